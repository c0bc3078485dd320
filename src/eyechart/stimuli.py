"""The stimuli of a run: each is read and made once for all models, within bounded memory."""

from dataclasses import fields
from functools import cached_property

from eyechart.conditions import show
from eyechart.frames import BoundedCache, FrameBank, Stimulus
from eyechart.perception.view import View, through

_MOST_BYTES = 128_000_000
_MOST_PICTURES = 5_000
"""Small pictures are limited by number: each costs more memory than its bytes."""


class _CachingBank(FrameBank):
    """A bank that reads a picture once for all conditions that show it."""

    @cached_property
    def _read(self) -> BoundedCache[str, bytes]:
        return BoundedCache(len, _MOST_BYTES, _MOST_PICTURES)

    def read(self, file: str) -> bytes:
        """Return an encoded picture, from disk or memory."""
        read = super().read
        return self._read.get(file, lambda: read(file))


class Stimuli:
    """Each condition's stimulus for a frame, made once for all models, through a view if any.

    Those that are not ``kept`` are made at each use, which for one model is the only one.
    """

    def __init__(self, bank: FrameBank, seed: int, view: View | None = None, *, kept: bool = True) -> None:
        self._bank = _CachingBank(**{field.name: getattr(bank, field.name) for field in fields(FrameBank)})
        self._seed = seed
        self._view = view
        self._kept = kept
        self._made: BoundedCache[tuple[str, str], Stimulus] = BoundedCache(
            lambda made: sum(map(len, made.pictures)), _MOST_BYTES, _MOST_PICTURES
        )

    def show(self, condition: str, frame_id: str) -> Stimulus:
        """Return a condition's stimulus for a frame."""

        def make() -> Stimulus:
            return through(self._view, show(condition, self._bank.frame(frame_id), self._bank, self._seed), frame_id)

        return self._made.get((condition, frame_id), make) if self._kept else make()
