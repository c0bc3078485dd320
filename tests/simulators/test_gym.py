"""Any Gymnasium environment through the one door: what it needs, how it is driven, and how it may fail."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np
import pytest

from eyechart.errors import DriveError, SpecError
from eyechart.simulators import Drive, Simulator, StepResult, open_simulator
from eyechart.simulators.gym.action_map import read_map

CORRIDOR = """
actions = ["STOP", "STRAIGHT", "LEFT", "RIGHT"]
mirror_pairs = [["LEFT", "RIGHT"]]
brake = ["STOP"]
proceed = ["STRAIGHT"]

[gym]
mirror = "horizontal"
picture = "a corridor"
terminated = "goal"
most_steps = 6

[gym.numbers]
STOP = 4
STRAIGHT = 5
LEFT = 6
RIGHT = 7

[gym.info]
lead_gap_m = "sight.gap"
speed_mps = "speed"
distance_m = "x"
crashed = "crashed"

[gym.scenarios.short]
length = 3

[gym.scenarios.endless]
length = 1000
"""


class Corridor(gymnasium.Env[np.ndarray, int]):
    """Walks towards a wall; LEFT bumps into it, and ``fault`` names what is wrong with the place."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"], "render_fps": 1}

    def __init__(self, render_mode: str | None = None, length: int = 3, fault: str = "") -> None:
        self.render_mode = render_mode
        self.length, self.fault = length, fault
        self.action_space = gymnasium.spaces.Discrete(4, start=4)
        if fault == "continuous":
            self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,))
        if fault == "cannot be made":
            raise RuntimeError("no licence\nfound")
        self.observation_space = gymnasium.spaces.Box(0, 1000, (1,))
        self.x = 0

    def _info(self) -> dict[str, Any]:
        info = {"sight": {"gap": np.float32(self.length - self.x)}, "speed": 1.5, "x": 10 + self.x, "crashed": False}
        if self.fault == "tells no speed":
            del info["speed"]
        return info

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[np.ndarray, dict[str, Any]]:  # noqa: ANN401
        """Draw the walls' shade from the seed."""
        del options
        super().reset(seed=seed)
        self.x, self.shade = 0, int(self.np_random.integers(256))
        return np.array([0.0]), self._info() if self.fault != "tells no speed" else {}

    def step(self, action: int) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Go on with any action but 4."""
        if self.fault == "raises" and self.x == 2:
            raise ZeroDivisionError("a wheel\nfell off")
        self.x += action != 4
        info = {**self._info(), "crashed": action == 6}
        reward = float("nan") if self.fault == "reward" else 1.0
        return np.array([float(self.x)]), reward, self.x >= self.length, False, info

    def render(self) -> Any:  # noqa: ANN401
        """Draw the way that was walked."""
        if self.fault == "floats":
            return np.zeros((4, 4, 3))
        picture = np.zeros((4, 6, 3), dtype=np.uint8)
        if self.fault != "black":
            picture[:, : self.x + 1] = self.shade
            picture[0, 0] = 255
        return picture


class Typist(Corridor):
    """A corridor in letters."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["ansi"]}


@pytest.fixture(autouse=True)
def corridors() -> Iterator[None]:
    """Register the corridor under a name of its own, and forget it again."""
    before = dict(gymnasium.registry)
    gymnasium.register("Corridor-v0", entry_point=Corridor)
    gymnasium.register("Typist-v0", entry_point=Typist)
    yield
    gymnasium.registry.clear()
    gymnasium.registry.update(before)


def opened(tmp_path: Path, text: str = CORRIDOR, name: str = "gym:Corridor-v0") -> Simulator:
    """Return an environment opened with an action map."""
    file = tmp_path / "map.toml"
    file.write_text(text, encoding="utf-8")
    return open_simulator(name, actions=file)


def with_fault(tmp_path: Path, fault: str) -> Simulator:
    """Return the corridor with something wrong."""
    return opened(tmp_path, CORRIDOR.replace("length = 3", f'length = 3\nfault = "{fault}"'))


def test_an_environment_is_driven_in_the_words_of_its_map(tmp_path: Path) -> None:
    """Actions, truth, distance and the end come from the environment; a seed is a world."""
    simulator = opened(tmp_path)
    said = simulator.declared
    assert (said.name, said.mirror_axis, said.picture) == ("gym:Corridor-v0", "horizontal", "a corridor")
    assert list(said.scenarios) == ["short", "endless"]
    drive, again, other = (simulator.drive("short", seed) for seed in (5, 5, 6))
    assert drive.truth() == {
        "lead_gap_m": 3.0,
        "left_clear": None,
        "right_clear": None,
        "demand": None,
        "speed_mps": 1.5,
        "crashed": False,
        "distance_m": 10,
    }
    moves = [drive.step("STRAIGHT"), drive.step("STOP"), drive.step("RIGHT")]
    assert moves[2] == StepResult(1.0, 1.5, 2.0, crashed=False, ended=None)
    assert (drive.picture() == 255).all(axis=2).sum() == 1
    assert drive.step("STRAIGHT") == StepResult(1.0, 1.5, 3.0, crashed=False, ended="goal")
    with pytest.raises(ValueError, match="'SLOW' is none of STOP, STRAIGHT, LEFT, RIGHT"):
        again.step("SLOW")
    with pytest.raises(ValueError, match="the drive is over: goal"):
        drive.step("STRAIGHT")
    assert again.state() != drive.state()
    for action in ("STRAIGHT", "STOP", "RIGHT", "STRAIGHT"):
        again.step(action)
        other.step(action)
    assert again.state() == drive.state() != other.state()
    assert np.array_equal(again.picture(), drive.picture())


def test_a_crash_ends_the_drive_and_so_does_the_map_s_time_limit(tmp_path: Path) -> None:
    """An environment that never terminates is bounded by the map."""
    simulator = opened(tmp_path)
    assert simulator.drive("short", 0).step("LEFT") == StepResult(1.0, 1.5, 1.0, crashed=True, ended="crash")
    endless = simulator.drive("endless", 0)
    assert [endless.step("STRAIGHT").ended for _ in range(6)] == [None] * 5 + ["time"]


def test_a_decision_may_last_several_steps_of_the_environment(tmp_path: Path) -> None:
    """Their rewards add up, and the end comes when it comes."""
    drive = opened(tmp_path, CORRIDOR.replace("most_steps", "repeat = 2\nmost_steps")).drive("short", 0)
    assert drive.step("RIGHT") == StepResult(2.0, 1.5, 2.0, crashed=False, ended=None)
    assert drive.step("RIGHT") == StepResult(1.0, 1.5, 3.0, crashed=False, ended="goal")


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("continuous", "environment 'Corridor-v0' has the actions Box(.*); eyechart drives discrete actions"),
        ("cannot be made", "environment 'Corridor-v0' cannot be made: RuntimeError: no licence found"),
    ],
)
def test_an_environment_that_cannot_be_driven_is_refused_when_it_is_opened(
    tmp_path: Path, fault: str, message: str
) -> None:
    """Before any episode begins, on one line."""
    with pytest.raises(SpecError, match=message):
        with_fault(tmp_path, fault)


def look_and_go(drive: Drive) -> None:
    """Go straight three times, and look before each."""
    for _ in range(3):
        drive.picture()
        drive.step("STRAIGHT")


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("black", r"'Corridor-v0' renders a picture of one colour, \(0, 0, 0\), which shows nothing$"),
        ("floats", r"'Corridor-v0' renders float64 of shape \(4, 4, 3\), no RGB picture"),
        ("raises", "'Corridor-v0' raised in step 3: ZeroDivisionError: a wheel fell off"),
        ("reward", "'Corridor-v0' gave the reward nan in step 1"),
        ("tells no speed", "'Corridor-v0': info has no 'speed'; it has sight, x, crashed"),
    ],
)
def test_an_environment_that_fails_under_way_is_an_error_in_words(tmp_path: Path, fault: str, message: str) -> None:
    """One episode ends in it, and what is wrong is said with the environment's name."""
    drive = with_fault(tmp_path, fault).drive("short", 0)
    with pytest.raises(DriveError, match=message):
        look_and_go(drive)
    drive.close()


def test_a_black_picture_under_the_dummy_driver_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It draws nothing then, and says nothing."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    with pytest.raises(DriveError, match="SDL_VIDEODRIVER=dummy makes pygame draw nothing: unset it"):
        with_fault(tmp_path, "black").drive("short", 0).picture()


@pytest.mark.parametrize(
    ("wrong", "right", "message"),
    [
        ("STOP = 4", "STOP = 9", "has the actions 4 to 7, but the action map gives STOP the number 9"),
        ("STOP = 4\n", "", "\\[gym.numbers\\] gives no number for STOP"),
        ("STOP = 4", "HALT = 4", "names 'HALT', not one of"),
        ("STOP = 4", "STOP = 4.0", "gives STOP the number 4.0; it must be a whole number"),
        ('"horizontal"', '"sideways"', "mirror takes vertical, horizontal or none, not 'sideways'"),
        ('"goal"', '"won"', "terminated takes crash or goal, not 'won'"),
        ("most_steps = 6", "most_steps = 0", "most_steps takes a whole number from 1 to 100000, not 0"),
        ("most_steps", "longest", "\\[gym\\] has no 'longest'; it has numbers"),
        ('brake = ["STOP"]', 'brake = ["HALT"]', "brake names 'HALT'"),
    ],
)
def test_a_wrong_action_map_is_named_with_what_is_wrong(tmp_path: Path, wrong: str, right: str, message: str) -> None:
    """With the file, except where the environment is the measure."""
    with pytest.raises(SpecError, match=message):
        opened(tmp_path, CORRIDOR.replace(wrong, right, 1))


def test_the_door_says_what_it_needs(tmp_path: Path) -> None:
    """An unknown environment, no RGB, no map, a map too many, no name, and a bank that cannot be."""
    with pytest.raises(SpecError, match=r"no environment 'Nope-v0': .* is named gym:MODULE:ENV_ID"):
        open_simulator("gym:Nope-v0")
    with pytest.raises(SpecError, match=r"'Typist-v0' renders no RGB pictures; its render modes are \['ansi'\]"):
        open_simulator("gym:Typist-v0")
    with pytest.raises(SpecError, match=r"needs an action map, --actions FILE.toml, that says what its actions 4 to 7"):
        open_simulator("gym:Corridor-v0")
    with pytest.raises(SpecError, match=r"'highway' has actions of its own; an action map is for gym:ENV_ID"):
        open_simulator("highway", actions=tmp_path / "map.toml")
    with pytest.raises(SpecError, match="name an environment, for example gym:CartPole-v1"):
        open_simulator("gym:")
    with pytest.raises(SpecError, match=r"map.toml: no table \[gym\]; write for example \[gym.numbers\]"):
        opened(tmp_path, CORRIDOR[: CORRIDOR.index("[gym]")])
    simulator = opened(tmp_path)
    assert "frames import" in simulator.declared.no_banks
    with pytest.raises(SpecError, match="has no scenario 'long'; known: short, endless"):
        simulator.drive("long", 0)
    with pytest.raises(SpecError, match="seed -1 is out of range"):
        simulator.drive("short", -1)


def test_cartpole_falls_and_is_seen_falling(tmp_path: Path) -> None:
    """A stock environment: its terminated is a crash, and its map needs no more than numbers."""
    text = 'actions = ["LEFT", "RIGHT"]\nmirror_pairs = [["LEFT", "RIGHT"]]\n[gym.numbers]\nLEFT = 0\nRIGHT = 1\n'
    simulator = opened(tmp_path, text, "gym:CartPole-v1")
    assert list(simulator.declared.scenarios) == ["default"]
    drive = simulator.drive("default", 3)
    before, moved = drive.picture(), drive.step("LEFT")
    while moved.ended is None:
        moved = drive.step("LEFT")
    assert (moved.ended, moved.crashed) == ("crash", True)
    assert before.shape == (400, 600, 3)
    assert not np.array_equal(before, drive.picture())
    drive.close()


def test_an_environment_of_another_package_tells_of_itself(tmp_path: Path) -> None:
    """highway-env by its module's name, with a configuration; its speed and crash come from its info."""
    text = """
actions = ["SLOW", "STRAIGHT"]
brake = ["SLOW"]
proceed = ["STRAIGHT"]
[gym.numbers]
SLOW = 4
STRAIGHT = 3
[gym.info]
speed_mps = "speed"
crashed = "crashed"
[gym.scenarios.few.config]
vehicles_count = 3
simulation_frequency = 5
"""
    simulator = opened(tmp_path, text, "gym:highway_env:highway-v0")
    assert {"gymnasium", "highway-env", "action map"} <= simulator.versions().keys()
    drive = simulator.drive("few", 0)
    assert drive.truth()["speed_mps"] == 25.0
    assert drive.step("SLOW").speed_mps < 25.0
    assert drive.picture().shape == (150, 600, 3)
    assert drive.truth()["crashed"] is False
    drive.close()


def test_an_action_map_that_differs_differs_in_its_versions(tmp_path: Path) -> None:
    """So that a run records which map it drove by."""
    one = opened(tmp_path).versions()["action map"]
    assert opened(tmp_path).versions()["action map"] == one
    assert opened(tmp_path, CORRIDOR.replace("LEFT = 6", "LEFT = 7")).versions()["action map"] != one
    assert read_map(tmp_path / "map.toml").numbers["LEFT"] == 7


def test_an_environment_that_draws_into_one_array_changes_no_earlier_picture(tmp_path: Path) -> None:
    """As many do: the picture of a moment stays what it was when the next one is drawn."""

    class Redrawing(Corridor):
        buffer = np.zeros((4, 6, 3), dtype=np.uint8)

        def render(self) -> Any:  # noqa: ANN401
            self.buffer[:] = super().render()
            return self.buffer

    gymnasium.register("Redrawing-v0", entry_point=Redrawing)
    drive = opened(tmp_path, name="gym:Redrawing-v0").drive("short", 5)
    first = drive.picture()
    kept = first.copy()
    drive.step("STRAIGHT")
    assert (drive.picture() != kept).any()
    assert (first == kept).all()
