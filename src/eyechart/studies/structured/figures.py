"""The figure of the visual interface: a frame, its calibrated view, and the reflected view.

Source: paper, figure fgr:vlm-interface.
"""

from collections.abc import Iterator, Sequence
from math import inf

import numpy as np

from eyechart.conditions import flip
from eyechart.frames import RGB, Frame, decode
from eyechart.perception.view import View, find_view
from eyechart.report.charts import Drawing, panels, style
from eyechart.studies.structured.tables import Estimates

_WIDTH = 7.16
"""The width of a figure over both columns of the paper's class, in inches."""


def interface(evidence: Sequence[Estimates]) -> Iterator[Drawing]:
    """Yield figure fgr:vlm-interface of the first run with pictures and a view.

    Its frame is the first with a close lead, else the first with a lead, else the first of the run.
    """
    for run in evidence:
        view = find_view(run.score.manifest.view)
        if view is None or run.pictures is None or not run.frames:
            continue
        frame = _frame(run)
        pixels = decode(run.pictures.recorded(frame), frame.file)
        with style():
            yield _drawn(frame, pixels, view)
        return


def _frame(run: Estimates) -> Frame:
    gap = run.score.bank.manifest.gap
    return (
        run.frames[0] if gap is None else min(run.frames, key=lambda frame: (not gap.near(frame), gap.of(frame) == inf))
    )


def _drawn(frame: Frame, pixels: RGB, view: View) -> Drawing:
    reflected = np.ascontiguousarray(flip(pixels, view.axis))
    shown = {
        "the simulator's frame": pixels,
        f"the calibrated view ({view.name})": view.show(pixels, frame.file),
        "its reflection": view.show(reflected, frame.file),
    }
    says = (
        f"Frame {frame.id}, from left to right: as the simulator drew it, as models saw it, and as they saw its "
        "reflection. In the reflection estimates of what is ahead stay, and LEFT and RIGHT exchange"
    )
    return Drawing("fgr-vlm-interface", "Visual interface", says, panels(shown, _WIDTH), wide=True)
