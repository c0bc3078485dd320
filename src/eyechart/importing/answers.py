"""Answers from other programs, read strictly from a table; faults name their row."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import cast, get_args

from eyechart.calls import MOST, ErrorKind, Reply, invalid_field
from eyechart.errors import SourceError, printable
from eyechart.importing.cells import MOST_CELL, Cell, Progress, Row, plain_name, read_number
from eyechart.importing.faults import Faults
from eyechart.importing.tables import SourceTable, open_table

MOST_ROWS = 5_000_000
MOST_REPEATS = 1_000
_NUMBERS = tuple(name for name in MOST if name not in {"status", "retry_after_s", "payload_bytes", "energy_j"})
_WORDS = ("text", "finish_reason", "error", "reasoning", "served", "provider", "system_fingerprint")
_LABELS = ("finish_reason", "served", "provider", "system_fingerprint")
"""The text fields that are names of one short line."""
TOLD = (*_NUMBERS, *_LABELS, "reasoning")
"""The fields of a reply that a row may have in addition to its text and its error."""
_MOST_LABEL = 200
_KEYS = ("call", "frame", "condition", "repeat")
ALIASES: Mapping[str, str] = MappingProxyType(
    {
        "answer": "text",
        "response": "text",
        "reply": "text",
        "latency": "seconds",
        "latency_s": "seconds",
        "cost": "cost_usd",
        "model": "served",
        "input_tokens": "prompt_tokens",
        "output_tokens": "completion_tokens",
    }
)
"""Other names of columns with the same meaning."""
_KNOWN = (*_KEYS[1:], "request_sha256", *_WORDS, *_NUMBERS, *ALIASES)
"""Columns that may be missing in some rows."""


@dataclass(frozen=True, slots=True)
class ImportedAnswer:
    """An answer from another program: its call's key, what the row says of it, and the reply.

    ``reply`` is None if the row has no answer. ``where`` names the row.
    """

    where: str
    call: str
    frame: str | None
    condition: str | None
    repeat: int
    request_sha256: str | None
    reply: Reply | None


def read_answer_table(path: Path, faults: Faults, progress: Progress | None = None) -> Iterator[ImportedAnswer]:
    """Yield the answers of a CSV, JSON lines or Parquet file in order, in bounded memory.

    A faulty row is added to ``faults`` and left out. Raises SourceError if the file cannot be read,
    or has no columns ``call`` and ``text``.
    """
    table = open_table(path, progress, optional=_KNOWN)
    named = _named(path, table)
    for number, row in enumerate(table.rows, 1):
        if number > MOST_ROWS:
            raise SourceError(f"{path} has more than {MOST_ROWS} rows; cut it into parts")
        where, made = f"{path.name}, row {number}", list[ImportedAnswer]()
        with faults.noted():
            made += [_answered(where, _meant(where, row, named))] if row else []
        yield from made
    faults.join(table.faults)


def meaning(column: str) -> str:
    """Return a column's meaning, whatever its case and separators; an unknown name stays."""
    plain = plain_name(column)
    return ALIASES.get(plain, plain if plain in (*_KEYS, *_KNOWN) else column)


def _named(path: Path, table: SourceTable) -> dict[str, str]:
    """Return each column's meaning; raises SourceError if a required one is missing."""
    named = {name: meaning(name) for name in table.columns}
    unread = f"; of a type that is not read are {', '.join(table.unread)}" if table.unread else ""
    for needed in ("call", "text"):
        if needed not in named.values():
            raise SourceError(
                f"{path} has no column '{needed}'; answers need the columns call and repeat of the export and a "
                f"column text; it has {printable(', '.join(table.columns) + unread)}"
            )
    return named


def _meant(where: str, row: Row, named: Mapping[str, str]) -> Row:
    """Return a row by its columns' meanings; raises SourceError if two filled ones coincide."""
    cells: dict[str, Cell] = {}
    for name, cell in row.items():
        means = named.get(name) or meaning(name)
        if cell is not None and cells.get(means) is not None:
            raise SourceError(f"{where} has two columns for {means}, '{name}' among them: leave one out")
        if cell is not None:
            cells[means] = cell
    return cells


def _answered(where: str, row: Row) -> ImportedAnswer:
    """Return a row as an answer; raises SourceError, beginning with ``where``, for a fault."""
    call = _word(row.get("call"), f"{where}: 'call'")
    if not call:
        raise SourceError(f"{where} has no call; keep that column of the export as it is")
    frame, condition, digest = (
        _word(row.get(name), f"{where}: '{name}'") or None for name in ("frame", "condition", "request_sha256")
    )
    return ImportedAnswer(where, call, frame, condition, _repeat(row.get("repeat"), where), digest, _reply(row, where))


def _repeat(cell: Cell, where: str) -> int:
    number = read_number(_filled(cell), f"{where}: 'repeat'") or 0.0
    if number != int(number) or not 0 <= number < MOST_REPEATS:
        raise SourceError(f"{where}: 'repeat' is {number:g}, not a whole number from 0 to {MOST_REPEATS - 1}")
    return int(number)


def _reply(row: Row, where: str) -> Reply | None:
    text, error = _verbatim(row.get("text"), where, "text"), _verbatim(row.get("error"), where, "error")
    if text.strip() and error.strip():
        raise SourceError(f"{where} has a text and an error; leave one empty")
    fields: dict[str, object] = {name: _number(row.get(name), f"{where}: '{name}'", name) for name in _NUMBERS}
    fields |= {name: _word(row.get(name), f"{where}: '{name}'") or None for name in _LABELS}
    fields["reasoning"] = _verbatim(row.get("reasoning"), where, "reasoning")
    if error.strip():
        kind = cast("ErrorKind", error if error in get_args(ErrorKind) else "exception")
        return made_reply("", {**fields, "error": kind, "error_detail": printable(error)}, where)
    if not text and not any(fields.values()):
        return None
    return made_reply(text, fields, where)


def made_reply(text: str, fields: Mapping[str, object], where: str) -> Reply:
    """Return a reply of these values; raises SourceError for a value of a wrong type."""
    reply = Reply(text, **fields)  # type: ignore[arg-type]
    if wrong := invalid_field(reply):
        raise SourceError(f"{where}: {wrong}")
    return reply


def _filled(cell: Cell) -> Cell:
    """Return a cell, or None for NaN, which other programs write into empty cells."""
    return None if isinstance(cell, float) and math.isnan(cell) else cell


def _verbatim(cell: Cell, where: str, name: str) -> str:
    text = "" if (cell := _filled(cell)) is None else str(cell)
    if len(text) > MOST_CELL:
        raise SourceError(f"{where}: '{name}' has {len(text)} characters; the limit is {MOST_CELL}")
    return text


def _word(cell: Cell, what: str) -> str:
    """Return a cell as a short line; raises SourceError, beginning with ``what``, if it is none."""
    text = "" if (cell := _filled(cell)) is None else str(cell).strip()
    if len(text) > _MOST_LABEL or not text.isprintable():
        raise SourceError(f"{what} is not one line of at most {_MOST_LABEL} printable characters")
    return text


def _number(cell: Cell, what: str, name: str) -> float | int | None:
    """Return a cell as a number of a reply; raises SourceError, beginning with ``what``, else."""
    number = read_number(_filled(cell), what)
    if number is None:
        return None
    if not 0 <= number <= MOST[name]:
        raise SourceError(f"{what} is {number:g}, not a number from 0 to {MOST[name]:g}; leave the cell empty")
    if name.endswith("_tokens"):
        if number != int(number):
            raise SourceError(f"{what} is {number:g}, not a whole number")
        return int(number)
    return number
