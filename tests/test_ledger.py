import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import astuple, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bundles import checked
from eyechart.attempts import budget_of
from eyechart.calls import MOST, UNFINISHED, CallKey, Reply
from eyechart.errors import LedgerError
from eyechart.ledger import UNKNOWN, Ledger
from eyechart.ledger.schema import SCHEMAS
from eyechart.limits import Limits

MODEL = "standin:steady"
KEY = CallKey("battery", MODEL, "baseline@0", "f1", "real")
OTHER = KEY._replace(frame="f2")
FULL = Reply("STOP", "stop", None, "", 10, 1, 0.5)
EVERY = Reply(
    "GO", "stop", None, "", 10, 9, 0.5, "so so", 8, 0.25, 200, 1.5, "m-2026", "upstream", 0.001, 2.5, "fp", 7, "ab"
)
WHOLE = ("prompt_tokens", "completion_tokens", "reasoning_tokens", "status", "payload_bytes")
COLUMNS = {1: 7, 2: 16}
"""How many fields of a Reply an older ledger holds."""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Return where a ledger may be."""
    return tmp_path / "ledger.sqlite"


def rows(path: Path, table: str) -> list[tuple[object, ...]]:
    """Read a table through a connection of its own, as any SQLite browser does."""
    with closing(sqlite3.connect(path)) as sql:
        return sql.execute(f"SELECT * FROM {table}").fetchall()  # noqa: S608 - the name is a test's own


def fill(path: Path, *entries: tuple[CallKey, Reply | None]) -> None:
    """Write a ledger with one attempt an entry, left open where there is no reply."""
    with Ledger(path, create=True) as ledger:
        for key, reply in entries:
            attempt = ledger.begin(key, "digest")
            if reply is not None:
                ledger.close(attempt, reply)


def older(path: Path, version: int, *replies: Reply) -> None:
    """Write a ledger of an older format, with one finished call a reply, as it was closed by its writer."""

    def add(table: str, *values: object) -> None:
        sql.execute(f"INSERT INTO {table} VALUES ({', '.join('?' * len(values))})", values)  # noqa: S608 - our own

    with closing(sqlite3.connect(path)) as sql:
        sql.executescript(f"PRAGMA journal_mode = WAL; {SCHEMAS[version]}")
        sql.execute(f"PRAGMA user_version = {version}")
        for number, reply in enumerate(replies, 1):
            add("calls", number, *KEY._replace(frame=f"f{number}"))
            add("attempts", number, number, 1, *(() if version == 1 else (None,)), "digest", "then")
            add("replies", number, number, 1, "now", *astuple(reply)[: COLUMNS[version]])
        sql.commit()


def files(folder: Path) -> dict[str, bytes]:
    """Return what lies in a folder."""
    return {item.name: item.read_bytes() for item in folder.iterdir()}


@contextmanager
def writer(path: Path) -> Iterator[subprocess.Popen[str]]:
    """Hold a process that has written one reply into a ledger, and has it open."""
    says = f"""
import sys
from pathlib import Path
from eyechart.calls import CallKey, Reply
from eyechart.ledger import Ledger
with Ledger(Path({str(path)!r}), create=True) as ledger:
    ledger.close(ledger.begin({KEY!r}, "digest"), Reply("STOP"))
    print("written", flush=True)
    sys.stdin.read()
"""
    pipe = subprocess.PIPE
    with subprocess.Popen([sys.executable, "-c", says], stdin=pipe, stdout=pipe, text=True) as one:
        assert one.stdout is not None
        assert one.stdout.readline() == "written\n"
        yield one
        one.kill()


def test_a_reply_comes_back_verbatim(path: Path) -> None:
    """Every field, for every kind of reply."""
    replies = {
        "f1": FULL,
        "f2": Reply(error="exception", error_detail="x: y"),
        "f4": EVERY,
        "f3": Reply("a\0b\r\n\u2028ü😀", "length"),
    }
    fill(path, *((KEY._replace(frame=frame), reply) for frame, reply in replies.items()))
    with Ledger(path, create=True) as ledger:
        assert {key.frame: reply for key, reply in ledger.replies(MODEL)} == replies
        assert list(ledger.replies("nobody")) == []


@pytest.mark.parametrize("value", ["1e308", "-1e308", "9e999", "-1", "9223372036854775807"])
def test_a_number_in_a_ledger_that_nobody_can_have_measured_reads_as_not_reported(path: Path, value: str) -> None:
    """An older eyechart kept what a server said; its row stays as it is, and its checksum holds."""
    fill(path, (KEY, EVERY))
    columns = [name for name in MOST if "e" not in value or name not in WHOLE]
    with closing(sqlite3.connect(path)) as sql:
        ((trigger,),) = sql.execute("SELECT sql FROM sqlite_master WHERE name = 'replies_UPDATE'")
        sql.execute("DROP TRIGGER replies_UPDATE")
        for name, to in dict.fromkeys(columns, value).items():
            sql.execute(f"UPDATE replies SET {name} = {to}")  # noqa: S608 - our own
        checked(sql)
        sql.execute(trigger)
        sql.commit()
    with Ledger(path) as ledger:
        ((_, reply),) = ledger.replies(MODEL)
        (sent,) = ledger.attempts(MODEL)
    assert reply == sent.reply == replace(EVERY, **dict.fromkeys(columns))


@given(st.text(st.characters()))
def test_any_text_can_be_kept(text: str) -> None:
    """Also one that is no Unicode: a lone surrogate, which broken escapes in JSON give, is kept as its escape."""
    with TemporaryDirectory() as folder, Ledger(Path(folder) / "ledger", create=True) as ledger:
        ledger.close(ledger.begin(KEY, "digest"), Reply(text, error_detail=text))
        ((_, reply),) = ledger.replies(MODEL)
        assert reply.text == reply.error_detail == text.encode("utf-8", "backslashreplace").decode()


@pytest.mark.parametrize("table", ["calls", "attempts", "replies"])
@pytest.mark.parametrize("change", ["UPDATE {} SET rowid = 99", "DELETE FROM {}"])
def test_rows_are_never_changed_or_removed(path: Path, table: str, change: str) -> None:
    """The file itself refuses, whoever asks."""
    fill(path, (KEY, FULL))
    before = rows(path, table)
    with closing(sqlite3.connect(path)) as sql, pytest.raises(sqlite3.IntegrityError, match="append-only"):
        sql.execute(change.format(table))
    assert rows(path, table) == before != []


def test_an_attempt_is_there_before_its_reply(path: Path) -> None:
    """Another connection sees it at once: it is committed before anything is sent."""
    with Ledger(path, create=True) as ledger:
        attempt = ledger.begin(KEY, "digest")
        ((id_, call, number, _, digest, _),) = rows(path, "attempts")
        assert (id_, call, number, digest) == (attempt.id, attempt.call, 1, "digest")
        assert rows(path, "replies") == []
        assert ledger.unknown() == {KEY}
        assert ledger.finished() == set()
        ledger.close(attempt, FULL)
        assert len(rows(path, "replies")) == 1
        assert ledger.unknown() == set()
        assert ledger.finished() == {KEY}


def test_a_finished_call_cannot_begin_again(path: Path) -> None:
    """It is paid for once; an error that will not pass finishes it too."""
    fill(path, (KEY, FULL), (OTHER, Reply(error="wrong_json")))
    with Ledger(path, create=True) as ledger:
        for key in (KEY, OTHER):
            with pytest.raises(LedgerError, match="finished already"):
                ledger.begin(key, "digest")
    assert len(rows(path, "attempts")) == 2


@pytest.mark.parametrize("error", sorted(UNFINISHED))
def test_an_error_that_may_pass_or_be_mended_leaves_a_call_unfinished(path: Path, error: str) -> None:
    """Its failures stand beside the reply that came in the end, which is the one that counts."""
    with Ledger(path, create=True) as ledger:
        ledger.close(ledger.begin(KEY, "digest"), Reply(error=error))  # type: ignore[arg-type]
        ledger.close(ledger.begin(KEY, "digest"), Reply(error=error, error_detail="last"))  # type: ignore[arg-type]
        assert ledger.finished() == ledger.unknown() == set()
        assert [reply.error_detail for _, reply in ledger.replies(MODEL)] == ["last"]
        attempt = ledger.begin(KEY, "digest")
        assert attempt.number == 3
        ledger.close(attempt, FULL)
        assert ledger.finished() == {KEY}
        assert list(ledger.replies(MODEL)) == [(KEY, FULL)]


def test_every_further_attempt_says_why_it_is_made(path: Path) -> None:
    """The error of the one before it, or that its outcome is unknown, because the run was killed meanwhile."""
    with Ledger(path, create=True) as ledger:
        ledger.close(ledger.begin(KEY, "digest"), Reply(error="rate_limited"))
        ledger.begin(KEY, "digest")
        ledger.close(ledger.begin(KEY, "digest"), FULL)
    assert [reason for _, _, _, reason, *_ in rows(path, "attempts")] == [None, "rate_limited", UNKNOWN]


def test_unknown_outcomes_are_those_of_unfinished_calls(path: Path) -> None:
    """An attempt without a reply is forgotten when a later one finishes its call; its row stays."""
    fill(path, (KEY, None), (OTHER, None), (OTHER, FULL))
    with Ledger(path, create=True) as ledger:
        assert ledger.unknown() == {KEY}
        sent = list(ledger.attempts(MODEL))
    assert [(attempt.key, attempt.number, attempt.reply) for attempt in sent] == [
        (KEY, 1, None),
        (OTHER, 1, None),
        (OTHER, 2, FULL),
    ]


def test_a_reply_ends_an_attempt_once(path: Path) -> None:
    """The same attempt gets no second reply."""
    with Ledger(path, create=True) as ledger:
        attempt = ledger.begin(KEY, "digest")
        ledger.close(attempt, FULL)
        with pytest.raises(sqlite3.IntegrityError):
            ledger.close(attempt, FULL)


def test_of_several_final_replies_of_a_call_the_last_one_counts(path: Path) -> None:
    """In the order of sending; a failure that came after them takes nothing back, and every reply stays."""
    with Ledger(path, create=True) as ledger:
        attempts = [ledger.begin(KEY, "digest") for _ in range(3)]
        for attempt, reply in zip(attempts, (FULL, EVERY, Reply(error="timeout")), strict=True):
            ledger.close(attempt, reply)
        assert list(ledger.replies(MODEL)) == [(KEY, EVERY)]
        assert [one.reply for one in ledger.attempts(MODEL)] == [FULL, EVERY, Reply(error="timeout")]
        assert ledger.finished() == {KEY}


@pytest.mark.parametrize("version", [1, 2])
def test_an_older_ledger_is_read_and_not_written(tmp_path: Path, version: int) -> None:
    """Every row comes back; what its format does not hold is unknown; the file and its folder stay as they are."""
    path = tmp_path / "ledger.sqlite"
    older(path, version, EVERY, Reply("GO"))
    before = files(tmp_path)
    known = Reply(*astuple(EVERY)[: COLUMNS[version]])
    with Ledger(path) as ledger:
        assert [reply for _, reply in ledger.replies(MODEL)] == [known, Reply("GO")]
        assert [(attempt.reason, attempt.reply) for attempt in ledger.attempts(MODEL)] == [
            (None, known),
            (None, Reply("GO")),
        ]
        assert len(ledger.finished()) == 2
        assert ledger.damaged() == []
    assert files(tmp_path) == before
    with Ledger(tmp_path / "merged", create=True) as merged, Ledger(path) as ledger:
        assert merged.absorb(ledger) == 2
        assert [reply for _, reply in merged.replies(MODEL)] == [known, Reply("GO")]
    assert {name: text for name, text in files(tmp_path).items() if "merged" not in name} == before


def test_a_ledger_of_format_2_grows_in_a_run_with_a_copy_of_the_old_one_beside_it(tmp_path: Path) -> None:
    """The copy reads as before; the ledger has today's schema, all of its rows, and a checksum on what is new."""
    path = tmp_path / "ledger.sqlite"
    older(path, 2, EVERY)
    with Ledger(path, create=True) as ledger:
        ledger.close(ledger.begin(KEY._replace(frame="f9"), "digest"), FULL)
    assert sorted(files(tmp_path)) == ["ledger.sqlite", "ledger.sqlite.counter", "ledger.sqlite.format2.bak"]
    with Ledger(path) as ledger:
        assert [reply.text for _, reply in ledger.replies(MODEL)] == ["GO", "STOP"]
    assert [row[-1] is None for row in rows(path, "replies")] == [True, False]
    with closing(sqlite3.connect(tmp_path / "ledger.sqlite.format2.bak")) as sql:
        assert sql.execute("PRAGMA user_version").fetchone() == (2,)
        assert sql.execute("SELECT text FROM replies").fetchall() == [("GO",)]


def test_a_migration_that_was_cut_begins_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """After the copy, in it, or within the change: the ledger is of format 2 until it is one of format 3."""
    path = tmp_path / "ledger.sqlite"
    older(path, 2, EVERY)
    (tmp_path / ".ledger.sqlite.format2.bak").write_text("half a copy", encoding="utf-8")
    with monkeypatch.context() as broken:
        broken.setattr(
            "eyechart.ledger.ledger.MIGRATION", "ALTER TABLE replies ADD COLUMN row_sha256 TEXT; SELECT absent;"
        )
        with pytest.raises(LedgerError, match="no such column: absent"):
            Ledger(path, create=True)
    with Ledger(path) as ledger:
        assert [reply.text for _, reply in ledger.replies(MODEL)] == ["GO"]
    with Ledger(path, create=True) as ledger:
        assert [reply.text for _, reply in ledger.replies(MODEL)] == ["GO"]
    assert sorted(files(tmp_path)) == ["ledger.sqlite", "ledger.sqlite.counter", "ledger.sqlite.format2.bak"]


KILLED = {
    "while its copy is written": "ledger.os.fsync = lambda _: die()",
    "before its copy is in place": "ledger.Path.replace = lambda *_: die()",
    "in the change": "ledger.MIGRATION = ledger.MIGRATION.replace('DROP INDEX', 'SELECT die(); DROP INDEX')",
    "before the change counts": "ledger.MIGRATION += 'SELECT die();'",
}


@pytest.mark.parametrize("when", KILLED)
def test_a_migration_that_is_killed_loses_nothing(tmp_path: Path, when: str) -> None:
    """The ledger is then still of format 2, is read with every row, and the next run migrates it."""
    path = tmp_path / "ledger.sqlite"
    older(path, 2, EVERY, FULL)
    says = f"""
import os, signal
from pathlib import Path
from eyechart.ledger import ledger
die, connect = lambda: os.kill(os.getpid(), signal.SIGKILL), ledger.connect
def connected(path, mode):
    opened = connect(path, mode)
    opened.create_function("die", 0, die)
    return opened
ledger.connect = connected
{KILLED[when]}
ledger.Ledger(Path({str(path)!r}), create=True)
"""
    assert subprocess.run([sys.executable, "-c", says], check=False).returncode == -signal.SIGKILL
    with Ledger(path) as ledger:
        assert ledger._format == 2
        assert [reply.text for _, reply in ledger.replies(MODEL)] == ["GO", "STOP"]
    with Ledger(path, create=True) as ledger:
        assert [reply.text for _, reply in ledger.replies(MODEL)] == ["GO", "STOP"]
    assert sorted(files(tmp_path)) == ["ledger.sqlite", "ledger.sqlite.counter", "ledger.sqlite.format2.bak"]


def test_a_ledger_of_format_1_is_not_appended_to(tmp_path: Path) -> None:
    """It is left as it is, and nothing is put beside it."""
    path = tmp_path / "ledger.sqlite"
    older(path, 1)
    before = files(tmp_path)
    with pytest.raises(LedgerError, match="format 1, which can be read but not appended to"):
        Ledger(path, create=True)
    assert files(tmp_path) == before


def test_a_merged_ledger_keeps_its_checksums(path: Path, tmp_path: Path) -> None:
    """They are over what was asked and came, not over the places of rows."""
    fill(path, (KEY, FULL))
    fill(tmp_path / "more", (OTHER, None), (OTHER, EVERY))
    with Ledger(path, create=True) as ledger, Ledger(tmp_path / "more") as more:
        ledger.absorb(more)
        assert ledger.damaged() == []
    assert None not in {row[-1] for row in rows(path, "replies")}


def test_a_ledger_is_read_beside_its_writer_and_nothing_is_left(tmp_path: Path) -> None:
    """Its rows are seen at once, also from the log of a writer that was killed; a read leaves no file of its own."""
    path = tmp_path / "ledger.sqlite"
    with writer(path) as live:
        assert (tmp_path / "ledger.sqlite-wal").stat().st_size > 0
        with Ledger(path) as ledger:
            assert ledger.finished() == {KEY}
        live.send_signal(signal.SIGKILL)
        live.wait()
    for name in ("ledger.sqlite-shm", "nothing"):
        (tmp_path / name).unlink(missing_ok=True)  # a copy of a run may lack it
        before = files(tmp_path)
        with Ledger(path) as ledger:
            assert ledger.finished() == {KEY}
        assert files(tmp_path) == before
    fill(path, (OTHER, FULL))
    assert sorted(files(tmp_path)) == ["ledger.sqlite", "ledger.sqlite.counter"]
    with Ledger(path) as ledger:
        assert ledger.finished() == {KEY, OTHER}
    assert sorted(files(tmp_path)) == ["ledger.sqlite", "ledger.sqlite.counter"]


def test_a_ledger_whose_log_is_begun_anew_at_every_copy_is_read_where_it_is(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A copy may then be torn: its file from before, its log from after."""
    with Ledger(path, create=True) as live:
        copy = shutil.copyfile

        def late(source: Path, target: Path) -> None:
            if source == path:
                live.close(live.begin(KEY._replace(frame=str(time.monotonic_ns())), "digest"), FULL)
                live._sql.execute("PRAGMA wal_checkpoint(TRUNCATE)")
            copy(source, target)

        monkeypatch.setattr(shutil, "copyfile", late)
        with Ledger(path) as ledger:
            assert len(ledger.finished()) == 20


def test_a_file_that_cannot_be_read_is_named(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing stays open or beside it."""
    fill(path, (KEY, FULL))
    monkeypatch.setattr(shutil, "copyfile", lambda *_: os.stat(path.parent / "none"))  # noqa: PTH116 - raises
    with pytest.raises(LedgerError, match=r"ledger\.sqlite cannot be read: No such file"):
        Ledger(path)


def test_absorbing_keeps_every_attempt_and_reply(path: Path, tmp_path: Path) -> None:
    """Keys, numbers, replies and open attempts come over; calls of both go on counting."""
    fill(path, (KEY, FULL), (OTHER, Reply(error="timeout")))
    more = tmp_path / "it's more.sqlite"
    third = KEY._replace(frame="f3")
    fill(more, (third, Reply(error="timeout")), (third, FULL), (OTHER, None), (OTHER, FULL))
    with Ledger(path, create=True) as ledger, Ledger(more) as other:
        assert ledger.absorb(other) == 1
        assert ledger.finished() == {KEY, OTHER, third}
        assert ledger.unknown() == set()
        assert dict(ledger.replies(MODEL)) == dict.fromkeys((KEY, OTHER, third), FULL)
        came = [attempt.reply for attempt in ledger.attempts(MODEL)]
    assert [came.count(FULL), came.count(Reply(error="timeout")), came.count(None)] == [3, 2, 1]
    numbers = sorted((call, number) for _, call, number, *_ in rows(path, "attempts"))
    assert numbers == [(1, 1), (2, 1), (2, 2), (2, 3), (3, 1), (3, 2)]
    assert len(rows(more, "attempts")) == 4


def test_absorbing_a_call_that_both_finished_copies_nothing(path: Path, tmp_path: Path) -> None:
    """It is named, and the ledger can still absorb others."""
    fill(path, (KEY, FULL))
    fill(tmp_path / "double", (OTHER, FULL), (KEY, FULL))
    fill(tmp_path / "fine", (OTHER, FULL))
    with Ledger(path, create=True) as ledger:
        with Ledger(tmp_path / "double") as double, pytest.raises(LedgerError, match=r"double: 1 call is .*frame='f1'"):
            ledger.absorb(double)
        assert ledger.finished() == {KEY}
        assert len(rows(path, "calls")) == 1
        with Ledger(tmp_path / "fine") as fine:
            ledger.absorb(fine)
        assert ledger.finished() == {KEY, OTHER}


def test_a_failed_absorption_is_undone(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing of it stays, and the next one succeeds."""
    fill(path, (KEY, FULL))
    fill(tmp_path / "more", (OTHER, FULL))
    with Ledger(path, create=True) as ledger, Ledger(tmp_path / "more") as more:
        with monkeypatch.context() as broken:
            broken.setattr("eyechart.ledger.ledger._COPY_REPLIES", "INSERT INTO nowhere VALUES (?)")
            with pytest.raises(sqlite3.OperationalError):
                ledger.absorb(more)
        assert [len(rows(path, table)) for table in ("calls", "attempts", "replies")] == [1, 1, 1]
        assert ledger.absorb(more) == 1


def test_what_is_no_ledger_is_refused_by_name_and_left_alone(path: Path) -> None:
    """A missing file, a text, somebody else's database and a later format: a clear error each."""
    with pytest.raises(LedgerError, match=r"ledger\.sqlite does not exist"):
        Ledger(path)
    assert not path.exists()
    path.write_text("dear diary, today I drove well" * 99, encoding="utf-8")
    for create in (False, True):
        with pytest.raises(LedgerError, match=r"ledger\.sqlite is no ledger"):
            Ledger(path, create=create)
    path.unlink()
    with closing(sqlite3.connect(path)) as sql:
        sql.execute("CREATE TABLE songs (name)")
    before = path.read_bytes()
    for create in (False, True):
        with pytest.raises(LedgerError, match=r"ledger\.sqlite is a ledger of format 0; this"):
            Ledger(path, create=create)
    assert path.read_bytes() == before


def test_a_ledger_that_is_read_is_not_written(path: Path) -> None:
    """Without ``create`` a ledger only reads, also where its folder and file cannot be written."""
    with Ledger(path, create=True) as ledger:
        ledger.close(ledger.begin(KEY, "digest"), FULL)
    before = path.read_bytes()
    with Ledger(path) as ledger, pytest.raises(sqlite3.OperationalError, match="readonly"):
        ledger.begin(KEY._replace(frame="f9"), "digest")
    with Ledger(path) as ledger:
        assert ledger.finished() == {KEY}
    assert path.read_bytes() == before


def test_a_ledger_of_a_later_format_is_refused(path: Path) -> None:
    """By its number, with the number that this program reads."""
    fill(path, (KEY, FULL))
    with closing(sqlite3.connect(path)) as sql:
        sql.execute("PRAGMA user_version = 9")
    with pytest.raises(
        LedgerError, match=r"format 9; this eyechart reads formats 1 to 3: use the eyechart that wrote it"
    ):
        Ledger(path)


@pytest.mark.parametrize("create", [True, False])
def test_a_folder_is_no_ledger(tmp_path: Path, create: bool) -> None:  # noqa: FBT001 - a parameter of the test
    """Nor is a file in a folder that does not exist."""
    for place in (tmp_path, tmp_path / "none" / "ledger.sqlite"):
        with pytest.raises(LedgerError, match=str(place)):
            Ledger(place, create=create)


def test_a_ledger_can_be_read_while_it_is_written(path: Path) -> None:
    """A reader sees what was committed, does not wait, and does not make the writer wait."""
    with Ledger(path, create=True) as writer:
        writer.close(writer.begin(KEY, "digest"), FULL)
        with closing(sqlite3.connect(path, timeout=0)) as reader:
            reader.execute("BEGIN")
            assert reader.execute("SELECT count(*) FROM replies").fetchone() == (1,)
            writer.close(writer.begin(OTHER, "digest"), FULL)
            assert reader.execute("SELECT count(*) FROM replies").fetchone() == (1,)
            reader.execute("COMMIT")
            assert reader.execute("SELECT count(*) FROM replies").fetchone() == (2,)


def test_opening_an_existing_ledger_to_create_it_keeps_its_rows(path: Path) -> None:
    """Resuming opens the ledger as beginning does."""
    fill(path, (KEY, FULL))
    fill(path, (OTHER, FULL))
    with Ledger(path, create=True) as ledger:
        assert ledger.finished() == {KEY, OTHER}


def test_a_budget_counts_the_calls_of_models_that_are_not_asked_now(path: Path) -> None:
    """A limit is the whole run's, whoever is asked on this day."""
    with Ledger(path, create=True) as ledger:
        ledger.close(ledger.begin(KEY, "d"), Reply("SLOW"))
        budget = budget_of(Limits(calls=1), ["another:model"], ledger)
        assert ledger.models() == [MODEL]
    assert not budget.may_send("another:model")
    assert budget.stopped == "1 call was sent, and --max-calls is 1"
