"""Each form of annotations becomes the one table: read from a small file of its own shape."""

import csv
import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner, Result

import drawn_roads
from annotation_forms import WRITERS, coco, kitti, nuscenes
from drawn_roads import EYE_M, HORIZON, LANE_M, SLOPE
from eyechart.cli.app import app
from eyechart.edits import ANNOTATION_FORMATS, Photo, read_format
from eyechart.edits.annotations import IGNORED, OTHER
from eyechart.edits.coco import mask_of_runs
from eyechart.edits.geometry import Box
from eyechart.edits.nuscenes import turned
from eyechart.errors import SourceError

DRAWN = drawn_roads.some(4)


def by_file(photos: Sequence[Photo]) -> dict[str, Photo]:
    """Return photographs by the last part of their file."""
    return {one.file.rpartition("/")[2]: one for one in photos}


def test_each_form_has_a_test() -> None:
    """A new one is written here too."""
    assert WRITERS.keys() == ANNOTATION_FORMATS.keys()


@pytest.mark.parametrize("name", WRITERS)
def test_a_form_says_what_it_holds(name: str, tmp_path: Path) -> None:
    """Boxes to a pixel, distances to their near face, the horizon where there is a calibration."""
    found = by_file(read_format(name, *WRITERS[name](tmp_path, DRAWN), None).photos)
    assert sorted(found) == [one.file for one in DRAWN]
    for photo in DRAWN:
        things = [one for one in found[photo.file].things if one.role == ""]
        assert len(things) == 2
        for n, thing in enumerate(things):
            assert np.abs(np.subtract(thing.box, photo.corners(n))).max() <= 1.0
            wanted = None if name == "mot" else photo.boxes[n][0]
            assert thing.distance_m == (None if wanted is None else pytest.approx(wanted, abs=0.02))
            assert thing.truncated == 0
        assert found[photo.file].horizon == (pytest.approx(HORIZON) if name in {"kitti", "nuscenes"} else None)


def test_what_forms_say_besides(tmp_path: Path) -> None:
    """Regions that were not annotated, masks, drives, places, and how much is hidden."""
    made = {}
    for name, write in WRITERS.items():
        (tmp_path / name).mkdir()
        made[name] = read_format(name, *write(tmp_path / name, DRAWN), None)
    first = {name: by_file(one.photos)[DRAWN[0].file] for name, one in made.items()}
    assert [one.role for one in first["kitti"].things] == ["", "", "ignored"]
    assert first["yolo"].things[0].mask == ""
    assert len(first["yolo"].things[1].mask.split()) == 4
    assert len(first["coco"].things[0].mask.split()) == 4
    cut_out = first["coco"].things[1].cut_out
    assert cut_out is not None
    assert np.array_equal(np.argwhere(cut_out)[0], DRAWN[0].corners(1)[1::-1])
    assert [one.occluded for one in first["mot"].things] == [0, 1]
    assert dict(first["mot"].cells) == {"episode": "drive-7", "step": 0}
    assert dict(first["nuscenes"].cells) == {"episode": "scene-0061", "step": 3, "scenario": "harbour"}
    assert made["nuscenes"].columns == ("episode", "step", "scenario")


def test_a_packed_mask_is_the_plain_one() -> None:
    """The text is that of pycocotools for a square of 3 by 3 in 6 by 5."""
    plain = mask_of_runs((6, 5), [7, 3, 3, 3, 3, 3, 8], "here")
    assert np.array_equal(np.argwhere(plain), [[y, x] for y in (1, 2, 3) for x in (1, 2, 3)])
    assert np.array_equal(mask_of_runs((6, 5), "7330005", "here"), plain)
    for counts, words in (
        ("7330", "are not the 30 pixels"),
        ("7~", "not packed as COCO packs"),
        ([-1, 31], "30 pixels"),
    ):
        with pytest.raises(SourceError, match=words):
            mask_of_runs((6, 5), counts, "here")
    with pytest.raises(SourceError, match="its mask has"):
        mask_of_runs((10**6, 10**6), [1], "here")


def test_a_quaternion_turns_as_it_says() -> None:
    """A quarter turn about z takes ahead to the left; four zeros are none."""
    half = math.sqrt(0.5)
    assert turned((half, 0, 0, half)) @ [1, 0, 0] == pytest.approx([0, 1, 0])
    with pytest.raises(SourceError, match="no quaternion of length 1"):
        turned((0, 0, 0, 0))


def edit(form: str, photos: Path, objects: Path, out: Path, *words: str) -> Result:
    """Run the command on annotations in a form."""
    given = ["frames", "edit", str(photos), "--objects", str(objects), "--out", str(out), "--cut", "box"]
    return CliRunner().invoke(
        app, [*given, *(("--format", form) if form else ()), "--near", "4:6", "--far", "20:25", *words]
    )


def rows_of(path: Path) -> list[dict[str, str]]:
    """Return a table's rows."""
    with path.open() as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize("name", ["kitti", "nuscenes"])
def test_a_form_with_everything_is_edited_at_once(name: str, tmp_path: Path) -> None:
    """What is nearest on the own way leads; the tables that were found are there to be corrected."""
    photos, objects = WRITERS[name](tmp_path, DRAWN)
    result = edit(name, photos, objects, tmp_path / "out", "--lane", str(LANE_M), "--eye", str(EYE_M))
    assert result.exit_code == 0, result.exception
    gaps = {row["file"].rpartition("/")[2]: float(row["gap"]) for row in rows_of(tmp_path / "out" / "table.csv")}
    assert gaps == {one.file: pytest.approx(one.boxes[0][0], abs=0.02) for one in DRAWN}
    assert all(row["lead_far"] for row in rows_of(tmp_path / "out" / "table.csv"))
    found = tmp_path / "out" / "photos.csv"
    table = [{**row, "beside": "right"} for row in rows_of(found)]
    with (tmp_path / "mine.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, list(table[0]))
        writer.writeheader()
        writer.writerows(table)
    words = ("--table", str(tmp_path / "mine.csv"), "--lane", str(LANE_M), "--eye", str(EYE_M))
    assert edit("", photos, tmp_path / "out" / "objects.csv", tmp_path / "again", *words).exit_code == 0
    again = rows_of(tmp_path / "again" / "table.csv")
    assert any(row["exchange_own"] for row in again)
    for row, before in zip(again, rows_of(tmp_path / "out" / "table.csv"), strict=True):
        assert row["lead_far_m"] == before["lead_far_m"]


@pytest.mark.parametrize("name", ["coco", "yolo", "mot"])
def test_a_form_that_lacks_something_says_what_would_do(name: str, tmp_path: Path) -> None:
    """Eight boxes fix no horizon; a table with one does, and MOT needs --from-foot too."""
    photos, objects = WRITERS[name](tmp_path, DRAWN)
    ways = ("--lane", str(LANE_M), "--eye", str(EYE_M))
    said = str(edit(name, photos, objects, tmp_path / "none", *ways).exception)
    assert "its horizon is not known" in said
    assert "give the column horizon, or more boxes with distance_m" in said
    text = "".join(f"{one.file},{HORIZON},right\n" for one in DRAWN)
    (tmp_path / "photos.csv").write_text(f"file,horizon,beside\n{text}")
    table = ("--table", str(tmp_path / "photos.csv"))
    if name == "mot":
        lacking = edit(name, photos, objects, tmp_path / "lacks", *ways, *table)
        assert "the distance of its lead is not known: give distance_m, or --from-foot K" in str(lacking.exception)
        table = (*table, "--from-foot", str(SLOPE))
    result = edit(name, photos, objects, tmp_path / "out", *ways, *table)
    assert result.exit_code == 0, result.exception
    rows = rows_of(tmp_path / "out" / "table.csv")
    assert [float(row["gap"]) for row in rows] == [pytest.approx(one.boxes[0][0], rel=0.03) for one in DRAWN]
    assert sum(bool(row["lead_far"]) for row in rows) == len(DRAWN)
    if name == "coco":
        with Image.open(tmp_path / "out" / "masks" / f"{DRAWN[0].file}-1.png") as mask:
            x0, y0, x1, y1 = DRAWN[0].corners(1)
            assert np.asarray(mask).any(axis=2).sum() == (x1 - x0) * (y1 - y0)


def test_a_role_is_taken_as_it_is_annotated(tmp_path: Path) -> None:
    """A category called lead leads, also beside the own way; and then no way is needed."""
    photos, objects = coco(tmp_path, DRAWN)
    whole = json.loads(objects.read_text())
    whole["categories"].append({"id": 2, "name": "Lead"})
    for one in whole["annotations"][1::2]:
        one["category_id"] = 2
    objects.write_text(json.dumps(whole))
    found = read_format("coco", photos, objects, None)
    assert [one.lead.box for one in found.photos if one.lead] == [Box(*one.corners(1)) for one in DRAWN]


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("kitti", "Car 0.00 0 0.1 3 4", "000000.txt, line 1 has not the 15 fields of KITTI's labels"),
        ("kitti", "Car a b c", "000000.txt, line 1: could not convert string to float: 'a'; it has not the 15 fields"),
        ("kitti", "Car 0 0 0 90 50 60 80 1 1 4 0 1 9 0", "000000.txt, line 1: its box is empty"),
        ("yolo", "0 0.5 0.5 0.1", "000000.txt, line 1 has not the class and four numbers of a box"),
        ("yolo", "0 120 40 30 20", "its numbers must be shares of the picture"),
        ("yolo", "0 0.5 0.5 0.1 0.1 -4", "the distance is -4; it is more than 0"),
        ("yolo", "0 0.5 0.5 0 0.1", "its box is empty"),
        ("yolo", "0 0.5 0.5 0.1 0.1 0.9\n0 0.2 0.5 0.1 0.1 0.4", "no distance is above 1, as if the last number"),
        (
            "yolo",
            "0 0.5 0.5 0.1 0.1 7\n0 0.2 0.5 0.1 0.1 12",
            "every distance is a whole number, as if the last number",
        ),
        ("mot", "99,1,2,3,4,5", "there is no picture of instant 99"),
        ("mot", "0,1,2,3,0,5", "its box is empty"),
        ("mot", "0,1,2", "gt.txt, line 1 has not the six numbers of MOT"),
        ("coco", "{}", "is no COCO file"),
        ("coco", '{"images": [{"id": 1, "file_name": "x.png"}], "annotations": []}', "there is no picture 'x.png'"),
        ("coco", '{"images": [{"id": 1, "file_name": "/etc/passwd"}], "annotations": []}', "leads outside"),
    ],
)
def test_a_fault_of_a_file_is_said_with_its_line(name: str, change: str, words: str, tmp_path: Path) -> None:
    """What, which, and nothing is taken from a file that is wrong."""
    photos, objects = WRITERS[name](tmp_path, DRAWN[:1])
    (objects / "000000.txt" if objects.is_dir() else objects).write_text(change)
    with pytest.raises(SourceError) as caught:
        read_format(name, photos, objects, None)
    assert words in str(caught.value)


def test_a_broken_table_of_nuscenes_is_named(tmp_path: Path) -> None:
    """A table that is not there, one of another kind, and a token that another table has not."""
    photos, objects = nuscenes(tmp_path, DRAWN[:1])
    kept = (objects / "scene.json").read_text()
    for text, words in (("[{}]", "is no table of nuScenes"), ("[]", "refers to a token that another has not")):
        (objects / "scene.json").write_text(text)
        with pytest.raises(SourceError, match=words):
            read_format("nuscenes", photos, objects, None)
    (objects / "scene.json").write_text(kept)
    (objects / "log.json").unlink()
    with pytest.raises(SourceError, match=r"log\.json cannot be read"):
        read_format("nuscenes", photos, objects, None)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda whole: whole["annotations"][0].update(image_id=7), "annotation 0: no image has its image_id 7"),
        (lambda whole: whole["annotations"][0]["attributes"].update(role="led"), "role is 'led', not lead, own"),
        (lambda whole: whole["annotations"][0]["attributes"].update(distance_m=10**400), "distance_m is '1000"),
        (lambda whole: [one["attributes"].update(role="lead") for one in whole["annotations"]], "one object leads"),
        (lambda whole: whole["images"].append({**whole["images"][0], "id": 2}), "is already in instances.json, image"),
        (lambda whole: whole["images"].append(dict(whole["images"][0])), "2 images have the id '000000.png'"),
        (lambda whole: whole["categories"].append({"id": 1, "name": "own"}), "2 categories have the id 1"),
        (
            lambda whole: whole["annotations"][0].update(category_id=4),
            "no category has its category_id 4",
        ),
    ],
)
def test_what_would_empty_a_road_in_silence_is_a_fault(
    change: Callable[[dict[str, Any]], object], words: str, tmp_path: Path
) -> None:
    """A photograph that loses its objects would say that nothing is ahead."""
    photos, objects = coco(tmp_path, DRAWN[:1])
    whole = json.loads(objects.read_text())
    change(whole)
    objects.write_text(json.dumps(whole))
    with pytest.raises(SourceError) as caught:
        read_format("coco", photos, objects, None)
    assert words in str(caught.value)


def test_an_attribute_counts_in_capitals_too(tmp_path: Path) -> None:
    """The lead would be another thing, and its distance unknown."""
    photos, objects = coco(tmp_path, DRAWN[:1])
    whole = json.loads(objects.read_text())
    whole["annotations"][0]["attributes"] = {"Role": "lead", "Distance_m": 7.5}
    objects.write_text(json.dumps(whole))
    (photo,) = read_format("coco", photos, objects, None).photos
    assert photo.lead is not None
    assert photo.lead.distance_m == 7.5


def test_a_part_of_kitti_that_nobody_looked_at_is_left_out_however_it_is_written(tmp_path: Path) -> None:
    """It would stand on the road as a thing."""
    photos, objects = kitti(tmp_path, DRAWN[:1])
    labels = objects / "000000.txt"
    labels.write_text(labels.read_text().replace("DontCare", "Dontcare"))
    assert [one.role for one in read_format("kitti", photos, objects, None).photos[0].things][-1] == IGNORED


def test_an_object_without_a_category_is_not_of_the_one_with_the_number_0(tmp_path: Path) -> None:
    """Nor does a category that is listed twice by one name matter."""
    photos, objects = coco(tmp_path, DRAWN[:1])
    whole = json.loads(objects.read_text())
    whole["categories"] = [{"id": 0, "name": "own"}, {"id": 0, "name": "Own"}]
    for one in whole["annotations"]:
        del one["category_id"]
    objects.write_text(json.dumps(whole))
    assert {one.role for one in read_format("coco", photos, objects, None).photos[0].things} == {OTHER}


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("occluded", 0.8, "occluded is 0.8; it is 0 for visible"),
        ("occluded", 4, "occluded is 4; it is 0 for visible"),
        ("truncated", 30, "truncated is 30; it is the share outside of the picture, from 0 to 1"),
    ],
)
def test_a_share_is_no_step_and_a_per_cent_no_share(name: str, value: float, words: str, tmp_path: Path) -> None:
    """A lead that is hidden by four fifths would pass for a visible one."""
    photos, objects = coco(tmp_path, DRAWN[:1])
    whole = json.loads(objects.read_text())
    whole["annotations"][0]["attributes"][name] = value
    objects.write_text(json.dumps(whole))
    with pytest.raises(SourceError) as caught:
        read_format("coco", photos, objects, None)
    assert f"instances.json, annotation 0: {words}" in str(caught.value)


def test_runs_of_another_size_than_the_picture_cut_nothing_out(tmp_path: Path) -> None:
    """The photograph is refused with its reason, and the others are edited."""
    photos, objects = coco(tmp_path, DRAWN)
    whole = json.loads(objects.read_text())
    size = whole["annotations"][1]["segmentation"]["size"]
    pixels = size[0] * size[1]
    whole["annotations"][1]["segmentation"] = {"size": [size[0] * 2, size[1]], "counts": [pixels, 9, pixels - 9]}
    objects.write_text(json.dumps(whole))
    text = "".join(f"{one.file},{HORIZON},right\n" for one in DRAWN)
    (tmp_path / "photos.csv").write_text(f"file,horizon,beside\n{text}")
    ways = ("--lane", str(LANE_M), "--eye", str(EYE_M), "--table", str(tmp_path / "photos.csv"))
    result = edit("coco", photos, objects, tmp_path / "out", *ways)
    assert result.exit_code == 0, result.exception
    refused = json.loads((tmp_path / "out" / "edit.json").read_text())["refused"]
    words = f"annotation 1: the mask: it has {size[1]}×{size[0] * 2} pixels, and its picture {size[1]}×{size[0]}"
    assert [(one["file"], one["reason"].partition(", ")[2]) for one in refused] == [(DRAWN[0].file, words)]


def test_pictures_without_a_word_of_them_are_counted(tmp_path: Path) -> None:
    """They are left out, and boxes that are no pixels leave nothing on the own way."""
    photos, objects = kitti(tmp_path, DRAWN)
    (objects / "000001.txt").unlink()
    ways = ("--lane", str(LANE_M), "--eye", str(EYE_M))
    assert (
        "1 picture is in no annotation, and left out" in edit("kitti", photos, objects, tmp_path / "out", *ways).output
    )
    for labels in objects.glob("*.txt"):
        labels.write_text("Car 0 0 0 0.4 0.3 0.6 0.5 1 1 4 0 1 9 0\n")
    said = str(edit("kitti", photos, objects, tmp_path / "none", *ways).exception)
    assert "nothing stands on the own way by --lane, --eye, the horizon, and boxes in pixels" in said


def test_a_region_that_was_not_annotated_is_an_attribute_too(tmp_path: Path) -> None:
    """As in the table of objects: nothing of it is cut out."""
    photos, objects = coco(tmp_path, DRAWN[:1])
    whole = json.loads(objects.read_text())
    whole["annotations"][1]["attributes"]["role"] = "Ignored"
    objects.write_text(json.dumps(whole))
    assert [one.role for one in read_format("coco", photos, objects, None).photos[0].things] == ["", "ignored"]


def test_a_lens_that_is_no_matrix_is_named(tmp_path: Path) -> None:
    """Its rows have other lengths."""
    photos, objects = nuscenes(tmp_path, DRAWN[:1])
    mounts = json.loads((objects / "calibrated_sensor.json").read_text())
    mounts[0]["camera_intrinsic"] = [[1.0], [1.0, 2.0], [3.0]]
    (objects / "calibrated_sensor.json").write_text(json.dumps(mounts))
    with pytest.raises(SourceError, match="no camera_intrinsic of 3×3 numbers"):
        read_format("nuscenes", photos, objects, None)


@pytest.mark.parametrize("name", WRITERS)
def test_photographs_that_are_not_there_are_named(name: str, tmp_path: Path) -> None:
    """In every form, before its files are read."""
    _, objects = WRITERS[name](tmp_path, DRAWN[:1])
    with pytest.raises(SourceError, match="gone is no folder of photographs"):
        read_format(name, tmp_path / "gone", objects, None)


def test_options_that_a_form_does_not_take_are_refused(tmp_path: Path) -> None:
    """And a form without roles needs to know how wide the own way is."""
    photos, objects = kitti(tmp_path, DRAWN[:2])
    out = tmp_path / "out"
    assert "--lane and --eye say how wide" in str(edit("kitti", photos, objects, out).exception)
    assert "--boxes is for the table" in str(edit("kitti", photos, objects, out, "--boxes", "xywh").exception)
    assert "unknown --format 'kiti'; did you mean 'kitti'?" in str(edit("kiti", photos, objects, out).exception)
    assert "give --table, the table of the photographs" in str(edit("", photos, objects, out).exception)
    assert "is no folder; --objects is the folder" in str(edit("yolo", photos, tmp_path / "a.txt", out).exception)
    (tmp_path / "rows.csv").write_text("file\n000000.png\n000001.png\n")
    (objects / "000001.txt").unlink()
    words = ("--table", str(tmp_path / "rows.csv"), "--lane", "3", "--eye", "1.5")
    assert "row 2: '000001.png' is not annotated in" in str(edit("kitti", photos, objects, out, *words).exception)
    assert not out.exists()


@pytest.mark.parametrize("name", ["coco", "nuscenes"])
def test_pictures_of_another_size_than_the_annotated_ones_are_refused(name: str, tmp_path: Path) -> None:
    """Boxes of whole pictures would cut the wrong thing out of smaller ones."""
    photos, objects = WRITERS[name](tmp_path, DRAWN[:2])
    if name == "coco":
        whole = json.loads(objects.read_text())
        whole["images"][0]["height"] = drawn_roads.HEIGHT
        objects.write_text(json.dumps(whole))
    picture = next(photos.rglob(DRAWN[0].file))
    with Image.open(picture) as found:
        found.resize((drawn_roads.WIDTH // 2, drawn_roads.HEIGHT // 2)).save(picture)
    result = edit(name, photos, objects, tmp_path / "out", "--lane", str(LANE_M), "--eye", str(EYE_M))
    assert result.exit_code != 0
    assert f"annotated as a picture of {drawn_roads.WIDTH}×{drawn_roads.HEIGHT} pixels" in str(result.exception)
    assert not (tmp_path / "out").exists()


def test_a_thing_at_the_camera_empties_no_road(tmp_path: Path) -> None:
    """Nearer than half a metre no box can be drawn; the photograph would say that nothing is ahead."""
    photos, objects = nuscenes(tmp_path, DRAWN[:1])
    boxes = json.loads((objects / "sample_annotation.json").read_text())
    boxes[0] |= {"translation": [100.0, 52.0, 0.6], "size": [1.8, 4.0, 1.5]}
    (objects / "sample_annotation.json").write_text(json.dumps(boxes))
    with pytest.raises(SourceError, match=r"stands before the camera, nearer than 0\.5 m"):
        read_format("nuscenes", photos, objects, None)


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("sample_token", "gone", "no sample has its sample_token 'gone'"),
        ("token", None, "sample_annotation.json has two rows of the token"),
        ("size", [1.5, 0, 1.2], "Expected `float` > 0.0"),
        ("size", [1.5, -2, 1.2], "Expected `float` > 0.0"),
    ],
)
def test_no_box_of_nuscenes_is_lost_or_turned_in_silence(field: str, value: object, words: str, tmp_path: Path) -> None:
    """A box of another sample, two of one token, and one without a size."""
    photos, objects = nuscenes(tmp_path, DRAWN[:1])
    boxes = json.loads((objects / "sample_annotation.json").read_text())
    boxes[0][field] = value or boxes[1][field]
    (objects / "sample_annotation.json").write_text(json.dumps(boxes))
    with pytest.raises(SourceError) as caught:
        read_format("nuscenes", photos, objects, None)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("table", "field", "value"),
    [
        ("sample_annotation", "translation", [1e308, 52.0, 0.6]),
        ("sample_annotation", "size", [1.8, 1e300, 1.5]),
        ("ego_pose", "translation", [-1e308, 0.0, 0.0]),
        ("calibrated_sensor", "camera_intrinsic", [[1e308, 0, 1], [0, 1, 1], [0, 0, 1]]),
    ],
)
def test_numbers_beyond_every_place_are_refused(table: str, field: str, value: object, tmp_path: Path) -> None:
    """Geometry would overflow with them, and a thing would vanish from its picture."""
    photos, objects = nuscenes(tmp_path, DRAWN[:1])
    rows = json.loads((objects / f"{table}.json").read_text())
    rows[0][field] = value
    (objects / f"{table}.json").write_text(json.dumps(rows))
    with pytest.raises(SourceError, match=rf"{table}\.json is no table of nuScenes: .*1000000000.*{field}"):
        read_format("nuscenes", photos, objects, None)


def test_two_pictures_of_one_annotation_are_named(tmp_path: Path) -> None:
    """Neither is left out without a word, and an instant is a whole number."""
    for name, other in (("yolo", DRAWN[0].file.replace(".png", ".jpg")), ("mot", f"{int(DRAWN[0].file[:6])}.png")):
        (tmp_path / name).mkdir()
        photos, objects = WRITERS[name](tmp_path / name, DRAWN[:2])
        with Image.open(photos / DRAWN[0].file) as found:
            found.convert("RGB").save(photos / other)
        with pytest.raises(SourceError, match=r"have one text file; keep one|are both of instant \d+; keep one"):
            read_format(name, photos, objects, None)
        (photos / other).unlink()
    objects.write_text(f"{objects.read_text()}\n1.7,1,5,5,9,9,1,3,1\n")
    with pytest.raises(SourceError, match=r"no picture of instant 1\.7"):
        read_format("mot", photos, objects, None)
