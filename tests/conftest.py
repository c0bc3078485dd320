"""Options of the whole test run; they stand here so that plain ``pytest`` knows them too."""

import gc
import hashlib
import io
import os
import re
import signal
import sys
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Sequence
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

os.environ.setdefault("OMP_NUM_THREADS", "1")  # read when NumPy or Torch is imported, here and in every child

import pytest
import typer.main
import typer.testing
from filelock import FileLock
from hypothesis import settings
from PIL import Image

import known

if TYPE_CHECKING:
    from eyechart_organisms.calibration import Calibration

typer.main.get_command = typer.testing._get_command = cache(typer.main.get_command)
"""The tree of commands does not change, and each call of a command in this process would build it anew."""

MOST_KEPT = 3000
"""So many encoded pictures are kept, most of some 10 kB."""
Save = Callable[[Image.Image, IO[bytes], str | bytes], None]


def encoded_once(save: Save) -> Save:
    """Return Pillow's encoder as one that encodes equal pixels once: many tests show and print the same pictures.

    It asks eyechart for nothing, so that the tests of what fell run on an older source too.
    """
    kept: dict[bytes, bytes] = {}

    def save_kept(image: Image.Image, file: IO[bytes], name: str | bytes) -> None:
        plain = all(isinstance(one, bool | int | float | str | bytes) for one in image.encoderinfo.values())
        if image.info or image.mode != "RGB" or not plain:  # what there is besides pixels is written too
            return save(image, file, name)

        how = f"{image.size} {sorted(image.encoderinfo.items())}".encode()
        digest = hashlib.sha256(how + image.tobytes()).digest()
        encoded = kept.get(digest)
        if encoded is None:
            buffer = io.BytesIO()
            save(image, buffer, name)
            if len(kept) >= MOST_KEPT:
                kept.clear()
            encoded = kept[digest] = buffer.getvalue()
        file.write(encoded)
        return None

    return save_kept


Image.init()
for code in ("PNG", "WEBP"):
    Image.register_save(code, encoded_once(Image.SAVE[code]))

settings.register_profile("no clock", deadline=None)
settings.load_profile("no clock")


FIRST = (
    "test_add_a.py",
    "test_look.py",
    "test_readme.py",
    "test_validate_drives.py",
    "test_notebooks.py",
    "test_battery_stop_early.py",
    "test_adversarial_runs.py",
    "test_policy.py",
    "test_holes.py",
    "test_truth.py",
    "test_edited_pictures.py",
    "test_doors.py",
    "test_policy_mixtures.py",
    "test_edited_evidence.py",
    "test_policy_adversaries.py",
    "test_battery_drift.py",
    "test_battery_elsewhere.py",
    "test_trained.py",
    "test_closed_loop.py",
    "test_probed_drives.py",
    "test_battery_power.py",
    "test_corruptions.py",
    "test_faults_of_annotation.py",
    "test_calibrate.py",
    "test_highway.py",
    "test_rover.py",
    "test_served.py",
    "test_episodes_faults.py",
    "test_policy_faults.py",
    "test_policy_course.py",
    "test_importing_controls.py",
    "test_every_simulator.py",
    "test_stated_policy.py",
    "test_look_page.py",
    "test_servers_of_a_run.py",
    "test_guests_at_the_door.py",
    "test_known_answers.py",
    "test_battery_kill.py",
    "test_episodes_kill.py",
    "test_policy_tables.py",
    "test_api_policies.py",
    "test_calibrate_early.py",
    "test_hierarchy.py",
    "test_transformers_serve.py",
    "test_estimating_organisms.py",
    "test_organisms.py",
    "test_every_page_browser.py",
)
"""Files of few and long tests, the longest first; where several processes share the tests, none is left at the end."""


CORE = "not models and not browser and not lerobot and not slow"
SLOW = "slow and not models and not browser and not lerobot"
BOTH = "not models and not browser and not lerobot"
_WHOLE_FILE = {
    CORE: re.compile(r"^pytestmark = .*pytest\.mark\.(?:models|browser|lerobot|slow)", re.MULTILINE),
    BOTH: re.compile(r"^pytestmark = .*pytest\.mark\.(?:models|browser|lerobot)", re.MULTILINE),
}


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out the files that have no test of what is asked for: to import them takes a while, and may need extras."""
    asked = config.option.markexpr
    if collection_path.suffix != ".py" or not collection_path.name.startswith("test_"):
        return None
    text = collection_path.read_text(encoding="utf-8")
    if asked in _WHOLE_FILE and _WHOLE_FILE[asked].search(text):
        return True
    if asked in {"models", "browser", SLOW} and f"pytest.mark.{asked.split()[0]}" not in text:
        return True
    lacking = {name for name in _IMPORTS.findall(text) if name in MISSING}
    if lacking:
        LEFT_OUT[collection_path.name] = lacking
        return True
    return None


EXTRAS = {
    "models": ("datasets", "pyarrow", "av", "h5py", "torch", "transformers", "safetensors", "ray"),
    "browser": ("playwright", "axe_playwright_python"),
    "lerobot": ("EYECHART_LEROBOT_PYTHON", "pyarrow"),
}
"""The modules that the tests of a mark need, and that only an extra installs; a variable names another Python."""


def is_there(name: str) -> bool:
    """Return whether a module is installed, or a variable set."""
    return bool(os.environ.get(name)) if name.isupper() else find_spec(name) is not None


_IMPORTS = re.compile(r"^(?:from|import) (\w+)", re.MULTILINE)
MISSING = (
    frozenset[str]()
    if os.environ.get("EYECHART_EXTRAS") == "required"
    else frozenset(name for many in EXTRAS.values() for name in many if not is_there(name))
)
"""Modules without which tests are left out, by name; none where the extras are required: a test then fails."""
LEFT_OUT: dict[str, set[str]] = {}
"""What was left out, a file or a test, and the modules that it lacks."""


def _leave_out(items: list[pytest.Item], config: pytest.Config) -> None:
    """Take out the tests whose mark needs a module that is not installed."""
    lacking = {
        item: {name for mark, many in EXTRAS.items() if item.get_closest_marker(mark) for name in many} & MISSING
        for item in items
    }
    out = [item for item in items if lacking[item]]
    LEFT_OUT.update({item.nodeid: lacking[item] for item in out})
    if out:
        config.hook.pytest_deselected(items=out)
        items[:] = [item for item in items if not lacking[item]]


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say what was left out for want of an extra, and which."""
    if LEFT_OUT:
        names = ", ".join(sorted({name for many in LEFT_OUT.values() for name in many}))
        files = sum("::" not in name for name in LEFT_OUT)
        said = f"left out: {files} files and {len(LEFT_OUT) - files} tests that need {names}"
        terminalreporter.write_line(f"{said}: make test-models, test-browser and test-lerobot run them")


@pytest.hookimpl(wrapper=True)
def pytest_collection(session: pytest.Session) -> Generator[None, object, object]:
    """Have the garbage collector pass over what was imported and collected, which stays to the end, and look seldom.

    One worker is the first, and compiles what is not compiled yet; the others find it done, where each would do it.
    """
    gc.disable()
    base = session.config._tmp_path_factory.getbasetemp().parent
    try:
        if hasattr(session.config, "workerinput") and not sys.dont_write_bytecode:
            with FileLock(base / "collection.lock"):
                if not (base / "collected").exists():
                    result = yield
                    (base / "collected").touch()
                    return result
        return (yield)
    finally:
        gc.freeze()
        gc.set_threshold(20_000, 20, 20)
        gc.enable()


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item], config: pytest.Config) -> None:
    """Put the long files first, then the others by how many tests they have; leave out what lacks an extra."""
    _leave_out(items, config)
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
def shared(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> Path:
    """Return the folder of this test session that its workers share."""
    base = tmp_path_factory.getbasetemp()
    return base if worker_id == "master" else base.parent


@pytest.fixture(scope="module")
def few_pictures() -> Iterator[None]:
    """Let the pages of batteries picture six frames a run, in a module whose tests ask about a page's words alone."""
    from eyechart.report.page import evenly  # noqa: PLC0415 - few tests need it, and it takes a while to import
    from eyechart.studies.battery import page  # noqa: PLC0415

    make = page.make_album

    def of_few(evidence: Any, shown: Sequence[Sequence[int]], **how: Any) -> object:  # noqa: ANN401 - handed on
        return make(evidence, [evenly(places, 6) for places in shown], **how)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(page, "make_album", of_few)
        yield


@pytest.fixture(scope="session")
def demo(shared: Path) -> known.Demo:
    """Return the one demo of this test session, shared by its workers."""
    return known.demo(shared)


@pytest.fixture(scope="session")
def calibration(shared: Path) -> "Calibration":
    """Return the one calibration of the default setting of this test session, shared by its workers."""
    return known.calibration(shared)
