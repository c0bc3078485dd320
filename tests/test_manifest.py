import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

import banks
from eyechart.errors import BankError, LedgerError
from eyechart.frames import FrameBank
from eyechart.manifest import RunManifest, is_free, is_run, read_run, today, versions, write_run
from eyechart.modes import ModeMeasurements, RequestMode
from eyechart.prompts import PROMPTS


@pytest.fixture
def bank(tmp_path: Path) -> FrameBank:
    """Return a bank of six frames."""
    return banks.build_bank(tmp_path / "source", scenarios=["light"])


@pytest.fixture
def manifest(bank: FrameBank) -> RunManifest:
    """Return the manifest of a run on the bank."""
    return RunManifest(
        study="battery",
        created=today(),
        seed=3,
        prompt=PROMPTS["baseline"],
        models={"a": "1"},
        conditions=("real", "blank"),
        limit=4,
        shard=(1, 2),
        bank_path=str(bank.root),
        fingerprint=bank.manifest.fingerprint,
        versions=versions(),
    )


@pytest.fixture
def out(tmp_path: Path, manifest: RunManifest, bank: FrameBank) -> Path:
    """Return the folder of a run."""
    (tmp_path / "run").mkdir()
    write_run(tmp_path / "run", manifest, bank)
    return tmp_path / "run"


def test_a_run_reads_back_as_it_was_written(out: Path, manifest: RunManifest, bank: FrameBank) -> None:
    """Also without the bank's pictures, which stay where they are."""
    shutil.rmtree(bank.root)
    read, frames = read_run(out)
    assert read == manifest
    assert frames.frames == bank.frames
    assert sorted(path.name for path in out.iterdir()) == ["bank", "run.json"]
    assert sorted(path.name for path in (out / "bank").iterdir()) == ["manifest.json", "metadata.jsonl"]


def test_a_run_keeps_each_models_mode_and_facts(manifest: RunManifest, bank: FrameBank, tmp_path: Path) -> None:
    """As they were; a later probe of the same mode adds what it measured."""
    asked = replace(manifest, modes={"a": RequestMode("a", max_tokens=9)}, facts={"a": {"digest": "abc"}})
    (tmp_path / "run").mkdir()
    write_run(tmp_path / "run", asked, bank)
    assert read_run(tmp_path / "run")[0] == asked
    probed = replace(asked, modes={"a": RequestMode("a", max_tokens=9, measured=ModeMeasurements(calls=4))})
    assert asked.extended(probed).mode("a") == probed.mode("a")
    assert probed.extended(asked).mode("a") == probed.mode("a")


def test_a_run_that_recorded_a_secret_is_read_and_does_not_go_on(
    out: Path, manifest: RunManifest, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its calls are paid for; what else it asked nobody may know, so that nothing is added to it."""
    monkeypatch.setenv("SOME_API_KEY", "very-secret-1234")
    raw = json.loads((out / "run.json").read_text())
    raw["modes"] = {"a": {"spec": "a", "body": {"note": "very-secret-1234"}}}
    (out / "run.json").write_text(json.dumps(raw))
    read, _ = read_run(out)
    assert read.mode("a").about == {"left_out": "a secret of body"}
    with pytest.raises(LedgerError, match="this run asked a in another mode"):
        read.extended(manifest)


def test_a_run_is_not_resumed_in_another_mode(manifest: RunManifest) -> None:
    """The default mode included; the field that differs is named."""
    asked = replace(manifest, modes={"a": RequestMode("a", temperature=None)})
    with pytest.raises(LedgerError, match=r"asked a in another mode: temperature was None, now 0\.0"):
        asked.extended(replace(manifest, modes={"a": RequestMode("a")}))
    with pytest.raises(LedgerError, match=r"temperature was 0\.0, now None"):
        manifest.extended(asked)


def test_more_models_conditions_and_frames_may_be_added(manifest: RunManifest) -> None:
    """In the order in which they came; what was there stays."""
    more = manifest.extended(replace(manifest, models={"b": "2", "a": "1"}, conditions=("noise", "real"), limit=6))
    assert (dict(more.models), more.conditions, more.limit) == ({"a": "1", "b": "2"}, ("real", "blank", "noise"), 6)
    assert manifest.extended(replace(manifest, limit=2)).limit == 4
    assert manifest.extended(replace(manifest, limit=None)).limit is None
    assert manifest.extended(manifest) == manifest


@pytest.mark.parametrize(
    ("name", "other", "named"),
    [
        ("study", "guardian", "study battery, now study guardian"),
        ("seed", 4, "seed 3, now seed 4"),
        ("prompt", PROMPTS["minimal"], f"{PROMPTS['baseline'].key}, now prompt {PROMPTS['minimal'].key}"),
        ("fingerprint", "f00", r"now the bank .* \(fingerprint f00\)"),
        ("shard", None, r"shard \(1, 2\), now shard None"),
        ("models", {"a": "2"}, "a at version 1, which is now 2"),
    ],
)
def test_another_run_is_not_added(manifest: RunManifest, name: str, other: object, named: str) -> None:
    """The message says what differs, and both values."""
    with pytest.raises(LedgerError, match=named):
        manifest.extended(replace(manifest, **{name: other}))  # type: ignore[arg-type]


DAMAGED: dict[str, object] = {
    "a list": [],
    "nothing": {},
    "another format": {"format": "eyechart-run/9"},
    "no seed": {"seed": None},
    "a wordy seed": {"seed": "three"},
    "half a shard": {"shard": [1]},
    "an empty shard": {"shard": []},
    "an unknown condition": {"conditions": ["real", "snow"]},
    "one word of conditions": {"conditions": "real"},
    "a list of models": {"models": ["a"]},
    "a prompt of another shape": {"prompt": {"name": "x"}},
    "a field from the future": {"future": 1},
    "a limit in words": {"limit": "few"},
}


@pytest.mark.parametrize("what", DAMAGED)
def test_a_damaged_run_manifest_is_refused_by_name(out: Path, what: str) -> None:
    """One line that names the file."""
    values, changed = json.loads((out / "run.json").read_text(encoding="utf-8")), DAMAGED[what]
    whole = values | changed if isinstance(changed, dict) and changed else changed
    (out / "run.json").write_text(json.dumps(whole), encoding="utf-8")
    with pytest.raises(LedgerError, match=r"run\.json is"):
        read_run(out)


@pytest.mark.parametrize("text", [b"", b"{", b"\xff", b"[" * 99_999])
def test_a_run_manifest_that_is_no_json_is_refused_by_name(out: Path, text: bytes) -> None:
    """Whatever stands in it."""
    (out / "run.json").write_bytes(text)
    with pytest.raises(LedgerError, match=r"run\.json is no run manifest"):
        read_run(out)


def test_a_run_with_another_bank_is_refused(out: Path, tmp_path: Path) -> None:
    """The copy must be the bank whose fingerprint the run has; a changed gap in it is found too."""
    other = banks.build_bank(tmp_path / "other", scenarios=["dense"])
    kept = (out / "bank" / "metadata.jsonl").read_text(encoding="utf-8")
    (out / "bank" / "metadata.jsonl").write_text(kept.replace("25.0", "5.0"), encoding="utf-8")
    with pytest.raises(BankError, match=r"metadata\.jsonl: the ground truth of frame"):
        read_run(out)
    for name in ("manifest.json", "metadata.jsonl"):
        shutil.copyfile(other.root / name, out / "bank" / name)
    with pytest.raises(LedgerError, match="is not the bank of this run"):
        read_run(out)


def test_a_folder_without_a_run_says_how_to_make_one(tmp_path: Path) -> None:
    """And is none."""
    with pytest.raises(LedgerError, match=r"run\.json does not exist.*eyechart run battery"):
        read_run(tmp_path)
    assert not is_run(tmp_path)


def test_a_run_may_begin_where_nothing_is_or_where_one_was_cut(
    tmp_path: Path, manifest: RunManifest, bank: FrameBank
) -> None:
    """Whatever moment a kill chose before the manifest was there, the next run begins in the same folder."""
    out = tmp_path / "run"
    assert is_free(out)
    out.mkdir()
    (out / ".lock").touch()
    (out / ".bank").mkdir()
    (out / ".run.json").write_text("{", encoding="utf-8")
    assert is_free(out)
    (out / "bank").mkdir()
    (out / "bank" / "metadata.jsonl").touch()
    assert is_free(out)
    write_run(out, manifest, bank)
    assert read_run(out)[0] == manifest


@pytest.mark.parametrize("theirs", ["notes.txt", "ledger.sqlite", "bank/images/f.png", "bank/sub/manifest.json"])
def test_a_run_does_not_begin_among_other_things(
    tmp_path: Path, manifest: RunManifest, bank: FrameBank, theirs: str
) -> None:
    """Above all not in the folder that holds the frame bank as ``bank``, which it would have to remove."""
    path = tmp_path / "out" / theirs
    path.parent.mkdir(parents=True)
    path.touch()
    assert not is_free(tmp_path / "out")
    assert not is_free(path)
    with pytest.raises(LedgerError, match="exists and is no run"):
        write_run(tmp_path / "out", manifest, bank)
    assert path.is_file()


def test_extending_a_run_keeps_its_bank(out: Path, manifest: RunManifest, bank: FrameBank) -> None:
    """Only the manifest is written anew."""
    stamp = (out / "bank" / "metadata.jsonl").stat().st_mtime_ns
    write_run(out, replace(manifest, models={"a": "1", "b": "1"}), bank)
    assert set(read_run(out)[0].models) == {"a", "b"}
    assert (out / "bank" / "metadata.jsonl").stat().st_mtime_ns == stamp


def test_versions_name_what_may_matter() -> None:
    """Of this program, of Python, and of what draws and computes."""
    assert {"eyechart", "python", "numpy", "pillow", "highway-env"} <= set(versions())
