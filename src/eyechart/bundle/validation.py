"""Validate a bundle: recompute everything from its ledger and bank, trusting nothing it prints."""

import hashlib
import json
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from eyechart.bundle.contents import (
    FORMAT,
    INDEX,
    REPORT,
    RESULTS,
    RUN_FOLDER,
    SOURCE,
    TABLES,
    DerivedResults,
    Recipe,
    as_json,
    derive,
    digest_of,
    drawn_with,
    said_since,
)
from eyechart.bundle.differences import (
    PrintedDifference,
    RoundedNumbers,
    compare_tables,
    compare_values,
    is_same_writing,
    printable,
)
from eyechart.bundle.drives import ReplayCheck, RunCheck, check_drives, require_bounded_drives
from eyechart.bundle.pages import Tolerance, compare_pages
from eyechart.bundle.parts import OF_DRIVES, derive_parts, has_parts
from eyechart.bundle.reader import unpack
from eyechart.calls import CallKey
from eyechart.errors import BundleError, EyechartError, raising
from eyechart.frames import FrameBank, open_unchecked, read_bounded
from eyechart.ledger import Ledger
from eyechart.manifest import BANK, BANK_TEXT, LEDGER, RUN, RunManifest, asked_of, read_episodes_manifest, read_manifest
from eyechart.perception.view import find_view
from eyechart.records import JsonRecord
from eyechart.run import Plan
from eyechart.scratch import scratch
from eyechart.studies import Tell, is_episodes, study_of
from eyechart.studies.battery.plans import plan_of
from eyechart.studies.battery.stages import widest
from eyechart.studies.battery.subjects import used_pictures
from eyechart.studies.hierarchy.plans import PARTS

MOST_FRAMES = 250_000
MOST_CALLS = 5_000_000
"""The most frames and calls of a run in a bundle; each frame takes 2 kB, each call 1 kB."""
USUAL = ReplayCheck()
_SHOWN = 40
"""Differences are printed up to this number."""
_LONGER = 4
"""A file this many times too long is not read."""


@dataclass(frozen=True)
class Validation(JsonRecord):
    """The result of a validation: figures that do not follow, what was compared, what could not be.

    ``uncompared`` names what other versions of libraries or of eyechart draw differently, by the
    bundle's own record. ``otherwise`` holds the figures of another eyechart that this one computes
    differently.
    """

    uncompared: list[str]
    otherwise: list[PrintedDifference]
    differences: list[PrintedDifference]
    compared: dict[str, int]
    notes: list[str]

    @property
    def holds(self) -> bool:
        """Return whether everything was compared and follows from the ledger and the bank."""
        return not self.differences and not self.uncompared

    @property
    def outcome(self) -> str:
        """Return in words that it holds, how much differs, or what was not compared."""
        if self.differences:
            return f"{len(self.differences)} differences"
        return f"holds, {' and '.join(self.uncompared)} not compared" if self.uncompared else "holds"

    def lines(self) -> Iterator[str]:
        """Yield the first differences, what is computed otherwise here, the notes and the outcome."""
        yield from (f"differs: {difference}" for difference in self.differences[:_SHOWN])
        if len(self.differences) > _SHOWN:
            yield f"and {len(self.differences) - _SHOWN} more differences (--json prints all)"
        yield from (f"computed differently here: {one}" for one in self.otherwise[:_SHOWN])
        yield from (f"note: {note}" for note in self.notes)
        yield f"{self.outcome}: {', '.join(f'{count} {name}' for name, count in self.compared.items())}"

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        return {"holds": self.holds, "outcome": self.outcome, **super().as_dict()}


def validate(file: Path, *, tell: Tell = lambda _: None, again: ReplayCheck = USUAL) -> Validation:
    """Recompute every figure of a bundle, drive its episodes ``again``, and compare.

    For another eyechart's bundle, the run's own records are all checked; figures only as far as
    both compute them in the same way. Raises BundleError if the file is no bundle, is damaged, or
    is harmful.
    """
    if file.exists() and not file.is_file():
        raise BundleError(f"{file} is no bundle file but {'a folder' if file.is_dir() else 'a device or a pipe'}")
    if not file.is_file():
        raise BundleError(f"{file} does not exist; 'eyechart bundle RUN --out {file.name}' makes one")
    with scratch("validate") as work:
        folder = Path(work)
        tell("unpacking")
        names = unpack(file, folder)
        index = _read_index(file, folder)
        recipe = Recipe.from_dict(index)
        notes = [
            f"drawn with {name} {printable(recipe.drawn_with.get(name, 'unknown'))[:40]}, here it is {version}"
            for name, version in drawn_with().items()
            if recipe.drawn_with.get(name) != version
        ]
        validation = Validation([], [], [*_check_files(folder, names, index)], {"files": len(names)}, notes)
        try:
            recompute = _recompute_parts if has_parts(folder / RUN_FOLDER) else _recompute
            recompute(folder, names, recipe, validation, tell, again)
        except (EyechartError, sqlite3.Error, RecursionError) as error:
            words = str(error).replace(f"{work}/", "")
            validation.differences.append(PrintedDifference("everything that follows from the run", "results", words))
        return validation


def _require_bounded(run: Path, manifest: RunManifest) -> None:
    """Raise BundleError if a run is too large to validate, before its frames are read."""
    text = run / BANK / BANK_TEXT[1]
    frames = 0
    if text.is_file():  # else the bank reports it missing
        with text.open("rb") as lines:
            frames = sum(1 for _ in lines)
    planned = len(manifest.models) * (len(manifest.frames) or frames) * len(manifest.conditions) * manifest.answers
    with Ledger(run / LEDGER, sound=False) as ledger:
        requests = ledger.held().requests
    for what, count, most in (
        ("frames", frames, MOST_FRAMES),
        ("planned calls", planned, MOST_CALLS),
        ("attempts in its ledger", requests, MOST_CALLS),
    ):
        if count > most:
            raise BundleError(f"it has {count} {what}, more than the {most} that are validated: nothing is recomputed")


def _announce(runs: Sequence[Path], again: ReplayCheck) -> None:
    """Announce the bound of the work on runs whose calls are recomputed."""
    if not runs:
        return
    calls, models = 0, set[tuple[Path, str]]()
    for run in runs:
        manifest = read_manifest(run)
        _require_bounded(run, manifest)
        models |= {(run, spec) for spec in manifest.models}
        with Ledger(run / LEDGER, sound=False) as ledger:
            calls += ledger.held().requests
    where = "" if len(runs) == 1 else f" in {len(runs)} cells"
    again.announce(
        f"recomputing {calls} requests and the results of their replies, of {len(models)} models{where}: no call"
    )


def _read_index(file: Path, folder: Path) -> dict[str, object]:
    try:
        index = json.loads((folder / INDEX).read_bytes())
    except (OSError, ValueError, RecursionError) as error:
        raise BundleError(f"{file} is no bundle: it has no {INDEX} that can be read") from error
    if not isinstance(index, dict) or index.get("format") != FORMAT or not isinstance(index.get("files"), dict):
        raise BundleError(f"{file} is no bundle of the format {FORMAT!r}")
    return index


def _check_files(folder: Path, names: list[str], index: Mapping[str, object]) -> Iterator[PrintedDifference]:
    listed, there = index["files"], set(names)
    assert isinstance(listed, dict)
    for name in sorted({*listed, *there} - {INDEX}):
        path = folder / name
        digest = digest_of(path) if name in there else "no file"
        if digest != listed.get(name):
            yield PrintedDifference(f"file {name}, SHA-256", str(listed.get(name, "not listed")), digest)


def _recompute(
    folder: Path, names: list[str], recipe: Recipe, validation: Validation, tell: Tell, again: ReplayCheck
) -> None:
    """Recompute a run on a bank and compare; adds to ``found``."""
    run = folder / RUN_FOLDER
    _announce([run], again)
    manifest, bank_used, bank = _check_calls(run, recipe, mine := RunCheck([], [], [], {}), tell)
    made = recipe.elsewhere(manifest.prompt.readers)
    _add(mine, validation)
    derived = derive(run, manifest, (bank_used, bank), recipe, tell)
    pictures = used_pictures(manifest, bank_used)
    held = {f"{RUN_FOLDER}/{name}" for name in (RUN, LEDGER, *(f"{BANK}/{file}" for file in (*BANK_TEXT, *pictures)))}
    validation.compared.update(derived.counted, pictures=len(pictures))
    _compare_derived(folder, names, held, recipe, made, derived, validation)


def _recompute_parts(
    folder: Path, names: list[str], recipe: Recipe, validation: Validation, tell: Tell, again: ReplayCheck
) -> None:
    """Recompute the runs of a study and compare; drives again only in worlds that ship."""
    run, held, made = folder / RUN_FOLDER, set[str](), recipe.elsewhere()
    study = study_of(run, "bundle")
    _announce([part for part in study.runs(run).values() if not is_episodes(part)], again)
    for name, part in study.runs(run).items():
        here, said = (f"{RUN_FOLDER}/{name}" if name else RUN_FOLDER), f"{name}: " if name else ""
        if is_episodes(part):
            require_bounded_drives(part)
            if name in PARTS and read_episodes_manifest(part).simulator != PARTS[name].simulator:
                raise BundleError(f"{here} is no part of the hierarchy: it is not driven in {PARTS[name].simulator}")
            same = _has_same(recipe, "pillow", "zlib")
            mine = check_drives(part, exact=made is None, same_pictures=same, how=again, tell=tell)
            held |= {f"{here}/{file}" for file in OF_DRIVES}
        else:
            mine = RunCheck([], [], [], {})
            manifest, bank_used, _ = _check_calls(part, recipe, mine, tell)
            held |= {f"{here}/{file}" for file in (RUN, LEDGER)}
            held |= {f"{here}/{BANK}/{file}" for file in (*BANK_TEXT, *used_pictures(manifest, bank_used))}
        _add(mine, validation, said)
    derived = derive_parts(run, recipe, tell)
    validation.compared.update(derived.counted)
    _compare_derived(folder, names, held, recipe, made, derived, validation)


def _add(mine: RunCheck, validation: Validation, said: str = "") -> None:
    """Add the findings of one run; ``said`` names the run among several."""
    validation.differences.extend(
        replace(difference, where=f"{said}{difference.where}") for difference in mine.differences
    )
    validation.uncompared.extend(f"{said}{one}" for one in mine.uncompared)
    validation.notes.extend(f"{said}{note}" for note in mine.notes)
    for what, count in mine.compared.items():
        validation.compared[what] = validation.compared.get(what, 0) + count


def _check_calls(run: Path, recipe: Recipe, check: RunCheck, tell: Tell) -> tuple[RunManifest, FrameBank, FrameBank]:
    """Check a run's bank and requests; return its manifest, its bank as used, and as stored."""
    manifest = read_manifest(run)
    _require_bounded(run, manifest)
    bank = open_unchecked(run / BANK)
    bank_used = asked_of(bank, manifest.prompt, recipe.reader)
    if not recipe.elsewhere(manifest.prompt.readers) and (run / RUN).read_bytes() != manifest.as_text().encode():
        check.differences.append(
            PrintedDifference(f"{RUN_FOLDER}/{RUN}", "written in another way", "as a run is written")
        )
    tell("checking the bank")
    check.differences.extend(check_bank(manifest, bank_used))
    with Ledger(run / LEDGER, sound=False) as ledger:
        damaged = ledger.damaged()
        check.differences.extend(
            PrintedDifference(f"{LEDGER}, {one}", "a row", "another than was written") for one in damaged
        )
        ledger.take()  # so that figures from damaged rows are named too
        if unchecked := ledger.unchecked():
            check.notes.append(f"{unchecked} replies are older than checksums: not checked")
        tell("checking the requests")
        requests, count, unlike = check_requests(
            ledger, manifest, bank_used, same_encoder=_has_same(recipe, "pillow", "zlib")
        )
    check.differences.extend(requests)
    frames = {key.frame for key in plan_of(manifest, bank_used).keys()}  # noqa: SIM118 - a plan is no mapping
    check.compared.update({"frames": len(frames), "requests": count})
    if unlike:
        named = ", ".join(unlike)
        check.notes.append(f"this machine encodes the pictures of {named} to other bytes: no request compared")
        check.uncompared.append(f"requests of {named}")
    return manifest, bank_used, bank


def _compare_derived(
    folder: Path,
    names: list[str],
    held: set[str],
    recipe: Recipe,
    made: str | None,
    derived: DerivedResults,
    validation: Validation,
) -> None:
    """Compare every file that follows from the runs; ``held`` are the files of the runs.

    ``made`` names another eyechart that made it; None for this one.
    """
    held |= {INDEX, *derived.files}
    validation.differences.extend(
        PrintedDifference(f"file {name}", "in the bundle", "neither used by the run nor made from it")
        for name in names
        if name not in held and not (made and name.startswith((TABLES, SOURCE)))  # it has others
    )
    validation.compared["tables"] = sum(name.startswith(TABLES) for name in derived.files)
    if made:
        _compare_elsewhere(folder, made, derived, validation)
        return
    strict = Tolerance(drawings=_has_same(recipe, "matplotlib"), pictures=_has_same(recipe, "pillow", "webp"))
    validation.differences.extend(_compare(folder, derived, strict))
    if not strict.drawings:
        validation.notes.append("of the drawings only the words were compared")
        validation.uncompared.append("drawings")
    if not strict.pictures:
        validation.notes.append("the pictures in the page were not compared with those of the bank")
        validation.uncompared.append("pictures")


def _compare_elsewhere(folder: Path, made: str, derived: DerivedResults, validation: Validation) -> None:
    """Compare another eyechart's output: replies strictly, figures one by one, files if equal.

    The file cannot show whether other rules or a person changed a figure.
    """
    validation.notes.append(made)
    for name, content in derived.files.items():
        if name != RESULTS and (not (folder / name).is_file() or (folder / name).read_bytes() != content):
            what = "the controllers' source" if name.startswith(SOURCE) else name
            validation.uncompared.extend([what] if what not in validation.uncompared else [])
    printed, rounding = _read_results(folder), RoundedNumbers.of(derived.results)
    follows = said_since(printed, derived.results)
    for replies, into in ((True, validation.differences), (False, validation.otherwise)):
        one, other = (
            {name: value for name, value in values.items() if (name == "replies_sha256") == replies}
            for values in (printed, follows)
        )
        into.extend(compare_values(one, other, rounding, _result_name))
    if validation.otherwise:
        validation.uncompared.append(f"{len(validation.otherwise)} figures that this eyechart computes differently")


def _read_results(folder: Path) -> dict[str, object]:
    with raising(BundleError, f"{RESULTS} cannot be read", of=(OSError, ValueError, RecursionError)):
        printed = json.loads((folder / RESULTS).read_bytes())
    if not isinstance(printed, dict):
        raise BundleError(f"{RESULTS} holds no results")
    return printed


def _has_same(recipe: Recipe, *libraries: str) -> bool:
    here = drawn_with()
    return all(recipe.drawn_with.get(name) == here[name] for name in libraries)


def _compare(folder: Path, derived: DerivedResults, how: Tolerance) -> Iterator[PrintedDifference]:
    rounding = RoundedNumbers.of(derived.results)
    for name, content in derived.files.items():
        path = folder / name
        if not path.is_file():
            yield PrintedDifference(name, "no file", f"{len(content)} bytes")
        elif len(printed := path.read_bytes()) > _LONGER * len(content):
            yield PrintedDifference(name, f"{len(printed)} bytes", f"{len(content)} bytes")
        elif printed != content:
            texts = printed.decode("utf-8", "replace"), content.decode("utf-8", "replace")
            yield from _compare_file(name, texts, derived, rounding, how)


def _compare_file(
    name: str, texts: tuple[str, str], derived: DerivedResults, rounding: RoundedNumbers, how: Tolerance
) -> Iterator[PrintedDifference]:
    if name == RESULTS:
        try:
            printed = json.loads(texts[0])
        except (ValueError, RecursionError):
            yield PrintedDifference(RESULTS, "no JSON", "the results")
            return
        yield from compare_values(printed, derived.results, rounding, _result_name)
        if not is_same_writing(printed, texts[0], lambda values: as_json(values).decode()):
            yield PrintedDifference(RESULTS, "written in another way", "as results are written")
    elif name == REPORT:
        yield from compare_pages(*texts, rounding, how)
    elif name.startswith(TABLES):
        yield from compare_tables(name, *texts, rounding)
    else:
        yield PrintedDifference(
            name, "another text", "this eyechart's" if name.startswith(SOURCE) else "that of every bundle"
        )


def _result_name(path: tuple[str | int, ...]) -> str:
    """Return in words which figure is at a place of the results."""
    words = [str(part) for part in path if part not in {"score", "models", "statistics"}]
    return f"{RESULTS}, {', '.join(words)}"


def check_bank(manifest: RunManifest, bank: FrameBank) -> Iterator[PrintedDifference]:
    """Yield frames with another ground truth than recorded, and used pictures with other bytes."""
    recorded = dict(bank.manifest.geometry)
    if manifest.fingerprint != bank.manifest.fingerprint:
        yield PrintedDifference("bank, fingerprint", manifest.fingerprint, bank.manifest.fingerprint)
    for frame in bank:
        if frame.geometry() != recorded.pop(frame.id, None):
            gap = bank.manifest.gap
            gap_words = "" if gap is None else f" ({gap.column} {frame.truth.get(gap.column)})"
            digest = str(bank.manifest.geometry.get(frame.id))
            yield PrintedDifference(f"bank, ground truth of frame '{frame.id}'{gap_words}", digest, frame.geometry())
    for frame_id in recorded:
        yield PrintedDifference(f"bank, frame '{frame_id}'", "recorded", "missing")
    if [frame.id for frame in bank] != list(bank.manifest.geometry):
        yield PrintedDifference("bank, order of the frames", "as recorded", "another")
    for file, shown in _uses(manifest, bank).items():
        yield from _check_picture(bank, file, shown)


def _uses(manifest: RunManifest, bank: FrameBank) -> dict[str, list[str]]:
    """Return the frames and conditions of each picture that the run used."""
    plan, uses = widest(manifest, plan_of(manifest, bank)), dict[str, list[str]]()
    seen = dict.fromkeys((key.frame, key.condition) for key in plan.keys())  # noqa: SIM118 - a plan is no mapping
    for frame_id, condition in seen:
        for file in plan.sources(condition, bank.frame(frame_id)):
            uses.setdefault(file, []).append(f"{frame_id} under {condition}")
    return uses


def _check_picture(bank: FrameBank, file: str, shown: list[str]) -> Iterator[PrintedDifference]:
    more = f" and {len(shown) - 3} more" if len(shown) > 3 else ""
    where = f"bank, picture {file} (shown for {', '.join(shown[:3])}{more})"
    recorded = bank.manifest.images.get(file, "nothing")
    try:
        digest = hashlib.sha256(read_bounded(bank.root, file)).hexdigest()
    except EyechartError as error:
        digest = str(error)
    if digest != recorded:
        yield PrintedDifference(where, recorded, digest)


def check_requests(
    ledger: Ledger, manifest: RunManifest, bank: FrameBank, *, same_encoder: bool
) -> tuple[list[PrintedDifference], int, list[str]]:
    """Compare the digest of every request in the ledger with the one that the bank gives.

    Return the differences, the number of requests compared, and the conditions that could not be
    compared. This machine encodes the pictures of those conditions to other bytes; with the
    ``same_encoder`` there are none.
    """
    plan, requests = plan_of(manifest, bank, view=find_view(manifest.view)), dict[tuple[str, str], str]()
    differs: dict[str, list[PrintedDifference]] = {}
    alike: dict[str, int] = {}
    for model in manifest.models:
        for sent in ledger.attempts(model):
            key, digest = sent.key, sent.request_sha256
            shown = (key.condition, key.frame)
            if shown not in requests:
                requests[shown] = _request(plan, *shown)
            if digest == requests[shown]:
                alike[key.condition] = alike.get(key.condition, 0) + 1
            else:
                where = f"ledger, request of {model} about frame '{key.frame}' under {key.condition}"
                differs.setdefault(key.condition, []).append(PrintedDifference(where, digest, requests[shown]))
    unlike = [name for name in differs if not same_encoder and name not in alike and _is_encoded(plan, name)]
    found = [one for name, many in differs.items() if name not in unlike for one in many]
    return found, sum(alike.values()) + len(found), unlike


def _is_encoded(plan: Plan, condition: str) -> bool:
    """Return whether a condition's pictures are encoded when shown, as the library does it."""
    if plan.view is not None:
        return True
    frame = next(frame for frame in plan.frames if plan.shows(condition, frame))
    try:
        stored = replace(plan.bank, plain=False)
        files = [stored.read(file) for file in plan.sources(condition, frame)]
        return not all(image in files for image in plan.seen(condition, frame).pictures)
    except EyechartError:
        return False


def _request(plan: Plan, condition: str, frame_id: str) -> str:
    """Return the digest of the request about a frame and condition, or why there is none."""
    try:
        seen = plan.seen(condition, plan.bank.frame(frame_id))
        return plan.query(CallKey(plan.study, "", plan.prompt.key, frame_id, condition), seen).sha256()
    except EyechartError as error:
        return str(error)
