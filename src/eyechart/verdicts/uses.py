"""How a share is read: its margins, whether it is used, ignored or followed, why it may be open, and its words.

Source: docs/decisions/0051-what-is-said-of-a-policy.md.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from eyechart.stats.statistic import Statistic

USED = 0.02
"""A channel is used where its share is above this, with a chance of .01 to be wrong."""
IGNORED = 0.10
"""And ignored where its share is below this, likewise."""
COLOURED = 0.03
"""Of two ways to look beyond one's pose, colours that are exchanged count from here on: two chances are two errors."""
ALPHA = 0.01
FOLLOWED = 0.30
"""An object is followed where the answer goes at least so far with it, as a share of the oracle's way, likewise."""
BECAUSE = 0.15
"""So much of it has to be because it is named, likewise, and half of what it follows the named one at least."""
EVENLY = 0.75
"""By each instruction, and along each axis of the world, it is so much of what it is on the mean at least."""
HEADING = math.cos(math.radians(45))
"""And it goes towards the object where its way is at most so far off that of the object, as a mean cosine."""
HEARD = 0.10
"""An instruction is followed where the answer goes at least so far towards what is named, or logged, likewise."""
UNSCORABLE = 0.10
"""Above this share of calls without a motion a policy is not scorable, and a condition says nothing."""
LEAST_NOISE = 0.01
"""Answers that differ by a smaller share of what they vary are as good as ones that do not."""
LEAST_EPISODES = 6
"""Fewer episodes bound nothing: the jackknife's intervals are too short."""

_LONG = 60
"""Signs of an instruction that a sentence quotes."""

Statistics = Mapping[str, Statistic]


@dataclass(frozen=True)
class Asked:
    """What a run did not ask although its bank can show it, and why the bank cannot show the rest, by condition."""

    unasked: frozenset[str] = frozenset()
    lacking: Mapping[str, str] = field(default_factory=dict)

    def forgot(self, *conditions: str) -> str:
        """Return in words which of some conditions the run did not ask, nothing where it asked all that there are."""
        names = [name for name in conditions if name in self.unasked]
        return f"the run did not ask {', '.join(names)}" if names else ""

    def without(self, condition: str) -> str:
        """Return in words why there is nothing of a condition, nothing where nobody says."""
        return self.forgot(condition) or self.lacking.get(condition, "")


EVERYTHING = Asked()
"""Nothing is known to be missing."""


def used(one: Statistic | None, least: float = USED) -> bool:
    """Return whether a share is above the margin, and no chance."""
    return settled(one) and one.ci[0] > least and (one.p is None or one.p <= ALPHA)  # type: ignore[index,union-attr]


def ignored(one: Statistic | None) -> bool:
    """Return whether a share is below the margin."""
    return settled(one) and one.ci[1] < IGNORED  # type: ignore[index,union-attr]


def settled(one: Statistic | None) -> bool:
    """Return whether a share has an interval that holds, of calls of which nearly all came back."""
    if one is None or one.value is None or one.ci is None or lost(one):
        return False
    return enough(one)


def enough(one: Statistic) -> bool:
    """Return whether a share is of episodes enough to bound anything."""
    episodes = (one.detail or {}).get("episodes", 0)
    return isinstance(episodes, int) and episodes >= LEAST_EPISODES


def lost(one: Statistic | None) -> str:
    """Return in words how many of its calls hold no motion, where they are too many; nothing else."""
    share = ((one.detail if one is not None else None) or {}).get("lost", 0.0)
    if not isinstance(share, float) or share <= UNSCORABLE:
        return ""
    return f"{share:.0%} of its calls hold no motion, and what it would have done there is not known"


def carried(one: Statistic | None) -> Mapping[str, float]:
    """Return the numbers and steps of the answer that go with a channel although their mean does not."""
    found = ((one.detail if one is not None else None) or {}).get("carried")
    drawn_apart = one is None or one.p is None or one.p <= ALPHA
    return found if isinstance(found, Mapping) and drawn_apart else {}


def followed(one: Statistic | None, least: float) -> bool:
    """Return whether what was moved is followed farther than that, and not by chance."""
    if one is None or one.value is None or one.ci is None or one.p is None or lost(one):
        return False
    return one.p < ALPHA and one.ci[0] > least


def opposed(one: Statistic | None) -> bool:
    """Return whether the answers go the other way."""
    return one is not None and one.ci is not None and not lost(one) and one.ci[1] < 0


def may_follow(one: Statistic | None) -> bool:
    """Return whether a following that is not settled may be as large as `FOLLOWED` all the same."""
    return one is None or one.ci is None or one.ci[1] >= FOLLOWED or bool(lost(one))


def unfollowed(one: Statistic | None) -> str:
    """Return why a following is not settled."""
    if gone := lost(one):
        return gone
    smallest = None if one is None or one.detail is None else one.detail.get("smallest_p")
    if isinstance(smallest, float) and smallest >= ALPHA:
        return "below seven episodes no test can tell"
    return "p is not below .01" if one is None or one.p is None or one.p >= ALPHA else "its lower end is too low"


def why_open(swap: Statistic | None) -> str:
    """Return why a share is neither used nor ignored."""
    if swap is None or swap.value is None:
        return swap.note if swap is not None and swap.note else "the run did not ask it"
    if not enough(swap):
        episodes = (swap.detail or {}).get("episodes", 0)
        return f"{episodes} episodes bound nothing; {LEAST_EPISODES} are the least"
    if gone := lost(swap):
        return gone
    if swap.p is not None and swap.p > ALPHA and swap.ci is not None and swap.ci[0] > USED:
        return f"its answers are drawn, and such a difference comes by chance (p {swap.p:.3f})"
    return f"the interval is neither above {USED} nor below {IGNORED}; more episodes make it shorter"


def share(one: Statistic | None) -> str:
    """Return a share of the action in words; one above 1 is no percentage of anything, and below 0 is only noise."""
    if one is not None and one.value is not None and one.value < 0:
        ends = None if one.ci is None else (max(0.0, one.ci[0]), max(0.0, one.ci[1]))
        one = replace(one, value=0.0, ci=ends)
    if one is None or one.value is None or one.value <= 1:
        found = way(one)
        return found if one is None or one.ci is None or one.ci[1] <= 1 else f"{found.rpartition(',')[0]}, over 100]"
    return f"more than all (T {one.value:.2f}{_ends(one)})"


def of_action(one: Statistic | None) -> str:
    """Return a share in words, of what."""
    if one is None or one.value is None or one.value <= 1:
        return f"{share(one)} of the action"
    return f"all of the action and more (T {one.value:.2f}{_ends(one)})"


def _ends(one: Statistic) -> str:
    return "" if one.ci is None else f" [{one.ci[0]:.2f}, {one.ci[1]:.2f}]"


def way(one: Statistic | None) -> str:
    """Return a share in percent; of a way that is followed it may be more than all, which is too far."""
    if one is None or one.value is None:
        return "— %"
    interval = "" if one.ci is None else f" [{100 * one.ci[0]:.1f}, {100 * one.ci[1]:.1f}]"
    return f"{100 * one.value:.1f} %{interval}"


def quoted(text: object) -> str:
    """Return the head of what was told, in quotes."""
    said = " ".join(str(text).split())
    return f"'{said if len(said) <= _LONG else said[: _LONG - 1] + '…'}'"


def sentence(words: str) -> str:
    """Return words as a sentence."""
    return f"{words[0].upper()}{words[1:]}."
