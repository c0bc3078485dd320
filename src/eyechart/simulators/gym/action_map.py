"""Action maps: the meaning of a Gymnasium environment's action numbers and info."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec

from eyechart.errors import SpecError
from eyechart.frames import MirrorAxis
from eyechart.spaces.discrete import Discrete, read_toml, space_from

Meaning = Literal["crash", "goal"]
"""The meaning of an environment's ``terminated`` if its info does not report crashes."""

ONE_SCENARIO = "default"
"""The scenario of a map that names none: the environment as it is registered."""

_KEYS = ("numbers", "mirror", "picture", "terminated", "repeat", "most_steps", "info", "scenarios")
_STEPS = Annotated[int, msgspec.Meta(ge=1, le=100_000)]
_SETTINGS = {
    "mirror": (MirrorAxis, "vertical, horizontal or none"),
    "terminated": (Meaning, "crash or goal"),
    "repeat": (_STEPS, "a whole number from 1 to 100000"),
    "most_steps": (_STEPS, "a whole number from 1 to 100000"),
}
_PICTURE = "what the environment renders"


@dataclass(frozen=True, slots=True)
class ActionMap:
    """The mapping between an action space and an environment.

    ``numbers`` maps each action to the environment's number. ``info`` maps a column of ground truth
    to a key of the environment's info; ``rewards.collision`` is a key within a key. ``scenarios``
    maps a name to further arguments of ``gymnasium.make``. A decision lasts ``repeat`` steps of the
    environment, and a drive at most ``most_steps`` decisions.
    """

    space: Discrete
    numbers: Mapping[str, int]
    mirror: MirrorAxis = "none"
    picture: str = _PICTURE
    terminated: Meaning = "crash"
    repeat: int = 1
    most_steps: int = 200
    info: Mapping[str, str] = field(default_factory=dict)
    scenarios: Mapping[str, Mapping[str, object]] = field(default_factory=lambda: {ONE_SCENARIO: {}})

    def as_dict(self) -> dict[str, object]:
        """Return the map as plain values."""
        return {**asdict(self), "space": self.space.as_dict()}


def read_map(path: Path) -> ActionMap:
    """Read an action map: the TOML file of an action space with one more table, ``gym``.

    Raises SpecError with the file and the fault.
    """
    values = read_toml(path)
    given = values.pop("gym", None)
    where = f"{path}"
    if not isinstance(given, dict):
        raise SpecError(f"{where}: no table [gym]; write for example [gym.numbers] and under it LEFT = 0")
    for key in given:
        if key not in _KEYS:
            raise SpecError(f"{where}: [gym] has no '{key}'; it has {', '.join(_KEYS)}")
    space = space_from(values, where, path.stem)
    settings: dict[str, Any] = {}
    for key, (kind, words) in _SETTINGS.items():
        try:
            settings |= {key: msgspec.convert(given[key], kind)} if key in given else {}
        except msgspec.ValidationError as error:
            raise SpecError(f"{where}: [gym] {key} takes {words}, not {given[key]!r}") from error
    info, scenarios = _table(given, "info", where), _table(given, "scenarios", where)
    return ActionMap(
        space=space,
        numbers=_numbers(given, space, where),
        picture=_text(given, "picture", where),
        info={column: _text(info, column, where) for column in info},
        scenarios={name: _table(scenarios, name, where) for name in scenarios} or {ONE_SCENARIO: {}},
        **settings,
    )


def _table(given: Mapping[str, object], key: str, where: str) -> dict[str, object]:
    value = given.get(key, {})
    if not isinstance(value, dict):
        raise SpecError(f"{where}: '{key}' must be a table, not {value!r}")
    return value


def _numbers(given: Mapping[str, object], space: Discrete, where: str) -> dict[str, int]:
    numbers: dict[str, int] = {}
    for action, number in _table(given, "numbers", where).items():
        if action not in space.actions:
            raise SpecError(f"{where}: [gym.numbers] names '{action}', not one of {list(space.actions)}")
        if not isinstance(number, int) or isinstance(number, bool):
            raise SpecError(f"{where}: [gym.numbers] gives {action} the number {number!r}; it must be a whole number")
        numbers[action] = number
    if missing := [action for action in space.actions if action not in numbers]:
        raise SpecError(f"{where}: [gym.numbers] gives no number for {', '.join(missing)}")
    return numbers


def _text(given: Mapping[str, object], key: str, where: str) -> str:
    value = given.get(key, _PICTURE)
    if not isinstance(value, str) or not value:
        raise SpecError(f"{where}: '{key}' must be text, not {value!r}")
    return value
