"""One policy's answers: arrays by condition, in units of scale, relative to the state shown."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from eyechart.calls import UNFINISHED, CallKey, Reply
from eyechart.channels import CAMERAS, STATE, flat_state, logs, partners, relative_log, whose
from eyechart.conditions import OVER, PARTNERS
from eyechart.conditions.policies import COMPUTED
from eyechart.run import MotionPlan
from eyechart.spaces.motion import reflect
from eyechart.stats.partners import NOBODY, Places
from eyechart.verdicts.share_predicates import UNSCORABLE

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Motions:
    """One policy's answers about the frames of a plan.

    ``answers`` maps a condition to an array (answers, frames, steps, dimensions), NaN if missing.
    ``reasons`` counts by condition the calls without a motion, by reason; ``planned`` and
    ``finished`` count the plan's calls. ``order`` has the attempts in the order of sending.
    ``without`` counts by condition the finished calls without a motion, and all finished ones. A
    condition that the policy ``fails_on`` has no answers.
    """

    plan: MotionPlan
    answers: Mapping[str, Floats]
    reasons: Mapping[str, Mapping[str, int]] = field(default_factory=dict)
    order: Sequence[CallKey] = ()
    planned: int = 0
    finished: int = 0
    without: Mapping[str, tuple[int, int]] = field(default_factory=dict)

    @property
    def missing(self) -> dict[str, int]:
        """Return how many calls hold no motion, by reason."""
        return _summed(self.reasons.values())

    @cached_property
    def fails_on(self) -> dict[str, tuple[int, int]]:
        """Return the computed pictures with too few motions: calls without one, and all, by condition."""
        return failing(self.without)

    def judged(self) -> tuple[dict[str, int], int]:
        """Return by reason the calls without a motion that count against it, of how many calls.

        Those on pictures that it fails on do not.
        """
        kept = [name for name in self.without if name not in self.fails_on]
        return _summed(self.reasons.get(name, {}) for name in kept), sum(self.without[name][1] for name in kept)

    def lost(self, *conditions: str) -> float:
        """Return the largest share of finished calls without a motion, ``real`` included."""
        counts = [self.without.get(name, (0, 0)) for name in ("real", *conditions)]
        return max(empty / finished if finished else 0.0 for empty, finished in counts)

    @cached_property
    def logged(self) -> Floats:
        """Return the logged motions, shape (frames, steps, dimensions); NaN without a log."""
        empty, kept = np.full(self.plan.motions.shape, np.nan), {frame.id for frame in logs(self.plan.bank)}
        return np.stack([np.array(frame.motion) if frame.id in kept else empty for frame in self.plan.frames])

    @cached_property
    def states(self) -> Floats | None:
        """Return the states, shape (frames, numbers), None where the bank has none."""
        found = [flat_state(frame.state) for frame in self.plan.frames]
        return np.array(found) if found and found[0] else None

    @cached_property
    def episodes(self) -> Places:
        """Return the number of each frame's episode, shape (frames,)."""
        return np.unique([frame.drive for frame in self.plan.frames], return_inverse=True)[1]

    @cached_property
    def scales(self) -> Floats:
        """Return the scale of each compared number over the whole bank's log, shape (columns,)."""
        frames = logs(self.plan.bank)
        if not frames:
            return self.plan.motions.scales()
        return self.plan.motions.scales(relative_log(frames, self.plan.motions))

    @cached_property
    def unscaled(self) -> frozenset[str]:
        """Return the parts of a motion that count in their own unit: the log has one value of them."""
        space, frames = self.plan.motions, logs(self.plan.bank)
        return space.unscaled(relative_log(frames, space) if frames else np.zeros(0))

    @cached_property
    def fit_to(self) -> Floats:
        """Return the logged motions in the form of `of`, without its first axis."""
        return np.asarray(self.plan.motions.relative(self.logged, self.states) / self.scales)

    def of(self, condition: str) -> Floats | None:
        """Return a condition's answers relative to the state shown, in scales; None if not run."""
        if condition not in self.answers:
            return None
        return np.asarray(self.plan.motions.relative(self.answers[condition], self._shown(condition)) / self.scales)

    def raw(self, condition: str) -> Floats | None:
        """Return a condition's answers relative to the state shown, in own units, or None."""
        found = self.of(condition)
        return None if found is None else np.asarray(found * self.scales)

    def as_given(self, condition: str) -> Floats:
        """Return a condition's answers as they are compared, not relative to the state."""
        return self.plan.motions.relative(self.answers[condition], None)

    def _shown(self, condition: str) -> Floats | None:
        """Return the states that a policy gets under a condition."""
        base, _, channel = condition.partition(OVER)
        if self.states is None:
            return None
        if base == "mirrored" and self.plan.motions.state:
            return reflect(self.states, self.plan.motions.state)
        if base in PARTNERS and (channel == STATE) != (base == "kept"):
            every = np.array([flat_state(frame.state) for frame in self.plan.bank])
            return np.asarray(every[self.partners(condition)])
        return self.states

    def partners(self, condition: str) -> Places:
        """Return the frame whose channel each frame is shown, as a place in the bank.

        It is the frame's own place if it has no partner.
        """
        base, _, channel = condition.partition(OVER)
        own = np.array([self._places[frame.id] for frame in self.plan.frames])
        if base not in PARTNERS:
            return own
        bank = self.plan.bank
        theirs = partners(bank.frames, *whose(base, channel), bank.manifest.images, self.plan.motions)[own]
        return np.where(theirs == NOBODY, own, theirs)

    @cached_property
    def compared(self) -> Places:
        """Return for each frame a frame of another episode, as a place in the plan, or NOBODY."""
        if len(self.plan.frames) == len(self.plan.bank.frames):
            return partners(self.plan.bank.frames, "swapped", CAMERAS)
        return partners(self.plan.frames, "swapped", CAMERAS)

    def episodes_of(self, places: Places) -> Places:
        """Return the episode numbers of places in the bank; the plan's episodes come first."""
        names = list(dict.fromkeys(sorted({frame.drive for frame in self.plan.frames})))
        numbers = {name: number for number, name in enumerate(names)}
        every = [numbers.setdefault(frame.drive, len(numbers)) for frame in self.plan.bank]
        return np.array(every)[places]

    def remembered(self) -> tuple[Floats, Floats, Floats]:
        """Return each answer's deviation from its call's mean, and two facts of the call before.

        The deviations have shape (calls, steps, dimensions). The first fact, shape (calls,
        numbers), holds the mean answer of the call before at its first and last step, and the state
        it showed. The second, shape (calls, dimensions), is that call's own deviation, averaged
        over the steps. Only calls with several answers count, after a call that has several too.
        """
        every = {name: one for name in self.answers if (one := self.of(name)) is not None and len(one) > 1}
        means = {name: one.mean(axis=0) for name, one in every.items()}
        shown = {name: self._shown(name) for name in every}
        at = {frame.id: place for place, frame in enumerate(self.plan.frames)}

        def beyond(call: CallKey) -> Floats:
            own = at[call.frame]
            return np.asarray(every[call.condition][call.repeat, own] - means[call.condition][own])

        found: tuple[list[Floats], ...] = ([], [], [])
        for first, call in pairwise(self.order):
            if first.condition in every and call.condition in every:
                place = at[first.frame]
                answer, states = means[first.condition][place], shown[first.condition]
                known = np.concatenate([answer[0], answer[-1], () if states is None else states[place]])
                for many, one in zip(found, (beyond(call), known, beyond(first).mean(axis=0)), strict=True):
                    many.append(one)
        if not found[0]:
            return np.zeros((0, 1, 1)), np.zeros((0, 1)), np.zeros((0, 1))
        arrays = [np.array(many) for many in found]
        good = np.logical_and.reduce([np.isfinite(array).reshape(len(array), -1).all(axis=1) for array in arrays])
        apart, before, earlier = (array[good] for array in arrays)
        return apart, before, earlier

    @cached_property
    def _places(self) -> Mapping[str, int]:
        return {frame.id: place for place, frame in enumerate(self.plan.bank)}


def failing(without: Mapping[str, tuple[int, int]]) -> dict[str, tuple[int, int]]:
    """Return the counts of the conditions of computed pictures with too few motions to be judged by.

    A detector in front of a policy may find nothing in a grey picture: that is no fault elsewhere.
    """
    return {
        name: (empty, finished)
        for name, (empty, finished) in without.items()
        if name.partition(OVER)[0] in COMPUTED and empty > UNSCORABLE * finished
    }


def _summed(many: Iterable[Mapping[str, int]]) -> dict[str, int]:
    total = Counter[str]()
    for one in many:
        total.update(one)
    return dict(total)


def read_motions(
    replies: Iterable[tuple[CallKey, Reply]], plan: MotionPlan, model: str, order: Sequence[CallKey] = ()
) -> Motions:
    """Return one policy's answers; ``replies`` may hold calls outside the plan, which are ignored.

    ``order`` has its attempts in the order of sending.
    """
    expected = set(plan.keys_of(model))
    turns = plan.answers if model in plan.drawn else 1
    place = {frame.id: number for number, frame in enumerate(plan.frames)}
    shape = (turns, len(plan.frames), *plan.motions.shape)
    found: dict[str, Floats] = {}
    reasons: dict[str, Counter[str]] = {}
    each, empty = Counter[str](), Counter[str]()
    for key, reply in replies:
        if key not in expected or reply.error in UNFINISHED:
            continue
        each[key.condition] += 1
        decision = plan.motions.read(reply)
        empty[key.condition] += decision.action is None
        if key.condition == "real_repeat" and key.repeat:
            continue  # it has the seed of all calls, and only tests whether that fixes the answer
        array = found.setdefault(key.condition, np.full(shape, np.nan))
        if decision.action is None:
            reasons.setdefault(key.condition, Counter())[str(decision.reason)] += 1
        else:
            array[key.repeat, place[key.frame]] = decision.action.array
    if "real_repeat" in found:
        found["real_repeat"] = found["real_repeat"][:1]
    without = {name: (empty[name], count) for name, count in each.items()}
    found = {name: array for name, array in found.items() if name not in failing(without)}
    return Motions(plan, found, reasons, order, len(expected), each.total(), without)
