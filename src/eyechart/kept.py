"""What a command read in a run, kept beside the run until the run, the program or the settings change.

A kept reading is named by the digest of everything that it follows from. That is the content of the
run's files, the program with its numeric libraries, and what was asked. It is sealed with a key of the
user's own, so a reading that came with a foreign run, or was damaged, is not believed.
"""

import hashlib
import hmac
import json
import os
import secrets
import stat
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.util import find_spec
from itertools import chain, islice
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar

from eyechart.errors import MissingCallsWarning
from eyechart.records import parse_json

T = TypeVar("T")

FOLDER = ".reading"
"""The folder in a run that holds its kept readings."""
_RUN = "run.json"
_MOST_KEPT = 64
_MOST_FILES = 3_000_000
_KEY_BYTES = 32
_SEAL = 64
"""The hexadecimal digits of a seal, which a line feed follows."""
_OF_OTHERS = 0o077
"""The rights of everybody but the owner."""
_YOUNG_NS = 2_000_000_000
"""A file that changed this shortly before may change again within one tick of its clock."""
_LEFT_S = 3600.0
"""A part of a reading that is older than this was left by a command that was killed."""
_PICTURES = (".png", ".jpg", ".jpeg", ".webp", ".bmp", ".gif", ".mp4")
"""Files that no number follows from: a run holds the digests of its pictures in other files."""
_PASSING = ("-shm", ".lock", ".new")
"""Ends of names of files that only a process at work needs."""
_LIBRARIES = ("numpy", "scipy", "msgspec")


class _UnnamedError(Exception):
    """A folder cannot be named by its content."""


class _FileState(NamedTuple):
    """A file as the system describes it: path, size, time of its content's last change in ns, number.

    ``touched`` is the time in ns of the last change of anything, its name included.
    """

    path: str
    size: int
    changed: int
    number: int
    touched: int


@dataclass(frozen=True)
class _RunState:
    """A run's content: a digest of it with what was asked, and the states of its files."""

    digest: str
    files: tuple[list[_FileState], list[_FileState]]
    since: int

    def holds(self, folder: Path, request: Sequence[object]) -> bool:
        """Return whether the content is still the same; files changed lately are read again."""
        if any(one.changed > self.since - _YOUNG_NS for one in chain(*self.files)):
            return _seen(folder, request).digest == self.digest
        return _states(folder) == self.files


@dataclass(frozen=True)
class KeptForm(Generic[T]):
    """How a reading is written to a file and read back; None for one that cannot be written."""

    suffix: str
    write: Callable[[T], Sequence[memoryview] | None]
    read: Callable[[memoryview], T]
    most_bytes: int


JSON: KeptForm[Any] = KeptForm(
    "json", lambda values: [memoryview(json.dumps(values).encode())], lambda body: json.loads(bytes(body)), 64_000_000
)
"""Plain values; a first reading is what would be read back."""


def kept(
    folder: Path,
    request: Sequence[object],
    make: Callable[[], T],
    form: KeptForm[T] = JSON,
    *,
    fresh: bool = False,
    beside: Sequence[Path] = (),
) -> T:
    """Return what ``make`` reads in a run's folder, or what it read before.

    ``request`` names the command and its settings, and ``beside`` the files that it reads elsewhere.
    Every byte of the run is hashed by each process, but for pictures. With ``fresh`` the run is read anew,
    and that is kept. Nothing is kept where the folder cannot be written, the run changed meanwhile,
    or ``make`` warned.
    """
    try:
        key, before = _key(), _seen(folder, request := [*request, [_hashed(os.fspath(one)) for one in beside]])
    except (_UnnamedError, OSError):
        key = None
    if key is None:
        return _as_kept(make(), form)[0]
    file = folder / FOLDER / f"{before.digest}.{form.suffix}"
    if not fresh and (found := _opened(file, form, key)) is not None:
        return found[0]
    with _warned() as said:
        made, body = _as_kept(make(), form)
    with suppress(_UnnamedError, OSError):
        small = body is not None and sum(part.nbytes for part in body) < form.most_bytes
        if body is not None and small and not said and before.holds(folder, request):
            _keep(file, body, key)
    return made


def _as_kept(made: T, form: KeptForm[T]) -> tuple[T, Sequence[memoryview] | None]:
    """Return a reading as it is read back, with its bytes: a first answer equals a second one."""
    body = form.write(made)
    return (made if body is None or form is not JSON else form.read(body[0])), body


@contextmanager
def _warned() -> Iterator[list[warnings.WarningMessage]]:
    """Yield a list that grows with each warning of the block, which is shown if the user wants it.

    One of missing calls is listed whatever Python's options, and although this process showed it
    already; it is shown after the block.
    """
    said: list[warnings.WarningMessage] = []
    shown = warnings.showwarning

    def show(*given: Any, **more: Any) -> None:  # noqa: ANN401 - as warnings calls it
        said.append(one := warnings.WarningMessage(*given, **more))
        if not issubclass(one.category, MissingCallsWarning):
            shown(*given, **more)

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("always", MissingCallsWarning)
            warnings.showwarning = show
            yield said
    finally:
        for one in said:
            if issubclass(one.category, MissingCallsWarning):
                warnings.warn_explicit(one.message, one.category, one.filename, one.lineno)


def _opened(file: Path, form: KeptForm[T], key: bytes) -> tuple[T] | None:
    """Return what a file keeps, in a tuple; None unless it is whole and of this user."""
    with suppress(OSError, ValueError, LookupError, TypeError, RecursionError):
        if not stat.S_ISREG(file.lstat().st_mode) or file.lstat().st_size > form.most_bytes:
            return None
        content = memoryview(file.read_bytes())
        seal, body = bytes(content[:_SEAL]), content[_SEAL + 1 :]
        if hmac.compare_digest(seal, _sealed(file.name, [body], key)):
            return (form.read(body),)
    return None


def _keep(file: Path, body: Sequence[memoryview], key: bytes) -> None:
    """Write a reading whole or not at all; remove the oldest beyond a number of them."""
    file.parent.mkdir(exist_ok=True)
    for left in file.parent.glob(".*.new"):
        if left.lstat().st_mtime < time.time() - _LEFT_S:
            left.unlink(missing_ok=True)
    partial = file.with_name(f".{file.stem}.{os.getpid()}.{secrets.token_hex(4)}.new")
    try:
        with partial.open("xb") as out:
            out.write(_sealed(file.name, body, key) + b"\n")
            out.writelines(body)
        partial.replace(file)
    finally:
        partial.unlink(missing_ok=True)
    every = sorted(file.parent.glob(f"*.{file.suffix[1:]}"), key=lambda one: one.stat().st_mtime_ns)
    for old in every[: -_MOST_KEPT if file.suffix == ".json" else -1]:
        old.unlink(missing_ok=True)


def _sealed(name: str, body: Sequence[memoryview], key: bytes) -> bytes:
    seal = hmac.new(key, name.encode() + b"\n", "sha256")
    for part in body:
        seal.update(part)
    return seal.hexdigest().encode()


@cache
def _key() -> bytes | None:
    """Return this user's key, made at its first use; None where no home can hold it.

    One that others could read or write is replaced.
    """
    with suppress(OSError, RuntimeError):
        place = Path.home() / ".cache" / "eyechart" / "readings.key"
        with suppress(FileNotFoundError):
            found = place.lstat()
            if not stat.S_ISREG(found.st_mode) or found.st_uid != os.geteuid():
                return None
            if stat.S_IMODE(found.st_mode) & _OF_OTHERS:
                place.unlink()
        if not place.exists():
            _make_key(place)
        with place.open("rb") as file:
            key = file.read(_KEY_BYTES + 1)
        return key if len(key) == _KEY_BYTES else None
    return None


def _make_key(place: Path) -> None:
    place.parent.mkdir(parents=True, exist_ok=True)
    partial = place.with_name(f".{place.name}.{os.getpid()}.new")
    try:
        partial.touch(0o600)
        partial.write_bytes(secrets.token_bytes(_KEY_BYTES))
        with suppress(FileExistsError):  # another process was first
            os.link(partial, place)
    finally:
        partial.unlink(missing_ok=True)


def _seen(folder: Path, request: Sequence[object]) -> _RunState:
    """Return the state of a run; raises _UnnamedError or OSError where it cannot be named."""
    since, (files, others) = time.time_ns(), _states(folder)
    digest = hashlib.sha256(json.dumps([_program(), os.fspath(folder), request]).encode())
    for one in files:
        is_picture = one.path.lower().endswith(_PICTURES)
        content = f"{one.size} {one.changed}" if is_picture else _content(one, since)
        digest.update(f"{one.path}\0{content}\n".encode(errors="surrogateescape"))
    digest.update("".join(f"{one[:4]}\n" for one in others).encode(errors="surrogateescape"))
    return _RunState(digest.hexdigest(), (files, others), since)


def _content(file: _FileState, now: int) -> str:
    """Return the digest of a file's content, which one that nobody touched lately keeps in this process."""
    return _hashed_in(file) if max(file.changed, file.touched) <= now - _YOUNG_NS else _hashed(file.path)


@lru_cache(maxsize=256)
def _hashed_in(file: _FileState) -> str:
    return _hashed(file.path)


def _states(folder: Path) -> tuple[list[_FileState], list[_FileState]]:
    """Return the states of a run's files, and of the bank elsewhere that its pictures came from."""
    own = list(islice(_files(folder), _MOST_FILES))
    banks = (place for one in own if one.path.endswith(f"{os.sep}{_RUN}") for place in _bank_of(Path(one.path)))
    others = list(islice(chain(*map(_files, banks)), _MOST_FILES))
    if _MOST_FILES in {len(own), len(others)}:
        raise _UnnamedError
    return own, others


def _hashed(path: str) -> str:
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _bank_of(run: Path) -> Iterator[Path]:
    """Yield the place of a run's pictures outside it, by its ``run.json``, where it is there."""
    with suppress(ValueError, RecursionError):
        said = parse_json(run.read_bytes())
        if isinstance(said, dict) and isinstance(place := said.get("bank_path"), str) and Path(place).is_dir():
            yield Path(place)


def _files(folder: Path) -> Iterator[_FileState]:
    """Yield the state of every file below a folder, by name; linked folders and pipes are no run."""
    with os.scandir(folder) as inside:
        entries = sorted(inside, key=lambda one: one.name)
    for entry in entries:
        if entry.is_dir():
            if entry.is_symlink():
                raise _UnnamedError
            if entry.name != FOLDER:
                yield from _files(Path(entry.path))
        elif not entry.name.endswith(_PASSING):
            yield _state(entry.path)


def _state(path: str) -> _FileState:
    found = os.stat(path)  # noqa: PTH116 - of every picture of a bank
    if not stat.S_ISREG(found.st_mode):
        raise _UnnamedError
    return _FileState(path, found.st_size, found.st_mtime_ns, found.st_ino, found.st_ctime_ns)


@cache
def _program() -> str:
    """Return a digest of this program's files and of the libraries that its numbers rest on."""
    digest = hashlib.sha256(sys.version.encode())
    for one in _files(Path(__file__).parent):
        if not one.path.endswith(".pyc"):
            with open(one.path, "rb") as file:  # noqa: PTH123 - hundreds of them, at every command
                content = file.read()
            digest.update(f"{one.path.removeprefix(os.path.dirname(__file__))}\0{one.size}\n".encode() + content)  # noqa: PTH120
    for name in _LIBRARIES:
        found = find_spec(name)
        version = Path((found and found.origin) or "").with_name("version.py")
        version = version if version.is_file() else version.with_name("_version.py")
        digest.update(version.read_bytes() if version.is_file() else b"")
    return digest.hexdigest()
