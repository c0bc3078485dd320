"""A table of votes: what each model said of each frame, hazard or clear, for the picture and for its reflection."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from eyechart.errors import VoteError
from eyechart.frames import MirrorAxis
from eyechart.modes import RequestMode
from eyechart.prompts import Prompt

VIEWS = ("original", "reflected")
"""The two pictures of a frame that a model votes on, in the order of a table's last axis."""

PARTS = ("calibration", "score", "bound")
"""What a frame may serve for, in a column ``split``."""


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
    its reflection: 1 hazard, 0 clear, -1 missing. ``hazard`` (frames,) is the truth. ``split`` says what each frame is
    for, where the table does. ``pictures`` are the SHA-256 digests of the frames' pictures, where the table is of a
    bank that records them: a frame is then known by its picture too. ``unfinished`` counts by model the votes that its
    run has still to ask for, which are missing here. ``contradicting``, in the shape of the votes and of runs only,
    says which clear votes tell a gap below the threshold, and so contradict themselves. Raises VoteError for a frame
    that stands twice, and for shapes that do not fit.
    """

    name: str
    frames: tuple[str, ...]
    episodes: tuple[str, ...]
    hazard: npt.NDArray[np.bool_]
    models: tuple[str, ...]
    votes: npt.NDArray[np.int8]
    about: About = field(default_factory=About)
    split: tuple[str, ...] | None = None
    pictures: tuple[str, ...] | None = None
    unfinished: Mapping[str, int] = field(default_factory=dict)
    contradicting: npt.NDArray[np.bool_] | None = None

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

    def missing(self, model: str) -> int:
        """Return how many of a model's votes are missing."""
        return int((self.of([model]) == -1).sum())

    def left(self, models: Sequence[str]) -> int:
        """Return how many votes of these models the run has still to ask for."""
        return sum(self.unfinished.get(model, 0) for model in models)

    def unfinished_words(self, models: Sequence[str]) -> list[str]:
        """Return in words that the run has still to ask for votes of these models; nothing where it has not."""
        left = self.left(models)
        words = f"{self.name} is a run that is not finished: {left} calls are left, whose votes count as missing"
        return [words] if left else []

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
            pictures=None if self.pictures is None else chosen(self.pictures),
            contradicting=None if self.contradicting is None else self.contradicting[:, mask],
        )
