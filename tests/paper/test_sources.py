"""What is said to be the paper's is held to a copy of the numbers that it prints; what it does not print is ours.

`printed.json` beside this file holds the numbers and the counts of the paper's text, tables and captions.
"""

import json
import re
from pathlib import Path

import pytest

from eyechart.studies.closed_loop.tables import PUBLISHED as LADDER
from eyechart.studies.hierarchy.scoring import PUBLISHED as INTENT
from eyechart.studies.structured.tables import PAPER as CONTROL

ROOT = Path(__file__).parents[2]
PRINTED = json.loads((Path(__file__).with_name("printed.json")).read_text(encoding="utf-8"))
NUMBERS, COUNTS = frozenset(PRINTED["numbers"]), frozenset(PRINTED["counts"])
SECTIONS, LABELS = tuple(PRINTED["sections"]), frozenset(PRINTED["labels"])
CLAIM = re.compile(r"[Tt]he paper(?:'s)?((?:[ \n]+(?:[A-Za-z:'`-]+|\())*?)[ \n(]+(\.?\d+(?:\.\d+)?)(?![\w])")
"""The paper, or something of the paper's, with a number a few words behind it."""
WORDS = 6
SECTION = re.compile(r"\b[Ss]ections? (?=[A-Z])")
"""Behind it stands the name of a section: all that code and documents name so are the paper's."""
LABEL = re.compile(r"\\b(?:t|fgr|sn):[a-z]+(?:-[a-z]+)*")
FILES = sorted(
    path
    for pattern in ("src/eyechart/**/*.py", "src/eyechart/**/*.html", "src/eyechart/**/*.toml", "docs/**/*.md", "*.md")
    for path in ROOT.glob(pattern)
    if path.name not in {"CHANGELOG.md", "changelog.md"}
)
NOT_CLAIMS = {
    ("verdicts/paper.py", ".05"): "says that the paper prints no such cut",
    ("docs/paper-rules.md", "20"): "how often its rules, applied to our banks, give a label",
}
"""Numbers behind the paper's name that are not said to be its own, by the end of the file's path."""
OURS = {
    "src/eyechart/spaces/scene.py": "Ours, at 20 to 30 m/s and centre to centre",
    "src/eyechart/frames/nouns.py": "that it is centre to centre is ours",
    "src/eyechart/simulators/__init__.py": "STOP under the model-predictive controller is ours",
    "src/eyechart/prompts.py": "and prints none; the wording, and the sixth, are ours",
    "docs/statistics.md": "a cut that is ours",
}
"""What the paper does not print, by the words that say so."""


def claims(text: str) -> list[str]:
    """Return the numbers that stand a few words behind the paper's name."""
    return [found[2] for found in CLAIM.finditer(text) if len(found[1].split()) <= WORDS]


def is_printed(number: str) -> bool:
    """Return whether the paper prints a number, as it is or as a share of a percentage."""
    return float(number) in NUMBERS or round(float(number) / 100, 6) in NUMBERS


def test_every_number_that_is_said_to_be_the_papers_is_printed_there() -> None:
    """In code, templates, tables of data and documents; the program finds a dozen of them, and a wrong one."""
    found = [(path.relative_to(ROOT).as_posix(), one) for path in FILES for one in claims(path.read_text("utf-8"))]
    excused = {key for key in NOT_CLAIMS for path, one in found if path.endswith(key[0]) and one == key[1]}
    assert excused == NOT_CLAIMS.keys(), "an exception that excuses nothing is to be taken out"
    unlike = [
        f"{path}: the paper … {one}"
        for path, one in found
        if not is_printed(one) and not any(path.endswith(key[0]) and one == key[1] for key in NOT_CLAIMS)
    ]
    assert not unlike, unlike
    assert len(found) >= 12
    assert [is_printed(one) for one in claims("The paper's frames are 289, and the paper prints .583 of them")] == [
        False,
        True,
    ]


def plain(text: str) -> str:
    """Return a text on one line, in small letters, with hyphens for dashes."""
    return " ".join(re.sub("--|–", "-", text).split()).lower()


def test_every_section_and_label_that_is_named_as_a_source_is_in_the_paper() -> None:
    """By its title, or the label of its table or figure; where there are two, also the one behind 'and' or a comma."""
    named, unknown = 0, []
    titles = sorted((plain(one) for one in SECTIONS), key=len, reverse=True)
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
    assert {count for goals, crashes, _, _ in INTENT.values() for count in (goals, crashes)} <= COUNTS
    numbers = [one for *_, metres, stops in INTENT.values() for one in (metres, stops and round(100 * stops, 1))]
    assert all(one in NUMBERS for one in numbers if one is not None)
    assert all(float(value) in NUMBERS for value in CONTROL)


def test_where_ours_is_not_the_papers_number_the_page_says_how_far_off() -> None:
    """The policy that reads its pixels: the value is computed in test_frontier, which holds it to this page."""
    page = (ROOT / "docs" / "paper.md").read_text(encoding="utf-8")
    assert "V is .583 here, where the paper prints .61" in page
    assert 0.61 in NUMBERS
    assert 0.083 in NUMBERS
