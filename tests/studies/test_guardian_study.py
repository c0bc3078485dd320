"""The guardian: chosen, frozen, scored on what it never saw; and the paper's table to its printed digits."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

import published_votes
import roads
from banks import build_bank
from eyechart import __version__
from eyechart.errors import GuardianError, VoteError
from eyechart.frames import open_bank
from eyechart.guardian.page import bound_lines, replay_lines
from eyechart.modes import RequestMode
from eyechart.prompts import PROMPTS
from eyechart.spaces.scene import Scene, safe_action
from eyechart.stats.committee_votes import Costs
from eyechart.studies import guardian as study
from eyechart.studies.guardian.modular import modular_action
from eyechart.studies.guardian.scores import answer_of
from published_votes import GEMMA, QWEN, published

QUICK = 0
"""Multisets to enumerate: none, so that intervals are drawn, which is what tests of other things have time for."""


@pytest.fixture(scope="module")
def table() -> study.VoteTable:
    """Return the votes with the paper's counts."""
    return published()


@pytest.fixture(scope="module")
def frozen(table: study.VoteTable) -> study.FrozenGuardian:
    """Return the guardian that the 16 calibration frames choose."""
    return study.fit(table.part("calibration"))


def test_the_papers_table_to_its_digits(table: study.VoteTable, frozen: study.FrozenGuardian) -> None:
    """Table t:positive-guardian, the choice behind it, McNemar, and intervals over all multisets of 12 episodes."""
    assert (frozen.committee, frozen.threshold, frozen.point) == ((GEMMA, QWEN), 2, "two_way")
    assert frozen.selection is not None
    assert (frozen.selection.single, frozen.selection.candidates) == (GEMMA, 60)
    scored = study.score(frozen, table.part("score"))
    printed = {name: [f"{row[key].value:.3f}" for key in row] for name, row in scored.rows.items()}
    assert printed == {
        "single": ["1.000", "0.842", "0.869", "0.821", "0.917"],
        "two_way": ["1.000", "0.956", "0.954", "0.958", "0.950"],
        "abstain": ["0.824", "0.960", "0.973", "0.946", "1.000"],
        "unanimous": ["0.647", "0.994", "0.996", "0.992", "1.000"],
    }
    assert scored.mcnemar.p == pytest.approx(3.35e-7, abs=5e-10)
    assert scored.mcnemar.as_dict()["detail"] == {"b": 35, "c": 4}
    votes, held_out = table.part("score").of(frozen.committee), table.part("score")
    two_way = ((votes == 1).sum(axis=(0, 2)) >= 2) == held_out.hazard
    single = (held_out.of([GEMMA])[0, :, 0] == 1) == held_out.hazard
    gains = [
        sum((two_way * 1 - single * 1)[np.array(held_out.episodes) == episode]) for episode in set(held_out.episodes)
    ]
    flipped = [abs(np.dot(signs, gains)) >= abs(sum(gains)) for signs in product((-1, 1), repeat=12)]
    assert scored.over_episodes.p == pytest.approx(np.mean(flipped))
    assert [(one.answered, one.wrong) for one in scored.curve] == [(176, 1), (224, 9), (272, 12)]
    assert len(scored.missed) == 9
    balanced = scored.rows["two_way"]["bal"]
    assert "means of their ends" in balanced.method
    assert balanced.ci is not None
    assert balanced.ci[0] < 0.954 < balanced.ci[1]
    assert scored.warnings[0].startswith("12 of 12 scored episodes also gave frames that chose the guardian")


def test_the_papers_nested_number(table: study.VoteTable) -> None:
    """.951 pooled over 288 frames, the same pair and threshold in 12 of 12 folds."""
    found = study.nested(table)
    assert found.agreed == 12
    assert set(found.folds.values()) == {((GEMMA, QWEN), 2, "two_way")}
    assert f"{found.pooled['bal'].value:.3f}" == "0.951"
    assert found.frames == 288


def test_nested_takes_two_episodes_costs_and_a_seed(table: study.VoteTable) -> None:
    """Two episodes are enough and one is not; costs move the thresholds of folds, a seed what is drawn of intervals."""
    halves = replace(table, episodes=tuple(f"e{number % 2}" for number in range(len(table.frames))))
    assert set(study.nested(halves).folds) == {"e0", "e1"}
    with pytest.raises(GuardianError, match=r"votes\.csv: all frames are of one episode; leaving one out needs two"):
        study.nested(replace(table, episodes=("e0",) * len(table.frames)))
    parted = replace(table, episodes=tuple("yes" if one else "no" for one in table.hazard))
    with pytest.raises(GuardianError, match=r"votes\.csv: without one of its episodes a class is empty"):
        study.nested(parted)
    missed, alarmed = (study.nested(halves, costs=costs) for costs in (Costs(50, 1), Costs(1, 50)))
    assert all(missed.folds[fold][1] < alarmed.folds[fold][1] for fold in missed.folds)
    assert study.nested(table).as_dict() == study.nested(table).as_dict()


def test_what_a_guardian_remembers_of_its_votes_is_read_back(frozen: study.FrozenGuardian, tmp_path: Path) -> None:
    """Prompt, axis, reader, way of voting, and of each model its version, what served it and its mode all come back."""
    models = frozen.about.versions
    told = replace(
        frozen.about,
        wording=PROMPTS["baseline"],
        axis="horizontal",
        served={name: f"{name} as served" for name in models},
        modes={name: RequestMode(name, temperature=0.5, max_tokens=77) for name in models},
        voting=1,
    )
    path = tmp_path / "g.json"
    study.write_frozen(path, replace(frozen, about=told))
    assert study.read_frozen(path).about == told


def test_selection_is_inside_every_fold(table: study.VoteTable) -> None:
    """What fails in one episode only is chosen without that episode, although another model is better on all."""
    names, group = table.groups()
    votes = np.ones_like(table.votes)
    votes[0] = np.where(group == 3, ~table.hazard, table.hazard)[:, None]
    votes[1] = table.hazard[:, None]
    wrong = np.flatnonzero((group != 3) & table.hazard)[:2]
    votes[1, wrong] = 0
    found = study.nested(replace(table, votes=votes), size=1)
    assert {episode: chosen[0] for episode, chosen in found.folds.items()} == {
        episode: (table.models[0 if episode == names[3] else 1],) for episode in names
    }
    assert found.pooled["acc"].value == pytest.approx(1 - (np.sum(group == 3) + 2) / 288)


def test_a_calibration_frame_is_never_scored(table: study.VoteTable, frozen: study.FrozenGuardian) -> None:
    """Not one of them; leaving them out is explicit."""
    with pytest.raises(GuardianError, match=r"frame 'f272' is one of 16 in votes\.csv that chose this guardian"):
        study.score(frozen, table)
    one = table.keep((*table.part("score").frames, "f280"))
    for refused in (study.score, study.bound):
        with pytest.raises(GuardianError, match="frame 'f280' is one of 1 "):
            refused(frozen, one)
    with pytest.raises(GuardianError, match="frame 'f280'"):
        study.replay(frozen, one, lambda _: None)
    assert frozen.selection is not None
    assert len(table.without(frozen.selection.frames).frames) == 272


def test_a_guardian_remembers_by_which_rule_its_ties_were_broken(frozen: study.FrozenGuardian, tmp_path: Path) -> None:
    """One of version 0.1.0 keeps the rule that chose it, and a rule that no version has is refused."""
    older = (
        "first committee in lexicographic order, then lowest threshold, then two_way before abstain before unanimous"
    )
    for rule, read in ((older, True), ("whatever pleases", False)):
        told = json.loads(json.dumps(frozen.as_dict()))
        del told["digest"]
        told["selection"]["tie_breaks"] = rule
        told["digest"] = hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()
        (tmp_path / "g.json").write_text(json.dumps(told), encoding="utf-8")
        if read:
            assert json.loads(json.dumps(study.read_frozen(tmp_path / "g.json").as_dict())) == told
        else:
            with pytest.raises(GuardianError, match="its rule for ties is unknown to this eyechart"):
                study.read_frozen(tmp_path / "g.json")


def test_a_member_that_votes_no_hazard_is_warned_of(table: study.VoteTable) -> None:
    """It is in a committee only where nobody else is as good, and the score says what it is worth there."""
    votes = table.votes.copy()
    votes[table.models.index(QWEN)] = 0
    mute = replace(table, votes=votes)
    frozen = study.fit(mute.part("calibration"), models=(GEMMA, QWEN))
    scored = study.score(frozen, mute.part("score"), resamples=10)
    assert f"{QWEN} votes hazard on none of the 272 frames: it adds nothing to a committee" in scored.warnings


@pytest.mark.parametrize(
    ("old", "new"),
    [('"threshold": 2', '"threshold": 1'), ('   "f280",\n', ""), ('"two_way"', '"abstain"'), ("digest-1", "digest-2")],
)
def test_an_edited_guardian_is_refused(frozen: study.FrozenGuardian, tmp_path: Path, old: str, new: str) -> None:
    """Its threshold, a frame that it saw, its operating point, a model's digest."""
    path = tmp_path / "guardian.json"
    study.write_frozen(path, frozen)
    assert study.read_frozen(path) == frozen
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(GuardianError, match="was edited after it was frozen"):
        study.read_frozen(path)


REDIGESTED: Mapping[str, tuple[dict[str, object], str]] = {
    "threshold": ({"threshold": 99}, "its threshold is 99, and no whole number from 1 to its 4 votes"),
    "no number": ({"threshold": 2.0}, "threshold is 2.0, not a whole number"),
    "views": ({"views": ["original"]}, "its views are not original and reflected"),
    "kind": ({"models": 7}, "models is 7, not an object"),
    "infinite": ({"threshold": 10**400}, "is no guardian that this eyechart can read: .*whole number"),
    "format": ({"format": []}, "is no guardian; 'eyechart guardian fit' writes one"),
    "axis": ({"mirror_axis": []}, r"mirror_axis is \[\], not "),
    "selection": ({"selection": []}, r"selection is \[\], not an object"),
    "more": ({"note": 1}, f"not as eyechart {__version__} writes a guardian, though its digest is its own: note"),
    "older": ({"note": 1, "eyechart": "0.0.9"}, f"written by eyechart 0.0.9, .* this one, {__version__}, cannot read"),
}


STRANGE: Mapping[str, tuple[dict[str, object], str]] = {
    "worth": ({"worth": 7.0}, "its worth on the frames that chose it is 7, which is impossible"),
    "less than nothing": ({"worth": -0.5}, "its worth on the frames"),
    "candidates": ({"candidates": 0}, "candidates is 0"),
    "no frames": ({"frames": []}, "the frames that chose it are missing"),
    "no episodes": ({"episodes": []}, "episodes"),
    "forgotten pictures": ({"pictures": ["a"]}, "it remembers 1 pictures of 16 frames"),
    "another single": ({"best_single_model": "nobody"}, "its best single model is none of its models: nobody"),
    "costs": (
        {"costs": {"miss": -1.0, "false_alarm": 1.0, "abstention": None, "hazard_rate": None}},
        "costs must be 0",
    ),
    "dear costs": (
        {"costs": {"miss": 1e308, "false_alarm": 1.0, "abstention": None, "hazard_rate": None}},
        "costs must be 0 or more, up to 1e\\+30",
    ),
}


@pytest.mark.parametrize("what", STRANGE)
def test_a_selection_that_cannot_have_been_is_refused(frozen: study.FrozenGuardian, tmp_path: Path, what: str) -> None:
    """Numbers that no choice has, and a memory of frames with gaps, through which a frame would be scored again."""
    change, words = STRANGE[what]
    raw = frozen.as_dict()
    raw["selection"] = {**raw["selection"], **change}  # type: ignore[dict-item]
    del raw["digest"]
    raw["digest"] = hashlib.sha256(json.dumps(raw, sort_keys=True).encode()).hexdigest()
    path = tmp_path / "guardian.json"
    path.write_text(json.dumps(raw), encoding="utf-8")
    with pytest.raises(GuardianError, match=words):
        study.read_frozen(path)


@pytest.mark.parametrize("what", REDIGESTED)
def test_a_guardian_that_was_edited_with_its_digest_is_refused_in_words(
    frozen: study.FrozenGuardian, tmp_path: Path, what: str
) -> None:
    """What is wrong, and not how Python would write it; another version is blamed only where it is another."""
    change, words = REDIGESTED[what]
    raw = {**frozen.as_dict(), **change}
    del raw["digest"]
    raw["digest"] = hashlib.sha256(json.dumps(raw, sort_keys=True).encode()).hexdigest()
    path = tmp_path / "guardian.json"
    path.write_text(json.dumps(raw), encoding="utf-8")
    with pytest.raises(GuardianError, match=words) as refused:
        study.read_frozen(path)
    assert "Error(" not in str(refused.value)


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"format": "eyechart-guardian/9"}', "{" * 10_000])
def test_what_is_no_guardian_is_said_to_be_none(tmp_path: Path, text: str) -> None:
    """In one line, whatever the file holds."""
    path = tmp_path / "guardian.json"
    path.write_text(text)
    with pytest.raises(GuardianError, match="is no guardian"):
        study.read_frozen(path)


def test_an_export_holds_what_a_stack_needs_and_nothing_else(
    table: study.VoteTable, frozen: study.FrozenGuardian, tmp_path: Path
) -> None:
    """No frame, no episode, no score; it reads back, names what it was made of, and cannot score."""
    path = tmp_path / "stack.json"
    study.write_frozen(path, frozen.exported())
    said = json.loads(path.read_text(encoding="utf-8"))
    how = "committee views threshold operating_point models prompt view mirror_axis reader bank"
    assert set(said) == {"format", *how.split(), "chosen_as", "eyechart", "digest"}
    assert said["chosen_as"] == frozen.digest
    back = study.read_frozen(path)
    assert back.exported() == back == frozen.exported()
    with pytest.raises(GuardianError, match="exported guardian does not hold the frames"):
        study.score(back, table.part("score"))


def test_costs_move_the_operating_point(table: study.VoteTable) -> None:
    """Dear misses lower the threshold, dear false alarms raise it, and cheap abstention splits no hairs."""
    whole = table.without(())
    misses, alarms = (study.fit(whole, costs=costs).threshold for costs in (Costs(50, 1), Costs(1, 50)))
    assert misses < alarms
    handed_on = study.fit(whole, costs=Costs(50, 50, 0.01))
    assert handed_on.point == "unanimous"
    assert handed_on.selection is not None
    assert handed_on.selection.rule == "lowest expected cost of a frame on the calibration frames"
    with pytest.raises(GuardianError, match="the costs choose the operating point"):
        study.fit(whole, costs=Costs(1, 1, 1), point="abstain")


def test_the_bound_comes_from_episodes_that_served_for_nothing_else(table: study.VoteTable) -> None:
    """Its number of episodes, what one percent would need, and its scope are said; other episodes are refused."""
    calibration = table.of_episodes(("e00", "e01", "e02", "e03"))
    frozen = study.fit(calibration)
    scored, fresh = table.of_episodes(("e04", "e05")), table.of_episodes([f"e{n:02}" for n in range(6, 12)])
    found = study.bound(frozen, fresh, used=scored.episodes)
    assert found.episodes == 6
    assert found.rate.value is not None
    assert found.rate.ci is not None
    assert 0 < found.rate.value < found.rate.ci[1] <= 1
    missed = fresh.hazard & (answer_of(frozen, fresh)["two_way"] == 0)
    assert (found.frame_rate.value, found.frame_rate.n) == (missed.sum() / fresh.hazard.sum(), fresh.hazard.sum())
    told, lines = found.as_dict(), list(bound_lines(found))
    for place, (name, words) in enumerate(study.ESTIMANDS.items()):
        assert words in lines[place], "every line says of what it is a bound"
        assert name == "conformal" or told[name]["estimand"] == words
    assert told["conformal_estimand"] == study.ESTIMANDS["conformal"]
    assert f"from {fresh.hazard.sum()} hazardous frames of 6 episodes, none of more than 24 frames" in lines[1]
    assert found.needed_at_best == 299 <= found.needed
    assert found.scope.startswith("valid only for episodes exchangeable with those of bank paper")
    assert len(found.conformal) == 4
    with pytest.raises(GuardianError, match="episode 'e04' is scored"):
        study.bound(frozen, scored, used=scored.episodes)
    with pytest.raises(GuardianError, match="episode 'e00' chose this guardian"):
        study.bound(study.fit(table.part("calibration")), table.part("score"))


def test_what_was_handed_on_is_no_miss(table: study.VoteTable) -> None:
    """At the abstaining point a split counts in coverage, never as clear; with every vote missing nothing is missed."""
    frozen = study.fit(table.part("calibration"), point="abstain")
    silent = replace(table.part("score"), votes=np.full((6, 272, 2), -1, dtype=np.int8))
    scored = study.score(frozen, silent)
    assert set(scored.answers.values()) == {"abstain"}
    assert scored.rows["two_way"]["coverage"].value == 0
    assert scored.rows["two_way"]["bal"].value is None
    assert (scored.missed, scored.incomplete) == ((), 272)


def scenes(gap_m: float | None, *, left: bool, right: bool) -> tuple[Scene, Scene]:
    """Return what the deterministic reader sees in a picture and in its reflection."""
    scene = Scene(gap_m, left, right)
    return scene, scene.mirrored()


def test_a_replay_is_equivariant_and_the_reader_keeps_collision_and_sides(
    table: study.VoteTable, frozen: study.FrozenGuardian
) -> None:
    """The guardian brakes; STOP and the side are the reader's, whatever the votes say."""
    held_out = table.part("score")
    gaps = (8.0, 15.0, 30.0, None)
    seen = {
        frame: scenes(gaps[place % 4], left=bool(place & 4), right=bool(place & 8))
        for place, frame in enumerate(held_out.frames)
    }
    found = study.replay(frozen, held_out, seen.get)
    assert found.equivariance.value == 1.0
    scored = study.score(frozen, held_out)
    for frame, action in found.actions.items():
        scene, answer = seen[frame][0], scored.answers[frame]
        if scene.gap_m == 8.0:
            assert action == "STOP"
        elif answer == "clear":
            assert action == "STRAIGHT"
        elif scene.left_clear != scene.right_clear:
            assert action == ("LEFT" if scene.left_clear else "RIGHT")
        else:
            assert action == "SLOW"
    agreed = sum(action == safe_action(seen[frame][0]) for frame, action in found.actions.items())
    assert found.agreement.value == agreed / 272
    truth = dict(zip(held_out.frames, held_out.hazard, strict=True))
    perfect = replace(held_out, votes=np.broadcast_to(held_out.hazard[None, :, None], held_out.votes.shape) * 1)
    best = study.replay(frozen, perfect, seen.get)
    assert (found.ceiling.value, found.ceiling.n) == (best.agreement.value, 272)
    assert 0 < (found.ceiling.value or 0) < 1, "it is asked about one distance, and the policy heeds others too"
    spoken = sum(answer != "abstain" for answer in scored.answers.values())
    assert found.answered.value == spoken / 272
    assert found.warnings == ()
    some = held_out.votes.copy()
    some[held_out.models.index(GEMMA), -100:] = -1
    partly = study.replay(frozen, replace(held_out, votes=some), seen.get)
    said = study.score(frozen, replace(held_out, votes=some), resamples=10).answers
    told = [frame for frame, answer in said.items() if answer != "abstain"]
    right = sum(partly.actions[frame] == safe_action(seen[frame][0]) for frame in told)
    assert (partly.agreement_answered.n, partly.agreement_answered.value) == (len(told), right / len(told))
    assert (partly.agreement_answered.value or 1) < (partly.agreement.value or 0)
    actions = {frame: modular_action("hazard" if truth[frame] else "clear", seen[frame][0]) for frame in told}
    agreeing = sum(action == safe_action(seen[frame][0]) for frame, action in actions.items())
    assert (partly.ceiling_answered.n, partly.ceiling_answered.value) == (len(told), agreeing / len(told))
    assert partly.ceiling == found.ceiling, "a perfect guardian answers every frame"
    assert any(
        line.startswith(
            f"The ceiling, a perfect guardian that answers the truth on every frame: "
            f"{found.ceiling.value:.3f} (n 272); where this one answered"
        )
        for line in replay_lines(found)
    )
    assert partly.warnings[0].startswith(f"{GEMMA}: 200 of 544 votes are missing")
    silent = study.replay(frozen, replace(held_out, votes=np.full_like(held_out.votes, -1)), seen.get)
    assert (silent.agreement.value, silent.answered.value) == (1.0, 0.0)
    assert silent.ceiling_answered.value is None
    lopsided = {frame: (pair[0], pair[0]) for frame, pair in seen.items()}
    assert (study.replay(frozen, held_out, lopsided.get).equivariance.value or 0) < 1
    with pytest.raises(GuardianError, match="reads none of its 272 pictures"):
        study.replay(frozen, held_out, lambda _: None)


def test_a_replay_reads_the_pictures_of_a_forward_camera(tmp_path: Path) -> None:
    """With the rover's own distances: STOP below 5 m, the free side below 8 m, STRAIGHT where it is called clear."""
    bank = roads.build_bank(tmp_path / "bank")
    truth = study.hazards_of(bank)
    lines = [f"{frame.id},{','.join(4 * [str(truth[frame.id])])}" for frame in bank]
    votes = tmp_path / "votes.csv"
    votes.write_text("frame,a/original,a/reflected,b/original,b/reflected\n" + "\n".join(lines))
    table = study.read_votes(votes, bank=bank)
    frozen = study.fit(table.keep([table.frames[2], table.frames[7]]))
    found = study.replay(frozen, frozen.unseen(table), study.reader_of(bank))
    assert list(found.actions.values()) == ["STOP", "STOP", "RIGHT", "STRAIGHT", "STRAIGHT", "STRAIGHT"]
    assert (found.equivariance.value, found.equivariance.n, found.unread) == (1.0, 6, ())


def test_votes_are_read_back_as_they_were_written(table: study.VoteTable, tmp_path: Path) -> None:
    """From CSV with a file about them, and from JSON lines; an empty cell is a missing vote."""
    votes = table.votes.copy()
    votes[0, :5] = -1
    written = replace(table, votes=votes)
    path, about = published_votes.write(written, tmp_path)
    read = study.read_votes(path, about=about)
    assert (read.frames, read.episodes, read.models, read.split) == (
        *(written.frames, written.episodes),
        *(written.models, written.split),
    )
    assert np.array_equal(read.votes, votes)
    assert np.array_equal(read.hazard, table.hazard)
    assert read.about == table.about
    lines = tmp_path / "votes.jsonl"
    rows = [{"id": "a", "ride": 1, "danger": 1, "m/original": "hazard", "m/reflected": None}]
    lines.write_text("\n".join(json.dumps(row) for row in rows))
    columns = {"frame": "id", "episode": "ride", "hazard": "danger"}
    short = study.read_votes(lines, columns=columns)
    assert (short.episodes, short.votes.tolist(), short.about.bank) == (("1",), [[[1, -1]]], None)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("frame,episode,hazard\na,e,1\n", "has no votes"),
        ("frame,episode,hazard,m/original\na,e,1,1\n", "no column 'm/reflected'"),
        ("frame,episode,m/original,m/reflected\na,e,1,1\n", "no column 'hazard'"),
        ("frame,episode,hazard,m/original,m/reflected\na,e,1,1,maybe\n", "row 1: 'm/reflected' is 'maybe'"),
        ("frame,episode,hazard,m/original,m/reflected\na,e,,1,1\n", "row 1: 'hazard' is None"),
        ("frame,episode,hazard,m/original,m/reflected\na,e,1,1,1\na,e,0,1,1\n", "'a' stands there twice"),
        ("frame,episode,hazard,split,m/original,m/reflected\na,e,1,test,1,1\n", "'split' is 'test', not one of"),
        ("frame,episode,hazard,m/original,m/reflected\n,e,1,1,1\n", "row 1: 'frame' is None"),
        ("frame,episode,hazard,m/original,m/reflected\n", "has no rows"),
    ],
)
def test_a_table_that_cannot_be_is_refused_with_its_row(tmp_path: Path, text: str, message: str) -> None:
    """Each says the file, the row and what is wrong."""
    path = tmp_path / "votes.csv"
    path.write_text(text)
    with pytest.raises(VoteError, match=message):
        study.read_votes(path)


def test_truth_and_episodes_may_come_from_a_bank(tmp_path: Path) -> None:
    """A hazard is what its column says, or a gap below the bank's threshold; the bank's fingerprint is then known."""
    bank = build_bank(tmp_path / "bank")
    path = tmp_path / "votes.csv"
    rows = [f"{frame.id},1,0" for frame in bank]
    path.write_text("\n".join(["frame,m/original,m/reflected", *rows]))
    read = study.read_votes(path, bank=bank)
    near = [isinstance(gap := frame.truth["lead_gap_m"], float) and gap < 18 for frame in bank]
    assert read.hazard.tolist() == near
    assert read.episodes == tuple(f"{frame.scenario}/{frame.episode}" for frame in bank)
    assert read.about.bank == open_bank(bank.root).manifest.fingerprint
    assert study.read_votes(path, bank=bank, hazard="crashed").hazard.tolist() == [False] * len(bank)
    for column, message in (("demand", "neither true nor false"), ("danger", "no column 'danger'")):
        with pytest.raises(VoteError, match=message):
            study.read_votes(path, bank=bank, hazard=column)
    path.write_text("frame,m/original,m/reflected\nnobody,1,1\n")
    with pytest.raises(VoteError, match="has no frame 'nobody'"):
        study.read_votes(path, bank=bank)


def test_a_committee_of_four_can_be_chosen_and_one_of_five_cannot(table: study.VoteTable) -> None:
    """Its threshold is of eight votes; models may be named, and ties among them go to the first."""
    four = study.fit(table.without(()), size=4)
    assert (len(four.committee), four.voters) == (4, 8)
    assert study.fit(table.without(()), models=(QWEN, GEMMA)).committee == (GEMMA, QWEN)
    with pytest.raises(GuardianError, match="1 to 4 models"):
        study.fit(table.without(()), size=5)
    with pytest.raises(GuardianError, match="frames are hazardous; it needs both kinds"):
        study.fit(table.keep(table.frames[:5]))
    with pytest.raises(VoteError, match="no votes of 'nobody'"):
        study.fit(table.without(()), models=("nobody", GEMMA))


def test_votes_of_several_runs_make_one_committee_and_what_does_not_fit_is_named(table: study.VoteTable) -> None:
    """A run a model, in any order of models and frames: the same guardian; each way not to fit is said."""
    apart = [
        replace(table, name=model, models=(model,), votes=table.of([model]), about=table.about.only([model]))
        for model in reversed(table.models)
    ]
    back = slice(None, None, -1)
    assert table.split is not None
    apart[1] = replace(
        apart[1],
        frames=table.frames[back],
        episodes=table.episodes[back],
        hazard=table.hazard[back],
        votes=apart[1].votes[:, back],
        split=table.split[back],
        unfinished={apart[1].models[0]: 3},
    )
    joined = study.join(apart)
    assert (joined.models, joined.frames, joined.unfinished) == (table.models, apart[0].frames, {apart[1].name: 3})
    assert np.array_equal(joined.votes, table.votes)
    whole = replace(joined, unfinished={})
    assert study.fit(whole.part("calibration")).digest == study.fit(table.part("calibration")).digest
    one, other = apart[0], apart[2]
    for wrong, message in (
        (one, f"'{one.name}' votes in {one.name} and in another table"),
        (replace(other, about=replace(other.about, view="another")), f"the view of {other.name} is not that of"),
        (other.keep(other.frames[1:]), "frame 'f000' is in one of them only"),
        (replace(other, hazard=~other.hazard), "say of a frame another hazard"),
    ):
        with pytest.raises(VoteError, match=message):
            study.join([one, wrong])


def test_a_table_without_a_single_vote_chooses_nothing(table: study.VoteTable) -> None:
    """Among committees that say nothing there is no best one; one vote of one model is enough to choose by."""
    silent = replace(table, votes=np.full_like(table.votes, -1))
    for choose in (study.fit, study.nested):
        with pytest.raises(GuardianError, match=r"no vote by .* on any of \d+ frames"):
            choose(silent)
    spoken = silent.votes.copy()
    spoken[0, 0, 0] = 1
    assert study.fit(replace(silent, votes=spoken)).committee
