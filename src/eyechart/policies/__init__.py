"""Policies that need no model: one module a kind, one door for all, from an observation to an action."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

from eyechart.actions import ActionSpace, Decision
from eyechart.frames import RGB, Scalar


@dataclass(frozen=True, slots=True)
class Observation:
    """One moment of an episode, for a policy that is no model.

    ``frame`` is the moment's id (``highway/dense/3/017``). ``picture()`` is drawn when it is asked for, under the
    episode's condition; None where the condition shows none. ``truth`` is for scripted references (``oracle``) only: a
    model gets a Query, which has no field for it. ``seed`` belongs to this moment of this policy alone.
    """

    frame: str
    step: int
    picture: Callable[[], RGB | None]
    truth: Mapping[str, Scalar]
    action_space: ActionSpace
    seed: int


class Policy(Protocol):
    """The door to a policy: it keeps no state between moments, so that a cut episode can begin anew."""

    def decide(self, observation: Observation) -> Decision:
        """Return an action of the observation's space, or the reason there is none."""
        ...
