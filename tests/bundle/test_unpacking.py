"""A file that came from anywhere does no harm: no path out, no link, no bomb, and one line that says what it is."""

import json
import shutil
import stat
import zipfile
from pathlib import Path

import pytest

import banks
import stand_ins
from bundles import repacked
from eyechart.bundle import reader, validate, write_bundle
from eyechart.bundle.contents import Recipe
from eyechart.bundle.reader import unpack
from eyechart.errors import BundleError
from eyechart.studies.battery import BatterySelection
from report_runs import make_run


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a run of four frames under three conditions."""
    folder = tmp_path_factory.mktemp("small")
    bank = banks.build_bank(folder / "bank").root
    conditions = ["real", "blank", "shuffled"]
    return make_run(bank, folder / "run", {"noisy": stand_ins.noisy}, extent=BatterySelection(4), conditions=conditions)


@pytest.fixture(scope="module")
def packed(run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return its bundle."""
    out = tmp_path_factory.mktemp("packed") / "run.zip"
    write_bundle(run, out, resamples=100)
    return out


def refused(file: Path, tmp_path: Path) -> str:
    """Return why a file is not unpacked, and see to it that nothing of it is outside its folder."""
    folder = tmp_path / "inside" / "deep"
    folder.mkdir(parents=True)
    before = sorted(path for path in tmp_path.rglob("*") if folder not in path.parents)
    with pytest.raises(BundleError) as error:
        unpack(file, folder)
    assert sorted(path for path in tmp_path.rglob("*") if folder not in path.parents) == before
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.mark.parametrize(
    "name",
    [
        "../out.txt",
        "run/bank/../../../out.txt",
        "/tmp/out.txt",  # noqa: S108 - a name that must be refused
        "run/bank//out.png",
        "run/bank/./out.png",
        "run/bank/C:out.png",
        "run/bank/a\x01b.png",
        f"run/bank/{'x' * 300}.png",
        "run/bank/images/",
        "elsewhere.txt",
        "run/other.sqlite",
        "tables/../../out.csv",
    ],
)
def test_a_name_that_is_no_part_of_a_bundle_is_refused(tmp_path: Path, name: str) -> None:
    """Before anything is written."""
    with zipfile.ZipFile(tmp_path / "b.zip", "w") as file:
        file.writestr("bundle.json", "{}")
        file.writestr(name, "x" if not name.endswith("/") else "")
    words = refused(tmp_path / "b.zip", tmp_path)
    assert "is no bundle" in words
    assert list((tmp_path / "inside" / "deep").iterdir()) == []


def test_backslashes_lead_nowhere(tmp_path: Path) -> None:
    """The zipfile module writes them as they are where they are no separators."""
    entry = zipfile.ZipInfo("x")
    entry.filename = "run/bank/..\\..\\out.png"
    with zipfile.ZipFile(tmp_path / "b.zip", "w") as file:
        file.writestr(entry, "x")
    assert "is not a plain file name" in refused(tmp_path / "b.zip", tmp_path)


def test_a_link_is_refused(tmp_path: Path) -> None:
    """Also where its name and its target are harmless."""
    entry = zipfile.ZipInfo("run/bank/images/a.png")
    entry.create_system, entry.external_attr = 3, (stat.S_IFLNK | 0o777) << 16
    with zipfile.ZipFile(tmp_path / "b.zip", "w") as file:
        file.writestr(entry, "/etc/passwd")
    assert "is a link or a folder" in refused(tmp_path / "b.zip", tmp_path)


def test_two_files_of_one_name_are_refused(tmp_path: Path) -> None:
    """What one reader shows another would not."""
    with zipfile.ZipFile(tmp_path / "b.zip", "w") as file:
        file.writestr("bundle.json", "{}")
        with pytest.warns(UserWarning, match="Duplicate name"):
            file.writestr("bundle.json", "[]")
    assert "it holds a name twice" in refused(tmp_path / "b.zip", tmp_path)


def test_a_file_in_the_place_of_a_folder_is_refused(tmp_path: Path) -> None:
    """One line, not a traceback."""
    with zipfile.ZipFile(tmp_path / "b.zip", "w") as file:
        file.writestr("run/bank/a", "x")
        file.writestr("run/bank/a/b.png", "x")
    assert "two of its files have the same path" in refused(tmp_path / "b.zip", tmp_path)


def test_a_bomb_is_not_unpacked(tmp_path: Path) -> None:
    """Neither a file that is larger than its kind may be, nor one that grows by more than a bundle does."""
    with zipfile.ZipFile(tmp_path / "a.zip", "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("run/bank/images/a.png", bytes(70_000_000))
    assert "more than the 64000000 that are allowed" in refused(tmp_path / "a.zip", tmp_path)
    shutil.rmtree(tmp_path / "inside")
    with zipfile.ZipFile(tmp_path / "b.zip", "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("report.html", bytes(70_000_000))
    assert "would grow from 0.1 MB to 70 MB" in refused(tmp_path / "b.zip", tmp_path)


def test_too_many_files_and_too_little_room_are_said(
    packed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before the first byte."""
    monkeypatch.setattr(reader, "MOST_FILES", 3)
    assert "more than the 3 that a bundle may" in refused(packed, tmp_path)
    shutil.rmtree(tmp_path / "inside")
    monkeypatch.undo()
    monkeypatch.setattr("shutil.disk_usage", lambda _: shutil._ntuple_diskusage(10, 10, 0))
    assert "needs more room to be unpacked" in refused(packed, tmp_path)


@pytest.mark.parametrize("how", ["empty", "text", "cut", "flipped", "directory"])
def test_a_damaged_file_is_no_bundle(packed: Path, tmp_path: Path, how: str) -> None:
    """Whatever is the matter with it: one line."""
    whole, file = packed.read_bytes(), tmp_path / "b.zip"
    middle = whole.index(b"report.html") + 500
    file.write_bytes(
        {
            "empty": b"",
            "text": b"not a zip at all",
            "cut": whole[: len(whole) // 2],
            "flipped": whole[:middle] + bytes([whole[middle] ^ 0xFF]) + whole[middle + 1 :],
            "directory": whole[:-30] + b"\xff" * 8 + whole[-22:],
        }[how]
    )
    with pytest.raises(BundleError, match="is no bundle"):
        validate(file)


def index_of(packed: Path, out: Path, **values: object) -> Path:
    """Write a copy of a bundle with other values in its index."""
    with zipfile.ZipFile(packed) as old, zipfile.ZipFile(out, "w") as new:
        for entry in old.infolist():
            content = old.read(entry)
            if entry.filename == "bundle.json":
                content = json.dumps(json.loads(content) | values).encode()
            new.writestr(entry, content)
    return out


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"format": "eyechart-bundle/9"}, "is no bundle of the format 'eyechart-bundle/1'"),
        ({"files": []}, "is no bundle of the format"),
        ({"eyechart": 9.9}, "eyechart is 9.9, not text"),
        ({"reader": "3"}, 'reader is "3", not a whole number'),
        ({"resamples": 10**9}, "resamples is 1000000000, not a whole number <= 100000"),
        ({"resamples": True}, "resamples is true"),
        ({"independent": "yes"}, "does not say how its results were made"),
        ({"drawn_with": None}, "does not say how its results were made"),
    ],
)
def test_a_bundle_that_cannot_be_recomputed_here_says_why(
    packed: Path, tmp_path: Path, values: dict[str, object], words: str
) -> None:
    """It names the value of its index that is none."""
    with pytest.raises(BundleError, match=words):
        validate(index_of(packed, tmp_path / "b.zip", **values))


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"eyechart": "9.9"}, "made by eyechart '9.9' with version 4 of the reader"),
        ({"reader": 99}, "with version 99 of the reader of replies"),
    ],
)
def test_a_bundle_of_another_version_is_validated_as_far_as_its_figures_are_computed_alike(
    packed: Path, tmp_path: Path, values: dict[str, object], words: str
) -> None:
    """Here all are; a figure and a table that are not are named, and no difference; a reply that is not is one."""
    found = validate(index_of(packed, tmp_path / "b.zip", **values))
    assert (found.differences, found.otherwise, found.uncompared) == ([], [], [])
    assert words in found.notes[-1]

    def change(folder: Path) -> None:
        results = json.loads((folder / "results.json").read_text())
        (model,) = results["score"]["models"]
        results["score"]["models"][model]["answered"] += 1
        results["replies_sha256"][model]["real"] = "0"
        (folder / "results.json").write_text(json.dumps(results))
        (folder / "tables" / "statistics.csv").write_text("")

    found = validate(repacked(tmp_path / "b.zip", tmp_path, change))
    assert [one.where.rpartition(", ")[2] for one in found.otherwise] == ["answered"]
    assert [difference.where.rpartition(", ")[2] for difference in found.differences] == ["real"]
    assert found.uncompared == ["tables/statistics.csv", "1 figures that this eyechart computes differently"]


def test_a_zip_without_an_index_is_no_bundle(tmp_path: Path) -> None:
    """Nor is a file that is not there."""
    with zipfile.ZipFile(tmp_path / "b.zip", "w") as file:
        file.writestr("results.json", "{}")
    with pytest.raises(BundleError, match=r"it has no bundle\.json that can be read"):
        validate(tmp_path / "b.zip")
    with pytest.raises(BundleError, match=r"'eyechart bundle RUN --out none\.zip' makes one"):
        validate(tmp_path / "none.zip")


def test_the_same_run_gives_the_same_bytes(run: Path, packed: Path, tmp_path: Path) -> None:
    """On another day, from another place, and while its ledger lies in another file."""
    shutil.copytree(run, tmp_path / "run")
    write_bundle(tmp_path / "run", tmp_path / "again.zip", resamples=100)
    assert (tmp_path / "again.zip").read_bytes() == packed.read_bytes()


def test_only_the_pictures_that_the_run_used_are_packed(packed: Path) -> None:
    """Of eighteen frames those four that were shown, and those that stood in for them."""
    with zipfile.ZipFile(packed) as file:
        pictures = [name for name in file.namelist() if name.startswith("run/bank/images/")]
        assert not any("lead_near" in name for name in file.namelist())
    assert 4 <= len(pictures) <= 8
    assert validate(packed).holds


def test_a_run_whose_pictures_are_gone_is_not_bundled(run: Path, tmp_path: Path) -> None:
    """And nothing stays at the place of the file."""
    shutil.copytree(run, tmp_path / "run")
    raw = json.loads((tmp_path / "run" / "run.json").read_text())
    (tmp_path / "run" / "run.json").write_text(json.dumps(raw | {"bank_path": str(tmp_path / "none")}))
    with pytest.raises(BundleError, match=r"are missing: .*give the bank with --frames"):
        write_bundle(tmp_path / "run", tmp_path / "out" / "b.zip")
    assert not (tmp_path / "out" / "b.zip").exists()


def test_what_fails_midway_leaves_the_file_of_before(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither half a bundle nor a part of one."""
    out = tmp_path / "b.zip"
    with zipfile.ZipFile(out, "w") as before:
        before.writestr("before", "a bundle of yesterday")
    kept = out.read_bytes()

    def fail(_: Path) -> None:
        raise BundleError("the disk is full")

    monkeypatch.setattr("eyechart.bundle.writer.check_names", fail)
    with pytest.raises(BundleError, match="the disk is full"):
        write_bundle(run, out, resamples=100)
    assert out.read_bytes() == kept
    assert [path.name for path in tmp_path.iterdir()] == ["b.zip"]


def test_a_recipe_is_read_as_it_was_written() -> None:
    """Name, resamples, word of independence, and versions."""
    recipe = Recipe.here("run", resamples=500, independent=True)
    assert Recipe.from_dict(json.loads(json.dumps(recipe.as_dict()))) == recipe
