"""Whose label rests on an edit: oracles of the edit lose depth, readers of distance keep it."""

import json
from collections.abc import Mapping

import numpy as np
import pytest

import edited_worlds
from edited_oracles import ORACLES, TRACES, TRUE, Known, Oracle, by_trace
from eyechart.conditions import NUDGES, is_available, show
from eyechart.edits import EditSource, Moves, edit_photographs, read_annotations
from eyechart.frames import Frame, FrameBank, decode, open_bank
from eyechart.importing import Choices, import_table
from eyechart.spaces.space import Decision
from eyechart.studies.battery.answers import Answers
from eyechart.studies.battery.calibrated_statistics import CalibratedStatistics, CalibratedTests
from eyechart.studies.battery.paper_statistics import Resampling
from eyechart.verdicts import calibrated_rules
from eyechart.verdicts.ruling import Ruling

EDITED = ("lead_near", "lead_far", "lead_drawn", "exchange_own", "exchange_beside", "exchange_apart", "patched")
CONDITIONS = ("real", "real_repeat", "shuffled", *EDITED, *NUDGES)
PASSES = {"chimera"}
"""Oracles that get depth all the same; docs/verdicts.md says which, and why."""

Pictures = Mapping[tuple[str, str], Known]


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of 60 edited moments of the rover, in 15 episodes."""
    folder = tmp_path_factory.mktemp("edited")
    found = edited_worlds.moments("rover", 60)
    photos, table, objects = edited_worlds.write(folder, found)
    source = EditSource(photos, read_annotations(photos, table, objects), folder)
    eye_m, limits = found[0].world.view.eye_m, edited_worlds.LIMITS
    edit_photographs(source, Moves((2.6, 4.4), (18, 27), edited_worlds.LANE_M, eye_m, limits=limits), folder / "edited")
    choices = Choices(threshold=8.0, unit="m", mirror="horizontal")
    return import_table(folder / "edited", folder / "edited" / "table.csv", folder / "bank", choices)


@pytest.fixture(scope="module")
def pictures(bank: FrameBank) -> Pictures:
    """Return every picture of the bank, with how it was edited."""
    copies = json.loads((bank.root.parent / "edited" / "edit.json").read_text())["copies"]
    moments = {one.file: one for one in edited_worlds.moments("rover", 60)}
    found: dict[tuple[str, str], Known] = {}
    for frame in bank:
        file = frame.file.split("taken/")[-1]
        mask, real = moments[file].lead.mask, decode(bank.image(frame), "real")
        plate = decode(bank.image(frame, "lead_absent"), "plate") if "lead_absent" in frame.counterfactuals else real
        for name in CONDITIONS:
            if not is_available(name, frame):
                continue
            image = next(iter(show(name, frame, bank, 0).images.values()))
            base = NUDGES.get(name, name)
            if base not in EDITED:
                found[frame.id, name] = Known(image)
                continue
            shown = decode(image, name)
            scales = [one["scale"] for one in copies[file][base]]
            bare = mask & ~edited_worlds.differ(shown, plate)
            elsewhere = edited_worlds.differ(shown, real) & ~mask if base == "patched" else np.zeros_like(mask)
            ghost = float((bare.sum() + elsewhere.sum()) / mask.sum())
            lead = max(scales, key=lambda one: abs(np.log(one))) if base == "patched" else scales[0]
            largest = max(max(copy["scale"] for copy in many) for many in copies[file].values())
            if base == "patched":  # it is as soft as the lead's own largest magnification
                lead = max(largest, 1.3)
            found[frame.id, name] = Known(
                image, edited=True, scale=lead, largest=max(*scales, lead), ghost=ghost, copies=len(scales)
            )
    return found


def statistics(
    bank: FrameBank, pictures: Pictures, oracle: Oracle, frames: tuple[Frame, ...] = ()
) -> CalibratedStatistics:
    """Return the tests of an oracle's answers to every picture of the bank."""
    frames = frames or bank.frames
    decisions = {
        name: tuple(
            Decision(oracle(pictures[frame.id, name])) if (frame.id, name) in pictures else None for frame in frames
        )
        for name in CONDITIONS
    }
    manifest = bank.manifest
    answers = Answers("", frames, manifest.action_space, manifest.gap, decisions, made=manifest.provenance)
    return CalibratedStatistics(CalibratedTests(answers, Resampling(seed=1)))


def ruled(bank: FrameBank, pictures: Pictures, oracle: Oracle) -> Ruling:
    """Return the ruling on an oracle."""
    return calibrated_rules(statistics(bank, pictures, oracle), turns=False)[0]


def named(pictures: Pictures, name: str) -> Oracle:
    """Return an oracle by its name, or one of a trace."""
    if name in TRACES:
        near, far = (
            [one for (_, condition), one in pictures.items() if condition == of] for of in ("lead_near", "lead_far")
        )
        return by_trace(TRACES[name], near, far)
    return ORACLES[name]


def test_the_bank_is_edited_and_says_so(bank: FrameBank) -> None:
    """The import read the record beside the table."""
    made = open_bank(bank.root).manifest
    assert (made.provenance, made.edit["method"]) == ("edited", "edit/1")
    assert sum("patched" in frame.counterfactuals for frame in bank) >= 44


@pytest.mark.parametrize("name", TRUE)
def test_a_reader_of_distance_keeps_depth_on_an_edited_bank(bank: FrameBank, pictures: Pictures, name: str) -> None:
    """Its answers do not change where nothing is moved, and follow the gap of the photographs as taken."""
    ruling = ruled(bank, pictures, TRUE[name])
    assert ruling.label == "depth", ruling.because


@pytest.mark.parametrize("name", [*ORACLES, *TRACES])
def test_whoever_follows_the_edit_gets_no_depth(bank: FrameBank, pictures: Pictures, name: str) -> None:
    """But for those that are named."""
    assert (ruled(bank, pictures, named(pictures, name)).label == "depth") is (name in PASSES)
