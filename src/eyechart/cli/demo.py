"""``eyechart demo``: the main job on known-answer controllers, offline, in about a minute."""

from pathlib import Path
from typing import Annotated

import typer

from eyechart.cli.results import print_verdicts
from eyechart.cli.terminal import progress, say


def demo(
    out: Annotated[Path, typer.Option(help="Folder for the demo's bank and run.")] = Path("demo"),
) -> None:
    """Build a highway bank, run all sixteen known-answer controllers, and print their verdicts.

    Every controller declares the verdicts that it deserves, and each row says whether it got them. A second call
    uses the bank and the finished calls of the first. Exit 1 where a verdict is not as declared.
    """
    from eyechart.models.scripted import CONTROLLERS
    from eyechart.simulators import open_simulator
    from eyechart.studies import battery as study
    from eyechart.verdicts import judge

    bank, run = out / "bank", out / "run"
    if not bank.exists():
        with progress("frames", "frames") as move:
            open_simulator("highway").build(bank, progress=move)
    planned = study.plan(bank, [f"scripted:{name}" for name in CONTROLLERS], run)
    with progress("calls", "calls") as move:
        study.run(planned, progress=move)
    verdicts = judge(study.score(run))
    print_verdicts(verdicts)
    wrong = [
        f"{spec}: {one.calibrated.label}, declared {CONTROLLERS[spec.partition(':')[2]].declared.calibrated}"
        for spec, one in verdicts.items()
        if one.calibrated.label != CONTROLLERS[spec.partition(":")[2]].declared.calibrated
    ]
    say(f"{len(verdicts) - len(wrong)} of {len(verdicts)} verdicts are as the controllers declared")
    for line in wrong:
        say(f"not as declared: {line}")
    say(f"the pictures: 'eyechart frames show {bank} --out sheet.png'; every number: 'eyechart score {run}'")
    if wrong:
        raise typer.Exit(1)
