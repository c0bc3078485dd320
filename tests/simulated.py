"""Simulated answers for the tests of scoring and of the rules: frames in memory, no picture, no ledger."""

import math
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
RANGED = (
    *("lead_near_nudged", "lead_drawn", "lead_drawn_nudged", "exchange_own", "exchange_own_nudged"),
    *("exchange_beside", "exchange_apart"),
)
OLDER = ("lane_own", "lane_beside", "lead_mid_near", "lead_mid_far")
"""The controls of a bank of an older version, in place of those before."""
ALWAYS = ("nudged", "lead_absent", "real_again")
NEAR_M, FAR_M = 7.0, 55.0
SPREAD_M = {
    "lead_mid_near_m": (9.1, 20.0),
    "lead_mid_far_m": (20.0, 49.0),
    "lead_drawn_m": (5.0, 60.0),
    "exchange_m": (5.6, 49.0),
}


def frames(*, scenarios: int = 4, episodes: int = 3, steps: int = 12, seed: int = 0) -> tuple[Frame, ...]:
    """Return frames with independent gaps of 5 to 70 m and a nuisance that drifts through each episode.

    ``beside_m`` is how far a vehicle of the neighbouring lane is; one side is clear, by the step, at one in six none.
    """
    rng = np.random.default_rng(seed)
    made = []
    for s in range(scenarios):
        for e in range(episodes):
            phase = rng.uniform()
            for t in range(steps):
                even, other, third = ((len(made) * step) % 1 for step in (0.618034, 0.754878, 0.569840))
                spread = zip(SPREAD_M.items(), (even, other, third, (third + 0.5) % 1), strict=True)
                mids = {name: round(low * (high / low) ** one, 3) for (name, (low, high)), one in spread}
                ends = {"lane_near_m": NEAR_M, "lane_far_m": FAR_M, "beside_m": 10 + 50 * even}
                clear = {"left_clear": t % 6 in {0, 2}, "right_clear": t % 6 in {1, 3, 5}}  # of the rest neither
                sides = {**clear, "ego_lane": s % 2, "lanes": 2}
                moment = {"lead_gap_m": round(float(rng.uniform(5, 70)), 3), "phase": (phase + t / 24) % 1}
                truth = {**moment, **mids, **ends, **sides}
                made.append(banks.one(f"s{s}-{e}-{t}", (f"s{s}", f"s{s}-{e}", t), "vertical", "-", truth=truth))
    return tuple(made)


def answers(
    rule: Rule,
    world: tuple[Frame, ...],
    *,
    counterfactuals: bool = True,
    controls: tuple[str, ...] = (*RANGED, *ALWAYS),
    seed: int = 0,
) -> Answers:
    """Ask a rule about every frame under every condition; the picture of another frame stands for it."""
    rng = np.random.default_rng(seed)
    names = CONDITIONS + ((*COUNTERFACTUALS, *controls) if counterfactuals else ())
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
    moved: dict[str, dict[str, object]] = {
        "lead_near": {"lead_gap_m": NEAR_M},
        "lead_far": {"lead_gap_m": FAR_M},
        "lane_own": {"lead_gap_m": NEAR_M, "beside_m": FAR_M},
        "lane_beside": {"lead_gap_m": FAR_M, "beside_m": NEAR_M},
        "lead_absent": {"lead_gap_m": None},
        "exchange_beside": {"lead_gap_m": FAR_M, "beside_m": frame.truth.get("exchange_m")},
        "exchange_apart": {"lead_gap_m": FAR_M, "beside_m": FAR_M},
    }
    name = name.removesuffix("_nudged")
    if name in {"lead_mid_near", "lead_mid_far", "lead_drawn"}:
        return replace(frame, truth={**frame.truth, "lead_gap_m": number(frame, f"{name}_m")})
    if name == "exchange_own":
        return replace(frame, truth={**frame.truth, "lead_gap_m": number(frame, "exchange_m"), "beside_m": FAR_M})
    if name in moved:
        return replace(frame, truth={**frame.truth, **moved[name]})
    del index
    return frame


def gap(frame: Frame) -> float:
    """Return a frame's gap as a number, infinite where there is no lead."""
    return number(frame, "lead_gap_m")


def number(frame: Frame, column: str) -> float:
    """Return a column of a frame as a number, infinite where it holds none."""
    value = frame.truth[column]
    return math.inf if value is None else float(str(value))


def boxed(frame: Frame) -> bool:
    """Return whether a frame says that neither side is clear."""
    return not any(frame.truth.get(name, True) for name in ("left_clear", "right_clear"))


def blind(condition: str) -> bool:
    """Return whether a condition shows no road."""
    return condition in {"blank", "noise", "text_only"}
