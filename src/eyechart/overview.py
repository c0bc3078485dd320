"""The index of a folder of runs: verdicts by run, models side by side, and models over time."""

import datetime as dt
import html
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any
from urllib.parse import quote

from eyechart.errors import EyechartError, SpecError, counted, printable, raising
from eyechart.kept import kept
from eyechart.manifest import BESIDE, RUN, EpisodesManifest, RunManifest
from eyechart.report.page import Page, PageSummary, VerdictSummary, fill
from eyechart.report.table import MARK, Cell, Column, Mark, Table
from eyechart.studies import (
    NO_VERDICT,
    ModelSummary,
    ReadOptions,
    Study,
    StudyReport,
    Tell,
    open_study,
    run_json,
    study_of,
)
from eyechart.studies.prompts import is_study
from eyechart.verdicts.labels import GLYPHS

DEEPEST = 4
"""The depth of nested folders to search for runs."""
UNREAD = "cannot be scored"
_VERSION = "version"
"""The one difference that two comparable runs of a model may have."""
_TITLE = re.compile(rb"<title>eyechart report: ([^<]*)</title>")
_HEAD = 4096
"""Bytes at the start of a page that hold its title."""


@dataclass(frozen=True)
class Entry:
    """What one run says of one model: version, question and finding.

    ``begun`` is when its first call was sent, in UTC, or the run's day if it has no call.
    ``counted`` is the "yes" of its kind of finding, and the noun that is counted. ``settings`` holds,
    by name, what must be equal before two runs of a model answer one question.
    """

    run: str
    study: str
    begun: str
    model: str
    about: str
    settings: tuple[tuple[str, object], ...]
    found: ModelSummary
    counted: tuple[str, str] = ("", "")

    def apart(self, other: "Entry") -> list[str]:
        """Return how another run of the model was asked differently."""
        theirs = dict(other.settings)
        return [name for name, value in self.settings if theirs.get(name) != value]

    @property
    def is_judged(self) -> bool:
        """Return whether the run has a verdict on the model."""
        return bool(self.model) and self.found.label not in {NO_VERDICT.label, UNREAD}

    @property
    def when(self) -> str:
        """Return when it began, for people, to the second."""
        return self.begun[:19].replace("T", " ")


def holds_runs(folder: Path) -> bool:
    """Return whether a folder contains runs but is neither a run nor one study."""
    return folder.is_dir() and not _is_run(folder) and bool(find_runs(folder))


def _is_run(folder: Path) -> bool:
    begun = any((folder / name).is_file() for name in (RUN, *BESIDE))
    return begun or open_study("hierarchy").holds(folder) or is_study(folder)


def find_runs(folder: Path, deep: int = DEEPEST) -> list[Path]:
    """Return the runs in a folder, by path; it follows no links and searches no run."""
    if _is_run(folder):
        return [folder]
    with raising(SpecError, f"{folder} cannot be read"):
        inside = [path for path in sorted(folder.iterdir()) if path.is_dir() and not path.is_symlink()]
    return [run for path in inside for run in find_runs(path, deep - 1)] if deep else []


def read_index(folder: Path, reading: ReadOptions, tell: Tell) -> list[Entry]:
    """Score every run in a folder, in the order of first calls; a failure is an entry too.

    A run without calls has only its day, and precedes all that began on that day.
    """
    entries: list[Entry] = []
    for run in find_runs(folder):
        name = run.relative_to(folder).as_posix()
        tell(f"scoring {name}")
        entries += _entries(name, run, reading)
    return sorted(entries, key=lambda entry: (entry.begun, entry.run, entry.model))


def _entries(name: str, run: Path, reading: ReadOptions) -> Iterator[Entry]:
    study = open_study("battery")
    try:
        study = study_of(run)
        request = ["index", reading.independent, reading.reread, reading.against, reading.resamples]
        found = kept(run, request, lambda: _found_in(run, study, reading), fresh=reading.fresh)
        findings = {spec: ModelSummary.of_plain(said) for spec, said in found["findings"].items()}
        findings = findings or dict.fromkeys(study.models(run) or ("",), NO_VERDICT)
        yield from _described(name, run, study, _moment(found["began"]), findings)
    except EyechartError as error:
        unread = ModelSummary(UNREAD, "bad", marks=(printable(str(error)),))
        yield Entry(name, study.runs_are, _moment(_created(run)), "", "", (), unread)


def _found_in(run: Path, study: Study[Any], reading: ReadOptions) -> dict[str, Any]:
    """Return what a run says, in plain values: its findings by model, and when it began."""
    findings = study.findings(study.score(run, reading))
    return {"findings": {spec: one.as_plain() for spec, one in findings.items()}, "began": study.began(run)}


def _created(run: Path) -> object:
    """Return when a run says that it was made; None if that cannot be read."""
    with suppress(EyechartError):
        return run_json(run).get("created")
    return None


def _described(
    name: str, run: Path, study: Study[Any], begun: str, findings: Mapping[str, ModelSummary]
) -> Iterator[Entry]:
    parts = [study.manifest(one) for one in study.runs(run).values()]
    of_banks = [part for part in parts if isinstance(part, RunManifest)]
    of_drives = [part for part in parts if isinstance(part, EpisodesManifest)]
    about = [*(Path(part.bank_path).name for part in of_banks), *(part.simulator for part in of_drives)]
    for spec, found in findings.items():
        versions = [*(part.models.get(spec) for part in of_banks), *(part.policies.get(spec) for part in of_drives)]
        settings = (
            ("bank", [*(part.fingerprint for part in of_banks), *(part.simulator for part in of_drives)]),
            (
                "frames",
                [*((part.limit, part.shard, part.frames) for part in of_banks), *(part.seeds for part in of_drives)],
            ),
            ("conditions", [part.conditions for part in parts]),
            ("prompt", [part.prompt.key for part in parts]),
            (_VERSION, versions),
            ("mode", [part.mode(spec) for part in parts if spec in part.models]),
            ("reader", [part.reader for part in parts]),
        )
        where = ", ".join(dict.fromkeys(about))
        yield Entry(name, study.runs_are, begun, spec, where, settings, found, study.counted)


def _moment(said: object) -> str:
    """Return a day, or a moment in UTC, in ISO form; "" if it is neither."""
    try:
        moment = dt.datetime.fromisoformat(str(said))
    except ValueError:
        return ""
    if len(str(said)) <= len("2026-01-01"):
        return moment.date().isoformat()
    return moment.astimezone(dt.UTC).isoformat(timespec="milliseconds") if moment.tzinfo else moment.isoformat()


def make_index(folder: Path, reading: ReadOptions, tell: Tell, out: Path | None = None) -> StudyReport:
    """Return the index of the runs in a folder; raises SpecError if there are none.

    With ``out`` it links to pages of single runs beside it or beside the runs.
    """
    entries = read_index(folder, reading, tell)
    if not entries:
        raise SpecError(f"{folder} is no run and holds none: 'eyechart run' makes one")
    runs = list(dict.fromkeys(entry.run for entry in reversed(entries)))
    places = {run: f"run-{number}" for number, run in enumerate(runs, 1)}
    pages = {} if out is None else _pages(folder, runs, out)
    led = {run: pages.get(run, f"#{place}") for run, place in places.items()}
    tables = [
        table for table in (runs_table(entries, led), models_table(entries), history_table(entries, led)) if table.rows
    ]
    page = fill(
        "index.html",
        scripts=("layout.js", "index.js"),
        title=folder.resolve().name,
        answer=_opening(entries, places),
        runs=len(runs),
        models=len({entry.model for entry in entries if entry.model}),
        tables={table.name: table for table in tables},
        each=_each(entries, places, pages),
        folder=str(folder),
    )
    return StudyReport(Page(page, {}), tables, [])


def _each(entries: Sequence[Entry], places: Mapping[str, str], pages: Mapping[str, str]) -> list[dict[str, object]]:
    """Return each run's part of the index, newest first: what it is, and its findings."""
    return [
        {
            "run": run,
            "place": place,
            "page": pages.get(run, ""),
            "of": mine[0].study,
            "about": mine[0].about,
            "begun": mine[0].when,
            "said": [(one, _said(one)) for one in mine],
        }
        for run, place in places.items()
        for mine in [[entry for entry in entries if entry.run == run]]
    ]


def _pages(folder: Path, runs: Sequence[str], out: Path) -> dict[str, str]:
    """Return the relative address of each run's own page: near the index or the run.

    A page is a run's if its title names that run alone. If two runs have one name, only a page in
    or beside the run counts.
    """
    pages: dict[str, str] = {}
    names = [_named(folder / run) for run in runs]
    for run, name in zip(runs, names, strict=True):
        here = folder / run
        near = [here, here.parent, *([out.parent] if names.count(name) == 1 else [])]
        page = next((file for place in near for file in _titled(place, name) if file.resolve() != out.resolve()), None)
        if page is not None:
            pages[run] = quote(os.path.relpath(page.resolve(), out.resolve().parent).replace(os.sep, "/"))
    return pages


def _named(run: Path) -> str:
    return run.resolve().name


def _titled(folder: Path, name: str) -> Iterator[Path]:
    """Yield the pages in a folder whose title names only this run."""
    for file in sorted(folder.glob("*.html")) if folder.is_dir() else ():
        try:
            if file.is_symlink():
                continue
            with file.open("rb") as stream:
                title = _TITLE.search(stream.read(_HEAD))
        except OSError:
            continue
        if title and html.unescape(title[1].decode("utf-8", "replace")) == name:
            yield file


_ANSWERS = {"Yes": "yes", "In part": "in part", "No": "no", "Inconclusive": "cannot be said"}
_OF_TONE = dict(zip(GLYPHS, _ANSWERS, strict=True))
"""The answer of a tone, for findings without an answer of their own."""


def _tone(entry: Entry) -> str:
    """Return the tone of a finding at the head of a page."""
    return entry.found.tone if entry.found.tone in GLYPHS else "open"


def _newest(entries: Sequence[Entry]) -> dict[tuple[str, tuple[str, str]], list[Entry]]:
    """Return the verdicts on each model of each kind, in order."""
    result: dict[tuple[str, tuple[str, str]], list[Entry]] = {}
    for entry in entries:
        if entry.is_judged:
            result.setdefault((entry.model, entry.counted), []).append(entry)
    return result


def _opening(entries: Sequence[Entry], places: Mapping[str, str]) -> PageSummary:
    """Return the head of an index: the newest verdict on each model, and whether it changed.

    Models with a changed verdict on an equal question come first, then the latest.
    """
    judged, said = _newest(entries), []
    for (model, _), mine in sorted(judged.items(), key=lambda one: one[1][-1].begun, reverse=True):
        now, before = mine[-1], mine[-2] if len(mine) > 1 else None
        changed = f"was {_words(before)}" if before is not None and _is_changed(before, now) else ""
        words = f"{now.run}, of {now.study}, {now.when}, on {now.about}." + (
            f" Compared with the run before: {_against(before, now)}." if before else ""
        )
        said.append(VerdictSummary(model, _words(now), _tone(now), words, now.found.state, places[now.run], changed))
    return PageSummary(_counted(entries), sorted(said, key=lambda one: not one.beware))


def _counted(entries: Sequence[Entry]) -> str:
    """Return in one sentence the number of models by newest answer, for each kind."""
    kinds: dict[tuple[str, str], list[str]] = {}
    judged = _newest(entries)
    for (_, kind), mine in judged.items():
        kinds.setdefault(kind, []).append(mine[-1].found.answer or _OF_TONE[_tone(mine[-1])])
    parts = []
    for (yes, whom), answers in kinds.items():
        counts = ", ".join(
            f"{answers.count(answer)} {words}" for answer, words in _ANSWERS.items() if answer in answers
        )
        parts.append(f"{yes}: {counts}, of {counted(len(answers), whom)}")
    models = {entry.model for entry in entries if entry.model}
    without = len(models - {model for model, _ in judged})
    unread = len({entry.run for entry in entries if entry.found.label == UNREAD})
    tail = [
        *(
            [f"{without} of {counted(len(models), 'model')} {'has' if without == 1 else 'have'} no verdict"]
            if without
            else []
        ),
        *([f"{counted(unread, 'run')} cannot be scored"] if unread else []),
    ]
    first = f"By the newest verdicts, {'; '.join(parts)}." if parts else "No run here has a verdict on a model."
    return " ".join([first, *(f"{words}." for words in tail)])


def _words(entry: Entry) -> str:
    return entry.found.label.replace("_", " ")


def _said(entry: Entry) -> Mark:
    return Mark(_words(entry), entry.found.tone, MARK if entry.found.marks else "")


def _led(entry: Entry, led: Mapping[str, str]) -> Mark:
    """Return a run's name with a link to its own page, or to its part of the index."""
    return Mark(entry.run, place=led.get(entry.run, ""))


_BEGUN = Column("begun (UTC)", "word", varies=True)
_TIMES = "A run begins when its first call is sent; a run without calls has only its day."


def runs_table(entries: Sequence[Entry], led: Mapping[str, str] | None = None) -> Table:
    """Return a row per model and run, newest first, with the estimate that decided.

    ``led`` holds the link of each run.
    """
    named = (
        *(Column("model", "word"), Column("verdict", "word"), Column("run"), Column("of", "word", varies=True)),
        *(Column("asked about"), _BEGUN, Column("asked about")),
        *(Column("value", "estimate"), Column("n", "count"), Column("not final")),
    )
    rows = tuple(
        (
            *(entry.model or "—", _said(entry), _led(entry, led or {}), entry.study, entry.about, entry.when),
            *(entry.found.decided_by, found, None if found is None else found.n, entry.found.state),
        )
        for entry in reversed(entries)
        for found in (entry.found.estimate,)
    )
    return Table("runs", "What each run says of each model", named, rows, _TIMES)


def models_table(entries: Sequence[Entry]) -> Table:
    """Return a row per model and a column per bank or simulator, with the newest verdict."""
    judged = [entry for entry in entries if entry.is_judged]
    kinds = dict.fromkeys((entry.about, entry.study) for entry in judged)
    heads = {
        kind: kind[0] if [about for about, _ in kinds].count(kind[0]) == 1 else f"{kind[0]}, {kind[1]}"
        for kind in kinds
    }
    newest = {(entry.model, (entry.about, entry.study)): entry for entry in judged}
    cells: list[tuple[Cell, ...]] = []
    for model in dict.fromkeys(entry.model for entry in judged):
        mine = [newest.get((model, kind)) for kind in heads]
        cells.append((model, *("—" if one is None else _said(one) for one in mine)))
    return Table(
        "models",
        "The newest verdict on each model, by bank or simulator",
        (Column("model", "word"), *(Column(head, "word") for head in heads.values())),
        tuple(cells),
        "Verdicts on different banks answer different questions, so they are not compared.",
    )


def history_table(entries: Sequence[Entry], led: Mapping[str, str] | None = None) -> Table:
    """Return the runs of each repeated model in order, each compared with the one before.

    Verdicts of two kinds, as of a battery and of drives, are not compared.
    """
    named = (
        *(Column("model", "word"), Column("verdict", "word"), Column("against the run before"), Column("run")),
        *(_BEGUN, Column("asked about"), Column("decided by"), Column("value", "estimate")),
    )
    rows: list[tuple[Cell, ...]] = []
    kinds: dict[tuple[str, tuple[str, str]], list[Entry]] = {}
    for one in (entry for entry in entries if entry.model and entry.found.label != NO_VERDICT.label):
        kinds.setdefault((one.model, one.counted), []).append(one)
    for (model, _), mine in kinds.items():
        if len(mine) < 2:
            continue
        changes = ["the first", *(_against(before, now) for before, now in pairwise(mine))]
        rows += [
            (
                *(model, _said(one), words, _led(one, led or {}), one.when),
                *(one.about, one.found.decided_by, one.found.estimate),
            )
            for one, words in zip(mine, changes, strict=True)
        ]
    note = (
        "Another verdict is not yet another model: 'eyechart compare RUN RUN' tests the difference of every "
        f"statistic. {_TIMES}"
    )
    return Table("history", "Models with several runs, over time", named, tuple(rows), note)


def _is_changed(before: Entry, now: Entry) -> bool:
    """Return whether a verdict changed on an equal question; the version may differ."""
    return before.found.label != now.found.label and set(now.apart(before)) <= {_VERSION}


def _against(before: Entry, now: Entry) -> str:
    """Return in words how a verdict compares with the one before, if the question is equal."""
    same, apart = before.found.label == now.found.label, now.apart(before)
    unlike = f"not the same {', '.join(apart)}" if apart else "with the same question"
    if same:
        return f"the same verdict{';' if apart else ','} {unlike}"
    if set(apart) <= {_VERSION}:
        return f"another verdict: it was {_words(before)}{';' if apart else ','} {unlike}"
    return f"another question, whose answer was '{_words(before)}'; {unlike}"
