"""A verdict is the claim that the evidence supports; every rule names the statistic that decided it.

Two sets of rules stand side by side: the paper's, as we read them, and the calibrated ones, which hold their
error rate and say ``undecided`` rather than accept a null. Both are declared in
docs/decisions/0006-two-sets-of-rules.md.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from eyechart.actions import ActionSpace
from eyechart.stats.agreement import trials_needed
from eyechart.stats.exchange import episodes_needed
from eyechart.stats.paired import pairs_to_bound
from eyechart.stats.resampling import holm
from eyechart.stats.statistic import Statistic
from eyechart.studies.battery import ALPHA, MARGIN, BatteryScore, ModelScore

PAPER_ALPHA = 0.05
PAPER_UNPARSED = 0.20
"""Above this unparsed rate over all calls the paper's rules do not score. The paper prints no cut: any in
(.05, .28) gives the five verdicts of Table t:frontier."""
SWAP_RATE = 0.5
UNPARSED = 0.05
FLOOR = 0.2
"""``self_inconsistent`` needs a lower bound of s above this and a kappa of real against real_repeat below it."""

POSITIVE_CLAIMS = 6
"""depth, self_inconsistent, content (Holm over two tests), scene_cue, presence_only, refusal_effect."""

CALIBRATED_LABELS = (
    "not_scorable",
    "depth_lateral",
    "depth",
    "self_inconsistent",
    "content",
    "scene_cue",
    "presence_only",
    "refusal_effect",
    "image_invariant",
    "undecided",
)
PAPER_LABELS = (
    "not_scorable",
    "refusal_effect",
    "image_invariant",
    "self_inconsistent",
    "presence_only",
    "depth",
    "depth_lateral",
)

TRUST: dict[str, str] = {
    "not_scorable": "It may be trusted with nothing: too few of its replies hold a decision.",
    "depth_lateral": "It may be tried as a longitudinal and lateral advisor: its braking follows distance and its "
    "turns follow the side.",
    "depth": "It may be tried as a longitudinal hazard monitor; no lateral authority has been earned.",
    "self_inconsistent": "It may be trusted with nothing: it does not repeat its own answer to the same picture.",
    "content": "It uses the picture, but its braking does not follow distance as it must: no authority over motion.",
    "scene_cue": "It recognises the kind of scene, not this picture: no authority over motion.",
    "presence_only": "It notices whether there is a picture, not what is in it: no authority over motion.",
    "refusal_effect": "It only refuses some non-pictures; its decisions do not come from the camera.",
    "image_invariant": "Its decisions do not come from the camera: no authority that needs one.",
    "undecided": "This evidence supports no claim; more frames or episodes are needed.",
}


@dataclass(frozen=True, slots=True)
class Ruling:
    """A label with the name of the statistic that decided it, and the reason in words."""

    label: str
    decided_by: str
    because: str


@dataclass(frozen=True)
class Verdict:
    """What a model's answers support under both sets of rules; the calibrated label is the headline.

    ``lateral`` is its own axis; ``evidence`` says how the question of distance was put: by intervention on the
    picture, by observation, or not at all. ``trust`` and ``scope`` are one sentence each.
    """

    model: str
    paper: Ruling
    calibrated: Ruling
    lateral: Ruling
    evidence: str
    trust: str
    scope: str
    notes: tuple[str, ...]

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values; labels under the names that scripts rely on."""
        return {
            "paper": self.paper.label,
            "calibrated": self.calibrated.label,
            "lateral": self.lateral.label,
            "evidence": self.evidence,
            "because": self.calibrated.because,
            "decided_by": self.calibrated.decided_by,
            "paper_because": self.paper.because,
            "paper_decided_by": self.paper.decided_by,
            "lateral_because": self.lateral.because,
            "trust": self.trust,
            "scope": self.scope,
            "notes": list(self.notes),
        }


def judge(score: BatteryScore) -> dict[str, Verdict]:
    """Return the verdict of every model of a scored battery."""
    return {spec: _judge_one(score, model) for spec, model in score.models.items()}


def _judge_one(score: BatteryScore, model: ModelScore) -> Verdict:
    found, space = model.statistics, score.bank.manifest.action_space
    lateral = lateral_rules(found, model, space)
    calibrated, evidence = calibrated_rules(found, swaps=lateral.label == "swaps")
    return Verdict(
        model=model.model,
        paper=paper_rules(found, model.holm),
        calibrated=calibrated,
        lateral=lateral,
        evidence=evidence,
        trust=TRUST[calibrated.label],
        scope=scope(score, model),
        notes=_notes(found, model),
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
        return _ruling("not_scorable", "unparsed_rate", unparsed, f"above {PAPER_UNPARSED}")
    response, decision = corrected["cramers_v"], found["cramers_v.decision"]
    if len(_asked(found["cramers_v"])) < 2:
        return Ruling("not_scorable", "cramers_v", "fewer than two conditions were asked: there is nothing to compare")
    if response is None or response >= PAPER_ALPHA:
        return _ruling("image_invariant", "cramers_v", found["cramers_v"], "no answer depends on the condition")
    if decision.p is None or decision.p >= PAPER_ALPHA:
        return _ruling("refusal_effect", "cramers_v.decision", decision, "only outputs differ")
    if found["clears_floor"].value != 1.0:
        idi, floor = found["idi"], found["noise_floor"]
        return Ruling(
            "self_inconsistent", "clears_floor", f"IDI {_number(idi)} is not above 1.5 s, s = {_number(floor)}"
        )
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
        return _ruling("presence_only", "gap_order", found["gap_order"], "the gap tests cannot be passed")
    if obstacle >= PAPER_ALPHA or information >= PAPER_ALPHA:
        name = "obstacle.decision" if obstacle >= information else "mutual_information.decision"
        return _ruling("presence_only", name, found[name], "the action does not follow the gap")
    if order <= 0:
        return _ruling("presence_only", "gap_order", found["gap_order"], "it does not brake nearer than it proceeds")
    return None


def _paper_depth(found: Mapping[str, Statistic]) -> Ruling:
    swap, information = found["mirror_swap_rate"], found["mutual_information.decision"]
    if swap.value is not None and swap.value >= SWAP_RATE:
        return _ruling("depth_lateral", "mirror_swap_rate", swap, "directions are exchanged under reflection")
    return _ruling("depth", "mutual_information.decision", information, "the action follows the gap")


def calibrated_rules(found: Mapping[str, Statistic], *, swaps: bool) -> tuple[Ruling, str]:
    """Return the calibrated label and how the question of distance was put (interventional, observational, none)."""
    name, evidence = _depth_test(found)
    unparsed, depth = found["unparsed_reference"], found[name]
    if unparsed.value is None:
        return Ruling("undecided", "unparsed_reference", "no call with the real picture has come back"), evidence
    if unparsed.value > UNPARSED:
        return _ruling("not_scorable", "unparsed_reference", unparsed, f"above {UNPARSED}"), evidence
    if depth.p is not None and depth.p < ALPHA:
        label = "depth_lateral" if swaps else "depth"
        return _ruling(label, name, depth, "it brakes harder where the lead is nearer"), evidence
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
    words = f"it disagrees with itself on the same picture (s = {_number(differs)}), about as often as chance would"
    return _ruling("self_inconsistent", "kappa_pooled", pooled, words)


def _content(found: Mapping[str, Statistic]) -> Ruling | None:
    names = ("content_shuffled", "content_recoloured")
    for name, p in zip(names, holm([found[name].p for name in names]), strict=True):
        if p is not None and p < ALPHA:
            what = (
                "another frame of the scenario" if name == "content_shuffled" else "only the paint of the own vehicle"
            )
            return _ruling("content", name, found[name], f"{what} changes its answer more than a repeat does")
    return None


def _scene_cue(found: Mapping[str, Statistic]) -> Ruling | None:
    cue = found["scene_cue"]
    if cue.p is None or cue.p >= ALPHA:
        return None
    return _ruling("scene_cue", "scene_cue", cue, "another scenario changes its answer more than another frame does")


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
    return _ruling("presence_only", "presence", presence, words)


def _refusal(found: Mapping[str, Statistic]) -> Ruling | None:
    response, decision = found["presence_response"], found["presence"]
    if response.p is None or response.p >= ALPHA or (decision.p is not None and decision.p < ALPHA):
        return None
    if not _bounds(found):
        return None
    return _ruling(
        "refusal_effect", "presence_response", response, "real and blank differ in outputs, not in decisions"
    )


def _invariant(found: Mapping[str, Statistic]) -> Ruling | None:
    blank = found["bound_blank"]
    if blank.p is None or blank.p >= ALPHA or not _bounds(found):
        return None
    words = f"the effects of a blank picture and of content are both below {MARGIN}"
    return _ruling("image_invariant", "bound_blank", blank, words)


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
    return _ruling("undecided", f"bound_{name}", bound, words)


def lateral_rules(found: Mapping[str, Statistic], model: ModelScore, space: ActionSpace) -> Ruling:
    """Return the lateral label: whether LEFT and RIGHT are exchanged under reflection, if that can be told."""
    swap, name = found["mirror_swap_rate"], "mirror_swap_rate"
    if swap.detail is None:
        return Ruling("not_tested", name, swap.note)
    seen = _directions(model, space)
    if sum(seen.values()) >= 8 and sum(count > 0 for count in seen.values()) == 1:
        only = next(direction for direction, count in seen.items() if count)
        return _ruling("one_sided", name, swap, f"{only} is the only direction it ever gives, mirrored or not")
    if swap.value is None or swap.ci is None or swap.p is None:
        need = trials_needed(0.65, 0.5, alpha=ALPHA)
        return Ruling("no_power", name, f"no directional decision; up to {need} are needed")
    chance = float(str(swap.detail["chance"]))
    both = all(count > 0 for count in seen.values())
    if both and swap.value >= SWAP_RATE and swap.ci[0] > chance and swap.p < ALPHA:
        return _ruling("swaps", name, swap, f"directions are exchanged, chance is {chance:.2f}")
    if swap.ci[1] < SWAP_RATE:
        return _ruling("does_not_swap", name, swap, f"directions are exchanged in less than {SWAP_RATE} of the cases")
    need = trials_needed(0.65, min(chance, 0.5), alpha=ALPHA)
    return _ruling("no_power", name, swap, f"{need} directional decisions would tell a rate of .65 from chance")


def _directions(model: ModelScore, space: ActionSpace) -> dict[str, int]:
    given = [*model.answers.actions("real"), *model.answers.actions("mirrored")]
    return {direction: sum(one == direction for one in given) for direction in space.directional}


def _ruling(label: str, name: str, statistic: Statistic, words: str) -> Ruling:
    interval = "" if statistic.ci is None else f" [{statistic.ci[0]:.3f}, {statistic.ci[1]:.3f}]"
    p = "" if statistic.p is None else f", p = {_p(statistic.p)}"
    return Ruling(label, name, f"{words}: {name} = {_number(statistic)}{interval}, n = {statistic.n}{p}")


def _number(statistic: Statistic) -> str:
    return "—" if statistic.value is None else f"{statistic.value:.3f}"


def _p(p: float) -> str:
    return f"{p:.1e}" if p < 0.0001 else f"{p:.4f}"


def scope(score: BatteryScore, model: ModelScore | None = None) -> str:
    """Return the sentence that bounds a verdict: bank, picture, episodes, model, prompt, date, what was not tested."""
    bank, run = score.bank, score.manifest
    frames = model.answers.frames if model else next(iter(score.models.values())).answers.frames
    episodes = _count(len({frame.episode for frame in frames}), "episode")
    if "episode" in bank.manifest.absent:
        episodes = "declared independent" if bank.manifest.independent else "no episodes recorded"
    who = f"{model.model}@{model.version}" if model else "each model"
    size = f"{_count(len(frames), 'frame')}, {episodes}"
    return (
        f"On bank {bank.name} ({bank.manifest.picture}; {size}), {who} with prompt {run.prompt.key} on {run.created}; "
        "not tested: other prompts, other cameras, closed loop."
    )


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _notes(found: Mapping[str, Statistic], model: ModelScore) -> tuple[str, ...]:
    notes = []
    if model.answered < model.planned:
        notes.append(f"partial: {model.answered} of {model.planned} planned calls are finished")
    if (found["unparsed_rate"].value or 0.0) > 0.0:
        reasons = (found["unparsed_rate"].detail or {}).get("reasons", {})
        notes.append(f"{_number(found['unparsed_rate'])} of the calls hold no decision: {reasons}")
    refused = sum(
        one is not None and one.missing == "refused"
        for condition in ("blank", "noise", "text_only")
        for one in model.answers.decisions.get(condition, ())
    )
    if refused:
        notes.append(f"it refused {refused} non-pictures (blank, noise or text only)")
    if found["depth_interventional"].p is None and found["depth_observational"].p is None:
        notes.append(f"whether it follows the gap was not tested: {found['depth_observational'].note}")
        if model.answers.gap is not None:
            strata = len({frame.scenario for frame in model.answers.frames})
            need = episodes_needed(strata, alpha=ALPHA)
            notes.append(f"{need} episodes in each scenario, or counterfactual pictures, would test it")
    if found["bound_scene"].p is None:
        notes.append("whether a picture of another scenario changes its answer was not tested")
    most = POSITIVE_CLAIMS * ALPHA
    notes.append(
        f"up to {POSITIVE_CLAIMS} positive claims are tested in order, each at alpha {ALPHA}: a false one has a chance "
        f"of at most {most:.2f}, which adds up over the models and prompts that are tried on one bank"
    )
    return tuple(notes)
