"""The sheet of an edit, at which a person looks before anything is asked: a row a photograph."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from eyechart.edits.annotations import Photo
from eyechart.edits.controls import EVERY, PICTURES, Edit
from eyechart.edits.geometry import grown
from eyechart.edits.scene import EditScene
from eyechart.frames import EXCHANGE, LEAD, RGB
from eyechart.report.contact_sheet import SheetCell, draw_sheet, small

ROWS = 40
"""The photographs of one sheet; more are on further sheets."""

_CELL_PX = 260
_RED, _BLUE, _YELLOW = (255, 0, 0), (0, 0, 255), (255, 255, 0)
_METRES = {"lead_near": "lead_near_m", "lead_far": "lead_far_m", "lead_drawn": LEAD, "exchange_own": EXCHANGE}
_GREY = 200


@dataclass
class Sheets:
    """Sheets in a folder: ``sheet.png``, then ``sheet-2.png`` and so on."""

    folder: Path
    _rows: list[list[SheetCell]] = field(default_factory=list)
    _files: list[Path] = field(default_factory=list)

    def add(self, photo: Photo, pixels: RGB, scene: EditScene | None, made: Edit, reasons: list[str]) -> None:
        """Add a photograph: as taken with its annotation, and each control picture or its reason."""
        lead = photo.lead
        metres = "" if lead is None else f"  {lead.distance_m:.1f} m"
        why = [*reasons, *filter(None, [made.refused.get(EVERY)])][:1]
        row = [SheetCell((f"{photo.file}{metres}", *why), small(_annotated(pixels, scene), _CELL_PX))]
        empty = small(np.full_like(pixels, _GREY), _CELL_PX)
        for name in PICTURES if made.pictures else ():
            away = made.distances.get(_METRES.get(name, ""))
            words = f"{name}{'' if away is None else f'  {away:.1f} m'}"
            picture = made.pictures.get(name)
            row.append(
                SheetCell(
                    (words, made.refused.get(name, made.refused.get(EVERY, ""))),
                    empty if picture is None else small(picture, _CELL_PX),
                )
            )
        self._rows.append(row)
        if len(self._rows) == ROWS:
            self._write()

    def finish(self) -> list[Path]:
        """Write the last sheet, and return all of them."""
        if self._rows:
            self._write()
        return self._files

    def _write(self) -> None:
        number = len(self._files) + 1
        file = self.folder / ("sheet.png" if number == 1 else f"sheet-{number}.png")
        draw_sheet(self._rows, file, cell_px=_CELL_PX)
        self._files.append(file)
        self._rows = []


def _annotated(pixels: RGB, scene: EditScene | None) -> RGB:
    """Return a photograph with the outline of its lead, of other things, and its horizon."""
    shown = pixels.copy()
    if scene is None:
        return shown
    for colour, masks in ((_BLUE, [one.mask for one in scene.others]), (_RED, [scene.lead.mask])):
        for mask in masks:
            shown[grown(mask, 1) & ~mask] = colour
    row = round(scene.lines.horizon)
    if 0 <= row < len(shown):
        shown[row] = _YELLOW
    return shown
