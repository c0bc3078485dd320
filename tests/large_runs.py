"""Evidence as large as a page must bear: 20 models on 288 frames under 15 conditions, with a reply of its own each."""

import random
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

import banks
from eyechart.calls import Query, Reply
from eyechart.frames import BankWriter, FrameBank, decode, encode, open_bank
from eyechart.models.scripted import CONTROLLERS, see
from eyechart.studies.battery.scores import score
from eyechart.studies.battery.subjects import Evidence, read_evidence
from report_runs import make_run

MODELS, FRAMES, CONDITIONS = 20, 288, 15
ASKED = (
    *("real", "real_repeat", "blank", "noise", "shuffled", "cross_scenario", "text_only", "mirrored"),
    *("lead_near", "lead_far", "recoloured", "lane_own", "lane_beside", "lead_absent", "nudged"),
)
WORDS = (
    *("the", "road", "ahead", "shows", "a", "vehicle", "in", "my", "lane", "at", "some", "distance", "left", "right"),
    *("clear", "traffic", "moderate", "lateral", "gap", "closing", "speed", "therefore", "safe", "because", "brake"),
    *("maintain", "merge", "dense", "light", "own", "beside", "far", "near"),
)


def wordy(name: str, query: Query) -> Reply:
    """Answer as a known-answer controller does, after 45 words that no other call gets."""
    dice = random.Random(query.seed)  # noqa: S311 - no secret
    decided = CONTROLLERS[name].decide(see(query.image), dice)
    assert isinstance(decided, str)
    return Reply(f"{' '.join(dice.choices(WORDS, k=45)).capitalize()}.\n\n{decided}", "stop", prompt_tokens=312)


def build_bank(out: Path, *, times: int) -> FrameBank:
    """Write a bank of as many frames; pictures are ``times`` as large as those of ``banks``, with a grain on them."""
    grain = np.random.default_rng(0).integers(0, 8 if times > 1 else 1, (16 * times, 60 * times, 3), dtype=np.uint8)

    def large(picture: bytes) -> bytes:
        return encode(decode(picture, "a picture").repeat(times, axis=0).repeat(times, axis=1) ^ grain)

    with BankWriter(out, banks.manifest()) as writer:
        for code, frame in enumerate(banks.frames_of(banks.SCENARIOS, 8, 12, "vertical", drawn=True, controls=True)):
            own, others = banks.pictures_of(frame, code)
            sides = {name: {at: large(one) for at, one in side.items()} for name, side in others.items()}
            writer.add(frame, {at: large(one) for at, one in own.items()}, sides)
    return open_bank(out)


def large_evidence(folder: Path, names: Sequence[str], *, times: int = 1) -> Evidence:
    """Ask known-answer controllers through the real run, score them, and return copies of them as 20 models."""
    models = {name: partial(wordy, name) for name in names}
    run = make_run(build_bank(folder / "bank", times=times).root, folder / "run", models, conditions=ASKED)
    (evidence,) = read_evidence([run], score=partial(score, resamples=199))
    return copied(evidence, MODELS // len(names))


def copied(one: Evidence, copies: int) -> Evidence:
    """Return evidence with each model so many times, each copy with words of its own in every reply."""
    score, replies = one.score, {}
    named = {f"{spec}-{copy}": spec for spec in score.models for copy in range(copies)}
    for name, spec in named.items():
        dice = random.Random(name)  # noqa: S311 - no secret
        replies[name] = {
            key: replace(said, text=f"{name}: {' '.join(dice.choices(WORDS, k=12))}. {said.text}")
            for key, said in one.replies[spec].items()
        }
    manifest = replace(
        score.manifest,
        models=dict.fromkeys(named, "1"),
        modes={name: replace(score.manifest.modes[spec], spec=name) for name, spec in named.items()},
    )
    many = replace(
        score,
        manifest=manifest,
        models={name: replace(score.models[spec], model=name) for name, spec in named.items()},
        accounting={name: score.accounting[spec] for name, spec in named.items()},
        guards={name: score.guards[spec] for name, spec in named.items()},
    )
    return replace(one, score=many, replies=replies)
