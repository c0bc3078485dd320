"""Figures of the hierarchy: what became of each source in each paired world, with its share of goals beside it."""

from collections.abc import Mapping, Sequence

from matplotlib.axes import Axes

from eyechart.episodes import Episode
from eyechart.report.charts import BLUE, INK, LINE, MUTED, PAPER, VERMILLION, Drawing, canvas, plain, style
from eyechart.report.page import evenly
from eyechart.studies.hierarchy import HierarchyScore, Source
from eyechart.studies.hierarchy.plots import in_order
from eyechart.studies.hierarchy.scoring import PUBLISHED, UNPUBLISHED, count_of
from eyechart.studies.hierarchy.tables import of_ablation

MOST_ROWS = 40
MOST_COLUMNS = 60
"""Sources and worlds in a figure; the tables have all of them."""
_ROW_IN = 0.235


def outcomes(score: HierarchyScore, ablation: str) -> Drawing | None:
    """Draw a row a source and a column a world: goal, crash or out of time, and right of it the share of goals."""
    rows = of_ablation(score.sources, ablation)[:MOST_ROWS]
    if not rows:
        return None
    ended = [_ended(score, one) for one in rows]
    every = in_order({world for one in ended for world in one})
    worlds = evenly(every, MOST_COLUMNS)
    with style():
        labels = [plain(one.name, 46) for one in rows]
        left, wide = 0.3 + 0.066 * max(map(len, labels)), min(0.36, 5.4 / len(worlds)) * len(worlds)
        figure, axes = canvas(left + wide + 2.35, 1.2 + _ROW_IN * len(rows), (left, 2.35, 0.65, 0.55))
        _marks(axes, ended, worlds)
        _columns(axes, worlds)
        axes.set_yticks(range(len(rows)), labels)
        height = figure.get_size_inches()[1]
        box = (
            (left + wide + 0.25) / (left + wide + 2.35),
            0.65 / height,
            1.35 / (left + wide + 2.35),
            (height - 1.2) / height,
        )
        _shares(figure.add_axes(box), rows)
    told = "; ".join(f"{label}: {count_of(one.goals)} goals" for label, one in zip(labels, rows, strict=True))
    name = "Primary" if ablation == "primary" else "Second"
    title = f"{name} ablation: what became of each source in the same {len(every)} worlds"
    says = f"Rows are sources, columns worlds: a dot is the goal, a cross a crash, a ring the end of the time. {told}."
    return Drawing(f"outcomes-{ablation}", title, says, figure, wide=True)


def _ended(score: HierarchyScore, row: Source) -> Mapping[tuple[str, int], str]:
    drives = next(one for one in score.drives[row.part] if one.driver == row.driver)
    every: Sequence[Episode] = (*drives.episodes, *drives.errors)
    return {(one.key.scenario, one.key.seed): one.ended for one in every}


def _marks(axes: Axes, ended: Sequence[Mapping[tuple[str, int], str]], worlds: Sequence[tuple[str, int]]) -> None:
    axes.set_xlim(-0.6, len(worlds) - 0.4)
    axes.set_ylim(len(ended) - 0.4, -0.6)
    kinds = {
        "goal": {"marker": "o", "s": 26, "color": BLUE},
        "crash": {"marker": "x", "s": 26, "color": VERMILLION, "linewidths": 1.7},
        "time": {"marker": "o", "s": 22, "facecolors": "none", "edgecolors": MUTED, "linewidths": 1.2},
        "error": {"marker": "$!$", "s": 30, "color": INK},
    }
    for y in range(len(ended)):
        axes.axhline(y, color=LINE, linewidth=0.5, zorder=0)
    for kind, how in kinds.items():
        at = [(x, y) for y, one in enumerate(ended) for x, world in enumerate(worlds) if one.get(world) == kind]
        if at:
            axes.scatter([x for x, _ in at], [y for _, y in at], zorder=3, **how)  # type: ignore[arg-type]
    axes.tick_params(length=0)
    for spine in axes.spines.values():
        spine.set_visible(False)


def _columns(axes: Axes, worlds: Sequence[tuple[str, int]]) -> None:
    """Name the seeds above the columns, and above them the scenarios."""
    axes.xaxis.tick_top()
    axes.set_xticks(range(len(worlds)), [str(seed) for _, seed in worlds], fontsize=7, color=MUTED)
    begun = [place for place, world in enumerate(worlds) if place == 0 or worlds[place - 1][0] != world[0]]
    for first, last in zip(begun, [*begun[1:], len(worlds)], strict=True):
        axes.text((first + last - 1) / 2, -1.55, worlds[first][0], ha="center", fontsize=8.5)
        if first:
            axes.axvline(first - 0.5, color=MUTED, linewidth=0.6, zorder=1)


def _shares(axes: Axes, rows: Sequence[Source]) -> None:
    axes.set_facecolor("none")
    axes.set_xlim(-4, 104)
    axes.set_ylim(len(rows) - 0.4, -0.6)
    for y, one in enumerate(rows):
        axes.axhline(y, color=LINE, linewidth=0.5, zorder=0)
        paper = PUBLISHED.get(one.name, UNPUBLISHED)
        if one.goals.ci is not None:
            axes.plot([100 * end for end in one.goals.ci], [y, y], color=BLUE, linewidth=1.6, zorder=2)
        if one.goals.value is not None:
            axes.scatter([100 * one.goals.value], [y], s=26, color=BLUE, zorder=3)
        if paper[0]:
            goals, _, of = paper[0].partition("/")
            at = 100 * int(goals) / int(of)
            axes.scatter([at], [y], 34, marker="D", facecolors=PAPER, edgecolors=INK, linewidths=1.0, zorder=2.5)
        axes.text(1.06, y, count_of(one.goals), transform=axes.get_yaxis_transform(), va="center", fontsize=8)
    axes.set_yticks([])
    axes.set_xticks([0, 50, 100])
    axes.set_xlabel("goals (%), 95 %\n◇ the paper's", fontsize=8)
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)
