"""The numbers of calls and episodes of runs, by study and arm: the corpus that a paper reports."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from pathlib import Path

from eyechart.costs import ALL
from eyechart.episodes import read_episodes
from eyechart.manifest import read_run
from eyechart.models.prices import Prices
from eyechart.report.table import Cell, Column, Table, columns
from eyechart.studies import RunCosts, is_episodes, names_of, run_json, study_of

SUM = "sum"


@dataclass(frozen=True, slots=True)
class CorpusRun:
    """One run of a folder: its study, its distinct episodes, and counts of calls.

    ``scored`` calls have a reply, with or without a decision. ``counts`` has ``unparsed`` ones
    among them, ``failed`` calls without a reply, ``open`` calls, and the ``probe`` calls before the
    run, which count nowhere else.
    """

    run: str
    study: str
    episodes: frozenset[tuple[str, ...]]
    counts: Counter[str]


def corpus_table(runs: Sequence[Path], prices: Prices) -> Table:
    """Return a row per run with its calls and episodes, and their sum; empty without models.

    The sum counts an episode of one bank once, however many runs ask about it.
    """
    arms = [
        _arm(f"{name} · {part}" if part else name, path, study_of(run).took_run(path, prices))
        for run, name in zip(runs, names_of(runs), strict=True)
        for part, path in study_of(run).runs(run).items()
    ]
    arms = [arm for arm in arms if arm.counts.total()]
    counts = ("scored", "unparsed", "failed", "open", "probe")
    rows: list[tuple[Cell, ...]] = [
        (arm.run, arm.study, len(arm.episodes), *(arm.counts[what] for what in counts)) for arm in arms
    ]
    if rows:
        every = sum((arm.counts for arm in arms), Counter[str]())
        episodes = frozenset[tuple[str, ...]]().union(*(arm.episodes for arm in arms))
        rows.append((SUM, None, len(episodes), *(every[what] for what in counts)))
    named = (Column("run"), Column("study", "word"), *columns("count", "episodes", *counts))
    note = (
        "scored: calls with a reply, of which unparsed hold no decision; probe: calls before a run, counted apart. "
        "The sum counts an episode of a bank once"
    )
    return Table("corpus", "Queries and episodes by study and arm", named, tuple(rows), note)


def _arm(name: str, run: Path, took: RunCosts) -> CorpusRun:
    """Return the counts of one run."""
    counts = Counter[str]()
    for account in (each[ALL] for each in took.accounts.values()):
        failed = account.missing.get("error", 0)
        counts["scored"] += account.finished - failed
        counts["unparsed"] += sum(account.missing.values()) - failed
        counts["failed"] += failed
        counts["open"] += account.calls - account.finished
    counts["probe"] = sum(probe.calls for probe in took.probes.values())
    study = "drives" if is_episodes(run) else str(run_json(run).get("study") or "")
    return CorpusRun(name, study, _episodes(run, frozenset(took.accounts)), counts)


def _episodes(run: Path, models: frozenset[str]) -> frozenset[tuple[str, ...]]:
    """Return the episodes that models drove in a run, or those of its bank."""
    if not is_episodes(run):
        manifest, bank = read_run(run)
        return frozenset((manifest.fingerprint, frame.drive) for frame in bank)
    driven = (episode.key for episode in read_episodes(run) if episode.key.policy in models)
    return frozenset((str(run.resolve()), *map(str, astuple(key))) for key in driven)
