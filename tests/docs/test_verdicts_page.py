"""The page of verdicts says what the labels and the rows of the rules say, and has a paragraph a label."""

import importlib.util
import re
from types import ModuleType

import pytest

from eyechart.verdicts import LABELS, LATERAL
from eyechart.verdicts.depth import REFUTING, SHOWN
from eyechart.verdicts.numbers import ASKS, BESIDE, PHOTOGRAPHS
from pages import ROOT


@pytest.fixture(scope="module")
def update_verdicts() -> ModuleType:
    """Return the program that writes the tables."""
    spec = importlib.util.spec_from_file_location("update_verdicts", ROOT / "docs" / "update_verdicts.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_tables_are_what_the_rules_say(update_verdicts: ModuleType) -> None:
    """Where this fails, run: python docs/update_verdicts.py."""
    assert {file.name for file in update_verdicts.MADE} == {"verdicts.md", "policy-reference.md"}
    for file in update_verdicts.MADE:
        text = file.read_text(encoding="utf-8")
        assert text == update_verdicts.page(text, file), "run: python docs/update_verdicts.py"


def test_every_label_has_a_paragraph_and_its_answer(update_verdicts: ModuleType) -> None:
    """And says what it does not show."""
    text = update_verdicts.PAGE.read_text(encoding="utf-8")
    for label, one in LABELS.items():
        assert f"| [`{label}`](#{label}) | {one.answer} |" in text
    for label in (*LABELS, *LATERAL):
        paragraph = text.partition(f"\n### `{label}`\n")[2].partition("\n#")[0]
        assert "*Does not show:*" in paragraph, label


def test_the_rules_of_depth_are_one_screen(update_verdicts: ModuleType) -> None:
    """Each number is in a row, and the section is no longer than 50 lines."""
    section = update_verdicts.PAGE.read_text(encoding="utf-8").partition("\n### `depth`\n")[2].partition("\n### ")[0]
    assert len(section.splitlines()) <= 50
    rows = [line for line in section.splitlines() if line.startswith("| `")]
    named = [name for row in rows for name in re.findall(r"`(\w+)`", row.split("|")[1])]
    assert len(named) == len({**ASKS, **BESIDE, **PHOTOGRAPHS})


def test_every_clause_of_depth_has_its_row_in_the_table() -> None:
    """Or what a rule reads would stand on no page; those of older banks alone have none."""
    read = {clause.statistic for clause in (*SHOWN, *REFUTING)} - {"depth_net", "lane_net"}
    assert sorted(read - {*ASKS, *BESIDE, *PHOTOGRAPHS}) == [], "say in verdicts/numbers.py what it asks"


def test_a_page_without_its_marks_is_refused(update_verdicts: ModuleType) -> None:
    """It says which table is lost."""
    with pytest.raises(ValueError, match="lost the marks of its table 'labels'"):
        update_verdicts.page("# How to read each verdict")
