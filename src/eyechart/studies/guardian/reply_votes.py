"""Read a vote from a reply, more strictly than an estimate, because a guardian acts on it.

The words around an estimate are not understood. They are compared with a list of harmless words,
and any other word makes the reply no vote. So no refusal, denial, quotation, hedge or example
passes because a list of bad words lacks it. Hazard and clear have the same rules.
"""

import re
from dataclasses import dataclass
from typing import Literal

from eyechart.spaces.scene import FIELDS, SCENES, Estimate, SurroundingText
from eyechart.spaces.space import Answer, ending, refuses

VOTED = SCENES.by(3)
"""The reader of votes' estimates.

Later versions of the reader reject only words and fields that the rules here reject too. So a
guardian that was chosen under version 3 stays valid.
"""

VOTE_READER = 1
"""The version of these rules; a guardian records it."""

Unvoted = Literal[
    "ended",  # its finish reason is not a normal one
    "words_around",  # around the estimate is more than a lead-in, a fence and turn markers
    "several_objects",  # more than one pair of braces, even with equal contents
    "repeated_field",  # a field twice, even with equal values
    "extra_field",  # a field that the question does not have; it may contradict the others
    "thinking_after",  # thinking that begins after the estimate may withdraw it
    "contradicts_itself",  # near and not close, or close and far
    "no_confidence",  # a confidence of 0
]
"""Why a reply with an estimate is no vote; without one the reader of scenes gives the reason."""

_LEAD_IN = """
a answer answers are as based below certainly course estimate estimates final five following follows for from here
here's image in is json measurement measurements my object of ok okay on output picture reply report requested response
result results scene single sure the these to value values with your
"""
LEAD_IN = frozenset(_LEAD_IN.split())
"""Words that may stand before an estimate: none denies, doubts, refuses, quotes or supposes."""

_FENCE = re.compile(r"```(?:json|JSON)?[ \t]*(?=\n|$)|```(?=\s*$)")
_MARKS = re.compile(r"<\|(?:begin_of_box|end_of_box|im_end|eot_id|endoftext|end)\|>|</s>|<end_of_turn>|<eos>")
_WORD = re.compile(r"[A-Za-z]+(?:'[a-z]+)?!?")
"""A word with a following "!"; a "!" by itself may be a programmer's negation."""
_HARMLESS = re.compile(r"[\s:.,*#_\ufeff-]+")


@dataclass(frozen=True, slots=True)
class Vote:
    """The vote of a reply: True for hazard, False for clear, or None and the reason ``why``.

    ``why`` is a word of `Unvoted` or of the reader; ``words`` explain it to a person.
    """

    hazard: bool | None
    why: str = ""
    words: str = ""

    def __str__(self) -> str:
        """Return the reason for no vote, on one line; empty for a vote."""
        return f"{self.why}: {self.words}" if self.words else self.why


def read_vote(reply: Answer, close_m: float) -> Vote:
    """Return the vote of a reply, for a question that calls a lead nearer than ``close_m`` close.

    It needs a scene estimate as `SceneSpace.read` reads it, and nothing that contradicts it. A
    missing finish reason is no fault.
    """
    found = VOTED.read(reply)
    if found.missing == "unparsed":
        return Vote(None, str(found.why))
    if found.missing is not None:
        return Vote(None, found.missing)
    if reply.finish_reason is not None and ending(reply.finish_reason) != "normal":
        return Vote(None, "ended", f"the reply ended with '{reply.finish_reason[:40]}'")
    assert found.action is not None
    assert found.beside is not None
    return _beside(found.beside) or _within(found.action, close_m) or Vote(found.action.close)


def _beside(said: SurroundingText) -> Vote | None:
    """Return why the text around an estimate makes it no vote, if it does."""
    if said.objects != 1:
        return Vote(None, "several_objects", f"{said.objects} objects in one reply")
    if said.thinking_after:
        return Vote(None, "thinking_after")
    if extra := [name for name in said.names if name not in FIELDS]:
        return Vote(None, "extra_field", f"'{extra[0][:40]}' is no field of the question")
    if len(said.names) != len(FIELDS):
        return Vote(None, "repeated_field")
    around = f"{said.before} {said.after}"
    if refuses(around):
        return Vote(None, "refused", "it declines in words, but gives an estimate")
    strange = _strange(said.before, LEAD_IN) or _strange(said.after)
    return Vote(None, "words_around", f"'{strange}' is next to its estimate") if strange else None


def _strange(text: str, words: frozenset[str] = frozenset()) -> str:
    """Return the first part of a text that is no listed word, fence, turn marker or punctuation."""
    plain = _MARKS.sub(" ", _FENCE.sub(" ", text)).replace("\u2019", "'")
    for word in _WORD.findall(plain):
        if word.lower().removesuffix("!") not in words:
            return str(word)[:40]
    rest = _HARMLESS.sub("", _WORD.sub("", plain))
    return rest[:1]


def _within(estimate: Estimate, close_m: float) -> Vote | None:
    """Return why an estimate itself is no vote.

    At the threshold itself both answers are allowed, since a number may be rounded.
    """
    gap_m = estimate.gap_m
    if gap_m is not None and gap_m < close_m and not estimate.close:
        return Vote(None, "contradicts_itself", f"{gap_m:g} m and not close, which is below {close_m:g} m")
    if estimate.close and (gap_m is None or gap_m > close_m):
        gap_words = "no lead" if gap_m is None else f"{gap_m:g} m"
        return Vote(None, "contradicts_itself", f"{gap_words} and close, which is below {close_m:g} m")
    return Vote(None, "no_confidence") if estimate.confidence == 0 else None
