import warnings
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import gymnasium as gym
import highway_env  # noqa: F401  (its import registers the environments)
import numpy as np
import pytest
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.kinematics import Vehicle
from hypothesis import given
from hypothesis import strategies as st

from eyechart.cameras import PALETTE
from eyechart.perception.renderer import HighwayReading, read_picture
from eyechart.spaces.scene import CLEAR_AHEAD_M, CLEAR_BEHIND_M, safe_action

RED = PALETTE["red"][0]
MIRROR = {"LEFT": "RIGHT", "RIGHT": "LEFT", "STRAIGHT": "STRAIGHT", "SLOW": "SLOW", "STOP": "STOP"}
PIXEL_M = 1 / 5.5


class Shot(NamedTuple):
    """A rendered picture and what the simulator's world says of it; ``doubt_m`` is how near it is to a tie."""

    rgb: np.ndarray
    gap_m: float | None
    left_clear: bool
    right_clear: bool
    lanes: int
    lane: int
    crashed: bool
    x_m: float
    merge: bool
    doubt_m: float


def make(name: str, **config: Any) -> Any:  # noqa: ANN401
    """Return an unwrapped highway-env environment that renders offscreen."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # gymnasium says that merge-v0 has a successor
        return gym.make(name, render_mode="rgb_array", config=config).unwrapped


def shoot(env: Any) -> Shot:  # noqa: ANN401
    """Render the world as it stands, and tell the truth about it."""
    rgb = np.ascontiguousarray(env.render())
    env.enable_auto_render = False
    ego, network = env.vehicle, env.road.network
    index = network.get_closest_lane_index(ego.position, ego.heading)
    lanes = len(network.all_side_lanes(index))
    off_centre = network.get_lane(index).local_coordinates(ego.position)[1]
    others = [vehicle.position - ego.position for vehicle in env.road.vehicles if vehicle is not ego]
    leads = [dx for dx, dy in others if dx > 0 and abs(dy) < 2 and dx * 5.5 + 180 < 600]
    beside = {
        side: [dx for dx, dy in others if abs(dy + off_centre - side) <= 2 and dx >= -CLEAR_BEHIND_M]
        for side in (-4.0, 4.0)
    }
    lane = index[2]
    edges = [2 - abs(off_centre)]
    for dx, dy in others:
        if -CLEAR_BEHIND_M - 1 < dx < 78:
            edges += [abs(abs(dy) - 2), abs(dx + CLEAR_BEHIND_M), abs(dx - CLEAR_AHEAD_M)]
            edges += [abs(abs(dy + off_centre) % 4 - 2)]
    return Shot(
        rgb,
        min(leads, default=None),
        lane > 0 and all(dx > CLEAR_AHEAD_M for dx in beside[-4.0]),
        lane < lanes - 1 and all(dx > CLEAR_AHEAD_M for dx in beside[4.0]),
        lanes,
        lane,
        bool(ego.crashed),
        float(ego.position[0]),
        "Merge" in type(env).__name__,
        min(edges),
    )


def drive(name: str, seed: int, steps: int, **config: Any) -> Iterator[Shot]:  # noqa: ANN401
    """Yield the pictures of a drive with seeded random actions, on past a crash."""
    env = make(name, **config)
    env.reset(seed=seed)
    rng = np.random.default_rng(seed)
    for _ in range(steps):
        yield shoot(env)
        env.step(int(rng.integers(5)))
    env.close()


class Stage:
    """An empty straight road on which a test places vehicles by hand."""

    def __init__(self, lanes: int = 3) -> None:
        self.env = make("highway-v0", lanes_count=lanes, vehicles_count=0)
        self.env.reset(seed=0)

    def shoot(
        self,
        *vehicles: tuple[float, float],
        ego: tuple[float, float] = (200.3, 4.0),
        kind: type = IDMVehicle,
        turned: float = 0.0,
        crashed: bool = False,
    ) -> Shot:
        """Render the ego at a place (x, y) in metres, and others at (dx, dy) from it."""
        self.env.vehicle.position = np.array(ego)
        self.env.vehicle.crashed = crashed
        self.env.road.vehicles = [self.env.vehicle]
        for offset in vehicles:
            self.env.road.vehicles.append(kind(self.env.road, np.array(ego) + offset, turned, 0))
        return shoot(self.env)


@pytest.fixture(scope="session")
def stage() -> Stage:
    """Three lanes; the ego's is the middle one unless a test puts it elsewhere."""
    return Stage()


def seeded_places(seed: int, shots: int, stage: Stage, lanes: int) -> Iterator[Shot]:
    """Yield random worlds: off-centre rows, turned and crashed vehicles, some of them over others."""
    rng = np.random.default_rng(seed)
    for n in range(shots):
        ego = (rng.uniform(150, 400), 4 * rng.integers(lanes) + rng.uniform(-1.9, 1.9) * (n % 2))
        near, far = ((-9, 25), (-35, 80))[n % 2]
        vehicles = [(rng.uniform(near, far), rng.uniform(-6, 6)) for _ in range(5)]
        kind = (IDMVehicle, Vehicle)[n % 3 == 0]
        yield stage.shoot(*vehicles, ego=ego, kind=kind, turned=rng.uniform(-0.3, 0.3), crashed=n % 4 == 0)


@pytest.fixture(scope="session")
def drives() -> list[Shot]:
    """Drives of light and dense traffic and of the merge, as the simulator renders them."""
    straight = {"lanes_count": 3, "duration": 40}
    return [
        *drive("highway-v0", 1, 14, **straight, vehicles_count=15),
        *drive("highway-v0", 2, 14, **straight, vehicles_count=20, vehicles_density=1.1),
        *drive("highway-v0", 3, 14, **straight | {"lanes_count": 4}, vehicles_count=20, vehicles_density=1.3),
        *drive("merge-v0", 4, 12),
        *drive("merge-v0", 6, 12),
    ]


@pytest.fixture(scope="session")
def placed(stage: Stage) -> list[Shot]:
    """Worlds that no drive would reach."""
    return [*seeded_places(7, 60, stage, 3), *seeded_places(8, 20, Stage(5), 5)]


def read(shot: Shot) -> HighwayReading:
    """Return the reading of a picture that must be readable."""
    reading = read_picture(shot.rgb)
    assert reading is not None
    return reading


def test_the_gap_is_read_within_five_centimetres_wherever_a_lead_is_visible(drives: list[Shot], stage: Stage) -> None:
    """Whole-pixel drawing alone costs 0.0455 m on average, and no visible lead is missed or invented."""
    blocked = [stage.shoot((gap, 0.0), kind=Vehicle) for gap in np.linspace(6.03, 75.9, 37)]
    shots = [shot for shot in drives if not shot.crashed] + blocked
    errors = []
    for shot in shots:
        gap_m = read(shot).scene.gap_m
        if shot.doubt_m > PIXEL_M:
            assert (gap_m is None) == (shot.gap_m is None)
        if gap_m is not None and shot.gap_m is not None:
            errors.append(abs(gap_m - shot.gap_m))
    assert len(errors) >= 0.99 * sum(shot.gap_m is not None for shot in shots)
    assert len(errors) >= 60
    assert np.mean(errors) <= 0.050


def test_the_sides_agree_with_the_world_wherever_no_boundary_is_within_a_pixel(
    drives: list[Shot], stage: Stage
) -> None:
    """Vehicles at many offsets in both adjacent lanes, from every lane."""
    beside = [
        stage.shoot((dx, dy), ego=(200.3, y))
        for y in (0.0, 4.0, 8.0)
        for dy in (-4.0, 4.0)
        for dx in (-30.0, -12.4, -11.6, 0.0, 21.0, 39.6, 40.4, 70.0)
    ]
    shots = [shot for shot in drives + beside if shot.doubt_m > PIXEL_M]
    assert len(shots) >= 90
    for shot in shots:
        scene = read(shot).scene
        assert (scene.left_clear, scene.right_clear) == (shot.left_clear, shot.right_clear)
    assert {(shot.left_clear, shot.right_clear) for shot in shots} >= {(True, False), (False, True), (True, True)}


def test_the_reading_of_a_flipped_picture_is_the_mirrored_reading(drives: list[Shot], placed: list[Shot]) -> None:
    """Exactly, on every rendered picture, and so is the action."""
    for shot in drives + placed:
        reading, flipped = read(shot), read_picture(shot.rgb[::-1])
        assert flipped == reading.mirrored()
        assert flipped is not None
        assert safe_action(flipped.scene) == MIRROR[safe_action(reading.scene)]


COLOURS = st.sampled_from(
    [colour for pair in PALETTE.values() for colour in pair]
    + [(100, 100, 100), (255, 255, 255), (60, 60, 60), (101, 100, 100)]
)
NEAR_OR_FAR = st.tuples(st.integers(150, 200), st.integers(55, 95)) | st.tuples(
    st.integers(0, 599), st.integers(0, 149)
)
BOXES = st.lists(st.tuples(NEAR_OR_FAR, st.integers(1, 40), st.integers(1, 24), COLOURS), max_size=10)


def draw_road(line_rows: list[int], solid: set[int]) -> np.ndarray:
    """Return grey with white lines, dashed but for the given places in the list."""
    rgb = np.full((150, 600, 3), 100, dtype=np.uint8)
    for n, row in enumerate(line_rows):
        rgb[row] = 255
        if n not in solid:
            rgb[row, np.arange(600) % 24 >= 17] = 100
    return rgb


@given(
    row=st.integers(53, 74),
    widths=st.lists(st.integers(20, 24), max_size=4),
    solid=st.sets(st.integers(0, 5)),
    boxes=BOXES,
    with_ego=st.booleans(),
)
def test_a_made_up_picture_and_its_flip_are_read_as_mirror_images(
    *,
    row: int,
    widths: list[int],
    solid: set[int],
    boxes: list[tuple[tuple[int, int], int, int, tuple[int, int, int]]],
    with_ego: bool,
) -> None:
    """Boxes of palette colours anywhere, in any order: touching, cut, over the ego, at equal distances."""
    rows = [line for line in [row, *(row + np.cumsum(widths)).tolist()] if line < 150]
    rgb = draw_road(rows, solid)
    for (x, y), width, height, colour in boxes:
        rgb[y : y + height, x : x + width] = colour
    if with_ego:
        rgb[70:79, 167:192] = PALETTE["green"][0]
    reading, flipped = read_picture(rgb), read_picture(rgb[::-1])
    assert flipped == (None if reading is None else reading.mirrored())


def test_a_vehicle_of_any_height_at_any_row_is_mirrored_exactly() -> None:
    """Near the edges of a lane one half pixel decides, and it must decide the same in the flip."""
    gaps = set()
    for height in range(8, 14):
        for row in range(50, 96):
            rgb = draw_road([42, 64, 86, 108], {0, 3})
            rgb[70:79, 167:192] = PALETTE["green"][0]
            rgb[row : row + height, 260:286] = PALETTE["blue"][0]
            reading, flipped = read_picture(rgb), read_picture(rgb[::-1])
            assert reading is not None
            assert flipped == reading.mirrored()
            gaps.add(reading.scene.gap_m is None)
    assert gaps == {True, False}


def test_two_vehicles_equally_near_the_anchor_do_not_break_the_mirror() -> None:
    """Neither is the ego more than the other, so both are, and no side is taken for up."""
    rgb = draw_road([64, 85], set())
    rgb[66:74, 167:192] = RED
    rgb[76:84, 167:192] = RED
    assert (rgb[::-1] == rgb).all()
    for row in (59, 60, 61, 80, 81, 82):
        with_lead = rgb.copy()
        with_lead[row : row + 9, 260:285] = PALETTE["blue"][0]
        reading, flipped = read_picture(with_lead), read_picture(with_lead[::-1])
        assert reading is not None
        assert reading.vehicles == 1
        assert flipped == reading.mirrored()


def test_an_ego_as_near_to_one_road_as_to_another_is_on_neither() -> None:
    """Between two roads no lane is the ego's, for any choice of one would be another in the flip."""
    rgb = draw_road([51, 73, 76, 98], {0, 2})
    rgb[70:79, 167:192] = PALETTE["green"][0]
    assert read_picture(rgb) is None
    assert read_picture(rgb[::-1]) is None


def test_a_picture_that_shows_no_highway_is_not_read(stage: Stage) -> None:
    """Grey, black, noise, a gradient, a grid, an empty road, another size: none of them has a scene."""
    lit = stage.shoot()
    rng = np.random.default_rng(0)
    ramp = np.linspace(0, 255, 600).astype(np.uint8)
    gradient = np.stack([np.tile(ramp, (150, 1)), np.tile(ramp[::-1], (150, 1)), np.full((150, 600), 90)], axis=-1)
    grid = np.full((150, 600, 3), 100, dtype=np.uint8)
    grid[::10] = 255
    pictures = {
        "road grey": np.full((150, 600, 3), 100, dtype=np.uint8),
        "middle grey": np.full((150, 600, 3), 128, dtype=np.uint8),
        "black": np.zeros((150, 600, 3), dtype=np.uint8),
        "white": np.full((150, 600, 3), 255, dtype=np.uint8),
        "noise": rng.integers(0, 256, (150, 600, 3), dtype=np.uint8),
        "gradient": gradient.astype(np.uint8),
        "grid": grid,
        "road on black": np.where(lit.rgb == 100, 0, lit.rgb).astype(np.uint8),
        "road without an ego": draw_road([42, 64, 86], {0, 2}),
        "half a road": draw_road([42, 64, 86], {0, 2})[:, :300],
        "floats": draw_road([42, 64, 86], {0, 2}).astype(np.float32),
    }
    assert {name for name, rgb in pictures.items() if read_picture(rgb) is not None} == set()


def test_shuffled_pixels_of_a_real_picture_are_not_read(stage: Stage) -> None:
    """The same colours in the same amounts are no scene without their places."""
    rgb = stage.shoot((20.0, 0.0)).rgb
    shuffled = np.random.default_rng(0).permutation(rgb.reshape(-1, 3)).reshape(rgb.shape)
    assert read_picture(rgb) is not None
    assert read_picture(shuffled) is None


def test_the_ego_is_green_while_it_drives_and_red_once_it_has_crashed(drives: list[Shot], stage: Stage) -> None:
    """In drives as they happen, and on the anchor only: a red lead does not make a red ego."""
    shots = [*drives, stage.shoot((9.0, 0.0), crashed=True), stage.shoot((9.0, 0.0), crashed=False)]
    assert {shot.crashed for shot in shots} == {True, False}
    for shot in shots:
        assert read(shot).ego_colour == ("red" if shot.crashed else "green")


def test_recolouring_the_ego_changes_the_ego_colour_and_nothing_else(drives: list[Shot], stage: Stage) -> None:
    """The counterfactual picture of the same moment: the ego drawn in the crash colour."""
    for shot in (stage.shoot((9.0, 0.0)), stage.shoot((30.0, 4.0), (12.0, 0.5)), drives[0]):
        rgb = shot.rgb.copy()
        rgb[(rgb == PALETTE["green"][0]).all(axis=2)] = RED
        rgb[(rgb == PALETTE["green"][1]).all(axis=2)] = PALETTE["red"][1]
        assert read(shot).ego_colour == "green"
        assert read_picture(rgb) == replace(read(shot), ego_colour="red")


def test_the_lanes_and_the_ego_among_them_are_counted_from_the_lines(drives: list[Shot]) -> None:
    """On roads of two, three and four lanes, the merge's third lane included, in and between lanes."""
    shots = [shot for shot in drives if shot.doubt_m > PIXEL_M]
    for lanes in (2, 3, 4):
        stage = Stage(lanes)
        for y in np.arange(-1.5, 4 * lanes - 2, 1.0):
            shots += [stage.shoot(ego=(x, y)) for x in (200.3, 201.4, 202.5, 203.6)]
    assert {shot.lanes for shot in shots} == {2, 3, 4}
    for shot in shots:
        assert (read(shot).lanes, read(shot).lane_from_left) == (shot.lanes, shot.lane)


def test_a_lane_beyond_the_edge_of_the_picture_is_not_counted() -> None:
    """From the outer lane of five, the picture ends within the fourth lane over."""
    stage = Stage(5)
    assert read(stage.shoot(ego=(200.3, 0.0))).lanes == 4
    assert read(stage.shoot(ego=(200.3, 8.0))).lanes == 5


def test_the_merging_lane_counts_only_where_its_line_is_dashed() -> None:
    """The lane can be entered from x = 230 to 310 m, though its line shows in the picture before and after."""
    env = make("merge-v0")
    env.reset(seed=0)
    env.road.vehicles = [env.vehicle]
    for x, lanes in ((226.0, 2), (229.0, 2), (230.5, 3), (233.0, 3), (270.0, 3), (309.0, 3), (312.0, 2)):
        for y in (0.0, 4.0):
            env.vehicle.position = np.array([x, y])
            shot = shoot(env)
            assert (shot.lanes, read(shot).lanes) == (lanes, lanes)
    env.vehicle.position = np.array([231.0, 4.0])
    env.road.vehicles.append(IDMVehicle(env.road, np.array([218.0, 10.0]), 0, 0))
    assert read(shoot(env)).lanes == 3  # no dash ends where the grey between a vehicle and a line does


def test_the_ramp_tells_the_merge_from_the_straight_highway(drives: list[Shot]) -> None:
    """In sight until the end of the merging lane (x = 310 m) has left the picture behind the ego."""
    seen = [shot for shot in drives if not shot.merge or shot.x_m < 310]
    assert {shot.merge for shot in seen} == {True, False}
    for shot in seen:
        assert read(shot).ramp is shot.merge


def test_the_stripe_phase_follows_the_ego_and_not_the_lead(stage: Stage) -> None:
    """Stripes begin every 4.33 m from the road's origin; a lead at any gap leaves the phase exactly as it is."""
    for x in np.arange(200.0, 204.4, 0.31):
        phase = read(stage.shoot(ego=(x, 4.0))).stripe_phase
        assert phase is not None
        assert 0 <= phase < 1
        off = (phase - x / 4.33) % 1.0
        assert min(off, 1 - off) < 0.02
        for gap in (8.0, 23.0, 61.0):
            assert read(stage.shoot((gap, 0.0), ego=(x, 4.0))).stripe_phase == phase


def test_a_road_without_dashed_lines_has_no_stripe_phase() -> None:
    """A single lane cannot say where a stripe begins."""
    reading = read(Stage(1).shoot(ego=(200.3, 0.0)))
    assert reading.stripe_phase is None
    assert reading.lanes == 1


def test_a_vehicle_cut_by_the_edge_is_placed_as_if_it_were_whole(stage: Stage) -> None:
    """The end in sight places it: at the right edge its rear, at the left edge its lights."""
    for gap in (74.5, 75.2, 76.0):
        assert read(stage.shoot((gap, 0.0))).scene.gap_m == pytest.approx(gap, abs=PIXEL_M / 2 + 1e-9)
    assert read(stage.shoot((77.0, 0.0))).vehicles == 1
    assert read(stage.shoot((77.0, 0.0))).scene.gap_m is None  # its centre is beyond the edge
    assert read(stage.shoot((-34.0, 0.0))).vehicles == 1


def test_a_lead_half_hidden_by_another_vehicle_is_placed_by_the_end_in_sight(stage: Stage) -> None:
    """The later vehicle is drawn over the earlier: over its rear, where its lights place it, or over its front."""
    behind = read(stage.shoot((20.0, 0.0), (16.8, 0.0)))
    assert behind.scene.gap_m == pytest.approx(16.8, abs=PIXEL_M / 2 + 1e-9)
    assert behind.vehicles == 2
    before = read(stage.shoot((20.0, 0.0), (23.1, 0.0)))
    assert before.scene.gap_m == pytest.approx(20.0, abs=PIXEL_M / 2 + 1e-9)
    assert before.vehicles == 2


def test_touching_vehicles_of_one_colour_are_told_apart_by_their_outlines(stage: Stage) -> None:
    """Bumper to bumper and side by side, as after a crash."""
    reading = read(stage.shoot((5.0, 0.0), (10.0, 0.0), (5.0, 2.0), (5.0, -2.0), crashed=True))
    assert reading.vehicles == 4
    assert reading.scene.gap_m == pytest.approx(5.0, abs=PIXEL_M / 2 + 1e-9)
    assert not reading.scene.left_clear


def test_a_vehicle_drawn_over_a_part_of_the_ego_does_not_hide_the_ego(stage: Stage) -> None:
    """Others are drawn after the ego, so in a crash they cover it; what is left of it is green."""
    for dx, dy in ((2.5, 0.3), (-1.5, 0.0), (-2.5, 0.0), (1.5, 0.0), (0.5, 1.4), (1.0, -1.4), (-0.3, 0.4)):
        reading = read(stage.shoot((dx, dy), crashed=False))
        assert (reading.ego_colour, reading.vehicles) == ("green", 1)


def test_a_lead_is_in_the_own_lane_within_two_metres_aside(stage: Stage) -> None:
    """To the pixel on either side, in the picture and in its flip, though truncation shifts every row."""
    for aside, is_lead in ((-1.95, True), (1.95, True), (-2.1, False), (2.1, False)):
        shot = stage.shoot((20.0, aside))
        flipped = read_picture(shot.rgb[::-1])
        assert flipped is not None
        assert (read(shot).scene.gap_m is not None) is is_lead
        assert (flipped.scene.gap_m is not None) is is_lead


def test_a_turned_lead_is_placed_within_a_tenth_of_a_metre_on_average(stage: Stage) -> None:
    """A turned drawing is truncated twice: one half pixel more is given back."""
    angles = [side * angle for angle in np.linspace(0.04, 0.2, 9) for side in (-1, 1)]
    errors = []
    for n, angle in enumerate(angles):
        gap_m = read(stage.shoot((20.0 + 0.31 * n, 0.0), turned=angle)).scene.gap_m
        assert gap_m is not None
        errors.append(gap_m - 20.0 - 0.31 * n)
    assert abs(np.mean(errors)) < 0.1
    assert np.max(np.abs(errors)) < 0.3


def test_a_sliver_of_a_hidden_vehicle_is_not_counted_as_another(stage: Stage) -> None:
    """Fewer than ten pixels of a vehicle's colour are what is left beside the one that hides it."""
    rgb = stage.shoot((20.0, 0.0)).rgb.copy()
    rgb[40:43, 400:403] = PALETTE["blue"][0]
    assert read_picture(rgb) == read(stage.shoot((20.0, 0.0)))


def test_the_obstacle_at_the_end_of_the_ramp_is_no_vehicle() -> None:
    """It is drawn yellow and square, without lights; it is neither counted nor taken for a lead."""
    env = make("merge-v0")
    env.reset(seed=0)
    env.road.vehicles = [env.vehicle]
    env.vehicle.position = np.array([280.0, 8.0])
    reading = read(shoot(env))
    assert (reading.vehicles, reading.scene.gap_m) == (0, None)
    yellow = (env.render() == PALETTE["yellow"][0]).all(axis=2)
    assert yellow.any()
