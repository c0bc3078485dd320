"""The words and the pace of two models' replies about the same moments tell whether one cache may have answered both.

A reply that follows from its decision tells no more than the decision: two models that decide alike then write alike.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from eyechart.ledger import Sent
from eyechart.studies.closed_loop.reading import Drives
from eyechart.studies.closed_loop.repeated import FEWEST_REPEATS, IMPLAUSIBLE, SLOW_S, seconds

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
