"""A scene is a structured estimate of one picture; a fixed policy turns it into one of five actions."""

from dataclasses import dataclass, replace

from eyechart.cameras import Distances

CLOSE_GAP_M = 18.0
"""A lead nearer than this, centre to centre, is close (paper, section The Input-Ablation Battery)."""

STOP_GAP_M = 12.0
"""Nearer than this the safe action is STOP whatever the sides are."""

FREE_GAP_M = 40.0
"""From here on the road ahead counts as free (the scripted geometric controller of Table t:baselines)."""

CLEAR_BEHIND_M = 12.0
CLEAR_AHEAD_M = 40.0
"""A side is clear when its lane exists and holds no vehicle centre from 12 m behind to 40 m ahead."""


HIGHWAY = Distances(STOP_GAP_M, CLOSE_GAP_M, FREE_GAP_M, CLEAR_BEHIND_M, CLEAR_AHEAD_M)
"""The paper's, at 20 to 30 m/s and centre to centre."""


@dataclass(frozen=True, slots=True)
class Scene:
    """What a controller needs to know of a picture.

    ``gap_m`` is the distance in metres to the nearest vehicle or obstacle ahead in the own lane, counted as its world
    counts it, or None where none is seen. ``left_clear`` and ``right_clear`` are as the driver sees them. ``distances``
    are those of the world.
    """

    gap_m: float | None
    left_clear: bool
    right_clear: bool
    distances: Distances = HIGHWAY

    @property
    def close(self) -> bool:
        """Whether a lead stands nearer than the world's threshold, 18 m on a highway."""
        return self.gap_m is not None and self.gap_m < self.distances.close_m

    @property
    def free(self) -> bool:
        """Whether the road ahead counts as free."""
        return self.gap_m is None or self.gap_m >= self.distances.free_m

    @property
    def blocked(self) -> bool:
        """Whether a lead stands so near that the safe action is to stop, whatever the sides are."""
        return self.gap_m is not None and self.gap_m < self.distances.stop_m

    def mirrored(self) -> "Scene":
        """Return the scene as its reflection across the lane axis shows it."""
        return replace(self, left_clear=self.right_clear, right_clear=self.left_clear)


def safe_action(scene: Scene) -> str:
    """Return the action of a fixed safety policy that is exactly equivariant under reflection.

    STRAIGHT where the road is free, STOP where a lead is very near, the one clear side where exactly one
    is clear, and SLOW otherwise (also where both sides are clear: a choice between them would be a prior).
    """
    if scene.free:
        return "STRAIGHT"
    if scene.blocked:
        return "STOP"
    if scene.left_clear != scene.right_clear:
        return "LEFT" if scene.left_clear else "RIGHT"
    return "SLOW"
