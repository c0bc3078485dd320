"""Does noise buy a stronger label? Paired runs of readers and near misses, without a coin and with one.

    make long-noise
    python benchmarks/noise_paid.py --pairs 100

Each error law is tried per picture, as at temperature 0, and per call, each in simulated worlds of 144 frames of its
own. With a coin, 10, 20 or 40 % of the answers to a road are one of all actions by chance; all else is as without. The
share that is told ``depth`` must not be higher with it than without by more than .02: no test of that is rejected
(Tango's score test of paired shares, one-sided, Holm over all rows, level .01).

Each finished run is kept in build/noise, so that an interrupted measurement goes on; another code of the rules begins
anew. Writes ``benchmarks/results/noise.json``; exit 1 where noise buys a label.
"""

import argparse
import datetime as dt
import json
import math
import random
import sys
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import eyechart
from adversarial_counts import AUTHORITY, said_of
from adversarial_runs import ROOT, Bank, judge_in_world, simulated_world
from eyechart.models.scripted import Answer, PerceivedPicture
from eyechart.stats.paired_tests import net_effect
from eyechart.stats.resamples import holm
from eyechart_organisms.adversaries import Adversary, Rule, graded, lead, noisy
from newcomers import new
from strangers import Reads, Stranger, always

RESULT = ROOT / "benchmarks" / "results" / "noise.json"
COINS, MARGIN, LEVEL = (0.1, 0.2, 0.4), 0.02, 0.01
FIRST = 5000
"""The number of the first world: others than the adversaries are asked about."""


def _by_bytes(sight: PerceivedPicture, _: random.Random) -> Answer:
    """Grade with a spread of .15 that belongs to the file: a nudged picture is read anew."""
    if sight.reading is None:
        return "STOP"
    gap = lead(sight.reading)
    return graded(gap * math.exp(random.Random(sight.file).gauss(0, 0.15)))  # noqa: S311 - no secret


def _cached(sight: PerceivedPicture, _: random.Random) -> Answer:
    """Grade behind a coin of five sides in 3 of 10 answers, which a cache of requests keeps for each file."""
    kept = random.Random(sight.file)  # noqa: S311 - no secret
    return noisy(0.3, lambda seen, _: "STOP" if seen.reading is None else graded(lead(seen.reading)))(sight, kept)


LAWS: Mapping[str, Stranger] = {
    "spread .3": new("", always(Reads(0.3, 0, 0).look)),
    "spread .4": new("", always(Reads(0.4, 0, 0).look)),
    "overlooks 5 %": new("", always(Reads(0, 0.05, 0).look)),
    "overlooks 10 %": new("", always(Reads(0, 0.1, 0).look)),
    "overlooks 20 %": new("", always(Reads(0, 0.2, 0).look)),
    "unread 20 %": new("", always(Reads(0, 0, 0.2).look)),
}
BYTES: Mapping[str, Stranger] = {
    "spread .15 of the bytes": new("", lambda: _by_bytes),
    "coin .3 behind a cache": new("", lambda: _cached),
}
ROWS = (*((name, cold) for name in LAWS for cold in (True, False)), *((name, False) for name in BYTES))
"""Each law, and whether its errors are a picture's."""


def opened(name: str, coin: float, seed: int, *, cold: bool) -> Adversary:
    """Return a new reader behind a coin, which falls for each call at either temperature."""
    one = (LAWS | BYTES)[name].open(0 if cold else 1, seed)
    return replace(one, decide=_behind(coin, one.decide)) if coin else one


def _behind(coin: float, rule: Rule) -> Rule:
    """Return a rule behind a coin at roads; what shows none is answered as without it."""
    with_coin = noisy(coin, rule)
    return lambda sight, rng: (rule if sight.reading is None else with_coin)(sight, rng)


def run(name: str, pair: int, coin: float, *, cold: bool) -> dict[str, object]:
    """Return what is said of a reader on the world of a pair."""
    bank = Bank("simulated-144", FIRST + pair)
    chance = f"{bank.seed}/{name}/{cold}"
    row = judge_in_world(opened(name, coin, bank.seed, cold=cold), simulated_world(bank), chance, bank.seed)
    return {"label": row.label, "by": row.decided_by, "calls": row.calls}


def told(runs: Mapping[int, Mapping[str, object]]) -> dict[int, bool]:
    """Return for each pair whether authority was said."""
    return {pair: one["label"] in AUTHORITY for pair, one in runs.items()}


def row_of(name: str, coin: float, without: Mapping[int, bool], with_it: Mapping[int, bool]) -> dict[str, object]:
    """Return the shares without a coin and with it over the pairs that have both, and the p of what it buys."""
    pairs = without.keys() & with_it.keys()
    won = sum(with_it[pair] and not without[pair] for pair in pairs)
    lost = sum(without[pair] and not with_it[pair] for pair in pairs)
    return {
        "reader": name,
        "coin": coin,
        "pairs": len(pairs),
        "without": sum(without[pair] for pair in pairs),
        "with": sum(with_it[pair] for pair in pairs),
        "only with": won,
        "only without": lost,
        "p": net_effect(won, lost, len(pairs), margin=MARGIN).p if pairs else None,
    }


def main() -> int:
    """Make the runs that are missing, and hold what a coin buys against the margin."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--pairs", type=int, default=100, help="worlds of each reader")
    options.add_argument("--keep", type=Path, default=ROOT / "build" / "noise", help="folder of the runs that are made")
    options.add_argument("--result", type=Path, default=RESULT, help="file of the result")
    given = options.parse_args()
    given.keep.mkdir(parents=True, exist_ok=True)
    code = said_of(ROOT).rules
    kept = given.keep / f"runs-{code}.jsonl"
    lines = kept.read_text(encoding="utf-8").splitlines() if kept.is_file() else []
    found = {tuple(key): one for key, one in map(json.loads, lines)}
    for pair in range(given.pairs):
        for name, cold in ROWS:
            for coin in (0.0, *COINS):
                key = (name, cold, coin, pair)
                if key not in found:
                    found[key] = run(name, pair, coin, cold=cold)
                    with kept.open("a", encoding="utf-8") as file:
                        file.write(json.dumps([key, found[key]]) + "\n")
        sys.stderr.write(f"{pair + 1} of {given.pairs}\n")
        if pair % 10 == 9:
            write(found, given.result, code)
    return write(found, given.result, code)


def write(found: Mapping[tuple[str, bool, float, int], Mapping[str, object]], result: Path, code: str) -> int:
    """Write and print the table; returns the exit code."""
    rows, labels = [], {}
    for name, cold in ROWS:
        words = f"{name}, {'per picture' if cold else 'per call'}"
        by_coin = {
            coin: {key[3]: one for key, one in found.items() if key[:3] == (name, cold, coin)} for coin in (0.0, *COINS)
        }
        labels[words] = {
            f"{coin:g}": dict(Counter(f"{one['label']} by {one['by']}" for one in runs.values()).most_common())
            for coin, runs in by_coin.items()
        }
        rows += [row_of(words, coin, told(by_coin[0.0]), told(by_coin[coin])) for coin in COINS]
    corrected = holm([row["p"] for row in rows])  # type: ignore[misc]
    bought = [row | {"p_holm": p} for row, p in zip(rows, corrected, strict=True) if p is not None and p < LEVEL]
    made = {
        "eyechart": eyechart.__version__,
        "date": dt.datetime.now(dt.UTC).date().isoformat(),
        "code": code,
        "margin": MARGIN,
        "level": LEVEL,
        "bought": bought,
        "rows": rows,
        "labels": labels,
    }
    result.write_text(json.dumps(made, indent=1) + "\n", encoding="utf-8")
    for row in rows:
        words = f"{row['with']} with it, {row['without']} without, of {row['pairs']}"
        print(f"{row['reader']:36} coin {row['coin']:.1f}: {words}")
    print(f"noise buys a label in {len(bought)} of {len(rows)} rows")
    return int(bool(bought))


if __name__ == "__main__":
    sys.exit(main())
