"""One demo for all tests that look at it: a balanced bank, sixteen controllers, and what the command printed.

Parts of it stand for runs and banks that a test would else make anew: a run of one of the controllers, and half of
the frames.
"""

import json
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from filelock import FileLock

from eyechart.frames import BankWriter, FrameBank, open_bank
from eyechart.manifest import RUN
from eyechart.simulators import open_bank_simulator

if TYPE_CHECKING:
    from eyechart_organisms.calibration import Calibration

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

    @property
    def half(self) -> Path:
        """Return a bank of every second frame of the demo's: all episodes, six frames each."""
        return self.folder.with_name("half")

    def alone(self, controller: str, out: Path) -> Path:
        """Return a complete run of one controller: the demo's, of which only this one's calls count."""
        shutil.copytree(self.run, out)
        manifest = json.loads((out / RUN).read_text(encoding="utf-8"))
        for place in ("models", "modes"):
            manifest[place] = {f"scripted:{controller}": manifest[place][f"scripted:{controller}"]}
        (out / RUN).write_text(json.dumps(manifest), encoding="utf-8")
        return out


def demo(shared: Path) -> Demo:
    """Run ``eyechart demo`` once a test session, however many workers ask for it."""
    folder, record = shared / "demo", shared / "demo.json"
    with FileLock(shared / "demo.lock"):
        if not record.exists():
            command = [EYECHART, "demo", "--out", str(folder)]
            plain = {name: value for name, value in os.environ.items() if name != "COLUMNS"}
            done = subprocess.run(command, capture_output=True, text=True, check=False, env=plain)
            if done.returncode not in (0, 1):
                raise AssertionError(f"the demo failed: {done.stderr}")
            thin(folder / "bank-0", folder.with_name("half"))
            record.write_text(json.dumps({"printed": done.stdout, "code": done.returncode}))
    return Demo(folder, **json.loads(record.read_text()))


def calibration(shared: Path) -> "Calibration":
    """Calibrate one bank of the default setting once a test session, however many workers ask for it."""
    from eyechart_organisms.calibration import calibrate  # noqa: PLC0415 - few tests need it, and it takes a while to import

    with FileLock(shared / "calibration.lock"):
        return calibrate(replications=1, seed=3, settings=["default"], keep=shared / "calibration.jsonl")


def thin(bank: Path, out: Path) -> FrameBank:
    """Write every second frame of a bank into another, whose distances are not those of so few frames; return that."""
    whole = open_bank(bank)
    with BankWriter(out, replace(whole.manifest, span=None)) as writer:
        for frame in whole.frames[::2]:
            writer.add(frame, whole.images(frame), {name: whole.images(frame, name) for name in frame.counterfactuals})
    return open_bank(out)


def table(folder: Path, **how: object) -> FrameBank:
    """Return a bank of the tabletop with two frames an episode: most claims about policies count by the episode."""
    whole = open_bank_simulator("tabletop").build(folder.with_name(f"{folder.name}-whole"), steps=4, **how)
    return thin(whole.root, folder)


def whole_table(bank: FrameBank) -> FrameBank:
    """Return the bank of four frames an episode of which `table` took two."""
    return open_bank(bank.root.with_name(f"{bank.root.name}-whole"))
