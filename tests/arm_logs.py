"""Logs of an arm of any number of joints, imported: a front camera that shows the arm, and a side one if wanted."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from eyechart.frames import FrameBank
from eyechart.importing import Choices, import_table, read_rig

SIDES = ("", "still", "moving")


def by_front(images: Mapping[str, np.ndarray], state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Do as the log does."""
    del instruction
    return np.stack([-0.3 * state + (float(images["front"][0, 0, 0]) - 125) / 100] * 2)


def arm_bank(
    folder: Path,
    *,
    joints: int = 2,
    episodes: int = 8,
    length: int = 6,
    side: str = "",
    tasks: Sequence[str] = ("go", "leave"),
    kind: str = "delta",
    horizon: int = 2,
    pace: float = 0.5,
    stays: int = 0,
    wrong: float = 0.0,
    rows: Sequence[tuple[int, int]] = ((3, 2),),
) -> FrameBank:
    """Return a bank of an arm that goes home from somewhere; the pictures of a side camera are all alike if ``still``.

    It goes the part ``pace`` of its way in a step, but in the last joints, as many as ``stays`` says, that stay. The
    brightness of the front picture's left half is the episode's, that of the right half the step's. In some rows
    of the log (episode, step) the first number is ``wrong`` by so much.
    """
    assert side in SIDES
    rng, cameras = np.random.default_rng(7), ("front", *(("side",) if side else ()))
    folder.mkdir(parents=True, exist_ok=True)
    names = [f"j{number}" for number in range(joints)]
    lines = [",".join([*cameras, "drive", "step", "task", *names, *(f"a{name}" for name in names)])]
    for drive in range(episodes):
        bright, state = int(rng.integers(40, 210)), rng.normal(size=joints)
        for step in range(length):
            pixels = np.full((6, 8, 3), bright, np.uint8)
            pixels[:, 4:] = 20 * step + drive
            files = [f"{drive}-{step}-{name}.png" for name in cameras]
            Image.fromarray(pixels).save(folder / files[0])
            if side:
                shown = np.full_like(pixels, 90) if side == "still" else 255 - pixels
                Image.fromarray(shown).save(folder / files[1])
            action = -0.3 * state + (bright - 125) / 100
            logged = action + np.eye(joints)[0] * (wrong if (drive, step) in rows else 0.0)
            cells = [*files, drive, step, _quoted(tasks[drive % len(tasks)]), *np.round([*state, *logged], 5)]
            lines.append(",".join(map(str, cells)))
            state[: joints - stays] += (pace * action + 0.1 * pace * rng.normal(size=joints))[: joints - stays]
    (folder / "t.csv").write_text("\n".join(lines))
    rig = [f'[[camera]]\nname = "{name}"\ncolumn = "{name}"\n' for name in cameras]
    rig += [
        f"[state]\njoints = {names}\n[motion]\nhorizon = {horizon}\nkind = '{kind}'\nrate_hz = 10\n".replace("'", '"')
    ]
    relative = "" if kind == "delta" else 'state = "{name}"\n'
    rig += [f'[[motion.number]]\ncolumn = "a{name}"\n{relative.format(name=name)}' for name in names]
    (folder / "rig.toml").write_text("\n".join(rig))
    chosen = Choices(rig=read_rig(folder / "rig.toml"), prompt_columns=("task",))
    return import_table(folder, folder / "t.csv", folder / "bank", chosen)


def declared(images: Mapping[str, np.ndarray], state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Do as the log does, and declare it."""
    return by_front(images, state, instruction)


declared.channels = ("camera:front", "state")  # type: ignore[attr-defined]


def _quoted(text: str) -> str:
    """Return a cell of a table."""
    doubled = text.replace('"', '""')
    return f'"{doubled}"'
