"""Synthetic runs of episodes with known answers: gaps that nobody's actions change, and a digest of what was done."""

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from eyechart.calls import Reply
from eyechart.episodes import STUDY, Episode, EpisodeKey, EpisodesManifest, Step, write_episodes
from eyechart.frames import Scalar
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER
from eyechart.modes import RequestMode
from eyechart.prompts import PROMPTS
from eyechart.seeds import key_seed
from eyechart.simulators import open_simulator
from eyechart.spaces.discrete import DRIVING
from eyechart.spaces.space import Decision

SCENARIOS = ("light", "dense", "merge", "blocked")
SPEEDS = {"STOP": 20.0, "SLOW": 20.0, "STRAIGHT": 30.0, "LEFT": 25.0, "RIGHT": 25.0}
COMMANDS = {"STOP": "SLOWER", "SLOW": "SLOWER"}

Decide = Callable[[Mapping[str, Scalar], int, int], str | None]
"""From the truth, the step and the episode's seed to an action, or None for no decision."""


def scene(scenario: str, seed: int, step: int, *, forward: bool) -> dict[str, Scalar]:
    """Return the truth of a moment: gaps that wander, and for a forward camera the side of the nearest obstacle."""
    rng = np.random.default_rng(key_seed(scenario, seed, "world"))
    gaps = 30 + 25 * np.sin(rng.uniform(0, 7) + np.arange(40) * rng.uniform(0.2, 0.7))
    gap = float(gaps[step]) if rng.random(40)[step] > 0.1 else None
    sides = rng.choice(["left", "right", "centre"], 40)
    truth: dict[str, Scalar] = {
        "lead_gap_m": gap,
        "left_clear": bool(rng.random(40)[step] > 0.5),
        "right_clear": bool(rng.random(40)[step] > 0.5),
        "demand": "STRAIGHT" if gap is None or gap >= 40 else "SLOW",
        "crashed": False,
    }
    return {**truth, "nearest_side": str(sides[step])} if forward else truth


def episode(key: EpisodeKey, decide: Decide, *, steps: int = 20, ended: str = "time", forward: bool = False) -> Episode:
    """Drive one synthetic episode; equal commands in equal worlds give equal digests."""
    found, distance, done = [], 0.0, []
    for number in range(steps):
        truth = scene(key.scenario, key.seed, number, forward=forward)
        action = decide(truth, number, key.seed)
        decision = Decision(action) if action is not None else Decision(None, "unparsed", "no_action")
        executed = action or open_simulator("highway").declared.fail_safe
        distance += SPEEDS[executed]
        done.append(COMMANDS.get(executed, executed))
        crashed = ended == "crash" and number == steps - 1
        moved = {"reward": SPEEDS[executed] / 30, "speed_mps": SPEEDS[executed], "distance_m": distance}
        found.append(Step(number, key.frame(number), decision, executed, truth, crashed=crashed, **moved))
    digest = hashlib.sha256(f"{key.world} {done} {ended}".encode()).hexdigest()
    return Episode(key, tuple(found), ended, digest)


def drive(
    policy: str,
    decide: Decide,
    *,
    condition: str = "real",
    simulator: str = "highway",
    seeds: Iterable[int] = range(8),
    **how: object,
) -> list[Episode]:
    """Drive a policy through every scenario and seed."""
    keys = (EpisodeKey(policy, simulator, scenario, seed, condition) for scenario in SCENARIOS for seed in seeds)
    return [episode(key, decide, **how) for key in keys]


def always(action: str | None) -> Decide:
    """Return a policy of one action."""
    return lambda _truth, _step, _seed: action


def by_depth(truth: Mapping[str, Scalar], _step: int, _seed: int) -> str:
    """Brake by the gap."""
    gap = truth["lead_gap_m"]
    assert gap is None or isinstance(gap, float)
    return "STRAIGHT" if gap is None or gap > 35 else "SLOW" if gap > 15 else "STOP"


def tossing(name: str) -> Decide:
    """Toss a five-sided coin, from the moment's own seed."""
    return lambda truth, step, seed: DRIVING.actions[
        key_seed(name, str(truth["lead_gap_m"]), step, seed) % len(DRIVING.actions)
    ]


def make_run(
    out: Path,
    episodes: Sequence[Episode],
    *,
    models: Sequence[str] = (),
    simulator: str = "highway",
    world: Mapping[str, str] | None = None,
    scenarios: Sequence[str] = SCENARIOS,
) -> Path:
    """Write a run of episodes as the runner would."""
    out.mkdir(parents=True, exist_ok=True)
    policies = dict.fromkeys(one.key.policy for one in episodes)
    manifest = EpisodesManifest(
        created="2026-01-01",
        simulator=simulator,
        scenarios=tuple(scenarios),
        seeds=tuple(range(8)),
        conditions=tuple(dict.fromkeys(one.key.condition for one in episodes)),
        policies=dict.fromkeys(policies, ""),
        action_space=DRIVING,
        picture="none",
        prompt=PROMPTS["baseline"],
        seed=0,
        max_steps=1000,
        world=world or {},
        versions={},
        modes={spec: RequestMode(spec) for spec in models},
    )
    manifest.write(out)
    write_episodes(out, episodes)
    return out


def add_replies(
    out: Path, episodes: Sequence[Episode], reply: Callable[[Step, int], Reply], request: Callable[[Step], str]
) -> None:
    """Write the calls of models' episodes into the run's ledger, in order."""
    number = 0
    with Ledger(out / LEDGER, create=True) as ledger, ledger.together():
        for one in episodes:
            for step in one.steps:
                key = one.key.call(PROMPTS["baseline"].key, step.step)
                assert key.study == STUDY
                ledger.close(ledger.begin(key, request(step)), reply(step, number))
                number += 1
