"""A moment is one picture with its truth and the pictures of the same world with one thing changed."""

from typing import Any

import numpy as np

from eyechart.frames import RGB
from eyechart.simulators.banks import Moment
from eyechart.simulators.highway.truth import find_lead, gap_to, others, read_truth
from eyechart.simulators.highway.world import LANE_M, Camera, World, moved, recoloured
from eyechart.simulators.plan import other_gap

NEAR_M = (7.0, 9.0)
FAR_M = (50.0, 60.0)
"""Where ``lead_near`` and ``lead_far`` put the lead, centre to centre."""

_CAR_M = 5.0
_BUMPER_M = 1.0


def record(world: World, camera: Camera, rng: np.random.Generator) -> Moment:
    """Return a world's moment with every counterfactual that can be drawn honestly; none after a crash.

    The lead is moved only along a lane that is free from where it was to where it goes.
    """
    lead = find_lead(world)
    gap_m = None if lead is None else gap_to(world.vehicle, lead)
    near_m, far_m = other_gap(gap_m, NEAR_M, rng), other_gap(gap_m, FAR_M, rng)
    pictures: dict[str, RGB | None] = {}
    if not world.vehicle.crashed:
        pictures["lead_near"] = _draw_with_lead_at(world, camera, near_m)
        pictures["lead_far"] = _draw_with_lead_at(world, camera, far_m)
        with recoloured(world.vehicle):
            pictures["recoloured"] = camera.draw()
    drawn = {name: picture for name, picture in pictures.items() if picture is not None}
    return Moment(truth=read_truth(world), picture=camera.draw(), counterfactuals=drawn)


def _draw_with_lead_at(world: World, camera: Camera, gap_m: float) -> RGB | None:
    """Return the picture with the lead at this gap, or None where it cannot get there."""
    lead = find_lead(world)
    if lead is None:
        return None
    x = float(world.vehicle.position[0]) + gap_m
    if not _way_is_free(world, lead, x):
        return None
    with moved(lead, x):
        return camera.draw() if find_lead(world) is lead else None


def _way_is_free(world: World, lead: Any, x: float) -> bool:  # noqa: ANN401  (highway-env has no types)
    reach = _CAR_M + _BUMPER_M
    low, high = sorted((float(lead.position[0]), x))
    return not any(
        low - reach < vehicle.position[0] < high + reach
        and abs(vehicle.position[1] - lead.position[1]) < LANE_M - _BUMPER_M
        for vehicle in others(world)
        if vehicle is not lead
    )
