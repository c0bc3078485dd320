"""LeRobotDatasets of version 3, small and written here: of a rover, and of an arm of two cameras."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import photographs
from eyechart.frames import encode

CAMERA, REAR = "observation.images.front", "observation.images.rear"
WORDS = ["cross the yard", "park"]
"""The words of the tasks: of the even episodes and of the odd ones."""


def arrow() -> tuple[Any, Any]:
    """Return pyarrow and its Parquet part."""
    import pyarrow as pa  # noqa: PLC0415 - an extra
    import pyarrow.parquet as pq  # noqa: PLC0415 - an extra

    return pa, pq


def write_table(path: Path, columns: dict[str, object], **options: object) -> Path:
    """Write columns as a Parquet file."""
    pa, pq = arrow()
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(pa.table(columns), path, **options)
    return path


def film(path: Path, gaps: list[float | None], fps: int) -> None:
    """Write a small video: one drawn picture a frame."""
    import av  # noqa: PLC0415 - an extra

    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg4", rate=fps)
        stream.width, stream.height, stream.pix_fmt = photographs.SIZE[1], photographs.SIZE[0], "yuv420p"
        stream.bit_rate = 4_000_000
        for gap in gaps:
            picture = av.VideoFrame.from_ndarray(photographs.draw(gap), format="rgb24")
            container.mux(stream.encode(picture))
        container.mux(stream.encode())


def lerobot(root: Path, *, episodes: int = 8, length: int = 10, fps: int = 10, version: str = "v3.0") -> list[float]:
    """Write a LeRobotDataset v3: two video files of half of the episodes each, one data file each; return the gaps."""
    rng, gaps, meta = np.random.default_rng(1), [], []
    half = episodes // 2
    for file in range(2):
        inside = [round(float(gap), 2) for gap in rng.uniform(3, 60, half * length)]
        gaps += inside
        film(root / f"videos/{CAMERA}/chunk-000/file-{file:03d}.mp4", list(inside), fps)
        numbers = [file * half + episode for episode in range(half) for _ in range(length)]
        steps = list(range(length)) * half
        data = {
            "observation.state": [[gap, 1.0] for gap in inside],
            "timestamp": np.array([step / fps for step in steps], dtype=np.float32),
            "frame_index": steps,
            "episode_index": numbers,
            "index": [file * half * length + place for place in range(half * length)],
            "task_index": [number % 2 for number in numbers],
        }
        write_table(root / f"data/chunk-000/file-{file:03d}.parquet", data)
        meta += [
            {
                "episode_index": file * half + episode,
                "data/chunk_index": 0,
                "data/file_index": file,
                f"videos/{CAMERA}/chunk_index": 0,
                f"videos/{CAMERA}/file_index": file,
                f"videos/{CAMERA}/from_timestamp": episode * length / fps,
                f"videos/{CAMERA}/to_timestamp": (episode + 1) * length / fps,
                "tasks": [WORDS[(file * half + episode) % 2]],
                "length": length,
            }
            for episode in range(half)
        ]
    write_table(
        root / "meta/episodes/chunk-000/file-000.parquet", {name: [one[name] for one in meta] for name in meta[0]}
    )
    write_table(root / "meta/tasks.parquet", {"task_index": [0, 1], "__index_level_0__": WORDS})
    info = {
        "codebase_version": version,
        "fps": fps,
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4",
        "features": {
            CAMERA: {"dtype": "video", "shape": [*photographs.SIZE, 3], "names": ["height", "width", "channels"]},
            "observation.state": {"dtype": "float32", "shape": [2], "names": ["gap", "speed"]},
        },
    }
    (root / "meta/info.json").write_text(json.dumps(info))
    return gaps


def arm(root: Path, *, inside: bool, width: int = 2, episodes: int = 8, length: int = 10) -> None:
    """Make a robot's of `lerobot`: a second camera and actions of so many numbers; pictures ``inside`` the data.

    The actions count up, and are changes by what the data tell.
    """
    lerobot(root, episodes=episodes, length=length)
    info = json.loads((root / "meta/info.json").read_text())
    info["features"][REAR] = dict(info["features"][CAMERA])
    names = {"motors": ["gap", "speed"]} if width == 2 else None
    info["features"]["action"] = {"dtype": "float32", "shape": [width], "names": names}
    info["features"]["depth"] = {"dtype": "video", "shape": [4, 4, 1], "info": {"is_depth_map": True}}
    pa, pq = arrow()
    for path in sorted((root / "data").rglob("*.parquet")):
        table = pq.read_table(path)
        numbers = np.arange(table.num_rows * width, dtype=float).reshape(-1, width)
        table = table.append_column("action", pa.array(numbers.tolist() if width > 1 else numbers[:, 0]))
        if inside:
            gaps = [one[0] for one in table["observation.state"].to_pylist()]
            for name in (CAMERA, REAR):
                cells = [{"bytes": encode(photographs.draw(gap)), "path": "x.png"} for gap in gaps]
                table = table.append_column(name, pa.array(cells))
        pq.write_table(table, path, row_group_size=13)
    if inside:
        for name in (CAMERA, REAR):
            info["features"][name]["dtype"] = "image"
    else:
        meta = root / "meta/episodes/chunk-000/file-000.parquet"
        rows = pq.read_table(meta)
        for name in ("chunk_index", "file_index", "from_timestamp", "to_timestamp"):
            rows = rows.append_column(f"videos/{REAR}/{name}", rows[f"videos/{CAMERA}/{name}"])
        pq.write_table(rows, meta)
        shutil.copytree(root / "videos" / CAMERA, root / "videos" / REAR)
    (root / "meta/info.json").write_text(json.dumps(info))


def reach(root: Path, names: dict[str, list[str] | None], *, changes: bool = False) -> None:
    """Make the data set of `arm` one whose joints wander, and whose actions are the places a step later."""
    arm(root, inside=True)
    info = json.loads((root / "meta/info.json").read_text())
    for name, given in names.items():
        info["features"][name]["names"] = given
    (root / "meta/info.json").write_text(json.dumps(info))
    rng, (pa, pq) = np.random.default_rng(0), arrow()
    for path in sorted((root / "data").rglob("*.parquet")):
        table = pq.read_table(path)
        joints = np.cumsum(rng.normal(size=(table.num_rows + 1, 2)), axis=0)
        done = np.diff(joints, axis=0) if changes else joints[1:]
        for name, numbers in (("observation.state", joints[:-1]), ("action", done)):
            table = table.set_column(table.schema.get_field_index(name), name, pa.array(numbers.tolist()))
        pq.write_table(table, path)


def describe(root: Path, change: Callable[[Any], object]) -> None:
    """Change what a data set's info.json says."""
    path = root / "meta/info.json"
    info = json.loads(path.read_text())
    change(info)
    path.write_text(json.dumps(info))


def rewrite(path: Path, change: Callable[[list[dict[str, Any]]], list[dict[str, Any]] | None]) -> None:
    """Change the rows of a Parquet file; a column keeps its type where its new cells are of it."""
    pa, pq = arrow()
    table = pq.read_table(path)
    rows = table.to_pylist()
    rows = change(rows) or rows
    columns = {}
    for name in dict.fromkeys(name for row in rows for name in row):
        cells = [row.get(name) for row in rows]
        kind = table.schema.field(name).type if name in table.column_names else None
        if kind is not None and pa.types.is_integer(kind) and not all(type(cell) is int for cell in cells):
            kind = None  # it would be cut to a whole number
        try:
            columns[name] = pa.array(cells, kind)
        except pa.ArrowException:
            columns[name] = pa.array(cells)
    pq.write_table(pa.table(columns), path)


def first_rows(root: Path) -> Path:
    """Return the first data file of a data set."""
    return root / "data/chunk-000/file-000.parquet"


def places(root: Path) -> Path:
    """Return the file that says where the episodes of a data set lie."""
    return root / "meta/episodes/chunk-000/file-000.parquet"


def of_episodes(root: Path, *, version: str = "v2.1", numbered: bool = True, gaps: list[float], fps: int = 10) -> None:
    """Make one of version 2 of the data set of `arm` or `lerobot`: a data file and a film an episode, lines of JSON.

    ``gaps`` are those that `lerobot` returned; where rows are not ``numbered`` they have no frame_index, as GR00T's.
    """
    pa, pq = arrow()
    table = pa.concat_tables([pq.read_table(path) for path in sorted((root / "data").rglob("*.parquet"))])
    shutil.rmtree(root / "data")
    rows = table.to_pylist()
    if not numbered:
        table = table.drop_columns(["frame_index"])
    films = [path.name for path in sorted((root / "videos").iterdir())] if (root / "videos").is_dir() else []
    shutil.rmtree(root / "videos", ignore_errors=True)
    lines = []
    for episode in dict.fromkeys(row["episode_index"] for row in rows):
        places_of = [place for place, row in enumerate(rows) if row["episode_index"] == episode]
        path = root / f"data/chunk-{episode // 3:03d}/episode_{episode:06d}.parquet"
        path.parent.mkdir(parents=True, exist_ok=True)
        pq.write_table(table.take(places_of), path)
        for camera in films:
            inside = [gaps[place] for place in places_of]
            film(root / f"videos/chunk-{episode // 3:03d}/{camera}/episode_{episode:06d}.mp4", list(inside), fps)
        lines.append({"episode_index": episode, "tasks": [WORDS[episode % 2]], "length": len(places_of)})
    shutil.rmtree(root / "meta/episodes")
    (root / "meta/tasks.parquet").unlink()
    write_lines(root / "meta/episodes.jsonl", lines)
    write_lines(root / "meta/tasks.jsonl", [{"task_index": place, "task": word} for place, word in enumerate(WORDS)])
    two = {
        "codebase_version": version,
        "chunks_size": 3,
        "data_path": "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
        "video_path": "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4",
    }
    describe(root, lambda info: info.update(two))


def write_lines(path: Path, lines: list[dict[str, Any]]) -> None:
    """Write a line of JSON for each."""
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
