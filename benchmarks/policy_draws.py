"""The six trained policies again: other draws of the one that samples, other episodes, other numbers of threads.

    make long-policy-draws
    python benchmarks/policy_draws.py

Each setting is a run of its own in a process of its own, of 12 episodes and 72 frames. Those of one bank are held
against the first run to the byte, policy by policy; all of them, by their labels, against what each was trained to do.
A finished setting stays in ``--work``, so that an interrupted measurement goes on. Writes
``benchmarks/results/policy_draws.json``; exit 1 where a policy that does not draw answers otherwise about the same
frames, or has other labels there.
"""

import argparse
import datetime as dt
import json
import os
import subprocess
import sys
from dataclasses import asdict, dataclass
from pathlib import Path

import eyechart
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER
from eyechart.models.trained import TRAINED
from eyechart.simulators import open_bank_simulator
from eyechart.spaces.motion import Motion
from eyechart.studies.policy.demo import ANSWERS, SEEDS, STEPS, shown
from eyechart.studies.policy.plans import PolicySelection, plan, run
from eyechart.studies.policy.scores import judge, score

RESULT = Path(__file__).parent / "results" / "policy_draws.json"
THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class Setting:
    """A run: which 12 episodes, with how many calls at once and threads of the linear algebra, of which policies."""

    name: str
    bank: int = 0
    concurrency: int = 1
    threads: int = 1
    names: tuple[str, ...] = tuple(TRAINED)


DRAWN = tuple(name for name, one in TRAINED.items() if one.samples)
SETTINGS = (
    Setting("first"),
    *(Setting(f"drawn again, {number}", names=DRAWN) for number in range(2, 5)),
    Setting("8 calls at once", concurrency=8, names=("sees", *DRAWN)),
    Setting("2 threads of linear algebra", threads=2, names=("sees", *DRAWN)),
    *(Setting(f"other episodes, {number}", bank=number) for number in range(1, 4)),
)


def measure(setting: Setting, work: Path) -> dict[str, object]:
    """Run a setting, and return each policy's labels, those that its training deserves, its shares and its digests."""
    result: dict[str, object] = {}
    for preset in dict.fromkeys(TRAINED[name].preset for name in setting.names):
        bank, out = work / f"bank-{preset}-{setting.bank}", work / f"{setting.name}-{preset}".replace(" ", "_")
        if not bank.exists():
            seeds = range(SEEDS * setting.bank, SEEDS * (setting.bank + 1))
            open_bank_simulator("tabletop").build(bank, preset=preset, seeds=seeds, steps=STEPS)
        specs = [f"trained:{name}" for name in setting.names if TRAINED[name].preset == preset]
        run(plan(bank, specs, out, extent=PolicySelection(answers=ANSWERS)), concurrency=setting.concurrency)
        scored = score(out)
        for spec, verdict in judge(scored).items():
            one = shown(spec, verdict)
            shares = {name: [share.value, *(share.ci or ())] for name, share in verdict.channels.items()}
            with Ledger(out / LEDGER) as ledger:
                digests = {
                    f"{key.frame} {key.condition}": Motion.read(reply.text).sha256
                    for key, reply in ledger.replies(spec)
                    if key.repeat == 0
                }
            result[spec] = {
                "labels": one.found,
                "not_as_trained": one.wrong,
                "guards": list(verdict.guards),
                "shares": shares,
                "digests": digests,
            }
    return result


def apart(setting: Setting, work: Path) -> dict[str, object]:
    """Return what a process of its own measures, from disk where it is there."""
    file = work / f"{setting.name}.json".replace(" ", "_")
    if not file.is_file():
        program = [sys.executable, __file__, "--work", str(work), "--one", setting.name]
        subprocess.run(program, check=True, env=os.environ | dict.fromkeys(THREADS, str(setting.threads)))
    result: dict[str, object] = json.loads(file.read_text(encoding="utf-8"))
    return result


def row(setting: Setting, found: dict, first: dict) -> dict[str, object]:
    """Return a setting's row: what differs from the first run where the frames are the same, and from the training."""
    told = {spec: one["labels"] for spec, one in found.items()}
    known = {**asdict(setting), "not_as_trained": {s: one["not_as_trained"] for s, one in found.items()}}
    known["not_as_trained"] = {spec: wrong for spec, wrong in known["not_as_trained"].items() if wrong}
    known |= {"labels": told, "shares": {spec: one["shares"] for spec, one in found.items()}}
    if setting.bank == 0:
        known["other_labels"] = [spec for spec, labels in told.items() if labels != first[spec]["labels"]]
        known["other_answers"] = {
            spec: sum(one["digests"][key] != digest for key, digest in first[spec]["digests"].items())
            for spec, one in found.items()
        }
    return known


def main() -> int:
    """Measure every setting and write the result; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--work", type=Path, default=Path("build/policy-draws"))
    parser.add_argument("--one", help="measure this setting alone, for the process that asks")
    args = parser.parse_args()
    args.work.mkdir(parents=True, exist_ok=True)
    if args.one is not None:
        (setting,) = (one for one in SETTINGS if one.name == args.one)
        file = args.work / f"{setting.name}.json".replace(" ", "_")
        file.write_text(json.dumps(measure(setting, args.work)), encoding="utf-8")
        return 0
    found = {one.name: apart(one, args.work) for one in SETTINGS}
    rows = [row(one, found[one.name], found[SETTINGS[0].name]) for one in SETTINGS]
    for one in rows:
        print(one["name"], "labels:", one.get("other_labels", "—"), "not as trained:", one["not_as_trained"])
    about = {"eyechart": eyechart.__version__, "date": dt.datetime.now(dt.UTC).date().isoformat()}
    RESULT.write_text(json.dumps({**about, "settings": rows}, indent=1) + "\n", encoding="utf-8")
    drawn = {f"trained:{name}" for name in DRAWN}
    others = [spec for one in rows for spec, count in one.get("other_answers", {}).items() if count]
    others += [spec for one in rows for spec in one.get("other_labels", ())]
    return int(any(spec not in drawn for spec in others))


if __name__ == "__main__":
    sys.exit(main())
