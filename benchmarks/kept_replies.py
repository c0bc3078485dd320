"""What the reader makes of the replies of numbers, letters and phrases that were kept until its rules were done.

    make long-marks
    python benchmarks/kept_replies.py [--mended "what was mended since"]

Writes ``benchmarks/results/marks.json``: per set how many replies there are, how many are read, and how many of them
wrongly, with the commit of the reader. The first count stands: a later one goes under "after" with what was mended.
Exit 1 where an action is read wrongly.
"""

import argparse
import datetime as dt
import json
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests")]

import eyechart  # noqa: E402
from eyechart.spaces.reader import READER  # noqa: E402
from marked_replies import SETS, counted, marked  # noqa: E402 - of the tests, as the corpus is

RESULT = ROOT / "benchmarks" / "results" / "marks.json"


def measured() -> dict[str, object]:
    """Return the counts of each set of the kept part, with the date, the version and the reader's commit."""
    asked = ["git", "-C", str(ROOT), "log", "-1", "--format=%h", "--", "src/eyechart/spaces"]
    commit = subprocess.run(asked, capture_output=True, text=True, check=True).stdout.strip()
    about = {"date": dt.datetime.now(tz=dt.UTC).date().isoformat(), "version": eyechart.__version__}
    return {**about, "reader": READER, "commit": commit, "kept": {kind: counted(marked("kept", kind)) for kind in SETS}}


def main() -> int:
    """Count, keep the first count, and return 1 where an action is read wrongly."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--mended", default="", help="what was mended since the first count, in a sentence")
    mended, found = options.parse_args().mended, measured()
    if RESULT.is_file():
        first = json.loads(RESULT.read_text(encoding="utf-8"))
        told = mended or first.get("after", {}).get("mended", "nothing")
        found = {**first, "after": {"mended": told, **found}}
    RESULT.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    sets = {kind: counted(marked("kept", kind)) for kind in SETS}
    for kind, counts in sets.items():
        print(f"{kind}: {counts}")
    return int(any(counts["wrong"] for counts in sets.values()))


if __name__ == "__main__":
    sys.exit(main())
