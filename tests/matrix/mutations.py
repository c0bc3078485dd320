"""What others may have written: values, templates, deep and wide JSON, rows that contradict, links and pipes."""

import copy
import csv
import io
import json
import os
import random
import re
import shutil
import zipfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from mutated_files import STRANGE, cut_or_insert

WIDE_BYTES = 48_000_000
"""Bytes of what is wide and empty: so many small objects take some thirty times as much in memory."""
TEXTS = {".json", ".jsonl", ".csv", ".tsv", ".toml"}
RECORDS = {".jsonl", ".csv", ".parquet"}
TEMPLATES = (
    "{%s:>3000000000}",
    "{%s:.999999999f}",
    "{%s[0]}",
    "{%s[abc]}",
    "{%s.__class__.__mro__}",
    "{%s!r:>2000000000}",
)
CELLS: tuple[Any, ...] = (
    "x",
    "9" * 5_000,
    0.5,
    -1,
    2**62,
    float("nan"),
    float("inf"),
    1e300,
    1e-308,
    "../../x",
    "{0.__class__}",
)

Change = Callable[[Path], None]


def files_of(folder: Path, names: Sequence[str], endings: set[str]) -> list[str]:
    """Return the files of inputs that end so, the first of those whose names differ in numbers alone."""
    found: dict[str, str] = {}
    for name in names:
        root = folder / name
        for path in sorted(root.rglob("*")) if root.is_dir() else [root]:
            if path.is_file() and path.suffix in endings:
                inner = path.relative_to(folder).as_posix()
                found.setdefault(re.sub(r"\d+", "#", inner), inner)
    return sorted(found.values())


def rows_of(path: Path) -> list[dict[str, Any]]:
    """Return the rows of a table, each a dictionary."""
    if path.suffix == ".parquet":
        import pyarrow.parquet as pq  # noqa: PLC0415 - an extra

        rows: list[dict[str, Any]] = pq.read_table(path).to_pylist()
        return rows
    if path.suffix == ".csv":
        return [dict(row) for row in csv.DictReader(io.StringIO(path.read_text()))]
    return [json.loads(line) for line in path.read_text().splitlines() if line.strip()]


def write_rows(path: Path, rows: list[dict[str, Any]]) -> None:
    """Write the rows of a table, of the kind that its name ends with; raises where its kind cannot hold them."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    if path.suffix == ".parquet":
        import pyarrow as pa  # noqa: PLC0415 - an extra
        import pyarrow.parquet as pq  # noqa: PLC0415 - an extra

        pq.write_table(pa.table({name: [row.get(name) for row in rows] for name in names}), path)
    elif path.suffix == ".csv":
        with path.open("w", newline="") as file:
            writer = csv.DictWriter(file, names)
            writer.writeheader()
            writer.writerows(rows)
    else:
        path.write_text("".join(json.dumps(row, separators=(",", ":")) + "\n" for row in rows))


def other(value: object) -> Any:  # noqa: ANN401 - of the value's kind
    """Return another value of a value's kind that is as likely as it."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int | float):
        return value + type(value)(2)
    if isinstance(value, str):
        try:
            return str(float(value) + 2.0)
        except ValueError:
            return f"{value}x"
    if isinstance(value, dict) and value:
        *before, last = value
        return {**{name: value[name] for name in before}, last: other(value[last])}
    return value[:-1] if isinstance(value, list) and value else "x"


def kinds(path: Path, most: int, *, truth: bool) -> dict[str, list[tuple[str, Change]]]:
    """Return the kinds of changes that fit a file, by their names; ``most`` of those without an end."""
    result: dict[str, list[tuple[str, Change]]] = {}
    result["broken bytes"], result["wide and deep"] = list(noise(most)), list(wide(path))
    if path.suffix in RECORDS:
        result["contradiction"] = list(contradictions(path))
    if path.suffix == ".parquet":
        result["cells"] = list(cells(path))
    if path.suffix in TEXTS:
        result["templates"] = list(templates(path))
    if path.suffix in {".json", ".jsonl"}:
        result["values"] = list(values())[: 4 * most]
    if path.suffix == ".json":
        result["numbers"] = list(numbers(path))
    if path.suffix == ".jsonl" and truth:
        result["emptied record"] = list(emptied(path))
    return result


def contradictions(path: Path) -> Iterator[tuple[str, Change]]:
    """Yield for every column of a table: its first row stands there again, and says otherwise of that column.

    Under another frame's name it is another frame, and contradicts nothing, unless a picture is named beside it.
    """
    for name in rows_of(path)[0]:
        if name == "frame" and path.name == "votes.csv":
            continue

        def change(file: Path, name: str = name) -> None:
            rows = rows_of(file)
            again = copy.deepcopy(rows[0])
            again[name] = other(again[name])
            write_rows(file, [*rows, again])

        yield f"a row again, other in {name}", change


def cells(path: Path) -> Iterator[tuple[str, Change]]:
    """Yield for every column of a Parquet file and strange value: the column holds it."""
    for name in rows_of(path)[0]:
        for value in CELLS:

            def change(file: Path, name: str = name, value: object = value) -> None:
                rows = rows_of(file)
                for row in rows:
                    row[name] = [value] * len(row[name]) if isinstance(row[name], list) else value
                write_rows(file, rows)

            yield f"{name} is {value!r:.20}", change


def emptied(path: Path) -> Iterator[tuple[str, Change]]:
    """Yield for records of JSON lines: one has empty lists and digests, and says that it failed."""
    for name, value in rows_of(path)[-1].items():
        if not isinstance(value, str) or re.fullmatch("[0-9a-f]{16,}", value) or not value:
            continue

        def change(file: Path, name: str = name) -> None:
            rows = rows_of(file)
            one = rows[-1]
            for key, held in one.items():
                if isinstance(held, list):
                    one[key] = []
                elif isinstance(held, str) and re.fullmatch("[0-9a-f]{16,}", held):
                    one[key] = ""
            one[name] = "error"
            write_rows(file, rows)

        yield f"a record is empty, {name} is error", change


def places(raw: Any) -> list[tuple[Any, Any]]:  # noqa: ANN401 - JSON of any shape
    """Return every place of JSON as (what holds it, its key or index)."""
    result: list[tuple[Any, Any]] = []
    left = [raw]
    while left:
        one = left.pop()
        inner = one.items() if isinstance(one, dict) else enumerate(one) if isinstance(one, list) else ()
        for name, value in inner:
            result.append((one, name))
            left.append(value)
    return result


def in_json(path: Path, change: Callable[[Any], None]) -> None:
    """Change the JSON of a file; of JSON lines the last line."""
    text = path.read_text()
    head, last = ("", text)
    if path.suffix == ".jsonl":
        *lines, last = text.splitlines()
        head = "".join(f"{line}\n" for line in lines)
    raw = json.loads(last)
    change(raw)
    path.write_text(head + json.dumps(raw) + "\n")


def templates(path: Path) -> Iterator[tuple[str, Change]]:
    """Yield for each kind of template: every field in braces that a file's texts hold is written so."""
    if not re.search(r"\{\w+(:[^}]*)?\}", path.read_text(errors="replace")):
        return
    for template in TEMPLATES:

        def change(file: Path, one: str = template) -> None:
            text = file.read_text()
            file.write_text(re.sub(r"\{(\w+)(:[^{}\"]*)?\}", lambda found: one % found.group(1), text))

        yield f"templates are {template % 'x'}", change


def values() -> Iterator[tuple[str, Change]]:
    """Yield one strange value at one place of JSON after the other; the place follows from the value's number."""
    for number, value in enumerate(STRANGE):

        def change(file: Path, number: int = number, value: object = value) -> None:
            def put(raw: Any) -> None:  # noqa: ANN401 - JSON
                all_places = places(raw)
                holder, name = all_places[random.Random(f"{file.name} {number}").randrange(len(all_places))]  # noqa: S311
                holder[name] = value

            in_json(file, put)

        yield f"value {number}", change


def numbers(path: Path) -> Iterator[tuple[str, Change]]:
    """Yield for every number at the top of JSON: it is none, not finite, tiny or huge."""
    raw = json.loads(path.read_text())
    for name, held in raw.items() if isinstance(raw, dict) else ():
        if isinstance(held, int | float) and not isinstance(held, bool):
            for value in (float("nan"), float("inf"), 1e308, 1e-308, -1, 0):
                yield (
                    f"{name} is {value}",
                    lambda file, name=name, value=value: in_json(file, lambda raw: raw.update({name: value})),
                )


def wide(path: Path) -> Iterator[tuple[str, Change]]:
    """Yield deep JSON, and JSON with a member of very many empty objects, in a file or a file of an archive."""
    many = b'"more":[' + b"{}," * (WIDE_BYTES // 3) + b"{}]"

    def widened(text: bytes) -> bytes:
        return text.rstrip()[:-1] + b"," + many + b"}"

    def deepened(text: bytes) -> bytes:
        return text.rstrip()[:-1] + b',"more":' + b"[" * 100_000 + b"]" * 100_000 + b"}"

    for label, change in (("very wide", widened), ("very deep", deepened)):
        if path.suffix in {".zip", ".eval"}:
            with zipfile.ZipFile(path) as archive:
                inner = [name for name in archive.namelist() if name.endswith(".json")]
            for name in dict.fromkeys(re.sub(r"\d+", "#", name) for name in inner):
                first = next(one for one in inner if re.sub(r"\d+", "#", one) == name)
                yield f"{first} is {label}", lambda file, change=change, first=first: repack(file, first, change)
        elif path.suffix == ".json":
            yield label, lambda file, change=change: file.write_bytes(change(file.read_bytes())) and None


def repack(path: Path, name: str, change: Callable[[bytes], bytes]) -> None:
    """Change one file of an archive."""
    with zipfile.ZipFile(path) as archive:
        held = {one: archive.read(one) for one in archive.namelist()}
    held[name] = change(held[name])
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for one, text in held.items():
            archive.writestr(one, text)


def noise(count: int) -> Iterator[tuple[str, Change]]:
    """Yield so many changes of bytes: cut, doubled, moved, or with tokens that nobody expects."""
    for number in range(count):

        def change(file: Path, number: int = number) -> None:
            file.write_bytes(cut_or_insert(file.read_bytes(), random.Random(f"{file.name} {number}")))  # noqa: S311

        yield f"bytes {number}", change


def pipe(path: Path) -> None:
    """Put a named pipe, which nobody writes to, in a file's place."""
    path.unlink()
    os.mkfifo(path)


def link_out(path: Path) -> None:
    """Put a link to a file of the same content, outside of what is read, in a file's place."""
    outside = Path(os.environ.get("MATRIX_OUTSIDE", "outside")).absolute()
    outside.mkdir(exist_ok=True)
    target = outside / path.name
    shutil.move(path, target)
    path.symlink_to(target)


def as_in_a_cache(root: Path) -> None:
    """Make a folder one of links to blobs beside it, as a cache of the Hub has a snapshot."""
    kept = root.parent / "datasets--a--set"
    snapshot, blobs = kept / "snapshots" / "0123abcd", kept / "blobs"
    blobs.mkdir(parents=True)
    snapshot.parent.mkdir()
    root.rename(snapshot)
    for number, path in enumerate(sorted(one for one in snapshot.rglob("*") if one.is_file())):
        path.rename(blobs / f"{number:064x}")
        path.symlink_to(os.path.relpath(blobs / f"{number:064x}", path.parent))
    root.symlink_to(snapshot, target_is_directory=True)
