"""What in a log of a robot looks like a fault of it, or makes what is measured by it another thing than it seems."""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from itertools import combinations

import numpy as np
import numpy.typing as npt

from eyechart.channels import far_off, flat_state, logs, rare, relative_log, state_names
from eyechart.frames import IMPORTED, Frame, FrameBank
from eyechart.spaces.motion import MotionSpace
from eyechart.stats.outliers import outlying, recurs

LEAST_FRAMES = 3
"""Of fewer frames of an episode it is no wonder that a camera shows the same in all of them."""
ONE_VALUE = 1e-9
"""A dimension whose spread is no more than this has one value, as `MotionSpace.scales` has it."""
SMALL = 1e-3
"""A dimension that varies by less of what the others do is named: it counts as much as they do."""

Floats = npt.NDArray[np.float64]


def notes(bank: FrameBank) -> list[str]:
    """Return what looks wrong in the log of a bank that says what a motion is, a line each; nothing of another bank.

    Numbers far from all others, dimensions of a motion that stay or hardly vary, and cameras that
    show one and the same picture all through an episode.
    """
    space = bank.manifest.motion
    if space is None:
        return []
    return [*_far_in_motion(bank, space), *_far_in_state(bank), *_spreads(bank, space), *_frozen(bank), *_doubled(bank)]


def _far_in_motion(bank: FrameBank, space: MotionSpace) -> Iterator[str]:
    """Yield which dimensions have a few numbers far from all others: those of faults, and those that recur."""
    frames, names, left = logs(bank), [one.name for one in space.dimensions], far_off(bank)
    logged = [frame for frame in bank if frame.motion]
    faults = {name for many in left.values() for name in many}
    if faults:
        said = _far(logged, space, [place for place, name in enumerate(names) if name in faults])
        yield (
            f"motion {said}, in {len(left)} of {len(logged)} logged motions: these are left out of what answers are "
            "measured by; correct them, or declare the scale if it is a move that is rare"
        )
    recur = [place for place, one in enumerate(space.dimensions) if one.name in rare(bank) - faults and not one.scale]
    if recur:
        yield (
            f"motion {_far(frames, space, recur)}, in several episodes: a move that is rare, or wrong rows, which "
            "would be the scale of all others; correct them, or declare the scale"
        )


def _far(frames: Sequence[Frame], space: MotionSpace, places: Sequence[int]) -> str:
    """Return in words that some dimensions have numbers far from all others, and how far."""
    names = [space.dimensions[place].name for place in places]
    said = _as_far(relative_log(frames, space)[..., places].reshape(-1, len(places)), names)
    return f"{_quoted(names)}: a few numbers lie far from all others ({said})"


def _far_in_state(bank: FrameBank) -> Iterator[str]:
    if not bank.manifest.state:
        return
    numbers = np.array([flat_state(frame.state) for frame in bank])
    far = outlying(numbers)
    far &= ~recurs(far, [frame.drive for frame in bank])
    if not far.any():
        return
    names, places = state_names(bank), np.flatnonzero(far.any(axis=0))
    said = _as_far(numbers[:, places], [names[place] for place in places])
    count = int(far.any(axis=1).sum())
    yield (
        f"state {_quoted(names[place] for place in places)}: a few numbers lie far from all others ({said}), in "
        f"{count} of {len(bank)} moments: partners at a similar state are chosen by its spread, and places are "
        "measured from it; correct them"
    )


def _as_far(numbers: Floats, names: Sequence[str]) -> str:
    """Return how far off the farthest of some numbers is, shape (n, d), beside how far the others of its column are."""
    away = np.abs(numbers - np.median(numbers, axis=0))
    usual = np.quantile(away, 0.95, axis=0)
    worst = int((away.max(axis=0) / usual).argmax())
    of = f"'{names[worst]}' is " if len(names) > 1 else ""
    return f"{of}{away[:, worst].max():.2g} from the median, where 95 of 100 are within {usual[worst]:.2g}"


def _spreads(bank: FrameBank, space: MotionSpace) -> Iterator[str]:
    """Yield which dimensions of the motion have one value, and which vary by next to nothing and count all the same."""
    frames = logs(bank)
    if not frames:
        return
    numbers = relative_log(frames, space).reshape(-1, len(space.dimensions))
    spreads = {place: float(numbers[:, place].std()) for place, one in enumerate(space.dimensions) if one.scale is None}
    if still := [place for place, spread in spreads.items() if spread <= ONE_VALUE]:
        values = ", ".join(_value(frames, space, place, float(numbers[0, place])) for place in still)
        yield (
            f"{values} in every row: the log does not say what counts there, and an answer counts in its own unit; "
            f"{_leave_out(bank)}"
        )
    varied = {place: spread for place, spread in spreads.items() if spread > ONE_VALUE}
    for place, spread in varied.items():
        usual = float(np.median([other for one, other in varied.items() if one != place] or [0.0]))
        if spread < SMALL * usual:
            yield (
                f"'{space.dimensions[place].name}' varies by {spread:.1g}, the others by {usual:.2g}: an error of that "
                f"size counts as much as one of theirs; if it is of the same unit, {_leave_out(bank)}"
            )


def _value(frames: Sequence[Frame], space: MotionSpace, place: int, relative: float) -> str:
    """Return what a dimension is in every row, in words: a number, or one beside that of the state."""
    name, raw = space.dimensions[place].name, {row[place] for frame in frames for row in frame.motion}
    return (
        f"'{name}' is {min(raw):g}" if max(raw) - min(raw) <= ONE_VALUE else f"'{name}' is {relative:g} off the state"
    )


def _leave_out(bank: FrameBank) -> str:
    """Return what can be done about a dimension whose spread is no measure of it."""
    if "lerobot" in str(bank.manifest.settings.get("format")):
        return "leave it out of the data set's 'action', or import a --table, whose --rig declares its scale"
    if bank.manifest.simulator != IMPORTED:
        return "declare its scale"
    return "declare its scale in --rig (scale = …), or leave it out"


def _frozen(bank: FrameBank) -> Iterator[str]:
    """Yield which cameras show one and the same picture all through an episode, but for one that always does."""
    episodes: dict[object, list[Frame]] = defaultdict(list)
    for frame in bank:
        episodes[frame.drive].append(frame)
    long = [frames for frames in episodes.values() if len(frames) >= LEAST_FRAMES]
    images = bank.manifest.images
    for name in (one.name for one in bank.frames[0].cameras):
        every = [{images.get(frame.pictures[name], frame.id) for frame in frames} for frames in long]
        count = sum(len(seen) == 1 for seen in every)
        if count and len({images.get(frame.pictures[name], frame.id) for frame in bank}) > 1:
            yield (
                f"camera '{name}' shows one and the same picture all through {count} of {len(long)} episodes: was it "
                "frozen, or covered?"
            )


def _doubled(bank: FrameBank) -> Iterator[str]:
    """Yield which cameras show in most frames the very picture of another one."""
    images, names = bank.manifest.images, [one.name for one in bank.frames[0].cameras]
    for one, other in combinations(names, 2):
        count = sum(images.get(frame.pictures[one], one) == images.get(frame.pictures[other], other) for frame in bank)
        if count > len(bank) / 2:
            yield (
                f"cameras '{one}' and '{other}' show one and the same picture in {count} of {len(bank)} moments: what "
                "is said of the one is said of both; were two names given to one camera?"
            )


def _quoted(names: Iterable[str]) -> str:
    return ", ".join(f"'{name}'" for name in names)
