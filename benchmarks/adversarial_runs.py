"""Adversaries through the real run: fresh banks, every adversary asked in stages, and which untrue claims they got.

    make long-adversaries
    python benchmarks/adversarial_runs.py --banks highway=10,rover=5,drone=5

Every run is kept on disk, so an interrupted measurement goes on. Writes ``benchmarks/results/adversaries.json``; exit 1
where a claim is untrue more often than is promised, or a reader of distance is told so too seldom.
"""

import argparse
import datetime as dt
import json
import os
import subprocess
import sys
from collections import Counter, defaultdict
from pathlib import Path

import adversary_door
import eyechart
from eyechart.calibrate.tally import AGAINST, RIGHT
from eyechart.models.scripted import CONTROLLERS

ROOT = Path(__file__).parents[1]
RESULT = ROOT / "benchmarks" / "results" / "adversaries.json"
EYECHART = Path(sys.executable).with_name("eyechart")
FIRST_SEED = 7000
"""Banks of other seeds than any that a rule was chosen on."""

NOT_FORWARD = frozenset({"stops_at_flipped", "second_nearest", "rearmost", "own_lane", "brightness", "blue_share"})
"""What makes no sense of a picture seen forward, or was written for the pixels of the other."""


def say(*words: str, seed: int = 0, bank: Path | None = None) -> str:
    """Run a command of eyechart; returns what it printed."""
    env = {**os.environ, "PYTHONPATH": str(Path(__file__).parent), "EYECHART_ADVERSARY_SEED": str(seed)}
    if bank is not None:
        env["EYECHART_ADVERSARY_BANK"] = str(bank)
    done = subprocess.run([EYECHART, *words], env=env, check=False, capture_output=True, text=True)
    if done.returncode != 0:
        raise SystemExit(f"eyechart {' '.join(words[:4])} … exits {done.returncode}: {done.stderr[-2000:]}")
    return done.stdout


def verdicts_on(simulator: str, number: int, folder: Path, steps: int) -> dict[str, dict[str, object]]:
    """Return the verdicts of every adversary and known controller on one fresh bank."""
    seed = FIRST_SEED + 10 * number
    bank, run = folder / f"{simulator}-{number}", folder / f"run-{simulator}-{number}"
    kept = folder / f"verdicts-{simulator}-{number}.json"
    if not kept.is_file():
        if not bank.exists():
            seeds = f"{seed},{seed + 1},{seed + 2}"
            say("frames", "build", simulator, "--seeds", seeds, "--steps", str(steps), "--out", str(bank))
        named = [name for name in adversary_door.NAMES if simulator == "highway" or name not in NOT_FORWARD]
        specs = [f"python:adversary_door:{name}" for name in named] + [f"scripted:{name}" for name in CONTROLLERS]
        models = [word for spec in specs for word in ("--model", spec)]
        say("run", "battery", "--frames", str(bank), "--out", str(run), *models, "--no-probe", seed=seed, bank=bank)
        kept.write_text(say("verdict", str(run), "--json", bank=bank), encoding="utf-8")
    return dict(json.loads(kept.read_text())["models"])


def main() -> int:
    """Run what is not run yet, count, and write the result."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--banks", default="highway=10,rover=5,drone=5", help="how many fresh banks of each simulator")
    options.add_argument("--steps", type=int, default=12, help="frames an episode")
    options.add_argument("--out", type=Path, default=ROOT / "build" / "adversaries", help="folder of banks and runs")
    options.add_argument("--result", type=Path, default=RESULT, help="file of the result")
    given = options.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    called: dict[str, dict[str, Counter[str]]] = defaultdict(lambda: defaultdict(Counter))
    for asked in given.banks.split(","):
        simulator, _, count = asked.partition("=")
        for number in range(int(count)):
            for spec, one in verdicts_on(simulator, number, given.out.resolve(), given.steps).items():
                called[simulator][spec][f"{one['calibrated']}/{one['lateral']}"] += 1
            print(f"{simulator} {number + 1} of {count}", file=sys.stderr)
    return write(called, given.result)


def write(called: dict[str, dict[str, Counter[str]]], result: Path) -> int:
    """Write and print what was called untruly, by simulator; returns the exit code."""
    found: dict[str, object] = {
        "eyechart": eyechart.__version__,
        "date": dt.datetime.now(dt.UTC).date().isoformat(),
        "commit": subprocess.run(
            ["git", "rev-parse", "HEAD"], check=True, capture_output=True, text=True, cwd=ROOT
        ).stdout.strip(),
    }
    misses = []
    for simulator, by in called.items():
        adversaries = {spec.rpartition(":")[2]: counts for spec, counts in by.items() if spec.startswith("python:")}
        untrue: dict[str, dict[str, str]] = {}
        for claim, wanted in AGAINST.items():
            wronged = {n: c for n, c in adversaries.items() if adversary_door.adversary(n).may_be_wronged(claim)}
            each = {
                name: sum(
                    n
                    for label, n in counts.items()
                    if claim in adversary_door.adversary(name).is_false(*label.split("/"))
                )
                for name, counts in wronged.items()
            }
            total, runs = sum(each.values()), sum(sum(counts.values()) for counts in wronged.values())
            untrue[claim] = {
                "all": f"{total} of {runs}",
                **{n: f"{k} of {sum(wronged[n].values())}" for n, k in each.items() if k},
            }
            misses += [f"{simulator}: {name} gets {claim} {k} times" for name, k in each.items() if k > 1]
            if total > max(1, wanted * runs):
                misses.append(f"{simulator}: {claim} untrue {total} of {runs}, wanted {wanted}")
        readers = {n: c for n, c in adversaries.items() if adversary_door.adversary(n).follows}
        right = sum(
            k for c in readers.values() for label, k in c.items() if label.split("/")[0] in {"depth", "depth_lateral"}
        )
        runs = sum(sum(counts.values()) for counts in readers.values())
        if runs and right / runs < RIGHT:
            misses.append(f"{simulator}: readers of distance told so {right} of {runs}, wanted {RIGHT}")
        known = {spec.rpartition(":")[2]: counts for spec, counts in by.items() if spec.startswith("scripted:")}
        hits = sum(
            k
            for n, c in known.items()
            for label, k in c.items()
            if label.split("/")[0] == CONTROLLERS[n].declared.calibrated
        )
        tried = sum(sum(counts.values()) for counts in known.values())
        if tried and hits / tried < RIGHT:
            misses.append(f"{simulator}: known answers right {hits} of {tried}, wanted {RIGHT}")
        found[simulator] = {
            "adversaries": len(adversaries),
            "untrue": untrue,
            "readers of distance": f"{right} of {runs}",
            "known answers": f"{hits} of {tried}",
            "called": {name: dict(counts) for name, counts in (*adversaries.items(), *known.items())},
        }
    found["misses"] = misses
    result.parent.mkdir(exist_ok=True)
    result.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    print("\n".join(misses) or "no claim is untrue more often than is promised")
    return int(bool(misses))


if __name__ == "__main__":
    sys.exit(main())
