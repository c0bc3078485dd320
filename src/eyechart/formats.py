"""What pictures of one's own come as: a row a format, from which the command, its help and its errors follow."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

from eyechart.errors import SourceError, SpecError, perhaps


@dataclass(frozen=True)
class Format:
    """A kind of source that becomes a bank.

    ``opens`` is ``module:function``, called with the folder, the bank's place, the `Choices`, ``reads`` and
    ``progress``, and of ``table``, ``camera`` and ``ahead`` those that are among its ``options``; ``convert`` is one
    too. ``folder`` says what the folder is, and ``sign`` is a file in it by which the format is recognised where
    no table is given. ``extra`` is what its libraries are installed with, and ``refuses`` says why it does not take an
    option of another.
    """

    opens: str
    folder: str
    options: tuple[str, ...]
    sign: str = ""
    extra: str = ""
    refuses: Mapping[str, str] = field(default_factory=dict)

    def importer(self) -> Callable[..., Any]:
        """Return what makes the bank; raises SourceError where a library of its extra is not installed."""
        module, _, function = self.opens.partition(":")
        try:
            found: Callable[..., Any] = getattr(import_module(module), function)
        except ImportError as error:
            raise SourceError(f"this needs {error.name}: pip install 'eyechart[{self.extra}]'") from error
        return found


FORMATS: dict[str, Format] = {
    "table": Format(
        "eyechart.importing.bank:import_table",
        "the pictures",
        ("table", "convert"),
        refuses={
            "ahead": "--horizon, --kind, --state and --action are for --format lerobot; of a --table, [motion] of "
            "--rig says them",
            "camera": "--camera is for --format lerobot; of a --table, --rig names the cameras",
        },
    ),
    "lerobot": Format(
        "eyechart.importing.lerobot:import_lerobot",
        "a LeRobotDataset",
        ("camera", "ahead"),
        sign="meta/info.json",
        extra="lerobot",
        refuses={
            "convert": "--convert is for the pictures of --table: those of a LeRobotDataset are made from its videos"
        },
    ),
}
"""Every format by its name in ``--format``."""


def takers(option: str) -> str:
    """Return in words of what an option is said."""
    return " or ".join(one.folder for one in FORMATS.values() if option in one.options)


def find_format(name: str | None, folder: Path, given: Collection[str]) -> Format:
    """Return the format of this name; ``given`` are the options that were used.

    Where no name and no table is given, a folder of another format than ``table`` is recognised.

    Raises SpecError for an unknown name, and where the format does not take what was given.
    """
    if name is not None and name not in FORMATS:
        raise SpecError(f"--format takes {' or '.join(FORMATS)}, not '{name}'{perhaps(name, tuple(FORMATS))}")
    found = FORMATS[name or "table"]
    if name is None and "table" not in given:
        found = next((one for one in FORMATS.values() if one.sign and (folder / one.sign).is_file()), found)
    if ("table" in found.options) != ("table" in given):
        others = " or ".join(known for known, one in FORMATS.items() if "table" not in one.options)
        raise SpecError(f"give --table FILE of the pictures, or --format {others}, and not both")
    for option in given:
        if option not in found.options:
            called = "--horizon" if option == "ahead" else f"--{option}"
            raise SpecError(found.refuses.get(option, f"{called} is not for {found.folder}: leave it out"))
    return found
