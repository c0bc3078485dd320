"""What is said of a verdict, word for word: in JSON, in the terminal and on the card."""

import json
from pathlib import Path

import pytest

import by_hand

KEPT = json.loads((Path(__file__).parent / "verdict_words.json").read_text(encoding="utf-8"))


def test_every_case_is_written_down() -> None:
    """None is new, and none is gone."""
    assert by_hand.names() == list(KEPT)


@pytest.mark.parametrize("case", KEPT)
def test_a_verdict_says_what_is_written_down(case: str) -> None:
    """Where words change on purpose, `python tests/by_hand.py > tests/verdict_words.json`, and read the difference."""
    assert json.loads(json.dumps(by_hand.said(case))) == KEPT[case]
