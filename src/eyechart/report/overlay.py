"""A controller's plan as lines over a camera's picture, for people, not for models."""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw

from eyechart.episodes import Step
from eyechart.simulators import Sketch

CASING = "#14171b"
_FINER = 3
"""Lines are drawn at this multiple of the size and scaled down, to be smooth."""


@dataclass(frozen=True)
class Stroke:
    """The style of one line: ``width`` in film pixels, ``dots`` on its points, or ``dashed``."""

    name: str
    says: str
    colour: str
    width: float
    dashed: bool = False
    dots: bool = False


STROKES = (
    Stroke("target", "target track", "#f5d547", 2.0, dashed=True),
    Stroke("driven", "driven until the next decision", "#ffffff", 2.5),
    Stroke("plan", "plan, 8 × 0.2 s", "#56b4e9", 3.5, dots=True),
)
"""In drawing order.

All colours but white are from Okabe and Ito's palette, and differ from the road's grey and the
obstacles' paints.
"""


def over(picture: Image.Image, sketch: Sketch, scale: int) -> Image.Image:
    """Return a picture, ``scale`` times the camera's, with a sketch over it, as a copy."""
    layer = Image.new("RGBA", (picture.width * _FINER, picture.height * _FINER), (0, 0, 0, 0))
    pen = ImageDraw.Draw(layer)
    for stroke in STROKES:
        for piece in pieces(getattr(sketch, stroke.name)):
            _draw(pen, [(x * scale * _FINER, y * scale * _FINER) for x, y in piece], stroke)
    smooth = layer.resize(picture.size, Image.Resampling.LANCZOS)
    return Image.alpha_composite(picture.convert("RGBA"), smooth).convert("RGB")


def pieces(line: npt.NDArray[np.float64]) -> list[list[tuple[float, float]]]:
    """Return the parts of a line before the camera, as points in pixels, to a tenth."""
    found: list[list[tuple[float, float]]] = [[]]
    for x, y in np.round(line, 1).tolist():
        if math.isnan(x):
            found.append([])
        else:
            found[-1].append((x, y))
    return [piece for piece in found if piece]


def plan_words(sketch: Sketch | None, step: Step | None) -> str:
    """Return the controller's target and its solver's success in words; empty without them."""
    if sketch is None or step is None:
        return ""
    plans, failed = step.facts.get("plans"), step.facts.get("solver_failures")
    flag = step.facts.get("solver_flag")
    if not isinstance(plans, int) or not isinstance(failed, int):
        return f"controller: {sketch.words}"
    solver = f"solver failed at {failed} of {plans} plans and braked" if failed else f"{plans} of {plans} plans solved"
    return f"controller: {sketch.words} · {solver} (flag {flag})"


def _draw(pen: ImageDraw.ImageDraw, places: Sequence[tuple[float, float]], stroke: Stroke) -> None:
    width = round(stroke.width * _FINER)
    parts = list(_dashes(places, 9.0 * _FINER)) if stroke.dashed else [list(places)]
    for colour, wider in ((CASING, 2 * _FINER), (stroke.colour, 0)):
        for part in parts:
            if len(part) > 1:
                pen.line(part, fill=colour, width=width + wider, joint="curve")
        if stroke.dots:
            for x, y in places:
                reach = (width + wider) * 0.95
                pen.ellipse((x - reach, y - reach, x + reach, y + reach), fill=colour)


def _dashes(places: Sequence[tuple[float, float]], long: float) -> Iterator[list[tuple[float, float]]]:
    """Yield every other stretch of a line; each is ``long`` pixels."""
    gone, part, drawn = 0.0, list(places[:1]), True
    for (x, y), (to_x, to_y) in itertools.pairwise(places):
        length = math.hypot(to_x - x, to_y - y)
        done = 0.0
        while length - done > long - gone:
            done += long - gone
            at = (x + (to_x - x) * done / length, y + (to_y - y) * done / length)
            if drawn:
                yield [*part, at]
            gone, part, drawn = 0.0, [at], not drawn
        gone += length - done
        part.append((to_x, to_y))
    if drawn:
        yield part
