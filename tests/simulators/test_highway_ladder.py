"""Highway's drives: the stock environment bit for bit, with the banks' picture and truth."""

import random

import gymnasium
import numpy as np
import pytest
from highway_env.envs.common.graphics import EnvViewer

from eyechart.errors import SpecError
from eyechart.perception.renderer import read_picture
from eyechart.simulators import open_simulator
from eyechart.simulators.highway import Highway
from eyechart.simulators.highway.drives import LADDER
from eyechart.spaces.discrete import DRIVING


def stock_states(scenario: str, seed: int, actions: list[str]) -> list[tuple[bytes, float, bool]]:
    """Return state, reward and end after each action, from ``gymnasium.make`` and ``env.step`` alone."""
    setting = LADDER[scenario]
    env = gymnasium.make(setting.env, config=dict(setting.config)).unwrapped
    env.reset(seed=seed)
    states = []
    for action in actions:
        _, reward, over, _, _ = env.step(env.action_type.actions_indexes[Highway.declared.commands[action]])
        vehicles = env.road.vehicles
        rows = [[*vehicle.position, vehicle.heading, vehicle.speed] for vehicle in vehicles]
        states.append((np.array(rows, dtype=np.float64).tobytes(), float(reward), bool(over)))
        if over:
            break
    env.close()
    return states


@pytest.mark.filterwarnings("ignore:.*merge-v0 is out of date")
@pytest.mark.parametrize("scenario", list(LADDER))
@pytest.mark.parametrize("seed", [0, 5])
def test_a_drive_is_the_stock_environment_bit_for_bit(scenario: str, seed: int) -> None:
    """State and reward after every one of some random actions, and when it ends; pictures have no effect."""
    rng = random.Random(f"{scenario}{seed}")  # noqa: S311 - no secret
    actions = rng.choices(DRIVING.actions, k=7)
    drive = open_simulator("highway").drive(scenario, seed)
    found = []
    for action in actions:
        drive.picture()
        moved = drive.step(action)
        found.append((drive.state(), moved.reward, moved.ended is not None))
        if moved.ended:
            break
    assert found == stock_states(scenario, seed, actions)
    assert len({state for state, _, _ in found}) == len(found)


def test_the_picture_is_the_stock_one_and_agrees_with_the_truth() -> None:
    """highway-env's own viewer draws the same pixels, and the reader of pictures finds the gap that the truth has."""
    drive = open_simulator("highway").drive("dense", 1)
    drive.step("SLOW")
    world = drive._world  # type: ignore[attr-defined]
    world.render_mode = "rgb_array"
    viewer = EnvViewer(world)
    viewer.display()
    assert (drive.picture() == viewer.get_image()).all()
    viewer.close()
    gap, reading = drive.truth()["lead_gap_m"], read_picture(drive.picture())
    assert reading is not None
    assert isinstance(gap, float)
    assert reading.scene.gap_m == pytest.approx(gap, abs=0.2)


def test_distance_counts_from_the_first_second_and_a_drive_ends_once() -> None:
    """SLOW drives at 20 m/s for 29 seconds; after the end there is no further step."""
    drive = open_simulator("highway").drive("light", 0)
    moves = [drive.step("SLOW")]
    while moves[-1].ended is None:
        moves.append(drive.step("SLOW"))
    assert moves[0].distance_m == 0.0
    assert [moves[-1].ended, len(moves)] == ["time", 30]
    assert moves[-1].distance_m == pytest.approx(580.5, abs=0.2)
    with pytest.raises(ValueError, match="over"):
        drive.step("SLOW")


def test_stop_and_slow_are_one_meta_action() -> None:
    """highway-env's slowest speed is 20 m/s, so the two give one and the same drive."""
    states = []
    for action in ("STOP", "SLOW"):
        drive = open_simulator("highway").drive("blocked", 3)
        drive.step(action)
        drive.step(action)
        states.append(drive.state())
    assert states[0] == states[1]


def test_an_unknown_scenario_seed_or_action_is_refused() -> None:
    """In words that say what there is."""
    simulator = open_simulator("highway")
    with pytest.raises(SpecError, match="no scenario 'snow'; known: light, dense, merge, blocked"):
        simulator.drive("snow", 0)
    with pytest.raises(SpecError, match="seed -1 is out of range"):
        simulator.drive("light", -1)
    with pytest.raises(ValueError, match="'JUMP' is none of"):
        simulator.drive("light", 0).step("JUMP")
