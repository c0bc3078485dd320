"""Rotations: one pose is one motion in every representation, whatever the sign and the wrap of its numbers."""

from collections.abc import Mapping
from itertools import count
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation as Turn

from eyechart.api import PolicyReport, examine_policy, run_policies
from eyechart.calls import Reply
from eyechart.channels import CAMERAS, partners
from eyechart.errors import SourceError, SpecError
from eyechart.spaces.motion import Dimension, Motion, MotionSpace
from eyechart.spaces.rotations import REPRESENTATIONS, Representation, Rotation, angle, compared, matrices, vectors
from eyechart.stats.partners import NOBODY
from rotated_logs import of_vector, product, rotated_bank, rotated_policy, written

Reports = dict[Representation, PolicyReport]
ANGLES = [one for one in REPRESENTATIONS if one.startswith("euler")]
COMPARED = [one for one in REPRESENTATIONS if one not in ANGLES or one in {"euler_xyz", "euler_ZYX_deg"}]
"""For whole runs angles of one order about fixed axes are enough, and degrees about axes that turn along."""


@pytest.fixture(scope="module")
def reports(tmp_path_factory: pytest.TempPathFactory) -> Reports:
    """Return the reports on one policy and one log in every representation."""
    found, root = {}, tmp_path_factory.mktemp("rotations")
    for how in COMPARED:
        bank = rotated_bank(root / how, how)
        found[how] = run_policies(bank, {"mine": rotated_policy(how)}, root / how / "run")
    return found


def test_shares_and_verdicts_are_equal_in_every_representation(reports: Reports) -> None:
    """Of the cameras and of the state, with their intervals; and the labels, guards and partners."""
    first, *others = (reports[how] for how in COMPARED)
    mine = first["python:mine"]
    assert (mine.channels["cameras"].value or 0.0) > 0.1
    assert not mine.guards
    for other in others:
        theirs = other["python:mine"]
        assert (theirs.camera.label, theirs.state.label, theirs.guards) == (
            mine.camera.label,
            mine.state.label,
            mine.guards,
        )
        assert theirs.channels.keys() == mine.channels.keys()
        rows = [{(row["statistic"]): row for row in one.rows()} for one in (first, other)]
        assert rows[0].keys() == rows[1].keys()
        for name, row in rows[0].items():
            for key in ("value", "low", "high"):
                if name != "memory" and row[key] is not None:
                    assert rows[1][name][key] == pytest.approx(row[key], abs=1e-6), name


def test_similar_states_are_the_same_frames_in_every_representation(reports: Reports) -> None:
    """A frame's match has a near pose, not near numbers."""
    banks = [one.score.bank for one in reports.values()]
    for how in ("matched", "near"):
        first, *others = (
            partners(bank.frames, how, CAMERAS, bank.manifest.images, bank.manifest.motion).tolist() for bank in banks
        )
        assert set(first) != {NOBODY}
        assert others == [first] * len(others)


def test_a_table_whose_numbers_are_another_rotation_is_refused(tmp_path: Path) -> None:
    """With what is wrong, and what the numbers look like."""
    said = "a quaternion has length 1, and one row has .*motion.3:9. look like rot6d"
    with pytest.raises(SourceError, match=said):
        rotated_bank(tmp_path, "rot6d", declared="quat_xyzw")


@pytest.mark.parametrize("how", REPRESENTATIONS)
def test_a_rotation_is_one_matrix_whatever_its_sign_and_wrap(how: Representation) -> None:
    """Equal to rounding; the angle of a turn between two rotations is that turn."""
    rng = np.random.default_rng(0)
    for size in (1e-7, 0.3, 3.1, np.pi):
        axis = rng.normal(size=3)
        turn = of_vector(size * axis / np.linalg.norm(axis))
        start = of_vector(rng.normal(size=3))
        both = [matrices(written(one, how, rng), how) for one in (start, product(start, turn)) for _ in range(4)]
        assert np.ptp(both[:4], axis=0).max() < 1e-12
        between = both[0].T @ both[4]
        assert float(angle(compared(between))) == pytest.approx(size, abs=2e-6)
        assert np.linalg.norm(vectors(between)) == pytest.approx(size, abs=1e-6)
        assert matrices(vectors(between), "axis_angle") == pytest.approx(between, abs=1e-6)


@pytest.mark.parametrize("how", ANGLES)
def test_three_angles_are_the_rotation_that_scipy_makes_of_their_word(how: Representation) -> None:
    """Fixed axes in small letters, axes that turn along in capitals, radians or degrees."""
    numbers = np.random.default_rng(2).uniform(-3, 3, (9, 3)) * (50 if how.endswith("_deg") else 1)
    expected = Turn.from_euler(how[6:9], numbers, degrees=how.endswith("_deg")).as_matrix()
    np.testing.assert_allclose(matrices(numbers, how), expected, rtol=0, atol=1e-12)
    others = [one for one in ANGLES if one != how]
    assert all(np.abs(matrices(numbers, one) - expected).max() > 0.1 for one in others)


def space(*rotations: Rotation, **how: object) -> MotionSpace:
    """Return a space of a place and a quaternion, beside a state of the same."""
    dimensions = tuple(Dimension(name) for name in ("x", "qx", "qy", "qz", "qw"))
    given = {"kind": "absolute", "state": dimensions, "rotations": rotations, **how}
    return MotionSpace("pose", dimensions, 1, **given)  # type: ignore[arg-type]


OWN, THEIRS = Rotation("quat_xyzw", 1, state=1), Rotation("quat_xyzw", 1, "state")


def test_a_distance_is_that_of_the_angle_and_of_plain_numbers() -> None:
    """A quaternion and its negative have none; a small turn has its angle, with the weight of three numbers."""
    of = space(OWN, THEIRS)
    rows = [np.array([[0.5, *sign * of_vector(np.array([0, 0, turn]))]]) for sign, turn in ((1, 0), (-1, 0), (1, 1e-3))]
    same, negative, turned = map(Motion.of, rows)
    assert of.distance(same, negative) == 0
    assert of.distance(same, turned) == pytest.approx(1e-3 / 2, rel=1e-5)
    assert of.parts == {"x": (0,), "rotation qx to qw": tuple(range(1, 10))}
    state = np.array([0.2, *of_vector(np.array([0, 0, 0.3]))])
    found = of.in_parts(of.relative(rows[2], state))
    assert found[0] == pytest.approx([0.5, 0.3 - 1e-3], rel=1e-6)
    assert "rotations" in of.as_dict()
    assert "rotations" not in space().as_dict()


@pytest.mark.parametrize(
    ("rotations", "how", "said"),
    [
        ((OWN, THEIRS), {"mirrored": True}, "the reflection of a rotation is not known"),
        ((Rotation("quat_xyzw", 1),), {"kind": "velocity"}, "a speed of turning is no rotation but a vector"),
        ((Rotation("rot6d", 0),), {}, "one exceeds its numbers"),
        ((Rotation("axis_angle", 0), Rotation("axis_angle", 2)), {}, "share a number"),
        ((OWN,), {}, "belongs to number 1 of the state, where none begins"),
    ],
)
def test_a_space_refuses_rotations_without_a_meaning(
    rotations: tuple[Rotation, ...], how: dict[str, object], said: str
) -> None:
    """Each with a sentence."""
    with pytest.raises(SpecError, match=said):
        space(*rotations, **how)


def test_an_answer_that_is_no_rotation_is_none() -> None:
    """A quaternion of zeros."""
    answer = Reply(Motion.of(np.zeros((1, 5))).text)
    assert space(OWN, THEIRS).read(answer).why == "not_a_rotation"
    assert "a quaternion of zeros" in space(OWN, THEIRS).lacks(answer)


def test_a_rotation_has_one_row_and_one_curve(reports: Reports, tmp_path: Path) -> None:
    """On the page, in the tables, and in what a statistic says of its dimensions."""
    report = reports["quat_xyzw"]
    page = report.to_html(tmp_path / "page.html").read_text()
    assert "rotation ar0 to ar3" in page
    assert "Of a rotation its angle is drawn, in radians." in page
    shares = (report["python:mine"].channels["cameras"].detail or {})["by_dimension"]
    assert list(shares) == ["ax", "ay", "az", "rotation ar0 to ar3"]


def test_the_doctor_finds_a_policy_of_rotations_well(reports: Reports) -> None:
    """A policy whose quaternions have other signs than the log has its size and its units."""
    found = examine_policy(reports["quat_xyzw"].path.parent / "bank", rotated_policy("quat_xyzw"))
    assert [one for one in found.findings if one.fine is False] == []


def test_the_doctor_takes_a_quaternion_and_its_negative_for_one_answer(reports: Reports) -> None:
    """Who alternates between them answers alike, and does not draw."""
    policy, calls = rotated_policy("quat_xyzw"), count()

    def alternating(images: Mapping[str, np.ndarray], state: np.ndarray, instruction: str | None) -> np.ndarray:
        return policy(images, state, instruction) * np.r_[1, 1, 1, [(-1) ** next(calls)] * 4]

    findings = examine_policy(reports["quat_xyzw"].path.parent / "bank", alternating).findings
    found = {one.name: one for one in findings}
    assert found["same"].fine is True
    assert "the same frame gets the same answer" in found["same"].says
    assert found["cameras"].fine is True
