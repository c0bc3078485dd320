from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import banks
from eyechart.conditions import (
    ABSENT,
    AGAIN,
    BATTERY,
    CONDITIONS,
    CONTROLS,
    COUNTERFACTUALS,
    FEWEST,
    FURTHER,
    MID_GREY,
    OF_BANKS,
    OLDER,
    RANGED,
    find_condition,
    flip,
    is_available,
    partner,
    require_partners,
    sample,
    show,
    sources,
)
from eyechart.errors import BankError, SpecError
from eyechart.frames import MAIN, Frame, FrameBank, MirrorAxis, decode, encode
from eyechart.stats.paired_tests import pairs_to_bound
from eyechart.verdicts import BOUND_ALPHA


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank that no test changes."""
    return banks.build_bank(tmp_path_factory.mktemp("conditions") / "bank")


def pixels(condition: str, frame: Frame, bank: FrameBank, seed: int = 0) -> np.ndarray:
    """Return the pixels that a condition shows."""
    return decode(show(condition, frame, bank, seed).images[MAIN], condition)


class Extreme(FrameBank):
    """A bank whose pictures hold the least and the largest value alone."""

    def read(self, file: str) -> bytes:
        """Return the one picture."""
        del file
        return encode(np.tile(np.array([0, 255, 0], np.uint8), (4, 4, 1)))


@pytest.mark.parametrize("name", OF_BANKS)
def test_every_condition_keeps_its_contract(name: str, bank: FrameBank) -> None:
    """A picture of the frame's size, the same in any order of making; an error where it is not available."""
    assert CONDITIONS[name].name == name
    assert CONDITIONS[name].image
    assert CONDITIONS[name].asks
    assert ("counterfactual" in CONDITIONS[name].needs) == (name in {*COUNTERFACTUALS, *CONTROLS} - {"nudged", AGAIN})
    assert not (name in BATTERY and CONDITIONS[name].needs & {"counterfactual", "control", "text", "drive"})
    if "text" in CONDITIONS[name].needs:
        told = tuple(replace(frame, fields={"speed": place}) for place, frame in enumerate(bank))
        bank = replace(bank, frames=told, said=("speed",))
    able = [frame for frame in bank if is_available(name, frame)]
    forward = {frame.id: show(name, frame, bank, 3) for frame in able}
    for frame in reversed(able):
        assert show(name, frame, bank, 3) == forward[frame.id]
    for frame in able:
        picture = forward[frame.id].images.get(MAIN)
        if picture is None:
            assert name == "text_only"
        else:
            assert decode(picture, name).shape == decode(bank.image(frame), "real").shape
    for frame in bank:
        if not is_available(name, frame):
            with pytest.raises(BankError, match=f"frame '{frame.id}'"):
                show(name, frame, bank, 3)


def test_the_battery_is_the_eight_of_the_table_in_its_order() -> None:
    """Table t:conditions of the paper."""
    expected = ("real", "real_repeat", "blank", "noise", "shuffled", "cross_scenario", "text_only", "mirrored")
    assert expected == BATTERY == tuple(CONDITIONS)[:8]
    assert COUNTERFACTUALS == ("lead_near", "lead_far", "recoloured")
    along = (name for name in CONTROLS if name in RANGED)
    assert (*OLDER, *FURTHER, "lead_absent", "real_again", "nudged", *along) == CONTROLS
    assert len(RANGED) == 7
    start = OF_BANKS.index("recoloured") + 1
    assert OF_BANKS[start : start + len(CONTROLS)] == CONTROLS


def test_real_and_its_repeat_are_the_very_bytes_of_the_frame(bank: FrameBank) -> None:
    """Nothing is encoded anew, so that nothing but the call differs."""
    for frame in bank:
        assert show("real", frame, bank, 0) == show("real_repeat", frame, bank, 1)
        assert show("real", frame, bank, 0).images == {MAIN: bank.image(frame)}


def test_blank_is_uniform_mid_grey(bank: FrameBank) -> None:
    """Of the frame's size, whatever the seed."""
    for frame in bank:
        assert (pixels("blank", frame, bank, seed=frame.step) == MID_GREY).all()
    assert MID_GREY == 128


def test_noise_is_of_its_key(bank: FrameBank) -> None:
    """The same twice; another for another frame or another run seed; spread over all values."""
    shown = [pixels("noise", frame, bank) for frame in bank]
    assert len({picture.tobytes() for picture in shown}) == len(bank)
    assert not np.array_equal(shown[0], pixels("noise", bank.frames[0], bank, seed=1))
    values = np.concatenate([picture.ravel() for picture in shown])
    assert (values.min(), values.max()) == (0, 255)
    assert abs(values.mean() - 127.5) < 2


def test_text_only_shows_nothing(bank: FrameBank) -> None:
    """No picture, not an empty one."""
    assert [show("text_only", frame, bank, 0).images for frame in bank] == [{}] * len(bank)


def test_counterfactuals_are_the_drawn_ones_and_only_where_drawn(bank: FrameBank) -> None:
    """A frame without a lead has none, and says so."""
    for name in COUNTERFACTUALS:
        for frame in bank:
            assert is_available(name, frame) == (frame.truth["lead_gap_m"] is not None)
            if is_available(name, frame):
                assert show(name, frame, bank, 0).images == bank.images(frame, name)
        assert {is_available(name, frame) for frame in bank} == {True, False}


def test_nudged_is_another_file_of_the_same_picture(bank: FrameBank) -> None:
    """One value of one pixel is off by one, also where it is 0 or 255; which one is of the frame and the run's seed."""
    for frame in bank:
        off = pixels("nudged", frame, bank).astype(int) - pixels("real", frame, bank)
        assert np.abs(off).sum() == 1
        assert show("nudged", frame, bank, 0).images != show("real", frame, bank, 0).images
    shown = [show("nudged", bank.frames[0], bank, seed).images[MAIN] for seed in range(5)]
    assert len(set(shown)) == 5
    extreme = Extreme(bank.root, bank.frames, bank.manifest)
    places = [pixels("nudged", bank.frames[0], extreme, seed).astype(int) for seed in range(9)]
    assert all(np.abs(place - [0, 255, 0]).sum() == 1 for place in places)


@st.composite
def scenarios(draw: st.DrawFn) -> FrameBank:
    """Draw a bank of frames without pictures: partners are chosen before any is read."""
    kinds = draw(st.lists(st.sampled_from("abcd"), min_size=1, max_size=12))
    frames = tuple(banks.one(f"f{at}", (kind, kind, at), "vertical", f"{at}.png") for at, kind in enumerate(kinds))
    return FrameBank(Path("nowhere"), frames, banks.manifest())


@given(scenarios(), st.integers(0, 2**63 - 1), st.sampled_from(["shuffled", "cross_scenario"]))
def test_a_partner_is_another_frame_of_the_right_scenario_or_an_error(bank: FrameBank, seed: int, name: str) -> None:
    """Never the frame itself; where there is no other, the message names the frame and what the bank lacks."""
    count = Counter(frame.scenario for frame in bank)
    for frame in bank:
        same = name == "shuffled"
        if (count[frame.scenario] > 1) if same else (len(count) > 1):
            chosen = partner(frame, bank, seed, name)
            assert chosen.id != frame.id
            assert (chosen.scenario == frame.scenario) is same
            assert partner(frame, bank, seed, name) == chosen
        else:
            with pytest.raises(BankError) as refused:
                partner(frame, bank, seed, name)
            assert f"frame '{frame.id}' has no partner for {name}" in str(refused.value)
            assert f"'{frame.scenario}'" in str(refused.value)
            with pytest.raises(BankError, match="has no partner"):
                require_partners((name,), bank)


def test_every_possible_partner_is_chosen_by_some_seed(bank: FrameBank) -> None:
    """The choice is not stuck to one frame of the bank."""
    frame = bank.frames[0]
    own = {other.id for other in bank if other.scenario == frame.scenario} - {frame.id}
    assert {partner(frame, bank, seed, "shuffled").id for seed in range(100)} == own
    others = {other.id for other in bank if other.scenario != frame.scenario}
    assert {partner(frame, bank, seed, "cross_scenario").id for seed in range(200)} == others


def test_conditions_that_need_no_partner_ask_for_none(bank: FrameBank) -> None:
    """One frame is enough for the rest of the battery."""
    one = replace(bank, frames=bank.frames[:1])
    needy = {"shuffled", "cross_scenario", "text_swapped"}
    require_partners(tuple(name for name in CONDITIONS if name not in needy), one)
    with pytest.raises(BankError, match="another frame in scenario 'light'"):
        require_partners(("shuffled",), one)


@pytest.mark.parametrize("axis", ["vertical", "horizontal"])
def test_mirroring_follows_the_frames_axis_and_twice_is_the_identity(axis: MirrorAxis, tmp_path: Path) -> None:
    """Rows for a top-down road, columns for a forward camera."""
    bank = banks.build_bank(tmp_path / "bank", scenarios=["light"], episodes=1, axis=axis)
    for frame in bank:
        real, mirrored = pixels("real", frame, bank), pixels("mirrored", frame, bank)
        assert np.array_equal(mirrored, real[::-1] if axis == "vertical" else real[:, ::-1])
        assert not np.array_equal(mirrored, real)
        assert np.array_equal(flip(flip(real, axis), axis), real)


def test_a_frame_without_an_axis_is_not_mirrored(tmp_path: Path) -> None:
    """It is not available, an error when asked for, and no axis is guessed."""
    bank = banks.build_bank(tmp_path / "bank", scenarios=["light"], episodes=1, axis="none")
    frame = bank.frames[0]
    assert not is_available("mirrored", frame)
    with pytest.raises(BankError, match=f"frame '{frame.id}' has no mirror axis"):
        show("mirrored", frame, bank, 0)
    with pytest.raises(SpecError, match="not 'none'"):
        flip(pixels("real", frame, bank), "none")
    assert all(is_available(name, frame) for name in BATTERY if name != "mirrored")


def test_cameras_that_mirror_each_other_exchange_their_pictures(tmp_path: Path) -> None:
    """What the left wrist sees in the reflected world is what the right one sees here, flipped; the state stays."""
    rig = banks.build_rig(tmp_path / "rig")
    for frame in rig:
        seen = {name: decode(image, name) for name, image in rig.images(frame).items()}
        made = show("mirrored", frame, rig, 0)
        assert list(made.images) == ["left", "right"]
        assert np.array_equal(decode(made.images["left"], "left"), seen["right"][:, ::-1])
        assert np.array_equal(decode(made.images["right"], "right"), seen["left"][:, ::-1])
        assert made.state == frame.state == show("blank", frame, rig, 0).state


@pytest.mark.parametrize(
    "name", [name for name in OF_BANKS if not CONDITIONS[name].needs & {"counterfactual", "text"} and name != AGAIN]
)
def test_a_condition_over_one_camera_leaves_the_others_as_they_are(name: str, tmp_path: Path) -> None:
    """It changes that camera's picture as it does over all, or takes it away."""
    rig = banks.build_rig(tmp_path / "rig")
    for frame in rig:
        real, over = rig.images(frame), show(f"{name}@right", frame, rig, 0)
        assert over.images["left"] == real["left"]
        assert (over.images.get("right") == real["right"]) == (name in {"real", "real_repeat"})
        assert ("right" in over.images) == (name != "text_only")
        assert is_available(f"{name}@right", frame)
        assert set(sources(f"{name}@right", frame, rig, 0)) >= set(frame.pictures.values())
    if name in {"blank", "mirrored"}:
        assert over.images["right"] == show(name, frame, rig, 0).images["right"]
    with pytest.raises(BankError, match="has no camera 'wrist'; it has left, right"):
        show(f"{name}@wrist", frame, rig, 0)


def test_an_unknown_condition_lists_the_known() -> None:
    """So that the next try succeeds."""
    with pytest.raises(SpecError) as refused:
        find_condition("grey")
    assert "'grey'" in str(refused.value)
    assert all(name in str(refused.value) for name in CONDITIONS)


def test_the_source_of_a_condition_is_the_file_that_it_shows(bank: FrameBank) -> None:
    """Of the paper's conditions and the counterfactuals: a blank, noise and a reflection are made of the frame."""
    for name in (*BATTERY, "lead_near", "lead_far", "recoloured"):
        for frame in bank:
            if not is_available(name, frame):
                continue
            files, images = sources(name, frame, bank, 3), show(name, frame, bank, 3).images
            if name == "text_only":
                assert files == ()
            elif name in {"blank", "noise", "mirrored"}:
                assert files == (frame.file,)
            else:
                assert [(bank.root / file).read_bytes() for file in files] == [*images.values()]


def test_a_sampled_control_adds_its_share_of_the_calls_and_is_asked_of_enough_to_bound_an_effect() -> None:
    """Of 800 calls a twentieth is forty; another seed asks other frames, more calls the same ones and more."""
    ids = [f"f{number:02d}" for number in range(60)]
    few = sample("lead_absent", ids, 800, 1)
    assert len(few) == 40
    assert few < sample("lead_absent", ids, 1000, 1)
    assert len(sample("lead_absent", ids, 1000, 1)) == 50
    assert few != sample("lead_absent", ids, 800, 2)
    assert sample("lead_absent", ids, 10_000, 1) == set(ids)
    assert pairs_to_bound(alpha=BOUND_ALPHA) == FEWEST
    assert len(sample("lead_absent", ids, 336, 1)) == FEWEST
    assert sample("lead_absent", ids[:7], 84, 1) == set(ids[:7])


@pytest.mark.parametrize(("frames", "conditions"), [(36, 11), (72, 11), (144, 11), (288, 11), (18, 11), (144, 8)])
def test_the_true_picture_with_the_absent_lead_costs_a_twentieth_at_most(frames: int, conditions: int) -> None:
    """Of all calls without it; its frames are among those of the picture without the lead."""
    ids, calls = [f"f{index}" for index in range(frames)], frames * conditions
    absent, again = (sample(name, ids, calls, 3) for name in (ABSENT, AGAIN))
    assert again <= absent
    assert len(again) >= 0.8 * len(absent) or frames < 36
    assert calls + len(absent) + len(again) <= 1.05 * (calls + len(absent))
