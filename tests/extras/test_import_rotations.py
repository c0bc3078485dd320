"""Rotations in a LeRobotDataset: declared, asked about where they are plain to see, or refused as wrong."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from data_sets import arm, arrow, describe, reach, rewrite
from eyechart.cli.app import app
from eyechart.errors import SourceError, SpecError
from eyechart.frames import FrameBank, open_bank
from eyechart.importing import Choices, Horizon, import_lerobot
from eyechart.importing.costs import costs
from eyechart.importing.logged_rotations import LoggedRows, Names, Places
from eyechart.importing.motion_log import MotionSegment
from eyechart.spaces.rotations import WIDTH, Representation
from rotated_logs import poses, product, written

pytestmark = pytest.mark.models

STATE = "observation.state"


def posed(
    root: Path,
    how: Representation,
    *,
    names: list[str] | None = None,
    spoil: float = 1.0,
    changes: bool = False,
) -> None:
    """Write a data set of poses, or of their changes."""
    arm(root, inside=True)
    rng = np.random.default_rng(3)
    pa, pq = arrow()
    every = iter(poses(episodes=8, length=10))
    wide = 3 + WIDTH[how]
    for path in sorted((root / "data").rglob("*.parquet")):
        states, done = [], []
        for steps in (next(every) for _ in range(4)):
            for now, after in pairwise(steps):
                one, other = (np.r_[each[0], written(each[1], how, rng)] for each in (now, after))
                if changes:
                    turn = product(now[1] * [-1, -1, -1, 1], after[1])
                    other = np.r_[after[0] - now[0], written(turn * np.sign(turn[3]), how, rng)]
                states.append((one * np.r_[1, 1, 1, [spoil] * WIDTH[how]]).tolist())
                done.append((other * np.r_[1, 1, 1, [spoil] * WIDTH[how]]).tolist())
        table = pq.read_table(path)
        for name, numbers in ((STATE, states), ("action", done)):
            table = table.set_column(table.schema.get_field_index(name), name, pa.array(numbers))
        pq.write_table(table, path)
    describe(
        root, lambda info: [info["features"][name].update(shape=[wide], names=names) for name in (STATE, "action")]
    )


def both(how: str, end: int) -> tuple[str, str]:
    """Return the options for the state and the action."""
    return f"{STATE}[3:{end}]={how}", f"action[3:{end}]={how}"


def bank_of(root: Path, *rotations: str, kind: str | None = None) -> FrameBank:
    """Import a data set for policies."""
    return import_lerobot(root, root.parent / "bank", Choices(), ahead=Horizon(2, kind, rotations=rotations))  # type: ignore[arg-type]


def asked(root: Path, *rotations: str) -> str:
    """Return what a refused import says."""
    with pytest.raises(SpecError) as refused:
        bank_of(root, *rotations)
    assert not (root.parent / "bank").exists()
    return str(refused.value)


@pytest.mark.parametrize("how", ["quat_xyzw", "axis_angle", "rot6d", "euler_xyz", "euler_ZYX_deg"])
def test_absolute_poses_are_told_in_every_representation(tmp_path: Path, how: Representation) -> None:
    """Also with signs and wraps at random; the bank measures each rotation from the state's."""
    posed(tmp_path / "set", how)
    bank = bank_of(tmp_path / "set", *both(how, 3 + WIDTH[how]))
    space = bank.manifest.motion
    assert space is not None
    assert space.kind == "absolute"
    assert [(one.of, one.first, one.state) for one in space.rotations] == [("motion", 3, 3), ("state", 3, None)]
    assert [one.state for one in space.dimensions] == [0, 1, 2, *[None] * WIDTH[how]]
    assert any("rotations, compared by their angle: " in line for line in costs(bank))


def test_changes_of_a_pose_are_told(tmp_path: Path) -> None:
    """A small turn is a rotation too, and is measured from no state."""
    posed(tmp_path / "set", "axis_angle", changes=True)
    bank = bank_of(tmp_path / "set", *both("axis_angle", 6))
    space = bank.manifest.motion
    assert space is not None
    assert space.kind == "delta"
    assert {one.state for one in space.rotations} == {None}


@pytest.mark.parametrize(
    ("how", "says"),
    [("quat_xyzw", "quat_xyzw"), ("axis_angle", "axis_angle"), ("rot6d", "rot6d")],
)
def test_numbers_that_are_plainly_a_rotation_are_asked_about(tmp_path: Path, how: Representation, says: str) -> None:
    """With the option that answers; `none` is an answer too."""
    posed(tmp_path / "set", how)
    words = ["frames", "import", str(tmp_path / "set"), "--horizon", "2", "--out", str(tmp_path / "bank")]
    end = 3 + WIDTH[how]
    said = asked(tmp_path / "set")
    for name in (STATE, "action"):
        assert f"rotation '{name}[3:{end}]={says}'" in said
        assert f"rotation '{name}[3:{end}]=none'" in said
    words += ["--format", "lerobot", "--kind", "absolute"]
    result = CliRunner().invoke(app, [*words, *(word for one in both("none", end) for word in ("--rotation", one))])
    assert result.exit_code == 0, result.output
    space = open_bank(tmp_path / "bank").manifest.motion
    assert space is not None
    assert not space.rotations


def test_rotations_of_other_counts_are_named_as_compared_alone(tmp_path: Path) -> None:
    """A motion of one and a state of none that is declared; where both have one, nothing is said."""
    posed(tmp_path / "set", "quat_xyzw")
    state, action = both("quat_xyzw", 7)
    paired = bank_of(tmp_path / "set", state, action)
    assert not any("belong to none" in line for line in costs(paired))
    (tmp_path / "two").mkdir()
    posed(tmp_path / "two" / "set", "rot6d")
    bank = bank_of(tmp_path / "two" / "set", f"{STATE}[3:9]=rot6d", f"{STATE}[0:3]=axis_angle", "action[3:9]=rot6d")
    space = bank.manifest.motion
    assert space is not None
    assert [one.state for one in space.rotations_of("motion")] == [None]
    (line,) = (line for line in costs(bank) if "belong to none" in line)
    assert line.startswith("the motion has 1 rotation and the state 2: 1 belong to none of the state's")


def test_a_quaternion_that_turns_about_one_axis_is_asked_about() -> None:
    """Two of its numbers are zero in every row, and two readings are missing; zeros and ones alone are none."""
    turns = np.linspace(0.1, 2.8, 40)
    zero = np.zeros(40)
    places: Places = {"motion": [("action", place) for place in range(4)], "state": []}
    names: Names = {"motion": ["a", "b", "c", "d"], "state": []}

    def of(rows: np.ndarray) -> LoggedRows:
        return LoggedRows.of([MotionSegment(rows, np.zeros((40, 0)))], places, names)

    about_z = np.stack([zero, zero, np.sin(turns / 2), np.cos(turns / 2)], axis=1)
    with pytest.raises(SpecError, match=r"action\[0:4\] look like a rotation \(quat_xyzw\)"):
        of(about_z).rotations([])
    missing = about_z.copy()
    missing[[3, 17]] = 0.0
    with pytest.raises(SpecError, match=r"action\[0:4\] look like a rotation"):
        of(missing).rotations([])
    missing[:20] = 0.0
    assert of(missing).rotations([]) == ()
    one_hot = np.eye(4)[np.arange(40) % 4]
    assert of(one_hot).rotations([]) == ()
    assert of(about_z * [1, 1, 1, 0.9]).rotations([]) == ()


def test_a_quaternion_whose_names_say_that_w_is_first_is_asked_about_as_that(tmp_path: Path) -> None:
    """And the other order is refused."""
    posed(tmp_path / "set", "quat_wxyz", names=["x", "y", "z", "qw", "qx", "qy", "qz"])
    assert "rotation 'action[3:7]=quat_wxyz'" in asked(tmp_path / "set")
    assert "its first number is named 'qw', as in quat_wxyz" in asked(tmp_path / "set", *both("quat_xyzw", 7))


@pytest.mark.parametrize(
    ("how", "declared", "spoil", "says"),
    [
        ("quat_xyzw", "quat_xyzw", 1.1, "a quaternion has length 1, and one row has 1.1"),
        ("rot6d", "rot6d", 1.1, "must have length 1 and a right angle, and one row is off by 0.1"),
        ("axis_angle", "axis_angle", 57.3, "a rotation vector has at most 2 pi radians, .* are these degrees?"),
        ("euler_xyz", "euler_xyz", 57.3, "an angle has at most 2 pi radians, .* declare euler_xyz_deg"),
        ("euler_xyz", "euler_xyz_deg", 1.0, "no angle is beyond pi; are these radians\\? Declare euler_xyz"),
        ("euler_ZYX_deg", "euler_ZYX_deg", 10.0, "an angle has at most 360 degrees, and one row has"),
        ("rot6d", "quat_xyzw", 1.0, r"a quaternion has length 1, .*\[3:9\] look like rot6d"),
    ],
)
def test_a_rotation_that_the_data_contradict_is_refused(
    tmp_path: Path, how: Representation, declared: Representation, spoil: float, says: str
) -> None:
    """With what is wrong with the numbers, and what they look like."""
    posed(tmp_path / "set", how, spoil=spoil)
    with pytest.raises(SpecError, match=says):
        bank_of(tmp_path / "set", *both(declared, 3 + WIDTH[declared]))


@pytest.mark.parametrize(
    ("how", "declared", "first"),
    [("quat_xyzw", "axis_angle", 3), ("quat_xyzw", "euler_xyz", 4), ("rot6d", "euler_ZYX", 5)],
)
def test_three_numbers_of_a_longer_rotation_are_no_rotation(
    tmp_path: Path, how: Representation, declared: Representation, first: int
) -> None:
    """Angles of a quaternion's imaginary numbers would be half of the turn."""
    posed(tmp_path / "set", how)
    end = 3 + WIDTH[how]
    said = asked(tmp_path / "set", f"action[3:{end}]={how}", f"{STATE}[{first}:{first + 3}]={declared}")
    assert f"={declared}: they are a part of {STATE}[3:{end}], which look like {how}" in said


@pytest.mark.parametrize(
    ("option", "says"),
    [
        ("action[3:7]", "write FEATURE"),
        ("action[3:7]=quat", "a rotation is quat_xyzw"),
        ("action[3:6]=quat_xyzw", "has 4 numbers, and"),
        ("action[5:9]=quat_xyzw", "'action' has 7 numbers"),
        ("actoin[3:7]=quat_xyzw", "no such feature; did you mean 'action'"),
        ("action[7:3]=none", "[7:3] holds no number"),
        ("action[3:3]=none", "[3:3] holds no number"),
    ],
)
def test_a_malformed_option_is_refused(tmp_path: Path, option: str, says: str) -> None:
    """Each with its own words."""
    posed(tmp_path / "set", "quat_xyzw")
    assert says in asked(tmp_path / "set", option)


@pytest.mark.parametrize("other", ["action[2:5]=euler_xyz", "action[3:7]=none"])
def test_a_number_belongs_to_one_rotation(tmp_path: Path, other: str) -> None:
    """Two options that overlap are refused, and the first number of both is named."""
    posed(tmp_path / "set", "quat_xyzw")
    assert "declares a number twice: action[3:4]" in asked(tmp_path / "set", "action[3:7]=quat_xyzw", other)


def test_an_ordinary_log_of_joints_is_not_asked_about(tmp_path: Path) -> None:
    """Neither wandering joints, nor a joint that wraps at half a turn, nor a one-hot word of four numbers."""
    reach(tmp_path / "set", {"action": None})
    assert bank_of(tmp_path / "set").manifest.motion is not None
    rng = np.random.default_rng(4)
    joints = np.cumsum(0.2 * rng.normal(size=(400, 10)), axis=0)
    joints[:, 0] = (np.linspace(0, 40, 400) + np.pi) % (2 * np.pi) - np.pi
    joints[:, 1:3] = 0.05 * rng.normal(size=(400, 2)) + 0.1
    joints[:, 6:] = np.eye(4)[rng.integers(0, 4, 400)]
    walk = MotionSegment(joints, joints)
    places: Places = {of: [("arm", number) for number in range(10)] for of in ("motion", "state")}
    names: Names = {of: [f"j{number}" for number in range(10)] for of in ("motion", "state")}
    assert LoggedRows.of([walk], places, names).rotations([]) == ()


def test_degrees_beside_radians_are_named(tmp_path: Path) -> None:
    """Not taken for changes, nor for places: the message says which of both is in degrees."""
    names: dict[str, list[str] | None] = {STATE: ["a", "b"], "action": ["a", "b"]}
    reach(tmp_path / "set", names)
    for path in (tmp_path / "set/data").rglob("*.parquet"):
        rewrite(path, lambda rows: [row | {STATE: np.degrees(row[STATE]).tolist()} for row in rows])
    with pytest.raises(SourceError, match="the motion in radians and the state in degrees"):
        bank_of(tmp_path / "set")
