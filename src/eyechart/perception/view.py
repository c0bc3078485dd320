"""The calibrated view: a picture cut and enlarged in a fixed way, with a legend and a ruler.

It is the same for every frame, whatever the frame shows. The scene keeps every visible pixel, and
the legend is next to it, never over it. So the view of a flipped picture has the reflected scene
and readable words. Next to a forward camera's picture, rulers give the distance of the ground.
Source: paper, section Constructive renderer-calibrated controller.
"""

import hashlib
import json
from dataclasses import asdict, dataclass, replace
from functools import cache
from typing import Literal, NamedTuple

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from eyechart.cameras import FORWARD, ForwardView
from eyechart.errors import BankError, SpecError
from eyechart.frames import RGB, MirrorAxis, Stimulus, decode, encode
from eyechart.spaces.scene import CLEAR_AHEAD_M, CLEAR_BEHIND_M, CLOSE_GAP_M

NONE = "none"
"""The value of ``--view`` for the picture itself."""

Colour = tuple[int, int, int]
BLACK, GREY, RED, BLUE = (0, 0, 0), (110, 110, 110), (200, 0, 0), (0, 70, 200)
_WHITE = (255, 255, 255)


class LegendMark(NamedTuple):
    """One stroke of a legend: text, line, box or polygon, at points (x, y) in pixels of the view.

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
    """The view of one kind of picture. Raises SpecError if its crop is no mirror image of itself.

    ``shape`` is the (height, width) of its pictures. ``crop`` gives the rows and columns shown
    (top, bottom, left, right), each pixel as ``factor`` × ``factor``. ``above`` and ``below`` are
    the heights of the legend, ``beside`` its width on either side, in pixels of the view. ``marks``
    are its strokes. ``ground`` fills what was cut off when a picture is restored.
    """

    name: str
    shape: tuple[int, int]
    crop: tuple[int, int, int, int]
    factor: int
    axis: MirrorAxis
    above: int
    below: int
    ground: Colour
    marks: tuple[LegendMark, ...]
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
        """Return the view of a picture, shape (h, w, 3); BankError for one of another size."""
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
        """Return the picture of this view, with cut parts in ``ground``; None for no such view.

        Every visible pixel comes back exactly.
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
    """Return the view without a scene, shape (h, w, 3), read-only."""
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


def text(x: int, y: int, words: str, *, size: int = 18, colour: Colour = BLACK, anchor: str = "lm") -> LegendMark:
    """Return a text with its anchor, by default the left middle, at (x, y)."""
    return LegendMark("text", ((x, y),), colour, words, size, anchor)


def arrow(x: int, y: int, dx: int, dy: int, colour: Colour) -> LegendMark:
    """Return an arrowhead with its tip at (x, y) that points along (dx, dy), 14 pixels long."""
    back, wide = 14, 8
    base_x, base_y = x - back * dx, y - back * dy
    corners = ((x, y), (base_x - wide * dy, base_y - wide * dx), (base_x + wide * dy, base_y + wide * dx))
    return LegendMark("polygon", corners, colour)


_EGO_BODY, _EGO_OUTLINE = (50, 200, 0), (60, 60, 60)


def highway() -> View:
    """Return the view of highway-env's picture: 17 m behind to 76 m ahead, 10 m to either side."""
    factor, crop, above, below = 2, (20, 130, 88, 600), 84, 124
    zero, px_per_m = 183, 11  # the column of the car's middle, and pixels a metre, in the view
    floor = above + factor * (crop[1] - crop[0])

    def at(metres: float) -> int:
        return zero + round(px_per_m * metres)

    legend = (
        text(12, 22, "LEFT side: the lane above you", size=20, colour=BLUE),
        arrow(308, 13, 0, -1, BLUE),
        # A car as highway-env draws it, enlarged twice.
        LegendMark("box", ((374, 11), (427, 32)), _EGO_OUTLINE),
        LegendMark("box", ((376, 13), (425, 30)), _EGO_BODY),
        text(438, 22, "= YOU (red after a crash), at 0 m, driving", size=20),
        LegendMark("line", ((822, 22), (870, 22)), BLACK, size=4),
        arrow(884, 22, 1, 0, BLACK),
        text(438, 52, "dashed line: a lane beyond it; solid line: edge of the road", size=18, colour=GREY),
        text(zero, 58, "YOU", size=20, anchor="mm"),
        arrow(zero, above - 2, 0, 1, BLACK),
        text(12, floor + 108, "RIGHT side: the lane below you", size=20, colour=BLUE),
        arrow(320, floor + 117, 0, 1, BLUE),
    )
    ruler: list[LegendMark] = [
        arrow(zero, floor + 2, 0, -1, BLACK),
        LegendMark("line", ((0, floor + 22), (1023, floor + 22)), BLACK),
    ]
    for metres in range(-10, 71, 10):
        ruler += (
            LegendMark("line", ((at(metres), above - 8), (at(metres), above)), BLACK),
            LegendMark("line", ((at(metres), floor + 14), (at(metres), floor + 22)), BLACK),
            text(at(metres), floor + 33, f"{metres} m", size=16, anchor="mm"),
        )
    close = f"CLOSE: a car ahead in your lane, its middle nearer than {CLOSE_GAP_M:g} m"
    zones = (
        LegendMark("box", ((at(0), floor + 46), (at(CLOSE_GAP_M), floor + 62)), RED),
        text(at(CLOSE_GAP_M) + 8, floor + 54, close, colour=RED),
        LegendMark("box", ((at(-CLEAR_BEHIND_M), floor + 72), (at(CLEAR_AHEAD_M), floor + 88)), BLUE),
        text(at(CLEAR_AHEAD_M) + 8, floor + 80, "a side is CLEAR if its lane is empty here", colour=BLUE),
    )
    return View(
        name="highway",
        shape=(150, 600),
        crop=crop,
        factor=factor,
        axis="vertical",
        above=above,
        below=below,
        ground=(100, 100, 100),
        marks=(*legend, *ruler, *zones),
    )


_FACTOR, _ABOVE, _BELOW, _BESIDE = 2, 74, 86, 96
_TICKS_M = (2, 3, 4, 5, 8, 15)


def forward(name: str, camera: ForwardView) -> View:
    """Return the view of a forward camera: the whole picture with distances at its sides."""
    width, floor = camera.width * _FACTOR + 2 * _BESIDE, _ABOVE + camera.height * _FACTOR
    near = camera.distances

    def row(metres: float) -> int:
        """Return the row of the view in which the ground at a distance lies."""
        return _ABOVE + round(_FACTOR * (camera.horizon + camera.focal_px * camera.eye_m / metres))

    marks: list[LegendMark] = [
        text(12, 20, "LEFT", size=22, colour=BLUE),
        arrow(76, 20, -1, 0, BLUE),
        text(width - 12, 20, "RIGHT", size=22, colour=BLUE, anchor="rm"),
        arrow(width - 88, 20, 1, 0, BLUE),
        text(width // 2, 20, "YOUR forward camera, driving into the picture", size=20, anchor="mm"),
        text(width // 2, 50, "rulers: metres ahead, where things meet the ground", size=18, colour=GREY, anchor="mm"),
    ]
    for outer, inner, number, anchor in (
        (_BESIDE - 34, _BESIDE, _BESIDE - 40, "rm"),
        (width - _BESIDE + 34, width - _BESIDE, width - _BESIDE + 40, "lm"),
    ):
        wide = sorted((outer, inner))
        for metres in _TICKS_M:
            marks.append(LegendMark("line", ((wide[0], row(metres)), (wide[1], row(metres))), BLACK))
            marks.append(text(number, row(metres), f"{metres} m", size=16, anchor=anchor))
        for start, reach, colour in ((4, near.close_m, RED), (18, near.ahead_m, BLUE)):
            left = inner - start - 12 if outer < inner else inner + start
            marks.append(LegendMark("box", ((left, row(reach)), (left + 11, floor - 1)), colour))
    close = f"CLOSE: an obstacle ahead in your lane, nearer than {near.close_m:g} m (red)"
    clear = f"a side is CLEAR if there is a lane and it is empty up to {near.ahead_m:g} m (blue)"
    marks += [
        text(width // 2, floor + 24, close, colour=RED, anchor="mm"),
        text(width // 2, floor + 50, clear, colour=BLUE, anchor="mm"),
    ]
    return View(
        name=name,
        shape=(camera.height, camera.width),
        crop=(0, camera.height, 0, camera.width),
        factor=_FACTOR,
        axis="horizontal",
        above=_ABOVE,
        below=_BELOW,
        ground=(0, 0, 0),
        marks=tuple(marks),
        beside=_BESIDE,
    )


CALIBRATED = "calibrated"
"""A value of ``--view``, like ``none``: the view of the bank's simulator."""

VIEWS: dict[str, View] = {"highway": highway(), **{name: forward(name, one) for name, one in FORWARD.items()}}
"""The calibrated view of each simulator's pictures."""


def view_for(choice: str | None, simulator: str) -> View | None:
    """Return the view for ``--view``, None for ``none``; raises SpecError for an unknown one.

    By default it is the calibrated one, if the simulator's pictures have one.
    """
    if choice == NONE or (choice is None and simulator not in VIEWS):
        return None
    choice = choice or CALIBRATED
    if choice != CALIBRATED:
        raise SpecError(f"--view takes {CALIBRATED} or {NONE}, not '{choice}'")
    if simulator not in VIEWS:
        raise SpecError(
            f"there is no calibrated view of pictures from '{simulator}', only of {', '.join(VIEWS)}; "
            f"use --view {NONE} for the pictures themselves"
        )
    return VIEWS[simulator]


def find_view(key: str) -> View | None:
    """Return the view of a key, None for ``none``; SpecError if it is unknown or has changed."""
    if key == NONE:
        return None
    known = {view.key: view for view in VIEWS.values()}
    if key not in known:
        raise SpecError(f"there is no view '{key}' in this version of eyechart, which has {', '.join(known)}")
    return known[key]


def through(view: View | None, stimulus: Stimulus, name: str = "picture") -> Stimulus:
    """Return a stimulus with its pictures as a view shows them; itself without a view."""
    if view is None:
        return stimulus
    shown = {camera: encode(view.show(decode(image, name), name)) for camera, image in stimulus.images.items()}
    return replace(stimulus, images=shown, past=tuple(through(view, one, name) for one in stimulus.past))


def scene_of(pixels: RGB) -> RGB:
    """Return the picture of a calibrated view; any other pixels are returned unchanged."""
    restored = (view.restore(pixels) for view in VIEWS.values())
    return next((one for one in restored if one is not None), pixels)
