"""``eyechart list``: what there is to choose from."""

import typer

from eyechart.cli.options import Json
from eyechart.cli.terminal import print_json

app = typer.Typer(help="List models, conditions, prompts and simulators.", no_args_is_help=True)


def _show(rows: dict[str, str], *, json: bool) -> None:
    if json:
        print_json(rows)
        return
    wide = max(len(name) for name in rows)
    for name, says in rows.items():
        typer.echo(f"{name:<{wide}}  {says}")


@app.command()
def models(json: Json = False) -> None:
    """List the models that there are, and how others are named; scripted ones and organisms are known answers."""
    from eyechart.models import known_models

    _show(known_models(), json=json)


@app.command()
def conditions(json: Json = False) -> None:
    """List the input conditions and what each asks."""
    from eyechart.conditions import CONDITIONS

    _show({name: f"{one.image}: {one.asks}" for name, one in CONDITIONS.items()}, json=json)


@app.command()
def prompts(json: Json = False) -> None:
    """List the prompt formulations with their key and wording."""
    from eyechart.prompts import PROMPTS

    wording = {name: f"{one.key}  {' '.join(f'{one.system} {one.user}'.split())}" for name, one in PROMPTS.items()}
    _show(wording, json=json)


@app.command()
def simulators(json: Json = False) -> None:
    """List the simulators, the presets of their banks and the scenarios of their drives."""
    from eyechart.simulators import KINDS, SIMULATORS, find_simulator

    declared = {name: find_simulator(name).declared for name in SIMULATORS}
    rows = {
        f"{name} --{option} {choice}": says
        for name, one in declared.items()
        for option, choices in (("preset", one.presets), ("scenarios", one.scenarios))
        for choice, says in choices.items()
    }
    rows |= {written: says for written, says, _ in KINDS.values()}
    _show(rows, json=json)
