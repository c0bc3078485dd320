"""Another trade in one file of actions and one bank: a forklift, which has no lanes, from pictures to bundle."""

import csv
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from eyechart import cli
from eyechart.conditions import BATTERY
from eyechart.frames import open_bank
from eyechart.spaces.discrete import read_space

SPACE = """
actions = ["HALT", "CREEP", "ROLL", "LIFT", "SWING PORT", "SWING STARBOARD"]
mirror_pairs = [["SWING PORT", "SWING STARBOARD"]]
brake = ["HALT", "CREEP"]
proceed = ["ROLL", "SWING PORT", "SWING STARBOARD"]
"""
RIG = """
[[camera]]
name = "mast"
column = "file"
mirror_axis = "horizontal"

[[camera]]
name = "rear"
column = "behind"
mirror_axis = "horizontal"

[state]
fork = ["height_m", "tilt"]
"""
FORKLIFT = '''
"""Halts before a pallet, creeps towards one, and swings to the open side where it has room."""
import io

import numpy as np
from PIL import Image


def decide(prompt, images, state):
    if "mast" not in images or not state:
        return "LIFT"
    pixels = np.asarray(Image.open(io.BytesIO(images["mast"])).convert("RGB")).astype(int)
    red = int(((pixels[..., 0] > 150) & (pixels[..., 1] < 60)).any(axis=1).sum())
    open_ = (pixels[..., 1] > 150) & (pixels[..., 0] < 60)
    if not red and not open_.any():
        return "LIFT"
    if red > 24:
        return "HALT"
    if red > 14:
        return "CREEP"
    columns = np.flatnonzero(open_.any(axis=0))
    return "ROLL" if not len(columns) else "SWING PORT" if columns.mean() < 28 else "SWING STARBOARD"
'''
AISLES, TRIPS, TICKS = ("cold store", "dock"), 4, 9


def warehouse(folder: Path) -> None:
    """Write the pictures of a forklift's two cameras with their table: a pallet ahead, and an open side."""
    dice = np.random.default_rng(4)
    rows = []
    for aisle in AISLES:
        for trip in range(TRIPS):
            for tick in range(TICKS):
                pallet_m = round(float(dice.uniform(0.5, 8)), 2)
                pixels = np.full((40, 56, 3), 90, dtype=np.uint8)
                pixels[2 : 2 + round(34 - 4 * pallet_m), 20:36] = (200, 0, 0)
                side = dice.choice([-1, 1])
                pixels[36:39, slice(2, 10) if side < 0 else slice(46, 54)] = (0, 200, 0)
                name = f"{aisle} {trip}-{tick}.png"
                Image.fromarray(pixels).save(folder / name)
                behind = f"behind {name}"
                Image.fromarray(dice.integers(0, 90, (20, 30, 3), dtype=np.uint8)).save(folder / behind)
                row = {"file": name, "scenario": aisle, "episode": trip, "step": tick, "pallet_m": pallet_m}
                rows.append({**row, "behind": behind, "height_m": tick / 10, "tilt": -0.125})
    with (folder / "table.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


@pytest.mark.slow
def test_a_forklift_goes_from_its_pictures_to_its_bundle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Import, battery, score, verdict, gate, report, bundle and validate, with nothing said of it in the house."""

    def eyechart(*words: object) -> object:
        monkeypatch.setattr(sys, "argv", ["eyechart", *map(str, words)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as left:
            cli.main()
        return left.value.code

    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "forklift.toml").write_text(SPACE)
    (tmp_path / "rig.toml").write_text(RIG)
    (tmp_path / "forklift.py").write_text(FORKLIFT)
    (tmp_path / "photos").mkdir()
    warehouse(tmp_path / "photos")
    table = ("--table", "photos/table.csv", "--map", "gap=pallet_m", "--threshold", 3, "--unit", "m")
    words = ("--rig", "rig.toml", "--actions", "forklift.toml", "--picture", "mast and rear camera of a forklift")
    assert not eyechart("frames", "import", "photos", *table, *words, "--out", "bank")
    assert open_bank(tmp_path / "bank").manifest.action_space == read_space(tmp_path / "forklift.toml")
    model = "python:forklift:decide"
    frame = open_bank(tmp_path / "bank").frames[3]
    assert (list(frame.pictures), frame.state) == (["mast", "rear"], {"fork": (0.3, -0.125)})
    asked = f"{','.join(BATTERY)},blank@mast,blank@rear,text_only@rear,shuffled@rear"
    assert not eyechart("run", "battery", "--model", model, "--frames", "bank", "--conditions", asked, "--out", "run")
    assert not eyechart("verdict", "run", "--json")
    verdict = json.loads(capsys.readouterr().out)["models"][model]
    assert (verdict["calibrated"], verdict["lateral"]) == ("depth_associated", "no_power")
    assert verdict["why_not"]["conditions"][:2] == ["lead_near", "lead_far"]
    assert not eyechart("score", "run", "--json")
    found = json.loads(capsys.readouterr().out)["models"][model]["statistics"]
    assert found["mirror_swap_rate"]["value"] == found["agree.real_repeat"]["value"] == 1.0
    assert found["noise_floor"]["value"] == 0.0
    assert found["agree.blank@mast"] == found["agree.blank"]
    assert {found[f"agree.{name}@rear"]["value"] for name in ("blank", "text_only", "shuffled")} == {1.0}
    assert (
        eyechart("gate", "run", "--require", "swaps") == 2
    )  # of so few episodes, each swapped answer is one of many alike
    assert eyechart("gate", "run", "--require", "depth_lateral,swaps") == 2
    assert not eyechart("report", "run", "--out", "report.html")
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "SWING STARBOARD" in page
    assert "STRAIGHT" not in page
    assert not eyechart("bundle", "run", "--out", "forklift.zip")
    assert not eyechart("validate", "forklift.zip")
