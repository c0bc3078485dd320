"""Forward pictures: what a reader has to know of them, and the image-only reader."""

from eyechart.perception.forward.reading import ForwardReading, read_forward
from eyechart.perception.forward.view import DRONE, HAZE, ROVER, VIEWS, Colour, View, distances_of, haze_share, view_of

__all__ = [
    "DRONE",
    "HAZE",
    "ROVER",
    "VIEWS",
    "Colour",
    "ForwardReading",
    "View",
    "distances_of",
    "haze_share",
    "read_forward",
    "view_of",
]
