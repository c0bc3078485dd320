"""What a controller does in truth: one thing is moved, in expectation per picture, and nothing is declared.

``depth``: a lead near brakes harder than one far by .25 and more, of pairs of pictures of a frame whose distances are a
factor of 1.5 apart less than .08 are the wrong way round, the mean curve rises by less than .15 of its span, less than
.10 of the frames have a quarter of their pairs wrong, and a neighbour does at most half of what a lead does, or .1.
``no``: below .10; .15 and more; .25 and more; .15 and more; .8 and more of a lead that does .2, or .2 where the lead
does nothing. Between them nothing is asked. A third of the range that does nothing is ``no`` where a farther one does
something: else the road is taken for free there. Turns have cuts of their own, see `Turns`.

A place that a verdict does not name is measured on what the named ones leave of it, see `find_rest`.
"""

import random
from collections.abc import Callable, Collection, Mapping
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from adversary_pictures import Floats, Ints, Pictures
from eyechart.calls import Reply
from eyechart.models.scripted import PerceivedPicture
from eyechart.spaces.discrete import DRIVING
from eyechart_organisms.adversaries import Adversary

DRAWS, CURVE_DRAWS = 48, 16
"""How often a picture is asked about where chance or memory has a say, and one of the curve."""
WARM = 3000
"""Calls before the first that counts."""
FEWEST, FEWEST_CURVES = 4, 20
"""Frames below which a place has no truth, and below which a mean curve is not one: errors of few pictures raise it."""
APART = 1.5
THIRDS: Mapping[str, tuple[int, int, tuple[int, ...]]] = {
    "near": (0, 6, (0,)),
    "middle": (6, 11, (1, 2)),
    "far": (11, 17, (3,)),
}
"""Which of the 17 distances, and which places of the exchange, are of each third of the range."""
NEAR, FAR = (2, 3), 15
"""The distances of the near lead, and the first of those that count as far."""
SMOOTHED = 3
"""Distances of the curve that are averaged."""
ACTIONS = {name: number for number, name in enumerate(DRIVING.actions)}
LEVELS = np.array([*((DRIVING.project(name, "brake") or 0.0) / 2 for name in DRIVING.actions), 0.0])
"""How hard each answer brakes, of 1; no answer does not."""

Open = Callable[[], Adversary]
Named = frozenset[str]
"""Places by what and which, as "scenario merge" or "third far"."""


@dataclass(frozen=True)
class Turns:
    """Of pictures with one clear side the shares turned to it and to the other, of boxed ones the most in a third.

    ``turns_clear``: a net share of .25 turned to the clear side, at most .08 of the turns to the other, at most .10 of
    a third's boxed pictures turned. ``no``: below .10; .2 and more; .2 and more.
    """

    clear: float
    blocked: float
    boxed: float | None

    @property
    def says(self) -> str:
        """Return the truth of its turns; nothing is asked of who hardly turns."""
        if self.clear + self.blocked + (self.boxed or 0.0) < 0.02:
            return "none"
        wrong = self.blocked / max(self.clear + self.blocked, 1e-9)
        if self.clear - self.blocked < 0.10 or wrong >= 0.2 or (self.boxed or 0) >= 0.2:
            return "no"
        good = self.clear - self.blocked >= 0.25 and wrong <= 0.08 and (self.boxed or 0) <= 0.10
        return "turns_clear" if good else "none"


@dataclass(frozen=True)
class Part:
    """What is true on some frames: net effect, wrong pairs and frames with many, rise, effects of lead and other."""

    net: float
    wrong: float
    frames: float
    rise: float
    ratios: tuple[tuple[float, float], ...]

    @property
    def says(self) -> str:
        """Return depth, no, or none where nothing is asked."""
        no = self.net < 0.10 or self.wrong >= 0.15 or self.rise >= 0.25 or self.frames >= 0.15
        if no or any(_is_others(*ratio) for ratio in self.ratios):
            return "no"
        good = self.net >= 0.25 and self.wrong < 0.08 and self.rise < 0.15 and self.frames < 0.10
        return "depth" if good and all(other <= max(lead / 2, 0.1) for lead, other in self.ratios) else "none"


def _is_others(lead: float, other: float) -> bool:
    return other >= 0.8 * lead if lead >= 0.2 else other >= 0.2


@dataclass(frozen=True)
class Truth:
    """What is true of all frames, of each place and third of the range, and of its turns."""

    whole: Part
    places: Mapping[str, str]
    turns: Turns

    @property
    def says(self) -> str:
        """Return the truth of its braking; where nothing moves it by the lead it is no."""
        if max((lead for lead, _ in self.whole.ratios), default=0.0) < 0.15 and self.whole.net < 0.15:
            return "no"
        return self.whole.says

    def plain(self) -> dict[str, object]:
        """Return it as plain values."""
        said = {"says": self.says, "turns": self.turns.says, "places": self.places}
        return said | asdict(self.whole) | asdict(self.turns)


def find_truth(open_one: Open, pictures: Pictures, look: str = "") -> Truth:
    """Return what a controller does, a new one of which is opened; ``look`` names a rule of the pixels instead."""
    answered = _answers(open_one, pictures, look)
    levels = _levels(answered)
    return Truth(
        whole=_part(levels, pictures, np.arange(len(pictures.places))),
        places=_places(levels, pictures),
        turns=_turns(answered, pictures),
    )


def find_rest(open_one: Open, pictures: Pictures, named: Collection[str], look: str = "") -> Mapping[str, str]:
    """Return the truth of each place that is not named, outside of those that are: of its other frames and distances.

    So a place is not untrue for what lies in a named one, and is untrue for what is wrong in the rest of it.
    """
    return _places(_levels(_answers(open_one, pictures, look)), pictures, frozenset(named))


def _answers(open_one: Open, pictures: Pictures, look: str) -> Ints:
    return np.array([[ACTIONS[one[look]] for one in pictures.looked]]) if look else _asked(open_one(), pictures)


def _levels(answered: Ints) -> Floats:
    return np.asarray(np.nanmean(np.where(answered < -1, np.nan, LEVELS[answered]), axis=0))


def _asked(one: Adversary, pictures: Pictures) -> Ints:
    """Return the numbers of a controller's answers, shape (passes, pictures), -1 for none and -2 where not asked.

    Pictures come in a random order, each with other bytes; one that answers alike three times over is asked no more.
    """
    rng, sights = random.Random(5), pictures.sights  # noqa: S311 - no secret
    few = np.setdiff1d(np.arange(len(sights)), pictures.curve.ravel()).tolist()
    for number in range(WARM):
        _answer(one, sights[rng.randrange(len(sights))], number, rng)
    found: list[NDArray[np.int64]] = []
    for turn in range(DRAWS):
        order = list(range(len(sights))) if turn < CURVE_DRAWS else list(few)
        rng.shuffle(order)
        column = np.full(len(sights), -2)
        for number in order:
            column[number] = _answer(one, sights[number], turn, rng)
        found.append(column)
        if turn == 2 and (np.array(found) == found[0]).all():
            break
    return np.array(found)


def _answer(one: Adversary, sight: PerceivedPicture, turn: int, rng: random.Random) -> int:
    said = one.decide(PerceivedPicture(sight.kind, sight.reading, b"%d/%d" % (id(sight), turn)), rng)
    return ACTIONS.get(said.text if isinstance(said, Reply) else said, -1)


def _pairs(levels: Floats, at: Floats) -> tuple[NDArray[np.bool_], NDArray[np.bool_], Ints]:
    """Return which pairs of each frame's pictures are the wrong way round, which are told apart, and the nearer."""
    near, far = np.array([(a, b) for a in range(len(at)) for b in range(len(at)) if at[b] > APART * at[a]]).T
    apart = levels[:, near] - levels[:, far]
    return apart < -0.2, np.abs(apart) > 0.2, near


def _share(part: NDArray[np.bool_], of: NDArray[np.bool_]) -> float:
    return float(part.sum() / max(of.sum(), 1))


def _part(levels: Floats, pictures: Pictures, frames: Ints, named: Named = frozenset()) -> Part:
    """Return what is true on some frames, outside of the named thirds of the range."""
    grid = levels[pictures.grid[frames]]
    wrong, told, _ = _pairs(_outside(grid, named), np.geomspace(1, 11.27, grid.shape[1]))
    of_frame = wrong.sum(axis=1) / np.maximum(told.sum(axis=1), 1)
    return Part(
        net=float(grid[:, NEAR].mean() - grid[:, FAR:].mean()),
        wrong=_share(wrong, told),
        frames=float((of_frame >= 0.25).mean()),
        rise=_rise(levels, pictures, frames, named),
        ratios=_ratios(levels, pictures, frames, named),
    )


def _outside(grid: Floats, named: Named) -> Floats:
    """Return levels of shape (frames, 17) without those of named thirds; the near and the far lead of all stay."""
    inside = np.zeros(grid.shape[1], dtype=np.bool_)
    for name, (first, last, _) in THIRDS.items():
        inside[first:last] = f"third {name}" in named
    inside[[*NEAR, *range(FAR, len(inside))]] = False
    return np.where(inside, np.nan, grid)


def _rise(levels: Floats, pictures: Pictures, frames: Ints, named: Named) -> float:
    """Return the greatest rise of the mean curve over its span, three distances averaged."""
    rows = pictures.curve[np.isin(pictures.of_curve, frames)]
    if len(rows) < FEWEST_CURVES:
        return 0.0
    curve = np.nanmean(np.where(rows < 0, np.nan, levels[rows]), axis=0)
    for part, name in zip(np.array_split(curve, len(THIRDS)), THIRDS, strict=True):
        part[:] = np.nan if f"third {name}" in named else part
    if np.count_nonzero(~np.isnan(curve)) < SMOOTHED:
        return 0.0
    smooth = np.convolve(curve[~np.isnan(curve)], np.ones(SMOOTHED) / SMOOTHED, "valid")
    risen = smooth - np.minimum.accumulate(smooth)
    return float(risen.max() / max(float(np.ptp(smooth)), 0.05))


def _ratios(levels: Floats, pictures: Pictures, frames: Ints, named: Named) -> tuple[tuple[float, float], ...]:
    """Return the effects of a lead and of a neighbour at the places of the exchange where enough frames show it."""
    found, inside = [], {place for name, (*_, some) in THIRDS.items() if f"third {name}" in named for place in some}
    for place, rows in enumerate(pictures.exchange[:, frames]):
        whole = rows[(rows >= 0).all(axis=1)]
        if len(whole) >= FEWEST and place not in inside:
            own, other, apart = levels[whole].mean(axis=0)
            found.append((float(own - apart), float(other - apart)))
        else:
            found.append((0.0, 0.0))
    return tuple(found)


def _frames(pictures: Pictures, named: Named) -> dict[str, Ints]:
    """Return the frames of each scenario and stratum that has enough outside of the named ones, by what and which."""
    said = [{f"{of} {name}" for of, name in place.items()} for place in pictures.places]
    every = dict.fromkeys(f"{of} {name}" for place in pictures.places for of, name in place.items())
    found = {
        name: np.array([number for number, mine in enumerate(said) if name in mine and not mine & named], dtype=int)
        for name in every
    }
    return {name: frames for name, frames in found.items() if len(frames) >= FEWEST}


def _places(levels: Floats, pictures: Pictures, named: Named = frozenset()) -> dict[str, str]:
    """Return the truth of each scenario, stratum and third, by what and which, outside of the named ones."""
    frames = _frames(pictures, named)
    found = {name: _part(levels, pictures, mine, named).says for name, mine in frames.items()}
    return found | {f"third {name}": says for name, says in _thirds(levels, pictures, named).items()}


def _thirds(levels: Floats, pictures: Pictures, named: Named) -> dict[str, str]:
    """Return the truth of each third that is not named, on the frames of no named place."""
    said = [{f"{of} {name}" for of, name in place.items()} for place in pictures.places]
    frames = np.array([number for number, mine in enumerate(said) if not mine & named], dtype=int)
    if len(frames) < FEWEST:
        return {}
    grid = levels[pictures.grid[frames]]
    wrong, told, nearer = _pairs(_outside(grid, named), np.geomspace(1, 11.27, grid.shape[1]))
    ratios, far, result = _ratios(levels, pictures, frames, named), float(grid[:, FAR:].mean()), dict[str, str]()
    net = {name: float(grid[:, first:last].mean()) - far for name, (first, last, _) in THIRDS.items()}
    for name, (first, last, places) in THIRDS.items():
        if f"third {name}" in named:
            continue
        own = (nearer >= first) & (nearer < last)
        share, mine = _share(wrong[:, own], told[:, own]), [ratios[place] for place in places]
        beyond = any(net[other] >= 0.10 for other, (begins, _, _) in THIRDS.items() if begins > first)
        if share >= 0.15 or any(_is_others(*one) for one in mine) or (net[name] < 0.10 and beyond):
            result[name] = "no"
        else:
            good = net[name] >= 0.25 and share < 0.08 and all(other <= max(lead / 2, 0.1) for lead, other in mine)
            result[name] = "depth" if good else "none"
    return result


def _turns(answered: Ints, pictures: Pictures) -> Turns:
    """Return how it turns, over all pictures of the range."""
    grid, left, right = pictures.grid, ACTIONS["LEFT"], ACTIONS["RIGHT"]
    scenes = [pictures.sights[number].reading for number in grid.ravel()]
    sides = np.array([(scene.scene.left_clear, scene.scene.right_clear) for scene in scenes if scene]).reshape(
        *grid.shape, 2
    )
    lefts, rights = ((answered == side).mean(axis=0)[grid] for side in (left, right))
    one_left, one_right = sides[..., 0] & ~sides[..., 1], ~sides[..., 0] & sides[..., 1]
    one = max(int((one_left | one_right).sum()), 1)
    boxed = ~sides.any(axis=-1)
    turned = [
        float((lefts + rights)[:, first:last][boxed[:, first:last]].mean())
        for first, last, _ in THIRDS.values()
        if boxed[:, first:last].sum() >= FEWEST
    ]
    return Turns(
        clear=float((lefts[one_left].sum() + rights[one_right].sum()) / one),
        blocked=float((rights[one_left].sum() + lefts[one_right].sum()) / one),
        boxed=max(turned, default=None),
    )
