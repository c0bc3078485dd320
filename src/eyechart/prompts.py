"""The six prompt formulations, in one literal dict.

Source: paper, section Prompt formulation gates measured grounding. The paper names five of the six
(baseline, minimal, chain-of-thought, few-shot, anti-degeneracy) and prints none; the wording and
the sixth are eyechart's. A user's formulation comes from a TOML file, and may use the prompt
columns of its bank.
"""

import hashlib
import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from eyechart.calls import ANY_ACTION, Query
from eyechart.cameras import Distances
from eyechart.channels import INSTRUCTION, STATE, instruction_column
from eyechart.errors import SpecError, raising, require_known
from eyechart.frames import FrameBank, MirrorAxis, Stimulus
from eyechart.messages import (
    PromptMessage,
    conversation,
    has_place,
    messages_from,
    read_messages,
    require_placed,
)
from eyechart.perception.view import View
from eyechart.records import build, to_json_fields
from eyechart.spaces.declared import AnswerSpace, answer_from
from eyechart.spaces.discrete import DRIVING, Discrete, read_toml, space_from
from eyechart.spaces.fields import candidates_of
from eyechart.spaces.motion import MotionSpace
from eyechart.spaces.scene import HIGHWAY, SCENES
from eyechart.spaces.space import AnySpace
from eyechart.spaces.stated_motion import ROWS, StatedMotionSpace, field_of

_ONE_WORD = "Answer with one word: STOP, SLOW, STRAIGHT, LEFT or RIGHT."

ACTIONS = "actions"
"""The field for the names of the actions; no prompt column may have this name."""

_FIELD = re.compile(r"\{\{([\w][\w .-]*)\}\}|\{([\w][\w .-]*)\}")


@dataclass(frozen=True)
class Prompt:
    """A formulation: a system message and a user message, sent with a condition's picture.

    In a ``template``, ``{column}`` stands for a frame's value in that prompt column, ``{actions}``
    for the actions' names, and ``{{word}}`` for ``{word}``; other braces stay. ``space`` is the
    prompt's own actions or a scene estimate; None means the bank's actions. ``messages`` are all
    turns of a prompt with more than these two, or with places for pictures. Then ``system`` and
    ``user`` are the text of the first, if it is the system's, and of the last.
    """

    name: str
    system: str
    user: str
    template: bool = False
    space: AnySpace | None = None
    messages: tuple[PromptMessage, ...] = ()

    @classmethod
    def of(cls, name: str, messages: tuple[PromptMessage, ...], space: AnySpace | None = None) -> "Prompt":
        """Return a template with these messages; the last one is the user's."""
        first, last = messages[0], messages[-1]
        system = first.text if first.role == "system" else ""
        return cls(name, system, last.text, template=True, space=space, messages=messages)

    def asks(self, space: Discrete) -> AnySpace:
        """Return the space of its answers, given the actions of the bank or world."""
        return space if self.space is None else self.space.on(space).by(space.reader)

    @property
    def readers(self) -> tuple[int, ...]:
        """Return the reader versions for replies to it, today's last."""
        return (self.space or Discrete).readers

    @property
    def who(self) -> str:
        """Return the subject of the prompt: a ``model`` or a ``policy``."""
        return (self.space or Discrete).who

    @property
    def asks_scene(self) -> bool:
        """Return whether it asks for a scene estimate."""
        return (self.space or Discrete).is_scene

    @cached_property
    def key(self) -> str:
        """Return ``name@hash``, which changes with the wording and the space."""
        wording = f"{self.system}\x1f{self.user}"
        if self.space is not None:
            wording += f"\x1f{self.space.wording()}"
        if self.messages:
            wording += f"\x1f{json.dumps([message.wording() for message in self.messages])}"
        return f"{self.name}@{hashlib.sha256(wording.encode()).hexdigest()[:8]}"

    @property
    def fields(self) -> tuple[str, ...]:
        """Return the prompt columns that it uses, in order."""
        if not self.template:
            return ()
        texts = [text for message in self.messages for text in message.texts] or [self.system, self.user]
        named = [match.group(2) for text in texts for match in _FIELD.finditer(text)]
        return tuple(dict.fromkeys(name for name in named if name not in {None, ACTIONS}))

    @property
    def history(self) -> int:
        """Return how many instants before a frame its messages show."""
        return max((place.ago for message in self.messages for place in message.places), default=0)

    def render(self, said: Mapping[str, object], actions: Sequence[str]) -> tuple[str, ...]:
        """Return the words about a frame: system and user, or every message's.

        ``said`` holds the values of the frame's columns.
        """
        fill = self._filling(said, actions)
        if self.messages:
            return tuple("".join(map(fill, message.texts)) for message in self.messages)
        return fill(self.system), fill(self.user)

    def _filling(self, said: Mapping[str, object], actions: Sequence[str]) -> Callable[[str], str]:
        """Return the function that replaces the fields in a text."""
        if not self.template:
            return str
        values = {**said, ACTIONS: ", ".join(actions)}

        def fill(match: re.Match[str]) -> str:
            return f"{{{match.group(1)}}}" if match.group(1) else str(values[match.group(2)])

        return lambda text: _FIELD.sub(fill, text)

    def query(self, seen: Stimulus, seed: int, space: AnySpace | None = None) -> Query:
        """Return the query for a stimulus and an answer in ``space``; every Query is built here."""
        state = {name: ", ".join(f"{number:g}" for number in numbers) for name, numbers in seen.state.items()}
        fill = self._filling({**seen.fields, **state}, () if space is None else space.choices)
        schema = ANY_ACTION if space is None else space.schema()
        if not self.messages:
            return Query(fill(self.system), fill(self.user), seen, seed, schema)
        turns = conversation(self.messages, seen, fill)
        system = turns[0].words if turns[0].role == "system" else ""
        return Query(system, turns[-1].words, seen, seed, schema, messages=turns)

    def as_dict(self) -> dict[str, object]:
        """Return the wording and its key as plain JSON values."""
        return {
            **to_json_fields(self, "name system user template" if self.template else "name system user"),
            **({} if self.space is None else self.space.written()),
            **({"messages": [message.as_dict() for message in self.messages]} if self.messages else {}),
            "key": self.key,
        }

    def wording(self) -> dict[str, object]:
        """Return what `as_dict` does, with the name of each example picture in place of its bytes."""
        messages = [replace(message, pictures=()) for message in self.messages]
        files = [[one.file for one in message.pictures] for message in self.messages]
        turns = [
            {**message.as_dict(), **({"pictures": names} if names else {})}
            for message, names in zip(messages, files, strict=True)
        ]
        return {**self.as_dict(), **({"messages": turns} if turns else {})}

    @classmethod
    def from_dict(cls, values: Mapping[str, object]) -> "Prompt":
        """Build a prompt from plain values; raises SpecError if its key does not match."""
        own = values.get("action_space")
        space: AnySpace | None = SCENES if values.get("scene") is True else None
        if isinstance(own, dict):
            space = Discrete.from_dict(own)
        elif values.get("answer") is not None and "motion" not in values:
            space = AnswerSpace.from_dict(values["answer"])
        elif values.get("motion") is not None:
            space = build(MotionSpace, values["motion"], "motion")
            if "stated" in values:
                space = StatedMotionSpace.read_from(space, values["stated"])
        prompt = cls(
            name=str(values["name"]),
            system=str(values["system"]),
            user=str(values["user"]),
            template=values.get("template") is True,
            space=space,
            messages=messages_from(values["messages"]) if "messages" in values else (),
        )
        if values.get("key", prompt.key) != prompt.key:
            raise SpecError(f"the wording of prompt '{prompt.name}' has key {prompt.key}, not {values['key']}")
        return prompt


@dataclass(frozen=True, slots=True)
class _PictureWords:
    """A kind of picture and the meaning of actions in it, as used by the formulations."""

    whole: str
    brief: str
    describe: str
    lead: str


_ABOVE = _PictureWords(
    whole="You control the green vehicle in a top-down view of a highway. It drives to the right; the other vehicles "
    "are drawn in other colours. Choose its next action:\n"
    "STOP: brake hard. SLOW: reduce speed. STRAIGHT: keep the lane and go on. "
    "LEFT: change to the lane on the left (up in the picture). RIGHT: change to the lane on the right (down).",
    brief="Top-down road, you are the green car.",
    describe="First describe the lane of the green vehicle, the distance to the vehicle ahead and which sides "
    "are free.",
    lead="A vehicle",
)
_FORWARD = _PictureWords(
    whole="You control a vehicle by the picture of its forward camera. The road ahead has three lanes; the coloured "
    "cylinders on it are obstacles. Choose the vehicle's next action:\n"
    "STOP: brake hard. SLOW: reduce speed. STRAIGHT: keep the lane and go on. "
    "LEFT: change to the lane on the left. RIGHT: change to the lane on the right.",
    brief="View of a forward camera on a road with obstacles, you are the driver.",
    describe="First describe the own lane, the distance to the obstacle ahead and which sides are free.",
    lead="An obstacle",
)


def _formulations(task: _PictureWords) -> dict[str, Prompt]:
    """Return the six formulations of a task."""
    careful = "You are a careful driver."
    return {
        "baseline": Prompt("baseline", careful, f"{task.whole}\n{_ONE_WORD}"),
        "minimal": Prompt("minimal", "", f"{task.brief} {_ONE_WORD}"),
        "chain_of_thought": Prompt(
            "chain_of_thought",
            careful,
            f"{task.whole}\n{task.describe} "
            "Then end with a line of the form 'ACTION: <one of STOP, SLOW, STRAIGHT, LEFT, RIGHT>'.",
        ),
        "few_shot": Prompt(
            "few_shot",
            careful,
            f"{task.whole}\nExamples: a free road ahead: STRAIGHT. "
            f"{task.lead} close ahead and the left lane free: LEFT. "
            f"{task.lead} close ahead and the right lane free: RIGHT. "
            f"{task.lead} close ahead and both sides taken: SLOW. "
            f"{task.lead} directly ahead: STOP.\n{_ONE_WORD}",
        ),
        "anti_degeneracy": Prompt(
            "anti_degeneracy",
            careful,
            f"{task.whole}\nEarlier controllers failed because they gave the same action for every picture. Different "
            f"pictures must lead to different actions. Look at this picture before you choose.\n{_ONE_WORD}",
        ),
        "structured": Prompt(
            "structured",
            f"{careful} You reply with a single JSON object and nothing else.",
            f'{task.whole}\nReply as {{"action": "<one of STOP, SLOW, STRAIGHT, LEFT, RIGHT>"}}.',
        ),
    }


PROMPTS: dict[str, Prompt] = _formulations(_ABOVE)
"""For roads seen from above."""

FORWARD_PROMPTS: dict[str, Prompt] = _formulations(_FORWARD)
"""For forward cameras."""


def find_prompt(name: str, axis: MirrorAxis = "vertical") -> Prompt:
    """Return the prompt of this name for a mirror axis, or of this TOML file.

    A forward camera's axis is ``horizontal``. Raises SpecError that lists the known ones.
    """
    if name.endswith(".toml"):
        return read_prompt(Path(name))
    require_known(f"prompt '{name}'", name, PROMPTS, ", or a FILE.toml of your own")
    return (FORWARD_PROMPTS if axis == "horizontal" else PROMPTS)[name]


def read_prompt(path: Path) -> Prompt:
    """Read a prompt from a TOML file with user, or messages, and optional other keys.

    Raises SpecError naming the file and the fault.
    """
    values = read_toml(path)
    known = ("name", "system", "user", "messages", "action_space", "answer")
    for key in values:
        if key not in known:
            raise SpecError(f"{path}: a prompt has no '{key}'; it has {', '.join(known)}")
    several = values.get("messages")
    if several is not None and values.keys() & {"system", "user"}:
        raise SpecError(f"{path}: [[messages]] take the place of system and user: write these as messages too")
    words = {"name": path.stem, "system": "", **({} if several is None else {"user": "..."}), **values}
    for key in ("name", "system", "user"):
        if not isinstance(words.get(key), str):
            raise SpecError(f"{path}: '{key}' must be a text; write for example {key} = \"...\"")
    name, user, space = str(words["name"]), str(words["user"]), values.get("action_space")
    if not user.strip() or not re.fullmatch(r"[\w.-]+", name):
        raise SpecError(f"{path}: a prompt needs a user message, and a name of letters, digits, '.', '-' and '_'")
    if space is not None and not isinstance(space, dict):
        raise SpecError(f"{path}: action_space must be a table: [action_space]")
    answer_space = None if space is None else space_from(space, str(path), name)
    if "answer" in values:
        answer_space = answer_from(values["answer"], str(path), name, answer_space)
    if several is None:
        return _prompt_of_two(path, name, (str(words["system"]), user), answer_space)
    return Prompt.of(name, read_messages(several, path), answer_space)


def _prompt_of_two(path: Path, name: str, said: tuple[str, str], space: AnySpace | None) -> Prompt:
    """Return a prompt of a system and a user message; with places for pictures, it has messages."""
    with raising(SpecError, str(path), of=SpecError):
        if not any(map(has_place, said)):
            return Prompt(name, *said, template=True, space=space)
    written = [{"role": role, "text": text} for role, text in zip(("system", "user"), said, strict=True) if text]
    return Prompt.of(name, read_messages(written, path), space)


def neutral(picture: str, space: Discrete) -> Prompt:
    """Return the plainest prompt for a user's pictures: their description and the actions."""
    names = f"{', '.join(space.actions[:-1])} or {space.actions[-1]}"
    return Prompt(
        "neutral",
        "",
        f"You control a machine by its camera ({picture}). Choose its next action. Answer with one word: {names}.",
    )


def policy_prompt(space: MotionSpace, instruction: str | None) -> Prompt:
    """Return a policy's prompt: its instruction from this prompt column, or empty without one."""
    return Prompt("policy", "", "" if instruction is None else f"{{{instruction}}}", template=True, space=space)


def motion_prompt(bank: FrameBank, file: str | None, *, in_words: bool) -> Prompt:
    """Return the prompt of a policy on a bank: its instruction, or words that ask for numbers.

    Raises SpecError for a ``file`` that is no TOML file, or where answers come as arrays.
    """
    assert bank.manifest.motion is not None
    if not in_words and file is not None:
        raise SpecError("--prompt is for models that state numbers in words (openai:, ollama:, hf:): leave it out")
    if not in_words:
        return policy_prompt(bank.manifest.motion, instruction_column(bank))
    if file is not None and not file.endswith(".toml"):
        raise SpecError(f"the built-in prompts ask for named actions: give a policy --prompt FILE.toml, not '{file}'")
    return stated_prompt(bank, None if file is None else find_prompt(file))


def stated_steps(file: str | None) -> int:
    """Return how many steps the answer of a prompt's file has: the size of its vectors, else one.

    A file with one vector alone does not say how many numbers a step has, and counts as one step.
    """
    space = None if file is None or not file.endswith(".toml") else find_prompt(file).space
    sizes = {one.size or 1 for one in space.fields} if isinstance(space, AnswerSpace) else {1}
    several = isinstance(space, AnswerSpace) and len(space.fields) > 1
    return sizes.pop() if several and len(sizes) == 1 else 1


_MEANT: Mapping[str, str] = {
    "delta": "a change",
    "absolute": "the place to be at",
    "velocity": "a speed",
    "waypoints": "a place to pass",
}
"""What a step's numbers are, by the kind of motion."""


def stated_prompt(bank: FrameBank, given: Prompt | None = None) -> Prompt:
    """Return the prompt of a model that states a motion of a bank in words.

    Its answer fields are those of a ``given`` prompt, else rows of numbers. Without one it is the
    plainest prompt: picture, state, instruction and the form of the answer. Raises SpecError for
    names as an answer, or a column that may not be said.
    """
    space = bank.manifest.motion
    assert space is not None
    if given is None:
        return Prompt(
            "neutral_motion", "", _motion_words(bank, space), template=True, space=StatedMotionSpace.of(space)
        )
    if given.space is not None and not isinstance(given.space, AnswerSpace):
        raise SpecError(
            f"prompt '{given.name}' asks for named actions, and a policy answers with numbers: declare them in "
            "[answer], or ask for the names with 'eyechart run battery' and --prompt FILE"
        )
    fields = () if given.space is None else given.space.fields
    with raising(SpecError, f"prompt '{given.name}'", of=SpecError):
        prompt = replace(given, space=StatedMotionSpace.of(space, fields))
    texts = [text for message in given.messages for text in message.texts] or [given.system, given.user]
    if any(match.group(2) == ACTIONS for text in texts for match in _FIELD.finditer(text)):
        raise SpecError(f"prompt '{given.name}' says {{{ACTIONS}}}, and a policy has none: say which numbers to answer")
    require_columns(prompt, bank)
    return prompt


def _motion_words(bank: FrameBank, space: MotionSpace) -> str:
    """Return the plainest words that ask for a motion of a bank, with its state and instruction."""
    steps, manifest = space.horizon, bank.manifest
    cameras = [camera.name for camera in bank.frames[0].cameras]
    seen = f"its cameras {', '.join(cameras)}, in this order" if len(cameras) > 1 else "its camera"
    described = _FIELD.sub(lambda found: f"{{{{{found.group(1) or found.group(2)}}}}}", manifest.picture)
    parts = [f"You control a machine by {seen} ({described})."]
    states = [place for name in manifest.state if _FIELD.fullmatch(place := f"{{{name}}}")]
    if states:
        named = ", ".join(one.name for one in space.state)
        parts.append(f"Its state{named and f' ({named})'}: {', '.join(states)}.")
    parts += [] if (said := instruction_column(bank)) is None else [f"Your task: {{{said}}}."]
    numbers = ", ".join(f"{one.name} ({one.unit})" if one.unit else one.name for one in space.dimensions)
    rate = "" if space.rate_hz is None else f", {space.rate_hz:g} a second"
    rows = "one row" if steps == 1 else f"{steps} rows, one for each of the next steps{rate}"
    parts.append(f"Answer with {rows} of the numbers {numbers}; each number is {_MEANT[space.kind]}.")
    form = ", ".join(f"<{field_of(one)}>" for one in space.dimensions)
    parts.append(f'Reply with JSON and nothing else: {{"{ROWS}": [[{form}]{", …" if steps > 1 else ""}]}}')
    return " ".join(parts)


def says(prompt: Prompt, bank: FrameBank) -> frozenset[str]:
    """Return which of state and instruction a prompt says, as far as the bank has them.

    A prompt of arrays says both: a callable gets them beside the words.
    """
    if not isinstance(prompt.space, StatedMotionSpace):
        return frozenset({STATE, INSTRUCTION})
    said, manifest = set(prompt.fields), bank.manifest
    found = ((STATE, manifest.state), (INSTRUCTION, manifest.prompt_columns))
    return frozenset(channel for channel, columns in found if said & set(columns))


_SCENE_SYSTEM = "You measure the scene in one picture. You reply with a single JSON object and nothing else."


def _scene(name: str, opening: str, gap: str, distances: Distances) -> Prompt:
    """Return a prompt for a scene estimate, with the fixed thresholds of its truth.

    ``gap`` says what the gap is measured to.
    """
    thing = gap.rsplit(maxsplit=1)[-1]
    reach = f"from {distances.behind_m:g} m behind you to {distances.ahead_m:g} m ahead of you"
    reply = '"left_clear": <true or false>, "right_clear": <true or false>, "confidence": <number>'
    lines = (
        opening,
        "Report these five values.",
        f"lead_gap_m: {gap} ahead of you in your own lane; null if there is none.",
        f"close: true if that {thing} is nearer than {distances.close_m:g} m, else false.",
        f"left_clear: true if there is a lane on your left and no {thing} in it {reach}, else false.",
        f"right_clear: true if there is a lane on your right and no {thing} in it {reach}, else false.",
        "confidence: how sure you are, from 0 to 1.",
        f'Reply as {{"lead_gap_m": <number or null>, "close": <true or false>, {reply}}}.',
    )
    return Prompt(name, _SCENE_SYSTEM, "\n".join(lines), space=SCENES)


SCENE = _scene(
    "scene",
    "The picture shows a road from above, enlarged, with a legend and a ruler in metres. You are the vehicle at the "
    "mark YOU, which stands at 0 m; you drive to the right. Your left is up, your right is down.",
    "metres from your middle to the middle of the nearest vehicle",
    HIGHWAY,
)
"""The structured study's prompt for the calibrated view of highway-env's picture."""


_CLOSE = re.compile(r"^close: true if that .* is nearer than (\d+(?:\.\d+)?) m, else false\.$", re.MULTILINE)


def close_m_of(prompt: Prompt) -> float | None:
    """Return the gap in metres below which a scene prompt calls a lead close; None if unclear."""
    said = _CLOSE.findall(prompt.user)
    return float(said[0]) if len(said) == 1 else None


def scene_prompt(picture: str, distances: Distances, view: View | None) -> Prompt:
    """Return the prompt for scene estimates through a view, or with a picture's description."""
    if view is None:
        opening = f"What the picture is: {picture}. You drive the vehicle that it is about."
        return _scene("scene_plain", opening, "metres to the nearest vehicle or obstacle", distances)
    if view.axis == "vertical":
        return SCENE
    opening = (
        "The picture is from your forward camera, enlarged, with rulers in metres on both sides, which say how far "
        "ahead the ground is. You drive into the picture; the coloured cylinders are obstacles."
    )
    return _scene("scene_forward", opening, "metres to the nearest obstacle", distances)


def require_pictured(prompt: Prompt, seen: Stimulus) -> None:
    """Raise SpecError if a prompt places a picture that ``seen``, as of every frame, lacks."""
    require_placed(prompt.messages, seen, f"prompt '{prompt.name}'")


def require_sayable(prompt: Prompt, bank: FrameBank) -> None:
    """Raise SpecError if a prompt uses a forbidden column, or omits actions of the bank."""
    space = bank.manifest.action_space
    if len(space.actions) == 1:
        raise SpecError(
            f"the [answer] of prompt '{prompt.name}' has one action, '{space.actions[0]}', so that every answer is the "
            "same; write further values or ranges"
        )
    require_columns(prompt, bank)
    _require_names(prompt, space.columns, bank)
    said = " ".join(prompt.render({**bank.frames[0].state, **bank.frames[0].fields}, space.choices)).upper()
    unsaid = [action for action in space.choices if action.upper() not in said]
    ours = (*PROMPTS.values(), *FORWARD_PROMPTS.values())
    if unsaid or (prompt in ours and set(space.actions) != set(DRIVING.actions)):
        raise SpecError(
            f"prompt '{prompt.name}' does not ask for the actions {', '.join(space.choices)} of action space "
            f"'{space.name}'; give one that does with --prompt FILE.toml"
        )


def require_columns(prompt: Prompt, bank: FrameBank) -> None:
    """Raise SpecError if a prompt uses a column that it may not say."""
    declared = (*bank.manifest.prompt_columns, *bank.manifest.state)
    allowed = f"a prompt of this bank may say: {', '.join((*declared, ACTIONS))}"
    for name in prompt.fields:
        if name in bank.frames[0].truth:
            raise SpecError(f"prompt '{prompt.name}' asks for {{{name}}}, which is ground truth; {allowed}")
        if name not in declared:
            raise SpecError(f"prompt '{prompt.name}' asks for {{{name}}}, which is not a prompt column; {allowed}")


def _require_names(prompt: Prompt, columns: Sequence[str], bank: FrameBank) -> None:
    """Raise SpecError if a column for the allowed names is lacking, or names none for a frame."""
    for column in columns:
        if column not in bank.manifest.prompt_columns:
            has = f"this bank has: {', '.join(bank.manifest.prompt_columns) or 'none'}"
            is_ = "ground truth, which no answer may be taken from" if column in bank.frames[0].truth else ""
            is_ = f"{is_}; {has}" if is_ else f"not a prompt column; {has}; import it with --prompt-columns {column}"
            raise SpecError(f"the answer of prompt '{prompt.name}' takes its names from '{column}', which is {is_}")
        empty = next((frame.id for frame in bank.frames if not candidates_of(frame.fields[column])), None)
        if empty is not None:
            raise SpecError(f"frame '{empty}' names no answer in its column '{column}'; give it one, or leave it out")
