"""The control pictures of one photograph: the lead near, far, anywhere, exchanged, away, patched."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Self

import numpy as np

from eyechart.edits import checks
from eyechart.edits.annotations import Photo
from eyechart.edits.checks import USUAL, EditLimits
from eyechart.edits.fill import Plate, filled
from eyechart.edits.geometry import Mask, blur_of, scaled
from eyechart.edits.horizon import Fit
from eyechart.edits.scene import CopyPlace, EditScene
from eyechart.errors import SpecError
from eyechart.frames import EXCHANGE, LEAD, PATCHED, RGB, Draws, Span, exchanged
from eyechart.seeds import key_seed

DRAWN, OWN_WAY, BESIDE, APART, ABSENT = (
    *("lead_drawn", "exchange_own", "exchange_beside", "exchange_apart"),
    "lead_absent",
)
EVERY = "all"
"""The picture of a refusal that is about all control pictures of a photograph."""

PICTURES = ("lead_near", "lead_far", DRAWN, OWN_WAY, BESIDE, APART, ABSENT, PATCHED)
"""The control pictures that an edit makes, in the order of their columns."""

_TRIES = 12
_PLACES = 8
_WIDER = (0.9, 1.3)
"""The place beside the own way, as factors of a way's width."""

_LEAN = 0.7
"""The share of the room in its own way by which the lead may lean away from the other."""

_PATCH = 0.6
"""The second hole of a patched picture has the shape of the lead at this factor of its distance."""
_PATCH_ASIDE = 1.3
_LEAST_GROWTH, _MOST_BLUR_PX = 1.3, 1.5


@dataclass(frozen=True)
class Moves:
    """Where copies of the lead are put: the ranges near and far, in metres, and the way beside.

    ``lane_m`` is the width of a way and ``eye_m`` the height of the camera; without both nothing is
    put beside. ``seed`` draws the distances. ``shadow`` is the strip of road around the foot that
    goes along, as a share of the lead's height.
    """

    near: Span
    far: Span
    lane_m: float | None = None
    eye_m: float | None = None
    seed: int = 0
    shadow: float = 0.08
    limits: EditLimits = USUAL

    def __post_init__(self) -> None:
        for name, (least, most) in (("near", self.near), ("far", self.far)):
            if not 0 < least <= most < math.inf:
                raise SpecError(
                    f"--{name} takes two distances above 0, the lower first, as 5:9; not {least:g}:{most:g}"
                )
        if self.near[1] >= self.far[0]:
            raise SpecError(f"--near ends at {self.near[1]:g} and --far begins at {self.far[0]:g}: near must be nearer")
        for name, value in (("lane", self.lane_m), ("eye", self.eye_m)):
            if value is not None and not 0 < value < 100:
                raise SpecError(f"--{name} is in metres, above 0 and below 100; not {value:g}")
        if not 0 <= self.shadow <= 1:
            raise SpecError(f"--shadow is a share of the lead's height, from 0 to 1; not {self.shadow:g}")

    @classmethod
    def read(
        cls,
        near: str | None,
        far: str | None,
        lane: float | None,
        eye: float | None,
        seed: int = 0,
        shadow: float = 0.08,
    ) -> Self:
        """Return where copies are put, from ranges ``A:B``; raises SpecError without the two."""
        if near is None or far is None:
            raise SpecError("give --near and --far, the ranges of the lead's distances in metres, as 5:9 and 40:60")
        return cls(_span("near", near), _span("far", far), lane, eye, seed, shadow)

    @property
    def between(self) -> float:
        """Return a distance between near and far in metres, below which a lead is near."""
        return round(math.sqrt(self.near[1] * self.far[0]), 1)

    @property
    def span(self) -> Span:
        """Return the whole range, from the nearest to the farthest place."""
        return self.near[0], self.far[1]

    @property
    def apart(self) -> Span:
        """Return the range of far places of the exchange, beyond all that the exchange draws."""
        return max(self.far[0], 1.02 * exchanged(self.span)[1]), self.far[1]


def _span(name: str, text: str) -> Span:
    """Return a range of distances ``A:B``; raises SpecError."""
    first, colon, last = text.partition(":")
    try:
        return float(first), float(last if colon else first)
    except ValueError as error:
        raise SpecError(f"--{name} takes two distances in metres, as 5:9; got '{text}'") from error


@dataclass
class Edit:
    """The control pictures (h, w, 3) of a photograph, with what was moved and what was refused.

    ``distances`` has the columns of their distances, ``places`` where a picture's copies of the
    lead are, and ``refused`` the reason for a picture that was not made.
    """

    pictures: dict[str, RGB] = field(default_factory=dict)
    distances: dict[str, float] = field(default_factory=dict)
    places: dict[str, tuple[CopyPlace, ...]] = field(default_factory=dict)
    refused: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Editor:
    """Makes the pictures of one photograph, whose scene is whole, by the moves."""

    scene: EditScene
    photo: Photo
    moves: Moves
    draws: Draws
    fit: Fit | None

    def edit(self) -> Edit:
        """Return the control pictures, or none but the reason if the road does not fill the hole."""
        scene, made = self.scene, Edit()
        plate = filled(scene.picture, scene.hole, scene.lines, kept=scene.kept)
        if plate.filled < 1 - self.moves.limits.unfilled:
            why = f"{1 - plate.filled:.0%} of the hole could not be filled with the road before it"
            return Edit(refused={EVERY: why})
        for name, column, tried in (
            ("lead_near", "lead_near_m", self._within(self.moves.near, "near")),
            ("lead_far", "lead_far_m", self._within(self.moves.far, "far")),
            (DRAWN, LEAD, self.draws.lead()),
        ):
            self._move(made, plate, name, column, tried)
        self._exchange(made, plate)
        if why := checks.of_absence(scene, self.moves.limits):
            made.refused[ABSENT] = why
        else:
            made.pictures[ABSENT] = scene.composed(plate)
        self._patch(made, plate)
        return made

    def _rng(self, what: str) -> np.random.Generator:
        return np.random.default_rng(key_seed("edit", self.moves.seed, self.photo.file, what))

    def _within(self, span: Span, what: str) -> Iterator[float]:
        """Yield distances of a range, drawn by the photograph's own seed."""
        rng = self._rng(what)
        for _ in range(_TRIES):
            yield round(float(rng.uniform(*span)), 3)

    def _move(self, made: Edit, plate: Plate, name: str, column: str, tried: Iterator[float]) -> None:
        why = ""
        for distance_m in tried:
            place = CopyPlace(distance_m)
            found = checks.of_places(self.scene, [place], self.photo, self.fit, self.moves.limits)
            if not found and abs(self.scene.scale(place) - 1) < self.moves.limits.moved:
                found = f"at {distance_m:.1f} m it would stand where it is"
            if not found:
                made.pictures[name], made.distances[column] = self.scene.composed(plate, place), distance_m
                made.places[name] = (place,)
                return
            why = why or found
        made.refused[name] = why

    def _exchange(self, made: Edit, plate: Plate) -> None:
        """Make the three pictures of the exchange, of two copies of the lead, or of none."""
        names, why = (OWN_WAY, BESIDE, APART), ""
        if self.moves.lane_m is None or self.moves.eye_m is None:
            why = "the exchange needs --lane and --eye, the width of a way and the camera's height"
        elif not self.photo.beside:
            why = "no side is declared free: write left, right or both into the column beside"
        else:
            for distance_m in self.draws.exchange(made.distances.get(LEAD)):
                for shown in self._exchanges(distance_m):
                    found = _first(
                        checks.of_places(self.scene, places, self.photo, self.fit, self.moves.limits)
                        for places in shown.values()
                    )
                    if not found:
                        made.distances[EXCHANGE] = distance_m
                        for name, places in shown.items():
                            made.pictures[name] = self.scene.composed(plate, *places)
                            made.places[name] = tuple(places)
                        return
                    why = why or found
            why = why or f"no distance of the exchange differs enough from {LEAD}"
        made.refused |= dict.fromkeys(names, why)

    def _exchanges(self, own_m: float) -> Iterator[Mapping[str, Sequence[CopyPlace]]]:
        """Yield pairs of places for the three pictures, in which the near one is at ``own_m``."""
        assert self.moves.lane_m is not None
        rng, scene = self._rng(f"exchange {own_m}"), self.scene
        aside_m = scene.aside_m(scene.lead.box)
        for number in range(_PLACES):
            side = 1 if self.photo.beside[int(rng.integers(len(self.photo.beside)))] == "left" else -1
            far_m, its_far_m = (round(float(rng.uniform(*self.moves.apart)), 3) for _ in range(2))
            lean = 0.0
            if number >= _PLACES // 4:
                room = max(self.moves.lane_m - scene.width_m, 0.0) / 2
                lean = -side * float(rng.uniform(0, _LEAN)) * room - aside_m
            its_left = side * self.moves.lane_m * float(rng.uniform(*_WIDER)) - aside_m
            square = own_m**2 + (aside_m + lean) ** 2 - (aside_m + its_left) ** 2
            if square <= 0:
                continue
            own, far = CopyPlace(own_m, lean), CopyPlace(far_m, lean)
            its_far, beside = CopyPlace(its_far_m, its_left), CopyPlace(math.sqrt(square), its_left)
            yield {OWN_WAY: (own, its_far), BESIDE: (beside, far), APART: (far, its_far)}

    def _patch(self, made: Edit, plate: Plate) -> None:
        """Make the picture that is edited as much as the others, and in which nothing is moved.

        The lead is as soft as in its own largest magnification. A hole of the shape that it would
        have nearer on its way is filled too, or beside it, where that is below the picture.
        """
        scene = self.scene
        largest = max((scene.scale(place) for places in made.places.values() for place in places), default=1.0)
        sigma = min(blur_of(max(largest, _LEAST_GROWTH)), _MOST_BLUR_PX)
        second = filled(plate.picture, self._second_hole(), scene.lines, kept=scene.kept)
        made.pictures[PATCHED] = scene.softened(sigma).composed(second, CopyPlace(scene.distance_m))
        made.places[PATCHED] = (CopyPlace(scene.distance_m),)

    def _second_hole(self) -> Mask:
        scene, share = self.scene, self.scene.lead.mask.astype(np.float32)[..., None]
        nearer = CopyPlace(_PATCH * scene.distance_m)
        box, rows = scene.box_at(nearer), scene.lead.mask.shape[0]
        if box.y1 <= rows * (1 - self.moves.limits.before):
            there = scaled(share, scene.scale(nearer), scene.lines)[..., 0] > 0.5
            if not (there & scene.own).any():
                return np.asarray(there, np.bool_)
        box = scene.lead.box
        aside = _PATCH_ASIDE * (box.x1 - box.x0)
        to_right = -aside if (box.x0 + box.x1) / 2 > scene.lead.mask.shape[1] / 2 else aside
        return np.asarray(scaled(share, 1.0, scene.lines, to_right)[..., 0] > 0.5, np.bool_) & ~scene.own


def _first(found: Iterator[str]) -> str:
    return next(filter(None, found), "")
