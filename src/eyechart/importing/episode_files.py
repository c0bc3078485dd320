"""The files of a LeRobotDataset v2.0 or v2.1, and of GR00T's: each episode has its own."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, TypeVar

import msgspec

from eyechart.errors import SourceError, raising, read_at_most
from eyechart.importing.cells import is_nothing
from eyechart.importing.layout import MOST_LINES, Clip, DataSetLayout, EpisodeTable, Info, once, require_own, video_of
from eyechart.records import Count

T = TypeVar("T")
_MODALITY = "meta/modality.json"
_DESCRIPTIONS = ("task_description", "coarse_action")
"""The ends of the names of GR00T's annotations that are instructions; others grade the episode."""


class _EpisodeLine(msgspec.Struct, frozen=True):
    episode_index: Count
    length: Count | None = None
    tasks: list[str] = []


class _TaskLine(msgspec.Struct, frozen=True):
    task_index: Count
    task: str


class _Annotation(msgspec.Struct, frozen=True):
    original_key: str | None = None


class _Modality(msgspec.Struct, frozen=True):
    """The part of GR00T's description that is read: the annotations, by name."""

    annotation: dict[str, _Annotation] = {}


@dataclass(frozen=True)
class EpisodeFiles(DataSetLayout):
    """The folder of a data set of version 2."""

    EPISODES: ClassVar = "meta/episodes.jsonl"
    TASKS: ClassVar = "meta/tasks.jsonl"
    DATA: ClassVar = "chunk-*/episode_*.parquet"

    def episodes(self, cameras: Sequence[str], info: Info) -> EpisodeTable:
        """Return the episodes' lengths, and their videos, which are whole files.

        Raises SourceError for a faulty line, or an episode with two different lengths.
        """
        path, lengths, tasks = self.root / self.EPISODES, dict[int, int | None](), dict[int, list[str]]()
        for line in self._lines(self.EPISODES, _EpisodeLine):
            once(lengths, line.episode_index, line.length, f"{path}: the length of episode {line.episode_index}")
            tasks[line.episode_index] = line.tasks
        if not lengths:
            raise SourceError(f"{path} has no episode: is the data set complete?")
        clips = {camera: {length: self._clip(camera, length, info) for length in lengths} for camera in cameras}
        require_own(clips, self.root)
        return EpisodeTable(lengths, clips, tasks)

    def _clip(self, camera: str, episode: int, info: Info) -> Clip:
        with raising(SourceError, f"{self.root / 'meta/info.json'}: video_path", of=ValueError):
            chunk = episode // info.chunks_size
            return Clip(video_of(info.video_path, camera, episode_chunk=chunk, episode_index=episode), 0.0)

    def tasks(self) -> dict[int, str]:
        """Return the words of each task; empty without their file."""
        result: dict[int, str] = {}
        for line in self._lines(self.TASKS, _TaskLine):
            if not is_nothing(line.task):
                where = f"{self.root / self.TASKS}: the words of task {line.task_index}"
                once(result, line.task_index, line.task, where)
        return result

    def task_column(self, columns: Sequence[str]) -> str:
        """Return the column of GR00T's description of the task, else LeRobot's own."""
        if self.file(_MODALITY) is None:
            return super().task_column(columns)
        path = self.root / _MODALITY
        raw = read_at_most(path, MOST_LINES, SourceError, "the description of a data set")
        with raising(SourceError, f"{path} is no description of a data set", of=_MALFORMED):
            named = msgspec.json.decode(raw, type=_Modality).annotation
        found = [
            column
            for name, one in named.items()
            if name.endswith(_DESCRIPTIONS) and (column := one.original_key or f"annotation.{name}") in columns
        ]
        return found[0] if found else super().task_column(columns)

    def _lines(self, inner: str, kind: type[T]) -> Iterator[T]:
        """Yield the lines of a file of JSON, if it exists; raises SourceError for a faulty line."""
        if self.file(inner) is None:
            return
        path, decoder = self.root / inner, msgspec.json.Decoder(kind)
        raw = read_at_most(path, MOST_LINES, SourceError, "lines that describe a data set")
        for number, line in enumerate(raw.splitlines(), 1):
            if line.strip():
                with raising(SourceError, f"{path}, line {number}", of=_MALFORMED):
                    lines = decoder.decode(line)
                yield lines


_MALFORMED: tuple[Any, ...] = (msgspec.MsgspecError, ValueError, RecursionError)
