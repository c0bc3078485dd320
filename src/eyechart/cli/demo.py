"""``eyechart demo`` and ``calibrate``: known answers, tried offline."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer

from eyechart.cli.options import Json
from eyechart.cli.terminal import print_each, print_json, print_line, progress, resumable, say
from eyechart.errors import SpecError


def demo(
    out: Annotated[Path, typer.Option(help="Folder for the demo's bank and run.")] = Path("demo"),
    seed: Annotated[int, typer.Option(min=0, help="Another seed gives other episodes and other draws.")] = 0,
    vlm: Annotated[
        bool,
        typer.Option("--vlm", help="Ask the five model organisms; needs the extras 'organisms' and 'transformers'."),
    ] = False,
    policy: Annotated[
        bool,
        typer.Option(
            "--policy", help="Ask six tiny robot policies, which answer with motions; needs the extra 'organisms'."
        ),
    ] = False,
) -> None:
    """Build a highway bank, run all test controllers and print their verdicts.

    Every controller declares its correct verdict; exit 1 if one gets another. Sixteen controllers
    are scripted. --vlm runs five tiny real vision-language models instead, and --policy six tiny
    robot policies on a tabletop. A second call reuses the bank and the finished calls of the first.
    Example: eyechart demo --out demo
    """
    if policy:
        if vlm:
            raise typer.BadParameter("--vlm and --policy are different demos: give one of them")
        _demo_policies(out, seed)
        return
    from eyechart.studies.battery import demo as study
    from eyechart.studies.battery.tables import verdicts_printed

    found = study.make(out, seed, progress, resumable(), vlm=vlm)
    verdicts, run, wrong = found.verdicts, found.run, found.wrong
    if vlm:
        from eyechart.models.huggingface.organisms import ORGANISMS

        print_each(verdicts_printed(found.score, verdicts))
        print_line("The task that each was trained for, and the verdict that it deserves:")
        for name, one in ORGANISMS.items():
            print_line(f"  {name:<18} {one.calibrated:<18} {one.lateral:<14} {one.says}")
    else:
        _explained(found.explained, found.says)
    print_line(*(f"not as declared: {spec} declares {found.declared[spec]}" for spec in wrong))
    who = "organisms were trained for" if vlm else "controllers declared"
    print_line(f"{len(verdicts) - len(wrong)} of {len(verdicts)} verdicts are as the {who}.")
    say(
        f"every verdict and why: 'eyechart verdict {run}'",
        f"every picture and reply on one page: 'eyechart report {run} --out report.html'",
    )
    if wrong:
        raise typer.Exit(1)


_SHOWN = ("No", "In part", "Yes")
"""The answers; one controller is explained for each."""


def _explained(found: Mapping[str, tuple[str, str, str]], does: Mapping[str, str]) -> None:
    """Print one controller for each answer with its reason, and the others in a line each.

    ``found`` holds answer, label and reason by SPEC; ``does`` holds what each does.
    """
    import textwrap

    first = {one[0]: spec for spec, one in reversed(list(found.items()))}
    shown = [first[answer] for answer in _SHOWN if answer in first]
    for spec in shown:
        answer, label, why = found[spec]
        print_line(f"{answer}: {spec}, {label}")
        for words in (f"What it does: {does[spec]}.", f"The verdict: {why}"):
            print_line(textwrap.fill(words, 80, initial_indent="  ", subsequent_indent="  ", break_on_hyphens=False))
    print_line("")
    print_line(f"The {len(found) - len(shown)} others:")
    wide = max(map(len, found), default=0)
    for spec, (answer, label, _) in found.items():
        if spec not in shown:
            print_line(f"  {spec:<{wide}}  {answer:<12}  {label}")
    print_line("")


def _demo_policies(out: Path, seed: int) -> None:
    """Ask six trained policies about a tabletop; print their verdicts beside their training."""
    from contextlib import ExitStack

    from eyechart.studies.policy import demo as study

    with resumable(), ExitStack() as bars:
        _, found = study.make(out, seed, lambda preset: bars.enter_context(progress(preset, "calls")))
    verdicts = {spec: one.verdict for spec, one in found.items()}
    said = {
        spec: (verdict.answer, verdict.camera.label, verdict.because if verdict.guards else verdict.camera.because)
        for spec, verdict in verdicts.items()
    }
    _explained(said, {spec: one.says for spec, one in found.items()})
    print_each(f"not as trained: {spec}: {words}" for spec, one in found.items() for words in one.wrong)
    right = sum(not one.wrong for one in found.values())
    print_each([f"{right} of {len(found)} policies got the labels that they were trained for."])
    runs = " ".join(str(out / f"run-{preset}-{seed}") for preset in study.PRESETS)
    own = f"eyechart run policy --policy python:MODULE:FUNCTION --frames {out / f'bank-balanced-{seed}'} --out my-run"
    say(
        *(f"every verdict and why: 'eyechart verdict {run}'" for run in runs.split()),
        f"every picture and motion on one page: 'eyechart report {runs} --out report.html'",
        f"your own: '{own}'",
    )
    if right < len(found):
        raise typer.Exit(1)


def calibrate(
    replications: Annotated[int, typer.Option(min=1, help="Simulated banks for each setting.")] = 40,
    seed: Annotated[int, typer.Option(min=0, help="Seed of every random draw.")] = 0,
    processes: Annotated[int, typer.Option(min=1, help="Processes; the result does not depend on their number.")] = 2,
    setting: Annotated[list[str] | None, typer.Option(help="Only this setting; repeat for more.")] = None,
    policies: Annotated[
        bool,
        typer.Option("--policies", help="Test the rules for policies instead; --setting is part of a setting's name."),
    ] = False,
    keep: Annotated[
        Path | None, typer.Option(help="Keep each bank's outcome in this file, and continue from it.", dir_okay=False)
    ] = None,
    engine: Annotated[
        str, typer.Option(help="Where banks are simulated: local, or ray, as tasks on the cluster of RAY_ADDRESS.")
    ] = "local",
    json: Json = False,
) -> None:
    """Try the battery's tests and both sets of rules on simulated controllers with known answers.

    It prints confusion matrices, error rates, power and the share of undecided verdicts; see
    docs/calibration.md. With --policies it prints how often simulated policies got each label, and
    how often that label was false. Without --policies it needs the extra 'organisms'. Exit 0: all
    targets are met; 1: one is missed.
    Example: eyechart calibrate --replications 200 --keep banks.jsonl
    """
    if policies:
        if keep is not None:
            raise SpecError("--keep is for the banks of controllers; --policies always starts anew: leave out --keep")
        _calibrate_policies(replications, seed, processes, setting, engine=engine, json=json)
        return
    from eyechart.models import organisms_folder

    organisms_folder("'eyechart calibrate'")
    from eyechart_organisms.calibration import calibrate as run
    from eyechart_organisms.calibration.table import tables

    with progress("banks", "banks") as move:
        found = run(
            replications=replications,
            seed=seed,
            processes=processes,
            settings=setting or None,
            progress=move,
            keep=keep,
            engine=engine,
        )
    print_json(found.as_dict()) if json else print_line(tables(found))
    if found.misses():
        raise typer.Exit(1)


def _calibrate_policies(
    draws: int, seed: int, processes: int, chosen: list[str] | None, *, engine: str, json: bool
) -> None:
    """Print how often each setting got each label; exit 1 if a false one is too frequent."""
    from eyechart.calibrate import policies as simulated

    with progress("settings", "settings") as move:
        tried = list(
            simulated.try_rules(draws, seed=seed, processes=processes, chosen=chosen, engine=engine, progress=move)
        )
    print_json([rule.as_dict() for rule in tried]) if json else print_each([simulated.table(tried)], 200)
    if any(rule.is_missed for rule in tried):
        raise typer.Exit(1)
