"""A million replies made from the corpus by mutation, each read: no exception, an action of the space or a reason.

    make long-replies
    python benchmarks/fuzzed_replies.py --replies 1000000

Replies follow from their numbers. Parts of 10 000 are kept on disk, so that an interrupted measurement goes on. Writes
``benchmarks/results/replies.json``, with what the reader makes of both parts of the corpus; exit 1 where anything was
wrong.
"""

import argparse
import datetime as dt
import json
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests")]

import eyechart  # noqa: E402
from eyechart.calls import Reply  # noqa: E402
from eyechart.spaces.reader import READER  # noqa: E402
from mutated_replies import PARTS, SPACES, count_wrong, read_corpus  # noqa: E402 - of the tests, as the corpus is

RESULT = ROOT / "benchmarks" / "results" / "replies.json"
KEPT = ROOT / "build" / f"fuzzed_replies_{READER}.json"
PART = 10_000


def corpus_read() -> dict[str, object]:
    """Return of each part of the corpus how many replies are read, rightly, and of how many that hold an action."""
    result: dict[str, object] = {}
    for part in PARTS:
        read = right = hold = held = 0
        for one in (one for one in read_corpus() if one.part == part):
            action = SPACES[one.space].read(Reply(one.text, "stop", None)).action
            read, right = (
                read + (action is not None),
                right + (action is not None and {action} == {one.first, one.second}),
            )
            if one.first is not None and one.first == one.second:
                hold, held = hold + 1, held + (action == one.first)
        result[part] = {"read": read, "rightly": right, "hold an action": hold, "of these read": held}
    return result


def main() -> int:
    """Read as many replies as were asked for, or the rest of them; return 1 where anything was wrong."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--replies", type=int, default=1_000_000)
    replies = options.parse_args().replies
    kept = json.loads(KEPT.read_text()) if KEPT.is_file() else {"read": 0, "seconds": 0.0, "wrong": []}
    corpus = read_corpus()
    while kept["read"] < replies:
        start, end = kept["read"], min(replies, kept["read"] + PART)
        began = time.process_time()
        kept["wrong"] += count_wrong(corpus, range(start, end))
        kept["seconds"] += time.process_time() - began
        kept["read"] = end
        KEPT.parent.mkdir(exist_ok=True)
        KEPT.write_text(json.dumps(kept))
    about = {"date": dt.datetime.now(tz=dt.UTC).date().isoformat(), "version": eyechart.__version__, "reader": READER}
    told = {"replies": kept["read"], "wrong": kept["wrong"][:20], "processor_seconds": round(kept["seconds"], 1)}
    RESULT.write_text(json.dumps({**about, **told, "corpus": corpus_read()}, indent=1, ensure_ascii=False) + "\n")
    print(f"{kept['read']} replies read, {len(kept['wrong'])} wrong: {RESULT}")
    return int(bool(kept["wrong"]))


if __name__ == "__main__":
    sys.exit(main())
