"""The paper's rules as we read them, and what it would point out: docs/decisions/battery.md."""

from collections import ChainMap
from collections.abc import Mapping
from dataclasses import replace

from eyechart.conditions import BATTERY
from eyechart.stats.association import Association
from eyechart.stats.statistic import Statistic
from eyechart.verdicts.evidence import DECIDED, Evidence
from eyechart.verdicts.labels import MARGIN, SWAP_RATE
from eyechart.verdicts.rules import Axis, NamedStatistics, Rule, compared, missing, p_below, p_from
from eyechart.verdicts.ruling import Ruling, and_p, figures, number

PAPER_ALPHA = 0.05
"""Below this p a test counts. The level is ours: the paper prints none. It calls .041 significant,
and .120 not."""
PAPER_UNPARSED = 0.20
"""Above this unparsed rate over all calls the rules do not score. The cut is ours: any in (.05,
.28) gives the five verdicts of Table t:frontier.
"""


_UNGRADED = "the gap tests cannot be passed"
_ALIKE = p_from("cramers_v.holm", PAPER_ALPHA)
_REFUSES = p_from("cramers_v.decision", PAPER_ALPHA)
_FARTHER = compared("gap_order", "value", "<=", 0.0)
_SWAPS = compared("mirror_swap_rate", "value", ">=", SWAP_RATE)
_FOLLOWS = tuple(p_below(name, PAPER_ALPHA) for name in ("obstacle.decision", "mutual_information.decision"))

PAPER = Axis(
    "paper",
    (
        Rule(
            "not_scorable",
            "unparsed_rate",
            (compared("unparsed_rate", "value", ">", PAPER_UNPARSED, untested=True),),
            f"more than {PAPER_UNPARSED} of all calls hold no decision",
        ),
        Rule(
            "not_scorable",
            "cramers_v",
            (compared("conditions_compared", "value", "<", 2.0),),
            "fewer than two conditions were asked: there is nothing to compare",
            quiet=True,
        ),
        Rule("image_invariant", "cramers_v", (_ALIKE,), "that its answer depends on the condition is not significant"),
        Rule(
            "refusal_effect",
            "cramers_v.decision",
            (_REFUSES,),
            "that its outputs depend on the condition is significant, that its decisions do is not",
        ),
        Rule(
            "self_inconsistent",
            "clears_floor",
            (compared("clears_floor", "value", "<", 1.0, untested=True),),
            "IDI {value:idi} is not above 1.5 s, s = {value:noise_floor}",
            quiet=True,
        ),
        *(
            Rule("presence_only", "gap_order", (clause,), _UNGRADED)
            for clause in (*(missing(clause.statistic) for clause in _FOLLOWS), missing("gap_order", "value"))
        ),
        Rule("presence_only", says="that its action follows the gap is not significant", broken=_FOLLOWS, worst=True),
        Rule("presence_only", "gap_order", (_FARTHER,), "it does not brake nearer than it proceeds"),
        Rule("depth_lateral", "mirror_swap_rate", (_SWAPS,), "directions are exchanged under reflection"),
        Rule("depth", "mutual_information.decision", says="the action follows the gap"),
    ),
)
"""The paper's labels, by its rules as we read them."""


def paper_rules(found: NamedStatistics, corrected: Mapping[str, float | None]) -> Ruling:
    """Return the paper's label; ``corrected`` holds the p of Cramér's V, corrected over the models.

    A refusal effect compares a model with itself, so that its decision level is not corrected.
    """
    whole = found["cramers_v"]
    facts = {
        "cramers_v.holm": replace(whole, p=corrected["cramers_v"]),
        "conditions_compared": Statistic(float(whole.groups if isinstance(whole, Association) else 0), whole.n),
    }
    return PAPER.evaluate(ChainMap(facts, found))  # type: ignore[arg-type]


def findings(evidence: Evidence) -> list[str]:
    """Return what the paper would point out of a model's answers, whatever its label.

    Source: paper, sections The Input-Ablation Battery (refusal effect, noise floor), Models
    (truncation) and Edge models are image-invariant (image token).
    """
    statistics = evidence.statistics
    return [*_cut(evidence), *_refusal(evidence), *_noise(statistics), *_image_token(statistics)]


def _cut(evidence: Evidence) -> list[str]:
    cut, calls = evidence.reasons(BATTERY).get("truncated", 0), evidence.statistics["unparsed_rate"].n
    if not cut:
        return []
    budget = f"the budget of {evidence.max_tokens} tokens" if evidence.max_tokens else "a budget that is not known"
    share = f"truncated: {cut} of {calls} replies ({cut / calls:.1%}) were cut off at {budget}"
    return [f"{share}; they count as failures, and nothing stands in their place; a larger budget may mend it"]


def _refusal(evidence: Evidence) -> list[str]:
    """Point out that outputs depend on the condition, and decisions do not."""
    found, calls = evidence.statistics, {name: sum(given.values()) for name, given in evidence.replies.items()}
    if found["refusal_effect"].value != 1.0:
        return []
    missing = {name: calls[name] - evidence.replies[name].get(DECIDED, 0) for name in BATTERY if name in calls}
    worst = max(missing, key=lambda name: missing[name] / max(calls[name], 1))
    if worst == "real" or "real" not in missing:
        return []
    name, symbol = ("cramers_v_real_blank", "V(real, blank)") if worst == "blank" else ("cramers_v", "V")
    tests = (found[name], found[f"{name}.decision"])
    outputs, decisions = (f"{symbol} = {number(test)}{and_p(test)} over" for test in tests)
    counts = " and ".join(f"{missing[name]} of {calls[name]} to {name}" for name in (worst, "real"))
    says = f"{outputs} outputs, and {decisions} decisions; no decision in {counts}"
    return [f"refusal effect: the picture decides whether it answers, not what it answers: {says}"]


def _noise(found: NamedStatistics) -> list[str]:
    """Point out a dependence that the paper's flag takes for noise."""
    floor, idi, association = found["noise_floor"], found["idi"], found["cramers_v"]
    if found["clears_floor"].value != 0.0 or not floor.value or not idi.value:
        return []
    says = "by the paper's flag, what depends on the picture is not told from its own noise"
    if association.p is not None and association.p < PAPER_ALPHA:
        says += f", whatever Cramér's V says (V = {number(association)}{and_p(association)})"
    repeats = f"it repeats its answer on {1 - floor.value:.0%} of identical pictures (s = {number(floor)})"
    flag = f"IDI = {number(idi)} is not above 1.5 s, and IDI_adj = {number(found['idi_adj'])}"
    return [f"noise floor: {repeats}: {flag}: {says}"]


def _image_token(found: NamedStatistics) -> list[str]:
    """Point out that a picture's presence decides much more than what it shows."""
    more = found["image_token.decision"]
    if more.value is None or more.ci is None or more.ci[0] <= MARGIN:
        return []
    grey, none = found["agree.blank.decision"], found["agree.text_only.decision"]
    agree = f"agree(blank) = {number(grey)} with agree(text_only) = {number(none)}"
    tested = f"difference {figures(more)}"
    return [f"image token: {agree}: that there is a picture matters more than what it shows ({tested})"]
