"""The calibrated view: the same around every frame, exact in its scene, and readable in its reflection."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eyechart.errors import BankError, SpecError
from eyechart.frames import RGB, Stimulus, decode, encode
from eyechart.perception.view import VIEWS, find_view, scene_of, through, view_for

HIGHWAY, ROVER = VIEWS["highway"], VIEWS["rover"]
TOP, BOTTOM, LEFT, RIGHT = HIGHWAY.crop


def picture(seed: int) -> RGB:
    """Return a picture of noise, every pixel of which can be told from the others."""
    return np.random.default_rng(seed).integers(0, 256, (150, 600, 3), dtype=np.uint8)


@settings(max_examples=10)
@given(st.integers(0, 2**32))
def test_what_is_shown_comes_back_exactly(seed: int) -> None:
    """An estimator that undoes the view has the picture's own pixels, and grey where they were cut off."""
    pixels = picture(seed)
    restored = scene_of(decode(encode(HIGHWAY.show(pixels)), "view"))
    assert (restored[TOP:BOTTOM, LEFT:RIGHT] == pixels[TOP:BOTTOM, LEFT:RIGHT]).all()
    assert (restored[:, :LEFT] == 100).all()
    assert (restored[:TOP] == 100).all()


@pytest.mark.parametrize("name", [name for name, view in VIEWS.items() if view.axis == "horizontal"])
def test_a_forward_picture_comes_back_whole_from_between_its_rulers(name: str) -> None:
    """Nothing of it is cut off, its reflection exchanges left and right, and the words stay."""
    view = VIEWS[name]
    pixels = np.random.default_rng(0).integers(0, 256, (*view.shape, 3), dtype=np.uint8)
    shown, reflected = view.show(pixels), view.show(np.ascontiguousarray(pixels[:, ::-1]))
    assert (scene_of(shown) == pixels).all()
    assert (scene_of(reflected) == pixels[:, ::-1]).all()
    for around in (slice(0, view.above), slice(-view.below, None)):
        assert (shown[around] == reflected[around]).all()
    assert (shown[:, : view.beside] == reflected[:, : view.beside]).all()


def test_the_rulers_of_a_forward_view_stand_where_the_ground_is() -> None:
    """Eight metres ahead of an eye 1.2 m high, 160 pixels of focal length: 24 pixels below the horizon."""
    shown = ROVER.show(np.zeros((*ROVER.shape, 3), dtype=np.uint8))
    ticks = np.flatnonzero((shown[:, ROVER.beside - 33] == 0).all(axis=1))
    for metres in (2, 3, 4, 5, 8, 15):
        row = ROVER.above + 2 * (96 + 160 * 1.2 / metres)
        assert np.abs(ticks - row).min() <= 1


def test_only_the_scene_differs_between_frames_and_only_it_is_reflected() -> None:
    """No label is of a frame; legend, words and ruler stand as they are over and under the flipped scene."""
    one, other, flipped = (HIGHWAY.show(pixels) for pixels in (picture(0), picture(1), picture(0)[::-1]))
    scene = slice(HIGHWAY.above, HIGHWAY.size[0] - HIGHWAY.below)
    for around in (slice(0, scene.start), slice(scene.stop, None)):
        assert (one[around] == other[around]).all()
        assert (one[around] == flipped[around]).all()
        assert len(np.unique(one[around])) > 20
    assert (one[scene] == flipped[scene][::-1]).all()
    assert not (one[scene] == other[scene]).all()


def test_the_ruler_stands_where_the_vehicles_are() -> None:
    """A lead that is drawn 20 m ahead has its middle over the tick of 20 m, and the ego over that of 0 m."""
    pixels = np.full((150, 600, 3), 100, dtype=np.uint8)
    for metres in (0, 20):
        column = 180 + round(5.5 * metres)
        pixels[70:81, column - 14 : column + 13] = (200, 0, 0)  # 27 pixels, as highway-env draws a vehicle
    view = HIGHWAY.show(pixels)
    red = np.flatnonzero((view[HIGHWAY.above + 110] == (200, 0, 0)).all(axis=1))
    ego, lead = red[red < 300], red[red > 300]
    ticks = np.flatnonzero((view[HIGHWAY.above - 7] == 0).all(axis=1))
    for body, metres in ((ego, 0), (lead, 20)):
        middle = (body[0] + body[-1]) / 2
        assert np.abs(ticks - middle).min() <= 1
        assert middle == pytest.approx(183 + 11 * metres, abs=1)


def test_a_picture_of_another_size_is_refused_with_what_to_do() -> None:
    """The view is calibrated for one camera."""
    with pytest.raises(BankError, match=r"'f1' has 64×48 pixels.*is for 600×150.*--view none"):
        HIGHWAY.show(np.zeros((48, 64, 3), dtype=np.uint8), "f1")


def test_what_is_no_view_is_left_as_it_is() -> None:
    """A picture of another size, and one of the view's size with other words around it."""
    other = HIGHWAY.show(picture(0)).copy()
    other[0, 0] = 0
    for pixels in (picture(0), other):
        assert scene_of(pixels) is pixels


def test_a_view_that_cuts_off_one_side_more_is_refused() -> None:
    """Its reflection would show another part of the road."""
    with pytest.raises(SpecError, match="cuts off more on one side"):
        replace(HIGHWAY, crop=(20, 129, 88, 600))


def test_the_key_changes_with_any_change_of_the_definition() -> None:
    """And only with that; a run finds its view by it."""
    moved = replace(HIGHWAY, marks=(HIGHWAY.marks[0]._replace(colour=(1, 2, 3)), *HIGHWAY.marks[1:]))
    assert len({HIGHWAY.key, moved.key, replace(HIGHWAY, above=HIGHWAY.above + 1).key}) == 3
    assert replace(HIGHWAY).key == HIGHWAY.key
    assert find_view(HIGHWAY.key) is HIGHWAY
    assert find_view("none") is None
    with pytest.raises(SpecError, match="there is no view 'highway@00000000'"):
        find_view("highway@00000000")


def test_a_view_is_asked_for_by_name() -> None:
    """Calibrated where the simulator's pictures have one, none for pictures of one's own."""
    assert view_for("calibrated", "highway") is HIGHWAY
    assert view_for("none", "import") is None
    with pytest.raises(SpecError, match=r"no calibrated view of pictures from 'import'.*--view none"):
        view_for("calibrated", "import")
    with pytest.raises(SpecError, match="--view takes calibrated or none"):
        view_for("zoomed", "highway")


def test_no_view_and_no_picture_are_passed_through() -> None:
    """Byte for byte."""
    assert through(None, Stimulus.of(b"as it is")) == Stimulus.of(b"as it is")
    assert through(HIGHWAY, Stimulus()) == Stimulus()
