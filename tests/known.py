"""One demo for all tests that look at it: a balanced bank, sixteen controllers, and what the command printed."""

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from filelock import FileLock

EYECHART = Path(sys.executable).with_name("eyechart")


@dataclass(frozen=True)
class Demo:
    """Where the demo lies, what it printed on standard output, and its exit code."""

    folder: Path
    printed: str
    code: int

    @property
    def bank(self) -> Path:
        """Return the demo's bank."""
        return self.folder / "bank-0"

    @property
    def run(self) -> Path:
        """Return the demo's run."""
        return self.folder / "run-0"


def demo(shared: Path) -> Demo:
    """Run ``eyechart demo`` once a test session, however many workers ask for it."""
    folder, record = shared / "demo", shared / "demo.json"
    with FileLock(shared / "demo.lock"):
        if not record.exists():
            command = [EYECHART, "demo", "--out", str(folder)]
            done = subprocess.run(
                command, capture_output=True, text=True, check=False, env={**os.environ, "COLUMNS": "120"}
            )
            if done.returncode not in (0, 1):
                raise AssertionError(f"the demo failed: {done.stderr}")
            record.write_text(json.dumps({"printed": done.stdout, "code": done.returncode}))
    return Demo(folder, **json.loads(record.read_text()))
