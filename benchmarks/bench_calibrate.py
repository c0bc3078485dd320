"""What the calibration takes: processor time of one simulated bank of its default setting, all controllers and rules.

The command is run with one bank and with three, and a bank takes half of the difference, so that its start does not
count. Reported, not gated. Writes ``results/bench_calibrate.json``.
"""

import argparse
import os
import resource
import subprocess
import sys

from pairs import keep

FEW, MANY, SETTING = 1, 3, "default"


def cpu_s(replications: int) -> float:
    """Return the processor seconds of the command with so many banks, in one process."""
    words = [sys.executable, "-m", "eyechart", "calibrate", "--setting", SETTING, "--processes", "1", "--json"]
    before = _children()
    done = subprocess.run(
        [*words, "--replications", str(replications)],
        stdout=subprocess.DEVNULL,
        check=False,
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": ""},
    )
    if done.returncode not in {0, 1}:  # 1: so few banks meet no target
        raise SystemExit(f"calibrate ended with {done.returncode}")
    return _children() - before


def _children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main() -> None:
    """Measure, keep and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=2)
    found = [(cpu_s(FEW), cpu_s(MANY)) for _ in range(parser.parse_args().pairs)]
    each = [(many - few) / (MANY - FEW) for few, many in found]
    result = {"setting": SETTING, "banks": [FEW, MANY], "cpu_s": found, "cpu_s_a_bank": each, "least": min(each)}
    keep("bench_calibrate", result)
    print(
        f"a bank takes {min(each):.1f} s of processor time, the least of {len(each)}; one alone with the start {found}"
    )


if __name__ == "__main__":
    main()
