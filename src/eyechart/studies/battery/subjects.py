"""The evidence of a run is all that a report shows: scores, verdicts, verbatim replies, and pictures."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from eyechart.calls import Reply
from eyechart.conditions import sources
from eyechart.errors import BankError
from eyechart.frames import Frame, FrameBank, check, open_bank
from eyechart.ledger import Ledger
from eyechart.manifest import BANK, LEDGER, RunManifest, asked_of
from eyechart.spaces.space import Decision
from eyechart.studies import battery as study
from eyechart.studies.battery import BatteryScore, ModelScore
from eyechart.studies.battery.planning import plan_of
from eyechart.verdicts import Verdict, judge

SHOWN = "every picture is the one that the run recorded (SHA-256), and the geometry is the same"

Tell = Callable[[str], None]
"""Is told in words what is under way, for whoever waits."""

Replies = Mapping[tuple[str, str], Reply]
"""A model's replies by frame and condition."""


@dataclass(frozen=True)
class Evidence:
    """One run, scored and judged.

    ``pictures`` is None where the bank's pictures cannot be shown; ``about_pictures`` then says why, else that they
    are those that the run recorded. ``unknown`` counts each model's calls that were sent and whose outcome is not
    known.
    """

    name: str
    score: BatteryScore
    verdicts: Mapping[str, Verdict]
    replies: Mapping[str, Replies]
    unknown: Mapping[str, int]
    pictures: FrameBank | None
    about_pictures: str

    @property
    def conditions(self) -> tuple[str, ...]:
        """Return the run's conditions."""
        return self.score.manifest.conditions

    @cached_property
    def frames(self) -> tuple[Frame, ...]:
        """Return the frames that the run asks about."""
        return next((model.answers.frames for model in self.score.models.values()), ())


@dataclass(frozen=True)
class Subject:
    """A model in a run. ``label`` names the run too where a report holds several."""

    label: str
    spec: str
    run: Evidence

    @property
    def model(self) -> ModelScore:
        """Return the model's score."""
        return self.run.score.models[self.spec]

    @property
    def verdict(self) -> Verdict:
        """Return the model's verdict."""
        return self.run.verdicts[self.spec]

    def decision(self, condition: str, frame: int) -> Decision[str] | None:
        """Return the decision on the frame of this number, None where there is no reply."""
        given = self.model.answers.decisions.get(condition)
        return None if given is None else given[frame]


def read_evidence(
    runs: Sequence[Path],
    banks: Sequence[Path] = (),
    *,
    independent: bool = False,
    reread: bool = False,
    tell: Tell = lambda _: None,
) -> list[Evidence]:
    """Score and judge runs, and find their pictures: in one of ``banks``, or where each run's manifest says.

    Raises LedgerError or BankError where a folder is no run. Pictures that are missing or differ raise nothing.
    """
    found = []
    for path, name in zip(runs, names_of(runs), strict=True):
        tell(f"scoring {name}")
        scored = study.score(path, independent=independent, reread=reread)
        tell(f"checking the pictures of {name}")
        found.append(
            evidence_of(name, scored, path / LEDGER, *find_pictures(scored.manifest, scored.bank, path, banks))
        )
    return found


def evidence_of(name: str, scored: BatteryScore, ledger_path: Path, pictures: FrameBank | None, about: str) -> Evidence:
    """Return the evidence of a scored run, whose pictures somebody has looked for."""
    with Ledger(ledger_path) as ledger:
        replies = {
            spec: {(key.frame, key.condition): reply for key, reply in ledger.replies(spec)} for spec in scored.models
        }
        unknown = [key.model for key in ledger.unknown()]
    counts = {spec: unknown.count(spec) for spec in scored.models}
    return Evidence(name, scored, judge(scored), replies, counts, pictures, about)


def used_pictures(manifest: RunManifest, bank: FrameBank) -> set[str]:
    """Return the files of the bank's pictures that the planned calls show, or are made of."""
    plan = plan_of(manifest, bank)
    shown = {(key.condition, key.frame) for key in plan.keys()}  # noqa: SIM118 - a plan is no mapping
    return {file for name, frame in shown for file in sources(name, bank.frame(frame), bank, plan.seed)}


def subjects(evidence: Sequence[Evidence]) -> list[Subject]:
    """Return every model of every run, in order."""
    several = len(evidence) > 1
    return [
        Subject(f"{run.name} · {spec}" if several else spec, spec, run) for run in evidence for spec in run.score.models
    ]


def names_of(runs: Sequence[Path]) -> list[str]:
    """Return the runs' folder names, numbered where two are the same."""
    names = [path.resolve().name or "run" for path in runs]
    return [
        name if names.count(name) == 1 else f"{name} ({1 + names[:place].count(name)})"
        for place, name in enumerate(names)
    ]


def find_pictures(
    manifest: RunManifest, asked: FrameBank, run: Path, banks: Sequence[Path] = ()
) -> tuple[FrameBank | None, str]:
    """Return the bank with the pictures that the run was made on, or None with the reason in words."""
    why = "no bank was given"
    for place in banks or _usual_places(manifest, asked, run):
        try:
            bank = open_bank(place)
            problem = _problem(bank, manifest, asked)
        except BankError:
            problem = f"the bank '{place.name}' is not there or cannot be opened"
        if problem is None:
            return asked_of(bank, manifest.prompt), SHOWN
        why = problem
    return None, why


def _usual_places(manifest: RunManifest, asked: FrameBank, run: Path) -> list[Path]:
    """Return where a run's pictures may be: its own copy of the bank, if it holds any, and where its manifest says."""
    own = run / BANK
    held = [own] if any((own / file).is_file() for file in used_pictures(manifest, asked)) else []
    return [*held, Path(manifest.bank_path)]


def _problem(bank: FrameBank, run: RunManifest, asked: FrameBank) -> str | None:
    mine, recorded = bank.manifest, asked.manifest
    if mine.fingerprint != run.fingerprint:
        return (
            f"the bank '{bank.root.name}' has fingerprint {mine.fingerprint[:16]}, the run was made on "
            f"{run.fingerprint[:16]}"
        )
    if mine.images != recorded.images:
        return f"the bank '{bank.root.name}' has other pictures of the same geometry than the run was made on"
    problems = check(bank.root, used_pictures(run, asked))
    return f"the bank '{bank.root.name}' is damaged: {len(problems)} differences" if problems else None
