"""Tables of the hierarchy: sources of intent beside the paper's, what they emitted, and whom completion tells apart."""

from collections.abc import Sequence

from rich.table import Table

from eyechart.stats.statistic import Statistic
from eyechart.studies.closed_loop import Paired
from eyechart.studies.hierarchy import Completion, Source
from eyechart.studies.hierarchy.planning import PARTS, name_of
from eyechart.studies.hierarchy.scoring import NOT_PERCEPTION, PUBLISHED, UNPUBLISHED

TITLES = {
    "primary": "Primary ablation: the controller knows the obstacles",
    "second": "Second ablation: it does not, but for mpc-oracle",
}


COLUMNS = ("intent source", "goal", "95 %", "paper", "crash", "95 %", "paper", "dist. m", "paper")
EMITTED = ("intent source", "intents", "STOP", "paper", "fail-safe", "solver failed", "no decision")


def source_table(sources: Sequence[Source], *, primary: bool) -> Table:
    """Return the rows of one ablation: goals and crashes with exact 95 % intervals, the paper's beside them.

    Episodes that ended in an error stand beside the name, and count in no rate.
    """
    table = Table(title=TITLES["primary" if primary else "second"])
    table.add_column(COLUMNS[0], no_wrap=True)
    for name in COLUMNS[1:]:
        table.add_column(name, justify="right", no_wrap=True)
    for one in sources:
        if one.part.startswith("primary") == primary:
            name, *cells = source_cells(one)
            table.add_row(f"{name} + {one.errors} in error" if one.errors else name, *cells)
    return table


def source_cells(one: Source) -> tuple[str, ...]:
    """Return a row of a source's table, as ``COLUMNS`` name its cells."""
    paper = PUBLISHED.get(one.name, UNPUBLISHED)
    return (
        one.name,
        _of(one.goals),
        _interval(one.goals),
        paper[0],
        _of(one.crashes),
        _interval(one.crashes),
        paper[1],
        _spread(one.distance_m, "{:.1f}"),
        "" if paper[2] is None else f"{paper[2]:.1f}",
    )


def intent_table(sources: Sequence[Source], *, primary: bool) -> Table:
    """Return what each source emitted, and where it did not: intents, the share of STOP among them, and the fail-safe.

    A STOP that the fail-safe executed counts in no share; ``no decision`` says how often it did, and why.
    """
    table = Table(title="What was emitted: STOP is a share of the intents [95 %], the fail-safe is no intent")
    table.add_column(EMITTED[0], no_wrap=True)
    for name in EMITTED[1:]:
        table.add_column(name, justify="left" if name == "no decision" else "right")
    for one in sources:
        if one.part.startswith("primary") == primary:
            table.add_row(*intent_cells(one))
    return table


def intent_cells(one: Source) -> tuple[str, ...]:
    """Return a row of what a source emitted, as ``EMITTED`` names its cells."""
    paper = PUBLISHED.get(one.name, UNPUBLISHED)[3]
    return (
        one.name,
        str(one.emitted),
        _spread(one.stop_share, "{:.1%}"),
        "" if paper is None else f"{paper:.1%}",
        str(one.fail_safe),
        str(one.solver_failures),
        ", ".join(f"{why} {count}" for why, count in one.no_decision.items()),
    )


def completion_table(completions: Sequence[Completion]) -> Table:
    """Return each model's goals with real pictures beside those without, and whether that shows perception."""
    table = Table(title="Goals of a model with its pictures, and of the same model without")
    table.add_column("arm", no_wrap=True)
    table.add_column("model")
    for name in ("real", "mirrored", "blank", "other worlds'"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("")
    for one in completions:
        goals = [one.goals.get(name) for name in ("real", "mirrored", "blank", "shuffled")]
        said = "differs from both" if one.shown else NOT_PERCEPTION
        table.add_row(
            PARTS[one.part].simulator, one.policy, *("" if each is None else _of(each) for each in goals), said
        )
    return table


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
        name_of("primary", one.first),
        str(one.worlds),
        _signed(goals.value, 100, " points"),
        _p(one.holm.get("success_rate")),
        _signed(distance.value, 1, ""),
        _p(one.holm.get("distance_m")),
    )


def goals_of(one: Source) -> str:
    """Return how many episodes reached the goal, of how many."""
    return _of(one.goals)


def _of(one: Statistic) -> str:
    return "—" if one.value is None else f"{round(one.value * one.n)}/{one.n}"


def _spread(one: Statistic, form: str) -> str:
    """Return a value with its interval."""
    if one.value is None:
        return "—"
    interval = "" if one.ci is None else f" [{form.format(one.ci[0])}, {form.format(one.ci[1])}]"
    return form.format(one.value) + interval


def _interval(one: Statistic) -> str:
    return "" if one.ci is None else f"{one.ci[0]:.2f}-{one.ci[1]:.2f}"


def _signed(value: float | None, scale: float, unit: str) -> str:
    return "—" if value is None else f"{scale * value:+.1f}{unit}"


def _p(p: float | None) -> str:
    return "—" if p is None else "<.001" if p < 0.001 else f"{p:.3f}"
