"""Episodes in one row for each policy under each condition; the means alone, to see that a run came out."""

from collections.abc import Iterable
from dataclasses import dataclass
from statistics import fmean

from eyechart.episodes.nouns import Episode
from eyechart.records import Plain


@dataclass(frozen=True, slots=True)
class Row(Plain):
    """Means over the episodes of one policy under one condition; None where no episode tells the number.

    ``episodes`` ended otherwise than in one of the ``errors``, which count in no mean. ``without_decision`` is the
    share of steps at which the fail-safe was executed because there was no decision.
    """

    policy: str
    condition: str
    episodes: int
    errors: int
    distance_m: float | None
    reward: float | None
    speed_mps: float | None
    crash_rate: float | None
    without_decision: float | None


def summarise(episodes: Iterable[Episode]) -> list[Row]:
    """Return the rows in the order in which a policy and a condition first come."""
    groups: dict[tuple[str, str], list[Episode]] = {}
    for episode in episodes:
        groups.setdefault((episode.key.policy, episode.key.condition), []).append(episode)
    return [_row(*names, group) for names, group in groups.items()]


def _row(policy: str, condition: str, group: list[Episode]) -> Row:
    good = [one for one in group if one.ended != "error"]
    steps = [step for one in good for step in one.steps]
    return Row(
        policy=policy,
        condition=condition,
        episodes=len(good),
        errors=len(group) - len(good),
        distance_m=_mean(one.distance_m for one in good),
        reward=fmean(one.reward for one in good) if good else None,
        speed_mps=_mean(one.speed_mps for one in good),
        crash_rate=fmean(one.crashed for one in good) if good else None,
        without_decision=fmean(step.decision.action is None for step in steps) if steps else None,
    )


def _mean(values: Iterable[float | None]) -> float | None:
    told = [value for value in values if value is not None]
    return fmean(told) if told else None
