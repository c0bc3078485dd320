"""A picture of one's own is copied as it is, after a look at whether every model would see the same in it."""

import io
import warnings
from pathlib import Path, PurePosixPath

from PIL import Image, UnidentifiedImageError

from eyechart.errors import BankError, SourceError
from eyechart.frames import MAX_IMAGE_BYTES, decode, inside

FORMATS = ("PNG", "JPEG", "WEBP")
_ORIENTATION = 0x0112


def place_of(folder: Path, name: str, what: str) -> str:
    """Return a picture's path inside the folder, with '/' between its parts; raises SourceError where it leads outside.

    ``what`` names row and column in the message.
    """
    path = name.strip()
    if "\\" in path and "/" not in path:
        path = path.replace("\\", "/")
    pure = PurePosixPath(path)
    if pure.is_absolute() and pure.is_relative_to(folder.resolve().as_posix()):
        pure = pure.relative_to(folder.resolve().as_posix())
    try:
        inside(folder, str(pure))
    except BankError as error:
        raise SourceError(f"{what} is '{name}', which leads outside {folder}, where the pictures must lie") from error
    return str(pure)


def read_picture(folder: Path, file: str, what: str) -> bytes:
    """Return a picture's bytes; raises SourceError, naming row and file, where models could see different things.

    It must be one PNG, JPEG or WebP picture of 8 bits a channel, not above 25 megapixels or 64 MB, and not turned by
    a note (EXIF orientation) that some programs follow and others do not.
    """
    path = folder / file
    try:
        if not path.is_file():
            raise SourceError(f"{what}: there is no picture '{file}' in {folder}")
        if path.stat().st_size > MAX_IMAGE_BYTES:
            raise SourceError(f"{what}: '{file}' has {path.stat().st_size} bytes; the limit is {MAX_IMAGE_BYTES}")
        picture = path.read_bytes()
    except OSError as error:
        raise SourceError(f"{what}: '{file}' cannot be read: {error.strerror}") from error
    _check_kind(picture, file, what)
    try:
        decode(picture, file)
    except BankError as error:
        raise SourceError(f"{what}: {error}") from error
    return picture


def _check_kind(picture: bytes, file: str, what: str) -> None:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(io.BytesIO(picture), formats=FORMATS) as opened:
                mode, frames = opened.mode, getattr(opened, "n_frames", 1)
                turned = opened.getexif().get(_ORIENTATION, 1)
    except Image.DecompressionBombError as error:
        raise SourceError(f"{what}: '{file}' has too many pixels: {error}") from error
    except UnidentifiedImageError as error:
        raise SourceError(f"{what}: '{file}' is damaged or no picture of {', '.join(FORMATS)}") from error
    except (OSError, SyntaxError, ValueError, TypeError) as error:
        raise SourceError(f"{what}: '{file}' is damaged or no picture: {error}") from error
    if frames > 1:
        raise SourceError(f"{what}: '{file}' holds {frames} pictures; save one still picture a frame")
    if mode.startswith(("I", "F")):
        raise SourceError(f"{what}: '{file}' has more than 8 bits a channel; save it with 8")
    if turned not in {0, 1}:
        raise SourceError(
            f"{what}: '{file}' is turned only by a note (EXIF orientation {turned}), which not every model follows; "
            "turn its pixels, for example with 'mogrify -auto-orient'"
        )
