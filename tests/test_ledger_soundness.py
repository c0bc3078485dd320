"""A ledger that is not what was written, or whose schema is not ours, is refused by name, read or appended to."""

import random
import shutil
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from eyechart.calls import CallKey, Reply
from eyechart.errors import LedgerError, MissingCallsWarning
from eyechart.ledger import Ledger
from eyechart.ledger.columns import UnsoundError, read_columns
from eyechart.ledger.schema import SCHEMAS, VERSION

MODEL = "standin:steady"
KEYS = [CallKey("battery", MODEL, "baseline@0", f"f{number}", "real") for number in range(4)]
MANY = 400
FULL = Reply("GO", "stop", None, "", 10, 9, 0.5, "so", 8, 0.25, 200, 1.5, "m-2026", "up", 0.001, 2.5, "fp", 7, "ab")


def rows_of(path: Path) -> tuple[object, ...]:
    """Return all that a ledger says of what came, in the order of its rows, and of how many calls nothing did."""
    with Ledger(path) as ledger:
        came = [attempt for attempt in ledger.attempts(MODEL) if attempt.reply is not None]
        return ledger.finished(), list(ledger.replies(MODEL)), came, len(ledger.unknown())


def opened(path: Path) -> None:
    """Open a ledger that nothing has checked."""
    with Ledger(path):
        pass


def in_columns(path: Path) -> None:
    """Read a ledger that nothing has checked as columns, as commands of a battery do."""
    with Ledger(path, sound=False) as ledger:
        ledger.columns()


READ = (opened, in_columns)
"""Ways of reading that check every row."""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Return where a ledger lies with an unfinished call, a failure that was repeated, and finished calls."""
    path = tmp_path / "ledger.sqlite"
    with Ledger(path, create=True) as ledger:
        ledger.begin(KEYS[0], "digest")
        ledger.close(ledger.begin(KEYS[1], "digest"), Reply(error="timeout", error_detail="late"))
        for key in KEYS[1:]:
            ledger.close(ledger.begin(key, "digest"), FULL)
    return path


def change(path: Path, script: str) -> None:
    """Change a file through a connection that lets anything be done to it."""
    with closing(sqlite3.connect(path)) as sql:
        triggers = sql.execute("SELECT name, sql FROM sqlite_master WHERE type = 'trigger'").fetchall()
        for name, _ in triggers:
            sql.execute(f"DROP TRIGGER {name}")
        sql.executescript(script)
        for _, text in triggers:
            sql.execute(text)
        sql.commit()


@pytest.mark.parametrize("column", sorted({"attempt", "call", "final", "closed_at", "row_sha256", *Reply.__slots__}))
def test_a_value_of_a_reply_that_was_changed_is_named_with_its_call(path: Path, column: str) -> None:
    """Every column of its row; commands that read refuse the ledger, and nothing is appended to it."""
    with closing(sqlite3.connect(path)) as sql:
        (kind,) = sql.execute("SELECT type FROM pragma_table_info('replies') WHERE name = ?", (column,)).fetchone()
    values = {"TEXT": "'x' || ifnull({0}, '')", "INTEGER": "ifnull({0}, 0) + 1", "REAL": "ifnull({0}, 0) + 1"}
    to = "9" if column == "attempt" else values[kind].format(column)
    change(path, f"UPDATE replies SET {column} = {to} WHERE attempt = 5")  # noqa: S608 - our own names
    belongs = "the reply to attempt 9, which belongs to no call"
    named = belongs if column == "attempt" else f"{MODEL}'s reply about f3 under real"
    for create in (False, True):
        with pytest.raises(LedgerError, match=rf"ledger\.sqlite is damaged in {named}; restore it from a copy"):
            Ledger(path, create=create)
    with pytest.raises(LedgerError, match=f"is damaged in {named}; restore"):
        in_columns(path)
    with Ledger(path, sound=False) as ledger:
        assert ledger.damaged() == [named]


@pytest.mark.parametrize(
    "script",
    [
        *(f"calls SET {field} = {field} || 'x' WHERE frame = 'f3'" for field in CallKey._fields),
        *(f"attempts SET {one} = 'x' WHERE id = 5" for one in ("reason", "request_sha256", "sent_at")),
        "attempts SET call = 1, number = 2 WHERE id = 5",
    ],
)
def test_what_was_asked_in_a_call_is_part_of_its_checksum(path: Path, script: str) -> None:
    """A reply whose call or attempt was changed is another reply."""
    change(path, f"UPDATE {script}".replace("repeat || 'x'", "repeat + 1"))
    for read in READ:
        with pytest.raises(LedgerError, match=f"is damaged in .*{MODEL}x?'s reply about f"):
            read(path)


@pytest.mark.parametrize("script", ["number = 3 WHERE id = 5", "call = 99 WHERE id = 1", "number = 2 WHERE id = 1"])
def test_an_attempt_that_is_none_of_its_calls_is_named(path: Path, script: str) -> None:
    """Also one that nothing came of, which has no checksum."""
    change(path, f"UPDATE attempts SET {script}")  # noqa: S608 - our own words
    for read in READ:
        with pytest.raises(LedgerError, match=f"attempt {script[-1]}, which breaks the count of its call"):
            read(path)


def test_several_damaged_rows_are_counted(path: Path) -> None:
    """The first is named."""
    change(path, "UPDATE replies SET text = 'STOP'")
    with pytest.raises(LedgerError, match=f"{MODEL}'s reply about f1 under real and 3 more; restore"):
        Ledger(path)


@pytest.mark.filterwarnings("ignore:.*is without its counter")
@pytest.mark.parametrize("read", READ)
def test_no_flipped_bit_changes_what_is_read(path: Path, tmp_path: Path, read: Callable[[Path], object]) -> None:
    """Anywhere in the file: all that is said of the calls is what it was, or the ledger is refused."""
    whole, truth, bits = path.read_bytes(), rows_of(path), random.Random(1)  # noqa: S311 - which bits, no secret
    copy, refused = tmp_path / "copy.sqlite", 0
    used = [at for at, byte in enumerate(whole) if byte] + [bits.randrange(len(whole)) for _ in range(100)]
    for at in bits.sample(used, MANY):
        flipped = bytearray(whole)
        flipped[at] ^= 1 << bits.randrange(8)
        copy.write_bytes(flipped)
        try:
            read(copy)  # what is found sound is not checked again
            rows = rows_of(copy)
        except LedgerError:
            refused += 1
            continue
        assert rows == truth, (at, whole[at])
    assert refused > 150


SCHEMA = {
    "a view in a table's place": "ALTER TABLE replies RENAME TO old; CREATE VIEW replies AS SELECT * FROM old;",
    "a trigger of somebody else's": "CREATE TRIGGER loud AFTER INSERT ON replies BEGIN DELETE FROM calls; END;",
    "rows can be changed": "DROP TRIGGER replies_UPDATE;",
    "rows can be removed": "DROP TRIGGER calls_DELETE;",
    "a trigger that does nothing": "DROP TRIGGER replies_UPDATE; CREATE TRIGGER replies_UPDATE BEFORE UPDATE ON calls "
    "BEGIN SELECT 1; END;",
    "a column more": "ALTER TABLE replies ADD COLUMN mood TEXT;",
    "a column less": "ALTER TABLE replies DROP COLUMN provider;",
    "an index less": "DROP INDEX final_replies;",
    "a table more": "CREATE TABLE songs (name);",
    "a virtual table": "CREATE VIRTUAL TABLE words USING fts5(text);",
    "a virtual table in a table's place": "DROP TABLE replies; CREATE VIRTUAL TABLE replies USING fts5(attempt, call);",
    "no table": "DROP TABLE replies; DROP TABLE attempts; DROP TABLE calls;",
    "another program's": "PRAGMA application_id = 1196444487;",
    "no version": "PRAGMA user_version = 0;",
    "an older version": "PRAGMA user_version = 2;",
    "a later version": "PRAGMA user_version = 4;",
    "a negative version": "PRAGMA user_version = -3;",
}


@pytest.mark.parametrize("what", SCHEMA)
def test_a_ledger_with_another_schema_is_refused(path: Path, what: str) -> None:
    """To read and to append, in words; the file stays as it is."""
    with closing(sqlite3.connect(path)) as sql:
        sql.executescript(SCHEMA[what])
    before = path.read_bytes()
    for create in (False, True):
        with pytest.raises(LedgerError, match=r"ledger\.sqlite (is no|is a ledger of format|holds no)"):
            Ledger(path, create=create)
    assert path.read_bytes() == before
    assert sorted(one.name for one in path.parent.iterdir()) == ["ledger.sqlite", "ledger.sqlite.counter"]


def test_the_names_of_a_foreign_schema_cannot_move_a_terminal(path: Path) -> None:
    """They come from a file of anybody's."""
    with closing(sqlite3.connect(path)) as sql:
        sql.execute('CREATE TABLE "a\x1b[2Jb" (x)')
    with pytest.raises(LedgerError) as said:
        Ledger(path)
    assert str(said.value).isprintable()


@pytest.mark.parametrize("version", [1, 2])
def test_an_older_ledger_has_its_own_schema(tmp_path: Path, version: int) -> None:
    """It is held against that of its format; damage to its tables, not to the words of a reply, is seen."""
    path = tmp_path / "ledger.sqlite"
    with closing(sqlite3.connect(path)) as sql:
        sql.executescript(f"{SCHEMAS[version]} PRAGMA user_version = {version};")
    with Ledger(path) as ledger:
        assert ledger.unchecked() == 0
    with closing(sqlite3.connect(path)) as sql:
        sql.executescript("CREATE TABLE songs (name);")
    with pytest.raises(LedgerError, match=f"songs of its schema differ from those of format {version}"):
        Ledger(path)


def test_a_ledger_that_holds_nothing_is_refused(path: Path) -> None:
    """Empty, or cut to nothing: no run leaves such a file, so something was lost."""
    path.write_bytes(b"")
    for create in (False, True):
        with pytest.raises(LedgerError, match=r"ledger\.sqlite holds no table \(0 bytes\): restore it from a copy"):
            Ledger(path, create=create)
    assert path.read_bytes() == b""


@pytest.mark.parametrize("keep", [0.3, 0.6, 0.95])
def test_a_ledger_that_was_cut_is_refused(path: Path, keep: float) -> None:
    """Wherever."""
    path.write_bytes(path.read_bytes()[: int(keep * path.stat().st_size)])
    for create in (False, True):
        with pytest.raises(LedgerError, match=r"ledger\.sqlite is (damaged|no ledger)"):
            Ledger(path, create=create)


@pytest.mark.parametrize("at", ["ledger.SCHEMAS", "connect", "Path.replace"])
def test_a_run_that_is_killed_while_it_makes_its_ledger_begins_anew(tmp_path: Path, at: str) -> None:
    """No file without tables stands in the ledger's place, at no time."""
    path = tmp_path / "ledger.sqlite"
    die = {
        "connect": "ledger.connect = lambda *_: die()",
        "ledger.SCHEMAS": "ledger.SCHEMAS = {3: ledger.SCHEMAS[3].replace('DROP INDEX', 'SELECT die(); DROP INDEX')}",
        "Path.replace": "ledger.Path.replace = lambda *_: die()",
    }[at]
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
{die}
ledger.Ledger(Path({str(path)!r}), create=True)
"""
    assert subprocess.run([sys.executable, "-c", says], check=False).returncode == -signal.SIGKILL
    assert not path.exists()
    with Ledger(path, create=True) as ledger:
        ledger.close(ledger.begin(KEYS[0], "digest"), FULL)
        assert ledger.finished() == {KEYS[0]}
    assert sorted(one.name for one in tmp_path.iterdir()) == ["ledger.sqlite", "ledger.sqlite.counter"]


@pytest.mark.filterwarnings("ignore:.*is without its counter")
def test_a_ledger_that_was_found_sound_is_looked_into_again_when_it_changed(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its bytes are what is remembered, not its name or its times."""
    paths: list[Path] = []

    def counted(look: Callable[[sqlite3.Connection, Path], None]) -> Callable[[sqlite3.Connection, Path], None]:
        return lambda sql, path: paths.append(path) or look(sql, path)

    from eyechart.ledger import ledger as module  # noqa: PLC0415 - to patch

    monkeypatch.setattr(module, "require_sound", counted(module.require_sound))
    copy = path.with_name("copy.sqlite")
    shutil.copyfile(path, copy)
    for _ in range(3):
        Ledger(path).__exit__(None, None, None)
        Ledger(copy).__exit__(None, None, None)
    assert paths == [path]
    with Ledger(path, create=True) as ledger:
        ledger.close(ledger.begin(KEYS[0], "digest"), FULL)
    Ledger(path).__exit__(None, None, None)
    assert paths == [path, path]


def _unchecked(path: Path, change: str) -> None:
    """Change a ledger by hand, behind its triggers."""
    with closing(sqlite3.connect(path)) as sql:
        triggers = [row[0] for row in sql.execute("SELECT sql FROM sqlite_master WHERE type = 'trigger'")]
        for trigger in triggers:
            sql.execute(f"DROP TRIGGER {trigger.split()[2]}")
        sql.execute(change)
        for trigger in triggers:
            sql.execute(trigger)
        sql.commit()


@pytest.mark.parametrize(
    "change",
    [
        "UPDATE replies SET text = 'LEFT', row_sha256 = NULL WHERE attempt = 2",
        "UPDATE replies SET row_sha256 = NULL WHERE attempt = 3",
        "UPDATE replies SET payload_bytes = 7, row_sha256 = NULL",
    ],
)
def test_a_reply_without_a_checksum_is_none_of_format_3(change: str, tmp_path: Path) -> None:
    """What is older than checksums came before every reply that has one, and says nothing that is newer."""
    path, said = tmp_path / "ledger.sqlite", CallKey("battery", "m", "p", "f", "real", 0)
    with Ledger(path, create=True) as ledger:
        for number in range(3):
            ledger.close(ledger.begin(said._replace(frame=f"f{number}"), "digest"), Reply("RIGHT"))
    _unchecked(path, change)
    for read in READ:
        with pytest.raises(LedgerError, match=r"is damaged in m's reply about f\d"):
            read(path)


def test_a_merged_ledger_has_a_checksum_for_every_reply(tmp_path: Path) -> None:
    """Also of those that come from one which is older than checksums."""
    old = Path(__file__).parent / "old" / "0.1.0" / "made" / "battery" / "ledger.sqlite"
    with Ledger(tmp_path / "ledger.sqlite", create=True) as ledger, Ledger(old) as other:
        key = CallKey("battery", "m", "p", "f", "real", 0)
        ledger.close(ledger.begin(key, "digest"), Reply("RIGHT"))
        ledger.absorb(other)
        assert other.unchecked()
        assert (ledger.unchecked(), ledger.damaged()) == (0, [])


@pytest.mark.parametrize("left", [".counter", "-wal .counter"])
def test_a_ledger_that_was_copied_without_what_lies_beside_it_is_said_to_be(left: str, tmp_path: Path) -> None:
    """Its log may hold its last rows, and nobody can count them."""
    path = tmp_path / "run" / "ledger.sqlite"
    path.parent.mkdir()
    (tmp_path / "copied").mkdir()
    with Ledger(path, create=True) as ledger:
        ledger.close(ledger.begin(CallKey("battery", "m", "p", "f", "real", 0), "digest"), Reply("RIGHT"))
        for one in path.parent.iterdir():
            if not one.name.endswith(tuple(left.split())):
                shutil.copyfile(one, tmp_path / "copied" / one.name)
        ledger.copy_to(tmp_path / "whole.sqlite")
    with pytest.warns(MissingCallsWarning, match=r"is without its counter, .* copy ledger\.sqlite\.counter and"):
        Ledger(tmp_path / "copied" / path.name).__exit__(None, None, None)
    with Ledger(tmp_path / "whole.sqlite") as copy, Ledger(path) as own:
        assert copy.held() == own.held()


def test_an_attempt_s_number_that_is_there_twice_is_noticed_without_an_index() -> None:
    """A score reads no index, and compares none with its table."""
    with closing(sqlite3.connect(":memory:")) as sql:
        sql.executescript(SCHEMAS[VERSION].replace("UNIQUE (call, number)", "CHECK (number > 0)"))
        sql.execute("INSERT INTO calls VALUES (1, 'battery', 'm', 'p', 'f', 'real', 0)")
        into = "INSERT INTO attempts (id, call, number, request_sha256, sent_at) VALUES (?, 1, 1, '', '')"
        sql.executemany(into, [(1,), (2,)])
        with pytest.raises(UnsoundError):
            read_columns(sql, None, by_frame=True, check=True)
