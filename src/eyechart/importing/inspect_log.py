"""Answers from a log of Inspect AI, ``.eval`` or ``.json``, read without Inspect in bounded memory.

A log in ``.eval`` is a ZIP file with one JSON file a sample. They are compressed with Zstandard,
which pyarrow unpacks.
"""

import json
import struct
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from eyechart.calls import MOST, Reply, bounded
from eyechart.errors import SourceError, printable, raising
from eyechart.importing.answers import MOST_REPEATS, MOST_ROWS, ImportedAnswer, made_reply
from eyechart.importing.cells import MOST_CELL, Progress
from eyechart.importing.faults import Faults
from eyechart.importing.parquet import require
from eyechart.records import parse_json

ENDINGS = (".eval", ".json")
MOST_SAMPLE = 64_000_000
"""Bytes of one sample, which may include its pictures."""
MOST_JSON = 1_000_000_000
"""Bytes of a log in JSON, which is read at once."""
MOST_UNPACKED = 50_000_000_000
_FAR = 1e300
_ZSTD = 93
_LOCAL = struct.Struct("<4sHHHHHIIIHH")
_FINISH = {"max_tokens": "length", "model_length": "length", "unknown": None}
"""Inspect's finish reasons that differ from OpenAI's."""


@dataclass(frozen=True)
class InspectLog:
    """A log: the evaluated model, Inspect's version, and the number of samples."""

    path: Path
    model: str
    version: str
    count: int

    def answers(self, faults: Faults, progress: Progress | None = None) -> Iterator[ImportedAnswer]:
        """Yield the answer of each sample; a faulty one is added to ``faults`` and left out."""
        for number, (name, sample) in enumerate(_samples(self.path), 1):
            made: list[ImportedAnswer] = []
            with faults.noted():
                made.append(_answered(f"{self.path.name}, sample {name}", sample))
            yield from made
            if progress is not None:
                progress(number, self.count)


def open_log(path: Path) -> InspectLog:
    """Open a log of Inspect AI; raises SourceError if it is none, or is too large."""
    if not path.is_file():
        raise SourceError(f"{path} does not exist or is no file")
    if path.suffix == ".json":
        header = _whole(path)
        count = len(_list(header.get("samples"), path))
    else:
        with _opened(path) as (archive, file):
            names = archive.namelist()
            start = next((name for name in ("header.json", "_journal/start.json") if name in names), None)
            if start is None:
                raise SourceError(f"{path} is no log of Inspect AI: it has no header.json")
            header = _object(_read(archive, file, archive.getinfo(start), path), path, start)
            count = sum(map(_is_sample, names))
    about = header.get("eval")
    if not isinstance(about, dict) or not isinstance(about.get("model"), str):
        raise SourceError(f"{path} is no log of Inspect AI: it does not name the evaluated model")
    packages = about.get("packages")
    version = packages.get("inspect_ai") if isinstance(packages, dict) else None
    return InspectLog(
        path, printable(about["model"])[:200], printable(str(version or "of unknown version"))[:40], count
    )


def _samples(path: Path) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield each sample with its name; raises SourceError if one cannot be read."""
    if path.suffix == ".json":
        for number, sample in enumerate(_list(_whole(path).get("samples"), path), 1):
            yield str(number), sample if isinstance(sample, dict) else {}
        return
    with _opened(path) as (archive, file):
        unpacked = 0
        for entry in archive.infolist():
            if _is_sample(entry.filename):
                unpacked += entry.file_size
                if unpacked > MOST_UNPACKED:
                    raise SourceError(f"{path} unpacks to more than {MOST_UNPACKED} bytes; cut it into parts")
                yield entry.filename, _object(_read(archive, file, entry, path), path, entry.filename)


def _is_sample(name: str) -> bool:
    return name.startswith("samples/") and name.endswith(".json")


@contextmanager
def _opened(path: Path) -> Iterator[tuple[zipfile.ZipFile, IO[bytes]]]:
    """Open a ZIP file and the file itself; its errors become SourceErrors with its name."""
    try:
        with path.open("rb") as file, zipfile.ZipFile(path) as archive:
            if len(archive.filelist) > MOST_ROWS:
                raise SourceError(f"{path} has more than {MOST_ROWS} files; cut it into parts")
            yield archive, file
    except (OSError, zipfile.BadZipFile, struct.error, EOFError, zlib.error, NotImplementedError) as error:
        raise SourceError(f"{path} cannot be read as a log of Inspect AI: {printable(str(error))}") from error


def _read(archive: zipfile.ZipFile, file: IO[bytes], entry: zipfile.ZipInfo, path: Path) -> bytes:
    """Return the unpacked bytes of a log's file, within the bound."""
    if entry.compress_type == _ZSTD:
        result = _unpacked(file, entry)
    else:
        with archive.open(entry) as packed:
            result = packed.read(MOST_SAMPLE + 1)
    if len(result) > MOST_SAMPLE:
        raise SourceError(f"{path}: {printable(entry.filename)} has more than {MOST_SAMPLE} bytes")
    return result


def _unpacked(file: IO[bytes], entry: zipfile.ZipInfo) -> bytes:
    """Return unpacked Zstandard data, at most a byte above the bound; raises OSError for damage."""
    pa = require("pyarrow", "pyarrow", "parquet")
    file.seek(entry.header_offset)
    sign, *_, name, extra = _LOCAL.unpack(file.read(_LOCAL.size))
    if sign != b"PK\x03\x04" or entry.compress_size > MOST_SAMPLE:
        raise zipfile.BadZipFile(f"{entry.filename} is damaged, or longer than {MOST_SAMPLE} bytes")
    file.seek(name + extra, 1)
    packed = pa.BufferReader(file.read(entry.compress_size))
    found, stream = bytearray(), pa.CompressedInputStream(packed, "zstd")
    while len(found) <= MOST_SAMPLE and (part := stream.read(1 << 20)):
        found += part
    return bytes(found)


def _whole(path: Path) -> Mapping[str, Any]:
    with raising(SourceError, f"{path} cannot be read"):
        if path.stat().st_size > MOST_JSON:
            raise SourceError(
                f"{path} has more than {MOST_JSON} bytes; convert it with 'inspect log convert' to .eval, which is "
                "read sample by sample"
            )
        return _object(path.read_bytes(), path, "it")


def _object(text: bytes, path: Path, name: str) -> Mapping[str, Any]:
    """Return a JSON object; raises SourceError for another value, or text that is not UTF-8."""
    try:
        result = parse_json(text)
        if b"\\u" in text:
            json.dumps(result, ensure_ascii=False).encode()  # half of a surrogate pair is no text
    except (ValueError, RecursionError) as error:
        raise SourceError(f"{path}: {printable(name)} is no JSON: {printable(str(error))}") from error
    if not isinstance(result, dict):
        raise SourceError(f"{path}: {printable(name)} is a {type(result).__name__}, no JSON object")
    return result


def _list(value: object, path: Path) -> list[object]:
    if not isinstance(value, list) or len(value) > MOST_ROWS:
        raise SourceError(f"{path} is no log of Inspect AI with at most {MOST_ROWS} samples: it has no list of them")
    return value


def _answered(where: str, sample: Mapping[str, Any]) -> ImportedAnswer:
    """Return a sample as an answer; raises SourceError, beginning with ``where``, for a fault."""
    metadata = sample.get("metadata")
    fields = metadata if isinstance(metadata, dict) else {}
    call = fields.get("call", sample.get("id"))
    epoch = sample.get("epoch", 1)
    if not isinstance(call, str) or not call or not call.isprintable():
        raise SourceError(f"{where} has no call in its metadata: is it a sample of the task eyechart/battery?")
    if not isinstance(epoch, int) or isinstance(epoch, bool) or not 1 <= epoch <= MOST_REPEATS:
        raise SourceError(f"{where}: its epoch is {str(epoch)[:40]!r}, not a whole number from 1 to {MOST_REPEATS}")
    frame, condition = (one if isinstance(one := fields.get(name), str) else None for name in ("frame", "condition"))
    return ImportedAnswer(where, call, frame, condition, epoch - 1, None, _reply(sample, where))


def _reply(sample: Mapping[str, Any], where: str) -> Reply | None:
    output = _part(sample, "output")
    words = _words(_part(sample, "error").get("message")) or _words(output.get("error"))
    choices = output.get("choices")
    first = choices[0] if isinstance(choices, list) and choices and isinstance(choices[0], dict) else None
    fields = _reply_fields(output)
    if words:
        return made_reply("", {**fields, "error": "exception", "error_detail": printable(words)}, where)
    if first is None:
        return None
    text, reasoning = _said(_part(first, "message").get("content"))
    if max(len(text), len(reasoning)) > MOST_CELL:
        raise SourceError(f"{where}: its text has more than {MOST_CELL} characters")
    ended = _words(first.get("stop_reason"))
    fields |= {"finish_reason": _FINISH.get(ended, ended) or None, "reasoning": reasoning}
    return made_reply(text, fields, where)


def _reply_fields(output: Mapping[str, Any]) -> dict[str, object]:
    """Return a sample's numbers of its call; impossible numbers count as not reported."""
    usage = _part(output, "usage")
    sent = [usage.get(name) for name in ("input_tokens", "input_tokens_cache_read", "input_tokens_cache_write")]
    counted = [one for one in map(_whole_number, sent) if one is not None]
    fields: dict[str, object] = {
        "prompt_tokens": sum(counted) or None,  # Inspect writes 0 for an unreported usage
        "completion_tokens": _whole_number(usage.get("output_tokens")) or None,
        "reasoning_tokens": _whole_number(usage.get("reasoning_tokens")),
        "cost_usd": _number(usage.get("total_cost")),
        "seconds": _number(output.get("time")),
        "served": _words(output.get("model"))[:200] or None,
    }
    kept = bounded(Reply(**{name: fields[name] for name in fields if name in MOST}))  # type: ignore[arg-type]
    return fields | {name: getattr(kept, name) for name in fields if name in MOST}


def _said(content: object) -> tuple[str, str]:
    """Return the text and the reasoning of a message of one text or of parts."""
    if isinstance(content, str):
        return content, ""
    parts = [one for one in content if isinstance(one, dict)] if isinstance(content, list) else []
    text = "".join(_words(part.get("text")) for part in parts if part.get("type") == "text")
    return text, "".join(_words(part.get("reasoning")) for part in parts if part.get("type") == "reasoning")


def _part(values: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    found = values.get(name)
    return found if isinstance(found, dict) else {}


def _words(value: object) -> str:
    return value if isinstance(value, str) else ""


def _whole_number(value: object) -> int | None:
    return value if isinstance(value, int) and not isinstance(value, bool) else None


def _number(value: object) -> float | None:
    return (
        float(value) if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < _FAR else None
    )
