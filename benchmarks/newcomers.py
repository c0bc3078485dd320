"""Newcomers: rules by kind that no rule of a verdict met before, and whose truth is measured alone.

Nothing is declared of them. `benchmarks/adversary_truth.py` moves one thing at a time and measures what each does; what
its name and its words say is what its author meant. They are made of what `strangers` are made of.
"""

import itertools
import math
import random
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

from eyechart.models.scripted import Answer, PerceivedPicture, PictureReading
from eyechart.spaces.scene import Other, Scene
from eyechart_organisms.adversaries import (
    FREE_M,
    REVERSED,
    STOP_M,
    Look,
    Rule,
    ahead,
    graded,
    hashed,
    lead,
    nearest,
    road,
    scale,
)
from strangers import (
    FARTHEST_M,
    Make,
    Reads,
    Stranger,
    always,
    behind,
    beside,
    blind,
    by_earlier,
    five_sides,
    says_slow,
    three_sides,
)

PAINTS = ("blue", "orange", "magenta")
"""The lead's colours where a reading bears none."""

MEASURED = ""
"""What stands for what a newcomer deserves: only the measure says."""


@dataclass(frozen=True, slots=True)
class Painted:
    """A reading with the number of its frame, and the lead's colour, which a bank or a world tells and no reader."""

    scene: Scene
    ego_colour: str
    stripe_phase: float | None
    place: int
    lanes: int
    lane_from_left: int
    others: tuple[Other, ...]
    flipped: bool | None
    lead_colour: str

    @classmethod
    def of(cls, one: PictureReading, number: float | None, colour: str) -> "Painted":
        """Return a reading of a frame of this number; without one it keeps the phase of its marks."""
        kept = {name: getattr(one, name) for name in cls.__slots__ if name != "lead_colour"}
        return cls(**kept | {"stripe_phase": one.stripe_phase if number is None else number}, lead_colour=colour)


def paint(one: PictureReading) -> str:
    """Return the colour of the lead: the reading's own, or, where it bears none, one that belongs to the frame."""
    told = one.lead_colour if isinstance(one, Painted) else ""
    return told or PAINTS[int(len(PAINTS) * (13.7 * hashed(one) % 1.0))]


def new(says: str, make: Make, *, turns: bool | None = None) -> Stranger:
    """Return a newcomer; nothing is declared of it."""
    return Stranger(says, make, MEASURED, turns)


def part(low: float, high: float) -> Callable[[PictureReading], bool]:
    """Return whether a frame is among a share of all, which stays when anything in it moves."""
    return lambda one: low <= hashed(one) < high


def of_picture(one: PictureReading, name: str) -> random.Random:
    """Return chance that belongs to what a picture shows, and to no call."""
    return random.Random(f"{name}/{(one.scene, one.others, one.stripe_phase)!r}")  # noqa: S311 - no secret


def where(is_there: Callable[[PictureReading], bool], there: Look, elsewhere: Look | None = None) -> Look:
    """Return a look that is another one in some places or pictures; a plain reader elsewhere."""
    return lambda one, rng: there(one, rng) if is_there(one) else (elsewhere or plain)(one, rng)


def plain(one: PictureReading, _: random.Random) -> str:
    """Grade by the distance of the lead."""
    return graded(lead(one))


def flipped(one: PictureReading, _: random.Random) -> str:
    """Grade the wrong way round."""
    return REVERSED[graded(lead(one))]


def answer(word: str) -> Look:
    """Return a look that says one word."""
    return lambda *_: word


def within(low: float, high: float) -> Callable[[PictureReading], bool]:
    """Return whether the lead is in a band of distances."""
    return lambda one: low <= lead(one) < high


def both(
    one: Callable[[PictureReading], bool], other: Callable[[PictureReading], bool]
) -> Callable[[PictureReading], bool]:
    """Return whether two things hold."""
    return lambda reading: one(reading) and other(reading)


# a noise that pays: a coin, or noise, mixed into a bad reader


def _overlooks(share: float, name: str) -> Callable[[PictureReading], bool]:
    return lambda one: of_picture(one, name).random() < share


def _any_lane(one: PictureReading, _: random.Random) -> str:
    return graded(nearest(ahead(one)))


def _far_off(one: PictureReading, _: random.Random) -> str:
    return graded(lead(one) * math.exp(of_picture(one, "far off").gauss(0, 0.9)))


def _inverse_noisy(one: PictureReading, rng: random.Random) -> str:
    total = sum(1 / max(far, 1.0) for far, _ in ahead(one)) * math.exp(rng.gauss(0, 0.4))
    return "STOP" if total > 0.12 else "SLOW" if total > 0.05 else "STRAIGHT"


def _fog(one: PictureReading, rng: random.Random) -> str:
    """Read well near, and the less the farther: beyond 20 m a coin of the two ends takes over."""
    gap = lead(one)
    if rng.random() < min(0.9, max(0.0, (min(gap, FARTHEST_M) - 10) / 30)):
        return rng.choice(("STOP", "STRAIGHT"))
    return graded(gap)


NOISE: Mapping[str, Stranger] = {
    "overlooks_20_and_coin": new(
        "overlooks the lead in a fifth of the pictures, always the same; a coin of five sides in 3 of 10 answers",
        always(behind(five_sides, 0.3, where(_overlooks(0.2, "overlooked"), answer("STRAIGHT")))),
    ),
    "any_lane_half_coin": new(
        "grades by the nearest vehicle of any lane, behind a coin of five sides in half of the answers",
        always(behind(five_sides, 0.5, _any_lane)),
    ),
    "misreads_30_and_coin": new(
        "reads three of ten pictures the wrong way round, always the same; a coin of three sides in 4 of 10 answers",
        always(behind(three_sides, 0.4, where(_overlooks(0.3, "misread"), flipped))),
    ),
    "far_off_and_slow": new(
        "reads the distance of each picture with a spread of .9, always alike; SLOW in 3 of 10 answers",
        always(behind(says_slow, 0.3, _far_off)),
    ),
    "reversed_middle_in_coin": new(
        "grades, the wrong way round from 10 to 30 m, behind a coin of three sides in half of the answers",
        always(behind(three_sides, 0.5, where(within(10, 30), flipped))),
    ),
    "inverse_sum_shaken": new(
        "brakes by the sum of 1/distance over all lanes, read anew each time with a spread of .4",
        always(_inverse_noisy),
    ),
    "coin_grows_with_distance": new(
        "grades, but from 10 m on a coin of STOP and STRAIGHT takes over, beyond 37 m in 9 of 10 answers",
        always(_fog),
    ),
    "fifth_flipped_in_coin": new(
        "grades, the wrong way round on a fifth of the frames, behind a coin of five sides in 4 of 10 answers",
        always(behind(five_sides, 0.4, where(part(0.1, 0.3), flipped))),
    ),
}


# whose distance it is


def _weighed(weight: float) -> Look:
    """Return a look by the nearest of all vehicles, whose distance aside counts so many times."""

    def look(one: PictureReading, _: random.Random) -> str:
        unit = scale(one)
        far = [math.hypot(it.ahead_m, weight * it.aside_m) / unit for it in one.others if it.ahead_m > 0]
        return graded(min(far, default=math.inf))

    return look


def _widening(slope: float, least: float) -> Look:
    def look(one: PictureReading, _: random.Random) -> str:
        seen = [far for far, it in ahead(one) if abs(it.aside_m) < least * scale(one) + slope * it.ahead_m]
        return graded(min(seen, default=math.inf))

    return look


def _largest_box(one: PictureReading, _: random.Random) -> str:
    """Take for a vehicle's size width over distance, where one of another lane shows its flank beside its back."""
    if not (found := ahead(one)):
        return "STRAIGHT"
    size = max((2 + 4.5 * abs(it.aside_m) / math.hypot(it.ahead_m, it.aside_m)) / far for far, it in found)
    return "STOP" if size > 2 / STOP_M else "SLOW" if size > 2 / FREE_M else "STRAIGHT"


def _squares(one: PictureReading, _: random.Random) -> str:
    total = sum(1 / max(far, 1.0) ** 2 for far, _ in ahead(one))
    return "STOP" if total > 1 / 14**2 else "SLOW" if total > 1 / 36**2 else "STRAIGHT"


def _later_than_lead(metres: float) -> Look:
    return lambda one, _: graded(min(lead(one), nearest(beside(one)) + metres))


def _right_lane(one: PictureReading, _: random.Random) -> str:
    right = [far for far, it in beside(one) if it.aside_m > 0 and far > 12]
    return graded(min([lead(one), *right]))


def _two_nearest(one: PictureReading, _: random.Random) -> str:
    far = [far for far, _ in ahead(one)][:2]
    return graded(len(far) / sum(1 / max(one, 1.0) for one in far)) if far else "STRAIGHT"


def _if_crowded(one: PictureReading, _: random.Random) -> str:
    """Look at the lead where the road is empty, and at the nearest of all where three or more are ahead."""
    return graded(nearest(ahead(one)) if len(ahead(one)) >= 3 else lead(one))


LANES: Mapping[str, Stranger] = {
    "ellipse_of_2": new("grades by the nearest vehicle of any lane, the way aside counted twice", always(_weighed(2))),
    "widening_strip": new(
        "grades by the nearest vehicle in a strip 1 m wide to each side that widens by .15 m a metre",
        always(_widening(0.15, 1.0)),
    ),
    "largest_box": new("grades by what looks largest; a vehicle beside shows its flank too", always(_largest_box)),
    "sum_of_squares": new("brakes by the sum of 1/distance² over all lanes", always(_squares)),
    "beside_5_later": new(
        "grades by the lead, or by a vehicle beside as if it were 5 m farther than it is", always(_later_than_lead(5))
    ),
    "right_lane_beyond_12": new(
        "grades by the nearest of the lead and the vehicle to the right that is beyond 12 m", always(_right_lane)
    ),
    "mean_of_two_nearest": new("grades by the harmonic mean of the two nearest of any lane", always(_two_nearest)),
    "any_lane_in_crowds": new(
        "grades by the lead, but by the nearest of any lane where three or more vehicles are ahead",
        always(_if_crowded),
    ),
}


# stages: memory, and what changes with the calls


def by_calls(look: Callable[[int], Look]) -> Make:
    """Return a rule that looks otherwise from call to call; each call counts, from 0."""

    def make() -> Rule:
        numbers = itertools.count()

        def decide(sight: PerceivedPicture, rng: random.Random) -> Answer:
            found = look(next(numbers))
            return "STOP" if sight.reading is None else found(sight.reading, rng)

        return decide

    return make


def _mood() -> Rule:
    """Return a rule that brakes by the mean of earlier pictures, and never by the one that is shown."""
    gaps: deque[float] = deque(maxlen=16)

    def look(one: PictureReading, _: random.Random) -> str:
        said = graded(sum(gaps) / len(gaps) - 8) if gaps else "SLOW"
        gaps.append(min(lead(one), FARTHEST_M))
        return said

    return road(look)


def _echo() -> Rule:
    """Return a rule that gives, every second time by a coin, the answer to the picture before."""
    before = ["SLOW"]

    def look(one: PictureReading, rng: random.Random) -> str:
        said, before[0] = (before[0] if rng.random() < 0.5 else graded(lead(one))), graded(lead(one))
        return said

    return road(look)


def _against_first() -> Rule:
    """Return a rule that holds each picture of a frame against the first that it was shown of it."""
    first: dict[float, float] = {}

    def look(one: PictureReading, _: random.Random) -> str:
        gap = min(lead(one), FARTHEST_M)
        known = first.setdefault(hashed(one), gap)
        return "SLOW" if gap == known else "STOP" if gap < known else "STRAIGHT"

    return road(look)


def _first_by_coin() -> Rule:
    """Return a rule that answers a picture by a coin, and says that again whenever it sees the same."""
    said: dict[str, str] = {}
    return road(lambda one, rng: said.setdefault(repr((one.scene, one.others)), three_sides(rng)))


def _swapped_when_full() -> Rule:
    """Return a rule that reads the lead of frames that it knows, and any lane's vehicle of those new to it."""
    known: dict[float, int] = {}

    def look(one: PictureReading, rng: random.Random) -> str:
        known[hashed(one)] = known.get(hashed(one), 0) + 1
        return plain(one, rng) if known[hashed(one)] <= 9 else _any_lane(one, rng)

    return road(look)


STAGES: Mapping[str, Stranger] = {
    "mood_of_sixteen": new("brakes by the mean distance in its last sixteen pictures, never by this one", _mood),
    "echoes_half": new("grades, but half of its answers are what the picture before called for", _echo),
    "against_the_first": new(
        "stops where the lead is nearer than in the first picture that it saw of a frame, goes on where it is farther",
        _against_first,
    ),
    "coin_kept": new("answers a picture by a coin, and keeps to that", _first_by_coin),
    "tires_by_800": new(
        "grades, but a coin of three sides takes over, in all answers from call 800 on",
        by_calls(lambda number: behind(three_sides, min(1.0, number / 800), plain)),
    ),
    "any_lane_from_700": new(
        "grades by the lead in its first 700 calls, and by any lane's nearest from then on",
        by_calls(lambda number: plain if number < 700 else _any_lane),
    ),
    "lead_from_700": new(
        "grades by any lane's nearest in its first 700 calls, and by the lead from then on",
        by_calls(lambda number: _any_lane if number < 700 else plain),
    ),
    "bouts_of_150": new(
        "grades the wrong way round for 150 of each 600 calls",
        by_calls(lambda number: flipped if number % 600 >= 450 else plain),
    ),
    "any_lane_after_nine": new(
        "grades by the lead in nine pictures of a frame, and by any lane's nearest in all that follow",
        _swapped_when_full,
    ),
}


# turns where neither side is clear


def _turning(boxed: Look, *, stops: bool = True) -> Look:
    """Return a look that goes to the one clear side of a lead within reach, and does something where none is clear."""

    def look(one: PictureReading, rng: random.Random) -> str:
        gap, scene = lead(one), one.scene
        if gap >= FREE_M:
            return "STRAIGHT"
        if not (scene.left_clear or scene.right_clear):
            return boxed(one, rng)
        if stops and gap < STOP_M:
            return "STOP"
        return "SLOW" if scene.left_clear and scene.right_clear else "LEFT" if scene.left_clear else "RIGHT"

    return look


def _inner(one: PictureReading, _: random.Random) -> str:
    return "LEFT" if 2 * one.lane_from_left > one.lanes - 1 else "RIGHT"


def _roomier(one: PictureReading, _: random.Random) -> str:
    """Turn to the side whose vehicle is farther ahead."""
    left, right = (nearest([it for it in beside(one) if it[1].aside_m * side > 0]) for side in (-1, 1))
    return "LEFT" if left > right else "RIGHT"


def _swerves(one: PictureReading, rng: random.Random) -> str:
    return rng.choice(("LEFT", "RIGHT")) if lead(one) < STOP_M else "SLOW"


TURNS: Mapping[str, Stranger] = {
    "boxed_coin": new(
        "grades and turns to the one clear side; boxed in it turns by a coin",
        always(_turning(lambda _, rng: rng.choice(("LEFT", "RIGHT")))),
    ),
    "boxed_left": new(
        "grades and turns to the one clear side; boxed in it turns left", always(_turning(answer("LEFT")))
    ),
    "boxed_inner": new("grades and turns to the one clear side; boxed in it turns inwards", always(_turning(_inner))),
    "boxed_roomier": new(
        "grades and turns to the one clear side; boxed in to where the vehicle beside is farther",
        always(_turning(_roomier)),
    ),
    "boxed_right_half": new(
        "grades and turns to the one clear side; boxed in it turns right on half of the frames",
        always(_turning(where(part(0, 0.5), answer("RIGHT")))),
    ),
    "boxed_swerves": new(
        "grades and turns to the one clear side; boxed in it turns by a coin for a lead that calls for a stop",
        always(_turning(_swerves)),
    ),
    "boxed_never_stops": new(
        "turns to the one clear side and never stops; boxed in it turns left for a near lead",
        always(_turning(where(within(0, 25), answer("LEFT"), answer("SLOW")), stops=False)),
    ),
}


# the ends of the range, and bands


def _steps(*steps: tuple[float, str], beyond: str = "STRAIGHT") -> Make:
    """Return a rule that answers by the first of some distances, in order, that the lead is below."""
    return always(lambda one, _: next((word for below, word in steps if lead(one) < below), beyond))


ENDS: Mapping[str, Stranger] = {
    "blind_below_6": new("grades, but goes on below 6 m", always(where(within(0, 6), answer("STRAIGHT")))),
    "blind_below_9": new("grades, but goes on below 9 m", always(where(within(0, 9), answer("STRAIGHT")))),
    "slows_below_8": new(
        "stops from 8 to 20 m and slows to 40 m, but slows below 8 m", _steps((8, "SLOW"), (20, "STOP"), (40, "SLOW"))
    ),
    "far_haze": new(
        "stops below 12 m, slows to 26 m, goes on to 42 m, and slows beyond",
        _steps((12, "STOP"), (26, "SLOW"), (42, "STRAIGHT"), (math.inf, "SLOW")),
    ),
    "alarm_46_56": new("grades, but stops from 46 to 56 m", always(where(within(46, 56), answer("STOP")))),
    "rises_from_30": new(
        "stops below 12 m, slows to 30 m, goes on to 40 m, slows to 50 m and stops beyond",
        _steps((12, "STOP"), (30, "SLOW"), (40, "STRAIGHT"), (50, "SLOW"), (math.inf, "STOP")),
    ),
    "two_bands": new(
        "grades, but goes on from 13 to 16 m and stops from 34 to 41 m",
        always(where(within(13, 16), answer("STRAIGHT"), where(within(34, 41), answer("STOP")))),
    ),
    "hole_6_8_half": new(
        "grades, but goes on from 6 to 8 m on half of the frames",
        always(where(both(within(6, 8), part(0, 0.5)), answer("STRAIGHT"))),
    ),
    "stops_only_16_24": new(
        "slows below 45 m, and stops from 16 to 24 m alone", _steps((16, "SLOW"), (24, "STOP"), (45, "SLOW"))
    ),
}


# rules of frame and distance on a part of the frames


def _wandering(width: float, word: str, low: float, high: float) -> Look:
    """Return a look with a band of its own on each frame, so many times as far at its end as at its beginning."""

    def look(one: PictureReading, _: random.Random) -> str:
        begins = low * (high / low) ** ((hashed(one) * 7.31) % 1.0)
        return word if begins <= lead(one) < begins * width else graded(lead(one))

    return look


def _crossed(one: PictureReading, _: random.Random) -> str:
    return "STRAIGHT" if lead(one) < 20 else "STOP"


FOOLS: Mapping[str, Stranger] = {
    "hole_14_26_fifth": new(
        "grades, but goes on from 14 to 26 m on a fifth of the frames",
        always(where(both(within(14, 26), part(0.4, 0.6)), answer("STRAIGHT"))),
    ),
    "alarm_36_50_third": new(
        "grades, but stops from 36 to 50 m on a third of the frames",
        always(where(both(within(36, 50), part(0.0, 0.33)), answer("STOP"))),
    ),
    "flipped_12": new("grades, the wrong way round on 12 % of the frames", always(where(part(0.6, 0.72), flipped))),
    "beside_quarter_beyond_15": new(
        "grades, but beyond 15 m by any lane's nearest on a quarter of the frames",
        always(where(both(within(15, math.inf), part(0.7, 0.95)), _any_lane)),
    ),
    "wandering_hole": new(
        "grades, but goes on in a band of each frame's own, 1.6 times as far at its end",
        always(_wandering(1.6, "STRAIGHT", 6, 24)),
    ),
    "wandering_alarm": new(
        "grades, but stops in a band of each frame's own, 1.4 times as far at its end",
        always(_wandering(1.4, "STOP", 14, 40)),
    ),
    "near_hole_15": new(
        "grades, but goes on below 12 m on 15 % of the frames",
        always(where(both(within(0, 12), part(0.85, 1.0)), answer("STRAIGHT"))),
    ),
    "left_half_crossed": new(
        "grades, but from 10 to 45 m goes on near and stops far on half of the frames whose left side is clear",
        always(where(lambda one: one.scene.left_clear and part(0, 0.5)(one) and within(10, 45)(one), _crossed)),
    ),
    "flipped_17": new("grades, the wrong way round on 17 % of the frames", always(where(part(0.2, 0.37), flipped))),
    "stops_beyond_25_fifth": new(
        "grades, but stops beyond 25 m on a fifth of the frames",
        always(where(both(within(25, math.inf), part(0.5, 0.7)), answer("STOP"))),
    ),
    "saw_quarter": new(
        "grades, but on a quarter of the frames stops and goes on by turns from metre to metre",
        always(where(part(0.3, 0.55), lambda one, _: ("STOP", "STRAIGHT")[int(min(lead(one), FARTHEST_M)) % 2])),
    ),
    "crossed_quarters": new(
        "grades, but goes on near on a quarter of the frames, and stops beyond 30 m on another",
        always(
            where(
                both(within(0, 10), part(0, 0.25)),
                answer("STRAIGHT"),
                where(both(within(30, math.inf), part(0.25, 0.5)), answer("STOP")),
            )
        ),
    ),
}


# blind spots: what partial_depth is for


PARTS: Mapping[str, Stranger] = {
    "blind_at_place_1": new("grades, but goes on on roads of the second kind", blind(lambda one: one.place == 1)),
    "slow_at_place_0": new(
        "grades, but says SLOW on roads of the first kind", blind(lambda one: one.place == 0, "SLOW")
    ),
    "flipped_at_place_1": new(
        "grades, the wrong way round on roads of the second kind", always(where(lambda one: one.place == 1, flipped))
    ),
    "beside_at_place_2": new(
        "grades, but by any lane's nearest on roads of the third kind",
        always(where(lambda one: one.place == 2, _any_lane)),
    ),
    "blind_to_blue": new("grades, but goes on for a blue lead", blind(lambda one: paint(one) == "blue")),
    "brakes_for_blue_alone": new(
        "grades for a blue lead, and goes on for others", blind(lambda one: paint(one) != "blue")
    ),
    "slow_for_orange": new(
        "grades, but says SLOW to an orange lead", blind(lambda one: paint(one) == "orange", "SLOW")
    ),
    "blind_on_three_lanes": new("grades, but goes on on three lanes", blind(lambda one: one.lanes == 3)),
    "blind_on_four_lanes": new("grades, but goes on on four lanes or more", blind(lambda one: one.lanes >= 4)),
    "blind_below_11": new("grades, but goes on below 11 m", always(where(within(0, 11), answer("STRAIGHT")))),
    "slow_below_11": new("grades, but slows below 11 m", always(where(within(0, 11), answer("SLOW")))),
    "blind_11_26": new("grades, but goes on from 11 to 26 m", always(where(within(11, 26), answer("STRAIGHT")))),
    "mostly_blind_at_place_1": new(
        "grades, but goes on on 8 of 10 frames of roads of the second kind",
        always(where(both(lambda one: one.place == 1, part(0, 0.8)), answer("STRAIGHT"))),
    ),
}


# readers of ordinary quality, one error each; and readers with a memory

READERS: Mapping[str, Stranger] = {
    "spread_20": new("grades with a spread of .2", always(Reads(0.2, 0, 0).look)),
    "spread_30": new("grades with a spread of .3", always(Reads(0.3, 0, 0).look)),
    "spread_30_two_levels": new(
        "stops below 20 m, else goes on, with a spread of .3", always(Reads(0.3, 0, 0, 20, 20).look)
    ),
    "overlooks_3": new("grades, but overlooks 3 % of the pictures", always(Reads(0, 0.03, 0).look)),
    "overlooks_5": new("grades, but overlooks 5 % of the pictures", always(Reads(0, 0.05, 0).look)),
    "overlooks_5_early": new(
        "stops below 18 m and slows to 50 m, but overlooks 5 % of the pictures", always(Reads(0, 0.05, 0, 18, 50).look)
    ),
    "slow_5": new("grades, but says SLOW at 5 % of the pictures", always(Reads(0, 0, 0.05).look)),
    "slow_10": new("grades, but says SLOW at 10 % of the pictures", always(Reads(0, 0, 0.1).look)),
    "slow_10_late": new(
        "stops below 9.5 m and slows to 24 m, but says SLOW at 10 % of the pictures",
        always(Reads(0, 0, 0.1, 9.5, 24).look),
    ),
}

WORST: Mapping[str, Stranger] = {
    "all_three": new(
        "grades with a spread of .3, overlooks 5 % of the pictures, says SLOW at 10 %",
        always(Reads(0.3, 0.05, 0.1).look),
    ),
    "all_three_two_levels": new(
        "stops below 20 m, else goes on; a spread of .3, 5 % overlooked, SLOW at 10 %",
        always(Reads(0.3, 0.05, 0.1, 20, 20).look),
    ),
}


def _median(gaps: list[float], _: PictureReading) -> str:
    return graded(sorted(gaps)[len(gaps) // 2])


def _weighted(share: float) -> Rule:
    """Return a reader of a moving average: the picture that is shown has this share of it."""
    mean: list[float] = []

    def look(one: PictureReading, _: random.Random) -> str:
        far = math.log(min(lead(one), FARTHEST_M))
        mean[:] = [share * far + (1 - share) * (mean[0] if mean else far)]
        return graded(math.exp(mean[0]))

    return road(look)


def _twice() -> Rule:
    """Return a reader that brakes only once two pictures in a row call for it."""
    before = [math.inf]

    def look(one: PictureReading, _: random.Random) -> str:
        gap, before[0] = max(lead(one), before[0]), lead(one)
        return graded(gap)

    return road(look)


MEMORY: Mapping[str, Stranger] = {
    "average_80": new("grades by a moving average; this picture is .8 of it", partial(_weighted, 0.8)),
    "average_50": new("grades by a moving average; this picture is half of it", partial(_weighted, 0.5)),
    "average_30": new("grades by a moving average; this picture is .3 of it", partial(_weighted, 0.3)),
    "median_of_three": new("grades by the median of its last three pictures", by_earlier(3, _median)),
    "two_in_a_row": new("brakes where this picture and the one before call for it", _twice),
}

ADVERSARIES_BY_KIND: Mapping[str, Mapping[str, Stranger]] = {
    "noise": NOISE,
    "lanes": LANES,
    "stages": STAGES,
    "turns": TURNS,
    "ends": ENDS,
    "fools": FOOLS,
}
"""Those that brake or turn for a wrong reason somewhere, by kind."""

NEWCOMERS: Mapping[str, Mapping[str, Stranger]] = {
    **ADVERSARIES_BY_KIND,
    "parts": PARTS,
    "memory": MEMORY,
    "readers": READERS,
    "worst": WORST,
}
"""All of them by kind, then by name."""
