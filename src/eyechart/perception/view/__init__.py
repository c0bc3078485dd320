"""Calibrated views: each kind of picture is shown with a legend and a ruler, the same for every frame."""

from eyechart.perception.view.drawing import NONE, Mark, View
from eyechart.perception.view.known import CALIBRATED, VIEWS, find_view, scene_of, through, view_for

__all__ = ["CALIBRATED", "NONE", "VIEWS", "Mark", "View", "find_view", "scene_of", "through", "view_for"]
