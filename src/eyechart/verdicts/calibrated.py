"""The calibrated rules: they hold their error rate, and say ``undecided`` rather than accept a null."""

from collections.abc import Mapping

from eyechart.stats.agreement import SwapRate, trials_needed
from eyechart.stats.paired import Discordant, pairs_to_bound
from eyechart.stats.resampling import holm
from eyechart.stats.statistic import Statistic
from eyechart.verdicts.labels import ALPHA, FLOOR, MARGIN, SWAP_RATE, UNPARSED_CUT
from eyechart.verdicts.ruling import Ruling, decided


def calibrated_rules(found: Mapping[str, Statistic], *, swaps: bool) -> tuple[Ruling, str]:
    """Return the calibrated label and how the question of distance was put (interventional, observational, none)."""
    name, evidence = _depth_test(found)
    unparsed, depth = found["unparsed_reference"], found[name]
    if unparsed.value is None:
        words = "no call with the real picture has come back"
        return decided("undecided", "unparsed_reference", None, words), evidence
    if unparsed.value > UNPARSED_CUT:
        return decided("not_scorable", "unparsed_reference", unparsed, "above {cut}", cut=UNPARSED_CUT), evidence
    if depth.p is not None and depth.p < ALPHA:
        label = "depth_lateral" if swaps else "depth"
        return decided(label, name, depth, "it brakes harder where the lead is nearer"), evidence
    for rule in (*POSITIVE, _invariant):
        ruling = rule(found)
        if ruling is not None:
            return ruling, evidence
    return _undecided(found), evidence


def _depth_test(found: Mapping[str, Statistic]) -> tuple[str, str]:
    if found["depth_interventional"].p is not None:
        return "depth_interventional", "interventional"
    return "depth_observational", "observational" if found["depth_observational"].p is not None else "none"


def _self_inconsistent(found: Mapping[str, Statistic]) -> Ruling | None:
    differs, kappa, pooled = found["self_disagreement"], found["kappa"].value, found["kappa_pooled"]
    if differs.ci is None or differs.ci[0] <= FLOOR or kappa is None or kappa >= FLOOR:
        return None
    if pooled.p is None or pooled.p >= ALPHA:
        return None
    words = "it disagrees with itself on the same picture (s = {s}), about as often as chance would"
    return decided("self_inconsistent", "kappa_pooled", pooled, words, s=differs)


def _content(found: Mapping[str, Statistic]) -> Ruling | None:
    names = ("content_shuffled", "content_recoloured")
    for name, p in zip(names, holm([found[name].p for name in names]), strict=True):
        if p is not None and p < ALPHA:
            what = (
                "another frame of the scenario" if name == "content_shuffled" else "only the paint of the own vehicle"
            )
            return decided("content", name, found[name], "{what} changes its answer more than a repeat does", what=what)
    return None


def _scene_cue(found: Mapping[str, Statistic]) -> Ruling | None:
    cue = found["scene_cue"]
    if cue.p is None or cue.p >= ALPHA:
        return None
    return decided("scene_cue", "scene_cue", cue, "another scenario changes its answer more than another frame does")


def _bounds(found: Mapping[str, Statistic]) -> bool:
    """Return whether every effect of content that could be tested is bounded below the margin."""
    tested = [found[f"bound_{name}"] for name in ("content_shuffled", "content_recoloured", "scene")]
    made = [bound for bound in tested if bound.p is not None]
    return found["bound_content_shuffled"].p is not None and all(
        bound.p < ALPHA for bound in made if bound.p is not None
    )


def _presence(found: Mapping[str, Statistic]) -> Ruling | None:
    presence = found["presence"]
    if presence.p is None or presence.p >= ALPHA or not _bounds(found):
        return None
    words = "real and blank differ, and the effect of content is below {margin}"
    return decided("presence_only", "presence", presence, words, margin=MARGIN)


def _refusal(found: Mapping[str, Statistic]) -> Ruling | None:
    response, decision = found["presence_response"], found["presence"]
    if response.p is None or response.p >= ALPHA or (decision.p is not None and decision.p < ALPHA):
        return None
    if not _bounds(found):
        return None
    return decided(
        "refusal_effect", "presence_response", response, "real and blank differ in outputs, not in decisions"
    )


POSITIVE = (_self_inconsistent, _content, _scene_cue, _presence, _refusal)
"""The rules of positive claims below depth, in the order in which they are tried; of ``content``, Holm over two."""


def _invariant(found: Mapping[str, Statistic]) -> Ruling | None:
    blank = found["bound_blank"]
    if blank.p is None or blank.p >= ALPHA or not _bounds(found):
        return None
    words = "the effects of a blank picture and of content are both below {margin}"
    return decided("image_invariant", "bound_blank", blank, words, margin=MARGIN)


def _undecided(found: Mapping[str, Statistic]) -> Ruling:
    """Say which absence could not be bounded, and what would decide it."""
    bounds = {name: found[f"bound_{name}"] for name in ("content_shuffled", "blank", "content_recoloured", "scene")}
    for condition, name in (("shuffled", "content_shuffled"), ("blank", "blank")):
        if bounds[name].p is None:
            words = "no frame has decisions on real, real_repeat and {condition}, so no absence can be bounded"
            return decided("undecided", f"bound_{name}", None, words, condition=condition)
    presence = found["presence"].p
    if presence is not None and presence < ALPHA:
        bounds.pop("blank")  # the effect of a blank is shown; what is open is the effect of content
    open_ones = {name: bound for name, bound in bounds.items() if bound.p is not None and bound.p >= ALPHA}
    if not open_ones:
        return decided("undecided", "presence", None, "no rule's test decided at alpha {alpha}", alpha=ALPHA)
    name, bound = max(open_ones.items(), key=lambda item: item[1].p or 0.0)
    discordant = bound.discordant / max(bound.n, 1) if isinstance(bound, Discordant) else 0.0
    need = pairs_to_bound(min(discordant, 0.9), margin=MARGIN, alpha=ALPHA)
    words = "no test decided; an effect of {margin} is not excluded (were there none, about {need} frames would)"
    return decided("undecided", f"bound_{name}", bound, words, margin=MARGIN, need=need)


def lateral_rules(found: Mapping[str, Statistic], seen: Mapping[str, int]) -> Ruling:
    """Return the lateral label: whether directions are exchanged under reflection, if that can be told.

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
        need = trials_needed(0.65, 0.5, alpha=ALPHA)
        return decided("no_power", name, None, "no directional decision; up to {need} are needed", need=need)
    both = all(count > 0 for count in seen.values())
    if both and swap.value >= SWAP_RATE and swap.ci[0] > swap.chance and swap.p < ALPHA:
        return decided("swaps", name, swap, "directions are exchanged, chance is {chance:.2f}", chance=swap.chance)
    if swap.ci[1] < SWAP_RATE:
        words = "directions are exchanged in less than {share} of the cases"
        return decided("does_not_swap", name, swap, words, share=SWAP_RATE)
    words = "{need} directional decisions would tell a rate of .65 from chance"
    need = trials_needed(0.65, min(swap.chance, 0.5), alpha=ALPHA)
    return decided("no_power", name, swap, words, need=need)
