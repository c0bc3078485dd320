"""An episode is a drive, and a step one of its decisions with what was executed and what came of it."""

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path

from eyechart.actions import Decision
from eyechart.calls import SILENT, CallKey
from eyechart.errors import LedgerError
from eyechart.frames import Scalar
from eyechart.simulators import Simulator

STUDY = "closed_loop"
EPISODES = "episodes.jsonl"
"""A run's finished episodes, one a line, in the order in which they ended."""

SILENCES: Mapping[str, frozenset[str]] = {"unfinished": frozenset(), "fail-safe": SILENT}
"""What becomes of a call that fails in a way that may pass, with the kinds of failure that are then a model's silence:
the episode is left for a resumed run, or the fail-safe is executed (docs/decisions/0027)."""


@dataclass(frozen=True, slots=True, order=True)
class EpisodeKey:
    """The identity of an episode: who drives, in which world, and what the camera's picture is replaced by."""

    policy: str
    simulator: str
    scenario: str
    seed: int
    condition: str = "real"

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
    to the policy. ``error`` is the kind of failure where the model's call failed. ``facts`` is what else the simulator
    says of the move. A model's Reply stands in the ledger under ``EpisodeKey.call``.
    """

    step: int
    frame: str
    decision: Decision
    executed_action: str
    truth: Mapping[str, Scalar]
    reward: float
    speed_mps: float
    distance_m: float
    crashed: bool
    facts: Mapping[str, Scalar] = field(default_factory=dict)
    error: str = ""


@dataclass(frozen=True, slots=True)
class Episode:
    """A drive that is over: ``ended`` is ``crash``, ``goal``, ``time`` or ``error``, of which ``detail`` says more.

    ``state_sha256`` is the digest of the world's state after the last step, for telling equal drives. An episode that
    ended in an error has the steps until then, and counts in no statistic.
    """

    key: EpisodeKey
    steps: tuple[Step, ...]
    ended: str
    state_sha256: str
    detail: str = ""

    @property
    def distance_m(self) -> float:
        """Return what was covered, 0 for an episode without a step."""
        return self.steps[-1].distance_m if self.steps else 0.0

    @property
    def reward(self) -> float:
        """Return the sum of the rewards."""
        return sum(step.reward for step in self.steps)

    @property
    def speed_mps(self) -> float | None:
        """Return the mean speed after a decision, None for an episode without a step."""
        return sum(step.speed_mps for step in self.steps) / len(self.steps) if self.steps else None

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


def fail_safe(simulator: Simulator) -> str:
    """Return what is executed where there is no decision: what the simulator declares, else its mildest brake.

    Source: paper, section Corpus and parsing: SLOW; under the model-predictive controller it is STOP.
    """
    space = simulator.action_space
    return getattr(simulator, "fail_safe", None) or (space.brake[-1] if space.brake else space.actions[0])


def read_episodes(path: Path) -> Iterator[Episode]:
    """Yield the finished episodes of a run folder; what a kill cut at the end of the file is no episode.

    Raises LedgerError, with the line, for anything else that is none.
    """
    file = path / EPISODES
    if not file.is_file():
        return
    lines = file.read_bytes().split(b"\n")
    for number, line in enumerate(lines[:-1], 1):
        try:
            yield _read(json.loads(line))
        except (ValueError, TypeError, KeyError, AttributeError) as error:
            raise LedgerError(f"{file}: line {number} is no episode: {error}") from error


def write_episodes(path: Path, episodes: Iterable[Episode]) -> None:
    """Append finished episodes to a run folder's file; each is on disk when this returns."""
    with (path / EPISODES).open("a", encoding="utf-8") as file:
        for episode in episodes:
            file.write(episode.as_line() + "\n")
        file.flush()


def mend_episodes(path: Path) -> None:
    """Cut off the beginning of an episode that a kill left at the end of a run folder's file, before more is added."""
    file = path / EPISODES
    if file.is_file():
        text = file.read_bytes()
        whole = text.rfind(b"\n") + 1
        if whole < len(text):
            with file.open("r+b") as opened:
                opened.truncate(whole)


def _read(raw: Mapping[str, object]) -> Episode:
    steps = raw["steps"]
    assert isinstance(steps, list)
    return Episode(
        key=EpisodeKey(**raw["key"]),  # type: ignore[arg-type]
        steps=tuple(Step(**{**step, "decision": Decision(**step["decision"])}) for step in steps),
        ended=str(raw["ended"]),
        state_sha256=str(raw["state_sha256"]),
        detail=str(raw["detail"]),
    )
