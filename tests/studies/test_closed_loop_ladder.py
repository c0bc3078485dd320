"""The ladder and the blind baseline on synthetic drives whose answer is known."""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drives import always, by_depth, drive, make_run, tossing
from eyechart.conditions import OF_WORLDS
from eyechart.episodes import Episode, EpisodeKey, write_episodes
from eyechart.errors import LedgerError, SpecError
from eyechart.frames import Scalar
from eyechart.spaces.space import Decision
from eyechart.stats.agreement import clopper_pearson
from eyechart.stats.paired_tests import mcnemar_exact
from eyechart.studies.closed_loop import score
from eyechart.studies.closed_loop.ladder import NO_INTERVAL
from eyechart.studies.closed_loop.tables import PUBLISHED, beside_paper, leads, unlike


def crashing(policy: str, action: str, *, of: int, condition: str = "real") -> list[Episode]:
    """Return 32 drives, of which the first so many end in a crash half way."""
    whole = drive(policy, always(action), condition=condition)
    short = drive(policy, always(action), condition=condition, steps=10, ended="crash")
    return [*short[:of], *whole[of:]]


def test_a_row_holds_means_and_exact_rates(tmp_path: Path) -> None:
    """Distance, reward and speed are means over episodes, without an interval; a crash rate has the exact one."""
    run = make_run(tmp_path, crashing("constant:SLOW", "SLOW", of=3))
    (row,) = score(run).ladder
    assert row.statistics["distance_m"].value == pytest.approx((29 * 400 + 3 * 200) / 32)
    assert row.statistics["speed_mps"].value == pytest.approx(20)
    crash = row.statistics["crash_rate"]
    assert (crash.value, crash.n, crash.ci) == (3 / 32, 32, clopper_pearson(3, 32))
    assert row.statistics["success_rate"].value == 29 / 32
    assert (row.statistics["distance_m"].ci, row.statistics["distance_m"].note) == (None, NO_INTERVAL)


def test_policies_are_held_against_the_best_constant_world_by_world(tmp_path: Path) -> None:
    """The reference is the constant of the highest reward; Holm never makes a p smaller."""
    episodes = [
        *crashing("constant:SLOW", "SLOW", of=0),
        *crashing("constant:LEFT", "LEFT", of=32),
        *crashing("oracle", "STRAIGHT", of=16),
    ]
    found = score(make_run(tmp_path, episodes))
    assert found.references["highway"].policy == "constant:SLOW"
    left, oracle = found.paired
    assert (left.first.policy, oracle.first.policy) == ("constant:LEFT", "oracle")
    assert left.differences["crash_rate"].p == mcnemar_exact(32, 0).p
    assert oracle.differences["crash_rate"].as_dict()["detail"] == {"b": 16, "c": 0}
    for one in (left, oracle):
        assert all((one.holm[name] or 0) >= (each.p or 0) for name, each in one.differences.items())
    assert "crash_rate" in left.changed
    assert score(tmp_path, against_policy="oracle").references["highway"].policy == "oracle"
    with pytest.raises(SpecError, match="no such policy drove"):
        score(tmp_path, against_policy="nobody").references  # noqa: B018 - computed when asked for


def test_the_same_episodes_in_another_order_give_the_same_bytes(tmp_path: Path) -> None:
    """The order in which processes finish has no say."""
    episodes = [*drive("constant:SLOW", always("SLOW")), *drive("random", tossing("t")), *drive("oracle", by_depth)]
    first = score(make_run(tmp_path / "one", episodes), resamples=300).as_dict()
    second_run = make_run(tmp_path / "two", episodes)
    episodes = [episodes[place] for place in np.random.default_rng(1).permutation(len(episodes))]
    (second_run / "episodes.jsonl").write_text("")
    write_episodes(second_run, episodes)
    assert json.dumps(score(second_run, resamples=300).as_dict(), allow_nan=False) == json.dumps(first, allow_nan=False)


def test_an_episode_in_error_counts_in_no_number(tmp_path: Path) -> None:
    """It is listed with its row; driven anew, the later record counts."""
    good = drive("constant:SLOW", always("SLOW"))
    bad = Episode(EpisodeKey("constant:SLOW", "highway", "light", 99), (), "error", "", "the camera shows black only")
    again = drive("constant:SLOW", always("SLOW"), seeds=[99])[0]
    run = make_run(tmp_path, [*good, bad])
    (row,) = score(run).ladder
    assert (row.errors, row.statistics["reward"].n) == (1, 32)
    write_episodes(run, [again])
    assert score(run).ladder[0].statistics["reward"].n == 33
    assert score(run).ladder[0].errors == 0


def test_two_different_episodes_of_one_key_are_refused(tmp_path: Path) -> None:
    """No number says which of the two counts."""
    run = make_run(tmp_path, [*drive("random", tossing("a")), *drive("random", tossing("b"), seeds=[0])])
    with pytest.raises(LedgerError, match="two different episodes"):
        score(run)


def test_a_folder_without_episodes_is_refused_by_name(tmp_path: Path) -> None:
    """Nothing is scored as 0."""
    with pytest.raises(LedgerError, match="does not exist"):
        score(tmp_path)
    with pytest.raises(LedgerError, match="no finished episode"):
        score(make_run(tmp_path / "run", []))


def test_the_papers_rows_stand_beside_ours(tmp_path: Path) -> None:
    """Relative differences, of crashes in points; STOP and SLOW lead together."""
    episodes = [*crashing("constant:STOP", "STOP", of=1), *crashing("constant:SLOW", "SLOW", of=1)]
    found = score(make_run(tmp_path, [*episodes, *crashing("constant:LEFT", "LEFT", of=28)]))
    slow, left = beside_paper(found.ladder)
    theirs = PUBLISHED["constant:SLOW"]["distance_m"]
    assert slow.differences["distance_m"] == pytest.approx((31 * 400 + 200) / 32 / theirs - 1)
    assert slow.apart == ("distance_m", "reward")
    assert left.differences["crash_rate"] == 0
    assert leads(found.ladder)["crash_rate"] == ["constant:STOP", "constant:SLOW"]
    assert unlike([slow, left]) == ""
    (few,) = beside_paper(score(make_run(tmp_path / "few", drive("constant:SLOW", always("SLOW"), seeds=[0]))).ladder)
    assert "the paper's rows have 32 episodes in four scenarios, these have 4" in unlike([few])


def test_a_seeing_driver_differs_from_itself_without_pictures_and_a_constant_does_not(tmp_path: Path) -> None:
    """The first significantly, the second not at all, and the sentences say so."""
    sees = [*drive("sees", by_depth), *crashing("sees", "STRAIGHT", of=32, condition="blank")]
    blind = [*drive("constant:SLOW", always("SLOW")), *drive("constant:SLOW", always("SLOW"), condition="blank")]
    first, second = score(make_run(tmp_path, [*sees, *blind])).blind
    assert (first.driver.policy, first.condition, first.finding) == ("sees", "blank", "differs")
    assert {"crash_rate", "success_rate", "distance_m", "reward"} <= set(first.paired.changed)
    assert "drives differently with real pictures than with blank ones in the same 32 worlds" in first.sentence
    assert "completes 32 of 32 with real pictures and 0 of 32 with blank ones" in first.sentence
    assert (second.finding, second.paired.changed) == ("identical", ())
    assert "the same to the last digit" in second.sentence
    assert "completing these worlds needs no picture, so completion says nothing about the camera" in second.sentence


def test_no_difference_comes_with_the_bound_that_the_data_allow(tmp_path: Path) -> None:
    """A coin tossed anew under blank pictures is not declared the same."""
    episodes = [*drive("random", tossing("a")), *drive("random", tossing("b"), condition="blank")]
    (found,) = score(make_run(tmp_path, episodes)).blind
    assert found.finding == "no_difference_found"
    assert "There may still be one: the data bound it" in found.sentence
    low, high = (100 * end for end in found.paired.differences["crash_rate"].ci or (0, 0))
    assert f"[{low:+.1f}, {high:+.1f}]" in found.sentence
    assert found.paired.differences["distance_m"].ci is None
    assert "without a bound: distance" in found.sentence


def test_few_worlds_cannot_say(tmp_path: Path) -> None:
    """With four worlds no exact test reaches .05, however much they differ."""
    episodes = [*drive("sees", by_depth, seeds=[0]), *drive("sees", always("LEFT"), condition="blank", seeds=[0])]
    (found,) = score(make_run(tmp_path, episodes)).blind
    assert found.finding == "cannot_say"
    assert "with 4 worlds no exact test can reach .05 after Holm over 5 tests" in found.sentence


def test_blank_pictures_show_only_whether_there_is_a_picture(tmp_path: Path) -> None:
    """Who brakes wherever there is any picture differs from blank, and not from another world's picture."""
    real, blank = drive("m", always("SLOW")), drive("m", always("LEFT"), condition="blank")
    (alone,) = score(make_run(tmp_path / "alone", [*real, *blank], models=["m"])).blind
    assert (alone.finding, alone.asks, alone.label.family) == ("differs", "whether there is a picture", "partly")
    assert "So its driving depends on whether there is a picture; the signs" in alone.sentence
    unasked = "Whether it depends on what the camera shows was not tested"
    assert unasked in alone.sentence
    same = drive("m", always("SLOW"), condition="shuffled")
    first, second = score(make_run(tmp_path / "both", [*real, *blank, *same], models=["m"])).blind
    assert "depends on whether there is a picture;" in first.sentence
    assert "what the camera shows" not in first.sentence, "the other comparison answers that"
    assert (second.finding, second.label.family) == ("identical", "blind")
    assert "In these worlds what the camera shows has no influence on how it drives." in second.sentence


@pytest.mark.parametrize("condition", sorted(set(OF_WORLDS) - {"real"}))
def test_each_condition_says_what_it_asks(tmp_path: Path, condition: str) -> None:
    """Of all that a world can show, only another world's picture tells what the camera shows."""
    real, other = drive("m", always("SLOW")), drive("m", always("LEFT"), condition=condition)
    (found,) = score(make_run(tmp_path / "run", [*real, *other], models=["m"])).blind
    assert found.finding == "differs"
    told = found.sentence.partition(" It completes")[0].partition(" Whether it depends")[0]
    assert ("depends on what the camera shows;" in told) == (condition == "shuffled")
    assert (f"depends on {found.asks};" in told) == (condition != "real_repeat")
    assert found.label.family == {"shuffled": "sees", "real_repeat": "open"}.get(condition, "partly")
    assert found.as_dict()["asks"] == found.asks
    (alike,) = score(
        make_run(tmp_path / "same", [*real, *drive("m", always("SLOW"), condition=condition)], models=["m"])
    ).blind
    assert ("the picture has no influence" in alike.sentence) == (condition in {"blank", "text_only", "noise"})
    assert ("repeats itself" in alike.sentence) == (condition == "real_repeat")


@pytest.mark.parametrize(("worlds", "finding"), [(7, "cannot_say"), (8, "differs")])
def test_the_worlds_that_are_needed_count_the_tests_of_the_family(tmp_path: Path, worlds: int, finding: str) -> None:
    """Seven worlds that all differ have p 1/64, five times over .05; eight are the fewest, and the sentence says so."""
    episodes = [*crashing("m", "SLOW", of=0), *crashing("m", "LEFT", of=32, condition="blank")]
    kept = [episode for episode in episodes if episode.key.scenario == "light" and episode.key.seed < worlds]
    (found,) = score(make_run(tmp_path / "run", kept, models=["m"])).blind
    assert (found.finding, found.paired.worlds) == (finding, worlds)
    assert ("8 worlds at least" in found.sentence) == (finding == "cannot_say")


@pytest.mark.parametrize(("mute", "finding"), [(1, "cannot_say"), (2, "cannot_say"), (3, "identical")])
def test_like_drives_by_the_fail_safe_are_no_evidence_of_blindness(tmp_path: Path, mute: int, finding: str) -> None:
    """Who decides nothing at half of the steps or more under both conditions is not told that no picture matters."""

    def seldom(_truth: Mapping[str, Scalar], step: int, _seed: int) -> str | None:
        return None if step % mute == 0 else "SLOW"

    episodes = [*drive("m", seldom), *drive("m", seldom, condition="blank")]
    (found,) = score(make_run(tmp_path / "run", episodes, models=["m"])).blind
    assert found.finding == finding
    assert ("no influence on how it drives" in found.sentence) == (finding == "identical")


def test_who_never_decides_without_pictures_is_not_compared_with_the_fail_safe(tmp_path: Path) -> None:
    """However much the drives differ: nothing of them is a decision."""
    episodes = [*drive("m", always("LEFT")), *drive("m", always(None), condition="blank")]
    (found,) = score(make_run(tmp_path / "run", episodes, models=["m"])).blind
    assert found.finding == "cannot_say"
    assert "with blank pictures it decides nothing at all" in found.sentence


@pytest.mark.parametrize(("condition", "needless"), [("blank", True), ("noise", True), ("mirrored", False)])
def test_completing_with_wrong_pictures_does_not_say_that_none_is_needed(
    tmp_path: Path, condition: str, *, needless: bool
) -> None:
    """Only pictures that show nothing of any world tell that."""
    episodes = [*drive("m", always("SLOW")), *drive("m", always("LEFT"), condition=condition)]
    (found,) = score(make_run(tmp_path / "run", episodes, models=["m"])).blind
    assert ("completing these worlds needs no picture" in found.sentence) == needless
    assert ("completion does not show that it reads what the camera shows correctly" in found.sentence) != needless


def test_a_time_out_is_a_success_only_where_there_is_no_goal(tmp_path: Path) -> None:
    """Once any episode of a scenario reaches a goal, lasting until the time is up is none."""
    time_out = drive("slow", always("SLOW"))
    assert score(make_run(tmp_path / "a", time_out)).ladder[0].statistics["success_rate"].value == 1
    goal = drive("fast", always("STRAIGHT"), ended="goal")
    found = {row.driver.policy: row for row in score(make_run(tmp_path / "b", [*time_out, *goal])).ladder}
    assert found["slow"].statistics["success_rate"].value == 0
    assert found["fast"].statistics["success_rate"].value == 1


def test_failed_calls_are_no_evidence_of_sight(tmp_path: Path) -> None:
    """Where calls failed under one condition the fail-safe drove, and nothing is said of the picture."""
    real = drive("m", always(None))
    blank = drive("m", always("LEFT"), condition="blank")
    failed = [
        replace(episode, steps=tuple(replace(step, decision=Decision(None, "error")) for step in episode.steps))
        for episode in real
    ]
    run = make_run(tmp_path / "run", [*failed, *blank], models=["m"])
    (found,) = score(run).blind
    assert found.finding == "cannot_say"
    assert "calls failed, 100% of them with real pictures" in found.sentence


def test_the_same_drive_by_the_fail_safe_is_not_the_same_decision(tmp_path: Path) -> None:
    """A model that refuses blank pictures and says SLOW otherwise is not told to ignore its picture."""
    real, blank = drive("m", always("SLOW")), drive("m", always(None), condition="blank")
    (found,) = score(make_run(tmp_path / "run", [*real, *blank], models=["m"])).blind
    assert found.finding == "cannot_say"
    assert "the drives are the same, but not the decisions" in found.sentence
