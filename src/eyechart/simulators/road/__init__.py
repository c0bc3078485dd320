"""Obstacles on a road of three tracks, for any vehicle with a forward camera: layouts, pictures, truth and banks."""

from eyechart.simulators.road.bank import RoadBanks
from eyechart.simulators.road.drive import RoadDrive
from eyechart.simulators.road.layout import FAMILIES, GOAL_M, ROAD_HALF_M, TRACKS_M, Layout, Obstacle, make_layout
from eyechart.simulators.road.picture import SCENERY, cylinders, draw, eye_of, verge_of
from eyechart.simulators.road.staging import Vehicle, stage
from eyechart.simulators.road.truth import find_lead, free_tracks, gap_to, read_scene, read_truth
from eyechart.simulators.road.world import DECISION_S, MIDDLE, TIME_S, AnyWorld, RoadWorld, next_track

__all__ = [
    "DECISION_S",
    "FAMILIES",
    "GOAL_M",
    "MIDDLE",
    "ROAD_HALF_M",
    "SCENERY",
    "TIME_S",
    "TRACKS_M",
    "AnyWorld",
    "Layout",
    "Obstacle",
    "RoadBanks",
    "RoadDrive",
    "RoadWorld",
    "Vehicle",
    "cylinders",
    "draw",
    "eye_of",
    "find_lead",
    "free_tracks",
    "gap_to",
    "make_layout",
    "next_track",
    "read_scene",
    "read_truth",
    "stage",
    "verge_of",
]
