import tomllib
from importlib.metadata import EntryPoint
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from eyechart.errors import SpecError
from eyechart.simulators import SIMULATORS, open_simulator
from eyechart.simulators.environments import ENVIRONMENTS, DriveEnvironment

ROOT = Path(__file__).parents[2]
IDS = list(ENVIRONMENTS)


def make(name: str, **changes: str) -> DriveEnvironment:
    """Return an environment as Gymnasium makes it, without its wrappers."""
    made = gymnasium.make(name, render_mode="rgb_array", **changes).unwrapped
    assert isinstance(made, DriveEnvironment)
    return made


def test_the_declared_entry_point_registers_every_environment() -> None:
    """What pyproject.toml names can be loaded and called, as often as one likes, and every id has a simulator."""
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["entry-points"]
    (point,) = [EntryPoint(name, value, "gymnasium.envs") for name, value in declared["gymnasium.envs"].items()]
    point.load()()
    assert set(IDS) <= gymnasium.registry.keys()
    assert set(ENVIRONMENTS.values()) <= SIMULATORS.keys()


@pytest.mark.parametrize("name", IDS)
def test_gymnasiums_own_checker_is_content(name: str) -> None:
    """Spaces, seeding, the five values of a step and rendering are as Gymnasium wants them; warnings are errors."""
    check_env(make(name))


@pytest.mark.parametrize("name", IDS)
def test_an_episode_is_the_simulators_drive(name: str) -> None:
    """A world that is asked for by name shows the same pictures, rewards and truth as the simulator's own drive."""
    simulator, environment = open_simulator(ENVIRONMENTS[name]), make(name)
    scenario = next(iter(simulator.declared.scenarios))
    picture, info = environment.reset(options={"scenario": scenario, "seed": 3})
    drive = simulator.drive(scenario, 3)
    assert (info["scenario"], info["seed"]) == (scenario, 3)
    ended = None
    while ended is None:
        np.testing.assert_array_equal(picture, drive.picture())
        assert {key: info[key] for key in drive.truth()} == drive.truth()
        moved = drive.step("STRAIGHT")
        number = np.int64(simulator.declared.action_space.actions.index("STRAIGHT"))
        picture, reward, terminated, truncated, info = environment.step(number)
        ended = moved.ended
        assert (reward, info["distance_m"], info["ended"]) == (moved.reward, moved.distance_m, ended)
        assert (terminated, truncated) == (ended in {"crash", "goal"}, ended == "time")
    np.testing.assert_array_equal(environment.render(), picture)


def test_a_seed_is_a_world_and_other_seeds_are_others() -> None:
    """Resetting with a seed repeats scenario and world; without one, the next world is drawn."""
    environment = make("eyechart/Rover-v0")

    def world(seed: int | None) -> tuple[object, object]:
        _, info = environment.reset(seed=seed)
        return info["scenario"], info["seed"]

    first = world(7)
    following = [world(None) for _ in range(20)]
    assert world(7) == first
    assert [world(None) for _ in range(20)] == following
    assert len({scenario for scenario, _ in following}) == 5
    assert len(set(following)) == 20
    fixed = make("eyechart/Rover-v0", scenario="gate")
    assert {fixed.reset(seed=seed)[1]["scenario"] for seed in range(5)} == {"gate"}


def test_what_cannot_be_is_refused() -> None:
    """A step before the first reset, a scenario that is none, and no picture without a render mode."""
    environment = make("eyechart/Rover-v0")
    with pytest.raises(gymnasium.error.ResetNeeded, match=r"call reset\(\) before"):
        environment.step(np.int64(0))
    with pytest.raises(SpecError, match="no scenario 'merge'"):
        environment.reset(options={"scenario": "merge"})
    with pytest.raises(SpecError, match="no scenario 'merge'"):
        DriveEnvironment("rover", scenario="merge")
    blind = DriveEnvironment("rover")
    blind.reset(seed=0)
    assert blind.render() is None
