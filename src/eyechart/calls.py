"""Calls: their keys, queries and replies, and the kinds of their failures."""

import hashlib
import json
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from operator import attrgetter
from types import MappingProxyType
from typing import Any, Literal, NamedTuple, get_args, get_type_hints

from msgspec import to_builtins

from eyechart.frames import Stimulus
from eyechart.messages import Turn
from eyechart.seeds import key_seed
from eyechart.spaces.space import AnySpace, Decision, ending

ErrorKind = Literal[
    "exception",
    "timeout",
    "rate_limited",
    "server_error",
    "connection",
    "cut_short",
    "unreadable",
    "gateway",
    "wrong_json",
    "too_large",
    "bad_request",
    "auth",
    "quota",
    "missing_model",
    "not_called",
]
"""The kinds of failures without a reply. Empty, refused and truncated replies are no errors."""

Then = Literal["again", "aside", "over"]
"""The reaction to a failure: repeat the call, set its model aside, or finish it as a failure.

After the last repeat, or if its model is set aside, the call stays unfinished."""

KINDS: Mapping[ErrorKind, tuple[Then, str]] = MappingProxyType(
    {
        "rate_limited": ("again", "429"),
        "server_error": ("again", "5xx or 425, or an error inside a reply of status 200"),
        "connection": (
            "again",
            "refused, reset, closed before a reply began, a certificate that is not trusted, or no descriptor is left",
        ),
        "cut_short": ("again", "the body ended before it was whole"),
        "timeout": ("again", "no whole reply within the mode's time, or 408"),
        "unreadable": ("again", "no HTTP, no JSON, not of the API's shape, or more than 8 MB"),
        "not_called": ("again", "no call was made: too many earlier calls of the callable have not returned"),
        "gateway": ("again", "a redirect, or another 4xx that does not show that the request is wrong"),
        "auth": ("aside", "401 or 403, or a 400 or 422 that says so: the key is missing, wrong or not allowed"),
        "quota": ("aside", "402, or a 400, 403, 422 or 429 that says that nothing is left to spend"),
        "missing_model": ("aside", "404, or a 400 or 422 that says so"),
        "bad_request": (
            "over",
            "a 400, 413 or 422 whose JSON names a field or a limit of the request, or a moderation",
        ),
        "exception": ("over", "the adapter, or what it calls, raised"),
        "wrong_json": ("over", "no JSON, or not of the API's shape, in a run of version 0.1"),
        "too_large": ("over", "a body beyond the bound, in a run of version 0.1"),
    }
)
"""The meaning of each kind of failure, and the reaction to it (docs/models.md shows this table)."""

TRANSIENT: frozenset[str] = frozenset(kind for kind, (then, _) in KINDS.items() if then == "again")
"""The kinds that may pass when the call is repeated."""

HOPELESS: frozenset[str] = frozenset(kind for kind, (then, _) in KINDS.items() if then == "aside")
"""The kinds that every further call of the model would meet too, until a repair."""

UNFINISHED: frozenset[str] = TRANSIENT | HOPELESS
"""The kinds that leave a call unfinished: a resumed run repeats it."""

UNASKED: frozenset[str] = frozenset({"not_called"})
"""The kinds of calls that were never made: they cost nothing, and say nothing about the model."""

SILENT: frozenset[str] = TRANSIENT - UNASKED - {"rate_limited"}
"""The kinds that count as a model's silence, in a run that counts it (docs/decisions/drives.md).
A 429 is none: it says that the run sends too fast."""

BLOCKED = "blocked"
"""The finish reason of a well-formed reply without an answer, which may come from a filter."""

REFUSED: frozenset[str] = frozenset({"bad_request", "gateway"})
"""The kinds of requests that a server refused, rightly or not."""


ANY_ACTION: Mapping[str, object] = {
    "type": "object",
    "properties": {"action": {"type": "string"}},
    "required": ["action"],
    "additionalProperties": False,
}
"""The JSON schema of an answer with any action."""


@dataclass(frozen=True, slots=True)
class Query:
    """Everything that a model may see, and a seed for its sampling. Ground truth has no field.

    ``stimulus`` comes from the condition. ``seed`` comes from the call's key, so a model that
    samples repeats its answer after a resume. ``schema`` is the JSON schema of an answer, for
    models that enforce one. It is a copy: a change of it affects no other call. ``messages`` are
    the turns of a prompt that has more than a system and a user message. ``system`` and ``user``
    are then the words of its first, if it is the system's, and of its last.
    """

    system: str
    user: str
    stimulus: Stimulus
    seed: int
    schema: Mapping[str, object] = field(default_factory=lambda: ANY_ACTION, hash=False)
    messages: tuple[Turn, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "schema", to_builtins(self.schema, enc_hook=dict))

    @property
    def images(self) -> tuple[bytes, ...]:
        """Return the encoded pictures (PNG or JPEG bytes) in the order of the cameras."""
        return tuple(self.stimulus.images.values())

    @property
    def image(self) -> bytes | None:
        """Return the picture of the first camera, None without a picture."""
        return next(iter(self.stimulus.images.values()), None)

    @property
    def turns(self) -> tuple[Turn, ...]:
        """Return the messages to send, with all pictures in their places."""
        system = (Turn("system", (self.system,)),) if self.system else ()
        return self.messages or (*system, Turn("user", (*self.images, self.user)))

    @property
    def pictures(self) -> tuple[bytes, ...]:
        """Return all encoded pictures to send, a prompt's examples included, in their order."""
        return tuple(picture for turn in self.turns for picture in turn.pictures)

    def said_by(self, role: str) -> "Query":
        """Return this query; for the role ``user``, with its system text before the user's."""
        if role == "system" or not self.system:
            return self
        if self.messages:
            _, first, *others = self.messages
            opening = [first.opened_by(self.system)] if first.role == "user" else [Turn("user", (self.system,)), first]
            turns = (*opening, *others)
            return replace(self, system="", user=turns[-1].words, messages=turns)
        return replace(self, system="", user=f"{self.system}\n\n{self.user}")

    def sha256(self) -> str:
        """Return the digest of the content without the seed: an audit column, never a cache key."""
        seen = self.stimulus
        found, pictured = hashlib.sha256(_sized((self.system.encode(), self.user.encode()))), _pictured(seen)
        found.update(sum(map(len, pictured)).to_bytes(8, "big"))
        for piece in pictured:  # not joined: a picture may be large
            found.update(piece)
        parts = [*_bound(self.schema), *_stated(seen)]
        for one in seen.past:
            parts += (b"past", b"".join(_pictured(one)), *_stated(one))
        for turn in self.messages:
            parts += turn.digests()
        found.update(_sized(parts))
        return found.hexdigest()


def _sized(parts: Iterable[bytes]) -> bytes:
    """Return parts in a row, each after its length."""
    return b"".join([one for part in parts for one in (len(part).to_bytes(8, "big"), part)])


def _pictured(seen: Stimulus) -> tuple[bytes, ...]:
    """Return the pieces of the digest's input for pictures: one alone, several with their cameras."""
    if len(seen.images) < 2:
        return next(((b"+", image) for image in seen.images.values()), (b"-",))
    named = [part for name, image in seen.images.items() for part in (name.encode(), image)]
    return (b"*", *(piece for part in named for piece in (len(part).to_bytes(8, "big"), part)))


def _stated(seen: Stimulus) -> list[bytes]:
    """Return the digest's input for a state; none without one."""
    return [b"state" + json.dumps(dict(seen.state), sort_keys=True).encode()] if seen.state else []


def _bound(schema: Mapping[str, object]) -> list[bytes]:
    """Return the digest's input for a schema: the names of its actions, or else all of it."""
    properties = schema.get("properties")
    if isinstance(properties, dict) and properties.keys() == {"action"}:
        return ["\x1f".join(properties["action"].get("enum", ())).encode()]
    return [b"", json.dumps(schema, sort_keys=True).encode()]


@dataclass(frozen=True, slots=True)
class Reply:
    """A model's reply, verbatim. A failure is a Reply with its ``error`` kind, never made-up text.

    ``finish_reason`` is the model's own, or a name of OpenAI's chat API (``stop``, ``length``,
    ``content_filter``). ``reasoning`` is the model's reasoning, if it is separate from the answer;
    ``completion_tokens`` include ``reasoning_tokens``. ``seconds`` and ``first_byte_s`` are wall
    time from sending to the last and to the first byte; in a stream, to its first text. ``status``
    is that of HTTP, and ``retry_after_s`` the server's Retry-After. ``served`` is the model's name
    in the reply, ``provider`` the upstream of a router, and ``system_fingerprint`` the server's
    name of its configuration. ``cost_usd`` is reported by the endpoint; ``energy_j`` is measured
    here. ``payload_bytes`` and ``payload_sha256`` are those of the request's body. None means not
    reported or not measured, never 0.
    """

    text: str = ""
    finish_reason: str | None = None
    error: ErrorKind | None = None
    error_detail: str = ""
    prompt_tokens: int | None = None
    completion_tokens: int | None = None
    seconds: float | None = None
    reasoning: str = ""
    reasoning_tokens: int | None = None
    first_byte_s: float | None = None
    status: int | None = None
    retry_after_s: float | None = None
    served: str | None = None
    provider: str | None = None
    cost_usd: float | None = None
    energy_j: float | None = None
    system_fingerprint: str | None = None
    payload_bytes: int | None = None
    payload_sha256: str | None = None


def is_cut(reply: Reply) -> bool:
    """Return whether a reply came but was cut off."""
    return reply.error is None and ending(reply.finish_reason) == "cut"


def is_empty(reply: Reply) -> bool:
    """Return whether a reply is complete and has no text."""
    return reply.error is None and not reply.text.strip() and not is_cut(reply)


def answer_from_reasoning(reply: Reply) -> Reply:
    """Return an empty reply with the end of its reasoning as its text.

    The end is a JSON object, or else the last line. A cut or filtered reply is returned unchanged.
    """
    if not is_empty(reply) or not (reply.finish_reason is None or ending(reply.finish_reason) == "normal"):
        return reply
    thought = re.sub(r"\s*```\s*$", "", reply.reasoning.rpartition("</think>")[2].strip())
    lines = thought.splitlines()
    start = max((place for place, line in enumerate(lines) if line.lstrip().startswith("{")), default=-1)
    last = "\n".join(lines[start:]) if thought.endswith("}") and start >= 0 else lines[-1] if lines else ""
    return replace(reply, text=last.strip())


@dataclass(frozen=True, slots=True)
class Emptiness:
    """Counts of replies: ``came``, ``empty`` ones, and empty ones with text in their reasoning.

    ``cut`` replies were cut off before their first word, ``cut_thought`` of them during reasoning.
    ``called`` counts empty replies that call a tool.
    """

    came: int = 0
    empty: int = 0
    thought: int = 0
    cut: int = 0
    cut_thought: int = 0
    called: int = 0

    @classmethod
    def of(cls, replies: Iterable[Reply]) -> "Emptiness":
        """Count replies."""
        found = cls()
        for reply in replies:
            found = found.plus(reply)
        return found

    def plus(self, reply: Reply) -> "Emptiness":
        """Return the counts with one more reply; a failure does not count."""
        if reply.error is not None:
            return self
        if reply.text.strip():
            return Emptiness(self.came + 1, self.empty, self.thought, self.cut, self.cut_thought, self.called)
        cut, thought = is_cut(reply), bool(reply.reasoning.strip())
        called = not cut and reply.finish_reason == "tool_calls"
        return self + Emptiness(1, not cut, thought and not cut, cut, thought and cut, called)

    def __add__(self, other: "Emptiness") -> "Emptiness":
        return Emptiness(*(getattr(self, one.name) + getattr(other, one.name) for one in fields(self)))

    @property
    def is_whole(self) -> bool:
        """Return whether there are replies, and all are without text, cut off or not."""
        return 0 < self.came == self.empty + self.cut

    @property
    def words(self) -> str:
        """Return the count of empty replies and the likely cause in words; "" without any."""
        if self.cut and self.is_whole:
            reasoned = f", {self.cut_thought} of them while the model reasoned" if self.cut_thought else ""
            return (
                f"all {self.came} replies are empty: {self.cut} were cut off before their first word{reasoned}; raise "
                "--max-tokens, or switch thinking off"
            )
        if not self.empty:
            return ""
        counted = (
            f"all {self.came} replies are empty" if self.is_whole else f"{self.empty} of {self.came} replies are empty"
        )
        if self.called:
            way = "--json-mode tool_call reads the answer there, if a reply has one call, or equal ones"
            return f"{counted}, and {self.called} of them call a tool: {way}"
        if not self.thought:
            return f"{counted}: the server's log, or a call by hand, says why"
        return (
            f"{counted}, and {self.thought} of them have their words in the reasoning (reasoning_content): the server "
            "takes the answer for a part of the thinking. Switch thinking off, start the server without its reasoning "
            "parser, or use --answer reasoning, which reads the end of the reasoning"
        )


MOST: Mapping[str, float] = MappingProxyType(
    {
        "prompt_tokens": 1e9,
        "completion_tokens": 1e9,
        "reasoning_tokens": 1e9,
        "seconds": 1e7,
        "first_byte_s": 1e7,
        "status": 999,
        "retry_after_s": 1e9,
        "cost_usd": 1e6,
        "energy_j": 1e12,
        "payload_bytes": 1e12,
    }
)
"""The largest value of each number of a Reply; the smallest is 0. Others count as not reported."""
_KINDS = {
    name: get_args(kind | int if kind == float | None else kind) or (kind,)
    for name, kind in get_type_hints(Reply).items()
    if name != "error"
}
_numbers, _values = attrgetter(*MOST), attrgetter(*_KINDS)
_DIGEST = re.compile(r"[0-9a-f]{64}")


def bounded(reply: Reply) -> Reply:
    """Return a reply without impossible numbers: NaN, infinite, negative, or beyond `MOST`."""
    numbers = zip(MOST.items(), _numbers(reply), strict=True)
    wrong = [
        name
        for (name, most), one in numbers
        if one is not None and isinstance(one, (int, float)) and not 0 <= one <= most
    ]
    return replace(reply, **dict.fromkeys(wrong)) if wrong else reply  # type: ignore[arg-type]


def invalid_field(reply: Reply) -> str | None:
    """Return which field of a reply has a wrong type, so that no ledger can hold it, or None."""
    for (name, kinds), value in zip(_KINDS.items(), _values(reply), strict=True):
        if not isinstance(value, kinds):
            return f"its {name} is a {type(value).__name__}"
    if reply.error is not None and reply.error not in get_args(ErrorKind):
        return f"its error is none of {', '.join(get_args(ErrorKind))}"
    if reply.payload_sha256 is not None and not _DIGEST.fullmatch(reply.payload_sha256):
        return "its payload_sha256 is no SHA-256"
    return None


class CallKey(NamedTuple):
    """The identity of a call: never its content (docs/decisions/calls.md)."""

    study: str
    model: str
    prompt: str
    frame: str
    condition: str
    repeat: int = 0

    def seed(self, run_seed: int) -> int:
        """Return a 63-bit seed that depends only on this key and the run's seed."""
        return key_seed(run_seed, *map(str, self))


DecisionReader = Callable[[CallKey, Reply], Decision[Any]]
"""Reads a call's reply as a decision; the call says which frame's own names it may hold."""


def read_in(space: AnySpace) -> DecisionReader:
    """Return the reader of replies in one space, whatever the call."""
    return lambda _, reply: space.read(reply)
