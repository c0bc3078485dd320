"""A bundle that would take for ever, or all memory, is refused before the work begins, and the bound is named."""

import json
import re
import resource
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

import banks
import stand_ins
from bundles import repacked
from eyechart.bundle import validate, validation, write_bundle
from eyechart.errors import BundleError
from report_runs import make_run

MOST_KB = 400_000
"""What validating any of these may add to the memory of the process, in kB."""


@pytest.fixture(scope="module")
def packed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a bundle of a small run."""
    folder = tmp_path_factory.mktemp("packed")
    bank = banks.build_bank(folder / "bank", episodes=1)
    run = make_run(bank.root, folder / "run", {"noisy": stand_ins.noisy})
    write_bundle(run, folder / "run.zip", resamples=200)
    return folder / "run.zip"


def in_json(name: str, change: Callable[[dict[str, object]], str]) -> Callable[[Path], None]:
    """Return a change of a file of JSON, given what it holds."""

    def changed(folder: Path) -> None:
        file = folder / name
        file.write_text(change(json.loads(file.read_text(encoding="utf-8"))), encoding="utf-8")

    return changed


def run_with(**more: object) -> Callable[[Path], None]:
    """Return a change of fields of the run's manifest."""
    return in_json("run/run.json", lambda raw: json.dumps(raw | more))


def deep(name: str) -> Callable[[Path], None]:
    """Return a change that makes a file a list in a list in a list, and so on."""
    return lambda folder: (folder / name).write_text("[" * 10**6 + "]" * 10**6, encoding="utf-8") and None


def many_frames(folder: Path) -> None:
    """Make a bank of the same frame, more often than any bank has frames."""
    file = folder / "run" / "bank" / "metadata.jsonl"
    file.write_bytes(b"{}\n" * (validation.MOST_FRAMES + 1))


STRANGE = {
    "repeated conditions": (
        run_with(conditions=["real"] * 10**6),
        r"it has 1000000 conditions, more than the 1000 that",
    ),
    "a long seed": (run_with(seed=10**400), r"seed is 1000\d+…, not a number up to 1e\+30"),
    "a longer seed": (
        in_json("run/run.json", lambda raw: json.dumps(raw).replace('"seed": 0', f'"seed": {"9" * 4400}')),
        r"run\.json is no run manifest: .*\d+ digits",
    ),
    "many answers": (run_with(answers=10**9), r"answers is 1000000000, not a number from 1 to 10000"),
    "repeated frames": (
        run_with(frames=["light-0-0"] * 10**6),
        r"it has \d+ planned calls, more than the 5000000 that",
    ),
    "many models": (
        run_with(models={f"scripted:m{number}": "1" for number in range(200_000)}),
        r"it has \d+ planned calls, more than the 5000000 that",
    ),
    "many frames": (many_frames, r"it has 250001 frames, more than the 250000 that are validated"),
    "a deep manifest": (deep("run/run.json"), r"run\.json is no run manifest: .*recursion"),
    "a deep bank": (deep("run/bank/manifest.json"), r"manifest\.json is no bank manifest: .*recursion"),
    "deep frames": (deep("run/bank/metadata.jsonl"), r"metadata\.jsonl, line 1: .*recursion"),
    "deep results": (deep("results.json"), r"results\.json: printed '"),
    "a list of lists": (
        in_json("run/run.json", lambda raw: json.dumps(raw | {"models": [[]] * 300_000})),
        r"run\.json is no run manifest",
    ),
}


@pytest.mark.parametrize("what", STRANGE)
def test_a_bundle_beyond_a_bound_is_refused_by_its_name(packed: Path, tmp_path: Path, what: str) -> None:
    """The bound is named as the first thing that follows from the run, and memory stays small."""
    change, words = STRANGE[what]
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    found = validate(repacked(packed, tmp_path, change))
    assert not found.holds
    assert any(re.search(words, str(difference)) for difference in found.differences), found.differences
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < MOST_KB


@pytest.mark.parametrize(
    ("name", "size", "words"),
    [
        ("run/run.json", 16_000_001, r"'run/run\.json' has 16000001 bytes, more than the 16000000 that are allowed"),
        ("results.json", 64_000_001, "more than the 64000000 that are allowed"),
        ("run/bank/metadata.jsonl", 128_000_001, "more than the 128000000 that are allowed"),
        ("bundle.json", 200_000, "'bundle.json' has 200000 bytes, more than the 101000 that are allowed"),
    ],
)
def test_a_file_of_text_that_is_too_long_is_not_unpacked(tmp_path: Path, name: str, size: int, words: str) -> None:
    """What JSON becomes in memory is many times as long as its text."""
    with zipfile.ZipFile(tmp_path / "b.zip", "w", zipfile.ZIP_STORED) as packed:
        packed.writestr(name, b" " * size)
    with pytest.raises(BundleError, match=words):
        validate(tmp_path / "b.zip")
