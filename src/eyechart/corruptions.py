"""Corruptions of a camera's picture in five graded steps: weather, light, optics and electronics.

Each takes pixels of shape (h, w, 3), uint8, and returns the same shape. Sizes are shares of the
picture's shorter side, so that a step means the same at every size. What is random comes from a
seed alone, and a later step adds to the same draw.
"""

import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFilter

from eyechart.errors import BankError
from eyechart.frames import RGB

Floats = NDArray[np.float64]
Draw = np.random.Generator

STEPS = (1, 2, 3, 4, 5)
"""The steps of every corruption, from mild to severe."""

LEAST_SIDE = 8
"""The shortest side in pixels of a picture that is corrupted."""

_HAZE, _WHITE = 220.0, 255.0
_LIGHT = np.array([255.0, 244.0, 214.0])
"""The colour of a low sun."""


@dataclass(frozen=True, slots=True)
class Corruption:
    """A corruption: its name, its effect in words, the quantity of its steps, and their values.

    ``draw(pixels, amount, rng)`` returns float pixels from 0 to 255; they are rounded and clipped.
    """

    name: str
    words: str
    quantity: str
    amounts: tuple[float, float, float, float, float]
    draw: Callable[[RGB, float, Draw], Floats]

    def applied(self, pixels: RGB, step: int, seed: int) -> RGB:
        """Return pixels at one of the steps 1 to 5; raises BankError for a tiny picture."""
        if min(pixels.shape[:2]) < LEAST_SIDE:
            raise BankError(
                f"a picture of {pixels.shape[1]}x{pixels.shape[0]} pixels is too small for {self.name}: its shorter "
                f"side needs {LEAST_SIDE}"
            )
        drawn = self.draw(pixels, self.amounts[step - 1], np.random.default_rng(seed))
        return np.clip(np.rint(drawn), 0, 255).astype(np.uint8)


def _size(pixels: RGB) -> tuple[int, int, int]:
    """Return height, width, and the shorter of the two, in pixels."""
    high, wide, _ = pixels.shape
    return high, wide, min(high, wide)


def _soft(high: int, wide: int, cells: int, rng: Draw) -> Floats:
    """Return a smooth random field from 0 to 1, shape (high, wide, 1), of about ``cells`` patches a side."""
    coarse = Image.fromarray(rng.integers(0, 256, (cells, cells), dtype=np.uint8))
    return np.asarray(coarse.resize((wide, high), Image.Resampling.BICUBIC), dtype=np.float64)[:, :, None] / 255


def _fog(pixels: RGB, kept: float, rng: Draw) -> Floats:
    """Return a haze of which the share ``kept`` of the contrast is left, a little uneven."""
    high, wide, _ = _size(pixels)
    patches = _HAZE + 16 * (_soft(high, wide, 4, rng) - 0.5)
    return kept * pixels + (1 - kept) * patches


def _rain(pixels: RGB, density: float, rng: Draw) -> Floats:
    """Return slanted bright streaks over a duller picture, ``density`` a square of the shorter side."""
    high, wide, side = _size(pixels)
    count = int(density * high * wide / side**2)
    mask = Image.new("L", (wide, high))
    brush, starts = ImageDraw.Draw(mask), rng.random((count, 3))
    for across, down, length in starts.tolist():
        reach = side * (0.06 + 0.10 * length)
        begin = across * wide, down * (high + reach) - reach
        brush.line((*begin, begin[0] + 0.18 * reach, begin[1] + reach), fill=255, width=max(1, round(side / 160)))
    drops = np.asarray(mask.filter(ImageFilter.GaussianBlur(side / 480)), dtype=np.float64)[:, :, None] / 255
    veil = min(0.5, density / 2400)
    dull = (1 - veil) * pixels + veil * 170.0
    return np.asarray(dull + 0.75 * drops * (_HAZE - dull))


def _night(pixels: RGB, light: float, rng: Draw) -> Floats:
    """Return the share ``light`` of the light, with the noise of few photons and of the sensor."""
    photons = rng.poisson(0.25 * light * pixels)
    return np.asarray(4 * (photons + rng.normal(0.0, 0.5, pixels.shape)) + 2.0)


def _sun(pixels: RGB, glare: float, rng: Draw) -> Floats:
    """Return the glare of a low sun in the upper half, ``glare`` at its centre, and a veil elsewhere."""
    high, wide, side = _size(pixels)
    rows, columns = np.mgrid[:high, :wide].astype(np.float64)
    at = high * (0.15 + 0.3 * rng.random()), wide * (0.2 + 0.6 * rng.random())
    away = np.hypot(rows - at[0], columns - at[1])[:, :, None] / side
    added = glare * (0.35 + 0.65 * np.exp(-away / 0.35)) + glare**2 * np.exp(-((away / 0.12) ** 2))
    return np.asarray(pixels * (1 - 0.3 * min(glare, 1.0)) + added * _LIGHT)


def _blur(pixels: RGB, radius: float, _: Draw) -> Floats:
    """Return a Gaussian blur; ``radius`` is its standard deviation as a share of the shorter side."""
    picture = Image.fromarray(pixels).filter(ImageFilter.GaussianBlur(radius * _size(pixels)[2]))
    return np.asarray(picture, dtype=np.float64)


def _grain(pixels: RGB, deviation: float, rng: Draw) -> Floats:
    """Return Gaussian noise with this standard deviation in levels, independent in each value."""
    return pixels + rng.normal(0.0, deviation, pixels.shape)


def _jpeg(pixels: RGB, quality: float, _: Draw) -> Floats:
    """Return what is left after JPEG compression with this quality, colours at half resolution."""
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "JPEG", quality=int(quality), subsampling=2)
    return np.asarray(Image.open(buffer).convert("RGB"), dtype=np.float64)


def _pixels(pixels: RGB, share: float, rng: Draw) -> Floats:
    """Return dead pixels: this share of all, black or white."""
    dead, white = rng.random(pixels.shape[:2]), rng.random(pixels.shape[:2]) < 0.5
    return np.asarray(np.where((dead < share)[:, :, None], np.where(white, _WHITE, 0.0)[:, :, None], pixels))


def _dirt(pixels: RGB, share: float, rng: Draw) -> Floats:
    """Return dirt on the lens: dark blots, out of focus, over about this share of the picture."""
    high, wide, _ = _size(pixels)
    field = _soft(high, wide, 7, rng)
    edge = float(np.quantile(field, 1 - share))
    cover = np.clip((field - edge) / 0.10 + 0.5, 0.0, 1.0) * 0.94
    return np.asarray((1 - cover) * pixels + cover * np.array([52.0, 44.0, 34.0]))


def _exposure(pixels: RGB, stops: float, rng: Draw) -> Floats:
    """Return an exposure so many stops too long, or, on every second frame, too short."""
    sign = 1 if rng.random() < 0.5 else -1
    linear = (pixels / _WHITE) ** 2.2 * 2.0 ** (sign * stops)
    return np.asarray(_WHITE * np.clip(linear, 0.0, 1.0) ** (1 / 2.2))


CORRUPTIONS: Mapping[str, Corruption] = {
    one.name: one
    for one in (
        Corruption("fog", "fog", "share of the contrast that is left", (0.70, 0.45, 0.27, 0.15, 0.07), _fog),
        Corruption("rain", "rain", "streaks a square of the shorter side", (60, 150, 320, 600, 1000), _rain),
        Corruption("night", "night", "share of the light that is left", (0.60, 0.35, 0.20, 0.10, 0.04), _night),
        Corruption("sun", "a low sun", "glare, 1 for white", (0.25, 0.45, 0.70, 1.00, 1.40), _sun),
        Corruption("blur", "blur", "deviation, share of the shorter side", (0.006, 0.012, 0.022, 0.04, 0.07), _blur),
        Corruption("grain", "noise of the sensor", "deviation in levels", (12, 25, 45, 75, 120), _grain),
        Corruption("jpeg", "JPEG compression", "quality", (40, 20, 10, 5, 1), _jpeg),
        Corruption("pixels", "dead pixels", "share of the pixels", (0.01, 0.04, 0.12, 0.30, 0.60), _pixels),
        Corruption("dirt", "dirt on the lens", "share of the picture", (0.08, 0.18, 0.32, 0.50, 0.70), _dirt),
        Corruption("exposure", "a wrong exposure", "stops too long or too short", (1.0, 1.8, 2.6, 3.6, 5.0), _exposure),
    )
}
"""All corruptions, by name."""


def step_of(name: str) -> tuple[Corruption, int] | None:
    """Return the corruption and step of a name such as ``fog_3``; None for any other name."""
    what, _, number = name.rpartition("_")
    if what in CORRUPTIONS and number in {str(step) for step in STEPS}:
        return CORRUPTIONS[what], int(number)
    return None
