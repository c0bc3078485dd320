"""Planning and running: every frame under every condition, with repeats for policies that draw."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Unpack

import numpy as np

from eyechart.calls import UNFINISHED, CallKey, Reply
from eyechart.channels import INSTRUCTION, STATE, TOLD, channels_of, require_history, require_inputs
from eyechart.conditions import FROZEN, NO_HISTORY, OVER, PARTNERS, find_condition, require_corruptible, show
from eyechart.conditions.policies import conditions_of, further_conditions, subset_conditions
from eyechart.costs import CostEstimate
from eyechart.errors import BankError, SpecError, did_you_mean, printable
from eyechart.event_loops import make_calls
from eyechart.frames import FrameBank
from eyechart.importing.log_warnings import notes
from eyechart.ledger import Ledger
from eyechart.limits import RunOutcome
from eyechart.manifest import LEDGER, RunManifest, asked_of, is_run, read_manifest
from eyechart.models import OpenedModel, history_of, open_policy, states
from eyechart.modes import RequestMode
from eyechart.planned_run import RunAllowance, RunEnding, calls_ended, empty, forecast
from eyechart.prompts import Prompt, motion_prompt, require_pictured, says
from eyechart.run import MotionPlan, RunOptions, Stages, in_order, spread
from eyechart.spaces.motion import MOTION_READER, Motion, MotionSpace, require_motions
from eyechart.stats.total_effect import rounding_tolerance
from eyechart.studies.battery import Battery, expected, open_whole, plan_of, resume_manifest
from eyechart.studies.battery import run as run_battery

STUDY = "policy"
ANSWERS = 4
"""Answers to each call of a policy that draws its answers, by default."""
LEAST_EPISODES = 3


@dataclass(frozen=True, slots=True)
class PolicySelection:
    """The size of a run: frames, one ``shard`` of the calls (i, n), answers of a policy that draws.

    With ``shapley`` the run has every subset of the channels, whatever conditions are named.
    """

    limit: int | None = None
    shard: tuple[int, int] | None = None
    answers: int = ANSWERS
    shapley: bool = False


WHOLE = PolicySelection()


@dataclass(frozen=True)
class PolicyRun(Battery):
    """A planned run of policies: a battery whose conditions change channels.

    Its number of calls depends on which policies draw, as far as that is known. ``of_shapley``
    counts the calls that only Shapley shares need.
    """

    plan: MotionPlan
    of_shapley: int = 0

    def staged(self, ledger: Ledger) -> MotionPlan:
        """Return the plan with the policies that draw, as far as the ledger's answers show."""
        return replace(self.plan, drawn=drawers(ledger, self.manifest) & set(self.plan.models))

    def stages(self, manifest: RunManifest, ledger: Ledger) -> tuple[MotionPlan, Stages]:
        """Return the calls of now, and a stage that repeats calls once answers turn out drawn."""
        begun = replace(self, manifest=manifest).staged(ledger)
        return begun, _RepeatStages(begun, manifest, ledger)

    def lines(self, how: RunAllowance) -> Iterator[str]:
        """Yield the conditions left out, each with its reason, and the number of calls."""
        calls, finished, _ = self.counts()
        size = self._counted("policy", str(calls - finished))
        yield from (*self._left_out(), *notes(self.plan.bank))
        yield f"{size}; a policy that draws its answers gets each call {self.plan.answers} times"
        if any(map(states, self.plan.models)):
            yield from forecast(self.manifest, self.plan.models, self._expected(how), how)
        if self.of_shapley:
            yield f"of these, {self.of_shapley} calls are for Shapley shares alone; more if a policy draws its answers"

    def more_by_model(self) -> dict[str, int]:
        """Return the calls that follow for each policy if it turns out to draw its answers."""
        drawn = replace(self.plan, drawn=frozenset(self.plan.models))
        with self._ledger as ledger:
            now = self.staged(ledger)
        return {spec: sum(1 for _ in drawn.keys_of(spec)) - sum(1 for _ in now.keys_of(spec)) for spec in now.models}

    def _expected(self, how: RunAllowance) -> tuple[CostEstimate, ...]:
        return expected(self, how.prices, concurrency=how.concurrency)

    def ends(self, outcome: RunOutcome, failed: Mapping[str, str]) -> Iterator[RunEnding]:
        """Yield the policies without any motion, and how the calls ended."""
        nothing, (calls, finished, _) = self.motionless(), self.counts()
        for spec, (count, why) in nothing.items():
            last = "" if spec in outcome.set_aside else f", the last one ended with {why}"
            yield RunEnding([f"nothing can be judged: {spec}: of {count} finished calls none holds a motion{last}"])
        yield calls_ended(outcome, failed, calls - finished, nothing=bool(nothing))
        if any(map(states, self.plan.models)):
            yield empty([self.out])

    def motionless(self) -> dict[str, tuple[int, str]]:
        """Return the policies without any motion: their finished calls, and the last fault."""
        with Ledger(self.out / LEDGER, absent=True) as ledger:
            found = {spec: self._without(ledger, spec) for spec in self.plan.models}
        return {spec: one for spec, one in found.items() if one[0]}

    def _without(self, ledger: Ledger, spec: str) -> tuple[int, str]:
        """Return a policy's finished calls if none holds a motion, and the last fault."""
        count, why = 0, ""
        for _, reply in ledger.replies(spec):
            if reply.error in UNFINISHED:
                continue
            if self.plan.motions.read(reply).action is not None:
                return 0, ""
            count += 1
            why = f"{reply.error}: {printable(reply.error_detail)}" if reply.error else self.plan.lacks(reply)
        return count, why


def plan(
    bank_path: Path,
    specs: Sequence[str | RequestMode | OpenedModel],
    out: Path,
    *,
    seed: int = 0,
    extent: PolicySelection = WHOLE,
    conditions: Sequence[str] | None = None,
    timeout_s: float | None = None,
    prompt: str | None = None,
) -> PolicyRun:
    """Plan a run of policies on a bank, or the rest of the run in ``out``; write and call nothing.

    ``conditions`` default to all that the bank can show. ``prompt`` is a TOML file for models that
    state their motions in words; it defaults to that of the run in ``out``, or to a plain one.

    Raises BankError for a bank without motions, with fewer than three episodes, or with a changed
    picture. Raises SpecError for an unknown policy, channel or condition, for a prompt that does
    not ask for the bank's motions, and LedgerError if ``out`` holds another run.
    """
    if extent.answers < 2:
        raise SpecError(f"--answers takes 2 or more, got {extent.answers}: one answer cannot show a policy's noise")
    opened = {one.mode.spec: one for one in (open_policy(each, timeout_s) for each in specs)}
    if not opened:
        raise SpecError("a run needs at least one --policy, see 'eyechart list policies'")
    models = {spec: one.model for spec, one in opened.items()}
    bank = open_whole(bank_path)
    _require_asked(bank)
    for spec, model in models.items():
        require_inputs(spec, model.facts, bank)
        require_history(spec, history_of(model.facts), bank)
    formulation = _prompt_for(bank, opened, prompt, out)
    supplied, left_out = shown_conditions(bank, formulation)
    names = _conditions_asked(bank, formulation, conditions or supplied, shapley=extent.shapley)
    require_corruptible(names, bank)
    bank = asked_of(bank, formulation)
    require_pictured(formulation, show("real", bank.frames[0], bank, seed))
    manifest = RunManifest.begun(
        bank,
        {spec: one.mode for spec, one in opened.items()},
        {spec: (model.version, model.facts) for spec, model in models.items()},
        study=STUDY,
        seed=seed,
        prompt=formulation,
        conditions=names,
        limit=extent.limit,
        shard=extent.shard,
        reader=MOTION_READER,
        answers=extent.answers,
    )
    manifest = resume_manifest(out, manifest, bank)
    frames = spread(bank.frames, extent.limit)
    calls = replace(motions_of(manifest, bank), models=tuple(models), conditions=names, frames=frames)
    usual = set(conditions or supplied)
    added = sum(key.condition not in usual for key in calls.keys())  # noqa: SIM118 - a method of plans
    return PolicyRun(calls, models, manifest, out, {} if conditions else left_out, added)


def _prompt_for(bank: FrameBank, specs: Collection[str], file: str | None, out: Path) -> Prompt:
    """Return the prompt of a run; without a file that of the run in ``out``, if there is one."""
    in_words = [spec for spec in specs if states(spec)]
    if in_words and len(in_words) < len(specs):
        raise SpecError(
            f"{', '.join(in_words)} states numbers in words, and the other policies return arrays. They are not asked "
            "alike, so run them in two folders; 'eyechart report ONE OTHER --out page.html' shows both"
        )
    if in_words and file is None and is_run(out):
        return read_manifest(out).prompt
    return motion_prompt(bank, file, in_words=bool(in_words))


def shown_conditions(
    bank: FrameBank, prompt: Prompt, *, reading: bool = True
) -> tuple[tuple[str, ...], dict[str, str]]:
    """Return the conditions of a run with a prompt, and why others are left out, as `conditions_of`.

    A channel that the prompt does not say is not exchanged: no answer could change with it.
    """
    supplied, left_out = conditions_of(bank, reading=reading)
    unsaid = {
        name: f"prompt '{prompt.name}' does not say the {channel}"
        for name in supplied
        if (channel := exchanged_text(name)) and channel not in says(prompt, bank)
    }
    return tuple(name for name in supplied if name not in unsaid), {**left_out, **unsaid}


def exchanged_text(condition: str) -> str:
    """Return the channel in words that a condition exchanges: the state, the instruction or ""."""
    base, _, channel = condition.partition(OVER)
    if base in PARTNERS and channel in {STATE, INSTRUCTION}:
        return channel
    return INSTRUCTION if base.startswith(TOLD) else ""


def _conditions_asked(bank: FrameBank, prompt: Prompt, named: Sequence[str], *, shapley: bool) -> tuple[str, ...]:
    """Return the conditions of a run; SpecError or BankError for one that is impossible here."""
    supplied, left_out = shown_conditions(bank, prompt)
    every, further = subset_conditions(bank), further_conditions(bank)
    if shapley and not every:
        raise BankError(f"the bank {bank.root} has no channel but its cameras; --shapley needs several")
    names = dict.fromkeys([*named, *(every.values() if shapley else ())])
    for name in names:
        find_condition(name, "policy")
        if name not in {*supplied, *further} and not (name in every.values() and name not in left_out):
            raise BankError(f"condition '{name}' cannot be shown: {left_out.get(name) or _unknown(name, bank)}")
    return tuple(names)


def _unknown(name: str, bank: FrameBank) -> str:
    """Say which channel or camera of a condition the bank lacks, and which it has."""
    base, over, channel = name.partition(OVER)
    cameras = [camera.name for camera in bank.frames[0].cameras]
    if base == FROZEN and not bank.manifest.history:
        return NO_HISTORY
    if not over or (base not in PARTNERS and channel in cameras):
        return "the bank has no such pictures"
    what, known = ("channel", [*channels_of(bank)]) if base in PARTNERS else ("camera", cameras)
    return f"the bank has no {what} '{channel}';{did_you_mean(channel, known)} there are {', '.join(known)}"


def _require_asked(bank: FrameBank) -> None:
    """Raise BankError if a bank has no definition of a motion, or too few episodes."""
    if bank.manifest.motion is None:
        raise BankError(
            f"the bank {bank.root} does not say what a motion is; 'frames build tabletop' makes a bank that does"
        )
    episodes = {frame.drive for frame in bank}
    if len(episodes) < LEAST_EPISODES or "episode" in bank.manifest.absent:
        raise BankError(
            f"the bank {bank.root} has {len(episodes)} episodes; a run exchanges channels between episodes and "
            f"needs {LEAST_EPISODES} or more"
        )


def motions_of(manifest: RunManifest, bank: FrameBank) -> MotionPlan:
    """Return the plan of a run's manifest, before any policy is known to draw."""
    found = plan_of(manifest, bank)
    assert isinstance(found, MotionPlan)
    return replace(found, seeded=frozenset(spec for spec in manifest.models if is_seeded(manifest, spec)))


def drawers(ledger: Ledger, manifest: RunManifest) -> frozenset[str]:
    """Return the policies that draw: two answers to one moment differ (if seeded, to one seed).

    The difference must exceed rounding. A policy that sums in parallel differs in the last bits,
    and repeated calls for those would cost much and show nothing.
    """
    space = require_motions(manifest.prompt.space)
    return frozenset(
        spec for spec in manifest.models if _draws(ledger.replies(spec), space, again=int(is_seeded(manifest, spec)))
    )


def is_seeded(manifest: RunManifest, spec: str) -> bool:
    """Return whether a seed fixes a policy's answers, as it declares."""
    return manifest.facts.get(spec, {}).get("seedable") == "true"


def _draws(replies: Iterator[tuple[CallKey, Reply]], space: MotionSpace, *, again: int) -> bool:
    """Return whether two motions differ by more than rounding; other replies are ignored."""
    first: dict[str, Motion] = {}
    apart = []
    for key, reply in replies:
        if (key.condition, key.repeat) in {("real", 0), ("real_repeat", again)}:
            motion = space.read(reply).action
            if motion is not None and motion != (before := first.setdefault(key.frame, motion)):
                apart.append((space.relative(before.array, None), space.relative(motion.array, None)))
    if not apart:
        return False
    near = rounding_tolerance(np.stack([space.relative(one.array, None) for one in first.values()]))
    return any(bool((np.abs(one - other) > near).any()) for one, other in apart)


class _RepeatStages(Stages):
    """Repeats the calls of a policy after its first pass, if its answers turned out to be drawn."""

    def __init__(self, planned: MotionPlan, manifest: RunManifest, ledger: Ledger) -> None:
        self._plan, self._manifest, self._ledger = planned, manifest, ledger
        self._repeated = set(planned.drawn)

    def more(self, model: str) -> Sequence[CallKey]:
        """Return the repeats of every call of a policy that draws its answers."""
        if model in self._repeated or model not in drawers(self._ledger, self._manifest):
            return ()
        self._repeated.add(model)
        done = self._ledger.finished()
        again = replace(self._plan, drawn=frozenset({model})).keys_of(model)
        return in_order((key for key in again if key not in done), self._plan.seed)


def run(planned: PolicyRun, *, again: bool = False, **how: Unpack[RunOptions]) -> RunOutcome:
    """Make the calls that the run's ledger lacks, one at a time a policy, and return the outcome.

    With ``again``, calls that failed in transport are repeated first.

    Inside a running event loop, as in a notebook, the calls run in a thread with a loop of its own.
    Raises LedgerError if another process writes to the run, or the ledger cannot be written.
    """
    progress = how.pop("progress", None)
    options: RunOptions = {"concurrency": 1, **how}
    return make_calls(partial(run_battery, planned, again=again, **options), progress)
