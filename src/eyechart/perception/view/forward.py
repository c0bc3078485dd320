"""The calibrated view of a forward camera over a flat road: rulers at both sides say how far away the ground is."""

from eyechart.cameras import ForwardView
from eyechart.perception.view.drawing import BLACK, BLUE, GREY, RED, Mark, View, arrow, text

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
