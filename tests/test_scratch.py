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
