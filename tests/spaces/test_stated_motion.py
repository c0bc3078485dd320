"""Motions in words are read strictly: rows of the bank's shape, declared fields, and nothing filled in."""

import json

import numpy as np
import pytest

from eyechart.calls import Reply
from eyechart.errors import SpecError
from eyechart.spaces.fields import AnswerField
from eyechart.spaces.motion import Dimension, Motion, MotionSpace
from eyechart.spaces.stated_motion import StatedMotionSpace

OWN = MotionSpace("drive", (Dimension("steer", "rad"), Dimension("pan.pos")), horizon=3)
ROWS = StatedMotionSpace.of(OWN)
ONE = StatedMotionSpace.of(MotionSpace("drive", OWN.dimensions, horizon=1))
NUMBERS = [[0.1, 1], [-0.2, 2.5], [3e-2, 3]]


@pytest.mark.parametrize(
    "text",
    [
        json.dumps(NUMBERS),
        json.dumps({"motion": NUMBERS}),
        f"```json\n{json.dumps(NUMBERS)}\n```",
        f'Here it is:\n```json\n{{"motion": {json.dumps(NUMBERS)}}}\n```',
        f"<think>or {{1}}?</think>{json.dumps(NUMBERS)}",
        "[(0.1, 1), (−0.2, 2.5), (.03, 3)]",
        "{'motion': [[0.1, 1], [-0.2, 2.5], [0.03, 3]]}",
    ],
)
def test_rows_are_read_as_they_stand(text: str) -> None:
    """Alone, in an object, in a fence, behind thinking."""
    motion = ROWS.read(Reply(text, "stop")).action
    assert motion is not None
    assert np.array_equal(motion.array, NUMBERS)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (json.dumps(np.transpose(NUMBERS).tolist()), "unparsed: wrong_size"),  # as many numbers, another shape
        (json.dumps([one for row in NUMBERS for one in row]), "unparsed: wrong_size"),
        (json.dumps(NUMBERS[:2]), "unparsed: wrong_size"),
        (json.dumps(NUMBERS[0]), "unparsed: wrong_size"),
        ("[[0.1, 1], [0.2], [0.3, 3]]", "unparsed: not_a_vector"),
        ('[[0.1, "1"], [0.2, 2], [0.3, 3]]', "unparsed: not_a_vector"),
        ('{"motion": [[0.1, 1], [0.2, NaN], [0.3, 3]]}', "unparsed: not_finite"),
        ('{"motion": [[0.1, 1], [0.2, true], [0.3, 3]]}', "unparsed: not_a_vector"),
        (f'{{"motion": {NUMBERS}}} no: {{"motion": {NUMBERS[::-1]}}}', "unparsed: several_values"),
        ('{"motion": [[0.1, 1], [0.2', "unparsed: malformed"),
        ('{"action": [[0.1, 1], [0.2, 2], [0.3, 3]]}', "unparsed: no_answer"),
        ("steer left, then straight", "unparsed: no_answer"),
        ("I'm sorry, I can't help with that.", "refused"),
        ("", "empty"),
        (Motion.of(NUMBERS).text, "unparsed: not_a_vector"),
    ],
)
def test_what_is_not_the_banks_motion_is_none(text: str, reason: str) -> None:
    """Each with its reason, also where the number of numbers is right."""
    decision = ROWS.read(Reply(text, "stop"))
    assert (decision.action, decision.reason) == (None, reason)


def test_one_step_is_one_row_and_cut_or_filtered_replies_are_none() -> None:
    """Whatever their words are."""
    for text in ("[0.1, 1]", "[[0.1, 1]]", '{"motion": [0.1, 1]}'):
        found = ONE.read(Reply(text, "stop")).action
        assert found is not None
        assert found.array.tolist() == [[0.1, 1.0]]
    assert ONE.read(Reply("[0.1, 1]", "length")).missing == "truncated"
    assert ONE.read(Reply("[0.1, 1]", "content_filter")).missing == "refused"
    assert ONE.read(Reply("", error="timeout")).missing == "error"


def test_fields_are_columns_by_the_names_of_the_dimensions() -> None:
    """A vector of the steps each, in any order; units that the bank declares may follow a number."""
    columns = [AnswerField("pan_pos", "vector", key="b.pan", size=3), AnswerField("steer", "vector", key="a", size=3)]
    space = StatedMotionSpace.of(OWN, columns)
    found = space.read(Reply('{"a": [1, 2, 3], "b": {"pan": [4, 5, 6]}}', "stop")).action
    assert found is not None
    assert found.array.tolist() == [[1, 4], [2, 5], [3, 6]]
    assert space.schema()["required"] == ["b", "a"]
    numbers = [AnswerField("steer", "number", pattern=r"steer (\S+)"), AnswerField("pan_pos", "number", key="pan")]
    single = StatedMotionSpace.of(MotionSpace("drive", OWN.dimensions, horizon=1), numbers)
    found = single.read(Reply('steer 0.5rad\n{"pan": -2}', "stop")).action
    assert found is not None
    assert found.array.tolist() == [[0.5, -2.0]]


def test_a_schema_asks_for_rows_and_the_space_comes_back_from_its_prompt() -> None:
    """With its fields; another form of answers is another wording."""
    rows = ROWS.schema()["properties"]
    assert isinstance(rows, dict)
    assert rows["motion"]["minItems"] == 3
    assert rows["motion"]["items"] == {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}
    whole = StatedMotionSpace.of(OWN, [AnswerField("path", "vector", pattern=r"path: (.*)", size=6)])
    for space in (ROWS, whole):
        assert StatedMotionSpace.read_from(OWN, json.loads(json.dumps(space.written()))["stated"]) == space
    assert len({ROWS.wording(), whole.wording(), OWN.wording()}) == 3
    assert set(ROWS.apart(OWN)) == {"form of answers"}
    assert whole.read(Reply("path: [[1, 2], [3, 4], [5, 6]]", "stop")).action == Motion.of(
        np.array([[1.0, 2], [3, 4], [5, 6]])
    )


@pytest.mark.parametrize(
    ("fields", "says"),
    [
        ([AnswerField("path", "vector", size=6, width=3)], "3 steps of 2"),
        ([AnswerField("path", "vector", size=4)], "write size = 6"),
        ([AnswerField("steer", "number", key="a"), AnswerField("pan_pos", "number", key="b")], "no step is repeated"),
        ([AnswerField("steer", "vector", key="a", size=3)], "declare a field of each name"),
    ],
)
def test_fields_that_are_not_the_motion_are_refused(fields: list[AnswerField], says: str) -> None:
    """With what to write."""
    with pytest.raises(SpecError, match=says):
        StatedMotionSpace.of(OWN, fields)


def test_two_numbers_with_one_fields_name_need_a_vector() -> None:
    """One field would be read as both of them; the whole motion in one vector is read."""
    twins = MotionSpace("arm", (Dimension("arm.x"), Dimension("arm_x")), horizon=1)
    with pytest.raises(SpecError, match=r"one field's name: arm_x, arm_x, of arm.x, arm_x; .* size = 2"):
        StatedMotionSpace.of(twins, [AnswerField("arm_x", "number", key="x")])
    found = StatedMotionSpace.of(twins, [AnswerField("both", "vector", key="both", size=2)])
    action = found.read(Reply('{"both": [1, 2]}', "stop")).action
    assert action is not None
    assert action.array.tolist() == [[1.0, 2.0]]


def test_what_a_reply_lacks_is_said_in_its_words_but_a_refusal_counts_to_no_set_aside() -> None:
    """Nor does a motion."""
    assert ROWS.lacks(Reply("[[1, 2]]", "stop")) == "it is read as wrong_size: '[[1, 2]]'"
    assert ROWS.lacks(Reply("[[1,", "length")) == "it is cut off: raise --max-tokens"
    assert ROWS.lacks(Reply("I'm sorry, I can't help with that.", "stop")) == ""
    assert ROWS.lacks(Reply(json.dumps(NUMBERS), "stop")) == ""
