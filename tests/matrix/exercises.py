"""Small real commands that drive the doors: what each needs, what it is told, and what it makes."""

import hashlib
import json
import re
import sqlite3
import zipfile
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from matrix.materials import ASKED, DRIVES, HONEST, RUDE
from matrix.stage import Ended

Words = tuple[str, ...]
_TABLE = ("--map", "gap=lidar_m", "--map", "file=photo", "--map", "episode=drive", "--map", "step=tick")
_TABLE = (*_TABLE, "--threshold", "18", "--unit", "m", "--mirror", "horizontal", "--actions", "rover.toml")

_RIGGED = (*_TABLE[:2], *_TABLE[4:12], *_TABLE[14:])


def replies(run: str) -> Callable[[Path, Ended], object]:
    """Return what reads the finished calls of the models that are not rude."""

    def read(folder: Path, ended: Ended) -> object:
        del ended
        with closing(sqlite3.connect(folder / run / "ledger.sqlite")) as sql:
            rows = sql.execute(
                "SELECT c.model, c.frame, c.condition, c.repeat, r.text, r.error, a.request_sha256 FROM calls c"
                " JOIN attempts a ON a.call = c.id JOIN replies r ON r.attempt = a.id WHERE r.final = 1"
            )
            return sorted(row for row in rows if row[0] != RUDE)

    return read


def files(*names: str) -> Callable[[Path, Ended], object]:
    """Return what takes the digest of every file of folders, or of files, but locks and dates."""

    def read(folder: Path, ended: Ended) -> object:
        del ended
        result = {}
        for name in names:
            root = folder / name
            for path in sorted(root.rglob("*")) if root.is_dir() else [root]:
                if path.is_file() and "lock" not in path.name:
                    text = re.sub(rb'"created": "[^"]*"', b"", path.read_bytes())
                    result[path.relative_to(folder).as_posix()] = hashlib.sha256(text).hexdigest()
        return result

    return read


def printed(folder: Path, ended: Ended) -> object:
    """Return what a command printed as its result."""
    del folder
    return ended.out


def without_numbers(folder: Path, ended: Ended) -> object:
    """Return what a command printed, without its numbers: seconds and drawn pictures are among them."""
    del folder
    return re.sub(r"[\d.]+", "#", ended.out)


def packed(name: str) -> Callable[[Path, Ended], object]:
    """Return what takes the digests of a bundle's files."""

    def read(folder: Path, ended: Ended) -> object:
        del ended
        with zipfile.ZipFile(folder / name) as file:
            return {one: hashlib.sha256(file.read(one)).hexdigest() for one in file.namelist() if "report" not in one}

    return read


def episodes(run: str) -> Callable[[Path, Ended], object]:
    """Return what reads the drives of a run, in any order."""

    def read(folder: Path, ended: Ended) -> object:
        del ended
        return sorted(set((folder / run / "episodes.jsonl").read_text().splitlines()))

    return read


@dataclass(frozen=True)
class Exercise:
    """Commands, what they need and make, and how that is told from another; ``foreign``: what others may write."""

    name: str
    commands: tuple[Words, ...]
    needs: tuple[str, ...]
    seen: Callable[[Path, Ended], object]
    makes: tuple[str, ...] = ()
    foreign: tuple[str, ...] = ()
    guests: bool = False
    arrow: bool = False
    parents: bool = False
    serves: bool = False
    asks: bool = False
    page: str = ""
    """A page that it makes, which says itself of what cannot be scored that it cannot, and why."""
    truth: bool = False
    """Whether what it prints is a judgement of what it reads: a record that is made empty is to be named."""


_LIST = (
    Exercise(
        "battery",
        (
            (
                *("run", "battery", "--model", RUDE, "--model", HONEST, "--frames", "bank", "--out", "out"),
                *("--conditions", "real,blank,text_only", "--concurrency", "4", "--timeout", "0.5"),
            ),
        ),
        ("bank", "guests.py"),
        replies("out"),
        ("out",),
        ("bank",),
        guests=True,
    ),
    Exercise(
        "resume",
        (("run", "battery", "--model", HONEST, *ASKED, "--out", "cut"),),
        ("bank", "guests.py", "cut"),
        replies("cut"),
        (),
        ("cut",),
    ),
    Exercise(
        "mode",
        (("run", "battery", "--mode", "mode.toml", "--prompt", "mine.toml", *ASKED, "--out", "out"),),
        ("bank", "guests.py", "mode.toml", "mine.toml"),
        replies("out"),
        ("out",),
        ("mode.toml", "mine.toml"),
    ),
    Exercise(
        "endpoint",
        (("run", "battery", "--model", "openai:m", "--base-url", "URL", "--no-probe", *ASKED, "--out", "out"),),
        ("bank",),
        replies("out"),
        ("out",),
        asks=True,
    ),
    Exercise(
        "watch",
        (
            (
                *("run", "battery", "--model", "openai:m", "--base-url", "URL", "--no-probe", "--concurrency", "1"),
                *(*ASKED, "--watch", "--out", "out"),
            ),
        ),
        ("bank",),
        replies("out"),
        ("out",),
        asks=True,
        serves=True,
    ),
    Exercise(
        "doctor",
        (("doctor", RUDE, "--seed", "1", "--timeout", "1", "--json"),),
        ("guests.py",),
        without_numbers,
        guests=True,
    ),
    Exercise(
        "doctor of an endpoint",
        (("doctor", "openai:m", "--base-url", "URL", "--seed", "1", "--json"),),
        (),
        without_numbers,
        asks=True,
    ),
    Exercise(
        "probe",
        (("probe", "openai:m", "--base-url", "URL", "--frames", "bank", "--out", "found.toml"),),
        ("bank",),
        lambda folder, _: re.findall(
            r"(?m)^(?:spec|max_tokens|token_field|stream|system) = .*", (folder / "found.toml").read_text()
        ),
        ("found.toml",),
        asks=True,
    ),
    Exercise(
        "merge", (("merge", "shard-1", "shard-2", "--out", "out"),), ("shard-1", "shard-2"), replies("out"), ("out",)
    ),
    Exercise("verdict", (("verdict", "run", "--json"),), ("run",), printed, (), ("run",)),
    Exercise("score", (("score", "run", "--json"), ("costs", "run", "--json")), ("run",), printed, (), ("run",)),
    Exercise(
        "gate", (("gate", "run", "--require", "depth", "--junit", "junit.xml"),), ("run",), printed, ("junit.xml",)
    ),
    Exercise("compare", (("compare", "run", "cut"),), ("run", "cut", "bank"), printed),
    Exercise(
        "transfer",
        (("transfer", "run", "--scores", "scores.csv"),),
        ("run", "scores.csv"),
        printed,
        (),
        ("scores.csv",),
    ),
    Exercise("report", (("report", "run", "--out", "page.html"),), ("run", "bank"), files("page.html"), ("page.html",)),
    Exercise(
        "paper", (("paper", "run", "drives", "--out", "paper"),), ("run", "drives", "bank"), files("paper"), ("paper",)
    ),
    Exercise(
        "bundle", (("bundle", "run", "--out", "out.zip"),), ("run", "bank"), packed("out.zip"), ("out.zip",), ("run",)
    ),
    Exercise("validate", (("validate", "run.zip"),), ("run.zip",), printed, (), ("run.zip",)),
    Exercise(
        "drives",
        ((*DRIVES, "--out", "out"),),
        (),
        episodes("out"),
        ("out",),
    ),
    Exercise(
        "drives resumed",
        (
            (*DRIVES, "--out", "drives"),
            ("score", "drives"),
            ("audit", "drives"),
            ("report", "drives", "--out", "p.html"),
        ),
        ("drives",),
        episodes("drives"),
        (),
        ("drives",),
    ),
    Exercise(
        "drives validated",
        (("bundle", "drives", "--out", "out.zip"), ("validate", "out.zip")),
        ("drives",),
        printed,
        ("out.zip",),
        ("drives",),
        truth=True,
    ),
    Exercise(
        "film",
        (("film", "run", "--frame", "dense-0-0", "--out", "film.gif"),),
        ("run", "bank"),
        files("film.gif"),
        ("film.gif",),
        ("run",),
    ),
    Exercise(
        "film of a drive",
        (("film", "drives", "--episode", "constant:SLOW", "--out", "film.html"),),
        ("drives",),
        files("film.html"),
        ("film.html",),
        ("drives",),
    ),
    Exercise(
        "film of a drive in MP4",
        (("film", "drives", "--episode", "constant:SLOW", "--out", "film.mp4"),),
        ("drives",),
        files("film.mp4"),
        ("film.mp4",),
        arrow=True,
    ),
    Exercise(
        "index",
        (("report", ".", "--out", "pages"),),
        ("run", "drives", "bank"),
        files("pages"),
        ("pages",),
        page="pages",
    ),
    Exercise("list", (("list", "models"), ("list", "modes"), ("list", "modes", "structured-qwen3.5-9b")), (), printed),
    Exercise(
        "fit",
        (
            ("guardian", "fit", "votes.csv", "--about", "votes.toml", "--calibration", "ids.txt", "--out", "fit.json"),
            ("guardian", "export", "fit.json", "--out", "stack.json"),
        ),
        ("votes.csv", "votes.toml", "ids.txt"),
        files("fit.json", "stack.json"),
        ("fit.json", "stack.json"),
        ("votes.csv", "votes.toml", "ids.txt"),
    ),
    Exercise(
        "import of a rig",
        (("frames", "import", "photos", "--table", "photos.csv", *_RIGGED, "--rig", "rig.toml", "--out", "out"),),
        ("photos", "photos.csv", "rover.toml", "rig.toml"),
        files("out"),
        ("out",),
        ("rig.toml",),
    ),
    Exercise(
        "import for policies",
        (
            (
                "frames",
                "import",
                "arm",
                "--format",
                "lerobot",
                "--horizon",
                "2",
                "--kind",
                "absolute",
                "--every",
                "2",
                "--out",
                "out",
            ),
        ),
        ("arm",),
        files("out"),
        ("out",),
        ("arm",),
        arrow=True,
    ),
    Exercise(
        "estimates",
        (
            (
                "run",
                "structured",
                "--model",
                "scripted:scene_positive_control",
                "--frames",
                "road",
                "--limit",
                "4",
                "--out",
                "out",
            ),
            ("score", "out", "--json"),
        ),
        ("road",),
        replies("out"),
        ("out",),
    ),
    Exercise(
        "estimates that drive",
        (("run", "online", "--model", "scripted:scene_side_blind", "--episodes", "1", "--out", "out"),),
        (),
        episodes("out"),
        ("out",),
    ),
    Exercise(
        "answers validated",
        (
            ("run", "import", "answers.jsonl", "--model", "mine", *ASKED, "--out", "out"),
            ("bundle", "out", "--out", "out.zip"),
            ("validate", "out.zip"),
        ),
        ("bank", "answers.jsonl"),
        printed,
        ("out", "out.zip"),
    ),
    Exercise(
        "import",
        (("frames", "import", "photos", "--table", "photos.csv", *_TABLE, "--out", "out"),),
        ("photos", "photos.csv", "rover.toml"),
        files("out"),
        ("out",),
        ("photos.csv", "rover.toml", "photos"),
    ),
    Exercise(
        "edit",
        (
            (
                *("frames", "edit", "roads", "--table", "roads.csv", "--objects", "boxes.csv", "--cut", "box"),
                *("--near", "4:6", "--far", "15:20", "--lane", "3", "--eye", "1.5", "--out", "out"),
            ),
        ),
        ("roads", "roads.csv", "boxes.csv"),
        files("out"),
        ("out",),
        ("roads.csv", "boxes.csv", "roads"),
    ),
    *(
        Exercise(
            f"edit of {form}",
            (
                (
                    *("frames", "edit", pictures, "--objects", objects, "--format", form, "--cut", "box"),
                    *("--near", "4:6", "--far", "15:20", "--lane", "3", "--eye", "1.5", *table, "--out", "out"),
                ),
            ),
            (form, "roads.csv"),
            files("out"),
            ("out",),
            (objects,),
        )
        for form, pictures, objects, table in (
            ("coco", "coco/images", "coco/instances.json", ("--table", "roads.csv")),
            ("nuscenes", "nuscenes", "nuscenes/v1.0-mini", ()),
        )
    ),
    Exercise(
        "import of lines",
        (("frames", "import", "photos", "--table", "photos.jsonl", *_TABLE, "--out", "out"),),
        ("photos", "photos.jsonl", "rover.toml"),
        files("out"),
        ("out",),
        ("photos.jsonl",),
    ),
    Exercise(
        "import of Parquet",
        (("frames", "import", "photos", "--table", "photos.parquet", *_TABLE, "--out", "out"),),
        ("photos", "photos.parquet", "rover.toml"),
        files("out"),
        ("out",),
        ("photos.parquet",),
        arrow=True,
    ),
    Exercise(
        "import of LeRobot",
        (
            (
                *("frames", "import", "set", "--format", "lerobot", "--every", "2", "--map"),
                *("gap=observation.state.gap", "--threshold", "18", "--unit", "m", "--out", "out"),
            ),
        ),
        ("set",),
        files("out"),
        ("out",),
        ("set",),
        arrow=True,
    ),
    Exercise(
        "import of demonstrations",
        (("frames", "import", "demos.hdf5", "--horizon", "2", "--kind", "delta", "--out", "out"),),
        ("demos.hdf5",),
        files("out"),
        ("out",),
        ("demos.hdf5",),
        arrow=True,
    ),
    Exercise(
        "import of episode files",
        (
            (
                *("frames", "import", "old-set", "--format", "lerobot", "--every", "2", "--horizon", "2"),
                *("--kind", "absolute", "--out", "out"),
            ),
        ),
        ("old-set",),
        files("out"),
        ("out",),
        ("old-set",),
        arrow=True,
    ),
    Exercise(
        "build",
        (("frames", "build", "tabletop", "--steps", "4", "--seeds", "0,1", "--out", "out"),),
        (),
        files("out"),
        ("out",),
    ),
    Exercise("check", (("frames", "check", "bank"),), ("bank",), printed, (), ("bank",)),
    Exercise(
        "export", (("frames", "export", *ASKED[1:], "--out", "out"),), ("bank",), files("out"), ("out",), ("bank",)
    ),
    Exercise(
        "answers",
        (("run", "import", "answers.jsonl", "--model", "mine", *ASKED, "--out", "out"),),
        ("bank", "answers.jsonl"),
        replies("out"),
        ("out",),
        ("answers.jsonl",),
    ),
    Exercise(
        "log",
        (("run", "import", "log.eval", *ASKED, "--out", "out"),),
        ("bank", "log.eval"),
        replies("out"),
        ("out",),
        ("log.eval",),
    ),
    Exercise(
        "log in JSON",
        (("run", "import", "log.json", *ASKED, "--out", "out"),),
        ("bank", "log.json"),
        replies("out"),
        ("out",),
        ("log.json",),
    ),
    Exercise(
        "policies",
        (("run", "policy", "--policy", "trained:sees", "--frames", "table", "--limit", "4", "--out", "out"),),
        ("table",),
        replies("out"),
        ("out",),
        ("table",),
    ),
    Exercise(
        "policies scored",
        (("verdict", "policy", "--json"), ("score", "policy", "--json")),
        ("policy", "table"),
        printed,
        (),
        ("policy",),
    ),
    Exercise(
        "guardian",
        (("guardian", "score", "guardian.json", "votes.csv", "--about", "votes.toml"),),
        ("guardian.json", "votes.csv", "votes.toml"),
        printed,
        (),
        ("guardian.json", "votes.csv", "votes.toml"),
    ),
    Exercise(
        "calibrate",
        (
            (
                "calibrate",
                "--processes",
                "1",
                "--setting",
                "small_10",
                "--replications",
                "1",
                "--keep",
                "kept",
                "--json",
            ),
        ),
        (),
        printed,
        ("kept",),
    ),
    Exercise(
        "calibrate in processes",
        (("calibrate", "--processes", "2", "--replications", "40"),),
        (),
        printed,
        parents=True,
    ),
    Exercise(
        "calibrate policies",
        (("calibrate", "--policies", "--processes", "2", "--replications", "40"),),
        (),
        printed,
        parents=True,
    ),
    Exercise(
        "ladder in processes",
        (("ladder", "--simulator", "rover", "--seeds", "8", "--processes", "2", "--out", "out"),),
        (),
        episodes("out"),
        ("out",),
        parents=True,
    ),
)
EXERCISES = {one.name: one for one in _LIST}


def as_json(seen: object) -> str:
    """Return what was seen as a text that can be compared and kept."""
    return json.dumps(seen, sort_keys=True, default=str)
