"""The prose of the pages is read once: short sentences, and lines that fit a screen."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FRONT = ("README.md", "CONTRIBUTING.md", "SECURITY.md", "CHANGELOG.md")
PAGES = tuple(
    page
    for page in sorted([*(ROOT / name for name in FRONT), *(ROOT / "docs").glob("*.md")])
    if "written by docs/" not in page.read_text(encoding="utf-8").partition("\n\n")[2].partition("\n")[0]
)
LONGEST = 29
"""Words of a sentence, at most."""
WIDEST = 100
"""Columns of a line of prose, at most."""
CHANGES = 80
"""Lines of the newest version in the changelog, at most."""
GENERATED = re.compile(r"^<!-- (.+?): written by .*?^<!-- end of \1 -->$", re.MULTILINE | re.DOTALL)
FENCED = re.compile(r"^( *)(`{3,}|:{3,}).*?^\1\2 *$", re.MULTILINE | re.DOTALL)
INDENTED = re.compile(r"(?<=\n\n)(?: {4,}.*\n(?:\n(?= {4}))?)+")
COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
NO_PROSE = re.compile(r"^ *(\||#|<|\([\w-]+\)=|!\[|\[[^\]]*\]:|\$\$)")
ITEM = re.compile(r"^ *(?:[-*]|\d+\.) +")
LINK_ALONE = re.compile(r"^ *(?:[-*]|\d+\.)? *!?\[[^\]]*\]\([^)]*\)[.,:;]?$")
END = re.compile(r"(?<=[.?!])['\")*_]* +(?=[\"'(*_`\[]*(?:[A-Z`\d]|eyechart\b|[np]: ))|:$")


def text_of(page: Path) -> str:
    """Return the text of a page; of a changelog the newest version, for an older one is history."""
    text = page.read_text(encoding="utf-8")
    return "\n## ".join(text.split("\n## ")[:2]) if page.name == "CHANGELOG.md" else text


def prose(text: str) -> list[tuple[int, str]]:
    """Return the lines of prose with their numbers; a blank line stands for what was left out."""
    for block in (GENERATED, FENCED, COMMENT, INDENTED):
        text = block.sub(lambda found: "\n" * found[0].count("\n"), text)
    lines = enumerate(text.splitlines(), start=1)
    return [(number, "" if NO_PROSE.match(line) else line) for number, line in lines]


def paragraphs(text: str) -> Iterator[tuple[int, str]]:
    """Yield each paragraph and each item of a list as one line, with the number of its first line."""
    begun, words = 0, ""
    for number, line in [*prose(text), (0, "")]:
        if words and (not line.strip() or ITEM.match(line)):
            yield begun, words
            words = ""
        if line.strip():
            begun = begun if words else number
            words = f"{words} {ITEM.sub('', line).strip()}".strip()


def sentences(paragraph: str) -> list[str]:
    """Split a paragraph into sentences; code counts as one word and a link as its text."""
    plain = re.sub(r"`+[^`]+`+", "`code`", paragraph)
    plain = re.sub(r"\$[^$]+\$", "`code`", plain)
    plain = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", plain)
    return [sentence for sentence in END.split(plain) if sentence.strip()]


def word_count(sentence: str) -> int:
    """Count the words; a dash or a sign alone is none."""
    return sum(1 for word in sentence.split() if re.search(r"\w", word))


def test_a_sentence_ends_where_the_next_begins() -> None:
    """Code is one word, a link is its text, an item stands alone, and what is no prose is left out."""
    text = (
        "# A b. C d.\n\nOne is .05 (`a b c`). **Two** is [a link](x.md),\nlong. eyechart is. n: frames.\n"
        "- Three\n  goes on\n- Four\n\n| a | b |\n\n    code here\n\n```sh\nmore code\n```\n\n"
        "<!-- x: written by y -->\nGenerated.\n<!-- end of x -->\n"
    )
    assert [sentence for _, words in paragraphs(text) for sentence in sentences(words)] == [
        "One is .05 (`code`).",
        "**Two** is a link, long.",
        "eyechart is.",
        "n: frames.",
        "Three goes on",
        "Four",
    ]
    assert word_count("a – `code` = 3") == 3


def test_the_pages_are_found() -> None:
    """All that a person writes; the reference of the command line is written by a program."""
    names = {page.name for page in PAGES}
    assert {"README.md", "SECURITY.md", "verdicts.md", "add-a-model.md"} <= names
    assert "cli.md" not in names


def test_the_newest_changes_are_read_on_two_screens() -> None:
    """What changed between releases, and not between days."""
    newest = text_of(ROOT / "CHANGELOG.md").partition("\n## ")[2]
    assert len(newest.splitlines()) <= CHANGES


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_no_sentence_has_thirty_words(page: Path) -> None:
    """A sentence that is longer becomes two, or a list."""
    found = paragraphs(text_of(page))
    long = [
        f"{page.name}:{number} {word_count(sentence)} words: {sentence}"
        for number, paragraph in found
        for sentence in sentences(paragraph)
        if word_count(sentence) > LONGEST
    ]
    assert not long, "\n".join(long)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_no_line_of_prose_is_wider_than_a_screen(page: Path) -> None:
    """Wrap prose at 100 columns; tables, code and a link alone on its line may be longer."""
    lines = prose(text_of(page))
    wide = [
        f"{page.name}:{number} {len(line)} columns"
        for number, line in lines
        if len(line) > WIDEST and not LINK_ALONE.match(line)
    ]
    assert not wide, "\n".join(wide)
