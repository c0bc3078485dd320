"""The rows before a row that becomes a frame: its window, or why the moment is left out."""

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from eyechart.errors import SourceError, counted
from eyechart.frames import Frame
from eyechart.importing.cells import Cell, Row, read_step
from eyechart.importing.faults import Faults

_NAMED = 8
"""Moments that are left out are named up to this number."""

NumberedRow = tuple[int, Row]
"""A row with its number in the table, from 1."""


@dataclass
class LeftOut:
    """Counts moments that are left out for one reason, and names the first of them."""

    why: str
    count: int = 0
    named: list[str] = field(default_factory=list)

    def add(self, moment: str) -> None:
        """Count a moment."""
        self.count += 1
        self.named += [moment][: self.count <= _NAMED]

    def lines(self) -> list[str]:
        """Return a line on them; none without any."""
        more = f" and {self.count - len(self.named)} more" if self.count > len(self.named) else ""
        return [f"{counted(self.count, 'moment')} left out, {self.why}: {', '.join(self.named)}{more}"][: self.count]


@dataclass
class RowsBefore:
    """Finds the ``history`` rows before a row of an episode, each one step after the last.

    Rows come in the order of the table, and ``places`` has the columns of scenario, episode and
    step. A row without its window becomes no frame: at the start of its episode, or behind a gap.
    ``windows`` has the numbers of the rows before each frame's row, the oldest first.
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
    _behind: LeftOut = field(default_factory=lambda: LeftOut("with a gap in the rows before"))

    def __post_init__(self) -> None:
        for place in ("episode", "step"):
            if place not in self.places:
                self.faults.add(f"--history needs the order of the rows: name the {place} with --map {place}=COLUMN")

    def window(self, row: Row, number: int) -> list[NumberedRow] | None:
        """Return the rows before the next row; None if it has not all of them, which is counted."""
        if "step" not in self.places:
            return None
        episode, step = tuple(row.get(self.places.get(one, "")) for one in ("scenario", "episode")), 0
        with self.faults.noted():
            step = read_step(row.get(self.places["step"]), f"{self.table}, row {number}: the step")
        last = self._last.setdefault(episode, deque(maxlen=self.history))
        before, wanted = [one for one, _, _ in last], [*range(step - self.history, step)]
        lacking, result = [one for one in wanted if one not in before], [(its, one) for _, its, one in last]
        if lacking and max(lacking) < self._first.setdefault(episode, step):
            self._early += 1
        elif before != wanted:
            why = f"no step {max(lacking)}" if lacking else "its rows are not in the order of the steps"
            self._behind.add(f"step {step} of episode {episode[1]} ({why})")
        last.append((step, number, row))
        return result if before == wanted else None

    def take(self, window: Sequence[NumberedRow], number: int) -> list[NumberedRow]:
        """Note that a row becomes a frame; return the rows of its window that are not kept yet."""
        self.windows[number] = tuple(its for its, _ in window)
        result = [(its, row) for its, row in window if its not in self._kept]
        self._kept |= {number, *self.windows[number]}
        return result

    def said(self) -> Iterator[str]:
        """Yield how many moments are left out, and why."""
        if self._early:
            rows = counted(self.history, "row")
            yield f"{counted(self._early, 'moment')} at the start of episodes left out: no {rows} before them"
        yield from self._behind.lines()

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
        self._without = LeftOut("without a picture of an instant before")

    def whole(self, frame: Frame) -> Frame | None:
        """Return a frame with its past; None for an instant before others, or without its own."""
        number = self._number[frame.id]
        self._shown[number] = frame.instant()
        if number not in self._rows:
            return None
        past = tuple(self._shown[one] for one in self._rows[number] if one in self._shown)
        if len(past) < len(self._rows[number]):
            self._without.add(f"step {frame.step} of episode {frame.episode}")
            return None
        return replace(frame, past=past)

    def said(self) -> list[str]:
        """Return how many moments are left out for want of a picture, and which."""
        return self._without.lines()

    def require_some(self, added: Sequence[Frame]) -> None:
        """Raise SourceError if no frame is left."""
        if not added:
            raise SourceError(f"no frame is left: {'; '.join(self.said())}")
