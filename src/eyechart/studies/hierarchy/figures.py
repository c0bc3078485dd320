"""Figures of the hierarchy: each source's outcome in each paired world, and worlds from above."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.patches import PathPatch, Rectangle
from matplotlib.path import Path as Way

from eyechart.cameras import ROVER
from eyechart.episodes import Episode
from eyechart.errors import EyechartError, LedgerError
from eyechart.frames import Scalar, rounded_truth
from eyechart.report.charts import BLUE, INK, LINE, MUTED, PAPER, SOFT, VERMILLION, WAYS, Drawing, canvas, plain, style
from eyechart.report.page import evenly
from eyechart.simulators.road import FAMILIES, GOAL_M, ROAD_HALF_M, Layout, make_layout
from eyechart.studies.closed_loop import Drives, verify
from eyechart.studies.hierarchy import HierarchyScore, IntentSource
from eyechart.studies.hierarchy.plans import MPC_ONLY, ORACLE, ORACLE_MIRRORED
from eyechart.studies.hierarchy.scores import PUBLISHED, UNPUBLISHED, count_of
from eyechart.studies.hierarchy.tables import of_ablation

_CHECKED = ("lead_gap_m", "free_left_m", "free_middle_m", "free_right_m")
"""The fields of truth at a world's first moment that describe its obstacles."""

_PLACE = ("x_m", "y_m", "yaw", "speed_mps")


@dataclass(frozen=True)
class Trajectory:
    """One episode from above. ``places`` (n, 4): x, y, yaw, speed at each decision and at the end.

    x is along the road and y to the left, in metres; yaw in rad, speed in m/s. ``ended`` is goal,
    crash or time.
    """

    ended: str
    places: npt.NDArray[np.float64]

    @cached_property
    def curve(self) -> npt.NDArray[np.float64]:
        """Return a smooth way through the places, shape (3 n - 2, 2): corners of a cubic Bezier.

        Decisions are a second apart; a rover that turns gently stays near this curve meanwhile.
        """
        x, y, yaw, speed = self.places.T
        at = np.column_stack([x, y])
        chord = np.hypot(*np.diff(at, axis=0).T)
        seconds = np.minimum(1.0, chord / np.maximum((speed[:-1] + speed[1:]) / 2, 1e-3))
        way = np.column_stack([np.cos(yaw), np.sin(yaw)]) * speed[:, None] / 3
        corners = np.empty((3 * len(at) - 2, 2))
        corners[::3] = at
        corners[1::3] = at[:-1] + way[:-1] * seconds[:, None]
        corners[2::3] = at[1:] - way[1:] * seconds[:, None]
        return corners


@dataclass(frozen=True)
class PairedWorld:
    """A world of several sources: its obstacles, and each source's way (None if not driven)."""

    scenario: str
    seed: int
    layout: Layout
    ways: tuple[Trajectory | None, ...]


def paired_worlds(sources: Sequence[Drives]) -> tuple[list[PairedWorld], list[str]]:
    """Return every world with the sources' ways in order, and a note for each that is not drawn.

    A world is left out if its obstacles here differ from those of the record.
    """
    found: dict[tuple[str, int], dict[int, Episode]] = {}
    for number, source in enumerate(sources):
        for episode in source.episodes:
            if episode.steps:
                found.setdefault((episode.key.scenario, episode.key.seed), {})[number] = episode
    worlds, notes = [], []
    for scenario, seed in in_order(found):
        mine = found[scenario, seed]
        first = min(mine)
        if not _is_recorded(sources[first], mine[first]):
            notes.append(f"World {scenario}/{seed} is not drawn: its obstacles here are not those of the record.")
            continue
        ways: list[Trajectory | None] = [None] * len(sources)
        for place, episode in mine.items():
            try:
                ways[place] = trajectory(sources[place], episode)
            except LedgerError as error:
                notes.append(f"A way is not drawn: {error}.")
        worlds.append(PairedWorld(scenario, seed, make_layout(scenario, seed), tuple(ways)))
    return worlds, notes


def in_order(worlds: Iterable[tuple[str, int]]) -> list[tuple[str, int]]:
    """Return worlds, each a scenario and a seed, in the study's order of scenarios."""
    places = {name: place for place, name in enumerate(FAMILIES)}
    return sorted(worlds, key=lambda world: (places.get(world[0], len(places)), world))


def trajectory(drives: Drives, episode: Episode) -> Trajectory:
    """Return an episode's places. If its end was not recorded, it is driven again.

    Raises LedgerError if it then ends differently, or if a place is missing.
    """
    rows = [_place(step.truth) for step in episode.steps]
    last = episode.steps[-1]
    end = last.facts
    if "y_m" not in end:
        end = rounded_truth(verify(drives, episode, drives.open_simulator()), last.frame)
    rows.append(_place({**end, "x_m": last.distance_m, "speed_mps": last.speed_mps}))
    return Trajectory(episode.ended, np.array(rows))


def _place(facts: Mapping[str, Scalar]) -> tuple[float, ...]:
    found = [facts.get(name) for name in _PLACE]
    if not all(isinstance(one, int | float) for one in found):
        raise LedgerError(f"the record lacks a place at some step: it needs {', '.join(_PLACE)}")
    return tuple(float(one or 0.0) for one in found)


def _is_recorded(drives: Drives, episode: Episode) -> bool:
    """Return whether a world has the obstacles of its record here."""
    try:
        drive = drives.open_simulator().drive(episode.key.scenario, episode.key.seed)
    except EyechartError:
        return False
    truth, then = rounded_truth(drive.truth(), episode.steps[0].frame), episode.steps[0].truth
    drive.close()
    return all(truth.get(name) == then.get(name) for name in _CHECKED)


MOST_WORLDS = 48
"""Strips of a group; more worlds are sampled evenly."""
MOST_PLANNERS = 6
"""Planners with a group in each ablation; the figures of outcomes and the tables have all."""
MOST_WAYS = 8
MOST_NOTES = 12

SIGNS = {"goal": "●", "crash": "✕", "time": "○"}
ENDS = {"goal": "reached the goal", "crash": "crashed", "time": "out of time"}
_SOLID, _DASHED, _DOTTED = "solid", (0, (4.0, 1.6)), (0, (1.0, 1.2))
CONDITION_NAMES = {"real": "real pictures", "mirrored": "mirrored", "blank": "blank", "shuffled": "shuffled"}
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
"""Name and line of each scripted source.

Grey and dashed is blind, vermillion is mirrored, ink is the controller that knows the obstacles.
"""


@dataclass(frozen=True)
class SourceStrip:
    """One source in a group of strips: its drives, and their line style."""

    drives: Drives
    name: str
    colour: str
    dash: Any = _SOLID

    @property
    def ink(self) -> str:
        """Return the colour for figures."""
        return INK if self.colour == "ink" else WAYS[self.colour]

    @property
    def variable(self) -> str:
        """Return the colour as a variable of the page's style sheet."""
        return "var(--ink)" if self.colour == "ink" else f"var(--way-{self.colour})"

    @property
    def dashes(self) -> str:
        """Return the dashes for SVG, in widths of a thin line."""
        return "" if self.dash == _SOLID else " ".join(f"{3 * one:g}" for one in self.dash[1])


@dataclass(frozen=True)
class StripGroup:
    """Strips of the same worlds and sources: the scripted ones of an ablation, or one planner's."""

    key: str
    ablation: str
    title: str
    lines: tuple[SourceStrip, ...]
    drawings: tuple[Drawing, ...]
    worlds: int

    @property
    def caption(self) -> str:
        """Return the number of worlds and sources in the group."""
        some = "" if len(self.drawings) == self.worlds else f"{len(self.drawings)} of "
        return f"{some}{self.worlds} worlds, {len(self.lines)} sources in each"


def groups(score: HierarchyScore) -> tuple[list[StripGroup], list[str]]:
    """Return the groups of both ablations, and notes on missing drawings."""
    found, notes = [], []
    with style():
        for ablation in ("primary", "second"):
            driven = [one.driver for part in _parts(ablation) for one in score.drives.get(part, ()) if one.is_model]
            planners = list(dict.fromkeys(one.policy for one in driven))
            if len(planners) > MOST_PLANNERS:
                notes.append(f"Ways of {MOST_PLANNERS} of {len(planners)} planners are drawn; the tables have all.")
            chosen = [("scripted sources", _scripted(score, ablation))]
            chosen += [(name, _planner(score, ablation, name)) for name in planners[:MOST_PLANNERS]]
            for number, (title, lines) in enumerate(chosen):
                if lines:
                    group, said = _group(f"{ablation}-{number}", ablation, title, lines[:MOST_WAYS])
                    found.append(group)
                    notes += [one for one in said if one not in notes]
    more = len(notes) - MOST_NOTES
    return found, [*notes[:MOST_NOTES], *([f"And {more} more ways or worlds are not drawn."] if more > 0 else [])]


def _parts(ablation: str) -> tuple[str, ...]:
    return ("primary", "primary-models") if ablation == "primary" else ("unaware-models", "lateral-models")


def _scripted(score: HierarchyScore, ablation: str) -> list[SourceStrip]:
    lines = []
    for (part, policy), (name, colour, dash) in _SCRIPTED.items():
        if (part == "primary") == (ablation == "primary"):
            lines += [
                SourceStrip(one, name, colour, dash)
                for one in score.drives.get(part, ())
                if one.driver.policy == policy
            ]
    return lines


def _planner(score: HierarchyScore, ablation: str, planner: str) -> list[SourceStrip]:
    context = {"MPC-only", "oracle"} if ablation == "primary" else {"oracle's side"}
    lines = [one for one in _scripted(score, ablation) if one.name in context]
    for part in _parts(ablation):
        full = part == "unaware-models"
        for one in score.drives.get(part, ()):
            if one.driver.policy == planner:
                colour, dash = _PLANNER.get(one.driver.condition, ("amber", _DASHED))
                name = CONDITION_NAMES.get(one.driver.condition, one.driver.condition)
                lines.append(
                    SourceStrip(
                        one, f"{one.driver.condition} + speed" if full else name, colour, _DOTTED if full else dash
                    )
                )
    return lines


def _group(key: str, ablation: str, title: str, lines: Sequence[SourceStrip]) -> tuple[StripGroup, list[str]]:
    worlds, notes = paired_worlds([line.drives for line in lines])
    shown = evenly(worlds, MOST_WORLDS)
    if len(shown) < len(worlds):
        notes.append(
            f"{len(shown)} of {len(worlds)} worlds are drawn from above, evenly taken; every number counts all."
        )
    drawings = tuple(_strip(key, world, lines) for world in shown)
    return StripGroup(key, ablation, title, tuple(lines), drawings, len(worlds)), notes


def _strip(key: str, world: PairedWorld, lines: Sequence[SourceStrip]) -> Drawing:
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
    description = "; ".join(f"{line.name}: {_words(way)}" for way, line in zip(world.ways, lines, strict=True))
    says = f"The road from above, {len(world.layout.obstacles)} obstacles. {description}."
    return Drawing(f"ways-{key}-{world.scenario}-{world.seed}", title, says, figure, lean=True)


def _road(axes: Axes, world: PairedWorld) -> None:
    """Draw the road with its lines, and each obstacle in a ring half a rover wide."""
    axes.set_axis_off()
    axes.add_patch(Rectangle((-2, -ROAD_HALF_M), GOAL_M + 5, 2 * ROAD_HALF_M, facecolor=SOFT, edgecolor="none"))
    axes.hlines((-ROAD_HALF_M, ROAD_HALF_M), -2, GOAL_M + 3, colors=MUTED, linewidth=0.7)
    axes.hlines((-1.0, 1.0), -2, GOAL_M, colors=LINE, linewidth=0.8, linestyles=(0, (5, 4)))
    axes.vlines(GOAL_M, -ROAD_HALF_M, ROAD_HALF_M, colors=INK, linewidth=1.0)
    for wider, alpha in ((ROVER.radius_m, 0.3), (0.0, None)):
        discs = [Way.circle((obstacle.x, obstacle.y), obstacle.radius + wider) for obstacle in world.layout.obstacles]
        if discs:
            axes.add_patch(PathPatch(Way.make_compound_path(*discs), facecolor=MUTED, edgecolor="none", alpha=alpha))
    for x, word in ((0, "0"), (25, "25"), (50, "50"), (75, "75"), (GOAL_M, "100 m")):
        axes.text(x, -ROAD_HALF_M - 0.5, word, ha="center", va="top", fontsize=7.5, color=MUTED)


def _way(axes: Axes, way: Trajectory, line: SourceStrip, width: float, gid: str) -> None:
    codes = [Way.MOVETO, *[Way.CURVE4] * (len(way.curve) - 1)]
    drawn = PathPatch(
        Way(way.curve, codes), facecolor="none", edgecolor=line.ink, linewidth=width, linestyle=line.dash, zorder=3
    )
    drawn.set_gid(f"{gid}-way")
    axes.add_patch(drawn)


def _end(axes: Axes, way: Trajectory, line: SourceStrip, gid: str) -> None:
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


def _label(axes: Axes, way: Trajectory | None, line: SourceStrip, y: float, gid: str) -> None:
    """Name a source next to the road, with the sign of its end and its distance."""
    where: dict[str, Any] = {"transform": axes.transAxes, "va": "center", "fontsize": 8.4}
    sign = "–" if way is None else SIGNS.get(way.ended, "?")
    axes.text(1.015, y, sign, color=line.ink, gid=f"{gid}-sign", **{**where, "fontsize": 8.5})
    far = "" if way is None or way.ended == "goal" else f" {way.places[-1, 0]:.0f} m"
    axes.text(1.052, y, plain(line.name, 24) + far, color=INK, gid=f"{gid}-name", **where)


def _words(way: Trajectory | None) -> str:
    if way is None:
        return "did not drive here"
    return f"{ENDS.get(way.ended, way.ended)} at {way.places[-1, 0]:.1f} m"


MOST_ROWS = 40
MOST_COLUMNS = 60
"""Sources and worlds in a figure; the tables have all of them."""
_ROW_IN = 0.235


def outcomes(score: HierarchyScore, ablation: str) -> Drawing | None:
    """Draw a row a source and a column a world (goal, crash, time), and the shares of goals."""
    rows = of_ablation(score.sources, ablation)[:MOST_ROWS]
    if not rows:
        return None
    ended = [_ended(score, row) for row in rows]
    every = in_order({world for one in ended for world in one})
    worlds = evenly(every, MOST_COLUMNS)
    with style():
        labels = [plain(row.name, 34) for row in rows]
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
    description = "; ".join(f"{label}: {count_of(row.goals)} goals" for label, row in zip(labels, rows, strict=True))
    name = "Primary" if ablation == "primary" else "Second"
    title = f"{name} ablation: the outcome of each source in the same {len(every)} worlds"
    says = (
        f"Rows are sources, columns worlds: a dot is the goal, a cross a crash, a ring the time limit. {description}."
    )
    return Drawing(f"outcomes-{ablation}", title, says, figure, wide=True)


def _ended(score: HierarchyScore, row: IntentSource) -> Mapping[tuple[str, int], str]:
    drives = next(one for one in score.drives[row.part] if one.driver == row.driver)
    every: Sequence[Episode] = (*drives.episodes, *drives.errors)
    return {(episode.key.scenario, episode.key.seed): episode.ended for episode in every}


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


def _shares(axes: Axes, rows: Sequence[IntentSource]) -> None:
    axes.set_facecolor("none")
    axes.set_xlim(-4, 104)
    axes.set_ylim(len(rows) - 0.4, -0.6)
    for y, row in enumerate(rows):
        axes.axhline(y, color=LINE, linewidth=0.5, zorder=0)
        paper = PUBLISHED.get(row.name, UNPUBLISHED)
        if row.goals.ci is not None:
            axes.plot([100 * end for end in row.goals.ci], [y, y], color=BLUE, linewidth=1.6, zorder=2)
        if row.goals.value is not None:
            axes.scatter([100 * row.goals.value], [y], s=26, color=BLUE, zorder=3)
        if paper[0]:
            goals, _, of = paper[0].partition("/")
            at = 100 * int(goals) / int(of)
            axes.scatter([at], [y], 34, marker="D", facecolors=PAPER, edgecolors=INK, linewidths=1.0, zorder=2.5)
        axes.text(1.06, y, count_of(row.goals), transform=axes.get_yaxis_transform(), va="center", fontsize=8)
    axes.set_yticks([])
    axes.set_xticks([0, 50, 100])
    axes.set_xlabel("goals (%), 95 %\n◇ the paper's", fontsize=8)
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)
