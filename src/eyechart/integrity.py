"""Guards say whether a run may be believed: did the picture arrive, has each call one outcome, is nothing faked.

A guard holds, fails, or cannot say. A failed guard marks the verdict wherever it is printed.
"""

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

from eyechart.calls import UNFINISHED, CallKey, Reply
from eyechart.ledger import Sent
from eyechart.modes import RequestMode

FEWEST = 8
"""Fewer pairs than this are no ground for a suspicion."""
SUDDEN = 0.1
"""A repeat that comes in less than this share of the first answer's time was hardly computed."""
MOST = 0.9
"""The share of pairs from which on it is no accident."""


@dataclass(frozen=True, slots=True)
class Guard:
    """One guard: its name, whether it holds (None is "cannot say"), and why, in words."""

    name: str
    holds: bool | None
    because: str

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        outcome = {True: "holds", False: "fails", None: "cannot say"}[self.holds]
        return {**asdict(self), "outcome": outcome}


def guards(sent: Sequence[Sent], planned: Sequence[CallKey], mode: RequestMode, fingerprint: str) -> tuple[Guard, ...]:
    """Return every guard of one model's calls; ``fingerprint`` is that of the bank's geometry, which was checked."""
    last = {one.key: one.reply for one in sent if one.reply is not None and one.reply.error is None}
    return (
        _picture(last, mode),
        _outcomes(sent, planned),
        Guard("geometry", True, f"the frames have the geometry that the run was made on ({fingerprint[:8]})"),
        _constant(last),
        _cache(sent, mode),
    )


def _picture(last: Mapping[CallKey, Reply], mode: RequestMode) -> Guard:
    found = mode.measured
    if found is not None and found.sees_image is not None:
        says = f"the model {'saw' if found.sees_image else 'did not see'} the probe's pictures"
        return Guard("picture", found.sees_image, says)
    adds = _added_tokens(last)
    if adds:
        return Guard("picture", True, f"a picture adds {adds:.0f} tokens to the prompt, as the server counts it")
    counted = "" if adds is None else "; a picture adds no token to the prompt, as the server counts it"
    return Guard("picture", None, f"no probe has shown that pictures arrive{counted}")


def _added_tokens(last: Mapping[CallKey, Reply]) -> float | None:
    """Return how many prompt tokens a picture adds to the same words, or None where nobody counts them."""
    shown, bare = (
        [reply.prompt_tokens for key, reply in last.items() if key.condition == name and reply.prompt_tokens]
        for name in ("real", "text_only")
    )
    return statistics.median(shown) - statistics.median(bare) if shown and bare else None


def _outcomes(sent: Sequence[Sent], planned: Sequence[CallKey]) -> Guard:
    finals: dict[CallKey, int] = {}
    failed = retried = unknown = 0
    for one in sent:
        retried += one.number > 1
        unknown += one.reply is None
        if one.reply is not None and one.reply.error not in UNFINISHED:
            finals[one.key] = finals.get(one.key, 0) + 1
            failed += one.reply.error is not None
    twice = sum(count > 1 for count in finals.values())
    without = sum(key not in finals for key in planned)
    counted = f"{len(sent)} attempts, {retried} of them repeated, {unknown} of unknown outcome, {failed} calls failed"
    if twice or without:
        return Guard("outcomes", False, f"{without} planned calls have no outcome, {twice} have two; {counted}")
    return Guard("outcomes", True, f"each of {len(planned)} planned calls has one outcome; {counted}")


def _constant(last: Mapping[CallKey, Reply]) -> Guard:
    texts = {reply.text.strip() for reply in last.values()}
    if len(last) < FEWEST:
        return Guard("degeneracy", None, f"{len(last)} replies are too few to call them constant")
    if len(texts) == 1:
        return Guard("degeneracy", False, f"all {len(last)} replies are the same: {min(texts)[:40]!r}")
    return Guard("degeneracy", True, f"{len(texts)} different replies among {len(last)}")


def _cache(sent: Sequence[Sent], mode: RequestMode) -> Guard:
    """Compare real_repeat with real of the same frame: a cache answers the later one at once, or never differs."""
    pairs = _pairs(sent)
    if len(pairs) < FEWEST:
        return Guard("cache", None, f"{len(pairs)} frames have two answers to the same picture; {FEWEST} are needed")
    same = sum(first.text == later.text and first.reasoning == later.reasoning for first, later in pairs)
    sudden = sum(
        first.text == later.text and (later.seconds or 0.0) < SUDDEN * (first.seconds or 0.0) for first, later in pairs
    )
    if mode.temperature and same == len(pairs):
        says = f"real_repeat equals real to the byte on all {same} frames, at temperature {mode.temperature:g}"
        return Guard("cache", False, f"a cache is suspected: {says}")
    if mode.spec.partition(":")[0] != "scripted" and sudden >= MOST * len(pairs):
        says = f"on {sudden} of {len(pairs)} frames the repeat is equal and came in under {SUDDEN:.0%} of the time"
        return Guard("cache", False, f"a cache is suspected: {says}")
    return Guard("cache", True, f"{same} of {len(pairs)} repeats are equal, and they were not answered suddenly")


def _pairs(sent: Sequence[Sent]) -> list[tuple[Reply, Reply]]:
    """Return (first, later) of the replies to real and real_repeat, in the order in which they were asked."""
    by_frame: dict[str, list[Reply]] = {}
    for one in sent:
        if one.key.condition in {"real", "real_repeat"} and one.reply is not None and one.reply.error is None:
            by_frame.setdefault(one.key.frame, []).append(one.reply)
    return [(replies[0], replies[1]) for replies in by_frame.values() if len(replies) == 2]
