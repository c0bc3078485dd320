"""Plain pictures, which every program shows alike: one upright still of 8-bit RGB.

`require_plain` refuses all others, and `made_plain` converts them by documented rules.
"""

from collections.abc import Iterator

import numpy as np
from PIL import Image, ImageColor, ImageOps

from eyechart.errors import BankError, SpecError
from eyechart.frames.damage import damages
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
