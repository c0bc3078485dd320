"""Pictures of one's own with one thing changed: columns of a table become counterfactuals and controls of a bank."""

import csv
from dataclasses import replace
from pathlib import Path

import pytest

from banks import STAGED
from eyechart.conditions import COUNTERFACTUALS, NUDGES, RANGED, show
from eyechart.errors import SourceError
from eyechart.frames import DISTANCES, LEAD, FrameBank, check
from eyechart.importing import Choices, costs, import_table, read_rig
from eyechart.simulators.rover import Rover
from eyechart.studies import battery
from eyechart.verdicts import judge

pytestmark = pytest.mark.slow

PLACES = {"gap": "lidar_m", "episode": "drive", "scenario": "place"}
WHOLE = Choices(
    columns=PLACES,
    mirror="horizontal",
    threshold=8.0,
    unit="m",
    picture="forward camera of our rover",
    made="rendered",
)
DRAWN = (*COUNTERFACTUALS, *(name for name in (*STAGED, *RANGED) if name not in {"nudged", "real_again", *NUDGES}))

AS_OLDER = {
    "exchange_own": "lane_own",
    "exchange_beside": "lane_beside",
    "exchange_m": "lane_near_m",
    "lead_drawn": "lead_mid_near",
    "lead_drawn_m": "lead_mid_near_m",
}
"""Columns of a table of before, in which photographs that are asked for today stand."""


@pytest.fixture(scope="module")
def taken(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank whose pictures stand for a user's photographs."""
    return Rover().build(tmp_path_factory.mktemp("taken") / "photos", seeds=(3, 4), steps=12)


@pytest.fixture(scope="module")
def few(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return one of a sixth of the frames, for what is said of each row or of none."""
    return Rover().build(tmp_path_factory.mktemp("few") / "photos", seeds=(3,), steps=4)


def table(bank: FrameBank, path: Path, *, older: bool = False, **cells: str) -> Path:
    """Write a user's table of a bank's pictures; ``cells`` take the place of those of the first row."""
    rows = []
    for frame in bank:
        row = {
            "file": frame.file,
            "lidar_m": frame.truth["lead_gap_m"],
            "drive": frame.episode,
            "place": frame.scenario,
        }
        row |= {name: frame.counterfactuals.get(name, {}).get("main") for name in DRAWN}
        row |= {name: frame.strata[name] for name in frame.strata}
        row |= {name: frame.truth.get(name) for name in DISTANCES}
        rows.append(row | ({name: row.pop(now) for now, name in AS_OLDER.items()} if older else {}))
    rows[0] |= cells
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return path


def test_photographs_with_controls_are_a_bank_that_can_show_depth(taken: FrameBank, tmp_path: Path) -> None:
    """The very bytes, the distances beside the fingerprint, absences counted; a reader of pictures earns ``depth``."""
    bank = import_table(taken.root, table(taken, tmp_path / "t.csv"), tmp_path / "bank", WHOLE)
    assert check(bank.root) == []
    for frame, photo in zip(bank, taken, strict=True):
        assert frame.counterfactuals.keys() == photo.counterfactuals.keys()
        for name in photo.counterfactuals:
            assert bank.image(frame, name) == taken.image(photo, name)
        assert {name: frame.truth.get(name) for name in DISTANCES} == {
            name: photo.truth.get(name) for name in DISTANCES
        }
    assert bank.manifest.controls.seed is None
    lacking = sum("lead_absent" not in frame.counterfactuals for frame in taken)
    said = f"lead_absent: {lacking} of {len(bank)} frames have no such picture, and are left out of its tests"
    assert [line for line in costs(bank) if line.startswith("lead_absent")] == [said]
    battery.run(battery.plan(bank.root, ["scripted:depth"], tmp_path / "run"))
    verdict = judge(battery.score(tmp_path / "run", resamples=200))["scripted:depth"]
    assert (verdict.calibrated.label, verdict.evidence) == ("depth", "controlled")


@pytest.mark.parametrize(
    ("cells", "said"),
    [
        ({"lane_own": "nowhere.png"}, "there is no picture 'nowhere.png'"),
        ({"lead_mid_near": "../out.png"}, "which leads outside"),
        ({"lead_mid_far_m": "far"}, "'lead_mid_far_m' is 'far', not a number"),
    ],
)
def test_what_is_wrong_with_a_control_is_one_line(
    few: FrameBank, tmp_path: Path, cells: dict[str, str], said: str
) -> None:
    """It names the row, and nothing stays."""
    with pytest.raises(Exception, match=said) as caught:
        import_table(few.root, table(few, tmp_path / "t.csv", **cells), tmp_path / "bank", WHOLE)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "bank").exists()


def test_a_picture_that_was_not_taken_is_absent(few: FrameBank, tmp_path: Path) -> None:
    """An empty cell is no error; a mid without its distance costs what the import says; a picture is one frame's."""
    one = table(few, tmp_path / "t.csv", older=True, lane_own="", lead_mid_near_m="")
    bank = import_table(few.root, one, tmp_path / "bank", WHOLE)
    assert "lane_own" not in bank.frames[0].counterfactuals
    assert "lead_mid_near_m" not in bank.frames[0].truth
    frame, photo = bank.frames[1], few.frames[1]
    assert bank.image(frame, "lane_own") == few.image(photo, "exchange_own")
    assert frame.truth["lead_mid_near_m"] == photo.truth["lead_drawn_m"]
    lacking = sum("lane_own" not in frame.counterfactuals for frame in bank)
    assert any(line.startswith(f"lane_own: {lacking} of") for line in costs(bank))
    assert any(line.startswith("no lead_mid_near_m for some pictures of lead_mid_near") for line in costs(bank))
    other = photo.counterfactuals["exchange_own"]["main"]
    with pytest.raises(SourceError, match="a picture is one frame"):
        import_table(few.root, table(few, tmp_path / "u.csv", older=True, lane_own=other), tmp_path / "more", WHOLE)
    left = replace(WHOLE, columns={**PLACES, **dict.fromkeys(DRAWN, "")})
    plain = import_table(few.root, table(few, tmp_path / "v.csv"), tmp_path / "plain", left)
    assert plain.frames[0].counterfactuals == {}


def test_a_bank_of_several_cameras_takes_no_such_columns(few: FrameBank, tmp_path: Path) -> None:
    """They are kept as words, and asked for by name they are no place."""
    (tmp_path / "rig.toml").write_text('[[camera]]\nname = "front"\ncolumn = "file"\n')
    rigged = replace(WHOLE, mirror="none", rig=read_rig(tmp_path / "rig.toml"))
    bank = import_table(few.root, table(few, tmp_path / "t.csv"), tmp_path / "bank", rigged)
    assert bank.frames[0].counterfactuals == {}
    asked = replace(rigged, columns={**PLACES, "lane_own": "lane_own"})
    with pytest.raises(SourceError, match="there is no place 'lane_own'"):
        import_table(few.root, table(few, tmp_path / "t.csv"), tmp_path / "more", asked)


def test_columns_are_kept_as_strata_beside_the_ground_truth(few: FrameBank, tmp_path: Path) -> None:
    """What a claim may be asked by; the fingerprint is the same without, and a column that is none is named."""
    asked = replace(WHOLE, strata=("lead_colour",))
    bank = import_table(few.root, table(few, tmp_path / "t.csv"), tmp_path / "bank", asked)
    plain = import_table(few.root, tmp_path / "t.csv", tmp_path / "plain", WHOLE)
    assert check(bank.root) == []
    assert bank.manifest.fingerprint == plain.manifest.fingerprint
    assert plain.manifest.strata == {}
    for frame, photo in zip(bank, few, strict=True):
        assert frame.strata == photo.strata == {"lead_colour": frame.truth["lead_colour"]}
    for name, said in (("lead_color", "has no column 'lead_color'; did you mean"), ("lidar_m", "something else")):
        with pytest.raises(SourceError, match=said):
            import_table(few.root, tmp_path / "t.csv", tmp_path / name, replace(WHOLE, strata=(name,)))
        assert not (tmp_path / name).exists()


def test_a_nudged_picture_may_be_given_and_must_be_one(few: FrameBank, tmp_path: Path) -> None:
    """It is shown as it is; another picture is a fault of its row."""
    photos = tmp_path / "photos"
    for frame in few:
        for name in (None, "lead_drawn"):
            file = frame.file if name is None else frame.counterfactuals[name]["main"]
            (photos / file).parent.mkdir(parents=True, exist_ok=True)
            (photos / file).write_bytes(few.read(file))
    rows = [(one, f"{one.id}.png") for one in few]
    for frame, file in rows:
        (photos / file).write_bytes(show("lead_drawn_nudged", frame, few, 5).images["main"])
    lines = ["file,lead_drawn,lead_drawn_nudged,lead_drawn_m"]
    lines += [f"{one.file},{one.counterfactuals['lead_drawn']['main']},{file},{one.truth[LEAD]}" for one, file in rows]
    (tmp_path / "t.csv").write_text("\n".join(lines))
    bank = import_table(photos, tmp_path / "t.csv", tmp_path / "bank", Choices())
    assert check(bank.root) == []
    first = bank.frames[0]
    assert show("lead_drawn_nudged", first, bank, 9).images["main"] == (photos / rows[0][1]).read_bytes()
    (photos / rows[3][1]).write_bytes(few.image(few.frames[3]))
    with pytest.raises(SourceError, match="row 4: the lead_drawn_nudged is not its lead_drawn with one value"):
        import_table(photos, tmp_path / "t.csv", tmp_path / "more", Choices())
