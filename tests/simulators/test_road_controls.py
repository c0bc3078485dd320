"""The controls of rover and drone: who is near, how near the lead is, and a road without a lead."""

import numpy as np
import pytest

from banks import STAGED
from eyechart.cameras import FORWARD, ROVER
from eyechart.conditions import CONDITIONS
from eyechart.frames import Frame, FrameBank, check, decode
from eyechart.perception.forward import ForwardReading, read_forward
from eyechart.simulators.drone import Drone
from eyechart.simulators.road import Layout, Obstacle
from eyechart.simulators.road.staging import EXCHANGE_M, MIDS_M, draw_controls
from eyechart.simulators.road.world import camera_of
from eyechart.simulators.rover import Rover
from eyechart.simulators.rover.world import start

DRAWN = tuple(name for name in STAGED if "counterfactual" in CONDITIONS[name].needs)


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
    for name in DRAWN[:-1]:
        assert sum(name in frame.counterfactuals for frame in bank) >= 0.98 * len(bank)
    for frame in bank:
        assert ("lead_absent" in frame.counterfactuals) == frame.truth["lead_visible"]


def test_the_mids_show_the_lead_where_the_bank_says(bank: FrameBank) -> None:
    """A reader of pixels finds the kept gap; each third of a range, in the logarithm, holds a fifth of the frames."""
    for name, (low, high) in MIDS_M.items():
        gaps_m = [metres(frame, f"{name}_m") for frame in bank]
        for frame, gap_m in zip(bank, gaps_m, strict=True):
            assert read(bank, frame, name).scene.gap_m == pytest.approx(gap_m, abs=0.1, rel=0.02)
        assert np.histogram(gaps_m, np.geomspace(low, high, 4))[0].min() >= len(bank) / 5


def test_who_is_near_is_exchanged(bank: FrameBank) -> None:
    """The lead is read near in one picture and far in the other; the rest of the picture stays."""
    for frame in bank:
        if "lane_own" not in frame.counterfactuals:
            continue
        own, beside = read(bank, frame, "lane_own").scene, read(bank, frame, "lane_beside").scene
        near_m, far_m = metres(frame, "lane_near_m"), metres(frame, "lane_far_m")
        assert EXCHANGE_M[0][0] <= near_m <= EXCHANGE_M[0][1]
        assert EXCHANGE_M[1][0] <= far_m <= EXCHANGE_M[1][1]
        assert own.gap_m == pytest.approx(near_m, abs=0.1)
        assert beside.gap_m == pytest.approx(far_m, rel=0.03)
        assert not (beside.left_clear and beside.right_clear)
        pixels = {name: decode(bank.image(frame, name), name) for name in ("lane_own", "lane_beside")}
        differ = (pixels["lane_own"] != pixels["lane_beside"]).any(axis=2)
        assert not differ[camera_of(frame.scenario, bank.manifest.simulator).hood].any()
        assert 0.002 < differ.mean() < 0.35


@pytest.mark.parametrize("across", [-0.35, 0.0, 0.35])
def test_the_far_one_is_seen_beside_the_near_lead(across: float) -> None:
    """Half of its width or more stands free of the near lead, whichever way that leans."""
    lead = Obstacle(10.0, across, 0.6, 1.0, 0)
    world = start(Layout("single", (lead,)))
    for seed in range(20):
        made = draw_controls(world, np.random.default_rng(seed))
        rows, columns = np.nonzero((made.pictures["lane_own"] != made.pictures["lead_absent"]).any(axis=2))
        deepest = np.array([rows[columns == column].max(initial=0) for column in range(ROVER.width)])
        far = (deepest > 0) & (deepest < ROVER.horizon + 16)
        away_m = np.hypot(made.distances["lane_far_m"] + lead.radius, 2.0)
        assert far.sum() >= 0.5 * 2 * lead.radius * ROVER.focal_px / away_m - 1


def test_without_a_lead_nothing_is_read_on_the_own_track(bank: FrameBank) -> None:
    """The sides are as they are in the true picture."""
    for frame in bank:
        if "lead_absent" in frame.counterfactuals:
            assert read(bank, frame, "lead_absent").scene.gap_m is None


def test_without_a_lead_no_control_is_drawn() -> None:
    """There is nothing that could be exchanged, moved or taken away."""
    beside = Obstacle(10.0, 2.0, 0.5, 1.0, 0)
    assert draw_controls(start(Layout("single", (beside,))), np.random.default_rng(0)).pictures == {}
