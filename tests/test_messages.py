"""Prompts with messages: what a model is sent is what was written, in order, and runs keep all of it."""

import asyncio
import base64
import json
import os
import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from aiohttp import web

import banks
from eyechart import inspect
from eyechart.bundle import validate, write_bundle
from eyechart.calls import Emptiness, Query, Reply
from eyechart.costs import ASSUMED_IN, assumed
from eyechart.errors import LedgerError, SpecError
from eyechart.frames import Camera, FrameBank, Stimulus, encode
from eyechart.messages import MOST_EXAMPLE_BYTES, PromptMessage, PromptPicture, Role
from eyechart.models import open_model
from eyechart.models.huggingface.checkpoint import conversation as chat
from eyechart.models.python_callable import hold
from eyechart.modes import RequestMode
from eyechart.prompts import PROMPTS, Prompt, read_prompt, require_pictured
from eyechart.spaces.discrete import DRIVING
from eyechart.studies import battery
from eyechart.studies.battery.plans import BatterySettings
from faults import FaultServer, Loopback, completion
from ollama_stand_in import StandIn as Ollama

Asked = dict[str, object]
NEAR, FAR, FRONT, LEFT, RIGHT, BEFORE = (
    encode(np.full((8, 8, 3), shade, dtype=np.uint8)) for shade in (10, 50, 90, 130, 170, 210)
)
RIG = Stimulus({"front": FRONT, "left": LEFT, "right": RIGHT}, {"speed": 3})
FEW_SHOT = """
[[messages]]
role = "system"
text = "You drive. You answer with one of: {actions}."

[[messages]]
role = "user"
text = "What do you do?"
pictures = ["near.png"]

[[messages]]
role = "assistant"
text = "Response to user:#### STOP"

[[messages]]
role = "user"
text = "What do you do?"
pictures = ["far.png"]

[[messages]]
role = "assistant"
text = "Response to user:#### STRAIGHT"

[[messages]]
role = "user"
text = "What do you do now? STOP, SLOW, STRAIGHT, LEFT or RIGHT."
"""


def written(folder: Path, text: str, name: str = "ask") -> Prompt:
    """Return a prompt from a file, with two example pictures beside it."""
    folder.mkdir(exist_ok=True)
    (folder / "near.png").write_bytes(NEAR)
    (folder / "far.png").write_bytes(FAR)
    (folder / f"{name}.toml").write_text(text, encoding="utf-8")
    return read_prompt(folder / f"{name}.toml")


def user(text: str, *pictures: str) -> str:
    """Return a prompt's file with one message of the user."""
    return f"[[messages]]\nrole = 'user'\ntext = '''{text}'''\npictures = {list(pictures)}\n"


async def _once(query: Query, mode: RequestMode) -> Reply:
    model = open_model(mode.spec, mode)
    try:
        return await model.answer(query)
    finally:
        await model.close()


def sent(query: Query, **fields: object) -> list[Asked]:
    """Return the messages that a server of chat completions gets for a query."""
    with FaultServer() as server:
        mode = RequestMode("openai:m", base_url=server.base_url, **fields)  # type: ignore[arg-type]
        assert asyncio.run(_once(query, mode)).error is None
    return server.asked[0]["messages"]  # type: ignore[return-value]


def picture(image: bytes) -> Asked:
    """Return a picture as the API has it."""
    url = f"data:image/png;base64,{base64.b64encode(image).decode()}"
    return {"type": "image_url", "image_url": {"url": url}}


def words(text: str) -> Asked:
    """Return words as the API has them."""
    return {"type": "text", "text": text}


def test_few_shot_turns_arrive_as_they_are_written(tmp_path: Path) -> None:
    """Pairs of messages with pictures of their own, and the frame's picture in the last, as DiLu asks."""
    query = written(tmp_path, FEW_SHOT).query(Stimulus.of(FRONT), 1, DRIVING)
    assert sent(query) == [
        {"role": "system", "content": "You drive. You answer with one of: STOP, SLOW, STRAIGHT, LEFT, RIGHT."},
        {"role": "user", "content": [picture(NEAR), words("What do you do?")]},
        {"role": "assistant", "content": "Response to user:#### STOP"},
        {"role": "user", "content": [picture(FAR), words("What do you do?")]},
        {"role": "assistant", "content": "Response to user:#### STRAIGHT"},
        {"role": "user", "content": [picture(FRONT), words(query.user)]},
    ]
    assert (query.system, query.user) == (
        "You drive. You answer with one of: STOP, SLOW, STRAIGHT, LEFT, RIGHT.",
        "What do you do now? STOP, SLOW, STRAIGHT, LEFT or RIGHT.",
    )
    assert query.pictures == (NEAR, FAR, FRONT)
    folded = sent(query, system="user")
    assert folded[0] == {"role": "user", "content": [picture(NEAR), words(f"{query.system}\n\nWhat do you do?")]}
    assert folded[1:] == sent(query)[2:]


def test_pictures_stand_where_the_words_place_them(tmp_path: Path) -> None:
    """Three cameras between their names, in another order than the bank's; a field and a literal brace beside them."""
    text = "Left: {picture:left} Front, at {speed}: {picture:front}{{picture:front}}\nRight: {picture:right} Go?"
    said = [words("Left: "), picture(LEFT), words(" Front, at 3: "), picture(FRONT)]
    said += [words("{picture:front}\nRight: "), picture(RIGHT), words(" Go?")]
    for form in (user(text), f"user = '''{text}'''\n"):
        prompt = written(tmp_path, form)
        assert prompt.fields == ("speed",)
        assert sent(prompt.query(RIG, 1)) == [{"role": "user", "content": said}]


def test_pictures_that_no_words_place_come_before_the_last_words(tmp_path: Path) -> None:
    """Nothing that a condition shows is lost; of the message's examples too."""
    prompt = written(tmp_path, user("See {picture:far.png} and {picture:left}.", "near.png", "far.png"))
    (message,) = sent(prompt.query(RIG, 1))
    shown = [picture(NEAR), picture(FRONT), picture(RIGHT)]
    assert message["content"] == [*shown, words("See "), picture(FAR), words(" and "), picture(LEFT), words(".")]


def test_a_picture_of_an_earlier_instant_stands_in_its_turn(tmp_path: Path) -> None:
    """The history of a navigator: the instant before with its answer, then this one."""
    seen = Stimulus({"main": FRONT}, past=(Stimulus({"main": BEFORE}), Stimulus({"main": LEFT})))
    history = "[[messages]]\nrole = 'user'\ntext = 'Then: {picture:main@-2} {picture:main@-1}'\n"
    history += "[[messages]]\nrole = 'assistant'\ntext = 'GO'\n"
    prompt = written(tmp_path, history + user("Now?"))
    assert sent(prompt.query(seen, 1)) == [
        {"role": "user", "content": [words("Then: "), picture(BEFORE), words(" "), picture(LEFT)]},
        {"role": "assistant", "content": "GO"},
        {"role": "user", "content": [picture(FRONT), words("Now?")]},
    ]
    require_pictured(prompt, seen)
    assert (prompt.history, PROMPTS["baseline"].history) == (2, 0)
    with pytest.raises(
        SpecError, match=r"places \{picture:main@-2\}.*2 instants before.*there are \{picture:main\}.*--history 2"
    ):
        require_pictured(prompt, replace(seen, past=seen.past[1:]))


def test_a_condition_without_a_picture_drops_its_place(tmp_path: Path) -> None:
    """The words stay, and the examples: these belong to the prompt."""
    prompt = written(tmp_path, user("Front: {picture:front} Go?", "near.png"))
    (message,) = sent(prompt.query(Stimulus(), 1))
    assert message["content"] == [picture(NEAR), words("Front:  Go?")]
    assert sent(written(tmp_path, user("{picture:front}")).query(Stimulus(), 1))[0]["content"] == [words("")]


def test_old_prompts_keep_their_keys_requests_and_records(tmp_path: Path) -> None:
    """A prompt of two messages without a place is what it was, to the byte."""
    text = 'system = "One of: {actions}."\nuser = "At {speed}, {{speed}}. {\\"a\\": 1}, {picture}."\n'
    prompt = written(tmp_path, text, "rover-1")
    assert PROMPTS["baseline"].key == "baseline@4c0af29c"
    assert prompt.key == "rover-1@e07bc21f"
    seen = Stimulus({"front": b"a", "rear": b"b"}, {"speed": 3, "picture": "x"}, {"joints": (1.0, 2.0)})
    assert prompt.query(seen, 7, DRIVING).sha256() == "4ba28a7306cf8dc5d4156f49ce6e307190c1b2c8a42952f226c549da2bdd4c79"
    assert list(prompt.as_dict()) == ["name", "system", "user", "template", "key"]


def test_a_prompts_key_and_request_change_with_any_message(tmp_path: Path) -> None:
    """A role, a word, a place, an example's name or its bytes; the record gives the same prompt back."""
    prompt = written(tmp_path, FEW_SHOT)
    assert Prompt.from_dict(json.loads(json.dumps(prompt.as_dict()))) == prompt
    others = [written(tmp_path, FEW_SHOT.replace(*change)) for change in CHANGES]
    (tmp_path / "near.png").write_bytes(FAR)
    others.append(read_prompt(tmp_path / "ask.toml"))
    assert len({one.key for one in (prompt, *others)}) == len(CHANGES) + 2
    digests = {one.query(RIG, 1, DRIVING).sha256() for one in (prompt, *others)}
    assert len(digests) == len(CHANGES) + 2
    broken = prompt.as_dict()
    broken["messages"] = others[0].as_dict()["messages"]
    with pytest.raises(SpecError, match="has key"):
        Prompt.from_dict(broken)


CHANGES = (
    ("What do you do now?", "What do you do now? {picture:front}"),
    ("#### STRAIGHT", "#### SLOW"),
    ('["far.png"]', '["near.png"]'),
    ('role = "assistant"', 'role = "user"'),
)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (f"user = 'Go?'\n{user('Go?')}", r"\[\[messages\]\] take the place of system and user"),
        ("messages = []", "messages must be 1 to 200 tables"),
        ("[[messages]]\nrole = 'assistant'\ntext = 'GO'", "the last message must be the user's, not the assistant's"),
        (user("A") + "[[messages]]\nrole = 'system'\ntext = 'B'\n" + user("C"), "message 2: only the first message"),
        ("[[messages]]\nrole = 'robot'\ntext = 'A'", "message 1: it needs a role"),
        ("[[messages]]\nrole = 'user'\ntext = 'A'\nimage = 'a.png'", "message 1: it has no 'image'; it has role"),
        (
            "[[messages]]\nrole = 'system'\ntext = '{picture:front}'\n" + user("A"),
            "only a message of the user may hold",
        ),
        (user(" "), "neither text nor pictures"),
        (user("A", "gone.png"), "picture 'gone.png' cannot be read"),
        (user("A", "../other.png"), "picture '../other.png' is no file in the prompt's folder"),
        (user("A", "link.png"), "picture 'link.png' is no file in the prompt's folder"),
        (user("A", "near.png", "near.png"), "a picture is named twice"),
        (user("A", "ask.toml"), "picture 'ask.toml': .*no picture"),
        (user("A", "large.png"), f"more than {MOST_EXAMPLE_BYTES} bytes"),
        (user("A {picture:front@1}"), r"\{picture:front@1\} is no place of a picture: write \{picture:CAMERA\}"),
        ("user = 'A {picture:}'", r"ask.toml: \{picture:\} is no place"),
    ],
)
def test_a_fault_in_a_file_is_named(tmp_path: Path, text: str, says: str) -> None:
    """Each with the file, the message and what to do."""
    (tmp_path / "other.png").write_bytes(NEAR)
    (folder := tmp_path / "prompt").mkdir()
    (folder / "link.png").symlink_to(tmp_path / "other.png")
    (folder / "large.png").write_bytes(NEAR)
    os.truncate(folder / "large.png", MOST_EXAMPLE_BYTES + 1)
    with pytest.raises(SpecError, match=says) as refused:
        written(folder, text)
    assert "ask.toml" in str(refused.value)


@pytest.mark.parametrize("role", ["assistant", "system"])
def test_a_message_that_is_made_by_hand_holds_no_picture_of_another_role(role: Role) -> None:
    """No service takes one, and some leave it out in silence."""
    for text, pictures in (("{picture:front}", ()), ("STOP", (PromptPicture("near.png", NEAR),))):
        with pytest.raises(SpecError, match="only a message of the user may hold pictures"):
            PromptMessage(role, text, pictures)
    assert PromptMessage(role, "STOP").texts == ("STOP",)


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of three cameras."""
    cameras = (Camera("front"), Camera("left"), Camera("right"))
    return banks.build_rig(tmp_path_factory.mktemp("rig") / "bank", cameras=cameras, frames=4)


def test_an_unknown_camera_is_refused_before_any_call(rig: FrameBank, tmp_path: Path) -> None:
    """The error lists what there is."""
    for place, lacks in (("lft", "such a camera or example"), ("left@-1", "1 instant before a frame")):
        written(tmp_path, user(f"STOP SLOW STRAIGHT LEFT RIGHT {{picture:{place}}}"))
        with pytest.raises(SpecError, match=lacks) as refused:
            battery.plan(rig.root, ["scripted:constant"], tmp_path / "run", prompt=str(tmp_path / "ask.toml"))
        assert "there are {picture:front}, {picture:left}, {picture:right}" in str(refused.value)
    assert not (tmp_path / "run").exists()


def test_a_run_keeps_its_examples(rig: FrameBank, tmp_path: Path) -> None:
    """It resumes and is bundled without the prompt's file, and every request is what was written."""
    prompt = written(tmp_path / "prompt", FEW_SHOT.replace("do now?", "do now? {picture:right} and {picture:left}"))

    def made(server: FaultServer, limit: int, file: Path | None) -> None:
        mode = RequestMode("openai:m", base_url=server.base_url, timeout_s=20.0)
        extent, conditions = battery.BatterySelection(limit), ("real", "real_repeat", "text_only")
        name = None if file is None else str(file)
        planned = battery.plan(rig.root, [mode], tmp_path / "run", prompt=name, conditions=conditions, extent=extent)
        assert battery.run(planned).whole

    with FaultServer() as server:
        made(server, 2, tmp_path / "prompt" / "ask.toml")
        (tmp_path / "prompt" / "near.png").write_bytes(FAR)
        with pytest.raises(LedgerError, match=r"this run has prompt ask@.*, now prompt ask@"):
            made(server, 3, tmp_path / "prompt" / "ask.toml")
        shutil.rmtree(tmp_path / "prompt")
        made(server, 3, None)
    assert len(server.asked) == 9
    assert battery.score(tmp_path / "run").manifest.prompt == prompt
    shown = [Stimulus(rig.images(frame)) for frame in rig.frames]
    expected = {json.dumps(sent(prompt.query(seen, 1, DRIVING))) for seen in (*shown, Stimulus())}
    assert {json.dumps(asked["messages"]) for asked in server.asked} <= expected
    write_bundle(tmp_path / "run", tmp_path / "run.zip", banks=[rig.root])
    assert validate(tmp_path / "run.zip").holds


def test_an_export_carries_every_turn(rig: FrameBank, tmp_path: Path) -> None:
    """Its pictures lie in the folder, the examples' too; a changed request is still found by its digest."""
    prompt = written(tmp_path, FEW_SHOT)
    asked = battery.questions_of(rig.root, BatterySettings(str(tmp_path / "ask.toml"), ("real",)))
    battery.write_questions(asked, tmp_path / "asked")
    rows = [json.loads(line) for line in (tmp_path / "asked" / "asked.jsonl").read_text().splitlines()]
    for (_, query), row in zip(asked.queries(), rows, strict=True):
        assert row["request_sha256"] == query.sha256()
        assert [turn["role"] for turn in row["messages"]] == [message.role for message in prompt.messages]
        assert [part for turn in row["messages"] for part in turn["content"] if part["type"] == "text"] == [
            words(turn.words) for turn in query.messages
        ]
        files = [part["image"] for turn in row["messages"] for part in turn["content"] if part["type"] == "image"]
        assert tuple((tmp_path / "asked" / file).read_bytes() for file in files) == query.pictures
    about = json.loads((tmp_path / "asked" / "asked.json").read_text())
    assert about["prompt"]["messages"][1] == {"role": "user", "text": "What do you do?", "pictures": ["near.png"]}
    assert "send it" in (tmp_path / "asked" / "README.txt").read_text()


@dataclass
class Spoken:
    """A stand-in for a class of messages of Inspect AI: what it is given."""

    content: Any = None
    text: str = ""
    image: str = ""


def test_inspect_is_given_every_turn(rig: FrameBank, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Roles and contents in order, with the places of the pictures' files."""
    kinds = {name: type(name, (Spoken,), {}) for name in INSPECT}
    for name, kind in kinds.items():
        monkeypatch.setattr(inspect, name, kind, raising=False)
    monkeypatch.setattr(inspect, "Sample", lambda **given: given, raising=False)
    written(tmp_path, FEW_SHOT)
    asked = battery.questions_of(rig.root, BatterySettings(str(tmp_path / "ask.toml"), ("real",)))
    battery.write_questions(asked, tmp_path / "asked")
    sample = inspect._sample(next(iter(inspect._rows(tmp_path / "asked"))), tmp_path / "asked")
    system, first, reply, *_, last = sample["input"]
    assert [type(one).__name__ for one in (system, first, reply, last)] == [
        INSPECT[0],
        INSPECT[1],
        INSPECT[2],
        INSPECT[1],
    ]
    assert (system.content[:10], reply.content) == ("You drive.", "Response to user:#### STOP")
    assert [Path(one.image).read_bytes() if one.image else one.text for one in first.content] == [
        NEAR,
        "What do you do?",
    ]
    assert len(last.content) == 4


INSPECT = ("ChatMessageSystem", "ChatMessageUser", "ChatMessageAssistant", "ContentText", "ContentImage")


def ollama(query: Query, modelfile: str = "") -> tuple[Reply, list[Asked]]:
    """Return the reply of a stand-in for Ollama to a query, and the requests that it got."""
    stand_in = Ollama(modelfile=modelfile)
    with Loopback(stand_in.app()) as served:
        mode = RequestMode("ollama:llava", base_url=f"http://127.0.0.1:{served.port}")
        return asyncio.run(_once(query, mode)), stand_in.asked


def test_ollama_gets_every_turn_and_a_mark_where_a_picture_stands(tmp_path: Path) -> None:
    """Pictures before the words need no mark, and no message of a long prompt may be left out in silence."""
    placed = FEW_SHOT.replace("do now?", "do now? Left {picture:left}, front {picture:front}.")
    query = written(tmp_path, placed).query(RIG, 1, DRIVING)
    reply, (asked,) = ollama(query)
    assert (reply.error, asked["truncate"]) == (None, False)
    _, first, stop, _, _, last = asked["messages"]  # type: ignore[misc]
    assert first == {"role": "user", "content": "What do you do?", "images": [base64.b64encode(NEAR).decode()]}
    assert stop == {"role": "assistant", "content": "Response to user:#### STOP"}
    assert last["content"].startswith("[img]What do you do now? Left [img], front [img]. STOP")
    assert last["images"] == [base64.b64encode(one).decode() for one in (RIGHT, LEFT, FRONT)]


def test_ollama_is_not_asked_where_it_would_move_a_picture(tmp_path: Path) -> None:
    """A model with a renderer ignores marks; words that hold a mark would take a picture."""
    plain, placed = (
        written(tmp_path, user(text)).query(RIG, 1) for text in ("Go?", "[img] {picture:left} {picture:right} Go?")
    )
    assert ollama(plain, "FROM x\nRENDERER qwen3-vl-instruct\n")[0].error is None
    for modelfile, says in (("RENDERER qwen3-vl-instruct", "before the words"), ("", "hold [img]")):
        reply, asked = ollama(placed, modelfile)
        assert reply.error == "exception"
        assert says in reply.error_detail
        assert asked == []


def test_a_chat_template_is_given_every_turn_with_its_pictures_in_order(tmp_path: Path) -> None:
    """A mark for each picture, in the place of the picture."""
    query = written(tmp_path, FEW_SHOT.replace("do now?", "{picture:left}?")).query(Stimulus({"left": LEFT}), 1)
    assert [(turn["role"], turn["content"]) for turn in chat(query.turns)][1:4] == [
        ("user", [{"type": "image"}, words("What do you do?")]),
        ("assistant", [words("Response to user:#### STOP")]),
        ("user", [{"type": "image"}, words("What do you do?")]),
    ]
    assert chat(query.turns)[-1]["content"][0] == words("What do you ")  # type: ignore[index]
    assert query.pictures == (NEAR, FAR, LEFT)


def heard(prompt: str, image: bytes | None, *, messages: list[dict[str, Any]]) -> str:
    """Return what it is given."""
    said = [f"{turn['role']}: {' '.join(str(len(part)) for part in turn['content'])}" for turn in messages]
    return f"{prompt} {len(image or b'')} {said}"


def test_a_callable_gets_every_turn_where_it_takes_them(tmp_path: Path) -> None:
    """Else it is told how, because it would miss the examples; a prompt of one message needs nothing."""
    mode = RequestMode("python:m:f")
    short = FEW_SHOT.replace("You drive. You answer with one of: {actions}.", "Drive.")
    query = written(tmp_path, short).query(Stimulus.of(FRONT), 1, DRIVING)
    reply = asyncio.run(hold(heard, mode).answer(query))
    turns = ["system: 6", f"user: {len(NEAR)} 15", "assistant: 26", f"user: {len(FAR)} 15", "assistant: 30"]
    assert reply.text == f"Drive.\n\n{query.user} {len(FRONT)} {[*turns, f'user: {len(FRONT)} {len(query.user)}']}"
    plain = hold(lambda prompt, image: f"{prompt} {image is None}", mode)
    refused = asyncio.run(plain.answer(query))
    assert (refused.error, "let it take them, as (prompt, image, *, messages)" in refused.error_detail) == (
        "exception",
        True,
    )
    one = written(tmp_path, user("Go {picture:front}?")).query(Stimulus({"front": FRONT}), 1)
    assert asyncio.run(plain.answer(one)).text == "Go ? False"


def called(*arguments: object, finish: str = "tool_calls", **message: object) -> Asked:
    """Return a completion whose message calls a tool with these arguments, once each."""
    calls = [
        {"id": f"c{number}", "type": "function", "function": {"name": "decide", "arguments": one}}
        for number, one in enumerate(arguments)
    ]
    body = completion(None, finish)
    body["choices"][0]["message"] |= {"tool_calls": calls, **message}  # type: ignore[index]
    return body


def replied(body: Asked, **fields: object) -> tuple[Reply, Asked]:
    """Return the reply to a body that a server gives, and the server's request."""

    async def handle(request: web.Request, asked: Asked, attempt: int) -> web.StreamResponse:
        del request, asked, attempt
        return web.json_response(body)

    with FaultServer([handle]) as server:
        mode = RequestMode("openai:m", base_url=server.base_url, **fields)  # type: ignore[arg-type]
        reply = asyncio.run(_once(Query("", "Go?", Stimulus(), 1, DRIVING.schema()), mode))
    return reply, server.asked[0]


def test_an_answer_in_a_tool_call_is_read_where_the_mode_asks_for_one() -> None:
    """The tool's parameters are the schema of JSON mode; arguments come as text, or as an object."""
    for given in ('{"action": "LEFT"}', {"action": "LEFT"}):
        reply, asked = replied(called(given), structured="tool_call")
        assert DRIVING.read(reply).action == "LEFT"
    _, other = replied(called("{}"), structured="json_schema")
    (tool,) = asked["tools"]  # type: ignore[misc]
    assert tool["function"]["parameters"] == other["response_format"]["json_schema"]["schema"]  # type: ignore[index]
    assert asked["tool_choice"] == {"type": "function", "function": {"name": tool["function"]["name"]}}
    thinking, _ = replied(called('{"action": "LEFT"}', finish="stop", content="I see a car."), structured="tool_call")
    assert (thinking.text, thinking.reasoning) == ('{"action": "LEFT"}', "I see a car.")


def test_a_tool_call_that_gives_no_one_answer_is_no_answer() -> None:
    """In another mode, with several calls that differ, or cut off; the end of the reply says why."""
    both = ('{"action": "LEFT"}', '{"action": "STOP"}')
    for body, mode in ((called(both[0]), "none"), (called(*both), "tool_call"), (called(None), "tool_call")):
        reply, _ = replied(body, structured=mode)
        assert (reply.text, DRIVING.read(reply).action) == ("", None)
        words = "1 of them call a tool: --json-mode tool_call reads the answer there, if a reply has one call, or equal"
        assert words in Emptiness.of([reply]).words
    cut, _ = replied(called(both[0], finish="length"), structured="tool_call")
    assert DRIVING.read(cut).missing == "truncated"
    plain, _ = replied(completion("LEFT"), structured="tool_call")
    assert DRIVING.read(plain).action == "LEFT"
    with pytest.raises(SpecError, match="json_schema"):
        open_model("ollama:m", RequestMode("ollama:m", structured="tool_call"))


def test_the_pieces_of_a_streamed_tool_call_are_joined() -> None:
    """By index; a piece of another shape loses nothing of the others."""
    pieces = (
        {"index": 0, "function": {"name": "decide", "arguments": ""}},
        {"index": 0, "function": {"arguments": '{"act'}},
    )
    events = [{"tool_calls": [piece]} for piece in (*pieces, {"index": 0, "function": {"arguments": 'ion": "LEFT"}'}})]
    events.insert(2, {"tool_calls": [{"index": 0}, "odd"]})
    lines = [json.dumps({"choices": [{"index": 0, "delta": delta, "finish_reason": None}]}) for delta in events]
    lines.append(json.dumps({"choices": [{"index": 0, "delta": {}, "finish_reason": "tool_calls"}]}))

    async def handle(request: web.Request, asked: Asked, attempt: int) -> web.StreamResponse:
        del request, asked, attempt
        text = "".join(f"data: {line}\n\n" for line in (*lines, "[DONE]"))
        return web.Response(text=text, content_type="text/event-stream")

    with FaultServer([handle]) as server:
        mode = RequestMode("openai:m", base_url=server.base_url, structured="tool_call", stream="usage")
        reply = asyncio.run(_once(Query("", "Go?", Stimulus(), 1), mode))
    assert (reply.text, reply.finish_reason) == ('{"action": "LEFT"}', "stop")


def test_an_estimate_counts_the_examples() -> None:
    """Each is assumed to take as many tokens as a frame's picture, unless a probe measured the prompt."""
    mode, basis = assumed(RequestMode("openai:m"), 2)
    assert mode.measured is not None
    assert mode.measured.prompt_tokens == 3 * ASSUMED_IN
    assert f"if a call takes {3 * ASSUMED_IN} tokens in" in basis
    assert assumed(mode, 5)[0] == mode
