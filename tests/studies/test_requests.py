"""A ledger that was not made by what its run asks is no verdict: each call is held to the run by its digest."""

import io
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

import banks
from eyechart.api import build_bank
from eyechart.cli.app import app
from eyechart.errors import LedgerError
from eyechart.frames import ENCODINGS, MAIN, BankWriter, FrameBank, PictureEncoding, nouns, open_bank
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER
from eyechart.simulators import open_bank_simulator
from eyechart.studies import battery, policy, structured

MODEL = "scripted:depth"
ASKED_ELSE = "asked something else than this run"


def jpegs(out: Path) -> FrameBank:
    """Write a bank of JPEG, which leave as PNG."""
    rng = np.random.default_rng(3)
    with BankWriter(out, banks.manifest()) as writer:
        for frame in banks.frames_of(("light",), 4, 3, "vertical", drawn=False):
            file, kept = f"images/{frame.id}.jpg", io.BytesIO()
            Image.fromarray(rng.integers(0, 255, (16, 60, 3), dtype=np.uint8)).save(kept, "JPEG")
            writer.add(replace(frame, pictures={MAIN: file}), {MAIN: kept.getvalue()}, {})
    return open_bank(out)


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a small bank."""
    return banks.build_bank(tmp_path_factory.mktemp("bank") / "bank", controls=True)


def asked(bank: FrameBank, out: Path, *, seed: int = 0, **how: object) -> Path:
    """Return a battery on a bank."""
    battery.run(battery.plan(bank.root, [MODEL], out, seed=seed, **how))  # type: ignore[arg-type]
    return out


def exchanged(run: Path, other: Path) -> Path:
    """Put another run's ledger into a run."""
    for file in run.glob(f"{LEDGER}*"):
        file.unlink()
    for file in other.glob(f"{LEDGER}*"):
        shutil.copy(file, run / file.name)
    return run


def change(run: Path, chosen: Callable[[str], bool], digest: str = "0" * 64) -> None:
    """Have the calls under some conditions say that they asked something else, in rows with their checksums."""
    with Ledger(run / LEDGER) as ledger:
        sent = [attempt for spec in ledger.models() for attempt in ledger.attempts(spec)]
    for file in run.glob(f"{LEDGER}*"):
        file.unlink()
    with Ledger(run / LEDGER, create=True) as ledger:
        for one in sent:
            assert one.reply is not None
            asked = digest if chosen(one.key.condition) else one.request_sha256
            ledger.close(ledger.begin(one.key, asked), one.reply)


def said(command: str, run: Path) -> str:
    """Return what a command says that cannot read a run."""
    done = CliRunner().invoke(app, [*command.split(), str(run)])
    assert isinstance(done.exception, LedgerError), (command, done.output)
    return str(done.exception)


@pytest.mark.parametrize("command", ["verdict", "score", "gate", "verdict --json", "score --json"])
def test_the_ledger_of_another_seed_is_no_verdict(bank: FrameBank, tmp_path: Path, command: str) -> None:
    """Under the same names: the pictures of other partners were shown."""
    run = exchanged(asked(bank, tmp_path / "run"), asked(bank, tmp_path / "other", seed=1))
    words = said(command, run)
    assert ASKED_ELSE in words
    assert f"the call of {MODEL} about frame" in words
    assert "run anew with another --out" in words


def test_the_ledger_of_another_bank_is_no_verdict(bank: FrameBank, tmp_path: Path) -> None:
    """Also where its frames have the same names and the same geometry."""
    other = shutil.copytree(bank.root, tmp_path / "painted")
    with BankWriter(tmp_path / "made", banks.manifest()) as writer:
        for code, frame in enumerate(bank):
            writer.add(frame, *banks.pictures_of(frame, code + 500))
    shutil.rmtree(other)
    run = exchanged(asked(bank, tmp_path / "run"), asked(open_bank(tmp_path / "made"), tmp_path / "other"))
    assert ASKED_ELSE in said("verdict", run)


@pytest.mark.parametrize("condition", ["text_only", "real", "shuffled", "lead_near", "blank", "mirrored", "noise"])
def test_a_row_that_asked_something_else_is_no_verdict(bank: FrameBank, tmp_path: Path, condition: str) -> None:
    """Whatever it shows: words alone, a picture of the bank, or one that was encoded for the call."""
    run, seen = asked(bank, tmp_path / "run"), iter([True])
    change(run, lambda name: name == condition and next(seen, False))
    words = said("verdict", run)
    assert f"under {condition}" in words
    assert ASKED_ELSE in words


@pytest.mark.parametrize("digest", ["-" + "1" * 63, "0x" + "1" * 62, "+1_1" + " " * 60, "no digest"])
def test_a_digest_that_is_none_is_held_to_the_run_too(bank: FrameBank, tmp_path: Path, digest: str) -> None:
    """A row is passed over only where it has no digest at all, as the rows of the first ledgers."""
    run, seen = asked(bank, tmp_path / "run"), iter([True])
    change(run, lambda name: name == "real" and next(seen, False), digest)
    assert ASKED_ELSE in said("verdict", run)


def test_a_run_does_not_go_on_with_a_ledger_that_asked_something_else(bank: FrameBank, tmp_path: Path) -> None:
    """Before anything is asked."""
    run = asked(bank, tmp_path / "run", extent=battery.BatterySelection(limit=8))
    exchanged(run, asked(bank, tmp_path / "other", seed=1, extent=battery.BatterySelection(limit=8)))
    with pytest.raises(LedgerError, match=ASKED_ELSE):
        battery.run(battery.plan(bank.root, [MODEL], run))


def test_estimates_of_scenes_are_held_too(tmp_path: Path) -> None:
    """Words, and pictures through their view."""
    bank, model = build_bank(tmp_path / "bank", seeds=(0,)), ["scripted:scene_positive_control"]
    run = tmp_path / "run"
    battery.run(structured.plan("admission", bank.root, model, run, view="calibrated"))
    structured.score(run)
    seen = iter([True])
    change(run, lambda name: name == "mirrored" and next(seen, False))
    with pytest.raises(LedgerError, match="under mirrored asked something else"):
        structured.score(run)


def test_calls_of_policies_are_held_too(tmp_path: Path) -> None:
    """Their states and instructions with the pictures."""
    bank = open_bank_simulator("tabletop").build(tmp_path / "bank", steps=4)
    run, few = tmp_path / "run", ("real", "real_repeat", "swapped@cameras", "swapped@instruction", "blank")
    policy.run(policy.plan(bank.root, ["python:arms:reach"], run, conditions=few))
    policy.score(run)
    seen = iter([True])
    change(run, lambda name: name.startswith("swapped@instruction") and next(seen, False))
    with pytest.raises(LedgerError, match="under swapped@instruction asked something else"):
        policy.score(run)


def test_pictures_that_leave_as_other_files_are_held_by_a_few(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The ledger of another seed is found, and no more than a few pictures a condition are encoded for that."""
    bank, made = jpegs(tmp_path / "bank"), list[str]()
    run = exchanged(asked(bank, tmp_path / "run"), asked(bank, tmp_path / "other", seed=1))
    png = nouns.as_png
    monkeypatch.setattr(nouns, "as_png", lambda picture, name, write: (made.append(name), png(picture, name, write))[1])
    with pytest.raises(LedgerError, match=ASKED_ELSE):
        battery.score(run)
    assert 0 < len(made) <= 8 * 8


def test_another_encoder_is_no_fault(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where none of the pictures that are encoded comes out as in the run, nobody can say what was asked."""
    run = asked(jpegs(tmp_path / "bank"), tmp_path / "run")

    def otherwise(rgb: np.ndarray) -> bytes:
        kept = io.BytesIO()
        Image.fromarray(rgb).save(kept, "PNG", compress_level=9)
        return kept.getvalue()

    others = dict.fromkeys(ENCODINGS, PictureEncoding(otherwise, otherwise))
    monkeypatch.setattr("eyechart.studies.battery.plans.ENCODINGS", others)
    assert battery.score(run).models[MODEL].answered
    change(run, lambda name: name == "text_only")
    with pytest.raises(LedgerError, match="under text_only"):
        battery.score(run)


def test_pictures_that_are_gone_or_were_changed_since_say_nothing_of_a_run(bank: FrameBank, tmp_path: Path) -> None:
    """A run is read without its bank, and a row without a digest as ever; words are held still."""
    own = open_bank(shutil.copytree(bank.root, tmp_path / "bank"))
    run = asked(own, tmp_path / "run")
    before = battery.score(run).as_dict()
    for frame in own:
        (own.root / frame.file).write_bytes(banks.encode(banks.draw(3.0, 999)))
    assert battery.score(run).as_dict() == before
    shutil.rmtree(own.root)
    assert battery.score(run).as_dict() == before
    change(run, lambda name: name in {"real", "text_only"}, digest="")
    battery.score(run)
    change(run, lambda name: name == "text_only")
    with pytest.raises(LedgerError, match="under text_only"):
        battery.score(run)


def test_the_ledger_of_another_prompt_is_no_verdict(bank: FrameBank, tmp_path: Path) -> None:
    """About the same frames, in other words."""
    run = exchanged(asked(bank, tmp_path / "run"), asked(bank, tmp_path / "other", prompt="minimal"))
    assert "under text_only asked something else" in said("verdict", run)
