"""Calibrated views: each kind of picture is shown with a legend and a ruler, the same for every frame.

Here are the views that there are, by simulator, and how a run finds its own again.
"""

from dataclasses import replace

from eyechart.cameras import FORWARD
from eyechart.errors import SpecError
from eyechart.frames import RGB, Stimulus, decode, encode
from eyechart.perception.view.drawing import NONE, Mark, View
from eyechart.perception.view.legends import forward, highway

__all__ = ["CALIBRATED", "NONE", "VIEWS", "Mark", "View", "find_view", "scene_of", "through", "view_for"]

CALIBRATED = "calibrated"
"""What ``--view`` takes besides ``none``: the view of the bank's simulator."""

VIEWS: dict[str, View] = {"highway": highway(), **{name: forward(name, one) for name, one in FORWARD.items()}}
"""The calibrated view of each simulator's pictures."""


def view_for(choice: str, simulator: str) -> View | None:
    """Return the view that ``--view`` asks for, None for ``none``; raises SpecError for what there is not."""
    if choice == NONE:
        return None
    if choice != CALIBRATED:
        raise SpecError(f"--view takes {CALIBRATED} or {NONE}, not '{choice}'")
    if simulator not in VIEWS:
        raise SpecError(
            f"there is no calibrated view of pictures from '{simulator}', only of {', '.join(VIEWS)}; "
            f"show them as they are with --view {NONE}"
        )
    return VIEWS[simulator]


def find_view(key: str) -> View | None:
    """Return the view of this key, None for ``none``; raises SpecError where it is unknown, or was another once."""
    if key == NONE:
        return None
    known = {view.key: view for view in VIEWS.values()}
    if key not in known:
        raise SpecError(f"there is no view '{key}' in this version of eyechart, which has {', '.join(known)}")
    return known[key]


def through(view: View | None, seen: Stimulus, name: str = "picture") -> Stimulus:
    """Return a stimulus with its pictures as a view shows them; itself without a view."""
    if view is None:
        return seen
    shown = {camera: encode(view.show(decode(image, name), name)) for camera, image in seen.images.items()}
    return replace(seen, images=shown)


def scene_of(pixels: RGB) -> RGB:
    """Return the picture behind a calibrated view, or the pixels as they are where they are no view."""
    restored = (view.restore(pixels) for view in VIEWS.values())
    return next((one for one in restored if one is not None), pixels)
