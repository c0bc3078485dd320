"""The page on guardians: its commands and its Python are run, with voters who see boxes in the place of the models."""

import json
import re
import shlex
import sys
from pathlib import Path

import pytest

import pages
import voters
from banks import build_bank, draw
from eyechart import cli
from eyechart.frames import encode
from eyechart.models import ADAPTERS
from eyechart.studies.guardian import read_votes

PAGE = (pages.ROOT / "docs" / "guardian.md").read_text(encoding="utf-8")
STAND_INS = {"scripted:scene_positive_control": "voter:sees", "scripted:scene_over_calling": "voter:always"}


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stand in a folder with a bank of boxes."""
    monkeypatch.setitem(ADAPTERS, "voter", "voters")
    assert voters.VERSION["all"] == "1"
    monkeypatch.chdir(tmp_path)
    build_bank(Path("bank"), episodes=3, steps=4, drawn=False)


def test_its_commands_and_its_python_run_as_they_stand(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """From runs to an exported guardian, to an answer; a replay on pictures that are no road is refused by name."""
    printed: dict[str, str] = {}
    blocks = re.findall(r"^```sh\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    for line in "".join(blocks).splitlines():
        words = [STAND_INS.get(word, word) for word in shlex.split(line)]
        if words[:1] != ["eyechart"] or words[1] == "serve":
            continue
        monkeypatch.setattr(sys, "argv", words)
        with pytest.raises(SystemExit) as left:
            cli.main()
        said = capsys.readouterr()
        assert left.value.code == (2 if words[2] == "modular" else 0), said.err
        printed[words[2]] = said.out + said.err
    assert "hazard from" in printed["score"]
    assert "9/9 folds" in printed["nested"]
    assert "modular replay is for pictures of highway-env, of the rover and of the drone" in printed["modular"]
    (python,) = re.findall(r"^```python\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    exec(compile(python, "docs/guardian.md", "exec"), {"picture": encode(draw(8.0, 1))})  # noqa: S102 - it is tested
    assert capsys.readouterr().out.startswith("hazard 4 of 4 votes say hazard")


def test_its_table_of_votes_and_the_file_about_them_are_read(tmp_path: Path) -> None:
    """As the page shows them."""
    (table,) = re.findall(r"^```text\n(frame,.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    (about,) = re.findall(r"^```toml\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    (tmp_path / "votes.csv").write_text(table)
    (tmp_path / "votes.toml").write_text(about)
    read = read_votes(tmp_path / "votes.csv", about=tmp_path / "votes.toml")
    assert read.models == ("detector-a", "detector-b")
    assert read.votes[1].tolist() == [[1, 0], [-1, 0], [1, 1]]
    assert read.about.unrecorded(read.models) == ["version of detector-b"]
    assert json.dumps(read.about.versions) == '{"detector-a": "3.1"}'
