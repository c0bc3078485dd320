"""Write the tables of a calibration into docs/calibration.md, between its two marks.

Usage: eyechart calibrate --replications 200 --json > found.json; python docs/update_calibration.py found.json
"""

import json
import re
import sys
from pathlib import Path

from eyechart.calibrate.table import tables
from eyechart.calibrate.tally import Calibration, read_calibration

PAGE = Path(__file__).with_name("calibration.md")
BLOCK = re.compile(r"(<!-- calibration: .*? -->\n).*?(<!-- end of calibration -->)", re.DOTALL)


def block(found: Calibration) -> str:
    """Return the command of a run and its tables."""
    command = f"eyechart calibrate --replications {found.replications} --seed {found.seed}"
    return f"Command: `{command}`\n\n{tables(found)}\n"


def main() -> None:
    """Replace what stands between the marks."""
    found = read_calibration(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")))
    text = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(BLOCK.sub(lambda match: match.group(1) + block(found) + match.group(2), text), encoding="utf-8")


if __name__ == "__main__":
    main()
