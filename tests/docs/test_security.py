"""SECURITY.md: each promise names the test file that holds it, and it is found from where a reader begins."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "SECURITY.md").read_text(encoding="utf-8")
ROWS = [line for line in TEXT.splitlines() if line.startswith("| ") and not line.startswith("| promise |")]


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[2:60])
def test_every_promise_names_the_tests_that_hold_it(row: str) -> None:
    """Files that exist and hold tests, and nothing else in their column."""
    _, promise, held, _ = row.split("|")
    files = re.findall(r"`([^`]+)`", held)
    assert promise.strip()
    assert files
    assert re.sub(r"`[^`]+`|[,\s]", "", held) == ""
    for file in files:
        assert re.search(r"^(async )?def test_", (ROOT / file).read_text(encoding="utf-8"), re.MULTILINE), file


def test_every_attacker_has_promises_and_what_is_not_promised() -> None:
    """But the reports that open in a browser, of which all is promised that there is."""
    parts = re.split(r"^### ", TEXT, flags=re.MULTILINE)[1:]
    assert len(parts) >= 6
    assert len(ROWS) >= 25
    for part in parts:
        assert "| promise | held by |" in part, part[:40]
    assert sum("**Not promised.**" in part for part in parts) >= 5
    for words in ("python:", "gym:", "trust_remote_code", "energy", "Report a vulnerability"):
        assert words in TEXT


@pytest.mark.parametrize(("page", "link"), [("README.md", "SECURITY.md"), ("docs/index.md", "security")])
def test_it_is_linked_where_a_reader_begins(page: str, link: str) -> None:
    """From the README, and from the table of contents of the site."""
    text = (ROOT / page).read_text(encoding="utf-8")
    assert f"({link})" in text or re.search(rf"^{link}$", text, re.MULTILINE)
    assert "../SECURITY.md" in (ROOT / "docs" / "security.md").read_text(encoding="utf-8")
