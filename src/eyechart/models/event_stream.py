"""Joins the server-sent events of a chat completion into the body of one that is not streamed."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from eyechart.models.http import Response, read_json

_NAMES = ("id", "model", "system_fingerprint", "provider", "usage")
_WORDS = ("content", "reasoning_content", "reasoning", "refusal")
_CALLS = ("tool_calls", "function_call")
_END = b"[DONE]"
_TYPE = "text/event-stream"
_REFUSED = "(refused without a word)"
_TEXTS = frozenset({"text", "output_text"})
"""The types of a message's parts that hold the answer."""
_THOUGHT = re.compile("think|thought|reason|summary|refusal", re.IGNORECASE)
"""Types of parts that are no answer: reasoning, and a refusal, which `refusal_of` reads."""
_BOM = b"\xef\xbb\xbf"


@dataclass(frozen=True, slots=True)
class StreamedCompletion:
    """A completion from events; ``whole`` says whether it is complete.

    ``first`` is the number of bytes up to the end of the first event with text, None without one.
    """

    body: dict[str, object]
    whole: bool
    first: int | None


def is_stream(came: Response) -> bool:
    """Return whether a response is a stream of events, by its type or its first bytes."""
    return came.content_type == _TYPE or came.body.removeprefix(_BOM).lstrip()[:6].startswith((b"data:", b"event:"))


def gather(came: Response) -> StreamedCompletion:
    """Join the events of a response; raises ValueError where a complete event is no JSON object.

    Only the first choice counts. The last event may be incomplete. A stream without a choice gives
    a body without one. An event with the name ``error`` is an error.
    """
    words, found, first = dict[str, list[str]](), dict[str, object](), None
    choice: dict[str, object] = {}
    ended = False
    for data, end, name in _events(came.body):
        if data.strip() == _END:
            ended = True
            break
        try:
            event = read_json(data)
        except ValueError:
            if end < len(came.body):
                raise
            break
        if not isinstance(event, dict):
            raise ValueError(f"an event is no JSON object but {type(event).__name__}")  # noqa: TRY004
        found |= {name: event[name] for name in (*_NAMES, "error") if event.get(name)}
        if name == b"error":
            found["error"] = event.get("error") or event or "an error without a word"
        if _add(event, words, choice) and first is None:
            first = end
    if not words and "finish_reason" not in choice:
        return StreamedCompletion(found, ended, first)
    message = {name: "".join(parts) for name, parts in words.items()} | {
        name: choice.pop(name) for name in _CALLS if name in choice
    }
    return StreamedCompletion(
        found | {"choices": [{**choice, "message": message}]}, ended or "finish_reason" in choice, first
    )


def first_words_s(came: Response, first: int | None) -> float | None:
    """Return the seconds until the first text of a stream, None where they were not measured."""
    return next((seconds for size, seconds in came.arrived if first is not None and size >= first), None)


def text_of(content: object) -> str:
    """Return a message's text, from a string or from parts."""
    if isinstance(content, str):
        return content
    if isinstance(content, list):
        return "".join(map(_part, content))
    return _part(content) if isinstance(content, dict) else ""


def _part(part: object) -> str:
    text = part.get("text") if isinstance(part, dict) and part.get("type", "text") in _TEXTS else part
    return text if isinstance(text, str) else ""


def require_text(content: object) -> None:
    """Raise ValueError where `text_of` would miss a part of the answer in a message's content."""
    if isinstance(content, int | float):
        raise ValueError(f"the content of the message is {content!r}, no text")  # noqa: TRY004
    parts = content if isinstance(content, list) else [content] if isinstance(content, dict) else []
    for part in parts:
        kind, said = (part.get("type", "text"), part.get("text")) if isinstance(part, dict) else ("text", part)
        if said and (kind not in _TEXTS or not isinstance(said, str)) and not _THOUGHT.search(str(kind)):
            raise ValueError(f"the content of the message has a part that cannot be read, of type {str(kind)!r}")


def refusal_of(message: Mapping[str, object]) -> str | None:
    """Return the refusal in a message's field or its content's parts; None without a refusal."""
    said, parts = message.get("refusal"), message.get("content")
    refused = [part.get("refusal") for part in parts if _is_refusal(part)] if isinstance(parts, list) else []
    if said and (not isinstance(said, str) or said.strip()):
        refused.append(text_of(said))
    return "".join(one for one in refused if isinstance(one, str)) if refused else None


def _is_refusal(part: object) -> bool:
    return isinstance(part, dict) and part.get("type") == "refusal"


def _add(event: dict[str, object], words: dict[str, list[str]], choice: dict[str, object]) -> bool:
    """Add an event's first choice to those before it; return whether it holds text."""
    choices = event.get("choices")
    mine = choices[0] if isinstance(choices, list) and choices and isinstance(choices[0], dict) else {}
    if mine.get("index", 0) != 0:
        return False
    delta = mine.get("delta") or mine.get("message") or mine.get("delta")  # an empty one counts
    said = _said(delta) if isinstance(delta, dict) else {}
    for name, text in said.items():
        words.setdefault(name, []).append(text)
    choice |= {name: mine[name] for name in ("error",) if mine.get(name)}
    # An abnormal end stays.
    if mine.get("finish_reason") and choice.get("finish_reason", "stop") == "stop":
        choice["finish_reason"] = mine["finish_reason"]
    if isinstance(delta, dict) and delta.get("function_call"):
        choice["function_call"] = delta["function_call"]
    if isinstance(delta, dict) and delta.get("tool_calls"):
        calls = _joined(choice.get("tool_calls"), delta["tool_calls"])
        choice["tool_calls"] = calls
    return any(said.values())


def _joined(calls: object, more: object) -> list[dict[str, object]]:
    """Return tool calls with the next pieces of their arguments, each joined by its index."""
    result: dict[int, dict[str, object]] = dict(enumerate(calls)) if isinstance(calls, list) else {}
    for place, piece in enumerate(more if isinstance(more, list) else [more]):
        number = piece.get("index") if isinstance(piece, dict) else None
        at = number if isinstance(number, int) else place
        before, given = arguments_of(result.get(at)), arguments_of(piece)
        both = isinstance(before, str) and isinstance(given, str)
        result[at] = {"function": {"arguments": f"{before}{given}" if both else before if given is None else given}}
    return list(result.values())


def arguments_of(call: object) -> object:
    """Return the arguments of a tool call as the server sent them, None without any."""
    function = call.get("function") if isinstance(call, dict) else None
    return function.get("arguments") if isinstance(function, dict) else None


def _said(delta: dict[str, object]) -> dict[str, str]:
    """Return the texts of a delta by field; raises ValueError as `require_text` does."""
    require_text(delta.get("content"))
    said = {name: text_of(delta.get(name)) for name in _WORDS}
    if (refused := refusal_of(delta)) is not None:
        said["refusal"] = refused or _REFUSED
    return said


def _events(body: bytearray) -> Iterator[tuple[bytes, int, bytes]]:
    """Yield each event's data, the place of its end, and its name; other fields are left out."""
    held, place, name = list[bytes](), 0, b""
    for line in bytes(body).splitlines(keepends=True):
        place += len(line)
        text = line.rstrip(b"\r\n").removeprefix(_BOM if place == len(line) else b"")
        if text.startswith(b"data:"):
            held.append(text[5:].removeprefix(b" "))
        elif text.startswith(b"event:"):
            name = text[6:].strip()
        elif not text:
            if held:
                yield b"\n".join(held), place, name
            held, name = [], b""
    if held:
        yield b"\n".join(held), place, name
