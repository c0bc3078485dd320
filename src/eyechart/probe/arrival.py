"""Shows that a run's pictures arrive as they are sent: at the size of its own, and several calls at once.

The drawn pictures that were asked one at a time are asked again at the run's own size, all at once. Where fewer are
right by `LOST` than were alone, they are asked once more, one at a time: what is then right shows that calls that are
made together get each other's pictures, and what is wrong again that pictures of this size do not arrive.
"""

import io
from collections.abc import Sequence
from dataclasses import dataclass

from PIL import Image

from eyechart.calls import Reply
from eyechart.frames import decode
from eyechart.modes import FEWEST_TOKENS
from eyechart.probe.asking import Asker
from eyechart.probe.sample import Sample, plain
from eyechart.probe.sight import Shot, Sight, said
from eyechart.seeds import key_seed

AT_ONCE = 8
"""Calls that are made together, as many as a run makes by default."""
MOST_CALLS = 2 * AT_ONCE
LOST = 5
"""So many more answers lost than won are no accident: below 3 in 10,000 where each is right in 9 of 10 calls."""
_GREY = (190, 190, 190)
_LEAST_SIDE = 256
"""Pixels of a side below which a drawn picture would be too small to be named rightly by a weak model."""


@dataclass(frozen=True, slots=True)
class Fault:
    """What happens to pictures on the way, by the name of its guard, and what to do about it."""

    guard: str
    because: str


def dropped(sight: Sight, came: Sequence[Reply], bare: Reply, size: tuple[int, int]) -> Fault | None:
    """Return that the run's own pictures are dropped, where the server's count of tokens proves it; else None.

    It counts the drawn pictures, and each prompt with a picture of the run has exactly the tokens of the words alone.
    """
    adds, counts = sight.image_tokens, [reply.prompt_tokens for reply in came]
    if adds is None or adds < FEWEST_TOKENS or not counts or bare.error is not None:
        return None
    if bare.prompt_tokens is None or any(count != bare.prompt_tokens for count in counts):
        return None
    wide, high = size
    return Fault(
        "picture",
        f"the server drops this run's pictures of {wide}×{high} pixels: a prompt with one has the {bare.prompt_tokens} "
        f"tokens of its words alone, where a drawn picture of 384×384 adds {adds}; {_smaller(size)}",
    )


def _smaller(size: tuple[int, int]) -> str:
    return (
        f"raise the server's context or limit of pixels, or import smaller pictures (--convert --longest "
        f"{min(384, max(size) - 1)})"
    )


async def arrives(asker: Asker, sight: Sight, sample: Sample, seed: int) -> Fault | None:
    """Return what is wrong with pictures of the run's size, or with calls made together; None where nothing is.

    At most `MOST_CALLS` calls. A call that fails says nothing.
    """
    size = size_of(sample)
    alone = [one for one in sight.shots if one.reply.error is None][:AT_ONCE]
    if size is None or len(alone) < AT_ONCE:
        return None
    queries = [
        plain(one.question.words, key_seed("arrival", seed, number), picture=at_size(one.question.picture, size))
        for number, one in enumerate(alone)
    ]
    together = _shots(alone, await asker.together(queries))
    if _lost(alone, together) < LOST:
        return None
    again = _shots(alone, [await asker.ask(query) for query in queries])
    before, one_by_one = (f"{sum(one.right for one in shots)} of {len(shots)}" for shots in (alone, again))
    if _lost(alone, again) >= LOST:
        words = f"pictures of this run's size ({size[0]}×{size[1]}) do not arrive as they are"
        named = f"{one_by_one} drawn ones are named rightly at this size, and {before} at 384×384"
        return Fault("picture", f"{words}: {named}; {_smaller(size)}")
    at_once = f"{sum(one.right for one in together)} of {len(together)}"
    named = f"{at_once} are named rightly when they are asked at once, and {one_by_one} one at a time"
    words = "pictures of calls that are made together are mixed up"
    return Fault("picture", f"{words}: {named}; ask with --concurrency 1, or mend the server")


def _shots(asked: Sequence[Shot], replies: Sequence[Reply]) -> list[Shot]:
    return [
        Shot(one.question, reply, said(one.question.kind, reply)) for one, reply in zip(asked, replies, strict=True)
    ]


def _lost(before: Sequence[Shot], after: Sequence[Shot]) -> int:
    """Return how many more answers were lost than won, among calls that came."""
    both = [(one.right, other.right) for one, other in zip(before, after, strict=True) if other.reply.error is None]
    return sum(one - other for one, other in both)


def size_of(sample: Sample) -> tuple[int, int] | None:
    """Return the width and height of the first picture that a run asks about, None where it shows none."""
    for _, seen in sample.asked:
        for name, picture in seen.images.items():
            high, wide, _ = decode(picture, name).shape
            return wide, high
    return None


def at_size(picture: bytes, size: tuple[int, int]) -> bytes:
    """Return a drawn picture (PNG) inside a grey one of this width and height; itself where that is too small."""
    drawn = Image.open(io.BytesIO(picture)).convert("RGB")
    side = min(*size, *drawn.size)
    if side < _LEAST_SIDE:
        return picture
    canvas = Image.new("RGB", size, _GREY)
    canvas.paste(
        drawn if side == drawn.width else drawn.resize((side, side)), ((size[0] - side) // 2, (size[1] - side) // 2)
    )
    written = io.BytesIO()
    canvas.save(written, "PNG")
    return written.getvalue()
