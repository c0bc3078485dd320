"""Drawings: matplotlib figures with a name and a description, written as SVG or PDF."""

import io
import math
import re
import unicodedata
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from html import escape
from itertools import starmap
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import LinearSegmentedColormap, to_rgb
from matplotlib.figure import Figure
from matplotlib.transforms import Affine2D, Bbox
from numpy.typing import NDArray
from PIL import ImageFont

from eyechart.stats.statistic import Statistic

INK = "#1c1f23"
MUTED = "#5a616c"
LINE = "#d9d6cf"
PAPER = "#fefefd"
BLUE = "#0072b2"
VERMILLION = "#d55e00"
GREEN = "#00735a"
SOFT = "#f1efe9"
"""Green is right and vermillion wrong, as on every page.

Blue and vermillion come from Okabe and Ito's palette, which colour-blind people can distinguish;
soft is a quiet ground.
"""

WAYS = {
    "blue": "#015ef7",
    "vermillion": "#d95b0a",
    "green": "#05945c",
    "purple": "#b325b6",
    "amber": "#ae9209",
    "grey": "#6d7581",
}
"""Colours for several crossing lines.

Any two, and ink, lie at least 24 apart in CIELAB, except amber and grey. That holds for normal eyes
and for eyes without one kind of cone (Machado et al. 2009), on light and dark paper.
"""

THEMED = {
    INK: "currentColor",
    MUTED: "var(--muted)",
    LINE: "var(--line)",
    PAPER: "var(--surface)",
    BLUE: "var(--blue)",
    VERMILLION: "var(--vermillion)",
    GREEN: "var(--green)",
    SOFT: "var(--soft)",
    **{colour: f"var(--way-{name})" for name, colour in WAYS.items()},
}
"""The style variable for each colour, which a light or dark page sets."""

_STYLE: Any = {
    "svg.hashsalt": "eyechart",
    "svg.fonttype": "none",
    "pdf.fonttype": 42,
    "text.parse_math": False,
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 9.0,
    "text.color": INK,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.8,
    "axes.unicode_minus": False,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "path.simplify": False,
}
ON_COLOUR = "#000000"
"""Ink on a coloured cell, in light and dark pages."""

_TAG = re.compile(r"<[^>]*>")
_ID = re.compile(r'(\bid="|url\(#|xlink:href="#)')
_LONG, _CLIP = re.compile(r"(\d\.\d)\d+"), re.compile(r' clip-path="[^"]*"')
_LONGEST = 40


@dataclass(frozen=True)
class Drawing:
    """A figure.

    ``name`` is its file's stem and the prefix of every id in it. ``wide`` gives it a row of its
    own. ``of`` is its model, if a section has a figure per model. ``note`` explains it below the
    figure. ``lean`` figures have one decimal, for pages with many.
    """

    name: str
    title: str
    description: str
    figure: Figure
    wide: bool = False
    of: str = ""
    lean: bool = False
    note: str = ""

    def labelled(self, label: str) -> "Drawing":
        """Return the figure under the paper's label, which names its files."""
        return replace(self, name=label.replace(":", "-"))

    def svg(self, *, inline: bool = False) -> str:
        """Return the figure as SVG: a file, or inline in the page's colours."""
        buffer = io.StringIO()
        with style(), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # names may hold characters without glyphs
            nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
            self.figure.savefig(buffer, format="svg", metadata=nothing, transparent=True)
        text = buffer.getvalue()
        text = re.sub(
            r"<defs>\s*<style.*?</style>\s*</defs>\s*", "", text[text.index("<svg") :], count=1, flags=re.DOTALL
        )
        if self.lean:
            text = _CLIP.sub("", _LONG.sub(r"\1", _TAG.sub(lambda tag: " ".join(tag.group().split()), text)))
            text = re.sub(r">\s+<", "><", text)
        text = _TAG.sub(lambda tag: _ID.sub(rf"\g<1>{self.name}-", tag.group()), text)
        return self._opened(_TAG.sub(_theme, text)) if inline else '<?xml version="1.0"?>\n' + self._opened(text)

    def _opened(self, text: str) -> str:
        """Return the SVG with an accessible name and a flexible size."""
        width, height = (72 * float(inches) for inches in self.figure.get_size_inches())
        names = f'role="img" aria-labelledby="{self.name}-title {self.name}-desc"'
        opening = (
            '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '
            f'viewBox="0 0 {width:g} {height:g}" width="{width * 4 / 3:.0f}" height="{height * 4 / 3:.0f}" {names} '
            'stroke-linejoin="round" stroke-linecap="butt">'
            f'<title id="{self.name}-title">{escape(plain(self.title, 400))}</title>'
            f'<desc id="{self.name}-desc">{escape(plain(self.description, 4000))}</desc>'
        )
        return opening + text[text.index(">") + 1 :].rstrip() + "\n"

    def pdf(self) -> bytes:
        """Return the figure as PDF, without a date."""
        buffer = io.BytesIO()
        with style(), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # as above
            self.figure.savefig(buffer, format="pdf", metadata={"CreationDate": None, "Title": plain(self.title, 400)})
        return buffer.getvalue()


def _theme(tag: re.Match[str]) -> str:
    text = tag.group()
    for colour, themed in THEMED.items() if "#" in text else ():
        text = text.replace(colour, themed)
    return text


@contextmanager
def style() -> Iterator[None]:
    """Set the style of figures during the block."""
    with mpl.rc_context(_STYLE):
        yield


def canvas(width: float, height: float, margins: tuple[float, float, float, float]) -> tuple[Figure, Axes]:
    """Return a figure with one axes; size and margins (left, right, bottom, top) in inches."""
    figure = Figure(figsize=(width, height))
    left, right, bottom, top = margins
    box = (left / width, bottom / height, (width - left - right) / width, (height - bottom - top) / height)
    axes = figure.add_axes(box)
    axes.set_facecolor("none")
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    return figure, axes


def plain(text: str, longest: int = _LONGEST) -> str:
    """Return a text for a figure: without control characters, and shortened in the middle."""
    shown = "".join("�" if unicodedata.category(sign) in {"Cc", "Cf", "Cs"} else sign for sign in text)
    if len(shown) <= longest:
        return shown
    half = (longest - 1) // 2
    return f"{shown[:half]}…{shown[-half:]}"


@cache
def font(size: int) -> ImageFont.FreeTypeFont:
    """Return the font of figures."""
    return ImageFont.truetype(Path(mpl.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf", size)


def width_of(text: str, points: float) -> float:
    """Return the width of a text in a figure in inches; a page's fonts are narrower."""
    return font(100).getlength(plain(text, 400)) / 100 * points / 72


def shorten_middle(text: str, inches: float, points: float) -> str:
    """Return a text, shortened in the middle to fit a width in inches."""
    most = len(text)
    while most > 3 and width_of(plain(text, most), points) > inches:
        most -= 1
    return plain(text, most)


_DARK = 0.18
"""White reads better than black below this luminance."""


def luminance(colour: str | tuple[float, float, float, float]) -> float:
    """Return the relative luminance of an sRGB colour, from 0 to 1. Source: WCAG 2."""
    linear = (one / 12.92 if one <= 0.04045 else ((one + 0.055) / 1.055) ** 2.4 for one in to_rgb(colour))
    return sum(weight * one for weight, one in zip((0.2126, 0.7152, 0.0722), linear, strict=True))


Cell = tuple[float | None, str, LinearSegmentedColormap]
"""A share from 0 to 1, or None that has no colour; the words in it; and the colours of shares."""
Frame = tuple[float, float, float, float, str, float]
"""A line around cells: left, top, right and bottom in cells, the colour, and the width in points."""
_PAD, _LARGE = 3.5, 8.5


@dataclass(frozen=True)
class GridLabels:
    """The names of a grid's columns (above) and rows, leaning by ``rotation`` degrees, and what both are."""

    columns: Sequence[str]
    rows: Sequence[str]
    rotation: float = 0
    points: float = _LARGE
    across: str = ""
    down: str = ""


def grid(
    size: tuple[float, float],
    margins: tuple[float, float, float, float],
    cells: Sequence[Sequence[Cell]],
    labels: GridLabels,
    frames: Sequence[Frame] = (),
) -> Figure:
    """Return a grid of coloured cells, row by row; size and margins are those of `canvas`.

    It draws on the figure itself: axes, spines and ticks took two thirds of a page's time with many.
    """
    figure = Figure(figsize=size)
    left, right, bottom, top = margins
    across = (size[0] - left - right) / max(1, len(labels.columns))
    down = (size[1] - bottom - top) / max(1, len(labels.rows))
    inches = figure.dpi_scale_trans
    place = Affine2D().scale(across, -down).translate(left + across / 2, size[1] - top - down / 2) + inches
    boxes = [(x - 0.48, y - 0.47, x + 0.48, y + 0.47) for y, row in enumerate(cells) for x in range(len(row))]
    faces = ["none" if share is None else colours(share) for row in cells for share, _, colours in row]
    how: dict[str, Any] = {"facecolors": faces, "edgecolors": LINE, "linewidths": 0.6}
    figure.add_artist(PolyCollection(list(starmap(_corners, boxes)), transform=place, zorder=1, **how))
    how = {"facecolors": "none", "edgecolors": [one[4] for one in frames], "linewidths": [one[5] for one in frames]}
    corners = [_corners(*one[:4]) for one in frames]
    figure.add_artist(PolyCollection(corners, transform=place, zorder=5, **how))
    for y, row in enumerate(cells):
        for x, (share, words, colours) in enumerate(row):
            ink = MUTED if share is None else "#ffffff" if luminance(colours(share)) < _DARK else ON_COLOUR
            if words:
                figure.text(x, y, words, ha="center", va="center", color=ink, fontsize=8, transform=place)
    _name_grid(figure, labels, (left, size[1] - top), (across, down))
    return figure


def _corners(left: float, top: float, right: float, bottom: float) -> list[tuple[float, float]]:
    return [(left, top), (right, top), (right, bottom), (left, bottom)]


def _name_grid(figure: Figure, labels: GridLabels, corner: tuple[float, float], cell: tuple[float, float]) -> None:
    """Write the names around a grid whose upper left corner, and the size of whose cells, are in inches."""
    (left, top), (across, down), pad = corner, cell, _PAD / 72
    how: dict[str, Any] = {"transform": figure.dpi_scale_trans, "color": INK}
    turned: dict[str, Any] = {**how, "rotation": labels.rotation, "ha": "left" if labels.rotation else "center"}
    turned |= {"va": "bottom", "rotation_mode": "anchor", "fontsize": labels.points}
    for x, name in enumerate(labels.columns):
        figure.text(left + (x + 0.5) * across, top + pad, name, **turned)
    for y, name in enumerate(labels.rows):
        at = top - (y + 0.5) * down
        figure.text(left - pad, at, name, ha="right", va="center_baseline", fontsize=_LARGE, **how)
    how |= {"color": MUTED, "fontsize": _LARGE, "ha": "center", "va": "bottom", "rotation_mode": "anchor"}
    if labels.across:
        lean = math.radians(labels.rotation)
        wide = max((width_of(name, labels.points) for name in labels.columns), default=0.0) if lean else 0.0
        above = top + pad + wide * math.sin(lean) + labels.points * math.cos(lean) / 72 + 0.03
        figure.text(left + across * len(labels.columns) / 2, above, labels.across, **how)
    if labels.down:
        aside = left - pad - max((width_of(name, _LARGE) for name in labels.rows), default=0.0) - 0.06
        figure.text(aside, top - down * len(labels.rows) / 2, labels.down, rotation=90, **how)


def room(labels: Sequence[str]) -> float:
    """Return the margin in inches that the longest model name needs."""
    return 0.3 + 0.068 * max([12, *(len(plain(label, 34)) for label in labels)])


Box = tuple[float, float, float, float]
"""Left, bottom, right and top, in pixels."""


WIDE, HEAD = 3.4, 1.9
"""Width in inches of the values: in a figure of its own, and at the head of a page."""


def dots(
    rows: Sequence[tuple[str, Statistic, str, bool]],
    x_name: str,
    scale: float,
    *,
    zero: bool = False,
    across: float = WIDE,
) -> Figure:
    """Return named statistics as coloured dots with intervals; ``zero`` draws a line at 0."""
    left = room([label for label, *_ in rows])
    figure, axes = canvas(left + across, 0.7 + 0.27 * len(rows), (left, 0.2, 0.5, 0.05))
    if zero:
        axes.axvline(0, color=INK, linewidth=0.9, zorder=1)
    for y, (_, one, colour, hollow) in enumerate(rows):
        axes.axhline(y, color=LINE, linewidth=0.6, zorder=0)
        if one.ci is not None and one.value is not None:
            axes.plot([scale * end for end in one.ci], [y, y], color=colour, lw=1.6, solid_capstyle="butt", zorder=2)
        if one.value is not None:
            face = PAPER if hollow else colour
            axes.scatter([scale * one.value], [y], s=34, facecolors=face, edgecolors=colour, linewidths=1.4, zorder=3)
    named_rows(axes, [label for label, *_ in rows], 0.5)
    axes.set_xlabel(x_name, fontsize=8.5)
    return figure


def panels(pictures: Mapping[str, NDArray[np.uint8]], width: float) -> Figure:
    """Return titled pictures (h, w, 3) side by side at equal widths; width in inches."""
    gap, above = 0.08, 0.22
    each = (width - gap * (len(pictures) - 1)) / len(pictures)
    tall = max(each * picture.shape[0] / picture.shape[1] for picture in pictures.values())
    figure = Figure(figsize=(width, tall + above))
    for place, (words, one) in enumerate(pictures.items()):
        high = each * one.shape[0] / one.shape[1]
        bottom = (tall - high) / 2
        box = (place * (each + gap) / width, bottom / (tall + above), each / width, high / (tall + above))
        axes = figure.add_axes(box)
        axes.imshow(one, interpolation="none", aspect="auto")
        axes.set_axis_off()
        axes.set_title(words, fontsize=7, pad=3)
    return figure


def named_rows(axes: Axes, labels: Sequence[str], below: float) -> None:
    """Name rows from the top, with the space ``below`` under the last."""
    axes.set_ylim(max(1, len(labels)) - below, -0.5 if below == 0.5 else -0.6)
    axes.set_yticks(range(len(labels)), [plain(label, 34) for label in labels])
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)


def scattered(points: Sequence[tuple[str, float, float]], x_name: str, y_name: str, corner: str) -> Figure:
    """Return named points, on axes to at least 1 and 0.25 bit, with words in a ``corner``."""
    figure, axes = canvas(5.5, 4.0, (0.65, 0.2, 0.6, 0.2))
    right = max([1.0, *(x for _, x, _ in points)]) * 1.3
    top = max([0.25, *(y for _, _, y in points)]) * 1.15
    axes.set_xlim(-0.03 * right, right)
    axes.set_ylim(-0.05 * top, top)
    axes.grid(color=LINE, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.set_xlabel(x_name)
    axes.set_ylabel(y_name)
    axes.text(right * 0.99, -0.035 * top, corner, ha="right", fontsize=8, style="italic", color=MUTED)
    _name_points(axes, points)
    return figure


def _name_points(axes: Axes, points: Sequence[tuple[str, float, float]]) -> None:
    """Draw the points, each with its name at the nearest free place."""
    inverse = axes.transData.inverted()
    taken: list[Box] = []
    seen = sorted(points, key=lambda point: (point[1], point[2], point[0]))
    pixels = [axes.transData.transform((x, y)) for _, x, y in seen]
    taken += [(float(x) - 4, float(y) - 4, float(x) + 4, float(y) + 4) for x, y in pixels]
    bounds = axes.get_window_extent()
    for (name, x, y), (px, py) in zip(seen, pixels, strict=True):
        label = plain(name, 30)
        axes.scatter([x], [y], s=34, color=BLUE, edgecolors=PAPER, linewidths=0.8, zorder=3)
        wide = 6.2 * len(label)
        box, side = next(
            (spot for spot in _spots(float(px), float(py), wide) if _is_free(spot[0], bounds, taken)),
            next(_spots(float(px), float(py), wide)),
        )
        taken.append(box)
        near, middle = box[0] if side == "left" else box[2], (box[1] + box[3]) / 2
        tx, ty = inverse.transform((near, middle))
        axes.text(tx, ty, label, fontsize=8, ha=side, va="center", zorder=4)
        if abs(middle - py) > 8 or abs(near - px) > 12:
            axes.plot([x, tx], [y, ty], color=MUTED, linewidth=0.5, zorder=2)


def _spots(px: float, py: float, wide: float) -> Iterator[tuple[Box, str]]:
    """Yield boxes for a name beside a point, nearest first, with the aligned end of the name."""
    for up in (0, 14, -14, 28, -28, *range(42, 300, 14)):
        for away in (9, 34, 80):
            yield (px + away, py + up - 7, px + away + wide, py + up + 7), "left"
            yield (px - away - wide, py + up - 7, px - away, py + up + 7), "right"


def _is_free(box: Box, bounds: Bbox, taken: Sequence[Box]) -> bool:
    inside = box[0] > bounds.x0 and box[2] < bounds.x1 + 12 and box[1] > bounds.y0 and box[3] < bounds.y1
    return inside and not any(
        box[0] < other[2] and other[0] < box[2] and box[1] < other[3] and other[1] < box[3] for other in taken
    )
