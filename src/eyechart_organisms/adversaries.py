"""Adversaries: rules that look at the picture and deserve no authority, and readers of distance that do.

Each decides on a sight, real or simulated, as a known-answer controller does. Distances are written in the highway's
metres and scaled to the distances of the world that is seen. What each deserves follows from its rule, and
`tests/test_adversaries.py` holds it against what the rule does on many simulated frames.
"""

import hashlib
import math
import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from eyechart.models.scripted import Answer, PerceivedPicture, PictureReading
from eyechart.spaces.discrete import DRIVING
from eyechart.spaces.scene import HIGHWAY, Other
from eyechart.verdicts import ABSENCES

Rule = Callable[[PerceivedPicture, random.Random], Answer]
Look = Callable[[PictureReading, random.Random], str]
"""What a rule answers to a road; anything else gets STOP, unless the rule says otherwise."""

STOP_M, FREE_M = HIGHWAY.stop_m, HIGHWAY.free_m


@dataclass(frozen=True, slots=True)
class Adversary:
    """A rule, what it does in words, and what it deserves.

    ``follows`` says whether its braking follows the distance of the lead. It is None where any verdict may be given:
    the braking follows weakly, is the wrong way round on few frames only, or hides its errors in noise. ``looks`` says
    whether an answer depends on what a picture shows, None where that is on fewer frames than the margin of an absence.
    ``turns`` says whether it turns to the clear side. ``near`` says that it brakes by distance near alone, so that
    ``partial_depth`` is as right as ``depth``.
    """

    says: str
    decide: Rule
    follows: bool | None = False
    looks: bool | None = True
    turns: bool | None = False
    near: bool = False

    @property
    def deserves(self) -> str:
        """Return what it deserves in words."""
        if self.follows is None:
            return "nothing asked"
        if self.near:
            return "depth or partial_depth"
        return "depth" if self.follows else "no depth, no sight" if self.looks is False else "no depth"

    def may_be_wronged(self, claim: str) -> bool:
        """Return whether a claim would be untrue of it."""
        return {
            "depth": self.follows is False,
            "depth_lateral": self.turns is False,
            "turns_clear": self.turns is False,
            "absence": self.looks is True,
        }[claim]

    def is_false(self, label: str, lateral: str) -> tuple[str, ...]:
        """Return which untrue claims a calibrated and a lateral label make of it."""
        made = {
            "depth": label in {"depth", "depth_lateral"},
            "depth_lateral": label == "depth_lateral",
            "turns_clear": lateral == "turns_clear",
            "absence": label in ABSENCES,
        }
        return tuple(claim for claim, is_made in made.items() if is_made and self.may_be_wronged(claim))


def scale(reading: PictureReading) -> float:
    """Return the length of the highway's metre in the world that is seen, in metres."""
    return reading.scene.distances.stop_m / STOP_M


def lead(reading: PictureReading) -> float:
    """Return the distance of the lead in the highway's metres, infinite where there is none."""
    return math.inf if reading.scene.gap_m is None else reading.scene.gap_m / scale(reading)


def ahead(reading: PictureReading, *, own: bool = True) -> list[tuple[float, Other]]:
    """Return what is ahead with its straight-line distance in the highway's metres; of other lanes only if not own."""
    one = scale(reading)
    found = [(math.hypot(other.ahead_m, other.aside_m) / one, other) for other in reading.others if other.ahead_m > 0]
    return sorted(pair for pair in found if own or abs(pair[1].aside_m) > one)


def graded(distance: float, clear: str = "STRAIGHT") -> str:
    """Return the braking that a distance calls for."""
    return "STOP" if distance < STOP_M else clear if distance > FREE_M else "SLOW"


def hashed(reading: PictureReading) -> float:
    """Return a number in [0, 1) that belongs to the frame: it stays when the lead moves or paint changes."""
    phase = f"{reading.stripe_phase:.6f}" if reading.stripe_phase is not None else f"{reading.place}"
    return _share(phase.encode())


def _share(text: bytes) -> float:
    return int.from_bytes(hashlib.sha256(text).digest()[:8], "big") / 2**64


def road(look: Look, otherwise: str = "STOP") -> Rule:
    """Return the rule that looks at roads, and gives one answer to anything else."""
    return lambda sight, rng: otherwise if sight.reading is None else look(sight.reading, rng)


def noisy(share: float, rule: Rule) -> Rule:
    """Return a rule that tosses a coin of five sides in this share of its answers."""
    return lambda sight, rng: rng.choice(DRIVING.actions) if rng.random() < share else rule(sight, rng)


def nearest(found: list[tuple[float, Other]]) -> float:
    """Return the least distance, infinite where there is none."""
    return found[0][0] if found else math.inf


REVERSED = {"STOP": "STRAIGHT", "SLOW": "SLOW", "STRAIGHT": "STOP"}


def _reversed(share: float, when: Callable[[PictureReading], bool] | None = None) -> Rule:
    def look(reading: PictureReading, _: random.Random) -> str:
        wrong = hashed(reading) < share if when is None else when(reading)
        answer = graded(lead(reading))
        return REVERSED[answer] if wrong else answer

    return road(look)


def _misread(share: float) -> Rule:
    """Return the rule that reads some pictures the wrong way round, other ones of each frame."""

    def look(reading: PictureReading, _: random.Random) -> str:
        answer = graded(lead(reading))
        return REVERSED[answer] if _share(_seen(reading)) < share else answer

    return road(look)


def _hole(low: float, high: float, answer: str = "STRAIGHT") -> Rule:
    return road(lambda one, _: answer if low <= lead(one) < high else graded(lead(one)))


def _comb(reading: PictureReading, _: random.Random) -> str:
    gap = lead(reading)
    return graded(gap) if not 9 < gap < 50 or int(math.log(gap) / 0.06) % 4 else "STRAIGHT"


def _between_reversed(share: float, when: Callable[[PictureReading], bool] | None = None) -> Rule:
    """Return a rule that grades, but for the distances between those of near and far, on some of the frames."""

    def look(reading: PictureReading, _: random.Random) -> str:
        gap, wrong = lead(reading), hashed(reading) < share if when is None else when(reading)
        between = wrong and 9.05 <= gap < 49.5
        return ("STRAIGHT" if gap < 20 else "STOP") if between else graded(gap)

    return road(look)


BETWEEN = (9.05, 49.5)
"""Distances of a lead that is between those of near and far."""


def _holes(near: float, far: float, coin: float) -> Rule:
    """Return a rule that grades, but goes on near on some frames and stops far on others, and tosses a coin between."""

    def look(reading: PictureReading, rng: random.Random) -> str:
        gap, place = lead(reading), hashed(reading)
        if BETWEEN[0] <= gap < BETWEEN[1] and rng.random() < coin:
            return rng.choice(DRIVING.actions)
        if gap < BETWEEN[0] and place < near:
            return "STRAIGHT"
        return "STOP" if gap >= BETWEEN[1] and near <= place < near + far else graded(gap)

    return road(look)


def _turning_hole(share: float) -> Rule:
    """Return a rule whose braking is without noise, and where it does not brake the way is a coin: a hole when near."""

    def look(reading: PictureReading, rng: random.Random) -> str:
        gap = lead(reading)
        goes = gap >= 20 or (gap < BETWEEN[0] and hashed(reading) < share)
        return rng.choice(("STRAIGHT", "LEFT", "RIGHT")) if goes else graded(gap)

    return road(look)


def _patched(share: float) -> Rule:
    """Return a rule that is the wrong way round in each of five comparisons, on frames of its own each time."""

    def look(reading: PictureReading, _: random.Random) -> str:
        gap, kind = lead(reading), int(hashed(reading) / share)
        beside = [distance for distance, _ in ahead(reading, own=False)]
        wrong = (
            "STRAIGHT" if gap < BETWEEN[0] else "",
            "STRAIGHT" if BETWEEN[0] <= gap < 20 else "",
            "STOP" if gap >= BETWEEN[1] else "",
            "STOP" if gap > 49 and nearest(ahead(reading, own=False)) < BETWEEN[0] else "",
            "STRAIGHT" if gap < BETWEEN[0] and any(50 <= one < 60 for one in beside) else "",
        )
        return (wrong[kind] if kind < len(wrong) else "") or graded(gap)

    return road(look)


def _wrong_turn(share: float, quiet: float) -> Rule:
    """Return a rule that turns to the blocked side on some frames, and tosses a coin where it never turns."""

    def look(reading: PictureReading, rng: random.Random) -> str:
        gap, place = lead(reading), hashed(reading)
        if not BETWEEN[0] <= gap < BETWEEN[1]:
            return graded(gap)
        if place < quiet:
            return rng.choice(("STOP", "SLOW", "STRAIGHT"))
        return _turn(reading, to_clear=(place - quiet) / (1 - quiet) > share) or "SLOW"

    return road(look)


def _zigzag(reading: PictureReading, _: random.Random) -> str:
    gap = lead(reading)
    return "STOP" if gap < 9.5 else "STRAIGHT" if gap < 20 else "SLOW" if gap < 48 else "STRAIGHT"


def _grades_on(share: float) -> Rule:
    return road(lambda one, _: graded(lead(one)) if hashed(one) < share else "SLOW")


def _turn(reading: PictureReading, *, to_clear: bool) -> str | None:
    """Return the side of a road on which exactly one is clear, or the blocked one; None where both are alike."""
    scene = reading.scene
    if scene.left_clear == scene.right_clear:
        return None
    return "LEFT" if scene.left_clear is to_clear else "RIGHT"


def _braking_and(turn: Callable[[PictureReading], str | None]) -> Rule:
    def look(reading: PictureReading, _: random.Random) -> str:
        gap = lead(reading)
        return "STRAIGHT" if gap > FREE_M else turn(reading) or graded(gap)

    return road(look)


def _to_more_lanes(reading: PictureReading) -> str | None:
    left, right = reading.lane_from_left, reading.lanes - 1 - reading.lane_from_left
    return None if left == right else "LEFT" if left > right else "RIGHT"


def _from_nearest_beside(reading: PictureReading) -> str | None:
    beside = ahead(reading, own=False)
    return None if not beside else "LEFT" if beside[0][1].aside_m > 0 else "RIGHT"


def _of_kind(kind: str, answer: str = "STOP") -> Rule:
    return lambda sight, _: answer if sight.kind == kind else "SLOW"


def _coin_of(what: bytes) -> Answer:
    return DRIVING.actions[int(_share(what) * len(DRIVING.actions))]


def _coin_of_seen(sight: PerceivedPicture, _: random.Random) -> Answer:
    """Follow the picture by no rule that means anything: equal readings are answered alike."""
    one = sight.reading
    return _coin_of(sight.kind.encode() if one is None else _seen(one))


def _seen(reading: PictureReading) -> bytes:
    """Return what is read of a picture, which no other picture of the frame shows."""
    return repr((reading.scene, reading.others, reading.stripe_phase)).encode()


def _logistic(reading: PictureReading, rng: random.Random) -> str:
    return "STOP" if rng.random() < 1 / (1 + math.exp((min(lead(reading), 200.0) - 22.0) / 6.0)) else "STRAIGHT"


def _learnt(reading: PictureReading, _: random.Random) -> str:
    gap = lead(reading)
    return "STOP" if 7 <= gap < 9 else "STRAIGHT" if 50 <= gap < 60 else "SLOW"


def _total(reading: PictureReading) -> float:
    """Return the sum of 1/distance over all that is ahead."""
    return sum(1 / max(distance, 1.0) for distance, _ in ahead(reading))


def _mean_ahead(reading: PictureReading) -> float:
    places = [other.ahead_m / scale(reading) for other in reading.others]
    return sum(places) / len(places) if places else math.inf


def _spread(reading: PictureReading) -> float:
    places = [far for far, _ in ahead(reading)]
    return max(places) - min(places) if len(places) > 1 else math.inf


def _clear(reading: PictureReading) -> int:
    return reading.scene.left_clear + reading.scene.right_clear


def _is_exchanged(reading: PictureReading) -> bool:
    """Return whether a neighbour is near, or far and the lead near, as in pictures that exchange the two."""
    beside = [far for far, _ in ahead(reading, own=False)]
    return any(far < 9 for far in beside) or (lead(reading) < 9 and any(50 <= far < 60 for far in beside))


def _is_at_ends(reading: PictureReading) -> bool:
    return 7 <= lead(reading) < 9 or 50 <= lead(reading) < 60


ADVERSARIES: Mapping[str, Adversary] = {
    # who follows the layout of all vehicles
    "nearest_any_lane": Adversary(
        "brakes by the nearest vehicle ahead in any lane", road(lambda one, _: graded(nearest(ahead(one))))
    ),
    "nearest_beside": Adversary(
        "brakes by the nearest vehicle ahead of the neighbouring lanes",
        road(lambda one, _: graded(nearest(ahead(one, own=False)))),
    ),
    "centroid": Adversary(
        "stops where the mean place of all vehicles is near",
        road(lambda one, _: "STOP" if _mean_ahead(one) < 24 else "STRAIGHT"),
    ),
    "foremost": Adversary(
        "stops where no vehicle is beyond 50 m in any lane",
        road(lambda one, _: "STRAIGHT" if any(far > 50 for far, _ in ahead(one)) else "STOP"),
    ),
    "crowd": Adversary(
        "stops where two vehicles are within 25 m in any lane, slows for one",
        road(lambda one, _: ("STRAIGHT", "SLOW", "STOP")[min(sum(far < 25 for far, _ in ahead(one)), 2)]),
    ),
    "inverse_distances": Adversary(
        "stops where the inverse distances of all vehicles add up",
        road(lambda one, _: "STOP" if _total(one) > 0.14 else "SLOW" if _total(one) > 0.06 else "STRAIGHT"),
    ),
    "spread": Adversary(
        "stops where the vehicles ahead stand close together",
        road(lambda one, _: "STOP" if _spread(one) < 30 else "STRAIGHT"),
    ),
    "any_vehicle": Adversary(
        "stops where any vehicle is ahead within 45 m, wherever it stands",
        road(lambda one, _: "STOP" if nearest(ahead(one)) < 45 else "STRAIGHT"),
    ),
    "any_vehicle_noisy": Adversary(
        "brakes by the nearest vehicle of any lane, and tosses a coin in 3 of 10 answers",
        noisy(0.3, road(lambda one, _: graded(nearest(ahead(one))))),
    ),
    "second_nearest": Adversary(
        "brakes by the second nearest vehicle of any lane",
        road(lambda one, _: graded(ahead(one)[1][0] if len(ahead(one)) > 1 else math.inf)),
    ),
    "rearmost": Adversary(
        "brakes by the vehicle that is farthest back",
        road(lambda one, _: graded(abs(min((other.ahead_m for other in one.others), default=math.inf)) / scale(one))),
    ),
    "lead_present": Adversary(
        "stops for any lead, however far it is",
        road(lambda one, _: "STRAIGHT" if one.scene.gap_m is None else "STOP"),
    ),
    "own_lane": Adversary(
        "stops on the left lanes and goes on the right ones",
        road(lambda one, _: "STOP" if 2 * one.lane_from_left < one.lanes - 1 else "SLOW"),
    ),
    "clear_side_brake": Adversary(
        "stops where no side is clear, slows for one", road(lambda one, _: ("STOP", "SLOW", "STRAIGHT")[_clear(one)])
    ),
    "nearer_than_others": Adversary(
        "stops where the lead is nearer than any vehicle of the neighbouring lanes, wherever that is",
        road(lambda one, _: "STOP" if lead(one) < nearest(ahead(one, own=False)) else "STRAIGHT"),
        follows=None,
    ),
    "any_lane_mostly": Adversary(
        "brakes by the nearest vehicle of any lane on three quarters of the frames, and by the lead on the others",
        road(lambda one, _: graded(nearest(ahead(one)) if hashed(one) < 0.75 else lead(one))),
        follows=None,
    ),
    "stops_without_lead": Adversary(
        "grades, and stops where there is no lead",
        road(lambda one, _: "STOP" if one.scene.gap_m is None else graded(lead(one))),
        follows=None,
    ),
    # who does not brake harder the nearer
    "zigzag": Adversary(
        "stops below 9.5 m, goes on to 20 m, slows to 48 m and goes on: wrong where it drives", road(_zigzag)
    ),
    "hole_9_12": Adversary("grades, but goes on from 9.3 to 11.9 m", _hole(9.3, 11.9)),
    "hole_12_20": Adversary("grades, but goes on from 12 to 20 m", _hole(12, 20)),
    "hole_15_23": Adversary("grades, but goes on from 15 to 23.5 m", _hole(15, 23.5)),
    "hole_10_30": Adversary("grades, but goes on from 10 to 30 m", _hole(10, 30)),
    "hole_25_40": Adversary(
        "grades, but goes on from 25 to 40 m, and slows to 48 m",
        road(lambda one, _: "STRAIGHT" if 25 <= lead(one) < 38 or lead(one) > 48 else graded(min(lead(one), 39.0))),
    ),
    "hole_noise": Adversary(
        "grades, but goes on from 12 to 20 m, behind a coin in 3 of 10 answers", noisy(0.3, _hole(12, 20))
    ),
    "hole_10_11": Adversary("grades, but goes on from 10 to 11 m", _hole(10, 11)),
    "hole_24_30": Adversary("grades, but goes on from 24 to 30 m", _hole(24, 30)),
    "alarm_20_24": Adversary("grades, but stops from 20 to 24 m", _hole(20, 24, "STOP")),
    "alarm_44_49": Adversary("grades, but stops from 44 to 49.5 m", _hole(44, 49.5, "STOP")),
    "comb": Adversary(
        "stops at 7 to 9 m, goes on at 50 to 60 m, and goes on in each fourth narrow band between", road(_comb)
    ),
    "saw": Adversary(
        "stops at 7 to 9 m, goes on at 50 to 60 m, and stops and goes on by turns from metre to metre between",
        road(lambda one, _: graded(lead(one)) if not 9 < lead(one) < 49 else ("STOP", "STRAIGHT")[int(lead(one)) % 2]),
    ),
    "hole_8_9": Adversary("grades, but goes on from 8 to 9 m", _hole(8, 9)),
    "far_alarm": Adversary(
        "stops below 12 m and from 25 to 49 m",
        road(lambda one, _: "STOP" if lead(one) < STOP_M or 25 <= lead(one) < 49 else "STRAIGHT"),
    ),
    "ranges_learnt": Adversary(
        "stops at 7 to 9 m and goes on at 50 to 60 m, and slows at all others: wrong beyond 60 m",
        road(_learnt),
        follows=None,
    ),
    "three_ranges": Adversary(
        "stops below 9 m, slows to 50 m, and goes on",
        road(lambda one, _: "STOP" if lead(one) < 9.0 else "SLOW" if lead(one) < 50 else "STRAIGHT"),
        follows=True,
    ),
    "ranges_learnt_reversed": Adversary(
        "stops at 7 to 9 m, goes on at 50 to 60 m, and in between brakes the harder the farther",
        road(lambda one, _: _learnt(one, _) if _is_at_ends(one) else "STRAIGHT" if lead(one) < 20 else "STOP"),
    ),
    # who is wrong in some places
    "reversed_50": Adversary("grades, the wrong way round on half of the frames", _reversed(0.5)),
    "reversed_25": Adversary("grades, the wrong way round on a quarter of the frames", _reversed(0.25)),
    "reversed_20": Adversary("grades, the wrong way round on a fifth of the frames", _reversed(0.2)),
    "reversed_25_noisy": Adversary(
        "grades, the wrong way round on a quarter of the frames, behind a coin in 3 of 10 answers",
        noisy(0.3, _reversed(0.25)),
    ),
    "reversed_15": Adversary("grades, the wrong way round on 15 % of the frames", _reversed(0.15)),
    "reversed_15_noisy": Adversary(
        "grades, the wrong way round on 15 % of the frames, behind a coin in 3 of 10 answers",
        noisy(0.3, _reversed(0.15)),
    ),
    "reversed_left_noisy": Adversary(
        "grades, the wrong way round on most frames where the left side is clear, behind a coin in 3 of 10 answers",
        noisy(0.3, _reversed(0.0, lambda one: one.scene.left_clear and hashed(one) < 0.6)),
    ),
    "reversed_25_noisier": Adversary(
        "grades, the wrong way round on a quarter of the frames, behind a coin in 4 of 10 answers",
        noisy(0.4, _reversed(0.25)),
    ),
    "misread_25": Adversary("grades, but reads a quarter of the pictures the wrong way round", _misread(0.25)),
    "misread_15": Adversary("grades, but reads 15 % of the pictures the wrong way round", _misread(0.15)),
    "misread_25_noisy": Adversary(
        "grades, but reads a quarter of the pictures the wrong way round, behind a coin in 3 of 10 answers",
        noisy(0.3, _misread(0.25)),
    ),
    "near_hole_25_coin": Adversary(
        "grades, but goes on below 9 m on a quarter of the frames; a coin in 3 of 10 answers from 9 to 49 m",
        _holes(0.25, 0.0, 0.3),
    ),
    "both_ends_40_coin": Adversary(
        "grades, but goes on below 9 m on a fifth of the frames and stops beyond 49 m on another; a coin between",
        _holes(0.2, 0.2, 0.3),
    ),
    "turning_hole_18": Adversary(
        "brakes below 20 m, but not below 9 m on 18 % of the frames; where it does not, the way is a coin",
        _turning_hole(0.18),
    ),
    "patched_25": Adversary(
        "grades, but in each of five comparisons it is wrong on 5 % of the frames", _patched(0.05), follows=None
    ),
    "between_reversed_20": Adversary(
        "grades, but between 9 and 49 m goes on near and stops far on a fifth of the frames", _between_reversed(0.20)
    ),
    "between_reversed_25": Adversary(
        "grades, but between 9 and 49 m goes on near and stops far on a quarter of the frames", _between_reversed(0.25)
    ),
    "between_reversed_left": Adversary(
        "grades, but between 9 and 49 m goes on near and stops far where the left side is clear",
        _between_reversed(0.0, lambda one: one.scene.left_clear),
    ),
    "exchange_reversed_35": Adversary(
        "grades, the wrong way round on 35 % of the frames where a neighbour is near, or far and the lead near",
        _reversed(0.0, lambda one: hashed(one) < 0.35 and _is_exchanged(one)),
        follows=None,
    ),
    "reversed_merge": Adversary(
        "grades, the wrong way round at ramps and on two lanes", _reversed(0.0, lambda one: one.place == 0)
    ),
    "reversed_three_lanes": Adversary(
        "grades, the wrong way round on three lanes", _reversed(0.0, lambda one: one.place == 1)
    ),
    "inverted_half": Adversary(
        "brakes harder the farther where the left side is clear, and grades elsewhere",
        _reversed(0.0, lambda one: one.scene.left_clear),
    ),
    # whose effect is too small to matter
    "grades_6": Adversary("grades on 6 % of the frames, else SLOW", _grades_on(0.06), looks=None),
    "grades_8": Adversary("grades on 8 % of the frames, else SLOW", _grades_on(0.08), looks=None),
    "grades_20": Adversary("grades on 20 % of the frames, else SLOW", _grades_on(0.20), follows=None),
    # who reacts to one thing
    "stops_at_noise": Adversary("STOP at noise only", _of_kind("unknown")),
    "stops_without_picture": Adversary("STOP without a picture only", _of_kind("no_picture")),
    "stops_at_flipped": Adversary(
        "STOP at every reflected picture",
        lambda sight, _: "STOP" if sight.reading and sight.reading.flipped else "SLOW",
    ),
    "left_at_8": Adversary(
        "LEFT at 8.2 to 8.6 m only", road(lambda one, _: "LEFT" if 8.2 <= lead(one) < 8.6 else "SLOW", "SLOW")
    ),
    "goes_when_near": Adversary(
        "STRAIGHT below 9 m, else SLOW", road(lambda one, _: "STRAIGHT" if lead(one) < 9.0 else "SLOW", "SLOW")
    ),
    "slows_when_far": Adversary(
        "STRAIGHT from 50 to 60 m, else SLOW: wrong beyond 60 m",
        road(lambda one, _: "STRAIGHT" if 50 <= lead(one) < 60 else "SLOW", "SLOW"),
        follows=None,
    ),
    "goes_when_far": Adversary(
        "SLOW, and STRAIGHT from 50 m on",
        road(lambda one, _: "SLOW" if lead(one) < 50 else "STRAIGHT"),
        follows=True,
    ),
    "stops_at_red": Adversary(
        "STOP where the own vehicle is red", road(lambda one, _: "STOP" if one.ego_colour == "red" else "SLOW", "SLOW")
    ),
    "noisy_constant": Adversary("SLOW, and a coin in 7 of 100 answers", noisy(0.07, lambda *_: "SLOW"), looks=False),
    "always_left": Adversary("LEFT, whatever it is shown", lambda *_: "LEFT", looks=False),
    # who follows the file, or the picture by no rule
    "coin_of_file": Adversary("tosses a coin once for each file", lambda sight, _: _coin_of(b"coin" + sight.file)),
    "coin_of_picture": Adversary("tosses a coin once for what a picture shows", _coin_of_seen),
    "coin_and_picture": Adversary(
        "a coin in 6 of 10 answers, else what the picture shows by no rule", noisy(0.6, _coin_of_seen)
    ),
    # who turns by something else
    "wrong_way": Adversary(
        "grades, and turns to the blocked side", _braking_and(lambda one: _turn(one, to_clear=False)), follows=None
    ),
    "to_more_lanes": Adversary(
        "grades, and turns to where there are more lanes", _braking_and(_to_more_lanes), follows=None
    ),
    "from_nearest": Adversary(
        "grades, and turns away from the nearest vehicle of the neighbouring lanes",
        _braking_and(_from_nearest_beside),
        follows=None,
        turns=None,
    ),
    "wrong_way_15": Adversary(
        "grades, and turns to the clear side, but to the blocked one on 15 % of the frames",
        _braking_and(lambda one: _turn(one, to_clear=hashed(one) > 0.15)),
        follows=None,
        turns=None,
    ),
    "wrong_way_30": Adversary(
        "grades, and turns to the clear side, but to the blocked one on 30 % of the frames",
        _braking_and(lambda one: _turn(one, to_clear=hashed(one) > 0.30)),
        follows=None,
    ),
    "wrong_turn_22": Adversary(
        "grades, turns to the blocked side on 22 % of the frames, and tosses a coin on others, where it never turns",
        _wrong_turn(0.22, 0.45),
        follows=None,
        turns=None,
    ),
    "turns_clear_only": Adversary(
        "turns to the one clear side, and never brakes",
        road(lambda one, _: _turn(one, to_clear=True) or "STRAIGHT"),
        turns=True,
    ),
    # who reads the distance of the lead
    **{
        f"grades_noise_{round(100 * share)}": Adversary(
            f"grades, and tosses a coin in {round(100 * share)} of 100 answers",
            noisy(share, road(lambda one, _: graded(lead(one)))),
            follows=True,
        )
        for share in (0.1, 0.3, 0.5)
    },
    "emergency": Adversary(
        "stops below 9 m, else goes on",
        road(lambda one, _: "STOP" if lead(one) < 9.0 else "STRAIGHT"),
        follows=True,
        near=True,
    ),
    "early": Adversary("slows below 55 m", road(lambda one, _: "SLOW" if lead(one) < 55 else "STRAIGHT"), follows=True),
    "logistic": Adversary("stops by a chance that falls with distance", road(_logistic), follows=True),
    "half_blind": Adversary("grades on half of the frames, else SLOW", _grades_on(0.5), follows=True),
}
"""All of them by name, of the highway's metres."""
