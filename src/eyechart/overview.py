"""A folder of runs has an index: what each run says of each model, models side by side, and one model over time."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from eyechart.errors import EyechartError, SpecError, printable, raising
from eyechart.manifest import BESIDE, RUN, EpisodesManifest, RunManifest
from eyechart.report.page import GLYPHS, Opening, Page, Said, fill, parted
from eyechart.report.table import MARK, Cell, Column, Mark, Table, marked
from eyechart.studies import Finding, Made, Reading, Study, Tell, open_study, study_of
from eyechart.studies.prompts import is_study

DEEPEST = 4
"""Folders in folders that are looked into for runs."""
UNREAD = "cannot be scored"
NO_VERDICT = Finding("no verdict", "")


@dataclass(frozen=True)
class Entry:
    """What one run says of one model: of which version, asked about what, and what it found.

    ``asked`` holds, by name, what has to be the same before two runs of a model are about one question.
    """

    run: str
    study: str
    created: str
    model: str
    about: str
    asked: tuple[tuple[str, object], ...]
    found: Finding

    def apart(self, other: "Entry") -> list[str]:
        """Return in what another run of the model was asked otherwise."""
        theirs = dict(other.asked)
        return [name for name, value in self.asked if theirs.get(name) != value]


def holds_runs(folder: Path) -> bool:
    """Return whether a folder is no run, nor all runs of one study, and has some in it."""
    return folder.is_dir() and not _is_run(folder) and bool(find_runs(folder))


def _is_run(folder: Path) -> bool:
    begun = any((folder / name).is_file() for name in (RUN, *BESIDE))
    return begun or open_study("hierarchy").holds(folder) or is_study(folder)


def find_runs(folder: Path, deep: int = DEEPEST) -> list[Path]:
    """Return the runs in a folder, by path; links are not followed, and a run is not looked into."""
    if _is_run(folder):
        return [folder]
    with raising(SpecError, f"{folder} cannot be read"):
        inside = [one for one in sorted(folder.iterdir()) if one.is_dir() and not one.is_symlink()]
    return [run for one in inside for run in find_runs(one, deep - 1)] if deep else []


def read_index(folder: Path, reading: Reading, tell: Tell) -> list[Entry]:
    """Score every run in a folder, oldest first; what cannot be scored is an entry that says so."""
    found: list[Entry] = []
    for run in find_runs(folder):
        name = run.relative_to(folder).as_posix()
        tell(f"scoring {name}")
        found += _entries(name, run, reading)
    return sorted(found, key=lambda one: (one.created, one.run, one.model))


def _entries(name: str, run: Path, reading: Reading) -> Iterator[Entry]:
    study = study_of(run)
    try:
        findings = study.findings(study.score(run, reading))
        yield from _described(name, run, study, findings or dict.fromkeys(study.models(run) or ("",), NO_VERDICT))
    except EyechartError as error:
        unread = Finding(UNREAD, "bad", marks=(printable(str(error)),))
        yield Entry(name, study.runs_are, "", "", "", (), unread)


def _described(name: str, run: Path, study: Study[Any], findings: Mapping[str, Finding]) -> Iterator[Entry]:
    parts = [study.manifest(one) for one in study.runs(run).values()]
    of_banks = [one for one in parts if isinstance(one, RunManifest)]
    of_drives = [one for one in parts if isinstance(one, EpisodesManifest)]
    about = [*(Path(one.bank_path).name for one in of_banks), *(one.simulator for one in of_drives)]
    for spec, found in findings.items():
        versions = [*(one.models.get(spec) for one in of_banks), *(one.policies.get(spec) for one in of_drives)]
        asked = (
            ("bank", [*(one.fingerprint for one in of_banks), *(one.simulator for one in of_drives)]),
            ("frames", [*((one.limit, one.shard, one.frames) for one in of_banks), *(one.seeds for one in of_drives)]),
            ("conditions", [one.conditions for one in parts]),
            ("prompt", [one.prompt.key for one in parts]),
            ("version", versions),
            ("mode", [one.mode(spec) for one in parts]),
            ("reader", [one.reader for one in parts]),
        )
        created = min((one.created for one in parts), default="")
        yield Entry(name, study.runs_are, created, spec, ", ".join(dict.fromkeys(about)), asked, found)


def make_index(folder: Path, reading: Reading, tell: Tell) -> Made:
    """Return the index of the runs in a folder; raises SpecError where it holds none."""
    entries = read_index(folder, reading, tell)
    if not entries:
        raise SpecError(f"{folder} is no run and holds none: 'eyechart run battery' makes one")
    tables = [table for table in (runs_table(entries), models_table(entries), history_table(entries)) if table.rows]
    html = fill(
        "index.html",
        scripts=("layout.js", "index.js"),
        title=folder.resolve().name,
        answer=_opening(entries),
        runs=len({one.run for one in entries}),
        models=len({one.model for one in entries if one.model}),
        labels=Counter(one.found.label for one in entries).most_common(),
        tables={one.name: one for one in tables},
        marks=[line for one in entries for line in marked(f"{one.model or one.study} in {one.run}", one.found.marks)],
    )
    return Made(Page(html, {}), tables, [])


_KINDS = {"good": "sees", "bad": "blind"}
_NEWEST = {"sees": "yes for", "partly": "in part for", "blind": "no for", "open": "cannot say for"}


def _opening(entries: Sequence[Entry]) -> Opening:
    """Return what an index says first: the newest verdict on each model, and whether it is another than the one before.

    The models whose newest verdict differs from the one before stand first, then those that were asked last.
    """
    by_model: dict[str, list[Entry]] = {}
    for one in entries:
        if one.model and one.found.label not in (NO_VERDICT.label, UNREAD):
            by_model.setdefault(one.model, []).append(one)
    said = []
    for model, mine in reversed(by_model.items()):
        now, before = mine[-1], mine[-2] if len(mine) > 1 else None
        changed = "" if before is None or before.found.label == now.found.label else f"was {_words(before)}"
        words = f"{now.run}, {now.created[:10]}, on {now.about}." + (
            f" Against the run before: {_against(before, now)}." if before else ""
        )
        tone = _KINDS.get(now.found.tone, now.found.tone)
        said.append(
            Said(model, _words(now), tone if tone in GLYPHS else "open", words, now.found.state, "runs", changed)
        )
    if not said:
        return Opening("No run here has a verdict on a model.")
    return Opening(
        f"Do they look, by the newest verdicts? {parted(said, _NEWEST, 'models')}",
        sorted(said, key=lambda one: not one.beware),
    )


def _words(one: Entry) -> str:
    return one.found.label.replace("_", " ")


def _said(one: Entry) -> Mark:
    return Mark(_words(one), one.found.tone, MARK if one.found.marks else "")


def runs_table(entries: Sequence[Entry]) -> Table:
    """Return a model of a run a row, the newest first, with the estimate that decided its verdict."""
    named = (
        *(Column("model", "word"), Column("verdict", "word"), Column("run"), Column("of", "word", varies=True)),
        *(Column("asked about"), Column("begun", "word", varies=True), Column("decided by")),
        *(Column("value", "estimate"), Column("n", "count"), Column("not final")),
    )
    rows = tuple(
        (
            *(one.model or "—", _said(one), one.run, one.study, one.about, one.created[:16].replace("T", " ")),
            *(one.found.decided_by, found, None if found is None else found.n, one.found.state),
        )
        for one in reversed(entries)
        for found in (one.found.estimate,)
    )
    return Table("runs", "What each run says of each model", named, rows)


def models_table(entries: Sequence[Entry]) -> Table:
    """Return a model a row and what it was asked about a column, with its newest verdict there."""
    newest = {(one.model, one.about): one for one in entries if one.found.estimate is not None}
    about = list(dict.fromkeys(place for _, place in newest))
    cells: list[tuple[Cell, ...]] = []
    for model in dict.fromkeys(spec for spec, _ in newest):
        mine = [newest.get((model, place)) for place in about]
        cells.append((model, *("—" if one is None else _said(one) for one in mine)))
    return Table(
        "models",
        "The newest verdict on each model, by what it was asked about",
        (Column("model", "word"), *(Column(one, "word") for one in about)),
        tuple(cells),
        "Verdicts on different banks are answers to different questions: they stand beside one another, and no more.",
    )


def history_table(entries: Sequence[Entry]) -> Table:
    """Return the runs of each model that was asked more than once in their order, each held against the one before."""
    named = (
        *(Column("model", "word"), Column("verdict", "word"), Column("against the run before"), Column("run")),
        *(
            Column("begun", "word", varies=True),
            Column("asked about"),
            Column("decided by"),
            Column("value", "estimate"),
        ),
    )
    rows: list[tuple[Cell, ...]] = []
    for model in dict.fromkeys(one.model for one in entries if one.model):
        mine = [one for one in entries if one.model == model and one.found.label != NO_VERDICT.label]
        if len(mine) < 2:
            continue
        told = ["the first", *(_against(before, now) for before, now in pairwise(mine))]
        rows += [
            (
                *(model, _said(one), words, one.run, one.created[:16].replace("T", " ")),
                *(one.about, one.found.decided_by, one.found.estimate),
            )
            for one, words in zip(mine, told, strict=True)
        ]
    note = (
        "Another verdict is not yet another model: 'eyechart compare RUN RUN' tests the difference of every statistic."
    )
    return Table("history", "Models that were asked more than once, over time", named, tuple(rows), note)


def _against(before: Entry, now: Entry) -> str:
    """Return in words how a run's verdict stands to the one before, and what was asked otherwise."""
    same = before.found.label == now.found.label
    verdict = "the same verdict" if same else f"another verdict: it was {before.found.label.replace('_', ' ')}"
    apart = now.apart(before)
    return f"{verdict}; not the same {', '.join(apart)}" if apart else f"{verdict}, asked the same"
