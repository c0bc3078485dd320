"""Files that a user may be sent, each broken by mutation, and what reads them: an answer, or an error in words."""

import hashlib
import json
import os
import random
import shutil
import sqlite3
import warnings
from collections.abc import Callable, Mapping
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import banks
import data_sets
import stand_ins
from bundles import repacked
from eyechart.bundle import validate, write_bundle
from eyechart.calls import CallKey, Reply
from eyechart.errors import EyechartError
from eyechart.frames import check
from eyechart.importing import Choices, Horizon, import_lerobot
from eyechart.importing.tables import open_table
from eyechart.ledger import Ledger
from eyechart.modes import read_mode
from eyechart.prompts import read_prompt
from eyechart.studies import guardian
from published_votes import published
from report_runs import make_run

MODE = b"""spec = "openai:some/model"
base_url = "http://127.0.0.1:8000/v1"
key_env = "SOME_KEY"
max_tokens = 64
temperature = 0.5
timeout_s = 30.0
structured = "json_object"
headers = { X-Name = "value" }
[options]
think = false
"""
PROMPT = """name = "mine"
system = "You are a pilot."
user = "Choose one of {actions}."
[action_space]
name = "boat"
actions = ["HALT", "GO", "PORT", "STARBOARD"]
mirror_pairs = [["PORT", "STARBOARD"]]
braking = ["HALT"]
proceeding = ["GO"]
"""
ROWS = [
    {"image": f"{index}.png", "episode": "a", "step": index, "gap_m": index * 0.5, "lane": "left"} for index in range(6)
]
STRANGE: tuple[Any, ...] = (
    *(None, True, [], {}, [[]], "", 0, -1, 2.5, 10**400, 1e308, -1e308, float("nan"), float("inf"), "x" * 10_000),
    *("\x1b[2J", "\ud800", "=1+1", "../../up", "/etc/passwd", [0] * 10_000, {"a": {"a": {"a": []}}}, "\u202e", "NaN"),
)
"""What a place of a file may hold that nobody expects there."""
TOKENS = (
    *(b"[" * 2_000, b"{" * 2_000, b'"', b"'", b"\\", b"\x00", b"\xff\xfe", b"1e999", b"9" * 4_500, b"\n", b"\r", b","),
    *(
        b"nan",
        b"null",
        b"[[x]]\n",
        b'""\x22',
        b"\xef\xbb\xbf",
        b"\\u0000",
        b"\\ud800",
        b"=",
        b"#",
        b"1979-05-27T07:32:00Z",
    ),
)


def cut_or_insert(text: bytes, dice: random.Random) -> bytes:
    """Return bytes with one to three changes: a bit, a part left out, doubled or moved, or what nobody expects."""
    for _ in range(dice.randint(1, 3)):
        start = dice.randrange(len(text) + 1)
        end = min(len(text), start + dice.choice((1, 8, 200)))
        part, kind = text[start:end], dice.randrange(5)
        if kind == 0 and part:
            part = bytes([part[0] ^ (1 << dice.randrange(8))]) + part[1:]
        elif kind == 1:
            part = b""
        elif kind == 2:
            part += part
        elif kind == 3:
            part = dice.choice(TOKENS) + part
        else:
            return text[:start] if dice.random() < 0.2 else text[:start] + bytes(reversed(part)) + text[end:]
        text = text[:start] + part + text[end:]
    return text


def other_values(raw: Any, dice: random.Random) -> Any:  # noqa: ANN401 - JSON of any shape
    """Return JSON with one place that holds another value, another place's, none, or more."""
    places: list[tuple[Any, Any]] = []
    left = [raw]
    while left:
        one = left.pop()
        inner = one.items() if isinstance(one, dict) else enumerate(one) if isinstance(one, list) else ()
        for name, value in inner:
            places.append((one, name))
            left.append(value)
    holder, name = dice.choice(places)
    if dice.random() < 0.15 and isinstance(holder, dict):
        holder[dice.choice(("more", "", "format", "\x1b"))] = holder.pop(name)
    else:
        other, its = dice.choice(places)
        holder[name] = dice.choice((dice.choice(STRANGE), json.loads(json.dumps(other[its]))))
    return raw


def in_json(text: bytes, dice: random.Random) -> bytes:
    """Return JSON that another value stands in, its digest mended in half of all cases; or changed as any bytes."""
    if dice.random() < 0.3:
        return cut_or_insert(text, dice)
    raw = other_values(json.loads(text), dice)
    if "digest" in raw and dice.random() < 0.5:
        del raw["digest"]
        raw["digest"] = hashlib.sha256(json.dumps(raw, sort_keys=True).encode()).hexdigest()
    return json.dumps(raw).encode()


def in_rows(path: Path, dice: random.Random) -> None:
    """Change a value of a ledger by SQL, its triggers standing as before, or its schema."""
    with closing(sqlite3.connect(path)) as sql:
        triggers = sql.execute("SELECT name, sql FROM sqlite_master WHERE type = 'trigger'").fetchall()
        for name, _ in triggers:
            sql.execute(f"DROP TRIGGER {name}")
        table = dice.choice(("calls", "attempts", "replies"))
        column = dice.choice([row[1] for row in sql.execute(f"PRAGMA table_info({table})")])
        value = dice.choice((None, -1, 2**62, 1e308, "", "x" * 5_000, "\x1b[2J", b"\xff\x00", "\x00", 0.5))
        try:
            sql.execute(f"UPDATE {table} SET {column} = ? WHERE rowid = ?", (value, dice.randint(1, 4)))  # noqa: S608
        except sqlite3.Error:  # what SQLite itself does not take
            sql.execute(f"DELETE FROM {table} WHERE rowid = ?", (dice.randint(1, 4),))  # noqa: S608 - our own
        for _, text in triggers[: None if dice.random() < 0.8 else -1]:
            sql.execute(text)
        sql.commit()


def read_ledger(path: Path) -> None:
    """Read all of a ledger, as commands do, and as `validate` does that names each damaged row."""
    for sound in (True, False):
        try:
            with Ledger(path, sound=sound) as ledger:
                _ = ledger.damaged(), ledger.unchecked(), ledger.finished(), ledger.unknown(), ledger.held()
                for model in ledger.models():
                    _ = list(ledger.replies(model)), list(ledger.attempts(model))
        except EyechartError:
            continue
        except sqlite3.Error:
            if sound:  # `validate` says it in words
                raise


@dataclass(frozen=True)
class Subject:
    """A kind of file: what it is made of, what breaks it, and what reads it."""

    name: str
    seeds: Mapping[str, bytes]
    change: Callable[[bytes, random.Random], bytes]
    read: Callable[[Path], object]

    def wrong(self, number: int, folder: Path) -> str | None:
        """Return what a reader did with one mutation that is neither an answer nor an error in words."""
        dice = random.Random(f"{self.name} {number}")  # noqa: S311 - which mutation, no secret
        name = dice.choice(sorted(self.seeds))
        path = folder / name
        if self.name == "ledgers" and dice.random() < 0.4:
            path.write_bytes(self.seeds[name])
            in_rows(path, dice)
        else:
            path.write_bytes(self.change(self.seeds[name], dice))
        return failure(lambda: self.read(path), f"{self.name} {number}")


def failure(read: Callable[[], object], what: str) -> str | None:
    """Return how a reader failed; None where it answered, or raised an error of the project's, of one line."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            read()
    except EyechartError as error:
        return None if len(str(error)) < 20_000 else f"{what}: an error of {len(str(error))} characters"
    except Exception as error:  # noqa: BLE001 - any other is what is looked for
        return f"{what}: {type(error).__name__}: {str(error)[:200]}"
    return None


def subjects(work: Path) -> dict[str, Subject]:
    """Return the kinds of single files, made in a folder."""
    frozen = guardian.fit(published().part("calibration"))
    guardian.write_frozen(work / "guardian.json", frozen)
    guardian.write_frozen(work / "exported.json", frozen.exported())
    with Ledger(work / "ledger.sqlite", create=True) as ledger:
        keys = [CallKey("battery", "m", "p", f"f{index}", "real") for index in range(4)]
        for key in keys[1:]:
            ledger.close(ledger.begin(key, "digest"), Reply("GO", "stop", None, "", 10, 9, 0.5))
        ledger.begin(keys[0], "digest")
    lines = [",".join(ROWS[0]), *(",".join(map(str, row.values())) for row in ROWS)]
    tables = {
        "t.csv": "\n".join(lines).encode(),
        "t.tsv": "\n".join(lines).replace(",", "\t").encode(),
        "t.jsonl": "\n".join(map(json.dumps, ROWS)).encode(),
    }
    guardians = {name: (work / name).read_bytes() for name in ("guardian.json", "exported.json")}
    found = (
        Subject("ledgers", {"ledger.sqlite": (work / "ledger.sqlite").read_bytes()}, cut_or_insert, read_ledger),
        Subject("modes", {"mode.toml": MODE}, cut_or_insert, read_mode),
        Subject("prompts", {"prompt.toml": PROMPT.encode()}, cut_or_insert, read_prompt),
        Subject("tables", tables, cut_or_insert, lambda path: list(open_table(path).rows)),
        Subject("guardians", guardians, in_json, guardian.read_frozen),
    )
    for file in work.iterdir():
        file.unlink()
    return {one.name: one for one in found}


def wholes(work: Path) -> dict[str, Callable[[int, Path], str | None]]:
    """Return what breaks and reads whole bundles and banks, by number and a folder to work in."""
    bank = banks.build_bank(work / "bank", episodes=1)
    run = make_run(bank.root, work / "run", {"noisy": stand_ins.noisy})
    write_bundle(run, work / "run.zip", resamples=100)

    def change(folder: Path, dice: random.Random) -> None:
        names = sorted(path for path in folder.rglob("*") if path.is_file() and path.name != "bundle.json")
        chosen = dice.choice([path for path in names if path.suffix in {".json", ".jsonl", ".sqlite"}] + names[:1])
        text = chosen.read_bytes()
        if chosen.suffix == ".json":
            text = in_json(text, dice)
        elif chosen.suffix == ".jsonl":
            lines = text.splitlines()
            at = dice.randrange(len(lines))
            text = b"\n".join([*lines[:at], in_json(lines[at], dice), *lines[at + 1 :]])
        else:
            text = cut_or_insert(text, dice)
        chosen.write_bytes(text)

    def bundles(number: int, folder: Path) -> str | None:
        dice = random.Random(f"bundle {number}")  # noqa: S311 - which mutation, no secret
        if dice.random() < 0.2:
            made = folder / "b.zip"
            made.write_bytes(cut_or_insert((work / "run.zip").read_bytes(), dice))
        else:
            made = repacked(work / "run.zip", folder, lambda opened: change(opened, dice))
        return failure(lambda: validate(made), f"bundles {number}")

    def whole_banks(number: int, folder: Path) -> str | None:
        dice = random.Random(f"bank {number}")  # noqa: S311 - which mutation, no secret
        shutil.copytree(bank.root, folder, dirs_exist_ok=True)
        if dice.random() < 0.3:
            one = dice.choice(sorted((folder / "images").iterdir()))
            one.write_bytes(cut_or_insert(one.read_bytes(), dice))
        else:
            change(folder, dice)
        return failure(lambda: check(folder), f"banks {number}")

    return {"bundles": bundles, "banks": whole_banks}


def data_set(work: Path) -> Callable[[int, Path], str | None]:
    """Return what breaks and imports whole LeRobotDatasets, by number and a folder; it needs pyarrow and PyAV."""
    for inside in (False, True):
        data_sets.arm(work / str(inside), inside=inside, episodes=2, length=6)

    def wrong(number: int, folder: Path) -> str | None:
        dice = random.Random(f"data set {number}")  # noqa: S311 - which mutation, no secret
        root = folder / "set"
        shutil.copytree(work / str(dice.random() < 0.5), root)
        (folder / "elsewhere").write_text("of another")
        for _ in range(dice.randint(1, 2)):
            in_data_set(root, dice)
        ahead = Horizon(2, dice.choice((None, "delta")))
        choices = Choices(every=dice.choice((1, 3)))
        return failure(lambda: import_lerobot(root, folder / "bank", choices, ahead=ahead), f"data sets {number}")

    return wrong


def in_data_set(root: Path, dice: random.Random) -> None:
    """Change one file of a data set: what info.json says, cells of a column, its name or its bytes, or what it is."""
    path = dice.choice(sorted(one for one in root.rglob("*") if one.is_file() and not one.is_symlink()))
    kind, info = dice.random(), root / "meta/info.json"
    if kind < 0.1:
        path.unlink()
        dice.choice((os.mkfifo, path.__class__.mkdir, lambda one: one.symlink_to(root.parent / "elsewhere")))(path)
    elif kind < 0.2:
        path.write_bytes(cut_or_insert(path.read_bytes(), dice))
    elif kind < 0.5 and info.is_file():
        with suppress(OSError, ValueError, RecursionError):  # it is no JSON already
            info.write_bytes(in_json(info.read_bytes(), dice))
    elif path.suffix == ".parquet":
        with suppress(
            OSError, ValueError, TypeError, ArithmeticError, NotImplementedError
        ):  # it is broken already, or pyarrow cannot write what was chosen
            data_sets.rewrite(path, lambda rows: other_cells(rows, dice))


def other_cells(rows: list[dict[str, Any]], dice: random.Random) -> list[dict[str, Any]]:
    """Return rows that are in another order or fewer, or with other cells in a column, or another name of it."""
    name, kind = dice.choice([*rows[0]]), dice.randrange(6)
    if kind == 0:
        return [*rows, *dice.sample(rows, 1)]
    if kind == 1:
        return dice.sample(rows, dice.randint(1, len(rows)))
    if kind == 2:
        return [{f"{one}x" if one == name else one: cell for one, cell in row.items()} for row in rows]
    strange = dice.choice((*STRANGE, 0.5, 2**62, -0.0, 1e-308, "9" * 5_000, None, [float("nan")] * 2, [None, 1.0]))
    if kind == 3:
        return [row | {name: strange} for row in rows]
    rows[dice.randrange(len(rows))][name] = dice.choice((strange, dice.choice(rows)[name], dice.choice(rows)[name]))
    return rows
