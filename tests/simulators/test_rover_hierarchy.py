"""The rover under the controller: intents once a second, plans five times, and nothing that prefers a side."""

import numpy as np
import pytest

from eyechart.errors import SpecError
from eyechart.mpc import Plan
from eyechart.simulators import Moved, open_bank_simulator
from eyechart.simulators.rover.hierarchy import MpcDrive, RoverMpc, RoverMpcLateral, RoverMpcUnaware

ACTIONS = RoverMpc.action_space.actions
MIRRORED = RoverMpc.action_space.mirror


def driven(drive: MpcDrive, intents: list[str]) -> list[tuple[Moved, bytes]]:
    """Drive by a list of intents; return each move with the state after it."""
    moves = []
    for intent in intents:
        moved = drive.step(intent)
        moves.append((moved, drive.state()))
        if moved.ended is not None:
            break
    return moves


@pytest.mark.parametrize("arm", [RoverMpc, RoverMpcUnaware, RoverMpcLateral])
def test_a_mirrored_world_with_mirrored_intents_gives_the_mirrored_drive_to_the_bit(arm: type[RoverMpc]) -> None:
    """Over random worlds and intents, those of three arms: 51 in all; and a repeat is equal to the bit."""
    rng = np.random.default_rng(7)
    for number in range(17):
        family = list(arm.scenarios)[number % len(arm.scenarios)]
        intents = [str(one) for one in rng.choice(ACTIONS, 12, p=[0.05, 0.1, 0.35, 0.25, 0.25])]
        here, there = arm().drive(family, number), arm().drive(family, number, mirrored=True)
        moves, others = driven(here, intents), driven(there, [MIRRORED(one) for one in intents])
        assert [moved for moved, _ in moves] == [moved for moved, _ in others]
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


def test_a_stop_stands_still_and_lasts_until_the_time_is_up() -> None:
    """Forty intents of a second each."""
    moves = driven(RoverMpc().drive("single", 0), ["STOP"] * 50)
    assert (len(moves), moves[-1][0].ended) == (40, "time")
    assert moves[-1][0].distance_m < 1.0


def test_every_move_says_how_often_the_solver_failed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Five plans a second; a failed one brakes, and stands in the record with the solver's code."""
    drive = RoverMpc().drive("single", 0)
    assert drive.step("STRAIGHT").facts == {"plans": 5, "solver_failures": 0, "solver_flag": 1}
    brake = Plan(-5.0, 0.0, solved=False, flag=-1, path=np.zeros((8, 2)))
    monkeypatch.setattr("eyechart.mpc.Mpc.plan", lambda *_: brake)
    moved = drive.step("STRAIGHT")
    assert moved.facts == {"plans": 5, "solver_failures": 5, "solver_flag": -1}
    assert moved.speed_mps == 0.0


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
