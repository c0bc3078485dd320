"""Frames that two banks share: whether the moments are equal, and how far their numbers differ.

Source: paper, section Experimental Setup (the geometry fingerprint: both arms agree on all shared
frames).
"""

from collections.abc import Mapping
from dataclasses import dataclass

from eyechart.frames.nouns import BankManifest, Frame, FrameBank


@dataclass(frozen=True)
class SharedFrames:
    """The frames with equal names in two banks, in the order of the first.

    ``sizes`` are the numbers of frames of the banks. ``unlike`` maps each shared frame of different
    geometry to the names of what differs. ``furthest`` maps each shared number of the ground truth
    to its largest difference, in its own unit.
    """

    frames: tuple[str, ...]
    sizes: tuple[int, int]
    unlike: Mapping[str, tuple[str, ...]]
    furthest: Mapping[str, float]

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        return {
            "shared": len(self.frames),
            "of": list(self.sizes),
            "equal": len(self.frames) - len(self.unlike),
            "unlike": {frame: list(what) for frame, what in self.unlike.items()},
            "largest_differences": dict(self.furthest),
        }


def shared_frames(one: FrameBank, other: FrameBank) -> SharedFrames:
    """Return the frames with equal names; geometry is compared to 3 decimals, pixels are not."""
    theirs = {frame.id: frame for frame in other}
    pairs = [(frame, theirs[frame.id]) for frame in one if frame.id in theirs]
    unlike = {mine.id: _unlike(mine, its) for mine, its in pairs if mine.geometry() != its.geometry()}
    furthest: dict[str, float] = {}
    for mine, its in pairs:
        for name in mine.truth.keys() & its.truth.keys():
            a, b = mine.truth[name], its.truth[name]
            if isinstance(a, int | float) and isinstance(b, int | float) and not isinstance(a, bool):
                furthest[name] = max(furthest.get(name, 0.0), abs(a - b))
    return SharedFrames(
        tuple(mine.id for mine, _ in pairs), (len(one), len(other)), unlike, dict(sorted(furthest.items()))
    )


def same_moments(manifest: BankManifest, other: BankManifest) -> tuple[str, ...]:
    """Return the frames with equal names and geometry in two banks, in the order of the first."""
    theirs = other.geometry
    return tuple(frame for frame, digest in manifest.geometry.items() if theirs.get(frame) == digest)


def _unlike(frame: Frame, other: Frame) -> tuple[str, ...]:
    """Return the names of the parts that differ between two frames."""
    parts = ("scenario", "episode", "step", "cameras", "fields", "state", "motion", "past")
    found = [name for name in parts if getattr(frame, name) != getattr(other, name)]
    names = sorted(frame.truth.keys() | other.truth.keys())
    return (*found, *(name for name in names if frame.truth.get(name, "") != other.truth.get(name, "")))
