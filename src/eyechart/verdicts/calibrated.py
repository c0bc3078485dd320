"""The calibrated rules: they hold their error rate, and say ``undecided`` rather than accept a null.

Number 6 of docs/decisions has them, and number 38 what depth needs beside its first test.
"""

import math
from collections.abc import Collection, Mapping, Sequence

from eyechart.stats.agreement import SwapRate, trials_needed
from eyechart.stats.paired import Discordant, SignTest, pairs_to_bound
from eyechart.stats.resampling import holm
from eyechart.stats.statistic import Statistic
from eyechart.verdicts.controls import ABSENT, DOSE, EXCHANGE, NUDGED, below, failures, lacking
from eyechart.verdicts.labels import ALPHA, BOUND_ALPHA, FLOOR, MARGIN, SWAP_RATE, UNPARSED_CUT
from eyechart.verdicts.ruling import Ruling, decided, p_value

CONTENT = {
    "content_shuffled": "another frame of the scenario",
    "content_recoloured": "only the paint of the own vehicle",
    "content_lead_absent": "only that the lead is gone",
}
"""The tests of content, and what each picture changes."""

CHANGES = ("mirrored", "lead_near", "lead_far", ABSENT)
"""What an absence bounds besides, at `BOUND_ALPHA`: these change the picture and are no other frame."""

STRICT = ("bound_content_shuffled", "bound_content_recoloured", "bound_scene", "bound_blank")
"""The bounds at `ALPHA`; the last is not of content."""

NO_PICTURES = ("noise", "text_only")
"""Likewise, where decisions are said not to come from the camera at all."""


def calibrated_rules(found: Mapping[str, Statistic], *, turns: bool) -> tuple[Ruling, str]:
    """Return the calibrated label, and how well the question of distance was put, see `grade`.

    ``turns`` says whether the lateral label earns ``depth_lateral`` where distance earns ``depth``.
    """
    evidence, unparsed = grade(found), found["unparsed_reference"]
    if unparsed.value is None:
        words = "no call with the real picture has come back"
        return decided("undecided", "unparsed_reference", None, words), evidence
    if unparsed.value > UNPARSED_CUT:
        return decided("not_scorable", "unparsed_reference", unparsed, "above {cut}", cut=UNPARSED_CUT), evidence
    ruling = _depth(found, turns=turns)
    for rule in (*POSITIVE, _invariant):
        ruling = ruling or rule(found)
    return ruling or _undecided(found), evidence


def grade(found: Mapping[str, Statistic]) -> str:
    """Return how well the question of distance was put: controlled, interventional, observational or none."""
    if found["depth_interventional"].p is not None:
        return "interventional" if found["lane_exchange"].p is None else "controlled"
    return "none" if found["depth_observational"].p is None else "observational"


def controls_wanted(
    found: Mapping[str, Statistic], *, supplied: Collection[str], asked: Collection[str]
) -> tuple[str, ...]:
    """Return the control conditions to ask next, of those ``supplied`` by the bank and not ``asked`` yet.

    None where nothing that could be claimed so far could be taken away by a control. It depends on the statistics
    alone, so that whoever scores a run finds the same.
    """
    ruling = calibrated_rules(found, turns=False)[0]
    label = ruling.label
    wanted: tuple[str, ...] = ()
    if label in {"content", "depth_associated"}:
        wanted = (NUDGED,)
    elif label in {"presence_only", "refusal_effect", "image_invariant"} or _may_be_blind(found, ruling):
        wanted = (ABSENT,)
    if label == "depth_associated" and found["depth_interventional"].p is not None:
        exchanged = found["lane_exchange"].p is not None
        if exchanged:
            wanted = (*DOSE, NUDGED)
        elif set(EXCHANGE) <= set(supplied) and not set(EXCHANGE) <= set(asked):
            wanted = EXCHANGE
    return tuple(name for name in wanted if name in supplied and name not in asked)


def _may_be_blind(found: Mapping[str, Statistic], ruling: Ruling) -> bool:
    """Return whether nothing is decided but that it follows no file: some absence may be true of it."""
    return ruling.label == "undecided" and ruling.statistic is not None and not below(found["repeat_over_nudged"].p)


def _depth(found: Mapping[str, Statistic], *, turns: bool) -> Ruling | None:
    """Return what its braking earns: by all seven conditions, by the first and no failure, or by one that fails."""
    name = "depth_observational" if found["depth_interventional"].p is None else "depth_interventional"
    first, harder = found[name], "it brakes harder where the lead is nearer"
    if not below(first.p) or below(found["repeat_over_nudged"].p):
        return None
    if name == "depth_observational":
        return decided("depth_associated", name, first, "{harder}; nothing was moved", harder=harder)
    failed = next(failures(found), None)
    if failed is not None:
        words = "{harder}, but {but}"
        return decided("content", failed.statistic, found[failed.statistic], words, harder=harder, but=failed.says)
    open_one = next(lacking(found), None)
    if open_one is not None:
        return decided("depth_associated", name, first, "{harder}; {but}", harder=harder, but=open_one.says)
    words = "{harder}, and every control holds"
    return decided("depth_lateral" if turns else "depth", name, first, words, harder=harder)


def _content(found: Mapping[str, Statistic]) -> Ruling | None:
    for name, p in zip(CONTENT, holm([found[name].p for name in CONTENT]), strict=True):
        nudged = found[name.replace("content_", "content_nudged_")].p
        if below(p) and (nudged is None or below(nudged)):
            words = "{what} changes its answer more than a repeat does"
            return decided("content", name, found[name], words, what=CONTENT[name])
    return None


def _self_inconsistent(found: Mapping[str, Statistic]) -> Ruling | None:
    """Ask the repeat alone, which is the same picture, and all pictures that call for one answer, which are more."""
    differs, kappa = found["self_disagreement"], found["kappa"]
    if differs.ci is None or differs.ci[0] <= FLOOR or kappa.value is None or kappa.ci is None:
        return None
    if kappa.value >= FLOOR or kappa.ci[0] > 0:  # above chance, however little
        return None
    if not all(below(found[name].p) for name in ("bound_kappa", "kappa_pooled")):
        return None
    words = "it disagrees with itself on the same picture (s = {s}), about as often as chance would"
    return decided("self_inconsistent", "kappa_pooled", found["kappa_pooled"], words, s=differs)


def _scene_cue(found: Mapping[str, Statistic]) -> Ruling | None:
    cue = found["scene_cue"]
    if not below(cue.p):
        return None
    return decided("scene_cue", "scene_cue", cue, "another scenario changes its answer more than another frame does")


def _levels(changes: Sequence[str]) -> dict[str, float]:
    """Return the bounds that an absence of content needs, each with its level."""
    return dict.fromkeys(STRICT[:3], ALPHA) | {f"bound_{name}": BOUND_ALPHA for name in changes}


def _open(found: Mapping[str, Statistic], levels: Mapping[str, float]) -> dict[str, Statistic]:
    """Return the bounds that were tested and do not hold."""
    made = {name: found[name] for name in levels if found[name].p is not None}
    return {name: bound for name, bound in made.items() if not below(bound.p, levels[name])}


def _bounded(found: Mapping[str, Statistic], changes: Sequence[str]) -> bool:
    """Return whether every effect of content that could be tested is bounded below the margin, and none is shown."""
    if found["bound_content_shuffled"].p is None or below(found["repeats_together"].p):
        return False
    return not _open(found, _levels(changes))


def _presence(found: Mapping[str, Statistic]) -> Ruling | None:
    presence = found["presence"]
    if not below(presence.p) or not _bounded(found, CHANGES):
        return None
    words = "real and blank differ, and the effect of content is below {margin}"
    return decided("presence_only", "presence", presence, words, margin=MARGIN)


def _refusal(found: Mapping[str, Statistic]) -> Ruling | None:
    response = found["presence_response"]
    if not below(response.p) or below(found["presence"].p) or not _bounded(found, (*CHANGES, *NO_PICTURES)):
        return None
    words = "real and blank differ in outputs, not in decisions"
    return decided("refusal_effect", "presence_response", response, words)


POSITIVE = (_content, _self_inconsistent, _scene_cue, _presence, _refusal)
"""The rules of positive claims below depth, in the order in which they are tried; those of ``content`` by Holm."""


def _invariant(found: Mapping[str, Statistic]) -> Ruling | None:
    blank = found["bound_blank"]
    if not below(blank.p) or not _bounded(found, (*CHANGES, *NO_PICTURES)):
        return None
    words = "the effects of a blank picture and of content are both below {margin}"
    return decided("image_invariant", "bound_blank", blank, words, margin=MARGIN)


def _undecided(found: Mapping[str, Statistic]) -> Ruling:
    """Say what stands in the way of every claim: a file that is followed, no answers, an effect, or few frames."""
    nudged = found["repeat_over_nudged"]
    if below(nudged.p):
        words = (
            "one pixel changed by one level, which nobody sees, changes its answer more than a repeat does: it follows "
            "the file, or a cache answered, and neither is sight"
        )
        return decided("undecided", "repeat_over_nudged", nudged, words)
    for condition, name in (("shuffled", "content_shuffled"), ("blank", "blank")):
        if found[f"bound_{name}"].p is None:
            words = "no frame has decisions on real, real_repeat and {condition}, so no absence can be bounded"
            return decided("undecided", f"bound_{name}", None, words, condition=condition)
    if below(found["repeats_together"].p):
        words = "some pictures get another answer than most, and get it twice; what is in them was not shown"
        return decided("undecided", "repeats_together", found["repeats_together"], words)
    levels = _levels((*CHANGES, *NO_PICTURES)) | {"bound_blank": ALPHA}
    if below(found["presence"].p):  # the effect of a blank is shown; what is open is the effect of content
        levels = _levels(CHANGES)
    open_ones = _open(found, levels)  # never none: were every bound to hold, a rule above would have decided
    name, bound = max(open_ones.items(), key=lambda item: item[1].p or 0.0)
    needed = frames_to_bound(bound, levels[name])
    if needed is None:
        words = "{what} changes its decision more than a repeat does, which no rule makes a claim of"
        return decided("undecided", name, bound, words, what=name.removeprefix("bound_").removeprefix("content_"))
    words = "no test decided; an effect of {margin} is not excluded ({under}, about {need} frames would)"
    return decided("undecided", name, bound, words, margin=MARGIN, need=needed[0], under=needed[1])


def frames_to_bound(bound: Statistic, alpha: float) -> tuple[int, str] | None:
    """Return how many frames would decide on a bound, and under what; None where there is an effect.

    They are more than there are: where that many without an effect would do, those that there are look like one, and
    counted is what would bound it, or show it, were the rest like these (the interval shrinks with the root).
    """
    if bound.ci is None or bound.value is None or bound.ci[0] > 0:
        return None
    discordant = bound.discordant / max(bound.n, 1) if isinstance(bound, Discordant) else 0.0
    need = pairs_to_bound(min(discordant, 0.9), margin=MARGIN, alpha=alpha)
    if need > bound.n:
        return need, "were there none"
    (low, high), value = bound.ci, bound.value
    times = [((high - value) / (MARGIN - value)) ** 2] if value < MARGIN else []
    times += [((value - low) / value) ** 2] if value > 0 else []
    return max(math.ceil(bound.n * min(times)), bound.n + 1), "were the rest like these"


def turns_to_tell(swap: Statistic) -> int | None:
    """Return how many turns would tell whether they are exchanged, more than there are; None where none would.

    So many as a rate of .65 takes, and where there are that many already, as the rate that they have.
    """
    need = _turns_for(0.5)
    if need > swap.n:
        return need
    rate = swap.value or 0.0
    return max(trials_needed(rate, 0.5, alpha=ALPHA), swap.n + 1) if rate > 0.51 else None


def _turns_for(chance: float) -> int:
    """Return how many turns tell a rate of .65 from chance."""
    return trials_needed(0.65, min(chance, 0.5), alpha=ALPHA)


def earns_lateral(found: Mapping[str, Statistic], label: str) -> bool:
    """Return whether a lateral label earns ``depth_lateral``: exchange alone only where nobody knows the sides."""
    return label == "turns_clear" or (label == "swaps" and not isinstance(found["turns_clear"], SignTest))


def lateral_rules(found: Mapping[str, Statistic], seen: Mapping[str, int]) -> Ruling:
    """Return the lateral label: whether directions are exchanged under reflection, and go to the clear side.

    ``seen`` counts each direction over the decisions on pictures and on their reflections.
    """
    swap, name = found["mirror_swap_rate"], "mirror_swap_rate"
    if not isinstance(swap, SwapRate):
        return decided("not_tested", name, None, "{note}", note=swap.note)
    if sum(seen.values()) >= 8 and sum(count > 0 for count in seen.values()) == 1:
        only = next(direction for direction, count in seen.items() if count)
        return decided(
            "one_sided", name, swap, "{only} is the only direction it ever gives, mirrored or not", only=only
        )
    if swap.value is None or swap.ci is None or swap.p is None or swap.chance is None:
        return decided("no_power", name, None, "no directional decision; up to {need} are needed", need=_turns_for(0.5))
    both = all(count > 0 for count in seen.values())
    if both and swap.value >= SWAP_RATE and swap.ci[0] > swap.chance and swap.p < ALPHA:
        return _swaps(found, swap)
    if swap.ci[1] < SWAP_RATE:
        words = "directions are exchanged in less than {share} of the cases"
        return decided("does_not_swap", name, swap, words, share=SWAP_RATE)
    words, need = "{n} directional decisions would tell a rate of .65 from chance", _turns_for(swap.chance)
    if need <= swap.n:
        words, need = "its {n} directional decisions do not tell whether it exchanges half of them", swap.n
    return decided("no_power", name, swap, words, n=need)


def _swaps(found: Mapping[str, Statistic], swap: SwapRate) -> Ruling:
    """Return what turns earn that are exchanged: that they go to the clear side, where that was tested and holds."""
    clear, within, against = (found[f"turns_{name}"] for name in ("clear", "clear_within", "against"))
    if below(against.p, BOUND_ALPHA) and against.value is not None and against.value > MARGIN:
        words = "directions are exchanged, but {share:.2f} of its turns, beyond its noise, go to the blocked side"
        return decided("swaps", "turns_against", against, words, share=against.value)
    if below(clear.p) and below(within.p):
        words = "directions are exchanged and go to the clear side, within each lane too (p = {within})"
        return decided("turns_clear", "turns_clear", clear, words, within=p_value(within.p or 0.0))
    words = "directions are exchanged, chance is {chance:.2f}"
    return decided("swaps", "mirror_swap_rate", swap, words, chance=swap.chance)
