"""The report page of episodes: ladder, blind baseline, audit and every drive, in one file.

Source of its figures: paper, Table t:baselines and figure fgr:mi.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from eyechart.report.charts import BLUE, HEAD, MUTED, WIDE, Drawing, dots, scattered, style
from eyechart.report.page import Page, PageSummary, Section, VerdictSummary, fill, parted
from eyechart.report.table import Table
from eyechart.studies import Tell, run_json
from eyechart.studies.closed_loop import DIFFERS, BlindBaseline, ClosedLoopScore, Degeneracy, LadderRow
from eyechart.studies.closed_loop.browser import PICTURED, drives_data
from eyechart.studies.closed_loop.ladder import CONSTANT, MARGINAL
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
from eyechart.studies.closed_loop.visual_dependence import blind_comparisons, comparison_words, named
from eyechart.verdicts.labels import SIGHT

MOST_ROWS = 40
"""The most drivers in a figure; the tables have all of them."""

_SIGHTED = 12
"""The most rows of the figure at the head of the page."""

_UNITS = {
    "success_rate": " (points)",
    "distance_m": " (m)",
    "reward": "",
    "speed_mps": " (m/s)",
    "crash_rate": " (points)",
}
_DRAWN = ("distance_m", "reward", "speed_mps", "crash_rate")
_BEST = {"distance_m": "more is better", "reward": "more is better", "crash_rate": "less is better"}


def drives_figures(score: ClosedLoopScore) -> dict[str, list[Drawing]]:
    """Return the figures by section; a section without data has none."""
    blind = {f"{named(one, score)} less {one.condition}": one for one in score.blind[:MOST_ROWS]}
    with style():
        rungs = sorted(score.ladder, key=lambda row: (row.driver.simulator, -(row.statistics["reward"].value or 0.0)))
        return {
            "ladder": [_dots(rungs[:MOST_ROWS], name) for name in _BEST] if rungs else [],
            "blind": [_paired(blind, name) for name in _DRAWN] if blind else [],
            "information": information(score.audit),
        }


def _dots(rungs: Sequence[LadderRow], name: str, across: float = WIDE) -> Drawing:
    form, found = MEASURES[name], [(rung.driver, rung.statistics[name]) for rung in rungs]
    rows = [(who.label, one, BLUE, who.policy.startswith("constant:")) for who, one in found]
    title = NAMES[name] if form.scale == 1.0 else f"{NAMES[name]} (%)"
    figure = dots(rows, f"{title}; {_BEST[name]}", form.scale, across=across)
    description = "; ".join(f"{who.label}: {form.shown(one)}" for who, one in found)
    says = f"Dots; rates with 95 % intervals; hollow: constant policies. {description}"
    return Drawing(f"ladder-{name}", f"The ladder: {title}", says, figure)


def _paired(baselines: Mapping[str, BlindBaseline], name: str, across: float = WIDE) -> Drawing:
    form, rows, descriptions = SIGNED[name], [], []
    for label, baseline in baselines.items():
        value = baseline.paired.differences[name]
        differs = name in baseline.paired.changed
        rows.append((label, value, BLUE if differs else MUTED, not differs))
        descriptions.append(f"{label}: {form.shown(value)}{', significant' if differs else ''}")
    what = NAMES[name].partition(" (")[0]
    figure = dots(rows, f"{what}, real less other{_UNITS[name]}", form.scale, zero=True, across=across)
    says = (
        f"Differences in the same worlds, rates with 95 % intervals; filled: significant after Holm. "
        f"{'; '.join(descriptions)}"
    )
    return Drawing(f"blind-{name}", f"Real pictures less others: {NAMES[name]}", says, figure)


def information(rows: Sequence[Degeneracy]) -> list[Drawing]:
    """Draw action entropy against information about the scene (figure fgr:mi), by driver."""
    points = []
    for row in rows:
        x, y = row.statistics["entropy_bits"].value, row.statistics["information_bits"].value
        if x is not None and y is not None:
            points.append((row.driver.label, x, y))
    if not points:
        return []
    names = ("action entropy over the drives (bits)", "I(A; scene) (bits)", "varied, and not about the scene")
    figure = scattered(points[:MOST_ROWS], *names)
    description = "; ".join(f"{name}: entropy {x:.2f}, information {y:.3f}" for name, x, y in points)
    says = f"High entropy with information near 0 (lower right) is variety without the scene. {description}."
    title = "Action entropy against information about the scene"
    return [Drawing("drives-information", title, says, figure, wide=True)]


_ANSWERS = {
    "sees": ("by sight",),
    "partly": ("in part by sight",),
    "blind": ("not by sight",),
    "open": ("cannot say", "for"),
}


def opening(score: ClosedLoopScore) -> PageSummary:
    """Return the opening of a page of drives: which drive by sight, and the best by score."""
    comparisons = blind_comparisons(score)
    said = [
        VerdictSummary(who, baseline.label.says, baseline.label.family, shows, why, "blind")
        for who, baseline in comparisons.items()
        for shows, why in [comparison_words(baseline)]
    ]
    if not comparisons:
        sentence = "Driving by sight was not tested: no driver drove the same worlds with other pictures too."
    else:
        sentence = parted(said, _ANSWERS, "drivers that were shown other pictures too")
    others = "shuffled ones" if all(baseline.is_of_camera for baseline in comparisons.values()) else "others"
    caption = f"Real pictures less {others}; right of the line: better with real ones. Filled: significant."
    return PageSummary(
        f"{sentence} {' '.join(_best(score))}".strip(),
        said,
        figure=sight(score, comparisons),
        caption=caption if comparisons else "",
    )


def _found(baseline: BlindBaseline) -> str:
    """Return the finding of a comparison in words, with the subject of a difference."""
    what = baseline.asks if baseline.is_of_pictures else "the timing of its actions matters"
    return f"differs: {what}" if baseline.finding == DIFFERS else SIGHT[baseline.finding].says


def _best(score: ClosedLoopScore) -> list[str]:
    """Return the best driver by reward in each simulator, in words, and whether it is blind."""
    result = []
    for simulator in score.simulators:
        rungs = [row for row in score.ladder if row.driver.simulator == simulator]
        best = max(rungs, key=lambda rung: rung.statistics["reward"].value or 0.0, default=None)
        if best is None or best.statistics["reward"].value is None:
            continue
        blind = best.driver.policy.startswith((CONSTANT, MARGINAL)) or best.driver.policy == "random"
        where = f" in {simulator}" if len(score.simulators) > 1 else ""
        reward = MEASURES["reward"].shown(best.statistics["reward"])
        sees = ", which sees nothing" if blind else ""
        n = best.statistics["reward"].n
        result.append(f"By score{where} {best.driver.label} comes first, reward {reward} over {n} episodes{sees}.")
    return result


def sight(score: ClosedLoopScore, baselines: Mapping[str, BlindBaseline]) -> Drawing | None:
    """Draw real pictures less others by driver; without such drives, the drivers by score."""
    for name in ("reward", "distance_m", "success_rate", "crash_rate"):
        if (drawing := sight_of(baselines, name)) is not None:
            return drawing
    with style():
        rungs = sorted(score.ladder, key=lambda row: -(row.statistics["reward"].value or 0.0))
        return replace(_dots(rungs[:_SIGHTED], "reward", HEAD), name="in-short") if rungs else None


def sight_of(baselines: Mapping[str, BlindBaseline], name: str) -> Drawing | None:
    """Draw real pictures less others in one measure, by driver; None where no value is known."""
    if not any(baseline.paired.differences[name].value is not None for baseline in baselines.values()):
        return None
    with style():
        return replace(_paired(dict(list(baselines.items())[:_SIGHTED]), name, HEAD), name="in-short")


@dataclass(frozen=True)
class StudyIntroduction:
    """A study's own part of the page, before the drives: question, answer and evidence.

    It replaces the question of driving by sight where no driver had other pictures too.
    """

    question: str
    answer: PageSummary
    section: Section


def make_drives_page(
    runs: Sequence[Path],
    score: ClosedLoopScore,
    first: StudyIntroduction | None = None,
    *,
    costs: Sequence[Table] = (),
    pictured: int = PICTURED,
    tell: Tell = lambda _: None,
) -> Page:
    """Return the report of runs of episodes; the same runs give the same bytes.

    ``costs`` are tables of the decisions' cost and time, ``first`` is the study's part before the
    drives; ``tell`` receives progress.
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
        question=first.question if first else "Which policies drive well, and which by sight?",
        answer=first.answer if first else opening(score),
        first=first.section if first else None,
        score=score,
        episodes=sum(len(drive.episodes) for drive in score.drives),
        unfinished=unfinished_words(score.unfinished),
        served=served_words(score.served),
        errors=[(drive.driver.label, episode) for drive in score.drives for episode in drive.errors],
        references=[reference.label for reference in score.references.values()],
        figures=drawn,
        ladder=ladder_table(score.ladder, score.references),
        paper=paper_table(beside) if beside else None,
        paper_words=paper_words(beside, score.ladder) if beside else [],
        paired=[replace(reference_table, note="") for reference_table in reference_tables(score)]
        if score.paired
        else [],  # the page has it
        blind=[(one, one.label.family, _found(one)) for one in score.blind],
        blind_table=blind_table(score.blind),
        audit=degeneracy_table(score.audit),
        audit_words=degeneracy_words(score.audit),
        replays=replay_table(score.replays) if score.replays else None,
        numbers=long_tables(score),
        made=[(path.resolve().name, made(path)) for path in runs],
        costs=costs,
        notes=browser.notes,
    )
    return Page(html, drawn, browser.notes)


def made(path: Path) -> Mapping[str, str]:
    """Return the manifest of the run as text; empty entries are left out."""
    return {name: _text(value) for name, value in run_json(path).items() if value not in (None, [], {})}


def _text(value: object) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {_text(one)}" for name, one in value.items())
    return ", ".join(map(_text, value)) if isinstance(value, list) else str(value)
