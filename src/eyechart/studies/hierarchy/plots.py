"""The hierarchy from above: a strip a world with the road, what stands on it, and the way of each source."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from matplotlib.axes import Axes
from matplotlib.patches import PathPatch, Rectangle
from matplotlib.path import Path as Way

from eyechart.cameras import ROVER
from eyechart.report.charts import INK, LINE, MUTED, PAPER, SOFT, WAYS, Drawing, canvas, plain, style
from eyechart.report.page import evenly
from eyechart.simulators.road import GOAL_M, ROAD_HALF_M
from eyechart.studies.closed_loop import Drives
from eyechart.studies.hierarchy import HierarchyScore
from eyechart.studies.hierarchy.planning import MPC_ONLY, ORACLE, ORACLE_MIRRORED
from eyechart.studies.hierarchy.trajectories import PairedWorld, Trajectory, paired_worlds

MOST_WORLDS = 48
"""Strips of a group; of more worlds, so many evenly taken."""
MOST_PLANNERS = 6
"""Planners that have a group in each ablation; the figures of outcomes and the tables have all of them."""
MOST_WAYS = 8
MOST_NOTES = 12

SIGNS = {"goal": "●", "crash": "✕", "time": "○"}
ENDS = {"goal": "reached the goal", "crash": "crashed", "time": "out of time"}
_SOLID, _DASHED, _DOTTED = "solid", (0, (4.0, 1.6)), (0, (1.0, 1.2))
CONDITION_NAMES = {"real": "real pictures", "mirrored": "mirrored", "blank": "blank", "shuffled": "other worlds'"}
_PLANNER = {
    "real": ("blue", _SOLID),
    "mirrored": ("vermillion", _SOLID),
    "blank": ("grey", _DASHED),
    "shuffled": ("purple", _DASHED),
}
_SCRIPTED: dict[tuple[str, str], tuple[str, str, Any]] = {
    ("primary", MPC_ONLY): ("MPC-only", "ink", _SOLID),
    ("primary", ORACLE): ("oracle", "green", _SOLID),
    ("primary", "random"): ("random", "purple", _SOLID),
    ("primary", "constant:LEFT"): ("always LEFT", "amber", _DASHED),
    ("primary", "constant:RIGHT"): ("always RIGHT", "amber", _DOTTED),
    ("primary", "constant:SLOW"): ("always SLOW", "grey", _DASHED),
    ("primary", "constant:STOP"): ("always STOP", "grey", _DOTTED),
    ("constrained", MPC_ONLY): ("mpc-oracle", "ink", _SOLID),
    ("unaware", MPC_ONLY): ("mpc-blind", "grey", _DASHED),
    ("lateral", ORACLE): ("oracle's side", "green", _SOLID),
    ("lateral", ORACLE_MIRRORED): ("its mirror", "vermillion", _SOLID),
}
"""How each scripted source is called and drawn: grey and dashed is blind, vermillion is mirrored, ink is the controller
that knows the obstacles."""


@dataclass(frozen=True)
class Line:
    """One source in a group of strips: its drives, and how they are drawn."""

    drives: Drives
    name: str
    colour: str
    dash: Any = _SOLID

    @property
    def ink(self) -> str:
        """Return the colour as figures write it."""
        return INK if self.colour == "ink" else WAYS[self.colour]

    @property
    def variable(self) -> str:
        """Return the colour as a page's style sheet has it."""
        return "var(--ink)" if self.colour == "ink" else f"var(--way-{self.colour})"

    @property
    def dashes(self) -> str:
        """Return the dashes as SVG has them, in widths of a thin line."""
        return "" if self.dash == _SOLID else " ".join(f"{3 * one:g}" for one in self.dash[1])


@dataclass(frozen=True)
class Group:
    """Strips of the same worlds with the same sources: all scripted ones of an ablation, or one planner's."""

    key: str
    ablation: str
    title: str
    lines: tuple[Line, ...]
    drawings: tuple[Drawing, ...]
    worlds: int

    @property
    def caption(self) -> str:
        """Return how many worlds and sources are shown."""
        some = "" if len(self.drawings) == self.worlds else f"{len(self.drawings)} of "
        return f"{some}{self.worlds} worlds, {len(self.lines)} sources in each"


def groups(score: HierarchyScore) -> tuple[list[Group], list[str]]:
    """Return the groups of both ablations, and in words what is not drawn."""
    found, notes = [], []
    with style():
        for ablation in ("primary", "second"):
            planners = _planners(score, ablation)
            if len(planners) > MOST_PLANNERS:
                notes.append(f"Ways of {MOST_PLANNERS} of {len(planners)} planners are drawn; the tables have all.")
            chosen = [("scripted sources", _scripted(score, ablation))]
            chosen += [(name, _planner(score, ablation, name)) for name in planners[:MOST_PLANNERS]]
            for number, (title, lines) in enumerate(chosen):
                if lines:
                    group, said = _group(f"{ablation}-{number}", ablation, title, lines[:MOST_WAYS])
                    found.append(group)
                    notes += [one for one in said if one not in notes]
    return found, _few(notes)


def _parts(ablation: str) -> tuple[str, ...]:
    return ("primary", "primary-models") if ablation == "primary" else ("unaware-models", "lateral-models")


def _planners(score: HierarchyScore, ablation: str) -> list[str]:
    every = [one.driver.policy for part in _parts(ablation) for one in score.drives.get(part, ()) if one.asked]
    return list(dict.fromkeys(every))


def _scripted(score: HierarchyScore, ablation: str) -> list[Line]:
    lines = []
    for (part, policy), (name, colour, dash) in _SCRIPTED.items():
        if (part == "primary") == (ablation == "primary"):
            lines += [
                Line(one, name, colour, dash) for one in score.drives.get(part, ()) if one.driver.policy == policy
            ]
    return lines


def _planner(score: HierarchyScore, ablation: str, planner: str) -> list[Line]:
    context = {"MPC-only", "oracle"} if ablation == "primary" else {"oracle's side"}
    lines = [one for one in _scripted(score, ablation) if one.name in context]
    for part in _parts(ablation):
        full = part == "unaware-models"
        for one in score.drives.get(part, ()):
            if one.driver.policy == planner:
                colour, dash = _PLANNER.get(one.driver.condition, ("amber", _DASHED))
                name = CONDITION_NAMES.get(one.driver.condition, one.driver.condition)
                lines.append(
                    Line(one, f"{one.driver.condition} + speed" if full else name, colour, _DOTTED if full else dash)
                )
    return lines


def _few(notes: Sequence[str]) -> list[str]:
    more = len(notes) - MOST_NOTES
    return [*notes[:MOST_NOTES], *([f"And {more} more ways or worlds are not drawn."] if more > 0 else [])]


def _group(key: str, ablation: str, title: str, lines: Sequence[Line]) -> tuple[Group, list[str]]:
    worlds, notes = paired_worlds([one.drives for one in lines])
    shown = evenly(worlds, MOST_WORLDS)
    if len(shown) < len(worlds):
        notes.append(
            f"{len(shown)} of {len(worlds)} worlds are drawn from above, evenly taken; every number counts all."
        )
    drawings = tuple(_strip(key, world, lines) for world in shown)
    return Group(key, ablation, title, tuple(lines), drawings, len(worlds)), notes


def _strip(key: str, world: PairedWorld, lines: Sequence[Line]) -> Drawing:
    height = max(0.98, 0.24 + 0.15 * len(lines))
    figure, axes = canvas(5.7, height, (0.06, 1.62, 0.19, 0.03))
    axes.set_xlim(-2.0, GOAL_M + 3.0)
    axes.set_ylim(-ROAD_HALF_M - 0.7, ROAD_HALF_M + 0.7)
    _road(axes, world)
    widths = [1.2 + 0.45 * (len(lines) - 1 - number) for number in range(len(lines))]
    for number, (way, line) in enumerate(zip(world.ways, lines, strict=True), 1):
        if way is not None:
            _way(axes, way, line, widths[number - 1], f"k{number}")
    for number, (way, line) in enumerate(zip(world.ways, lines, strict=True), 1):
        if way is not None:
            _end(axes, way, line, f"k{number}")
        _label(axes, way, line, 1.0 - (number - 0.5) / len(lines), f"k{number}")
    closed = ", closed by a wall" if world.layout.closed else ""
    title = f"{world.scenario}, seed {world.seed}{closed}"
    told = "; ".join(f"{line.name}: {_words(way)}" for way, line in zip(world.ways, lines, strict=True))
    says = f"The road from above, {len(world.layout.obstacles)} obstacles. {told}."
    return Drawing(f"ways-{key}-{world.scenario}-{world.seed}", title, says, figure, lean=True)


def _road(axes: Axes, world: PairedWorld) -> None:
    """Draw the road and its lines, and each obstacle in a ring that is as wide as half the rover."""
    axes.set_axis_off()
    axes.add_patch(Rectangle((-2, -ROAD_HALF_M), GOAL_M + 5, 2 * ROAD_HALF_M, facecolor=SOFT, edgecolor="none"))
    axes.hlines((-ROAD_HALF_M, ROAD_HALF_M), -2, GOAL_M + 3, colors=MUTED, linewidth=0.7)
    axes.hlines((-1.0, 1.0), -2, GOAL_M, colors=LINE, linewidth=0.8, linestyles=(0, (5, 4)))
    axes.vlines(GOAL_M, -ROAD_HALF_M, ROAD_HALF_M, colors=INK, linewidth=1.0)
    for wider, alpha in ((ROVER.radius_m, 0.3), (0.0, None)):
        discs = [_disc(one.x, one.y, one.radius + wider) for one in world.layout.obstacles]
        if discs:
            axes.add_patch(PathPatch(Way.make_compound_path(*discs), facecolor=MUTED, edgecolor="none", alpha=alpha))
    for x, word in ((0, "0"), (25, "25"), (50, "50"), (75, "75"), (GOAL_M, "100 m")):
        axes.text(x, -ROAD_HALF_M - 0.5, word, ha="center", va="top", fontsize=7.5, color=MUTED)


def _disc(x: float, y: float, radius: float) -> Way:
    return Way.circle((x, y), radius)


def _way(axes: Axes, way: Trajectory, line: Line, width: float, gid: str) -> None:
    codes = [Way.MOVETO, *[Way.CURVE4] * (len(way.curve) - 1)]
    drawn = PathPatch(
        Way(way.curve, codes), facecolor="none", edgecolor=line.ink, linewidth=width, linestyle=line.dash, zorder=3
    )
    drawn.set_gid(f"{gid}-way")
    axes.add_patch(drawn)


def _end(axes: Axes, way: Trajectory, line: Line, gid: str) -> None:
    x, y = float(way.places[-1, 0]), float(way.places[-1, 1])
    if way.ended == "crash":
        for colour, wide in ((PAPER, 3.4), (line.ink, 1.7)):
            axes.plot(
                [x], [y], "x", color=colour, markersize=6.5, markeredgewidth=wide, zorder=5, gid=f"{gid}-end{wide}"
            )
        return
    face = line.ink if way.ended == "goal" else PAPER
    edge = PAPER if way.ended == "goal" else line.ink
    axes.plot(
        [x], [y], "o", color=face, markeredgecolor=edge, markersize=5.5, markeredgewidth=1.1, zorder=5, gid=f"{gid}-end"
    )


def _label(axes: Axes, way: Trajectory | None, line: Line, y: float, gid: str) -> None:
    """Name a source beside the road, with the sign of its end, and how far it came where that is not the goal."""
    where: dict[str, Any] = {"transform": axes.transAxes, "va": "center", "fontsize": 8.4}
    sign = "–" if way is None else SIGNS.get(way.ended, "?")
    axes.text(1.015, y, sign, color=line.ink, gid=f"{gid}-sign", **{**where, "fontsize": 8.5})
    far = "" if way is None or way.ended == "goal" else f" {way.places[-1, 0]:.0f} m"
    axes.text(1.052, y, plain(line.name, 24) + far, color=INK, gid=f"{gid}-name", **where)


def _words(way: Trajectory | None) -> str:
    if way is None:
        return "did not drive here"
    return f"{ENDS.get(way.ended, way.ended)} at {way.places[-1, 0]:.1f} m"
