"""The reader of replies: what a careful human reads, nothing guessed, in bounded time."""

import json
import re
import time
import unicodedata

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eyechart.calls import Reply
from eyechart.spaces.discrete import DRIVING, Discrete
from eyechart.spaces.space import MISSING, Decision
from replies import EMPTY, READ, REFUSED, UNPARSED


@pytest.mark.parametrize("text", READ)
def test_a_stated_action_is_read(text: str) -> None:
    """Bare words, JSON, markers and conclusions give their action."""
    assert DRIVING.read(Reply(text, "stop", None)) == Decision(READ[text])


@pytest.mark.parametrize("text", UNPARSED)
def test_a_reply_that_states_no_single_action_is_unparsed(text: str) -> None:
    """Several candidates, a negated one, an unknown one or a part of a word are never guessed at."""
    assert DRIVING.read(Reply(text, "stop", None)) == Decision(None, "unparsed", UNPARSED[text])


@pytest.mark.parametrize("text", REFUSED)
def test_a_refusal_is_refused_also_where_it_says_left_or_right(text: str) -> None:
    """In "I can't help with that right now" nobody orders a turn to the right."""
    assert DRIVING.read(Reply(text, "stop", None)) == Decision(None, "refused")


@pytest.mark.parametrize("text", EMPTY)
def test_a_reply_of_nothing_but_thought_is_empty(text: str) -> None:
    """What stands in an open or a closed think block is no answer."""
    assert DRIVING.read(Reply(text, "stop", None)) == Decision(None, "empty")


@pytest.mark.parametrize("text", ["", "LEFT", '{"action": "LEFT"}', "ACTION: LEFT"])
def test_the_way_a_reply_ended_comes_before_its_text(text: str) -> None:
    """A cut, filtered or failed reply holds no decision, even where an action can be read in it."""
    assert DRIVING.read(Reply(text, "length", None)).missing == "truncated"
    assert DRIVING.read(Reply(text, "content_filter", None)).missing == "refused"
    assert DRIVING.read(Reply(text, "refusal", None)).missing == "refused"
    assert DRIVING.read(Reply(text, "stop", "timeout")).missing == "error"
    assert DRIVING.read(Reply(text, "length", "timeout")).missing == "error"


@pytest.mark.parametrize("finish_reason", [None, "stop", "tool_calls"])
def test_an_unknown_finish_reason_does_not_hide_an_action(finish_reason: str | None) -> None:
    """Only the reasons that cut or filter a reply take its decision away."""
    assert DRIVING.read(Reply("LEFT", finish_reason, None)) == Decision("LEFT")


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
    "two actions in turns": "LEFT RIGHT " * 9_000,
    "a list without end": "LEFT, " * 16_000,
    "choices": "so STOP. " * 11_000,
    "conditions": "if so, then " * 8_000 + "STOP",
    "denials around": "not STOP is not " * 6_000,
    "labels": "action: STOP\n" * 7_000,
    "headings": "action\n" * 14_000,
    "answers in tags": "<answer>STOP</answer>" * 4_000,
    "open tags": "<answer>" * 12_000,
    "open thoughts of another kind": "<reasoning>" * 9_000 + "◁think▷" * 100,
    "channels": "<|channel|>analysis" * 5_000,
    "boxes": "\\boxed{" * 12_000,
    "boxes in boxes": "\\boxed{{STOP}" * 7_000,
    "keys without an end": '{"action": ' * 9_000,
    "objects that state": '{"action": "STOP"} ' * 900 + '{"action": "LEFT"}',
    "actions and thoughts in turns": "{" + '"action": "STOP", "why": "so LEFT is fine, but", ' * 2_000 + '"a": 1}',
    "struck out": "~~STOP" * 15_000,
    "rows": "| STOP |\n" * 10_000,
    "one letter at a time": "S T O P " * 12_000,
    "a name in pieces": "S-" * 49_000,
    "brackets": "(" * 50_000 + "STOP" + ")" * 49_000,
    "apologies": "i " * 50_000,
    "spaces after I": "i" + " " * 99_000 + "x",
    "quotes": "\"'`*(" * 20_000,
}


STATED = {
    "a megabyte that ends in an answer": "SLOW",
    "a list without end": "LEFT",
    **dict.fromkeys(["choices", "labels", "answers in tags", "boxes in boxes", "struck out", "brackets"], "STOP"),
    "actions and thoughts in turns": "STOP",
}
"""Those in which somebody chooses an action all the same."""


@pytest.mark.parametrize("what", CATASTROPHES)
def test_a_hostile_reply_is_read_in_bounded_time(what: str) -> None:
    """No reply makes the reader hang: each of these would, were its time quadratic in the reply's length."""
    start = time.process_time()
    decision = DRIVING.read(Reply(CATASTROPHES[what], "stop", None))
    assert time.process_time() - start < 4.0
    assert decision.action == STATED.get(what)


REPEATED = {
    "calls": "steer(1) ",
    "assignments": "action=1 ",
    "what is returned": "return 1\n",
    "frames of Chinese": "我选择1,",
    "frames of Japanese": "1にします。",
    "frames of German": "ich wähle 1, ",
    "lines": "Action: 1\n",
    "objects": '{"a":1} ',
    "quotes": '"1" ',
    "brackets": "(1",
    "closed brackets": "1) ",
    "denials": "not 1 ",
    "hedges": "maybe 1, ",
    "sentences": "I choose 1. ",
    "number words": "two. ",
    "letters": "B ",
    "blank lines": "\n",
    "columns": " \t",
}
BINS = Discrete("bins", ("-2", "-1", "0", "1", "2", "B"), (("-2", "2"), ("-1", "1")), (), ())


@pytest.mark.parametrize("what", REPEATED)
def test_what_is_repeated_is_read_in_linear_time(what: str) -> None:
    """Eight times as much takes at most sixteen times as long; in quadratic time it would take sixty-four."""
    times = []
    for length in (12_000, 96_000):
        reply = Reply(f"Two. {REPEATED[what] * (length // len(REPEATED[what]))}x", "stop", None)
        start = time.process_time()
        BINS.read(reply)
        times.append(time.process_time() - start)
    assert times[1] < 16 * times[0] + 0.2


def test_what_stands_in_long_thinking_is_no_answer() -> None:
    """However far back it was opened; and what follows it is read."""
    thought = "<think>" + "the road is grey. " * 10_000 + "ACTION: LEFT"
    assert DRIVING.read(Reply(thought, "stop", None)) == Decision(None, "empty")
    assert DRIVING.read(Reply(f"{thought}</think> ACTION: SLOW", "stop", None)) == Decision("SLOW")


@given(st.text(), st.sampled_from([None, "stop", "length", "content_filter"]))
def test_any_text_gives_an_action_or_a_reason(text: str, finish_reason: str | None) -> None:
    """The reader is total, and says the same twice."""
    decision = DRIVING.read(Reply(text, finish_reason, None))
    assert decision.action in {None, *DRIVING.actions}
    assert (decision.missing in MISSING) == (decision.action is None)
    assert DRIVING.read(Reply(text, finish_reason, None)) == decision


FRAGMENTS = st.one_of(
    st.sampled_from([*DRIVING.actions, *(action.lower() for action in DRIVING.actions)]),
    st.sampled_from(
        ['{"action": "', '"}', "{", "}", "```json\n", "```", "ACTION: ", "final answer is ", "<think>", "</think>"]
    ),
    st.sampled_from(
        ["not ", "never ", "n't ", "I can't see ", " or ", "/", "-", "_", ".", "\n", " ", "'", "\u200b", "\u0130"]
    ),
    st.text(max_size=6),
)


@given(st.lists(FRAGMENTS, max_size=12).map("".join), st.sampled_from([None, "stop", "tool_calls"]))
def test_no_action_is_read_that_the_text_does_not_hold(text: str, finish_reason: str | None) -> None:
    """Whatever a model writes, the reader never raises and never brings an action of its own."""
    decision = DRIVING.read(Reply(text, finish_reason, None))
    plain = re.sub(r"[\W_]", "", unicodedata.normalize("NFKC", text).upper())
    assert decision.action is None or decision.action in plain


@given(st.sampled_from(DRIVING.actions), st.integers(0, 2**8))
def test_upper_and_lower_case_of_a_bare_action_do_not_matter(action: str, seed: int) -> None:
    """A bare word is the action however it is written."""
    mixed = "".join(letter.lower() if seed >> at & 1 else letter for at, letter in enumerate(action))
    assert DRIVING.read(Reply(mixed, "stop", None)).action == action


@given(st.lists(st.sampled_from(DRIVING.actions), min_size=1, max_size=4), st.sampled_from(DRIVING.actions))
def test_the_last_marker_wins_over_every_mention(mentioned: list[str], final: str) -> None:
    """A chain of thought may mention what it likes before its marker."""
    thought = " ".join(f"I could go {action}." for action in mentioned)
    assert DRIVING.read(Reply(f"{thought}\nACTION: {final}", "stop", None)).action == final
    assert DRIVING.read(Reply(thought + "\n" + json.dumps({"action": final}), "stop", None)).action == final


def test_names_with_signs_and_words_are_read_as_wholes() -> None:
    """A longer name is not taken for the shorter one in it."""
    space = Discrete("craft", ("TURN", "TURN LEFT", "NO-OP", "K2"), (), ("NO-OP",), ("TURN",))
    assert space.read(Reply("ACTION: turn left", "stop", None)).action == "TURN LEFT"
    assert space.read(Reply("I choose no-op.", "stop", None)).action == "NO-OP"
    assert space.read(Reply("so TURN", "stop", None)).action == "TURN"
    assert space.read(Reply("ACTION: \u212a2", "stop", None)).missing == "unparsed"


@pytest.mark.parametrize("names", [("AVOID", "FOLLOW"), ("LANE 2", "LANE 1")])
def test_an_action_is_no_heading_over_the_next_one(names: tuple[str, str]) -> None:
    """Though its name is a word that denies, or a thing: two actions below each other are no choice."""
    space = Discrete("headings", names, (), (), ())
    for text in ("\n".join(names), "\n\n".join(names)):
        assert space.read(Reply(text, "stop", None)).missing == "unparsed"
    assert space.read(Reply(names[0], "stop", None)).action == names[0]


def at_depth(frames: int, text: str) -> Decision[str]:
    """Read a decision from so many calls further down."""
    return at_depth(frames - 1, text) if frames else DRIVING.read(Reply(text, "stop", None))


def test_what_is_read_of_an_object_depends_on_no_caller() -> None:
    """Nor on what the parser bears: an object nested in more than 100 levels is text, wherever it is read."""
    for levels, action in ((99, None), (100, "LEFT"), (400, "LEFT")):
        stated = '{"action": ["none"], "note": ' + "[" * levels + "]" * levels + "} LEFT"
        assert {at_depth(frames, stated).action for frames in (0, 300, 600)} == {action}
