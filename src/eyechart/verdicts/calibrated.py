"""The calibrated rules: they hold their error rate, and say ``undecided`` rather than accept a null."""

from collections.abc import Mapping

from eyechart.stats.agreement import trials_needed
from eyechart.stats.paired import pairs_to_bound
from eyechart.stats.resampling import holm
from eyechart.stats.statistic import Statistic
from eyechart.verdicts.labels import ALPHA, FLOOR, MARGIN, SWAP_RATE, UNPARSED_CUT
from eyechart.verdicts.ruling import Ruling, decided, number

POSITIVE_CLAIMS = 6
"""depth, self_inconsistent, content (Holm over two tests), scene_cue, presence_only, refusal_effect."""


def calibrated_rules(found: Mapping[str, Statistic], *, swaps: bool) -> tuple[Ruling, str]:
    """Return the calibrated label and how the question of distance was put (interventional, observational, none)."""
    name, evidence = _depth_test(found)
    unparsed, depth = found["unparsed_reference"], found[name]
    if unparsed.value is None:
        return Ruling("undecided", "unparsed_reference", "no call with the real picture has come back"), evidence
    if unparsed.value > UNPARSED_CUT:
        return decided("not_scorable", "unparsed_reference", unparsed, f"above {UNPARSED_CUT}"), evidence
    if depth.p is not None and depth.p < ALPHA:
        label = "depth_lateral" if swaps else "depth"
        return decided(label, name, depth, "it brakes harder where the lead is nearer"), evidence
    for rule in (_self_inconsistent, _content, _scene_cue, _presence, _refusal, _invariant):
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
    words = f"it disagrees with itself on the same picture (s = {number(differs)}), about as often as chance would"
    return decided("self_inconsistent", "kappa_pooled", pooled, words)


def _content(found: Mapping[str, Statistic]) -> Ruling | None:
    names = ("content_shuffled", "content_recoloured")
    for name, p in zip(names, holm([found[name].p for name in names]), strict=True):
        if p is not None and p < ALPHA:
            what = (
                "another frame of the scenario" if name == "content_shuffled" else "only the paint of the own vehicle"
            )
            return decided("content", name, found[name], f"{what} changes its answer more than a repeat does")
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
    words = f"real and blank differ, and the effect of content is below {MARGIN}"
    return decided("presence_only", "presence", presence, words)


def _refusal(found: Mapping[str, Statistic]) -> Ruling | None:
    response, decision = found["presence_response"], found["presence"]
    if response.p is None or response.p >= ALPHA or (decision.p is not None and decision.p < ALPHA):
        return None
    if not _bounds(found):
        return None
    return decided(
        "refusal_effect", "presence_response", response, "real and blank differ in outputs, not in decisions"
    )


def _invariant(found: Mapping[str, Statistic]) -> Ruling | None:
    blank = found["bound_blank"]
    if blank.p is None or blank.p >= ALPHA or not _bounds(found):
        return None
    words = f"the effects of a blank picture and of content are both below {MARGIN}"
    return decided("image_invariant", "bound_blank", blank, words)


def _undecided(found: Mapping[str, Statistic]) -> Ruling:
    """Say which absence could not be bounded, and what would decide it."""
    bounds = {name: found[f"bound_{name}"] for name in ("content_shuffled", "blank", "content_recoloured", "scene")}
    for condition, name in (("shuffled", "content_shuffled"), ("blank", "blank")):
        if bounds[name].p is None:
            words = f"no frame has decisions on real, real_repeat and {condition}, so no absence can be bounded"
            return Ruling("undecided", f"bound_{name}", words)
    presence = found["presence"].p
    if presence is not None and presence < ALPHA:
        bounds.pop("blank")  # the effect of a blank is shown; what is open is the effect of content
    open_ones = {name: bound for name, bound in bounds.items() if bound.p is not None and bound.p >= ALPHA}
    if not open_ones:
        return Ruling("undecided", "presence", f"no rule's test decided at alpha {ALPHA}")
    name, bound = max(open_ones.items(), key=lambda item: item[1].p or 0.0)
    detail = bound.detail or {}
    discordant = (float(str(detail.get("b", 0))) + float(str(detail.get("c", 0)))) / max(bound.n, 1)
    need = pairs_to_bound(min(discordant, 0.9), margin=MARGIN, alpha=ALPHA)
    words = f"no test decided; an effect of {MARGIN} is not excluded (were there none, about {need} frames would)"
    return decided("undecided", f"bound_{name}", bound, words)


def lateral_rules(found: Mapping[str, Statistic], seen: Mapping[str, int]) -> Ruling:
    """Return the lateral label: whether directions are exchanged under reflection, if that can be told.

    ``seen`` counts each direction over the decisions on pictures and on their reflections.
    """
    swap, name = found["mirror_swap_rate"], "mirror_swap_rate"
    if swap.detail is None:
        return Ruling("not_tested", name, swap.note)
    if sum(seen.values()) >= 8 and sum(count > 0 for count in seen.values()) == 1:
        only = next(direction for direction, count in seen.items() if count)
        return decided("one_sided", name, swap, f"{only} is the only direction it ever gives, mirrored or not")
    if swap.value is None or swap.ci is None or swap.p is None:
        need = trials_needed(0.65, 0.5, alpha=ALPHA)
        return Ruling("no_power", name, f"no directional decision; up to {need} are needed")
    chance = float(str(swap.detail["chance"]))
    both = all(count > 0 for count in seen.values())
    if both and swap.value >= SWAP_RATE and swap.ci[0] > chance and swap.p < ALPHA:
        return decided("swaps", name, swap, f"directions are exchanged, chance is {chance:.2f}")
    if swap.ci[1] < SWAP_RATE:
        return decided("does_not_swap", name, swap, f"directions are exchanged in less than {SWAP_RATE} of the cases")
    need = trials_needed(0.65, min(chance, 0.5), alpha=ALPHA)
    return decided("no_power", name, swap, f"{need} directional decisions would tell a rate of .65 from chance")
