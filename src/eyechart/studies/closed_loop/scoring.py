"""score() reads runs of episodes and makes no call: the same folders give the same numbers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from eyechart.episodes import Unfinished, every_episode, read_episodes, read_manifest, unfinished
from eyechart.studies.closed_loop.agreement import Replay, replays
from eyechart.studies.closed_loop.blind import Blind, blind_baselines
from eyechart.studies.closed_loop.degeneracy import Degeneracy, audit
from eyechart.studies.closed_loop.identical import SUSPECT, Twins, twins
from eyechart.studies.closed_loop.ladder import Outcomes, Paired, Rung, against, outcomes_of, reference_of, rung
from eyechart.studies.closed_loop.reading import Driver, Drives, names_of, read_drives
from eyechart.studies.closed_loop.wording import Repeats, repeated_requests

RESAMPLES = 5000
CHOSEN_HERE = (
    "the reference is the best constant of these same episodes, so that the differences lean to its side and the p are "
    "not exact; they are with a reference that is named beforehand, by --against"
)
"""What must be known of tests against a reference that the same data chose."""


@dataclass(frozen=True)
class ClosedLoopScore:
    """What runs of episodes show, each part computed when it is asked for, from the episodes alone.

    ``against_policy`` names the policy that the ladder holds the others against; None takes the best constant of
    each simulator.
    """

    drives: tuple[Drives, ...]
    against_policy: str | None = None
    resamples: int = RESAMPLES
    paths: tuple[Path, ...] = ()

    @cached_property
    def unfinished(self) -> Mapping[str, tuple[Unfinished, ...]]:
        """Return by run, where any is, the episodes without a record that its policies and worlds make together."""
        named = zip(self.paths, names_of(self.paths), strict=True)
        return {name: left for path, name in named if (left := unfinished_of(path))}

    @property
    def simulators(self) -> tuple[str, ...]:
        """Return the simulators that were driven, in the order in which they were met."""
        return tuple(dict.fromkeys(one.driver.simulator for one in self.drives))

    def of(self, simulator: str) -> tuple[Drives, ...]:
        """Return the drivers of one simulator."""
        return tuple(one for one in self.drives if one.driver.simulator == simulator)

    @cached_property
    def outcomes(self) -> Outcomes:
        """Return what counts as success in these worlds."""
        return outcomes_of(self.drives)

    @cached_property
    def ladder(self) -> tuple[Rung, ...]:
        """Return a row a driver."""
        return tuple(rung(one, self.outcomes, resamples=self.resamples) for one in self.drives)

    @cached_property
    def references(self) -> Mapping[str, Driver]:
        """Return by simulator the driver that the others are held against, where there is one."""
        found = {name: reference_of(self.of(name), self.against_policy) for name in self.simulators}
        return {name: one.driver for name, one in found.items() if one is not None}

    @property
    def caveat(self) -> str:
        """Return what must be known of the paired differences, nothing where the reference was named."""
        return CHOSEN_HERE if self.references and self.against_policy is None else ""

    @cached_property
    def paired(self) -> tuple[Paired, ...]:
        """Return every other driver less the reference of its simulator, Holm over one simulator's tests."""
        by_driver = {one.driver: one for one in self.drives}
        pairs = ((self.of(name), by_driver[driver]) for name, driver in self.references.items())
        return tuple(one for pair in pairs for one in against(*pair, self.outcomes, resamples=self.resamples))

    @cached_property
    def blind(self) -> tuple[Blind, ...]:
        """Return each policy as its own blind baseline."""
        return tuple(blind_baselines(self.drives, self.outcomes, resamples=self.resamples))

    @cached_property
    def audit(self) -> tuple[Degeneracy, ...]:
        """Return a row of the degeneracy audit a driver."""
        return tuple(audit(self.drives, resamples=self.resamples))

    @cached_property
    def replays(self) -> tuple[Replay, ...]:
        """Return each driver held against each scripted controller."""
        return tuple(found for one in self.drives for found in replays(one, resamples=self.resamples))

    @cached_property
    def twins(self) -> tuple[Twins, ...]:
        """Return the drivers with identical drives."""
        return tuple(twins(self.drives))

    @cached_property
    def repeats(self) -> tuple[Repeats, ...]:
        """Return what the repeated requests of each driver tell."""
        return tuple(found for one in self.drives if (found := repeated_requests(one)) is not None)

    @property
    def suspect(self) -> bool:
        """Return whether anything points to a cache."""
        return any(one.kind == SUSPECT for one in self.twins) or any(one.suspect for one in self.repeats)

    def as_dict(self) -> dict[str, object]:
        """Return every number as plain JSON values."""
        return {
            "study": "closed_loop",
            "references": {name: one.policy for name, one in self.references.items()},
            "references_chosen_on_these_data": self.against_policy is None,
            "ladder": [one.as_dict() for one in self.ladder],
            "paired": [one.as_dict() for one in self.paired],
            "blind": [one.as_dict() for one in self.blind],
            **self.audit_dict(),
            "unfinished": [{"run": run, **one.as_dict()} for run, left in self.unfinished.items() for one in left],
        }

    def audit_dict(self) -> dict[str, object]:
        """Return the audit's part as plain JSON values."""
        return {
            "audit": [one.as_dict() for one in self.audit],
            "replays": [one.as_dict() for one in self.replays],
            "identical": [one.as_dict() for one in self.twins],
            "repeated_requests": [one.as_dict() for one in self.repeats],
        }


def score(
    runs: Sequence[Path] | Path,
    *,
    against_policy: str | None = None,
    resamples: int = RESAMPLES,
) -> ClosedLoopScore:
    """Read one run of episodes or several; raises LedgerError where a folder is none or holds no episode."""
    paths = [runs] if isinstance(runs, Path) else list(runs)
    return ClosedLoopScore(read_drives(paths), against_policy, resamples, tuple(paths))


def unfinished_of(path: Path) -> tuple[Unfinished, ...]:
    """Return the episodes without a record that a run's policies and worlds make together, by policy, and why."""
    manifest = read_manifest(path)
    over = {one.key for one in read_episodes(path)}
    return tuple(unfinished(path, [key for key in every_episode(manifest) if key not in over], manifest.models))
