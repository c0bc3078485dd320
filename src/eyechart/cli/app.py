"""The tree of commands."""

from collections.abc import Sequence
from copy import copy
from typing import Annotated

import typer

from eyechart import __version__
from eyechart.cli import answers, bundle, demo, drive, frames, guardian, look, probe, run, score
from eyechart.cli.help import Command, CommandGroup, Commands
from eyechart.cli.options import Json, from_one_folder
from eyechart.cli.terminal import output_kept, print_json, print_line
from eyechart.errors import SpecError, did_you_mean

app = typer.Typer(
    cls=Commands,
    name="eyechart",
    help="Find out whether a vision-language controller's decisions come from its camera.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    add_completion=False,
    epilog="Start with 'eyechart look SPEC'. Bad input prints one line and exits 2; --debug prints the traceback.",
)
listing = typer.Typer(help="List models, modes, conditions, prompts and simulators.", no_args_is_help=True)


def _show(rows: dict[str, str], *, json: bool) -> None:
    if json:
        print_json(rows)
        return
    wide = max(len(name) for name in rows)
    for name, says in rows.items():
        print_line(f"{name:<{wide}}  {says}")


@listing.command()
def models(json: Json = False) -> None:
    """List the built-in models and how to name others.

    The correct verdict of scripted models and organisms is known.
    """
    from eyechart.models import known_models

    _show(known_models(), json=json)


@listing.command()
def modes(
    name: Annotated[str | None, typer.Argument(help="A mode to print as a file: > mode.toml.")] = None,
    json: Json = False,
) -> None:
    """List the request modes of the paper's models, or print one as a file. None was ever tried."""
    from eyechart.models import known_modes
    from eyechart.modes import untried_text, untried_words

    known = known_modes()
    if name is not None and name not in known:
        raise SpecError(f"no request mode '{name}';{did_you_mean(name, known)} see 'eyechart list modes'")
    if json:
        print_json({one: mode.as_dict() for one, mode in known.items() if name in (None, one)})
    elif name is not None:
        print_line(untried_text(known[name]).rstrip("\n"))
    else:
        _show({one: untried_words(mode) for one, mode in known.items()}, json=False)


@listing.command()
def policies(json: Json = False) -> None:
    """List the built-in policies and how to name others.

    The correct verdict of the trained ones is known.
    """
    from eyechart.models import POLICIES, known_models

    _show(known_models(POLICIES), json=json)


@listing.command()
def conditions(json: Json = False) -> None:
    """List the conditions and the question that each answers.

    Those with CHANNEL or CAMERA are for policies.
    """
    from eyechart.conditions.policies import listed_conditions

    _show(listed_conditions(), json=json)


@listing.command()
def prompts(json: Json = False) -> None:
    """List the prompt formulations with their key and wording."""
    from eyechart.prompts import PROMPTS

    _show(
        {name: f"{one.key}  {' '.join(f'{one.system} {one.user}'.split())}" for name, one in PROMPTS.items()}, json=json
    )


@listing.command()
def simulators(json: Json = False) -> None:
    """List the simulators, the presets of their banks and the scenarios of their drives."""
    from eyechart.simulators import known_simulators

    _show(known_simulators(), json=json)


app.command()(look.look)
app.command()(probe.doctor)
app.command()(probe.probe)
frames.app.command()(answers.export)
app.add_typer(frames.app, name="frames")
for study in (run.prompts, drive.closed_loop, drive.hierarchy, run.admission, run.structured, drive.online, run.policy):
    run.app.command()(study)
run.app.command("import")(answers.import_)
app.add_typer(run.app, name="run")
app.add_typer(listing, name="list")
for command in (
    *(demo.demo, run.merge, score.score, score.verdict, score.costs, score.gate, score.compare, score.transfer),
    *(frames.plan, demo.calibrate, guardian.serve, bundle.report, bundle.paper, drive.ladder, drive.audit, drive.film),
    *(bundle.bundle, bundle.validate),
):
    app.command()(command)
app.add_typer(guardian.app, name="guardian")
for group in (listing, frames.app, guardian.app):
    group.info.cls = CommandGroup
for group in (app, listing, run.app, frames.app, guardian.app):
    for one in group.registered_commands:
        assert one.callback is not None
        one.cls = Command
        one.callback = output_kept()(from_one_folder(one.callback))


def named(words: Sequence[str]) -> typer.Typer:
    """Return the tree with only the command that begins these words, or the whole tree.

    The whole takes ten times as long to build as a command.
    """
    found = [one for one in app.registered_commands if one.callback and words[:1] == [one.callback.__name__]]
    if not found:
        return app
    tree = copy(app)
    tree.registered_commands, tree.registered_groups = found, []
    return tree


def _version(value: bool) -> None:
    if value:
        print_line(f"eyechart {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    del version
