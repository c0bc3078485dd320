"""The stages of a run: a model's finished answers alone decide which controls it is shown.

The run's conditions come first. Then follow, for each model, the controls that could refute what
its answers suggest, and the steps of the run's series of corruptions. A stage begins when the one
before is finished. See docs/decisions/stopping.md.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from eyechart.calls import UNFINISHED, CallKey, Reply
from eyechart.conditions import ABSENT, AGAIN, CONTROLS, asked_in_stages, is_available
from eyechart.ledger import Attempts, Ledger
from eyechart.manifest import RunManifest
from eyechart.run import Plan, Stages, cells_of, in_order, lacking
from eyechart.seeds import key_seed
from eyechart.studies.battery.answers import Answers, Mask, answers_in, read_answers
from eyechart.studies.battery.calibrated_statistics import CalibratedTests, LazyStatistics
from eyechart.studies.battery.paper_statistics import Resampling
from eyechart.studies.battery.series import every_step, most_left, next_steps
from eyechart.verdicts import controls_wanted


@dataclass(frozen=True, slots=True)
class ControlProgress:
    """The controls for a model and the steps of its series, by its answers so far.

    ``judged`` are those of finished stages, ``open`` those of the current stage. ``most``
    are all controls that may still follow; empty where it ``ended``: the last stage is finished and
    nothing is left to refute.
    """

    judged: tuple[str, ...] = ()
    open: tuple[str, ...] = ()
    most: tuple[str, ...] = ()
    ended: bool = False

    @property
    def controls(self) -> tuple[str, ...]:
        """Return all controls of the model, in the order of their stages."""
        return (*self.judged, *self.open)

    def judged_of(self, plan: Plan) -> tuple[str, ...]:
        """Return the conditions whose answers are judged: all but the current stage's."""
        return (*plan.conditions, *self.judged)


def available_controls(manifest: RunManifest, plan: Plan) -> tuple[str, ...]:
    """Return the controls that may follow a run's conditions; a shard has none."""
    if manifest.controls != "auto" or plan.shard is not None:
        return ()
    shown = asked_in_stages([name for name in CONTROLS if any(is_available(name, frame) for frame in plan.frames)])
    return tuple(name for name in shown if name not in plan.conditions)


def series_of(manifest: RunManifest) -> tuple[str, ...]:
    """Return the series of a run; a shard has none."""
    return () if manifest.shard is not None else manifest.series


def widest(manifest: RunManifest, plan: Plan) -> Plan:
    """Return a plan with every control that any model of the run may need."""
    may = available_controls(manifest, plan)
    return replace(plan, controls={spec: may for spec in plan.models if may})


Finished = Mapping[tuple[str, int], Mask]
"""A model's finished calls: of each condition and repeat, which frames."""


@dataclass(frozen=True)
class ModelAnswers:
    """A model's answers under every condition that a run may have, and its finished calls."""

    answers: Callable[[Plan], Answers]
    finished: Callable[[], Finished]


def answered(attempts: Attempts, plan: Plan, model: str) -> ModelAnswers:
    """Return a model's answers in a ledger."""

    def finished() -> Finished:
        rows = attempts.last(model)
        rows = rows[~attempts.error(rows, UNFINISHED)]
        return attempts.cells(rows, plan.places, plan.study, plan.prompt.key)

    independent, has_text = plan.bank.manifest.independent, bool(plan.prompt.fields)
    return ModelAnswers(
        lambda wide: answers_in(attempts, wide, model, independent=independent, has_text=has_text), finished
    )


def replied(replies: Iterable[tuple[CallKey, Reply]], plan: Plan, model: str) -> ModelAnswers:
    """Return a model's answers in replies, the last of each call."""
    given, (independent, has_text) = list(replies), (plan.bank.manifest.independent, bool(plan.prompt.fields))
    return ModelAnswers(
        lambda wide: read_answers(model, given, wide, independent=independent, has_text=has_text),
        lambda: cells_of((key for key, reply in given if reply.error not in UNFINISHED), plan.places),
    )


def asked_of_model(
    plan: Plan,
    model: str,
    given: ModelAnswers,
    may: Sequence[str],
    begun: Sequence[str] = (),
    *,
    series: Sequence[str] = (),
) -> ControlProgress:
    """Return the controls that a model's replies call for, out of those that it ``may`` have.

    The ``series`` of corruptions follow when no control is left. ``begun`` are the controls and
    steps that earlier answers called for; they are kept, and not worked out again.
    """
    if not may and not series:
        return ControlProgress(ended=True)
    finished = given.finished()
    may = [name for name in may if name != AGAIN or not _is_older(plan, model, finished)]
    answers = given.answers(replace(plan, controls={model: (*may, *every_step(series))}))
    answers = replace(answers, sent={})  # a run under way has no order of its calls, and has to find the same
    judged: tuple[str, ...] = ()
    wanted = tuple(begun)
    while not lacking(replace(plan, controls={model: (*judged, *wanted)}).cells(model), finished):
        judged = (*judged, *wanted)
        part, sure = answers.under((*plan.conditions, *judged)), plan.bank.manifest.independent
        statistics = LazyStatistics(
            CalibratedTests(part, Resampling(seed=plan.seed), sure).tests()
        )  # however the run is scored
        wanted = controls_wanted(statistics, supplied=may, conditions_run=judged) if may else ()
        wanted = wanted or next_steps(part, series)
        if not wanted:
            return ControlProgress(judged, ended=True)
    left = (name for name in may if name not in judged + wanted)
    further = most_left(answers, series, (*plan.conditions, *judged, *wanted))
    return ControlProgress(judged, wanted, (*left, *further))


def _is_older(plan: Plan, model: str, finished: Finished) -> bool:
    """Return whether an older version ran the model: all lead_absent calls, no repeats."""
    cells = replace(plan, controls={model: (ABSENT, AGAIN)}).cells(model)
    absent, again = ({at: cells for at, cells in cells.items() if at[0] == name} for name in (ABSENT, AGAIN))
    return not lacking(absent, finished) and lacking(again, finished) == sum(int(one.sum()) for one in again.values())


def staged(plan: Plan, found: Mapping[str, ControlProgress]) -> Plan:
    """Return a plan with the controls of its models."""
    return replace(plan, controls={spec: found[spec].controls for spec in plan.models if found[spec].controls})


def stages_of(manifest: RunManifest, whole: Plan, calls: Ledger | Attempts | None) -> dict[str, ControlProgress]:
    """Return each model's controls in a ``whole`` run, from its ledger or attempts; None are none."""
    may, series = available_controls(manifest, whole), series_of(manifest)
    wanted = calls if may or series else None
    attempts = wanted.columns(whole.read, by_frame=bool(whole.space.columns)) if isinstance(wanted, Ledger) else wanted
    return {
        spec: asked_of_model(
            whole,
            spec,
            replied((), whole, spec) if attempts is None else answered(attempts, whole, spec),
            may,
            series=series,
        )
        for spec in whole.models
    }


class AdaptiveStages(Stages):
    """Runs the controls of each model, stage by stage.

    ``plan`` has the calls of now, of a ``whole`` run. A model's replies are read from the ledger
    once; new ones are added.
    """

    def __init__(self, plan: Plan, whole: Plan, manifest: RunManifest, ledger: Ledger) -> None:
        self._plan, self._whole, self._ledger = plan, whole, ledger
        self._may, self._controls = available_controls(manifest, whole), dict(plan.controls)
        self._series = series_of(manifest)
        self._replies: dict[str, dict[CallKey, Reply]] = {}

    def finished(self, key: CallKey, reply: Reply) -> None:
        """Keep a reply for the next stage."""
        if key.model in self._replies:
            self._replies[key.model][key] = reply

    def more(self, model: str) -> list[CallKey]:
        """Return the calls of a model's next stage, in a seeded random order.

        Empty before its last stage is finished. Calls that a walk over the frames has made already
        are not repeated.
        """
        if not self._may and not self._series:
            return []
        before = self._controls.get(model, ())
        if model not in self._replies:
            self._replies[model] = dict(self._ledger.replies(model))
        replies = self._replies[model]
        came = replied(replies.items(), self._whole, model)
        now = asked_of_model(self._whole, model, came, self._may, before, series=self._series).controls
        fresh = tuple(name for name in now if name not in before)
        if not fresh:
            del self._replies[model]
            return []
        self._controls[model] = (*before, *fresh)
        given = {key for key, reply in replies.items() if reply.error not in UNFINISHED}
        keys = replace(self._plan, controls={model: fresh}).keys_of(model)
        todo = (key for key in keys if key.condition in fresh and key not in given)
        return in_order(todo, key_seed("stage", self._plan.seed, model, *fresh))
