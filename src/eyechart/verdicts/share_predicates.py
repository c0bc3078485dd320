"""How a share is read: margins, the clauses that it is used, ignored or followed, and words.

Why these rules: docs/decisions/policies.md.
"""

import math
import shlex
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from eyechart.stats.shares import FollowedShare, LogDistance, Share, of_kind, shown_share
from eyechart.stats.statistic import Statistic
from eyechart.verdicts.rules import WORDS, Clause, Reading, Rule, word

ALPHA = 0.01
USED, IGNORED = 0.02, 0.10
"""A channel is used above the first share and ignored below the second, each at `ALPHA`."""
COLOURED = 0.03
"""Exchanged colours count from here on: a second proof is a second chance to err."""
FOLLOWED = 0.30
"""An object is followed where the answer goes with it by this share of the oracle's way."""
BECAUSE = 0.15
"""This much of it, and half of it at least, has to be because the object is named."""
EVENLY = 0.75
"""For each instruction and along each axis of the world it is at least this share of its mean."""
HEADING = math.cos(math.radians(45))
"""The mean cosine between the answer's way and the object's is at least this."""
HEARD = 0.10
"""An instruction is followed where the answer goes this share of the way to what it names."""
UNSCORABLE = 0.10
"""Above this share of calls without a motion nothing is scored."""
LEAST_NOISE = 0.01
"""Answers that differ by a smaller share of what they vary count as equal."""
LEAST_EPISODES = 6
"""Fewer episodes bound nothing: the jackknife's intervals are too short."""

_LONG = 60
"""A sentence quotes so many characters of an instruction."""

Statistics = Mapping[str, Statistic]


@dataclass(frozen=True)
class MissingConditions:
    """The conditions that a run left out, why its bank lacks others, and the bank's folder.

    ``failing`` has those that a policy fails on: the calls without a motion, and all.
    """

    unasked: frozenset[str] = frozenset()
    lacking: Mapping[str, str] = field(default_factory=dict)
    bank: str = "BANK"
    failing: Mapping[str, tuple[int, int]] = field(default_factory=dict)


EVERYTHING = MissingConditions()


def _kind(name: str) -> type[Share]:
    kinds: Mapping[str, type[Share]] = {"follow": FollowedShare, "misfit": LogDistance}
    return kinds.get(name.partition(".")[0], Share)


def as_read(name: str, statistic: Statistic) -> Share:
    """Return a statistic of a name as the kind that the rules read."""
    kind = _kind(name)
    return statistic if isinstance(statistic, kind) else of_kind(kind, statistic)


class ShareStatistics(dict[str, Share]):
    """The statistics of a policy, each of its kind, with facts on its run that rules read.

    ``asked.CONDITION`` is 0 if the run did not ask it. If the policy fails on it, the value is the
    share of its calls without a motion. If the bank lacks it, there is no value.
    A statistic that is missing has an n of -1, and no other number.
    """

    def __init__(self, statistics: Statistics, left_out: MissingConditions = EVERYTHING, **facts: bool) -> None:
        super().__init__(
            {name: as_read(name, statistic) for name, statistic in statistics.items()}
            | {f"asked.{name}": Share(None, 0, note=why) for name, why in left_out.lacking.items()}
            | {f"asked.{name}": Share(0.0, 0, note=f"the run did not ask {name}") for name in left_out.unasked}
            | {
                f"asked.{name}": Share(empty / calls, calls, note=fails(name, empty, calls))
                for name, (empty, calls) in left_out.failing.items()
            }
            | {name: Share(float(holds), 1) for name, holds in facts.items()}
        )
        self.bank = shlex.quote(left_out.bank)

    def __missing__(self, name: str) -> Share:
        return _kind(name)(None, -1)

    def forgot(self, *conditions: str) -> str:
        """Return in words which of some conditions the run did not ask, or the policy fails on."""
        names = [name for name in conditions if self[f"asked.{name}"].value == 0]
        unasked = [f"the run did not ask {', '.join(names)}"] if names else []
        failing = {name: one for name in conditions if (one := self[f"asked.{name}"]).value}
        return ", and ".join(
            (*unasked, *_failing({name: (one.value or 0.0, one.note) for name, one in failing.items()}))
        )


def fails(condition: str, empty: int, calls: int) -> str:
    """Return in words on how many pictures of a condition a policy fails."""
    return f"it fails on {empty} of {calls} {pictures(condition)}"


def pictures(condition: str) -> str:
    """Return the pictures of a condition in words: ``told_named_plus`` has those of a moved object."""
    base, _, camera = condition.partition("@")
    which = base.removeprefix("told_").partition("_")[0]
    words = f"pictures with the {which} object moved" if which in {"named", "other"} else _PICTURES.get(base, base)
    words = words if words.startswith("pictures") else f"{words} pictures"
    words += " and another instruction" if base.startswith("told_") else ""
    return f"{words} of the {camera} camera" if camera else words


_PICTURES = {"exchanged": "pictures with exchanged colours", "decoys": "pictures with further objects"}
"""The pictures of conditions whose name is no word for them."""


def fails_on(failing: Mapping[str, tuple[int, int]]) -> str:
    """Return in one clause on which computed pictures a policy fails; empty for none.

    ``failing`` has by condition the calls without a motion, and all. Of several the worst is named.
    """
    counted = {name: (empty / calls, fails(name, empty, calls)) for name, (empty, calls) in failing.items()}
    return "".join(_failing(counted))


def _failing(many: Mapping[str, tuple[float, str]]) -> Iterator[str]:
    """Yield one clause on some conditions, each with the share of its failures and its own clause."""
    if many:
        _, worst = many[min(many, key=lambda name: (-many[name][0], name))]
        kinds = f"it fails on {len(many)} kinds of computed pictures, at worst on"
        yield worst if len(many) == 1 else worst.replace("it fails on", kinds, 1)


_FEW_LOST = Reading("lost", "<=", UNSCORABLE, otherwise=True)
_ENOUGH = Reading("episodes", ">=", LEAST_EPISODES, otherwise=False)
_BOUNDED = (Reading("value", "there"), Reading("low", "there"), _FEW_LOST)
_SETTLED = (*_BOUNDED, _ENOUGH)
_IGNORED = (Reading("high", "<", IGNORED), *_SETTLED)


def _used(least: float) -> tuple[Reading, ...]:
    return (Reading("low", ">", least), *_SETTLED, Reading("p", "<=", ALPHA, otherwise=True))


def every(name: str, *readings: Reading) -> tuple[Clause, ...]:
    """Return a condition for each of some readings of a statistic."""
    return tuple(Clause(name, (reading,)) for reading in readings)


def use(name: str, least: float = USED) -> tuple[Clause, ...]:
    """Return the conditions that a share is above a margin, and not by chance."""
    return every(name, *_used(least))


def disuse(name: str, *, may_lack: bool = False) -> tuple[Clause, ...]:
    """Return the conditions that a share is below the margin, or, if it ``may_lack``, missing."""
    lacks = (Reading("n", "<", 0.0),) if may_lack else ()
    return tuple(Clause(name, (one, *lacks)) for one in _IGNORED)


def carrying(name: str) -> tuple[Clause, ...]:
    """Return the conditions that a share is used, and may be too large to be ignored."""
    return every(name, Reading("high", ">=", IGNORED), *_used(USED))


def following(name: str, least: float) -> tuple[Clause, ...]:
    """Return the conditions that a moved object is followed so far, and not by chance."""
    return every(name, Reading("low", ">", least), Reading("p", "<", ALPHA, otherwise=False), *_BOUNDED)


def bounded(name: str, reads: str, holds: str, least: float) -> tuple[Clause, ...]:
    """Return the conditions of one end of an interval, of a statistic that lost few calls."""
    return every(name, _FEW_LOST, Reading(reads, holds, least, otherwise=False))


def may_exceed(name: str) -> Clause:
    """Return the condition that a following that is not settled may reach `FOLLOWED`."""
    return Clause(name, (Reading("high", ">=", FOLLOWED, otherwise=True), ~_FEW_LOST))


def lossy(name: str) -> Clause:
    """Return the condition that too many of the calls of a statistic hold no motion."""
    return Clause(name, (~_FEW_LOST,))


def unknown(name: str) -> Clause:
    """Return the condition that a statistic has no value, or lost too many calls."""
    return Clause(name, (Reading("value", "missing"), ~_FEW_LOST))


def measured(name: str, *, holds: bool = True) -> Clause:
    """Return the condition that there is such a statistic, or is none."""
    return Clause(name, (Reading("n", ">=" if holds else "<", 0.0),))


def condition_run(condition: str) -> Clause:
    """Return the condition that the run did not leave out a condition of its bank."""
    return Clause(f"asked.{condition}", (Reading("value", "missing"),))


def measured_clauses(name: str) -> tuple[Clause, ...]:
    """Return the conditions that a share was measured, on enough episodes to bound it."""
    return every(name, Reading("value", "there"), _ENOUGH)


def is_used(statistic: Statistic | None) -> bool:
    """Return whether a share is above the margin, and not by chance."""
    return statistic is not None and all(reading.of(as_read("", statistic)) for reading in _used(USED))


def is_ignored(statistic: Statistic | None) -> bool:
    """Return whether a share is below the margin."""
    return statistic is not None and all(reading.of(as_read("", statistic)) for reading in _IGNORED)


def is_conclusive(statistic: Statistic) -> bool:
    """Return whether a share has an interval, on enough episodes and with few calls lost."""
    return all(reading.of(statistic) for reading in _SETTLED)


WORDS.update(
    forgot=lambda found, names: found.forgot(*names.split(",")),
    without=lambda found, name: found[f"asked.{name}"].note,
    bank=lambda found, _: found.bank,
)


def undecided(by: str, needs: tuple[Clause, ...], sentence: str, *broken: Clause) -> Rule:
    """Return the rule of what is open."""
    return Rule("undecided", by, needs, sentence, broken)


@word
def lost(one: Share) -> str:
    """Return in words how many of its calls hold no motion; empty where they are few."""
    if one.lost is None or one.lost <= UNSCORABLE:
        return ""
    return f"{one.lost:.0%} of its calls hold no motion, and what it would have done there is not known"


@word
def unfollowed(one: Share) -> str:
    """Return why a following is not settled."""
    if gone := lost(one):
        return gone
    if isinstance(one, FollowedShare) and one.smallest_p is not None and one.smallest_p >= ALPHA:
        return "below seven episodes no test can tell"
    if one.p is None or one.p >= ALPHA:
        return "p is not below .01"
    return "it has no interval" if one.ci is None else "its lower end is too low"


@word
def why_open(one: Share) -> str:
    """Return why a share is neither used nor ignored."""
    if one.value is None:
        return one.note or "the run did not ask it"
    if not _ENOUGH.of(one):
        return f"{one.episodes or 0} episodes bound nothing; {LEAST_EPISODES} are the least"
    if gone := lost(one):
        return gone
    if one.bytes is not None:
        alone = f"one value of its pictures that is one level off changes {one.bytes:.0%} too"
        return f"{alone}: what goes beyond that is not above {USED}, and the whole not below {IGNORED}"
    if one.p is not None and one.p > ALPHA and one.ci is not None and one.ci[0] > USED:
        return f"its answers are drawn, and such a difference can come by chance (p {one.p:.3f})"
    interval = "there is no interval" if one.ci is None else f"the interval is neither above {USED} nor below {IGNORED}"
    return interval if one.ci is None else f"{interval}; more episodes make it shorter"


@word
def share(one: Share) -> str:
    """Return a share in words; below 0 it is noise, and above 1 it is no percentage."""
    if one.value is not None and one.value < 0:
        one = as_read("", shown_share(one))
    if one.value is None or (one.value <= 1 and (one.ci is None or one.ci[1] <= 1)):
        return way(one)
    if one.value <= 1 and one.ci is not None:
        return f"{100 * one.value:.1f} % [{100 * one.ci[0]:.1f}, over 100]"
    return f"all of it (T {one.value:.2f}{_ends(one)})"


@word
def of_action(one: Share) -> str:
    """Return a share in words, with what it is of: how the action varies between moments."""
    if one.value is None or one.value <= 1:
        return f"{share(one)} of the action's variation"
    return f"all of the action's variation (T {one.value:.2f}{_ends(one)}; another moment has T 1)"


def _ends(statistic: Statistic) -> str:
    return "" if statistic.ci is None else f" [{statistic.ci[0]:.2f}, {statistic.ci[1]:.2f}]"


@word
def way(one: Share) -> str:
    """Return in percent how much of a way is followed; more than 100 is too far."""
    if one.value is None:
        return "— %"
    interval = "" if one.ci is None else f" [{100 * one.ci[0]:.1f}, {100 * one.ci[1]:.1f}]"
    return f"{100 * one.value:.1f} %{interval}"


def quote(text: object) -> str:
    """Return the beginning of an instruction, in quotes."""
    said = " ".join(str(text).split())
    return f"'{said if len(said) <= _LONG else said[: _LONG - 1] + '…'}'"


def sentence(words: str, end: str = ".") -> str:
    """Return words as a sentence."""
    return f"{words[0].upper()}{words[1:]}{end}"
