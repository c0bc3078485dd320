"""The places of columns: picture, gap, episode and so on; the others become ground truth."""

import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Annotated

import msgspec

from eyechart.conditions import CONDITIONS
from eyechart.errors import BankError, SpecError, did_you_mean, raising, suggestion
from eyechart.frames import FILE_SUFFIX, Camera, MirrorAxis, is_reserved, read_axis, require_exchanged
from eyechart.importing.cells import plain_name
from eyechart.importing.faults import Faults
from eyechart.importing.motion_log import LoggedMotion, Reflection
from eyechart.importing.tables import SourceTable
from eyechart.spaces.discrete import read_toml
from eyechart.spaces.motion import MotionSpace

PICTURED = tuple(name for name, condition in CONDITIONS.items() if "counterfactual" in condition.needs)
"""Places of counterfactual pictures, which change one thing of the moment; a cell may be empty."""

ROLES: dict[str, tuple[str, ...]] = {
    "file": ("file", "file_name"),
    "gap": ("gap",),
    "episode": ("episode",),
    "step": ("step",),
    "scenario": ("scenario",),
    "mirror": ("mirror_axis",),
    **{name: (name, f"{name}{FILE_SUFFIX}") for name in PICTURED},
}
"""The places of a bank, each with its own column names."""

USUAL: dict[str, tuple[str, ...]] = {
    "file": (
        *("filename", "file_path", "filepath", "path", "image", "image_path", "img", "photo"),
        *("image_file", "image_filename", "image_file_name", "image_name", "img_path", "img_file", "img_name"),
        *("photo_path", "photo_file", "picture", "picture_path", "frame_path", "frame_file", "rgb_path"),
    ),
    "gap": ("gap_m", "lead_gap", "lead_gap_m", "distance", "distance_m", "lead_distance", "lead_distance_m", "range_m"),
    "episode": (
        *("episode_id", "episode_index", "drive", "drive_id", "sequence", "sequence_id", "trajectory"),
        *("trajectory_id", "video", "video_id", "clip_id", "run_id", "scene_id", "scene_token"),
    ),
    "step": ("frame_index", "frame_number", "tick", "timestep", "time_step", "frame_no", "frame_idx", "step_index"),
    "scenario": ("scenario_name", "place", "environment", "location", "scene"),
}
"""Usual names of columns, in this order, for a table without a place's own name.

A name that is as often something else is left out: a column ``frame`` may be a number, a name or a
file.
"""

_DISTANCE = re.compile(r"(?:^|_)(gap|distance|dist|range|headway|clearance|lidar|radar|sonar|ultrasonic)(?:_|$)")


def is_distance(column: str) -> bool:
    """Return whether a column's name looks like that of a distance."""
    apart = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", column)
    return _DISTANCE.search(re.sub(r"[^a-z0-9]+", "_", apart.lower())) is not None


def axis_named(mirror: str, faults: Faults) -> MirrorAxis:
    """Return the axis of --mirror; an unknown word is a fault and counts as none."""
    try:
        return read_axis(mirror)
    except ValueError:
        near = suggestion(mirror, ("vertical", "horizontal", "none"))
        faults.add(f"--mirror takes vertical, horizontal or none, not '{mirror}'{near}")
        return "none"


def read_places(words: Sequence[str]) -> dict[str, str]:
    """Return the column of each place in ``PLACE=COLUMN``; raises SpecError for a bad pair."""
    places: dict[str, str] = {}
    for word in words:
        place, equals, column = word.partition("=")
        if not equals or place in places:
            raise SpecError(f"--map takes PLACE=COLUMN once per place, for example gap=lidar_m; got '{word}'")
        places[place] = column
    return places


class CameraColumn(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A camera of a rig, the column of its pictures, and the columns of its counterfactuals.

    In a LeRobotDataset the name is that of its camera, and there is no column.
    """

    name: str
    column: str = ""
    mirror_axis: MirrorAxis = "none"
    mirrors: str = ""
    changed: dict[str, str] = {}


class SensorLayout(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The cameras of a table, and the columns of its states and of its logged motion.

    ``reflection`` declares state and motion in the reflected world.
    """

    camera: Annotated[tuple[CameraColumn, ...], msgspec.Meta(min_length=1)]
    state: dict[str, tuple[str, ...]] = {}
    motion: LoggedMotion | None = None
    reflection: Reflection | None = None

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """Return the cameras as frames have them."""
        return tuple(Camera(one.name, one.mirror_axis, one.mirrors) for one in self.camera)

    @property
    def space(self) -> MotionSpace | None:
        """Return the space of the logged motions, None without motions."""
        return None if self.motion is None else self.motion.space(self.state, self.reflection)

    @property
    def changed(self) -> tuple[str, ...]:
        """Return the kinds of counterfactual pictures, which are equal for all cameras."""
        return tuple(self.camera[0].changed)

    def places(self) -> dict[str, str]:
        """Return the columns by their places; the first camera's is the file."""
        first, *others = self.camera
        taken = {"file": first.column, **{f"camera {one.name}": one.column for one in others}}
        taken |= {f"{kind} {one.name}": column for one in self.camera for kind, column in one.changed.items()}
        numbers = [(name, place, one) for name, many in self.state.items() for place, one in enumerate(many)]
        done = () if self.motion is None else self.motion.number
        taken |= {f"state {name} {place}": one for name, place, one in numbers}
        return taken | {f"motion {place}": one.column for place, one in enumerate(done)}


def read_rig(path: Path, *, of_table: bool = True) -> SensorLayout:
    """Read a rig from a TOML file.

    Each ``[[camera]]`` has name, column, mirror_axis and mirrors. ``[camera.changed]`` names the
    columns of its counterfactual pictures, and ``[state]`` those of each state. ``[motion]``
    declares the log (`LoggedMotion`), with a ``[[motion.number]]`` for each number, and
    ``[reflection]`` the reflected world (`Reflection`). A rig that is not ``of_table`` has cameras
    and ``[reflection]`` alone. Raises SpecError with the file and the fault.
    """
    with raising(SpecError, f"{path} is no rig of cameras", of=(msgspec.ValidationError, BankError, SpecError)):
        rig = msgspec.convert(read_toml(path), SensorLayout)
        require_exchanged(rig.cameras)
        _require_changed_alike(rig.camera)
        (_require_columns if of_table else _require_no_columns)(rig)
        _require_axes(rig)
        if rig.motion is not None:
            rig.motion.space(rig.state, rig.reflection)
    return rig


def _require_columns(rig: SensorLayout) -> None:
    for one in rig.camera:
        if not one.column:
            raise SpecError(f"camera '{one.name}' has no column; name the table's column of its pictures")
    if rig.reflection is not None and rig.motion is None:
        raise SpecError("[reflection] declares a reflected motion, but there is no [motion]")


def _require_no_columns(rig: SensorLayout) -> None:
    own = [f"camera '{one.name}': column" for one in rig.camera if one.column or one.changed]
    own += [name for name, there in (("[state]", rig.state), ("[motion]", rig.motion)) if there]
    if own:
        raise SpecError(f"{own[0]} is for a --table; a LeRobotDataset declares its pictures and numbers itself")


def _require_axes(rig: SensorLayout) -> None:
    """Raise SpecError if a reflection is declared and a camera has no mirror axis."""
    lacking = [one.name for one in rig.camera if one.mirror_axis == "none"]
    if rig.reflection is not None and lacking:
        raise SpecError(f"[reflection] needs the mirror_axis of every camera; '{lacking[0]}' has none")


def _require_changed_alike(cameras: Sequence[CameraColumn]) -> None:
    for camera in cameras:
        if camera.changed.keys() != cameras[0].changed.keys():
            raise BankError(
                f"camera '{camera.name}' has other pictures with one thing changed than '{cameras[0].name}'"
            )
        if unknown := sorted(camera.changed.keys() - set(PICTURED)):
            raise BankError(f"camera '{camera.name}': changed.{unknown[0]} is none of {', '.join(PICTURED)}")


def places(
    mapped: Mapping[str, str],
    table: SourceTable,
    faults: Faults,
    *,
    rig: SensorLayout | None = None,
    kept: Collection[str] = (),
    own: Collection[str] = (),
) -> dict[str, str]:
    """Return the column of each place that has one, with a rig's; an empty name means none.

    A usual name is not taken for a place of ``own``, nor if it is one of ``kept``. An unknown
    place, an unknown column and a column with two places are faults.
    """
    roles = {place: names for place, names in ROLES.items() if rig is None or place not in {*PICTURED, "mirror"}}
    of_rig = {} if rig is None else rig.places()
    result = _given(of_rig, mapped, roles, table, faults)
    for place in (role for role in roles if role not in of_rig and role not in mapped):
        usual = () if place in own else (*roles[place], *USUAL.get(place, ()))
        result[place] = _called(roles[place], usual, table.columns, {*result.values(), *kept})
        if result[place] not in roles[place]:
            _require_one(place, result[place], table, faults)
    if not (result.get("file") or of_rig or mapped.get("file")):
        lacking = f"{table.name} has no column 'file'; name the pictures' column with --map file=COLUMN"
        faults.add(f"{lacking}; {_has(table.columns)}")
    result = {place: result[place] for place in (*roles, *of_rig) if result.get(place)}
    _require_once(result, faults)
    return result


def _require_one(place: str, column: str, table: SourceTable, faults: Faults) -> None:
    """Note as a fault a column taken by its name if another has the same name in other letters."""
    same = [one for one in table.columns if column and plain_name(one) == plain_name(column)]
    if len(same) > 1:
        named = "' and '".join(same)
        faults.add(f"{table.name} has the columns '{named}': choose one with --map {place}=COLUMN")


def _given(
    of_rig: Mapping[str, str], mapped: Mapping[str, str], roles: Collection[str], table: SourceTable, faults: Faults
) -> dict[str, str]:
    """Return the columns that a rig and ``--map`` name; an unknown place or column is a fault."""
    result: dict[str, str] = {}
    for place, column in mapped.items():
        if place not in roles:
            known = f"{', '.join(roles)}{suggestion(place, roles)}"
            faults.add(f"--map {place}={column}: there is no place '{place}'; places are {known}")
        elif column and column not in table.columns:
            faults.add(f"--map {place}={column}: {no_column(column, table.columns, table.name)}")
        else:
            result[place] = column
    for place, column in of_rig.items():
        if column not in table.columns:
            faults.add(
                f"--rig: the {place} is declared as column '{column}': {no_column(column, table.columns, table.name)}"
            )
        else:
            result[place] = column
    return result


def _require_once(found: Mapping[str, str], faults: Faults) -> None:
    """Note as a fault a column with several places."""
    for column in dict.fromkeys(found.values()):
        if len(several := [place for place, one in found.items() if one == column]) > 1:
            faults.add(f"column '{column}' cannot be {' and '.join(several)} at once")


def _called(own: Sequence[str], usual: Sequence[str], columns: Sequence[str], taken: Collection[str]) -> str:
    """Return the column with a place's own name, or with a usual name that is free; else ""."""
    by_name = {plain_name(column): column for column in reversed(columns) if column not in taken}
    named = [*(one for one in own if one in columns), *(by_name[one] for one in usual if one in by_name)]
    return next(iter(named), "")


def no_column(column: str, columns: Sequence[str], table: str) -> str:
    """Return the message of an unknown column, with the nearest and with all columns."""
    return f"{table} has no column '{column}';{did_you_mean(column, columns)} {_has(columns)}"


def _has(columns: Sequence[str]) -> str:
    shown = ", ".join(name for name in columns[:30] if name)
    return f"it has {shown}{', …' if len(columns) > 30 else ''}"


def others(taken: Mapping[str, str], said: Sequence[str], columns: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return the columns kept as ground truth, and those left out as reserved names."""
    free = [name for name in columns if name and name not in {*taken.values(), *said}]
    return [name for name in free if not is_reserved(name)], [name for name in free if is_reserved(name)]
