"""Tables of the structured arm for the terminal: Table t:controller-local, the clauses of admission, every figure."""

from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from eyechart.report.tables import MARK
from eyechart.stats.statistic import Statistic
from eyechart.studies.structured import EstimatorScore, StructuredScore
from eyechart.studies.structured.online import OnlineScore

PAPER = ("renderer positive (paper)", "1.000", "1.000", "0.090", "1.000", "1.000", "1.000 (10)", "0.167")
"""The first line of Table t:controller-local, on the paper's own 288 pairs."""

_OUTCOME = {True: "pass", False: "FAIL", None: "cannot say"}
_STYLE = {True: "green", False: "red", None: "yellow"}


def controller_table(score: StructuredScore) -> Table:
    """Return Table t:controller-local: a line a model, below the paper's line of its positive control."""
    title = f"{score.manifest.study}: {score.pairs} pairs of {score.bank.name}, view {score.manifest.view}"
    caption = "Swap denominators are in parentheses; crash rates are of online runs. — cannot say"
    table = Table(box=SIMPLE_HEAD, pad_edge=False, title=Text(title), title_justify="left", caption=caption)
    table.add_column("estimator", no_wrap=True)
    for name in ("parse", "bal. acc.", "MAE (m)", "scene eq.", "action eq.", "swap (n)", "crash", "admitted"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_row(*PAPER, "—", style="dim", end_section=True)
    for spec, one in score.models.items():
        found = one.statistics
        names = ("parse", "balanced_accuracy", "gap_mae_m", "scene_equivariance", "action_equivariance")
        swap = found["swap_rate"]
        mark = MARK if marks(score, spec) else ""
        admitted = Text(f"{'yes' if one.admitted else 'no'}{mark}", style="green" if one.admitted else "red")
        table.add_row(
            Text(spec), *(_number(found[name]) for name in names), f"{_number(swap)} ({swap.n})", "—", admitted
        )
    return table


def marks(score: StructuredScore, spec: str) -> list[str]:
    """Return in words which guards a model's calls fail; a mark behind its admission stands for them."""
    return [f"guard '{one.name}' fails: {one.because}" for one in score.guards[spec] if one.holds is False]


def clauses_table(score: EstimatorScore) -> Table:
    """Return one row a clause: what it asks for, what was found, and pass or fail."""
    words = "admitted" if score.admitted else "not admitted"
    partial = "" if score.answered >= score.planned else f"; {score.answered} of {score.planned} calls are answered"
    title = Text(f"{score.model}: {words}{partial}")
    table = Table(box=SIMPLE_HEAD, pad_edge=False, title=title, title_justify="left")
    table.add_column("clause", no_wrap=True)
    for name in ("at least", "value", "95 % interval", "n"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("", no_wrap=True)
    table.add_column("what is counted", overflow="fold")
    for held in score.clauses:
        whole = held.clause.least >= 1
        table.add_row(
            held.name,
            f"{held.clause.least:.0f}" if whole else f"{held.clause.least:.2f}",
            _number(held.statistic, 0 if whole else 3),
            _interval(held.statistic),
            str(held.statistic.n),
            Text(_OUTCOME[held.passes], style=_STYLE[held.passes]),
            held.clause.says,
        )
    return table


def figures_table(score: EstimatorScore) -> Table:
    """Return every figure of one model, over all frames and over those before any collision."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, title=Text(score.model), title_justify="left")
    table.add_column("figure", no_wrap=True)
    for scope in ("all frames", "before collision"):
        table.add_column(scope, justify="right")
        table.add_column("95 % interval", justify="right")
        table.add_column("n", justify="right")
    table.add_column("note", overflow="fold")
    for name, one in score.statistics.items():
        before = None if score.before is None else score.before[name]
        row = ["—", "—", "—"] if before is None else [_number(before), _interval(before), str(before.n)]
        note = "the bank does not record collisions" if before is None else one.note
        table.add_row(name, _number(one), _interval(one), str(one.n), *row, Text(note))
    return table


def online_table(score: OnlineScore) -> Table:
    """Return one row an estimator: its crash rate, its decisions, and how often it gave none."""
    passed = sum(one.why is None for one in score.vetted)
    worlds = f"{passed} of {len(score.vetted)} worlds pass the checks"
    title = f"online in {score.manifest.simulator}: {worlds}, view {score.manifest.view}"
    caption = "The paper's positive control crashes in 0.167 of its 12 episodes. — cannot say"
    table = Table(box=SIMPLE_HEAD, pad_edge=False, title=Text(title), title_justify="left", caption=caption)
    table.add_column("estimator", no_wrap=True)
    for name in ("episodes", "crash", "95 % interval", *score.manifest.action_space.actions, "fail-safe", "errors"):
        table.add_column(name, justify="right", no_wrap=True)
    for spec, one in score.driven.items():
        decided = (str(one.decisions.get(name, 0)) for name in score.manifest.action_space.actions)
        crash = one.crash_rate
        table.add_row(
            Text(spec),
            str(crash.n),
            _number(crash),
            _interval(crash),
            *decided,
            str(one.fail_safe),
            str(one.errors),
        )
    return table


def reading_words(score: EstimatorScore) -> list[str]:
    """Return in words how many replies held no estimate and why, and what was repaired in others."""
    lines = []
    for what, counts in (("no estimate", score.told.reasons), ("repaired", score.told.repairs)):
        if counts:
            lines.append(f"{what}: " + ", ".join(f"{name} {count}" for name, count in counts.items()))
    return lines


def _number(one: Statistic, digits: int = 3) -> str:
    return "—" if one.value is None else f"{one.value:.{digits}f}"


def _interval(one: Statistic) -> str:
    return "—" if one.ci is None else f"[{one.ci[0]:.3f}, {one.ci[1]:.3f}]"
