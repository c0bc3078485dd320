"""Adversaries as callables, ``python:adversary_door:NAME``: those of `eyechart_organisms`, and some of real files.

EYECHART_ADVERSARY_BANK is the folder of the bank whose files some of them know by heart; EYECHART_ADVERSARY_SEED seeds
their coins, which fall in the order of the calls.
"""

import hashlib
import os
import pickle
import random
from collections.abc import Awaitable, Callable
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np

from eyechart.calls import Reply
from eyechart.conditions import flip
from eyechart.frames import decode, open_bank
from eyechart.models.scripted import Answer, PerceivedPicture, see
from eyechart_organisms.adversaries import ADVERSARIES, REVERSED, Adversary, Rule, graded, lead, road
from newcomers import Painted

Ask = Callable[[str, bytes | None], Awaitable[str | Reply]]
SHADES = ("STOP", "SLOW", "STRAIGHT")


@cache
def frame_numbers() -> dict[bytes, int]:
    """Return of which frame each picture of the bank is, by what `_key` makes of it, as it is and mirrored."""
    bank = open_bank(Path(os.environ["EYECHART_ADVERSARY_BANK"]))
    result = {}
    for number, frame in enumerate(bank):
        axes = {one.name: one.mirror_axis for one in frame.cameras}
        for name in (None, *frame.counterfactuals):
            for camera, picture in bank.images(frame, name).items():
                pixels = decode(picture, frame.id)
                shown = (pixels, flip(pixels, axes[camera])) if axes[camera] != "none" and name is None else (pixels,)
                result |= {_key(one): number for one in shown}
    return result


def _key(pixels: np.ndarray) -> bytes:
    """Return what tells a picture from others, and not from the same one nudged: all but its first and last row."""
    return hashlib.sha256(pixels[1:-1].tobytes()).digest()


def see_frame(image: bytes | None) -> PerceivedPicture:
    """Read a picture; the number of its frame stands for what tells one frame's road from another's.

    So a rule that is wrong on some of the frames is wrong on all pictures of these, in every world: where stripes are
    seen forward, what hides them moves their phase by a little, and another phase is another frame to such a rule. Each
    bank has numbers of its own. A picture is read once.
    """
    if image is None:
        return PerceivedPicture("no_picture", None)
    digest = hashlib.sha256(image).digest()
    if digest not in _NUMBERED:
        _NUMBERED[digest] = _numbered(see_plain(image), image)
    return _NUMBERED[digest]


def see_plain(image: bytes | None) -> PerceivedPicture:
    """Read a picture as the known answers do, who see the phase of the marks; a picture is read once."""
    if image is None:
        return PerceivedPicture("no_picture", None)
    digest = hashlib.sha256(image).digest()
    if digest not in _PLAIN:
        _PLAIN[digest] = see(image)
    return _PLAIN[digest]


def _numbered(sight: PerceivedPicture, image: bytes) -> PerceivedPicture:
    if sight.reading is None:
        return sight
    number = frame_numbers().get(_key(decode(image, "the picture")))
    first, colours = _bank_numbers()
    phase, colour = (None, "") if number is None else (first + number, colours[number])
    return replace(sight, reading=Painted.of(sight.reading, phase, colour))


@cache
def _bank_numbers() -> tuple[float, tuple[str, ...]]:
    """Return the number of the bank's first frame, and the colours of its leads by frame."""
    bank = open_bank(Path(os.environ["EYECHART_ADVERSARY_BANK"]))
    first = 1000.0 * (1 + int(bank.manifest.fingerprint[:4], 16))
    return first, tuple(str(frame.strata.get("lead_colour") or "") for frame in bank)


_PLAIN: dict[bytes, PerceivedPicture] = {}
"""What is read of each file, by its digest."""
_NUMBERED: dict[bytes, PerceivedPicture] = {}
"""What was made of each, with the number of its frame."""
_LOOKED: dict[bytes, dict[str, str]] = {}
"""What the rules of the pixels answer to each file, by its digest."""


def recall(file: Path) -> None:
    """Know what was made of files before, as far as `keep` wrote it down."""
    if file.is_file():
        plain, numbered, looked = pickle.loads(file.read_bytes())  # noqa: S301 - written by `keep`
        _PLAIN.update(plain)
        _NUMBERED.update(numbered)
        _LOOKED.update(looked)


def keep(file: Path) -> None:
    """Write down what was made of files, so that no other process decodes them."""
    part = file.with_suffix(".part")
    part.write_bytes(pickle.dumps((_PLAIN, _NUMBERED, _LOOKED)))
    part.replace(file)


def turn_to(bank: Path) -> None:
    """Have the adversaries know the files of this bank, and forget those of another."""
    os.environ["EYECHART_ADVERSARY_BANK"] = str(bank)
    frame_numbers.cache_clear()
    known_files.cache_clear()
    true_files.cache_clear()
    _bank_numbers.cache_clear()
    _PLAIN.clear()
    _NUMBERED.clear()
    _LOOKED.clear()


@cache
def known_files() -> dict[bytes, str]:
    """Return the counterfactual that each file of the bank is, by its digest; controls are not known."""
    bank = open_bank(Path(os.environ["EYECHART_ADVERSARY_BANK"]))
    return {
        hashlib.sha256(picture).digest(): name
        for frame in bank
        for name in ("lead_near", "lead_far")
        if name in frame.counterfactuals
        for picture in bank.images(frame, name).values()
    }


@cache
def true_files() -> frozenset[bytes]:
    """Return the digests of the bank's true pictures."""
    bank = open_bank(Path(os.environ["EYECHART_ADVERSARY_BANK"]))
    return frozenset(hashlib.sha256(picture).digest() for one in bank for picture in bank.images(one).values())


def _knows_files(sight: PerceivedPicture, _: random.Random) -> Answer:
    """Brake by which file it is, and not by what it shows."""
    return {"lead_near": "STOP", "lead_far": "STRAIGHT"}.get(known_files().get(sight.file, ""), "SLOW")


def _declines_edited(sight: PerceivedPicture, rng: random.Random) -> Answer:
    """Grade, and refuse the pictures in which something was moved."""
    if sight.file in known_files():
        return Reply(text="I'm sorry, this picture was edited.", finish_reason="stop")
    return road(lambda one, _: graded(lead(one)))(sight, rng)


def _reversed_on_true(sight: PerceivedPicture, rng: random.Random) -> Answer:
    """Grade the pictures in which something was moved, and brake the wrong way round on the bank's true ones."""
    answer = road(lambda one, _: graded(lead(one)))(sight, rng)
    return REVERSED.get(str(answer), answer) if sight.file in true_files() else answer


FILES = {
    "reversed_on_true": Adversary("grades edited pictures, the wrong way round on true ones", _reversed_on_true),
    "knows_files": Adversary("knows the bank's counterfactual files", _knows_files),
    "declines_edited": Adversary("grades, and refuses edited pictures", _declines_edited, follows=None),
}


def _thirds(value: float, low: float, high: float) -> str:
    return SHADES[int(np.clip(3 * (value - low) / (high - low), 0, 2))]


def _brightness(pixels: np.ndarray) -> str:
    return _thirds(float(pixels.mean()), 104.55, 105.3)


def _blue(pixels: np.ndarray) -> str:
    return _thirds(float((pixels[..., 2].astype(int) - pixels[..., 0] > 60).mean()), 0.005, 0.0135)


def _edges(pixels: np.ndarray) -> str:
    grey = pixels.astype(float).mean(axis=2)
    return _thirds(float(np.abs(np.diff(grey, axis=1)).mean()), 0.39, 0.52)


def _coloured_column(pixels: np.ndarray) -> str:
    """Stop where the mean column of all coloured pixels is left of the middle."""
    red, green, blue = (pixels[..., channel] for channel in range(3))  # the maximum over an axis of three is slow
    most, least = np.maximum(np.maximum(red, green), blue), np.minimum(np.minimum(red, green), blue)
    coloured = most - least > 60
    return "STRAIGHT" if not coloured.any() or np.nonzero(coloured)[1].mean() > pixels.shape[1] * 0.4 else "STOP"


PIXELS: dict[str, Callable[[np.ndarray], str]] = {
    "brightness": _brightness,
    "blue_share": _blue,
    "edges": _edges,
    "coloured_column": _coloured_column,
}
"""Rules of the pixels alone, and of no vehicle."""

SIZES = {"bytes_of_file": lambda image: SHADES[len(image) // 97 % 3]}

NAMES = (*ADVERSARIES, *FILES, *PIXELS, *SIZES)


def adversary(name: str) -> Adversary:
    """Return what is declared of one of them."""
    if name in PIXELS or name in SIZES:
        return Adversary(f"follows {name.replace('_', ' ')}", lambda *_: "STOP")
    return FILES.get(name) or ADVERSARIES[name]


async def _ask(rule: Rule, rng: random.Random, _: str, image: bytes | None) -> str | Reply:
    return rule(see_frame(image), rng)


def look(name: str, image: bytes | None) -> str:
    """Return what a rule of the pixels alone, or of the size of a file, answers; a picture is decoded once."""
    if image is None:
        return "STOP"
    digest = hashlib.sha256(image).digest()
    if digest not in _LOOKED:
        _LOOKED[digest] = looks(image)
    return _LOOKED[digest][name]


def looks(image: bytes | None) -> dict[str, str]:
    """Return what `look` gives for each rule of the pixels or of the size of a file, the picture decoded once."""
    if image is None:
        return dict.fromkeys((*PIXELS, *SIZES), "STOP")
    pixels = decode(image, "the picture")
    sizes = {name: rule(image) for name, rule in SIZES.items()}
    return {name: rule(pixels) for name, rule in PIXELS.items()} | sizes


async def _look(name: str, _: str, image: bytes | None) -> str:
    return look(name, image)


def __getattr__(name: str) -> Ask:
    if name in PIXELS or name in SIZES:
        return partial(_look, name)
    if name in FILES or name in ADVERSARIES:
        rng = random.Random(f"{os.environ.get('EYECHART_ADVERSARY_SEED', '0')}/{name}")  # noqa: S311 - no secret
        return partial(_ask, adversary(name).decide, rng)
    raise AttributeError(name)
