"""What is said to be the paper's is held to a copy of the numbers that it prints; what it does not print is ours.

`printed.json` beside this file holds the numbers and the counts of the paper's text, tables and captions.
"""

import ast
import io
import json
import re
import tokenize
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from eyechart.studies.closed_loop.tables import PUBLISHED as LADDER
from eyechart.studies.hierarchy.scores import PUBLISHED as INTENT
from eyechart.studies.hierarchy.scores import PUBLISHED_MODELS as MODELS
from eyechart.studies.structured.tables import PAPER as CONTROL

ROOT = Path(__file__).parents[2]
PRINTED = json.loads((Path(__file__).with_name("printed.json")).read_text(encoding="utf-8"))
NUMBERS, COUNTS = frozenset(PRINTED["numbers"]), frozenset(PRINTED["counts"])
SECTIONS, LABELS = tuple(PRINTED["sections"]), frozenset(PRINTED["labels"])
CLAIMS = tomllib.loads(Path(__file__).with_name("claims.toml").read_text(encoding="utf-8"))
"""The lines of the paper that print a quantity, and which of them each number beside its name is."""
NAMED = re.compile(r"\b[Tt]he paper(?:'s)?\b(?! rules)|\(paper, |\bpaper's\b(?! rule)|\b[Pp]ublished\b")
NUMBER = re.compile(r"(?<![\w.\[/#^-])\.?\d+(?:\.\d+)?(?![\w]|\.\d)")
SENTENCE = re.compile(r"(?<=[.;:!?])\s+(?=[\"'A-Z`*(_-])|\n\n|\|\n")
WORDS = 14
"""A number within so many words of the paper's name, in one sentence, is a claim."""
SECTION = re.compile(r"\b[Ss]ections? (?=[A-Z])")
"""Behind it stands the name of a section: all that code and documents name so are the paper's."""
LABEL = re.compile(r"\\b(?:t|fgr|sn):[a-z]+(?:-[a-z]+)*")
FILES = sorted(
    path
    for pattern in ("src/eyechart/**/*.py", "src/eyechart/**/*.html", "src/eyechart/**/*.toml", "docs/**/*.md", "*.md")
    for path in ROOT.glob(pattern)
    if path.name not in {"CHANGELOG.md", "changelog.md"}
)
WITHOUT = {"paper-rules.md", "README.md", "model-organisms.md"}
"""Documents that show what our own runs print, beside the paper's rules."""
OURS = {
    "src/eyechart/spaces/scene.py": "eyechart's values, for 20 to 30 m/s and centre to centre",
    "src/eyechart/frames/nouns.py": "centre to centre is eyechart's choice",
    "src/eyechart/simulators/__init__.py": "is eyechart's own choice",
    "src/eyechart/prompts.py": "and prints none; the wording and the sixth are eyechart's",
    "docs/statistics.md": "a cut that is ours",
    "docs/verdicts.md": "The cuts are ours, because it prints none: the level of .05, the 20 %",
    "src/eyechart/studies/battery/paper_statistics.py": "our choice, because the paper prints none",
    "src/eyechart/verdicts/paper.py": "The level is ours: the paper prints none",
    "src/eyechart/verdicts/labels.py": "The cut is ours; no model of the paper comes near",
    "src/eyechart/simulators/highway/drives.py": "The paper does not say how its bank was driven",
}
"""What the paper does not print, by the words that say so."""


def prose(path: Path) -> Iterator[str]:
    """Yield what a file says in words: a document whole; of code docstrings, comments and sentences that are printed.

    Before the docstring of a constant stands its number.
    """
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".md":
        yield text
        return
    tree = ast.parse(text)
    bodies = [node.body for node in ast.walk(tree) if isinstance(getattr(node, "body", None), list)]
    for before, one in ((a, b) for body in bodies for a, b in zip([None, *body], body, strict=False)):
        match before, one:
            case _, ast.Expr(value=ast.Constant(value=str(said))):
                value = getattr(getattr(before, "value", None), "value", None)
                yield f"{value:g} {said}" if isinstance(value, int | float) else said
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            each = [*node.args, *(word.value for word in node.keywords)]
            yield from (one.value for one in each if isinstance(one, ast.Constant) and isinstance(one.value, str))
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            yield token.string


def claims(text: str) -> list[str]:
    """Return the numbers within some words of the paper's name."""
    result = []
    for sentence in SENTENCE.split(text):
        named = list(NAMED.finditer(sentence))
        for one in NUMBER.finditer(sentence):
            between = (sentence[min(a.end(), one.end()) : max(a.start(), one.start())] for a in named)
            if min((len(words.split()) for words in between), default=WORDS + 1) <= WORDS:
                result.append(one[0])
    return result


def numbers_of(line: str) -> set[float]:
    """Return the numbers that a line prints, a percentage also as a share."""
    found = {float(one) for one in re.findall(r"(?<![\w.])\d+(?:\.\d+)?", line)}
    return found | {round(one / 100, 6) for one in found}


@pytest.mark.parametrize(
    ("text", "numbers"),
    [
        ('ALPHA = 0.05\n"""The paper\'s level of significance."""\n', ["0.05"]),
        ('"""Return the paper\'s label, by its rules as we read them, with its own alpha of .05."""\n', [".05"]),
        ('"""Frames nearer than 18 m (published: 81), with 24 steps 219 (published: about 220)."""\n', None),
        ('A = 18.0\n"""Nearer than this, centre to centre (paper, section The Input-Ablation Battery)."""\n', ["18"]),
    ],
)
def test_a_number_beside_the_papers_name_is_found(text: str, numbers: list[str] | None, tmp_path: Path) -> None:
    """Before and behind it, in the constant that a docstring is of, and as published."""
    file = tmp_path / "one.py"
    file.write_text(text)
    found = [claim for said in prose(file) for claim in claims(said)]
    assert found == (["18", "81", "24", "219", "220"] if numbers is None else numbers)


def test_every_number_beside_the_papers_name_is_of_a_line_that_prints_it() -> None:
    """Or stands in the list of what is none of the paper's; the lists hold nothing that is not said."""
    said = {
        (path.relative_to(ROOT).as_posix(), claim)
        for path in FILES
        if path.suffix in {".py", ".md"} and path.name not in WITHOUT
        for text in prose(path)
        for claim in claims(text)
    }
    listed = {
        (file, number): (kind, word)
        for kind in ("paper", "ours")
        for file, numbers in CLAIMS[kind].items()
        for number, word in numbers.items()
    }
    assert not (new := sorted(said - listed.keys())), f"say in claims.toml which line prints it, or call it ours: {new}"
    assert not (gone := sorted(listed.keys() - said)), f"nobody says this any more: {gone}"
    for (file, number), (kind, name) in listed.items():
        if kind == "paper":
            assert float(number) in numbers_of(CLAIMS["lines"][name]), (file, number, name)


def test_the_lines_hold_numbers_that_the_paper_prints() -> None:
    """By its copy, as numbers or as counts; and each line is somebody's source."""
    counted = {float(part) for count in COUNTS for part in count.split("/")}
    for name, line in CLAIMS["lines"].items():
        printed = {float(one) for one in re.findall(r"(?<![\w.^-])\d+(?:\.\d+)?", line)}
        assert {one for one in printed if one > 10 or one % 1} <= NUMBERS | counted, name
    used = {name for numbers in CLAIMS["paper"].values() for name in numbers.values()}
    assert used <= CLAIMS["lines"].keys()


def plain(text: str) -> str:
    """Return a text on one line, in small letters, with hyphens for dashes."""
    return " ".join(re.sub("--|–", "-", text).split()).lower()


def test_every_section_and_label_that_is_named_as_a_source_is_in_the_paper() -> None:
    """By its title, or the label of its table or figure; where there are two, also the one behind 'and' or a comma."""
    named, unknown = 0, []
    titles = sorted((plain(section) for section in SECTIONS), key=len, reverse=True)
    for path in FILES:
        text = path.read_text(encoding="utf-8")
        unknown += [f"{path.name}: {one}" for one in LABEL.findall(text) if one not in LABELS]
        joined = " ".join(text.split())
        for found in SECTION.finditer(joined):
            rest, named = plain(joined[found.end() : found.end() + 200]), named + 1
            title = next((one for one in titles if rest.startswith(one)), None)
            behind = re.match(r"(?: \([^)]*\))?(?:,| and) ", rest[len(title or "") :])
            if title is None or (
                found[0].lower() == "sections "
                and not (behind and any(rest[len(title) + behind.end() :].startswith(one) for one in titles))
            ):
                unknown.append(f"{path.name}: section {rest[:60]}")
    assert not unknown, unknown
    assert named >= 40


@pytest.mark.parametrize("file", OURS)
def test_what_the_paper_does_not_print_is_called_ours(file: str) -> None:
    """Distances but 18 m, how a gap is measured, STOP in the hierarchy, the prompts' words, the cut of unparsed."""
    text = " ".join((ROOT / file).read_text(encoding="utf-8").split())
    assert OURS[file] in text


def test_rows_that_stand_beside_ours_are_the_papers() -> None:
    """Every number of its tables that the code holds; a crash of one episode in 32 is its 3.1 %."""
    ladder = [value for row in LADDER.values() for name, value in row.items() if name != "crash_rate"]
    assert all(value in NUMBERS for value in ladder)
    assert all(round(100 * row["crash_rate"], 1) in NUMBERS for row in LADDER.values())
    intents = [*INTENT.values(), *(row for rows in MODELS.values() for row in rows.values())]
    assert {count for goals, crashes, _, _ in intents for count in (goals, crashes)} <= COUNTS
    numbers = [one for *_, metres, stops in intents for one in (metres, stops and round(100 * stops, 1))]
    assert all(number in NUMBERS for number in numbers if number is not None)
    assert all(float(value) in NUMBERS for value in CONTROL)


def test_where_ours_is_not_the_papers_number_the_page_says_how_far_off() -> None:
    """The policy that reads its pixels: the value is computed in test_frontier, which holds it to this page."""
    page = (ROOT / "docs" / "paper.md").read_text(encoding="utf-8")
    assert "V is .583 here, where the paper prints .61" in page
    assert 0.61 in NUMBERS
    assert 0.083 in NUMBERS
    assert "MAE is .016 to .045 m here, by the bank, where the paper prints .090" in page
    assert CONTROL[2] == 0.09
