"""The statistics that depth needs beside its first: what was moved, how much of it counts, and where it is reversed.

Every comparison is of braking levels within a frame. Their thresholds and why they are these:
docs/decisions/0038-depth-needs-controls.md.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import combinations, pairwise, product
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from eyechart.frames import LEAD_GAP
from eyechart.seeds import key_seed
from eyechart.stats.agreement import rate
from eyechart.stats.jackknife import half_exceeded
from eyechart.stats.order import SWAPPED_ENDS, falls_everywhere, lost_beyond_noise, swapped_ends
from eyechart.stats.paired import (
    BoxedTurns,
    Curve,
    Dose,
    joint_losses,
    net_effect,
    reversal_power,
    reversal_test,
    sign_test,
    stratified_association,
    worst_part,
)
from eyechart.stats.resampling import holm
from eyechart.stats.statistic import Statistic, cannot_say
from eyechart.studies.battery.answers import ABSENT, Answers
from eyechart.verdicts import ALPHA, DOSE_ALPHA, MARGIN, NET_ALPHA, SCENARIO_ALPHA
from eyechart.verdicts.depth import STAGE

LEVEL = 1 - 2 * ALPHA
"""Two-sided level of the intervals, so that each end is a one-sided bound at alpha."""

FEWEST_PAIRS = 7
"""With fewer pairs an exact sign test cannot reach alpha .01 (2 to the power of -7 is .0078)."""

NO_BRAKE = "this space has no axis 'brake'"

BINS = 3
"""Into so many bins of equal ratio the distances of each of the two mids are parted."""

MIDS = ("lead_mid_near", "lead_mid_far")
DISTANCES = {
    "lead_near": "lane_near_m",
    "lead_mid_near": "lead_mid_near_m",
    "lead_mid_far": "lead_mid_far_m",
    "lead_far": "lane_far_m",
}
"""The conditions that move the lead, from the nearest, and the columns that say how far away it then is."""

EXCHANGED = ("lane_own", "lane_beside")
"""The conditions that exchange who is near, the lead first."""

ALIKE = ("real", "real_repeat", "nudged")
"""The pictures that show what the true one shows: two answers to them that differ are noise."""
END_SHARE = 0.15
"""The ends of braking are where so many of the answers are less hard, and so many harder."""

APART = 1.1
"""The true picture is compared with a dose that is farther or nearer by this factor at least."""

CURVE = "mean braking level with the lead nearest less that with it farthest"

COMPARED = ("lead_near", "lead_far", "lane_own", "lane_beside", "lead_mid_near", "lead_mid_far", "nudged")
"""The pictures that the conditions of depth compare."""

ALONG_LANE = (
    *("real", "real_repeat", "lead_near", "lead_near_nudged", "lead_far", "lead_drawn", "lead_drawn_nudged"),
    *("lead_mid_near", "lead_mid_far"),
)
"""The pictures in which what stands beside is what the frame says."""
_BOXED, _ONE_SIDE = ["False", "False"], ["False", "True"]

SIDES = ("left_clear", "right_clear")
"""The columns of ground truth that say which side is clear."""
LANES = (("ego_lane", "lanes"), ("track",))
"""The columns that say on which of how many lanes the own vehicle is: the first of these that a bank has."""

DEPTH_TESTS = (
    "depth_interventional",
    "depth_net",
    "lane_exchange",
    "lane_net",
    "dose_near_mid",
    "dose_mid",
    "dose_mid_far",
    "dose_bins",
    "dose_lost",
    "dose_by_frame",
    "dose_scan",
    "dose_curve",
    "scenario_reversed",
    "near_far_lost",
    "lane_lost",
    "both_lost",
    "twice_lost",
    "any_lost",
    "ends_lost",
    "unparsed_controls",
)
"""The tests of braking that moved pictures make."""
TURN_TESTS = ("turns_clear", "turns_clear_within", "turns_against", "turns_boxed")

Floats = NDArray[np.float64]
Range = tuple[str, tuple[float, float] | None, NDArray[np.bool_]]
"""A condition that moves the lead, from where to where, and which frames show it there."""


def _worst_joint(found: Sequence[Statistic], what: str) -> Statistic:
    """Return the joint losses of least corrected p, of equal ones the greatest; none where there are none."""
    if not found:
        return cannot_say("no two braking levels were given", method=what)
    corrected = [1.0 if p is None else p for p in holm([one.p for one in found])]
    place = min(range(len(found)), key=lambda one: (corrected[one], -(found[one].value or 0.0)))
    method = f"{what}; p: Fisher's exact test, one-sided, Holm over {len(found)}"
    return replace(found[place], p=corrected[place], method=method)


@dataclass(frozen=True)
class Controls:
    """Computes, of one model's answers, what the conditions of depth read."""

    answers: Answers

    def tests(self) -> dict[str, Callable[[], Statistic]]:
        """Return what makes every test, by its name."""
        near_far, exchange = ("lead_near", "lead_far"), ("lane_own", "lane_beside")
        return {
            "depth_interventional": partial(self._over, *near_far),
            "depth_net": partial(self._net, *near_far),
            "lane_exchange": partial(self._over, *exchange),
            "lane_net": partial(self._net, *exchange),
            "dose_near_mid": partial(self._step, "lead_near", "lead_mid_near"),
            "dose_mid": partial(self._step, "lead_mid_near", "lead_mid_far"),
            "dose_mid_far": partial(self._step, "lead_mid_far", "lead_far"),
            "dose_bins": self._bins,
            "dose_lost": self._dose_lost,
            "dose_by_frame": self._by_frame,
            "dose_scan": self._scan,
            "dose_curve": self._curve,
            "scenario_reversed": self._scenarios,
            "near_far_lost": partial(self._lost, *near_far),
            "lane_lost": partial(self._lost, *exchange),
            "both_lost": self._both_lost,
            "twice_lost": self._twice_lost,
            "any_lost": self._any_lost,
            "ends_lost": self._ends_lost,
            "unparsed_controls": self._unparsed,
            "turns_clear": self._turns_clear,
            "turns_clear_within": self._turns_clear_within,
            "turns_against": self._turns_against,
            "turns_boxed": self._turns_boxed,
        }

    def _level(self, condition: str) -> Floats:
        """Return the braking level on each frame, NaN where there is no decision or the space knows no braking."""
        found = self.answers.projection(condition, "brake")
        return np.full(len(self.answers.frames), np.nan) if found is None else found

    @cached_property
    def _wavered(self) -> tuple[int, int]:
        """Return on how many frames a repeat gets another braking level, and of how many."""
        one, again = self._pairs("real", "real_repeat")
        return int(np.count_nonzero(one != again)), len(one)

    def _lacking(self, pairs: int, first: str, second: str) -> Statistic:
        what = f"sign test of the braking level, {first} over {second}"
        if self.answers.projection("real", "brake") is None:
            return cannot_say(NO_BRAKE, method=what)
        which = "counterfactual" if first == "lead_near" and second == "lead_far" else "control"
        return cannot_say(f"{pairs} {which} pairs with two decisions; {FEWEST_PAIRS} are needed", pairs, what)

    def _pairs(self, first: str, second: str) -> tuple[Floats, Floats]:
        """Return the braking levels of two conditions on the frames with both."""
        one, other = self._level(first), self._level(second)
        have = ~np.isnan(one + other)
        return one[have], other[have]

    def _over(self, first: str, second: str) -> Statistic:
        one, other = self._pairs(first, second)
        if len(one) < FEWEST_PAIRS:
            return self._lacking(len(one), first, second)
        found = sign_test(one, other, level=LEVEL)
        method = f"braking level, {first} over {second}: {found.method}"
        return replace(found, method=method, detail={**(found.detail or {}), "pairs": len(one)})

    def _net(self, first: str, second: str) -> Statistic:
        one, other = self._pairs(first, second)
        if len(one) < FEWEST_PAIRS:
            return self._lacking(len(one), first, second)
        wins, losses = (int(np.count_nonzero(which)) for which in (one > other, one < other))
        found = net_effect(wins, losses, len(one), margin=MARGIN, alpha=NET_ALPHA)
        return replace(found, method=f"braking harder on {first} less on {second}: {found.method}")

    def _step(self, nearer: str, farther: str) -> Statistic:
        one, other = self._pairs(nearer, farther)
        if len(one) < FEWEST_PAIRS:
            return self._lacking(len(one), nearer, farther)
        found = reversal_test(one, other, level=LEVEL)
        return replace(found, method=f"braking level, {nearer} over {farther}: {found.method}")

    def _parts(
        self, pairs: Mapping[str, tuple[Floats, Floats]], alpha: float, like: tuple[Floats, Floats]
    ) -> Statistic:
        """Test each part for a reversal, corrected over the parts that have pairs at all.

        Its power is that of a part in which every pair is as often lost as those ``like`` it are won, and the other way
        round.
        """
        tested = {name: reversal_test(*both, level=LEVEL) for name, both in pairs.items()}
        made = [one.p if len(both[0]) else None for one, both in zip(tested.values(), pairs.values(), strict=True)]
        several = max(1, sum(p is not None for p in made))
        wins, losses = (float(np.mean(one)) if len(one) else 0.0 for one in (like[0] > like[1], like[0] < like[1]))
        powers = [reversal_power(len(one), alpha=alpha / several, lost=wins, won=losses) for one, _ in pairs.values()]
        if all(p is None for p in made):
            tested = {}
        return worst_part(tested, [1.0 if p is None else p for p in holm(made)], powers if tested else [])

    @cached_property
    def _ranges(self) -> list[Range]:
        """Return the doses from the nearest: the condition, its range, and which frames show it at that range.

        The distances of each of the two mids are parted into bins of equal ratio; without distances it is one bin.
        """
        found: list[Range] = []
        for condition, column in DISTANCES.items():
            asked, distance = ~np.isnan(self._level(condition)), self.answers.numbers(column)
            known = distance[~np.isnan(distance)]
            if not len(known):
                found.append((condition, None, asked))
                continue
            low, high = float(known.min()), float(known.max())
            bins = BINS if condition in MIDS and 0 < low < high else 1
            edges = np.geomspace(low, high, bins + 1) if bins > 1 else np.array([low, high])
            place = np.clip(np.searchsorted(edges, distance, side="right") - 1, 0, bins - 1)
            for one in range(bins):
                which = asked & ~np.isnan(distance) & (place == one)
                found.append((condition, (float(edges[one]), float(edges[one + 1])), which))
        return found

    def _bins(self) -> Statistic:
        """Compare each bin of the mids with the nearer and the farther dose on its own frames, and with the next bin.

        A frame is shown each mid at one distance, drawn without regard to the frame. So the next bin is of others;
        these are paired in the order of the bank.
        """
        order = list(DISTANCES)
        pairs: dict[str, tuple[Floats, Floats]] = {}
        for condition, ends, which in self._ranges:
            if condition not in MIDS or not which.any():
                continue
            place, name = order.index(condition), condition if ends is None else "{:.3g}-{:.3g} m".format(*ends)
            for nearer, farther, of in (
                (order[place - 1], condition, f"{name} against nearer"),
                (condition, order[place + 1], f"{name} against farther"),
            ):
                one, other = self._level(nearer)[which], self._level(farther)[which]
                have = ~np.isnan(one + other)
                pairs[of] = one[have], other[have]
        for (mid, ends, which), (condition, others, elsewhere) in pairwise(self._ranges):
            if mid == condition and ends is not None and others is not None:
                one, other = self._level(mid)[which], self._level(mid)[elsewhere]
                both = min(len(one), len(other))
                pairs["{:.3g}-{:.3g} m against {:.3g}-{:.3g} m".format(*ends, *others)] = one[:both], other[:both]
        return self._parts(pairs, DOSE_ALPHA, self._pairs("lead_near", "lead_far"))

    def _dose_lost(self) -> Statistic:
        """Return the greatest share of pairs lost, less half of the noise: of the steps, and of the true picture.

        That stands among the others at the distance at which it shows the lead. ``p`` is the smallest, corrected.
        """
        what = "share of a step of the dose lost, less half of the noise of its braking"
        wavered, repeats = self._wavered
        found = {}
        for name, nearer, farther in (*self._steps(), *self._of_real()):
            have = ~np.isnan(nearer + farther)
            lost, pairs = int(np.count_nonzero((nearer < farther)[have])), int(np.count_nonzero(have))
            if pairs >= FEWEST_PAIRS and repeats:
                found[name] = (lost, pairs, lost_beyond_noise(lost, pairs, wavered, repeats))
        if not found:
            return cannot_say("no step of the dose has pairs with two decisions", method=what)
        corrected = dict(zip(found, holm([p for *_, p in found.values()]), strict=True))
        worst = min(found, key=lambda name: (corrected[name] or 0.0, -found[name][0] / found[name][1]))
        lost, pairs, _ = found[worst]
        share = rate(lost, pairs, level=LEVEL).less(wavered / repeats / 2)
        note, method = f"most: {worst}", f"{what}; p: binomial against repeats, Holm over {len(found)}"
        return replace(share, p=corrected[worst], method=method, note=note)

    def _steps(self) -> list[tuple[str, Floats, Floats]]:
        """Return the braking levels of each two neighbouring doses, with both names."""
        return [(f"{one} over {other}", self._level(one), self._level(other)) for one, other in pairwise(DISTANCES)]

    def _of_real(self) -> list[tuple[str, Floats, Floats]]:
        """Return the braking levels of the true picture and of each dose, the nearer first, NaN where about as near.

        Not of the exchange, in which another vehicle is moved too: who turns where a side is clear may then not brake.
        Where near and far were put frame by frame the bank does not tell, only between which distances: the true lead
        is nearer than all of these, or farther.
        """
        known = self.answers.numbers(LEAD_GAP.column)
        real, found = self._level("real"), []
        for condition, column in DISTANCES.items():
            level, distance = self._level(condition), self.answers.numbers(column)
            before, after = known * APART < distance, known > distance * APART
            if condition not in MIDS:
                before = known * APART < np.fmin.reduce(distance, initial=np.nan)
                after = known > np.fmax.reduce(distance, initial=np.nan) * APART
            nearer, farther = np.where(before, real, level), np.where(before, level, real)
            nearer[~(before | after)] = np.nan
            found.append((f"real and {condition} by their distances", nearer, farther))
        return found

    def _by_frame(self) -> Statistic:
        """Return on how many frames a pair is the wrong way round beyond what independent answers would be."""
        near_far, exchange = ("lead_near", "lead_far"), ("lane_own", "lane_beside")
        what = "share of frames with a pair the wrong way round, less what independent answers would give"
        found = []
        for first, second in (near_far, exchange, *pairwise(DISTANCES)):
            one, other = self._pairs(first, second)
            if len(one) >= FEWEST_PAIRS:
                each = (joint_losses(one < of, other >= of, level=LEVEL) for of in np.unique([one, other])[1:])
                found += [replace(lost, note=f"most: {first} over {second}") for lost in each]
        return _worst_joint(found, what)

    def _scan(self) -> Statistic:
        """Test whether braking rises with distance anywhere along the two mids."""
        levels = np.concatenate([self._level(name) for name in MIDS])
        places = np.concatenate([self.answers.numbers(DISTANCES[name]) for name in MIDS])
        have = ~np.isnan(places + levels)
        seed = key_seed("dose_scan", *(frame.id for frame in self.answers.frames))
        found = falls_everywhere(places[have], levels[have], seed=seed)
        return replace(found, method=f"braking level along {' and '.join(MIDS)}: {found.method}")

    def _curve(self) -> Statistic:
        doses = []
        for condition, ends, which in self._ranges:
            levels, (low, high) = self._level(condition)[which], ends or (None, None)
            doses.append(Dose(condition, low, high, len(levels), float(levels.mean()) if len(levels) else None))
        shown = [one for one in doses if one.level is not None]
        if len(shown) < 2:
            return cannot_say("the lead was not shown at two distances", method=CURVE)
        nearest, farthest = shown[0].level, shown[-1].level
        assert nearest is not None
        assert farthest is not None
        frames = sum(one.frames for one in shown)
        return Curve(nearest - farthest, frames, method=CURVE, doses=tuple(doses))

    def _scenarios(self) -> Statistic:
        """Test in each scenario the sign of both differences together; where one was not answered, of the other."""
        near, far, own, beside = (self._level(name) for name in ("lead_near", "lead_far", "lane_own", "lane_beside"))
        have = ~np.isnan(near + far + own + beside)
        apart, scenarios = np.sign(near - far + own - beside)[have], self.answers.scenarios[have]
        none = np.zeros_like(apart)
        pairs = {
            name: (apart[scenarios == name], none[scenarios == name])
            for name in dict.fromkeys(self.answers.scenarios.tolist())
        }
        return self._parts(pairs, SCENARIO_ALPHA, (apart, none))

    def _lost(self, first: str, second: str) -> Statistic:
        """Return the share of pairs that are lost, less half of the noise: more a coin does not lose."""
        one, other = self._pairs(first, second)
        if len(one) < FEWEST_PAIRS:
            return self._lacking(len(one), first, second)
        wavered, repeats = self._wavered
        found = rate(int(np.count_nonzero(one < other)), len(one), level=LEVEL).less(wavered / max(1, repeats) / 2)
        method = f"braking less hard on {first} than on {second}, less half of the noise of its braking: {found.method}"
        return replace(found, method=method)

    def _both_lost(self) -> Statistic:
        near, far, own, beside = (self._level(name) for name in ("lead_near", "lead_far", "lane_own", "lane_beside"))
        have = ~np.isnan(near + far + own + beside)
        found = joint_losses((near < far)[have], (own < beside)[have], level=LEVEL)
        return replace(found, method=f"lead_near under lead_far, lane_own under lane_beside: {found.method}")

    def _twice_lost(self) -> Statistic:
        """Return on how many frames both pictures with the lead near, or both with it far, are lost to one between.

        Beyond what two independent answers would lose. Near, of the frames on which it brakes for `lead_mid_near`: it
        does not for `lead_near`, nor for `lane_own`; far, of those on which it does not for `lead_mid_far`: it does for
        `lead_far` and `lane_beside`. Noise loses one here and one there; a rule of the frame loses both. These are half
        of the frames at least: where it answers so for the picture between by noise alone, both ends are lost by who
        brakes always on some frames, and reads the others.
        """
        near, mid_near, mid_far, far = (self._level(name) for name in DISTANCES)
        own, beside = self._level("lane_own"), self._level("lane_beside")
        what = "share of frames that lose both pictures of one end to one between, less what independent answers would"
        found = []
        for name, ends, mid, harder in (("near", (near, own), mid_near, False), ("far", (far, beside), mid_far, True)):
            have = ~np.isnan(mid + ends[0] + ends[1])
            for of in np.unique([one[have] for one in (*ends, mid)])[1:]:
                held = have & ((mid < of) if harder else (mid >= of))
                first, second = ((one[held] >= of) == harder for one in ends)
                if np.count_nonzero(held) >= max(FEWEST_PAIRS, np.count_nonzero(have) / 2):
                    found.append(replace(joint_losses(first, second, level=LEVEL), note=f"most: with the lead {name}"))
        return _worst_joint(found, what)

    def _any_lost(self) -> Statistic:
        """Return on how many frames any comparison is lost, less what noise may lose in all of them together.

        A rule may be the wrong way round on a few frames of each comparison, and on many of them all.
        """
        compared = [(self._level(one), self._level(other)) for one, other in (*pairwise(DISTANCES), EXCHANGED)]
        have = ~np.isnan(sum(one + other for one, other in compared))
        what = "share of frames that lose any comparison of doses or of the exchange"
        if (frames := int(np.count_nonzero(have))) < FEWEST_PAIRS:
            return cannot_say(f"{frames} frames have all of these decisions; {FEWEST_PAIRS} are needed", frames, what)
        wavered, repeats = self._wavered
        lost = np.any([one[have] < other[have] for one, other in compared], axis=0)
        noise, each = wavered / max(1, repeats), len(compared) / 2
        found = rate(int(np.count_nonzero(lost)), frames, level=LEVEL)
        share, (low, high), wide = found.value or 0.0, found.ci or (0.0, 1.0), NormalDist().inv_cdf(0.5 + LEVEL / 2)
        spread = each * wide * math.sqrt(noise * (1 - noise) / max(1, repeats))
        below, value = max(share - low, wide * math.sqrt(share * (1 - share) / frames)), share - each * noise
        method = f"{what}, less half of the noise of its braking for each, {100 * LEVEL:g}% interval of both"
        ci = (value - math.hypot(below, spread), value + math.hypot(high - share, spread))
        return replace(found, value=value, ci=ci, method=method)

    def _ends_lost(self) -> Statistic:
        """Return how often it answers from one end of its braking to the other the wrong way round, beyond its noise.

        Of both pictures with the lead near against both with it far: who misreads a picture now and then may do so in
        any of the four. The ends are of what it answers to these, so that a rare answer is none. Its noise is that of
        all pictures that show what the true one shows.
        """
        if (exchanged := len(self._pairs("lane_own", "lane_beside")[0])) < FEWEST_PAIRS:
            return self._lacking(exchanged, "lane_own", "lane_beside")
        compared = [self._pairs(*two) for two in product(("lead_near", "lane_own"), ("lead_far", "lane_beside"))]
        nearer, farther = (np.concatenate([both[place] for both in compared]) for place in (0, 1))
        low, high = np.quantile([*nearer, *farther], (END_SHARE, 1 - END_SHARE))
        alike = [self._pairs(*two) for two in combinations(ALIKE, 2)]
        one, again = (np.concatenate([both[place] for both in alike]) for place in (0, 1))
        if low == high or not len(one):
            return cannot_say("its braking has no two ends, or no picture was asked twice", len(nearer), SWAPPED_ENDS)
        third = (high - low) / 3
        return swapped_ends((nearer, farther), (one, again), light=low + third, hard=high - third, often=2, level=LEVEL)

    def _unparsed(self) -> Statistic:
        """Return the rate of calls without a decision about the compared pictures that hold fewest, failed ones too."""
        found = []
        for name in (*COMPARED, *STAGE):
            given = [one for one in self.answers.decisions.get(name, ()) if one is not None]
            failed = sum(one.missing == "error" for one in given)
            lost = rate(sum(one.action is None for one in given), len(given), level=LEVEL)
            which = f"most: {name}" + (f", of which {failed} calls failed" if failed else "")
            found.append(replace(lost, note=which) if given else lost)
        return max(found, key=lambda one: -1.0 if one.ci is None else one.ci[0])

    def _turned(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_], list[tuple[object, ...]]] | str:
        """Return, of the turns with one clear side, whether they went left, whether that was clear, and on which lane.

        Else why nobody can say. The lane is empty where the bank does not record it.
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
            for turn, frame in zip(self.answers.actions("real").tolist(), frames, strict=True)
            if turn in sides and {frame.truth.get(name) for name in SIDES} == {True, False}
        ]
        left, clear = (np.array([one[place] for one in found], dtype=np.bool_) for place in (0, 1))
        return left, clear, [one[2] for one in found]

    def _turns_against(self) -> Statistic:
        """Return the share of turns to the only side that is not clear, less half of the noise of its turns.

        Its noise is how often another answer comes back where it turns: what it does elsewhere is none of it.
        """
        found, what = self._turned(), "share of turns to the only blocked side, less half of the noise of its turns"
        if isinstance(found, str):
            return cannot_say(found, method=what)
        left, clear, _ = found
        real, again = (self.answers.actions(name) for name in ("real", "real_repeat"))
        turned = [
            (one, other)
            for one, other in zip(real, again, strict=True)
            if one in self.answers.partners and other != ABSENT
        ]
        wrong, repeats = int(np.count_nonzero(left != clear)), len(turned)
        wavered = sum(one != other for one, other in turned)
        if not len(left) or not repeats:
            return cannot_say("no turn with exactly one clear side, or no repeat", method=what)
        share = rate(wrong, len(left), level=LEVEL).less(wavered / repeats / 2)
        p, method = lost_beyond_noise(wrong, len(left), wavered, repeats), f"{what}; p: binomial against repeats"
        return replace(share, p=p, method=method)

    def _turns_boxed(self) -> Statistic:
        """Return how often it turns where neither side is clear, less half of how often where exactly one is.

        Of all pictures that move nothing beside the own lane.
        """
        what = "turns where neither side is clear less half of those where one is"
        turns = [*self.answers.partners]
        known = [[frame.truth.get(name) for name in SIDES] for frame in self.answers.frames]
        given = np.array([self.answers.actions(name) for name in ALONG_LANE])
        turned, answered = np.isin(given, turns).sum(axis=0), (given != ABSENT).sum(axis=0)
        boxed, beside = (np.array([sorted(map(str, one)) == of for one in known]) for of in (_BOXED, _ONE_SIDE))
        if not turns or not (boxed * answered).any():
            why = "no action turns" if not turns else "no answer where neither side is known to be clear"
            return cannot_say(why, method=what)
        first, second = ([turned * which, answered * which] for which in (boxed, beside))
        found = half_exceeded(first, second, self.answers.episodes)
        return BoxedTurns(
            found.value,
            found.n,
            found.ci,
            method=f"{what}: {found.method}",
            note=found.note,
            level=found.level,
            turned=int((turned * boxed).sum()),
        )

    def _turns_clear(self) -> Statistic:
        found, what = self._turned(), "turns to the only clear side over turns away from it"
        if isinstance(found, str):
            return cannot_say(found, method=what)
        left, clear, _ = found
        tested = sign_test(left == clear, left != clear, level=LEVEL)
        note = "" if tested.n else "no turn has exactly one clear side"
        return replace(tested, method=f"{what}: {tested.method}", note=note, detail=None)

    def _turns_clear_within(self) -> Statistic:
        found, what = self._turned(), "turn and clear side within own lane and number of lanes"
        if isinstance(found, str):
            return cannot_say(found, method=what)
        left, clear, lanes = found
        if lanes and not lanes[0]:
            wanted = " or ".join(" and ".join(names) for names in LANES)
            return cannot_say(f"the bank does not say on which lane it is (columns {wanted})", len(left), what)
        tested = stratified_association(left, clear, lanes, level=LEVEL)
        return replace(tested, method=f"{what}: {tested.method}")
