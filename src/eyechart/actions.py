"""An action space says which decisions exist, which exchange under reflection, which brake and which proceed."""

import re
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from eyechart.errors import SpecError

Missing = Literal["unparsed", "truncated", "refused", "empty", "error"]
"""Why a reply holds no decision."""

MISSING: tuple[Missing, ...] = ("unparsed", "truncated", "refused", "empty", "error")

Unparsed = Literal["no_action", "unknown_action", "several_actions", "negated"]
"""Why a reply of words could not be read: it names no action, states one that the space lacks, names several that
differ, or names one only to deny it."""

UNPARSED = "UNPARSED"
"""The response-level symbol of every reply without a decision; no action may have this name."""

_TOML_BYTES = 1_000_000
_NAME = re.compile(r"[^\W_](.*[^\W_])?")


@dataclass(frozen=True, slots=True)
class Decision:
    """An action, or the reason there is none. There is no default and no substitute.

    ``why`` says more of a reply that is ``unparsed``. Raises ValueError unless exactly one of ``action`` and
    ``missing`` is given, and where ``why`` is given for another reason than ``unparsed``.
    """

    action: str | None
    missing: Missing | None = None
    why: Unparsed | None = None

    def __post_init__(self) -> None:
        if (self.action is None) == (self.missing is None):
            raise ValueError("a Decision has either an action or the reason there is none, never both or neither")
        if self.why is not None and self.missing != "unparsed":
            raise ValueError(f"only an unparsed Decision says why, not one that is {self.missing or self.action}")

    @property
    def symbol(self) -> str:
        """Return the response-level symbol: the action, or ``UNPARSED`` whatever the reason."""
        return self.action if self.action is not None else UNPARSED

    @property
    def reason(self) -> str | None:
        """Return why there is no decision, with what is wrong with an ``unparsed`` reply; None where there is one."""
        return self.missing if self.why is None else f"{self.missing}: {self.why}"


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
