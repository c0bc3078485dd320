"""Motions: kept to the byte, read strictly, measured in units of scale, and reflected as the world is."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from eyechart.calls import Reply
from eyechart.errors import SpecError
from eyechart.spaces.motion import Dimension, Motion, MotionSpace, reflect

REACH = MotionSpace(
    "reach",
    (Dimension("dx", along="x", sign=-1), Dimension("dy", scale=2.0, along="y"), Dimension("grip")),
    horizon=8,
    mirrored=True,
)
ARMS = MotionSpace(
    "arms",
    (Dimension("left", mirrors="right", state=0, sign=-1), Dimension("right", mirrors="left", state=1, sign=-1)),
    horizon=4,
    kind="absolute",
    state=(Dimension("left", mirrors="right", sign=-1), Dimension("right", mirrors="left", sign=-1)),
    mirrored=True,
)


def reply(given: object) -> Reply:
    """Return what a ledger keeps of an answer."""
    return Reply(Motion.of(given).text, "stop")


@settings(max_examples=60, deadline=None)
@given(
    hnp.arrays(
        st.sampled_from([np.float16, np.float32, np.float64, np.int32]),
        hnp.array_shapes(max_dims=3, max_side=6),
        elements={"min_value": -100, "max_value": 100},
    )
)
def test_a_motion_comes_back_to_the_byte(array: np.ndarray) -> None:
    """Whatever its shape and type; its text is plain JSON."""
    motion = Motion.of(array)
    again = Motion.read(motion.text)
    assert again == motion
    assert (again.array == array).all()
    assert json.loads(motion.text)["motion"]["shape"] == list(array.shape)


def test_the_digest_is_of_the_bytes() -> None:
    """A byte that was changed, and a shape that does not fit, are found out."""
    kept = json.loads(Motion.of(np.zeros((2, 2), np.float32)).text)
    for name, value in (("base64", "AAAA"), ("sha256", "0"), ("shape", [2, 3]), ("shape", [2**40, 2**40])):
        changed = {"motion": {**kept["motion"], name: value}}
        with pytest.raises(ValueError, match="other_bytes"):
            Motion.read(json.dumps(changed))
    for text in ("", "[1, 2]", '{"motion": 3}', json.dumps({"motion": {**kept["motion"], "type": "|O"}})):
        with pytest.raises(ValueError, match="not_a_motion"):
            Motion.read(text)


@pytest.mark.parametrize(
    ("given", "why"),
    [
        (np.zeros((4, 3)), "wrong_shape"),
        (np.zeros((1, 8, 3)), "wrong_shape"),
        (np.full((8, 3), np.nan), "not_finite"),
        (np.full((8, 3), np.inf), "not_finite"),
    ],
)
def test_what_is_no_motion_of_the_space_is_none_and_says_why(given: np.ndarray, why: str) -> None:
    """Half a chunk, another layout, and what is no number."""
    found = REACH.read(reply(given))
    assert (found.action, found.missing, found.why) == (None, "unparsed", why)
    assert REACH.read(Reply(error="timeout")).missing == "error"
    assert REACH.read(Reply("SLOW", "stop")).why == "not_a_motion"
    assert REACH.read(Reply("", "stop")).missing == "empty"


@pytest.mark.parametrize(
    ("shape", "words"),
    [
        ((1, 8, 3), "return the chunk alone, without the axis of the batch: [0]"),
        ((1, 4, 3), "[0]; then return 8 steps, or import the bank with --horizon 4"),
        ((4, 3), "return 8 steps, or import the bank with --horizon 4"),
        ((3, 8), "return it with the steps first: .T"),
        ((24,), "return it as .reshape(8, 3)"),
        ((3,), "return all 8 steps of the chunk, not one of them"),
        ((8, 2), "a step of the bank has 3 numbers: dx, dy, grip"),
        ((8, 32), "a step of the bank has 3 numbers: dx, dy, grip; if the others pad them, return [:, :3]"),
        (
            (1, 8, 32),
            "[0]; then a step of the bank has 3 numbers: dx, dy, grip; if the others pad them, return [:, :3]",
        ),
        ((50, 32), "return [:, :3]; then return 8 steps, or import the bank with --horizon 50"),
        ((3, 16), "return an array of 8 steps of 3 numbers"),
        ((), "return an array of 8 steps of 3 numbers"),
    ],
)
def test_another_shape_is_said_with_what_to_do_about_it(shape: tuple[int, ...], words: str) -> None:
    """The reason that is counted stays one word; a motion lacks nothing, and an error has words of its own."""
    said = REACH.lacks(reply(np.zeros(shape)))
    assert said.startswith(f"its shape is {shape}, and that of the bank's motions (8, 3): ")
    assert said.endswith(words)
    assert REACH.lacks(reply(np.full((8, 3), np.nan))).startswith("some of its values are not numbers (NaN, infinite")
    assert REACH.lacks(Reply("", "stop")) == "it is empty"
    assert REACH.lacks(reply(np.zeros((8, 3)))) == REACH.lacks(Reply(error="timeout")) == ""


@pytest.mark.parametrize("given", ["left", None, object(), [[1], [2, 3]], np.zeros(3, complex), np.zeros(200_000)])
def test_what_holds_no_numbers_is_refused_in_words(given: object) -> None:
    """Before it reaches a ledger."""
    with pytest.raises(ValueError, match="array"):
        Motion.of(given)


def test_a_distance_is_in_units_of_scale() -> None:
    """By hand: dy differs by 2 of scale 2 in every step, so the mean over three dimensions is 1/3."""
    one, other = np.zeros((8, 3)), np.zeros((8, 3))
    other[:, 1] = 2.0
    assert REACH.distance(Motion.of(one), Motion.of(other)) == pytest.approx(np.sqrt(1 / 3))
    logged = np.random.default_rng(0).normal(0, [3, 1, 0], (500, 8, 3))
    assert REACH.scales(logged) == pytest.approx([3, 2, 1], rel=0.05)


def test_places_are_measured_relative_to_their_state() -> None:
    """Each number from its own of the state; deltas are not touched."""
    numbers, states = np.ones((5, 4, 2)), np.column_stack([np.arange(5.0), np.zeros(5)])
    found = ARMS.relative(numbers, states)
    assert found[3, 0].tolist() == [-2.0, 1.0]
    assert (REACH.relative(np.ones((5, 8, 3)), states) == 1).all()


def test_displacement_is_how_far_it_goes_along_an_axis() -> None:
    """Deltas add up; nothing is along an axis that no dimension is along."""
    motion = Motion.of(np.tile([0.5, -1.0, 1.0], (8, 1)))
    assert REACH.project(motion, "x") == 4.0
    assert REACH.project(motion, "y") == -8.0
    assert REACH.project(motion, "z") is None
    speeds = MotionSpace("speed", (Dimension("vx", along="x"),), 4, "velocity", rate_hz=2.0)
    assert speeds.project(Motion.of(np.ones((4, 1))), "x") == 2.0
    places = MotionSpace("place", (Dimension("x", along="x"),), 3, "waypoints")
    assert places.project(Motion.of([[1], [2], [5]]), "x") == 5.0


@settings(max_examples=30, deadline=None)
@given(hnp.arrays(np.float64, (4, 2), elements=st.floats(-10, 10)))
def test_reflecting_twice_is_the_same_motion(numbers: np.ndarray) -> None:
    """Dimensions that exchange places, with or without a sign."""
    once = ARMS.reflect(Motion.of(numbers))
    assert once.array == pytest.approx(-numbers[:, ::-1])
    assert ARMS.reflect(once).array == pytest.approx(numbers)


def test_what_cannot_be_a_space_is_refused() -> None:
    """Each with what is wrong."""
    for made, words in (
        (lambda: MotionSpace("m", (Dimension("a", mirrors="b"),), 1), "must be there"),
        (lambda: MotionSpace("m", (Dimension("a"), Dimension("a")), 1), "one name"),
        (lambda: MotionSpace("m", (), 1), "needs a horizon"),
        (lambda: MotionSpace("m", (Dimension("a", state=2),), 1), "which has no such number"),
        (lambda: Dimension("a", scale=0.0), "scale above 0"),
        (lambda: Dimension("a", sign=2.0), "sign 1 or -1"),
    ):
        with pytest.raises(SpecError, match=words):
            made()


def test_a_reflection_commutes_with_measuring_from_the_state() -> None:
    """Reflected places less reflected states are the reflected differences, whatever they are reflected about."""
    names = (("left", "right", 1, -1.0, 0.0), ("right", "left", 0, -1.0, 0.0), ("x", "", 2, -1.0, 0.5))
    places = tuple(Dimension(one, mirrors=other, sign=sign, about=at) for one, other, _, sign, at in names)
    own = tuple(replace(place, state=number) for place, (_, _, number, _, _) in zip(places, names, strict=True))
    space = MotionSpace("arms", own, 2, "absolute", state=(places[1], places[0], places[2]), mirrored=True)
    rng = np.random.default_rng(0)
    motions, states = rng.normal(size=(5, 2, 3)), rng.normal(size=(5, 3))
    there = space.relative(reflect(motions, space.dimensions), reflect(states, space.state))
    assert space.reflect_relative(space.relative(motions, states)) == pytest.approx(there)
    assert reflect(reflect(motions, space.dimensions), space.dimensions) == pytest.approx(motions)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"sign": 1.0}, "need one sign and about"),
        ({"about": 0.5}, "need one sign and about"),
    ],
)
def test_a_reflection_that_is_none_is_refused(change: dict[str, float], said: str) -> None:
    """The reflection of the reflection is the number itself, in one space and in its state."""
    other = replace(ARMS.dimensions[1], **change)  # type: ignore[arg-type]
    with pytest.raises(SpecError, match=said):
        replace(ARMS, dimensions=(ARMS.dimensions[0], other))


def test_a_place_is_reflected_as_its_number_of_the_state() -> None:
    """Else what is measured from it would be measured from another place there."""
    with pytest.raises(SpecError, match="reflected 'left' must be measured relative to the reflected 'left'"):
        replace(ARMS, state=(Dimension("left"), Dimension("right")))


def test_an_instruction_exchanges_its_words_whole_and_keeps_its_capitals() -> None:
    """Twice is the text itself; a word inside another stays."""
    space = replace(REACH, words=(("left", "right"), ("port", "starboard")))
    said = "Left arm: put the LEFT cup right of the bright leftover, to port"
    there = "Right arm: put the RIGHT cup left of the bright leftover, to starboard"
    assert space.reflect_text(said) == there
    assert space.reflect_text(there) == said
    assert REACH.reflect_text(said) == said


def test_one_step_without_its_axis_is_told_how_to_get_it() -> None:
    """Of a horizon of 1 the steps are not missing, the axis is; and no horizon of 0 is advised."""
    space = MotionSpace("one", tuple(Dimension(name) for name in "abc"), 1)
    said = space.lacks(Reply(text=Motion.of(np.zeros(3)).text))
    assert ".reshape(1, 3)" in said
    assert "--horizon" not in space.lacks(Reply(text=Motion.of(np.zeros((0, 3))).text))
