"""The calibrated rules: they hold their error rate, and accept no null hypothesis.

docs/decisions/battery.md says why; `depth` has what depth needs beside its first test.
"""

import math
from collections import ChainMap
from collections.abc import Collection, Mapping

from eyechart.conditions import ABSENT, AGAIN, FURTHER
from eyechart.stats.agreement import SwapRate, trials_needed
from eyechart.stats.paired_tests import DiscordantPairs, pairs_to_bound
from eyechart.stats.statistic import Statistic
from eyechart.verdicts.depth import (
    DOSE,
    EXCHANGE,
    EXCHANGED,
    LARGE,
    MOVED,
    NUDGED,
    RULES,
    STAGE,
    UNFOLLOWED,
    is_drawn,
    is_edited,
)
from eyechart.verdicts.labels import ALPHA, BOUND_ALPHA, FLOOR, MARGIN, ONE_SIDED_FROM, SWAP_RATE, UNPARSED_CUT
from eyechart.verdicts.rules import (
    WORDS,
    Axis,
    Clause,
    NamedStatistics,
    Reading,
    Rule,
    compared,
    fact,
    missing,
    number_of,
    p_below,
    p_from,
    there,
)
from eyechart.verdicts.ruling import Ruling, p_value

PICTURES = {
    "shuffled": "another frame of the scenario",
    "recoloured": "another paint of the own vehicle alone",
    "lead_absent": "the lead's absence alone",
    "lead_near": "the lead near",
    "lead_far": "the lead far",
    "scene": "a frame of another scenario",
    "mirrored": "the reflected picture",
    "blank": "a blank picture",
    "noise": "noise in place of the picture",
    "text_only": "no picture",
}
"""What a model is shown in place of its picture, in words."""

CONTENT = {f"content_{name}": PICTURES[name] for name in ("shuffled", "recoloured", "lead_absent")}
"""The tests of content, and what each picture changes."""

_CHANGES = ("bound_mirrored", "bound_lead_near", "bound_lead_far", f"bound_{ABSENT}")
"""What an absence also bounds, at `BOUND_ALPHA`: changed pictures that are no other frame."""

_NO_PICTURES = ("bound_noise", "bound_text_only")
"""Likewise, where decisions are said not to come from the camera at all."""

STRICT = ("bound_content_shuffled", "bound_content_recoloured", "bound_scene", "bound_blank")
"""The bounds at `ALPHA`; the last is not of content."""


def grade(found: NamedStatistics) -> str:
    """Return how distance was tested: controlled, edited, interventional, observational or none.

    It is edited where the controls are pictures into which the lead was edited.
    """
    if found["depth_interventional"].p is not None:
        if is_edited(found) and is_drawn(found):
            return "edited"
        return "controlled" if is_drawn(found) or found["lane_net"].n else "interventional"
    return "none" if found["depth_observational"].p is None else "observational"


def controls_wanted(
    found: NamedStatistics, *, supplied: Collection[str], conditions_run: Collection[str]
) -> tuple[str, ...]:
    """Return the controls to ask next, of those ``supplied`` by the bank and not run yet.

    Empty where no control could take a claim away. The statistics alone decide, so that every
    scoring of a run finds the same.
    """
    ruling = calibrated_rules(found, turns=False)[0]
    label, decided = ruling.label, ruling.statistic is not None
    may_be_blind = label == "undecided" and decided and UNFOLLOWED.holds(found)
    wanted: tuple[str, ...] = ()
    if label in {"content", "depth_associated"}:
        wanted = (NUDGED,)
    elif label in {"presence_only", "refusal_effect", "image_invariant"} or may_be_blind:
        wanted = (ABSENT, AGAIN)
    if set(STAGE) <= {*supplied, *conditions_run}:
        if label != "not_scorable" and MOVED.holds(found) and not set(STAGE) <= set(conditions_run):
            wanted = (*STAGE, *FURTHER)
    elif label == "depth_associated" and MOVED.holds(found) and LARGE.holds(found):
        if EXCHANGED.holds(found):
            wanted = (*DOSE, NUDGED)
        elif set(EXCHANGE) <= set(supplied) and not set(EXCHANGE) <= set(conditions_run):
            wanted = EXCHANGE
    return tuple(name for name in wanted if name in supplied and name not in conditions_run)


NO_CONTENT = (there("bound_content_shuffled"), p_from("repeats_together", ALPHA))


def _bounds(*names: str) -> tuple[Clause, ...]:
    """Return the bounds that an absence needs, of those that were tested."""
    return tuple(p_below(name, _level(name), untested=True) for name in names)


def _level(name: str) -> float:
    return ALPHA if name in STRICT else BOUND_ALPHA


_OF_CONTENT = _bounds(*STRICT[:3], *_CHANGES)
_OF_ALL = (*_OF_CONTENT, *_bounds(*_NO_PICTURES))
_BLANK = p_below("bound_blank", ALPHA)
_PRESENCE = p_below("presence", ALPHA)


_FEW = f"less than {MARGIN} of the frames more than a repeat does"


def _open_bound(found: NamedStatistics, name: str) -> str:
    """Say of an open bound that there is an effect, or how many frames would decide."""
    needed = frames_to_bound(found[name], _level(name))
    what = PICTURES[name.removeprefix("bound_").removeprefix("content_")]
    if needed is None:
        return f"{what} changes its decision more than a repeat does, which supports no label"
    frames, likeness = needed
    return (
        f"no test decided; that {what} changes its decision on {MARGIN} of the frames or more is not excluded "
        f"(about {frames} frames would exclude or show it, {likeness})"
    )


def _no_answer(name: str, condition: str) -> Rule:
    words = f"no frame has decisions on real, real_repeat and {condition}, so no absence can be bounded"
    return Rule("undecided", name, (missing(name),), words, quiet=True)


_ANSWERED = (
    Rule(
        "undecided",
        "unparsed_reference",
        (missing("unparsed_reference", "value"),),
        "no call with the real picture has come back",
        quiet=True,
    ),
    Rule(
        "not_scorable",
        "unparsed_reference",
        (compared("unparsed_reference", "value", ">", UNPARSED_CUT),),
        f"more than {UNPARSED_CUT} of its replies to true pictures hold no decision",
    ),
)
_REST = (
    Rule(
        "depth_associated",
        "depth_observational",
        (missing("depth_interventional"), p_below("depth_observational", ALPHA), UNFOLLOWED),
        "its braking goes with the gap that frames happen to have; no lead was moved to test it",
    ),
    *(
        Rule(
            "content",
            name,
            (p_below(name, ALPHA, family=tuple(CONTENT)), p_below(nudged, ALPHA, untested=True)),
            f"{what} changes its answer more than a repeat does",
        )
        for name, what in CONTENT.items()
        for nudged in (name.replace("content_", "content_nudged_"),)
    ),
    Rule(
        "self_inconsistent",
        "kappa_pooled",
        (
            compared("self_disagreement", "low", ">", FLOOR),
            compared("kappa", "value", "<", FLOOR),
            compared("kappa", "low", "<=", 0.0),
            p_below("bound_kappa", ALPHA),
            p_below("kappa_pooled", ALPHA),
        ),
        "it disagrees with itself on the same picture (s = {value:self_disagreement}), about as often as chance would",
    ),
    Rule(
        "scene_cue",
        "scene_cue",
        (p_below("scene_cue", ALPHA),),
        "another scenario changes its answer more than another frame of its own scenario does; that the latter changes "
        "it was not shown",
    ),
    Rule(
        "presence_only",
        "presence",
        (_PRESENCE, *NO_CONTENT, *_OF_CONTENT),
        f"its decisions on real and blank pictures differ; other content that was tested changes them on {_FEW}",
    ),
    Rule(
        "refusal_effect",
        "presence_response",
        (p_below("presence_response", ALPHA), p_from("presence", ALPHA), *NO_CONTENT, *_OF_ALL),
        "its outputs on real and blank pictures differ; that its decisions differ was not shown, and "
        f"all else that was tested changes them on {_FEW}",
    ),
    Rule(
        "image_invariant",
        "bound_blank",
        (_BLANK, *NO_CONTENT, *_OF_ALL),
        f"a blank picture changes its decision on {_FEW}, and so does all else that was tested",
    ),
    Rule(
        "undecided",
        "repeat_over_nudged",
        (p_below("repeat_over_nudged", ALPHA),),
        "one pixel changed by one level, which nobody sees, changes its answer more than a repeat does: it follows "
        "the file, or a cache answered, so that its answers do not show what it sees",
    ),
    _no_answer("bound_content_shuffled", "shuffled"),
    _no_answer("bound_blank", "blank"),
    Rule(
        "undecided",
        "repeats_together",
        (p_below("repeats_together", ALPHA),),
        "some pictures get another answer than most, and get it twice; that their content decides was not shown",
    ),
    # where the effect of a blank is shown, what is open is the effect of content
    Rule("undecided", needs=(_PRESENCE,), says="{open_bound}", broken=_OF_CONTENT, worst=True),
    Rule("undecided", says="{open_bound}", broken=(*_OF_ALL, _BLANK), worst=True),
)

DISTANCE = Axis("distance", (*_ANSWERED, *RULES, *_REST))
"""The calibrated labels, in the order in which they are tried.

Without pictures of the lead along its range a model gets ``depth_associated`` at most.
"""

_NO_CLAIMS = {"undecided", "not_scorable", "image_invariant"}
_OF_DEPTH = {"depth_lateral", "partial_depth", "depth_associated"}
CLAIMS = len({rule.label for rule in DISTANCE.rules} - _NO_CLAIMS - _OF_DEPTH)
"""So many positive claims are tested, each at alpha; depth and what falls short of it are one."""


def frames_to_bound(bound: Statistic, alpha: float) -> tuple[int, str] | None:
    """Return how many frames would decide on a bound, and if what; None where there is an effect.

    If all frames together would do without an effect, it counts how many more would bound it or show
    it. The further frames are taken to be like these: the interval shrinks with the root of n.
    """
    if bound.ci is None or bound.value is None or bound.ci[0] > 0:
        return None
    discordant = bound.discordant / max(bound.n, 1) if isinstance(bound, DiscordantPairs) else 0.0
    need = pairs_to_bound(min(discordant, 0.9), margin=MARGIN, alpha=alpha)
    if need > bound.n:
        return need, "if there is none"
    (low, high), value = bound.ci, bound.value
    times = [((high - value) / (MARGIN - value)) ** 2] if value < MARGIN else []
    times += [((value - low) / value) ** 2] if value > 0 else []
    return max(math.ceil(bound.n * min(times)), bound.n + 1), "if the rest are like these"


def turns_to_tell(swap: Statistic) -> int | None:
    """Return how many turns would tell whether they are exchanged; None where none would.

    It is for a rate of .65, and where there are enough turns for that, for the rate that they have.
    """
    need = _turns_for(0.5)
    if need > swap.n:
        return need
    rate = swap.value or 0.0
    return max(trials_needed(rate, 0.5, alpha=ALPHA), swap.n + 1) if rate > 0.51 else None


def _turns_for(chance: float) -> int:
    return trials_needed(0.65, min(chance, 0.5), alpha=ALPHA)


BOXED = compared("turns_boxed", "high", "<", 0.0)
"""Where neither side is clear it turns less than half as often as where one is."""
_INWARDS = Clause("turns_boxed", (Reading("value", "<=", 0.0), Reading("low", "<=", 0.0)), untested=True)


def earns_lateral(found: NamedStatistics, label: str) -> bool:
    """Return whether it earns ``depth_lateral``: to the clear side, and few turns without one."""
    return label == "turns_clear" and BOXED.holds(found) is True


_SWAP = "mirror_swap_rate"


def lateral_facts(found: NamedStatistics, seen: Mapping[str, int]) -> Mapping[str, Statistic]:
    """Return the facts that the lateral rules read.

    ``seen`` counts each direction over pictures and their reflections.
    """
    given = [direction for direction, count in seen.items() if count]
    alone = len(given) == 1 and sum(seen.values()) >= ONE_SIDED_FROM
    return {
        **fact("turns_reflected", holds=isinstance(found[_SWAP], SwapRate)),
        **fact("every_direction", holds=len(given) == len(seen)),
        "one_direction": Statistic(float(alone), sum(seen.values()), note=given[0] if alone else ""),
    }


def _few_turns(found: NamedStatistics, _: str) -> str:
    """Say how many directions would tell, or that those given do not."""
    swap = found[_SWAP]
    need = _turns_for(number_of(swap, "chance") or 0.0)
    if need <= swap.n:
        return f"its {swap.n} directional decisions do not tell whether it exchanges half of them"
    return f"{need} directional decisions would tell a rate of .65 from chance"


WORDS.update(
    open_bound=_open_bound,
    few_turns=_few_turns,
    hundredths=lambda found, name: f"{found[name].value:.2f}",
    chance=lambda found, name: f"{found[name].chance:.2f}",
    p_value=lambda found, name: p_value(found[name].p),
)

_SWAPS = (
    compared("every_direction", "value", ">=", 1.0),
    compared(_SWAP, "value", ">=", SWAP_RATE),
    compared(_SWAP, "low", ">", "chance"),
    p_below(_SWAP, ALPHA),
)

LATERAL_AXIS = Axis(
    "lateral",
    (
        Rule("not_tested", _SWAP, (compared("turns_reflected", "value", "<", 1.0),), f"{{note:{_SWAP}}}", quiet=True),
        Rule(
            "one_sided",
            _SWAP,
            (compared("one_direction", "value", ">=", 1.0),),
            "{note:one_direction} is the only direction it ever gives, mirrored or not",
        ),
        Rule(
            "no_power",
            _SWAP,
            (Clause(_SWAP, tuple(Reading(reads, "missing") for reads in ("value", "low", "p", "chance"))),),
            f"no decision has a direction; up to {_turns_for(0.5)} are needed",
            quiet=True,
        ),
        Rule(
            "swaps",
            "turns_against",
            (*_SWAPS, p_below("turns_against", BOUND_ALPHA), compared("turns_against", "value", ">", MARGIN)),
            "its directions are exchanged under reflection, but {hundredths:turns_against} of its turns, beyond its "
            "noise, go to the blocked side",
        ),
        Rule(
            "turns_clear",
            "turns_clear",
            (*_SWAPS, p_below("turns_clear", ALPHA), p_below("turns_clear_within", ALPHA), _INWARDS),
            "its directions are exchanged under reflection and go to the clear side, within each lane too "
            "(p = {p_value:turns_clear_within})",
        ),
        Rule("swaps", _SWAP, _SWAPS, f"its directions are exchanged under reflection; chance is {{chance:{_SWAP}}}"),
        Rule(
            "does_not_swap",
            _SWAP,
            (compared(_SWAP, "high", "<", SWAP_RATE),),
            f"its directions are exchanged under reflection in less than {SWAP_RATE} of the cases",
        ),
        Rule("no_power", _SWAP, says="{few_turns}"),
    ),
)
"""Whether directions are exchanged under reflection, and go to the clear side."""


def lateral_rules(found: NamedStatistics, seen: Mapping[str, int]) -> Ruling:
    """Return the lateral label; ``seen`` is that of `lateral_facts`."""
    return LATERAL_AXIS.evaluate(ChainMap(dict(lateral_facts(found, seen)), found))  # type: ignore[arg-type]


def calibrated_rules(found: NamedStatistics, *, turns: bool) -> tuple[Ruling, str]:
    """Return the calibrated label, and how distance was tested, see `grade`.

    ``turns`` says whether the lateral label earns ``depth_lateral`` where distance earns ``depth``.
    """
    known = ChainMap(dict(fact("lateral_earned", holds=turns)), found)  # type: ignore[arg-type]
    return DISTANCE.evaluate(known), grade(found)
