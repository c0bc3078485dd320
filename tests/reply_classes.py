"""Classes of replies of a guardian's members, each with what it may count for, written before the rules of reading."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from eyechart.calls import Reply

CLOSE_M = 18.0
"""What the question calls close."""
OBJECTS = {
    "@clear": '{"lead_gap_m": null, "close": false, "left_clear": true, "right_clear": true, "confidence": 0.9}',
    "@hazard": '{"lead_gap_m": 5.0, "close": true, "left_clear": true, "right_clear": false, "confidence": 0.9}',
}
"""What stands for an estimate in the table."""


@dataclass(frozen=True, slots=True)
class Row:
    """A class: what the message of an OpenAI-compatible server holds, and the outcome that it must have.

    ``expected`` is ``clear``, ``hazard``, or ``abstain`` with its reason.
    """

    name: str
    expected: str
    content: str | None
    finish_reason: str | None
    more: Mapping[str, object] = field(default_factory=dict)

    @property
    def choice(self) -> dict[str, object]:
        """Return the choice as a server sends it."""
        more = dict(self.more)
        error = {"error": more.pop("choice_error")} if "choice_error" in more else {}
        message = {"role": "assistant", "content": self.content, **more}
        return {"index": 0, "message": message, "finish_reason": self.finish_reason, **error}


def _rows() -> tuple[Row, ...]:
    found = []
    for line in Path(__file__).with_suffix(".jsonl").read_text(encoding="utf-8").splitlines():
        said = json.loads(line)
        content = said.pop("content")
        for sign, estimate in OBJECTS.items():
            content = content and content.replace(sign, estimate)
        found.append(Row(said.pop("class"), said.pop("expected"), content, said.pop("finish_reason", None), said))
    return tuple(found)


ROWS = _rows()


def reply(row: Row) -> Reply:
    """Return the reply of a class as a callable gives it, which has no field beside text and finish reason."""
    return Reply(row.content or "", row.finish_reason)
