"""Photographs as people have them: usual names, all faults at once, made plain on request, mirrored frame by frame."""

import csv
import io
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import photographs
from eyechart import cli
from eyechart.conditions import is_available
from eyechart.errors import BankError, SourceError, SpecError
from eyechart.frames import RGB, FrameBank, check, decode, made_plain, read_colour, require_plain
from eyechart.importing import Choices, Convert, costs, import_table, read_rig, taken

RED, GREEN, BLUE = (250, 0, 0), (0, 250, 0), (0, 0, 250)


def corners() -> Image.Image:
    """Return a picture that shows how it is turned: red above left, green above right, blue below, 6 wide, 4 high."""
    pixels = np.zeros((4, 6, 3), dtype=np.uint8)
    pixels[:2, :3], pixels[:2, 3:], pixels[2:] = RED, GREEN, BLUE
    return Image.fromarray(pixels)


def encoded(picture: Image.Image, kind: str, **options: object) -> bytes:
    """Return a picture's file."""
    file = io.BytesIO()
    picture.save(file, kind, **options)
    return file.getvalue()


def turned(orientation: int) -> Image.Exif:
    """Return the note that a camera writes."""
    note = Image.Exif()
    note[0x0112] = orientation
    return note


def clear() -> Image.Image:
    """Return the picture with its lower half transparent."""
    picture = corners().convert("RGBA")
    picture.putalpha(Image.fromarray(np.repeat(np.array([[255], [255], [0], [0]], dtype=np.uint8), 6, axis=1)))
    return picture


def deep() -> Image.Image:
    """Return a grey picture of 16 bits, from black to white."""
    return Image.fromarray(np.linspace(0, 65535, 24).round().astype(np.uint16).reshape(4, 6))


def odd() -> dict[str, tuple[bytes, str, str]]:
    """Return pictures that are not plain: the file, why it is refused, and what is done to make it plain."""
    rgb, other = corners(), Image.new("RGB", (6, 4), (9, 9, 9))
    film = {"save_all": True, "append_images": [other]}
    return {
        "turned.jpg": (
            encoded(rgb, "JPEG", exif=turned(6), quality=100, subsampling=0),
            "EXIF orientation 6",
            "turned",
        ),
        "turned.png": (encoded(rgb, "PNG", exif=turned(6)), "EXIF orientation 6", "turned"),
        "turned.webp": (encoded(rgb, "WEBP", exif=turned(6), lossless=True), "EXIF orientation 6", "turned"),
        "cmyk.jpg": (encoded(rgb.convert("CMYK"), "JPEG", quality=100), "printing colours (CMYK)", "CMYK"),
        "clear.png": (encoded(clear(), "PNG"), "has transparency", "transparency"),
        "clear.webp": (encoded(clear(), "WEBP", lossless=True), "has transparency", "transparency"),
        "one-colour.png": (encoded(rgb, "PNG", transparency=BLUE), "has transparency", "transparency"),
        "palette.png": (encoded(rgb.convert("P", palette=Image.Palette.ADAPTIVE), "PNG"), "has a palette", "palette"),
        "grey.png": (encoded(rgb.convert("L"), "PNG"), "is grey", "grey"),
        "grey.jpg": (encoded(rgb.convert("L"), "JPEG", quality=100), "is grey", "grey"),
        "two.png": (encoded(rgb.convert("1"), "PNG"), "is black and white", "black and white"),
        "deep.png": (encoded(deep(), "PNG"), "more than 8 bits a channel", "16 bits"),
        "deep.tif": (encoded(deep(), "TIFF"), "no picture of PNG, JPEG, WEBP", "16 bits"),
        "film.png": (encoded(rgb, "PNG", **film), "holds 2 pictures", "first of 2"),
        "film.webp": (encoded(rgb, "WEBP", lossless=True, **film), "holds 2 pictures", "first of 2"),
        "phone.jpg": (encoded(rgb, "MPO", quality=100, subsampling=0, **film), "holds 2 pictures", "first of 2"),
        "film.gif": (encoded(rgb, "GIF", **film), "no picture of PNG, JPEG, WEBP", "first of 2"),
        "plain.bmp": (encoded(rgb, "BMP"), "no picture of PNG, JPEG, WEBP", "BMP"),
    }


def what_is_seen(name: str) -> RGB:
    """Return what a program that follows every note shows of an odd picture, over yellow."""
    pixels = np.asarray(corners())
    if "turned" in name:
        return np.rot90(pixels, -1)
    if "deep" in name:
        grey = np.linspace(0, 255, 24).round().astype(np.uint8).reshape(4, 6)
        return np.repeat(grey[:, :, None], 3, axis=2)
    if name.startswith(("clear", "one-colour")):
        below = pixels.copy()
        below[2:] = (255, 255, 0)
        return below
    if name.startswith(("grey", "two")):
        return np.asarray(corners().convert("1" if name == "two.png" else "L").convert("RGB"))
    return pixels


@pytest.mark.parametrize("name", odd())
def test_an_odd_picture_is_refused_and_made_plain_where_that_is_asked(name: str) -> None:
    """What everyone sees of it is what a program that follows all notes shows; the plain one is taken by all."""
    picture, refused, done = odd()[name]
    with pytest.raises(BankError, match=name) as caught:
        require_plain(picture, name)
    assert refused in str(caught.value)
    pixels, words = made_plain(picture, name, background=read_colour("#ffff00"))
    assert any(done in word for word in words)
    assert np.abs(pixels.astype(int) - what_is_seen(name)).max() <= 8
    assert require_plain(encoded(Image.fromarray(pixels), "PNG"), name) == "image/png"


def test_all_that_is_odd_in_a_picture_is_said_at_once() -> None:
    """A print's colours and a turn are one line."""
    picture = encoded(corners().convert("CMYK"), "JPEG", exif=turned(3))
    with pytest.raises(BankError, match=r"is of printing colours \(CMYK\).*; it is turned only by EXIF orientation"):
        require_plain(picture, "both.jpg")


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "WEBP"])
def test_a_plain_picture_has_its_media_type_and_nothing_is_done_to_it(kind: str) -> None:
    """Not by its name, but by what it is."""
    picture = encoded(corners(), kind)
    assert require_plain(picture, "a.dat") == f"image/{kind.lower()}"
    pixels, done = made_plain(picture, "a.dat")
    assert done == []
    assert np.array_equal(pixels, decode(picture, "a.dat"))


def test_what_nobody_can_say_the_white_of_is_refused_whatever_is_asked() -> None:
    """Numbers of 32 bits."""
    picture = encoded(Image.fromarray(np.ones((4, 4), dtype=np.float32)), "TIFF")
    with pytest.raises(BankError, match="its white is unknown"):
        made_plain(picture, "depth.tif")


def table_of(rows: Sequence[Mapping[str, object]], path: Path) -> Path:
    """Write rows as a CSV file."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return path


@pytest.fixture
def album(tmp_path: Path) -> Path:
    """Return a folder with every odd picture and a plain one."""
    folder = tmp_path / "album"
    folder.mkdir()
    for name, (picture, _, _) in odd().items():
        (folder / name).write_bytes(picture)
    corners().save(folder / "plain.png")
    return folder


def test_a_folder_of_odd_pictures_becomes_a_bank_that_says_what_was_done(album: Path, tmp_path: Path) -> None:
    """The plain one keeps its bytes; the others are PNG under their own ids, and the manifest counts the kinds."""
    names = [*odd(), "plain.png"]
    table = table_of([{"file": name} for name in names], tmp_path / "t.csv")
    bank = import_table(album, table, tmp_path / "bank", Choices(convert=Convert("yellow", longest=5)))
    assert check(bank.root) == []
    assert [frame.id for frame in bank] == names
    for frame in bank:
        assert require_plain(bank.image(frame), frame.id) == "image/png"
        assert max(decode(bank.image(frame), frame.id).shape[:2]) == 5
        assert frame.file.endswith(".png")
    assert bank.manifest.settings["convert"] == {"background": "yellow", "longest": 5}
    done = bank.manifest.settings["converted"]
    assert isinstance(done, dict)
    assert (done["pictures"], done["turned"], done["made smaller"], done["first of 2"]) == (19, 3, 19, 4)
    assert any("19 pictures" in line and "over yellow" in line for line in taken(bank))


def test_without_a_bound_a_plain_picture_keeps_its_bytes(album: Path, tmp_path: Path) -> None:
    """Also where others are converted."""
    table = table_of([{"file": "plain.png"}, {"file": "grey.jpg"}], tmp_path / "t.csv")
    bank = import_table(album, table, tmp_path / "bank", Choices(convert=Convert()))
    assert bank.image(bank.frames[0]) == (album / "plain.png").read_bytes()
    assert bank.frames[1].file == "images/grey.jpg.png"


def test_all_faults_of_a_source_are_named_at_once(album: Path, tmp_path: Path) -> None:
    """Of choices, cells and pictures, each by its row; one round, and nothing is written."""
    rows = [
        {"file": "plain.png", "drive": 1, "tick": 0, "gap": "3", "side": "left"},
        {"file": "grey.png", "drive": "", "tick": "x", "gap": "near", "side": "horizontal"},
        {"file": "gone.png", "drive": 1, "tick": 0, "gap": "", "side": ""},
        {"file": "../out.png", "drive": 1, "tick": 2, "gap": "4", "side": ""},
        {"file": "plain.png", "drive": 1, "tick": 3, "gap": "5", "side": ""},
    ]
    choices = Choices(
        columns={"mirror": "side", "scenario": "plaec", "colour": "x"}, threshold=8.0, prompt_columns=("speed",)
    )
    with pytest.raises(SourceError) as caught:
        import_table(album, table_of(rows, tmp_path / "t.csv"), tmp_path / "bank", choices)
    first, *lines = str(caught.value).splitlines()
    assert first == f"t.csv has {len(lines)} faults, and nothing was written:"
    for words in (
        "columns={'scenario': 'plaec'}: t.csv has no column 'plaec'",
        "there is no place 'colour'",
        "the gap 'gap' needs a limit of near",
        "prompt_columns speed",
        "row 1: the mirror axis 'side' is 'left', not vertical, horizontal or none",
        "row 2: the gap 'gap' is 'near'",
        "row 2: the episode 'drive' is empty",
        "row 2: the step 'tick' is 'x'",
        "row 2: 'grey.png' is grey",
        "row 3: there is no picture 'gone.png'",
        "row 3: step 0 of episode '1' occurs twice",
        "row 4: the file 'file' is '../out.png', which leads outside",
        "row 5: 'plain.png' is already in row 1",
    ):
        assert sum(words in line for line in lines) == 1, words
    assert len(lines) == 13
    assert sorted(path.name for path in tmp_path.iterdir()) == ["album", "t.csv"]


@pytest.mark.parametrize("kind", ["csv", "jsonl"])
def test_rows_that_are_broken_are_faults_among_the_others(album: Path, tmp_path: Path, kind: str) -> None:
    """Each by its number, and the rows after them are read on."""
    rows = {
        "csv": ("file,drive", "plain.png,1", "grey.png", "cmyk.jpg,1,2,3", "gone.png,"),
        "jsonl": (
            *('{"file": "plain.png", "drive": 1}', '{"file": "grey.png"', '{"file": "cmyk.jpg", "tick": 2}'),
            '{"file": "gone.png"}',
        ),
    }[kind]
    table = tmp_path / f"t.{kind}"
    table.write_text("\n".join(rows) + "\n")
    with pytest.raises(SourceError) as caught:
        import_table(album, table, tmp_path / "bank", Choices())
    lines = str(caught.value).splitlines()
    assert lines[0] == f"t.{kind} has 4 faults, and nothing was written:"
    assert ["row 2" in lines[1], "row 3" in lines[2]] == [True, True]
    assert sum("row 4: the episode 'drive' is empty" in line for line in lines) == 1
    assert sum("row 4: there is no picture 'gone.png'" in line for line in lines) == 1


def test_a_refusal_names_the_option_that_makes_a_picture_plain(album: Path, tmp_path: Path) -> None:
    """Of each that can be made so, and of no other."""
    Image.fromarray(np.ones((4, 4), dtype=np.float32)).save(album / "depth.tif")
    (album / "cut.png").write_bytes((album / "plain.png").read_bytes()[:-30])
    table = table_of([{"file": name} for name in (*odd(), "depth.tif", "cut.png")], tmp_path / "t.csv")
    with pytest.raises(SourceError) as caught:
        import_table(album, table, tmp_path / "bank", Choices())
    for line in str(caught.value).splitlines()[1:]:
        assert line.endswith(", or import with convert=Convert()") != ("depth.tif" in line or "cut.png" in line), line


def test_more_faults_than_a_screen_holds_are_counted(album: Path, tmp_path: Path) -> None:
    """The first forty are said, and how many more there are."""
    table = table_of([{"file": f"{n}.png"} for n in range(100)], tmp_path / "t.csv")
    with pytest.raises(SourceError) as caught:
        import_table(album, table, tmp_path / "bank", Choices())
    lines = str(caught.value).splitlines()
    assert (lines[0], lines[-1]) == ("t.csv has 100 faults, and nothing was written:", "and 60 more")
    assert len(lines) == 42


def test_the_command_line_prints_each_fault_on_its_line(
    album: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit 2, and with --convert the same table is a bank."""
    table = table_of([{"file": "grey.png"}, {"file": "palette.png"}], tmp_path / "t.csv")
    words = ["eyechart", "frames", "import", str(album), "--table", str(table), "--out", str(tmp_path / "bank")]

    def run(*more: str) -> object:
        monkeypatch.setattr(sys, "argv", [*words, *more])
        with pytest.raises(SystemExit) as left:
            cli.main()
        return left.value.code

    assert run() == 2
    lines = capsys.readouterr().err.splitlines()
    assert "has 2 faults, and nothing was written:" in lines[-3]
    assert ["grey.png" in lines[-2], "palette.png" in lines[-1]] == [True, True]
    assert all(line.endswith(", or import with --convert") for line in lines[-2:])
    assert run("--longest", "5") == 2
    assert "give --convert too" in capsys.readouterr().err
    assert run("--convert", "--background", "nocolour") == 2
    assert "'nocolour' is not a colour" in capsys.readouterr().err
    assert run("--convert") == 0
    assert "converted to PNG: 2 pictures (1 a palette, 1 grey), over white" in capsys.readouterr().err


@pytest.fixture
def photos(tmp_path: Path) -> Path:
    """Return a folder of photographs."""
    photographs.take(tmp_path / "photos", photographs.rows())
    return tmp_path / "photos"


def test_usual_names_of_columns_are_taken_and_said(photos: Path, tmp_path: Path) -> None:
    """No --map: in whatever letters, the unit from the gap's name, paths from the table's own place."""
    names = {
        "photo": "Image Path",
        "drive": "Sequence",
        "place": "Location",
        "tick": "Frame-Number",
        "lidar_m": "Distance_m",
    }
    rows = [{names.get(name, name): value for name, value in row.items()} for row in photographs.rows()]
    rows = [{**row, "Image Path": f"photos/{row['Image Path']}"} for row in rows]
    bank = import_table(photos, table_of(rows, tmp_path / "t.csv"), tmp_path / "bank", Choices(threshold=18.0))
    assert bank.manifest.gap is not None
    assert (bank.manifest.gap.column, bank.manifest.gap.unit) == ("Distance_m", "m")
    assert bank.manifest.absent == ()
    assert bank.frames[0].id == str(photographs.rows()[0]["photo"])
    places = "file from 'Image Path', gap from 'Distance_m' in m, episode from 'Sequence', step from 'Frame-Number'"
    assert taken(bank) == [
        f"columns, guessed by their names: {places}, scenario from 'Location'",
        "columns without a place, kept as ground truth: speed; --map PLACE=COLUMN gives one a place",
    ]


def test_the_places_own_names_are_taken_in_whatever_letters(photos: Path, tmp_path: Path) -> None:
    """As spreadsheets write them."""
    names = {"photo": "File", "drive": "Episode", "place": "SCENARIO", "tick": "Step", "lidar_m": "Gap"}
    rows = [{names.get(name, name): value for name, value in row.items()} for row in photographs.rows()]
    rows = [{**row, "Mirror Axis": "horizontal", "Lead-Near": ""} for row in rows]
    choices = Choices(threshold=18.0, unit="m")
    bank = import_table(photos, table_of(rows, tmp_path / "t.csv"), tmp_path / "bank", choices)
    assert bank.manifest.absent == ()
    assert bank.manifest.gap is not None
    assert bank.frames[0].mirror_axis == "horizontal"
    assert not {*names.values(), "Mirror Axis", "Lead-Near"} - {"Gap"} & bank.frames[0].truth.keys()


@pytest.mark.parametrize(
    ("columns", "places"),
    [
        (("image_file", "video", "frame_idx", "scene"), ("episode", "scenario", "step")),
        (("img_path", "scene_token", "frame_no"), ("episode", "step")),
        (("frame_path", "clip_id"), ("episode",)),
        (("picture", "scene"), ("scenario",)),
    ],
)
def test_what_tables_of_videos_call_their_columns_is_taken(
    photos: Path, tmp_path: Path, columns: tuple[str, ...], places: tuple[str, ...]
) -> None:
    """Files by their usual names too; a scene with an episode's sign is one, else a kind of place."""
    cells = {"frame_idx": "tick", "frame_no": "tick", "scene": "place"}
    rows = [
        {name: row["photo"] if one == 0 else row[cells.get(name, "drive")] for one, name in enumerate(columns)}
        for row in photographs.rows()
    ]
    bank = import_table(photos, table_of(rows, tmp_path / "t.csv"), tmp_path / "bank", Choices())
    assert {"scenario", "episode", "step"} - {*bank.manifest.absent} == {*places}


def test_a_usual_name_is_not_taken_where_its_owner_says_otherwise(photos: Path, tmp_path: Path) -> None:
    """No threshold: no gap; independent: no episodes; said by a prompt, or left empty by --map: no place."""
    rows = [{**row, "distance_m": row["lidar_m"]} for row in photographs.rows()]
    choices = Choices(independent=True, prompt_columns=("place",), columns={"step": ""})
    bank = import_table(photos, table_of(rows, tmp_path / "t.csv"), tmp_path / "bank", choices)
    assert bank.manifest.gap is None
    assert bank.manifest.absent == ("scenario", "episode", "step")
    assert {"distance_m", "drive", "tick"} <= bank.frames[0].truth.keys()
    assert bank.frames[0].fields == {"place": "yard"}


def test_a_mirror_axis_may_be_a_column(photos: Path, tmp_path: Path) -> None:
    """Each frame is mirrored by its own axis, and those without one are left out of that condition."""
    rows = [{**row, "mirror_axis": ("horizontal", "Vertical ", "")[n % 3]} for n, row in enumerate(photographs.rows())]
    table = table_of(rows, tmp_path / "t.csv")
    bank = import_table(photos, table, tmp_path / "bank", Choices())
    assert [frame.mirror_axis for frame in bank][:3] == ["horizontal", "vertical", "none"]
    assert [is_available("mirrored", frame) for frame in bank][:3] == [True, True, False]
    given = import_table(photos, table, tmp_path / "given", Choices(mirror="horizontal"))
    assert {frame.mirror_axis for frame in given} == {"horizontal"}
    both = Choices(mirror="horizontal", columns={"mirror": "mirror_axis"})
    with pytest.raises(SourceError, match="both say the mirror axis: leave out one"):
        import_table(photos, table, tmp_path / "both", both)


RIG = """
[[camera]]
name = "front"
column = "photo"
mirror_axis = "horizontal"
changed = { lead_near = "near_front" }

[[camera]]
name = "rear"
column = "rear"
mirror_axis = "horizontal"
changed = { lead_near = "near_rear" }
"""


def rig_bank(photos: Path, tmp_path: Path, rig: str = RIG, **cells: str) -> FrameBank:
    """Import photographs as those of two cameras, with the lead moved near in each; ``cells`` are of the first row."""
    paths = [str(row["photo"]) for row in photographs.rows()]
    rows = [
        {"photo": path, "rear": paths[-1 - n], "near_front": paths[(n + 1) % 64], "near_rear": paths[(n + 2) % 64]}
        for n, path in enumerate(paths)
    ]
    rows[0] |= cells
    (tmp_path / "rig.toml").write_text(rig)
    choices = Choices(rig=read_rig(tmp_path / "rig.toml"))
    return import_table(photos, table_of(rows, tmp_path / "t.csv"), tmp_path / "bank", choices)


def test_pictures_with_one_thing_changed_may_be_of_several_cameras(photos: Path, tmp_path: Path) -> None:
    """Every camera's own column; a moment that none of them took again is without."""
    bank = rig_bank(photos, tmp_path, near_front="", near_rear="")
    assert check(bank.root) == []
    assert [*bank.frames[0].counterfactuals] == []
    second = bank.frames[1]
    assert {name: one.rpartition("lead_near/")[2] for name, one in second.counterfactuals["lead_near"].items()} == {
        "front": f"front/{photographs.rows()[2]['photo']}",
        "rear": f"rear/{photographs.rows()[3]['photo']}",
    }
    assert bank.images(second, "lead_near")["rear"] == (photos / str(photographs.rows()[3]["photo"])).read_bytes()


@pytest.mark.parametrize(
    ("change", "cells", "said"),
    [
        (("near_rear", "near_raer"), {}, "the lead_near rear is declared as column 'near_raer'"),
        (('{ lead_near = "near_rear" }', "{}"), {}, "camera 'rear' has other pictures with one thing changed"),
        (("lead_near =", "lead_nearer ="), {}, "changed.lead_nearer is none of"),
        (("", ""), {"near_rear": ""}, "row 1: lead_near has no picture of rear; take it by every camera, or by none"),
    ],
)
def test_a_rig_whose_changed_pictures_do_not_fit_says_why(
    photos: Path, tmp_path: Path, change: tuple[str, str], cells: dict[str, str], said: str
) -> None:
    """By camera and column."""
    with pytest.raises((SourceError, SpecError)) as caught:
        rig_bank(photos, tmp_path, RIG.replace(*change), **cells)
    assert said in str(caught.value)


def test_a_source_that_was_converted_is_imported_again_as_it_is(album: Path, tmp_path: Path) -> None:
    """What is plain stays: a bank's own table and pictures make the same pictures."""
    table = table_of([{"file": name} for name in odd()], tmp_path / "t.csv")
    bank = import_table(album, table, tmp_path / "bank", Choices(convert=Convert()))
    again = import_table(bank.root, bank.root / "metadata.jsonl", tmp_path / "again", replace(Choices(), columns={}))
    assert [bank.image(one) for one in bank] == [again.image(one) for one in again]
    assert "converted" not in json.loads((tmp_path / "again/manifest.json").read_text())["settings"]


def test_pictures_that_leave_as_many_megabytes_are_said(tmp_path: Path) -> None:
    """With what to do; a bank of small ones says nothing of it."""
    folder = tmp_path / "large"
    folder.mkdir()
    Image.new("RGB", (4000, 3000), "red").save(folder / "a.jpg")
    table = table_of([{"file": "a.jpg"}], tmp_path / "t.csv")
    said = [line for line in costs(import_table(folder, table, tmp_path / "bank", Choices())) if "large" in line]
    assert [line.partition(";")[0] for line in said] == [
        "large pictures: they leave as PNG, about 20 MB each, which many servers refuse"
    ]
    small = import_table(folder, table, tmp_path / "small", Choices(convert=Convert(longest=1280)))
    assert not any("large" in line for line in costs(small))
