"""A verdict puts the rulings of both sets of rules together, with what it may be trusted with and its scope."""

from collections.abc import Mapping
from dataclasses import dataclass

from eyechart.integrity import Guard
from eyechart.stats.exchange import episodes_needed
from eyechart.stats.statistic import Statistic
from eyechart.studies.battery import ALPHA, BatteryScore, ModelScore
from eyechart.verdicts.calibrated import POSITIVE_CLAIMS, TRUST, calibrated_rules
from eyechart.verdicts.lateral import lateral_rules
from eyechart.verdicts.paper import paper_rules
from eyechart.verdicts.ruling import Ruling, number


@dataclass(frozen=True)
class Verdict:
    """What a model's answers support under both sets of rules; the calibrated label is the headline.

    ``lateral`` is its own axis; ``evidence`` says how the question of distance was put: by intervention on the
    picture, by observation, or not at all. ``trust`` and ``scope`` are one sentence each. ``failed`` are the
    guards that say that the run itself is not to be believed; they mark the verdict wherever it is printed.
    """

    model: str
    paper: Ruling
    calibrated: Ruling
    lateral: Ruling
    evidence: str
    trust: str
    scope: str
    notes: tuple[str, ...]
    failed: tuple[Guard, ...] = ()

    @property
    def marks(self) -> tuple[str, ...]:
        """Return the guards that failed, in words: with one of them the verdict is not to be relied on."""
        return tuple(f"guard '{guard.name}' failed: {guard.because}" for guard in self.failed)

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
            "failed_guards": list(self.marks),
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
        failed=tuple(guard for guard in score.guards.get(model.model, ()) if guard.holds is False),
    )


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
        notes.append(f"{number(found['unparsed_rate'])} of the calls hold no decision: {reasons}")
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
