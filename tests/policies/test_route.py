"""The route is told how far each track is free; the mirrored policy is wrong wherever a side matters."""

import pytest

from eyechart.errors import SpecError
from eyechart.frames import Scalar
from eyechart.policies import Observation, open_policy
from eyechart.spaces.discrete import DRIVING
from eyechart.spaces.space import Decision


def observed(truth: dict[str, Scalar]) -> Observation:
    """Return a moment with this truth."""
    return Observation("rover-mpc/single/0/000", 0, lambda: None, truth, DRIVING, 0)


def decided(spec: str, left: float, middle: float, right: float, *, track: int = 1) -> Decision[str]:
    """Return what a policy decides on the middle track, or another."""
    truth: dict[str, Scalar] = {"free_left_m": left, "free_middle_m": middle, "free_right_m": right, "track": track}
    return open_policy(spec, DRIVING, lambda _: {}).decide(observed(truth))


@pytest.mark.parametrize(
    ("free", "track", "action"),
    [
        ((30.0, 30.0, 30.0), 1, "STRAIGHT"),
        ((30.0, 15.0, 30.0), 1, "STRAIGHT"),
        ((30.0, 14.0, 8.0), 1, "LEFT"),
        ((8.0, 14.0, 30.0), 1, "RIGHT"),
        ((10.0, 8.0, 30.0), 0, "RIGHT"),
        ((30.0, 8.0, 10.0), 2, "LEFT"),
        ((8.0, 8.5, 8.0), 1, "SLOW"),
        ((8.8, 8.0, 8.0), 1, "SLOW"),
        ((4.9, 4.0, 3.0), 1, "STOP"),
    ],
)
def test_the_route_goes_towards_the_freest_track(free: tuple[float, float, float], track: int, action: str) -> None:
    """It stays where 15 m are free, and stops where no track leads on."""
    assert decided("route", *free, track=track) == Decision(action)


def test_the_mirrored_policy_takes_the_other_side_and_is_itself_a_policy() -> None:
    """What has no side stays; mirrored twice is the policy itself."""
    assert decided("mirrored:route", 30.0, 14.0, 8.0) == Decision("RIGHT")
    assert decided("mirrored:mirrored:route", 30.0, 14.0, 8.0) == Decision("LEFT")
    assert decided("mirrored:constant:SLOW", 30.0, 14.0, 8.0) == Decision("SLOW")


def test_a_world_that_does_not_tell_its_tracks_is_refused_by_name() -> None:
    """As is a name after it, and a policy that is none."""
    with pytest.raises(SpecError, match="'route' needs a simulator that tells track, free_left_m"):
        open_policy("route", DRIVING, lambda _: {}).decide(observed({"lead_gap_m": 3.0}))
    with pytest.raises(SpecError, match="policy 'route' takes nothing after its name"):
        open_policy("route:far", DRIVING, lambda _: {})
    with pytest.raises(SpecError, match="unknown policy 'nobody'"):
        open_policy("mirrored:nobody", DRIVING, lambda _: {})
