"""The times of a data set's rows, and whether rows, episodes and videos agree."""

import math
from array import array
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import chain, pairwise
from pathlib import Path

from eyechart.errors import SourceError
from eyechart.importing.cells import Cell, Row
from eyechart.importing.layout import MOST_SECONDS, Clip, whole
from eyechart.records import LARGEST

NEAR = 0.25
"""The largest distance of a picture from its row's second, as a share of a frame."""
_HALF = 0.5
"""Stretches of one video that are nearer than this share of a frame overlap."""
_PACES = 100_000
"""The number of rows from which the rate is taken."""
_PACE = 0.1
"""The largest relative difference between the rows' interval and the declared one."""
_SHOWN = 3
PLACES = {"episode": "episode_index", "step": "frame_index"}
TIME = "timestamp"


@dataclass(slots=True)
class _Episode:
    """An episode's rows so far: their count, the last step, and the last and first seconds."""

    count: int = 0
    step: int = -1
    time_s: float = -math.inf
    first_s: float = math.nan


@dataclass(slots=True)
class _SkippedRows:
    """Rows left out because of one column: the first number, the count, and some values."""

    first: int
    count: int = 0
    values: dict[str, None] = field(default_factory=dict)


@dataclass
class Timeline:
    """Records the times of rows, leaves out unreadable rows, and refuses contradictory ones.

    ``needed`` columns must be numbers up to `LARGEST`, ``counted`` ones whole numbers. ``left`` has
    the rows left out by column, and ``emptied`` the other cells that no bank can hold. ``times``
    has the second of each row in its episode, NaN if it is left out. ``lacking`` are the episodes
    without rows.
    """

    name: str
    fps: float
    counted: list[str]
    needed: list[str]
    times: "array[float]" = field(default_factory=lambda: array("d"))
    left: dict[str, _SkippedRows] = field(default_factory=dict)
    emptied: Counter[str] = field(default_factory=Counter)
    lacking: list[int] = field(default_factory=list)
    meta: str = "meta/episodes"
    _episodes: dict[int, _Episode] = field(default_factory=dict)
    _paces: "array[float]" = field(default_factory=lambda: array("d"))

    def add(self, row: Row) -> Row:
        """Return the next row with the cells that a bank can hold; empty if it is left out.

        Raises SourceError if an episode's steps or seconds do not rise: it occurs twice, or out of
        order.
        """
        self.times.append(math.nan)
        episode, step = (whole(row.get(name)) for name in PLACES.values())
        bad = next((name for name, one in zip(PLACES.values(), (episode, step), strict=True) if one is None), None)
        if episode is None or step is None:
            return self._leave(str(bad), row)
        time_s = self._second(row, episode, step)
        wrong = [TIME] if time_s is None else [name for name in self.counted if whole(row.get(name)) is None]
        bad = next(chain(wrong, (name for name in self.needed if not _is_number(row.get(name)))), None)
        if bad is not None:
            return self._leave(bad, row)
        self.times[-1] = math.nan if time_s is None else time_s
        return {name: self._plain(name, cell) for name, cell in row.items()}

    def _second(self, row: Row, episode: int, step: int) -> float | None:
        """Return a row's second in its episode, by its timestamp; None for an invalid one."""
        known = self._episodes.setdefault(episode, _Episode())
        where = f"{self.name}, row {len(self.times)}: step {step} of episode {episode}"
        if step <= known.step:
            raise SourceError(f"{where} comes after step {known.step}; each step is one row, in their order")
        before, known.step, known.count = known.step, step, known.count + 1
        cell = row[TIME] if TIME in row else step / self.fps
        if isinstance(cell, bool | str) or cell is None or not 0 <= cell <= MOST_SECONDS:
            return None
        if cell <= known.time_s:
            raise SourceError(
                f"{where} was at {cell:g} s by its timestamp, but step {before} at {known.time_s:g} s; a later step "
                "must have a later time, or its picture is unknown"
            )
        if math.isfinite(known.time_s) and len(self._paces) < _PACES:
            self._paces.append((cell - known.time_s) / (step - before))
        known.first_s = cell if math.isnan(known.first_s) else known.first_s
        known.time_s = float(cell)
        return known.time_s

    def _leave(self, column: str, row: Row) -> Row:
        cell, left = row.get(column), self.left.setdefault(column, _SkippedRows(len(self.times)))
        left.count += 1
        if len(left.values) <= _SHOWN:
            left.values["empty" if cell is None else repr(cell)[:40]] = None
        return {}

    def _plain(self, name: str, cell: Cell) -> Cell:
        """Return a cell; a number that no bank can hold is left empty if it is not needed."""
        if isinstance(cell, float) and not abs(cell) <= LARGEST:
            self.emptied[name] += 1
            return None
        return cell

    def said(self) -> list[str]:
        """Return the rows and cells that are left out, a line a column."""
        lines = []
        for column, left in self.left.items():
            some = ", ".join(list(left.values)[:_SHOWN]) + (", …" if len(left.values) > _SHOWN else "")
            lines.append(
                f"{left.count} of {len(self.times)} rows are left out: '{column}' is {some} there (the first is row "
                f"{left.first}); no motion includes them"
            )
        if self.lacking:
            some = ", ".join(map(str, self.lacking[:_SHOWN])) + (", …" if len(self.lacking) > _SHOWN else "")
            lines.append(f"{len(self.lacking)} episodes of {self.meta} have no row in the data files: {some}")
        lines += [
            f"{count} cells of '{name}' are left empty: they are no number up to {LARGEST:g}"
            for name, count in self.emptied.items()
        ]
        return lines

    def require(self, lengths: Mapping[int, int | None], clips: Mapping[str, Mapping[int, Clip]], meta: Path) -> None:
        """Raise SourceError if the rows contradict meta/episodes or the rate, or none is left.

        ``clips`` has each episode's place by camera, ``lengths`` its number of steps.
        """
        if self.times and all(map(math.isnan, self.times)):
            raise SourceError(f"{self.name} has no row that can be read: {'; '.join(self.said())}")
        for episode, known in self._episodes.items():
            if episode not in lengths:
                raise SourceError(f"{meta} does not list episode {episode}, which has {known.count} rows")
            length = lengths[episode]
            if length is not None and length not in {known.count, known.step + 1}:
                raise SourceError(
                    f"{meta}: episode {episode} has the length {length}, but {known.count} rows, and the last is "
                    f"step {known.step}: the length is wrong, or rows are missing"
                )
        self.meta = f"meta/{meta.name}"
        self.lacking = [episode for episode in lengths if episode not in self._episodes]
        self._require_rate(meta.parent / "info.json")
        for camera, found in clips.items():
            if found:
                self._require_apart(camera, found, meta)

    def _require_rate(self, info: Path) -> None:
        if not self._paces:
            return
        pace = sorted(self._paces)[len(self._paces) // 2]
        if abs(pace * self.fps - 1) > _PACE:
            raise SourceError(
                f"{info} gives {self.fps:g} frames a second, but the rows of {self.name} are {pace:g} s apart by their "
                f"timestamps, which is {1 / pace:g} a second"
            )

    def _require_apart(self, camera: str, clips: Mapping[int, Clip], meta: Path) -> None:
        """Raise SourceError if stretches of a video overlap, or rows pass the end of theirs."""
        if lacking := [episode for episode in self._episodes if episode not in clips]:
            raise SourceError(f"{meta} has no place of the video of episode {lacking[0]} of '{camera}'")
        stretches: list[tuple[str, float, float, int]] = sorted(
            (clip.video, clip.start_s + known.first_s, clip.start_s + known.time_s, episode)
            for episode, known in self._episodes.items()
            for clip in [clips[episode]]
            if math.isfinite(known.time_s)
        )
        for (video, _, end, before), (again, start, _, episode) in pairwise(stretches):
            if video == again and start - end < _HALF / self.fps:
                raise SourceError(
                    f"{meta}: episodes {before} and {episode} overlap in '{video}': the first goes on to {end:.3f} s, "
                    f"and the second begins at {start:.3f} s"
                )
        for _, _, end, episode in stretches:
            until = clips[episode].end_s
            if until is not None and end > until + _HALF / self.fps:
                raise SourceError(
                    f"{meta}: episode {episode} ends at {until:.3f} s of '{clips[episode].video}', but its rows go on "
                    f"to {end:.3f} s"
                )

    def ends(self, clips: Mapping[int, Clip]) -> dict[str, float]:
        """Return the second of the last row in each video."""
        result: dict[str, float] = {}
        for episode, known in self._episodes.items():
            if episode in clips and math.isfinite(known.time_s):
                one = clips[episode]
                result[one.video] = max(result.get(one.video, 0.0), one.start_s + known.time_s)
        return result


def _is_number(cell: Cell) -> bool:
    return isinstance(cell, int | float) and not isinstance(cell, bool) and abs(cell) <= LARGEST
