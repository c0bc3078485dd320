"""Why a model did not get a stronger label: the test that failed, and what would settle it."""

import math
import shlex
from collections.abc import Callable
from dataclasses import dataclass, replace

from eyechart.conditions import NUDGES
from eyechart.frames import PATCHED
from eyechart.records import to_json_fields
from eyechart.stats.agreement import trials_needed
from eyechart.stats.episode_permutation import episodes_needed
from eyechart.stats.paired_tests import SignTest
from eyechart.stats.statistic import Statistic
from eyechart.verdicts.battery_rules import BOXED, STRICT, frames_to_bound, turns_to_tell
from eyechart.verdicts.depth import (
    AS_TAKEN,
    DENSE,
    EVEN,
    NO_FILE,
    NO_OPEN_PLACE,
    PATCHED_BOUND,
    REFUTING,
    SHOWN,
    STAGE,
    UNFOLLOWED,
    UNSHOWN,
    frames_to_exclude,
    holes,
    is_refuted,
    named,
)
from eyechart.verdicts.early_verdicts import PREFIX
from eyechart.verdicts.evidence import Evidence
from eyechart.verdicts.labels import ALPHA, BOUND_ALPHA, LABELS, MARGIN, UNPARSED_CUT
from eyechart.verdicts.numbers import needs_of
from eyechart.verdicts.rules import Clause, NamedStatistics, compared, number_of
from eyechart.verdicts.ruling import Ruling, measured

NOTHING = "nothing on frames like these: the test was made, and says no"
_NOT_SHOWN = "nothing on frames like these: the test was made, and shows no effect, nor excludes one"
_BOUNDED = f"nothing on frames like these: the effect of content is bounded below {MARGIN}"
_DECISIONS = "replies that hold a decision: another output format, or a larger budget of tokens"
_EVERYWHERE = compared("holes", "value", "<=", 0.0, needs="an effect in every place")
MOVED = ("lead_near", "lead_far")
PHOTOGRAPHED = {
    "lead_near": "the lead near",
    "lead_far": "the lead far",
    "lead_drawn": "the lead anywhere between",
    "exchange_own": "the lead anywhere between, one beside the path far",
    "exchange_beside": "the one beside the path there, the lead far",
    "exchange_apart": "both far",
    PATCHED: "nothing moved, and edited as much, which 'eyechart frames edit' makes",
}
"""What each picture shows of the same moment; nudged ones are made of these."""

ANY = "any other"
"""In place of the nearest stronger label where every label is one."""


@dataclass(frozen=True, slots=True)
class WhyNot:
    """The nearest stronger label, the statistic that kept a model from it, and what settles it.

    ``frames``, ``episodes`` and ``conditions`` are what is missing; more frames are never named
    where a condition is. The p is that of the rule, corrected where the rule corrects it. ``first``
    is the first way of several that ``settle`` names.
    """

    label: str
    decided_by: str
    statistic: Statistic | None
    needs: str
    settle: str
    frames: int | None = None
    episodes: int | None = None
    conditions: tuple[str, ...] = ()
    first: str = ""

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        one = self.statistic
        measured = to_json_fields(one, "value ci n p") if one else dict.fromkeys(("value", "ci", "n", "p"))
        return to_json_fields(self, "label decided_by needs settle frames episodes conditions") | measured

    def __str__(self) -> str:
        return f"not {self.label}: {measured(self.decided_by, self.statistic)}; it needs {self.needs}"

    @property
    def settled_by(self) -> str:
        """Return in words what would settle it."""
        return f"what would settle it: {self.settle}"


def is_below(p: float | None, alpha: float = ALPHA) -> bool:
    """Return whether a test was made and rejects."""
    return p is not None and p < alpha


def why_not(evidence: Evidence, ruling: Ruling, lateral: Ruling) -> WhyNot | None:
    """Return why a model's label is no stronger one; None where none is."""
    found, label, name = evidence.statistics, ruling.label, ruling.decided_by
    if label == "depth":
        return _not_lateral(found, lateral)
    if evidence.stopped is not None and not evidence.stopped.is_whole:
        return _stopped(evidence, label) if label in _EARLY else None
    made: dict[str, Callable[[], WhyNot]] = {
        "not_scorable": lambda: WhyNot(ANY, name, ruling.statistic, f"at most {UNPARSED_CUT}", _DECISIONS),
        "partial_depth": lambda: _by_clause("depth", _EVERYWHERE, found, NOTHING),
        "depth_associated": lambda: _not_depth(evidence),
        "content": lambda: _not_associated(evidence),
        "undecided": lambda: _undecided(found, name, ruling.statistic),
    }
    if nearest := LABELS[label].nearest:
        why = _by_test(*nearest, found)
        return replace(why, settle=_BOUNDED, frames=None) if label == "presence_only" else why
    return made[label]() if label in made else None


def _by_clause(label: str, clause: Clause, found: NamedStatistics, settle: str) -> WhyNot:
    return WhyNot(label, clause.statistic, clause.read(found), clause.needs, settle)


def _by_test(label: str, name: str, found: NamedStatistics) -> WhyNot:
    """Say that a test does not hold, and how many frames would settle it."""
    settle, frames = _frames(found[name])
    return WhyNot(label, name, found[name], f"p below {ALPHA}", settle, frames)


def _by_file(label: str, clause: Clause, found: NamedStatistics) -> WhyNot:
    return _by_clause(label, clause, found, "an answer to each picture of its own: no cache, and no memory of files")


def _by_pictures(label: str, name: str, evidence: Evidence, missing: tuple[str, ...], needs: str) -> WhyNot:
    settle, first = _pictures(missing, evidence)
    return WhyNot(label, name, evidence.statistics.get(name), needs, settle, conditions=missing, first=first)


_EARLY = {
    "depth_associated": ("depth", "near_far"),
    "presence_only": ("depth_associated", "near_far"),
    "refusal_effect": ("presence_only", "presence"),
    "image_invariant": ("presence_only", "presence"),
    "not_scorable": (ANY, "scorable"),
}
"""The nearest stronger label of one that was settled early, and the claim that is not."""


def _stopped(evidence: Evidence, label: str) -> WhyNot:
    stronger, claim = _EARLY[label]
    name = PREFIX + claim
    if label == "depth_associated":
        return _by_pictures(stronger, name, evidence, STAGE, "pictures along the range")
    settle = f"nothing on this bank: {label} is settled, and leaves no room for it"
    return WhyNot(stronger, name, evidence.statistics.get(name), "an e-value that settles it", settle)


def _not_lateral(found: NamedStatistics, lateral: Ruling) -> WhyNot:
    """Say which test of turns does not hold."""
    if lateral.label == "turns_clear":
        settle = "more moments at which neither side is clear, in more episodes"
        return _by_clause("depth_lateral", BOXED, found, settle)
    if lateral.label == "swaps":
        return _not_clear(found, lateral)
    swap, needs = found["mirror_swap_rate"], f"half of the turns exchanged under reflection, p below {ALPHA}"
    if lateral.decided_by.startswith(PREFIX):  # settled by an e-value that denies it
        settle = f"nothing on this bank: {lateral.label} is settled"
        why = WhyNot("depth_lateral", lateral.decided_by, lateral.statistic, needs, settle)
    else:
        why = WhyNot("depth_lateral", "mirror_swap_rate", swap, needs, NOTHING)
    if lateral.label == "no_power":
        return replace(why, settle=_turns_needed(swap))
    if lateral.label == "not_tested":
        settle = "mirrored pictures, and actions that a reflection exchanges"
        return replace(why, settle=settle, conditions=("mirrored",))
    return why


def _not_clear(found: NamedStatistics, lateral: Ruling) -> WhyNot:
    """Say which test does not hold of turns that are exchanged."""
    name = next((name for name in ("turns_clear", "turns_clear_within") if not is_below(found[name].p)), "")
    if lateral.decided_by == "turns_against" or not name:
        return WhyNot("depth_lateral", lateral.decided_by, lateral.statistic, f"at most {MARGIN}", NOTHING)
    why = _by_test("depth_lateral", name, found)
    if found[name].p is None:
        return replace(why, settle=f"a bank that records more: {found[name].note}", frames=None)
    if name == "turns_clear_within":
        return replace(why, settle="turns on lanes of which either side may be clear", frames=None)
    return why


def _turns_needed(swap: Statistic) -> str:
    need = turns_to_tell(swap)
    if need is None:
        return f"nothing on frames like these: {swap.n} turns are enough, and no more than half are exchanged"
    return f"about {need} frames on which it turns; it turned on {swap.n}"


def _not_depth(evidence: Evidence) -> WhyNot:
    """Say what was not shown of a model that brakes harder for the nearer lead."""
    found, replies, name = evidence.statistics, evidence.replies, "depth_interventional"
    if found[name].p is None:
        settle = f"decisions on more of its pictures: {found[name].note}"
        if all(replies.get(moved) for moved in MOVED):
            settle = f"decisions on {', '.join(MOVED)}: {found[name].note}"
        elif missing := tuple(one for one in (*MOVED, *STAGE) if one not in replies):
            return _by_pictures("depth", name, evidence, missing, "an answer")
        return WhyNot("depth", name, found[name], "an answer", settle)
    hardly = named(holes(found))
    needs = [one for one in (*UNSHOWN, _EVERYWHERE) if not (hardly and one in {NO_OPEN_PLACE, _EVERYWHERE})]
    why = _not_shown(evidence, next(one for one in needs if one.holds(found) is not True))
    if not hardly:
        return why
    settle = f"{why.settle}; that is partial_depth at best, for its braking hardly answers {hardly}"
    return replace(why, label="partial_depth", settle=settle)


def _not_shown(evidence: Evidence, clause: Clause) -> WhyNot:
    """Say of a condition what would show it."""
    found, replies = evidence.statistics, evidence.replies
    one = clause.read(found)
    missing = tuple(name for name in clause.conditions if name not in replies)
    if clause.outcome(found) is None and missing:
        return _by_pictures("depth", clause.statistic, evidence, missing, "an answer")
    settle = f"more frames, in more episodes: there are {one.n}" if one.n else f"decisions on its pictures: {one.note}"
    if clause in {DENSE, EVEN} and clause.outcome(found) is False:
        return _not_dense(clause, found)
    if clause is AS_TAKEN:
        settle = NOTHING if one.p is not None else f"more episodes, or gaps of photographs as taken: {one.note}"
    elif clause is PATCHED_BOUND:
        frames = frames_to_exclude(one)
        return replace(_by_clause("depth", clause, found, f"about {frames} frames with {PATCHED}"), frames=frames)
    elif clause is NO_OPEN_PLACE:
        settle = f"more frames {one.note}"
    elif clause.statistic == "picture_before":
        settle = "an answer to each picture of its own: no memory of earlier calls"
    elif clause.statistic == "unparsed_controls":
        settle = "decisions on edited pictures: it declines them more often than true ones may be"
    return _by_clause("depth", clause, found, settle)


def _not_dense(clause: Clause, found: NamedStatistics) -> WhyNot:
    """Say about how many frames hold enough drawn distances, if the rest are like these."""
    one, frames = clause.read(found), found["sensitivity"].n
    (reading,) = clause.readings
    share, wanted = number_of(one, reading.reads), float(reading.threshold)
    if not share:
        return _by_clause("depth", clause, found, f"more than these {frames} frames: a window holds none")
    need = math.ceil(frames * wanted / share)
    why = _by_clause("depth", clause, found, f"about {need} frames, if the rest are like these {frames}")
    return replace(why, frames=need)


def _pictures(missing: tuple[str, ...], evidence: Evidence) -> tuple[str, str]:
    """Say which pictures were not asked, and which the bank lacks: what they show, what draws them.

    All of that, and the first of these ways.
    """
    lacks = [name for name in missing if name in evidence.absent]
    names = [name for name in missing if name not in evidence.absent and not (lacks and name in NUDGES)]
    ways = []
    if lacks:
        shown = "; ".join(f"{name}: {PHOTOGRAPHED[name]}" for name in lacks if name in PHOTOGRAPHED)
        command = f"eyechart frames build --add-to {shlex.quote(evidence.bank)}"
        if evidence.made == "rendered" and not {*MOVED, PATCHED} & set(lacks):
            ways.append(f"'{command}' draws them of a simulator's world, then resume the run")
        ways.append(f"of photographs, each moment again ({shown})")
        ways[0] = f"pictures that the bank lacks: {ways[0]}"
    if names:
        ways.append(f"{'and ' if ways else ''}pictures that were not asked: {', '.join(names)}")
    return "; ".join(ways), ways[0]


def _not_associated(evidence: Evidence) -> WhyNot:
    """Say which condition of depth fails, or why its first test does not hold."""
    statistics = evidence.statistics
    interventional, observational = statistics["depth_interventional"], statistics["depth_observational"]
    if is_refuted(statistics):
        clause = next(one for one in REFUTING if one.holds(statistics) is False)
        shown = any(one.statistic == clause.statistic for one in SHOWN)
        why = _by_clause("depth", clause, statistics, NOTHING)
        return replace(why, needs=needs_of(clause.statistic)) if shown else why
    first = observational if interventional.p is None else interventional
    if is_below(first.p):
        return _by_file("depth", UNFOLLOWED, statistics)
    if interventional.p is not None:
        return _by_test("depth", "depth_interventional", statistics)
    settle = f"counterfactual pictures ({', '.join(MOVED)})"
    if lacks := [f"{name}: {PHOTOGRAPHED[name]}" for name in MOVED if name in evidence.absent]:
        settle += f", which this bank lacks (of each moment again, {'; '.join(lacks)})"
    episodes = None
    if observational.p is None and evidence.gap:
        episodes = episodes_needed(evidence.scenarios, alpha=ALPHA)
        settle += f", or {episodes} episodes in each scenario"
    needs, unasked = f"p below {ALPHA}", tuple(name for name in MOVED if name not in evidence.replies)
    return WhyNot("depth_associated", "depth_observational", observational, needs, settle, None, episodes, unasked)


_OF_FILES = {"repeat_over_nudged": ("content", UNFOLLOWED), "file": ("depth_associated", NO_FILE)}
"""What is undecided where a model follows the file: the nearest stronger label, and what it needs."""


def _undecided(found: NamedStatistics, name: str, statistic: Statistic | None) -> WhyNot:
    if name in _OF_FILES:
        return _by_file(*_OF_FILES[name], found)
    if name == "repeats_together":
        return _by_test("content", "content_shuffled", found)
    label = "presence_only" if is_below(found["presence"].p) else "image_invariant"
    if statistic is None and name.startswith("bound_"):
        conditions = ("shuffled" if name == "bound_content_shuffled" else "blank",)
        settle = f"decisions on {', '.join(('real', 'real_repeat', *conditions))}"
        return WhyNot(label, name, found[name], "an answer", settle, conditions=conditions)
    if statistic is None:
        return WhyNot(ANY, name, None, "an answer", "calls with the real picture that come back")
    alpha = ALPHA if name in STRICT else BOUND_ALPHA
    needed, needs = frames_to_bound(statistic, alpha), f"an effect bounded below {MARGIN}, p below {alpha}"
    if needed is None:
        return WhyNot(label, name, statistic, needs, "nothing on frames like these: the effect is there")
    return WhyNot(label, name, statistic, needs, "about {} frames, {}".format(*needed), needed[0])


def _frames(statistic: Statistic) -> tuple[str, int | None]:
    """Return in words what would settle a test, and about how many frames."""
    need, frames = None, statistic.n + statistic.ties if isinstance(statistic, SignTest) else statistic.n
    if isinstance(statistic, SignTest) and statistic.n:
        rate, alpha = statistic.value or 0.0, ALPHA
        while rate > 0.51:  # nearer to one half, tens of thousands of frames would not settle it
            need = math.ceil(trials_needed(rate, 0.5, alpha=alpha) * frames / statistic.n)
            if need > frames:
                break
            alpha /= 2  # its rule corrects it, for so many tests
    if statistic.p is None:
        return f"decisions that this test can compare: {statistic.note}", None
    return (_NOT_SHOWN, None) if need is None else (f"about {need} frames, if the rest are like these {frames}", need)
