"""The protocol of a space of actions; a decision is an action, or the reason for none."""

import json
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar, Generic, Literal, Protocol, Self, TypeVar

from eyechart.cameras import Distances

Missing = Literal["unparsed", "truncated", "refused", "empty", "error"]
"""Why a reply holds no decision."""

MISSING: tuple[Missing, ...] = ("unparsed", "truncated", "refused", "empty", "error")

UNPARSED = "UNPARSED"
"""The response-level symbol of a reply without a decision; no action may have this name."""

A = TypeVar("A")
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Decision(Generic[A]):
    """An action, or the reason for none; there is no default and no substitute.

    ``why`` details an ``unparsed`` reply. Raises ValueError unless exactly one of ``action`` and
    ``missing`` is given, and if ``why`` comes with another reason.
    """

    action: A | None
    missing: Missing | None = None
    why: str | None = None

    def __post_init__(self) -> None:
        if (self.action is None) == (self.missing is None):
            raise ValueError("a Decision has either an action or the reason there is none, never both or neither")
        if self.why is not None and self.missing != "unparsed":
            raise ValueError(f"only an unparsed Decision says why, not one that is {self.missing or self.action}")

    @property
    def symbol(self) -> str:
        """Return the response-level symbol: the action in words, or ``UNPARSED``."""
        return UNPARSED if self.action is None else str(self.action)

    @property
    def reason(self) -> str | None:
        """Return the reason for no decision, with details if ``unparsed``; None for an action."""
        return self.missing if self.why is None else f"{self.missing}: {self.why}"


def unparsed(why: str) -> Decision[Any]:
    """Return the decision of a reply without a readable action, and why."""
    return Decision(None, "unparsed", why)


class Answer(Protocol):
    """The readable part of a call's reply: the text, why it ended, and what failed."""

    @property
    def text(self) -> str:
        """The verbatim text."""

    @property
    def finish_reason(self) -> str | None:
        """Why the text ended."""

    @property
    def error(self) -> str | None:
        """The kind of the failure; None if a reply came."""


class SpaceDefaults(Protocol):
    """The defaults of most spaces: models' answers, one version of rules, the same in every world.

    ``who`` is the subject, ``model`` or ``policy``. ``is_scene`` says that an answer is a scene
    estimate.
    """

    __slots__ = ()
    who: ClassVar[str] = "model"
    is_scene: ClassVar[bool] = False

    def schema(self) -> Mapping[str, object]:
        """Return the JSON schema of an answer."""

    def wording(self) -> str:
        """Return a text that changes with the space."""
        return json.dumps(self.schema(), sort_keys=True)

    def written(self) -> Mapping[str, object]:
        """Return the space as plain JSON values, under its name in a prompt; empty without one."""
        return {}

    def by(self, reader: int) -> Self:
        """Return the space with this version of the reading rules, if it has others."""
        del reader
        return self

    @property
    def choices(self) -> tuple[str, ...]:
        """Return the names that a prompt must say."""
        return ()

    def on(self, own: Any) -> Any:  # noqa: ANN401 - a space of the same kind
        """Return the space of a prompt on a bank with its ``own`` actions."""
        del own
        return self

    def turn(self, symbol: str) -> str:
        """Return the part of a named answer that a reflection may exchange."""
        return symbol

    @property
    def columns(self) -> tuple[str, ...]:
        """Return the prompt columns with the names that a frame allows."""
        return ()

    def given(self, row: Mapping[str, object]) -> Self:
        """Return the space of one frame whose words state these fields."""
        del row
        return self

    def in_world(self, distances: Distances) -> Self:
        """Return the space of a world with these distances."""
        del distances
        return self


class Space(SpaceDefaults, Protocol[A]):
    """What an action is; statistics use it for three numbers, and know nothing else of an action.

    Actions are hashable. ``actions`` are the names for an answer; empty if an answer is no name.
    """

    @property
    def reader(self) -> int:
        """The version of the reading rules, which a run records."""

    @property
    def readers(self) -> tuple[int, ...]:
        """The versions of the rules that can read a reply here, today's last."""

    @property
    def actions(self) -> tuple[str, ...]:
        """The names for an answer."""

    def read(self, reply: Answer) -> Decision[A]:
        """Return the decision in a reply: strict, reproducible, and never guessing."""

    def distance(self, one: A, other: A) -> float:
        """Return the distance of two actions: 0 if they are the same."""

    def project(self, action: A, axis: str) -> float | None:
        """Return an action's part along an axis, such as ``brake``; None without such an axis."""

    def reflect(self, action: A) -> A | None:
        """Return the action that the reflected world calls for; None if that is unknown."""

    def symbol(self, action: A) -> str:
        """Return an action's name, for a table and for the world that executes it."""

    def role(self, symbol: str) -> str:
        """Return the role of this name in the gap tests: brake, proceed, or other."""


AnySpace = Space[Any]


_REFUSAL = re.compile(
    r"\b(i\s+(can(no|')t|am\s+(unable|not\s+able)|won't|will\s+not|must\s+decline)|i'm\s+(unable|not\s+able|sorry)"
    r"|sorry|cannot\s+(assist|help|see|comply)|unable\s+to\s+(assist|help|see|determine|comply)|no\s+image\b)",
    re.IGNORECASE,
)
PICTURE_ASKED_FOR = (
    r"\b(?:please|kindly|(?:could|can|will|would|need) you(?: to)?|(?:once|if|when|until|after|unless) you)\s+"
    r"(?:\w+\s+){0,2}?(?:provide|(?:re-?)?upload|(?:re-?)?attach|(?:re)?send|share|supply|submit|paste)\b"
    r"[^.;\n{]{0,40}?\b(?:images?|pictures?|photos?|frames?|feed)\b"
)
"""A regular expression for a request for a picture: its author saw none."""
_THINK_TAG = re.compile(r"(</?think(?:ing)?>)", re.IGNORECASE)
READ_AT_MOST = 100_000
"""The number of last characters outside thinking that are read; the ledger keeps all of a reply."""
_LEVELS_AT_MOST = 100
_BRACES_AT_MOST = 1000
_STRUCTURE = re.compile(r'"(?:[^"\\]|\\.)*+"?|[{}\[\]]', re.DOTALL)

Ending = Literal["normal", "cut", "filtered"]
_NORMAL = "stop end_turn stop_sequence eos eos_token complete completed"
_CUT = (
    "length max_tokens max_token max_output_tokens max_new_tokens max_length model_length token_limit limit "
    "context_length context_length_exceeded model_context_window_exceeded "
    "incomplete insufficient_system_resource error abort aborted cancelled canceled interrupted timeout"
)
_FILTERED = (
    "content_filter content_filtered refusal refused safety image_safety recitation blocklist prohibited_content spii "
    "guardrail_intervened moderation blocked image_prohibited_content image_recitation sensitive"
)
ENDINGS: Mapping[str, Ending] = {
    **dict.fromkeys(_NORMAL.split(), "normal"),
    **dict.fromkeys(_CUT.split(), "cut"),
    **dict.fromkeys(_FILTERED.split(), "filtered"),
}
"""Servers' finish reasons in lower case with underscores: normal, cut off, or filtered."""


@lru_cache(maxsize=1024)
def ending(finish_reason: str | None) -> Ending | None:
    """Return how a reply ended, by a finish reason in any spelling; None if unknown.

    It is unknown without a reason, and for a word outside `ENDINGS`. Text after a filter's word
    (``content_filter: PROHIBITED_CONTENT``) is its reason.
    """
    word = (finish_reason or "").strip().lower().replace("-", "_").replace(" ", "_")
    word = word.removeprefix("finish_reason_")
    known = ENDINGS.get(word)
    return "filtered" if known is None and ENDINGS.get(word.partition(":")[0]) == "filtered" else known


def why_unanswered(finish_reason: str | None, error: str | None) -> Missing | None:
    """Return why a reply has no answer: an error, a cut-off or a filter's refusal; else None."""
    if error is not None:
        return "error"
    ended = ending(finish_reason)
    return "truncated" if ended == "cut" else "refused" if ended == "filtered" else None


def refuses(text: str) -> bool:
    """Return whether a text declines to answer in words; it may still contain an answer."""
    return _REFUSAL.search(text.replace("’", "'")) is not None


def without_thinking(text: str) -> str:
    """Return the text outside thinking; its tag may come from the template, or stay open."""
    visible: list[str] = []
    thinking = False
    for part in _THINK_TAG.split(text):
        if not _THINK_TAG.fullmatch(part):
            visible += [] if thinking else [part]
        elif part.startswith("</"):
            visible = visible if thinking else []
            thinking = False
        else:
            thinking = True
    return " ".join(visible)


def thinks_behind(text: str, sign: str) -> bool:
    """Return whether thinking begins after the first ``sign`` outside thinking."""
    seen = thinking = False
    for part in _THINK_TAG.split(text):
        if not _THINK_TAG.fullmatch(part):
            seen = seen or (not thinking and sign in part)
        elif part.startswith("</"):
            seen = thinking = False
        elif seen:
            return True
        else:
            thinking = True
    return False


def is_too_deep(text: str, start: int = 0) -> bool:
    """Return whether the JSON value at ``start`` is nested in more than 100 levels.

    A parser's own limit depends on its caller's depth; this one does not.
    """
    depth = 0
    for match in _STRUCTURE.finditer(text, start):
        if match.group() in {"{", "["}:
            depth += 1
        elif match.group() in {"}", "]"}:
            depth -= 1
        if not 0 < depth <= _LEVELS_AT_MOST:
            return depth > 0
    return False


def json_objects(text: str, kind: Callable[[list[tuple[str, object]]], T]) -> Iterator[tuple[int, int, T]]:
    """Yield the outermost JSON objects in a text; none if it has too many braces to try.

    Each comes with its start, its end, and the ``kind`` made of its keys and values, as inner
    objects are. An object that is nested too deeply counts as text.
    """
    decoder, start = json.JSONDecoder(object_pairs_hook=kind), text.find("{")
    if text.count("{") > _BRACES_AT_MOST:
        return
    while start >= 0:
        end = start + 1
        try:
            value, ended = decoder.raw_decode(text, start)
            if not is_too_deep(text, start):
                end = ended
                yield start, end, value
        except ValueError:
            pass
        except RecursionError:
            if not is_too_deep(text, start):
                raise
        start = text.find("{", end)
