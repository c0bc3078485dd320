"""Drives as a study, scored without calls (same folders, same numbers), and its shared base."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from eyechart import episodes
from eyechart.calls import read_in
from eyechart.costs import accounts_of
from eyechart.episodes import UnfinishedEpisodes, every_episode, read_episodes, read_manifest, unfinished
from eyechart.integrity import ServedChecks, ServedGuard
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER, EpisodesManifest
from eyechart.models.prices import Prices
from eyechart.records import to_json_fields
from eyechart.spaces.space import AnySpace
from eyechart.stats.statistic import ModelStatistics
from eyechart.studies import NO_VERDICT, ModelSummary, ReadOptions, RunCosts, S, Study, StudyReport, Tell, is_episodes
from eyechart.studies.closed_loop.audit import Degeneracy, ReplayComparison, audit, measured, replays
from eyechart.studies.closed_loop.blind_baseline import BlindBaseline, beside_marginals, blind_baselines
from eyechart.studies.closed_loop.drives import Driver, Drives, read_drives, told_apart
from eyechart.studies.closed_loop.identical_drives import (
    SUSPECT,
    IdenticalEpisodes,
    RepeatedRequests,
    identical_groups,
    repeated_requests,
)
from eyechart.studies.closed_loop.ladder import (
    LadderRow,
    PairedDifference,
    SuccessCriteria,
    against,
    outcomes_of,
    reference_of,
    rung,
)

RESAMPLES = 5000
CHOSEN_HERE = (
    "the reference is the best constant of these same episodes, so the differences lean to its side and the p are "
    "not exact. Name a reference beforehand with --against for exact p"
)
"""The caveat of tests against a reference that the same data chose."""


@dataclass(frozen=True)
class ClosedLoopScore:
    """The scores of runs of episodes, each part computed at first use, from the episodes alone.

    ``against_policy`` names the ladder's reference policy; None takes the best constant of each
    simulator.
    """

    drives: tuple[Drives, ...]
    against_policy: str | None = None
    resamples: int = RESAMPLES
    paths: tuple[Path, ...] = ()

    @cached_property
    def unfinished(self) -> Mapping[str, tuple[UnfinishedEpisodes, ...]]:
        """Return by run the planned episodes without a record; only runs that lack any."""
        named = zip(self.paths, told_apart(self.paths), strict=True)
        return {name: left for path, name in named if (left := unfinished_of(path))}

    @cached_property
    def served(self) -> Mapping[str, ServedGuard]:
        """Return the guards of models for which several models or providers answered.

        With several runs the key names the run too.
        """
        named = zip(self.paths, told_apart(self.paths), strict=True)
        return {
            f"{spec} in {name}" if name else spec: one for path, name in named for spec, one in served_of(path).items()
        }

    @property
    def simulators(self) -> tuple[str, ...]:
        """Return the simulators of the drives, in order of appearance."""
        return tuple(dict.fromkeys(drive.driver.simulator for drive in self.drives))

    def of(self, simulator: str) -> tuple[Drives, ...]:
        """Return the drivers of one simulator."""
        return tuple(drive for drive in self.drives if drive.driver.simulator == simulator)

    @cached_property
    def outcomes(self) -> SuccessCriteria:
        """Return the definition of success in these worlds."""
        return outcomes_of(self.drives)

    @cached_property
    def ladder(self) -> tuple[LadderRow, ...]:
        """Return a row per driver."""
        return tuple(rung(drive, self.outcomes) for drive in self.drives)

    @cached_property
    def references(self) -> Mapping[str, Driver]:
        """Return the reference driver of each simulator that has one."""
        found = {name: reference_of(self.of(name), self.against_policy) for name in self.simulators}
        return {name: one.driver for name, one in found.items() if one is not None}

    @property
    def caveat(self) -> str:
        """Return the caveat on the paired differences, "" where the reference was named."""
        return CHOSEN_HERE if self.references and self.against_policy is None else ""

    @cached_property
    def paired(self) -> tuple[PairedDifference, ...]:
        """Return each other driver less the reference, Holm over a simulator's tests."""
        by_driver = {drive.driver: drive for drive in self.drives}
        pairs = ((self.of(name), by_driver[driver]) for name, driver in self.references.items())
        return tuple(one for pair in pairs for one in against(*pair, self.outcomes, resamples=self.resamples))

    @cached_property
    def blind(self) -> tuple[BlindBaseline, ...]:
        """Return each policy against its blind baselines, and against its own marginal."""
        how = {"resamples": self.resamples}
        return (
            *blind_baselines(self.drives, self.outcomes, **how),
            *beside_marginals(self.drives, self.outcomes, **how),
        )

    @cached_property
    def audit(self) -> tuple[Degeneracy, ...]:
        """Return a row of the degeneracy audit per driver."""
        return tuple(audit(self.drives, resamples=self.resamples))

    @cached_property
    def replays(self) -> tuple[ReplayComparison, ...]:
        """Return each driver's comparison with each scripted controller."""
        return tuple(found for drive in self.drives for found in replays(drive, resamples=self.resamples))

    @cached_property
    def twins(self) -> tuple[IdenticalEpisodes, ...]:
        """Return the drivers with identical drives."""
        return tuple(identical_groups(self.drives))

    @cached_property
    def repeats(self) -> tuple[RepeatedRequests, ...]:
        """Return the comparison of each driver's repeated requests."""
        return tuple(found for drive in self.drives if (found := repeated_requests(drive)) is not None)

    def measured(self) -> tuple[ModelStatistics, ...]:
        """Return the audit of every model."""
        lacking = {one.policy: one.words for left in self.unfinished.values() for one in left}
        return measured(self.drives, lacking, resamples=self.resamples)

    @property
    def is_suspect(self) -> bool:
        """Return whether anything points to a cache."""
        return any(twin.kind == SUSPECT for twin in self.twins) or any(repeat.suspect for repeat in self.repeats)

    def as_dict(self) -> dict[str, object]:
        """Return every number as plain JSON values."""
        return {
            "study": "closed_loop",
            "references": {name: reference.policy for name, reference in self.references.items()},
            "references_chosen_on_these_data": self.against_policy is None,
            **to_json_fields(self, "ladder paired blind served"),
            **self.audit_dict(),
            "unfinished": [{"run": run, **one.as_dict()} for run, left in self.unfinished.items() for one in left],
        }

    def audit_dict(self) -> dict[str, object]:
        """Return the audit's part as plain JSON values."""
        return to_json_fields(self, "audit replays", identical=self.twins, repeated_requests=self.repeats)


def score(
    runs: Sequence[Path] | Path,
    *,
    against_policy: str | None = None,
    resamples: int = RESAMPLES,
) -> ClosedLoopScore:
    """Read runs of episodes; raises LedgerError where a folder is none or holds no episode."""
    paths = [runs] if isinstance(runs, Path) else list(runs)
    return ClosedLoopScore(read_drives(paths), against_policy, resamples, tuple(paths))


def unfinished_of(path: Path) -> tuple[UnfinishedEpisodes, ...]:
    """Return a run's planned episodes without a record, by policy, with the reason."""
    manifest = read_manifest(path)
    over = {episode.key for episode in read_episodes(path)}
    return tuple(unfinished(path, [key for key in every_episode(manifest) if key not in over], manifest.models))


def served_of(path: Path) -> dict[str, ServedGuard]:
    """Return the failed guards of models that several models, providers or fingerprints served."""
    guards: dict[str, ServedGuard] = {}
    with Ledger(path / LEDGER, absent=True) as ledger:
        manifest = read_manifest(path)
        attempts = ledger.columns(read_in(manifest.prompt.asks(manifest.action_space)), by_frame=False)
        for spec in manifest.models:
            for guard in ServedChecks(attempts, spec, manifest.mode(spec)).guards():
                if not guard.holds:
                    guards[spec] = guard
    return guards


if TYPE_CHECKING:
    from eyechart.report.charts import Drawing
    from eyechart.report.table import Table
    from eyechart.studies.closed_loop.page import StudyIntroduction

NO_LEDGER = {
    **dict.fromkeys(
        ("verdict", "compare", "gate"),
        "holds drives, which are compared world by world: use 'eyechart score'",
    ),
}
"""The commands that drives refuse, because no ledger holds them, with the reason."""


class EpisodeStudy(Study[S]):
    """A study whose runs are drives."""

    runs_are = "drives"
    refuses = NO_LEDGER

    def manifest(self, run: Path) -> EpisodesManifest:
        return episodes.read_manifest(run)

    def manifest_and_space(self, run: Path) -> tuple[EpisodesManifest, AnySpace]:
        manifest = self.manifest(run)
        return manifest, manifest.prompt.asks(manifest.action_space)

    def took_run(self, run: Path, prices: Prices, *, fresh: bool = False) -> RunCosts:
        del fresh  # of policies and drives no columns are kept
        manifest, space = self.manifest_and_space(run)
        costs = RunCosts(probes=dict(manifest.probes))
        if (run / LEDGER).is_file():
            with Ledger(run / LEDGER) as ledger:
                attempts = ledger.columns(read_in(space), by_frame=False)
            for spec in manifest.models:
                mode = manifest.mode(spec)
                costs.accounts[spec] = accounts_of(attempts, spec, prices.of(mode))
                costs.guards[spec] = ServedChecks(attempts, spec, mode).guards()
        return costs

    def report(self, runs: Sequence[Path], banks: Sequence[Path], reading: ReadOptions, tell: Tell) -> StudyReport:
        del banks
        tell("scoring")
        return self.made(runs, score(runs, against_policy=reading.against, resamples=reading.resamples), reading, tell)

    def made(self, runs: Sequence[Path], scored: ClosedLoopScore, reading: ReadOptions, tell: Tell) -> StudyReport:
        """Return the report of drives that are scored."""
        from eyechart.studies.closed_loop.browser import PICTURED
        from eyechart.studies.closed_loop.page import make_drives_page
        from eyechart.studies.closed_loop.tables import tables_of

        first = self.first(runs)
        costs = [table for table in (self.deployment(runs, reading),) if table is not None]
        page = make_drives_page(runs, scored, first, costs=costs, pictured=PICTURED if reading.driven else 0, tell=tell)
        return StudyReport(page, [*tables_of(scored), *(first.section.tables if first else ()), *costs], page.notes)

    def first(self, runs: Sequence[Path]) -> "StudyIntroduction | None":
        """Return a study's own section before the drives; None where there is none."""
        del runs
        return None


class ClosedLoop(EpisodeStudy[ClosedLoopScore]):
    """Policies and models that drive."""

    counted = ("drive by sight", "driver")

    def holds(self, folder: Path) -> bool:
        return is_episodes(folder)

    def score(self, folder: Path, reading: ReadOptions) -> ClosedLoopScore:
        return score(folder, against_policy=reading.against, resamples=reading.resamples)

    def findings(self, score: ClosedLoopScore) -> Mapping[str, ModelSummary]:
        from eyechart.studies.closed_loop.visual_dependence import findings

        unjudged = dict.fromkeys((drive.driver.policy for drive in score.drives if drive.is_model), NO_VERDICT)
        return {**unjudged, **findings(score)}

    def whole(self, folder: Path, reading: ReadOptions, tell: Tell) -> tuple[ClosedLoopScore, StudyReport]:
        scored = self.score(folder, reading)
        return scored, self.made([folder], scored, reading, tell)

    def printed(self, score: ClosedLoopScore) -> "Iterator[Table | str]":
        from eyechart.studies.closed_loop import tables

        yield from tables.served_words(score.served)
        yield from tables.ladder_printed(score)
        yield from tables.unfinished_words(score.unfinished)
        if score.blind:
            yield tables.blind_table(score.blind)
            yield from (one.sentence for one in score.blind)
        yield from tables.audit_printed(score)
        yield from tables.long_tables(score)

    def paper(
        self, runs: Sequence[Path], banks: Sequence[Path], reading: ReadOptions, tell: Tell
    ) -> "Iterator[Table | Drawing]":
        from eyechart.studies.closed_loop.page import information
        from eyechart.studies.closed_loop.tables import degeneracy_audit, paper_tables

        del banks
        tell("scoring")
        scored = score(runs, against_policy=reading.against)
        yield from paper_tables(scored)
        yield from (drawing.labelled("fgr:mi") for drawing in information(degeneracy_audit(scored)))
