"""The "add a …" pages end in a passing test: each is followed to the letter on a copy of the tree."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

import pages
import test_layers

pytestmark = pytest.mark.slow

DOCS = Path(__file__).parents[2] / "docs"
PAGES = (
    "add-a-condition.md",
    "add-a-model.md",
    "add-a-policy.md",
    "add-an-importer.md",
    "add-a-simulator.md",
    "add-a-statistic.md",
    "add-a-study.md",
    "add-a-verdict.md",
)


@pytest.mark.parametrize("name", PAGES)
def test_the_page_followed_to_the_letter_ends_in_passing_tests(name: str, tmp_path: Path) -> None:
    """Its files and edits are made on a copy, its commands run there, and its code is in the house's style."""
    page = (DOCS / name).read_text(encoding="utf-8")
    tree = pages.copy_tree(tmp_path / "tree")
    printed = pages.follow(page, tree)
    assert re.search(r"^\d+ passed", printed[0], re.MULTILINE)
    assert "skipped" not in printed[0]
    assert test_layers.violations(test_layers.modules(tree / "src")) == []
    written = [step.path for step in pages.steps(page) if step.path.endswith(".py")]
    for words in (["check"], ["format", "--check"]):
        ruff = [str(Path(sys.executable).with_name("ruff")), *words, *written]
        done = subprocess.run(ruff, cwd=tree, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout


@pytest.mark.parametrize("name", PAGES)
def test_the_page_is_done_in_the_real_tree_nowhere(name: str) -> None:
    """What the page adds is not there yet, or following it would show nothing."""
    files = [step.path for step in pages.steps((DOCS / name).read_text(encoding="utf-8")) if step.kind == "file"]
    assert files
    assert [path for path in files if (pages.ROOT / path).exists()] == []


def test_an_edit_that_does_not_fit_says_so() -> None:
    """A page whose lines have gone from the tree fails, instead of doing nothing."""
    assert pages.edited("one\ntwo\n", " one\n+more\n") == "one\nmore\ntwo\n"
    assert pages.edited("one\ntwo\n", "-one\n+1\n two\n") == "1\ntwo\n"
    with pytest.raises(AssertionError, match="mend the page"):
        pages.edited("one\ntwo\n", " three\n+more\n")
    with pytest.raises(AssertionError, match="mend the page"):
        pages.edited("one\none\n", " one\n+more\n")
