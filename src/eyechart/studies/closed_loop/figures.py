"""Figures of what drove: the ladder as dots with intervals, real pictures less others, and entropy against information.

Source: paper, Table t:baselines and figure fgr:mi.
"""

from collections.abc import Sequence

from eyechart.report.charts import BLUE, MUTED, VERMILLION, Drawing, dots, scattered, style
from eyechart.studies.closed_loop import Blind, ClosedLoopScore, Degeneracy, Rung
from eyechart.studies.closed_loop.tables import MEASURES, NAMES, SIGNED

MOST_ROWS = 40
"""Drivers in a figure; the tables have all of them."""

_UNITS = {"distance_m": " (m)", "reward": "", "speed_mps": " (m/s)", "crash_rate": " (points)"}
_BEST = {"distance_m": "more is better", "reward": "more is better", "crash_rate": "less is better"}


def drives_figures(score: ClosedLoopScore) -> dict[str, list[Drawing]]:
    """Return the figures by section; a section without data has none."""
    with style():
        rungs = sorted(score.ladder, key=lambda one: (one.driver.simulator, -(one.statistics["reward"].value or 0.0)))
        return {
            "ladder": [_dots(rungs[:MOST_ROWS], name) for name in _BEST] if rungs else [],
            "blind": [_paired(score.blind[:MOST_ROWS], name) for name in _UNITS] if score.blind else [],
            "information": _information(score.audit),
        }


def _dots(rungs: Sequence[Rung], name: str) -> Drawing:
    form, found = MEASURES[name], [(one.driver, one.statistics[name]) for one in rungs]
    rows = [(who.label, one, BLUE, who.policy.startswith("constant:")) for who, one in found]
    title = NAMES[name] if form.scale == 1.0 else f"{NAMES[name]} (%)"
    figure = dots(rows, f"{title}; {_BEST[name]}", form.scale)
    told = "; ".join(f"{who.label}: {form.shown(one)}" for who, one in found)
    says = f"Dots with 95 % intervals over episodes; hollow: constant policies. {told}"
    return Drawing(f"ladder-{name}", f"The ladder: {title}", says, figure)


def _paired(found: Sequence[Blind], name: str) -> Drawing:
    form, rows, told = SIGNED[name], [], []
    for one in found:
        label, value = f"{one.driver.label} less {one.condition}", one.paired.differences[name]
        differs = name in one.paired.changed
        rows.append((label, value, VERMILLION if differs else MUTED, not differs))
        told.append(f"{label}: {form.shown(value)}{', significant' if differs else ''}")
    what = NAMES[name].partition(" (")[0]
    figure = dots(rows, f"{what}, real less other{_UNITS[name]}", form.scale, zero=True)
    says = f"Differences in the same worlds with 95 % intervals; filled: significant after Holm. {'; '.join(told)}"
    return Drawing(f"blind-{name}", f"Real pictures less others: {NAMES[name]}", says, figure)


def _information(rows: Sequence[Degeneracy]) -> list[Drawing]:
    points = []
    for row in rows:
        x, y = row.statistics["entropy_bits"].value, row.statistics["information_bits"].value
        if x is not None and y is not None:
            points.append((row.driver.label, x, y))
    if not points:
        return []
    names = ("action entropy over the drives (bits)", "I(A; scene) (bits)", "varied, and not about the scene")
    figure = scattered(points[:MOST_ROWS], *names)
    told = "; ".join(f"{name}: entropy {x:.2f}, information {y:.3f}" for name, x, y in points)
    says = f"High entropy with information near 0 (lower right) is variety without the scene. {told}."
    title = "Action entropy against information about the scene"
    return [Drawing("drives-information", title, says, figure, wide=True)]
