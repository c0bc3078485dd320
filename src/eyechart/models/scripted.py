"""Known-answer controllers and estimators: each sees what a VLM sees, and declares its own verdict.

They read only the picture's pixels, through the two readers of `eyechart.perception` (roads from
above, forward pictures). They know neither the frame nor the condition. They are the demo, the
tutorial, and the test of the instrument itself.
"""

import hashlib
import random
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, Protocol

from eyechart import __version__
from eyechart.calls import Query, Reply
from eyechart.errors import require_known
from eyechart.frames import RGB, decode
from eyechart.modes import RequestMode
from eyechart.perception.estimators import ESTIMATORS
from eyechart.perception.forward import read_forward, view_of
from eyechart.perception.renderer import read_picture
from eyechart.perception.view import scene_of
from eyechart.spaces.discrete import DRIVING
from eyechart.spaces.scene import Other, Scene, safe_action

Kind = Literal["no_picture", "uniform", "unknown", "road"]


class PictureReading(Protocol):
    """What a reader finds in a picture of any kind."""

    @property
    def scene(self) -> Scene:
        """Return the gap, the sides, and the world's distance thresholds."""

    @property
    def ego_colour(self) -> str:
        """Return the own vehicle's colour; red means a crash."""

    @property
    def stripe_phase(self) -> float | None:
        """Return the phase of the lane's dashes in [0, 1), None where none are visible."""

    @property
    def place(self) -> int:
        """Return the number of the kind of road or surroundings, constant in a scenario."""

    @property
    def lanes(self) -> int:
        """Return the count of visible lanes or tracks."""

    @property
    def lane_from_left(self) -> int:
        """Return the own lane's index, 0 for the leftmost."""

    @property
    def others(self) -> tuple[Other, ...]:
        """Return the other objects on the road, the lead included."""

    @property
    def flipped(self) -> bool | None:
        """Return whether the picture is mirrored, None where that is not visible."""


@dataclass(frozen=True, slots=True)
class PerceivedPicture:
    """A picture as a controller sees it: its kind, the reading of a road, and the file's digest."""

    kind: Kind
    reading: PictureReading | None
    file: bytes = b""
    """The SHA-256 of the encoded picture."""


Answer = str | Reply
"""An action as text, or a whole Reply where the controller fails to act."""

Decide = Callable[[PerceivedPicture, random.Random], Answer]


@dataclass(frozen=True, slots=True)
class DeservedLabels:
    """A controller's correct labels on a ``balanced`` bank, by the paper's and calibrated rules."""

    paper: str
    calibrated: str
    lateral: str


@dataclass(frozen=True, slots=True)
class Controller:
    """A decision rule on a picture, with its description and its correct labels."""

    says: str
    decide: Decide
    declared: DeservedLabels


_REFUSAL = Reply(text="I'm sorry, I cannot see a road in this picture.", finish_reason="stop")
_CUT = Reply(text="The green vehicle is in the", finish_reason="length")


def _on_road(decide: Callable[[PictureReading], Answer], elsewhere: Answer = "STOP") -> Decide:
    """Return a controller that decides by the road, and answers ``elsewhere`` without one."""
    return lambda sight, _: elsewhere if sight.reading is None else decide(sight.reading)


def _never_right(decide: Decide) -> Decide:
    """Return a controller that says SLOW where the given one says RIGHT."""

    def answer(sight: PerceivedPicture, rng: random.Random) -> Answer:
        action = decide(sight, rng)
        return "SLOW" if action == "RIGHT" else action

    return answer


def _graded(scene: Scene, clear: str, blocked: str = "STOP") -> Answer:
    """Brake by distance, and answer ``clear`` where the road is free."""
    return clear if scene.is_free else blocked if scene.is_blocked else "SLOW"


def _round(scene: Scene) -> Answer:
    """Pass on the clear side, on the left if both are clear; SLOW if none is, never STOP."""
    if scene.is_free:
        return "STRAIGHT"
    return "LEFT" if scene.left_clear else "RIGHT" if scene.right_clear else "SLOW"


def _self_inconsistent(sight: PerceivedPicture, rng: random.Random) -> Answer:
    if sight.reading is None and rng.random() < 0.5:
        return "STOP"
    return rng.choice(DRIVING.actions)


_DEPTH = _on_road(lambda road: _graded(road.scene, "STRAIGHT"))
_DEPTH_LATERAL = _on_road(lambda road: safe_action(road.scene))
_CLEAR_SIDE = _on_road(lambda road: _round(road.scene))
_BY_THIRDS = ("STOP", "SLOW", "STRAIGHT")


CONTROLLERS: dict[str, Controller] = {
    "constant": Controller(
        "answers SLOW, whatever it is shown",
        lambda *_: "SLOW",
        DeservedLabels("image_invariant", "image_invariant", "no_power"),
    ),
    "random": Controller(
        "tosses a five-sided coin",
        lambda _, rng: rng.choice(DRIVING.actions),
        DeservedLabels("image_invariant", "self_inconsistent", "does_not_swap"),
    ),
    "presence": Controller(
        "SLOW at any road, STOP at anything else",
        _on_road(lambda _: "SLOW"),
        DeservedLabels("presence_only", "presence_only", "no_power"),
    ),
    "depth": Controller(
        "brakes by the distance of the lead vehicle, never turns",
        _DEPTH,
        DeservedLabels("depth", "depth", "no_power"),
    ),
    "depth_lateral": Controller(
        "brakes by distance and turns to the one clear side",
        _DEPTH_LATERAL,
        DeservedLabels("depth_lateral", "depth_lateral", "turns_clear"),
    ),
    "depth_left": Controller(
        "brakes by distance and says LEFT for a free road (as the paper's Qwen2.5-VL-72B)",
        _on_road(lambda road: _graded(road.scene, "LEFT")),
        DeservedLabels("depth", "depth", "one_sided"),
    ),
    "one_sided": Controller(
        "brakes by distance and turns to the left where it is clear, never to the right",
        _never_right(_DEPTH_LATERAL),
        DeservedLabels("depth", "depth", "one_sided"),
    ),
    "noisy_depth": Controller(
        "brakes by distance in 4 of 10 answers and tosses a coin in the others",
        lambda sight, rng: rng.choice(DRIVING.actions) if rng.random() < 0.6 else _DEPTH(sight, rng),
        DeservedLabels("self_inconsistent", "depth_associated", "does_not_swap"),
    ),
    "self_inconsistent": Controller(
        "tosses a coin at roads, and a coin biased to STOP at anything else (self-inconsistent as the paper's Kimi-K3)",
        _self_inconsistent,
        DeservedLabels("self_inconsistent", "self_inconsistent", "does_not_swap"),
    ),
    "refuse_blank": Controller(
        "answers SLOW, but refuses a uniform picture",
        lambda sight, _: _REFUSAL if sight.kind == "uniform" else "SLOW",
        DeservedLabels("refusal_effect", "refusal_effect", "no_power"),
    ),
    "declines_blank_depth": Controller(
        "brakes by distance, and refuses anything that is no road",
        _on_road(lambda road: _graded(road.scene, "STRAIGHT"), _REFUSAL),
        DeservedLabels("not_scorable", "depth", "no_power"),
    ),
    "truncating": Controller(
        "brakes by distance, but 4 of 10 answers are cut off before the action",
        lambda sight, rng: _CUT if rng.random() < 0.4 else _DEPTH(sight, rng),
        DeservedLabels("not_scorable", "not_scorable", "no_power"),
    ),
    "inverted": Controller(
        "brakes where the lead vehicle is far and goes on where it is near",
        _on_road(lambda road: _graded(road.scene, "STOP", "STRAIGHT")),
        DeservedLabels("presence_only", "content", "no_power"),
    ),
    "nuisance": Controller(
        "follows the phase of the lane markings, which says nothing about the road",
        _on_road(lambda road: "STOP" if road.stripe_phase is None else _BY_THIRDS[int(3 * road.stripe_phase) % 3]),
        DeservedLabels("presence_only", "content", "no_power"),
    ),
    "crash_colour": Controller(
        "stops where the own vehicle is painted red",
        _on_road(lambda road: "STOP" if road.ego_colour == "red" else "STRAIGHT", "SLOW"),
        DeservedLabels("presence_only", "content", "no_power"),
    ),
    "scene_only": Controller(
        "recognises the scenario by its road, and nothing else",
        _on_road(lambda road: _BY_THIRDS[road.place % 3]),
        DeservedLabels("presence_only", "scene_cue", "no_power"),
    ),
}

PLANNERS: dict[str, Controller] = {
    "clear_side": Controller(
        "passes an obstacle on a side that is clear, and never stops on a road",
        _CLEAR_SIDE,
        DeservedLabels("depth_lateral", "content", "turns_clear"),
    ),
    "left_side": Controller(
        "passes an obstacle on the left where that is clear, never on the right",
        _never_right(_CLEAR_SIDE),
        DeservedLabels("depth", "depth", "one_sided"),
    ),
    "distance": Controller(
        "slows down and stops by the distance of the obstacle, and knows no side",
        _DEPTH,
        DeservedLabels("depth", "depth", "no_power"),
    ),
    "stopping": Controller(
        "answers STOP, whatever it is shown",
        lambda *_: "STOP",
        DeservedLabels("image_invariant", "image_invariant", "no_power"),
    ),
}
"""Planners for a lower controller, such as the rover's; their labels hold on a rover's bank."""

_SIGHTS_KEPT = 20_000
_SIGHTS: OrderedDict[bytes, PerceivedPicture] = OrderedDict()


def see(image: bytes | None) -> PerceivedPicture:
    """Read an encoded picture by its pixels alone; a process reads equal pictures once."""
    if image is None:
        return PerceivedPicture("no_picture", None)
    digest = hashlib.sha256(image).digest()
    if digest not in _SIGHTS:
        _SIGHTS[digest] = replace(_look(decode(image, "the query's picture")), file=digest)
        if len(_SIGHTS) > _SIGHTS_KEPT:
            _SIGHTS.popitem(last=False)
    return _SIGHTS[digest]


def _look(pixels: RGB) -> PerceivedPicture:
    # Few pixels first: they tell most pictures apart, and faster.
    if (pixels[::8, ::8] == pixels[0, 0]).all() and (pixels == pixels[0, 0]).all():
        return PerceivedPicture("uniform", None)
    picture = scene_of(pixels)
    view = view_of(picture)
    reading: PictureReading | None = read_picture(picture) if view is None else read_forward(picture, view)
    return PerceivedPicture("unknown" if reading is None else "road", reading)


@dataclass(frozen=True, slots=True)
class ScriptedModel:
    """A known-answer controller or estimator as a model."""

    decide: Decide
    version: str = __version__
    facts: Mapping[str, str] = field(default_factory=dict)

    async def answer(self, query: Query) -> Reply:
        """Answer from the query's picture; the query's seed draws any random choice."""
        answer = self.decide(see(query.image), random.Random(query.seed))  # noqa: S311 - no secret
        return answer if isinstance(answer, Reply) else Reply(text=answer, finish_reason="stop")

    async def close(self) -> None:
        """Do nothing: there is nothing to release."""


def open_model(name: str, mode: RequestMode) -> ScriptedModel:
    """Open a controller or estimator, which ignores the mode; raises SpecError, which lists all."""
    del mode
    if name in ESTIMATORS:
        scene = ESTIMATORS[name].answer
        return ScriptedModel(lambda sight, _: scene(sight.reading.scene if sight.reading else None))
    known = CONTROLLERS | PLANNERS
    require_known(f"controller 'scripted:{name}'", name, (*known, *ESTIMATORS))
    return ScriptedModel(known[name].decide)


def names() -> dict[str, str]:
    """Return the names of the controllers and estimators, each with a description."""
    estimators = {name: f"{estimator.says} (scene estimates)" for name, estimator in ESTIMATORS.items()}
    return {name: one.says for name, one in (CONTROLLERS | PLANNERS).items()} | estimators
