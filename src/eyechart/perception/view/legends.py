"""The calibrated views of our worlds: rulers and legends for the highway seen from above, and for a forward camera.

At both sides of a forward camera's picture of a flat road, rulers say how far away the ground is.
"""

from eyechart.cameras import ForwardView
from eyechart.perception.view.drawing import BLACK, BLUE, GREY, RED, Colour, Mark, View, arrow, text
from eyechart.spaces.scene import CLEAR_AHEAD_M, CLEAR_BEHIND_M, CLOSE_GAP_M

_EGO_BODY, _EGO_OUTLINE = (50, 200, 0), (60, 60, 60)


def _car(x: int, y: int, *, body: Colour) -> tuple[Mark, Mark]:
    """Return the picture of a car as highway-env draws it, enlarged twice, its left middle at (x, y)."""
    outline = Mark("box", ((x, y - 11), (x + 53, y + 10)), _EGO_OUTLINE)
    return outline, Mark("box", ((x + 2, y - 9), (x + 51, y + 8)), body)


def highway() -> View:
    """Return the view of highway-env's picture: from 17 m behind to 76 m ahead, 10 m to either side."""
    factor, crop, above, below = 2, (20, 130, 88, 600), 84, 124
    zero, px_per_m = 183, 11  # the middle of the car as it is drawn, and the length of a metre, in the view
    floor = above + factor * (crop[1] - crop[0])

    def at(metres: float) -> int:
        return zero + round(px_per_m * metres)

    legend = (
        text(12, 22, "LEFT side: the lane above you", size=20, colour=BLUE),
        arrow(308, 13, 0, -1, BLUE),
        *_car(374, 22, body=_EGO_BODY),
        text(438, 22, "= YOU (red after a crash), at 0 m, driving", size=20),
        Mark("line", ((822, 22), (870, 22)), BLACK, size=4),
        arrow(884, 22, 1, 0, BLACK),
        text(438, 52, "dashed line: a lane beyond it; solid line: edge of the road", size=18, colour=GREY),
        text(zero, 58, "YOU", size=20, anchor="mm"),
        arrow(zero, above - 2, 0, 1, BLACK),
        text(12, floor + 108, "RIGHT side: the lane below you", size=20, colour=BLUE),
        arrow(320, floor + 117, 0, 1, BLUE),
    )
    ruler: list[Mark] = [
        arrow(zero, floor + 2, 0, -1, BLACK),
        Mark("line", ((0, floor + 22), (1023, floor + 22)), BLACK),
    ]
    for metres in range(-10, 71, 10):
        ruler += (
            Mark("line", ((at(metres), above - 8), (at(metres), above)), BLACK),
            Mark("line", ((at(metres), floor + 14), (at(metres), floor + 22)), BLACK),
            text(at(metres), floor + 33, f"{metres} m", size=16, anchor="mm"),
        )
    close = f"CLOSE: a car ahead in your lane, its middle nearer than {CLOSE_GAP_M:g} m"
    zones = (
        Mark("box", ((at(0), floor + 46), (at(CLOSE_GAP_M), floor + 62)), RED),
        text(at(CLOSE_GAP_M) + 8, floor + 54, close, colour=RED),
        Mark("box", ((at(-CLEAR_BEHIND_M), floor + 72), (at(CLEAR_AHEAD_M), floor + 88)), BLUE),
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
    """Return the view of a forward camera's pictures: all of the picture, its own ground's distances beside it."""
    width, floor = camera.width * _FACTOR + 2 * _BESIDE, _ABOVE + camera.height * _FACTOR
    near = camera.distances

    def row(metres: float) -> int:
        """Return the row of the view in which the ground lies so far ahead."""
        return _ABOVE + round(_FACTOR * (camera.horizon + camera.focal_px * camera.eye_m / metres))

    marks: list[Mark] = [
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
            marks.append(Mark("line", ((wide[0], row(metres)), (wide[1], row(metres))), BLACK))
            marks.append(text(number, row(metres), f"{metres} m", size=16, anchor=anchor))
        for start, reach, colour in ((4, near.close_m, RED), (18, near.ahead_m, BLUE)):
            left = inner - start - 12 if outer < inner else inner + start
            marks.append(Mark("box", ((left, row(reach)), (left + 11, floor - 1)), colour))
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
