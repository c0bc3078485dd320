"""Rows say of random drives, planners, prompts and estimates what functions said of them before."""

import json
from collections.abc import Mapping
from pathlib import Path

import pytest

import test_rules
from evidences import digests
from eyechart.studies.closed_loop.blind_baseline import DRIVES
from eyechart.studies.hierarchy.scores import COMPLETES
from eyechart.studies.prompts import CELLS
from eyechart.verdicts.admission import ADMITS
from eyechart.verdicts.labels import ADMITTED, PLANNERS, PROMPTED, SIGHT, Label
from eyechart.verdicts.rules import Axis
from sights import SAID

OLD: dict[str, list[str]] = json.loads((Path(__file__).parent / "old_sights.json").read_text("utf-8"))
"""Digests of what is said of blocks of them.

Those of admission are of the rules when they were functions and no rows. The others were recorded
again when sentences were reworded; of 3,240 of them no label, tone or number had changed.
"""


@pytest.mark.parametrize("kind", SAID)
def test_rows_say_what_was_said_before(kind: str) -> None:
    """Label, tone, deciding statistic and sentence of the first blocks; of all of them by `make long-rulings`."""
    say, seed, of = SAID[kind]
    assert list(digests(say, seed, 3, of)) == OLD[kind][:3]


AXES = ((ADMITS, ADMITTED), (DRIVES, SIGHT), (COMPLETES, PLANNERS), (CELLS, PROMPTED))


@pytest.mark.parametrize(("axis", "labels"), AXES, ids=lambda one: getattr(one, "name", ""))
def test_every_clause_is_three_valued_and_every_label_has_a_rule(axis: Axis, labels: Mapping[str, Label]) -> None:
    """As of a battery; the last rule needs nothing, so that there is a label of any statistics."""
    test_rules.test_every_clause_is_three_valued(axis)
    assert {rule.label for rule in axis.rules} == labels.keys()
    assert axis.rules[-1].needs == ()
