"""Shows a model drawn pictures and says what its replies prove: that it sees, that it is blind, or neither.

"It sees" is a claim by an exact test against guessing; "it is blind" needs a bound below one half on how often it is
right where it answers what was asked. Questions in words that were never sent before tell a model from a cache that
knows replies by their words alone.
"""

import re
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

from eyechart.calls import HOPELESS, REFUSED, Query, Reply
from eyechart.modes import FEWEST_TOKENS
from eyechart.probe.asking import Asker, LimitReachedError
from eyechart.probe.pictures import CHOICES, COUNTS, NONE, Kind, Question, questions, words
from eyechart.probe.sample import plain
from eyechart.seeds import key_seed
from eyechart.spaces.discrete import Discrete
from eyechart.stats.guessing import Answered, Block, right
from eyechart.stats.statistic import Statistic

ALPHA = 0.01
"""The chance of calling a guesser one that sees is at most this."""
HALF = 0.5
"""Who looks is right at least so often; a model whose rate is bounded below it is called blind."""
SUDDEN = 0.1
"""A reply that takes less than this share of the usual time was hardly computed."""
SLOWEST_S = 0.1
"""Where the usual time is shorter than this, nothing can be said from a shorter one."""
REPEATS = 2

Outcome = Literal["sees", "blind", "cannot_say"]

_NO_PICTURE = re.compile(
    r"\b(can(no|')t|do(n't| not)|unable|no|not|without|haven't|didn't)\b.{0,40}\b(images?|pictures?|photos?|see)\b",
    re.IGNORECASE | re.DOTALL,
)
_PICTURES = re.compile(r"(?<![a-z])(image|images|image_url|vision|multi-?modal|mmproj)(?![a-z])", re.IGNORECASE)
_DIGIT = re.compile(r"(?<![\w.-])[1-6](?![\w.-])")


@dataclass(frozen=True, slots=True)
class Shot:
    """A question with its picture, and the reply; ``said`` is the choice that it names, None where it names none."""

    question: Question
    reply: Reply
    said: str | None

    @property
    def right(self) -> bool:
        """Return whether it is the right answer."""
        return self.said == self.question.answer


@dataclass
class Sight:
    """What a model replied: to the questions, to the same words ``bare`` of a picture, to the first one ``again``.

    ``cut`` says why the questions ended early, if they did.
    """

    shots: list[Shot] = field(default_factory=list)
    bare: list[tuple[Kind, Reply]] = field(default_factory=list)
    again: list[Reply] = field(default_factory=list)
    cut: str | None = None

    @property
    def replies(self) -> list[Reply]:
        """Return every reply, in the order of the kinds."""
        return [*(one.reply for one in self.shots), *(reply for _, reply in self.bare), *self.again]

    @property
    def answered(self) -> list[Shot]:
        """Return the shots whose reply names a choice, or says that there is no picture."""
        return [one for one in self.shots if one.said is not None]

    @property
    def says_none(self) -> int:
        """Return how many replies say that there is no picture."""
        return sum(one.said == NONE for one in self.shots)

    def score(self, kind: Kind | None = None, *, fresh: bool | None = None) -> Statistic:
        """Return how many of the shots of a kind are right, with the exact p against guessing; of all for None."""
        return _score(
            one for one in self._came if kind in {None, one.question.kind} and fresh in {None, one.question.fresh}
        )

    def bound(self) -> Statistic:
        """Return the share right where the model answered what was asked; its upper end bounds it at 95 %."""
        return _score(self.answered)

    @property
    def _came(self) -> list[Shot]:
        return [one for one in self.shots if one.reply.error is None]

    @property
    def p(self) -> float | None:
        """Return the p against guessing: the smallest of all questions and of each kind, times their number."""
        found = [p for kind in (None, *CHOICES) if (p := self.score(kind).p) is not None]
        return min(1.0, len(found) * min(found)) if found else None

    @property
    def takes_no_pictures(self) -> bool:
        """Return whether every picture was refused for being one, and the words alone were answered."""
        replies = [one.reply for one in self.shots]
        refused = [one.error in REFUSED or (one.error and _PICTURES.search(one.error_detail)) for one in replies]
        plain = [reply.error is None for _, reply in self.bare]
        return len(refused) > 1 and all(refused) and bool(plain) and all(plain)

    @property
    def cached_by_words(self) -> bool:
        """Return whether different pictures got one reply wherever the words were the same, and only there."""
        p = self.score(fresh=True).p
        return bool(self._alike) and p is not None and p < ALPHA

    @property
    def sudden(self) -> bool:
        """Return whether exact repeats got the identical reply at once, as a cache gives it."""
        return self.same == (1 + REPEATS, 1 + REPEATS) and self._at_once(self.again)

    @property
    def sudden_by_words(self) -> bool:
        """Return whether different pictures with the same words got one reply each kind, at once."""
        return self._at_once(self._alike)

    @property
    def _alike(self) -> list[Reply]:
        """Return what came to words that were sent before, where each kind got one reply; nothing where one did not."""
        usual = [self._usual(kind) for kind in CHOICES]
        later = [reply for same in usual for reply in same[1:]]
        return later if len(later) > 2 and all(len({one.text for one in same}) <= 1 for same in usual) else []

    @property
    def fits_first(self) -> bool:
        """Return whether every answer of each kind is that of its first picture, as from a cache that keeps one."""
        by_kind = [[one for one in self.shots if one.question.kind == kind] for kind in CHOICES]
        several = [shots for shots in by_kind if len(shots) > 1]
        return bool(several) and all({one.said for one in shots} == {shots[0].question.answer} for shots in several)

    def _usual(self, kind: Kind) -> list[Reply]:
        """Return what came to the words that are the same in every question of a kind."""
        return [one.reply for one in self._came if one.question.kind == kind and not one.question.fresh]

    def _at_once(self, replies: Iterable[Reply]) -> bool:
        """Return whether replies took far less time than those to words that were never sent before."""
        took, usual = _median(replies), _median(one.reply for one in self._came if one.question.fresh)
        return took is not None and usual is not None and usual >= SLOWEST_S and took < SUDDEN * usual

    @property
    def same(self) -> tuple[int, int]:
        """Return how many replies to the first picture are the one that it got most often, of how many."""
        texts = [reply.text for reply in (*(one.reply for one in self.shots[:1]), *self.again) if reply.error is None]
        return max((texts.count(text) for text in texts), default=0), len(texts)

    @property
    def image_tokens(self) -> int | None:
        """Return how many tokens a picture adds to the same words, as the server counts; None where it does not."""
        adds = []
        for kind, reply in self.bare:
            shown = next((one.prompt_tokens for one in self._usual(kind)), None)
            if shown and reply.prompt_tokens:
                adds.append(shown - reply.prompt_tokens)
        return round(statistics.median(adds)) if adds else None

    @property
    def outcome(self) -> Outcome:
        """Return what the replies prove."""
        if self.takes_no_pictures or self.cached_by_words:
            return "blind"
        if self.p is not None and self.p < ALPHA:
            return "sees"
        upper = self.bound().ci
        return "blind" if upper is not None and upper[1] < HALF else "cannot_say"

    @property
    def because(self) -> str:
        """Return in words what decided the outcome."""
        if self.takes_no_pictures:
            return f"all {len(self.shots)} requests with a picture were refused, and the same words alone were answered"
        every, bound = self.score(), self.bound()
        if not isinstance(every, Answered):
            return "no question was answered"
        counted = f"{every.right} of {every.n} right, where guessing gives {every.expected:.1f}"
        if self.cached_by_words:
            return f"different pictures got the identical reply whenever the words were the same ({counted})"
        if self.outcome == "sees":
            return f"{counted} (p {_p(self.p)})"
        if bound.ci is None:
            return f"none of {every.n} replies names any of the choices"
        answered = "" if bound.n == every.n else f", {bound.n} of {every.n} replies name one of the choices"
        return f"{counted} (p {_p(self.p)}){answered}; its rate is below {bound.ci[1]:.2f} (95 %)"


def _p(p: float | None) -> str:
    return "—" if p is None else "<10⁻⁴" if p < 0.0001 else f"{p:.4f}" if p < 0.01 else f"{p:.2f}"


def _score(shots: Iterable[Shot]) -> Statistic:
    held = list(shots)
    blocks = []
    for kind, choices in CHOICES.items():
        mine = [one for one in held if one.question.kind == kind]
        dealt = [choices.index(one.question.answer) for one in mine]
        blocks.append(
            Block(len(choices), dealt, [None if one.said not in choices else choices.index(one.said) for one in mine])
        )
    return right(one for one in blocks if one.dealt)


def _median(replies: Iterable[Reply]) -> float | None:
    took = [reply.seconds for reply in replies if reply.seconds is not None]
    return statistics.median(took) if took else None


def said(kind: Kind, reply: Reply) -> str | None:
    """Return the choice that a reply names, ``NONE`` where it says that there is no picture, or None."""
    if kind == "count":
        reply = replace(reply, text=_DIGIT.sub(lambda digit: COUNTS[int(digit.group()) - 1], reply.text))
    # What is there is asked, not what to do: a name that describes the picture is the answer, as version 3 reads it.
    found = Discrete(kind, (*CHOICES[kind], NONE), (), (), (), reader=3).read(reply)
    if found.action is None and found.missing in {"refused", "unparsed"} and _NO_PICTURE.search(reply.text[:2000]):
        return NONE
    return found.action


async def look(asker: Asker, seed: int, *, spare: int = 0) -> Sight:
    """Ask the fourteen questions, two of them again without a picture, and the first one again with it.

    It ends early where nothing that comes is an answer: an error that every call would meet, or pictures refused. The
    first one is asked again only as often as leaves ``spare`` calls to whoever asks on.
    """
    sight, asked = Sight(), questions(seed)
    try:
        for number, question in enumerate(asked):
            reply = await asker.ask(_query(question.words, question.picture, seed, number))
            sight.shots.append(Shot(question, reply, said(question.kind, reply)))
            if number == 1 and all(one.reply.error is not None for one in sight.shots):
                break  # there is no use in going on
        if sight.shots[-1].reply.error in HOPELESS:
            return sight
        kinds: Sequence[Kind] = ("colour", "count") if len(sight.shots) > 2 else ("colour",)
        for place, kind in enumerate(kinds):
            sight.bare.append((kind, await asker.ask(_query(words(kind), None, seed, 100 + place))))
        room = asker.most - asker.spent.calls - spare
        for place in range(min(REPEATS, room) if len(sight.shots) > 2 else 0):
            first = sight.shots[0].question
            sight.again.append(await asker.ask(_query(first.words, first.picture, seed, 200 + place)))
    except LimitReachedError as limit:
        sight.cut = str(limit)
    return sight


def _query(asked: str, picture: bytes | None, seed: int, number: int) -> Query:
    return plain(asked, key_seed("probe", seed, number), picture=picture)


def picture_counts(tokens: int | None) -> bool | None:
    """Return whether the server counts a picture; None where it does not count, or says too little."""
    return None if tokens is None else tokens >= FEWEST_TOKENS
