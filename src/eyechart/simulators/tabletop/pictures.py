"""The table's two cameras: ``top`` shows all of it, ``wrist`` shows the area near the tool."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from eyechart.cameras import Colour
from eyechart.simulators.tabletop.world import Floats, Workspace

SIZE = 32
CAMERAS = ("top", "wrist")
TABLE: Colour = (200, 190, 170)
OTHER_TABLE: Colour = (170, 200, 180)
BLOCKS: tuple[Colour, Colour] = ((210, 40, 40), (40, 70, 220))
DECOY: Colour = (120, 120, 120)
HALF = 0.06
"""Half a block's width."""
ZOOM = 2.5
"""The magnification of the wrist camera, whose picture is centred on the tool."""
_DARK, _OPEN, _CLOSED = (30.0, 30.0, 30.0), (120.0, 120.0, 120.0), (240.0, 240.0, 90.0)
_SHADE = 0.95

_Pictures = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class TableAppearance:
    """The look of the table: its colour, the blocks' colours, and grey decoys.

    ``decoys`` has shape (k, 2).
    """

    table: Colour = TABLE
    blocks: tuple[Colour, Colour] = BLOCKS
    decoys: Floats | None = None


USUAL = TableAppearance()
_MIDDLES = (np.arange(SIZE) + 0.5)[None, :]


def top(tables: Sequence[Workspace], look: TableAppearance = USUAL) -> _Pictures:
    """Return the pictures of the camera above, shape (n, 32, 32, 3)."""
    tools, grips = np.stack([table.tool for table in tables]), np.array([table.grip for table in tables])
    pictures = _ground(len(tables), look.table)
    for places, colour in _things(tables, look):
        _square(pictures, places, HALF, colour)
    _disc(pictures, tools, 0.045, np.broadcast_to(_DARK, (len(tables), 3)))
    _disc(pictures, tools, 0.02, np.where(grips[:, None] > 0.5, _CLOSED, _OPEN))
    return _rounded(pictures)


def wrist(tables: Sequence[Workspace], look: TableAppearance = USUAL) -> _Pictures:
    """Return the pictures of the camera at the tool, shape (n, 32, 32, 3)."""
    tools = np.stack([table.tool for table in tables])
    pictures = _SHADE * _ground(len(tables), look.table)
    for places, colour in _things(tables, look):
        _square(pictures, (places - tools) * ZOOM + 0.5, HALF * ZOOM, colour)
    _disc(pictures, np.broadcast_to((0.5, 0.06), tools.shape), 0.07, np.broadcast_to(_DARK, (len(tables), 3)))
    return _rounded(pictures)


def cameras(tables: Sequence[Workspace], look: TableAppearance = USUAL) -> dict[str, _Pictures]:
    """Return the pictures of both cameras by name, each of shape (n, 32, 32, 3)."""
    return {"top": top(tables, look), "wrist": wrist(tables, look)}


def _ground(count: int, colour: Colour) -> Floats:
    return np.broadcast_to(np.array(colour, np.float64), (count, SIZE, SIZE, 3)).copy()


def _things(tables: Sequence[Workspace], look: TableAppearance) -> list[tuple[Floats, Colour]]:
    """Return the places, shape (n, 2), and the colour of every block and decoy."""
    blocks = np.stack([table.blocks for table in tables])
    found = [(blocks[:, place], colour) for place, colour in enumerate(look.blocks)]
    decoys = [] if look.decoys is None else [np.broadcast_to(place, blocks[:, 0].shape) for place in look.decoys]
    return [*((place, DECOY) for place in decoys), *found]


def _square(pictures: Floats, places: Floats, half: float, colour: Colour) -> None:
    across, down = (np.clip(half * SIZE - np.abs(_MIDDLES - places[:, [axis]] * SIZE) + 0.5, 0, 1) for axis in (0, 1))
    _paint(pictures, down[:, :, None] * across[:, None, :], np.array(colour, np.float64)[None])


def _disc(pictures: Floats, places: Floats, radius: float, colours: Floats) -> None:
    across, down = (_MIDDLES - places[:, [axis]] * SIZE for axis in (0, 1))
    far = np.sqrt(down[:, :, None] ** 2 + across[:, None, :] ** 2)
    _paint(pictures, np.clip(radius * SIZE - far + 0.5, 0, 1), colours)


def _paint(pictures: Floats, share: Floats, colours: Floats) -> None:
    pictures += share[..., None] * (colours[:, None, None, :] - pictures)


def _rounded(pictures: Floats) -> _Pictures:
    return np.asarray(np.rint(pictures), np.uint8)
