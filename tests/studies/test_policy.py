"""Policies from a run to a verdict: known answers, faults that a guard names, and a ledger that is gone on with."""

import json
import os
import random
import re
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import stand_ins
from eyechart.calls import CallKey, Reply
from eyechart.cli.app import app
from eyechart.errors import BankError, LedgerError, SpecError
from eyechart.frames import FrameBank
from eyechart.ledger import Ledger
from eyechart.simulators import open_bank_simulator
from eyechart.spaces.motion import Motion
from eyechart.studies import ReadOptions, policy, study_of
from eyechart.studies.policy import PolicyScore, PolicySelection
from eyechart.studies.policy.scores import judge
from eyechart.transfer import transfer
from known import table, whole_table

pytestmark = pytest.mark.slow

KNOWN = {
    "python:arms:reach": ("object_grounded", "state_used", "instruction_followed"),
    "python:arms:middle": ("ignores_camera", "state_shortcut", "instruction_ignored"),
    "python:arms:deaf": ("object_grounded", "state_used", "instruction_ignored"),
}
FAULTS = {
    "python:arms:not_a_number": ("not_scorable", "not_finite"),
    "python:arms:half": ("not_scorable", "wrong_shape"),
    "python:arms:broken": ("not_scorable", "error"),
    "python:arms:parcel": ("not_scorable", "error"),
    "python:arms:raw": ("misfit", "normalisation"),
    "python:arms:still": ("constant", ""),
    "python:arms:tossed": ("self_inconsistent", "nothing changes"),
    "python:arms:queue": ("self_inconsistent", "nothing changes"),
}
FEW = ("real", "real_repeat", "nudged", "swapped@cameras", "blank")


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of twelve episodes of two frames."""
    return table(tmp_path_factory.mktemp("policy") / "bank")


@pytest.fixture(scope="module")
def whole(bank: FrameBank) -> FrameBank:
    """Return the bank of twelve episodes of four frames of which `bank` has two."""
    return whole_table(bank)


@pytest.fixture(scope="module")
def run(bank: FrameBank) -> Path:
    """Return a run of the policies with known answers."""
    out = bank.root.parent / "run"
    policy.run(policy.plan(bank.root, list(KNOWN), out))
    return out


@pytest.fixture(scope="module")
def scored(run: Path) -> PolicyScore:
    """Return its score."""
    return policy.score(run)


def told(*words: object, code: int = 0) -> str:
    """Return what a command prints, which exits so."""
    result = CliRunner().invoke(app, list(map(str, words)))
    assert result.exit_code == code, result.output
    return result.stdout


def test_an_index_shows_the_statistic_that_decided_for_each_policy(run: Path, scored: PolicyScore) -> None:
    """By its own name, with its value: the one that the verdict on the cameras names."""
    verdicts = judge(scored)
    for spec, found in study_of(run).findings(scored).items():
        assert found.decided_by == verdicts[spec].camera.by or not verdicts[spec].camera.by
        assert found.estimate is scored.models[spec].statistics[found.decided_by]


def test_every_policy_gets_the_labels_that_it_deserves(run: Path) -> None:
    """By the JSON that scripts rely on: a label an axis, a share a channel."""
    found = json.loads(told("verdict", run, "--json"))["policies"]
    labels = {spec: (one["camera"], one["state"], one["instruction"]) for spec, one in found.items()}
    assert labels == {**KNOWN, "python:arms:deaf": ("camera_content", "state_used", "instruction_ignored")}
    for one in found.values():
        assert one["guards"] == []
        assert set(one["cameras"]) == {"top", "wrist"}
        assert set(one["channels"]) == {"cameras", "camera:top", "camera:wrist", "state", "instruction"}
        assert one["cameras"]["wrist"] == "ignores_camera"
        for share in one["channels"].values():
            assert share["ci"][0] <= share["T"] <= share["ci"][1]
            assert share["n"] == 24
    assert (
        "both are below 0.1, and no episode was found that responds by 0.1 or more"
        in found["python:arms:middle"]["because"]
    )
    assert found["python:arms:middle"]["channels"]["cameras"]["T"] == 0.0
    assert "it declares that it does not read it" in found["python:arms:middle"]["because"]


def test_an_object_that_nobody_named_is_no_ground_for_grounding(scored: PolicyScore) -> None:
    """Who goes to red whatever is said follows the moved object in half of the episodes, named or not."""
    verdict = judge(scored)["python:arms:deaf"]
    assert verdict.camera.label == "camera_content"
    assert verdict.camera.why_not


def test_commands_say_the_same(run: Path) -> None:
    """Verdict, score, costs, gate; what the study cannot do it says."""
    assert "instruction_followed" in told("verdict", run)
    assert "T.swapped@state" in told("score", run)
    assert "python:arms:reach" in told("costs", run)
    assert json.loads(told("score", run, "--json"))["study"] == "policy"
    wanted = "camera:camera_content,instruction:instruction_followed"
    lines = told("gate", run, "--require", wanted, code=1)
    assert "holds       python:arms:reach  camera:camera_content" in lines
    assert "FAILS       python:arms:deaf  instruction:instruction_followed" in lines
    refused = CliRunner().invoke(app, ["gate", str(run), "--require", "depth"])
    assert "camera:object_grounded" in str(refused.exception)


def test_a_report_is_made_and_a_bundle_is_validated(run: Path, tmp_path: Path) -> None:
    """From the run's own files, and from the bundle's alone."""
    told("report", run, "--out", tmp_path / "page.html", "--tables", tmp_path / "tables")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "object_grounded (top camera_content, wrist ignores_camera); state_used" in page
    assert re.search(r"python:arms:deaf</bdi>: .*What the picture shows .+ Next: train with several instructions", page)
    does = r"1 looks \(\S+:reach\), 1 does not look \(\S+:middle\) and 1 looks but does not listen \(\S+:deaf\)"
    assert re.search(f"Of 3 policies, {does}", page)
    assert "Not more of cameras, top camera, wrist camera, state, instruction, because it is said of these" in page
    assert "wrist: at a similar state" in page
    assert "If the object that it is told to reach is moved in the picture, its motion goes along." in page
    assert "Next: train with several instructions in one scene" in page
    assert page.count("shares-python-arms-reach-title") == 2
    assert len(set(re.findall(r'aria-labelledby="(moment-python-arms-[\w-]+)-title', page))) == 5  # one stands first
    assert "data:image/png;base64" in page
    assert (tmp_path / "tables" / "channels.csv").is_file()
    told("bundle", run, "--out", tmp_path / "run.zip")
    assert "3 models" in told("validate", tmp_path / "run.zip")


def test_the_ledger_keeps_every_array_to_the_byte(run: Path) -> None:
    """What was answered can be read back, with its digest."""
    with Ledger(run / "ledger.sqlite") as ledger:
        replies = [reply for _, reply in ledger.replies("python:arms:reach")]
        assert ledger.damaged() == []
    motions = [Motion.read(reply.text) for reply in replies]
    assert {motion.shape for motion in motions} == {(8, 3)}
    assert all(
        json.loads(reply.text)["motion"]["sha256"] == motion.sha256
        for reply, motion in zip(replies, motions, strict=True)
    )


def test_each_fault_fails_its_guard_and_gets_no_verdict(bank: FrameBank, tmp_path: Path) -> None:
    """NaN, half a motion, a missing camera, another unit, no motion at all, noise, and a queue that nobody empties."""
    policy.run(
        policy.plan(bank.root, list(FAULTS), tmp_path / "run", conditions=FEW, extent=PolicySelection(answers=2))
    )
    verdicts = judge(policy.score(tmp_path / "run"))
    for spec, (guard, words) in FAULTS.items():
        assert words in verdicts[spec].guards[guard]
        assert {one.label for one in (verdicts[spec].camera, verdicts[spec].state)} == {"undecided"}
    gate = study_of(tmp_path / "run").gate(policy.score(tmp_path / "run"), ["camera:camera_content"])
    assert {check.holds for check in gate.checks} == {None}


def test_a_policy_that_can_be_reset_is_asked_as_at_the_beginning(bank: FrameBank, tmp_path: Path) -> None:
    """The same queue, emptied before every call, is no fault."""
    policy.run(policy.plan(bank.root, ["python:arms:reset"], tmp_path / "run", conditions=FEW))
    one = policy.score(tmp_path / "run").models["python:arms:reset"]
    assert one.statistics["noise"].value == 0.0
    assert one.statistics["misfit"].value < 0.1


def test_what_draws_its_answers_is_asked_again_and_what_is_seeded_is_not(bank: FrameBank, tmp_path: Path) -> None:
    """Four answers to each call but the repeat; a seed is the same for all calls, and is tried twice."""
    specs = ["python:arms:unsteady", "python:arms:fixed"]
    policy.run(policy.plan(bank.root, specs, tmp_path / "run", conditions=FEW))
    models = policy.score(tmp_path / "run").models
    drawn, fixed = (models[spec] for spec in specs)
    assert (drawn.drawn, drawn.motions.finished) == (True, 24 * (5 + 3 * 4))
    assert (fixed.drawn, fixed.motions.finished, fixed.version) == (False, 24 * 6, "seven")
    assert fixed.statistics["noise"].value == pytest.approx(drawn.statistics["noise"].value, abs=0.1)
    shares = [one.statistics["T.swapped@cameras"] for one in (drawn, fixed)]
    assert shares[0].p < 0.01
    assert shares[1].p is None
    assert shares[0].value == pytest.approx(shares[1].value, rel=0.2)


def test_who_says_that_a_seed_fixes_it_and_draws_is_found_out(bank: FrameBank, tmp_path: Path) -> None:
    """One seed gives two answers: it is asked as one that draws, and its noise is not taken for looking."""
    policy.run(policy.plan(bank.root, ["python:arms:liar"], tmp_path / "run"))
    scored = policy.score(tmp_path / "run")
    found = scored.models["python:arms:liar"]
    assert found.drawn
    assert found.statistics["T.swapped@cameras"].value == pytest.approx(0, abs=0.05)
    assert judge(scored)["python:arms:liar"].camera.label == "ignores_camera"
    (cell,) = transfer([scored], {"python:arms:liar": 1.0}, measure="T.swapped@cameras").cells
    assert (cell.bank, cell.measured) == (bank.name, found.statistics["T.swapped@cameras"].value)


def test_a_pose_in_the_picture_is_no_content(whole: FrameBank, tmp_path: Path) -> None:
    """States match roughly, and the rest of the difference shows; a picture of the own episode shows as much."""
    asked = ("real", "real_repeat", "nudged", "swapped@cameras", "matched@cameras", "near@cameras", "blank")
    specs = ["python:arms:poses", "python:arms:deaf"]
    policy.run(policy.plan(whole.root, specs, tmp_path / "run", conditions=asked))
    scored = policy.score(tmp_path / "run")
    poses, deaf = (scored.models[spec].statistics for spec in specs)
    assert poses["T.matched@cameras"].ci[0] > 0.02
    assert poses["beyond@cameras"].ci[0] < 0.02 < deaf["beyond@cameras"].ci[0]
    verdicts = judge(scored)
    assert verdicts[specs[0]].camera.label == "uses_camera"
    assert "it may read its own pose" in verdicts[specs[0]].camera.because
    assert verdicts[specs[1]].camera.label == "camera_content"


def test_a_wrist_that_looks_at_the_block_is_content(bank: FrameBank, tmp_path: Path) -> None:
    """Its own episode's pictures show the block elsewhere too; that it answers to colours is no pose."""
    over = ("swapped@cameras", "swapped@camera:wrist", "matched@camera:wrist", "near@camera:wrist", "exchanged@wrist")
    spec = "python:arms:by_wrist"
    for name, conditions in (("without", over[:-1]), ("with", over)):
        policy.run(policy.plan(bank.root, [spec], tmp_path / name, conditions=(*FEW[:3], *conditions)))
    without, found = (judge(policy.score(tmp_path / name))[spec].cameras["wrist"] for name in ("without", "with"))
    assert without.label == "uses_camera"
    assert found.label == "camera_content"


def test_a_run_that_was_cut_goes_on_and_comes_to_the_same(bank: FrameBank, tmp_path: Path) -> None:
    """In three parts, by a limit of calls; a finished run makes no further call, and another bank is refused."""
    specs = ["python:arms:reach", "python:arms:fixed"]
    whole, cut = (policy.plan(bank.root, specs, tmp_path / name, conditions=FEW) for name in ("whole", "cut"))
    policy.run(whole)
    for limit in (50, 125):
        told(
            "run",
            "policy",
            "--frames",
            bank.root,
            "--out",
            tmp_path / "cut",
            "--max-calls",
            limit,
            *(word for spec in specs for word in ("--policy", spec)),
            "--conditions",
            ",".join(FEW),
            code=3,
        )
    assert "calls are unfinished" in judge(policy.score(tmp_path / "cut"))[specs[0]].remarks[0]
    policy.run(cut)
    assert judge(policy.score(tmp_path / "cut"))[specs[0]].remarks == ()
    assert cut.counts() == (24 * 11, 24 * 11, 0)
    first, second = (policy.score(tmp_path / name).as_dict()["policies"] for name in ("whole", "cut"))
    assert first == second
    other = table(tmp_path / "other", seeds=(7, 8))
    with pytest.raises(LedgerError, match="fingerprint"):
        policy.plan(other.root, specs, tmp_path / "cut", conditions=FEW)


def test_a_run_that_is_killed_goes_on_and_loses_no_finished_call(bank: FrameBank, tmp_path: Path) -> None:
    """Killed three times by SIGKILL, it makes no finished call again, and comes to what nobody disturbed."""
    specs, out = ["python:arms:reach", "python:arms:fixed"], tmp_path / "cut"
    words = [*("run", "policy", "--frames", bank.root, "--out", out), "--conditions", ",".join(FEW)]
    words += ["--concurrency", 4, *(word for spec in specs for word in ("--policy", spec))]
    program = [sys.executable, "-c", "from eyechart.cli import main; main()", *map(str, words)]
    env = os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])}
    replies: dict[CallKey, Reply] = {}
    for more in (*random.Random(3).sample(range(1, 80), 3), 24 * 11):  # noqa: S311
        wanted = stand_ins.rows_in(out / "ledger.sqlite", "replies") + more
        with subprocess.Popen(program, env=env, stderr=subprocess.DEVNULL) as running:
            while running.poll() is None:
                if stand_ins.rows_in(out / "ledger.sqlite", "replies") >= wanted:
                    running.kill()
                time.sleep(0.002)
        with Ledger(out / "ledger.sqlite") as ledger:
            found = {key: reply for spec in specs for key, reply in ledger.replies(spec)}
        assert len(found) >= min(wanted, 24 * 11)
        assert replies.items() <= found.items()
        replies = found
    assert len(replies) == 24 * 11
    policy.run(policy.plan(bank.root, specs, tmp_path / "whole", conditions=FEW))
    with Ledger(out / "ledger.sqlite") as ledger:
        finals = [sent.key for spec in specs for sent in ledger.attempts(spec) if sent.final]
        assert len(finals) == len(set(finals))
    assert said_of(out) == said_of(tmp_path / "whole")


def said_of(run: Path) -> tuple[object, object]:
    """Return the numbers and the verdicts of a run, without what its calls took."""
    scored = policy.score(run)
    return scored.as_dict()["policies"], {spec: one.as_dict() for spec, one in judge(scored).items()}


@pytest.mark.parametrize("order", [[2, 1], [3, 1, 2]])
def test_shards_are_merged_into_the_same(bank: FrameBank, tmp_path: Path, order: list[int]) -> None:
    """In any order of the shards: the same answers to the byte, and the same verdict; one draws, by a seed."""
    specs, count = ["python:arms:reach", "python:arms:fixed"], len(order)
    for number in order:
        extent = PolicySelection(shard=(number, count))
        policy.run(policy.plan(bank.root, specs, tmp_path / f"{number}", conditions=FEW, extent=extent))
    told("merge", *(tmp_path / f"{number}" for number in order), "--out", tmp_path / "merged")
    policy.run(policy.plan(bank.root, specs, tmp_path / "whole", conditions=FEW))
    assert said_of(tmp_path / "merged") == said_of(tmp_path / "whole")


def test_shards_that_are_not_finished_merge_and_the_whole_goes_on(bank: FrameBank, tmp_path: Path) -> None:
    """One of three is cut and one was never begun: what is missing is asked of the merged run."""
    specs = ["python:arms:fixed"]
    first, second = (
        policy.plan(bank.root, specs, tmp_path / f"{number}", conditions=FEW, extent=PolicySelection(shard=(number, 3)))
        for number in (1, 2)
    )
    policy.run(first)
    policy.run(replace(second, plan=replace(second.plan, frames=second.plan.frames[:7])))
    told("merge", tmp_path / "2", tmp_path / "1", "--out", tmp_path / "merged")
    rest = policy.plan(bank.root, specs, tmp_path / "merged", conditions=FEW)
    calls, finished, _ = rest.counts()
    assert 0 < finished < calls
    policy.run(rest)
    assert rest.counts() == (calls, calls, 0)
    policy.run(policy.plan(bank.root, specs, tmp_path / "whole", conditions=FEW))
    assert said_of(tmp_path / "merged") == said_of(tmp_path / "whole")


def test_too_few_episodes_settle_nothing(tmp_path: Path) -> None:
    """Four episodes bound nothing; two cannot even be asked."""
    small = open_bank_simulator("tabletop").build(tmp_path / "bank", seeds=(0,), steps=4)
    policy.run(policy.plan(small.root, ["python:arms:reach"], tmp_path / "run", conditions=(*FEW, "matched@cameras")))
    verdict = judge(policy.score(tmp_path / "run"))["python:arms:reach"]
    assert verdict.camera.label == "undecided"
    assert "episodes bound nothing" in verdict.camera.because


def test_absence_is_said_of_the_data_set_where_enough_episodes_were_asked(run: Path, tmp_path: Path) -> None:
    """Of 12 episodes none responds, and a third of all may; of 48 less than a tenth. The label is the same."""
    policies = json.loads(told("verdict", run, "--json"))["policies"]
    few = policies["python:arms:middle"]["axes"]["camera"]
    assert (few["label"], few["data_set"]["label"], few["data_set"]["responding"]) == ("ignores_camera", "undecided", 0)
    assert "none of 12 responds, so that up to 32% of the data set's may; 44 episodes" in few["why_not"]
    assert "data_set" not in policies["python:arms:reach"]["axes"]["camera"]
    large = table(tmp_path / "bank", seeds=range(12))
    policy.run(policy.plan(large.root, ["python:arms:middle"], tmp_path / "run"))
    verdict = judge(policy.score(tmp_path / "run"))["python:arms:middle"]
    for one in (verdict.camera, verdict.state):
        assert (one.of_data_set, one.why_not) == (one.label, "")
    assert verdict.camera.as_dict()["data_set"]["share_at_most"] == pytest.approx(1 - 0.01 ** (1 / 48))


def test_what_cannot_be_asked_is_refused_in_one_line(bank: FrameBank, tmp_path: Path) -> None:
    """An unknown policy, channel, condition; a bank without motions; one answer of a policy that may draw."""
    highway = open_bank_simulator("rover").build(tmp_path / "rover", seeds=(0,), steps=4)
    for given, error, words in (
        ({"specs": ["trained:sees"], "bank_path": highway.root}, BankError, "does not say what a motion is"),
        ({"specs": ["arms:reach"]}, SpecError, "unknown policy 'arms:reach'"),
        ({"specs": ["trained:nobody"]}, SpecError, "known are sees"),
        ({"specs": ["python:arms:nobody"]}, SpecError, "no callable 'nobody'"),
        ({"specs": []}, SpecError, "at least one --policy"),
        ({"specs": ["python:arms:awaited"]}, SpecError, "an async function"),
        (
            {"specs": ["python:arms:sightless"]},
            SpecError,
            "take the arguments .images, state, instruction. by position, and has",
        ),
        (
            {"specs": ["python:arms:seedless"]},
            SpecError,
            "seed=. by position, and has .images, state, instruction.: got an",
        ),
        ({"conditions": ["swapped@nose"]}, SpecError, "unknown condition 'swapped@nose'"),
        (
            {"conditions": ["blank@tpo"]},
            BankError,
            "the bank has no camera 'tpo'; did you mean 'top'. there are top, w",
        ),
        (
            {"conditions": ["swapped@camera:left"]},
            BankError,
            "has no channel 'camera:left'; .*there are cameras, camera",
        ),
        ({"conditions": ["matched@state"]}, BankError, "only pictures are matched"),
        ({"extent": PolicySelection(answers=1)}, SpecError, "--answers takes 2 or more"),
    ):
        with pytest.raises(error, match=words):
            policy.plan(**{"bank_path": bank.root, "specs": ["python:arms:reach"], "out": tmp_path / "no", **given})
    assert not (tmp_path / "no").exists()


def test_reading_asks_for_the_reader_that_began_the_run(run: Path, tmp_path: Path) -> None:
    """A run of another version of the rules is read anew only where that is said."""
    values = json.loads((run / "run.json").read_text(encoding="utf-8"))
    copy = tmp_path / "run"
    copy.mkdir()
    for name in ("ledger.sqlite", "ledger.sqlite.counter"):
        (copy / name).write_bytes((run / name).read_bytes())
    (copy / "bank").symlink_to(run / "bank")
    (copy / "run.json").write_text(json.dumps({**values, "reader": 0}), encoding="utf-8")
    with pytest.raises(LedgerError, match="--reread"):
        study_of(copy).score(copy, ReadOptions())
    assert study_of(copy).score(copy, ReadOptions(reread=True)).models


def test_absolute_places_are_measured_from_the_state_that_was_shown() -> None:
    """A constant offset from the state does not vary, however the state does."""
    from eyechart.spaces.motion import Dimension, MotionSpace  # noqa: PLC0415

    space = MotionSpace("p", (Dimension("x", state=0),), 1, "absolute", state=(Dimension("x"),))
    states = np.array([[0.1], [0.9]])
    assert space.relative(states[:, None] + 0.2, states) == pytest.approx(0.2)
