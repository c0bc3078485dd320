"""Figures of policies: how much each channel carries, and what one moment becomes when a channel is exchanged."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from eyechart.channels import CAMERA, CAMERAS, INSTRUCTION, STATE, channels_of
from eyechart.errors import EyechartError
from eyechart.frames import FrameBank, decode
from eyechart.report.charts import BLUE, INK, LINE, MUTED, SOFT, VERMILLION, Drawing, canvas, named_rows, style
from eyechart.report.table import number
from eyechart.spaces.motion import MotionSpace
from eyechart.stats.statistic import Statistic
from eyechart.studies.policy.course import Course
from eyechart.studies.policy.reading import Floats, Motions
from eyechart.studies.policy.scoring import OnePolicy
from eyechart.verdicts.channels import IGNORED, USED, ignored, used

_TICKS = (0, 0.1, 0.3, 0.6, 1, 2, 4)
_SHOWN = {
    "real": ("its answer", INK, "-"),
    f"swapped@{CAMERAS}": ("other pictures", VERMILLION, "-"),
    f"swapped@{INSTRUCTION}": ("another instruction", VERMILLION, "--"),
    f"swapped@{STATE}": ("another state", MUTED, "--"),
    "named_plus": ("its object moved", BLUE, "-"),
}
"""The conditions of which a moment's motion is drawn: what each is, its colour and its line."""
_PICTURES = {
    "real": ("its answer", INK, "-"),
    f"matched@{CAMERAS}": ("another's at a like state", BLUE, "--"),
    "blank": ("grey pictures", MUTED, ":"),
    "exchanged": ("colours exchanged", BLUE, "-."),
    "other_plus": ("the other object moved", BLUE, ":"),
    "recoloured": ("another table", MUTED, "-."),
    "decoys": ("further objects", MUTED, "--"),
}
"""Those of pictures alone, of which the first moment is drawn once more, with each camera's exchanged."""
_LINES = ("-", "--", "-.", ":")
Shown = Mapping[str, tuple[str, str, str]]
_MOMENTS = 2


def shares(spec: str, policy: OnePolicy) -> Iterator[Drawing]:
    """Draw the share of every channel, and of pictures at a similar state and of grey ones, with the two margins.

    Yields nothing where no share can be said.
    """
    rows = [(_in_words(name), one) for name, one in policy.statistics.items() if _is_drawn(name, one)]
    if not rows:
        return
    with style():
        figure, axes = canvas(4.9, 0.7 + 0.25 * max(1, len(rows)), (2.1, 0.15, 0.5, 0.08))
        axes.set_xscale("function", functions=(np.sqrt, np.square))
        axes.axvspan(0, USED, color=SOFT, zorder=0)
        axes.axvline(IGNORED, color=MUTED, linewidth=0.9, linestyle=(0, (4, 3)), zorder=1)
        for y, (_, one) in enumerate(rows):
            colour = BLUE if used(one) else VERMILLION if ignored(one) else MUTED
            _interval(axes, y, one, colour)
        named_rows(axes, [name for name, _ in rows], 0.5)
        ends = [one.ci[1] for _, one in rows if one.ci is not None]
        axes.set_xlim(0, min(4.5, max([1.2, *ends]) * 1.05))
        ticks = [tick for tick in _TICKS if tick <= axes.get_xlim()[1]]
        axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        axes.set_xlabel("share of its own variation", fontsize=8.5)
    told = "; ".join(f"{name} {number(one.value, 3)}" for name, one in rows)
    frames = sorted({one.n for _, one in rows})
    of = f"{frames[0]} to {frames[-1]}" if len(frames) > 1 else f"{frames[0]}"
    title = "How much each channel carries: blue is used, orange ignored (left of the dashes), grey undecided"
    yield Drawing(_slug(f"shares-{spec}"), f"{title}; 98 % intervals, {of} frames", f"Shares. {told}", figure)


def _in_words(name: str) -> str:
    """Return what was shown instead, of a share's name: ``T.matched@camera:top`` is 'top, at a like state'."""
    base, _, channel = name.removeprefix("T.").partition("@")
    what = channel.removeprefix("camera:") or "cameras"
    return f"{what if len(what) <= _LONGEST else f'…{what[1 - _LONGEST :]}'}, {_INSTEAD[base]}"


_LONGEST = 14
_INSTEAD = {"swapped": "another's", "matched": "at a like state", "blank": "grey", "exchanged": "colours exchanged"}


def _is_drawn(name: str, one: Statistic) -> bool:
    base = name.removeprefix("T.").partition("@")[0]
    return name.startswith("T.") and base in _INSTEAD and one.value is not None


def _interval(axes: Axes, y: int, one: Statistic, colour: str) -> None:
    axes.axhline(y, color=LINE, linewidth=0.6, zorder=0)
    if one.ci is not None:
        axes.plot(np.clip(one.ci, 0, 4.5), [y, y], color=colour, lw=1.8, solid_capstyle="butt", zorder=2)
    if one.value is not None:
        axes.scatter([np.clip(one.value, 0, 4.5)], [y], s=30, color=colour, zorder=3)


def training(course: Course) -> Drawing:
    """Draw each channel's share against the step of the training, a row each, with the margins that `shares` has."""
    names, points = course.channels, [(one.step or 0, one.shares) for one in course.checkpoints]
    far = max([1.2, *(one.ci[1] for _, each in points for one in each.values() if one.ci is not None)])
    high = 0.95
    with style():
        figure = Figure(figsize=(4.4, 0.55 + high * len(names)))
        whole = figure.get_size_inches()[1]
        for row, name in enumerate(names):
            box = (0.62 / 4.4, (whole - high * (row + 1) + 0.1) / whole, 3.66 / 4.4, (high - 0.3) / whole)
            axes = figure.add_axes(box)
            _share_axis(axes, min(4.5, far * 1.05))
            axes.set_title(name, fontsize=8.5, loc="left", pad=2)
            _shares_by_step(axes, [(step, each[name]) for step, each in points if name in each])
            axes.set_xlim(*_around([step for step, _ in points]))
            axes.set_xticks(*_steps([step for step, _ in points]))
            axes.tick_params(labelbottom=row == len(names) - 1, labelsize=7.5)
        axes.set_xlabel("step of the training", fontsize=8.5)
    told = "; ".join(
        f"{name} " + ", ".join(f"{number(each[name].value, 2)} at {step}" for step, each in points if name in each)
        for name in names
    )
    title = "When did it stop looking? Each channel's share: blue is used, orange ignored (below the dashes), grey open"
    return Drawing("training", title, f"Shares with 98 % intervals, by step. {told}", figure)


def _shares_by_step(axes: Axes, shares: Sequence[tuple[int, Statistic]]) -> None:
    """Draw a channel's shares, joined, each with its interval and in the colour of what it says."""
    held = [(step, one) for step, one in shares if one.value is not None]
    axes.plot([step for step, _ in held], [_on_page(one.value) for _, one in held], color=LINE, lw=1, zorder=1)
    for step, one in held:
        colour = BLUE if used(one) else VERMILLION if ignored(one) else MUTED
        if one.ci is not None:
            axes.plot([step, step], np.clip(one.ci, 0, 4.5), color=colour, lw=1.8, zorder=2)
        axes.scatter([step], [_on_page(one.value)], s=22, color=colour, zorder=3, clip_on=False)


def _share_axis(axes: Axes, far: float) -> None:
    """Make the vertical axis one of shares, with the two margins."""
    axes.set_yscale("function", functions=(np.sqrt, np.square))
    axes.axhspan(0, USED, color=SOFT, zorder=0)
    axes.axhline(IGNORED, color=MUTED, linewidth=0.9, linestyle=(0, (4, 3)), zorder=1)
    axes.set_ylim(0, far)
    ticks = [tick for tick in (0, 0.1, 0.5, 1, 2, 4) if tick <= far]
    axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])


def _on_page(value: float | None) -> float:
    return float(np.clip(0.0 if value is None else value, 0, 4.5))


def _around(steps: Sequence[int]) -> tuple[float, float]:
    """Return limits that leave a margin on both sides of steps."""
    room = 0.06 * (max(steps) - min(steps) or 1)
    return min(steps) - room, max(steps) + room


def _steps(steps: Sequence[int]) -> tuple[list[int], list[str]]:
    """Return where steps are marked, none nearer to the last than its words are long, and the words."""
    kept: list[int] = []
    for step in sorted(set(steps)):
        if not kept or step - kept[-1] >= 0.12 * (max(steps) - min(steps)):
            kept.append(step)
    words = [f"{step / 1000:g}k" if step >= 1000 and step % 100 == 0 else str(step) for step in kept]
    return kept, words


def moments(spec: str, policy: OnePolicy, pictures: FrameBank | None) -> list[Drawing]:
    """Draw moments that tell most: their pictures, and the motion as it was and with each channel exchanged."""
    found = policy.motions
    places = [int(place) for place in _telling(found)]
    cameras = [name for name in channels_of(found.plan.bank) if name.startswith(CAMERA)]
    each = {
        f"swapped@{name}": (f"another {name.removeprefix(CAMERA)}", VERMILLION, _LINES[turn % len(_LINES)])
        for turn, name in enumerate(cameras)
    }
    drawn = [("moment", place, _SHOWN) for place in places] + [
        ("pictures", place, _PICTURES | each) for place in places[:1]
    ]
    made = []
    for kind, place, shown in drawn:
        asked = {name: how for name, how in shown.items() if name in found.answers}
        if "real" in asked and len(asked) > 1:
            made.append(_moment(f"{kind}-{spec}", found, place, asked, pictures))
    return [one for one in made if one is not None]


def _telling(found: Motions) -> Sequence[int]:
    """Return the moments at which other pictures change the answer most, and in the middle, of different episodes."""
    real, other = found.of("real"), found.of(f"swapped@{CAMERAS}")
    if real is None or other is None:
        return range(min(_MOMENTS, len(found.plan.frames)))
    apart = ((real.mean(axis=0) - other.mean(axis=0)) ** 2).mean(axis=(1, 2))
    order = np.argsort(np.where(np.isfinite(apart), -apart, np.inf), kind="stable")
    good = order[: int(np.isfinite(apart).sum())]
    if not len(good):
        return ()
    middle = [place for place in good[len(good) // 2 :] if found.episodes[place] != found.episodes[good[0]]]
    return [int(good[0]), *(int(place) for place in middle[: _MOMENTS - 1])]


def _moment(name: str, found: Motions, place: int, shown: Shown, pictures: FrameBank | None) -> Drawing | None:
    frame, space = found.plan.frames[place], found.plan.motions
    seen = {} if pictures is None else _pictures(pictures, frame.id)
    left = 1.35 if seen else 0.1
    with style():
        below = 0.17 * max(0, -(-len(shown) // 2) - _LEGEND_ROWS)
        high = 3.3 + below
        figure = Figure(figsize=(4.4, high))
        for (camera, picture), box in zip(seen.items(), _boxes(len(seen), below), strict=True):
            axes = figure.add_axes(box)
            axes.imshow(picture, interpolation="nearest")
            axes.set_title(camera, fontsize=8.5 if len(seen) <= _ONE_COLUMN else 6)
            axes.set_axis_off()
        axes = figure.add_axes(((left + 0.4) / 4.4, (1.0 + below) / high, (3.85 - left) / 4.4, 2.1 / high))
        drawn = _paths(axes, found, place, shown) if len(space.axes) > 1 else _curves(axes, found, place, shown)
        axes.legend(
            loc="upper center",
            bbox_to_anchor=(0.45, -0.2),
            ncols=2,
            fontsize=7.5,
            frameon=False,
            handlelength=1.8,
            columnspacing=1.0,
        )
    if not drawn:
        return None
    told = f"“{found.plan.prompt.render({**frame.fields}, ())[1]}”" if frame.fields else "no instruction"
    title = f"{frame.id}, {told}"
    says = "Its motion as it was, and with one thing changed of what it is shown: " + ", ".join(drawn)
    return Drawing(_slug(f"{name}-{frame.id}"), title, says, figure)


_ONE_COLUMN, _LEGEND_ROWS = 2, 3


def _boxes(count: int, below: float = 0.0) -> list[tuple[float, float, float, float]]:
    """Return where so many pictures stand, from above, left in a figure of 4.4 by 3.3 inches and ``below`` more."""
    columns = 1 if count <= _ONE_COLUMN else 2 if count <= 4 * _ONE_COLUMN else 3
    rows = max(2, -(-count // columns))
    wide, step = 1.2 / columns - 0.1, 3.0 / rows
    size = min(wide, step - 0.25)
    return [
        (
            (0.05 + (turn % columns) * (wide + 0.1)) / 4.4,
            (below + 3.05 - step * (turn // columns) - size) / (below + 3.3),
            size / 4.4,
            size / (below + 3.3),
        )
        for turn in range(count)
    ]


def _pictures(bank: FrameBank, frame_id: str) -> dict[str, Floats]:
    """Return a frame's pictures by camera, none where they cannot be read."""
    try:
        frame = bank.frame(frame_id)
        return {name: np.asarray(decode(one, name)) for name, one in bank.images(frame).items()}
    except EyechartError:
        return {}


def _paths(axes: Axes, found: Motions, place: int, shown: Shown) -> list[str]:
    """Draw where motions lead along the first two axes of the world, y downwards as in a picture."""
    space, drawn = found.plan.motions, []
    across, down = space.axes[:2]
    for name, (words, colour, line) in shown.items():
        raw = found.raw(name)
        if raw is None or not np.isfinite(raw[0, place]).all():
            continue
        ways = [
            [0.0, *(float(space.displacement(raw[0, place][:end], axis)) for end in range(1, space.horizon + 1))]
            for axis in (across, down)
        ]
        axes.plot(*ways, color=colour, linestyle=line, linewidth=2.4 if name == "real" else 1.3, label=words)
        axes.scatter([ways[0][-1]], [ways[1][-1]], s=16, color=colour, zorder=3)
        drawn.append(words)
    axes.scatter([0], [0], s=26, facecolors="none", edgecolors=INK, zorder=4)
    axes.set_aspect("equal", adjustable="datalim")
    axes.invert_yaxis()
    _quiet(axes, _with_unit(space, across), _with_unit(space, down))
    return drawn


def _with_unit(space: MotionSpace, axis: str) -> str:
    """Return an axis of the world with the unit of the numbers along it; of velocities, which are summed, without."""
    units = {one.unit for one in space.dimensions if one.along == axis and one.unit}
    return f"{axis} ({', '.join(sorted(units))})" if units and space.kind != "velocity" else axis


def _curves(axes: Axes, found: Motions, place: int, shown: Shown) -> list[str]:
    """Draw every dimension over the horizon, one below the other, each in its own scale."""
    drawn = []
    for name, (words, colour, line) in shown.items():
        answers = found.of(name)
        if answers is None or not np.isfinite(answers[0, place]).all():
            continue
        for number_of, column in enumerate(answers[0, place].T):
            label = words if number_of == 0 else None
            wide = 2.4 if name == "real" else 1.3
            axes.plot(column - 3.0 * number_of, color=colour, linestyle=line, linewidth=wide, label=label)
        drawn.append(words)
    dimensions = [one.name for one in found.plan.motions.dimensions]
    axes.set_yticks([-3.0 * turn for turn in range(len(dimensions))], dimensions)
    _quiet(axes, "step", "")
    return drawn


def _quiet(axes: Axes, across: str, down: str) -> None:
    axes.set_xlabel(across, fontsize=8)
    axes.set_ylabel(down, fontsize=8)
    axes.tick_params(labelsize=7)
    axes.grid(color=LINE, linewidth=0.5)
    axes.set_axisbelow(True)


def _slug(text: str) -> str:
    """Return text as the stem of a file: letters, digits and single hyphens."""
    signs = [sign if sign.isalnum() and sign.isascii() else "-" for sign in text]
    return "".join(sign for before, sign in pairwise(["-", *signs]) if sign != "-" or before != "-").strip("-")
