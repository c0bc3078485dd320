"""The formats of a user's pictures; the import command, its help and its errors use this table."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

from eyechart.errors import SourceError, SpecError, suggestion


@dataclass(frozen=True)
class Format:
    """A kind of source that becomes a bank.

    ``opens`` is ``module:function``. The function takes the folder, the bank's place, the
    `Choices`, ``reads`` and ``progress``. It also takes those of ``table``, ``camera`` and
    ``ahead`` that are in ``options``; ``convert`` is an option too. ``folder`` says what the folder
    is, and ``sign`` is the file that identifies the format without a table. ``extra`` installs its
    libraries, and ``refuses`` says why it does not take another format's option.
    """

    opens: str
    folder: str
    options: tuple[str, ...]
    sign: str = ""
    extra: str = ""
    refuses: Mapping[str, str] = field(default_factory=dict)

    def importer(self) -> Callable[..., Any]:
        """Return the function that makes the bank; raises SourceError without its extra."""
        module, _, function = self.opens.partition(":")
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
            "ahead": "--horizon, --kind, --state and --action are for --format lerobot; for a --table, [motion] in "
            "--rig gives them",
            "camera": "--camera is for --format lerobot; for a --table, --rig names the cameras",
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
    """Return in words the sources that take an option."""
    return " or ".join(one.folder for one in FORMATS.values() if option in one.options)


def find_format(name: str | None, folder: Path, given: Collection[str]) -> Format:
    """Return the format of this name; ``given`` are the options used.

    Without a name and a table, the folder's format is recognised. Raises SpecError for an unknown
    name, and for options that the format does not take.
    """
    if name is not None and name not in FORMATS:
        raise SpecError(f"--format takes {' or '.join(FORMATS)}, not '{name}'{suggestion(name, tuple(FORMATS))}")
    result = FORMATS[name or "table"]
    if name is None and "table" not in given:
        result = next((one for one in FORMATS.values() if one.sign and (folder / one.sign).is_file()), result)
    if ("table" in result.options) != ("table" in given):
        others = " or ".join(known for known, one in FORMATS.items() if "table" not in one.options)
        raise SpecError(f"give either --table FILE of the pictures or --format {others}, not both")
    for option in given:
        if option not in result.options:
            called = "--horizon" if option == "ahead" else f"--{option}"
            raise SpecError(result.refuses.get(option, f"{called} is not for {result.folder}: leave it out"))
    return result
