"""The rover under the controller: intents once a second, plans five times, and nothing that prefers a side."""

from dataclasses import replace

import numpy as np
import pytest

from eyechart.errors import SpecError
from eyechart.mpc import MpcPlan
from eyechart.simulators import StepResult, execute, open_bank_simulator
from eyechart.simulators.rover.hierarchy import MpcDrive, RoverMpc, RoverMpcLateral, RoverMpcUnaware

ACTIONS = RoverMpc.declared.action_space.actions
MIRRORED = RoverMpc.declared.action_space.reflect


def driven(drive: MpcDrive, intents: list[str]) -> list[tuple[StepResult, bytes]]:
    """Drive by a list of intents; return each move with the state after it."""
    moves = []
    for intent in intents:
        moved = drive.step(intent)
        moves.append((moved, drive.state()))
        if moved.ended is not None:
            break
    return moves


def reflected(moved: StepResult) -> StepResult:
    """Return the move in the mirrored world: where it ended across the road, and how it was turned, change sign."""
    sides = {name: -float(moved.facts[name] or 0.0) for name in ("y_m", "yaw")}
    return replace(moved, facts={**moved.facts, **sides})


@pytest.mark.parametrize("arm", [RoverMpc, RoverMpcUnaware, RoverMpcLateral])
def test_a_mirrored_world_with_mirrored_intents_gives_the_mirrored_drive_to_the_bit(arm: type[RoverMpc]) -> None:
    """Over random worlds and intents, those of three arms: 51 in all; and a repeat is equal to the bit."""
    rng = np.random.default_rng(7)
    for number in range(17):
        family = list(arm.declared.scenarios)[number % len(arm.declared.scenarios)]
        intents = [str(one) for one in rng.choice(ACTIONS, 12, p=[0.05, 0.1, 0.35, 0.25, 0.25])]
        here, there = arm().drive(family, number), arm().drive(family, number, mirrored=True)
        moves, others = driven(here, intents), driven(there, [MIRRORED(intent) for intent in intents])
        assert [moved for moved, _ in moves] == [reflected(moved) for moved, _ in others]
        assert here.state() == there.world.mirrored().as_bytes()
        assert driven(arm().drive(family, number), intents) == moves


def test_what_the_controller_is_told_makes_the_arms() -> None:
    """Told of the obstacles it goes round them, untold it drives into them; the lateral arm does not slow down."""
    told, untold, lateral = (arm().drive("offset", 0) for arm in (RoverMpc, RoverMpcUnaware, RoverMpcLateral))
    assert driven(told, ["STRAIGHT"] * 40)[-1][0].ended == "goal"
    assert driven(untold, ["STRAIGHT"] * 40)[-1][0].ended == "crash"
    slow = driven(lateral, ["SLOW"] * 4)[-1][0]
    assert slow.speed_mps > 4.0
    assert driven(RoverMpcUnaware().drive("offset", 0), ["SLOW"] * 4)[-1][0].speed_mps == pytest.approx(2.5, abs=0.05)


@pytest.mark.parametrize("arm", [RoverMpc, RoverMpcUnaware, RoverMpcLateral])
def test_where_nothing_is_decided_the_rover_stops_in_every_arm(arm: type[RoverMpc]) -> None:
    """Also where a STOP that was decided leaves the speed to the cruise; afterwards it drives on."""
    drive = arm().drive("single", 0)
    moves = [execute(drive, "STOP", decided=False) for _ in range(4)]
    assert moves[-1].speed_mps == pytest.approx(0.0, abs=0.01)
    assert "0 m/s" in drive.sketch().words
    again = [execute(drive, "STRAIGHT", decided=True) for _ in range(4)]
    assert again[-1].speed_mps > 4.0
    decided = arm().drive("single", 0)
    assert (execute(decided, "STOP", decided=True).speed_mps > 1.0) == (arm is RoverMpcLateral)


def test_a_stop_stands_still_and_lasts_until_the_time_is_up() -> None:
    """Forty intents of a second each."""
    moves = driven(RoverMpc().drive("single", 0), ["STOP"] * 50)
    assert (len(moves), moves[-1][0].ended) == (40, "time")
    assert moves[-1][0].distance_m < 1.0


def test_every_move_says_how_often_the_solver_failed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Five plans a second; a failed one brakes, and stands in the record with the solver's code."""
    drive = RoverMpc().drive("single", 0)
    moved = drive.step("STRAIGHT")
    assert moved.facts == {"plans": 5, "solver_failures": 0, "solver_flag": 1, **side_of(drive)}
    brake = MpcPlan(-5.0, 0.0, solved=False, flag=-1, path=np.zeros((8, 2)))
    monkeypatch.setattr("eyechart.mpc.Mpc.plan", lambda *_: brake)
    moved = drive.step("STRAIGHT")
    assert moved.facts == {"plans": 5, "solver_failures": 5, "solver_flag": -1, **side_of(drive)}
    assert moved.speed_mps == 0.0


def side_of(drive: MpcDrive) -> dict[str, object]:
    """Return where across the road a drive stands, and how it is turned."""
    return {"y_m": drive.truth()["y_m"], "yaw": drive.truth()["yaw"]}


def test_a_sketch_lies_where_the_picture_before_the_decision_shows_the_ground() -> None:
    """The target is the track's middle, the way begins at the vehicle, a mirrored world has mirrored lines."""
    here, there = RoverMpc().drive("slalom", 1), RoverMpc().drive("slalom", 1, mirrored=True)
    with pytest.raises(ValueError, match="there is no plan yet"):
        here.sketch()
    for intent in ("STRAIGHT", "LEFT"):
        before = here.truth()
        here.step(intent)
        there.step(MIRRORED(intent))
    sketch, other = here.sketch(), there.sketch()
    assert (sketch.words, other.words) == ("4 m/s on the left track", "4 m/s on the right track")
    for name in ("plan", "target", "driven"):
        mine, theirs = getattr(sketch, name), getattr(other, name)
        np.testing.assert_allclose(mine[:, 0], 320 - theirs[:, 0], atol=1e-9)
        np.testing.assert_allclose(mine[:, 1], theirs[:, 1], atol=1e-9)
    assert here.driven[0] == (before["x_m"], before["y_m"])
    assert here.driven[-1] == (here.truth()["x_m"], here.truth()["y_m"])
    assert len(sketch.plan) == 8
    assert sketch.plan[-1][0] < 160 < other.plan[-1][0]


def test_the_truth_says_how_far_each_track_is_free() -> None:
    """From the left, as the driver sees it; the mirrored world says it the other way round."""
    here, there = RoverMpc().drive("slalom", 1), RoverMpc().drive("slalom", 1, mirrored=True)
    names = ("free_left_m", "free_middle_m", "free_right_m")
    own = [here.truth()[name] for name in names]
    assert own == [there.truth()[name] for name in reversed(names)]
    assert own[0] != own[2]
    assert all(isinstance(one, float) and 0 <= one <= 30 for one in own)


@pytest.mark.parametrize("name", ["rover-mpc", "rover-mpc-unaware", "rover-mpc-lateral"])
def test_it_makes_no_banks_and_says_whose_serve(name: str) -> None:
    """Its pictures are the plain rover's."""
    with pytest.raises(SpecError, match=f"simulator '{name}' makes no banks: its pictures are those of 'rover'"):
        open_bank_simulator(name)
