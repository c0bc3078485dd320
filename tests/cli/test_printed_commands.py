"""Every command that eyechart names in what it prints is one, and runs as it is printed."""

import ast
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from rich.markup import render
from typer.main import get_command

from eyechart.cli.app import app
from eyechart.cli.demo import _demo_policies

SOURCE = Path(__file__).parents[2] / "src" / "eyechart"
NAMED = re.compile(r"'eyechart ([a-z][^'>]+)[^']*'")
FILLED = re.compile(r"\{\w*\}")


def texts(tree: ast.stmt) -> Iterator[tuple[int, str]]:
    """Yield every text of a statement with its line; what is filled in later is a word."""
    nodes = list(ast.walk(tree))
    parts = {id(each) for node in nodes if isinstance(node, ast.JoinedStr) for each in ast.walk(node)}
    for node in nodes:
        if isinstance(node, ast.JoinedStr):
            values = (one.value if isinstance(one, ast.Constant) else "WORD" for one in node.values)
            yield node.lineno, "".join(map(str, values))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in parts:
            yield node.lineno, FILLED.sub("WORD", node.value)


def named() -> Iterator[tuple[str, str]]:
    """Yield where each command is named, and its words."""
    for path in sorted(SOURCE.rglob("*.py")):
        if path == SOURCE / "bundle" / "parts.py":
            continue  # the text of every bundle since 0.1.0, which a validation compares
        source = path.read_text(encoding="utf-8")
        if "'eyechart " not in source:
            continue  # to look through every text of all modules takes seconds, in each worker
        lines = source.splitlines()
        for one in ast.parse(source).body:
            if "'eyechart " in "\n".join(lines[one.lineno - 1 : one.end_lineno]):
                for line, text in texts(one):
                    for found in NAMED.findall(text):
                        yield f"{path.relative_to(SOURCE)}:{line}", " ".join(found.split())


@cache
def tree() -> Any:  # noqa: ANN401 - click's own types are not exported
    """Return the tree of commands."""
    return get_command(app)


def parse(words: str) -> None:
    """Parse a command; of one that is only named, see that there is one. Raises click's own errors."""
    command: Any = tree()
    rest = ["1" if word == "N" else word for word in shlex.split(words)]
    while rest and rest[0] != "WORD" and hasattr(command, "commands"):
        assert rest[0] in command.commands, f"no command '{rest[0]}' in 'eyechart {words}'"
        command = command.commands[rest.pop(0)]
    if rest and not hasattr(command, "commands"):
        command.make_context(command.name, rest).close()


@pytest.mark.parametrize("words", sorted({words for _, words in named()}))
def test_a_command_that_is_named_parses(words: str) -> None:
    """Whoever copies it gets no usage error."""
    try:
        parse(words)
    except Exception as error:
        where = ", ".join(place for place, one in named() if one == words)
        raise AssertionError(f"'eyechart {words}' ({where}) does not run: {error}") from error


def examples() -> list[str]:
    """Return the examples of all commands, without what a shell does with them."""
    page = (Path(__file__).parents[2] / "docs" / "cli.md").read_text(encoding="utf-8")
    found = re.findall(r"^Example[^:\n]*: `eyechart ([^`]+)`", page, re.MULTILINE)
    return [re.split(r"\. |,? then |,? or |, | [|>&] ", one)[0].rstrip(".") for one in found]


@pytest.mark.parametrize("words", examples())
def test_an_example_of_a_command_parses(words: str) -> None:
    """As it stands in the help."""
    parse(words)


def test_the_demo_of_policies_ends_with_commands_that_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """One report of all its runs, and how to go on with a policy of one's own."""
    monkeypatch.setattr("eyechart.studies.policy.demo.make", lambda *_: ([], {}))
    _demo_policies(tmp_path / "demo", 0)
    said = " ".join(capsys.readouterr().err.split())
    commands = NAMED.findall(said)
    assert [command.split()[0] for command in commands] == ["verdict", "verdict", "verdict", "report", "run"]
    for one in commands:
        parse(one)
    assert re.search(r"report \S+run-balanced-0 \S+run-privileged-0 \S+run-fixed-0 --out ", said)
    assert f"your own: 'eyechart run policy --policy python:MODULE:FUNCTION --frames {tmp_path}" in said


def helps() -> list[str]:
    """Return every help text of the commands and their options."""
    found, left = [], [tree()]
    while left:
        command = left.pop()
        left += getattr(command, "commands", {}).values()
        found += [command.help, command.epilog, *(getattr(param, "help", None) for param in command.params)]
    return [one for one in found if one]


def test_no_help_has_brackets_that_are_taken_for_markup() -> None:
    """What stands in such brackets is not printed."""
    assert not [one for one in helps() if render(one).plain != one]


def test_the_package_runs_as_a_module() -> None:
    """As ``python -m eyechart``."""
    said = subprocess.run([sys.executable, "-m", "eyechart", "--help"], check=True, capture_output=True, text=True)
    assert "Usage: eyechart" in said.stdout
