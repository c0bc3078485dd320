"""Kinds of replies with numbers, letters and phrases, each with its kin: what is a choice, and what looks like one.

`marks/kin.jsonl` was written beside the rules, unlike the corpus: the unit of a space, words for numbers, what is set,
forms of a verb, reasons and cases; measures, counts, other units, what others do, states, lists, plans and questions.
"""

import json

import pytest

from eyechart.calls import Reply
from eyechart.spaces.discrete import DRIVING, Discrete
from marked_replies import MARKS, SPACES, Marked

KIN = [json.loads(line) for line in (MARKS / "kin.jsonl").read_text(encoding="utf-8").splitlines()]


@pytest.mark.parametrize("space", SPACES)
def test_a_choice_is_read_in_whatever_form(space: str) -> None:
    """As a careful reader reads it."""
    kin = [(one["text"], one["action"]) for one in KIN if one["space"] == space and one["action"] is not None]
    assert [(text, action) for text, action in kin if Marked(space, text, None, None).read != action] == []


@pytest.mark.parametrize("space", SPACES)
def test_what_only_looks_like_a_choice_is_not_read(space: str) -> None:
    """A wrong action costs more than a missing one."""
    texts = [one["text"] for one in KIN if one["space"] == space and one["action"] is None]
    assert [(text, found) for text in texts if (found := Marked(space, text, None, None).read) is not None] == []


CONTRADICTIONS = (
    '{"answer": "%s", "choice": "%s"}',
    '{"action": "%s"}\nI choose %s.',
    "Action: %s\nSo I choose %s.",
    "I choose %s.\n\nAnswer: %s",
    "Action: %s\nAction: %s",
    "<answer>%s</answer><answer>%s</answer>",
    "\\boxed{%s} \\boxed{%s}",
    "I choose %s. I choose %s.",
    "%s\n%s",
)


@pytest.mark.parametrize("form", CONTRADICTIONS)
@pytest.mark.parametrize("space", ["ids", "bins", "gears", "letters", "moves", "rooms"])
def test_a_reply_that_contradicts_itself_is_no_answer(space: str, form: str) -> None:
    """In whatever forms it says the two; one that says the same twice is one."""
    one, other = SPACES[space].actions[1:3]
    assert Marked(space, form % (one, other), None, None).read is None
    assert Marked(space, form % (other, one), None, None).read is None
    assert Marked(space, form % (one, one), None, None).read == one


@pytest.mark.parametrize("text", ["I choose %s.\n\nFinal answer: %s", "First I would choose %s. Wait, no. Answer: %s"])
def test_what_was_weighed_before_contradicts_nothing(text: str) -> None:
    """What comes last as the decision counts."""
    assert Marked("letters", text % ("B", "C"), None, None).read == "C"


@pytest.mark.parametrize(
    "text", ["A truck is ahead; it is slowing.", "It is stopping.", "The lead? It's slowing down."]
)
def test_what_it_is_doing_is_said_of_a_thing(text: str) -> None:
    """Nobody can tell that the controller itself is meant."""
    assert DRIVING.read(Reply(text, "stop", None)).action is None


def test_a_unit_is_the_space_s_where_each_number_has_it() -> None:
    """Other spellings of it count then; in a space where one number has it only that number with that spelling."""
    names = ("10", "20")
    all_of_them = Discrete("all", names, (), (), (), (("10 km/h", "10"), ("20 km/h", "20")))
    one_of_them = Discrete("one", names, (), (), (), (("10 km/h", "10"),))
    for text, of_all, of_one in (
        ("10 km/h", "10", "10"),
        ("20 km/h", "20", None),
        ("10 kph", "10", None),
        ('{"speed": 20}', "20", None),
        ("20 m/s", None, None),
        ("10 km", None, None),
    ):
        assert all_of_them.read(Reply(text, "stop", None)).action == of_all
        assert one_of_them.read(Reply(text, "stop", None)).action == of_one


REPLACED = (
    "LEFT. Edit: RIGHT",
    "LEFT. Updated: RIGHT",
    "LEFT. Typo, I meant RIGHT",
    "LEFT (should be RIGHT)",
    "LEFT. Or rather RIGHT",
    "LEFT. New answer: RIGHT",
    "Action: LEFT\nEdit: RIGHT",
    '{"action": "LEFT"}\nEdit: RIGHT',
    '{"action": "LEFT"} should be RIGHT',
    '{"action": "LEFT", "correction": "RIGHT"}',
    '{"action": "LEFT", "revised_action": "RIGHT"}',
    '{"action": "LEFT", "override": "STOP"}',
    '{"action": "LEFT", "final": "RIGHT"}',
)
DENIED = (
    "(LEFT) is unsafe",
    "[LEFT] is wrong",
    "The answer is not (LEFT)",
    "not(LEFT)",
    "!LEFT",
    "\u00acLEFT",
    "LEFT=0",
    "LEFT: 0.1",
    "LEFT: 10%",
    "P(LEFT) = 0.1",
    "\u26d4 LEFT",
    "cf. LEFT",
    "vs. LEFT",
    "Fig. LEFT",
    '{"action": "LEFT", "safe": "no"}',
    '{"action": "LEFT", "approved": false}',
    '{"action": "LEFT", "executed": false}',
    '{"action": "LEFT", "veto": true}',
    '{"action": "LEFT", "not": true}',
    '{"not": {"action": "LEFT"}}',
    '{"if_clear": {"action": "LEFT"}}',
    '{"action": "LEFT", "condition": "only if the lane is clear"}',
    "SLOW for 5 seconds then STRAIGHT",
)


OTHERS = (
    '{"trucks": [{"id": 1, "action": "NAME"}]}',
    '{"pedestrian": {"action": "NAME"}}',
    '{"oncoming_car": {"action": "NAME"}}',
    '{"objects": [{"type": "car", "action": "NAME"}], "plan": "be careful"}',
    '{"road": {"direction": "NAME"}, "plan": "be careful"}',
    '{"perception": {"lead": "none", "direction": "NAME"}}',
)
BLIND = (
    '"image_received": false',
    '"imageVisible": false',
    '"can_see_image": "no"',
    '"has_picture": false',
    '"image": "not provided"',
    '"image_status": "missing"',
    '"reason": "No image was provided."',
    '"note": "I was not given an image."',
    '"meta": {"image_available": false}',
)
SEEING = (
    '"image_received": true',
    '"image_quality": "poor"',
    '"frame": 0',
    '"image_changed": false',
    '"lead_visible": false',
    '"reason": "No vehicle is visible in the image."',
    '"image": "none of the lanes is blocked"',
)


@pytest.mark.parametrize(("space", "name"), [("letters", "B"), ("ids", "2"), ("moves", "STOP"), (None, "LEFT")])
def test_what_an_object_of_another_thing_holds_is_that_things(space: str | None, name: str) -> None:
    """Its action, and its direction; one of the controller's own is read beside it."""
    asked = DRIVING if space is None else SPACES[space]
    other = asked.actions[0]
    for text in OTHERS:
        said = text.replace("NAME", name)
        assert asked.read(Reply(said, "stop", None)).action is None, said
        own = f'{{"scene": {said}, "plan": {{"action": "{other}"}}}}'
        assert asked.read(Reply(own, "stop", None)).action == other, own


@pytest.mark.parametrize(("space", "name"), [("letters", "B"), ("ids", "2"), ("moves", "STOP"), (None, "LEFT")])
def test_an_action_beside_a_field_that_says_there_was_no_picture_is_none(space: str | None, name: str) -> None:
    """Wherever the field stands; that no lead is seen in a picture is no such thing."""
    asked = DRIVING if space is None else SPACES[space]
    for fields, action in ((BLIND, None), (SEEING, name)):
        for field in fields:
            for text in (f'{{"action": "{name}", {field}}}', f'{{{field}, "action": "{name}"}}'):
                assert asked.read(Reply(text, "stop", None)).action == action, text


@pytest.mark.parametrize(
    ("space", "text"),
    [
        ("bins", "-(1)"),
        ("bins", '-"1"'),
        ("bins", "-\\boxed{1}"),
        ("bins", "Answer: -[1]"),
        ("bins", "Answer: minus (1)"),
        ("bins", "+/-1"),
        ("bins", "1,-1"),
        ("bins", "1/-1"),
        ("bins", "(0.5, 1)"),
        ("ids", "7, 2"),
        ("ids", "Action: (7, 2)"),
        ("bins", "steer(1, 0)"),
        ("bins", "steer=1 brake=0"),
        ("bins", "Brake: 0"),
        ("bins", "x: -1"),
        ("gears", "Speed (km/h): 1"),
        ("gears", '{"speed": 1, "unit": "km/h"}'),
        ("gears", '{"speed_kmh": 1}'),
        ("degrees", '{"angle": 15, "unit": "rad"}'),
    ],
)
def test_a_number_of_another_sign_list_control_or_unit_is_no_action(space: str, text: str) -> None:
    """Also where something parts the sign from it, or its unit stands in another field."""
    assert Marked(space, text, None, None).read is None


@pytest.mark.parametrize(
    ("space", "text", "action"),
    [
        ("letters", "B) slow down because the lane is blocked", "B"),
        ("letters", "(B) turn left since the right side is closed", "B"),
        ("letters", "Press B.", "B"),
        ("bins", "(1)", "1"),
        ("bins", "Answer: - 1, 0.9", None),
        ("gears", "Speed (m/s): 1", "1"),
        ("gears", '{"speed": 1, "unit": "m/s"}', "1"),
        ("gears", '{"speed_mps": 1}', "1"),
        ("degrees", '{"angle": 15, "unit": "degrees"}', "15"),
        (None, "Which side is the car on? LEFT.", None),
        (None, "Where is the truck? LEFT", None),
        (None, "Which side is safest? LEFT.", "LEFT"),
        (None, "What should the car do? LEFT.", "LEFT"),
        (None, "RIGHT: two cars", None),
        (None, "RIGHT turn ahead", None),
        (None, '{"action": "LEFT", "speed_action": "SLOW"}', None),
    ],
)
def test_reasons_and_questions_are_told_from_choices(space: str | None, text: str, action: str | None) -> None:
    """What is said of a thing in the picture is no choice, and a reason takes no choice away."""
    asked = DRIVING if space is None else SPACES[space]
    assert asked.read(Reply(text, "stop", None)).action == action


HARMS = (
    "NAME would hit the car ahead.",
    "Option NAME would hit the car ahead.",
    "NAME: it would crash.",
    "NAME: this hits the car ahead.",
    "NAME - that would be dangerous.",
    "NAME) it would hit the car.",
    "NAME, which would hit the car.",
)


@pytest.mark.parametrize("text", HARMS)
@pytest.mark.parametrize(("space", "name"), [("letters", "B"), ("ids", "2"), ("moves", "TURN LEFT"), (None, "LEFT")])
def test_what_would_do_harm_is_no_choice(space: str | None, name: str, text: str) -> None:
    """Whether a sentence of its own says so, behind a colon or after the name; and what is chosen then is read."""
    asked = DRIVING if space is None else SPACES[space]
    other = next(one for one in asked.actions if one != name)
    for said, action in ((text, None), (f"{text} So {other}.", other)):
        assert asked.read(Reply(said.replace("NAME", name), "stop", None)).action in {None, action}


@pytest.mark.parametrize(
    "text",
    [
        "STOP. We would hit the car otherwise.",
        "STOP. We would hit the car.",
        "STOP: we might crash into the lead vehicle.",
        "STOP. It might crash into us.",
        "STOP. It hits the brakes.",
        "STOP: it could hit the car ahead.",
        "STOP, hitting the brakes hard.",
        "STOP: otherwise we would hit the car.",
        "STOP. If we continue, we would hit the car.",
        "STOP, because we would hit the car.",
        "STOP to avoid hitting the car.",
        "STOP. It would be dangerous to go on.",
        "STOP. The car ahead could hit us.",
        "LEFT would hit the truck, so STOP.",
        "LEFT: it would hit the truck. STOP.",
    ],
)
def test_the_harm_of_what_is_not_done_is_a_reason(text: str) -> None:
    """Otherwise, if, or of another action."""
    assert DRIVING.read(Reply(text, "stop", None)).action == "STOP"


@pytest.mark.parametrize("text", REPLACED)
def test_an_action_that_is_replaced_by_another_is_not_read(text: str) -> None:
    """Whatever word says that the second is meant; rather none of the two than the wrong one."""
    assert DRIVING.read(Reply(text, "stop", None)).action != "LEFT"


@pytest.mark.parametrize("text", DENIED)
def test_an_action_in_brackets_or_with_a_sign_is_denied_as_any_other(text: str) -> None:
    """Also where a program, a table or a flag of JSON denies it."""
    assert DRIVING.read(Reply(text, "stop", None)).action is None


@pytest.mark.parametrize(
    ("text", "action"),
    [
        ("(LEFT) is best", "LEFT"),
        ("LEFT!", "LEFT"),
        ("The lead is near (STOP)", "STOP"),
        ("STOP: turning is not safe", "STOP"),
        ('{"action": "LEFT", "condition": "sunny"}', "LEFT"),
        ('{"action": "LEFT", "blocked": false, "safe": true}', "LEFT"),
        ("slow to the max.\nLEFT", "LEFT"),
    ],
)
def test_what_looks_like_a_denial_and_is_none_is_read(text: str, action: str) -> None:
    """The rules above take no more than they have to."""
    assert DRIVING.read(Reply(text, "stop", None)).action == action
