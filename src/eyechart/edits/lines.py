"""The vanishing lines of every photograph: as given, or by the horizon of the bank's own boxes."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from eyechart.edits.annotations import IGNORED, OWN, Photo
from eyechart.edits.geometry import Lines
from eyechart.edits.horizon import Fit, fit_horizon, why_not_fixed

Size = tuple[int, int]
"""Width and height of a picture."""

FEWEST = 4
"""Fewer boxes below given horizons tell nothing of the feet."""

_OFF = 0.005
"""Given horizons may be off the boxes' line by this share of the rows, and three standard errors."""


@dataclass(frozen=True)
class Sight:
    """The vanishing lines of a photograph and the line of its bank's feet.

    Without ``lines`` it cannot be edited, and ``why`` says why. ``fit`` is None where too few boxes
    tell where feet stand.
    """

    lines: Lines | None
    fit: Fit | None = None
    why: str = ""


@dataclass(frozen=True)
class Ground:
    """What the boxes of equal pictures say: the line of their feet, or why there is none.

    ``given`` are photographs with a horizon of their own; theirs is then how far the line is from
    it. ``unchecked`` says why given horizons could not be checked.
    """

    size: Size
    given: bool
    fit: Fit | None
    why: str = ""
    unchecked: str = ""

    def as_dict(self) -> dict[str, object]:
        """Return the plain values that an edit's record keeps."""
        fit = self.fit
        said = (
            {}
            if fit is None
            else {
                "horizon": None if self.given else round(fit.horizon, 3),
                "focal_times_eye_px_m": round(fit.slope, 3),
                "behind_m": round(fit.behind_m, 2),
                "spread_px": round(fit.spread, 3),
                "boxes": fit.boxes,
            }
        )
        return {"size": list(self.size), "given": self.given, **said, "why": self.why, "unchecked": self.unchecked}


def sights_of(photos: Sequence[Photo], sizes: Mapping[str, Size]) -> tuple[dict[str, Sight], list[Ground]]:
    """Return the sight of each photograph by its file, and what the boxes of each size say."""
    groups: dict[tuple[Size, bool], list[Photo]] = defaultdict(list)
    for one in photos:
        groups[sizes[one.file], one.horizon is not None].append(one)
    grounds = {key: _ground(many, *key) for key, many in groups.items()}
    return {
        one.file: _sight(one, sizes[one.file], grounds[sizes[one.file], one.horizon is not None]) for one in photos
    }, [*grounds.values()]


def feet_of(photo: Photo, size: Size) -> Iterator[tuple[float, float]]:
    """Yield foot row (below a given horizon) and distance of the whole things of a photograph."""
    for one in photo.things:
        whole = one.box.x0 > 1 and one.box.x1 < size[0] - 1 and one.box.y1 < size[1] - 1
        clear = one.role not in {OWN, IGNORED} and one.truncated <= 0 and one.occluded < 2
        if whole and clear and one.distance_m is not None:
            yield one.box.y1 - (photo.horizon or 0.0), one.distance_m


def _ground(photos: Sequence[Photo], size: Size, given: bool) -> Ground:  # noqa: FBT001 - a key of the groups
    pairs = [pair for one in photos for pair in feet_of(one, size)]
    feet, away = [foot for foot, _ in pairs], [distance for _, distance in pairs]
    free = fit_horizon(feet, away)
    loose = why_not_fixed(free, away, size[1])
    if not given:
        return Ground(size, given, None if loose else free, _advice(loose))
    if not loose and free is not None:
        off = free.horizon
        if abs(off) > _OFF * size[1] + 3 * free.error:
            side = "below" if off > 0 else "above"
            words = f"boxes and distances put the horizon {abs(off):.1f} px {side} the given one"
            return Ground(size, given, free, f"{words}: leave the column horizon empty, or correct it")
        below = fit_horizon(feet, [one + free.behind_m for one in away], free=False)
        return Ground(size, given, None if below is None else replace(below, behind_m=free.behind_m))
    fit = fit_horizon(feet, away, free=False) if len(pairs) >= FEWEST else None
    return Ground(size, given, fit, unchecked=loose)


def _advice(loose: str) -> str:
    if not loose:
        return ""
    return f"its horizon is not known ({loose}): give the column horizon, or more boxes with distance_m"


def _sight(photo: Photo, size: Size, ground: Ground) -> Sight:
    if ground.why:
        return Sight(None, None, ground.why)
    fit = ground.fit
    horizon = photo.horizon if photo.horizon is not None else fit.horizon if fit is not None else None
    assert horizon is not None
    column = size[0] / 2 if photo.vanishing is None else photo.vanishing
    return Sight(Lines(column, horizon, 0.0 if fit is None else fit.behind_m), fit)


def with_distances(photos: Sequence[Photo], from_foot: float) -> list[Photo]:
    """Return photographs whose unknown distances are ``from_foot`` / (foot - horizon).

    ``from_foot`` is focal length times camera height, in px·m. A photograph without a given
    horizon stays as it is.
    """

    def known(photo: Photo) -> Photo:
        if photo.horizon is None:
            return photo
        horizon = photo.horizon
        things = (
            replace(one, distance_m=from_foot / (one.box.y1 - horizon))
            if one.distance_m is None and one.box.y1 > horizon + 1
            else one
            for one in photo.things
        )
        return replace(photo, things=tuple(things))

    return [known(one) for one in photos]
