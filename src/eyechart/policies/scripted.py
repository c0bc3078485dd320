"""Policies that follow the scene: one is told it by the simulator, one reads it from the picture."""

from dataclasses import dataclass

from eyechart.errors import SpecError
from eyechart.frames import RGB
from eyechart.perception.forward import read_forward, view_of
from eyechart.perception.renderer import read_picture
from eyechart.policies import Observation, Recorded, require_actions
from eyechart.spaces.discrete import Discrete
from eyechart.spaces.scene import Scene, safe_action
from eyechart.spaces.space import Decision

ACTIONS = ("SLOW", "STRAIGHT", "LEFT", "RIGHT")
NEEDS = ("demand", "left_clear", "right_clear")
"""The columns of ground truth that the oracle reads."""


@dataclass(frozen=True, slots=True)
class Oracle:
    """The scripted geometric controller: STRAIGHT on a free road, else LEFT or RIGHT where clear, else SLOW.

    The road is free where the safety policy demands STRAIGHT (on the highway: no lead nearer than 40 m). It reads the
    ground truth and no picture, so no condition changes it. Source: paper, Table t:baselines (oracle-geometric).
    """

    def decide(self, observation: Observation) -> Decision[str]:
        """Return the action; raises SpecError where the simulator tells no scene."""
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
    """Reads the scene from the picture's pixels alone and takes the safe action: proof that the picture suffices."""

    def decide(self, observation: Observation) -> Decision[str]:
        """Return the safe action, or a refusal where the picture shows no road."""
        picture = observation.picture()
        scene = None if picture is None else read_scene(picture)
        return Decision(None, "refused") if scene is None else Decision(safe_action(scene))


def read_scene(picture: RGB) -> Scene | None:
    """Return the scene of a picture of any of our worlds, by its pixels alone, or None where it shows no road."""
    view = view_of(picture)
    reading = read_picture(picture) if view is None else read_forward(picture, view)
    return None if reading is None else reading.scene


def oracle(name: str, space: Discrete, recorded: Recorded) -> Oracle:
    """Open ``oracle``."""
    del name, recorded
    require_actions("oracle", ACTIONS, space)
    return Oracle()


def positive_control(name: str, space: Discrete, recorded: Recorded) -> PositiveControl:
    """Open ``positive_control``."""
    del name, recorded
    require_actions("positive_control", ACTIONS, space)
    return PositiveControl()
