"""Each refusal happens where it should, with its reason, and nowhere else."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from PIL import Image

import drawn_roads
from drawn_roads import BLUE, EYE_M, HORIZON, LANE_M, RED, SLOPE, Drawn
from eyechart.edits import PICTURES, Annotations, EditRecord, EditSource, Moves, ObjectBox, Photo, edit_photographs
from eyechart.edits.geometry import Box

NEAR, FAR = (4.0, 5.0), (12.0, 15.0)
LEAD = (6.0, 0.0, RED)
Change = Callable[[Photo], Photo]


def photo_of(drawn: Drawn, roles: tuple[str, ...] = ("lead", "", "")) -> Photo:
    """Return a drawn photograph as it is annotated, with both sides free."""
    things = (
        ObjectBox(role, Box(*drawn.corners(n)), ahead, where=f"row {n}")
        for n, (role, (ahead, _, _)) in enumerate(zip(roles, drawn.boxes, strict=False))
    )
    return Photo(drawn.file, {}, float(HORIZON), beside=("left", "right"), things=tuple(things), where="row 1")


def edited(folder: Path, boxes: tuple[tuple[float, float, tuple[int, int, int]], ...], change: Change) -> EditRecord:
    """Edit a photograph of boxes beside one that is in order, so that something is made."""
    sound, drawn = Drawn("sound.png", (LEAD,)), Drawn("a.png", boxes)
    drawn_roads.write_pictures(folder / "photos", [sound, drawn])
    photos = (photo_of(sound), change(photo_of(drawn)))
    source = EditSource(folder / "photos", Annotations(photos, ()), folder, cut="box")
    return edit_photographs(source, Moves(NEAR, FAR, LANE_M, EYE_M), folder / "out")


def refused(record: EditRecord) -> dict[str, str]:
    """Return the reasons of the photograph by picture."""
    return {one.picture: one.reason for one in record.refused if one.file == "a.png"}


def of_lead(**changed: object) -> Change:
    """Return the change of a photograph's lead."""
    return lambda photo: replace(
        photo,
        things=(replace(photo.things[0], **changed), *photo.things[1:]),  # type: ignore[arg-type]
    )


def with_thing(thing: ObjectBox) -> Change:
    """Return a photograph with one thing more."""
    return lambda photo: replace(photo, things=(*photo.things, thing))


def test_a_sound_photograph_is_edited_whole(tmp_path: Path) -> None:
    """Every picture is made, each with its copies, and nothing is refused."""
    record = edited(tmp_path, (LEAD,), lambda photo: photo)
    assert refused(record) == {}
    assert all(record.pictures[name] == 2 for name in PICTURES)
    assert {name: len(copies) for name, copies in record.copies["a.png"].items()} == {
        **dict.fromkeys(("lead_near", "lead_far", "lead_drawn", "patched"), 1),
        **dict.fromkeys(("exchange_own", "exchange_beside", "exchange_apart"), 2),
    }


@pytest.mark.parametrize(
    ("boxes", "change", "reason"),
    [
        ((LEAD,), of_lead(truncated=0.2), "it is annotated as truncated (0.2)"),
        ((LEAD,), of_lead(occluded=2), "it is annotated as occluded (2)"),
        (((6.0, 4.0, RED),), lambda photo: photo, "it touches the edge of the picture"),
        (((2.44, 0.0, RED),), lambda photo: photo, "no road is seen before it"),
        (((9.0, 0.0, RED),), lambda photo: photo, "it is 22 px high, less than 24"),
        ((LEAD,), lambda photo: replace(photo, horizon=72.0), "of it is above the horizon, where nothing says"),
        ((LEAD,), lambda photo: replace(photo, horizon=89.0), "its foot is at row 90, and the horizon at 89"),
        ((LEAD, (4.0, 0.9, BLUE)), lambda photo: photo, "something nearer covers"),
        ((LEAD, (7.0, 1.0, BLUE)),
         lambda photo: replace(photo, things=(photo.things[0], replace(photo.things[1], distance_m=None))),
         "it touches something whose distance is not known"),
        ((LEAD,), with_thing(ObjectBox("ignored", Box(90, 85, 130, 95), None)),
         "a region in which things were not annotated"),
        ((LEAD,), of_lead(mask="nothing.png"), "there is no file 'nothing.png'"),
    ],
)  # fmt: skip
def test_a_photograph_is_refused_whole(
    tmp_path: Path, boxes: tuple[tuple[float, float, tuple[int, int, int]], ...], change: Change, reason: str
) -> None:
    """With its reason; its row stays in the table, without a control picture."""
    record = edited(tmp_path, boxes, change)
    assert reason in refused(record)["all"]
    assert "a.png" not in record.copies
    assert "taken/a.png,6.0," in (tmp_path / "out" / "table.csv").read_text() or boxes[0][0] != 6.0


def test_a_copy_is_not_put_behind_the_end_of_the_free_ground(tmp_path: Path) -> None:
    """Far is not made, and what is drawn stays before it."""
    record = edited(tmp_path, (LEAD,), lambda photo: replace(photo, clear_to_m=9.0))
    why = refused(record)
    assert "it is beyond clear_to_m, 9" in why["lead_far"]
    assert {"lead_far", "exchange_own", "exchange_beside", "exchange_apart"} <= why.keys()
    assert record.copies["a.png"]["lead_drawn"][0]["distance_m"] <= 9
    assert "lead_near" not in why


def test_a_copy_is_not_put_on_or_behind_another_thing_of_its_way(tmp_path: Path) -> None:
    """Nor is the lead said to be absent where another stands behind it."""
    record = edited(tmp_path, (LEAD, (9.0, 0.0, BLUE)), lambda photo: photo)
    why = refused(record)
    assert "something stands in its place or before it (row 1)" in why["lead_far"]
    assert why["lead_absent"] == "something else stands on its way (row 1)"
    assert record.copies["a.png"]["lead_drawn"][0]["distance_m"] < 9
    beside = edited(tmp_path / "beside", (LEAD, (9.0, LANE_M, BLUE)), lambda photo: photo)
    assert not {"lead_far", "lead_absent"} & refused(beside).keys()


def test_the_exchange_needs_a_free_side_and_takes_no_other(tmp_path: Path) -> None:
    """Declared left, the copy stands on the left; on a way with something on it there is none."""
    left = edited(tmp_path / "left", (LEAD,), lambda photo: replace(photo, beside=("left",)))
    assert left.copies["a.png"]["exchange_beside"][0]["left_m"] > 0.8 * LANE_M
    right = edited(tmp_path / "right", (LEAD,), lambda photo: replace(photo, beside=("right",)))
    assert right.copies["a.png"]["exchange_beside"][0]["left_m"] < -0.8 * LANE_M
    none = edited(tmp_path / "none", (LEAD,), lambda photo: replace(photo, beside=()))
    assert "no side is declared free" in refused(none)["exchange_own"]
    taken = edited(tmp_path / "taken", (LEAD, (8.0, LANE_M, BLUE)), lambda photo: replace(photo, beside=("left",)))
    assert {"exchange_own", "exchange_beside", "exchange_apart"} <= refused(taken).keys()


def test_the_near_copy_stands_beside_at_the_same_distance_in_a_straight_line(tmp_path: Path) -> None:
    """And the far ones in pairs, farther than all that is drawn."""
    record = edited(tmp_path, (LEAD,), lambda photo: photo)
    copies = record.copies["a.png"]
    own, its_far = copies["exchange_own"]
    beside, far = copies["exchange_beside"]
    assert beside["distance_m"] ** 2 + beside["left_m"] ** 2 == pytest.approx(
        own["distance_m"] ** 2 + own["left_m"] ** 2, rel=0.01
    )
    assert copies["exchange_apart"] == [far, its_far]
    assert min(far["distance_m"], its_far["distance_m"]) >= FAR[0]
    drawn, exchanged = copies["lead_drawn"][0]["distance_m"], own["distance_m"]
    assert max(drawn, exchanged) >= 1.5 * min(drawn, exchanged)


def test_a_copy_that_would_be_too_large_or_under_the_own_vehicle_is_not_made(tmp_path: Path) -> None:
    """A far lead is not brought near; a foot that the bonnet hides is not one."""
    drawn = Drawn("a.png", ((7.0, 0.0, RED),))
    drawn_roads.write_pictures(tmp_path / "photos", [drawn])
    hooded = with_thing(ObjectBox("own", Box(0, 106, 200, 150), None))(photo_of(drawn))
    for near, photo, reason in (
        ((4.0, 4.2), hooded, "or the own vehicle hides its foot"),
        ((1.0, 1.2), photo_of(drawn), "which is not from 0.11 to 4"),
    ):
        source = EditSource(tmp_path / "photos", Annotations((photo,), ()), tmp_path, cut="box")
        record = edit_photographs(source, Moves(near, FAR), tmp_path / str(near[0]))
        assert reason in refused(record)["lead_near"]
        assert "lead_far" in record.copies["a.png"]


def test_what_is_own_or_another_thing_is_put_back_over_copies(tmp_path: Path) -> None:
    """A nearer thing beside covers a copy behind it, and the bonnet is as it was."""
    change = with_thing(ObjectBox("own", Box(0, 140, 200, 150), None))
    edited(tmp_path, (LEAD, (4.5, 1.8, BLUE)), change)
    drawn = Drawn("a.png", (LEAD, (4.5, 1.8, BLUE))).pixels()
    x0, y0, x1, y1 = Drawn("a.png", (LEAD, (4.5, 1.8, BLUE))).corners(1)
    for name in ("lead_far", "lead_drawn", "lead_absent", "patched"):
        with Image.open(tmp_path / "out" / name / "a.png") as picture:
            made = picture.convert("RGB")
        assert made.getpixel(((x0 + x1) // 2, (y0 + y1) // 2)) == BLUE, name
        assert made.getpixel((100, 145)) == tuple(int(one) for one in drawn[145, 100]), name
    assert SLOPE / LEAD[0] + HORIZON == 90
