"""Figures that compare models: agreement, information, counterfactual pairs and the noise floor.

Source: paper, figures bicb (agreement) and mi (entropy against information).
"""

from collections.abc import Iterator, Sequence

from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.patches import Rectangle
from matplotlib.transforms import Bbox

from eyechart.report.drawing import BLUE, INK, LINE, MUTED, PAPER, VERMILLION, Drawing, canvas, cell, grid, plain, room
from eyechart.report.evidence import Subject
from eyechart.report.table import number

_REDS = LinearSegmentedColormap.from_list("same", ["#ffffff", "#fddbc7", "#ef8a62", "#b2182b"])
FLOOR_FACTOR = 1.5
"""IDI clears the noise floor s above so many times s."""

_OUTCOMES = (("harder near", VERMILLION, ""), ("alike", LINE, ""), ("harder far", BLUE, "////"))

Box = tuple[float, float, float, float]
"""Left, bottom, right and top, in pixels."""


def agreement(everyone: Sequence[Subject]) -> Drawing:
    """Draw how often each condition gets the action of the real frame (figure bicb): red is the same action."""
    conditions = list(dict.fromkeys(name for who in everyone for name in who.run.conditions if name != "real"))
    shares = [[_agree(who, name) for name in conditions] for who in everyone]
    left = room([who.label for who in everyone])
    width, height = left + 0.75 + 0.56 * max(1, len(conditions)), 1.0 + 0.31 * len(everyone)
    figure, axes = canvas(width, height, (left, 0.75, 0.05, 0.95))
    for y, row in enumerate(shares):
        for x, share in enumerate(row):
            cell(axes, x, y, share, number(share, 2), _REDS)
    if "real_repeat" in conditions:
        x = conditions.index("real_repeat")
        axes.add_patch(Rectangle((x - 0.5, -0.5), 1, len(everyone), fill=False, edgecolor=INK, linewidth=1.6, zorder=5))
    labels = [f"{name}\n(noise floor)" if name == "real_repeat" else name for name in conditions]
    grid(axes, labels, [plain(who.label, 34) for who in everyone], rotation=40)
    told = "; ".join(
        f"{who.label}: " + ", ".join(f"{name} {number(share, 2)}" for name, share in zip(conditions, row, strict=True))
        for who, row in zip(everyone, shares, strict=True)
    )
    title = "Agreement with the action given to the real frame"
    says = f"Red means the same action whether or not it can see. Rows are models, columns conditions. {told}"
    return Drawing("agreement", title, says, figure, wide=True)


def _agree(who: Subject, condition: str) -> float | None:
    """Return the share of frames with the response that the real frame got."""
    apart, _ = who.model.answers.distance("real", condition, "response")
    return float((apart == 0).mean()) if len(apart) else None


def information(everyone: Sequence[Subject]) -> list[Drawing]:
    """Draw action entropy against mutual information with the gap (figure mi), each model by its name."""
    points = []
    for who in everyone:
        found = who.model.statistics
        x, y = found["entropy"].value, found["mutual_information.decision"].value
        if x is not None and y is not None:
            points.append((who, x, y))
    if not points:
        return []
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
    labelled(axes, [(who.label, x, y) for who, x, y in points])
    told = "; ".join(f"{who.label}: entropy {x:.2f}, information {y:.3f}" for who, x, y in points)
    missing = [who.label for who in everyone if who.label not in {one.label for one, _, _ in points}]
    without = f" Cannot say: {', '.join(missing)}." if missing else ""
    title = "Action entropy against mutual information with the gap"
    says = f"High entropy with information near 0 (lower right) is variety without sight. {told}.{without}"
    return [Drawing("information", title, says, figure, wide=True)]


def labelled(axes: Axes, points: Sequence[tuple[str, float, float]]) -> None:
    """Draw the points, and each name at the nearest place where it covers no other name."""
    inverse = axes.transData.inverted()
    taken: list[Box] = []
    seen = sorted(points, key=lambda one: (one[1], one[2], one[0]))
    pixels = [axes.transData.transform((x, y)) for _, x, y in seen]
    taken += [(float(x) - 4, float(y) - 4, float(x) + 4, float(y) + 4) for x, y in pixels]
    bounds = axes.get_window_extent()
    for (name, x, y), (px, py) in zip(seen, pixels, strict=True):
        label = plain(name, 30)
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


def pairs(everyone: Sequence[Subject]) -> list[Drawing]:
    """Draw how many counterfactual pairs each model brakes harder near, alike, and harder far."""
    counted = [(who, pair_counts(who)) for who in everyone]
    counted = [(who, counts) for who, counts in counted if sum(counts)]
    if not counted:
        return []
    left = room([who.label for who, _ in counted])
    figure, axes = canvas(left + 5.6, 0.95 + 0.3 * len(counted), (left, 0.25, 0.5, 0.4))
    told = []
    for y, (who, counts) in enumerate(counted):
        start, total = 0.0, sum(counts)
        for count, (_, colour, hatch) in zip(counts, _OUTCOMES, strict=True):
            _bar(axes, (start, count / total, y), count, colour, hatch)
            start += count / total
        told.append(f"{who.label}: {pair_words(counts)}")
    axes.set_ylim(len(counted) - 0.4, -0.6)
    axes.set_xlim(0, 1)
    axes.set_yticks(range(len(counted)), [plain(who.label, 34) for who, _ in counted])
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.set_xlabel("share of pairs with two decisions")
    for words, colour, hatch in _OUTCOMES:
        axes.add_patch(
            Rectangle((0, -9), 0, 0, facecolor=colour, hatch=hatch, edgecolor=PAPER, linewidth=0, label=words)
        )
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=3, frameon=False, fontsize=8.5, borderaxespad=0)
    title = "Counterfactual pairs: braking with the lead near against far"
    return [Drawing("counterfactual-pairs", title, "; ".join(told), figure, wide=True)]


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
    """Return how many counterfactual pairs were braked harder near, alike, and harder far."""
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
    return f"{harder} of {sum(counts)} pairs are braked harder near, {softer} harder far, {alike} alike"


def noise_floor(everyone: Sequence[Subject]) -> Drawing:
    """Draw s, IDI and 1.5 s of each model: the paper asks that IDI stands above 1.5 s."""
    left = room([who.label for who in everyone])
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
