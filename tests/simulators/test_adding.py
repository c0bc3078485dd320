"""An older bank gets the pictures that it lacks, into a copy or into itself, and nothing of it is ever half-written."""

import json
import shutil
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

import banks
from eyechart.cli.app import app
from eyechart.conditions import RANGED
from eyechart.errors import BankError, SpecError
from eyechart.frames import BankManifest, FrameBank, check, open_bank
from eyechart.manifest import read_run
from eyechart.records import build
from eyechart.simulators import additions
from eyechart.simulators.additions import add_missing
from eyechart.simulators.banks import BOXED, DOZENS
from eyechart.simulators.rover import Rover
from eyechart.studies import battery

Change = Callable[[dict[str, object]], object]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of today, in the staging of before."""
    out = tmp_path_factory.mktemp("whole") / "bank"
    return Rover().build(out, seeds=(3,), steps=4, controls_seed=11, staging=DOZENS)


@pytest.fixture
def old(whole: FrameBank, tmp_path: Path) -> Path:
    """Return the same bank as an older eyechart wrote it: without what is drawn over the whole range.

    Of its first frame it has a picture that is drawn no more, with its distances.
    """
    root = tmp_path / "old"
    shutil.copytree(whole.root, root)
    raw = json.loads((root / "manifest.json").read_text())
    del raw["span"], raw["strata"]
    raw["controls"]["distances"] = {whole.frames[0].id: OLDER_M}
    rows = [json.loads(line) for line in (root / "metadata.jsonl").read_text().splitlines()]
    for row in rows:
        for name in RANGED:
            if (file := row.pop(f"{name}_file_name", None)) is not None:
                raw["images"].pop(file)
                (root / file).unlink()
    file = f"counterfactuals/{whole.frames[0].id}-lane_own.png"
    (root / file).write_bytes(whole.image(whole.frames[0]))
    digests = {**raw["images"], file: raw["images"][whole.frames[0].file]}
    rows[0]["lane_own_file_name"] = file
    raw["images"] = {
        row[name]: digests[row[name]]
        for row in rows
        for name in ("file_name", *(name for name in sorted(row) if name.endswith("_file_name")))
    }
    (root / "manifest.json").write_text(json.dumps(raw))
    (root / "metadata.jsonl").write_text("".join(f"{json.dumps(row)}\n" for row in rows))
    assert check(root) == []
    return root


def contents(root: Path) -> dict[str, bytes]:
    """Return every file of a folder."""
    return {str(path.relative_to(root)): path.read_bytes() for path in sorted(root.rglob("*")) if path.is_file()}


OLDER_M = {"lane_far_m": 20.0, "lane_near_m": 4.0}


def as_whole(bank: FrameBank, whole: FrameBank) -> None:
    """Fail unless a bank is the one that is built today, told otherwise, with the older picture that it had."""
    assert check(bank.root) == []
    first, *others = bank.frames
    assert tuple(others) == whole.frames[1:]
    assert first.counterfactuals.keys() - whole.frames[0].counterfactuals.keys() == {"lane_own"}
    assert first.truth == {**whole.frames[0].truth, **OLDER_M}
    older = first.counterfactuals["lane_own"]["main"]
    images = {file: digest for file, digest in bank.manifest.images.items() if file != older}
    assert images == whole.manifest.images
    assert bank.read(older) == whole.image(whole.frames[0])
    distances = dict(whole.manifest.controls.distances)
    distances[first.id] = {**distances[first.id], **OLDER_M}
    assert bank.manifest.controls == replace(whole.manifest.controls, distances=distances)
    assert (bank.manifest.span, bank.manifest.strata) == (whole.manifest.span, whole.manifest.strata)
    assert bank.manifest.fingerprint == whole.manifest.fingerprint


def test_a_copy_gets_what_is_missing_and_the_older_bank_stays(old: Path, whole: FrameBank, tmp_path: Path) -> None:
    """It is the bank that is built today, to the bit."""
    before = contents(old)
    bank, count = add_missing(old, tmp_path / "new")
    as_whole(bank, whole)
    assert count == len(whole.manifest.images) - (len(open_bank(old).manifest.images) - 1) > 0
    assert contents(old) == before
    with pytest.raises(BankError, match="exists already"):
        add_missing(old, tmp_path / "new")


def test_the_bank_itself_gets_what_is_missing_once(old: Path, whole: FrameBank) -> None:
    """What it holds is not touched but for its manifest; a second time there is nothing to add."""
    before = contents(old)
    bank, count = add_missing(old)
    as_whole(bank, whole)
    assert count > 0
    now = contents(old)
    assert {name for name in before if now[name] != before[name]} == {"manifest.json"}
    assert add_missing(old)[1] == 0
    assert contents(old) == now
    assert not [path for path in old.parent.iterdir() if path.name.endswith(".part")]


@pytest.mark.parametrize("after", [0, 1, 7])
def test_a_bank_in_which_it_was_cut_off_is_the_one_that_it_was(
    old: Path, whole: FrameBank, monkeypatch: pytest.MonkeyPatch, after: int
) -> None:
    """Whichever picture came last, or none; the next attempt finishes it."""
    before, written = contents(old), 0

    def cut(path: Path, content: bytes) -> None:
        nonlocal written
        if written == after:
            raise KeyboardInterrupt
        written += 1
        path.write_bytes(content)

    with monkeypatch.context() as patched:
        patched.setattr(additions, "_write", cut)
        with pytest.raises(KeyboardInterrupt):
            add_missing(old)
    assert contents(old).items() >= before.items()
    assert check(old) == []
    as_whole(add_missing(old)[0], whole)


def test_what_is_cut_off_before_the_manifest_is_replaced_changes_nothing(
    old: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a copy nothing is left."""

    def cut(*_: object) -> None:
        raise OSError("no space left")

    monkeypatch.setattr(additions, "replace_manifest", cut)
    for out in (None, tmp_path / "new"):
        with pytest.raises(OSError, match="no space"):
            add_missing(old, out)
    assert check(old) == []
    assert not (tmp_path / "new").exists()


def test_a_bank_that_is_drawn_otherwise_today_is_refused(old: Path, whole: FrameBank, tmp_path: Path) -> None:
    """As one that no simulator made, one that is damaged, and one whose episodes were staged in another way."""
    with pytest.raises(SpecError, match="not built by 'eyechart frames build'"):
        add_missing(banks.build_bank(tmp_path / "boxes").root)
    for words, change in (
        ("differently from the bank", lambda raw: raw["settings"].update(seeds=[4])),
        ("staged its episodes of 13 steps differently", lambda raw: raw["settings"].update(steps=13, staging=None)),
    ):
        other = tmp_path / words[:9]
        shutil.copytree(old, other)
        rewritten(other, change)
        with pytest.raises(BankError, match=words):
            add_missing(other)
        assert check(other) == []
    (old / whole.frames[0].file).write_bytes(b"x")
    with pytest.raises(BankError, match="it is damaged"):
        add_missing(old)


def rewritten(root: Path, change: Change) -> None:
    """Change what a bank says of itself, its declaration too; a setting that becomes None is left out."""
    path = root / "manifest.json"
    raw = json.loads(path.read_text())
    change(raw)
    raw["settings"] = {name: one for name, one in raw["settings"].items() if one is not None}
    path.write_text(json.dumps(raw))
    with pytest.raises(BankError, match=r"declaration .* was changed after it was made"):
        open_bank(root)
    kept = {field.name: raw[field.name] for field in fields(BankManifest) if field.name in raw}
    path.write_text(json.dumps(raw | {"declaration": build(BankManifest, kept).declaration}))


def test_a_bank_of_the_newer_staging_is_staged_as_it_was(tmp_path: Path) -> None:
    """Its version stands in its manifest."""
    bank = Rover().build(tmp_path / "bank", seeds=(3,), steps=4, staging=BOXED)
    assert add_missing(bank.root)[1] == 0
    assert open_bank(bank.root).manifest == bank.manifest


def test_a_run_goes_on_with_what_came_to_its_bank(old: Path, tmp_path: Path) -> None:
    """Its copy of the bank's text says so too; a bank that lost or changed a picture is another one."""
    asked = ("real", "lead_near", "lead_drawn", "exchange_own_nudged")
    battery.run(battery.plan(old, ["scripted:depth"], tmp_path / "run", conditions=asked[:2]))
    lacking = open_bank(old).manifest
    add_missing(old)
    battery.run(battery.plan(old, ["scripted:depth"], tmp_path / "run", conditions=asked))
    _, bank = read_run(tmp_path / "run")
    assert bank.manifest.images.items() > lacking.images.items()
    score = battery.score(tmp_path / "run", resamples=50)
    decisions = score.models["scripted:depth"].answers.decisions
    for name in asked:
        drawn = name.removesuffix("_nudged")
        there = sum(drawn == "real" or drawn in frame.counterfactuals for frame in bank)
        assert sum(one is not None for one in decisions[name]) == there > 0


def test_the_command_says_what_it_did(old: Path, tmp_path: Path) -> None:
    """And what it wants, where it is given too little or too much."""

    def said(*words: object) -> tuple[int, str]:
        result = CliRunner().invoke(app, ["frames", "build", *map(str, words)])
        return result.exit_code, f"{result.output}{result.exception or ''}"

    code, text = said("--add-to", old, "--out", tmp_path / "new")
    assert (code, "pictures added; 20 frames in" in text) == (0, True), text
    assert said("--add-to", old)[0] == 0
    code, text = said("--add-to", old)
    assert (code, "lacks none of its control pictures" in text) == (0, True), text
    for words in (("rover", "--add-to", old), (), ("rover",)):
        code, text = said(*words)
        assert code != 0
        assert "--add-to" in text
