"""Logs of a block that slides at a speed of its own, and policies that read the speed from two instants."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from PIL import Image

from eyechart.frames import FrameBank
from eyechart.importing import Choices, import_table, read_rig

WIDE = 64
HORIZON = 2
RIG = f"""
[[camera]]
name = "top"
column = "top"
mirror_axis = "horizontal"
[[camera]]
name = "side"
column = "side"
mirror_axis = "horizontal"
[state]
block = ["x", "y"]
[motion]
horizon = {HORIZON}
kind = "delta"
rate_hz = 10
[[motion.number]]
column = "dx"
[[motion.number]]
column = "dy"
"""


def moved(*, episodes: int = 10, length: int = 8, gaps: tuple[tuple[int, int], ...] = ()) -> list[dict[str, float]]:
    """Return the rows of a log: episode, step, places x and y from 0 to 1, and the changes of both in the step."""
    rng, rows = np.random.default_rng(5), list[dict[str, float]]()
    for episode in range(episodes):
        place, speed = rng.uniform(0.3, 0.7, 2), rng.normal(0, 0.02, 2)
        for step in range(length):
            speed = 0.9 * speed + rng.normal(0, 0.009, 2)
            if (episode, step) not in gaps:
                names = dict(zip(("drive", "step", "x", "y", "dx", "dy"), (episode, step, *place, *speed), strict=True))
                rows.append(names)
            place = np.clip(place + speed, 0.05, 0.95)
    return rows


def draw(place: float) -> Image.Image:
    """Draw a white bar at a place from 0 to 1, blurred so that its middle tells the place to a part of a pixel."""
    near = np.exp(-(((np.arange(WIDE) - place * (WIDE - 1)) / 3) ** 2))
    return Image.fromarray(
        np.repeat((255 * near).round().astype(np.uint8)[None, :, None], 12, axis=0).repeat(3, axis=2)
    )


def middle(pixels: np.ndarray) -> np.ndarray:
    """Return the places of the bars in pictures (n, h, w, 3), shape (n,); 0 where there is none."""
    bright = pixels[..., 0].astype(float).mean(axis=1)
    return np.asarray((bright @ np.arange(WIDE)) / np.maximum(bright.sum(axis=1), 1e-9) / (WIDE - 1))


def source(folder: Path, **how: object) -> Path:
    """Write a log's table ``t.csv``, pictures and ``rig.toml``; the top camera shows x, the side camera y."""
    folder.mkdir(parents=True, exist_ok=True)
    lines = ["top,side,drive,step,task,x,y,dx,dy"]
    for row in moved(**how):  # type: ignore[arg-type]
        files = [f"{row['drive']}-{row['step']}-{camera}.png" for camera in ("top", "side")]
        for file, axis in zip(files, "xy", strict=True):
            draw(row[axis]).save(folder / file)
        numbers = [f"{row[name]:.4f}" for name in ("x", "y", "dx", "dy")]
        lines.append(",".join([*files, str(row["drive"]), str(row["step"]), f"go {row['drive'] % 2}", *numbers]))
    (folder / "t.csv").write_text("\n".join(lines))
    (folder / "rig.toml").write_text(RIG)
    return folder


def mover_bank(folder: Path, *, history: int = 1, every: int = 1, **how: object) -> FrameBank:
    """Return a bank of such a log, with ``history`` instants before each frame."""
    where = source(folder, **how)
    rig = read_rig(where / "rig.toml")
    chosen = Choices(rig=rig, prompt_columns=("task",), history=history, every=every)
    return import_table(where, where / "t.csv", where / "bank", chosen)


def by_states(images: Mapping[str, np.ndarray], state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Go on as the last two states went."""
    del images, instruction
    return np.stack([state[-1] - state[-2]] * HORIZON)


def by_pictures(images: Mapping[str, np.ndarray], state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Go on as the bars of the last two pictures went."""
    del state, instruction
    return np.stack([np.array([np.diff(middle(images[camera]))[-1] for camera in ("top", "side")])] * HORIZON)


by_states.history = by_pictures.history = 1  # type: ignore[attr-defined]
