"""What parses bytes of others, each as a function of bytes: an answer, or an error in words, and nothing else."""

import io
import sqlite3
import tempfile
from collections.abc import Callable, Mapping
from contextlib import closing
from pathlib import Path

from bundles import checked
from eyechart.bundle import validate
from eyechart.calls import Reply
from eyechart.errors import EyechartError
from eyechart.importing.answers import read_answer_table
from eyechart.importing.faults import Faults
from eyechart.importing.inspect_log import open_log
from eyechart.importing.layout import DataSetLayout
from eyechart.importing.tables import open_table
from eyechart.ledger import Ledger
from eyechart.models.http import Response
from eyechart.models.openai_compatible import _read as read_completion
from eyechart.modes import read_mode
from eyechart.prompts import read_prompt
from eyechart.spaces.discrete import DRIVING, Discrete
from eyechart.spaces.motion import Dimension, MotionSpace
from eyechart.spaces.scene import SceneSpace

CORPUS = Path(__file__).parents[1] / "corpus"
_FOLDER = tempfile.TemporaryDirectory(prefix="eyechart-targets-")
WORK = Path(_FOLDER.name)
_SPACES = (
    DRIVING,
    Discrete("numbers", ("-2", "-1", "0", "1", "2"), (("-2", "2"), ("-1", "1")), (), ()),
    Discrete("letters", ("A", "B", "C", "D"), (), (), ()),
    Discrete("phrases", ("keep going", "come to a stop", "hard left", "hard right"), (), (), ()),
    SceneSpace(),
    MotionSpace("steps", (Dimension("x"), Dimension("y")), 2),
)


def replies(data: bytes) -> None:
    """Read a reply in one of the kinds of space, which the first byte names; an action is one of the space."""
    space, text = _SPACES[data[0] % len(_SPACES)] if data else DRIVING, data[1:4_000].decode(errors="replace")
    decision = space.read(Reply(text, "stop"))
    assert (decision.action is None) != (decision.missing is None)
    assert not isinstance(space, Discrete) or decision.action is None or decision.action in space.actions
    assert space.read(Reply(text, "stop")) == decision


def completions(data: bytes) -> None:
    """Read a chat completion, or a stream of one where the first byte is odd, or a tool call with the second bit."""
    kind = "text/event-stream" if data[:1] and data[0] % 2 else "application/json"
    reply = read_completion(
        Response(body=bytearray(data[1:]), status=200, content_type=kind), tool=bool(data[:1] and data[0] & 2)
    )
    assert isinstance(reply, Reply)
    assert isinstance(reply.text, str)


def put(name: str, data: bytes) -> Path:
    """Write data into a file of the working folder."""
    path = WORK / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return path


def answers(data: bytes) -> None:
    """Read a table of answers, of a kind that the first byte names."""
    path = put(f"answers{('.csv', '.jsonl', '.tsv')[data[0] % 3 if data else 0]}", data[1:])
    list(read_answer_table(path, Faults()))


def tables(data: bytes) -> None:
    """Read a table of pictures, of a kind that the first byte names."""
    path = put(f"table{('.csv', '.jsonl', '.tsv')[data[0] % 3 if data else 0]}", data[1:])
    list(open_table(path).rows)


def modes(data: bytes) -> None:
    """Read a request mode."""
    read_mode(put("mode.toml", data))


def prompts(data: bytes) -> None:
    """Read a prompt with its actions, or with its messages."""
    read_prompt(put("prompt.toml", data))


def robots(data: bytes) -> None:
    """Read the description of a LeRobotDataset."""
    put("set/meta/info.json", data)
    DataSetLayout(WORK / "set").info()


def logs(data: bytes) -> None:
    """Read a log of Inspect AI in JSON, with its samples."""
    list(open_log(put("log.json", data)).answers(Faults()))


def ledgers(data: bytes) -> None:
    """Read a ledger of whatever bytes, all its rows."""
    with Ledger(put("ledger.sqlite", data)) as ledger:
        for model in ledger.models():
            _ = list(ledger.replies(model)), list(ledger.attempts(model))
        _ = ledger.finished(), ledger.unknown(), ledger.damaged()


def rows(data: bytes) -> None:
    """Read a ledger in which one cell of a row holds what the bytes say, its triggers standing as before."""
    path = put("rows.sqlite", (CORPUS / "ledgers" / "ledger.sqlite").read_bytes())
    head, text = data[:3].ljust(3, b"\0"), data[3:]
    with closing(sqlite3.connect(path)) as sql:
        kept = triggers(sql)
        for name, _ in kept:
            sql.execute(f"DROP TRIGGER {name}")
        table = ("calls", "attempts", "replies")[head[0] % 3]
        columns = [row[1] for row in sql.execute(f"PRAGMA table_info({table})")]
        value = (text, text.decode(errors="replace"), int.from_bytes(text[:7], "little"), None)[head[2] % 4]
        try:
            sql.execute(f"UPDATE {table} SET {columns[head[1] % len(columns)]} = ? WHERE rowid = 1", (value,))  # noqa: S608
        except sqlite3.Error:  # what SQLite itself does not take
            return
        if head[2] % 8 > 3:  # as one who means harm writes it
            checked(sql)
        for _, text_of in kept:
            sql.execute(text_of)
        sql.commit()
    ledgers(path.read_bytes())


def triggers(sql: sqlite3.Connection) -> list[tuple[str, str]]:
    """Return the triggers of a ledger."""
    return sql.execute("SELECT name, sql FROM sqlite_master WHERE type = 'trigger'").fetchall()


def bundles(data: bytes) -> None:
    """Validate a bundle whose index holds the bytes."""
    import zipfile  # noqa: PLC0415 - where it is needed

    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as file:
        file.writestr("bundle.json", data)
    validate(put("bundle.zip", packed.getvalue()))


TARGETS: Mapping[str, Callable[[bytes], None]] = {
    "replies": replies,
    "completions": completions,
    "answers": answers,
    "tables": tables,
    "modes": modes,
    "prompts": prompts,
    "robots": robots,
    "logs": logs,
    "ledgers": ledgers,
    "rows": rows,
    "bundles": bundles,
}


def parse(name: str, data: bytes) -> None:
    """Give bytes to a target; an error of the project's is words. Any other goes through."""
    said = "read"
    try:
        TARGETS[name](data)
    except EyechartError as error:
        said = str(error)
    assert said
    assert len(said) < 20_000
