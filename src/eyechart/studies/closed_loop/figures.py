"""Figures of what drove: the ladder as dots with intervals, real pictures less others, and entropy against information.

Source: paper, Table t:baselines and figure fgr:mi.
"""

from collections.abc import Sequence

from matplotlib.axes import Axes

from eyechart.report.charts import (
    BLUE,
    INK,
    LINE,
    MUTED,
    PAPER,
    VERMILLION,
    Drawing,
    canvas,
    plain,
    room,
    scattered,
    style,
)
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
    labels = [one.driver.label for one in rungs]
    left = room(labels)
    figure, axes = canvas(left + 3.4, 0.7 + 0.27 * len(rungs), (left, 0.2, 0.5, 0.05))
    scale = 100.0 if name.endswith("_rate") else 1.0
    told = []
    for y, one in enumerate(rungs):
        found = one.statistics[name]
        axes.axhline(y, color=LINE, linewidth=0.6, zorder=0)
        if found.value is not None:
            constant = one.driver.policy.startswith("constant:")
            _dot(axes, y, scale * found.value, found.ci and (scale * found.ci[0], scale * found.ci[1]), hollow=constant)
        told.append(f"{one.driver.label}: {MEASURES[name].shown(found)}")
    _rows(axes, labels)
    title = NAMES[name] if scale == 1.0 else f"{NAMES[name]} (%)"
    axes.set_xlabel(f"{title}; {_BEST[name]}", fontsize=8.5)
    says = f"Dots with 95 % intervals over episodes; hollow: constant policies. {'; '.join(told)}"
    return Drawing(f"ladder-{name}", f"The ladder: {title}", says, figure)


def _dot(axes: Axes, y: int, value: float, ci: tuple[float, float] | None, *, hollow: bool, colour: str = BLUE) -> None:
    if ci is not None:
        axes.plot(ci, [y, y], color=colour, linewidth=1.6, solid_capstyle="butt", zorder=2)
    axes.scatter(
        [value], [y], s=34, facecolors=PAPER if hollow else colour, edgecolors=colour, linewidths=1.4, zorder=3
    )


def _rows(axes: Axes, labels: Sequence[str]) -> None:
    axes.set_ylim(max(1, len(labels)) - 0.5, -0.5)
    axes.set_yticks(range(len(labels)), [plain(label, 34) for label in labels])
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)


def _paired(found: Sequence[Blind], name: str) -> Drawing:
    labels = [f"{one.driver.label} less {one.condition}" for one in found]
    left = room(labels)
    figure, axes = canvas(left + 3.4, 0.7 + 0.27 * len(found), (left, 0.2, 0.5, 0.05))
    scale, told = 100.0 if name.endswith("_rate") else 1.0, []
    axes.axvline(0, color=INK, linewidth=0.9, zorder=1)
    for y, one in enumerate(found):
        value = one.paired.differences[name]
        axes.axhline(y, color=LINE, linewidth=0.6, zorder=0)
        differs = name in one.paired.changed
        if value.value is not None:
            ci = value.ci and (scale * value.ci[0], scale * value.ci[1])
            _dot(axes, y, scale * value.value, ci, hollow=not differs, colour=VERMILLION if differs else MUTED)
        told.append(f"{labels[y]}: {SIGNED[name].shown(value)}{', significant' if differs else ''}")
    _rows(axes, labels)
    what = NAMES[name].partition(" (")[0]
    axes.set_xlabel(f"{what}, real less other{_UNITS[name]}", fontsize=8.5)
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
