"""Policies that follow the scene: from the simulator's truth, or read from the picture.

One gets the free length of each track, and any policy can have left and right exchanged.
"""

from dataclasses import dataclass

from eyechart.errors import SpecError
from eyechart.frames import RGB
from eyechart.perception.forward import read_forward, view_of
from eyechart.perception.renderer import read_picture
from eyechart.policies import Observation, Policy, RecordedActions, open_policy
from eyechart.spaces.discrete import Discrete
from eyechart.spaces.scene import Scene, safe_action
from eyechart.spaces.space import Decision

NEEDS = ("demand", "left_clear", "right_clear")
"""The columns of ground truth that the oracle reads."""


@dataclass(frozen=True, slots=True)
class Oracle:
    """The scripted geometric controller: STRAIGHT if free, else LEFT or RIGHT if clear, else SLOW.

    The road is free where the safety policy demands STRAIGHT (on the highway: no lead nearer than
    40 m). It reads the ground truth and no picture, so no condition changes it. Source: paper,
    Table t:baselines (oracle-geometric).
    """

    def decide(self, observation: Observation) -> Decision[str]:
        """Return the action; raises SpecError if the simulator gives no scene."""
        truth = observation.truth
        if missing := [name for name in NEEDS if truth.get(name) is None]:
            raise SpecError(f"'oracle' needs a simulator that tells {', '.join(NEEDS)}; here {missing[0]} is missing")
        if truth["demand"] == "STRAIGHT":
            return Decision("STRAIGHT")
        if truth["left_clear"]:
            return Decision("LEFT")
        return Decision("RIGHT" if truth["right_clear"] else "SLOW")


@dataclass(frozen=True, slots=True)
class PositiveControl:
    """Reads the scene from the pixels alone and acts safely: proof that the picture suffices."""

    def decide(self, observation: Observation) -> Decision[str]:
        """Return the safe action, or a refusal if the picture shows no road."""
        picture = observation.picture()
        scene = None if picture is None else read_scene(picture)
        return Decision(None, "refused") if scene is None else Decision(safe_action(scene))


def read_scene(picture: RGB) -> Scene | None:
    """Return the scene of a picture of any shipped world by its pixels; None without a road."""
    view = view_of(picture)
    reading = read_picture(picture) if view is None else read_forward(picture, view)
    return None if reading is None else reading.scene


TRACKS = ("free_left_m", "free_middle_m", "free_right_m")
"""The columns of truth for the route: how far each track is free, in metres, from the left."""

_FREE_M = 15.0
_CLOSED_M = 5.0
_BETTER_M = 1.0
"""A track free so far needs no change; none leads on below; a better one is freer by so much."""


@dataclass(frozen=True, slots=True)
class Route:
    """Keeps a track that is free for 15 m, else takes the freest; STOP if none is free for 5 m.

    It reads the ground truth and no picture. It is the oracle of the paper's section Hierarchical
    VLM-MPC Diagnostic.
    """

    def decide(self, observation: Observation) -> Decision[str]:
        """Return the intent; raises SpecError if the simulator gives no free lengths of tracks."""
        truth = observation.truth
        free = [value for name in TRACKS if isinstance(value := truth.get(name), float | int)]
        own = truth.get("track")
        if len(free) < len(TRACKS) or not isinstance(own, int):
            raise SpecError(f"'route' needs a simulator that tells track, {', '.join(TRACKS)}, such as 'rover-mpc'")
        best = max(range(len(free)), key=lambda track: (free[track], -abs(track - own)))
        if free[own] >= _FREE_M:
            return Decision("STRAIGHT")
        if free[best] < _CLOSED_M:
            return Decision("STOP")
        if free[best] < free[own] + _BETTER_M:
            return Decision("SLOW")
        return Decision("LEFT" if best < own else "RIGHT")


@dataclass(frozen=True, slots=True)
class MirroredPolicy:
    """Decides like another policy with left and right exchanged: wrong wherever a side matters."""

    policy: Policy

    def decide(self, observation: Observation) -> Decision[str]:
        """Return the policy's action with sides exchanged, or its reason for none."""
        decision = self.policy.decide(observation)
        return Decision(observation.action_space.reflect(decision.action)) if decision.action else decision


def mirrored(name: str, space: Discrete, recorded: RecordedActions) -> MirroredPolicy:
    """Open ``mirrored:POLICY``."""
    return MirroredPolicy(open_policy(name, space, recorded))
