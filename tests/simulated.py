"""Simulated answers for the tests of scoring and of the rules: frames in memory, no picture, no ledger."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

import banks
from eyechart.frames import LEAD_GAP, Frame
from eyechart.spaces.discrete import DRIVING
from eyechart.spaces.space import Decision
from eyechart.studies.battery.answers import Answers

Rule = Callable[[str, Frame, np.random.Generator], str | None]
"""(condition, frame, generator) to an action, or None for an unparsed reply."""

CONDITIONS = ("real", "real_repeat", "blank", "noise", "shuffled", "cross_scenario", "text_only", "mirrored")
COUNTERFACTUALS = ("lead_near", "lead_far", "recoloured")


def frames(*, scenarios: int = 4, episodes: int = 3, steps: int = 12, seed: int = 0) -> tuple[Frame, ...]:
    """Return frames with independent gaps of 5 to 70 m and a nuisance that drifts through each episode."""
    rng = np.random.default_rng(seed)
    made = []
    for s in range(scenarios):
        for e in range(episodes):
            phase = rng.uniform()
            for t in range(steps):
                truth = {"lead_gap_m": round(float(rng.uniform(5, 70)), 3), "phase": (phase + t / 24) % 1}
                made.append(banks.one(f"s{s}-{e}-{t}", (f"s{s}", f"s{s}-{e}", t), "vertical", "-", truth=truth))
    return tuple(made)


def answers(rule: Rule, world: tuple[Frame, ...], *, counterfactuals: bool = True, seed: int = 0) -> Answers:
    """Ask a rule about every frame under every condition; the picture of another frame stands for it."""
    rng = np.random.default_rng(seed)
    names = CONDITIONS + (COUNTERFACTUALS if counterfactuals else ())
    decisions = {}
    for name in names:
        column = []
        for index, frame in enumerate(world):
            action = rule(name, _shown(name, frame, index, world, rng), rng)
            column.append(Decision(None, "unparsed") if action is None else Decision(action))
        decisions[name] = tuple(column)
    return Answers("simulated", world, DRIVING, LEAD_GAP, decisions, finished=len(world) * len(names))


def _shown(name: str, frame: Frame, index: int, world: tuple[Frame, ...], rng: np.random.Generator) -> Frame:
    """Return the frame whose world the picture of a condition shows."""
    if name in {"shuffled", "cross_scenario"}:
        same = name == "shuffled"
        others = [one for one in world if (one.scenario == frame.scenario) == same and one.id != frame.id]
        return others[int(rng.integers(len(others)))]
    if name in {"lead_near", "lead_far"}:
        truth = {**frame.truth, "lead_gap_m": 7.0 if name == "lead_near" else 55.0}
        return replace(frame, truth=truth)
    del index
    return frame


def gap(frame: Frame) -> float:
    """Return a frame's gap as a number."""
    return float(str(frame.truth["lead_gap_m"]))


def blind(condition: str) -> bool:
    """Return whether a condition shows no road."""
    return condition in {"blank", "noise", "text_only"}
