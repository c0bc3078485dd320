"""Edited against rendered: the same moments, once with copies in photographs, once drawn anew."""

from pathlib import Path

import numpy as np
import pytest

import edited_controllers
import edited_worlds
from edited_worlds import EXCHANGES, LEADS, Pair, pixels
from eyechart.frames import open_bank
from eyechart.importing import Choices, import_table
from eyechart.studies import battery
from eyechart.verdicts import judge

CONTROLLERS = ("depth", "two_levels", "nearest", "any_lead", "colour")


@pytest.fixture(scope="module", params=["rover", "drone"])
def pair(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Pair:
    """Return 36 moments of a world, edited and rendered at the same places."""
    folder = tmp_path_factory.mktemp(request.param)
    return edited_worlds.write_pair(folder, edited_worlds.moments(request.param, 36))


def test_an_edited_lead_is_where_it_is_said_to_be(pair: Pair) -> None:
    """Read by the calibrated reader, which errs by .1 % on rendered pictures."""
    for name, column in LEADS.items():
        errors = []
        for row in pair.rows():
            if row[name]:
                wanted, got = (
                    float(row[column]),
                    edited_worlds.gap_in(pixels(pair.edited / row[name]), pair.moment(row)),
                )
                errors.append(9.0 if got is None else abs(got - wanted) / wanted)
        assert len(errors) >= 25, name
        assert np.median(errors) <= 0.02, name
        assert np.percentile(errors, 90) <= 0.05, name
        assert max(errors) < 0.10, name


def test_a_filled_hole_is_no_obstacle(pair: Pair) -> None:
    """Where the lead is taken away the reader finds what the rendered picture without it has."""
    count = ghosts = 0
    for row in pair.rows():
        if row["lead_absent"]:
            moment = pair.moment(row)
            count += 1
            seen = edited_worlds.gap_in(pixels(pair.edited / row["lead_absent"]), moment)
            ghosts += seen != edited_worlds.gap_in(pixels(pair.rendered / row["lead_absent"]), moment)
    assert count >= 30
    assert ghosts == 0


def test_a_patched_picture_shows_the_lead_in_its_place(pair: Pair) -> None:
    """It is edited, and nothing is moved: the pixels differ and the gap does not."""
    shifts = []
    for row in pair.rows():
        if row["patched"]:
            moment, shown = pair.moment(row), pixels(pair.edited / row["patched"])
            assert moment.lead is not None
            gap = edited_worlds.gap_in(shown, moment)
            shifts.append(9.0 if gap is None else abs(gap - moment.lead.gap_m) / moment.lead.gap_m)
            assert (shown != moment.picture).any(axis=2).sum() > 20
    assert len(shifts) >= 30
    assert max(shifts) < 0.10


def test_the_exchange_moves_what_is_near_beside(pair: Pair) -> None:
    """On the own way the near copy leads; beside it the lead is far, and so it is with both far."""
    found = [row for row in pair.rows() if row["exchange_own"]]
    assert len(found) >= 15
    for row in found:
        moment, wanted = pair.moment(row), float(row["exchange_m"])
        own, beside, apart = (edited_worlds.gap_in(pixels(pair.edited / row[name]), moment) for name in EXCHANGES)
        assert own == pytest.approx(wanted, rel=0.1)
        assert beside is not None
        assert beside > 21
        assert apart == pytest.approx(beside, rel=0.02)


def test_five_controllers_get_the_label_of_the_rendered_bank(pair: Pair, tmp_path: Path) -> None:
    """And the graded reader gives the same answer to 98 % of the pictures."""
    choices = Choices(threshold=8.0, unit="m", mirror="horizontal")
    labels, answers = [], []
    for folder, table in zip((pair.edited, pair.rendered), pair.tables, strict=True):
        bank = import_table(folder, table, tmp_path / folder.name, choices)
        specs = [f"python:edited_controllers:{name}" for name in CONTROLLERS]
        planned = battery.plan(bank.root, specs, tmp_path / f"run {folder.name}")
        battery.run(planned)
        scored = battery.score(tmp_path / f"run {folder.name}", resamples=200)
        labels.append({spec: one.calibrated.label for spec, one in judge(scored).items()})
        answers.append(
            {
                (frame.id.removeprefix("images/"), name): edited_controllers.depth("", bank.image(frame, name))
                for frame in open_bank(bank.root)
                for name in (*LEADS, *EXCHANGES, "lead_absent")
                if name in frame.counterfactuals
            }
        )
    assert labels[0] == labels[1]
    both = answers[0].keys() & answers[1].keys()
    assert len(both) > 150
    assert np.mean([answers[0][key] == answers[1][key] for key in both]) >= 0.98
