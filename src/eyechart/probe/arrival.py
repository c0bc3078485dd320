"""Checks that a run's pictures arrive at the model, in their own form and in parallel calls.

The drawn pictures were shown one call at a time. They are shown again in the run's form, in
parallel. If `LOST` fewer answers are right, they are shown once more, one at a time. If those
answers are right, parallel calls get each other's pictures; if not, such pictures do not arrive.
"""

import io
import random
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from PIL import Image

from eyechart.calls import Query, Reply
from eyechart.frames import media_type, size_of
from eyechart.modes import FEWEST_TOKENS
from eyechart.probe.asker import Asker
from eyechart.probe.picture_proof import AnsweredQuestion, SightAnswers, said
from eyechart.probe.pictures import CHOICES, NONE, draw, words
from eyechart.probe.sample import Sample, plain
from eyechart.seeds import key_seed

AT_ONCE = 8
"""The number of pictures in parallel calls."""
MOST_CALLS = 2 * AT_ONCE
REPEATS = 3
LOST = 5
"""The net loss of right answers with a probability below 3 in 10,000, if 9 of 10 are right."""
FLICKERS = 2
"""The least number of pictures that one call names and another misses, in each order."""
MISSED = 11
"""This many answers "no picture", of three times `AT_ONCE`, are no accident. With `FLICKERS` it is
below 2 in 10,000 for a model that says so in 15 of 100 calls at random."""
_GREY = (190, 190, 190)
_LEAST_SIDE = 256
"""The least side of a drawn picture in pixels: a weak model does not recognise a smaller one."""


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault of the pictures' transport: the name of its guard, and the reason with advice."""

    guard: str
    because: str


class Form(NamedTuple):
    """The form of a picture: its width and height in pixels, and its format."""

    wide: int
    high: int
    kind: str

    @property
    def words(self) -> str:
        """Return the form in words; PNG, the format of drawn pictures, is not named."""
        return f"{self.wide}×{self.high}" if self.kind == "PNG" else f"{self.wide}×{self.high} as {self.kind}"

    @property
    def another(self) -> str:
        """Return advice on how to make pictures that arrive."""
        smaller = f"import smaller pictures (--convert --longest {min(384, max(self.wide, self.high) - 1)})"
        said = smaller if self.kind == "PNG" else f"save them as PNG, or {smaller}"
        return f"raise the server's context or limit of pixels, or {said}"


def dropped(sight: SightAnswers, came: Sequence[Reply], bare: Reply, form: Form) -> Fault | None:
    """Return a fault if token counts prove that the server drops the run's pictures, else None.

    Drawn pictures add tokens, but a prompt with a picture of the run has only those of its text.
    """
    adds, counts = sight.image_tokens, [reply.prompt_tokens for reply in came]
    if adds is None or adds < FEWEST_TOKENS or not counts or bare.error is not None:
        return None
    if bare.prompt_tokens is None or any(count != bare.prompt_tokens for count in counts):
        return None
    return Fault(
        "picture",
        f"the server drops this run's pictures of {form.words}: a prompt with one has the {bare.prompt_tokens} "
        f"tokens of its words alone, but a drawn picture of 384×384 adds {adds}; {form.another}",
    )


async def arrives(asker: Asker, sight: SightAnswers, sample: Sample, seed: int) -> Fault | None:
    """Return a fault of pictures in the run's form, or of parallel calls; None without one.

    Makes at most `MOST_CALLS` calls. Failed calls do not count.
    """
    form = form_of(sample)
    alone = [shot for shot in sight.shots if shot.reply.error is None][:AT_ONCE]
    if form is None or len(alone) < AT_ONCE:
        return None
    queries = [
        plain(shot.question.words, key_seed("arrival", seed, number), picture=in_form(shot.question.picture, form))
        for number, shot in enumerate(alone)
    ]
    # The second half swaps its pairs: servers behind one address often take turns.
    order = sorted(range(AT_ONCE), key=lambda at: at ^ (at >= AT_ONCE // 2))
    came = await asker.together([queries[at] for at in order], sample.at_once)
    together = _shots(alone, [came[at] for at in order])
    flickers = _flickers(alone, together)
    if not flickers and _lost(alone, together) < LOST:
        return None
    again = _shots(alone, [await asker.ask(query) for query in queries])
    missed = sum(shot.said == NONE for shot in (*alone, *together, *again))
    if flickers and missed >= MISSED:
        what = f"of {3 * AT_ONCE} drawn pictures {missed} are missed, but another call names some of them rightly"
        hint = "one of several servers at this address may drop pictures: use another one, or repair the server"
        return Fault("picture", f"pictures arrive in some calls only: {what}; {hint}")
    if _lost(alone, together) < LOST:
        return None
    before, one_by_one = (f"{sum(shot.is_right for shot in shots)} of {len(shots)}" for shots in (alone, again))
    if _lost(alone, again) >= LOST:
        what = f"pictures of this run's size ({form.words}) do not arrive as they are"
        named = f"{one_by_one} drawn ones are named rightly at this size, and {before} at 384×384"
        return Fault("picture", f"{what}: {named}; {form.another}")
    at_once = f"{sum(shot.is_right for shot in together)} of {len(together)}"
    named = f"{at_once} are named rightly in parallel calls, and {one_by_one} one at a time"
    what = "the server mixes up the pictures of parallel calls"
    return Fault("picture", f"{what}: {named}; run with --concurrency 1, or repair the server")


def _flickers(before: Sequence[AnsweredQuestion], after: Sequence[AnsweredQuestion]) -> bool:
    """Return whether one call names a picture that another misses, `FLICKERS` times in each order.

    Several servers at one address answer so, if one of them drops pictures.
    """
    both = list(zip(before, after, strict=True))
    gone = sum(one.is_right and other.said == NONE for one, other in both)
    back = sum(one.said == NONE and other.is_right for one, other in both)
    return min(gone, back) >= FLICKERS


async def reuses(asker: Asker, sight: SightAnswers, seed: int) -> Fault | None:
    """Return a fault if a prefix cache gives one picture's state to another, else None.

    Two calls with pictures of a new size, made only if all named colours are the first picture's.
    With such a cache, both get the colour of the first of the two.
    """
    colours = [shot.said for shot in sight.shots if shot.question.kind == "colour"]
    named = colours[0] if colours else None
    if len(colours) < 2 or set(colours) != {named} or named != sight.shots[0].question.answer:
        return None
    dice = random.Random(key_seed("arrival", seed, "reuses"))  # noqa: S311 - no secret
    first, other = dice.sample([colour for colour in CHOICES["colour"] if colour != named], 2)
    answers = []
    for number, colour in enumerate((first, other), 100):
        picture = in_form(draw("colour", colour, dice), Form(448, 416, "PNG"))
        reply = await asker.ask(plain(words("colour"), key_seed("arrival", seed, number), picture=picture))
        answers.append(said("colour", reply))
    if answers != [first, first]:
        return None
    return Fault(
        "cache",
        "every answer fits the first picture of its size: a prefix cache gives its kept state to other pictures; "
        "switch prefix caching off for pictures, or repair the server",
    )


async def apart(asker: Asker, sight: SightAnswers, sample: Sample, seed: int) -> tuple[Fault | None, str]:
    """Check whether several pictures in one query arrive in order; return a fault, or a note.

    Makes three calls, with each camera's picture in the run's form. One colour is that of the
    first picture (in the second call, of the last), the other that of all others. If an answer
    lacks a colour, the third call leaves that picture out. Equal token counts prove that it never
    arrived; a smaller count does not, as the model may ignore it. If the server counts no pictures,
    both answers must lack a colour. The server may also have exchanged the pictures, which is a
    note: then both calls reverse the colours, and the first picture gets the last one's colour.
    """
    forms = {name: _form(picture, name) for name, picture in sample.questions[0][1].images.items()}
    if len(forms) < 2:
        return None, ""
    colours = _colours(seed)
    first, *_, last = forms
    shown = [{name: colours[name != first] for name in forms}, {name: colours[2 + (name == last)] for name in forms}]
    replies = [
        await asker.ask(_of_several(forms, one, key_seed("arrival", seed, 200 + number)))
        for number, one in enumerate(shown)
    ]
    if any(reply.error is not None for reply in replies):
        failed = next(reply.error_detail for reply in replies if reply.error is not None)
        return None, f"{len(forms)} pictures in one query failed: {failed[:200]}"
    if _is_turned(replies[0], colours[:2]) and _is_turned(replies[1], colours[2:]):
        both = {name: colours[1 + (name != first)] for name in forms}
        return None, await _of_first(asker, forms, both, key_seed("arrival", seed, 202))
    named = [_named_in(reply, one) for reply, one in zip(replies, shown, strict=True)]
    some = [number for number, names in enumerate(named) if 0 < len(names) < len(forms)]
    if not some:
        return None, ""
    rest = {name: forms[name] for name in named[some[0]]}
    fewer = await asker.ask(_of_several(rest, shown[some[0]], key_seed("arrival", seed, 202)))
    counts = (sight.image_tokens or 0) >= FEWEST_TOKENS  # else the server counts only text tokens
    tokens = (replies[some[0]].prompt_tokens, fewer.prompt_tokens) if counts else (None, None)
    return _left_out(forms, len(rest), tokens, every=len(some) == len(shown))


def _colours(seed: int) -> list[str]:
    """Return four colours: two in the order of the choices, and two in reverse order."""
    dice = random.Random(key_seed("arrival", seed, "apart"))  # noqa: S311 - no secret
    colours = dice.sample(CHOICES["colour"], 4)
    colours[:2] = sorted(colours[:2], key=CHOICES["colour"].index)
    colours[2:] = sorted(colours[2:], key=CHOICES["colour"].index, reverse=True)
    return colours


def _named_in(reply: Reply, shown: Mapping[str, str]) -> list[str]:
    """Return the cameras with a colour that the answer names."""
    return [name for name, colour in shown.items() if _names(reply, colour)]


def _left_out(
    forms: Mapping[str, Form], named: int, tokens: tuple[int | None, int | None], *, every: bool
) -> tuple[Fault | None, str]:
    """Return a fault or a note on answers that name only some pictures of a query.

    ``tokens`` are of all pictures and of the named ones, None if the server counts none.
    ``every``: all answers lack a picture.
    """
    whole, fewer = tokens
    counted = bool(whole and fewer)
    if whole and fewer and whole > fewer:
        return None, f"it names {named} of {len(forms)} pictures by their colours; the server counts all of them"
    if not counted and not every:
        return None, f"one of two answers names {named} of {len(forms)} pictures of a query by their colours"
    several = sorted({form.words for form in forms.values()}, reverse=True)
    of = "one size" if len(several) == 1 else f"sizes {' and '.join(several)}"
    what = f"of {len(forms)} pictures of {of} in one query {named} arrive: no answer names the colour of another"
    return Fault("picture", f"{what}; repair the server, or run on fewer cameras"), ""


async def _of_first(asker: Asker, forms: Mapping[str, Form], shown: Mapping[str, str], seed: int) -> str:
    """Return a note if the first of several pictures gets the last one's colour, else ""."""
    question = (
        "Each picture shows a shape of one colour. Which colour is it in the first picture? Answer with one word: "
    )
    reply = await asker.ask(_of_several(forms, shown, seed, question))
    first, *_, last = shown.values()
    if reply.error is not None or _names(reply, first) or not _names(reply, last):
        return ""
    return (
        f"of {len(forms)} pictures in one query it takes the first for another: the server exchanges them, or the "
        "model does not know their order. Before you trust the result of one camera, repair the server or use one"
    )


def _is_turned(reply: Reply, colours: Sequence[str]) -> bool:
    """Return whether an answer names both colours, in reverse order."""
    first, second = (re.search(rf"\b{colour}\b", reply.text, re.IGNORECASE) for colour in colours)
    return first is not None and second is not None and second.start() < first.start()


_ALL = "Each picture shows a shape of one colour. Which colours are there? Answer with all, in the pictures' order: "


def _of_several(forms: Mapping[str, Form], shown: Mapping[str, str], seed: int, question: str = _ALL) -> Query:
    """Return a query with a picture for each camera: a shape of that camera's colour."""
    question = f"{question}{', '.join(CHOICES['colour'])}."
    query, dice = plain(question, seed), random.Random(seed)  # noqa: S311 - no secret
    images = {name: in_form(draw("colour", shown[name], dice), form) for name, form in forms.items()}
    return replace(query, stimulus=replace(query.stimulus, images=images))


def _names(reply: Reply, colour: str) -> bool:
    return re.search(rf"\b{colour}\b", reply.text, re.IGNORECASE) is not None


async def repeats(asker: Asker, sight: SightAnswers, sample: Sample) -> str:
    """Return the count of equal repeats, called singly at temperature 0, as "5 of 5"; else ""."""
    if asker.mode.temperature != 0:
        return ""
    first, *again = [await asker.ask(sample.query(0)) for _ in range(1 + REPEATS)]
    actions = [sample.space.read(one).action for one in (first, *again) if one.error is None]
    same, of = sight.same
    equal = sum(one == actions[0] for one in actions[1:])
    return f"{max(0, same - 1) + equal} of {max(0, of - 1) + max(0, len(actions) - 1)}"


def _shots(questions: Sequence[AnsweredQuestion], replies: Sequence[Reply]) -> list[AnsweredQuestion]:
    return [
        AnsweredQuestion(question.question, reply, said(question.question.kind, reply))
        for question, reply in zip(questions, replies, strict=True)
    ]


def _lost(before: Sequence[AnsweredQuestion], after: Sequence[AnsweredQuestion]) -> int:
    """Return the net loss of right answers, among calls that did not fail."""
    both = [
        (question.is_right, other.is_right)
        for question, other in zip(before, after, strict=True)
        if other.reply.error is None
    ]
    return sum(one - other for one, other in both)


def form_of(sample: Sample) -> Form | None:
    """Return the form of a run's largest picture, None where it shows none."""
    forms = [_form(picture, name) for _, seen in sample.questions for name, picture in seen.images.items()]
    return max(forms, key=lambda form: form.wide * form.high, default=None)


def _form(picture: bytes, name: str) -> Form:
    return Form(*size_of(picture, name), media_type(picture).removeprefix("image/").upper())


def in_form(picture: bytes, form: Form) -> bytes:
    """Return a drawn picture (PNG) in a form's format, on grey of its size if that is not small."""
    drawn = Image.open(io.BytesIO(picture)).convert("RGB")
    side = min(form.wide, form.high, *drawn.size)
    if side >= _LEAST_SIDE:
        canvas = Image.new("RGB", form[:2], _GREY)
        shown = drawn if side == drawn.width else drawn.resize((side, side))
        canvas.paste(shown, ((form.wide - side) // 2, (form.high - side) // 2))
        drawn = canvas
    elif form.kind == "PNG":
        return picture
    written = io.BytesIO()
    drawn.save(written, form.kind, quality=95)
    return written.getvalue()
