"""The checkpoints of a training side by side: how each channel's share changes, and when a policy stopped looking."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from eyechart.errors import SpecError
from eyechart.records import Plain, plain
from eyechart.report.table import STATISTIC as STATISTIC_COLUMNS
from eyechart.report.table import Column, Table, columns, statistic_cells
from eyechart.stats.resampling import holm
from eyechart.stats.statistic import Statistic
from eyechart.studies.policy.scoring import OnePolicy, PolicyScore, difference, judge
from eyechart.studies.policy.tables import mark
from eyechart.verdicts.channels import PolicyVerdict

ALPHA = 0.05
"""Level of the tests of difference, after Holm's correction over the channels of two policies."""


@dataclass(frozen=True)
class Checkpoint:
    """A policy of a run: how far its training had come (None where it does not say), and what is said of it."""

    policy: OnePolicy
    verdict: PolicyVerdict
    step: int | None

    @property
    def name(self) -> str:
        """Return what a sentence calls it."""
        return self.policy.model if self.step is None else f"{self.policy.model}, step {self.step}"

    @property
    def labels(self) -> dict[str, str]:
        """Return its labels by axis."""
        one = self.verdict
        cameras = {f"camera:{name}": judged.label for name, judged in one.cameras.items()}
        return {"camera": one.camera.label, **cameras, "state": one.state.label, "instruction": one.instruction.label}

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        shares = {
            name: {"T": one.value, "ci": plain(one.ci), "n": one.n} for name, one in self.verdict.channels.items()
        }
        head = {"policy": self.policy.model, "version": self.policy.version, "step": self.step}
        return {**head, **self.labels, "guards": list(self.verdict.guards), "channels": shares}


@dataclass(frozen=True)
class Change(Plain):
    """One checkpoint and the next: the labels that changed, and each channel's difference with its p after Holm."""

    before: str
    after: str
    labels: Mapping[str, tuple[str, str]]
    channels: Mapping[str, Statistic]
    holm: Mapping[str, float | None]

    @property
    def changed(self) -> tuple[str, ...]:
        """Return the channels whose share differs significantly, after correction."""
        return tuple(name for name, p in self.holm.items() if p is not None and p < ALPHA)


@dataclass(frozen=True)
class Course:
    """Checkpoints in their order, and what changed from each to the next."""

    checkpoints: tuple[Checkpoint, ...]
    changes: tuple[Change, ...]

    @property
    def replicated(self) -> bool:
        """Return whether no label changed and no share differs."""
        return not any(one.labels or one.changed for one in self.changes)

    def says(self) -> Iterator[str]:
        """Yield a sentence for each change, and when the pictures stopped or began to count."""
        for one in self.changes:
            labels = (f"{axis} {old}, then {new}" for axis, (old, new) in one.labels.items())
            shares = f"differs in {', '.join(one.changed)}" if one.changed else "no share differs (Holm)"
            yield f"{one.before} → {one.after}: {'; '.join([*labels, shares])}"
        ignores = [one.verdict.camera.label == "ignores_camera" for one in self.checkpoints]
        for (before, after), point in zip(pairwise(ignores), self.checkpoints[1:], strict=True):
            if before != after:
                yield f"from {point.name} on it {'ignores its cameras' if after else 'no longer ignores its cameras'}"

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        changes = [{**one.as_dict(), "changed": list(one.changed)} for one in self.changes]
        found = {"replicated": self.replicated, "policies": [one.as_dict() for one in self.checkpoints]}
        return {**found, "changes": changes, "says": list(self.says())}

    def printed(self) -> Iterator[Table | str]:
        """Yield the shares of every checkpoint, what changed, and sentences."""
        names = list(dict.fromkeys(name for one in self.checkpoints for name in one.verdict.channels))
        rows = [
            (
                one.policy.model,
                one.step,
                mark(one.labels["camera"]),
                *(one.verdict.channels.get(name) for name in names),
            )
            for one in self.checkpoints
        ]
        head = (Column("policy", "word"), Column("step", "count"), Column("camera", "word"))
        note = "the share of its own variation that goes with each channel; 98 % intervals"
        yield Table(
            "course", "each channel's share, in order", (*head, *columns("estimate", *names)), tuple(rows), note
        )
        yield Table(
            "changes",
            "how much larger each share is than before",
            (
                Column("from", "word"),
                Column("to", "word"),
                Column("channel", "word"),
                *STATISTIC_COLUMNS,
                Column("Holm", "p"),
            ),
            tuple(
                (one.before, one.after, name, *statistic_cells(apart), one.holm[name])
                for one in self.changes
                for name, apart in one.channels.items()
            ),
        )
        yield from self.says()


def course_of(scores: Sequence[PolicyScore]) -> Course:
    """Return the policies of runs on one bank in the order of their steps; as they were asked where one has none.

    Raises SpecError where there are fewer than two, or they were not asked about the same frames.
    """
    found = [one for score in scores for one in _checkpoints(score)]
    if len(found) < 2:
        raise SpecError("there is one policy, and nothing to compare it with; give a second run, or run several")
    first = found[0].policy.motions.plan
    for one in found[1:]:
        plan = one.policy.motions.plan
        same = plan.bank.manifest.fingerprint == first.bank.manifest.fingerprint
        if not same or [frame.id for frame in plan.frames] != [frame.id for frame in first.frames]:
            raise SpecError(f"{found[0].policy.model} and {one.policy.model} were not asked about the same frames")
    if all(one.step is not None for one in found):
        found.sort(key=lambda one: one.step or 0)
    return Course(tuple(found), tuple(_change(*two) for two in pairwise(found)))


def _checkpoints(score: PolicyScore) -> Iterator[Checkpoint]:
    verdicts = judge(score)
    for spec, one in score.models.items():
        step = score.manifest.facts.get(spec, {}).get("step")
        yield Checkpoint(one, verdicts[spec], int(step) if step is not None and step.isdecimal() else None)


def _change(before: Checkpoint, after: Checkpoint) -> Change:
    names = [name for name in before.verdict.channels if name in after.verdict.channels]
    scored = not (before.verdict.guards or after.verdict.guards)
    apart = {name: difference(before.policy, after.policy, name) for name in names if scored}
    labels = {
        axis: (old, after.labels[axis]) for axis, old in before.labels.items() if old != after.labels.get(axis, old)
    }
    corrected = dict(zip(apart, holm([one.p for one in apart.values()]), strict=True))
    return Change(before.name, after.name, labels, apart, corrected)
