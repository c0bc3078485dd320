"""A contact sheet shows a bank at a glance: one row an episode, each frame with its gap and what it demands.

One frame alone is shown as it is, reflected, or in the calibrated view.
"""

from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from eyechart.conditions import CONTROLS, flip
from eyechart.destination import whole
from eyechart.errors import BankError
from eyechart.frames import Frame, FrameBank, decode
from eyechart.perception.view import CALIBRATED, view_for

_CELL_PX = 300
_CAPTION_PX = 18
_MARGIN_PX = 6
_MOST_PX = 30_000


def contact_sheet(bank: FrameBank, out: Path, *, counterfactual: str | None = None, columns: int | None = None) -> None:
    """Write a PNG with every frame of a bank, or with one of its counterfactuals where frames have it.

    ``columns`` defaults to the longest episode, at most 12. Raises BankError where no frame has the
    counterfactual, or the sheet would be larger than a PNG viewer bears.
    """
    frames = [frame for frame in bank if counterfactual is None or counterfactual in frame.counterfactuals]
    if not frames:
        raise BankError(f"no frame of {bank.root} has a counterfactual picture '{counterfactual}'")
    rows = _rows(frames, columns)
    first = decode(bank.image(frames[0], counterfactual), frames[0].file)
    height = max(1, round(first.shape[0] * _CELL_PX / first.shape[1]))
    step = height + _CAPTION_PX + _MARGIN_PX
    width = _MARGIN_PX + max(len(row) for row in rows) * (_CELL_PX + _MARGIN_PX)
    if len(rows) * step > _MOST_PX:
        raise BankError(f"a sheet of {len(frames)} frames is too tall; show fewer with --limit")
    sheet = Image.new("RGB", (width, _MARGIN_PX + len(rows) * step), "white")
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(12)
    for y, row in enumerate(rows):
        for x, frame in enumerate(row):
            pixels = np.ascontiguousarray(decode(bank.image(frame, counterfactual), frame.file))
            left, top = _MARGIN_PX + x * (_CELL_PX + _MARGIN_PX), _MARGIN_PX + y * step
            draw.text((left, top), _caption(frame, bank, counterfactual), fill="black", font=font)
            sheet.paste(Image.fromarray(pixels).resize((_CELL_PX, height)), (left, top + _CAPTION_PX))
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
    """Write one frame's picture as PNG, or its reflection, as it is or in its simulator's calibrated view.

    Raises BankError where there is no such picture, SpecError where there is no such view or mirror axis.
    """
    pixels = decode(bank.image(frame, counterfactual), frame.file)
    shown = view_for(CALIBRATED, bank.manifest.simulator) if view else None
    if mirrored:
        pixels = flip(pixels, frame.mirror_axis)
    if shown is not None:
        pixels = shown.show(pixels, frame.file)
    _save(Image.fromarray(np.ascontiguousarray(pixels)), out)


def _save(picture: Image.Image, out: Path) -> None:
    with whole(out, "picture") as partial:
        picture.save(partial, "PNG")


def _rows(frames: list[Frame], columns: int | None) -> list[list[Frame]]:
    episodes: dict[str, list[Frame]] = {}
    for frame in frames:
        episodes.setdefault(frame.episode, []).append(frame)
    wide = columns or min(12, max(len(episode) for episode in episodes.values()))
    return [episode[at : at + wide] for episode in episodes.values() for at in range(0, len(episode), wide)]


def _caption(frame: Frame, bank: FrameBank, shown: str | None) -> str:
    """Return a frame's id, the gap that its picture shows as far as the bank knows it, and what it demands."""
    words = [frame.id]
    gap = bank.manifest.gap
    placed = {"lane_own": "lane_near_m", "lane_beside": "lane_far_m"}.get(str(shown), f"{shown}_m")
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
