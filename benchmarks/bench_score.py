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
from collections.abc import Iterable, Iterator
from contextlib import closing
from itertools import count, islice
from pathlib import Path

from eyechart.calls import CallKey, Reply
from eyechart.conditions import BATTERY
from eyechart.frames import LEAD_GAP, MAIN, BankManifest, BankWriter, Frame, alone, encode, open_bank
from eyechart.ledger import Ledger
from eyechart.ledger.counter import WrittenCounts, counting
from eyechart.ledger.rows import REPLY, checksum, now, row_of
from eyechart.manifest import LEDGER, RunManifest, today, versions, write_run
from eyechart.prompts import find_prompt
from eyechart.run import Plan
from eyechart.spaces.discrete import DRIVING
from eyechart.studies.battery import plan_of, score
from eyechart.verdicts import judge
from pairs import keep

AT_ONCE = 5_000
"""Calls given to the database at once."""
SEEING = frozenset({"real", "real_repeat", "mirrored", "recoloured"})
"""The conditions under which the answers follow the lead's distance."""
_FIELDS = ", ".join((*REPLY, "row_sha256"))
INTO = (
    "INSERT INTO calls (id, study, model, prompt, frame, condition, repeat) VALUES (?, {study}, ?, {prompt}, ?, ?, 0)",
    "INSERT INTO attempts (id, call, number, reason, request_sha256, sent_at) VALUES (?1, ?1, 1, NULL, ?2, ?3)",
    f"INSERT INTO replies (attempt, call, final, closed_at, {_FIELDS}) VALUES (?1, ?1, 1, ?2, ?3, {{others}}, ?4)",  # noqa: S608 - of this text
)
"""What puts the rows of calls, where ``others`` are all that replies have beside their text."""


def make_run(out: Path, *, models: int, episodes: int, steps: int) -> int:
    """Write a bank and a finished ledger of depth-graded, noisy answers; return the number of calls."""
    rng = random.Random(0)  # noqa: S311
    write_bank(out / "source", rng, episodes=episodes, steps=steps)
    return answer_all(out, models=models, rng=rng)


def write_bank(root: Path, rng: random.Random, *, episodes: int, steps: int) -> None:
    """Write a bank of one small picture, with drawn gaps to the lead."""
    import numpy as np  # noqa: PLC0415 - after the clock of a caller that measures imports

    pixels = np.zeros((2, 2, 3), dtype=np.uint8)
    pixels[0, 0] = 255  # as one of a camera, it differs from its mirror image
    picture = encode(pixels)
    manifest = BankManifest("synthetic", "bench", "no pictures at all", DRIVING, LEAD_GAP)
    with BankWriter(root, manifest) as writer:
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


def digests(plan: Plan) -> Iterator[str]:
    """Yield the digest of what is asked about each frame under each condition, the same of every model."""
    shown = plan.stimuli()
    for frame, condition in cells(plan):
        key = CallKey(plan.study, plan.models[0], plan.prompt.key, frame.id, condition)
        yield plan.query(key, shown.show(condition, frame.id)).sha256()


def cells(plan: Plan) -> Iterator[tuple[Frame, str]]:
    """Yield each frame with each condition that it can be shown under, in the bank's order."""
    return ((frame, name) for frame in plan.frames for name in plan.conditions if plan.shows(name, frame))


def fill(path: Path, plan: Plan, rng: random.Random, asked: Iterable[str] | None = None) -> int:
    """Write every call, its attempt and its reply as a run does, but for the order; return how many.

    ``asked`` are the `digests` of what is asked, where they are known. Nothing is flushed to the disk, and a script
    that is killed leaves no ledger of use.
    """
    numbers, actions = count(1), plan.bank.manifest.action_space.actions
    replies = {text: Reply(text, "stop", prompt_tokens=90, completion_tokens=2, seconds=0.1) for text in actions}
    fields = {text: row_of(reply, final=True)[2:] for text, reply in replies.items()}
    study, prompt = plan.study, plan.prompt.key

    def rows() -> Iterator[tuple[tuple[object, ...], ...]]:
        """Yield the varying values of each call's rows: of the call, the attempt and the reply."""
        for (frame, condition), digest in zip(cells(plan), digests(plan) if asked is None else asked, strict=True):
            seen, sent = condition in SEEING, now()
            answer = "SLOW" if float(frame.truth["lead_gap_m"] or 0) < 30 or not seen else "STRAIGHT"
            for model, at in zip(plan.models, numbers):  # noqa: B905 - numbers never end
                text = rng.choice(actions) if seen and rng.random() < 0.2 else answer
                written = checksum(
                    (study, model, prompt, frame.id, condition, 0, None, digest, sent, 1, sent, *fields[text])
                )
                yield (at, model, frame.id, condition), (at, digest, sent), (at, sent, text, written)

    made, written = rows(), 0
    Ledger(path, create=True).__exit__(None, None, None)
    with closing(sqlite3.connect(path, isolation_level=None)) as sql:
        for how in ("journal_mode = OFF", "synchronous = OFF", "locking_mode = EXCLUSIVE", "cache_size = -500000"):
            sql.execute(f"PRAGMA {how}")

        def quoted(*values: object) -> str:
            """Return values as they stand in a statement; to bind them anew for each row takes most of the time."""
            return ", ".join(sql.execute("SELECT quote(?)", (value,)).fetchone()[0] for value in values)

        same = {"study": quoted(study), "prompt": quoted(prompt), "others": quoted(*fields[actions[0]][1:])}
        into = [one.format(**same) for one in INTO]
        sql.execute("BEGIN")
        while several := [*islice(made, AT_ONCE)]:
            for statement, many in zip(into, zip(*several, strict=True), strict=True):
                sql.executemany(statement, many)
            written += len(several)
        sql.execute("COMMIT")
        sql.execute("PRAGMA journal_mode = WAL")  # as a run has it
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
