"""Draw the two sheets of docs/edited-pictures.md: photographs with their edits, and those that are refused.

Usage: python docs/make_edited_sheets.py docs/photographs docs/images
"""

import json
import sys
import tempfile
from pathlib import Path

from PIL import Image

from eyechart.edits import EditSource, Moves, edit_photographs, read_format
from eyechart.frames import decode, read_bounded
from eyechart.report.contact_sheet import SheetCell, draw_sheet, small

WORK = ("000000", "000018", "000021", "000038", "000042", "000046")
REFUSED = ("000060", "000061", "000062", "000063", "000064", "000065")
BY_EYE = ("000065", "000066", "000067")
SHOWN = ("lead_near", "lead_far", "exchange_own", "lead_absent", "patched")
MOVES = Moves((5, 8), (30, 45), lane_m=3.5, eye_m=1.65, shadow=0.4)
CELL_PX = 210


def edited(folder: Path, table: str, out: Path) -> dict[str, str]:
    """Edit the photographs of a table; return why each was refused, by its name."""
    found = read_format("kitti", folder / "image_2", folder / "label_2", folder / table)
    source = EditSource(folder / "image_2", found, folder / "label_2", cut="box", finds_leads=True)
    edit_photographs(source, MOVES, out)
    refused = json.loads((out / "edit.json").read_text())["refused"]
    return {one["file"].partition(".")[0]: one["reason"] for one in reversed(refused)}


def row_of(folder: Path, name: str) -> list[SheetCell]:
    """Return a photograph as taken, and the control pictures that were made of it."""
    taken = decode(read_bounded(folder, f"taken/{name}.webp"), name)
    row = [SheetCell((f"{name}: as taken",), small(taken, CELL_PX))]
    for kind in SHOWN:
        file = f"{kind}/{name}.webp.png"
        if (folder / file).is_file():
            row.append(SheetCell((kind,), small(decode(read_bounded(folder, file), name), CELL_PX)))
    return row


def main(folder: Path, images: Path) -> None:
    """Write edited-pictures.jpg, refused-pictures.jpg and thrown-out-pictures.jpg."""
    with tempfile.TemporaryDirectory() as work:
        edited(folder, "photos.csv", Path(work) / "photos")
        edited(folder, "odd.csv", Path(work) / "odd")
        sheets = {
            "edited-pictures": [row_of(Path(work) / "photos", name) for name in WORK],
            "refused-pictures": [
                [row_of(Path(work) / "odd", name)[0] for name in REFUSED[start : start + 3]] for start in (0, 3)
            ],
            "thrown-out-pictures": [row_of(Path(work) / "odd", name) for name in BY_EYE],
        }
        for name, rows in sheets.items():
            drawn = Path(work) / f"{name}.png"
            draw_sheet(rows, drawn, cell_px=CELL_PX)
            with Image.open(drawn) as sheet:
                sheet.convert("RGB").save(images / f"{name}.jpg", quality=82)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
