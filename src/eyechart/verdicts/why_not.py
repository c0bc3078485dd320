"""Why a model did not get a stronger label: the test that kept it from it, and what would settle it."""

import math
import shlex
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from eyechart.conditions import NUDGES
from eyechart.records import Written
from eyechart.stats.agreement import trials_needed
from eyechart.stats.exchange import episodes_needed
from eyechart.stats.paired import SignTest
from eyechart.stats.statistic import Statistic
from eyechart.verdicts.calibrated import BOXED, STRICT, frames_to_bound, turns_to_tell
from eyechart.verdicts.depth import NO_OPEN_PLACE, REFUTING, STAGE, UNSHOWN, is_refuted
from eyechart.verdicts.early import PREFIX
from eyechart.verdicts.evidence import Evidence
from eyechart.verdicts.labels import ALPHA, BOUND_ALPHA, LABELS, MARGIN, UNPARSED_CUT
from eyechart.verdicts.ruling import Ruling, measured

NOTHING = "nothing on frames like these: the test was made, and says no"
MOVED = ("lead_near", "lead_far")
PHOTOGRAPHED = {
    "lead_near": "the obstacle ahead near",
    "lead_far": "the obstacle ahead far",
    "lead_drawn": "the obstacle ahead anywhere between",
    "exchange_own": "the obstacle ahead anywhere between, one beside the path far",
    "exchange_beside": "the one beside the path there, the obstacle ahead far",
    "exchange_apart": "both far",
}
"""What each picture shows of the same moment that a bank of one's own may lack; nudged ones are made of these."""

ANY = "any other"
"""In place of the nearest stronger label where every label is one."""


@dataclass(frozen=True, slots=True)
class WhyNot(Written):
    """The nearest stronger label, the statistic that kept a model from it, what it needs, and what would settle it.

    ``frames``, ``episodes`` and ``conditions`` are what would settle it where that is what is missing; more frames are
    never named where a condition is. ``p`` is that of the rule, corrected where the rule corrects it. ``first`` is the
    first way of several that ``settle`` names.
    """

    written = (
        "label decided_by statistic.value statistic.ci statistic.n statistic.p needs settle frames episodes conditions"
    )

    label: str
    decided_by: str
    statistic: Statistic | None
    needs: str
    settle: str
    frames: int | None = None
    episodes: int | None = None
    conditions: tuple[str, ...] = ()
    first: str = ""

    def __str__(self) -> str:
        return f"not {self.label}: {measured(self.decided_by, self.statistic)}; it needs {self.needs}"

    @property
    def settled_by(self) -> str:
        """Return in words what would settle it."""
        return f"what would settle it: {self.settle}"


def below(p: float | None, alpha: float = ALPHA) -> bool:
    """Return whether a test was made and rejects."""
    return p is not None and p < alpha


def why_not(evidence: Evidence, ruling: Ruling, lateral: Ruling) -> WhyNot | None:
    """Return why a model's label is no stronger one; None where none is."""
    if evidence.stopped is not None:
        return _stopped(evidence, ruling, lateral)
    found = evidence.statistics
    if nearest := LABELS[ruling.label].nearest:
        return _by_one_test(*nearest, found, ruling)
    made: dict[str, Callable[[], WhyNot]] = {
        "depth": lambda: _not_lateral(found, lateral),
        "partial_depth": lambda: _in_part(found, ruling),
        "depth_associated": lambda: _not_depth(evidence),
        "content": lambda: _not_associated(evidence),
        "not_scorable": lambda: _not_scorable(ruling),
        "undecided": lambda: _undecided(found, ruling),
    }
    return made[ruling.label]() if ruling.label in made else None


def _not_scorable(ruling: Ruling) -> WhyNot:
    settle = "replies that hold a decision: another output format, or a larger budget of tokens"
    return WhyNot(ANY, ruling.decided_by, ruling.statistic, f"at most {UNPARSED_CUT}", settle)


def _by_one_test(label: str, name: str, found: Mapping[str, Statistic], ruling: Ruling) -> WhyNot:
    """Say that the test of the next stronger label does not hold; nothing settles what is bounded."""
    why = _untold(label, name, found)
    if ruling.label == "presence_only":
        bounded = f"nothing on frames like these: the effect of content is bounded below {MARGIN}"
        return replace(why, settle=bounded, frames=None)
    return why


def _untold(label: str, name: str, found: Mapping[str, Statistic]) -> WhyNot:
    """Say that a test does not hold, and what would settle it."""
    settle, frames = _frames(found[name])
    return WhyNot(label, name, found[name], f"p below {ALPHA}", settle, frames)


def _by_file(label: str, found: Mapping[str, Statistic]) -> WhyNot:
    """Say that it follows the file, or a cache answered."""
    settle = "an answer to each picture of its own: no cache, and no memory of files"
    return WhyNot(label, "repeat_over_nudged", found["repeat_over_nudged"], f"p of {ALPHA} at least", settle)


_EARLY = {
    "depth_associated": ("depth", "near_far"),
    "presence_only": ("depth_associated", "near_far"),
    "refusal_effect": ("presence_only", "presence"),
    "image_invariant": ("presence_only", "presence"),
    "not_scorable": (ANY, "scorable"),
}
"""Of labels that a run may have settled early: the nearest stronger one, and the claim that is not settled."""


def _stopped(evidence: Evidence, ruling: Ruling, lateral: Ruling) -> WhyNot | None:
    if ruling.label == "depth":
        return _not_lateral(evidence.statistics, lateral)
    if ruling.label not in _EARLY:
        return None
    stronger, claim = _EARLY[ruling.label]
    found, name = evidence.statistics, PREFIX + claim
    if ruling.label == "depth_associated":
        settle, first = _pictures(STAGE, evidence)
        needs = "pictures along the range"
        return WhyNot(stronger, name, found.get(name), needs, settle, conditions=STAGE, first=first)
    settle = f"nothing on this bank: {ruling.label} is settled, and leaves no room for it"
    return WhyNot(stronger, name, found.get(name), "an e-value that settles it", settle)


def _not_lateral(found: Mapping[str, Statistic], lateral: Ruling) -> WhyNot:
    """Say which test of turns does not hold."""
    if lateral.label == "turns_clear":
        settle = "more moments at which neither side is clear, in more episodes"
        return WhyNot("depth_lateral", "turns_boxed", found["turns_boxed"], BOXED.needs, settle)
    if lateral.label == "swaps":
        return _not_clear(found, lateral)
    swap, needs = found["mirror_swap_rate"], f"half of the turns exchanged under reflection, p below {ALPHA}"
    early = lateral.decided_by.startswith(PREFIX)  # settled by an e-value that denies it
    name, one = (lateral.decided_by, lateral.statistic) if early else ("mirror_swap_rate", swap)
    missing = ("mirrored",) if lateral.label == "not_tested" else ()
    settle = {
        "no_power": _turns_needed(swap),
        "not_tested": "mirrored pictures, and actions that a reflection exchanges",
    }.get(lateral.label, f"nothing on this bank: {lateral.label} is settled" if early else NOTHING)
    return WhyNot("depth_lateral", name, one, needs, settle, conditions=missing)


def _not_clear(found: Mapping[str, Statistic], lateral: Ruling) -> WhyNot:
    """Say which test does not hold of turns that are exchanged; more turns mend none where others are shown wrong."""
    against = WhyNot("depth_lateral", lateral.decided_by, lateral.statistic, f"at most {MARGIN}", NOTHING)
    if lateral.decided_by == "turns_against":
        return against
    for name in ("turns_clear", "turns_clear_within"):
        one = found[name]
        if below(one.p):
            continue
        why = _untold("depth_lateral", name, found)
        if one.p is None:
            return replace(why, settle=f"a bank that says more: {one.note}", frames=None)
        if name == "turns_clear_within":
            return replace(why, settle="turns on lanes of which either side may be clear", frames=None)
        return why
    return against


def _turns_needed(swap: Statistic) -> str:
    need = turns_to_tell(swap)
    if need is None:
        return f"nothing on frames like these: {swap.n} turns are enough, and no more than half are exchanged"
    return f"about {need} frames on which it turns; it turned on {swap.n}"


def _not_depth(evidence: Evidence) -> WhyNot:
    """Say what was not shown of who brakes harder for the nearer lead, or that nothing was moved."""
    found, name = evidence.statistics, "depth_interventional"
    if found[name].p is None:
        if all(evidence.replies.get(moved) for moved in MOVED):
            settle = f"decisions on {', '.join(MOVED)}: {found[name].note}"
            return WhyNot("depth", name, found[name], "an answer", settle)
        return _missing("depth", name, evidence, tuple(one for one in (*MOVED, *STAGE) if one not in evidence.replies))
    clause = next(one for one in UNSHOWN if one.holds(found) is not True)
    one = clause.read(found)
    missing = tuple(name for name in clause.conditions if name not in evidence.replies)
    if clause.outcome(found) is None and missing:
        return _missing("depth", clause.statistic, evidence, missing)
    if clause is NO_OPEN_PLACE:
        return WhyNot("depth", clause.statistic, one, clause.needs, f"more frames {one.note}")
    settle = f"more frames, in more episodes: there are {one.n}" if one.n else f"decisions on its pictures: {one.note}"
    if clause.statistic == "unparsed_controls":
        settle = "decisions on edited pictures: it declines them more often than true ones may be"
    return WhyNot("depth", clause.statistic, one, clause.needs, settle)


def _in_part(found: Mapping[str, Statistic], ruling: Ruling) -> WhyNot:
    """Say that its braking answers in some places only; more frames show no more of the others."""
    return WhyNot("depth", ruling.decided_by, found["holes"], "an effect in every place", NOTHING)


def _missing(label: str, name: str, evidence: Evidence, missing: tuple[str, ...]) -> WhyNot:
    """Say what would answer a test that was not made: conditions, where any was not asked, else decisions."""
    one = evidence.statistics[name]
    if missing:
        settle, first = _pictures(missing, evidence)
        return WhyNot(label, name, one, "an answer", settle, conditions=missing, first=first)
    return WhyNot(label, name, one, "an answer", f"decisions on more of its pictures: {one.note}")


def _pictures(missing: tuple[str, ...], evidence: Evidence) -> tuple[str, str]:
    """Say which pictures were not asked, and which the bank lacks, with what these are to show and what draws them.

    All of that, and the first of these ways.
    """
    lacks = [name for name in missing if name in evidence.absent]
    asked = [name for name in missing if name not in evidence.absent and not (lacks and name in NUDGES)]
    ways = []
    if lacks:
        shown = "; ".join(f"{name}: {PHOTOGRAPHED[name]}" for name in lacks if name in PHOTOGRAPHED)
        command = f"eyechart frames build --add-to {shlex.quote(evidence.bank)}"
        if not set(MOVED) & set(lacks):
            ways.append(f"'{command}' draws them of a simulator's world, then resume the run")
        ways.append(f"of photographs, each moment again ({shown})")
        ways[0] = f"pictures that the bank lacks: {ways[0]}"
    if asked:
        ways.append(f"{'and ' if ways else ''}pictures that were not asked: {', '.join(asked)}")
    return "; ".join(ways), ways[0]


def _not_associated(evidence: Evidence) -> WhyNot:
    """Say which of the conditions of depth fails, or that its first test does not hold or could not be made."""
    found = evidence.statistics
    interventional, observational = found["depth_interventional"], found["depth_observational"]
    if is_refuted(found):
        clause = next(one for one in REFUTING if one.holds(found) is False)
        return WhyNot("depth", clause.statistic, clause.read(found), clause.needs, NOTHING)
    first = observational if interventional.p is None else interventional
    if below(first.p):
        return _by_file("depth", found)
    if interventional.p is not None:
        return _untold("depth", "depth_interventional", found)
    settle = f"counterfactual pictures ({', '.join(MOVED)})"
    if lacks := [f"{name}: {PHOTOGRAPHED[name]}" for name in MOVED if name in evidence.absent]:
        settle += f", which this bank lacks (of each moment again, {'; '.join(lacks)})"
    episodes = None
    if observational.p is None and evidence.gap:
        episodes = episodes_needed(evidence.scenarios, alpha=ALPHA)
        settle += f", or {episodes} episodes in each scenario"
    needs, unasked = f"p below {ALPHA}", tuple(name for name in MOVED if name not in evidence.replies)
    return WhyNot("depth_associated", "depth_observational", observational, needs, settle, None, episodes, unasked)


def _undecided(found: Mapping[str, Statistic], ruling: Ruling) -> WhyNot:
    name, one = ruling.decided_by, ruling.statistic
    if name == "repeat_over_nudged":
        return _by_file("content", found)
    if name == "repeats_together":
        return _untold("content", "content_shuffled", found)
    label = "presence_only" if below(found["presence"].p) else "image_invariant"
    if one is None and name.startswith("bound_"):
        conditions = tuple({"bound_content_shuffled": "shuffled"}.get(name, "blank").split())
        settle = f"decisions on {', '.join(('real', 'real_repeat', *conditions))}"
        return WhyNot(label, name, found[name], "an answer", settle, conditions=conditions)
    if one is None:
        return WhyNot(ANY, name, None, "an answer", "calls with the real picture that come back")
    alpha = ALPHA if name in STRICT else BOUND_ALPHA
    needed, needs = frames_to_bound(one, alpha), f"an effect bounded below {MARGIN}, p below {alpha}"
    if needed is None:
        return WhyNot(label, name, one, needs, "nothing on frames like these: the effect is there")
    return WhyNot(label, name, one, needs, "about {} frames, {}".format(*needed), needed[0])


def _frames(one: Statistic) -> tuple[str, int | None]:
    """Return what would settle a test in words, and about how many frames, were the rest like those that there are."""
    need, frames = None, one.n + one.ties if isinstance(one, SignTest) else one.n
    if isinstance(one, SignTest) and one.n:
        rate, alpha = one.value or 0.0, ALPHA
        while rate > 0.51:  # nearer to one half, tens of thousands of frames would not settle it
            need = math.ceil(trials_needed(rate, 0.5, alpha=alpha) * frames / one.n)
            if need > frames:
                break
            alpha /= 2  # its rule corrects it, for so many tests
    return (NOTHING, None) if need is None else (f"about {need} frames, were the rest like these {frames}", need)
