"""A page of the docs, followed to the letter: its files are written and its edits made in a copy of the tree.

A block that opens with ``# path`` is a file. A ``diff`` block that opens with ``--- path`` is an edit: its lines with a
space or a minus must stand in the file, once, and become those with a space or a plus. ``sh`` blocks are commands.
"""

import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

ROOT = Path(__file__).parents[1]
TREE = ("src", "tests", "docs", "benchmarks", "README.md", "CHANGELOG.md", "pyproject.toml")
_BLOCK = re.compile(r"^```(python|diff|sh)\n(.*?)^```", re.MULTILINE | re.DOTALL)


@dataclass(frozen=True)
class Step:
    """One block of a page: a file, an edit, or commands. ``path`` is "" for commands."""

    kind: Literal["file", "edit", "commands"]
    path: str
    text: str


def steps(page: str) -> Iterator[Step]:
    """Yield what a page tells to do, in order."""
    for kind, text in _BLOCK.findall(page):
        first, _, rest = text.partition("\n")
        if kind == "sh":
            yield Step("commands", "", text)
        elif kind == "diff":
            yield Step("edit", first.removeprefix("--- "), rest)
        elif first.startswith("# ") and first.endswith(".py"):
            yield Step("file", first.removeprefix("# "), rest)


def edited(text: str, diff: str) -> str:
    """Return a text with an edit made; raises AssertionError where its lines do not stand in the text just once."""
    lines = diff.splitlines(keepends=True)
    assert all(line[0] in " +-" for line in lines), f"a line of a diff starts with a space, + or -:\n{diff}"
    before = [line[1:] for line in lines if line[0] in " -"]
    after = [line[1:] for line in lines if line[0] in " +"]
    there = text.splitlines(keepends=True)
    places = [at for at in range(len(there)) if there[at : at + len(before)] == before]
    assert len(places) == 1, f"these lines do not stand in the file once; mend the page:\n{''.join(before)}"
    return "".join(there[: places[0]] + after + there[places[0] + len(before) :])


def copy_tree(to: Path) -> Path:
    """Copy what belongs to the project into a new folder."""
    for name in TREE:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, to / name, ignore=shutil.ignore_patterns("*.egg-info", "_build", "old"))
        else:
            to.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source, to / name)
    return to


def follow(page: str, tree: Path) -> list[str]:
    """Do what a page tells in a copy of the tree; return what each of its commands printed.

    Raises AssertionError with the output of a command that fails.
    """
    printed = []
    for step in steps(page):
        if step.kind == "file":
            (tree / step.path).write_text(step.text, encoding="utf-8")
        elif step.kind == "edit":
            file = tree / step.path
            file.write_text(edited(file.read_text(encoding="utf-8"), step.text), encoding="utf-8")
        else:
            printed += [run(line, tree) for line in step.text.splitlines()]
    return printed


def run(line: str, tree: Path) -> str:
    """Run one command of a page in a tree, on that tree's own source, and return what it printed."""
    command, *words = shlex.split(line)
    if command == "pytest":
        words += ["-q", "-p", "no:cacheprovider", "-p", "no:randomly", "--basetemp", str(tree.with_name("basetemp"))]
    program = (
        [sys.executable, "-m", "pytest"] if command == "pytest" else [str(Path(sys.executable).with_name(command))]
    )
    path = {"PYTHONPATH": str(tree / "src")}
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("PYTEST_", "COV_"))}
    done = subprocess.run(
        [*program, *words], cwd=tree, capture_output=True, text=True, check=False, env={**kept, **path}
    )
    assert done.returncode == 0, f"$ {line}\n{done.stdout[-6000:]}\n{done.stderr[-3000:]}"
    return done.stdout
