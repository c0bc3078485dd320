"""Doubts about an imported bank: what it took may be something else, and only the user can tell."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from eyechart.errors import counted
from eyechart.frames import Frame, FrameBank, Gap, Scalar, decode

_APART = 30.0
"""Distances of moved things whose middle is so many times the gaps' are in another unit, most likely."""
_TWICE = 2.0
"""Two gaps whose pictures may be equal where pixels are coarse differ by no more than this factor."""
_LOOKED_AT = 20
_DARK = 40
"""The brightest level, of 255, of a picture that holds the numbers of classes, and no light."""


def doubts(bank: FrameBank) -> Iterator[str]:
    """Yield a line for each doubt about the pictures and the distances of a bank, with what to do."""
    yield from _dark(bank)
    yield from _sizes(bank)
    if bank.manifest.independent:
        yield from _of_a_film(bank)
    for kind in sorted({kind for frame in bank for kind in frame.counterfactuals}):
        yield from _copied(bank, kind)
    if (gap := bank.manifest.gap) is not None:
        yield from _shown_twice(bank, gap)
        yield from _threshold_outside(bank, gap)
        yield from _far_from_gaps(bank, gap)


def _numbers(bank: FrameBank, name: str) -> list[float]:
    found = (frame.truth.get(name) for frame in bank)
    return [float(one) for one in found if isinstance(one, int | float)]


def _shown(bank: FrameBank, files: Mapping[str, str]) -> tuple[str, ...]:
    """Return the digests of pictures, given by camera."""
    return tuple(bank.manifest.images.get(file, file) for file in files.values())


def _copied(bank: FrameBank, kind: str) -> Iterator[str]:
    """Yield that pictures of a kind are those of another drive, or the true ones all through."""
    true, same, still = dict[str, tuple[str, ...]](), defaultdict[object, list[Frame]](list), 0
    for frame in (one for one in bank if kind in one.counterfactuals):
        true[frame.id], changed = _shown(bank, frame.pictures), _shown(bank, frame.counterfactuals[kind])
        same[changed].append(frame)
        still += changed == true[frame.id]
    if still == len(true):
        yield f"{kind}: all {counted(still, 'picture')} are the true ones again: was nothing moved?"
        return
    apart = (many for many in same.values() if len({one.drive for one in many}) > 1)
    of_others = [many for many in apart if len({true[one.id] for one in many}) > 1]
    if of_others:
        one, *_, other = of_others[0]
        yield (
            f"{kind}: {sum(map(len, of_others))} of {counted(len(true), 'picture')} are the same as one of another "
            f"drive, as of '{one.id}' and '{other.id}', though the true ones differ: is each of its own moment?"
        )


def _shown_twice(bank: FrameBank, gap: Gap) -> Iterator[str]:
    """Yield how many frames have the picture of another one beside another gap."""
    same = defaultdict[object, list[Frame]](list)
    for frame in bank:
        same[_shown(bank, frame.pictures)].append(frame)
    unlike = [many for many in same.values() if _are_apart([one.truth.get(gap.column) for one in many])]
    if unlike:
        one, other = next((unlike[0][0], two) for two in unlike[0] if _gap(two, gap) != _gap(unlike[0][0], gap))
        yield (
            f"{sum(map(len, unlike))} of {len(bank)} frames show the picture of another one, with quite another gap: "
            f"'{one.id}' has {_gap(one, gap)} and '{other.id}' {_gap(other, gap)}. Was the camera frozen, or does the "
            "gap belong to another row?"
        )


def _are_apart(gaps: Sequence[Scalar]) -> bool:
    """Return whether one of the gaps is more than twice another one, or some are none."""
    numbers = [one for one in gaps if isinstance(one, int | float)]
    return 0 < len(numbers) < len(gaps) or (bool(numbers) and max(numbers) > _TWICE * min(numbers))


def _gap(frame: Frame, gap: Gap) -> str:
    cell = frame.truth.get(gap.column)
    return f"{cell:g} {gap.unit}" if isinstance(cell, int | float) else "none"


def _threshold_outside(bank: FrameBank, gap: Gap) -> Iterator[str]:
    """Yield that every gap is on one side of what is near."""
    gaps = _numbers(bank, gap.column)
    below = sum(one < gap.threshold for one in gaps)
    if len(gaps) > 1 and below in {0, len(gaps)}:
        side = "no gap is" if not below else "every gap is"
        yield (
            f"{side} below the threshold of {gap.threshold:g} {gap.unit}: they go from {min(gaps):g} to {max(gaps):g}. "
            "Is the threshold in the same unit?"
        )


def _far_from_gaps(bank: FrameBank, gap: Gap) -> Iterator[str]:
    """Yield the distances of moved things that are of another size than the gaps."""
    gaps = _numbers(bank, gap.column)
    for name in sorted({name for frame in bank for name in frame.placed}):
        moved = _numbers(bank, name)
        if not (moved and gaps):
            continue
        middle, usual = float(np.median(moved)), float(np.median(gaps))
        if min(middle, usual) * _APART < max(middle, usual):
            yield (
                f"{name}: its middle value is {middle:g}, and that of the gap {usual:g}, both read in {gap.unit}. Are "
                "they in one unit? A cell may say its own, as '5 m'"
            )


def _some(bank: FrameBank) -> Sequence[Frame]:
    return bank.frames[:: max(1, len(bank) // _LOOKED_AT)]


def _sizes(bank: FrameBank) -> Iterator[str]:
    """Yield that a camera's pictures are of several sizes."""
    shapes = [bank.shapes(frame) for frame in _some(bank)]
    for name in shapes[0]:
        sizes = sorted({(wide, high) for high, wide, _ in (one[name] for one in shapes)})
        if len(sizes) > 1:
            (wide, high), *_, (width, height) = sizes
            yield (
                f"camera '{name}' has pictures of several sizes, such as {wide}×{high} and {width}×{height} pixels: "
                "are they of one camera? A moment may be exchanged for one of the other size"
            )


def _of_a_film(bank: FrameBank) -> Iterator[str]:
    """Yield that frames declared independent have steps, or the colours of the next by name."""
    some = sorted(bank, key=lambda one: one.id)[-2 * _LOOKED_AT :]
    colours = np.array([decode(next(iter(bank.images(one).values())), one.id).mean((0, 1)) for one in some])
    near, far = (np.median(abs(colours - np.roll(colours, by, 0))) for by in (1, len(some) // 2))
    if near < far / 3 or "step" not in bank.manifest.absent:
        yield "--independent, but frames have steps, or are like the next by name, as in a film: --map episode=COLUMN"


def _dark(bank: FrameBank) -> Iterator[str]:
    """Yield that pictures are nearly black, as those of class numbers are."""
    frames = _some(bank)
    for name in (camera.name for camera in bank.frames[0].cameras):
        most = max(int(decode(bank.read(frame.pictures[name]), frame.id).max()) for frame in frames)
        if most < _DARK:
            yield (
                f"no pixel of {counted(len(frames), 'picture')} of camera '{name}' is brighter than {most} of 255: are "
                "these labels of classes, or depths, in place of pictures?"
            )
