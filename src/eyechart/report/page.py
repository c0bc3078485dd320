"""The page: one self-contained HTML file that makes no request, in which nothing that a model wrote is markup."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from eyechart.conditions import CONDITIONS, OF_BANKS
from eyechart.costs import ALL
from eyechart.destination import whole
from eyechart.report.assets import fill
from eyechart.report.browser import Texts, browser_data, collect_texts, frames_shown
from eyechart.report.drawing import Drawing
from eyechart.report.evidence import Evidence, Subject, Tell, subjects
from eyechart.report.figures import figures
from eyechart.report.integrity import counts, not_covered, summed
from eyechart.report.pictures import Album, make_album
from eyechart.report.sections import guards, pairs, silent
from eyechart.report.sheets import STATISTIC_COLUMNS, level, shown, statistic_rows
from eyechart.spaces.space import MISSING
from eyechart.stats.statistic import Statistic
from eyechart.verdicts import LABELS, Stopped, shared_notes

MODELS_DRAWN = 24
"""Models that have figures of their own in the page."""


@dataclass(frozen=True)
class Page:
    """A report as HTML, with its figures, and in ``notes`` what is not in it or was made smaller."""

    html: bytes
    drawings: dict[str, list[Drawing]]
    notes: tuple[str, ...]


def make_page(evidence: Sequence[Evidence], *, tell: Tell = lambda _: None) -> Page:
    """Return the report of runs. The same runs give the same bytes. ``tell`` is told what is under way."""
    everyone, shown = subjects(evidence), frames_shown(evidence)
    shared = shared_notes({who.label: who.verdict for who in everyone})
    tell("figures")
    drawn = figures(everyone)
    album, texts = make_album(evidence, shown, tell=tell), collect_texts(evidence, shown)
    tell("the page")
    notes = _notes(evidence, shown, album, texts, len(everyone))
    html = fill(
        "page.html",
        scripts=("layout.js", "browser.js", "page.js"),
        data=browser_data(evidence, album, texts, shown),
        title=", ".join(run.name for run in evidence),
        runs=[_run(run) for run in evidence],
        cards=[_card(who, shared) for who in everyone],
        shared=shared,
        figures={section: many[:MODELS_DRAWN] for section, many in drawn.items()},
        silent=silent(evidence, everyone, drawn),
        pairs=[
            one
            for run, places in zip(evidence, album.places, strict=True)
            for one in pairs(run, places, album, len(everyone))
        ],
        statistics=[(who.label, _statistics(who)) for who in everyone],
        statistic_columns=STATISTIC_COLUMNS,
        conditions=[CONDITIONS[name] for name in OF_BANKS],
        stopped=any(who.model.stopped for who in everyone),
        accounting=[_accounting(who) for who in everyone],
        reasons=MISSING,
        notes=notes,
    )
    return Page(html, drawn, tuple(notes))


def _notes(
    evidence: Sequence[Evidence], shown: Sequence[Sequence[int]], album: Album, texts: Texts, models: int
) -> list[str]:
    """Return in words what is not in the page, or not as it was."""
    notes = [*album.notes]
    every, listed = sum(len(run.frames) for run in evidence), sum(map(len, shown))
    if listed < every:
        notes.append(
            f"The browser lists {listed:,} of {every:,} frames, evenly from every episode; every number on this page "
            "counts all of them."
        )
    if texts.cut:
        notes.append(f"{texts.cut} replies are cut after {texts.limit:,} characters; the ledger has all of them.")
    if models > MODELS_DRAWN:
        notes.append(f"Figures of one model each stand here for the first {MODELS_DRAWN} of {models} models.")
    return notes


def write_page(page: Page, out: Path) -> None:
    """Write a page; a reader never sees half of it. Raises OutputError where it may not be written there."""
    with whole(out, "report") as partial:
        partial.write_bytes(page.html)


def _card(who: Subject, shared: Mapping[str, str]) -> dict[str, object]:
    verdict = who.verdict
    label = LABELS[verdict.calibrated.label]
    deciding = who.model.statistics[verdict.calibrated.decided_by]
    return {
        "model": who.label,
        "version": who.model.version,
        "family": label.family,
        "glyph": label.glyph,
        "verdict": verdict,
        "notes": [note for note in verdict.notes if note not in shared],
        "numbers": _numbers(deciding, verdict.stopped),
        "because": verdict.calibrated.words.partition(": settled by ")[0],
    }


def _numbers(one: Statistic, stopped: Stopped | None) -> list[tuple[str, str]]:
    if stopped is not None:
        calls = f"{stopped.calls} of {stopped.planned}"
        return [
            ("e-value", f"{one.value:.4g}"),
            ("settled at", _threshold(one)),
            ("frames", str(one.n)),
            ("calls", calls),
        ]
    interval = (f"{level(one)} interval".strip(), shown(one.ci, "interval"))
    return [("value", shown(one.value, "number")), interval, ("n", str(one.n)), ("p", shown(one.p, "p"))]


def _threshold(one: Statistic) -> str:
    return f"{(one.detail or {}).get('threshold', '—'):g}"


def _statistics(who: Subject) -> list[list[str]]:
    return [
        [shown(cell, kind) if cell != "" else "" for cell, (_, kind) in zip(row, STATISTIC_COLUMNS, strict=True)]
        for row in statistic_rows(who)
    ]


def _run(run: Evidence) -> dict[str, object]:
    manifest, bank = run.score.manifest, run.score.bank
    rows = [counts(who) for who in subjects([run])]
    return {
        "name": run.name,
        "bank": bank.name,
        "picture": bank.manifest.picture,
        "frames": len(run.frames),
        "models": len(run.score.models),
        "fingerprint": manifest.fingerprint,
        "created": manifest.created,
        "seed": manifest.seed,
        "prompt": manifest.prompt,
        "versions": manifest.versions,
        "conditions": manifest.conditions,
        "shard": manifest.shard,
        "limit": manifest.limit,
        "gap": bank.manifest.gap,
        "space": bank.manifest.action_space,
        "has_pictures": run.pictures is not None,
        "about_pictures": run.about_pictures,
        "counts": summed(rows),
        "counts_by_model": list(zip(run.score.models, rows, strict=True)),
        "guards": guards(run),
        "not_covered": not_covered(run),
    }


def _accounting(who: Subject) -> dict[str, object]:
    given = [one for column in who.model.answers.decisions.values() for one in column if one is not None]
    return {
        "model": who.label,
        "planned": who.model.planned,
        "answered": who.model.answered,
        "stopped": who.model.stopped is not None,
        "unknown": who.run.unknown[who.spec],
        "took": who.run.score.accounting[who.spec][ALL],
        "missing": [sum(one.missing == reason for one in given) for reason in MISSING],
    }
