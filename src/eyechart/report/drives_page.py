"""The page of runs of episodes: the ladder, the blind baseline, the audit and every drive, in one file."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from eyechart.manifest import RUN
from eyechart.report.assets import fill
from eyechart.report.drives_browser import PICTURED, Tell, drives_data
from eyechart.report.drives_figures import drives_figures
from eyechart.report.page import Page
from eyechart.report.rungs import NAMES, degeneracy_words, paper_words, share, shown, unfinished_words
from eyechart.report.tables import number, p_value
from eyechart.studies.closed_loop import Blind, ClosedLoopScore, Degeneracy, Paired, Replay
from eyechart.studies.closed_loop.published import PUBLISHED, Beside, beside_paper

Row = Sequence[str]

_FINDINGS = {
    "differs": ("sees", "●", "differs"),
    "no_difference_found": ("open", "?", "no difference found"),
    "identical": ("blind", "○", "identical drives"),
    "cannot_say": ("open", "–", "cannot say"),
}


def make_drives_page(
    runs: Sequence[Path], score: ClosedLoopScore, *, pictured: int = PICTURED, tell: Tell = lambda _: None
) -> Page:
    """Return the report of runs of episodes; the same runs give the same bytes. ``tell`` is told what is under way."""
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
        columns=list(NAMES.values()),
        ladder=_ladder(score),
        paper=[_beside(one) for one in beside],
        paper_words=paper_words(beside, score.ladder) if beside else [],
        paired=[_paired(one) for one in score.paired],
        blind=[_blind(one) for one in score.blind],
        audit=[_degeneracy(one) for one in score.audit],
        audit_words=degeneracy_words(score.audit),
        replays=[_replay(one) for one in score.replays],
        twins=score.twins,
        repeats=score.repeats,
        made=[(path.resolve().name, made(path)) for path in runs],
        notes=browser.notes,
    )
    return Page(html, drawn, browser.notes)


def _ladder(score: ClosedLoopScore) -> list[dict[str, object]]:
    rungs = sorted(score.ladder, key=lambda one: (one.driver.simulator, -(one.statistics["reward"].value or 0.0)))
    return [
        {
            "label": one.driver.label,
            "simulator": one.driver.simulator,
            "reference": one.driver in score.references.values(),
            "n": one.statistics["reward"].n,
            "errors": one.errors,
            "cells": [shown(one.statistics[name], name) for name in NAMES],
        }
        for one in rungs
    ]


def _beside(row: Beside) -> Row:
    cells = [row.rung.driver.policy]
    for name, theirs in PUBLISHED[row.rung.driver.policy].items():
        value, by = row.rung.statistics[name].value, row.differences.get(name)
        scale, unit = (100.0, " points") if name == "crash_rate" else (1.0, " %")
        cells += [
            number(None if value is None else scale * value, 1 if scale > 1 or name != "reward" else 2),
            number(scale * theirs, 1 if scale > 1 or name != "reward" else 2),
            "—" if by is None else f"{100 * by:+.1f}{unit}",
        ]
    return cells


def _paired(one: Paired) -> dict[str, object]:
    return {"label": one.first.label, "against": one.second.label, "worlds": one.worlds, "cells": difference_cells(one)}


def difference_cells(one: Paired) -> list[tuple[str, str]]:
    """Return each difference as a page shows it, with its p after Holm."""
    return [(shown(one.differences[name], name, signed=True), p_value(one.holm.get(name))) for name in NAMES]


def _blind(one: Blind) -> dict[str, object]:
    family, glyph, words = _FINDINGS[one.finding]
    return {
        "label": one.driver.label,
        "condition": one.condition,
        "family": family,
        "glyph": glyph,
        "finding": words,
        "sentence": one.sentence,
        "worlds": one.paired.worlds,
        "cells": difference_cells(one.paired),
    }


def _degeneracy(row: Degeneracy) -> dict[str, object]:
    found, varies = row.statistics, (row.statistics["distinct_actions"].value or 0) > 1
    unparsed = found["unparsed_rate"].value
    reasons = ", ".join(f"{count} {reason}" for reason, count in row.reasons.items())
    return {
        "label": row.driver.label,
        "simulator": row.driver.simulator,
        "geometry": row.geometry or "—",
        "reads": row.label,
        "cells": [
            str(found["modal_share"].n),
            number(found["modal_share"].value),
            number(found["distinct_actions"].value, 0),
            number(found["entropy_bits"].value, 2),
            number(found["information_bits"].value) if varies else "—",
            number(found["information_share"].value) if varies else "—",
            p_value(row.holm_naive) if varies else "—",
            p_value(row.holm) if varies else "—",
            "—" if unparsed is None else f"{100 * unparsed:.1f} %",
        ],
        "reasons": reasons,
    }


def _replay(one: Replay) -> Row:
    best = one.best_constant
    return (
        one.driver.label,
        one.controller,
        str(one.agreement.n),
        share(one.agreement),
        "—" if best is None else f"{best[0]} {best[1]:.3f}",
        share(one.shuffled),
        p_value(one.shuffled.p),
    )


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
