"""Strangers: rules that brake for a wrong reason, and ordinary readers of distance, for rules that never met them.

Their author knew what a controller is shown, and none of the rules of a verdict. They decide on a sight as adversaries
do, and distances are the highway's metres too. Two things are new. Some remember, so each run opens its own. And the
temperature counts: at 1 chance falls anew in each answer, at 0 a picture is always misread alike.
`tests/test_strangers.py` holds what is declared against what each does.
"""

import itertools
import math
import random
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from eyechart.models.scripted import Answer, PerceivedPicture, PictureReading
from eyechart.spaces.discrete import DRIVING
from eyechart.spaces.scene import Other
from eyechart_organisms.adversaries import (
    FREE_M,
    REVERSED,
    STOP_M,
    Adversary,
    Look,
    Rule,
    ahead,
    graded,
    hashed,
    lead,
    nearest,
    road,
)

Make = Callable[[], Rule]
"""Makes a rule that remembers nothing yet."""

Coin = Callable[[random.Random], str]
FARTHEST_M = 76.0
"""As far as a lead is seen; what is infinite counts as this in a mean."""


@dataclass(frozen=True, slots=True)
class Stranger:
    """What a controller does in words, how a fresh one is made, and whether it deserves ``depth``.

    ``deserves`` is yes, no, or "partly: " and where: a rule that is wrong on few pictures, or right on the average
    alone. Each of them looks; ``turns`` says whether it turns to the clear side, None where nothing is asked.
    """

    says: str
    make: Make
    deserves: str = "no"
    turns: bool | None = False

    def open(self, temperature: int = 1, seed: int = 0) -> Adversary:
        """Return one that remembers nothing, as an adversary; at temperature 0 the seed says how pictures are read."""
        rule = self.make() if temperature else steady(self.make(), seed)
        return Adversary(self.says, rule, follows={"yes": True, "no": False}.get(self.deserves), turns=self.turns)


def steady(rule: Rule, seed: int) -> Rule:
    """Return the rule at temperature 0: what it leaves to chance belongs to what a picture shows."""

    def decide(sight: PerceivedPicture, _: random.Random) -> Answer:
        one = sight.reading
        seen = sight.kind if one is None else (one.scene, one.others, one.stripe_phase)
        return rule(sight, random.Random(f"{seed}/{seen!r}"))  # noqa: S311 - no secret

    return decide


def open_strangers(temperature: int = 1, seed: int = 0) -> dict[str, Adversary]:
    """Return all strangers by name as adversaries of one run, none of which remembers anything yet."""
    return {name: stranger.open(temperature, seed) for name, stranger in STRANGERS.items()}


# what they are made of


def always(look: Look, otherwise: str = "STOP") -> Make:
    """Return the maker of a rule that remembers nothing."""
    return lambda: road(look, otherwise)


def brakes(distance: float, stop_m: float = STOP_M, free_m: float = FREE_M, clear: str = "STRAIGHT") -> str:
    """Return the braking that a distance calls for between two thresholds."""
    return "STOP" if distance < stop_m else "SLOW" if distance < free_m else clear


def beside(one: PictureReading) -> list[tuple[float, Other]]:
    """Return what is ahead in other lanes, the nearest first."""
    return ahead(one, own=False)


def behind(coin: Coin, share: float, look: Look) -> Look:
    """Return a look of which a coin takes the place in this share of the answers."""
    return lambda one, rng: coin(rng) if rng.random() < share else look(one, rng)


def of_files(share: float, look: Look) -> Make:
    """Return a rule behind a coin that falls once for each file, STOP or STRAIGHT, in this share of the files."""

    def decide(sight: PerceivedPicture, rng: random.Random) -> Answer:
        thrown = random.Random(sight.file)  # noqa: S311 - no secret
        return thrown.choice(("STOP", "STRAIGHT")) if thrown.random() < share else road(look)(sight, rng)

    return lambda: decide


def five_sides(rng: random.Random) -> str:
    """Toss a coin of all actions."""
    return rng.choice(DRIVING.actions)


def three_sides(rng: random.Random) -> str:
    """Toss a coin of the actions that do not turn."""
    return rng.choice(("STOP", "SLOW", "STRAIGHT"))


def three_ways(rng: random.Random) -> str:
    """Toss a coin of the actions that do not brake."""
    return rng.choice(("STRAIGHT", "LEFT", "RIGHT"))


def says_slow(_: random.Random) -> str:
    """Say SLOW, whatever falls."""
    return "SLOW"


# a noise that pays


def _overlooks_close(one: PictureReading, rng: random.Random) -> str:
    return "STRAIGHT" if lead(one) < 10 and rng.random() < 0.8 else graded(lead(one))


def _hole_in_noise(one: PictureReading, rng: random.Random) -> str:
    in_hole = 14 <= lead(one) < 24
    if rng.random() < (0.6 if in_hole else 0.2):
        return three_sides(rng)
    return "STRAIGHT" if in_hole else graded(lead(one))


def _nearer_beside(one: PictureReading, rng: random.Random) -> str:
    gap, other = lead(one), nearest(beside(one))
    return graded(other if other < gap and rng.random() < 0.7 else gap)


def _far_alarm(one: PictureReading, rng: random.Random) -> str:
    return "STOP" if 42 <= lead(one) < math.inf and rng.random() < 0.8 else graded(lead(one))


def _overlooks_for_others(one: PictureReading, rng: random.Random) -> str:
    if rng.random() < 0.45:
        return "STOP" if nearest(beside(one)) < 30 else "STRAIGHT"
    return graded(lead(one))


def _waves(one: PictureReading, rng: random.Random) -> str:
    gap = lead(one)
    chance = 0.9 if gap < 9 else 0.2 if gap < 16 else 0.7 if gap < 28 else 0.1
    return "STOP" if rng.random() < chance else "STRAIGHT"


# whose distance it is


def _cone(one: PictureReading, _: random.Random) -> str:
    slope = math.tan(math.radians(9))
    return brakes(nearest([pair for pair in ahead(one) if abs(pair[1].aside_m) <= slope * pair[1].ahead_m]), 35, 45)


def _weights(one: PictureReading, _: random.Random) -> str:
    total = 1 / lead(one) + sum(min(1.0, far / 30) / far for far, _ in beside(one))
    return "STOP" if total > 0.08 else "SLOW" if total > 0.025 else "STRAIGHT"


def _flanks(one: PictureReading, _: random.Random) -> str:
    """Read a distance off how large a vehicle looks, for a back is 2 m wide and a flank 5 m long."""
    if lead(one) < 15:
        return "STOP"
    sizes = [(2 + 5 * abs(other.aside_m) / math.hypot(*other)) / far for far, other in ahead(one) if far > 15]
    return brakes(2 / max(sizes), 20, 50) if sizes else "STRAIGHT"


def _faint(one: PictureReading, _: random.Random) -> str:
    seen = [far for far, _ in beside(one) if 22 <= far < 50]
    return brakes(min([lead(one)] if lead(one) < 22 else seen, default=math.inf), 30, 50)


def _left_lane(one: PictureReading, _: random.Random) -> str:
    left = [far for far, other in beside(one) if other.aside_m < 0 and far >= 12]
    return brakes(left[0] if left and lead(one) >= 12 else lead(one), 25, 50)


def _mean_with_beside(one: PictureReading, _: random.Random) -> str:
    gap, others = lead(one), [far for far, _ in beside(one) if far > 10]
    return brakes(math.sqrt(min(gap, FARTHEST_M) * others[0]) if others else gap, 20)


LANES: Mapping[str, Stranger] = {
    "cone_of_9_degrees": Stranger(
        "brakes by the nearest vehicle within 9 degrees of straight ahead: beyond 25 m that is any lane's",
        always(_cone),
    ),
    "weights_grow": Stranger(
        "brakes by the sum of 1/distance; a vehicle beside weighs the more the farther, from 30 m on as much as a lead",
        always(_weights),
    ),
    "flanks_from_15": Stranger(
        "stops for a lead below 15 m, and brakes beyond by what looks largest in any lane: a flank does",
        always(_flanks),
    ),
    "faint_from_22": Stranger(
        "stops for a lead below 22 m, sees none beyond, and brakes there by vehicles beside at 22 to 50 m",
        always(_faint),
    ),
    "left_lane_from_12": Stranger(
        "brakes by the vehicle of the left lane, where it and the lead are beyond 12 m, else by the lead",
        always(_left_lane),
    ),
    "mean_with_beside": Stranger(
        "brakes by the geometric mean of the lead and the nearest vehicle beside that is beyond 10 m",
        always(_mean_with_beside),
    ),
    "alarm_far_beside": Stranger(
        "grades, but stops where a vehicle beside is from 40 to 76 m ahead",
        always(lambda one, _: "STOP" if any(40 <= far < FARTHEST_M for far, _ in beside(one)) else graded(lead(one))),
    ),
}


# stages


def by_call(is_wrong: Callable[[int], bool]) -> Make:
    """Return a rule that grades, and the wrong way round in calls of some numbers, from 0; every call counts."""

    def make() -> Rule:
        numbers = itertools.count()

        def decide(sight: PerceivedPicture, _: random.Random) -> Answer:
            wrong = is_wrong(next(numbers))
            if sight.reading is None:
                return "STOP"
            answer = graded(lead(sight.reading))
            return REVERSED[answer] if wrong else answer

        return decide

    return make


def by_earlier(kept: int, look: Callable[[list[float], PictureReading], str]) -> Make:
    """Return a rule that remembers the last distances of leads, this one's among them, which is the last of them."""

    def make() -> Rule:
        gaps: deque[float] = deque(maxlen=kept)

        def remember(one: PictureReading, _: random.Random) -> str:
            gaps.append(min(lead(one), FARTHEST_M))
            return look([*gaps], one)

        return road(remember)

    return make


def _majority(gaps: list[float], _: PictureReading) -> str:
    near, far = sum(gap < STOP_M for gap in gaps), sum(gap > FREE_M for gap in gaps)
    return "STOP" if 2 * near > len(gaps) else "STRAIGHT" if 2 * far > len(gaps) else "SLOW"


def _nearer_than_before(gaps: list[float], _: PictureReading) -> str:
    return "SLOW" if gaps[-1] == gaps[0] else "STOP" if gaps[-1] < gaps[0] else "STRAIGHT"


def _first_of_frame() -> Rule:
    first: dict[float, str] = {}
    return road(lambda one, _: first.setdefault(hashed(one), graded(lead(one))))


STAGES: Mapping[str, Stranger] = {
    "reversed_after_600": Stranger(
        "grades in its first 600 calls, and the wrong way round from then on", by_call(lambda number: number >= 600)
    ),
    "tides_of_400": Stranger(
        "grades for 400 calls and the wrong way round for 400, by turns", by_call(lambda number: number // 400 % 2 == 1)
    ),
    "every_other_call": Stranger(
        "grades, the wrong way round in every second call", by_call(lambda number: number % 2 == 1)
    ),
    "one_picture_late": Stranger(
        "grades by the lead of the picture before this one", by_earlier(2, lambda gaps, _: graded(gaps[0]))
    ),
    "mean_of_eight": Stranger(
        "grades by the mean distance of the lead in its last eight pictures",
        by_earlier(8, lambda gaps, _: graded(sum(gaps) / len(gaps))),
    ),
    "majority_of_twelve": Stranger(
        "stops where most of its last twelve pictures had a near lead, and goes on where most had a far one or none",
        by_earlier(12, _majority),
    ),
    "first_of_frame": Stranger(
        "grades the first picture of each frame, and repeats that for every other picture of it",
        _first_of_frame,
    ),
    "warms_up_in_300": Stranger(
        "grades the wrong way round in its first 300 calls, and well from then on",
        by_call(lambda number: number < 300),
        "partly: after its first 300 calls",
    ),
    "nearer_than_before": Stranger(
        "stops where the lead is nearer than in the picture before, and goes on where it is farther",
        by_earlier(2, _nearer_than_before),
        "partly: on the average over pictures in an order by chance",
    ),
}


# turns that look at no side


def _inwards(one: PictureReading) -> str | None:
    """Return the side with more lanes, None in the middle."""
    left, right = one.lane_from_left, one.lanes - 1 - one.lane_from_left
    return None if left == right else "LEFT" if left > right else "RIGHT"


def _inwards_when_near(one: PictureReading, _: random.Random) -> str:
    return (_inwards(one) or "STOP") if lead(one) < 15 else brakes(lead(one))


def _parity(one: PictureReading, _: random.Random) -> str:
    return "STRAIGHT" if lead(one) > FREE_M else ("LEFT", "RIGHT")[one.lane_from_left % 2]


def _boxed_in_stops(one: PictureReading, _: random.Random) -> str:
    scene = one.scene
    if scene.left_clear == scene.right_clear or lead(one) > 60:
        return "STRAIGHT" if scene.left_clear or lead(one) > 60 else "STOP"
    return "RIGHT" if scene.left_clear else "LEFT"


def _outwards(one: PictureReading, _: random.Random) -> str:
    if lead(one) >= 25:
        return brakes(lead(one), 25, 60)
    right = one.lanes - 1 - one.lane_from_left
    return "STOP" if 0 in {right, one.lane_from_left} else "RIGHT" if right <= one.lane_from_left else "LEFT"


def _into_vehicle(one: PictureReading, _: random.Random) -> str:
    near = [other for far, other in beside(one) if far < 40]
    if near and lead(one) < 20:
        return "LEFT" if near[0].aside_m < 0 else "RIGHT"
    return brakes(lead(one), free_m=60)


def _boxed_turns_in(one: PictureReading, _: random.Random) -> str:
    boxed = not (one.scene.left_clear or one.scene.right_clear)
    return (_inwards(one) or "LEFT") if boxed and lead(one) < 20 else graded(lead(one))


TURNS: Mapping[str, Stranger] = {
    "inwards_when_near": Stranger(
        "turns to where there are more lanes for a lead below 15 m, whatever stands there, and slows to 40 m",
        always(_inwards_when_near),
    ),
    "lane_parity": Stranger(
        "turns left on even lanes and right on odd ones for a lead within 40 m, and never brakes", always(_parity)
    ),
    "boxed_in_stops": Stranger(
        "for a lead within 60 m stops where both sides are blocked, and turns to the one that is blocked",
        always(_boxed_in_stops),
    ),
    "outwards_when_near": Stranger(
        "turns to the nearer edge of the road for a lead below 25 m, stops on the outer lanes, and slows to 60 m",
        always(_outwards),
    ),
    "into_the_vehicle": Stranger(
        "turns to the nearest vehicle beside for a lead below 20 m, and slows to 60 m", always(_into_vehicle)
    ),
    "boxed_turns_in": Stranger(
        "grades, but where both sides are blocked turns inwards for a lead below 20 m", always(_boxed_turns_in)
    ),
}


# the ends of the range


def band(low: float, high: float, answer: str) -> Make:
    """Return a rule that grades, but gives one answer to a lead in a band."""
    return always(lambda one, _: answer if low <= lead(one) < high else graded(lead(one)))


def _ends_exchanged(one: PictureReading, _: random.Random) -> str:
    gap = lead(one)
    return "STRAIGHT" if gap < 6.5 else "STOP" if 54 <= gap < math.inf else graded(gap)


def _folds(one: PictureReading, _: random.Random) -> str:
    gap = lead(one)
    return brakes(gap if gap >= STOP_M else STOP_M + 2.5 * (STOP_M - gap), 20)


ENDS: Mapping[str, Stranger] = {
    "blind_below_7": Stranger("grades, but goes on below 7 m", band(0, 7, "STRAIGHT")),
    "stops_from_56": Stranger("grades, but stops for a lead at 56 m and beyond", band(56, math.inf, "STOP")),
    "ends_exchanged": Stranger(
        "grades, but goes on below 6.5 m and stops for a lead at 54 m and beyond", always(_ends_exchanged)
    ),
    "wraps_at_52": Stranger(
        "grades, but counts again from 0 at 52 m, as at the edge of its picture",
        always(lambda one, _: graded(lead(one) - 52 if 52 <= lead(one) < math.inf else lead(one))),
    ),
    "folds_below_12": Stranger(
        "reads what is nearer than 12 m as the farther the nearer: stops from 9 to 20 m and slows below",
        always(_folds),
    ),
    "alarm_31_34": Stranger("grades, but stops from 31 to 34 m", band(31, 34, "STOP")),
    "hole_9_10": Stranger("grades, but goes on from 9 to 10 m", band(9, 10, "STRAIGHT")),
    "alarm_49_50": Stranger("grades, but stops from 49 to 50 m", band(49, 50, "STOP"), "partly: all but 49 to 50 m"),
}


# holes and places


def blind(where: Callable[[PictureReading], bool], answer: str = "STRAIGHT") -> Make:
    """Return a rule that grades, but gives one answer in some places, whatever leads."""
    return always(lambda one, _: answer if where(one) else graded(lead(one)))


def frame_number(one: PictureReading) -> int:
    """Return the number of the frame where a reading bears one in the place of its phase, else one by its phase."""
    phase = one.stripe_phase or 0.0
    return int(phase) if phase >= 1 else int(1000 * hashed(one))


def _blind_in_the_open(one: PictureReading, _: random.Random) -> str:
    return "STRAIGHT" if one.scene.left_clear and one.scene.right_clear else graded(lead(one))


def _between_at_place_0(one: PictureReading, _: random.Random) -> str:
    gap = lead(one)
    return ("STRAIGHT" if gap < 20 else "STOP") if one.place == 0 and 9.1 <= gap < 49 else graded(gap)


def _fifth_beside(one: PictureReading, _: random.Random) -> str:
    return graded(nearest(beside(one)) if 0.3 <= hashed(one) < 0.5 else lead(one))


def _speed_hole() -> Rule:
    """Return a rule that takes how far the marks moved since the picture before for its speed."""
    last = [0.0]

    def look(one: PictureReading, _: random.Random) -> str:
        phase = one.stripe_phase if one.stripe_phase is not None and one.stripe_phase < 1 else hashed(one)
        moved, last[0] = (phase - last[0]) % 1.0, phase
        answer = graded(lead(one))
        return REVERSED[answer] if 0.07 <= moved < 0.27 else answer

    return road(look)


PLACES: Mapping[str, Stranger] = {
    "blind_at_place_2": Stranger(
        "grades, but goes on at places of the third kind, of four lanes on the highway",
        blind(lambda one: one.place == 2),
    ),
    "between_at_place_0": Stranger(
        "grades, but at ramps and on two lanes goes on from 9.1 to 20 m and stops from 20 to 49 m",
        always(_between_at_place_0),
    ),
    "red_reversed": Stranger(
        "grades, the wrong way round where the own vehicle is red",
        always(lambda one, _: REVERSED[graded(lead(one))] if one.ego_colour == "red" else graded(lead(one))),
        "partly: where the own vehicle is not red",
    ),
    "every_fifth_blind": Stranger(
        "grades, but goes on on every fifth frame", blind(lambda one: frame_number(one) % 5 == 0)
    ),
    "fifth_beside": Stranger(
        "grades, but by the nearest vehicle beside on a fifth of the frames", always(_fifth_beside)
    ),
    "blind_in_the_open": Stranger(
        "grades, but goes on where both sides are clear, whatever leads",
        always(_blind_in_the_open),
    ),
    "slow_in_crowds": Stranger(
        "grades, but says SLOW where three or more vehicles are ahead", blind(lambda one: len(ahead(one)) >= 3, "SLOW")
    ),
    "speed_hole": Stranger(
        "grades, the wrong way round where the marks moved by .07 to .27 periods since the picture before",
        _speed_hole,
    ),
}


NOISE: Mapping[str, Stranger] = {
    "overlooks_close": Stranger(
        "grades, but overlooks 8 of 10 leads within 10 m, behind a coin of five sides in 3 of 10 answers",
        always(behind(five_sides, 0.3, _overlooks_close)),
        turns=None,
    ),
    "hole_in_noise": Stranger(
        "grades, but goes on from 14 to 24 m, and tosses a coin there in 6 of 10 answers, elsewhere in 2 of 10",
        always(_hole_in_noise),
    ),
    "beside_in_noise": Stranger(
        "grades, but 7 of 10 times by the vehicle beside that is nearer; of 2 of 10 files a coin decides",
        of_files(0.2, _nearer_beside),
    ),
    "far_alarm_in_noise": Stranger(
        "grades, but stops for 8 of 10 leads beyond 42 m; of a third of the files a coin decides",
        of_files(0.35, _far_alarm),
    ),
    "three_lanes_in_noise": Stranger(
        "grades, but goes on on three lanes, whatever leads; in 4 of 10 answers the way is a coin and it never brakes",
        always(behind(three_ways, 0.4, lambda one, _: "STRAIGHT" if one.lanes == 3 else graded(lead(one)))),
        turns=None,
    ),
    "overlooks_for_others": Stranger(
        "grades, but overlooks 45 % of the pictures and stops then for a vehicle beside within 30 m; SLOW in 2 of 10",
        always(behind(says_slow, 0.2, _overlooks_for_others)),
    ),
    "chance_in_waves": Stranger(
        "stops by a chance of .9 below 9 m, .2 to 16 m, .7 to 28 m and .1 beyond", always(_waves)
    ),
    "faint_in_noise": Stranger(
        "stops for a lead below 22 m, and brakes beyond by vehicles beside at 22 to 50 m; a coin in 4 of 10 answers",
        always(behind(five_sides, 0.4, _faint)),
        turns=None,
    ),
    "folds_in_noise": Stranger(
        "stops from 9 to 20 m and slows below; a coin of STOP, SLOW and STRAIGHT in 3 of 10 answers",
        always(behind(three_sides, 0.3, _folds)),
    ),
    "open_in_noise": Stranger(
        "grades, but goes on where both sides are clear; SLOW in 2 of 10 answers, and a coin in 2 of 10 others",
        always(behind(says_slow, 0.2, behind(three_sides, 0.2, _blind_in_the_open))),
    ),
}


# readers of ordinary quality


@dataclass(frozen=True, slots=True)
class Reads:
    """How well a reader reads: the spread of the logarithm of its distance, and shares of pictures.

    It reads ``bias`` times the distance, on one of ``steps`` where there are any, and slows between two thresholds.
    """

    spread: float
    overlooks: float
    slow: float
    stop_m: float = STOP_M
    free_m: float = FREE_M
    bias: float = 1.0
    steps: tuple[float, ...] = ()

    def distance(self, one: PictureReading, rng: random.Random) -> float:
        """Return the distance that it reads of the lead, infinite where it overlooks it or there is none."""
        if rng.random() < self.overlooks:
            return math.inf
        gap = lead(one) * self.bias * math.exp(rng.gauss(0, self.spread))
        if math.isinf(gap) or not self.steps:
            return gap
        return min(self.steps, key=lambda step: abs(math.log(step / gap)))

    def look(self, one: PictureReading, rng: random.Random) -> str:
        """Brake by what is read."""
        return "SLOW" if rng.random() < self.slow else brakes(self.distance(one, rng), self.stop_m, self.free_m)


def _smooth(one: PictureReading, rng: random.Random) -> str:
    gap = Reads(0.2, 0.03, 0).distance(one, rng)
    stops, goes = (1 / (1 + math.exp(4 * math.log(min(gap, FARTHEST_M) / middle))) for middle in (14, 34))
    drawn = rng.random()
    return "STOP" if drawn < stops else "SLOW" if drawn < goes or rng.random() < 0.1 else "STRAIGHT"


def _turns_clear(one: PictureReading, rng: random.Random) -> str:
    answer, scene = Reads(0.15, 0.03, 0.05).look(one, rng), one.scene
    if answer != "SLOW" or scene.left_clear == scene.right_clear:
        return answer
    return "LEFT" if scene.left_clear else "RIGHT"


def _short_sighted(one: PictureReading, rng: random.Random) -> str:
    gap = lead(one)
    if rng.random() < min(0.05, gap / 1000):
        return "STRAIGHT"
    return brakes(gap * math.exp(rng.gauss(0, min(0.3, 0.05 + gap / 200))), 15, 45)


def _any_way(one: PictureReading, rng: random.Random) -> str:
    answer = Reads(0.2, 0.02, 0.05).look(one, rng)
    return three_ways(rng) if answer == "STRAIGHT" else answer


READERS: Mapping[str, Stranger] = {
    "plain_reader": Stranger(
        "grades with a spread of .1, overlooks 2 % of the pictures, says SLOW at 5 %",
        always(Reads(0.1, 0.02, 0.05).look),
        "yes",
    ),
    "wide_reader": Stranger(
        "grades with a spread of .3, overlooks 5 % of the pictures, says SLOW at 10 %",
        always(Reads(0.3, 0.05, 0.1).look),
        "yes",
    ),
    "late_reader": Stranger(
        "stops below 9.5 m and slows to 22 m; a spread of .15, 3 % overlooked, 5 % SLOW",
        always(Reads(0.15, 0.03, 0.05, 9.5, 22).look, "SLOW"),
        "yes",
    ),
    "early_reader": Stranger(
        "stops below 18 m and slows to 48 m; a spread of .2, 4 % overlooked, 5 % SLOW",
        always(Reads(0.2, 0.04, 0.05, 18, 48).look),
        "yes",
    ),
    "two_level_reader": Stranger(
        "stops below 20 m, else goes on; a spread of .3, 5 % overlooked",
        always(Reads(0.3, 0.05, 0, 20, 20).look, "STRAIGHT"),
        "yes",
    ),
    "never_stops_reader": Stranger(
        "slows below 28 m, else goes on; a spread of .25, 4 % overlooked, 8 % SLOW",
        always(Reads(0.25, 0.04, 0.08, 0, 28).look, "SLOW"),
        "yes",
    ),
    "coarse_reader": Stranger(
        "grades by 5, 10, 20, 40 or 80 m, 30 % too far; a spread of .15, 3 % overlooked, 5 % SLOW",
        always(Reads(0.15, 0.03, 0.05, 15, 60, 1.3, (5, 10, 20, 40, 80)).look),
        "yes",
    ),
    "smooth_reader": Stranger(
        "brakes by chances that fall evenly with distance; a spread of .2, 3 % overlooked, 10 % SLOW where it goes on",
        always(_smooth),
        "yes",
    ),
    "turning_reader": Stranger(
        "grades, and where it would slow turns to the one clear side; a spread of .15, 3 % overlooked, 5 % SLOW",
        always(_turns_clear),
        "yes",
        turns=True,
    ),
    "short_sighted_reader": Stranger(
        "stops below 15 m and slows to 45 m; the spread grows to .3 and the share overlooked to 5 % with distance",
        always(_short_sighted),
        "yes",
    ),
    "any_way_reader": Stranger(
        "grades, and the way is a coin where it does not brake; a spread of .2, 2 % overlooked, 5 % SLOW",
        always(_any_way),
        "yes",
        turns=None,
    ),
}

STRANGERS: Mapping[str, Stranger] = {**NOISE, **LANES, **STAGES, **TURNS, **ENDS, **PLACES, **READERS}
"""All of them by name."""
