"""What would decide an undecided axis of a policy: more episodes, other conditions, or a check."""

import shlex
from collections.abc import Iterator
from typing import NamedTuple

from eyechart.channels import BY_STATE, CAMERA, CAMERAS, INSTRUCTION, STATE, channels_of
from eyechart.conditions import OVER
from eyechart.conditions.policies import conditions_of
from eyechart.prompts import says
from eyechart.studies.policy.scores import PolicyScore
from eyechart.verdicts.share_predicates import ALPHA, USED, ShareStatistics, is_used, pictures


class Advice(NamedTuple):
    """What to ``do``, and an optional second clause; as text it is one sentence.

    ``is_of_the_road`` says that the doctor answers it, and no frame or condition does.
    """

    do: str
    besides: str = ""
    is_of_the_road: bool = False

    def __str__(self) -> str:
        return f"{'; '.join(filter(None, self[:2]))}."


SETTLE = Advice("ask more episodes", "'eyechart plan {bank}' says how often so many settle it")
ASK_ROAD = Advice(
    "ask 'eyechart doctor SPEC --frames {bank}' whether {what} reaches it",
    "if the policy must not read it, declare the channels that it reads",
    is_of_the_road=True,
)
"""Advice for a channel that changes no bit of any answer."""
IN_WORDS = {CAMERAS: "its picture", STATE: "its state", INSTRUCTION: "its instruction"}
CHANNEL_OF = {"camera": CAMERAS, "state": STATE, "instruction": INSTRUCTION}
"""The channel of each axis."""


def settling(score: PolicyScore, spec: str, channel: str) -> Advice:
    """Return the advice that would decide a channel's axis."""
    seen = (*_to_ask(score, channel), *_of_failures(score, spec, channel))
    ways = (*seen, *_of_the_road(score, spec, channel), *_of_pose(score, spec, channel))
    return next(iter(ways), _of(SETTLE, score, channel))


def _of(advice: Advice, score: PolicyScore, channel: str) -> Advice:
    do, besides = (named(one, score, channel) for one in (advice.do, advice.besides))
    return advice._replace(do=do, besides=besides)


def named(advice: str, score: PolicyScore, channel: str = CAMERAS) -> str:
    """Return advice with the run's bank and the channel's name filled in."""
    text = advice.replace("{bank}", shlex.quote(score.manifest.bank_path))
    return text.replace("{what}", _in_words(channel))


def _to_ask(score: PolicyScore, channel: str) -> Iterator[Advice]:
    """Yield advice on what the bank or the run lacks."""
    what = _in_words(channel)
    if channel not in channels_of(score.bank):
        noun = what.removeprefix("its ")
        yield Advice(f"use a bank with {'an' if noun[0] in 'aeiou' else 'a'} {noun}: this one has none")
    elif channel in {STATE, INSTRUCTION} - says(score.manifest.prompt, score.bank):
        yield Advice(f"let the prompt say {what}, by the name of its column in braces: this one does not")
    elif missing := ", ".join(_not_asked(score, channel)):
        yield Advice(f"run the missing conditions ({missing}): 'eyechart run policy' without --conditions runs all")
    elif f"swapped{OVER}{channel}" in conditions_of(score.bank)[1]:
        yield Advice(f"use a bank in which every frame has {what.replace('its', 'another', 1)} in another episode")


def _of_the_road(score: PolicyScore, spec: str, channel: str) -> Iterator[Advice]:
    """Yield advice if the channel may not arrive, or the answers go against the instruction."""
    statistics = ShareStatistics(score.models[spec].statistics)
    swap, follow = statistics[f"T.swapped{OVER}{channel}"], statistics["follow.told"]
    if swap.same == 1.0:
        yield _of(ASK_ROAD, score, channel)
    if channel == INSTRUCTION and follow.ci is not None and follow.ci[1] < 0:
        yield Advice("look for exchanged names or a wrong sign in its training: it goes against its instruction")
    if swap.p is not None and swap.p > ALPHA and swap.ci is not None and swap.ci[0] > USED:
        yield Advice("use more --answers a call: its answers are drawn, and the difference may be chance")


def _of_pose(score: PolicyScore, spec: str, channel: str) -> Iterator[Advice]:
    """Yield advice to separate content from pose, for pictures that are used."""
    statistics, lacking = score.models[spec].statistics, conditions_of(score.bank)[1]
    if channel in {STATE, INSTRUCTION} or not is_used(statistics.get(f"T.swapped{OVER}{channel}")):
        return
    if any(f"{name}{OVER}{channel}" in lacking for name in BY_STATE):
        yield Advice(
            "add frames with the same robot pose in several episodes: without them the effect of a picture may be "
            "that of the pose"
        )
    if is_used(statistics.get(f"T.matched{OVER}{channel}")) and not is_used(statistics.get(f"beyond{OVER}{channel}")):
        yield Advice(
            "add frames with the same robot pose and objects elsewhere, or use a world that moves them: frames like "
            "these may never separate its view from its pose"
        )


def _of_failures(score: PolicyScore, spec: str, channel: str) -> Iterator[Advice]:
    """Yield advice if the policy fails on pictures that a channel's label needs."""
    if names := [name for name in _needed(channel) if name in score.models[spec].motions.fails_on]:
        yield Advice(
            f"let it return a motion on {', '.join(map(pictures, names))} too: what it does where it finds nothing"
        )


def _not_asked(score: PolicyScore, channel: str) -> Iterator[str]:
    """Yield the conditions that a channel's label needs, the bank can show and the run lacks."""
    able, planned = conditions_of(score.bank)[0], score.manifest.conditions
    yield from (name for name in _needed(channel) if name in able and name not in planned)


def _needed(channel: str) -> Iterator[str]:
    """Yield the conditions that a channel's label needs."""
    yield from ("real_repeat", f"swapped{OVER}{channel}")
    if channel not in {STATE, INSTRUCTION}:
        over = f"{OVER}{channel.removeprefix(CAMERA)}" if channel.startswith(CAMERA) else ""
        yield from (*(f"{name}{OVER}{channel}" for name in BY_STATE), f"blank{over}")


def _in_words(channel: str) -> str:
    if channel.startswith(CAMERA):
        return f"its picture of the {channel.removeprefix(CAMERA)} camera"
    return IN_WORDS[channel]
