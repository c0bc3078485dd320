import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from filelock import FileLock

import banks
import stand_ins
from eyechart.calls import CallKey, Reply
from eyechart.conditions import BATTERY, CONDITIONS, OF_BANKS, is_available
from eyechart.errors import BankError, EyechartError, LedgerError, SpecError
from eyechart.frames import FrameBank, decode, encode
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER, read_run, write_run
from eyechart.models import ADAPTERS
from eyechart.studies import battery as study
from eyechart.studies.battery import plans

NOISY, STEADY = stand_ins.SPECS
WITHOUT_TEXT = tuple(name for name in OF_BANKS if not CONDITIONS[name].needs & {"text", "control"})
"""The built-in prompts say nothing of a frame."""


@pytest.fixture(autouse=True)
def _installed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make ``standin:NAME`` a SPEC for one test."""
    monkeypatch.setitem(ADAPTERS, "standin", "stand_ins")


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of twelve frames that no test changes."""
    return banks.build_bank(tmp_path_factory.mktemp("planning") / "bank", scenarios=["light", "dense"])


def replies(out: Path) -> dict[CallKey, Reply]:
    """Return every finished call of a run with its reply, less its seconds."""
    with Ledger(out / LEDGER) as ledger:
        found = [pair for model in read_run(out)[0].models for pair in ledger.replies(model)]
        assert {key for key, _ in found} == ledger.finished()
    return {key: replace(reply, seconds=None) for key, reply in found}


def plan_and_run(bank: FrameBank, out: Path, *specs: str, **options: object) -> study.Battery:
    """Plan a battery and run it."""
    planned = study.plan(bank.root, specs or (NOISY,), out, **options)  # type: ignore[arg-type]
    study.run(planned)
    return planned


def test_planning_writes_and_asks_nothing(bank: FrameBank, tmp_path: Path) -> None:
    """The number of calls is known before any is paid for."""
    planned = study.plan(bank.root, [NOISY, STEADY], tmp_path / "run")
    able = sum(is_available(name, frame) for name in WITHOUT_TEXT for frame in bank)
    assert able >= 12 * 8 + 3 * sum(bool(frame.counterfactuals) for frame in bank)
    assert planned.counts() == (2 * able, 0, 0)
    assert planned.plan.conditions == WITHOUT_TEXT
    assert list(tmp_path.iterdir()) == []


def test_a_bank_without_counterfactuals_gets_the_eight_conditions(tmp_path: Path) -> None:
    """What was not drawn is not planned."""
    plain = banks.build_bank(tmp_path / "bank", drawn=False)
    undrawn = tuple(name for name in WITHOUT_TEXT if "counterfactual" not in CONDITIONS[name].needs)
    assert study.plan(plain.root, [STEADY], tmp_path / "run").plan.conditions == undrawn
    assert undrawn[:8] == BATTERY


def test_controls_are_asked_by_name_alone(bank: FrameBank, tmp_path: Path) -> None:
    """Every bank has nudged; a control that has to be drawn is refused where no frame has its picture."""
    named = study.plan(bank.root, [STEADY], tmp_path / "run", conditions=["real", "nudged"])
    assert named.counts() == (2 * len(bank), 0, 0)
    with pytest.raises(BankError, match="condition 'lane_own' cannot be shown: no frame has its picture"):
        study.plan(bank.root, [STEADY], tmp_path / "run", conditions=["real", "lane_own"])


def test_a_run_is_whole_and_counts_as_finished(bank: FrameBank, tmp_path: Path) -> None:
    """Every planned call has a reply; the same command again makes none."""
    planned = plan_and_run(bank, tmp_path / "run", NOISY, STEADY)
    calls = len(planned.plan.keys())
    assert planned.counts() == (calls, calls, 0)
    assert set(replies(tmp_path / "run")) == set(planned.plan.keys())
    again = plan_and_run(bank, tmp_path / "run", NOISY, STEADY)
    assert all(model.queries == [] for model in again.models.values() if isinstance(model, stand_ins.StandIn))
    assert again.counts() == (calls, calls, 0)


def test_models_conditions_and_frames_may_be_added_to_a_run(bank: FrameBank, tmp_path: Path) -> None:
    """Each command asks only for its own; together they are the run of all at once."""
    out = tmp_path / "run"
    plan_and_run(bank, out, STEADY, conditions=["real", "blank"], extent=study.BatterySelection(4))
    plan_and_run(bank, out, NOISY, conditions=["mirrored"], extent=study.BatterySelection(2))
    grown = plan_and_run(bank, out, NOISY, STEADY)
    manifest = read_run(out)[0]
    assert (set(manifest.models), set(manifest.conditions), manifest.limit) == (
        {NOISY, STEADY},
        set(WITHOUT_TEXT),
        None,
    )
    whole = plan_and_run(bank, tmp_path / "whole", NOISY, STEADY)
    assert replies(out) == replies(tmp_path / "whole")
    assert grown.counts() == whole.counts()


def test_naming_a_model_or_a_condition_twice_asks_once(bank: FrameBank, tmp_path: Path) -> None:
    """A double name is no double call."""
    planned = plan_and_run(bank, tmp_path / "run", STEADY, STEADY, conditions=["real", "real"])
    assert planned.counts() == (12, 12, 0)


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"seed": 1}, "seed 0, now seed 1"),
        ({"prompt": "minimal"}, "prompt baseline@.*, now prompt minimal@"),
        ({"extent": study.BatterySelection(shard=(1, 2))}, r"shard None, now shard \(1, 2\)"),
    ],
)
def test_resuming_with_other_options_is_refused(
    bank: FrameBank, tmp_path: Path, options: dict[str, object], named: str
) -> None:
    """The message names what differs, and nothing is written."""
    plan_and_run(bank, tmp_path / "run", STEADY, conditions=["real"])
    before = (tmp_path / "run" / "run.json").read_bytes()
    with pytest.raises(LedgerError, match=named):
        study.plan(bank.root, [STEADY], tmp_path / "run", **options)  # type: ignore[arg-type]
    assert (tmp_path / "run" / "run.json").read_bytes() == before


def test_resuming_on_another_bank_is_refused(bank: FrameBank, tmp_path: Path) -> None:
    """By its geometry, and by its pictures where the geometry is the same."""
    plan_and_run(bank, tmp_path / "run", STEADY, conditions=["real"])
    other = banks.build_bank(tmp_path / "other")
    with pytest.raises(LedgerError, match=r"this run has the bank .*bank \(fingerprint [0-9a-f]{16}\), now the bank"):
        study.plan(other.root, [STEADY], tmp_path / "run")
    repainted = tmp_path / "repainted"
    shutil.copytree(bank.root, repainted)
    repaint(repainted)
    with pytest.raises(LedgerError, match="other pictures of the same geometry"):
        study.plan(repainted, [STEADY], tmp_path / "run")


def repaint(root: Path) -> None:
    """Change a pixel of a bank's first picture, and its digest with it."""
    import hashlib  # noqa: PLC0415 - nowhere else needed

    file = root / "images" / "light-0-0.png"
    old = file.read_bytes()
    pixels = np.array(decode(old, "old"))
    pixels[0, 0] = 7
    file.write_bytes(encode(pixels))
    text = (root / "manifest.json").read_text(encoding="utf-8")
    digests = [hashlib.sha256(one).hexdigest() for one in (old, file.read_bytes())]
    (root / "manifest.json").write_text(text.replace(*digests), encoding="utf-8")


def test_a_model_that_answers_as_another_version_is_refused(
    bank: FrameBank, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two versions in one ledger could not be told apart."""
    plan_and_run(bank, tmp_path / "run", STEADY, conditions=["real"])
    monkeypatch.setattr(stand_ins, "open_model", lambda *_: stand_ins.StandIn(version="2"))
    with pytest.raises(LedgerError, match=f"{STEADY} at version 1, which is now 2"):
        study.plan(bank.root, [STEADY], tmp_path / "run")


def test_a_damaged_bank_is_refused_before_any_call(bank: FrameBank, tmp_path: Path) -> None:
    """The picture at fault is named."""
    shutil.copytree(bank.root, tmp_path / "bank")
    (tmp_path / "bank" / "images" / "light-0-1.png").write_bytes(b"x")
    with pytest.raises(BankError, match=r"is damaged: 'images/light-0-1\.png'"):
        study.plan(tmp_path / "bank", [STEADY], tmp_path / "run")


@pytest.mark.parametrize(
    ("specs", "options", "named"),
    [
        ((), {}, "at least one --model"),
        (("standin",), {}, "unknown model 'standin'"),
        (("nobody:x",), {}, "scripted:NAME"),
        ((STEADY,), {"prompt": "poem"}, "known are baseline"),
        ((STEADY,), {"conditions": ["snow"]}, "known are real"),
        ((STEADY,), {"extent": study.BatterySelection(0)}, "--limit needs at least 1"),
    ],
)
def test_unknown_names_are_refused_while_planning(
    bank: FrameBank, tmp_path: Path, specs: tuple[str, ...], options: dict[str, object], named: str
) -> None:
    """With what is known, and before anything is written."""
    with pytest.raises(SpecError, match=named):
        study.plan(bank.root, specs, tmp_path / "run", **options)  # type: ignore[arg-type]
    assert list(tmp_path.iterdir()) == []


def test_a_condition_that_a_bank_is_too_small_for_is_refused_by_name_and_else_left_out(tmp_path: Path) -> None:
    """Before the first call, and the plan says what was left out and why."""
    small = banks.build_bank(tmp_path / "bank", scenarios=["light"], episodes=1, steps=1, drawn=False)
    why = "has no partner for shuffled: the bank needs another frame in scenario 'light'"
    with pytest.raises(BankError, match=why):
        study.plan(small.root, [STEADY], tmp_path / "run", conditions=["real", "shuffled"])
    planned = study.plan(small.root, [STEADY], tmp_path / "run")
    assert planned.plan.conditions == ("real", "real_repeat", "blank", "noise", "text_only", "mirrored")
    assert list(planned.left_out) == ["shuffled", "cross_scenario"]
    assert why in planned.left_out["shuffled"]
    assert plan_and_run(small, tmp_path / "run", STEADY, conditions=["real", "noise"]).counts() == (2, 2, 0)


def test_a_run_is_not_put_among_other_things(bank: FrameBank, tmp_path: Path) -> None:
    """Nor into the folder that holds the bank, which would be lost, nor over a ledger without its manifest."""
    home = tmp_path / "home"
    shutil.copytree(bank.root, home / "bank")
    orphan = tmp_path / "orphan"
    plan_and_run(bank, orphan, STEADY, conditions=["real"])
    (orphan / "run.json").unlink()
    for out in (home, home / "bank", orphan, home / "bank" / "manifest.json"):
        with pytest.raises(LedgerError, match="exists and is no run"):
            study.plan(home / "bank", [STEADY], out)
    assert (home / "bank" / "images" / "light-0-0.png").is_file()


def test_a_second_process_on_one_run_is_refused(bank: FrameBank, tmp_path: Path) -> None:
    """While the first one writes; afterwards it may go on."""
    out = tmp_path / "run"
    planned = study.plan(bank.root, [STEADY], out)
    out.mkdir()
    program = "import sys, filelock; lock = filelock.FileLock(sys.argv[1]); lock.acquire(); print(flush=True); input()"
    words = [sys.executable, "-c", program, str(out / ".lock")]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as first:
        assert first.stdout is not None
        first.stdout.readline()
        with pytest.raises(LedgerError, match="another process is writing"):
            study.run(planned)
        assert not (out / LEDGER).exists()
        first.communicate(b"\n")
    study.run(planned)
    assert planned.counts()[0] == planned.counts()[1]


def test_a_run_that_another_process_began_meanwhile_is_extended_or_refused(bank: FrameBank, tmp_path: Path) -> None:
    """What was planned before the other one wrote does not overwrite it."""
    out = tmp_path / "run"
    mine = study.plan(bank.root, [STEADY], out, conditions=["real"])
    foreign = study.plan(bank.root, [STEADY], out, seed=9)
    plan_and_run(bank, out, NOISY, conditions=["real"])
    study.run(mine)
    assert set(read_run(out)[0].models) == {NOISY, STEADY}
    with pytest.raises(LedgerError, match="seed 0, now seed 9"):
        study.run(foreign)


def test_a_ledger_that_cannot_be_written_is_one_line(
    bank: FrameBank, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A full disk is no fault of the program."""
    planned = study.plan(bank.root, [STEADY], tmp_path / "run")

    def full(*_: object, **__: object) -> None:
        import sqlite3  # noqa: PLC0415 - nowhere else needed

        raise sqlite3.OperationalError("database or disk is full")

    monkeypatch.setattr(plans, "execute", full)
    with pytest.raises(LedgerError, match=r"ledger\.sqlite cannot be written: the disk is full; the same"):
        study.run(planned)
    assert not FileLock(tmp_path / "run" / ".lock").is_locked


@pytest.mark.parametrize("order", [[1], [2, 1], [3, 1, 4, 2]])
def test_merged_shards_are_the_run_of_all(bank: FrameBank, tmp_path: Path, order: list[int]) -> None:
    """In any order of the shards: the same calls, the same replies, the same manifest."""
    count = len(order)
    options = {"conditions": ["real", "noise", "lead_near"], "extent": study.BatterySelection(7)}
    for index in range(1, count + 1):
        part = {**options, "extent": study.BatterySelection(7, (index, count))}
        plan_and_run(bank, tmp_path / str(index), NOISY, STEADY, **part)
    calls = study.merge([tmp_path / str(index) for index in order], tmp_path / "merged")
    plan_and_run(bank, tmp_path / "whole", NOISY, STEADY, **options)
    assert replies(tmp_path / "merged") == replies(tmp_path / "whole")
    assert calls == len(replies(tmp_path / "whole"))
    assert read_run(tmp_path / "merged")[0] == read_run(tmp_path / "whole")[0]
    assert plan_and_run(bank, tmp_path / "merged", NOISY, STEADY, **options).counts() == (calls, calls, 0)


def test_unfinished_shards_merge_and_the_whole_resumes(bank: FrameBank, tmp_path: Path) -> None:
    """Also where a shard is missing: what it would have asked is asked then."""
    plan_and_run(bank, tmp_path / "1", STEADY, extent=study.BatterySelection(shard=(1, 3)))
    second = study.plan(bank.root, [STEADY], tmp_path / "2", extent=study.BatterySelection(shard=(2, 3)))
    study.run(replace(second, plan=replace(second.plan, frames=second.plan.frames[:3])))
    with Ledger(tmp_path / "2" / LEDGER, create=True) as ledger:
        ledger.begin(next(key for key in second.plan.keys_of(STEADY) if key not in ledger.finished()), "")
    study.merge([tmp_path / "1", tmp_path / "2"], tmp_path / "merged")
    planned = study.plan(bank.root, [STEADY], tmp_path / "merged")
    calls, finished, unknown = planned.counts()
    assert 0 < finished < calls
    assert unknown == 1
    study.run(planned)
    assert planned.counts() == (calls, calls, 0)


def test_what_are_no_parts_of_one_run_does_not_merge(bank: FrameBank, tmp_path: Path) -> None:
    """Doubles, other seeds, other pictures, no shard, no run and a taken place: refused, and nothing stays."""
    plan_and_run(bank, tmp_path / "one", STEADY, extent=study.BatterySelection(shard=(1, 2)))
    plan_and_run(bank, tmp_path / "other", STEADY, extent=study.BatterySelection(shard=(2, 2)), seed=1)
    shutil.copytree(bank.root, tmp_path / "repainted")
    repaint(tmp_path / "repainted")
    study.run(
        study.plan(tmp_path / "repainted", [STEADY], tmp_path / "painted", extent=study.BatterySelection(shard=(2, 2)))
    )
    before = sorted(path.name for path in tmp_path.iterdir())
    for shards, named in (
        (["one", "one"], "finished in both ledgers"),
        (["one", "other"], "other is no part of the run in .*one: this run has seed 0, now seed 1"),
        (["one", "painted"], "painted is no part of the run in .*one: it was run on other pictures"),
        ([], "one or more shards"),
        (["one", "repainted"], r"run\.json does not exist"),
    ):
        with pytest.raises(EyechartError, match=named):
            study.merge([tmp_path / name for name in shards], tmp_path / "merged")
    with pytest.raises(LedgerError, match="exists and is not empty"):
        study.merge([tmp_path / "one"], tmp_path / "other")
    assert sorted(path.name for path in tmp_path.iterdir()) == before


def test_a_run_that_was_cut_before_its_first_call_begins_again(bank: FrameBank, tmp_path: Path) -> None:
    """With a manifest and no ledger."""
    planned = study.plan(bank.root, [STEADY], tmp_path / "run")
    (tmp_path / "run").mkdir()
    write_run(tmp_path / "run", planned.manifest, bank)
    assert study.plan(bank.root, [STEADY], tmp_path / "run").counts()[1:] == (0, 0)
    study.run(study.plan(bank.root, [STEADY], tmp_path / "run"))
    assert set(replies(tmp_path / "run")) == set(planned.plan.keys())


def test_a_run_depends_on_no_hash_seed(bank: FrameBank, tmp_path: Path) -> None:
    """Another process with another PYTHONHASHSEED gets the same replies."""
    env = os.environ | {"PYTHONPATH": str(Path(stand_ins.__file__).parent), "PYTHONHASHSEED": "77"}
    words = [sys.executable, "-m", "stand_ins", str(bank.root), str(tmp_path / "theirs"), "0"]
    subprocess.run(words, env=env, check=True)
    plan_and_run(bank, tmp_path / "mine", *stand_ins.SPECS, seed=7)
    assert replies(tmp_path / "mine") == replies(tmp_path / "theirs")
