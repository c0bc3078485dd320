"""Figures of policies: each channel's share, and one moment with each channel exchanged."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import cycle, pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, MaxNLocator

from eyechart.channels import CAMERA, CAMERAS, INSTRUCTION, STATE, channels_of, instruction_column
from eyechart.errors import EyechartError, counted, listed
from eyechart.frames import FrameBank, decode
from eyechart.report.charts import (
    BLUE,
    INK,
    LINE,
    MUTED,
    PAPER,
    SOFT,
    VERMILLION,
    WAYS,
    Drawing,
    canvas,
    named_rows,
    shorten_middle,
    style,
    width_of,
)
from eyechart.report.short_names import shorten
from eyechart.report.table import number
from eyechart.spaces.motion import PLACES, MotionSpace
from eyechart.stats.shares import shown_share
from eyechart.stats.statistic import Statistic
from eyechart.studies.policy.motions import Floats, Motions
from eyechart.studies.policy.scores import PolicyResult
from eyechart.studies.policy.training_curve import TrainingCurve
from eyechart.verdicts.labels import USES
from eyechart.verdicts.policy_rules import AxisVerdict
from eyechart.verdicts.policy_verdict import PolicyVerdict
from eyechart.verdicts.share_predicates import IGNORED, USED, is_ignored, is_used

_TICKS = (0, 0.1, 0.3, 0.6, 1, 2, 4)
_OF_ALL = {
    f"swapped@{CAMERAS}": "another episode's pictures",
    "named_plus": "the named object moved",
    f"swapped@{INSTRUCTION}": "another instruction",
    f"swapped@{STATE}": "another episode's state",
}
"""The conditions whose motion is drawn at a moment, and what each changes."""
_OF_PICTURES = {f"matched@{CAMERAS}": "pictures at a similar state", "blank": "grey pictures"}
"""Conditions of pictures alone; the first moment is drawn again under them, camera by camera."""
_OF_THE_WORLD = {
    "exchanged": "the objects' colours exchanged",
    "other_plus": "the other object moved",
    "recoloured": "another table",
    "decoys": "further objects",
}
"""Conditions that a simulator draws; the first moment is drawn again under them."""
_LINES: Sequence[tuple[str, Any]] = (
    (WAYS["vermillion"], "-"),
    (WAYS["blue"], (0, (5, 1.5))),
    (WAYS["purple"], (0, (1.2, 1.2))),
    (WAYS["amber"], (0, (6, 1.5, 1.2, 1.5))),
    (WAYS["green"], (0, (3, 3))),
)
"""The lines of the conditions; no figure has more, and each has its own colour and dashes."""
_OWN, _OWN_WIDTH = "its answer", 2.6
_MOMENTS = 2
STRETCHED = "The axis is stretched near 0 (square root)."
MARGINS = f"Shaded, 0 to {USED:g}: too small to count as used. Below the dashed line, {IGNORED:g}: ignored."
ABOVE_ONE = (
    "The share is of the policy's own variation between moments. Above 1, the exchange changes its answer more than "
    "another moment does."
)


@dataclass(frozen=True)
class MotionLine:
    """A motion as drawn: the change in words, colour, dashes, and numbers (steps, dimensions)."""

    words: str
    colour: str
    dashes: Any
    numbers: Floats

    @property
    def width(self) -> float:
        """Return the line's width: the policy's own answer stands out."""
        return _OWN_WIDTH if self.words == _OWN else 1.5


def shares(judged: PolicyVerdict, policy: PolicyResult) -> Iterator[Drawing]:
    """Draw each channel's share, similar-state and grey pictures included, with both margins.

    A row with an undecided axis is hollow, whatever its interval. Yields nothing if no share has a
    value.
    """
    rows = [(_in_words(name), one, _channel(judged, name)) for name, one in _drawn(policy)]
    if not rows:
        return
    names = [name for name, *_ in rows]
    with style():
        left = 0.2 + max(width_of(name, 8.5) for name in names)
        figure, axes = canvas(left + 2.75, 0.7 + 0.25 * len(rows), (left, 0.15, 0.5, 0.08))
        axes.set_xscale("function", functions=(np.sqrt, np.square))
        axes.axvspan(0, USED, color=SOFT, zorder=0)
        axes.axvline(IGNORED, color=MUTED, linewidth=0.9, linestyle=(0, (4, 3)), zorder=1)
        for y, (_, one, channel) in enumerate(rows):
            _interval(axes, y, one, _colour(one, _axes(judged)[channel]))
        named_rows(axes, names, 0.5)
        axes.tick_params(axis="y", pad=7)
        axes.set_xlim(0, min(_FAR, max([1.2, *map(_end, (one for _, one, _ in rows))]) * 1.05))
        ticks = [tick for tick in _TICKS if tick <= axes.get_xlim()[1]]
        axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        axes.set_xlabel("share of its own variation (T)", fontsize=8.5)
    description = "; ".join(f"{name} {number(shown_share(one).value, 3)}" for name, one, _ in rows)
    frames = sorted({one.n for _, one, _ in rows})
    of = f"{frames[0]} to {frames[-1]}" if len(frames) > 1 else f"{frames[0]}"
    spec = judged.model
    title = f"How much each channel carries for {spec}: blue is used, orange ignored, hollow grey is open"
    title = f"{title}; 98 % intervals, {of} frames"
    note = [
        "Each row says what is exchanged.",
        MARGINS,
        STRETCHED,
        *_of_open(judged, [channel for *_, channel in rows]),
        *_of_similar(names),
    ]
    note += [ABOVE_ONE] if any(_end(one) > 1 for _, one, _ in rows) else []
    yield Drawing(_slug(f"shares-{spec}"), title, f"Shares. {description}", figure, note=" ".join(note))


def _drawn(policy: PolicyResult) -> Iterator[tuple[str, Statistic]]:
    """Yield the name and value of each share that has a row."""
    for name, statistic in policy.statistics.items():
        if (
            name.startswith("T.")
            and name.removeprefix("T.").partition("@")[0] in _INSTEAD
            and statistic.value is not None
        ):
            yield name, statistic


def _in_words(name: str) -> str:
    """Return a share's name in words: ``T.matched@camera:top`` is 'top: at a similar state'."""
    base, _, channel = name.removeprefix("T.").partition("@")
    what = channel.removeprefix(CAMERA) or CAMERAS
    return f"{what if len(what) <= _LONGEST else f'…{what[1 - _LONGEST :]}'}: {_INSTEAD[base]}"


_LONGEST, _FAR = 14, 4.5
_SIMILAR = "at a similar state"
_INSTEAD = {
    "swapped": "another episode's",
    "matched": _SIMILAR,
    "blank": "grey",
    "exchanged": "colours exchanged",
}


def _axes(judged: PolicyVerdict) -> dict[str, AxisVerdict]:
    """Return the verdict on each channel."""
    cameras = {f"{CAMERA}{name}": camera for name, camera in judged.cameras.items()}
    return {CAMERAS: judged.camera, **cameras, STATE: judged.state, INSTRUCTION: judged.instruction}


def _channel(judged: PolicyVerdict, name: str) -> str:
    """Return the channel of a share: ``T.blank@top`` is the top camera's, ``T.blank`` is of all."""
    channel, axes = name.rpartition("@")[2], _axes(judged)
    return next((one for one in (channel, f"{CAMERA}{channel}") if one in axes), CAMERAS)


def _colour(statistic: Statistic, axis: AxisVerdict) -> str:
    """Return the colour of a share: grey if it or its axis is undecided."""
    if USES[axis.label].is_open:
        return MUTED
    return BLUE if is_used(statistic) else VERMILLION if is_ignored(statistic) else MUTED


def _of_open(judged: PolicyVerdict, channels: Sequence[str]) -> Iterator[str]:
    """Yield a sentence that names the undecided channels with a row, if there are any."""
    axes = _axes(judged)
    found = [axis.removeprefix(CAMERA) for axis in axes if axis in channels and USES[axes[axis].label].is_open]
    if found:
        which = listed(found)
        yield f"Hollow because the verdict is undecided, whatever the interval: {which}. The line below says why."


def _of_similar(names: Sequence[str]) -> Iterator[str]:
    if any(name.endswith(_SIMILAR) for name in names):
        yield "At a similar state: the moment of another episode with the nearest state."


def _end(statistic: Statistic) -> float:
    """Return how far a share reaches."""
    return max(statistic.value or 0, 0 if statistic.ci is None else statistic.ci[1])


def _interval(axes: Axes, y: int, statistic: Statistic, colour: str) -> None:
    axes.axhline(y, color=LINE, linewidth=0.6, zorder=0)
    if statistic.ci is not None:
        axes.plot(np.clip(statistic.ci, 0, _FAR), [y, y], color=colour, lw=1.8, solid_capstyle="butt", zorder=2)
    if statistic.value is not None:
        _dot(axes, _on_page(statistic.value), y, colour)


def _dot(axes: Axes, x: float, y: float, colour: str) -> None:
    """Draw a share: filled if it is decided, hollow if it is open."""
    face = PAPER if colour == MUTED else colour
    axes.scatter([x], [y], s=28, facecolors=face, edgecolors=colour, linewidths=1.4, zorder=3, clip_on=False)


def training(course: TrainingCurve) -> Drawing:
    """Draw each channel's share against the training step, a row each, with the margins."""
    names = course.channels
    points = [(checkpoint.step or 0, checkpoint.verdict, checkpoint.shares) for checkpoint in course.checkpoints]
    every = [one for *_, each in points for one in each.values()]
    far, high = max([1.2, *map(_end, every)]), 0.95
    with style():
        figure = Figure(figsize=(4.4, 0.55 + high * len(names)))
        whole = figure.get_size_inches()[1]
        for row, name in enumerate(names):
            box = (0.62 / 4.4, (whole - high * (row + 1) + 0.1) / whole, 3.66 / 4.4, (high - 0.3) / whole)
            axes = figure.add_axes(box)
            _share_axis(axes, min(_FAR, far * 1.05))
            axes.set_title(name, fontsize=8.5, loc="left", pad=2)
            here = [(step, each[name], verdict) for step, verdict, each in points if name in each]
            _shares_by_step(axes, [(step, one, _axes(verdict)[_channel(verdict, name)]) for step, one, verdict in here])
            axes.set_xlim(*_around([step for step, *_ in points]))
            axes.set_xticks(*_steps([step for step, *_ in points]))
            axes.tick_params(labelbottom=row == len(names) - 1, labelsize=7.5)
        axes.set_xlabel("step of the training", fontsize=8.5)
    description = "; ".join(
        f"{name} "
        + ", ".join(f"{number(shown_share(each[name]).value, 2)} at {step}" for step, _, each in points if name in each)
        for name in names
    )
    title = "When did it stop looking? Each channel's share by step: blue is used, orange ignored, hollow grey is open"
    note = ["98 % intervals.", MARGINS, STRETCHED, "Open: its interval, or the verdict on its channel, is undecided."]
    note += [ABOVE_ONE] if any(_end(one) > 1 for one in every) else []
    return Drawing(
        "training", title, f"Shares with 98 % intervals, by step. {description}", figure, note=" ".join(note)
    )


def _shares_by_step(axes: Axes, shares: Sequence[tuple[int, Statistic, AxisVerdict]]) -> None:
    """Draw a channel's shares joined, each with its interval, in the colour of its verdict."""
    held = [(step, one, axis) for step, one, axis in shares if one.value is not None]
    axes.plot([step for step, *_ in held], [_on_page(one.value) for _, one, _ in held], color=LINE, lw=1, zorder=1)
    for step, one, axis in held:
        colour = _colour(one, axis)
        if one.ci is not None:
            axes.plot([step, step], np.clip(one.ci, 0, _FAR), color=colour, lw=1.8, zorder=2)
        _dot(axes, step, _on_page(one.value), colour)


def _share_axis(axes: Axes, far: float) -> None:
    """Make the vertical axis one of shares, with the two margins."""
    axes.set_yscale("function", functions=(np.sqrt, np.square))
    axes.axhspan(0, USED, color=SOFT, zorder=0)
    axes.axhline(IGNORED, color=MUTED, linewidth=0.9, linestyle=(0, (4, 3)), zorder=1)
    axes.set_ylim(0, far)
    ticks = [tick for tick in (0, 0.1, 0.5, 1, 2, 4) if tick <= far]
    axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])


def _on_page(value: float | None) -> float:
    return float(np.clip(0.0 if value is None else value, 0, _FAR))


def _around(steps: Sequence[int]) -> tuple[float, float]:
    """Return limits with a margin on both sides of the steps."""
    room = 0.06 * (max(steps) - min(steps) or 1)
    return min(steps) - room, max(steps) + room


def _steps(steps: Sequence[int]) -> tuple[list[int], list[str]]:
    """Return the steps with a mark, far enough apart for their words, and the words."""
    kept: list[int] = []
    for step in sorted(set(steps)):
        if not kept or step - kept[-1] >= 0.12 * (max(steps) - min(steps)):
            kept.append(step)
    words = [f"{step / 1000:g}k" if step >= 1000 and step % 100 == 0 else str(step) for step in kept]
    return kept, words


def moments(spec: str, policy: PolicyResult, pictures: FrameBank | None) -> list[Drawing]:
    """Draw the most telling moments: the pictures, the motion, and it with each channel exchanged.

    Further figures exchange single cameras and change the world. No moment is drawn twice if there
    are enough.
    """
    motions = policy.motions
    cameras = [name for name in channels_of(motions.plan.bank) if name.startswith(CAMERA)]
    each = {f"swapped@{name}": f"another {name.removeprefix(CAMERA)} picture" for name in cameras}
    kinds: list[tuple[str, Mapping[str, str]]] = [("moment", _OF_ALL)] * _MOMENTS
    for turn, kept in enumerate(_parts(_OF_PICTURES | each, len(_LINES))):
        kinds.append((f"pictures-{turn + 1}" if turn else "pictures", kept))
    kinds.append(("world", _OF_THE_WORLD))
    kinds = [(kind, shown) for kind, shown in kinds if any(motions.raw(name) is not None for name in shown)]
    drawings: dict[tuple[str, int], Drawing | None] = {}
    for (kind, shown), (place, why) in zip(kinds, cycle(_telling(motions, len(kinds))), strict=False):
        drawings.setdefault((kind, place), _moment(kind, spec, motions, place, why, shown, pictures))
    return [drawing for drawing in drawings.values() if drawing is not None]


def _parts(whole: Mapping[str, str], most: int) -> Iterator[Mapping[str, str]]:
    """Yield a mapping in parts of at most ``most`` entries."""
    names = list(whole)
    for start in range(0, len(names), most):
        yield {name: whole[name] for name in names[start : start + most]}


_MOST = "It is the moment at which other pictures change its answer most."
_MIDDLE = "At half of the moments or more, other pictures change its answer more than here."


def _telling(found: Motions, most: int) -> list[tuple[int, str]]:
    """Return the moment that other pictures change most, and middle ones of other episodes.

    Each comes with a sentence about it. Without exchanged pictures, these are the first moments.
    """
    real, other = found.of("real"), found.of(f"swapped@{CAMERAS}")
    if real is None or other is None:
        return [(place, "") for place in range(min(most, len(found.plan.frames)))]
    apart = ((real.mean(axis=0) - other.mean(axis=0)) ** 2).mean(axis=(1, 2))
    order = np.argsort(np.where(np.isfinite(apart), -apart, np.inf), kind="stable")
    good = order[: int(np.isfinite(apart).sum())]
    if not len(good):
        return []
    by_episode = {found.episodes[place]: place for place in reversed(good[len(good) // 2 :])}
    middle = [place for name, place in reversed(by_episode.items()) if name != found.episodes[good[0]]]
    caption = _MOST if apart[good[0]] > 0 else ""
    return [(int(good[0]), caption), *((int(place), caption and _MIDDLE) for place in middle[: most - 1])]


def _moment(
    kind: str, spec: str, found: Motions, place: int, why: str, shown: Mapping[str, str], pictures: FrameBank | None
) -> Drawing | None:
    """Draw one moment; None if it has no answer, or no changed one."""
    frame, space = found.plan.frames[place], found.plan.motions
    lines = _lines(found, place, shown)
    if len(lines) < 2 or lines[0].words != _OWN:
        return None
    seen = {} if pictures is None else _pictures(pictures, frame.id)
    on_a_plane = len(space.axes) > 1
    with style():
        figure = paths(seen, space, lines) if on_a_plane else curves(seen, space, lines, found.scales)
    column = instruction_column(found.plan.bank)
    instruction = "without an instruction" if column is None else f"told “{frame.fields[column]}”"
    says = "Its own motion, and its motion with one input changed: "
    note = " ".join(filter(None, (_read_as(space, on_a_plane=on_a_plane), _of_answers(found), why)))
    return Drawing(
        _slug(f"{kind}-{spec}-{frame.id}"),
        f"{spec} at {frame.id}, {instruction}",
        says + ", ".join(line.words for line in lines),
        figure,
        note=note,
    )


def _lines(found: Motions, place: int, shown: Mapping[str, str]) -> list[MotionLine]:
    """Return a moment's motions, its own answer first; missing ones are left out."""
    lines = []
    looks = [(INK, "-"), *_LINES]
    for (name, words), (colour, dashes) in zip({"real": _OWN, **shown}.items(), looks, strict=False):
        raw = found.raw(name)
        if raw is not None and np.isfinite(raw[0, place]).all():
            lines.append(MotionLine(words, colour, dashes, raw[0, place]))
    return lines


def _read_as(space: MotionSpace, *, on_a_plane: bool) -> str:
    """Return what the figure draws of a motion and how to read it."""
    steps = counted(space.horizon, "step")
    rate = f", {space.rate_hz:g} a second" if space.rate_hz else ""
    exchanged = "Thick: its own answer. Every other line: its answer with that one input changed."
    if on_a_plane:
        down = space.axes[1]
        return (
            f"Each line is the path of its motion ({steps}{rate}) from the ring on; {down} points down, as in a "
            f"picture. {exchanged}"
        )
    alone = len(space.parts) == 1
    what = "the number of its motion" if alone else "one number of its motion"
    names = {dimension.name for dimension in space.dimensions if space.kind in PLACES and dimension.state is not None}
    relative = " Places are drawn relative to its state." if names else ""
    relative += " Of a rotation its angle is drawn, in radians." if space.rotations_of("motion") else ""
    units = "" if any(dimension.unit for dimension in space.dimensions) else " The bank names no units."
    units = f" All are in {_unit(space)}." if _unit(space) else units
    return f"Each curve is {what} over {steps}{rate}; each axis has a scale of its own.{relative}{units} {exchanged}"


def _of_answers(found: Motions) -> str:
    """Return a note if only the first of several answers is drawn."""
    real = found.of("real")
    return f"The first of {len(real)} answers is drawn." if real is not None and len(real) > 1 else ""


_ONE_COLUMN, _WIDE = 2, 4.4


def _boxes(count: int, below: float = 0.0) -> list[tuple[float, float, float, float]]:
    """Return the boxes of pictures at the left of a figure, 4.4 by 3.3 inches plus ``below``."""
    columns = 1 if count <= _ONE_COLUMN else 2 if count <= 4 * _ONE_COLUMN else 3
    rows = max(2, -(-count // columns))
    wide, step = 1.2 / columns - 0.1, 3.0 / rows
    size = min(wide, step - 0.25)
    return [
        (
            (0.05 + (turn % columns) * (wide + 0.1)) / _WIDE,
            (below + 3.05 - step * (turn // columns) - size) / (below + 3.3),
            size / _WIDE,
            size / (below + 3.3),
        )
        for turn in range(count)
    ]


def _pictures(bank: FrameBank, frame_id: str) -> dict[str, Floats]:
    """Return a frame's pictures by camera; empty if they cannot be read."""
    try:
        frame = bank.frame(frame_id)
        return {name: np.asarray(decode(image, name)) for name, image in bank.images(frame).items()}
    except EyechartError:
        return {}


def _show(figure: Figure, picture: Floats, box: tuple[float, float, float, float], name: str, size: float) -> None:
    """Draw a picture in a box of the figure, its name above it and no wider than it."""
    axes = figure.add_axes(box)
    axes.imshow(picture, interpolation="nearest")
    axes.set_title(shorten_middle(name, box[2] * _WIDE + 0.05, size), fontsize=size, pad=3)
    axes.set_axis_off()


def paths(seen: Mapping[str, Floats], space: MotionSpace, lines: Sequence[MotionLine]) -> Figure:
    """Draw the motions' paths along the world's first two axes, y downwards as in a picture."""
    left, below = (1.35 if seen else 0.25), 0.18 * _legend_rows(lines) - 0.36
    high = 3.3 + below
    figure = Figure(figsize=(_WIDE, high))
    for (camera, picture), box in zip(seen.items(), _boxes(len(seen), below), strict=True):
        _show(figure, picture, box, camera, 8.5 if len(seen) <= _ONE_COLUMN else 7)
    axes = figure.add_axes(((left + 0.45) / _WIDE, (0.9 + below) / high, (3.8 - left) / _WIDE, 2.2 / high))
    across, down = space.axes[:2]
    for line in lines:
        ways = [
            [0.0, *(float(space.displacement(line.numbers[:end], axis)) for end in range(1, space.horizon + 1))]
            for axis in (across, down)
        ]
        axes.plot(*ways, color=line.colour, linestyle=line.dashes, linewidth=line.width, label=line.words)
        axes.scatter([ways[0][-1]], [ways[1][-1]], s=16, color=line.colour, zorder=3)
    axes.scatter([0], [0], s=26, facecolors="none", edgecolors=INK, zorder=4)
    axes.set_aspect("equal", adjustable="datalim")
    axes.invert_yaxis()
    _quiet(axes)
    axes.set_xlabel(shorten_middle(_with_unit(space, across), (3.8 - left), 8), fontsize=8)
    axes.set_ylabel(shorten_middle(_with_unit(space, down), 2.1, 8), fontsize=8)
    _legend(figure, lines)
    return figure


def _with_unit(space: MotionSpace, axis: str) -> str:
    """Return an axis of the world with its unit; velocities are summed, so they get none."""
    units = {dimension.unit for dimension in space.dimensions if dimension.along == axis and dimension.unit}
    return f"{axis} ({', '.join(sorted(units))})" if units and space.kind != "velocity" else axis


_FEW, _IN_A_ROW, _LEAST_SIGNS = 3, 4, 24
"""Dimensions in one column (more: two), pictures in a row, and least signs of a short name."""


def curves(seen: Mapping[str, Floats], space: MotionSpace, lines: Sequence[MotionLine], scales: Floats) -> Figure:
    """Draw each dimension over the horizon in a small chart, with the pictures above.

    An axis spans at least its dimension's scale, so that small differences look small.
    """
    units = {dimension.name: dimension.unit for dimension in space.dimensions}
    names = [f"{name} ({units[name]})" if units.get(name) and not _unit(space) else name for name in space.parts]
    lines = [replace(line, numbers=space.in_parts(line.numbers)) for line in lines]
    scales = scales[[many[0] for many in space.parts.values()]]
    columns = 1 if len(names) <= _FEW else 2
    rows = -(-len(names) // columns)
    beside = min(max(len(seen), 3), _IN_A_ROW)
    size, each = (_WIDE - 0.1 * (beside + 1)) / beside, 0.92
    size = min(size, 1.15)
    tall = size * min(1.5, max([0.0, *(one.shape[0] / one.shape[1] for one in seen.values())]))
    above = (tall + 0.25) * -(-len(seen) // beside) + 0.05
    below = 0.42 + 0.18 * _legend_rows(lines)
    high = above + each * rows + below
    figure = Figure(figsize=(_WIDE, high))
    for turn, (camera, picture) in enumerate(seen.items()):
        down, across = divmod(turn, beside)
        left, low = 0.1 + across * (size + 0.1), high - (tall + 0.25) * (down + 1)
        _show(figure, picture, (left / _WIDE, low / high, size / _WIDE, tall / high), camera, 8)
    step = (_WIDE - 0.05) / columns
    for turn, name in enumerate(_with_room(names, step - 0.15)):
        down, across = divmod(turn, columns)
        left, low, wide = across * step + 0.5, high - above - each * (down + 1) + 0.1, step - 0.6
        axes = figure.add_axes((left / _WIDE, low / high, wide / _WIDE, (each - 0.4) / high))
        _over_steps(axes, lines, turn, float(scales[turn]))
        axes.text(-0.4 / wide, 1.08, name, transform=axes.transAxes, fontsize=8, va="bottom")
        last = turn + columns >= len(names)
        axes.tick_params(labelbottom=last)
        if last:
            axes.set_xlabel("step", fontsize=8, labelpad=1)
    _legend(figure, lines)
    return figure


def _with_room(names: Sequence[str], inches: float) -> list[str]:
    """Return names shortened to a width in inches, each still unique."""
    made = list(names)
    for most in range(max(map(len, names)), _LEAST_SIGNS - 1, -1):
        short = shorten(names, most)
        made = [short[name] for name in names]
        if all(width_of(name, 8) <= inches for name in made):
            break
    return made


def _unit(space: MotionSpace) -> str:
    """Return the common unit of all dimensions, empty if there is none."""
    units = {dimension.unit for dimension in space.dimensions}
    return next(iter(units)) if len(units) == 1 else ""


def _over_steps(axes: Axes, lines: Sequence[MotionLine], dimension: int, scale: float) -> None:
    """Draw one dimension of every line over the steps of the horizon."""
    values = np.array([line.numbers[:, dimension] for line in lines])
    steps = range(1, values.shape[1] + 1)
    for one, column in zip(lines, values, strict=True):
        marker = "o" if len(column) == 1 else ""
        axes.plot(
            steps, column, color=one.colour, linestyle=one.dashes, linewidth=one.width, marker=marker, markersize=3
        )
    low, far = float(values.min()), max(float(np.ptp(values)), scale) or 1.0
    middle = low + float(np.ptp(values)) / 2
    axes.set_ylim(middle - 0.58 * far, middle + 0.58 * far)
    axes.set_xlim(*((0.5, 1.5) if len(steps) == 1 else (1, len(steps))))
    axes.set_xticks(sorted({1, (1 + len(steps)) // 2, len(steps)}))
    axes.yaxis.set_major_locator(MaxNLocator(3, prune="both"))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.3g}"))
    _quiet(axes)


def _legend_rows(lines: Sequence[MotionLine]) -> int:
    return -(-len(lines) // 2)


def _legend(figure: Figure, lines: Sequence[MotionLine]) -> None:
    """Draw the legend below a figure, in two columns."""
    drawn = [Line2D([], [], color=line.colour, linestyle=line.dashes, linewidth=line.width) for line in lines]
    figure.legend(
        drawn,
        [shorten_middle(line.words, 1.68, 7.5) for line in lines],
        loc="lower left",
        bbox_to_anchor=(0.0, 0.0),
        ncols=2,
        fontsize=7.5,
        frameon=False,
        handlelength=2.4,
        columnspacing=1.0,
        borderaxespad=0.2,
    )


def _quiet(axes: Axes) -> None:
    axes.tick_params(labelsize=7)
    axes.grid(color=LINE, linewidth=0.5)
    axes.set_axisbelow(True)


def _slug(text: str) -> str:
    """Return text as the stem of a file: letters, digits and single hyphens."""
    signs = [sign if sign.isalnum() and sign.isascii() else "-" for sign in text]
    return "".join(sign for before, sign in pairwise(["-", *signs]) if sign != "-" or before != "-").strip("-")
