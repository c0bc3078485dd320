"""``openai:MODEL``: chat completions of OpenAI and of servers with its API, pictures included.

Pictures come before the text. The runner retries; the key comes from the environment only.
"""

import base64
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from urllib.parse import urlsplit

import orjson

from eyechart.calls import BLOCKED, REFUSED, Query, Reply, answer_from_reasoning
from eyechart.errors import SpecError
from eyechart.frames import media_type
from eyechart.messages import Part, Turn
from eyechart.models import require_options
from eyechart.models.energy import metered
from eyechart.models.event_stream import (
    arguments_of,
    first_words_s,
    gather,
    is_stream,
    refusal_of,
    require_text,
    text_of,
)
from eyechart.models.faults import WITHIN, kind_of_status, with_proof
from eyechart.models.http import (
    Endpoint,
    Response,
    count_of,
    end_of,
    is_loopback,
    number_of,
    read_json,
    unlike_json,
    words_of,
)
from eyechart.modes import TOKEN_FIELDS, RequestMode
from eyechart.spaces.space import ending

BASE_URL = "https://api.openai.com/v1"
KEY = "OPENAI_API_KEY"
OPTIONS = {"energy": "true measures this machine's energy during a call, for a server that runs here"}

NO_CHOICE = "the JSON has no choice with a message, as when a filter blocks the request"
_PATH = "/chat/completions"
_VERSIONED = re.compile(r"/v\d+(/|$)")
_SECURED = re.compile(r"HTTPS port|TLS|redirected to https:|upgrade to https", re.IGNORECASE)
_NO_SYSTEM = re.compile(
    r"\b(system|developer)['\" ]*(role|message|instruction|prompt)|\brole.{0,20}\bsystem\b|roles must alternate"
    r"|only user and assistant roles",
    re.IGNORECASE,
)
"""How servers say that they take no system role."""
_NOBODY = {"missing_model", "unreadable", "gateway", "bad_request"}
"""The failures of an address without chat completions."""
TOOL = "decide"
_TOOL_DOES = "Give the answer."
_PLACE = b"\0"
"""The place of a picture in a body: a byte that JSON escapes in texts."""
_SEEDS = 2**31
"""Some servers keep a seed in 32 bits."""


@dataclass(slots=True)
class OpenAICompatible:
    """A model of an OpenAI-compatible server. Only the replies name its version (``served``)."""

    name: str
    mode: RequestMode
    endpoint: Endpoint
    facts: Mapping[str, str]
    version: str = "as served"
    _fixed: dict[str, object] = field(default_factory=dict)

    async def answer(self, query: Query) -> Reply:
        """Answer one query. A failure is a Reply with its kind."""
        spoken = query.said_by(self.mode.system)
        body = orjson.dumps(self._fixed | _request_body(spoken, self.mode) | dict(self.mode.body))
        call = self._send(_with_pictures(body, spoken.pictures))
        return await metered(call) if self.mode.options.get("energy") else await call

    async def _send(self, payload: bytes) -> Reply:
        came = await self.endpoint.post(_PATH, payload)
        reply = came.failure() if came.error else _read(came, tool=self.mode.structured == "tool_call")
        if self.mode.answer == "reasoning":
            reply = answer_from_reasoning(reply)
        return self.endpoint.scrubbed(_hinted(reply, self.mode) if reply.error else reply)

    async def close(self) -> None:
        """Close the session."""
        await self.endpoint.close()


def open_model(name: str, mode: RequestMode) -> OpenAICompatible:
    """Open a model without a request; raises SpecError where its key is not in the environment."""
    require_options(mode, OPTIONS)
    base_url = (mode.base_url or BASE_URL).rstrip("/").removesuffix(_PATH)
    headers = mode.header_values()
    secrets = [value for one, value in headers.items() if value != mode.headers[one]]
    key = os.environ.get(mode.key_env or KEY, "").strip()
    authorised = any(header.lower() == "authorization" for header in headers)
    if not key and not authorised and (mode.key_env or base_url == BASE_URL):
        raise SpecError(
            f"'{mode.spec}' needs a key. Set the environment variable {mode.key_env or KEY}, or name another with "
            "--key-env (key_env in the file of --mode). For a server that needs no key, give --base-url"
        )
    if key and not key.isascii():
        raise SpecError(f"the environment variable {mode.key_env or KEY} holds no key: a key is ASCII")
    if key and not authorised:
        headers["Authorization"] = f"Bearer {key}"
    secrets += [part for value in secrets for part in value.split()] + [key] * bool(key)
    endpoint = Endpoint(base_url, mode.timeout_s, headers, tuple(secrets), mode.query)
    warnings = [*_unpinned(base_url, mode), *_in_the_clear(base_url, key)]
    facts = {"endpoint": base_url, **({"warning": "; ".join(warnings)} if warnings else {})}
    fixed: dict[str, object] = {"model": name, mode.token_field: mode.max_tokens}
    if mode.temperature is not None:
        fixed["temperature"] = mode.temperature
    return OpenAICompatible(name, mode, endpoint, facts, _fixed=fixed)


def names() -> dict[str, str]:
    """Return the kinds of names that follow ``openai:`` in a SPEC, each with its meaning."""
    return {"MODEL": "a model of OpenAI, or with --base-url of vLLM, llama.cpp, SGLang, OpenRouter, transformers serve"}


def _unpinned(base_url: str, mode: RequestMode) -> list[str]:
    """Return a warning where a router may mix upstreams, and so versions and quantisations."""
    if not (urlsplit(base_url).hostname or "").endswith("openrouter.ai"):
        return []
    chosen = mode.body.get("provider")
    if isinstance(chosen, Mapping) and (
        chosen.get("only") or (chosen.get("order") and chosen.get("allow_fallbacks") is False)
    ):
        return []
    pin = """--body 'provider={"only": ["NAME"], "allow_fallbacks": false}'"""
    return [f"routing is not pinned: replies of several upstreams may mix; pin it with {pin}"]


def _in_the_clear(base_url: str, key: str) -> list[str]:
    clear = key and urlsplit(base_url).scheme == "http" and not is_loopback(base_url)
    return ["the key is sent without encryption: the address begins with http://"] if clear else []


def _request_body(query: Query, mode: RequestMode) -> dict[str, object]:
    """Return the part of a request that depends on the query."""
    body: dict[str, object] = {"messages": list(map(_message, query.turns))}
    if mode.seed:
        body["seed"] = query.seed % _SEEDS
    if mode.stream != "none":
        body["stream"] = True
    if mode.stream == "usage":
        body["stream_options"] = {"include_usage": True}
    if mode.structured == "json_object":
        body["response_format"] = {"type": "json_object"}
    elif mode.structured == "json_schema":
        schema = {"name": "decision", "strict": True, "schema": query.schema}
        body["response_format"] = {"type": "json_schema", "json_schema": schema}
    elif mode.structured == "tool_call":
        function = {"name": TOOL, "description": _TOOL_DOES, "strict": True, "parameters": query.schema}
        body["tools"] = [{"type": "function", "function": function}]
        body["tool_choice"] = {"type": "function", "function": {"name": TOOL}}
    return body


def read_completion(body: Mapping[str, object], status: int) -> Reply:
    """Return the reply in a body that was stored with its HTTP status, as one that just came.

    It has no times and no digest of a request.
    """
    came = Response(bytearray(orjson.dumps(body)), status)
    if status == 200:
        reply = _read(came, tool=False)
    else:
        kind, words = kind_of_status(status, body), words_of(body)
        reply = came.failure(kind, with_proof(words, status, body) if kind == "bad_request" else words)
    return replace(reply, seconds=None, payload_bytes=None, payload_sha256=None)


def _message(turn: Turn) -> dict[str, object]:
    """Return a message; only the user's content is a list of parts."""
    if turn.role != "user":
        return {"role": turn.role, "content": turn.words}
    return {"role": turn.role, "content": list(map(_content, turn.parts))}


def _content(part: Part) -> dict[str, object]:
    if isinstance(part, str):
        return {"type": "text", "text": part}
    return {"type": "image_url", "image_url": {"url": orjson.Fragment(_PLACE)}}


def _with_pictures(body: bytes, pictures: Sequence[bytes]) -> bytes:
    """Return a body with the pictures in their places, each copied once."""
    if not pictures:
        return body
    before, *after = body.split(_PLACE)
    pieces = [before]
    for picture, rest in zip(pictures, after, strict=True):
        url = f'"data:{media_type(picture)};base64,'
        pieces += (url.encode(), base64.b64encode(picture), b'"', rest)
    return b"".join(pieces)


def _read(came: Response, *, tool: bool) -> Reply:
    """Read a body of status 200, streamed or not; a body of another shape is a failure.

    ``tool``: the answer is in the arguments of the function that the request offers.
    """
    if is_stream(came):
        return _read_stream(came, tool=tool)
    try:
        body = read_json(came.body)
    except ValueError as error:
        return came.failure("unreadable", f"{unlike_json(came)}: {error}")
    if not isinstance(body, dict):
        return came.failure("unreadable", f"the body is no JSON object but {type(body).__name__}")
    return _read_body(came, body, tool=tool)


def _read_stream(came: Response, *, tool: bool) -> Reply:
    """Read a stream of events; its first byte counts from its first words."""
    try:
        streamed = gather(came)
    except ValueError as error:
        return came.failure("unreadable", f"an event of the stream is no JSON of a message: {error}")
    came.first_byte_s = first_words_s(came, streamed.first)
    if not streamed.whole and not streamed.body.get("error"):
        return came.failure("cut_short", f"the stream ended after {len(came.body)} bytes, before it was done")
    counted: dict[str, object] = {"choices": []} if "usage" in streamed.body else {}
    return _read_body(came, {**counted, **streamed.body}, tool=tool)


def _read_body(came: Response, body: dict[str, object], *, tool: bool) -> Reply:
    if body.get("error"):
        return _failed(came, body["error"])
    choices = body.get("choices")
    choice = choices[0] if isinstance(choices, list) and choices and isinstance(choices[0], dict) else {}
    if choice.get("error"):
        return _failed(came, choice["error"])
    message = choice.get("message")
    if choices == []:
        return replace(came.failure("unreadable", NO_CHOICE), finish_reason=BLOCKED)
    if not isinstance(message, dict):
        return came.failure("unreadable", "the JSON has no choice with a message")
    try:
        require_text(message.get("content"))
    except ValueError as error:
        return came.failure("unreadable", str(error))
    reply = came.reply(**_said(body, choice, message))
    return _from_tool(reply, message) if tool else reply


def _hinted(reply: Reply, mode: RequestMode) -> Reply:
    """Return a failure with advice, if the model refuses a field or the address seems wrong."""
    said, hints = reply.error_detail, list[str]()
    if reply.error in REFUSED and "not support" in said:
        if mode.token_field != TOKEN_FIELDS[1] and "max_completion_tokens" in said:
            hints.append("--token-field max_completion_tokens")
        if mode.temperature is not None and "temperature" in said:
            hints.append("--temperature default")
    if (
        reply.error in {"bad_request", "gateway", "server_error"}
        and mode.system == "system"
        and _NO_SYSTEM.search(said)
    ):
        hints.append("--system user")
    if reply.error in REFUSED and mode.stream == "none" and re.search(r"\bstream", said, re.IGNORECASE):
        hints.append("--stream usage")
    if not hints:
        where = "" if mode.query else _misdirected(reply, mode.base_url)
        return replace(reply, error_detail=f"{said}; {where}") if where else reply
    return replace(reply, error_detail=f"{said}; ask with {' '.join(hints)}, or let 'eyechart probe' find the mode")


def _misdirected(reply: Reply, base_url: str) -> str:
    """Return advice on the address: its scheme, a path without a version, or the model's name."""
    scheme, _, rest = base_url.rstrip("/").partition("://")
    if scheme == "https" and reply.error == "connection" and "ssl" in reply.error_detail.lower():
        return f"this server may speak http: try --base-url http://{rest}"
    secured = reply.error in {"bad_request", "gateway", "server_error"} and _SECURED.search(reply.error_detail)
    if scheme == "http" and (secured or "no HTTP response" in reply.error_detail):
        return f"this server may speak https: try --base-url https://{rest}"
    if not reply.error or reply.error not in _NOBODY or not base_url:
        return ""
    if not _VERSIONED.search(rest) and (reply.error != "missing_model" or reply.status == 404):
        return f"the address does not end in /v1, as most do: try --base-url {scheme}://{rest}/v1"
    return f"{scheme}://{rest}/models lists what there is" if reply.error == "missing_model" else ""


def _failed(came: Response, error: object) -> Reply:
    """Return the failure in a reply of status 200; routers report upstream failures so."""
    fields = error if isinstance(error, dict) else {}
    words = words_of(fields.get("message") or error)
    code = count_of(fields.get("code"))
    if code is None or not 400 <= code < 600:
        return came.failure("server_error", f"{WITHIN}{words}")
    kind = kind_of_status(code, error)
    return came.failure(kind, with_proof(f"{WITHIN}{words}", code, error) if kind == "bad_request" else WITHIN + words)


def _said(body: dict[str, object], choice: dict[str, object], message: dict[str, object]) -> dict[str, object]:
    """Return the fields of a reply that a completion gives."""
    text, finish = text_of(message.get("content")), end_of(choice.get("finish_reason"))
    refusal = refusal_of(message)
    if ending(finish) not in {"cut", "filtered"}:  # a refusal or a tool call outranks a normal end
        finish = "refusal" if refusal is not None else _beside(body, message) or finish
    usage = body.get("usage")
    usage = usage if isinstance(usage, dict) else {}
    details = usage.get("completion_tokens_details")
    fingerprint = _line(body.get("system_fingerprint"))
    served = _line(body.get("model"))
    return {
        "text": text or refusal or "",
        "finish_reason": finish,
        "prompt_tokens": count_of(usage.get("prompt_tokens")),
        "completion_tokens": count_of(usage.get("completion_tokens")),
        "reasoning": text_of(message.get("reasoning_content")) or text_of(message.get("reasoning")),
        "reasoning_tokens": count_of(details.get("reasoning_tokens")) if isinstance(details, dict) else None,
        "served": f"{served} {fingerprint}" if served and fingerprint else served,
        "provider": _line(body.get("provider")),
        "system_fingerprint": fingerprint,
        "cost_usd": number_of(usage.get("cost")),
    }


def _from_tool(reply: Reply, message: dict[str, object]) -> Reply:
    """Return a reply with the arguments of its one tool call as its text.

    Text beside the call counts as reasoning. A reply without a call is unchanged, and so is one
    with different calls, whose finish reason is ``tool_calls``.
    """
    calls = message.get("tool_calls")
    said = set(map(_arguments, calls)) - {""} if isinstance(calls, list) else set[str]()
    if reply.finish_reason != "tool_calls" or len(said) != 1:
        return reply
    return replace(reply, text=said.pop(), reasoning=reply.reasoning or reply.text, finish_reason="stop")


def _arguments(call: object) -> str:
    """Return the arguments of a tool call as JSON text; "" without any."""
    given = arguments_of(call)
    return given if isinstance(given, str) else "" if given is None else words_of([given])[1:-1]


def _beside(body: dict[str, object], message: dict[str, object]) -> str | None:
    """Return a finish reason for a tool call or different choices in a reply, else None."""
    if _calls(message):
        return "tool_calls"
    choices = body.get("choices")
    messages = (
        [choice.get("message") for choice in choices if isinstance(choice, dict)] if isinstance(choices, list) else []
    )
    said = {text_of(one.get("content")) for one in messages if isinstance(one, dict)}
    return "several_choices" if len(said) > 1 else None


def _calls(message: dict[str, object]) -> bool:
    """Return whether a message calls a tool, although the request offers none."""
    return bool(message.get("tool_calls") or message.get("function_call"))


def _line(value: object) -> str | None:
    """Return a server's name of something, or None without one; `Endpoint.scrubbed` cuts it."""
    return value if isinstance(value, str) and value else None
