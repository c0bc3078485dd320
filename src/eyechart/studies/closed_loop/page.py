"""The page of runs of episodes: the ladder, the blind baseline, the audit and every drive, in one file."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from eyechart.manifest import RUN
from eyechart.report.page import Page, fill
from eyechart.report.table import Table
from eyechart.studies.closed_loop import ClosedLoopScore
from eyechart.studies.closed_loop.browser import PICTURED, Tell, drives_data
from eyechart.studies.closed_loop.figures import drives_figures
from eyechart.studies.closed_loop.published import beside_paper
from eyechart.studies.closed_loop.tables import (
    FINDINGS,
    blind_table,
    degeneracy_table,
    degeneracy_words,
    ladder_table,
    long_tables,
    paper_table,
    paper_words,
    reference_tables,
    replay_table,
    unfinished_words,
)

GLYPHS = {"sees": "●", "blind": "○", "open": "?"}
_FINDINGS = {"no_difference_found": "no difference found", "identical": "identical drives", "cannot_say": "cannot say"}


def make_drives_page(
    runs: Sequence[Path],
    score: ClosedLoopScore,
    more: Sequence[Table] = (),
    *,
    pictured: int = PICTURED,
    tell: Tell = lambda _: None,
) -> Page:
    """Return the report of runs of episodes; the same runs give the same bytes.

    ``more`` tables stand with its numbers; ``tell`` is told what is under way.
    """
    tell("figures")
    drawn = drives_figures(score)
    browser = drives_data(score, pictured=pictured, tell=tell)
    tell("the page")
    beside = beside_paper(score.ladder)
    html = fill(
        "drives.html",
        styles=("drives.css",),
        scripts=("layout.js", "browser.js", "drives.js"),
        data=browser.data,
        title=", ".join(path.resolve().name for path in runs),
        drives=score.drives,
        episodes=sum(len(one.episodes) for one in score.drives),
        unfinished=unfinished_words(score.unfinished),
        errors=[(one.driver.label, episode) for one in score.drives for episode in one.errors],
        simulators=score.simulators,
        references=[one.label for one in score.references.values()],
        figures=drawn,
        caveat=score.caveat,
        ladder=ladder_table(score.ladder, score.references),
        paper=paper_table(beside) if beside else None,
        paper_words=paper_words(beside, score.ladder) if beside else [],
        paired=reference_tables(score) if score.paired else [],
        blind=[(one, FINDINGS[one.finding], _FINDINGS.get(one.finding, one.finding)) for one in score.blind],
        glyphs=GLYPHS,
        blind_table=blind_table(score.blind),
        audit=degeneracy_table(score.audit),
        audit_words=degeneracy_words(score.audit),
        replays=replay_table(score.replays) if score.replays else None,
        numbers=[*more, *long_tables(score)],
        twins=score.twins,
        repeats=score.repeats,
        made=[(path.resolve().name, made(path)) for path in runs],
        notes=browser.notes,
    )
    return Page(html, drawn, browser.notes)


def made(path: Path) -> Mapping[str, str]:
    """Return what the run says of how it was made, as text; nothing where it says nothing."""
    try:
        raw = json.loads((path / RUN).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    if not isinstance(raw, dict):
        return {}
    return {str(name): _text(value) for name, value in raw.items() if value not in (None, [], {})}


def _text(value: object) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {_text(one)}" for name, one in value.items())
    return ", ".join(map(_text, value)) if isinstance(value, list) else str(value)
