"""Parquet tables and LeRobotDatasets become banks, within bounds of memory."""

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import parquets
import photographs
from data_sets import CAMERA, REAR, arm, arrow, film, lerobot, reach, write_table
from eyechart.channels import reflected
from eyechart.conditions import show
from eyechart.conditions.policies import conditions_of
from eyechart.errors import BankError, SourceError, SpecError
from eyechart.frames import FrameBank, check, decode, open_bank
from eyechart.importing import Choices, Horizon, costs, import_lerobot, import_table, read_rig
from eyechart.importing.costs import taken
from eyechart.importing.log_warnings import notes
from eyechart.models import ADAPTERS
from eyechart.spaces.discrete import read_space
from eyechart.spaces.motion import Kind
from eyechart.studies import battery
from eyechart.verdicts import judge

pytestmark = pytest.mark.models

PLACES = {"file": "photo", "episode": "drive", "step": "tick", "scenario": "place", "gap": "lidar_m"}
WHOLE = Choices(columns=PLACES, mirror="horizontal", threshold=18.0, unit="m", picture="forward camera of a rover")


def columns_of(rows: list[photographs.Row]) -> dict[str, object]:
    """Return rows as columns."""
    return {name: [row[name] for row in rows] for name in rows[0]}


@pytest.fixture
def photos(tmp_path: Path) -> Path:
    """Return a folder of photographs."""
    photographs.take(tmp_path / "photos", photographs.rows())
    return tmp_path / "photos"


def test_a_parquet_table_gives_the_bank_of_the_same_csv(photos: Path, tmp_path: Path) -> None:
    """Columns that are no plain values are left out and named; nulls are empty cells."""
    rows = photographs.rows()
    (tmp_path / "t.csv").write_text(photographs.as_csv(rows))
    columns = {**columns_of(rows), "scan": [[1.0, 2.0]] * len(rows), "raw": [b"x"] * len(rows)}
    table = write_table(tmp_path / "t.parquet", columns, row_group_size=7)
    banks = [import_table(photos, tmp_path / name, tmp_path / f"{name}-bank", WHOLE) for name in ("t.csv", table.name)]
    assert banks[0].manifest.fingerprint == banks[1].manifest.fingerprint
    words = "is left out: it has no plain values"
    left = [[one.split()[1] for one in taken(bank) if one.endswith(words)] for bank in banks]
    assert left == [[], ["'scan'", "'raw'"]]


BOMBS = """
import sys, pyarrow as pa, pyarrow.parquet as pq
kind, path = sys.argv[1:]
if kind == "cell":
    column = pa.array(["0/00.jpg", "x" * 300_000_000], pa.large_string())
elif kind == "repeated":
    column = pa.DictionaryArray.from_arrays(pa.array([0] * 30_000, pa.int32()), pa.array(["x" * 1_000_000]))
elif kind == "rows":
    column = pa.DictionaryArray.from_arrays(pa.array([0] * 60_000_000, pa.int8()), pa.array(["0/00.jpg"]))
else:
    column = pa.array(["0/00.jpg"] * 3 + ["x" * 90_000] * 5)
options = {"use_dictionary": False, "column_encoding": {"file": "DELTA_BYTE_ARRAY"}} if kind == "prefixes" else {}
pq.write_table(pa.table({"file": column}), path, compression="zstd", **options)
"""

READER = """
import resource, sys
from pathlib import Path
resource.setrlimit(resource.RLIMIT_AS, (int(sys.argv[3]), int(sys.argv[3])))
from eyechart.importing import Choices, import_table
from eyechart.channels import reflected
from eyechart.conditions import show
from eyechart.conditions.policies import conditions_of
from eyechart.errors import SourceError, SpecError
try:
    import_table(Path(sys.argv[1]), Path(sys.argv[2]), Path(sys.argv[1]) / "bank", Choices())
except SourceError as error:
    print(error)
# Not ru_maxrss, which begins with the memory of whoever started the process.
print(next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")))
"""


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("cell", "unpacks to 3000000"),
        ("repeated", "row 1: 'file' has more than 100000 characters"),
        ("rows", "has more than 20000000 rows; cut it into parts"),
        ("prefixes", "size is known only after reading, such as DELTA_BYTE_ARRAY"),
    ],
)
def test_a_table_that_unpacks_to_gigabytes_is_refused_in_bounded_memory(tmp_path: Path, kind: str, said: str) -> None:
    """A few kilobytes that stand for 0.3 to 30 GB: one line, and at most 600 MB in use at any time."""
    bomb = tmp_path / "bomb.parquet"
    subprocess.run([sys.executable, "-c", BOMBS, kind, str(bomb)], check=True)
    assert bomb.stat().st_size < 1_000_000
    words = [sys.executable, "-c", READER, str(tmp_path), str(bomb), str(8 * 2**30)]
    out = subprocess.run(words, check=True, capture_output=True, text=True).stdout.splitlines()
    assert len(out) == 2
    assert said in out[0]
    assert int(out[1]) < 600_000, "kilobytes"
    assert not (tmp_path / "bank").exists()


BEYOND = """
import sys
from pathlib import Path
from eyechart.channels import reflected
from eyechart.conditions import show
from eyechart.conditions.policies import conditions_of
from eyechart.errors import SourceError, SpecError
from eyechart.importing.parquet import open_parquet
for path in map(Path, sys.argv[1:]):
    try:
        print(path.stem, sum(1 for row in open_parquet(path, vectors={"listed": ("one", "two")}).rows()), "rows")
    except SourceError as error:
        print(path.stem, error)
print("peak", next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")))
"""


def zeros(count: int) -> bytes:
    """Return so many bytes of 0, a multiple of 16 MB, as Zstandard packs them: half a kilobyte for each 16 MB."""
    pa, _ = arrow()
    packed: bytes = pa.Codec("zstd").compress(bytes(1 << 24), asbytes=True)
    return packed * (count >> 24)


def lies(folder: Path) -> dict[str, str]:
    """Write files whose footers are modest and whose pages are not; return what is said of each."""
    vast, name = 127 << 24, (8).to_bytes(4, "little") + b"0/00.jpg"
    words = parquets.page(zeros(vast), kind=parquets.DICTIONARY, unpacked=vast, values=1)
    indices = parquets.page(b"", unpacked=9, values=1, encoding=parquets.RLE_DICTIONARY)
    told = parquets.page(zeros(vast), unpacked=5, values=1)
    again = parquets.twice(told, len(told) - len(zeros(vast)), bytes([0x05, 0x04]) + parquets.whole(vast))
    one = parquets.page(name, unpacked=12, values=1)
    column, plain = parquets.Column, parquets.NONE
    made = {
        "page": [column("file", parquets.page(zeros(vast), unpacked=vast, values=1), 1)],
        "claim": [column("file", parquets.page(name, unpacked=2**31 - 1, values=1), 1)],
        "dictionary": [column("file", words + indices, 1, dictionary=len(words))],
        "prefixes": [column("file", parquets.page(name, unpacked=12, values=1, encoding=parquets.DELTA_BYTES), 1)],
        "lengths": [column("file", parquets.page(name, unpacked=12, values=1, encoding=parquets.DELTA_LENGTH), 1)],
        "twice": [column("file", again, 1)],
        "behind": [column("file", one[:-4], 1, codec=plain)],
        "values": [column("file", parquets.page(name, unpacked=12, values=2**31 - 1), 1, codec=plain)],
        "many": [column(f"c{n}", parquets.page(zeros(1 << 24), unpacked=1 << 24, values=1), 1) for n in range(5)],
        "width": [column("file", one, 1, codec=plain, kind=parquets.FIXED, width=2**30, optional=True)],
        "listed": [column("listed", parquets.page(b"", unpacked=9, values=2**31 - 1), 1, listed=True, kind=2)],
    }
    for kind, columns in made.items():
        parquets.write(folder / f"{kind}.parquet", columns, 1)
    deep = [parquets.Struct({3: 1, 4: b"a", 5: 1})] * 5_000
    parquets.write(folder / "deep.parquet", [column("file", one, 1, codec=plain)], 1, extra=deep)
    parquets.write(folder / "rows.parquet", [column("file", one, 1, codec=plain)], 10**15)
    return {
        "page": "unpacks to 2130706432 bytes at a time",
        "claim": "unpacks to 2147483647 bytes at a time",
        "dictionary": "unpacks to 2130706441 bytes at a time",
        "prefixes": "size is known only after reading",
        "lengths": "size is known only after reading",
        "twice": "it says field 2 twice",
        "behind": "goes on behind its end",
        "values": "has 2147483647 values for 1 rows",
        "many": "more than the limit of 192000000",
        "width": "has values of 1073741824 bytes; the limit is 64",
        "listed": "unpacks to 2147483647 numbers in vectors",
        "deep": "its schema is nested too deep",
        "rows": "has 1 values for 1000000000000000 rows",
    }


def test_a_footer_that_lies_is_found_out_before_a_page_is_unpacked(tmp_path: Path) -> None:
    """Kilobytes that stand for 2 GB in a page, a dictionary, a claim or a null: one line each, within 150 MB."""
    said = lies(tmp_path)
    assert max(path.stat().st_size for path in tmp_path.iterdir()) < 100_000
    words = [sys.executable, "-c", BEYOND, *(str(tmp_path / f"{kind}.parquet") for kind in said)]
    *lines, peak = subprocess.run(words, check=True, capture_output=True, text=True).stdout.splitlines()
    assert [line.split()[0] for line in lines] == list(said)
    for line, expected in zip(lines, said.values(), strict=True):
        assert expected in line
    assert int(peak.split()[1]) < 150_000, "kilobytes"


def test_what_is_just_within_the_bounds_is_read_within_750_mb(tmp_path: Path) -> None:
    """The most words at a time, of the widest letters; the most numbers in one vector; every column the same word."""
    pa, pq = arrow()
    words = [f"{place:06d}{'x' * 89_000}😀" for place in range(700)]
    pq.write_table(pa.table({"file": words}), tmp_path / "words.parquet", use_dictionary=False, data_page_size=1 << 30)
    long = pa.array([np.full(15_900_000, 1.5), [2.5, 3.5]], pa.list_(pa.float64()))
    pq.write_table(pa.table({"listed": long}), tmp_path / "listed.parquet", compression="zstd")
    same = pa.DictionaryArray.from_arrays(pa.array([0] * 1024, pa.int8()), pa.array(["x" * 15_000]))
    pq.write_table(pa.table({f"c{place}": same for place in range(1500)}), tmp_path / "wide.parquet")
    paths = [str(tmp_path / f"{kind}.parquet") for kind in ("words", "listed", "wide")]
    out = subprocess.run([sys.executable, "-c", BEYOND, *paths], check=True, capture_output=True, text=True).stdout
    *lines, peak = out.splitlines()
    assert lines[0] == "words 700 rows"
    assert lines[1].endswith("row 1: 'listed' has 15900000 components, not 2")
    assert lines[2] == "wide 1024 rows"
    assert int(peak.split()[1]) < 750_000, "kilobytes"


def test_a_file_that_is_no_parquet_is_one_line(photos: Path, tmp_path: Path) -> None:
    """Torn in the footer, in a page, or no Parquet at all."""
    whole = write_table(tmp_path / "t.parquet", columns_of(photographs.rows())).read_bytes()
    for content in (b"", b"PAR1PAR1", whole[:-20], whole[:4] + bytes(300) + whole[304:]):
        (tmp_path / "t.parquet").write_bytes(content)
        with pytest.raises(SourceError, match=r"t\.parquet cannot be read as Parquet") as refused:
            import_table(photos, tmp_path / "t.parquet", tmp_path / "bank", WHOLE)
        assert "\n" not in str(refused.value)
        assert not (tmp_path / "bank").exists()


ROBOT = Choices(
    columns={"gap": "observation.state.gap", "scenario": "task"}, mirror="horizontal", threshold=18.0, unit="m"
)


def test_a_lerobot_data_set_becomes_a_bank_and_a_verdict(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every frame shows its own moment: the box in the decoded picture is as high as its gap says."""
    gaps = lerobot(tmp_path / "set")
    (tmp_path / "rover.toml").write_text(photographs.SPACE)
    choices = replace(ROBOT, space=read_space(tmp_path / "rover.toml"))
    bank = import_lerobot(tmp_path / "set", tmp_path / "bank", choices)
    assert len(bank) == len(gaps)
    assert check(bank.root) == []
    for frame, gap in zip(bank, gaps, strict=True):
        assert frame.truth["observation.state.gap"] == gap
        assert frame.id == f"episode-{frame.episode}/frame-{frame.step}.png"
        shown = photographs.height(decode(bank.image(frame), frame.file))
        assert abs(shown - photographs.height(photographs.draw(gap))) <= 2
    assert {frame.scenario for frame in bank} == {"cross the yard", "park"}
    assert costs(bank) == []
    monkeypatch.setitem(ADAPTERS, "driver", "photographs")
    battery.run(battery.plan(bank.root, ["driver:looks"], tmp_path / "run"))
    verdict = judge(battery.score(tmp_path / "run", resamples=500))["driver:looks"]
    assert (verdict.calibrated.label, verdict.evidence) == ("depth_associated", "observational")


def test_every_tenth_frame_of_a_long_video_is_looked_up(tmp_path: Path) -> None:
    """Frames between are not taken, and those taken are the right ones."""
    lerobot(tmp_path / "set", episodes=2, length=120)
    whole = import_lerobot(tmp_path / "set", tmp_path / "whole", ROBOT)
    some = import_lerobot(tmp_path / "set", tmp_path / "some", replace(ROBOT, every=40))
    assert [frame.step for frame in some] == [0, 40, 80] * 2
    for frame in some:
        assert some.image(frame) == whole.image(whole.frame(frame.id))


def spoil(root: Path, what: str) -> None:
    """Damage a data set."""
    info = json.loads((root / "meta/info.json").read_text())
    if what == "version":
        info["codebase_version"] = "v1.6"
    if what == "outside":
        info["video_path"] = "../../{video_key}.mp4"
    if what == "no camera":
        del info["features"][CAMERA]
    (root / "meta/info.json").write_text(json.dumps(info))
    spoil_files(root, what)


def spoil_files(root: Path, what: str) -> None:
    """Damage the files of a data set."""
    if what == "no video":
        (root / f"videos/{CAMERA}/chunk-000/file-001.mp4").unlink()
    if what == "torn video":
        video = root / f"videos/{CAMERA}/chunk-000/file-001.mp4"
        video.write_bytes(video.read_bytes()[:400])
    if what == "pointer":
        pointer = "version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 9\n"
        (root / f"videos/{CAMERA}/chunk-000/file-001.mp4").write_text(pointer)
    if what == "short video":
        film(root / f"videos/{CAMERA}/chunk-000/file-001.mp4", [9.0] * 12, 10)
    if what == "no episodes":
        (root / "meta/episodes/chunk-000/file-000.parquet").unlink()
    if what == "no data":
        for path in (root / "data/chunk-000").iterdir():
            path.unlink()


@pytest.mark.parametrize(
    ("what", "said"),
    [
        ("version", "has version v1.6, but eyechart reads v2.0, v2.1 and v3"),
        ("outside", "leads outside the data set"),
        ("no camera", "lists no feature of dtype video"),
        ("no video", "file-001.mp4 does not exist; download it again, or, in a clone, run 'git lfs pull'"),
        ("torn video", "cannot be read as a video (Invalid data found when processing input); if it is cut, or a"),
        ("pointer", "if it is cut, or a pointer of Git LFS, download it again"),
        ("short video", "file-001.mp4 ends at 1.100 s, but the data set has rows at "),
        ("no episodes", "has no chunk-*/file-*.parquet"),
        ("no data", "has no chunk-*/file-*.parquet"),
    ],
)
def test_what_is_wrong_with_a_data_set_is_one_line_and_leaves_nothing(tmp_path: Path, what: str, said: str) -> None:
    """The line names the file at fault."""
    lerobot(tmp_path / "set")
    spoil(tmp_path / "set", what)
    with pytest.raises(SourceError) as refused:
        import_lerobot(tmp_path / "set", tmp_path / "bank", ROBOT)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)
    assert [path.name for path in tmp_path.iterdir()] == ["set"]


def test_a_camera_and_the_places_of_a_data_set_are_its_own(tmp_path: Path) -> None:
    """An unknown camera lists those that there are; the episode of a frame is not to be mapped."""
    lerobot(tmp_path / "set")
    with pytest.raises(SourceError, match=f"camera rear: .* there are {CAMERA}"):
        import_lerobot(tmp_path / "set", tmp_path / "bank", ROBOT, camera="rear")
    arm(tmp_path / "two", inside=False)
    with pytest.raises(SourceError, match=r"choose one with camera: observation\.images\.front, observation"):
        import_lerobot(tmp_path / "two", tmp_path / "bank", ROBOT)
    bank = import_lerobot(tmp_path / "set", tmp_path / "short", ROBOT, camera="front")
    assert bank.manifest.settings["camera"] == CAMERA
    mapped = replace(ROBOT, columns={"episode": "task_index"})
    with pytest.raises(
        SourceError, match=r"columns=\{'episode': '…'\}: a data set declares the episode of a frame itself"
    ):
        import_lerobot(tmp_path / "set", tmp_path / "bank", mapped)


def test_what_is_no_data_set_or_no_bank_is_told_what_to_give(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A name of the Hub has its folder said; a data set given as a bank, the command that imports it."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SourceError, match=r"there is no folder 'lerobot/pusht'; .*HF_LEROBOT_HOME.*--local-dir pusht'"):
        import_lerobot(Path("lerobot/pusht"), tmp_path / "bank", ROBOT)
    lerobot(tmp_path / "set")
    with pytest.raises(
        BankError, match=r"set is a LeRobotDataset, and 'eyechart frames import .*set --format lerobot "
    ):
        open_bank(tmp_path / "set")


@pytest.mark.parametrize("inside", [False, True])
def test_a_lerobot_data_set_becomes_a_bank_for_policies(tmp_path: Path, *, inside: bool) -> None:
    """All its cameras but one of depths, its state, its task, and the actions that follow; videos or Parquet alike."""
    arm(tmp_path / "set", inside=inside)
    bank = import_lerobot(tmp_path / "set", tmp_path / "bank", Choices(every=3), ahead=Horizon(4, "absolute"))
    assert check(bank.root) == []
    assert not [line for line in taken(bank) if line.startswith("warning")]
    space = bank.manifest.motion
    assert space is not None
    assert (space.shape, space.kind, space.rate_hz) == ((4, 2), "absolute", 10.0)
    assert [(dimension.name, dimension.state) for dimension in space.dimensions] == [("gap", 0), ("speed", 1)]
    assert [frame.step for frame in bank][:4] == [0, 3, 6, 9]
    for frame in bank:
        first = (int(frame.episode) % 4 * 10 + frame.step) * 2
        wanted = tuple((first + 2.0 * step, first + 2.0 * step + 1) for step in range(4))
        assert frame.motion == (wanted if frame.step <= 6 else ())
        assert list(frame.pictures) == ["front", "rear"]
        shown = [photographs.height(decode(image, name)) for name, image in bank.images(frame).items()]
        expected = photographs.height(photographs.draw(frame.state["state"][0]))
        assert np.abs(np.array(shown) - expected).max() <= (0 if inside else 2)
        assert frame.fields == {"task": ("cross the yard", "park")[int(frame.episode) % 2]}
    assert any("8 of 32 frames have no logged motion" in line for line in costs(bank))


@pytest.mark.parametrize("inside", [False, True])
def test_episodes_of_a_data_set_that_are_there_twice_are_imported_once(tmp_path: Path, *, inside: bool) -> None:
    """As of two data sets that were merged; with other pictures they are other recordings."""
    arm(tmp_path / "set", inside=inside)
    _, pq = arrow()
    one, other = sorted((tmp_path / "set" / "data").rglob("*.parquet"))
    first, second = pq.read_table(one), pq.read_table(other)
    for name in ("observation.state", "action"):
        second = second.set_column(second.schema.get_field_index(name), name, first[name])
    pq.write_table(second, other, row_group_size=13)
    apart = import_lerobot(tmp_path / "set", tmp_path / "apart", Choices(), ahead=Horizon(4, "delta"))
    assert len(apart) == 80
    for name in (CAMERA, REAR):
        if inside:
            second = second.set_column(second.schema.get_field_index(name), name, first[name])
            pq.write_table(second, other, row_group_size=13)
        else:
            reel = tmp_path / "set" / "videos" / name / "chunk-000"
            shutil.copy(reel / "file-000.mp4", reel / "file-001.mp4")
    bank = import_lerobot(tmp_path / "set", tmp_path / "bank", Choices(), ahead=Horizon(4, "delta"))
    assert [frame.id for frame in bank] == [frame.id for frame in apart][:40]
    assert check(bank.root) == []
    said = "4 episodes repeat others: '4' is '0', '5' is '1', '6' is '2', '7' is '3' (same pictures and numbers)"
    assert any(line.startswith(said) for line in taken(bank))
    kept = import_lerobot(tmp_path / "set", tmp_path / "kept", Choices(keep_repeats=True), ahead=Horizon(4, "delta"))
    assert kept.manifest.fingerprint == apart.manifest.fingerprint


def tasks(root: Path, words: dict[int, str | None] | None) -> None:
    """Replace the words of a data set's tasks; None removes the file."""
    path = root / "meta/tasks.parquet"
    path.unlink()
    if words is not None:
        pa, _ = arrow()
        said = pa.array([*words.values()], pa.string())
        write_table(path, {"task_index": [*words], "__index_level_0__": said})


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (None, r"tasks\.parquet does not exist, but every row has a task_index.* prompt_columns"),
        ({0: None, 1: None}, r"tasks\.parquet holds no words of tasks"),
        ({0: "cross the yard"}, r"row 11: meta/tasks\.parquet has no words of task 1"),
    ],
)
def test_tasks_without_words_are_no_bank_without_an_instruction(
    tmp_path: Path, words: dict[int, str | None] | None, said: str
) -> None:
    """Refused in one line; who names what a policy is told has it so."""
    arm(tmp_path / "set", inside=True)
    tasks(tmp_path / "set", words)
    with pytest.raises(SourceError, match=said) as refused:
        import_lerobot(tmp_path / "set", tmp_path / "bank", Choices(), ahead=Horizon(4, "delta"))
    assert "\n" not in str(refused.value)
    named = import_lerobot(
        tmp_path / "set", tmp_path / "bank", Choices(prompt_columns=("task_index",)), ahead=Horizon(4, "delta")
    )
    assert {field for frame in named for field in frame.fields.values()} == {0, 1}


MIRRORED = """
[[camera]]
name = "front"
mirror_axis = "horizontal"
mirrors = "rear"

[[camera]]
name = "rear"
mirror_axis = "horizontal"
mirrors = "front"

[reflection]
words = { yard = "park" }
numbers = { speed = { sign = -1, about = 0.5 } }
"""


def robot(folder: Path) -> FrameBank:
    """Import a data set with the rig beside it."""
    rig = read_rig(folder / "rig.toml", of_table=False)
    ahead = Horizon(4, "absolute")
    return import_lerobot(folder / "set", folder / "bank", Choices(every=3, rig=rig), ahead=ahead)


def test_a_lerobot_data_set_says_by_a_rig_what_is_reflected(tmp_path: Path) -> None:
    """Its cameras by their short names, and the numbers of state and action by theirs."""
    arm(tmp_path / "set", inside=True)
    (tmp_path / "rig.toml").write_text(MIRRORED)
    bank = robot(tmp_path)
    space = bank.manifest.motion
    assert space is not None
    for many in (space.dimensions, space.state):
        assert [(one.sign, one.about) for one in many] == [(1, 0), (-1, 0.5)]
    assert "mirrored" in conditions_of(bank)[0]
    frame = bank.frames[0]
    seen = reflected(show("mirrored", frame, bank, 0), space)
    assert seen.state["state"] == (frame.state["state"][0], 1 - frame.state["state"][1])
    assert (decode(seen.images["front"], "") == decode(bank.images(frame)["rear"], "")[:, ::-1]).all()
    assert seen.fields == {"task": "cross the park"}


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('name = "rear"', 'name = "raer"', "did you mean 'rear'"),
        ("speed =", "sped =", "did you mean 'speed'"),
        ('name = "front"', 'name = "front"\ncolumn = "x"', "a LeRobotDataset declares its"),
    ],
)
def test_a_rig_that_does_not_fit_a_data_set_is_one_line(tmp_path: Path, old: str, new: str, said: str) -> None:
    """It names what there is."""
    arm(tmp_path / "set", inside=True)
    (tmp_path / "rig.toml").write_text(
        MIRRORED.replace('mirrors = "rear"\n', "").replace('mirrors = "front"\n', "").replace(old, new)
    )
    with pytest.raises(SpecError) as refused:
        robot(tmp_path)
    assert said in str(refused.value)
    assert not (tmp_path / "bank").exists()


@pytest.mark.parametrize("names", [{"action": None, "observation.state": None}, {"action": ["a", "b"]}, {}])
@pytest.mark.parametrize("changes", [False, True])
def test_the_kind_of_actions_is_told_by_the_data_whatever_their_names(
    tmp_path: Path, names: dict[str, list[str] | None], *, changes: bool
) -> None:
    """Places relative to the joint of the same place, or changes; the import says which, and the ratio."""
    reach(tmp_path / "set", names, changes=changes)
    bank = import_lerobot(tmp_path / "set", tmp_path / "bank", Choices(), ahead=Horizon(2))
    space, kind = bank.manifest.motion, "delta" if changes else "absolute"
    assert space is not None
    assert space.kind == kind
    assert [dimension.state for dimension in space.dimensions] == ([None, None] if changes else [0, 1])
    assert [line for line in taken(bank) if line.startswith(f"kind: {kind}, as the data tell: ")]


@pytest.mark.parametrize(("kind", "looks"), [("absolute", "changes"), ("delta", "places"), ("velocity", "places")])
def test_a_kind_that_the_data_deny_is_taken_with_a_warning(tmp_path: Path, kind: Kind, looks: str) -> None:
    """Where it agrees, there is none."""
    for changes in (False, True):
        reach(tmp_path / f"set-{changes}", {}, changes=changes)
        bank = import_lerobot(
            tmp_path / f"set-{changes}", tmp_path / f"bank-{changes}", Choices(), ahead=Horizon(2, kind)
        )
        assert bank.manifest.motion is not None
        assert bank.manifest.motion.kind == kind
        warned = [line for line in taken(bank) if line.startswith(f"warning: these numbers look like {looks}: ")]
        assert bool(warned) is (changes is (looks == "changes"))


def test_what_the_data_do_not_tell_is_as_the_names_say_or_asked_for(tmp_path: Path) -> None:
    """Names of the state's own numbers are places, and the import says so; of others nobody knows what they are."""
    pa, pq = arrow()
    for name, names in (("same", {}), ("others", {"action": ["a", "b"]})):
        reach(tmp_path / name, names)
        for path in sorted((tmp_path / name / "data").rglob("*.parquet")):
            table = pq.read_table(path)
            noise = np.random.default_rng(0).normal(size=(table.num_rows, 2)) * 0.7
            states = np.array(table["observation.state"].to_pylist())
            done = pa.array((states + noise * states.std(axis=0)).tolist())
            table = table.set_column(table.schema.get_field_index("action"), "action", done)
            pq.write_table(table, path)
    bank = import_lerobot(tmp_path / "same", tmp_path / "bank", Choices(), ahead=Horizon(3))
    assert bank.manifest.motion is not None
    assert bank.manifest.motion.kind == "absolute"
    (said,) = (line for line in taken(bank) if line.startswith("kind: absolute, as the names say; the data do not"))
    assert said.endswith("--kind declares another")
    with pytest.raises(SourceError, match=r"the data do not show the kind of the numbers of 'action' .* give it with"):
        import_lerobot(tmp_path / "others", tmp_path / "refused", Choices(), ahead=Horizon(3))
    assert not (tmp_path / "refused").exists()


def test_a_number_of_actions_that_hardly_varies_is_said_with_what_can_be_done(tmp_path: Path) -> None:
    """A data set declares no scale."""
    reach(tmp_path / "set", {}, changes=True)
    pa, pq = arrow()
    for path in sorted((tmp_path / "set" / "data").rglob("*.parquet")):
        table = pq.read_table(path)
        done = np.array(table["action"].to_pylist()) * [1, 1e-6]
        table = table.set_column(table.schema.get_field_index("action"), "action", pa.array(done.tolist()))
        pq.write_table(table, path)
    bank = import_lerobot(tmp_path / "set", tmp_path / "bank", Choices(), ahead=Horizon(2))
    said, alike = notes(bank)
    assert alike.startswith("cameras 'front' and 'rear' show the same picture in 80 of 80 moments")
    assert said.startswith("'speed' varies by 1e-06, the others by ")
    assert said.endswith("leave it out of the data set's 'action', or import a --table, whose --rig declares its scale")


def test_an_action_of_another_kind_is_said_and_one_number_is_no_vector(tmp_path: Path) -> None:
    """Somebody says what numbers are that go along with no change of the state."""
    arm(tmp_path / "set", inside=True, width=1)
    kinds: tuple[Kind, ...] = ("delta", "velocity")
    spaces = [
        import_lerobot(
            tmp_path / "set", tmp_path / kind, Choices(), ahead=Horizon(2, kind), camera=CAMERA
        ).manifest.motion
        for kind in kinds
    ]
    assert [space.kind for space in spaces if space is not None] == [*kinds]
    assert [space.shape for space in spaces if space is not None] == [(2, 1)] * 2


@pytest.mark.parametrize(
    ("what", "said"),
    [
        ("no action", "lists no feature 'action'"),
        ("no bytes", "has no bytes inside the data files"),
        ("no picture", "is damaged or no picture"),
        ("no column", "no camera has a picture"),
    ],
)
def test_pictures_inside_parquet_that_are_none_are_one_line(tmp_path: Path, what: str, said: str) -> None:
    """And nothing stays."""
    arm(tmp_path / "set", inside=True)
    pa, pq = arrow()
    if what == "no action":
        info = json.loads((tmp_path / "set/meta/info.json").read_text())
        del info["features"]["action"]
        (tmp_path / "set/meta/info.json").write_text(json.dumps(info))
    for path in sorted((tmp_path / "set/data").rglob("*.parquet")) if what != "no action" else ():
        table = pq.read_table(path)
        cells = {"no bytes": None, "no picture": b"GIF89a"}.get(what)
        column = pa.array([{"bytes": cells, "path": "x.png"}] * table.num_rows, table.schema.field(REAR).type)
        place = table.schema.get_field_index(REAR)
        changed = table.drop_columns([CAMERA, REAR]) if what == "no column" else table.set_column(place, REAR, column)
        pq.write_table(changed, path)
    with pytest.raises(SourceError, match=said) as refused:
        import_lerobot(tmp_path / "set", tmp_path / "bank", Choices(), ahead=Horizon(4, "delta"))
    assert "\n" not in str(refused.value)
    assert not (tmp_path / "bank").exists()
