"""Attempts as columns: a ledger is read in one pass, which checks every row, and then counted by numpy."""

import gc
import json
import re
import sqlite3
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from hashlib import sha256
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eyechart.calls import MOST, UNFINISHED, CallKey, DecisionReader, Reply
from eyechart.kept import KeptForm
from eyechart.ledger.rows import KEY_OF_CALL, OF_KEY, REPLY, REPLY_OF, SentAttempt, pack
from eyechart.spaces.space import Decision

Ints = NDArray[np.integer[Any]]
Mask = NDArray[np.bool_]
Row = tuple[Any, ...]

EVERY_ATTEMPT = (
    f"SELECT {KEY_OF_CALL}, a.reason, a.request_sha256, a.sent_at, r.final, r.closed_at, {REPLY_OF}, "
    "a.number, a.call, r.call IS a.call, r.row_sha256 "
    "FROM attempts a JOIN calls c ON c.id = a.call LEFT JOIN replies r ON r.attempt = a.id ORDER BY a.id"
)
_FINAL, _REPLY = OF_KEY + 3, OF_KEY + 5
_NUMBER = _REPLY + len(REPLY)
_AT = {name: _REPLY + at for at, name in enumerate(REPLY)}
_CODED = {**{name: at for at, name in enumerate(CallKey._fields)}, "reason": OF_KEY, **_AT}
_CODED = {
    name: _CODED[name]
    for name in ("study", "model", "prompt", "frame", "condition", "repeat", "reason", "error", "finish_reason")
}
_WHOLE = ("prompt_tokens", "completion_tokens", "reasoning_tokens")
_REAL = ("seconds", "first_byte_s", "cost_usd", "energy_j")
_NAMES = tuple(_AT[name] for name in ("served", "provider", "system_fingerprint", "payload_sha256"))
_AT_ONCE = 4_000
_READ_AT_MOST = 100_000
_DIGITS = 64
_HEXADECIMAL = re.compile("[0-9a-f]+").fullmatch
_SHA256 = re.compile(f"[0-9a-f]{{{_DIGITS}}}").fullmatch
TEXTS_KEPT = 1000
"""The most distinct texts of a model that are told apart."""
AGAIN_SHOWN = ("real", "real_repeat")
"""The conditions of one picture, whose replies are compared word by word."""


class UnsoundError(Exception):
    """A row differs from what was written; a slower walk over the rows says which."""


@dataclass(frozen=True)
class Repeats:
    """The replies to pictures shown twice: their rows, and hashes of their texts and reasonings."""

    rows: Ints
    text: Ints
    reasoning: Ints


@dataclass(frozen=True)
class Attempts:
    """Attempts at calls in the order of sending, an array a field, and a value's number for words.

    ``codes`` holds by name the numbers of the words in ``names``. ``call`` numbers the calls, and
    ``number`` the attempts at each from 1. ``came`` says that a reply came, ``final`` that it
    finished the call. ``decision`` is a place in ``decisions``, -1 without a reply. ``silent`` says
    that a reply has no text, ``thought`` that it has a reasoning. ``request`` is the request's digest
    as a number (`hashed`), -1 without one. ``whole`` are numbers of tokens, -1 where unknown, and
    ``real`` seconds, dollars and joules, NaN where unknown. A number that no reply has is left out.
    ``served`` holds, by model and by what named itself in replies without an error, their number and
    the times of the first and last. ``texts`` are the distinct replies of each model, up to
    `TEXTS_KEPT`.
    """

    names: Mapping[str, tuple[Any, ...]]
    codes: Mapping[str, Ints]
    call: Ints
    number: Ints
    came: Mask
    final: Mask
    decision: Ints
    decisions: tuple[Decision[Any], ...]
    silent: Mask
    thought: Mask
    request: Ints
    whole: Mapping[str, Ints]
    real: Mapping[str, NDArray[np.float64]]
    repeats: Repeats
    served: Mapping[tuple[int, Row], tuple[int, str, str]]
    texts: Mapping[int, frozenset[str]]

    def code(self, name: str, value: object) -> int:
        """Return the number of a word; -1 where no attempt has it."""
        return self._places[name].get(value, -1)

    @cached_property
    def _places(self) -> Mapping[str, Mapping[Any, int]]:
        return {name: {value: at for at, value in enumerate(values)} for name, values in self.names.items()}

    def of(self, model: str) -> Ints:
        """Return the rows of a model's attempts, in order."""
        return self._rows_of.get(self.code("model", model), np.zeros(0, dtype=np.int64))

    @cached_property
    def _rows_of(self) -> Mapping[int, Ints]:
        codes = self.codes["model"]
        order, ends = np.argsort(codes, kind="stable"), np.cumsum(np.bincount(codes, minlength=1))
        return dict(enumerate(np.split(order, ends[:-1])))

    def error(self, rows: Ints, kinds: Iterable[str | None]) -> Mask:
        """Return which rows have a reply with one of these errors; None is a reply without one."""
        codes, found = self.codes["error"][rows], np.zeros(len(rows), dtype=np.bool_)
        for kind in kinds:
            found |= codes == self.code("error", kind)
        return self.came[rows] & found

    def last(self, model: str) -> Ints:
        """Return the row of each call's last final reply, or else of its last failure, by call."""
        rows = self.of(model)
        rows = rows[self.came[rows]]
        calls, place = np.unique(self.call[rows], return_inverse=True)
        found, final = np.full(len(calls), -1, dtype=np.int64), self.final[rows]
        found[place] = rows
        found[place[final]] = rows[final]
        return found

    def finishing(self, rows: Ints) -> Mask:
        """Return which rows have a reply that finished its call."""
        return self.came[rows] & (self.final[rows] | ~self.error(rows, UNFINISHED))

    def cells(self, rows: Ints, places: Mapping[str, int], study: str, prompt: str) -> dict[tuple[str, int], Mask]:
        """Return by condition and repeat which frames, by their ``places``, some of these rows are about."""
        own = (self.code("study", study), self.code("prompt", prompt))
        rows = rows[(self.codes["study"][rows] == own[0]) & (self.codes["prompt"][rows] == own[1])]
        at = self.places(places)[self.codes["frame"][rows]]
        repeats = len(self.names["repeat"])
        pairs = self.codes["condition"][rows].astype(np.int64) * repeats + self.codes["repeat"][rows]
        found = {}
        for pair in np.flatnonzero(np.bincount(pairs)).tolist():
            shown = at[(pairs == pair) & (at >= 0)]
            cells = np.zeros(len(places), dtype=np.bool_)
            cells[shown] = True
            found[self.names["condition"][pair // repeats], self.names["repeat"][pair % repeats]] = cells
        return found

    def places(self, places: Mapping[str, int]) -> Ints:
        """Return the place of each known frame, -1 for one without."""
        return np.array([places.get(frame, -1) for frame in self.names["frame"]], dtype=np.int64)

    def key(self, row: int) -> CallKey:
        """Return the call of a row."""
        return CallKey(*(self.names[name][self.codes[name][row]] for name in CallKey._fields))


class Codes:
    """Numbers words in the order in which they first come."""

    def __init__(self) -> None:
        self._found: defaultdict[Any, int] = defaultdict()
        self._found.default_factory = self._found.__len__

    def of(self, column: Sequence[Any]) -> Ints:
        """Return the number of each word of a column."""
        return _small(np.fromiter(map(self._found.__getitem__, column), np.int64, len(column)))

    @property
    def words(self) -> tuple[Any, ...]:
        """Return the words by their numbers."""
        return tuple(self._found)


def columns_of(attempts: Iterable[SentAttempt], read: DecisionReader, *, by_frame: bool = True) -> Attempts:
    """Return attempts as columns, such as those of a ledger that a run still writes."""
    gather, calls = _Gather(read, by_frame=by_frame), Codes()
    blank = (None,) * len(REPLY)
    rows = (
        (
            *(*one.key, one.reason, one.request_sha256, one.sent_at, None if one.reply is None else one.final, None),
            *(blank if one.reply is None else (getattr(one.reply, name) for name in REPLY)),
            *(one.number, one.key, True, None),
        )
        for one in attempts
    )
    while several := list(islice(rows, _AT_ONCE)):
        places = calls.of([one[_NUMBER + 1] for one in several])
        gather.add([(*row[: _NUMBER + 1], int(place)) for row, place in zip(several, places, strict=True)])
    return gather.made()


def read_columns(sql: sqlite3.Connection, read: DecisionReader | None, *, by_frame: bool, check: bool) -> Attempts:
    """Return every attempt of an open ledger as columns.

    ``read`` reads a reply's decision; one ``by_frame`` needs to know the frame and its condition.
    With ``check`` each reply is compared with its checksum, and the links of the rows are counted.
    Raises UnsoundError where a row differs.
    """
    gather = _Gather(read, by_frame=by_frame)
    with _uncollected():
        for several in _several(sql):
            if check:
                _require_sums(several)
            gather.add(several)
    made = gather.made()
    if check:
        _require_links(sql, made)
    return made


@contextmanager
def _uncollected() -> Iterator[None]:
    """Pause Python's search for cycles: rows are many and have none, and it takes a tenth of their reading."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


def _several(sql: sqlite3.Connection) -> Iterator[list[Row]]:
    rows = sql.execute(EVERY_ATTEMPT)
    while several := rows.fetchmany(_AT_ONCE):
        yield several


def _require_sums(several: Sequence[Row]) -> None:
    """Raise UnsoundError unless every reply has its checksum and belongs to the call of its attempt."""
    for row in several:
        if row[_FINAL] is not None and (
            sha256(pack(row[:_NUMBER])).hexdigest() != row[_NUMBER + 3] or not row[_NUMBER + 2]
        ):
            raise UnsoundError


def _require_links(sql: sqlite3.Connection, made: Attempts) -> None:
    """Raise UnsoundError unless all rows were met, and the attempts at each call count from 1."""
    met = (len(made.call), int(made.came.sum()))
    held = tuple(sql.execute(f"SELECT count(*) FROM {name}").fetchone()[0] for name in ("attempts", "replies"))
    times = np.bincount(made.call, minlength=1)
    if met != held or np.any(made.number < 1) or np.any(made.number > times[made.call]):
        raise UnsoundError
    counted = np.zeros(len(made.call), dtype=np.bool_)
    counted[(np.cumsum(times) - times)[made.call] + made.number - 1] = True
    if not counted.all():  # a number is there twice, which only an index would show
        raise UnsoundError


def _small(column: Ints) -> Ints:
    """Return whole numbers in the smallest type that holds them."""
    low, high = int(column.min(initial=0)), int(column.max(initial=0))
    fits = (kind for kind in (np.int8, np.int16, np.int32) if np.iinfo(kind).min <= low and high <= np.iinfo(kind).max)
    return column.astype(next(fits, np.int64))


class _Column:
    """A column that grows in place: many small arrays would leave as much memory in pieces once they are joined."""

    def __init__(self) -> None:
        self._held, self._count = np.zeros(0, dtype=np.int64), 0

    def add(self, part: NDArray[Any]) -> None:
        """Append values; the type widens as that of joined arrays does."""
        end = self._count + len(part)
        kind = np.promote_types(self._held.dtype, part.dtype) if self._count else part.dtype
        if end > len(self._held) or kind != self._held.dtype:
            grown = np.empty(max(2 * len(self._held), end), dtype=kind)
            grown[: self._count] = self.whole
            self._held = grown
        self._held[self._count : end] = part
        self._count = end

    @property
    def whole(self) -> NDArray[Any]:
        return self._held[: self._count]


@dataclass
class _Gather:
    """Gathers columns from rows, several at a time."""

    read: DecisionReader | None
    by_frame: bool
    _coded: dict[str, Codes] = field(default_factory=lambda: {name: Codes() for name in _CODED})
    _columns: defaultdict[str, "_Column"] = field(default_factory=lambda: defaultdict(_Column))
    _count: int = 0
    _names: Codes = field(default_factory=Codes)
    _served: dict[tuple[int, int], tuple[int, str, str]] = field(default_factory=dict)
    _texts: defaultdict[int, set[str]] = field(default_factory=lambda: defaultdict(set))
    _decisions: Codes = field(default_factory=Codes)
    _known: dict[Row, int] = field(default_factory=dict)
    _entries: list[tuple[int, bool, str]] = field(default_factory=list)

    def add(self, several: Sequence[Row]) -> None:
        """Add rows of `EVERY_ATTEMPT`."""
        columns = list(zip(*several, strict=True))
        put = self._put
        codes = {name: self._coded[name].of(columns[at]) for name, at in _CODED.items()}
        for name, column in codes.items():
            put(name, column)
        final = np.array(columns[_FINAL], dtype=np.float64)
        came = ~np.isnan(final)
        put("came", came)
        put("final", final == 1)
        put("number", _small(np.array(columns[_NUMBER], dtype=np.int64)))
        put("call", _small(np.array(columns[_NUMBER + 1], dtype=np.int64)))
        put("request", _all_hashed(columns[OF_KEY + 1]))
        self._numbers(columns)
        entries = self._read(columns, codes, came)
        decision, silent, _ = zip(*self._entries, (-1, False, ""), strict=True)  # the last is that of no reply
        put("decision", _small(np.array(decision)[entries]))
        put("silent", np.array(silent)[entries])
        reasonings = columns[_AT["reasoning"]]
        if not {"", None}.issuperset(reasonings):
            put("thought", np.array([bool(one and one.strip()) for one in reasonings], dtype=np.bool_))
        else:
            put("thought", np.zeros(len(several), dtype=np.bool_))
        plain = came & (codes["error"] == self._coded["error"].of([None])[0])
        self._keep_texts(codes["model"][plain], entries[plain])
        self._keep_names(columns, codes["model"], plain)
        self._keep_repeats(columns, plain & np.isin(codes["condition"], self._coded["condition"].of(AGAIN_SHOWN)))
        self._count += len(several)
        if len(self._known) > _READ_AT_MOST:
            self._known.clear()
            self._entries.clear()

    def _put(self, name: str, column: NDArray[Any]) -> None:
        self._columns[name].add(column)

    def _numbers(self, columns: Sequence[Row]) -> None:
        for name in (*_WHOLE, *_REAL):
            column = columns[_AT[name]]
            if column.count(None) == len(column):
                found = np.full(len(column), np.nan, dtype=np.float32)
            else:
                found = np.array(column, dtype=np.float64)
                found[~((found >= 0) & (found <= MOST[name]))] = np.nan
            if name in _WHOLE:
                self._put(name, _small(np.where(np.isnan(found), -1, found).astype(np.int64)))
            else:
                self._put(name, found)

    def _read(self, columns: Sequence[Row], codes: Mapping[str, Ints], came: Mask) -> Ints:
        """Return each row's entry of text, end and error, which is read once; -1 without a reply."""
        seen = [columns[_AT["text"]], codes["finish_reason"].tolist(), codes["error"].tolist()]
        seen += [codes[name].tolist() for name in ("prompt", "frame", "condition", "repeat") if self.by_frame]
        known, found = self._known, np.full(len(came), -1, dtype=np.int64)
        every = list(zip(*seen, strict=True))
        entries = list(map(known.get, every))
        if came.all() and None not in entries:
            return np.array(entries, dtype=np.int64)
        for at in np.flatnonzero(came).tolist():
            entry = known.get(every[at])
            found[at] = self._entry(every[at], tuple(column[at] for column in columns)) if entry is None else entry
        return found

    def _entry(self, seen: Row, row: Row) -> int:
        """Read a reply that is like none before, and return its entry."""
        decision, text = -1, row[_AT["text"]].strip()
        if self.read is not None:
            made = self.read(CallKey(*row[:OF_KEY]), Reply(*row[_REPLY:_NUMBER]))
            decision = int(self._decisions.of([made])[0])
        entry = self._known[seen] = len(self._entries)
        self._entries.append((decision, not text, text))
        return entry

    def _keep_texts(self, models: Ints, entries: Ints) -> None:
        """Keep a model's distinct texts, up to a number of them."""
        for pair in np.unique(models.astype(np.int64) << 32 | entries).tolist():
            kept = self._texts[pair >> 32]
            if len(kept) < TEXTS_KEPT:
                kept.add(self._entries[pair & 0xFFFFFFFF][2])

    def _keep_names(self, columns: Sequence[Row], models: Ints, plain: Mask) -> None:
        said = [*(columns[at] for at in _NAMES[:3]), [digest is None for digest in columns[_NAMES[3]]]]
        if all(len(set(one)) == 1 for one in said):  # most runs name one model throughout
            names = np.repeat(self._names.of([tuple(one[0] for one in said)]), len(plain))
        else:
            names = self._names.of(list(zip(*said, strict=True)))
        rows, sent_at = np.flatnonzero(plain), columns[OF_KEY + 2]
        pairs = models[rows].astype(np.int64) << 32 | names[rows]
        found, first, counts = np.unique(pairs, return_index=True, return_counts=True)
        last = len(pairs) - 1 - np.unique(pairs[::-1], return_index=True)[1]
        for at in np.argsort(first):
            pair = (int(found[at]) >> 32, int(found[at]) & 0xFFFFFFFF)
            count, since, _ = self._served.get(pair, (0, sent_at[rows[first[at]]], ""))
            self._served[pair] = (count + int(counts[at]), since, sent_at[rows[last[at]]])

    def _keep_repeats(self, columns: Sequence[Row], shown: Mask) -> None:
        rows = np.flatnonzero(shown)
        self._put("repeats", rows + self._count)
        for name in ("text", "reasoning"):
            column = columns[_AT[name]]
            self._put(f"repeats {name}", np.array([hash(column[at]) for at in rows.tolist()], dtype=np.int64))

    def made(self) -> Attempts:
        """Return the columns."""

        def whole(name: str) -> NDArray[Any]:
            return self._columns.pop(name, _Column()).whole

        names, said = self._names.words, {name: codes.words for name, codes in self._coded.items()}
        return Attempts(
            names=said,
            codes={name: whole(name) for name in _CODED},
            call=whole("call"),
            number=whole("number"),
            came=whole("came").astype(np.bool_),
            final=whole("final").astype(np.bool_),
            decision=whole("decision"),
            decisions=self._decisions.words,
            silent=whole("silent").astype(np.bool_),
            thought=whole("thought").astype(np.bool_),
            request=whole("request"),
            whole={name: column for name in _WHOLE if np.any((column := whole(name)) >= 0)},
            real={name: column for name in _REAL if not np.all(np.isnan(column := whole(name)))},
            repeats=Repeats(whole("repeats"), whole("repeats text"), whole("repeats reasoning")),
            served={(model, names[name]): found for (model, name), found in self._served.items()},
            texts={model: frozenset(found) for model, found in self._texts.items()},
        )


def hashed(digest: str) -> int:
    """Return a request's digest as a number of 60 bits, from 0; -1 without one."""
    if not digest:
        return -1
    if _SHA256(digest) is None:  # no digest of ours
        digest = sha256(digest.encode(errors="surrogatepass")).hexdigest()
    return int(digest[:15], 16)


def _all_hashed(digests: Sequence[str]) -> Ints:
    """Return what `hashed` does of each digest; many whole ones are read at once."""
    joined = "".join(digests)
    if set(map(len, digests)) != {_DIGITS} or _HEXADECIMAL(joined) is None:
        return np.fromiter(map(hashed, digests), np.int64, len(digests))
    return (np.frombuffer(bytes.fromhex(joined), ">u8")[:: _DIGITS // 16] >> 4).astype(np.int64)


def written(attempts: Attempts) -> list[memoryview] | None:
    """Return columns in parts: a line of JSON that describes them, and then their arrays.

    None where an action is no word, as a motion: it cannot be written exactly.
    """
    if any(not isinstance(one.action, str | None) for one in attempts.decisions):
        return None
    arrays = dict(_arrays(attempts))
    said = {
        "arrays": [[name, one.dtype.str, len(one)] for name, one in arrays.items()],
        "names": attempts.names,
        "decisions": [[one.action, one.missing, one.why] for one in attempts.decisions],
        "served": [[model, said, *counted] for (model, said), counted in attempts.served.items()],
        "texts": {str(model): sorted(found) for model, found in attempts.texts.items()},
    }
    head = json.dumps(said).encode()
    head += b" " * (-(len(head) + 1 + _BEFORE) % 8) + b"\n"
    return [memoryview(head), *(np.ascontiguousarray(one).data.cast("B") for one in arrays.values() if one.size)]


def _arrays(attempts: Attempts) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield every array by a name, those of the largest values first."""
    groups = {"": vars(attempts), "codes": attempts.codes, "whole": attempts.whole, "real": attempts.real}
    groups["repeats"] = vars(attempts.repeats)
    found = {
        f"{group}.{name}": one
        for group, many in groups.items()
        for name, one in many.items()
        if isinstance(one, np.ndarray)
    }
    yield from sorted(found.items(), key=lambda item: -item[1].itemsize)


def read_back(body: memoryview) -> Attempts:
    """Return the columns that `written` wrote, over the same bytes; raises ValueError or LookupError."""
    head = re.match(rb"[^\n]*\n", body)
    if head is None:
        raise ValueError("no line describes the columns")
    said, at = json.loads(head[0]), head.end()
    groups: dict[str, dict[str, NDArray[Any]]] = {name: {} for name in ("", "codes", "whole", "real", "repeats")}
    for name, kind, length in said["arrays"]:
        group, _, place = name.partition(".")
        if np.dtype(kind).kind not in "bif":
            raise ValueError(f"{name} is no column of numbers")
        groups[group][place] = np.frombuffer(body, kind, length, at)
        at += groups[group][place].nbytes
    return Attempts(
        names={name: tuple(words) for name, words in said["names"].items()},
        codes=groups["codes"],
        whole=groups["whole"],
        real=groups["real"],
        repeats=Repeats(**groups["repeats"]),
        decisions=tuple(Decision(*one) for one in said["decisions"]),
        served={(model, tuple(named)): tuple(counted) for model, named, *counted in said["served"]},
        texts={int(model): frozenset(found) for model, found in said["texts"].items()},
        **groups[""],
    )


_BEFORE = 65
"""Bytes of the seal before a kept reading, so that its arrays begin at a multiple of eight."""
COLUMNS = KeptForm("columns", written, read_back, 1_000_000_000)
"""How columns are kept beside a run: an array takes as long to read as its bytes."""
