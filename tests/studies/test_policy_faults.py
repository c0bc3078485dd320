"""Policies as people ship them, with one fault between robot and network: what a run says, and what it cannot know."""

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from arm_logs import arm_bank
from eyechart.channels import far_off
from eyechart.frames import FrameBank
from eyechart.importing import Choices, import_table, read_rig
from eyechart.models import policy_callable
from eyechart.models.policy_callable import PolicyCallable
from eyechart.probe.policies import examine_policy
from eyechart.prompts import policy_prompt
from eyechart.run import MotionPlan
from eyechart.spaces.motion import Motion
from eyechart.studies import policy
from eyechart.studies.policy import PolicySelection
from eyechart.studies.policy.effects import Effects
from eyechart.studies.policy.motions import Motions
from eyechart.studies.policy.scores import PolicyScore, judge
from known import table, whole_table

pytestmark = pytest.mark.slow

FEW = ("real", "real_repeat", "nudged", "swapped@cameras", "blank")
WIRES = (
    *(
        "real",
        "real_repeat",
        "nudged",
        "swapped@cameras",
        "swapped@camera:top",
        "swapped@camera:wrist",
        "swapped@instruction",
    ),
    *("swapped@state", "blank", "blank@top", "blank@wrist"),
)
FAULTS = {
    "channels_first": ("not_scorable", "error"),
    "seventh": ("not_scorable", "error"),
    "varies": ("not_scorable", "wrong_shape"),
    "strings": ("not_scorable", "error"),
    "objects": ("not_scorable", "error"),
    "masked": ("not_scorable", "error"),
    "one_answer": ("not_scorable", "error"),
    "overflown": ("not_scorable", "not_finite"),
    "with_batch": ("not_scorable", "wrong_shape"),
    "transposed": ("not_scorable", "wrong_shape"),
    "normalised": ("misfit", "normalisation"),
    "tokens": ("misfit", "action space"),
    "late_state": ("self_inconsistent", ""),
    "late_pictures": ("self_inconsistent", "goes with the call before"),
    "smoothed": ("self_inconsistent", "goes with the call before"),
}
HARMLESS = ("sound", "mutates", "one_buffer", "shared", "shared_too")
MISUSED = ("blue_first", "upside_down", "cameras_exchanged", "unit_floats")


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of twelve episodes of two frames."""
    return table(tmp_path_factory.mktemp("faults") / "bank")


@pytest.fixture(scope="module")
def whole(bank: FrameBank) -> FrameBank:
    """Return the bank of twelve episodes of four frames of which `bank` has two."""
    return whole_table(bank)


def asked(bank: FrameBank, out: Path, *names: str, **options: int) -> PolicyScore:
    """Return the scored run of faulty policies, their calls at once."""
    specs = [f"python:faulty_arms:{name}" for name in names]
    policy.run(policy.plan(bank.root, specs, out, conditions=FEW, extent=PolicySelection(answers=2)), **options)
    return policy.score(out)


def test_each_fault_that_can_be_known_fails_a_guard_and_gets_no_label(whole: FrameBank, tmp_path: Path) -> None:
    """Shapes, types, masks, another unit, failures, and a history of a call that was another moment's."""
    verdicts = judge(asked(whole, tmp_path / "run", *FAULTS))
    for name, (guard, words) in FAULTS.items():
        one = verdicts[f"python:faulty_arms:{name}"]
        assert guard in one.guards, (name, one.guards)
        assert words in one.guards[guard]
        assert {one.camera.label, one.state.label, one.instruction.label} == {"undecided"}


def test_what_a_call_does_to_its_own_arrays_reaches_no_other(bank: FrameBank, tmp_path: Path) -> None:
    """Inputs that are overwritten, one buffer for all answers, and two policies that share what they keep."""
    models = asked(bank, tmp_path / "run", *HARMLESS, concurrency=4).models
    (first, *others) = (model.motions.answers for model in models.values())
    for other in others:
        assert all((first[name] == other[name]).all() for name in first)


def test_an_answer_is_copied_before_another_call_may_write_to_it(
    bank: FrameBank, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While it is copied, no other call can begin."""
    policies, held = [], []

    class Watched(PolicyCallable):
        """A policy that is remembered, to look at its lock."""

        def __init__(self, *given: Any, **more: Any) -> None:  # noqa: ANN401 - passed on
            super().__init__(*given, **more)
            policies.append(self)

    def of(answer: object) -> Motion:
        held.append(policies[0].alone.locked())
        return Motion.of(answer)

    monkeypatch.setattr(policy_callable, "PolicyCallable", Watched)
    monkeypatch.setattr(policy_callable, "Motion", SimpleNamespace(of=of))
    asked(bank, tmp_path / "run", "one_buffer", concurrency=1)
    assert held
    assert all(held)


def test_what_draws_its_answers_keeps_nothing(bank: FrameBank, tmp_path: Path) -> None:
    """Noise of a stream of its own is not taken for a history."""
    found = asked(bank, tmp_path / "run", "unseeded")
    ((spec, one),) = found.models.items()
    assert one.drawn
    assert one.statistics["memory"].p > 0.001
    assert judge(found)[spec].guards == {}


def test_what_is_noise_hides_whether_answers_are_constant(whole: FrameBank, tmp_path: Path) -> None:
    """Greater noise than variation is no constant, and no share is below 0; a noise too small to count is one."""
    found = {name: asked(whole, tmp_path / name, name) for name in ("wanders", "trembles")}
    wanders, trembles = (one for score in found.values() for one in judge(score).values())
    assert "self_inconsistent" in wanders.guards
    assert "constant" not in wanders.guards
    assert "constant" in trembles.guards
    assert "self_inconsistent" not in trembles.guards
    variation = found["wanders"].models[wanders.model].statistics["variation"]
    assert variation.value is None
    assert "differ as much when nothing changes" in variation.note
    for one in (wanders, trembles):
        assert not re.search(r"(?<![\w.])-\d", str(one)), str(one)


def test_who_differs_in_the_last_bits_is_asked_once(bank: FrameBank, tmp_path: Path) -> None:
    """Its labels are those of who answers alike, and pictures that never reach it are named all the same."""
    found = asked(bank, tmp_path / "run", "sound", "jitters", "jitters_unseeing")
    exact, rounds, unseeing = found.models.values()
    assert not any(model.drawn for model in found.models.values())
    assert exact.motions.planned == exact.answered == rounds.motions.planned == rounds.answered
    assert 0 < rounds.statistics["noise"].value < 1e-8
    assert rounds.statistics["T.swapped@cameras"].value == pytest.approx(exact.statistics["T.swapped@cameras"].value)
    same, also, blind = judge(found).values()
    assert [axis.label for axis in also.axes.values()] == [axis.label for axis in same.axes.values()]
    assert unseeing.statistics["T.swapped@cameras"].value > 0
    assert blind.camera.label == "undecided"
    assert "changes none of 24 answers by more than rounding" in blind.camera.because


def test_who_fails_now_and_then_does_not_draw_for_it(bank: FrameBank, tmp_path: Path) -> None:
    """Nor for a number that never moves but for its last bits."""
    (one,) = asked(bank, tmp_path / "run", "jitters_and_fails").models.values()
    assert sum(one.motions.missing.values()) > 0
    assert not one.drawn


def test_a_guard_whose_calls_failed_is_none_that_was_passed(bank: FrameBank, tmp_path: Path) -> None:
    """Who answers to no nudged picture may answer by its bytes."""
    ((spec, found),) = judge(asked(bank, tmp_path / "run", "knows_its_files")).items()
    assert policy.score(tmp_path / "run").models[spec].statistics["T.nudged"].value is None
    assert {axis.label for axis in found.axes.values()} == {"undecided"}


def test_what_goes_with_the_time_is_no_noise(bank: FrameBank, tmp_path: Path) -> None:
    """Answers that go with a count of calls differ from call to call as the calls before did."""
    (one,) = judge(asked(bank, tmp_path / "run", "counts")).values()
    assert "goes with the call before" in one.guards["self_inconsistent"]


def test_a_gripper_that_never_moves_is_named(bank: FrameBank, tmp_path: Path) -> None:
    """Where the log's does; all else is said as ever."""
    (one,) = judge(asked(bank, tmp_path / "run", "held")).values()
    assert one.guards == {}
    assert "Its grip is the same in every answer, and the log's is not" in one.remarks[0]


def test_pictures_in_another_form_are_not_held_against_the_policy_in_silence(bank: FrameBank, tmp_path: Path) -> None:
    """What it does is what it does with these; that it does not do what was logged is said beside the labels."""
    specs, out = [f"python:faulty_arms:{name}" for name in MISUSED], tmp_path / "run"
    policy.run(policy.plan(bank.root, specs, out))
    verdicts = judge(policy.score(out))
    for verdict in verdicts.values():
        assert any("does something else than was logged" in remark for remark in verdict.remarks)
    dark = verdicts["python:faulty_arms:unit_floats"]
    assert any("are its pictures ordered and scaled" in remark for remark in dark.remarks)


@pytest.mark.parametrize(
    ("name", "unreached"),
    [
        ("cached", {"camera", "camera:top", "camera:wrist", "instruction"}),
        ("dropped", {"camera", "camera:top", "camera:wrist"}),
        ("unplugged", {"camera:wrist"}),
        ("other_key", {"instruction"}),
        ("other_key_declared", {"instruction"}),
    ],
)
def test_a_channel_that_does_not_arrive_is_said_to_be_so_before_what_was_not_asked(
    bank: FrameBank, tmp_path: Path, name: str, unreached: set[str]
) -> None:
    """That not a bit changes is said first, where the axis is open because the run left controls out."""
    spec, out = f"python:faulty_arms:{name}", tmp_path / "run"
    policy.run(policy.plan(bank.root, [spec], out, conditions=WIRES, extent=PolicySelection(answers=2)))
    verdict = judge(policy.score(out))[spec]
    axes = {"camera": verdict.camera, "instruction": verdict.instruction}
    axes |= {f"camera:{camera}": one for camera, one in verdict.cameras.items()}
    assert {axis for axis, one in axes.items() if "changes not one bit" in one.because} == unreached
    assert all(axes[axis].label == "undecided" for axis in unreached)
    assert verdict.state.label != "state_shortcut"
    amiss = {finding.name for finding in examine_policy(spec, bank).findings if finding.fine is False}
    assert {axis.replace("camera", "cameras") if axis == "camera" else axis for axis in unreached} <= amiss


def test_who_declares_that_it_does_not_read_a_channel_ignores_it(bank: FrameBank, tmp_path: Path) -> None:
    """Not a bit changes there either, and it is no fault; what is declared is said."""
    spec, out = "python:arms:middle", tmp_path / "run"
    policy.run(policy.plan(bank.root, [spec], out))
    one = judge(policy.score(out))[spec]
    assert (one.camera.label, one.instruction.label, one.state.label) == (
        "ignores_camera",
        "instruction_ignored",
        "state_shortcut",
    )
    assert "it declares that it does not read it" in one.camera.because


def test_a_policy_that_hangs_ends_the_run_with_its_reason(bank: FrameBank, tmp_path: Path) -> None:
    """After some calls that took too long it is left alone, and gets no label."""
    spec = "python:faulty_arms:hangs"
    policy.run(policy.plan(bank.root, [spec], tmp_path / "run", conditions=FEW, timeout_s=0.1), attempts=1)
    found = policy.score(tmp_path / "run")
    verdict = judge(found)[spec]
    assert found.models[spec].motions.finished < 4 * len(bank)
    assert {verdict.camera.label, verdict.state.label} == {"undecided"}


def test_a_row_of_a_log_that_is_far_from_all_others_turns_no_verdict_round(tmp_path: Path) -> None:
    """It would be the scale of its numbers, beside which nothing moves; it is left out, and named."""
    spec, found = "python:arm_logs:by_front", {}
    for wrong in (0.0, 1000.0):
        bank = arm_bank(tmp_path / f"{wrong}", tasks=("go",), length=8, episodes=12, wrong=wrong)
        policy.run(policy.plan(bank.root, [spec], tmp_path / f"run-{wrong}"))
        score = policy.score(tmp_path / f"run-{wrong}")
        found[wrong] = judge(score)[spec]
        assert (score.models[spec].motions.scales < 1).all()
        assert {finding.name: finding.fine for finding in examine_policy(spec, bank).findings}["unit"]
        assert len(far_off(bank)) == (2 if wrong else 0)
    assert found[1000.0].guards == found[0.0].guards == {}
    assert found[1000.0].camera.label == found[0.0].camera.label == "camera_content"
    (said,) = (remark for remark in found[1000.0].remarks if remark.startswith("Of the log"))
    assert said.startswith(
        "Of the log 2 moments are left out of what answers are measured by, since numbers of aj0 are"
    )
    assert not any("left out" in remark for remark in found[0.0].remarks)


def test_rows_that_are_far_in_many_episodes_are_kept_and_hide_no_use(tmp_path: Path) -> None:
    """They may be moves that are rare, so nothing is left out; but what they make small is not called ignored."""
    rows = [(drive, 2) for drive in (1, 5, 9)]
    bank = arm_bank(tmp_path / "arm", tasks=("go",), length=8, episodes=16, horizon=1, wrong=50.0, rows=rows)
    spec = "python:test_policy_faults:by_sight_and_by_state"
    policy.run(policy.plan(bank.root, [spec], tmp_path / "run"))
    score = policy.score(tmp_path / "run")
    found = score.models[spec].statistics["T.swapped@cameras"]
    assert far_off(bank) == {}
    assert found.value < 0.1
    assert found.carried["aj0"] > 0.5
    assert found.as_dict()["detail"]["carried"]["aj0"] == found.carried["aj0"]


@pytest.mark.parametrize(("scale", "label"), [("", "undecided"), ("1.0", "ignores_camera")])
def test_a_number_that_is_constant_in_the_log_hides_no_use(tmp_path: Path, scale: str, label: str) -> None:
    """The log gives it no scale, so that no size of its moves is small; a declared scale says what is."""
    arm_bank(tmp_path / "arm", tasks=("go",), length=8, episodes=12, horizon=1)
    head, *rows = (tmp_path / "arm" / "t.csv").read_text().splitlines()
    (tmp_path / "arm" / "t.csv").write_text("\n".join([head, *(f"{row.rpartition(',')[0]},0" for row in rows)]))
    rig = tmp_path / "arm" / "rig.toml"
    rig.write_text(f"{rig.read_text()}{f'scale = {scale}' if scale else ''}\n")
    chosen = Choices(rig=read_rig(rig), prompt_columns=("task",))
    bank = import_table(tmp_path / "arm", tmp_path / "arm" / "t.csv", tmp_path / "bank", chosen)
    found = {}
    for name in ("by_state_and_a_little_by_sight", "by_state_and_its_last_bits"):
        spec = f"python:test_policy_faults:{name}"
        policy.run(policy.plan(bank.root, [spec], tmp_path / name))
        found[name] = judge(policy.score(tmp_path / name))[spec].camera
    seen, blind = found.values()
    assert (seen.label, blind.label) == (label, "ignores_camera")
    assert label == "ignores_camera" or "some go with it: aj1 (T 0." in seen.because


def by_state_and_a_little_by_sight(images: dict[str, Any], state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Go by the state alone, and a little by the picture in the second number, which the log never moves."""
    del instruction
    return np.array([[-0.3 * state[0], 0.03 * (float(images["front"][0, 0, 0]) - 125) / 100]])


def by_state_and_its_last_bits(images: dict[str, Any], state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Go by the state alone, but for the rounding of a network."""
    del instruction
    return np.array([[-0.3 * state[0], 1e-5 * (float(images["front"][0, 0, 0]) - 125) / 100]])


def test_a_wrong_state_is_not_all_that_places_vary(tmp_path: Path) -> None:
    """Relative to it a place is far off, and would be the whole variation, beside which nothing is used."""
    clean = arm_bank(tmp_path / "arm", tasks=("go",), length=8, episodes=12, kind="absolute")
    first, *others = clean.frames
    state = {"joints": (1000.0, *first.state["joints"][1:])}
    bank = replace(clean, frames=(replace(first, state=state), *others))
    space, spec = bank.manifest.motion, "python:arm_logs:by_front"
    assert {*far_off(bank)} == {first.id}
    plan = MotionPlan("policy", bank, policy_prompt(space, None), (spec,), ("real",), bank.frames, 0)
    answers = np.array([frame.motion or np.full(space.shape, np.nan) for frame in bank])
    effects = Effects(Motions(plan, {"real": answers[None]}), drawn=False)
    assert 0 < effects._variation().values.max() < 100


def by_sight_and_by_state(images: dict[str, Any], state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Do as the log does in the first number, and go by the state alone in the second."""
    del instruction
    return np.array([[-0.3 * state[0] + (float(images["front"][0, 0, 0]) - 125) / 100, -0.3 * state[1]]])
