"""Which labels a bank can give is told before a call is made, with how many more frames it would take."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

import banks
import known
from eyechart.conditions import RANGED
from eyechart.frames import FrameBank, open_bank
from eyechart.studies.battery import reach
from eyechart.studies.battery.power import power_of
from eyechart.studies.battery.reach import Reach, _longer, reach_of
from eyechart.verdicts import LABELS


@pytest.fixture(scope="module")
def half(demo: known.Demo) -> FrameBank:
    """Return the highway's balanced bank with six steps of each episode: 72 frames."""
    return open_bank(demo.half)


def reached(bank: FrameBank) -> dict[str, Reach]:
    """Return what is said of each label."""
    return {one.label: one for one in reach_of(bank)}


def test_what_a_run_found_could_be_reached(demo: known.Demo) -> None:
    """Of every label that one of the sixteen controllers got; only declining and undecided need nothing."""
    found = reached(open_bank(demo.bank))
    assert list(found) == list(LABELS)
    got = {label for label in LABELS if re.search(rf"(?<!\w){label}(?!\w)", demo.printed)}
    assert got > {"depth", "depth_lateral", "content", "scene_cue", "image_invariant"}
    assert {label: found[label].lacks for label in got if not found[label].reached} == {}


def test_few_frames_are_said_to_be_few_and_how_many_would_do(half: FrameBank) -> None:
    """24 frames of 12 episodes: a reader that never errs is not depth; on so many more it is."""
    few = replace(half, frames=tuple(frame for frame in half.frames if frame.step < 4))
    assert len(few) == 24
    one = reached(few)["depth"]
    assert not one.reached
    assert "a simulated model that deserves it gets depth_associated" in one.lacks
    assert one.more is not None
    assert 24 < one.more <= 72
    assert one.words == f"with about {one.more} more frames"
    enough = replace(few, frames=tuple(_longer(few.frames, len(few) + one.more)))
    assert len({frame.id for frame in enough}) == len(enough)
    assert reached(enough)["depth"].reached
    assert reached(half)["depth"].reached


@pytest.mark.parametrize(
    ("label", "lacks"),
    [
        ("depth", "no frame can be shown lead_near_nudged"),
        ("partial_depth", "no frame can be shown lead_near_nudged"),
        ("depth_lateral", "no frame can be shown mirrored, lead_near_nudged"),
        ("scene_cue", "no frame can be shown cross_scenario"),
    ],
)
def test_a_condition_that_is_missing_is_named(half: FrameBank, label: str, lacks: str) -> None:
    """No more frames of such a bank would do."""

    def bare(frame):  # noqa: ANN001, ANN202
        pictures = {
            name: counterfactual for name, counterfactual in frame.counterfactuals.items() if name == "recoloured"
        }
        return replace(frame, scenario="road", counterfactuals=pictures, cameras=banks.alone("none"))

    one = reached(replace(half, frames=tuple(map(bare, half.frames))))[label]
    assert (one.reached, one.more) == (False, None)
    assert one.lacks.replace("lead_near, lead_far, ", "").startswith(lacks)
    assert one.words == "no"


def test_a_bank_that_does_not_say_which_side_is_clear_gives_no_lateral_label(half: FrameBank) -> None:
    """It is named, with the columns."""
    frames = tuple(replace(frame, truth={**frame.truth, "left_clear": None}) for frame in half.frames)
    one = reached(replace(half, frames=frames))["depth_lateral"]
    assert one.lacks == "the bank does not say which side is clear (left_clear and right_clear)"


def test_a_table_says_it_with_the_power(half: FrameBank) -> None:
    """A row a label; the JSON has the same."""
    found = power_of(half)
    rows = {row[0]: row for row in found.table().rows}
    assert list(rows) == list(LABELS)
    assert rows["depth"][2].text == "yes"
    assert rows["depth"][3] == found.odds.depth["1"]
    assert [one["label"] for one in found.as_dict()["labels"]] == list(LABELS)
    assert set(RANGED) <= found.controls.keys()


def test_a_label_that_no_controller_deserves_is_told_by_what_its_rule_reads(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A label is one row: whether a bank can give it follows from the statistics of its clauses."""
    monkeypatch.setattr(reach, "_CONTROLLERS", {})
    monkeypatch.setattr(reach, "_NEEDS", {})
    two = banks.build_bank(tmp_path / "two")
    one = replace(two, frames=tuple(frame for frame in two if frame.scenario == two.frames[0].scenario))
    assert reached(two)["scene_cue"].reached
    told = reached(one)["scene_cue"]
    assert (told.reached, told.more) == (False, None)
    assert told.lacks.startswith("its rule reads scene_cue: ")


def test_few_frames_reach_a_place_that_is_blind_and_turns_that_are_frequent(half: FrameBank) -> None:
    """Of 72 frames a scenario holds too few to bound its effect, and turns far away alone are too few."""
    found = reached(half)
    assert found["partial_depth"].reached
    assert found["depth_lateral"].reached


@pytest.mark.parametrize("label", ["depth_lateral", "partial_depth"])
def test_a_label_is_tried_with_every_controller_that_deserves_it(
    half: FrameBank, label: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The last one may get what the first one does not; where none does, the first one's reason is told."""
    first = reach._CONTROLLERS["image_invariant"]
    monkeypatch.setattr(reach, "MOST_FRAMES", 150)
    monkeypatch.setattr(reach, "_CONTROLLERS", {**reach._CONTROLLERS, label: (*first, *reach._CONTROLLERS[label])})
    assert reach._kept_from(label, half, half.frames) == ""
    monkeypatch.setattr(reach, "_CONTROLLERS", {**reach._CONTROLLERS, label: first})
    told = reach._reach(label, half)
    assert (told.reached, told.more) == (False, None)
    assert told.lacks.startswith("a simulated model that deserves it gets image_invariant: ")
    assert told.lacks.endswith("(on 144 frames, the most that were tried)")
