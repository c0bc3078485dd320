"""Discrete actions have names; which exist, which exchange under reflection, which brake and which proceed.

The decision is found in a reply's verbatim text: strictly, the same way every time, and never guessing.
"""

import json
import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import ClassVar, Literal

import msgspec

from eyechart.errors import SpecError
from eyechart.records import build
from eyechart.spaces.space import (
    READ_AT_MOST,
    UNPARSED,
    Answer,
    Decision,
    refuses,
    too_deep,
    unanswered,
    without_thinking,
)

Unparsed = Literal["no_action", "unknown_action", "several_actions", "negated"]
"""Why a reply of words could not be read: it names no action, states one that the space lacks, names several that
differ, or names one only to deny it."""

READER = 3
"""The version of these rules. A run records it, so that decisions read by other rules are never taken for these."""

_TOML_BYTES = 1_000_000
_NAME = re.compile(r"[^\W_](.*[^\W_])?")
_NEGATION = re.compile(
    r"(\b(not|cannot|never|avoid|avoiding|no|nor|neither|without|than|instead\s+of|unable\s+to)|n't)\s+(\w+\s+)?"
    r"((to|the|a|an|on|into|towards?|go|going|turn|turning|move|moving|change|changing|steer|lanes?)\s+){0,4}[\"'`*(]*$",
    re.IGNORECASE,
)
_NEGATED = re.compile(
    r"[\"'`*)]*\s+((is|was|would\s+be)\s+(not|never|impossible|unsafe|dangerous|blocked|occupied|taken)"
    r"|isn't|wasn't|cannot|can't)\b",
    re.IGNORECASE,
)
_JSON_KEYS = ("action", "decision", "answer")
_MARKER = r"\b(?:action|answer|decision)\W{0,4}(?:[:=>→–—\n-]|\bis\b)\W{0,6}"
_BRACES_AT_MOST = 1000
_SHORT = 80
"""Characters up to which an action in lower case is an answer; in longer prose "the road is straight" is none."""

_SHARED: dict[Decision[str], Decision[str]] = {}
_READINGS_KEPT = 1000
"""Of so many different replies the decision is kept, because controllers repeat themselves."""


@dataclass(frozen=True, slots=True)
class Discrete:
    """Discrete actions with the roles that the battery asks about.

    ``mirror_pairs`` exchange under reflection; actions in none of them are their own mirror image.
    ``brake`` lists the braking actions from the hardest to the mildest; ``proceed`` lists those that go on.
    An action may be in neither. Raises SpecError for an unknown, repeated, unreadable or contradictory name.
    """

    reader: ClassVar[int] = READER
    name: str
    actions: tuple[str, ...]
    mirror_pairs: tuple[tuple[str, str], ...]
    brake: tuple[str, ...]
    proceed: tuple[str, ...]

    def __post_init__(self) -> None:
        if len(set(self.actions)) != len(self.actions) or len(self.actions) < 2:
            raise SpecError(f"action space '{self.name}' needs two or more different actions, got {list(self.actions)}")
        if len({action.upper() for action in self.actions}) != len(self.actions):
            raise SpecError(f"action space '{self.name}': {list(self.actions)} differ only in upper and lower case")
        for action in self.actions:
            if not _NAME.fullmatch(action) or action.upper() == UNPARSED:
                raise SpecError(
                    f"action space '{self.name}': '{action}' cannot be read from a reply; a name is one line, begins "
                    f"and ends with a letter or a digit, and is not {UNPARSED}"
                )
        paired = [action for pair in self.mirror_pairs for action in pair]
        for role, names in (("mirror_pairs", paired), ("brake", self.brake), ("proceed", self.proceed)):
            for action in names:
                if action not in self.actions:
                    raise SpecError(
                        f"action space '{self.name}': {role} names '{action}', not one of {list(self.actions)}"
                    )
            if len(set(names)) != len(names):
                raise SpecError(f"action space '{self.name}': {role} names an action twice")
        if both := set(self.brake) & set(self.proceed):
            raise SpecError(f"action space '{self.name}': {sorted(both)} cannot both brake and proceed")

    @property
    def directional(self) -> tuple[str, ...]:
        """Return the actions that a reflection exchanges."""
        return tuple(action for pair in self.mirror_pairs for action in pair)

    def schema(self) -> dict[str, object]:
        """Return the JSON schema of an answer: an object whose action is one of the names."""
        only = {"required": ["action"], "additionalProperties": False}
        return {"type": "object", "properties": {"action": {"type": "string", "enum": list(self.actions)}}, **only}

    def read(self, reply: Answer) -> Decision[str]:
        """Return the decision that a reply holds; see `_read` for the rules."""
        return _read(self, reply.text, reply.finish_reason, reply.error)

    def distance(self, one: str, other: str) -> float:
        """Return 0 where two actions are the same, else 1."""
        return float(one != other)

    def project(self, action: str, axis: str) -> float | None:
        """Return 0 for an action that does not brake, and 1, 2, … from the mildest brake to the hardest.

        None along another axis than ``brake``.
        """
        if axis != "brake":
            return None
        return float(len(self.brake) - self.brake.index(action) if action in self.brake else 0)

    def symbol(self, action: str) -> str:
        """Return the action, which is its own name."""
        return action

    def role(self, symbol: str) -> str:
        """Return what an action is to the gap tests: brake, proceed, or other."""
        return "brake" if symbol in self.brake else "proceed" if symbol in self.proceed else "other"

    def reflect(self, action: str) -> str:
        """Return the action that the reflected world calls for."""
        both = (either for pair in self.mirror_pairs for either in (pair, pair[::-1]))
        return next((other for one, other in both if one == action), action)

    def as_dict(self) -> dict[str, object]:
        """Return the space as plain JSON values."""
        return dict(msgspec.json.decode(msgspec.json.encode(self)))

    @classmethod
    def from_dict(cls, values: object) -> "Discrete":
        """Build a space from plain values; raises SpecError naming what is wrong."""
        try:
            return build(cls, values)
        except ValueError as error:
            raise SpecError(f"an action space needs name, actions, mirror_pairs, brake and proceed: {error}") from error


def read_space(path: Path) -> Discrete:
    """Read an action space from a TOML file: actions, and if wanted name, mirror_pairs, brake and proceed.

    Raises SpecError naming the file and what is wrong in it.
    """
    return space_from(read_toml(path), str(path), path.stem)


def space_from(values: dict[str, object], where: str, name: str) -> Discrete:
    """Build a space from the plain values of a file; ``name`` is its name where the file gives none.

    Raises SpecError, beginning with ``where``, for a key that no space has, for no actions, and for an illegal space.
    """
    known: dict[str, object] = {"name": name, "actions": None, "mirror_pairs": [], "brake": [], "proceed": []}
    for key in values:
        if key not in known:
            raise SpecError(f"{where}: an action space has no '{key}'; it has {', '.join(known)}")
    if "actions" not in values:
        raise SpecError(f'{where}: no actions; write for example actions = ["STOP", "GO"]')
    try:
        return Discrete.from_dict({**known, **values})
    except SpecError as error:
        raise SpecError(f"{where}: {error}") from error


def read_toml(path: Path) -> dict[str, object]:
    """Read a TOML file of at most 1 MB; raises SpecError naming it and the line at fault."""
    try:
        with path.open("rb") as file:
            text = file.read(_TOML_BYTES + 1)
        if len(text) > _TOML_BYTES:
            raise SpecError(f"{path} has more than {_TOML_BYTES} bytes, too many for settings")
        return tomllib.loads(text.decode("utf-8-sig"))
    except OSError as error:
        raise SpecError(f"{path} cannot be read: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise SpecError(f"{path} is no TOML file: {error}") from error


DRIVING = Discrete(
    name="driving",
    actions=("STOP", "SLOW", "STRAIGHT", "LEFT", "RIGHT"),
    mirror_pairs=(("LEFT", "RIGHT"),),
    brake=("STOP", "SLOW"),
    proceed=("STRAIGHT", "LEFT", "RIGHT"),
)
"""The paper's five actions."""


@lru_cache(maxsize=_READINGS_KEPT)
def _read(space: Discrete, text: str, finish_reason: str | None, error: str | None) -> Decision[str]:
    """Read the decision from a reply's verbatim text; strict, deterministic, and never guessing.

    In order: an error, a cut-off (``length``) or a filter's refusal is the reason there is no decision. What
    stands in ``<think>`` is no answer. Then the whole text as an action; the ``action`` of its JSON objects; the
    last ``action: X``; an action in capitals named alone; in a short reply that refuses nothing, an action in any
    case named alone. The first of these that is there decides, and nothing below it is looked at.
    Several different candidates, or one that is negated, are ``unparsed``, and the Decision says which. Source:
    paper, section Corpus and parsing.
    """
    if (missing := unanswered(finish_reason, error)) is not None:
        return Decision(None, missing)
    visible = without_thinking(text)[-READ_AT_MOST:].replace("’", "'").strip()
    if not visible:
        return Decision(None, "empty")
    refused = refuses(visible)
    found = _find(visible, space, any_case=not refused and len(visible) <= _SHORT)
    decision: Decision[str] = Decision(None, "refused") if refused and found.action is None else found
    return _SHARED.setdefault(decision, decision)


def _find(text: str, space: Discrete, *, any_case: bool) -> Decision[str]:
    by_name = {action.upper(): action for action in space.actions}
    if (bare := _bare(text)) in by_name:
        return Decision(by_name[bare])
    if stated := {_bare(action) for action in _json_actions(text)}:
        if len(stated) > 1:
            return _unparsed("several_actions")
        found = by_name.get(stated.pop())
        return _unparsed("unknown_action") if found is None else Decision(found)
    # Not \b: neither "non-stop" nor "right-hand" names an action.
    name = rf"(?<!\w)(?<!\w-)({'|'.join(re.escape(one) for one in sorted(by_name, key=len, reverse=True))})(?!-?\w)"
    if marked := list(re.finditer(_MARKER + name, text, re.IGNORECASE)):
        # Another action may follow on its line (``ACTION: LEFT or RIGHT``).
        following = re.compile(rf"[^\w\n]{{0,6}}(?:(?:or|and|then)[^\w\n]{{1,6}})?{name}", re.IGNORECASE)
        return _only_one([*marked[-1:], *filter(None, [following.match(text, marked[-1].end())])], by_name)
    for flags in (0, re.IGNORECASE) if any_case else (0,):
        if named := list(re.finditer(name, text, flags)):
            return _only_one(named, by_name)
    return _unparsed("no_action")


def _unparsed(why: Unparsed) -> Decision[str]:
    return Decision(None, "unparsed", why)


def _bare(text: str) -> str:
    return text.strip(" \t\r\n.,;:!*`\"'_()[]").upper()


def _only_one(found: list[re.Match[str]], by_name: dict[str, str]) -> Decision[str]:
    if len({match.group(1).upper() for match in found}) != 1:
        return _unparsed("several_actions")
    for match in found:
        text, start = match.string, match.start(1)
        if _NEGATION.search(text[max(0, start - 60) : start]) or _NEGATED.match(text, match.end(1)):
            return _unparsed("negated")
    # get: ignoring case, a regular expression takes "İ" for "I", and upper() does not.
    action = by_name.get(found[0].group(1).upper())
    return _unparsed("no_action") if action is None else Decision(action)


def _json_actions(text: str) -> Iterator[str]:
    """Yield what each JSON object that states an action states; an empty text where that is no text."""
    for value in _json_objects(text):
        by_key = {key.lower(): action for key, action in value.items()}
        stated = next((by_key[key] for key in _JSON_KEYS if key in by_key), None)
        if any(key in by_key for key in _JSON_KEYS):
            yield stated if isinstance(stated, str) else ""


def _json_objects(text: str) -> Iterator[dict[str, object]]:
    """Yield the outermost JSON objects in a text, wherever they stand; none where it has too many braces to try.

    One that is nested too deeply is taken as text.
    """
    decoder, start = json.JSONDecoder(), text.find("{")
    if text.count("{") > _BRACES_AT_MOST:
        return
    while start >= 0:
        end = start + 1
        try:
            value, ended = decoder.raw_decode(text, start)
            if not too_deep(text, start):
                end = ended
                yield value
        except ValueError:
            pass
        except RecursionError:
            if not too_deep(text, start):
                raise
        start = text.find("{", end)
