"""Validating a bundle: everything is recomputed from its ledger and its bank, and nothing that it prints is trusted."""

import hashlib
import json
import sqlite3
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from eyechart.bundle.comparing import Difference, Rounding, compare_tables, compare_values, printable
from eyechart.bundle.contents import (
    FORMAT,
    INDEX,
    REPORT,
    RESULTS,
    RUN_FOLDER,
    TABLES,
    Derived,
    Recipe,
    as_json,
    derive,
    drawn_with,
)
from eyechart.bundle.evidence import check_bank, check_requests
from eyechart.bundle.pages import Strictness, compare_pages
from eyechart.bundle.unpacking import unpack
from eyechart.errors import BundleError, EyechartError
from eyechart.frames import FrameBank, open_unchecked
from eyechart.ledger import Ledger
from eyechart.manifest import BANK, BANK_TEXT, LEDGER, RUN, RunManifest, asked_of, read_manifest
from eyechart.studies.battery.planning import plan_of
from eyechart.studies.battery.subjects import Tell, used_pictures

_LONGER = 4
"""A file that is so many times as long as it should be is not looked into."""


@dataclass(frozen=True)
class Validation:
    """What a validation found: every figure that does not follow, what was compared, and what could not be.

    ``uncompared`` are the things that other versions of libraries, or of eyechart, draw otherwise, by the bundle's own
    word; ``otherwise`` the figures of another eyechart that this one computes otherwise.
    """

    differences: tuple[Difference, ...]
    compared: Mapping[str, int]
    notes: tuple[str, ...]
    uncompared: tuple[str, ...] = ()
    otherwise: tuple[Difference, ...] = ()

    @property
    def holds(self) -> bool:
        """Return whether everything was compared, and follows from the ledger and the bank."""
        return not self.differences and not self.uncompared

    @property
    def outcome(self) -> str:
        """Return in words whether it holds, how many differences there are, or what could not be compared."""
        if self.differences:
            return f"{len(self.differences)} differences"
        return f"holds, {' and '.join(self.uncompared)} not compared" if self.uncompared else "holds"

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        return {
            "holds": self.holds,
            "outcome": self.outcome,
            "uncompared": list(self.uncompared),
            "otherwise": [one.as_dict() for one in self.otherwise],
            "differences": [one.as_dict() for one in self.differences],
            "compared": dict(self.compared),
            "notes": list(self.notes),
        }


def validate(file: Path, *, tell: Tell = lambda _: None) -> Validation:
    """Recompute every figure of a bundle from its ledger and its bank, and compare.

    Of a bundle of another eyechart everything that its run says is checked, and the figures as far as this one computes
    them alike. Raises BundleError where the file is no bundle, damaged, or would do harm.
    """
    if file.exists() and not file.is_file():
        raise BundleError(f"{file} is no bundle file but {'a folder' if file.is_dir() else 'a device or a pipe'}")
    if not file.is_file():
        raise BundleError(f"{file} does not exist; 'eyechart bundle RUN --out {file.name}' makes one")
    with tempfile.TemporaryDirectory(prefix="eyechart-validate-") as work:
        folder = Path(work)
        tell("unpacking")
        names = unpack(file, folder)
        index = _read_index(file, folder)
        recipe = Recipe.from_dict(index)
        found = _Found([*_check_files(folder, names, index)], {"files": len(names)}, _unlike(recipe), [])
        try:
            _recompute(folder, names, recipe, found, tell)
        except (EyechartError, sqlite3.Error, RecursionError) as error:
            words = str(error).replace(f"{work}/", "")
            found.differences.append(Difference("everything that follows from the run", "results", words))
        return Validation(
            tuple(found.differences),
            found.compared,
            tuple(found.notes),
            tuple(found.uncompared),
            tuple(found.otherwise),
        )


@dataclass(frozen=True)
class _Found:
    """What a validation has found so far."""

    differences: list[Difference]
    compared: dict[str, int]
    notes: list[str]
    uncompared: list[str]
    otherwise: list[Difference] = field(default_factory=list)


def _read_index(file: Path, folder: Path) -> dict[str, object]:
    try:
        index = json.loads((folder / INDEX).read_bytes())
    except (OSError, ValueError, RecursionError) as error:
        raise BundleError(f"{file} is no bundle: it has no {INDEX} that can be read") from error
    if not isinstance(index, dict) or index.get("format") != FORMAT or not isinstance(index.get("files"), dict):
        raise BundleError(f"{file} is no bundle of the format {FORMAT!r}")
    return index


def _check_files(folder: Path, names: list[str], index: Mapping[str, object]) -> Iterator[Difference]:
    listed, there = index["files"], set(names)
    assert isinstance(listed, dict)
    for name in sorted({*listed, *there} - {INDEX}):
        path = folder / name
        digest = "no file"
        if name in there:
            with path.open("rb") as file:
                digest = hashlib.file_digest(file, "sha256").hexdigest()
        if digest != listed.get(name):
            yield Difference(f"file {name}, SHA-256", str(listed.get(name, "not listed")), digest)


def _unlike(recipe: Recipe) -> list[str]:
    here = drawn_with()
    return [
        f"drawn with {name} {printable(recipe.drawn_with.get(name, 'unknown'))[:40]}, here is {version}"
        for name, version in here.items()
        if recipe.drawn_with.get(name) != version
    ]


def _recompute(folder: Path, names: list[str], recipe: Recipe, found: _Found, tell: Tell) -> None:
    """Recompute from the run and compare; ``found`` takes the differences, what was compared, and what was not."""
    differences, compared, notes = found.differences, found.compared, found.notes
    run = folder / RUN_FOLDER
    manifest, bank = read_manifest(run), open_unchecked(run / BANK)
    asked = asked_of(bank, manifest.prompt)
    if not recipe.elsewhere and (run / RUN).read_bytes() != manifest.as_text().encode():
        differences.append(Difference(f"{RUN_FOLDER}/{RUN}", "written in another way", "as a run is written"))
    tell("checking the bank")
    differences += check_bank(manifest, asked)
    with Ledger(run / LEDGER) as ledger:
        ledger.require_plain()
        for key in ledger.damaged():
            place = f"{key.model}, {key.frame}, {key.condition}"
            differences.append(Difference(f"{LEDGER}, {place}", "a reply", "another than its checksum says"))
        tell("checking the requests")
        requests, count, unlike = check_requests(ledger, manifest, asked, same_encoder=_same(recipe, "pillow", "zlib"))
    differences += requests
    frames = {key.frame for key in plan_of(manifest, asked).keys()}  # noqa: SIM118 - a plan is no mapping
    compared |= {"frames": len(frames), "requests": count}
    if unlike:
        notes.append(f"this machine encodes the pictures of {', '.join(unlike)} to other bytes: no request compared")
        found.uncompared.append(f"requests of {', '.join(unlike)}")
    derived = derive(run, manifest, (asked, bank), recipe, tell)
    tell("comparing")
    differences += _check_foreign(names, manifest, asked, derived, recipe)
    compared |= _counted(manifest, asked, derived)
    if recipe.elsewhere:
        _compare_elsewhere(folder, recipe.elsewhere, derived, found)
        return
    differences += _compare(folder, recipe, derived)
    strict = _strictness(recipe)
    if not strict.drawings:
        notes.append("of the drawings only the words were compared")
        found.uncompared.append("drawings")
    if not strict.pictures:
        notes.append("the pictures in the page were not compared with those of the bank")
        found.uncompared.append("pictures")


def _compare_elsewhere(folder: Path, made: str, derived: Derived, found: _Found) -> None:
    """Compare what another eyechart printed: the replies as ever, the figures one by one, a file where it is the same.

    Whether a figure that differs was computed by other rules or changed by somebody, nobody can say from the file.
    """
    found.notes.append(made)
    for name, content in derived.files.items():
        if name != RESULTS and (not (folder / name).is_file() or (folder / name).read_bytes() != content):
            found.uncompared.append(name)
    printed, rounding = _read_results(folder), Rounding.of(derived.results)
    for replies, into in ((True, found.differences), (False, found.otherwise)):
        one, other = (
            {name: value for name, value in values.items() if (name == "replies_sha256") == replies}
            for values in (printed, derived.results)
        )
        into.extend(compare_values(one, other, rounding, _result_name))
    if found.otherwise:
        found.uncompared.append(f"{len(found.otherwise)} figures that this eyechart computes otherwise")


def _read_results(folder: Path) -> dict[str, object]:
    try:
        printed = json.loads((folder / RESULTS).read_bytes())
    except (OSError, ValueError, RecursionError) as error:
        raise BundleError(f"{RESULTS} cannot be read: {error}") from error
    if not isinstance(printed, dict):
        raise BundleError(f"{RESULTS} holds no results")
    return printed


def _check_foreign(
    names: list[str], manifest: RunManifest, asked: FrameBank, derived: Derived, recipe: Recipe
) -> Iterator[Difference]:
    """Yield every file that is neither part of the run nor made from it; another eyechart may make other tables."""
    bank = {f"{RUN_FOLDER}/{BANK}/{name}" for name in (*BANK_TEXT, *used_pictures(manifest, asked))}
    known = {INDEX, f"{RUN_FOLDER}/{RUN}", f"{RUN_FOLDER}/{LEDGER}", *derived.files, *bank}
    for name in names:
        if name not in known and not (recipe.elsewhere and name.startswith(TABLES)):
            yield Difference(f"file {name}", "in the bundle", "neither used by the run nor made from it")


def _strictness(recipe: Recipe) -> Strictness:
    return Strictness(drawings=_same(recipe, "matplotlib"), pictures=_same(recipe, "pillow", "webp"))


def _same(recipe: Recipe, *libraries: str) -> bool:
    here = drawn_with()
    return all(recipe.drawn_with.get(name) == here[name] for name in libraries)


def _compare(folder: Path, recipe: Recipe, derived: Derived) -> Iterator[Difference]:
    rounding = Rounding.of(derived.results)
    for name, content in derived.files.items():
        path = folder / name
        if not path.is_file():
            yield Difference(name, "no file", f"{len(content)} bytes")
            continue
        printed = path.read_bytes()
        if printed == content:
            continue
        if len(printed) > _LONGER * len(content):
            yield Difference(name, f"{len(printed)} bytes", f"{len(content)} bytes")
            continue
        texts = printed.decode("utf-8", "replace"), content.decode("utf-8", "replace")
        yield from _compare_file(name, texts, derived, rounding, _strictness(recipe))


def _compare_file(
    name: str, texts: tuple[str, str], derived: Derived, rounding: Rounding, how: Strictness
) -> Iterator[Difference]:
    if name == RESULTS:
        try:
            printed = json.loads(texts[0])
        except (ValueError, RecursionError):
            yield Difference(RESULTS, "no JSON", "the results")
            return
        yield from compare_values(printed, derived.results, rounding, _result_name)
        if not _as_written(printed, texts[0]):
            yield Difference(RESULTS, "written in another way", "as results are written")
    elif name == REPORT:
        yield from compare_pages(*texts, rounding, how)
    elif name.startswith(TABLES):
        yield from compare_tables(name, *texts, rounding)
    else:
        yield Difference(name, "another text", "that of every bundle")


def _as_written(values: object, text: str) -> bool:
    try:
        return as_json(values) == text.encode("utf-8", "backslashreplace")
    except ValueError:  # NaN and infinity, which no results hold
        return False


def _result_name(path: tuple[str | int, ...]) -> str:
    """Return in words which figure stands at a place of the results."""
    words = [str(part) for part in path if part not in {"score", "models", "statistics"}]
    return f"{RESULTS}, {', '.join(words)}"


def _counted(manifest: RunManifest, asked: FrameBank, derived: Derived) -> dict[str, int]:
    models = derived.score.models
    return {
        "models": len(manifest.models),
        "statistics": sum(len(one.statistics) for one in models.values()),
        "calls": sum(one.answered for one in models.values()),
        "pictures": len(used_pictures(manifest, asked)),
        "tables": sum(name.startswith(TABLES) for name in derived.files),
    }
