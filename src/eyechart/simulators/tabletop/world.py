"""A table with a red and a blue block, and a tool that reaches for the named one.

The table is the unit square; x grows to the right and y downwards, as in the picture from above.
Nothing is drawn here.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Colour = Literal["red", "blue"]
Object = Literal["named", "other"]

COLOURS: tuple[Colour, Colour] = ("red", "blue")
HORIZON = 8
"""The number of moves that one action plans."""
REACH = 0.06
"""The longest move, and the unit of dx and dy."""
CLOSE = 0.025
"""The gripper closes where a move ends nearer to the block than this."""
MOVED = 0.12
"""The distance by which a block is moved in the pictures that move it."""
_APART, _LOW, _HIGH = 0.2, 0.12, 0.88
_EDGE = 0.06
_UNSTEADY = 0.25
_FIXED = ((0.3, 0.7), (0.7, 0.7))
_DIRECTIONS = 16


@dataclass(frozen=True)
class Workspace:
    """The table at a moment: the places of tool and blocks, and the named block.

    ``blocks`` has shape (2, 2): red and blue, x and y. ``grip`` is 1 if the gripper is closed.
    """

    tool: Floats
    grip: float
    blocks: Floats
    named: Colour

    def place_of(self, which: Object) -> int:
        """Return the row of the named block, or of the other one."""
        named = COLOURS.index(self.named)
        return named if which == "named" else 1 - named

    @property
    def target(self) -> Floats:
        """Return the place of the named block, shape (2,)."""
        return np.asarray(self.blocks[self.place_of("named")])

    def moved(self, which: Object, by: Floats) -> "Workspace":
        """Return the same moment with one block moved."""
        blocks = self.blocks.copy()
        blocks[self.place_of(which)] += by
        return replace(self, blocks=blocks)

    def told_otherwise(self) -> "Workspace":
        """Return the same moment with the other block named."""
        return replace(self, named=COLOURS[self.place_of("other")])


def instruction(named: str) -> str:
    """Return the instruction for a named block."""
    return f"reach the {named} block"


def oracle(table: Workspace) -> Floats:
    """Return the straight motion to the named block, shape (8, 3): dx, dy and grip.

    dx and dy are in units of `REACH`.
    """
    place, rows = table.tool.copy(), np.zeros((HORIZON, 3))
    for row in rows:
        way = table.target - place
        far = float(np.hypot(*way))
        move = way if far < REACH else way / far * REACH
        row[:2], row[2] = move / REACH, float(np.hypot(*(way - move)) < CLOSE)
        place += move
    return rows


def scene(rng: np.random.Generator, *, fixed: bool = False) -> Floats:
    """Return the blocks' places, shape (2, 2): red and blue; apart, or fixed at two places."""
    while not fixed:
        pair = rng.uniform(_LOW, _HIGH, (2, 2))
        if np.hypot(*(pair[0] - pair[1])) > _APART:
            return pair
    return np.array(_FIXED)


def episode(rng: np.random.Generator, blocks: Floats, named: Colour, moves: int, *, left: bool) -> list[Workspace]:
    """Return a reach by an oracle with an unsteady hand, begun in the left or right half."""
    tool, grip, result = rng.uniform((0.1, 0.1), (0.5, 0.9)), 0.0, []
    if not left:
        tool[0] = 1 - tool[0]
    for _ in range(moves):
        now = Workspace(tool, grip, blocks, named)
        result.append(now)
        first = oracle(now)[0]
        tool = np.clip(tool + REACH * (first[:2] + _UNSTEADY * rng.normal(size=2)), 0.02, 0.98)
        grip = float(first[2])
    return result


def direction(table: Workspace, which: Object, rng: np.random.Generator) -> Floats:
    """Return a unit vector along which a block has room to move by `MOVED` both ways.

    Room means away from the edges and from the other block. If no drawn direction has room on both
    sides, it is the one with the most room.
    """
    angles = rng.uniform(0, 2 * np.pi, _DIRECTIONS)
    ways = np.column_stack([np.cos(angles), np.sin(angles)])
    own, other = table.blocks[table.place_of(which)], table.blocks[1 - table.place_of(which)]
    ends = own + MOVED * np.stack([ways, -ways])
    inside = np.minimum(ends, 1 - ends).min(axis=(0, 2)) - _EDGE
    clear = np.linalg.norm(ends - other, axis=2).min(axis=0) - 2 * _EDGE
    room = np.minimum(inside, clear)
    free = np.flatnonzero(room >= 0)
    return np.asarray(ways[free[0] if len(free) else room.argmax()])
