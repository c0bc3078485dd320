"""An action space says which decisions exist, which exchange under reflection, which brake and which proceed."""

import json
import re
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from eyechart.errors import SpecError

Missing = Literal["unparsed", "truncated", "refused", "empty", "error"]
"""Why a reply holds no decision."""

MISSING: tuple[Missing, ...] = ("unparsed", "truncated", "refused", "empty", "error")

UNPARSED = "UNPARSED"
"""The response-level symbol of every reply without a decision; no action may have this name."""

_TOML_BYTES = 1_000_000
_NAME = re.compile(r"[^\W_](.*[^\W_])?")


@dataclass(frozen=True, slots=True)
class Decision:
    """An action, or the reason there is none. There is no default and no substitute.

    Raises ValueError unless exactly one of ``action`` and ``missing`` is given.
    """

    action: str | None
    missing: Missing | None = None

    def __post_init__(self) -> None:
        if (self.action is None) == (self.missing is None):
            raise ValueError("a Decision has either an action or the reason there is none, never both or neither")

    @property
    def symbol(self) -> str:
        """Return the response-level symbol: the action, or ``UNPARSED`` whatever the reason."""
        return self.action if self.action is not None else UNPARSED


@dataclass(frozen=True, slots=True)
class ActionSpace:
    """Discrete actions with the roles that the battery asks about.

    ``mirror_pairs`` exchange under reflection; actions in none of them are their own mirror image.
    ``brake`` lists the braking actions from the hardest to the mildest; ``proceed`` lists those that go on.
    An action may be in neither. Raises SpecError for an unknown, repeated, unreadable or contradictory name.
    """

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

    def mirror(self, action: str) -> str:
        """Return the action that the reflected world calls for."""
        for one, other in self.mirror_pairs:
            if action == one:
                return other
            if action == other:
                return one
        return action

    def agree(self, one: str, other: str) -> bool:
        """Return whether two decisions are the same decision."""
        return one == other

    def braking_level(self, action: str) -> int:
        """Return 0 for an action that does not brake, and 1, 2, … from the mildest brake to the hardest."""
        return len(self.brake) - self.brake.index(action) if action in self.brake else 0

    def as_dict(self) -> dict[str, object]:
        """Return the space as plain JSON values."""
        return {
            "name": self.name,
            "actions": list(self.actions),
            "mirror_pairs": [list(pair) for pair in self.mirror_pairs],
            "brake": list(self.brake),
            "proceed": list(self.proceed),
        }

    @classmethod
    def from_dict(cls, values: dict[str, object]) -> "ActionSpace":
        """Build a space from plain values; raises SpecError naming what is wrong."""
        try:
            pairs = [tuple(map(str, pair)) for pair in _list(values["mirror_pairs"])]
            return cls(
                name=str(values["name"]),
                actions=tuple(map(str, _list(values["actions"]))),
                mirror_pairs=tuple((one, other) for one, other in pairs),
                brake=tuple(map(str, _list(values["brake"]))),
                proceed=tuple(map(str, _list(values["proceed"]))),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise SpecError(f"an action space needs name, actions, mirror_pairs, brake and proceed: {error}") from error


def read_space(path: Path) -> ActionSpace:
    """Read an action space from a TOML file: actions, and if wanted name, mirror_pairs, brake and proceed.

    Raises SpecError naming the file and what is wrong in it.
    """
    return space_from(read_toml(path), str(path), path.stem)


def space_from(values: dict[str, object], where: str, name: str) -> ActionSpace:
    """Build a space from the plain values of a file; ``name`` is its name where the file gives none."""
    known: dict[str, object] = {"name": name, "actions": None, "mirror_pairs": [], "brake": [], "proceed": []}
    for key in values:
        if key not in known:
            raise SpecError(f"{where}: an action space has no '{key}'; it has {', '.join(known)}")
    if "actions" not in values:
        raise SpecError(f'{where}: no actions; write for example actions = ["STOP", "GO"]')
    try:
        return ActionSpace.from_dict({**known, **values})
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


def _list(value: object) -> list[Sequence[object]]:
    if not isinstance(value, list | tuple):
        raise TypeError(f"expected a list, got {value!r}")
    return list(value)


DRIVING = ActionSpace(
    name="driving",
    actions=("STOP", "SLOW", "STRAIGHT", "LEFT", "RIGHT"),
    mirror_pairs=(("LEFT", "RIGHT"),),
    brake=("STOP", "SLOW"),
    proceed=("STRAIGHT", "LEFT", "RIGHT"),
)
"""The paper's five actions."""

_REFUSAL = re.compile(
    r"\b(i\s+(can(no|')t|am\s+(unable|not\s+able)|won't|will\s+not|must\s+decline)|i'm\s+(unable|not\s+able|sorry)"
    r"|sorry|cannot\s+(assist|help|see|comply)|unable\s+to\s+(assist|help|see|determine|comply)|no\s+image\b)",
    re.IGNORECASE,
)
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
_THINK_TAG = re.compile(r"(</?think(?:ing)?>)", re.IGNORECASE)
_JSON_KEYS = ("action", "decision", "answer")
_READ_AT_MOST = 100_000
"""Characters of a reply that are read for a decision; the ledger keeps all of it."""
_BRACES_AT_MOST = 1000
_SHORT = 80
"""Characters up to which an action in lower case is an answer; in longer prose "the road is straight" is none."""


def read_decision(text: str, finish_reason: str | None, error: str | None, space: ActionSpace) -> Decision:
    """Read the decision from a reply's verbatim text; strict, deterministic, and never guessing.

    In order: an error, a cut-off (``length``) or a filter's refusal is the reason there is no decision. What
    stands in ``<think>`` is no answer. Then the whole text as an action; the last JSON object's ``action``; the
    last ``action: X``; an action in capitals named alone; in a short reply that refuses nothing, an action in any
    case named alone.
    Several different candidates, or one that is negated, are ``unparsed``. Source: paper, section Corpus and
    parsing.
    """
    if error is not None:
        return Decision(None, "error")
    if finish_reason == "length":
        return Decision(None, "truncated")
    if finish_reason in {"content_filter", "refusal"}:
        return Decision(None, "refused")
    visible = _without_thinking(text[-_READ_AT_MOST:]).replace("’", "'").strip()
    if not visible:
        return Decision(None, "empty")
    refuses = _REFUSAL.search(visible) is not None
    action = _find_action(visible, space, any_case=not refuses and len(visible) <= _SHORT)
    if action is not None:
        return Decision(action)
    return Decision(None, "refused" if refuses else "unparsed")


def _without_thinking(text: str) -> str:
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


def _find_action(text: str, space: ActionSpace, *, any_case: bool) -> str | None:
    by_name = {action.upper(): action for action in space.actions}
    if (bare := _bare(text)) in by_name:
        return by_name[bare]
    stated = _json_action(text)
    if stated is not None:
        return by_name.get(_bare(stated))
    # Not \b: neither "non-stop" nor "right-hand" names an action.
    name = rf"(?<!\w)(?<!\w-)({'|'.join(re.escape(one) for one in sorted(by_name, key=len, reverse=True))})(?!-?\w)"
    marker = r"\b(?:action|answer|decision)\W{0,4}(?:[:=>→–—\n-]|\bis\b)\W{0,6}"
    marked = list(re.finditer(marker + name, text, re.IGNORECASE))
    if marked:
        return _only_one([*marked[-1:], *_alternative(marked[-1], name)], by_name)
    for flags in (0, re.IGNORECASE) if any_case else (0,):
        found = list(re.finditer(name, text, flags))
        if found:
            return _only_one(found, by_name)
    return None


def _bare(text: str) -> str:
    return text.strip(" \t\r\n.,;:!*`\"'_()[]").upper()


def _alternative(marked: re.Match[str], name: str) -> list[re.Match[str]]:
    """Return the other action that follows a marked one on its line (``ACTION: LEFT or RIGHT``), if any."""
    following = re.compile(rf"[^\w\n]{{0,6}}(?:(?:or|and|then)[^\w\n]{{1,6}})?{name}", re.IGNORECASE)
    other = following.match(marked.string, marked.end())
    return [] if other is None else [other]


def _only_one(found: list[re.Match[str]], by_name: dict[str, str]) -> str | None:
    if len({match.group(1).upper() for match in found}) != 1 or any(map(_negated, found)):
        return None
    # get: ignoring case, a regular expression takes "İ" for "I", and upper() does not.
    return by_name.get(found[0].group(1).upper())


def _negated(match: re.Match[str]) -> bool:
    text, start = match.string, match.start(1)
    return bool(_NEGATION.search(text[max(0, start - 60) : start]) or _NEGATED.match(text, match.end(1)))


def _json_action(text: str) -> str | None:
    """Return the action of the last JSON object that has one, or None where there is none."""
    for value in reversed(list(_json_objects(text))):
        by_key = {key.lower(): action for key, action in value.items()}
        for key in _JSON_KEYS:
            if key in by_key:
                action = by_key[key]
                return action if isinstance(action, str) else ""
    return None


def _json_objects(text: str) -> Iterator[dict[str, object]]:
    """Yield the outermost JSON objects in a text, wherever they stand; none where it has too many braces to try."""
    decoder, start = json.JSONDecoder(), text.find("{")
    if text.count("{") > _BRACES_AT_MOST:
        return
    while start >= 0:
        end = start + 1
        try:
            value, end = decoder.raw_decode(text, start)
            yield value
        except (ValueError, RecursionError):
            pass
        start = text.find("{", end)
