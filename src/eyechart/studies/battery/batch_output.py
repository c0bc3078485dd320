"""Answers in the output of OpenAI's Batch API: a line of JSON for each request.

A line has the request's ``custom_id``, and either ``response`` with ``status_code`` and ``body``,
or ``error``. A run takes the ``custom_id`` as the call of the export.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path

from eyechart.calls import ErrorKind, Reply, invalid_field
from eyechart.errors import SourceError, printable, raising
from eyechart.importing import Faults, ImportedAnswer
from eyechart.importing.answers import MOST_ROWS
from eyechart.importing.cells import MOST_CELL, Progress
from eyechart.importing.tables import text_lines
from eyechart.models.openai_compatible import read_completion
from eyechart.records import parse_json

_UNASKED = {"batch_expired", "batch_cancelled", "batch_canceled"}
"""The codes of errors by which a request was never made."""
_CHAT = "chat.completion"
_MOST_KEY = 200


def is_batch(path: Path) -> bool:
    """Return whether the first line of a ``.jsonl`` file is of a batch's output."""
    if path.suffix.lower() != ".jsonl" or not path.is_file():
        return False
    first = next((line for line in text_lines(path, None) if line.strip()), "")
    try:
        row = parse_json(first)
    except (ValueError, RecursionError):
        return False
    if not isinstance(row, dict) or "call" in row:  # a table has this column, and may have others
        return False
    return "custom_id" in row and bool({"response", "error"} & row.keys())


def served_by(path: Path) -> str:
    """Return the model that the answered lines name, else the file's name without ending.

    Raises SourceError if they name several: a run has the answers of each under its own name.
    """
    named: dict[str, None] = {}
    for line in text_lines(path, None):
        model = _part(_part(_object(line), "response"), "body").get("model") if line.strip() else None
        if isinstance(model, str) and model.strip():
            named[printable(model)[:_MOST_KEY]] = None
    if len(named) > 1:
        raise SourceError(
            f"{path} has answers of several models: {', '.join([*named][:5])}. Write the lines of each model into a "
            "file of its own, and import these one after another"
        )
    return next(iter(named), printable(path.stem))


def read_batch(path: Path, faults: Faults, progress: Progress | None = None) -> Iterator[ImportedAnswer]:
    """Yield the answer of each line in order; a faulty line is added to ``faults`` and left out.

    Raises SourceError if the file cannot be read.
    """
    for number, line in enumerate((line for line in text_lines(path, progress) if line.strip()), 1):
        if number > MOST_ROWS:
            raise SourceError(f"{path} has more than {MOST_ROWS} lines; cut it into parts")
        where, made = f"{path.name}, row {number}", list[ImportedAnswer]()
        with faults.noted():
            made.append(_answered(where, line))
        yield from made


def _answered(where: str, line: str) -> ImportedAnswer:
    with raising(SourceError, f"{where} is no JSON object", of=(ValueError, RecursionError)):
        row = parse_json(line)
    if not isinstance(row, dict):
        raise SourceError(f"{where} is a {type(row).__name__}, no JSON object")
    call = row.get("custom_id")
    if not isinstance(call, str) or not call or len(call) > _MOST_KEY or not call.isprintable():
        raise SourceError(f"{where} has no custom_id; give each request the call of the export as its custom_id")
    reply = _reply(where, row)
    if wrong := invalid_field(reply):
        raise SourceError(f"{where}: {wrong}")
    if len(reply.text) > MOST_CELL:
        raise SourceError(f"{where}: its text has {len(reply.text)} characters; the limit is {MOST_CELL}")
    return ImportedAnswer(where, call, None, None, 0, None, reply)


def _reply(where: str, row: Mapping[str, object]) -> Reply:
    """Return a line's reply, or its failure by kind; raises SourceError if it has neither."""
    error, response = _part(row, "error"), _part(row, "response")
    if error or row.get("error"):
        code, words = str(error.get("code")), error.get("message") or row.get("error")
        kind: ErrorKind = "not_called" if code in _UNASKED else "server_error"
        return Reply(error=kind, error_detail=printable(f"{words} ({code})" if error else str(words)))
    body, status = _part(response, "body"), response.get("status_code")
    if not isinstance(status, int) or isinstance(status, bool) or not 100 <= status <= 599 or not body:
        raise SourceError(f"{where} has no error and no response with a status_code and a body")
    kind_of, choices = body.get("object"), body.get("choices")
    if isinstance(kind_of, str) and kind_of != _CHAT:
        raise SourceError(
            f"{where}: its body is a {kind_of}, of another endpoint; a run takes {_CHAT} of /v1/chat/completions"
        )
    if isinstance(choices, list) and all(isinstance(one, dict) for one in choices):
        body = {**body, "choices": sorted(choices, key=_place)}
    with raising(SourceError, f"{where}: the body cannot be read", of=TypeError):
        return read_completion(body, status)


def _place(choice: Mapping[str, object]) -> int:
    index = choice.get("index")
    return index if isinstance(index, int) else 0


def _object(line: str) -> Mapping[str, object]:
    try:
        row = parse_json(line)
    except (ValueError, RecursionError):
        return {}
    return row if isinstance(row, dict) else {}


def _part(values: Mapping[str, object], name: str) -> Mapping[str, object]:
    found = values.get(name)
    return found if isinstance(found, dict) else {}
