"""A LeRobotDataset v2.0 or v2.1, and GR00T's: the same bank as of version 3, or one line that says what is wrong."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from data_sets import CAMERA, REAR, arm, arrow, describe, first_rows, lerobot, of_episodes, rewrite, write_lines
from eyechart.errors import EyechartError, SourceError, SpecError
from eyechart.frames import FrameBank
from eyechart.importing import Choices, Horizon, import_lerobot
from eyechart.importing.costs import taken

pytestmark = pytest.mark.models

AHEAD = Horizon(2, "absolute")


def bank_of(root: Path, out: str = "bank", ahead: Horizon = AHEAD) -> FrameBank:
    """Import a data set for policies."""
    return import_lerobot(root, root.parent / out, Choices(), ahead=ahead)


def of_arm(root: Path, *, inside: bool = False, **how: Any) -> list[float]:  # noqa: ANN401 - as of `of_episodes`
    """Write an arm's data set of version 2; return its gaps."""
    arm(root, inside=inside)
    gaps = lerobot(root.parent / "gaps")
    of_episodes(root, gaps=gaps, **how)
    return gaps


def seen(bank: FrameBank) -> list[tuple[Any, ...]]:
    """Return all that a bank says of each frame, and the bytes of its pictures."""
    return [(one.id, one.fields, one.state, one.motion, bank.images(one)) for one in bank]


@pytest.mark.parametrize("inside", [True, False])
@pytest.mark.parametrize("version", ["v2.0", "v2.1"])
def test_versions_2_and_3_of_one_data_set_are_one_bank(tmp_path: Path, version: str, *, inside: bool) -> None:
    """States, motions, words and pictures inside the data are the same; films differ as they were encoded anew."""
    arm(tmp_path / "three", inside=inside)
    of_arm(tmp_path / "two", inside=inside, version=version)
    three, two = bank_of(tmp_path / "three", "a"), bank_of(tmp_path / "two", "b")
    if inside:
        assert seen(two) == seen(three)
    assert [one[:4] for one in seen(two)] == [one[:4] for one in seen(three)]
    assert {one.fields["task"] for one in two} == {"cross the yard", "park"}
    assert (three.manifest.settings["format"], two.manifest.settings["format"]) == ("lerobot v3", "lerobot v2")


def test_rows_that_nobody_numbered_are_numbered_by_their_order(tmp_path: Path) -> None:
    """As GR00T's; a file of two episodes is then refused."""
    of_arm(tmp_path / "set", inside=True, numbered=False)
    of_arm(tmp_path / "numbered", inside=True)
    assert seen(bank_of(tmp_path / "set")) == seen(bank_of(tmp_path / "numbered", "b"))
    path = tmp_path / "set/data/chunk-000/episode_000000.parquet"
    rewrite(path, lambda rows: [row | {"episode_index": place // 5} for place, row in enumerate(rows)])
    with pytest.raises(SourceError, match=r"episode_000000\.parquet has rows of several episodes, but no column"):
        bank_of(tmp_path / "set", "refused")


def test_what_gr00t_calls_the_description_of_the_task_is_the_instruction(tmp_path: Path) -> None:
    """Not LeRobot's own number of a task, and not what grades the episode."""
    root = tmp_path / "set"
    of_arm(root, inside=True, numbered=False)
    own = {"annotation.human.validity": 1, "annotation.human.action.task_description": 2, "task_index": 0}
    for path in (root / "data").rglob("*.parquet"):
        rewrite(path, lambda rows: [row | own for row in rows])
    words = ["drive", "valid", "pick the pear"]
    write_lines(root / "meta/tasks.jsonl", [{"task_index": place, "task": word} for place, word in enumerate(words)])
    named: dict[str, Any] = {"annotation": {"human.validity": {}, "human.action.task_description": {}}}
    (root / "meta/modality.json").write_text(json.dumps(named))
    assert {one.fields["task"] for one in bank_of(root)} == {"pick the pear"}
    named["annotation"]["human.action.task_description"]["original_key"] = "task_index"
    (root / "meta/modality.json").write_text(json.dumps(named))
    assert {one.fields["task"] for one in bank_of(root, "b")} == {"drive"}


def test_a_camera_without_films_is_left_out(tmp_path: Path) -> None:
    """As GR00T's own demonstrations list one under two names."""
    of_arm(tmp_path / "set")
    for path in (tmp_path / "set/videos").rglob(f"{REAR}/*.mp4"):
        path.unlink()
    bank = bank_of(tmp_path / "set")
    assert [camera.name for camera in bank.manifest.cameras] == ["front"]
    assert any("rear' is left out: info.json lists it, but none of its videos exists" in one for one in taken(bank))


def torn(root: Path, inner: str) -> None:
    """Cut a file of lines in the middle of one."""
    path = root / inner
    path.write_bytes(path.read_bytes()[:-20])


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda root: torn(root, "meta/episodes.jsonl"), "meta/episodes.jsonl, line 8: "),
        (lambda root: torn(root, "meta/tasks.jsonl"), "meta/tasks.jsonl, line 2: "),
        (
            lambda root: write_lines(root / "meta/episodes.jsonl", [{"episode_index": -1}]),
            "line 1: Expected `int` >= 0",
        ),
        (lambda root: write_lines(root / "meta/episodes.jsonl", []), "has no episode"),
        (
            lambda root: write_lines(
                root / "meta/episodes.jsonl", [{"episode_index": 0, "length": one} for one in (9, 10)]
            ),
            "the length of episode 0: there are two",
        ),
        (
            lambda root: write_lines(root / "meta/tasks.jsonl", [{"task_index": 0, "task": one} for one in "ab"]),
            "meta/tasks.jsonl: the words of task 0: there are two",
        ),
        (lambda root: (root / "data/chunk-000/episode_000001.parquet").unlink(), None),
        (lambda root: (root / f"videos/chunk-000/{CAMERA}/episode_000001.mp4").unlink(), "episode_000001.mp4 does not"),
        (
            lambda root: describe(root, lambda info: info.update(video_path="videos/{chunk_index}/{video_key}.mp4")),
            "is no path with video_key, episode_chunk and episode_index in braces",
        ),
        (
            lambda root: describe(root, lambda info: info.update(video_path="videos/{episode_index}.mp4")),
            "share the video",
        ),
        (lambda root: describe(root, lambda info: info.update(video_path="../{video_key}/{episode_index}")), "outside"),
        (lambda root: describe(root, lambda info: info.update(chunks_size=0)), "chunks_size"),
        (
            lambda root: describe(root, lambda info: info.update(codebase_version="v1.6")),
            "eyechart reads v2.0, v2.1 and v3",
        ),
    ],
)
def test_what_is_wrong_is_one_line_and_leaves_nothing(
    tmp_path: Path, spoil: Callable[[Path], object], said: str | None
) -> None:
    """The line names the file; an episode without rows is said, and the others are taken."""
    of_arm(tmp_path / "set")
    spoil(tmp_path / "set")
    if said is None:
        assert any("1 episodes of meta/episodes.jsonl have no row" in one for one in taken(bank_of(tmp_path / "set")))
        return
    with pytest.raises(EyechartError) as refused:
        bank_of(tmp_path / "set")
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)
    assert not (tmp_path / "bank").exists()


def renamed(root: Path, names: dict[str, str]) -> None:
    """Call columns of the data and features otherwise."""
    _, pq = arrow()
    for path in (root / "data").rglob("*.parquet"):
        table = pq.read_table(path)
        pq.write_table(
            table.rename_columns([names.get(column_name, column_name) for column_name in table.column_names]), path
        )
    describe(root, lambda info: info.update(features={names.get(one, one): of for one, of in info["features"].items()}))


def test_state_and_action_are_found_by_their_usual_names_or_by_those_that_are_given(tmp_path: Path) -> None:
    """Vectors of other names, and in parts; the motions stay the same."""
    arm(tmp_path / "set", inside=True)
    usual = [(one.state, one.motion) for one in bank_of(tmp_path / "set", "usual")]
    renamed(tmp_path / "set", {"observation.state": "state", "action": "actions"})
    assert [(one.state, one.motion) for one in bank_of(tmp_path / "set", "plural")] == usual
    renamed(tmp_path / "set", {"state": "proprio", "actions": "control"})
    with pytest.raises(SourceError, match=r"lists no feature 'action' .*; name the feature, .* action"):
        bank_of(tmp_path / "set", "unnamed")
    given = Horizon(2, "absolute", ("proprio",), ("control",))
    assert [(one.state, one.motion) for one in bank_of(tmp_path / "set", "given", given)] == usual
    with pytest.raises(SourceError, match=r"state propio: .* no such feature .*proprio"):
        bank_of(tmp_path / "set", "misspelt", Horizon(2, "absolute", ("propio",), ("control",)))
    with pytest.raises(SourceError, match=r"^state names 'proprio' twice; name each feature once"):
        bank_of(tmp_path / "set", "twice", Horizon(2, "absolute", ("proprio", "proprio"), ("control",)))


def test_a_state_in_parts_is_one_state(tmp_path: Path) -> None:
    """Of two features in the order of info.json; a number of its own is a part as a vector is."""
    pa, pq = arrow()
    arm(tmp_path / "set", inside=True)
    whole = bank_of(tmp_path / "set", "whole")
    path = first_rows(tmp_path / "set")
    for path in sorted((tmp_path / "set/data").rglob("*.parquet")):
        table = pq.read_table(path)
        for name, of in (("observation.state", ("arm", "grip")), ("action", ("arm", "grip"))):
            numbers = table[name].to_pylist()
            table = table.drop_columns([name])
            for place, part in enumerate(of):
                table = table.append_column(
                    f"{name}.{part}", pa.array([number[place] for number in numbers], pa.float64())
                )
        pq.write_table(table, path)

    def parts(info: Any) -> None:  # noqa: ANN401 - info.json
        for name in ("observation.state", "action"):
            del info["features"][name]
            info["features"] |= {f"{name}.{part}": {"dtype": "float64", "shape": [1]} for part in ("arm", "grip")}

    describe(tmp_path / "set", parts)
    bank = bank_of(tmp_path / "set", "parts")
    assert [(one.state, one.motion) for one in bank] == [(one.state, one.motion) for one in whole]
    assert not any("left out of the state" in one for one in taken(bank))


def test_names_of_features_need_motions() -> None:
    """A bank of answers has no state."""
    from eyechart.cli.frames import SourceDescription  # noqa: PLC0415 - what the command line gives

    with pytest.raises(SpecError, match="--state describes the motions of --horizon: give --horizon too"):
        SourceDescription(state="proprio").own()
