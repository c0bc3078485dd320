"""The hierarchy tells a planner that sees from one that does not, and prints what completion does not show."""

import itertools
import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

import planners
from eyechart.calls import Reply
from eyechart.cli.app import app
from eyechart.episodes import Bounds, EpisodesRun, expected, read_episodes
from eyechart.episodes import plan as plan_episodes
from eyechart.episodes import run as run_episodes
from eyechart.errors import LedgerError, SpecError
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER
from eyechart.models.prices import Prices, read_prices
from eyechart.modes import RequestMode
from eyechart.report.table import Table
from eyechart.studies import hierarchy
from eyechart.studies.hierarchy import HierarchyScore, IntentSource, Part, plans, score, scores
from eyechart.studies.hierarchy.tables import TITLES, against_table, completion_table, intent_table, source_table
from eyechart.studies.probes import spent_on
from faults import FaultServer

pytestmark = pytest.mark.slow

MPC_ONLY = "constant:STRAIGHT"
SEEING = "scripted:clear_side"
SMALL: Mapping[str, Part] = {
    "primary": Part("rover-mpc", (MPC_ONLY, "constant:STOP", "route"), ("offset",), 1),
    "primary-models": Part("rover-mpc", (), ("offset",), 1, ("real", "blank"), models=True),
    "unaware": Part("rover-mpc-unaware", (MPC_ONLY,), ("offset", "slalom"), 3),
    "lateral": Part("rover-mpc-lateral", ("route", "mirrored:route"), ("offset", "slalom"), 3),
    "lateral-models": Part("rover-mpc-lateral", (), ("clutter",), 1, plans.CONDITIONS, models=True),
}
"""The study in fewer worlds."""

SHORT: Mapping[str, Part] = {
    name: Part(simulator, (), ("offset",), 1, models=True)
    for name, simulator in (("unaware-models", "rover-mpc-unaware"), ("lateral-models", "rover-mpc-lateral"))
}
"""A drive in each of two parts, straight into an obstacle."""

FREE = Prices(())
ONE = Bounds(processes=1)


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


def hanging(prompt: str, image: object, calls: Iterator[int] = itertools.count()) -> str | Reply:  # noqa: B008
    """Hang every other time."""
    del prompt, image
    return Reply(error="timeout") if next(calls) % 2 else "SLOW"


def dear(prompt: str, image: object) -> Reply:
    """Go straight on, for a cent."""
    del prompt, image
    return Reply("STRAIGHT", "stop", cost_usd=0.01)


def lapsed(prompt: str, image: object) -> Reply:
    """Refuse the key."""
    del prompt, image
    return Reply(error="auth", error_detail="no such key")


def own(name: str) -> str:
    """Return the SPEC of one of the planners above."""
    return f"python:{__name__}:{name}"


@pytest.fixture(scope="module")
def studied(tmp_path_factory: pytest.TempPathFactory) -> HierarchyScore:
    """Run the small study with a planner that sees, in this process and behind an endpoint."""
    out = tmp_path_factory.mktemp("hierarchy")
    with pytest.MonkeyPatch.context() as patch, FaultServer([planners.clear_side]) as server:
        patch.setattr(plans, "PARTS", SMALL)
        modes = [RequestMode(SEEING), RequestMode(planners.SPEC, base_url=server.base_url)]
        hierarchy.run(hierarchy.plan(out, modes), FREE, bounds=ONE)
        return score(out)


@pytest.fixture(scope="module")
def failed(tmp_path_factory: pytest.TempPathFactory) -> HierarchyScore:
    """Drive once with each of three planners that fail."""
    out = tmp_path_factory.mktemp("failed")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plans, "PARTS", {"primary-models": replace(SHORT["unaware-models"], simulator="rover-mpc")})
        modes = [RequestMode(own(name)) for name in ("garbled", "failing", "hanging")]
        hierarchy.run(hierarchy.plan(out, modes), FREE, bounds=ONE)
        return score(out)


def cells(table: Table) -> dict[str, dict[str, str]]:
    """Return a table's cells by row and column."""
    return {row[0]: dict(zip(table.names, row, strict=True)) for row in table.texts()}


def goals(studied: HierarchyScore, part: str, policy: str, condition: str = "real") -> tuple[int, int]:
    """Return how many episodes of a source reached the goal, of how many."""
    row = next(
        source
        for source in studied.sources
        if (source.part, source.driver.policy, source.driver.condition) == (part, policy, condition)
    )
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
    assert all("completion does not show perception" in line for line in said)  # one world cannot show it either
    rates = "goals with real pictures 1/1, blank 0/1"
    assert said[0] == f"rover-mpc, scripted:clear_side: {rates}: completion does not show perception."


@pytest.mark.parametrize(
    ("goals", "p", "label", "said"),
    [
        (0.5, 0.01, "by_camera", False),
        (0.5, 0.2, "by_camera", True),
        (-0.5, 0.01, "by_camera", True),
        (0.0, 1.0, "by_camera", True),
        (0.5, 0.01, "cannot_say", True),
    ],
)
def test_only_more_goals_with_real_pictures_show_perception(
    studied: HierarchyScore, goals: float, p: float, label: str, *, said: bool
) -> None:
    """Not another distance, not fewer goals, and nothing where so many calls failed that the fail-safe drove."""
    part, blind = studied.blind[0]
    assert part
    changed = replace(blind.paired.differences["success_rate"], value=goals)
    paired = replace(
        blind.paired,
        differences={**blind.paired.differences, "success_rate": changed},
        holm={"success_rate": p, "distance_m": 0.001},
    )
    ruling = replace(blind.ruling, label=label)
    assert bool(scores.unless_shown(replace(blind, paired=paired, ruling=ruling))) == said


def test_an_estimate_does_not_count_a_drive_as_short_as_its_crash(tmp_path: Path) -> None:
    """Where STOP brakes nothing, as in the lateral arm, a drive is expected to last as long as one that steers."""
    drives = plan_episodes("rover-mpc-lateral", [SEEING], tmp_path, scenarios=["offset"], seeds=[0])
    (told,) = expected(drives, read_prices(), concurrency=1)
    run_episodes(drives)
    (driven,) = read_episodes(tmp_path)
    assert abs(told.calls - len(driven.steps)) <= 5
    assert "about" in told.words


def test_a_planner_behind_an_endpoint_drives_as_it_does_in_this_process(studied: HierarchyScore) -> None:
    """To the last digit of every world's state, whatever it is shown."""
    for part in ("primary-models", "lateral-models"):
        states = {
            spec: {
                (episode.key.world, episode.key.condition): episode.state_sha256
                for drives in studied.drives[part]
                for episode in drives.episodes
                if episode.key.policy == spec
            }
            for spec in (SEEING, planners.SPEC)
        }
        assert states[SEEING] == states[planners.SPEC]
        assert len(states[SEEING]) == (2 if part == "primary-models" else 4)


def of(found: HierarchyScore, name: str) -> IntentSource:
    """Return the row of one of the planners that fail."""
    (row,) = [source for source in found.sources if source.driver.policy == own(name)]
    return row


@pytest.mark.parametrize(("name", "why"), [("garbled", "unparsed"), ("failing", "exception"), ("hanging", "timeout")])
def test_a_planner_that_fails_ends_in_logged_stops_that_are_no_intents_of_its_own(
    failed: HierarchyScore, name: str, why: str
) -> None:
    """Never in the last plan again; the table counts them by reason, and no STOP is credited to the planner."""
    (drives,) = [one for one in failed.drives["primary-models"] if one.driver.policy == own(name)]
    silent = [step for step in drives.steps if step.decision.action is None]
    assert len(silent) >= 10
    assert {step.executed_action for step in silent} == {"STOP"}
    row = of(failed, name)
    assert row.no_decision == {why: len(silent)}
    assert (row.intents["STOP"], row.intents_emitted) == (0, len(drives.steps) - len(silent))
    assert row.stop_share.value == (None if name == "garbled" else 0.0)
    shown = cells(intent_table(failed.sources, "primary"))[own(name)]
    assert (shown["intents"], shown["fail-safe"], shown["no decision"]) == (
        str(row.intents_emitted),
        str(len(silent)),
        f"{why} {len(silent)}",
    )


def test_solver_failures_are_counted_and_shown(studied: HierarchyScore) -> None:
    """No plan failed here; those that are put into a record stand in its row."""
    assert all(source.solver_failures == 0 for source in studied.sources)
    drives = studied.drives["primary"][0]
    episode = drives.episodes[0]
    steps = tuple(replace(step, facts={**step.facts, "solver_failures": 2}) for step in episode.steps[:3])
    worse = replace(drives, episodes=(replace(episode, steps=(*steps, *episode.steps[3:])),))
    row = HierarchyScore({"primary": (worse,)}).sources[0]
    assert row.solver_failures == 6
    assert cells(intent_table([row], "primary"))[row.name]["solver failed"] == "6"


def test_what_every_episode_shares_has_no_interval_but_the_exact_one(studied: HierarchyScore) -> None:
    """One of no width would claim certainty: the metres of one that drives alike. A share has the exact bound."""
    drives = next(one for one in studied.drives["lateral-models"] if one.driver.condition == "real")
    row = HierarchyScore({"lateral-models": (replace(drives, episodes=drives.episodes[:1] * 4),)}).sources[0]
    assert row.distance_m.value == drives.episodes[0].distance_m
    assert row.distance_m.ci is None
    assert row.stop_share.ci == pytest.approx((0, 1 - 0.05 ** (1 / 4)))


def test_nothing_is_concluded_of_a_model_that_did_not_drive_with_real_pictures(studied: HierarchyScore) -> None:
    """With blank ones alone there is a row of goals, and no sentence on what completion shows."""
    blank = tuple(one for one in studied.drives["primary-models"] if one.driver.condition == "blank")
    found = HierarchyScore({"primary-models": blank})
    assert found.sources
    assert (found.completions, found.words) == ((), ())


def test_the_tables_hold_every_source_once(studied: HierarchyScore) -> None:
    """Beside the paper's where it prints one; the controller alone is what the others are held against."""
    first, second = (cells(source_table(studied.sources, name)) for name in TITLES)
    assert len(first) + len(second) == len(studied.sources)
    assert {"MPC-only", "constant STRAIGHT", f"{SEEING}, blank"} <= first.keys()
    assert {"mpc-blind", "oracle, lateral intent, mirrored", f"{SEEING}, lateral intent, mirrored"} <= second.keys()
    assert first["MPC-only"]["paper's dist."] == "95.6"
    assert {
        name: row for name, row in first["MPC-only"].items() if name != "intent source" and "paper" not in name
    }.items() <= (first["constant STRAIGHT"].items())
    against = cells(against_table(studied.against_mpc_only))
    assert len(against) == len(studied.against_mpc_only) == 6
    assert {"oracle intent", "constant STOP", f"{SEEING}, blank"} <= against.keys()
    assert {difference.second.policy for difference in studied.against_mpc_only} == {MPC_ONLY}
    assert len(completion_table(studied.completions).rows) == len(studied.completions) == 4
    for source in studied.sources:
        drives = next(each for each in studied.drives[source.part] if each.driver == source.driver)
        assert source.intents_emitted + source.fail_safe_steps == len(drives.steps)


def test_eleven_sources_and_eight_controllers_drive_in_the_worlds_that_the_paper_counts(tmp_path: Path) -> None:
    """Five families by five seeds, and four by eight; each is planned and named."""
    planned = hierarchy.plan(tmp_path, [RequestMode(SEEING)])
    counts: dict[str, int] = {}
    for name, (part, policy) in hierarchy.SCRIPTED.items():
        counts[name] = sum(key.policy == policy for key in planned[part].keys)
    for part in ("primary-models", "unaware-models", "lateral-models"):
        for key in planned[part].keys:
            driver = scores.Driver(key.simulator, "VLM", key.condition)
            name = plans.name_of(part, driver)
            counts[name] = counts.get(name, 0) + 1
    constants = [f"constant {action}" for action in ("STRAIGHT", "SLOW", "STOP", "LEFT", "RIGHT")]
    primary = ["MPC-only", "oracle intent", "random intent", *constants, "VLM", "VLM, mirrored", "VLM, blank"]
    oracle, vlm = "oracle, lateral intent", "VLM, lateral intent"
    second = ["mpc-oracle", "mpc-blind", vlm, f"{vlm}, mirrored", oracle, f"{oracle}, mirrored"]
    second += ["VLM, full intent", "VLM, full intent, mirrored"]
    assert {name: counts[name] for name in primary} == dict.fromkeys(primary, 25)
    assert {name: counts[name] for name in second} == dict.fromkeys(second, 32)
    other = {f"{name}, {shown}" for name in (vlm, "VLM, full intent") for shown in ("blank", "shuffled")}
    assert counts.keys() - {*primary, *second} == other | {"VLM, shuffled"}


@pytest.mark.parametrize("limits", [{"calls": 10}, {"cost_usd": 0.095}])
def test_a_limit_bounds_the_whole_study(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limits: dict[str, float]
) -> None:
    """What the first part took is not left for the second; the command that resumes counts both."""
    monkeypatch.setattr(plans, "PARTS", SHORT)
    planned = hierarchy.plan(tmp_path, [RequestMode(own("dear"))])
    for _ in range(2):
        outcome = hierarchy.run(planned, FREE, bounds=ONE, **limits)  # type: ignore[arg-type]
        assert outcome.stopped is not None
        assert len(planned["lateral-models"].left()) == 1
        calls = [spent_on([part.out], FREE).calls for part in planned.values()]
        assert min(calls) >= 3
        assert sum(calls) == 10


@pytest.mark.parametrize("limits", [{"calls": 10}, {"cost_usd": 0.095}])
def test_a_limit_counts_the_arms_that_are_no_part_of_todays_choice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limits: dict[str, float]
) -> None:
    """What an arm took on another day is spent, whichever is chosen today."""
    monkeypatch.setattr(plans, "PARTS", SHORT)
    dear_one = [RequestMode(own("dear"))]
    hierarchy.run(
        hierarchy.plan(tmp_path, dear_one, choice=plans.HierarchySelection(arms=("unaware",))), FREE, bounds=ONE
    )
    before = spent_on([tmp_path / "unaware-models"], FREE).calls
    assert before < 10
    today = hierarchy.plan(tmp_path, dear_one, choice=plans.HierarchySelection(arms=("lateral",)))
    assert hierarchy.run(today, FREE, bounds=ONE, **limits).stopped is not None  # type: ignore[arg-type]
    assert spent_on([tmp_path / name for name in SHORT], FREE).calls == 10


def test_a_model_that_is_set_aside_in_one_part_is_asked_in_no_later_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its key would be refused there too; what is not driven is unfinished, and the study says why."""
    monkeypatch.setattr(plans, "PARTS", SHORT)
    planned = hierarchy.plan(tmp_path, [RequestMode(own("lapsed"))])
    outcome = hierarchy.run(planned, FREE, bounds=ONE)
    assert outcome.set_aside == {own("lapsed"): "auth: no such key"}
    assert [len(part.left()) for part in planned.values()] == [1, 1]
    assert not (tmp_path / "lateral-models" / LEDGER).exists()
    with Ledger(tmp_path / "unaware-models" / LEDGER) as ledger:
        assert len(list(ledger.attempts(own("lapsed")))) == 1


def test_a_folder_without_the_study_is_refused(tmp_path: Path) -> None:
    """With the command that makes one."""
    with pytest.raises(LedgerError, match="holds no run of the hierarchy; 'eyechart run hierarchy --out"):
        score(tmp_path)
    assert list(read_episodes(tmp_path)) == []


def driven(planned: Mapping[str, EpisodesRun]) -> dict[str, set[tuple[str, str, int]]]:
    """Return who is to drive where, by part."""
    return {name: {(key.policy, key.scenario, key.seed) for key in run.keys} for name, run in planned.items()}


def test_sources_arms_worlds_and_seeds_are_chosen(tmp_path: Path) -> None:
    """By the names of the tables, some of which hold commas, or by policies, which stand for every arm of theirs."""
    chosen = hierarchy.read_choice("oracle, lateral intent, mirrored, random", None, "offset, clutter", [3])
    found = driven(hierarchy.plan(tmp_path, choice=chosen))
    assert found == {
        "primary": {("random", "offset", 3), ("random", "clutter", 3)},
        "lateral": {("mirrored:route", "offset", 3), ("mirrored:route", "clutter", 3)},
    }
    both = hierarchy.plan(tmp_path, choice=hierarchy.read_choice("route", "primary,lateral"))
    assert {name: len(one.keys) for name, one in both.items()} == {"primary": 25, "lateral": 32}
    single = hierarchy.plan(tmp_path, choice=hierarchy.read_choice(worlds="single"))
    assert set(single) == {"primary"}  # the second ablation has no such world


def test_sources_are_named_in_any_letters() -> None:
    """As mpc-only for MPC-only, which the tables write in capitals."""
    assert hierarchy.read_choice("mpc-only") == hierarchy.read_choice("MPC-only")


def test_a_model_drives_alone_where_no_source_is_wanted(tmp_path: Path) -> None:
    """In every arm of models, or in those that are chosen; an arm without models has none to drive."""
    model = [RequestMode(SEEING)]
    alone = hierarchy.plan(tmp_path, model, choice=hierarchy.read_choice("none", seeds=[0]))
    assert list(alone) == ["primary-models", "unaware-models", "lateral-models"]
    arm = hierarchy.plan(tmp_path, model, choice=hierarchy.read_choice("none", "lateral", seeds=[0]))
    assert list(arm) == ["lateral-models"]
    with pytest.raises(SpecError, match="no model drives in this choice: models drive in the arms primary, unaware, l"):
        hierarchy.plan(tmp_path, model, choice=hierarchy.read_choice(arms="constrained"))


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ({"sources": "route, oracel"}, "--sources takes one or more of MPC-only; oracle intent; .* got 'oracel'"),
        ({"arms": "primary-models"}, "--arms takes one or more of primary, constrained, unaware, lateral"),
        ({"worlds": "offset,maze"}, "--worlds takes one or more of offset, single, slalom, gate, clutter"),
        ({"worlds": " , "}, "--worlds takes one or more of"),
        ({"sources": "mirrored:route", "arms": "primary"}, "no source is left"),
        (
            {"sources": "route,random", "arms": "primary,constrained"},
            r"no source drives in the arm 'constrained' in this choice; its scripted sources are 'mpc-oracle'",
        ),
        ({"sources": "none"}, "no source is left"),
    ],
)
def test_a_choice_that_the_study_does_not_have_says_what_it_has(
    words: Mapping[str, str], why: str, tmp_path: Path
) -> None:
    """In one sentence that names the option."""
    with pytest.raises(SpecError, match=why):
        hierarchy.plan(tmp_path, choice=hierarchy.read_choice(**words))


def test_a_chosen_part_of_the_study_is_driven_and_read(tmp_path: Path) -> None:
    """The command drives it, its tables have these rows alone, and a wider choice goes on in the same folder."""
    words = ["run", "hierarchy", "--arms", "primary", "--worlds", "offset", "--out", str(tmp_path / "out"), "--json"]
    first = CliRunner().invoke(app, [*words, "--sources", "route", "--seeds", "1"])
    assert first.exit_code == 0, first.output
    rows = {(one["name"], one["goals"]["n"]) for one in json.loads(first.stdout)["sources"]}
    assert rows == {("oracle intent", 1)}
    wider = CliRunner().invoke(app, [*words, "--sources", "route,random intent", "--seeds", "0,1"])
    rows = {(one["name"], one["goals"]["n"]) for one in json.loads(wider.stdout)["sources"]}
    assert rows == {("oracle intent", 2), ("random intent", 2)}
    assert not json.loads(wider.stdout)["unfinished"]
