"""What older versions made is read, scored and validated by today's code, which answers as they did.

`tests/old/` holds a folder a version: what it made, and what its commands answered. `tests/old/differences.toml` lists
what is answered otherwise on purpose. The commands that read change nothing, and add only what they keep.
"""

import contextlib
import importlib.util
import json
import os
import shlex
import shutil
import sqlite3
import sys
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path
from types import ModuleType

import pytest

from by_key import Difference, Expected, differences, read_expected, unexpected
from eyechart import cli
from eyechart.kept import FOLDER

OLD = Path(__file__).parent / "old"
ANSWERS = sorted(OLD.glob("*/answers/*.json"))
NAMES = [f"{path.parents[1].name}/{path.stem}" for path in ANSWERS]
EXPECTED = read_expected(OLD / "differences.toml")


def marks(folder: Path) -> dict[str, tuple[int, int, int]]:
    """Return of every file of a folder which it is, its size, and when it was last written to, in nanoseconds."""
    result = {}
    for place, folders, names in os.walk(folder):
        folders[:] = [name for name in folders if name not in {"__pycache__", FOLDER}]
        for name in names:
            said = os.stat(os.path.join(place, name))  # noqa: PTH116, PTH118 - of every file, after every command
            result[f"{place}/{name}"] = (said.st_ino, said.st_size, said.st_mtime_ns)
    return result


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a copy of all that older versions made."""
    copy = tmp_path_factory.mktemp("old")
    for version in OLD.glob("*/made"):
        shutil.copytree(version, copy / version.parent.name)
    return copy


@cache
def kept(path: Path) -> dict[str, object]:
    """Return an answer as it was kept."""
    return json.loads(path.read_text(encoding="utf-8"))


@pytest.fixture
def say(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):  # noqa: ANN201
    """Return a function that runs a command line in a folder: exit code, standard output, standard error."""

    def run(folder: Path, line: str) -> tuple[int, str, str]:
        monkeypatch.chdir(folder)
        monkeypatch.syspath_prepend(str(folder))
        monkeypatch.delitem(sys.modules, "controllers", raising=False)  # that of another copy, which may be gone
        monkeypatch.setattr(sys, "argv", ["eyechart", *shlex.split(line)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as left:
            cli.main()
        return int(left.value.code or 0), *capsys.readouterr()

    return run


FOUND: dict[Path, list[Difference]] = {}
READ_AGAIN = {"verdict", "score", "costs", "gate"}
"""Commands that keep what they read; a second answer is the kept one, and that of --fresh is read anew."""


@pytest.fixture
def found(say, made: Path):  # noqa: ANN001, ANN201
    """Return a function that gives an answer's differences, asked once; asking writes nothing."""

    def ask(path: Path) -> list[Difference]:
        if path not in FOUND:
            folder = made / path.parents[1].name
            before, then = marks(folder), kept(path)
            code, out, _ = say(folder, str(then["command"]))
            now = {"exit": code, "json": json.loads(out) if out.strip() else None}
            FOUND[path] = list(differences({name: then[name] for name in now}, now, within=1e-12))
            if shlex.split(str(then["command"]))[0] in READ_AGAIN:
                again, anew = (say(folder, f"{then['command']}{more}") for more in ("", " --fresh"))
                assert (again[:2], anew[:2]) == ((code, out), (code, out)), f"{then['command']} answers otherwise"
            assert marks(folder) == before, f"{then['command']} changed files"
        return FOUND[path]

    return ask


@pytest.mark.parametrize("path", ANSWERS, ids=NAMES)
def test_todays_code_answers_as_the_version_that_made_it(path: Path, found) -> None:  # noqa: ANN001
    """By exit code and by every key of the JSON, floats to twelve places; and the folder stays as it was.

    The answers were kept on another processor, whose sums may differ in their last bit.
    """
    unlike = unexpected(path.stem, found(path), EXPECTED)
    assert not unlike, "\n".join([f"{path.stem}: {len(unlike)} unlisted differences", *unlike[:20]])


@pytest.mark.parametrize("entry", EXPECTED, ids=lambda one: f"{one.answer} {' > '.join(one.key)}")
def test_every_listed_difference_is_one(entry: Expected, found) -> None:  # noqa: ANN001
    """An entry of differences.toml that no answer shows any more is to be taken out."""
    named = [path for path in ANSWERS if fnmatchcase(path.stem, entry.answer)]
    assert any(entry.covers(path.stem, one) for path in named for one in found(path)), "it does not differ: take it out"


@pytest.mark.parametrize("path", sorted(OLD.glob("*/surface.json")), ids=lambda path: path.parent.name)
def test_what_was_promised_to_callers_is_still_there(path: Path) -> None:
    """Commands, options with their defaults, and what api and testing take; what came since is no breach."""
    then, now = kept(path), load_make().surface()
    broken = [difference for difference in differences(then, now) if breaks(difference)]
    assert not unexpected("surface", broken, EXPECTED)


def breaks(found: Difference) -> bool:
    """Return whether an older call may fail: something is gone or changed, or what came since must be given.

    What need no longer be given breaks none.
    """
    if found.kind != "added":
        return not (found.key[-1] == "required" and found.new is False)
    option = isinstance(found.new, dict) and found.new.get("required") is True
    return option or (isinstance(found.new, str) and found.new.endswith("required"))


def load_make() -> ModuleType:
    """Return the program that makes what is kept."""
    spec = importlib.util.spec_from_file_location("make_old", OLD / "make.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def rows(ledger: Path) -> list[tuple[object, ...]]:
    """Return the rows of a ledger in the order in which they were written."""
    with contextlib.closing(sqlite3.connect(f"{ledger.as_uri()}?mode=ro", uri=True)) as opened:
        return opened.execute("SELECT * FROM attempts ORDER BY rowid").fetchall()


RESUMED = "run battery --frames yard --out {} --model python:controllers:unsteady"


def test_an_old_run_that_is_finished_is_not_asked_again(say, made: Path, tmp_path: Path) -> None:  # noqa: ANN001
    """The command that made it finds nothing to do."""
    folder = shutil.copytree(made / "0.1.0", tmp_path / "made")
    before = len(rows(folder / "own" / "ledger.sqlite"))
    code, _, told = say(folder, RESUMED.format("own"))
    assert (code, len(rows(folder / "own" / "ledger.sqlite"))) == (0, before), told


def test_an_old_run_goes_on_where_it_stopped(say, made: Path, tmp_path: Path) -> None:  # noqa: ANN001
    """What it holds stays, only the rest is asked, and then it is a run like that which was made at once."""
    folder = shutil.copytree(made / "0.1.0", tmp_path / "made")
    ledger = folder / "halfway" / "ledger.sqlite"
    before = rows(ledger)
    code, _, told = say(folder, RESUMED.format("halfway"))
    assert code == 0, told
    after = rows(ledger)
    assert (len(before), len(after)) == (40, len(rows(folder / "own" / "ledger.sqlite")))
    assert [row[: len(old)] for row, old in zip(after, before, strict=False)] == before
    verdicts = [say(folder, f"verdict {run} --json")[1] for run in ("halfway", "own")]
    assert verdicts[0] == verdicts[1]


def test_an_old_run_of_a_model_of_another_version_is_not_mixed(say, made: Path, tmp_path: Path) -> None:  # noqa: ANN001
    """The known answers carry eyechart's version: a ledger holds the replies of one."""
    folder = shutil.copytree(made / "0.1.0", tmp_path / "made")
    code, _, told = say(folder, "run battery --frames highway --out unfinished --model scripted:depth")
    assert code == 2
    assert "this run asked scripted:depth at version 0.1.0" in told
    assert len(rows(folder / "unfinished" / "ledger.sqlite")) == 40
