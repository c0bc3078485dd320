"""One thing taken for another in a table is refused, or said when the bank is made."""

import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from eyechart.errors import SourceError
from eyechart.frames import FrameBank
from eyechart.importing import Choices, costs, import_table
from eyechart.importing.costs import FEWEST_OF_VALUE, MOST_OF_STRATUM
from eyechart.studies.battery.depth import FEWEST_OF_PLACE, MOST_OF_COLUMN

GAPS = (5.0, 30.0, 12.5, 41.0, 8.0, 22.0, 61.0, 17.0)


def made(folder: Path, *, shown: Sequence[int] = range(len(GAPS)), bright: int = 200, **more: Sequence[object]) -> Path:
    """Write pictures, by the number that each shows and up to ``bright``, and their table with more columns."""
    for number, look in enumerate(shown):
        pixels = np.random.default_rng(look).integers(0, bright, (24, 32, 3)).astype(np.uint8)
        for name in (f"{number}.png", *(f"{kind}-{number}.png" for kind in ("lead_near", "lead_far", "lead_drawn"))):
            Image.fromarray(np.roll(pixels, len(name), axis=0)).save(folder / name)
    columns = {"gap": GAPS, "episode": [f"e{number // 2}" for number in range(len(GAPS))], **more}
    lines = [",".join(["file", *columns])]
    lines += [
        ",".join([f"{number}.png", *(f'"{many[number]}"' for many in columns.values())]) for number in range(len(shown))
    ]
    (folder / "table.csv").write_text("\n".join(lines))
    return folder / "table.csv"


def bank(table: Path, *, threshold: float = 18.0, strata: tuple[str, ...] = ()) -> FrameBank:
    """Import a table, whose gap is in metres."""
    choices = Choices(threshold=threshold, unit="m", strata=strata)
    return import_table(table.parent, table, table.parent / "bank", choices)


def test_nothing_is_doubted_of_a_usual_table(tmp_path: Path) -> None:
    """Its costs are those of what it lacks."""
    drawn = [f"lead_drawn-{number}.png" for number in range(len(GAPS))]
    found = costs(bank(made(tmp_path, lead_drawn=drawn, lead_drawn_m=[4, 9, 15, 22, 40, 55, 6, 12])))
    assert not [line for line in found if line.endswith("?") or "as '5 m'" in line], found


@pytest.mark.parametrize("cell", ["1.53241E+15", "1,53E+15", "2E+17"])
@pytest.mark.parametrize("place", ["episode", "scenario"])
def test_a_name_that_a_spreadsheet_has_rounded_is_refused(place: str, cell: str, tmp_path: Path) -> None:
    """Drives of different names had become one."""
    with pytest.raises(SourceError, match="a long number without its last digits") as caught:
        bank(made(tmp_path, **dict[str, Any]({place: [cell] * len(GAPS)})))
    assert f"row 1: the {place} '{place}' is '{cell}'" in str(caught.value)


def test_a_name_that_is_a_float_too_large_to_be_exact_is_refused(tmp_path: Path) -> None:
    """Of JSON or Parquet, as pandas writes whole numbers beside an empty cell."""
    made(tmp_path)
    rows = [f'{{"file": "{n}.png", "gap": {gap}, "episode": {1.5e18 + 1000 * n}}}' for n, gap in enumerate(GAPS)]
    (tmp_path / "table.jsonl").write_text("\n".join(rows))
    with pytest.raises(SourceError, match=r"row 1: the episode 'episode' is 1\.5e\+18, a long number"):
        bank(tmp_path / "table.jsonl")


@pytest.mark.parametrize("cell", ["3e8750f331d7499e", "1e5", "12", "1.5e-7", "3.000000000000000000e+00"])
def test_a_name_with_an_e_in_it_is_a_name(cell: str, tmp_path: Path) -> None:
    """A hexadecimal token is no rounded number, and a number with all its digits, as NumPy writes it, is none."""
    assert bank(made(tmp_path, episode=[cell] * len(GAPS))).frames[0].episode == cell


def test_a_table_of_one_picture_is_refused(tmp_path: Path) -> None:
    """A model that looks was said to decide the same without the picture."""
    with pytest.raises(SourceError, match=r"all 8 rows show one and the same picture, such as '0\.png' and '7\.png'"):
        bank(made(tmp_path, shown=[0] * len(GAPS)))
    assert not (tmp_path / "bank").exists()


def test_a_picture_that_stands_beside_two_gaps_is_said(tmp_path: Path) -> None:
    """A camera that freezes for a while, or a gap of another row."""
    found = costs(bank(made(tmp_path, shown=[0, 0, 2, 3, 4, 5, 6, 6])))
    line = next(line for line in found if "with quite another gap" in line)
    assert line.startswith("4 of 8 frames show the picture of another one, with quite another gap: '0.png' has 5 m")
    assert "'1.png' 30 m. Was the camera frozen" in line


@pytest.mark.parametrize(("threshold", "words"), [(0.5, "no gap is below"), (1800.0, "every gap is below")])
def test_a_threshold_that_parts_no_gaps_is_said(threshold: float, words: str, tmp_path: Path) -> None:
    """As one in centimetres, where the gaps are in metres."""
    found = costs(bank(made(tmp_path), threshold=threshold))
    assert any(line.startswith(f"{words} the threshold of {threshold:g} m: they go from 5 to 61") for line in found)


def test_distances_of_moved_things_in_another_unit_are_said(tmp_path: Path) -> None:
    """Millimetres beside metres."""
    files, far = [f"lead_drawn-{number}.png" for number in range(len(GAPS))], range(4000, 12000, 1000)
    found = costs(bank(made(tmp_path, lead_drawn=files, lead_drawn_m=far)))
    assert any(line.startswith("lead_drawn_m: its middle value is 7500, and that of the gap 19.5") for line in found)


def test_a_near_that_is_farther_than_the_far_is_refused(tmp_path: Path) -> None:
    """The two columns were exchanged, and a model that brakes was said not to."""
    files = {kind: [f"{kind}-{number}.png" for number in range(len(GAPS))] for kind in ("lead_near", "lead_far")}
    with pytest.raises(SourceError, match="row 1: 'lead_near_m' is 50 and 'lead_far_m' 6, but near is less than far"):
        bank(made(tmp_path, **dict[str, Any](files), lead_near_m=[50] * len(GAPS), lead_far_m=[6] * len(GAPS)))


def test_a_cell_with_a_fault_moves_no_near_beside_the_far_of_another_row(tmp_path: Path) -> None:
    """Only the cell itself is named."""
    files = {kind: [f"{kind}-{number}.png" for number in range(len(GAPS))] for kind in ("lead_near", "lead_far")}
    near, far = ["?", 40, 4, 40, 4, 40, 4, 40], [20, 60, 20, 60, 20, 60, 20, 60]
    with pytest.raises(SourceError, match="row 1: 'lead_near_m' is '\\?'") as caught:
        bank(made(tmp_path, **dict[str, Any](files), lead_near_m=near, lead_far_m=far))
    assert "near is less than far" not in str(caught.value)


def test_a_picture_of_another_drive_in_place_of_a_moment_of_its_own_is_said(tmp_path: Path) -> None:
    """A model that knows the place of that one picture would pass for one that brakes for the near."""
    table = made(tmp_path, lead_near=[f"lead_near-{number}.png" for number in range(len(GAPS))])
    for number in (1, 5):
        shutil.copy(tmp_path / "lead_near-0.png", tmp_path / f"lead_near-{number}.png")
    line = next(line for line in costs(bank(table)) if line.startswith("lead_near: 3 of 8 pictures are the same"))
    assert "as of '0.png' and '5.png', though the true ones differ" in line


def test_pictures_in_which_nothing_was_moved_are_said(tmp_path: Path) -> None:
    """The true picture copied under the name of another one."""
    table = made(tmp_path, lead_near=[f"lead_near-{number}.png" for number in range(len(GAPS))])
    for number in range(len(GAPS)):
        shutil.copy(tmp_path / f"{number}.png", tmp_path / f"lead_near-{number}.png")
    assert "lead_near: all 8 pictures are the true ones again: was nothing moved?" in costs(bank(table))


def test_a_moved_picture_of_another_size_is_refused(tmp_path: Path) -> None:
    """A model could tell the near from the far by the size alone."""
    table = made(tmp_path, lead_near=[f"lead_near-{number}.png" for number in range(len(GAPS))])
    Image.new("RGB", (64, 48), (9, 90, 200)).save(tmp_path / "lead_near-3.png")
    with pytest.raises(SourceError, match="row 4: lead_near has 64×48 pixels, and the true picture 32×24"):
        bank(table)


def test_pictures_of_several_sizes_are_said(tmp_path: Path) -> None:
    """Those of two cameras in one table."""
    table = made(tmp_path)
    Image.open(tmp_path / "3.png").resize((64, 48)).save(tmp_path / "3.png")
    assert any("several sizes, such as 32×24 and 64×48 pixels" in line for line in costs(bank(table)))


def test_strata_that_look_the_same_are_refused(tmp_path: Path) -> None:
    """They were two groups, of which a claim is asked apart."""
    with pytest.raises(SourceError, match="the stratum 'light' is 'rain ' in some rows and 'rain' in others"):
        bank(made(tmp_path, light=["rain", "rain "] * 4), strata=("light",))


def test_a_stratum_that_names_no_place_is_said(tmp_path: Path) -> None:
    """Of too many values, of one, and of too few frames of a value: a blind spot there would not be named."""
    long = [str(number) for number in range(13)]
    shown = [*range(26)]
    columns = {"tag": long * 2, "town": ["here"] * 26, "light": ["day"] * 20 + ["dusk"] * 6, "road": ["a", "b"] * 13}
    gaps = {"gap": [5.0 + number for number in shown], "episode": [f"e{number // 2}" for number in shown]}
    found = costs(bank(made(tmp_path, shown=shown, **gaps, **columns), strata=tuple(columns)))
    assert [line for line in found if line.startswith("stratum")] == [
        *(
            f"stratum '{name}': it has {many}, and a claim is judged by those of 2 to 12: a place where a controller "
            "is blind is not found by it"
            for name, many in (("tag", "13 values"), ("town", "1 value"))
        ),
        "stratum 'light': dusk: fewer than 8 frames each, so that no claim is judged in them alone",
    ]
    assert (MOST_OF_STRATUM, FEWEST_OF_VALUE) == (MOST_OF_COLUMN, FEWEST_OF_PLACE)


def test_rows_of_one_name_between_which_others_lie_are_doubted_without_steps(tmp_path: Path) -> None:
    """Drives of two days may be called alike; with steps, the same one occurs twice, and is refused."""
    words = "as its steps, in their order; rows of others lie between: are two called alike?"
    (tmp_path / "whole").mkdir()
    assert words not in " ".join(costs(bank(made(tmp_path / "whole"))))
    assert words in " ".join(costs(bank(made(tmp_path, episode=["a", "a", "b", "b"] * 2))))


def test_a_column_that_is_called_as_a_unit_is_in_it(tmp_path: Path) -> None:
    """Feet were taken for the metres of --unit."""
    made(tmp_path, ft=GAPS)
    choices = Choices(columns={"gap": "ft"}, threshold=18.0, unit="m")
    with pytest.raises(SourceError, match="unit m: the gap's column 'ft' says ft; leave out"):
        import_table(tmp_path, tmp_path / "table.csv", tmp_path / "bank", choices)
    found = import_table(tmp_path, tmp_path / "table.csv", tmp_path / "bank", replace(choices, unit=None))
    assert found.manifest.gap is not None
    assert found.manifest.gap.unit == "ft"


@pytest.mark.parametrize("names", [("Night", "night"), ("01", "1")])
def test_strata_in_other_letters_or_with_zeros_are_two_and_named(names: tuple[str, str], tmp_path: Path) -> None:
    """As names of drives are, once; an empty cell is none of them."""
    light = [*names, *names, "None", "", *names]
    found = costs(bank(made(tmp_path, light=light), strata=("light",)))
    one, other = sorted(names)
    said = [line for line in found if "differ only" in line]
    how = "differ only in how they are written, and count as two"
    assert said == [f"the values of 'light' '{one}' and '{other}' {how}"]


@pytest.mark.parametrize("names", [("Stop", "stop"), ("go  on", "go on"), ("1", "1.0")])
def test_words_of_prompts_that_look_the_same_are_two_and_named(names: tuple[str, str], tmp_path: Path) -> None:
    """Whoever exchanges such instructions exchanges nothing; what is said of them is true of each pair."""
    table = made(tmp_path, task=[*names] * 4)
    found = costs(
        import_table(tmp_path, table, tmp_path / "bank", Choices(columns={"gap": ""}, prompt_columns=("task",)))
    )
    said = f"the values of 'task' '{names[0]}' and '{names[1]}' differ only in how they are written, and count as two"
    assert said in found


def film(folder: Path, *, names: Sequence[int], steps: bool = False) -> FrameBank:
    """Import frames of a thing that comes nearer, under the names given, as independent draws."""
    for number, name in enumerate(names):
        pixels = np.full((24, 64, 3), 90, np.uint8)
        pixels[:, : 2 * number] = 200
        Image.fromarray(pixels).save(folder / f"{name:03}.png")
    head, order = ["file,gap,step", "file,gap"][not steps], np.random.default_rng(0).permutation(names)
    rows = [f"{name:03}.png,{5 + name}{f',{name}' * steps}" for name in order]
    (folder / "table.csv").write_text("\n".join([head, *rows]))
    choices = Choices(threshold=18.0, unit="m", independent=True)
    return import_table(folder, folder / "table.csv", folder / "bank", choices)


def test_frames_of_a_film_that_are_declared_independent_are_doubted(tmp_path: Path) -> None:
    """By their steps, or because each is like the next one by name; those in no order are believed."""
    words, mixed = (
        "frames have steps, or are like the next by name, as in a film",
        np.random.default_rng(1).permutation(24),
    )
    for name in ("film", "steps", "mixed"):
        (tmp_path / name).mkdir()
    assert words in " ".join(costs(film(tmp_path / "film", names=range(24))))
    assert words in " ".join(costs(film(tmp_path / "steps", names=mixed.tolist(), steps=True)))
    assert words not in " ".join(costs(film(tmp_path / "mixed", names=mixed.tolist())))


def test_a_stratum_with_the_name_of_the_distances_is_refused(tmp_path: Path) -> None:
    """A hole in it was taken for a part of the distance, and ended the reading of a run."""
    with pytest.raises(SourceError, match="strata range: a verdict calls the parts of the distance so; rename"):
        bank(made(tmp_path, range=["a", "b"] * 4), strata=("range",))


def test_pictures_of_class_numbers_are_said(tmp_path: Path) -> None:
    """Labels of classes are nearly black, and a model sees nothing in them."""
    found = costs(bank(made(tmp_path, bright=24)))
    assert any("is brighter than 23 of 255: are these labels of classes" in line for line in found)
