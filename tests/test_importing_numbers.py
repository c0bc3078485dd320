"""Numbers of a table: marks that mean "nothing ahead", units, ways to write them, columns that were guessed."""

import csv
import io
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from PIL import Image

from eyechart import cli, importing
from eyechart.errors import SourceError, SpecError
from eyechart.frames import FrameBank, open_bank
from eyechart.importing import Choices, costs, import_table, taken
from eyechart.importing import columns as reading

PICTURES = 12
Table = Callable[..., FrameBank]
GAPS = (5.0, 30.0, 12.5, 41.0, 8.0, 22.0, 61.0, 17.0, 9.5, 33.0, 14.0, 80.2)


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of twelve pictures that differ."""
    folder = tmp_path_factory.mktemp("photos")
    for number in range(PICTURES):
        Image.new("RGB", (32, 24), (20 * number, 90, 200 - 10 * number)).save(folder / f"{number}.png")
    return folder


@pytest.fixture
def table(photos: Path, tmp_path: Path) -> Table:
    """Return a function that imports a table whose column ``gap`` has these cells."""

    def run(
        gaps: tuple[object, ...] = GAPS,
        *,
        column: str = "gap",
        delimiter: str = ",",
        extra: object = None,
        **changes: object,
    ) -> FrameBank:
        written, more = io.StringIO(), extra if isinstance(extra, dict) else {}
        rows = csv.writer(written, delimiter=delimiter)
        rows.writerow(["file", column, "episode", *more])
        for number, gap in enumerate(gaps):
            rows.writerow([f"{number}.png", gap, f"e{number // 2}", *(cells[number] for cells in more.values())])
        path = tmp_path / "table.csv"
        path.write_text(written.getvalue(), encoding="utf-8")
        given = {"columns": {"gap": column}, "threshold": 18.0, "unit": "m"} | changes
        return import_table(photos, path, tmp_path / "bank", Choices(**given))  # type: ignore[arg-type]

    return run


def marked(mark: object, *rows: int) -> tuple[object, ...]:
    """Return the gaps with a mark in some rows."""
    return tuple(mark if number in rows else gap for number, gap in enumerate(GAPS))


@pytest.mark.parametrize("mark", ["100", "200.0", "250", "500", "1000", "1e4"])
def test_a_round_number_that_stands_often_far_above_all_others_is_refused(table: Table, mark: str) -> None:
    """As the longest range of a sensor, written where nothing is ahead; declared, it is either."""
    gaps = tuple(gap if gap == mark else min(float(str(gap)), 40.0) for gap in marked(mark, 1, 3, 5))
    with pytest.raises(SourceError, match=r"row 2 and 2 more rows: the gap 'gap' is .*no_lead"):
        table(gaps)
    assert table(gaps, numerals=importing.Numerals(no_lead=(mark,))).frames[1].truth["gap"] is None


@pytest.mark.parametrize("far", [(1, 3), (1,)])
def test_a_round_number_that_is_seldom_or_near_others_is_a_distance(table: Table, far: tuple[int, ...]) -> None:
    """A road has far leads."""
    assert table(marked("200", *far)).frames[1].truth["gap"] == 200.0


@pytest.mark.parametrize("column", ["gap_inches", "gap_in", "gap (inch)", "gap_dm", "gap_pct", "gap_nmi", "gap_deg"])
def test_a_unit_of_another_kind_in_the_column_s_name_is_refused(table: Table, column: str) -> None:
    """An inch is no metre, and a share is none."""
    with pytest.raises((SourceError, SpecError), match="the gap's column"):
        table(column=column)


def test_a_mark_with_a_unit_behind_it_is_the_mark(table: Table) -> None:
    """As a program writes it that puts the unit behind every number."""
    gaps = tuple(f"{gap} m" for gap in marked("-1.0", 1, 3))
    assert table(gaps, numerals=importing.Numerals(no_lead=("-1",))).frames[1].truth["gap"] is None


def test_the_sign_between_thousands_may_be_either_apostrophe(table: Table) -> None:
    """A spreadsheet writes the curved one."""
    bank = table(marked("1\u2019234.5", 1), numerals=importing.Numerals("1'234.5", no_lead=()))
    assert bank.frames[1].truth["gap"] == 1234.5


@pytest.mark.parametrize("mark", ["-1", "-0.5", "-999", "-1.7976931348623157e+308", "-1e30"])
def test_a_gap_below_zero_is_refused_by_name_and_value(table: Table, tmp_path: Path, mark: str) -> None:
    """It would be the nearest lead of all; nothing is written."""
    with pytest.raises(SourceError, match=r"row 2.*gap.*no_lead|row 2.*gap.*up to") as refused:
        table(marked(mark, 1, 3))
    assert "no_lead" in str(refused.value)
    assert not (tmp_path / "bank").exists()


@pytest.mark.parametrize(
    "mark", ["99.9", "999", "9999", "999.99", "1000000", "65535", "32767", "2147483647", "3.4028235e38"]
)
@pytest.mark.parametrize("rows", [(1,), (1, 3, 5)])
def test_a_number_that_looks_like_a_mark_is_refused(table: Table, mark: str, rows: tuple[int, ...]) -> None:
    """Nines, powers of ten and limits of types, far above all other numbers, however often they stand there."""
    gaps = tuple(gap if gap == mark else min(float(str(gap)), 40.0) for gap in marked(mark, *rows))
    with pytest.raises(SourceError, match=r"row 2.*gap.*no_lead"):
        table(gaps)


def test_a_zero_that_stands_far_below_all_others_is_refused_and_one_among_small_gaps_is_a_gap(table: Table) -> None:
    """A range finder that met nothing writes 0."""
    with pytest.raises(SourceError, match=r"row 2 and 1 more rows: the gap 'gap' is 0.*no_lead"):
        table(marked("0", 1, 3))
    assert len(table(marked("0", 1))) == PICTURES


@pytest.mark.parametrize("gap", ["99", "85.5", "120", "1000"])
def test_an_ordinary_far_gap_is_taken(table: Table, gap: str) -> None:
    """It has neighbours, or is no number that people use for a mark."""
    assert table(marked(gap, 1)).frames[1].truth["gap"] == float(gap)


@pytest.mark.parametrize(
    ("mark", "declared"),
    [("-1", "-1"), ("-1.0", "-1"), ("999", "999"), ("inf", "inf"), ("Infinity", "inf"), ("N/A", "n/a"), ("nan", "NaN")],
)
def test_a_declared_mark_is_nothing_ahead_and_is_counted(table: Table, mark: str, declared: str) -> None:
    """The gap of these frames is unknown as if the cell were empty, and the bank says how many there were."""
    bank = table(marked(mark, 1, 3), numerals=importing.Numerals(no_lead=("none", declared)))
    assert [frame.truth["gap"] for frame in bank][:4] == [5.0, None, 12.5, None]
    assert bank.manifest.settings["no_lead"] == {"none": 0, declared: 2}
    assert f"2 rows of {declared}" in " ".join(taken(bank))


def test_where_every_number_is_declared_a_distance_none_is_taken_for_a_mark(table: Table) -> None:
    """An empty declaration; below zero there is still no distance."""
    every = importing.Numerals(no_lead=())
    assert table(marked("999", 1), numerals=every).frames[1].truth["gap"] == 999.0


def test_below_zero_is_refused_also_where_other_marks_are_declared(table: Table) -> None:
    """A mark that was forgotten is no distance."""
    with pytest.raises(SourceError, match="below 0"):
        table(marked("-2", 1), numerals=importing.Numerals(no_lead=("-1",)))


def test_a_picture_at_a_distance_below_zero_is_refused(table: Table) -> None:
    """The distances of pictures in which one thing was moved are distances too."""
    cells = ["", *["-1"] * 3, *["4"] * 8]
    with pytest.raises(SourceError, match="'lead_mid_near_m' is -1"):
        table(extra={"lead_mid_near_m": cells})


@pytest.mark.parametrize(
    ("column", "unit", "named"),
    [
        ("distance_cm", "m", "cm"),
        ("gap_ft", "m", "ft"),
        ("lidar (cm)", "m", "cm"),
        ("range [km]", "m", "km"),
        ("distanceFeet", "m", "ft"),
        ("gap.mm", "cm", "mm"),
        ("lead_gap_meters", "ft", "m"),
    ],
)
def test_a_unit_in_a_columns_name_that_contradicts_the_given_one_is_refused(
    table: Table, column: str, unit: str, named: str
) -> None:
    """Distances in centimetres that are taken for metres move every threshold."""
    with pytest.raises(SourceError, match=f"{unit}.*says {named}"):
        table(column=column, unit=unit)


@pytest.mark.parametrize(("column", "unit"), [("gap_m", "metres"), ("gap_ft", "feet"), ("gap_m", None), ("gap", "m")])
def test_a_unit_of_two_names_is_no_contradiction(table: Table, column: str, unit: str | None) -> None:
    """And where none is given, the column's own is taken."""
    bank = table(column=column, unit=unit)
    assert bank.manifest.gap is not None
    assert bank.manifest.gap.unit == (unit or "m")


def test_a_name_of_one_word_is_no_unit() -> None:
    """Nor is the end of a word."""
    assert [
        importing.numerals.unit_of(name) for name in ("m", "gap", "km", "team", "gap_team", "gap_m2", "distance")
    ] == [None] * 7


@pytest.mark.parametrize(
    ("style", "cells"),
    [
        ("1234,5", ("5,25", "1234,5")),
        ("1.234,5", ("5,25", "1.234,5")),
        ("1 234,5", ("5,25", "1\u00a0234,5")),
        ("1'234.5", ("5.25", "1'234.5")),
        ("1,234.5", ("5.25", "1,234.5")),
    ],
)
def test_numbers_are_read_as_they_are_declared_to_be_written(table: Table, style: str, cells: tuple[str, str]) -> None:
    """Of the gap, and of every other column of numbers; words and files stay as they are."""
    speeds = [cells[0]] * PICTURES
    gaps = (*cells, *(str(gap).replace(".", style[-2]) for gap in GAPS[2:]))
    bank = table(
        gaps,
        delimiter=";",
        numerals=importing.Numerals(style),
        extra={"speed": speeds, "note": ["1.2.3, 4"] * PICTURES},
    )
    assert [frame.truth["gap"] for frame in bank][:3] == [5.25, 1234.5, 12.5]
    assert bank.frames[0].truth["speed"] == 5.25
    assert bank.frames[0].truth["note"] == "1.2.3, 4"
    assert bank.frames[0].id == "0.png"


@pytest.mark.parametrize(
    ("style", "cell"), [("1.234,5", "12.4"), ("1234,5", "12.4"), ("1,234.5", "12,4"), ("1.234,5", "1.23")]
)
def test_a_number_that_is_written_otherwise_than_declared_is_refused(table: Table, style: str, cell: str) -> None:
    """12.4 is not 124, whatever the sign between thousands is."""
    gaps = (cell, *(str(gap).replace(".", style[-2]) for gap in GAPS[1:]))
    with pytest.raises(SourceError, match=r"row 1.*gap.*not a number"):
        table(gaps, delimiter=";", numerals=importing.Numerals(style))


@pytest.mark.parametrize("gaps", [("950", "1.110", "2.500"), ("1.110", "2.345", "12.000"), ("1.110 m", "900 m")])
def test_a_point_that_may_stand_between_thousands_is_asked_about(table: Table, gaps: tuple[str, ...]) -> None:
    """1.110 is 1.11 or 1110, and each is read once it is declared."""
    cells = tuple(gaps[number % len(gaps)] for number in range(PICTURES))
    number = gaps.index(next(gap for gap in gaps if gap.startswith("1.110")))
    with pytest.raises(SourceError, match=rf"row {number + 1}: 'gap' is '1.110', which is 1.11 or 1110.*1234.5 or"):
        table(cells)
    for style, gap in (("1234.5", 1.11), ("1.234,5", 1110.0)):
        bank = table(cells, numerals=importing.Numerals(style, no_lead=()))
        assert bank.frames[number].truth["gap"] == gap
        shutil.rmtree(bank.root)


@pytest.mark.parametrize(
    ("gaps", "extra"),
    [
        (("1.110", "0.500", "12.345"), None),
        (("1.110", "12.34", "5.250"), None),
        (("1.110", "5", "7"), {"speed": ["3.25"] * PICTURES}),
        (("1.110", "1234.500", "5.250"), None),
        (("1.1e0", "5", "7"), None),
        (("5", "30", "12"), {"clock": ["1.700"] * PICTURES}),
    ],
)
def test_a_point_that_another_number_explains_is_a_point(
    table: Table, gaps: tuple[str, ...], extra: dict[str, list[str]] | None
) -> None:
    """A fraction of another length, a number below one or above a thousand, anywhere in the table."""
    bank = table(tuple(gaps[number % len(gaps)] for number in range(PICTURES)), extra=extra)
    assert bank.frames[0].truth["gap"] in {1.11, 1.1, 5.0}


def test_a_way_to_write_numbers_that_is_unknown_is_refused() -> None:
    """With those that are known."""
    with pytest.raises(SpecError, match=r"1\.234,5"):
        importing.Numerals("1_234")


def test_a_number_with_its_unit_is_read_where_the_unit_is_declared(table: Table) -> None:
    """In short or in words; another unit in one row is refused."""
    assert table(tuple(f"{gap} m" for gap in GAPS)).frames[0].truth["gap"] == 5.0


@pytest.mark.parametrize("cell", ["5 cm", "5ft", "5 km"])
def test_another_unit_behind_one_number_is_refused(table: Table, cell: str) -> None:
    """5 cm among metres is not 5 m."""
    with pytest.raises(SourceError, match=r"row 1.*the gap is in m"):
        table((cell, *GAPS[1:]))


def test_a_column_that_was_guessed_is_named_with_its_price(table: Table) -> None:
    """Six drives in three places: distance can be tested over all, and not within each."""
    places = [f"place {number // 4}" for number in range(PICTURES)]
    bank = table(extra={"location": places})
    assert bank.manifest.settings["guessed"] == {"scenario": "location"}
    assert "guessed by their names: scenario from 'location'" in " ".join(taken(bank))
    (price,) = [line for line in costs(bank) if "guessed" in line]
    assert "3 scenarios of 2 episodes each" in price
    assert "8 ways, too few to test distance" in price
    assert "'scenario': ''" in price


def test_a_column_without_a_place_is_named(table: Table) -> None:
    """As one in another language, which no list of usual names has."""
    bank = table(column="Abstand", extra={"Wetter": ["rain"] * PICTURES}, columns={}, threshold=None, unit="")
    (line,) = [one for one in taken(bank) if "without a place" in one]
    assert line.endswith(": Abstand, Wetter; --map gap=COLUMN names the distance ahead")


def test_a_stratum_has_its_place(table: Table) -> None:
    """What a claim is tested within is read."""
    bank = table(extra={"Abstand": GAPS, "Wetter": ["rain"] * PICTURES}, strata=("Wetter",))
    (line,) = [one for one in taken(bank) if "without a place" in one]
    assert line == "columns without a place, kept as ground truth: Abstand; --map PLACE=COLUMN gives one a place"


def test_a_column_that_was_given_is_not_called_guessed(table: Table) -> None:
    """Neither by the manifest nor in words."""
    places = [f"place {number // 4}" for number in range(PICTURES)]
    bank = table(extra={"location": places}, columns={"gap": "gap", "scenario": "location"})
    assert "guessed" not in bank.manifest.settings
    assert not [line for line in (*costs(bank), *taken(bank)) if "guessed" in line]


@pytest.mark.parametrize("column", ["distance_m", "lidar_front", "LeadGap", "min range", "headway_s", "dist"])
def test_a_column_that_looks_like_the_distance_is_not_dropped_without_a_word(table: Table, column: str) -> None:
    """It is kept as ground truth, and the import says how it becomes the gap."""
    bank = table(column=column, columns={}, threshold=None, unit=None)
    assert bank.manifest.gap is None
    (line,) = [line for line in costs(bank) if "looks like the distance" in line]
    assert column in line
    assert "threshold" in line


@pytest.mark.parametrize("column", ["arrange", "distant", "orange", "speed", "gapless_mode", "place"])
def test_other_columns_do_not_look_like_a_distance(column: str) -> None:
    """A part of a word is no word."""
    assert not reading.is_distance(column)


def test_paths_of_another_machine_are_taken_without_what_they_begin_with(photos: Path, tmp_path: Path) -> None:
    """The refusal says which beginning would do; a row that begins otherwise is refused."""
    path = tmp_path / "table.csv"
    path.write_text("file\n" + "\n".join(f"/home/ann/rec7/{number}.png" for number in range(PICTURES)) + "\n")
    with pytest.raises(SourceError, match=r"strip.*/home/ann/rec7"):
        import_table(photos, path, tmp_path / "bank", Choices())
    bank = import_table(photos, path, tmp_path / "bank", Choices(strip="/home/ann/rec7/"))
    assert [frame.id for frame in bank][:2] == ["0.png", "1.png"]
    path.write_text("file\n/home/ben/0.png\n")
    with pytest.raises(SourceError, match="does not begin with"):
        import_table(photos, path, tmp_path / "other", Choices(strip="/home/ann"))


@pytest.mark.parametrize(("brand", "kind"), [(b"heic", "HEIC"), (b"mif1", "HEIC"), (b"avif", "AVIF")])
def test_a_photograph_of_a_telephone_is_named_by_its_format(tmp_path: Path, brand: bytes, kind: str) -> None:
    """With a way to convert it."""
    (tmp_path / "a.png").write_bytes(b"\0\0\0\x18ftyp" + brand + b"\0" * 64)
    (tmp_path / "table.csv").write_text("file\na.png\n")
    with pytest.raises(SourceError, match=f"format {kind}.*PNG or JPEG"):
        import_table(tmp_path, tmp_path / "table.csv", tmp_path / "bank", Choices())


def test_a_step_in_nanoseconds_is_called_too_large(table: Table) -> None:
    """It is a whole number; what is wrong is its size."""
    steps = [str(1_700_000_000_123_456_789 + number) for number in range(PICTURES)]
    with pytest.raises(SourceError, match=r"too large for a step.*step"):
        table(extra={"step": steps})


def test_the_command_takes_marks_numbers_and_paths(
    photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As one would write them; the wrong way to write numbers is one line."""
    path = tmp_path / "table.csv"
    rows = [f"C:/rec/{number}.png;{str(gap).replace('.', ',')};e{number}" for number, gap in enumerate(GAPS)]
    path.write_text("\n".join(["file;gap;episode", *rows[:-1], "C:/rec/11.png;-1;e11"]) + "\n")
    words = ["frames", "import", str(photos), "--table", str(path), "--threshold", "18", "--unit", "m"]
    words += ["--strip", "C:/rec", "--no-lead", "-1,inf", "--numbers"]
    for style, code in (("1.2.3", 2), ("1234,5", 0)):
        monkeypatch.setattr("sys.argv", ["eyechart", *words, style, "--out", str(tmp_path / "bank")])
        with pytest.raises(SystemExit) as left:
            cli.main()
        assert left.value.code == code
    assert "1 rows of -1" in capsys.readouterr().err
    assert [frame.truth["gap"] for frame in open_bank(tmp_path / "bank")][-2:] == [14.0, None]


@pytest.mark.parametrize(
    ("column", "unit"),
    [
        ("gap_cm_lidar", "cm"),
        ("dist_ft_fused", "ft"),
        ("cm_gap", "cm"),
        ("gapCmLeft", "cm"),
        ("gap (mm) raw", "mm"),
        ("gap_meters_left", "m"),
        ("gap_m", "m"),
        ("range_m_max", None),
        ("gap_to_m_lane", None),
        ("distance_second_car", None),
        ("distance_foot_path", None),
        ("gap_to_yard", "yd"),
        ("yard_gap_left", None),
        ("gap_in_lane", None),
        ("driver_s_gap", None),
        ("gap_m2_left", None),
        ("gap_ft_to_m", "m"),
    ],
)
def test_a_unit_within_a_column_s_name_is_its_unit(table: Table, column: str, unit: str | None) -> None:
    """A word that is as often something else is none; what stands at the end comes first."""
    assert importing.numerals.unit_of(column) == unit
    other = "m" if unit != "m" else "cm"
    if unit:
        with pytest.raises(SourceError, match=f"says {unit}"):
            table(column=column, unit=other)
    else:
        assert len(table(column=column, unit=other)) == PICTURES


MOVED = ["lead_drawn_m", "exchange_m", "lead_mid_near_m"]


@pytest.mark.parametrize("column", MOVED)
@pytest.mark.parametrize(
    ("cells", "wrong"),
    [
        (["7.5 px"], r"row 1: '{}' is '7.5 px', which cannot be converted to the gap's m"),
        (["7.5", "near"], r"row 2: '{}' is 'near', not a number; leave the cell empty if there is none(?!, or)"),
        (["7.5", "7,5"], r"row 2: '{}' is '7,5', not a number; a decimal comma is read with numbers=1234,5"),
        (["7.5", "-1"], r"row 2: '{}' is -1, and no distance is below 0; leave the cell empty"),
    ],
)
def test_distances_of_what_was_moved_are_read_as_the_gap_is(
    table: Table, column: str, cells: list[str], wrong: str
) -> None:
    """By their row, and not as words where one of them is none."""
    with pytest.raises(SourceError, match=wrong.format(column)):
        table(extra={column: [cells[number % len(cells)] for number in range(PICTURES)]})


def test_distances_of_what_was_moved_have_units_and_no_marks(table: Table) -> None:
    """And are asked about where they may be a thousand times as large; the import says in what unit they are."""
    bank = table(
        extra={
            "lead_drawn_m": ["7.5 m", "N/A", "", "250 cm"] * 3,
            "lead_far_m": [100] * PICTURES,
            "lead_near_m": [0, 0, 40.0] * 4,
        },
        numerals=importing.Numerals(no_lead=("100",)),
    )
    assert [frame.truth.get("lead_drawn_m") for frame in bank][:4] == [7.5, None, None, 2.5]
    assert {frame.truth["lead_far_m"] for frame in bank} == {100}
    assert bank.manifest.settings["no_lead"] == {"100": 0}
    shutil.rmtree(bank.root)
    bank = table(extra={"lead_far_m": [99] * PICTURES, "lead_near_m": [0, 0, 40.0] * 4})
    assert len(bank) == PICTURES
    shutil.rmtree(bank.root)
    bank = table(unit="ft", extra={"lead_far_m": ["3.048 m"] * PICTURES})
    assert [frame.truth["lead_far_m"] for frame in bank] == pytest.approx([10.0] * PICTURES)
    shutil.rmtree(bank.root)
    whole = tuple(int(gap) + 20 for gap in GAPS)
    with pytest.raises(SourceError, match=r"'lead_drawn_m' is '1\.110', which is 1\.11 or 1110"):
        table(whole, extra={"lead_drawn_m": ["1.110"] * PICTURES})
    other = table(column="gap_cm", unit=None, extra={"lead_drawn_m": [7.5] * PICTURES})
    assert "lead_drawn_m: read in cm, like the gap" in costs(other)


def test_what_could_be_the_distance_too_is_named_where_one_was_guessed(table: Table) -> None:
    """The first of the usual names is taken."""
    bank = table(column="distance_m", columns={}, unit=None, extra={"range_m": [9.5] * PICTURES})
    assert [line for line in costs(bank) if "and so could be range_m" in line]
