"""A call is a key with its attempts: what was asked of which model about which frame, and what came back."""

import hashlib
import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from operator import attrgetter
from types import MappingProxyType
from typing import Any, Literal, NamedTuple, get_args, get_type_hints

from eyechart.frames import Stimulus
from eyechart.seeds import key_seed
from eyechart.spaces.space import ending

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
"""What went wrong when no answer came. An empty reply, a refusal and a truncation are replies, and no errors."""

Then = Literal["again", "aside", "over"]
"""What is done: the call is made again, and stays unfinished when its attempts are used up; its model is set aside,
and the call stays unfinished; or the call is over, as a failure."""

KINDS: Mapping[ErrorKind, tuple[Then, str]] = MappingProxyType(
    {
        "rate_limited": ("again", "429"),
        "server_error": ("again", "5xx or 425, or an error inside a reply of status 200"),
        "connection": ("again", "refused, reset, closed before a reply began, or a certificate that is not trusted"),
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
"""What each kind of failure means, and what is done about it: the one table (docs/models.md shows it)."""

TRANSIENT: frozenset[str] = frozenset(kind for kind, (then, _) in KINDS.items() if then == "again")
"""The kinds that may pass when the same call is made again."""

HOPELESS: frozenset[str] = frozenset(kind for kind, (then, _) in KINDS.items() if then == "aside")
"""The kinds that every further call of the model would meet too, until somebody mends what is wrong."""

UNFINISHED: frozenset[str] = TRANSIENT | HOPELESS
"""The kinds that leave a call unfinished: a resumed run makes it again."""

UNASKED: frozenset[str] = frozenset({"not_called"})
"""The kinds of calls that were never made: they cost nothing, and say nothing of the model."""

SILENT: frozenset[str] = TRANSIENT - UNASKED - {"rate_limited"}
"""The kinds in which a model says nothing, for a run that counts silence (docs/decisions/drives.md).
A 429 is none: it says that the run asks too fast."""

BLOCKED = "blocked"
"""The finish reason of a failure that may be a filter's: a reply in order, without an answer in it."""

REFUSED: frozenset[str] = frozenset({"bad_request", "gateway"})
"""The kinds in which a server turned a request down, rightly or not."""


ANY_ACTION: Mapping[str, object] = {
    "type": "object",
    "properties": {"action": {"type": "string"}},
    "required": ["action"],
    "additionalProperties": False,
}
"""The JSON schema of an answer that names an action, whichever."""


@dataclass(frozen=True, slots=True)
class Query:
    """Everything that a model may see, and a seed for its sampling. There is no field for ground truth.

    ``stimulus`` is what a condition shows. ``seed`` is derived from the call's key, so that a model that samples
    answers the same call alike after a resume. ``schema`` is the JSON schema of an answer, for a model that it binds,
    and the query's own: who changes it changes no other call.
    """

    system: str
    user: str
    stimulus: Stimulus
    seed: int
    schema: Mapping[str, object] = field(default_factory=lambda: ANY_ACTION, hash=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "schema", _own(self.schema))

    @property
    def images(self) -> tuple[bytes, ...]:
        """Return the encoded pictures (PNG or JPEG bytes) in the order of the cameras."""
        return tuple(self.stimulus.images.values())

    @property
    def image(self) -> bytes | None:
        """Return the picture of the first camera, None where no picture is shown."""
        return next(iter(self.stimulus.images.values()), None)

    def said_by(self, role: str) -> "Query":
        """Return this query with its system words in the user's turn, before the user's own, for the role ``user``."""
        if role == "system" or not self.system:
            return self
        return replace(self, system="", user=f"{self.system}\n\n{self.user}")

    def sha256(self) -> str:
        """Return the digest of the content (not of the seed), an audit column and never a cache key."""
        digest, state = hashlib.sha256(), dict(self.stimulus.state)
        for part in (
            self.system.encode(),
            self.user.encode(),
            self._pictured(),
            *_bound(self.schema),
            *([b"state" + json.dumps(state, sort_keys=True).encode()] if state else []),
        ):
            digest.update(len(part).to_bytes(8, "big"))
            digest.update(part)
        return digest.hexdigest()

    def _pictured(self) -> bytes:
        """Return what the digest has of the pictures: one as it is, whatever its camera, several by their cameras."""
        if len(self.stimulus.images) < 2:
            return b"-" if self.image is None else b"+" + self.image
        named = (part for name, image in self.stimulus.images.items() for part in (name.encode(), image))
        return b"*" + b"".join(len(part).to_bytes(8, "big") + part for part in named)


def _own(schema: Any) -> Any:  # noqa: ANN401 - JSON of the same shape
    """Return a copy of a JSON schema, down to its parts."""
    if isinstance(schema, Mapping):
        return {name: _own(one) for name, one in schema.items()}
    return type(schema)(map(_own, schema)) if isinstance(schema, list | tuple) else schema


def _bound(schema: Mapping[str, object]) -> list[bytes]:
    """Return what the digest has of a schema: the names of the actions, or the schema where it names none."""
    properties = schema.get("properties")
    if isinstance(properties, dict) and properties.keys() == {"action"}:
        return ["\x1f".join(properties["action"].get("enum", ())).encode()]
    return [b"", json.dumps(schema, sort_keys=True).encode()]


@dataclass(frozen=True, slots=True)
class Reply:
    """What came back, verbatim. A failure is a Reply with its ``error`` kind, never made-up text.

    ``finish_reason`` is verbatim, in the names of OpenAI's chat API where the model has none of its own
    (``stop``, ``length``, ``content_filter``). ``reasoning`` is what the
    model thought, where it comes apart from the answer; ``completion_tokens`` include ``reasoning_tokens``.
    ``seconds`` and ``first_byte_s`` are wall time from sending to the last and the first byte, of a stream to its
    first words.
    ``status`` is HTTP's; ``retry_after_s`` what the server asked for. ``served`` names
    the model as the reply does, ``provider`` the upstream that a router chose, ``system_fingerprint`` the server's own
    name of its configuration. ``cost_usd`` is what the endpoint itself reports, ``energy_j`` what was measured here.
    ``payload_bytes`` and ``payload_sha256`` are of the request's body as it went out. None is "not reported" or "not
    measured", never 0.
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
    """Return whether a reply came, and was cut off."""
    return reply.error is None and ending(reply.finish_reason) == "cut"


def is_empty(reply: Reply) -> bool:
    """Return whether a reply came whole and says nothing."""
    return reply.error is None and not reply.text.strip() and not is_cut(reply)


def concluded(reply: Reply) -> Reply:
    """Return an empty reply with the end of its reasoning as its text: a JSON object, or else the last line.

    What was cut off or filtered is no end.
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
    """How many replies came, how many of them say nothing, and how many of those hold words in their reasoning.

    ``cut`` of those that came were cut off before their first word, ``cut_thought`` of these while they reasoned.
    """

    came: int = 0
    empty: int = 0
    thought: int = 0
    cut: int = 0
    cut_thought: int = 0

    @classmethod
    def of(cls, replies: Iterable[Reply]) -> "Emptiness":
        """Count replies."""
        return sum((cls().plus(reply) for reply in replies), start=cls())

    def plus(self, reply: Reply) -> "Emptiness":
        """Return these counts with one more reply; a failure is none."""
        if reply.error is not None:
            return self
        if reply.text.strip():
            return Emptiness(self.came + 1, self.empty, self.thought, self.cut, self.cut_thought)
        cut, thought = is_cut(reply), bool(reply.reasoning.strip())
        return self + Emptiness(1, not cut, thought and not cut, cut, thought and cut)

    def __add__(self, other: "Emptiness") -> "Emptiness":
        return Emptiness(*(getattr(self, one.name) + getattr(other, one.name) for one in fields(self)))

    @property
    def whole(self) -> bool:
        """Return whether there are replies and all say nothing, cut off or not."""
        return 0 < self.came == self.empty + self.cut

    @property
    def words(self) -> str:
        """Return in words how many are empty, and the likely cause; nothing where none is."""
        if self.cut and self.whole:
            reasoned = f", {self.cut_thought} of them while the model reasoned" if self.cut_thought else ""
            return (
                f"all {self.came} replies are empty: {self.cut} were cut off before their first word{reasoned}; raise "
                "--max-tokens, or switch thinking off"
            )
        if not self.empty:
            return ""
        counted = (
            f"all {self.came} replies are empty" if self.whole else f"{self.empty} of {self.came} replies are empty"
        )
        if not self.thought:
            return f"{counted}: the server's log, or a call by hand, says why"
        return (
            f"{counted}, and {self.thought} of them have their words in the reasoning (reasoning_content): the server "
            "takes the answer for a part of the thinking; switch thinking off, start the server without its reasoning "
            "parser, or ask with --answer reasoning, which reads the end of the reasoning"
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
"""What each number of a Reply may be at most; at least, 0. One beyond was not measured: it counts as not reported."""
_KINDS = {
    name: get_args(kind | int if kind == float | None else kind) or (kind,)
    for name, kind in get_type_hints(Reply).items()
    if name != "error"
}
_numbers, _values = attrgetter(*MOST), attrgetter(*_KINDS)


def bounded(reply: Reply) -> Reply:
    """Return a reply without the numbers that nobody can have measured: none, infinite, negative, or beyond `MOST`."""
    numbers = zip(MOST.items(), _numbers(reply), strict=True)
    wrong = [name for (name, most), one in numbers if isinstance(one, (int, float)) and not 0 <= one <= most]
    return replace(reply, **dict.fromkeys(wrong)) if wrong else reply  # type: ignore[arg-type]


def misfit(reply: Reply) -> str | None:
    """Return in words what of a reply is not of its field's type, so that no ledger can hold it, or None."""
    for (name, kinds), value in zip(_KINDS.items(), _values(reply), strict=True):
        if not isinstance(value, kinds):
            return f"its {name} is a {type(value).__name__}"
    if reply.error is not None and reply.error not in get_args(ErrorKind):
        return f"its error is none of {', '.join(get_args(ErrorKind))}"
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
        """Return a 63-bit seed that depends on this key and the run's seed only."""
        return key_seed(run_seed, *map(str, self))
