"""Policies without a model: a module for each kind, one protocol, from observation to action."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Protocol

from eyechart.errors import SpecError, did_you_mean
from eyechart.frames import RGB, Scalar
from eyechart.spaces.discrete import Discrete
from eyechart.spaces.space import Decision


@dataclass(frozen=True, slots=True)
class Observation:
    """One moment of an episode, for a policy that is no model.

    ``frame`` is the moment's id (``highway/dense/3/017``). ``picture()`` draws on demand, under the
    episode's condition; None if the condition shows none. ``truth`` is for scripted references
    (``oracle``) only: a model gets a Query, which has no field for it. ``seed`` is unique to this
    moment and policy.
    """

    frame: str
    step: int
    picture: Callable[[], RGB | None]
    truth: Mapping[str, Scalar]
    action_space: Discrete
    seed: int


class Policy(Protocol):
    """The protocol of a policy: no state between moments, so a cut episode can restart."""

    def decide(self, observation: Observation) -> Decision[str]:
        """Return an action of the observation's space, or the reason there is none."""


RecordedActions = Callable[[Path], Mapping[str, int]]
"""Returns how often each action was decided in a run's folder; a higher layer provides it."""

REFERENCES: dict[str, str] = {
    "constant": "eyechart.policies.baselines:constant",
    "random": "eyechart.policies.baselines:Uniform",
    "marginal": "eyechart.policies.baselines:marginal",
    "oracle": "eyechart.policies.scripted:Oracle",
    "route": "eyechart.policies.scripted:Route",
    "mirrored": "eyechart.policies.scripted:mirrored",
    "positive_control": "eyechart.policies.scripted:PositiveControl",
}
"""Policies without a model, by the first word of their SPEC, as ``module:function``.

The function gets the text after the colon, the action space, and a reader of runs' decisions. Any
other SPEC is a model's.
"""


_SIDES = ("SLOW", "STRAIGHT", "LEFT", "RIGHT")
BARE = {"random": (), "oracle": _SIDES, "route": ("STOP", *_SIDES), "positive_control": _SIDES}
"""Policies whose SPEC has no colon, with the actions that each needs; classes without arguments."""


def is_policy(spec: str) -> bool:
    """Return whether a SPEC names a policy that is no model."""
    return spec.partition(":")[0] in REFERENCES


def open_policy(spec: str, space: Discrete, recorded: RecordedActions) -> Policy:
    """Open the policy of a SPEC for these actions; the result can be sent to another process.

    Raises SpecError for an unknown name, and for a policy that needs other actions.
    """
    kind, _, name = spec.partition(":")
    if kind not in REFERENCES:
        raise SpecError(
            f"unknown policy '{spec}';{did_you_mean(spec, REFERENCES)} known are {', '.join(REFERENCES)}, and any "
            f"model's SPEC"
        )
    if name and kind in BARE:
        raise SpecError(f"'{spec}': policy '{kind}' takes nothing after its name")
    if lacking := [action for action in BARE.get(kind, ()) if action not in space.actions]:
        raise SpecError(f"'{kind}' drives with {', '.join(lacking)}, which action space '{space.name}' does not have")
    module, _, function = REFERENCES[kind].partition(":")
    opened = getattr(import_module(module), function)
    policy: Policy = opened() if kind in BARE else opened(name, space, recorded)
    return policy
