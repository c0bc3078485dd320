"""The drone: what its actions do, what its limits are, and that a mirror exchanges left and right and nothing else."""

import math
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from eyechart.api import run_battery
from eyechart.cameras import DRONE
from eyechart.errors import SpecError
from eyechart.frames import FrameBank, decode
from eyechart.models.scripted import CONTROLLERS
from eyechart.perception.forward import read_forward, view_of
from eyechart.simulators import Drive, StepResult
from eyechart.simulators.drone import Drone
from eyechart.simulators.drone.world import (
    BODY_RADIUS_M,
    HZ,
    INTENTS,
    LAG_S,
    MOST_ACCELERATION_MPS2,
    MOST_SPEED_MPS,
    DroneWorld,
    Velocity,
    decide,
    start,
)
from eyechart.simulators.road import FAMILIES, TRACKS_M, Layout, make_layout
from eyechart.spaces.discrete import DRIVING
from eyechart.spaces.scene import safe_action

IN_SIGHT_M = (2.6, 29.0)
"""Nearer pillars stand below the picture's edge, and the view ends at 30 m."""

EMPTY = start(Layout("single", ()))


def flown(*actions: str, world: DroneWorld = EMPTY) -> DroneWorld:
    """Return the world after these decisions."""
    for action in actions:
        world = decide(world, action)
    return world


def drive_by(drive: Drive, choose: str | None = None) -> list[StepResult]:
    """Drive to the end by one action, or by what is demanded, changing over to a clear side where it says SLOW."""
    moves: list[StepResult] = []
    while not moves or moves[-1].ended is None:
        truth = drive.truth()
        side = "LEFT" if truth["left_clear"] else "RIGHT" if truth["right_clear"] else "SLOW"
        wanted = side if truth["demand"] == "SLOW" else str(truth["demand"])
        moves.append(drive.step(choose or wanted))
    return moves


# ---- flight


def test_straight_speeds_up_slow_brakes_mildly_and_stop_brings_it_to_hover() -> None:
    """At the limits of its tilt: cruise in under two seconds, and a stop within 3.2 m."""
    cruising = flown("STRAIGHT", "STRAIGHT")
    assert cruising.state.speed == pytest.approx(INTENTS["STRAIGHT"].speed, abs=0.05)
    assert flown("SLOW", world=cruising).state.speed == pytest.approx(INTENTS["SLOW"].speed, abs=0.05)
    hovering = flown("STOP", "STOP", world=cruising)
    assert hovering.state.speed < 0.02
    assert hovering.state.x - cruising.state.x < 3.2


def test_left_and_right_lead_one_track_aside_and_no_farther_than_the_outer_one() -> None:
    """Most of the way in one decision; the drone follows its track's middle from then on."""
    gone = flown("STRAIGHT", "STRAIGHT", "LEFT")
    assert gone.state.y > (TRACKS_M[1] + TRACKS_M[2]) / 2
    assert flown("STRAIGHT", "STRAIGHT", world=gone).state.y == pytest.approx(TRACKS_M[2], abs=0.05)
    outer = flown("LEFT", "LEFT", "LEFT", "STRAIGHT", "STRAIGHT")
    assert outer.track == 2
    assert outer.state.y == pytest.approx(TRACKS_M[2], abs=0.05)
    assert flown("LEFT", "RIGHT", "STRAIGHT", "STRAIGHT").state.y == pytest.approx(0.0, abs=0.05)


def test_no_sequence_of_actions_goes_beyond_the_published_limits() -> None:
    """Acceleration up to g times the tangent of 20 degrees, and a speed far below 30 km/h."""
    assert pytest.approx(3.57, abs=0.005) == MOST_ACCELERATION_MPS2
    rng = np.random.default_rng(5)
    for _ in range(20):
        velocity, to_left = Velocity(), float(rng.uniform(-4, 4))
        for action in rng.choice(DRIVING.actions, 5).tolist():
            for _ in range(HZ):
                after = velocity.after(INTENTS[action], to_left, 1 / HZ)
                change = math.hypot(after.ahead - velocity.ahead, after.left - velocity.left)
                assert change * HZ <= MOST_ACCELERATION_MPS2 * (1 + 1e-9)
                velocity = after
                assert velocity.speed < MOST_SPEED_MPS


def test_a_small_change_of_speed_answers_as_a_first_order_lag() -> None:
    """After one lag 63 % of the way is made."""
    velocity, steps = Velocity(3.5), 1000
    for _ in range(steps):
        velocity = velocity.after(INTENTS["STRAIGHT"], 0.0, LAG_S / steps)
    assert (velocity.ahead - 3.5) / 0.5 == pytest.approx(1 - math.exp(-1), abs=0.001)


# ---- drives


def test_a_drive_ends_at_the_goal_in_a_crash_or_with_the_time() -> None:
    """Whoever does as demanded arrives, whoever does not look hits what stands in the way, and STOP stays."""
    arrived = drive_by(Drone().drive("single", 0))
    assert arrived[-1].ended == "goal"
    assert arrived[-1].distance_m >= 100.0
    drive = Drone().drive("single", 0)
    hit = drive_by(drive, "STRAIGHT")
    assert (hit[-1].ended, hit[-1].crashed, hit[-1].reward) == ("crash", True, -10.0)
    with pytest.raises(ValueError, match="this drive is over"):
        drive.step("STRAIGHT")
    stayed = drive_by(Drone().drive("single", 0), "STOP")
    assert (stayed[-1].ended, len(stayed), stayed[-1].distance_m) == ("time", 40, 0.0)


def test_a_crash_is_contact_and_not_nearness() -> None:
    """The drone ends where its propellers touch the pillar, within a step of flight."""
    layout = make_layout("single", 0)
    world = start(layout)
    while world.ended is None:
        world = decide(world, "STRAIGHT")
    (pillar,) = layout.obstacles
    way = math.hypot(pillar.x - world.state.x, pillar.y - world.state.y)
    reach = pillar.radius + BODY_RADIUS_M
    assert reach - INTENTS["STRAIGHT"].speed / HZ < way <= reach


def test_a_seed_is_one_world_and_the_rovers_too() -> None:
    """The same pillars stand where the rover's obstacles stand, three times as high; another seed is another world."""
    drive, again, other = (Drone().drive("clutter", seed) for seed in (4, 4, 5))
    assert drive.state() == again.state() != other.state()
    rover = make_layout("clutter", 4).obstacles
    ours = drive.world.layout.obstacles
    assert [(obstacle.x, obstacle.y, obstacle.radius, 3 * obstacle.height) for obstacle in rover] == [
        (obstacle.x, obstacle.y, obstacle.radius, obstacle.height) for obstacle in ours
    ]
    for action in ("STRAIGHT", "LEFT", "SLOW"):
        assert drive.step(action) == again.step(action)
    assert drive.state() == again.state()
    assert np.array_equal(drive.picture(), again.picture())


def test_the_mirrored_drive_is_the_drive_in_a_mirror_to_the_bit() -> None:
    """In 100 scenes: the flipped picture, and truth with the sides exchanged."""
    rng = np.random.default_rng(11)
    for family, seed in product(FAMILIES, range(20)):
        drive, mirrored = Drone().drive(family, seed), Drone().drive(family, seed, mirrored=True)
        for action in rng.choice(DRIVING.actions, int(rng.integers(8))).tolist():
            if drive.step(action).ended is not None:
                mirrored.step(DRIVING.reflect(action))
                break
            mirrored.step(DRIVING.reflect(action))
        assert np.array_equal(drive.picture()[:, ::-1], mirrored.picture())
        one, other = drive.truth(), mirrored.truth()
        assert (one["left_clear"], one["right_clear"]) == (other["right_clear"], other["left_clear"])
        assert one["lead_gap_m"] == other["lead_gap_m"]
        assert DRIVING.reflect(str(one["demand"])) == other["demand"]
        assert one["y_m"] == -float(str(other["y_m"]))


def test_what_will_not_do_is_refused() -> None:
    """An unknown scenario lists the known ones; a seed must be one; an action must be one."""
    with pytest.raises(SpecError, match="simulator 'drone' has no scenario 'forest'; known: offset, single"):
        Drone().drive("forest", 0)
    with pytest.raises(SpecError, match="seed -1 is out of range"):
        Drone().drive("single", -1)
    with pytest.raises(ValueError, match="'UP' is none of STOP, SLOW"):
        Drone().drive("single", 0).step("UP")


# ---- pictures


def test_its_pictures_are_read_as_what_they_show() -> None:
    """Under way: gaps to 5 cm within the view, sides, and the place across the road; the picture tells its view."""
    for family in FAMILIES:
        drive = Drone().drive(family, 2)
        for action in ("STRAIGHT", "SLOW", "STRAIGHT", "LEFT", "STRAIGHT", "RIGHT", "STRAIGHT"):
            picture, truth = drive.picture(), drive.truth()
            assert view_of(picture) is DRONE
            reading = read_forward(picture, DRONE)
            assert reading is not None
            assert reading.y_m == pytest.approx(truth["y_m"], abs=0.02)
            gap_m = truth["lead_gap_m"]
            if isinstance(gap_m, float) and IN_SIGHT_M[0] < gap_m < IN_SIGHT_M[1]:
                assert reading.scene.gap_m == pytest.approx(gap_m, abs=0.05)
            if drive.step(action).ended is not None:
                break


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a small bank: three episodes a family, six moments each."""
    return Drone().build(tmp_path_factory.mktemp("drone") / "bank", seeds=(0, 1, 2), steps=6)


@pytest.mark.slow
def test_a_bank_demands_what_its_pictures_show(bank: FrameBank) -> None:
    """The reader finds the demanded action in every picture, and moved leads where they were put.

    Repainting the own frame changes nothing else.
    """
    demanded = []
    for frame in bank:
        reading = read_forward(decode(bank.image(frame), frame.id), DRONE)
        assert reading is not None
        assert safe_action(reading.scene) == frame.truth["demand"]
        demanded.append(frame.truth["demand"])
        gaps = {}
        for name in frame.counterfactuals:
            other = read_forward(decode(bank.image(frame, name), name), DRONE)
            assert other is not None
            assert other.ego_colour == ("red" if name == "recoloured" else "green")
            gaps[name] = other.scene.gap_m
        assert gaps["recoloured"] == reading.scene.gap_m
        assert gaps["lead_near"] is None or gaps["lead_near"] < DRONE.distances.stop_m
        assert gaps["lead_far"] is None or gaps["lead_far"] > DRONE.distances.free_m
    assert set(demanded) == set(DRIVING.actions)
    assert abs(demanded.count("LEFT") - demanded.count("RIGHT")) <= 3


@pytest.mark.slow
def test_a_controller_gets_its_declared_labels_on_a_drone_bank(bank: FrameBank, tmp_path: Path) -> None:
    """The one that depends on gap and sides, with the horizontal flip; all sixteen were run once for the docs."""
    verdict = run_battery(bank, "scripted:depth_lateral", tmp_path / "run")["scripted:depth_lateral"]
    declared = CONTROLLERS["depth_lateral"].declared
    assert (verdict.calibrated.label, verdict.lateral.label) == (declared.calibrated, declared.lateral)
    assert verdict.evidence == "controlled"
