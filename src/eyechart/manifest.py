"""A run's manifest: what it asks and which models, so that it can be resumed, merged and read."""

import datetime as dt
import json
import os
import platform
import shlex
import shutil
import sqlite3
from collections.abc import Container, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, ClassVar, Self, TypeVar

from eyechart import __version__
from eyechart.conditions import find_condition
from eyechart.corruptions import CORRUPTIONS
from eyechart.errors import LedgerError, SpecError, raising, require_known, text_file, why
from eyechart.frames import (
    AS_STORED,
    ENCODINGS,
    NEWEST,
    BankManifest,
    FrameBank,
    locked,
    open_bank,
    read_bank_manifest,
)
from eyechart.limits import NOTHING, Limits, Usage, added
from eyechart.models.prices import Prices
from eyechart.models.sources import changed, is_formerly
from eyechart.modes import RequestMode
from eyechart.perception.view import NONE
from eyechart.prompts import Prompt
from eyechart.records import build, parse_json, shown
from eyechart.spaces.discrete import Discrete, named_actions
from eyechart.spaces.motion import require_motions
from eyechart.spaces.reader import READER

LEDGER = "ledger.sqlite"
RUN = "run.json"
EPISODES = "episodes.jsonl"
"""A run's finished episodes, one per line, in the order of their ends."""
BANK = "bank"
"""The run's copy of the bank's text; in a bundle with the used pictures."""
BANK_TEXT = ("manifest.json", "metadata.jsonl")
OWN = ".own"
"""Marks a bank that was made in this folder for this run alone."""
BESIDE = ("vetting.json", "seen.json")
"""Files that may precede a run's episodes: the worlds that an online run chose."""

MOST_CONDITIONS, MOST_ANSWERS = 1_000, 10_000
"""The most conditions of a run, and the most answers per question from a sampling policy."""
CONTROLS_ASKED = ("none", "auto", "all")
"""The control conditions that a run may ask, from the fewest."""


MOVED = "moved"
"""The fact of a model that says when its run continued at another address."""


class Manifest:
    """The common part of all runs' manifests, and how one is extended by another of the same run.

    ``modes`` are the models' request modes, and ``facts`` their known properties (digest,
    quantisation, template). ``reader`` is the version of the reader of replies. ``view`` is the key
    of the view for pictures, or ``none``. ``probes`` says what probing each model took.
    """

    __slots__ = ()
    FORMAT: ClassVar[str]
    COMMAND: ClassVar[str]
    """The command that makes such a run."""
    WHO: ClassVar[str]
    """The field that maps each subject or driver to a version."""
    ASKED: ClassVar[str]
    """What the run did with a subject, in words."""
    SAME: ClassVar[tuple[str, ...]]
    GROWS: ClassVar[tuple[str, ...]]

    prompt: Prompt
    modes: Mapping[str, RequestMode]
    facts: Mapping[str, Mapping[str, str]]
    probes: Mapping[str, Usage]

    def mode(self, spec: str) -> RequestMode:
        """Return a model's request mode; the default mode if the run has none."""
        return self.modes.get(spec) or RequestMode(spec)

    def spent_before(self) -> Usage:
        """Return what probing took, for all models together."""
        return Usage.together(self.probes.values())

    def within(
        self, prices: Prices, *, calls: int | None = None, cost_usd: float | None = None, before: Usage = NOTHING
    ) -> Limits:
        """Return a run's limits: requests, and dollars at these prices.

        What was spent ``before`` counts, and so does probing.
        """
        spent = Usage.together([self.spent_before(), before])
        return Limits(calls, cost_usd, before=spent, cost=lambda spec, reply: prices.cost(self.mode(spec), reply)[0])

    def counting(self, probes: Mapping[str, Usage]) -> Self:
        """Return this manifest with what was spent on probing models, added to earlier probes."""
        return replace(self, probes={**self.probes, **added(self.probes, probes)})  # type: ignore[type-var]

    def extended(self, other: Self) -> Self:
        """Return this manifest extended by another.

        Raises LedgerError that names the difference if the two cannot be one run.
        """
        for name in self.SAME:
            mine, theirs = getattr(self, name), getattr(other, name)
            if mine != theirs:
                before, now = self._said_of(name, other), other._said_of(name, self)
                raise LedgerError(
                    f"this run has {before}, now {now} was asked for; give the same options to resume it, "
                    "or another --out for another run"
                )
        grown = self._wider(other)
        before, now = getattr(self, self.WHO), getattr(other, self.WHO)
        older = {spec for spec in before.keys() & now.keys() if self._is_newer(spec, other)}
        for spec in before.keys() & now.keys():
            if spec not in older:
                self._require_version(spec, other)
            self._require_mode(spec, other)
        modes = {spec: mode for spec, mode in other.modes.items() if mode.measured or spec not in self.modes}
        for name in self.GROWS:
            grown[name] = tuple(dict.fromkeys([*getattr(self, name), *getattr(other, name)]))
        added = {spec: more for spec, more in other.facts.items() if spec not in older}
        facts = {spec: {**_moves(self.facts.get(spec, {})), **more} for spec, more in added.items()}
        who = {spec: version for spec, version in now.items() if spec not in older}
        for name, more in ((self.WHO, who), ("modes", modes), ("facts", facts), ("probes", other.probes)):
            grown[name] = {**getattr(self, name), **more}
        return replace(self, **grown)  # type: ignore[type-var]

    def _require_version(self, spec: str, other: Self) -> None:
        """Raise LedgerError that names the change if the versions of a common subject differ."""
        before, now = getattr(self, self.WHO)[spec], getattr(other, self.WHO)[spec]
        if before != now and not other._is_newer(spec, self):
            which = changed(self.facts.get(spec, {}), other.facts.get(spec, {}))
            raise LedgerError(
                f"this run {self.ASKED.format(spec)} at version {before}, which is now "
                f"{now}{which and f' ({which})'}. One run cannot hold two versions: give another --out, or "
                "restore the files or the program of the earlier version"
            )

    def _require_mode(self, spec: str, other: Self) -> None:
        """Raise LedgerError if a model's request mode differs."""
        mine, theirs = self.mode(spec), other.mode(spec)
        if mine.is_same_request(theirs):
            return
        if mine.differs_in_address_only(theirs):
            raise LedgerError(
                f"this run asked {spec} at {mine.base_url or 'the usual address'}, but its address, key, "
                f"headers or patience have changed ({theirs.base_url or 'the usual address'}). Give the same, "
                "another --out for another run, or continue a run with --moved, which records it"
            )
        mine, theirs = mine.request(), theirs.request()
        name = next(one.name for one in fields(mine) if getattr(mine, one.name) != getattr(theirs, one.name))
        difference = f"{name} was {getattr(mine, name)!r}, now {getattr(theirs, name)!r}"
        raise LedgerError(
            f"this run asked {spec} in another mode: {difference}; "
            "give the same options or --mode file to resume it, or another --out"
        )

    def _is_newer(self, spec: str, other: Self) -> bool:
        """Return whether the other version of a callable is from before its imports counted."""
        version = getattr(other, self.WHO)[spec]
        return is_formerly(version, other.facts.get(spec, {}), self.facts.get(spec, {}))

    def moved(self, modes: Iterable[RequestMode]) -> Self:
        """Return this manifest moved to these modes' addresses; ``facts`` record the move."""
        kept, facts, when = dict(self.modes), dict(self.facts), dt.datetime.now(dt.UTC).isoformat(timespec="seconds")
        for mode in modes:
            before = kept.get(mode.spec)
            if before is not None and not before.is_same_request(after := before.moved_to(mode)):
                known = facts.get(mode.spec, {})
                said = f"{when} from {before.base_url or 'the usual address'} to {mode.base_url or 'the usual address'}"
                facts[mode.spec] = {**known, MOVED: "; ".join([*_moves(known).values(), said])}
                kept[mode.spec] = after
        return replace(self, modes=kept, facts=facts)  # type: ignore[type-var]

    def as_text(self) -> str:
        """Return the JSON text of the manifest's file."""
        modes = {spec: mode.as_dict() for spec, mode in self.modes.items()}
        values = {**asdict(self), "prompt": self.prompt.as_dict(), "modes": modes}  # type: ignore[call-overload]
        if isinstance(self, EpisodesManifest):
            values["action_space"] = self.action_space.as_dict()
        return json.dumps({"format": self.FORMAT, **values}, indent=1, ensure_ascii=False) + "\n"

    def write(self, out: Path) -> None:
        """Write the manifest into the run's folder, atomically."""
        partial = out / f".{RUN}"
        with partial.open("w", encoding="utf-8") as file:
            file.write(self.as_text())
            file.flush()
            os.fsync(file.fileno())
        partial.replace(out / RUN)

    def _said_of(self, name: str, other: Self) -> str:
        """Return in words a field of this manifest that differs from another's."""
        own = getattr(self, name)
        if isinstance(self, RunManifest) and name == "fingerprint":
            return f"the bank {self.bank_path} (fingerprint {self.fingerprint[:16]})"
        if not isinstance(own, Prompt):
            return f"{name} {own}"
        space, theirs = own.space, other.prompt.space
        if space == theirs or "model" in {own.who, other.prompt.who}:
            return f"{name} {own.key}"
        apart = require_motions(space).apart(require_motions(theirs))
        return f"motion with {', '.join(f'{what} {mine}' for what, (mine, _) in apart.items()) or 'another reflection'}"

    def _wider(self, other: Self) -> dict[str, Any]:
        """Return the joint limits of both; raises LedgerError if they conflict."""
        raise NotImplementedError


VersionFacts = tuple[str, Mapping[str, str]]
"""A subject's version, and its known facts."""


@dataclass(frozen=True, slots=True)
class RunManifest(Manifest):
    """The plan of a run on a bank; ``models`` maps a SPEC to the version that answered.

    ``shard`` is (i, n), counted from 1, or None for the whole. ``limit`` is the number of frames,
    or None for all. With ``stop_early`` a model is no longer asked once its verdict is settled.
    ``reader`` is the reader's version at the start. ``frames`` are chosen ids, empty for all or the
    first ``limit``.
    ``controls`` says which control conditions are asked in addition to ``conditions``: none;
    ``auto``, those that each model's answers need, in later stages; or all, among ``conditions``.
    ``controls_seed`` is the seed of the bank's controls, or None. ``answers`` is the number of
    answers per question from a sampling policy. ``encoding`` says how pictures are sent.
    ``series`` are corruptions whose steps are asked in later stages.
    """

    FORMAT = "eyechart-run/2"
    COMMAND = "battery"
    WHO = "models"
    ASKED = "asked {}"
    SAME = (
        "study",
        "seed",
        "view",
        "prompt",
        "fingerprint",
        "shard",
        "stop_early",
        "frames",
        "answers",
        "encoding",
        "reader",
    )
    GROWS = ("conditions", "series")

    study: str
    created: str
    seed: int
    prompt: Prompt
    models: Mapping[str, str]
    conditions: tuple[str, ...]
    limit: int | None
    shard: tuple[int, int] | None
    bank_path: str
    fingerprint: str
    versions: Mapping[str, str]
    stop_early: bool = False
    modes: Mapping[str, RequestMode] = field(default_factory=dict)
    facts: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    reader: int = READER
    view: str = NONE
    frames: tuple[str, ...] = ()
    probes: Mapping[str, Usage] = field(default_factory=dict)
    controls: str = "none"
    controls_seed: int | None = None
    answers: int = 1
    encoding: str = AS_STORED
    series: tuple[str, ...] = ()

    def require_reader(self, path: Path, known: tuple[int, ...], *, reread: bool) -> None:
        """Raise LedgerError if the run's reader version is not ``known`` (today's is last).

        With ``reread`` any version is allowed.
        """
        if self.reader not in known and not reread:
            raise LedgerError(
                f"{path} was started with version {self.reader} of the reader of replies, and this is version "
                f"{known[-1]}. Replies may now be read differently: read its replies anew with --reread"
            )

    @classmethod
    def begun(
        cls,
        bank: FrameBank,
        modes: Mapping[str, RequestMode],
        who: Mapping[str, VersionFacts],
        **fields: Any,  # noqa: ANN401
    ) -> "RunManifest":
        """Return the manifest of a run on a bank that starts today, with further ``fields``."""
        return cls(
            created=today(),
            models={spec: version for spec, (version, _) in who.items()},
            bank_path=str(bank.root.resolve()),
            fingerprint=bank.manifest.fingerprint,
            versions=versions(),
            modes=modes,
            facts={spec: dict(facts) for spec, (_, facts) in who.items() if facts},
            encoding=NEWEST,
            **fields,
        )

    def _wider(self, other: "RunManifest") -> dict[str, Any]:
        if CONTROLS_ASKED.index(other.controls) < CONTROLS_ASKED.index(self.controls):
            raise LedgerError(
                f"this run was started with --controls {self.controls}, now {other.controls} was asked for; "
                "give at least as many to resume it, or another --out for another run"
            )
        limit = None if None in {self.limit, other.limit} else max(self.limit or 0, other.limit or 0)
        return {"limit": limit, "controls": other.controls}


MARGINAL = "marginal"
"""The beginning of the SPEC of a policy that draws from a controller's decisions."""


def own_marginal(spec: str, drivers: Container[str]) -> str:
    """Return the driver that ``marginal:DRIVER`` names; "" for an earlier run's or other policy."""
    kind, _, name = spec.partition(":")
    return name if kind == MARGINAL and name.partition(":")[0] != MARGINAL and name in drivers else ""


@dataclass(frozen=True, slots=True)
class EpisodesManifest(Manifest):
    """The plan of a run of episodes: every policy in every scenario, seed and condition.

    ``policies`` maps a SPEC to the version of the driver: a model's own, a marginal's counts, or
    nothing. The marginal of a driver of this run has no counts until it drives.
    ``picture`` describes the pictures. ``world`` holds the versions of the libraries that make the
    world, and ``versions`` all that may matter. ``max_steps`` is the largest bound on decisions;
    each episode records its own. ``silence`` says what a call does that fails but may succeed
    later: the episode stays ``unfinished``, or the ``fail-safe`` is executed. ``reflected`` says
    whether models were also asked about reflections.
    """

    FORMAT = "eyechart-episodes/1"
    COMMAND = "closed-loop"
    WHO = "policies"
    ASKED = "let {} drive"
    SAME = ("simulator", "seed", "view", "prompt", "world", "reader", "silence", "reflected")
    GROWS = ("scenarios", "seeds", "conditions")

    created: str
    simulator: str
    scenarios: tuple[str, ...]
    seeds: tuple[int, ...]
    conditions: tuple[str, ...]
    policies: Mapping[str, str]
    action_space: Discrete
    picture: str
    prompt: Prompt
    seed: int
    max_steps: int
    world: Mapping[str, str]
    versions: Mapping[str, str]
    modes: Mapping[str, RequestMode] = field(default_factory=dict)
    facts: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    reader: int = READER
    view: str = NONE
    probes: Mapping[str, Usage] = field(default_factory=dict)
    silence: str = "unfinished"
    reflected: bool = False

    @property
    def models(self) -> tuple[str, ...]:
        """Return the policies that are models."""
        return tuple(self.modes)

    def marginal_of(self, spec: str) -> str:
        """Return the driver of this run whose decisions a policy draws from, or ""."""
        return own_marginal(spec, self.policies)

    def _wider(self, other: "EpisodesManifest") -> dict[str, Any]:
        if other.max_steps < self.max_steps:
            raise LedgerError(
                f"this run has --max-steps {self.max_steps}, now {other.max_steps} was asked for: finished "
                "drives may be longer; give at least as many, or another --out"
            )
        return {"max_steps": other.max_steps}


def _moves(facts: Mapping[str, str]) -> dict[str, str]:
    return {MOVED: facts[MOVED]} if MOVED in facts else {}


M = TypeVar("M", RunManifest, EpisodesManifest)


def versions() -> dict[str, str]:
    """Return the versions that may matter to a picture or a number."""
    from importlib.metadata import PackageNotFoundError, version  # noqa: PLC0415 - slow to import

    result = {"eyechart": __version__, "python": platform.python_version()}
    for package in ("numpy", "scipy", "pillow", "highway-env", "gymnasium", "pygame-ce"):
        try:
            result[package] = version(package)
        except PackageNotFoundError:
            continue
    return result


def today() -> str:
    """Return the date in UTC, as a run records it."""
    return dt.datetime.now(dt.UTC).date().isoformat()


def write_run(out: Path, manifest: RunManifest, bank: FrameBank) -> None:
    """Write a run's manifest and its bank's text (no pictures) into the run's folder.

    Raises LedgerError if ``out`` is taken by something that is no run.
    """
    copy = out / BANK
    if not is_run(out) and not holds(out, bank):
        if not is_free(out):
            raise LedgerError(f"{out} exists and is no run; choose another place with --out")
        shutil.rmtree(copy, ignore_errors=True)  # left by a run cut before its manifest
        partial = out / f".{BANK}"
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir()
        for name in BANK_TEXT:
            shutil.copyfile(bank.root / name, partial / name)
        partial.replace(copy)
    elif is_run(out):
        _take_added(copy, bank)
    manifest.write(out)


def _take_added(copy: Path, bank: FrameBank) -> None:
    """Copy additions to a run's bank: pictures that its manifest names now, and how they were made.

    Raises LedgerError if both say how they were made, and not the same.
    """
    then, now = (folder / "manifest.json" for folder in (copy, bank.root))
    before, made = read_bank_manifest(copy), bank.manifest.made
    if made and before.made and made != before.made:
        raise LedgerError(
            f"the control pictures are {made} by {bank.root}, and {before.made} by the run in {copy.parent}: "
            f"say which with 'eyechart frames declare {shlex.quote(str(bank.root))} {shlex.quote(str(copy.parent))} "
            "--made WORD'"
        )
    more = bank.manifest.images.keys() - before.images.keys() or (made and not before.made)
    if more and before.fingerprint == bank.manifest.fingerprint and now.is_file():
        partial = copy / ".manifest.json"
        shutil.copyfile(now, partial)
        partial.replace(then)


@contextmanager
def alone_in(out: Path) -> Iterator[None]:
    """Hold a run's folder, which is made if missing (for a link, its target).

    Raises LedgerError if another process holds it, it cannot be made or its ledger cannot be written.
    Also if it is another folder at the end, because it was moved or removed.
    """
    with raising(LedgerError, f"{out} cannot be made", "; choose another --out"):
        Path(os.path.realpath(out)).mkdir(parents=True, exist_ok=True)
    begun = out.stat()
    taken = LedgerError(f"another process is writing to {out}; wait for it, or choose another --out")
    try:
        with locked(out / ".lock", taken):
            yield
    except sqlite3.Error as error:
        raise LedgerError(f"{out / LEDGER} cannot be written: {why(error)}; the same command resumes") from error
    if not out.is_dir() or not os.path.samestat(begun, out.stat()):
        raise LedgerError(
            f"{out} was moved or removed while it was written. If it was moved, it is whole at its new place: give "
            "that as --out to resume it"
        )


def is_run(path: Path) -> bool:
    """Return whether a folder holds a run."""
    return (path / RUN).is_file()


def holds(path: Path, bank: FrameBank) -> bool:
    """Return whether a folder holds only a bank that was made there for its run."""
    there = (path / BANK / OWN).is_file() and bank.root.resolve() == (path / BANK).resolve()
    return there and {one.name for one in path.iterdir()} <= {BANK, ".lock", f".{RUN}"}


def is_free(path: Path) -> bool:
    """Return whether a run may begin in a folder: it is empty but for remains of a cut start.

    A folder ``bank`` with pictures is a frame bank, which eyechart must not remove.
    """
    if not path.is_dir():
        return not path.exists()
    left = {item.name for item in path.iterdir()} - {".lock", f".{RUN}", f".{BANK}"}
    return not left or (left == {BANK} and all(item.name in BANK_TEXT for item in (path / BANK).iterdir()))


def is_episodes_run(path: Path) -> bool:
    """Return whether a folder holds a run of episodes; False means that one may begin there.

    Raises LedgerError if it holds something else.
    """
    if is_run(path):
        read_episodes_manifest(path)
        return True
    if path.exists():
        left = {item.name for item in path.iterdir()} - {".lock", f".{RUN}", *BESIDE} if path.is_dir() else {path.name}
        if left:
            raise LedgerError(f"{path} exists and is no run; choose another place with --out")
    return False


def asked_of(bank: FrameBank, prompt: Prompt, reader: int = READER) -> FrameBank:
    """Return a bank as a prompt uses it, with the prompt's fields and own actions.

    ``reader`` is the version of the reader of replies.
    """
    space = asked_space(bank.manifest, prompt, reader).among(frame.fields for frame in bank.frames)
    return replace(bank, said=prompt.fields, manifest=replace(bank.manifest, action_space=space))


def asked_space(bank: BankManifest, prompt: Prompt, reader: int = READER) -> Discrete:
    """Return the actions to read from replies: the prompt's own, or the bank's."""
    return named_actions(prompt.space, bank.action_space).by(reader)


def read_run(path: Path, *, reread: bool = False) -> tuple[RunManifest, FrameBank]:
    """Read a run's manifest and its bank's text; raises LedgerError or BankError naming the file.

    Replies are read by the run's own reader version, or by today's with ``reread``.
    """
    manifest = read_manifest(path)
    bank = asked_of(open_bank(path / BANK), manifest.prompt, READER if reread else manifest.reader)
    if bank.manifest.fingerprint != manifest.fingerprint:
        raise LedgerError(
            f"{path / BANK} is not the bank of this run: its fingerprint differs from that in {path / RUN}"
        )
    return manifest, bank


def read_manifest(path: Path) -> RunManifest:
    """Read the manifest of a run on a bank; raises LedgerError naming the file."""
    return _read(path, RunManifest)


def read_episodes_manifest(path: Path) -> EpisodesManifest:
    """Read the manifest of a run of episodes; raises LedgerError naming the file."""
    return _read(path, EpisodesManifest)


def _read(path: Path, kind: type[M]) -> M:
    file = path / RUN
    try:
        raw = parse_json(text_file(file).read_text(encoding="utf-8"))
        found = raw.pop("format")
        if found == kind.FORMAT:
            return _built(kind, raw, str(file))
    except FileNotFoundError as error:
        made = "'eyechart run battery' makes one of models, 'eyechart run policy' one of policies"
        made = made if kind is RunManifest else f"'eyechart run {kind.COMMAND}' makes one"
        raise LedgerError(f"{file} does not exist: is {path} a run? {made}") from error
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError, SpecError) as error:
        raise LedgerError(f"{file} is no run manifest: {error}") from error
    if kind is RunManifest and found == EpisodesManifest.FORMAT:
        raise LedgerError(
            f"{path} is a run of episodes: read it with 'eyechart score', 'report', 'audit', 'film' or 'costs'"
        )
    raise LedgerError(
        f"{file} is of format {found!r}, not {kind.FORMAT!r}: it is no run of '{kind.COMMAND}', or one of "
        "another eyechart; use the one that wrote it, or start a new run"
    )


def _built(kind: type[M], raw: dict[str, Any], file: str) -> M:
    for name in ("modes", "facts", "reader"):
        if name not in raw:
            raise ValueError(f"it has no {name}")
    for name, value in raw.items():
        if isinstance(value, str) and not value.isprintable():
            raise ValueError(f"{name} is {shown(value)}, not a line of text")
    raw["prompt"] = Prompt.from_dict(raw["prompt"])
    raw["modes"] = {spec: RequestMode.recorded(mode, file) for spec, mode in raw["modes"].items()}
    if kind is EpisodesManifest:
        raw["action_space"] = Discrete.from_dict(raw["action_space"]).by(raw["reader"])
    made = build(kind, raw)
    if isinstance(made, RunManifest):
        _require_legal(made)
    return made


def _require_legal(manifest: RunManifest) -> None:
    """Raise ValueError, or SpecError for a condition, if a run's manifest is impossible."""
    if len(manifest.conditions) > MOST_CONDITIONS:
        raise ValueError(
            f"it has {len(manifest.conditions)} conditions, more than the {MOST_CONDITIONS} that a run may have"
        )
    if not 1 <= manifest.answers <= MOST_ANSWERS:
        raise ValueError(f"answers is {manifest.answers}, not a number from 1 to {MOST_ANSWERS}")
    for condition in manifest.conditions:
        find_condition(condition, manifest.prompt.who)
    if manifest.controls not in CONTROLS_ASKED:
        raise ValueError(f"controls {manifest.controls!r} is not one of {', '.join(CONTROLS_ASKED)}")
    for name in manifest.series:
        require_known("corruption", name, CORRUPTIONS)
    if manifest.encoding not in ENCODINGS:
        raise ValueError(f"encoding {manifest.encoding!r} is not one of {', '.join(ENCODINGS)}")
    if manifest.shard is not None and not 1 <= manifest.shard[0] <= manifest.shard[1]:
        raise ValueError(f"shard {manifest.shard[0]}/{manifest.shard[1]} does not satisfy 1 <= i <= n")
