"""A rover with a forward camera on a road with obstacles: frame banks with ground truth, and drives."""

from eyechart.simulators.rover.rover import Rover

__all__ = ["Rover"]
