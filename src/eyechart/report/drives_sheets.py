"""Sheets of what drove: the ladder (Table t:baselines), paired differences and the audit (Table t:degeneracy)."""

from pathlib import Path

from eyechart.report.sheets import Cell, Sheet, files_of, level
from eyechart.studies.closed_loop import ClosedLoopScore, Driver, Paired

_STATISTIC = (("value", "number"), ("interval", "interval"), ("level", "text"), ("n", "count"), ("p", "p"))
_WHO = (("simulator", "text"), ("policy", "text"), ("condition", "text"), ("run", "text"))
DIFFERENCE = (
    *((name, "text") for name in ("first", "second", "statistic")),
    *_STATISTIC,
    ("Holm p", "p"),
    ("finding", "text"),
)
"""The columns of a sheet of paired differences."""


def write_drives_sheets(score: ClosedLoopScore, folder: Path) -> list[Path]:
    """Write the tables of runs of episodes as CSV, Markdown and LaTeX; return the files."""
    folder.mkdir(parents=True, exist_ok=True)
    sheets = (_ladder(score), _paired(score), _audit(score), _degeneracy(score))
    made = {folder / name: content for name, content in files_of(sheets).items()}
    for path, content in made.items():
        path.write_bytes(content)
    return list(made)


def _who(driver: Driver) -> tuple[Cell, ...]:
    return driver.simulator, driver.policy, driver.condition, driver.run


def _ladder(score: ClosedLoopScore) -> Sheet:
    rows = tuple(
        (*_who(one.driver), name, found.value, found.ci, level(found), found.n, found.p, found.method)
        for one in score.ladder
        for name, found in one.statistics.items()
    )
    columns = (*_WHO, ("statistic", "text"), *_STATISTIC, ("method", "text"))
    return Sheet("ladder", "The ladder (Table t:baselines), row by row", columns, rows)


def _paired(score: ClosedLoopScore) -> Sheet:
    rows: list[tuple[Cell, ...]] = []
    for one in score.paired:
        rows += differences(one, "")
    for blind in score.blind:
        rows += differences(blind.paired, blind.finding)
    beware = f" (beware: {score.caveat})" if score.caveat else ""
    caption = f"Differences in the same worlds: from the reference{beware}, and real pictures less others"
    return Sheet("paired", caption, DIFFERENCE, tuple(rows))


def differences(one: Paired, finding: str) -> list[tuple[Cell, ...]]:
    """Return a row for each statistic of a pair, as ``DIFFERENCE`` names its cells."""
    who = (one.first.label, one.second.label)
    return [
        (*who, name, found.value, found.ci, level(found), found.n, found.p, one.holm.get(name), finding)
        for name, found in one.differences.items()
    ]


def _audit(score: ClosedLoopScore) -> Sheet:
    rows = tuple(
        (*_who(one.driver), name, found.value, found.ci, level(found), found.n, found.p, found.note)
        for one in score.audit
        for name, found in one.statistics.items()
    )
    columns = (*_WHO, ("statistic", "text"), *_STATISTIC, ("note", "text"))
    return Sheet("audit", "The degeneracy audit, every number", columns, rows)


def _degeneracy(score: ClosedLoopScore) -> Sheet:
    names = ("modal_share", "distinct_actions", "entropy_bits", "information_bits", "information_share")
    rows = tuple(
        (
            *_who(one.driver),
            *(one.statistics[name].value for name in names),
            one.holm_naive,
            one.holm,
            one.statistics["unparsed_rate"].value,
            one.geometry,
            one.label,
        )
        for one in score.audit
    )
    numbers = tuple((name, "number") for name in names)
    tail = (("p (paper)", "p"), ("p (episodes)", "p"), ("no decision", "number"), ("scene", "text"), ("label", "text"))
    caption = "Policy degeneracy audit (Table t:degeneracy); both p Holm-corrected"
    return Sheet("degeneracy", caption, (*_WHO, *numbers, *tail), rows)
