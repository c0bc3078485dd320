"""Tiny banks of a rover's pictures: an obstacle ahead at one distance after the other, and one beside it or none."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import banks
from eyechart.cameras import ROVER
from eyechart.frames import MAIN, BankWriter, FrameBank, Gap, encode, open_bank
from eyechart.simulators.road.layout import Layout, Obstacle
from eyechart.simulators.road.truth import read_truth
from eyechart.simulators.road.world import draw
from eyechart.simulators.rover.world import RoverState, RoverWorld

GAPS_M = (3.0, 4.5, 6.0, 7.5, 9.0, 12.0, 16.0, 24.0)


def build_bank(out: Path, gaps_m: Sequence[float] = GAPS_M) -> FrameBank:
    """Write a bank of a frame a gap; in every second one an obstacle closes the left side."""
    gap = Gap(column="lead_gap_m", threshold=ROVER.distances.close_m, unit="m")
    said = replace(banks.manifest(), simulator="rover", picture="forward camera of a rover", gap=gap)
    with BankWriter(out, said) as writer:
        for step, gap_m in enumerate(gaps_m):
            ahead, beside = Obstacle(gap_m + 0.6, 0.0, 0.6, 1.0, 0), Obstacle(6.0, 2.0, 0.6, 1.0, 1)
            world = RoverWorld(
                Layout("single", (ahead, beside) if step % 2 else (ahead,)), RoverState(0.0, 0.0, 0.0, 1.0), 1
            )
            place = "single", "single-0", step
            frame = banks.one(f"single-0-{step}", place, "horizontal", f"images/{step}.png", truth=read_truth(world))
            writer.add(frame, {MAIN: encode(draw(world))}, {})
    return open_bank(out)
