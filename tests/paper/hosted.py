"""The paper's five hosted models, rebuilt from the counts that it publishes: a bank, and a ledger of 5760 replies.

The paper prints rates, counts of actions, medians and p values, and no ledger. What they leave open was searched
once and stands here as literal counts. ``at_gap``: seeded hill climbing over the tables gap × action, exchanging two
frames at a time, until medians, I(A;g) and the p against the obstacle were those that are printed. ``columns``: the
counts of shuffled and cross_scenario (Qwen, Cosmos3, MiniCPM), or of blank, noise and text_only (Kimi), were scanned
in order, from the real ones or a constant outwards, until Cramér's V was the printed one; the others are the real ones.

The gaps themselves are pinned by p: MiniCPM's two rare actions (.125) allow quantile bins of 72/36/36 or of
62/10/36/36, and Kimi-K3's I = .122 at p = .030 needs four bins; with three its p is below .005.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment

import banks
import stand_ins
from eyechart.calls import CallKey, Query, Reply
from eyechart.conditions import BATTERY
from eyechart.frames import LEAD_GAP, MAIN, RGB, BankManifest, BankWriter, FrameBank, decode, encode, open_bank
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER, RunManifest, versions, write_run
from eyechart.modes import RequestMode
from eyechart.prompts import find_prompt
from eyechart.spaces.discrete import DRIVING

SCENARIOS = ("light", "dense", "merge", "blocked")
EPISODES, STEPS = 3, 12

ANSWERS = ("STOP", "SLOW", "STRAIGHT", "LEFT", "RIGHT", "UNPARSED")
"""The order of every tuple of counts below."""

Counts = tuple[int, int, int, int, int, int]

GAPS_M = {4.9: 2, 5.0: 60, 6.2: 5, 8.0: 5, 12.3: 9, 22.1: 10, 26.8: 9, 27.3: 8, 33.2: 12, 45.0: 12, 60.0: 12}
"""How many of the 144 frames have each gap: 81 are below 18 m, and the quantile bins hold 62, 10, 36 and 36."""


@dataclass(frozen=True)
class Column:
    """A model's answers to a condition: how often each, and how many of them equal the answer to the real frame."""

    counts: Counts
    agree: int


@dataclass(frozen=True)
class Hosted:
    """One model. ``at_gap`` counts its answers to real frames, a row for each of `GAPS_M`.

    ``columns`` holds the other conditions but mirrored. There ``turned`` counts the answers to frames whose real answer
    has a direction, ``swaps`` of which exchange it, and ``unturned`` those to the others. ``cut`` says that a missing
    answer was cut off by the token budget.
    """

    at_gap: tuple[Counts, ...]
    columns: Mapping[str, Column]
    turned: Counts = (0, 0, 0, 0, 0, 0)
    swaps: int = 0
    unturned: Counts = (0, 0, 0, 0, 0, 0)
    cut: bool = False


_QWEN = (57, 37, 0, 50, 0, 0)
_COSMOS = (13, 32, 86, 5, 8, 0)
_MINICPM = (0, 142, 2, 0, 0, 0)
_K26 = (27, 36, 33, 1, 2, 45)
_K3 = (40, 25, 38, 20, 20, 1)
_ALL_STOP = (144, 0, 0, 0, 0, 0)
_ALL_SLOW = (0, 144, 0, 0, 0, 0)

MODELS: dict[str, Hosted] = {
    "Qwen2.5-VL-72B": Hosted(
        at_gap=(
            (0, 2, 0, 0, 0, 0),
            (31, 7, 0, 22, 0, 0),
            (5, 0, 0, 0, 0, 0),
            (5, 0, 0, 0, 0, 0),
            (9, 0, 0, 0, 0, 0),
            (0, 9, 0, 1, 0, 0),
            (4, 5, 0, 0, 0, 0),
            (0, 8, 0, 0, 0, 0),
            (1, 1, 0, 10, 0, 0),
            (2, 2, 0, 8, 0, 0),
            (0, 3, 0, 9, 0, 0),
        ),
        columns={
            "real_repeat": Column(_QWEN, 141),
            "blank": Column(_ALL_STOP, 57),
            "noise": Column(_ALL_STOP, 57),
            "text_only": Column(_ALL_STOP, 57),
            "shuffled": Column((31, 40, 0, 73, 0, 0), 60),
            "cross_scenario": Column((31, 40, 0, 73, 0, 0), 48),
        },
        turned=(1, 25, 0, 24, 0, 0),
        unturned=(57, 37, 0, 0, 0, 0),
    ),
    "Cosmos3-SR-33B": Hosted(
        at_gap=(
            (0, 0, 0, 0, 2, 0),
            (7, 13, 31, 3, 6, 0),
            (3, 0, 2, 0, 0, 0),
            (2, 1, 2, 0, 0, 0),
            (0, 5, 4, 0, 0, 0),
            (0, 0, 9, 1, 0, 0),
            (0, 0, 9, 0, 0, 0),
            (0, 4, 3, 1, 0, 0),
            (1, 8, 3, 0, 0, 0),
            (0, 0, 12, 0, 0, 0),
            (0, 1, 11, 0, 0, 0),
        ),
        columns={
            "real_repeat": Column(_COSMOS, 126),
            "blank": Column(_ALL_SLOW, 32),
            "noise": Column(_ALL_STOP, 13),
            "text_only": Column(_ALL_SLOW, 32),
            "shuffled": Column((2, 32, 88, 10, 12, 0), 80),
            "cross_scenario": Column((2, 32, 88, 10, 12, 0), 69),
        },
        turned=(2, 3, 6, 0, 2, 0),
        unturned=(13, 32, 86, 0, 0, 0),
    ),
    "MiniCPM-V-4.5": Hosted(
        at_gap=(
            *((0, frames, 0, 0, 0, 0) for frames in list(GAPS_M.values())[:-1]),
            (0, 10, 2, 0, 0, 0),
        ),
        columns={
            "real_repeat": Column(_MINICPM, 144),
            "blank": Column(_ALL_STOP, 0),
            "noise": Column(_ALL_STOP, 0),
            "text_only": Column(_ALL_STOP, 0),
            "shuffled": Column(_ALL_SLOW, 142),
            "cross_scenario": Column(_ALL_SLOW, 142),
        },
        unturned=_ALL_SLOW,
    ),
    "Kimi-K2.6": Hosted(
        at_gap=(
            (0, 0, 1, 0, 0, 1),
            (6, 12, 14, 0, 2, 26),
            (0, 1, 1, 1, 0, 2),
            (1, 2, 1, 0, 0, 1),
            (5, 2, 0, 0, 0, 2),
            (0, 1, 7, 0, 0, 2),
            (0, 0, 4, 0, 0, 5),
            (5, 3, 0, 0, 0, 0),
            (4, 7, 0, 0, 0, 1),
            (3, 2, 5, 0, 0, 2),
            (3, 6, 0, 0, 0, 3),
        ),
        columns={
            "real_repeat": Column(_K26, 85),
            "blank": Column((0, 0, 0, 144, 0, 0), 1),
            "noise": Column((17, 17, 61, 0, 0, 49), 0),
            "text_only": Column((16, 17, 61, 0, 0, 50), 0),
            "shuffled": Column(_K26, 61),
            "cross_scenario": Column(_K26, 61),
        },
        turned=(0, 1, 1, 0, 0, 1),
        unturned=(27, 36, 33, 0, 0, 45),
        cut=True,
    ),
    "Kimi-K3": Hosted(
        at_gap=(
            (1, 1, 0, 0, 0, 0),
            (19, 10, 18, 4, 8, 1),
            (0, 1, 3, 0, 1, 0),
            (2, 0, 0, 2, 1, 0),
            (4, 0, 4, 1, 0, 0),
            (1, 2, 0, 6, 1, 0),
            (4, 1, 0, 0, 4, 0),
            (4, 1, 1, 1, 1, 0),
            (1, 4, 4, 3, 0, 0),
            (2, 2, 4, 0, 4, 0),
            (2, 3, 4, 3, 0, 0),
        ),
        columns={
            "real_repeat": Column(_K3, 30),
            "blank": Column((109, 8, 12, 7, 7, 1), 33),
            "noise": Column((15, 98, 14, 8, 8, 1), 27),
            "text_only": Column((13, 8, 108, 7, 7, 1), 24),
            "shuffled": Column(_K3, 30),
            "cross_scenario": Column(_K3, 30),
        },
        turned=(11, 7, 10, 6, 6, 0),
        swaps=9,
        unturned=(29, 18, 28, 14, 14, 1),
    ),
}

REFUSES_BLANKS = Hosted(
    at_gap=((0, 2, 0, 0, 0, 0), (0, 59, 0, 0, 0, 1), *((0, n, 0, 0, 0, 0) for n in list(GAPS_M.values())[2:])),
    columns={
        **dict.fromkeys(("real_repeat", "shuffled", "cross_scenario"), Column((0, 143, 0, 0, 0, 1), 144)),
        **dict.fromkeys(("noise", "text_only"), Column(_ALL_SLOW, 143)),
        "blank": Column((0, 90, 0, 0, 0, 54), 91),
    },
    unturned=_ALL_SLOW,
)
"""One action and parse failures only, 1 on real and 54 on blank frames (section The Input-Ablation Battery)."""


def build_bank(out: Path) -> FrameBank:
    """Write the bank of 4 scenarios × 3 episodes × 12 steps, its gaps spread over all of them."""
    gaps = [gap for gap, frames in GAPS_M.items() for _ in range(frames)]
    return write_bank(out, [gaps[37 * place % len(gaps)] for place in range(len(gaps))], [grey(0)] * len(gaps))


def write_bank(out: Path, gaps: Sequence[float], pictures: Sequence[RGB]) -> FrameBank:
    """Write a bank of 144 frames with these gaps and these pictures, in the order scenario, episode, step."""
    manifest = BankManifest("paper", "hosted", "pictures a few pixels wide", DRIVING, LEAD_GAP)
    place = 0
    with BankWriter(out, manifest) as writer:
        for scenario in SCENARIOS:
            for episode in range(EPISODES):
                for step in range(STEPS):
                    name = f"{scenario}-{episode}-{step}"
                    where, truth = (scenario, f"{scenario}-{episode}", step), {"lead_gap_m": gaps[place]}
                    frame = banks.one(name, where, "vertical", f"images/{name}.png", truth=truth)
                    writer.add(frame, {MAIN: encode(pictures[place])}, {})
                    place += 1
    return open_bank(out)


def grey(offset: int) -> RGB:
    """Return a picture of 8 × 8 pixels with a dark box, ``offset`` pixels above (negative) or below its middle."""
    pixels = np.full((8, 8, 3), 128, dtype=np.uint8)
    pixels[3 + offset : 5 + offset, 3:5] = 0
    return pixels


def deal(beside: Sequence[str], counts: Counts, agree: int) -> list[str]:
    """Return answers with these counts, exactly ``agree`` of which equal what stands at their place in ``beside``.

    Raises ValueError where no order of the answers does.
    """
    waiting, left, same = Counter(beside), Counter(dict(zip(ANSWERS, counts, strict=True))), Counter[str]()
    for _ in range(agree):  # an answer taken where most meet leaves the others room to miss each other
        most = max(ANSWERS, key=lambda name: (min(waiting[name], left[name]) > 0, waiting[name] + left[name]))
        for counter, change in ((same, 1), (waiting, -1), (left, -1)):
            counter[most] += change
    answers = []
    for name in beside:
        answers.append(name if same[name] > 0 else "")
        same[name] -= 1
    open_places = [place for place, answer in enumerate(answers) if not answer]
    rest = [name for name in ANSWERS for _ in range(left[name])]
    meets = np.array([[name == beside[place] for name in rest] for place in open_places], ndmin=2)
    for row, column in zip(*linear_sum_assignment(meets), strict=True):
        answers[open_places[row]] = rest[column]
    if len(rest) != len(open_places) or sum(map(str.__eq__, answers, beside)) != agree:
        raise ValueError(f"no order of {counts} agrees exactly {agree} times")
    return answers


def answers_of(model: Hosted, bank: FrameBank) -> dict[str, list[str]]:
    """Return a model's answers, condition by condition, in the order of the bank's frames."""
    waiting = {
        gap: [name for name, n in zip(ANSWERS, row, strict=True) for _ in range(n)]
        for gap, row in zip(GAPS_M, model.at_gap, strict=True)
    }
    real = [waiting[frame.truth["lead_gap_m"]].pop(0) for frame in bank]
    answers = {"real": real} | {name: deal(real, column.counts, column.agree) for name, column in model.columns.items()}
    has_direction = [name in DRIVING.directional for name in real]
    wanted = [DRIVING.reflect(name) for name, turned in zip(real, has_direction, strict=True) if turned]
    others = [name for name, turned in zip(real, has_direction, strict=True) if not turned]
    shared = sum(min(others.count(name), n) for name, n in zip(ANSWERS, model.unturned, strict=True))
    turned, unturned = iter(deal(wanted, model.turned, model.swaps)), iter(deal(others, model.unturned, shared))
    answers["mirrored"] = [next(turned) if each else next(unturned) for each in has_direction]
    return answers


def reply(answer: str, number: int, *, cut: bool) -> Reply:
    """Return a reply that holds this answer, in one of the forms that models use."""
    if answer == "UNPARSED":
        prose = Reply("The green vehicle is in the middle lane.", "stop", completion_tokens=9)
        return Reply("", "length", completion_tokens=4096) if cut else prose
    forms = (answer, f'{{"action": "{answer}"}}', f"The road ahead decides.\nACTION: {answer}")
    return Reply(forms[number % len(forms)], "stop", completion_tokens=2)


def write_ledger(out: Path, bank: FrameBank, models: Mapping[str, Hosted]) -> Path:
    """Write a finished run of these models on the bank, as `eyechart run battery` leaves it; return its folder."""
    prompt = find_prompt("baseline")
    manifest = RunManifest(
        study="battery",
        created="2026-01-01",
        seed=0,
        prompt=prompt,
        models=dict.fromkeys(models, "paper"),
        conditions=BATTERY,
        limit=None,
        shard=None,
        bank_path=str(bank.root),
        fingerprint=bank.manifest.fingerprint,
        versions=versions(),
    )
    out.mkdir()
    write_run(out, manifest, bank)
    with Ledger(out / LEDGER, create=True) as ledger, ledger.together():
        for spec, model in models.items():
            for condition, answers in answers_of(model, bank).items():
                for number, (frame, answer) in enumerate(zip(bank, answers, strict=True)):
                    key = CallKey("battery", spec, prompt.key, frame.id, condition)
                    ledger.close(ledger.begin(key, ""), reply(answer, number, cut=model.cut))
    return out


@dataclass(frozen=True)
class Symmetric(stand_ins.Held):
    """The paper's synthetic pixel-grounded policy: away from the darker half of the picture, else STRAIGHT."""

    version: str = "1"
    margin: float = 0.1

    async def answer(self, query: Query) -> Reply:
        """Answer from the pixels alone; no picture is as symmetric as a grey one."""
        if query.image is None:
            return Reply("STRAIGHT", "stop")
        pixels = decode(query.image, "the query's picture").astype(float)
        difference = pixels[:4].mean() - pixels[4:].mean()
        if abs(difference) < self.margin:
            return Reply("STRAIGHT", "stop")
        return Reply("LEFT" if difference > 0 else "RIGHT", "stop")


def build_symmetric_bank(out: Path, lopsided: int) -> FrameBank:
    """Write a bank whose box stands in the middle of the picture, but in ``lopsided`` frames above or below it."""
    spread = {round(place * 144 / lopsided): (-2, 2)[place % 2] for place in range(lopsided)}
    return write_bank(out, [20.0] * 144, [grey(spread.get(place, 0)) for place in range(144)])


def open_model(name: str, mode: RequestMode) -> Symmetric:
    """Open the policy under a SPEC of its own; there is one, and its name does not matter."""
    del name, mode
    return Symmetric()
