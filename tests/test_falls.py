"""What fell when a version was tried from outside is held by a test, which a table names."""

import ast
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FALLS = tomllib.loads((ROOT / "tests" / "falls.toml").read_text(encoding="utf-8"))["fall"]


def named() -> Iterator[str]:
    """Yield the tests that the table names."""
    for fall in FALLS:
        yield from fall["test"] if isinstance(fall["test"], list) else [fall["test"]]


@cache
def functions(file: str) -> frozenset[str]:
    """Return the functions of a test file, also those of its classes."""
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    return frozenset(node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef))


@pytest.mark.parametrize("test", sorted(set(named())))
def test_a_test_that_the_table_names_is_there(test: str) -> None:
    """Whoever renames it renames it there too."""
    file, _, name = test.partition("::")
    assert name.rpartition("::")[2] in functions(file)


def test_every_row_says_what_fell_where_and_what_holds_it() -> None:
    """In a sentence."""
    for fall in FALLS:
        assert fall.keys() - {"pages"} == {"found", "what", "test"}, fall
        assert fall["what"].endswith("."), fall


def test_the_options_of_all_tests_import_what_the_older_version_has() -> None:
    """Or none of these tests would run on its source, and nothing would show that it fell there."""
    had = {
        "frames": {"BankWriter", "FrameBank", "open_bank"},
        "manifest": {"RUN"},
        "simulators": {"open_bank_simulator"},
    }
    for file in ("conftest", "known"):
        tree = ast.parse((ROOT / "tests" / f"{file}.py").read_text(encoding="utf-8"))
        for one in tree.body:
            if isinstance(one, ast.ImportFrom) and str(one.module).startswith("eyechart"):
                new = {name.name for name in one.names} - had.get(str(one.module).removeprefix("eyechart."), set())
                assert not new, f"{file}: import {', '.join(new)} where it is used"
