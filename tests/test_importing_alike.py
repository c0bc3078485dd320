"""One thing that a table has twice, under two names, and two things that it calls by one."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from eyechart.errors import SourceError
from eyechart.frames import FrameBank
from eyechart.importing import Choices, costs, import_table, taken

FRAMES = 12
GAPS = (5.0, 30.0, 12.5, 41.0, 8.0, 22.0, 61.0, 17.0, 9.5, 33.0, 14.0, 80.2)
Row = dict[str, object]
Table = Callable[..., FrameBank]


@pytest.fixture
def photos(tmp_path: Path) -> Path:
    """Return a folder of two dozen pictures that differ."""
    folder, dice = tmp_path / "photos", np.random.default_rng(0)
    folder.mkdir()
    for number in range(2 * FRAMES):
        Image.fromarray(dice.integers(0, 255, (24, 32, 3), dtype=np.uint8)).save(folder / f"{number}.png")
    return folder


@pytest.fixture
def table(photos: Path, tmp_path: Path) -> Table:
    """Return a function that imports these rows, or twelve of four episodes with the ``cells`` given."""

    def run(
        rows: list[Row] | None = None, cells: dict[str, list[object]] | None = None, **changes: object
    ) -> FrameBank:
        rows = rows or drive("e")
        rows = [row | {name: many[place] for name, many in (cells or {}).items()} for place, row in enumerate(rows)]
        lines = [",".join(rows[0]), *(",".join(map(str, row.values())) for row in rows)]
        (tmp_path / "table.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
        choices = Choices(**{"threshold": 18.0, "unit": "m"} | changes)  # type: ignore[arg-type]
        return import_table(photos, tmp_path / "table.csv", tmp_path / "bank", choices)

    return run


def drive(name: str, file: str = "{}.png", gaps: tuple[float, ...] = GAPS) -> list[Row]:
    """Return twelve rows of four episodes of three frames."""
    return [{"file": file.format(n), "gap": gaps[n], "episode": f"{name}{n // 3}"} for n in range(FRAMES)]


def again(photos: Path, how: str) -> str:
    """Make every picture stand in the folder under a second name, and return how they are called then."""
    if how == "a folder's link":
        (photos / "again").symlink_to(".")
        return "again/{}.png"
    for number in range(FRAMES):
        one, other = photos / f"{number}.png", photos / f"again-{number}.png"
        {"copy": shutil.copy, "link": lambda one, other: other.symlink_to(one.name), "hard link": os.link}[how](
            one, other
        )
    return "again-{}.png"


@pytest.mark.parametrize("how", ["copy", "link", "hard link", "a folder's link"])
def test_a_recording_that_is_there_twice_counts_once_also_where_it_has_no_numbers(
    table: Table, photos: Path, tmp_path: Path, how: str
) -> None:
    """It would be two drives in every test; kept, it is said to be counted twice."""
    rows = [*drive("e"), *drive("f", again(photos, how))]
    bank = table(rows)
    assert {frame.episode for frame in bank} == {"e0", "e1", "e2", "e3"}
    assert "4 episodes repeat others: 'f0' is 'e0'" in " ".join(taken(bank))
    shutil.rmtree(tmp_path / "bank")
    kept = table(rows, keep_repeats=True)
    assert len(kept) == 2 * FRAMES
    assert "warning: 4 episodes repeat others" in " ".join(taken(kept))


def test_a_recording_that_is_there_twice_with_two_gaps_is_refused(table: Table, photos: Path) -> None:
    """Which of both is right, nobody knows; where both are kept, or one is empty, nothing is lost."""
    rows = [*drive("e"), *drive("f", again(photos, "copy"), tuple(reversed(GAPS)))]
    with pytest.raises(SourceError, match=r"'again-.*' and '.*' show the same.*the gap 'gap' is .* import both with"):
        table(rows)
    bank = table(rows, keep_repeats=True)
    assert len(bank) == 2 * FRAMES
    shutil.rmtree(bank.root)
    assert len(table([*rows[:FRAMES], *({**row, "gap": ""} for row in rows[FRAMES:])])) == FRAMES


def test_single_pictures_that_stand_there_twice_are_counted_and_named(table: Table, photos: Path) -> None:
    """As of frames that are declared independent draws."""
    rows = [*drive("e"), *drive("f", again(photos, "copy"))[:2]]
    bank = table([{name: row[name] for name in ("file", "gap")} for row in rows], independent=True)
    assert (
        "2 of 14 frames have the same picture as a frame of another drive, such as 'again-0.png' and '0.png'"
        in " ".join(costs(bank))
    )


@pytest.mark.parametrize(
    "names",
    [
        ("\u00e9t\u00e9", "e\u0301te\u0301"),
        ("1", "1.0"),
        ("+1", "1"),
        ("a\u200bb", "ab"),
        ("a\x00b", "ab"),
        ("a\x7fb", "ab"),
        ("a b", "a  b"),
        ("a b", "a\u00a0b"),
        ("\uff41", "a"),
    ],
)
@pytest.mark.parametrize("place", ["episode", "scenario"])
def test_names_that_look_the_same_are_refused(table: Table, names: tuple[str, str], place: str) -> None:
    """One drive under two names is two in every test."""
    with pytest.raises(SourceError, match=f"the {place} '{place}' is .* in some rows and .* in others"):
        table(cells={place: [names[number // 6] for number in range(FRAMES)]})


@pytest.mark.parametrize("names", [("aB", "Ab"), ("1", "01")])
@pytest.mark.parametrize("place", ["episode", "scenario"])
def test_names_in_other_letters_or_with_zeros_are_two_and_named(
    table: Table, names: tuple[str, str], place: str
) -> None:
    """As tokens may be; who reads them may have meant one."""
    bank = table(cells={place: [names[number // 6] for number in range(FRAMES)]})
    one, other = sorted(names)
    assert f"the {place}s '{one}' and '{other}' differ only in how they are written" in " ".join(costs(bank))


@pytest.mark.parametrize("names", [("a1", "a10"), ("10", "1"), ("1.5", "1"), ("-1", "1"), ("a-1", "a1")])
def test_names_that_differ_are_two(table: Table, names: tuple[str, str]) -> None:
    """A number's sign, its fraction and its size are no way to write it."""
    assert len({frame.episode for frame in table(cells={"episode": [names[n // 6] for n in range(FRAMES)]})}) == 2


@pytest.mark.parametrize("word", ["nan", "NaN", "None", "null", "<NA>", "N/A", "#N/A", "NaT"])
def test_a_word_that_programs_write_for_nothing_is_no_name_of_an_episode(table: Table, word: str) -> None:
    """All rows without a name would be one drive; a scenario may be called so, as 'none' beside 'rain'."""
    cells: list[object] = ["a", word, *["a"] * 10]
    with pytest.raises(SourceError, match=f"row 2: the episode 'episode' is '{word}'; every row needs one"):
        table(cells={"episode": cells})
    assert {frame.scenario for frame in table(cells={"scenario": cells})} == {"a", word}


def test_a_word_that_programs_write_for_nothing_is_said_to_no_model(table: Table) -> None:
    """Nobody goes at nan."""
    with pytest.raises(SourceError, match="row 2: 'speed' is 'nan'; a prompt column needs a value"):
        table(cells={"speed": ["3", "nan", *["4"] * 10]}, prompt_columns=("speed",))
    bank = table(cells={"speed": ["3", "N/A", *["null"] * 10]}, prompt_columns=("speed",))
    assert {frame.fields["speed"] for frame in bank} == {"3", "N/A", "null"}


def placed(scenarios: str, episodes: str) -> dict[str, list[object]]:
    """Return the columns of scenarios and episodes by a letter a row."""
    return {"episode": [*episodes], "scenario": [*scenarios]}


def test_a_drive_through_several_scenarios_is_refused_where_its_steps_show_it(table: Table) -> None:
    """Its parts would be exchanged as drives of their own: p .03 of two drives in five places."""
    columns = placed("xyzxyzxyzxyz", "aaaaaabbbbbb")
    with pytest.raises(SourceError, match="episode 'a' goes through the scenarios 'x' and 'y'"):
        table(cells=columns | {"step": [*range(6)] * 2})


def test_names_of_episodes_that_recur_in_another_scenario_are_other_drives(table: Table) -> None:
    """Where a step stands in both, or others lie between; without steps nobody knows, and it is said."""
    columns, words = placed("xxxxxxyyyyyy", "aaabbbaaabbb"), "2 episode names occur in several scenarios"
    bank = table(cells=columns)
    assert words in " ".join(costs(bank))
    shutil.rmtree(bank.root)
    stepped = table(cells=columns | {"step": [0, 1, 2] * 4})
    assert len({frame.drive for frame in stepped}) == 4
    assert words not in " ".join(costs(stepped))
    shutil.rmtree(bank.root)
    through = table(cells=placed("xxxxxxxxyyyy", "aaaabbbbaaaa") | {"step": [*range(FRAMES)]})
    assert len({frame.drive for frame in through}) == 3
    assert "1 episode name occurs in several scenarios" in " ".join(costs(through))


def test_scenarios_and_steps_without_episodes_are_no_drive_through_several(table: Table) -> None:
    """All frames are one draw, and nothing is said of drives."""
    rows: list[Row] = [{"file": f"{n}.png", "gap": GAPS[n], "location": "AB"[n // 6]} for n in range(FRAMES)]
    bank = table(rows)
    assert "in several scenarios" not in " ".join(costs(bank))
    shutil.rmtree(bank.root)
    assert len(table(rows, {"step": [*range(FRAMES)]})) == FRAMES


@pytest.mark.parametrize(("one", "other"), [("gap", "Gap"), ("file", "File")])
def test_a_column_that_is_called_exactly_as_its_place_is_taken(table: Table, one: str, other: str) -> None:
    """And the other one is named."""
    bank = table(cells={other: [1, 2] * 6})
    assert f"{one} is '{one}', not the column '{other}'; " in " ".join(costs(bank))


@pytest.mark.parametrize(("one", "other"), [("Episode", "EPISODE"), ("distance_m", "Distance m")])
def test_a_column_is_not_chosen_among_those_of_one_name(table: Table, one: str, other: str) -> None:
    """In other letters they are two, and the first that comes is not what is meant."""
    place = "gap" if "_" in one else one.lower()
    rows = [{one if name == place else name: cell for name, cell in row.items()} for row in drive("e")]
    cells: dict[str, list[object]] = {other: [1, 2] * 6}
    with pytest.raises(SourceError, match=f"has the columns '{one}' and '{other}': choose one with .*{place}"):
        table(rows, cells)
    assert len(table(rows, cells, columns={place: one})) == FRAMES


PAIRS = [
    ("lead_near", "lead_far"),
    ("lead_near", "lead_absent"),
    ("exchange_own", "exchange_beside"),
    ("exchange_own", "exchange_apart"),
    ("lane_own", "lane_beside"),
]


@pytest.mark.parametrize("rows", [1, FRAMES])
def test_a_recoloured_picture_that_repeats_the_file_was_not_taken(table: Table, photos: Path, rows: int) -> None:
    """It is left out, and counted in one line."""
    names = again(photos, "copy")
    cells: list[object] = [names.format(n) if n < rows else f"{FRAMES + n}.png" for n in range(FRAMES)]
    bank = table(cells={"recoloured": cells})
    assert sum("recoloured" in frame.counterfactuals for frame in bank) == FRAMES - rows
    assert f"{rows} picture{'s' * (rows > 1)} of recoloured repeat the file, and count as missing" in taken(bank)


@pytest.mark.parametrize(("one", "other"), PAIRS)
def test_two_pictures_between_which_something_was_moved_are_not_one(
    table: Table, photos: Path, one: str, other: str
) -> None:
    """Whoever reads them would be told not to follow what was moved."""
    shutil.copy(photos / "20.png", photos / "same.png")
    pictures: dict[str, list[object]] = {
        name: [f"{12 + n}.png" for n in range(11)] + ["23.png"] for name in (one, other)
    }
    for name in (one, other):
        pictures[name][8] = "20.png" if name == one else "same.png"
    pictures[other] = ["", *([""] * 7), pictures[other][8], "", "", ""]
    with pytest.raises(SourceError, match=f"row 9: {one} and {other} are the same picture"):
        table([{"file": f"{n}.png", "gap": GAPS[n], "episode": f"e{n // 3}"} for n in range(FRAMES)], pictures)
