"""Scene estimates of one picture, and the fixed policy that turns one into an action.

A model's estimate is read strictly: its syntax is repaired, its content never. Source: paper,
section Constructive renderer-calibrated controller.
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
    SpaceDefaults,
    is_too_deep,
    refuses,
    thinks_behind,
    why_unanswered,
    without_thinking,
)

CLOSE_GAP_M = 18.0
"""A nearer lead is close (paper, section The Input-Ablation Battery). Measuring from centre to
centre is eyechart's choice."""

STOP_GAP_M = 12.0
"""With a nearer lead the safe action is STOP, whatever the sides."""

FREE_GAP_M = 40.0
"""From this gap on the road is free (the scripted geometric controller of Table t:baselines)."""

CLEAR_BEHIND_M = 12.0
CLEAR_AHEAD_M = 40.0
"""A side is clear if its lane exists without a vehicle centre from 12 m behind to 40 m ahead."""


SCENE_READER = 4
"""The version of these rules, which a run records and is read by."""

_TRUSTING = 3
SCENE_READERS = (_TRUSTING, SCENE_READER)
"""The versions that can read a scene; 3 accepts an estimate even if the answer reports a failure.
"""

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
"""The JSON schema of an estimate, without number bounds, which some servers refuse."""

Unscened = Literal[
    "no_object",  # the text holds no braces
    "malformed",  # no JSON in braces even after repairs, or more than 100 levels
    "several_objects",  # two estimates that differ
    "contradictory",  # a field is given twice with different values
    "missing_field",
    "wrong_type",  # a word or a number for true or false, a word for a number
    "out_of_range",  # a gap below 0 or above 1000 m, a confidence outside 0 to 1
    "says_error",  # an estimate, but the answer reports a failure or no picture
    "too_long",  # longer than the reading limit; its end might differ
]
"""Why a reply in words holds no estimate."""

Repair = Literal["code_fence", "text_around", "trailing_comma"]
"""The repairs of a reply's syntax: code fences or words around the object, trailing commas."""

REPAIRS: tuple[Repair, ...] = ("code_fence", "text_around", "trailing_comma")

_FENCE = re.compile(r"```[\w-]*")
_STRING_OR_COMMA = re.compile(r'("(?:[^"\\]|\\.)*")|,(?=\s*[}\]])', re.DOTALL)
_OBJECTS_AT_MOST = 100


HIGHWAY = Distances(STOP_GAP_M, CLOSE_GAP_M, FREE_GAP_M, CLEAR_BEHIND_M, CLEAR_AHEAD_M)
"""eyechart's values, for 20 to 30 m/s and centre to centre; the paper prints only the 18 m."""


class Other(NamedTuple):
    """Another vehicle or obstacle: its distance ahead and to the right, in metres."""

    ahead_m: float
    aside_m: float

    def mirrored(self) -> "Other":
        """Return it in the flipped picture."""
        return Other(self.ahead_m, -self.aside_m)


@dataclass(frozen=True, slots=True)
class Scene:
    """The content of a picture that a controller needs.

    ``gap_m`` is the distance in metres to the nearest vehicle or obstacle ahead in the own lane, as
    its world measures it, or None. ``left_clear`` and ``right_clear`` are from the driver's view.
    ``distances`` are the world's.
    """

    gap_m: float | None
    left_clear: bool
    right_clear: bool
    distances: Distances = HIGHWAY

    @property
    def is_close(self) -> bool:
        """Return whether a lead is nearer than the world's threshold, 18 m on a highway."""
        return self.gap_m is not None and self.gap_m < self.distances.close_m

    @property
    def is_free(self) -> bool:
        """Return whether the road ahead is free."""
        return self.gap_m is None or self.gap_m >= self.distances.free_m

    @property
    def is_blocked(self) -> bool:
        """Return whether the lead is so near that the safe action is to stop."""
        return self.gap_m is not None and self.gap_m < self.distances.stop_m

    def mirrored(self) -> "Scene":
        """Return the scene in the reflection across the lane axis."""
        return replace(self, left_clear=self.right_clear, right_clear=self.left_clear)


def safe_action(scene: Scene) -> str:
    """Return the action of a fixed safety policy that is exactly equivariant under reflection.

    It is STRAIGHT on a free road, STOP with a very near lead, the clear side if exactly one is
    clear, and otherwise SLOW. With both sides clear it is SLOW too, because a choice between them
    would be a prior.
    """
    if scene.is_free:
        return "STRAIGHT"
    if scene.is_blocked:
        return "STOP"
    if scene.left_clear != scene.right_clear:
        return "LEFT" if scene.left_clear else "RIGHT"
    return "SLOW"


@dataclass(frozen=True, slots=True)
class Estimate:
    """A model's estimate of a picture's scene; ``gap_m`` None means no lead.

    ``close`` is the model's own, and may contradict its gap.
    """

    gap_m: float | None
    close: bool
    left_clear: bool
    right_clear: bool
    confidence: float

    @classmethod
    def of(cls, scene: Scene, confidence: float = 1.0) -> "Estimate":
        """Return a scene as a consistent estimate."""
        return cls(scene.gap_m, scene.is_close, scene.left_clear, scene.right_clear, confidence)

    def disagrees(self, distances: Distances = HIGHWAY) -> bool:
        """Return whether ``close`` contradicts the gap."""
        return self.close != (self.gap_m is not None and self.gap_m < distances.close_m)

    def act(self, distances: Distances = HIGHWAY) -> str:
        """Return the safe action of the scene; if ``close`` and gap disagree, the more cautious.

        A close lead without a gap, or with one that is not close, counts as a lead at the threshold
        (18 m on a highway). It is never STRAIGHT, and STOP only if a gap says so. A nearer gap
        counts whatever ``close`` says. It is exactly equivariant under reflection. ``distances``
        are the world's.
        """
        free = self.gap_m is None or self.gap_m >= distances.close_m
        gap_m = distances.close_m if self.close and free else self.gap_m
        return safe_action(Scene(gap_m, self.left_clear, self.right_clear, distances))

    def mirrored(self) -> "Estimate":
        """Return the estimate of the reflected scene."""
        return replace(self, left_clear=self.right_clear, right_clear=self.left_clear)

    def __str__(self) -> str:
        """Return the estimate as a JSON text that reads back as itself."""
        values = asdict(self)
        return json.dumps({"lead_gap_m": values.pop("gap_m"), **values})


class SurroundingText(NamedTuple):
    """The other content of a reply with an estimate, without thinking.

    ``before`` and ``after`` surround its first and last of ``objects`` objects; ``names`` are all
    their field names with repetitions. ``thinking_after`` says that it thinks again after the
    first, ``failed`` that a field or the words report a failure.
    """

    before: str
    after: str
    objects: int
    names: tuple[str, ...]
    thinking_after: bool
    failed: bool


@dataclass(frozen=True, slots=True)
class SceneDecision(Decision[Estimate]):
    """An estimate, or the reason for none, and the repairs of the reply's syntax.

    ``beside`` is the other content of a reply with an estimate.
    """

    repairs: tuple[Repair, ...] = ()
    beside: SurroundingText | None = field(default=None, compare=False)


@dataclass(frozen=True, slots=True)
class SceneSpace(SpaceDefaults):
    """A space whose actions are scene estimates; the world executes their safe action.

    ``distances`` are the world's. ``reader`` is the version of the reading rules, and no part of
    the space.
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
        """Return the estimate in a reply; see `_read` for the rules."""
        return _read(self.reader, reply.text, reply.finish_reason, reply.error)

    def distance(self, one: Estimate, other: Estimate) -> float:
        """Return 0 if two estimates agree in everything but confidence, else 1."""
        return float(replace(one, confidence=0.0) != replace(other, confidence=0.0))

    def project(self, action: Estimate, axis: str) -> float | None:
        """Return how hard an estimate's safe action brakes; None for any axis but ``brake``."""
        return DRIVING.project(self.symbol(action), axis)

    def reflect(self, action: Estimate) -> Estimate:
        """Return the estimate of the reflected scene."""
        return action.mirrored()

    def symbol(self, action: Estimate) -> str:
        """Return the safe action of an estimate."""
        return action.act(self.distances)

    def role(self, symbol: str) -> str:
        """Return the role of a safe action in the gap tests."""
        return DRIVING.role(symbol)

    def written(self) -> dict[str, object]:
        """Return the mark of a prompt for scenes."""
        return {"scene": True}

    def by(self, reader: int) -> "SceneSpace":
        """Return the space with this version of the reading rules; unchanged if it is unknown."""
        return replace(self, reader=reader) if reader in SCENE_READERS else self

    def in_world(self, distances: Distances) -> "SceneSpace":
        """Return the space of a world with these distances."""
        return replace(self, distances=distances)


SCENES = SceneSpace()


class _Unreadable(Exception):  # noqa: N818 - no error: it says why a reply holds no estimate
    def __init__(self, why: Unscened) -> None:
        super().__init__(why)
        self.why = why


@lru_cache(maxsize=_READINGS_KEPT)
def _read(rules: int, text: str, finish_reason: str | None, error: str | None) -> SceneDecision:
    """Read the scene estimate from a reply's verbatim text: strictly, and never guessing.

    First, an error, a cut-off (``length``) or a filter's refusal is the reason for none. Then text
    in ``<think>`` is removed, and the JSON object in the rest is read. Unknown fields are ignored.
    But a field or words that report a failure are believed, except by version 3 of the ``rules``.
    An answer longer than `READ_AT_MOST` is not read at all, because a part may differ from the
    whole; thinking may be longer.
    """
    if (missing := why_unanswered(finish_reason, error)) is not None:
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


def _only_one(text: str, repairs: dict[Repair, None]) -> tuple[dict[str, object], SurroundingText]:
    """Return the one object of a text and the other content; records repairs.

    Raises _Unreadable if there is not exactly one.
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
        raise _Unreadable("malformed")  # the broken estimate may correct the whole one
    beside = SurroundingText(
        before=text[: spans[0][0]],
        after=text[spans[-1][1] :],
        objects=len(spans),
        names=tuple(name for one in objects for name, _ in one),
        thinking_after=False,
        failed=says_no_picture(around) or any(says_failed(one, FIELDS) for one in objects),
    )
    return _agreed([dict(one) for one in objects]), beside


def _agreed(objects: Sequence[dict[str, object]]) -> dict[str, object]:
    """Return the first estimate among objects, or the first; raises _Unreadable if two differ."""
    answers = [one for one in objects if any(name in one for name in FIELDS)] or objects[:1]
    if any(_differs(answers[0].get(name), answer.get(name)) for answer in answers[1:] for name in FIELDS):
        raise _Unreadable("several_objects")
    return answers[0]


def _around(text: str, spans: Sequence[tuple[int, int]], repairs: dict[Repair, None]) -> str:
    """Return the text around the objects; record code fences and words in it."""
    around = "\n".join(
        text[end:start] for (_, end), (start, _) in zip([(0, 0), *spans], [*spans, (None, 0)], strict=True)
    )
    if _FENCE.search(around):
        repairs["code_fence"] = None
    if _FENCE.sub("", around).strip():
        repairs["text_around"] = None
    return around


def _spans(text: str) -> Iterator[tuple[int, int]]:
    """Yield the spans of the outermost braces of a text; braces in a string do not count."""
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
    """Return the fields of a JSON object, its commas repaired if necessary, or None."""
    try:
        return _json(text)
    except ValueError:
        mended = _STRING_OR_COMMA.sub(lambda match: match.group(1) or "", text)
    try:
        result = _json(mended)
    except ValueError:
        return None
    repairs["trailing_comma"] = None
    return result


def _json(text: str) -> Sequence[tuple[str, object]]:
    """Return a JSON object's fields; raises ValueError if it is none.

    Raises _Unreadable for contradictory fields. Objects within it become lists, which no field may
    be.
    """

    def no_number(word: str) -> object:
        raise ValueError(f"{word} is no JSON")

    if is_too_deep(text):
        raise ValueError("it is nested too deeply")
    pairs: list[tuple[str, object]] = json.loads(text, object_pairs_hook=list, parse_constant=no_number)
    found: dict[str, object] = {}
    for name, value in pairs:
        if name in FIELDS and name in found and _differs(found[name], value):
            raise _Unreadable("contradictory")
        found[name] = value
    return pairs


def _differs(one: object, other: object) -> bool:
    """Return whether two values of a field differ; true is not 1, and lists are all equal."""
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


def _believed(estimate: Estimate, beside: SurroundingText) -> Estimate:
    if beside.failed:
        raise _Unreadable("says_error")
    return estimate


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
