"""What is printed of policies: counts by channel, shares by step, nothing of who failed a guard, what to do next."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import arms
from eyechart.frames import FrameBank
from eyechart.report.table import Table
from eyechart.stats.shares import LogDistance
from eyechart.stats.statistic import Statistic
from eyechart.studies import ReadOptions, policy, study_of
from eyechart.studies.policy.advice import SETTLE, settling
from eyechart.studies.policy.figures import _boxes
from eyechart.studies.policy.page import _answer, _does, _tone, in_a_sentence, made
from eyechart.studies.policy.scores import PolicyScore
from eyechart.studies.policy.tables import channel_table, parts_table, steps_table
from known import table
from policies_by_hand import share, verdict

HERE = "python:test_policy_tables"
FEW = ("real", "real_repeat", "nudged", "swapped@cameras", "swapped@state", "swapped@instruction", "blank")


def unread(images: arms.Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Go to the middle, and declare nothing."""
    return arms.middle(images, state, instruction)


def contrary(images: arms.Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Take one name for the other."""
    return arms.reach(images, state, "reach the red block" if "blue" in str(instruction) else "reach the blue block")


def ends(images: arms.Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Go to the middle, but with the last step where it sees the block."""
    result = arms.middle(images, state, instruction)
    result[-1] = arms.reach(images, state, instruction)[-1]
    return result


def still(images: arms.Images, state: np.ndarray, instruction: str | None) -> np.ndarray:
    """Hardly move."""
    return 1e-9 * arms.reach(images, state, instruction)


def of_16(n: int) -> Statistic:
    """Return a used share of so many frames."""
    one = share(0.1, 0.5)
    return Statistic(one.value, n, one.ci, detail=one.detail)


def test_each_channels_own_number_of_frames_is_told() -> None:
    """One number where all are alike, and which are otherwise where they are not."""
    alike, other = verdict(), verdict(swap=of_16(12), **{"T.swapped@camera:top": of_16(12)})
    table = channel_table({"a": alike, "b": other})
    assert [row[-1] for row in table.rows] == [72, "72; cameras 12, camera:top 12"]


def test_no_share_is_listed_of_who_failed_a_guard() -> None:
    """The note says which guard that was."""
    failed = verdict(misfit=LogDistance(2.0, 72, offset=9.0, spread=1.0))
    table = channel_table({"good": verdict(), "bad": failed})
    assert table.rows[0][1] is not None
    assert set(table.rows[1][1:]) == {None}
    assert table.note.endswith("not computed where a guard failed: bad (misfit)")


@pytest.fixture(scope="module")
def scored(tmp_path_factory: pytest.TempPathFactory) -> PolicyScore:
    """Return a run of the policies of this module on twelve episodes of four frames."""
    folder = tmp_path_factory.mktemp("tables")
    bank: FrameBank = table(folder / "bank")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(Path(__file__).parent)
        specs = [f"{HERE}:{name}" for name in ("still", "unread", "contrary", "ends")]
        policy.run(policy.plan(bank.root, specs, folder / "run"))
    return policy.score(folder / "run")


@pytest.mark.slow
def test_the_share_by_step_is_printed(scored: PolicyScore) -> None:
    """Of one that looks for its last step alone, all of it is there; who failed a guard is in no such table."""
    table = steps_table(scored)
    assert table.names[2:] == [f"step {number}" for number in range(1, 9)]
    row = next(row for row in table.rows if row[:2] == (f"{HERE}:ends", "swapped@cameras"))
    assert [round(float(str(one)), 9) for one in row[2:-1]] == [0.0] * 7
    assert float(str(row[-1])) > 0.1
    for one in (table, parts_table(scored)):
        assert {row[0] for row in one.rows} == {f"{HERE}:{name}" for name in ("unread", "contrary", "ends")}
    printed = study_of(Path(scored.bank.root).parent).printed(scored)
    assert "steps" in [one.name for one in printed if isinstance(one, Table)]


@pytest.mark.slow
def test_the_page_draws_no_share_of_who_failed_and_says_what_settles_what_is_open(scored: PolicyScore) -> None:
    """Not more episodes, where another question or a look at the road is what would."""
    html = made([(scored, None)]).page.html.decode()
    drawn = [
        name for name in ("still", "unread", "contrary", "ends") if f"shares-python-test-policy-tables-{name}" in html
    ]
    assert drawn == ["unread", "contrary", "ends"]
    unread, contrary = f"{HERE}:unread", f"{HERE}:contrary"
    for channel, what in (("cameras", "its picture"), ("instruction", "its instruction")):
        assert str(settling(scored, unread, channel)).startswith(
            f"ask 'eyechart doctor SPEC --frames {scored.manifest.bank_path}' whether {what} reaches it; if the"
        )
    assert "exchanged names or a wrong sign" in str(settling(scored, contrary, "instruction"))
    assert "exchanged names or a wrong sign" in html
    assert "its motion with one input changed" in html
    assert html.count("pictures-python-test-policy-tables-unread-") > 0
    assert "another top picture, another wrist picture" in html
    assert "whether its picture reaches it" in html
    command = "".join(
        f"<span>{word}</span> " for word in ("eyechart", "doctor", "SPEC", "--frames", scored.manifest.bank_path)
    )
    assert f'<code class="command">{command.rstrip()}</code> whether its picture reaches it' in html


@pytest.mark.slow
def test_what_was_not_asked_is_to_be_asked(
    scored: PolicyScore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a run that named its conditions; of a whole one more episodes, and another kind of frames for the pose."""
    monkeypatch.syspath_prepend(Path(__file__).parent)
    spec = "python:arms:poses"
    root = Path(scored.bank.root).parent.parent / "bank"
    policy.run(policy.plan(root, [spec], tmp_path / "few", conditions=FEW))
    few = study_of(tmp_path / "few").score(tmp_path / "few", ReadOptions())
    assert str(settling(few, spec, "cameras")).startswith(
        "run the missing conditions (matched@cameras, near@cameras): "
    )
    assert settling(few, spec, "instruction") != settling(few, spec, "cameras")
    policy.run(policy.plan(root.with_name("bank-whole"), [spec], tmp_path / "whole"))
    assert "objects elsewhere" in str(settling(policy.score(tmp_path / "whole"), spec, "cameras"))
    assert str(SETTLE).startswith("ask more episodes")


@pytest.mark.slow
def test_a_channel_that_the_bank_lacks_is_asked_for_in_words(scored: PolicyScore) -> None:
    """With the article that belongs to it."""
    said = str(settling(scored, f"{HERE}:unread", "camera:side"))
    assert said.startswith("use a bank with a picture of the side camera: this one has none")


@pytest.mark.slow
def test_a_camera_that_is_kept_or_noise_is_scored_where_it_is_named(scored: PolicyScore, tmp_path: Path) -> None:
    """All but the top camera from elsewhere changes who goes by its state; noise on the wrist changes nothing."""
    root, spec = Path(scored.bank.root).parent.parent / "bank", "python:arms:reach"
    asked = ("real", "noise@wrist", "noise@top", "kept@camera:top")
    policy.run(policy.plan(root, [spec], tmp_path / "run", conditions=asked))
    statistics = policy.score(tmp_path / "run").models[spec].statistics
    assert statistics["T.noise@wrist"].value == 0
    assert (statistics["T.noise@top"].value or 0) > 0.1
    assert (statistics["T.kept@camera:top"].value or 0) > 0.1


@pytest.mark.parametrize("count", [1, 2, 3, 4, 6, 8, 9])
def test_the_pictures_of_all_cameras_have_a_place_each(count: int) -> None:
    """None upon another, and all on the figure."""
    boxes = _boxes(count)
    assert len(boxes) == count
    for left, low, wide, high in boxes:
        assert 0 <= left < left + wide < 1.45 / 4.4
        assert 0 <= low < low + high <= 3.2 / 3.3
    for place, (left, low, wide, high) in enumerate(boxes):
        for other in boxes[:place]:
            apart = left >= other[0] + other[2] or other[0] >= left + wide
            assert apart or low >= other[1] + other[3] or other[1] >= low + high


def test_what_overturns_the_headline_stands_in_it() -> None:
    """Of who does something else than was logged: in the first sentence, in that of several, and not in green."""
    fine, other = verdict(), replace(verdict(), misfit=2.7)
    assert (
        _answer(other)
        == f"Its error is 2.7 times the log's variance: it does something else than was logged. {_answer(fine)}"
    )
    assert (_tone(fine), _tone(other)) == ("sees", "partly")
    told = in_a_sentence([("a", _does(fine)), ("b", _does(other))])
    assert told.endswith("and 1 looks but does something else than was logged (b).")
