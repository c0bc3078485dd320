"""An action space says which decisions exist, which exchange under reflection, which brake and which proceed."""

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from eyechart.errors import SpecError

Missing = Literal["unparsed", "truncated", "refused", "empty", "error"]
"""Why a reply holds no decision."""

MISSING: tuple[Missing, ...] = ("unparsed", "truncated", "refused", "empty", "error")


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
        return self.action if self.action is not None else "UNPARSED"


@dataclass(frozen=True, slots=True)
class ActionSpace:
    """Discrete actions with the roles that the battery asks about.

    ``mirror_pairs`` exchange under reflection; actions in none of them are their own mirror image.
    ``brake`` lists the braking actions from the hardest to the mildest; ``proceed`` lists those that go on.
    An action may be in neither. Raises SpecError for an unknown, repeated or contradictory name.
    """

    name: str
    actions: tuple[str, ...]
    mirror_pairs: tuple[tuple[str, str], ...]
    brake: tuple[str, ...]
    proceed: tuple[str, ...]

    def __post_init__(self) -> None:
        if len(set(self.actions)) != len(self.actions) or len(self.actions) < 2:
            raise SpecError(f"action space '{self.name}' needs two or more different actions, got {list(self.actions)}")
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
_NEGATION = re.compile(r"(\bnot|n't|\bnever|\bavoid|\bno|\bwithout)\s+(\w+\s+){0,1}$", re.IGNORECASE)
_THINKING = re.compile(r"<think>.*?</think>", re.DOTALL | re.IGNORECASE)
_FENCE = re.compile(r"```(?:json)?\s*(.*?)```", re.DOTALL | re.IGNORECASE)
_READ_AT_MOST = 100_000
"""Characters of a reply that are read for a decision; the ledger keeps all of it."""


def read_decision(text: str, finish_reason: str | None, error: str | None, space: ActionSpace) -> Decision:
    """Read the decision from a reply's verbatim text; strict, deterministic, and never guessing.

    In order: an error, a cut-off (``length``) or a filter's refusal is the reason there is no decision. Then
    the whole text as an action; a JSON object's ``action``; the last ``action: X`` line; an action in capitals
    named alone; an action in any case named alone. Several different candidates, or one that is negated, are
    ``unparsed``. Source: paper, section Corpus and parsing.
    """
    if error is not None:
        return Decision(None, "error")
    if finish_reason == "length":
        return Decision(None, "truncated")
    if finish_reason in {"content_filter", "refusal"}:
        return Decision(None, "refused")
    visible = _THINKING.sub(" ", text[-_READ_AT_MOST:]).strip()
    if not visible:
        return Decision(None, "empty")
    action = _find_action(visible, space)
    if action is not None:
        return Decision(action)
    return Decision(None, "refused" if _REFUSAL.search(visible) else "unparsed")


def _find_action(text: str, space: ActionSpace) -> str | None:
    by_name = {action.upper(): action for action in space.actions}
    bare = text.strip(" \t\r\n.,;:!*`\"'_()[]").upper()
    if bare in by_name:
        return by_name[bare]
    stated = _json_action(text)
    if stated is not None:
        return by_name.get(stated.strip().upper())
    names = "|".join(re.escape(name) for name in sorted(by_name, key=len, reverse=True))
    marked = re.findall(
        rf"\b(?:final\s+)?(?:action|answer|decision)\W{{0,6}}(?:is\W{{1,4}})?({names})\b", text, re.IGNORECASE
    )
    if marked:
        return by_name[marked[-1].upper()]
    for pattern in (re.compile(rf"\b({names})\b"), re.compile(rf"\b({names})\b", re.IGNORECASE)):
        found = list(pattern.finditer(text))
        if found:
            return _only_one(found, text, by_name)
    return None


def _only_one(found: list[re.Match[str]], text: str, by_name: dict[str, str]) -> str | None:
    if len({match.group().upper() for match in found}) != 1:
        return None
    if any(_NEGATION.search(text[max(0, match.start() - 40) : match.start()]) for match in found):
        return None
    return by_name[found[0].group().upper()]


def _json_action(text: str) -> str | None:
    """Return the ``action`` of the last JSON object in the text, or None where there is none."""
    candidates = [*_FENCE.findall(text), *re.findall(r"\{[^{}]{0,4000}\}", text)]
    for candidate in reversed(candidates):
        try:
            value = json.loads(candidate)
        except (ValueError, RecursionError):
            continue
        if isinstance(value, dict):
            for key, action in value.items():
                if str(key).lower() in {"action", "decision", "answer"} and isinstance(action, str):
                    return action
    return None
