"""Plain pictures, which every program shows alike: one upright still of 8-bit RGB.

`require_plain` refuses all others, and `made_plain` converts them by documented rules.
"""

import io
import struct
import zlib
from collections.abc import Iterator
from contextlib import suppress
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageColor, ImageOps

from eyechart.errors import BankError, SpecError, counted
from eyechart.frames.pictures import RGB, open_picture

PLAIN_FORMATS = ("PNG", "JPEG", "WEBP")
"""Formats that are kept unchanged."""
FORMATS = (*PLAIN_FORMATS, "BMP", "GIF", "TIFF")
"""Formats that can be converted to plain pictures."""
MEDIA_TYPES = {"PNG": "image/png", "JPEG": "image/jpeg", "WEBP": "image/webp"}

_ORIENTATION = 0x0112
_DEPTH_OF_PNG = 24
"""The place of the bit depth in a PNG's header, which is always its first chunk."""
_WHITE_16 = 257
"""The divisor of 16-bit values: 65535 is white."""
_WORDS = {
    "1": "is black and white",
    "L": "is grey",
    "P": "has a palette",
    "CMYK": "is of printing colours (CMYK)",
}


def require_plain(picture: bytes, name: str) -> str:
    """Return a plain picture's media type; raises BankError with all that is not plain in it.

    It must be a PNG, JPEG or WebP of one picture with 8 bits a channel, red, green and blue without
    transparency, and at most 25 megapixels. It must not depend on an EXIF orientation, which some
    programs ignore. It must hold all pixels that it declares, and nothing behind them.
    """
    with open_picture(picture, name, PLAIN_FORMATS) as found:
        if odd := [*_oddities(found, picture)]:
            raise BankError(f"'{name}' {'; it '.join(odd)}")
        pixels = np.asarray(found, dtype=np.uint8)
        if odd := [damage.words for damage in damages(picture, str(found.format), pixels)]:
            raise BankError(f"'{name}' {'; it '.join(odd)}")
        return MEDIA_TYPES[str(found.format)]


def _oddities(found: Image.Image, picture: bytes) -> Iterator[str]:
    """Yield, as words that follow a picture's name, what programs may show differently."""
    if (frames := getattr(found, "n_frames", 1)) > 1:
        yield f"holds {frames} pictures; save one still picture a frame"
    if _is_deep(found, picture):
        yield "has more than 8 bits a channel; save it with 8"
    elif found.mode in _WORDS:
        yield f"{_WORDS[found.mode]}; save it as red, green and blue"
    elif _is_clear(found):
        yield "has transparency, for which each program uses its own background; save it without"
    elif found.mode != "RGB":
        yield f"has the channels {found.mode}; save it as red, green and blue"
    if (turned := found.getexif().get(_ORIENTATION, 1)) not in {0, 1}:
        yield f"is turned only by EXIF orientation {turned}, which some models ignore; turn its pixels"


def _is_deep(found: Image.Image, picture: bytes) -> bool:
    of_png = found.format == "PNG" and picture[_DEPTH_OF_PNG] > 8
    return of_png or found.mode.startswith(("I", "F"))


def _is_clear(found: Image.Image) -> bool:
    return found.mode in {"RGBA", "LA", "PA", "La", "RGBa"} or "transparency" in found.info


def read_colour(words: str) -> tuple[int, int, int]:
    """Return a colour (red, green, blue of 255) from a name or #rrggbb; raises SpecError."""
    try:
        return ImageColor.getcolor(words, "RGB")[:3]  # type: ignore[index,return-value]
    except ValueError as error:
        raise SpecError(f"'{words}' is not a colour; give a name such as white, or #rrggbb") from error


def made_plain(
    picture: bytes, name: str, *, background: tuple[int, int, int] = (255, 255, 255), longest: int | None = None
) -> tuple[RGB, list[str]]:
    """Return a picture as plain pixels, shape (h, w, 3), and the conversions in words.

    The rules: it is turned by its EXIF orientation. Of several pictures the first is taken. 16 bits
    become 8, with 65535 as white. Transparent parts show ``background``. A colour profile is
    dropped. ``longest`` is the most pixels of its longer side. Without a conversion there are no
    words. Raises BankError if it is no picture, or has more than 16 bits.
    """
    with open_picture(picture, name, FORMATS) as found:
        done = [f"first of {frames}"] if (frames := getattr(found, "n_frames", 1)) > 1 else []
        deep = _is_deep(found, picture)
        for damage in damages(picture, str(found.format), np.asarray(found.convert("RGB"), dtype=np.uint8)):
            if damage.lost:
                raise BankError(f"'{name}' {damage.words}")
            done.append("bytes behind it")
        if found.mode == "F" or (found.mode == "I" and found.format != "PNG"):
            raise BankError(f"'{name}' has more than 16 bits a channel, and its white is unknown; save it with 8")
        if found.getexif().get(_ORIENTATION, 1) not in {0, 1}:
            done.append("turned")
        upright = ImageOps.exif_transpose(found)
        done += ["16 bits"] if deep else []
        if upright.mode.startswith("I"):
            grey = (np.asarray(upright).astype(np.int64) + _WHITE_16 // 2) // _WHITE_16
            upright = Image.fromarray(np.clip(grey, 0, 255).astype(np.uint8))
        elif _is_clear(upright):
            done.append("transparency")
            above = upright.convert("RGBA")
            below = Image.new("RGBA", above.size, (*background, 255))
            upright = Image.alpha_composite(below, above).convert("RGB")
        if upright.mode != "RGB":
            done += [] if deep else [_WORDS.get(upright.mode, upright.mode).removeprefix("is ").removeprefix("has ")]
            upright = upright.convert("RGB")
        if longest is not None and max(upright.size) > longest:
            done.append("made smaller")
            upright.thumbnail((longest, longest), Image.Resampling.LANCZOS)
        if found.format not in PLAIN_FORMATS and not done:
            done.append(f"{found.format}")
        return np.asarray(upright, dtype=np.uint8), done


_CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
"""Samples of a pixel by a PNG's colour type."""
_ADAM7 = ((0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2))
"""For each pass of an interlaced PNG: first column and row, and the steps between them."""
_FILLING = b"\x5a\xc3" * 32
"""Bytes that a JPEG decoder reads as blocks if some are missing, and ignores otherwise."""


class PictureDamage(NamedTuple):
    """A fault of a picture's data, in words that follow its name, and whether pixels are lost."""

    words: str
    lost: bool


def damages(picture: bytes, kind: str, pixels: RGB) -> Iterator[PictureDamage]:
    """Yield the faults of a decoded picture's data; ``kind`` is Pillow's format.

    Only PNG, JPEG and WebP are checked. libwebp itself refuses a WebP whose data end too early.
    """
    if kind == "PNG":
        yield from _of_png(picture)
    elif kind == "JPEG":
        yield from _of_jpeg(picture, pixels)
    elif kind == "WEBP":
        yield from _behind(picture, 8 + int.from_bytes(picture[4:8], "little"))


def _behind(picture: bytes, end: int) -> Iterator[PictureDamage]:
    if end > len(picture):
        yield PictureDamage(f"is damaged: it ends {end - len(picture)} bytes before its end", lost=True)
    elif (more := len(picture) - end) > 0:
        yield PictureDamage(f"has {counted(more, 'byte')} behind its end", lost=False)


def _of_png(picture: bytes) -> Iterator[PictureDamage]:
    width, height, bits, colour, _, _, interlaced = struct.unpack_from(">IIBBBBB", picture, 16)
    wanted = sum(
        _rows_bytes(*one, bits * _CHANNELS[colour]) for one in _passes(width, height, interlaced=bool(interlaced))
    )
    unpacked, stream, name, end = 0, zlib.decompressobj(), b"", 8
    for name, data, whole, end in _chunks(picture):  # noqa: B007 - the last one is asked below
        if not whole:
            yield PictureDamage(
                f"is damaged: its part {name.decode('latin-1')!r} is not what its checksum says", lost=True
            )
            return
        if name == b"IDAT":
            unpacked += _unpacked(stream, data, wanted - unpacked)
    if name != b"IEND":
        yield PictureDamage("is damaged: its end is missing", lost=True)
    if unpacked != wanted or not stream.eof or stream.unused_data:
        held = f"{unpacked} bytes of pixels" if unpacked <= wanted else "more bytes of pixels"
        yield PictureDamage(
            f"is damaged: its {width} × {height} pixels need {wanted} bytes, and it holds {held}", lost=True
        )
    yield from _behind(picture, end)


def _unpacked(stream: "zlib._Decompress", packed: bytes, wanted: int) -> int:
    """Return the size of an unpacked part, stopped soon after ``wanted`` or at damage."""
    result = 0
    with suppress(zlib.error):
        while packed and result <= wanted:
            result += len(stream.decompress(packed, 1 << 20))
            packed = stream.unconsumed_tail
    return result


def _chunks(picture: bytes) -> Iterator[tuple[bytes, bytes, bool, int]]:
    """Yield a PNG's parts up to its end: name, data, whether the checksum fits, and its end."""
    place, name = 8, b""
    while name != b"IEND" and place + 12 <= len(picture):
        length, name = struct.unpack_from(">I4s", picture, place)
        end = place + 12 + length
        check = picture[place + 4 : end - 4], picture[end - 4 : end]
        yield name, picture[place + 8 : end - 4], zlib.crc32(check[0]).to_bytes(4) == check[1], end
        place = end


def _passes(width: int, height: int, *, interlaced: bool) -> list[tuple[int, int]]:
    """Return the widths and heights of the pictures in a PNG's rows."""
    if not interlaced:
        return [(width, height)]
    return [(-(-(width - x) // across), -(-(height - y) // down)) for x, y, across, down in _ADAM7]


def _rows_bytes(width: int, height: int, bits: int) -> int:
    return height * (1 + (width * bits + 7) // 8) if width > 0 and height > 0 else 0


def _of_jpeg(picture: bytes, pixels: RGB) -> Iterator[PictureDamage]:
    """Yield a JPEG's faults: if filling behind a scan changes a pixel, the scan was too short."""
    ends, end = _scans(picture)
    filled = bytearray()
    before = 0
    for place in ends:
        filled += picture[before:place] + _FILLING
        before = place
    filled += picture[before:end]
    with Image.open(io.BytesIO(filled), formats=("JPEG",)) as opened:
        if not np.array_equal(np.asarray(opened.convert("RGB"), dtype=np.uint8), pixels):
            yield PictureDamage("is damaged: it declares more pixels than it holds", lost=True)
    yield from _behind(picture, end)


def _scans(picture: bytes) -> tuple[list[int], int]:
    """Return the end of each scan of a JPEG, also before a restart, and the picture's end."""
    ends, place, data = list[int](), 2, False
    while (place := picture.find(b"\xff", place)) >= 0 and place + 1 < len(picture):
        marker = picture[place + 1]
        if data and marker == 0x00:
            place += 2
            continue
        if marker == 0xFF:
            place += 1
            continue
        if data:
            ends.append(place)
        if marker == 0xD9:
            return ends, place + 2
        data = data and 0xD0 <= marker <= 0xD7
        if data or marker == 0x01 or place + 4 > len(picture):
            place += 2
            continue
        place += 2 + struct.unpack_from(">H", picture, place + 2)[0]
        data = marker == 0xDA
    return ends, len(picture) + 2
