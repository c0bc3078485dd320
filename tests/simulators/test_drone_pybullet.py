"""gym-pybullet-drones in the drone's scenarios: tested wherever it can be imported, and said where it cannot."""

import importlib.util
import sys

import numpy as np
import pytest
from numpy.typing import NDArray

from eyechart.cameras import DRONE, Eye
from eyechart.errors import SpecError
from eyechart.frames import RGB
from eyechart.simulators import open_bank_simulator, open_simulator
from eyechart.simulators.camera import Cylinder, RoadCamera
from eyechart.simulators.drone import Drone, PybulletDrone
from eyechart.simulators.drone.aviary import IN_FRONT_M, Aviary
from eyechart.simulators.drone.world import BODY_RADIUS_M
from eyechart.simulators.road import make_layout

IS_HERE = all(importlib.util.find_spec(name) is not None for name in ("pybullet", "gym_pybullet_drones"))


def test_without_gym_pybullet_drones_the_error_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """On one line, when a world is opened; what can be said without it is said."""
    monkeypatch.setitem(sys.modules, "pybullet", None)
    simulator = open_simulator("drone-pybullet")
    assert simulator.declared.scenarios == Drone.declared.scenarios
    with pytest.raises(
        SpecError, match=r"'drone-pybullet' needs gym-pybullet-drones .*pip install 'eyechart\[drone\]'"
    ):
        simulator.drive("single", 0)
    with pytest.raises(SpecError, match=r"pip install --no-deps git\+https://github.com/utiasDSL/gym-pybullet-drones"):
        simulator.versions()


def test_it_makes_no_banks_and_says_what_does() -> None:
    """The drone's banks are drawn by our own camera."""
    with pytest.raises(SpecError, match="makes no banks: those of the same scenarios come from 'drone'"):
        open_bank_simulator("drone-pybullet")


if not IS_HERE:

    def test_gym_pybullet_drones_is_not_installed_here_so_its_flights_are_not_tested() -> None:
        """This sentence stands in the report of a run of tests that could not fly it."""
        with pytest.raises(SpecError, match="needs gym-pybullet-drones"):
            PybulletDrone().drive("single", 0)

else:

    def test_it_is_the_version_that_the_docs_name() -> None:
        """Its source's, not an index's."""
        assert PybulletDrone().versions()["gym-pybullet-drones"] == "2.1.0"

    def test_straight_speeds_up_left_changes_over_and_stop_hovers() -> None:
        """The Crazyflie's own controller follows our commands, at 4 m/s too."""
        drive = PybulletDrone().drive("single", 0)
        speeds = [drive.step(action).speed_mps for action in ("STRAIGHT", "STRAIGHT", "STRAIGHT")]
        assert speeds[-1] == pytest.approx(4.0, abs=0.25)
        drive.step("LEFT")
        drive.step("STRAIGHT")
        assert float(str(drive.truth()["y_m"])) == pytest.approx(2.0, abs=0.3)
        assert drive.truth()["track"] == 0
        drive.step("STOP")
        assert drive.step("STOP").speed_mps < 0.3
        drive.close()

    def test_contact_is_a_crash_where_the_pillar_stands() -> None:
        """Polled after every step: nothing in gym-pybullet-drones tells of it."""
        drive = PybulletDrone().drive("single", 0)
        moved = drive.step("STRAIGHT")
        while moved.ended is None:
            moved = drive.step("STRAIGHT")
        (pillar,) = make_layout("single", 0).obstacles
        assert (moved.ended, moved.crashed) == ("crash", True)
        assert moved.distance_m == pytest.approx(pillar.x - pillar.radius - BODY_RADIUS_M, abs=0.15)
        with pytest.raises(ValueError, match="this drive is over"):
            drive.step("STRAIGHT")
        drive.close()

    def test_its_camera_sees_the_pillars_where_ours_does() -> None:
        """Same lens, same place: the two renderers agree on nine in ten of the pixels that either paints red."""
        theirs, ours = red_pillars()
        both, either = np.logical_and(*map(reddish, (theirs, ours))), np.logical_or(*map(reddish, (theirs, ours)))
        assert theirs.shape == ours.shape == (DRONE.height, DRONE.width, 3)
        assert both.sum() >= 0.9 * either.sum() > 2000

    def test_a_symmetric_world_is_its_own_mirror_image_but_for_edges() -> None:
        """The floor is plain and the light even, so that the flipped picture could have been drawn."""
        picture, _ = red_pillars()
        differ = (picture != picture[:, ::-1]).any(axis=2)
        assert differ.mean() < 0.01
        assert differ.sum(axis=1).max() <= 8

    def test_the_same_seed_and_actions_give_the_same_flight() -> None:
        """To the bit, on one machine."""
        drives = [PybulletDrone().drive("slalom", 3) for _ in range(2)]
        moves = [[drive.step(action) for action in ("STRAIGHT", "LEFT", "SLOW")] for drive in drives]
        assert moves[0] == moves[1]
        assert drives[0].state() == drives[1].state()
        assert np.array_equal(drives[0].picture(), drives[1].picture())
        for drive in drives:
            drive.close()


def red_pillars() -> tuple[RGB, RGB]:
    """Return a picture of two pillars left and right of the road's middle by PyBullet, and by our own camera."""
    pillars = [Cylinder(8.0, y, 0.5, 3.0, (200, 60, 60)) for y in (-2.0, 2.0)]
    aviary = Aviary(pillars, DRONE, DRONE.verges["meadow"], y=0.0)
    picture = aviary.draw()
    aviary.close()
    return picture, RoadCamera(DRONE).draw(Eye(IN_FRONT_M, 0.0, DRONE.eye_m), pillars)


def reddish(picture: RGB) -> NDArray[np.bool_]:
    """Return which pixels are redder than green."""
    pixels = picture.astype(int)
    return np.asarray(pixels[:, :, 0] - pixels[:, :, 1] > 50)
