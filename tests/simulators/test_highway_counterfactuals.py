"""The controls that highway-env draws: which moments have them, another seed of them, and a road without a lead."""

from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import numpy.typing as npt
import pytest
from highway_env.vehicle.behavior import IDMVehicle
from PIL import Image

from banks import ALONG
from eyechart.cameras import EGO_COLUMN, HEIGHT_PX, PX_PER_M
from eyechart.conditions import OLDER
from eyechart.frames import EXCHANGE, LEAD, Draws, Frame, FrameBank, check, decode, draws_of, open_bank
from eyechart.perception.renderer import HighwayReading, read_picture
from eyechart.simulators.highway import Highway
from eyechart.simulators.highway.counterfactuals import FAR_M, LOWEST_M, draw_ranged
from eyechart.simulators.highway.drives import open_drive
from eyechart.simulators.highway.world import StockCamera, World

HALF_LANE_PX = 2 * PX_PER_M
PLACED = {"lane_near_m", "lane_far_m", "lead_mid_near_m", "lead_mid_far_m"}


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


def read(bank: FrameBank, frame: Frame, name: str) -> HighwayReading:
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
    for name in ALONG:
        lacking = [frame for frame in bank if name not in frame.counterfactuals]
        assert len(lacking) <= len(bank) / 20 or name == "lead_absent"
    for frame in bank:
        assert frame.counterfactuals.keys().isdisjoint(OLDER)
        assert frame.placed.isdisjoint(PLACED)
        assert ("lead_absent" in frame.counterfactuals) == frame.truth["lead_visible"]


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
        assert all(frame.truth[name] != anew.truth[name] for name in (LEAD, EXCHANGE) if name in frame.truth)
        for name in ("lead_near", "lead_far", "recoloured", "lead_absent"):
            if name in frame.counterfactuals:
                assert one.image(frame, name) == other.image(anew, name)
        assert one.image(frame) == other.image(anew)
    for name in ALONG[:-1]:
        equal = [one.image(frame, name) == other.image(frame, name) for frame in one if name in frame.counterfactuals]
        assert sum(equal) < len(one) / 4
    again = Highway().build(tmp_path / "again", seeds=(7,), steps=4)
    assert (again.manifest.images, again.manifest.controls) == (one.manifest.images, one.manifest.controls)


def meet(*others: tuple[float, float]) -> tuple[World, StockCamera]:
    """Return a road of three lanes with the ego in the middle one and vehicles so far ahead and aside, in metres."""
    world = open_drive("light", 0)
    ego = world.vehicle
    ego.position = world.road.network.get_lane(("0", "1", 1)).position(200.0, 0.0)
    ego.lane_index = ("0", "1", 1)
    places = [[ego.position[0] + ahead, ego.position[1] + aside] for ahead, aside in others]
    world.road.vehicles = [ego, *(IDMVehicle(world.road, place) for place in places)]
    return world, StockCamera(world)


ALL = {*ALONG}
EXCHANGED = {"exchange_own", "exchange_beside", "exchange_apart"}


@pytest.mark.parametrize(
    ("others", "drawn"),
    [
        (((30.0, 0.0),), ALL),
        (((30.0, 0.0), (20.0, 4.0)), ALL),
        (((30.0, 0.0), (6.5, 4.0)), ALL),
        (
            ((30.0, 0.0), *((float(ahead), aside) for ahead in range(4, 64, 5) for aside in (-4.0, 4.0))),
            ALL - EXCHANGED,
        ),
        (((30.0, 0.0), (6.0, 2.2)), ALL),
        (((30.0, 0.0), (38.0, 0.0)), {"lead_drawn"}),
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
    made = draw_ranged(world, camera, draws(), np.random.default_rng(0))
    assert made.pictures.keys() == drawn
    assert (6.0, 2.2) not in others or min(made.distances.values()) > 12, (
        "the lead jumped over a vehicle half in its lane"
    )
    assert_named(made.pictures, made.distances)
    assert world.road.vehicles == vehicles
    assert [vehicle.position.tolist() for vehicle in world.road.vehicles] == before
    assert np.array_equal(camera.draw(), picture)


def assert_named(pictures: Mapping[str, object], distances: Mapping[str, float]) -> None:
    """Every distance belongs to a picture that is there, and every moved lead has its distance."""
    of = {"lead_drawn": LEAD, **dict.fromkeys(EXCHANGED, EXCHANGE)}
    assert set(distances) == {distance for name, distance in of.items() if name in pictures}


def draws() -> Draws:
    """Return the distances that are tried of one frame."""
    return draws_of(0, (LOWEST_M, FAR_M[1]), ["one"])["one"]


def test_nothing_is_drawn_after_a_crash() -> None:
    """As for the other pictures that have one thing changed."""
    world, camera = meet((30.0, 0.0))
    world.vehicle.crashed = True
    assert draw_ranged(world, camera, draws(), np.random.default_rng(0)).pictures == {}
