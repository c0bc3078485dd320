"""Draw the README's picture: one frame under every condition, and what six controllers answer to it.

Usage: python docs/make_pictures.py BANK OUT.png
"""

import asyncio
import sys
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

from eyechart.calls import Query
from eyechart.conditions import CONDITIONS, OF_BANKS, show
from eyechart.frames import MAIN, Frame, FrameBank, Stimulus, decode, open_bank
from eyechart.models import open_model
from eyechart.spaces.discrete import DRIVING

CONTROLLERS = ("constant", "presence", "scene_only", "crash_colour", "depth", "depth_lateral")
CELL, PICTURE_W, PICTURE_H, LABEL_W, ROW, TOP = 104, 400, 100, 132, 112, 40
INK, SOFT, SAME, OTHER = "#1b1f24", "#57606a", "#eaeef2", "#ffd8a8"


def chosen(bank: FrameBank) -> Frame:
    """Return the first frame of the middle distance that demands LEFT and has every counterfactual."""
    return next(
        frame
        for frame in bank
        if frame.truth["demand"] == "LEFT" and frame.scenario == "light" and len(frame.counterfactuals) == 3
    )


def answer(controller: str, picture: bytes | None) -> str:
    """Return a controller's decision on a picture."""
    reply = asyncio.run(open_model(f"scripted:{controller}").answer(Query("", "", Stimulus.of(picture), 0)))
    decision = DRIVING.read(reply)
    return decision.action or str(decision.missing)


def draw(bank: FrameBank, out: Path) -> None:
    """Write the picture: a row a condition; answers that differ from the real frame's are tinted."""
    frame, big, small = chosen(bank), ImageFont.load_default(15), ImageFont.load_default(13)
    width = LABEL_W + PICTURE_W + 16 + CELL * len(CONTROLLERS)
    shown = [CONDITIONS[name] for name in OF_BANKS if "text" not in CONDITIONS[name].needs]
    sheet = Image.new("RGB", (width, TOP + ROW * len(shown) + 6), "white")
    pen = ImageDraw.Draw(sheet)
    for column, name in enumerate(CONTROLLERS):
        pen.text((LABEL_W + PICTURE_W + 16 + column * CELL + CELL / 2, TOP / 2), name, INK, small, anchor="mm")
    real = {name: answer(name, show("real", frame, bank, 0).images.get(MAIN)) for name in CONTROLLERS}
    for row, condition in enumerate(shown):
        top, picture = TOP + row * ROW, show(condition.name, frame, bank, 0).images.get(MAIN)
        pen.text((8, top + PICTURE_H / 2), condition.name, INK, big, anchor="lm")
        if picture is None:
            pen.rectangle((LABEL_W, top, LABEL_W + PICTURE_W, top + PICTURE_H), "white", SOFT)
            pen.text((LABEL_W + PICTURE_W / 2, top + PICTURE_H / 2), "(no picture)", SOFT, small, anchor="mm")
        else:
            pixels = Image.fromarray(decode(picture, condition.name)).resize((PICTURE_W, PICTURE_H))
            sheet.paste(pixels, (LABEL_W, top))
        for column, name in enumerate(CONTROLLERS):
            left, given = LABEL_W + PICTURE_W + 16 + column * CELL, answer(name, picture)
            pen.rounded_rectangle(
                (left + 3, top + 30, left + CELL - 3, top + 70), 6, SAME if given == real[name] else OTHER
            )
            pen.text((left + CELL / 2, top + PICTURE_H / 2), given, INK, small, anchor="mm")
    out.parent.mkdir(parents=True, exist_ok=True)
    sheet.quantize(128).save(out, optimize=True)


if __name__ == "__main__":
    draw(open_bank(Path(sys.argv[1])), Path(sys.argv[2]))
