"""Scene estimates: what is read from a reply, what is repaired and counted, and what is never made up."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eyechart.calls import Reply
from eyechart.spaces.discrete import DRIVING, Discrete
from eyechart.spaces.scene import (
    CLOSE_GAP_M,
    FIELDS,
    FREE_GAP_M,
    HIGHWAY,
    REPAIRS,
    SCENES,
    SCHEMA,
    Estimate,
    SceneDecision,
)

SCENE = Estimate(22.5, close=False, left_clear=True, right_clear=False, confidence=0.9)
GOOD = str(SCENE)
GAPS = st.none() | st.floats(min_value=0.0, max_value=1000.0)
ESTIMATES = st.builds(Estimate, GAPS, st.booleans(), st.booleans(), st.booleans(), st.floats(0.0, 1.0))


def read(text: str) -> SceneDecision:
    """Read a reply that ended by itself."""
    return SCENES.read(Reply(text, "stop", None))


@given(ESTIMATES)
def test_an_estimate_reads_back_as_itself_without_a_repair(estimate: Estimate) -> None:
    """Whatever its numbers are."""
    assert read(str(estimate)) == SceneDecision(estimate)


@given(ESTIMATES)
def test_the_action_of_a_mirrored_estimate_is_the_mirrored_action(estimate: Estimate) -> None:
    """Also where close and the gap disagree; reflection undoes itself."""
    assert estimate.mirrored().act() == DRIVING.reflect(estimate.act())
    assert estimate.mirrored().mirrored() == estimate


@given(ESTIMATES)
def test_close_and_gap_are_never_played_against_caution(estimate: Estimate) -> None:
    """A close lead is never gone towards, whatever the gap; and a short gap counts, whatever close says."""
    if estimate.close or (estimate.gap_m is not None and estimate.gap_m < FREE_GAP_M):
        assert estimate.act() != "STRAIGHT"
    if estimate.gap_m is not None and estimate.gap_m < 12:
        assert estimate.act() == "STOP"


def test_a_close_lead_without_a_gap_is_a_lead_at_the_threshold() -> None:
    """It turns to the one clear side, and does not stop for a distance that nobody gave."""
    for gap_m in (None, 60.0):
        assert Estimate(gap_m, close=True, left_clear=True, right_clear=False, confidence=1).act() == "LEFT"
        assert Estimate(gap_m, close=True, left_clear=True, right_clear=False, confidence=1).disagrees()
    assert Estimate(CLOSE_GAP_M - 1, close=False, left_clear=False, right_clear=True, confidence=1).act() == "RIGHT"


REPAIRED = {
    f"```json\n{GOOD}\n```": ("code_fence",),
    f"```\n{GOOD}\n```": ("code_fence",),
    f"Here it is: {GOOD}": ("text_around",),
    f"Sure!\n```json\n{GOOD}\n```\nDrive safely.": ("code_fence", "text_around"),
    GOOD.replace("}", ",}"): ("trailing_comma",),
    f"```json\n{GOOD.replace('}', ' , }')}\n```": ("code_fence", "trailing_comma"),
    f"<think>{{not this}}</think>{GOOD}": (),
    f"{GOOD}\n{GOOD}": (),
    f"a set is {{x}}; {GOOD}": ("text_around",),
}


@pytest.mark.parametrize("text", REPAIRED)
def test_a_repair_of_syntax_is_counted_and_changes_no_content(text: str) -> None:
    """Fences, words around and trailing commas; the estimate is that of the plain text."""
    assert read(text) == SceneDecision(SCENE, repairs=REPAIRED[text])
    assert set(REPAIRED[text]) <= set(REPAIRS)


def test_a_comma_in_a_text_is_no_trailing_comma() -> None:
    """What stands between quotation marks is content."""
    text = GOOD.replace("}", ', "note": "so, }",}')
    assert read(text).action == SCENE


LONG = "word " * 21_000
"""105 000 characters, more than are read."""


@pytest.mark.parametrize("text", [LONG + GOOD, GOOD + LONG, GOOD.replace("}", ', "note": "' + LONG + '"}')])
def test_of_an_answer_that_is_too_long_no_part_is_read(text: str) -> None:
    """What was cut off could take back what was read."""
    assert read(text) == SceneDecision(None, "unparsed", "too_long")


def test_thinking_may_be_longer_than_what_is_read() -> None:
    """It is no answer; nor does an estimate in it become one where its end never came."""
    assert read(f"<think>{LONG}</think>{GOOD}") == SceneDecision(SCENE)
    assert read(f"<think>{LONG}{GOOD}") == SceneDecision(None, "empty")


def without(name: str) -> str:
    """Return the good reply without a field."""
    return json.dumps({key: value for key, value in json.loads(GOOD).items() if key != name})


def changed(**values: object) -> str:
    """Return the good reply with other values."""
    return json.dumps({**json.loads(GOOD), **values})


UNREAD = {
    "The road is free.": "no_object",
    "[1, 2]": "no_object",
    '{"lead_gap_m": 3': "malformed",
    GOOD.replace("true", "True"): "malformed",
    GOOD.replace("22.5", "NaN"): "malformed",
    "{}": "missing_field",
    **{without(name): "missing_field" for name in FIELDS},
    '{"scene": ' + GOOD + "}": "missing_field",
    changed(close="false"): "wrong_type",
    changed(left_clear=1): "wrong_type",
    changed(right_clear=None): "wrong_type",
    changed(lead_gap_m="22.5"): "wrong_type",
    changed(lead_gap_m=True): "wrong_type",
    changed(confidence=None): "wrong_type",
    changed(lead_gap_m=-1): "out_of_range",
    changed(lead_gap_m=1e6): "out_of_range",
    changed(lead_gap_m=10**400): "out_of_range",
    changed(confidence=90): "out_of_range",
    GOOD.replace("22.5", "1e999"): "out_of_range",
    GOOD.replace("}", ', "close": true}'): "contradictory",
    f"{GOOD} or {changed(close=True)}": "several_objects",
}


@pytest.mark.parametrize("text", UNREAD)
def test_what_cannot_be_read_is_unparsed_with_its_reason(text: str) -> None:
    """Nothing is filled in, converted or chosen."""
    assert read(text) == SceneDecision(None, "unparsed", UNREAD[text])


def test_a_reply_that_is_none_says_which() -> None:
    """As for an action: error, cut-off, refusal, nothing."""
    assert SCENES.read(Reply(GOOD, "stop", "timeout")).missing == "error"
    assert SCENES.read(Reply(GOOD, "length", None)).missing == "truncated"
    assert SCENES.read(Reply(GOOD, "content_filter", None)).missing == "refused"
    assert read("<think>22 m</think> ").missing == "empty"
    assert read("I’m sorry, I cannot see a road.").missing == "refused"
    assert read(f"I'm sorry, this is a guess: {GOOD}").action == SCENE


FAILED: list[dict[str, object]] = [
    {"error": "no image"},
    {"Error": {"code": 400, "message": "bad request"}},
    {"errors": [{"detail": "decoder"}]},
    {"error_message": "x"},
    {"refusal": "I would rather not."},
    {"refused": True},
    {"unable": True},
    {"failure": 3},
    {"note": "image not provided"},
    {"Note": "The image was not provided."},
    {"status": "no_image"},
    {"no_image": True},
    {"reasoning": "I could not see the picture, so this is a guess."},
    {"reasoning": "I don\u2019t have access to the attached image."},
    {"warnings": ["Image missing"]},
    {"meta": {"why": {"said": "No picture was attached"}}},
    {"comment": "Please upload the image again."},
    {"comment": "Without seeing an image I assume a free road."},
    {"image_received": False},
    {"imageVisible": "no"},
    {"can_see_image": False},
    {"image": "not provided"},
    {"image_status": "missing"},
    {"meta": {"picture_available": False}},
    {"note": "I was not given a picture."},
]


@pytest.mark.parametrize("said", FAILED, ids=str)
def test_an_answer_that_says_that_it_saw_nothing_is_no_estimate(said: dict[str, object]) -> None:
    """In a field of the object, before or behind the others, in an object beside it, or in the words around."""
    none = SceneDecision(None, "unparsed", "says_error")
    beside = json.dumps(said)
    assert read(changed(**said)) == none
    assert read(json.dumps({**said, **json.loads(GOOD)})) == none
    assert read(f"{beside}\n{GOOD}") == read(f"{GOOD}\n{beside}") == none
    assert read("No image was provided. " + GOOD) == read(GOOD + " I cannot see any image.") == none
    assert read(beside).why == "missing_field"


ORDINARY: list[dict[str, object]] = [
    {"reasoning": "I do not see any vehicle in the image, so the road is free."},
    {"explanation": "There is no lead in this picture; I cannot see beyond the frame."},
    {"notes": "Sorry, the distance is a guess: I cannot determine it exactly."},
    {"quality": "no image noise, no frame drops", "image_ok": True},
    {"image_received": True, "image_changed": False, "lead_visible": False, "frame": 0, "image": "none of note"},
    {"reasoning": "The left lane in the image is not visible."},
    {"error": None, "errors": [], "refusal": "", "refused": False, "failure": "none", "unable": {"to": None}},
    {"gap_error_m": 1.5, "error_margin": 0.5, "valid": True},
]


@pytest.mark.parametrize("said", ORDINARY, ids=str)
def test_ordinary_words_beside_an_estimate_take_nothing_from_it(said: dict[str, object]) -> None:
    """That nothing is seen in a picture is no picture that was not seen, and a failure without a value is none."""
    assert read(changed(**said)) == SceneDecision(SCENE)


@pytest.mark.parametrize("said", FAILED, ids=str)
def test_a_run_that_was_begun_under_version_3_is_read_as_it_was(said: dict[str, object]) -> None:
    """The version of the bank's actions is that of the run; each of the scene's is one of theirs, so none is lost."""
    before = SCENES.by(3)
    assert before.read(Reply(changed(**said), "stop", None)) == SceneDecision(SCENE)
    assert (before, before.reader, before.in_world(HIGHWAY).reader, SCENES.by(99)) == (SCENES, 3, 3, SCENES)
    assert set(SCENES.readers) <= set(Discrete.readers)


PIECES = st.sampled_from([*GOOD, *FIELDS, "{", "}", '"', "\\", ",", ":", "```", "true", "1e999", "<think>", "[", "]"])
WORDS = st.text(max_size=60) | st.lists(PIECES, max_size=80).map("".join) | st.just(GOOD)


@given(st.lists(WORDS, max_size=4).map("".join), st.sampled_from(["stop", None, "length", "refusal", "odd"]))
def test_whatever_comes_is_an_estimate_or_a_reason(text: str, finish_reason: str | None) -> None:
    """The reader never raises, and what it accepts reads back as itself."""
    found = SCENES.read(Reply(text, finish_reason, None))
    assert (found.action is None) == (found.missing is not None)
    if found.action is not None:
        assert read(str(found.action)).action == found.action


MONSTERS = {
    "braces": "{" * 99_999,
    "brackets": "[" * 99_999,
    "nested": '{"a":' * 5_000 + "1" + "}" * 5_000,
    "objects": "{}" * 50_000,
    "quotes": '"' * 99_999,
    "commas": '{"' + ", " * 40_000 + "}",
}


@pytest.mark.parametrize("name", MONSTERS)
def test_a_monstrous_reply_costs_little_and_holds_no_estimate(name: str) -> None:
    """Deep nesting, endless braces, quotes and commas."""
    assert read(MONSTERS[name]).action is None


def test_the_schema_is_of_the_fields_that_are_read() -> None:
    """All are required, and no other is allowed; a gap may be null."""
    assert tuple(SCHEMA["properties"]) == FIELDS  # type: ignore[arg-type]
    assert SCHEMA["required"] == list(FIELDS)
    assert tuple(json.loads(GOOD)) == FIELDS


@pytest.mark.parametrize(
    "broken",
    [
        "{'lead_gap_m': 5, 'close': True, 'left_clear': False, 'right_clear': False, 'confidence': 0.9}",
        'Correction: {"lead_gap_m": 5, "close": true, "left_clear": false',
    ],
)
@pytest.mark.parametrize("first", [True, False])
def test_a_broken_estimate_beside_a_whole_one_is_not_left_aside(broken: str, *, first: bool) -> None:
    """It may be the one that was meant, and the whole one the one that was taken back."""
    whole = '{"lead_gap_m": 50, "close": false, "left_clear": true, "right_clear": true, "confidence": 0.9}'
    text = f"{broken} }} {whole}" if first else f"{whole} {broken}"
    found = SCENES.read(Reply(text, "stop", None))
    assert (found.action, found.missing) == (None, "unparsed")


def test_true_and_one_are_two_estimates() -> None:
    """Also where both are whole objects."""
    one = '{"lead_gap_m": 50, "close": false, "left_clear": true, "right_clear": true, "confidence": 0.9}'
    assert SCENES.read(Reply(one + one.replace("false", "0"), "stop", None)).why == "several_objects"


def at_depth(frames: int, text: str) -> SceneDecision:
    """Read a reply from so many calls further down."""
    return at_depth(frames - 1, text) if frames else read(text)


def with_note(depth: int) -> str:
    """Return the good reply with a field of no meaning that is nested so deep."""
    return GOOD.replace("}", ', "note": ' + '{"a": ' * depth + "1" + "}" * depth + "}")


def test_what_is_read_depends_on_no_nesting_and_no_caller() -> None:
    """Up to 100 levels a field of no meaning is not looked into; beyond, the reply is malformed."""
    for frames in (0, 300, 600):
        assert at_depth(frames, with_note(99) + with_note(98)).action == SCENE
        for text in (with_note(100), with_note(600), with_note(600) * 2, with_note(900).replace('{"a": ', '[{"a": ')):
            assert at_depth(frames, text) == SceneDecision(None, "unparsed", "malformed")


def test_fields_of_no_meaning_may_differ_and_a_field_that_is_no_scalar_has_the_wrong_type() -> None:
    """Only the five fields are compared."""
    assert read(changed(note=1, other=[2]) + changed(note={"a": 3})).action == SCENE
    assert read(GOOD.replace("}", ', "note": {"close": true, "close": false}}')).action == SCENE
    assert read(changed(close={"a": 1}) + changed(close=[2])).why == "wrong_type"
    assert read(GOOD + changed(close=[2])).why == "several_objects"
