"""A table of votes, hazard or clear: by model and frame, for the picture and its reflection."""

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from eyechart.errors import GuardianError, VoteError
from eyechart.frames import FrameBank, MirrorAxis
from eyechart.modes import RequestMode
from eyechart.prompts import Prompt
from eyechart.stats.committee_votes import HAZARD, MISSING, Point, answers

VIEWS = ("original", "reflected")
"""The two pictures of a frame that a model votes on, in the order of a table's last axis."""

PARTS = ("calibration", "score", "bound")
"""The parts of a split, in a column ``split``."""

HAZARD_COLUMN = "hazard"
_WORDS: dict[object, bool] = {
    **dict.fromkeys(("true", "1", "1.0", "yes", "hazard"), True),
    **dict.fromkeys(("false", "0", "0.0", "no", "clear"), False),
}


@dataclass(frozen=True, slots=True)
class VoteProvenance:
    """The origin of votes. None or absent means not recorded; then a change cannot be noticed.

    ``bank`` is the bank's fingerprint, ``bank_name`` its short name; ``prompt`` and ``view`` are
    keys with digests. ``versions``, ``served`` (the model that all replies name) and ``modes`` are
    by model. ``wording`` is the prompt and ``axis`` the mirror axis, which a stack needs.
    ``reader`` is the version of the reader of scenes, ``voting`` that of the rules for votes.
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
    voting: int | None = None

    @property
    def is_lax(self) -> bool:
        """Return whether the scenes were read before votes had rules of their own."""
        return self.reader is not None and self.voting is None

    def unrecorded(self, models: Collection[str]) -> list[str]:
        """Return descriptions of the facts that these models' votes lack."""
        names = [
            name for name, value in (("bank", self.bank), ("prompt", self.prompt), ("view", self.view)) if not value
        ]
        return names + [f"version of {model}" for model in models if not self.versions.get(model)]

    def only(self, models: Collection[str]) -> "VoteProvenance":
        """Return the origin of these models' votes only."""
        return replace(
            self,
            versions={model: version for model, version in self.versions.items() if model in models},
            served={model: name for model, name in self.served.items() if model in models},
            modes={model: mode for model, mode in self.modes.items() if model in models},
        )


@dataclass(frozen=True)
class VoteTable:
    """Votes of several models on the frames of one bank.

    ``models`` are in lexicographic order, which breaks ties. ``votes`` has shape (models, frames,
    2), for the picture and its reflection: 1 hazard, 0 clear, -1 missing. ``hazard`` (frames,) is
    the truth. ``split`` gives the part of each frame, if the table has one. ``pictures`` are the
    SHA-256 digests of the pictures, if the bank records them; they identify a frame too.

    ``unfinished`` counts by model the calls that its run has still to make; their votes are
    missing. ``why``, in the shape of the votes and for runs only, gives the reason why a reply is
    no vote. It is empty for a vote and for no reply. Raises VoteError for a repeated frame and for
    shapes that do not fit.
    """

    name: str
    frames: tuple[str, ...]
    episodes: tuple[str, ...]
    hazard: npt.NDArray[np.bool_]
    models: tuple[str, ...]
    votes: npt.NDArray[np.int8]
    about: VoteProvenance = field(default_factory=VoteProvenance)
    split: tuple[str, ...] | None = None
    pictures: tuple[str, ...] | None = None
    unfinished: Mapping[str, int] = field(default_factory=dict)
    why: npt.NDArray[np.str_] | None = None

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
        """Return the votes of these models, in this order, shape (models, frames, 2).

        Raises VoteError for a model without votes.
        """
        for model in models:
            if model not in self.models:
                raise VoteError(f"{self.name} has no votes of '{model}'; it has {', '.join(self.models)}")
        return self.votes[[self.models.index(model) for model in models]]

    def missing(self, model: str) -> int:
        """Return how many of a model's votes are missing."""
        return int((self.of([model]) == -1).sum())

    def reasons(self, model: str) -> dict[str, int]:
        """Return how many of a model's replies are no vote, by reason, the most frequent first."""
        if self.why is None:
            return {}
        counted = Counter(self.why[self.models.index(model)].ravel().tolist())
        return {why: n for why, n in counted.most_common() if why}

    def mute_words(self, models: Sequence[str]) -> list[str]:
        """Return a sentence for each of these models that votes hazard on no frame."""
        n = len(self.frames)
        return [
            f"{model} votes hazard on none of the {n} frames: it adds nothing to a committee"
            for model in models
            if not (self.of([model]) == HAZARD).any()
        ]

    def left(self, models: Sequence[str]) -> int:
        """Return how many calls of these models the run has still to make."""
        return sum(self.unfinished.get(model, 0) for model in models)

    def unfinished_words(self, models: Sequence[str]) -> list[str]:
        """Return a sentence if the run has still to make calls of these models."""
        left = self.left(models)
        words = f"{self.name} is a run that is not finished: {left} calls are left; their votes count as missing"
        return [words] if left else []

    def groups(self) -> tuple[tuple[str, ...], npt.NDArray[np.int64]]:
        """Return the sorted episodes, and each frame's number among them."""
        names = tuple(sorted(set(self.episodes)))
        number = {name: place for place, name in enumerate(names)}
        return names, np.array([number[name] for name in self.episodes], dtype=np.int64)

    def keep(self, wanted: Collection[str]) -> "VoteTable":
        """Return the table of these frames only; raises VoteError for an unknown one."""
        chosen = set(wanted)
        if unknown := sorted(chosen - set(self.frames)):
            raise VoteError(f"{self.name} has no frame '{unknown[0]}'")
        return self.rows(place for place, frame in enumerate(self.frames) if frame in chosen)

    def without(self, unwanted: Collection[str]) -> "VoteTable":
        """Return the table without these frames."""
        left_out = set(unwanted)
        return self.rows(place for place, frame in enumerate(self.frames) if frame not in left_out)

    def part(self, *names: str) -> "VoteTable":
        """Return the frames of these parts; raises VoteError without a column ``split``."""
        if self.split is None:
            raise VoteError(f"{self.name} has no column 'split', which says what a frame is for: {', '.join(PARTS)}")
        return self.rows(place for place, part in enumerate(self.split) if part in names)

    def for_use(self, name: str) -> "VoteTable":
        """Return the frames of a part, or all frames of a table without a column ``split``."""
        return self if self.split is None else self.part(name)

    def parted(self, bound_episodes: Collection[str] | None) -> "tuple[VoteTable, VoteTable | None]":
        """Return the frames to score and those for the bound: episodes of this name, or a split."""
        if bound_episodes is not None:
            fresh = self.of_episodes(bound_episodes)
            return self.without(fresh.frames).for_use("score"), fresh
        has_bound = self.split is not None and "bound" in self.split
        return self.for_use("score"), self.part("bound") if has_bound else None

    def of_episodes(self, names: Collection[str]) -> "VoteTable":
        """Return the frames of these episodes; raises VoteError for an unknown one."""
        chosen = set(names)
        if unknown := sorted(chosen - set(self.episodes)):
            raise VoteError(f"{self.name} has no episode '{unknown[0]}'")
        return self.rows(place for place, episode in enumerate(self.episodes) if episode in chosen)

    def rows(self, places: Iterable[int]) -> "VoteTable":
        """Return the frames with these row numbers, in this order."""
        order = list(places)

        def chosen(values: tuple[str, ...]) -> tuple[str, ...]:
            return tuple(values[place] for place in order)

        return replace(
            self,
            frames=chosen(self.frames),
            episodes=chosen(self.episodes),
            hazard=self.hazard[order],
            votes=self.votes[:, order],
            split=None if self.split is None else chosen(self.split),
            pictures=None if self.pictures is None else chosen(self.pictures),
            why=None if self.why is None else self.why[:, order],
        )


def require_both(table: VoteTable) -> None:
    """Raise GuardianError unless a table has hazardous and clear frames."""
    hazards = int(table.hazard.sum())
    if not 0 < hazards < len(table.frames):
        raise GuardianError(f"{table.name}: {hazards} of {len(table.frames)} frames are hazardous; it needs both kinds")


def answered(votes: npt.NDArray[np.int8], threshold: int, point: Point) -> npt.NDArray[np.int64]:
    """Return the answers of a committee with votes of shape (models, frames, 2)."""
    hazard, missing = ((votes == vote).sum(axis=(0, 2)) for vote in (HAZARD, MISSING))
    return answers(hazard, missing, voters=len(votes) * len(VIEWS), threshold=threshold, point=point)


def join(tables: Sequence[VoteTable]) -> VoteTable:
    """Return the votes of all models of these tables on their frames, in the first one's order.

    Raises VoteError that names the difference. Tables must agree in frames, truth, parts, bank,
    prompt, view and reader, and no two may have votes of one model.
    """
    first, *others = tables
    for other in others:
        _require_alike(first, other)
    places = [{frame: place for place, frame in enumerate(other.frames)} for other in others]
    ordered = [one.rows(map(place.__getitem__, first.frames)) for one, place in zip(others, places, strict=True)]
    aligned = [first, *ordered]
    for one in ordered:
        for what in ("hazard", "episodes", "split"):
            mine, theirs = (np.array(getattr(table, what)) for table in (first, one))
            if mine.shape != theirs.shape or (mine != theirs).any():
                raise VoteError(f"{first.name} and {one.name} say of a frame another {what}")
    models = sorted((model, table) for table, one in enumerate(aligned) for model in one.models)
    for (model, table), (again, _) in pairwise(models):
        if model == again:
            raise VoteError(f"'{model}' votes in {aligned[table].name} and in another table: give each model once")
    about = first.about
    for one in ordered:
        about = replace(
            about,
            versions={**about.versions, **one.about.versions},
            served={**about.served, **one.about.served},
            modes={**about.modes, **one.about.modes},
        )
    return replace(
        first,
        name=" + ".join(one.name for one in aligned),
        models=tuple(model for model, _ in models),
        votes=np.concatenate([aligned[table].of([model]) for model, table in models]),
        about=about,
        why=_why(aligned, models),
        unfinished={model: left for one in aligned for model, left in one.unfinished.items()},
    )


def _why(tables: Sequence[VoteTable], models: Sequence[tuple[str, int]]) -> npt.NDArray[np.str_] | None:
    """Return the reasons for missing votes of these models; None if no table is of a run."""
    if all(table.why is None for table in tables):
        return None
    known = [np.full(table.votes.shape, "", dtype=object) if table.why is None else table.why for table in tables]
    return np.stack([known[table][tables[table].models.index(model)] for model, table in models])


def _require_alike(first: VoteTable, other: VoteTable) -> None:
    for what in ("bank", "prompt", "view", "reader", "voting"):
        if getattr(first.about, what) != getattr(other.about, what):
            raise VoteError(f"the {what} of {other.name} is not that of {first.name}, so their votes make no committee")
    if apart := sorted(set(first.frames) ^ set(other.frames)):
        raise VoteError(
            f"{first.name} and {other.name} are not of the same frames: frame '{apart[0]}' is in one of them only"
        )


def hazards_of(bank: FrameBank, column: str = HAZARD_COLUMN) -> dict[str, bool]:
    """Return each frame's truth: the bank's column, or else whether the gap is below threshold.

    Raises VoteError that names the frame if the column holds neither true nor false.
    """
    gap = bank.manifest.gap
    if any(column in frame.truth for frame in bank):
        return {one.id: hazard_of(one.truth.get(column), f"frame '{one.id}': '{column}'") for one in bank}
    if gap is None or column != HAZARD_COLUMN:
        raise VoteError(f"the bank {bank.name} has no column '{column}' of ground truth, which marks the hazards")
    hazards = {}
    for frame in bank:
        value = frame.truth.get(gap.column)
        hazards[frame.id] = isinstance(value, int | float) and not isinstance(value, bool) and value < gap.threshold
    return hazards


def hazard_of(cell: object, what: str) -> bool:
    """Return a cell as the truth of a frame; a VoteError begins with ``what``."""
    value = flag(cell)
    if value is None:
        raise VoteError(f"{what} is {cell!r}, neither true nor false")
    return value


def pictures_of(bank: FrameBank, frames: Sequence[str]) -> tuple[str, ...] | None:
    """Return the recorded digests of frames' pictures; None unless all are recorded."""
    digests = [bank.manifest.images.get(bank.frame(frame).file) for frame in frames]
    found = tuple(digest for digest in digests if digest)
    return found if len(found) == len(digests) else None


def flag(cell: object) -> bool | None:
    """Return a cell as true or false (1, yes, hazard; 0, no, clear), None if it is neither."""
    return _WORDS.get(str(cell).strip().lower())
