"""The hierarchy tells a planner that sees from one that does not, and prints what completion does not show."""

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import pytest

from eyechart.episodes import Bounds, read_episodes, run
from eyechart.errors import LedgerError
from eyechart.modes import RequestMode
from eyechart.report.hierarchy import against_table, source_table
from eyechart.studies import hierarchy
from eyechart.studies.hierarchy import HierarchyScore, Part, planning, score, scoring

MPC_ONLY = "constant:STRAIGHT"
SMALL: Mapping[str, Part] = {
    "primary": Part("rover-mpc", (MPC_ONLY, "constant:STOP", "route"), ("offset",), 1),
    "primary-models": Part("rover-mpc", (), ("offset",), 1, ("real", "blank"), models=True),
    "unaware": Part("rover-mpc-unaware", (MPC_ONLY,), ("offset", "slalom"), 3),
    "lateral": Part("rover-mpc-lateral", ("route", "mirrored:route"), ("offset", "slalom"), 3),
    "lateral-models": Part("rover-mpc-lateral", (), ("offset",), 2, ("real", "mirrored"), models=True),
}
"""The study in fewer worlds."""


def garbled(prompt: str, image: object) -> str:
    """Answer something that is no action."""
    del prompt, image
    return "I would rather not say."


def failing(prompt: str, image: object, calls: Iterator[int] = itertools.count()) -> str:  # noqa: B008 - one count
    """Raise every other time."""
    del prompt, image
    if next(calls) % 2:
        raise RuntimeError("no planner just now")
    return "STRAIGHT"


@pytest.fixture(scope="module")
def studied(tmp_path_factory: pytest.TempPathFactory) -> HierarchyScore:
    """Run the small study with a planner that sees and two that fail."""
    out = tmp_path_factory.mktemp("hierarchy")
    specs = ("scripted:clear_side", f"python:{__name__}:garbled", f"python:{__name__}:failing")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(planning, "PARTS", SMALL)
        for planned in hierarchy.plan(out, [RequestMode(spec) for spec in specs]).values():
            run(planned, bounds=Bounds(processes=1))
        return score(out)


def goals(studied: HierarchyScore, part: str, policy: str, condition: str = "real") -> tuple[int, int]:
    """Return how many episodes of a source reached the goal, of how many."""
    (row,) = [
        one
        for one in studied.sources
        if (one.part, one.driver.policy, one.driver.condition) == (part, policy, condition)
    ]
    assert row.goals.value is not None
    return round(row.goals.value * row.goals.n), row.goals.n


def test_scripted_sources_reach_what_the_arms_let_them(studied: HierarchyScore) -> None:
    """Told of the obstacles the controller needs no intent; untold, only the oracle's side saves it."""
    assert goals(studied, "primary", MPC_ONLY) == (1, 1)
    assert goals(studied, "primary", "constant:STOP") == (0, 1)
    assert goals(studied, "unaware", MPC_ONLY) == (0, 6)
    assert goals(studied, "lateral", "route")[0] >= 5
    assert goals(studied, "lateral", "mirrored:route")[0] <= 1
    control = studied.oracle_mirrored
    assert control is not None
    assert control.differences["success_rate"].value == pytest.approx(1.0, abs=0.35)


def test_a_planner_that_sees_is_told_from_itself_when_its_picture_is_mirrored(studied: HierarchyScore) -> None:
    """Where the controller knows the obstacles, it completes with its eyes shut too, which the words say."""
    assert (
        goals(studied, "lateral-models", "scripted:clear_side")[0]
        > goals(studied, "lateral-models", "scripted:clear_side", "mirrored")[0]
    )
    said = [line for line in studied.words if "scripted:clear_side" in line]
    assert said
    assert all("completion does not show perception" in line for line in said)  # two worlds cannot show it either


@pytest.mark.parametrize(
    ("goals", "p", "said"), [(0.5, 0.01, False), (0.5, 0.2, True), (-0.5, 0.01, True), (0.0, 1.0, True)]
)
def test_only_more_goals_with_real_pictures_show_perception(
    studied: HierarchyScore, goals: float, p: float, *, said: bool
) -> None:
    """Not another distance, and not fewer goals."""
    part, blind = studied.blind[0]
    assert part
    changed = replace(blind.paired.differences["success_rate"], value=goals)
    paired = replace(
        blind.paired,
        differences={**blind.paired.differences, "success_rate": changed},
        holm={"success_rate": p, "distance_m": 0.001},
    )
    assert bool(scoring.unless_shown(replace(blind, paired=paired))) == said


@pytest.mark.parametrize("name", ["garbled", "failing"])
def test_a_planner_that_fails_ends_in_logged_stops(studied: HierarchyScore, name: str) -> None:
    """Never in the last plan again: each step without a decision executed STOP."""
    drives = [one for one in studied.drives["primary-models"] if one.driver.policy == f"python:{__name__}:{name}"]
    failed = [step for one in drives for step in one.steps if step.decision.action is None]
    assert failed
    assert all(step.executed_action == "STOP" for step in failed)
    assert {step.decision.missing for step in failed} == {"unparsed" if name == "garbled" else "error"}
    mine = [one for one in studied.sources if one.driver.policy == f"python:{__name__}:{name}"]
    rows = [one for one in mine if one.part == "primary-models"]
    assert sum(one.fail_safe for one in rows) == len(failed)
    assert all(one.intents["STOP"] == 0 for one in rows)
    assert all(one.intents["STRAIGHT"] == 0 or name == "failing" for one in rows)


def test_the_tables_hold_every_source_once(studied: HierarchyScore) -> None:
    """Beside the paper's where it prints one; the controller alone is what the others are held against."""
    first, second = source_table(studied.sources, primary=True), source_table(studied.sources, primary=False)
    assert first.row_count + second.row_count == len(studied.sources)
    names = [str(cell) for table in (first, second) for cell in table.columns[0].cells]
    assert "oracle, lateral intent, mirrored" in names
    assert len(set(names)) == len(names)
    assert against_table(studied.against_mpc_only).row_count == len(studied.against_mpc_only) == 8
    assert {one.second.policy for one in studied.against_mpc_only} == {MPC_ONLY}


def test_solver_failures_and_intents_are_counted(studied: HierarchyScore) -> None:
    """No plan failed here; the counts of intents add up to the decisions."""
    assert all(one.solver_failures == 0 for one in studied.sources)
    for one in studied.sources:
        drives = next(each for each in studied.drives[one.part] if each.driver == one.driver)
        assert sum(one.intents.values()) + one.fail_safe == len(drives.steps)


def test_a_folder_without_the_study_is_refused(tmp_path: Path) -> None:
    """With the command that makes one."""
    with pytest.raises(LedgerError, match="holds no run of the hierarchy; 'eyechart run hierarchy --out"):
        score(tmp_path)
    assert list(read_episodes(tmp_path)) == []
