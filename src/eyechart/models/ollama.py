"""``ollama:MODEL``: a model of an Ollama server, over its native streaming API.

The digest identifies the model. Source: Ollama's API, docs/api.md.
"""

import asyncio
import base64
import contextlib
import hashlib
import http.client
import re
import threading
import urllib.error
import urllib.request
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace

import orjson

from eyechart.calls import Query, Reply, answer_from_reasoning
from eyechart.errors import SpecError
from eyechart.messages import Turn
from eyechart.models import HERE, WEIGHTS_GB, machine_of, require_options
from eyechart.models.energy import metered
from eyechart.models.http import (
    MOST_BYTES,
    Endpoint,
    Response,
    count_of,
    end_of,
    error_message,
    is_loopback,
    read_json,
    words_of,
)
from eyechart.modes import RequestMode

BASE_URL = "http://127.0.0.1:11434"
OPTIONS = {
    "think": "true, false, or low, medium, high: whether a model that can think does so",
    "keep_alive": "how long the model stays loaded after a call, as 10m; -1: for ever; default: until its run ends",
    "num_ctx": "tokens of context",
    "energy": "true measures this machine's energy during a call, for a server that runs here",
}

_ASKING_S = 10.0
_UNLOADING_S = 3.0
_SEEDS = 2**31
_MARK = "[img]"
_RENDERER = re.compile(r"^RENDERER\s+(\S+)", re.MULTILINE)
"""A model file names a built-in renderer of prompts, which ignores marks, where it has no template."""
_LOST = re.compile(r"\bmodel\b.*\bnot found\b", re.IGNORECASE | re.DOTALL)


@dataclass(slots=True)
class Ollama:
    """A model of an Ollama server; ``version`` is the start of its digest, and its quantisation."""

    name: str
    mode: RequestMode
    endpoint: Endpoint
    version: str
    facts: Mapping[str, str]
    loaded: bool = False

    async def answer(self, query: Query) -> Reply:
        """Answer one query. A failure is a Reply with its kind."""
        self.loaded = True
        turns = query.said_by(self.mode.system).turns
        if words := _unplaceable(turns, renders="renderer" in self.facts):
            return Reply(error="exception", error_detail=words)
        payload = orjson.dumps(_request_body(self.name, query, turns, self.mode))
        call = self._send(payload)
        return await metered(call) if self.mode.options.get("energy") else await call

    async def _send(self, payload: bytes) -> Reply:
        came = await self.endpoint.post("/api/chat", payload)
        reply = _failed(came, self.name) if came.error else _read(came, self.name)
        if self.mode.answer == "reasoning":
            reply = answer_from_reasoning(reply)
        return self.endpoint.scrubbed(reply)

    async def close(self) -> None:
        """Unload the model from a server on this machine if it was used, then close the session.

        The model stays loaded if the mode sets ``keep_alive``, or if the server is another machine.
        """
        stays = "keep_alive" in self.mode.options or "keep_alive" in self.mode.body
        if self.loaded and not stays and machine_of(self.mode) == HERE:
            payload = orjson.dumps({"model": self.name, "keep_alive": 0})
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(_UNLOADING_S):
                    await self.endpoint.post("/api/generate", payload)
        self.loaded = False
        await self.endpoint.close()


def open_model(name: str, mode: RequestMode) -> Ollama:
    """Open a model with the server's facts of it; raises SpecError without the server or model."""
    require_options(mode, OPTIONS)
    if mode.structured == "tool_call":
        raise SpecError(f"'{mode.spec}' cannot be made to call a tool: Ollama binds an answer by json_schema")
    base_url = (mode.base_url or BASE_URL).rstrip("/")
    headers = mode.header_values()
    secrets = tuple(
        part for one, value in headers.items() if value != mode.headers[one] for part in (value, *value.split())
    )
    endpoint = Endpoint(base_url, mode.timeout_s, headers, secrets, mode.query)
    server = _Server(base_url, headers, endpoint)
    tags, shown = server.get("/api/tags"), server.show(name)
    facts = _facts(name, tags, shown) | {"endpoint": base_url, "server": _text(server.get("/api/version"), "version")}
    facts = {key: endpoint.scrub(value) for key, value in facts.items() if value}
    version = " ".join(facts[part][:12] for part in ("digest", "quantisation") if facts.get(part)) or "no digest"
    return Ollama(name, mode, endpoint, version, facts)


def names() -> dict[str, str]:
    """Return what may stand after ``ollama:``."""
    return {"MODEL": "a pulled model, as qwen2.5vl:7b; its server runs here, or --base-url names it"}


class _NoRedirects(urllib.request.HTTPRedirectHandler):
    """Follows no redirect: it would send the headers, and their secrets, to another address."""

    def redirect_request(self, *request: object, **more: object) -> None:
        """Return no request; urllib then raises the redirect as an HTTPError."""


class _RefusedError(Exception):
    """A response of a status other than 2xx, with its body."""

    def __init__(self, code: int, body: bytes) -> None:
        super().__init__(code)
        self.code = code
        self.body = body


def _within(seconds: float, work: Callable[[], bytes]) -> bytes:
    """Return the result of work; raises TimeoutError after the time, also while a server sends."""
    done: Future[bytes] = Future()

    def run() -> None:
        try:
            done.set_result(work())
        except BaseException as error:  # noqa: BLE001 - the waiting thread raises it
            done.set_exception(error)

    threading.Thread(target=run, name="ollama-opens", daemon=True).start()
    return done.result(seconds)


@dataclass(slots=True)
class _Server:
    """An Ollama server's facts of itself and its models, read before any inference."""

    base_url: str
    headers: Mapping[str, str]
    endpoint: Endpoint

    def get(self, path: str) -> Mapping[str, object]:
        """Return the JSON object at a path; raises SpecError where no Ollama server answers."""
        try:
            return self._ask(path)
        except _RefusedError as error:
            answer = f"{path} gave HTTP {error.code}"
            raise SpecError(f"what answers at {self.base_url} is no Ollama server: {answer}") from error

    def _ask(self, path: str, payload: bytes | None = None) -> Mapping[str, object]:
        headers = {"Content-Type": "application/json", **self.headers}
        request = urllib.request.Request(self.base_url + path, payload, headers)  # noqa: S310 - http or https by type
        handlers = [_NoRedirects(), *([urllib.request.ProxyHandler({})] if is_loopback(self.base_url) else [])]
        try:
            result = read_json(_within(_ASKING_S, lambda: _fetched(request, handlers)))
        except ValueError as error:
            raise SpecError(f"what answers at {self.base_url} is no Ollama server: {path} gave no JSON") from error
        except (OSError, http.client.HTTPException) as error:
            words = self.endpoint.scrub(str(getattr(error, "reason", error)))
            raise SpecError(
                f"no Ollama server answers at {self.base_url} ({words}): start one with 'ollama serve', or name "
                "another with --base-url"
            ) from error
        if not isinstance(result, Mapping):
            raise SpecError(f"what answers at {self.base_url} is no Ollama server: {path} gave no JSON object")
        return result

    def show(self, name: str) -> Mapping[str, object]:
        """Return the facts of a model; raises SpecError, which says how to get a missing one."""
        try:
            return self._ask("/api/show", orjson.dumps({"model": name}))
        except _RefusedError as error:
            words = error_message(error.body, self.endpoint.scrub)
            if error.code == 404:
                raise SpecError(f"{_missing(name)} (the server at {self.base_url} says: {words})") from error
            raise SpecError(f"the server at {self.base_url} answers HTTP {error.code} to /api/show: {words}") from error


def _fetched(request: urllib.request.Request, handlers: list[urllib.request.BaseHandler]) -> bytes:
    try:
        with urllib.request.build_opener(*handlers).open(request, timeout=_ASKING_S) as came:
            return bytes(came.read(MOST_BYTES))
    except urllib.error.HTTPError as error:
        with error:
            raise _RefusedError(error.code, error.read(MOST_BYTES)) from None


def _missing(name: str) -> str:
    return f"Ollama has no model '{name}': get it with 'ollama pull {name}'"


def _facts(name: str, tags: Mapping[str, object], shown: Mapping[str, object]) -> dict[str, str]:
    """Return digest, quantisation, size, family, template and parameters, as far as known."""
    models = tags.get("models")
    full = name if ":" in name.rpartition("/")[2] else f"{name}:latest"
    mine = next(
        (
            model
            for model in (models if isinstance(models, list) else [])
            if isinstance(model, Mapping) and full in {model.get("name"), model.get("model")}
        ),
        {},
    )
    details = shown.get("details")
    details = details if isinstance(details, Mapping) else {}
    template = _text(shown, "template")
    facts = {
        "digest": _text(mine, "digest").removeprefix("sha256:"),
        "quantisation": _text(details, "quantization_level"),
        "size": _text(details, "parameter_size"),
        "family": _text(details, "family"),
        "template": template,
        "template_sha256": hashlib.sha256(template.encode()).hexdigest() if template else "",
        "parameters": _text(shown, "parameters"),
        "renderer": _text(shown, "renderer") or "".join(_RENDERER.findall(_text(shown, "modelfile"))[:1]),
    }
    stored = mine.get("size")
    if isinstance(stored, int) and stored > 0:
        facts[WEIGHTS_GB] = f"{stored / 1e9:.3g}"
    able = shown.get("capabilities")
    if isinstance(able, list) and "vision" not in able:
        facts["warning"] = f"'{name}' takes no pictures: its capabilities are {', '.join(map(str, able))}"
    return facts


def _text(values: Mapping[str, object], name: str) -> str:
    found = values.get(name)
    return found[:20_000] if isinstance(found, str) else ""


def _unplaceable(turns: Sequence[Turn], *, renders: bool) -> str:
    """Return why Ollama would move a picture out of its place between words; "" if it does not."""
    between = [turn for turn in turns if not _is_before(turn)]
    if between and renders:
        return "Ollama puts this model's pictures before the words of their message: place them there in the prompt"
    if any(_MARK in turn.words for turn in between):
        return f"the words of the prompt hold {_MARK}, which is Ollama's mark for the place of a picture"
    return ""


def _is_before(turn: Turn) -> bool:
    """Return whether all pictures of a turn come before its words."""
    return turn.parts[: len(turn.pictures)] == turn.pictures


def _message(turn: Turn) -> dict[str, object]:
    """Return a message. Ollama replaces each mark in its words by one of its pictures, in order."""
    marked = "".join(part if isinstance(part, str) else _MARK for part in turn.parts)
    message: dict[str, object] = {"role": turn.role, "content": turn.words if _is_before(turn) else marked}
    if turn.pictures:
        message["images"] = [base64.b64encode(picture).decode() for picture in turn.pictures]
    return message


def _request_body(name: str, query: Query, turns: Sequence[Turn], mode: RequestMode) -> dict[str, object]:
    options: dict[str, object] = {"num_predict": mode.max_tokens}
    if mode.temperature is not None:
        options["temperature"] = mode.temperature
    if mode.seed:
        options["seed"] = query.seed % _SEEDS
    if "num_ctx" in mode.options:
        options["num_ctx"] = mode.options["num_ctx"]
    given = dict(mode.body)
    more = given.pop("options", {})
    body = {
        "model": name,
        "messages": list(map(_message, turns)),
        "stream": True,
        "options": options | (dict(more) if isinstance(more, Mapping) else {}),
    }
    if query.messages:
        body["truncate"] = False  # else Ollama silently drops the first messages of a long prompt
    body |= {option: mode.options[option] for option in ("think", "keep_alive") if option in mode.options}
    if mode.structured != "none":
        body["format"] = "json" if mode.structured == "json_object" else query.schema
    return body | given


def _failed(came: Response, name: str) -> Reply:
    reply = came.failure()
    if reply.error == "missing_model":
        return replace(reply, error_detail=f"{_missing(name)} ({reply.error_detail})")
    if reply.error == "connection":
        return replace(reply, error_detail=f"no Ollama server answers, start it with 'ollama serve': {came.detail}")
    if "does not support thinking" in reply.error_detail:
        return replace(reply, error_detail=f"{reply.error_detail}; ask it without --option think")
    return reply


def _read(came: Response, name: str) -> Reply:
    """Read the stream, one JSON object a line; the last one has ``done`` and the counts."""
    text: list[str] = []
    reasoning: list[str] = []
    called = False
    for line in came.body.splitlines():
        try:
            part = read_json(line)
        except ValueError as error:
            return came.failure("unreadable", f"a line of the stream is no JSON: {error}")
        if not isinstance(part, dict):
            return came.failure("unreadable", "a line of the stream is no JSON object")
        if part.get("error"):
            words = words_of(part["error"])
            lost = _LOST.search(words) is not None
            return came.failure("missing_model" if lost else "server_error", _missing(name) if lost else words)
        message = part.get("message")
        if isinstance(message, dict):
            text.append(_text(message, "content"))
            reasoning.append(_text(message, "thinking"))
            called = called or bool(message.get("tool_calls"))
        if part.get("done") is True:
            return came.reply(**_said(part, "".join(text), "".join(reasoning), called=called))
    return came.failure("cut_short", f"the stream ended after {len(came.body)} bytes, before it was done")


def _said(last: Mapping[str, object], text: str, reasoning: str, *, called: bool) -> dict[str, object]:
    """Return the fields of a reply that the stream gives."""
    return {
        "text": text,
        "finish_reason": "tool_calls" if called else end_of(last.get("done_reason")),
        "prompt_tokens": count_of(last.get("prompt_eval_count")),
        "completion_tokens": count_of(last.get("eval_count")),
        "reasoning": reasoning,
        "served": _text(last, "model") or None,
    }
