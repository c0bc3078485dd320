import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eyechart.attempts import budget_of
from eyechart.calls import UNFINISHED, CallKey, Reply
from eyechart.errors import LedgerError
from eyechart.ledger import UNKNOWN, Ledger
from eyechart.limits import Limits

MODEL = "standin:steady"
KEY = CallKey("battery", MODEL, "baseline@0", "f1", "real")
OTHER = replace(KEY, frame="f2")
FULL = Reply("STOP", "stop", None, "", 10, 1, 0.5)
EVERY = Reply("GO", "stop", None, "", 10, 9, 0.5, "so so", 8, 0.25, 200, 1.5, "m-2026", "upstream", 0.001, 2.5)


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


def test_a_reply_comes_back_verbatim(path: Path) -> None:
    """Every field, for every kind of reply."""
    replies = {
        "f1": FULL,
        "f2": Reply(error="exception", error_detail="x: y"),
        "f4": EVERY,
        "f3": Reply("a\0b\r\n\u2028ü😀", "length"),
    }
    fill(path, *((replace(KEY, frame=frame), reply) for frame, reply in replies.items()))
    with Ledger(path, create=True) as ledger:
        assert {key.frame: reply for key, reply in ledger.replies(MODEL)} == replies
        assert list(ledger.replies("nobody")) == []


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
    assert [(one.key, one.number, one.reply) for one in sent] == [(KEY, 1, None), (OTHER, 1, None), (OTHER, 2, FULL)]


def test_a_reply_ends_an_attempt_once(path: Path) -> None:
    """Neither the same attempt nor the same call gets a second final reply."""
    with Ledger(path, create=True) as ledger:
        one, two = ledger.begin(KEY, "digest"), ledger.begin(KEY, "digest")
        ledger.close(one, FULL)
        for attempt in (one, two):
            with pytest.raises(sqlite3.IntegrityError):
                ledger.close(attempt, FULL)


def test_absorbing_keeps_every_attempt_and_reply(path: Path, tmp_path: Path) -> None:
    """Keys, numbers, replies and open attempts come over; calls of both go on counting."""
    fill(path, (KEY, FULL), (OTHER, Reply(error="timeout")))
    more = tmp_path / "it's more.sqlite"
    third = replace(KEY, frame="f3")
    fill(more, (third, Reply(error="timeout")), (third, FULL), (OTHER, None), (OTHER, FULL))
    with Ledger(path, create=True) as ledger, Ledger(more) as other:
        assert ledger.absorb(other) == 1
        assert ledger.finished() == {KEY, OTHER, third}
        assert ledger.unknown() == set()
        assert dict(ledger.replies(MODEL)) == dict.fromkeys((KEY, OTHER, third), FULL)
        came = [one.reply for one in ledger.attempts(MODEL)]
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
        with Ledger(tmp_path / "double") as double, pytest.raises(LedgerError, match=r"double: 1 calls .*frame='f1'"):
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
            broken.setattr("eyechart.ledger._COPY_REPLIES", "INSERT INTO nowhere VALUES (?)")
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
        with pytest.raises(LedgerError, match=r"ledger\.sqlite is a ledger of format 0"):
            Ledger(path, create=create)
    assert path.read_bytes() == before


def test_a_file_that_was_cut_before_its_first_table_is_an_empty_ledger(path: Path) -> None:
    """A run that was killed while it made its ledger reads as empty, and resumes."""
    path.touch()
    with Ledger(path) as ledger:
        assert ledger.finished() == set()
    with Ledger(path, create=True) as ledger:
        ledger.close(ledger.begin(KEY, "digest"), FULL)
        assert ledger.finished() == {KEY}


def test_a_ledger_that_is_read_is_not_written(path: Path) -> None:
    """Without ``create`` a ledger only reads, also where its folder and file cannot be written."""
    with Ledger(path, create=True) as ledger:
        ledger.close(ledger.begin(KEY, "digest"), FULL)
    before = path.read_bytes()
    with Ledger(path) as ledger, pytest.raises(sqlite3.OperationalError, match="readonly"):
        ledger.begin(replace(KEY, frame="f9"), "digest")
    with Ledger(path) as ledger:
        assert ledger.finished() == {KEY}
    assert path.read_bytes() == before


def test_a_ledger_of_a_later_format_is_refused(path: Path) -> None:
    """By its number, with the number that this program reads."""
    fill(path, (KEY, FULL))
    with closing(sqlite3.connect(path)) as sql:
        sql.execute("PRAGMA user_version = 9")
    with pytest.raises(LedgerError, match=r"format 9; this eyechart reads format 2: use the eyechart that wrote it"):
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
    assert budget.stopped == "1 calls were sent, and --max-calls is 1"
