"""Plans, runs and merges batteries: every frame under every condition, and no call twice."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, replace
from functools import partial
from pathlib import Path
from secrets import randbelow
from typing import TYPE_CHECKING, Any, Self, Unpack

from eyechart.channels import require_history
from eyechart.clusters import require_engine
from eyechart.conditions import (
    BATTERY,
    CONDITIONS,
    CONTROLS,
    NO_HISTORY,
    ONE_INSTANT,
    OVER,
    STEPPED,
    asked_in_stages,
    by_reason,
    find_condition,
    is_available,
    is_of_one_instant,
    of_bank,
    require_camera,
    require_corruptible,
    require_partners,
    show,
)
from eyechart.costs import CostEstimate, estimate
from eyechart.errors import BankError, LedgerError, SpecError, counted, raising, suggestion
from eyechart.event_loops import make_calls
from eyechart.frames import AS_STORED, ENCODINGS, IMPORTED, FrameBank, check, open_bank, whole_folder
from eyechart.ledger import Ledger
from eyechart.limits import RunOutcome
from eyechart.manifest import (
    BANK,
    CONTROLS_ASKED,
    LEDGER,
    OWN,
    RunManifest,
    alone_in,
    asked_of,
    holds,
    is_free,
    is_run,
    read_manifest,
    read_run,
    write_run,
)
from eyechart.models import Model, OpenedModel, history_of, open_model, sequential_groups
from eyechart.models.actors import ActorPool
from eyechart.models.prices import Prices
from eyechart.modes import RequestMode
from eyechart.perception.view import View, through
from eyechart.planned_run import Bar, PlannedRun, RunAllowance, RunEnding, calls_ended, empty, forecast
from eyechart.prompts import Prompt, find_prompt, neutral, require_pictured, require_sayable
from eyechart.run import MotionPlan, Plan, RunOptions, Stages, ask_again, execute, spread
from eyechart.studies.battery.early_stop import NEEDED, EarlyStop, layout_for, typical
from eyechart.studies.battery.early_stop import Progress as HowFar
from eyechart.studies.battery.evidence import NEAR_FAR
from eyechart.studies.battery.requests import require_requests
from eyechart.studies.battery.series import OTHERS, every_step
from eyechart.studies.battery.stages import AdaptiveStages, ControlProgress, staged, stages_of, widest
from eyechart.verdicts import GUARANTEE, VALIDITY

if TYPE_CHECKING:  # a score probes no model
    from eyechart.probe import Sample

STUDY = "battery"

_PICTURES = 5
"""The number of pictures for a probe before a run."""


@dataclass(frozen=True, slots=True)
class BatterySelection:
    """How much of a bank is run: the frames, one ``shard`` of the calls (i, n), or an early stop.

    With ``stop_early`` the calls of a model end once its verdict is settled. It needs whole frames
    and the conditions real, real_repeat and blank. ``controls`` says which control conditions are
    run too: ``auto``, in later stages, those that each model's answers call for; ``all``, for every
    model at once; or ``none``. The default is that of an existing run; else ``none`` where
    conditions are named, and ``auto`` where they are not. ``series`` are corruptions, whose steps
    follow in stages for a model that uses clean pictures.
    """

    limit: int | None = None
    shard: tuple[int, int] | None = None
    stop_early: bool = False
    controls: str | None = None
    series: tuple[str, ...] = ()

    def controls_of(self, out: Path | None, conditions: Sequence[str] | None) -> str:
        """Return which controls are run; raises SpecError for an unknown word."""
        before = read_manifest(out).controls if out is not None and is_run(out) else None
        given = self.controls or before or ("none" if conditions else "auto")
        if given not in CONTROLS_ASKED:
            known = f"{', '.join(CONTROLS_ASKED)}{suggestion(given, CONTROLS_ASKED)}"
            raise SpecError(f"--controls '{given}' is none of {known}")
        return given

    def require_possible(self, conditions: Sequence[str]) -> None:
        """Raise SpecError where a verdict cannot be settled early, or a series cannot be asked."""
        if self.series and (self.stop_early or self.shard is not None):
            raise SpecError(
                f"--series needs the answers of a whole run, so it goes without "
                f"{'--stop-early' if self.stop_early else '--shard'}: "
                + ("leave that out" if self.stop_early else "merge the shards, and give it to the merged run")
            )
        if not self.stop_early:
            return
        if self.shard is not None:
            raise SpecError(
                "--stop-early needs all calls of a frame in one run: leave out --shard, or split the models"
            )
        if missing := [name for name in NEEDED if name not in conditions]:
            raise SpecError(
                f"--stop-early needs the conditions {', '.join(NEEDED)}; --conditions lacks {', '.join(missing)}"
            )


WHOLE = BatterySelection()


@dataclass(frozen=True, slots=True)
class BatterySettings:
    """The calls of a battery, whatever model answers; see `plan`."""

    prompt: str | None = None
    conditions: tuple[str, ...] | None = None
    seed: int = 0
    extent: BatterySelection = WHOLE
    study: str = STUDY


@dataclass(frozen=True)
class Battery(PlannedRun):
    """A planned battery before its run: its plan, its models, and its folder."""

    plan: Plan
    models: Mapping[str, Model]
    manifest: RunManifest
    out: Path
    left_out: Mapping[str, str] = field(default_factory=dict)
    """Conditions that the bank cannot supply, each with the reason; only if none were named."""

    def begin(self) -> RunManifest:
        """Begin the run without models, if it does not exist yet, and return its manifest."""
        if not is_run(self.out):
            write_run(self.out, replace(self.manifest, models={}, modes={}, facts={}), self.plan.bank)
        return read_manifest(self.out)

    def sample(self) -> "Sample":
        """Return a few frames of the battery for a probe."""
        return sample_of([self])

    def lines(self, how: RunAllowance) -> Iterator[str]:
        """Yield what is left out and why, the number and cost of the calls, and the early stop."""
        yield from self.sizes()
        estimates = expected(self, how.prices, concurrency=how.concurrency)
        yield from forecast(self.manifest, self.plan.models, estimates, how)
        if self.manifest.stop_early:
            yield from self._before()

    def make(self, how: RunAllowance, bar: Bar) -> RunOutcome:
        """Make the remaining calls."""
        require_engine(how.engine)
        limits = how.limits(self.manifest)
        options: dict[str, Any] = {"again": how.again, "sequential": how.sequential, "limits": limits}
        here, concurrency = self, how.concurrency
        if how.engine == "ray":
            here, concurrency = self._held(ActorPool(how.workers, how.gpus)), concurrency * how.workers
        with bar("calls", self.unit) as move:
            return make_calls(partial(run, here, concurrency=concurrency, **options), move)

    def _held(self, pool: ActorPool) -> Self:
        """Return the battery with its models held by actors, if any call is left."""
        if not self.left():
            return self
        modes = {spec: self.manifest.mode(spec) for spec in self.plan.models}
        return replace(self, models=pool.hold(self.models, modes, self.plan.prompt.who))

    def ends(self, outcome: RunOutcome, failed: Mapping[str, str]) -> Iterator[RunEnding]:
        """Yield what was saved, how the calls ended, and which models gave empty replies."""
        early = self.manifest.stop_early
        yield RunEnding(self._after() if early else ())
        yield calls_ended(outcome, failed, 0 if outcome.whole and not early else self.left())
        yield empty([self.out])

    def sizes(self) -> list[str]:
        """Return what is left out and why, and how many calls there are."""
        to_make = f"{'at most ' if self.manifest.stop_early else ''}{self.left()}"
        return [*self._left_out(), self._counted("model", to_make), *self._controls(), *self._out_of_reach()]

    def _left_out(self) -> list[str]:
        return [f"left out: {names}, because {why}" for names, why in by_reason(self.left_out).items()]

    def _counted(self, who: str, to_make: str) -> str:
        plan, (calls, finished, unknown) = self.plan, self.counts()
        sent = f"{counted(calls, 'call')}, {finished} finished, {unknown} sent with unknown outcome"
        return f"{counted(len(plan.models), who)} × {plan.size}: {sent}, {to_make} to make"

    def _controls(self) -> list[str]:
        """Return how many control calls may follow, and what a shard does about them."""
        if self.manifest.controls == "auto" and self.manifest.shard is not None:
            return ["controls: none in a shard, because they depend on all answers; merge the shards and resume"]
        more = sum(self.more_by_model().values())
        what = "controls and series" if self.manifest.series else "controls"
        return [f"{what}: up to {counted(more, 'call')} more, if a model's answers call for them"][: more > 0]

    def _out_of_reach(self) -> list[str]:
        """Return the verdicts that so few frames gave no simulated controller, before they are paid for.

        Empty for a shard, and for a run without calls left.
        """
        if self.manifest.shard is not None or not self.left():
            return []
        from eyechart.studies.battery.reach import unreachable_labels  # noqa: PLC0415 - it judges, which a run does not

        never = ", ".join(unreachable_labels(self.plan.bank, self.plan.frames, self.plan.conditions))
        more = f"'eyechart plan {self.manifest.bank_path}' says what does"
        size = len(self.plan.frames)
        return [f"of these {size} frames no simulated controller that was tried gets: {never}; {more}"][: bool(never)]

    def _before(self) -> list[str]:
        """Return what stopping early guarantees, and the most and the typical number of calls."""
        more = self.more_by_model()
        most = max(sum(1 for _ in self.plan.keys_of(model)) + more[model] for model in self.plan.models)
        counts = sorted(self.typical().items(), key=lambda one: one[1])
        usual = ", ".join(f"{count} ({label})" for label, count in counts)
        return [
            f"stop early: {GUARANTEE}",
            f"stop early: {VALIDITY}",
            (
                f"stop early: at most {most} calls per model; a model whose repeats never differ takes "
                f"{usual or 'as many'}"
            ),
        ]

    def _after(self) -> list[str]:
        """Return which models were stopped early, and the calls saved."""
        lines, planned_calls, saved = [], 0, 0
        for model, one in self.progress().items():
            calls = sum(1 for _ in self.plan.keys_of(model)) if one.stopped is None else one.stopped.planned
            planned_calls += calls
            if one.stopped is None:
                lines.append(f"{model}: not stopped early, {one.left} of {calls} calls left")
                continue
            saved += one.stopped.saved
            beyond = f", {one.stopped.beyond} ended after the stop and do not count" if one.stopped.beyond else ""
            share = f"{one.stopped.saved} calls saved ({one.stopped.saved / calls:.0%})"
            lines.append(f"{model}: {one.stopped.words()}: {share}{beyond}")
        return [*lines, f"calls saved: {saved} of {planned_calls} ({saved / max(planned_calls, 1):.0%})"]

    def counts(self) -> tuple[int, int, int]:
        """Return how many calls are planned, finished, and of unknown outcome.

        Only stages that have begun are planned; for further controls see `more_by_model`.
        """
        with self._ledger as ledger:
            keys = set(self.staged(ledger).keys())
            return len(keys), len(keys & ledger.finished()), len(keys & ledger.unknown())

    def left_by_model(self) -> dict[str, int]:
        """Return how many calls of each model remain; an upper limit where the run stops early."""
        if self.manifest.stop_early:
            return {spec: one.left for spec, one in self.progress().items()}
        with self._ledger as ledger:
            plan, finished = self.staged(ledger), ledger.finished()
        return {spec: sum(key not in finished for key in plan.keys_of(spec)) for spec in plan.models}

    def more_by_model(self) -> dict[str, int]:
        """Return the most control calls that may follow beside the planned ones, by model."""
        with self._ledger as ledger:
            found = self._progress(ledger)
        most = replace(self.plan, controls={spec: one.most for spec, one in found.items()})
        return {spec: sum(key.condition in one.most for key in most.keys_of(spec)) for spec, one in found.items()}

    @property
    def _ledger(self) -> Ledger:
        return Ledger(self.out / LEDGER, absent=True)

    def staged(self, ledger: Ledger) -> Plan:
        """Return the plan with the controls that the models' answers so far call for."""
        return staged(self.plan, self._progress(ledger))

    def stages(self, manifest: RunManifest, ledger: Ledger) -> tuple[Plan, Stages]:
        """Return the plan of now, and the stages that decide what follows."""
        whole = plan_of(manifest, self.plan.bank)
        now = staged(self.plan, stages_of(manifest, whole, ledger))
        later = AdaptiveStages(now, whole, manifest, ledger)
        return now, EarlyStop(widest(manifest, self.plan), ledger, later) if manifest.stop_early else later

    def _progress(self, ledger: Ledger) -> dict[str, ControlProgress]:
        progresses = stages_of(self.manifest, plan_of(self.manifest, self.plan.bank), ledger)
        return {spec: progresses[spec] for spec in self.plan.models}

    def left_lines(self) -> Iterator[str]:
        """Yield, of a run that is not finished, what is left and the command that makes it."""
        left, more, manifest = self.left(), sum(self.more_by_model().values()), self.manifest
        if left or more:
            up_to = f", and up to {more} of control pictures" if more else ""
            who = " ".join(
                f"--{'policy' if manifest.study == 'policy' else 'model'} {spec}" for spec in manifest.models
            )
            command = f"'eyechart run {manifest.study} {who} --frames {manifest.bank_path} --out {self.out}'"
            yield f"{counted(left, 'call', 'are')} left{up_to}: {command}, with the options of the shards, makes them"

    def left(self) -> int:
        """Return how many calls of all models remain."""
        return sum(self.left_by_model().values())

    def progress(self) -> dict[str, HowFar]:
        """Return how far each model is, in a run that stops early."""
        with self._ledger as ledger:
            early = EarlyStop(widest(self.manifest, self.plan), ledger)
        return {model: early.progress(model) for model in self.plan.models}

    def typical(self) -> dict[str, int]:
        """Return how many calls a clear model of each kind takes where the run stops early."""
        return typical(layout_for(widest(self.manifest, self.plan), self.plan.models[0]))


def plan(
    bank_path: Path,
    specs: Sequence[str | RequestMode | OpenedModel],
    out: Path,
    *,
    prompt: str | None = None,
    conditions: Sequence[str] | None = None,
    seed: int = 0,
    extent: BatterySelection = WHOLE,
    study: str = STUDY,
) -> Battery:
    """Plan a battery, or the rest of one in ``out``; writes nothing and makes no call.

    ``specs`` name the models: a SPEC for the default mode, a mode, or a model that is open already.
    ``conditions`` default to the eight of Table t:conditions and the counterfactuals that the bank
    can supply, and text_swapped where the prompt has fields; ``extent`` adds controls. ``prompt``
    is a name or a TOML file. It defaults to ``baseline``, and to a plain prompt for imported
    frames, and to its own for a run in ``out``. ``study`` is the name of the study in the manifest.

    Raises BankError where a picture differs from the one that the bank's manifest recorded. Raises
    SpecError for an unknown name, or for a plan that cannot stop early. Raises LedgerError where
    ``out`` holds another run, or a run with early stop that was begun with other frames or
    conditions.
    """
    modes, models = open_models(specs)
    who = {spec: (model.version, model.facts) for spec, model in models.items()}
    asking = BatterySettings(prompt, None if conditions is None else tuple(conditions), seed, extent, study)
    return replace(planned(bank_path, modes, who, out, asking), models=models)


def planned(
    bank_path: Path,
    modes: Mapping[str, RequestMode],
    who: Mapping[str, tuple[str, Mapping[str, str]]],
    out: Path | None,
    asking: BatterySettings,
) -> Battery:
    """Plan a battery as `plan` does, from the version and the facts of each SPEC in ``who``.

    Without ``out`` the battery has no folder.
    """
    conditions, extent = asking.conditions, asking.extent
    bank = open_whole(bank_path)
    formulation = _prompt_for(bank, asking.prompt, out)
    bank = asked_of(bank, formulation)
    require_sayable(formulation, bank)
    for spec, (_, facts) in who.items():
        require_history(spec, history_of(facts), bank)
    if formulation.messages:
        require_pictured(formulation, show("real", bank.frames[-1], bank, asking.seed))
    supplied, left_out = conditions_of(bank, formulation)
    controls = extent.controls_of(out, conditions)
    every = (name for name in supplied if name not in CONTROLS)
    drawn = asked_in_stages(supplied) if controls == "all" else ()
    chosen = tuple(dict.fromkeys((*(conditions or every), *drawn)))
    for name in chosen:
        find_condition(name)
        require_camera(name, bank.frames[0].cameras)
        if (base := name.partition(OVER)[0]) not in supplied and base not in STEPPED:
            raise BankError(f"condition '{name}' cannot be shown: {left_out.get(base, NO_HISTORY)}")
    extent.require_possible(chosen)
    manifest = RunManifest.begun(
        bank,
        modes,
        who,
        study=asking.study,
        seed=asking.seed,
        prompt=formulation,
        conditions=chosen,
        limit=extent.limit,
        shard=extent.shard,
        stop_early=extent.stop_early,
        controls=controls,
        controls_seed=bank.manifest.controls.seed,
        series=extent.series,
    )
    _require_series(manifest.series, chosen)
    require_corruptible((*chosen, *every_step(manifest.series)), bank)
    manifest = manifest if out is None else resume_manifest(out, manifest, bank)
    bank = asked_of(bank, formulation, manifest.reader)
    the_plan = plan_of(manifest, bank, models=tuple(who), conditions=chosen, limit=extent.limit)
    return Battery(the_plan, {}, manifest, out or Path(), {} if conditions else _expected(left_out, formulation))


def _require_series(series: Sequence[str], conditions: Sequence[str]) -> None:
    """Raise SpecError for a series without the clean pictures that its steps are compared with."""
    if series and not any(set(names) <= set(conditions) for names in (NEAR_FAR, ("real", *OTHERS))):
        raise SpecError(
            f"--series compares {' with '.join(NEAR_FAR)}, or real with {' and '.join(OTHERS)}: the run has none of "
            "these pairs; leave out --conditions, or name them"
        )


def open_models(specs: Sequence[str | RequestMode | OpenedModel]) -> tuple[dict[str, RequestMode], dict[str, Model]]:
    """Return the request mode and the opened model of each SPEC; raises SpecError for none."""
    held = {spec.mode.spec: spec.model for spec in specs if isinstance(spec, OpenedModel)}
    given = (spec.mode if isinstance(spec, OpenedModel) else spec for spec in specs)
    requested = {mode.spec: mode for mode in (RequestMode(one) if isinstance(one, str) else one for one in given)}
    models = {spec: held.get(spec) or open_model(spec, mode) for spec, mode in requested.items()}
    if not models:
        raise SpecError("a run needs at least one --model, see 'eyechart list models'")
    return requested, models


def open_whole(bank_path: Path) -> FrameBank:
    """Open a bank; raises BankError where a picture differs from the one in its manifest."""
    if problems := check(bank_path):
        raise BankError(
            f"the bank {bank_path} is damaged: {problems[0]} ({len(problems)} in all, 'eyechart frames check')"
        )
    return open_bank(bank_path)


def _prompt_for(bank: FrameBank, name: str | None, out: Path | None) -> Prompt:
    """Return the prompt of this name; without a name the prompt of the run in ``out``, if any."""
    if name is None and out is not None and is_run(out):
        return read_manifest(out).prompt
    imported = bank.manifest.simulator == IMPORTED
    if name is None and imported:
        return neutral(bank.manifest.picture, bank.manifest.action_space)
    return find_prompt(name or "baseline", "vertical" if imported else bank.frames[0].mirror_axis)


def _expected(left_out: Mapping[str, str], prompt: Prompt) -> dict[str, str]:
    """Return the left-out conditions that a user would look for."""
    return {
        name: why
        for name, why in left_out.items()
        if name in BATTERY or ("text" in CONDITIONS[name].needs and prompt.fields)
    }


def conditions_of(bank: FrameBank, prompt: Prompt) -> tuple[tuple[str, ...], dict[str, str]]:
    """Return the conditions that the bank can supply, and why it cannot supply the others."""
    left_out: dict[str, str] = {}
    for name in of_bank(bank):
        needs = CONDITIONS[name].needs
        if "text" in needs and not prompt.fields:
            left_out[name] = f"prompt '{prompt.name}' says nothing of a frame"
        elif not any(is_available(name, frame) for frame in bank):
            left_out[name] = "no frame has a mirror axis" if "axis" in needs else "no frame has its picture"
            left_out[name] = ONE_INSTANT if is_of_one_instant(name, bank) else left_out[name]
        else:
            try:
                require_partners((name,), bank)
            except BankError as error:
                left_out[name] = str(error)
    return tuple(name for name in of_bank(bank) if name not in left_out), left_out


def resume_manifest(out: Path, manifest: RunManifest, bank: FrameBank) -> RunManifest:
    """Return a run's manifest joined with that of the run in ``out``, if there is one.

    Pictures keep the encoding, and replies the reader, of the existing run; its bank may have
    grown. Raises LedgerError where ``out`` holds another run, or something else.
    """
    if is_run(out):
        before, bank_before = read_run(out)
        same = bank_before.manifest.images.items() <= bank.manifest.images.items()
        if not same and before.fingerprint == manifest.fingerprint:
            raise LedgerError(
                f"{out} was run on other pictures of the same geometry; choose another --out for this bank"
            )
        kept = before.reader if before.reader in manifest.prompt.readers else manifest.reader
        extended = before.extended(replace(manifest, encoding=before.encoding, reader=kept))
        if manifest.stop_early:
            _require_as_begun(before, manifest)
        return extended
    if not is_free(out) and not holds(out, bank):
        raise LedgerError(f"{out} exists and is no run; choose another place with --out")
    return manifest


def _require_as_begun(before: RunManifest, now: RunManifest) -> None:
    """Raise LedgerError where a run with early stop is resumed with other frames or conditions."""
    begun, given = ("all frames" if one.limit is None else f"--limit {one.limit}" for one in (before, now))
    if set(before.conditions) != set(now.conditions):
        begun, given = (f"--conditions {','.join(one.conditions)}" for one in (before, now))
    if before.controls != now.controls:
        begun, given = (f"--controls {one.controls}" for one in (before, now))
    if begun != given:
        raise LedgerError(
            f"this run was begun with {begun}, now {given} was given. An early stop depends on all calls of a run: "
            "give the same options to resume it, or another --out for another run"
        )


def plan_of(
    manifest: RunManifest,
    bank: FrameBank,
    *,
    models: Sequence[str] | None = None,
    conditions: Sequence[str] | None = None,
    limit: int | None = None,
    view: View | None = None,
) -> Plan:
    """Return the plan of a run's manifest, or of some of its models and conditions.

    ``view`` is the manifest's. A reader of the run needs no view: a version of eyechart that shows
    pictures differently can still score it.
    """
    whole = models is None
    chosen = tuple(bank.frame(name) for name in manifest.frames)
    found = Plan(
        study=manifest.study,
        bank=replace(bank, plain=manifest.encoding != AS_STORED, encoding=ENCODINGS[manifest.encoding]),
        prompt=manifest.prompt,
        models=tuple(manifest.models if models is None else models),
        conditions=tuple(conditions or manifest.conditions),
        frames=chosen or spread(bank.frames, manifest.limit if whole else limit),
        seed=manifest.seed,
        shard=manifest.shard,
        view=view,
    )
    if manifest.prompt.who == "model":
        return found
    given = {one.name: getattr(found, one.name) for one in fields(found)}
    return MotionPlan(**given, answers=manifest.answers)


def sample_of(planned: Iterable[Battery]) -> "Sample":
    """Return a few frames of batteries of one bank, with the prompt of each battery in turn.

    Pictures are shown through the view of the first battery, which also gives the form of an
    answer.
    """
    from eyechart.probe import Sample  # noqa: PLC0415 - a score probes no model

    held = list(planned)
    plan = held[0].plan
    questions = []
    for number, frame in enumerate(spread(plan.frames, max(_PICTURES, len(held)))):
        stimulus = through(plan.view, show("real", frame, plan.bank, plan.seed), frame.id)
        questions.append((held[number % len(held)].plan.prompt, stimulus))
    return Sample(questions, plan.space)


def expected(battery: Battery, prices: Prices, *, concurrency: int) -> tuple[CostEstimate, ...]:
    """Return the expected cost of the remaining calls, by model; with controls, at most."""
    more = battery.more_by_model()
    return tuple(
        estimate(
            battery.manifest.mode(spec), calls + more[spec], prices, concurrency=concurrency, at_most=bool(more[spec])
        )
        for spec, calls in battery.left_by_model().items()
    )


@contextmanager
def writing(out: Path, manifest: RunManifest, bank: FrameBank) -> Iterator[tuple[RunManifest, Ledger]]:
    """Hold a run on a bank while calls are added; yield its joined manifest and its ledger.

    Raises LedgerError where another process is writing to the same run, where the ledger cannot be
    written, or where it holds calls that the run does not plan.
    """
    with alone_in(out):
        # Again, because another process may have begun or extended this run before the lock.
        manifest = resume_manifest(out, manifest, bank)
        write_run(out, manifest, bank)
        with Ledger(out / LEDGER, create=True) as ledger:
            require_requests(ledger.path, ledger.columns(), manifest, plan_of(manifest, bank))
            yield manifest, ledger


def run(
    battery: Battery, *, again: bool = False, sequential: bool | None = None, **how: Unpack[RunOptions]
) -> RunOutcome:
    """Make the calls of a planned battery that its ledger lacks, and return how the run ended.

    With ``again``, calls that failed in transport are made once more first. ``sequential`` says
    whether models run one after another, each closed before the next; by default local models do.
    Raises LedgerError where another process is writing to the same run, or the ledger cannot be
    written.
    """
    turns = sequential_groups(map(battery.manifest.mode, battery.plan.models), sequential=sequential)
    battery = replace(battery, plan=replace(battery.plan, turns=turns))
    with writing(battery.out, battery.manifest, battery.plan.bank) as (manifest, ledger):
        if again and (first := ask_again(battery.plan, battery.models, ledger, **how)).stopped is not None:
            return first
        plan, stages = battery.stages(manifest, ledger)
        return execute(plan, battery.models, ledger, stages, **how)


def merge(shards: Sequence[Path], out: Path) -> int:
    """Merge shards of one run into a new run at ``out``; return its number of calls.

    Shards may be unfinished: the merged run is resumed as a whole. Raises LedgerError, and leaves
    nothing at ``out``, where they are not parts of one run or hold the same finished call twice.
    """
    if not shards:
        raise LedgerError("merge needs the folders of one or more shards")
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise LedgerError(f"{out} exists and is not empty; choose another --out for the merged run")
    manifest, bank = _whole(shards)
    calls = 0
    with whole_folder(out, LedgerError) as work:
        write_run(work, manifest, bank)
        with Ledger(work / LEDGER, create=True) as merged:
            for shard in shards:
                with Ledger(shard / LEDGER) as ledger:
                    calls += merged.absorb(ledger)
    return calls


def with_fresh_controls(
    frames: Path,
    out: Path,
    shard: str | None,
    *,
    dry_run: bool,
    tell: Callable[[str], None],
    bar: Bar,
) -> Path:
    """Return the bank of a run with its own controls, which is made once in the run's folder.

    Raises SpecError for a shard, and LedgerError if ``out`` holds another run.
    """
    from eyechart.simulators.banks import MOST_SEED, redraw  # noqa: PLC0415 - few runs draw pictures

    if shard is not None:
        raise SpecError(
            "--fresh-controls needs one run, because shards share their pictures: leave out --shard, or build "
            "one bank for all of them with 'eyechart frames build SIMULATOR --controls-seed N --out BANK'"
        )
    own = out / BANK
    if not is_free(out):
        bank = open_bank(frames)
        has_own = (own / bank.frames[0].file).is_file()
        if not has_own or open_bank(own).manifest.fingerprint != bank.manifest.fingerprint:
            begun = "a run that was started without --fresh-controls, or on another bank" if is_run(out) else "no run"
            raise LedgerError(f"{out} holds {begun}; choose another --out")
        return own
    if dry_run:
        tell("controls: their distances will be drawn anew, into the run's folder")
        return frames
    with bar("controls", "frames") as move:
        seed = redraw(frames, own, randbelow(MOST_SEED), move).manifest.controls.seed
    (own / OWN).touch()
    tell(f"controls: drawn anew into {own} with seed {seed}")
    return own


def begun(out: Path) -> Battery:
    """Return the battery at ``out`` without models, to count its remaining calls."""
    manifest, bank = read_run(out)
    return Battery(plan_of(manifest, bank), {}, manifest, out)


def _whole(shards: Sequence[Path]) -> tuple[RunManifest, FrameBank]:
    """Return the manifest and the bank of the run that the shards belong to."""
    read = [read_run(shard) for shard in shards]
    manifests, bank = [manifest for manifest, _ in read], read[0][1]
    whole = replace(manifests[0], shard=None)
    for shard, (manifest, its_bank) in zip(shards, read, strict=True):
        made, own = (one.manifest.made for one in (bank, its_bank))
        if made and own and made != own:
            raise LedgerError(
                f"the control pictures are {own} by the run in {shard}, and {made} by that in {shards[0]}: say which "
                "with 'eyechart frames declare' and all of these folders"
            )
        bank = bank if made else its_bank
        if its_bank.manifest.images != read[0][1].manifest.images and manifest.fingerprint == whole.fingerprint:
            raise LedgerError(f"{shard} is no part of the run in {shards[0]}: it was run on other pictures")
        with raising(LedgerError, f"{shard} is no part of the run in {shards[0]}", of=LedgerError):
            whole = whole.extended(replace(manifest, shard=None))
    return replace(whole, created=min(manifest.created for manifest in manifests)), bank
