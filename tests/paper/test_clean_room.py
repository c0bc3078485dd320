"""A program that imports nothing of eyechart counts the paper's statistics anew from a bundle's table of decisions."""

import ast
import csv
import io
import json
import subprocess
import sys
import zipfile
from pathlib import Path

import hosted
import pytest

from eyechart.bundle import write_bundle

ROOT = Path(__file__).parents[2]
PROGRAM = ROOT / "docs" / "clean_room.py"
MADE = ROOT / "tests" / "old" / "0.1.0" / "made"
SIX = 6


@pytest.fixture(scope="module")
def bundles(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Return bundles of the paper's five models and of a run with controls, refusals and frames without a lead."""
    folder = tmp_path_factory.mktemp("clean")
    bank = hosted.build_bank(folder / "bank")
    run = hosted.write_ledger(folder / "hosted", bank, {**hosted.MODELS, "refuses": hosted.REFUSES_BLANKS})
    write_bundle(run, folder / "hosted.zip", banks=[bank.root], resamples=100)
    write_bundle(MADE / "battery", folder / "battery.zip", banks=[MADE / "highway"], resamples=100)
    return [folder / "hosted.zip", folder / "battery.zip"]


def counted(bundle: Path) -> tuple[int, list[str]]:
    """Return how the program ends, and its lines."""
    done = subprocess.run([sys.executable, "-I", PROGRAM, bundle], capture_output=True, text=True, check=False)
    assert done.stderr == ""
    return done.returncode, done.stdout.splitlines()


def test_it_is_short_and_imports_nothing_of_the_house() -> None:
    """At most 200 lines, and the standard library alone."""
    text = PROGRAM.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 200
    nodes = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Import | ast.ImportFrom)]
    names = {name for node in nodes for name in ([node.module] if isinstance(node, ast.ImportFrom) else [])}
    names |= {name.name for node in nodes if isinstance(node, ast.Import) for name in node.names}
    assert {name.partition(".")[0] for name in names} <= sys.stdlib_module_names


def test_every_number_comes_out_of_the_table_again(bundles: list[Path]) -> None:
    """Six numbers of every model of each bundle, to 1e-12."""
    for bundle in bundles:
        code, lines = counted(bundle)
        models = json.loads(zipfile.ZipFile(bundle).read("results.json"))["score"]["models"]
        assert len(lines) == SIX * len(models)
        assert (code, {line.split()[0] for line in lines}) == (0, {"same"})


def test_a_prompt_study_is_counted_cell_by_cell(tmp_path: Path) -> None:
    """Each number that a cell holds, of every model under every prompt."""
    write_bundle(MADE / "prompts", tmp_path / "prompts.zip", banks=[MADE / "highway"], resamples=100)
    code, lines = counted(tmp_path / "prompts.zip")
    cells = json.loads(zipfile.ZipFile(tmp_path / "prompts.zip").read("results.json"))["score"]["cells"]
    assert len(lines) == 3 * len(cells)
    assert (code, {line.split()[0] for line in lines}) == (0, {"same"})
    assert any(f"{cells[0]['model']} in {cells[0]['cell']}  IDI  " in line for line in lines)


def test_a_bundle_without_decisions_is_said_to_have_none(tmp_path: Path) -> None:
    """In words and not in a traceback: of drives, and of what is no bundle."""
    with zipfile.ZipFile(tmp_path / "drives.zip", "w") as out:
        out.writestr("results.json", "{}")
    (tmp_path / "none.zip").write_text("none")
    for name, words in (("drives.zip", "holds no table of decisions"), ("none.zip", "is no bundle")):
        code, (line,) = counted(tmp_path / name)
        assert (code, words in line) == (2, True)


def test_a_decision_that_is_changed_shows_in_the_numbers(bundles: list[Path], tmp_path: Path) -> None:
    """One reply to a real picture of one model, whose numbers alone differ."""
    changed = tmp_path / "changed.zip"
    with zipfile.ZipFile(bundles[0]) as held, zipfile.ZipFile(changed, "w") as out:
        for name in held.namelist():
            content = held.read(name)
            if name == "tables/decisions.csv":
                rows = list(csv.reader(io.StringIO(content.decode())))
                place = next(n for n, row in enumerate(rows) if row[0] == "Kimi-K3" and row[4:6] == ["real", "LEFT"])
                rows[place][5] = "STOP"
                text = io.StringIO()
                csv.writer(text, lineterminator="\n").writerows(rows)
                content = text.getvalue().encode()
            out.writestr(name, content)
    code, lines = counted(changed)
    assert code == 1
    assert {line.split()[1] for line in lines if line.startswith("DIFFERS")} == {"Kimi-K3"}


def test_the_page_lists_every_column_and_prints_the_program(bundles: list[Path]) -> None:
    """docs/bundles.md is held to the table that is written."""
    page = (ROOT / "docs" / "bundles.md").read_text(encoding="utf-8")
    with zipfile.ZipFile(bundles[0]) as held:
        (head,) = csv.reader(io.StringIO(held.read("tables/decisions.csv").decode().partition("\n")[0]))
    for name in head:
        assert f"`{name}`" in page, name
    assert "{literalinclude} clean_room.py" in page
