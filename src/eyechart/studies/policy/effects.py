"""Effect sizes of one policy: by channel, by moved object, and against the log.

Why these: docs/decisions/policies.md.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import chain

import numpy as np
import numpy.typing as npt

from eyechart.channels import (
    BY_STATE,
    CAMERAS,
    INSTRUCTION,
    MOVES,
    OBJECTS,
    STATE,
    TOLD,
    channels_of,
    far_off,
    instruction_column,
    instruction_key,
    own_pictures,
    rare,
)
from eyechart.conditions import OVER, PARTNERS
from eyechart.conditions.policies import subset_conditions
from eyechart.seeds import key_seed
from eyechart.spaces.motion import PLACES
from eyechart.stats.agreement import rate
from eyechart.stats.partners import NOBODY, Places
from eyechart.stats.risk_bounds import share_bound
from eyechart.stats.shares import FollowedShare, LogDistance, Share, of_kind
from eyechart.stats.sign_flip import follow
from eyechart.stats.statistic import Statistic, not_available
from eyechart.stats.total_effect import (
    LEVEL,
    ROUNDING,
    Pairs,
    dispersion_change,
    distance_from_log,
    half_products,
    held_still,
    memory_share,
    misfit_share,
    noise_share,
    permutation_p,
    responding,
    rounding_tolerance,
    shapley_values,
    share_beyond,
    shares_of_parts,
    squared_distance,
    t_quantile,
    total_effect,
)
from eyechart.studies.policy.motions import Floats, Motions
from eyechart.verdicts.policy_rules import RESPONDS, SURENESS, rests_on
from eyechart.verdicts.policy_verdict import CONSTANT
from eyechart.verdicts.share_predicates import ALPHA, IGNORED, LEAST_EPISODES, LEAST_NOISE, USED, fails, quote

NOT_ASKED = "the run did not ask this"
NOT_FINISHED = "none of its calls is finished"
_LEAST_TOLD = 3
"""An instruction with fewer episodes has no statistic of its own."""
_LEAST_PART = 0.1
"""An axis with a smaller part of the oracle's way has no share of its own."""
NOT_SHOWN = "no frame of the run can be shown it"
NO_FRAMES = "no frame has both answers"


def statistics_of(motions: Motions, *, drawn: bool, seeded: bool) -> dict[str, Statistic]:
    """Return every statistic of one policy's motions, by name.

    ``T.CONDITION`` is the share of the policy's own variation that changes under a condition.
    ``follow.named`` and ``follow.other`` say how far it follows a moved object. ``follow.told``
    says how much farther it follows the one that its instruction names. ``follow.logged`` says how
    much nearer its own instruction brings it to the log than another one. ``swapped.alike@…`` is
    the share with any other episode's pictures, on the frames that have a match at a similar state.
    ``shapley.CHANNEL`` exists if the run has every subset of the channels.
    """
    taken = Effects(motions, drawn=drawn, seeded=seeded)
    missing, calls = motions.judged()
    statistics = {
        "motions": rate(calls - sum(missing.values()), calls),
        "misfit": taken.misfit(),
        "variation": taken.variation_share(),
        "noise": taken.noise(),
        **({"memory": taken.memory()} if drawn else {}),
    }
    for name in motions.plan.conditions:
        if name not in {"real", "real_repeat", "mirrored", *MOVES} and not name.startswith(TOLD):
            statistics[f"T.{name}"] = taken.total(name)
    cameras = [name for name in channels_of(motions.plan.bank) if name not in {STATE, INSTRUCTION}]
    statistics |= {f"beyond@{name}": taken.beyond(name) for name in cameras if f"T.near@{name}" in statistics}
    if motions.plan.motions.kind in PLACES and f"T.swapped{OVER}{STATE}" in statistics:
        statistics[f"reads{OVER}{STATE}"] = taken.reads()
    statistics |= {f"swapped.alike@{name}": taken.alike(name) for name in cameras if f"T.matched@{name}" in statistics}
    absent = [name for name in channels_of(motions.plan.bank) if f"T.swapped@{name}" in statistics]
    statistics |= {f"{claim}@{name}": taken.responds(name, claim) for name in absent for claim in RESPONDS}
    statistics |= {f"follow.{which}": taken.follow((which,)) for which in OBJECTS}
    statistics["follow.told"] = taken.instruction_effect()
    statistics["follow.rather"] = taken.follow(OBJECTS)
    if f"T.swapped{OVER}{INSTRUCTION}" in statistics:
        statistics["follow.logged"] = taken.logged()
    statistics["mirror"] = taken.mirror()
    statistics |= taken.shapley()
    return statistics


class Effects:
    """The statistics of one policy's motions, one by one."""

    def __init__(self, motions: Motions, *, drawn: bool, seeded: bool = False) -> None:
        self._motions, self._drawn, self._seeded = motions, drawn, seeded
        real = motions.of("real")
        space = motions.plan.motions
        empty = np.full((1, len(motions.plan.frames), space.horizon, space.width), np.nan)
        self._columns_of = {name: list(many) for name, many in space.parts.items()}
        self._real = empty if real is None else real
        self._compared = motions.compared
        self._episodes = motions.episodes
        self._far = far_off(motions.plan.bank)

    def _whole(self, *arrays: Floats) -> Places:
        """Return the frames on which every answer of all arrays is a motion."""
        good = np.ones(arrays[0].shape[1], dtype=bool)
        for array in arrays:
            good &= np.isfinite(array).reshape(len(array), array.shape[1], -1).all(axis=(0, 2))
        return np.flatnonzero(good)

    def _others(self) -> tuple[Places, Places]:
        """Return frames, and for each a frame of another episode; both have real answers.

        Frames with a log far off are excluded: a place relative to a wrong state would be all of
        the variation.
        """
        places, there = self._compared, np.zeros(len(self._compared), dtype=bool)
        there[self._whole(self._real)] = True
        there &= np.array([frame.id not in self._far for frame in self._motions.plan.frames])
        good = there & (places != NOBODY) & there[np.where(places == NOBODY, 0, places)]
        frames = np.flatnonzero(good)
        return frames, places[frames]

    def _variation(self) -> Pairs:
        frames, others = self._others()
        values = squared_distance(self._real[:, frames], self._real[:, others]) if len(frames) else np.zeros(0)
        return Pairs(values, self._episodes[frames], self._episodes[others])

    def misfit(self) -> Statistic:
        """Return the normalised error to the log, with the offset and the spread."""
        fit = self._motions.fit_to
        frames = self._whole(self._real[:1], fit[None])
        answers, logged = self._real[0, frames], fit[frames]
        result = of_kind(LogDistance, misfit_share(answers, logged, self._episodes[frames]))
        here = [self._far[frame.id] for frame in self._motions.plan.frames if frame.id in self._far]
        if here:
            of = tuple(dict.fromkeys(chain.from_iterable(here)))
            result = replace(result, far_off=len(here), far_off_of=of)
        if result.value is None:
            return result
        # The columns of a rotation have no spread of their own; its error is in the value.
        plain = {name: many[0] for name, many in self._columns_of.items() if len(many) == 1}
        if not plain:
            return result
        names, places = list(plain), list(plain.values())
        # A copy in C order: the order of memory decides the last digits of a sum.
        own, log = (np.ascontiguousarray(one[..., places]) for one in (answers, logged))
        (offset, first), (spread, second) = distance_from_log(own, log)
        return replace(result, offset=offset, offset_of=names[first], spread=spread, spread_of=names[second])

    def variation_share(self) -> Statistic:
        """Return the answers' variation between episodes, over that of the logged motions.

        Of drawn answers it is net of their noise, and None where that leaves nothing: more noise than
        `CONSTANT` then hides whether they vary. ``with_noise`` is there where they may be constant.
        """
        frames, others = self._others()
        fit, method = self._motions.fit_to, "variation between episodes, over that of the logged motions"
        good = np.isfinite(fit[frames]).all(axis=(1, 2)) & np.isfinite(fit[others]).all(axis=(1, 2))
        frames, others = frames[good], others[good]
        if not len(frames):
            return not_available("no two frames have answers and logged motions", method=method)
        own = float(squared_distance(self._real[:, frames], self._real[:, others]).mean())
        with_noise = float(((self._real[:, frames] - self._real[:, others]) ** 2).mean()) / 2
        logged = float(squared_distance(fit[None, frames], fit[None, others]).mean())
        if not logged > 0:
            return not_available("the logged motions are all the same", len(frames), method)
        if own < 0 and with_noise >= CONSTANT * logged:
            return not_available(
                "its answers differ as much when nothing changes as between episodes", len(frames), method
            )
        answers = self._real[:, frames].mean(axis=0)
        held = {*held_still(answers, fit[frames])}
        moved = {*np.flatnonzero(np.ptp(answers.reshape(-1, answers.shape[-1]), axis=0) >= ROUNDING).tolist()}
        still = [
            name
            for name, many in self._columns_of.items()
            if held & {*many} and (len(many) == 1 or not moved & {*many})
        ]
        share, most = max(0.0, own / logged), with_noise / logged
        found = Share(share, len(frames), method=method, still=still or None)
        return replace(found, with_noise=most) if share < CONSTANT else found

    def memory(self) -> Statistic:
        """Return the share of the noise that goes with the call before.

        It is the most significant of four tests. Kept pictures show in what the call before showed;
        drift with time or a call counter shows in the noise of the call before. Each is tested on
        the mean over the steps and on all steps, since an answer that alternates along the horizon
        has no mean.
        """
        apart, *before = self._motions.remembered()
        parts = (apart.mean(axis=1), apart.reshape(len(apart), apart.shape[1] * apart.shape[2]))
        statistics = [memory_share(part, one, seed=key_seed("memory")) for part in parts for one in before]
        return min(statistics, key=lambda statistic: 2.0 if statistic.p is None else statistic.p)

    def noise(self) -> Statistic:
        """Return the share of the variation without any change, or between two seeds."""
        again = self._motions.of("real_repeat")
        if again is None:
            return not_available(self._absent("real_repeat"))
        frames, others = self._others()
        good = np.isfinite(again[0, frames]).all(axis=(1, 2))
        frames, others = frames[good], others[good]
        other = again[0] if self._seeded and np.isfinite(again[0, others]).all() else self._real[0]
        found = noise_share(self._real[0, frames], again[0, frames], other[others])
        found = self._counted(found, "real_repeat")
        return replace(found, seeds=2) if self._seeded else found

    @cached_property
    def _near(self) -> Floats:
        """Return the largest difference of answers that counts as rounding, shape (dimensions,).

        It is 0 if the repeats are equal, or if the policy draws its answers or is seeded. It is in
        the units of the raw answers.
        """
        both = {"real", "real_repeat"} <= self._motions.answers.keys()
        real, again = (self._motions.as_given(name) if both else None for name in ("real", "real_repeat"))
        exact = np.zeros(self._real.shape[-1])
        if real is None or again is None or self._drawn or self._seeded:
            return exact
        frames = self._whole(real, again)
        return exact if (real[:, frames] == again[:, frames]).all() else rounding_tolerance(real[0, frames])

    def _same(self, condition: str, frames: Places) -> float:
        """Return the share of frames with equal raw answers under a condition.

        The raw answers are compared, since one place is another one relative to another state.
        """
        real, other = (self._motions.as_given(name)[:, frames] for name in ("real", condition))
        return float((np.abs(real - other) <= self._near).all(axis=(0, 2, 3)).mean())

    @cached_property
    def _whole_variation(self) -> float:
        values = self._variation().values
        return float(values.mean()) if len(values) else 0.0

    def _as_given(self) -> tuple[Pairs, Floats, Floats] | str:
        """Return another state's effect on raw answers, and both answers; else why none."""
        condition = f"swapped{OVER}{STATE}"
        frames = self._answered(condition)
        if isinstance(frames, str):
            return frames
        real, other = (self._motions.as_given(name)[:, frames] / self._motions.scales for name in ("real", condition))
        return self._between(condition, frames, real, other), real, other

    def reads(self) -> Statistic:
        """Return the share of raw places, not relative to the state, that goes with the state."""
        condition, given = f"swapped{OVER}{STATE}", self._as_given()
        frames = self._answered(condition)
        if isinstance(given, str) or isinstance(frames, str):
            return not_available(str(given))
        effect, real, other = given
        statistic = total_effect(effect, self._variation(), sampled=self._drawn)
        p = permutation_p(real, other, seed=key_seed("relabelling", "reads")) if self._drawn else None
        return self._net(self._counted(replace(statistic, p=p), condition), effect, frames, condition)

    def _counted(self, found: Statistic, *conditions: str) -> Share:
        """Return a statistic with the share of its condition's calls without a motion."""
        share = found if isinstance(found, Share) else of_kind(Share, found)
        lost = self._motions.lost(*conditions)
        return replace(share, lost=lost) if lost else share

    def _absent(self, condition: str) -> str:
        """Return why there is no answer at all under a condition."""
        plan = self._motions.plan
        if condition not in plan.conditions:
            return NOT_ASKED
        if counts := self._motions.fails_on.get(condition):
            return fails(condition, *counts)
        return NOT_FINISHED if any(plan.shows(condition, frame) for frame in plan.frames) else NOT_SHOWN

    def _answered(self, condition: str) -> Places | str:
        """Return the frames with answers both real and under a condition, or why none."""
        changed = self._motions.of(condition)
        if changed is None:
            return self._absent(condition)
        frames = self._whole(self._real, changed)
        return frames if len(frames) else NO_FRAMES

    def _between(self, condition: str, frames: Places, real: Floats, other: Floats) -> Pairs:
        """Return half the squared distance of two answers, the second under a condition."""
        owner = partner = self._episodes[frames]
        if condition.partition(OVER)[0] in PARTNERS:
            partner = self._motions.episodes_of(self._motions.partners(condition)[frames])
        return Pairs(squared_distance(real, other), owner, partner)

    def pairs(self, condition: str) -> tuple[Pairs, Pairs] | str:
        """Return a condition's effect and the variation; else why there is none."""
        frames, changed = self._answered(condition), self._motions.of(condition)
        if isinstance(frames, str) or changed is None:
            return str(frames)
        return self._between(condition, frames, self._real[:, frames], changed[:, frames]), self._variation()

    @cached_property
    def _by_bytes(self) -> Floats | None:
        """Return answers to nudged pictures (one value one level off) if they differ, else None."""
        found = self.total("nudged")
        if found.value is None or found.value < LEAST_NOISE or (found.p is not None and found.p > ALPHA):
            return None
        return self._motions.of("nudged")

    @cached_property
    def _sees_grey(self) -> bool:
        """Return whether nudged pictures are farther from grey ones than from their own originals.

        A policy that recognises pictures by their bytes alone knows neither nudged nor grey ones.
        """
        other, grey = self._by_bytes, self._motions.of("blank")
        if other is None or grey is None or not len(frames := self._whole(self._real, other, grey)):
            return False
        own, seen = self._episodes[frames], other[:, frames]
        apart, alone = (Pairs(squared_distance(seen, one[:, frames]), own, own) for one in (grey, self._real))
        statistic = share_beyond(apart, alone, self._variation())
        return statistic.ci is not None and statistic.ci[0] > USED

    def _net(self, found: Statistic, effect: Pairs, frames: Places, condition: str) -> Share:
        """Return a share whose lower end counts only what exceeds the effect of nudged pictures.

        The upper end stays: noise from the bytes shows neither use nor absence. If nudged pictures
        are no farther from grey ones than from the originals, the lower end is at most 0.
        """
        share = found if isinstance(found, Share) else of_kind(Share, found)
        if self._by_bytes is None or share.ci is None:
            return share
        kept = np.isin(frames, self._whole(self._by_bytes))
        places, own = frames[kept], self._episodes[frames[kept]]
        if not len(places):
            return replace(share, ci=(min(0.0, share.ci[0]), share.ci[1]))
        alone = Pairs(squared_distance(self._real[:, places], self._by_bytes[:, places]), own, own)
        beyond = share_beyond(effect, alone, self._variation())
        sees = self._sees_grey or condition.partition(OVER)[2] in {STATE, INSTRUCTION}
        low = beyond.ci[0] if beyond.ci is not None and sees else 0.0
        bytes_ = float(alone.values.mean()) / self._whole_variation
        return replace(share, ci=(min(low, share.ci[0]), share.ci[1]), bytes=bytes_)

    def total(self, condition: str) -> Statistic:
        """Return the share of the variation that changes under a condition; parts in ``detail``."""
        pairs, changed = self.pairs(condition), self._motions.of(condition)
        if isinstance(pairs, str) or changed is None:
            return not_available(str(pairs))
        frames = self._whole(self._real, changed)
        real, other = self._real[:, frames], changed[:, frames]
        found = total_effect(*pairs, sampled=self._drawn)
        if found.value is None:
            return found
        p = permutation_p(real, other, seed=key_seed("relabelling", condition)) if self._drawn else None
        some, others = self._others()
        columns = list(self._columns_of.values())
        parts = shares_of_parts(real, other, self._real[:, some], self._real[:, others], columns)
        by = {
            "by_dimension": dict(zip(self._columns_of, parts["dimension"], strict=True)),
            "by_step": list(parts["step"]),
        }
        apart = None
        if self._drawn:
            apart = dispersion_change(real, other, self._whole_variation, seed=key_seed("scatter", condition))
        size, size_p = apart or (None, None)
        found = replace(
            self._counted(found, condition),
            p=p,
            detail={**(found.detail or {}), **by},
            same=self._same(condition, frames),
            scatter=size,
            scatter_p=size_p,
            texts=self._texts(condition, frames) if condition == f"swapped{OVER}{INSTRUCTION}" else None,
        )
        carried = self._carried(frames, changed, pairs[0]) if (found.value or 0.0) < IGNORED else {}
        found = replace(found, carried=carried or None)
        return found if condition == "nudged" else self._net(found, pairs[0], frames, condition)

    def _texts(self, condition: str, frames: Places) -> list[str]:
        """Return the most frequent pair of own and exchanged instruction."""
        bank = self._motions.plan.bank
        column = instruction_column(bank) or ""
        own, theirs = (
            [str(bank.frames[place].fields.get(column, "")) for place in self._motions.partners(name)[frames]]
            for name in ("real", condition)
        )
        return list(Counter(zip(own, theirs, strict=True)).most_common(1)[0][0])

    def _carried(self, frames: Places, changed: Floats, effect: Pairs) -> dict[str, float]:
        """Return the dimensions and steps whose own share is too large for "ignored".

        Listed are parts whose lower end is above the margin of use. A part must vary at least as
        much as one of the log does, since one that hardly moves can have any share. A part whose
        logged spread comes from a few frames is compared with its own variation alone. So is one that
        counts in its own unit, unless it moves by no more than `ROUNDING` of that.
        """
        some, others = self._others()
        went = half_products(self._real[:, frames], changed[:, frames])
        varies = half_products(self._real[:, some], self._real[:, others])
        parts = {
            name: (went[..., many].sum(axis=-1), varies[..., many].sum(axis=-1))
            for name, many in self._columns_of.items()
        }
        parts |= {f"step {step + 1}": (went[:, step], varies[:, step]) for step in range(went.shape[1])}
        result: dict[str, float] = {}
        least = dict.fromkeys(self._motions.unscaled, ROUNDING**2)
        least |= dict.fromkeys(rare(self._motions.plan.bank) - {*chain.from_iterable(self._far.values())}, 0.0)
        for name, (less, more) in parts.items():
            of, over = less.mean(axis=1), more.mean(axis=1)
            if len(over) and over.mean() > least.get(name, CONSTANT) and of.mean() >= IGNORED * over.mean():
                whole = Pairs(over, self._episodes[some], self._episodes[others])
                statistic = total_effect(Pairs(of, effect.owner, effect.partner), whole, sampled=self._drawn)
                if statistic.value is not None and statistic.ci is not None and statistic.ci[0] > USED:
                    result[name] = statistic.value
        return result

    def shapley(self) -> dict[str, Statistic]:
        """Return each channel's Shapley share of the variation; they add up to 1.

        The worth of a subset is half the squared distance between the frame's answer and the answer
        with that subset from the frame's partner. The worth of all channels uses the partner's own
        answer.
        """
        every = subset_conditions(self._motions.plan.bank)
        if not every or not set(every.values()) <= set(self._motions.plan.conditions):
            return {}
        names = sorted(frozenset().union(*every))
        answers = {some: self._motions.of(name) for some, name in every.items()}
        given = {some: answer for some, answer in answers.items() if answer is not None}
        if len(given) < len(every):
            return {f"shapley.{name}": not_available(NOT_ASKED) for name in names}
        frames, others = self._pictures_of(np.isin(np.arange(self._real.shape[1]), self._whole(*given.values())))
        if not len(frames):
            return {f"shapley.{name}": not_available(NO_FRAMES) for name in names}
        real = self._real[:, frames]
        worth = {some: squared_distance(real, one[:, frames]) for some, one in given.items()}
        worth[frozenset(names)] = squared_distance(real, self._real[:, others])
        owner, partner = self._episodes[frames], self._episodes[others]
        whole = Pairs(worth[frozenset(names)], owner, partner)
        return {
            f"shapley.{name}": total_effect(Pairs(values, owner, partner), whole, signed=True)
            for name, values in shapley_values(worth).items()
        }

    def _pictures_of(self, good: npt.NDArray[np.bool_]) -> tuple[Places, Places]:
        """Return good frames whose partner has a real answer, and the partners' places."""
        plan = self._motions.plan
        at = {frame.id: place for place, frame in enumerate(plan.frames)}
        ids = [plan.bank.frames[place].id for place in self._motions.partners(f"swapped{OVER}{CAMERAS}")]
        places = np.array([at.get(one, NOBODY) for one in ids])
        there = np.isin(places, self._whole(self._real))
        frames = np.flatnonzero(good & there)
        return frames, places[frames]

    def responds(self, channel: str, claim: str) -> Statistic:
        """Return the share of episodes in which a channel carries `IGNORED` or more, with bounds.

        Each condition that the claim of absence needs counts. The bounds hold for all episodes from
        which these were drawn.
        """
        found = [self.pairs(one) for one in rests_on(claim, channel)]
        effects = [one[0] for one in found if not isinstance(one, str)]
        if channel == STATE and self._motions.plan.motions.kind in PLACES:
            effects = [] if isinstance(given := self._as_given(), str) else [given[0]]
        return share_bound(*responding(effects, self._variation(), IGNORED), confidence=SURENESS)

    def beyond(self, channel: str) -> Statistic:
        """Return the share with pictures at a similar state, less that with own-episode ones.

        If the latter is none, the rest may come from the small differences that the states still
        have.
        """
        matched, near = (self._motions.of(f"{name}@{channel}") for name in BY_STATE)
        if matched is None or near is None:
            return not_available(self._absent(f"{BY_STATE[matched is not None]}@{channel}"))
        frames = self._whole(self._real, matched, near)
        if not len(frames):
            return not_available(NO_FRAMES)
        short, still = own_pictures(self._motions.plan.bank, channel, self._motions.partners("real")[frames])
        if short:
            return not_available(short, len(frames))
        real, own = self._real[:, frames], self._episodes[frames]
        theirs = self._motions.episodes_of(self._motions.partners(f"matched@{channel}")[frames])
        alike = Pairs(squared_distance(real, matched[:, frames]), own, theirs)
        found = share_beyond(alike, Pairs(squared_distance(real, near[:, frames]), own, own), self._variation())
        found = self._counted(found, *(f"{name}@{channel}" for name in BY_STATE))
        return replace(found, still=still) if still else found

    def alike(self, channel: str) -> Statistic:
        """Return the share with any other episode's pictures, on frames that have a match by state.

        It is the baseline of the matched share, on the same frames.
        """
        matched, swapped = (self._motions.of(f"{name}@{channel}") for name in ("matched", "swapped"))
        if matched is None or swapped is None:
            return not_available(next(self._absent(f"{name}@{channel}") for name in ("matched", "swapped")))
        frames = self._whole(self._real, matched, swapped)
        if not len(frames):
            return not_available(NO_FRAMES)
        real, other = self._real[:, frames], swapped[:, frames]
        theirs = self._motions.episodes_of(self._motions.partners(f"swapped@{channel}")[frames])
        effect = Pairs(squared_distance(real, other), self._episodes[frames], theirs)
        found = total_effect(effect, self._variation(), sampled=self._drawn)
        p = permutation_p(real, other, seed=key_seed("relabelling", "alike", channel)) if self._drawn else None
        found = self._counted(replace(found, p=p), f"matched@{channel}", f"swapped@{channel}")
        return self._net(found, effect, frames, f"swapped@{channel}")

    def follow(self, which: tuple[str, ...]) -> Statistic:
        """Return how far the answer follows a moved object; of two, how much farther the first."""
        gains, full = self._gains(which[0])
        if gains is None:
            return self._unmoved(which[:1])
        heading, parts = None, None
        if len(which) > 1:
            less, _ = self._gains(which[1])
            if less is None:
                return self._unmoved(which[1:])
            gains = gains - less
            parts = dict(self._parts(which, gains, full))
        else:
            heading = self._heading(which[0], gains)
        found = of_kind(FollowedShare, self._followed(gains, full), heading=heading, parts=parts)
        return self._counted(found, *(name for name in MOVES if name.startswith(which)))

    def _parts(self, which: Sequence[str], gains: Floats, full: Floats) -> Iterator[tuple[str, dict[str, float]]]:
        """Yield how much farther the first of two objects is followed, by instruction and by axis.

        Instructions count from three episodes on, if there are two such instructions. An axis is a
        share of its part of the oracle's way. With fewer than six episodes, ``at_most`` is the
        upper end (.99), else the share itself.
        """
        plan = self._motions.plan
        column, good = instruction_column(plan.bank) or "", np.isfinite(gains) & np.isfinite(full)
        texts: dict[object, list[int]] = {}
        for place in np.flatnonzero(good).tolist():
            texts.setdefault(instruction_key({column: plan.frames[place].fields.get(column, "")}), []).append(place)
        for places in texts.values() if len(texts) > 1 else ():
            if (part := self._part(gains[places], full[places], self._episodes[places])) is not None:
                yield f"told {quote(plan.frames[places[0]].fields.get(column, ''))}", part
        first, second = (self._along(name) for name in which)
        length = sum((self._way(which[0], axis) ** 2 for axis in first or ()), np.zeros(len(gains)))
        for axis in first or () if second is not None else ():
            of = full * self._way(which[0], axis) ** 2 / np.where(length > 0, length, 1.0)
            apart = (first or {})[axis] - (second or {})[axis]
            own = good & np.isfinite(of) & np.isfinite(apart)
            if of[own].sum() > _LEAST_PART * full[own].sum():
                part = self._part(apart[own], of[own], self._episodes[own])
                yield from [(f"along {axis}", part)] if part is not None else ()

    def _part(self, gains: Floats, full: Floats, episodes: Places) -> dict[str, float] | None:
        """Return the share on a part of the frames and its upper end; None for too few episodes."""
        names, which = np.unique(episodes, return_inverse=True)
        count, whole = len(names), float(full.sum())
        if count < _LEAST_TOLD or whole <= 0:
            return None
        value = float(gains.sum()) / whole
        left = np.bincount(which, gains - value * full) / whole
        wide = 0.0 if count >= LEAST_EPISODES else t_quantile(LEVEL, count - 1) * (count / (count - 1)) ** 0.5
        return {"value": value, "at_most": value + wide * float(np.sqrt((left**2).sum())), "episodes": count}

    def _heading(self, which: str, gains: Floats) -> float | None:
        """Return the cosine between the way of an object and the way of the answer.

        It is taken over all frames and net of the noise of drawn answers, which has no direction:
        the sum of the projections, over the product of the lengths.
        """
        forth, back = (self._motions.raw(f"{which}_{side}") for side in ("plus", "minus"))
        if forth is None or back is None:
            return None
        far, long, space = np.zeros(len(gains)), np.zeros(len(gains)), self._motions.plan.motions
        for axis in space.axes:
            far += 2 * half_products(space.displacement(forth, axis), space.displacement(back, axis))
            long += self._way(which, axis) ** 2
        good = np.isfinite(gains) & np.isfinite(far) & np.isfinite(long)
        whole = float((far * long)[good].sum()) * int(good.sum())
        return float(gains[good].sum()) / whole**0.5 if whole > 0 else None

    def _way(self, which: str, axis: str) -> Floats:
        """Return how far an object was moved along an axis, by frame."""
        return np.array([_number(frame.truth.get(f"{which}_along_{axis}")) for frame in self._motions.plan.frames])

    def instruction_effect(self) -> Statistic:
        """Return how much farther the answer follows the named object than the other."""
        own = [self._gains(which) for which in OBJECTS]
        instructed = [self._gains(which, TOLD) for which in OBJECTS]
        (named, named_full), (other, other_full) = own
        (named_told, _), (other_told, _) = instructed
        if named is None or other is None or named_told is None or other_told is None:
            return self._unmoved(OBJECTS, TOLD)
        found = self._followed((named - other - named_told + other_told) / 2, (named_full + other_full) / 2)
        return self._counted(found, *MOVES, *(f"{TOLD}{name}" for name in MOVES))

    def logged(self) -> Statistic:
        """Return how much nearer its own instruction brings the answer to the log than another.

        It is a share of the difference of the two answers. 1: the answer matches the log; 0: the
        change is unrelated to the log.
        """
        condition = f"swapped{OVER}{INSTRUCTION}"
        changed, fit = self._motions.of(condition), self._motions.fit_to
        if changed is None:
            return not_available(self._absent(condition))
        frames = self._whole(self._real, changed, fit[None])
        own, other, logged = self._real[:, frames], changed[:, frames], fit[frames]
        if not len(frames):
            return not_available("no frame has both answers and a logged motion")
        errors = [((one.mean(axis=0) - logged) ** 2).mean(axis=(1, 2)) for one in (other, own)]
        full = 2 * squared_distance(own, other)
        found = follow(errors[0] - errors[1], full, self._episodes[frames], seed=key_seed("logged"))
        return self._counted(found, condition)

    def _unmoved(self, objects: Sequence[str], *prefixes: str) -> Statistic:
        """Return why objects are not known to be followed."""
        moves = [name for name in MOVES if name.startswith(tuple(objects))]
        names = [*moves, *(f"{head}{name}" for head in prefixes for name in moves)]
        failed = (name for name in names if name in self._motions.fails_on)
        return not_available(next((self._absent(name) for name in failed), NOT_ASKED))

    def _followed(self, gains: Floats, full: Floats) -> Statistic:
        good = np.isfinite(gains) & np.isfinite(full)
        return follow(gains[good], full[good], self._episodes[good], seed=key_seed("follow"))

    def _gains(self, which: str, prefix: str = "") -> tuple[Floats | None, Floats]:
        """Return each frame's gain along the object's way, moved forth over back, and the oracle's.

        NaN if there is no answer.
        """
        full = np.array([_number(frame.truth.get(f"{which}_follow")) for frame in self._motions.plan.frames])
        along = self._along(which, prefix)
        return (None if along is None else sum(along.values(), np.zeros(len(full)))), full

    def _along(self, which: str, prefix: str = "") -> dict[str, Floats] | None:
        """Return the motion with the object forth less back, by axis; None if not run."""
        forth, back = (self._motions.raw(f"{prefix}{which}_{side}") for side in ("plus", "minus"))
        space = self._motions.plan.motions
        if forth is None or back is None or not space.axes:
            return None
        apart = forth.mean(axis=0) - back.mean(axis=0)
        return {axis: self._way(which, axis) * space.displacement(apart, axis) for axis in space.axes}

    def mirror(self) -> Statistic:
        """Return the distance of the mirrored moment's answer from the reflected one; 0 fits."""
        changed, space = self._motions.of("mirrored"), self._motions.plan.motions
        if changed is None:
            return not_available(self._absent("mirrored") if "mirrored" in self._motions.fails_on else NOT_ASKED)
        frames = self._whole(self._real, changed)
        if not len(frames):
            return not_available(NO_FRAMES)
        scales = self._motions.scales
        expected = space.reflect_relative(self._real[:, frames] * scales) / scales
        owner = self._episodes[frames]
        values = squared_distance(expected, changed[:, frames])
        return total_effect(Pairs(values, owner, owner), self._variation(), sampled=self._drawn)


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else np.nan
