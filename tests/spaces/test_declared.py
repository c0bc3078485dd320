"""Spaces of declared answers: their actions, levels, reflection and schemas, from a prompt's file."""

import json
from pathlib import Path

import pytest

import banks
from eyechart.calls import Reply
from eyechart.conditions import BATTERY
from eyechart.episodes.plans import _prompt_for
from eyechart.errors import SpecError
from eyechart.frames import Stimulus
from eyechart.manifest import asked_of
from eyechart.prompts import Prompt, read_prompt, require_sayable
from eyechart.simulators import declared_by
from eyechart.spaces.declared import AnswerSpace
from eyechart.spaces.discrete import DRIVING
from eyechart.spaces.fields import AnswerField
from eyechart.studies.battery.reach import unreachable_labels

WAYS = AnswerField("steer", key="steer", values=("left", "none", "right"), mirror_pairs=(("left", "right"),))
PEDAL = AnswerField("pedal", key="pedal", values=("full", "half", "gas"), brake=("full", "half"), proceed=("gas",))
BOTH = AnswerSpace.of("both", (WAYS, PEDAL))


MANY = "".join(
    f"[[answer.fields]]\nname = {name!r}\nkey = {name!r}\nvalues = {[f'v{n}' for n in range(50)]}\n" for name in "ab"
)


def said(text: str, finish_reason: str = "stop") -> Reply:
    """Return a reply with this text."""
    return Reply(text=text, finish_reason=finish_reason)


def prompt_of(folder: Path, text: str) -> Prompt:
    """Return the prompt of a file with this text."""
    (folder / "own.toml").write_text(text, encoding="utf-8")
    return read_prompt(folder / "own.toml")


def test_several_fields_make_one_action_of_all_their_values() -> None:
    """It brakes by the field that brakes, and turns by the field that a reflection exchanges."""
    assert len(BOTH.actions) == 9
    found = BOTH.read(said('{"steer": "Left", "pedal": "half"}'))
    assert found.action == "steer=left pedal=half"
    assert BOTH.reflect("steer=left pedal=half") == "steer=right pedal=half"
    assert [BOTH.project(f"steer=none pedal={name}", "brake") for name in PEDAL.values] == [2.0, 1.0, 0.0]
    assert [BOTH.role(f"steer=left pedal={name}") for name in PEDAL.values] == ["brake", "brake", "proceed"]
    assert BOTH.turn("steer=left pedal=half") == "steer=left"
    assert BOTH.opposite("steer=left") == "steer=right"
    assert BOTH.turns == ("steer=left", "steer=right")
    assert BOTH.brake[:3] == tuple(f"steer={way} pedal=full" for way in WAYS.values)


def test_names_by_frame_and_a_speed_are_one_action() -> None:
    """The actions of a bank are the union over its frames; a frame allows its own."""
    fields = (AnswerField("arrow", key="arrow", from_column="arrows"), PEDAL)
    bank = AnswerSpace.of("both", fields).among([{"arrows": "1, 2"}, {"arrows": "3"}])
    assert len(bank.actions) == 9
    assert bank.project("arrow=3 pedal=full", "brake") == 2.0
    reply = said('{"arrow": 3, "pedal": "full"}')
    assert bank.given({"arrows": "3"}).read(reply).action == "arrow=3 pedal=full"
    assert bank.given({"arrows": "1, 2"}).read(reply).reason == "unparsed: other_value"


def test_an_answer_without_one_field_has_none() -> None:
    """It says why; a refusal, a cut-off and silence stay what they are."""
    assert BOTH.read(said('{"steer": "left"}')).reason == "unparsed: no_answer"
    assert BOTH.read(said("I'm sorry, I can't help with that.")).reason == "refused"
    assert BOTH.read(said('{"steer": "left", "pedal": "gas"}', finish_reason="length")).reason == "truncated"
    assert BOTH.read(said(" ")).reason == "empty"
    assert BOTH.read(said('<think>{"steer": "right"}</think>{"steer": "left", "pedal": "gas"}')).action is not None


@pytest.mark.parametrize(("one", "other"), [("1234567", "1234568"), ("0.3", "0.30000001")])
def test_different_numbers_are_different_actions(one: str, other: str) -> None:
    """Alone and in a vector."""
    alone = AnswerSpace.of("v", (AnswerField("v", kind="number", key="v"),))
    pair = AnswerSpace.of("v", (AnswerField("v", kind="vector", key="v", size=2),))
    for space, form in ((alone, '{"v": %s}'), (pair, '{"v": [1, %s]}')):
        found = [space.read(said(form % number)).action for number in (one, other)]
        assert None not in found
        assert found[0] != found[1]


def test_numbers_without_ranges_and_vectors_have_no_actions_beforehand() -> None:
    """They are compared as they are, and no axis is claimed."""
    space = AnswerSpace.of(
        "v", (AnswerField("v", kind="number", key="v"), AnswerField("w", kind="vector", size=2, key="w"))
    )
    assert space.actions == ()
    found = space.read(said('{"v": -0.0, "w": [1, 2.5]}')).action
    assert found == "v=0 w=[1, 2.5]"
    assert space.project(found, "brake") is None
    assert space.reflect(found) == found
    assert space.role(found) == "other"


def test_a_bank_says_which_labels_such_answers_can_reach(tmp_path: Path) -> None:
    """Content is not excluded, and braking is."""
    prompt = prompt_of(tmp_path, 'user = "go"\n[answer]\nfields = [{name = "v", kind = "vector", size = 2}]\n')
    bank = asked_of(banks.build_bank(tmp_path / "bank", episodes=3, steps=4), prompt)
    lacking = unreachable_labels(bank, bank.frames, BATTERY)
    assert {"depth", "depth_lateral", "partial_depth"} <= {*lacking}
    assert "content" not in lacking


def test_the_schema_asks_for_the_same_fields_at_the_same_places() -> None:
    """Nested keys become nested objects."""
    fields = (
        AnswerField("v", kind="number", key="plan.v", unit="m/s"),
        AnswerField("w", kind="vector", size=2, key="plan.w"),
    )
    schema = AnswerSpace.of("v", (*fields, WAYS)).schema()
    assert schema["required"] == ["plan", "steer"]
    inner = schema["properties"]["plan"]  # type: ignore[index]
    assert inner["required"] == ["v", "w"]
    assert inner["properties"]["v"] == {"type": "number", "description": "in m/s"}
    assert inner["properties"]["w"]["minItems"] == 2
    assert schema["properties"]["steer"]["enum"] == ["left", "none", "right"]  # type: ignore[index]


def test_a_name_in_words_is_read_from_what_its_schema_asks_for() -> None:
    """The letter of an option is read from JSON too."""
    space = AnswerSpace.of("car", (AnswerField("letter", values=("A", "B", "C")),))
    assert list(space.schema()["properties"]) == ["action"]  # type: ignore[call-overload]
    assert space.read(said('{"action": "B"}')).action == space.read(said("Action: B")).action == "B"
    assert space.read(said("A car is ahead.")).action is None


def test_a_name_without_values_takes_the_actions_of_the_bank(tmp_path: Path) -> None:
    """So the prompt says where the answer stands, and the bank what it may be."""
    prompt = prompt_of(tmp_path, 'user = "{actions}?"\n[answer]\nfields = [{name = "a", key = "cmd"}]\n')
    bank = asked_of(banks.build_bank(tmp_path / "bank", scenarios=["light"], episodes=1), prompt)
    require_sayable(prompt, bank)
    space = prompt.asks(bank.manifest.action_space)
    assert space.read(said('{"cmd": "left"}')).action == "LEFT"
    assert space.read(said("LEFT")).action is None
    assert space.reflect("LEFT") == "RIGHT"
    assert [space.project(name, "brake") for name in DRIVING.actions] == [
        DRIVING.project(name, "brake") for name in DRIVING.actions
    ]
    assert prompt.query(Stimulus(), 1, space).user == "STOP, SLOW, STRAIGHT, LEFT, RIGHT?"


def test_a_prompts_key_changes_with_its_answer_alone(tmp_path: Path) -> None:
    """What a run records reads back as the same prompt."""
    text = 'user = "left, none or right?"\n'
    table = '[answer]\nfields = [{name = "a", key = "KEY", values = ["left", "none", "right"]}]\n'
    plain, one, other = (prompt_of(tmp_path, text + more) for more in ("", table, table.replace("KEY", "k")))
    assert len({plain.key, one.key, other.key}) == 3
    assert Prompt.from_dict(json.loads(json.dumps(one.as_dict()))) == one


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("[answer]\n", "one list: fields"),
        ("answer = 3\n", "one list: fields"),
        ('[answer]\nfields = [{name = "a", kind = "angle"}]\n', "kind"),
        ('[action_space]\nactions = ["x", "y"]\n[answer]\nfields = [{name = "a", values = ["x"]}]\n', "Leave"),
        ('[answer]\nfields = [{name = "a", key = "a"}, {name = "b", key = "b"}]\n', "needs values"),
        (
            MANY,
            "2500 combinations",
        ),
    ],
)
def test_a_wrong_answer_table_is_refused_with_its_file(text: str, fault: str, tmp_path: Path) -> None:
    """The error names the file and the fault."""
    with pytest.raises(SpecError, match=r"own\.toml") as refused:
        prompt_of(tmp_path, f'user = "go"\n{text}')
    assert fault in str(refused.value)


def test_a_drive_takes_only_answers_that_are_the_worlds_actions(tmp_path: Path) -> None:
    """Where the answer stands is the prompt's; what a world executes is its own."""
    world = declared_by("highway")
    assert world is not None
    prompt_of(
        tmp_path, 'user = "{actions}? LEFT RIGHT STOP SLOW STRAIGHT"\n[answer]\nfields = [{name = "a", key = "cmd"}]\n'
    )
    prompt = _prompt_for(world, str(tmp_path / "own.toml"))
    assert prompt.asks(world.action_space).read(said('{"cmd": "slow"}')).action == "SLOW"
    prompt_of(tmp_path, 'user = "go"\n[answer]\nfields = [{name = "a", kind = "vector", size = 2}]\n')
    with pytest.raises(SpecError, match="not the actions of this world; it executes STOP"):
        _prompt_for(world, str(tmp_path / "own.toml"))


def test_a_column_that_the_bank_lacks_is_refused_before_the_first_call(tmp_path: Path) -> None:
    """The error says which columns there are."""
    prompt = prompt_of(tmp_path, 'user = "go"\n[answer]\nfields = [{name = "a", from_column = "arrows"}]\n')
    bank = banks.build_bank(tmp_path / "bank", scenarios=["light"], episodes=1)
    with pytest.raises(SpecError, match="'arrows', which is not a prompt column"):
        require_sayable(prompt, asked_of(bank, prompt))


def test_ground_truth_gives_no_names_and_no_way_to_them_is_named(tmp_path: Path) -> None:
    """Nobody may be told it, so an import that would say it is no advice."""
    bank = banks.build_bank(tmp_path / "bank", scenarios=["light"], episodes=1)
    column = next(iter(bank.frames[0].truth))
    prompt = prompt_of(tmp_path, f'user = "go"\n[answer]\nfields = [{{name = "a", from_column = "{column}"}}]\n')
    with pytest.raises(SpecError, match=f"'{column}', which is ground truth, which no answer may be taken") as refused:
        require_sayable(prompt, asked_of(bank, prompt))
    assert "--prompt-columns" not in str(refused.value)


def test_one_range_alone_is_no_answer_of_a_battery(tmp_path: Path) -> None:
    """It bounds a number of a policy; here every answer would be the same action."""
    text = 'user = "go"\n[answer]\nfields = [{name = "v", kind = "number", values = ["0..30"]}]\n'
    prompt = prompt_of(tmp_path, text)
    bank = banks.build_bank(tmp_path / "bank", scenarios=["light"], episodes=1)
    with pytest.raises(
        SpecError, match=r"has one action, 'v=0\.\.30', so that every answer is the same; write further"
    ):
        require_sayable(prompt, asked_of(bank, prompt))


def test_a_name_of_a_column_is_read_in_words_and_as_an_object() -> None:
    """Without a key or a pattern the frame's names are read as named actions are."""
    space = AnswerSpace.of("view", [AnswerField("view", from_column="views")]).given({"views": "Left, Right, Ahead"})
    for text in ("Left", "Left.", '{"action": "Left"}', "**left**", "I choose: Left"):
        assert space.read(Reply(text, "stop")).action == "Left", text
    for text in ("Behind", "Left or Right", "not Left"):
        assert space.read(Reply(text, "stop")).action is None, text


def test_names_of_a_column_with_signs_of_equality_stay_apart() -> None:
    """Two different answers are two symbols."""
    fields = [AnswerField(name, key=name, from_column=name) for name in ("a", "b")]
    space = AnswerSpace.of("two", fields).given({"a": "x, x b=y", "b": "z, y b=z"})
    said = [json.dumps({"a": one, "b": other}) for one, other in (("x", "y b=z"), ("x b=y", "z"))]
    found = [space.read(Reply(text, "stop")).action for text in said]
    assert None not in found
    assert len(set(found)) == 2
