"""Tests for depth beyond the pictures along its range, and tests of turns, all within a frame."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from eyechart.conditions import FURTHER, OLDER
from eyechart.frames import PATCHED
from eyechart.stats.agreement import rate
from eyechart.stats.exact_difference import exact_bounds
from eyechart.stats.jackknife import excess_over_half
from eyechart.stats.order import order_violation_p
from eyechart.stats.paired_tests import (
    BoxedTurns,
    ChangedPairs,
    net_effect,
    paired_difference_from_counts,
    sign_test,
    stratified_association,
)
from eyechart.stats.statistic import Statistic, not_available
from eyechart.studies.battery.answers import ABSENT, Answers
from eyechart.studies.battery.evidence import NEAR_FAR
from eyechart.verdicts import ALPHA, MARGIN, NET_ALPHA
from eyechart.verdicts.depth import EXCHANGE, NUDGED, PHOTOGRAPHED, STAGE

LEVEL = 1 - 2 * ALPHA
"""Two-sided level of the intervals, so that each end is a one-sided bound at alpha."""

FEWEST_PAIRS = 7
"""With fewer pairs an exact sign test cannot reach alpha .01 (2 to the power of -7 is .0078)."""

NO_PATCHED = "no frame has decisions on real, real_repeat and patched"
NO_BRAKE = "this space has no axis 'brake'"

EDITED = (*NEAR_FAR, *OLDER, NUDGED, *STAGE, *FURTHER)
"""The pictures that depth compares with others."""

ALONG_LANE = (
    *("real", "real_repeat", "lead_near", "lead_near_nudged", "lead_far", "lead_drawn", "lead_drawn_nudged"),
    *("lead_mid_near", "lead_mid_far"),
)
"""The pictures whose neighbouring lanes are as the frame's ground truth says."""
_BOXED, _ONE_SIDE = ["False", "False"], ["False", "True"]

SIDES = ("left_clear", "right_clear")
"""The columns of ground truth that say which side is clear."""
LANES = (("ego_lane", "lanes"), ("track",))
"""The columns for the own lane and the number of lanes; the first set that a bank has counts."""

DEPTH_TESTS = ("depth_interventional", "depth_net", "lane_net", "unparsed_controls")
"""Further tests for depth, on moved pictures."""
OF_PICTURES = ("photographed", "patched_excess", "patched_bound", "depth_observational")
"""What depth reads besides of banks whose control pictures are not rendered."""
TURN_TESTS = ("turns_clear", "turns_clear_within", "turns_against", "turns_boxed")

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ControlStatistics:
    """Computes control statistics of one model's answers."""

    answers: Answers

    def tests(self) -> dict[str, Callable[[], Statistic]]:
        """Return the function of every test, by its name."""
        return {
            "depth_interventional": self._over,
            "depth_net": partial(self._net, *NEAR_FAR),
            "lane_net": partial(self._net, *EXCHANGE),
            "unparsed_controls": self._unparsed,
            "turns_clear": self._turns_clear,
            "turns_clear_within": self._turns_clear_within,
            "turns_against": self._turns_against,
            "turns_boxed": self._turns_boxed,
            **self._of_pictures(),
        }

    def _of_pictures(self) -> dict[str, Callable[[], Statistic]]:
        """Return the tests of banks whose control pictures are not rendered; of others none."""
        if self.answers.made == "rendered":
            return {}
        tests: dict[str, Callable[[], Statistic]] = {PHOTOGRAPHED: lambda: Statistic(1.0, len(self.answers.frames))}
        if self.answers.made == "edited":
            tests |= {"patched_excess": self._patched_excess, "patched_bound": self._patched_bound}
        return tests

    def _changes(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return where the edit alone, and where a repeat changes the decision, on frames with both."""
        edited, has = self.answers.distance("real", PATCHED)
        again, repeated = self.answers.distance("real", "real_repeat")
        return edited[repeated[has]] > 0, again[has[repeated]] > 0

    def _patched_excess(self) -> Statistic:
        """Test whether the edit alone changes the decision on more frames than a repeat does."""
        edited, again = self._changes()
        if not len(edited):
            return not_available(NO_PATCHED)
        test = sign_test(edited, again)
        return ChangedPairs(
            float(np.mean(edited)) - float(np.mean(again)),
            len(edited),
            p=test.p,
            method="decision changed by the edit alone, less by a repeat; p: one-sided exact McNemar test",
            b=test.wins,
            c=test.losses,
            changed=int(edited.sum()),
            repeated=int(again.sum()),
        )

    def _patched_bound(self) -> Statistic:
        """Bound that excess."""
        edited, again = self._changes()
        if not len(edited):
            return not_available(NO_PATCHED)
        test = sign_test(edited, again)
        bound = paired_difference_from_counts(test.wins, test.losses, len(edited), level=LEVEL)
        if (exact := exact_bounds(test.wins, test.losses, len(edited), alpha=ALPHA)) is not None:
            bound = replace(bound, ci=exact, method="paired difference of proportions, exact bounds")
        return replace(bound, method=f"decision changed by the edit alone, less by a repeat: {bound.method}")

    def _level(self, condition: str) -> Floats:
        """Return the braking level on each frame, NaN without a decision or a braking axis."""
        found = self.answers.projection(condition, "brake")
        return np.full(len(self.answers.frames), np.nan) if found is None else found

    def _lacking(self, pairs: int, first: str, second: str) -> Statistic:
        what = f"sign test of the braking level, {first} over {second}"
        if self.answers.projection("real", "brake") is None:
            return not_available(NO_BRAKE, method=what)
        which = "counterfactual" if (first, second) == NEAR_FAR else "control"
        return not_available(f"{pairs} {which} pairs with two decisions; {FEWEST_PAIRS} are needed", pairs, what)

    def _pairs(self, first: str, second: str) -> tuple[Floats, Floats]:
        """Return the braking levels of two conditions on the frames with both."""
        one, other = self._level(first), self._level(second)
        have = ~np.isnan(one + other)
        return one[have], other[have]

    def _over(self) -> Statistic:
        """Test whether it brakes harder for the near lead than for the far one."""
        one, other = self._pairs(*NEAR_FAR)
        if len(one) < FEWEST_PAIRS:
            return self._lacking(len(one), *NEAR_FAR)
        test = sign_test(one, other, level=LEVEL)
        method = "braking level, {} over {}: {}".format(*NEAR_FAR, test.method)
        return replace(test, method=method, detail={**(test.detail or {}), "pairs": len(one)})

    def _net(self, first: str, second: str) -> Statistic:
        one, other = self._pairs(first, second)
        if len(one) < FEWEST_PAIRS:
            return self._lacking(len(one), first, second)
        wins, losses = (int(np.count_nonzero(which)) for which in (one > other, one < other))
        statistic = net_effect(wins, losses, len(one), margin=MARGIN, alpha=NET_ALPHA)
        return replace(statistic, method=f"braking harder on {first} less on {second}: {statistic.method}")

    def _unparsed(self) -> Statistic:
        """Return the rate of calls without a decision, under the compared condition with most.

        Failed calls count as such calls.
        """
        found = []
        for name in EDITED:
            given = [one for one in self.answers.decisions.get(name, ()) if one is not None]
            failed = sum(one.missing == "error" for one in given)
            lost = rate(sum(one.action is None for one in given), len(given), level=LEVEL)
            which = f"most: {name}" + (f", of which {failed} calls failed" if failed else "")
            found.append(replace(lost, note=which) if given else lost)
        return max(found, key=lambda one: -1.0 if one.ci is None else one.ci[0])

    def _turned(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_], list[tuple[object, ...]]] | str:
        """Return the turns with one clear side: went left, left was clear, and the lane.

        Returns the reason in words where the bank or the space lacks the data. The lane is empty
        where the bank does not record it.
        """
        frames = self.answers.frames
        if not any(all(isinstance(frame.truth.get(name), bool) for name in SIDES) for frame in frames):
            return f"the bank does not say which side is clear (columns {' and '.join(SIDES)})"
        sides = {name: side for name in self.answers.partners for side in ("left", "right") if side in name.lower()}
        if set(sides.values()) != {"left", "right"}:
            return "no action is named after left and right"
        lanes = next((names for names in LANES if all(name in frames[0].truth for name in names)), ())
        found = [
            (sides[turn] == "left", frame.truth["left_clear"] is True, tuple(frame.truth.get(name) for name in lanes))
            for turn, frame in zip(self.answers.turns("real").tolist(), frames, strict=True)
            if turn in sides and {frame.truth.get(name) for name in SIDES} == {True, False}
        ]
        left, clear = (np.array([one[place] for one in found], dtype=np.bool_) for place in (0, 1))
        return left, clear, [one[2] for one in found]

    def _turns_against(self) -> Statistic:
        """Return the share of turns to the blocked side, less half of the noise of its turns.

        The noise is how often the repeat of a turn gets another answer. Other frames do not count.
        """
        found, what = self._turned(), "share of turns to the only blocked side, less half of the noise of its turns"
        if isinstance(found, str):
            return not_available(found, method=what)
        left, clear, _ = found
        real, again = (self.answers.turns(name) for name in ("real", "real_repeat"))
        turned = [
            (one, other)
            for one, other in zip(real, again, strict=True)
            if one in self.answers.partners and other != ABSENT
        ]
        wrong, repeats = int(np.count_nonzero(left != clear)), len(turned)
        wavered = sum(one != other for one, other in turned)
        if not len(left) or not repeats:
            return not_available("no turn with exactly one clear side, or no repeat", method=what)
        share = rate(wrong, len(left), level=LEVEL).less(wavered / repeats / 2)
        p, method = order_violation_p(wrong, len(left), wavered, repeats), f"{what}; p: binomial against repeats"
        return replace(share, p=p, method=method)

    def _turns_boxed(self) -> Statistic:
        """Return how often it turns with both sides blocked, less half of that with one clear.

        All pictures count that change nothing beside the own lane.
        """
        what = "turns where neither side is clear less half of those where one is"
        turns = [*self.answers.partners]
        known = [[frame.truth.get(name) for name in SIDES] for frame in self.answers.frames]
        given = np.array([self.answers.turns(name) for name in ALONG_LANE])
        turned, answered = np.isin(given, turns).sum(axis=0), (given != ABSENT).sum(axis=0)
        boxed, beside = (np.array([sorted(map(str, one)) == of for one in known]) for of in (_BOXED, _ONE_SIDE))
        if not turns or not (boxed * answered).any():
            why = "no action turns" if not turns else "no answer where neither side is known to be clear"
            return not_available(why, method=what)
        first, second = ([turned * which, answered * which] for which in (boxed, beside))
        statistic = excess_over_half(first, second, self.answers.episodes)
        return BoxedTurns(
            statistic.value,
            statistic.n,
            statistic.ci,
            method=f"{what}: {statistic.method}",
            note=statistic.note,
            level=statistic.level,
            turned=int((turned * boxed).sum()),
        )

    def _turns_clear(self) -> Statistic:
        found, what = self._turned(), "turns to the only clear side over turns away from it"
        if isinstance(found, str):
            return not_available(found, method=what)
        left, clear, _ = found
        tested = sign_test(left == clear, left != clear, level=LEVEL)
        note = "" if tested.n else "no turn has exactly one clear side"
        return replace(tested, method=f"{what}: {tested.method}", note=note, detail=None)

    def _turns_clear_within(self) -> Statistic:
        found, what = self._turned(), "turn and clear side within own lane and number of lanes"
        if isinstance(found, str):
            return not_available(found, method=what)
        left, clear, lanes = found
        if lanes and not lanes[0]:
            wanted = " or ".join(" and ".join(names) for names in LANES)
            return not_available(f"the bank does not say on which lane it is (columns {wanted})", len(left), what)
        tested = stratified_association(left, clear, lanes, level=LEVEL)
        return replace(tested, method=f"{what}: {tested.method}")
