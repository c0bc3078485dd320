"""What the rows of the rules say of random evidences, held against what the functions said that they replaced.

    make long-rulings
    python benchmarks/old_rulings.py

Digests of blocks of 1000 evidences were recorded of the functions (`tests/old_rulings.json` of a battery's axes,
`tests/old_rulings_policies.json` of those of a policy, `tests/old_sights.json` of drives, planners, prompts and
estimates); the tests compare the first blocks, and this all of an axis.
Of policies those evidences are left out that a rule reads which was changed since: how many these are, and which labels
became others, is recorded in `tests/changed_rulings_policies.json` and stands beside.
Each axis is written to ``benchmarks/results/old_rulings.json`` as soon as it is done, and is not done again; ``--anew``
begins anew. Exit 1 where a block differs.
"""

import argparse
import datetime as dt
import json
import sys
from pathlib import Path

import eyechart

ROOT = Path(__file__).resolve().parents[1]
RESULT = ROOT / "benchmarks" / "results" / "old_rulings.json"
sys.path[:0] = [str(ROOT / "tests")]

import test_policy_rules as policies  # noqa: E402 - of the tests, whose short form does the same
import test_rules as battery  # noqa: E402
import test_sights as sights  # noqa: E402
from evidences import RECORDED, digests  # noqa: E402
from sights import SAID  # noqa: E402


def blocks_of(axis: str) -> tuple[list[str], list[str]]:
    """Return the recorded digests of an axis, and those of what the rows say."""
    if axis in battery.OLD:
        return battery.OLD[axis], list(digests(battery.SAID[axis], RECORDED[axis], len(battery.OLD[axis])))
    if axis in sights.OLD:
        say, seed, of = SAID[axis]
        return sights.OLD[axis], list(digests(say, seed, len(sights.OLD[axis]), of))
    return policies.OLD[axis], list(policies.said(axis, len(policies.OLD[axis])))


def changed(axis: str) -> dict[str, object]:
    """Return how many evidences of an axis are read otherwise since, and which labels became others."""
    if axis not in policies.CHANGED:
        return {}
    found = policies.CHANGED[axis]
    return {"read otherwise since": found["read otherwise"]["all"], "became": found["became, of all"]}


def main() -> int:
    """Compare the axes that have no row yet; return 1 where any block differs."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--anew", action="store_true")
    anew = options.parse_args().anew
    rows = {} if anew or not RESULT.is_file() else json.loads(RESULT.read_text(encoding="utf-8"))["axes"]
    for axis in (*battery.OLD, *policies.OLD, *sights.OLD):
        if axis not in rows:
            old, now = blocks_of(axis)
            differ = sum(one != other for one, other in zip(old, now, strict=True))
            size = SAID[axis][2] if axis in sights.OLD else 1000
            rows[axis] = {"evidences": size * len(old), "blocks": len(old), "blocks that differ": differ}
            rows[axis] |= changed(axis)
            print(axis, rows[axis], flush=True)
            date = dt.datetime.now(dt.UTC).date().isoformat()
            told = {"version": eyechart.__version__, "date": date, "axes": rows}
            RESULT.write_text(json.dumps(told, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return int(any(row["blocks that differ"] for row in rows.values()))


if __name__ == "__main__":
    sys.exit(main())
