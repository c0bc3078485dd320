"""One log of an arm's poses in any representation of its rotation, and the policy that answers in the same one."""

import itertools
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.spatial.transform import Rotation as Turn

from eyechart.frames import FrameBank
from eyechart.importing import Choices, import_table, read_rig
from eyechart.spaces.rotations import WIDTH, Representation, matrices

Numbers = np.ndarray
DOWN = np.array([1.0, 0.0, 0.0, 0.0])
"""A gripper that points down: half a turn about x, as a quaternion with w last."""


def product(one: Numbers, other: Numbers) -> Numbers:
    """Return the product of two quaternions with w last."""
    (a, p), (b, q) = ((each[3], each[:3]) for each in (one, other))
    return np.array([*(a * q + b * p + np.cross(p, q)), a * b - p @ q])


def of_vector(vector: Numbers) -> Numbers:
    """Return a rotation vector as a quaternion."""
    size = float(np.linalg.norm(vector))
    return np.array([*(np.sin(size / 2) / max(size, 1e-12) * vector), np.cos(size / 2)])


def written(quaternion: Numbers, how: Representation, rng: np.random.Generator) -> Numbers:
    """Return a rotation in a representation; its sign or its wrap is drawn."""
    x, y, z, w = quaternion * rng.choice([-1, 1])
    if how == "quat_xyzw":
        return np.array([x, y, z, w])
    if how == "quat_wxyz":
        return np.array([w, x, y, z])
    if how == "axis_angle":
        size = float(np.linalg.norm([x, y, z]))
        return 2 * np.arctan2(size, w) * np.array([x, y, z]) / size
    matrix = matrices(quaternion, "quat_xyzw")
    if how == "rot6d":
        return np.asarray(matrix[:, :2].T.ravel())
    one, two, three = Turn.from_quat([x, y, z, w]).as_euler(how[6:9])
    if rng.random() < 0.5:
        one, two, three = one + np.pi, np.pi - two, three + np.pi
    turns = np.array([(turn + np.pi) % (2 * np.pi) - np.pi for turn in (one, two, three)])
    return np.rad2deg(turns) if how.endswith("_deg") else turns


def quaternion_of(numbers: Numbers, how: Representation) -> Numbers:
    """Return a quaternion of a rotation in a representation, of either sign."""
    matrix = matrices(numbers, how)
    every = np.array(
        [
            [matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1], 1 + matrix.trace()],
            [1 + 2 * matrix[0, 0] - matrix.trace(), matrix[0, 1] + matrix[1, 0], matrix[0, 2] + matrix[2, 0],
             matrix[2, 1] - matrix[1, 2]],
        ]
    )  # fmt: skip
    found = every[np.linalg.norm(every, axis=1).argmax()]
    return np.asarray(found / np.linalg.norm(found))


def poses(episodes: int = 8, length: int = 7) -> list[list[tuple[Numbers, Numbers, Numbers]]]:
    """Return places, quaternions and goals by episode and step; the arm turns and goes towards a goal."""
    rng, found = np.random.default_rng(5), []
    for _ in range(episodes):
        goal, start, lean = rng.uniform(-0.2, 0.2, 3), 0.1 * rng.normal(size=3), 0.2 * rng.normal(size=3)
        steps = []
        for step in range(length + 1):
            way = step / length
            place = start + way * (goal - start) + 0.004 * rng.normal(size=3)
            turn = lean + way * (2 * goal - lean) + 0.01 * rng.normal(size=3)
            steps.append((place, product(DOWN, of_vector(turn)), goal))
        found.append(steps)
    return found


def rotated_bank(folder: Path, how: Representation, declared: Representation | None = None) -> FrameBank:
    """Return the bank of the log in a representation, ``declared`` as it or another one."""
    folder.mkdir(parents=True, exist_ok=True)
    names = ["x", "y", "z", *(f"r{place}" for place in range(WIDTH[how]))]
    lines, rng = (
        [",".join(["front", "drive", "step", *names, *(f"a{name}" for name in names)])],
        np.random.default_rng(9),
    )
    for drive, steps in enumerate(poses()):
        for step, (now, after) in enumerate(itertools.pairwise(steps)):
            pixels = np.full((6, 8, 3), 60 + step, np.uint8)
            pixels[0, 0] = np.round(128 + 500 * now[2])
            file = f"{drive}-{step}.png"
            Image.fromarray(pixels).save(folder / file)
            cells = [np.r_[one[0], written(one[1], how, rng)] for one in (now, after)]
            lines.append(",".join([file, str(drive), str(step), *(f"{cell:.15g}" for one in cells for cell in one)]))
    (folder / "t.csv").write_text("\n".join(lines))
    rig = ['[[camera]]\nname = "front"\ncolumn = "front"', f"[state]\npose = {names}".replace("'", '"')]
    rig += ['[motion]\nhorizon = 2\nkind = "absolute"\nrate_hz = 10']
    rig += [
        f'[[motion.number]]\ncolumn = "a{name}"' + (f'\nstate = "{name}"' if name in names[:3] else "")
        for name in names
    ]
    word = declared or how
    rig += [f'[[motion.rotations]]\nrepresentation = "{word}"\nfirst = 3\nstate = 3']
    rig += [f'[[motion.rotations]]\nrepresentation = "{word}"\nfirst = 3\nof = "state"']
    (folder / "rig.toml").write_text("\n".join(rig))
    return import_table(folder, folder / "t.csv", folder / "bank", Choices(rig=read_rig(folder / "rig.toml")))


def rotated_policy(how: Representation) -> Callable[[Mapping[str, Numbers], Numbers, str | None], Numbers]:
    """Return a policy that goes and turns towards the goal in the picture, with signs drawn by the state."""

    def act(images: Mapping[str, Numbers], state: Numbers, instruction: str | None) -> Numbers:
        del instruction
        state = np.asarray(state, float)
        goal = (images["front"][0, 0].astype(float) - 128) / 500
        rng = np.random.default_rng(int(abs(state[0]) * 1e6))
        now, rows = quaternion_of(state[3:], how), []
        for way in (0.2, 0.4):
            turned = written(product(now, of_vector(way * (goal + 0.1))), how, rng)
            rows.append(np.r_[state[:3] + way * (goal - state[:3]), turned])
        return np.array(rows)

    return act
