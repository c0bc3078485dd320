"""The rules on policies, simulated: the worlds have the shares that they declare, and false claims are counted."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from eyechart.calibrate.policies import LabelCounts, PolicySetting, labels_of, settings, simulated, try_rules
from eyechart.cli.app import app
from eyechart.errors import SpecError

BASE = PolicySetting()


@pytest.mark.parametrize(
    ("setting", "shares"),
    [
        (BASE, {"T.swapped@cameras": 0.10, "T.matched@cameras": 0.0, "T.blank": 0.0}),
        (replace(BASE, margin="matched"), {"T.swapped@cameras": 0.40, "T.matched@cameras": 0.10, "T.blank": 0.0}),
        (replace(BASE, margin="blank"), {"T.swapped@cameras": 0.0, "T.matched@cameras": 0.0, "T.blank": 0.10}),
        (replace(BASE, margin="instruction", share=0.2), {"T.swapped@instruction": 0.20}),
        (replace(BASE, numbers="bang-bang"), {"T.swapped@cameras": 0.10}),
        (replace(BASE, numbers="heavy tails"), {"T.swapped@cameras": 0.10}),
        (replace(BASE, response=0.25), {"T.swapped@cameras": 0.10}),
        (
            replace(BASE, margin="matched", response=0.25, whole=True, episodes=50),
            {"T.swapped@cameras": 0.40, "T.matched@cameras": 0.10},
        ),
        (replace(BASE, noise=1.0, answers=2, frames=144), {"T.swapped@cameras": 0.10, "T.blank": 0.0}),
    ],
)
def test_a_world_has_the_share_that_it_declares(setting: PolicySetting, shares: Mapping[str, float]) -> None:
    """Of every condition, as the mean over data sets; a ratio of means is a little above it."""
    found = [simulated(setting, np.random.default_rng(number)) for number in range(120)]
    for name, share in shares.items():
        assert np.mean([one[name].value for one in found]) == pytest.approx(share, abs=0.01 + 0.15 * share)


def test_settings_are_named_apart_and_hold_what_was_written_down() -> None:
    """One factor is moved at a time from the base; T and noise are crossed."""
    every = settings()
    assert len({setting.name for setting in every}) == len(every)
    assert every.count(BASE) == 1
    assert {setting.episodes for setting in every} == {6, 7, 8, 12, 24, 50}
    assert {(setting.noise, setting.answers, setting.share) for setting in every if setting.noise} == {
        (noise, answers, share)
        for noise in (0.05, 0.25, 1.0)
        for answers in (2, 4)
        for share in (0.0, 0.02, 0.05, 0.10, 0.20, 0.40)
    }
    assert all(setting.frames >= setting.episodes for setting in every)


def test_an_untrue_label_is_counted_against_the_rules() -> None:
    """The most frequent one; what is true, or undecided, is not."""
    tried = LabelCounts(BASE, {"ignores_camera": 2, "pose_only": 50, "undecided": 48}, 100)
    assert tried.false == 0.02
    assert not tried.is_missed
    assert LabelCounts(BASE, {"ignores_camera": 3}, 100).is_missed
    assert LabelCounts(replace(BASE, share=0.05), {"ignores_camera": 100}, 100).false is None
    assert replace(BASE, share=0.02).false == {"camera_content", "uses_camera", "pose_only", "camera_presence"}


def test_where_few_episodes_respond_nothing_untrue_is_said_of_the_data_set() -> None:
    """Of twelve episodes none may respond; then the label is true of these, and undecided of all."""
    sparse = replace(BASE, response=0.15, whole=True)
    counter = Counter(label for seed in range(60) for label in labels_of(sparse, np.random.default_rng(seed)))
    assert counter["ignores_camera, true of these episodes"] >= 2
    assert counter["undecided, of the data set"] >= 60
    tried = LabelCounts(sparse, counter, 60)
    assert tried.false is not None
    assert tried.false > 0.02
    assert (tried.seen, tried.claimed, tried.is_missed) == (0.0, 0.0, False)
    told = tried.as_dict()
    assert "true of these" not in str(told)
    assert told["labels"]["ignores_camera"] == tried.false
    assert "ignores_camera" not in told["of_data_set"]
    assert not any("true of these" in label for label in labels_of(BASE, np.random.default_rng(0)))
    assert LabelCounts(sparse, {"ignores_camera, of the data set": 3}, 100).is_missed


def test_absence_is_said_of_the_data_set_from_enough_episodes_on() -> None:
    """Fifty of which none responds bound the share that may; one in four that does at a similar state is too many."""
    silent = replace(BASE, share=0.0, episodes=50)
    labels = labels_of(silent, np.random.default_rng(1))
    assert {"ignores_camera, of the data set", "state_shortcut, of the data set"} <= set(labels)
    pose = replace(BASE, margin="matched", episodes=50, response=0.25, whole=True)
    labels = [label for seed in range(20) for label in labels_of(pose, np.random.default_rng(seed))]
    assert "pose_only, of the data set" not in labels


def test_clear_policies_get_their_labels() -> None:
    """At the ends of the scale, in nearly every data set."""
    for setting, label in (
        (replace(BASE, share=0.0), "ignores_camera"),
        (replace(BASE, margin="matched", share=0.2), "camera_content"),
        (replace(BASE, margin="instruction", share=0.0), "instruction_ignored"),
        (replace(BASE, margin="follow", share=0.7), "object_grounded"),
        (replace(BASE, margin="control", share=0.6), "camera_content"),
        (replace(BASE, margin="follow", share=0.7, episodes=6), "camera_content"),
    ):
        said = [labels_of(setting, np.random.default_rng(number)) for number in range(20)]
        assert sum(label in one for one in said) >= 16, setting.name


def test_the_result_does_not_depend_on_processes_and_the_command_prints_it() -> None:
    """Only the settings that are named."""
    one, two = (list(try_rules(120, processes=count, chosen=[BASE.name], exact=True)) for count in (1, 2))
    assert [found.as_dict() for found in one] == [found.as_dict() for found in two]
    done = CliRunner().invoke(
        app, ["calibrate", "--policies", "--replications", "5", "--setting", "matched 0.2", "--processes", "1"]
    )
    assert "matched 0.2, 12 episodes, 72 frames" in done.stdout
    with pytest.raises(SpecError, match="no setting of policies"):
        list(try_rules(5, chosen=["nothing"]))
