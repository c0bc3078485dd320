"""The page on frames of one's own cannot rot: its files are read, its commands parsed, its Python run."""

import re
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from typer.main import get_command

import photographs
from eyechart.calls import Reply
from eyechart.cli.app import app
from eyechart.frames import encode, open_bank
from eyechart.importing.columns import ROLES, read_rig
from eyechart.prompts import read_prompt
from eyechart.spaces.discrete import DRIVING, read_space
from eyechart.spaces.fields import AnswerField

DOCS = Path(__file__).parents[2] / "docs"
PAGES = ("bring-your-own-frames", "frames-reference", "own-prompts")
PAGE = "\n".join((DOCS / f"{name}.md").read_text(encoding="utf-8") for name in PAGES)


def blocks(kind: str) -> list[str]:
    """Return the page's blocks of a kind."""
    return re.findall(rf"^```{kind}\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)


def test_its_commands_and_options_exist() -> None:
    """Every line names a command and options that there are."""
    lines = [line for block in blocks("sh") for line in block.splitlines()]
    assert len(lines) >= 6
    for line in lines:
        command, words = get_command(app), line.split()[1:]
        while hasattr(command, "commands"):
            command = command.commands[words.pop(0)]
        known = {option for parameter in command.params for option in parameter.opts}
        assert {word for word in words if word.startswith("--")} <= known


def test_its_example_runs_as_it_stands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The TOML files are read, and the Python makes a bank with nothing missing."""
    rig, motion, _, _, space, prompt, placed, several, *_ = blocks("toml")
    (tmp_path / "rig.toml").write_text(rig)
    left, right = read_rig(tmp_path / "rig.toml").cameras
    assert (left.name, left.mirrors) == ("left_wrist", right.name)
    (tmp_path / "done.toml").write_text(rig + motion)
    done = read_rig(tmp_path / "done.toml").space
    assert done is not None
    assert [(dimension.name, dimension.state) for dimension in done.dimensions] == [("goal_1", 0), ("goal_2", 1)]
    (tmp_path / "rover.toml").write_text(space)
    (tmp_path / "ask.toml").write_text(prompt)
    assert read_space(tmp_path / "rover.toml").brake == ("HALT", "CRAWL")
    assert read_prompt(tmp_path / "ask.toml").fields == ("speed",)
    (tmp_path / "placed.toml").write_text(placed)
    assert [place.name for place in read_prompt(tmp_path / "placed.toml").messages[0].places] == ["left", "front"]
    (tmp_path / "near.png").write_bytes(encode(np.zeros((8, 8, 3), dtype=np.uint8)))
    (tmp_path / "few-shot.toml").write_text(several)
    assert len(read_prompt(tmp_path / "few-shot.toml").messages) == 4
    rows = photographs.rows()
    photographs.take(tmp_path / "photos", rows)
    (tmp_path / "photos.csv").write_text(photographs.as_csv(rows))
    monkeypatch.chdir(tmp_path)
    exec(compile(blocks("python")[0], "the page", "exec"), {})  # noqa: S102 - it is what is tested
    bank = open_bank(tmp_path / "bank")
    assert len(bank) == len(rows)
    assert bank.manifest.action_space.name == "rover"


READS = {
    "action": ('{"plan": {"cmd": "left"}}', "LEFT"),
    "Response": ("Response to user:#### 4", "4"),
    "steer": ('{"steer": "Left", "speed": "3 m/s"}', "steer=Left speed<5"),
    "pairs": ("[(1, 0), (1, 0), (1, 0), (1, 0), (1, 0), (1, 0)]", "pairs=[1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0]"),
    "arrow": ("{'action': 3}", "3"),
}


def test_its_answers_are_read_as_it_says(tmp_path: Path) -> None:
    """Each example of an answer table is a legal prompt, and reads such a reply."""
    tables = [block for block in blocks("toml") if "[answer" in block]
    assert len(tables) == len(READS)
    for table, (named, (text, action)) in zip(tables, READS.items(), strict=True):
        assert named in table
        (tmp_path / "ask.toml").write_text(table)
        assert read_prompt(tmp_path / "ask.toml").asks(DRIVING).read(Reply(text, "stop")).action == action
    assert {one.name for one in fields(AnswerField)} <= {*re.findall(r"`(\w+)`", PAGE)}


def test_it_has_a_row_for_every_place() -> None:
    """What each missing column costs."""
    assert [place for place in ROLES if f"| `{place}`" not in PAGE] == []
