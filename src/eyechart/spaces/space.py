"""A space knows what an action is; a decision is an action, or the reason there is none."""

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
"""The response-level symbol of every reply without a decision; no action may have this name."""

A = TypeVar("A")
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Decision(Generic[A]):
    """An action, or the reason there is none. There is no default and no substitute.

    ``why`` says more of a reply that is ``unparsed``. Raises ValueError unless exactly one of ``action`` and
    ``missing`` is given, and where ``why`` is given for another reason than ``unparsed``.
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
        """Return the response-level symbol: the action in words, or ``UNPARSED`` whatever the reason."""
        return UNPARSED if self.action is None else str(self.action)

    @property
    def reason(self) -> str | None:
        """Return why there is no decision, with what is wrong with an ``unparsed`` reply; None where there is one."""
        return self.missing if self.why is None else f"{self.missing}: {self.why}"


def unparsed(why: str) -> Decision[Any]:
    """Return that no action can be read from a reply, and why."""
    return Decision(None, "unparsed", why)


class Answer(Protocol):
    """What came back of a call, as far as it is read: the text, why it ended, and what failed."""

    @property
    def text(self) -> str:
        """The verbatim text."""

    @property
    def finish_reason(self) -> str | None:
        """Why the text ended."""

    @property
    def error(self) -> str | None:
        """The kind of the failure, None where something came back."""


class Usual(Protocol):
    """What most spaces have in common: a model's answers, read by one version of the rules, the same in every world.

    ``who`` is whose answers these are, a ``model``'s or a ``policy``'s; ``is_scene`` whether one is an estimate of the
    scene.
    """

    __slots__ = ()
    who: ClassVar[str] = "model"
    is_scene: ClassVar[bool] = False

    def schema(self) -> Mapping[str, object]:
        """Return the JSON schema of an answer."""

    def wording(self) -> str:
        """Return a text that changes with what the space asks for."""
        return json.dumps(self.schema(), sort_keys=True)

    def written(self) -> Mapping[str, object]:
        """Return the space as plain JSON values, by the name that a prompt has for it; nothing where none has one."""
        return {}

    def by(self, reader: int) -> Self:
        """Return the space with replies read by this version of the rules, where it has others."""
        del reader
        return self

    def in_world(self, distances: Distances) -> Self:
        """Return the space as a world with these distances has it."""
        del distances
        return self


class Space(Usual, Protocol[A]):
    """What an action is. Statistics ask it for three numbers, and know nothing else of an action.

    Actions are hashable. ``actions`` are the names that an answer may give, none where an answer is no name.
    """

    @property
    def reader(self) -> int:
        """The version of the rules of reading, which a run records."""

    @property
    def readers(self) -> tuple[int, ...]:
        """The versions of these rules by which a reply can be read here, today's last."""

    @property
    def actions(self) -> tuple[str, ...]:
        """The names that an answer may give."""

    def read(self, reply: Answer) -> Decision[A]:
        """Return the decision that a reply holds: strict, the same every time, and never guessing."""

    def distance(self, one: A, other: A) -> float:
        """Return how far two actions differ: 0 where they are the same."""

    def project(self, action: A, axis: str) -> float | None:
        """Return how much of an action is along an axis, such as ``brake``; None where the space has no such axis."""

    def reflect(self, action: A) -> A | None:
        """Return the action that the reflected world calls for; None where nobody can say."""

    def symbol(self, action: A) -> str:
        """Return an action's name, for a table and for the world that executes it."""

    def role(self, symbol: str) -> str:
        """Return what an action of this name is to the gap tests: brake, proceed, or other."""


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
"""A regular expression of words that ask for a picture: the one who says them was shown none."""
_THINK_TAG = re.compile(r"(</?think(?:ing)?>)", re.IGNORECASE)
READ_AT_MOST = 100_000
"""Characters outside thinking, the last ones, that are read for a decision; the ledger keeps all of a reply."""
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
"""What servers call the end of a reply, in small letters with low lines: by itself, cut off, or by a filter."""


@lru_cache(maxsize=1024)
def ending(finish_reason: str | None) -> Ending | None:
    """Return how a reply ended by its finish reason, in whose words and letters it may be; None where nobody can say.

    Nobody can where none is reported, and of a word that is not in `ENDINGS`. What stands behind the word of a filter
    (``content_filter: PROHIBITED_CONTENT``) is its reason.
    """
    word = (finish_reason or "").strip().lower().replace("-", "_").replace(" ", "_")
    word = word.removeprefix("finish_reason_")
    known = ENDINGS.get(word)
    return "filtered" if known is None and ENDINGS.get(word.partition(":")[0]) == "filtered" else known


def unanswered(finish_reason: str | None, error: str | None) -> Missing | None:
    """Return why a reply holds no answer, whatever its text: an error, a cut-off or a filter's refusal; else None."""
    if error is not None:
        return "error"
    ended = ending(finish_reason)
    return "truncated" if ended == "cut" else "refused" if ended == "filtered" else None


def refuses(text: str) -> bool:
    """Return whether a text says in words that it declines to answer; whether it answers all the same is not asked."""
    return _REFUSAL.search(text.replace("’", "'")) is not None


def without_thinking(text: str) -> str:
    """Return what stands outside thinking: its tag may have been opened by the chat template, or never closed."""
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
    """Return whether thinking begins behind the first ``sign`` that stands outside thinking."""
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


def too_deep(text: str, start: int = 0) -> bool:
    """Return whether the JSON value that begins at ``start`` is nested in more than 100 levels, so that it is not read.

    A parser gives up at a depth that depends on its caller's; this bound does not.
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
    """Yield the outermost JSON objects in a text, wherever they stand; none where it has too many braces to try.

    Each with where it begins and ends, and as the ``kind`` that its keys and values make, as those within it are. One
    that is nested too deeply is taken as text.
    """
    decoder, start = json.JSONDecoder(object_pairs_hook=kind), text.find("{")
    if text.count("{") > _BRACES_AT_MOST:
        return
    while start >= 0:
        end = start + 1
        try:
            value, ended = decoder.raw_decode(text, start)
            if not too_deep(text, start):
                end = ended
                yield start, end, value
        except ValueError:
            pass
        except RecursionError:
            if not too_deep(text, start):
                raise
        start = text.find("{", end)
