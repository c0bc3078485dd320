"""Drawn pictures with questions that a blind model cannot answer: a colour, a side, a count.

A seed draws the right answers of a kind without repetition, so a constant answer is right at most
once. About half of the questions repeat the same words; the others have words of their own.
"""

import random
from dataclasses import dataclass
from typing import Literal

import numpy as np
from PIL import Image, ImageDraw

from eyechart.frames import encode
from eyechart.seeds import key_seed

Kind = Literal["colour", "side", "count"]

NONE = "NONE"
"""The answer where there is no picture."""

COLOURS: dict[str, tuple[int, int, int]] = {
    "RED": (220, 20, 30),
    "GREEN": (20, 150, 40),
    "BLUE": (25, 50, 220),
    "YELLOW": (250, 220, 20),
    "ORANGE": (255, 130, 0),
    "PURPLE": (130, 20, 150),
    "BLACK": (0, 0, 0),
    "WHITE": (255, 255, 255),
}
SIDES: dict[str, tuple[float, float]] = {"LEFT": (-1, 0), "RIGHT": (1, 0), "TOP": (0, -1), "BOTTOM": (0, 1)}
COUNTS = ("ONE", "TWO", "THREE", "FOUR", "FIVE", "SIX")

CHOICES: dict[Kind, tuple[str, ...]] = {"colour": tuple(COLOURS), "side": tuple(SIDES), "count": COUNTS}
DEAL: dict[Kind, tuple[int, int]] = {"colour": (4, 2), "side": (2, 2), "count": (2, 2)}
"""The count of questions of each kind: with the same words, and with words of their own."""

_ASKS: dict[Kind, str] = {
    "colour": "What colour is the shape in the picture?",
    "side": "On which side of the picture is the black disc?",
    "count": "How many black squares are in the picture?",
}
_SIZE = 384
_GREY = (190, 190, 190)


@dataclass(frozen=True, slots=True)
class Question:
    """One question with its picture (PNG) and right answer; ``fresh``: its words are unique."""

    kind: Kind
    answer: str
    words: str
    picture: bytes
    fresh: bool


def questions(seed: int) -> tuple[Question, ...]:
    """Return a seed's fourteen questions, shuffled; the first is a colour in the same words."""
    dice = random.Random(key_seed("probe", seed))  # noqa: S311 - no secret
    found = []
    for kind, (same, fresh) in DEAL.items():
        for place, answer in enumerate(dice.sample(CHOICES[kind], same + fresh)):
            new = place >= same
            found.append(Question(kind, answer, words(kind, dice if new else None), draw(kind, answer, dice), new))
    first, *rest = found
    dice.shuffle(rest)
    return first, *rest


def words(kind: Kind, ticket: random.Random | None = None) -> str:
    """Return the question's text; with a ``ticket``, in words that were never sent before."""
    number = "" if ticket is None else f"Question {ticket.randrange(10**8, 10**9)}. "
    return f"{number}{_ASKS[kind]} Answer with one word: {', '.join(CHOICES[kind])}; or {NONE} if there is no picture."


def draw(kind: Kind, answer: str, dice: random.Random) -> bytes:
    """Return a picture with this answer, as PNG; all other properties are random."""
    image = Image.new("RGB", (_SIZE, _SIZE), _GREY)
    pen = ImageDraw.Draw(image)
    if kind == "colour":
        shape = pen.ellipse if dice.random() < 0.5 else pen.rectangle
        shape(_around(_SIZE / 2 + dice.uniform(-30, 30), _SIZE / 2 + dice.uniform(-30, 30), 110), fill=COLOURS[answer])
    elif kind == "side":
        across, down = SIDES[answer]
        x, y = (_SIZE / 2 + 0.33 * _SIZE * one + dice.uniform(-12, 12) for one in (across, down))
        pen.ellipse(_around(x, y, 45), fill=COLOURS["BLACK"])
    else:
        for cell in dice.sample(range(9), COUNTS.index(answer) + 1):
            x, y = ((0.5 + one) * _SIZE / 3 + dice.uniform(-14, 14) for one in divmod(cell, 3))
            pen.rectangle(_around(x, y, 32), fill=COLOURS["BLACK"])
    return encode(np.asarray(image))


def road(seed: int) -> bytes:
    """Return a sketch of a road from above as PNG, 600 × 150 pixels as in a highway bank."""
    dice = random.Random(key_seed("road", seed))  # noqa: S311 - no secret
    image = Image.new("RGB", (600, 150), (100, 100, 100))
    pen = ImageDraw.Draw(image)
    for line in (0.0, 50.0, 100.0, 149.0):
        pen.line((0, line, 600, line), fill=(255, 255, 255), width=2)
    pen.rectangle((120, 65, 150, 85), fill=(50, 200, 0))
    for lane in range(3):
        x = dice.uniform(180, 560)
        pen.rectangle((x, 50 * lane + 15, x + 30, 50 * lane + 35), fill=(100, 200, 255))
    return encode(np.asarray(image))


def _around(x: float, y: float, half: float) -> tuple[float, float, float, float]:
    return x - half, y - half, x + half, y + half
