"""What in a log of a robot looks like a fault of it, or makes what is measured by it another thing than it seems."""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
import numpy.typing as npt

from eyechart.channels import far_off, flat_state, logs
from eyechart.frames import IMPORTED, Frame, FrameBank
from eyechart.spaces.motion import MotionSpace
from eyechart.stats.outliers import outlying

LEAST_FRAMES = 3
"""Of fewer frames of an episode it is no wonder that a camera shows the same in all of them."""
STILL = 1e-9
"""A dimension whose spread is no more than this has one value, as `MotionSpace.scales` has it."""
SMALL = 1e-3
"""A dimension that varies by less of what the others do is named: it counts as much as they do."""

Floats = npt.NDArray[np.float64]


def notes(bank: FrameBank) -> list[str]:
    """Return what looks wrong in the log of a bank that says what a motion is, a line each; nothing of another bank.

    Numbers far from all others, dimensions of a motion that stay or hardly vary, and cameras that show one and the same
    picture all through an episode.
    """
    space = bank.manifest.motion
    if space is None:
        return []
    return [*_far_in_motion(bank, space), *_far_in_state(bank, space), *_spreads(bank, space), *_frozen(bank)]


def _far_in_motion(bank: FrameBank, space: MotionSpace) -> Iterator[str]:
    far = far_off(bank)
    if not far:
        return
    frames, names = [frame for frame in bank if frame.motion], [one.name for one in space.dimensions]
    numbers, which = _relative(frames, space), {name for many in far.values() for name in many}
    places = [place for place, name in enumerate(names) if name in which]
    said = _as_far(numbers[..., places].reshape(-1, len(places)), [names[place] for place in places])
    yield (
        f"motion {_quoted(names[place] for place in places)}: in {len(far)} of {len(frames)} logged motions a number "
        f"lies far from all others ({said}): these are left out of what answers are measured by; correct them"
    )


def _far_in_state(bank: FrameBank, space: MotionSpace) -> Iterator[str]:
    if not bank.manifest.state:
        return
    numbers = np.array([flat_state(frame.state) for frame in bank])
    far = outlying(numbers)
    if not far.any():
        return
    names = [one.name for one in space.state]
    names = names or [name for name, many in bank.frames[0].state.items() for _ in many]
    places = np.flatnonzero(far.any(axis=0))
    said = _as_far(numbers[:, places], [names[place] for place in places])
    count = int(far.any(axis=1).sum())
    yield (
        f"state {_quoted(names[place] for place in places)}: in {count} of {len(bank)} moments a number lies far "
        f"from all others ({said}): partners at a similar state are chosen by its spread; correct them"
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
    numbers = _relative(frames, space).reshape(-1, len(space.dimensions))
    spreads = {place: float(numbers[:, place].std()) for place, one in enumerate(space.dimensions) if one.scale is None}
    if still := [place for place, spread in spreads.items() if spread <= STILL]:
        values = ", ".join(_value(frames, space, place, float(numbers[0, place])) for place in still)
        yield (
            f"{values} in every row: the log does not say what counts there, and an answer counts in its own unit; "
            f"{_leave_out(bank)}"
        )
    varied = {place: spread for place, spread in spreads.items() if spread > STILL}
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
    return f"'{name}' is {min(raw):g}" if max(raw) - min(raw) <= STILL else f"'{name}' is {relative:g} off the state"


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


def _relative(frames: Sequence[Frame], space: MotionSpace) -> Floats:
    """Return logged motions as they are compared, shape (frames, steps, dimensions)."""
    states = np.array([flat_state(frame.state) for frame in frames])
    return space.relative(np.array([frame.motion for frame in frames]), states if states.size else None)


def _quoted(names: Iterable[str]) -> str:
    return ", ".join(f"'{name}'" for name in names)
