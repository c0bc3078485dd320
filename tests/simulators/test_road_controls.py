"""The controls of rover and drone: which moments have them, what is seen of the far one, and a road without a lead."""

import numpy as np
import pytest

from banks import ALONG
from eyechart.cameras import FORWARD, ROVER
from eyechart.conditions import OLDER
from eyechart.frames import EXCHANGE, Draws, Frame, FrameBank, check, decode, draws_of
from eyechart.perception.forward import ForwardReading, read_forward
from eyechart.simulators.drone import Drone
from eyechart.simulators.road import Layout, Obstacle
from eyechart.simulators.road.staged_moments import FAR_M, draw_ranged
from eyechart.simulators.road.world import lowest_m
from eyechart.simulators.rover import Rover
from eyechart.simulators.rover.world import start


@pytest.fixture(scope="module", params=[Rover, Drone])
def bank(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of one seed."""
    return request.param().build(tmp_path_factory.mktemp("road") / "bank", seeds=(5,))


def read(bank: FrameBank, frame: Frame, name: str) -> ForwardReading:
    """Return what a control shows to a reader that knows nothing else."""
    reading = read_forward(decode(bank.image(frame, name), frame.id), FORWARD[bank.manifest.simulator])
    assert reading is not None
    return reading


def metres(frame: Frame, name: str) -> float:
    """Return a distance of a frame."""
    value = frame.truth[name]
    assert isinstance(value, float)
    return value


def test_nearly_every_frame_has_every_control(bank: FrameBank) -> None:
    """All but those without a lead, where the lead is in no picture that could lack it."""
    assert check(bank.root) == []
    for name in ALONG[:-1]:
        assert sum(name in frame.counterfactuals for frame in bank) >= 0.95 * len(bank)
    for frame in bank:
        assert frame.counterfactuals.keys().isdisjoint(OLDER)
        assert ("lead_absent" in frame.counterfactuals) == frame.truth["lead_visible"]


@pytest.mark.parametrize("across", [-0.35, 0.0, 0.35])
def test_the_far_one_is_seen_beside_the_near_lead(across: float) -> None:
    """Half of its width or more stands free of the near lead, whichever way that leans."""
    lead = Obstacle(10.0, across, 0.6, 1.0, 0)
    world = start(Layout("single", (lead,)))
    for seed in range(20):
        made = draw_ranged(world, draws(seed), np.random.default_rng(seed))
        if made.distances[EXCHANGE] > 4.4:
            continue  # by its depth in the picture the far one can no more be told from the near one
        rows, columns = np.nonzero((made.pictures["exchange_own"] != made.pictures["lead_absent"]).any(axis=2))
        deepest = np.array([rows[columns == column].max(initial=0) for column in range(ROVER.width)])
        far = (deepest > 0) & (deepest < ROVER.horizon + 16)
        away_m = np.hypot(FAR_M[1] + lead.radius, 2.0)
        assert far.sum() >= 0.5 * 2 * lead.radius * ROVER.focal_px / away_m - 1


def test_without_a_lead_nothing_is_read_on_the_own_track(bank: FrameBank) -> None:
    """The sides are as they are in the true picture."""
    for frame in bank:
        if "lead_absent" in frame.counterfactuals:
            assert read(bank, frame, "lead_absent").scene.gap_m is None


def test_without_a_lead_no_control_is_drawn() -> None:
    """There is nothing that could be exchanged, moved or taken away."""
    beside = Obstacle(10.0, 2.0, 0.5, 1.0, 0)
    world = start(Layout("single", (beside,)))
    assert draw_ranged(world, draws(0), np.random.default_rng(0)).pictures == {}


def draws(seed: int) -> Draws:
    """Return the distances that are tried of one frame."""
    return draws_of(seed, (lowest_m("rover"), FAR_M[1]), ["one"])["one"]
