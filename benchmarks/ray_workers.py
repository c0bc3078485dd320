"""A battery of at least ten minutes of processor time in one process, and over two workers of Ray on this machine.

    make long-ray

The controller is a callable that works for a third of a second a call and answers by the picture. Counted is the
processor time of every process: the command, its workers, and Ray's servers. An arm that was cut goes on where it was,
and what it had used is kept. Writes ``benchmarks/results/ray.json``; exit 1 where Ray takes more than 1.15 times as
much, the rows or the verdicts differ, the work was shorter than ten minutes, or a process is left after ten seconds.
"""

import argparse
import datetime as dt
import json
import os
import sqlite3
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

from eyechart import __version__
from eyechart.simulators import open_bank_simulator

ROOT = Path(__file__).parents[1]
RESULT = ROOT / "benchmarks" / "results" / "ray.json"
WORK = ROOT / "build" / "ray_workers"
ARMS = {"one process": (), "two workers": ("--engine", "ray", "--workers", "2")}
SPEC = "python:hard_work:works"
MOST, LEAST_S, SOON_S = 1.15, 600.0, 10.0
MARK = "EYECHART_RAY_BENCHMARK"
"""The variable by which the processes of a measurement are known."""


def processes(mark: str) -> dict[tuple[str, str], float]:
    """Return the processor seconds of each process with this mark, by its number and the time of its start."""
    tick, found = os.sysconf("SC_CLK_TCK"), {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if f"{MARK}={mark}".encode() in (folder / "environ").read_bytes().split(b"\0"):
                _, _, after = (folder / "stat").read_text().rpartition(")")
                values = after.split()
                if values[0] != "Z":
                    found[folder.name, values[19]] = (int(values[11]) + int(values[12])) / tick
        except OSError:  # it has ended
            continue
    return found


@contextmanager
def cluster(env: dict[str, str]) -> Iterator[None]:
    """Have a cluster of one node with two processors, whose processes have this environment."""
    from ray.cluster_utils import Cluster  # noqa: PLC0415 - an extra

    before = dict(os.environ)
    os.environ.update(env)
    made = Cluster(initialize_head=True, head_node_args={"num_cpus": 2, "include_dashboard": False})
    try:
        made.wait_for_nodes()
        env["RAY_ADDRESS"] = made.address
        yield
    finally:
        made.shutdown()
        os.environ.clear()
        os.environ.update(before)


def made(arm: str) -> dict[str, float]:
    """Make the run of an arm, or go on with it; return the seconds so far, of the processor and of the wall."""
    out, kept = WORK / arm.replace(" ", "_"), WORK / f"{arm.replace(' ', '_')}.json"
    before = json.loads(kept.read_text()) if kept.exists() else {"processor_s": 0.0, "wall_s": 0.0, "left": 0}
    if before.get("whole"):
        return before
    mark = f"{os.getpid()}-{arm.replace(' ', '-')}"
    path = (str(Path(__file__).parent), os.environ.get("PYTHONPATH", ""))
    env = {**os.environ, MARK: mark, "PYTHONPATH": os.pathsep.join(filter(None, path)), "PYTHONDONTWRITEBYTECODE": ""}
    env |= {"RAY_USAGE_STATS_ENABLED": "0", "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0", "RAY_worker_niceness": "0"}
    words = ["run", "battery", "--model", SPEC, "--frames", str(WORK / "bank"), "--out", str(out), *ARMS[arm]]
    seen, began, now = dict[tuple[str, str], float](), time.monotonic(), dict(before)

    def count(*, whole: bool) -> None:
        seen.update(processes(mark))
        now["processor_s"] = round(before["processor_s"] + sum(seen.values()), 2)
        now["wall_s"] = round(before["wall_s"] + time.monotonic() - began, 1)
        kept.write_text(json.dumps({**now, "whole": whole}))

    def wait(run: subprocess.Popen[bytes]) -> None:
        while run.poll() is None:
            count(whole=False)
            time.sleep(0.5)
        if run.returncode:
            raise SystemExit(f"the run of {arm} exits {run.returncode}")

    def command() -> subprocess.Popen[bytes]:
        return subprocess.Popen([sys.executable, "-m", "eyechart", *words], env=env, stdout=subprocess.DEVNULL)

    if arm == "one process":
        wait(command())
    else:
        with cluster(env):
            wait(command())
            count(whole=False)
    end = time.monotonic() + SOON_S
    while (left := processes(mark)) and time.monotonic() < end:
        time.sleep(0.2)
    now["left"] = len(left)
    count(whole=True)
    return now


def rows(arm: str) -> list[tuple[object, ...]]:
    """Return what a ledger holds of each call, but for order and times."""
    with closing(sqlite3.connect(WORK / arm.replace(" ", "_") / "ledger.sqlite")) as sql:
        asked = "SELECT frame, condition, repeat, request_sha256, text, error FROM calls "
        joined = "JOIN attempts ON attempts.call = calls.id JOIN replies ON replies.attempt = attempts.id"
        return sorted(sql.execute(asked + joined))


def verdict(arm: str) -> object:
    """Return the verdict of an arm's run as JSON values."""
    words = [sys.executable, "-m", "eyechart", "verdict", str(WORK / arm.replace(" ", "_")), "--json"]
    return json.loads(subprocess.run(words, capture_output=True, check=True).stdout)


def main() -> int:
    """Make both arms, or one of them; write the result when both are made."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--arm", choices=ARMS, action="append", help="make this arm alone; the other is made already")
    given = parser.parse_args()
    WORK.mkdir(parents=True, exist_ok=True)
    if not (WORK / "bank").exists():
        open_bank_simulator("highway").build(WORK / "bank", seeds=range(3))
    for arm in given.arm or ARMS:
        print(f"{arm}: {made(arm)}", flush=True)
    kept = {arm: WORK / f"{arm.replace(' ', '_')}.json" for arm in ARMS}
    if not all(file.exists() and json.loads(file.read_text()).get("whole") for file in kept.values()):
        return 0
    took = {arm: json.loads(file.read_text()) for arm, file in kept.items()}
    one, two = (took[arm]["processor_s"] for arm in ARMS)
    mine, theirs = map(rows, ARMS)
    missed = {
        "processor time": two > MOST * one,
        "ten minutes": one < LEAST_S,
        "rows": mine != theirs,
        "verdict": verdict("one process") != verdict("two workers"),
        "processes left": any(arm["left"] for arm in took.values()),
    }
    found = {
        "version": __version__,
        "date": dt.datetime.now(dt.UTC).date().isoformat(),
        "calls": len(mine),
        "arms": took,
        "ratio": round(two / one, 3),
        "bound": MOST,
        "missed": [name for name, is_missed in missed.items() if is_missed],
        "load at the end": [round(load, 1) for load in os.getloadavg()],
    }
    RESULT.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(found, indent=1))
    return int(any(missed.values()))


if __name__ == "__main__":
    sys.exit(main())
