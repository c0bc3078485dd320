"""An episode is a drive, and a step one of its decisions with what was executed and what came of it."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field

from eyechart.calls import SILENT, CallKey
from eyechart.frames import Scalar
from eyechart.records import Count, Name
from eyechart.spaces.space import Decision

STUDY = "closed_loop"

SILENCES: Mapping[str, frozenset[str]] = {"unfinished": frozenset(), "fail-safe": SILENT}
"""What becomes of a call that fails in a way that may pass, with the kinds of failure that are then a model's silence:
the episode is left for a resumed run, or the fail-safe is executed (docs/decisions/0027)."""


@dataclass(frozen=True, slots=True, order=True)
class EpisodeKey:
    """The identity of an episode: who drives, in which world, and what the camera's picture is replaced by."""

    policy: Name
    simulator: Name
    scenario: Name
    seed: Count
    condition: Name = "real"

    @property
    def world(self) -> str:
        """Return the world's name, which every policy and condition shares: ``highway/dense/3``."""
        return f"{self.simulator}/{self.scenario}/{self.seed}"

    def frame(self, step: int) -> str:
        """Return the id of the picture before a decision: ``highway/dense/3/017``."""
        return f"{self.world}/{step:03d}"

    def call(self, prompt: str, step: int) -> CallKey:
        """Return the key of the call that a model's decision of this step is."""
        return CallKey(STUDY, self.policy, prompt, self.frame(step), self.condition)


@dataclass(frozen=True, slots=True)
class Step:
    """One decision of an episode.

    ``truth`` is of the moment before the decision, ``reward``, ``speed_mps``, ``distance_m`` and ``crashed`` of the one
    after it. ``executed_action`` is the decision's or, where there is none, the fail-safe, which is never credited
    to the policy. ``error`` is the kind of failure where the model's call failed. A speed or a distance that the
    simulator does not tell is None. ``facts`` is what else the simulator says of the move. ``rounded_state_sha256`` is
    the digest of the world's state after it, its numbers rounded to 3 decimals; None where a record is older than that
    field, or the world told no state. A model's Reply stands in the ledger under ``EpisodeKey.call``.
    """

    step: Count
    frame: Name
    decision: Decision[Name]
    executed_action: Name
    truth: Mapping[str, Scalar]
    reward: float
    speed_mps: float | None
    distance_m: float | None
    crashed: bool
    facts: Mapping[str, Scalar] = field(default_factory=dict)
    error: str = ""
    rounded_state_sha256: str | None = None


@dataclass(frozen=True, slots=True)
class Episode:
    """A drive that is over: ``ended`` is ``crash``, ``goal``, ``time`` or ``error``, of which ``detail`` says more.

    ``state_sha256`` is the digest of the world's state after the last step, for telling equal drives. An episode that
    ended in an error has the steps until then, and counts in no statistic. ``max_steps`` is the bound that it was
    driven under: of more decisions it would have been an error; None where a record is older than that field.
    """

    key: EpisodeKey
    steps: tuple[Step, ...]
    ended: Name
    state_sha256: str
    detail: str = ""
    max_steps: Count | None = None

    @property
    def distance_m(self) -> float | None:
        """Return what was covered, 0 for an episode without a step, None where the simulator does not tell."""
        return self.steps[-1].distance_m if self.steps else 0.0

    @property
    def reward(self) -> float:
        """Return the sum of the rewards."""
        return sum(step.reward for step in self.steps)

    @property
    def speed_mps(self) -> float | None:
        """Return the mean speed after a decision, None without a step, or where the simulator does not tell it."""
        speeds = [step.speed_mps for step in self.steps if step.speed_mps is not None]
        return sum(speeds) / len(speeds) if speeds and len(speeds) == len(self.steps) else None

    @property
    def crashed(self) -> bool:
        """Return whether any step ended in a crash."""
        return any(step.crashed for step in self.steps)

    def actions(self) -> tuple[str, ...]:
        """Return what was executed, step by step: replayed in the same world it gives the same episode."""
        return tuple(step.executed_action for step in self.steps)

    def as_line(self) -> str:
        """Return the episode as one line of JSON."""
        return json.dumps(asdict(self), ensure_ascii=False, separators=(",", ":"), allow_nan=False)
