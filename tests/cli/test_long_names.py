"""Models whose SPECs have 120 signs, at 80 columns and through a pipe: verdicts in sight, whole names in files."""

import csv
import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

import banks
import report_runs
import stand_ins
from eyechart.cli.app import app
from eyechart.report.short_names import shorten

NAMES = {
    f"{'served/from/a/long/path/' * 2}{middle}{'/checkpoints/of/a/training' * 3}"[:112]: respond
    for middle, respond in (("first", stand_ins.stop), ("other", stand_ins.noisy), ("third", stand_ins.stop))
}
SPECS = [f"standin:{name}" for name in NAMES]
FOLDED = ("score", "costs --unread")
"""Commands that may break short names over lines of a cell, where other cells stand between."""
COMMANDS = ("verdict", "score", "costs", "costs --all", "costs --unread", "gate", "compare", "transfer")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a run of three models whose names differ only in their middles."""
    folder = tmp_path_factory.mktemp("long")
    bank = banks.build_bank(folder / "bank", drawn=False).root
    made = report_runs.make_run(bank, folder / "run", NAMES)
    rows = [{"model": spec, "score": place} for place, spec in enumerate(SPECS)]
    with (folder / "scores.csv").open("w", encoding="utf-8", newline="") as file:
        table = csv.DictWriter(file, ["model", "score"])
        table.writeheader()
        table.writerows(rows)
    return made


def told(run: Path, command: str, *more: str) -> Result:
    """Return what a command on the run ends in."""
    first, *options = command.split()
    others = {"compare": [str(run), "--resamples", "999"], "transfer": ["--scores", str(run.parent / "scores.csv")]}
    return CliRunner().invoke(app, [first, str(run), *others.get(first, []), *options, *more])


@pytest.fixture(params=["80 columns", "pipe"])
def width(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[int | None]:
    """Print to a terminal of 80 columns and return these, or to a pipe."""
    if request.param == "pipe":
        yield None
        return
    for name, value in (("FORCE_COLOR", "1"), ("NO_COLOR", "1"), ("TERM", "dumb"), ("COLUMNS", "80")):
        monkeypatch.setenv(name, value)
    yield 80


@pytest.mark.parametrize("command", COMMANDS)
def test_names_are_short_and_each_its_own(run: Path, width: int | None, command: str) -> None:
    """No command prints a name of 120 signs, all of them are told apart, and no table is wider than the screen."""
    assert {len(spec) for spec in SPECS} == {120}
    shown = told(run, command).stdout
    joined = "".join(shown.split())
    assert all(name not in joined for name in SPECS)
    asked = SPECS[1:2] if command == "costs --unread" else SPECS  # the only one whose replies hold no decision
    if command not in FOLDED:
        assert all(shorten(SPECS)[name] in joined for name in asked)
    if width is not None and command != "gate":  # a check is a line, which the terminal breaks
        assert max(map(len, shown.splitlines())) <= width


def test_a_verdict_stands_in_the_line_of_its_name_or_right_below(run: Path, width: int | None) -> None:
    """Nothing but the short name stands between a reader and the verdict."""
    lines = told(run, "verdict").stdout.splitlines()
    found = json.loads(told(run, "verdict", "--json").stdout)["models"]
    labels = {spec: one["calibrated"] for spec, one in found.items()}
    for spec, label in labels.items():
        short = shorten(SPECS)[spec]
        assert any(line.startswith(f"{short}: {label}") for line in lines)
        if width is not None:  # too narrow for columns: a row is a name with a line for each of its cells
            assert lines[lines.index(short) + 1].startswith(f"  verdict: {label}")
    for line, label in zip(told(run, "gate").stdout.splitlines(), ("cannot say",) * 3, strict=True):
        assert line.startswith(label)
        assert "  depth: " in line[: width or 80]


@pytest.mark.parametrize("command", COMMANDS)
def test_json_keeps_the_whole_name(run: Path, command: str) -> None:
    """Programs read SPECs, not what fits a screen."""
    printed = told(run, command, "--json").stdout
    assert json.loads(printed)
    assert all(json.dumps(spec) in printed for spec in SPECS)


def test_tables_for_programs_keep_the_whole_name(run: Path) -> None:
    """In CSV, Markdown and LaTeX, of every table that a report writes."""
    page = run.parent / "report.html"
    assert CliRunner().invoke(app, ["report", str(run), "--out", str(page), "--tables", str(run.parent)]).exit_code == 0
    for suffix in ("csv", "md", "tex"):
        text = "".join(file.read_text(encoding="utf-8") for file in run.parent.glob(f"*.{suffix}"))
        plain = text.replace("\\", "")
        assert all(spec in plain for spec in SPECS), suffix
    assert all(spec in page.read_text(encoding="utf-8") for spec in SPECS)
