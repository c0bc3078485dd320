"""The layouts of LeRobotDatasets, rebuilt small: what is read is what was written, the rest is refused by name."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

from data_sets import arrow, write_lines, write_table
from eyechart.errors import EyechartError
from eyechart.frames import FrameBank, decode, encode
from eyechart.importing import Choices, Horizon, import_lerobot
from eyechart.importing.costs import taken

pytestmark = pytest.mark.models

TOP, WRIST = "observation.images.top", "observation.images.wrist"
STATE, ACTION, DEPTH = "observation.state", "action", f"{TOP}_depth"
EPISODES, LENGTH = 3, 12
Rows = list[dict[str, Any]]
Info = dict[str, Any]


def nothing(*_: object) -> None:
    """Change nothing."""


@dataclass(frozen=True)
class RobotLayout:
    """One layout: how it is written, how it is asked for, and what comes of it.

    ``kept`` are the rows of each episode that become frames, and ``refused`` is a part of the error.
    """

    cameras: dict[str, tuple[int, int]] = field(default_factory=lambda: {TOP: (16, 24)})
    inside: bool = True
    codec: str = "mpeg4"
    width: int = 6
    listed: bool = False
    number: str = "float32"
    fps: float = 10
    changes: bool = False
    names: Any = "joints"
    words: Sequence[str] = ("pick",)
    rows: Callable[[Rows], object] = nothing
    info: Callable[[Info], object] = nothing
    parts: tuple[tuple[str, ...], tuple[str, ...]] = ((STATE,), (ACTION,))
    shown: tuple[str, ...] | None = None
    version: str = "v3.0"
    shift_s: float = 0.0
    table: bool = True
    lost: frozenset[int] = frozenset()
    said: str = ""
    refused: str = ""
    camera: str | None = None


def shots(camera: int, episode: int, size: tuple[int, int]) -> list[Any]:
    """Return an episode's pictures: a bar that moves, whose rows differ by camera and episode."""
    result = []
    for step in range(LENGTH):
        picture = np.full((*size, 3), 30 + 60 * camera, np.uint8)
        picture[:, size[1] * step // LENGTH : size[1] * step // LENGTH + size[1] // 5] = (250, 40 + 70 * episode, 90)
        result.append(picture)
    return result


def log(one: RobotLayout, episode: int) -> tuple[Any, Any]:
    """Return an episode's states and actions, as numbers of the type in which they are stored."""
    rng = np.random.default_rng([7, episode])
    places = np.cumsum(rng.normal(size=(LENGTH + 1, one.width)), axis=0)
    done = np.diff(places, axis=0) if one.changes else places[1:]
    return places[:-1].astype(one.number), done.astype(one.number)


def film(path: Path, pictures: Sequence[Any], one: RobotLayout) -> None:
    """Write pictures as a video."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w") as container:
        stream = container.add_stream(one.codec, rate=Fraction(one.fps).limit_denominator(1000))
        stream.height, stream.width, stream.pix_fmt = *pictures[0].shape[:2], "yuv420p"
        stream.options = {"preset": "12"} if one.codec == "libsvtav1" else {"x265-params": "log-level=none:pools=1"}
        if one.codec == "mpeg4":
            stream.options, stream.bit_rate = {}, 4_000_000
        for picture in pictures:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode())


def split(one: RobotLayout, name: str, numbers: Any) -> dict[str, Any]:  # noqa: ANN401 - of NumPy
    """Return a vector's cells under the features that hold its parts; the last part of several is one number."""
    parts = one.parts[name == ACTION]
    if len(parts) == 1:
        return {parts[0]: numbers.tolist() if len(numbers) > 1 or one.listed else numbers.item()}
    return {parts[0]: numbers[:-1].tolist(), parts[1]: numbers[-1].item()}


def rows_of(one: RobotLayout) -> Rows:
    """Return all rows, before they are changed."""
    result: Rows = []
    for episode in range(EPISODES):
        state, action = log(one, episode)
        pictures = {name: shots(n, episode, size) for n, (name, size) in enumerate(one.cameras.items())}
        for step in range(LENGTH):
            row = split(one, STATE, state[step]) | split(one, ACTION, action[step])
            row |= {"timestamp": np.float32(step / one.fps), "frame_index": step, "episode_index": episode}
            row |= {"index": len(result), "task_index": episode % len(one.words)}
            if one.inside:
                row |= {name: {"bytes": encode(many[step]), "path": None} for name, many in pictures.items()}
            result.append(row)
    one.rows(result)
    return result


def features_of(one: RobotLayout) -> dict[str, Any]:
    """Return the description of the features."""
    found: dict[str, Any] = {}
    for name, size in one.cameras.items():
        found[name] = {"dtype": "image" if one.inside else "video", "shape": [*size, 3], "info": {"video.fps": one.fps}}
    for parts in one.parts:
        names = [f"joint_{n}" for n in range(one.width)] if one.names == "joints" else one.names
        widths = [one.width] if len(parts) == 1 else [one.width - 1, 1]
        for name, width in zip(parts, widths, strict=True):
            found[name] = {"dtype": one.number, "shape": [width], "names": names if len(parts) == 1 else None}
    for name in ("timestamp", "frame_index", "episode_index", "index", "task_index"):
        found[name] = {"dtype": "float32" if name == "timestamp" else "int64", "shape": [1], "names": None}
    return found


def columns_of(one: RobotLayout, rows: Rows) -> dict[str, Any]:
    """Return the rows' columns; vectors have the layout's type."""
    pa, _ = arrow()
    kind = pa.from_numpy_dtype(np.dtype(one.number))
    vectors = {name for parts in one.parts for name in parts if isinstance(rows[0].get(name), list)}
    result = {}
    for name in rows[0]:
        cells = [row[name] for row in rows]
        if name in vectors and one.number == "float16":
            cells = [None if cell is None else np.array(cell, np.float16) for cell in cells]
        result[name] = pa.array(cells, pa.list_(kind)) if name in vectors else pa.array(cells)
    return result


def write(root: Path, one: RobotLayout) -> None:
    """Write a layout as a data set of its version."""
    rows, info = rows_of(one), {"codebase_version": one.version, "fps": one.fps, "features": features_of(one)}
    if one.version == "v3.0":
        _write_three(root, one, rows)
        info["video_path"] = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
    else:
        _write_two(root, one, rows)
        info["video_path"] = "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4"
    one.info(info)
    (root / "meta/info.json").write_text(json.dumps(info))


def _write_three(root: Path, one: RobotLayout, rows: Rows) -> None:
    write_table(root / "data/chunk-000/file-000.parquet", columns_of(one, rows))
    meta: Rows = []
    for episode in range(EPISODES):
        line: dict[str, Any] = {
            "episode_index": episode,
            "tasks": [one.words[episode % len(one.words)]],
            "length": LENGTH,
        }
        for name in () if one.inside else one.cameras:
            start, end = ((episode + more) * LENGTH / one.fps + one.shift_s for more in (0, 1))
            line |= {f"videos/{name}/{part}_index": 0 for part in ("chunk", "file")}
            line |= {f"videos/{name}/from_timestamp": start, f"videos/{name}/to_timestamp": end}
        meta.append(line)
    write_table(
        root / "meta/episodes/chunk-000/file-000.parquet", {name: [row[name] for row in meta] for name in meta[0]}
    )
    if one.table:
        words = {"task_index": [*range(len(one.words))], "__index_level_0__": [*one.words]}
        write_table(root / "meta/tasks.parquet", words)
    for n, (name, size) in enumerate({} if one.inside else one.cameras.items()):
        pictures = [picture for episode in range(EPISODES) for picture in shots(n, episode, size)]
        film(root / f"videos/{name}/chunk-000/file-000.mp4", pictures, one)


def _write_two(root: Path, one: RobotLayout, rows: Rows) -> None:
    for episode in range(EPISODES):
        own = [row for row in rows if row["episode_index"] == episode]
        write_table(root / f"data/chunk-000/episode_{episode:06d}.parquet", columns_of(one, own))
        for n, (name, size) in enumerate(one.cameras.items()):
            film(root / f"videos/chunk-000/{name}/episode_{episode:06d}.mp4", shots(n, episode, size), one)
    tasks = [{"task_index": n, "task": word} for n, word in enumerate((*one.words, "valid"))]
    lengths = [{"episode_index": n, "tasks": [*one.words, "valid"], "length": LENGTH} for n in range(EPISODES)]
    (root / "meta").mkdir()
    write_lines(root / "meta/tasks.jsonl", tasks)
    write_lines(root / "meta/episodes.jsonl", lengths)
    if "frame_index" not in rows[0]:
        annotation = {"human.action.task_description": {}, "human.validity": {}}
        (root / "meta/modality.json").write_text(json.dumps({"annotation": annotation}))


def each(change: Callable[[dict[str, Any]], object]) -> Callable[[Rows], None]:
    """Return what changes every row."""

    def done(rows: Rows) -> None:
        for row in rows:
            change(row)

    return done


def at(number: int, name: str, cell: object, place: int | None = None) -> Callable[[Rows], None]:
    """Return what puts a cell into one row, or a number into its vector."""

    def done(rows: Rows) -> None:
        if place is None:
            rows[number][name] = cell
        else:
            rows[number][name][place] = cell

    return done


def feature(name: str, **told: object) -> Callable[[Info], None]:
    """Return what describes a feature, or changes its description."""
    return lambda info: info["features"].setdefault(name, {}).update(told)


def with_column(name: str, cell: Callable[[dict[str, Any]], object], dtype: str, shape: list[int]) -> dict[str, Any]:
    """Return the options that add a column."""
    added = each(lambda row: row.update({name: cell(row)}))
    return {"rows": added, "info": feature(name, dtype=dtype, shape=shape, names=None)}


def groot(row: dict[str, Any]) -> None:
    """Make a row one of GR00T's."""
    del row["frame_index"]
    row.update({"annotation.human.action.task_description": 0, "annotation.human.validity": 1})


def slower(rows: Rows) -> None:
    """Have the recorder's seconds jump back in the middle of each episode."""
    for row in rows:
        row["timestamp"] = np.float32(row["timestamp"] * (1 if row["frame_index"] < 6 else 0.8))


def with_gaps(rows: Rows) -> None:
    """Drop some frames."""
    rows[:] = [row for row in rows if row["frame_index"] not in {4, 9}]


def as_depth(place: str) -> Callable[[Info], None]:
    """Return what marks the second camera as one of depths."""
    return feature(DEPTH, **{place: {"video.is_depth_map": True}})


HIGH = {f"observation.images.{name}": (16, 24) for name in ("cam_high", "cam_left_wrist", "cam_right_wrist", "cam_low")}
WITH_DEPTH: dict[str, Any] = {"cameras": {TOP: (16, 24), DEPTH: (16, 24)}, "shown": (TOP,)}
SPLIT = ((f"{STATE}.joint_position", f"{STATE}.gripper_position"), (f"{ACTION}.joint_position", f"{ACTION}.gripper"))
CHANNELS = feature(TOP, shape=[3, 16, 24], names=["channels", "height", "width"])
AXES = {f"m{n}": n for n in range(6)}
TWO = {"arm": [f"j{n}" for n in range(5)], "gripper": ["g"]}
MOTORS = {"motors": [f"m{n}" for n in range(6)]}

LAYOUTS: dict[str, RobotLayout] = {
    "film in MPEG-4": RobotLayout(inside=False),
    "film in AV1": RobotLayout(inside=False, codec="libsvtav1", cameras={TOP: (96, 128)}),
    "film in HEVC": RobotLayout(inside=False, codec="libx265", cameras={TOP: (96, 128)}),
    "cameras of two sizes": RobotLayout(inside=False, cameras={TOP: (16, 24), WRIST: (32, 32)}),
    "pictures in Parquet": RobotLayout(),
    "film, channels first": RobotLayout(inside=False, info=CHANNELS),
    "pictures, channels first": RobotLayout(info=CHANNELS),
    "observation.image": RobotLayout(cameras={"observation.image": (16, 24)}),
    "image and image2": RobotLayout(cameras={f"observation.images.{one}": (16, 24) for one in ("image", "image2")}),
    "names of openpi": RobotLayout(
        cameras={"image": (16, 24), "wrist_image": (16, 24)}, parts=(("state",), ("actions",)), names=["state"], width=7
    ),
    "depth in info": RobotLayout(**WITH_DEPTH, info=as_depth("info"), said="marked as depths"),
    "depth in video_info": RobotLayout(**WITH_DEPTH, info=as_depth("video_info"), said="marked as depths"),
    "no words of tasks": RobotLayout(table=False, refused="does not exist, but every row has a task_index"),
    "neither words nor numbers of tasks": RobotLayout(table=False, rows=each(lambda row: row.pop("task_index"))),
    "names of motors": RobotLayout(names=MOTORS),
    "names of axes": RobotLayout(names=AXES),
    "names of two groups": RobotLayout(names=TWO),
    "names in a list of lists": RobotLayout(names=[[f"m{n}" for n in range(6)]]),
    "no names": RobotLayout(names=None),
    "one name": RobotLayout(names=["state"]),
    "equal names": RobotLayout(names=["motor"] * 6),
    "NaN in a third": RobotLayout(
        rows=each(lambda row: row[STATE].__setitem__(2, float("nan")) if row["frame_index"] % 3 == 0 else None),
        lost=frozenset(range(0, EPISODES * LENGTH, 3)),
        said="12 of 36 rows are left out",
    ),
    "NaN in one": RobotLayout(rows=at(5, STATE, float("nan"), 2), lost=frozenset({5}), said="1 of 36 rows"),
    "infinite action": RobotLayout(rows=at(7, ACTION, float("inf"), 1), lost=frozenset({7}), said="1 of 36 rows"),
    "null state": RobotLayout(rows=at(5, STATE, None), lost=frozenset({5}), said="1 of 36 rows"),
    "float16": RobotLayout(number="float16"),
    "float64": RobotLayout(number="float64"),
    "two arms and four cameras": RobotLayout(cameras=HIGH, width=14, names=None, fps=50),
    "changes": RobotLayout(changes=True),
    "a gripper of two values": RobotLayout(
        rows=each(lambda row: row[ACTION].__setitem__(-1, float(row[ACTION][-1] > 0)))
    ),
    "films that begin a frame late": RobotLayout(inside=False, shift_s=0.1, refused="ends at"),
    "two tasks": RobotLayout(words=("pick", "place")),
    "parts of a task": RobotLayout(**with_column("subtask_index", lambda row: row["frame_index"] // 5, "int64", [1])),
    "a column of words": RobotLayout(**with_column("language_instruction", lambda _: "pick it", "string", [1])),
    "structs of words": RobotLayout(
        **with_column("language_persistent", lambda _: [{"role": "user", "content": "pick"}], "language", [1])
    ),
    "state of the surroundings": RobotLayout(
        **with_column("observation.environment_state", lambda row: [row["index"] * 1.0, 2.0], "float32", [2]),
        said="'observation.environment_state' (2 numbers)",
    ),
    "vectors in parts": RobotLayout(parts=SPLIT, width=7),
    "a table of numbers": RobotLayout(
        **with_column("observation.tactile", lambda _: [[1.0, 2.0], [3.0, 4.0]], "float32", [2, 2]),
        said="'observation.tactile' (2×2 numbers)",
    ),
    "one number": RobotLayout(width=1, names=None),
    "words for numbers": RobotLayout(
        rows=each(lambda row: row.update({ACTION: "go"})),
        refused="info.json describes 'action' as 6 numbers, and the data files have it as no list of 6 numbers",
    ),
    "one number in a list": RobotLayout(width=1, names=None, listed=True),
    "eighty numbers": RobotLayout(width=80, names=None),
    "a camera without pictures": RobotLayout(
        info=feature("observation.images.egoview", dtype="image", shape=[16, 24, 3]),
        said="'observation.images.egoview' is left out",
    ),
    "29.97 frames a second": RobotLayout(inside=False, fps=29.97),
    "seconds of their own": RobotLayout(inside=False, rows=slower, refused="a later step must have a later time"),
    "frames that are missing": RobotLayout(inside=False, rows=with_gaps),
    "episodes in another order": RobotLayout(rows=lambda rows: rows.sort(key=lambda row: -row["episode_index"])),
    "version 2.0": RobotLayout(version="v2.0", inside=False),
    "version 2.1": RobotLayout(version="v2.1", inside=False),
    "demonstrations of GR00T": RobotLayout(
        version="v2.0",
        inside=False,
        rows=each(groot),
        info=feature("observation.images.egoview", dtype="video", shape=[16, 24, 3]),
        said="'observation.images.egoview' is left out",
    ),
}


def is_own(shown: Any, own: list[Any], step: int, *, exact: bool) -> bool:  # noqa: ANN401 - of NumPy
    """Return whether a picture is that of its step: to the bit, or nearer than to the steps beside it."""
    if exact:
        return np.array_equal(shown, own[step])
    apart = [float(np.abs(shown.astype(int) - one).mean()) for one in own]
    return step == int(np.argmin(apart))


def require_written(bank: FrameBank, one: RobotLayout) -> None:
    """Require that every frame has its row's numbers, words and pictures, and that no frame is missing."""
    known = {(row["episode_index"], row.get("frame_index", n % LENGTH)): (n, row) for n, row in enumerate(rows_of(one))}
    kept = {place: row for place, (n, row) in known.items() if n not in one.lost}
    assert {(int(frame.episode), frame.step) for frame in bank} == kept.keys()
    cameras = {name.rpartition(".")[2]: n for n, name in enumerate(one.cameras) if name in (one.shown or one.cameras)}
    assert {camera.name for camera in bank.manifest.cameras} == cameras.keys()
    for frame in bank:
        episode = int(frame.episode)
        told = [numbers(kept[episode, frame.step], one.parts[0])]
        assert [[*frame.state["state"]]] == told
        ahead = [kept.get((episode, frame.step + more)) for more in (0, 1)]
        if None not in ahead:
            assert [[*step] for step in frame.motion] == [
                numbers(row, one.parts[1]) for row in ahead if row is not None
            ]
        assert bool(frame.motion) == (None not in ahead)
        assert frame.fields.get("task") == (one.words[episode % len(one.words)] if one.table else None)
        for name, n in cameras.items():
            shown, size = decode(bank.images(frame)[name], frame.id), [*one.cameras.values()][n]
            assert is_own(shown, shots(n, episode, size), frame.step, exact=one.inside), (frame.id, name)


def numbers(row: dict[str, Any], parts: Sequence[str]) -> list[float]:
    """Return the numbers of a vector's parts in a row."""
    cells = [row[name] if isinstance(row[name], list) else [row[name]] for name in parts]
    return [number for many in cells for number in many]


@pytest.mark.parametrize("name", LAYOUTS)
def test_a_layout_is_read_as_it_was_written_or_refused_by_name(tmp_path: Path, name: str) -> None:
    """Numbers to the bit; pictures of films are those of their step, and others to the bit."""
    one, root = LAYOUTS[name], tmp_path / "set"
    write(root, one)
    ahead = Horizon(2, "delta" if one.changes else "absolute")
    if one.refused:
        with pytest.raises(EyechartError, match=one.refused):
            import_lerobot(root, tmp_path / "bank", Choices(), ahead=ahead)
        assert not (tmp_path / "bank").exists()
        return
    bank = import_lerobot(root, tmp_path / "bank", Choices(), ahead=ahead)
    require_written(bank, one)
    assert one.said in "\n".join(taken(bank))


def test_all_but_four_layouts_are_read() -> None:
    """The others are refused: what they say of words, films, seconds or numbers cannot be."""
    refused = [name for name, one in LAYOUTS.items() if one.refused]
    assert refused == [
        "no words of tasks",
        "films that begin a frame late",
        "words for numbers",
        "seconds of their own",
    ]
    assert len(LAYOUTS) - len(refused) >= 43
