"""A robot's data set, written by LeRobot's own writer, from import to gate: what it takes of time and memory.

    LEROBOT_PYTHON=/path/to/python make long-lerobot

``LEROBOT_PYTHON`` is a Python with LeRobot (3.12 or newer); this one needs ``eyechart[lerobot]``. Two cameras of
480 × 640, six joints, 50 Hz, 20 episodes (`write_lerobot`): of 300 frames with videos, of 100 with pictures inside
Parquet; a policy that answers with chunks of 50 and looks, and one that does not. Each step is a command in a
process of its own, and a step that is finished is not made again. Writes ``benchmarks/results/lerobot.json``; exit 1
where a verdict is not as it should be.
"""

import argparse
import datetime as dt
import json
import os
import resource
import subprocess
import sys
import time
from pathlib import Path

import eyechart

HERE = Path(__file__).parent
RESULT = HERE / "results" / "lerobot.json"
SPECS = {
    "python:arm_policies:looks": {"camera": "camera_content", "instruction": "instruction_followed"},
    "python:arm_policies:blind": {"camera": "ignores_camera", "state": "state_shortcut"},
}
EYECHART = (sys.executable, "-c", "from eyechart.cli import main; main()")


def made(cache: Path, name: str, words: list[str], code: int = 0) -> dict[str, float]:
    """Run a command once; return its seconds, its CPU seconds and its peak of memory, from disk where it ran."""
    file = cache / f"{name}.json"
    if not file.is_file():
        before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
        told = "import resource,subprocess,sys,json; c=subprocess.run(sys.argv[2:]).returncode; "
        told += (
            "u=resource.getrusage(resource.RUSAGE_CHILDREN); open(sys.argv[1],'w').write(str(u.ru_maxrss)); sys.exit(c)"
        )
        peak = cache / f"{name}.peak"
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")])}
        with (cache / f"{name}.out").open("w") as out:
            done = subprocess.run(
                [sys.executable, "-c", told, str(peak), *words], check=False, stdout=out, env=environment
            )
        if done.returncode != code:
            raise SystemExit(f"{name} ended with {done.returncode}, not {code}: {' '.join(words)}")
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        found = {"seconds": time.monotonic() - begun, "cpu_seconds": cpu, "peak_mb": int(peak.read_text()) / 1024}
        file.write_text(json.dumps({what: round(number, 1) for what, number in found.items()}))
    return dict(json.loads(file.read_text()))


def steps_of(cache: Path, kind: str, python: str) -> dict[str, dict[str, float]]:
    """Make a data set and all that follows from it."""
    root, bank, run = (cache / f"{kind}-{what}" for what in ("set", "bank", "run"))
    policies = [word for spec in SPECS for word in ("--policy", spec)]
    words = ["--format", "lerobot", "--horizon", "50", "--every", "25"]
    images = ["--images", "--frames", "100"] if kind == "parquet" else []
    steps = {
        "import": [*EYECHART, "frames", "import", str(root), *words, "--out", str(bank)],
        "check": [*EYECHART, "frames", "check", str(bank)],
        "plan": [*EYECHART, "plan", str(bank)],
        "run": [*EYECHART, "run", "policy", *policies, "--frames", str(bank), "--out", str(run)],
        "verdict": [*EYECHART, "verdict", str(run), "--json"],
        "report": [*EYECHART, "report", str(run), "--out", str(cache / f"{kind}.html")],
        "bundle": [*EYECHART, "bundle", str(run), "--out", str(cache / f"{kind}.zip")],
    }
    made(cache, f"{kind}-write", [python, str(HERE / "write_lerobot.py"), str(root), *images])
    found = {name: made(cache, f"{kind}-{name}", words) for name, words in steps.items()}
    require = "camera:camera_content,instruction:instruction_followed"
    gate = [*EYECHART, "gate", str(run), "--require", require]
    return {**found, "gate": made(cache, f"{kind}-gate", gate, code=1)}


def wrong(cache: Path, kind: str) -> list[str]:
    """Return the labels that are not as they should be."""
    said = json.loads((cache / f"{kind}-verdict.out").read_text())["policies"]
    expected = [(spec, axis, label) for spec, labels in SPECS.items() for axis, label in labels.items()]
    return [f"{kind}: {spec}: {axis} {said[spec][axis]}" for spec, axis, label in expected if said[spec][axis] != label]


def main() -> int:
    """Make every step of both kinds and write the result; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cache", type=Path, default=Path("build/lerobot"))
    args = parser.parse_args()
    python = os.environ.get("LEROBOT_PYTHON", "")
    if not python:
        raise SystemExit("LEROBOT_PYTHON names a Python that has LeRobot")
    args.cache.mkdir(parents=True, exist_ok=True)
    kinds = {kind: steps_of(args.cache, kind, python) for kind in ("videos", "parquet")}
    amiss = [line for kind in kinds for line in wrong(args.cache, kind)]
    about = {"eyechart": eyechart.__version__, "date": dt.datetime.now(dt.UTC).date().isoformat()}
    verdicts = {kind: json.loads((args.cache / f"{kind}-verdict.out").read_text())["policies"] for kind in kinds}
    told = {
        kind: {
            spec: {name: one[name] for name in ("camera", "cameras", "state", "instruction")}
            for spec, one in said.items()
        }
        for kind, said in verdicts.items()
    }
    RESULT.write_text(json.dumps({**about, "steps": kinds, "verdicts": told, "amiss": amiss}, indent=1) + "\n")
    sys.stdout.write("\n".join([*amiss, f"wrote {RESULT}"]) + "\n")
    return int(bool(amiss))


if __name__ == "__main__":
    sys.exit(main())
