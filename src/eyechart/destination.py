"""Safe places for output files: never over a run's or bank's files, or another kind of file."""

import os
import re
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

from eyechart.errors import OutputError, raising
from eyechart.frames import own_folder
from eyechart.manifest import BANK, BANK_TEXT, EPISODES, LEDGER, RUN, is_run

GENERATOR = b'<meta name="generator" content="eyechart'
"""The beginning of every report."""
_HEAD = 4096
_FILM = re.compile(rb"GIF8|.{4}ftyp", re.DOTALL)


def _head(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(_HEAD)


KINDS: dict[str, Callable[[Path], bool]] = {
    "report": lambda path: path.suffix.lower() in {".html", ".htm"} or GENERATOR in _head(path),
    "film": lambda path: _FILM.match(_head(path)) is not None or GENERATOR in _head(path),
    "bundle": zipfile.is_zipfile,
    "request mode": lambda path: path.suffix.lower() == ".toml",
    "JUnit file": lambda path: path.suffix.lower() == ".xml",
    "picture": lambda path: path.suffix.lower() == ".png" or _head(path).startswith(b"\x89PNG"),
    "guardian": lambda path: b'"eyechart-guardian' in _head(path),
}
"""The kinds of output, each with a test of the files that it may replace."""


def require_free(out: Path, kind: str) -> None:
    """Raise OutputError if ``out`` may not become a file of one of ``KINDS``; writes nothing.

    It is refused if it is a folder, a file of a run or a bank, a file of another kind, or cannot be
    made.
    """
    with _written(out):
        require_foreign(out)
        if out.is_dir():
            raise OutputError(f"{out} is a folder; give the path of the {kind} to write, such as {out / 'NAME'}")
        if out.exists() and (not out.is_file() or (out.stat().st_size and not KINDS[kind](out))):
            raise OutputError(f"{out} exists and is no {kind}; it is not overwritten: choose another place")
        above = next(folder for folder in out.absolute().parents if folder.exists() or folder.is_symlink())
        if not above.is_dir() or not os.access(above, os.W_OK | os.X_OK):
            words = "cannot be written to" if above.is_dir() else "is no folder"
            raise OutputError(f"{out} cannot be written: {above} {words}; choose another place")


def require_foreign(out: Path) -> None:
    """Raise OutputError if ``out`` is a file of a run or of a bank."""
    for path in (Path(os.path.realpath(out.parent)) / out.name, Path(os.path.realpath(out))):
        for folder in path.parents:
            name = path.relative_to(folder).parts[0]
            run = is_run(folder) or (folder / LEDGER).is_file()
            if run and (name in {RUN, ".lock", BANK, EPISODES} or name.startswith(LEDGER)):
                raise OutputError(f"{out} belongs to the run {folder} and is not overwritten: choose another place")
            if (folder / BANK_TEXT[1]).is_file() and name in {*BANK_TEXT, "images"}:
                raise OutputError(f"{out} belongs to the bank {folder} and is not overwritten: choose another place")


@contextmanager
def whole(out: Path, kind: str) -> Iterator[Path]:
    """Yield a temporary path whose file replaces ``out`` once it is complete.

    Missing folders are made. A link is replaced, and its target stays. Raises OutputError as
    ``require_free`` does, if writing fails, or if another process writes there now; no part
    remains.
    """
    require_free(out, kind)
    with _written(out), own_folder(out, OutputError) as work:
        partial = work / f"made{out.suffix}"
        yield partial
        partial.replace(out)


def write_files(files: Mapping[str, bytes], folder: Path) -> list[Path]:
    """Write files by name into a folder, and return them; none is moved before all are complete.

    Raises OutputError if one may not be written there.
    """
    places = [folder / name for name in files]
    with _written(folder):
        for place in places:
            require_foreign(place)
        with own_folder(folder / "files", OutputError) as work:
            for name, content in files.items():
                (work / name).write_bytes(content)
            for place in places:
                (work / place.name).replace(place)
    return places


def _written(out: Path) -> AbstractContextManager[None]:
    return raising(OutputError, f"{out} cannot be written", "; choose another place")
