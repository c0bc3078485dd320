"""Verdicts on channels: every label at both sides of its bounds, and what stands in the way said in words."""

from dataclasses import replace

import pytest

from eyechart.gate import hold_policies
from eyechart.stats.risk_bounds import share_bound
from eyechart.stats.shares import LogDistance, Share
from eyechart.stats.statistic import Statistic
from eyechart.verdicts.labels import CAMERA, STATE, meets
from eyechart.verdicts.policy_rules import of_camera, of_state
from eyechart.verdicts.policy_verdict import REQUIREMENTS, judge_policy
from eyechart.verdicts.share_predicates import MissingConditions
from policies_by_hand import (
    A_LITTLE,
    CHANNELS,
    FOLLOWED,
    GOOD,
    IGNORED,
    NOT_ONE_BIT,
    OPEN,
    REVERSED,
    TOO_FEW,
    UNFOLLOWED,
    USED,
    losing,
    share,
    verdict,
    without,
)


def _near_its_pose(coloured: Statistic) -> dict[str, Statistic | None]:
    """Return what changes where pictures of the own episode tell nothing, and exchanged colours so much."""
    return {"beyond@cameras": OPEN, "T.near@cameras": share(0.1, 0.3), "T.exchanged": coloured, "follow": None}


@pytest.mark.parametrize(
    ("changed", "label", "words"),
    [
        ({}, "object_grounded", "followed 60.0 %"),
        ({"follow": None}, "camera_content", "moves no object"),
        ({"follow": Statistic(0.6, 72, (0.30, 0.9), 0.009)}, "camera_content", "lower end is too low"),
        ({"follow": Statistic(0.6, 72, (0.31, 0.9), 0.010)}, "camera_content", "p is not below .01"),
        ({"follow": TOO_FEW}, "camera_content", "below seven episodes"),
        ({"named": UNFOLLOWED}, "camera_content", "because it is named is not shown"),
        ({"matched": IGNORED}, "pose_only", "it reads what its state tells too"),
        ({"matched": None}, "uses_camera", "no state to match by"),
        ({"matched": OPEN}, "uses_camera", "where the state is alike"),
        ({"matched": None, "swap": OPEN}, "undecided", "more episodes make it shorter"),
        (
            {"matched": None, "swap": share(0.0200001, 0.3)},
            "uses_camera",
            "whether it tells more than the pose is open",
        ),
        ({"matched": None, "swap": share(0.02, 0.3)}, "undecided", "more episodes make it shorter"),
        ({"matched": None, "swap": share(0.0300001, 0.5, p=0.01)}, "uses_camera", "no state to match by"),
        ({"matched": None, "swap": share(0.03, 0.5, p=0.01)}, "undecided", "no state to match by"),
        ({"matched": None, "swap": share(0.031, 0.5, p=0.011)}, "undecided", "by chance (p 0.011)"),
        ({"matched": None, "swap": share(0.021, 0.5, episodes=6)}, "uses_camera", "no state to match by"),
        ({"matched": None, "swap": share(0.021, 0.5, episodes=5)}, "undecided", "5 episodes bound nothing"),
        ({"matched": OPEN, "swap": IGNORED}, "undecided", "where the state is alike"),
        ({"swap": OPEN}, "undecided", "more episodes make it shorter"),
        ({"swap": IGNORED, "matched": IGNORED, "blank": IGNORED}, "ignores_camera", "both are below 0.1"),
        ({"swap": IGNORED, "matched": None, "blank": IGNORED}, "ignores_camera", "both are below 0.1"),
        ({"swap": IGNORED, "matched": IGNORED}, "camera_presence", "that there is a picture matters"),
        ({"swap": IGNORED, "matched": IGNORED, "blank": OPEN}, "undecided", "is open: grey ones"),
        ({"swap": IGNORED, "matched": OPEN, "blank": IGNORED}, "undecided", ""),
        ({"swap": share(0.021, 0.5, p=0.02)}, "undecided", "by chance (p 0.020)"),
        ({"swap": share(0.021, 0.5, p=0.01)}, "object_grounded", ""),
        ({"swap": share(0.0, 0.05, episodes=5)}, "undecided", "5 episodes bound nothing"),
        ({"swap": None}, "undecided", "did not ask"),
        (_near_its_pose(share(0.029, 0.5)), "uses_camera", "it may read its own pose"),
        (_near_its_pose(share(0.031, 0.5)), "camera_content", "moves no object"),
    ],
)
def test_the_camera_axis(changed: dict[str, Statistic | None], label: str, words: str) -> None:
    """Each label, and just outside it."""
    found = verdict(**changed).camera
    assert found.label == label
    assert words in f"{found.because} {found.why_not}"


def test_each_camera_has_a_label_of_its_own() -> None:
    """One may be ignored where both together are used; no single one is grounded in an object."""
    found = verdict(**{"T.swapped@camera:wrist": IGNORED, "T.matched@camera:wrist": IGNORED, "T.blank@wrist": IGNORED})
    assert {name: camera.label for name, camera in found.cameras.items()} == {
        "top": "camera_content",
        "wrist": "ignores_camera",
    }
    assert "both are below 0.1, and no episode was found that responds by 0.1 or more" in found.because


@pytest.mark.parametrize(
    ("changed", "label"),
    [
        ({}, "state_used"),
        ({"swap": IGNORED, "matched": IGNORED, "blank": IGNORED}, "state_shortcut"),
        ({"state": IGNORED}, "ignores_state"),
        ({"state": OPEN}, "undecided"),
        ({"state": None}, "undecided"),
    ],
)
def test_the_state_axis(changed: dict[str, Statistic | None], label: str) -> None:
    """A shortcut only where the cameras are ignored."""
    assert verdict(**changed).state.label == label
    assert of_state({}, "undecided", there=False).label == "undecided"


@pytest.mark.parametrize(
    ("changed", "label"),
    [
        ({}, "instruction_followed"),
        ({"told": IGNORED, "named": UNFOLLOWED}, "instruction_ignored"),
        ({"told": IGNORED}, "undecided"),
        ({"told": OPEN}, "undecided"),
        ({"told": None}, "no_power"),
        ({"named": UNFOLLOWED}, "undecided"),
        ({"named": UNFOLLOWED, "follow": UNFOLLOWED}, "undecided"),
        ({"named": UNFOLLOWED, "follow": UNFOLLOWED, "follow.logged": UNFOLLOWED}, "undecided"),
        ({"named": UNFOLLOWED, "follow": UNFOLLOWED, "follow.logged": FOLLOWED}, "instruction_followed"),
        ({"named": REVERSED, "follow": REVERSED}, "undecided"),
        ({"named": REVERSED, "follow": UNFOLLOWED, "follow.logged": FOLLOWED}, "undecided"),
        ({"named": None, "follow": None, "follow.logged": REVERSED}, "undecided"),
        ({"named": None, "follow": None, "follow.logged": FOLLOWED}, "instruction_followed"),
        ({"named": None, "follow": None}, "instruction_followed"),
    ],
)
def test_the_instruction_axis(changed: dict[str, Statistic | None], label: str) -> None:
    """Used, and towards what is named wherever a moved object can tell."""
    assert verdict(**changed).instruction.label == label


@pytest.mark.parametrize(
    ("changed", "guards"),
    [
        ({"motions": Statistic(0.9, 100)}, []),
        ({"motions": Statistic(0.89, 100)}, ["not_scorable"]),
        ({"motions": Statistic(None, 0)}, ["not_scorable"]),
        ({"misfit": LogDistance(1.0, 9, offset=1.01, spread=1.0)}, ["misfit"]),
        ({"misfit": LogDistance(1.0, 9, offset=1.0, spread=3.1)}, ["misfit"]),
        ({"misfit": LogDistance(1.0, 9, offset=1.0, spread=3.0)}, []),
        ({"misfit": LogDistance(0.99, 9, offset=9.0, spread=9.0)}, []),
        ({"variation": Statistic(0.019, 9)}, ["constant"]),
        ({"variation": Statistic(0.02, 9)}, []),
        ({"noise": Statistic(0.51, 9)}, ["self_inconsistent"]),
        ({"noise": Statistic(0.5, 9)}, []),
        ({"variation": Statistic(0.01, 9), "noise": Statistic(0.9, 9)}, ["self_inconsistent"]),
        ({"variation": Share(0.01, 9, with_noise=0.3), "noise": Statistic(0.9, 9)}, ["self_inconsistent"]),
        ({"variation": Share(0.01, 9, with_noise=0.019), "noise": Statistic(0.9, 9)}, ["constant"]),
        ({"variation": Share(0.01, 9, with_noise=0.021), "noise": Statistic(0.5, 9)}, ["constant"]),
        ({"T.nudged": Share(0.6, 9)}, ["self_inconsistent"]),
        ({"T.nudged": Share(0.6, 9, p=0.01)}, ["self_inconsistent"]),
        ({"T.nudged": Share(0.6, 9, p=0.2)}, []),
        ({"variation": Share(None, 9), "noise": Statistic(0.9, 9)}, ["self_inconsistent"]),
    ],
)
def test_guards_come_before_every_axis(changed: dict[str, Statistic], guards: list[str]) -> None:
    """Where one fails nothing else is said, and a gate cannot say."""
    found = verdict(**changed)
    assert list(found.guards) == guards
    if guards:
        labels = {one.label for one in (found.camera, found.state, found.instruction, *found.cameras.values())}
        assert labels == {"undecided"}
        assert found.because.startswith(guards[0])
        assert hold_policies({"m": found}, ["camera:object_grounded"], {}).exit_code == 2


def test_a_gate_holds_fails_or_cannot_say() -> None:
    """Object grounded meets content; an open label and an unfinished run cannot say; another label fails."""
    asks = ["camera:camera_content", "instruction:instruction_followed"]
    assert set(asks) <= REQUIREMENTS.keys()
    assert hold_policies({"m": verdict()}, asks, {}).exit_code == 0
    assert hold_policies({"m": verdict(matched=IGNORED)}, asks, {}).exit_code == 1
    assert hold_policies({"m": verdict(swap=OPEN)}, asks, {}).exit_code == 2
    assert hold_policies({"m": verdict()}, asks, {"m": 3}).exit_code == 2
    assert hold_policies({"m": verdict(told=None)}, asks, {}).exit_code == 2
    assert "camera:undecided" not in REQUIREMENTS


def test_what_a_verdict_says_beside_its_labels() -> None:
    """Paint that decides, and a camera that carries next to nothing."""
    assert verdict().remarks == ()
    assert "another colour" in verdict(**{"T.recoloured": USED}).remarks[0]
    assert "next to nothing" in verdict(swap=share(0.021, 0.099)).remarks[0]


def test_calls_that_are_left_out_are_counted_beside_the_labels() -> None:
    """They may be those of one kind of moment, so that whoever reads the labels must know of them."""
    found = verdict(motions=Statistic(0.92, 200))
    assert found.guards == {}
    (remark,) = found.remarks
    assert remark.startswith("16 of 200 calls hold no motion (9 unparsed: not_finite, 4 refused, 2 timeout): they")
    assert found.as_dict()["remarks"] == [remark]


def test_a_remark_says_no_more_of_the_cameras_than_their_label() -> None:
    """That its pictures are ignored is a remark where that is the label, and not where they may never have arrived."""
    unfit = {"misfit": LogDistance(1.5, 72, offset=0.1, spread=1.1)}
    ignored = verdict(swap=IGNORED, matched=IGNORED, blank=IGNORED, **unfit)
    assert any(remark.startswith("It ignores its cameras") for remark in ignored.remarks)
    unread = verdict(swap=NOT_ONE_BIT, matched=NOT_ONE_BIT, blank=NOT_ONE_BIT, **unfit)
    assert unread.camera.label == "ignores_camera"
    assert any(remark.startswith("It ignores its cameras") for remark in unread.remarks)


@pytest.mark.parametrize(
    ("reads", "label", "words"),
    [
        ((), "ignores_camera", "changes not one bit of 72 answers: it may not be connected"),
        (("cameras", "state"), "ignores_camera", "it may not be connected"),
        (("camera:top",), "ignores_camera", "it may not be connected"),
        (("state",), "ignores_camera", "it declares that it does not read it."),
    ],
)
def test_a_channel_that_changes_not_one_bit_is_ignored_and_may_not_be_connected(
    reads: tuple[str, ...], label: str, words: str
) -> None:
    """The remark is not made of a channel that the policy declares to leave unread."""
    changed = {**GOOD, "T.swapped@state": USED, "T.swapped@cameras": NOT_ONE_BIT, "T.blank": NOT_ONE_BIT}
    found = judge_policy("m", changed, CHANNELS, scope="here.", reads=reads)
    assert found.camera.label == label
    assert words in found.camera.because
    assert ("may not be connected" in found.camera.because) == (reads != ("state",))
    assert found.state.label == "state_shortcut"


def test_a_use_that_the_policy_declares_not_to_make_is_named_as_a_contradiction() -> None:
    """Of each such channel, and of none that it declares; nor where a use is not shown."""
    words = "it declares that it does not read it, which its answers contradict: let it declare that it does"
    top = verdict(reads=("camera:top",))
    assert words in top.instruction.because
    assert words not in top.camera.because + top.cameras["top"].because
    told = verdict(reads=("instruction",))
    assert told.camera.label == "object_grounded"
    assert words in told.camera.because
    assert words not in told.instruction.because
    for found in (verdict(), verdict(reads=("state",), swap=OPEN), verdict(reads=("state",), swap=IGNORED)):
        assert words not in found.camera.because
    told_nothing_else = verdict(reads=("state",), told=None)
    assert words not in told_nothing_else.instruction.because


@pytest.mark.parametrize(
    ("changed", "label", "answer", "code"),
    [
        ({}, "object_grounded", "Yes", 0),
        ({"follow": None}, "camera_content", "Yes", 0),
        ({"matched": IGNORED}, "pose_only", "In part", 0),
        ({"matched": None}, "uses_camera", "In part", 0),
        ({"matched": None, "swap": OPEN}, "undecided", "Inconclusive", 2),
        ({"swap": IGNORED, "matched": IGNORED}, "camera_presence", "No", 1),
        ({"swap": IGNORED, "matched": IGNORED, "blank": IGNORED}, "ignores_camera", "No", 1),
        ({"swap": NOT_ONE_BIT, "matched": NOT_ONE_BIT, "blank": NOT_ONE_BIT}, "ignores_camera", "No", 1),
        ({"swap": OPEN}, "undecided", "Inconclusive", 2),
        ({"motions": Statistic(0.5, 9)}, "undecided", "Inconclusive", 2),
    ],
)
def test_whether_it_looks_is_answered_and_may_be_required(
    changed: dict[str, Statistic | None], label: str, answer: str, code: int
) -> None:
    """By the label of all cameras; met by Yes and In part, and not said of an unfinished run."""
    found = verdict(**changed)
    said = found.as_dict()
    assert (found.camera.label, said["answer"], said["holes"]) == (label, answer, [])
    assert hold_policies({"m": found}, ["looks"], {}).exit_code == code
    assert hold_policies({"m": found}, ["looks"], {"m": 3}).exit_code == 2


@pytest.mark.parametrize(
    ("wanted", "holds"),
    [
        ("looks", True),
        ("camera:uses_camera", True),
        ("camera:object_grounded", None),
        ("camera:camera_content", None),
        ("camera:pose_only", None),
        ("camera:camera_presence", False),
        ("camera:ignores_camera", False),
    ],
)
def test_a_camera_of_which_the_use_is_open_looks_and_shows_no_content(
    wanted: str,
    holds: bool | None,  # noqa: FBT001 - a case
) -> None:
    """What it may be besides is neither given nor refuted, and what is open is printed; less than a use is refuted."""
    why = "60 of 72 frames have no frame of another episode at a similar state"
    found = verdict(matched=None, asked=MissingConditions(lacking={"matched@cameras": why}))
    assert found.camera.label == "uses_camera"
    (check,) = hold_policies({"m": found}, [wanted], {}).checks
    assert check.holds is holds
    assert "whether it tells more than the pose is open" in check.because
    assert why in check.because


def test_noise_buys_no_use_of_a_camera() -> None:
    """Who reads its pose and is noisy claims no more than who does not; who uses nothing is noisy and gets no use."""
    wide = share(0.0, 0.3)
    steady, noisy = verdict(matched=IGNORED).camera, verdict(matched=wide).camera
    assert (steady.label, noisy.label) == ("pose_only", "uses_camera")
    assert CAMERA[noisy.label].rank == CAMERA[steady.label].rank
    assert not set(meets(noisy.label, CAMERA)) - {"uses_camera"} - set(meets(steady.label, CAMERA))
    assert verdict(swap=wide, matched=wide, blank=wide).camera.label == "undecided"


def test_what_may_be_required_of_a_policy_is_read_from_the_rows() -> None:
    """A stronger label meets a weaker one where its row says so, and looks by its answer."""
    assert REQUIREMENTS["camera:camera_content"] == "the camera label is object_grounded or camera_content"
    looks = "the camera label is object_grounded or camera_content or uses_camera or pose_only"
    assert REQUIREMENTS["looks"] == looks
    assert REQUIREMENTS["state:state_used"] == "the state label is state_used"
    assert len(REQUIREMENTS) == 12


def test_a_gate_cannot_say_whether_an_object_is_followed_that_nobody_moved() -> None:
    """Nor where too few episodes could tell; it fails where the object is followed less than would do."""
    asks = ["camera:object_grounded"]
    (check,) = hold_policies({"m": verdict(follow=None, named=None)}, asks, {}).checks
    assert check.holds is None
    assert check.because.endswith("The bank moves no object, so whether it is followed is open.")
    assert hold_policies({"m": verdict(follow=TOO_FEW)}, asks, {}).exit_code == 2
    assert hold_policies({"m": verdict(follow=UNFOLLOWED)}, asks, {}).exit_code == 1
    assert hold_policies({"m": verdict(named=UNFOLLOWED)}, asks, {}).exit_code == 1
    assert hold_policies({"m": verdict()}, asks, {}).exit_code == 0
    assert hold_policies({"m": verdict(matched=IGNORED)}, asks, {}).exit_code == 1


def test_judging_nothing_decides_nothing() -> None:
    """Without any statistic of a channel."""
    assert of_camera({}, "cameras", "its cameras").label == "undecided"


def test_a_verdict_bears_the_name_of_its_policy_and_of_each_camera() -> None:
    """Also where a guard failed; a camera's name may hold a colon."""
    assert {verdict().model, verdict(motions=Statistic(0.5, 9)).model} == {"m"}
    found = {f"T.{kind}@camera:left:arm": IGNORED for kind in ("swapped", "matched")} | {"T.blank@left:arm": USED}
    told = judge_policy("m", GOOD | found, ("camera:left:arm",), scope="here.")
    assert {name: camera.label for name, camera in told.cameras.items()} == {"left:arm": "camera_presence"}


def test_a_share_above_one_is_no_percentage() -> None:
    """It is said to be all and more, with T as it is; an interval that ends above one ends above all."""
    above, across = Share(1.34, 72, (1.1, 1.6), episodes=12), share(0.7, 1.2)
    found = verdict(swap=above, matched=above)
    assert (
        "carry all of the action's variation (T 1.34 [1.10, 1.60]; another moment has T 1), and all of it (T 1.34"
        in found.camera.because
    )
    assert "%" not in found.camera.because.partition("; when it is moved")[0]
    assert any(remark.startswith("A share above 1 (cameras) is no part of a whole") for remark in found.remarks)
    assert "carry 95.0 % [70.0, over 100] of the action's variation" in verdict(swap=across, follow=None).camera.because
    assert verdict(swap=across).as_dict()["channels"]["cameras"]["ci"] == [0.7, 1.2]


@pytest.mark.parametrize(("silent", "high", "said"), [(12, 0.3187, "undecided"), (44, 0.0994, "ignores_camera")])
def test_absence_is_said_of_the_data_set_only_where_few_of_its_episodes_may_respond(
    silent: int, high: float, said: str
) -> None:
    """None of 12 leaves 32 % open, none of 44 less than 10 %; the label of the episodes asked is the same."""
    gone = {"swap": IGNORED, "matched": IGNORED, "blank": IGNORED}
    found = verdict(**gone, **{"responds@cameras": share_bound(0, silent, confidence=0.99)})
    told = found.as_dict()["axes"]["camera"]
    assert found.camera.label == "ignores_camera"
    assert told["data_set"]["label"] == said
    assert told["data_set"]["share_at_most"] == pytest.approx(high, abs=1e-4)
    assert (told["data_set"]["episodes"], told["data_set"]["responding"]) == (silent, 0)
    assert ("up to 32 % of the data set's may; 44 episodes of which" in told["why_not"].replace("%", " %")) == (
        silent == 12
    )
    (check,) = hold_policies({"m": found}, ["camera:ignores_camera"], {}).checks
    assert check.holds
    assert ("of these episodes" in check.because) == (silent == 12)
    assert "data_set" not in verdict(**gone).as_dict()["axes"]["camera"]


GONE = {"swap": IGNORED, "matched": IGNORED, "blank": IGNORED}
UNCONTROLLED = {"beyond@cameras": None, "T.near@cameras": None, "follow": None, "named": None}


@pytest.mark.parametrize(
    ("axis", "changed", "forgot", "words"),
    [
        ("camera", UNCONTROLLED, ("near@cameras",), "the run did not ask near@cameras"),
        ("camera", {**GONE, "matched": None}, ("matched@cameras",), "the run did not ask matched@cameras"),
        ("camera", {"matched": None}, ("matched@cameras",), "the run did not ask matched@cameras"),
        ("camera", {**GONE, "blank": None}, ("blank",), "the run did not ask blank"),
        ("camera", {"swap": None}, ("swapped@cameras",), "the run did not ask swapped@cameras"),
        ("state", {"state": None}, ("swapped@state",), "the run did not ask swapped@state"),
        ("instruction", {"told": None}, ("swapped@instruction",), "the run did not ask swapped@instruction"),
        ("instruction", {"named": None, "follow": None}, ("named_plus",), "the run did not ask named_plus"),
        ("instruction", {"named": None}, ("told_named_plus",), "the run did not ask told_named_plus"),
        ("instruction", {"told": IGNORED, "named": None}, ("told_named_plus",), "did not ask told_named_plus"),
        ("camera", {"noise": Statistic(None, 0, note="")}, ("real_repeat",), "did not ask real_repeat"),
        ("state", {"noise": Statistic(None, 0, note="")}, ("real_repeat",), "did not ask real_repeat"),
    ],
)
def test_what_was_not_asked_gives_no_label_and_passes_no_gate(
    axis: str, changed: dict[str, Statistic | None], forgot: tuple[str, ...], words: str
) -> None:
    """A control, a guard or a condition that the bank could show and the run left out is open, and named."""
    found = verdict(**changed, asked=without(*forgot))
    judged = getattr(found, axis)
    assert judged.label == "undecided"
    assert words in judged.because
    wanted = {"camera": "camera_content", "state": "state_used", "instruction": "instruction_followed"}[axis]
    assert hold_policies({"m": found}, [f"{axis}:{wanted}"], {}).exit_code == 2


@pytest.mark.parametrize(
    ("value", "at_most", "label"),
    [(0.45, 0.45, "object_grounded"), (0.44, 0.44, "camera_content"), (0.2, 0.45, "object_grounded")],
)
def test_who_goes_to_half_of_what_it_is_told_is_not_grounded(value: float, at_most: float, label: str) -> None:
    """Each instruction, and each axis of the world, may have three quarters of the mean at least."""
    even, less = ({"value": one, "at_most": end, "episodes": 6} for one, end in ((0.9, 0.9), (value, at_most)))
    parts = {"told 'reach the red block'": even, "told 'reach the blue block'": less, "along x": even}
    found = verdict(**{"follow.rather": replace(FOLLOWED, parts=parts)}).camera
    assert found.label == label
    said = "told 'reach the blue block' it is followed only 44 % farther than the other, and 60 % on the whole"
    assert (said in found.why_not) == (label == "camera_content")
    assert found.may_be == ("object_grounded" if label == "camera_content" else "")


def test_few_episodes_with_pictures_of_their_own_are_named() -> None:
    """Not as a difference that is not settled."""
    few = {"beyond@cameras": share(0.5, 2.0, episodes=5), "T.near@cameras": share(0.1, 0.3), "follow": None}
    found = verdict(**few).camera
    assert found.label == "uses_camera"
    assert "5 episodes bound nothing; 6 are the least" in found.because
    assert "not settled" not in found.because


def test_what_was_exchanged_in_words_is_quoted() -> None:
    """Whether two texts say the same, a reader sees; a long one is cut."""
    texts = ["reach  red", "go\nto the " + "very " * 20 + "red one"]
    told = replace(IGNORED, texts=texts)
    found = verdict(told=told, named=UNFOLLOWED).instruction
    assert found.label == "instruction_ignored"
    assert "Another instruction (most often 'go to the very" in found.because
    assert "…' for 'reach red')" in found.because


def test_nobody_is_grounded_by_a_control_that_was_left_out() -> None:
    """The named object's own way alone is no ground, where another instruction could have been told."""
    found = verdict(**{"named": None, "follow.rather": FOLLOWED}, asked=without("told_named_plus")).camera
    assert (found.label, found.may_be) == ("camera_content", "object_grounded")
    assert "the run did not ask told_named_plus" in found.why_not


def test_what_a_bank_cannot_show_is_said_as_it_is() -> None:
    """No picture of the own episode is no control passed; one reason of a bank is not given for another."""
    why = "128 of 128 frames have no frame of another episode at a similar state"
    open_match = verdict(matched=None, asked=MissingConditions(lacking={"matched@cameras": why})).camera
    assert open_match.label == "uses_camera"
    assert why in open_match.because
    alone = verdict(**UNCONTROLLED, asked=MissingConditions(lacking={"near@cameras": "12 frames are alone"})).camera
    assert alone.label == "uses_camera"
    assert "12 frames are alone" in alone.because
    few = "9 frames have no frame of another episode that differs there"
    told = verdict(told=None, asked=MissingConditions(lacking={"swapped@instruction": few})).instruction
    assert (told.label, told.because) == ("no_power", f"{few}.")


@pytest.mark.parametrize(
    ("axis", "changed", "label"),
    [
        ("camera", {"swap": losing(USED, 0.10)}, "object_grounded"),
        ("camera", {"swap": losing(USED, 0.11)}, "undecided"),
        ("camera", {"matched": losing(USED, 0.11)}, "uses_camera"),
        ("camera", {"matched": None, "swap": losing(USED, 0.10)}, "uses_camera"),
        ("camera", {"matched": None, "swap": losing(USED, 0.11)}, "undecided"),
        ("camera", {**GONE, "swap": losing(IGNORED, 0.11)}, "undecided"),
        ("camera", {**GONE, "matched": losing(IGNORED, 0.11)}, "undecided"),
        ("camera", {**GONE, "blank": losing(IGNORED, 0.11)}, "undecided"),
        ("camera", {"follow": None, "beyond@cameras": losing(USED, 0.11)}, "uses_camera"),
        ("camera", {"named": losing(FOLLOWED, 0.11)}, "camera_content"),
        ("state", {"state": losing(USED, 0.11)}, "undecided"),
        ("state", {"state": losing(IGNORED, 0.11)}, "undecided"),
        ("instruction", {"told": losing(USED, 0.11)}, "undecided"),
        ("instruction", {"named": losing(FOLLOWED, 0.11)}, "undecided"),
        ("instruction", {"told": IGNORED, "named": losing(UNFOLLOWED, 0.11)}, "undecided"),
        ("camera", {"noise": losing(Share(0.0, 72), 0.11)}, "undecided"),
    ],
)
def test_a_condition_of_which_many_calls_hold_no_motion_says_nothing(
    axis: str, changed: dict[str, Statistic | None], label: str
) -> None:
    """Who declines one kind of question is judged by no rest of it, and the share is said."""
    judged = getattr(verdict(**changed), axis)
    assert judged.label == label
    if any(isinstance(one, Share) and one.lost == 0.11 for one in changed.values()) and label != "camera_content":
        assert "11% of its calls hold no motion" in judged.because


def test_a_pose_is_read_where_pictures_are_used_at_all() -> None:
    """Moments with a match at a similar state may be those in which nothing is looked at."""
    few = Share(0.0, 34, (0.0, 0.01), episodes=12)
    found = verdict(**{"matched": few, "swapped.alike@cameras": IGNORED}).camera
    assert found.label == "uses_camera"
    assert "(34 of 72 moments have one)" in found.because
    found = verdict(**{"matched": few, "swapped.alike@cameras": USED}).camera
    assert (found.label, "(34 of 72 moments have one)" in found.because) == ("pose_only", True)


CARRIED = Share(0.05, 72, (0.0, 0.099), episodes=12, carried={"grip": 0.84, "step 8": 0.2})


@pytest.mark.parametrize(
    ("axis", "changed"),
    [
        ("camera", {**GONE, "swap": CARRIED}),
        ("camera", {**GONE, "blank": CARRIED}),
        ("camera", {"matched": CARRIED}),
        ("state", {"state": CARRIED}),
        ("instruction", {"told": CARRIED, "named": UNFOLLOWED}),
    ],
)
def test_a_mean_hides_no_number(axis: str, changed: dict[str, Statistic | None]) -> None:
    """A gripper, or the last step, that goes with a channel is not ignored because the rest does not."""
    judged = getattr(verdict(**changed), axis)
    assert judged.label == ("uses_camera" if changed.keys() == {"matched"} else "undecided")
    assert "grip (T 0.84), step 8 (T 0.20)" in judged.because
    assert "both are below" not in judged.because


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("T.decoys", "further objects change"),
        ("T.recoloured", "other colours of the table change"),
        ("T.exchanged", "the objects' colours exchanged change"),
        ("T.swapped@camera:top", "the top camera alone carries"),
    ],
)
def test_no_absence_is_said_against_a_picture_that_is_used(name: str, words: str) -> None:
    """Nor is the state said to be all; by which camera other objects were seen is open too."""
    found = verdict(**GONE, **{name: USED, "T.blank@wrist": IGNORED, "T.blank@top": IGNORED})
    assert found.camera.label == "undecided"
    assert words in found.camera.because
    assert found.state.label == "state_used"
    single = {camera.label for camera in found.cameras.values()}
    assert single == ({"undecided"} if "@" not in name else {"pose_only", "ignores_camera"})
    ignored = verdict(**GONE, **{name: IGNORED})
    assert (ignored.camera.label, ignored.state.label) == ("ignores_camera", "state_shortcut")


def test_an_object_that_is_followed_is_seen() -> None:
    """Whatever other episodes' pictures change."""
    assert verdict(**GONE, follow=FOLLOWED).camera.label == "undecided"
    assert verdict(matched=IGNORED, follow=FOLLOWED).camera.label == "uses_camera"


def test_no_absence_rests_on_a_control_that_it_fails_on() -> None:
    """Further objects make it fail, so that whether it answers to them is open; moved ones bound nothing either."""
    nothing = Share(None, 0, note="it fails on 72 of 72 pictures with further objects")
    failing = MissingConditions(failing={"decoys": (72, 72)})
    found = verdict(**GONE, asked=failing, **{"T.decoys": nothing}).camera
    assert found.label == "undecided"
    assert (
        "whether other pictures show a use is open: it fails on 72 of 72 pictures with further objects" in found.because
    )
    assert verdict(**GONE, **{"T.decoys": IGNORED}).camera.label == "ignores_camera"
    moved = verdict(follow=None, asked=MissingConditions(failing={"named_plus": (70, 72)}))
    assert (moved.camera.label, moved.camera.may_be) == ("camera_content", "object_grounded")
    assert (
        "it fails on 70 of 72 pictures with the named object moved, so whether it is followed is open"
        in moved.camera.why_not
    )
    assert moved.remarks[0].startswith(
        "It fails on 70 of 72 pictures with the named object moved: what it would do there is not known"
    )


def test_failures_on_many_kinds_of_pictures_are_one_clause() -> None:
    """With their number and the worst of them in words, and with what it is judged by, if by anything."""
    moves = [
        f"{told}{which}_{side}" for told in ("", "told_") for which in ("named", "other") for side in ("plus", "minus")
    ]
    failing = {name: (place + 20, 48) for place, name in enumerate(moves)} | {"blank@top": (40, 48)}
    asked = MissingConditions(failing=failing)
    worst = "t fails on 9 kinds of computed pictures, at worst on 40 of 48 blank pictures of the top camera: what it"
    judged = verdict(named=None, follow=None, asked=asked)
    assert judged.remarks[0] == f"I{worst} would do there is not known, and it is judged by its other answers"
    of_moves = "it fails on 8 kinds of computed pictures, at worst on 27 of 48 pictures with the other object moved and"
    assert of_moves in judged.camera.why_not
    assert of_moves in judged.instruction.because
    found = verdict(named=None, follow=None, asked=asked, motions=Statistic(0.7, 9))
    assert "it fails on" not in str(found).lower(), "it fails on all kinds of pictures"
    found = verdict(named=None, follow=None, asked=asked, noise=Statistic(0.9, 9))
    assert found.remarks[0] == f"I{worst} would do there is not known, and its other answers are not judged either"
    for said in (judged, found):
        assert "_plus" not in str(said)
        assert str(said).count("it fails on") <= 4


def test_noise_is_a_remark_and_no_label() -> None:
    """No robot is shown noise; but who answers to it was given its pictures."""
    found = verdict(**GONE, **{"T.noise": USED})
    assert found.camera.label == "ignores_camera"
    assert any(remark.startswith("Noise in place of its pictures changes") for remark in found.remarks)
    same = {**dict.fromkeys(GONE, NOT_ONE_BIT), "follow": UNFOLLOWED, "named": UNFOLLOWED}
    assert "may not be connected" in verdict(**same).camera.because
    assert "does not reach" not in verdict(**same, **{"T.noise": USED}).camera.because


def test_several_cameras_are_ignored_one_at_a_time() -> None:
    """Where all together are not, each may tell what the others tell."""
    gone = {f"T.{kind}@camera:{name}": IGNORED for kind in ("swapped", "matched") for name in ("top", "wrist")}
    gone |= {f"T.blank@{name}": IGNORED for name in ("top", "wrist")}
    found = verdict(**gone)
    assert {camera.label for camera in found.cameras.values()} == {"ignores_camera"}
    assert "while the others are there: wrist could be exchanged too, but" in found.cameras["top"].because
    whole = verdict(**gone, **GONE)
    assert "while the others are there" not in whole.because


def test_a_state_is_said_to_be_used_and_no_more() -> None:
    """Not that cameras have a part, nor that nothing else has one."""
    assert STATE["state_used"].says == "Its state is used."
    assert "alone" not in STATE["state_shortcut"].says
    found = verdict(**GONE).state
    assert (found.label, "another instruction changes" in found.because) == ("state_shortcut", True)
    assert "instruction" not in verdict(**GONE, told=IGNORED).state.because


def test_what_it_is_told_and_what_it_does_are_two_things() -> None:
    """Where nothing is moved that is said, and where it hardly goes there."""
    open_ = verdict(named=None, follow=None).instruction
    assert (open_.label, "is not tested" in open_.because) == ("instruction_followed", True)
    hardly = verdict(named=Statistic(0.05, 72, (0.02, 0.08), 0.0002)).instruction
    assert (hardly.label, "only 5.0 % [2.0, 8.0]" in hardly.because) == ("undecided", True)
    little = Statistic(0.15, 72, (0.12, 0.18), 0.0002)
    found = verdict(named=little)
    assert found.instruction.label == "instruction_followed"
    assert any("hardly does what it is told" in remark for remark in found.remarks)
    away = verdict(named=REVERSED, follow=REVERSED).instruction
    assert "goes away from what is named" in away.because


def test_a_share_above_one_has_more_than_one_reason() -> None:
    """Moments of two episodes may be told the same, and then differ less than with another instruction."""
    above = Share(1.64, 72, (1.1, 2.4), episodes=12)
    (remark,) = (one for one in verdict(told=above).remarks if one.startswith("A share above 1"))
    assert "which may have the same there" in remark


@pytest.mark.parametrize("name", ["swap", "state", "told"])
def test_no_share_is_printed_that_is_none(name: str) -> None:
    """What nobody measured carries no dash of the action."""
    for none in (None, Statistic(None, 0, note="one episode alone")):
        assert "—" not in str(verdict(**{name: none}).as_dict())


@pytest.mark.parametrize(("responding", "label"), [(4, "ignores_camera"), (5, "undecided"), (11, "undecided")])
def test_no_absence_is_said_of_episodes_that_respond(responding: int, label: str) -> None:
    """Up to a tenth of those asked may; of drawn answers chance makes some look so, and it is said of the mean."""
    some = {"responds@cameras": share_bound(responding, 44, confidence=0.99)}
    found = verdict(**GONE, **some).camera
    assert found.label == label
    assert ("episodes each respond" in found.because) == (label == "undecided")
    assert "without anybody noticing" not in found.because
    drawn = {name: replace(one, p=0.5) for name, one in GONE.items()}
    for noise, as_drawn in ((0.011, "ignores_camera"), (0.009, label)):
        assert verdict(**drawn, **some, noise=Statistic(noise, 72)).camera.label == as_drawn


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"noise": Share(0.1, 72, seeds=2)}, "that is at one seed"),
        ({"T.blank": replace(IGNORED, p=0.5, scatter=0.03, scatter_p=0.01)}, "scatter"),
    ],
)
def test_no_absence_is_said_of_a_mean_or_a_seed_alone(changed: dict[str, Statistic], words: str) -> None:
    """Where another seed changes the margin of absence, or the answers scatter otherwise, not by chance."""
    found = verdict(**GONE, **changed)
    assert (found.camera.label, words in found.camera.because) == ("undecided", True)
    little = Share(0.099, 72, seeds=2)
    chance = replace(IGNORED, p=0.5, scatter=0.03, scatter_p=0.011)
    small = replace(IGNORED, p=0.5, scatter=0.02, scatter_p=0.001)
    for fine in ({"noise": little}, {"T.blank": chance}, {"T.blank": small}):
        assert verdict(**GONE, **fine).camera.label == "ignores_camera"


def test_a_control_of_absence_that_was_not_asked_is_none_that_was_passed() -> None:
    """Moved objects, other colours, further objects, and each camera: each is named."""
    for left_out in ("decoys", "exchanged", "recoloured", "named_plus", "swapped@camera:top", "nudged"):
        found = verdict(**GONE, asked=without(left_out)).camera
        assert (found.label, f"did not ask {left_out}" in found.because) == ("undecided", True), left_out


def test_who_answers_to_a_nudged_picture_and_to_none_by_more_is_inconsistent() -> None:
    """Nothing is said of any axis; who answers to others by more has noise, and who ignores all has next to none."""
    found = verdict(**{"T.nudged": USED, "swap": OPEN})
    assert "one level off" in found.guards["self_inconsistent"]
    assert "another episode's change more is not shown" in found.guards["self_inconsistent"]
    assert {axis.label for axis in found.axes.values()} == {"undecided"}
    assert verdict(**{"T.nudged": share(0.0, 0.0)}).guards == {}
    reader = verdict(**{"T.nudged": USED})
    assert (reader.camera.label, reader.guards) == ("object_grounded", {})
    assert any("its noise hangs on the bytes" in remark for remark in reader.remarks)
    nothing = dict.fromkeys(("swap", "matched", "blank"), IGNORED)
    assert verdict(**{"T.nudged": IGNORED}, **nothing).camera.label == "ignores_camera"


@pytest.mark.parametrize(
    ("state", "reads", "label"),
    [
        (USED, USED, "state_used"),
        (USED, share(0.0, 0.15), "undecided"),
        (USED, share(0.0, 0.01), "ignores_state"),
        (IGNORED, IGNORED, "ignores_state"),
        (IGNORED, USED, "undecided"),
    ],
)
def test_places_are_held_against_what_was_answered(state: Statistic, reads: Statistic, label: str) -> None:
    """Relative to another state the same place is another motion."""
    assert verdict(state=state, **{"reads@state": reads}).state.label == label


def test_an_object_is_followed_because_it_is_named_and_towards_it() -> None:
    """By the margin of the claim, and within 45 degrees."""
    little = Statistic(0.2, 72, (0.15, 0.25), 0.0002)
    less = Statistic(0.29, 72, (0.28, 0.30), 0.0002)
    beside = replace(FOLLOWED, heading=0.7)
    toward = replace(FOLLOWED, heading=0.72)
    assert verdict(named=little).camera.label == "camera_content"
    assert "less than half" in verdict(named=less).camera.why_not
    assert verdict(named=Statistic(0.3, 72, (0.16, 0.44), 0.0002)).camera.label == "object_grounded"
    assert verdict(follow=beside).camera.label == "camera_content"
    assert "46 degrees" in verdict(follow=beside).camera.why_not
    assert verdict(follow=toward).camera.label == "object_grounded"


def test_a_gate_cannot_say_what_may_be_so() -> None:
    """Of an instruction that the log does not settle, where nothing is moved; and an interval above the margin does."""
    open_ = Statistic(0.2, 72, (-0.3, 0.7), 0.2)
    found = verdict(named=None, follow=None, **{"follow.logged": open_})
    assert (found.instruction.label, found.instruction.may_be) == ("undecided", "instruction_followed")
    assert hold_policies({"m": found}, ["instruction:instruction_followed"], {}).exit_code == 2
    sure = verdict(named=None, follow=None, **{"follow.logged": Statistic(2.5, 72, (0.63, 4.4), 0.02)})
    assert sure.instruction.label == "instruction_followed"
    assert verdict(**{"named": A_LITTLE, "follow": UNFOLLOWED, "follow.logged": open_}).instruction.label == "undecided"


def test_a_number_of_another_unit_is_named_though_the_error_is_small() -> None:
    """By its name; a guard only fails where the whole does not fit."""
    small = LogDistance(0.4, 72, offset=0.1, spread=9.0, spread_of="dx", offset_of="dy")
    found = verdict(misfit=small)
    assert found.guards == {}
    assert any(remark.startswith("The spread of 'dx' is another by a factor of 9") for remark in found.remarks)


def test_a_command_names_the_bank_of_the_run() -> None:
    """By its path, as a shell takes it, wherever a verdict says what to ask."""
    unread = {"T.swapped@state": Share(0.0, 72, (0.0, 0.0), episodes=12, same=1.0)}
    missingconditions = MissingConditions(bank="banks/my arm")
    found = judge_policy("m", GOOD | unread, CHANNELS, scope="here.", left_out=missingconditions)
    assert "'eyechart doctor SPEC --frames 'banks/my arm'' asks" in found.state.because
    assert "BANK" not in str(found)


def test_what_is_said_of_one_camera_alone_ends_its_last_sentence() -> None:
    """Behind the remark that it may not be connected, where that is made too."""
    same = Share(0.0, 72, (0.0, 0.0), episodes=12, same=1.0)
    names = ("camera:left", "camera:right")
    shares = {f"T.{kind}@{name}": same for name in names for kind in ("swapped", "matched")}
    greys = {f"T.blank@{name.partition(':')[2]}": same for name in names}
    found = judge_policy("m", GOOD | shares | greys, (*CHANNELS, *names), scope="here.")
    assert [found.cameras[name].label for name in ("left", "right")] == ["ignores_camera"] * 2
    said = found.cameras["left"].because
    assert ". Another picture of left changes not one bit" in said
    assert said.endswith("since they may show the same.")
    assert ".;" not in said
