"""Sheets of the hierarchy: every source's rates, and every paired difference."""

from pathlib import Path

from eyechart.report.drives_sheets import DIFFERENCE, differences
from eyechart.report.sheets import Cell, Sheet, files_of
from eyechart.studies.hierarchy import HierarchyScore


def write_hierarchy_sheets(score: HierarchyScore, folder: Path) -> list[Path]:
    """Write the tables of a study as CSV, Markdown and LaTeX; return the files."""
    folder.mkdir(parents=True, exist_ok=True)
    made = {folder / name: content for name, content in files_of((_sources(score), _paired(score))).items()}
    for path, content in made.items():
        path.write_bytes(content)
    return list(made)


def _sources(score: HierarchyScore) -> Sheet:
    actions = next(iter(score.sources)).intents
    counted = ("fail-safe steps", "solver failures", "episodes in error", *actions)
    columns = (
        *((name, "text") for name in ("part", "name", "simulator", "source", "condition")),
        ("n", "count"),
        *(
            cell
            for name in ("goals", "crashes", "distance m", "STOP share")
            for cell in ((name, "number"), (f"{name} interval", "interval"))
        ),
        *((name, "count") for name in counted),
    )
    rows: list[tuple[Cell, ...]] = [
        (
            *(one.part, one.name, one.driver.simulator, one.driver.policy, one.driver.condition, one.goals.n),
            *(one.goals.value, one.goals.ci, one.crashes.value, one.crashes.ci),
            *(one.distance_m.value, one.distance_m.ci, one.stop_share.value, one.stop_share.ci),
            *(one.fail_safe, one.solver_failures, one.errors, *one.intents.values()),
        )
        for one in score.sources
    ]
    return Sheet("sources", "Sources of intent above the controller (Table t:mpc-intent)", columns, tuple(rows))


def _paired(score: HierarchyScore) -> Sheet:
    rows: list[tuple[Cell, ...]] = []
    for one in score.against_mpc_only:
        rows += differences(one, "")
    if score.oracle_mirrored is not None:
        rows += differences(score.oracle_mirrored, "positive control")
    for _, blind in score.blind:
        rows += differences(blind.paired, blind.finding)
    caption = "Differences in the same worlds: from MPC-only, the positive control, and real pictures less others"
    return Sheet("paired", caption, DIFFERENCE, tuple(rows))
