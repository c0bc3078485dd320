"""The page: one self-contained HTML file that makes no request, in which nothing that a model wrote is markup."""

from collections.abc import Mapping, Sequence

from eyechart.conditions import CONDITIONS, OF_BANKS
from eyechart.costs import ALL
from eyechart.report.page import Page, fill
from eyechart.report.table import Column, level, number, p_value
from eyechart.spaces.space import MISSING
from eyechart.stats.evalues import EValue
from eyechart.stats.statistic import Statistic
from eyechart.studies.battery.album import Album, make_album
from eyechart.studies.battery.browser import Texts, browser_data, collect_texts, frames_shown
from eyechart.studies.battery.figures import figures
from eyechart.studies.battery.sections import counts, guards, not_covered, pairs, silent, summed
from eyechart.studies.battery.subjects import Evidence, Subject, Tell, subjects
from eyechart.studies.battery.tables import frontier_table, judged_of, statistics_table, verdict_table
from eyechart.verdicts import LABELS, Stopped, shared_notes

MODELS_DRAWN = 24
"""Models that have figures of their own in the page."""


def make_page(evidence: Sequence[Evidence], *, tell: Tell = lambda _: None) -> Page:
    """Return the report of runs. The same runs give the same bytes. ``tell`` is told what is under way."""
    everyone, shown = subjects(evidence), frames_shown(evidence)
    judged = judged_of(everyone)
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
        statistics=list(statistics_table(judged).split()),
        tables=[verdict_table(judged), frontier_table(judged)],
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
        "because": str(verdict.calibrated.reason),
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
    interval = (f"{level(one)} interval".strip(), Column("", "interval").shown(one.ci))
    return [("value", number(one.value)), interval, ("n", str(one.n)), ("p", p_value(one.p))]


def _threshold(one: Statistic) -> str:
    return f"{one.threshold:g}" if isinstance(one, EValue) else "—"


def _run(run: Evidence) -> dict[str, object]:
    rows = [counts(who) for who in subjects([run])]
    return {
        "evidence": run,
        "manifest": run.score.manifest,
        "bank": run.score.bank,
        "counts": summed(rows),
        "counts_by_model": list(zip(run.score.models, rows, strict=True)),
        "guards": guards(run),
        "not_covered": not_covered(run),
    }


def _accounting(who: Subject) -> dict[str, object]:
    given = [one for column in who.model.answers.decisions.values() for one in column if one is not None]
    missing = [sum(one.missing == reason for one in given) for reason in MISSING]
    took = who.run.score.accounting[who.spec][ALL]
    return {"who": who, "model": who.model, "unknown": who.run.unknown[who.spec], "took": took, "missing": missing}
