"""Copies that are made to be read are gone at the end, and those of a killed process at the next start."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from eyechart import scratch as module
from eyechart.scratch import scratch

COPIES = """
import os, sys, time
from eyechart.ledger import Ledger
from pathlib import Path
with Ledger(Path(sys.argv[1]), accepting=True):
    os.write(1, b"copied\\n")
    time.sleep(300)
"""
LEDGER = Path(__file__).parent / "old" / "0.1.0" / "made" / "battery" / "ledger.sqlite"


def test_the_copies_of_a_killed_process_are_cleared_at_the_next_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And no other: not those of one that lives, nor what is somebody else's."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(module, "_YOUNG_S", -1.0)
    (tmp_path / "eyechart-notes").mkdir()
    command = [sys.executable, "-c", COPIES, str(LEDGER)]
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    begun = [subprocess.Popen(command, stdout=subprocess.PIPE, env=environment) for _ in range(2)]
    try:
        for one in begun:
            assert one.stdout is not None
            assert one.stdout.readline() == b"copied\n"
        begun[0].kill()
        begun[0].wait()
        assert len(list(tmp_path.glob("eyechart-ledger-*"))) == 2
        module._clear.cache_clear()
        with scratch("ledger") as folder:
            left = {path.name for path in tmp_path.iterdir()}
            assert len(left) == 3
            assert {"eyechart-notes", folder.parent.name} < left
    finally:
        for one in begun:
            one.kill()
            one.communicate()
    assert not folder.exists()


STEPS = """
import os, sys
from eyechart.scratch import scratch
seen = 0
def killed(event, args):
    global seen
    changes = event in {"os.remove", "os.rmdir", "os.mkdir"} or event == "open" and str(args[0]).endswith(".held")
    seen += changes and (seen > 0 or "eyechart-" in str(args[0]))
    if seen > int(sys.argv[1]):
        os._exit(9)
sys.addaudithook(killed)
with scratch("ledger") as folder:
    (folder / "a").write_text("a")
"""


def test_a_folder_is_cleared_whenever_its_process_was_killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Before its lock was there, and at each step of its removal."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(module, "_YOUNG_S", -1.0)
    left = set()
    for moment in range(20):
        command = [sys.executable, "-c", STEPS, str(moment)]
        done = subprocess.run(command, env={**os.environ, "TMPDIR": str(tmp_path)}, check=False)
        left.add(len(list(tmp_path.iterdir())))
        module._clear.cache_clear()
        module._clear(str(tmp_path))
        assert list(tmp_path.iterdir()) == []
        if done.returncode == 0:
            break
    assert done.returncode == 0
    assert left == {0, 1}


@pytest.mark.parametrize("name", ["eyechart-run-20261129", "eyechart-out-a1b2c3d4", "eyechart-ledger-mine_own"])
def test_an_empty_folder_of_a_user_stays(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It may be the folder in which a user works, as mktemp made it."""
    monkeypatch.setattr(module, "_YOUNG_S", -1.0)
    (tmp_path / name).mkdir()
    module._clear.cache_clear()
    module._clear(str(tmp_path))
    assert (tmp_path / name).is_dir()
