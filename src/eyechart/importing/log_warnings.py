"""Oddities of a robot's log that look like faults or change the meaning of measurements."""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from itertools import combinations

import numpy as np
import numpy.typing as npt

from eyechart.channels import far_off, flat_state, logs, rare, relative_log, state_names
from eyechart.frames import IMPORTED, Frame, FrameBank
from eyechart.spaces.motion import ONE_VALUE, MotionSpace
from eyechart.stats.outliers import outlying, recurs

LEAST_FRAMES = 3
"""The fewest frames of an episode in which one unchanged picture is suspicious."""
SMALL = 1e-3
"""A dimension that varies by less than this share of the others is reported, because it counts as
much as they do."""

Floats = npt.NDArray[np.float64]


def notes(bank: FrameBank) -> list[str]:
    """Return one line for each oddity in the log of a bank with motions, else none.

    Oddities are numbers far from all others, dimensions of a motion that hardly vary, and cameras
    that show one picture all through an episode.
    """
    space = bank.manifest.motion
    if space is None:
        return []
    return [*_far_in_motion(bank, space), *_far_in_state(bank), *_spreads(bank, space), *_frozen(bank), *_doubled(bank)]


def _far_in_motion(bank: FrameBank, space: MotionSpace) -> Iterator[str]:
    """Yield the dimensions with a few far numbers: faults, and numbers that recur."""
    frames, names, left = logs(bank), [dimension.name for dimension in space.dimensions], far_off(bank)
    logged = [frame for frame in bank if frame.motion]
    faults = {name for many in left.values() for name in many}
    if faults:
        said = _far(logged, space, [place for place, name in enumerate(names) if name in faults])
        yield (
            f"motion {said}, in {len(left)} of {len(logged)} logged motions: answers are not compared with these, "
            "and they set no scale; correct them, or declare the scale if it is a rare move"
        )
    recur = [
        place
        for place, dimension in enumerate(space.dimensions)
        if dimension.name in rare(bank) - faults and not dimension.scale
    ]
    if recur:
        yield (
            f"motion {_far(frames, space, recur)}, in several episodes: a rare move, or wrong rows, which "
            "would set the scale of all others; correct them, or declare the scale"
        )


def _far(frames: Sequence[Frame], space: MotionSpace, places: Sequence[int]) -> str:
    """Return a note, with distances, on dimensions with numbers far from all others."""
    names, columns = [space.dimensions[place].name for place in places], [space.plain.index(place) for place in places]
    said = _as_far(relative_log(frames, space)[..., columns].reshape(-1, len(places)), names)
    return f"{_quoted(names)}: a few numbers lie far from all others ({said})"


def _far_in_state(bank: FrameBank) -> Iterator[str]:
    if not bank.manifest.state:
        return
    numbers, space = np.array([flat_state(frame.state) for frame in bank]), bank.manifest.motion
    far = outlying(numbers)
    for one in () if space is None else space.rotations_of("state"):
        far[:, list(one.numbers)] = False
    far &= ~recurs(far, [frame.drive for frame in bank])
    if not far.any():
        return
    names, places = state_names(bank), np.flatnonzero(far.any(axis=0))
    said = _as_far(numbers[:, places], [names[place] for place in places])
    count = int(far.any(axis=1).sum())
    yield (
        f"state {_quoted(names[place] for place in places)}: a few numbers lie far from all others ({said}), in "
        f"{count} of {len(bank)} moments. Partners at a similar state are chosen by its spread, and places are "
        "measured from it; correct them"
    )


def _as_far(numbers: Floats, names: Sequence[str]) -> str:
    """Return the farthest number's distance, shape (n, d), next to the usual one of its column."""
    away = np.abs(numbers - np.median(numbers, axis=0))
    usual = np.quantile(away, 0.95, axis=0)
    worst = int((away.max(axis=0) / usual).argmax())
    of = f"'{names[worst]}' is " if len(names) > 1 else ""
    return f"{of}{away[:, worst].max():.2g} from the median, where 95 of 100 are within {usual[worst]:.2g}"


def _spreads(bank: FrameBank, space: MotionSpace) -> Iterator[str]:
    """Yield the dimensions of the motion that have one value, or hardly vary but still count."""
    frames = logs(bank)
    if not frames:
        return
    compared = relative_log(frames, space).reshape(-1, space.width)
    numbers = {place: compared[:, column] for column, place in enumerate(space.plain)}
    spreads = {place: float(one.std()) for place, one in numbers.items() if space.dimensions[place].scale is None}
    if still := [place for place, spread in spreads.items() if spread <= ONE_VALUE]:
        values = ", ".join(_value(frames, space, place, float(numbers[place][0])) for place in still)
        yield (
            f"{values} in every row: the log gives no scale there, and an answer counts in its own unit; "
            f"{_leave_out(bank)}"
        )
    varied = {place: spread for place, spread in spreads.items() if spread > ONE_VALUE}
    for place, spread in varied.items():
        usual = float(np.median([other for one, other in varied.items() if one != place] or [0.0]))
        if spread < SMALL * usual:
            yield (
                f"'{space.dimensions[place].name}' varies by {spread:.1g}, the others by {usual:.2g}: an error of that "
                f"size counts as much as one of theirs; if it has the same unit, {_leave_out(bank)}"
            )


def _value(frames: Sequence[Frame], space: MotionSpace, place: int, relative: float) -> str:
    """Return a dimension's value in every row: a number, or one relative to the state."""
    name, raw = space.dimensions[place].name, {row[place] for frame in frames for row in frame.motion}
    return (
        f"'{name}' is {min(raw):g}" if max(raw) - min(raw) <= ONE_VALUE else f"'{name}' is {relative:g} off the state"
    )


def _leave_out(bank: FrameBank) -> str:
    """Return the advice on a dimension whose spread is no measure of it."""
    if "lerobot" in str(bank.manifest.settings.get("format")):
        return "leave it out of the data set's 'action', or import a --table, whose --rig declares its scale"
    if bank.manifest.simulator != IMPORTED:
        return "declare its scale"
    return "declare its scale in --rig (scale = …), or leave it out"


def _frozen(bank: FrameBank) -> Iterator[str]:
    """Yield the cameras with one unchanged picture in some episodes, unless it never changes."""
    episodes: dict[object, list[Frame]] = defaultdict(list)
    for frame in bank:
        episodes[frame.drive].append(frame)
    long = [frames for frames in episodes.values() if len(frames) >= LEAST_FRAMES]
    images = bank.manifest.images
    for name in (camera.name for camera in bank.frames[0].cameras):
        every = [{images.get(frame.pictures[name], frame.id) for frame in frames} for frames in long]
        count = sum(len(seen) == 1 for seen in every)
        if count and len({images.get(frame.pictures[name], frame.id) for frame in bank}) > 1:
            yield (
                f"camera '{name}' shows the same picture all through {count} of {len(long)} episodes: was it "
                "frozen, or covered?"
            )


def _doubled(bank: FrameBank) -> Iterator[str]:
    """Yield the pairs of cameras that show the same picture in most frames."""
    images, names = bank.manifest.images, [camera.name for camera in bank.frames[0].cameras]
    for one, other in combinations(names, 2):
        count = sum(images.get(frame.pictures[one], one) == images.get(frame.pictures[other], other) for frame in bank)
        if count > len(bank) / 2:
            yield (
                f"cameras '{one}' and '{other}' show the same picture in {count} of {len(bank)} moments: results "
                "for one hold for both; does one camera have two names?"
            )


def _quoted(names: Iterable[str]) -> str:
    return ", ".join(f"'{name}'" for name in names)
