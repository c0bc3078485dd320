"""Read votes: from a table with two columns a model, or from a run, where "close" is a hazard."""

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from eyechart.calls import CallKey, Reply
from eyechart.errors import BankError, SourceError, VoteError, raising
from eyechart.frames import Frame, FrameBank, open_bank
from eyechart.importing.tables import open_table
from eyechart.integrity import names_of
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER, is_run, read_run
from eyechart.modes import RequestMode
from eyechart.prompts import close_m_of
from eyechart.spaces.discrete import read_toml
from eyechart.spaces.scene import SCENE_READER, SCENE_READERS
from eyechart.stats.committee_votes import MISSING
from eyechart.studies.battery import plan_of
from eyechart.studies.guardian.reply_votes import VOTE_READER, VOTED, read_vote
from eyechart.studies.guardian.votes import (
    HAZARD_COLUMN,
    PARTS,
    VIEWS,
    VoteProvenance,
    VoteTable,
    flag,
    hazard_of,
    hazards_of,
    pictures_of,
)

T = TypeVar("T")

_MOST_FRAMES = 1_000_000
_WHOLE = re.compile(r"-?(?:0|[1-9][0-9]*)\.0+")
"""A whole number written with a fraction: it names one frame in tables of text and of numbers."""


def read_votes(
    path: Path,
    *,
    bank: FrameBank | None = None,
    about: Path | None = None,
    columns: Mapping[str, str] | None = None,
    hazard: str = HAZARD_COLUMN,
) -> VoteTable:
    """Read votes from CSV, JSON lines or Parquet: a row a frame, two columns a model.

    ``columns`` gives other names for the columns ``frame``, ``episode``, ``hazard`` and ``split``.
    A model's columns are ``MODEL/original`` and ``MODEL/reflected``. Votes are true or false (or 1
    and 0, yes and no, hazard and clear); an empty cell is a missing vote. With a ``bank``, episodes
    and truth come from it. ``about`` is a TOML file on the origin of the votes. Raises VoteError
    that names the file, the row and the fault.
    """
    try:
        table = open_table(path)
        models = _models(path, table.columns)
        places = _places(path, table.columns, columns or {}, with_bank=bank is not None)
        rows = list(table.rows)
        table.faults.require_none(path.name)
    except SourceError as error:
        raise VoteError(str(error)) from error
    if not rows:
        raise VoteError(f"{path} has no rows; each row is a frame")
    if len(rows) > _MOST_FRAMES:
        raise VoteError(f"{path} has more than {_MOST_FRAMES} frames")

    def column(name: str, read: Callable[[object, str], T]) -> tuple[T, ...]:
        return tuple(read(row.get(name), f"{path}, row {number}: '{name}'") for number, row in enumerate(rows, 1))

    frames = column(places["frame"], _text)
    if bank is None:
        episodes, truth = column(places["episode"], _text), column(places["hazard"], hazard_of)
    else:
        known, ids = hazards_of(bank, hazard), {frame.id for frame in bank}
        for number, frame in enumerate(frames, 1):
            if frame not in ids:
                raise VoteError(f"{path}, row {number}: the bank {bank.name} has no frame '{frame}'")
        episodes, truth = tuple(bank.frame(frame).drive for frame in frames), tuple(known[frame] for frame in frames)
    votes = [[column(f"{model}/{view}", _vote) for view in VIEWS] for model in models]
    return VoteTable(
        name=path.name,
        frames=frames,
        episodes=episodes,
        hazard=np.array(truth, dtype=np.bool_),
        models=models,
        votes=np.array(votes, dtype=np.int8).transpose(0, 2, 1),
        split=column(places["split"], _part) if "split" in places else None,
        about=_about(about, models, bank),
        pictures=None if bank is None else pictures_of(bank, frames),
    )


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


def _places(path: Path, have: Sequence[str], mapped: Mapping[str, str], *, with_bank: bool) -> dict[str, str]:
    roles = ("frame", "episode", "hazard", "split")
    for role, column in mapped.items():
        if role not in roles:
            raise VoteError(f"--map {role}={column}: there is no place '{role}'; places are {', '.join(roles)}")
        if column not in have:
            raise VoteError(f"--map {role}={column}: {path} has no column '{column}'; it has {', '.join(have[:30])}")
    places = {role: mapped.get(role, role) for role in roles if mapped.get(role, role) in have}
    for role in ("frame",) if with_bank else ("frame", "episode", "hazard"):
        if role not in places:
            more = "" if role == "frame" else ", or give the bank with --frames"
            raise VoteError(f"{path} has no column '{role}'; name it with --map {role}=COLUMN{more}")
    return places


def _text(cell: object, what: str) -> str:
    if isinstance(cell, float) and cell.is_integer():
        cell = int(cell)
    text = "" if cell is None else str(cell).strip()
    if _WHOLE.fullmatch(text):
        text = text.partition(".")[0]
    if not text or not text.isprintable() or (isinstance(cell, float) and not math.isfinite(cell)):
        raise VoteError(f"{what} is {cell!r}; every row needs one, on one line")
    return text


def _part(cell: object, what: str) -> str:
    text = _text(cell, what)
    if text not in PARTS:
        raise VoteError(f"{what} is '{text}', not one of {', '.join(PARTS)}")
    return text


def _vote(cell: object, what: str) -> int:
    value = MISSING if cell is None else flag(cell)
    if value is None:
        raise VoteError(f"{what} is {cell!r}; a vote is true or false, or empty where it is missing")
    return int(value)


def _about(path: Path | None, models: Sequence[str], bank: FrameBank | None) -> VoteProvenance:
    fingerprint, name = (None, "") if bank is None else (bank.manifest.fingerprint, bank.name)
    if path is None:
        return VoteProvenance(bank=fingerprint, bank_name=name)
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
    return VoteProvenance(
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


CONDITIONS = ("real", "mirrored")
"""The conditions of a model's two votes, in the order of `VIEWS`."""


def votes_from(
    source: Path,
    *,
    bank: FrameBank | None,
    about: Path | None,
    columns: Mapping[str, str],
    hazard: str = HAZARD_COLUMN,
    reread: bool = False,
) -> VoteTable:
    """Return the votes of a run's folder (`votes_of_run`), or of a table (`read_votes`).

    A run records how its votes were made, so it takes no ``about`` or ``columns``, and no other
    bank than its own. Raises VoteError.
    """
    if not source.exists():
        raise VoteError(f"{source} does not exist: give the folder of a run of scene estimates, or a table of votes")
    if not source.is_dir():
        return read_votes(source, bank=bank, about=about, columns=columns, hazard=hazard)
    if about is not None or columns:
        raise VoteError(f"{source} is a run and already records how its votes were made: leave out --about and --map")
    table = votes_of_run(source, hazard=hazard, reread=reread)
    if bank is not None and bank.manifest.fingerprint != table.about.bank:
        raise VoteError(
            f"{source} is a run on the bank {table.about.bank_name}, and {bank.root} is another one: the bank differs; "
            "give that run's bank to --frames, or leave that out"
        )
    return table


def votes_of_run(path: Path, *, hazard: str = HAZARD_COLUMN, reread: bool = False) -> VoteTable:
    """Return the votes of every model of a run; other replies are missing votes with a reason.

    Truth is the bank's column ``hazard``, or else whether the gap is below its threshold. Raises
    VoteError if the folder is no run of scene estimates, or if another version of the reader began
    it and ``reread`` is not set.
    """
    _require_no_bank(path)
    manifest, bank = read_run(path)
    if not manifest.prompt.asks_scene:
        raise VoteError(f"{path} is a run of the study '{manifest.study}', whose replies are no scene estimates")
    if manifest.reader not in SCENE_READERS and not reread:
        raise VoteError(
            f"{path} was begun under version {manifest.reader} of the reader of scenes; this is version "
            f"{SCENE_READER}: its votes may differ from those seen before; read its replies anew with --reread"
        )
    if (close_m := close_m_of(manifest.prompt)) is None:
        raise VoteError(
            f"{path}: its prompt '{manifest.prompt.name}' does not say below which distance a lead is close"
        )
    plan = replace(plan_of(manifest, bank), shard=None)  # a shard lacks the votes of the others
    frames, models = plan.frames, tuple(sorted(manifest.models))
    votes = np.full((len(models), len(frames), 2), MISSING, dtype=np.int8)
    why = np.full(votes.shape, "", dtype=object)
    with Ledger(path / LEDGER) as ledger:
        finished = ledger.finished()
        served = {
            model: _cast(ledger.replies(model), frames, votes[number], why[number], close_m)
            for number, model in enumerate(models)
        }
    truth, axes = hazards_of(bank, hazard), {frame.mirror_axis for frame in frames}
    about = VoteProvenance(
        bank=bank.manifest.fingerprint,
        bank_name=bank.name,
        prompt=manifest.prompt.key,
        view=manifest.view,
        versions=dict(manifest.models),
        served={model: name for model, names in served.items() if (name := _served_as(names)) is not None},
        modes=dict(manifest.modes),
        wording=manifest.prompt,
        axis=axes.pop() if len(axes) == 1 else None,
        reader=VOTED.reader,
        voting=VOTE_READER,
    )
    return VoteTable(
        name=path.name,
        frames=tuple(frame.id for frame in frames),
        episodes=tuple(frame.drive for frame in frames),
        hazard=np.array([truth[frame.id] for frame in frames], dtype=np.bool_),
        models=models,
        votes=votes,
        about=about,
        pictures=pictures_of(bank, [frame.id for frame in frames]),
        unfinished={
            model: sum(key.condition in CONDITIONS and key not in finished for key in plan.keys_of(model))
            for model in models
        },
        why=why,
    )


def read_ids(path: Path) -> list[str]:
    """Return the ids of frames in a file, one a line; raises VoteError if it is no text."""
    with raising(VoteError, f"{path} is no list of frame ids, one a line", of=(OSError, ValueError)):
        return [line.strip() for line in path.read_text(encoding="utf-8-sig").splitlines() if line.strip()]


def _require_no_bank(folder: Path) -> None:
    """Raise VoteError for a bank, and say how it becomes votes."""
    if is_run(folder):
        return
    with suppress(BankError):  # the reader of the run reports what else is wrong
        open_bank(folder)
        studies = "admission", "structured"
        ways = " or ".join(f"'eyechart run {one} --model SPEC --frames {folder} --out RUN'" for one in studies)
        raise VoteError(f"{folder} is a bank, which holds no votes: ask models with {ways}, and give that run's folder")


def _served_as(names: Mapping[str, str]) -> str | None:
    """Return the model that all replies name, and later votes must; ``names`` is `_cast`'s.

    Configurations of one model count as that model. If the replies name several models, no later
    reply matches, so a guardian chosen on them gets no vote.
    """
    models = sorted(set(names.values()))
    return next(iter(names)) if len(names) == 1 else " and ".join(models) or None


def _cast(
    replies: Iterable[tuple[CallKey, Reply]],
    frames: Sequence[Frame],
    votes: npt.NDArray[np.int8],
    why: npt.NDArray[np.str_],
    close_m: float,
) -> dict[str, str]:
    """Fill in a model's votes and the reasons for missing ones, both (frames, 2).

    Returns the served names, each with its model's name without the server's configuration.
    """
    place = {frame.id: number for number, frame in enumerate(frames)}
    served = dict[str, str]()
    for key, reply in replies:
        if key.frame in place and key.condition in CONDITIONS:
            if reply.error is None and reply.served is not None:
                served[reply.served] = names_of(reply)[0] or reply.served
            found, at = read_vote(reply, close_m), (place[key.frame], CONDITIONS.index(key.condition))
            votes[at], why[at] = MISSING if found.hazard is None else int(found.hazard), found.why
    return served
