"""Sheets of runs of scene estimates: Table t:controller-local, the clauses of admission, every figure."""

from collections.abc import Sequence
from pathlib import Path

from eyechart.report.estimates import Estimator
from eyechart.report.sheets import Cell, Sheet, files_of, level

_ROW = (
    ("parse", "parse"),
    ("bal. acc.", "balanced_accuracy"),
    ("MAE (m)", "gap_mae_m"),
    ("scene eq.", "scene_equivariance"),
    ("action eq.", "action_equivariance"),
    ("swap", "swap_rate"),
)
_OUTCOME = {True: "pass", False: "fail", None: "cannot say"}
_VALUE = (("value", "number"), ("interval", "interval"), ("level", "text"), ("n", "count"))


def estimates_files(everyone: Sequence[Estimator]) -> dict[str, bytes]:
    """Return the tables as CSV, Markdown and LaTeX, by their files' names."""
    return files_of((_controllers(everyone), _clauses(everyone), _figures(everyone)))


def write_estimates_sheets(everyone: Sequence[Estimator], folder: Path) -> list[Path]:
    """Write the tables as CSV, Markdown and LaTeX; return the files."""
    folder.mkdir(parents=True, exist_ok=True)
    made = {folder / name: content for name, content in estimates_files(everyone).items()}
    for path, content in made.items():
        path.write_bytes(content)
    return list(made)


def _controllers(everyone: Sequence[Estimator]) -> Sheet:
    columns = (
        ("estimator", "text"),
        *((name, "number") for name, _ in _ROW),
        ("turns", "count"),
        ("admitted", "text"),
        ("unfinished", "text"),
    )
    rows: list[tuple[Cell, ...]] = []
    for who in everyone:
        found, score = who.score.statistics, who.score
        left = score.planned - score.answered
        rows.append(
            (
                who.label,
                *(found[name].value for _, name in _ROW),
                found["swap_rate"].n,
                "yes" if score.admitted else "no",
                f"{left} of {score.planned} calls" if left > 0 else None,
            )
        )
    caption = "Estimators side by side (Table t:controller-local); turns are the swap rate's denominator"
    return Sheet("controllers", caption, columns, tuple(rows))


def _clauses(everyone: Sequence[Estimator]) -> Sheet:
    columns = (("estimator", "text"), ("clause", "text"), ("at least", "number"), *_VALUE, ("outcome", "text"))
    rows = tuple(
        (
            who.label,
            one.name,
            one.clause.least,
            one.statistic.value,
            one.statistic.ci,
            level(one.statistic),
            one.statistic.n,
            _OUTCOME[one.passes],
        )
        for who in everyone
        for one in who.score.clauses
    )
    return Sheet("clauses", "The clauses of admission, held against each estimator", columns, rows)


def _figures(everyone: Sequence[Estimator]) -> Sheet:
    columns = (("estimator", "text"), ("frames", "text"), ("figure", "text"), *_VALUE, ("method", "text"))
    rows: list[tuple[Cell, ...]] = []
    for who in everyone:
        for scope, found in (("all", who.score.statistics), ("before collision", who.score.before or {})):
            rows += [
                (
                    who.label,
                    scope,
                    name,
                    one.value,
                    one.ci,
                    level(one),
                    one.n,
                    "; ".join(filter(None, (one.method, one.note))),
                )
                for name, one in found.items()
            ]
    return Sheet(
        "estimates", "Every figure of each estimator", (*columns[:-1], ("method and note", "text")), tuple(rows)
    )
