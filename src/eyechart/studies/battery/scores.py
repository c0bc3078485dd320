"""Scores a run: ledger and bank to decisions to statistics; only reads, same bytes every time."""

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Generic, TypeVar

from eyechart.calls import CallKey
from eyechart.conditions import CONTROLS, OVER, is_available, of_bank
from eyechart.costs import ALL, Account, accounts_of
from eyechart.errors import LedgerError, SpecError, counted
from eyechart.frames import IMPORTED, FrameBank
from eyechart.integrity import Guard, RequestChecks, guards_of
from eyechart.kept import kept
from eyechart.ledger import COLUMNS, Attempts, Ledger
from eyechart.manifest import LEDGER, RunManifest, read_run
from eyechart.models.prices import Prices, read_prices
from eyechart.modes import is_made_elsewhere
from eyechart.records import to_json_fields
from eyechart.run import Plan, cells_of, lacking
from eyechart.spaces.reader import READERS
from eyechart.stats.resamples import holm
from eyechart.stats.statistic import ModelStatistics, Statistic
from eyechart.studies.battery.answers import Answers, Mask, answers_in
from eyechart.studies.battery.calibrated_statistics import CalibratedTests, LazyStatistics
from eyechart.studies.battery.controls import DEPTH_TESTS, OF_PICTURES, TURN_TESTS
from eyechart.studies.battery.depth import NAMES
from eyechart.studies.battery.early_stop import EarlyStop, StoppingState
from eyechart.studies.battery.paper_statistics import PaperStatistics, Resampling
from eyechart.studies.battery.plans import STUDY, plan_of
from eyechart.studies.battery.requests import require_requests
from eyechart.studies.battery.series import StepReplies, series_statistics, step_in, unseeing
from eyechart.studies.battery.stages import (
    ControlProgress,
    answered,
    asked_of_model,
    available_controls,
    series_of,
    staged,
    stages_of,
    widest,
)
from eyechart.verdicts import Evidence, StoppingPoint
from eyechart.verdicts.why_not import MOVED

READ = (
    *(*DEPTH_TESTS, *NAMES, *TURN_TESTS, "repeat_over_nudged", "unparsed_reference", "self_disagreement"),
    *OF_PICTURES,
)
"""The tests that ``depth`` and its turns rest on."""

CallAccounts = tuple[dict[str, dict[str, Account]], dict[str, tuple[Guard, ...]]]
"""By model: accounts by condition, and guards."""

HOLM = ("cramers_v", "cramers_v.decision", "obstacle", "mutual_information", "mutual_information.decision")
"""The tests whose p is corrected over the models of a run (Holm 1979)."""


@dataclass(frozen=True)
class ModelScore:
    """One model's decisions and statistics; ``holm`` has each test's p corrected over the models.

    ``planned`` and ``answered`` count calls; a verdict on fewer than planned says so. ``stopped``
    says where the run settled its verdict early. Then ``answers`` and ``answered`` hold the calls
    that count, and ``statistics`` their e-values. Other statistics keep only their value, because p
    and interval hold only at a fixed sample size. ``controls`` are the model's control conditions;
    those of an unfinished stage are in no statistic.
    """

    model: str
    version: str
    planned: int
    answered: int
    answers: Answers
    statistics: Mapping[str, Statistic]
    holm: Mapping[str, float | None]
    stopped: StoppingPoint | None = None
    controls: ControlProgress = field(default_factory=ControlProgress)

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        names = "version planned answered stopped statistics holm"
        return to_json_fields(self, names, controls=self.controls.controls)


M = TypeVar("M")
"""A study's score of one model's calls."""


@dataclass(frozen=True)
class CallsScore(ABC, Generic[M]):
    """The scores of a run's calls about a bank's frames, and apart from them the costs.

    Two runs with equal answers may differ only in ``accounting`` and ``guards`` (timing, attempts).
    """

    manifest: RunManifest
    bank: FrameBank
    models: Mapping[str, M]
    accounting: Mapping[str, Mapping[str, Account]]
    guards: Mapping[str, tuple[Guard, ...]]

    @property
    def conditions(self) -> tuple[str, ...]:
        """Return the conditions of any model."""
        return self.manifest.conditions

    def marks(self, spec: str) -> list[str]:
        """Return the failed guards of a model in words."""
        return [f"guard '{one.name}' fails: {one.because}" for one in self.guards[spec] if one.holds is False]

    @abstractmethod
    def evidence(self) -> dict[str, Evidence]:
        """Return what the rules judge of every model."""


@dataclass(frozen=True)
class BatteryScore(CallsScore[ModelScore]):
    """The scores of one battery, and apart from them the costs of its calls."""

    independent: bool = False
    """Whether the user or the bank declared that frames without episodes are independent draws."""
    folder: Path = Path("RUN")
    """The folder of the run."""

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        run = to_json_fields(self.manifest, "study fingerprint seed stop_early controls")
        about = {"bank": self.bank.name, "reader": self.bank.manifest.action_space.reader}
        own = to_json_fields(self, "independent models accounting guards")
        return {**run, "prompt": self.manifest.prompt.key, **about, **own}

    @property
    def conditions(self) -> tuple[str, ...]:
        """Return the conditions of any model, controls last."""
        later = dict.fromkeys(name for model in self.models.values() for name in model.controls.controls)
        controls = (name for name in CONTROLS if name in later)
        return (*self.manifest.conditions, *controls, *(name for name in later if step_in(name)))

    def __repr__(self) -> str:
        return f"<BatteryScore of {', '.join(self.models) or 'no model'} on {self.bank.name}>"

    def evidence(self) -> dict[str, Evidence]:
        """Return what the rules judge of every model."""
        absent = tuple(name for name in of_bank(self.bank) if not any(is_available(name, frame) for frame in self.bank))
        part = self.manifest.shard is not None and self.manifest.controls == "auto"
        return {
            spec: Evidence(
                model=spec,
                statistics=model.statistics,
                planned=model.planned,
                answered=model.answered,
                replies=model.answers.counts(),
                guards=self.guards.get(spec, ()),
                holm=model.holm,
                directions=model.answers.directions(),
                gap=model.answers.gap is not None,
                scenarios=len({frame.scenario for frame in model.answers.frames}),
                max_tokens=0 if is_made_elsewhere(spec) else self.manifest.mode(spec).max_tokens,
                scope=self.scope(model),
                stopped=model.stopped,
                absent=absent,
                part=part and any(name not in absent for name in CONTROLS),
                bank=self.manifest.bank_path,
                made=self.bank.manifest.provenance,
                run=str(self.folder),
            )
            for spec, model in self.models.items()
        }

    def measured(self) -> tuple[ModelStatistics, ...]:
        """Return the statistics of every model on the bank."""
        calls = {
            spec: f"{one.answered} of {one.planned} calls; controls may still follow"
            for spec, one in self.evidence().items()
            if one.is_unfinished
        }
        return tuple(
            ModelStatistics(spec, self.bank.name, model.statistics, calls.get(spec, ""))
            for spec, model in self.models.items()
        )

    def scope(self, model: ModelScore | None = None) -> str:
        """Return the scope of a verdict: bank, episodes, model, prompt, date, untested things."""
        bank, run = self.bank, self.manifest
        frames = (model or next(iter(self.models.values()))).answers.frames
        episodes = counted(len({frame.episode for frame in frames}), "episode")
        if "episode" in bank.manifest.absent:
            episodes = f"no episodes recorded{', frames declared independent' if self.independent else ''}"
        who = f"{model.model}@{model.version}" if model else "each model"
        size = f"{counted(len(frames), 'frame')}, {episodes}"
        terms = f"with prompt {run.prompt.key} on {run.created}; not tested: other prompts, other cameras, closed loop."
        if any(is_made_elsewhere(spec) for spec in ([model.model] if model else self.models)):
            terms = f"called elsewhere and not by eyechart{'' if model else ' where its name says so'}, {terms}"
        said = f"On bank {bank.name} ({bank.manifest.picture}; {size}), {who} {terms}"
        return " ".join((said, *_made_in_words(bank)))


def _made_in_words(bank: FrameBank) -> Iterator[str]:
    """Yield how the control pictures of a bank were made, unless a simulator rendered them."""
    manifest = bank.manifest
    if manifest.simulator != IMPORTED or not any(frame.counterfactuals for frame in bank):
        return
    if manifest.made != "edited":
        words = f"were {manifest.made}" if manifest.made else "may be rendered, staged or edited: it is not said"
        yield f"Its control pictures {words}."
        return
    edit = manifest.edit
    counts = ", ".join(f"{name} {sum(name in frame.counterfactuals for frame in bank)}" for name in MOVED)
    how, refused = edit.get("method"), edit.get("refused")
    left = f"; {sum(refused.values())} pictures were refused, see edit.json" if isinstance(refused, dict) else ""
    by = f" ({how})" if how else ""
    yield f"Its control pictures were made by editing{by}: {counts} of {len(bank)} frames{left}."
    yield "Cut-outs were moved, not things: light, haze, reflections or the face that is seen may play a part."


def score(
    path: Path,
    *,
    resamples: int = 5000,
    independent: bool = False,
    reread: bool = False,
    fresh: bool = False,
    frames: Sequence[str] = (),
) -> BatteryScore:
    """Score the battery in a run's folder, finished or not, on some of its ``frames`` or on all.

    ``independent`` declares that frames without episodes are independent draws, as a bank's
    manifest may. ``fresh`` reads the ledger anew, whatever was kept of it. ``reread`` lets today's
    reader read the replies of a run begun under an older one. Raises LedgerError or BankError where
    the folder is no run, needs ``reread``, or holds calls that it does not plan. Raises SpecError
    where independence is declared for a bank with episodes, or the run cannot be scored on these
    ``frames``.
    """
    manifest, bank = read_run(path, reread=reread)
    require_scorable(path, manifest, bank, independent=independent, reread=reread)
    if frames:
        chosen = set(frames)
        ids = tuple(frame.id for frame in plan_of(manifest, bank).frames if frame.id in chosen)
        if not ids or manifest.stop_early:
            why = "its answers chose its frames" if manifest.stop_early else "it has none of them"
            raise SpecError(f"{path} cannot be scored on {len(chosen)} frames of its bank: {why}")
        manifest = replace(manifest, frames=ids)
    return score_run(
        manifest, bank, path / LEDGER, resamples=resamples, independent=independent, held=True, fresh=fresh
    )


def require_scorable(
    path: Path, manifest: RunManifest, bank: FrameBank, *, independent: bool = False, reread: bool = False
) -> None:
    """Raise LedgerError or SpecError where a run may not be scored so, see ``score``."""
    if manifest.study != STUDY:
        raise LedgerError(
            f"{path} is a run of the study '{manifest.study}', not of a battery: use 'eyechart score {path}'; in "
            "Python, eyechart.api.read_policies reads policies, and eyechart.studies.study_of finds any run's study"
        )
    manifest.require_reader(path, READERS, reread=reread)
    if (
        independent
        and max(Counter(frame.episode for frame in bank).values()) > 1
        and "episode" not in bank.manifest.absent
    ):
        raise SpecError(
            f"{path}: the frames of an episode are not independent draws, and this bank records episodes; "
            "leave out --independent"
        )


def score_run(
    manifest: RunManifest,
    bank: FrameBank,
    ledger_path: Path,
    *,
    resamples: int = 5000,
    independent: bool = False,
    held: bool = False,
    fresh: bool = False,
) -> BatteryScore:
    """Score the calls in a ledger by a run's manifest and its bank.

    With ``held`` the ledger's columns are kept in its run's folder, and each call is compared with
    the run's requests; raises LedgerError where one differs. ``fresh`` reads them anew.
    """
    independent = independent or bank.manifest.independent
    how = Resampling(resamples=resamples, seed=manifest.seed)
    plan, has_text = plan_of(manifest, bank), bool(manifest.prompt.fields)
    attempts = attempts_of(ledger_path, plan, kept_in=ledger_path.parent if held else None, fresh=fresh)
    if held:
        require_requests(ledger_path, attempts, manifest, plan)
    may, progress, answers = available_controls(manifest, plan), dict[str, ControlProgress](), dict[str, Answers]()
    series = series_of(manifest)
    for spec in manifest.models:
        progress[spec] = asked_of_model(plan, spec, answered(attempts, plan, spec), may, series=series)
        reading = replace(plan, controls={spec: may if manifest.stop_early else progress[spec].controls})
        answers[spec] = answers_in(attempts, reading, spec, independent=independent, has_text=has_text)
    wide, plan = widest(manifest, plan), staged(plan, progress)
    courses, finished, said = _further(manifest, wide, ledger_path)
    spent, guards = taken(attempts, manifest, plan, read_prices(), courses)
    stopped = {spec: course.stopped(answers[spec].finished) for spec, course in courses.items()}
    for spec, course in courses.items():
        if stopped[spec] is not None:
            answers[spec] = _counting(answers[spec], course.counted)
            progress[spec] = ControlProgress(
                tuple(name for name in CONTROLS if name in answers[spec].decisions), ended=True
            )
        else:
            came = sum(key in finished for key in plan.keys_of(spec))
            answers[spec] = replace(answers[spec].under(plan.conditions_of(spec)), finished=came)
    statistics = {
        spec: _with_evidence(
            lazy_statistics(
                answer.under(progress[spec].judged_of(plan)), how, independent=independent, said=said.get(spec)
            ),
            courses.get(spec),
            stopped.get(spec),
        )
        for spec, answer in answers.items()
    }
    corrected = _corrected(statistics, {spec for spec, one in stopped.items() if one is not None})
    models = {
        spec: ModelScore(
            model=spec,
            version=version,
            planned=sum(int(cells.sum()) for cells in plan.cells(spec).values()),
            answered=answers[spec].finished,
            answers=answers[spec],
            statistics=statistics[spec],
            holm=corrected[spec],
            stopped=stopped.get(spec),
            controls=progress[spec],
        )
        for spec, version in manifest.models.items()
    }
    return BatteryScore(manifest, bank, models, spent, guards, independent, ledger_path.parent)


def _further(
    manifest: RunManifest, wide: Plan, ledger_path: Path
) -> tuple[dict[str, StoppingState], set[CallKey], dict[str, StepReplies]]:
    """Return what columns do not tell: the course of an early stop, its finished calls, and words at each step."""
    series = series_of(manifest)
    if not (series or manifest.stop_early):
        return {}, set(), {}
    with Ledger(ledger_path) as ledger:
        said = {spec: unseeing(ledger.replies(spec)) for spec in manifest.models if series}
        courses = EarlyStop(wide, ledger).courses if manifest.stop_early else {}
        return courses, ledger.finished() if courses else set(), said


def attempts_of(ledger: Path, plan: Plan, *, kept_in: Path | None = None, fresh: bool = False) -> Attempts:
    """Return a ledger's attempts as columns, its replies read by a plan, or those kept in a folder.

    Raises LedgerError where it is damaged.
    """

    def read() -> Attempts:
        with Ledger(ledger, sound=False) as opened:
            return opened.columns(plan.read, by_frame=bool(plan.space.columns))

    return read() if kept_in is None else kept(kept_in, ["columns", plan.space.reader], read, COLUMNS, fresh=fresh)


def took(path: Path, *, prices: Prices | None = None, fresh: bool = False) -> CallAccounts:
    """Return the cost of every model's calls, and whether the guards hold, without statistics."""
    return took_run(*read_run(path), path / LEDGER, prices=prices, kept_in=path, fresh=fresh)


def took_run(
    manifest: RunManifest,
    bank: FrameBank,
    ledger_path: Path,
    *,
    prices: Prices | None = None,
    kept_in: Path | None = None,
    fresh: bool = False,
) -> CallAccounts:
    """Return what `took` returns, from a run's manifest and its bank."""
    plan = plan_of(manifest, bank)
    attempts, courses = attempts_of(ledger_path, plan, kept_in=kept_in, fresh=fresh), dict[str, StoppingState]()
    if manifest.stop_early:
        with Ledger(ledger_path) as ledger:
            courses = EarlyStop(widest(manifest, plan), ledger).courses
    plan = staged(plan, stages_of(manifest, plan, attempts))
    return taken(attempts, manifest, plan, prices or read_prices(), courses)


def taken(
    attempts: Attempts,
    manifest: RunManifest,
    plan: Plan,
    prices: Prices,
    courses: Mapping[str, StoppingState] | None = None,
) -> CallAccounts:
    """Return costs and guards of a plan's calls; ``courses`` limit the calls of an early stop."""
    spent: dict[str, dict[str, Account]] = {}
    found: dict[str, tuple[Guard, ...]] = {}
    requests = RequestChecks(attempts, manifest.models)
    for spec in manifest.models:
        mode, rows = manifest.mode(spec), attempts.of(spec)
        ended = attempts.cells(rows[attempts.finishing(rows)], plan.places, plan.study, plan.prompt.key)
        planned = _wanted(plan, spec, courses[spec]) if courses else plan.cells(spec)
        calls = sum(int(cells.sum()) for cells in planned.values())
        spent[spec] = accounts_of(attempts, spec, prices.of(mode))
        said = spent[spec][ALL].words
        guards = guards_of(attempts, spec, mode, (calls, lacking(planned, ended)), manifest.fingerprint, said)
        found[spec] = (*guards, *requests.guards(spec))
    return spent, found


def _wanted(plan: Plan, spec: str, course: StoppingState) -> dict[tuple[str, int], Mask]:
    """Return the planned calls that a model's early stop leaves."""
    controls, keys = plan.controls.get(spec, ()), plan.keys_of(spec)
    wanted = (key for key in keys if key.condition in controls or key.condition in course.wanted(key.frame))
    return cells_of(wanted, plan.places)


def _counting(answers: Answers, counted: Collection[tuple[str, str]]) -> Answers:
    """Return the answers that count, without control conditions that have none."""
    decisions = {
        name: tuple(
            one if (frame.id, name) in counted else None for frame, one in zip(answers.frames, column, strict=True)
        )
        for name, column in answers.decisions.items()
    }
    kept = {name: column for name, column in decisions.items() if name not in CONTROLS or any(column)}
    return replace(answers, decisions=kept, finished=len(counted))


def _with_evidence(
    statistics: Mapping[str, Statistic], course: StoppingState | None, stopped: StoppingPoint | None
) -> Mapping[str, Statistic]:
    """Add the e-values of a run that stops early; remove what holds only at a fixed sample size.

    The tests that ``depth`` reads stay, because they used all frames.
    """
    if course is None:
        return statistics
    if stopped is None:
        return {**statistics, **course.statistics()}
    kept = {stopped.lateral_by, *(READ if stopped.is_whole else ())}
    bare = {name: statistic if name in kept else _bare(statistic) for name, statistic in statistics.items()}
    return {**bare, **course.statistics()}


def _bare(statistic: Statistic) -> Statistic:
    """Return a statistic of a run that stopped early, without its p and its interval."""
    words = "stopped early: a p or an interval would hold at a fixed size only"
    tested = {
        name for name in statistic.detail or {} if name.startswith("p_") or name.endswith("_p") or name == "bounded"
    }
    detail = (
        None if statistic.detail is None else {name: of for name, of in statistic.detail.items() if name not in tested}
    )
    return replace(
        statistic, ci=None, p=None, note=f"{statistic.note}; {words}" if statistic.note else words, detail=detail
    )


def statistics_of(
    answers: Answers, how: Resampling, *, independent: bool = False, said: StepReplies | None = None
) -> dict[str, Statistic]:
    """Return the paper's statistics, the calibrated tests and the series of one model, by name."""
    return dict(lazy_statistics(answers, how, independent=independent, said=said))


def lazy_statistics(
    answers: Answers, how: Resampling, *, independent: bool = False, said: StepReplies | None = None
) -> LazyStatistics:
    """Return what `statistics_of` does, each computed when it is first read: a verdict reads half of them."""
    plain = answers.under([name for name in answers.decisions if OVER not in name or not step_in(name)])
    tests = PaperStatistics(plain, how).tests() | CalibratedTests(plain, how, independent).tests()
    steps = series_statistics(answers, said or {})
    return LazyStatistics(tests | {name: partial(steps.__getitem__, name) for name in steps})


def _corrected(
    statistics: Mapping[str, Mapping[str, Statistic]], stopped: Collection[str]
) -> dict[str, dict[str, float | None]]:
    """Correct each test over the models; p is 1 for a constant or an early-stopped model."""
    by_model: dict[str, dict[str, float | None]] = {spec: {} for spec in statistics}
    for test in HOLM:
        corrected = holm([1.0 if spec in stopped else found[test].p for spec, found in statistics.items()])
        for spec, p in zip(statistics, corrected, strict=True):
            by_model[spec][test] = None if spec in stopped else p
    return by_model
