"""What an adversary does on the pictures of a bank: its true effects, wrong orders and changes, by asking it at length.

The distances of its rule are the highway's. In another world, or where the bank shows few leads at some distance, the
same rule may do less, or nothing at all. So what a verdict may say of it is taken from the bank that the verdict is of.
"""

import random
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from adversary_door import adversary, looks, see_frame
from eyechart.calibrate.adversaries import Adversary
from eyechart.conditions import show
from eyechart.frames import LEAD_GAP, MAIN, Frame, FrameBank
from eyechart.models.scripted import Sight
from eyechart.spaces.discrete import DRIVING

DISTANCES = {
    "lead_near": "lane_near_m",
    "lead_mid_near": "lead_mid_near_m",
    "lead_mid_far": "lead_mid_far_m",
    "lead_far": "lane_far_m",
}
"""The conditions that move the lead, from the nearest, and the columns that say how far away it then is."""

DRAWS = 96
"""How often a rule with a coin is asked about a picture."""
CLEARLY = 0.4
"""Levels of braking by which the farther of two is braked for harder on the average, where the order is wrong."""
SMALL, LARGE = 0.10, 0.30
"""Below the one an effect, a share of frames or of changes is none to speak of; from the other on it is one."""
DRAWN = (*DISTANCES, "lane_own", "lane_beside", "recoloured")
ROADS = ("real", "shuffled", "cross_scenario", "mirrored", "nudged", *DRAWN)
NO_ROADS = ("blank", "noise", "text_only")
APART = 1.1
"""Distances of a ratio below this are about the same."""

Levels = NDArray[np.float64]


@dataclass(frozen=True)
class Truth:
    """Effects are wins less losses as a share of pairs; ``wrong`` is the share of frames whose order is wrong anywhere.

    ``changed`` is the share of answers that change with the picture of a road, beyond what its coin changes, in the
    condition with the most; ``reacts`` the same with no road to be seen. None where the bank shows no such pair.
    """

    near_far: float | None
    own_beside: float | None
    wrong: float | None
    changed: float
    reacts: float

    def of(self, declared: Adversary, label: str) -> Adversary:
        """Return what is declared, with what it does here in the place of what it does in general, to judge a label.

        Who is called ``presence_only`` may answer otherwise where there is no road to see. No more is required of a
        verdict than is declared.
        """
        most = self.changed if label == "presence_only" else max(self.changed, self.reacts)
        follows = None if self.follows and not declared.follows else self.follows
        return replace(declared, follows=follows, looks=True if most >= SMALL else None if most > 0 else False)

    @property
    def follows(self) -> bool | None:
        """Return whether its braking follows the distance of the lead; None between the two."""
        if self.near_far is None or self.own_beside is None or self.wrong is None:
            return None
        least = min(self.near_far, self.own_beside)
        if least < SMALL or self.wrong >= SMALL:
            return False
        return True if least >= LARGE else None


class Pictures:
    """What a bank shows under each condition, made and read once for all adversaries; no sight where it lacks one."""

    def __init__(self, bank: FrameBank) -> None:
        frames = list(bank)
        self.shown = {name: [_shown(name, frame, bank) for frame in frames] for name in (*ROADS, *NO_ROADS)}
        self.distances = {
            name: np.array([_number(frame.truth.get(column)) for frame in frames])
            for name, column in {"real": LEAD_GAP.column, **DISTANCES}.items()
        }


def _shown(condition: str, frame: Frame, bank: FrameBank) -> tuple[Mapping[str, str], Sight | None]:
    """Return what the rules of the pixels answer to a picture, for which it is decoded once, and what is seen in it."""
    if condition in DRAWN and condition not in frame.counterfactuals:
        return {}, None
    image = show(condition, frame, bank, 0).images.get(MAIN)
    return looks(image), see_frame(image)


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) else np.nan


def _answers(name: str, pictures: Pictures, condition: str, draws: int) -> NDArray[np.str_]:
    """Return an adversary's answers (draws, frames), empty where there is no picture or no action in the answer."""
    rng = random.Random(f"{name}/{condition}")  # noqa: S311 - no secret
    return np.array([[_answer(name, *shown, rng) for _ in range(draws)] for shown in pictures.shown[condition]]).T


def _answer(name: str, looked: Mapping[str, str], sight: Sight | None, rng: random.Random) -> str:
    if sight is None:
        return ""
    if name in looked:
        return looked[name]
    answer = adversary(name).decide(sight, rng)
    return answer if isinstance(answer, str) else ""


def _levels(answers: NDArray[np.str_]) -> Levels:
    known = {"": np.nan} | {action: DRIVING.project(action, "brake") for action in DRIVING.actions}
    return np.vectorize(lambda one: 0.0 if known[one] is None else known[one], otypes=[float])(answers)


def find_truth(name: str, pictures: Pictures) -> Truth:
    """Return what an adversary does on these pictures."""
    tried = _answers(name, pictures, "real", 4)
    draws = DRAWS if (tried != tried[0]).any() else 1
    answers = {condition: _answers(name, pictures, condition, draws) for condition in pictures.shown}
    levels = {condition: _levels(one) for condition, one in answers.items()}
    return Truth(
        near_far=_net(levels["lead_near"], levels["lead_far"]),
        own_beside=_net(levels["lane_own"], levels["lane_beside"]),
        wrong=_wrong(levels, pictures.distances),
        changed=max(_changed(answers, condition) for condition in ROADS[1:]),
        reacts=max(_changed(answers, condition) for condition in NO_ROADS),
    )


def _net(nearer: Levels, farther: Levels) -> float | None:
    apart = np.sign(nearer - farther)
    return float(np.nanmean(apart)) if (~np.isnan(apart)).any() else None


def _wrong(levels: Mapping[str, Levels], distances: Mapping[str, Levels]) -> float | None:
    """Return the share of frames on which the farther of two pictures is clearly braked for harder."""
    means = {name: one.mean(axis=0) for name, one in levels.items()}
    pairs = (*pairwise(DISTANCES), ("lead_near", "lead_far"), ("lane_own", "lane_beside"))
    reverse = [means[farther] - means[nearer] for nearer, farther in pairs]
    for name in DISTANCES:
        apart = np.log(distances[name] / distances["real"])
        reverse.append(np.where(np.abs(apart) > np.log(APART), np.sign(apart) * (means[name] - means["real"]), np.nan))
    table = np.array(reverse)
    tested = ~np.isnan(table).all(axis=0)
    return float((np.nan_to_num(table[:, tested], nan=-1.0) > CLEARLY).any(axis=0).mean()) if tested.any() else None


def _changed(answers: Mapping[str, NDArray[np.str_]], condition: str) -> float:
    """Return how much more often an answer differs from that to the true picture than two of those do."""
    real, other = answers["real"], answers[condition]
    have = (other != "").all(axis=0)
    if not have.any():
        return 0.0
    apart = float((real != other)[:, have].mean())
    coin = float((real != np.roll(real, 1, axis=0))[:, have].mean()) if len(real) > 1 else 0.0
    chance = 2.5 * np.sqrt(0.25 / real[:, have].size) if len(real) > 1 else 0.0
    return max(0.0, float(apart - coin - chance))
