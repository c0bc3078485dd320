"""Pictures on disk, with limits on bytes before reading and on pixels before decoding."""

import hashlib
import io
import math
import os
import struct
import warnings
import zlib
from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from stat import S_ISLNK, S_ISREG
from threading import RLock
from types import MappingProxyType
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from eyechart.errors import BankError, above_streams, raising

RGB = NDArray[np.uint8]
MAX_PIXELS = 25_000_000
MAX_IMAGE_BYTES = 64_000_000
_PNG, _BARE, _UP = b"\x89PNG\r\n\x1a\n", bytes([8, 2, 0, 0, 0]), 2
_UNCOMPRESSED, _BLOCK = b"\x78\x01", 0xFFFF
"""The head of a stream of zlib, and the most bytes of a block that is not compressed."""
_RAW, _BAND, _ADLER = -15, 3, 65_521
"""Deflate without zlib's head, the fewest equal rows that are taken from a stock, Adler-32's modulus."""
_FORMATS = ("PNG", "JPEG", "WEBP", "BMP")
_SOUND_KEPT = 100_000
_SOUND: set[bytes] = set()
"""The digests of pictures that were decoded whole in this process, or encoded."""

_TYPES = {b"\x89PNG": "image/png", b"\xff\xd8": "image/jpeg", b"RIFF": "image/webp", b"BM": "image/bmp"}

K = TypeVar("K", bound=Hashable)
T = TypeVar("T")


class BoundedCache(Generic[K, T]):
    """A cache of recent items by name, limited in bytes, by ``size``, and in number.

    Threads may use it at once; while one makes an item, the others wait.
    """

    def __init__(self, size: Callable[[T], int], most_bytes: int, most: int) -> None:
        self._kept: OrderedDict[K, T] = OrderedDict()
        self._size, self._most_bytes, self._most = size, most_bytes, most
        self._bytes, self._alone = 0, RLock()

    def get(self, name: K, make: Callable[[], T]) -> T:
        """Return the item of a name, and make it if it is not cached."""
        with self._alone:
            if name in self._kept:
                self._kept.move_to_end(name)
                return self._kept[name]
            made = self._kept[name] = make()
            self._bytes += self._size(made)
            while self._bytes > self._most_bytes or len(self._kept) > self._most:
                _, dropped = self._kept.popitem(last=False)
                self._bytes -= self._size(dropped)
            return made


_DECODED: BoundedCache[bytes, RGB] = BoundedCache(lambda pixels: pixels.nbytes, 32_000_000, 2_000)
"""Decoded pictures. Small ones, which a run shows under many conditions, stay; of large ones only
the last few do."""


def inside(root: Path, file: str) -> Path:
    """Return the path of a bank's file; raises BankError if it leads outside the bank."""
    path = root / file
    try:
        home, real = _resolved(_absolute(str(root))), _real(str(path))
        within = real == home or real.startswith(home if home.endswith("/") else f"{home}/")
        outside = file.startswith("/") or ".." in file.split("/") or not within
    except (OSError, ValueError, RuntimeError) as error:  # a name too long, with a NUL, or a loop of links
        raise BankError(f"{file!r} is not a file of the bank {root}: {error}") from error
    if outside:
        raise BankError(f"'{file}' leads outside the bank {root}; a bank's pictures must lie inside it")
    return path


def _real(path: str) -> str:
    """Return a resolved path; its folder is cached, a link in its last part is followed anew."""
    with suppress(OSError):
        if S_ISLNK(os.lstat(path).st_mode):
            return str(Path(path).resolve())
    folder, name = os.path.split(path)
    return os.path.join(_resolved(_absolute(folder)), name)  # noqa: PTH118 - of every picture: a Path takes longer


def _absolute(folder: str) -> str:
    return folder if folder.startswith("/") else os.path.join(os.getcwd(), folder)  # noqa: PTH109, PTH118 - as above


@lru_cache(maxsize=64)
def _resolved(folder: str) -> str:
    """Return a bank's absolute folder without links; a bank does not move while it is read."""
    return str(Path(folder).resolve())


def read_bounded(root: Path, file: str) -> bytes:
    """Return a bank file's bytes.

    Raises BankError if the file is missing, not a regular file, outside the bank, or above 64 MB.
    """
    path = inside(root, file)
    with raising(BankError, f"'{file}' of the bank {root} cannot be read"):
        found = path.stat()
        if not S_ISREG(found.st_mode):
            raise BankError(f"'{file}' of the bank {root} is not a file")
        if found.st_size > MAX_IMAGE_BYTES:
            raise BankError(f"'{file}' has {found.st_size} bytes; the limit is {MAX_IMAGE_BYTES}")
        with open(path, "rb", buffering=0, opener=above_streams) as opened:
            return opened.readall()


def media_type(picture: bytes) -> str:
    """Return a picture's media type by its first bytes; PNG's for an unknown one."""
    for sign, kind in _TYPES.items():
        if picture.startswith(sign):
            return kind
    return "image/png"


def size_of(picture: bytes, name: str) -> tuple[int, int]:
    """Return an encoded picture's width and height from its header, without decoding.

    Raises BankError with the picture's name if it is no picture.
    """
    if is_bare(picture) and zlib.crc32(picture[12:29]).to_bytes(4) == picture[29:33]:
        width, height = struct.unpack_from(">II", picture, 16)
        if 0 < width * height <= MAX_PIXELS:
            return width, height
    with _opened(picture, name, _FORMATS) as found:
        return found.size


def decode(picture: bytes, name: str) -> RGB:
    """Decode a picture to RGB, shape (h, w, 3), uint8, after a check of its size.

    Raises BankError with the picture's name if it is no picture, is truncated, or has more than 25
    megapixels.
    """
    with open_picture(picture, name, _FORMATS) as found:
        return np.asarray(found if found.mode == "RGB" else found.convert("RGB"), dtype=np.uint8)


def pixels_of(picture: bytes, name: str) -> RGB:
    """Return a picture's pixels as `decode` does, cached and copied for the caller."""
    return _DECODED.get(picture, lambda: decode(picture, name)).copy()


def digest_of_sound(picture: bytes, name: str) -> str:
    """Return the SHA-256, in hex, of a picture that can be decoded; each is decoded once.

    Raises BankError as `decode` does.
    """
    found = hashlib.sha256(picture)
    if found.digest() not in _SOUND:
        with open_picture(picture, name, _FORMATS) as image:
            image.load() if image.mode == "RGB" else image.convert("RGB")
        _remember_sound(found.digest())
    return found.hexdigest()


def encode_sound(rgb: RGB) -> bytes:
    """Encode a picture as `encode` does; one that this process made need not be decoded to be found sound."""
    picture = encode(rgb)
    _remember_sound(hashlib.sha256(picture).digest())
    return picture


def _remember_sound(digest: bytes) -> None:
    if len(_SOUND) >= _SOUND_KEPT:
        _SOUND.clear()
    _SOUND.add(digest)


_PHONES = {
    "HEIC": (b"heic", b"heix", b"hevc", b"hevx", b"heim", b"heis", b"mif1", b"msf1"),
    "AVIF": (b"avif", b"avis"),
}
"""Formats of phones' photographs, by the brand in their first box (ISO/IEC 23008-12)."""


@contextmanager
def open_picture(picture: bytes, name: str, formats: tuple[str, ...]) -> Iterator[Image.Image]:
    """Open a picture of one of these formats and of allowed size, without decoding it.

    Inside the context, errors of Pillow become BankErrors with the picture's name: it is no such
    picture, is truncated, or has more than 25 megapixels.
    """
    with _opened(picture, name, formats) as result:
        width, height = result.size
        if width * height > MAX_PIXELS:
            raise BankError(f"'{name}' has {width}×{height} pixels; the limit is {MAX_PIXELS // 1_000_000} megapixels")
        yield result


@contextmanager
def _opened(picture: bytes, name: str, formats: tuple[str, ...]) -> Iterator[Image.Image]:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Pillow warns of oddities in a picture, here or later
            _refuse_vast(picture)
            result = Image.open(io.BytesIO(picture), formats=formats)
            with result:
                yield result
    except Image.DecompressionBombError as error:
        raise BankError(f"'{name}' has more than {MAX_PIXELS // 1_000_000} megapixels") from error
    except UnidentifiedImageError as error:
        raise BankError(f"'{name}' {_unread(picture, formats)}") from error
    except (OSError, SyntaxError, ValueError, TypeError, ArithmeticError, LookupError, struct.error) as error:
        raise BankError(f"'{name}' is damaged or no picture: {error}") from error


def _unread(picture: bytes, formats: tuple[str, ...]) -> str:
    """Return, as words that follow a picture's name, why its format cannot be read."""
    brand = picture[8:12].lower() if picture[4:8] == b"ftyp" else b""
    kind = next((kind for kind, brands in _PHONES.items() if brand in brands), None)
    if kind is None:
        return f"is damaged or no picture of {', '.join(formats)}"
    return f"is a picture of the format {kind}, which is not read; save it as PNG or JPEG, as with 'magick IN OUT.png'"


def _refuse_vast(picture: bytes) -> None:
    """Raise DecompressionBombError if a WebP claims too many pixels.

    Opening a WebP allocates memory for all of them, twice. Source: RFC 9649, sections 2.5 to 2.7,
    on the three kinds of first chunks.
    """
    if picture[:4] != b"RIFF" or picture[8:12] != b"WEBP" or len(picture) < 30:
        return
    kind, bits = picture[12:16], int.from_bytes(picture[21:25], "little")
    if kind == b"VP8X":
        sides = [int.from_bytes(picture[at : at + 3], "little") + 1 for at in (24, 27)]
    elif kind == b"VP8L":
        sides = [(bits >> shift & 0x3FFF) + 1 for shift in (0, 14)]
    else:
        sides = [int.from_bytes(picture[at : at + 2], "little") & 0x3FFF for at in (26, 28)]
    if sides[0] * sides[1] > MAX_PIXELS:
        raise Image.DecompressionBombError


def beside(images: Mapping[str, bytes], name: str) -> bytes | None:
    """Return several cameras' pictures side by side as one; a single one as it is, else None."""
    if len(images) < 2:
        return next(iter(images.values()), None)
    seen = [decode(image, f"{name}, {camera}") for camera, image in images.items()]
    high = max(one.shape[0] for one in seen)
    return encode(np.hstack([np.pad(one, ((0, high - one.shape[0]), (0, 0), (0, 0))) for one in seen]))


def as_png(picture: bytes, name: str, write: Callable[[RGB], bytes]) -> bytes:
    """Return a picture as an 8-bit PNG without metadata, as ``write`` makes it of its pixels.

    Such a PNG stays as it is. Raises BankError as `decode` does.
    """
    return picture if is_bare(picture) else write(decode(picture, name))


def is_bare(picture: bytes) -> bool:
    """Return whether a picture is an 8-bit RGB PNG, not interlaced, without metadata."""
    if picture[:8] != _PNG or picture[24:29] != _BARE:
        return False
    at, kinds = 8, set[bytes]()
    while at + 8 <= len(picture):
        kinds.add(picture[at + 4 : at + 8])
        at += 12 + int.from_bytes(picture[at : at + 4], "big")
    return kinds == {b"IHDR", b"IDAT", b"IEND"} and at == len(picture)


def encode(rgb: RGB) -> bytes:
    """Encode an RGB picture, shape (h, w, 3), uint8, as PNG."""
    buffer = io.BytesIO()
    Image.fromarray(rgb, mode=None).save(buffer, "PNG", compress_level=1)
    return buffer.getvalue()


def packed(rgb: RGB) -> bytes:
    """Encode an RGB picture, shape (h, w, 3), uint8, as PNG whose rows differ from those above.

    One filter (Up) and run lengths: for pictures of simulators and of cameras this takes a third of
    the time of `encode`, which tries five filters, and fewer bytes.
    """
    high, wide, _ = rgb.shape
    deflate = zlib.compressobj(1, strategy=zlib.Z_RLE)
    return _png(wide, high, deflate.compress(_differences(rgb).data), deflate.flush())


def banded(rgb: RGB) -> bytes:
    """Encode a picture as `packed` does, with rows that equal those above from a stock of streams.

    Most rows of a simulator's picture equal the row above. Runs of them are not compressed anew.
    """
    high, wide, _ = rgb.shape
    rows = _differences(rgb)
    moved = [0, *(np.flatnonzero(rows[1:, 1:].any(axis=1)) + 1).tolist(), high]
    deflate = zlib.compressobj(1, wbits=_RAW, strategy=zlib.Z_RLE)
    data, check, begin = [_UNCOMPRESSED], 1, 0
    for last, further in pairwise(moved):
        # The first row of a band belongs to the part before: its end is then the zero that a band ends with too.
        if (still := further - last - 2) < _BAND:
            continue
        part = rows[begin : last + 2].data
        data += (deflate.compress(part), deflate.flush(zlib.Z_SYNC_FLUSH), _band(still, wide))
        check, begin = _checked_band(zlib.adler32(part, check), still, wide), further
    part = rows[begin:].data
    check = zlib.adler32(part, check)
    return _png(wide, high, *data, deflate.compress(part), deflate.flush(), struct.pack(">I", check))


def _differences(rgb: RGB) -> NDArray[np.uint8]:
    """Return a picture's rows less those above, each with the sign of the filter (Up)."""
    high, wide, _ = rgb.shape
    flat, rows = rgb.reshape(high, 3 * wide), np.empty((high, 1 + 3 * wide), dtype=np.uint8)
    rows[:, 0], rows[0, 1:] = _UP, flat[0]
    np.subtract(flat[1:], flat[:-1], out=rows[1:, 1:])
    return rows


@lru_cache(maxsize=2_000)
def _band(high: int, wide: int) -> bytes:
    """Return so many rows that equal those above as a part of a stream of deflate."""
    deflate = zlib.compressobj(1, wbits=_RAW, strategy=zlib.Z_RLE)
    return deflate.compress((bytes([_UP]) + bytes(3 * wide)) * high) + deflate.flush(zlib.Z_SYNC_FLUSH)


def _checked_band(check: int, high: int, wide: int) -> int:
    """Return a checksum (Adler-32, RFC 1950) continued over so many rows that equal those above."""
    low, sums = check & 0xFFFF, check >> 16
    sums += (1 + 3 * wide) * (high * low + _UP * high * (high + 1) // 2)
    return (sums % _ADLER) << 16 | (low + _UP * high) % _ADLER


def stored(rgb: RGB) -> bytes:
    """Encode an RGB picture, shape (h, w, 3), uint8, as an uncompressed PNG (RFC 2083)."""
    high, wide, _ = rgb.shape
    return _png(wide, high, zlib.compress(_rows(rgb).data, 0))


def in_blocks(rgb: RGB) -> bytes:
    """Encode a picture as `stored` does, in whole blocks (RFC 1951): the same by every zlib, faster."""
    high, wide, _ = rgb.shape
    rows = _rows(rgb).data.cast("B")
    data: list[bytes | memoryview] = [_UNCOMPRESSED]
    for at in range(0, len(rows), _BLOCK):
        block = rows[at : at + _BLOCK]
        data += (struct.pack("<?HH", at + _BLOCK >= len(rows), len(block), len(block) ^ _BLOCK), block)
    return _png(wide, high, *data, struct.pack(">I", zlib.adler32(rows)))


def _rows(rgb: RGB) -> NDArray[np.uint8]:
    """Return a picture's rows as a PNG without filters holds them."""
    high, wide, _ = rgb.shape
    rows = np.empty((high, 1 + 3 * wide), dtype=np.uint8)
    rows[:, 0], rows[:, 1:] = 0, rgb.reshape(high, 3 * wide)
    return rows


def _png(wide: int, high: int, *data: bytes | memoryview) -> bytes:
    """Return an 8-bit RGB PNG of compressed rows; ``data`` is not joined or copied before."""
    parts: list[bytes | memoryview] = [_PNG]
    head = struct.pack(">II", wide, high) + _BARE
    for name, pieces in ((b"IHDR", (head,)), (b"IDAT", data), (b"IEND", ())):
        check = zlib.crc32(name)
        for piece in pieces:
            check = zlib.crc32(piece, check)
        parts += (struct.pack(">I", sum(map(len, pieces))), name, *pieces, struct.pack(">I", check))
    return b"".join(parts)


def noises(seed: int, shapes: Sequence[tuple[int, ...]]) -> Iterator[RGB]:
    """Yield random pictures of these shapes, the values of ``default_rng(seed).integers(0, 256)``.

    The bytes of the generator's words are these values, and four times as fast.
    """
    words = [-(-math.prod(shape) // 4) for shape in shapes]
    drawn = np.random.default_rng(seed).bit_generator.random_raw(-(-sum(words) // 2))
    values, at = drawn.astype("<u8", copy=False).view(np.uint8), 0
    for shape, count in zip(shapes, words, strict=True):
        yield values[at : at + math.prod(shape)].reshape(shape)
        at += 4 * count


class PictureEncoding(NamedTuple):
    """How a run writes the pictures that it makes: those of a scene, and noise."""

    picture: Callable[[RGB], bytes]
    noise: Callable[[RGB], bytes]


AS_STORED, NEWEST = "stored", "png-4"
ENCODINGS: Mapping[str, PictureEncoding] = MappingProxyType(
    {
        AS_STORED: PictureEncoding(encode, encode),
        "png": PictureEncoding(encode, encode),
        "png-2": PictureEncoding(encode, stored),
        "png-3": PictureEncoding(packed, in_blocks),
        NEWEST: PictureEncoding(banded, in_blocks),
    }
)
"""How a run's pictures are sent: as the bank holds them, or all as 8-bit PNGs of pixels alone.

Such PNGs look alike as files. The third does not compress noise, which took half of a call's time
and saved no bytes. The fourth packs the other pictures in a third of the time, and the fifth in half of that.
"""
