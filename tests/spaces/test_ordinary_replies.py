"""Ordinary replies that a stricter rule once took for no choice, and what such a rule is for, side by side."""

import pytest

from eyechart.calls import Reply
from eyechart.spaces.discrete import DRIVING, Discrete

SPACES = {
    "highway": Discrete(
        "highway", ("LANE_LEFT", "IDLE", "LANE_RIGHT", "FASTER", "SLOWER"), (("LANE_LEFT", "LANE_RIGHT"),), (), ()
    ),
    "rover": Discrete("rover", ("LEFT", "RIGHT", "GO", "STOP", "BRAKE"), (("LEFT", "RIGHT"),), ("BRAKE",), ("GO",)),
    "ids": Discrete("ids", ("0", "1", "2", "3", "4"), (("0", "2"),), ("4",), ("1", "3")),
    "driving": DRIVING,
}


def read(space: str, text: str) -> str | None:
    """Return the action that is read in a reply."""
    return SPACES[space].read(Reply(text, "stop", None)).action


@pytest.mark.parametrize(
    ("space", "text", "action"),
    [
        ("highway", "FASTER: no vehicles ahead", "FASTER"),
        ("highway", "Action: FASTER (no vehicles ahead)", "FASTER"),
        ("highway", "I choose FASTER (no cars ahead).", "FASTER"),
        ("highway", "Action: SLOWER (two cars ahead)", "SLOWER"),
        ("highway", "SLOWER: no safe gap", "SLOWER"),
        ("highway", "SLOWER: vehicles ahead", "SLOWER"),
        ("highway", "FASTER (clear)", "FASTER"),
        ("highway", "IDLE (no vehicles)", "IDLE"),
        ("highway", '{"action":"FASTER (no vehicles ahead)"}', "FASTER"),
        ("rover", "STOP (two cars)", "STOP"),
        ("rover", "BRAKE: several cars", "BRAKE"),
        ("rover", "Action: LEFT (no cars)", "LEFT"),
        ("rover", "Action: LEFT: no cars", "LEFT"),
        ("rover", "I choose LEFT (no cars).", "LEFT"),
        ("rover", '{"action": "LEFT: no cars ahead"}', "LEFT"),
        ("rover", "LEFT: two cars", None),
        ("rover", "RIGHT: no cars", None),
        ("rover", "LEFT: free", None),
        ("highway", "LANE_LEFT: clear", None),
        ("highway", "FASTER: unknown", None),
    ],
)
def test_an_action_with_its_reason_is_not_the_state_of_a_side(space: str, text: str, action: str | None) -> None:
    """How many cars there are says how a side is only where the side stands by itself."""
    assert read(space, text) == action


OWN = """
movement motion drive driving turn steer heading ego ego_vehicle car robot rover vehicle agent lateral lane_change
trajectory path route recommendation prediction current_step action_1 control_signal high_level low_level policy data
json value content message
"""
NAMED = """
traffic_decision hazard_response obstacle_response road_action road_decision traffic_rule_action detected_action
signal_command lane_choice
"""
OTHERS = "lead front objects road perception other_vehicle obstacle traffic pedestrian"


@pytest.mark.parametrize("key", OWN.split())
def test_a_direction_in_an_object_of_the_own_is_the_answer(key: str) -> None:
    """Whether the object is the only one or not."""
    assert read("rover", f'{{"{key}": {{"direction": "LEFT"}}}}') == "LEFT"
    assert read("rover", f'{{"reason": "free", "{key}": {{"direction": "LEFT"}}}}') == "LEFT"


@pytest.mark.parametrize("key", OTHERS.split())
def test_a_direction_in_an_object_of_another_is_that_ones(key: str) -> None:
    """Also where the object is the only one."""
    assert read("rover", f'{{"{key}": {{"direction": "LEFT"}}}}') is None
    assert read("rover", f'{{"reason": "free", "{key}": {{"direction": "LEFT"}}}}') is None


def test_an_object_that_is_all_of_a_reply_holds_the_answer() -> None:
    """Whatever its key is, where it is no other's."""
    assert read("rover", '{"my_turn_now": {"direction": "LEFT"}}') == "LEFT"
    assert read("rover", '{"scene": {"direction": "LEFT"}, "plan": "wait"}') is None


@pytest.mark.parametrize(
    "key",
    NAMED.split(),
)
def test_an_object_by_the_name_of_a_decision_is_the_own(key: str) -> None:
    """Whatever it is about; an object by the name of the thing is the thing's."""
    assert read("rover", f'{{"{key}": {{"action": "LEFT"}}}}') == "LEFT"
    assert read("rover", f'{{"note": "free", "{key}": {{"action": "LEFT"}}}}') == "LEFT"
    assert read("rover", '{"traffic": {"action": "LEFT"}}') is None


@pytest.mark.parametrize(
    ("field", "seen"),
    [
        ('"reason":"The previous frame is not available, so speed is unknown."', True),
        ('"reason":"Rear camera image is missing, but front is clear"', True),
        ('"reason":"A rear camera image was not provided; the front is clear."', True),
        ('"reason":"No previous image was provided, so speed is unknown."', True),
        ('"reason":"I have not been given a second image."', True),
        ('"image":"empty"', True),
        ('"image_state":"empty"', True),
        ('"frame":"not visible"', True),
        ('"image":"not provided"', False),
        ('"image":"missing"', False),
        ('"reason":"The image is missing."', False),
        ('"reason":"The front camera image was not provided."', False),
    ],
)
def test_a_picture_besides_that_lacks_leaves_the_action(field: str, *, seen: bool) -> None:
    """What was before, or is seen to the rear, is not the picture that is asked about; an empty one may be a road."""
    action = "SLOWER" if seen else None
    assert read("highway", f'{{{field},"action":"SLOWER"}}') == action
    assert read("highway", f'{{"action":"SLOWER",{field}}}') == action


@pytest.mark.parametrize(
    ("text", "action"),
    [
        ("brake: 4", "4"),
        ("**Brake**: 4", "4"),
        ("Action - brake: 4", "4"),
        ("The answer is brake: 4", "4"),
        ("gas: 1, brake: 0", None),
        ("steer: 1, brake: 0", "1"),
        ("throttle: 1, brake: 0", None),
    ],
)
def test_a_number_behind_the_name_of_a_pedal_is_one_of_several_only_beside_another(
    text: str, action: str | None
) -> None:
    """A brake may be what a number is the action of; beside a wheel with a number of its own it is a setting."""
    assert read("ids", text) == action


@pytest.mark.parametrize(
    ("text", "action"),
    [
        ("Which way is clear? LEFT", "LEFT"),
        ("Which direction has more room? LEFT", "LEFT"),
        ("Q: Which direction is free?\nA: LEFT", "LEFT"),
        ("Which lane is open? LEFT", "LEFT"),
        ("Which direction does the robot take? LEFT", "LEFT"),
        ("Which way does the car go? LEFT", "LEFT"),
        ("Which side is the car on? LEFT", None),
        ("Which lane is the open truck in? LEFT", None),
        ("Which direction is not clear? LEFT", None),
        ("Which direction does the road bend? LEFT", None),
        ("Where is the truck? LEFT", None),
    ],
)
def test_a_question_of_where_to_go_is_answered_by_a_choice(text: str, action: str | None) -> None:
    """One of where something is, is not."""
    assert read("rover", text) == action


@pytest.mark.parametrize(
    ("text", "action"),
    [
        ("SLOW. Wait for the car ahead to clear before going STRAIGHT.", "SLOW"),
        ("STOP; wait until the lane to the LEFT is free.", "STOP"),
        ("SLOW. Wait, STOP.", "STOP"),
        ("STOP until the truck pulls out.", "STOP"),
        ("Left is out, right is out, so STOP.", "STOP"),
        ("To eliminate the risk of a collision, STOP.", "STOP"),
        ("Having ruled out LEFT and RIGHT, the best action is SLOW.", "SLOW"),
        ("I rule out LEFT and SLOW.", None),
        ("turn_left()", "LEFT"),
        ("steer(LEFT)", "LEFT"),
        ("The gap falls below 10 m. I want to go LEFT.", "LEFT"),
        ("There is a hay bale ahead. I also see a car LEFT.", None),
        ("Rain falls. A truck is also left.", None),
        ("The truck ahead makes LEFT impossible.", None),
        ("Only left turns are allowed.", None),
        ("The correct side is right.", None),
        ("How fast should I drive? SLOW", "SLOW"),
        ("brake=1, action=STOP", "STOP"),
        ("LEFT # RIGHT # STOP", None),
        ("Action: LEFT // RIGHT", None),
        ("STOP # no, SLOW", "SLOW"),
        ("The truck will stop for sure.", None),
        ("STOP for sure.", "STOP"),
        ("pedestrian.stop()", None),
        ("Should I call stop()?", None),
        ("The controller's slow() function lowers the speed.", None),
        ("One could call stop() or slow().", None),
    ],
)
def test_a_word_of_another_use_makes_no_choice_and_takes_none(text: str, action: str | None) -> None:
    """What waits, falls, is out or ruled out, is code of others or its comment."""
    assert read("driving", text) == action


@pytest.mark.parametrize(
    "text",
    ["A truck, a van and a car: that makes 3.", "The exit number points to 4.", "Slow down for the cars ahead (2)."],
)
def test_a_number_that_is_counted_or_pointed_to_is_no_choice(text: str) -> None:
    """Of cars, and of a sign."""
    assert read("ids", text) is None
