"""Compare the checkpoints of a training: the shares, and when a policy stopped looking."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from eyechart.errors import SpecError
from eyechart.manifest import RunManifest
from eyechart.records import JsonRecord, to_json_fields
from eyechart.report.table import STATISTIC as STATISTIC_COLUMNS
from eyechart.report.table import Column, Table, columns, statistic_cells
from eyechart.stats.resamples import holm
from eyechart.stats.statistic import Statistic
from eyechart.studies.policy.scores import PolicyResult, PolicyScore, difference, judge
from eyechart.studies.policy.tables import mark
from eyechart.verdicts.labels import CAMERA
from eyechart.verdicts.policy_verdict import PolicyVerdict
from eyechart.verdicts.share_predicates import is_used

ALPHA = 0.05
"""Level of the tests of difference, after Holm's correction over the channels of two policies."""
LEAST = 0.001
"""A smaller difference is rounding: it is in every frame, so no test takes it for chance."""

_STEP = re.compile(
    r"(?<![a-z])(?:step|checkpoint|ckpt|iteration|iter|epoch)s?[ _=:-]*(\d[\d_,]*)(k|m)?(?!\w|\.\d)", re.IGNORECASE
)
_THOUSANDS = {"": 1, "k": 1000, "m": 1_000_000}


@dataclass(frozen=True)
class TrainingCheckpoint:
    """A policy of a run, its verdict and its training step; None if it declares no step."""

    policy: PolicyResult
    verdict: PolicyVerdict
    step: int | None

    @property
    def name(self) -> str:
        """Return its name in sentences: the SPEC, with the step if there is one."""
        return self.policy.model if self.step is None else f"{self.policy.model}, step {self.step}"

    @property
    def labels(self) -> dict[str, str]:
        """Return its labels by axis."""
        one = self.verdict
        cameras = {f"camera:{name}": judged.label for name, judged in one.cameras.items()}
        return {"camera": one.camera.label, **cameras, "state": one.state.label, "instruction": one.instruction.label}

    @property
    def looks(self) -> bool | None:
        """Return whether its cameras count; None if a guard failed or no margin is passed."""
        if self.verdict.guards:
            return None
        if not (label := CAMERA[self.verdict.camera.label]).is_open:
            return not label.is_absence
        return True if is_used(self.verdict.channels.get("cameras")) else None

    @property
    def shares(self) -> Mapping[str, Statistic]:
        """Return the share of each channel; empty if a guard failed."""
        return {} if self.verdict.guards else self.verdict.channels

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        channels = self.verdict.channels.items()
        shares = {name: to_json_fields(channel, "ci n", T=channel.value) for name, channel in channels}
        head = {"policy": self.policy.model, "version": self.policy.version, "step": self.step}
        return {**head, **self.labels, "guards": list(self.verdict.guards), "channels": shares}


@dataclass(frozen=True)
class Change(JsonRecord):
    """The changes from one checkpoint to the next: labels, and shares with their p after Holm.

    If a guard failed for one of the two, no share is compared. ``failed`` names each failed guard
    and its policy.
    """

    before: str
    after: str
    labels: Mapping[str, tuple[str, str]]
    channels: Mapping[str, Statistic]
    holm: Mapping[str, float | None]
    failed: tuple[str, ...] = ()

    @property
    def changed(self) -> tuple[str, ...]:
        """Return the channels whose share differs significantly and by more than rounding."""
        return tuple(name for name, p in self.holm.items() if p is not None and p < ALPHA and self._differs(name))

    def _differs(self, name: str) -> bool:
        value = self.channels[name].value
        return value is not None and abs(value) >= LEAST

    def says(self) -> str:
        """Return the changes in a sentence, or why there was no comparison."""
        if self.failed:
            return f"not compared: {'; '.join(self.failed)}"
        labels = (f"{axis} {old}, then {new}" for axis, (old, new) in self.labels.items())
        shares = f"differs in {', '.join(self.changed)}" if self.changed else "no share differs (Holm)"
        return "; ".join([*labels, shares])


@dataclass(frozen=True)
class TrainingCurve:
    """Checkpoints in order, the pairs of them that are compared, and the changes in each pair."""

    checkpoints: tuple[TrainingCheckpoint, ...]
    compared: tuple[tuple[TrainingCheckpoint, TrainingCheckpoint], ...]
    changes: tuple[Change, ...]

    @property
    def is_replicated(self) -> bool:
        """Return whether no label changed and no share differs."""
        return not any(change.labels or change.changed for change in self.changes)

    def says(self) -> Iterator[str]:
        """Yield a sentence for each change, and for a start or stop of looking."""
        for change in self.changes:
            yield f"{change.before} → {change.after}: {change.says()}"
        for pair in self.compared if self.is_stepped else ():
            before, after = (one.looks for one in pair)
            if None not in (before, after) and before != after:
                yield f"from {pair[1].name} on it {'no longer ignores its cameras' if after else 'ignores its cameras'}"

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        changes = [{**change.as_dict(), "changed": list(change.changed)} for change in self.changes]
        found = {
            "replicated": self.is_replicated,
            "policies": [checkpoint.as_dict() for checkpoint in self.checkpoints],
        }
        return {**found, "changes": changes, "says": list(self.says())}

    @property
    def is_stepped(self) -> bool:
        """Return whether every policy has a step, and not all the same one."""
        return None not in (steps := {checkpoint.step for checkpoint in self.checkpoints}) and len(steps) > 1

    @property
    def channels(self) -> tuple[str, ...]:
        """Return the channels for which any policy has a share."""
        return tuple(dict.fromkeys(name for checkpoint in self.checkpoints for name in checkpoint.shares))

    def tables(self) -> list[Table]:
        """Return the tables of shares by checkpoint, and of changes between checkpoints."""
        rows = [
            (
                checkpoint.policy.model,
                checkpoint.step,
                mark(", ".join(checkpoint.verdict.guards) or checkpoint.labels["camera"]),
                *(checkpoint.shares.get(name) for name in self.channels),
            )
            for checkpoint in self.checkpoints
        ]
        head = (Column("policy", "word"), Column("step", "count"), Column("camera", "word"))
        shares = columns("estimate", *self.channels)
        note = "the share of a policy's own variation that goes with each channel; 98 % intervals"
        named = (*(Column(name, "word") for name in ("from", "to", "channel")), *STATISTIC_COLUMNS, Column("Holm", "p"))
        changed = tuple(
            (change.before, change.after, name, *statistic_cells(apart), change.holm[name])
            for change in self.changes
            for name, apart in change.channels.items()
        )
        return [
            Table("course", "each channel's share, in order", (*head, *shares), tuple(rows), note),
            Table("changes", "how much larger each share is than before", named, changed),
        ]

    def printed(self) -> Iterator[Table | str]:
        """Yield the tables, then the sentences."""
        yield from self.tables()
        yield from self.says()


def course_of(scores: Sequence[PolicyScore], given: Mapping[str, int] | None = None) -> TrainingCurve:
    """Return the checkpoints of runs on one bank, in the order of their steps.

    Without a step for each, they keep the order of the runs. If all runs have the same policies, as
    in a replication, each policy is compared with itself. A step is ``given`` by SPEC, else
    declared (``step``), else read from the policy's version ("step 20000", "checkpoint-020000",
    "ckpt_20k"). Raises SpecError for fewer than two policies, for runs on different frames, or for
    a step of an unknown policy.
    """
    checkpoints = [checkpoint for score in scores for checkpoint in _checkpoints(score, given or {})]
    models = {checkpoint.policy.model for checkpoint in checkpoints}
    if unknown := [spec for spec in given or {} if spec not in models]:
        raise SpecError(f"--step names '{unknown[0]}', but the policies of these runs are {', '.join(sorted(models))}")
    if len(checkpoints) < 2:
        raise SpecError("there is one policy, and nothing to compare it with; give a second run, or run several")
    _require_same_frames(checkpoints)
    compared = tuple(_compared(checkpoints, [list(score.models) for score in scores]))
    return TrainingCurve(tuple(checkpoints), compared, tuple(_change(*two) for two in compared))


def _compared(
    checkpoints: list[TrainingCheckpoint], specs: Sequence[list[str]]
) -> Iterator[tuple[TrainingCheckpoint, TrainingCheckpoint]]:
    """Sort the policies, and yield the pairs to compare; ``specs`` are those of each run."""
    again = len(specs) > 1 and all(sorted(spec) == sorted(specs[0]) for spec in specs)
    if all(checkpoint.step is not None for checkpoint in checkpoints):
        checkpoints.sort(key=lambda checkpoint: checkpoint.step or 0)
        again = False
    elif again:
        checkpoints.sort(key=lambda checkpoint: specs[0].index(checkpoint.policy.model))
    for one, other in pairwise(checkpoints):
        if not again or one.policy.model == other.policy.model:
            yield one, other


def _require_same_frames(checkpoints: Sequence[TrainingCheckpoint]) -> None:
    """Raise SpecError if the policies have different frames or different definitions of a motion.

    Two banks with one fingerprint may define motions differently, as after imports with two
    ``--kind``.
    """
    first = checkpoints[0].policy.motions.plan
    for checkpoint in checkpoints[1:]:
        plan, two = checkpoint.policy.motions.plan, f"{checkpoints[0].policy.model} and {checkpoint.policy.model}"
        same = plan.bank.manifest.fingerprint == first.bank.manifest.fingerprint
        if not same or [frame.id for frame in plan.frames] != [frame.id for frame in first.frames]:
            banks = "" if same else f": their banks are {first.bank.name} and {plan.bank.name}"
            raise SpecError(f"{two} have different frames{banks}; compare runs on one bank with one --limit")
        spaces = first.bank.manifest.motion, plan.bank.manifest.motion
        if None not in spaces and (apart := spaces[0].apart(spaces[1])):  # type: ignore[union-attr,arg-type]
            said = "; ".join(f"{name}: {mine} and {theirs}" for name, (mine, theirs) in apart.items())
            raise SpecError(f"{two} answer with different motions, which cannot be compared: {said}; use one bank")


def training_of(scores: Sequence[PolicyScore], given: Mapping[str, int]) -> TrainingCurve | None:
    """Return the course of a report's policies if they are checkpoints of one training, else None.

    They are checkpoints if each has a step and all have the same frames. Raises SpecError if steps
    are ``given`` and they are not.
    """
    try:
        curve = course_of(scores, given)
    except SpecError:
        if given:
            raise
        return None
    if given and not curve.is_stepped:
        without = [checkpoint.policy.model for checkpoint in curve.checkpoints if checkpoint.step is None]
        lacking = f"{', '.join(without)} has no step" if without else "all policies have the same step"
        raise SpecError(f"--step gives no order, since {lacking}; give --step SPEC=N for each")
    return curve if curve.is_stepped else None


def step_of(manifest: RunManifest, spec: str, given: Mapping[str, int]) -> int | None:
    """Return a policy's training step: as given, else as declared, else as its version says."""
    facts, version = manifest.facts.get(spec, {}), manifest.models[spec]
    if spec in given:
        return given[spec]
    if (said := facts.get("step", "")).isdecimal():
        return int(said)
    if (read := _STEP.search(version)) is None:
        return None
    number, thousands = read.groups("")
    return int(re.sub("[_,]", "", number)) * _THOUSANDS[thousands.lower()]


def _checkpoints(score: PolicyScore, given: Mapping[str, int]) -> Iterator[TrainingCheckpoint]:
    verdicts = judge(score)
    for spec, model in score.models.items():
        yield TrainingCheckpoint(model, verdicts[spec], step_of(score.manifest, spec, given))


def _change(before: TrainingCheckpoint, after: TrainingCheckpoint) -> Change:
    names = [name for name in before.verdict.channels if name in after.verdict.channels]
    failed = [f"guard {', '.join(one.verdict.guards)} of {one.name}" for one in (before, after) if one.verdict.guards]
    apart = {name: difference(before.policy, after.policy, name) for name in names if not failed}
    labels = {
        axis: (old, after.labels[axis]) for axis, old in before.labels.items() if old != after.labels.get(axis, old)
    }
    if before.verdict.guards.keys() != after.verdict.guards.keys():
        labels["guards"] = ", ".join(before.verdict.guards), ", ".join(after.verdict.guards)
    corrected = dict(zip(apart, holm([one.p for one in apart.values()]), strict=True))
    return Change(before.name, after.name, labels, apart, corrected, tuple(failed))
