import math
from dataclasses import replace

import numpy as np
import pytest

from eyechart.cameras import HAZE, ROVER, Eye
from eyechart.frames import RGB
from eyechart.simulators.camera import Cylinder, RoadCamera

ORANGE, HOOD = (216, 84, 24), (50, 200, 0)


def scene(seed: int) -> tuple[Eye, list[Cylinder]]:
    """Return a random eye among up to eight random cylinders, some of them lower than the eye or above the ground."""
    rng = np.random.default_rng(seed)

    def between(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    bodies = [
        Cylinder(
            x=between(-2, 30),
            y=between(-5, 5),
            radius=between(0.2, 0.9),
            height=between(0.4, 2.5),
            colour=tuple(rng.integers(0, 256, 3).tolist()),
            base=float(rng.choice([0.0, 0.7])),
        )
        for _ in range(rng.integers(9))
    ]
    return Eye(between(0, 200), between(-4, 4), between(0.4, 3), between(-0.6, 0.6)), bodies


@pytest.mark.parametrize("sizes", [(320, 240, 160.0, 96), (160, 120, 80.0, 48), (101, 75, 60.0, 30)])
def test_a_mirrored_world_renders_to_the_flipped_picture(sizes: tuple[int, int, float, int]) -> None:
    """Not one of the pixels of 100 random scenes differs."""
    width, height, focal_px, horizon = sizes
    camera = RoadCamera(replace(ROVER, width=width, height=height, focal_px=focal_px, horizon=horizon))
    for seed in range(100):
        eye, bodies = scene(seed)
        picture = camera.draw(eye, bodies, hood=HOOD)
        mirrored = camera.draw(eye.mirrored(), [body.mirrored() for body in reversed(bodies)], hood=HOOD)
        np.testing.assert_array_equal(mirrored, picture[:, ::-1])


def test_a_camera_that_drew_before_draws_what_a_new_one_draws() -> None:
    """The ground that it keeps is that of the eye alone, whatever stood on it and wherever the eye was since."""
    camera = RoadCamera()
    for seed in range(10):
        (eye, bodies), (other, others) = scene(seed), scene(seed + 100)
        for seen, shown in ((eye, bodies), (eye, others), (eye, []), (other, others), (eye, bodies)):
            np.testing.assert_array_equal(camera.draw(seen, shown), RoadCamera().draw(seen, shown))


def rows_of(picture: RGB, column: int) -> np.ndarray:
    """Return the rows of a column in which the picture shows orange: a colour, and more red than blue."""
    pixels = picture[:, column].astype(int)
    return np.flatnonzero(pixels[:, 0] - pixels[:, 2] > 40)


@pytest.mark.parametrize("yaw", [0.0, 0.2])
@pytest.mark.parametrize("away", [3.0, 7.0, 16.0])
def test_a_cylinder_stands_where_the_pinhole_says(away: float, yaw: float) -> None:
    """Its foot, top and sides lie where similar triangles put them, to a pixel."""
    eye = Eye(50.0, 0.5, 1.2, yaw)
    ahead, aside = away * np.cos(yaw), away * np.sin(yaw)
    body = Cylinder(50.0 + ahead, 0.5 + aside, 0.5, 2.0, ORANGE)
    picture = RoadCamera().draw(eye, [body])
    rows = rows_of(picture, ROVER.width // 2)
    near = away - body.radius
    assert rows.max() + 1 == pytest.approx(ROVER.horizon + ROVER.focal_px * 1.2 / near, abs=1)
    assert rows.min() == pytest.approx(max(0, ROVER.horizon - ROVER.focal_px * 0.8 / near), abs=1)
    seen = np.flatnonzero([rows_of(picture, column).size for column in range(ROVER.width)])
    half = np.tan(np.arcsin(body.radius / away)) * ROVER.focal_px
    assert (seen.min(), seen.max() + 1) == pytest.approx((160 - half, 160 + half), abs=1.5)


def test_the_nearer_body_hides_the_farther_one() -> None:
    """Whatever their sizes and whichever is named first."""
    wide, thin = Cylinder(9.0, 2.6, 2.5, 3.0, (0, 0, 200)), Cylinder(6.5, 0.3, 0.2, 1.0, ORANGE)
    camera, eye = RoadCamera(), Eye(0.0, 0.0)
    one, other = camera.draw(eye, [wide, thin]), camera.draw(eye, [thin, wide])
    np.testing.assert_array_equal(one, other)
    assert rows_of(one, 160 - round(160 * 0.3 / 6.5)).size > 20


def test_a_body_behind_the_eye_or_around_it_is_not_drawn() -> None:
    """The picture is that of an empty road."""
    eye = Eye(10.0, 0.0)
    behind, around = Cylinder(5.0, 0.0, 0.5, 2.0, ORANGE), Cylinder(10.1, 0.0, 0.5, 2.0, ORANGE)
    np.testing.assert_array_equal(RoadCamera().draw(eye, [behind, around]), RoadCamera().draw(eye))


def test_everything_fades_with_distance() -> None:
    """A body far away is nearer to the colour of haze than the same body near."""
    shades = []
    for away in (4.0, 12.0, 40.0):
        picture = RoadCamera().draw(Eye(0.0, 0.0), [Cylinder(away, 0.0, 0.8, 2.0, ORANGE)])
        shades.append(np.abs(picture[96, 160].astype(int) - HAZE).sum())
    assert shades == sorted(shades, reverse=True)
    assert shades[0] > 1.5 * shades[2]


def test_the_road_is_grey_between_its_edges_and_the_verge_is_not() -> None:
    """What has a colour on the road stands on it; the edges lie where the pinhole puts them, at any offset and yaw."""
    for y, yaw in ((0.0, 0.0), (2.0, 0.1), (-1.5, -0.2)):
        picture = RoadCamera().draw(Eye(3.0, y, 1.2, yaw)).astype(int)
        row = ROVER.horizon + 40
        depth = ROVER.focal_px * 1.2 / 40.5
        coloured = np.ptp(picture[row], axis=1) > 8
        left, right = (
            ROVER.width / 2 - ROVER.focal_px * ((edge - y) / depth - np.sin(yaw)) / np.cos(yaw)
            for edge in (ROVER.half_width_m, -ROVER.half_width_m)
        )
        grey = np.flatnonzero(~coloured)
        if left > 1:
            assert grey.min() == pytest.approx(left, abs=2.5)
        if right < ROVER.width - 1:
            assert grey.max() == pytest.approx(right, abs=2.5)


def test_dashes_move_with_the_eye_and_repeat_with_their_period() -> None:
    """A period on, the same picture; half a period on, another."""
    camera = RoadCamera()
    here = camera.draw(Eye(7.25, 0.0))
    np.testing.assert_array_equal(here, camera.draw(Eye(7.25 + 4 * ROVER.period_m, 0.0)))
    assert (here != camera.draw(Eye(7.25 + ROVER.period_m / 2, 0.0))).any()


def test_the_hood_is_painted_and_nothing_else_changes() -> None:
    """Its pixels lie below, in the middle; painting it in another colour changes these only."""
    camera = RoadCamera()
    green, red = camera.draw(Eye(0.0, 0.0), hood=HOOD), camera.draw(Eye(0.0, 0.0), hood=(255, 100, 100))
    changed = (green != red).any(axis=2)
    np.testing.assert_array_equal(changed, camera.hood)
    assert 0.03 < changed.mean() < 0.1
    assert np.flatnonzero(changed.any(axis=1)).min() > 0.85 * ROVER.height


def test_a_projected_place_on_the_ground_lies_where_the_camera_draws_it() -> None:
    """Within a pixel, for any eye: the near foot of a thin post; a place beside or behind the eye is none."""
    rng, camera = np.random.default_rng(3), RoadCamera()
    seen = 0
    for _ in range(60):
        x, y, high = rng.uniform((0, -3, 0.8), (50, 3, 1.6)).tolist()
        eye = Eye(x, y, high, float(rng.normal(0, 0.2)))
        ahead, aside = float(rng.uniform(2, 15)), float(rng.uniform(-0.8, 0.8))
        cos, sin = math.cos(eye.yaw), math.sin(eye.yaw)
        x, y = eye.x + ahead * (cos - aside * sin), eye.y + ahead * (sin + aside * cos)
        beyond = 1 + 0.05 / math.hypot(x - eye.x, y - eye.y)
        post = Cylinder(eye.x + beyond * (x - eye.x), eye.y + beyond * (y - eye.y), 0.05, 0.6, (255, 0, 255))
        bare, with_post = camera.draw(eye), camera.draw(eye, [post])
        rows, columns = np.nonzero((bare != with_post).any(axis=2))
        ((column, row),) = ROVER.project(eye, [(x, y)])
        if rows.size and rows.max() < ROVER.height - 1:
            seen += 1
            assert abs(column - (columns.mean() + 0.5)) < 1.0
            assert abs(row - (rows.max() + 0.5)) <= 1.0
    assert seen > 40
    assert np.isnan(ROVER.project(Eye(5.0, 0.0), [(4.0, 0.0), (5.0, 1.0)])).all()
