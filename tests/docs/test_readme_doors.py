"""The doors of the README are opened: each row's commands run as they stand, with stand-ins for what a user brings."""

import json
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

import photographs
from banks import build_bank
from eyechart.cli.app import app
from readme import ANSWERS, README, door, run
from seeing import served

pytestmark = pytest.mark.slow

ADDRESS = "http://127.0.0.1:8000/v1"


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return an empty folder, which is the current one and the place of a user's modules."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "my_robot", raising=False)
    return tmp_path


def test_an_endpoint(here: Path) -> None:
    """On a small bank; its address is a server that sees."""
    (words,) = door("endpoint")
    small = build_bank(here / "small", episodes=4, steps=2).root
    with served() as server:
        words[words.index(ADDRESS)] = server.base_url
        assert run(words, "--frames", str(small)).startswith(ANSWERS)
    assert (here / "looks" / "openai-MODEL" / "report.html").is_file()


def test_photographs_and_a_table(here: Path) -> None:
    """The function has the name and the arguments that the row gives it."""
    (words,) = door("photographs")
    table = photographs.rows(drives=6, ticks=10, places=("yard", "hall", "lane"))
    photographs.take(here / "photos", table)
    (here / "photos.csv").write_text(photographs.as_csv(table))
    assert "def decide(prompt, image) -> str" in README
    (here / "my_robot.py").write_text(
        "from brakers import by_box\n\n\ndef decide(prompt, image) -> str:\n    return by_box(prompt, image)\n"
    )
    assert run(words).startswith("In part. It uses the picture")


def test_a_simulator(here: Path) -> None:
    """In one world of the rover; the page of the drives is written."""
    drive, report = door("simulator")
    with served() as server:
        run(drive, "--base-url", server.base_url, "--simulator", "rover", "--scenarios", "single", "--seeds", "1")
    run(report)
    assert (here / "drives.html").stat().st_size > 10_000


def test_answers_from_elsewhere(here: Path) -> None:
    """Whoever answers reads nothing but the exported table."""
    export, bring = door("elsewhere")
    build_bank(here / "bank", episodes=4, steps=2)
    run(export)
    asked = [json.loads(line) for line in (here / "asked" / "asked.jsonl").read_text("utf-8").splitlines()]
    answers = [json.dumps({"call": row["call"], "text": "SLOW"}) for row in asked]
    (here / "answers.jsonl").write_text("\n".join(answers) + "\n", encoding="utf-8")
    unnamed = here / "unnamed.jsonl"
    unnamed.write_text("\n".join(one.replace('"text"', '"said"') for one in answers) + "\n", encoding="utf-8")
    refused = CliRunner().invoke(app, [*bring[:2], "unnamed.jsonl", *bring[3:]])
    assert "no row has a 'text' (or answer, response, reply" in str(refused.exception)
    run(bring)
    assert "NAME" in run(["verdict", "run"])
