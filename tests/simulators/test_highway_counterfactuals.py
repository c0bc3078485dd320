"""The controls that highway-env draws: who is near, how near the lead is, and a road without a lead."""

import math
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import numpy.typing as npt
import pytest
from highway_env.vehicle.behavior import IDMVehicle
from PIL import Image

from banks import STAGED
from eyechart.cameras import EGO_COLUMN, HEIGHT_PX, PX_PER_M
from eyechart.conditions import CONDITIONS
from eyechart.frames import DISTANCES, Frame, FrameBank, check, decode, open_bank
from eyechart.perception.renderer import Reading, read_picture
from eyechart.simulators.highway import Highway
from eyechart.simulators.highway.counterfactuals import FAR_M, MIDS_M, NEAR_M, draw_controls
from eyechart.simulators.highway.driving import open_drive
from eyechart.simulators.highway.world import Camera, World

DRAWN = tuple(name for name in STAGED if "counterfactual" in CONDITIONS[name].needs)
HALF_CAR_PX, HALF_LANE_PX, LANE_PX = 2.5 * PX_PER_M + 2, 2 * PX_PER_M, 4 * PX_PER_M


@pytest.fixture(scope="module")
def bank(demo: SimpleNamespace) -> FrameBank:
    """Return the default balanced bank."""
    return open_bank(demo.bank)


def pixels(bank: FrameBank, frame: Frame, name: str | None = None) -> npt.NDArray[np.int16]:
    """Return a picture of a frame."""
    return decode(bank.image(frame, name), frame.id).astype(np.int16)


def colours(picture: npt.NDArray[np.int16]) -> set[tuple[int, ...]]:
    """Return the colours of a picture."""
    return {colour for _, colour in Image.fromarray(picture.astype(np.uint8)).getcolors(picture.size)}


def read(bank: FrameBank, frame: Frame, name: str) -> Reading:
    """Return what a control shows to a reader that knows nothing else."""
    reading = read_picture(decode(bank.image(frame, name), frame.id))
    assert reading is not None
    return reading


def metres(frame: Frame, name: str) -> float:
    """Return a distance of a frame."""
    value = frame.truth[name]
    assert isinstance(value, float)
    return value


def test_nearly_every_frame_has_every_control(bank: FrameBank) -> None:
    """All but those without a lead, where the lead is in no picture that could lack it."""
    for name in DRAWN:
        lacking = [frame for frame in bank if name not in frame.counterfactuals]
        assert len(lacking) <= len(bank) / 100 or name == "lead_absent"
    for frame in bank:
        assert ("lead_absent" in frame.counterfactuals) == frame.truth["lead_visible"]


def test_the_mids_show_the_lead_where_the_bank_says(bank: FrameBank) -> None:
    """A reader of pixels finds the kept distance, and the sides as they are in the true picture."""
    for frame in bank:
        for name, (low, high) in MIDS_M.items():
            scene, gap_m = read(bank, frame, name).scene, metres(frame, f"{name}_m")
            assert low <= gap_m <= high
            assert scene.gap_m == pytest.approx(gap_m, abs=0.2)
            assert (scene.left_clear, scene.right_clear) == (frame.truth["left_clear"], frame.truth["right_clear"])
            rows, columns = np.nonzero((pixels(bank, frame, name) != pixels(bank, frame)).any(axis=2))
            assert np.abs(rows - HEIGHT_PX / 2).max(initial=0) <= HALF_LANE_PX
            assert columns.min(initial=EGO_COLUMN + 99) > EGO_COLUMN + HALF_CAR_PX - 2


def test_the_mids_leave_no_hole_in_the_range(bank: FrameBank) -> None:
    """Each third of their ranges, taken in the logarithm, holds a fifth of the frames at least."""
    for name, (low, high) in MIDS_M.items():
        shares = np.histogram([metres(frame, f"{name}_m") for frame in bank], np.geomspace(low, high, 4))[0]
        assert shares.sum() == len(bank)
        assert shares.min() >= len(bank) / 5


def test_who_is_near_is_exchanged_and_nothing_else(bank: FrameBank) -> None:
    """The two pictures differ at a near and a far place of the own lane, and at the same two of one lane beside it."""
    for frame in bank:
        near_m, far_m = metres(frame, "lane_near_m"), metres(frame, "lane_far_m")
        beside_m = math.sqrt(near_m**2 - 16)
        own, beside = pixels(bank, frame, "lane_own"), pixels(bank, frame, "lane_beside")
        rows, columns = np.nonzero((own != beside).any(axis=2))
        aside = np.round((rows - HEIGHT_PX / 2) / LANE_PX)
        assert set(aside.tolist()) in ({0.0, 1.0}, {0.0, -1.0})
        for lane, near in ((0, near_m), (aside[aside != 0][0], beside_m)):
            ahead = (columns[aside == lane] - EGO_COLUMN) / PX_PER_M
            at_near, at_far = np.abs(ahead - near) < 3.6, np.abs(ahead - far_m) < 3.6
            assert (at_near | at_far).all()
            assert at_near.any()
            assert at_far.any()
        assert len(colours(own) ^ colours(beside)) <= 2
        assert abs(own.mean() - beside.mean()) < 0.3


def test_the_lead_is_read_near_in_one_and_far_in_the_other(bank: FrameBank) -> None:
    """A reader of pixels finds the lead at the near and at the far distance, and the neighbour closing its side."""
    for frame in bank:
        own, beside = read(bank, frame, "lane_own").scene, read(bank, frame, "lane_beside").scene
        assert NEAR_M[0] <= metres(frame, "lane_near_m") <= NEAR_M[1]
        assert FAR_M[0] <= metres(frame, "lane_far_m") <= FAR_M[1]
        assert own.gap_m == pytest.approx(metres(frame, "lane_near_m"), abs=0.2)
        assert beside.gap_m == pytest.approx(metres(frame, "lane_far_m"), abs=0.2)
        assert not (beside.left_clear and beside.right_clear)


def test_without_a_lead_the_own_lane_is_empty(bank: FrameBank) -> None:
    """A reader of pixels finds no lead; only the lead's own pixels are gone."""
    for frame in bank:
        if "lead_absent" in frame.counterfactuals:
            assert read(bank, frame, "lead_absent").scene.gap_m is None
            rows, columns = np.nonzero((pixels(bank, frame, "lead_absent") != pixels(bank, frame)).any(axis=2))
            assert np.abs(rows - HEIGHT_PX / 2).max() <= HALF_LANE_PX
            assert np.abs((columns - EGO_COLUMN) / PX_PER_M - metres(frame, "lead_gap_m")).max() < 3.6


def test_another_seed_moves_the_controls_alone(tmp_path: Path) -> None:
    """Fingerprint and all other pictures stay; the distances, and with them the controls, are others."""
    one, other = (Highway().build(tmp_path / str(seed), seeds=(7,), steps=4, controls_seed=seed) for seed in (0, 2**40))
    assert one.manifest.fingerprint == other.manifest.fingerprint
    assert (one.manifest.controls.seed, other.manifest.controls.seed) == (0, 2**40)
    assert check(other.root) == []
    for frame, anew in zip(one, other, strict=True):
        same = {name for name in DISTANCES if frame.truth[name] == anew.truth[name]}
        assert same == set()
        for name in ("lead_near", "lead_far", "recoloured", "lead_absent"):
            if name in frame.counterfactuals:
                assert one.image(frame, name) == other.image(anew, name)
        assert one.image(frame) == other.image(anew)
    for name in DRAWN[:-1]:
        equal = [one.image(frame, name) == other.image(frame, name) for frame in one]
        assert sum(equal) < len(one) / 4
    again = Highway().build(tmp_path / "again", seeds=(7,), steps=4)
    assert (again.manifest.images, again.manifest.controls) == (one.manifest.images, one.manifest.controls)


def meet(*others: tuple[float, float]) -> tuple[World, Camera]:
    """Return a road of three lanes with the ego in the middle one and vehicles so far ahead and aside, in metres."""
    world = open_drive("light", 0)
    ego = world.vehicle
    ego.position = world.road.network.get_lane(("0", "1", 1)).position(200.0, 0.0)
    ego.lane_index = ("0", "1", 1)
    places = [[ego.position[0] + ahead, ego.position[1] + aside] for ahead, aside in others]
    world.road.vehicles = [ego, *(IDMVehicle(world.road, place) for place in places)]
    return world, Camera(world)


ALL = {*DRAWN}
EXCHANGE = {"lane_own", "lane_beside"}


@pytest.mark.parametrize(
    ("others", "drawn"),
    [
        (((30.0, 0.0),), ALL),
        (((30.0, 0.0), (20.0, 4.0)), ALL),
        (((30.0, 0.0), (6.5, 4.0)), ALL),
        (((30.0, 0.0), (6.0, 4.0), (10.0, 4.0), (6.0, -4.0), (10.0, -4.0)), ALL - EXCHANGE),
        (((30.0, 0.0), (6.0, 2.2)), {"lead_absent"}),
        (((30.0, 0.0), (38.0, 0.0)), set()),
        (((90.0, 0.0),), ALL - {"lead_absent"}),
        (((20.0, 4.0),), set()),
        ((), set()),
    ],
)
def test_a_control_that_cannot_be_drawn_is_absent(others: tuple[tuple[float, float], ...], drawn: set[str]) -> None:
    """No vehicle is put into another, the lead jumps over nobody, and the road is afterwards as it was."""
    world, camera = meet(*others)
    picture, vehicles = camera.draw(), list(world.road.vehicles)
    before = [vehicle.position.tolist() for vehicle in vehicles]
    made = draw_controls(world, camera, np.random.default_rng(0))
    assert made.pictures.keys() - MIDS_M.keys() == drawn - MIDS_M.keys()
    assert drawn != ALL or drawn == made.pictures.keys()
    assert_named(made.pictures, made.distances)
    assert world.road.vehicles == vehicles
    assert [vehicle.position.tolist() for vehicle in world.road.vehicles] == before
    assert np.array_equal(camera.draw(), picture)


def assert_named(pictures: Mapping[str, object], distances: Mapping[str, float]) -> None:
    """Every distance belongs to a picture that is there, and every moved lead has its distance."""
    of = {"lane_own": {"lane_near_m", "lane_far_m"}, **{name: {f"{name}_m"} for name in MIDS_M}}
    assert set(distances) == set().union(*(names for name, names in of.items() if name in pictures))


def test_nothing_is_drawn_after_a_crash() -> None:
    """As for the other pictures that have one thing changed."""
    world, camera = meet((30.0, 0.0))
    world.vehicle.crashed = True
    assert draw_controls(world, camera, np.random.default_rng(0)).pictures == {}
