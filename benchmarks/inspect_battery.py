"""A battery under Inspect AI and one asked by hand, imported from a file, against the native run, by statistic.

    make long-inspect
    python benchmarks/inspect_battery.py --inspect ENV/bin/inspect

A server on loopback answers by the picture, as the controller whose name its model has. Each controller is asked three
times by the commands that a user gives: by ``run battery``; by ``inspect eval eyechart/battery``, in an environment of
its own that has Inspect AI and eyechart without its requirements; and by a client of twenty lines that knows nothing
but the table of an export. What the last two bring is imported, and what the answers call for is exported, until
nothing is left. What is finished is kept on disk, so that an interrupted measurement goes on.
Writes ``benchmarks/results/inspect.json``; exit 1 where a verdict, a statistic, a count or a request differs.
"""

import argparse
import base64
import csv
import datetime as dt
import hashlib
import json
import os
import random
import shutil
import subprocess
import sys
import time
import urllib.request
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests")]

import eyechart  # noqa: E402
from broken_roads import BrokenRoad  # noqa: E402 - of the tests; here its road is sound
from eyechart.calls import Query  # noqa: E402
from eyechart.frames import Stimulus, open_bank  # noqa: E402
from eyechart.models import open_model  # noqa: E402
from eyechart.models.scripted import see  # noqa: E402
from eyechart.records import plain  # noqa: E402
from eyechart.studies import battery as study  # noqa: E402
from eyechart.verdicts import judge  # noqa: E402
from eyechart_organisms.adversaries import ADVERSARIES  # noqa: E402

RESULT = ROOT / "benchmarks" / "results" / "inspect.json"
KEPT = ROOT / "build" / "inspect_battery"
CONTROLLERS = ("depth_lateral", "constant", "centroid", "refuse_blank")
"""A reader of distance and sides, a blind one, a follower of the layout, one that refuses."""
WAYS = ("native", "inspect", "file")
MOST_ROUNDS = 4
_KEY = "none-on-loopback"


class Answers:
    """What the server answers, and what it was asked: words, picture and settings, by controller."""

    def __init__(self) -> None:
        """Begin with nothing asked."""
        self.asked: Counter[str] = Counter()
        self.settings: set[str] = set()

    def __call__(self, request: Mapping[str, object]) -> str:
        """Return what the controller that the request names says to its words and picture, and count the request."""
        system, user, picture = _told(request["messages"])
        self.asked[_digest(system, user, picture)] += 1
        budget = request.get("max_tokens", request.get("max_completion_tokens"))
        self.settings.add(f"temperature {request.get('temperature')}, at most {budget} tokens")
        name = str(request["model"])
        if name in ADVERSARIES:
            said = ADVERSARIES[name].decide(see(picture), random.Random(0))  # noqa: S311 - a rule that tosses no coin
            return said if isinstance(said, str) else said.text
        asking = open_model(f"scripted:{name}").answer(
            Query(system, user, Stimulus() if picture is None else Stimulus.of(picture), 0)
        )
        try:
            asking.send(None)
        except StopIteration as done:
            return str(done.value.text)
        raise RuntimeError("a scripted controller waits for nothing")

    def taken(self) -> tuple[Counter[str], list[str]]:
        """Return what was asked since it was last taken, and with which settings."""
        asked, settings = self.asked, sorted(self.settings)
        self.asked, self.settings = Counter(), set()
        return asked, settings


def _told(messages: object) -> tuple[str, str, bytes | None]:
    """Return the system's words, the user's words and the picture of a request."""
    words, picture = {"system": "", "user": ""}, None
    assert isinstance(messages, list)
    for message in messages:
        parts = (
            message["content"]
            if isinstance(message["content"], list)
            else [{"type": "text", "text": message["content"]}]
        )
        for part in parts:
            if part["type"] == "text":
                words[message["role"]] += part["text"]
            else:
                picture = base64.b64decode(part["image_url"]["url"].partition(",")[2])
    return words["system"], words["user"], picture


def _digest(system: str, user: str, picture: bytes | None) -> str:
    return hashlib.sha256(repr((system, user, picture)).encode()).hexdigest()


def command(*words: str, allowed: tuple[int, ...] = (0,), **more: str) -> None:
    """Run a command of eyechart, or of another program; raises RuntimeError where it ends otherwise than allowed."""
    first = str(Path(sys.executable).with_name("eyechart"))
    program = words if "/" in words[0] else (first, *words)
    done = subprocess.run(program, capture_output=True, text=True, check=False, env={**os.environ, **more})
    if done.returncode not in allowed:
        raise RuntimeError(
            f"{' '.join(words)[:200]} ended with {done.returncode}: {(done.stdout + done.stderr)[-800:]}"
        )


def native(bank: Path, name: str, url: str, home: Path) -> Path:
    """Return the run that eyechart itself made."""
    out = home / "run"
    model = ("--model", f"openai:{name}", "--base-url", url, "--no-probe")
    command("run", "battery", "--frames", str(bank), "--out", str(out), *model)
    return out


def elsewhere(bank: Path, home: Path, ask: Callable[[Path, Path], Path]) -> Path:
    """Return the run of answers that ``ask`` brings of each export, and of those that the answers call for."""
    out = home / "run"
    for number in range(1, MOST_ROUNDS + 1):
        folder = home / f"asked-{number}"
        more = ("--run", str(out)) if out.is_dir() else ()
        command("frames", "export", str(bank), "--out", str(folder), *more)
        answers = ask(folder, home)
        command(
            "run", "import", str(answers), "--frames", str(bank), "--model", "vlm", "--out", str(out), allowed=(0, 1)
        )
        if not study.questions_left(bank, out).left:
            return out
    raise RuntimeError(f"{home}: answers are still called for after {MOST_ROUNDS} rounds")


def under_inspect(program: str, name: str, url: str) -> Callable[[Path, Path], Path]:
    """Return what asks an export under Inspect AI, and brings its log: in .eval first, in .json in later rounds."""

    def ask(folder: Path, home: Path) -> Path:
        logs = home / f"logs-{folder.name}"
        form = "eval" if folder.name.endswith("-1") else "json"
        task = ("eval", "eyechart/battery", "-T", f"asked={folder}", "--model", f"openai-api/loopback/{name}")
        how = ("--display", "plain", "--log-dir", str(logs), "--log-format", form, "--max-connections", "8")
        command(program, *task, *how, LOOPBACK_BASE_URL=url, LOOPBACK_API_KEY=_KEY, PYTHONPATH="")
        (log,) = logs.glob(f"*.{form}")
        return log

    return ask


def by_hand(name: str, url: str) -> Callable[[Path, Path], Path]:
    """Return what asks an export row by row, and brings a table: JSON lines first, CSV in later rounds."""

    def ask(folder: Path, home: Path) -> Path:
        rows = [answered(row, folder, name, url) for row in _rows(folder)]
        if folder.name.endswith("-1"):
            table = home / "answers.jsonl"
            table.write_text("".join(json.dumps(row) + "\n" for row in rows))
            return table
        table = home / "answers.csv"
        with table.open("w", newline="") as file:
            writer = csv.DictWriter(file, list(rows[0]))
            writer.writeheader()
            writer.writerows(rows)
        return table

    return ask


def _rows(folder: Path) -> Iterator[dict[str, str]]:
    with (folder / "asked.jsonl").open() as lines:
        yield from map(json.loads, lines)


def answered(row: Mapping[str, str], folder: Path, name: str, url: str) -> dict[str, object]:
    """Ask one row, by nothing but what stands in it, and return what came back as a row of a table."""
    text: object = row["user"]
    if row["picture"]:
        image = base64.b64encode((folder / row["picture"]).read_bytes()).decode()
        shown = {"type": "image_url", "image_url": {"url": f"data:image/png;base64,{image}"}}
        text = [shown, {"type": "text", "text": row["user"]}]
    said = [{"role": "system", "content": row["system"]}, {"role": "user", "content": text}]
    body = json.dumps({"model": name, "messages": said, "temperature": 0, "max_tokens": 1024}).encode()
    asking = urllib.request.Request(f"{url}/chat/completions", body)  # noqa: S310 - on loopback
    with urllib.request.urlopen(asking, timeout=60) as came:  # noqa: S310
        reply = json.load(came)
    choice = reply["choices"][0]
    return {
        **{key: row[key] for key in ("call", "repeat")},
        "text": choice["message"]["content"],
        "finish_reason": choice["finish_reason"],
    }


def judged(run: Path) -> dict[str, object]:
    """Return every statistic with its n, interval and p, the counts, and the labels of the verdict of a run's model."""
    score = study.score(run, resamples=999)
    (model,), (verdict,) = score.models.values(), judge(score).values()
    labels = {"calibrated": verdict.calibrated.label, "lateral": verdict.lateral.label, "paper": verdict.paper.label}
    counts = {"planned": model.planned, "answered": model.answered, "controls": plain(model.controls)}
    told = {**labels, **counts, "statistics": plain(model.statistics), "holm": plain(model.holm)}
    return dict(json.loads(json.dumps(told, default=str)))


def measured(name: str, bank: Path, program: str) -> dict[str, object]:
    """Ask one controller in three ways; return its verdict, and in words whatever differs from the native run."""
    home = KEPT / name
    shutil.rmtree(home, ignore_errors=True)
    answers = Answers()
    found: dict[str, dict[str, object]] = {}
    asked: dict[str, Counter[str]] = {}
    told: dict[str, object] = {}
    with BrokenRoad(answers, share=0.0) as server:
        url = server.base_url
        ways: dict[str, Callable[[Path], Path]] = {
            "native": lambda at: native(bank, name, url, at),
            "inspect": lambda at: elsewhere(bank, at, under_inspect(program, name, url)),
            "file": lambda at: elsewhere(bank, at, by_hand(name, url)),
        }
        for way in WAYS:
            (home / way).mkdir(parents=True)
            began = time.monotonic()
            found[way] = judged(ways[way](home / way))
            asked[way], settings = answers.taken()
            told[way] = {
                "requests": asked[way].total(),
                "rounds": len(list((home / way).glob("asked-*"))),
                "settings": settings,
                "seconds": round(time.monotonic() - began, 1),
            }
    statistics = found["native"]["statistics"]
    assert isinstance(statistics, dict)
    return {
        **{one: found["native"][one] for one in ("calibrated", "lateral", "paper", "planned", "answered")},
        "statistics": len(statistics),
        "ways": told,
        "differs": [line for way in WAYS[1:] for line in differences(way, found, asked)],
    }


def differences(way: str, found: Mapping[str, Mapping[str, object]], asked: Mapping[str, Counter[str]]) -> list[str]:
    """Return in words what a way of asking made otherwise than the native run."""
    said = [] if asked[way] == asked["native"] else [f"{way}: the server was asked otherwise"]
    for part, value in found["native"].items():
        other = found[way][part]
        if isinstance(value, dict) and isinstance(other, dict):
            said += [f"{way}: {part}: {one}" for one in {**value, **other} if value.get(one) != other.get(one)]
        elif value != other:
            said.append(f"{way}: {part}: {other}, not {value}")
    return said


def main() -> int:
    """Ask every controller that is not finished, write the result, and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--inspect", required=True, help="the program 'inspect' of an environment that has eyechart too"
    )
    parser.add_argument("--steps", type=int, default=6, help="steps an episode of the bank")
    options = parser.parse_args()
    bank, kept = KEPT / f"bank-{options.steps}", KEPT / f"done-{options.steps}.json"
    KEPT.mkdir(parents=True, exist_ok=True)
    if not bank.is_dir():
        command("frames", "build", "highway", "--out", str(bank), "--steps", str(options.steps))
    done: dict[str, dict[str, object]] = json.loads(kept.read_text()) if kept.is_file() else {}
    for name in CONTROLLERS:
        if name not in done:
            done[name] = measured(name, bank, str(Path(options.inspect).absolute()))
            kept.write_text(json.dumps(done, indent=1) + "\n")
        print(f"{name}: {done[name]['calibrated']}, differs: {done[name]['differs'] or 'nothing'}", flush=True)
    head = {"date": dt.datetime.now(dt.UTC).date().isoformat(), "version": eyechart.__version__}
    about = {"inspect_ai": inspect_version(options.inspect), "frames": len(open_bank(bank).frames)}
    wrong = sum(bool(one["differs"]) for one in done.values())
    RESULT.write_text(json.dumps({**head, **about, "differing": wrong, "controllers": done}, indent=1) + "\n")
    return int(bool(wrong))


def inspect_version(program: str) -> str:
    """Return the version of Inspect AI that a program is of."""
    asked = [str(Path(program).with_name("python")), "-c", "from importlib.metadata import version as v"]
    asked[-1] += "; print(v('inspect_ai'))"
    return subprocess.run(asked, capture_output=True, text=True, check=True).stdout.strip()


if __name__ == "__main__":
    sys.exit(main())
