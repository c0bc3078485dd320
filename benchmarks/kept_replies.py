"""What the reader makes of the replies of numbers, letters and phrases that were kept until its rules were done.

There are four such samples, of other writers and readers: "kept", "second", whose other half is in the open part,
"third" and "fourth".

    make long-marks
    python benchmarks/kept_replies.py [--mended "what was mended since"]

Writes ``benchmarks/results/marks.json``: per sample and set how many replies there are, how many are read, and how many
of them wrongly, with the commit of the reader. A sample's first count stands: a later one of all goes under "after",
with what was mended.
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
SAMPLES = ("kept", "second", "third", "fourth")


def about() -> dict[str, object]:
    """Return the date, the version and the reader's commit."""
    asked = ["git", "-C", str(ROOT), "log", "-1", "--format=%h", "--", "src/eyechart/spaces"]
    commit = subprocess.run(asked, capture_output=True, text=True, check=True).stdout.strip()
    date = dt.datetime.now(tz=dt.UTC).date().isoformat()
    return {"date": date, "version": eyechart.__version__, "reader": READER, "commit": commit}


def main() -> int:
    """Count, keep each sample's first count, and return 1 where an action is read wrongly."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--mended", default="", help="what was mended since the first count, in a sentence")
    mended = options.parse_args().mended
    found = json.loads(RESULT.read_text(encoding="utf-8")) if RESULT.is_file() else {}
    counts = {sample: {kind: counted(marked(sample, kind)) for kind in SETS} for sample in SAMPLES}
    earlier = [sample for sample in SAMPLES if sample in found]
    for sample in SAMPLES:
        found.setdefault(sample, {**about(), **counts[sample]})
    if earlier:
        said = mended or found.get("after", {}).get("mended", "nothing")
        found["after"] = {"mended": said, **about(), **{sample: counts[sample] for sample in earlier}}
    RESULT.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    for sample, sets in counts.items():
        for kind, count in sets.items():
            print(f"{sample} {kind}: {count}")
    return int(any(count["wrong"] for sets in counts.values() for count in sets.values()))


if __name__ == "__main__":
    sys.exit(main())
