"""The audit on synthetic drives whose answer is known: who decides, who varies, who converges, and what is a cache."""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from drives import add_replies, always, by_depth, drive, make_run, tossing
from eyechart.calls import Reply
from eyechart.cli.app import app
from eyechart.episodes import Episode, Step
from eyechart.frames import Scalar
from eyechart.studies.closed_loop import score
from eyechart.studies.closed_loop.audit import GAP_ALONE, GAP_AND_SIDE
from eyechart.studies.closed_loop.browser import drives_data
from eyechart.studies.closed_loop.film import lines
from eyechart.studies.closed_loop.page import drives_figures
from eyechart.studies.closed_loop.tables import degeneracy_table, paper_tables


def test_a_depth_reader_follows_the_scene_and_a_coin_does_not(tmp_path: Path) -> None:
    """The coin has the higher entropy and the lower information: varying is not deciding."""
    reader, coin = score(make_run(tmp_path, [*drive("reader", by_depth), *drive("coin", tossing("c"))])).audit
    assert reader.label == "follows the scene"
    assert (reader.holm or 1) < 0.01
    assert (reader.statistics["information_share"].value or 0) > 0.4
    assert coin.label == "varies, no link found"
    assert (coin.statistics["entropy_bits"].value or 0) > 2.2 > (reader.statistics["entropy_bits"].value or 9)
    assert (coin.statistics["information_share"].value or 1) < 0.03
    assert reader.geometry == GAP_ALONE


def test_a_follower_of_the_clock_passes_the_papers_test_and_not_the_episode_safe_one(tmp_path: Path) -> None:
    """Where gaps fall with time in every episode alike, the step tells the gap, and nobody has to look."""

    def falling(_truth: Mapping[str, Scalar], step: int, _seed: int) -> str:
        return "STRAIGHT" if step < 10 else "SLOW"

    episodes = [
        Episode(
            one.key,
            tuple(_at(step, gap=50 - 2 * step.step + one.key.seed % 3) for step in one.steps),
            one.ended,
            one.state_sha256,
        )
        for one in drive("clock", falling)
    ]
    (row,) = score(make_run(tmp_path, episodes)).audit
    assert (row.holm_naive or 1) < 0.001
    assert (row.holm or 0) > 0.5


def _at(step: Step, *, gap: float) -> Step:
    return Step(
        step.step,
        step.frame,
        step.decision,
        step.executed_action,
        {**step.truth, "lead_gap_m": float(gap)},
        step.reward,
        step.speed_mps,
        step.distance_m,
        step.crashed,
    )


def test_a_constant_is_called_so_and_holm_leaves_it_out(tmp_path: Path) -> None:
    """From a modal share of .98 on; it has no test in the family, and a third of no decisions is told apart."""

    def nearly(_truth: Mapping[str, Scalar], step: int, _seed: int) -> str | None:
        return None if step % 3 == 0 else "SLOW"

    alone = score(make_run(tmp_path / "a", drive("reader", by_depth))).audit[0]
    rows = score(make_run(tmp_path / "b", [*drive("reader", by_depth), *drive("nearly", nearly)])).audit
    assert rows[1].is_constant
    assert rows[1].label == "constant"
    assert rows[1].statistics["unparsed_rate"].value == pytest.approx(7 / 20)
    assert rows[1].reasons == {"unparsed": 224}
    assert rows[1].statistics["information_share"].value is None
    assert rows[1].holm is None
    assert rows[0].holm == pytest.approx(alone.holm)


def test_the_audit_and_the_papers_table_tell_one_p(tmp_path: Path) -> None:
    """Beside constants and models that saw no pictures: no cells of Table t:degeneracy."""
    blind = drive("blind", tossing("b"))
    blind = [replace(one, key=replace(one.key, condition="blank")) for one in blind]
    models = {"reader": by_depth, "coin": tossing("c"), "slow": always("SLOW"), "left": always("LEFT")}
    drives = [*(one for name, how in models.items() for one in drive(name, how)), *blind]
    run = make_run(tmp_path, drives, models=[*models, "blind"])
    found = score(run)
    (told,) = (paper_table for paper_table in paper_tables(found) if paper_table.label == "t:degeneracy")
    mine = {row[1]: row[-2:] for row in told.rows}
    alone = {row.driver.policy: row for row in found.audit}
    place = [column.name for column in degeneracy_table(found.audit).columns].index("p (paper)")
    rows = zip(found.audit, degeneracy_table(found.audit).rows, strict=True)
    printed = {row.driver.policy: cells[place : place + 2] for row, cells in rows}
    assert set(mine) == set(models)
    assert {name: printed[name] for name in models} == mine
    assert mine["slow"] == (None, None)
    ps = sorted(alone[name].statistics["information_bits"].p or 0 for name in ("reader", "coin"))
    assert min(one for one, _ in mine.values() if one is not None) == pytest.approx(2 * ps[0])


def test_a_forward_camera_is_audited_by_gap_and_side(tmp_path: Path) -> None:
    """Who steers away from the nearest obstacle and ignores its distance is found, and the row says by what."""

    def steering(truth: Mapping[str, Scalar], _step: int, _seed: int) -> str:
        return {"left": "RIGHT", "right": "LEFT"}.get(str(truth["nearest_side"]), "SLOW")

    rover = drive("steering", steering, simulator="highway", forward=True)
    (row,) = score(make_run(tmp_path / "a", rover)).audit
    assert row.geometry == GAP_AND_SIDE
    assert row.label == "follows the scene"
    flat = drive("steering", lambda _truth, step, seed: steering({"nearest_side": "left"}, step, seed))
    assert score(make_run(tmp_path / "b", flat)).audit[0].geometry == GAP_ALONE


def test_episodes_of_different_lengths_are_cut_and_not_thrown_away(tmp_path: Path) -> None:
    """Some crash early; the rest of their scenario still is exchanged, and the note counts what is left out."""
    whole, short = drive("reader", by_depth), drive("reader", by_depth, steps=5, ended="crash")
    episodes = [short[place] if place % 8 < 3 else one for place, one in enumerate(whole)]
    safe = score(make_run(tmp_path, episodes)).audit[0].statistics["information_episode_safe"]
    assert (safe.p or 1) < 0.01
    assert safe.n == 20 * 20
    assert "60 of 460 steps are left out" in safe.note


def test_two_constants_converge(tmp_path: Path) -> None:
    """Two models that always say one action drive alike to the last digit: a genuine convergence, said in words."""
    episodes = [*drive("model-a", always("STRAIGHT")), *drive("model-b", always("STRAIGHT"))]
    (found,) = score(make_run(tmp_path, episodes, models=["model-a", "model-b"])).twins
    assert (found.kind, found.same, found.worlds) == ("constant policies converge", 32, 32)
    assert "always" not in found.kind
    assert "all of them take STRAIGHT and nothing else" in found.words


def test_the_fail_safe_is_credited_to_no_model(tmp_path: Path) -> None:
    """Who answers nothing drives as the constant SLOW does, and takes no action; nearly always is not nothing else."""
    episodes = [*drive("mute", always(None)), *drive("constant:SLOW", always("SLOW"))]
    (found,) = score(make_run(tmp_path / "a", episodes, models=["mute"])).twins
    assert found.kind == "no decision: the fail-safe drove"
    assert "there is no decision of mute at 100% of the steps" in found.words

    def nearly(_truth: Mapping[str, Scalar], step: int, seed: int) -> str | None:
        return "LEFT" if (step, seed) == (0, 0) else None if step == 1 else "SLOW"

    (twins,) = score(make_run(tmp_path / "b", [*drive("m", nearly), *drive("n", nearly)], models=["m", "n"])).twins
    assert "all of them take SLOW at 98% of the steps at least" in twins.words
    assert "At 5% of them m decides nothing, and SLOW comes from the fail-safe" in twins.words


def test_other_words_for_one_command_are_aliases(tmp_path: Path) -> None:
    """STOP and SLOW are one command in the highway, which the simulator itself declares."""
    episodes = [*drive("one", always("STOP")), *drive("other", always("SLOW"))]
    (found,) = score(make_run(tmp_path, episodes)).twins
    assert found.kind == "aliased commands"
    assert "SLOW and STOP both are SLOWER" in found.words


def test_other_actions_with_one_drive_are_not_called_aliases(tmp_path: Path) -> None:
    """Where nothing is declared, actions without effect are what was seen."""
    right = drive("right", always("RIGHT"))
    left = [
        Episode(mine.key, mine.steps, mine.ended, theirs.state_sha256)
        for mine, theirs in zip(drive("left", always("LEFT")), right, strict=True)
    ]
    (found,) = score(make_run(tmp_path / "a", [*right, *left])).twins
    assert found.kind == "other actions, same drive"


def test_what_a_simulator_does_not_tell_is_a_dash_everywhere(tmp_path: Path) -> None:
    """No speed, no distance and no gap: neither a zero in a table, nor a difference, nor a link to a scene."""
    run = make_run(tmp_path / "run", [_untold(one) for one in (*drive("a", by_depth), *drive("b", tossing("x")))])
    scored = score(run, against_policy="b")
    for rung in scored.ladder:
        told = {name: rung.statistics[name].value is not None for name in ("distance_m", "reward", "speed_mps")}
        assert told == {"distance_m": False, "reward": True, "speed_mps": False}
        assert rung.statistics["speed_mps"].note == "the simulator does not tell it"
    (pair,) = scored.paired
    assert (pair.differences["distance_m"].value, pair.holm["distance_m"]) == (None, None)
    assert pair.differences["reward"].p is not None
    assert {(row.label, row.geometry) for row in scored.audit} == {("cannot say", "")}
    drives = scored.drives[0]
    assert {line.state for line in lines(drives, drives.episodes[0])[:-1]} == {"gap — · then — m/s"}
    printed = " ".join(CliRunner().invoke(app, ["score", str(run)]).stdout.split())
    assert " 0.0 " not in printed.partition("Policy degeneracy audit")[0]
    browser = json.loads(json.dumps(drives_data(scored, pictured=0).data["episodes"][0]))  # type: ignore[index]
    assert (browser["distance"], {step[4] for step in browser["steps"]}) == (None, {None})
    assert drives_figures(scored)["ladder"]


def _untold(one: Episode) -> Episode:
    steps = (replace(step, speed_mps=None, distance_m=None, truth=dict.fromkeys(step.truth)) for step in one.steps)
    return replace(one, steps=tuple(steps))


def test_a_run_is_scored_where_its_simulator_is_not(tmp_path: Path) -> None:
    """What is not installed here declares nothing, and everything else is computed."""
    away = "gym:Elsewhere-v9"
    episodes = [
        one
        for policy, action in (("one", "STOP"), ("other", "SLOW"))
        for one in drive(policy, always(action), simulator=away)
    ]
    (found,) = score(make_run(tmp_path, episodes, simulator=away)).twins
    assert (found.kind, found.same) == ("other actions, same drive", 32)


def cached(step: Step, number: int) -> Reply:
    """Reply as a model that takes a while the first time, and as a cache the second."""
    return Reply(f"I see the road. {step.executed_action}", "stop", seconds=1.5 if number < 640 else 0.002)


def test_a_planted_cache_is_suspect(tmp_path: Path) -> None:
    """A coin that is tossed alike in two models, word for word and in no time, was tossed once."""
    episodes = [*drive("model-a", tossing("x")), *drive("model-b", tossing("x"))]
    run = make_run(tmp_path, episodes, models=["model-a", "model-b"])
    add_replies(run, episodes, cached, lambda step: step.frame)
    scored = score(run)
    (found,) = scored.twins
    assert (found.kind, found.same, scored.is_suspect) == ("suspect caching", 32, True)
    assert "640 of 640 replies are word for word the same" in found.words
    assert "the median reply took 0.002 s against 1.5 s" in found.words


def test_like_minds_are_no_cache(tmp_path: Path) -> None:
    """Two readers of the same gaps decide alike, each in words of its own; and a few short drives agree by chance."""
    episodes = [*drive("model-a", by_depth), *drive("model-b", by_depth)]
    run = make_run(tmp_path / "a", episodes, models=["model-a", "model-b"])
    add_replies(run, episodes, lambda _step, n: Reply(f"in my words, {n // 640}", "stop"), lambda step: step.frame)
    assert [twin.kind for twin in score(run).twins] == ["decide alike here and there"]
    few = [*drive("model-b", tossing("x"), seeds=[0]), *drive("model-b", tossing("y"), seeds=range(1, 8))]
    some = make_run(tmp_path / "b", [*drive("model-a", tossing("x")), *few], models=["model-a", "model-b"])
    (found,) = score(some).twins
    assert (found.kind, found.same) == ("decide alike here and there", 4)


def test_a_cache_inside_one_model_shows_in_its_repeated_requests(tmp_path: Path) -> None:
    """The same request answered again with the same words in a thousandth of the time; a slow model is no cache."""
    episodes = drive("model", tossing("x"))

    def reply(_step: Step, number: int) -> Reply:
        return Reply(f"roll {number % 20}", "stop", seconds=1.0 if number < 20 else 0.001)

    fast = make_run(tmp_path / "fast", episodes, models=["model"])
    add_replies(fast, episodes, reply, lambda step: f"picture {step.step}")
    assert [repeat.suspect for repeat in score(fast).repeats] == [True]
    slow = make_run(tmp_path / "slow", episodes, models=["model"])
    add_replies(
        slow, episodes, lambda _step, n: Reply(f"roll {n % 20}", "stop", seconds=1.0), lambda s: f"picture {s.step}"
    )
    assert [repeat.suspect for repeat in score(slow).repeats] == [False]


@pytest.mark.parametrize(("seconds", "suspect"), [(0.101, True), (0.099, False)])
def test_a_model_that_is_quick_by_itself_is_no_cache(tmp_path: Path, seconds: float, suspect: bool) -> None:  # noqa: FBT001
    """Below a tenth of a second for a first reply its repeats may take a hundredth of that, and tell nothing."""
    episodes = drive("model", tossing("x"))
    run = make_run(tmp_path / "run", episodes, models=["model"])

    def reply(_step: Step, number: int) -> Reply:
        return Reply(f"roll {number % 20}", "stop", seconds=seconds if number < 20 else seconds / 100)

    add_replies(run, episodes, reply, lambda step: f"picture {step.step}")
    assert [repeat.suspect for repeat in score(run).repeats] == [suspect]


def test_what_needs_no_cache_is_not_suspected(tmp_path: Path) -> None:
    """A policy without a model, and one model that repeats itself in a second run at the same pace."""
    scripted = [*drive("oracle", by_depth), *drive("oracle", by_depth, condition="blank")]
    assert [twin.kind for twin in score(make_run(tmp_path / "s", scripted)).twins] == ["repeats itself"]
    runs = []
    for name in ("first", "second"):
        episodes = drive("model", by_depth)
        runs.append(make_run(tmp_path / name, episodes, models=["model"]))
        add_replies(runs[-1], episodes, lambda _step, _n: Reply("x", "stop", seconds=1.0), lambda step: step.frame)
    found = score(runs)
    assert [twin.kind for twin in found.twins] == ["repeats itself"]
    assert [row.driver.label for row in found.ladder] == ["first · model", "second · model"]
    assert not found.is_suspect


@pytest.mark.parametrize(("seconds", "kind"), [(0.09, "repeats itself"), (1.0, "suspect caching")])
def test_a_quick_model_that_repeats_itself_at_another_pace_is_no_cache(
    tmp_path: Path, seconds: float, kind: str
) -> None:
    """Below a tenth of a second its times tell nothing; above, the words are of one model and not of two."""
    runs = []
    for name, took in (("whole", seconds), ("cut", seconds / 20)):
        episodes = drive("model", by_depth)
        runs.append(make_run(tmp_path / name, episodes, models=["model"]))
        reply = Reply("x", "stop", seconds=took)
        add_replies(runs[-1], episodes, lambda _step, _n, reply=reply: reply, lambda step: step.frame)  # type: ignore[misc]
    (found,) = score(runs).twins
    assert found.kind == kind
    assert "Two models" not in found.words


def test_numbers_of_several_simulators_are_printed_whole(tmp_path: Path) -> None:
    """A long name is folded before a number beside it is cut."""
    name = "python:some_package.with_a_long_name:and_a_function_that_is_long_as_well_and_goes_on"
    runs = [make_run(tmp_path / at, drive(name, by_depth, simulator=at), simulator=at) for at in ("highway", "rover")]
    printed = CliRunner().invoke(app, ["audit", *map(str, runs)]).stdout
    assert "…" not in printed
    assert "follows the scene" in printed


def test_replay_tells_agreement_from_the_marginal(tmp_path: Path) -> None:
    """A follower of the controller agrees more often than its own decisions in random order; a coin does not."""
    episodes = [*drive("reader", by_depth), *drive("coin", tossing("c")), *drive("straight", always("STRAIGHT"))]
    found = {
        (replay.driver.policy, replay.controller): replay for replay in score(make_run(tmp_path, episodes)).replays
    }
    reader, coin, straight = (found[name, "demand"] for name in ("reader", "coin", "straight"))
    assert (reader.agreement.value or 0) > (reader.shuffled.ci or (1, 1))[1]
    assert reader.shuffled.p == 1 / 5001  # the paper's number of permutations
    assert (coin.shuffled.p or 0) > 0.05
    assert straight.agreement.value == straight.constants["STRAIGHT"].value
    assert straight.agreement.value == pytest.approx(straight.shuffled.value)
    assert set(reader.constants) == {"STOP", "SLOW", "STRAIGHT", "LEFT", "RIGHT"}
    assert ("reader", "oracle") in found


def test_one_model_that_decides_alike_under_two_conditions_is_no_cache(tmp_path: Path) -> None:
    """A mirror changes no distance: who brakes by distance drives the same, and rightly so."""
    episodes = [*drive("m", by_depth), *drive("m", by_depth, condition="mirrored")]
    scored = score(make_run(tmp_path / "run", episodes, models=["m"]))
    (found,) = scored.twins
    assert not scored.is_suspect
    assert "makes the same decisions with real and mirrored pictures" in found.words
