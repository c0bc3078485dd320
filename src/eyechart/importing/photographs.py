"""Photographs of a table: their places, their checks, and their conversion on request."""

from collections import Counter
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path, PurePosixPath

from eyechart.errors import BankError, SourceError, plain_file, raising, whole_number
from eyechart.frames import MAX_IMAGE_BYTES, Provenance, encode, inside, made_plain, read_colour, require_plain
from eyechart.importing.edit_record import RecordedEdit, edit_above

_MOST_NAME = 1_000


@dataclass(frozen=True)
class Convert:
    """The conversion of pictures (`eyechart.frames.made_plain`) to upright 8-bit RGB PNGs.

    Transparent parts show ``background``, a colour's name or #rrggbb. Pictures whose longer side
    has more than ``longest`` pixels are made smaller. A picture that is plain, and not too large,
    stays as it is.
    """

    background: str = "white"
    longest: int | None = None

    def __post_init__(self) -> None:
        read_colour(self.background)
        if self.longest is not None:
            whole_number("longest, in pixels,", self.longest, 1)


@dataclass(frozen=True)
class Photographs:
    """The folder of a table's pictures; the table itself is in ``beside``.

    ``done`` counts conversions; ``strip`` is a prefix that is removed from every path. ``made`` is
    how the control pictures are said to be made.
    """

    folder: Path
    beside: Path
    convert: Convert | None = None
    done: Counter[str] = field(default_factory=Counter)
    strip: str = ""
    edit: RecordedEdit | None = None
    made: Provenance = ""

    @cached_property
    def _home(self) -> Path:
        return self.folder.resolve()

    def locate(self, name: str, what: str) -> str:
        """Return a picture's path inside the folder, with '/'; ``what`` names row and column.

        A path may also be relative to the table, if it leads into the folder. Raises SourceError if
        it leads outside.
        """
        path = name.strip()
        if len(path) > _MOST_NAME:
            raise SourceError(f"{what} is '{path[:60]}…', {len(path)} characters, which is no file's name")
        if "\\" in path and "/" not in path:
            path = path.replace("\\", "/")
        pure = PurePosixPath(self._stripped(path, what))
        if pure.is_absolute() and pure.is_relative_to(self._home.as_posix()):
            pure = pure.relative_to(self._home.as_posix())
        elif not pure.is_absolute() and not self._is_file(self.folder / pure):
            pure = self._from_table(pure) or pure
        try:
            inside(self.folder, str(pure))
        except BankError as error:
            none = error.__cause__  # a NUL, or a loop of links
            outside = f"leads outside {self.folder}, where the pictures must lie{self._advice(pure)}"
            why = f"is no file there: {none}" if none else outside
            raise SourceError(f"{what} is '{name}', which {why}") from error
        return str(pure)

    def _stripped(self, path: str, what: str) -> str:
        """Return a path without the prefix; raises SourceError if it has another beginning."""
        head = self.strip.replace("\\", "/").rstrip("/")
        if not head:
            return path
        if not path.startswith(f"{head}/"):
            raise SourceError(f"{what} is '{path}', which does not begin with --strip {self.strip}")
        return path[len(head) + 1 :]

    def _advice(self, pure: PurePosixPath) -> str:
        """Return the ``--strip`` that makes an absolute path one of the folder, "" if none does."""
        for place in range(1, len(pure.parts)):
            if self._is_file(self.folder / PurePosixPath(*pure.parts[place:])):
                return f"; --strip {PurePosixPath(*pure.parts[:place])} removes the other machine's folder"
        return ""

    def _from_table(self, pure: PurePosixPath) -> PurePosixPath | None:
        path = self.beside / pure
        if ".." in pure.parts or not self._is_file(path):
            return None
        home = path.resolve()
        return PurePosixPath(home.relative_to(self._home)) if home.is_relative_to(self._home) else None

    @staticmethod
    def _is_file(path: Path) -> bool:
        try:
            return path.is_file()
        except (OSError, ValueError):  # a name too long, or with a NUL
            return False

    def read(self, file: str, what: str) -> tuple[bytes, str]:
        """Return a picture's bytes and its name in a bank.

        Raises SourceError with row and file if it is not plain and no conversion was chosen.
        """
        with raising(SourceError, what, of=BankError):
            picture = self._bytes_of(file)
            if self.convert is None:
                _require_plain(picture, file)
                return picture, file
            pixels, done = made_plain(
                picture, file, background=read_colour(self.convert.background), longest=self.convert.longest
            )
        if not done:
            return picture, file
        self.done.update(["pictures", *done])
        return encode(pixels), file if file.lower().endswith(".png") else f"{file}.png"

    def _bytes_of(self, file: str) -> bytes:
        path = self.folder / file
        with raising(BankError, f"'{file}' cannot be read"):
            if not path.is_file():
                raise BankError(f"there is no picture '{file}' in {self.folder}")
            if path.stat().st_size > MAX_IMAGE_BYTES:
                raise BankError(f"'{file}' has {path.stat().st_size} bytes; the limit is {MAX_IMAGE_BYTES}")
            picture = plain_file(path).read_bytes()
        if self.edit is not None:
            home, place = self.beside.resolve(), path.resolve()
            self.edit.require_recorded(
                place.relative_to(home).as_posix() if place.is_relative_to(home) else file, picture
            )
        elif self.made != "edited":
            self._require_unedited(path.resolve(), file)
        return picture

    def _require_unedited(self, place: Path, file: str) -> None:
        """Raise BankError if the record of an edit, not beside the table, says that it made a picture."""
        above = edit_above(place, self._home)
        if above is not None and above[1].makes(above[0]):
            beside = place.parents[above[0].count("/")]
            raise BankError(
                f"'{file}' was made by an edit, as {beside / above[1].name} says: put the table into {beside}, or say "
                "--made edited"
            )


def _require_plain(picture: bytes, file: str) -> None:
    """Raise BankError if a picture is not plain, with the option that could convert it."""
    try:
        require_plain(picture, file)
    except BankError as error:
        try:
            made_plain(picture, file)
        except BankError:
            raise error from None
        raise BankError(f"{error}, or import with --convert") from error
