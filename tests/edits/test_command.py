"""The command: from two tables to a folder that the import takes as it is."""

import csv
import hashlib
import json
import shlex
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner, Result

import edited_worlds
from eyechart.cli.app import app
from eyechart.conditions import CONTROLS, COUNTERFACTUALS
from eyechart.edits import PICTURES, Photo
from eyechart.edits.controls import EVERY, Edit
from eyechart.edits.edit import Sheets
from eyechart.frames import check, open_bank

NEAR_FAR = ("--near", "2.6:4.4", "--far", "18:27")


@pytest.fixture(scope="module")
def brought(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with photographs, two tables, and one photograph with nothing ahead."""
    folder = tmp_path_factory.mktemp("brought")
    found = [one for one in edited_worlds.moments("rover", 36) if one.lead is not None and one.lead.gap_m < 6]
    edited_worlds.write(folder, tuple(found[:5]))
    Image.fromarray(found[0].rendered(None)).save(folder / "photos" / "empty.png")
    with (folder / "photos.csv").open("a") as file:
        file.write("empty.png,offset-0,99,offset,96,160,\n")
    return folder


def rows_of(table: Path) -> list[dict[str, str]]:
    """Return a table's rows."""
    with table.open() as file:
        return list(csv.DictReader(file))


def edit(folder: Path, out: Path, *words: str, table: str = "photos.csv", objects: str = "objects.csv") -> Result:
    """Run the command on a folder's photographs."""
    tables = ("--table", str(folder / table), "--objects", str(folder / objects))
    given = ["frames", "edit", str(folder / "photos"), *tables, *NEAR_FAR, "--out", str(out), *words]
    return CliRunner().invoke(app, given)


def test_the_columns_are_those_of_the_rules() -> None:
    """Each is a condition with a picture of its own that today's rules read."""
    assert set(PICTURES) < {*CONTROLS, *COUNTERFACTUALS}


def test_an_edited_folder_is_imported_as_it_is(brought: Path, tmp_path: Path) -> None:
    """Photographs keep their bytes, gaps are those annotated, and every cell is a picture of its distance."""
    out = tmp_path / "edited"
    result = edit(brought, out, "--lane", "2", "--eye", "1.2")
    assert result.exit_code == 0, result.output
    assert f"look at {out / 'sheet.png'} before you go on" in result.stderr
    words = ["frames", "import", str(out), "--table", str(out / "table.csv"), "--threshold", "8", "--unit", "m"]
    assert CliRunner().invoke(app, [*words, "--mirror", "horizontal", "--out", str(tmp_path / "bank")]).exit_code == 0
    bank = open_bank(tmp_path / "bank")
    assert check(bank.root) == []
    assert len(bank) == 6
    frame = bank.frame("taken/empty.png")
    assert frame.truth["gap"] is None
    assert not frame.counterfactuals
    moved = [one for one in bank if "lead_drawn" in one.counterfactuals]
    assert len(moved) >= 4
    for one in moved:
        assert bank.image(one) == (brought / "photos" / one.id.removeprefix("taken/")).read_bytes()
        assert 2.6 <= one.truth["lead_drawn_m"] <= 27
        assert 2.6 <= one.truth["lead_near_m"] <= 4.4
        assert 18 <= one.truth["lead_far_m"] <= 27
    with Image.open(out / "sheet.png") as sheet:
        assert sheet.width > 2000


def test_the_record_has_method_parameters_refusals_and_digests(brought: Path, tmp_path: Path) -> None:
    """Each digest is of its file, and each cell that is empty has a reason."""
    out = tmp_path / "edited"
    assert edit(brought, out, "--seed", "4").exit_code == 0
    record = json.loads((out / "edit.json").read_text())
    assert (record["made"], record["method"]) == ("edited", "edit/1")
    assert record["parameters"]["near_m"] == [2.6, 4.4]
    assert record["parameters"]["seed"] == 4
    assert {"table.csv", "sheet.png"} < record["digests"].keys()
    for file, digest in record["digests"].items():
        assert hashlib.sha256((out / file).read_bytes()).hexdigest() == digest
    refused = {(one["file"], one["picture"]): one["reason"] for one in record["refused"]}
    for row in rows_of(out / "table.csv"):
        taken = row["file"].removeprefix("taken/")
        for name in PICTURES:
            told = (taken, name) in refused or (taken, "all") in refused
            assert bool(row[name]) != (told or not row["gap"])
    assert "the exchange needs --lane and --eye" in {*refused.values()}.pop()
    assert record["pictures"]["exchange_own"] == 0
    assert record["masks"] == {"file": record["masks"]["file"]}


def test_the_same_command_makes_the_same_bytes_and_another_seed_others(brought: Path, tmp_path: Path) -> None:
    """A photograph's pictures depend on the seed and on it; the JSON tells what was made."""
    found = []
    for name, seed in (("a", "0"), ("b", "0"), ("c", "1")):
        result = edit(brought, tmp_path / name, "--seed", seed, "--json")
        assert result.exit_code == 0
        assert json.loads(result.stdout)["made"] == "edited"
        assert "digests" not in json.loads(result.stdout)
        found.append(json.loads((tmp_path / name / "edit.json").read_text())["digests"])
    assert found[0] == found[1]
    for column in ("lead_near_m", "lead_far_m", "lead_drawn_m"):
        one, other = ([row[column] for row in rows_of(tmp_path / name / "table.csv") if row[column]] for name in "ac")
        assert not set(one) & set(other)
        assert len({*one}) == len(one) >= 4


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--near", "9:5"), "--near takes two distances above 0, the lower first, as 5:9; not 9:5"),
        (("--near", "5:40"), "--near ends at 40 and --far begins at 18: near must be nearer"),
        (("--near", "close"), "--near takes two distances in metres, as 5:9; got 'close'"),
        (("--boxes", "xyx"), "unknown --boxes 'xyx'; did you mean 'xyxy'?"),
        (("--cut", "knife"), "unknown --cut 'knife'"),
        (("--lane", "-1"), "--lane is in metres, above 0 and below 100; not -1"),
        (("--shadow", "2"), "--shadow is a share of the lead's height, from 0 to 1; not 2"),
        (("--from-foot", "0"), "--from-foot is focal length times camera height in px·m, above 0; not 0"),
    ],
)
def test_a_wrong_option_is_an_error_in_words(
    brought: Path, tmp_path: Path, words: tuple[str, ...], message: str
) -> None:
    """Nothing is written."""
    result = edit(brought, tmp_path / "edited", *words)
    assert message in str(result.exception)
    assert not (tmp_path / "edited").exists()


def test_an_output_that_exists_is_not_touched(brought: Path, tmp_path: Path) -> None:
    """Its files stay."""
    (tmp_path / "kept.txt").write_text("mine")
    assert f"{tmp_path} exists already and is not an empty folder" in str(edit(brought, tmp_path).exception)
    assert (tmp_path / "kept.txt").read_text() == "mine"
    assert [one.name for one in tmp_path.iterdir()] == ["kept.txt"]


def test_two_photographs_must_not_share_the_name_of_a_picture(brought: Path, tmp_path: Path) -> None:
    """Control pictures are PNGs, named for their photograph."""
    (brought / "photos" / "two.jpg.png").write_bytes((brought / "photos" / "empty.png").read_bytes())
    with Image.open(brought / "photos" / "empty.png") as picture:
        picture.save(brought / "photos" / "two.jpg")
    (brought / "two.csv").write_text("file\ntwo.jpg\ntwo.jpg.png\n")
    (brought / "none.csv").write_text("file,role,x0,y0,x1,y1,distance_m\n")
    said = str(edit(brought, tmp_path / "out", table="two.csv", objects="none.csv").exception)
    assert said.startswith("two.csv, row 1: 'two.jpg' and 'two.jpg.png' would have pictures of one name; rename one")


def test_what_cannot_be_edited_at_all_leaves_nothing(brought: Path, tmp_path: Path) -> None:
    """The reasons are counted, and no table without a control picture is written."""
    text = (brought / "objects.csv").read_text().replace(",lead,", ",,")
    (brought / "none.csv").write_text(text)
    said = str(edit(brought, tmp_path / "edited", objects="none.csv").exception)
    assert (
        said
        == "no control picture could be made, and nothing was written: no photograph has an object with the role lead"
    )
    assert not (tmp_path / "edited").exists()
    assert not list(tmp_path.iterdir())


def test_a_lead_without_a_distance_is_no_row_without_a_lead(brought: Path, tmp_path: Path) -> None:
    """An empty gap would say that nothing is ahead: the photograph is left out, with what would do."""
    rows = rows_of(brought / "objects.csv")
    first = next(one for one in rows if one["role"] == "lead")
    taken, first["distance_m"] = first["file"], ""
    with (brought / "unknown.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    assert edit(brought, tmp_path / "edited", objects="unknown.csv").exit_code == 0
    table = (tmp_path / "edited" / "table.csv").read_text()
    assert f"taken/{taken}," not in table
    record = json.loads((tmp_path / "edited" / "edit.json").read_text())
    reasons = [one["reason"] for one in record["refused"] if one["file"] == taken]
    assert reasons == ["the distance of its lead is not known: give distance_m, or --from-foot K"]
    assert edit(brought, tmp_path / "feet", "--from-foot", "192", objects="unknown.csv").exit_code == 0
    found = {row["file"]: row for row in rows_of(tmp_path / "feet" / "table.csv")}
    lead = next(one.lead for one in edited_worlds.moments("rover", 36) if one.file == taken)
    assert lead is not None
    assert float(found[f"taken/{taken}"]["gap"]) == pytest.approx(lead.gap_m, rel=0.03)


def test_a_lead_that_is_not_in_its_picture_gives_no_gap(brought: Path, tmp_path: Path) -> None:
    """Its photograph would say that something is ahead that nobody sees in it."""
    rows = rows_of(brought / "objects.csv")
    number, first = next((place, one) for place, one in enumerate(rows, 1) if one["role"] == "lead")
    taken = first["file"]
    first |= {"x0": "900", "x1": "940", "mask": ""}
    with (brought / "outside.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    assert edit(brought, tmp_path / "edited", objects="outside.csv").exit_code == 0
    assert f"taken/{taken}" not in {row["file"] for row in rows_of(tmp_path / "edited" / "table.csv")}
    assert not (tmp_path / "edited" / "taken" / taken).exists()
    record = json.loads((tmp_path / "edited" / "edit.json").read_text())
    assert [one for one in record["refused"] if one["file"] == taken] == [
        {
            "file": taken,
            "picture": "real",
            "reason": f"outside.csv, row {number}: the box of its lead is outside of the picture",
        }
    ]


def test_a_row_with_too_few_cells_is_one_fault(brought: Path, tmp_path: Path) -> None:
    """It is not said besides that its cells are empty; and an empty file cannot be left out by an option."""
    objects = (brought / "objects.csv").read_text()
    (brought / "short.csv").write_text(f"file,episode\n{rows_of(brought / 'photos.csv')[0]['file']},a\nempty.png\n")
    (brought / "broken.csv").write_text(f"{objects}empty.png,1,2\n")
    said = str(edit(brought, tmp_path / "out", table="short.csv").exception)
    assert said == f"{brought / 'short.csv'}, row 2 has 1 cells; the header has 2"
    said = str(edit(brought, tmp_path / "out", objects="broken.csv").exception)
    count = len(rows_of(brought / "objects.csv")) + 1
    assert said == f"{brought / 'broken.csv'}, row {count} has 3 cells; the header has 8"
    (brought / "short.csv").write_text("file,episode\n,a\n")
    said = str(edit(brought, tmp_path / "out", table="short.csv").exception)
    assert said == "short.csv, row 1: the file is empty; each row names its photograph"
    assert not list(tmp_path.iterdir())


def test_the_sheet_says_why_a_hole_could_not_be_filled(tmp_path: Path) -> None:
    """As it says every other reason for a photograph without control pictures."""
    picture = np.zeros((40, 60, 3), np.uint8)
    sheets = Sheets(tmp_path)
    sheets.add(Photo("one.png", {}), picture, None, Edit(refused={EVERY: "60% of the hole"}), [])
    assert sheets._rows[0][0].lines == ("one.png", "60% of the hole")


def test_a_picture_that_programs_show_unlike_is_refused_with_its_row(brought: Path, tmp_path: Path) -> None:
    """A grey one: boxes are of the picture as it is saved, so nothing is converted."""
    grey = np.asarray(Image.open(brought / "photos" / "empty.png").convert("L"))
    Image.fromarray(grey).save(brought / "photos" / "grey.png")
    (brought / "grey.csv").write_text("file\ngrey.png\n")
    (brought / "nothing.csv").write_text("file,role,x0,y0,x1,y1,distance_m\n")
    said = str(edit(brought, tmp_path / "out", table="grey.csv", objects="nothing.csv").exception)
    assert said.startswith("grey.csv, row 1: 'grey.png' is grey; save it as red, green and blue")
    assert "its boxes must be those of the picture as saved" in said


def look(folder: Path, *words: str) -> Result:
    """Run a look on a folder's photographs and objects."""
    tables = ("--table", str(folder / "photos.csv"), "--objects", str(folder / "objects.csv"))
    given = ["look", "scripted:presence", "--photos", str(folder / "photos"), *tables, *words]
    return CliRunner().invoke(app, given)


def test_a_look_stops_at_the_sheet_and_says_how_to_go_on(
    brought: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No call is made before a person looked; the command that goes on asks the edited bank."""
    monkeypatch.chdir(tmp_path)
    words = (*NEAR_FAR, "--lane", "2", "--eye", "1.2", "--json")
    first = look(brought, *words)
    assert first.exit_code == 2, first.exception
    said = json.loads(first.stdout)
    assert said["answer"] == "Inconclusive"
    assert said["because"].startswith("No call was made yet. First look at looks/scripted-presence/edited/sheet.png")
    assert (tmp_path / "looks/scripted-presence/edited/sheet.png").is_file()
    assert not (tmp_path / "looks/scripted-presence/run").exists()
    again = look(brought, *words)
    (command,) = said["next"]
    assert f"was edited already: look at {tmp_path}/looks/scripted-presence/edited/sheet.png" in str(again.exception)
    done = CliRunner().invoke(app, shlex.split(command)[1:])
    assert done.exit_code in {0, 1, 2}, done.exception
    assert (tmp_path / "looks/scripted-presence/run").is_dir()
    bank = open_bank(tmp_path / "looks/scripted-presence/bank")
    assert bank.manifest.gap is not None
    assert bank.manifest.gap.threshold == 8.9
    assert any("lead_drawn" in one.counterfactuals for one in bank)


def test_options_of_an_edit_belong_together_in_a_look(brought: Path) -> None:
    """Each lacking one is named."""
    assert "give --near and --far" in str(look(brought, "--near", "5:9").exception)
    alone = CliRunner().invoke(app, ["look", "scripted:presence", "--near", "5:9"])
    assert "are for photographs that are edited: give --objects too" in str(alone.exception)
    lost = CliRunner().invoke(app, ["look", "scripted:presence", "--objects", "x.csv", *NEAR_FAR])
    assert "--objects belongs to --photos FOLDER and --table FILE" in str(lost.exception)
