"""A finding is what the paper would point out beside a verdict: a note in words, with the numbers that it rests on."""

from collections.abc import Mapping

from eyechart.conditions import BATTERY
from eyechart.stats.statistic import Statistic
from eyechart.studies.battery import MARGIN, ModelScore
from eyechart.verdicts.paper import PAPER_ALPHA
from eyechart.verdicts.ruling import number, p_value


def findings(found: Mapping[str, Statistic], model: ModelScore, *, max_tokens: int) -> list[str]:
    """Return what there is to be pointed out of a model's answers, whatever its label; often nothing.

    ``max_tokens`` is the budget that its replies had. Source: paper, section The Input-Ablation Battery (refusal
    effect, noise floor), section Models (truncation) and section Edge models are image-invariant (image token).
    """
    return [
        *_cut(found, max_tokens),
        *_refusal(found, model),
        *_noise(found),
        *_image_token(found),
    ]


def _cut(found: Mapping[str, Statistic], max_tokens: int) -> list[str]:
    reasons = (found["unparsed_rate"].detail or {}).get("reasons")
    cut = reasons.get("truncated", 0) if isinstance(reasons, Mapping) else 0
    if not cut:
        return []
    calls = found["unparsed_rate"].n
    share = f"truncated: {cut} of {calls} replies ({cut / calls:.1%}) were cut off at the budget of {max_tokens} tokens"
    return [f"{share}; they count as failures, and nothing stands in their place; a larger budget may mend it"]


def _refusal(found: Mapping[str, Statistic], model: ModelScore) -> list[str]:
    """Point out answers that depend on the condition in outputs and not in decisions."""
    if found["refusal_effect"].value != 1.0:
        return []
    missing = {name: _without_decision(model, name) for name in BATTERY if name in model.answers.decisions}
    worst = max(missing, key=lambda name: missing[name][0] / max(missing[name][1], 1))
    if worst == "real" or "real" not in missing:
        return []
    name, symbol = ("cramers_v_real_blank", "V(real, blank)") if worst == "blank" else ("cramers_v", "V")
    tests = (found[name], found[f"{name}.decision"])
    outputs, decisions = (f"{symbol} = {number(one)}{_p(one)} over" for one in tests)
    counts = " and ".join(f"{missing[name][0]} of {missing[name][1]} to {name}" for name in (worst, "real"))
    says = f"{outputs} outputs, and {decisions} decisions; no decision in {counts}"
    return [f"refusal effect: what it is shown decides whether it answers, not what: {says}"]


def _without_decision(model: ModelScore, condition: str) -> tuple[int, int]:
    given = [one for one in model.answers.decisions[condition] if one is not None]
    return sum(one.action is None for one in given), len(given)


def _noise(found: Mapping[str, Statistic]) -> list[str]:
    """Point out a dependence that the paper's flag takes for noise; a model that never varies has none to flag."""
    floor, idi, association = found["noise_floor"], found["idi"], found["cramers_v"]
    if found["clears_floor"].value != 0.0 or not floor.value or not idi.value:
        return []
    looks = ""
    if association.p is not None and association.p < PAPER_ALPHA:
        looks = f", whatever Cramér's V says (V = {number(association)}{_p(association)})"
    repeats = f"it repeats its answer on {1 - floor.value:.0%} of identical pictures (s = {number(floor)})"
    flag = f"IDI = {number(idi)} is not above 1.5 s, and IDI_adj = {number(found['idi_adj'])}"
    says = "by the paper's flag, what depends on the picture is not told from its own noise"
    return [f"noise floor: {repeats}: {flag}: {says}{looks}"]


def _image_token(found: Mapping[str, Statistic]) -> list[str]:
    """Point out decisions that hang on whether there is a picture much more than on what it shows."""
    more = found["image_token.decision"]
    if more.value is None or more.ci is None or more.ci[0] <= MARGIN:
        return []
    grey, none = found["agree.blank.decision"], found["agree.text_only.decision"]
    agree = f"agree(blank) = {number(grey)} with agree(text_only) = {number(none)}"
    tested = f"difference {number(more)} [{more.ci[0]:.3f}, {more.ci[1]:.3f}], n = {more.n}{_p(more)}"
    return [f"image token: {agree}: that there is a picture matters more than what it shows ({tested})"]


def _p(one: Statistic) -> str:
    return "" if one.p is None else f", p = {p_value(one.p)}"
