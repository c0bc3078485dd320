"""A scene is a structured estimate of one picture; a fixed policy turns it into one of five actions.

What a model says of a scene is read strictly: its syntax is repaired and its content never. Source: paper, section
Constructive renderer-calibrated controller.
"""

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from typing import ClassVar, Literal, NamedTuple

from eyechart.cameras import Distances
from eyechart.spaces.discrete import DRIVING
from eyechart.spaces.failures import says_failed, says_no_picture
from eyechart.spaces.space import (
    READ_AT_MOST,
    Answer,
    Decision,
    Usual,
    refuses,
    thinks_behind,
    too_deep,
    unanswered,
    without_thinking,
)

CLOSE_GAP_M = 18.0
"""A lead nearer than this is close (paper, section The Input-Ablation Battery); that it is centre to centre is ours."""

STOP_GAP_M = 12.0
"""Nearer than this the safe action is STOP whatever the sides are."""

FREE_GAP_M = 40.0
"""From here on the road ahead counts as free (the scripted geometric controller of Table t:baselines)."""

CLEAR_BEHIND_M = 12.0
CLEAR_AHEAD_M = 40.0
"""A side is clear when its lane exists and holds no vehicle centre from 12 m behind to 40 m ahead."""


SCENE_READER = 4
"""The version of these rules. A run records it, and is read by the version that it was begun under."""

_TRUSTING = 3
SCENE_READERS = (_TRUSTING, SCENE_READER)
"""The versions by which a scene can be read; 3 takes an answer that says that it failed for its estimate."""

_READINGS_KEPT = 1000

MOST_GAP_M = 1000.0
"""A larger gap is no distance to a vehicle in a picture."""

FIELDS = ("lead_gap_m", "close", "left_clear", "right_clear", "confidence")

SCHEMA: Mapping[str, object] = {
    "type": "object",
    "properties": {
        "lead_gap_m": {"type": ["number", "null"]},
        "close": {"type": "boolean"},
        "left_clear": {"type": "boolean"},
        "right_clear": {"type": "boolean"},
        "confidence": {"type": "number"},
    },
    "required": list(FIELDS),
    "additionalProperties": False,
}
"""The JSON schema of an estimate; it has no bounds of numbers, because not every server takes a schema that has."""

Unscened = Literal[
    "no_object",  # the text holds no braces
    "malformed",  # what stands in braces is no JSON, also after the repairs, or is nested in more than 100 levels
    "several_objects",  # two estimates that differ
    "contradictory",  # a field is given twice with different values
    "missing_field",
    "wrong_type",  # a word or a number for true or false, a word for a number
    "out_of_range",  # a gap below 0 or above 1000 m, a confidence outside 0 to 1
    "says_error",  # a whole estimate, beside which the answer says that it failed or that there was no picture
    "too_long",  # more words than are read, so that an estimate beyond them might say otherwise
]
"""Why a reply of words holds no estimate."""

Repair = Literal["code_fence", "text_around", "trailing_comma"]
"""What was set right in a reply's syntax: code fences or words around the object, a comma before a closing brace."""

REPAIRS: tuple[Repair, ...] = ("code_fence", "text_around", "trailing_comma")

_FENCE = re.compile(r"```[\w-]*")
_STRING_OR_COMMA = re.compile(r'("(?:[^"\\]|\\.)*")|,(?=\s*[}\]])', re.DOTALL)
_OBJECTS_AT_MOST = 100


HIGHWAY = Distances(STOP_GAP_M, CLOSE_GAP_M, FREE_GAP_M, CLEAR_BEHIND_M, CLEAR_AHEAD_M)
"""Ours, at 20 to 30 m/s and centre to centre; of these the paper prints 18 m alone."""


class Other(NamedTuple):
    """Another vehicle or obstacle: how far ahead it is and how far to the right, in metres."""

    ahead_m: float
    aside_m: float

    def mirrored(self) -> "Other":
        """Return it in the flipped picture."""
        return Other(self.ahead_m, -self.aside_m)


@dataclass(frozen=True, slots=True)
class Scene:
    """What a controller needs to know of a picture.

    ``gap_m`` is the distance in metres to the nearest vehicle or obstacle ahead in the own lane, counted as its world
    counts it, or None where none is seen. ``left_clear`` and ``right_clear`` are as the driver sees them. ``distances``
    are those of the world.
    """

    gap_m: float | None
    left_clear: bool
    right_clear: bool
    distances: Distances = HIGHWAY

    @property
    def close(self) -> bool:
        """Whether a lead stands nearer than the world's threshold, 18 m on a highway."""
        return self.gap_m is not None and self.gap_m < self.distances.close_m

    @property
    def free(self) -> bool:
        """Whether the road ahead counts as free."""
        return self.gap_m is None or self.gap_m >= self.distances.free_m

    @property
    def blocked(self) -> bool:
        """Whether a lead stands so near that the safe action is to stop, whatever the sides are."""
        return self.gap_m is not None and self.gap_m < self.distances.stop_m

    def mirrored(self) -> "Scene":
        """Return the scene as its reflection across the lane axis shows it."""
        return replace(self, left_clear=self.right_clear, right_clear=self.left_clear)


def safe_action(scene: Scene) -> str:
    """Return the action of a fixed safety policy that is exactly equivariant under reflection.

    STRAIGHT where the road is free, STOP where a lead is very near, the one clear side where exactly one
    is clear, and SLOW otherwise (also where both sides are clear: a choice between them would be a prior).
    """
    if scene.free:
        return "STRAIGHT"
    if scene.blocked:
        return "STOP"
    if scene.left_clear != scene.right_clear:
        return "LEFT" if scene.left_clear else "RIGHT"
    return "SLOW"


@dataclass(frozen=True, slots=True)
class Estimate:
    """A picture's scene as a model says that it is; ``gap_m`` None means that no lead is seen.

    ``close`` is what the model says, and may contradict its own gap.
    """

    gap_m: float | None
    close: bool
    left_clear: bool
    right_clear: bool
    confidence: float

    @classmethod
    def of(cls, scene: Scene, confidence: float = 1.0) -> "Estimate":
        """Return a scene as an estimate that agrees with itself."""
        return cls(scene.gap_m, scene.close, scene.left_clear, scene.right_clear, confidence)

    def disagrees(self, distances: Distances = HIGHWAY) -> bool:
        """Return whether ``close`` is not what the gap says."""
        return self.close != (self.gap_m is not None and self.gap_m < distances.close_m)

    def act(self, distances: Distances = HIGHWAY) -> str:
        """Return the safe action of the scene; where ``close`` and the gap disagree, of the more cautious of the two.

        A close lead at no gap, or at one that is not close, is a lead at the threshold, 18 m on a highway: it is never
        STRAIGHT, and STOP only where a gap says so. A nearer gap counts whatever ``close`` says. Exactly equivariant
        under reflection. ``distances`` are those of the world.
        """
        free = self.gap_m is None or self.gap_m >= distances.close_m
        gap_m = distances.close_m if self.close and free else self.gap_m
        return safe_action(Scene(gap_m, self.left_clear, self.right_clear, distances))

    def mirrored(self) -> "Estimate":
        """Return the estimate of the reflected scene."""
        return replace(self, left_clear=self.right_clear, right_clear=self.left_clear)

    def __str__(self) -> str:
        """Return the estimate as the JSON text that reads back as itself."""
        values = asdict(self)
        return json.dumps({"lead_gap_m": values.pop("gap_m"), **values})


class Beside(NamedTuple):
    """What a reply with an estimate says beside it, thinking left aside.

    ``before`` and ``after`` stand around its first and its last object, of which there are ``objects``; ``names`` are
    of all their fields, as often as they stand there. ``thinking_after`` is whether it thinks on behind the first,
    ``failed`` whether a field or the words around say that the answer is none.
    """

    before: str
    after: str
    objects: int
    names: tuple[str, ...]
    thinking_after: bool
    failed: bool


@dataclass(frozen=True, slots=True)
class SceneDecision(Decision[Estimate]):
    """An estimate, or the reason that a reply holds none, and how the reply's syntax was repaired.

    ``beside`` is what else stands in a reply with an estimate, for those who act on it.
    """

    repairs: tuple[Repair, ...] = ()
    beside: Beside | None = field(default=None, compare=False)


@dataclass(frozen=True, slots=True)
class SceneSpace(Usual):
    """An action is a scene estimate; the world executes its safe action. ``distances`` are those of the world.

    ``reader`` is the version of the rules of reading, which is no part of the space.
    """

    is_scene: ClassVar[bool] = True
    readers: ClassVar[tuple[int, ...]] = SCENE_READERS
    name: ClassVar[str] = "scene"
    actions: ClassVar[tuple[str, ...]] = ()
    distances: Distances = HIGHWAY
    reader: int = field(default=SCENE_READER, compare=False)

    def schema(self) -> Mapping[str, object]:
        """Return the JSON schema of an estimate."""
        return SCHEMA

    def read(self, reply: Answer) -> SceneDecision:
        """Return the estimate that a reply holds; see `_read` for the rules."""
        return _read(self.reader, reply.text, reply.finish_reason, reply.error)

    def distance(self, one: Estimate, other: Estimate) -> float:
        """Return 0 where two estimates say the same of the scene, whatever their confidence, else 1."""
        return float(replace(one, confidence=0.0) != replace(other, confidence=0.0))

    def project(self, action: Estimate, axis: str) -> float | None:
        """Return how hard the safe action of an estimate brakes; None along another axis than ``brake``."""
        return DRIVING.project(self.symbol(action), axis)

    def reflect(self, action: Estimate) -> Estimate:
        """Return the estimate of the reflected scene."""
        return action.mirrored()

    def symbol(self, action: Estimate) -> str:
        """Return the safe action of an estimate."""
        return action.act(self.distances)

    def role(self, symbol: str) -> str:
        """Return what a safe action is to the gap tests."""
        return DRIVING.role(symbol)

    def written(self) -> dict[str, object]:
        """Return that a scene is asked for."""
        return {"scene": True}

    def by(self, reader: int) -> "SceneSpace":
        """Return the space with replies read by this version of the rules; the same where there is no such version."""
        return replace(self, reader=reader) if reader in SCENE_READERS else self

    def in_world(self, distances: Distances) -> "SceneSpace":
        """Return the estimates of a world with these distances."""
        return replace(self, distances=distances)


SCENES = SceneSpace()


class _Unreadable(Exception):  # noqa: N818 - no error: it says why a reply holds no estimate
    def __init__(self, why: Unscened) -> None:
        super().__init__(why)
        self.why = why


@lru_cache(maxsize=_READINGS_KEPT)
def _read(rules: int, text: str, finish_reason: str | None, error: str | None) -> SceneDecision:
    """Read the scene estimate from a reply's verbatim text; strict, deterministic, and never guessing.

    In order: an error, a cut-off (``length``) or a filter's refusal is the reason there is none. What stands in
    ``<think>`` is no answer. Then the JSON object in what is left. Fields that the schema does not have are not read,
    but one that says that the answer is none is believed, as words around are; not by version 3 of the ``rules``.
    Nothing is read of an answer that is longer than `READ_AT_MOST`, for a part of it is not what the model said;
    thinking may be longer.
    """
    if (missing := unanswered(finish_reason, error)) is not None:
        return SceneDecision(None, missing)
    visible = without_thinking(text).strip()
    if not visible:
        return SceneDecision(None, "empty")
    repairs: dict[Repair, None] = {}
    try:
        values, beside = _only_one(visible, repairs)
        found = _estimate(values) if rules == _TRUSTING else _believed(_estimate(values), beside)
        beside = beside._replace(thinking_after=thinks_behind(text, "{"))
        return SceneDecision(found, repairs=tuple(name for name in REPAIRS if name in repairs), beside=beside)
    except _Unreadable as unreadable:
        if unreadable.why == "no_object" and refuses(visible):
            return SceneDecision(None, "refused")
        return SceneDecision(None, "unparsed", unreadable.why)


def _only_one(text: str, repairs: dict[Repair, None]) -> tuple[dict[str, object], Beside]:
    """Return the one object of a text and what stands beside it, noting what had to be set right.

    Raises _Unreadable where there is not one.
    """
    if len(text) > READ_AT_MOST:
        raise _Unreadable("too_long")
    spans = list(_spans(text))
    if not spans:
        raise _Unreadable("malformed" if "{" in text else "no_object")
    if len(spans) > _OBJECTS_AT_MOST:
        raise _Unreadable("several_objects")
    around = _around(text, spans, repairs)
    loaded = [_loaded(text[start:end], repairs) for start, end in spans]
    objects = [one for one in loaded if one is not None]
    broken = [text[start:end] for (start, end), one in zip(spans, loaded, strict=True) if one is None]
    broken += text[spans[-1][1] :].partition("{")[2:]
    if not objects or any(name in part for part in broken for name in FIELDS):
        raise _Unreadable("malformed")  # beside a broken estimate a whole one may be the one that was taken back
    beside = Beside(
        before=text[: spans[0][0]],
        after=text[spans[-1][1] :],
        objects=len(spans),
        names=tuple(name for one in objects for name, _ in one),
        thinking_after=False,
        failed=says_no_picture(around) or any(says_failed(one, FIELDS) for one in objects),
    )
    return _agreed([dict(one) for one in objects]), beside


def _agreed(objects: Sequence[dict[str, object]]) -> dict[str, object]:
    """Return the first estimate among some objects, or the first object; raises _Unreadable where two differ."""
    answers = [one for one in objects if any(name in one for name in FIELDS)] or objects[:1]
    if any(_differ(answers[0].get(name), one.get(name)) for one in answers[1:] for name in FIELDS):
        raise _Unreadable("several_objects")
    return answers[0]


def _around(text: str, spans: Sequence[tuple[int, int]], repairs: dict[Repair, None]) -> str:
    """Return what stands around the objects of a text, and note code fences and words in it."""
    around = "\n".join(
        text[end:start] for (_, end), (start, _) in zip([(0, 0), *spans], [*spans, (None, 0)], strict=True)
    )
    if _FENCE.search(around):
        repairs["code_fence"] = None
    if _FENCE.sub("", around).strip():
        repairs["text_around"] = None
    return around


def _spans(text: str) -> Iterator[tuple[int, int]]:
    """Yield where the outermost braces of a text begin and end; braces in a string are text."""
    depth, start, quoted, escaped = 0, 0, False, False
    for place, sign in enumerate(text):
        if escaped:
            escaped = False
        elif quoted:
            escaped, quoted = sign == "\\", sign != '"'
        elif sign == '"':
            quoted = depth > 0
        elif sign == "{":
            start = start if depth else place
            depth += 1
        elif sign == "}" and depth:
            depth -= 1
            if not depth:
                yield start, place + 1


def _loaded(text: str, repairs: dict[Repair, None]) -> Sequence[tuple[str, object]] | None:
    """Return the fields of the JSON object that a text is, its commas mended where it needs that, or None."""
    try:
        return _json(text)
    except ValueError:
        mended = _STRING_OR_COMMA.sub(lambda match: match.group(1) or "", text)
    try:
        found = _json(mended)
    except ValueError:
        return None
    repairs["trailing_comma"] = None
    return found


def _json(text: str) -> Sequence[tuple[str, object]]:
    """Return a JSON object's fields; raises ValueError for what is none, _Unreadable for one that contradicts itself.

    Objects within it become lists, which no field may be.
    """

    def no_number(word: str) -> object:
        raise ValueError(f"{word} is no JSON")

    if too_deep(text):
        raise ValueError("it is nested too deeply")
    pairs: list[tuple[str, object]] = json.loads(text, object_pairs_hook=list, parse_constant=no_number)
    found: dict[str, object] = {}
    for name, value in pairs:
        if name in FIELDS and name in found and _differ(found[name], value):
            raise _Unreadable("contradictory")
        found[name] = value
    return pairs


def _differ(one: object, other: object) -> bool:
    """Return whether two values of a field differ; true is not 1, and what is no field's value is not looked into."""
    if isinstance(one, list) or isinstance(other, list):
        return not (isinstance(one, list) and isinstance(other, list))
    return one != other or isinstance(one, bool) != isinstance(other, bool)


def _estimate(values: Mapping[str, object]) -> Estimate:
    if any(name not in values for name in FIELDS):
        raise _Unreadable("missing_field")
    gap = values["lead_gap_m"]
    return Estimate(
        gap_m=None if gap is None else _number(gap, MOST_GAP_M),
        close=_flag(values["close"]),
        left_clear=_flag(values["left_clear"]),
        right_clear=_flag(values["right_clear"]),
        confidence=_number(values["confidence"], 1.0),
    )


def _believed(found: Estimate, beside: Beside) -> Estimate:
    if beside.failed:
        raise _Unreadable("says_error")
    return found


def _flag(value: object) -> bool:
    if not isinstance(value, bool):
        raise _Unreadable("wrong_type")
    return value


def _number(value: object, most: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise _Unreadable("wrong_type")
    if not (0 <= value <= most) or not math.isfinite(value):
        raise _Unreadable("out_of_range")
    return float(value) + 0.0
