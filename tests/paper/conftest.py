"""The paper's numbers as test cases: which are checked, and which are left out by their kind."""

import json
from collections import Counter
from pathlib import Path

import pytest

CHECKED = ("statistic", "rate")
LEFT_OUT = ("arithmetic", "feasibility")
KEYS = ("id", "kind", "function", "inputs", "expected", "tolerance")


def read_vectors(path: Path) -> list[dict]:
    """Return the entries of a vector file; CollectError where it is missing or not what it should be."""
    try:
        entries = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise pytest.Collector.CollectError(f"paper vectors '{path}' cannot be read ({error.strerror})") from error
    except ValueError as error:
        raise pytest.Collector.CollectError(f"paper vectors '{path}' are not JSON: {error}") from error
    if not isinstance(entries, list) or not any(
        isinstance(entry, dict) and entry.get("kind") in CHECKED for entry in entries
    ):
        raise pytest.Collector.CollectError(f"paper vectors '{path}' hold no entry of kind {' or '.join(CHECKED)}")
    for place, entry in enumerate(entries):
        missing = [key for key in KEYS if not isinstance(entry, dict) or key not in entry]
        if missing:
            raise pytest.Collector.CollectError(f"paper vectors '{path}': entry number {place} lacks {missing}")
        if entry["kind"] not in CHECKED + LEFT_OUT:
            raise pytest.Collector.CollectError(f"paper vectors '{path}': '{entry['id']}' is of kind '{entry['kind']}'")
    return entries


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Make one test of each checked entry; the left-out ones are counted in a test's name."""
    if "vector" in metafunc.fixturenames:
        checked = [v for v in read_vectors(metafunc.config.getoption("vectors")) if v["kind"] in CHECKED]
        metafunc.parametrize("vector", checked, ids=[v["id"] for v in checked])
    if "left_out" in metafunc.fixturenames:
        counts = Counter(v["kind"] for v in read_vectors(metafunc.config.getoption("vectors")))
        left_out = {kind: counts[kind] for kind in LEFT_OUT}
        name = "-".join(f"{number}_{kind}" for kind, number in left_out.items())
        metafunc.parametrize("left_out", [left_out], ids=[f"left_out_{name}"])
