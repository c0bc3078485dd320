import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eyechart.errors import SpecError
from eyechart.spaces.discrete import DRIVING, Discrete
from eyechart.spaces.space import MISSING, Decision


@st.composite
def spaces(draw: st.DrawFn) -> Discrete:
    """Draw a legal action space."""
    names = draw(st.lists(st.from_regex(r"[A-Z]{1,6}", fullmatch=True), min_size=2, max_size=8, unique=True))
    names = [name for name in names if name != "UNPARSED"]
    pairs = draw(st.integers(0, len(names) // 2))
    mixed = draw(st.permutations(names))
    cut = draw(st.integers(0, len(names)))
    return Discrete(
        "drawn",
        tuple(names),
        tuple((mixed[2 * at], mixed[2 * at + 1]) for at in range(pairs)),
        tuple(mixed[:cut]),
        tuple(mixed[cut:]),
    )


@given(spaces())
def test_mirroring_twice_is_the_identity(space: Discrete) -> None:
    """The mirror is an involution, and moves exactly the directional actions."""
    for action in space.actions:
        assert space.reflect(space.reflect(action)) == action
        assert (space.reflect(action) != action) == (action in space.directional)


@given(spaces())
def test_an_action_space_survives_json(space: Discrete) -> None:
    """A bank's manifest gives back the space that it was written with."""
    assert Discrete.from_dict(json.loads(json.dumps(space.as_dict()))) == space


@given(spaces())
def test_braking_levels_fall_from_the_hardest_to_none(space: Discrete) -> None:
    """The hardest brake has the highest level, and what goes on has 0."""
    levels = [space.project(action, "brake") for action in space.brake]
    assert levels == list(range(len(space.brake), 0, -1))
    assert all(space.project(action, "brake") == 0 for action in space.proceed)


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"actions": ("GO",), "brake": (), "proceed": (), "mirror_pairs": ()}, "two or more"),
        ({"actions": ("GO", "GO", "L", "R")}, "two or more different"),
        ({"actions": ("GO", "Go", "L", "R", "HALT")}, "upper and lower case"),
        ({"actions": ("GO", "", "L", "R", "HALT")}, "''"),
        ({"actions": ("GO", "unparsed", "L", "R", "HALT")}, "'unparsed'"),
        ({"actions": ("GO", " X", "L", "R", "HALT")}, "' X'"),
        ({"actions": ("GO", "A\nB", "L", "R", "HALT")}, "'A\nB'"),
        ({"actions": ("GO", "X!", "L", "R", "HALT")}, "'X!'"),
        ({"brake": ("WAIT",)}, "brake names 'WAIT'"),
        ({"proceed": ("RUN",)}, "proceed names 'RUN'"),
        ({"mirror_pairs": (("L", "UP"),)}, "mirror_pairs names 'UP'"),
        ({"mirror_pairs": (("L", "L"),)}, "mirror_pairs names an action twice"),
        ({"mirror_pairs": (("L", "R"), ("R", "GO"))}, "mirror_pairs names an action twice"),
        ({"brake": ("HALT", "HALT")}, "brake names an action twice"),
        ({"brake": ("HALT", "GO")}, "cannot both brake and proceed"),
    ],
)
def test_an_illegal_action_space_is_refused_by_name(changed: dict[str, tuple[str, ...]], named: str) -> None:
    """The message says which space and which name is at fault."""
    legal = {
        "actions": ("GO", "L", "R", "HALT"),
        "mirror_pairs": (("L", "R"),),
        "brake": ("HALT",),
        "proceed": ("GO",),
    }
    Discrete("mine", **legal)  # type: ignore[arg-type]
    with pytest.raises(SpecError, match="action space 'mine'") as refused:
        Discrete("mine", **(legal | changed))  # type: ignore[arg-type]
    assert named in str(refused.value)


@pytest.mark.parametrize(
    "values",
    [
        {},
        {"name": "x"},
        DRIVING.as_dict() | {"actions": "STOP"},
        DRIVING.as_dict() | {"mirror_pairs": [["LEFT", "RIGHT", "STOP"]]},
        DRIVING.as_dict() | {"mirror_pairs": [1]},
        DRIVING.as_dict() | {"brake": None},
    ],
)
def test_plain_values_that_are_no_action_space_are_refused(values: dict[str, object]) -> None:
    """A damaged manifest gives one line, not a traceback."""
    with pytest.raises(SpecError, match="an action space needs name, actions"):
        Discrete.from_dict(values)


def test_a_decision_has_exactly_one_of_action_and_reason() -> None:
    """There is no default and no substitute."""
    with pytest.raises(ValueError, match="either an action or the reason"):
        Decision(None)
    with pytest.raises(ValueError, match="either an action or the reason"):
        Decision("STOP", "refused")
    with pytest.raises(ValueError, match="only an unparsed Decision says why, not one that is refused"):
        Decision(None, "refused", "negated")
    with pytest.raises(ValueError, match="only an unparsed Decision says why, not one that is STOP"):
        Decision("STOP", None, "negated")
    assert Decision("STOP").symbol == "STOP"
    assert {Decision(None, reason).symbol for reason in MISSING} == {"UNPARSED"}


def test_only_equal_actions_agree() -> None:
    """A mirrored action is another decision."""
    assert DRIVING.distance("LEFT", "LEFT") == 0.0
    assert DRIVING.distance("LEFT", DRIVING.reflect("LEFT")) == 1.0
