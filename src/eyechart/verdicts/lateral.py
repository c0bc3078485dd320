"""The lateral label: whether left and right are exchanged under reflection, an axis of its own."""

from collections.abc import Mapping

from eyechart.spaces.discrete import Discrete
from eyechart.stats.agreement import trials_needed
from eyechart.stats.statistic import Statistic
from eyechart.studies.battery import ALPHA, ModelScore
from eyechart.verdicts.ruling import SWAP_RATE, Ruling, decided

LATERAL_LABELS = ("swaps", "does_not_swap", "one_sided", "no_power", "not_tested")


def lateral_rules(found: Mapping[str, Statistic], model: ModelScore, space: Discrete) -> Ruling:
    """Return the lateral label: whether LEFT and RIGHT are exchanged under reflection, if that can be told."""
    swap, name = found["mirror_swap_rate"], "mirror_swap_rate"
    if swap.detail is None:
        return Ruling("not_tested", name, swap.note)
    seen = _directions(model, space)
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


def _directions(model: ModelScore, space: Discrete) -> dict[str, int]:
    given = [*model.answers.actions("real"), *model.answers.actions("mirrored")]
    return {direction: sum(one == direction for one in given) for direction in space.directional}
