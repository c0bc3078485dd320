"""References for intents: one that is told how far each track is free, and any policy with left and right exchanged."""

from dataclasses import dataclass

from eyechart.errors import SpecError
from eyechart.policies import Observation, Policy, Recorded, open_policy, require_actions
from eyechart.spaces.discrete import Discrete
from eyechart.spaces.space import Decision

TRACKS = ("free_left_m", "free_middle_m", "free_right_m")
"""The columns of ground truth that the route reads: how far each track is free, in metres, from the left."""

_FREE_M = 15.0
_CLOSED_M = 5.0
_BETTER_M = 1.0
"""From where a track needs no change, below which no track leads on, and by how much another has to be freer."""


@dataclass(frozen=True, slots=True)
class Route:
    """Keeps a track that is free for 15 m, else goes towards the freest one; STOP where none leads on for 5 m.

    It reads the ground truth and no picture: the oracle of the paper's section Hierarchical VLM-MPC Diagnostic.
    """

    def decide(self, observation: Observation) -> Decision[str]:
        """Return the intent; raises SpecError where the simulator does not tell how far its tracks are free."""
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
class Mirrored:
    """Decides as another policy does, with left and right exchanged: what it does is wrong wherever a side matters."""

    policy: Policy

    def decide(self, observation: Observation) -> Decision[str]:
        """Return the other side of the policy's action, or the reason why it has none."""
        decision = self.policy.decide(observation)
        return Decision(observation.action_space.reflect(decision.action)) if decision.action else decision


def route(name: str, space: Discrete, recorded: Recorded) -> Route:
    """Open ``route``."""
    del name, recorded
    require_actions("route", ("STOP", "SLOW", "STRAIGHT", "LEFT", "RIGHT"), space)
    return Route()


def mirrored(name: str, space: Discrete, recorded: Recorded) -> Mirrored:
    """Open ``mirrored:POLICY``."""
    return Mirrored(open_policy(name, space, recorded))
