"""Pictures of one's own become a bank and a verdict, or one clear line and nothing at all."""

import json
import sys
import tracemalloc
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import photographs
from eyechart import cli
from eyechart.errors import EyechartError, SourceError, SpecError
from eyechart.frames import FrameBank, check, open_bank
from eyechart.importing import Choices, costs, import_lerobot, import_table, parquet, read_rig, tables
from eyechart.importing import bank as making
from eyechart.models import ADAPTERS
from eyechart.run import Plan
from eyechart.spaces.discrete import DRIVING, read_space
from eyechart.studies import battery
from eyechart.verdicts import Verdict, judge

PLACES = {"file": "photo", "episode": "drive", "step": "tick", "scenario": "place", "gap": "lidar_m"}
WHOLE = Choices(columns=PLACES, mirror="horizontal", threshold=18.0, unit="m", picture="forward camera of a rover")

Import = Callable[..., FrameBank]


@pytest.fixture(autouse=True)
def _drivers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make ``driver:looks`` and ``driver:listens`` SPECs for one test."""
    monkeypatch.setitem(ADAPTERS, "driver", "photographs")


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of 64 photographs that no test changes."""
    folder = tmp_path_factory.mktemp("photos")
    photographs.take(folder, photographs.rows())
    return folder


@pytest.fixture
def imported(photos: Path, tmp_path: Path) -> Import:
    """Return a function that imports the photographs with a table's text; ``changes`` are to the choices."""

    def run(text: str | bytes, *, ending: str = ".csv", folder: Path = photos, **changes: object) -> FrameBank:
        table = tmp_path / f"table{ending}"
        table.write_bytes(text if isinstance(text, bytes) else text.encode())
        return import_table(folder, table, tmp_path / "bank", replace(WHOLE, **changes))  # type: ignore[arg-type]

    return run


def verdict_of(bank: FrameBank, out: Path, spec: str = "driver:looks", **options: object) -> Verdict:
    """Run a battery with the bank's own default conditions, and judge it."""
    battery.run(battery.plan(bank.root, [spec], out, **options))  # type: ignore[arg-type]
    return judge(battery.score(out, resamples=500))[spec]


def eyechart(monkeypatch: pytest.MonkeyPatch, *words: object) -> object:
    """Run the command line; return its exit code."""
    monkeypatch.setattr(sys, "argv", ["eyechart", *map(str, words)])
    with pytest.raises(SystemExit) as left:
        cli.main()
    return left.value.code


@pytest.mark.slow
@pytest.mark.parametrize("episodes", [True, False])
def test_from_a_folder_of_photographs_to_the_verdict_depth(
    *, photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], episodes: bool
) -> None:
    """A custom action space, a CSV, the command line, a model that reads pixels; episodes or not."""
    (tmp_path / "rover.toml").write_text(photographs.SPACE)
    without = () if episodes else ("drive", "tick")
    (tmp_path / "t.csv").write_text(photographs.as_csv(photographs.rows(), without=without))
    mapped = [
        word for place, column in PLACES.items() if column not in without for word in ("--map", f"{place}={column}")
    ]
    words = ["frames", "import", photos, "--table", tmp_path / "t.csv", *mapped, "--threshold", 18, "--unit", "m"]
    words += ["--mirror", "horizontal", "--actions", tmp_path / "rover.toml", "--out", tmp_path / "bank"]
    assert eyechart(monkeypatch, *words, *([] if episodes else ["--independent"])) == 0
    assert "64 frames in" in capsys.readouterr().err
    words = ["run", "battery", "--model", "driver:looks", "--frames", tmp_path / "bank", "--out", tmp_path / "run"]
    assert eyechart(monkeypatch, *words) == 0
    capsys.readouterr()
    assert eyechart(monkeypatch, "verdict", tmp_path / "run", "--json") == 0
    verdict = json.loads(capsys.readouterr().out)["models"]["driver:looks"]
    assert (verdict["calibrated"], verdict["evidence"]) == ("depth_associated", "observational")
    assert ("8 episodes" if episodes else "declared independent") in verdict["scope"]
    assert check(tmp_path / "bank") == []


def test_a_bank_holds_the_very_bytes_the_ground_truth_and_the_places(imported: Import, photos: Path) -> None:
    """Nothing is encoded anew; an empty gap is no lead; other columns are kept, numbers as numbers."""
    table = photographs.rows()
    bank = imported(photographs.as_csv(table))
    assert len(bank) == len(table)
    for frame, row in zip(bank, table, strict=True):
        assert bank.image(frame) == (photos / str(row["photo"])).read_bytes()
        assert dict(frame.truth) == {"lidar_m": row["lidar_m"], "speed": row["speed"]}
        assert (frame.episode, frame.scenario, frame.step) == (str(row["drive"]), row["place"], row["tick"])
        assert frame.mirror_axis == "horizontal"
    assert any(frame.truth["lidar_m"] is None for frame in bank)
    assert bank.manifest.gap is not None
    assert (bank.manifest.gap.column, bank.manifest.gap.threshold, bank.manifest.gap.unit) == ("lidar_m", 18.0, "m")
    assert bank.manifest.absent == ()
    assert costs(bank) == []


def encodings() -> dict[str, bytes]:
    """Return one table in the shapes in which tables come."""
    table = photographs.rows()
    quoted = photographs.as_csv(table).replace("yard", '"yard"')
    lines = "".join(json.dumps({**row, "drive": str(row["drive"])}) + "\n" for row in table)
    return {
        "bom.csv": b"\xef\xbb\xbf" + photographs.as_csv(table).encode(),
        "crlf.csv": photographs.as_csv(table, end="\r\n").encode(),
        "quoted.csv": quoted.encode(),
        "utf16.csv": photographs.as_csv(table).encode("utf-16"),
        "utf16le.csv": photographs.as_csv(table).encode("utf-16-le"),
        "utf32.csv": photographs.as_csv(table).encode("utf-32"),
        "semicolon.csv": photographs.as_csv(table, delimiter=";").encode(),
        "tab.tsv": photographs.as_csv(table, delimiter="\t").encode(),
        "blank-lines.csv": photographs.as_csv(table, end="\n\n").encode(),
        "lines.jsonl": lines.encode(),
    }


@pytest.mark.parametrize("shape", encodings())
def test_a_table_is_read_in_whatever_shape_it_comes(imported: Import, tmp_path: Path, shape: str) -> None:
    """Byte order marks, line ends, quotes, delimiters and JSON lines: one geometry."""
    plain = imported(photographs.as_csv(photographs.rows()))
    (tmp_path / "bank").rename(tmp_path / "plain")
    bank = imported(encodings()[shape], ending=Path(shape).suffix)
    assert bank.manifest.fingerprint == plain.manifest.fingerprint


def spoilt(column: str, value: object, row: int = 4) -> str:
    """Return the table's text with one cell changed; rows count from 1."""
    table = [dict(one) for one in photographs.rows()]
    table[row - 1][column] = value
    return photographs.as_csv(table)


@pytest.mark.parametrize(
    ("text", "changes", "said"),
    [
        ("", {}, "is empty"),
        ("photo,drive,place,tick,lidar_m\n", {}, "has no rows"),
        (spoilt("lidar_m", "near"), {}, "row 4: the gap 'lidar_m' is 'near', not a number"),
        (spoilt("lidar_m", "nan"), {}, "row 4: the gap 'lidar_m' is 'nan', not a number"),
        (spoilt("lidar_m", "1e999"), {}, "row 4: the gap 'lidar_m' is '1e999', not a number"),
        (spoilt("lidar_m", "1e35"), {}, "row 4: the gap 'lidar_m' is 1e+35, not a number up to 1e+30"),
        (spoilt("lidar_m", "-1e40"), {}, "row 4: the gap 'lidar_m' is -1e+40, not a number up to 1e+30"),
        (spoilt("photo", "0/00.jpg"), {}, "row 4: '0/00.jpg' is already in row 1"),
        (spoilt("photo", "./0/00.jpg"), {}, "row 4: '0/00.jpg' is already in row 1"),
        (spoilt("photo", "../secret.png"), {}, "row 4: the file 'photo' is '../secret.png', which leads outside"),
        (spoilt("photo", "/etc/passwd"), {}, "leads outside"),
        (spoilt("photo", "0/none.jpg"), {}, "row 4: there is no picture '0/none.jpg'"),
        (spoilt("photo", ""), {}, "row 4: the file 'photo' is empty"),
        (spoilt("tick", "2.5"), {}, "row 4: the step 'tick' is '2.5', not a whole number"),
        (spoilt("tick", ""), {}, "row 4: the step 'tick' is empty, not a whole number"),
        (spoilt("tick", "x"), {}, "every row needs one; else leave the column out with columns={'step': ''}"),
        (spoilt("tick", 0), {}, "row 4: step 0 of episode '0' occurs twice"),
        (spoilt("drive", ""), {}, "row 4: the episode 'drive' is empty"),
        (spoilt("speed", ""), {"prompt_columns": ("speed",)}, "row 4: 'speed' is empty; a prompt column needs"),
        (spoilt("speed", "x" * 100_001), {}, "row 4: 'speed' has more than 100000 characters"),
        (spoilt("speed", "x" * 200_000), {}, "row 4: field larger than field limit"),
        (spoilt("speed", '"'), {}, None),
        (
            photographs.as_csv(photographs.rows()) + '1.jpg,9,yard,0,3,"slow\n2.jpg,9,yard,1,3,4\n',
            {},
            "quote not closed?",
        ),
        (photographs.as_csv(photographs.rows()) + '1.jpg,"9"9,yard,0,3,4\n', {}, "row 65: ',' expected after '\"'"),
        (spoilt("photo", "x" * 5000), {}, "…', 5000 characters, which is no file's name"),
        (spoilt("photo", "0/\0.jpg"), {}, "which is no file there: embedded null"),
        (
            photographs.as_csv(photographs.rows()).replace(".50 km/h", ",5", 1),
            {},
            "cells; the header has 6",
        ),
        ("photo,photo\n", {}, "has two columns 'photo'"),
        ("x" * 4_000_001, {}, "line 1 is longer than 4000000 characters"),
        (b"photo,lidar_m\n\xff\xfe\xfd,3\n", {}, "is no utf-8 text after line"),
        (photographs.as_csv(photographs.rows()), {"columns": {**PLACES, "gap": "lidar"}}, "did you mean 'lidar_m'"),
        (
            photographs.as_csv(photographs.rows(), without=["photo"]),
            {"columns": {"gap": "lidar_m"}},
            "no column 'file'",
        ),
        (photographs.as_csv(photographs.rows()), {"columns": {**PLACES, "speed": "x"}}, "there is no place 'speed'"),
        (
            photographs.as_csv(photographs.rows()),
            {"columns": {**PLACES, "gap": "tick"}},
            "'tick' cannot be gap and step at once",
        ),
        (photographs.as_csv(photographs.rows()), {"threshold": None}, "needs a limit of near"),
        (photographs.as_csv(photographs.rows()), {"columns": {**PLACES, "gap": ""}}, "threshold belongs to a gap"),
        (photographs.as_csv(photographs.rows()), {"independent": True}, "the frames of an episode are not independent"),
        (photographs.as_csv(photographs.rows()), {"prompt_columns": ("lidar_m",)}, "it is the gap of a frame"),
        (photographs.as_csv(photographs.rows()), {"prompt_columns": ("velocity",)}, "has no column 'velocity'"),
        (photographs.as_csv([{**row, "lidar_m": None} for row in photographs.rows()]), {}, "is empty in every row"),
    ],
)
def test_what_is_wrong_with_a_table_is_one_line_and_leaves_nothing(
    imported: Import, tmp_path: Path, text: str | bytes, changes: dict[str, object], said: str | None
) -> None:
    """The line names the row, the column and the value; a quoted quote is no fault."""
    if said is None:
        assert len(imported(text, **changes)) == 64
        return
    with pytest.raises(SourceError) as refused:
        imported(text, **changes)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)
    assert [path.name for path in tmp_path.iterdir()] == ["table.csv"]


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        (
            '{"photo": "0/00.jpg"}\n{"photo": "0/01.jpg", "new": 1}\n',
            "row 2 has a column 'new' that the first row does not have",
        ),
        ('{"photo": "0/00.jpg"}\n[1]\n', "row 2 is a list, no JSON object"),
        ('{"photo": "0/00.jpg"\n', "row 1 is no JSON object"),
        ('{"photo": ["0/00.jpg"]}\n', "row 1: 'photo' is a list, not a plain value"),
        ("[" * 100_000, "row 1 is no JSON object"),
        ("\n\n", "is empty"),
        ('{"photo": "\\ud800.jpg"}\n', "row 1 is no JSON object"),
        ('{"photo": "0/00.jpg", "photo": "0/01.jpg"}\n', "row 1 is no JSON object: it has 'photo' twice"),
        ('{"photo": "0/00.jpg", "lidar_m": 1' + "0" * 400 + "}\n", "row 1: the gap 'lidar_m' is 1000000"),
        ('{"photo": "0/00.jpg", "lidar_m": NaN}\n', "row 1: the gap 'lidar_m' is nan, not a number"),
    ],
)
def test_what_is_wrong_with_json_lines_is_one_line(imported: Import, lines: str, said: str) -> None:
    """Nested values, other columns and broken lines are refused by row."""
    places = {place: column if column in lines else "" for place, column in PLACES.items()}
    threshold = 18.0 if places["gap"] else None
    with pytest.raises(SourceError, match=r"table\.jsonl") as refused:
        imported(lines, ending=".jsonl", columns=places, threshold=threshold)
    assert said in str(refused.value)


def test_a_delimiter_inside_quotes_parts_no_columns(imported: Import) -> None:
    """A header may hold more commas in a name than semicolons between names."""
    text = photographs.as_csv(photographs.rows(), delimiter=";").replace(
        "speed", '"speed, as read, told, or so, or so, or"', 1
    )
    assert "speed, as read, told, or so, or so, or" in imported(text).frames[0].truth


def odd_pictures(folder: Path) -> dict[str, str]:
    """Write pictures that no bank takes; return what is said of each."""
    pixels = Image.fromarray(photographs.draw(9.0))
    pixels.save(folder / "whole.png")
    (folder / "torn.png").write_bytes((folder / "whole.png").read_bytes()[:90])
    (folder / "text.jpg").write_text("no picture")
    (folder / "folder.png").mkdir()
    pixels.save(folder / "bitmap.bmp")
    turned = Image.Exif()
    turned[0x0112] = 6
    pixels.save(folder / "turned.jpg", exif=turned)
    Image.fromarray(np.zeros((4, 4), dtype=np.uint16)).save(folder / "deep.png")
    pixels.save(folder / "film.webp", save_all=True, append_images=[Image.fromarray(photographs.draw(50.0))])
    Image.new("1", (6000, 6000)).save(folder / "vast.png")
    (folder / "link.png").symlink_to("/etc/hostname")
    return {
        "torn.png": "damaged or no picture",
        "text.jpg": "damaged or no picture of PNG, JPEG, WEBP",
        "folder.png": "there is no picture",
        "bitmap.bmp": "damaged or no picture of PNG, JPEG, WEBP",
        "turned.jpg": "EXIF orientation 6",
        "deep.png": "more than 8 bits a channel",
        "film.webp": "holds 2 pictures",
        "vast.png": "the limit is 25 megapixels",
        "link.png": "leads outside",
    }


def test_a_picture_in_which_models_could_see_different_things_is_refused(imported: Import, tmp_path: Path) -> None:
    """Torn, too large, of another kind, turned by a note, moving: by row and name, and nothing stays."""
    folder = tmp_path / "odd"
    folder.mkdir()
    for name, said in odd_pictures(folder).items():
        with pytest.raises(SourceError, match=f"row 2.*{name}") as refused:
            imported(f"file\nwhole.png\n{name}\n", folder=folder, columns={}, threshold=None)
        assert said in str(refused.value)
        assert sorted(path.name for path in tmp_path.iterdir()) == ["odd", "table.csv"]


def test_windows_paths_and_paths_inside_the_folder_are_understood(imported: Import, photos: Path) -> None:
    """A table written elsewhere, or with whole paths, names the same pictures."""
    bank = imported(f"file\n0\\00.jpg\n{photos.resolve()}/0/01.jpg\n", columns={}, threshold=None)
    assert [frame.id for frame in bank] == ["0/00.jpg", "0/01.jpg"]


LESS: dict[str, tuple[Sequence[str], dict[str, object], str, str, str]] = {
    "gap": (["lidar_m"], {"threshold": None}, "depth_observational", "the bank records no gap", "no gap"),
    "scenario": (["place"], {}, "scene_cue", "no frame has all three decisions", "no scenarios"),
    "mirror": ([], {"mirror": "none"}, "mirror_swap_rate", "no frame of the bank has a mirror axis", "no mirror axis"),
    "episode": (["drive", "tick"], {}, "depth_observational", "the bank records no episodes", "no episodes"),
}


@pytest.mark.slow
@pytest.mark.parametrize("missing", LESS)
def test_a_missing_column_costs_its_own_tests_by_name_and_the_battery_still_runs(
    imported: Import, tmp_path: Path, missing: str
) -> None:
    """The test that needs the column cannot say, and why; the import says so, and a verdict comes all the same."""
    gone, changes, statistic, why, said = LESS[missing]
    places = {place: column for place, column in PLACES.items() if column not in gone}
    bank = imported(photographs.as_csv(photographs.rows(), without=gone), columns=places, space=space(), **changes)
    assert any(line.startswith(said) for line in costs(bank))
    verdict = verdict_of(bank, tmp_path / "run")
    statistics = battery.score(tmp_path / "run", resamples=500).models["driver:looks"].statistics
    assert (statistics[statistic].value, statistics[statistic].p) == (None, None)
    assert why in statistics[statistic].note
    assert verdict.calibrated.label == {"gap": "content", "episode": "content"}.get(missing, "depth_associated")
    if missing == "mirror":
        assert verdict.lateral.label == "not_tested"
    if missing == "scenario":
        assert any("another scenario changes its answer was not tested" in note for note in verdict.notes)
        with pytest.raises(EyechartError, match="'cross_scenario' cannot be shown"):
            battery.plan(bank.root, ["driver:looks"], tmp_path / "other", conditions=["real", "cross_scenario"])
    if missing == "episode":
        assert "no episodes recorded" in verdict.scope
        gap_tests = [
            one for name, one in statistics.items() if name.startswith(("obstacle", "mutual_information", "gap_order"))
        ]
        assert len(gap_tests) == 5
        assert all(gap_test.p is None and gap_test.value is None for gap_test in gap_tests)
        declared = battery.score(tmp_path / "run", resamples=500, independent=True)
        assert judge(declared)["driver:looks"].calibrated.label == "depth_associated"


def space() -> object:
    """Return the rover's action space."""
    return making.Discrete(
        "rover", ("HALT", "CRAWL", "GO", "PORT", "STARBOARD"), (("PORT", "STARBOARD"),), ("HALT", "CRAWL"), ("GO",)
    )


def long_table(path: Path, rows: int) -> Path:
    """Write a CSV of so many rows."""
    with path.open("w") as file:
        file.write("file,drive\n")
        file.writelines(f"{number}.jpg,1\n" for number in range(rows))
    return path


def test_padded_numbers_are_numbers_where_a_number_is_asked_for(imported: Import) -> None:
    """Steps and gaps may be padded with zeros, as recorders write them; a column of names keeps its zeros."""
    rows = photographs.rows()
    padded = [
        {
            **row,
            "tick": f"{row['tick']:03}",
            "lidar_m": f"0{row['lidar_m']}" if row["lidar_m"] else "",
            "tag": f"{n:03}",
        }
        for n, row in enumerate(rows)
    ]
    bank = imported(photographs.as_csv(padded))
    assert [frame.step for frame in bank] == [row["tick"] for row in rows]
    assert [frame.truth["lidar_m"] for frame in bank] == [row["lidar_m"] or None for row in rows]
    assert [frame.truth["tag"] for frame in bank][:2] == ["000", "001"]


@pytest.mark.slow
def test_a_table_of_a_million_rows_is_streamed_every_so_many(tmp_path: Path) -> None:
    """Rows that become no frames are not kept, and progress is told meanwhile."""
    table, read = long_table(tmp_path / "long.csv", 1_000_000), []
    opened = tables.open_table(table, lambda done, total: read.append((done, total)))
    kept = making.keep(opened, Choices(columns={"episode": "drive"}, every=50_000))
    assert kept.numbers == list(range(1, 1_000_001, 50_000))
    assert len(read) == 200
    assert all(0 < done <= total == table.stat().st_size for done, total in read)


def test_a_long_table_takes_bounded_memory_and_without_every_the_line_says_what_to_do(
    tmp_path: Path, photos: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before a single picture is looked for."""
    table = long_table(tmp_path / "long.csv", 30_000)
    tracemalloc.start()
    making.keep(tables.open_table(table), Choices(columns={"episode": "drive"}, every=5000))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 1_000_000
    monkeypatch.setattr(making, "MOST_FRAMES", 1000)
    with pytest.raises(SourceError, match="more than 1000 frames; take every Nth of them with every=N"):
        import_table(photos, table, tmp_path / "bank", Choices())
    assert not (tmp_path / "bank").exists()


def test_without_its_extra_an_adapter_names_the_extra(
    tmp_path: Path, photos: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One line, not a traceback."""
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    (tmp_path / "t.parquet").write_bytes(b"PAR1")
    with pytest.raises(SourceError, match=r"pip install 'eyechart\[parquet\]'"):
        import_table(photos, tmp_path / "t.parquet", tmp_path / "bank", Choices())
    with pytest.raises(SourceError, match=r"pip install 'eyechart\[lerobot\]'"):
        parquet.require("pyarrow", "pyarrow", "lerobot")
    with pytest.raises(SourceError, match=r"info\.json does not exist: is .* a LeRobotDataset"):
        import_lerobot(photos, tmp_path / "bank", Choices())


def test_steps_that_stand_twice_and_numbers_beyond_every_bank_are_named_beside_all_other_faults(
    photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """By their rows, where a step and an episode of other rows cannot be read; so are options that are wrong."""
    table = photographs.rows()[:12]
    table[1]["tick"], table[3]["drive"] = "x", ""
    table[5]["lidar_m"], table[6]["lidar_m"] = "1e35", "-1e40"
    table[8]["tick"] = table[7]["tick"] = 3
    table[8] |= {name: table[7][name] for name in ("drive", "place")}
    (tmp_path / "t.csv").write_text(photographs.as_csv(table))
    mapped = [word for place, column in PLACES.items() for word in ("--map", f"{place}={column}")]
    wrong = ["--mirror", "diagonal", "--actions", tmp_path / "none.toml", "--threshold", "1e308", "--unit", "m"]
    words = ["frames", "import", photos, "--table", tmp_path / "t.csv", "--out", tmp_path / "bank", *mapped, *wrong]
    assert eyechart(monkeypatch, *words) == 2
    said = " ".join(capsys.readouterr().err.split())
    for fault in (
        "--mirror takes vertical, horizontal or none, not 'diagonal'",
        "none.toml cannot be read",
        "--threshold must be a number up to 1e+30",
        "row 2: the step 'tick' is 'x'",
        "row 4: the episode 'drive' is empty",
        "row 6: the gap 'lidar_m' is 1e+35",
        "row 7: the gap 'lidar_m' is -1e+40",
        "row 9: step 3 of episode",
    ):
        assert fault in said, fault
    assert "t.csv has 8 faults" in said
    assert not (tmp_path / "bank").exists()


def test_ground_truth_that_no_bank_holds_is_named_by_every_row(imported: Import, photos: Path) -> None:
    """Of a table whose numbers are numbers, all of them."""
    rows = [{"photo": f"0/0{number}.jpg", "speed": speed} for number, speed in enumerate((1.5, 1e31, 2.0, -1e32))]
    lines = "".join(json.dumps(row) + "\n" for row in rows)
    with pytest.raises(SourceError) as refused:
        imported(lines, ending=".jsonl", folder=photos, columns={"file": "photo"}, threshold=None)
    assert "row 2: 'speed' is 1e+31, which no bank can hold" in str(refused.value)
    assert "row 4: 'speed' is -1e+32, which no bank can hold" in str(refused.value)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--table", "t.txt"], "is not a readable table; known endings are .csv"),
        (["--table", "none.csv"], "does not exist or is not a file"),
        ([], "give either --table FILE of the pictures or --format lerobot"),
        (["--format", "zip"], "--format takes table or lerobot"),
        (["--table", "t.csv", "--map", "gap"], "--map takes PLACE=COLUMN"),
        (["--table", "t.csv", "--mirror", "left"], "--mirror takes vertical, horizontal or none"),
        (["--table", "t.csv", "--actions", "none.toml"], "none.toml cannot be read"),
    ],
)
def test_a_wrong_word_on_the_command_line_is_one_line_and_exit_2(
    *,
    photos: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    said: str,
) -> None:
    """And nothing is written."""
    monkeypatch.chdir(tmp_path)
    assert eyechart(monkeypatch, "frames", "import", photos, "--out", "bank", *words) == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("actions = [", "is no TOML file"),
        ("name = 'x'", "no actions"),
        ("actions = ['A', 'B']\nsteer = 1", "an action space has no 'steer'"),
        ("actions = ['A', 'B']\n[answer]\nfields = []", "stands in the file of a prompt (--prompt FILE.toml)"),
        ("actions = ['A', 'B']\nbrake = ['C']", "brake names 'C'"),
        ("actions = ['A']", "needs two or more different actions"),
        ("actions = ['A', 'B']\nmirror_pairs = ['AB', 3]", "mirror_pairs"),
        ("# " + "x" * 1_000_001, "more than 1000000 bytes"),
    ],
)
def test_an_action_space_that_is_none_is_one_line(tmp_path: Path, text: str, said: str) -> None:
    """The line names the file and what is wrong in it."""
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(SpecError, match=r"a\.toml") as refused:
        read_space(tmp_path / "a.toml")
    assert said in str(refused.value)


def test_an_action_space_is_read_from_its_file(tmp_path: Path) -> None:
    """Its name is the file's where it gives none; roles may be left out."""
    (tmp_path / "rover.toml").write_text(photographs.SPACE)
    assert read_space(tmp_path / "rover.toml") == space()
    (tmp_path / "two.toml").write_text("actions = ['A', 'B']")
    assert read_space(tmp_path / "two.toml").as_dict() == {
        "name": "two",
        "actions": ["A", "B"],
        "mirror_pairs": [],
        "brake": [],
        "proceed": [],
    }


def test_a_bank_can_be_imported_again_from_its_own_metadata(imported: Import, tmp_path: Path) -> None:
    """Columns whose names a bank needs are left out, and the import says so."""
    bank = imported(photographs.as_csv(photographs.rows()))
    places = {"gap": "lidar_m"}
    again = import_table(bank.root, bank.root / "metadata.jsonl", tmp_path / "again", replace(WHOLE, columns=places))
    assert [dict(frame.truth) for frame in again] == [dict(frame.truth) for frame in bank]
    assert costs(again) == ["left out, because a bank needs these names: frame_id, mirror_axis"]


def test_a_bank_that_says_nothing_new_is_as_it_always_was(imported: Import) -> None:
    """Its manifest has no new key, and opens without one."""
    bank = imported(photographs.as_csv(photographs.rows()), space=DRIVING)
    assert not {"prompt_columns", "absent", "independent"} & bank.manifest.as_dict().keys()
    assert open_bank(bank.root).manifest.independent is False


def test_the_bank_declares_independence_so_that_scoring_needs_no_flag(imported: Import, tmp_path: Path) -> None:
    """What was said at import holds for every score and verdict."""
    text = photographs.as_csv(photographs.rows(), without=["drive", "tick"])
    bank = imported(text, columns={"file": "photo", "gap": "lidar_m"}, independent=True, space=space())
    assert bank.manifest.independent
    assert verdict_of(bank, tmp_path / "run").calibrated.label == "depth_associated"
    assert isinstance(battery.plan(bank.root, ["driver:looks"], tmp_path / "run").plan, Plan)


RIG = '[[camera]]\nname = "front"\ncolumn = "photo"\n'


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("", "missing required field `camera`"),
        ("camera = []", "Expected `array` of length >= 1"),
        (RIG + 'axis = "horizontal"', "unknown field `axis`"),
        (RIG + 'mirror_axis = "diagonal"', "Invalid enum value 'diagonal'"),
        (RIG + 'mirrors = "rear"', "camera 'front' mirrors 'rear', which must exist"),
        (RIG + RIG, "two cameras have the same name: front, front"),
        (RIG.replace("front", "a b"), "a camera's name has letters"),
        (RIG + '[state]\njoints = "speed"', r"Expected `array`, got `str` - at `\$\.state"),
    ],
)
def test_a_rig_that_is_none_says_why(tmp_path: Path, text: str, named: str) -> None:
    """The file is named, and what is wrong in it."""
    (tmp_path / "rig.toml").write_text(text)
    with pytest.raises(SpecError, match=rf"rig\.toml is no rig of cameras: .*{named}"):
        read_rig(tmp_path / "rig.toml")


@pytest.mark.parametrize(
    ("rig", "named"),
    [
        (RIG.replace("photo", "phoot"), "the file is declared as column 'phoot': .* did you mean 'photo'"),
        (RIG + '[[camera]]\nname = "rear"\ncolumn = "photo"', "column 'photo' cannot be file and camera rear at once"),
        (RIG + '[state]\nspeed = ["tick"]', "the state 'speed' has the name of a column that is kept"),
        (RIG + '[state]\npose = ["tick", "place"]', "'place' of the state 'pose' is .*, not a number"),
    ],
)
def test_a_rig_that_does_not_fit_its_table_says_why(tmp_path: Path, rig: str, named: str) -> None:
    """And leaves nothing."""
    rows = photographs.rows(drives=2, ticks=2)
    photographs.take(tmp_path / "photos", rows)
    (tmp_path / "t.csv").write_text(photographs.as_csv(rows))
    (tmp_path / "rig.toml").write_text(rig)
    choices = Choices(rig=read_rig(tmp_path / "rig.toml"))
    with pytest.raises(SourceError, match=named):
        import_table(tmp_path / "photos", tmp_path / "t.csv", tmp_path / "bank", choices)
    assert not (tmp_path / "bank").exists()
