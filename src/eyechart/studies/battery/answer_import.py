"""A run of answers made elsewhere; eyechart made none of its calls, and every report says so."""

import hashlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import islice
from pathlib import Path

from eyechart.calls import CallKey, Reply, bounded
from eyechart.conditions import of_bank
from eyechart.errors import SourceError, SpecError, printable, raising
from eyechart.importing import LOGS, Faults, ImportedAnswer, open_log, read_answer_table
from eyechart.importing.answers import TOLD
from eyechart.importing.cells import is_nothing
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER, RunManifest, is_run, read_manifest, today
from eyechart.models import cleaned
from eyechart.models.faults import is_of_the_road
from eyechart.modes import ELSEWHERE, RequestMode
from eyechart.run import Progress
from eyechart.studies.battery.batch_output import is_batch, read_batch, served_by
from eyechart.studies.battery.plans import Battery, BatterySettings, planned, writing
from eyechart.studies.battery.questions import Keys, showable, unasked

IMPORTED = "imported"
"""The version of such a model, and the manifest's fact that lists the imported files."""
_AT_ONCE = 500
_MOST_SOURCES = 50
_MOST_NAME = 200

ReadAnswers = Callable[[Faults, Progress], Iterator[ImportedAnswer]]
"""Yields the answers of a source, anew at each call, and notes its faults."""


@dataclass(frozen=True)
class AnswerSource:
    """A source of answers: a name, the file's SHA-256, what wrote it in words, and its reader.

    ``answered_by`` is the model that it names, or else a name for it.
    """

    name: str
    sha256: str
    made_by: str
    read: ReadAnswers
    answered_by: str


@dataclass
class ImportedAnswers:
    """The counts of a source's rows, for a run.

    ``new`` answers are appended, ``again`` of them in place of a failure; ``there`` are in the run
    already. Of the new ones, ``errors`` are failures, and ``nothing`` are words such as None that
    programs write for a missing value. ``repeats`` are further answers to a call; the first counts.
    ``blank`` rows hold no answer. ``firstless`` calls have further answers but no first one.
    """

    new: int = 0
    again: int = 0
    there: int = 0
    errors: int = 0
    nothing: int = 0
    repeats: int = 0
    blank: int = 0
    firstless: int = 0

    @property
    def words(self) -> str:
        """Return the counts in words."""
        parts = (
            (self.new, "new answers"),
            (self.errors, "of them failures"),
            (self.nothing, "of them None, nan or null, taken as the model's words: leave a cell empty where none came"),
            (self.again, "in place of a failure"),
            (self.there, "there already"),
            (self.repeats, "repeats, of which the first counts"),
            (self.blank, "rows without an answer"),
            (self.firstless, "calls with further answers and no first (repeat 0), which stay without an answer"),
        )
        return ", ".join(f"{count} {name}" for count, name in parts if count or name == "new answers")


@dataclass(frozen=True)
class AnswerImport:
    """Answers that were read and checked against a run, but are not in it yet."""

    battery: Battery
    source: AnswerSource
    brought: ImportedAnswers
    requests: "_Requests"
    widened: tuple[str, ...] = ()
    """In words, what an existing run gets too: a model, conditions, frames, controls."""

    @cached_property
    def spec(self) -> str:
        """Return the SPEC of the answers."""
        (spec,) = self.battery.plan.models
        return spec


def read_import(
    bank: Path,
    source: AnswerSource,
    out: Path,
    name: str | None,
    asking: BatterySettings,
    *,
    progress: Progress = lambda *_: None,
) -> AnswerImport:
    """Read a source's answers for a battery on a bank, or for the rest of the run in ``out``.

    Their SPEC is ``elsewhere:NAME``. Without a name it is the model that the source names, which an
    existing run must hold already. Nothing is written.

    Raises SourceError with every faulty row. A fault is a key of another bank, prompt
    or seed, or a call or a repeat with two answers. A frame that is not in the bank is one, and an
    answer where the run holds another. Also raises what `plan` raises.
    """
    before = read_manifest(out) if is_run(out) else None
    spec = _spec(source, name, before, out)
    facts = _facts(out, spec, source)
    battery = planned(bank, {spec: RequestMode(spec)}, {spec: (IMPORTED, facts)}, out, asking)
    requests = _Requests(battery)
    check, faults = _AnswerCheck(battery, requests), Faults()
    for one in source.read(faults, progress):
        with faults.noted():
            check.take(one)
    faults.require_none(source.name)
    brought = check.counted()
    if not brought.new and not brought.there:
        raise SourceError(f"{source.name} holds no answer that counts: {_no_answer(brought)}")
    return AnswerImport(battery, source, brought, requests, _widened(before, battery.manifest, out))


def _spec(source: AnswerSource, name: str | None, before: RunManifest | None, out: Path) -> str:
    """Return the SPEC of the model; raises SpecError for no name, or an unchosen new one."""
    given = (source.answered_by if name is None else name).strip()
    if not given or not given.isprintable() or len(given) > _MOST_NAME:
        raise SpecError(f"--model names what answered, in a line of 1 to {_MOST_NAME} signs; got {given[:80]!r}")
    spec = f"{ELSEWHERE}:{given}"
    if name is None and before is not None and spec not in before.models:
        held = ", ".join(model.removeprefix(f"{ELSEWHERE}:") for model in before.models)
        raise SpecError(
            f"{out} holds answers of {held}, and {source.name} would be those of '{given[:80]}': say with --model "
            "whose they are; another name adds a model to the run"
        )
    return spec


def _no_answer(brought: ImportedAnswers) -> str:
    if not brought.repeats:
        return "no row has a 'text' (or answer, response, reply: the words as they came)"
    return f"all {brought.repeats} have a repeat of 1 or more, and the first answer to a call has repeat 0"


def _widened(before: RunManifest | None, now: RunManifest, out: Path) -> tuple[str, ...]:
    """Return in words what a run gets besides answers, because the user may not intend it."""
    if before is None:
        return ()
    models = [model for model in now.models if model not in before.models]
    conditions = [condition for condition in now.conditions if condition not in before.conditions]
    frames = before.limit is not None and before.limit != now.limit
    said = (
        (models, f"{', '.join(models)} is a model besides {', '.join(before.models)}, and needs all calls"),
        (conditions, f"it now has {', '.join(conditions)} too: choose with --conditions"),
        (frames, f"it now has {now.limit or 'all'} frames, and had {before.limit}: choose with --limit"),
        (before.controls != now.controls, f"its controls are now '{now.controls}', and were '{before.controls}'"),
    )
    return tuple(f"{out} grows: {words}" for grows, words in said if grows)


def bring(read: AnswerImport, *, progress: Progress = lambda *_: None) -> ImportedAnswers:
    """Append the answers to the run, and begin it if needed; repeat an interrupted import.

    Raises LedgerError where another process writes to the run, or the ledger cannot be written.
    """
    battery = read.battery
    with writing(battery.out, battery.manifest, battery.plan.bank) as (_, ledger):
        check, faults = _AnswerCheck(battery, read.requests), Faults()
        rows = (new for one in read.source.read(faults, progress) if (new := check.take(one)) is not None)
        while some := list(islice(rows, _AT_ONCE)):
            with ledger.together():
                for key, reply, again in some:
                    ledger.close(ledger.begin(key, read.requests.digest(key), again=again), reply)
        faults.require_none(read.source.name)
        return check.counted()


class _Requests:
    """The request digest of each call of a battery, computed once."""

    def __init__(self, battery: Battery) -> None:
        self._plan, self._stimuli = battery.plan, battery.plan.stimuli()
        self._known: dict[CallKey, str] = {}

    def digest(self, key: CallKey) -> str:
        """Return the digest of a call's words and pictures."""
        if key not in self._known:
            self._known[key] = self._plan.query(key, self._stimuli.show(key.condition, key.frame)).sha256()
        return self._known[key]


@dataclass
class _AnswerCheck:
    """Checks answers, one by one, against the calls of a run and its ledger."""

    battery: Battery
    requests: _Requests
    brought: ImportedAnswers = field(default_factory=ImportedAnswers)
    seen: set[tuple[CallKey, int]] = field(default_factory=set)

    def counted(self) -> ImportedAnswers:
        """Return the counts after the last row, with the calls that have no first answer."""
        calls = {key for key, repeat in self.seen if repeat and (key, 0) not in self.seen}
        self.brought.firstless = len(calls - self._held.keys())
        return self.brought

    @cached_property
    def _keys(self) -> Keys:
        return Keys.of(self.battery.manifest, self.battery.plan)

    @cached_property
    def _calls(self) -> Mapping[str, CallKey]:
        return dict(showable(self.battery))

    @cached_property
    def _held(self) -> Mapping[CallKey, tuple[str, bool]]:
        """Return each finished call's reply digest, and whether the call may be made again."""
        (spec,) = self.battery.plan.models
        with Ledger(self.battery.out / LEDGER, absent=True) as ledger:
            finished = ledger.finished()
            return {
                key: (_digest(reply), is_of_the_road(reply)) for key, reply in ledger.replies(spec) if key in finished
            }

    def take(self, one: ImportedAnswer) -> tuple[CallKey, Reply, bool] | None:
        """Return a row's call, its reply, and whether it replaces a failure; None if not new.

        Raises SourceError, beginning with the row, for a row that answers no call of the run.
        """
        key = self._call(one)
        if (key, one.repeat) in self.seen:
            times = f" as repeat {one.repeat}" if one.repeat else ""
            raise SourceError(f"{one.where}: frame '{key.frame}' under {key.condition} is answered twice{times}")
        self.seen.add((key, one.repeat))
        if one.reply is None:
            self.brought.blank += 1
        elif one.repeat:
            self.brought.repeats += 1
        else:
            return self._new(one, key, cleaned(bounded(one.reply)))  # as `eyechart.models.ask` keeps them
        return None

    def _call(self, one: ImportedAnswer) -> CallKey:
        key = self._calls.get(one.call)
        if key is None:
            raise SourceError(f"{one.where}: {self._why_unknown(one)}")
        for name, value in (("frame", one.frame), ("condition", one.condition)):
            if value is not None and getattr(key, name) not in {value, value.removeprefix("'")}:
                raise SourceError(f"{one.where} has {name} '{value}', and its call is about {getattr(key, name)!r}")
        if one.request_sha256 is not None and one.request_sha256 != self.requests.digest(key):
            raise SourceError(
                f"{one.where} was asked with another picture or other words than this machine makes for it. Export the "
                "calls anew here, or leave out the column request_sha256 if another version of Pillow made the export"
            )
        return key

    def _why_unknown(self, one: ImportedAnswer) -> str:
        bank = self.battery.plan.bank
        known = one.frame is None or any(frame.id == one.frame for frame in bank.frames)
        if not known:
            return f"frame '{one.frame}' is not of the bank {bank.name}"
        if not self._keys.holds(one.call):
            return (
                f"call '{one.call[:40]}' is of another export: give the bank, --prompt and --seed that it was made with"
            )
        if one.frame is None or one.condition is None:
            found = self._keys.find(one.call, of_bank(bank), (frame.id for frame in bank.frames))
            options = "--conditions, --controls and --limit"
            return (
                f"call '{one.call[:40]}' is none of this run: give the {options} of the export"
                if found is None
                else unasked(self.battery, *found)
            )
        if self._keys.call(one.condition, one.frame) in self._calls:
            return f"call '{one.call[:40]}' is not that of frame '{one.frame}' under {one.condition}: keep that column"
        return unasked(self.battery, one.condition, one.frame)

    def _new(self, one: ImportedAnswer, key: CallKey, reply: Reply) -> tuple[CallKey, Reply, bool] | None:
        held, again = self._held.get(key, ("", False))
        if held == _digest(reply):
            self.brought.there += 1
            return None
        if held and not again:
            raise SourceError(
                f"{one.where}: frame '{key.frame}' under {key.condition} has another answer in {self.battery.out} "
                "already; give another --out for other answers"
            )
        self.brought.new += 1
        self.brought.again += bool(held)
        self.brought.errors += reply.error is not None
        named = {name.upper() for name in self.battery.plan.space.actions}
        empty = bool(reply.text.strip()) and is_nothing(reply.text, "none")
        self.brought.nothing += empty and reply.text.strip().upper() not in named
        return key, reply, bool(held)


def _digest(reply: Reply) -> str:
    """Return the digest of all that a row says about a reply."""
    parts = (reply.text, reply.error, reply.error_detail, *(getattr(reply, name) for name in TOLD))
    return hashlib.sha256(repr(parts).encode("utf-8", "replace")).hexdigest()


def _facts(out: Path, spec: str, source: AnswerSource) -> dict[str, str]:
    """Return the manifest's facts on imported answers: their files, each once."""
    before = read_manifest(out).facts.get(spec, {}).get(IMPORTED, "") if is_run(out) else ""
    said = f"{source.name} (SHA-256 {source.sha256[:16]}, {source.made_by})"
    known = [one for one in before.split("; ") if one]
    here = [] if any(one.partition(" on ")[0] == said for one in known) else [f"{said} on {today()}"]
    return {"calls": "not made by eyechart", IMPORTED: "; ".join([*known, *here][-_MOST_SOURCES:])}


def source_of(path: Path) -> AnswerSource:
    """Return a table, the output of an OpenAI batch, or an Inspect AI log (.eval, .json).

    Raises SourceError where it cannot be read.
    """
    with raising(SourceError, f"{path} cannot be read"), path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    if path.suffix in LOGS:
        log = open_log(path)
        return AnswerSource(printable(path.name), digest, f"a log of Inspect AI {log.version}", log.answers, log.model)
    if is_batch(path):
        read = partial(read_batch, path)
        return AnswerSource(printable(path.name), digest, "the output of an OpenAI batch", read, served_by(path))
    read = partial(read_answer_table, path)
    return AnswerSource(printable(path.name), digest, "a table", read, printable(path.stem))
