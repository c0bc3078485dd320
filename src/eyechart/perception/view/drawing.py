"""The calibrated view is a picture cut and enlarged in a fixed way, with a legend and a ruler around it.

It is the same for every frame: nothing in it depends on what the frame holds. The scene keeps every pixel that is
shown, and the legend stands beside it, never over it. So the view of the flipped picture is the reflection of the
scene with words that can still be read. Source: paper, section Constructive renderer-calibrated controller.
"""

import hashlib
import json
from dataclasses import asdict, dataclass
from functools import cache
from typing import Literal, NamedTuple

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from eyechart.errors import BankError, SpecError
from eyechart.frames import RGB, MirrorAxis

NONE = "none"
"""What ``--view`` takes for the picture as it is."""

Colour = tuple[int, int, int]
BLACK, GREY, RED, BLUE = (0, 0, 0), (110, 110, 110), (200, 0, 0), (0, 70, 200)
_WHITE = (255, 255, 255)


class Mark(NamedTuple):
    """One stroke of a legend: a text, a line, a box or a polygon, at points (x, y) in pixels of the view.

    ``size`` is a text's height or a line's width; ``anchor`` is Pillow's anchor of a text.
    """

    kind: Literal["text", "line", "box", "polygon"]
    points: tuple[tuple[int, int], ...]
    colour: Colour = BLACK
    words: str = ""
    size: int = 2
    anchor: str = "lm"


@dataclass(frozen=True, slots=True)
class View:
    """How one kind of picture is shown. Raises SpecError where its crop is not its own mirror image.

    ``shape`` is the (height, width) of the pictures that it is for, ``crop`` their rows and columns that are shown
    (top, bottom, left, right), each pixel as ``factor`` × ``factor``. ``above`` and ``below`` are the heights of the
    legend, ``beside`` its width on either side, in pixels of the view, and ``marks`` what is drawn there. ``ground`` is
    the colour that stands for what was cut off when the picture is restored.
    """

    name: str
    shape: tuple[int, int]
    crop: tuple[int, int, int, int]
    factor: int
    axis: MirrorAxis
    above: int
    below: int
    ground: Colour
    marks: tuple[Mark, ...]
    beside: int = 0

    def __post_init__(self) -> None:
        top, bottom, left, right = self.crop
        (height, width), sides = self.shape, {"vertical": (top, bottom), "horizontal": (left, right)}
        extent = {"vertical": height, "horizontal": width}
        if self.axis in sides and sum(sides[self.axis]) != extent[self.axis]:
            raise SpecError(f"view '{self.name}' cuts off more on one side of its {self.axis} axis than on the other")

    @property
    def size(self) -> tuple[int, int]:
        """Return the view's own (height, width) in pixels."""
        top, bottom, left, right = self.crop
        return self.above + (bottom - top) * self.factor + self.below, (right - left) * self.factor + 2 * self.beside

    @property
    def key(self) -> str:
        """Return ``name@hash``, which changes with any change of the view's definition."""
        words = json.dumps(asdict(self), sort_keys=True)
        return f"{self.name}@{hashlib.sha256(words.encode()).hexdigest()[:8]}"

    def show(self, pixels: RGB, name: str = "picture") -> RGB:
        """Return the view of a picture, shape (h, w, 3); raises BankError, naming it, for one of another size."""
        if pixels.shape != (*self.shape, 3):
            (high, wide), (height, width) = pixels.shape[:2], self.shape
            raise BankError(
                f"'{name}' has {wide}×{high} pixels, and the view '{self.name}' is for {width}×{height}: "
                f"show such pictures with --view {NONE}"
            )
        top, bottom, left, right = self.crop
        whole = _surround(self).copy()
        scene = pixels[top:bottom, left:right]
        whole[self._scene] = scene.repeat(self.factor, axis=0).repeat(self.factor, axis=1)
        return whole

    def restore(self, pixels: RGB) -> RGB | None:
        """Return the picture of which this is the view, what was cut off in ``ground``; None where it is no such view.

        Exact: every pixel that the view shows comes back.
        """
        if pixels.shape != (*self.size, 3):
            return None
        scene = pixels[self._scene]
        whole = _surround(self).copy()
        whole[self._scene] = scene
        if not np.array_equal(whole, pixels):
            return None
        top, bottom, left, right = self.crop
        picture = np.empty((*self.shape, 3), dtype=np.uint8)
        picture[:] = self.ground
        picture[top:bottom, left:right] = scene[:: self.factor, :: self.factor]
        return picture

    @property
    def _scene(self) -> tuple[slice, slice]:
        """Return the rows and columns of the view in which the scene stands."""
        height, width = self.size
        return slice(self.above, height - self.below), slice(self.beside, width - self.beside)


@cache
def _surround(view: View) -> RGB:
    """Return the view without a scene, shape (h, w, 3); it is not to be written to."""
    height, width = view.size
    sheet = Image.new("RGB", (width, height), _WHITE)
    draw = ImageDraw.Draw(sheet)
    for mark in view.marks:
        if mark.kind == "text":
            font = ImageFont.load_default(mark.size)
            draw.text(mark.points[0], mark.words, fill=mark.colour, font=font, anchor=mark.anchor)
        elif mark.kind == "line":
            draw.line(mark.points, fill=mark.colour, width=mark.size)
        elif mark.kind == "box":
            draw.rectangle(mark.points, fill=mark.colour)
        else:
            draw.polygon(mark.points, fill=mark.colour)
    pixels = np.asarray(sheet, dtype=np.uint8)
    pixels.flags.writeable = False
    return pixels


def text(x: int, y: int, words: str, *, size: int = 18, colour: Colour = BLACK, anchor: str = "lm") -> Mark:
    """Return a text with its anchor, by default the left middle, at (x, y)."""
    return Mark("text", ((x, y),), colour, words, size, anchor)


def arrow(x: int, y: int, dx: int, dy: int, colour: Colour) -> Mark:
    """Return an arrowhead with its tip at (x, y) that points along (dx, dy), 14 pixels long."""
    back, wide = 14, 8
    base_x, base_y = x - back * dx, y - back * dy
    corners = ((x, y), (base_x - wide * dy, base_y - wide * dx), (base_x + wide * dy, base_y + wide * dx))
    return Mark("polygon", corners, colour)
