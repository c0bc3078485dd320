"""The rows before a row that becomes a frame: its window, or why the moment is left out."""

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from eyechart.errors import SourceError, counted
from eyechart.frames import Frame
from eyechart.importing.cells import Cell, Row, read_step
from eyechart.importing.faults import Faults

_NAMED = 8
"""Moments with a gap before them are named up to this number."""

NumberedRow = tuple[int, Row]
"""A row with its number in the table, from 1."""


@dataclass
class RowsBefore:
    """Finds the ``history`` rows before a chosen row, each one step after the last.

    Rows come in the order of the table, and ``places`` has the columns of scenario, episode and
    step. ``windows`` gets the numbers of the rows before each chosen one, the oldest first. A chosen
    row without them is left out: at the start of its episode, or behind a gap.
    """

    history: int
    places: Mapping[str, str]
    table: str
    faults: Faults
    windows: dict[int, tuple[int, ...]] = field(default_factory=dict)
    _last: dict[tuple[Cell, ...], deque[tuple[int, int, Row]]] = field(default_factory=dict)
    _first: dict[tuple[Cell, ...], int] = field(default_factory=dict)
    _kept: set[int] = field(default_factory=set)
    _early: int = 0
    _behind: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        for place in ("episode", "step"):
            if place not in self.places:
                self.faults.add(f"--history needs the order of the rows: name the {place} with --map {place}=COLUMN")

    def before(self, row: Row, number: int, *, chosen: bool) -> tuple[bool, list[NumberedRow]]:
        """Return whether a chosen row is kept, and the rows before it that no earlier window has."""
        episode, step = tuple(row.get(self.places.get(one, "")) for one in ("scenario", "episode")), 0
        if "step" not in self.places:
            return False, []
        with self.faults.noted():
            step = read_step(row.get(self.places["step"]), f"{self.table}, row {number}: the step")
        known = self._last.setdefault(episode, deque(maxlen=self.history))
        whole = self._is_whole(episode, step) if chosen else False
        result = [(its, one) for _, its, one in known if whole and its not in self._kept]
        if whole:
            self.windows[number] = tuple(its for _, its, _ in known)
            self._kept |= {number, *self.windows[number]}
        self._first.setdefault(episode, step)
        known.append((step, number, row))
        return whole, result

    def _is_whole(self, episode: tuple[Cell, ...], step: int) -> bool:
        """Return whether the rows before a step are there; else count why they are not."""
        there = {one for one, _, _ in self._last[episode]}
        lacking = [one for one in range(step - self.history, step) if one not in there]
        if not lacking:
            return True
        if max(lacking) < self._first.get(episode, step):
            self._early += 1
        else:
            self._behind.append(f"step {step} of episode {episode[1]} (no step {max(lacking)})")
        return False

    def said(self) -> Iterator[str]:
        """Yield how many moments are left out, and why."""
        if self._early:
            rows = counted(self.history, "row")
            yield f"{counted(self._early, 'moment')} at the start of episodes left out: no {rows} before them"
        yield from _left_out(self._behind, "with a gap in the rows before")

    def require_some(self) -> None:
        """Note as a fault that no moment has a whole window."""
        if not self.windows and not self.faults:
            why = "; ".join(self.said()) or "it has no rows"
            self.faults.add(f"--history {self.history}: {self.table} has no moment with so many rows before it: {why}")


class Windows:
    """Joins frames with the instants before them, as their pictures come in the order of the rows."""

    def __init__(self, frames: Sequence[Frame], numbers: Sequence[int], rows: Mapping[int, Sequence[int]]) -> None:
        self._number = dict(zip((frame.id for frame in frames), numbers, strict=True))
        self._rows, self._shown = rows, dict[int, Frame]()
        self._without: list[str] = []

    def whole(self, frame: Frame) -> Frame | None:
        """Return a frame with its past; None for an instant before others, or without its own."""
        number = self._number[frame.id]
        self._shown[number] = frame.instant()
        if number not in self._rows:
            return None
        past = tuple(self._shown[one] for one in self._rows[number] if one in self._shown)
        if len(past) < len(self._rows[number]):
            self._without.append(f"step {frame.step} of episode {frame.episode}")
            return None
        return replace(frame, past=past)

    def said(self) -> list[str]:
        """Return how many moments are left out for want of a picture, and which."""
        return _left_out(self._without, "without a picture of an instant before")

    def require_some(self, added: Sequence[Frame]) -> None:
        """Raise SourceError if no frame is left."""
        if not added:
            raise SourceError(f"no frame is left: {'; '.join(self.said())}")


def _left_out(moments: Sequence[str], why: str) -> list[str]:
    """Return a line on the moments that are left out; none without any."""
    more = f" and {len(moments) - _NAMED} more" if len(moments) > _NAMED else ""
    named = ", ".join(moments[:_NAMED])
    return [f"{counted(len(moments), 'moment')} left out, {why}: {named}{more}"] if moments else []
