"""Votes are read from a table: a row a frame, two columns a model, and a file that says how they came about."""

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from eyechart.errors import SourceError, VoteError
from eyechart.frames import FrameBank
from eyechart.importing.tables import Row, open_table
from eyechart.modes import RequestMode
from eyechart.spaces.discrete import read_toml
from eyechart.stats.committee import MISSING
from eyechart.studies.guardian.votes import (
    HAZARD_COLUMN,
    PARTS,
    VIEWS,
    About,
    VoteTable,
    episode_of,
    flag,
    hazards_of,
    pictures_of,
)

_MOST_FRAMES = 1_000_000
_WHOLE = re.compile(r"-?(?:0|[1-9][0-9]*)\.0+")
"""A number without a fraction, written with one: it names the same frame in a table of text and in one of numbers."""


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
    pictures = None if bank is None else pictures_of(bank, frames)
    truth = np.array(known[1], dtype=np.bool_)
    return VoteTable(path.name, frames, known[0], truth, models, votes, told, split, pictures)


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
        value = flag(row.get(places["hazard"]))
        if value is None:
            given = row.get(places["hazard"])
            raise VoteError(f"{path}, row {number}: '{places['hazard']}' is {given!r}, neither true nor false")
        truth.append(value)
    return episodes, tuple(truth)


def _text(path: Path, number: int, row: Row, column: str) -> str:
    cell = row.get(column)
    if isinstance(cell, float) and cell.is_integer():
        cell = int(cell)
    text = "" if cell is None else str(cell).strip()
    if _WHOLE.fullmatch(text):
        text = text.partition(".")[0]
    if not text or not text.isprintable() or (isinstance(cell, float) and not math.isfinite(cell)):
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
    value = flag(cell)
    if value is None:
        raise VoteError(
            f"{path}, row {number}: '{column}' is {cell!r}; a vote is true or false, or empty where it is missing"
        )
    return int(value)


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
        if "mode" in said:
            if not isinstance(said["mode"], dict):
                raise VoteError(f"{path}: the mode of '{model}' is {said['mode']!r}, not a table of a request mode")
            modes[model] = RequestMode.from_dict({"spec": model, **said["mode"]}, f"{path}, {model}")
    return versions, modes
