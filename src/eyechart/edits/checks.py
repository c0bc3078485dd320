"""What is not edited, and why: a picture that is refused costs scope, and never a label in silence."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from eyechart.edits.annotations import Photo
from eyechart.edits.geometry import Box, Mask, grown
from eyechart.edits.horizon import Fit
from eyechart.edits.scene import CopyPlace, Cutout, EditScene


@dataclass(frozen=True, slots=True)
class EditLimits:
    """The limits of an edit, as shares where no unit is named.

    A copy's scale is from ``smallest`` to ``largest``. A lead has ``least_px`` rows, is
    ``edge_px`` away from the edges, and has a share of ``before`` of the picture's rows below it.
    At most ``above`` of it is above the horizon. Something nearer covers at most ``covered`` of its
    rim, and ``unfilled`` of the hole may be without road. Its foot may be ``foot_off`` off its
    bank's line, and that of a copy ``place_off``. A copy has ``least_pasted_px`` rows and another
    scale than the lead by ``moved``. At most ``hidden`` of it is covered and ``out_of_picture``
    outside.

    Those of scale, hole and foot were measured on rendered pictures, where the truth is known;
    ``above`` and ``foot_off`` were set by eye on photographs.
    """

    largest: float = 4.0
    smallest: float = 1 / 9
    least_px: float = 24
    least_pasted_px: float = 5
    edge_px: float = 1
    above: float = 0.25
    before: float = 0.03
    covered: float = 0.10
    unfilled: float = 0.02
    foot_off: float = 0.20
    place_off: float = 0.35
    hidden: float = 0.5
    out_of_picture: float = 0.5
    moved: float = 0.1


USUAL = EditLimits()
_BESIDE_M, _BESIDE = 1.0, 1.1
"""Two things whose distances differ less, in metres or as a factor, stand in one place."""


def of_annotation(photo: Photo, lead: Cutout, rows: int, columns: int, limits: EditLimits) -> Iterator[str]:
    """Yield why a lead cannot be cut out whole, from what was annotated."""
    thing, box = photo.lead, lead.box
    assert thing is not None
    left, right = min(box.x0, thing.box.x0), max(box.x1, thing.box.x1)
    if left <= limits.edge_px or right >= columns - limits.edge_px or box.y1 >= rows - limits.edge_px:
        yield "it touches the edge of the picture, so that it is not seen whole"
    elif box.y1 >= rows * (1 - limits.before):
        yield "no road is seen before it"
    if thing.truncated > 0:
        yield f"it is annotated as truncated ({thing.truncated:g})"
    if thing.occluded >= 2:
        yield f"it is annotated as occluded ({thing.occluded:g})"
    if box.y1 - box.y0 < limits.least_px:
        yield f"it is {box.y1 - box.y0:.0f} px high, less than {limits.least_px:g}"
    if thing.distance_m is None:
        yield "its distance is not known: give distance_m, or --from-foot K with a horizon"


def of_scene(scene: EditScene, ignored: Sequence[Box], fit: Fit | None, limits: EditLimits) -> Iterator[str]:
    """Yield why a lead cannot be moved in its scene."""
    lead, horizon = scene.lead, scene.lines.horizon
    if lead.foot <= horizon + 2:
        yield f"its foot is at row {lead.foot:.0f}, and the horizon at {horizon:.0f}"
        return
    above = float(lead.mask[: max(int(horizon), 0)].sum() / lead.mask.sum())
    if above > limits.above:
        yield f"{above:.0%} of it is above the horizon, where nothing says what is behind it"
    rim = grown(lead.mask, 2) & ~lead.mask
    over = _sum_of(one.mask for one in scene.others if one.distance_m is not None and one.distance_m < scene.distance_m)
    if over is not None and (share := float((rim & over).sum() / rim.sum())) > limits.covered:
        yield f"something nearer covers {share:.0%} of its rim"
    hole = grown(scene.hole, 2)
    if any(one.distance_m is None and (hole & one.mask).any() for one in scene.others):
        yield "it touches something whose distance is not known, so that which covers the other is not known"
    if any(_touches(hole, box) for box in ignored):
        yield "it touches a region in which things were not annotated"
    if fit is not None and (off := foot_off(scene, fit)) and not abs(off - 1) <= limits.foot_off:
        yield (
            f"its foot is at {off:.2f} of the depth below the horizon that its distance asks for: a slope, or a wrong "
            "distance, box or horizon"
        )


def foot_off(scene: EditScene, fit: Fit) -> float:
    """Return the depth of the lead's foot below the horizon over the one of the bank's line."""
    depth = fit.foot(scene.lines.horizon, scene.distance_m) - scene.lines.horizon
    return (scene.lead.foot - scene.lines.horizon) / depth if depth > 0 else 0.0


def _sum_of(masks: Iterable[Mask]) -> Mask | None:
    made: Mask | None = None
    for one in masks:
        made = one if made is None else made | one
    return made


def _touches(mask: Mask, box: Box) -> bool:
    x0, y0, x1, y1 = (max(round(one), 0) for one in box)
    return bool(mask[y0:y1, x0:x1].any())


def of_places(scene: EditScene, places: Sequence[CopyPlace], photo: Photo, fit: Fit | None, limits: EditLimits) -> str:
    """Return why copies of the lead cannot stand in these places, empty if they can."""
    boxes = [scene.box_at(place) for place in places]
    for place, box in zip(places, boxes, strict=True):
        if why := _of_copy(scene, place, box, photo, fit, limits):
            return why
    for place, box in zip(places, boxes, strict=True):
        nearer = [there for other, there in zip(places, boxes, strict=True) if other.distance_m < place.distance_m]
        nearer += [one.box for one in scene.others if one.distance_m is not None and one.distance_m < place.distance_m]
        if _hidden(box, nearer) > limits.hidden:
            return f"at {place.distance_m:.1f} m more than half of it is hidden by something nearer"
    return ""


def _of_copy(scene: EditScene, place: CopyPlace, box: Box, photo: Photo, fit: Fit | None, limits: EditLimits) -> str:
    columns = scene.lead.mask.shape[1]
    scale, metres = scene.scale(place), f"at {place.distance_m:.1f} m"
    if not limits.smallest <= scale <= limits.largest:
        return f"{metres} it is scaled by {scale:.2f}, which is not from {limits.smallest:.2f} to {limits.largest:g}"
    if box.y1 - box.y0 < limits.least_pasted_px:
        return f"{metres} it is {box.y1 - box.y0:.1f} px high"
    if photo.clear_to_m is not None and place.distance_m > photo.clear_to_m:
        return f"{metres} it is beyond clear_to_m, {photo.clear_to_m:g}"
    inside = max(min(box.x1, columns) - max(box.x0, 0.0), 0.0)
    if inside < (1 - limits.out_of_picture) * (box.x1 - box.x0) or not _shows_foot(scene, box, limits):
        return f"{metres} it leaves the picture, or the own vehicle hides its foot"
    if fit is not None and (wrong := _place_off(scene, scale, fit)) > limits.place_off:
        return f"{metres} its foot may be {wrong:.0%} off, as its foot in the photograph is off the bank's line"
    return _in_the_way(scene, place, box, limits)


def _shows_foot(scene: EditScene, box: Box, limits: EditLimits) -> bool:
    """Return whether the row on which a copy stands is in the picture, above the own vehicle."""
    rows, columns = scene.lead.mask.shape
    if box.y1 > rows:
        return False
    left, right = max(round(box.x0), 0), min(round(box.x1), columns)
    own = scene.own[min(max(round(box.y1) - 1, 0), rows - 1), left:right]
    return bool(own.size) and float(own.mean()) <= limits.covered


def _place_off(scene: EditScene, scale: float, fit: Fit) -> float:
    """Return how far off a copy's foot is if the horizon is what is wrong with the lead's foot."""
    depth = fit.foot(scene.lines.horizon, scene.distance_m) - scene.lines.horizon
    wrong_px = abs(scene.lead.foot - scene.lines.horizon - depth)
    return max(wrong_px - 1.0, 0.0) * abs(1 - scale) / (scale * depth) if depth > 0 else 0.0


def _in_the_way(scene: EditScene, place: CopyPlace, box: Box, limits: EditLimits) -> str:
    """Return what stands where a copy is to stand, or before it on its way."""
    for one in scene.others:
        if one.distance_m is None:
            if _overlap(box.x0, box.x1, one.box) > 0 and box.y1 > one.box.y0 and box.y0 < one.box.y1:
                return f"at {place.distance_m:.1f} m it meets something whose distance is not known ({one.where})"
            continue
        if one.distance_m > max(_BESIDE * place.distance_m, place.distance_m + _BESIDE_M):
            continue
        there = scene.box_at(CopyPlace(one.distance_m, place.left_m))
        if _overlap(there.x0, there.x1, one.box) > limits.covered:
            return f"at {place.distance_m:.1f} m something stands in its place or before it ({one.where})"
    return ""


def of_absence(scene: EditScene, limits: EditLimits) -> str:
    """Return why a picture without the lead has another lead, empty if it has none."""
    for one in scene.others:
        if one.distance_m is None:
            continue
        there = scene.box_at(CopyPlace(one.distance_m))
        if _overlap(there.x0, there.x1, one.box) > limits.covered:
            return f"something else stands on its way ({one.where})"
    return ""


def _overlap(left: float, right: float, box: Box) -> float:
    """Return the share of a box, or of these columns if they are narrower, that both cover."""
    return max(min(right, box.x1) - max(left, box.x0), 0.0) / max(min(right - left, box.x1 - box.x0), 1e-6)


def _hidden(box: Box, nearer: Sequence[Box]) -> float:
    """Return the share of a box's columns that nearer ones hide, where they reach as high."""
    hides = [max(min(box.x1, one.x1) - max(box.x0, one.x0), 0.0) for one in nearer if one.y0 <= (box.y0 + box.y1) / 2]
    return sum(hides) / (box.x1 - box.x0)
