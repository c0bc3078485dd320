"""``eyechart compare`` holds two runs against each other; ``eyechart transfer`` holds runs against external scores."""

from pathlib import Path
from typing import Annotated

import typer

from eyechart.cli.options import Json
from eyechart.cli.terminal import print_json, table_console


def compare(
    first: Annotated[Path, typer.Argument(help="Folder of a run.")],
    second: Annotated[Path, typer.Argument(help="Folder of its replication.")],
    every: Annotated[bool, typer.Option("--all", help="Print every statistic, not only the main ones.")] = False,
    resamples: Annotated[int, typer.Option(min=999, help="Exchanges of the runs, and resamples of episodes.")] = 2000,
    json: Json = False,
) -> None:
    """Compare two runs on one bank, per verdict and per statistic, with a test of difference.

    Exit 0: every verdict and statistic came out again; 1: something differs; 2: the runs cannot be compared.
    Example: eyechart compare monday tuesday
    """
    from eyechart.compare import compare as compared
    from eyechart.report.tables import MARK, replication_table
    from eyechart.studies import battery

    found = compared(battery.score(first), battery.score(second), resamples=resamples)
    if json:
        print_json(found.as_dict())
    else:
        console = table_console()
        for line in found.apart:
            console.print(f"not the same: {line}", markup=False)
        for line in found.marks:
            console.print(f"{MARK} {line}", markup=False)
        for one in found.models.values():
            console.print(replication_table(one, every=every))
            changed = f"differs in {', '.join(one.changed)}" if one.changed else "no statistic differs (Holm)"
            pairs = (f"{name} {a}" if a == b else f"{name} {a}, then {b}" for name, (a, b) in one.labels.items())
            console.print(f"{one.model}: {'; '.join(pairs)}; {changed}", markup=False, style="bold")
    if not found.replicated:
        raise typer.Exit(1)


def transfer(
    runs: Annotated[list[Path], typer.Argument(help="Folders of runs.")],
    scores: Annotated[Path, typer.Option(help="CSV file with the columns model and score.")],
    measure: Annotated[
        str, typer.Option(help="The statistic that stands for grounding, as 'eyechart score' names it.")
    ] = "mutual_information.decision",
    json: Json = False,
) -> None:
    """Correlate scores from elsewhere with grounding, over the models of the runs.

    Example: eyechart transfer run-highway run-rover --scores perception.csv
    """
    from eyechart.report.table import number, p_value
    from eyechart.studies import battery
    from eyechart.transfer import read_scores
    from eyechart.transfer import transfer as correlated

    external = read_scores(scores)
    found = correlated([battery.score(run) for run in runs], external, measure=measure)
    if json:
        print_json(found.as_dict())
        return
    console = table_console()
    for cell in found.cells:
        mean = f" (mean of {cell.runs} runs)" if cell.runs > 1 else ""
        words = f"{cell.model} on {cell.bank}: score {cell.score:g}, {measure} {cell.measured:.3f}{mean}"
        console.print(words, markup=False)
    for line in found.left_out:
        console.print(f"left out: {line}", markup=False)
    for name, one in (("Pearson", found.pearson), ("Spearman", found.spearman)):
        interval = "—" if one.ci is None else f"[{one.ci[0]:.3f}, {one.ci[1]:.3f}]"
        why = f" ({one.note})" if one.note else ""
        words = f"{name} r = {number(one.value)}, 95 % interval {interval}, p {p_value(one.p)}, n {one.n}{why}"
        console.print(words, markup=False)
