"""Another trade in one file of actions and one bank: a forklift, which has no lanes, from its bank to its bundle."""

import json
import sys
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from eyechart import cli
from eyechart.frames import IMPORTED, BankManifest, BankWriter, Camera, Frame, Gap, encode
from eyechart.spaces.discrete import read_space

SPACE = """
actions = ["HALT", "CREEP", "ROLL", "LIFT", "SWING PORT", "SWING STARBOARD"]
mirror_pairs = [["SWING PORT", "SWING STARBOARD"]]
brake = ["HALT", "CREEP"]
proceed = ["ROLL", "SWING PORT", "SWING STARBOARD"]
"""
FORKLIFT = '''
"""Halts before a pallet, creeps towards one, and swings to the side that the mast's camera shows open."""
import io

import numpy as np
from PIL import Image


def seen(image):
    return np.asarray(Image.open(io.BytesIO(image)).convert("RGB")).astype(int)


def decide(prompt, images, state):
    if not images:
        return "LIFT"
    forks, mast = seen(images["forks"]), seen(images["mast"])
    red = int(((forks[..., 0] > 150) & (forks[..., 1] < 60)).any(axis=1).sum())
    open_ = (mast[..., 1] > 150) & (mast[..., 0] < 60)
    if not red and not open_.any():
        return "LIFT"
    if red > 24:
        return "HALT"
    if red > 14:
        return "CREEP"
    columns = np.flatnonzero(open_.any(axis=0))
    return "ROLL" if not len(columns) else "SWING PORT" if columns.mean() < 28 else "SWING STARBOARD"
'''
AISLES, TRIPS, TICKS = ("cold-store", "dock"), 4, 9
CAMERAS = (Camera("forks", "horizontal"), Camera("mast", "horizontal"))
GAP = Gap("pallet_m", 3.0, "m")


def warehouse(out: Path) -> None:
    """Write the bank of a forklift: a pallet before its forks, and an open side that its mast's camera shows."""
    dice, space = np.random.default_rng(4), read_space(out.parent / "forklift.toml")
    made = BankManifest(IMPORTED, "trips", "two cameras of a forklift", space, GAP, {}, {}, cameras=CAMERAS)
    with BankWriter(out, made) as writer:
        for aisle, trip, tick in product(AISLES, range(TRIPS), range(TICKS)):
            pallet_m = round(float(dice.uniform(0.5, 8)), 2)
            forks, mast = np.full((2, 40, 56, 3), 90, dtype=np.uint8)
            forks[2 : 2 + round(34 - 4 * pallet_m), 20:36] = (200, 0, 0)
            mast[36:39, slice(2, 10) if dice.random() < 0.5 else slice(46, 54)] = (0, 200, 0)
            shown = {"forks": encode(forks), "mast": encode(mast)}
            name = f"{aisle}-{trip}-{tick}"
            files = {camera: f"images/{camera}/{name}.png" for camera in shown}
            writer.add(Frame(name, aisle, str(trip), tick, CAMERAS, files, {GAP.column: pallet_m}), shown, {})


def test_a_forklift_goes_from_its_bank_to_its_bundle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Battery, score, verdict, gate, report, bundle and validate, with nothing said of it in the house."""

    def eyechart(*words: object) -> object:
        monkeypatch.setattr(sys, "argv", ["eyechart", *map(str, words)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as left:
            cli.main()
        return left.value.code

    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "forklift.toml").write_text(SPACE)
    (tmp_path / "forklift.py").write_text(FORKLIFT)
    warehouse(tmp_path / "bank")
    model = "python:forklift:decide"
    assert not eyechart("run", "battery", "--model", model, "--frames", "bank", "--out", "run")
    assert not eyechart("verdict", "run", "--json")
    verdict = json.loads(capsys.readouterr().out)["models"][model]
    assert (verdict["calibrated"], verdict["lateral"]) == ("depth_lateral", "swaps")
    assert not eyechart("score", "run", "--json")
    found = json.loads(capsys.readouterr().out)["models"][model]["statistics"]
    assert found["mirror_swap_rate"]["value"] == found["agree.real_repeat"]["value"] == 1.0
    assert found["noise_floor"]["value"] == 0.0
    assert not eyechart("gate", "run", "--require", "depth_lateral,swaps")
    assert not eyechart("report", "run", "--out", "report.html")
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "SWING STARBOARD" in page
    assert "STRAIGHT" not in page
    assert not eyechart("bundle", "run", "--out", "forklift.zip")
    assert not eyechart("validate", "forklift.zip")
