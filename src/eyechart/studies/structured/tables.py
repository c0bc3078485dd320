"""Tables of scene estimates: Table t:controller-local, admission, all figures, online drives."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

from eyechart.report.table import MARK, STATISTIC, Cell, Column, Mark, Table, columns, stack_tables, statistic_cells
from eyechart.stats.statistic import Statistic
from eyechart.studies.battery import CallsScore
from eyechart.studies.battery.subjects import ModelInRun, RunEvidence
from eyechart.studies.structured import EstimatorScore
from eyechart.studies.structured.online import CONTROL, OnlineScore
from eyechart.studies.structured.plans import ADMISSION
from eyechart.verdicts.admission import CLAUSES, ClauseResult

PAPER = (1.0, 1.0, 0.09, 1.0, 1.0, 1.0, 10)
"""The positive control's line of Table t:controller-local, on the paper's own 288 pairs.

It crashes in 0.167 of its 12 online episodes.
"""
CONTROLLERS = "Task-calibrated estimators"
"""The beginning of the title of Table t:controller-local, whose columns come from two runs."""
POSITIVE = "scripted:scene_positive_control"
"""The image-only positive control as an estimator; it drives when worlds are vetted."""
_ROW = {
    "parse": "parse",
    "bal. acc.": "balanced_accuracy",
    "MAE (m)": "gap_mae_m",
    "scene eq.": "scene_equivariance",
    "action eq.": "action_equivariance",
    "swap": "swap_rate",
}
_TOLD = 2
"""The clauses that the head of a page gives with their results; the table has all of them."""
_OUTCOME = {True: Mark("pass", "good"), False: Mark("fail", "bad"), None: Mark("cannot say", "open")}

Estimates = RunEvidence[EstimatorScore]
EstimatorInRun = ModelInRun[EstimatorScore]
"""A run of scene estimates, and a model in it."""

ScoredEstimator = tuple[str, EstimatorScore, Sequence[str]]
"""A model's label, its score, and its failed guards in words."""


def scored_of(everyone: Sequence[EstimatorInRun]) -> list[ScoredEstimator]:
    """Return the models of a report's evidence with their scores."""
    return [(who.label, who.model, who.run.score.marks(who.spec)) for who in everyone]


def tables_of(everyone: Sequence[ScoredEstimator]) -> tuple[Table, ...]:
    """Return every table of models with scene estimates."""
    return controller_table(everyone), clauses_table(everyone), figures_table(everyone)


def controller_table(everyone: Sequence[ScoredEstimator]) -> Table:
    """Return Table t:controller-local, a line per model, with the paper's control in the note."""
    rows: list[tuple[Cell, ...]] = []
    for label, score, fails in everyone:
        found, left = score.statistics, score.planned - score.answered
        admitted = Mark(*(("yes", "good") if score.is_admitted else ("no", "bad")), MARK if fails else "")
        unfinished = f"{left} of {score.planned} calls" if left > 0 else None
        rows.append((label, *(found[name] for name in _ROW.values()), found["swap_rate"].n, admitted, unfinished))
    named = (Column("estimator"), *columns("estimate", *_ROW), Column("turns", "count"), Column("admitted", "word"))
    caption = "Estimators side by side (Table t:controller-local); turns are the swap rate's denominator"
    paper = ", ".join(f"{name} {value:.3f}" for name, value in zip(_ROW, PAPER, strict=False))
    note = f"renderer positive (paper), on its own pairs: {paper} of {PAPER[-1]} turns. — cannot say"
    return Table("controllers", caption, (*named, Column("unfinished")), tuple(rows), note)


def paper_tables(scores: Mapping[str, CallsScore[EstimatorScore]]) -> Iterator[Table]:
    """Yield Table t:controller-local of runs by name; admission runs have a table of their own.

    The swap rate's denominator stands in parentheses.
    """
    whole, admission = (
        {name: score for name, score in scores.items() if (score.manifest.study == ADMISSION) is small}
        for small in (False, True)
    )
    if whole:
        yield _estimators(whole).labelled("t:controller-local")
    if admission:
        yield replace(_admitted(admission), name="admission")


def _estimators(scores: Mapping[str, CallsScore[EstimatorScore]]) -> Table:
    """Return a row per estimator in the paper's form; the caption gives the number of pairs."""
    form = (Column(name, "estimate", beside="n" if name == "swap" else "") for name in _ROW)
    named = (Column("estimator"), *form)
    models = {name: score.models for name, score in scores.items()}
    found = {
        name: Table("", "static", named, tuple(_figures(*each) for each in held.items()), about=CONTROLLERS)
        for name, held in models.items()
    }
    counts = [one.statistics["scene_equivariance"].n for held in models.values() for one in held.values()]
    return stack_tables(found).counted(counts, "pairs", "of original and mirror per estimator")


def _admitted(scores: Mapping[str, CallsScore[EstimatorScore]]) -> Table:
    """Return `_estimators` with admission, and the clauses that fail or cannot be said."""
    table = _estimators(scores)
    every = [model for run in scores.values() for model in run.models.values()]
    rows = tuple(
        (*row, "yes" if model.is_admitted else "no", "; ".join(_held_words(model.clauses)) or "all hold")
        for row, model in zip(table.rows, every, strict=True)
    )
    return replace(table, columns=(*table.columns, Column("admitted", "word"), Column("clauses")), rows=rows)


def _held_words(clauses: Iterable[ClauseResult]) -> Iterator[str]:
    for clause in clauses:
        if clause.passes is not True:
            yield f"{clause.name} {'fails' if clause.passes is False else 'cannot be said'}"


def _figures(spec: str, score: EstimatorScore) -> tuple[Cell, ...]:
    return (spec, *(score.statistics[name] for name in _ROW.values()))


def clauses_words(found: Iterable[tuple[str, bool | None, str]]) -> str:
    """Return in words the clauses that fail or cannot be said, from (name, holds, result)."""
    every = list(found)
    sentences = []
    for begins, outcome in (("It fails ", False), ("Cannot say: ", None)):
        mine = [_clause_words(name, because) for name, holds, because in every if holds is outcome]
        if mine:
            more = f"; and {len(mine) - _TOLD} more, below" if len(mine) > _TOLD else ""
            sentences.append(f"{begins}{'; '.join(mine[:_TOLD])}{more}.")
    return " ".join(sentences) or f"It meets all {len(every)} clauses."


def _clause_words(name: str, because: str) -> str:
    says = f", {CLAUSES[name].needs}" if name in CLAUSES else ""
    return f"{name}{says}: {because}"


def clauses_table(everyone: Sequence[ScoredEstimator]) -> Table:
    """Return one row per clause: what it needs, its value, and pass or fail."""
    held = ((label, clause) for label, score, _ in everyone for clause in score.clauses)
    return _held_table("clauses", "The clauses of admission, checked for each estimator", held)


def _held_table(name: str, caption: str, held: Iterable[tuple[str, ClauseResult]]) -> Table:
    rows = tuple(
        (
            label,
            one.name,
            one.least,
            *statistic_cells(one.statistic)[:-1],
            _OUTCOME[one.passes],
            one.clause.needs + (f" ({one.statistic.note})" if one.statistic.value is None else ""),
        )
        for label, one in held
    )
    named = (Column("estimator"), Column("clause", "word"), Column("at least", "number"), *STATISTIC[:-1])
    return Table(name, caption, (*named, Column("outcome", "word"), Column("what is counted")), rows)


def figures_table(everyone: Sequence[ScoredEstimator]) -> Table:
    """Return every figure, over all frames and over those before any collision."""
    rows = tuple(
        (label, scope, name, *statistic_cells(one)[:-1], "; ".join(filter(None, (one.method, one.note))))
        for label, score, _ in everyone
        for scope, found in (("all", score.statistics), ("before collision", score.before or {}))
        for name, one in found.items()
    )
    named = (Column("estimator"), *columns("word", "frames", "figure"), *STATISTIC[:-1], Column("method and note"))
    unsaid = [label for label, score, _ in everyone if score.before is None]
    note = f"The bank does not record collisions: {', '.join(unsaid)}." if unsaid else ""
    return Table("estimates", "Every figure of each estimator", named, rows, note)


def online_table(score: OnlineScore) -> Table:
    """Return one row per estimator: its crash rate, its decisions, and the steps without one."""
    actions, passed = score.manifest.action_space.actions, sum(check.why is None for check in score.vetted)
    worlds = f"{passed} of {len(score.vetted)} worlds pass the checks"
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (
            spec,
            one.crash_rate.n,
            one.crash_rate,
            *(one.decisions.get(name, 0) for name in actions),
            one.fail_safe,
            one.errors,
        )
        for spec, one in score.driven.items()
    )
    named = (Column("estimator"), Column("episodes", "count"), Column("crash", "estimate"))
    caption = f"online in {score.manifest.simulator}: {worlds}, view {score.manifest.view}"
    note = "The paper's positive control crashes in 0.167 of its 12 episodes. — cannot say"
    return Table("online", caption, (*named, *columns("count", *actions, "fail-safe", "errors")), rows, note)


def met_table(score: OnlineScore) -> Table:
    """Return one row per clause of admission, over the frames of an estimator's online drives."""
    held = ((spec, clause) for spec, driven in score.driven.items() for clause in driven.clauses)
    return _held_table("met", "The clauses of admission, checked on the frames of each estimator's drives", held)


def crashes_table(scores: Mapping[str, OnlineScore]) -> Table:
    """Return the online column of Table t:controller-local by run: an estimator's crash rate.

    The vetting drives are the positive control's row, unless it drove as an estimator. For runs in
    the same worlds they count once.
    """
    drove = any(POSITIVE in one.driven for one in scores.values())
    found, vettings = {}, []
    for name, score in scores.items():
        rows = []
        for spec, one in score.driven.items():
            if spec != CONTROL:
                rows.append((spec, one.crash_rate))
            elif not drove and score.vetted not in vettings:
                vettings.append(score.vetted)
                rows.append((POSITIVE, one.crash_rate))
        named = (Column("estimator"), Column("crash", "estimate", beside=""))
        found[name] = Table("", "online", named, tuple(rows), about=CONTROLLERS)
    table = stack_tables(found)
    counts = [row[1].n if isinstance(row[1], Statistic) else None for row in table.rows]
    return table.counted(counts, "episodes", "per estimator").labelled("t:controller-local")


def reading_words(score: EstimatorScore) -> list[str]:
    """Return in words whether a model is admitted, and its missing and repaired estimates."""
    partial = "" if score.answered >= score.planned else f"; {score.answered} of {score.planned} calls are answered"
    lines = [f"{score.model}: {'admitted' if score.is_admitted else 'not admitted'}{partial}"]
    for what, counts in (("no estimate", score.answers.reasons), ("repaired", score.answers.repairs)):
        if counts:
            lines.append(f"{what}: " + ", ".join(f"{name} {count}" for name, count in counts.items()))
    return lines
