"""The page of policies: a verdict each, and the evidence below it."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from eyechart.report.accounts import costs_table
from eyechart.report.page import Section, page_of
from eyechart.report.table import Table
from eyechart.studies import Made
from eyechart.studies.policy.scoring import PolicyScore, judge
from eyechart.studies.policy.tables import channel_table, parts_table, statistics_table, verdict_table


def made(scores: Sequence[PolicyScore], banks: Sequence[Path]) -> Made:
    """Return the report of runs of policies."""
    del banks
    sections = [section for score in scores for section in _sections(score)]
    title = ", ".join(score.bank.name for score in scores)
    page = page_of("Does it look, and does it listen?", title, sections)
    return Made(page, [table for score in scores for table in _tables(score)], page.notes)


def _tables(score: PolicyScore) -> list[Table]:
    """Return what is written beside the page."""
    verdicts = judge(score)
    costs = costs_table(score.accounting, every=True)
    return [verdict_table(verdicts), channel_table(verdicts), statistics_table(score), parts_table(score), costs]


def _sections(score: PolicyScore) -> Iterator[Section]:
    verdicts = judge(score)
    yield Section("Verdicts", tables=[verdict_table(verdicts), channel_table(verdicts)])
    for spec, one in verdicts.items():
        lines = [f"{name}: {why}" for name, why in one.guards.items()]
        lines += [] if one.guards else [one.because]
        yield Section(spec, lines=[*lines, *one.remarks, one.scope])
    yield Section("Every statistic", tables=[*statistics_table(score).split(), parts_table(score)])
    yield Section("What the calls took", tables=[costs_table(score.accounting, every=False)])
