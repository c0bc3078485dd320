"""Figures of one model: its actions against the gap, under reflection, and with the lead far and near.

Source: paper, table t:qwenorder (median gap by action) and section Mirror test.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.patches import Rectangle

from eyechart.report.drawing import (
    BLUE,
    INK,
    LINE,
    MUTED,
    ON_COLOUR,
    VERMILLION,
    Drawing,
    canvas,
    cell,
    grid,
    plain,
)
from eyechart.report.evidence import Subject
from eyechart.spaces.space import UNPARSED, AnySpace
from eyechart.studies.battery.answers import Symbols

_BLUES = LinearSegmentedColormap.from_list("count", ["#ffffff", "#c6dbef", "#6baed6", "#08519c"])
MOST_MARKS = 400
"""Marks of one action in a figure; of more frames every second, third, … is drawn."""

_MARKS = {"brake": ("s", VERMILLION), "proceed": ("^", BLUE), "other": ("o", MUTED)}


def gap_by_action(who: Subject, place: int) -> list[Drawing]:
    """Draw the gap of each real frame by the action that it got, with medians; nothing where there is no gap."""
    answers = who.model.answers
    if answers.gaps is None or answers.gap is None:
        return []
    real, gaps = answers.actions("real"), answers.gaps
    finite = gaps[np.isfinite(gaps)]
    farthest = float(finite.max()) if finite.size else 1.0
    leadless = not np.isfinite(gaps).all()
    nowhere = farthest * 1.16
    actions = answers.space.actions
    names = [f"{plain(action, 12)} ({np.count_nonzero(real == action)})" for action in actions]
    margin = 0.2 + 0.077 * max(map(len, names))
    figure, axes = canvas(3.5, 0.6 + 0.36 * len(actions), (margin, 0.15, 0.5, 0.05))
    told = []
    for y, action in enumerate(actions):
        mine = gaps[real == action]
        some = mine[:: 1 + len(mine) // MOST_MARKS]
        mark, colour = _MARKS[answers.space.role(action)]
        shown = np.where(np.isfinite(some), some, nowhere)
        jitter = 0.26 * np.sin(np.arange(len(some)) * 2.399963)  # the golden angle: even, and the same every time
        axes.scatter(shown, y + jitter, s=9, marker=mark, color=colour, alpha=0.55, linewidths=0)
        if len(mine):
            middle = float(np.median(np.where(np.isfinite(mine), mine, farthest)))
            axes.plot([middle, middle], [y - 0.4, y + 0.4], color=INK, linewidth=2.2, solid_capstyle="butt")
            told.append(f"{action}: {len(mine)} frames, median {middle:.1f} {answers.gap.unit}")
        else:
            told.append(f"{action}: never")
    _strip_axes(axes, names, nowhere, leadless=leadless)
    axes.axvline(answers.gap.threshold, color=MUTED, linestyle=(0, (4, 3)), linewidth=0.9, zorder=0)
    axes.set_xlabel(f"{plain(answers.gap.column, 24)} ({plain(answers.gap.unit, 8)})", fontsize=8.5)
    if leadless:
        axes.axvline((farthest + nowhere) / 2, color=LINE, linewidth=0.8, zorder=0)
    title = f"Gap by action, {who.label}"
    says = f"Each mark is a real frame; squares brake, triangles proceed; the bar is the median. {'; '.join(told)}"
    return [Drawing(f"gap-{place:02d}", title, says, figure, of=who.label)]


def _strip_axes(axes: Axes, names: Sequence[str], nowhere: float, *, leadless: bool) -> None:
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_xlim(0, nowhere * (1.06 if leadless else 0.92))
    axes.set_yticks(range(len(names)), names)
    axes.tick_params(axis="y", length=0)
    kept = [float(tick) for tick in axes.get_xticks() if 0 <= tick < nowhere * (0.84 if leadless else 0.92)]
    extra = [nowhere] if leadless else []
    axes.set_xticks([*kept, *extra], [*(f"{tick:g}" for tick in kept), *("none" for _ in extra)])
    for y in range(len(names)):
        axes.axhline(y, color=LINE, linewidth=0.6, zorder=0)
    axes.spines["left"].set_visible(False)


def mirror(who: Subject, place: int) -> list[Drawing]:
    """Draw which action a reflection turns each action into; a frame marks where it should go."""
    answers = who.model.answers
    real, mirrored, _ = answers.both("real", "mirrored", "response")
    if not len(real) or not answers.partners:
        return []
    names = ("real frame", "mirrored frame")
    expected = {(action, answers.partners.get(action, action)) for action in answers.space.actions}
    title = f"Under reflection, {who.label}"
    note = "framed: the action that the reflected world calls for"
    return [
        _transitions((f"mirror-{place:02d}", title, who.label), (real, mirrored), names, answers.space, expected, note)
    ]


def counterfactual(who: Subject, place: int) -> list[Drawing]:
    """Draw the decisions of the same moments with the lead near and far; a frame marks harder braking when near."""
    answers, space = who.model.answers, who.model.answers.space
    far, near, _ = answers.both("lead_far", "lead_near", "response")
    if not len(far):
        return []
    level = {action: space.project(action, "brake") or 0.0 for action in space.actions}
    harder = {(one, other) for one in space.actions for other in space.actions if level[other] > level[one]}
    title = f"Lead far and near, {who.label}"
    note = "framed: brakes harder when the lead is near"
    names = ("lead far", "lead near")
    return [_transitions((f"counterfactual-{place:02d}", title, who.label), (far, near), names, space, harder, note)]


def _transitions(
    words: tuple[str, str, str],
    pair: tuple[Symbols, Symbols],
    names: tuple[str, str],
    space: AnySpace,
    marked: set[tuple[str, str]],
    note: str,
) -> Drawing:
    rows, columns = pair
    actions = [*space.actions, *([UNPARSED] if UNPARSED in {*rows.tolist(), *columns.tolist()} else [])]
    size = len(actions)
    labels = [plain(one, 11) for one in actions]
    leaning = size > 5 or max(map(len, labels)) > 8
    top, margin = (0.95 if leaning else 0.5), 0.4 + 0.075 * max(map(len, labels))
    figure, axes = canvas(3.5, top + 0.05 + 0.33 * size, (margin, 0.35 if leaning else 0.1, 0.05, top))
    told = []
    for y, one in enumerate(actions):
        total = int((rows == one).sum())
        for x, other in enumerate(actions):
            count = int(((rows == one) & (columns == other)).sum())
            cell(axes, x, y, count / total if total else None, str(count) if total else "", _BLUES)
            if (one, other) in marked:
                edge = ON_COLOUR if total else INK
                axes.add_patch(
                    Rectangle((x - 0.44, y - 0.43), 0.88, 0.86, fill=False, edgecolor=edge, linewidth=1.1, zorder=5)
                )
            if count:
                told.append(f"{one} to {other}: {count}")
    grid(axes, labels, labels, rotation=40 if leaning else 0)
    axes.tick_params(axis="x", labelsize=7.5)
    axes.set_xlabel(names[1], fontsize=8.5, color=MUTED)
    axes.set_ylabel(names[0], fontsize=8.5, color=MUTED)
    says = f"Rows: {names[0]}; columns: {names[1]}; {note}. {'; '.join(told)}"
    return Drawing(words[0], words[1], says, figure, of=words[2])
