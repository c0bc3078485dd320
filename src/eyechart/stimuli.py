"""Pictures as a run shows them: each read and made once for all models and conditions, within a bound of memory."""

from collections import OrderedDict
from collections.abc import Callable
from functools import cached_property

from eyechart.conditions import show
from eyechart.frames import Frame, FrameBank
from eyechart.perception.view import View, through

_MOST_BYTES = 128_000_000
_MOST_PICTURES = 5_000
"""Small pictures are bounded by their number: keeping one costs more than its bytes."""


class _Kept:
    """The most recently used pictures by name, within a bound of bytes and of number."""

    def __init__(self) -> None:
        self._kept: OrderedDict[tuple[str, str], bytes | None] = OrderedDict()
        self._bytes = 0

    def get(self, name: tuple[str, str], make: Callable[[], bytes | None]) -> bytes | None:
        if name in self._kept:
            self._kept.move_to_end(name)
            return self._kept[name]
        picture = self._kept[name] = make()
        self._bytes += len(picture or b"")
        while self._bytes > _MOST_BYTES or len(self._kept) > _MOST_PICTURES:
            _, dropped = self._kept.popitem(last=False)
            self._bytes -= len(dropped or b"")
        return picture


class _Remembering(FrameBank):
    """A bank that reads a picture once for the several conditions that show it."""

    @cached_property
    def _read(self) -> _Kept:
        return _Kept()

    def image(self, frame: Frame, counterfactual: str | None = None) -> bytes:
        """Return an encoded picture, read from disk or remembered."""
        read = super().image
        found = self._read.get((counterfactual or "", frame.id), lambda: read(frame, counterfactual))
        assert found is not None
        return found


class Stimuli:
    """What each condition shows for a frame, through a view if there is one, made once for all models."""

    def __init__(self, bank: FrameBank, seed: int, view: View | None = None) -> None:
        self._bank = _Remembering(bank.root, bank.frames, bank.manifest)
        self._seed = seed
        self._view = view
        self._made = _Kept()

    def show(self, condition: str, frame_id: str) -> bytes | None:
        """Return the encoded picture of a condition, or None where it shows none."""

        def make() -> bytes | None:
            return through(self._view, show(condition, self._bank.frame(frame_id), self._bank, self._seed), frame_id)

        return self._made.get((condition, frame_id), make)
