"""One thing is one, and two are several, wherever a number is said."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from banks import build_bank
from eyechart.cli.app import app
from eyechart.errors import LedgerError, counted
from eyechart.ledger import Ledger


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((1, "frame"), "1 frame"),
        ((0, "frame"), "0 frames"),
        ((2, "policy"), "2 policies"),
        ((2, "process"), "2 processes"),
        ((1, "call", "are"), "1 call is"),
        ((2, "call", "have"), "2 calls have"),
        ((1, "more model", "stand"), "1 more model stands"),
    ],
)
def test_a_number_has_its_noun_and_its_verb(words: tuple[int, str], said: str) -> None:
    """By the endings of English."""
    assert counted(*words) == said


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["run", "battery"], "1 model × 1 frame × 1 condition"),
        (["run", "prompts", "--prompt", "baseline"], "1 cell × 1 model: "),
    ],
)
def test_a_plan_of_one_is_said_in_the_singular(tmp_path: Path, words: list[str], said: str) -> None:
    """Of every kind of run on a bank."""
    bank = build_bank(tmp_path / "bank", episodes=2, steps=2).root
    more = ["--model", "scripted:depth", "--frames", str(bank), "--out", str(tmp_path / "run"), "--dry-run"]
    result = CliRunner().invoke(app, [*words, *more, "--limit", "1", "--conditions", "real"])
    assert result.exit_code == 0, result.output
    assert said in result.stderr


def test_a_run_that_asked_nobody_yet_is_called_one(tmp_path: Path) -> None:
    """What is no run at all is asked whether it is one."""
    (tmp_path / "run.json").write_text("{}")
    with pytest.raises(LedgerError, match="its run made no call yet"):
        Ledger(tmp_path / "ledger.sqlite")
    with pytest.raises(LedgerError, match=r"is .*none a run\? 'eyechart run' makes one"):
        Ledger(tmp_path / "none" / "ledger.sqlite")
