"""The code that adversarial rows are of: what decides a label is in its digest, what words it is not."""

import re
import shutil
from pathlib import Path

import pytest

import adversarial_counts as counts

ROOT = Path(__file__).parents[1]
SOURCE = Path("src", "eyechart")


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """Return a copy of the code that rows are of."""
    parts = ("verdicts", "studies/battery", "stats", "conditions")
    for part in (*(SOURCE / one for one in parts), Path("src", "eyechart_organisms"), Path("benchmarks")):
        shutil.copytree(ROOT / part, tmp_path / part, ignore=shutil.ignore_patterns("results", "__pycache__"))
    return tmp_path


def _change(file: Path, now: str, then: str) -> None:
    text = file.read_text(encoding="utf-8")
    assert now in text
    file.write_text(text.replace(now, then), encoding="utf-8")


def test_words_alone_make_no_other_code(tree: Path) -> None:
    """Those of a file that only words, and those of a function that only prints; a threshold does."""
    before = counts.said_of(tree)
    assert before == counts.said_of(ROOT)
    for name in counts.WORDING:
        file, _, function = name.partition(" ")
        now, then = (f"def {function}(", f"def {function}(*more, ") if function else ('"""', '"""Also, ')
        _change(tree / SOURCE / file, now, then)
    assert counts.said_of(tree) == before
    _change(tree / SOURCE / "verdicts" / "labels.py", "MARGIN = 0.1", "MARGIN = 0.11")
    after = counts.said_of(tree)
    assert after.rules != before.rules
    assert after.truth == before.truth
    _change(tree / SOURCE / "studies" / "battery" / "plans.py", "def _controls(self)", "def _controls(self, more=())")
    assert counts.said_of(tree).rules != after.rules


def test_what_decides_a_label_takes_nothing_but_words_from_what_is_left_out() -> None:
    """Which conditions are the moved ones stands there too, and is read by notes alone."""
    left_out = [name for name in counts.WORDING if " " not in name]
    names = "|".join(Path(name).stem for name in left_out)
    taken = re.compile(rf"from eyechart\.(?:verdicts|studies\.battery)\.({names}) import ([^#\n]+)")
    found = {
        (file.relative_to(ROOT / SOURCE).as_posix(), one, what.strip())
        for part in ("verdicts", "studies/battery", "stats")
        for file in (ROOT / SOURCE / part).rglob("*.py")
        if file.relative_to(ROOT / SOURCE).as_posix() not in left_out
        for one, what in taken.findall(file.read_text(encoding="utf-8"))
    }
    study = "studies/battery/study.py"
    assert {one for one in found if one[0] != study} == {
        ("verdicts/verdict.py", "why_not", "MOVED, WhyNot, is_below, why_not"),
        ("studies/battery/scores.py", "why_not", "MOVED"),
        ("studies/battery/plans.py", "reach", "unreachable_labels"),
    }
    assert {one for name, one, _ in found if name == study} == {"tables", "figures", "page"}
