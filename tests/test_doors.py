"""Doors are found from the syntax, each stands in the registry, and chosen ones hold under chosen faults."""

import ast
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from matrix.exercises import EXERCISES
from matrix.finder import doors, kind_of
from matrix.registry import DRIVEN, NOT_DRIVEN

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src"

CHOSEN = (
    "battery | guest | changes its arguments",
    "battery | guest | changes the folder",
    "doctor | guest | writes below Python",
    "drives validated | emptied record",
    "watch | idle connections",
    "endpoint | echoed key | ^(percent of every byte|escapes|lines)$",
    "log | wide and deep | header.json is very wide",
    "check | (contradiction|named pipe)",
    "import | (full disk|failing change|failing lock)",
    "merge | failing (statement|lock|temporary)",
    "drives resumed | contradiction",
    "drives resumed | full disk | 20000",
    "doctor | few descriptors",
)
"""The cells of the short form, as ``exercise | fault | case``; each part is a pattern."""


def tried(source: Path, rows: Path, *only: str) -> tuple[int, dict[str, list[str]], str]:
    """Run cells of the matrix on a source: its exit code, its rows, and what it said."""
    words = [sys.executable, "-m", "matrix", "--src", str(source), "--most", "0", "--out", str(rows)]
    words += [word for one in only for word in ("--only", one)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "tests")}
    done = subprocess.run(words, env=environment, capture_output=True, text=True, check=False, timeout=600)
    assert rows.is_file(), done.stderr
    return done.returncode, json.loads(rows.read_text()), done.stdout + done.stderr


def test_every_door_stands_in_the_registry_and_every_entry_has_its_door() -> None:
    """A new door gets an exercise that drives it, or the reason why none does; what is gone is taken out."""
    found = {door.place for door in doors(SOURCE)}
    assert found - DRIVEN.keys() - NOT_DRIVEN.keys() == set()
    assert (DRIVEN.keys() | NOT_DRIVEN.keys()) - found == set()
    assert DRIVEN.keys() & NOT_DRIVEN.keys() == set()
    assert set(DRIVEN.values()) <= EXERCISES.keys()


def test_chosen_doors_hold_under_chosen_faults(tmp_path: Path) -> None:
    """Words, or the same result: nothing is lost, left running or left behind."""
    code, rows, said = tried(SOURCE, tmp_path / "rows.json", *CHOSEN)
    assert {cell: wrong for cell, wrong in rows.items() if wrong} == {}, said
    assert code == 0
    for one in CHOSEN:
        exercise, fault, *_ = one.split(" | ")
        assert any(cell.startswith(f"{exercise} | ") for cell in rows), f"no cell of {one}"
        assert fault


def test_a_fall_that_is_planted_is_found(tmp_path: Path) -> None:
    """A source whose command line lets an error of the system through, else the test above could not fail."""
    shutil.copytree(SOURCE, tmp_path / "src")  # with what Python compiled, which holds for all but the changed file
    main = tmp_path / "src" / "eyechart" / "cli" / "__init__.py"
    text = main.read_text(encoding="utf-8")
    assert text.count("except (EyechartError, OSError) as error") == 1
    main.write_text(text.replace("except (EyechartError, OSError) as error", "except EyechartError as error"))
    code, rows, _ = tried(tmp_path / "src", tmp_path / "rows.json", "list | full disk | 4000")
    assert code == 1
    assert any(said.startswith("exit 70") for wrong in rows.values() for said in wrong), rows


@pytest.mark.parametrize(
    ("call", "kind"),
    [
        ("open(path)", "file"),
        ("path.open('rb')", "file"),
        ("path.read_text(encoding='utf-8')", "file"),
        ("path.write_bytes(text)", "disk"),
        ("part.replace(path)", "disk"),
        ("sqlite3.connect(file)", "database"),
        ("FileLock(path)", "lock"),
        ("socket.create_server(address)", "network"),
        ("aiohttp.ClientSession()", "network"),
        ("web.TCPSite(runner, host, 0)", "network"),
        ("subprocess.Popen(words)", "process"),
        ("ProcessPoolExecutor(2)", "process"),
        ("import_module(name)", "code"),
        ("spec.loader.exec_module(module)", "code"),
        ("json.loads(text)", "parser"),
        ("tomllib.load(file)", "parser"),
        ("Image.open(file)", "parser"),
        ("zipfile.ZipFile(path)", "parser"),
        ("av.open(path)", "parser"),
        ("tempfile.mkdtemp()", "temporary"),
        ("template.format(number=1)", "template"),
        ("template.format_map(row)", "template"),
        ("'{}'.format(1)", None),
        ("WORDS.format(1)", None),
        ("text.replace('a', 'b')", None),
        ("world.open(seed)", None),
        ("thing.load(path)", None),
    ],
)
def test_each_kind_of_door_is_known_by_its_call(call: str, kind: str | None) -> None:
    """And what only looks like one is not."""
    node = ast.parse(call, mode="eval").body
    assert isinstance(node, ast.Call)
    assert kind_of(node) == kind


def test_doors_are_found_under_other_names_and_in_inner_functions(tmp_path: Path) -> None:
    """As an import renames them; what stands in no function is the module's."""
    text = "from json import loads as parse\nimport sqlite3 as sql\nclass A:\n def b(self):\n  def c(): parse(1)\n"
    text += "sql.connect('x')"
    (tmp_path / "one.py").write_text(text)
    assert {(door.function, door.kind) for door in doors(tmp_path)} == {("A.b.c", "parser"), ("<module>", "database")}
    with pytest.raises(FileNotFoundError):
        doors(tmp_path / "none")
