"""A table of votes: what each model said of each frame, hazard or clear, for the picture and for its reflection."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from eyechart.actions import read_toml
from eyechart.errors import SourceError, VoteError
from eyechart.frames import Frame, FrameBank, MirrorAxis
from eyechart.importing.tables import Cell, Row, open_table
from eyechart.modes import RequestMode
from eyechart.prompts import Prompt
from eyechart.stats.committee import MISSING

VIEWS = ("original", "reflected")
"""The two pictures of a frame that a model votes on, in the order of a table's last axis."""

PARTS = ("calibration", "score", "bound")
"""What a frame may serve for, in a column ``split``."""

HAZARD_COLUMN = "hazard"
_WORDS: dict[object, bool] = {
    **dict.fromkeys(("true", "1", "1.0", "yes", "hazard"), True),
    **dict.fromkeys(("false", "0", "0.0", "no", "clear"), False),
}
_MOST_FRAMES = 1_000_000


@dataclass(frozen=True, slots=True)
class About:
    """How votes came about. What was not recorded is None, or absent; a change of it cannot be found.

    ``bank`` is the bank's fingerprint and ``bank_name`` its short name, ``prompt`` and ``view`` are keys with
    digests; ``versions``, ``served`` (what replies name as their model, where they all name one) and ``modes`` are by
    model. ``wording`` is the prompt itself and ``axis`` the mirror axis of the pictures, which a stack needs;
    ``reader`` is the version of the reader of scenes.
    """

    bank: str | None = None
    bank_name: str = ""
    prompt: str | None = None
    view: str | None = None
    versions: Mapping[str, str] = field(default_factory=dict)
    served: Mapping[str, str] = field(default_factory=dict)
    modes: Mapping[str, RequestMode] = field(default_factory=dict)
    wording: Prompt | None = None
    axis: MirrorAxis | None = None
    reader: int | None = None

    def unrecorded(self, models: Collection[str]) -> list[str]:
        """Return in words what was not recorded of these models' votes."""
        names = [
            name for name, value in (("bank", self.bank), ("prompt", self.prompt), ("view", self.view)) if not value
        ]
        return names + [f"version of {model}" for model in models if not self.versions.get(model)]

    def only(self, models: Collection[str]) -> "About":
        """Return what is known of these models."""
        return replace(
            self,
            versions={model: version for model, version in self.versions.items() if model in models},
            served={model: name for model, name in self.served.items() if model in models},
            modes={model: mode for model, mode in self.modes.items() if model in models},
        )


@dataclass(frozen=True)
class VoteTable:
    """Votes of several models on the frames of one bank.

    ``models`` are in lexicographic order, which breaks ties. ``votes`` has shape (models, frames, 2), the picture and
    its reflection: 1 hazard, 0 clear, -1 missing. ``hazard`` (frames,) is the truth. ``split`` says what each frame
    is for, where the table does. Raises VoteError for a frame that stands twice, and for shapes that do not fit.
    """

    name: str
    frames: tuple[str, ...]
    episodes: tuple[str, ...]
    hazard: npt.NDArray[np.bool_]
    models: tuple[str, ...]
    votes: npt.NDArray[np.int8]
    about: About = field(default_factory=About)
    split: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        if len(set(self.frames)) != len(self.frames):
            twice = next(frame for frame in self.frames if self.frames.count(frame) > 1)
            raise VoteError(f"{self.name}: frame '{twice}' stands there twice; a frame is one row")
        if self.votes.shape != (len(self.models), len(self.frames), 2) or not np.isin(self.votes, (1, 0, -1)).all():
            raise VoteError(
                f"{self.name}: votes have shape {self.votes.shape}; they are 1, 0 or -1 of (models, frames, 2)"
            )
        if list(self.models) != sorted(set(self.models)):
            raise VoteError(f"{self.name}: models must be different and in lexicographic order, which breaks ties")
        if len(self.episodes) != len(self.frames) or self.hazard.shape != (len(self.frames),):
            raise VoteError(f"{self.name}: every frame needs one episode and one truth")

    def of(self, models: Sequence[str]) -> npt.NDArray[np.int8]:
        """Return the votes of these models, in this order, shape (models, frames, 2); raises VoteError for another."""
        for model in models:
            if model not in self.models:
                raise VoteError(f"{self.name} has no votes of '{model}'; it has {', '.join(self.models)}")
        return self.votes[[self.models.index(model) for model in models]]

    def groups(self) -> tuple[tuple[str, ...], npt.NDArray[np.int64]]:
        """Return the episodes, sorted, and the number of each frame's among them."""
        names = tuple(sorted(set(self.episodes)))
        number = {name: place for place, name in enumerate(names)}
        return names, np.array([number[name] for name in self.episodes], dtype=np.int64)

    def keep(self, wanted: Collection[str]) -> "VoteTable":
        """Return the table of these frames only; raises VoteError for one that it has not."""
        asked = set(wanted)
        if unknown := sorted(asked - set(self.frames)):
            raise VoteError(f"{self.name} has no frame '{unknown[0]}'")
        return self._rows([frame in asked for frame in self.frames])

    def without(self, unwanted: Collection[str]) -> "VoteTable":
        """Return the table without these frames."""
        left_out = set(unwanted)
        return self._rows([frame not in left_out for frame in self.frames])

    def part(self, *names: str) -> "VoteTable":
        """Return the frames that its column ``split`` gives to these parts; raises VoteError where there is no such."""
        if self.split is None:
            raise VoteError(f"{self.name} has no column 'split', which says what a frame is for: {', '.join(PARTS)}")
        return self._rows([part in names for part in self.split])

    def of_episodes(self, names: Collection[str]) -> "VoteTable":
        """Return the frames of these episodes; raises VoteError for an episode that it has not."""
        asked = set(names)
        if unknown := sorted(asked - set(self.episodes)):
            raise VoteError(f"{self.name} has no episode '{unknown[0]}'")
        return self._rows([episode in asked for episode in self.episodes])

    def _rows(self, kept: Sequence[bool]) -> "VoteTable":
        mask = np.array(kept, dtype=np.bool_)

        def chosen(values: tuple[str, ...]) -> tuple[str, ...]:
            return tuple(value for value, keep in zip(values, kept, strict=True) if keep)

        return replace(
            self,
            frames=chosen(self.frames),
            episodes=chosen(self.episodes),
            hazard=self.hazard[mask],
            votes=self.votes[:, mask],
            split=None if self.split is None else chosen(self.split),
        )


def hazards_of(bank: FrameBank, column: str = HAZARD_COLUMN) -> dict[str, bool]:
    """Return the truth of each frame: the bank's column, or where it has none whether the gap is below its threshold.

    Raises VoteError naming the frame where the column holds neither true nor false.
    """
    gap = bank.manifest.gap
    if any(column in frame.truth for frame in bank):
        return {frame.id: _truth(frame, column) for frame in bank}
    if gap is None or column != HAZARD_COLUMN:
        raise VoteError(f"the bank {bank.name} has no column '{column}' of ground truth, which says what is a hazard")
    found = {}
    for frame in bank:
        value = frame.truth.get(gap.column)
        found[frame.id] = isinstance(value, int | float) and not isinstance(value, bool) and value < gap.threshold
    return found


def _truth(frame: Frame, column: str) -> bool:
    value = _flag(frame.truth.get(column))
    if value is None:
        raise VoteError(f"frame '{frame.id}': '{column}' is {frame.truth.get(column)!r}, neither true nor false")
    return value


def episode_of(frame: Frame) -> str:
    """Return the name of a frame's episode in a table: names of episodes may recur in another scenario."""
    return f"{frame.scenario}/{frame.episode}"


def read_votes(
    path: Path,
    *,
    bank: FrameBank | None = None,
    about: Path | None = None,
    columns: Mapping[str, str] | None = None,
    hazard: str = HAZARD_COLUMN,
) -> VoteTable:
    """Read votes from CSV, JSON lines or Parquet: a row a frame, two columns a model.

    The columns ``frame``, ``episode``, ``hazard`` and ``split`` may have other names, given in ``columns``; a model's
    are ``MODEL/original`` and ``MODEL/reflected``. Votes are true or false (or 1 and 0, yes and no, hazard and
    clear); an empty cell is a missing vote. With a ``bank``, episodes and truth are its own. ``about`` is a TOML file
    that says how the votes came about. Raises VoteError that names the file, the row and what is wrong.
    """
    try:
        table = open_table(path)
        models = _models(path, table.columns)
        places = _places(path, table.columns, columns or {}, with_bank=bank is not None)
        rows = _bounded(path, list(table.rows))
    except SourceError as error:
        raise VoteError(str(error)) from error
    frames = tuple(_text(path, number, row, places["frame"]) for number, row in enumerate(rows, 1))
    known = _of_bank(path, frames, bank, hazard) if bank is not None else _of_rows(path, rows, places)
    votes = np.full((len(models), len(rows), 2), MISSING, dtype=np.int8)
    for place, model in enumerate(models):
        for view, view_name in enumerate(VIEWS):
            name = f"{model}/{view_name}"
            votes[place, :, view] = [_vote(path, number, row, name) for number, row in enumerate(rows, 1)]
    split = None
    if "split" in places:
        split = tuple(_part(path, number, row, places["split"]) for number, row in enumerate(rows, 1))
    told = _about(about, models, bank)
    return VoteTable(path.name, frames, known[0], np.array(known[1], dtype=np.bool_), models, votes, told, split)


def _models(path: Path, columns: Sequence[str]) -> tuple[str, ...]:
    found: dict[str, set[str]] = {}
    for column in columns:
        model, _, view = column.rpartition("/")
        if model and view in VIEWS:
            found.setdefault(model, set()).add(view)
    for model, views in found.items():
        if lacking := [view for view in VIEWS if view not in views]:
            raise VoteError(f"{path} has no column '{model}/{lacking[0]}'; a model votes on {' and '.join(VIEWS)}")
    if not found:
        raise VoteError(f"{path} has no votes; a model's columns are MODEL/original and MODEL/reflected")
    return tuple(sorted(found))


def _places(path: Path, have: Sequence[str], asked: Mapping[str, str], *, with_bank: bool) -> dict[str, str]:
    roles = ("frame", "episode", "hazard", "split")
    for role, column in asked.items():
        if role not in roles:
            raise VoteError(f"--map {role}={column}: there is no place '{role}'; places are {', '.join(roles)}")
        if column not in have:
            raise VoteError(f"--map {role}={column}: {path} has no column '{column}'; it has {', '.join(have[:30])}")
    places = {role: asked.get(role, role) for role in roles if asked.get(role, role) in have}
    for role in ("frame",) if with_bank else ("frame", "episode", "hazard"):
        if role not in places:
            more = "" if role == "frame" else ", or give the bank with --frames"
            raise VoteError(f"{path} has no column '{role}'; name it with --map {role}=COLUMN{more}")
    return places


def _bounded(path: Path, rows: list[Row]) -> list[Row]:
    if not rows:
        raise VoteError(f"{path} has no rows; each row is a frame")
    if len(rows) > _MOST_FRAMES:
        raise VoteError(f"{path} has more than {_MOST_FRAMES} frames")
    return rows


def _of_bank(
    path: Path, frames: Sequence[str], bank: FrameBank, hazard: str
) -> tuple[tuple[str, ...], tuple[bool, ...]]:
    truth, ids = hazards_of(bank, hazard), {frame.id for frame in bank}
    for number, frame in enumerate(frames, 1):
        if frame not in ids:
            raise VoteError(f"{path}, row {number}: the bank {bank.name} has no frame '{frame}'")
    return tuple(episode_of(bank.frame(frame)) for frame in frames), tuple(truth[frame] for frame in frames)


def _of_rows(path: Path, rows: Sequence[Row], places: Mapping[str, str]) -> tuple[tuple[str, ...], tuple[bool, ...]]:
    episodes = tuple(_text(path, number, row, places["episode"]) for number, row in enumerate(rows, 1))
    truth = []
    for number, row in enumerate(rows, 1):
        value = _flag(row.get(places["hazard"]))
        if value is None:
            given = row.get(places["hazard"])
            raise VoteError(f"{path}, row {number}: '{places['hazard']}' is {given!r}, neither true nor false")
        truth.append(value)
    return episodes, tuple(truth)


def _text(path: Path, number: int, row: Row, column: str) -> str:
    cell = row.get(column)
    if isinstance(cell, float) and cell == int(cell):
        cell = int(cell)
    text = "" if cell is None else str(cell).strip()
    if not text or not text.isprintable():
        raise VoteError(f"{path}, row {number}: '{column}' is {cell!r}; every row needs one, on one line")
    return text


def _part(path: Path, number: int, row: Row, column: str) -> str:
    text = _text(path, number, row, column)
    if text not in PARTS:
        raise VoteError(f"{path}, row {number}: '{column}' is '{text}', not one of {', '.join(PARTS)}")
    return text


def _vote(path: Path, number: int, row: Row, column: str) -> int:
    cell = row.get(column)
    if cell is None:
        return MISSING
    value = _flag(cell)
    if value is None:
        raise VoteError(
            f"{path}, row {number}: '{column}' is {cell!r}; a vote is true or false, or empty where it is missing"
        )
    return int(value)


def _flag(cell: Cell) -> bool | None:
    return _WORDS.get(str(cell).strip().lower())


def _about(path: Path | None, models: Sequence[str], bank: FrameBank | None) -> About:
    fingerprint, name = (None, "") if bank is None else (bank.manifest.fingerprint, bank.name)
    if path is None:
        return About(bank=fingerprint, bank_name=name)
    raw = read_toml(path)
    known = {"bank", "bank_name", "prompt", "view", "models"}
    for key, value in raw.items():
        if key not in known:
            raise VoteError(f"{path}: there is no '{key}'; there are {', '.join(sorted(known))}")
        if key != "models" and (not isinstance(value, str) or not value):
            raise VoteError(f"{path}: {key} is {value!r}, not a text")
    said = {key: str(value) for key, value in raw.items() if key != "models"}
    if bank is not None and said.get("bank", fingerprint) != fingerprint:
        raise VoteError(f"{path}: the votes are of bank {said['bank']}, not of {name}")
    versions, modes = _of_models(path, raw.get("models", {}), models)
    return About(
        bank=fingerprint or said.get("bank"),
        bank_name=name or said.get("bank_name", ""),
        prompt=said.get("prompt"),
        view=said.get("view"),
        versions=versions,
        modes=modes,
    )


def _of_models(path: Path, raw: object, models: Sequence[str]) -> tuple[dict[str, str], dict[str, RequestMode]]:
    if not isinstance(raw, dict):
        raise VoteError(f'{path}: models is a table: [models."SPEC"] with version and, for a stack, mode')
    versions, modes = {}, {}
    for model, said in raw.items():
        if model not in models:
            raise VoteError(f"{path}: there are no votes of '{model}'; there are of {', '.join(models)}")
        if not isinstance(said, dict) or not set(said) <= {"version", "mode"}:
            raise VoteError(f'{path}: [models."{model}"] has version and mode, nothing else')
        if "version" in said:
            versions[model] = str(said["version"])
        if isinstance(said.get("mode"), dict):
            modes[model] = RequestMode.from_dict({"spec": model, **said["mode"]}, f"{path}, {model}")
    return versions, modes
