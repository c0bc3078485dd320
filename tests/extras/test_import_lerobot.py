"""A LeRobotDataset whose parts contradict each other, lead outside or are wrong: refused, or left out and said."""

import hashlib
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import photographs
from data_sets import CAMERA, REAR, arm, arrow, describe, film, first_rows, lerobot, places, reach, rewrite, write_table
from eyechart.cli.app import app
from eyechart.errors import EyechartError, SourceError
from eyechart.frames import FrameBank, check, decode, open_bank
from eyechart.importing import Choices, Horizon, costs, import_lerobot
from eyechart.importing.costs import taken
from eyechart.importing.layout import video_of

pytestmark = pytest.mark.models

Rows = list[dict[str, Any]]
VIDEO = f"videos/{CAMERA}/chunk-000/file-000.mp4"
STATE, ACTION = "observation.state", "action"


def bank_of(root: Path, out: str = "bank", *, every: int = 1, camera: str | None = None) -> FrameBank:
    """Import a data set for policies of two steps."""
    ahead = Horizon(2, "absolute")
    return import_lerobot(root, root.parent / out, Choices(every=every), camera=camera, ahead=ahead)


def refused(root: Path, **how: Any) -> str:  # noqa: ANN401 - as of `bank_of`
    """Return the one line with which a data set is refused; nothing is left of the bank."""
    with pytest.raises(EyechartError) as error:
        bank_of(root, "refused", **how)
    assert "\n" not in str(error.value)
    assert not (root.parent / "refused").exists()
    return str(error.value)


def left_out(bank: FrameBank) -> list[str]:
    """Return what the import says of what is left out."""
    return [line for line in taken(bank) if "are left out" in line or "left out of the state" in line]


def as_high(bank: FrameBank) -> bool:
    """Return whether the box in each frame's picture is as high as the gap in its state says."""
    for frame in bank:
        shown = photographs.height(decode(bank.images(frame)["front"], frame.id))
        if abs(shown - photographs.height(photographs.draw(frame.state["state"][0]))) > 2:
            return False
    return True


def swap(rows: Rows, name: str, values: list[Any]) -> None:
    """Put other cells into the first rows of a column."""
    for row, value in zip(rows, values, strict=False):
        row[name] = value


def test_rows_that_do_not_say_which_of_several_tasks_they_are_of_are_refused(tmp_path: Path) -> None:
    """The words of the first task are no words of all; of one task there is no doubt."""
    root = tmp_path / "set"
    arm(root, inside=True)
    words = ["pick", "place"]
    for count in (2, 1):
        write_table(root / "meta/tasks.parquet", {"task_index": [*range(count)], "task": words[:count]})
        for path in sorted((root / "data").rglob("*.parquet")):
            rewrite(path, lambda rows: [{k: v for k, v in row.items() if k != "task_index"} for row in rows])
        if count == 2:
            assert "no column 'task_index' with each row's task" in refused(root)
    bank = bank_of(root, "one")
    assert {frame.fields["task"] for frame in bank} == {"pick"}


# ------------------------------------------------------------------------------------------------- cameras


@pytest.mark.parametrize(
    "marks",
    [
        {"info": {"is_depth_map": True}},
        {"info": {"video.is_depth_map": True}},
        {"video_info": {"video.is_depth_map": True}},
        {"info": {"video.fps": 10}, "video_info": {"video.is_depth_map": True}},
        {"info": {"is_depth_map": 1}},
    ],
)
def test_a_camera_of_depths_is_left_out_by_each_mark_that_lerobot_reads(tmp_path: Path, marks: dict[str, Any]) -> None:
    """In any of three places, and said; a mark that is false is none."""
    arm(tmp_path / "set", inside=False)
    describe(tmp_path / "set", lambda info: info["features"][REAR].update(marks))
    bank = bank_of(tmp_path / "set")
    assert [camera.name for camera in bank.manifest.cameras] == ["front"]
    assert any("rear' is left out: its pictures are marked as depths" in line for line in taken(bank))
    off = {place: dict.fromkeys(of, False) for place, of in marks.items()}
    describe(tmp_path / "set", lambda info: info["features"][REAR].update(off))
    assert [camera.name for camera in bank_of(tmp_path / "set", "both").manifest.cameras] == ["front", "rear"]


def test_a_camera_that_only_looks_like_one_of_depths_is_taken_and_said(tmp_path: Path) -> None:
    """By its one channel, as by its name: nobody marked it."""
    arm(tmp_path / "set", inside=False)
    describe(tmp_path / "set", lambda info: info["features"][REAR].update(shape=[48, 64, 1]))
    bank = bank_of(tmp_path / "set")
    assert [camera.name for camera in bank.manifest.cameras] == ["front", "rear"]
    assert any("rear' looks like a depth camera" in line for line in taken(bank))


def lose_clips(root: Path) -> None:
    """Have meta/episodes say nothing of a camera."""
    rewrite(
        places(root), lambda rows: [{name: row[name] for name in row if f"videos/{REAR}/" not in name} for row in rows]
    )


def lose_films(root: Path) -> None:
    """Remove all films of a camera."""
    for path in (root / "videos" / REAR).rglob("*.mp4"):
        path.unlink()


def lose_column(root: Path) -> None:
    """Declare a camera whose pictures are in the data files, and are not there."""
    describe(root, lambda info: info["features"][REAR].update(dtype="image"))


@pytest.mark.parametrize("lose", [lose_clips, lose_films, lose_column])
def test_a_camera_without_files_is_left_out_and_named(tmp_path: Path, lose: Callable[[Path], None]) -> None:
    """Whoever asks for it alone is told why there is none; where no camera has a picture there is no bank."""
    arm(tmp_path / "set", inside=False)
    lose(tmp_path / "set")
    bank = bank_of(tmp_path / "set")
    assert [camera.name for camera in bank.manifest.cameras] == ["front"]
    assert any(line.startswith(f"camera '{REAR}' is left out: info.json lists it, but ") for line in taken(bank))
    assert "download the data set again" in refused(tmp_path / "set", camera="rear")
    describe(tmp_path / "set", lambda info: info["features"].pop(CAMERA))
    assert "no camera has a picture" in refused(tmp_path / "set")


# ------------------------------------------------------------------------------------- which picture is a row's


def test_the_own_timestamp_of_a_row_says_which_picture_is_its(tmp_path: Path) -> None:
    """A recorder that missed three rows in the middle: the film goes on, and the steps count on."""
    lerobot(tmp_path / "set", length=13)
    describe(tmp_path / "set", lambda info: info["features"].update({ACTION: info["features"][STATE]}))

    def miss(rows: Rows) -> Rows:
        kept = [row | {ACTION: row[STATE]} for row in rows if row["frame_index"] not in {5, 6, 7}]
        return [row | {"frame_index": place % 10} for place, row in enumerate(kept)]

    for path in sorted((tmp_path / "set/data").rglob("*.parquet")):
        rewrite(path, miss)
    rewrite(places(tmp_path / "set"), lambda rows: [row | {"length": 10} for row in rows])
    bank = bank_of(tmp_path / "set")
    assert (len(bank), as_high(bank), check(bank.root)) == (80, True, [])


def test_of_two_pictures_near_a_second_the_nearest_is_taken(tmp_path: Path) -> None:
    """The film has thirty frames a second, the data set ten: the one before is near enough too, and another's."""
    lerobot(tmp_path / "set", episodes=2)
    describe(tmp_path / "set", lambda info: info["features"].update({ACTION: info["features"][STATE]}))
    for file in range(2):
        path = first_rows(tmp_path / "set").with_name(f"file-{file:03d}.parquet")
        rewrite(path, lambda rows: [row | {ACTION: row[STATE]} for row in rows])
        gaps: list[float | None] = []
        rewrite(path, lambda rows: gaps.extend(gap for row in rows for gap in (row[STATE][0], 2.0, 2.0)))  # noqa: B023
        film(tmp_path / "set" / VIDEO.replace("file-000", f"file-{file:03d}"), gaps, 30)
    assert as_high(bank_of(tmp_path / "set"))


def test_a_moment_that_the_film_does_not_show_is_left_out_and_counted(tmp_path: Path) -> None:
    """A row between two pictures belongs to neither of them."""
    arm(tmp_path / "set", inside=False)
    rewrite(first_rows(tmp_path / "set"), lambda rows: swap(rows[3:], "timestamp", [0.345]))
    bank = bank_of(tmp_path / "set")
    assert [frame.id for frame in bank if frame.episode == "0"] == [
        f"episode-0/frame-{step}.png" for step in range(10) if step != 3
    ]
    assert [line.partition(" has no picture")[0] for line in left_out(bank)[-2:]] == [
        "1 of 80 frames are left out: 'front'",
        "1 of 80 frames are left out: 'rear'",
    ]


@pytest.mark.parametrize("cell", [None, {"bytes": None, "path": "x"}, {"bytes": b"GIF89a", "path": "x"}])
def test_a_picture_that_is_none_leaves_out_its_moment(tmp_path: Path, cell: dict[str, Any] | None) -> None:
    """Of one camera, in one row; the others are as they were."""
    arm(tmp_path / "set", inside=True)
    whole = bank_of(tmp_path / "set", "whole")
    rewrite(first_rows(tmp_path / "set"), lambda rows: swap(rows[7:], REAR, [cell]))
    bank = bank_of(tmp_path / "set")
    assert [frame.id for frame in bank] == [frame.id for frame in whole if frame.id != "episode-0/frame-7.png"]
    assert all(bank.images(frame) == whole.images(whole.frame(frame.id)) for frame in bank)
    assert any(line.startswith("1 of 80 frames are left out: 'rear' has no picture of them (") for line in taken(bank))


# ------------------------------------------------------------------------------------------- contradictions


def again(rows: Rows, **other: object) -> Rows:
    """Return rows with the first one again, of which something is another."""
    return [*rows, rows[0] | other]


CONTRADICTIONS: dict[str, tuple[Callable[[Path], object], str]] = {
    "an episode has two places": (
        lambda root: rewrite(places(root), lambda rows: again(rows, **{f"videos/{CAMERA}/from_timestamp": 2.0})),
        "the place of episode 0 in the videos of .*: there are two different values",
    ),
    "an episode has two lengths": (
        lambda root: rewrite(places(root), lambda rows: again(rows, length=9)),
        "the length of episode 0: there are two different values",
    ),
    "two episodes have one place": (
        lambda root: rewrite(places(root), lambda rows: swap(rows[1:], f"videos/{CAMERA}/from_timestamp", [0.0])),
        "episodes 0 and 1 overlap in",
    ),
    "an episode begins a picture too early": (
        lambda root: rewrite(places(root), lambda rows: swap(rows[1:], f"videos/{CAMERA}/from_timestamp", [0.9])),
        "episodes 0 and 1 overlap in .* goes on to 0.900 s, and the second begins at 0.900 s",
    ),
    "an episode ends before its rows": (
        lambda root: rewrite(places(root), lambda rows: swap(rows, f"videos/{CAMERA}/to_timestamp", [0.5])),
        "episode 0 ends at 0.500 s of .*, but its rows go on to 0.900 s",
    ),
    "all begin a picture too late": (
        lambda root: rewrite(
            places(root),
            lambda rows: [
                {name: cell + 0.1 if name.endswith("_timestamp") else cell for name, cell in row.items()}
                for row in rows
            ],
        ),
        "file-000.mp4 ends at 3.900 s, but the data set has rows at 3.975 s",
    ),
    "an episode is shorter than its rows": (
        lambda root: rewrite(places(root), lambda rows: swap(rows, "length", [5])),
        "episode 0 has the length 5, but 10 rows",
    ),
    "an episode is longer than its rows": (
        lambda root: rewrite(places(root), lambda rows: swap(rows, "length", [99999])),
        "episode 0 has the length 99999, but 10 rows",
    ),
    "the rows of an episode stand there twice": (
        lambda root: rewrite(first_rows(root), lambda rows: rows + rows[:10]),
        "row 41: step 0 of episode 0 comes after step 9",
    ),
    "a step stands there twice": (
        lambda root: rewrite(first_rows(root), lambda rows: [*rows[:2], rows[1], *rows[2:]]),
        "row 3: step 1 of episode 0 comes after step 1",
    ),
    "time goes back": (
        lambda root: rewrite(first_rows(root), lambda rows: swap(rows[4:], "timestamp", [0.25])),
        "row 5: step 4 of episode 0 was at 0.25 s by its timestamp, but step 3 at 0.3 s",
    ),
    "the rows are of another rate": (
        lambda root: describe(root, lambda info: info.update(fps=5)),
        "gives 5 frames a second, but the rows of set are 0.1 s apart by their timestamps, which is 10 a second",
    ),
    "two cameras have one film": (
        lambda root: describe(root, lambda info: info.update(video_path=VIDEO)),
        "the cameras .*front' and .*rear' share the video",
    ),
    "a task has two wordings": (
        lambda root: rewrite(root / "meta/tasks.parquet", lambda rows: again(rows, __index_level_0__="stop")),
        "the words of task 0: there are two different values",
    ),
    "a row has another task than its index": (
        lambda root: rewrite(
            root / "data/chunk-000/file-000.parquet", lambda rows: [row | {"task": "park"} for row in rows]
        ),
        "row 1: its task is 'park' by its own column, and 'cross the yard' by its task_index 0",
    ),
    "a task has two words at once": (
        lambda root: rewrite(
            root / "meta/tasks.parquet", lambda rows: [row | {"task": f"task {row['task_index']}"} for row in rows]
        ),
        "task 0 has several words, 'task 0' and 'cross the yard'",
    ),
    "words have no index": (
        lambda root: rewrite(root / "meta/tasks.parquet", lambda rows: again(rows, task_index=None)),
        "'cross the yard' has the task_index None, not a whole number",
    ),
    "an episode is not named": (
        lambda root: rewrite(places(root), lambda rows: rows[:-1]),
        "does not list episode 7, which has 10 rows",
    ),
    "a task has no words": (
        lambda root: rewrite(root / "meta/tasks.parquet", lambda rows: swap(rows, "__index_level_0__", [" "])),
        "has no words of task 0",
    ),
    "a task has a word for nothing": (
        lambda root: rewrite(root / "meta/tasks.parquet", lambda rows: swap(rows, "__index_level_0__", ["nan"])),
        "has no words of task 0",
    ),
    "a row is of a task that is not there": (
        lambda root: rewrite(root / "meta/tasks.parquet", lambda rows: rows[:1]),
        "has no words of task 1",
    ),
}


@pytest.mark.parametrize("name", CONTRADICTIONS)
def test_what_contradicts_the_rest_is_refused(tmp_path: Path, name: str) -> None:
    """Neither source is taken for the truth, also where the rows at fault become no frames."""
    change, said = CONTRADICTIONS[name]
    arm(tmp_path / "set", inside=False)
    change(tmp_path / "set")
    assert re.search(said, refused(tmp_path / "set", every=7)), refused(tmp_path / "set", every=7)


def test_frames_without_words_of_their_task_are_counted_where_nobody_is_told_them(tmp_path: Path) -> None:
    """By the number of the task."""
    lerobot(tmp_path / "set")
    rewrite(tmp_path / "set/meta/tasks.parquet", lambda rows: rows[:1])
    bank = import_lerobot(tmp_path / "set", tmp_path / "bank", Choices())
    assert "40 of 80 frames have no words of their task: meta/tasks.parquet has none of 1" in taken(bank)


def test_other_words_in_the_list_of_episodes_are_named(tmp_path: Path) -> None:
    """An episode may have several tasks, as long as those of its rows are among them."""
    arm(tmp_path / "set", inside=True)
    named = "have tasks by their rows that"
    assert not any(named in line for line in taken(bank_of(tmp_path / "set")))
    rewrite(
        places(tmp_path / "set"),
        lambda rows: [row | {"tasks": ["sleep"] if n == 3 else row["tasks"]} for n, row in enumerate(rows)],
    )
    (line,) = [line for line in taken(bank_of(tmp_path / "set", "other")) if named in line]
    assert "1 episodes" in line
    assert "episode 3 has 'park' by its task_index, and 'sleep' in meta/episodes" in line


@pytest.mark.parametrize("inside", [True, False])
def test_episodes_without_a_row_are_counted_and_named(tmp_path: Path, inside: bool) -> None:  # noqa: FBT001 - a case
    """As where a data file was not downloaded: half of the data set is not the data set."""
    arm(tmp_path / "set", inside=inside)
    (tmp_path / "set/data/chunk-000/file-001.parquet").unlink()
    bank = bank_of(tmp_path / "set")
    assert len(bank) == 40
    assert "4 episodes of meta/episodes have no row in the data files: 4, 5, 6, …" in taken(bank)


def test_two_cameras_that_show_one_picture_are_named(tmp_path: Path) -> None:
    """What hides the one is seen by the other, so that neither of both seems to matter."""
    arm(tmp_path / "set", inside=True)
    words = "cameras 'front' and 'rear' show the same picture in 80 of 80 moments"
    assert [line for line in costs(bank_of(tmp_path / "set")) if words in line]
    for path in sorted((tmp_path / "set/data").rglob("*.parquet")):
        rewrite(path, lambda rows: [row | {REAR: rows[place - 1][REAR]} for place, row in enumerate(rows)])
    assert not [line for line in costs(bank_of(tmp_path / "set", "other")) if "show the same picture in" in line]


def test_an_episode_that_stands_there_once_without_its_length_is_no_contradiction(tmp_path: Path) -> None:
    """What is not said contradicts nothing."""
    arm(tmp_path / "set", inside=True)
    rewrite(places(tmp_path / "set"), lambda rows: [{**rows[0], "length": None}, *rows, {**rows[0], "length": None}])
    assert len(bank_of(tmp_path / "set")) == 80


def test_what_stands_there_twice_alike_is_no_contradiction(tmp_path: Path) -> None:
    """As in a data set that was merged with itself in part."""
    arm(tmp_path / "set", inside=False)
    whole = bank_of(tmp_path / "set", "whole")
    rewrite(places(tmp_path / "set"), lambda rows: rows + rows[:2])
    assert bank_of(tmp_path / "set").manifest.fingerprint == whole.manifest.fingerprint


# ------------------------------------------------------------------------------------------------- bad rows


BAD: dict[str, tuple[str, Any]] = {
    "no number": (STATE, [float("nan"), 1.0]),
    "no end": (ACTION, [float("inf"), 1.0]),
    "too much": (ACTION, [1e300, 1.0]),
    "nothing": (STATE, None),
    "a part": (ACTION, [None, 1.0]),
    "no second": ("timestamp", float("nan")),
    "a second before": ("timestamp", -1.0),
    "no task": ("task_index", 0.5),
    "a task below": ("task_index", -1),
    "no episode": ("episode_index", 0.5),
    "no step": ("frame_index", -4),
}


@pytest.mark.parametrize("name", BAD)
def test_a_row_that_cannot_be_read_leaves_out_its_moment(tmp_path: Path, name: str) -> None:
    """It is counted and named, no motion goes over it, and all other frames are as they were, pictures too."""
    column, cell = BAD[name]
    arm(tmp_path / "set", inside=True)
    whole = bank_of(tmp_path / "set", "whole")
    rewrite(first_rows(tmp_path / "set"), lambda rows: swap(rows[5:], column, [cell]))
    bank = bank_of(tmp_path / "set")
    assert [frame.id for frame in bank] == [frame.id for frame in whole if frame.id != "episode-0/frame-5.png"]
    for frame in bank:
        same = whole.frame(frame.id)
        assert (bank.images(frame), frame.state) == (whole.images(same), same.state)
        assert frame.motion == (() if frame.id == "episode-0/frame-4.png" else same.motion)
    (said,) = left_out(bank)
    assert re.match(rf"1 of 80 rows are left out: '{column}.*' is .* there \(the first is row 6\)", said)


def test_rows_that_are_all_wrong_are_no_bank_and_say_why(tmp_path: Path) -> None:
    """Or that leave no motion between them."""
    arm(tmp_path / "set", inside=True)
    some, every = (lambda rows: rows[::2]), (lambda rows: rows)
    for chosen, said in ((some, "no episode has 2 consecutive steps"), (every, "has no row that can be read")):
        for path in sorted((tmp_path / "set/data").rglob("*.parquet")):
            rewrite(path, lambda rows: swap(chosen(rows), ACTION, [None] * 40))  # noqa: B023
        found = refused(tmp_path / "set")
        assert said in found
        assert "rows are left out: 'action.0' is empty there" in found


def test_a_number_that_no_bank_can_hold_empties_its_cell_where_no_policy_needs_it(tmp_path: Path) -> None:
    """A reward that is infinite is no reason to refuse what a policy is asked by."""
    arm(tmp_path / "set", inside=True)
    for path in sorted((tmp_path / "set/data").rglob("*.parquet")):
        rewrite(
            path, lambda rows: [row | {"next.reward": float("inf") if row["frame_index"] == 9 else 1.0} for row in rows]
        )
    bank = bank_of(tmp_path / "set")
    assert {frame.step for frame in bank if frame.truth["next.reward"] is None} == {9}
    assert any(line.startswith("8 cells of 'next.reward' are left empty") for line in taken(bank))


def test_numbers_that_a_policy_does_not_get_are_named(tmp_path: Path) -> None:
    """Observed beside the state, of another shape, or too many to be one."""
    arm(tmp_path / "set", inside=True)
    more = {
        "observation.environment_state": {"dtype": "float32", "shape": [2], "names": None},
        "observation.tactile": {"dtype": "float32", "shape": [2, 3], "names": None},
        "observation.gripper": {"dtype": "float32", "shape": [1], "names": None},
        "observation.words": {"dtype": "string", "shape": [1], "names": None},
        "next.reward": {"dtype": "float32", "shape": [1], "names": None},
    }
    describe(tmp_path / "set", lambda info: info["features"].update(more))
    said = "left out of the state, which has 'observation.state': 'observation.environment_state' (2 numbers), "
    assert f"{said}'observation.tactile' (2×3 numbers), 'observation.gripper' (1 number)" in taken(
        bank_of(tmp_path / "set")
    )
    describe(tmp_path / "set", lambda info: info["features"][STATE].update(shape=[180]))
    (said,) = left_out(bank_of(tmp_path / "set", "long"))
    assert said.startswith("left out of the state, which has nothing: 'observation.state' (180 numbers), ")
    describe(tmp_path / "set", lambda info: info["features"][ACTION].update(shape=[180]))
    assert "'action' (180 numbers)" in refused(tmp_path / "set")


def test_actions_that_are_not_in_the_motion_are_named(tmp_path: Path) -> None:
    """As those of the wheels beside those of the arms."""
    arm(tmp_path / "set", inside=True)
    more = {"base_action": {"dtype": "float32", "shape": [2], "names": None}, "next.reward": {"dtype": "float32"}}
    describe(tmp_path / "set", lambda info: info["features"].update(more))
    said = [line for line in taken(bank_of(tmp_path / "set")) if "left out of the motion" in line]
    assert said == ["left out of the motion, which has 'action': 'base_action' (2 numbers)"]


def test_places_of_another_unit_or_frame_are_asked_for(tmp_path: Path) -> None:
    """That they are far from the state does not make them changes; who says the kind is believed."""
    pa, pq = arrow()
    ways: dict[str, Callable[[Any], Any]] = {
        "unit": np.radians,
        "frame": lambda joints: np.sin(joints / 4)[:, ::-1],
    }
    for name, way in ways.items():
        reach(tmp_path / name, {})
        for path in sorted((tmp_path / name / "data").rglob("*.parquet")):
            table = pq.read_table(path)
            done = way(np.array(table[ACTION].to_pylist())) + 30
            place = table.schema.get_field_index(ACTION)
            pq.write_table(table.set_column(place, ACTION, pa.array(done.tolist())), path)
        with pytest.raises(SourceError, match=r"the data do not show the kind of the numbers of 'action'"):
            import_lerobot(tmp_path / name, tmp_path / "bank", Choices(), ahead=Horizon(2))
        bank = import_lerobot(tmp_path / name, tmp_path / f"{name}-bank", Choices(), ahead=Horizon(2, "absolute"))
        assert bank.manifest.motion is not None
        assert bank.manifest.motion.kind == "absolute"
        assert costs(bank)


# --------------------------------------------------------------------------------------------------- links


FILES = ("meta/info.json", "meta/tasks.parquet", "data/chunk-000/file-000.parquet", VIDEO)


def in_cache(root: Path, cache: Path) -> Path:
    """Return the snapshot of a data set as the Hub's cache has it: links to files that are named by their contents."""
    snapshot, blobs = cache / "datasets--me--arm/snapshots/0123abc", cache / "datasets--me--arm/blobs"
    blobs.mkdir(parents=True)
    for path in sorted(root.rglob("*")):
        if path.is_file():
            blob = blobs / hashlib.sha256(path.read_bytes()).hexdigest()
            blob.write_bytes(path.read_bytes())
            link = snapshot / path.relative_to(root)
            link.parent.mkdir(parents=True, exist_ok=True)
            link.symlink_to(os.path.relpath(blob, link.parent))
    return snapshot


def test_a_snapshot_in_the_cache_of_the_hub_is_read(tmp_path: Path) -> None:
    """Its files are links to the blobs beside it; the bank is that of the plain folder."""
    arm(tmp_path / "set", inside=False)
    plain = bank_of(tmp_path / "set", "plain")
    snapshot = in_cache(tmp_path / "set", tmp_path / "cache")
    bank = import_lerobot(snapshot, tmp_path / "bank", Choices(), ahead=Horizon(2, "absolute"))
    assert bank.manifest.fingerprint == plain.manifest.fingerprint


@pytest.mark.parametrize("inner", FILES)
@pytest.mark.parametrize("cached", [False, True])
def test_no_link_leads_outside_a_data_set(tmp_path: Path, inner: str, *, cached: bool) -> None:
    """Of no kind of file, of no folder, and also not of a snapshot, nor by a blob that is a link."""
    arm(tmp_path / "set", inside=False)
    root = in_cache(tmp_path / "set", tmp_path / "cache") if cached else tmp_path / "set"
    kept = tmp_path / "elsewhere" / Path(inner).name
    kept.parent.mkdir()
    (root / inner).resolve().rename(kept)
    (root / inner).resolve().symlink_to(kept)
    assert "leads outside the data set" in refused(root)
    (root / inner).unlink()
    (root / inner).parent.rename(tmp_path / "elsewhere/folder")
    (tmp_path / "elsewhere/folder" / Path(inner).name).symlink_to(kept)
    (root / inner).parent.symlink_to(tmp_path / "elsewhere/folder", target_is_directory=True)
    assert "leads outside the data set" in refused(root)


@pytest.mark.parametrize("inner", FILES)
def test_a_link_may_lead_inside_a_data_set(tmp_path: Path, inner: str) -> None:
    """As of one who keeps his films in another folder of it; a link to nothing is said."""
    arm(tmp_path / "set", inside=False)
    plain = bank_of(tmp_path / "set", "plain")
    (tmp_path / "set/kept").mkdir()
    kept = (tmp_path / "set" / inner).rename(tmp_path / "set/kept" / Path(inner).name)
    (tmp_path / "set" / inner).symlink_to(kept)
    assert bank_of(tmp_path / "set").manifest.fingerprint == plain.manifest.fingerprint
    kept.unlink()
    assert re.search("does not exist|link to nothing", refused(tmp_path / "set"))


def test_a_film_is_no_list_of_others(tmp_path: Path) -> None:
    """A list that FFmpeg would play names files, or addresses, of anybody."""
    arm(tmp_path / "set", inside=False)
    one = tmp_path / "set" / VIDEO
    one.rename(one.with_name("other.mp4"))
    for words in ("ffconcat version 1.0\nfile other.mp4\n", "#EXTM3U\n#EXTINF:4,\nother.mp4\n#EXT-X-ENDLIST\n"):
        one.write_text(words)
        assert "file-000.mp4 cannot be read as a video" in refused(tmp_path / "set")


# ------------------------------------------------------------------------------------- templates, cells, bounds


TEMPLATES = (
    "{chunk_index:>30000000}",
    "{chunk_index:.9999999f}",
    "{chunk_index:09999999d}",
    "{chunk_index[0]}",
    "{video_key[abc]}",
    "videos/{video_key.__class__.__mro__}",
    "{chunk_index:{file_index}}",
    "{chunk_index!r}",
    "{video_key:03d}",
    "{episode_index}",
    "{}",
    "{",
    "",
)


@pytest.mark.parametrize("template", TEMPLATES)
def test_a_template_of_another_s_is_no_code(tmp_path: Path, template: str) -> None:
    """Only three names in braces are replaced; the rest of Python's language for templates is refused in words."""
    arm(tmp_path / "set", inside=False)
    describe(tmp_path / "set", lambda info: info.update(video_path=template))
    assert "meta/info.json: video_path" in refused(tmp_path / "set")


def test_a_template_s_names_are_replaced_and_what_they_bring_is_not() -> None:
    """With zeros at their head, as many as are asked for; braces in a camera's name are its own."""
    template = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index}.mp4"
    assert video_of(template, "front", chunk_index=7, file_index=12) == "videos/front/chunk-007/file-12.mp4"
    assert (
        video_of(template, "{chunk_index:09d}", chunk_index=1, file_index=5)
        == "videos/{chunk_index:09d}/chunk-001/file-5.mp4"
    )


START, CHUNK = f"videos/{CAMERA}/from_timestamp", f"videos/{CAMERA}/chunk_index"


def begin(second: object) -> Callable[[Path], object]:
    """Return what has the first episode begin at another second of its video."""
    return lambda root: rewrite(places(root), lambda rows: swap(rows, START, [second]))


CELLS: dict[str, tuple[Callable[[Path], object], str]] = {
    "fps tiny": (lambda root: describe(root, lambda info: info.update(fps=1e-308)), "1e-308 frames a second"),
    "fps vast": (lambda root: describe(root, lambda info: info.update(fps=1e308)), r"1e\+308 frames a second"),
    "fps words": (lambda root: describe(root, lambda info: info.update(fps="x")), "Expected `float`, got `str`"),
    "features": (lambda root: describe(root, lambda info: info.update(features=[1])), "Expected `object`"),
    "start inf": (begin(float("inf")), "is inf, not a second"),
    "start vast": (begin(1e300), "1e\\+300, not a second"),
    "start nan": (begin(float("nan")), "is nan, not a second"),
    "start gone": (begin(None), "is empty"),
    "chunk words": (
        lambda root: rewrite(places(root), lambda rows: swap(rows, CHUNK, ["9" * 9] * 8)),
        "chunk_index' is '999999999', not a whole number",
    ),
    "episode words": (
        lambda root: rewrite(places(root), lambda rows: swap(rows, "episode_index", ["x"] * 8)),
        "'episode_index' is 'x', not a whole number",
    ),
    "length words": (
        lambda root: rewrite(places(root), lambda rows: swap(rows, "length", [0.5] * 8)),
        "'length' is 0.5, not a whole number",
    ),
}


@pytest.mark.parametrize("name", CELLS)
def test_a_value_that_cannot_be_is_said_in_words(tmp_path: Path, name: str) -> None:
    """Which file, which column, and what stands there."""
    change, said = CELLS[name]
    arm(tmp_path / "set", inside=False)
    change(tmp_path / "set")
    assert re.search(said, refused(tmp_path / "set"))


READ = """
import json, os, sys
from pathlib import Path
from eyechart.errors import SourceError
from eyechart.importing import Horizon, Choices, import_lerobot
root, *names = map(Path, sys.argv[1:])
for name in names:
    kept = (root / name).rename(root / "kept")
    os.mkfifo(root / name)
    try:
        import_lerobot(root, root.parent / "bank", Choices(), ahead=Horizon(2, "absolute"))
    except SourceError as error:
        print(error)
    (root / name).unlink()
    kept.rename(root / name)
path = root / "meta/info.json"
text = path.read_text()
info = json.loads(text)
cameras = {f"cam{number}": info["features"]["observation.images.front"] for number in range(1900)}
for made in (text[:-1] + ',"pad":[' + "[]," * 20_000_000 + "1]}", json.dumps({**info, "features": cameras})):
    path.write_text(made)
    del made
    try:
        import_lerobot(root, root.parent / "bank", Choices(), ahead=Horizon(2, "absolute"))
    except SourceError as error:
        print(error)
"""


def test_nothing_hangs_and_nothing_grows_without_bound(tmp_path: Path) -> None:
    """A pipe in the place of each file, sixty megabytes of empty lists, 1900 cameras: a line each, within 20 s."""
    arm(tmp_path / "set", inside=False)
    limited = f"import resource; resource.setrlimit(resource.RLIMIT_AS, (3 * 2**30,) * 2)\n{READ}"
    words = [sys.executable, "-c", limited, str(tmp_path / "set"), *FILES]
    lines = subprocess.run(words, check=True, capture_output=True, text=True, timeout=60).stdout.splitlines()
    assert [line.endswith("is not a regular file") for line in lines] == [True] * 4 + [False] * 2
    assert lines[4].endswith("info.json has more than 4000000 bytes, too many for the description of a data set")
    assert lines[5].endswith("info.json lists 1900 cameras; the limit is 64")


def test_a_data_set_is_recognised_without_its_format(tmp_path: Path) -> None:
    """By a file of its folder; with it, all is as it was, and an option of a table is refused by its name."""
    lerobot(tmp_path / "set", episodes=4, length=6)
    told = ("frames", "import", str(tmp_path / "set"), "--every", "2")
    banks = []
    for name, more in (("told", ("--format", "lerobot")), ("found", ())):
        done = CliRunner().invoke(app, [*told, *more, "--out", str(tmp_path / name)])
        assert done.exit_code == 0, done.output
        banks.append(open_bank(tmp_path / name))
    assert banks[0].manifest.fingerprint == banks[1].manifest.fingerprint
    refused = CliRunner().invoke(app, [*told, "--convert", "--out", str(tmp_path / "bank")])
    assert "--convert is for the pictures of --table" in str(refused.exception)
    assert not (tmp_path / "bank").exists()
