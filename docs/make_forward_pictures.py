"""Draw the pictures of docs/simulators.md: a simulator's five families, and one moment under its conditions.

Usage: python docs/make_forward_pictures.py rover|drone OUT.png
"""

import sys
import tempfile
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

from eyechart.conditions import show
from eyechart.frames import MAIN, Frame, FrameBank, decode
from eyechart.simulators import open_simulator

WIDTH, LABEL, GAP = 200, 22, 6
SHOWN = ("real", "lead_near", "lead_far", "recoloured", "mirrored")


def draw(bank: FrameBank, out: Path) -> None:
    """Write a row of the families and a row of the conditions."""
    families = [next(one for one in frames if one.truth["demand"] == "RIGHT") for frames in bank.scenarios.values()]
    chosen = families[2]
    rows = [
        [(frame.scenario, frame, "real") for frame in families],
        [(f"{chosen.scenario}, {name}", chosen, name) for name in SHOWN],
    ]
    high = _picture(chosen, bank, "real").height
    sheet = Image.new("RGB", (len(SHOWN) * (WIDTH + GAP) - GAP, 2 * (high + LABEL)), "white")
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(14)
    for row, cells in enumerate(rows):
        for column, (label, frame, condition) in enumerate(cells):
            left, top = column * (WIDTH + GAP), row * (high + LABEL)
            pen.text((left, top + 2), label, "#1b1f24", font)
            sheet.paste(_picture(frame, bank, condition), (left, top + LABEL))
    sheet.save(out, optimize=True)


def _picture(frame: Frame, bank: FrameBank, condition: str) -> Image.Image:
    shown = show(condition, frame, bank, 0).images[MAIN]
    picture = Image.fromarray(decode(shown, frame.id).copy())
    return picture.resize((WIDTH, WIDTH * picture.height // picture.width))


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        draw(open_simulator(sys.argv[1]).build(Path(folder) / "bank", seeds=(0,)), Path(sys.argv[2]))
