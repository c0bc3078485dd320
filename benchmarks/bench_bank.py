"""What a bank's worlds and pictures cost: as ``Highway`` makes them, and as stock highway-env is driven and rendered.

The same 144 frames, three ways: ``env.step`` and ``env.render`` with nothing patched, as a user would write it
(every step then draws fourteen pictures that nobody sees); the same with that switched off after each picture;
and eyechart's. Every vehicle's position, speed and heading must be equal byte for byte at every frame, and every
picture pixel for pixel, before a ratio is printed. Gated: at least 3 times less CPU time than the first way, in the
greatest of ten pairs that alternate. Writes ``results/bench_bank.json``.
"""

import argparse
import json
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from highway_env.vehicle.kinematics import Vehicle

from eyechart.simulators import open_simulator
from eyechart.simulators.highway.drives import BLOCKED, BLOCKER_AHEAD_M, DRIVES, drive_worlds
from eyechart.simulators.highway.world import StockCamera
from pairs import PAIRS, alternating, cpu_s, keep, ratios

BOUND = 3.0
SEEDS = (0, 1, 2)
STEPS = 12

Frames = dict[str, tuple[bytes, bytes]]
"""The state and the picture of each frame, as bytes."""


def state(world: Any) -> bytes:  # noqa: ANN401  (highway-env has no types)
    """Return the raw floats of every vehicle's position, speed and heading."""
    rows = [[*vehicle.position, vehicle.speed, vehicle.heading] for vehicle in world.road.vehicles]
    return np.array(rows, dtype=np.float64).tobytes()


def episodes() -> Iterator[tuple[str, int]]:
    """Yield every episode's scenario and seed."""
    yield from ((scenario, seed) for scenario in DRIVES for seed in SEEDS)


def drive_stock(*, auto_render: bool) -> Frames:
    """Return the frames of stock highway-env, stepped and rendered by its public functions."""
    frames: Frames = {}
    for scenario, seed in episodes():
        setting = DRIVES[scenario]
        env: Any = gym.make(setting.env, config=dict(setting.config), render_mode="rgb_array")
        env.reset(seed=seed)
        world = env.unwrapped
        if scenario == BLOCKED:
            place = [world.vehicle.position[0] + BLOCKER_AHEAD_M, world.vehicle.position[1]]
            world.road.vehicles.append(Vehicle(world.road, place, heading=0.0, speed=0.0))
        for step in range(STEPS):
            if step:
                env.step(1)
            picture = env.render()
            world.enable_auto_render = auto_render
            frames[f"{scenario}-{seed}-{step}"] = state(world), picture.tobytes()
        world.viewer = None
    return frames


def drive_faster() -> Frames:
    """Return the frames of preset ``paper`` as ``Highway.build`` steps and draws them."""
    frames: Frames = {}
    for scenario, seed in episodes():
        camera = None
        for step, world in enumerate(drive_worlds(scenario, seed, STEPS)):
            camera = camera or StockCamera(world)
            frames[f"{scenario}-{seed}-{step}"] = state(world), camera.draw().tobytes()
    return frames


def build(preset: str) -> float:
    """Return the CPU seconds of a whole bank: worlds, counterfactuals, PNG and text."""
    with tempfile.TemporaryDirectory() as folder:
        make = open_simulator("highway").build
        return cpu_s(lambda: make(Path(folder) / "bank", preset=preset, seeds=SEEDS, steps=STEPS))


def measure(pairs: int) -> dict[str, float]:
    """Time the three ways; raises SystemExit where a state or a picture differs."""
    first = drive_faster()

    def equal(way: Callable[[], Frames]) -> Callable[[], None]:
        def checked() -> None:
            require_equal(first, way())

        return checked

    stock, quiet = equal(lambda: drive_stock(auto_render=True)), equal(lambda: drive_stock(auto_render=False))
    mine, theirs = alternating(equal(drive_faster), stock, pairs)
    again, without = alternating(equal(drive_faster), quiet, 1)
    return {
        "pairs": pairs,
        "frames": len(first),
        "faster_cpu_s": min(mine),
        "stock_cpu_s": min(theirs),
        "stock_without_auto_render_cpu_s": min(without),
        "ratio": max(ratios(mine, theirs)),
        "ratio_without_auto_render": max(ratios(again, without)),
        "bound": BOUND,
        "paper_bank_cpu_s": build("paper"),
        "balanced_bank_cpu_s": build("balanced"),
    }


def require_equal(first: Frames, others: Frames) -> None:
    """Raise SystemExit where a state or a picture differs."""
    for frame, (positions, picture) in first.items():
        if others[frame][0] != positions:
            raise SystemExit(f"frame '{frame}' has another state than in stock highway-env")
        if others[frame][1] != picture:
            raise SystemExit(f"frame '{frame}' has another picture than in stock highway-env")


def main() -> None:
    """Measure, print, and exit 1 below the bound."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--pairs", type=int, default=PAIRS)
    options = parser.parse_args()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # gymnasium warns of steps after the end, which the published bank has
        found = measure(options.pairs)
    keep("bench_bank", found)
    if options.json:
        print(json.dumps(found, indent=1))
    else:
        print(f"{found['frames']:.0f} frames, states and pictures equal to stock highway-env byte for byte")
        for name in ("faster_cpu_s", "stock_cpu_s", "stock_without_auto_render_cpu_s"):
            print(f"{name:32} {found[name]:7.2f}")
        print(
            f"ratio {found['ratio']:.1f} (bound {BOUND}), without auto-render {found['ratio_without_auto_render']:.1f}"
        )
        print(f"whole banks, CPU s: paper {found['paper_bank_cpu_s']:.1f}, balanced {found['balanced_bank_cpu_s']:.1f}")
    sys.exit(0 if found["ratio"] >= BOUND else 1)


if __name__ == "__main__":
    main()
