"""A run may have controls of its own: the bank's moments and pictures, with the distances of controls drawn anew."""

import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import banks
from eyechart import cli
from eyechart.conditions import CONTROLS
from eyechart.frames import FrameBank, check, open_bank
from eyechart.manifest import read_run
from eyechart.simulators.rover import Rover

Say = Callable[..., tuple[int, str]]


@pytest.fixture
def say(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Say:
    """Return a function that runs a command line: exit code, and all that it wrote."""

    def run(*words: object) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["eyechart", *map(str, words)])
        with pytest.raises(SystemExit) as left:
            cli.main()
        said = capsys.readouterr()
        return int(left.value.code or 0), said.out + said.err

    return run


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a small bank of the rover's."""
    return Rover().build(tmp_path_factory.mktemp("fresh") / "bank", seeds=(3,), steps=4)


def asked(bank: Path, out: Path, *more: str) -> tuple[object, ...]:
    """Return the words of a run with controls of its own."""
    words = ("--model", "scripted:depth", "--conditions", "real,lead_drawn,nudged", "--fresh-controls")
    return ("run", "battery", "--frames", bank, "--out", out, *words, *more)


@pytest.mark.slow
def test_a_run_has_controls_of_its_own_and_all_else_of_the_banks(bank: FrameBank, tmp_path: Path, say: Say) -> None:
    """Its folder holds the pictures; another run has others; the same command resumes; a report finds them."""
    seeds = set()
    for name in ("one", "other"):
        out = tmp_path / name
        code, said = say(*asked(bank.root, out))
        assert code == 0, said
        manifest, own = read_run(out)
        assert f"with seed {manifest.controls_seed}" in said
        seeds.add(manifest.controls_seed)
        assert check(out / "bank") == []
        assert own.manifest.fingerprint == bank.manifest.fingerprint
        assert own.manifest.controls.distances != bank.manifest.controls.distances
        for frame, before in zip(own, bank, strict=True):
            assert own.image(frame) == bank.image(before)
            for drawn in before.counterfactuals.keys() - set(CONTROLS):
                assert own.image(frame, drawn) == bank.image(before, drawn)
    assert len(seeds | {0}) == 3
    code, said = say(*asked(bank.root, tmp_path / "one"))
    assert (code, "drawn anew" in said, "0 to make" in said) == (0, False, True), said
    assert say("report", tmp_path / "one", "--out", tmp_path / "page.html")[0] == 0
    assert "data:image/webp" in (tmp_path / "page.html").read_text(encoding="utf-8")


def test_a_dry_run_draws_nothing(bank: FrameBank, tmp_path: Path, say: Say) -> None:
    """It says what would become of the controls."""
    code, said = say(*asked(bank.root, tmp_path / "run", "--dry-run"))
    assert code == 0
    assert "will be drawn anew" in said
    assert list(tmp_path.iterdir()) == []


def test_an_older_bank_without_controls_gets_them(bank: FrameBank, tmp_path: Path, say: Say) -> None:
    """All that it needs is to be drawn today as it was."""
    old = tmp_path / "old"
    shutil.copytree(bank.root, old)
    manifest = json.loads((old / "manifest.json").read_text())
    rows = [json.loads(line) for line in (old / "metadata.jsonl").read_text().splitlines()]
    for row in rows:
        for name in CONTROLS:
            manifest["images"].pop(row.pop(f"{name}_file_name", None), None)
    del manifest["controls"]
    (old / "manifest.json").write_text(json.dumps(manifest))
    (old / "metadata.jsonl").write_text("".join(f"{json.dumps(row)}\n" for row in rows))
    assert open_bank(old).frames[0].counterfactuals.keys().isdisjoint(CONTROLS)
    code, said = say(*asked(old, tmp_path / "run"))
    assert code == 0, said


@pytest.mark.slow
def test_a_bank_that_cannot_be_drawn_again_is_refused_and_nothing_stays(
    bank: FrameBank, tmp_path: Path, say: Say
) -> None:
    """One that no simulator made, and one whose pictures are others today; a shard; a run begun without."""
    boxes = banks.build_bank(tmp_path / "boxes").root
    code, said = say(*asked(boxes, tmp_path / "run"))
    assert code == 2
    assert "was not built by 'eyechart frames build' from a known simulator" in said
    other = tmp_path / "other"
    shutil.copytree(bank.root, other)
    text = (other / "manifest.json").read_text()
    first = bank.manifest.images[bank.frames[0].file]
    (other / "manifest.json").write_text(text.replace(first, "0" * 64))
    code, said = say(*asked(other, tmp_path / "run"))
    assert code == 2
    assert "draw other pictures than the bank has" in said
    assert not (tmp_path / "run" / "bank").exists()
    code, said = say(*asked(bank.root, tmp_path / "run", "--shard", "1/2"))
    assert code == 2
    assert "frames build SIMULATOR --controls-seed N" in said
    plain = [word for word in asked(bank.root, tmp_path / "plain") if word != "--fresh-controls"]
    assert say(*plain)[0] == 0
    code, said = say(*asked(bank.root, tmp_path / "plain"))
    assert code == 2
    assert "started without --fresh-controls" in said
