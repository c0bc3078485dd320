"""The door that every simulator keeps: contract tests over the registry."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
from typer.testing import CliRunner

from eyechart.cli.app import app
from eyechart.conditions import BATTERY, RANGED, is_available, require_partners, show
from eyechart.errors import BankError, SpecError
from eyechart.frames import FrameBank, check, decode, open_bank, shared_frames
from eyechart.perception.view import VIEWS
from eyechart.simulators import SIMULATORS, find_simulator, open_bank_simulator
from eyechart.simulators.banks import STAGING

pytestmark = pytest.mark.slow

PHOTOGRAPHED = [name for name in SIMULATORS if find_simulator(name).declared.presets]
"""Those that make banks; the others can only be driven."""


def test_its_camera_is_one_that_has_a_view_and_distances_of_its_own() -> None:
    """So nothing is read in one world by the distances of another."""
    cameras = {name: find_simulator(name).declared.camera for name in SIMULATORS}
    assert set(cameras.values()) - {""} == set(VIEWS)
    assert {name: camera for name, camera in cameras.items() if name != camera} == {
        "tabletop": "",
        "rover-mpc": "rover",
        "rover-mpc-unaware": "rover",
        "rover-mpc-lateral": "rover",
        "drone-pybullet": "drone",
    }


NO_LEAD = ["tabletop"]
"""The worlds without a vehicle ahead."""


@pytest.fixture(scope="module", params=PHOTOGRAPHED)
def bank(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a small bank of each simulator."""
    return open_bank_simulator(request.param).build(tmp_path_factory.mktemp("door") / "bank", seeds=(0, 1), steps=4)


def test_its_name_opens_it_and_its_presets_are_in_words(bank: FrameBank) -> None:
    """For ``eyechart list simulators``, and for the scope of every verdict."""
    simulator = open_bank_simulator(bank.manifest.simulator)
    assert simulator.declared.name == bank.manifest.simulator
    assert bank.manifest.preset in simulator.declared.presets
    assert all(sentence.endswith(".") for sentence in simulator.declared.presets.values())
    assert bank.manifest.picture


def test_its_bank_is_what_its_manifest_says(bank: FrameBank) -> None:
    """The fingerprint and every picture's hash are those recorded."""
    assert check(bank.root) == []
    assert open_bank(bank.root).manifest == bank.manifest


def test_the_same_seeds_give_the_same_frames_and_others_give_others(bank: FrameBank, tmp_path: Path) -> None:
    """A bank can be built again from its name, which is told as it goes; a seed is one episode a scenario."""
    simulator, told = open_bank_simulator(bank.manifest.simulator), list[tuple[int, int]]()
    again = simulator.build(tmp_path / "again", seeds=(0, 1), steps=4, progress=lambda *at: told.append(at))
    assert told[-1] == (len(bank), len(bank))
    others = simulator.build(tmp_path / "others", seeds=(2, 3), steps=4)
    assert again.manifest.fingerprint == bank.manifest.fingerprint
    assert again.manifest.images == bank.manifest.images
    assert others.manifest.fingerprint != bank.manifest.fingerprint
    assert len({frame.episode for frame in bank}) == 2 * len(bank.scenarios)
    assert len(bank) == 8 * len(bank.scenarios)


STAGED = [(name, preset) for name in PHOTOGRAPHED for preset in find_simulator(name).declared.presets]


@pytest.mark.parametrize(("name", "preset"), STAGED)
def test_a_longer_bank_begins_with_the_shorter_one(name: str, preset: str, tmp_path: Path) -> None:
    """The paper's 288 frames begin with the 144, so that its arms can be compared; a third dozen follows."""
    simulator = open_bank_simulator(name)
    whole = simulator.open_preset(preset)
    first = dict(list(whole.scenarios.items())[:1])
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(type(simulator), "open_preset", lambda _self, _name: replace(whole, scenarios=first))
        banks = [
            simulator.build(tmp_path / str(steps), preset=preset, seeds=(0,), steps=steps) for steps in (12, 24, 27)
        ]
    for one, other in pairwise(banks):
        both = shared_frames(one, other)
        assert (len(both.frames), both.unlike) == (len(one), {})
        ranged = [name for name in RANGED if name in one.frames[0].counterfactuals]
        anew = {file for frame in one for name in ranged for file in frame.counterfactuals.get(name, {}).values()}
        images = {file: digest for file, digest in one.manifest.images.items() if file not in anew}
        assert images.items() <= other.manifest.images.items()
        checked = CliRunner().invoke(app, ["frames", "check", str(one.root), str(other.root)])
        assert f"{len(one)} are the same moments" in checked.output
        assert checked.exit_code == 0
        assert len({tuple(sorted(frame.truth.items())) for frame in other}) == len(other)
    assert banks[1].manifest.settings["staging"] == whole.staging(STAGING)[0]


def test_its_gap_is_a_number_or_no_lead_and_lies_on_both_sides_of_near(bank: FrameBank) -> None:
    """Or no test of distance can decide anything; a world without a lead has no gap."""
    if bank.manifest.simulator in NO_LEAD:
        assert bank.manifest.gap is None
        return
    gap = bank.manifest.gap
    assert gap is not None
    values = [frame.truth[gap.column] for frame in bank]
    numbers = [value for value in values if value is not None]
    assert all(isinstance(value, float | int) and not isinstance(value, bool) for value in numbers)
    assert min(numbers) < gap.threshold
    assert None in values or max(numbers) >= gap.threshold


def test_every_condition_can_be_shown(bank: FrameBank) -> None:
    """The eight of the paper on every frame, and counterfactuals that are pictures of the frame's size."""
    require_partners(BATTERY, bank)
    for frame in bank:
        size = decode(bank.image(frame), frame.id).shape
        for name in BATTERY:
            pictures = show(name, frame, bank, 0).images
            assert list(pictures) == ([] if name == "text_only" else [camera.name for camera in frame.cameras])
            assert all(decode(picture, name).shape == size for picture in pictures.values())
        for name in frame.counterfactuals:
            assert bank.manifest.simulator in NO_LEAD or is_available(name, frame)
            assert decode(bank.image(frame, name), name).shape == size


def test_moving_the_lead_changes_the_picture(bank: FrameBank) -> None:
    """Near and far are two pictures, on every frame that has them; some frame of a road has them."""
    pairs = [frame for frame in bank if {"lead_near", "lead_far"} <= frame.counterfactuals.keys()]
    assert bool(pairs) == (bank.manifest.simulator not in NO_LEAD)
    for frame in pairs:
        assert bank.image(frame, "lead_near") != bank.image(frame, "lead_far")


def test_it_refuses_what_cannot_be(bank: FrameBank, tmp_path: Path) -> None:
    """An unknown preset and a place that is taken are errors in words."""
    simulator = open_bank_simulator(bank.manifest.simulator)
    with pytest.raises(SpecError, match="no preset 'ideal'"):
        simulator.build(tmp_path / "other", preset="ideal")
    with pytest.raises(BankError, match="exists already"):
        simulator.build(bank.root)
