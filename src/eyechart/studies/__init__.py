"""The kinds of run ("studies"), a module or package each: how each is scored and reported."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Protocol, TypeVar

from eyechart.calls import DecisionReader, read_in
from eyechart.costs import ALL, Account, UnreadReply, unread
from eyechart.errors import LedgerError, SpecError, text_file, why
from eyechart.frames import FrameBank
from eyechart.ledger import Ledger
from eyechart.limits import Usage, added
from eyechart.manifest import BESIDE, LEDGER, RUN, EpisodesManifest, RunManifest
from eyechart.models.prices import Prices, read_prices
from eyechart.records import JsonRecord, parse_json, to_json_fields
from eyechart.spaces.space import AnySpace
from eyechart.stats.statistic import Statistic, UpperBound

if TYPE_CHECKING:  # a score needs no terminal and no figures; a list of costs needs no verdicts
    from typing import Unpack

    from rich.text import Text

    from eyechart.gate import Gate, Terms
    from eyechart.integrity import Guard
    from eyechart.modes import RequestMode
    from eyechart.planned_run import PlannedRun
    from eyechart.report.charts import Drawing
    from eyechart.report.page import Page, PageSummary
    from eyechart.report.table import Table
    from eyechart.verdicts import Label, Ruling, Verdict

Tell = Callable[[str], None]
"""Receives a line of progress for the user who waits."""


class CheckpointSeries(JsonRecord, Protocol):
    """The models of several runs in training order, and what changed from each to the next."""

    @property
    def is_replicated(self) -> bool:
        """Return whether nothing changed."""

    def printed(self) -> "Iterator[Table | str]":
        """Yield tables and sentences."""


S = TypeVar("S", bound=JsonRecord)
"""The results that a study computes from a run."""

HELD = {True: "holds", False: "FAILS", None: "cannot say"}
"""The first word of a check or a guard, as it is printed."""
NO_DRIVES = dict.fromkeys(
    ("score --against", "report --against"), "is no run of drives, and --against names a policy of one"
)


def read_steps(given: Sequence[str] | None, studies: "Sequence[Study[Any]]") -> dict[str, int]:
    """Return the step of each SPEC; raises SpecError for another form or kind of run."""
    steps = {}
    for one in given or []:
        spec, sign, step = one.rpartition("=")
        if not (sign and spec and step.isdecimal()):
            raise SpecError(f"--step is SPEC=N with a whole number, as python:my:act=20000, not '{one}'")
        steps[spec] = int(step)
    if steps and (others := [study.runs_are for study in studies if study.runs_are != "policies"]):
        raise SpecError(f"--step is for checkpoints of policies, and this is a run of {others[0] or 'another kind'}")
    return steps


@dataclass(frozen=True)
class ReadOptions:
    """How runs are read: what is declared of frames and replies, and the policy to compare with.

    Without ``driven``, the page of a run of episodes opens no world and shows no picture. ``steps``
    gives the training steps of each policy, by SPEC. A battery is scored on ``frames`` of its bank;
    empty means every frame of the run.
    """

    independent: bool = False
    reread: bool = False
    against: str | None = None
    resamples: int = 5000
    driven: bool = True
    steps: Mapping[str, int] = field(default_factory=dict)
    frames: Sequence[str] = ()
    fresh: bool = False
    """Whether a run is read anew, whatever was kept of an earlier reading."""
    prices: Prices | None = None
    """The token prices of the user's own file; None for the built-in table alone."""


@dataclass
class RunCosts:
    """The calls' cost by model and condition, the guards, and the cost of probes before the run."""

    accounts: dict[str, dict[str, Account]] = field(default_factory=dict)
    guards: "dict[str, tuple[Guard, ...]]" = field(default_factory=dict)
    probes: dict[str, Usage] = field(default_factory=dict)

    def add(self, part: str, other: "RunCosts") -> None:
        """Add the costs of one part of a study; a run that stands alone has the name ``""``."""
        where = f" in {part}" if part else ""
        self.accounts |= {f"{spec}{where}": found for spec, found in other.accounts.items()}
        self.guards |= {f"{spec}{where}": found for spec, found in other.guards.items()}
        self.probes |= added(self.probes, other.probes)

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        return to_json_fields(self, "guards probes", accounting=self.accounts)


@dataclass(frozen=True)
class BundledRun:
    """A bundled run: name, manifest, bank, ledger, and the bank with its pictures."""

    name: str
    manifest: RunManifest
    bank: FrameBank
    ledger: Path
    pictures: FrameBank


@dataclass(frozen=True)
class StudyReport:
    """A report: its page, its tables, and lines to print."""

    page: "Page"
    tables: "Sequence[Table]"
    lines: Sequence[str]


@dataclass(frozen=True)
class ModelSummary:
    """The answer of a run for one model, in a word, with the estimate that decided it.

    ``state`` says what keeps the answer open. ``tone`` is that of a ``Mark`` of a table; ``answer``
    is the reply where the tone does not give it. ``marks`` are the guards that failed, in words.
    """

    label: str
    tone: str
    decided_by: str = ""
    estimate: "Statistic | None" = None
    state: str = ""
    marks: Sequence[str] = ()
    answer: str = ""

    @classmethod
    def of(cls, ruling: "Ruling", label: "Label", state: str = "", marks: Sequence[str] = ()) -> "ModelSummary":
        """Return the finding that an index shows for a ruling and its label."""
        return cls(ruling.label, label.family, ruling.decided_by, ruling.statistic, state, marks)

    def as_plain(self) -> dict[str, object]:
        """Return plain values from which `of_plain` makes it again; of the estimate, what is shown."""
        one, words = self.estimate, ("label", "tone", "decided_by", "state", "answer")
        shown = None if one is None else [isinstance(one, UpperBound), one.value, one.n, one.ci, one.p, one.level]
        return {**{name: getattr(self, name) for name in words}, "marks": [*self.marks], "estimate": shown}

    @classmethod
    def of_plain(cls, said: Mapping[str, Any]) -> "ModelSummary":
        """Return the finding that `as_plain` wrote."""
        bounded, value, n, ci, p, level = said["estimate"] or (False, None, 0, None, None, 0.95)
        kind = UpperBound if bounded else Statistic
        one = kind(value, n, None if ci is None else (ci[0], ci[1]), p, level=level)
        return cls(**{**said, "estimate": one if said["estimate"] else None})


NO_VERDICT = ModelSummary("no verdict", "")


class Study(ABC, Generic[S]):
    """A kind of run; a report calls its runs ``runs_are``, and they answer a ``question``.

    ``refuses`` maps each command that the study does not have to the reason, which follows a run's
    name in an error. ``requirements`` maps what a gate may require to its meaning; ``required`` is
    the default.
    """

    runs_are: ClassVar[str] = ""
    question: ClassVar[str] = ""
    refuses: ClassVar[Mapping[str, str]] = {}
    requirements: ClassVar[Mapping[str, str]] = {}
    required: ClassVar[str] = ""
    callables: ClassVar[bool] = False
    """Whether the subject is a callable, which counts no tokens and reports no cost."""
    counted: ClassVar[tuple[str, str]] = ("look", "model")
    """The verb and the noun of its findings; an index counts findings with one pair together."""

    @abstractmethod
    def holds(self, folder: Path) -> bool:
        """Return whether a folder is a run of this study; never raises."""

    @abstractmethod
    def score(self, folder: Path, reading: ReadOptions) -> S:
        """Score a run, finished or not.

        Raises LedgerError, BankError or SpecError where it cannot be scored.
        """

    def plan(
        self, bank: Path, modes: "Sequence[RequestMode]", out: Path, *, seed: int, limit: int | None
    ) -> "PlannedRun":
        """Plan a run of models on a bank, for a study that has no command of its own."""
        raise NotImplementedError

    @abstractmethod
    def printed(self, score: S) -> "Iterator[Table | str]":
        """Yield the tables and lines that ``eyechart score --all`` prints."""

    def brief(self, score: S) -> "Iterator[Table | str]":
        """Yield the output of ``eyechart score``, deciding numbers first; by default all of it."""
        return self.printed(score)

    @abstractmethod
    def took_run(self, run: Path, prices: Prices, *, fresh: bool = False) -> RunCosts:
        """Return the costs of one run's calls, at these prices; ``fresh`` reads its ledger anew."""

    def scored(self, runs: Sequence[Path], reading: ReadOptions, tell: Tell) -> Iterator[tuple[str, S]]:
        """Yield the score of each of several folders with its name."""
        for run, name in zip(runs, names_of(runs), strict=True):
            tell(f"scoring {name}")
            yield name, self.score(run, reading)

    def runs(self, folder: Path) -> Mapping[str, Path]:
        """Return the runs in a folder of this study, by name; a single run has the name ``""``."""
        return {"": folder}

    def began(self, folder: Path) -> str:
        """Return when the first call was sent, by the ledgers; else the day in ``run.json``.

        A day alone sorts before all times of that day.
        """
        sent, said = [], []
        for run in self.runs(folder).values():
            said.append(str(run_json(run).get("created") or ""))
            if (run / LEDGER).is_file():
                with Ledger(run / LEDGER) as ledger:
                    sent.append(ledger.began())
        return min(filter(None, sent or said), default=min(filter(None, said), default=""))

    def took(self, folder: Path, prices: Prices, *, fresh: bool = False) -> RunCosts:
        """Return the costs of all runs of a folder; ``fresh`` reads their ledgers anew."""
        costs = RunCosts()
        for name, run in self.runs(folder).items():
            costs.add(name, self.took_run(run, prices, fresh=fresh))
        return costs

    def costs_printed(self, run: Path, prices: Prices, *, every: bool, fresh: bool) -> "Iterator[Table | str]":
        """Yield what a run's calls took, what decisions cost, and the guards."""
        from eyechart.report.accounts import costs_table  # noqa: PLC0415 - a score needs no tables

        took = self.took(run, prices, fresh=fresh)
        each = self.deployment([run], ReadOptions(prices=prices), {run: took})
        tables = [costs_table(took.accounts, every=every), *([] if each is None else [each])]
        yield from (table.known() if self.callables else table for table in tables)
        if not took.accounts:
            yield "no model was asked: policies and worlds take no calls"
        yield from (f"the probe of {spec} before the run also took: {one.words}" for spec, one in took.probes.items())
        for spec, found in took.guards.items():
            yield from (f"{HELD[one.holds]:<10}  {spec}  guard '{one.name}': {one.because}" for one in found)

    def deployment(
        self, runs: Sequence[Path], reading: ReadOptions, took: Mapping[Path, RunCosts] | None = None
    ) -> "Table | None":
        """Return cost and time per decision, in the paper's units; None where no model was called.

        A model of several runs is named with its run. ``took`` are costs that are known already.
        """
        from eyechart.report.accounts import deployment_table  # noqa: PLC0415 - a score needs no tables
        from eyechart.report.table import stack_tables  # noqa: PLC0415 - as above

        prices, tables = reading.prices or read_prices(), {}
        for run, name in zip(runs, names_of(runs), strict=True):
            accounts = ((took or {}).get(run) or self.took(run, prices)).accounts
            tables[name] = deployment_table({spec: found[ALL] for spec, found in accounts.items()})
        found = replace(stack_tables(tables), name="deployment")
        return found if found.rows else None

    @abstractmethod
    def manifest_and_space(self, run: Path) -> tuple[RunManifest | EpisodesManifest, AnySpace]:
        """Return the manifest of one run, and the space that reads its replies."""

    def reader(self, run: Path) -> DecisionReader:
        """Return what reads the reply of each call of one run, as the run's score does."""
        return read_in(self.manifest_and_space(run)[1])

    def models(self, folder: Path) -> list[str]:
        """Return the SPECs of all models in a folder's runs."""
        by_run = (self.manifest(run).models for run in self.runs(folder).values())
        return list(dict.fromkeys(spec for models in by_run for spec in models))

    @abstractmethod
    def manifest(self, run: Path) -> RunManifest | EpisodesManifest:
        """Return the manifest of one run, without its bank."""

    def unread(self, folder: Path) -> dict[str, tuple[UnreadReply, ...]]:
        """Return the replies of each model that hold no decision, in all runs of a folder."""
        result: dict[str, tuple[UnreadReply, ...]] = {}
        for name, run in self.runs(folder).items():
            (manifest, space), read = self.manifest_and_space(run), self.reader(run)
            if (run / LEDGER).is_file():
                with Ledger(run / LEDGER) as ledger:
                    where = f" in {name}" if name else ""
                    result |= {f"{spec}{where}": unread(ledger, spec, space, read) for spec in manifest.models}
        return result

    def verdicts(self, score: S) -> "Mapping[str, Verdict]":
        """Return the verdict on each model; empty for a study without verdicts."""
        del score
        return {}

    def findings(self, score: S) -> Mapping[str, ModelSummary]:
        """Return each model's finding for an index of runs; empty for a study without verdicts."""
        del score
        return {}

    def verdict_json(self, score: S) -> Mapping[str, object]:
        """Return the verdicts as plain JSON values."""
        return {"models": {spec: verdict.as_dict() for spec, verdict in self.verdicts(score).items()}}

    def verdict_printed(self, score: S) -> "Iterator[Table | Text | str]":
        """Yield what ``eyechart verdict`` prints."""
        raise NotImplementedError

    def gate(self, score: S, require: Sequence[str], **terms: "Unpack[Terms]") -> "Gate":
        """Check a score against ``requirements``; a study without any refuses earlier."""
        raise NotImplementedError

    def course(self, scores: Sequence[S], reading: ReadOptions) -> CheckpointSeries | None:
        """Return several runs as a training course; None where runs are compared one by one."""
        del scores, reading
        return None

    def report(self, runs: Sequence[Path], banks: Sequence[Path], reading: ReadOptions, tell: Tell) -> StudyReport:
        """Return the report of runs, from ``printed``.

        Pictures, if any, are in ``banks`` or where the runs recorded them.
        """
        from eyechart.report.page import Section, page_of  # noqa: PLC0415 - a score needs no templates

        del banks
        sections, scores = [], {}
        for run, name in zip(runs, names_of(runs), strict=True):
            tell(f"scoring {run.name}")
            scores[name] = self.score(run, reading)
            parts = list(self.printed(scores[name]))
            lines = [part for part in parts if isinstance(part, str)]
            every = f"Every number of {name}" if len(runs) > 1 else "Every number"
            sections.append(Section(every, tables=[part for part in parts if not isinstance(part, str)], lines=lines))
        if (costs := self.deployment(runs, reading)) is not None:
            sections.append(Section("What decisions cost and take", tables=[costs]))
        title = ", ".join(run.name for run in runs)
        page = page_of(
            self.question or f"What came of these {self.runs_are}?", title, sections, answer=self.answer(scores)
        )
        return StudyReport(page, [table for section in sections for table in section.tables], page.notes)

    def answer(self, scores: Mapping[str, S]) -> "PageSummary | None":
        """Return the opening of the report, from scores by run; None to begin with the tables."""
        del scores
        return None

    def paper(
        self, runs: Sequence[Path], banks: Sequence[Path], reading: ReadOptions, tell: Tell
    ) -> "Iterator[Table | Drawing]":
        """Yield the paper's tables and figures that these runs determine, by the paper's labels."""
        del runs, banks, reading, tell
        yield from ()

    def require_scorable(self, run: Path, reading: ReadOptions) -> None:
        """Raise LedgerError or SpecError where a run may not be bundled under this reading."""
        raise NotImplementedError

    def derive(self, run: BundledRun, reading: ReadOptions, tell: Tell) -> tuple[S, StudyReport]:
        """Return the score and the report of a run whose bank is in the bundle."""
        raise NotImplementedError

    def whole(self, folder: Path, reading: ReadOptions, tell: Tell) -> tuple[S, StudyReport]:
        """Return score and report of a bundled run of episodes, or of a folder of several runs."""
        raise NotImplementedError


STUDIES: dict[str, str] = {
    "battery": "eyechart.studies.battery.study:BatteryStudy",
    "structured": "eyechart.studies.structured.study:StructuredStudy",
    "online": "eyechart.studies.structured.study:OnlineStudy",
    "closed_loop": "eyechart.studies.closed_loop.study:ClosedLoop",
    "hierarchy": "eyechart.studies.hierarchy.study:Hierarchy",
    "prompts": "eyechart.studies.prompts:Prompts",
    "policy": "eyechart.studies.policy.study:Policies",
}
"""The class of each study: ``module:class``, imported when it is opened."""
OF_SEVERAL = ("hierarchy", "prompts")
"""Studies whose folders hold runs and no ``run.json``; for a single run they are tried last."""


def open_study(name: str) -> Study[Any]:
    """Open a study by its name."""
    module, _, attribute = STUDIES[name].partition(":")
    opened: Study[Any] = getattr(import_module(module), attribute)()
    return opened


def study_of(folder: Path, to: str = "") -> Study[Any]:
    """Return the study of a run folder; falls back to the battery for its error message.

    Raises SpecError, in the study's words, where the study refuses the command ``to``.
    """
    begun = any((folder / name).is_file() for name in (RUN, *BESIDE))
    opened = map(open_study, sorted(STUDIES, key=lambda name: begun == (name in OF_SEVERAL)))
    study = next((one for one in opened if one.holds(folder)), None) or open_study("battery")
    if to in study.refuses:
        raise SpecError(f"{folder} {study.refuses[to]}")
    return study


def each_once(runs: Iterable[Path]) -> list[Path]:
    """Return the folders in order, each once, under the first name given for it."""
    paths: dict[Path, Path] = {}
    for run in runs:
        paths.setdefault(run.resolve(), run)
    return list(paths.values())


def names_of(runs: Sequence[Path]) -> list[str]:
    """Return the runs' folder names; equal names are numbered."""
    names = [path.resolve().name or "run" for path in runs]
    return [
        name if names.count(name) == 1 else f"{name} ({1 + names[:place].count(name)})"
        for place, name in enumerate(names)
    ]


def run_json(folder: Path) -> Mapping[str, object]:
    """Return a folder's ``run.json``; empty where there is none or it is not a JSON object.

    Raises LedgerError where the system denies reading: the run would pass for one of another study.
    """
    file = folder / RUN
    try:
        found = parse_json(text_file(file).read_text(encoding="utf-8"))
    except (FileNotFoundError, NotADirectoryError, ValueError, RecursionError):
        return {}
    except OSError as error:
        raise LedgerError(f"{file} cannot be read: {why(error)}") from error
    return found if isinstance(found, dict) else {}


def is_episodes(path: Path) -> bool:
    """Return whether a folder is a run of episodes, by the format of its ``run.json``."""
    return run_json(path).get("format") == EpisodesManifest.FORMAT


def require_single(runs: Sequence[Path]) -> None:
    """Raise SpecError that names the runs if one of these folders is a study of several."""
    for run in runs:
        if "" not in (parts := study_of(run).runs(run)):
            named = ", ".join(map(str, parts.values()))
            raise SpecError(f"{run} is a study of several runs: name one of them: {named}")
