"""Runs whose counts are the paper's: estimators, online drives, the ladder, the hierarchy and the prompt study.

The paper prints rates with their denominators, and no ledger. Each run here is made of any replies or drives that have
these counts; what the counts do not determine (metres, rewards, entropy) is not the paper's.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import hosted
import numpy as np

import banks
import drives
from eyechart.calls import CallKey, Reply
from eyechart.episodes import Episode, EpisodeKey
from eyechart.frames import LEAD_GAP, MAIN, BankManifest, BankWriter, FrameBank, encode, open_bank
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER, RunManifest, versions, write_run
from eyechart.prompts import Prompt, find_prompt, scene_prompt
from eyechart.run import spread
from eyechart.spaces.discrete import DRIVING
from eyechart.spaces.reader import READER
from eyechart.spaces.scene import HIGHWAY, SCENE_READER, Estimate
from eyechart.studies.hierarchy.plans import FAMILIES, MPC_ONLY, ORACLE, SIDED
from eyechart.studies.structured.online import VETTING

CLOSE, OTHER = 220, 68
"""The 288 static pairs: 220 with a close lead."""


class Local(NamedTuple):
    """An estimator of Table t:controller-local: frames called right, its error in metres, and counts of pairs.

    ``sensed`` of the 220 close frames and ``specified`` of the 68 others are called right. ``scene`` and ``action``
    pairs are equal after reflection; of ``turns`` directions ``swaps`` exchange; it crashes in ``crashes`` of 12.
    """

    sensed: int
    specified: int
    error_m: float
    scene: int
    action: int
    swaps: int
    turns: int
    crashes: int


LOCAL = {
    "Renderer positive": Local(220, 68, 0.090, 288, 288, 10, 10, 2),
    "Qwen3-VL-8B": Local(141, 17, 15.345, 73, 105, 16, 134, 1),
    "Gemma4-12B": Local(180, 61, 16.014, 115, 143, 0, 43, 8),
    "Qwen3.5-9B": Local(210, 53, 13.125, 9, 155, 9, 93, 1),
    "Qwen2.5-VL-7B": Local(211, 3, 53.653, 0, 251, 0, 1, 12),
    "Ministral3-8B": Local(219, 5, 6.240, 3, 160, 15, 112, 1),
    "MiniCPM-V-4.5": Local(159, 38, 11.049, 2, 62, 4, 199, 1),
}
"""Of sensitivity and specificity the paper prints one pair (Ministral's .995/.074); the others have its mean."""


def estimates(one: Local) -> list[tuple[Estimate, Estimate]]:
    """Return what an estimator told of each frame and of its reflection: close frames first, directions before all."""
    told = []
    for place in range(CLOSE + OTHER):
        close = place < one.sensed if place < CLOSE else place >= CLOSE + one.specified
        gap, turns = (14.0 if place < CLOSE else 25.0) + one.error_m, place < one.turns
        real = Estimate(gap, close, left_clear=True, right_clear=not turns, confidence=0.5)
        reflected = real.mirrored()
        equal = place if turns else place - one.turns + one.swaps  # its place among the pairs of equal action
        if equal < (one.swaps if turns else one.action):
            other = reflected if equal < one.scene else replace(reflected, confidence=0.4)
        else:
            other = real if turns else replace(reflected, close=True, gap_m=20.0, left_clear=False)
        told.append((real, other))
    return told


def static_run(folder: Path) -> Path:
    """Write the bank of 288 frames and a finished structured run on it."""
    manifest = BankManifest("paper", "static", "pictures a few pixels wide", DRIVING, LEAD_GAP)
    with BankWriter(folder / "bank", manifest) as writer:
        for place in range(CLOSE + OTHER):
            where = (hosted.SCENARIOS[place % 4], f"e{place % 12}", place)
            truth = {"lead_gap_m": 14.0 if place < CLOSE else 25.0}
            frame = banks.one(f"f{place:03}", where, "vertical", f"images/f{place:03}.png", truth=truth)
            writer.add(frame, {MAIN: encode(hosted.grey(0))}, {})
    bank = open_bank(folder / "bank")
    prompt = scene_prompt(bank.manifest.picture, HIGHWAY, None)
    said = {spec: estimates(one) for spec, one in LOCAL.items()}
    run = _begun(folder / "static", bank, "structured", prompt, LOCAL, ("real", "mirrored"))
    with Ledger(run / LEDGER, create=True) as ledger, ledger.together():
        for spec, told in said.items():
            for number, condition in enumerate(("real", "mirrored")):
                for frame, pair in zip(bank, told, strict=True):
                    key = CallKey("structured", spec, prompt.key, frame.id, condition)
                    ledger.close(ledger.begin(key, ""), Reply(str(pair[number]), "stop"))
    return run


def _begun(
    out: Path, bank: FrameBank, study: str, prompt: Prompt, models: Iterable[str], conditions: tuple[str, ...]
) -> Path:
    """Write what stands in a run's folder before its first call."""
    manifest = RunManifest(
        study=study,
        created="2026-01-01",
        seed=0,
        prompt=prompt,
        models=dict.fromkeys(models, "paper"),
        conditions=conditions,
        limit=QUERIES if study == "battery" else None,
        shard=None,
        bank_path=str(bank.root),
        fingerprint=bank.manifest.fingerprint,
        versions=versions(),
        reader=SCENE_READER if study == "structured" else READER,
    )
    out.mkdir(parents=True)
    write_run(out, manifest, bank)
    return out


def driven(keys: Sequence[EpisodeKey], action: str, *, crashes: int = 0, goals: int = 0) -> list[Episode]:
    """Return drives of one action, of which the first end in crashes, the next at the goal, the others in time."""
    ends = ["crash"] * crashes + ["goal"] * goals + ["time"] * (len(keys) - crashes - goals)
    return [drives.episode(key, drives.always(action), steps=4, ended=end) for key, end in zip(keys, ends, strict=True)]


def online_run(folder: Path) -> Path:
    """Write an online run of twelve worlds that passed the checks, in which the estimators crash so often."""
    worlds = [(scenario, seed) for scenario in drives.SCENARIOS for seed in range(3)]
    found = []
    for spec, one in LOCAL.items():
        keys = [EpisodeKey(spec, "highway", *world) for world in worlds]
        found += driven(keys, "SLOW", crashes=one.crashes)
    out = drives.make_run(folder / "online", found)
    passed = [
        {"scenario": scenario, "seed": seed, "frames": 4, "ended": "time", "actions": {"SLOW": 4}}
        | {"gap_mae_m": 0.05, "why": None, "unseen": 0}
        for scenario, seed in worlds
    ]
    (out / VETTING).write_text(json.dumps(passed))
    return out


LADDER = {
    "constant:SLOW": ("SLOW", 1),
    "oracle": ("SLOW", 12),
    "random": ("STRAIGHT", 25),
    "constant:LEFT": ("LEFT", 28),
    "constant:RIGHT": ("RIGHT", 32),
    "constant:STRAIGHT": ("STRAIGHT", 32),
}
"""Table t:baselines: how many of a policy's 32 episodes crash."""


def ladder_run(folder: Path) -> Path:
    """Write the ladder's drives."""
    found = []
    for policy, (action, crashes) in LADDER.items():
        keys = [EpisodeKey(policy, "highway", scenario, seed) for scenario in drives.SCENARIOS for seed in range(8)]
        found += driven(keys, action, crashes=crashes)
    return drives.make_run(folder / "ladder", found)


GEMMA = "ollama:gemma4"
Drove = tuple[str, str, str, int, int]
"""Who drove, what it was shown, its intent, and how often it reached the goal and crashed."""

HIERARCHY: Mapping[str, tuple[str, Sequence[str], int, Sequence[Drove]]] = {
    "primary": (
        "rover-mpc",
        FAMILIES,
        5,
        [
            (MPC_ONLY, "real", "STRAIGHT", 23, 0),
            (ORACLE, "real", "LEFT", 23, 0),
            ("random", "real", "SLOW", 14, 0),
            ("constant:LEFT", "real", "LEFT", 24, 0),
        ],
    ),
    "primary-models": (
        "rover-mpc",
        FAMILIES,
        5,
        [(GEMMA, "real", "SLOW", 8, 0), (GEMMA, "mirrored", "SLOW", 8, 0), (GEMMA, "blank", "STOP", 0, 0)],
    ),
    "constrained": ("rover-mpc", SIDED, 8, [(MPC_ONLY, "real", "STRAIGHT", 30, 2)]),
    "unaware": ("rover-mpc-unaware", SIDED, 8, [(MPC_ONLY, "real", "STRAIGHT", 1, 31)]),
    "unaware-models": ("rover-mpc-unaware", SIDED, 8, [(GEMMA, "real", "STOP", 0, 11)]),
    "lateral-models": (
        "rover-mpc-lateral",
        SIDED,
        8,
        [(GEMMA, "real", "LEFT", 0, 32), (GEMMA, "mirrored", "LEFT", 5, 27)],
    ),
}
"""Table t:mpc-intent and the second ablation, by the folder of each arm."""


def hierarchy_study(folder: Path) -> Path:
    """Write the drives of both ablations."""
    for part, (simulator, scenarios, seeds, drove) in HIERARCHY.items():
        found = []
        for policy, condition, action, goals, crashes in drove:
            keys = [
                EpisodeKey(policy, simulator, family, seed, condition) for family in scenarios for seed in range(seeds)
            ]
            found += driven(keys, action, crashes=crashes, goals=goals)
        models = [GEMMA] if part.endswith("models") else []
        drives.make_run(folder / "hierarchy" / part, found, models=models, simulator=simulator, scenarios=scenarios)
    return folder / "hierarchy"


QUERIES = 100
PROMPTS: Mapping[str, Mapping[str, tuple[int, int, int]]] = {
    "baseline": {"Qwen2.5-VL-72B": (37, 3, 63), "MiniCPM-V-4.5": (98, 2, 100), "SmolVLM": (89, 2, 11)},
    "minimal": {"SmolVLM": (48, 3, 53)},
    "chain_of_thought": {"Qwen2.5-VL-72B": (48, 6, 99), "MiniCPM-V-4.5": (49, 5, 97)},
    "few_shot": {"Qwen2.5-VL-72B": (96, 2, 100), "MiniCPM-V-4.5": (64, 3, 100), "SmolVLM": (100, 1, 0)},
    "anti_degeneracy": {"Qwen2.5-VL-72B": (93, 2, 100), "MiniCPM-V-4.5": (44, 4, 82), "SmolVLM": (92, 3, 8)},
}
"""Table t:prompts by prompt and model: the modal output's count, distinct outputs, and answers that blank changes."""


def prompt_study(folder: Path) -> Path:
    """Write a cell a prompt, of 100 frames shown real and blank."""
    bank = hosted.build_bank(folder / "prompts-bank")
    for name, models in PROMPTS.items():
        prompt = find_prompt(name)
        run = _begun(folder / "prompts" / name, bank, "battery", prompt, models, ("real", "blank"))
        frames = spread(bank.frames, QUERIES)
        with Ledger(run / LEDGER, create=True) as ledger, ledger.together():
            for spec, counts in models.items():
                for condition, answers in zip(("real", "blank"), _outputs(*counts), strict=True):
                    for number, (frame, answer) in enumerate(zip(frames, answers, strict=True)):
                        key = CallKey("battery", spec, prompt.key, frame.id, condition)
                        ledger.close(ledger.begin(key, ""), hosted.reply(answer, number, cut=False))
    return folder / "prompts"


def _outputs(modal: int, distinct: int, changed: int) -> tuple[list[str], list[str]]:
    """Return outputs of real pictures with these counts, and of blank ones."""
    others = [hosted.ANSWERS[1 + place % (distinct - 1)] for place in range(QUERIES - modal)] if distinct > 1 else []
    real = [hosted.ANSWERS[0]] * modal + others
    blank = [hosted.ANSWERS[(hosted.ANSWERS.index(one) + (place < changed)) % 5] for place, one in enumerate(real)]
    return real, blank


EDGE: Mapping[str, Mapping[str, Mapping[str, Sequence[int]]]] = {
    "drone": {
        "Qwen2-VL-2B": {"STRAIGHT": (45, 45, 45, 45)},
        "Qwen2-VL-7B": {"STRAIGHT": (45, 45, 45, 45)},
        "LLaVA-1.5-7B": {"STRAIGHT": (42, 40, 43, 42), "SLOW": (2, 4, 1, 0), "STOP": (1, 1, 1, 3)},
        "SmolVLM": {
            "STRAIGHT": (17, 25, 26, 29),
            "SLOW": (12, 15, 14, 6),
            "STOP": (18, 2, 4, 3),
            "LEFT": (2, 8, 6, 12),
            "RIGHT": (1, 0, 0, 0),
        },
    },
    "rover": {
        "Qwen2-VL-2B": {"STRAIGHT": (55, 55, 55, 55)},
        "LLaVA-1.5-7B": {"STRAIGHT": (55, 55, 55, 55)},
        "Qwen2-VL-7B": {"STRAIGHT": (55, 55, 55, 51), "SLOW": (0, 0, 0, 4)},
        "SmolVLM": {"SLOW": (29, 24, 37, 32), "STOP": (18, 23, 10, 15)},
    },
}
"""Decisions by quartile of the gap, found by search, that have every share and bit of Table t:degeneracy.

The paper prints no counts; those of a cell that varies are not the only ones with its digits, and p depends on them.
"""


def edge_runs(folder: Path) -> list[Path]:
    """Write drives of the eight cells, a run a platform."""
    made = []
    for platform, cells in EDGE.items():
        found = [one for spec, counts in cells.items() for one in _decided(spec, platform, counts)]
        made.append(drives.make_run(folder / platform, found, models=tuple(cells), simulator=platform))
    return made


def _decided(spec: str, platform: str, counts: Mapping[str, Sequence[int]]) -> list[Episode]:
    """Return drives of twenty steps in which these decisions are taken at gaps of these quartiles."""
    moments = [
        (action, 10.0 * quartile + 0.01 * number)
        for action, row in counts.items()
        for quartile, many in enumerate(row)
        for number in range(many)
    ]
    moments = [moments[place] for place in np.random.default_rng(0).permutation(len(moments))]
    result = []
    for number, start in enumerate(range(0, len(moments), 20)):
        mine = moments[start : start + 20]
        key = EpisodeKey(spec, platform, drives.SCENARIOS[number % 4], number // 4)
        whole = drives.episode(key, lambda _truth, step, _seed, mine=mine: mine[step][0], steps=len(mine))
        steps = [replace(step, truth={"lead_gap_m": mine[step.step][1]}) for step in whole.steps]
        result.append(replace(whole, steps=tuple(steps)))
    return result
