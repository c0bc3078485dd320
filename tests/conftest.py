"""Options of the whole test run; they stand here so that plain ``pytest`` knows them too."""

import gc
import os
import re
import signal
from collections import Counter
from collections.abc import Generator, Iterator
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # read when NumPy or Torch is imported, here and in every child

import pytest
from hypothesis import settings

import known

settings.register_profile("no clock", deadline=None)
settings.load_profile("no clock")


FIRST = (
    "test_adversarial_runs.py",
    "test_battery_kill.py",
    "test_episodes_kill.py",
    "test_calibrate.py",
    "test_validate_drives.py",
    "test_policy.py",
    "test_battery_stop_early.py",
    "test_calibrate_early.py",
    "test_hierarchy.py",
    "test_every_simulator.py",
    "test_transformers_serve.py",
    "test_estimating_organisms.py",
    "test_organisms.py",
    "test_every_page_browser.py",
)
"""Files of few and long tests, the longest first; where several processes share the tests, none is left at the end."""


CORE = "not models and not browser and not slow"
SLOW = "slow and not models and not browser"
_WHOLE_FILE = re.compile(r"^pytestmark = .*pytest\.mark\.(?:models|browser|slow)", re.MULTILINE)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out the files that have no test of what is asked for: to import them takes a while, and may need extras."""
    asked = config.option.markexpr
    if asked not in {"models", "browser", SLOW, CORE} or not collection_path.name.startswith("test_"):
        return None
    if collection_path.suffix != ".py":
        return None
    text = collection_path.read_text(encoding="utf-8")
    without = _WHOLE_FILE.search(text) is not None if asked == CORE else f"pytest.mark.{asked.split()[0]}" not in text
    return True if without else None


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Have the garbage collector pass over what was imported and collected: it stays to the end, and is much."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the long files first, then the others by how many tests they have."""
    tests = Counter(item.path for item in items)
    places = {name: place for place, name in enumerate(FIRST)}
    items.sort(key=lambda item: (places.get(item.path.name, len(FIRST)), -tests[item.path], item.path))


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add ``--vectors FILE``: other paper vectors than the copy in the repository.

    Without a path on the command line write ``--vectors=FILE``: pytest looks for this file beside its first
    argument, and would take a FILE of its own for that.
    """
    parser.addoption(
        "--vectors",
        type=Path,
        default=Path(__file__).parent / "paper" / "paper_vectors.json",
        metavar="FILE",
        help="the paper's numbers with their inputs, as JSON (default: tests/paper/paper_vectors.json)",
    )


@pytest.fixture(autouse=True)
def _interrupts() -> Iterator[None]:
    """Give an interrupt back its meaning: a command that ends in this process leaves a handler that exits at once."""
    yield
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def demo(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> known.Demo:
    """Return the one demo of this test session, shared by its workers."""
    base = tmp_path_factory.getbasetemp()
    return known.demo(base if worker_id == "master" else base.parent)
