"""What fell on version 0.1.0 in the wild is a list, `wild.toml`, and tests that are there hold each point of it."""

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FAULTS = tomllib.loads((ROOT / "tests" / "wild.toml").read_text(encoding="utf-8"))["fault"]


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault["point"][:60])
def test_every_point_is_held_by_tests_that_are_there(fault: dict[str, object]) -> None:
    """Each named test is a function of its file; a point without any says what is missing."""
    tests = fault["tests"]
    assert isinstance(tests, list)
    assert bool(tests) != ("open" in fault)
    assert set(fault) <= {"point", "tests", "open"}
    for name in tests:
        file, _, function = name.partition("::")
        text = (ROOT / file).read_text(encoding="utf-8")
        assert re.search(rf"^(?:async )?def {function}\(", text, re.MULTILINE), name


def test_the_list_has_every_point_once() -> None:
    """Sixteen faults, what endpoints met, what photographs, answers made elsewhere and Python met."""
    points = [fault["point"] for fault in FAULTS]
    assert len(set(points)) == len(points)
    assert (
        sum(not point.startswith(("endpoints: ", "photographs: ", "elsewhere: ", "python: ")) for point in points) == 16
    )
    assert sum(point.startswith("endpoints: ") for point in points) >= 7
    assert sum(point.startswith("photographs: ") for point in points) == 3
