"""Pictures of the rover's forward camera at random moments, each with what a planner has to know of it.

They come from the rover's own ray caster: it is quick, so nothing needs to be redrawn. No world here is one of a bank's
or of a drive's: layouts have seeds that neither takes, and obstacles stand where no family puts them.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image

from eyechart.simulators.road import FAMILIES, TRACKS_M, Layout, make_layout
from eyechart.simulators.road.layout import new_obstacle
from eyechart.simulators.road.truth import read_scene
from eyechart.simulators.road.world import draw
from eyechart.simulators.rover.world import RoverState, RoverWorld, touches

SIDE = 64
FIRST_SEED = 2**31
"""Seeds of layouts from here on: no bank and no drive is asked for one as large by hand."""

BITS = ("lead <15 m", "lead <8 m", "lead <5 m", "left clear", "right clear", "left track", "right track", "road")
"""What the first stage learns to tell of a picture."""

SWAPPED = (0, 1, 2, 4, 3, 6, 5, 7)


@dataclass(frozen=True)
class Moments:
    """Pictures (n, 64, 64, 3), uint8, and their bits (n, 8) in the order of ``BITS``."""

    pictures: npt.NDArray[np.uint8]
    bits: npt.NDArray[np.bool_]

    def with_flips(self) -> "Moments":
        """Return the moments, and after them their reflections."""
        pictures = np.concatenate((self.pictures, self.pictures[:, :, ::-1]))
        return Moments(pictures, np.concatenate((self.bits, self.bits[:, SWAPPED])))


def take(count: int, seed: int) -> Moments:
    """Return so many moments of one stream of random numbers."""
    rng = np.random.default_rng((7, seed))
    pictures = np.empty((count, SIDE, SIDE, 3), np.uint8)
    bits = np.empty((count, len(BITS)), np.bool_)
    for number in range(count):
        world = _moment(rng)
        picture = Image.fromarray(draw(world, red=bool(rng.random() < 0.1)))
        pictures[number] = np.asarray(picture.resize((SIDE, SIDE), Image.Resampling.LANCZOS))
        scene = read_scene(world)
        gap_m = np.inf if scene.gap_m is None else scene.gap_m
        sides = (world.track + 1 < len(TRACKS_M), world.track > 0)
        bits[number] = (gap_m < 15, gap_m < 8, gap_m < 5, scene.left_clear, scene.right_clear, *sides, True)
    return Moments(pictures, bits)


def _moment(rng: np.random.Generator) -> RoverWorld:
    """Return the rover somewhere on a road, on a track or on its way to one, touching nothing."""
    while True:
        family = str(rng.choice(list(FAMILIES)))
        track = int(rng.integers(len(TRACKS_M)))
        x = float(rng.uniform(0, 92))
        layout = make_layout(family, int(FIRST_SEED + rng.integers(2**31)))
        if rng.random() < 0.6:
            layout = _scattered(family, x, rng)
        off, yaw = float(rng.normal(0, 0.12)), float(rng.normal(0, 0.025))
        if rng.random() < 0.4:
            off = float(rng.uniform(-1, 1))
            yaw = float(np.clip(-0.4 * off + rng.normal(0, 0.08), -0.5, 0.5))
        state = RoverState(x, TRACKS_M[track] + off, yaw, float(rng.uniform(1, 4.5)))
        if not touches(state, layout):
            return RoverWorld(layout, state, track)


def _scattered(family: str, x: float, rng: np.random.Generator) -> Layout:
    """Return obstacles at any distance ahead, mostly on tracks, the near ones as often as the far ones."""
    found = []
    for _ in range(int(rng.integers(1, 8))):
        ahead = float(rng.uniform(2.5, 18) if rng.random() < 0.7 else rng.uniform(-1, 40))
        across = float(TRACKS_M[int(rng.integers(len(TRACKS_M)))] + rng.uniform(-0.35, 0.35))
        if rng.random() < 0.2:
            across = float(rng.uniform(-3.5, 3.5))
        obstacle = new_obstacle(x + ahead, across, rng)
        if all(
            np.hypot(obstacle.x - other.x, obstacle.y - other.y) > obstacle.radius + other.radius + 0.05
            for other in found
        ):
            found.append(obstacle)
    return Layout(family, tuple(found))


def main() -> None:
    """Write moments to a file, so that several processes may take them: ``python organisms/forward.py --out FILE``."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--count", type=int, default=24_000)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    taken = take(args.count, args.seed)
    np.savez(args.out, pictures=taken.pictures, bits=taken.bits)


if __name__ == "__main__":
    main()
