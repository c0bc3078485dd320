"""Known-answer estimators: each changes the scene read from the picture in a known way.

Each declares the clauses of admission that it must fail. They get what the image-only positive
control read, never the ground truth: a Query has no field for that. So no model, and no estimator,
can answer from the truth. The tests build one that knows the pictures by heart.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace

from eyechart.spaces.scene import Estimate, Scene

NO_ROAD = "I'm sorry, I cannot see a road in this picture."


@dataclass(frozen=True, slots=True)
class Estimator:
    """An estimator: its description, the reply that it makes of a scene, and what it must fail."""

    says: str
    tell: Callable[[Scene], str]
    fails: frozenset[str] = frozenset()

    def answer(self, scene: Scene | None) -> str:
        """Return the reply about a picture with this scene; a picture of no road is declined."""
        return NO_ROAD if scene is None else self.tell(scene)


def _over_calling(scene: Scene) -> str:
    called_m = (scene.distances.stop_m + scene.distances.close_m) / 2
    gap_m = called_m if scene.gap_m is None else min(scene.gap_m, called_m)
    return str(Estimate.of(replace(scene, gap_m=gap_m)))


def _silent_when_free(scene: Scene) -> str:
    text = str(Estimate.of(scene))
    if not scene.is_free:
        return text
    return json.dumps({name: value for name, value in json.loads(text).items() if name != "confidence"})


_CLOSE = frozenset({"close_accuracy", "balanced_accuracy"})

ESTIMATORS: dict[str, Estimator] = {
    "scene_positive_control": Estimator(
        "measures the scene by the picture's exact colours", lambda scene: str(Estimate.of(scene))
    ),
    "scene_constant": Estimator(
        "sees a free road with both sides clear, whatever it is shown",
        lambda _: str(Estimate.of(Scene(None, left_clear=True, right_clear=True))),
        _CLOSE | {"actions", "directional"},
    ),
    "scene_over_calling": Estimator("calls every lead close, and one where there is none", _over_calling, _CLOSE),
    "scene_side_blind": Estimator(
        "measures the gap, and takes both sides for clear",
        lambda scene: str(Estimate.of(replace(scene, left_clear=True, right_clear=True))),
        frozenset({"directional"}),
    ),
    "scene_one_sided": Estimator(
        "measures the gap, and reports the left clear and the right taken",
        lambda scene: str(Estimate.of(replace(scene, left_clear=True, right_clear=False))),
        frozenset({"scene_equivariance", "action_equivariance"}),
    ),
    "scene_distance_blind": Estimator(
        "sees the sides, and reports every lead midway between close and free",
        lambda scene: str(Estimate.of(replace(scene, gap_m=(scene.distances.close_m + scene.distances.free_m) / 2))),
        _CLOSE,
    ),
    "scene_silent_when_free": Estimator(
        "measures the scene, and leaves out a field if the road is free", _silent_when_free, frozenset({"parse"})
    ),
}
"""Estimators by name. ``fails`` holds on the admission set of a ``balanced`` bank."""
