"""A look at a model: find its request mode, then ask it until its verdict is settled."""

import shlex
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from eyechart.costs import assumed, estimate
from eyechart.errors import printable
from eyechart.frames import IMPORTED, FrameBank
from eyechart.ledger import Ledger
from eyechart.limits import RunOutcome, Usage
from eyechart.looks.answer import Look, NextStep, PictureResult
from eyechart.looks.pictures import BANK
from eyechart.looks.reach import SMALL, affordable, fewest
from eyechart.looks.request import MODE, Bill, LookRequest, Watch, failed, write_report
from eyechart.looks.sight_checks import MOST_CALLS, SightChecks, SightFailure, doctor_command, unseen
from eyechart.manifest import LEDGER, is_run, read_manifest
from eyechart.models.prices import Prices, read_prices
from eyechart.modes import RequestMode
from eyechart.planned_run import RunAllowance
from eyechart.run import spread
from eyechart.studies import battery
from eyechart.studies.battery import Battery, BatterySelection
from eyechart.studies.battery.answers import Answers
from eyechart.studies.battery.stages import widest
from eyechart.verdicts import Evidence, Verdict, judge_one
from eyechart.verdicts.why_not import PHOTOGRAPHED, WhyNot

AT_ONCE = 8
SHOWN: tuple[Mapping[str, str], ...] = (
    {"real": "the real picture"},
    {"blank": "a blank picture", "noise": "noise", "text_only": "no picture"},
    {
        "lead_near": "the same moment, the lead near",
        "lane_own": "the same moment, a near lead",
        "shuffled": "a picture of another moment",
        "cross_scenario": "a picture of another scenario",
        "mirrored": "the same picture, reflected",
    },
)
"""The three pictures; each is the first of these conditions that was run."""


@dataclass(frozen=True)
class ModelLook:
    """A look at one model on a bank; see `look`."""

    wanted: LookRequest
    bank: Path
    watch: Watch

    def look(self) -> Look:
        """Find the request mode, ask the model, and return the answer."""
        wanted = self.wanted
        known = wanted.mode if wanted.by_file or wanted.held is not None else self._sights.known(wanted.mode)
        planned = self._sized(known)
        self._agree(planned, 0 if known is not None else MOST_CALLS)
        if known is None:
            found = self._sights.find(wanted.mode, planned.sample())
            if isinstance(found, SightFailure):
                return unseen(wanted, found)
            self.watch.say(f"{_sight(found)}; it is asked as {wanted.out / MODE} says")
            planned = self._plan(found, planned.manifest.limit)
            self._agree(planned, 0)
        before = planned.counts()[1]
        outcome = self._made(planned)
        mode = planned.manifest.mode(wanted.spec)
        return self._answered(outcome, mode, has_new_calls=planned.counts()[1] > before)

    @cached_property
    def _prices(self) -> Prices:
        return read_prices()

    @cached_property
    def _sights(self) -> SightChecks:
        return SightChecks(self.wanted.out, self._prices, self.watch.bar)

    def _plan(self, mode: RequestMode, limit: int | None) -> Battery:
        wanted, extent = self.wanted, BatterySelection(limit, stop_early=True)
        modes = [wanted.held or mode]
        return battery.plan(self.bank, modes, wanted.run, prompt=wanted.prompt, seed=wanted.seed, extent=extent)

    def _sized(self, known: RequestMode | None) -> Battery:
        """Return the plan on the fewest frames that can give every answer, or as the budget allows.

        A run that exists keeps its own frames.
        """
        wanted, mode = self.wanted, known or self.wanted.mode
        if is_run(wanted.run):
            planned = self._plan(mode, read_manifest(wanted.run).limit)
            self.watch.say(*wanted.begun(len(planned.plan.frames), min(SMALL, len(planned.plan.bank))))
            return planned
        planned = self._plan(mode, None)
        bank = planned.plan.bank
        most = len(bank)
        if wanted.budget is not None:
            room = wanted.budget - (MOST_CALLS + self._sights.spent.calls if known is None else _asked_before(mode))
            most = affordable(most, partial(_most, planned), room)
        reach = fewest(bank, most)
        self.watch.say(*reach.lines())
        return planned if reach.frames == len(bank) else self._plan(mode, reach.frames)

    def _agree(self, planned: Battery, more: int) -> None:
        """Get consent to the most that will be paid, with ``more`` calls for the request mode."""
        spec = self.wanted.spec
        settled = planned.progress()[spec].stopped is not None
        left = 0 if settled else planned.left() + planned.more_by_model()[spec]
        left += failed(self.wanted) if self.wanted.again else 0
        examples = sum(len(message.pictures) for message in planned.plan.prompt.messages)
        mode, basis = assumed(planned.manifest.mode(spec), examples)
        expected = estimate(mode, left + more, self._prices, concurrency=AT_ONCE, at_most=True)
        usual = None if planned.counts()[1] else planned.typical().get("image_invariant")
        self.watch.agree(Bill(mode, expected, basis, usual))

    def _made(self, planned: Battery) -> RunOutcome:
        before = Usage(calls=_asked_before(planned.manifest.mode(self.wanted.spec)))
        allowed = RunAllowance(self._prices, max_calls=self.wanted.budget, before=before, again=self.wanted.again)
        return planned.make(allowed, self.watch.bar)

    def _answered(self, outcome: RunOutcome, mode: RequestMode, *, has_new_calls: bool) -> Look:
        """Return the answer of the run, and write its page."""
        wanted = self.wanted
        scored = battery.score(wanted.run)
        evidence = scored.evidence()[wanted.spec]
        verdict = judge_one(evidence)
        stopped = outcome.stopped or outcome.set_aside.get(wanted.spec, "")
        whole = verdict.unfinished is None
        because = _because(verdict) if whole else f"The run is not finished: {stopped or verdict.progress}."
        pictures, among = _pictures(scored.models[wanted.spec].answers)
        write_report(wanted, self.bank, self.watch, has_new_calls=has_new_calls)
        return Look(
            wanted.spec,
            verdict.answer if whole else "Inconclusive",
            because,
            (*_holes(verdict), *_unseen(verdict, mode), *_failed(wanted, evidence)),
            verdict.calibrated.label,
            pictures,
            among,
            tuple(self._steps(verdict, mode, scored.bank, whole=whole, failing=bool(evidence.reasons().get("error")))),
            wanted.report,
            wanted.run,
            scored.models[wanted.spec].answered,
            "" if verdict.stopped is None else f"{verdict.stopped.words().capitalize()}.",
        )

    def _steps(
        self, verdict: Verdict, mode: RequestMode, bank: FrameBank, *, whole: bool, failing: bool
    ) -> Iterator[NextStep]:
        """Yield the possible next steps."""
        wanted, run = self.wanted, str(self.wanted.run)
        if not whole:
            yield from wanted.continued()
            return
        if failed(wanted):
            yield NextStep("ask the failed calls again", wanted.command(again=True))
        if verdict.answer == "Yes" and not failing:
            yield NextStep(
                "keep it so in CI: exit 0 as long as it looks", f"eyechart gate {shlex.quote(run)} --require looks"
            )
        elif verdict.answer != "Yes" and verdict.why_not is not None:
            settle = _settled_by(verdict.why_not, bank)
            if not settle.startswith("nothing"):
                yield NextStep(f"to settle more: {settle}", f"eyechart plan {shlex.quote(_bank(wanted))}")
        if _may_be_blind(verdict, mode):
            yield NextStep("see whether its pictures reach it", doctor_command(wanted))
        if verdict.answer == "No":
            again = wanted.out.with_name(f"{wanted.out.name}-2")
            yield NextStep("try another prompt", wanted.command(prompt="FILE.toml", out=again))
        yield NextStep("every statistic, and why no stronger label", f"eyechart verdict {shlex.quote(run)}")


def _most(planned: Battery, frames: int) -> int:
    """Return the most calls on ``frames`` frames of a plan, with every control."""
    some = replace(planned.plan, frames=spread(planned.plan.bank.frames, frames))
    wide = widest(planned.manifest, some)
    return sum(1 for spec in wide.models for _ in wide.keys_of(spec))


def _asked_before(mode: RequestMode) -> int:
    """Return the number of calls that found the model's request mode."""
    return (mode.measured.calls or 0) if mode.measured is not None else 0


def _because(verdict: Verdict) -> str:
    """Return the ruling's sentence: doubts first, then permitted use and reason."""
    reason = verdict.calibrated.found or verdict.calibrated.reason
    said = f"{verdict.trust} {reason[:1].upper()}{reason[1:]}."
    untested = [note for note in verdict.notes if note.startswith(UNTESTED) and verdict.answer != "Yes"]
    distance = [f"{note[0].upper()}{note[1:]}." for note in untested[:1]]
    return " ".join([*(f"{mark[0].upper()}{mark[1:]}." for mark in verdict.doubts), said, *distance])


UNTESTED = "whether it follows the gap was not tested"


def _holes(verdict: Verdict) -> Iterator[str]:
    """Yield the places where the answer does not hold; those of equal counts are in one line."""
    counts: dict[tuple[int, int], list[str]] = {}
    for hole in verdict.holes:
        counts.setdefault((hole.harder, hole.frames), []).append(hole.where.replace("`", ""))
    for (harder, frames), places in counts.items():
        each = " in each of these, which may be the same ones" if len(places) > 1 else ""
        where = ", ".join(places)
        yield f"Not {where}: it brakes harder for the nearer lead on {harder} of {frames} frames{each}."
    yield from (f"Not excluded: {words}." for words in verdict.open_to)


def _sight(mode: RequestMode) -> str:
    """Return in words whether the drawn pictures showed that a model sees."""
    found = mode.measured
    if found is None or found.sees_image:
        return "it sees its pictures"
    said = found.facts.get("picture", "")
    return f"whether its pictures reach it was not shown{said and f' ({said})'}"


def _may_be_blind(verdict: Verdict, mode: RequestMode) -> bool:
    """Return whether the cause of a No may be a picture that does not arrive."""
    return verdict.answer == "No" and mode.measured is not None and not mode.measured.sees_image


def _unseen(verdict: Verdict, mode: RequestMode) -> Iterator[str]:
    """Yield that pictures may not arrive, where no drawn picture showed that they do."""
    if _may_be_blind(verdict, mode):
        said = _sight(mode)
        yield f"{said[0].upper()}{said[1:]}: the fault may lie between eyechart and the model."


def _failed(wanted: LookRequest, evidence: Evidence) -> Iterator[str]:
    """Yield the number of calls that failed, and the first error, if no gate holds such a run."""
    count = evidence.reasons().get("error")
    if not count and not evidence.is_unfinished:
        return  # calls that failed and that its verdict did not need
    with Ledger(wanted.run / LEDGER) as ledger:
        found = [one for _, one in ledger.replies(wanted.spec) if one.error]
    if found:
        first = printable(f"{found[0].error}: {found[0].error_detail}")[:160]
        yield (
            f"{count or len(found)} calls ended in an error, so 'gate' and assert_looks are inconclusive. The first "
            f"error: {first}"
        )


def _pictures(answers: Answers) -> tuple[tuple[PictureResult, ...], str]:
    """Return three pictures with their answer counts, on frames with a lead past the median."""
    gaps, every = answers.gaps, range(len(answers.frames))
    far, among = list(every), f"on {len(every)} frames"
    if gaps is not None and np.isfinite(gaps).any():
        far = [int(at) for at in np.flatnonzero(gaps >= np.median(gaps))]
        among = f"on the {len(far)} frames whose lead is farther off"
    found = []
    for kind in SHOWN:
        name = next((one for one in kind if any(answers.decisions.get(one, ()))), None)
        if name is None:
            continue
        said = [one for at in far if (one := answers.decisions[name][at]) is not None]
        counts = Counter(f"({one.missing})" if one.action is None else str(one.action) for one in said)
        found.append(PictureResult(kind[name], dict(counts.most_common()), n=len(said)))
    return tuple(found), among


def _settled_by(why: WhyNot, bank: FrameBank) -> str:
    """Return what would settle a verdict; what an imported bank lacks only photographs can."""
    lacks = [name for name in why.conditions if not any(name in frame.counterfactuals for frame in bank)]
    taken = [f"{name}: {PHOTOGRAPHED[name]}" for name in lacks if name in PHOTOGRAPHED]
    if bank.manifest.simulator != IMPORTED or not taken:
        return why.first or why.settle
    return f"pictures of each moment again ({'; '.join(taken)})"


def _bank(wanted: LookRequest) -> str:
    return str(wanted.pictures.frames or wanted.out / BANK)
