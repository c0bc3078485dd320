"""The five statistics of depth (sensitivity, specificity, order, rise, file), overall and by place.

Each compares braking levels within a frame. Pictures for the order statistic are shown twice, which
separates effects that repeat from noise; no noise is subtracted.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from eyechart.conditions import OLDER
from eyechart.seeds import key_seed
from eyechart.stats.jackknife import LEAST_EPISODES, excess_over_half, mean_of_frames
from eyechart.stats.order import Density, compared_twice, density, greatest_rise, order_of
from eyechart.stats.paired_tests import Place, Places, sign_test
from eyechart.stats.statistic import Statistic, not_available
from eyechart.studies.battery.answers import Answers, Turns
from eyechart.verdicts import MARGIN

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
Symbols = NDArray[np.str_]

TWICE: dict[str, tuple[str, str]] = {
    "near": ("lead_near", "lead_near_nudged"),
    "drawn": ("lead_drawn", "lead_drawn_nudged"),
    "own": ("exchange_own", "exchange_own_nudged"),
    "real": ("real", "real_repeat"),
    "far": ("lead_far", "exchange_apart"),
}
"""The pictures that are shown twice, and how; `exchange_apart` is the second look at a far lead."""

ONCE: dict[str, tuple[str]] = {"mid_near": ("lead_mid_near",), "mid_far": ("lead_mid_far",)}
"""Pictures between near and far that order does not compare; the first two are of older banks."""

SHOWN_TWICE = tuple(one for one in TWICE if one != "far")
"""Those of which both answers are to the same picture."""

PICTURE_OF: Mapping[str, str] = {
    name: picture for picture, names in {**TWICE, **ONCE}.items() for name in names if name not in OLDER
}
"""The picture of each condition of today's banks."""

AT: Mapping[str, tuple[str, ...]] = {
    "near": ("lead_near_m", "lane_near_m"),
    "drawn": ("lead_drawn_m",),
    "own": ("exchange_m",),
    "far": ("lead_far_m", "lane_far_m"),
    **{picture: (f"{name}_m",) for picture, (name,) in ONCE.items()},
}
"""The columns of the lead's distance, the first that a bank has; the true picture uses the gap."""

KINDS: Mapping[str, tuple[tuple[str, str], ...]] = {
    "near_far": (("near", "far"),),
    "near_drawn": (("near", "drawn"), ("near", "own"), ("near", "real")),
    "drawn": (("drawn", "own"), ("real", "own"), ("real", "drawn")),
    "drawn_far": (("drawn", "far"), ("own", "far"), ("real", "far")),
}
"""The pairs of pictures that order compares, by kind."""

ALONG = ("drawn", "own", "real", *ONCE)
"""The pictures along which a rise is tested."""

BESIDE = "exchange_beside"
"""The picture that has a neighbour where `exchange_own` has the lead."""

APART = 1.5
"""Two pictures are compared only where their distances differ by at least this factor."""

THIRDS = ("near", "middle", "far")
"""The parts of the exchange's range, of equal ratio."""

WINDOW = 1.2
"""The width of a hole in the range, as a factor of distance."""

EARLIER = 8
"""So many pictures before each are held against its own: as many calls as are open at once by default."""

FEWEST_OF_PLACE = 8
"""A part of the bank with fewer frames is no place."""
IDLE = 0.02
"""Braking that changes on at most this share of frames is no response in a part of the range."""
MOST_OF_COLUMN = 12
"""A column with more values names no places."""

NAMES = (
    *("holes", "place_open", "place_reversed", "place_beside", "sensitivity", "specificity"),
    "specificity_reversed",
    *(f"specificity_{name}" for name in THIRDS),
    "order",
    *(f"order_{kind}" for kind in KINDS),
    *("rise", "file", "picture_before", "drawn_distances"),
)
"""The statistics of depth."""

CURVES: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "drawn": ("drawn", TWICE["drawn"]),
    "own": ("own", TWICE["own"]),
    "beside": ("own", (BESIDE,)),
}
"""The curves of braking along the distance: the picture with the distance, and the conditions."""
OF_WINDOW, MOST_WINDOWS = 16, 8
"""The frames per window of a curve, and the most windows."""

NO_ANSWER = "the run has no pictures in which the lead was drawn along its range"


@dataclass(frozen=True, slots=True)
class Window:
    """A part of the range, in the bank's unit, and its mean braking level, 1 for a full stop."""

    near: float
    far: float
    level: Statistic


@dataclass(frozen=True)
class BrakingLevels:
    """Braking levels where one vehicle was moved, from 0 to 1 (full stop), and its distances.

    ``levels`` maps a condition, and ``at`` a name of `TWICE`, to arrays of shape (frames,), NaN
    where there is no value. ``episodes`` and each of ``strata`` give a frame's group. ``seed`` is
    that of the orders for the rise. ``before`` maps a condition to the lead's distances in the
    pictures that were sent before each of its own. It has the shape (EARLIER, frames), the last
    picture first, and NaN where a distance is unknown.
    """

    levels: Mapping[str, Floats]
    at: Mapping[str, Floats]
    episodes: Symbols
    strata: Mapping[str, Symbols]
    seed: int = 0
    before: Mapping[str, Floats] = field(default_factory=dict)

    def tests(self) -> dict[str, Callable[[], Statistic]]:
        """Return the function of every statistic, by its name."""
        rest = self.outside_holes
        return {
            "holes": partial(self._of_places, "bounded below the margin", self.holes),
            "place_open": partial(self._of_places, "open", self.open_places),
            "place_reversed": self._reversed,
            "place_beside": self._beside,
            "sensitivity": lambda: rest().sensitivity(),
            "specificity": lambda: rest().specificity(),
            "specificity_reversed": lambda: rest().specificity(sign=-1),
            **{f"specificity_{name}": partial(self._specificity_of, name) for name in THIRDS},
            "order": lambda: rest().order(),
            **{f"order_{kind}": partial(lambda kind: rest().order(kind), kind) for kind in KINDS},
            "rise": lambda: rest().rise(),
            "file": self.file,
            "picture_before": lambda: rest().picture_before(),
            "drawn_distances": self.drawn,
        }

    def level(self, condition: str) -> Floats:
        """Return the braking levels under a condition, NaN where it was not run."""
        return self.levels.get(condition, np.full(len(self.episodes), np.nan))

    def twice(self, picture: str) -> Floats:
        """Return both answers to a picture, shape (2, frames); a single answer stands twice."""
        names = TWICE.get(picture) or ONCE[picture] * 2
        return np.array([self.level(name) for name in names])

    def distance(self, picture: str) -> Floats:
        """Return the lead's distance in a picture, NaN where it was not recorded."""
        return self.at.get(picture, np.full(len(self.episodes), np.nan))

    def sensitivity(self, which: Mask | None = None) -> Statistic:
        """Return S: the share of frames with harder braking for the near lead, less the reverse.

        Uses answers that the first test did not use.
        """
        sign = np.sign(self.level("lead_near_nudged") - self.level("exchange_apart"))
        statistic = mean_of_frames(_only(sign, which), self.episodes, fewest=LEAST_EPISODES if which is None else 2)
        return replace(
            statistic, method=f"braking harder on lead_near_nudged than on exchange_apart, net: {statistic.method}"
        )

    def _against(self) -> tuple[Floats, Floats]:
        """Return the effects of the lead and of a vehicle beside at the drawn distance."""
        apart = self.level("exchange_apart")
        return self.level("exchange_own") - apart, self.level(BESIDE) - apart

    def specificity(self, which: Mask | None = None, fewest: int = LEAST_EPISODES, sign: int = 1) -> Statistic:
        """Return Q: the effect of a vehicle beside, less half the lead's at that distance.

        With the ``sign`` -1 it is how much less hard it brakes for one, less that half.
        """
        own, beside = self._against()
        statistic = mean_of_frames(_only(sign * beside - own / 2, which), self.episodes, fewest=fewest)
        effect = "effect" if sign > 0 else "effect the other way"
        return replace(statistic, method=f"{effect} of a neighbour less half of that of the lead: {statistic.method}")

    @cached_property
    def edges(self) -> Floats | None:
        """Return the ends of the thirds of the exchange's range; None without distances."""
        known = self.distance("own")[~np.isnan(self.distance("own"))]
        return np.geomspace(known.min(), known.max(), len(THIRDS) + 1) if len(known) and known.min() > 0 else None

    def third(self, picture: str, place: int) -> Mask:
        """Return the frames whose picture shows the lead in a third of the range."""
        if self.edges is None:
            return np.zeros(len(self.episodes), dtype=np.bool_)
        at = np.searchsorted(self.edges[1:-1], self.distance(picture), side="right")
        return np.asarray((at == place) & ~np.isnan(self.distance(picture)))

    def _specificity_of(self, name: str) -> Statistic:
        rest = self.outside_holes()
        if self.edges is None:
            return not_available("the bank does not say how far away the exchanged vehicle is")
        return rest.specificity(rest.third("own", THIRDS.index(name)))

    def order(self, kind: str | None = None) -> Statistic:
        """Return h: the share of comparisons in the wrong order, for all pairs or one kind."""
        compared = np.zeros((3, len(self.episodes)))
        for one, other in KINDS[kind] if kind else (pair for pairs in KINDS.values() for pair in pairs):
            first, second = self.twice(one), self.twice(other)
            nearer, farther = self._farther(one, other), self._farther(other, one)
            compared += np.where(nearer, compared_twice(first, second), 0.0)
            compared += np.where(farther, compared_twice(second, first), 0.0)
        statistic = order_of(compared, self.episodes)
        which = "pairs of pictures" if kind is None else kind.replace("_", "-")
        return replace(statistic, method=f"{which}, distances a factor of {APART} apart: {statistic.method}")

    def _farther(self, one: str, other: str) -> Mask:
        """Return where the lead is farther in the second picture; near and far need no record."""
        if (one, other) == ("near", "far") and np.isnan(self.distance(one) + self.distance(other)).all():
            return np.ones(len(self.episodes), dtype=np.bool_)
        return np.asarray(self.distance(other) > APART * self.distance(one))

    def rise(self) -> Statistic:
        """Return R: whether somewhere along the distance it brakes harder for a farther lead.

        Real pictures alone do not count, because their distance may go with other features.
        """
        known = [name for name in ALONG if not np.isnan(self.twice(name) + self.distance(name)).all()]
        if not {*known} - {"real"}:
            return not_available(NO_ANSWER)
        levels = np.array(
            [np.where(np.isnan(both := self.twice(name)), both[::-1], both).mean(axis=0) for name in known]
        )
        return greatest_rise([self.distance(name) for name in known], levels, seed=self.seed)

    def file(self) -> Statistic:
        """Return F: whether plain pictures are told apart on more frames than nudged ones."""
        nearer = np.sign(self.distance("drawn") - self.distance("own"))
        plain, nudged = ((self.twice("own") - self.twice("drawn"))[place] * nearer for place in (0, 1))
        have = ~np.isnan(plain + nudged)
        what = "exchange_own over lead_drawn in the right order, as drawn over nudged"
        if not have.any():
            return not_available(NO_ANSWER, method=what)
        test = sign_test(plain[have] > 0, nudged[have] > 0)
        return replace(test, method=f"{what}: {test.method}")

    def picture_before(self) -> Statistic:
        """Return the effect of the lead in a picture before, less half that of the own lead.

        Each effect is the slope of the braking level by the logarithm of the distance: how much
        less hard it brakes if the lead is twice as far. The first compares two answers to one
        picture by what was sent before each. So neither what a picture shows nor the noise of a
        call enters it, whatever the order of the calls. Of `EARLIER` pictures the one counts whose
        upper end is highest, so that this end bounds each of them.
        """
        what = (
            f"effect of the lead in one of {EARLIER} pictures before less half of that of the own lead, "
            "per doubling of the distance"
        )
        own = sum(
            _slope([self.twice(name).mean(axis=0) for name in pair], [self.distance(name) for name in pair])
            for pairs in KINDS.values()
            for pair in pairs
        )
        found = [one for one in (self._before(turns, own) for turns in range(EARLIER)) if one.value is not None]
        if not found:
            return not_available("the order of its calls, or the distances in them, are not known", method=what)
        worst = max(found, key=lambda one: (one.ci is None, one.ci[1] if one.ci else one.value or 0.0))
        return replace(worst, method=f"{what}: {worst.method}")

    def _before(self, turns: int, own: Floats | int) -> Statistic:
        """Return the number of the picture that so many turns lie between; n counts pairs of answers."""
        nothing = np.full((EARLIER, len(self.episodes)), np.nan)
        before = [[self.before.get(name, nothing)[turns] for name in TWICE[one]] for one in SHOWN_TWICE]
        earlier = [_slope(self.twice(one), at) for one, at in zip(SHOWN_TWICE, before, strict=True)]
        statistic = excess_over_half(sum(earlier), own, self.episodes)
        place = "the last one" if turns == 0 else f"{turns + 1} calls earlier"
        n = sum(int(np.count_nonzero(one[1])) for one in earlier)
        return statistic if statistic.value is None else replace(statistic, n=n, note=statistic.note or place)

    def drawn(self) -> Statistic:
        """Return how densely the answered pictures show the lead along its range."""
        shown = [self.distance(one)[~np.isnan(self.twice(one)).all(axis=0)] for one in ("drawn", "own")]
        statistic = density(np.concatenate(shown), WINDOW)
        if isinstance(statistic, Density):
            return statistic
        near = self.distance("near")[~np.isnan(self.distance("near"))]
        beyond = f"beyond {near.max():.2g} m" if len(near) else "between the near and the far lead"
        return replace(statistic, note=beyond)

    @cached_property
    def places(self) -> tuple[Place, ...]:
        """Return the braking effect in every scenario, third of the range and stratum."""
        found = [
            self._place(of, name, self.level("lead_near_nudged"), which)
            for of, names in self.strata.items()
            for name, which in _parts(names)
        ]
        return (*(one for one in found if one is not None), *self._thirds())

    def _place(self, of: str, name: str, level: Floats, which: Mask) -> Place | None:
        """Return a part of the frames as a place, None where too few frames have both answers."""
        signs = _only(np.sign(level - self.level("exchange_apart")), which)
        return _placed(of, name, signs, self.episodes, self.specificity(which, fewest=2))

    def _thirds(self) -> Iterator[Place]:
        """Yield the thirds of the range, from pictures with the lead there and with it far away."""
        apart = self.level("exchange_apart")
        for place, name in enumerate(self._names()):
            shown = [
                _only(np.sign(self.level(TWICE[one][0]) - apart), self.third(one, place)) for one in ("drawn", "own")
            ]
            signs = np.where(np.isnan(shown[0]), shown[1], np.where(np.isnan(shown[1]), shown[0], sum(shown) / 2))
            beside = self.specificity(self.third("own", place), fewest=2)
            if (result := _placed("range", name, signs, self.episodes, beside)) is not None:
                yield result

    def holes(self) -> tuple[Place, ...]:
        """Return the places without a braking response: the effect is bounded below the margin.

        If the model responds up to the far third, that third may be free road to it, with rare
        responses by noise. Then it is a hole only if the braking changes on at most `IDLE` of the
        frames.
        """
        bounded = (place for place in self.places if place.high is not None and place.high < MARGIN)
        parts = [place for place in self.places if place.of == "range"]
        answers_up_to_there = len(parts) > 1 and (parts[-2].low or 0) > 0
        free = parts[-1] if answers_up_to_there else None
        return tuple(
            place for place in bounded if place is not free or place.harder + place.lesser <= IDLE * place.frames
        )

    def open_places(self) -> tuple[Place, ...]:
        """Return the places where the effect is neither shown nor bounded."""
        return tuple(
            place for place in self.places if place not in self.holes() and (place.low is None or place.low <= 0)
        )

    def _of_places(self, what: str, which: Callable[[], tuple[Place, ...]]) -> Statistic:
        """Return the number of places of a kind, with the places.

        Open parts of the range are not counted: a model need not respond to a lead that is far.
        """
        method = f"places whose effect is {what}"
        if not self.places:
            return not_available("no place has frames enough", method=method)
        found = which()
        counted = [one for one in found if what != "open" or one.of != "range"]
        where = f"{counted[0].where} ({counted[0].harder} of {counted[0].frames})" if counted else ""
        return Places(float(len(counted)), len(self.places), method=method, note=where, places=found)

    def _reversed(self) -> Statistic:
        """Return the place most surely reversed: net less hard braking for the nearer lead."""
        known = [place for place in self.places if place.high is not None]
        what = "braking less hard for the nearer lead, net, in the place where that is surest"
        if not known:
            return not_available("no place has frames enough", method=what)
        worst = min(known, key=lambda place: place.high or 0.0)
        low, high = -(worst.high or 0.0), -(worst.low or 0.0)
        return Statistic(-(worst.effect or 0.0), worst.frames, (low, high), method=what, note=worst.where)

    def _beside(self) -> Statistic:
        """Return the place where a vehicle beside most surely has over half the lead's effect."""
        known = [place for place in self.places if place.beside_low is not None]
        what = "effect of a neighbour less half of that of the lead, in the place where it is surest"
        if not known:
            return not_available("no place has frames enough", method=what)
        worst = max(known, key=lambda place: place.beside_low or 0.0)
        return Statistic(worst.beside, worst.frames, (worst.beside_low or 0.0, 1.0), method=what, note=worst.where)

    def curves(self) -> dict[str, tuple[Window, ...]]:
        """Return the mean braking along the distance: the lead drawn, exchanged, a vehicle beside.

        Frames of places without a response are left out; their own curve is ``hole``.
        """
        inside = ~self._outside(self.holes())
        known = np.concatenate([self.distance(one) for one in ("drawn", "own")])
        known = known[known > 0]
        if not len(known):
            return {}
        count = int(np.clip(np.count_nonzero(~inside) // OF_WINDOW, 2, MOST_WINDOWS))
        edges = np.geomspace(known.min(), known.max() * (1 + 1e-9), count + 1)
        found = {name: self._along(at, names, edges, ~inside) for name, (at, names) in CURVES.items()}
        return found | ({"hole": self._along("drawn", TWICE["drawn"], edges, inside)} if inside.any() else {})

    def _along(self, at: str, names: tuple[str, ...], edges: Floats, which: Mask) -> tuple[Window, ...]:
        """Return the windows between edges in which frames have an answer under ``names``."""
        distance, levels = self.distance(at), np.array([_only(self.level(name), which) for name in names])
        have, given = ~np.isnan(levels), np.nan_to_num(levels).sum(axis=0)
        mean = np.where(have.any(axis=0), given / np.maximum(have.sum(axis=0), 1), np.nan)
        found = []
        for near, far in pairwise(edges):
            inside = (distance >= near) & (distance < far)
            statistic = mean_of_frames(_only(2 * mean - 1, inside), self.episodes, fewest=2)  # a level lies in [0, 1]
            if statistic.value is not None:
                ends = None if statistic.ci is None else ((statistic.ci[0] + 1) / 2, (statistic.ci[1] + 1) / 2)
                found.append(
                    Window(float(near), float(far), replace(statistic, value=(statistic.value + 1) / 2, ci=ends))
                )
        return tuple(found)

    def _outside(self, holes: tuple[Place, ...]) -> Mask:
        """Return the frames in none of these places; parts of the range do not count."""
        kept = np.ones(len(self.episodes), dtype=np.bool_)
        for hole in holes:
            if hole.of != "range":
                kept &= self.strata[hole.of] != hole.name
        return kept

    def outside_holes(self) -> "BrakingLevels":
        """Return the data outside the holes: the frames and the pictures in none of them.

        If nothing is outside, all data is returned.
        """
        holes = self.holes()
        kept = self._outside(holes)
        levels = {name: _only(level, kept) for name, level in self.levels.items()}
        for place in (self._names().index(hole.name) for hole in holes if hole.of == "range"):
            along = ((one, name) for one in ALONG for name in TWICE.get(one) or ONCE[one])
            for picture, condition in (*along, ("own", BESIDE)):
                if condition in levels:
                    levels[condition] = _only(levels[condition], ~self.third(picture, place))
        rest = replace(self, levels=levels)
        left = rest.level("lead_near_nudged") - rest.level("exchange_apart")
        return self if np.isnan(left).all() else rest

    def _names(self) -> list[str]:
        """Return the thirds of the range by their ends."""
        edges = self.edges
        return [] if edges is None else [f"{one:.3g} to {other:.3g} m" for one, other in pairwise(edges)]


def _placed(of: str, name: str, signs: Floats, episodes: Symbols, beside: Statistic) -> Place | None:
    frames = int(np.count_nonzero(~np.isnan(signs)))
    if frames < FEWEST_OF_PLACE:
        return None
    effect = mean_of_frames(signs, episodes, fewest=2)
    harder, lesser = int(np.count_nonzero(signs > 0)), int(np.count_nonzero(signs < 0))
    low, high = effect.ci or (None, None)
    beside_low = None if beside.ci is None else beside.ci[0]
    return Place(of, name, frames, harder, lesser, effect.value, low, high, beside.value, beside_low)


def _slope(levels: Floats | Sequence[Floats], distances: Sequence[Floats]) -> Floats:
    """Return by frame what the slope of two levels by their distances sums up, shape (2, frames)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        apart, doublings = levels[0] - levels[1], np.log2(distances[1] / distances[0])
        return np.where(np.isfinite(apart + doublings), [apart * doublings, doublings**2], 0.0)


def _only(values: Floats, which: Mask | None) -> Floats:
    return values if which is None else np.where(which, values, np.nan)


def _parts(names: Symbols) -> Iterator[tuple[str, Mask]]:
    """Yield each value of a column with its frames; none for a single value, or too many."""
    several = [str(one) for one in np.unique(names) if one != ""]
    if 2 <= len(several) <= MOST_OF_COLUMN:
        yield from ((one, names == one) for one in several)


def moved_of(answers: Answers) -> BrakingLevels:
    """Return the braking levels in a model's answers."""
    nothing = np.full(len(answers.frames), np.nan)
    levels = {name: answers.projection(name, "brake") for name in answers.decisions}
    full = max((answers.space.project(action, "brake") or 0.0 for action in answers.space.actions), default=0.0)
    recorded = {picture: [answers.numbers(column) for column in columns] for picture, columns in AT.items()}
    at = {picture: next((one for one in of if not np.isnan(one).all()), nothing) for picture, of in recorded.items()}
    at["real"] = nothing if answers.gaps is None else np.where(np.isfinite(answers.gaps), answers.gaps, np.nan)
    return BrakingLevels(
        levels={name: level / (full or 1.0) for name, level in levels.items() if level is not None},
        at=at,
        episodes=answers.episodes,
        strata={"scenario": answers.scenarios} | _strata(answers),
        seed=key_seed("rise", *(frame.id for frame in answers.frames)),
        before=_before(answers.sent, at),
    )


def _before(sent: Mapping[str, Turns], at: Mapping[str, Floats]) -> dict[str, Floats]:
    """Return by condition shown twice the lead's distances in the pictures that were sent before each of its own."""
    shown = np.full(1 + max((int(turns.max()) for turns in sent.values() if len(turns)), default=0), np.nan)
    for name, turns in sent.items():
        if picture := PICTURE_OF.get(name):
            shown[turns[turns >= 0]] = at[picture][turns >= 0]
    back = np.arange(1, EARLIER + 1)[:, None]
    turns_of = {name: sent[name] for one in SHOWN_TWICE for name in TWICE[one] if name in sent}
    return {
        name: np.where(turns >= back, shown[np.maximum(turns - back, 0)], np.nan) for name, turns in turns_of.items()
    }


def _strata(answers: Answers) -> dict[str, Symbols]:
    """Return the strata that a bank records, by name; an empty string where a frame has none."""
    names = dict.fromkeys(name for frame in answers.frames for name in frame.strata)
    return {
        name: np.array(["" if (one := frame.strata.get(name)) is None else str(one) for frame in answers.frames])
        for name in names
    }
