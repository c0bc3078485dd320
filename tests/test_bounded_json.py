"""A JSON text from elsewhere takes bounded memory, whatever it says: its values are counted before one is made."""

import ast
import json
import tracemalloc
import zipfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest

import eyechart
from banks import build_bank
from eyechart import inspect
from eyechart.episodes import EPISODES, read_episodes
from eyechart.errors import EyechartError, SourceError
from eyechart.frames import open_bank
from eyechart.importing import Faults, open_log
from eyechart.manifest import RUN, read_manifest
from eyechart.records import MOST_VALUES, parse_json
from eyechart.studies import run_json

ROOT = Path(eyechart.__file__).parent
WIDE = b"{}," * (MOST_VALUES // 2 + 1)
HEAD = b'{"eval":{"model":"m"}'
OWN = {
    "bundle/contents.py": 2,
    "bundle/pages.py": 2,
    "bundle/validation.py": 3,
    "inspect.py": 2,
    "kept.py": 1,
    "ledger/columns.py": 1,
    "ledger/counter.py": 1,
    "models/faults.py": 1,
    "models/http.py": 2,
    "models/huggingface/weights.py": 1,
    "models/lerobot/process.py": 1,
    "perception/estimators.py": 1,
    "records.py": 1,
    "spaces/motion.py": 1,
    "spaces/scene.py": 1,
    "studies/guardian/frozen.py": 1,
}
"""Where JSON is read that is bounded in bytes before (bundles, replies, the counter) or our own, and how many times."""


def _header(folder: Path) -> None:
    with zipfile.ZipFile(folder / "log.eval", "w", zipfile.ZIP_DEFLATED) as log:
        log.writestr("header.json", HEAD + b',"a":[' + WIDE + b"1]}")
    open_log(folder / "log.eval")


def _sample(folder: Path) -> None:
    with zipfile.ZipFile(folder / "log.eval", "w", zipfile.ZIP_DEFLATED) as log:
        log.writestr("header.json", HEAD + b"}")
        log.writestr("samples/1_epoch_1.json", b'{"a":[' + WIDE + b"1]}")
    faults = Faults()
    list(open_log(folder / "log.eval").answers(faults))
    faults.require_none("log.eval")


def _log(folder: Path) -> None:
    (folder / "log.json").write_bytes(HEAD + b',"samples":[' + WIDE + b"1]}")
    open_log(folder / "log.json")


def _run(folder: Path) -> None:
    (folder / RUN).write_bytes(b'{"format":[' + WIDE + b"1]}")
    assert run_json(folder) == {}
    read_manifest(folder)


def _bank(folder: Path) -> None:
    (folder / "manifest.json").write_bytes(b'{"format":[' + WIDE + b"1]}")
    open_bank(folder)


def _episodes(folder: Path) -> None:
    (folder / EPISODES).write_bytes(b'{"steps":[' + WIDE + b"1]}\n")
    list(read_episodes(folder))


@pytest.mark.parametrize("read", [_header, _sample, _log, _run, _bank, _episodes])
def test_a_file_of_many_small_values_is_refused_before_they_are_made(
    read: Callable[[Path], None], tmp_path: Path
) -> None:
    """Before one is made: each of three bytes would take about seventy."""
    tracemalloc.start()
    try:
        with pytest.raises(EyechartError, match=f"it holds more than {MOST_VALUES} values"):
            read(tmp_path)
        assert tracemalloc.get_traced_memory()[1] < 8 * len(WIDE)
    finally:
        tracemalloc.stop()


def _metadata(folder: Path) -> None:
    build_bank(folder / "bank")
    _grow(folder / "bank" / "metadata.jsonl")
    open_bank(folder / "bank")


def _grow(file: Path) -> None:
    """Make a file as large as no text is; it takes no room on a disk."""
    with file.open("ab") as opened:
        opened.truncate(1_000_000_001)


def _vast_run(folder: Path) -> None:
    _grow(folder / RUN)
    read_manifest(folder)


def _vast_json(folder: Path) -> None:
    _grow(folder / RUN)
    run_json(folder)


def _vast_bank(folder: Path) -> None:
    _grow(folder / "manifest.json")
    open_bank(folder)


def _vast_episodes(folder: Path) -> None:
    _grow(folder / EPISODES)
    list(read_episodes(folder))


@pytest.mark.parametrize("read", [_metadata, _vast_run, _vast_json, _vast_bank, _vast_episodes])
def test_a_text_that_is_too_large_is_refused_before_it_is_read(read: Callable[[Path], None], tmp_path: Path) -> None:
    """Whatever stands in it, even one value alone."""
    tracemalloc.start()
    try:
        with pytest.raises(EyechartError, match="more than the 1000000000 that are read"):
            read(tmp_path)
        assert tracemalloc.get_traced_memory()[1] < 50_000_000
    finally:
        tracemalloc.stop()


def test_an_export_is_read_within_bounds_where_inspect_runs_it(tmp_path: Path) -> None:
    """Without eyechart's own reader, which that environment may lack."""
    (tmp_path / "asked.jsonl").write_bytes(b"[" + WIDE + b"1]")
    (tmp_path / "asked.json").write_bytes(b"[" + WIDE + b"1]")
    for read in (lambda: list(inspect._rows(tmp_path)), lambda: inspect._batch(tmp_path)):
        with pytest.raises(SourceError, match="more than 1000000"):
            read()


def test_signs_in_a_text_are_no_values_where_few_are_there() -> None:
    """A long text alone is read, and one value more than may be is not."""
    assert parse_json(json.dumps(["x" * 100]), 50) == ["x" * 100]
    with pytest.raises(ValueError, match="it holds more than 3 values"):
        parse_json("[1,2,3,4]", 3)


def test_json_is_read_by_the_bounded_reader() -> None:
    """But where its bytes are bounded before, or are our own."""
    found = Counter[str]()
    for file in ROOT.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            call = node.func if isinstance(node, ast.Call) else None
            if not isinstance(call, ast.Attribute) or call.attr not in {"loads", "load"}:
                continue
            if isinstance(call.value, ast.Name) and call.value.id in {"json", "orjson"}:
                found[file.relative_to(ROOT).as_posix()] += 1
    assert found == OWN
