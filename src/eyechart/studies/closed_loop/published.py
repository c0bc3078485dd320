"""The paper's ladder beside a run's: Table t:baselines, row by row, with the differences."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from eyechart.studies.closed_loop.ladder import Rung

PUBLISHED: Mapping[str, Mapping[str, float]] = {
    "constant:SLOW": {"distance_m": 514.4, "reward": 19.64, "speed_mps": 20.1, "crash_rate": 0.031},
    "oracle": {"distance_m": 444.5, "reward": 16.34, "speed_mps": 23.5, "crash_rate": 0.375},
    "random": {"distance_m": 339.3, "reward": 12.05, "speed_mps": 22.7, "crash_rate": 0.781},
    "constant:LEFT": {"distance_m": 211.3, "reward": 6.92, "speed_mps": 25.0, "crash_rate": 0.875},
    "constant:RIGHT": {"distance_m": 197.0, "reward": 7.01, "speed_mps": 25.0, "crash_rate": 1.0},
    "constant:STRAIGHT": {"distance_m": 145.8, "reward": 5.13, "speed_mps": 28.1, "crash_rate": 1.0},
}
"""Table t:baselines of the paper: 32 episodes a policy in highway-env. It leaves out STOP, whose row is SLOW's."""

SIMULATOR = "highway"
EPISODES = 32
NEAR = 0.02
"""A number within so much of the paper's, relatively, is called the same."""


@dataclass(frozen=True)
class Beside:
    """A row of ours and what it is beside the paper's: relative differences, for the crash rate points of it."""

    rung: Rung
    differences: Mapping[str, float]

    @property
    def apart(self) -> tuple[str, ...]:
        """Return what lies further from the paper than 2 %, for crashes than one episode."""
        one_episode = 1.0 / max(1, self.rung.statistics["crash_rate"].n) + 0.001  # the paper prints one digit
        near = {name: one_episode if name == "crash_rate" else NEAR for name in self.differences}
        return tuple(name for name, by in self.differences.items() if abs(by) > near[name])

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        policy = self.rung.driver.policy
        return {"policy": policy, "paper": dict(PUBLISHED[policy]), "differences": dict(self.differences)}


def beside_paper(rungs: Sequence[Rung]) -> list[Beside]:
    """Return the rows that the paper's table has too, in its order: real pictures in the highway only."""
    mine = {
        one.driver.policy: one for one in rungs if (one.driver.simulator, one.driver.condition) == (SIMULATOR, "real")
    }
    found = []
    for policy, row in PUBLISHED.items():
        if policy in mine:
            values = {name: mine[policy].statistics[name].value for name in row}
            differences = {
                name: value - row[name] if name == "crash_rate" else value / row[name] - 1
                for name, value in values.items()
                if value is not None
            }
            found.append(Beside(mine[policy], differences))
    return found


def unlike(rows: Sequence[Beside]) -> str:
    """Return in words that some rows are of other episodes than the paper's, nothing where all have as many."""
    counts = sorted({row.rung.statistics["reward"].n for row in rows} - {EPISODES})
    if not counts:
        return ""
    mine = " or ".join(map(str, counts))
    return f"the paper's rows are of {EPISODES} episodes in four scenarios, these of {mine}: drive the whole ladder"


def leads(rungs: Sequence[Rung]) -> dict[str, list[str]]:
    """Return who is best by each of distance, reward and crash rate among some rows; several where they are equal."""
    best: dict[str, list[str]] = {}
    for name, sign in (("distance_m", 1), ("reward", 1), ("crash_rate", -1)):
        values = {one.driver.label: sign * value for one in rungs if (value := one.statistics[name].value) is not None}
        best[name] = [label for label, value in values.items() if value == max(values.values())]
    return best
