"""Faults of annotation: refused, or the order of distances is kept and the metres are those annotated."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import edited_worlds
from edited_worlds import Moment
from eyechart.edits import Annotations, EditLimits, EditResult, EditSource, Moves, ObjectBox, Photo
from eyechart.edits.geometry import Box
from eyechart.errors import SourceError

NAMES = ("lead_near", "lead_drawn", "lead_far")
Change = Callable[[Photo], Photo]


@pytest.fixture(scope="module")
def moments(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, tuple[Moment, ...]]:
    """Return a folder with the pictures of moments, and these."""
    folder = tmp_path_factory.mktemp("faults")
    found = edited_worlds.moments("rover", 20)
    edited_worlds.write(folder, found)
    return folder, found


def photo_of(moment: Moment) -> Photo:
    """Return a moment as it is annotated without a fault."""
    assert moment.lead is not None
    things = [
        ObjectBox("lead", Box(*edited_worlds.box_of(moment.lead.mask)), moment.lead.gap_m, cut_out=moment.lead.mask)
    ]
    things.append(ObjectBox("own", Box(*edited_worlds.box_of(moment.hood)), None, cut_out=moment.hood))
    things += [
        ObjectBox("", Box(*edited_worlds.box_of(one.mask)), one.gap_m, cut_out=one.mask) for one in moment.others
    ]
    return Photo(moment.file, {}, float(moment.world.view.horizon), moment.column, things=tuple(things))


@dataclass(frozen=True)
class Read:
    """What a reader finds in edited pictures: (annotated, read) metres by photograph and picture."""

    record: EditResult
    gaps: dict[str, dict[str, tuple[float, float | None]]]

    def ratios(self) -> np.ndarray:
        """Return read over annotated distances, and 9 for what is not read."""
        return np.array(
            [9.0 if got is None else got / said for one in self.gaps.values() for said, got in one.values()]
        )

    def wrong_orders(self) -> list[str]:
        """Return the photographs with two pictures, a factor of 1.5 apart, the wrong way round."""
        return [
            file
            for file, one in self.gaps.items()
            for (a, read_a), (b, read_b) in combinations(sorted(one.values()), 2)
            if b >= 1.5 * a and not (read_a or 99) < (read_b or 99)
        ]


def edited(folder: Path, moments: tuple[Moment, ...], out: Path, change: Change) -> Read:
    """Return what is read in the pictures that an edit makes of moments with a fault."""
    source = EditSource(
        folder / "photos", Annotations(tuple(change(photo_of(one)) for one in moments), ()), folder, cut="box"
    )
    moves = Moves((2.6, 4.4), (18, 27), 2.0, 1.2, limits=EditLimits(least_px=5))
    record = edited_worlds.edit(source, moves, out, of_lead=True)
    by_file = {one.file: one for one in moments}
    gaps = {
        file: {
            name: (
                pictures[name][0]["distance_m"],
                edited_worlds.gap_in(np.asarray(Image.open(out / name / file)), by_file[file]),
            )
            for name in NAMES
            if name in pictures
        }
        for file, pictures in record.copies.items()
    }
    return Read(record, gaps)


def of_lead(change: Callable[[ObjectBox], ObjectBox]) -> Change:
    """Return the change of a photograph's lead."""
    return lambda photo: replace(
        photo, things=tuple(change(one) if one.role == "lead" else one for one in photo.things)
    )


def grown_box(thing: ObjectBox) -> ObjectBox:
    """Return a thing with a box a tenth too wide on each side, and no mask."""
    by = max(1.0, 0.1 * (thing.box.x1 - thing.box.x0))
    x0, y0, x1, y1 = thing.box
    return replace(thing, box=Box(x0 - by, y0 - by, x1 + by, y1 + by), cut_out=None)


@pytest.mark.parametrize(
    "change",
    [
        of_lead(lambda one: replace(one, cut_out=None)),
        of_lead(grown_box),
        lambda photo: replace(photo, things=tuple(one for one in photo.things if one.role)),
    ],
    ids=["box for mask", "box too large", "others missing"],
)
def test_a_bad_box_or_a_missing_thing_moves_no_lead(
    moments: tuple[Path, tuple[Moment, ...]], tmp_path: Path, change: Change
) -> None:
    """The rectangle goes along, and the foot stays where it is."""
    read = edited(*moments, tmp_path / "out", change)
    assert sum(map(len, read.gaps.values())) > 45
    assert read.wrong_orders() == []
    assert np.median(np.abs(read.ratios() - 1)) < 0.02


@pytest.mark.parametrize("off", [-10, -5, -2, 2, 5, 10])
def test_a_horizon_that_the_boxes_deny_is_refused(
    moments: tuple[Path, tuple[Moment, ...]], tmp_path: Path, off: int
) -> None:
    """Two pixels of 240 rows would cost a seventh of a far distance; the reason says how many they are."""
    side = "above" if off > 0 else "below"
    with pytest.raises(SourceError, match=rf"put the horizon \d+\.\d px {side} the given one") as caught:
        edited(*moments, tmp_path / "out", lambda one: replace(one, horizon=(one.horizon or 0) + off))
    assert "leave the column horizon empty" in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_without_a_horizon_the_boxes_give_it(moments: tuple[Path, tuple[Moment, ...]], tmp_path: Path) -> None:
    """As well as a given one."""
    read = edited(*moments, tmp_path / "out", lambda one: replace(one, horizon=None))
    (ground,) = read.record.grounds
    assert ground.fit is not None
    assert abs(ground.fit.horizon - 96) < 1
    assert read.wrong_orders() == []
    assert np.median(np.abs(read.ratios() - 1)) < 0.02


def test_few_boxes_check_no_horizon_and_it_is_said(moments: tuple[Path, tuple[Moment, ...]], tmp_path: Path) -> None:
    """Five pixels off, the order is kept; that the metres may be off is a note of the record."""
    folder, found = moments
    alone = [replace(one, others=()) for one in found[:12]]
    read = edited(folder, tuple(alone), tmp_path / "out", lambda one: replace(one, horizon=(one.horizon or 0) + 2))
    assert read.wrong_orders() == []
    assert "horizons were not checked" in read.record.notes[-1]
    assert "12 whole boxes with a distance, and 24 are needed" in read.record.notes[-1]


@pytest.mark.parametrize("factor", [0.8, 0.9, 1.1, 1.2])
def test_a_wrong_scale_of_distances_is_passed_on_as_it_is(
    moments: tuple[Path, tuple[Moment, ...]], tmp_path: Path, factor: float
) -> None:
    """Every picture is off by the factor of its table, so the table's metres stay those of the scope."""
    change = lambda photo: replace(  # noqa: E731 - one of the parameters' kind
        photo,
        things=tuple(
            replace(one, distance_m=None if one.distance_m is None else factor * one.distance_m) for one in photo.things
        ),
    )
    read = edited(*moments, tmp_path / "out", change)
    assert read.wrong_orders() == []
    seen = read.ratios()[read.ratios() < 9]
    assert np.median(np.abs(seen * factor - 1)) < 0.02
    assert np.percentile(np.abs(seen * factor - 1), 90) < 0.06


def test_a_foot_that_its_distance_denies_is_refused_alone(
    moments: tuple[Path, tuple[Moment, ...]], tmp_path: Path
) -> None:
    """One distance of 20 is half as long again: that photograph is refused, and no other for it."""
    wrong = moments[1][3].file

    def change(photo: Photo) -> Photo:
        longer = of_lead(lambda one: replace(one, distance_m=1.5 * (one.distance_m or 0)))
        return longer(photo) if photo.file == wrong else photo

    read = edited(*moments, tmp_path / "out", change)
    whole = [one for one in read.record.refused if "its foot is at" in one.reason]
    assert [(one.file, one.picture) for one in whole] == [(wrong, "all")]
    assert whole[0].reason.startswith("its foot is at 1.")
    assert wrong not in read.gaps


def test_horizons_that_jump_are_refused_where_they_matter(
    moments: tuple[Path, tuple[Moment, ...]], tmp_path: Path
) -> None:
    """Each horizon is up to 6 px off by chance: what is still made keeps its order and errs by less than half."""
    rng = np.random.default_rng(3)
    off = {one.file: float(rng.uniform(-6, 6)) for one in moments[1]}
    read = edited(*moments, tmp_path / "out", lambda one: replace(one, horizon=(one.horizon or 0) + off[one.file]))
    made = sum(map(len, read.gaps.values()))
    assert 10 < made < 55
    assert read.wrong_orders() == []
    assert np.percentile(np.abs(read.ratios() - 1), 90) < 0.5
