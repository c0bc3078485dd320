import pytest
from hypothesis import given
from hypothesis import strategies as st

from eyechart.spaces.scene import Distances, Scene, safe_action

MIRROR = {"LEFT": "RIGHT", "RIGHT": "LEFT", "STRAIGHT": "STRAIGHT", "SLOW": "SLOW", "STOP": "STOP"}
SCENES = st.builds(Scene, st.none() | st.floats(min_value=0.0, max_value=200.0), st.booleans(), st.booleans())


@given(SCENES)
def test_the_safe_action_of_a_mirrored_scene_is_the_mirrored_action(scene: Scene) -> None:
    """LEFT and RIGHT exchange, every other action stays, with no exception."""
    assert safe_action(scene.mirrored()) == MIRROR[safe_action(scene)]


@given(SCENES)
def test_a_scene_mirrored_twice_is_the_scene_itself(scene: Scene) -> None:
    """Reflection exchanges the sides, keeps the gap, and undoes itself."""
    assert scene.mirrored() == Scene(scene.gap_m, scene.right_clear, scene.left_clear)
    assert scene.mirrored().mirrored() == scene


@pytest.mark.parametrize(
    ("gap_m", "left_clear", "right_clear", "action"),
    [
        (None, True, False, "STRAIGHT"),
        (40.0, False, True, "STRAIGHT"),
        (39.9, True, False, "LEFT"),
        (39.9, False, True, "RIGHT"),
        (39.9, True, True, "SLOW"),
        (39.9, False, False, "SLOW"),
        (12.0, True, False, "LEFT"),
        (11.9, True, False, "STOP"),
        (0.0, False, False, "STOP"),
    ],
)
def test_the_policy_goes_on_turns_slows_or_stops_by_the_gap_and_the_sides(
    *, gap_m: float | None, left_clear: bool, right_clear: bool, action: str
) -> None:
    """Free from 40 m, stop below 12 m, between them the one clear side, and slow where there is no one side."""
    assert safe_action(Scene(gap_m, left_clear, right_clear)) == action


@pytest.mark.parametrize(("gap_m", "close"), [(None, False), (18.0, False), (17.9, True)])
def test_a_lead_is_close_below_eighteen_metres(*, gap_m: float | None, close: bool) -> None:
    """The paper's threshold is strict, and no lead is no close lead."""
    assert Scene(gap_m, left_clear=False, right_clear=False).is_close is close


@pytest.mark.parametrize(("gap_m", "action"), [(4.9, "STOP"), (5.0, "LEFT"), (14.9, "LEFT"), (15.0, "STRAIGHT")])
def test_the_policy_goes_by_the_distances_of_the_scenes_world(gap_m: float, action: str) -> None:
    """A slow rover's distances in the place of the highway's; what is close is likewise the world's."""
    near = Distances(stop_m=5.0, close_m=8.0, free_m=15.0, behind_m=1.0, ahead_m=15.0)
    scene = Scene(gap_m, left_clear=True, right_clear=False, distances=near)
    assert safe_action(scene) == action
    assert safe_action(scene.mirrored()) == MIRROR[action]
    assert scene.is_close == (gap_m < 8.0)
