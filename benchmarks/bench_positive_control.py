"""Measures the image-only positive control: its time a frame, its gaps and its sides against the simulator.

Reported, not gated. Writes ``results/bench_positive_control.json``.
"""

import argparse
import json
import time
import warnings
from collections.abc import Iterator
from statistics import median
from typing import Any, NamedTuple

import gymnasium as gym
import highway_env  # noqa: F401  (its import registers the environments)
import numpy as np
from highway_env.vehicle.kinematics import Vehicle

from eyechart.perception.renderer import PX_PER_M, WIDTH_PX, HighwayReading, read_picture
from eyechart.spaces.scene import CLEAR_AHEAD_M, CLEAR_BEHIND_M
from pairs import keep

SCENARIOS: dict[str, tuple[str, dict[str, Any]]] = {
    "light": ("highway-v0", {"lanes_count": 3, "vehicles_count": 15}),
    "dense": ("highway-v0", {"lanes_count": 3, "vehicles_count": 20, "vehicles_density": 1.1}),
    "blocked": ("highway-v0", {"lanes_count": 3, "vehicles_count": 20}),
    "merge": ("merge-v0", {}),
}


class Shot(NamedTuple):
    """A picture and the truth: the nearest visible lead in metres, and whether left and right are clear."""

    rgb: np.ndarray
    gap_m: float | None
    clear: tuple[bool, bool]


def shoot(env: Any) -> Shot:  # noqa: ANN401
    """Render the world as it stands and ask it for the truth."""
    rgb = np.ascontiguousarray(env.render())
    env.enable_auto_render = False
    ego, network = env.vehicle, env.road.network
    index = network.get_closest_lane_index(ego.position, ego.heading)
    lanes = len(network.all_side_lanes(index))
    off_centre = network.get_lane(index).local_coordinates(ego.position)[1]
    others = [vehicle.position - ego.position for vehicle in env.road.vehicles if vehicle is not ego]
    edge = 0.7 * WIDTH_PX / PX_PER_M
    leads = [float(dx) for dx, dy in others if 0 < dx < edge and abs(dy) < 2]

    def is_clear(step: int) -> bool:
        beside = [dx for dx, dy in others if abs(dy + off_centre - 4 * step) <= 2]
        return 0 <= index[2] + step < lanes and not any(-CLEAR_BEHIND_M <= dx <= CLEAR_AHEAD_M for dx in beside)

    return Shot(rgb, min(leads, default=None), (is_clear(-1), is_clear(1)))


def drive(scenario: str, seeds: range, steps: int) -> Iterator[Shot]:
    """Yield the pictures of seeded random drives, each until it ends or crashes."""
    name, config = SCENARIOS[scenario]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # gymnasium says that merge-v0 has a successor
        env: Any = gym.make(name, render_mode="rgb_array", config=config).unwrapped
    for seed in seeds:
        env.reset(seed=seed)
        if scenario == "blocked":
            env.road.vehicles.append(Vehicle(env.road, env.vehicle.position + np.array([40.0, 0.0]), 0, 0))
        rng = np.random.default_rng(seed)
        for _ in range(steps):
            yield shoot(env)
            *_, terminated, truncated, _ = env.step(int(rng.integers(5)))
            if terminated or truncated:
                break
    env.close()


def measure(scenario: str, shots: list[Shot], repeats: int) -> dict[str, float | int | str | None]:
    """Return the scenario's row: every rate with its n, None where there is nothing to average."""
    seconds: list[float] = []
    readings: list[HighwayReading | None] = []
    for shot in shots:
        for _ in range(repeats):
            start = time.perf_counter()
            reading = read_picture(shot.rgb)
            seconds.append(time.perf_counter() - start)
        readings.append(reading)
    pairs = [(shot, reading) for shot, reading in zip(shots, readings, strict=True) if reading is not None]
    errors = [
        abs(reading.scene.gap_m - shot.gap_m)
        for shot, reading in pairs
        if shot.gap_m is not None and reading.scene.gap_m is not None
    ]
    leads = sum(shot.gap_m is not None for shot in shots)
    sides = [
        told == true
        for shot, reading in pairs
        for told, true in zip((reading.scene.left_clear, reading.scene.right_clear), shot.clear, strict=True)
    ]
    return {
        "scenario": scenario,
        "frames": len(shots),
        "read": len(pairs),
        "leads": leads,
        "coverage": len(errors) / leads if leads else None,
        "gap_mae_m": float(np.mean(errors)) if errors else None,
        "side_accuracy": sum(sides) / (2 * len(shots)),
        "mirrored_exactly": sum(read_picture(shot.rgb[::-1]) == reading.mirrored() for shot, reading in pairs),
        "median_ms": 1e3 * median(seconds),
    }


def main() -> None:
    """Run the scenarios and print a table, or JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=4, help="drives a scenario")
    parser.add_argument("--steps", type=int, default=15, help="most pictures a drive")
    parser.add_argument("--repeats", type=int, default=5, help="timed readings a picture")
    parser.add_argument("--json", action="store_true", help="print JSON")
    args = parser.parse_args()
    shots = {name: list(drive(name, range(args.seeds), args.steps)) for name in SCENARIOS}
    rows = [measure(name, some, args.repeats) for name, some in shots.items()]
    rows.append(measure("all", [shot for some in shots.values() for shot in some], args.repeats))
    keep("bench_positive_control", {"scenarios": rows})
    if args.json:
        print(json.dumps(rows, indent=2))
        return
    print("  ".join(f"{name:>16}" for name in rows[0]))
    for row in rows:
        cells = ["—" if v is None else f"{v:.4f}" if isinstance(v, float) else str(v) for v in row.values()]
        print("  ".join(f"{cell:>16}" for cell in cells))


if __name__ == "__main__":
    main()
