"""A look at a policy: test it on a few frames, then ask it with each channel exchanged."""

import shlex
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from tempfile import TemporaryDirectory

from eyechart.channels import CAMERAS, InputShapes
from eyechart.costs import assumed, estimate
from eyechart.errors import SourceError, raising
from eyechart.formats import format_of_data_set
from eyechart.frames import open_bank
from eyechart.importing.bank import Choices
from eyechart.importing.lerobot import Horizon
from eyechart.ledger import Ledger
from eyechart.limits import RunOutcome, Usage
from eyechart.looks.answer import Look, NextStep, PictureResult
from eyechart.looks.pictures import LONG_WAY
from eyechart.looks.reach import affordable
from eyechart.looks.request import Bill, LookRequest, Watch, failed, write_report
from eyechart.looks.sight_checks import MOST_CALLS as OF_SIGHT
from eyechart.looks.sight_checks import SightChecks, SightFailure, unseen
from eyechart.manifest import LEDGER, is_run, read_manifest
from eyechart.models import OpenedModel, history_of, open_policy, states
from eyechart.models.prices import read_prices
from eyechart.modes import RequestMode
from eyechart.planned_run import RunAllowance
from eyechart.probe.policies import MOST_CALLS, PolicyDiagnosis, examine_policy
from eyechart.prompts import stated_steps
from eyechart.run import spread
from eyechart.spaces.motion import Motion
from eyechart.studies import policy
from eyechart.studies.policy import PolicyScore, PolicySelection
from eyechart.studies.policy.advice import settling
from eyechart.studies.policy.plans import PolicyRun
from eyechart.studies.policy.scores import judge
from eyechart.verdicts.labels import CAMERA
from eyechart.verdicts.policy_verdict import MISFIT, PolicyVerdict
from eyechart.verdicts.share_predicates import IGNORED

_SELDOM = 1_000_000
"""For a trial, one frame is taken per this many frames of an episode: its first one."""
MOTION_AXES = 2
AT_ONCE = 8
"""Concurrent calls of a model that answers in words; other policies are called one at a time."""

SHOWN = {
    f"T.swapped@{CAMERAS}": "another episode's pictures",
    "T.blank": "grey pictures",
    f"T.matched@{CAMERAS}": "others at a similar state",
}
"""The three pictures, by the statistic of how much a motion changes with them."""


def steps_of(wanted: LookRequest) -> int:
    """Return the number of steps in a policy's motions, from one answer; 1 for drawn banks.

    A policy that does not answer with an array counts as one step; the doctor reports it later.
    """
    if wanted.pictures.dataset is None:
        return 1
    if states(wanted.spec):
        return stated_steps(wanted.prompt)
    if (before := wanted.pictures.made_with(wanted.out)) is not None:
        return before
    held = wanted.held or open_policy(wanted.spec)
    if (shapes := InputShapes.of(held.model.facts)) is not None:
        return shapes.steps
    with TemporaryDirectory() as trial:
        bank, run = Path(trial) / "bank", Path(trial) / "run"
        few = Choices(every=_SELDOM, history=history_of(held.model.facts))
        a_few = {"choices": few, "ahead": Horizon(1, "delta", rotations=None)}
        folder = wanted.pictures.dataset
        with raising(SourceError, f"{folder}", LONG_WAY, of=SourceError):
            format_of_data_set(folder).importer()(folder, out=bank, **a_few)
        policy.run(policy.plan(bank, [held], run, extent=PolicySelection(1), conditions=("real",)))
        with Ledger(run / LEDGER) as ledger:
            ((_, reply),) = ledger.replies(wanted.spec)
    try:
        shape = Motion.read(reply.text).shape
    except ValueError:
        return 1
    return shape[0] if len(shape) == MOTION_AXES else 1


@dataclass(frozen=True)
class PolicyLook:
    """A look at one policy on a bank of motions; see `look`."""

    wanted: LookRequest
    bank: Path
    watch: Watch

    def look(self) -> Look:
        """Test the policy, ask it, and return the answer; a served model is first shown to see."""
        wanted, known = self.wanted, self._known()
        planned = self._sized()
        calls, finished, _ = planned.counts()
        begun = is_run(wanted.run)
        self._agree(planned, calls - finished, OF_SIGHT + MOST_CALLS if known is None else MOST_CALLS * (not begun))
        if known is None:
            found = self._sights.find(wanted.mode, planned.sample())
            if isinstance(found, SightFailure):
                return unseen(wanted, found)
            return replace(self, wanted=replace(wanted, mode=found, held=open_policy(found))).look()
        if not begun and (amiss := self._amiss()) is not None:
            return amiss
        before = Usage(calls=self._probed_in)
        at_once = AT_ONCE if states(wanted.spec) else 1
        allowed = RunAllowance(
            read_prices(), max_calls=wanted.budget, concurrency=at_once, before=before, again=wanted.again
        )
        outcome = planned.make(allowed, self.watch.bar)
        return self._answered(planned, outcome, has_new_calls=planned.counts()[1] > finished)

    def _known(self) -> RequestMode | None:
        """Return the mode that the policy is asked in; None if it must be found first."""
        wanted = self.wanted
        if wanted.held is not None:
            return wanted.held.mode
        return wanted.mode if wanted.by_file else self._sights.known(wanted.mode)

    @cached_property
    def _sights(self) -> SightChecks:
        return SightChecks(self.wanted.out, read_prices(), self.watch.bar)

    @cached_property
    def _opened(self) -> OpenedModel:
        return self.wanted.held or open_policy(self._known() or self.wanted.mode)

    @property
    def _probed_in(self) -> int:
        """Return the number of calls that found the request mode."""
        found = self._opened.mode.measured
        return 0 if found is None else found.calls or 0

    def _agree(self, planned: PolicyRun, left: int, more: int) -> None:
        """Get consent to the most that will be paid, with ``more`` calls before the run."""
        mode, basis = assumed(self._opened.mode)
        spec = self.wanted.spec
        drawn = planned.more_by_model()[spec] if left else 0  # a finished run has found whether it draws
        usual = left + more + (failed(self.wanted) if self.wanted.again else 0)
        expected = estimate(mode, usual + drawn, read_prices(), concurrency=1)
        self.watch.agree(
            Bill(self._opened.mode, expected, basis, usual if drawn else None, "if it repeats its answers")
        )

    def _sized(self) -> PolicyRun:
        """Return the plan on all frames, or on as many as the budget allows a sampling policy."""
        wanted = self.wanted
        limit = read_manifest(wanted.run).limit if is_run(wanted.run) else None
        planned = self._plan(limit)
        frames = len(planned.plan.bank.frames)
        if is_run(wanted.run):
            self.watch.say(*wanted.begun(len(planned.plan.frames), frames))
        if is_run(wanted.run) or wanted.budget is None:
            return planned
        before = MOST_CALLS + (OF_SIGHT if self._known() is None else self._probed_in)
        some = affordable(frames, partial(_most, planned), wanted.budget - before)
        if some == frames:
            return planned
        self.watch.say(
            f"asked about {some} of {frames} frames: fewer episodes give wider intervals, and may leave it undecided"
        )
        return self._plan(some)

    def _plan(self, limit: int | None) -> PolicyRun:
        wanted = self.wanted
        extent = PolicySelection(limit)
        return policy.plan(self.bank, [self._opened], wanted.run, seed=wanted.seed, extent=extent, prompt=wanted.prompt)

    def _amiss(self) -> Look | None:
        """Return an early answer if no motion comes back; print every other fault."""
        with self.watch.bar("doctor", "calls") as move:
            bank, prompt = open_bank(self.bank), self.wanted.prompt
            diagnosis = examine_policy(self._opened, bank, prompt=prompt, tell=lambda at: move(at, MOST_CALLS))
        wrong = [finding for finding in diagnosis.findings if finding.fine is False]
        self.watch.say(*(f"wrong: {finding.name}: {finding.says}" for finding in wrong))
        without = next((finding for finding in wrong if finding.name == "motions"), None)
        return None if without is None else self._unasked(diagnosis, without.says)

    def doctor(self) -> str:
        """Return the command that tests the policy on the bank."""
        wanted = self.wanted
        address = "" if wanted.file is not None else wanted.mode.base_url
        given = {"--base-url": address, "--frames": str(self.bank), "--prompt": wanted.prompt}
        words = [word for option, value in given.items() if value for word in (option, value)]
        return shlex.join(["eyechart", "doctor", str(wanted.file or wanted.spec), *words])

    def _unasked(self, found: PolicyDiagnosis, why: str) -> Look:
        wanted = self.wanted
        steps = (NextStep("see every check", self.doctor()), NextStep("look again after the repair", wanted.command()))
        because = f"It does not answer as a policy on this bank: {why}."
        return Look(wanted.spec, "Inconclusive", because, label="unseen", next=steps, calls=found.calls)

    def _answered(self, planned: PolicyRun, outcome: RunOutcome, *, has_new_calls: bool) -> Look:
        wanted, spec = self.wanted, self.wanted.spec
        scored = policy.score(wanted.run)
        verdict = judge(scored)[spec]
        calls, finished, _ = planned.counts()
        stopped = outcome.stopped or outcome.set_aside.get(spec, "")
        because = _because(verdict)
        if calls > finished:
            because = f"The run is not finished: {stopped or f'{finished} of {calls} calls'}."
        answer = "Inconclusive" if verdict.guards or calls > finished else verdict.answer
        write_report(wanted, self.bank, self.watch, has_new_calls=has_new_calls)
        return Look(
            spec,
            answer,
            because,
            tuple(_holes(verdict)),
            verdict.camera.label,
            tuple(_pictures(scored, spec)),
            f"a mean of {len(planned.plan.frames)} frames",
            tuple(_steps(self, scored, answer, verdict, left=calls > finished)),
            wanted.report,
            wanted.run,
            finished,
        )


def _most(planned: PolicyRun, frames: int) -> int:
    """Return the number of calls on ``frames`` frames for a policy that samples its answers."""
    some = spread(planned.plan.bank.frames, frames)
    plan = replace(planned.plan, frames=some, drawn=frozenset(planned.plan.models))
    return sum(1 for _ in plan.keys_of(planned.plan.models[0]))


def _because(verdict: PolicyVerdict) -> str:
    """Return in words what decided or which guard failed, with a warning of a large error."""
    if verdict.guards:
        return verdict.because
    said = f"{CAMERA[verdict.camera.label].says} {verdict.camera.because}"
    if verdict.misfit is not None and verdict.misfit >= MISFIT:
        error = f"its error is {verdict.misfit:.1f} times the log's variance"
        said += f" But {error}: it does something else than was logged."
    return said


def _holes(verdict: PolicyVerdict) -> Iterator[str]:
    """Yield the cameras that do not matter although others do."""
    if not verdict.guards and verdict.answer in {"Yes", "In part"}:
        ignored = [name for name, camera in verdict.cameras.items() if camera.label == "ignores_camera"]
        changes = f"another episode's pictures change less than {IGNORED} of the motion's variation"
        yield from (f"Not by the {name} camera: {changes}." for name in ignored)


def _pictures(scored: PolicyScore, spec: str) -> Iterator[PictureResult]:
    statistics = scored.models[spec].statistics
    for name, words in SHOWN.items():
        if (one := statistics.get(name)) is not None:
            yield PictureResult(words, change=one.value, ci=one.ci, n=one.n, why=one.note or "not asked")


def _steps(
    look: PolicyLook, scored: PolicyScore, answer: str, verdict: PolicyVerdict, *, left: bool
) -> Iterator[NextStep]:
    wanted, run = look.wanted, shlex.quote(str(look.wanted.run))
    if left:
        yield from wanted.continued()
        return
    if failed(wanted):
        yield NextStep("ask the failed calls again", wanted.command(again=True))
    if answer == "Yes":
        yield NextStep("keep it so in CI: exit 0 as long as it looks", f"eyechart gate {run} --require looks")
    elif verdict.guards:
        yield NextStep("see why it cannot be judged, and repair it", look.doctor())
    elif CAMERA[verdict.camera.label].may_be_more:
        settle = settling(scored, wanted.spec, CAMERAS)
        if settle.is_of_the_road:
            yield NextStep("to settle it: does its picture reach it?", look.doctor())
        else:
            yield NextStep(f"to settle it: {settle.do}", f"eyechart plan {shlex.quote(str(look.bank))}")
    else:
        yield NextStep("see whether its pictures reach it", look.doctor())
    yield NextStep("what it does with its state and its instruction", f"eyechart verdict {run}")
