"""Finds the smallest visible detail of a picture: the gap of a ring, as on an eye chart.

The limit may be the model itself, or a server that makes pictures smaller.
"""

import random
from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw

from eyechart.frames import encode
from eyechart.probe.asker import Asker, LimitReachedError
from eyechart.probe.picture_proof import said
from eyechart.probe.pictures import NONE, SIDES
from eyechart.probe.sample import plain
from eyechart.seeds import key_seed

SIZE = (1024, 768)
"""Width and height of the pictures in pixels, as of a usual camera."""
GAPS = (64, 24, 12, 6)
"""The gaps of the rings, in pixels; a ring is five times as wide."""
EACH = 2
MOST_CALLS = EACH * len(GAPS)

_WORDS = (
    f"Where is the opening of the black ring in the picture? Answer with one word: {', '.join(SIDES)}; or {NONE} if "
    "there is no ring."
)


@dataclass(frozen=True, slots=True)
class Acuity:
    """Gap in pixels, right answers and all answers, from the largest gap to the first unseen."""

    by_gap: tuple[tuple[int, int, int], ...] = ()

    @property
    def smallest(self) -> int | None:
        """Return the smallest gap with all answers right, None without one."""
        return min((gap for gap, right, of in self.by_gap if right == of > 0), default=None)

    @property
    def words(self) -> str:
        """Return the result in words, with the counts at each gap."""
        if not self.by_gap:
            return "not asked"
        wide, high = SIZE
        counted = ", ".join(f"{right} of {of} at {gap}" for gap, right, of in self.by_gap)
        found = f"a gap of {self.smallest} pixels" if self.smallest else f"no gap of {GAPS[0]} pixels or fewer"
        return f"{found} in {wide} × {high} ({counted})"


NOT_ASKED = Acuity()


async def acuity(asker: Asker, seed: int) -> Acuity:
    """Ask for the gap's side, twice a size, until one size is not seen; a limit ends it early."""
    dice = random.Random(key_seed("acuity", seed))  # noqa: S311 - no secret
    found: list[tuple[int, int, int]] = []
    for gap in GAPS:
        right = of = 0
        for number, answer in enumerate(dice.sample(list(SIDES), EACH)):
            query = plain(_WORDS, key_seed("acuity", seed, gap, number), picture=ring(gap, answer, dice))
            try:
                reply = await asker.ask(query)
            except LimitReachedError:
                return Acuity(tuple(found))
            of += reply.error is None
            right += reply.error is None and said("side", reply) == answer
        found.append((gap, right, of))
        if right < EACH:
            break
    return Acuity(tuple(found))


def ring(gap: int, side: str, dice: random.Random) -> bytes:
    """Return a white picture (PNG) with a black ring near its middle, open on one side."""
    image = Image.new("RGB", SIZE, (255, 255, 255))
    pen, half = ImageDraw.Draw(image), 2.5 * gap
    x, y = (length / 2 + dice.uniform(-40, 40) for length in SIZE)
    pen.ellipse((x - half, y - half, x + half, y + half), fill=(0, 0, 0))
    pen.ellipse((x - half + gap, y - half + gap, x + half - gap, y + half - gap), fill=(255, 255, 255))
    across, down = SIDES[side]
    left, right = sorted((x, x + across * (half + 1)))
    top, bottom = sorted((y, y + down * (half + 1)))
    beside = gap / 2
    box = (left, y - beside, right, y + beside) if across else (x - beside, top, x + beside, bottom)
    pen.rectangle(box, fill=(255, 255, 255))
    return encode(np.asarray(image))
