"""Makes a tree of this folder anew with the eyechart that is installed: what a version wrote and answered, to keep.

    /elsewhere/.venv/bin/python tests/old/make.py tests/old/0.1.0

The Python is one in which that version is installed. ``made/`` holds banks, runs, guardians and bundles; ``answers/``
holds what each command in `ANSWERS` answered about them, ``surface.json`` what commands, api and testing take.
`tests/test_old.py` holds today's code to all three.
"""

import contextlib
import inspect
import io
import json
import os
import shlex
import sqlite3
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any, get_args, get_type_hints

import numpy as np
from PIL import Image
from typer.main import get_command

from eyechart import api, testing
from eyechart.cli import main as eyechart
from eyechart.cli.app import app
from eyechart.modes import RequestMode
from eyechart.studies import battery

CONTROLLERS = '''"""A controller of one's own that fails, declines and answers nothing now and then."""


def unsteady(prompt: str, image: bytes | None) -> str:
    """Answer by the length of what is shown."""
    size = len(image or b"")
    if size % 7 == 0:
        raise RuntimeError("the camera is dirty")
    return "" if size % 7 == 1 else "I cannot help with that." if size % 7 == 2 else "SLOW" if size % 2 else "LEFT"
'''

FORKLIFT = """name = "forklift"
actions = ["HALT", "CREEP", "DRIVE"]
brake = ["HALT", "CREEP"]
proceed = ["DRIVE"]
"""

MAKES: Mapping[str, str] = {
    "highway": "frames build highway --seeds 0 --steps 6 --out highway",
    "rover": "frames build rover --seeds 0 --steps 4 --out rover",
    "yard": "frames import photos --table photos.csv --map gap=lidar_m --map episode=drive --threshold 18 --unit m "
    "--mirror horizontal --picture 'forward camera of our rover' --out yard",
    "forklifts": "frames import photos --table photos.csv --map gap=lidar_m --threshold 18 --unit m --independent "
    "--actions forklift.toml --picture 'camera of a forklift' --out forklifts",
    "battery": "run battery --frames highway --out battery --limit 16 --model scripted:depth "
    "--model scripted:depth_lateral --model scripted:truncating --model scripted:declines_blank_depth "
    "--model scripted:self_inconsistent --model python:controllers:unsteady",
    "again": "run battery --frames highway --out again --limit 16 --model scripted:depth "
    "--model scripted:depth_lateral --model scripted:truncating --model scripted:self_inconsistent --seed 1",
    "ahead": "run battery --frames rover --out ahead --model scripted:depth_lateral --model scripted:constant",
    "unfinished": "run battery --frames highway --out unfinished --model scripted:depth --max-calls 40",
    "early": "run battery --frames highway --out early --model scripted:constant --stop-early",
    "shard-1": "run battery --frames highway --out shard-1 --model scripted:one_sided --limit 8 --shard 1/2",
    "shard-2": "run battery --frames highway --out shard-2 --model scripted:one_sided --limit 8 --shard 2/2",
    "merged": "merge shard-1 shard-2 --out merged",
    "own": "run battery --frames yard --out own --model python:controllers:unsteady",
    "halfway": "run battery --frames yard --out halfway --model python:controllers:unsteady --max-calls 40",
    "trade": "run battery --frames forklifts --out trade --model python:controllers:unsteady",
    "mode.toml": "probe scripted:depth --seed 1 --out mode.toml",
    "by-mode": "run battery --frames highway --out by-mode --mode mode.toml --limit 8",
    "prompts": "run prompts --frames highway --out prompts --model scripted:depth --model scripted:truncating "
    "--prompt baseline --prompt minimal --limit 12",
    "admission": "run admission --frames highway --out admission --model scripted:scene_side_blind "
    "--model scripted:scene_positive_control --model scripted:scene_silent_when_free",
    "structured": "run structured --frames highway --out structured --model scripted:scene_positive_control "
    "--model scripted:scene_over_calling --model scripted:scene_side_blind",
    "online": "run online --out online --model scripted:scene_side_blind --episodes 2",
    "drives": "run closed-loop --out drives --simulator rover --policy oracle --policy constant:SLOW "
    "--policy scripted:depth_lateral --condition real --condition blank --scenarios offset --seeds 2",
    "ladder": "ladder --out ladder --seeds 1",
    "hierarchy": "run hierarchy --out hierarchy --policy scripted:clear_side",
    "guardian.json": "guardian fit votes.csv --about about.toml --out guardian.json",
    "watcher.json": "guardian fit structured --frames highway --size 1 --calibration calibration.txt "
    "--out watcher.json",
    "stack.json": "guardian export guardian.json --out stack.json",
    "battery.zip": "bundle again --out battery.zip",
    "estimates.zip": "bundle admission --out estimates.zip",
}
"""What is made, by the file or folder that it becomes, in this order."""

RUNS = ("battery", "again", "ahead", "unfinished", "early", "merged", "own", "halfway", "trade", "by-mode")
DRIVEN = ("online", "drives", "ladder", "hierarchy")
ESTIMATES = ("admission", "structured")

ANSWERS: Mapping[str, str] = {
    **{f"check-{bank}": f"frames check {bank} --json" for bank in ("highway", "rover", "yard", "forklifts")},
    **{f"plan-{bank}": f"plan {bank} --json" for bank in ("highway", "yard", "forklifts")},
    **{f"score-{run}": f"score {run} --json" for run in (*RUNS, "prompts", *ESTIMATES, *DRIVEN)},
    **{f"verdict-{run}": f"verdict {run} --json" for run in (*RUNS, "prompts", "admission", "drives")},
    **{f"costs-{run}": f"costs {run} --all --json" for run in (*RUNS, "prompts", *ESTIMATES, *DRIVEN)},
    **{f"gate-{run}": f"gate {run} --json" for run in (*RUNS, "prompts", *ESTIMATES, *DRIVEN)},
    "gate-all": "gate battery --require depth,depth_lateral,swaps --max-unparsed 0.2 --json",
    "gate-clauses": "gate admission --require parse,actions,directional --json",
    "score-independent": "score trade --independent --json",
    "score-against": "score drives --against constant:SLOW --json",
    "compare": "compare battery again --all --json",
    "compare-else": "compare battery ahead --json",
    "transfer": "transfer battery again --scores scores.csv --json",
    "audit-drives": "audit drives --json",
    "audit-ladder": "audit ladder drives --json",
    "audit-hierarchy": "audit hierarchy/primary-models --json",
    "guardian-score": "guardian score guardian.json votes.csv --about about.toml --json",
    "guardian-unseen": "guardian score watcher.json structured --frames highway --unseen --json",
    "guardian-seen": "guardian score watcher.json structured --frames highway --json",
    "guardian-nested": "guardian nested votes.csv --about about.toml --json",
    "guardian-nested-run": "guardian nested structured --frames highway --size 1 --json",
    "guardian-modular": "guardian modular watcher.json structured --frames highway --unseen --json",
    "validate-battery": "validate battery.zip --json",
    "validate-estimates": "validate estimates.zip --json",
}
"""The commands that read, by the name of the file that keeps what they answered."""


def inputs() -> None:
    """Write what a user brings: controllers, pictures with a table, votes, scores."""
    Path("controllers.py").write_text(CONTROLLERS, encoding="utf-8")
    Path("forklift.toml").write_text(FORKLIFT, encoding="utf-8")
    Path("photos").mkdir()
    dice = np.random.default_rng(7)
    lines = ["file,lidar_m,drive"]
    for number in range(16):
        gap = float(dice.integers(6, 40))
        pixels = np.full((48, 64, 3), 120, dtype=np.uint8)
        pixels[30:, :, :] = dice.integers(60, 90, (18, 64, 3))
        side = int(200 / gap)
        pixels[30 - side // 2 : 30 + side // 2, 32 - side // 2 : 32 + side // 2] = (200, 30, 30)
        Image.fromarray(pixels).save(f"photos/{number:02}.png")
        lines.append(f"{number:02}.png,{gap},drive-{number // 4}")
    Path("photos.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    models = ("gemma", "qwen", "other")
    votes = [f"{model}/{view}" for model in models for view in ("original", "reflected")]
    lines = [",".join(("frame", "episode", "hazard", "split", *votes))]
    for number in range(60):
        hazard = int(dice.random() < 0.5)
        split = "calibration" if number < 16 else "bound" if number % 5 == 4 else "score"
        said = [hazard if dice.random() < right else 1 - hazard for right in (0.9, 0.9, 0.8, 0.8, 0.5, 0.5)]
        lines.append(",".join(map(str, (f"f{number:03}", f"{split}-{number % 6}", hazard, split, *said))))
    Path("votes.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    about = 'bank = "b1"\nbank_name = "yard"\nprompt = "p1"\nview = "v1"\n'
    about += "".join(f'[models."{one}"]\nversion = "1"\n' for one in models)
    Path("about.toml").write_text(about, encoding="utf-8")
    names = ("depth", "depth_lateral", "truncating", "self_inconsistent", "presence")
    lines = ["model,score", *(f"scripted:{name},{0.9 - 0.1 * place:.1f}" for place, name in enumerate(names))]
    Path("scores.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    frames = [f"{scene}-0-{step:02}" for scene in ("light", "dense") for step in range(6)]
    Path("calibration.txt").write_text("\n".join(frames) + "\n", encoding="utf-8")


def command(line: str) -> tuple[int, str, str]:
    """Run a command of eyechart in this process; returns exit code, standard output and standard error."""
    out, err = io.StringIO(), io.StringIO()
    sys.argv = ["eyechart", *shlex.split(line)]
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            eyechart()
            code = 0
        except SystemExit as left:
            code = left.code if isinstance(left.code, int) else int(left.code is not None)
    return code, out.getvalue(), err.getvalue()


def answer(line: str) -> dict[str, object]:
    """Return what a command answered: its exit code, and the JSON that it printed, if it printed any."""
    code, out, _ = command(line)
    return {"command": line, "exit": code, "json": json.loads(out) if out.strip() else None}


def surface() -> dict[str, object]:
    """Return what is promised to those who call: commands with their options, and what api and testing offer."""
    commands = dict(_commands(get_command(app), "eyechart"))
    return {"commands": commands, **{module.__name__: _offered(module) for module in (api, testing)}}


def _commands(command: Any, name: str) -> Iterator[tuple[str, object]]:  # noqa: ANN401 - click exports no type of it
    if hasattr(command, "commands"):
        for word, found in command.commands.items():
            yield from _commands(found, f"{name} {word}")
        return
    yield (
        name,
        {
            one.opts[0]: {"default": str(one.default), "required": one.required, "again": one.multiple}
            for one in command.params
        },
    )


def _offered(module: ModuleType) -> dict[str, object]:
    return {
        name: _parameters(one) | {f".{word}": "member" for word in vars(one) if inspect.isclass(one) and word[0] != "_"}
        for name, one in vars(module).items()
        if callable(one) and one.__module__.startswith(module.__name__) and not name.startswith("_")
    }


def _parameters(one: Callable[..., object]) -> dict[str, object]:
    """Return what a function takes; options that it passes on have the defaults of who takes them, or are off."""
    taken: dict[str, inspect.Parameter] = {}
    for name, found in inspect.signature(one).parameters.items():
        passed = get_args(found.annotation) if found.kind is found.VAR_KEYWORD else ()
        takers = (RequestMode, battery.BatterySelection, battery.plan)
        planned = {option: one for taker in takers for option, one in inspect.signature(taker).parameters.items()}
        named = {option: one.replace(kind=found.KEYWORD_ONLY) for option, one in planned.items()}
        off = inspect.Parameter(name, found.KEYWORD_ONLY, default=False)
        taken |= {option: named.get(option, off) for option in get_type_hints(passed[0])} if passed else {name: found}
    return {
        name: f"{'by name' if found.kind is found.KEYWORD_ONLY else 'by place'}, "
        f"{'required' if found.default is found.empty else repr(found.default)}"
        for name, found in taken.items()
    }


def settle(made: Path) -> None:
    """Make what a command left fit to keep: a ledger is one file, and a bank is named from the folder of all."""
    for ledger in made.rglob("ledger.sqlite"):
        with contextlib.closing(sqlite3.connect(ledger)) as opened:
            opened.execute("PRAGMA wal_checkpoint(TRUNCATE)")
            opened.execute("VACUUM")
        for beside in ("-wal", "-shm"):
            ledger.with_name(ledger.name + beside).unlink(missing_ok=True)
    for manifest in made.rglob("run.json"):
        text = manifest.read_text(encoding="utf-8")
        manifest.write_text(text.replace(f"{Path.cwd()}/", ""), encoding="utf-8")
    for lock in made.rglob(".lock"):
        lock.unlink()


def main() -> int:
    """Make the tree in the folder that the command line names, which must not be there."""
    from eyechart.studies.hierarchy.plans import PARTS  # noqa: PLC0415 - the package of 0.1.0 does not name it

    root = Path(sys.argv[1]).resolve()
    (root / "made").mkdir(parents=True)
    (root / "answers").mkdir()
    os.chdir(root / "made")
    sys.path.insert(0, ".")
    inputs()
    whole = dict(PARTS)
    for name, part in whole.items():  # a whole study of the hierarchy has twenty times the bytes
        PARTS[name] = replace(part, seeds=1, scenarios=part.scenarios[:2], conditions=part.conditions[:3])
    for name, line in MAKES.items():
        code, _, err = command(line)
        print(f"{code} {line}\n{err if code else ''}", end="", flush=True)
        if not Path(name).exists():
            return 2
        settle(Path(name))
    PARTS.update(whole)
    for name, line in ANSWERS.items():
        found = answer(line)
        text = json.dumps(found, ensure_ascii=False, sort_keys=True)
        (root / "answers" / f"{name}.json").write_text(text + "\n", encoding="utf-8")
        print(f"{found['exit']} {line}", flush=True)
    settle(Path())
    (root / "surface.json").write_text(json.dumps(surface(), indent=1, sort_keys=True) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
