"""Discrete actions: their names, and which brake, proceed, or exchange under reflection.

The decision is read from a reply's verbatim text: strictly, reproducibly, and without guessing.
"""

import json
import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import ClassVar, Self

from eyechart.errors import SpecError, raising, read_at_most
from eyechart.records import build, to_json_fields
from eyechart.spaces.reader import READER, READERS, ActionNames, read_by, spelled
from eyechart.spaces.space import (
    READ_AT_MOST,
    UNPARSED,
    Answer,
    AnySpace,
    Decision,
    SpaceDefaults,
    why_unanswered,
    without_thinking,
)

_TOML_BYTES = 1_000_000
_NAME = re.compile(r"[+-]?\d+(\.\d+)?\s?[°%]?|([+-]?\d|[^\W_])(.*[^\W_])?")
_SHARED: dict[Decision[str], Decision[str]] = {}
_READINGS_KEPT = 1000
"""Cached readings of replies, because controllers repeat themselves."""


@dataclass(frozen=True, slots=True)
class Discrete(SpaceDefaults):
    """Discrete actions with the roles that the battery needs.

    ``mirror_pairs`` exchange under reflection; other actions are their own mirror image. Of letters
    and numbers without signs the first of a pair is the left one, unless its alias says "right".
    "2 (left)" is then no action where 2 is the right one. ``brake``
    lists the braking actions from hardest to mildest, ``proceed`` those that go on; an action may
    be in neither. ``aliases`` map other names to actions; no other word is read as an action.
    ``reader`` is the version of the reading rules, and no part of the space. Raises SpecError for
    an unknown, repeated, unreadable or contradictory name.
    """

    readers: ClassVar[tuple[int, ...]] = READERS
    name: str
    actions: tuple[str, ...]
    mirror_pairs: tuple[tuple[str, str], ...]
    brake: tuple[str, ...]
    proceed: tuple[str, ...]
    aliases: tuple[tuple[str, str], ...] = ()
    reader: int = field(default=READER, compare=False)

    def __post_init__(self) -> None:
        if len(set(self.actions)) != len(self.actions) or len(self.actions) < 2:
            raise SpecError(f"action space '{self.name}' needs two or more different actions, got {list(self.actions)}")
        if len({action.upper() for action in self.actions}) != len(self.actions):
            raise SpecError(f"action space '{self.name}': {list(self.actions)} differ only in upper and lower case")
        for action in self.actions:
            self._require_readable(action)
        if len({*map(spelled, self.actions)}) != len(self.actions):
            raise SpecError(
                f"action space '{self.name}': two of {list(self.actions)} are the same number, or the same in words"
            )
        paired = [action for pair in self.mirror_pairs for action in pair]
        meant = [action for _, action in self.aliases]
        for role, names in (("mirror_pairs", paired), ("brake", self.brake), ("proceed", self.proceed)):
            self._require_actions(role, names)
            if len(set(names)) != len(names):
                raise SpecError(f"action space '{self.name}': {role} names an action twice")
        if both := set(self.brake) & set(self.proceed):
            raise SpecError(f"action space '{self.name}': {sorted(both)} cannot both brake and proceed")
        self._require_actions("aliases", meant)
        known = {spelled(action) for action in self.actions}
        for alias, _ in self.aliases:
            self._require_readable(alias)
            if spelled(alias) in known:
                raise SpecError(f"action space '{self.name}': the alias '{alias}' is an action's name, or given twice")
            known.add(spelled(alias))

    def _require_readable(self, name: str) -> None:
        if not _NAME.fullmatch(name) or name.upper() == UNPARSED:
            raise SpecError(
                f"action space '{self.name}': '{name}' cannot be read from a reply. A name is one line, begins "
                f"and ends with a letter or a digit (a number may have its sign), and is not {UNPARSED}"
            )

    def _require_actions(self, role: str, names: Sequence[str]) -> None:
        for action in names:
            if action not in self.actions:
                raise SpecError(f"action space '{self.name}': {role} names '{action}', not one of {list(self.actions)}")

    def by(self, reader: int) -> Self:
        """Return the space with this version of the reading rules; unchanged if it is unknown."""
        return replace(self, reader=reader) if reader in READERS else self

    @property
    def names(self) -> ActionNames:
        """Return the names of the actions and their aliases, as read in words."""
        return ActionNames((*((action, action) for action in self.actions), *self.aliases), self.mirror_pairs)

    @property
    def choices(self) -> tuple[str, ...]:
        """Return the names that a prompt must say."""
        return self.actions

    def on(self, own: "Discrete") -> "Discrete":
        """Return the space of a prompt on a bank with its ``own`` actions."""
        del own
        return self

    def among(self, rows: Iterable[Mapping[str, object]]) -> "Discrete":
        """Return the space of frames with these fields in their words."""
        del rows
        return self

    def opposite(self, turn: str) -> str:
        """Return the turn that the reflected world calls for."""
        return self.reflect(turn)

    @property
    def turns(self) -> tuple[str, ...]:
        """Return the parts of the actions that a reflection exchanges: here whole actions."""
        return self.directional

    @property
    def directional(self) -> tuple[str, ...]:
        """Return the actions that a reflection exchanges."""
        return tuple(action for pair in self.mirror_pairs for action in pair)

    def schema(self) -> dict[str, object]:
        """Return the JSON schema of an answer: an object whose action is one of the names."""
        only = {"required": ["action"], "additionalProperties": False}
        return {"type": "object", "properties": {"action": {"type": "string", "enum": list(self.actions)}}, **only}

    def read(self, reply: Answer) -> Decision[str]:
        """Return the decision in a reply; see `_read` for the rules."""
        return _read(self, self.reader, reply.text, reply.finish_reason, reply.error)

    def distance(self, one: str, other: str) -> float:
        """Return 0 if two actions are the same, else 1."""
        return float(one != other)

    def project(self, action: str, axis: str) -> float | None:
        """Return 0 for an action that does not brake, else 1, 2, … from mildest to hardest.

        None for any axis other than ``brake``.
        """
        if axis != "brake":
            return None
        return float(len(self.brake) - self.brake.index(action) if action in self.brake else 0)

    def symbol(self, action: str) -> str:
        """Return the action, which is its own name."""
        return action

    def role(self, symbol: str) -> str:
        """Return the role of an action in the gap tests: brake, proceed, or other."""
        return "brake" if symbol in self.brake else "proceed" if symbol in self.proceed else "other"

    def reflect(self, action: str) -> str:
        """Return the action that the reflected world calls for."""
        both = (either for pair in self.mirror_pairs for either in (pair, pair[::-1]))
        return next((other for one, other in both if one == action), action)

    def wording(self) -> str:
        """Return a text that changes with the space."""
        return json.dumps(self.as_dict())

    def written(self) -> dict[str, object]:
        """Return the space as plain JSON values, under its name in a prompt."""
        return {"action_space": self.as_dict()}

    def as_dict(self) -> dict[str, object]:
        """Return the space as plain JSON values."""
        return to_json_fields(self, "name actions mirror_pairs brake proceed" + " aliases" * bool(self.aliases))

    @classmethod
    def from_dict(cls, values: object) -> "Discrete":
        """Build a space from plain values; raises SpecError that names the fault."""
        with raising(SpecError, "an action space needs name, actions, mirror_pairs, brake and proceed", of=ValueError):
            written = build(_SpaceFile, values)
        return cls(
            written.name,
            written.actions,
            written.mirror_pairs,
            written.brake,
            written.proceed,
            tuple(written.aliases.items()) if isinstance(written.aliases, Mapping) else written.aliases,
        )


def named_actions(space: AnySpace | None, own: Discrete) -> Discrete:
    """Return the named actions to read from replies: a prompt's, or a bank's ``own``."""
    return space.on(own) if isinstance(space, Discrete) else own


@dataclass(frozen=True, slots=True)
class _SpaceFile:
    """A space in the form of a file."""

    name: str
    actions: tuple[str, ...]
    mirror_pairs: tuple[tuple[str, str], ...]
    brake: tuple[str, ...]
    proceed: tuple[str, ...]
    aliases: Mapping[str, str] | tuple[tuple[str, str], ...] = ()


def read_space(path: Path) -> Discrete:
    """Read an action space from a TOML file.

    It has actions, and optionally name, mirror_pairs, brake, proceed and aliases. Raises SpecError
    naming the file and the fault.
    """
    return space_from(read_toml(path), str(path), path.stem)


def space_from(values: dict[str, object], where: str, name: str) -> Discrete:
    """Build a space from a file's plain values; ``name`` is used if the file has none.

    Raises SpecError, beginning with ``where``, for an unknown key, missing actions, or an illegal
    space.
    """
    known: dict[str, object] = {
        "name": name,
        "actions": None,
        "mirror_pairs": [],
        "brake": [],
        "proceed": [],
        "aliases": {},
    }
    for key in values:
        if key == "answer":
            raise SpecError(
                f"{where}: [answer] says how a reply is read, and stands in the file of a prompt (--prompt FILE.toml); "
                "actions of a bank are names alone"
            )
        if key not in known:
            raise SpecError(f"{where}: an action space has no '{key}'; it has {', '.join(known)}")
    if "actions" not in values:
        raise SpecError(f'{where}: no actions; write for example actions = ["STOP", "GO"]')
    with raising(SpecError, where, of=SpecError):
        return Discrete.from_dict({**known, **values})


def read_toml(path: Path) -> dict[str, object]:
    """Read a TOML file of at most 1 MB; raises SpecError naming it and the wrong line."""
    text = read_at_most(path, _TOML_BYTES, SpecError, "settings")
    with raising(SpecError, f"{path} is no TOML file", of=(ValueError, RecursionError)):
        return tomllib.loads(text.decode("utf-8-sig"))


DRIVING = Discrete(
    name="driving",
    actions=("STOP", "SLOW", "STRAIGHT", "LEFT", "RIGHT"),
    mirror_pairs=(("LEFT", "RIGHT"),),
    brake=("STOP", "SLOW"),
    proceed=("STRAIGHT", "LEFT", "RIGHT"),
)
"""The paper's five actions."""


@lru_cache(maxsize=_READINGS_KEPT)
def _read(space: Discrete, rules: int, text: str, finish_reason: str | None, error: str | None) -> Decision[str]:
    """Read the decision from a reply's verbatim text: strictly, and never guessing.

    First, an error, a cut-off (``length``) or a filter's refusal is the reason for no decision.
    Then text in ``<think>`` is removed. Then the words are read by version ``rules`` of the reading
    rules. Source: paper, section Corpus and parsing.
    """
    if (missing := why_unanswered(finish_reason, error)) is not None:
        return Decision(None, missing)
    visible = without_thinking(text)[-READ_AT_MOST:].replace("’", "'").strip()
    if not visible:
        return Decision(None, "empty")
    decision = read_by(rules, visible, space.names)
    return _SHARED.setdefault(decision, decision)
