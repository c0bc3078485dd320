"""Channels: what each condition exchanges of what a policy is given, and whose it is."""

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import banks
from arm_logs import arm_bank
from eyechart.channels import (
    CAMERAS,
    INSTRUCTION,
    MOVES,
    STATE,
    TOLD,
    channels_of,
    far_off,
    flat_state,
    instruction_column,
    instruction_key,
    logs,
    partner_of,
    partners,
    rare,
    reflected,
)
from eyechart.cli.app import app
from eyechart.conditions import find_condition, is_available, show, sources
from eyechart.conditions.policies import conditions_of, further_conditions, listed_conditions, unshown_channels
from eyechart.errors import BankError, SpecError
from eyechart.frames import Frame, FrameBank, Stimulus, decode
from eyechart.importing import costs
from eyechart.report.contact_sheet import contact_sheet, write_frame
from eyechart.simulators import open_bank_simulator


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a tabletop of eight episodes."""
    return open_bank_simulator("tabletop").build(tmp_path_factory.mktemp("channels") / "bank", seeds=(0, 1), steps=4)


def own(bank: FrameBank, frame: Frame) -> Stimulus:
    """Return what a frame is."""
    return Stimulus(bank.images(frame), frame.fields, frame.state)


def test_a_bank_has_its_cameras_its_state_and_its_instruction(bank: FrameBank) -> None:
    """Each camera is a channel where there are several."""
    assert channels_of(bank) == (CAMERAS, "camera:top", "camera:wrist", STATE, INSTRUCTION)
    assert instruction_column(bank) == INSTRUCTION


def far_apart(one: Frame, other: Frame, spread: np.ndarray) -> float:
    """Return the squared distance of two states, as a share of that of two at random."""
    apart = (np.array(flat_state(one.state)) - flat_state(other.state)) / spread
    return float((apart**2).sum() / (2 * len(spread)))


@pytest.mark.parametrize("channel", [CAMERAS, "camera:top", "camera:wrist", STATE, INSTRUCTION])
def test_a_swap_exchanges_one_channel_for_another_episodes_and_nothing_else(bank: FrameBank, channel: str) -> None:
    """It differs there, and all other channels are the frame's own; what is kept is the reverse."""
    for frame in bank:
        seen, mine = show(f"swapped@{channel}", frame, bank, 0), own(bank, frame)
        other = partner_of(frame, bank, "swapped", channel)
        assert other.drive != frame.drive
        whole = {**mine.images, STATE: mine.state, INSTRUCTION: mine.fields}
        theirs = {**bank.images(other), STATE: other.state, INSTRUCTION: other.fields}
        found = {**seen.images, STATE: seen.state, INSTRUCTION: seen.fields}
        names = ("top", "wrist") if channel == CAMERAS else (channel.removeprefix("camera:"),)
        assert found == {name: (theirs if name in names else whole)[name] for name in whole}
        assert found != whole


def test_what_is_kept_is_all_that_is_the_frames_own(bank: FrameBank) -> None:
    """The other channels come from one frame of another episode together."""
    for frame in bank:
        seen, other = show("kept@state", frame, bank, 0), partner_of(frame, bank, "kept", STATE)
        assert seen == Stimulus(bank.images(other), other.fields, frame.state)


def test_every_frame_is_shown_as_often_as_any_other(bank: FrameBank) -> None:
    """Of the cameras and of the instruction; so nobody's picture weighs more."""
    for channel in (CAMERAS, INSTRUCTION, STATE):
        counts = Counter(partner_of(frame, bank, "swapped", channel).id for frame in bank)
        assert set(counts.values()) == {1}


def test_a_match_is_the_nearest_state_of_another_episode(bank: FrameBank) -> None:
    """Nearer than a swap's on the whole, and the nearest there is."""
    states = np.array([flat_state(frame.state) for frame in bank])
    spread = states.std(axis=0)
    for place, frame in enumerate(bank):
        if not is_available("matched@cameras", frame, bank):
            continue
        other = partner_of(frame, bank, "matched", CAMERAS)
        assert far_apart(frame, other, spread) <= 0.1
        far = (((states - states[place]) / spread) ** 2).sum(axis=1)
        elsewhere = [far[number] for number, one in enumerate(bank) if one.drive != frame.drive]
        assert far[[one.id for one in bank].index(other.id)] == min(elsewhere)


def test_moved_objects_are_shown_with_the_own_instruction_or_another(bank: FrameBank) -> None:
    """The pictures are the same; only what is told differs."""
    for frame in bank.frames[:6]:
        for name in MOVES:
            plain, told = show(name, frame, bank, 0), show(f"{TOLD}{name}", frame, bank, 0)
            assert plain.images == told.images == bank.images(frame, name)
            assert plain.fields == frame.fields != told.fields
            assert plain.state == told.state == frame.state


def test_a_bank_says_what_it_cannot_show(bank: FrameBank) -> None:
    """Without instructions that differ, without a state, and without objects."""
    every, left_out = conditions_of(bank)
    assert {
        "swapped@instruction",
        "matched@camera:wrist",
        "blank@top",
        "exchanged@top",
        "told_other_minus",
        "mirrored",
    } <= set(every)
    assert left_out == dict.fromkeys(
        ("matched@state", "near@state", "matched@instruction", "near@instruction"),
        "only pictures are matched by the state",
    )
    alike = tuple(replace(frame, fields={INSTRUCTION: "reach"}, counterfactuals={}) for frame in bank)
    poor = replace(bank, frames=alike, manifest=replace(bank.manifest, motion=None))
    every, left_out = conditions_of(poor)
    assert "no frame of another episode that differs" in left_out["swapped@instruction"]
    assert "have no such picture" in left_out["named_plus"]
    assert "reflected motion" in left_out["mirrored"]
    assert "swapped@cameras" in every
    with pytest.raises(BankError, match="has no partner"):
        show("swapped@instruction", alike[0], poor, 0)


def test_conditions_of_pictures_are_those_of_a_battery(bank: FrameBank) -> None:
    """Grey over one camera leaves the other."""
    frame = bank.frames[0]
    seen = show("blank@wrist", frame, bank, 0)
    assert seen.images["top"] == bank.images(frame)["top"]
    assert set(np.unique(decode(seen.images["wrist"], "wrist"))) == {128}
    assert show("noise", frame, bank, 1) != show("noise", frame, bank, 2)


def test_the_state_is_reflected_with_the_pictures(bank: FrameBank) -> None:
    """X about the middle of the table; y and grip stay."""
    frame = bank.frames[0]
    x, y, grip = frame.state["state"]
    seen = reflected(show("mirrored", frame, bank, 0), bank.manifest.motion)
    assert seen.state["state"] == pytest.approx((1 - x, y, grip))


def test_the_files_of_a_condition_are_those_that_it_shows(bank: FrameBank) -> None:
    """So that a bundle holds them all."""
    frame = bank.frames[0]
    for name in conditions_of(bank)[0]:
        assert is_available(name, frame, bank) or name.startswith(("matched", "near"))
        if not is_available(name, frame, bank):
            continue
        files = sources(name, frame, bank, 0)
        seen = {bank.read(file) for file in files}
        assert (
            name.startswith(("nudged", "blank", "noise", "mirrored"))
            or set(show(name, frame, bank, 0).images.values()) <= seen
        )


def test_an_unknown_condition_is_refused_with_what_is_known(bank: FrameBank) -> None:
    """Also a camera that is not there, and a bank whose instruction nobody can tell."""
    for name in ("swapped", "swapped@nose", "named_plus@state", "shuffled"):
        with pytest.raises(SpecError, match="known are real"):
            find_condition(name, "policy")
    with pytest.raises(BankError, match="has no camera 'left'"):
        show("swapped@camera:left", bank.frames[0], bank, 0)
    several = replace(bank, manifest=replace(bank.manifest, prompt_columns=("task", "hint")))
    with pytest.raises(BankError, match="name the instruction's 'instruction'"):
        instruction_column(several)


def test_a_bank_of_one_camera_has_no_camera_of_its_own(tmp_path) -> None:  # noqa: ANN001
    """All cameras are that one."""
    one = banks.build_bank(tmp_path / "bank")
    assert channels_of(one) == (CAMERAS,)


def test_colours_are_exchanged_in_one_camera_alone(bank: FrameBank) -> None:
    """The other camera, the state and the instruction stay; so does all that is known of the pictures' files."""
    frame = bank.frames[0]
    seen, drawn = show("exchanged@wrist", frame, bank, 0), bank.images(frame, "exchanged")
    assert seen.images == {"top": bank.images(frame)["top"], "wrist": drawn["wrist"]}
    assert (seen.state, seen.fields) == (frame.state, frame.fields)
    files = sources("exchanged@wrist", frame, bank, 0)
    assert set(files) == {*frame.pictures.values(), frame.counterfactuals["exchanged"]["wrist"]}
    with pytest.raises(BankError, match="has no camera 'rear'; it has top, wrist"):
        show("exchanged@rear", frame, bank, 0)
    plain = replace(bank, frames=tuple(replace(one, counterfactuals={}) for one in bank))
    assert not any("exchanged@" in name for many in conditions_of(plain) for name in many)


def test_a_camera_whose_pictures_are_all_alike_is_not_exchanged(tmp_path: Path) -> None:
    """Its swap would show what is there anyway; both the bank's check and its import say so, and the others stay."""
    still = arm_bank(tmp_path / "still", side="still")
    every, left_out = conditions_of(still)
    why = "48 of 48 frames have no frame of another episode that differs in the side camera"
    assert {name: left_out[name] for name in left_out if name.endswith("camera:side")} == dict.fromkeys(
        ("swapped@camera:side", "matched@camera:side", "near@camera:side"), why
    )
    assert unshown_channels(still) == {"camera:side": why}
    assert {"swapped@cameras", "swapped@camera:front", "blank@side"} <= set(every)
    assert any("swapped@camera:side" in line and line.endswith(why) for line in costs(still))
    result = CliRunner().invoke(app, ["frames", "check", str(still.root)])
    assert f"not asked of a policy: camera:side: {why}" in " ".join(result.output.split())
    said = json.loads(CliRunner().invoke(app, ["frames", "check", str(still.root), "--json"]).stdout)
    assert (said["ok"], said["unshown"]) == (True, {"camera:side": why})
    assert unshown_channels(arm_bank(tmp_path / "moving", side="moving")) == {}


def test_a_partners_picture_differs_where_it_can(tmp_path: Path) -> None:
    """Of a camera that shows one of two pictures: all episodes of one get one of the other; all cameras keep theirs."""
    bank = arm_bank(tmp_path / "arm", side="moving")
    digests = dict(bank.manifest.images)
    for frame in bank:
        digests[frame.pictures["side"]] = "left" if int(frame.episode) < 2 else "right"
    bank = replace(bank, manifest=replace(bank.manifest, images=digests))
    for frame in bank:
        other = partner_of(frame, bank, "swapped", "camera:side")
        assert digests[other.pictures["side"]] != digests[frame.pictures["side"]]
        assert (
            partner_of(frame, bank, "swapped", CAMERAS)
            == bank.frames[partners(bank.frames, "swapped", CAMERAS)[bank.frames.index(frame)]]
        )
        for how in ("matched", "near"):
            if is_available(f"{how}@camera:side", frame, bank):
                other = partner_of(frame, bank, how, "camera:side")
                assert digests[other.pictures["side"]] != digests[frame.pictures["side"]]


def test_one_camera_is_kept_or_noise_where_that_is_asked_by_name(bank: FrameBank) -> None:
    """Neither is asked of itself; kept, it alone is the frame's own."""
    further = ("noise@top", "kept@camera:top", "noise@wrist", "kept@camera:wrist")
    assert further_conditions(bank) == further
    assert not {*further} & {*conditions_of(bank)[0]}
    frame = bank.frames[0]
    kept, other = show("kept@camera:wrist", frame, bank, 0), partner_of(frame, bank, "kept", "camera:wrist")
    assert other.drive != frame.drive
    images = {**bank.images(other), "wrist": bank.images(frame)["wrist"]}
    assert kept == Stimulus(images, other.fields, other.state)
    noisy = show("noise@top", frame, bank, 0)
    assert noisy.images["wrist"] == bank.images(frame)["wrist"]
    assert noisy.images["top"] != bank.images(frame)["top"]
    assert {"swapped@CHANNEL", "near@CHANNEL", "noise@CAMERA", "exchanged@CAMERA", "decoys"} <= set(listed_conditions())


def test_a_sheet_has_all_cameras_and_what_a_policy_is_told(bank: FrameBank, tmp_path: Path) -> None:
    """Side by side, reflected too; the caption has three lines where there are motions."""
    frame = bank.frames[0]
    write_frame(bank, frame, tmp_path / "one.png")
    both = decode((tmp_path / "one.png").read_bytes(), "one")
    top, wrist = (decode(image, name) for name, image in bank.images(frame).items())
    assert np.array_equal(both, np.concatenate([top, wrist], axis=1))
    write_frame(bank, frame, tmp_path / "other.png", mirrored=True)
    mirrored = decode((tmp_path / "other.png").read_bytes(), "other")
    assert np.array_equal(mirrored, np.concatenate([top[:, ::-1], wrist[:, ::-1]], axis=1))
    contact_sheet(bank, tmp_path / "sheet.png")
    plain = replace(bank, manifest=replace(bank.manifest, motion=None))
    contact_sheet(plain, tmp_path / "plain.png")
    tall, less = (decode((tmp_path / f"{name}.png").read_bytes(), name).shape[0] for name in ("sheet", "plain"))
    rows = len({one.episode for one in bank})
    assert tall - less == 2 * 18 * rows


@pytest.mark.parametrize(
    ("first", "second", "one"),
    [
        ("reach red", "Reach red. ", True),
        ('Pick-up the "cube"!', "pick up   the cube", True),
        ("reach red", "go to the red one", False),
        ("turn by 30", "turn by -30", False),
        ("move 3.5 cm", "move 35 cm", False),
        ("go ↑", "go ↓", False),
        ("?", "!", False),
    ],
)
def test_instructions_that_differ_in_signs_alone_are_one(tmp_path: Path, first: str, second: str, *, one: bool) -> None:
    """Nobody who obeys both alike ignores them; whether other words say the same, nobody knows from the words."""
    bank = arm_bank(tmp_path / "arm", tasks=(f"{first}", f"{second}"))
    assert (instruction_key({"task": first}) == instruction_key({"task": second})) == one
    assert ("swapped@instruction" in conditions_of(bank)[1]) == one


def test_a_scale_that_somebody_declares_keeps_every_row(tmp_path: Path) -> None:
    """A row that is far off is left out where its spread would be the scale, and there alone."""
    bank = arm_bank(tmp_path / "arm", length=8, wrong=1000.0)
    space = bank.manifest.motion
    assert space is not None
    assert {name for many in far_off(bank).values() for name in many} == {"aj0"}
    assert rare(bank) == {"aj0"}
    first, *others = space.dimensions
    declared = replace(space, dimensions=(replace(first, scale=0.2), *others))
    kept = replace(bank, manifest=replace(bank.manifest, motion=declared), frames=(*bank.frames,))
    assert far_off(kept) == {}
    assert len(logs(kept)) == len(logs(bank)) + len(far_off(bank))
