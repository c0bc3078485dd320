"""The version is one, wherever it is said."""

import re
import tomllib
from pathlib import Path

from eyechart import __version__

ROOT = Path(__file__).parents[1]
VERSION = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
HEADS = re.findall(r"^## (\S+) \((.+)\)$", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)


def test_what_is_installed_is_this_checkout() -> None:
    """Where this fails, install it again: make test does it, or pip install --no-deps -e ."""
    assert __version__ == VERSION, f"installed is {__version__}, and pyproject.toml says {VERSION}: install it again"


def test_the_changelog_begins_with_this_version() -> None:
    """One in the making is unreleased; a release has its date."""
    version, when = HEADS[0]
    assert version == VERSION.partition(".dev")[0]
    assert bool(re.fullmatch(r"\d{4}-\d\d-\d\d", when)) == (".dev" not in VERSION), when
    assert when == "unreleased" or ".dev" not in VERSION


def test_every_earlier_version_in_the_changelog_has_a_date_and_is_kept() -> None:
    """What it made lies in tests/old."""
    assert HEADS[1:]
    for version, when in HEADS[1:]:
        assert re.fullmatch(r"\d{4}-\d\d-\d\d", when), (version, when)
        assert (ROOT / "tests" / "old" / version / "answers").is_dir(), f"{version} is not kept: tests/old/make.py"


def test_a_citation_names_the_last_release() -> None:
    """While a version is in the making, it is the one before."""
    cited = re.search(r"^version: (\S+)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE)
    assert cited
    assert cited[1] == (HEADS[1][0] if ".dev" in VERSION else VERSION)
