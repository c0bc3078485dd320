"""Pictures as a run shows them: each read and made once for all models and conditions, within a bound of memory."""

from dataclasses import fields
from functools import cached_property

from eyechart.conditions import show
from eyechart.frames import FrameBank, Kept, Stimulus
from eyechart.perception.view import View, through

_MOST_BYTES = 128_000_000
_MOST_PICTURES = 5_000
"""Small pictures are bounded by their number: keeping one costs more than its bytes."""


class _Remembering(FrameBank):
    """A bank that reads a picture once for the several conditions that show it."""

    @cached_property
    def _read(self) -> Kept[str, bytes]:
        return Kept(len, _MOST_BYTES, _MOST_PICTURES)

    def read(self, file: str) -> bytes:
        """Return an encoded picture, read from disk or remembered."""
        read = super().read
        return self._read.get(file, lambda: read(file))


class Stimuli:
    """What each condition shows for a frame, through a view if there is one, made once for all models."""

    def __init__(self, bank: FrameBank, seed: int, view: View | None = None) -> None:
        self._bank = _Remembering(**{one.name: getattr(bank, one.name) for one in fields(FrameBank)})
        self._seed = seed
        self._view = view
        self._made: Kept[tuple[str, str], Stimulus] = Kept(
            lambda made: sum(map(len, made.images.values())), _MOST_BYTES, _MOST_PICTURES
        )

    def show(self, condition: str, frame_id: str) -> Stimulus:
        """Return what a condition shows of a frame."""

        def make() -> Stimulus:
            return through(self._view, show(condition, self._bank.frame(frame_id), self._bank, self._seed), frame_id)

        return self._made.get((condition, frame_id), make)
