"""Numbers that pages say were measured are those of the committed results, which tell their version and date."""

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "benchmarks" / "results"
NUMBERS = tomllib.loads((Path(__file__).parent / "numbers.toml").read_text(encoding="utf-8"))["number"]


@pytest.mark.parametrize("one", NUMBERS, ids=lambda one: f"{one['file']} {one['key']}")
def test_a_number_on_a_page_is_that_of_its_result(one: dict[str, Any]) -> None:
    """To as many places as the page prints."""
    before, after = map(re.escape, one["says"].split("{}"))
    page = " ".join((ROOT / one["page"]).read_text(encoding="utf-8").split())
    found = re.findall(f"{before}([0-9.][0-9 .]*){after}", page)
    assert len(found) == 1, f"{one['page']} says {one['says']!r} {len(found)} times"
    result = json.loads((RESULTS / one["file"]).read_text(encoding="utf-8"))
    keys = one["key"] if isinstance(one["key"], list) else [one["key"]]
    measured = sum(_at(result, key) for key in keys)
    told = found[0].replace(" ", "")
    places = len(told.partition(".")[2])
    assert float(told) == pytest.approx(round(measured * one.get("scale", 1), places), abs=1e-9)


def _at(found: Any, key: str) -> float:  # noqa: ANN401 - JSON of any shape
    """Return the number at a place; of a list the ``least`` or the ``most``, of "3 of 7" its ``hits`` or the ``of``."""
    for part in key.split("/"):
        if isinstance(found, list):
            found = {"least": min, "most": max}[part](found)
        elif isinstance(found, str):
            found = float(found.split(" of ")[("hits", "of").index(part)])
        else:
            found = found[part]
    return found


def test_every_result_tells_its_version_and_date() -> None:
    """Or nobody knows of which eyechart a number is."""
    for file in RESULTS.glob("*.json"):
        text = file.read_text(encoding="utf-8")
        assert re.search(r'"(version|eyechart|new)": "', text), file.name
        assert re.search(r'"date": "20', text), file.name
