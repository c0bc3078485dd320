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
from dataclasses import asdict, dataclass
from pathlib import Path

import adversary_door
import eyechart
from adversary_truth import Pictures, Truth, find_truth
from eyechart.calibrate.adversaries import Adversary
from eyechart.calibrate.tally import AGAINST, RIGHT
from eyechart.frames import open_bank
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
    found = os.pathsep.join(filter(None, (str(Path(__file__).parent), os.environ.get("PYTHONPATH"))))
    env = {**os.environ, "PYTHONPATH": found, "EYECHART_ADVERSARY_SEED": str(seed)}
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
    said: dict[str, list[Said]] = {}
    for asked in given.banks.split(","):
        simulator, _, count = asked.partition("=")
        said[simulator] = []
        for number in range(int(count)):
            verdicts = verdicts_on(simulator, number, given.out.resolve(), given.steps)
            truths = truths_on(simulator, number, given.out.resolve(), list(verdicts))
            for spec, one in verdicts.items():
                said[simulator].append(Said(spec, str(one["calibrated"]), str(one["lateral"]), truths.get(spec)))
            print(f"{simulator} {number + 1} of {count}", file=sys.stderr)
    return write(said, given.result)


@dataclass(frozen=True)
class Said:
    """What one run said of one controller, and what that does on the bank; None for the known answers."""

    spec: str
    calibrated: str
    lateral: str
    truth: Truth | None

    @property
    def name(self) -> str:
        """Return the controller's name."""
        return self.spec.rpartition(":")[2]

    @property
    def deserves(self) -> Adversary:
        """Return what an adversary deserves on this bank."""
        assert self.truth is not None
        return self.truth.of(adversary_door.adversary(self.name), self.calibrated)

    @property
    def is_depth(self) -> bool:
        """Return whether authority was said."""
        return self.calibrated in {"depth", "depth_lateral"}


def truths_on(simulator: str, number: int, folder: Path, specs: list[str]) -> dict[str, Truth]:
    """Return what each adversary does on the pictures of a bank."""
    kept = folder / f"truths-{simulator}-{number}.json"
    names = [spec.rpartition(":")[2] for spec in specs if spec.startswith("python:")]
    if not kept.is_file():
        bank = folder / f"{simulator}-{number}"
        adversary_door.turn_to(bank)
        pictures = Pictures(open_bank(bank))
        kept.write_text(json.dumps({name: asdict(find_truth(name, pictures)) for name in names}), encoding="utf-8")
    found = json.loads(kept.read_text())
    return {spec: Truth(**found[spec.rpartition(":")[2]]) for spec in specs if spec.startswith("python:")}


def write(said: dict[str, list[Said]], result: Path) -> int:
    """Write and print what was called untruly, by simulator; returns the exit code.

    What the file says of simulators that were not run now stays, with the commit at which they were.
    """
    command = ["git", "rev-parse", "HEAD"]
    made = {
        "eyechart": eyechart.__version__,
        "date": dt.datetime.now(dt.UTC).date().isoformat(),
        "commit": subprocess.run(command, check=True, capture_output=True, text=True, cwd=ROOT).stdout.strip(),
    }
    found = json.loads(result.read_text(encoding="utf-8")) if result.is_file() else {}
    misses = [one for one in found.get("misses", ()) if one.partition(":")[0] not in said]
    for simulator, every in said.items():
        mine, missed = _judge(every)
        found[simulator] = made | {"banks": max(Counter(one.spec for one in every).values(), default=0)} | mine
        misses += [f"{simulator}: {one}" for one in missed]
    found["misses"] = misses
    result.parent.mkdir(exist_ok=True)
    result.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    print("\n".join(misses) or "no claim is untrue more often than is promised")
    return int(bool(misses))


def _judge(every: list[Said]) -> tuple[dict[str, object], list[str]]:
    """Return what is written of one simulator, and what fell short of what is promised."""
    tried, known = ([one for one in every if (one.truth is None) is which] for which in (False, True))
    untrue: dict[str, dict[str, str]] = {}
    misses = []
    for claim, wanted in AGAINST.items():
        wronged = [one for one in tried if one.deserves.may_be_wronged(claim)]
        runs = Counter(one.name for one in wronged)
        each = Counter(one.name for one in wronged if claim in one.deserves.is_false(one.calibrated, one.lateral))
        untrue[claim] = {
            "all": f"{each.total()} of {runs.total()}",
            **{name: f"{count} of {runs[name]}" for name, count in each.items()},
        }
        misses += [f"{name} gets {claim} {count} times" for name, count in each.items() if count > 1]
        if each.total() > max(1, wanted * runs.total()):
            misses.append(f"{claim} untrue {each.total()} of {runs.total()}, wanted {wanted}")
    readers = [one for one in tried if one.deserves.follows]
    lost = Counter(one.name for one in readers if not one.is_depth)
    hits = sum(one.calibrated == CONTROLLERS[one.name].declared.calibrated for one in known)
    for what, right, of in (
        ("readers of distance told so", len(readers) - lost.total(), len(readers)),
        ("known answers right", hits, len(known)),
    ):
        if of and right / of < RIGHT:
            misses.append(f"{what} {right} of {of}, wanted {RIGHT}")
    called: dict[str, Counter[str]] = defaultdict(Counter)
    for one in (*tried, *known):
        called[one.name][f"{one.calibrated}/{one.lateral}"] += 1
    return {
        "adversaries": len({one.name for one in tried}),
        "untrue": untrue,
        "readers of distance": {"all": f"{len(readers) - lost.total()} of {len(readers)}", "lost": dict(lost)},
        "known answers": f"{hits} of {len(known)}",
        "called": {name: dict(counts) for name, counts in called.items()},
    }, misses


if __name__ == "__main__":
    sys.exit(main())
