"""What the exercises work on: a bank, runs, shards, tables, robot data, logs; small, and made by eyechart itself."""

import csv
import json
import shutil
import zipfile
from collections.abc import Sequence
from pathlib import Path

import annotation_forms
import banks
import data_sets
import demonstrations
import drawn_roads
import photographs
import published_votes
from matrix import guests
from matrix.stage import perform

ASKED = ("--frames", "bank", "--conditions", "real,blank", "--limit", "6")
HONEST, RUDE = "python:guests:honest", "python:guests:rude"
MODE = 'spec = "python:guests:honest"\ntimeout_s = 30.0\nheaders = { X-Name = "a" }\n'
PROMPT = 'name = "mine"\nuser = "Choose one of {actions}."\n'
RIG = '[[camera]]\nname = "front"\ncolumn = "photo"\nmirror_axis = "horizontal"\n'
SCORES = "model,score\npython:guests:honest,0.5\npython:guests:rude,0.25\n"


def made(stock: Path, *words: str) -> None:
    """Run a command in the stock; raises RuntimeError where it does not come to its end."""
    ended = perform(words, stock)
    if ended.code:
        raise RuntimeError(f"eyechart {' '.join(words)}: exit {ended.code}: {ended.err[-2000:]}")


def prepare(stock: Path, *, arrow: bool) -> None:
    """Make everything in a new folder; with what needs pyarrow and av where they are there."""
    stock.mkdir(parents=True)
    bank = banks.build_bank(stock / "bank", episodes=1)
    png = next(iter(sorted((bank.root / "images").iterdir()))).read_bytes()
    (stock / "png").write_bytes(png)
    guests.invite(stock, "polite")
    for name, text in (("mode.toml", MODE), ("mine.toml", PROMPT), ("scores.csv", SCORES), ("rig.toml", RIG)):
        (stock / name).write_text(text)
    _runs(stock)
    _tables(stock)
    _answers(stock)
    votes, about = published_votes.write(published_votes.published(), stock)
    (stock / "ids.txt").write_text(
        "".join(f"{frame}\n" for frame in published_votes.published().part("calibration").frames)
    )
    made(stock, "guardian", "fit", votes.name, "--about", about.name, "--out", "guardian.json")
    if arrow:
        gaps = data_sets.lerobot(stock / "set", episodes=4, length=6)
        data_sets.arm(stock / "old-set", inside=False, episodes=4, length=6)
        data_sets.of_episodes(stock / "old-set", gaps=gaps, numbered=False)
        words = {"annotation": {"human.action.task_description": {"original_key": "task_index"}}}
        (stock / "old-set/meta/modality.json").write_text(json.dumps(words))
        data_sets.reach(stock / "arm", {"observation.state": ["x", "y"], "action": ["x", "y"]})
        demonstrations.robomimic(stock / "demos.hdf5")
        rows = photographs.rows(drives=2, ticks=3)
        data_sets.write_table(stock / "photos.parquet", {name: [row[name] for row in rows] for name in rows[0]})
    shutil.rmtree(stock / "tmp")
    for name in ("stdout", "stderr", "asked"):
        (stock / name).unlink(missing_ok=True)


def _runs(stock: Path) -> None:
    """Make a whole run, its shards, one that was cut, drives, and a run of policies."""
    made(stock, "run", "battery", "--model", HONEST, *ASKED, "--out", "run")
    for number in "12":
        made(stock, "run", "battery", "--model", HONEST, *ASKED, "--shard", f"{number}/2", "--out", f"shard-{number}")
    cut = perform(("run", "battery", "--model", HONEST, *ASKED, "--max-calls", "5", "--out", "cut"), stock)
    if cut.code != 3:
        raise RuntimeError(f"a run stopped at --max-calls: exit {cut.code}: {cut.err}")
    made(stock, *DRIVES, "--out", "drives")
    made(stock, "bundle", "run", "--out", "run.zip")
    made(stock, "frames", "build", "tabletop", "--steps", "4", "--seeds", "0,1", "--out", "table")
    made(stock, "run", "policy", "--policy", "trained:sees", "--frames", "table", "--limit", "4", "--out", "policy")


DRIVES = (
    *("run", "closed-loop", "--simulator", "rover", "--scenarios", "single", "--seeds", "1", "--processes", "1"),
    *("--policy", "constant:SLOW", "--policy", "constant:STRAIGHT"),
)


def _tables(stock: Path) -> None:
    """Write photographs with their table, as CSV and as JSON lines."""
    rows = photographs.rows(drives=2, ticks=3)
    (stock / "rover.toml").write_text(photographs.SPACE)
    roads = drawn_roads.some(2)
    drawn_roads.write_pictures(stock / "roads", roads)
    annotation_forms.coco(stock / "coco", roads)
    annotation_forms.nuscenes(stock / "nuscenes", roads)
    drawn_roads.write_tables(stock / "roads.csv", stock / "boxes.csv", roads)
    photographs.take(stock / "photos", rows)
    with (stock / "photos.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows({name: "" if cell is None else cell for name, cell in row.items()} for row in rows)
    write_lines(stock / "photos.jsonl", rows)


def _answers(stock: Path) -> None:
    """Export the bank, and write answers to it as a table and as logs of Inspect AI."""
    made(stock, "frames", "export", *ASKED[1:], "--out", "export")
    calls = [json.loads(line)["call"] for line in (stock / "export" / "asked.jsonl").read_text().splitlines()]
    write_lines(stock / "answers.jsonl", [{"call": call, "text": "SLOW"} for call in calls])
    said = [{"message": {"content": "SLOW"}, "stop_reason": "stop"}]
    samples = [
        {"id": call, "epoch": 1, "metadata": {"call": call}, "output": {"choices": said, "time": 0.5}} for call in calls
    ]
    header = {"eval": {"model": "a/model", "packages": {"inspect_ai": "0.3.285"}}}
    (stock / "log.json").write_text(json.dumps({**header, "samples": samples}))
    with zipfile.ZipFile(stock / "log.eval", "w", zipfile.ZIP_DEFLATED) as packed:
        packed.writestr("header.json", json.dumps(header))
        for number, sample in enumerate(samples):
            packed.writestr(f"samples/{number}_epoch_1.json", json.dumps(sample))


def write_lines(path: Path, rows: Sequence[object]) -> None:
    """Write rows as JSON lines."""
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))


def copy(stock: Path, names: Sequence[str], folder: Path) -> None:
    """Copy materials into the folder of a cell."""
    for name in names:
        source, target = stock / name, folder / name
        if name == "road" and not source.exists():  # it takes as long as all others together
            made(stock, "frames", "build", "highway", "--out", name)
        if source.is_dir():
            shutil.copytree(source, target)
        else:
            shutil.copyfile(source, target)
