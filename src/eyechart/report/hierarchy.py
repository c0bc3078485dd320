"""Tables of the hierarchy: sources of intent beside the paper's, and each held against the controller alone."""

from collections.abc import Sequence

from rich.table import Table

from eyechart.stats.statistic import Statistic
from eyechart.studies.closed_loop import Paired
from eyechart.studies.hierarchy import Source
from eyechart.studies.hierarchy.planning import MPC_ONLY, PARTS
from eyechart.studies.hierarchy.scoring import PUBLISHED

TITLES = {
    "primary": "Primary ablation: the controller knows the obstacles",
    "second": "Second ablation: it does not, but for mpc-oracle",
}
COLUMNS = (
    "intent source",
    "goal",
    "95 %",
    "paper",
    "crash",
    "95 %",
    "paper",
    "dist. m",
    "STOP",
    "fail-safe",
    "solver failed",
)
_NAMES = {
    ("primary", MPC_ONLY): "MPC-only (= constant:STRAIGHT)",
    ("primary", "route"): "oracle intent",
    ("primary", "random"): "random intent",
    ("constrained", MPC_ONLY): "mpc-oracle",
    ("unaware", MPC_ONLY): "mpc-blind",
    ("lateral", "route"): "oracle, lateral intent",
    ("lateral", "mirrored:route"): "oracle, lateral intent, mirrored",
}


def source_table(sources: Sequence[Source], *, primary: bool) -> Table:
    """Return the rows of one ablation: goals and crashes with exact 95 % intervals, the paper's beside them."""
    table = Table(title=TITLES["primary" if primary else "second"])
    table.add_column(COLUMNS[0], no_wrap=True)
    for name in COLUMNS[1:]:
        table.add_column(name, justify="right", no_wrap=True)
    for one in sources:
        if one.part.startswith("primary") == primary:
            table.add_row(*source_cells(one))
    return table


def source_cells(one: Source) -> tuple[str, ...]:
    """Return a row of a source's table, as ``COLUMNS`` name its cells."""
    paper = PUBLISHED.get((one.part, one.driver.policy, one.driver.condition), ("", "", None, None))
    return (
        name_of(one),
        goals_of(one),
        _interval(one.goals),
        paper[0],
        _of(one.crashes),
        _interval(one.crashes),
        paper[1],
        "—" if one.distance_m is None else f"{one.distance_m:.1f}",
        "—" if one.stop_share is None else f"{one.stop_share:.1%}",
        str(one.fail_safe),
        str(one.solver_failures),
    )


def against_table(pairs: Sequence[Paired]) -> Table:
    """Return each source less MPC-only in the same worlds, exact tests, p after Holm."""
    table = Table(title="Less MPC-only in the same worlds; p after Holm")
    table.add_column("intent source", no_wrap=True)
    for name in ("worlds", "goals", "p", "distance m", "p"):
        table.add_column(name, justify="right")
    for one in pairs:
        table.add_row(*against_cells(one))
    return table


def against_cells(one: Paired) -> tuple[str, ...]:
    """Return a row of a table of paired differences: source, worlds, goals and p, distance and p."""
    goals, distance = one.differences["success_rate"], one.differences["distance_m"]
    return (
        one.first.label,
        str(one.worlds),
        _signed(goals.value, 100, " points"),
        _p(one.holm.get("success_rate")),
        _signed(distance.value, 1, ""),
        _p(one.holm.get("distance_m")),
    )


def name_of(one: Source) -> str:
    """Return how a source is called in tables and figures."""
    named = _NAMES.get((one.part, one.driver.policy))
    if named is not None and one.driver.condition == "real":
        return named
    arm = PARTS[one.part].simulator.removeprefix("rover-mpc").removeprefix("-")
    return f"{one.driver.label}{f', {arm}' if arm else ''}"


def goals_of(one: Source) -> str:
    """Return how many episodes reached the goal, of how many."""
    return _of(one.goals)


def _of(one: Statistic) -> str:
    return "—" if one.value is None else f"{round(one.value * one.n)}/{one.n}"


def _interval(one: Statistic) -> str:
    return "" if one.ci is None else f"{one.ci[0]:.2f}-{one.ci[1]:.2f}"


def _signed(value: float | None, scale: float, unit: str) -> str:
    return "—" if value is None else f"{scale * value:+.1f}{unit}"


def _p(p: float | None) -> str:
    return "—" if p is None else "<.001" if p < 0.001 else f"{p:.3f}"
