"""Figures of batteries: those that compare models, and those of one model.

Source: paper, figures fgr:bicb (agreement) and fgr:mi (entropy against information), Table
t:qwenorder (median gap by action) and section The Input-Ablation Battery (reflection).
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.patches import Rectangle

from eyechart.conditions import AGAIN, CONTROLS, OVER
from eyechart.report.charts import (
    BLUE,
    GREEN,
    INK,
    LINE,
    MUTED,
    ON_COLOUR,
    PAPER,
    VERMILLION,
    WAYS,
    Cell,
    Drawing,
    Frame,
    GridLabels,
    canvas,
    grid,
    named_rows,
    plain,
    room,
    scattered,
    style,
)
from eyechart.report.table import number
from eyechart.spaces.space import UNPARSED, AnySpace
from eyechart.stats.paired_tests import Place
from eyechart.studies.battery.answers import Symbols
from eyechart.studies.battery.depth import Window, moved_of
from eyechart.studies.battery.subjects import Subject

_REDS = LinearSegmentedColormap.from_list("same", ["#ffffff", "#fddbc7", "#ef8a62", "#b2182b"])
_STAYS = LinearSegmentedColormap.from_list("stays", ["#ef8a62", "#fddbc7", "#ffffff", "#c2e5d8", "#66bfa1"])
_MOVED = LinearSegmentedColormap.from_list("moved", ["#ffffff", "#c3c8cf"])
STAYS = ("real_repeat", "recoloured", "nudged", "text_swapped")
"""Conditions under which a model that follows distance keeps its answer."""
MOVED = ("lead_near", "lead_far", *(name for name in CONTROLS if name not in {"nudged", AGAIN}))
"""Conditions under which the answer may or may not stay, by frame; they are grey."""
FLOOR_FACTOR = 1.5
"""IDI clears the noise floor s above this factor of s."""

_OUTCOMES = (("harder near", GREEN, ""), ("alike", LINE, ""), ("harder far", VERMILLION, "////"))


def agreement(everyone: Sequence[Subject], *, as_paper: bool = False) -> Drawing:
    """Draw how often each condition gets the action of the real frame (figure bicb).

    A mirrored answer is compared with the reflected action, left and right exchanged. With
    ``as_paper`` it is compared with the real frame's action, as in the paper, and grey: an answer
    straight on is the same in the reflection. Red is the same action where the picture shows
    nothing, or another one where the answer should stay. Green is an answer that stays where it
    should.
    """
    conditions = list(dict.fromkeys(name for who in everyone for name in who.run.conditions if name != "real"))
    shares = [
        [_agree(who, name, reflect=not as_paper and _base(name) == "mirrored") for name in conditions]
        for who in everyone
    ]
    left = room([who.label for who in everyone])
    above = max([0.95, *(0.2 + 0.05 * len(name) for name in conditions)])  # of names that lean by 40 degrees
    width, height = left + 0.75 + 0.56 * max(1, len(conditions)), 0.05 + above + 0.31 * len(everyone)
    cells = _coloured(shares, [_colours(name, as_paper=as_paper) for name in conditions])
    floor = [x for x, name in enumerate(conditions) if name == "real_repeat"]
    framed = [(x - 0.5, -0.5, x + 0.5, len(everyone) - 0.5, INK, 1.6) for x in floor]
    below = {"real_repeat": "\n(noise floor)", "mirrored": "" if as_paper else "\n(exchanged)"}
    labels = GridLabels(
        [name + below.get(name, "") for name in conditions], [plain(who.label, 34) for who in everyone], rotation=40
    )
    figure = grid((width, height), (left, 0.75, 0.05, above), cells, labels, framed)
    description = "; ".join(
        f"{who.label}: " + ", ".join(f"{name} {number(share, 2)}" for name, share in zip(conditions, row, strict=True))
        for who, row in zip(everyone, shares, strict=True)
    )
    title = "Agreement with the action given to the real frame"
    says = f"Red means the same action whether or not it can see. Rows are models, columns conditions. {description}"
    if as_paper and "mirrored" in conditions:
        says = (
            f"Grey columns, mirrored among them, say nothing alone: the frame decides whether an answer stays. {says}"
        )
    return Drawing("agreement", title, says, figure, wide=True)


def _coloured(shares: Sequence[Sequence[float | None]], colours: Sequence[LinearSegmentedColormap]) -> list[list[Cell]]:
    return [[(share, number(share, 2), one) for share, one in zip(row, colours, strict=True)] for row in shares]


def _colours(condition: str, *, as_paper: bool) -> LinearSegmentedColormap:
    """Return a condition's colours: green where answers should stay, grey by frame, else red."""
    reflected = _base(condition) == "mirrored"
    if condition in STAYS or (reflected and not as_paper):
        return _STAYS
    return _MOVED if reflected or _base(condition) in MOVED else _REDS


def _base(condition: str) -> str:
    """Return a condition's name without its camera."""
    return condition.partition(OVER)[0]


def _agree(who: Subject, condition: str, *, reflect: bool = False) -> float | None:
    """Return the share of frames with the real frame's response, or its reflection."""
    apart, _ = who.model.answers.distance("real", condition, "response", reflect=reflect)
    return float((apart == 0).mean()) if len(apart) else None


def information(everyone: Sequence[Subject]) -> list[Drawing]:
    """Draw action entropy against mutual information with the gap (figure mi), by model."""
    points = []
    for who in everyone:
        statistics = who.model.statistics
        x, y = statistics["entropy"].value, statistics["mutual_information.decision"].value
        if x is not None and y is not None:
            points.append((who, x, y))
    if not points:
        return []
    names = ("action entropy on real frames (bits)", "I(A; g) (bits)", "varied, and not about the gap")
    figure = scattered([(who.label, x, y) for who, x, y in points], *names)
    description = "; ".join(f"{who.label}: entropy {x:.2f}, information {y:.3f}" for who, x, y in points)
    missing = [who.label for who in everyone if who.label not in {one.label for one, _, _ in points}]
    without = f" Cannot say: {', '.join(missing)}." if missing else ""
    title = "Action entropy against mutual information with the gap"
    says = f"High entropy with information near 0 (lower right) is variety without sight. {description}.{without}"
    return [Drawing("information", title, says, figure, wide=True)]


def pairs(everyone: Sequence[Subject]) -> list[Drawing]:
    """Draw in how many counterfactual pairs each model brakes harder near, equally, harder far."""
    counted = [(who, pair_counts(who)) for who in everyone]
    counted = [(who, counts) for who, counts in counted if sum(counts)]
    if not counted:
        return []
    left = room([who.label for who, _ in counted])
    figure, axes = canvas(left + 4.3, 0.95 + 0.3 * len(counted), (left, 0.25, 0.5, 0.4))
    descriptions = []
    for y, (who, counts) in enumerate(counted):
        start, total = 0.0, sum(counts)
        for count, (_, colour, hatch) in zip(counts, _OUTCOMES, strict=True):
            _bar(axes, (start, count / total, y), count, colour, hatch)
            start += count / total
        descriptions.append(f"{who.label}: {pair_words(counts)}")
    axes.set_xlim(0, 1)
    named_rows(axes, [who.label for who, _ in counted], 0.4)
    axes.set_xlabel("share of pairs with two decisions")
    for words, colour, hatch in _OUTCOMES:
        axes.add_patch(
            Rectangle((0, -9), 0, 0, facecolor=colour, hatch=hatch, edgecolor=PAPER, linewidth=0, label=words)
        )
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=3, frameon=False, fontsize=8.5, borderaxespad=0)
    title = "Counterfactual pairs: braking with the lead near against far"
    return [Drawing("counterfactual-pairs", title, "; ".join(descriptions), figure, wide=True)]


def _bar(axes: Axes, place: tuple[float, float, int], count: int, colour: str, hatch: str) -> None:
    start, wide, y = place
    if not count:
        return
    bar = Rectangle((start, y - 0.33), wide, 0.66, facecolor=colour, hatch=hatch, edgecolor=PAPER, linewidth=0.8)
    axes.add_patch(bar)
    if wide > 0.045:
        box = {"facecolor": PAPER, "edgecolor": "none", "pad": 1.2, "boxstyle": "round,pad=0.15"}
        axes.text(start + wide / 2, y, str(count), ha="center", va="center", fontsize=8, color=INK, bbox=box)


def pair_counts(who: Subject) -> tuple[int, int, int]:
    """Return in how many counterfactual pairs it brakes harder near, equally, and harder far."""
    near, far = (who.model.answers.projection(name, "brake") for name in ("lead_near", "lead_far"))
    if near is None or far is None:
        return 0, 0, 0
    apart = near - far
    return int((apart > 0).sum()), int((apart == 0).sum()), int((apart < 0).sum())


def pair_words(counts: tuple[int, int, int]) -> str:
    """Return the counts of pairs in words."""
    harder, alike, softer = counts
    if not sum(counts):
        return "no counterfactual pair has two decisions"
    return f"{harder} of {sum(counts)} pairs are braked harder near, {softer} harder far, {alike} equally"


def noise_floor(everyone: Sequence[Subject]) -> Drawing:
    """Draw s, IDI and 1.5 s of each model: by the paper, IDI must exceed 1.5 s."""
    left = room([who.label for who in everyone])
    figure, axes = canvas(left + 4.2, 1.0 + 0.32 * len(everyone), (left, 1.25, 0.55, 0.35))
    descriptions = []
    for y, who in enumerate(everyone):
        statistics = who.model.statistics
        floor, idi, clears = statistics["noise_floor"].value, statistics["idi"].value, statistics["clears_floor"].value
        axes.axhline(y, color=LINE, linewidth=0.6, zorder=0)
        if floor is not None:
            bar = FLOOR_FACTOR * floor
            axes.plot([0, bar], [y, y], color=MUTED, linewidth=3.5, alpha=0.35, solid_capstyle="butt", zorder=1)
            axes.scatter([floor], [y], s=34, marker="o", color=INK, zorder=3)
            axes.plot([bar, bar], [y - 0.3, y + 0.3], color=INK, linewidth=2, zorder=2)
        if idi is not None:
            axes.scatter([idi], [y], s=40, marker="D", color=BLUE, edgecolors=PAPER, linewidths=0.6, zorder=4)
        word = "cannot say" if clears is None else "clears" if clears else "does not clear"
        axes.text(1.56, y, word, va="center", fontsize=8.5, color=INK if clears else MUTED)
        descriptions.append(f"{who.label}: s {number(floor)}, IDI {number(idi)}, {word}")
    axes.set_xlim(-0.02, 1.52)
    named_rows(axes, [who.label for who in everyone], 0.4)
    axes.set_xlabel("share of frames with another answer")
    axes.scatter([], [], marker="o", s=34, color=INK, label="s (a repeat differs)")
    axes.plot([], [], marker="|", markersize=9, markeredgewidth=2, linestyle="none", color=INK, label="1.5 s")
    axes.scatter([], [], marker="D", s=36, color=BLUE, label="IDI (a blank differs)")
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=3, frameon=False, fontsize=8.5, borderaxespad=0)
    return Drawing(
        "noise-floor",
        "Noise floor s, its threshold 1.5 s, and IDI",
        f"IDI has to stand above 1.5 s. {'; '.join(descriptions)}",
        figure,
        wide=True,
    )


_BLUES = LinearSegmentedColormap.from_list("count", ["#ffffff", "#c6dbef", "#6baed6", "#08519c"])
MOST_MARKS = 400
"""The most marks of one action in a figure; of more frames every second, third, … is drawn."""

_MARKS = {"brake": ("s", MUTED), "proceed": ("^", MUTED), "other": ("o", MUTED)}
"""Actions differ by shape, because red and green stand for wrong and right alone."""


def gap_by_action(who: Subject, place: int) -> list[Drawing]:
    """Draw each real frame's gap by its action, with medians; empty where there is no gap."""
    answers = who.model.answers
    if answers.gaps is None or answers.gap is None:
        return []
    real, gaps = answers.actions("real"), answers.gaps
    finite = gaps[np.isfinite(gaps)]
    farthest = float(finite.max()) if finite.size else 1.0
    leadless = not np.isfinite(gaps).all()
    nowhere = farthest * 1.16
    actions = answers.names
    names = [f"{plain(action, 12)} ({np.count_nonzero(real == action)})" for action in actions]
    margin = 0.2 + 0.077 * max(map(len, names))
    figure, axes = canvas(3.5, 0.6 + 0.36 * len(actions), (margin, 0.15, 0.5, 0.05))
    axes.set_xlim(0, nowhere * (1.06 if leadless else 0.92))  # first, or every mark would set the limits anew
    axes.set_ylim(len(names) - 0.5, -0.5)
    descriptions = []
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
            descriptions.append(f"{action}: {len(mine)} frames, median {middle:.1f} {answers.gap.unit}")
        else:
            descriptions.append(f"{action}: never")
    _strip_axes(axes, names, nowhere, leadless=leadless)
    axes.axvline(answers.gap.threshold, color=MUTED, linestyle=(0, (4, 3)), linewidth=0.9, zorder=0)
    axes.set_xlabel(f"{plain(answers.gap.column, 24)} ({plain(answers.gap.unit, 8)})", fontsize=8.5)
    if leadless:
        axes.axvline((farthest + nowhere) / 2, color=LINE, linewidth=0.8, zorder=0)
    title = f"Gap by action, {who.label}"
    says = (
        f"Each mark is a real frame; squares brake, triangles proceed; the bar is the median. {'; '.join(descriptions)}"
    )
    return [Drawing(f"gap-{place:02d}", title, says, figure, of=who.label)]


def _strip_axes(axes: Axes, names: Sequence[str], nowhere: float, *, leadless: bool) -> None:
    axes.set_yticks(range(len(names)), names)
    axes.tick_params(axis="y", length=0)
    kept = [float(tick) for tick in axes.get_xticks() if 0 <= tick < nowhere * (0.84 if leadless else 0.92)]
    extra = [nowhere] if leadless else []
    axes.set_xticks([*kept, *extra], [*(f"{tick:g}" for tick in kept), *("none" for _ in extra)])
    for y in range(len(names)):
        axes.axhline(y, color=LINE, linewidth=0.6, zorder=0)
    axes.spines["left"].set_visible(False)


def mirror(who: Subject, place: int) -> list[Drawing]:
    """Draw which action each action becomes under reflection; a box marks the correct one."""
    answers = who.model.answers
    real, mirrored, _ = answers.both("real", "mirrored", "response")
    if not len(real) or not answers.partners:
        return []
    names = ("real frame", "mirrored frame")
    expected = {(action, answers.reflections.get(action, action)) for action in answers.names}
    title = f"Under reflection, {who.label}"
    note = "framed: the action that the reflected world calls for"
    return [
        _transitions((f"mirror-{place:02d}", title, who.label), (real, mirrored), names, answers.space, expected, note)
    ]


def counterfactual(who: Subject, place: int) -> list[Drawing]:
    """Draw the decisions with the lead near and far; a box marks harder braking when near."""
    answers, space = who.model.answers, who.model.answers.space
    far, near, _ = answers.both("lead_far", "lead_near", "response")
    if not len(far):
        return []
    level = {action: space.project(action, "brake") or 0.0 for action in space.actions}
    harder = {(action, other) for action in space.actions for other in space.actions if level[other] > level[action]}
    title = f"Lead far and near, {who.label}"
    note = "framed: brakes harder when the lead is near"
    names = ("lead far", "lead near")
    return [_transitions((f"counterfactual-{place:02d}", title, who.label), (far, near), names, space, harder, note)]


_CURVES: Mapping[str, tuple[str, str, str, str]] = {
    "drawn": ("the lead, at a distance drawn anew", WAYS["blue"], "o", "-"),
    "own": ("the lead, a neighbour kept far", WAYS["purple"], "^", "-"),
    "beside": ("a neighbour, the lead kept far", WAYS["amber"], "s", "--"),
    "hole": ("the lead {holes}", WAYS["vermillion"], "X", ":"),
}
"""Each curve's words, colour, mark and stroke."""
BANDS = "Mean braking where the vehicle stands that far away; band: 90% interval over episodes."
_HEAD, _WHOLE = (4.3, 2.9), (5.6, 3.2)
"""Inches of a figure of curves at the head of a page, and of one on its own."""


def braking(who: Subject, place: int) -> list[Drawing]:
    """Draw braking along the distance, for the lead and for a neighbour, if the run has it."""
    drawn = _braking(who, _WHOLE)
    return [] if drawn is None else [replace(drawn, name=f"braking-{place:02d}", of=who.label, wide=True, note=BANDS)]


def braking_head(who: Subject) -> Drawing | None:
    """Return the same figure for the head of a page, None without pictures along the range."""
    with style():
        drawn = _braking(who, _HEAD)
    return None if drawn is None else replace(drawn, name="in-short")


def _braking(who: Subject, size: tuple[float, float]) -> Drawing | None:
    verdict = who.verdict
    curves = moved_of(who.model.answers).curves() if verdict.numbers else {}
    if not curves:
        return None
    figure, axes = canvas(*size, (0.95, 0.12, 0.5, 0.17 * len(curves) + 0.1))
    unit = who.model.answers.gap.unit if who.model.answers.gap is not None else "m"
    descriptions = []
    for name, windows in curves.items():
        words, colour, mark, stroke = _CURVES[name]
        words = words.format(holes=_of_frames(verdict.holes))
        _curve(axes, windows, colour, mark, stroke, words)
        along = (f"{window.near:.3g} to {window.far:.3g} {unit} {number(window.level.value, 2)}" for window in windows)
        descriptions.append(f"{words}: {', '.join(along)}")
    _distances(axes, [one for many in curves.values() for one in many], unit)
    axes.legend(loc="lower left", bbox_to_anchor=(-0.02, 1.0), frameon=False, fontsize=8.5, borderaxespad=0)
    title = f"Braking by distance, {who.label}"
    return Drawing("braking", title, f"{BANDS} 1 is a full stop. {'. '.join(descriptions)}.", figure)


def _of_frames(holes: Sequence[Place]) -> str:
    """Return in words where braking does not respond; places with equal counts are named once."""
    where = {(hole.harder, hole.frames): hole.where for hole in reversed(holes) if hole.of != "range"}
    first, more = next(reversed(where.values()), ""), len(where) - 1
    return first.replace("`", "") + (f" and {more} more" if more > 0 else "")


def _curve(axes: Axes, windows: Sequence[Window], colour: str, mark: str, stroke: str, words: str) -> None:
    """Draw a curve with its band; a window without an interval has none."""
    middle = [float(np.sqrt(window.near * window.far)) for window in windows]
    axes.plot(
        middle,
        [window.level.value or 0.0 for window in windows],
        color=colour,
        marker=mark,
        markersize=4.5,
        linestyle=stroke,
        linewidth=1.7,
        label=words,
        zorder=3,
    )
    banded = [(x, *window.level.ci) for x, window in zip(middle, windows, strict=True) if window.level.ci is not None]
    if banded:
        x, low, high = zip(*banded, strict=True)
        axes.fill_between(x, np.maximum(low, 0), np.minimum(high, 1), color=colour, alpha=0.16, linewidth=0, zorder=1)


def _distances(axes: Axes, windows: Sequence[Window], unit: str) -> None:
    """Name the axes: distance by ratio, braking from going on to a full stop."""
    near, far = min(window.near for window in windows), max(window.far for window in windows)
    axes.set_xscale("log")
    axes.set_xlim(near, far)
    ticks = [tick for tick in _TICKS if near <= tick <= far]
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.set_xticks([], minor=True)
    axes.set_ylim(-0.04, 1.04)
    axes.set_yticks([0, 0.5, 1], ["goes on", "half", "full stop"])
    axes.grid(axis="y", color=LINE, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.set_xlabel(f"distance ({plain(unit, 8)})", fontsize=8.5)


_TICKS = tuple(step * 10.0**power for power in range(-2, 4) for step in (1, 2, 5))


def _transitions(
    words: tuple[str, str, str],
    pair: tuple[Symbols, Symbols],
    names: tuple[str, str],
    space: AnySpace,
    marked: set[tuple[str, str]],
    note: str,
) -> Drawing:
    rows, columns = pair
    given = space.actions or sorted({*rows.tolist(), *columns.tolist()} - {UNPARSED})
    actions = [*given, *([UNPARSED] if UNPARSED in {*rows.tolist(), *columns.tolist()} else [])]
    size = len(actions)
    labels = [plain(action, 11) for action in actions]
    leaning = size > 5 or max(map(len, labels)) > 8
    top, margin = (0.95 if leaning else 0.5), 0.4 + 0.075 * max(map(len, labels))
    descriptions, framed = [], list[Frame]()
    cells: list[list[Cell]] = [[] for _ in actions]
    for y, one in enumerate(actions):
        total = int((rows == one).sum())
        for x, other in enumerate(actions):
            count = int(((rows == one) & (columns == other)).sum())
            cells[y].append((count / total if total else None, str(count) if total else "", _BLUES))
            if (one, other) in marked:
                framed.append((x - 0.44, y - 0.43, x + 0.44, y + 0.43, ON_COLOUR if total else INK, 1.1))
            if count:
                descriptions.append(f"{one} to {other}: {count}")
    box = (3.5, top + 0.05 + 0.33 * size), (margin, 0.35 if leaning else 0.1, 0.05, top)
    named = GridLabels(labels, labels, 40 if leaning else 0, 7.5, across=names[1], down=names[0])
    figure = grid(*box, cells, named, framed)
    says = f"Rows: {names[0]}; columns: {names[1]}; {note}. {'; '.join(descriptions)}"
    return Drawing(words[0], words[1], says, figure, of=words[2])


MODELS_BESIDE = 4
"""The most models side by side on a narrow page."""


def agreement_down(everyone: Sequence[Subject]) -> list[Drawing]:
    """Draw the figure of agreement for a narrow page: a row per condition, a few models each."""
    drawn = []
    with style():
        for number_of, first in enumerate(range(0, len(everyone), MODELS_BESIDE), 1):
            some = everyone[first : first + MODELS_BESIDE]
            conditions = list(dict.fromkeys(name for who in some for name in who.run.conditions if name != "real"))
            cells = [
                [(share, number(share, 2), colours) for share in (_agree(who, name, reflect=reflect) for who in some)]
                for name in conditions
                for reflect, colours in [(_base(name) == "mirrored", _colours(name, as_paper=False))]
            ]
            size = 1.75 + 0.72 * len(some) + 0.85, 1.35 + 0.31 * max(1, len(conditions))
            who_and_what = [plain(who.label, 22) for who in some], [plain(name, 20) for name in conditions]
            figure = grid(size, (1.75, 0.85, 0.05, 1.3), cells, GridLabels(*who_and_what, rotation=40))
            title = "Agreement with the action given to the real frame"
            says = "The same numbers as in the wide figure, a row per condition and a column per model."
            drawn.append(Drawing(f"agreement-down-{number_of}", title, says, figure))
    return drawn


def figures(everyone: Sequence[Subject]) -> dict[str, list[Drawing]]:
    """Return the figures by section; a section without data has none."""
    with style():
        return {
            "agreement": [agreement(everyone)] if everyone else [],
            "gap": [drawing for place, who in enumerate(everyone, 1) for drawing in gap_by_action(who, place)],
            "information": information(everyone),
            "mirror": [one for place, who in enumerate(everyone, 1) for one in mirror(who, place)],
            "pairs": pairs(everyone),
            "braking": [drawing for place, who in enumerate(everyone, 1) for drawing in braking(who, place)],
            "counterfactual": [one for place, who in enumerate(everyone, 1) for one in counterfactual(who, place)],
            "noise": [noise_floor(everyone)] if everyone else [],
        }
