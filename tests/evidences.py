"""Random evidences of every axis, the same for a seed in every version: what older rules said of them is recorded."""

import hashlib
import re
from collections.abc import Callable, Iterator, Mapping
from random import Random

from eyechart.stats.agreement import SwapRate
from eyechart.stats.paired_tests import SignTest
from eyechart.stats.statistic import Statistic
from eyechart.verdicts.battery_rules import PICTURES

Found = dict[str, Statistic]

_FILE = ("repeat_over_nudged", "repeats_together")
_BOUNDS = tuple(
    f"bound_{name}"
    for name in (
        *("content_shuffled", "content_recoloured", "scene", "blank", "mirrored", "lead_near", "lead_far"),
        *("lead_absent", "noise", "text_only", "kappa"),
    )
)
_CONTENT = tuple(
    f"content_{nudged}{name}" for nudged in ("", "nudged_") for name in ("shuffled", "recoloured", "lead_absent")
)
_SHOWN = (*("depth_observational", "scene_cue", "presence", "presence_response", "kappa_pooled"),)
_SHARES = ("unparsed_reference", "self_disagreement", "kappa")
NAMES = (*_FILE, *_BOUNDS, *_CONTENT, *_SHOWN, *_SHARES)

_PS = (1e-6, 0.0033, 0.004, 0.0049999, 0.005, 0.0099999, 0.01, 0.0166, 0.02, 0.0499999, 0.05, 0.2, 0.8, 1.0)
_VALUES = (-0.3, 0.0, 0.01, 0.03, 0.045, 0.05, 0.0500001, 0.06, 0.07, 0.0700001, 0.1, 0.12, 0.2, 0.3, 0.5, 0.9, 1.0)
_LOWS = (-0.4, -0.1, 0.0, 1e-7, 0.02, 0.05, 0.0500001, 0.0999999, 0.1, 0.12, 0.2, 0.2000001, 0.3, 0.6)


def drawn(rng: Random, usual: Statistic, often: float) -> Statistic:
    """Return the usual statistic so often, else one at or beside the thresholds, with parts that may be missing."""
    if rng.random() < often:
        return usual
    if rng.random() < 0.12:
        return Statistic(None, 0, note="nothing was asked")
    p = None if rng.random() < 0.12 else rng.choice(_PS)
    low = rng.choice(_LOWS)
    ci = None if rng.random() < 0.1 else (low, low + rng.choice((0.0, 0.05, 0.2)))
    return Statistic(rng.choice(_VALUES), rng.choice((6, 36, 144)), ci, p, note="so many")


def usual(name: str, kind: str) -> Statistic:  # noqa: PLR0911 - a table
    """Return what a statistic is of a subject of a kind: a reader, one that is blind, or one that is neither."""
    shown, low, high = kind == "reader", 1e-6, 0.9
    if name in _FILE:
        return Statistic(0.0, 144, p=high)
    if name.startswith("bound_"):
        return Statistic(0.0, 144, (-0.05, 0.05), low if kind == "blind" else high)
    if name == "unparsed_reference":
        return Statistic(0.0, 144, (0.0, 0.01))
    if name == "self_disagreement":
        return Statistic(0.1 if kind != "coin" else 0.7, 144, (0.0 if kind != "coin" else 0.6, 0.8))
    if name == "kappa":
        return Statistic(0.9 if kind != "coin" else 0.0, 144, (0.8 if kind != "coin" else -0.1, 0.95))
    if name in {"presence", "presence_response"}:
        return Statistic(0.1, 144, p=low if kind == "reader" else high)
    if kind == "coin":
        return Statistic(0.0, 144, p=low if name == "kappa_pooled" else high)
    return Statistic(0.5, 144, (0.4, 0.6), low if shown and name in _SHOWN else high)


def distance(rng: Random) -> Found:
    """Return an evidence for the calibrated rules, of a model that does not brake harder for the near lead.

    What they say of one that does has changed since, and is none of it.
    """
    kind, often = rng.choice(("reader", "blind", "coin", "any")), rng.choice((0.5, 0.9, 0.97, 0.99))
    found = {name: drawn(rng, usual(name, kind), often) for name in NAMES}
    moved = Statistic(0.5, 144, p=rng.choice((None, 0.01, 0.4)))
    return found | {"depth_interventional": moved, "lane_net": Statistic(None, 0)}


def lateral(rng: Random) -> tuple[Found, dict[str, int]]:
    """Return an evidence for the lateral rules, and how often each direction was given."""
    swap: Statistic = drawn(rng, Statistic(0.9, 40, (0.7, 0.97), 1e-4), 0.5)
    if rng.random() < 0.9:
        chance = None if rng.random() < 0.1 else rng.choice((0.1, 0.3, 0.5, 0.6))
        swap = SwapRate(swap.value, swap.n, swap.ci, swap.p, note=swap.note, chance=chance)
    clear: Statistic = drawn(rng, Statistic(0.9, 30, p=1e-4), 0.6)
    if rng.random() < 0.7:
        clear = SignTest(clear.value, clear.n, clear.ci, clear.p, wins=clear.n, losses=0, ties=0)
    found = {"mirror_swap_rate": swap, "turns_clear": clear}
    found |= {f"turns_{name}": drawn(rng, Statistic(0.9, 30, p=1e-4), 0.5) for name in ("clear_within", "against")}
    return found, {side: rng.choice((0, 0, 3, 5, 8, 20)) for side in ("LEFT", "RIGHT")}


def paper(rng: Random) -> tuple[Found, float | None, int]:
    """Return an evidence for the paper's rules, the corrected p of V, and of how many conditions."""
    names = (
        *("cramers_v", "cramers_v.decision", "clears_floor", "idi", "noise_floor", "obstacle.decision"),
        *("mutual_information.decision", "gap_order", "mirror_swap_rate", "unparsed_rate"),
    )
    found = {name: drawn(rng, Statistic(0.5, 144, p=1e-4), 0.6) for name in names}
    found["clears_floor"] = Statistic(rng.choice((1.0, 1.0, 1.0, 0.0, None)), 144)
    if rng.random() < 0.9:
        found["unparsed_rate"] = Statistic(rng.choice((0.0, 0.1, 0.2)), 1152)
    return found, rng.choice((1e-6, 0.02, 0.0499999, 0.05, 0.3, None)), rng.choice((0, 1, 2, 8, 8))


def digests(say: Callable[[Random], str], seed: int, blocks: int, of: int = 1000) -> Iterator[str]:
    """Yield for each block of evidences a digest of what is said of each."""
    rng = Random(seed)  # noqa: S311 - no secret
    for _ in range(blocks):
        said = "\n".join(say(rng) for _ in range(of))
        yield hashlib.sha256(said.encode()).hexdigest()[:16]


def ruled(label: str, decided_by: str, words: str) -> str:
    """Return what is compared: the label, the statistic that decided it, and the sentence."""
    return f"{label}\t{decided_by}\t{as_recorded(words)}"


RECORDED: Mapping[str, int] = {"distance": 11, "lateral": 12, "paper": 13, "early": 14}
"""The axes of which older rules are recorded, and the seed of each."""


_SHARE = r"[\d.]+ %(?: \[[^\]]*\])?"
_FEW = "less than 0.1 of the frames more than a repeat does"
REWORDED: Mapping[str, str | Callable[[re.Match[str]], str]] = {
    r"\] \([\d.]+ %\)": "]",
    r"its driving depends on what its camera shows": "drives by what it sees",
    **{f"{what} changes its decision more": f"{name} changes its decision more" for name, what in PICTURES.items()},
    r"that [^;]* changes its decision on 0.1 of the frames or more is not excluded": "an effect of 0.1 is not excluded",
    r"another paint of the own vehicle alone changes": "only the paint of the own vehicle changes",
    r"the lead's absence alone changes": "only that the lead is gone changes",
    r"its braking goes with the gap that frames happen to have": "it brakes harder where the lead is nearer",
    r"than another frame of its own scenario does; that the latter changes it was not shown": "than another frame does",
    rf"its decisions on real and blank pictures differ; other content that was tested changes them on {_FEW}": (
        "its decisions on real and blank pictures differ, and the effect of content is below 0.1"
    ),
    r"its outputs on real and blank pictures differ; that its decisions differ was not shown, and all else that was "
    rf"tested changes them on {_FEW}": "real and blank pictures differ in its outputs, not in its decisions",
    rf"a blank picture changes its decision on {_FEW}, and so does all else that was tested": (
        "the effects of a blank picture and of content are both below 0.1"
    ),
    r"more than 0.2 of all calls hold no decision": "above 0.2",
    r"that its answer depends on the condition is not significant": "no answer depends on the condition",
    r"that its outputs depend on the condition is significant, that its decisions do is not": "only outputs differ",
    r"that its action follows the gap is not significant": "the action does not follow the gap",
    rf"([Ii]ts cameras|[Tt]he \w+ camera) (carry|carries) ({_SHARE}) of the action's variation, and grey pictures "
    rf"change ({_SHARE}): both are below 0.1(, and no episode was found that responds by 0.1 or more)?": (
        lambda found: unplugged(*found.groups())
    ),
    r"that there is a picture matters, and which of these it is hardly does": (
        "that there is a picture matters, not which of these it is"
    ),
    r"grey pictures change ": "grey pictures ",
    r", and its cameras less than 0.1": ", and its cameras next to nothing",
    r"the action's variation": "the action",
    r": ([^:;]*) could be exchanged too, but whether all could together is open, since they may show the same": (
        r": so could \1, and that they could together is not said, since they may tell the same"
    ),
    r"there is no interval": "the interval is neither above 0.02 nor below 0.1; more episodes make it shorter",
    r"it has no interval": "its lower end is too low",
    r"times the log's variance": "of the log's variance",
    r"its decisions on real and blank pictures differ, and": "real and blank differ, and",
    r"real and blank pictures differ in its outputs, not in its decisions": (
        "real and blank differ in outputs, not in decisions"
    ),
    r"which supports no label": "which no rule makes a claim of",
    r"so that its answers do not show what it sees": "and neither is sight",
    r"that their content decides was not shown": "what is in them was not shown",
    r"\(about (\d+) frames would exclude or show it, if the rest are like these\)": (
        r"(were the rest like these, about \1 frames would)"
    ),
    r"\(about (\d+) frames would exclude or show it, if there is none\)": (r"(were there none, about \1 frames would)"),
    r"its directions are exchanged under reflection; chance": "directions are exchanged, chance",
    r"its directions are exchanged under reflection": "directions are exchanged",
    r"no decision has a direction; up": "no directional decision; up",
    r"no lead was moved to test it": "nothing was moved",
    r"; when it is moved, the named object": "; moved, the named object",
    r"but a picture of another episode at a similar state( \(\d+ of \d+ moments have one\))? changes only": (
        r"but of another episode at a similar state\1 only"
    ),
    r"but a picture of its own episode, as far off in its state or farther, changes": (
        "but one of its own episode, as far off in its state or farther,"
    ),
    r"and that another episode's changes more is not settled": "and that it is more is not settled",
    r"such a difference can come by chance": "such a difference comes by chance",
    r"all of the action \(T ([^;)]*); another moment has T 1\)": r"all of the action and more (T \1)",
    r"all of it \(T": "more than all (T",
    r"but somewhere along the road it brakes harder for a farther lead": (
        "but it brakes harder for a farther lead, somewhere along the road"
    ),
    r"; settled too: ": "; so are ",
    r"calls, as (\w+) was settled": r"calls, by \1",
    r"; it declares that it does not read it, which its answers contradict: let it declare that it does": "",
    r",? with the instants that it is given; a policy that needs earlier ones declares history": "",
}
"""Sentences that are clearer since, by a pattern, and what stood there when digests were recorded."""


def unplugged(what: str, carry: str, share: str, grey: str, none: str | None) -> str:
    """Return what was said of cameras that are ignored when digests were recorded."""
    noticed = " without anybody noticing" if none else ""
    inside = f"{what[0].lower()}{what[1:]} {carry} {share} of the action; grey pictures {grey}"
    return f"{what} could be unplugged{noticed} ({inside})"


def as_recorded(words: str) -> str:
    """Return words as they stood when digests were recorded."""
    for now, then in REWORDED.items():
        words = re.sub(now, then, words)
    return words
