"""The paper's rules, as we read them (docs/decisions/0006-two-sets-of-rules.md)."""

from collections.abc import Mapping, Sequence

from eyechart.stats.statistic import Statistic
from eyechart.verdicts.ruling import SWAP_RATE, Ruling, decided, number

PAPER_ALPHA = 0.05
PAPER_UNPARSED = 0.20
"""Above this unparsed rate over all calls the paper's rules do not score. The paper prints no cut: any in
(.05, .28) gives the five verdicts of Table t:frontier."""

PAPER_LABELS = (
    "not_scorable",
    "refusal_effect",
    "image_invariant",
    "self_inconsistent",
    "presence_only",
    "depth",
    "depth_lateral",
)


def paper_rules(found: Mapping[str, Statistic], corrected: Mapping[str, float | None]) -> Ruling:
    """Return the paper's label, by its rules as we read them, with its own alpha of .05.

    ``corrected`` holds the p of Cramér's V corrected over the models. A refusal effect compares a model with itself,
    so its decision level is not corrected: over other models it would have another family than the response level.
    """
    return _paper_blind(found, corrected) or _paper_ungraded(found) or _paper_depth(found)


def _paper_blind(found: Mapping[str, Statistic], corrected: Mapping[str, float | None]) -> Ruling | None:
    unparsed = found["unparsed_rate"]
    if unparsed.value is None or unparsed.value > PAPER_UNPARSED:
        return decided("not_scorable", "unparsed_rate", unparsed, f"above {PAPER_UNPARSED}")
    response, decision = corrected["cramers_v"], found["cramers_v.decision"]
    if len(_asked(found["cramers_v"])) < 2:
        return Ruling("not_scorable", "cramers_v", "fewer than two conditions were asked: there is nothing to compare")
    if response is None or response >= PAPER_ALPHA:
        return decided("image_invariant", "cramers_v", found["cramers_v"], "no answer depends on the condition")
    if decision.p is None or decision.p >= PAPER_ALPHA:
        return decided("refusal_effect", "cramers_v.decision", decision, "only outputs differ")
    if found["clears_floor"].value != 1.0:
        idi, floor = found["idi"], found["noise_floor"]
        return Ruling("self_inconsistent", "clears_floor", f"IDI {number(idi)} is not above 1.5 s, s = {number(floor)}")
    return None


def _asked(association: Statistic) -> Sequence[object]:
    rows = (association.detail or {}).get("rows", ())
    return rows if isinstance(rows, list | tuple) else ()


def _paper_ungraded(found: Mapping[str, Statistic]) -> Ruling | None:
    obstacle, information, order = (
        found["obstacle.decision"].p,
        found["mutual_information.decision"].p,
        found["gap_order"].value,
    )
    if obstacle is None or information is None or order is None:
        return decided("presence_only", "gap_order", found["gap_order"], "the gap tests cannot be passed")
    if obstacle >= PAPER_ALPHA or information >= PAPER_ALPHA:
        name = "obstacle.decision" if obstacle >= information else "mutual_information.decision"
        return decided("presence_only", name, found[name], "the action does not follow the gap")
    if order <= 0:
        return decided("presence_only", "gap_order", found["gap_order"], "it does not brake nearer than it proceeds")
    return None


def _paper_depth(found: Mapping[str, Statistic]) -> Ruling:
    swap, information = found["mirror_swap_rate"], found["mutual_information.decision"]
    if swap.value is not None and swap.value >= SWAP_RATE:
        return decided("depth_lateral", "mirror_swap_rate", swap, "directions are exchanged under reflection")
    return decided("depth", "mutual_information.decision", information, "the action follows the gap")
