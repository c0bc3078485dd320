"""Scoring: from a ledger of motions to each policy's statistics; it only reads."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from eyechart.channels import CAMERA, CAMERAS, channels_of
from eyechart.costs import Account
from eyechart.errors import LedgerError
from eyechart.frames import FrameBank
from eyechart.integrity import Guard
from eyechart.ledger import Attempts, Ledger
from eyechart.manifest import LEDGER, RunManifest, read_run
from eyechart.models import states
from eyechart.models.prices import Prices, read_prices
from eyechart.records import to_json_fields
from eyechart.run import MotionPlan
from eyechart.spaces.motion import MOTION_READER
from eyechart.stats.statistic import ModelStatistics, Statistic, not_available
from eyechart.stats.total_effect import share_difference
from eyechart.studies.battery import require_requests, taken
from eyechart.studies.policy.effects import Effects, statistics_of
from eyechart.studies.policy.motions import Motions, read_motions
from eyechart.studies.policy.plans import STUDY, drawers, is_seeded, motions_of, shown_conditions
from eyechart.verdicts.policy_verdict import PolicyVerdict, judge_policy, not_arrived
from eyechart.verdicts.share_predicates import MissingConditions

_GUARDS = frozenset({"outcomes", "geometry", "served"})
_OF_SERVERS = ("picture", "cache", "load", "truncation", "shown")
"""Guards of models that state their motions in words, which are asked as any served model is."""
_ON_THE_WAY = frozenset({"picture", "cache", "load"})
"""Guards whose failure is a fault of the way to the model, so that no channel can be judged."""

CallAccounts = tuple[dict[str, dict[str, Account]], dict[str, tuple[Guard, ...]]]


@dataclass(frozen=True)
class PolicyResult:
    """One policy: its statistics by name, its answers, and whether it draws them."""

    model: str
    version: str
    motions: Motions
    drawn: bool
    statistics: Mapping[str, Statistic]

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        calls = to_json_fields(self.motions, "planned missing")
        return to_json_fields(self, "version answered drawn statistics") | calls

    @property
    def answered(self) -> int:
        """Return how many calls are finished."""
        return self.motions.finished


@dataclass(frozen=True)
class PolicyScore:
    """Every policy of a run, and the costs of its calls."""

    manifest: RunManifest
    bank: FrameBank
    models: Mapping[str, PolicyResult]
    accounting: Mapping[str, Mapping[str, Account]]
    guards: Mapping[str, tuple[Guard, ...]]

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        space = self.manifest.prompt.space
        run = to_json_fields(self.manifest, "study fingerprint seed", reader=space and space.reader)
        own = to_json_fields(self, "channels accounting guards", policies=self.models)
        return {**run, "bank": self.bank.name, **own}

    @property
    def channels(self) -> tuple[str, ...]:
        """Return the channels of the bank."""
        return channels_of(self.bank)

    def measured(self) -> tuple[ModelStatistics, ...]:
        """Return the statistics of every policy on the bank."""
        short = {
            spec: f"{model.answered} of {model.motions.planned} calls"
            for spec, model in self.models.items()
            if model.answered < model.motions.planned
        }
        return tuple(
            ModelStatistics(spec, self.bank.name, model.statistics, short.get(spec, ""))
            for spec, model in self.models.items()
        )

    def scope(self, spec: str) -> str:
        """Return what limits the verdict on a policy, in words."""
        one = self.models[spec]
        frames = one.motions.plan.frames
        episodes = len({frame.drive for frame in frames})
        where = f"On these {episodes} episodes ({len(frames)} frames) of {self.bank.name}, {self.bank.manifest.picture}"
        prompt, others = (f" with prompt {self.manifest.prompt.key}", "other prompts, ") if states(spec) else ("", "")
        return (
            f"{where}, {spec}@{one.version}{prompt} on {self.manifest.created}; not tested: {others}other data, closed "
            "loop, and what only few episodes would show. Intervals are of 98 %."
        )


def score(path: Path, *, reread: bool = False) -> PolicyScore:
    """Score the run of policies in a folder, finished or not.

    Raises LedgerError or BankError if the folder is no such run. LedgerError also for a run begun
    under another version of the reader, unless ``reread`` is set.
    """
    manifest, bank = read_run(path)
    require_scorable(path, manifest, reread=reread)
    return score_run(manifest, bank, path / LEDGER, held=True)


def require_scorable(path: Path, manifest: RunManifest, *, reread: bool = False) -> None:
    """Raise LedgerError if a run is not one of policies, or its reader has another version."""
    if manifest.study != STUDY:
        raise LedgerError(
            f"{path} is a run of the study '{manifest.study}', not of policies: use 'eyechart score {path}', "
            "or eyechart.api.read_report of a battery from Python"
        )
    manifest.require_reader(path, (MOTION_READER,), reread=reread)


def score_run(manifest: RunManifest, bank: FrameBank, ledger_path: Path, *, held: bool = False) -> PolicyScore:
    """Score the calls of a ledger by a run's manifest and its bank.

    With ``held``, a call whose request differs from the run's raises LedgerError.
    """
    results: dict[str, PolicyResult] = {}
    with Ledger(ledger_path) as ledger:
        plan = drawn_of(ledger, manifest, bank)
        attempts = ledger.columns(plan.read, by_frame=False)
        if held:
            require_requests(ledger_path, attempts, manifest, plan)
        for spec, version in manifest.models.items():
            drawn = spec in plan.drawn
            order = [sent.key for sent in ledger.attempts(spec)] if drawn else []
            motions = read_motions(ledger.replies(spec), plan, spec, order)
            statistics = statistics_of(motions, drawn=drawn, seeded=is_seeded(manifest, spec) and not drawn)
            results[spec] = PolicyResult(spec, version, motions, drawn, statistics)
    accounting, guards = _took(attempts, manifest, plan, read_prices())
    return PolicyScore(manifest, bank, results, accounting, guards)


def judge(found: PolicyScore) -> dict[str, PolicyVerdict]:
    """Return the verdict on every policy of a run."""
    supplied, lacking = shown_conditions(found.bank, found.manifest.prompt, reading=False)
    unasked = MissingConditions(
        frozenset(supplied) - frozenset(found.manifest.conditions), lacking, found.manifest.bank_path
    )
    verdicts = {
        spec: judge_policy(
            spec,
            model.statistics,
            found.channels,
            scope=found.scope(spec),
            missing=model.motions.judged()[0],
            left=model.motions.planned - model.motions.finished,
            reads=tuple(filter(None, found.manifest.facts.get(spec, {}).get("channels", "").split(", "))),
            left_out=replace(unasked, failing=model.motions.fails_on),
        )
        for spec, model in found.models.items()
    }
    return {spec: _as_it_arrived(one, found.guards.get(spec, ())) for spec, one in verdicts.items()}


def _as_it_arrived(verdict: PolicyVerdict, guards: Sequence[Guard]) -> PolicyVerdict:
    """Return a verdict as far as the guards of the way to a model allow it.

    Answers that follow the run's own pictures prove that these arrived, whatever a probe saw.
    """
    failed = {one.name: one.because for one in guards if one.name in _ON_THE_WAY and one.holds is False}
    if verdict.answer in {"Yes", "In part"} and (why := failed.pop("picture", "")):
        remark = f"its answers follow its pictures here, although guard 'picture' failed: {why}"
        verdict = replace(verdict, remarks=(*verdict.remarks, remark))
    return not_arrived(verdict, failed) if failed else verdict


def judged_json(found: PolicyScore) -> dict[str, dict[str, object]]:
    """Return the verdict on every policy as plain JSON values, with each camera by its name.

    With a single camera, its entry repeats the one of all cameras.
    """
    said = {spec: one.as_dict() for spec, one in judge(found).items()}
    names = [camera.name for camera in found.bank.frames[0].cameras]
    for one in said.values() if len(names) == 1 else ():
        own = f"{CAMERA}{names[0]}"
        one["cameras"] = {names[0]: one["camera"]}
        for key, whole in (("channels", CAMERAS), ("axes", "camera")):
            every = one[key]
            assert isinstance(every, dict)
            one[key] = every | ({own: every[whole]} if whole in every else {})
    return said


def drawn_of(ledger: Ledger, manifest: RunManifest, bank: FrameBank) -> MotionPlan:
    """Return a run's plan with the policies that its ledger shows to draw their answers."""
    return replace(motions_of(manifest, bank), drawn=drawers(ledger, manifest))


def took(path: Path, prices: Prices) -> CallAccounts:
    """Return every policy's costs and guards, without the statistics."""
    manifest, bank = read_run(path)
    with Ledger(path / LEDGER) as ledger:
        plan = drawn_of(ledger, manifest, bank)
        return _took(ledger.columns(plan.read, by_frame=False), manifest, plan, prices)


def _took(attempts: Attempts, manifest: RunManifest, plan: MotionPlan, prices: Prices) -> CallAccounts:
    spent, kept = taken(attempts, manifest, plan, prices)
    return spent, {
        spec: tuple(one for one in many if one.name in _GUARDS or (states(spec) and one.name in _OF_SERVERS))
        for spec, many in kept.items()
    }


def difference(first: PolicyResult, second: PolicyResult, channel: str) -> Statistic:
    """Return how much larger a channel's share is for the second policy, on the same frames."""
    found = [Effects(one.motions, drawn=one.drawn).pairs(f"swapped@{channel}") for one in (first, second)]
    less, more = found
    if isinstance(less, str) or isinstance(more, str):
        return not_available(next(one for one in found if isinstance(one, str)))
    return share_difference(less, more)
