"""Decisions are pages that are read once: short, in plain sentences, and no number of an older commit is lost."""

import re
from pathlib import Path

import pytest

DECISIONS = Path(__file__).parents[2] / "docs" / "decisions"
PAGES = sorted(DECISIONS.glob("*.md"))
GIVEN = [*range(1, 41), *range(43, 54), *range(57, 63)]
"""The numbers that decisions had while each was a file."""


def sentences(text: str) -> list[str]:
    """Return the sentences of a page's prose, without tables and headings."""
    parts = re.split(r"\n\s*\n|\n(?=- |#|\|)", re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL))
    prose = [" ".join(part.split()) for part in parts if not part.startswith(("#", "|"))]
    return [one for part in prose for one in re.split(r"(?<=[.!?])[\"*)`]*\s+(?=[A-Z`*\"(\[])", part)]


def test_a_sentence_ends_where_the_next_begins() -> None:
    """Or the count below would be of something else."""
    assert sentences("# A b.\n\nOne is .05. **Two** is.\n- Three\n  goes on\n\n| a | b |\n") == [
        "One is .05.",
        "**Two** is.",
        "- Three goes on",
    ]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_decision_is_read_once(page: Path) -> None:
    """Its prose is below 100 columns, its sentences have 30 words at most, and it takes a screen."""
    text = page.read_text(encoding="utf-8")
    lines = text.splitlines()
    assert [line for line in lines if len(line) > 99 and not line.startswith("|")] == []
    assert [sentence for sentence in sentences(text) if len(re.findall(r"\S*\w\S*", sentence)) > 30] == []
    assert len(lines) <= (100 if page.name == "README.md" else 55)


def test_every_number_says_where_it_stands_now() -> None:
    """Commits and results of before name a decision by its number."""
    text = (DECISIONS / "README.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\d+) \| .+ \| \[.+\]\((.+)\) \|$", text, re.MULTILINE)
    assert [int(number) for number, _ in rows] == GIVEN
    assert all((DECISIONS / place).is_file() for _, place in rows)


def test_every_page_is_in_the_list_of_subjects() -> None:
    """A page that the list does not name is found by nobody."""
    subjects = (DECISIONS / "README.md").read_text(encoding="utf-8").partition("\n## ")[0]
    assert set(re.findall(r"\(([\w-]+\.md)\)", subjects)) == {page.name for page in PAGES} - {"README.md"}
