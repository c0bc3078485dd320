"""Objects of nuScenes (Caesar et al. 2020): tables in JSON, with boxes in space for every key frame."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from eyechart.edits.annotations import OTHER, Annotations, ObjectBox, Photo
from eyechart.edits.geometry import Box
from eyechart.edits.text_labels import BoundedNumber, read_document
from eyechart.errors import SourceError, raising
from eyechart.importing.cells import Cell
from eyechart.importing.faults import Faults
from eyechart.importing.photographs import Photographs

CHANNEL = "CAM_FRONT"
_LEAST_DEPTH_M = 0.5
_OCCLUDED = {"4": 0.0, "3": 1.0}
"""By the token of its visibility: 80 to 100 %, and 60 to 80 %; less is largely covered."""

_Floats = NDArray[np.float64]
_Three = tuple[BoundedNumber, BoundedNumber, BoundedNumber]
_SideLength = Annotated[float, msgspec.Meta(gt=0, le=1e9)]
_Four = tuple[BoundedNumber, BoundedNumber, BoundedNumber, BoundedNumber]
T = TypeVar("T")


class _Row(msgspec.Struct):
    token: str


class _EgoPose(_Row):
    translation: _Three
    rotation: _Four


class _Mount(_EgoPose):
    sensor_token: str
    camera_intrinsic: list[list[BoundedNumber]]


class _Sensor(_Row):
    channel: str


class _Shot(_Row):
    sample_token: str
    ego_pose_token: str
    calibrated_sensor_token: str
    filename: str
    is_key_frame: bool
    width: int
    height: int


class _Sample(_Row):
    timestamp: int
    scene_token: str


class _Drive(_Row):
    name: str
    log_token: str


class _Log(_Row):
    location: str


class _SpaceBox(_Row):
    sample_token: str
    translation: _Three
    rotation: _Four
    size: tuple[_SideLength, _SideLength, _SideLength]
    visibility_token: str = ""


def read(folder: Path, objects: Path, faults: Faults) -> Annotations:
    """Read a folder of tables; pictures are those of the front camera in key frames.

    The horizon is where the way that the vehicle points along vanishes.
    """
    poses, mounts = _table(objects, "ego_pose", _EgoPose), _table(objects, "calibrated_sensor", _Mount)
    sensors, samples = _table(objects, "sensor", _Sensor), _table(objects, "sample", _Sample)
    drives, logs = _table(objects, "scene", _Drive), _table(objects, "log", _Log)
    boxes: dict[str, list[_SpaceBox]] = {}
    for one in _table(objects, "sample_annotation", _SpaceBox).values():
        if one.sample_token not in samples:  # its picture would pass for an empty road
            faults.add(f"sample_annotation {one.token}: no sample has its sample_token '{one.sample_token}'")
        boxes.setdefault(one.sample_token, []).append(one)
    pictures, photos, steps = Photographs(folder, objects), [], dict[str, int]()
    shots = [one for one in _table(objects, "sample_data", _Shot).values() if one.is_key_frame]
    with raising(SourceError, f"{objects}: a table refers to a token that another has not", of=KeyError):
        shots = [one for one in shots if sensors[mounts[one.calibrated_sensor_token].sensor_token].channel == CHANNEL]
        for shot in sorted(shots, key=lambda one: samples[one.sample_token].timestamp):
            sample = samples[shot.sample_token]
            drive = drives[sample.scene_token]
            step = steps[drive.token] = steps.get(drive.token, -1) + 1
            mount, pose = mounts[shot.calibrated_sensor_token], poses[shot.ego_pose_token]
            cells: dict[str, Cell] = {"episode": drive.name, "step": step, "scenario": logs[drive.log_token].location}
            with faults.noted():
                file = pictures.locate(shot.filename, f"sample_data {shot.token}: the file")
                if not (folder / file).is_file():
                    raise SourceError(f"sample_data {shot.token}: there is no picture '{file}' in {folder}")
                column, row = _vanishing(mount)
                things = tuple(_things(boxes.get(shot.sample_token, []), mount, pose, shot))
                size = shot.width, shot.height
                where = f"sample {shot.sample_token}"
                photos.append(Photo(file, cells, row, column, things=things, where=where, size=size))
    return Annotations(tuple(photos), ("episode", "step", "scenario"))


def _table(folder: Path, name: str, kind: type[T]) -> dict[str, T]:
    """Return a table's rows by their token."""
    rows: list[Any] = read_document(folder / f"{name}.json", list[kind], "table of nuScenes")  # type: ignore[valid-type]
    made: dict[str, T] = {}
    for row in rows:
        if made.setdefault(row.token, row) is not row:
            raise SourceError(f"{folder / name}.json has two rows of the token '{row.token}'; keep one")
    return made


def turned(rotation: _Four) -> _Floats:
    """Return the matrix (3, 3) of a quaternion w, x, y, z; raises SourceError for no rotation."""
    four = np.asarray(rotation, np.float64)
    length = float(np.linalg.norm(four))
    if not 0.5 < length < 2:
        raise SourceError(f"a rotation is {list(rotation)}, which is no quaternion of length 1")
    w, x, y, z = four / length
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def _lens(mount: _Mount) -> _Floats:
    rows = mount.camera_intrinsic
    lens = np.asarray(rows if {*map(len, rows)} == {3} else [], np.float64)
    if lens.shape != (3, 3) or not np.isfinite(lens).all():
        raise SourceError(f"calibrated_sensor {mount.token} has no camera_intrinsic of 3×3 numbers")
    return lens


def _vanishing(mount: _Mount) -> tuple[float, float]:
    """Return column and row of the point where the vehicle's own direction vanishes."""
    ahead = turned(mount.rotation).T @ np.array([1.0, 0.0, 0.0])
    if ahead[2] <= 0.1:
        raise SourceError(f"calibrated_sensor {mount.token} does not look ahead")
    at = _lens(mount) @ (ahead / ahead[2])
    return float(at[0]), float(at[1])


def _things(boxes: list[_SpaceBox], mount: _Mount, pose: _EgoPose, shot: _Shot) -> Iterator[ObjectBox]:
    """Yield the boxes that stand in front of a camera, as they are seen in its picture."""
    lens, from_ego, from_world = _lens(mount), turned(mount.rotation).T, turned(pose.rotation).T
    signs = np.array([[a, b, c] for a in (-0.5, 0.5) for b in (-0.5, 0.5) for c in (-0.5, 0.5)])
    for one in boxes:
        width, length, height = one.size
        corners = (signs * (length, width, height)) @ turned(one.rotation).T + np.asarray(one.translation)
        seen = ((corners - pose.translation) @ from_world.T - mount.translation) @ from_ego.T
        if seen[:, 2].min() < _LEAST_DEPTH_M:
            if seen[:, 2].max() > _LEAST_DEPTH_M and seen[:, 0].min() < 0 < seen[:, 0].max():
                raise SourceError(
                    f"sample_annotation {one.token}: it stands before the camera, nearer than {_LEAST_DEPTH_M:g} m; "
                    "leave its sample out"
                )
            continue
        at = seen @ lens.T
        at = at[:, :2] / at[:, 2:]
        whole = Box(*at.min(axis=0), *at.max(axis=0))
        box = Box(max(whole.x0, 0), max(whole.y0, 0), min(whole.x1, shot.width), min(whole.y1, shot.height))
        if box.x1 - box.x0 < 1 or box.y1 - box.y0 < 1:
            continue
        inside = (box.x1 - box.x0) * (box.y1 - box.y0) / ((whole.x1 - whole.x0) * (whole.y1 - whole.y0))
        yield ObjectBox(
            OTHER,
            Box(*(float(edge) for edge in box)),
            float(seen[:, 2].min()),
            truncated=0.0 if inside > 0.999 else float(1 - inside),
            occluded=_OCCLUDED.get(one.visibility_token, 2.0) if one.visibility_token else 0.0,
            where=f"sample_annotation {one.token}",
        )
