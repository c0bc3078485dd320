"""A report and a bundle are the same bytes each time, whatever the process that writes them was told of its machine."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from banks import build_bank
from eyechart.studies import battery

ENVIRONMENTS = (
    {"PYTHONHASHSEED": "1", "TZ": "Pacific/Kiritimati", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
    {"PYTHONHASHSEED": "2", "TZ": "America/Adak", "OMP_NUM_THREADS": "2", "OPENBLAS_NUM_THREADS": "2"},
)
LOCALES = ({"LC_ALL": "C.UTF-8", "COLUMNS": "200"}, {"LC_ALL": "C", "COLUMNS": "60"})


@pytest.mark.slow
@pytest.mark.parametrize("command", ["report", "bundle"])
def test_two_processes_write_the_same_bytes(tmp_path: Path, command: str) -> None:
    """By other hash seeds, time zones, numbers of threads, locales and widths of terminals."""
    bank = build_bank(tmp_path / "bank", drawn=False)
    battery.run(battery.plan(bank.root, ["scripted:depth", "scripted:constant"], tmp_path / "run"))
    written = []
    for number, (told, locale) in enumerate(zip(ENVIRONMENTS, LOCALES, strict=True)):
        out = tmp_path / f"{number}.{'html' if command == 'report' else 'zip'}"
        program = [sys.executable, "-c", "from eyechart.cli import main; main()", command, "run", "--out", str(out)]
        done = subprocess.run(
            program, cwd=tmp_path, env={**os.environ, **told, **locale}, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        written.append(out.read_bytes())
    assert written[0] == written[1]
