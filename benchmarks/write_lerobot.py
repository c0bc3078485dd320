"""Writes a LeRobotDataset v3 with LeRobot's own writer, of a real robot's layout; LeRobot's own Python runs this.

    python benchmarks/write_lerobot.py OUT [--images] [--episodes 20] [--frames 300] [--high 480] [--wide 640]

Two cameras, six joints, 50 Hz, two tasks. A block lies somewhere on a table; the arm reaches for it in a straight line
in joint space, with a little wandering. Nothing of eyechart is imported.
"""

import argparse
import shutil
from pathlib import Path

import numpy as np

JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
TASKS = ("pick up the red block", "pick up the blue block")
RATE_HZ = 50


def table(high: int, wide: int) -> np.ndarray:
    """Return a table with a grain, shape (high, wide, 3)."""
    rng = np.random.default_rng(0)
    rows, columns = np.linspace(0, 20, high)[:, None], np.linspace(0, 7, wide)[None]
    grain = 14 * np.sin(rows + 2 * np.sin(columns)) + rng.normal(0, 4, (high, wide))
    return np.clip(np.array([150, 130, 105]) + grain[..., None], 0, 255).astype(np.uint8)


def draw(back: np.ndarray, places: dict[tuple[int, int, int], np.ndarray], half: int) -> np.ndarray:
    """Return a picture with a square of each colour at its place, in shares of the picture."""
    picture = back.copy()
    high, wide, _ = picture.shape
    for colour, place in places.items():
        x, y = int(place[0] * wide), int(place[1] * high)
        picture[max(0, y - half) : y + half, max(0, x - half) : x + half] = colour
    return picture


def joints_at(tool: np.ndarray, grip: float, wrist: float) -> np.ndarray:
    """Return six joint angles in degrees that stand for a tool's place."""
    x, y = tool
    return np.array([90 * (x - 0.5), 60 * y, 80 * (1 - y), 20 * x * y, wrist, 100 * grip], np.float32)


def episode(rng: np.random.Generator, frames: int) -> dict[str, np.ndarray]:
    """Return blocks, the tool's place in every frame, and the joints, of one reach."""
    blocks = rng.uniform(0.15, 0.85, (2, 2))
    named, wrist = int(rng.integers(2)), float(rng.uniform(-20, 20))
    way = np.clip(np.arange(frames + 1) / (0.8 * frames), 0, 1)[:, None]
    begin = rng.uniform(0.1, 0.9, 2)
    tool = begin + way * (blocks[named] - begin) + 0.01 * np.cumsum(rng.normal(0, 0.05, (frames + 1, 2)), axis=0)
    joints = np.stack([joints_at(one, float(share > 0.95), wrist) for one, share in zip(tool, way[:, 0], strict=True)])
    return {"blocks": blocks, "named": np.array(named), "tool": tool, "joints": joints}


def write(out: Path, *, images: bool, episodes: int, frames: int, size: tuple[int, int]) -> None:
    """Write the data set: absolute joint positions as actions, a step ahead of the state."""
    from lerobot.datasets.lerobot_dataset import LeRobotDataset  # noqa: PLC0415 - of its own environment

    shutil.rmtree(out, ignore_errors=True)
    names = [f"{joint}.pos" for joint in JOINTS]
    camera = {"dtype": "image" if images else "video", "shape": (*size, 3), "names": ["height", "width", "channels"]}
    numbers = {"dtype": "float32", "shape": (len(JOINTS),), "names": names}
    features = {"observation.images.top": camera, "observation.images.wrist": camera}
    features |= {"observation.state": numbers, "action": numbers}
    made = LeRobotDataset.create("local/arm", fps=RATE_HZ, features=features, root=out, use_videos=not images)
    rng, back = np.random.default_rng(0), table(*size)
    for _ in range(episodes):
        one = episode(rng, frames)
        for step in range(frames):
            tool, blocks = one["tool"][step], one["blocks"]
            near = {c: 0.5 + (b - tool) * 2 for c, b in zip(((200, 40, 40), (40, 60, 200)), blocks, strict=True)}
            top = draw(back, dict(zip(near, blocks, strict=True)) | {(30, 30, 30): tool}, size[0] // 24)
            wrist = draw(back, {c: b for c, b in near.items() if ((b > 0) & (b < 1)).all()}, size[0] // 10)
            made.add_frame(
                {
                    "observation.images.top": top,
                    "observation.images.wrist": wrist,
                    "observation.state": one["joints"][step],
                    "action": one["joints"][step + 1],
                    "task": TASKS[int(one["named"])],
                }
            )
        made.save_episode()
    made.finalize()


def main() -> None:
    """Write a data set as the options say."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--images", action="store_true", help="pictures inside Parquet instead of videos")
    parser.add_argument("--episodes", type=int, default=20)
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--high", type=int, default=480)
    parser.add_argument("--wide", type=int, default=640)
    args = parser.parse_args()
    size = (args.high, args.wide)
    write(args.out, images=args.images, episodes=args.episodes, frames=args.frames, size=size)


if __name__ == "__main__":
    main()
