"""Rotations in a robot's log: as they are declared, checked against the data, and recognised."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from eyechart.errors import SpecError, did_you_mean
from eyechart.importing.motion_log import LogDescription, MotionSegment, tell
from eyechart.spaces.rotations import (
    DEGREES,
    EULER,
    FREEDOM,
    REPRESENTATIONS,
    WIDTH,
    Floats,
    Representation,
    Rotation,
    about_their_mean,
    compared,
    matrices,
    mean,
    read_representation,
    vectors,
)

NONE = "none"
"""The word for numbers that look like a rotation and are none."""
LEAST_SEEN = 10
"""The fewest rows in which a rotation is recognised."""
_GIVEN = 0.9
"""The least share of rows that are not all zeros."""
_LENGTH, _EXACT = 0.02, 1e-3
"""Largest error of a unit length in declared numbers, and in numbers that are recognised."""
_TURN, _NEAR = 0.5, 2.8
"""A rotation vector that changes its sign moves far and turns by less than this. The least median
norm in radians of rotation vectors that stay near half a turn."""
_LEAST_FLIPS, _MOST, _HALF = 2, 0.8, 0.5
"""The fewest such changes that are evidence, the share of far moves that they must be, and how
opposite each number must be, 1 for always."""
_ALIKE, _UNIT = 0.9, 0.1
"""The least correlation of a number with its place in the state, and the largest error of a unit's
factor."""
_DECLARED = re.compile(r"([^\[\]=]+)\[(\d{1,4}):(\d{1,4})\]=(\w+)")

Of = Literal["motion", "state"]
Places = Mapping[Of, Sequence[tuple[str, int]]]
"""The feature, and the number in it, of every number of the motion and of the state."""
Names = Mapping[Of, Sequence[str]]


@dataclass(frozen=True, slots=True)
class DeclaredRotation:
    """Numbers ``start`` to ``stop`` (excluded) of a feature; without a representation no rotation."""

    feature: str
    start: int
    stop: int
    representation: Representation | None

    @classmethod
    def read(cls, text: str) -> "DeclaredRotation":
        """Return what ``FEATURE[3:7]=quat_xyzw`` declares; raises SpecError with the form."""
        found = _DECLARED.fullmatch(text.strip())
        if found is None:
            raise SpecError(
                f"--rotation {text}: write FEATURE[FIRST:END]={' or '.join((*REPRESENTATIONS, NONE))}, "
                "as action[3:7]=quat_xyzw"
            )
        word, start, stop = found[4], int(found[2]), int(found[3])
        if stop <= start:
            raise SpecError(f"--rotation {text}: [{start}:{stop}] holds no number; the end comes after the last one")
        known = None if word == NONE else read_representation(word)
        if known is not None and stop - start != WIDTH[known]:
            raise SpecError(
                f"--rotation {text}: {word} has {WIDTH[known]} numbers, and [{start}:{stop}] {stop - start}"
            )
        return cls(found[1].strip(), start, stop, known)

    def place(self, places: Places) -> tuple[Of, int]:
        """Return where its first number is; raises SpecError if the feature has no such numbers."""
        option = f"--rotation {self.feature}[{self.start}:{self.stop}]"
        for of, numbers in places.items():
            if (self.feature, self.start) in numbers and (self.feature, self.stop - 1) in numbers:
                return of, [*numbers].index((self.feature, self.start))
        counts = {name: place + 1 for many in places.values() for name, place in many}
        if self.feature in counts:
            raise SpecError(f"{option}: '{self.feature}' has {counts[self.feature]} numbers")
        there = ", ".join(f"{name} ({count})" for name, count in counts.items())
        raise SpecError(f"{option}: there is no such feature;{did_you_mean(self.feature, [*counts])} there are {there}")


@dataclass(frozen=True)
class LoggedRows:
    """All rows of a log, (n, numbers), of the motion and of the state, with their names."""

    rows: Mapping[Of, Floats]
    joined: Mapping[Of, np.ndarray]
    places: Places
    names: Names

    @classmethod
    def of(cls, walks: Sequence[MotionSegment], places: Places, names: Names) -> "LoggedRows":
        """Return the rows of all walks; ``joined`` marks the rows that follow the row before."""
        follows = np.concatenate([np.arange(len(walk.done)) > 0 for walk in walks])
        done, states = (np.concatenate(many) for many in ([one.done for one in walks], [one.states for one in walks]))
        return cls({"motion": done, "state": states}, {"motion": follows, "state": follows}, places, names)

    def rotations(self, declared: Sequence[DeclaredRotation]) -> tuple[Rotation, ...]:
        """Return the declared rotations; raises SpecError for wrong ones and undeclared ones.

        The rotations of the motion belong to those of the state in their order, if their counts
        agree.
        """
        found, known = list[Rotation](), set[tuple[Of, int]]()
        for one in declared:
            of, first = one.place(self.places)
            own = {(of, first + step) for step in range(one.stop - one.start)}
            if twice := known & own:
                raise SpecError(f"--rotation declares a number twice: {self._named(of, min(twice)[1], 1)}")
            known |= own
            if one.representation is not None:
                found.append(Rotation(one.representation, first, of))
        wrong = [f"--rotation {fault}" for fault in self.faults(found)]
        undeclared = [line for of in self.rows for line in self._undeclared(of, known)]
        if wrong or undeclared:
            raise SpecError("\n".join([*wrong, *undeclared]))
        state = sorted(one.first for one in found if one.of == "state")
        motion = sorted((one for one in found if one.of == "motion"), key=lambda one: one.first)
        pairs: Sequence[int | None] = state if len(state) == len(motion) else [None] * len(motion)
        moved = [
            Rotation(one.representation, one.first, "motion", place) for one, place in zip(motion, pairs, strict=True)
        ]
        return (*moved, *(one for one in found if one.of == "state"))

    def faults(self, rotations: Sequence[Rotation]) -> list[str]:
        """Return the rotations that the data contradict, each with the reason."""
        every = {one: self._fault(one) for one in rotations}
        return [
            f"{self._named(one.of, one.first, len(one.numbers))}={one.representation}: {fault}"
            for one, fault in every.items()
            if fault
        ]

    def _named(self, of: Of, first: int, count: int) -> str:
        feature, start = self.places[of][first]
        return f"{feature}[{start}:{start + count}]"

    def _fault(self, one: Rotation) -> str:
        """Return why numbers are not the rotation that they are declared to be, "" if they may be."""
        rows = self.rows[one.of][:, one.numbers.start : one.numbers.stop]
        names = [self.names[one.of][number].lower() for number in one.numbers]
        fault = _contradicted(names, one.representation) or _spoiled(rows, one.representation)
        if not fault:
            return self._is_part(one)
        size = next((size for size in (6, 4, 3) if _seen(self._window(one.of, one.first, size), None)), 0)
        like = _seen(self._window(one.of, one.first, size), None) if size else ""
        named = self._named(one.of, one.first, size)
        return f"{fault}" + (f"; {named} look like {like}" if like and like != one.representation else "")

    def _is_part(self, one: Rotation) -> str:
        """Return of which longer rotation numbers are a part, "" if of none."""
        places, (start, stop) = self.places[one.of], (one.numbers.start, one.numbers.stop)
        for size in (size for size in (6, 4) if size > stop - start):
            for first in range(max(0, stop - size), min(start, len(places) - size) + 1):
                like = _seen(self._window(one.of, first, size), None)
                if like and places[first][0] == places[first + size - 1][0]:
                    return f"they are a part of {self._named(one.of, first, size)}, which look like {like}"
        return ""

    def _window(self, of: Of, first: int, size: int) -> Floats:
        return self.rows[of][:, first : first + size]

    def _undeclared(self, of: Of, known: set[tuple[Of, int]]) -> Iterator[str]:
        """Yield a question for all numbers that look like a rotation and are not declared."""
        taken, every = set(known), self.places[of]
        for size in (6, 4, 3):
            for first in range(len(every) - size + 1):
                window = {(of, first + step) for step in range(size)}
                if window & taken or every[first][0] != every[first + size - 1][0]:
                    continue
                like = _seen(self._window(of, first, size), self.joined[of])
                if like:
                    taken |= window
                    names = [name.lower() for name in self.names[of][first : first + size]]
                    like = "quat_wxyz" if size == 4 and _has_w_first(names) else like
                    first_w = _OR.get(like, "")
                    named = self._named(of, first, size)
                    yield (
                        f"{named} look like a rotation ({like}): {_WHY[size]}. Declare it with "
                        f"--rotation '{named}={like}'{first_w}, or --rotation '{named}={NONE}'"
                    )


_WHY = {
    6: "two vectors of length 1 at a right angle in every row",
    4: "four numbers of length 1 in every row",
    3: "a vector that stays near a length of pi, or changes its sign there",
}


_OR = {
    "quat_xyzw": " or quat_wxyz, if w is its first number",
    "axis_angle": " or euler_xyz or another order, if they are three angles",
}
"""Other rotations that such numbers may be, by the likeliest."""


def _has_w_first(names: Sequence[str]) -> bool:
    return names[0].endswith("w") and not names[-1].endswith("w")


def _contradicted(names: Sequence[str], representation: Representation) -> str:
    """Return how the names of numbers contradict a quaternion's order, "" if they do not."""
    if representation == "quat_xyzw" and _has_w_first(names):
        return f"its first number is named '{names[0]}', as in quat_wxyz"
    if representation == "quat_wxyz" and names[-1].endswith("w") and not names[0].endswith("w"):
        return f"its last number is named '{names[-1]}', as in quat_xyzw"
    return ""


def _spoiled(rows: Floats, representation: Representation) -> str:
    """Return why no such rotation has these numbers, "" if it may."""
    size = np.linalg.norm(rows, axis=1)
    if representation.startswith("quat"):
        worst = float(size[np.abs(size - 1).argmax()])
        return "" if abs(worst - 1) <= _LENGTH else f"a quaternion has length 1, and one row has {worst:.3g}"
    if representation == "rot6d":
        if _off_frame(rows) <= _LENGTH:
            return ""
        if _off_frame(_by_rows(rows)) <= _LENGTH:
            return "the numbers are (3, 2) in memory, row by row; rot6d is the first column, then the second"
        return f"its two columns must have length 1 and a right angle, and one row is off by {_off_frame(rows):.3g}"
    return _no_angles(float(size.max() if representation == "axis_angle" else np.abs(rows).max()), representation)


def _no_angles(most: float, representation: Representation) -> str:
    """Return why angles of at most so much are not those of a representation, "" if they may be."""
    if representation.endswith(DEGREES):
        if most > 365:
            return f"an angle has at most 360 degrees, and one row has {most:.3g}"
        radians = np.pi - _LENGTH < most <= np.pi + _EXACT
        return f"no angle is beyond pi; are these radians? Declare {representation[:-4]}" if radians else ""
    if most <= 2 * np.pi + 0.1:
        return ""
    if representation.startswith(EULER):
        way = f"if in degrees, declare {representation}{DEGREES}"
        return f"an angle has at most 2 pi radians, and one row has {most:.3g}; {way}"
    degrees = "; are these degrees? Give radians" if most > 20 else ""
    return f"a rotation vector has at most 2 pi radians, and one row has {most:.3g}{degrees}"


def _by_rows(rows: Floats) -> Floats:
    return np.asarray(rows[:, [0, 2, 4, 1, 3, 5]])


def _off_frame(rows: Floats) -> float:
    """Return the largest error of length or of the right angle in columns of shape (n, 6)."""
    one, other = rows[:, :3], rows[:, 3:]
    lengths = [np.abs(np.linalg.norm(each, axis=1) - 1) for each in (one, other)]
    return float(np.max([*lengths, np.abs((one * other).sum(axis=1))]))


def _seen(rows: Floats, joined: np.ndarray | None) -> Representation | Literal[""]:
    """Return the rotation that rows of 3, 4 or 6 numbers show beyond doubt, "" for none.

    Rows of zeros and ones are no evidence, and at least three numbers must vary. Of a quaternion
    two are enough: those of a turn about one axis.
    """
    least = 2 if rows.shape[1] == 4 else 3
    if rows.shape[1] > 3:
        given = rows[rows.any(axis=1)]  # a few rows of zeros are readings that are missing
        rows = given if len(given) >= _GIVEN * len(rows) else rows
    if len(rows) < LEAST_SEEN or (rows.std(axis=0) > _EXACT).sum() < least or np.isin(rows, (0, 1, -1)).all():
        return ""
    if rows.shape[1] == 6:
        return "rot6d" if _off_frame(rows) <= _EXACT else ""
    size = np.linalg.norm(rows, axis=1)
    if rows.shape[1] == 4:
        return "quat_xyzw" if np.abs(size - 1).max() <= _EXACT else ""
    if joined is None or not _NEAR < size.max() <= 2 * np.pi + _EXACT:
        return ""
    stays_near = np.median(size) > _NEAR and np.pi - 0.02 < size.max() <= np.pi + _EXACT
    return "axis_angle" if stays_near or _flips(rows, joined) else ""


def _flips(rows: Floats, joined: np.ndarray) -> bool:
    """Return whether rotation vectors move by more than pi in one step, but turn only a little.

    All three numbers change their signs then. If only one does, it is a joint that wraps.
    """
    places = np.flatnonzero(joined)
    far = np.linalg.norm(rows[places] - rows[places - 1], axis=1) > np.pi
    places = places[far]
    if len(places) < _LEAST_FLIPS:
        return False
    before, after = (matrices(rows[many], "axis_angle") for many in (places - 1, places))
    turns = np.linalg.norm(compared(before) - compared(after), axis=1)
    products = rows[places - 1] * rows[places]
    opposite = products.sum(axis=0) < -_HALF * np.abs(products).sum(axis=0)
    return bool(opposite.all() and (turns < _TURN).mean() > _MOST)


def tell_turned(
    walks: Sequence[MotionSegment], named: Sequence[int | None], rotations: Sequence[Rotation], wide: int
) -> LogDescription:
    """Return the evidence of a log on its kind, as `tell`, with the pairs of its plain numbers.

    ``wide`` is the count of the state's numbers. A rotation counts as three numbers.
    """
    if not rotations or not walks:
        return tell(walks, named)
    motion, state = (tuple(one for one in rotations if one.of == of) for of in ("motion", "state"))
    own, theirs = _sources(len(named), motion), _sources(wide, state)
    partners = dict(enumerate(named)) | {one.first: one.state for one in motion}
    turned = [
        theirs.index(partner) + place - own.index(number) if (partner := partners[number]) in theirs else None
        for place, number in enumerate(own)
    ]
    evidence = tell(_in_turns(walks, motion, state), turned)
    firsts = {one.first for one in state}
    found = {number: place for number, place in zip(own, evidence.pairs, strict=True) if place is not None}
    found = {number: theirs[place] for number, place in found.items() if theirs[place] not in firsts}
    return replace(evidence, pairs=tuple(found.get(number) for number in range(len(named))))


def _in_turns(
    walks: Sequence[MotionSegment], motion: tuple[Rotation, ...], state: tuple[Rotation, ...]
) -> list[MotionSegment]:
    """Return walks whose rotations are 3 numbers: their turns from the mean of their state."""
    done, states = (np.concatenate(many) for many in ([one.done for one in walks], [one.states for one in walks]))
    made, own = about_their_mean(done, motion), _sources(done.shape[1], motion)
    by_first = {one.first: one for one in state}
    for one in motion:
        if one.state is not None:
            theirs, found = mean(by_first[one.state].matrices(states)), one.matrices(done)
            # Places are near the state's mean; changes are not, and keep their own.
            if np.trace(theirs.T @ mean(found)) > 1:
                made[:, own.index(one.first) :][:, :3] = vectors(theirs.T @ found)
    cuts = np.cumsum([len(walk.done) for walk in walks])[:-1]
    parts = (np.split(many, cuts) for many in (made, about_their_mean(states, state)))
    return [MotionSegment(*pair) for pair in zip(*parts, strict=True)]


def _sources(count: int, rotations: Sequence[Rotation]) -> list[int]:
    """Return the number of the log that each number in turns is made of; a rotation's is its first."""
    first = {number: one.first for one in rotations for number in one.numbers}
    last = {number for one in rotations for number in one.numbers[FREEDOM:]}
    return [first.get(number, number) for number in range(count) if number not in last]


def in_degrees(walks: Sequence[MotionSegment], named: Sequence[int | None]) -> str:
    """Return that the motion is in degrees and the state in radians, or the reverse; "" for neither.

    ``named`` has the place in the state that each number names; without names it is its own place.
    """
    if not walks or not walks[0].states.shape[1]:
        return ""
    done, states = (np.concatenate(many) for many in ([one.done for one in walks], [one.states for one in walks]))
    places = [number if place is None else place for number, place in enumerate(named)]
    pairs = [(done[:, one], states[:, place]) for one, place in enumerate(places) if place < states.shape[1]]
    pairs = [(one, other) for one, other in pairs if one.std() > 0 and other.std() > 0]
    alike = [(one, other) for one, other in pairs if np.corrcoef(one, other)[0, 1] > _ALIKE]
    factors = np.array([one.std() / other.std() for one, other in alike])
    words = {
        180 / np.pi: "the motion in degrees and the state in radians",
        np.pi / 180: "the motion in radians and the state in degrees",
    }
    for factor, said in words.items():
        if 2 * (np.abs(factors / factor - 1) < _UNIT).sum() > len(pairs):
            return f"; the spreads have a factor of {factor:.3g}: {said}? Convert one of them"
    return ""
