"""Whose label rests on an edit: oracles of the edit lose depth, readers of distance keep it."""

import json
import re
from collections.abc import Mapping

import numpy as np
import pytest

import edited_worlds
from edited_oracles import ORACLES, TRACES, TRUE, Known, Oracle, by_trace, noisy
from eyechart.conditions import NUDGES, is_available, show
from eyechart.edits import EditSource, Moves, read_annotations
from eyechart.frames import Frame, FrameBank, decode, open_bank
from eyechart.importing import Choices, import_table
from eyechart.spaces.space import Decision
from eyechart.studies.battery.answers import Answers
from eyechart.studies.battery.calibrated_statistics import CalibratedTests, LazyStatistics
from eyechart.studies.battery.paper_statistics import Resampling
from eyechart.verdicts import calibrated_rules
from eyechart.verdicts.ruling import Ruling

pytestmark = pytest.mark.slow
EDITED = ("lead_near", "lead_far", "lead_drawn", "exchange_own", "exchange_beside", "exchange_apart", "patched")
CONDITIONS = ("real", "real_repeat", "shuffled", *EDITED, *NUDGES)
FRAMES = 72
OF_EDITS = {"photographed", "patched_excess", "patched_bound"}
FOOLED = {"blur_lead", "blur_ghost", "edit_only", "sharp_far", "chimera_blur"}
"""Oracles that get depth by the rules of banks that are rendered."""

Pictures = Mapping[tuple[str, str], Known]


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of 72 edited moments of the rover, in 15 episodes."""
    folder = tmp_path_factory.mktemp("edited")
    found = edited_worlds.moments("rover", FRAMES)
    photos, table, objects = edited_worlds.write(folder, found)
    source = EditSource(photos, read_annotations(photos, table, objects), folder)
    eye_m, limits = found[0].world.view.eye_m, edited_worlds.LIMITS
    moves = Moves((2.6, 4.4), (18, 27), edited_worlds.LANE_M, eye_m, limits=limits)
    edited_worlds.edit(source, moves, folder / "edited")
    choices = Choices(threshold=8.0, unit="m", mirror="horizontal")
    return import_table(folder / "edited", folder / "edited" / "table.csv", folder / "bank", choices)


@pytest.fixture(scope="module")
def pictures(bank: FrameBank) -> Pictures:
    """Return every picture of the bank, with how it was edited."""
    copies = json.loads((bank.root.parent / "edited" / "edit.json").read_text())["copies"]
    moments = {one.file: one for one in edited_worlds.moments("rover", FRAMES)}
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
            lead = min(copies[file][base], key=lambda one: abs(one["left_m"]))["scale"]
            largest = max(max(copy["scale"] for copy in many) for many in copies[file].values())
            if base == "patched":  # it is as soft as the lead's own largest magnification
                lead = max(largest, 1.3)
            found[frame.id, name] = Known(
                image, edited=True, scale=lead, largest=max(*scales, lead), ghost=ghost, copies=len(scales)
            )
    return found


def statistics(bank: FrameBank, pictures: Pictures, oracle: Oracle, frames: tuple[Frame, ...] = ()) -> LazyStatistics:
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
    return LazyStatistics(CalibratedTests(answers, Resampling(resamples=1999, seed=1)).tests())


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


def as_rendered(found: LazyStatistics) -> str:
    """Return the label that the same answers get where control pictures are rendered."""
    plain = {name: one for name, one in found.items() if name not in OF_EDITS}
    return calibrated_rules(plain, turns=False)[0].label


@pytest.mark.parametrize(("name", "label"), [("depth", "depth"), ("early", "depth"), ("two_levels", "partial_depth")])
def test_a_reader_of_distance_keeps_its_label_on_an_edited_bank(
    bank: FrameBank, pictures: Pictures, name: str, label: str
) -> None:
    """Its answers do not change where nothing is moved, and follow the gap of the photographs as taken."""
    found = statistics(bank, pictures, TRUE[name])
    assert (calibrated_rules(found, turns=False)[0].label, as_rendered(found)) == (label, label)


def test_a_reader_that_errs_needs_more_frames(bank: FrameBank, pictures: Pictures) -> None:
    """With 3 answers of 10 by chance it is associated on 72 frames, and told how many it would take."""
    ruling = ruled(bank, pictures, noisy(TRUE["depth"], 0.3))
    assert ruling.label == "depth_associated"
    assert re.search(r"that it answers to the edit was not excluded: n = 7[0-2], about \d+ frames", ruling.reason)


@pytest.mark.parametrize("name", [*ORACLES, *TRACES])
def test_whoever_follows_the_edit_gets_no_depth(bank: FrameBank, pictures: Pictures, name: str) -> None:
    """Five would, if nobody asked how the pictures were made."""
    found = statistics(bank, pictures, named(pictures, name))
    assert (as_rendered(found) == "depth") is (name in FOOLED)
    assert calibrated_rules(found, turns=False)[0].label in {"content", "depth_associated", "undecided"}
