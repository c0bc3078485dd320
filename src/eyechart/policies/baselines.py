"""Policies that never look: a constant, a uniform draw, or a draw like another controller's."""

import random
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from eyechart.errors import SpecError, suggestion
from eyechart.policies import Observation, RecordedActions
from eyechart.spaces.discrete import Discrete
from eyechart.spaces.space import MISSING, Decision, Missing


@dataclass(frozen=True, slots=True)
class Constant:
    """Decides the same action at every moment."""

    action: str

    def decide(self, observation: Observation) -> Decision[str]:
        """Return the action."""
        del observation
        return Decision(self.action)


@dataclass(frozen=True, slots=True)
class Uniform:
    """Draws every action with the same probability, from the moment's own seed."""

    def decide(self, observation: Observation) -> Decision[str]:
        """Return an action of the observation's space."""
        return Decision(random.Random(observation.seed).choice(observation.action_space.actions))  # noqa: S311 - no secret


@dataclass(frozen=True, slots=True)
class Marginal:
    """Draws actions as often as a controller took them, without a picture.

    ``counts`` are the controller's decisions by action. For a driver of the same run they also
    count missing decisions by reason (``no decision: refused``), so the fail-safe drives as often.
    Source: paper, section The Input-Ablation Battery.
    """

    counts: Mapping[str, int]

    def decide(self, observation: Observation) -> Decision[str]:
        """Return a drawn action, or a missing decision as often as the controller had none."""
        rng = random.Random(observation.seed)  # noqa: S311 - no secret
        drawn = rng.choices(list(self.counts), weights=list(self.counts.values()))[0]
        missing = next((one for one in MISSING if drawn == without(one)), None)
        return Decision(drawn) if missing is None else Decision(None, missing)

    @property
    def version(self) -> str:
        """Return the counts as a run records them."""
        return str(dict(self.counts))


def without(missing: Missing) -> str:
    """Return the name under which a marginal counts decisions missing for a reason."""
    return f"no decision: {missing}"


def constant(name: str, space: Discrete, recorded: RecordedActions) -> Constant:
    """Open ``constant:ACTION``."""
    del recorded
    if name not in space.actions:
        known = f"{', '.join(space.actions)}{suggestion(name, space.actions)}"
        raise SpecError(f"'constant:{name}' is given as constant:ACTION, with one of {known}")
    return Constant(name)


def marginal(name: str, space: Discrete, recorded: RecordedActions) -> Marginal:
    """Open ``marginal:RUN``; raises SpecError if the run has no decision of these actions."""
    if not name:
        raise SpecError(
            "a marginal is given as marginal:RUN, with the folder of a run, or as marginal:SPEC, with "
            "another driver of the same run"
        )
    counts = dict(recorded(Path(name)))
    if strange := sorted(counts.keys() - set(space.actions)):
        raise SpecError(f"{name} holds decisions other than {', '.join(space.actions)}: {', '.join(strange)}")
    if not counts:
        raise SpecError(f"{name} holds no decision, so there is nothing to sample from")
    return drawn_like(counts, space)


def drawn_like(counts: Mapping[str, int], space: Discrete) -> Marginal:
    """Return the marginal of some counts: known actions and missing decisions; other names drop."""
    named = (*space.actions, *(without(one) for one in MISSING))
    return Marginal({drawn: counts[drawn] for drawn in named if drawn in counts})
