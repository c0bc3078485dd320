"""Obstacles on a road of three tracks for vehicles with a forward camera: layouts to banks."""

from eyechart.simulators.road.drive import RoadDrive
from eyechart.simulators.road.layout import FAMILIES, GOAL_M, ROAD_HALF_M, TRACKS_M, Layout, Obstacle, make_layout
from eyechart.simulators.road.staged_moments import RoadBanks, Vehicle
from eyechart.simulators.road.truth import free_tracks, read_truth
from eyechart.simulators.road.world import DECISION_S, RoadWorld, cylinders, draw, eye_of, next_track, verge_of

__all__ = [
    "DECISION_S",
    "FAMILIES",
    "GOAL_M",
    "ROAD_HALF_M",
    "TRACKS_M",
    "Layout",
    "Obstacle",
    "RoadBanks",
    "RoadDrive",
    "RoadWorld",
    "Vehicle",
    "cylinders",
    "draw",
    "eye_of",
    "free_tracks",
    "make_layout",
    "next_track",
    "read_truth",
    "verge_of",
]
