"""The figures of a report: agreement, gap, information, reflection, counterfactuals and the noise floor.

Source: paper, figures bicb (agreement) and mi (entropy against information), tables t:frontier and t:qwenorder.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.patches import Rectangle
from matplotlib.transforms import Bbox

from eyechart.actions import UNPARSED, ActionSpace
from eyechart.report.drawing import BLUE, INK, LINE, MUTED, PAPER, VERMILLION, Drawing, canvas, plain, style
from eyechart.report.evidence import Subject
from eyechart.report.tables import number
from eyechart.studies.battery.answers import Symbols

_REDS = LinearSegmentedColormap.from_list("same", ["#ffffff", "#fddbc7", "#ef8a62", "#b2182b"])
_BLUES = LinearSegmentedColormap.from_list("count", ["#ffffff", "#c6dbef", "#6baed6", "#08519c"])
FLOOR_FACTOR = 1.5
"""IDI clears the noise floor s above so many times s."""

_ON_COLOUR = "#202020"
"""Ink on a coloured cell: the same in light and in dark."""

Box = tuple[float, float, float, float]
"""Left, bottom, right and top, in pixels."""

_MARKS = {"brake": ("s", VERMILLION), "proceed": ("^", BLUE), "other": ("o", MUTED)}


def figures(everyone: Sequence[Subject]) -> dict[str, list[Drawing]]:
    """Return the figures by section; a section whose data are missing has none."""
    with style():
        return {
            "agreement": [agreement(everyone)] if everyone else [],
            "gap": [one for place, who in enumerate(everyone, 1) for one in gap_by_action(who, place)],
            "information": [information(everyone)] if everyone else [],
            "mirror": [one for place, who in enumerate(everyone, 1) for one in mirror(who, place)],
            "counterfactual": [one for place, who in enumerate(everyone, 1) for one in counterfactual(who, place)],
            "noise": [noise_floor(everyone)] if everyone else [],
        }


def write_figures(drawn: dict[str, list[Drawing]], folder: Path) -> list[Path]:
    """Write every figure as SVG and PDF; return the files."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for drawing in (one for section in drawn.values() for one in section):
        for suffix, content in (("svg", drawing.svg().encode("utf-8", "backslashreplace")), ("pdf", drawing.pdf())):
            path = folder / f"{drawing.name}.{suffix}"
            path.write_bytes(content)
            written.append(path)
    return written


def agreement(everyone: Sequence[Subject]) -> Drawing:
    """Draw how often each condition gets the action of the real frame (figure bicb): red is the same action."""
    conditions = list(dict.fromkeys(name for who in everyone for name in who.run.conditions if name != "real"))
    shares = [[_agree(who, name) for name in conditions] for who in everyone]
    left = _room(everyone)
    width, height = left + 0.75 + 0.56 * max(1, len(conditions)), 1.0 + 0.31 * len(everyone)
    figure, axes = canvas(width, height, (left, 0.75, 0.05, 0.95))
    for y, row in enumerate(shares):
        for x, share in enumerate(row):
            _cell(axes, x, y, share, number(share, 2), _REDS)
    if "real_repeat" in conditions:
        x = conditions.index("real_repeat")
        axes.add_patch(Rectangle((x - 0.5, -0.5), 1, len(everyone), fill=False, edgecolor=INK, linewidth=1.6, zorder=5))
    labels = [f"{name}\n(noise floor)" if name == "real_repeat" else name for name in conditions]
    _grid(axes, labels, [plain(who.label, 34) for who in everyone], rotation=40)
    told = "; ".join(
        f"{who.label}: " + ", ".join(f"{name} {number(share, 2)}" for name, share in zip(conditions, row, strict=True))
        for who, row in zip(everyone, shares, strict=True)
    )
    title = "Agreement with the action given to the real frame"
    says = f"Red means the same action whether or not it can see. Rows are models, columns conditions. {told}"
    return Drawing("agreement", title, says, figure, wide=True)


def _room(everyone: Sequence[Subject]) -> float:
    """Return the margin in inches that the longest name of a model needs."""
    return 0.3 + 0.068 * max([12, *(len(plain(who.label, 34)) for who in everyone)])


def _agree(who: Subject, condition: str) -> float | None:
    """Return the share of frames with the response that the real frame got."""
    real, other, _ = who.model.answers.both("real", condition, "response")
    return float((real == other).mean()) if len(real) else None


def _cell(axes: Axes, x: int, y: int, share: float | None, text: str, colours: LinearSegmentedColormap) -> None:
    face = "none" if share is None else colours(share)
    axes.add_patch(Rectangle((x - 0.48, y - 0.47), 0.96, 0.94, facecolor=face, edgecolor=LINE, linewidth=0.6))
    ink = MUTED if share is None else "#ffffff" if share > 0.72 else _ON_COLOUR
    axes.text(x, y, text, ha="center", va="center", color=ink, fontsize=8)


def _grid(axes: Axes, columns: Sequence[str], rows: Sequence[str], *, rotation: float = 0) -> None:
    axes.set_xlim(-0.5, max(1, len(columns)) - 0.5)
    axes.set_ylim(max(1, len(rows)) - 0.5, -0.5)
    how: dict[str, Any] = {"rotation": rotation, "ha": "left", "rotation_mode": "anchor"} if rotation else {}
    axes.set_xticks(range(len(columns)), columns, **how)
    axes.set_yticks(range(len(rows)), rows)
    axes.xaxis.tick_top()
    axes.xaxis.set_label_position("top")
    axes.tick_params(length=0)
    for spine in axes.spines.values():
        spine.set_visible(False)


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
    figure, axes = canvas(3.5, 0.6 + 0.42 * len(actions), (0.95, 0.15, 0.5, 0.05))
    told = []
    for y, action in enumerate(actions):
        mine = gaps[real == action]
        role = _role(answers.space, action)
        mark, colour = _MARKS[role]
        shown = np.where(np.isfinite(mine), mine, nowhere)
        jitter = 0.26 * np.sin(np.arange(len(mine)) * 2.399963)  # the golden angle: even, and the same every time
        axes.scatter(shown, y + jitter, s=9, marker=mark, color=colour, alpha=0.55, linewidths=0)
        if len(mine):
            middle = float(np.median(np.where(np.isfinite(mine), mine, farthest)))
            axes.plot([middle, middle], [y - 0.4, y + 0.4], color=INK, linewidth=2.2, solid_capstyle="butt")
            told.append(f"{action}: {len(mine)} frames, median {middle:.1f} {answers.gap.unit}")
        else:
            told.append(f"{action}: never")
    names = [f"{plain(action, 12)} ({np.count_nonzero(real == action)})" for action in actions]
    _strip_axes(axes, names, nowhere, leadless=leadless)
    axes.axvline(answers.gap.threshold, color=MUTED, linestyle=(0, (4, 3)), linewidth=0.9, zorder=0)
    axes.set_xlabel(f"{plain(answers.gap.column, 24)} ({plain(answers.gap.unit, 8)})", fontsize=8.5)
    if leadless:
        axes.axvline((farthest + nowhere) / 2, color=LINE, linewidth=0.8, zorder=0)
    title = f"Gap by action, {who.label}"
    says = f"Each mark is a real frame; squares brake, triangles proceed; the bar is the median. {'; '.join(told)}"
    return [Drawing(f"gap-{place:02d}", title, says, figure)]


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


def _role(space: ActionSpace, action: str) -> str:
    return "brake" if action in space.brake else "proceed" if action in space.proceed else "other"


def information(everyone: Sequence[Subject]) -> Drawing:
    """Draw action entropy against mutual information with the gap (figure mi), each model by its name."""
    points = []
    for who in everyone:
        found = who.model.statistics
        x, y = found["entropy"].value, found["mutual_information.decision"].value
        if x is not None and y is not None:
            points.append((who, x, y))
    figure, axes = canvas(7.0, 4.3, (0.65, 0.2, 0.6, 0.2))
    right = max([1.0, *(x for _, x, _ in points)]) * 1.3
    top = max([0.25, *(y for _, _, y in points)]) * 1.15
    axes.set_xlim(-0.03 * right, right)
    axes.set_ylim(-0.05 * top, top)
    axes.grid(color=LINE, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.set_xlabel("action entropy on real frames (bits)")
    axes.set_ylabel("I(A; g) (bits)")
    axes.text(
        right * 0.99, -0.035 * top, "varied, and not about the gap", ha="right", fontsize=8, style="italic", color=MUTED
    )
    _labelled(axes, points)
    told = "; ".join(f"{who.label}: entropy {x:.2f}, information {y:.3f}" for who, x, y in points)
    missing = [who.label for who in everyone if who.label not in {one.label for one, _, _ in points}]
    without = f" Cannot say: {', '.join(missing)}." if missing else ""
    title = "Action entropy against mutual information with the gap"
    says = f"High entropy with information near 0 (lower right) is variety without sight. {told}.{without}"
    return Drawing("information", title, says, figure, wide=True)


def _labelled(axes: Axes, points: Sequence[tuple[Subject, float, float]]) -> None:
    """Draw the points, and each name at the nearest place where it covers no other name."""
    inverse = axes.transData.inverted()
    taken: list[Box] = []
    seen = sorted(points, key=lambda one: (one[1], one[2], one[0].label))
    pixels = [axes.transData.transform((x, y)) for _, x, y in seen]
    taken += [(float(x) - 4, float(y) - 4, float(x) + 4, float(y) + 4) for x, y in pixels]
    bounds = axes.get_window_extent()
    for (who, x, y), (px, py) in zip(seen, pixels, strict=True):
        label = plain(who.label, 30)
        axes.scatter([x], [y], s=34, color=BLUE, edgecolors=PAPER, linewidths=0.8, zorder=3)
        wide = 6.2 * len(label)
        box, side = next(
            (spot for spot in _spots(float(px), float(py), wide) if _free(spot[0], bounds, taken)),
            next(_spots(float(px), float(py), wide)),
        )
        taken.append(box)
        near, middle = box[0] if side == "left" else box[2], (box[1] + box[3]) / 2
        tx, ty = inverse.transform((near, middle))
        axes.text(tx, ty, label, fontsize=8, ha=side, va="center", zorder=4)
        if abs(middle - py) > 8 or abs(near - px) > 12:
            axes.plot([x, tx], [y, ty], color=MUTED, linewidth=0.5, zorder=2)


def _spots(px: float, py: float, wide: float) -> Iterator[tuple[Box, str]]:
    """Yield boxes for a name beside a point, the nearest first, with the end of the name that is at the point."""
    for up in (0, 14, -14, 28, -28, *range(42, 300, 14)):
        for away in (9, 34, 80):
            yield (px + away, py + up - 7, px + away + wide, py + up + 7), "left"
            yield (px - away - wide, py + up - 7, px - away, py + up + 7), "right"


def _free(box: Box, bounds: Bbox, taken: Sequence[Box]) -> bool:
    inside = box[0] > bounds.x0 and box[2] < bounds.x1 + 12 and box[1] > bounds.y0 and box[3] < bounds.y1
    return inside and not any(_overlap(box, other) for other in taken)


def _overlap(one: Box, other: Box) -> bool:
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]


def mirror(who: Subject, place: int) -> list[Drawing]:
    """Draw which action a reflection turns each action into; a frame marks where it should go."""
    answers = who.model.answers
    real, mirrored, _ = answers.both("real", "mirrored", "response")
    if not len(real) or not answers.space.mirror_pairs:
        return []
    names = ("real frame", "mirrored frame")
    expected = {(action, answers.space.mirror(action)) for action in answers.space.actions}
    title = f"Under reflection, {who.label}"
    note = "framed: the action that the reflected world calls for"
    return [_transitions(f"mirror-{place:02d}", title, (real, mirrored), names, answers.space, expected, note)]


def counterfactual(who: Subject, place: int) -> list[Drawing]:
    """Draw the decisions of the same moments with the lead near and far; a frame marks harder braking when near."""
    answers, space = who.model.answers, who.model.answers.space
    far, near, _ = answers.both("lead_far", "lead_near", "response")
    if not len(far):
        return []
    level = space.braking_level
    harder = {(one, other) for one in space.actions for other in space.actions if level(other) > level(one)}
    title = f"Lead far and near, {who.label}"
    note = "framed: brakes harder when the lead is near"
    names = ("lead far", "lead near")
    return [_transitions(f"counterfactual-{place:02d}", title, (far, near), names, space, harder, note)]


def _transitions(
    name: str,
    title: str,
    pair: tuple[Symbols, Symbols],
    names: tuple[str, str],
    space: ActionSpace,
    marked: set[tuple[str, str]],
    note: str,
) -> Drawing:
    rows, columns = pair
    actions = [*space.actions, *([UNPARSED] if UNPARSED in {*rows.tolist(), *columns.tolist()} else [])]
    size = len(actions)
    figure, axes = canvas(3.5, 0.6 + 0.36 * size, (1.15, 0.1, 0.05, 0.55))
    told = []
    for y, one in enumerate(actions):
        total = int((rows == one).sum())
        for x, other in enumerate(actions):
            count = int(((rows == one) & (columns == other)).sum())
            _cell(axes, x, y, count / total if total else None, str(count) if total else "", _BLUES)
            if (one, other) in marked:
                edge = _ON_COLOUR if total else INK
                axes.add_patch(
                    Rectangle((x - 0.44, y - 0.43), 0.88, 0.86, fill=False, edgecolor=edge, linewidth=1.1, zorder=5)
                )
            if count:
                told.append(f"{one} to {other}: {count}")
    _grid(axes, [plain(one, 9) for one in actions], [plain(one, 11) for one in actions])
    axes.tick_params(axis="x", labelsize=7)
    axes.set_xlabel(names[1], fontsize=8.5, color=MUTED)
    axes.set_ylabel(names[0], fontsize=8.5, color=MUTED)
    return Drawing(name, title, f"Rows: {names[0]}; columns: {names[1]}; {note}. {'; '.join(told)}", figure)


def noise_floor(everyone: Sequence[Subject]) -> Drawing:
    """Draw s, IDI and 1.5 s of each model: the paper asks that IDI stands above 1.5 s."""
    left = _room(everyone)
    figure, axes = canvas(left + 4.6, 1.0 + 0.32 * len(everyone), (left, 1.25, 0.55, 0.35))
    told = []
    for y, who in enumerate(everyone):
        found = who.model.statistics
        floor, idi, clears = found["noise_floor"].value, found["idi"].value, found["clears_floor"].value
        axes.axhline(y, color=LINE, linewidth=0.6, zorder=0)
        if floor is not None:
            bar = FLOOR_FACTOR * floor
            axes.plot([0, bar], [y, y], color=MUTED, linewidth=3.5, alpha=0.35, solid_capstyle="butt", zorder=1)
            axes.scatter([floor], [y], s=34, marker="o", color=VERMILLION, zorder=3)
            axes.plot([bar, bar], [y - 0.3, y + 0.3], color=INK, linewidth=2, zorder=2)
        if idi is not None:
            axes.scatter([idi], [y], s=40, marker="D", color=BLUE, edgecolors=PAPER, linewidths=0.6, zorder=4)
        word = "cannot say" if clears is None else "clears" if clears else "does not clear"
        axes.text(1.56, y, word, va="center", fontsize=8.5, color=INK if clears else MUTED)
        told.append(f"{who.label}: s {number(floor)}, IDI {number(idi)}, {word}")
    axes.set_ylim(max(1, len(everyone)) - 0.4, -0.6)
    axes.set_xlim(-0.02, 1.52)
    axes.set_yticks(range(len(everyone)), [plain(who.label, 34) for who in everyone])
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.set_xlabel("share of frames with another answer")
    _key(axes)
    return Drawing(
        "noise-floor",
        "Noise floor s, its threshold 1.5 s, and IDI",
        f"IDI has to stand above 1.5 s. {'; '.join(told)}",
        figure,
        wide=True,
    )


def _key(axes: Axes) -> None:
    axes.scatter([], [], marker="o", s=34, color=VERMILLION, label="s (a repeat differs)")
    axes.plot([], [], marker="|", markersize=9, markeredgewidth=2, linestyle="none", color=INK, label="1.5 s")
    axes.scatter([], [], marker="D", s=36, color=BLUE, label="IDI (a blank differs)")
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=3, frameon=False, fontsize=8.5, borderaxespad=0)


def pair_counts(who: Subject) -> str:
    """Return in words how many counterfactual pairs were braked harder near, alike, and harder far."""
    answers = who.model.answers
    near, far, _ = answers.both("lead_near", "lead_far", "decision")
    if not len(near):
        return "no counterfactual pair has two decisions"
    apart = answers.levels(near) - answers.levels(far)
    harder, softer = int((apart > 0).sum()), int((apart < 0).sum())
    alike = len(near) - harder - softer
    return f"{harder} of {len(near)} pairs are braked harder near, {softer} harder far, {alike} alike"
