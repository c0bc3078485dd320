"""A contact sheet: one row per episode, each frame with its gap and demand.

Several cameras stand side by side. A frame for policies also has its instruction, state and motion.
One frame alone is shown as it is, reflected, or in the calibrated view.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from eyechart.conditions import CONTROLS, flip
from eyechart.destination import whole
from eyechart.errors import BankError
from eyechart.frames import EXCHANGE, RGB, Frame, FrameBank, decode
from eyechart.perception.view import CALIBRATED, view_for

_Font = ImageFont.FreeTypeFont | ImageFont.ImageFont
_CELL_PX = 300
_CAPTION_PX = 18
_MARGIN_PX = 6
_MOST_PX = 30_000


def contact_sheet(bank: FrameBank, out: Path, *, counterfactual: str | None = None, columns: int | None = None) -> None:
    """Write a PNG of all frames of a bank, or of one counterfactual of the frames that have it.

    ``columns`` defaults to the longest episode, at most 12. Raises BankError if no frame has the
    counterfactual, or the sheet is too large for a PNG viewer.
    """
    frames = [frame for frame in bank if counterfactual is None or counterfactual in frame.counterfactuals]
    if not frames:
        raise BankError(f"no frame of {bank.root} has a counterfactual picture '{counterfactual}'")
    has_motion = bank.manifest.motion is not None
    cells = [
        [
            SheetCell(
                (_caption(frame, bank, counterfactual), *(_policy_lines(frame) if has_motion else ())),
                small(_pixels(bank, frame, counterfactual), _CELL_PX),
            )
            for frame in row
        ]
        for row in _rows(frames, columns)
    ]
    draw_sheet(cells, out)


class SheetCell(NamedTuple):
    """A picture (h, w, 3) of a sheet, with the lines above it; each is cut to the picture's width."""

    lines: tuple[str, ...]
    picture: RGB


def small(pixels: RGB, width: int) -> RGB:
    """Return a picture (h, w, 3) at this width, with its shape kept."""
    picture = Image.fromarray(np.ascontiguousarray(pixels))
    return np.asarray(picture.resize((width, max(1, round(picture.height * width / picture.width)))), np.uint8)


def draw_sheet(rows: Sequence[Sequence[SheetCell]], out: Path, *, cell_px: int = _CELL_PX) -> None:
    """Write rows of pictures as one PNG, all as wide as ``cell_px`` and as high as the first.

    Raises BankError if it is too large for a PNG viewer.
    """
    first = rows[0][0].picture
    height = max(1, round(first.shape[0] * cell_px / first.shape[1]))
    caption = _CAPTION_PX * max(len(cell.lines) for row in rows for cell in row)
    step = height + caption + _MARGIN_PX
    width = _MARGIN_PX + max(len(row) for row in rows) * (cell_px + _MARGIN_PX)
    if len(rows) * step > _MOST_PX:
        raise BankError(f"a sheet of {sum(map(len, rows))} frames is too tall; show fewer with --limit")
    sheet = Image.new("RGB", (width, _MARGIN_PX + len(rows) * step), "white")
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(12)
    for y, row in enumerate(rows):
        for x, cell in enumerate(row):
            left, top = _MARGIN_PX + x * (cell_px + _MARGIN_PX), _MARGIN_PX + y * step
            for number, line in enumerate(cell.lines):
                words = _cut(line, draw, font, cell_px)
                draw.text((left, top + number * _CAPTION_PX), words, fill="black", font=font)
            sheet.paste(Image.fromarray(cell.picture).resize((cell_px, height)), (left, top + caption))
    _save(sheet, out)


def write_frame(
    bank: FrameBank,
    frame: Frame,
    out: Path,
    *,
    counterfactual: str | None = None,
    view: bool = False,
    mirrored: bool = False,
) -> None:
    """Write one frame's pictures, or their reflection, side by side as PNG.

    With ``view`` it is the first camera in its simulator's calibrated view. Raises BankError if
    there is no such picture, and SpecError if there is no such view or mirror axis.
    """
    shown = view_for(CALIBRATED, bank.manifest.simulator) if view else None
    if shown is None:
        pixels = _pixels(bank, frame, counterfactual, mirrored=mirrored)
    else:
        first = decode(bank.image(frame, counterfactual), frame.file)
        pixels = shown.show(flip(first, frame.mirror_axis) if mirrored else first, frame.file)
    _save(Image.fromarray(np.ascontiguousarray(pixels)), out)


def _pixels(bank: FrameBank, frame: Frame, counterfactual: str | None, *, mirrored: bool = False) -> RGB:
    """Return all cameras' pictures of a frame, or their reflections, at the first's height."""
    images = bank.images(frame, counterfactual)
    seen = {name: decode(image, frame.pictures[name]) for name, image in images.items()}
    if mirrored:
        cameras = [camera for camera in frame.cameras if camera.name in seen]
        sources = {camera.name: camera.mirrors if camera.mirrors in seen else camera.name for camera in cameras}
        axes = {camera.name: camera.mirror_axis for camera in frame.cameras}
        seen = {name: flip(seen[source], axes[source]) for name, source in sources.items()}
    first, *others = seen.values()
    high = first.shape[0]
    scaled = [Image.fromarray(np.ascontiguousarray(one)) for one in others]
    more = [np.asarray(one.resize((max(1, round(one.width * high / one.height)), high))) for one in scaled]
    return np.concatenate([first, *more], axis=1) if more else first


def _policy_lines(frame: Frame) -> tuple[str, str]:
    """Return a policy's input of a frame, and the first and last step of its logged motion."""
    said = "; ".join(map(str, frame.fields.values())) or "no instruction"
    state = "; ".join(f"{name} {_numbers(numbers)}" for name, numbers in frame.state.items()) or "no state"
    ends = (frame.motion[0], frame.motion[-1]) if frame.motion else ()
    motion = " … ".join(map(_numbers, ends)) or "no logged motion"
    return f"{said}, {state}", f"motion {motion}"


def _numbers(numbers: tuple[float, ...]) -> str:
    return " ".join(f"{number:.2g}" for number in numbers)


def _cut(line: str, draw: ImageDraw.ImageDraw, font: _Font, width: int) -> str:
    """Return as much of a line as fits above one picture of this width."""
    kept = len(line)
    while kept > 1 and draw.textlength(line[:kept], font=font) > width:
        kept -= 1
    return line if kept == len(line) else f"{line[: kept - 1]}…"


def _save(picture: Image.Image, out: Path) -> None:
    with whole(out, "picture") as partial:
        picture.save(partial, "PNG")


def _rows(frames: list[Frame], columns: int | None) -> list[list[Frame]]:
    episodes: dict[str, list[Frame]] = {}
    for frame in frames:
        episodes.setdefault(frame.episode, []).append(frame)
    wide = columns or min(12, max(len(episode) for episode in episodes.values()))
    return [episode[at : at + wide] for episode in episodes.values() for at in range(0, len(episode), wide)]


_PLACED = {
    "lane_own": "lane_near_m",
    "lane_beside": "lane_far_m",
    "exchange_own": EXCHANGE,
    "exchange_beside": EXCHANGE,
}
"""The columns with the distance of a control's vehicle, if they do not have its name."""


def _caption(frame: Frame, bank: FrameBank, shown: str | None) -> str:
    """Return a frame's id, the gap in its picture if known, and its demand."""
    words = [frame.id]
    gap = bank.manifest.gap
    placed = _PLACED.get(str(shown), f"{shown}_m")
    if shown in CONTROLS:
        words += [f"{value:.1f}" for value in [frame.truth.get(placed)] if isinstance(value, float)]
    elif gap is not None and gap.column in frame.truth:
        value = frame.truth[gap.column]
        words.append("no lead" if value is None else f"{value:.1f} {gap.unit}")
    if "demand" in frame.truth:
        words.append(str(frame.truth["demand"]))
    if frame.truth.get("crashed"):
        words.append("crashed")
    return "  ".join(words)
