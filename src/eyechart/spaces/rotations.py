"""Rotations that are written as several numbers of a motion or a state.

Numbers are compared as matrices, so that equal rotations are equal in every representation.
"""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from eyechart.errors import SpecError, suggestion

Floats = npt.NDArray[np.float64]
Representation = Literal[
    "quat_xyzw",
    "quat_wxyz",
    "axis_angle",
    "rot6d",
    "euler_xyz",
    "euler_zyx",
    "euler_XYZ",
    "euler_ZYX",
    "euler_xyz_deg",
    "euler_zyx_deg",
    "euler_XYZ_deg",
    "euler_ZYX_deg",
]
"""How the numbers of a rotation are written.

``axis_angle`` is a rotation vector in radians. ``rot6d`` is the first column of the matrix, then
its second; the order by rows, (3, 2) in memory, is another one and is not read. ``euler_xyz`` are
three turns in the order of the numbers, in small letters about fixed axes, in capital letters about
the axes that turn along, as SciPy spells them. They are radians, and degrees with ``_deg``."""

REPRESENTATIONS: tuple[Representation, ...] = get_args(Representation)
EULER, DEGREES = "euler_", "_deg"
WIDTH: dict[Representation, int] = dict.fromkeys(REPRESENTATIONS, 3) | {"quat_xyzw": 4, "quat_wxyz": 4, "rot6d": 6}
MATRIX = 9
"""The numbers of a rotation as it is compared."""
FREEDOM = 3
"""The numbers that a rotation counts for."""
_DIGITS = 12
"""Decimals of a compared matrix: two representations of one rotation differ by rounding alone."""


def read_representation(word: str) -> Representation:
    """Return a word as a representation; raises SpecError that lists them."""
    for one in REPRESENTATIONS:
        if one == word:
            return one
    raise SpecError(f"a rotation is {', '.join(REPRESENTATIONS)}, not '{word}'{suggestion(word, REPRESENTATIONS)}")


@dataclass(frozen=True, slots=True)
class Rotation:
    """Consecutive numbers from ``first`` on that are one rotation, of a motion or ``of`` a state.

    ``state`` is the first number of the state's rotation that a place is measured from.
    """

    representation: Representation
    first: int
    of: Literal["motion", "state"] = "motion"
    state: int | None = None

    @property
    def numbers(self) -> range:
        """Return the places of its numbers."""
        return range(self.first, self.first + WIDTH[self.representation])

    def matrices(self, rows: Floats) -> Floats:
        """Return its matrices, shape (…, 3, 3), in rows of shape (…, numbers)."""
        return matrices(rows[..., self.numbers.start : self.numbers.stop], self.representation)


def matrices(numbers: Floats, representation: Representation) -> Floats:
    """Return the matrices, shape (…, 3, 3), of rotations of shape (…, numbers).

    Quaternions may have any length, and the columns of ``rot6d`` any lengths and angle. NaN where
    they give no rotation, such as for a quaternion of zeros.
    """
    if representation == "rot6d":
        return _of_columns(numbers[..., :3], numbers[..., 3:])
    if representation == "quat_wxyz":
        return _of_quaternions(np.roll(numbers, -1, axis=-1))
    if representation.startswith(EULER):
        return _of_angles(np.deg2rad(numbers) if representation.endswith(DEGREES) else numbers, representation[6:9])
    return _of_quaternions(numbers if representation == "quat_xyzw" else _quaternions(numbers))


def compared(found: Floats) -> Floats:
    """Return matrices (…, 3, 3) as numbers (…, 9), whose distance is twice the half angle's sine."""
    return np.asarray(np.round(found.reshape(*found.shape[:-2], MATRIX) / np.sqrt(2), _DIGITS))


def angle(numbers: Floats) -> Floats:
    """Return the angles in radians, shape (…), of rotations as `compared` gives them."""
    half = np.linalg.norm(numbers - np.eye(3).ravel() / np.sqrt(2), axis=-1) / 2
    return np.asarray(2 * np.arcsin(np.clip(half, 0, 1)))


def mean(found: Floats) -> Floats:
    """Return the rotation nearest to all matrices of shape (n, 3, 3)."""
    left, _, right = np.linalg.svd(found.mean(axis=0))
    sign = np.linalg.det(left @ right)
    return np.asarray(left @ np.diag([1.0, 1.0, 1.0 if sign >= 0 else -1.0]) @ right)


def vectors(found: Floats) -> Floats:
    """Return matrices (…, 3, 3) as rotation vectors (…, 3) in radians, of norms up to pi."""
    turn = np.arccos(np.clip((np.trace(found, axis1=-2, axis2=-1) - 1) / 2, -1, 1))[..., None]
    skew = np.stack([found[..., 2, 1] - found[..., 1, 2], found[..., 0, 2] - found[..., 2, 0],
                     found[..., 1, 0] - found[..., 0, 1]], axis=-1)  # fmt: skip
    size = np.linalg.norm(skew, axis=-1, keepdims=True)
    turn = np.where(turn < 1, np.arctan2(size / 2, np.cos(turn)), turn)
    usual = skew * np.where(size > 1e-6, turn / np.where(size > 1e-6, size, 1.0), 0.5)
    # Near half a turn the skew part vanishes, and the symmetric one holds the axis.
    outer = (found + np.eye(3)) / 2
    longest = np.diagonal(outer, axis1=-2, axis2=-1).argmax(axis=-1)
    axis = np.take_along_axis(outer, longest[..., None, None], axis=-2)[..., 0, :]
    axis = axis / np.maximum(np.linalg.norm(axis, axis=-1, keepdims=True), 1e-12)
    axis = np.where((axis * skew).sum(axis=-1, keepdims=True) < 0, -axis, axis)
    return np.asarray(np.where(turn > np.pi - 1e-4, axis * turn, usual))


def about_their_mean(numbers: Floats, rotations: tuple[Rotation, ...]) -> Floats:
    """Return rows (n, numbers) with each rotation as its 3-number turn from the mean of all rows."""
    by_first = {one.first: one for one in rotations}
    parts, place = [], 0
    while place < numbers.shape[-1]:
        if (one := by_first.get(place)) is None:
            parts.append(numbers[:, place : place + 1])
            place += 1
        else:
            found = one.matrices(numbers)
            parts.append(np.round(vectors(mean(found).T @ found), _DIGITS - 2))
            place = one.numbers.stop
    return np.concatenate(parts, axis=1)


def _of_columns(first: Floats, second: Floats) -> Floats:
    with np.errstate(divide="ignore", invalid="ignore"):
        x = first / np.linalg.norm(first, axis=-1, keepdims=True)
        rest = second - (x * second).sum(axis=-1, keepdims=True) * x
        y = rest / np.linalg.norm(rest, axis=-1, keepdims=True)
    return np.stack([x, y, np.cross(x, y)], axis=-1)


def _of_quaternions(numbers: Floats) -> Floats:
    with np.errstate(divide="ignore", invalid="ignore"):
        unit = numbers / np.linalg.norm(numbers, axis=-1, keepdims=True)
    x, y, z, w = (unit[..., place] for place in range(4))
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _quaternions(numbers: Floats) -> Floats:
    """Return rotation vectors (…, 3) as quaternions (…, 4), x first."""
    half = np.linalg.norm(numbers, axis=-1, keepdims=True) / 2
    return np.concatenate([numbers * np.sinc(half / np.pi) / 2, np.cos(half)], axis=-1)


def _of_angles(numbers: Floats, order: str) -> Floats:
    """Return three turns in radians in an order as ``xyz``; those about fixed axes come from the left."""
    turns = [
        _of_quaternions(_quaternions(numbers[..., [place]] * np.eye(3)["xyz".index(axis)]))
        for place, axis in enumerate(order.lower())
    ]
    first, second, third = turns if order.isupper() else reversed(turns)
    return np.asarray(first @ second @ third)
