"""Logged motions: the actions in a robot's log, row by row, from each moment on."""

from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Annotated, Any

import msgspec
import numpy as np
import numpy.typing as npt

from eyechart.errors import SourceError, SpecError, did_you_mean
from eyechart.importing.cells import Cell, Row, read_part
from eyechart.importing.faults import Faults
from eyechart.spaces.motion import PLACES, Dimension, Floats, Kind, MotionSpace
from eyechart.spaces.rotations import Rotation

MOST_NUMBERS = 50_000_000
"""The most numbers in all rows' motions together."""
LEAST_TOLD = 10
"""The fewest rows with a motion and a state that show the kind of a motion."""
PLACES_BELOW, CHANGES_ABOVE = 0.5, 1.0
"""Limits of the distance from the state, in units of the numbers' spread. Nearer numbers are
places; farther ones have no relation to the state."""
MOST_TOLD = 100_000
"""The most rows that are used to find the kind; the log may be longer."""
LEAST_WALKED = 30
"""The fewest steps, each with a state before and after, that show whether numbers are its
changes."""
FOLLOWS, ALIKE, LEAST_SHARE = 0.6, 0.9, 0.3
"""Three limits. The least correlation with the state's changes. The least correlation with the
state itself within an episode. The least share of numbers that follow the changes in a log of
changes."""
WINDOWS = (1, 4)
"""Widths, in steps, over which changes are compared: an arm lags behind its command."""
_STILL = 1e-9
"""A number does not vary if its spread is at most this share of the largest."""

Rows = tuple[tuple[float, ...], ...]


class MotionNumber(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One number of a motion's step: its column and its `eyechart.spaces.motion.Dimension`.

    ``state`` is the column of the state's number to which a place is relative.
    """

    column: str
    name: str = ""
    unit: str = ""
    scale: float | None = None
    along: str = ""
    state: str = ""


class ReflectedNumber(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A number's reflection: that of ``mirrors``, else its own, times ``sign`` about ``about``."""

    mirrors: str = ""
    sign: float = 1.0
    about: float = 0.0


class Reflection(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The reflection of a state and a motion; numbers that are not in ``numbers`` stay.

    ``words`` are exchanged in an instruction, such as left and right. Names are those of columns or
    of numbers.
    """

    numbers: dict[str, ReflectedNumber] = {}
    words: dict[str, str] = {}

    def by_column(self, *parts: Mapping[str, str]) -> "Reflection":
        """Return the same by columns; each of ``parts`` (motion, state) maps names to columns.

        A name that several parts have applies to each. Of two numbers that exchange places, one
        entry is enough. Raises SpecError if no part has a name, or if a name and its mirror are in
        different parts.
        """
        found: dict[str, ReflectedNumber] = {}
        for name, number in self.numbers.items():
            holders = [part for part in parts if name in part]
            if not holders:
                every = [*dict.fromkeys(other for part in parts for other in part)]
                raise SpecError(f"[reflection] names '{name}';{did_you_mean(name, every)} there are {', '.join(every)}")
            for part in holders:
                if number.mirrors and number.mirrors not in part:
                    raise SpecError(
                        f"[reflection]: '{name}' mirrors '{number.mirrors}', which is not of the same numbers"
                    )
                own, other = part[name], part[number.mirrors or name]
                found[own] = msgspec.structs.replace(number, mirrors="" if own == other else other)
        for column, number in list(found.items()):
            if number.mirrors:
                found.setdefault(number.mirrors, msgspec.structs.replace(number, mirrors=column))
        return Reflection(found, self.words)


class LoggedMotion(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The columns of a log that are motions: the action of each row's step, in this order."""

    number: Annotated[tuple[MotionNumber, ...], msgspec.Meta(min_length=1)]
    horizon: Annotated[int, msgspec.Meta(ge=1)]
    kind: Kind = "delta"
    rate_hz: float | None = None
    name: str = "action"
    rotations: tuple[Rotation, ...] = ()

    def space(self, state: Mapping[str, Sequence[str]], reflection: Reflection | None = None) -> MotionSpace:
        """Return the motion space of a bank; ``state`` maps each state to its numbers' columns.

        Raises SpecError if a number belongs to a column of no state, or the reflection is invalid.
        """
        columns = [column for many in state.values() for column in many]
        for one in self.number:
            if one.state and one.state not in columns:
                has = ", ".join(columns) or "no number"
                raise SpecError(f"the motion's '{one.column}' belongs to '{one.state}', but the state has {has}")
        names = {one.column: one.name or one.column for one in self.number}
        done = {name: column for column, name in names.items()} | {column: column for column in names}
        known = (reflection or Reflection()).by_column(done, {column: column for column in columns})
        given = [known.numbers.get(one.column, ReflectedNumber()) for one in self.number]
        places = [known.numbers.get(column, ReflectedNumber()) for column in columns]
        return MotionSpace(
            self.name,
            tuple(
                Dimension(
                    names[one.column],
                    unit=one.unit,
                    scale=one.scale,
                    along=one.along,
                    mirrors=names.get(there.mirrors, ""),
                    sign=there.sign,
                    about=there.about,
                    state=columns.index(one.state) if one.state else None,
                )
                for one, there in zip(self.number, given, strict=True)
            ),
            self.horizon,
            self.kind,
            self.rate_hz,
            state=tuple(
                Dimension(column, mirrors=there.mirrors, sign=there.sign, about=there.about)
                for column, there in zip(columns, places, strict=True)
            ),
            mirrored=reflection is not None,
            words=tuple(known.words.items()),
            rotations=self.rotations,
        )


@dataclass(frozen=True)
class MotionSegment:
    """The actions of consecutive steps of an episode, (n, numbers), and their states, (n, d)."""

    done: Floats
    states: Floats

    def moved(self, width: int) -> tuple[Floats, Floats]:
        """Return the sums over ``width`` steps, and the changes of the state in them."""
        total = np.concatenate([np.zeros((1, self.done.shape[1])), np.cumsum(self.done, axis=0)])
        return (total[width:] - total[:-width])[: len(self.done) - width], self.states[width:] - self.states[:-width]

    def stood(self, later: int) -> tuple[Floats, Floats]:
        """Return the actions and the states ``later`` steps later, each less its mean."""
        done, states = self.done[: len(self.done) - later], self.states[later:]
        return done - done.mean(axis=0), states - states.mean(axis=0)


@dataclass(frozen=True)
class LogDescription:
    """The evidence of the data on the kind of logged numbers.

    ``ratio`` is their distance from the paired numbers of the state, in units of their own spread.
    It is a root mean square, and the median of the ``count`` numbers whose partner varies; None
    without pairs. ``pairs`` has the place of each number's partner in the state, or None.
    ``follows`` is the share of numbers that correlate with the changes of the state, and ``alike``
    with the state itself, over ``walked`` steps.
    """

    ratio: float | None
    pairs: tuple[int | None, ...]
    count: int = 0
    follows: float = 0.0
    alike: float = 0.0
    walked: int = 0

    @property
    def kind(self) -> Kind | None:
        """Return the kind: places, changes, or None if the data do not show it.

        Changes need evidence of their own: numbers that are not places may be anything.
        """
        if self.ratio is not None and self.ratio < PLACES_BELOW:
            return "absolute"
        return "delta" if self.follows >= LEAST_SHARE and self.follows > self.alike else None

    def why(self) -> str:
        """Return the measurements in words."""
        far = "no state that varies can be paired with them"
        if self.ratio is not None:
            far = (
                f"the {self.count} numbers lie {self.ratio:.2g} of their own spread away from the state (rms, median; "
                f"places would lie below {PLACES_BELOW:g})"
            )
            if self.kind == "absolute":
                return far
        if self.walked < LEAST_WALKED:
            return f"{far}; only {self.walked} steps have a state before and behind, of {LEAST_WALKED} that are needed"
        alike = "" if not self.alike else f", and {self.alike:.0%} with the state itself, as places of another unit do"
        return f"{far}; {self.follows:.0%} of the numbers go along with the changes of the state{alike}"

    def contradicts(self, kind: Kind) -> bool:
        """Return whether the data clearly contradict this kind."""
        return self.kind is not None and (kind in PLACES) != (self.kind in PLACES)

    def warning(self, kind: Kind, by: str) -> str:
        """Return the warning for another kind that is declared ``by`` an option."""
        other = "places" if self.kind in PLACES else "changes"
        return f"warning: these numbers look like {other}: {self.why()}; taken for {kind} as {by} says"


def tell(walks: Iterable[MotionSegment], named: Sequence[int | None]) -> LogDescription:
    """Return the evidence on the kind of logged numbers, from stretches with states.

    ``named`` has the place in the state that each number names. The others are paired by their own
    place if the counts agree. If they do not follow that number, or the counts differ, they are
    paired with the number that each follows most closely.
    """
    every: list[MotionSegment] = []
    for walk in walks:
        every.append(walk)
        if sum(len(each.done) for each in every) > MOST_TOLD:
            break
    return replace(_near(every, named), **_followed(every))


def _near(walks: Sequence[MotionSegment], named: Sequence[int | None]) -> LogDescription:
    """Return how near the numbers of a log are to those of their states."""
    if sum(len(walk.done) for walk in walks) < LEAST_TOLD or not walks[0].states.shape[1]:
        return LogDescription(None, tuple(named))
    done, states = (np.concatenate(many) for many in zip(*((walk.done, walk.states) for walk in walks), strict=True))
    varies = np.flatnonzero(done.std(axis=0) > _STILL * np.maximum(1, np.abs(done).max(axis=0)))
    if not len(varies):
        return LogDescription(None, tuple(named))
    apart = {int(number): _apart(done[:, number], states) for number in varies}
    nearest = _paired(apart, named, {number: int(far.argmin()) for number, far in apart.items()})
    if len(named) != states.shape[1]:
        return nearest
    beside = _paired(apart, named, {number: number for number in apart})
    return nearest if nearest.kind == "absolute" != beside.kind else beside


def _apart(one: Floats, states: Floats) -> Floats:
    """Return a number's distance to each of the state in its spread; infinite to a constant."""
    far = np.sqrt(((one[:, None] - states) ** 2).mean(axis=0)) / one.std()
    still = states.std(axis=0) <= _STILL * np.maximum(1, np.abs(states).max(axis=0))
    return np.where(still, np.inf, far)


def _paired(apart: Mapping[int, Floats], named: Sequence[int | None], others: Mapping[int, int]) -> LogDescription:
    """Return the evidence for numbers paired as they are named, or else as the ``others``.

    Among the others, a number as far away as its spread follows none, and stays unpaired.
    """
    pairs = {number: others[number] if (own := named[number]) is None else own for number in apart}
    near = {number: place for number, place in pairs.items() if apart[number][place] < CHANGES_ABOVE}
    known = [far for number, place in pairs.items() if np.isfinite(far := apart[number][place])]
    found = tuple(near.get(number) if own is None else own for number, own in enumerate(named))
    return LogDescription(round(float(np.median(known)), 4) if known else None, found, len(known))


def _followed(walks: Sequence[MotionSegment]) -> dict[str, Any]:
    """Return the shares of numbers that follow the state's changes, and the state itself.

    Changes are compared as they are, summed over each of the `WINDOWS`. Places are compared within
    their episode, without its mean: an episode in one direction would let a place correlate with
    the changes.
    """
    long = [walk for walk in walks if len(walk.done) > max(WINDOWS) and walk.states.shape[1]]
    walked = sum(len(walk.done) - 1 for walk in long)
    if walked < LEAST_WALKED:
        return {"walked": walked}
    varies: npt.NDArray[np.bool_] = np.asarray(np.concatenate([walk.done for walk in long]).std(axis=0) > _STILL)
    if not varies.any():
        return {"walked": walked}
    change = _closest([[walk.moved(width) for walk in long] for width in WINDOWS])
    same = _closest([[walk.stood(later) for walk in long] for later in (0, 1)])
    follows = (change >= FOLLOWS) & (change > same)
    share = [round(float(one[varies].mean()), 4) for one in (follows, (same >= ALIKE) & ~follows)]
    return {"walked": walked, "follows": share[0], "alike": share[1]}


def _closest(ways: Sequence[Sequence[tuple[Floats, Floats]]]) -> Floats:
    """Return each number's highest correlation with one of the state, over all ways of pairing."""
    together = [tuple(np.concatenate(many) for many in zip(*parts, strict=True)) for parts in ways]
    result: Floats = np.max([_alike(done, states) for done, states in together], axis=0).max(axis=1)
    return result


def _alike(done: Floats, states: Floats) -> Floats:
    """Return the correlations, shape (numbers, d), of numbers and states; 0 for constants."""
    return np.asarray(_of_length_one(done).T @ _of_length_one(states))


def _of_length_one(numbers: Floats) -> Floats:
    """Return columns less their mean, each of length 1; zeros for a constant, in whatever unit."""
    apart = numbers - numbers.mean(axis=0)
    length, whole = (np.sqrt((one**2).sum(axis=0)) for one in (apart, numbers))
    result: Floats = np.divide(apart, length, out=np.zeros_like(apart), where=length > _STILL * whole)
    return result


class MotionLog:
    """The actions and states of every row of a table by episode, also of rows without a frame.

    ``state`` are the columns of the state's numbers.
    """

    def __init__(self, logged: LoggedMotion, state: Sequence[str], faults: Faults, table: str) -> None:
        self._logged, self._state, self._faults, self._table = logged, state, faults, table
        self._numbers: dict[object, array[float]] = {}
        self._states: dict[object, array[float]] = {}
        self._steps: dict[object, array[float]] = {}
        self._places: list[tuple[object, int]] = []
        self._count = 0

    def add(self, row: Row, number: int, places: Mapping[str, str], *, kept: bool) -> None:
        """Add a row, which becomes a frame if ``kept``; a cell that is no number is a fault.

        ``places`` has the columns of scenario, episode and step; scenarios may use equal names of
        episodes.
        """
        episode = tuple(row.get(places.get(place, "")) for place in ("scenario", "episode"))
        step = row.get(places.get("step", ""))
        self._count += len(self._logged.number) + len(self._state)
        if self._count > MOST_NUMBERS:
            raise SourceError(f"{self._table} logs more than {MOST_NUMBERS} numbers of motions; cut it into parts")
        numbers, steps = (many.setdefault(episode, array("d")) for many in (self._numbers, self._steps))
        with self._faults.noted():
            where = f"{self._table}, row {number}"
            found = [read_part(row.get(one.column), f"{where}: '{one.column}'") for one in self._logged.number]
            steps.append(len(steps) if step is None else read_part(step, f"{where}: the step"))
            numbers.extend(found)
            self._states.setdefault(episode, array("d")).extend(_finite(row.get(one)) for one in self._state)
        if kept:
            self._places.append((episode, len(steps) - 1))

    def motions(self) -> Iterator[Rows]:
        """Yield each frame's motion; empty if the episode ends or skips a step too early."""
        wide, ahead = len(self._logged.number), self._logged.horizon
        whole = {episode: self._unbroken(steps) for episode, steps in self._steps.items()}
        for episode, place in self._places:
            if whole[episode][place] < ahead:
                yield ()
                continue
            numbers = self._numbers[episode]
            yield tuple(tuple(numbers[step * wide : (step + 1) * wide]) for step in range(place, place + ahead))

    def walks(self) -> Iterator[MotionSegment]:
        """Yield all stretches of consecutive rows in an episode, each with a state of numbers."""
        for episode, steps in self._steps.items():
            if len(self._numbers[episode]) != len(steps) * len(self._logged.number):
                continue  # a cell of it is a fault
            done, states = (
                np.frombuffer(many[episode], dtype=np.float64).reshape(len(steps), -1)
                if many.get(episode)
                else np.empty((len(steps), 0))
                for many in (self._numbers, self._states)
            )
            whole = np.asarray(np.isfinite(states).all(axis=1))
            cuts = np.flatnonzero((np.diff(np.frombuffer(steps, dtype=np.float64)) != 1) | ~whole[1:] | ~whole[:-1]) + 1
            yield from map(MotionSegment, np.split(done, cuts), np.split(states, cuts))

    @staticmethod
    def _unbroken(steps: "array[float]") -> list[int]:
        """Return how many consecutive rows, a step apart, begin at each row, itself included."""
        result = [1] * len(steps)
        for place, (one, after) in reversed(list(enumerate(pairwise(steps)))):
            result[place] = result[place + 1] + 1 if after == one + 1 else 1
        return result

    def require_some(self) -> None:
        """Raise SourceError if no frame has a motion of the whole horizon."""
        if self._places and not any(self.motions()):
            longest = max(max(self._unbroken(steps), default=0) for steps in self._steps.values())
            raise SourceError(
                f"{self._table}: no episode has {self._logged.horizon} consecutive steps, and at most {longest} "
                "follow each other: choose no longer horizon"
            )


def _finite(cell: Cell) -> float:
    """Return a cell of the state as a number, else NaN; its fault is noted where it is read."""
    try:
        return read_part(cell, "")
    except SourceError:
        return float("nan")
