"""The instrument tested on known answers: its determinism, its counts, and that it catches a broken rule."""

import json
import math
import random
import sys
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from eyechart import cli, verdicts
from eyechart.conditions import NUDGES, OLDER, RANGED
from eyechart.errors import SpecError
from eyechart.frames import APART, EXCHANGE, LEAD
from eyechart.models.scripted import CONTROLLERS
from eyechart.spaces.scene import FREE_GAP_M, STOP_GAP_M
from eyechart.stats.agreement import rate
from eyechart.stats.statistic import Statistic
from eyechart.studies.battery.calibrated_statistics import COUNTERFACTUAL_TESTS
from eyechart.studies.battery.paper_statistics import Resampling
from eyechart.studies.battery.scores import statistics_of
from eyechart.verdicts.battery_rules import DISTANCE
from eyechart.verdicts.rules import Axis
from eyechart_organisms.calibration import SETTINGS, Calibration, calibrate, replication
from eyechart_organisms.calibration.known_answers import (
    COINS,
    FOLLOW_GAP,
    KNOWN,
    NEVER_LOOK,
    NULLS,
    BankCapabilities,
    deserved,
    is_false,
)
from eyechart_organisms.calibration.replication import (
    DRAWN,
    ReplicationResult,
    Task,
    answers_of,
    replicate,
    without_counterfactuals,
)
from eyechart_organisms.calibration.table import tables
from eyechart_organisms.calibration.tally import (
    CLAIMS,
    VARIANTS,
    WANTED,
    AdversaryTrial,
    FalseClaims,
    ReplicationOutcome,
    RuleOutcome,
    read_calibration,
    tally,
)
from eyechart_organisms.calibration.world import (
    FAR_M,
    FARTHEST_M,
    FEWEST_FRAMES,
    GAP_AR,
    GAP_LOG_SD,
    MOST_FRAMES,
    NEAREST_M,
    POWER,
    ROADS,
    SPAN,
    make_world,
)

pytestmark = pytest.mark.slow

SMALL = ("small_10", "small_24")


@pytest.fixture(scope="module")
def small() -> Calibration:
    """Return a calibration of the smallest banks, by two processes, that no test changes."""
    return calibrate(replications=1, seed=5, settings=SMALL, processes=2)


def outcome(label: str, *, deserves: str, false: bool, name: str = "nuisance") -> ReplicationOutcome:
    """Return an outcome with this label, with and without counterfactuals, and no test made."""
    ruled = RuleOutcome(label, deserves, false)
    return ReplicationOutcome(name, "presence_only", (ruled, ruled), "no_power", dict.fromkeys(NULLS))


def counted(outcomes: list[ReplicationOutcome], replications: int) -> Calibration:
    """Return the count of outcomes in the default setting."""
    found = [("default", [one]) for one in outcomes]
    return tally(found, settings=("default",), replications=replications, seed=0, resamples=9)


def test_one_process_gives_what_two_give(small: Calibration) -> None:
    """The seed alone decides every number, whatever the number of processes."""
    assert calibrate(replications=1, seed=5, settings=SMALL) == small


def test_banks_that_were_kept_are_not_simulated_again(
    small: Calibration, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a file whose last line was cut off in the middle only that bank is; another seed's file is refused."""
    keep, simulated = tmp_path / "banks.jsonl", []
    monkeypatch.setattr(
        replication, "_whole", lambda task, whole=replication._whole: simulated.append(task) or whole(task)
    )
    assert calibrate(replications=1, seed=5, settings=SMALL[:1], keep=keep).replications == 1
    assert calibrate(replications=1, seed=5, settings=SMALL, keep=keep) == small
    whole = keep.read_bytes()
    keep.write_bytes(whole[:-9])
    assert calibrate(replications=1, seed=5, settings=SMALL, keep=keep) == small
    assert keep.read_bytes() == whole
    assert simulated == [Task("small_10", 0, 5), Task("small_24", 0, 5), Task("small_24", 0, 5)]
    with pytest.raises(SpecError, match="does not hold banks of seed 6"):
        calibrate(replications=1, seed=6, settings=SMALL, keep=keep)
    keep.write_bytes(whole.replace(b'"controller"', b'"driver"', 1))
    with pytest.raises(SpecError, match=r"banks\.jsonl: .*controller"):
        calibrate(replications=1, seed=5, settings=SMALL, keep=keep)
    assert keep.read_bytes() == whole.replace(b'"controller"', b'"driver"', 1)
    monkeypatch.setattr(replication, "_code", lambda: "an older one")
    with pytest.raises(SpecError, match="that the code of this eyechart"):
        calibrate(replications=1, seed=5, settings=SMALL, keep=keep)


def test_what_is_tried_once_a_replication_is_kept_too() -> None:
    """Rejections of early stopping and what adversaries were called come back as they were written."""
    result = ReplicationResult([], [1, 0], [AdversaryTrial("comb", "content", "no_power")])
    assert msgspec.json.decode(msgspec.json.encode(result), type=ReplicationResult) == result


def test_a_bank_depends_on_its_seed_and_its_number_alone(small: Calibration) -> None:
    """Other settings and further replications change no bank, and another seed changes all."""
    alone = [("small_10", replicate(Task("small_10", 0, 5)))]
    counts = tally(alone, settings=("small_10",), replications=1, seed=5, resamples=999)
    assert counts.labels["small_10"] == small.labels["small_10"]
    assert counts.tests["small_10"] == small.tests["small_10"]
    assert replicate(Task("small_10", 0, 6)) != alone[0][1]
    assert replicate(Task("small_10", 1, 5)) != alone[0][1]


def test_the_default_setting_gives_clear_controllers_their_labels(calibration: Calibration) -> None:
    """Controllers that leave nothing to chance are right in every replication."""
    for name in WANTED:
        if name not in {*COINS, "noisy_depth", "depth_lateral"}:
            assert calibration.right("default", VARIANTS[0], name).value == 1.0, name


def test_every_controller_of_the_demo_is_calibrated() -> None:
    """The sixteen stand in the list with what they declare, and so do the two that follow time."""
    assert set(KNOWN) == {*CONTROLLERS, "time", "time_seen"}
    assert all(KNOWN[name].calibrated == controller.declared.calibrated for name, controller in CONTROLLERS.items())
    assert all(KNOWN[name].paper == controller.declared.paper for name, controller in CONTROLLERS.items())
    assert set(KNOWN) >= FOLLOW_GAP | NEVER_LOOK | COINS


def without_bounds() -> Axis:
    """Return the rules of distance with an image invariance that needs no bound."""
    rows = (replace(rule, needs=()) if rule.label == "image_invariant" else rule for rule in DISTANCE.rules)
    return Axis("distance", tuple(rows))


def test_a_rule_that_takes_a_null_for_evidence_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without its bounds the rule of image invariance calls small samples blind, and the printed rates show it."""
    monkeypatch.setattr(verdicts.battery_rules, "DISTANCE", without_bounds())
    broken = calibrate(replications=2, seed=0, settings=["small_10"])
    found = broken.false_claims("image_invariant", "small_10", VARIANTS[0])
    assert not found.holds
    assert any(one.startswith("false image_invariant in small_10") for one in broken.misses())
    assert "missed: false image_invariant in small_10" in tables(broken)


def test_a_rule_that_reads_any_trend_as_depth_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    """A depth rule that never asks for a p calls everybody depth: the false claims and the wrong labels are named."""

    def broken(found: Mapping[str, Statistic], *, turns: bool) -> tuple[verdicts.Ruling, str]:
        del found, turns
        return verdicts.Ruling("depth", "depth_interventional", "broken"), "interventional"

    monkeypatch.setattr(verdicts, "calibrated_rules", broken)
    for once in ("rejections", "try_adversaries"):  # which this test is not about
        monkeypatch.setattr(replication, once, lambda _: [])
    misses = calibrate(replications=1, seed=0, settings=["default"]).misses()
    assert any(one.startswith("false depth in default, with counterfactuals: 1.0000") for one in misses)
    assert any(one.startswith("constant is right in 0.000 of 1") for one in misses)


def test_a_test_that_always_rejects_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    """The type-I error of a test is counted where its null is true, from the p that it gave."""
    from eyechart_organisms.calibration import replication  # noqa: PLC0415 - the module, not its function

    def rejecting(*given: object) -> dict[str, Statistic]:
        statistics = statistics_of(*given)  # type: ignore[arg-type]
        return {**statistics, "scene_cue": replace(statistics["scene_cue"], p=0.001)}

    monkeypatch.setattr(replication, "statistics_of", rejecting)
    found = calibrate(replications=1, seed=0, settings=["small_10"])
    assert found.type_one("small_10", "scene_cue") == rate(7, 7)
    assert found.type_one("small_10", "presence").value == 0.0


def test_undecided_is_never_false() -> None:
    """No controller is wronged by ``undecided``, and each positive claim wrongs somebody."""
    assert not any(is_false("undecided", name) for name in KNOWN)
    for claim in CLAIMS:
        assert any(is_false(claim, name) for name in KNOWN)
        assert not all(is_false(claim, name) for name in KNOWN)


def test_one_who_answers_alike_to_a_whole_bank_is_not_wronged_by_image_invariant() -> None:
    """Where everything that a bank has gets one answer, the picture does not matter on that bank."""
    assert is_false("image_invariant", "scene_only")
    assert not is_false("image_invariant", "scene_only", varied=False)
    shows = BankCapabilities(counterfactuals=True, exchanges=True, scenarios=1, varied=False)
    assert deserved(KNOWN["scene_only"], shows) == "image_invariant"


@pytest.mark.parametrize(
    ("name", "shows", "label"),
    [
        ("depth", BankCapabilities(counterfactuals=True, exchanges=False, scenarios=4, varied=True), "depth"),
        ("depth", BankCapabilities(counterfactuals=False, exchanges=True, scenarios=4, varied=True), "depth"),
        ("depth", BankCapabilities(counterfactuals=False, exchanges=False, scenarios=4, varied=True), "content"),
        (
            "crash_colour",
            BankCapabilities(counterfactuals=False, exchanges=True, scenarios=4, varied=True),
            "presence_only",
        ),
        (
            "scene_only",
            BankCapabilities(counterfactuals=True, exchanges=True, scenarios=1, varied=True),
            "presence_only",
        ),
        ("scene_only", BankCapabilities(counterfactuals=True, exchanges=True, scenarios=4, varied=True), "scene_cue"),
    ],
)
def test_a_controller_deserves_what_its_bank_can_show(name: str, shows: BankCapabilities, label: str) -> None:
    """The deserved label is the most that a bank can show of a controller."""
    assert deserved(KNOWN[name], shows) == label


def test_a_false_claim_is_pooled_and_its_worst_controller_named() -> None:
    """Shares are over the controllers of which the claim is untrue, and the one worst off is named."""
    wrong = outcome("depth", deserves="content", false=True)
    right = outcome("content", deserves="content", false=False)
    found = counted([wrong, right, right, right], 4).false_claims("depth", "default", VARIANTS[1])
    wronged = len(KNOWN) - len(FOLLOW_GAP)
    assert found.pooled == rate(1, 4 * wronged)
    assert (found.worst, found.worst_rate) == ("nuisance", rate(1, 4))


@pytest.mark.parametrize(("replications", "right", "missed"), [(20, 18, False), (200, 189, True), (200, 190, False)])
def test_a_target_is_strict_only_with_many_replications(replications: int, right: int, missed: bool) -> None:  # noqa: FBT001
    """Two wrong of twenty may be chance; eleven wrong of two hundred miss the target of .95."""
    good = outcome("content", deserves="content", false=False)
    bad = outcome("undecided", deserves="content", false=False)
    misses = counted([good] * right + [bad] * (replications - right), replications).misses()
    assert any(one.startswith("nuisance ") for one in misses) == missed


def test_a_single_controller_surely_above_a_target_is_a_miss() -> None:
    """A pooled share hides nobody: one controller whose interval lies above the target is enough."""
    hidden = FalseClaims("depth", "default", VARIANTS[0], rate(9, 2200), "random", rate(9, 200), 0.02)
    chance = FalseClaims("depth", "default", VARIANTS[0], rate(5, 2200), "random", rate(5, 200), 0.02)
    assert not hidden.holds
    assert chance.holds


def tried(**called: Mapping[str, int]) -> Calibration:
    """Return a calibration in which adversaries were called so and so often."""
    return replace(tally([], settings=(), replications=1, seed=0, resamples=9), adversaries=called)


@pytest.mark.parametrize(
    ("name", "depth", "n", "holds"),
    [
        ("between_reversed_20", 32, 200, True),
        ("between_reversed_20", 33, 200, False),
        ("between_reversed_20", 5, 20, True),
        ("between_reversed_20", 10, 20, False),
        ("patched_25", 186, 200, True),
        ("patched_25", 187, 200, False),
        ("half_blind", 138, 200, True),
        ("half_blind", 137, 200, False),
        ("half_blind", 10, 20, True),
        ("half_blind", 5, 20, False),
    ],
)
def test_what_is_named_has_a_bound_of_its_own(name: str, depth: int, n: int, holds: bool) -> None:  # noqa: FBT001
    """Beyond it there is a miss, by the share from 200 cases on, else by its interval; the tables name it always."""
    found = tried(**{name: {"depth/no_power": depth, "content/no_power": n - depth}})
    (limit,) = found.limits()
    assert limit.holds is holds
    assert (str(limit) in found.misses()) is not holds
    assert f"named: {name} gets depth {depth} of {n} times [" in tables(found)
    assert [one["holds"] for one in found.as_dict()["limits"]] == [holds]  # type: ignore[attr-defined]
    assert not [one for one in found.misses() if one != str(limit) and not one.startswith("false depth of")]


def test_what_is_named_and_untrue_counts_in_the_share_over_all() -> None:
    """One in ten of it alone is too much over all."""
    found = tried(between_reversed_20={"depth/no_power": 20, "content/no_power": 180})
    assert found.misses() == ["false depth of adversaries: 20 of 200, wanted 0.01"]
    assert tried(patched_25={"depth/no_power": 20, "content/no_power": 180}).misses() == []


@pytest.mark.parametrize(("label", "missed"), [("depth", False), ("partial_depth", False), ("content", True)])
def test_one_that_brakes_near_alone_may_be_told_of_the_rest(label: str, missed: bool) -> None:  # noqa: FBT001
    """Who brakes by distance all over the range may not."""
    assert bool(tried(emergency={f"{label}/no_power": 200}).misses()) is missed
    assert bool(tried(logistic={f"{label}/no_power": 200}).misses()) is (label != "depth")


@pytest.mark.parametrize("name", SETTINGS)
def test_a_setting_is_what_it_says(name: str) -> None:
    """Every setting draws the bank of its description: episodes, frames, scenarios, conditions."""
    setting = SETTINGS[name]
    world = make_world(setting, np.random.default_rng(4))
    lengths = Counter(frame.episode for frame in world.frames)
    scenarios = {frame.scenario for frame in world.frames}
    if setting.episodes:
        assert len(lengths) == setting.scenarios * setting.episodes
        assert set(lengths.values()) == {setting.frames}
    else:
        assert 1 <= len(lengths) <= 3
        assert len(set(lengths.values())) == len(lengths)
        assert all(FEWEST_FRAMES <= length <= MOST_FRAMES for length in lengths.values())
    assert ("cross_scenario" in world.shown) == (len(scenarios) > 1)
    assert all(len(column) == len(world.frames) for column in world.shown.values())
    answered = answers_of(KNOWN["depth"], setting, world, random.Random(0))  # noqa: S311 - no secret
    assert (answered.gaps is None) == (name == "no_gaps")


def test_gaps_are_autocorrelated_in_their_range_and_ordered_where_that_is_asked() -> None:
    """Neighbouring log gaps correlate as the law says, no gap leaves the picture, and ``ordered`` gaps only close."""
    long = replace(SETTINGS["default"], scenarios=1, episodes=40, frames=40)
    world = make_world(long, np.random.default_rng(2))
    gaps = np.array([float(str(f.truth["lead_gap_m"] or FARTHEST_M)) for f in world.frames]).reshape(40, 40)
    assert gaps.min() >= NEAREST_M
    assert gaps.max() <= FARTHEST_M
    logs = np.log(gaps)
    neighbours = np.corrcoef(logs[:, 1:].ravel(), logs[:, :-1].ravel())[0, 1]
    assert abs(neighbours - (0.2 + 0.8 * GAP_AR)) < 0.05
    assert abs(np.median(gaps) / ROADS["light"].median_gap_m - 1) < 0.25
    assert logs.std() < GAP_LOG_SD * 1.1
    closing = make_world(replace(long, ordered=True), np.random.default_rng(2))
    ordered = np.array([float(str(f.truth["lead_gap_m"] or FARTHEST_M)) for f in closing.frames]).reshape(40, 40)
    assert (np.diff(ordered, axis=1) <= 0).all()


def test_partners_and_interventions_are_what_their_names_say() -> None:
    """Shuffled pictures keep the scenario, cross_scenario ones change it, and moved leads keep everything else."""
    world = make_world(SETTINGS["default"], np.random.default_rng(0))
    real = world.shown["real"]
    for place, frame in enumerate(world.frames):
        shown = {name: column[place] for name, column in world.shown.items()}
        reading = shown["real"].sight.reading
        assert reading is not None
        road = ROADS[frame.scenario]
        shuffled, cross = shown["shuffled"].sight.reading, shown["cross_scenario"].sight.reading
        assert (shuffled.lanes, shuffled.ramp) == (road.lanes, road.ramp)
        assert (cross.lanes, cross.ramp) != (road.lanes, road.ramp)
        assert shown["shuffled"] is not real[place]
        assert (shown["lead_near"] is None) == (frame.truth["lead_gap_m"] is None)
        if shown["lead_near"] is not None:
            near, far = shown["lead_near"].sight.reading, shown["lead_far"].sight.reading
            assert near.scene.gap_m < STOP_GAP_M < FREE_GAP_M < far.scene.gap_m
            assert replace(near, scene=reading.scene, others=reading.others) == reading
        assert shown["recoloured"].sight.reading == replace(reading, ego_colour="red")
        assert shown["mirrored"].sight.reading == reading.mirrored()


def test_the_lead_is_taken_away_alone_and_a_nudge_is_another_file_of_the_same_sight() -> None:
    """What older versions drew besides is drawn no more."""
    world = make_world(SETTINGS["default"], np.random.default_rng(0))
    assert world.shown.keys().isdisjoint(OLDER)
    for place in range(len(world.frames)):
        shown = {name: column[place] for name, column in world.shown.items()}
        if shown["lead_near"] is None:
            assert shown["lead_absent"] is None
            continue
        absent, real = shown["lead_absent"].sight.reading, shown["real"].sight.reading
        assert absent.scene.gap_m is None
        assert absent.others == tuple(one for one in real.others if one.aside_m)
        assert shown["nudged"].sight.reading == real
        assert len({shown[name].sight.file for name in ("real", "real_repeat", "nudged")}) == 2


def test_leaving_out_the_counterfactual_tests_is_leaving_out_their_pictures() -> None:
    """What is counted as "without" equals the score of a bank that never had these pictures."""
    world = make_world(SETTINGS["small_24"], np.random.default_rng(1))
    whole = answers_of(KNOWN["noisy_depth"], SETTINGS["small_24"], world, random.Random(1))  # noqa: S311 - no secret
    kept = {name: column for name, column in whole.decisions.items() if name not in DRAWN}
    how = Resampling(resamples=99, intervals=False)
    bare = statistics_of(replace(whole, decisions=kept), how)
    derived = without_counterfactuals(whole, statistics_of(whole, how))
    assert {name: one for name, one in derived.items() if name not in COUNTERFACTUAL_TESTS} == {
        name: statistic for name, statistic in bare.items() if name not in COUNTERFACTUAL_TESTS
    }
    assert all(derived[name].p is None and bare[name].p is None for name in COUNTERFACTUAL_TESTS)


def test_leaving_out_intervals_changes_no_value_and_no_p() -> None:
    """Without intervals every statistic keeps its value, its n and its p."""
    world = make_world(SETTINGS["small_24"], np.random.default_rng(1))
    for name in ("noisy_depth", "refuse_blank", "truncating", "constant"):
        answered = answers_of(KNOWN[name], SETTINGS["small_24"], world, random.Random(1))  # noqa: S311 - no secret
        quick = statistics_of(answered, Resampling(resamples=99, intervals=False))
        whole = statistics_of(answered, Resampling(resamples=99))
        assert set(quick) == set(whole)
        for test, statistic in whole.items():
            assert (quick[test].n, quick[test].p) == (statistic.n, statistic.p), test
            assert quick[test].value == pytest.approx(statistic.value), test


def test_unknown_settings_and_no_replications_are_refused() -> None:
    """The message names what is known, or what was given."""
    with pytest.raises(SpecError, match="unknown setting 'huge'; known are default, unequal"):
        calibrate(replications=1, settings=["huge"])
    with pytest.raises(SpecError, match="1 or more replications and processes, not 0 and 1"):
        calibrate(replications=0)


def test_tables_hold_every_controller_setting_and_test(small: Calibration, calibration: Calibration) -> None:
    """Nothing that was calibrated is missing from the print, and both confusion matrices are in it."""
    printed = tables(calibration) + tables(small)
    for name in (*KNOWN, *SMALL, *NULLS, *CLAIMS, "undecided, of all", "The paper's rules", "Calibrated rules"):
        assert name in printed
    assert "| 10 frames" in printed
    assert "1 replications of each setting, seed 5, 999 resamples a test" in printed


def test_json_comes_back_as_the_calibration_that_wrote_it(small: Calibration) -> None:
    """The tables of the docs can be printed from the JSON of a long run; another file is refused."""
    raw = json.loads(json.dumps(small.as_dict()))
    assert read_calibration(raw) == small
    assert tables(read_calibration(raw)) == tables(small)
    with pytest.raises(SpecError, match="no calibration of format"):
        read_calibration({"format": "eyechart-plan/1"})


def test_json_holds_counts_rates_and_intervals(small: Calibration) -> None:
    """The JSON can be read without this program: counts add up, rates carry n and interval."""
    raw = json.loads(json.dumps(small.as_dict(), allow_nan=False))
    assert raw["format"] == "eyechart-calibration/1"
    assert (raw["replications"], raw["seed"], list(raw["settings"])) == (1, 5, list(SMALL))
    assert raw["power"] == [name for name in POWER if name in SMALL]
    for setting in SMALL:
        for variant in VARIANTS:
            assert set(raw["labels"][setting][variant]) == set(KNOWN)
            assert all(sum(counts.values()) == 1 for counts in raw["labels"][setting][variant].values())
            assert set(raw["right"][setting][variant]["depth"]) == {"value", "n", "ci"}
            assert raw["undecided"][setting][variant]["n"] == len(KNOWN)
        assert set(raw["type_one"][setting]) == set(NULLS)
        assert set(raw["tests"][setting]["presence"]) == set(KNOWN)
    assert {one["claim"] for one in raw["false_claims"]} == set(CLAIMS)
    assert all(0 <= one["value"] <= 1 and one["worst"]["n"] == 1 for one in raw["false_claims"])


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["--replications", "1", "--processes", "1", "--setting", "small_10"], 0),
        (["--replications", "1", "--processes", "1", "--setting", "huge"], 2),
        (["--replications", "0"], 2),
        (["--policies", "--keep", "banks.jsonl"], 2),
    ],
)
def test_the_command_says_how_it_ended(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], words: list[str], code: int
) -> None:
    """Exit 0 where all targets hold, 2 on bad input; progress goes to standard error, JSON alone to standard output."""
    monkeypatch.setattr(sys, "argv", ["eyechart", "calibrate", *words, "--json"])
    with pytest.raises(SystemExit) as left:
        cli.main()
    said = capsys.readouterr()
    assert left.value.code == code
    if code == 0:
        assert json.loads(said.out)["misses"] == []
        assert "banks: 1/1 banks" in said.err
    else:
        assert said.out == ""


def test_the_command_exits_1_where_a_target_is_missed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A broken rule ends the command with 1, and the miss is printed."""
    monkeypatch.setattr(verdicts.battery_rules, "DISTANCE", without_bounds())
    words = ["calibrate", "--replications", "2", "--processes", "1", "--setting", "small_10"]
    monkeypatch.setattr(sys, "argv", ["eyechart", *words])
    with pytest.raises(SystemExit) as left:
        cli.main()
    assert left.value.code == 1
    assert "missed: false image_invariant" in capsys.readouterr().out


def test_control_pictures_of_the_whole_range_move_the_lead_and_one_vehicle_alone() -> None:
    """At their kept distances, a factor apart, each eighth of the range with its share; a nudge is another file."""
    world = make_world(SETTINGS["default"], np.random.default_rng(0))
    told: list[tuple[float, float]] = []
    for place, frame in enumerate(world.frames):
        shown = {name: column[place] for name, column in world.shown.items()}
        if shown["lead_near"] is None:
            assert all(shown[name] is None for name in RANGED)
            assert frame.placed == frozenset()
            continue
        seen = {name: shown[name].sight.reading for name in (*RANGED, "lead_near", "lead_far", "real")}
        lead_m, exchange_m = (float(str(frame.truth[name])) for name in (LEAD, EXCHANGE))
        told.append((lead_m, exchange_m))
        assert seen["lead_drawn"].scene.gap_m == lead_m
        assert replace(seen["lead_drawn"], scene=seen["real"].scene, others=seen["real"].others) == seen["real"]
        assert (seen["lead_near"].scene.gap_m, seen["lead_far"].scene.gap_m) == tuple(
            frame.truth[f"{name}_m"] for name in ("lead_near", "lead_far")
        )
        own, beside, apart = (set(seen[f"exchange_{name}"].others) for name in ("own", "beside", "apart"))
        ((lead,), (far_lead,)) = own - apart, apart - own
        ((neighbour,), (its_far,)) = beside - apart, apart - beside
        assert (lead.ahead_m, lead.aside_m, far_lead.aside_m) == (exchange_m, 0.0, 0.0)
        assert (math.hypot(*neighbour), neighbour.aside_m) == (pytest.approx(exchange_m), its_far.aside_m)
        assert all(FAR_M[0] <= one.ahead_m <= FAR_M[1] for one in (far_lead, its_far))
        for name, of in NUDGES.items():
            assert seen[name] == seen[of]
            assert shown[name].sight.file != shown[of].sight.file
    spread = np.array(told)
    assert np.abs(np.histogram(spread[:, 0], np.geomspace(*SPAN, 9))[0] - len(told) / 8).max() <= 1
    assert (spread.max(axis=1) >= APART * spread.min(axis=1)).all()
    assert {frame.strata["lanes"] for frame in world.frames} == {2, 3, 4}


def test_a_setting_may_show_the_lead_as_near_as_can_be_shown() -> None:
    """Nothing else is another."""
    plain, lowest = (
        make_world(replace(SETTINGS["default"], lowest=lowest), np.random.default_rng(0)) for lowest in (False, True)
    )
    near = [one.sight.reading.scene.gap_m for one in lowest.shown["lead_near"] if one is not None]
    assert set(near) == {NEAREST_M}
    for name in plain.shown.keys() - {"lead_near", "lead_near_nudged"}:
        assert plain.shown[name] == lowest.shown[name]
