"""Episodes of a log that are one recording under two names, as in a merged data set.

If such an episode is counted twice, it is two in every test. The partner of a moment at a similar
state is then the moment itself.
"""

import hashlib
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np

from eyechart.frames import RGB, Frame, decode

LEAST_SHARED = 3
"""The fewest distinct moments that two candidates share: a robot that stands still has one."""
SHARED = 0.95
"""The share of the shorter one's distinct moments that both have: two that only begin equally are
no repeat."""
LOOKED_AT = 3
"""The number of shared moments whose pictures are compared."""
MEAN, PART = 3.0, 25.0
"""The largest differences of one moment's pictures, such as by another encoding: on average, and in
any part.

A small object in another place changes the average by no more than JPEG or H.264 do, but its own
part by more.
"""
LEAST_SIDE, PARTS = 4, 32
"""The least side of a part in pixels, and the approximate number of parts along a picture's shorter
side."""
MOST_HOLDERS = 8
"""The most episodes in which a moment is looked up, so that time grows only with the frames."""
MOST_TRIED = 3
_SHOWN = 8
REPEATS = "repeats"
"""The setting of an imported bank that lists repeated episodes."""


@dataclass(frozen=True)
class Repeat:
    """A repeated episode: its frames, both names, and whether its instruction differs.

    ``pairs`` are its moments with those of the other one.
    """

    frames: Sequence[Frame]
    episode: str
    of: str
    is_reworded: bool
    pairs: Sequence[tuple[Frame, Frame]]

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        return {"episode": self.episode, "of": self.of, "frames": len(self.frames), "told_otherwise": self.is_reworded}


def repeats(
    frames: Sequence[Frame], read: Callable[[str], bytes], digest: Callable[[str], str] | None = None
) -> list[Repeat]:
    """Return the episodes that repeat a longer or earlier one: same numbers and pictures.

    The numbers are the states, or else the motions. ``read`` returns the encoded picture of a file.
    Two recordings with the same numbers and different pictures are no repeats. Moments without
    numbers are equal if the ``digest`` of all their pictures is.
    """
    digest = digest or (lambda file: hashlib.sha256(read(file)).hexdigest())
    episodes: dict[str, list[Frame]] = defaultdict(list)
    for frame in frames:
        episodes[frame.drive].append(frame)
    moments = {drive: {_key(one, digest): one for one in reversed(many)} for drive, many in episodes.items()}
    holders: dict[bytes, list[str]] = defaultdict(list)
    several = len({frame.scenario for frame in frames}) > 1
    names = {drive: drive if several else many[0].episode for drive, many in episodes.items()}
    result = []
    for drive in sorted(episodes, key=lambda episode: -len(episodes[episode])):
        own = moments[drive]
        if (of := _same(own, holders, moments, read)) is None:
            for key in own:
                if len(holders[key]) < MOST_HOLDERS:
                    holders[key].append(drive)
            continue
        instruction, before = (
            {*chain.from_iterable(one.fields.items() for one in episodes[name])} for name in (drive, of)
        )
        pairs = [(one, moments[of][key]) for key, one in own.items() if key in moments[of]]
        result.append(Repeat(episodes[drive], names[drive], names[of], not instruction <= before, pairs))
    return result


def in_words(found: Sequence[Mapping[str, object]], *, kept: bool) -> str:
    """Return a line that names the repeated episodes, given as `Repeat.as_dict`."""
    pairs = [f"'{one['episode']}' is '{one['of']}'" for one in found]
    named = ", ".join(pairs[:_SHOWN]) + (f" and {len(pairs) - _SHOWN} more" if len(pairs) > _SHOWN else "")
    said = f"{len(pairs)} episodes repeat others: {named}"
    if len(pairs) == 1:
        said = f"episode '{found[0]['episode']}' repeats episode '{found[0]['of']}'"
    reworded = sum(bool(one["told_otherwise"]) for one in found)
    of = "" if reworded == len(pairs) else f" in {reworded}"
    said += f" (same pictures and numbers{f', another instruction{of}' if reworded else ''})"
    count = sum(int(str(one["frames"])) for one in found)
    if kept:
        return f"warning: {said}: kept, as --keep-repeats says, and counted twice"
    return f"{said}: left out, {count} frames; --keep-repeats imports them"


def _key(frame: Frame, digest: Callable[[str], str]) -> bytes:
    """Return a key of a moment: its state, else its motion, else its pictures.

    Numbers are in single precision. The motion ahead ends with the episode, so the last moments of
    an excerpt have another motion, or none.
    """
    numbers = [*chain.from_iterable(frame.state.values())] or [*chain.from_iterable(frame.motion)]
    held = np.array(numbers, dtype=np.float32) + np.float32(0)  # no zero with a sign
    content = held.tobytes() if numbers else " ".join(map(digest, frame.pictures.values())).encode()
    return hashlib.blake2b(content, digest_size=16).digest()


def _same(
    own: Mapping[bytes, Frame],
    holders: Mapping[bytes, Sequence[str]],
    moments: Mapping[str, Mapping[bytes, Frame]],
    read: Callable[[str], bytes],
) -> str | None:
    """Return the episode that these moments repeat, None if there is none."""
    counts = Counter(drive for key in own for drive in holders.get(key, ()))
    for drive, count in counts.most_common(MOST_TRIED):
        other = moments[drive]
        if count < max(LEAST_SHARED, SHARED * min(len(own), len(other))):
            continue
        shared = [key for key in own if key in other]
        looked = {shared[place * (len(shared) - 1) // (LOOKED_AT - 1)] for place in range(LOOKED_AT)}
        if all(_are_alike(own[key], other[key], read) for key in looked):
            return drive
    return None


def _are_alike(frame: Frame, other: Frame, read: Callable[[str], bytes]) -> bool:
    """Return whether all cameras of two frames show the same."""
    return all(_are_seen_alike(read(file), read(other.pictures[name])) for name, file in frame.pictures.items())


def _are_seen_alike(one: bytes, other: bytes) -> bool:
    return one == other or _are_level(decode(one, "a picture"), decode(other, "a picture"))


def _are_level(one: RGB, other: RGB) -> bool:
    """Return whether two pictures differ by no more than their encoding can."""
    if one.shape != other.shape:
        return False
    away = np.abs(one.astype(np.int16) - other).mean(axis=2)
    high, wide = away.shape
    side = min(max(LEAST_SIDE, min(high, wide) // PARTS), high, wide)
    rows, columns = high // side, wide // side
    parts = away[: rows * side, : columns * side].reshape(rows, side, columns, side).mean(axis=(1, 3))
    return bool(away.mean() <= MEAN and parts.max() <= PART)
