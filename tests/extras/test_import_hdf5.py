"""Demonstrations in HDF5: what was written is what the bank has; hostile or contradictory files are refused by name."""

import io
import os
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from demonstrations import EPISODES, LENGTH, act, h5py, jpeg, robomimic, shots, walk
from eyechart.cli.app import app
from eyechart.errors import EyechartError, SourceError
from eyechart.frames import FrameBank, decode
from eyechart.importing import Choices, Horizon, import_hdf5
from eyechart.importing.costs import taken

pytestmark = pytest.mark.models

DEMO = "data/demo_1"


def bank_of(source: Path, ahead: Horizon | None = None, **how: Any) -> FrameBank:  # noqa: ANN401 - as of `import_hdf5`
    """Import a source for policies of two steps."""
    return import_hdf5(source, source.parent / how.pop("out", "bank"), Choices(), ahead=ahead or Horizon(2), **how)


def written(bank: FrameBank, state: Callable[[int], Any], action: Callable[[int], Any]) -> bool:
    """Return whether every frame has the state and motion of its row, to the bit."""
    for frame in bank:
        episode, step = int(frame.episode), frame.step
        if [*frame.state["state"]] != state(episode)[step].tolist():
            return False
        if frame.motion and [[*row] for row in frame.motion] != action(episode)[step : step + 2].tolist():
            return False
    return sum(bool(frame.motion) for frame in bank) == EPISODES * (LENGTH - 1)


def changes(episode: int) -> Any:  # noqa: ANN401 - of NumPy
    """Return the actions that `robomimic` writes."""
    places = walk(episode, 7)
    return np.diff(places, axis=0, append=places[-1:]).astype(np.float64)


def pictured(bank: FrameBank, cameras: list[str]) -> bool:
    """Return whether every frame shows what was written for it, to the bit."""
    return [one.name for one in bank.manifest.cameras] == cameras and all(
        np.array_equal(decode(bank.images(frame)[name], frame.id), shots(int(frame.episode), seed)[frame.step])
        for frame in bank
        for seed, name in enumerate(cameras)
    )


def test_robomimic_is_read_to_the_bit(tmp_path: Path) -> None:
    """With its rate, its usual state, and a note of what the state leaves out."""
    bank = bank_of(robomimic(tmp_path / "low.hdf5"), Horizon(2, "delta"))
    assert written(bank, lambda one: walk(one, 7)[:, [0, 1, 2, 0, 1, 2, 3, 0, 1]], changes)
    assert pictured(bank, ["agentview_image", "robot0_eye_in_hand_image"])
    assert bank.manifest.motion is not None
    assert bank.manifest.motion.rate_hz == 20
    assert bank.manifest.settings["format"] == "hdf5 robomimic"
    said = "\n".join(taken(bank))
    assert "'object' (10 numbers)" in said
    assert "may be upside down" in said
    assert not any("task" in frame.fields for frame in bank)


def test_libero_is_read_to_the_bit_with_its_instruction(tmp_path: Path) -> None:
    """Each file of a folder has its own; the words may be a list of letters."""
    for place, words in enumerate(("open the drawer", '"close it"')):
        (tmp_path / "set").mkdir(exist_ok=True)
        robomimic(tmp_path / f"set/task_{place}.hdf5", libero=True, words=words)
    bank = bank_of(tmp_path / "set/task_0.hdf5", out="one")
    assert written(bank, lambda one: walk(one, 7)[:, [0, 1, 0, 1, 2, 3, 4, 5, 6]], changes)
    assert pictured(bank, ["agentview_rgb", "eye_in_hand_rgb"])
    assert any("kind: delta, as the data tell" in line for line in taken(bank))
    both = import_hdf5(tmp_path / "set", tmp_path / "both", Choices(keep_repeats=True), ahead=Horizon(2))
    assert {int(one.episode) // EPISODES: one.fields["task"] for one in both} == {0: "open the drawer", 1: "close it"}
    named = bank_of(tmp_path / "set/task_0.hdf5", Horizon(2, "delta", ("ee_states",)), camera="agentview_rgb", out="n")
    assert written(named, lambda one: walk(one, 7)[:, :6], changes)
    assert pictured(named, ["agentview_rgb"])


def test_act_is_read_to_the_bit(tmp_path: Path) -> None:
    """A file is an episode, ten is after two, and the rate is the user's to say."""
    act(tmp_path / "set")
    (tmp_path / "set/episode_5.hdf5").rename(tmp_path / "set/episode_10.hdf5")
    with pytest.raises(EyechartError, match="rate"):
        bank_of(tmp_path / "set", out="none")
    bank = bank_of(tmp_path / "set", rate=50)
    assert written(bank, lambda one: walk(one, 14), lambda one: np.vstack([walk(one, 14)[1:], walk(one, 14)[-1:]]))
    assert pictured(bank, ["cam_high", "cam_left_wrist"])
    assert bank.manifest.motion is not None
    assert bank.manifest.motion.kind == "absolute"


def test_actions_beside_those_that_are_read_are_named(tmp_path: Path) -> None:
    """As Mobile ALOHA writes those of its wheels, also where only one file has them."""
    act(tmp_path / "set")
    assert not any("beside" in line for line in taken(bank_of(tmp_path / "set", rate=50, out="without")))
    with h5py().File(tmp_path / "set/episode_3.hdf5", "a") as file:
        file["base_action"] = np.ones((LENGTH, 2))
    assert "left out, beside 'action': 'base_action'" in taken(bank_of(tmp_path / "set", rate=50))


def test_encoded_pictures_of_act_are_decoded_without_their_padding(tmp_path: Path) -> None:
    """Files may be padded to different lengths."""
    bank = bank_of(act(tmp_path / "set", compressed=True), rate=50)
    for frame in bank:
        for seed, name in enumerate(("cam_high", "cam_left_wrist")):
            own = np.asarray(Image.open(io.BytesIO(jpeg(shots(int(frame.episode), seed)[frame.step]))).convert("RGB"))
            assert np.array_equal(decode(bank.images(frame)[name], frame.id), own)


def test_rows_and_cameras_that_cannot_be_used_are_left_out_and_named(tmp_path: Path) -> None:
    """NaN in a state, depths, and pictures of one channel."""
    path = robomimic(tmp_path / "low.hdf5")
    with h5py().File(path, "a") as file:
        file[f"{DEMO}/obs/robot0_eef_pos"][3] = np.nan
        for group in file["data"].values():
            group["obs/agentview_depth"] = np.zeros((LENGTH, 16, 24, 1), np.float32)
            group["obs/mask_image"] = np.zeros((LENGTH, 16, 24, 1), np.uint8)
    bank = bank_of(path, Horizon(2, "delta"))
    said = "\n".join(taken(bank))
    assert len(bank) == EPISODES * LENGTH - 1
    assert "1 of 72 rows are left out: 'robot0_eef_pos.0' is nan there" in said
    assert "'agentview_depth' is left out: its pictures are depths" in said
    assert "'mask_image' is left out" in said


def test_a_file_is_recognised_without_its_format(tmp_path: Path) -> None:
    """So is a folder of them."""
    robomimic(tmp_path / "low.hdf5")
    act(tmp_path / "set")
    for source, more in (("low.hdf5", ["--kind", "delta"]), ("set", ["--rate", "50"])):
        out = str(tmp_path / f"bank-{source}")
        asked = ["frames", "import", str(tmp_path / source), "--horizon", "2", *more, "--out", out]
        result = CliRunner().invoke(app, asked)
        assert result.exit_code == 0, result.output


def edit(change: Callable[[Any], None]) -> Callable[[Path], None]:
    """Return what changes an open file."""

    def done(path: Path) -> None:
        with h5py().File(path, "a") as file:
            change(file)

    return done


def put(name: str, **made: Any) -> Callable[[Any], None]:  # noqa: ANN401 - of h5py
    """Return what replaces an array of the second episode by an empty one of other properties."""

    def done(file: Any) -> None:  # noqa: ANN401 - of h5py
        del file[f"{DEMO}/{name}"]
        file[DEMO].create_dataset(name, **made)

    return done


def link(to: Any) -> Callable[[Any], None]:  # noqa: ANN401 - of h5py
    """Return what replaces an array by a link."""

    def done(file: Any) -> None:  # noqa: ANN401 - of h5py
        del file[f"{DEMO}/obs/object"]
        file[f"{DEMO}/obs/object"] = to(h5py())

    return done


def virtual(file: Any) -> None:  # noqa: ANN401 - of h5py
    """Show an array of another file."""
    del file[f"{DEMO}/obs/object"]
    layout = h5py().VirtualLayout((LENGTH, 10), "f4")
    layout[:] = h5py().VirtualSource("other.hdf5", "x", (LENGTH, 10))
    file.create_virtual_dataset(f"{DEMO}/obs/object", layout)


def bomb(file: Any) -> None:  # noqa: ANN401 - of h5py
    """Put a chunk that unpacks to 300 times of what it declares."""
    name = f"{DEMO}/obs/object"
    del file[name]
    array = file.create_dataset(name, (LENGTH, 10), "f4", chunks=(LENGTH, 10), compression="gzip")
    array.id.write_direct_chunk((0, 0), zlib.compress(bytes(150_000)))


def objects(file: Any) -> None:  # noqa: ANN401 - of h5py
    """Put pickled or encoded objects of any length."""
    del file[f"{DEMO}/obs/object"]
    array = file.create_dataset(f"{DEMO}/obs/object", (LENGTH,), h5py().vlen_dtype(np.uint8))
    array[0] = np.zeros(3, np.uint8)


def told(name: str, value: object) -> Callable[[Any], None]:
    """Return what sets an attribute of the group of episodes."""
    return lambda file: file["data"].attrs.__setitem__(name, value)


def cut(path: Path) -> None:
    """Lose the second half of a file."""
    os.truncate(path, path.stat().st_size // 2)


def damaged(path: Path) -> None:
    """Keep the first bytes alone."""
    path.write_bytes(b"\x89HDF\r\n\x1a\nnothing")


def piped(path: Path) -> None:
    """Put a pipe, which nobody writes to."""
    path.unlink()
    os.mkfifo(path)


def observed(name: str) -> Callable[[Any], None]:
    """Return what adds an observation of whole numbers to every episode, last episode first."""

    def done(file: Any) -> None:  # noqa: ANN401 - of h5py
        for place, group in enumerate(file["data"].values()):
            group[f"obs/{name}"] = np.full(LENGTH, EPISODES - 1 - place)

    return done


def empty(file: Any) -> None:  # noqa: ANN401 - of h5py
    """Add pictures without pixels to every episode."""
    for group in file["data"].values():
        group["obs/no_image"] = np.zeros((LENGTH, 0, 0, 3), np.uint8)


def lone(file: Any) -> None:  # noqa: ANN401 - of h5py
    """Put an array in the place of an episode."""
    del file[DEMO]
    file[DEMO] = np.zeros(3)


def misnamed(file: Any) -> None:  # noqa: ANN401 - of h5py
    """Add an observation whose name is no text."""
    module = h5py()
    space = module.h5s.create_simple((LENGTH,))
    module.h5d.create(file[f"{DEMO}/obs"].id, b"\xff\xfe", module.h5t.NATIVE_DOUBLE, space)


WRONG: dict[str, tuple[Callable[[Path], None], str]] = {
    "external link": (edit(link(lambda h5: h5.ExternalLink("/etc/passwd", "/x"))), "obs/object': it is a link"),
    "soft link": (edit(link(lambda h5: h5.SoftLink("/data/demo_0/obs/object"))), "obs/object': it is a link"),
    "link to nothing": (edit(link(lambda h5: h5.SoftLink("/nothing"))), "obs/object': it is a link"),
    "virtual": (edit(virtual), "in other files"),
    "raw file": (
        edit(put("obs/object", shape=(LENGTH, 10), dtype="f4", external=[("/etc/passwd", 0, 480)])),
        "in other files",
    ),
    "objects": (edit(objects), "of type object"),
    "struct": (edit(put("obs/object", shape=(LENGTH,), dtype=[("a", "f4")])), "are no numbers"),
    "complex": (edit(put("obs/object", shape=(LENGTH, 10), dtype="c8")), "are no numbers"),
    "declared only": (edit(put("obs/agentview_image", shape=(LENGTH, 16, 24, 3), dtype="u1")), "the file holds 0"),
    "huge": (edit(put("actions", shape=(10**12, 7), dtype="f4", chunks=(9, 7))), "the limit is 20000000 rows"),
    "holes": (
        edit(put("actions", shape=(10**7, 7), dtype="f4", chunks=(9, 7))),
        "chunks of values, and the file holds",
    ),
    "great chunk": (
        edit(put("actions", shape=(LENGTH, 7), maxshape=(None, 7), dtype="f4", chunks=(10**7, 7), compression="gzip")),
        "its chunks have 280000000 bytes",
    ),
    "other packing": (
        edit(put("actions", data=np.zeros((LENGTH, 7)), chunks=(9, 7), compression="lzf")),
        "not compressed by gzip alone",
    ),
    "bomb": (edit(bomb), "the chunk at row 0 unpacks to more than its 480 bytes"),
    "lengths": (edit(put("actions", data=np.zeros((LENGTH - 1, 7)))), f"has {LENGTH} rows, but the actions have 11"),
    "declared length": (edit(lambda file: file[DEMO].attrs.modify("num_samples", 5)), "num_samples 5, but 12 actions"),
    "other sizes": (edit(put("actions", data=np.zeros((LENGTH, 5)))), r"'actions' is float64 \[5\], and float64 \[7\]"),
    "fewer arrays": (edit(lambda file: file[f"{DEMO}/obs"].__delitem__("object")), "'object' is none"),
    "no actions": (edit(lambda file: file[DEMO].__delitem__("actions")), "has no array 'actions'"),
    "faulty rate": (edit(told("env_args", "{")), "the attribute 'env_args' is no JSON"),
    "no rate": (edit(told("env_args", "{}")), "the files do not have it"),
    "no words": (edit(told("problem_info", "{}")), "has no language_instruction"),
    "long attribute": (edit(told("env_args", "x" * 2_000_000)), "env_args'"),
    "another layout": (edit(lambda file: file.move("data", "other")), "has neither data/demo_N"),
    "cut": (cut, "cannot be read as HDF5"),
    "no HDF5": (damaged, "cannot be read as HDF5"),
    **{
        f"own column {name}": (edit(observed(name)), f"has an array '{name}', which is a column of its own")
        for name in ("episode_index", "frame_index", "task_index", "task", "file", "robot0_eef_pos.0")
    },
    "two instructions": (
        edit(told("problem_info", '{"language_instruction": ["open it", "close it"]}')),
        "has 2 texts; a file has one",
    ),
    "quotes alone": (edit(told("problem_info", r'{"language_instruction": "\"\""}')), "has no language_instruction"),
    "great rate": (edit(told("env_args", f'{{"env_kwargs": {{"control_freq": 1{"0" * 400}}}}}')), "the control_freq"),
    "empty pictures": (edit(empty), "'no_image' has pictures of 0 values"),
    "odd name": (edit(misnamed), "is no UTF-8 text"),
    "episode without arrays": (edit(lone), "data/demo_1 is no group"),
    "pipe": (piped, "a pipe or a device"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_hostile_or_contradictory_file_is_refused_by_name(tmp_path: Path, name: str) -> None:
    """Before it costs memory, and nothing is left of the bank."""
    change, why = WRONG[name]
    change(robomimic(tmp_path / "low.hdf5"))
    with pytest.raises(SourceError, match=why) as error:
        bank_of(tmp_path / "low.hdf5", Horizon(2, "delta"))
    assert "\n" not in str(error.value)
    assert not (tmp_path / "bank").exists()


def test_a_file_without_a_rate_does_not_take_that_of_another(tmp_path: Path) -> None:
    """The user says it for all."""
    (tmp_path / "set").mkdir()
    for name in ("a", "b"):
        robomimic(tmp_path / f"set/{name}.hdf5")
    edit(told("env_args", "{}"))(tmp_path / "set/b.hdf5")
    with pytest.raises(SourceError, match=r"rate=N \(the files have 20, and some have none\)"):
        bank_of(tmp_path / "set", Horizon(2, "delta"))


def test_a_contradicting_rate_and_mixed_folders_are_refused(tmp_path: Path) -> None:
    """A folder is of one program, and no link leads out of it."""
    robomimic(tmp_path / "low.hdf5")
    with pytest.raises(EyechartError, match="contradicts the control_freq 20"):
        bank_of(tmp_path / "low.hdf5", rate=10)
    act(tmp_path / "set")
    robomimic(tmp_path / "set/low.hdf5")
    with pytest.raises(SourceError, match="is of robomimic, but the files before it are of ACT"):
        bank_of(tmp_path / "set", rate=50)
    (tmp_path / "set/low.hdf5").unlink()
    (tmp_path / "set/low.hdf5").symlink_to(tmp_path / "low.hdf5")
    with pytest.raises(SourceError, match="leads outside"):
        bank_of(tmp_path / "set", rate=50)
