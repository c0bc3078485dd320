"""Shows that a run's pictures arrive as they are sent: at the size of its own, and several calls at once.

The drawn pictures that were asked one at a time are asked again at the run's own size, all at once. Where fewer are
right by `LOST` than were alone, they are asked once more, one at a time: what is then right shows that calls that are
made together get each other's pictures, and what is wrong again that pictures of this size do not arrive.
"""

import io
import random
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from PIL import Image

from eyechart.calls import Query, Reply
from eyechart.frames import decode
from eyechart.modes import FEWEST_TOKENS
from eyechart.probe.asking import Asker
from eyechart.probe.pictures import CHOICES, draw, words
from eyechart.probe.sample import Sample, plain
from eyechart.probe.sight import Shot, Sight, said
from eyechart.seeds import key_seed

AT_ONCE = 8
"""Pictures that are shown together, where the run has so many calls under way at once."""
MOST_CALLS = 2 * AT_ONCE
REPEATS = 3
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
    together = _shots(alone, await asker.together(queries, sample.at_once))
    if _lost(alone, together) < LOST:
        return None
    again = _shots(alone, [await asker.ask(query) for query in queries])
    before, one_by_one = (f"{sum(one.right for one in shots)} of {len(shots)}" for shots in (alone, again))
    if _lost(alone, again) >= LOST:
        what = f"pictures of this run's size ({size[0]}×{size[1]}) do not arrive as they are"
        named = f"{one_by_one} drawn ones are named rightly at this size, and {before} at 384×384"
        return Fault("picture", f"{what}: {named}; {_smaller(size)}")
    at_once = f"{sum(one.right for one in together)} of {len(together)}"
    named = f"{at_once} are named rightly when they are asked at once, and {one_by_one} one at a time"
    what = "pictures of calls that are made together are mixed up"
    return Fault("picture", f"{what}: {named}; ask with --concurrency 1, or mend the server")


async def reuses(asker: Asker, sight: Sight, seed: int) -> Fault | None:
    """Return that a cache by prefix gives one picture's state to another, at a size that was not asked before.

    Two calls, where every colour that was named is that of the first picture: the first of the new size is named
    rightly then, and the second gets the same name.
    """
    told = [one.said for one in sight.shots if one.question.kind == "colour"]
    named = told[0] if told else None
    if len(told) < 2 or set(told) != {named} or named != sight.shots[0].question.answer:
        return None
    dice = random.Random(key_seed("arrival", seed, "reuses"))  # noqa: S311 - no secret
    first, other = dice.sample([colour for colour in CHOICES["colour"] if colour != named], 2)
    answers = []
    for number, colour in enumerate((first, other), 100):
        picture = at_size(draw("colour", colour, dice), (448, 416))
        reply = await asker.ask(plain(words("colour"), key_seed("arrival", seed, number), picture=picture))
        answers.append(said("colour", reply))
    if answers != [first, first]:
        return None
    return Fault(
        "cache",
        "every answer fits the first picture of its size: a cache by prefix gives what it kept of one picture to "
        "others; switch prefix caching off for pictures, or mend the server",
    )


async def apart(asker: Asker, sample: Sample, seed: int) -> tuple[Fault | None, str]:
    """Return whether pictures of one query are told apart, for a run that has several: a fault, or a note in words.

    Each camera's picture has the size that it has in the run. Three calls. Two answers that name one of two colours
    each, and tokens that do not grow with the pictures, show that one of them arrives; where the tokens grow, the model
    may look at one alone. Answers that name the pictures in another order than they were sent in, once as the choices
    stand and once not, and the first one by the colour of the last, are noted: the server may have exchanged them.
    """
    sizes = {name: _size(picture, name) for name, picture in sample.asked[0][1].images.items()}
    if len(sizes) < 2:
        return None, ""
    alone_at = dict([next(iter(sizes.items()))])
    dice = random.Random(key_seed("arrival", seed, "apart"))  # noqa: S311 - no secret
    colours = dice.sample(CHOICES["colour"], 4)
    colours[:2] = sorted(colours[:2], key=CHOICES["colour"].index)
    colours[2:] = sorted(colours[2:], key=CHOICES["colour"].index, reverse=True)
    replies = [
        await asker.ask(_of_several(sizes, shown, key_seed("arrival", seed, 200 + number)))
        for number, shown in enumerate((colours[:2], colours[2:]))
    ]
    if any(one.error is not None for one in replies):
        failed = next(one.error_detail for one in replies if one.error is not None)
        return None, f"{len(sizes)} pictures in one query failed: {failed[:200]}"
    if _is_turned(replies[0], colours[:2]) and _is_turned(replies[1], colours[2:]):
        return None, await _of_first(asker, sizes, colours[1:3], key_seed("arrival", seed, 202))
    shown_of = zip(replies, (colours[:2], colours[2:]), strict=True)
    if any(sum(_names(reply, colour) for colour in shown) != 1 for reply, shown in shown_of):
        return None, ""
    alone = await asker.ask(_of_several(alone_at, colours[:1], key_seed("arrival", seed, 202)))
    if alone.prompt_tokens and replies[0].prompt_tokens and replies[0].prompt_tokens > alone.prompt_tokens:
        return None, f"it names one of two colours in {len(sizes)} pictures, all of which the server counts"
    several = sorted(set(sizes.values()), reverse=True)
    of = "one size" if len(several) == 1 else "sizes " + " and ".join(f"{wide}×{high}" for wide, high in several)
    what = f"of {len(sizes)} pictures of {of} in one query one arrives: answers name one of two colours"
    return Fault("picture", f"{what}; mend the server, or run on one camera"), ""


async def _of_first(asker: Asker, sizes: Mapping[str, tuple[int, int]], colours: Sequence[str], seed: int) -> str:
    """Return in words that the first of several pictures is named as the last one is; nothing where it is not."""
    asked = "Each picture shows a shape of one colour. Which colour is it in the first picture? Answer with one word: "
    reply = await asker.ask(_of_several(sizes, colours, seed, asked))
    if reply.error is not None or _names(reply, colours[0]) or not _names(reply, colours[-1]):
        return ""
    return (
        f"of {len(sizes)} pictures in one query it takes the first for another: the server exchanges them, or the "
        "model does not know their order; before what one camera does is believed, mend the server or ask about one"
    )


def _is_turned(reply: Reply, colours: Sequence[str]) -> bool:
    """Return whether an answer names both colours, the second one first."""
    first, second = (re.search(rf"\b{colour}\b", reply.text, re.IGNORECASE) for colour in colours)
    return first is not None and second is not None and second.start() < first.start()


_ALL = "Each picture shows a shape of one colour. Which colours are there? Answer with all, in the pictures' order: "


def _of_several(sizes: Mapping[str, tuple[int, int]], colours: Sequence[str], seed: int, asked: str = _ALL) -> Query:
    """Return a query that shows the first colour to the first camera, and the last one to all others."""
    asked = f"{asked}{', '.join(CHOICES['colour'])}."
    query, dice = plain(asked, seed), random.Random(seed)  # noqa: S311 - no secret
    shown = {
        name: at_size(draw("colour", colours[min(place, len(colours) - 1)], dice), size)
        for place, (name, size) in enumerate(sizes.items())
    }
    return replace(query, stimulus=replace(query.stimulus, images=shown))


def _names(reply: Reply, colour: str) -> bool:
    return re.search(rf"\b{colour}\b", reply.text, re.IGNORECASE) is not None


async def repeats(asker: Asker, sight: Sight, sample: Sample) -> str:
    """Return how many repeats are equal that are asked alone at temperature 0, as "5 of 5"; nothing at another one."""
    if asker.mode.temperature != 0:
        return ""
    first, *again = [await asker.ask(sample.query(0)) for _ in range(1 + REPEATS)]
    told = [sample.space.read(one).action for one in (first, *again) if one.error is None]
    same, of = sight.same
    equal = sum(one == told[0] for one in told[1:])
    return f"{max(0, same - 1) + equal} of {max(0, of - 1) + max(0, len(told) - 1)}"


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
            return _size(picture, name)
    return None


def _size(picture: bytes, name: str) -> tuple[int, int]:
    high, wide, _ = decode(picture, name).shape
    return wide, high


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
