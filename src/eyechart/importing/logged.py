"""What a robot did, row by row of its log, becomes the motion that was logged from each moment on."""

from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Annotated, Any

import msgspec
import numpy as np
import numpy.typing as npt

from eyechart.errors import SourceError, SpecError, meant
from eyechart.importing.cells import Cell, Row, read_part
from eyechart.importing.faults import Faults
from eyechart.spaces.motion import PLACES, Dimension, Floats, Kind, MotionSpace

MOST_NUMBERS = 50_000_000
"""Numbers of all rows' motions together."""
LEAST_TOLD = 10
"""Rows with a motion and a state below which the data do not tell what a motion is."""
PLACES_BELOW, CHANGES_ABOVE = 0.5, 1.0
"""Numbers that stay this near to the state, in units of their spread, are places; farther away they
are none of it."""
MOST_TOLD = 100_000
"""Rows by which it is told; the log goes on."""
LEAST_WALKED = 30
"""Steps with a state before and behind below which the data do not tell whether numbers are its
changes."""
FOLLOWS, ALIKE, LEAST_SHARE = 0.6, 0.9, 0.3
"""Correlations from which on numbers go along with the state's changes, and with the state itself
within an episode; and the share of numbers that have to do the one for the log to be one of
changes."""
WINDOWS = (1, 4)
"""Steps over which changes are compared: an arm lags behind what it is told."""
_STILL = 1e-9
"""A number whose spread is no more than this share of the largest does not vary."""

Rows = tuple[tuple[float, ...], ...]


class Number(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One number of a motion's step: its column, and what `eyechart.spaces.motion.Dimension` says of it.

    ``state`` is the column of the number of the state that it is measured relative to, where it is
    a place.
    """

    column: str
    name: str = ""
    unit: str = ""
    scale: float | None = None
    along: str = ""
    state: str = ""


class Reflected(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a number is in the reflected world: that of ``mirrors``, its own without, times ``sign`` about ``about``."""

    mirrors: str = ""
    sign: float = 1.0
    about: float = 0.0


class Reflection(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the reflected world has of a state and a motion: what is not in ``numbers`` stays as it is there.

    ``words`` are what an instruction exchanges, such as left and right. Names are those of columns,
    or of numbers.
    """

    numbers: dict[str, Reflected] = {}
    words: dict[str, str] = {}

    def by_column(self, *parts: Mapping[str, str]) -> "Reflection":
        """Return the same by columns; each of the ``parts`` (the motion, the state) maps names to its columns.

        A name that several have is of each. Of two numbers that exchange places it is enough to
        name one. Raises SpecError where a name is of no part, or what it mirrors is not of the
        same.
        """
        found: dict[str, Reflected] = {}
        for name, one in self.numbers.items():
            holders = [part for part in parts if name in part]
            if not holders:
                every = [*dict.fromkeys(other for part in parts for other in part)]
                raise SpecError(f"[reflection] names '{name}';{meant(name, every)} there are {', '.join(every)}")
            for part in holders:
                if one.mirrors and one.mirrors not in part:
                    raise SpecError(f"[reflection]: '{name}' mirrors '{one.mirrors}', which is not of the same numbers")
                own, other = part[name], part[one.mirrors or name]
                found[own] = msgspec.structs.replace(one, mirrors="" if own == other else other)
        for column, one in list(found.items()):
            if one.mirrors:
                found.setdefault(one.mirrors, msgspec.structs.replace(one, mirrors=column))
        return Reflection(found, self.words)


class Logged(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The columns of a log that are motions: what was done in the step of each row, in this order."""

    number: Annotated[tuple[Number, ...], msgspec.Meta(min_length=1)]
    horizon: Annotated[int, msgspec.Meta(ge=1)]
    kind: Kind = "delta"
    rate_hz: float | None = None
    name: str = "action"

    def space(self, state: Mapping[str, Sequence[str]], reflection: Reflection | None = None) -> MotionSpace:
        """Return the motions of a bank; ``state`` maps each state to the columns of its numbers.

        Raises SpecError where a number belongs to a column that no state has, or the reflection is
        none.
        """
        columns = [column for many in state.values() for column in many]
        for one in self.number:
            if one.state and one.state not in columns:
                has = ", ".join(columns) or "no number"
                raise SpecError(f"the motion's '{one.column}' belongs to '{one.state}', and the state has {has}")
        names = {one.column: one.name or one.column for one in self.number}
        done = {name: column for column, name in names.items()} | {column: column for column in names}
        known = (reflection or Reflection()).by_column(done, {column: column for column in columns})
        given = [known.numbers.get(one.column, Reflected()) for one in self.number]
        places = [known.numbers.get(column, Reflected()) for column in columns]
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
        )


@dataclass(frozen=True)
class Walk:
    """What was done in the steps of an episode that follow each other, (n, numbers), each from its state, (n, d)."""

    done: Floats
    states: Floats

    def moved(self, width: int) -> tuple[Floats, Floats]:
        """Return the sums of so many steps, and how the state changed in them."""
        total = np.concatenate([np.zeros((1, self.done.shape[1])), np.cumsum(self.done, axis=0)])
        return (total[width:] - total[:-width])[: len(self.done) - width], self.states[width:] - self.states[:-width]

    def stood(self, later: int) -> tuple[Floats, Floats]:
        """Return the steps and the state so many steps later, each less its mean."""
        done, states = self.done[: len(self.done) - later], self.states[later:]
        return done - done.mean(axis=0), states - states.mean(axis=0)


@dataclass(frozen=True)
class Told:
    """What the data say of logged numbers.

    ``ratio`` is how far they are from the numbers of the state that they are paired with, in units
    of their own spread (root mean square; the median of the ``count`` numbers whose partner
    varies), None where nothing can be paired. ``pairs`` has the place of each one's number in the
    state, None where it has none. ``follows`` and ``alike`` are the shares of the numbers that go
    along with the changes of the state, and with the state itself, over ``walked`` steps.
    """

    ratio: float | None
    pairs: tuple[int | None, ...]
    count: int = 0
    follows: float = 0.0
    alike: float = 0.0
    walked: int = 0

    @property
    def kind(self) -> Kind | None:
        """Return what they are, places or changes; None where the data do not tell.

        Changes have evidence of their own: that they are no places says nothing of what else they
        are.
        """
        if self.ratio is not None and self.ratio < PLACES_BELOW:
            return "absolute"
        return "delta" if self.follows >= LEAST_SHARE and self.follows > self.alike else None

    def why(self) -> str:
        """Return in words what was measured."""
        far = "no state that varies can be paired with them"
        if self.ratio is not None:
            far = (
                f"{self.ratio:.2g} of their spread from the state (rms, median of {self.count} numbers; below "
                f"{PLACES_BELOW:g} they are places)"
            )
            if self.kind == "absolute":
                return far
        if self.walked < LEAST_WALKED:
            return f"{far}; only {self.walked} steps have a state before and behind, of {LEAST_WALKED} that are needed"
        alike = "" if not self.alike else f", and {self.alike:.0%} with the state itself, as places of another unit do"
        return f"{far}; {self.follows:.0%} of the numbers go along with the changes of the state{alike}"

    def against(self, kind: Kind) -> bool:
        """Return whether the data clearly say that they are not of this kind."""
        return self.kind is not None and (kind in PLACES) != (self.kind in PLACES)

    def warning(self, kind: Kind, by: str) -> str:
        """Return what to say where somebody declares another kind ``by`` an option."""
        other = "places" if self.kind in PLACES else "changes"
        return f"warning: these numbers look like {other}: {self.why()}; taken for {kind} as {by} says"


def tell(walks: Iterable[Walk], named: Sequence[int | None]) -> Told:
    """Return what was done in the rows of a log, by the states from which it was done.

    ``named`` has the place in the state that each number names. The others are paired by their
    place, where there are as many; where they do not follow that, or there are not, with the number
    of the state that each follows most closely.
    """
    every: list[Walk] = []
    for one in walks:
        every.append(one)
        if sum(len(each.done) for each in every) > MOST_TOLD:
            break
    return replace(_near(every, named), **_followed(every))


def _near(walks: Sequence[Walk], named: Sequence[int | None]) -> Told:
    """Return how near the numbers of a log are to those of their states."""
    if sum(len(one.done) for one in walks) < LEAST_TOLD or not walks[0].states.shape[1]:
        return Told(None, tuple(named))
    done, states = (np.concatenate(many) for many in zip(*((one.done, one.states) for one in walks), strict=True))
    varies = np.flatnonzero(done.std(axis=0) > _STILL * np.maximum(1, np.abs(done).max(axis=0)))
    if not len(varies):
        return Told(None, tuple(named))
    apart = {int(number): _apart(done[:, number], states) for number in varies}
    nearest = _paired(apart, named, {number: int(far.argmin()) for number, far in apart.items()})
    if len(named) != states.shape[1]:
        return nearest
    beside = _paired(apart, named, {number: number for number in apart})
    return nearest if nearest.kind == "absolute" != beside.kind else beside


def _apart(one: Floats, states: Floats) -> Floats:
    """Return how far a number is from each one of the state, in units of its spread; infinitely from a constant."""
    far = np.sqrt(((one[:, None] - states) ** 2).mean(axis=0)) / one.std()
    still = states.std(axis=0) <= _STILL * np.maximum(1, np.abs(states).max(axis=0))
    return np.where(still, np.inf, far)


def _paired(apart: Mapping[int, Floats], named: Sequence[int | None], others: Mapping[int, int]) -> Told:
    """Return what numbers are that are paired as they are named, or else as the ``others``.

    Of these, one that is as far away as its spread follows no number of the state, and is paired
    with none.
    """
    pairs = {number: others[number] if (own := named[number]) is None else own for number in apart}
    near = {number: place for number, place in pairs.items() if apart[number][place] < CHANGES_ABOVE}
    known = [far for number, place in pairs.items() if np.isfinite(far := apart[number][place])]
    found = tuple(near.get(number) if own is None else own for number, own in enumerate(named))
    return Told(round(float(np.median(known)), 4) if known else None, found, len(known))


def _followed(walks: Sequence[Walk]) -> dict[str, Any]:
    """Return which share of the numbers goes along with the changes of the state, and which with the state itself.

    Changes are compared as they are, summed over each of the `WINDOWS`; places within their
    episode: in one that goes one way, the place goes along with the changes while its mean is kept.
    """
    long = [one for one in walks if len(one.done) > max(WINDOWS) and one.states.shape[1]]
    walked = sum(len(one.done) - 1 for one in long)
    if walked < LEAST_WALKED:
        return {"walked": walked}
    varies: npt.NDArray[np.bool_] = np.asarray(np.concatenate([one.done for one in long]).std(axis=0) > _STILL)
    if not varies.any():
        return {"walked": walked}
    change = _closest([[one.moved(width) for one in long] for width in WINDOWS])
    same = _closest([[one.stood(later) for one in long] for later in (0, 1)])
    follows = (change >= FOLLOWS) & (change > same)
    share = [round(float(one[varies].mean()), 4) for one in (follows, (same >= ALIKE) & ~follows)]
    return {"walked": walked, "follows": share[0], "alike": share[1]}


def _closest(ways: Sequence[Sequence[tuple[Floats, Floats]]]) -> Floats:
    """Return each number's highest correlation with one of the state, in whichever way they are put beside it."""
    together = [tuple(np.concatenate(many) for many in zip(*parts, strict=True)) for parts in ways]
    found: Floats = np.max([_alike(done, states) for done, states in together], axis=0).max(axis=1)
    return found


def _alike(done: Floats, states: Floats) -> Floats:
    """Return the correlation of each number with each one of the state, shape (numbers, d); 0 of what does not vary."""
    one, other = (many - many.mean(axis=0) for many in (done, states))
    norms = np.sqrt((one**2).sum(axis=0))[:, None] * np.sqrt((other**2).sum(axis=0))[None]
    found: Floats = np.divide(one.T @ other, norms, out=np.zeros_like(norms), where=norms > _STILL)
    return found


class Log:
    """What was done in every row of a table, by episode, and from which state; also in the rows that become no frame.

    ``state`` are the columns of the state's numbers.
    """

    def __init__(self, logged: Logged, state: Sequence[str], faults: Faults, table: str) -> None:
        self._logged, self._state, self._faults, self._table = logged, state, faults, table
        self._numbers: dict[object, array[float]] = {}
        self._states: dict[object, array[float]] = {}
        self._steps: dict[object, array[float]] = {}
        self._places: list[tuple[object, int]] = []
        self._count = 0

    def add(self, row: Row, number: int, places: Mapping[str, str], *, kept: bool) -> None:
        """Take note of a row, which becomes a frame where it is ``kept``; a cell that is no number is a fault.

        ``places`` has the columns of scenario, episode and step; names of episodes may recur in
        another scenario.
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
        """Yield for each frame what was done from there on; nothing where the episode ends, or skips a step, before."""
        wide, ahead = len(self._logged.number), self._logged.horizon
        whole = {episode: self._unbroken(steps) for episode, steps in self._steps.items()}
        for episode, place in self._places:
            if whole[episode][place] < ahead:
                yield ()
                continue
            numbers = self._numbers[episode]
            yield tuple(tuple(numbers[step * wide : (step + 1) * wide]) for step in range(place, place + ahead))

    def walks(self) -> Iterator[Walk]:
        """Yield the stretches of all episodes in which rows follow each other, each with a state of numbers."""
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
            yield from map(Walk, np.split(done, cuts), np.split(states, cuts))

    @staticmethod
    def _unbroken(steps: "array[float]") -> list[int]:
        """Return how many rows follow each other from each on, itself counted, a step apart each."""
        found = [1] * len(steps)
        for place, (one, after) in reversed(list(enumerate(pairwise(steps)))):
            found[place] = found[place + 1] + 1 if after == one + 1 else 1
        return found

    def require_some(self) -> None:
        """Raise SourceError where no frame has a motion of the whole horizon."""
        if self._places and not any(self.motions()):
            longest = max(len(steps) for steps in self._steps.values())
            raise SourceError(
                f"{self._table}: nowhere do {self._logged.horizon} steps follow each other, and the longest episode "
                f"has {longest}; choose a shorter horizon"
            )


def _finite(cell: Cell) -> float:
    """Return a cell of the state as a number, NaN where it is none; what is wrong with it is said where it is read."""
    try:
        return read_part(cell, "")
    except SourceError:
        return float("nan")
