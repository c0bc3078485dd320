"""A picture is plain where every program shows the same of it: one upright still picture of 8-bit red, green and blue.

`require_plain` refuses any other, and `made_plain` makes a plain one of it, by rules that are
written down.
"""

from collections.abc import Iterator

import numpy as np
from PIL import Image, ImageColor, ImageOps

from eyechart.errors import BankError, SpecError
from eyechart.frames.pictures import RGB, opened
from eyechart.frames.whole import damages

PLAIN_FORMATS = ("PNG", "JPEG", "WEBP")
"""What may be kept as it is."""
FORMATS = (*PLAIN_FORMATS, "BMP", "GIF", "TIFF")
"""What a plain picture may be made of."""
MEDIA_TYPES = {"PNG": "image/png", "JPEG": "image/jpeg", "WEBP": "image/webp"}

_ORIENTATION = 0x0112
_DEPTH_OF_PNG = 24
"""Where a PNG's header, which is always its first chunk, says how many bits a value has."""
_WHITE_16 = 257
"""What 16 bits are divided by: 65535 is white."""
_WORDS = {
    "1": "is black and white",
    "L": "is grey",
    "P": "has a palette",
    "CMYK": "is of printing colours (CMYK)",
}


def require_plain(picture: bytes, name: str) -> str:
    """Return the media type of a plain picture that decodes; raises BankError that says all in which it is none.

    It must be a PNG, JPEG or WebP of one picture, 8 bits a channel, red, green and blue without
    transparency, not above 25 megapixels, and not turned by a note (EXIF orientation) that some
    programs follow and others do not. It must hold all pixels that it declares, and nothing behind
    them.
    """
    with opened(picture, name, PLAIN_FORMATS) as found:
        if odd := [*_oddities(found, picture)]:
            raise BankError(f"'{name}' {'; it '.join(odd)}")
        pixels = np.asarray(found, dtype=np.uint8)
        if odd := [one.words for one in damages(picture, str(found.format), pixels)]:
            raise BankError(f"'{name}' {'; it '.join(odd)}")
        return MEDIA_TYPES[str(found.format)]


def _oddities(found: Image.Image, picture: bytes) -> Iterator[str]:
    """Yield in words, which follow a picture's name, what programs may show in different ways."""
    if (frames := getattr(found, "n_frames", 1)) > 1:
        yield f"holds {frames} pictures; save one still picture a frame"
    if _is_deep(found, picture):
        yield "has more than 8 bits a channel; save it with 8"
    elif found.mode in _WORDS:
        yield f"{_WORDS[found.mode]}; save it as red, green and blue"
    elif _is_clear(found):
        yield "has transparency, under which each program lays a colour of its own; save it without"
    elif found.mode != "RGB":
        yield f"has the channels {found.mode}; save it as red, green and blue"
    if (turned := found.getexif().get(_ORIENTATION, 1)) not in {0, 1}:
        yield f"is turned only by a note (EXIF orientation {turned}), which not every model follows; turn its pixels"


def _is_deep(found: Image.Image, picture: bytes) -> bool:
    of_png = found.format == "PNG" and picture[_DEPTH_OF_PNG] > 8
    return of_png or found.mode.startswith(("I", "F"))


def _is_clear(found: Image.Image) -> bool:
    return found.mode in {"RGBA", "LA", "PA", "La", "RGBa"} or "transparency" in found.info


def read_colour(words: str) -> tuple[int, int, int]:
    """Return a colour (red, green, blue of 255) from its name or #rrggbb; raises SpecError where it is none."""
    try:
        return ImageColor.getcolor(words, "RGB")[:3]  # type: ignore[index,return-value]
    except ValueError as error:
        raise SpecError(f"'{words}' is no colour; give a name as white, or #rrggbb") from error


def made_plain(
    picture: bytes, name: str, *, background: tuple[int, int, int] = (255, 255, 255), longest: int | None = None
) -> tuple[RGB, list[str]]:
    """Return a picture as plain pixels, shape (h, w, 3), and what was done to it, in words.

    It is turned as its note says; of several pictures the first is taken; 16 bits become 8, 65535
    white; what is transparent shows ``background``; a profile of colours is left out. ``longest``
    is the most pixels of its longer side. Nothing done gives no words. Raises BankError where it is
    no picture, or one of more than 16 bits.
    """
    with opened(picture, name, FORMATS) as found:
        done = [f"first of {frames}"] if (frames := getattr(found, "n_frames", 1)) > 1 else []
        deep = _is_deep(found, picture)
        for one in damages(picture, str(found.format), np.asarray(found.convert("RGB"), dtype=np.uint8)):
            if one.lost:
                raise BankError(f"'{name}' {one.words}")
            done.append("bytes behind it")
        if found.mode == "F" or (found.mode == "I" and found.format != "PNG"):
            raise BankError(f"'{name}' has more than 16 bits a channel, and nobody says what is white; save it with 8")
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
