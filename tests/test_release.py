"""The version is one, wherever it is said."""

import re
import tomllib
from importlib.metadata import version as installed
from pathlib import Path

import pytest

from eyechart import __version__

ROOT = Path(__file__).parents[1]
HEADS = re.findall(r"^## (\S+) \((.+)\)$", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)


def test_what_is_installed_is_this_checkout() -> None:
    """Where this fails, install it again: make test does it, or pip install --no-deps -e ."""
    assert installed("eyechart") == __version__, "what pip knows of is another version: install it again"


def test_the_changelog_begins_with_this_version() -> None:
    """One in the making is unreleased; a release has its date."""
    version, when = HEADS[0]
    assert version == __version__.partition(".dev")[0]
    assert bool(re.fullmatch(r"\d{4}-\d\d-\d\d", when)) == (".dev" not in __version__), when
    assert when == "unreleased" or ".dev" not in __version__


def test_every_earlier_version_in_the_changelog_has_a_date_and_is_kept() -> None:
    """What it made lies in tests/old."""
    assert HEADS[1:]
    for version, when in HEADS[1:]:
        assert re.fullmatch(r"\d{4}-\d\d-\d\d", when), (version, when)
        assert (ROOT / "tests" / "old" / version / "answers").is_dir(), f"{version} is not kept: tests/old/make.py"


def test_a_citation_names_this_version() -> None:
    """Also while it is in the making: who cites a checkout cites what is in it, and that is not the last release."""
    cited = re.search(r"^version: (\S+)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE)
    assert cited
    assert cited[1] == __version__


def test_the_workflows_only_call_make() -> None:
    """Each step is one target of the Makefile, so that what fails there can be run here."""
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    flows = [path.read_text(encoding="utf-8") for path in (ROOT / ".github" / "workflows").glob("*.yml")]
    steps = [step for text in flows for step in re.findall(r"^ *(?:- )?run: *(.*)$", text, re.MULTILINE)]
    assert steps
    assert set(steps) <= {f"make {target}" for target in targets}


@pytest.mark.parametrize(
    "marks", [set(), {"slow"}, {"models"}, {"browser"}, {"slow", "lerobot"}, {"slow", "models"}, {"slow", "browser"}]
)
def test_each_test_is_run_by_one_target(marks: set[str]) -> None:
    """A slow test that needs an extra is run where the extra is, and nowhere else; none is run by none."""
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    asked = dict(re.findall(r"^(test[a-z-]*):.*\n(?:\t.*\n)*?\t.*pytest.* -m \"?(.+?)\"?$", makefile, re.MULTILINE))
    slow = "$(if $(WITH_SLOW),, and not slow)"
    assert asked["test"].count(slow) == 1
    both, asked["test"] = asked["test"].replace(slow, ""), asked["test"].replace(slow, " and not slow")
    assert set(asked) == {"test", "test-slow", "test-models", "test-lerobot", "test-browser"}
    held = {mark: mark in marks for mark in ("slow", "models", "lerobot", "browser")}
    runs = [target for target, words in asked.items() if eval(words, {}, held)]  # noqa: S307 - our own file
    assert eval(both, {}, held) == bool({"test", "test-slow"} & {*runs})  # noqa: S307 - our own file
    assert len(runs) == 1, (marks, runs)


def test_the_classifiers_name_the_versions_that_are_tested() -> None:
    """No more and no fewer."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    said = [one.rpartition(" ")[2] for one in project["classifiers"] if re.search(r":: 3\.\d+$", one)]
    flow = (ROOT / ".github" / "workflows" / "checks.yml").read_text(encoding="utf-8")
    listed = re.search(r"python: \[(.*)\]", flow)
    assert listed
    assert said == re.findall(r"3\.\d+", listed[1])
