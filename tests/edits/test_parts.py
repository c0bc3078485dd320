"""The parts of an edit: lines, fill, masks and tables."""

import sys
import types
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from eyechart.edits import BOXES, ObjectBox, read_annotations
from eyechart.edits.annotations import corners
from eyechart.edits.fill import filled, membrane
from eyechart.edits.geometry import Box, Layer, Lines, blur_of, grown, laid_over, scaled, smoothing
from eyechart.edits.horizon import fit_horizon, why_not_fixed
from eyechart.edits.masks import BOX, FILE, GRABCUT, POLYGON, from_corners, mask_of
from eyechart.errors import SourceError

LINES = Lines(60.0, 40.0)


def feet(horizon: float, slope: float, behind: float, noise: float, seed: int = 0) -> tuple[list[float], list[float]]:
    """Return feet and distances of 48 boxes, with distances that are off by a share of themselves."""
    rng = np.random.default_rng(seed)
    away = np.exp(rng.uniform(np.log(4), np.log(30), 48))
    rows = horizon + slope / (away + behind)
    return rows.tolist(), (away * np.exp(rng.normal(0, noise, 48))).tolist()


@pytest.mark.parametrize("by", [0, 1, 3, 9])
@pytest.mark.parametrize("places", [[], [(0, 0)], [(11, 19)], [(3, 4), (8, 15)]])
def test_a_mask_grows_on_all_sides_by_so_many_pixels(places: list[tuple[int, int]], by: int) -> None:
    """Into the corners, and not beyond the picture."""
    mask, every = np.zeros((12, 20), bool), np.zeros((12, 20), bool)
    for row, column in places:
        mask[row, column] = True
        every[max(row - by, 0) : row + by + 1, max(column - by, 0) : column + by + 1] = True
    assert grown(mask, by).tolist() == every.tolist()


@pytest.mark.parametrize(("noise", "within"), [(0.0, 0.01), (0.05, 1.5), (0.1, 3.0)])
def test_the_horizon_comes_out_of_boxes_and_distances(noise: float, within: float) -> None:
    """With exact and with noisy distances; a common factor of all distances does not move it."""
    for seed in range(5):
        rows, away = feet(96, 192, 0, noise, seed)
        found, longer = fit_horizon(rows, away), fit_horizon(rows, [1.2 * one for one in away])
        assert found is not None
        assert longer is not None
        assert abs(found.horizon - 96) < within
        assert longer.horizon == pytest.approx(found.horizon, abs=0.2)
        assert longer.slope == pytest.approx(1.2 * found.slope, rel=0.05)


def test_a_camera_behind_the_measured_point_is_found() -> None:
    """A metre from bumper to camera; without it the horizon would be pixels off."""
    rows, away = feet(96, 192, 1.0, 0.02)
    found = fit_horizon(rows, away)
    assert found is not None
    assert found.behind_m == pytest.approx(1.0, abs=0.3)
    assert abs(found.horizon - 96) < 1
    assert found.foot(96, 3) == pytest.approx(96 + found.slope / (3 + found.behind_m))


def test_what_does_not_fix_a_horizon_is_said() -> None:
    """Too few boxes, equal distances, a hill, and boxes that stand higher the nearer they are."""
    rows, away = feet(96, 192, 0, 0)
    assert why_not_fixed(fit_horizon(rows, away), away, 240) == ""
    assert why_not_fixed(fit_horizon(rows[:5], away[:5]), away[:5], 240).startswith("5 whole boxes with a distance")
    alike = [10 + one / 30 for one in away]
    assert "span a factor of 1.1, not 3" in why_not_fixed(fit_horizon(rows, alike), alike, 240)
    hill = [row + 5 * np.sin(one) for row, one in zip(rows, away, strict=True)]
    assert "px about their line, more than 2.4" in why_not_fixed(fit_horizon(hill, away), away, 240)
    upside = [192 - row for row in rows]
    assert why_not_fixed(fit_horizon(upside, away), away, 240) == "nearer boxes do not stand lower"
    assert fit_horizon([], []) is None


def test_a_thing_that_is_moved_keeps_its_foot_on_the_line() -> None:
    """A point at horizon + k/d is at horizon + k/d' after the scaling, to a fiftieth of a pixel."""
    picture = np.zeros((120, 160, 1), np.float32)
    picture[60:80, 70:90] = 1  # its foot is at 80: 40 px below the horizon
    for scale in (0.25, 0.5, 1.5, 1.9):
        made = scaled(picture, scale, LINES)[..., 0]
        inside = scale * 20
        rows = np.arange(120) + 0.5
        middle = float((made.sum(axis=1) * rows).sum() / made.sum())
        assert middle == pytest.approx(40 + scale * 20 + inside / 2, abs=0.15)
        assert made.sum() == pytest.approx(inside * scale * 20, rel=0.02)


def test_a_window_is_the_same_part_of_the_whole() -> None:
    """Also beside the picture's edges, with a shift and with smoothing."""
    rng = np.random.default_rng(0)
    picture = rng.random((50, 70, 2)).astype(np.float32)
    for scale, shift in ((0.4, 3.5), (1.0, -7.25), (2.3, 11.0)):
        whole = scaled(picture, scale, LINES, shift)
        part = scaled(picture, scale, LINES, shift, Box(12, 5, 66, 44))
        np.testing.assert_allclose(part, whole[5:44, 12:66], atol=1e-5)


def test_smoothing_and_blur_belong_together() -> None:
    """What is shrunk is smoothed before; what is not is not; a magnified thing is as soft as it grew."""
    assert smoothing(1.0) == smoothing(2.0) == 0
    assert smoothing(0.5) == pytest.approx(0.45 * 3**0.5)
    assert blur_of(2.0) == pytest.approx(0.45 * 3**0.5)
    assert blur_of(0.5) == 0


def test_the_nearer_layer_covers_the_farther() -> None:
    """In whatever order they are given."""
    ground = np.zeros((4, 4, 3), np.float32)
    near, far = (
        Layer(d, np.dstack([np.full((4, 4, 3), v), np.ones((4, 4))]).astype(np.float32)) for d, v in ((2, 9), (5, 7))
    )
    for layers in ((near, far), (far, near)):
        assert (laid_over(ground, layers) == 9).all()


def road() -> np.ndarray:
    """Return a picture (120, 160, 3) of a road with two lines that meet at the vanishing point."""
    rows, columns = np.mgrid[:120, :160] + 0.5
    below = np.maximum(rows - 40, 0.1)
    across = (columns - 60) / below
    grey = np.where(np.abs(np.abs(across) - 0.8) < 0.08, 220.0, 90.0)
    sky = 150 + rows
    return np.repeat(np.where(rows > 40, grey, sky)[..., None], 3, axis=2).astype(np.float32)


def test_the_road_runs_on_through_the_hole() -> None:
    """A hole over a line is filled with the line, where it would run; a fill from the rim has none."""
    picture, hole = road(), np.zeros((120, 160), np.bool_)
    hole[58:80, 70:110] = True
    made = filled(picture, hole, LINES, kept=np.zeros_like(hole))
    assert made.filled > 0.99
    error = np.abs(made.picture - picture)[hole].mean()
    plain = np.abs(membrane(picture, grown(hole, 2), ~grown(hole, 2)) - picture)[hole].mean()
    assert error < 6
    assert plain > 2 * error
    assert (made.picture[~made.hole] == picture[~made.hole]).all()


def test_other_things_are_no_source_of_the_road() -> None:
    """A red thing on the road before the hole is not repeated in it."""
    picture, hole, other = road(), np.zeros((120, 160), np.bool_), np.zeros((120, 160), np.bool_)
    hole[58:80, 40:90], other[84:104, 40:100] = True, True
    picture[other] = (255, 0, 0)
    made = filled(picture, hole, LINES, kept=other)
    inside = made.picture[hole]
    assert (np.abs(inside[:, 0] - inside[:, 1]) < 12).all()
    assert (made.picture[other & ~made.hole] == picture[other & ~made.hole]).all()


def test_a_hole_without_road_before_it_is_said_not_to_be_filled() -> None:
    """A thing that stands at the lower edge has nothing before it."""
    picture, hole = road(), np.zeros((120, 160), np.bool_)
    hole[60:120, 40:120] = True
    assert filled(picture, hole, LINES, kept=np.zeros_like(hole)).filled < 0.5


def test_a_large_hole_is_filled_as_smoothly_as_a_small_one() -> None:
    """Solved at half the size it is the same plane."""
    rows, columns = np.mgrid[:260, :260].astype(np.float32)
    plane = np.dstack([0.5 * rows + 0.25 * columns] * 3).astype(np.float32)
    hole = np.zeros((260, 260), np.bool_)
    hole[20:240, 20:240] = True
    made = membrane(np.where(hole[..., None], 0, plane).astype(np.float32), hole, ~hole)
    assert np.abs(made - plane)[hole].max() < 2
    assert (made[~hole] == plane[~hole]).all()


@pytest.mark.parametrize(
    ("boxes", "numbers"),
    [
        ("xyxy", (10, 20, 40, 60)),
        ("xywh", (10, 20, 30, 40)),
        ("cxcywh", (25, 40, 30, 40)),
        ("percent", (10, 20, 30, 40)),
    ],
)
def test_four_numbers_are_one_box_in_every_writing(boxes: str, numbers: tuple[float, ...]) -> None:
    """Each names the same corners."""
    assert boxes in BOXES
    assert corners(numbers, boxes, "row 1") == Box(10, 20, 40, 60)


def test_a_mask_is_a_file_or_corners_or_what_is_found_in_the_box(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each says where it is from; a mask of another object, or of another size, is refused."""
    pixels = np.full((40, 50, 3), 90, np.uint8)
    box, stored = Box(10, 10, 30, 30), np.zeros((40, 50), np.uint8)
    stored[10:30, 12:30] = 7
    Image.fromarray(stored).save(tmp_path / "m.png")
    Image.fromarray(stored[:30]).save(tmp_path / "low.png")
    Image.fromarray(pixels).save(tmp_path / "m.jpg")

    def found(mask: str, cut: str = BOX, box: Box = box) -> tuple[int, str]:
        made, kind = mask_of(ObjectBox("", box, 5.0, mask, where="row 3"), pixels, [tmp_path], cut)
        return int(made.sum()), kind

    assert found("m.png") == (360, FILE)
    assert found("10,10 30,10 30,30 10,30")[1] == POLYGON
    assert abs(found("10,10 30,10 30,30 10,30")[0] - 400) <= 41
    assert found("") == (400, BOX)
    assert from_corners("0,0 9,0 9,9; 20,20 29,20 29,29", 50, 40)[25, 27]
    for mask, words in (
        ("no.png", "row 3: the mask: there is no file 'no.png'"),
        ("low.png", "row 3: the mask: it has 50×30 pixels, and its picture 50×40"),
        ("1,2 3", "is neither a .png file nor corners"),
        ("1,2 3,x 4,5", "'x' is no coordinate"),
        ("../m.png", "leads outside"),
        ("0,0 4,0 4,4", "are not of one object"),
        ("10,10 30,30 30,29", "it is less than 10% of its box"),
    ):
        with pytest.raises(SourceError, match=words.replace("(", r"\(")):
            found(mask)
    (tmp_path / "p.png").write_bytes((tmp_path / "m.jpg").read_bytes())
    with pytest.raises(SourceError, match=r"'p\.png' is no PNG"):
        found("p.png")
    monkeypatch.setitem(sys.modules, "cv2", fake_cv2())
    assert found("", GRABCUT) == (225, GRABCUT)
    assert found("", GRABCUT, Box(10, 10, 15, 15)) == (25, BOX)


def fake_cv2() -> types.ModuleType:
    """Return a stand-in for OpenCV whose GrabCut takes all but the box's upper and left quarter."""
    made = types.ModuleType("cv2")
    made.GC_BGD, made.GC_FGD, made.GC_PR_FGD, made.GC_INIT_WITH_MASK = 0, 1, 3, 1  # type: ignore[attr-defined]
    made.error = RuntimeError  # type: ignore[attr-defined]
    made.setRNGSeed = lambda _: None  # type: ignore[attr-defined]

    def grabcut(part: np.ndarray, guess: np.ndarray, *_: object) -> None:
        assert part.shape[:2] == guess.shape
        rows, columns = np.nonzero(guess == 3)
        guess[: rows.min() + 5] = 0
        guess[:, : columns.min() + 5] = 0

    made.grabCut = grabcut  # type: ignore[attr-defined]
    return made


TABLE = "file,episode,step,scenario,horizon,beside,clear_to_m,light\na.png,e,0,s,16,left,30,dim\n"
OBJECTS = "file,role,x0,y0,x1,y1,distance_m,mask,truncated,occluded\na.png,lead,5,5,20,20,9,,,\n"


def read(folder: Path, table: str = TABLE, objects: str = OBJECTS, boxes: str = "xyxy") -> object:
    """Return the annotations of two texts."""
    Image.fromarray(np.zeros((40, 50, 3), np.uint8)).save(folder / "a.png")
    (folder / "photos.csv").write_text(table)
    (folder / "objects.csv").write_text(objects)
    return read_annotations(folder, folder / "photos.csv", folder / "objects.csv", boxes)


def test_two_tables_are_photographs_with_things(tmp_path: Path) -> None:
    """What only an edit reads is apart; all other columns are kept for the bank."""
    found = read(tmp_path)
    (photo,) = found.photos  # type: ignore[attr-defined]
    assert found.columns == ("episode", "step", "scenario", "light")  # type: ignore[attr-defined]
    assert (photo.horizon, photo.beside, photo.clear_to_m, photo.cells["light"]) == (16, ("left",), 30, "dim")
    assert (photo.lead.box, photo.lead.distance_m, photo.lead.where) == (Box(5, 5, 20, 20), 9, "objects.csv, row 1")


@pytest.mark.parametrize(
    ("table", "objects", "words"),
    [
        (TABLE.replace("file", "fil"), OBJECTS, "photos.csv has no column 'file'; did you mean 'fil'"),
        (TABLE.replace("light", "gap"), OBJECTS, "has the column 'gap', which an edit makes"),
        (TABLE.replace("light", "lead_near"), OBJECTS, "has the column 'lead_near', which an edit makes"),
        (TABLE.replace("a.png", "b.png"), OBJECTS, "photos.csv, row 1: there is no picture 'b.png'"),
        (TABLE + "a.png,e,1,s,,,,\n", OBJECTS, "row 2: 'a.png' is already in row 1"),
        (TABLE.replace("left", "up"), OBJECTS, "beside is 'up', not left, right, both or empty"),
        (TABLE.replace(",30,", ",0,"), OBJECTS, "clear_to_m is 0; a distance is more than 0"),
        (TABLE.replace("16", "low"), OBJECTS, "horizon is 'low', not a number"),
        (TABLE, OBJECTS.replace("x0", "left"), "objects.csv has no column 'x0'"),
        (TABLE, OBJECTS.replace("occluded", "hidden"), "objects.csv has a column 'hidden'"),
        (TABLE, OBJECTS.replace("lead", "leed"), "role is 'leed', not lead, own, ignored, or empty"),
        (TABLE, OBJECTS.replace(",20,20,", ",20,,"), "a box needs its four numbers"),
        (TABLE, OBJECTS.replace(",20,20,", ",4,20,"), "the box 5, 5 to 4, 20 is empty; --boxes xyxy or xywh"),
        (TABLE, OBJECTS + "a.png,lead,1,1,9,9,4,,,\n", "row 2: 'a.png' has its lead in objects.csv, row 1 already"),
        (TABLE, OBJECTS + "c.png,,1,1,9,9,4,,,\n", "objects.csv, row 2: 'c.png' is no row of the photographs' table"),
        (TABLE, OBJECTS.replace(",9,,,", ",-9,,,"), "distance_m is -9; a distance is more than 0"),
        (TABLE.partition("\n")[0] + "\n", OBJECTS, "photos.csv has no rows"),
    ],
)
def test_a_fault_of_a_table_is_said_with_its_row(tmp_path: Path, table: str, objects: str, words: str) -> None:
    """What, which, and what to do."""
    with pytest.raises(SourceError) as caught:
        read(tmp_path, table, objects)
    assert words in str(caught.value)


def test_all_faults_are_said_at_once(tmp_path: Path) -> None:
    """A line each."""
    objects = OBJECTS + "a.png,x,1,1,9,9,4,,,\na.png,,1,1,0,9,4,,,\n"
    with pytest.raises(SourceError) as caught:
        read(tmp_path, TABLE, objects)
    assert str(caught.value).startswith("photos.csv with objects.csv has 2 faults, and nothing was written:\n")
