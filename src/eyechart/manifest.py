"""A run's manifest says what was asked of whom, so that it can be resumed, merged and read: on a bank, or of drives."""

import datetime as dt
import json
import os
import platform
import shutil
import sqlite3
from collections.abc import Container, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, ClassVar, Self, TypeVar

from eyechart import __version__
from eyechart.conditions import find_condition
from eyechart.errors import LedgerError, SpecError, raising, text_file, why
from eyechart.frames import BankManifest, FrameBank, locked, open_bank, read_bank_manifest
from eyechart.limits import NOTHING, Limits, Spent, added
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
"""A run's finished episodes, one a line, in the order in which they ended."""
BANK = "bank"
"""The run's copy of the bank's text; in a bundle with the pictures that the run used."""
BANK_TEXT = ("manifest.json", "metadata.jsonl")
OWN = ".own"
"""Stands in that folder where the whole bank was made there, for this run alone."""
BESIDE = ("vetting.json", "seen.json")
"""What may stand in a folder before its episodes begin: which worlds the structured study's online run chose."""


STORED, PNG, PNG_2 = ENCODINGS = ("stored", "png", "png-2")
"""How pictures leave: as the bank holds them, or all as 8-bit PNGs of pixels alone, which look alike as files.

In the second of these encodings noise is not compressed: that took half of a call's time, and made no file smaller.
"""

MOST_CONDITIONS, MOST_ANSWERS = 1_000, 10_000
"""How many conditions a run may have, and how often a policy that draws its answers may be asked for each."""
CONTROLS_ASKED = ("none", "auto", "all")
"""Which control conditions a run may ask, from the fewest."""


MOVED = "moved"
"""The fact of a model that says when its run went on at another address."""


class Manifest:
    """What the manifests of all runs say alike, and how one is extended by another of the same run.

    ``modes`` says how each model was asked, ``facts`` what is known of it (digest, quantisation, template). ``reader``
    is the version of what reads the replies. ``view`` is the key of the view that pictures are shown through, ``none``
    where they are shown as they are. ``probes`` says what it took to probe a model before the run.
    """

    __slots__ = ()
    FORMAT: ClassVar[str]
    COMMAND: ClassVar[str]
    """The command that makes such a run."""
    WHO: ClassVar[str]
    """The field that maps who was asked, or drove, to a version."""
    ASKED: ClassVar[str]
    """What was done with one of them, in words."""
    SAME: ClassVar[tuple[str, ...]]
    GROWS: ClassVar[tuple[str, ...]]

    prompt: Prompt
    modes: Mapping[str, RequestMode]
    facts: Mapping[str, Mapping[str, str]]
    probes: Mapping[str, Spent]

    def mode(self, spec: str) -> RequestMode:
        """Return how a model was asked; the default mode where the run gave none."""
        return self.modes.get(spec) or RequestMode(spec)

    def spent_before(self) -> Spent:
        """Return what probing took, of all models together."""
        return Spent.together(self.probes.values())

    def within(
        self, prices: Prices, *, calls: int | None = None, cost_usd: float | None = None, before: Spent = NOTHING
    ) -> Limits:
        """Return a run's limits: so many requests, so many dollars by these prices, with what was spent ``before``.

        What probing for the run took counts too.
        """
        spent = Spent.together([self.spent_before(), before])
        return Limits(calls, cost_usd, before=spent, cost=lambda spec, reply: prices.cost(self.mode(spec), reply)[0])

    def counting(self, probes: Mapping[str, Spent]) -> Self:
        """Return this manifest with what was spent on probing models, beside what was spent on them before."""
        return replace(self, probes={**self.probes, **added(self.probes, probes)})  # type: ignore[type-var]

    def extended(self, other: Self) -> Self:
        """Return this manifest with what another asks for added.

        Raises LedgerError that names what differs where the two cannot be one run.
        """
        for name in self.SAME:
            mine, theirs = getattr(self, name), getattr(other, name)
            if mine != theirs:
                before, now = self._said_of(name, other), other._said_of(name, self)
                raise LedgerError(
                    f"this run has {before}, now {now} was asked for; "
                    "give the same options to resume it, or another --out for another run"
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
        told = {spec: more for spec, more in other.facts.items() if spec not in older}
        facts = {spec: {**_moves(self.facts.get(spec, {})), **more} for spec, more in told.items()}
        who = {spec: version for spec, version in now.items() if spec not in older}
        for name, more in ((self.WHO, who), ("modes", modes), ("facts", facts), ("probes", other.probes)):
            grown[name] = {**getattr(self, name), **more}
        return replace(self, **grown)  # type: ignore[type-var]

    def _require_version(self, spec: str, other: Self) -> None:
        """Raise LedgerError where another manifest has another version of one who is in both, naming what changed."""
        before, now = getattr(self, self.WHO)[spec], getattr(other, self.WHO)[spec]
        if before != now and not other._is_newer(spec, self):
            which = changed(self.facts.get(spec, {}), other.facts.get(spec, {}))
            raise LedgerError(
                f"this run {self.ASKED.format(spec)} at version {before}, which is now {now}{which and f' ({which})'}; "
                "give another --out, or bring back the files or the program that answered before: two versions in "
                "one run cannot be told apart"
            )

    def _require_mode(self, spec: str, other: Self) -> None:
        """Raise LedgerError where a model would be asked otherwise than it was."""
        mine, theirs = self.mode(spec), other.mode(spec)
        if mine.same_request(theirs):
            return
        if mine.differs_in_address_only(theirs):
            raise LedgerError(
                f"this run asked {spec} at {mine.base_url or 'the usual address'}, and now its address, key, "
                f"headers or patience are others ({theirs.base_url or 'the usual address'}): give the same, "
                "or --moved to go on there and record it"
            )
        mine, theirs = mine.request(), theirs.request()
        name = next(one.name for one in fields(mine) if getattr(mine, one.name) != getattr(theirs, one.name))
        difference = f"{name} was {getattr(mine, name)!r}, now {getattr(theirs, name)!r}"
        raise LedgerError(
            f"this run asked {spec} in another mode: {difference}; "
            "give the same options or --mode file to resume it, or another --out"
        )

    def _is_newer(self, spec: str, other: Self) -> bool:
        """Return whether the other manifest has of a callable the version that it had before its imports counted."""
        version = getattr(other, self.WHO)[spec]
        return is_formerly(version, other.facts.get(spec, {}), self.facts.get(spec, {}))

    def moved(self, modes: Iterable[RequestMode]) -> Self:
        """Return this manifest with its models asked at the addresses of these modes; ``facts`` say what moved when."""
        kept, facts, when = dict(self.modes), dict(self.facts), dt.datetime.now(dt.UTC).isoformat(timespec="seconds")
        for mode in modes:
            before = kept.get(mode.spec)
            if before is not None and not before.same_request(after := before.moved_to(mode)):
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
        """Write the manifest into the run's folder, whole or not at all."""
        partial = out / f".{RUN}"
        with partial.open("w", encoding="utf-8") as file:
            file.write(self.as_text())
            file.flush()
            os.fsync(file.fileno())
        partial.replace(out / RUN)

    def _said_of(self, name: str, other: Self) -> str:
        """Return in words what a manifest says of what another says otherwise."""
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
        """Return the bounds of both together; raises LedgerError where they cannot be."""
        raise NotImplementedError


Who = tuple[str, Mapping[str, str]]
"""The version of one who is asked, and what is known of it."""


@dataclass(frozen=True, slots=True)
class RunManifest(Manifest):
    """What a run on a bank was planned to do. ``models`` maps a SPEC to the version that answered.

    ``shard`` is (i, n), counted from 1, or None for the whole; ``limit`` the number of frames, or None for all.
    ``stop_early`` says that a model is no longer asked once its verdict is settled. ``reader`` is the version that the
    run was begun under. ``frames`` are the ids of the frames that were chosen for the run, empty where it is about all
    of them or their first ``limit``. ``controls`` says which control conditions are asked beside ``conditions``: none;
    ``auto``, of each model those that its answers call for, in later stages; or all, among ``conditions``. By
    ``controls_seed`` the bank's controls were drawn, None where nobody drew them by one. ``answers`` is how often a
    policy that draws its answers is asked for each. ``encoding`` is how pictures leave.
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
    GROWS = ("conditions",)

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
    probes: Mapping[str, Spent] = field(default_factory=dict)
    controls: str = "none"
    controls_seed: int | None = None
    answers: int = 1
    encoding: str = STORED

    def require_reader(self, path: Path, known: tuple[int, ...], *, reread: bool) -> None:
        """Raise LedgerError where a run was begun under a version of its reader that is not ``known``, today's last.

        One that is ``reread`` may be of any.
        """
        if self.reader not in known and not reread:
            raise LedgerError(
                f"{path} was begun under version {self.reader} of the reader of its replies, and this is version "
                f"{known[-1]}: what is read may differ from what was seen before; read its replies anew with --reread"
            )

    @classmethod
    def begun(
        cls,
        bank: FrameBank,
        modes: Mapping[str, RequestMode],
        who: Mapping[str, Who],
        **asked: Any,  # noqa: ANN401
    ) -> "RunManifest":
        """Return the manifest of a run on a bank that begins today; ``asked`` are its other fields."""
        return cls(
            created=today(),
            models={spec: version for spec, (version, _) in who.items()},
            bank_path=str(bank.root.resolve()),
            fingerprint=bank.manifest.fingerprint,
            versions=versions(),
            modes=modes,
            facts={spec: dict(facts) for spec, (_, facts) in who.items() if facts},
            encoding=PNG_2,
            **asked,
        )

    def _wider(self, other: "RunManifest") -> dict[str, Any]:
        if CONTROLS_ASKED.index(other.controls) < CONTROLS_ASKED.index(self.controls):
            raise LedgerError(
                f"this run was begun with --controls {self.controls}, now {other.controls} was asked for; "
                "give as many to resume it, or another --out for another run"
            )
        limit = None if None in {self.limit, other.limit} else max(self.limit or 0, other.limit or 0)
        return {"limit": limit, "controls": other.controls}


MARGINAL = "marginal"
"""How the SPEC of a policy begins that draws like a controller's decisions."""


def own_marginal(spec: str, drivers: Container[str]) -> str:
    """Return the one of some drivers that ``marginal:DRIVER`` names; "" for an earlier run's, and any other policy."""
    kind, _, name = spec.partition(":")
    return name if kind == MARGINAL and name.partition(":")[0] != MARGINAL and name in drivers else ""


@dataclass(frozen=True, slots=True)
class EpisodesManifest(Manifest):
    """What a run of episodes was planned to do: every policy in every scenario, seed and condition.

    ``policies`` maps a SPEC to the version of what drives: a model's own, the counts of a marginal, or nothing; the
    marginal of a driver of this run has no counts until it drives.
    ``picture`` is the kind of picture in words. ``world`` holds the versions of the libraries that make the world,
    ``versions`` all that may matter. ``max_steps`` is the largest bound on decisions that was asked for; each episode
    says under which it was driven. ``silence`` says what becomes of a call that fails in a way that may pass: the
    episode stays ``unfinished``, or the ``fail-safe`` is executed. ``reflected`` says whether models were asked
    about the reflection of each picture too.
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
    probes: Mapping[str, Spent] = field(default_factory=dict)
    silence: str = "unfinished"
    reflected: bool = False

    @property
    def models(self) -> tuple[str, ...]:
        """Return the policies that are models."""
        return tuple(self.modes)

    def marginal_of(self, spec: str) -> str:
        """Return the driver of this run like whose decisions a policy draws; "" where it is no such marginal."""
        return own_marginal(spec, self.policies)

    def _wider(self, other: "EpisodesManifest") -> dict[str, Any]:
        if other.max_steps < self.max_steps:
            raise LedgerError(
                f"this run has --max-steps {self.max_steps}, now {other.max_steps} was asked for: what it drove "
                "already may have gone on for longer; give at least as many, or another --out"
            )
        return {"max_steps": other.max_steps}


def _moves(facts: Mapping[str, str]) -> dict[str, str]:
    return {MOVED: facts[MOVED]} if MOVED in facts else {}


M = TypeVar("M", RunManifest, EpisodesManifest)


def versions() -> dict[str, str]:
    """Return the versions that may matter to a picture or a number."""
    from importlib.metadata import PackageNotFoundError, version  # noqa: PLC0415 - slow to import

    found = {"eyechart": __version__, "python": platform.python_version()}
    for package in ("numpy", "scipy", "pillow", "highway-env", "gymnasium", "pygame-ce"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def today() -> str:
    """Return the date in UTC, as a run records it."""
    return dt.datetime.now(dt.UTC).date().isoformat()


def write_run(out: Path, manifest: RunManifest, bank: FrameBank) -> None:
    """Write a run's manifest and the text of its bank (no pictures) into the run's folder.

    Raises LedgerError where ``out`` is taken by something that is no run.
    """
    copy = out / BANK
    if not is_run(out) and not holds(out, bank):
        if not is_free(out):
            raise LedgerError(f"{out} exists and is no run; choose another place with --out")
        shutil.rmtree(copy, ignore_errors=True)  # of a run that was cut before it had a manifest
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
    """Take over what came to a run's bank since it was copied: pictures that its manifest names now."""
    then, now = (folder / "manifest.json" for folder in (copy, bank.root))
    before = read_bank_manifest(copy)
    more = bank.manifest.images.keys() - before.images.keys()
    if more and before.fingerprint == bank.manifest.fingerprint and now.is_file():
        partial = copy / ".manifest.json"
        shutil.copyfile(now, partial)
        partial.replace(then)


@contextmanager
def alone_in(out: Path) -> Iterator[None]:
    """Hold a run's folder, which is made where it is missing.

    Of a link, what it leads to is made. Raises LedgerError where another process holds it, where it cannot be made, or
    its ledger cannot be written.
    """
    with raising(LedgerError, f"{out} cannot be made", "; choose another --out"):
        Path(os.path.realpath(out)).mkdir(parents=True, exist_ok=True)
    taken = LedgerError(f"another process is writing to {out}; wait for it, or choose another --out")
    try:
        with locked(out / ".lock", taken):
            yield
    except sqlite3.Error as error:
        raise LedgerError(f"{out / LEDGER} cannot be written: {why(error)}; the same command resumes") from error


def is_run(path: Path) -> bool:
    """Return whether a folder holds a run."""
    return (path / RUN).is_file()


def holds(path: Path, bank: FrameBank) -> bool:
    """Return whether a folder holds nothing but a bank that was made there for the run on it, with its own controls."""
    there = (path / BANK / OWN).is_file() and bank.root.resolve() == (path / BANK).resolve()
    return there and {one.name for one in path.iterdir()} <= {BANK, ".lock", f".{RUN}"}


def is_free(path: Path) -> bool:
    """Return whether a run may begin in a folder: nothing is there but what a run leaves that was cut at its start.

    A folder ``bank`` that holds pictures is a frame bank, and not ours to remove.
    """
    if not path.is_dir():
        return not path.exists()
    left = {item.name for item in path.iterdir()} - {".lock", f".{RUN}", f".{BANK}"}
    return not left or (left == {BANK} and all(item.name in BANK_TEXT for item in (path / BANK).iterdir()))


def is_episodes_run(path: Path) -> bool:
    """Return whether a folder holds a run of episodes; raises LedgerError where it holds something else.

    False means that one may begin there.
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
    """Return a bank as a prompt asks of it: with what that says of a frame, and the actions it has of its own.

    ``reader`` is the version of the rules by which an action is read from a reply.
    """
    space = asked_space(bank.manifest, prompt, reader)
    return replace(bank, said=prompt.fields, manifest=replace(bank.manifest, action_space=space))


def asked_space(bank: BankManifest, prompt: Prompt, reader: int = READER) -> Discrete:
    """Return the actions that are read from replies: the prompt's own, or the bank's."""
    return named_actions(prompt.space, bank.action_space).by(reader)


def read_run(path: Path, *, reread: bool = False) -> tuple[RunManifest, FrameBank]:
    """Read a run's manifest and the text of its bank; raises LedgerError or BankError naming the file at fault.

    Its replies are read by the version of the reader that it was begun under, or by today's where ``reread``.
    """
    manifest = read_manifest(path)
    bank = asked_of(open_bank(path / BANK), manifest.prompt, READER if reread else manifest.reader)
    if bank.manifest.fingerprint != manifest.fingerprint:
        raise LedgerError(
            f"{path / BANK} is not the bank of this run: its fingerprint differs from that in {path / RUN}"
        )
    return manifest, bank


def read_manifest(path: Path) -> RunManifest:
    """Read the manifest of a run on a bank; raises LedgerError naming the file at fault."""
    return _read(path, RunManifest)


def read_episodes_manifest(path: Path) -> EpisodesManifest:
    """Read the manifest of a run of episodes; raises LedgerError naming the file at fault."""
    return _read(path, EpisodesManifest)


def _read(path: Path, kind: type[M]) -> M:
    file = path / RUN
    try:
        raw = parse_json(text_file(file).read_text(encoding="utf-8"))
        found = raw.pop("format")
        if found == kind.FORMAT:
            return _built(kind, raw, str(file))
    except FileNotFoundError as error:
        made = "one is made by 'eyechart run battery' of models, 'eyechart run policy' of policies"
        made = made if kind is RunManifest else f"'eyechart run {kind.COMMAND}' makes one"
        raise LedgerError(f"{file} does not exist: is {path} a run? {made}") from error
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError, SpecError) as error:
        raise LedgerError(f"{file} is no run manifest: {error}") from error
    if kind is RunManifest and found == EpisodesManifest.FORMAT:
        raise LedgerError(
            f"{path} is a run of episodes, for 'eyechart score', 'report', 'audit', 'film' and 'costs' to read"
        )
    raise LedgerError(
        f"{file} is of format {found!r}, not {kind.FORMAT!r}: it is no run of '{kind.COMMAND}', or one of another "
        "eyechart; use the one that wrote it, or run anew"
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


def _require_legal(made: RunManifest) -> None:
    """Raise ValueError, or SpecError of a condition, where a run's manifest holds what no run can be asked."""
    if len(made.conditions) > MOST_CONDITIONS:
        raise ValueError(f"conditions are {len(made.conditions)}, more than the {MOST_CONDITIONS} that a run may have")
    if not 1 <= made.answers <= MOST_ANSWERS:
        raise ValueError(f"answers is {made.answers}, not a number from 1 to {MOST_ANSWERS}")
    for condition in made.conditions:
        find_condition(condition, made.prompt.who)
    if made.controls not in CONTROLS_ASKED:
        raise ValueError(f"controls {made.controls!r} is none of {', '.join(CONTROLS_ASKED)}")
    if made.encoding not in ENCODINGS:
        raise ValueError(f"encoding {made.encoding!r} is none of {', '.join(ENCODINGS)}")
    if made.shard is not None and not 1 <= made.shard[0] <= made.shard[1]:
        raise ValueError(f"shard {made.shard[0]}/{made.shard[1]} does not satisfy 1 <= i <= n")
