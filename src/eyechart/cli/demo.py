"""``eyechart demo``: the main job on known-answer controllers, offline, in about a minute."""

from pathlib import Path
from typing import Annotated

import typer

from eyechart.cli.results import print_table
from eyechart.cli.terminal import progress, resumable, say


def demo(
    out: Annotated[Path, typer.Option(help="Folder for the demo's bank and run.")] = Path("demo"),
    seed: Annotated[int, typer.Option(min=0, help="Another seed: other episodes, other draws.")] = 0,
) -> None:
    """Build a highway bank, run all sixteen known-answer controllers, and print their verdicts.

    Every controller declares the verdict that it deserves; exit 1 where one got another. A second call uses the
    bank and the finished calls of the first. Example: eyechart demo --out demo
    """
    from eyechart.models.scripted import CONTROLLERS
    from eyechart.simulators import open_simulator
    from eyechart.studies import battery as study
    from eyechart.verdicts import judge

    bank, run = out / f"bank-{seed}", out / f"run-{seed}"
    if not bank.exists():
        with progress("frames", "frames") as move:
            open_simulator("highway").build(bank, seeds=range(3 * seed, 3 * seed + 3), progress=move)
    planned = study.plan(bank, [f"scripted:{name}" for name in CONTROLLERS], run, seed=seed)
    with resumable(), progress("calls", "calls") as move:
        study.run(planned, progress=move)
    scored = study.score(run)
    verdicts = judge(scored)
    print_table(scored, verdicts)
    declared = {f"scripted:{name}": one.declared.calibrated for name, one in CONTROLLERS.items()}
    wrong = [spec for spec, one in verdicts.items() if one.calibrated.label != declared[spec]]
    for spec in wrong:
        typer.echo(f"not as declared: {spec} declares {declared[spec]}")
    typer.echo(f"{len(verdicts) - len(wrong)} of {len(verdicts)} verdicts are as the controllers declared.")
    say(f"the pictures: 'eyechart frames show {bank} --out sheet.png'; every number: 'eyechart score {run}'")
    if wrong:
        raise typer.Exit(1)
