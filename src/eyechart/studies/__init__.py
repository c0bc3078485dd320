"""The studies, a module or package each, one door for all: a kind of run, how it is scored, and what comes of it."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Protocol, TypeVar

from eyechart.costs import ALL, Account, Unread, unread
from eyechart.errors import LedgerError, SpecError, text_file, why
from eyechart.frames import FrameBank
from eyechart.ledger import Ledger
from eyechart.limits import Spent, added
from eyechart.manifest import BESIDE, LEDGER, RUN, EpisodesManifest, RunManifest
from eyechart.models.prices import Prices, read_prices
from eyechart.records import parse_json, plain
from eyechart.spaces.space import AnySpace

if TYPE_CHECKING:  # a score needs no terminal and no figures; a list of costs needs no verdicts
    from typing import Unpack

    from rich.text import Text

    from eyechart.gate import Gate, Terms
    from eyechart.integrity import Guard
    from eyechart.modes import RequestMode
    from eyechart.planned import Planned
    from eyechart.report.charts import Drawing
    from eyechart.report.page import Opening, Page
    from eyechart.report.table import Table
    from eyechart.stats.statistic import Statistic
    from eyechart.verdicts import Label, Ruling, Verdict

Tell = Callable[[str], None]
"""Is told in words what is under way, for whoever waits."""


class Score(Protocol):
    """What a study makes of a run."""

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""


class Course(Protocol):
    """Models of several runs in the order of a training, and what changed from each to the next."""

    @property
    def replicated(self) -> bool:
        """Return whether nothing changed."""

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""

    def printed(self) -> "Iterator[Table | str]":
        """Yield tables and sentences."""


S = TypeVar("S", bound=Score)
NO_DRIVES = dict.fromkeys(
    ("score --against", "report --against"), "is no run of drives, and --against names a policy of one"
)


@dataclass(frozen=True)
class Reading:
    """How runs are read: what is declared of their frames and replies, and what drives are held ``against``.

    Where not ``driven``, a page of drives shows no picture, because no world is opened for one.
    ``steps`` says of policies, by SPEC, how far their training had come. ``frames`` are those of a bank that a battery
    is scored on; empty for all that were asked about.
    """

    independent: bool = False
    reread: bool = False
    against: str | None = None
    resamples: int = 5000
    driven: bool = True
    steps: Mapping[str, int] = field(default_factory=dict)
    frames: Sequence[str] = ()
    prices: Prices | None = None
    """What a token costs, where a file of one's own says so; None for the table alone."""


@dataclass
class Took:
    """What calls took by model and condition, whether their guards hold, and what probes before the run took."""

    accounts: dict[str, dict[str, Account]] = field(default_factory=dict)
    guards: "dict[str, tuple[Guard, ...]]" = field(default_factory=dict)
    probes: dict[str, Spent] = field(default_factory=dict)

    def add(self, part: str, other: "Took") -> None:
        """Add what a part of a study took; one that stands alone has no name."""
        where = f" in {part}" if part else ""
        self.accounts |= {f"{spec}{where}": found for spec, found in other.accounts.items()}
        self.guards |= {f"{spec}{where}": found for spec, found in other.guards.items()}
        self.probes |= added(self.probes, other.probes)

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        return {"accounting": plain(self.accounts), "guards": plain(self.guards), "probes": plain(self.probes)}


@dataclass(frozen=True)
class Packed:
    """A run in a bundle: its name, what its manifest, its bank and its ledger say, and the bank with its pictures."""

    name: str
    manifest: RunManifest
    bank: FrameBank
    ledger: Path
    pictures: FrameBank


@dataclass(frozen=True)
class Made:
    """A report: its page, its tables, and what is to be said of it."""

    page: "Page"
    tables: "Sequence[Table]"
    lines: Sequence[str]


@dataclass(frozen=True)
class Finding:
    """What a run says of one model, in a word and the estimate that decided it; ``state`` says what keeps it open.

    ``tone`` is that of a ``Mark`` of a table, ``answer`` what it comes to where the tone does not say it. ``marks``
    are the guards that failed, in words.
    """

    label: str
    tone: str
    decided_by: str = ""
    estimate: "Statistic | None" = None
    state: str = ""
    marks: Sequence[str] = ()
    answer: str = ""

    @classmethod
    def of(cls, ruling: "Ruling", label: "Label", state: str = "", marks: Sequence[str] = ()) -> "Finding":
        """Return what an index says by a ruling, whose label this is."""
        return cls(ruling.label, label.family, ruling.decided_by, ruling.statistic, state, marks)


NO_VERDICT = Finding("no verdict", "")


class Study(ABC, Generic[S]):
    """A kind of run, of which a report speaks as ``runs_are``, and which answers a ``question``.

    ``refuses`` says of each thing that it cannot do why, in words that follow a run's name. ``requirements`` are what a
    gate may ask of its models, with what each means, ``required`` the one that it does ask.
    """

    runs_are: ClassVar[str] = ""
    question: ClassVar[str] = ""
    refuses: ClassVar[Mapping[str, str]] = {}
    requirements: ClassVar[Mapping[str, str]] = {}
    required: ClassVar[str] = ""
    callables: ClassVar[bool] = False
    """Whether who is asked is a callable, which counts no tokens and reports no cost."""
    counted: ClassVar[tuple[str, str]] = ("look", "model")
    """What its findings say yes to, and of whom: an index counts the findings of one kind together."""

    @abstractmethod
    def holds(self, folder: Path) -> bool:
        """Return whether a folder is a run of this study; it raises nothing."""

    @abstractmethod
    def score(self, folder: Path, reading: Reading) -> S:
        """Score a run, finished or not; raises LedgerError, BankError or SpecError where it cannot be."""

    def plan(self, bank: Path, modes: "Sequence[RequestMode]", out: Path, *, seed: int, limit: int | None) -> "Planned":
        """Plan a run of models on a bank, for the command of its name, where a study has no other of its own."""
        raise NotImplementedError

    @abstractmethod
    def printed(self, score: S) -> "Iterator[Table | str]":
        """Yield the tables and lines that ``eyechart score --all`` prints."""

    def brief(self, score: S) -> "Iterator[Table | str]":
        """Yield what ``eyechart score`` prints: what decided first; all where a study is short."""
        return self.printed(score)

    @abstractmethod
    def took_run(self, run: Path, prices: Prices) -> Took:
        """Return what the calls of one run took, at these prices."""

    def scored(self, runs: Sequence[Path], reading: Reading, tell: Tell) -> Iterator[tuple[str, S]]:
        """Yield the score of each of several folders with its name."""
        for run, name in zip(runs, names_of(runs), strict=True):
            tell(f"scoring {name}")
            yield name, self.score(run, reading)

    def runs(self, folder: Path) -> Mapping[str, Path]:
        """Return the runs that a folder of this study holds, by name; one that stands alone has none: ``""``."""
        return {"": folder}

    def began(self, folder: Path) -> str:
        """Return when the first call of a folder's runs was sent, by their ledgers; where none was, the day they say.

        A day alone comes before all times of that day.
        """
        sent, said = [], []
        for run in self.runs(folder).values():
            said.append(str(run_json(run).get("created") or ""))
            if (run / LEDGER).is_file():
                with Ledger(run / LEDGER) as ledger:
                    sent.append(ledger.began())
        return min(filter(None, sent or said), default=min(filter(None, said), default=""))

    def took(self, folder: Path, prices: Prices) -> Took:
        """Return what the calls of all runs of a folder took."""
        found = Took()
        for name, run in self.runs(folder).items():
            found.add(name, self.took_run(run, prices))
        return found

    def deployment(self, runs: Sequence[Path], reading: Reading) -> "Table | None":
        """Return what decisions of runs cost and take, in the paper's units; None where no model was asked.

        A model of several runs is named with its run.
        """
        from eyechart.report.accounts import deployment_table  # noqa: PLC0415 - a score needs no tables
        from eyechart.report.table import stacked  # noqa: PLC0415 - as above

        prices, tables = reading.prices or read_prices(), {}
        for run, name in zip(runs, names_of(runs), strict=True):
            accounts = self.took(run, prices).accounts
            tables[name] = deployment_table({spec: found[ALL] for spec, found in accounts.items()})
        found = replace(stacked(tables), name="deployment")
        return found if found.rows else None

    @abstractmethod
    def asked(self, run: Path) -> tuple[RunManifest | EpisodesManifest, AnySpace]:
        """Return the manifest of one run, and the space by which its replies are read."""

    def models(self, folder: Path) -> list[str]:
        """Return the SPECs of the models that the runs of a folder asked."""
        asked = (self.manifest(run).models for run in self.runs(folder).values())
        return list(dict.fromkeys(spec for models in asked for spec in models))

    @abstractmethod
    def manifest(self, run: Path) -> RunManifest | EpisodesManifest:
        """Return the manifest of one run, without its bank."""

    def unread(self, folder: Path) -> dict[str, tuple[Unread, ...]]:
        """Return the replies of each model that hold no decision, in all runs of a folder."""
        found: dict[str, tuple[Unread, ...]] = {}
        for name, run in self.runs(folder).items():
            manifest, space = self.asked(run)
            if (run / LEDGER).is_file():
                with Ledger(run / LEDGER) as ledger:
                    where = f" in {name}" if name else ""
                    found |= {f"{spec}{where}": unread(ledger, spec, space) for spec in manifest.models}
        return found

    def verdicts(self, score: S) -> "Mapping[str, Verdict]":
        """Return the verdict on each model, none where a study has none."""
        del score
        return {}

    def findings(self, score: S) -> Mapping[str, Finding]:
        """Return what an index of runs says of each model, none where a study has no verdict."""
        del score
        return {}

    def verdict_json(self, score: S) -> Mapping[str, object]:
        """Return the verdicts as plain JSON values."""
        return {"models": {spec: one.as_dict() for spec, one in self.verdicts(score).items()}}

    def verdict_printed(self, score: S) -> "Iterator[Table | Text | str]":
        """Yield what ``eyechart verdict`` prints."""
        raise NotImplementedError

    def gate(self, score: S, require: Sequence[str], **terms: "Unpack[Terms]") -> "Gate":
        """Hold a score to some of the ``requirements``; a study without any refuses before it is asked, as below."""
        raise NotImplementedError

    def course(self, scores: Sequence[S], reading: Reading) -> Course | None:
        """Return the models of several runs in the order of a training; None where runs are compared one by one."""
        del scores, reading
        return None

    def report(self, runs: Sequence[Path], banks: Sequence[Path], reading: Reading, tell: Tell) -> Made:
        """Return the report of runs: what ``score`` prints. Pictures, if any, are in ``banks`` or where they were."""
        from eyechart.report.page import Section, page_of  # noqa: PLC0415 - a score needs no templates

        del banks
        sections, scores = [], {}
        for run, name in zip(runs, names_of(runs), strict=True):
            tell(f"scoring {run.name}")
            scores[name] = self.score(run, reading)
            parts = list(self.printed(scores[name]))
            lines = [one for one in parts if isinstance(one, str)]
            every = f"Every number of {name}" if len(runs) > 1 else "Every number"
            sections.append(Section(every, tables=[one for one in parts if not isinstance(one, str)], lines=lines))
        if (costs := self.deployment(runs, reading)) is not None:
            sections.append(Section("What decisions cost and take", tables=[costs]))
        title = ", ".join(run.name for run in runs)
        page = page_of(
            self.question or f"What came of these {self.runs_are}?", title, sections, answer=self.answer(scores)
        )
        return Made(page, [table for one in sections for table in one.tables], page.notes)

    def answer(self, scores: Mapping[str, S]) -> "Opening | None":
        """Return what such a report says first of runs, by name; None where it begins with its tables."""
        del scores
        return None

    def paper(
        self, runs: Sequence[Path], banks: Sequence[Path], reading: Reading, tell: Tell
    ) -> "Iterator[Table | Drawing]":
        """Yield the paper's tables and figures that runs determine, by its labels; nothing where there is none."""
        del runs, banks, reading, tell
        yield from ()

    def require_scorable(self, run: Path, reading: Reading) -> None:
        """Raise LedgerError or SpecError where a run that is to be bundled may not be read so."""
        raise NotImplementedError

    def derive(self, run: Packed, reading: Reading, tell: Tell) -> tuple[S, Made]:
        """Return the score and the report of a run on a bank that is in a bundle."""
        raise NotImplementedError

    def whole(self, folder: Path, reading: Reading, tell: Tell) -> tuple[S, Made]:
        """Return the score and the report of drives, or of a folder of several runs, that are in a bundle."""
        raise NotImplementedError


STUDIES: dict[str, str] = {
    "battery": "eyechart.studies.battery.study:BatteryStudy",
    "structured": "eyechart.studies.structured.study:Structured",
    "online": "eyechart.studies.structured.study:OnlineStudy",
    "closed_loop": "eyechart.studies.closed_loop.study:ClosedLoop",
    "hierarchy": "eyechart.studies.hierarchy.study:Hierarchy",
    "prompts": "eyechart.studies.prompts:Prompts",
    "policy": "eyechart.studies.policy.study:Policies",
}
"""What a study's name means: ``module:class``, imported when it is opened."""
OF_SEVERAL = ("hierarchy", "prompts")
"""The studies whose folders hold runs and are none themselves: of a run they are asked last."""


def open_study(name: str) -> Study[Any]:
    """Open a study by its name."""
    module, _, attribute = STUDIES[name].partition(":")
    opened: Study[Any] = getattr(import_module(module), attribute)()
    return opened


def study_of(folder: Path, to: str = "") -> Study[Any]:
    """Return the study whose run a folder is; the battery, which says what is wrong with it, where it is none.

    Raises SpecError in the study's own words where it refuses what it is asked ``to`` do.
    """
    begun = any((folder / name).is_file() for name in (RUN, *BESIDE))
    opened = map(open_study, sorted(STUDIES, key=lambda name: begun == (name in OF_SEVERAL)))
    study = next((one for one in opened if one.holds(folder)), None) or open_study("battery")
    if to in study.refuses:
        raise SpecError(f"{folder} {study.refuses[to]}")
    return study


def each_once(runs: Iterable[Path]) -> list[Path]:
    """Return folders in their order, each once, by the first of the names under which it was given."""
    found: dict[Path, Path] = {}
    for one in runs:
        found.setdefault(one.resolve(), one)
    return list(found.values())


def names_of(runs: Sequence[Path]) -> list[str]:
    """Return the runs' folder names, numbered where two are the same."""
    names = [path.resolve().name or "run" for path in runs]
    return [
        name if names.count(name) == 1 else f"{name} ({1 + names[:place].count(name)})"
        for place, name in enumerate(names)
    ]


def run_json(folder: Path) -> Mapping[str, object]:
    """Return what a folder's ``run.json`` says, nothing where there is none, or what stands there is none.

    Raises LedgerError where the system does not let it be read: the run would be taken for one of another study.
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
