"""A bank's battery as a task of Inspect AI; 'eyechart run import' reads its log.

  inspect eval eyechart/battery -T asked=FOLDER --model openai/MODEL

'eyechart frames export' wrote ``FOLDER``. The task needs no other module of eyechart, so it also
runs where eyechart's own requirements cannot be met.
"""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from eyechart.errors import SourceError, plain_file, read_at_most

try:
    from inspect_ai import Task, task
    from inspect_ai.dataset import MemoryDataset, Sample
    from inspect_ai.model import (
        ChatMessageAssistant,
        ChatMessageSystem,
        ChatMessageUser,
        ContentImage,
        ContentText,
        GenerateConfig,
    )
    from inspect_ai.solver import generate
except ImportError:
    HERE = False

    def task(function: Any) -> Any:  # noqa: ANN401 - as Inspect's own, which is not there
        """Return a task's function as it is."""
        return function
else:
    HERE = True

MAX_TOKENS = 1024
"""The default budget of a reply, as in eyechart's own runs."""
_LONGEST = 1_000_000
"""Most characters of a call, and bytes of an export's description: a bound on memory."""


@task  # type: ignore[untyped-decorator]
def battery(asked: str) -> Any:  # noqa: ANN401 - a Task of Inspect
    """Return the task that makes every call of an export, in order, each alone.

    Temperature is 0 and a reply has 1024 tokens, unless Inspect sets them. A failed sample does not
    end the task. Raises SourceError if Inspect AI is not installed, or the folder is no export.
    """
    if not HERE:
        raise SourceError("this needs Inspect AI: pip install inspect-ai, in the environment that runs it")
    folder = Path(asked).resolve()
    rows = list(_rows(folder))
    return Task(
        dataset=MemoryDataset([_sample(row, folder) for row in rows], name=_batch(folder)),
        solver=generate(cache=False),
        config=GenerateConfig(temperature=0.0, max_tokens=MAX_TOKENS),
        fail_on_error=False,
        name="battery",
    )


def _rows(folder: Path) -> Iterator[dict[str, Any]]:
    try:
        with plain_file(folder / "asked.jsonl").open(encoding="utf-8") as lines:
            while line := lines.readline(_LONGEST + 1):
                yield json.loads(_bounded(line))
    except (OSError, ValueError, RecursionError) as error:
        raise SourceError(
            f"{folder} is no export: {error}; 'eyechart frames export BANK --out FOLDER' makes one"
        ) from None


def _bounded(line: str) -> str:
    """Return a line; raises ValueError if it is longer than any call."""
    if len(line) > _LONGEST:
        raise ValueError(f"a line of asked.jsonl has more than {_LONGEST} characters")
    return line


def _batch(folder: Path) -> str:
    """Return a name of the export that differs by bank, prompt and seed."""
    try:
        about = json.loads(read_at_most(folder / "asked.json", _LONGEST, SourceError, "the description of an export"))
        return f"{about['bank']}-{about['batch'][:8]}"
    except (ValueError, LookupError, TypeError, RecursionError) as error:
        raise SourceError(f"{folder} is no export: {error!r}") from None


def _sample(row: dict[str, Any], folder: Path) -> Any:  # noqa: ANN401 - a Sample of Inspect
    """Return a row as a sample: system words, pictures and user's words, as eyechart does."""
    if row.get("messages"):
        turns = [_message(turn, folder) for turn in row["messages"]]
        return Sample(id=row["call"], input=turns, metadata={"call": row["call"]})
    pictures = [row[name] for name in row if name.partition("@")[0] == "picture" and row[name]]
    content = [*(ContentImage(image=str(folder / name)) for name in pictures), ContentText(text=row["user"])]
    user = ChatMessageUser(content=content if pictures else row["user"])
    return Sample(
        id=row["call"],
        input=[*([ChatMessageSystem(content=row["system"])] if row["system"] else []), user],
        metadata={"call": row["call"]},
    )


def _message(turn: dict[str, Any], folder: Path) -> Any:  # noqa: ANN401 - a ChatMessage of Inspect
    """Return a message of a call, with its pictures in their places."""
    parts = turn["content"]
    if turn["role"] != "user":
        kind = ChatMessageSystem if turn["role"] == "system" else ChatMessageAssistant
        return kind(content="".join(part["text"] for part in parts))
    content = [
        ContentText(text=part["text"]) if part["type"] == "text" else ContentImage(image=str(folder / part["image"]))
        for part in parts
    ]
    return ChatMessageUser(content=content)
