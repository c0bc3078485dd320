"""Write docs/cli.md, the reference of the command line, from the commands themselves.

Usage: python docs/update_cli.py
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from typer.main import get_command

from eyechart.cli import help as told
from eyechart.cli.app import app

PAGE = Path(__file__).with_name("cli.md")
HEAD = """# The command line

<!-- written by docs/update_cli.py: change the commands, not this page -->

Every command explains itself with `--help`. Exit codes: 0 done, 1 the answer is no, 2 bad input or "cannot say", 3
stopped at a limit, 130 interrupted. Bad input prints one line; `--debug`, anywhere among the words, shows where it
arose.
"""


def commands(command: Any, name: str) -> Iterator[tuple[str, Any]]:  # noqa: ANN401 - click's own types are not exported
    """Yield each command below a group with its full name, depth first, in the order of the help."""
    for word, found in command.commands.items():
        if hasattr(found, "commands"):
            yield from commands(found, f"{name} {word}")
        else:
            yield f"{name} {word}", found


def section(name: str, command: Any) -> str:  # noqa: ANN401
    """Return the section of one command: what it does, how it is called, and a row an option."""
    arguments = [param for param in command.params if param.param_type_name == "argument"]
    options = [param for param in command.params if param.param_type_name == "option" and not param.hidden]
    required = [f"{option.opts[0]} {shown(option)}" for option in options if option.required]
    words = [
        name,
        *(usage(argument) for argument in arguments),
        *required,
        *(["[options]"] if len(options) > len(required) else []),
    ]
    lines = [f"## `{name}`", "", *paragraphs(command), "```text", " ".join(words), "```", ""]
    if arguments or options:
        lines += ["| | what it is | default |", "|---|---|---|", *map(row, [*arguments, *options]), ""]
    return "\n".join(lines)


def paragraphs(command: Any) -> list[str]:  # noqa: ANN401
    """Return what a command says of itself, examples as code."""
    said = "\n\n".join(part for part in (command.help, command.epilog) if part)
    return [
        line for name, words in told.paragraphs(said) for line in (f"{name}: `{words}`" if name else cell(words), "")
    ]


def row(option: Any) -> str:  # noqa: ANN401
    """Return the row of an option or an argument."""
    if option.param_type_name == "argument":
        name = f"`{usage(option)}`"
    else:
        both = [*option.opts, *option.secondary_opts]
        name = f"`{', '.join(both)}{'' if option.is_flag else f' {shown(option)}'}`"
    again = " Again for more." if option.multiple and "again" not in (option.help or "").lower() else ""
    default = "required" if option.required else default_of(option)
    return f"| {name} | {cell(option.help or '')}{again} | {default} |"


def usage(argument: Any) -> str:  # noqa: ANN401
    """Return an argument's name, with dots where it may be given more than once."""
    name = (argument.metavar or argument.name).rstrip(".").upper()
    return f"{name}..." if argument.nargs == -1 else name


def shown(option: Any) -> str:  # noqa: ANN401
    """Return the word that stands for an option's value."""
    return str(option.metavar or option.name.strip("_").upper())


def default_of(option: Any) -> str:  # noqa: ANN401
    """Return an option's default; nothing for none."""
    return "" if option.default is None or option.default in ((), [], "") or option.is_flag else f"`{option.default}`"


def cell(text: str) -> str:
    """Return a text as Markdown that stands for itself, in a table too."""
    escaped = text.replace("\\", "\\\\")
    for sign in "|<>*[]":
        escaped = escaped.replace(sign, f"\\{sign}")
    return " ".join(escaped.split())


def page() -> str:
    """Return the whole page."""
    found = commands(get_command(app), "eyechart")
    return "\n".join([HEAD, *(section(name, command) for name, command in found)])


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
