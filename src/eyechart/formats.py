"""The formats of a user's pictures; the import command, its help and its errors use this table."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

from eyechart.errors import SourceError, SpecError, raising, suggestion


@dataclass(frozen=True)
class Format:
    """A kind of source that becomes a bank.

    ``opens`` is ``module:function``. The function takes the folder, the bank's place, the
    `Choices`, ``reads`` and ``progress``. It also takes those of ``table``, ``camera`` and
    ``ahead`` that are in ``options``; ``convert`` is an option too. ``folder`` says what the folder
    is. Without a table, a folder with the file ``sign`` is of the format, and a file that begins
    with ``magic``, or a folder with such a file. ``extra`` installs its libraries, and ``refuses``
    says why it does not take another format's option. ``reads`` is ``module:function`` too: it
    opens a data set without its pictures, so that a look knows how many frames there are.
    """

    opens: str
    folder: str
    options: tuple[str, ...]
    sign: str = ""
    magic: bytes = b""
    extra: str = ""
    reads: str = ""
    refuses: Mapping[str, str] = field(default_factory=dict)

    def is_of(self, folder: Path) -> bool:
        """Return whether a folder or a file is of this format by its content."""
        if self.sign and (folder / self.sign).is_file():
            return True
        first = min(folder.glob("*.h*5"), default=folder) if folder.is_dir() else folder
        if not self.magic or not first.is_file():
            return False
        with raising(SourceError, f"{first} cannot be read"), first.open("rb") as file:
            return file.read(len(self.magic)) == self.magic

    def importer(self) -> Callable[..., Any]:
        """Return the function that makes the bank; raises SourceError without its extra."""
        return self._function(self.opens)

    def length(self, folder: Path) -> int:
        """Return the number of a data set's frames; raises SourceError where it cannot be read."""
        lengths = self._function(self.reads)(folder, None, every=True).episodes.lengths
        return sum(length or 0 for length in lengths.values())

    def _function(self, place: str) -> Callable[..., Any]:
        module, _, function = place.partition(":")
        try:
            result: Callable[..., Any] = getattr(import_module(module), function)
        except ImportError as error:
            raise SourceError(f"this needs {error.name}: pip install 'eyechart[{self.extra}]'") from error
        return result


FORMATS: dict[str, Format] = {
    "table": Format(
        "eyechart.importing.bank:import_table",
        "the pictures",
        ("table", "convert"),
        refuses={
            "ahead": "--horizon, --kind, --state and --action are for --format lerobot and hdf5; for a --table, "
            "[motion] in --rig gives them",
            "camera": "--camera is for --format lerobot and hdf5; for a --table, --rig names the cameras",
        },
    ),
    "lerobot": Format(
        "eyechart.importing.lerobot:import_lerobot",
        "a LeRobotDataset",
        ("camera", "ahead"),
        sign="meta/info.json",
        extra="lerobot",
        reads="eyechart.importing.lerobot:read_dataset",
        refuses={
            "convert": "--convert is for the pictures of --table: those of a LeRobotDataset are made from its videos"
        },
    ),
    "hdf5": Format(
        "eyechart.importing.demonstrations:import_hdf5",
        "demonstrations in HDF5",
        ("camera", "ahead", "rate"),
        magic=b"\x89HDF\r\n\x1a\n",
        extra="hdf5",
        reads="eyechart.importing.demonstrations:read_demonstrations",
        refuses={"convert": "--convert is for the pictures of --table: those of HDF5 are taken as they are stored"},
    ),
}
"""Every format by its name in ``--format``."""


UNREAD: Mapping[str, tuple[str, ...]] = {
    "zarr": (".zgroup", ".zarray", "zarr.json", "*/.zgroup", "*/.zarray"),
    "RLDS": ("dataset_info.json", "*.tfrecord*", "*/dataset_info.json", "*/*/dataset_info.json"),
    "MCAP": ("*.mcap",),
}
"""Formats that are not read, with patterns of their files."""


def unread(name: str | None, folder: Path) -> str:
    """Return the way for a source in a format that is not read, empty for another source."""
    given = (name or "").lower()
    for known, patterns in UNREAD.items():
        here = given == "" and (folder.suffix in {f".{known.lower()}", ".tfrecord"} or _has(folder, patterns))
        if here or given == known.lower():
            return f"; {known} is not read: convert it to a LeRobotDataset, and give that with --format lerobot"
    return ""


def _has(folder: Path, patterns: Sequence[str]) -> bool:
    return folder.is_dir() and any(next(folder.glob(pattern), None) is not None for pattern in patterns)


def format_of_data_set(folder: Path) -> Format:
    """Return the format of a data set by its content; where nothing tells, a LeRobotDataset."""
    return next((one for one in FORMATS.values() if one.reads and one.is_of(folder)), FORMATS["lerobot"])


def takers(option: str) -> str:
    """Return in words the sources that take an option."""
    return " or ".join(one.folder for one in FORMATS.values() if option in one.options)


def find_format(name: str | None, folder: Path, given: Collection[str]) -> Format:
    """Return the format of this name; ``given`` are the options used.

    Without a name and a table, the folder's format is recognised. Raises SpecError for an unknown
    name, and for options that the format does not take.
    """
    if name is not None and name not in FORMATS:
        way = suggestion(name, tuple(FORMATS)) or unread(name, folder)
        raise SpecError(f"--format takes {' or '.join(FORMATS)}, not '{name}'{way}")
    result = FORMATS[name or "table"]
    if name is None and "table" not in given:
        result = next((one for one in FORMATS.values() if one.is_of(folder)), result)
    if ("table" in result.options) != ("table" in given):
        others = " or ".join(known for known, one in FORMATS.items() if "table" not in one.options)
        raise SpecError(
            f"give either --table FILE of the pictures or --format {others}, not both{unread(None, folder)}"
        )
    for option in given:
        if option not in result.options:
            called = "--horizon" if option == "ahead" else f"--{option}"
            raise SpecError(result.refuses.get(option, f"{called} is not for {result.folder}: leave it out"))
    return result
