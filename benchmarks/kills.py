"""Two hundred kills over the commands that write or begin processes: nothing is lost, and nothing is left.

    python benchmarks/kills.py [--kills 200]

Each kill begins a command, or goes on with one that was killed before, and ends it at a random moment with SIGKILL,
SIGTERM or SIGINT, as an out-of-memory killer, a time-out and a person do. Ten seconds later no process of it may run;
then, at the end of a command's kills, it runs to its end: what it made is held against one that was never killed, and
the temporary folder has to be empty. Each row is kept in benchmarks/results/kills.json as it is made, and a campaign
that is cut goes on where it was.
"""

import argparse
import datetime as dt
import hashlib
import json
import os
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from eyechart import __version__ as eyechart_version

RESULTS = Path(__file__).parent / "results" / "kills.json"
WORK = Path("build/kills")
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
GRACE_S = 10.0
ENDED = {0, 1, 2, 129, 130, 143, -signal.SIGKILL, -signal.SIGTERM, -signal.SIGINT}
MODEL = "python:kills_model:answer"
ANSWERS = """
import time
def answer(prompt, image):
    time.sleep(0.02)
    return "SLOW" if len(image or b"") % 3 else "STRAIGHT"
"""


@dataclass(frozen=True)
class Command:
    """A command: its words, what it makes, how that is told from another, and within how long it is killed.

    What is made ``at_once`` is there whole or not at all, and the command does not go on with it.
    """

    words: tuple[str, ...]
    makes: str
    seen: Callable[[Path], object]
    within_s: float = 4.0
    at_once: bool = False


def replies(run: Path) -> object:
    """Return what a ledger says of each finished call; raises where one call is finished twice."""
    with closing(sqlite3.connect(run / "ledger.sqlite")) as sql:
        rows = sql.execute(
            "SELECT model, frame, condition, repeat, text FROM calls c JOIN replies r ON r.call = c.id WHERE final = 1"
        ).fetchall()
    assert len({row[:4] for row in rows}) == len(rows), "a call was finished twice"
    return sorted(rows)


def same_bytes(made: Path) -> object:
    """Return the bytes of a file."""
    return made.read_bytes()


def kept_banks(file: Path) -> object:
    """Return the banks that a calibration kept, in any order."""
    return sorted(file.read_bytes().splitlines())


def episodes(run: Path) -> object:
    """Return the episodes of a run, in any order."""
    return sorted((run / "episodes.jsonl").read_text(encoding="utf-8").splitlines())


BANK = ("--frames", "bank", "--limit", "24", "--conditions", "real,blank,text_only")
COMMANDS = {
    "run": Command(("run", "battery", "--model", MODEL, *BANK, "--out", "OUT"), "OUT", replies),
    "watch": Command(("run", "battery", "--model", MODEL, *BANK, "--watch", "--out", "OUT"), "OUT", replies),
    "merge": Command(("merge", "shard-1", "shard-2", "--out", "OUT"), "OUT", replies, at_once=True),
    "import": Command(("run", "import", "answers.jsonl", "--model", "mine", *BANK, "--out", "OUT"), "OUT", replies),
    "bundle": Command(("bundle", "whole", "--out", "OUT.zip"), "OUT.zip", same_bytes, 8.0, at_once=True),
    "calibrate": Command(
        ("calibrate", "--processes", "2", "--setting", "default", "--replications", "4", "--keep", "OUT.jsonl"),
        "OUT.jsonl",
        kept_banks,
        12.0,
    ),
    "ladder": Command(
        ("ladder", "--simulator", "rover", "--seeds", "1", "--processes", "2", "--out", "OUT"), "OUT", episodes, 12.0
    ),
}


def eyechart(*words: str, out: Path) -> "subprocess.Popen[bytes]":
    """Begin a command in a session of its own."""
    own = {"TMPDIR": str(WORK.resolve() / "tmp"), "PYTHONPATH": os.pathsep.join([*sys.path, str(WORK.resolve())])}
    command = [sys.executable, "-m", "eyechart", *(word.replace("OUT", str(out)) for word in words)]
    with (WORK / "log").open("ab") as log:
        return subprocess.Popen(
            command, cwd=WORK, stdout=log, stderr=log, env={**os.environ, **own}, start_new_session=True
        )


def running(session: int) -> list[int]:
    """Return the processes of a session, and those that name the working folder: a group of its own hides none."""
    result = []
    for path in Path("/proc").glob("[0-9]*"):
        try:
            of = os.getsid(int(path.name))
            ended = (path / "stat").read_text().rpartition(")")[2].split()[0] == "Z"
        except OSError:
            continue
        if of == session and not ended:
            result.append(int(path.name))
    return result


def kill(command: Command, out: Path, number: int) -> dict[str, object]:
    """Begin a command, end it at a random moment, and return what was left of it after the grace."""
    dice = random.Random(number)  # noqa: S311 - moments, no secret
    begun, one = eyechart(*command.words, out=out), dice.choice(SIGNALS)
    try:
        begun.wait(after := dice.uniform(0.2, command.within_s))
    except subprocess.TimeoutExpired:
        begun.send_signal(one)
    processes, end = len(running(begun.pid)), time.monotonic() + GRACE_S
    while running(begun.pid) and time.monotonic() < end:
        begun.poll()
        time.sleep(0.05)
    left = running(begun.pid)
    for each in left:
        os.kill(each, signal.SIGKILL)
    code, made = begun.wait(), WORK / command.makes.replace("OUT", str(out))
    row = {"signal": one.name, "after_s": round(after, 2), "processes": processes, "exit": code, "left": len(left)}
    if command.at_once and made.exists():
        row["made"] = digest(command, made)
    if code == 0 or "made" in row:  # it came to its end before: the next one begins anew
        shutil.rmtree(made) if made.is_dir() else made.unlink(missing_ok=True)
    return {**row, "ended_before": code in {0, 1} and processes == 0}


def digest(command: Command, made: Path) -> str:
    """Return what tells what a command made from another."""
    return hashlib.sha256(json.dumps(command.seen(made), default=str).encode()).hexdigest()


def prepare() -> None:
    """Make the bank, the shards and the answers that the commands need, each whole."""
    (WORK / "tmp").mkdir(parents=True, exist_ok=True)
    (WORK / "kills_model.py").write_text(ANSWERS, encoding="utf-8")
    shards = [("run", "battery", "--model", MODEL, *BANK, "--shard", f"{n}/2", "--out", f"shard-{n}") for n in (1, 2)]
    whole = ("run", "battery", "--model", MODEL, *BANK, "--out", "whole")
    for words, made in (
        (("frames", "build", "highway", "--out", "bank"), "bank"),
        *((shard, shard[-1]) for shard in shards),
        (whole, "whole"),
        (("frames", "export", "bank", *BANK[2:], "--out", "asked"), "asked"),
    ):
        if not (WORK / made).exists():
            assert eyechart(*words, out=WORK).wait() == 0, f"{' '.join(words)}: see {WORK / 'log'}"
    with (WORK / "asked" / "asked.jsonl").open(encoding="utf-8") as asked:
        lines = [json.dumps({"call": json.loads(line)["call"], "text": "SLOW"}) for line in asked]
    (WORK / "answers.jsonl").write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")


def finished(name: str, command: Command, kept: Sequence[str]) -> dict[str, object]:
    """Run a command that was killed to its end, and hold what it made, then and before, against one that never was."""
    made = {}
    for out in (Path(f"killed-{name}"), Path(f"never-{name}")):
        code = eyechart(*command.words, out=out).wait()
        if code not in {0, 1}:
            return {"exit": code, "same": False, "temporary": -1}
        made[out] = digest(command, WORK / command.makes.replace("OUT", str(out)))
    left = sorted(path.name for path in (WORK / "tmp").iterdir() if path.name.startswith("eyechart-"))
    return {
        "exit": 0,
        "same": len({*made.values(), *kept}) == 1,
        "temporary": len(left),
    }


def write(kept: dict[str, object]) -> None:
    """Write the rows that there are, with version and date."""
    told = {**kept, "version": eyechart_version, "date": dt.datetime.now(dt.UTC).date().isoformat()}
    RESULTS.write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> None:
    """Kill, keep each row, and say what was lost or left; exit 1 where anything was."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--only", action="append", choices=list(COMMANDS))
    given = parser.parse_args(arguments)
    signal.signal(
        signal.SIGINT, signal.default_int_handler
    )  # a shell's background job ignores it, and so would all here
    prepare()
    kept = json.loads(RESULTS.read_text(encoding="utf-8")) if RESULTS.exists() else {"kills": {}, "ends": {}}
    names = given.only or list(COMMANDS)
    for number in range(given.kills):
        name = names[number % len(names)]
        if str(number) in kept["kills"]:
            continue
        row = kill(COMMANDS[name], Path(f"killed-{name}"), number)
        kept["kills"][str(number)] = {"command": name, **row}
        write(kept)
        print(number, name, row, flush=True)
    time.sleep(6)  # a copy is cleared by the next start once it is so old
    for name in names:
        whole = [one["made"] for one in kept["kills"].values() if one["command"] == name and "made" in one]
        kept["ends"][name] = finished(name, COMMANDS[name], whole)
        write(kept)
        print(name, kept["ends"][name], flush=True)
    wrong = [one for one in kept["kills"].values() if one["left"] or one["exit"] not in ENDED]
    wrong += [one for one in kept["ends"].values() if not one["same"] or one["temporary"]]
    if not wrong:
        shutil.rmtree(WORK)
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
