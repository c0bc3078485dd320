"""Pictures that are whole, and such as programs see otherwise, each with what is said of it."""

import io
import struct
import zlib
from collections.abc import Callable

import numpy as np
from PIL import Image

from banks import draw

PIXELS = Image.fromarray(draw(38.0, 4))
NOISE = Image.fromarray(np.random.default_rng(0).integers(0, 255, (61, 83, 3), dtype=np.uint8))
WIDTH, HEIGHT = PIXELS.size


def encoded(kind: str, picture: Image.Image = PIXELS, **how: object) -> bytes:
    """Return a picture in a format."""
    out = io.BytesIO()
    picture.save(out, kind, **how)  # type: ignore[arg-type]
    return out.getvalue()


def noted(orientation: int) -> Image.Exif:
    """Return a note that turns a picture."""
    note = Image.Exif()
    note[0x0112] = orientation
    return note


def part(name: bytes, data: bytes) -> bytes:
    """Return a part of a PNG."""
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def png(size: tuple[int, int], packed: bytes, *, bits: int = 8, more: bytes = b"") -> bytes:
    """Return a PNG in RGB with this header and these packed rows, whether they fit or not."""
    head = part(b"IHDR", struct.pack(">IIBBBBB", *size, bits, 2, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + head + more + part(b"IDAT", packed) + part(b"IEND", b"")


def rows(count: int, bits: int = 8) -> bytes:
    """Return so many black rows of the drawn pictures' width, packed."""
    return zlib.compress(bytes((1 + WIDTH * 3 * bits // 8) * count))


def cut_scan(jpeg: bytes, share: float = 0.5) -> bytes:
    """Return a JPEG of which only a share of the scan is there, closed as if it were whole."""
    begin = jpeg.index(b"\xff\xda") + 14
    return jpeg[: begin + int(share * (len(jpeg) - begin))] + b"\xff\xd9"


def resized(jpeg: bytes, width: int, height: int) -> bytes:
    """Return a baseline JPEG whose header declares another size."""
    place = jpeg.index(b"\xff\xc0") + 5
    return jpeg[:place] + struct.pack(">HH", height, width) + jpeg[place + 4 :]


def shortened(webp: bytes) -> bytes:
    """Return a WebP whose data end half-way, and whose headers say so too."""
    size = struct.unpack_from("<I", webp, 16)[0] // 2 & ~1
    return b"RIFF" + struct.pack("<I", 12 + size) + webp[8:16] + struct.pack("<I", size) + webp[20 : 20 + size]


WHOLE: dict[str, Callable[[], bytes]] = {
    "PNG": lambda: encoded("PNG"),
    "PNG by hand": lambda: png((WIDTH, HEIGHT), rows(HEIGHT)),
    "JPEG": lambda: encoded("JPEG"),
    "JPEG, finest": lambda: encoded("JPEG", NOISE, quality=97, subsampling=0),
    "JPEG, progressive": lambda: encoded("JPEG", NOISE, progressive=True),
    "JPEG with restarts": lambda: encoded("JPEG", NOISE, restart_marker_blocks=3),
    "JPEG of one colour": lambda: encoded("JPEG", Image.new("RGB", (320, 240), (9, 9, 9)), optimize=True),
    "JPEG with a note that turns nothing": lambda: encoded("JPEG", exif=noted(1)),
    "WebP": lambda: encoded("WEBP"),
    "WebP, lossless": lambda: encoded("WEBP", NOISE, lossless=True),
}

ODD: dict[str, tuple[Callable[[], bytes], str]] = {
    "turned JPEG": (lambda: encoded("JPEG", exif=noted(6)), "EXIF orientation 6"),
    "turned PNG": (lambda: encoded("PNG", exif=noted(3)), "EXIF orientation 3"),
    "turned WebP": (lambda: encoded("WEBP", exif=noted(8)), "EXIF orientation 8"),
    "16 bits, grey": (lambda: encoded("PNG", Image.fromarray(np.zeros((9, 9), np.uint16))), "more than 8 bits"),
    "16 bits, RGB": (lambda: png((WIDTH, HEIGHT), rows(HEIGHT, 16), bits=16), "more than 8 bits"),
    "grey": (lambda: encoded("PNG", PIXELS.convert("L")), "is grey"),
    "grey JPEG": (lambda: encoded("JPEG", PIXELS.convert("L")), "is grey"),
    "palette": (lambda: encoded("PNG", PIXELS.convert("P")), "has a palette"),
    "one bit": (lambda: encoded("PNG", PIXELS.convert("1")), "is black and white"),
    "transparent": (lambda: encoded("PNG", Image.new("RGBA", (9, 9))), "has transparency"),
    "transparent WebP": (lambda: encoded("WEBP", Image.new("RGBA", (9, 9), (9, 9, 9, 9))), "has transparency"),
    "a transparent colour": (
        lambda: png((WIDTH, HEIGHT), rows(HEIGHT), more=part(b"tRNS", bytes(6))),
        "has transparency",
    ),
    "CMYK": (lambda: encoded("JPEG", PIXELS.convert("CMYK")), "printing colours (CMYK)"),
    "moving PNG": (lambda: encoded("PNG", save_all=True, append_images=[PIXELS.rotate(180)]), "holds 2 pictures"),
    "moving WebP": (lambda: encoded("WEBP", save_all=True, append_images=[PIXELS.rotate(180)]), "holds 2 pictures"),
    "several JPEGs": (lambda: encoded("MPO", save_all=True, append_images=[PIXELS]), "holds 2 pictures"),
    "bitmap": (lambda: encoded("BMP"), "no picture of PNG, JPEG, WEBP"),
    "GIF": (lambda: encoded("GIF"), "no picture of PNG, JPEG, WEBP"),
    "69 bytes for 2 megapixels": (lambda: png((1448, 1448), zlib.compress(b"")), "damaged"),
    "PNG of half its rows": (lambda: png((WIDTH, HEIGHT), rows(HEIGHT // 2)), "damaged"),
    "PNG of one row too many": (lambda: png((WIDTH, HEIGHT), rows(HEIGHT + 1)), "more bytes of pixels"),
    "PNG, cut": (lambda: encoded("PNG")[:-20], "damaged"),
    "PNG without its end": (lambda: encoded("PNG")[:-12], "its end is missing"),
    "PNG with a wrong checksum": (lambda: encoded("PNG")[:-17] + b"x" + encoded("PNG")[-16:], "damaged"),
    "PNG with something behind": (lambda: encoded("PNG") + b"x", "1 byte behind its end"),
    "JPEG, cut": (lambda: encoded("JPEG")[:-200], "damaged"),
    "JPEG, cut and closed": (lambda: cut_scan(encoded("JPEG", NOISE)), "declares more pixels than it holds"),
    "JPEG, cut near its end and closed": (lambda: cut_scan(encoded("JPEG", NOISE), 0.9), "declares more pixels"),
    "JPEG of nothing": (lambda: cut_scan(encoded("JPEG"), 0.0), "declares more pixels than it holds"),
    "JPEG, progressive, cut and closed": (
        lambda: cut_scan(encoded("JPEG", NOISE, progressive=True)),
        "declares more pixels than it holds",
    ),
    "JPEG with restarts, cut and closed": (
        lambda: cut_scan(encoded("JPEG", NOISE, restart_marker_blocks=3)),
        "declares more pixels than it holds",
    ),
    "JPEG that says it is larger": (lambda: resized(encoded("JPEG"), 1400, 1400), "declares more pixels"),
    "JPEG with something behind": (lambda: encoded("JPEG") + bytes(9), "9 bytes behind its end"),
    "WebP, cut": (lambda: encoded("WEBP", NOISE)[:-40], "damaged"),
    "WebP, cut and closed": (lambda: shortened(encoded("WEBP", NOISE)), "damaged"),
    "WebP, lossless, cut and closed": (lambda: shortened(encoded("WEBP", NOISE, lossless=True)), "damaged"),
    "WebP with something behind": (lambda: encoded("WEBP") + b"xyz", "3 bytes behind its end"),
    "the head of a PNG": (lambda: encoded("PNG")[:33], "damaged"),
    "the head of a WebP": (lambda: b"RIFF\0\0\0\0WEBP", "damaged"),
    "words": (lambda: b"no picture", "no picture of PNG, JPEG, WEBP"),
    "nothing": (lambda: b"", "no picture of PNG, JPEG, WEBP"),
}
"""What no bank takes, and no guardian is shown."""
