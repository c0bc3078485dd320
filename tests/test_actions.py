import json
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eyechart.actions import DRIVING, MISSING, ActionSpace, Decision, read_decision
from eyechart.errors import SpecError

READ = {
    "STOP": "STOP",
    "stop": "STOP",
    " Left. ": "LEFT",
    "**RIGHT**": "RIGHT",
    "`slow`\n": "SLOW",
    "“STRAIGHT”": "STRAIGHT",
    "STOP。": "STOP",
    "\u200bSTOP": "STOP",
    "I would go LEFT here.": "LEFT",
    "I will slow now": "SLOW",
    "STOP STOP STOP": "STOP",
    "non-stop traffic: SLOW": "SLOW",
    '{"action": "LEFT"}': "LEFT",
    '{"ACTION": "left."}': "LEFT",
    '{"answer": "the lead is near", "action": "STOP"}': "STOP",
    '{"decision": "RIGHT", "why": {"gap": [4, 5], "note": "LEFT is taken"}}': "RIGHT",
    '{"action": "STOP", "else": {"action": "LEFT"}}': "STOP",
    'I see a car.\n```json\n{"action": "SLOW"}\n```': "SLOW",
    "```\nSTOP\n```": "STOP",
    'First {"action": "LEFT"} but then {"action": "STOP"}': "STOP",
    "{'action': 'STOP', 'other': 'none'}": "STOP",
    "ACTION: LEFT": "LEFT",
    "LEFT is taken, RIGHT is free.\nACTION: RIGHT": "RIGHT",
    "STOP? SLOW? No, LEFT.\n**Action:** **straight**": "STRAIGHT",
    "Action: LEFT at first.\nOn reflection\nFinal answer: STOP.": "STOP",
    "LEFT or RIGHT?\n## Final decision\n\nSTOP": "STOP",
    "LEFT is near; the final answer is: `SLOW`": "SLOW",
    "ACTION: LEFT (the RIGHT lane is taken)": "LEFT",
    "ACTION: STOP\nRIGHT would crash.": "STOP",
    "Not LEFT.\nANSWER = STOP": "STOP",
    "<think>LEFT? RIGHT?</think>STOP": "STOP",
    "<think>a</think> STOP <think>b LEFT</think>": "STOP",
    "LEFT? RIGHT? hm</think>\n\nSLOW": "SLOW",
    "<think>a <think>LEFT</think> RIGHT</think> STOP": "STOP",
    "<THINKING>LEFT</THINKING> STOP": "STOP",
    "I can't see a car, so my action is STRAIGHT": "STRAIGHT",
    "I will not change lanes. STRAIGHT": "STRAIGHT",
}
UNPARSED = (
    "LEFT or RIGHT",
    "Slow down, then stop.",
    "ACTION: LEFT or RIGHT",
    "ACTION: STOP, SLOW, STRAIGHT, LEFT or RIGHT",
    "ACTION: <one of STOP, SLOW, STRAIGHT, LEFT, RIGHT>",
    "The action LEFT would crash, so STOP",
    "Do not turn LEFT",
    "Don't go LEFT",
    "Don’t go to the LEFT",
    "Never change to the LEFT lane",
    "Avoid LEFT",
    "anything rather than **LEFT**",
    "LEFT is not possible",
    "LEFT isn't free",
    "LEFTOVER",
    "STOPPED, UPRIGHT and STRAIGHTFORWARD",
    "It drives non-stop",
    "the right-hand lane",
    "BRIGHT",
    "42",
    "...",
    "FLY",
    "ＳＴＯＰ",
    "ACTION: RİGHT",
    '{"action": null, "seen": "LEFT"}',
    '{"action": "FLY", "seen": "LEFT"}',
    '{"action": "LEFT or RIGHT"}',
    '{"action": ["LEFT"]}',
    "DECISION: FLY",
)
REFUSED = (
    "I'm sorry, but I can't assist with that.",
    "I’m sorry, I can’t help with that right now.",
    "I cannot see the image.",
    "No image was given.",
    "I am unable to determine what is to the left of the car.",
    "I must decline.",
    "Sorry, I won't say which way is right.",
)
EMPTY = ("", " \n\t", "<think></think>", "<think>I should go LEFT", "LEFT? STOP?</think>")


@pytest.mark.parametrize("text", READ)
def test_a_stated_action_is_read(text: str) -> None:
    """Bare words, JSON, markers and conclusions give their action."""
    assert read_decision(text, "stop", None, DRIVING) == Decision(READ[text])


@pytest.mark.parametrize("text", UNPARSED)
def test_a_reply_that_states_no_single_action_is_unparsed(text: str) -> None:
    """Several candidates, a negated one, an unknown one or a part of a word are never guessed at."""
    assert read_decision(text, "stop", None, DRIVING) == Decision(None, "unparsed")


@pytest.mark.parametrize("text", REFUSED)
def test_a_refusal_is_refused_also_where_it_says_left_or_right(text: str) -> None:
    """In "I can't help with that right now" nobody orders a turn to the right."""
    assert read_decision(text, "stop", None, DRIVING) == Decision(None, "refused")


@pytest.mark.parametrize("text", EMPTY)
def test_a_reply_of_nothing_but_thought_is_empty(text: str) -> None:
    """What stands in an open or a closed think block is no answer."""
    assert read_decision(text, "stop", None, DRIVING) == Decision(None, "empty")


@pytest.mark.parametrize("text", ["", "LEFT", '{"action": "LEFT"}', "ACTION: LEFT"])
def test_the_way_a_reply_ended_comes_before_its_text(text: str) -> None:
    """A cut, filtered or failed reply holds no decision, even where an action can be read in it."""
    assert read_decision(text, "length", None, DRIVING).missing == "truncated"
    assert read_decision(text, "content_filter", None, DRIVING).missing == "refused"
    assert read_decision(text, "refusal", None, DRIVING).missing == "refused"
    assert read_decision(text, "stop", "timeout", DRIVING).missing == "error"
    assert read_decision(text, "length", "timeout", DRIVING).missing == "error"


@pytest.mark.parametrize("finish_reason", [None, "stop", "tool_calls"])
def test_an_unknown_finish_reason_does_not_hide_an_action(finish_reason: str | None) -> None:
    """Only the reasons that cut or filter a reply take its decision away."""
    assert read_decision("LEFT", finish_reason, None, DRIVING) == Decision("LEFT")


CATASTROPHES = {
    "a megabyte that ends in an answer": "the road is grey. " * 60_000 + "ACTION: SLOW",
    "unclosed thoughts": "<think>" * 15_000,
    "a fence and spaces": "x```" + " " * 99_000 + "x",
    "fences": "`" * 100_000,
    "braces": "{" * 100_000,
    "closed braces": "{}" * 50_000,
    "nested objects": '{"a":' * 20_000,
    "nested lists": "[" * 100_000,
    "nested objects in lists": ('{"a":[' + "1," * 45) * 1_100,
    "a digit string": '{"action": ' + "1" * 99_000 + "}",
    "finals": "final " * 20_000,
    "markers": "action: " * 15_000,
    "a marker and spaces": "action" + " " * 99_000 + "x",
    "negations": "not " * 25_000 + "x",
    "one action many times": "x STOP " * 15_000,
    "apologies": "i " * 50_000,
    "spaces after I": "i" + " " * 99_000 + "x",
    "quotes": "\"'`*(" * 20_000,
}


@pytest.mark.parametrize("what", CATASTROPHES)
def test_a_hostile_reply_is_read_in_bounded_time(what: str) -> None:
    """No reply makes the reader hang: each of these would, were its time quadratic in the reply's length."""
    start = time.process_time()
    decision = read_decision(CATASTROPHES[what], "stop", None, DRIVING)
    assert time.process_time() - start < 4.0
    assert decision.action == {"a megabyte that ends in an answer": "SLOW", "one action many times": "STOP"}.get(what)


@given(st.text(), st.sampled_from([None, "stop", "length", "content_filter"]))
def test_any_text_gives_an_action_or_a_reason(text: str, finish_reason: str | None) -> None:
    """The reader is total, and says the same twice."""
    decision = read_decision(text, finish_reason, None, DRIVING)
    assert decision.action in {None, *DRIVING.actions}
    assert (decision.missing in MISSING) == (decision.action is None)
    assert read_decision(text, finish_reason, None, DRIVING) == decision


@given(st.sampled_from(DRIVING.actions), st.integers(0, 2**8))
def test_upper_and_lower_case_of_a_bare_action_do_not_matter(action: str, seed: int) -> None:
    """A bare word is the action however it is written."""
    mixed = "".join(letter.lower() if seed >> at & 1 else letter for at, letter in enumerate(action))
    assert read_decision(mixed, "stop", None, DRIVING).action == action


@given(st.lists(st.sampled_from(DRIVING.actions), min_size=1, max_size=4), st.sampled_from(DRIVING.actions))
def test_the_last_marker_wins_over_every_mention(mentioned: list[str], final: str) -> None:
    """A chain of thought may mention what it likes before its marker."""
    thought = " ".join(f"I could go {action}." for action in mentioned)
    assert read_decision(f"{thought}\nACTION: {final}", "stop", None, DRIVING).action == final
    assert read_decision(thought + "\n" + json.dumps({"action": final}), "stop", None, DRIVING).action == final


def test_names_with_signs_and_words_are_read_as_wholes() -> None:
    """A longer name is not taken for the shorter one in it."""
    space = ActionSpace("craft", ("TURN", "TURN LEFT", "NO-OP", "K2"), (), ("NO-OP",), ("TURN",))
    assert read_decision("ACTION: turn left", "stop", None, space).action == "TURN LEFT"
    assert read_decision("I choose no-op.", "stop", None, space).action == "NO-OP"
    assert read_decision("so TURN", "stop", None, space).action == "TURN"
    assert read_decision("ACTION: \u212a2", "stop", None, space).missing == "unparsed"


@st.composite
def spaces(draw: st.DrawFn) -> ActionSpace:
    """Draw a legal action space."""
    names = draw(st.lists(st.from_regex(r"[A-Z]{1,6}", fullmatch=True), min_size=2, max_size=8, unique=True))
    names = [name for name in names if name != "UNPARSED"]
    pairs = draw(st.integers(0, len(names) // 2))
    mixed = draw(st.permutations(names))
    cut = draw(st.integers(0, len(names)))
    return ActionSpace(
        "drawn",
        tuple(names),
        tuple((mixed[2 * at], mixed[2 * at + 1]) for at in range(pairs)),
        tuple(mixed[:cut]),
        tuple(mixed[cut:]),
    )


@given(spaces())
def test_mirroring_twice_is_the_identity(space: ActionSpace) -> None:
    """The mirror is an involution, and moves exactly the directional actions."""
    for action in space.actions:
        assert space.mirror(space.mirror(action)) == action
        assert (space.mirror(action) != action) == (action in space.directional)


@given(spaces())
def test_an_action_space_survives_json(space: ActionSpace) -> None:
    """A bank's manifest gives back the space that it was written with."""
    assert ActionSpace.from_dict(json.loads(json.dumps(space.as_dict()))) == space


@given(spaces())
def test_braking_levels_fall_from_the_hardest_to_none(space: ActionSpace) -> None:
    """The hardest brake has the highest level, and what goes on has 0."""
    levels = [space.braking_level(action) for action in space.brake]
    assert levels == list(range(len(space.brake), 0, -1))
    assert all(space.braking_level(action) == 0 for action in space.proceed)


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
    ActionSpace("mine", **legal)  # type: ignore[arg-type]
    with pytest.raises(SpecError, match="action space 'mine'") as refused:
        ActionSpace("mine", **(legal | changed))  # type: ignore[arg-type]
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
        ActionSpace.from_dict(values)


def test_a_decision_has_exactly_one_of_action_and_reason() -> None:
    """There is no default and no substitute."""
    with pytest.raises(ValueError, match="either an action or the reason"):
        Decision(None)
    with pytest.raises(ValueError, match="either an action or the reason"):
        Decision("STOP", "refused")
    assert Decision("STOP").symbol == "STOP"
    assert {Decision(None, reason).symbol for reason in MISSING} == {"UNPARSED"}


def test_only_equal_actions_agree() -> None:
    """A mirrored action is another decision."""
    assert DRIVING.agree("LEFT", "LEFT")
    assert not DRIVING.agree("LEFT", DRIVING.mirror("LEFT"))
