"""The page of runs of episodes: the ladder, the blind baseline, the audit and every drive, in one file.

Source of its figures: paper, Table t:baselines and figure fgr:mi.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

from eyechart.report.charts import BLUE, MUTED, VERMILLION, Drawing, dots, scattered, style
from eyechart.report.page import Page, fill
from eyechart.report.table import Table
from eyechart.studies import Tell, run_json
from eyechart.studies.closed_loop import Blind, ClosedLoopScore, Degeneracy, Rung
from eyechart.studies.closed_loop.browser import PICTURED, drives_data
from eyechart.studies.closed_loop.tables import (
    MEASURES,
    NAMES,
    SIGNED,
    beside_paper,
    blind_table,
    degeneracy_table,
    degeneracy_words,
    ladder_table,
    long_tables,
    paper_table,
    paper_words,
    reference_tables,
    replay_table,
    served_words,
    unfinished_words,
)

MOST_ROWS = 40
"""Drivers in a figure; the tables have all of them."""

_UNITS = {"distance_m": " (m)", "reward": "", "speed_mps": " (m/s)", "crash_rate": " (points)"}
_BEST = {"distance_m": "more is better", "reward": "more is better", "crash_rate": "less is better"}


def drives_figures(score: ClosedLoopScore) -> dict[str, list[Drawing]]:
    """Return the figures by section; a section without data has none."""
    with style():
        rungs = sorted(score.ladder, key=lambda one: (one.driver.simulator, -(one.statistics["reward"].value or 0.0)))
        return {
            "ladder": [_dots(rungs[:MOST_ROWS], name) for name in _BEST] if rungs else [],
            "blind": [_paired(score.blind[:MOST_ROWS], name) for name in _UNITS] if score.blind else [],
            "information": _information(score.audit),
        }


def _dots(rungs: Sequence[Rung], name: str) -> Drawing:
    form, found = MEASURES[name], [(one.driver, one.statistics[name]) for one in rungs]
    rows = [(who.label, one, BLUE, who.policy.startswith("constant:")) for who, one in found]
    title = NAMES[name] if form.scale == 1.0 else f"{NAMES[name]} (%)"
    figure = dots(rows, f"{title}; {_BEST[name]}", form.scale)
    told = "; ".join(f"{who.label}: {form.shown(one)}" for who, one in found)
    says = f"Dots with 95 % intervals over episodes; hollow: constant policies. {told}"
    return Drawing(f"ladder-{name}", f"The ladder: {title}", says, figure)


def _paired(found: Sequence[Blind], name: str) -> Drawing:
    form, rows, told = SIGNED[name], [], []
    for one in found:
        label, value = f"{one.driver.label} less {one.condition}", one.paired.differences[name]
        differs = name in one.paired.changed
        rows.append((label, value, VERMILLION if differs else MUTED, not differs))
        told.append(f"{label}: {form.shown(value)}{', significant' if differs else ''}")
    what = NAMES[name].partition(" (")[0]
    figure = dots(rows, f"{what}, real less other{_UNITS[name]}", form.scale, zero=True)
    says = f"Differences in the same worlds with 95 % intervals; filled: significant after Holm. {'; '.join(told)}"
    return Drawing(f"blind-{name}", f"Real pictures less others: {NAMES[name]}", says, figure)


def _information(rows: Sequence[Degeneracy]) -> list[Drawing]:
    points = []
    for row in rows:
        x, y = row.statistics["entropy_bits"].value, row.statistics["information_bits"].value
        if x is not None and y is not None:
            points.append((row.driver.label, x, y))
    if not points:
        return []
    names = ("action entropy over the drives (bits)", "I(A; scene) (bits)", "varied, and not about the scene")
    figure = scattered(points[:MOST_ROWS], *names)
    told = "; ".join(f"{name}: entropy {x:.2f}, information {y:.3f}" for name, x, y in points)
    says = f"High entropy with information near 0 (lower right) is variety without the scene. {told}."
    title = "Action entropy against information about the scene"
    return [Drawing("drives-information", title, says, figure, wide=True)]


GLYPHS = {"sees": "●", "partly": "◐", "blind": "○", "open": "?"}
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
        served=served_words(score.served),
        errors=[(one.driver.label, episode) for one in score.drives for episode in one.errors],
        simulators=score.simulators,
        references=[one.label for one in score.references.values()],
        figures=drawn,
        caveat=score.caveat,
        ladder=ladder_table(score.ladder, score.references),
        paper=paper_table(beside) if beside else None,
        paper_words=paper_words(beside, score.ladder) if beside else [],
        paired=reference_tables(score) if score.paired else [],
        blind=[(one, one.tone, _FINDINGS.get(one.finding, f"differs: {one.asks}")) for one in score.blind],
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
    return {name: _text(value) for name, value in run_json(path).items() if value not in (None, [], {})}


def _text(value: object) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {_text(one)}" for name, one in value.items())
    return ", ".join(map(_text, value)) if isinstance(value, list) else str(value)
