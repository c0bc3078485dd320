"""How many calls each kind of controller took before the rule of depth was a new one, and takes now, as a table.

    make long-calls
    python benchmarks/calls_by_kind.py --old build/0.2.0.dev0/src

Both versions simulate worlds of 144 frames from the same seeds and ask every adversary and known answer in their own
stages; the calls are counted. Blind controllers may take 1.05 times as many as before. Each finished bank of a version
is kept in build/calls. Writes ``benchmarks/results/calls.json``; exit 1 where a blind one takes more.
"""

import argparse
import datetime as dt
import json
import os
import subprocess
import sys
from pathlib import Path
from statistics import mean

from eyechart import __version__

ROOT = Path(__file__).resolve().parents[1]
RESULT = ROOT / "benchmarks" / "results" / "calls.json"
OLD = ROOT / "build" / "0.2.0.dev0" / "src"
FRAMES, MOST = 144, 1.05
BLIND = ("constant", "random", "presence", "self_inconsistent", "refuse_blank", "noisy_constant", "always_left")
READERS = ("depth", "depth_lateral", "depth_left", "one_sided", "emergency", "early", "logistic", "goes_when_far")
READERS += ("three_ranges", "grades_noise_10", "grades_noise_30", "grades_noise_50", "half_blind")
LAYOUT = ("nearest_any_lane", "any_vehicle", "crowd", "inverse_distances", "spread", "centroid", "any_vehicle_noisy")
KINDS = {"blind": BLIND, "reader of distance": READERS, "follower of the layout": LAYOUT}

BEFORE = """
from eyechart.calibrate.adversaries import ADVERSARIES
from eyechart.calibrate.known import KNOWN, Known as KnownController, by_sight
from eyechart.calibrate.replication import answers_of, staged
from eyechart.calibrate.world import SETTINGS, make_world
from eyechart.studies.battery.published import Resampling
from eyechart.studies.battery.scoring import statistics_of
"""
NOW = """
from eyechart_organisms.adversaries import ADVERSARIES
from eyechart_organisms.calibration.known_answers import KNOWN, KnownController, by_sight
from eyechart_organisms.calibration.replication import answers_of, staged
from eyechart_organisms.calibration.world import SETTINGS, make_world
from eyechart.studies.battery.paper_statistics import Resampling
from eyechart.studies.battery.scores import statistics_of
"""
"""Where either version has what the count needs."""

COUNT = """
import json, random, sys
import numpy as np
from eyechart.verdicts import calibrated_rules
seed = int(sys.argv[1])
setting = SETTINGS["default"]
world, how = make_world(setting, np.random.default_rng(seed)), Resampling(resamples=999, seed=seed, intervals=False)
tried = dict(KNOWN)
tried |= {name: KnownController(name, one.says, by_sight(one.decide), "", "", "") for name, one in ADVERSARIES.items()}
found = {}
for name, one in tried.items():
    asked = staged(answers_of(one, setting, world, random.Random(f"{seed}/{name}")), how)
    calls = sum(one is not None for column in asked.decisions.values() for one in column)
    found[name] = [calls, calibrated_rules(statistics_of(asked, how), turns=False)[0].label]
print(json.dumps(found))
"""
"""What either version runs on a bank: of each controller the calls, and the label."""


def counted(source: Path, imports: str, seed: int, kept: Path) -> dict[str, list[object]]:
    """Return the calls and label of each controller on the bank of a seed, by the source of one version."""
    if not kept.is_file():
        environment = {**os.environ, "PYTHONPATH": str(source)}
        words = [sys.executable, "-c", imports + COUNT, str(seed)]
        done = subprocess.run(words, env=environment, stdout=subprocess.PIPE, text=True, check=True, cwd=ROOT)
        kept.write_text(done.stdout, encoding="utf-8")
    return dict(json.loads(kept.read_text(encoding="utf-8")))


def main() -> int:
    """Count what is missing, and write the table."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--old", type=Path, default=OLD, help="source of the version before")
    options.add_argument("--banks", type=int, default=10)
    options.add_argument("--keep", type=Path, default=ROOT / "build" / "calls")
    options.add_argument("--result", type=Path, default=RESULT)
    given = options.parse_args()
    given.keep.mkdir(parents=True, exist_ok=True)
    sources = {"before": (given.old.resolve(), BEFORE), "now": (ROOT / "src", NOW)}
    found: dict[str, list[dict[str, list[object]]]] = {which: [] for which in sources}
    for seed in range(given.banks):
        for which, (source, imports) in sources.items():
            found[which].append(counted(source, imports, seed, given.keep / f"{which}-{seed}.json"))
        sys.stderr.write(f"bank {seed + 1} of {given.banks}\n")
    return write(found, given.result)


def write(found: dict[str, list[dict[str, list[object]]]], result: Path) -> int:
    """Write and print the calls by kind and by controller, as conditions of all frames; returns the exit code."""
    names = [name for name in found["now"][0] if name in found["before"][0]]
    calls = {
        name: {
            which: round(mean(float(str(bank[name][0])) for bank in banks) / FRAMES, 3)
            for which, banks in found.items()
        }
        for name in names
    }
    kinds = dict(KINDS) | {"all others": tuple(name for name in names if name not in {*BLIND, *READERS, *LAYOUT})}
    table = {}
    for kind, mine in kinds.items():
        before, now = (mean(calls[name][which] for name in mine) for which in ("before", "now"))
        most = max(calls[name]["now"] / calls[name]["before"] for name in mine)
        table[kind] = {
            "controllers": len(mine),
            "before": round(before, 3),
            "now": round(now, 3),
            "times": round(now / before, 3),
            "most": round(most, 3),
        }
    made = {
        "version": __version__,
        "date": dt.datetime.now(dt.UTC).date().isoformat(),
        "banks": len(found["now"]),
        "frames": FRAMES,
        "calls are": "conditions of all frames, the mean over banks",
        "kinds": table,
        "controllers": calls,
    }
    result.write_text(json.dumps(made, indent=1) + "\n", encoding="utf-8")
    for kind, one in table.items():
        print(f"{kind:24} {one['before']:.3f} before {one['now']:.3f} now, {one['times']} times, at most {one['most']}")
    return int(table["blind"]["most"] > MOST)


if __name__ == "__main__":
    sys.exit(main())
