"""Data sets by LeRobot's own writer, by its converter of v2.1, and as GR00T's: what is read is what was written.

`lerobot_checkpoints` runs this, in a Python that has ``lerobot[dataset]`` and eyechart. Numbers, words and pictures
inside the data are compared to the bit. A film is lossy, so its pictures are compared with what PyAV and LeRobot
decode of it, to the bit too, and each has to be nearer to its own step than to any other.
"""

import json
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

SIZES = {"observation.images.top": (64, 96), "observation.images.wrist": (96, 96)}
LENGTHS, WIDTH, FPS, AHEAD = (14, 18, 12, 16), 6, 10, 4
"""Steps of each episode, numbers of a state and of an action, steps a second, and those of a motion."""
TASKS = ("pick the block", "place the block")
STATE, ACTION = "observation.state", "action"
DESCRIBED = "annotation.human.action.task_description"


@dataclass(frozen=True)
class Episode:
    """What is written of an episode: pictures (n, h, w, 3) by camera, states and actions (n, 6), words."""

    pictures: dict[str, np.ndarray]
    state: np.ndarray
    action: np.ndarray
    task: int


def episodes() -> list[Episode]:
    """Return the episodes: a bar that moves over a coloured ground, and joints that wander."""
    rng, found = np.random.default_rng(20), []
    for number, length in enumerate(LENGTHS):
        pictures = {}
        for camera, (high, wide) in SIZES.items():
            shown = np.empty((length, high, wide, 3), np.uint8)
            shown[:] = rng.integers(40, 200, 3)
            for step in range(length):
                at = (wide - 10) * step // length
                shown[step, 8:-8, at : at + 10] = (250, 60 * number, 20)
            pictures[camera] = shown
        places = np.cumsum(rng.normal(size=(length + 1, WIDTH)), axis=0).astype(np.float32)
        found.append(Episode(pictures, places[:-1], places[1:], number % 2))
    return found


def features(*, films: bool) -> dict[str, Any]:
    """Return the description of cameras, state and action."""
    kind, names = "video" if films else "image", [f"joint_{place}.pos" for place in range(WIDTH)]
    seen = {name: {"dtype": kind, "shape": (*size, 3), "names": ["height", "width", "channels"]}
            for name, size in SIZES.items()}  # fmt: skip
    return seen | {name: {"dtype": "float32", "shape": (WIDTH,), "names": names} for name in (STATE, ACTION)}


def by_writer(root: Path, *, films: bool) -> None:
    """Write version 3 by LeRobot's own writer."""
    from lerobot.datasets.lerobot_dataset import LeRobotDataset  # noqa: PLC0415 - of the other environment

    data = LeRobotDataset.create("here/set", fps=FPS, features=features(films=films), root=root, use_videos=films)
    for one in episodes():
        for step in range(len(one.state)):
            row = {name: pictures[step] for name, pictures in one.pictures.items()}
            data.add_frame({**row, STATE: one.state[step], ACTION: one.action[step], "task": TASKS[one.task]})
        data.save_episode()
    data.finalize()


def by_shape(root: Path, *, films: bool, groot: bool = False) -> None:
    """Write version 2.1 as LeRobot's older writer did, or 2.0 as the demonstrations of GR00T are."""
    first, lines = 0, []
    for number, one in enumerate(episodes()):
        _write_rows(root, number, one, first, films=films, groot=groot)
        first += len(one.state)
        numbers = {STATE: one.state, ACTION: one.action}
        stats = {name: {**{what: getattr(many, what)(0).tolist() for what in ("min", "max", "mean", "std")},
                        "count": [len(many)]} for name, many in numbers.items()}  # fmt: skip
        told = [TASKS[one.task], *(["valid"] if groot else [])]
        lines.append({"episode_index": number, "tasks": told, "length": len(one.state), "stats": stats})
        for name in SIZES if films else ():
            _film(root / f"videos/chunk-000/{name}/episode_{number:06d}.mp4", one.pictures[name])
    (root / "meta").mkdir()
    words = [*TASKS, *(["valid"] if groot else [])]
    _lines(root / "meta/tasks.jsonl", [{"task_index": place, "task": word} for place, word in enumerate(words)])
    _lines(root / "meta/episodes.jsonl", [{name: line[name] for name in line if name != "stats"} for line in lines])
    if groot:
        (root / "meta/modality.json").write_text(json.dumps(_modality()))
    else:
        _lines(root / "meta/episodes_stats.jsonl", [{name: line[name] for name in ("episode_index", "stats")}
                                                    for line in lines])  # fmt: skip
    (root / "meta/info.json").write_text(json.dumps(_info(films=films, version="v2.0" if groot else "v2.1")))


def _write_rows(root: Path, number: int, one: Episode, first: int, *, films: bool, groot: bool) -> None:
    """Write the rows of an episode; GR00T's have no number within it, and say the task in a column of their own."""
    import pyarrow as pa  # noqa: PLC0415 - as above
    import pyarrow.parquet as pq  # noqa: PLC0415 - as above

    steps = np.arange(len(one.state))
    columns: dict[str, Any] = {
        STATE: pa.array(list(one.state), pa.list_(pa.float32())),
        ACTION: pa.array(list(one.action), pa.list_(pa.float32())),
        "timestamp": (steps / FPS).astype(np.float32),
        "episode_index": np.full(len(steps), number),
        "index": first + steps,
        "task_index": np.full(len(steps), 0 if groot else one.task),
    }
    if groot:
        columns |= {DESCRIBED: np.full(len(steps), one.task), "annotation.human.validity": np.full(len(steps), 2)}
    else:
        columns["frame_index"] = steps
    for name in () if films else SIZES:
        columns[name] = [{"bytes": _png(picture), "path": None} for picture in one.pictures[name]]
    path = root / f"data/chunk-000/episode_{number:06d}.parquet"
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(pa.table(columns), path)


def _modality() -> dict[str, Any]:
    """Return GR00T's description of parts, cameras and words."""
    parts = {"arm": {"start": 0, "end": WIDTH - 1}, "hand": {"start": WIDTH - 1, "end": WIDTH}}
    video = {name.rpartition(".")[2]: {"original_key": name} for name in SIZES}
    annotation = {"human.action.task_description": {}, "human.validity": {}}
    return {"state": parts, "action": parts, "video": video, "annotation": annotation}


def _info(*, films: bool, version: str) -> dict[str, Any]:
    """Return the description of a data set of version 2; GR00T's lists a camera under two names."""
    found = features(films=films)
    if version == "v2.0":
        found = {"observation.images.egoview": found[next(iter(SIZES))], **found}
    numbers = {
        "timestamp": "float32",
        **dict.fromkeys(("frame_index", "episode_index", "index", "task_index"), "int64"),
    }
    found |= {name: {"dtype": kind, "shape": (1,), "names": None} for name, kind in numbers.items()}
    return {
        "codebase_version": version,
        "robot_type": "arm",
        "total_episodes": len(LENGTHS),
        "total_frames": sum(LENGTHS),
        "total_tasks": len(TASKS),
        "total_videos": len(LENGTHS) * len(SIZES) * films,
        "total_chunks": 1,
        "chunks_size": 1000,
        "fps": FPS,
        "splits": {"train": f"0:{len(LENGTHS)}"},
        "data_path": "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
        "video_path": "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4" if films else None,
        "features": found,
    }


def _lines(path: Path, lines: list[dict[str, Any]]) -> None:
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))


def _png(picture: np.ndarray) -> bytes:
    from PIL import Image  # noqa: PLC0415 - as above

    kept = BytesIO()
    Image.fromarray(picture).save(kept, "PNG")
    return kept.getvalue()


def _film(path: Path, pictures: np.ndarray) -> None:
    import av  # noqa: PLC0415 - as above

    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=FPS)
        stream.height, stream.width, stream.pix_fmt = *pictures.shape[1:3], "yuv420p"
        stream.options = {"g": "2", "crf": "18"}
        for picture in pictures:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode())


def by_converter(root: Path, *, films: bool) -> None:
    """Have LeRobot's own converter make version 3 of version 2.1."""
    by_shape(root, films=films)
    words = [sys.executable, "-m", "lerobot.scripts.convert_dataset_v21_to_v30", "--repo-id=here/set"]
    subprocess.run(
        [*words, f"--root={root}", "--push-to-hub=false"],
        check=True,
        capture_output=True,
        env={**os.environ, "HF_HUB_OFFLINE": "1"},
    )


SETS = {
    "LeRobot's writer, pictures": (by_writer, {"films": False}),
    "LeRobot's writer, films": (by_writer, {"films": True}),
    "v2.1, pictures": (by_shape, {"films": False}),
    "v2.1, films": (by_shape, {"films": True}),
    "v2.1 by LeRobot's converter, pictures": (by_converter, {"films": False}),
    "v2.1 by LeRobot's converter, films": (by_converter, {"films": True}),
    "GR00T's v2.0, films": (by_shape, {"films": True, "groot": True}),
}
"""How each data set is made."""


def decoded(root: Path, camera: str) -> list[np.ndarray]:
    """Return the pictures of each episode as PyAV decodes its films, one after the other."""
    import av  # noqa: PLC0415 - as above

    shown = []
    for path in sorted(root.rglob(f"videos/**/{camera}/**/*.mp4")):
        with av.open(str(path)) as container:
            shown += [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    return np.split(np.array(shown), np.cumsum(LENGTHS)[:-1])


def by_lerobot(root: Path) -> dict[str, list[np.ndarray]]:
    """Return the pictures of each episode as LeRobot itself reads them, by camera."""
    from lerobot.datasets.lerobot_dataset import LeRobotDataset  # noqa: PLC0415 - as above

    data = LeRobotDataset("here/set", root=root, video_backend="pyav")
    rows = [data[place] for place in range(len(data))]
    pictures = {name: np.stack([np.rint(row[name].numpy().transpose(1, 2, 0) * 255) for row in rows]) for name in SIZES}
    return {name: np.split(many.astype(np.uint8), np.cumsum(LENGTHS)[:-1]) for name, many in pictures.items()}


def compare(name: str, folder: Path) -> dict[str, Any]:
    """Make a data set, import it, and return how much of it is as it was written; ``amiss`` names what is not."""
    from eyechart.formats import FORMATS  # noqa: PLC0415 - as above
    from eyechart.frames import decode  # noqa: PLC0415 - as above
    from eyechart.importing.bank import Choices  # noqa: PLC0415 - as above
    from eyechart.importing.lerobot import Horizon  # noqa: PLC0415 - as above

    shutil.rmtree(folder, ignore_errors=True)
    root, (make, how) = folder / "set", SETS[name]
    folder.mkdir(parents=True)
    make(root, **how)
    bank = FORMATS["lerobot"].importer()(root, out=folder / "bank", choices=Choices(), ahead=Horizon(AHEAD, "absolute"))
    written, films = episodes(), bool(how["films"])
    of_films = {camera: decoded(root, camera) for camera in SIZES} if films else {}
    of_lerobot = by_lerobot(root) if make is not by_shape else {}
    counts = dict.fromkeys(("frames", "motions", "numbers", "words", "pictures", "as LeRobot reads them"), 0)
    amiss: list[str] = []
    for frame in bank:
        one, step = written[int(frame.episode)], frame.step
        ahead = one.action[step : step + AHEAD]
        right = {
            "frames": True,
            "motions": bool(frame.motion) == (len(ahead) == AHEAD),
            "numbers": np.array_equal(frame.state["state"], one.state[step])
            and (not frame.motion or np.array_equal(frame.motion, ahead)),
            "words": frame.fields["task"] == TASKS[one.task],
        }
        for camera in SIZES:
            short, own = camera.rpartition(".")[2], one.pictures[camera]
            shown = decode(bank.images(frame)[short], frame.id)
            apart = np.abs(own.astype(int) - shown).mean(axis=(1, 2, 3))
            exact = of_films[camera][int(frame.episode)][step] if films else own[step]
            right[f"{short} picture"] = np.array_equal(shown, exact) and int(apart.argmin()) == step
            if of_lerobot:
                same = np.array_equal(shown, of_lerobot[camera][int(frame.episode)][step])
                right[f"{short} picture as LeRobot reads it"] = same
        amiss += [f"{name}: {frame.id}: {what}" for what, holds in right.items() if not holds]
        for what, holds in right.items():
            counts[_COUNTED.get(what.partition(" ")[2], what)] += bool(holds)
    if counts["frames"] != sum(LENGTHS):
        amiss.append(f"{name}: {counts['frames']} frames of {sum(LENGTHS)}")
    return {**{what: count for what, count in counts.items() if count}, "amiss": amiss}


_COUNTED = {"picture": "pictures", "picture as LeRobot reads it": "as LeRobot reads them"}
