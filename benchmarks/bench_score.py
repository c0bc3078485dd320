"""What scoring costs: 5 models × 1152 calls with every statistic, and a ledger of a million calls with its peak memory.

Reported, not gated: there is nothing to compare it with but the clock. Writes ``results/bench_score.json``.
"""

import argparse
import json
import random
import resource
import tempfile
import time
from itertools import islice
from pathlib import Path

from eyechart.calls import CallKey, Reply
from eyechart.conditions import BATTERY
from eyechart.frames import LEAD_GAP, MAIN, BankManifest, BankWriter, Frame, alone, encode, open_bank
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER, RunManifest, today, versions, write_run
from eyechart.prompts import find_prompt
from eyechart.run import Plan
from eyechart.spaces.discrete import DRIVING
from eyechart.studies.battery import plan_of, score
from eyechart.verdicts import judge
from pairs import keep

AT_ONCE = 5_000
"""Calls written in one transaction."""


def make_run(out: Path, *, models: int, episodes: int, steps: int) -> int:
    """Write a bank and a finished ledger of depth-graded, noisy answers; return the number of calls."""
    import numpy as np  # noqa: PLC0415 - after the clock of a caller that measures imports

    rng = random.Random(0)  # noqa: S311
    picture = encode(np.zeros((2, 2, 3), dtype=np.uint8))
    manifest = BankManifest("synthetic", "bench", "no pictures at all", DRIVING, LEAD_GAP)
    gaps = {}
    with BankWriter(out / "source", manifest) as writer:
        for episode in range(episodes):
            for step in range(steps):
                frame_id = f"e{episode}-{step}"
                gaps[frame_id] = rng.uniform(5, 70)
                frame = Frame(
                    id=frame_id,
                    scenario=f"s{episode % 4}",
                    episode=f"e{episode}",
                    step=step,
                    cameras=alone("vertical"),
                    pictures={MAIN: f"images/{frame_id}.png"},
                    truth={"lead_gap_m": gaps[frame_id]},
                )
                writer.add(frame, {MAIN: picture}, {})
    bank = open_bank(out / "source")
    specs = [f"bench:{number}" for number in range(models)]
    prompt = find_prompt("baseline")
    run = RunManifest(
        study="battery",
        created=today(),
        seed=0,
        prompt=prompt,
        models=dict.fromkeys(specs, "0"),
        conditions=BATTERY,
        limit=None,
        shard=None,
        bank_path=str(bank.root),
        fingerprint=bank.manifest.fingerprint,
        versions=versions(),
    )
    (out / "run").mkdir()
    write_run(out / "run", run, bank)
    return fill(out / "run" / LEDGER, plan_of(run, bank), gaps, rng)


def fill(path: Path, plan: Plan, gaps: dict[str, float], rng: random.Random) -> int:
    """Write every call, its attempt and its reply as a run does, many in one transaction; return how many."""

    def answer(gap: float) -> str:
        return rng.choice(DRIVING.actions) if rng.random() < 0.2 else "SLOW" if gap < 30 else "STRAIGHT"

    shown = plan.stimuli()
    keys = (
        CallKey("battery", spec, plan.prompt.key, frame, condition)
        for frame in gaps
        for condition in BATTERY
        for spec in plan.models
    )
    written = 0
    with Ledger(path, create=True) as ledger:
        while several := [*islice(keys, AT_ONCE)]:
            with ledger.together():
                for key in several:
                    seen = key.condition in {"real", "real_repeat", "mirrored"}
                    text = answer(gaps[key.frame]) if seen else "SLOW"
                    reply = Reply(text, "stop", prompt_tokens=90, completion_tokens=2, seconds=0.1)
                    query = plan.query(key, shown.show(key.condition, key.frame))
                    ledger.close(ledger.begin(key, query.sha256()), reply)
            written += len(several)
    return written


def measure(*, models: int, episodes: int, steps: int) -> dict[str, float]:
    """Score one synthetic run; return calls, CPU seconds and the process's peak memory in MB so far."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        calls = make_run(out, models=models, episodes=episodes, steps=steps)
        size = (out / "run" / LEDGER).stat().st_size / 1e6
        start = time.process_time()
        judge(score(out / "run"))
        seconds = time.process_time() - start
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {"calls": calls, "ledger_mb": size, "score_cpu_s": seconds, "peak_rss_mb": peak}


def main() -> None:
    """Measure both sizes and print them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--small", action="store_true", help="leave out the million calls")
    options = parser.parse_args()
    found = {"5 models x 1152 calls": measure(models=5, episodes=12, steps=12)}
    if not options.small:
        found["one model, 1 000 000 calls"] = measure(models=1, episodes=5208, steps=24)
    keep("bench_score", found)
    if options.json:
        print(json.dumps(found, indent=1))
        return
    for name, numbers in found.items():
        print(f"{name}: " + ", ".join(f"{key} {value:,.1f}" for key, value in numbers.items()))


if __name__ == "__main__":
    main()
