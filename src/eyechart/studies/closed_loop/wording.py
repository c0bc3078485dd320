"""The words and the pace of replies tell of a cache: to requests that one model got before, and of two models alike.

A reply that follows from its decision tells no more than the decision: two models that decide alike then write alike.
The identity of a call is its key, never its content (docs/decisions/0001): what answers by content cannot be measured.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from statistics import median

from eyechart.calls import Reply
from eyechart.ledger import Sent
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


VERBATIM = 0.9
"""A cache gives the text back; where fewer replies are word for word the same, two models found their own words."""


@dataclass(frozen=True)
class Wording:
    """What the ledgers tell of two drivers' replies about the same moments; ``words`` says it.

    ``compared`` counts the moments of which both have a reply, ``same`` those with the same text. ``beyond`` counts
    the same texts that do not follow from the decision: another text stands more often with the same action.
    ``faster`` says whether the one took implausibly less time.
    """

    compared: int
    same: int
    beyond: int
    faster: bool
    words: str

    @property
    def verbatim(self) -> bool:
        """Return whether the replies are the same to the word; never where none can be compared."""
        return self.compared > 0 and self.same >= VERBATIM * self.compared

    @property
    def beyond_decisions(self) -> bool:
        """Return whether the same texts tell more than the same decisions do."""
        return self.beyond >= FEWEST_REPEATS


def wording(one: Drives, other: Drives, worlds: Sequence[str]) -> Wording:
    """Return what the replies of two drivers about some worlds tell, as far as the ledgers know them."""
    mine, theirs = (_replies(each, set(worlds)) for each in (one, other))
    both = sorted(mine.keys() & theirs.keys())
    same = [frame for frame in both if _text(mine[frame]) == _text(theirs[frame])]
    took = [seconds(sent.reply for sent in each.values() if sent.reply is not None) for each in (mine, theirs)]
    quick = max(took) >= SLOW_S and 0 < min(took) < IMPLAUSIBLE * max(took)
    other_picture = sum(mine[frame].request_sha256 != theirs[frame].request_sha256 for frame in both)
    said = [f"{len(same)} of {len(both)} replies are word for word the same"]
    if other_picture:
        said.append(f"{other_picture} of them to other requests")
    if quick:
        said.append(f"and the median reply took {min(took):.3g} s against {max(took):.3g} s")
    return Wording(len(both), len(same), _beyond(one, mine, same), quick, ", ".join(said))


def _beyond(drives: Drives, replies: dict[str, Sent], frames: Sequence[str]) -> int:
    """Return how many replies have another text than the one that stands most often with their action."""
    decided = {step.frame: step.decision.action for step in drives.steps}
    texts: dict[str | None, Counter[str]] = {}
    for frame in frames:
        plain = "".join(sign for sign in _text(replies[frame]).casefold() if sign.isalnum())
        texts.setdefault(decided.get(frame), Counter())[plain] += 1
    return sum(found.total() - max(found.values()) for found in texts.values())


def _replies(drives: Drives, worlds: set[str]) -> dict[str, Sent]:
    """Return the reply about each moment of some worlds, by its frame."""
    return {
        sent.key.frame: sent
        for sent in drives.replies
        if sent.reply is not None and sent.key.frame.rpartition("/")[0] in worlds
    }


def _text(sent: Sent) -> str:
    return sent.reply.text if sent.reply is not None else ""
