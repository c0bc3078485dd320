"""What scoring costs: 5 models × 1152 calls with every statistic, and a ledger of a million calls with its peak memory.

Reported, not gated: there is nothing to compare it with but the clock. Writes ``results/bench_score.json``.
"""

import argparse
import json
import random
import resource
import sqlite3
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing
from itertools import chain, count, islice
from pathlib import Path

from eyechart.calls import CallKey, Reply
from eyechart.conditions import BATTERY
from eyechart.frames import LEAD_GAP, MAIN, BankManifest, BankWriter, Frame, alone, encode, open_bank
from eyechart.ledger import Ledger
from eyechart.ledger.counter import WrittenCounts, counting
from eyechart.ledger.rows import KEY, REPLY, checksum, now, row_of
from eyechart.manifest import LEDGER, RunManifest, today, versions, write_run
from eyechart.prompts import find_prompt
from eyechart.run import Plan
from eyechart.spaces.discrete import DRIVING
from eyechart.studies.battery import plan_of, score
from eyechart.verdicts import judge
from pairs import keep

AT_ONCE = 5_000
"""Calls written in one transaction."""
SEEING = frozenset({"real", "real_repeat", "mirrored", "recoloured"})
"""The conditions under which the answers follow the lead's distance."""
_COLUMNS = {
    f"calls (id, {KEY})": 1 + len(CallKey._fields),
    "attempts (id, call, number, reason, request_sha256, sent_at)": 6,
    f"replies (attempt, call, final, closed_at, {', '.join(REPLY)}, row_sha256)": 5 + len(REPLY),
}
INTO = tuple(f"INSERT INTO {name} VALUES ({', '.join('?' * many)})" for name, many in _COLUMNS.items())  # noqa: S608 - of this text


def make_run(out: Path, *, models: int, episodes: int, steps: int) -> int:
    """Write a bank and a finished ledger of depth-graded, noisy answers; return the number of calls."""
    import numpy as np  # noqa: PLC0415 - after the clock of a caller that measures imports

    rng = random.Random(0)  # noqa: S311
    pixels = np.zeros((2, 2, 3), dtype=np.uint8)
    pixels[0, 0] = 255  # as one of a camera, it differs from its mirror image
    picture = encode(pixels)
    manifest = BankManifest("synthetic", "bench", "no pictures at all", DRIVING, LEAD_GAP)
    with BankWriter(out / "source", manifest) as writer:
        for episode in range(episodes):
            for step in range(steps):
                frame_id = f"e{episode}-{step}"
                frame = Frame(
                    id=frame_id,
                    scenario=f"s{episode % 4}",
                    episode=f"e{episode}",
                    step=step,
                    cameras=alone("vertical"),
                    pictures={MAIN: f"images/{frame_id}.png"},
                    truth={"lead_gap_m": rng.uniform(5, 70)},
                )
                writer.add(frame, {MAIN: picture}, {})
    return answer_all(out, models=models, rng=rng)


def answer_all(out: Path, *, models: int, rng: random.Random, conditions: tuple[str, ...] = BATTERY) -> int:
    """Write a finished run of a folder's bank; return the number of calls."""
    bank = open_bank(out / "source")
    run = RunManifest(
        study="battery",
        created=today(),
        seed=0,
        prompt=find_prompt("baseline"),
        models={f"bench:{number}": "0" for number in range(models)},
        conditions=conditions,
        limit=None,
        shard=None,
        bank_path=str(bank.root),
        fingerprint=bank.manifest.fingerprint,
        versions=versions(),
    )
    (out / "run").mkdir()
    write_run(out / "run", run, bank)
    return fill(out / "run" / LEDGER, plan_of(run, bank), rng)


def fill(path: Path, plan: Plan, rng: random.Random) -> int:
    """Write every call, its attempt and its reply as a run does, many in one transaction; return how many."""
    shown, numbers = plan.stimuli(), count(1)

    def rows_of(frame: Frame) -> Iterator[tuple[tuple[object, ...], ...]]:
        """Yield the rows of each call about a frame: of the call, the attempt and the reply."""
        near = float(frame.truth["lead_gap_m"] or 0) < 30
        for condition in (name for name in plan.conditions if plan.shows(name, frame)):
            own = CallKey("battery", plan.models[0], plan.prompt.key, frame.id, condition)
            asked = plan.query(own, shown.show(condition, frame.id)).sha256()  # that of every model
            seen = condition in SEEING
            for spec in plan.models:
                key, at = own._replace(model=spec), next(numbers)
                answer = "SLOW" if near or not seen else "STRAIGHT"
                text = rng.choice(DRIVING.actions) if seen and rng.random() < 0.2 else answer
                sent = now()
                reply = row_of(Reply(text, "stop", prompt_tokens=90, completion_tokens=2, seconds=0.1), final=True)
                digest = checksum((*key, None, asked, sent, *reply))
                yield (at, *key), (at, at, 1, None, asked, sent), (at, at, *reply, digest)

    rows, written = chain.from_iterable(map(rows_of, plan.frames)), 0
    Ledger(path, create=True).__exit__(None, None, None)
    with closing(sqlite3.connect(path, isolation_level=None)) as sql:
        while several := [*islice(rows, AT_ONCE)]:
            sql.execute("BEGIN")
            for into, many in zip(INTO, zip(*several, strict=True), strict=True):
                sql.executemany(into, many)
            sql.execute("COMMIT")
            written += len(several)
    with counting(path, WrittenCounts(written, written)) as counter:
        counter.write(WrittenCounts(written, written))
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
