"""The pictures of one camera in the order of its frames: decoded from videos, or taken out of Parquet files."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from eyechart.errors import BankError, SourceError
from eyechart.frames import MAX_IMAGE_BYTES, MAX_PIXELS, Frame, encode, inside, made_plain, read_colour
from eyechart.importing.parquet import binary_cells, require

_SEEK_S = 2.0
"""A wanted frame so far ahead is looked up instead of decoded up to."""
_AGAIN = "download it again, or, in a clone, run 'git lfs pull'"
_PNG = b"\x89PNG\r\n\x1a\n"


@dataclass(frozen=True, slots=True)
class Clip:
    """Where an episode lies: its video's path in the data set, and the second at which it begins there."""

    video: str
    start_s: float


@dataclass(frozen=True)
class Videos:
    """One camera's videos below ``root``: the clip of each episode, and the frames a second."""

    root: Path
    clips: Mapping[int, Clip]
    fps: float

    def pictures(self, frames: Sequence[Frame], rows: Sequence[int]) -> Iterator[bytes]:
        """Yield each frame's picture as PNG; raises SourceError where a video does not show it."""
        del rows
        for (video, _), run in groupby(self._placed(frames), key=lambda one: one[0]):
            try:
                path = inside(self.root, video)
            except BankError as error:
                raise SourceError(
                    f"{self.root / 'meta/info.json'}: the video '{video}' leads outside the data set"
                ) from error
            yield from _decoded(path, [(time_s, frame) for _, time_s, frame in run], 0.5 / self.fps)

    def _placed(self, frames: Iterable[Frame]) -> Iterator[tuple[tuple[str, int], float, Frame]]:
        """Yield every frame's video, with a count of how often time went back in it, its second there, and itself."""
        before, turn = ("", -math.inf), 0
        for frame in frames:
            clip = self.clips.get(int(frame.episode))
            if clip is None:
                raise SourceError(
                    f"{self.root / 'meta/episodes'} has no episode {frame.episode}, of which the data has frames"
                )
            now = (clip.video, clip.start_s + frame.step / self.fps)
            turn += now[0] == before[0] and now[1] < before[1]
            before = now
            yield (clip.video, turn), now[1], frame


@dataclass(frozen=True)
class Embedded:
    """One camera's pictures inside the data files, in a column of its name with their bytes."""

    files: Sequence[Path]
    column: str

    def pictures(self, frames: Sequence[Frame], rows: Sequence[int]) -> Iterator[bytes]:
        """Yield the pictures of these rows, which rise from 1 through all files, as PNG."""
        found = binary_cells(self.files, f"{self.column}.bytes", rows)
        for frame, picture in zip(frames, found, strict=True):
            what = f"{self.column} of {frame.id}"
            if picture is None:
                raise SourceError(f"'{what}' has no bytes inside the data files; write the data set with its pictures")
            if len(picture) > MAX_IMAGE_BYTES:
                raise SourceError(f"'{what}' has {len(picture)} bytes; the limit is {MAX_IMAGE_BYTES}")
            try:
                pixels, done = made_plain(picture, what, background=read_colour("white"), longest=None)
            except BankError as error:
                raise SourceError(str(error)) from error
            yield picture if not done and picture.startswith(_PNG) else encode(pixels)


Reel = Videos | Embedded


def _decoded(path: Path, times: Sequence[tuple[float, Frame]], tolerance_s: float) -> Iterator[bytes]:
    av = require("av", "PyAV", "lerobot")
    try:
        with av.open(str(path)) as container:
            stream = container.streams.video[0]
            if stream.width * stream.height > MAX_PIXELS:
                raise SourceError(f"{path} has {stream.width}×{stream.height} pixels; the limit is {MAX_PIXELS}")
            shown = _shown(container, stream)
            now, pixels = -math.inf, None
            for time_s, frame in times:
                if time_s - now > _SEEK_S:
                    container.seek(max(0, int((time_s - tolerance_s) / stream.time_base)), stream=stream)
                    shown, now = _shown(container, stream), -math.inf
                while now < time_s - tolerance_s:
                    now, pixels = next(shown, (math.inf, None))
                if pixels is None or abs(now - time_s) > tolerance_s:
                    raise SourceError(
                        f"{path} shows nothing at {time_s:.3f} s, where frame '{frame.id}' should be; where it is cut, "
                        f"{_AGAIN}"
                    )
                yield encode(np.asarray(pixels.to_ndarray(format="rgb24"), dtype=np.uint8))
    except (av.FFmpegError, OSError, IndexError) as error:
        if not path.is_file():
            raise SourceError(f"{path} is not there; {_AGAIN}") from error
        said = error.strerror if isinstance(error, (av.FFmpegError, OSError)) else None
        why = said or str(error).partition("\n")[0]
        raise SourceError(
            f"{path} cannot be read as a video ({why}); where it is cut, or a pointer of Git LFS, {_AGAIN}"
        ) from error


def _shown(container: Any, stream: Any) -> Iterator[tuple[float, Any]]:  # noqa: ANN401 - of PyAV
    for picture in container.decode(stream):
        if picture.time is not None:
            yield float(picture.time), picture
