"""The paper's tables and figures, by label, from runs; and what the missing ones need.

Each study says which it yields (`Study.paper`). Halves of a table from two kinds of run are joined
here.
"""

import hashlib
import json
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import astuple, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from eyechart.costs import ALL
from eyechart.destination import write_files
from eyechart.episodes import read_episodes
from eyechart.errors import BankError, GuardianError, SpecError, text_file
from eyechart.frames import FrameBank, open_bank
from eyechart.manifest import BANK, read_run
from eyechart.models.prices import Prices, read_prices
from eyechart.records import parse_json
from eyechart.studies import ReadOptions, RunCosts, Study, Tell, each_once, is_episodes, names_of, run_json, study_of

if TYPE_CHECKING:
    from eyechart.report.charts import Drawing
    from eyechart.report.table import Cell, Table

LABELS: Mapping[str, str] = {
    "t:conditions": "eyechart run battery",
    "t:baselines": "eyechart run closed-loop",
    "t:controller-local": "eyechart run structured",
    "t:positive-guardian": "eyechart run structured",
    "t:mpc-intent": "eyechart run hierarchy",
    "t:degeneracy": "eyechart run closed-loop",
    "t:frontier": "eyechart run battery",
    "t:qwenorder": "eyechart run battery",
    "t:prompts": "eyechart run prompts",
    "fgr:mi": "eyechart run closed-loop",
    "fgr:bicb": "eyechart run battery",
    "fgr:vlm-interface": "eyechart run structured",
}
"""The labels of the paper's tables and figures, each with the command for its run."""
BESIDES: Mapping[str, str] = {
    "t:controller-local": "with a run of eyechart run online, its crash column",
    "t:positive-guardian": "with --guardian, a file of eyechart guardian fit",
    "t:degeneracy": "with a model in it",
    "fgr:mi": "with a model in it",
    "fgr:vlm-interface": "with the bank's pictures, in a calibrated view",
}
"""What a label needs in addition to its run."""

ESTIMATES = "estimates"
"""The kind of runs whose replies hold votes for a guardian."""


@dataclass(frozen=True)
class Artefacts:
    """The tables and figures of runs; ``missing`` says by label what the others need."""

    tables: "tuple[Table, ...]"
    drawings: "tuple[Drawing, ...]"
    missing: Mapping[str, str]


def artefacts(
    given: Sequence[Path],
    banks: Sequence[Path] = (),
    reading: ReadOptions | None = None,
    tell: Tell = lambda _: None,
    *,
    guardian: Path | None = None,
    prices: Path | None = None,
    scores: Path | None = None,
) -> Artefacts:
    """Return all parts of the paper that these runs determine; runs of one kind share a table.

    A ``guardian`` is scored on frames that did not choose it, from runs of scene estimates or
    tables of votes in ``given``. A TOML file with a table's name describes its votes. ``prices`` is
    a price file, and ``scores`` a table of external scores to correlate with grounding. Raises what
    scoring raises.
    """
    from eyechart.report.table import Table  # noqa: PLC0415 - the list of labels needs no figures

    paths = each_once(given)
    runs = [path for path in paths if guardian is None or not path.is_file()]
    by_kind: dict[str, tuple[Study[object], list[Path]]] = {}  # type: ignore[type-var]
    for run in runs:
        study = study_of(run)
        by_kind.setdefault(type(study).__qualname__, (study, []))[1].append(run)
    made = [one for study, mine in by_kind.values() for one in study.paper(mine, banks, reading or ReadOptions(), tell)]
    if guardian is not None:
        tell(f"scoring {guardian.name}")
        made += _guardian(guardian, paths, banks, reading or ReadOptions())
    made += _beside(runs, read_prices(prices), reading or ReadOptions(), scores)
    tables = tuple(_joined([one for one in made if isinstance(one, Table)]))
    drawings = tuple(one for one in made if not isinstance(one, Table))
    have = {table.label for table in tables} | {drawing.name.replace("-", ":", 1) for drawing in drawings}
    commands = _commands({kind: mine for kind, (_, mine) in by_kind.items()})
    missing = {label: needs(label, commands) for label in LABELS if label not in have}
    return Artefacts(tables, drawings, missing)


def needs(label: str, given: Collection[str] = ()) -> str:
    """Return in words what a label needs, in addition to the commands in ``given``."""
    besides = BESIDES.get(label)
    if LABELS[label] in given and besides:
        return f"needs the run of {LABELS[label]} {besides}"
    return ", ".join(filter(None, (f"needs a run of {LABELS[label]}", besides)))


def _commands(kinds: Mapping[str, Sequence[Path]]) -> set[str]:
    """Return the commands that made runs, by study; an admission is not ``run structured``."""
    made = {"BatteryStudy": "battery", "ClosedLoop": "closed-loop"}
    found = {f"eyechart run {name}" for kind, name in made.items() if kind in kinds}
    whole = any(run_json(run).get("study") == "structured" for run in kinds.get("StructuredStudy", ()))
    return found | ({"eyechart run structured"} if whole else set())


def _guardian(path: Path, given: Iterable[Path], banks: Sequence[Path], reading: ReadOptions) -> "Iterator[Table]":
    """Yield Table t:positive-guardian on all given frames that did not choose the guardian.

    Then yield tests against the best single model, nested choice over all votes, and modular replay
    if the bank's pictures can be read.
    """
    from eyechart.guardian.page import nested_table, paper_table, replay_table, tests_table  # noqa: PLC0415 - draws
    from eyechart.studies import guardian as study  # noqa: PLC0415 - as above

    frozen, votes = study.read_frozen(path), []
    for one in given:
        if one.is_file():
            about = one.with_suffix(".toml")
            votes.append(study.read_votes(one, about=about if about.is_file() else None))
        elif study_of(one).runs_are == ESTIMATES:
            votes.append(study.votes_of_run(one, reread=reading.reread))
    mine = [vote for vote in votes if frozen.about.bank in {None, vote.about.bank}]
    unseen = [left for vote in mine if (left := frozen.unseen(vote)).frames]
    if not unseen:
        raise SpecError(
            f"no votes are given for {path} on frames of its bank that did not choose it: give a run of scene "
            "estimates, or a table of votes, with --guardian"
        )
    table = study.join(unseen)
    table = table if table.split is None else table.part("score")
    found = study.score(frozen, table)
    yield paper_table(found)
    yield tests_table(found)
    whole = study.join(mine)
    with suppress(GuardianError):  # one episode, or an unfinished run: no nested choice
        yield nested_table(study.nested(whole if whole.split is None else whole.part("calibration", "score")))
    for bank in _pictured(frozen.about.bank, given, banks):
        with suppress(GuardianError, BankError):  # pictures that are gone or cannot be read
            yield replay_table(study.replay(frozen, table, study.reader_of(bank)))
            return


def _pictured(fingerprint: str | None, given: Iterable[Path], banks: Sequence[Path]) -> "Iterator[FrameBank]":
    """Yield the given banks and the runs' banks with this fingerprint."""
    for folder in (*banks, *(path / BANK for path in given if (path / BANK).is_dir())):
        with suppress(BankError):
            bank = open_bank(folder)
            if fingerprint in {None, bank.manifest.fingerprint}:
                yield bank


def _beside(runs: Sequence[Path], prices: Prices, reading: ReadOptions, scores: Path | None) -> "Iterator[Table]":
    """Yield further tables: costs, corpus, replications, and transfer of ``scores``."""
    from eyechart.compare import replications_table  # noqa: PLC0415 - draws
    from eyechart.studies.battery import score as score_battery  # noqa: PLC0415 - as above
    from eyechart.transfer import read_scores, transfer, transfer_table  # noqa: PLC0415 - as above

    for table in (_costs(runs, prices), corpus_table(runs, prices)):
        if table.rows:
            yield table
    batteries = [run for run in runs if run_json(run).get("study") == "battery"]
    if len(batteries) > 1:
        found = {
            name: score_battery(
                run, independent=reading.independent, reread=reading.reread, resamples=reading.resamples
            )
            for run, name in zip(batteries, names_of(batteries), strict=True)
        }
        if (replications := replications_table(found)) is not None:
            yield replications
    if scores is not None:
        yield transfer_table(transfer([study_of(run).score(run, reading) for run in runs], read_scores(scores)))


def _costs(runs: Sequence[Path], prices: Prices) -> "Table":
    """Return the costs of all models' decisions; a model in several runs is named with its run."""
    from eyechart.report.accounts import deployment_table  # noqa: PLC0415 - as above
    from eyechart.report.table import stack_tables  # noqa: PLC0415 - as above

    tables = {}
    for run, name in zip(runs, names_of(runs), strict=True):
        accounts = study_of(run).took(run, prices).accounts
        tables[name] = deployment_table({spec: found[ALL] for spec, found in accounts.items()})
    return stack_tables(tables or {"": deployment_table({})})


def _joined(tables: "Sequence[Table]") -> "Iterator[Table]":
    """Yield tables; those with one label and different columns are joined."""
    held: dict[str, Table] = {}
    for table in tables:
        before = held.get(table.label) if table.label else None
        if before is None or set(before.names[1:]) & set(table.names[1:]):
            if before is not None:
                yield before
            if table.label:
                held[table.label] = table
            else:
                yield table
        else:
            held[table.label] = before.joined(table)
    yield from held.values()


WRITTEN = ".paper.json"
"""The record in the folder of written files, with their SHA-256."""


@dataclass(frozen=True)
class WrittenFiles:
    """The written files, and old files that do not belong to these runs and were ``removed``.

    ``kept`` are old files that were changed since.
    """

    files: tuple[Path, ...]
    removed: tuple[Path, ...] = ()
    kept: tuple[Path, ...] = ()

    def lines(self) -> Iterator[str]:
        """Yield what happened to each file."""
        yield from (f"wrote    {path}" for path in self.files)
        yield from (f"removed  {path}: an earlier call wrote it, and these runs do not" for path in self.removed)
        yield from (f"kept     {path}: an earlier call wrote it, and it was changed since" for path in self.kept)


def write(found: Artefacts, folder: Path) -> WrittenFiles:
    """Write tables as CSV, Markdown and LaTeX, figures as SVG and PDF; remove old files.

    Raises OutputError if a file may not be written there.
    """
    from eyechart.report.table import files_of  # noqa: PLC0415 - as above

    files = files_of([table if table.label else replace(table, label=f"t:{table.name}") for table in found.tables])
    names = [drawing.name for drawing in found.drawings]
    for place, one in enumerate(found.drawings):
        stem = f"{one.name}_{again + 1}" if (again := names[:place].count(one.name)) else one.name
        files |= {f"{stem}.svg": one.svg().encode("utf-8", "backslashreplace"), f"{stem}.pdf": one.pdf()}
    before = _before(folder)
    digests = {name: hashlib.sha256(content).hexdigest() for name, content in sorted(files.items())}
    record = (json.dumps({"files": digests}, indent=1) + "\n").encode()
    *written, _ = write_files({**files, WRITTEN: record}, folder)
    removed, kept = _cleared(folder, before, set(files))
    return WrittenFiles(tuple(written), removed, kept)


def _cleared(
    folder: Path, before: Mapping[str, str], names: Collection[str]
) -> tuple[tuple[Path, ...], tuple[Path, ...]]:
    """Remove old files that are not written again; return them, and those changed since."""
    removed, kept = [], []
    for name, digest in before.items():
        file = folder / name
        if name in names or Path(name).name != name or not file.is_file() or file.is_symlink():
            continue
        if hashlib.sha256(file.read_bytes()).hexdigest() == digest:
            file.unlink()
            removed.append(file)
        else:
            kept.append(file)
    return tuple(removed), tuple(kept)


def _before(folder: Path) -> Mapping[str, str]:
    """Return the digests of an earlier call's files by name; empty without a record."""
    try:
        files = parse_json(text_file(folder / WRITTEN).read_text(encoding="utf-8"))["files"]
        return {name: digest for name, digest in files.items() if isinstance(digest, str)}
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError):
        return {}


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


def corpus_table(runs: Sequence[Path], prices: Prices) -> "Table":
    """Return a row per run with its calls and episodes, and their sum; empty without models.

    The sum counts an episode of one bank once, however many runs ask about it.
    """
    from eyechart.report.table import Column, Table, columns  # noqa: PLC0415 - as above

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
        rows.append(("sum", None, len(episodes), *(every[what] for what in counts)))
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
