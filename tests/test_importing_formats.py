"""Every format in which pictures of one's own come: a contract test over the registry."""

import inspect
import tomllib
from pathlib import Path

import pytest
from typer.testing import CliRunner

from eyechart.cli.app import app
from eyechart.errors import SourceError, SpecError
from eyechart.formats import FORMATS, Format, find_format, takers
from eyechart.importing import Choices
from eyechart.looks import Pictures

OPTIONS = ("table", "camera", "ahead", "rate", "convert")
EXTRAS = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["project"]["optional-dependencies"]


def own(one: Format) -> dict[str, object]:
    """Return the arguments of a format that others do not take; what makes pictures plain is a choice."""
    given = {"table": Path("t.csv"), "camera": None, "ahead": None, "rate": None}
    return {name: value for name, value in given.items() if name in one.options}


@pytest.mark.parametrize("name", FORMATS)
def test_every_importer_is_called_alike(name: str, tmp_path: Path) -> None:
    """The folder, the bank's place, the choices, two counters and its options; no source is one line, and no bank."""
    one, nobody = FORMATS[name], tmp_path / "nobody"
    assert set(one.options) <= set(OPTIONS)
    assert one.extra in {"", *EXTRAS}
    make = one.importer()
    inspect.signature(make).bind(nobody, out=tmp_path, choices=Choices(), reads=None, progress=None, **own(one))
    with pytest.raises(SourceError) as error:
        make(nobody, out=tmp_path / "bank", choices=Choices(), reads=None, progress=None, **own(one))
    assert "\n" not in str(error.value)
    assert not (tmp_path / "bank").exists()


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_is_recognised(name: str, tmp_path: Path) -> None:
    """By its table, or by a file in its folder, and by its name."""
    given = ["table"] if "table" in FORMATS[name].options else []
    sign = tmp_path / (FORMATS[name].sign or ("demos.hdf5" if FORMATS[name].magic else "photo.png"))
    sign.parent.mkdir(exist_ok=True)
    sign.write_bytes(FORMATS[name].magic)
    assert find_format(None, tmp_path, given) is find_format(name, tmp_path, given) is FORMATS[name]


def test_a_format_that_is_named_is_taken_at_its_word(tmp_path: Path) -> None:
    """A folder that looks like another's is not taken for that one."""
    for one in ("photo.png", FORMATS["lerobot"].sign):
        (tmp_path / one).parent.mkdir(exist_ok=True)
        (tmp_path / one).touch()
    with pytest.raises(SpecError, match="give either --table FILE of the pictures"):
        find_format("table", tmp_path, [])
    given = ["frames", "import", str(tmp_path), "--out", str(tmp_path / "bank")]
    named, told = (CliRunner().invoke(app, [*given, *more]).exception for more in (["--format", "table"], []))
    assert "give either --table FILE of the pictures" in str(named)
    assert "no description of a LeRobotDataset" in str(told)


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("option", OPTIONS)
def test_what_a_format_does_not_take_is_refused(name: str, option: str, tmp_path: Path) -> None:
    """By the option's own name, and never by being ignored."""
    one = FORMATS[name]
    given = list(dict.fromkeys((*(["table"] if "table" in one.options else []), option)))
    if option in one.options:
        assert find_format(name, tmp_path, given) is one
        assert one.folder in takers(option)
        return
    with pytest.raises(SpecError, match="--horizon" if option == "ahead" else f"--{option}"):
        find_format(name, tmp_path, given)


def test_a_look_imports_as_the_table_of_formats_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By what a row opens, and by no importer that it knows itself."""
    made: list[str] = []
    monkeypatch.setattr(Format, "importer", lambda one: lambda *_, **given: made.append(f"{one.opens} {sorted(given)}"))
    (tmp_path / "t.csv").touch()
    Pictures(photos=tmp_path, table=tmp_path / "t.csv").bank(tmp_path / "look", lambda *_: None)
    assert made == [f"{FORMATS['table'].opens} ['choices', 'out', 'progress', 'table']"]


def test_a_library_that_is_not_installed_is_named_with_its_extra() -> None:
    """An importer may import its library at the top of its module."""
    missing = Format("eyechart.importing.no_such_module:import_it", "films", (), extra="lerobot")
    with pytest.raises(SourceError, match=r"this needs .*: pip install 'eyechart\[lerobot\]'"):
        missing.importer()


def test_a_format_that_nobody_has_is_named() -> None:
    """With the nearest that there is."""
    with pytest.raises(SpecError, match=r"--format takes table or .*, not 'lerobo'.*mean 'lerobot'"):
        find_format("lerobo", Path(), [])


@pytest.mark.parametrize(
    ("inner", "known"), [(".zgroup", "zarr"), ("1.0.0/dataset_info.json", "RLDS"), ("a.mcap", "MCAP")]
)
def test_a_format_that_is_not_read_is_named_with_the_way(tmp_path: Path, inner: str, known: str) -> None:
    """By the files in the folder, and by its name in --format."""
    (tmp_path / inner).parent.mkdir(exist_ok=True)
    (tmp_path / inner).touch()
    way = f"{known} is not read: convert it to a LeRobotDataset, and give that with --format lerobot"
    for name in (None, known.lower()):
        with pytest.raises(SpecError, match=way):
            find_format(name, tmp_path, [])
