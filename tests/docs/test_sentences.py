"""The prose of the pages is read once: short sentences, and lines that fit a screen."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FRONT = ("README.md", "CONTRIBUTING.md", "SECURITY.md")
PAGES = tuple(
    page
    for page in sorted([*(ROOT / name for name in FRONT), *(ROOT / "docs").glob("*.md")])
    if "written by docs/" not in page.read_text(encoding="utf-8").partition("\n\n")[2].partition("\n")[0]
)
LONGEST = 29
"""Words of a sentence, at most."""
WIDEST = 100
"""Columns of a line of prose, at most."""
GENERATED = re.compile(r"^<!-- (.+?): written by .*?^<!-- end of \1 -->$", re.MULTILINE | re.DOTALL)
FENCED = re.compile(r"^( *)(`{3,}|:{3,}).*?^\1\2 *$", re.MULTILINE | re.DOTALL)
COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
NO_PROSE = re.compile(r"^ *(\||#|<|\([\w-]+\)=|!\[|\[[^\]]*\]:|\$\$)")
ITEM = re.compile(r"^ *(?:[-*]|\d+\.) +")
LINK_ALONE = re.compile(r"^ *(?:[-*]|\d+\.)? *!?\[[^\]]*\]\([^)]*\)[.,:;]?$")
END = re.compile(r"(?<=[.?!])['\")*_]* +(?=[\"'(*_`\[]*(?:[A-Z`\d]|eyechart\b|[np]: ))|:$")


def prose(text: str) -> list[tuple[int, str]]:
    """Return the lines of prose with their numbers; a blank line stands for what was left out."""
    for block in (GENERATED, FENCED, COMMENT):
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


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_no_sentence_has_thirty_words(page: Path) -> None:
    """A sentence that is longer becomes two, or a list."""
    found = paragraphs(page.read_text(encoding="utf-8"))
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
    lines = prose(page.read_text(encoding="utf-8"))
    wide = [
        f"{page.name}:{number} {len(line)} columns"
        for number, line in lines
        if len(line) > WIDEST and not LINK_ALONE.match(line)
    ]
    assert not wide, "\n".join(wide)
