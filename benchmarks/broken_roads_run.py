"""A battery through every fault of the road at random, killed again and again, against the same one undisturbed.

    make long-faults
    python benchmarks/broken_roads_run.py --share 0.4 --kills 40

The server of ``tests/broken_roads.py`` answers as a controller that reads distance from the picture, and breaks a share
of the requests by one of its kinds, drawn at random. The run is a process of its own that is killed at random moments
and begun again, until nothing is left. Writes ``benchmarks/results/faults.json``; exit 1 where a finished call was lost
or changed, a call ended in a failure, server and ledger count otherwise, or the verdict differs.
"""

import argparse
import base64
import datetime as dt
import json
import os
import random
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests")]

import eyechart  # noqa: E402 - the tests lie beside
from broken_roads import ROADS, BrokenRoad  # noqa: E402
from eyechart.calls import CallKey, Query  # noqa: E402
from eyechart.frames import Stimulus  # noqa: E402
from eyechart.ledger import Ledger, SentAttempt  # noqa: E402
from eyechart.limits import Limits  # noqa: E402
from eyechart.manifest import LEDGER  # noqa: E402
from eyechart.models import open_model  # noqa: E402
from eyechart.modes import RequestMode  # noqa: E402
from eyechart.studies import battery as study  # noqa: E402
from eyechart.verdicts import judge  # noqa: E402

SPEC = "openai:m"
RESULT = ROOT / "benchmarks" / "results" / "faults.json"
_CONTROLLER = open_model("scripted:depth")


def answer(asked: Mapping[str, object]) -> str:
    """Return what the controller says to a request: it is told the words and the picture that came."""
    *system, user = asked["messages"]  # type: ignore[misc]
    urls = [part["image_url"]["url"] for part in user["content"] if part["type"] == "image_url"]
    words = "".join(part["text"] for part in user["content"] if part["type"] == "text")
    seen = Stimulus.of(base64.b64decode(urls[0].partition(",")[2])) if urls else Stimulus()
    asking = _CONTROLLER.answer(Query("".join(one["content"] for one in system), words, seen, 0))
    try:
        asking.send(None)
    except StopIteration as said:
        return str(said.value.text)
    raise RuntimeError("a scripted controller waits for nothing")


def planned(bank: Path, out: Path, base_url: str, timeout_s: float = 2.0) -> study.Battery:
    """Return the battery, without controls, so that the number of calls is known before."""
    mode = RequestMode(SPEC, base_url=base_url, seed=True, timeout_s=timeout_s)
    return study.plan(bank, [mode], out, seed=7, extent=study.BatterySelection(controls="none"))


def make_calls(bank: Path, out: Path, base_url: str, timeout_s: float = 2.0) -> None:
    """Make what is left of the calls."""
    limits = Limits(patience=10**6)  # of a road that breaks every second request, ten in a row prove nothing
    study.run(planned(bank, out, base_url, timeout_s), concurrency=32, limits=limits)


def finals(out: Path) -> dict[CallKey, tuple[str, str | None]]:
    """Return text and error of every finished call."""
    if not (out / LEDGER).is_file():
        return {}
    with Ledger(out / LEDGER) as ledger:
        finished = ledger.finished()
        return {key: (one.text, one.error) for key, one in ledger.replies(SPEC) if key in finished}


def disturbed(bank: Path, out: Path, server: BrokenRoad, kills: int, longest_s: float) -> dict[str, int]:
    """Run the battery through the server, killed so many times; count what must not be."""
    dice, lost, killed, rounds = random.Random(11), 0, 0, 0  # noqa: S311 - moments, no secret
    before: dict[CallKey, tuple[str, str | None]] = {}
    words = [sys.executable, __file__, "--child", str(bank), str(out), server.base_url]
    while True:
        rounds += 1
        child = subprocess.Popen(words)
        if killed < kills:
            told = server.requests.total()
            while server.requests.total() == told and child.poll() is None:
                time.sleep(0.02)
            time.sleep(dice.uniform(0.0, longest_s))
            child.kill()
            killed += 1
        child.wait()
        now = finals(out)
        lost += sum(now.get(key) != value for key, value in before.items())
        before = now
        if killed >= kills and len(now) == len(planned(bank, out, server.base_url).plan.keys()):
            break
        if rounds > kills + 50:
            raise RuntimeError("the run does not end")
    with Ledger(out / LEDGER) as ledger:
        attempts = list(ledger.attempts(SPEC))
    return {
        "calls": len(before),
        "kills": killed,
        "rounds": rounds,
        "lost_or_changed": lost,
        "final_failures": sum(error is not None for _, error in before.values()),
        **counted(attempts, server.requests),
    }


def counted(attempts: list[SentAttempt], requests: Mapping[int, int]) -> dict[str, int]:
    """Count attempts in the ledger and requests at the server, and the calls in which they cannot be the same.

    An attempt may not have arrived whose outcome is unknown, or that found its connection closed.
    """
    sent, may_miss = Counter[int](), Counter[int]()
    for attempt in attempts:
        seed = attempt.key.seed(7) % 2**31
        sent[seed] += 1
        may_miss[seed] += attempt.reply is None or (
            attempt.reply.error == "connection" and attempt.reply.status is None
        )
    wrong = [seed for seed in {*sent, *requests} if not 0 <= sent[seed] - requests.get(seed, 0) <= may_miss[seed]]
    return {
        "attempts": len(attempts),
        "requests": sum(requests.values()),
        "unknown": sum(one.reply is None for one in attempts),
        "calls_counted_otherwise": len(wrong),
    }


def judged(out: Path) -> dict[str, object]:
    """Return the labels and the value of every statistic."""
    scored = study.score(out, resamples=999)
    (one,) = scored.models.values()
    (verdict,) = judge(scored).values()
    labels = {"calibrated": verdict.calibrated.label, "lateral": verdict.lateral.label, "paper": verdict.paper.label}
    return {**labels, **{name: found.value for name, found in one.statistics.items()}}


def measured(bank: Path, folder: Path, *, share: float, kills: int, longest_s: float) -> dict[str, object]:
    """Return what came of the battery through broken roads, and whether its verdict is the undisturbed one."""
    with BrokenRoad(answer, share=0.0) as sound:
        make_calls(bank, folder / "sound", sound.base_url, 60.0)
    with BrokenRoad(answer, share=share, seed=3) as broken:
        begun = time.monotonic()
        found = disturbed(bank, folder / "broken", broken, kills, longest_s)
        kinds, faults = len(broken.dealt), broken.dealt.total()
    quiet, loud = judged(folder / "sound"), judged(folder / "broken")
    return {
        **found,
        "kinds": kinds,
        "faults": faults,
        "seconds": round(time.monotonic() - begun),
        "verdict": loud["calibrated"],
        "answers_differ": finals(folder / "sound") != finals(folder / "broken"),
        "verdict_differs": quiet != loud,
    }


def is_wrong(found: Mapping[str, object]) -> bool:
    """Return whether anything is that must not be."""
    names = ("lost_or_changed", "final_failures", "calls_counted_otherwise", "answers_differ", "verdict_differs")
    return any(found[name] for name in names)


def main() -> int:
    """Measure, write the result, and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--share", type=float, default=0.4)
    parser.add_argument("--kills", type=int, default=30)
    parser.add_argument("--steps", type=int, default=12)
    parser.add_argument("--child", nargs=3, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.child:
        make_calls(Path(asked.child[0]), Path(asked.child[1]), asked.child[2])
        return 0
    with tempfile.TemporaryDirectory() as made:
        bank = Path(made) / "bank"
        build = [str(Path(sys.executable).with_name("eyechart")), "frames", "build", "highway", "--out", str(bank)]
        subprocess.run([*build, "--steps", str(asked.steps)], check=True, stdout=subprocess.DEVNULL)
        found = measured(bank, Path(made), share=asked.share, kills=asked.kills, longest_s=4.0)
    head = {"date": dt.datetime.now(dt.UTC).date().isoformat(), "version": eyechart.__version__, "share": asked.share}
    result = {**head, "load": round(os.getloadavg()[0], 1), "kinds_of_fault": len(ROADS), **found}
    RESULT.write_text(json.dumps(result, indent=1) + "\n")
    for name, value in result.items():
        print(f"{name:>24}  {value}")
    return 1 if is_wrong(found) else 0


if __name__ == "__main__":
    sys.exit(main())
