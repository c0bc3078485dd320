"""The pictures of one camera in the order of its frames, from videos or from Parquet files."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from eyechart.errors import BankError, SourceError
from eyechart.frames import MAX_IMAGE_BYTES, MAX_PIXELS, Frame, encode, made_plain, read_colour
from eyechart.importing.layout import Clip, DataSetLayout
from eyechart.importing.parquet import binary_cells, require
from eyechart.importing.timeline import NEAR, Timeline

_SEEK_S = 2.0
"""A frame farther ahead than this is reached by a seek instead of by decoding."""
_SURE = 0.75
"""A video with a declared end this share of a picture behind a second has a picture there."""
_AGAIN = "download it again, or, in a clone, run 'git lfs pull'"
_ALONE = {"protocol_whitelist": "file", "format_whitelist": "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi"}
"""The formats that FFmpeg may open: videos, but no playlists of other files or addresses."""
_PNG = b"\x89PNG\r\n\x1a\n"


@dataclass(frozen=True, slots=True)
class MissingPicture:
    """A picture that does not exist or cannot be shown, and why."""

    why: str


Picture = bytes | MissingPicture


@dataclass(frozen=True)
class Videos:
    """One camera's videos: each episode's clip, and the time of each row of the data set.

    The ``timeline`` is complete only after all rows are read.
    """

    layout: DataSetLayout
    clips: Mapping[int, Clip]
    timeline: Timeline

    def pictures(self, frames: Sequence[Frame], rows: Sequence[int]) -> Iterator[Picture]:
        """Yield each frame's picture as PNG, or that the video has none near its second.

        Raises SourceError if the video cannot be read, or ends before its rows do.
        """
        ends, near_s = self.timeline.ends(self.clips), NEAR / self.timeline.fps
        for (video, _), run in groupby(self._placed(frames, rows), key=lambda one: one[0]):
            path = self.layout.file(video)
            if path is None:
                raise SourceError(f"{self.layout.root / video} does not exist; {_AGAIN}")
            yield from _decoded(path, [time_s for _, time_s in run], near_s, ends[video])

    def _placed(self, frames: Sequence[Frame], rows: Sequence[int]) -> Iterator[tuple[tuple[str, int], float]]:
        """Yield every frame's video, with the number of backward jumps in it, and its second."""
        before, turn = ("", -math.inf), 0
        for frame, row in zip(frames, rows, strict=True):
            clip = self.clips[int(frame.episode)]
            now = (clip.video, clip.start_s + self.timeline.times[row - 1])
            turn += now[0] == before[0] and now[1] < before[1]
            before = now
            yield (clip.video, turn), now[1]


@dataclass(frozen=True)
class EmbeddedPictures:
    """One camera's pictures inside the data files, as bytes in a column of its name."""

    files: Sequence[Path]
    column: str

    def pictures(self, frames: Sequence[Frame], rows: Sequence[int]) -> Iterator[Picture]:
        """Yield the pictures of these rows as PNG, or why one is missing.

        ``rows`` rise from 1 through all files.
        """
        found = binary_cells(self.files, f"{self.column}.bytes", rows)
        for frame, picture in zip(frames, found, strict=True):
            what = f"{self.column} of {frame.id}"
            if picture is None:
                yield MissingPicture(f"'{what}' has no bytes inside the data files")
            elif len(picture) > MAX_IMAGE_BYTES:
                yield MissingPicture(f"'{what}' has {len(picture)} bytes; the limit is {MAX_IMAGE_BYTES}")
            else:
                yield plain_picture(picture, what)


class Reel(Protocol):
    """The pictures of one camera."""

    def pictures(self, frames: Sequence[Frame], rows: Sequence[int]) -> Iterator[Picture]:
        """Yield each frame's picture as PNG or JPEG, or why it is missing.

        ``rows`` are the numbers of the frames' rows, from 1. Raises SourceError for an unreadable
        file.
        """


def plain_picture(picture: bytes, what: str) -> Picture:
    """Return the bytes of a picture as RGB PNG; an unreadable one is missing."""
    try:
        pixels, done = made_plain(picture, what, background=read_colour("white"), longest=None)
    except BankError as error:
        return MissingPicture(str(error))
    return picture if not done and picture.startswith(_PNG) else encode(pixels)


def _decoded(path: Path, times: Sequence[float], near_s: float, end_s: float) -> Iterator[Picture]:
    """Yield a video's nearest picture to each of the rising ``times``, if within ``near_s``.

    Raises SourceError if the video ends before ``end_s``.
    """
    av = require("av", "PyAV", "lerobot")
    try:
        with av.open(str(path), options=_ALONE) as container:
            stream = container.streams.video[0]
            stream.codec_context.options = {"max_pixels": str(MAX_PIXELS)}
            if stream.width * stream.height > MAX_PIXELS:
                raise SourceError(f"{path} has {stream.width}×{stream.height} pixels; the limit is {MAX_PIXELS}")
            _require_end(container, stream, path, end_s - near_s)
            reader = _VideoReader(container, stream)
            for time_s in times:
                far, picture = reader.nearest(time_s)
                yield (
                    _encoded(picture, path)
                    if far <= near_s
                    else MissingPicture(f"{path} shows nothing at {time_s:.3f} s")
                )
    except (av.FFmpegError, OSError, IndexError) as error:
        said = error.strerror if isinstance(error, (av.FFmpegError, OSError)) else None
        why = said or str(error).partition("\n")[0]
        raise SourceError(
            f"{path} cannot be read as a video ({why}); if it is cut, or a pointer of Git LFS, {_AGAIN}"
        ) from error


def _encoded(picture: Any, path: Path) -> bytes:  # noqa: ANN401 - of PyAV
    if picture.width * picture.height > MAX_PIXELS:
        raise SourceError(f"{path} has {picture.width}×{picture.height} pixels; the limit is {MAX_PIXELS}")
    return encode(np.asarray(picture.to_ndarray(format="rgb24"), dtype=np.uint8))


def _require_end(container: Any, stream: Any, path: Path, end_s: float) -> None:  # noqa: ANN401 - of PyAV
    """Raise SourceError if a video has nothing at or after ``end_s``; leave it at its start.

    Its declared end is one picture behind its last. If that does not decide, the last pictures are
    decoded.
    """
    start, length = stream.start_time or 0, stream.duration
    if length is not None and (start + length) * stream.time_base > end_s + _SURE / float(stream.average_rate or 1):
        return
    container.seek(max(0, int(end_s / stream.time_base)), stream=stream)
    last = max((time_s for time_s, _ in _pictures(container, stream)), default=0.0)
    if last < end_s:
        raise SourceError(
            f"{path} ends at {last:.3f} s, but the data set has rows at {end_s:.3f} s in it: if it is cut, "
            f"{_AGAIN}; else 'from_timestamp' in meta/episodes is wrong"
        )
    container.seek(0, stream=stream)


class _VideoReader:
    """The pictures of a video in order, with a seek if the next one wanted is far ahead."""

    def __init__(self, container: Any, stream: Any) -> None:  # noqa: ANN401 - of PyAV
        self._container, self._stream = container, stream
        self._pictures = _pictures(container, stream)
        self._before: tuple[float, Any] = (-math.inf, None)
        self._after: tuple[float, Any] = (-math.inf, None)

    def nearest(self, time_s: float) -> tuple[float, Any]:
        """Return the nearest picture and its distance in seconds; ``time_s`` never decreases."""
        if time_s - self._after[0] > _SEEK_S:
            self._container.seek(max(0, int((time_s - _SEEK_S / 2) / self._stream.time_base)), stream=self._stream)
            self._pictures = _pictures(self._container, self._stream)
            self._before = self._after = (-math.inf, None)
        while self._after[0] < time_s:
            self._before, self._after = self._after, next(self._pictures, (math.inf, None))
        return min(((abs(one - time_s), picture) for one, picture in (self._before, self._after)), key=itemgetter(0))


def _pictures(container: Any, stream: Any) -> Iterator[tuple[float, Any]]:  # noqa: ANN401 - of PyAV
    for picture in container.decode(stream):
        if picture.time is not None:
            yield float(picture.time), picture
