"""Requests that one model got before tell of a cache: the same words again, in no time.

The identity of a call is its key, never its content (docs/decisions/0001): what answers by content cannot be measured.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from statistics import median

from eyechart.calls import Reply
from eyechart.studies.closed_loop.reading import Driver, Drives

FEWEST_REPEATS = 5
"""So many requests that were made before must come again before their latency is looked at."""

IMPLAUSIBLE = 0.1
"""A repeated request that takes less than this share of what first requests take was hardly answered anew."""

SLOW_S = 0.1
"""A model that answers faster than this is quick by itself, and its times tell nothing of a cache."""


@dataclass(frozen=True)
class Repeats:
    """What a driver's repeated requests tell: the same request again, its text and how long it took.

    ``ratio`` is the median seconds of repeats over that of first requests, None where they are not measured.
    """

    driver: Driver
    repeats: int
    same_text: int
    ratio: float | None
    suspect: bool
    words: str

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        return {
            "driver": self.driver.label,
            "simulator": self.driver.simulator,
            "repeats": self.repeats,
            "same_text": self.same_text,
            "latency_ratio": self.ratio,
            "suspect": self.suspect,
            "words": self.words,
        }


def repeated_requests(drives: Drives) -> Repeats | None:
    """Return what requests that a driver made before tell when they come again; None where fewer than five did.

    A request is the same where its text and picture are. Suspect: the first replies vary, every repeat has the text of
    the first, and repeats come in less than a tenth of the time.
    """
    first: dict[str, Reply] = {}
    again: list[tuple[Reply, Reply]] = []
    for sent in drives.replies:
        if sent.reply is None or sent.reply.error is not None or not sent.request_sha256:
            continue
        before = first.setdefault(sent.request_sha256, sent.reply)
        if before is not sent.reply:
            again.append((before, sent.reply))
    if len(again) < FEWEST_REPEATS:
        return None
    same = sum(one.text == two.text for one, two in again)
    slow, fast = seconds(first.values()), seconds(two for _, two in again)
    ratio = fast / slow if slow and any(two.seconds is not None for _, two in again) else None
    varies = len({one.text for one in first.values()}) > 1
    suspect = varies and same == len(again) and ratio is not None and ratio < IMPLAUSIBLE and slow >= SLOW_S
    words = f"{len(again)} requests came again, {same} got the text of the first"
    if ratio is not None:
        words += f", in {ratio:.2g} of its time"
    if suspect:
        words += ": a cache answered them, so that neither noise nor repeats can be measured; switch it off"
    return Repeats(drives.driver, len(again), same, ratio, suspect, words)


def seconds(replies: Iterable[Reply]) -> float:
    """Return the median seconds of some replies, 0 where none was measured."""
    given = [one.seconds for one in replies if one.seconds is not None]
    return median(given) if given else 0.0
