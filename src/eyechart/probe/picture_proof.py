"""Shows a model drawn pictures, and tests whether its replies prove that it sees or is blind.

"It sees" follows from an exact test against guessing. "It is blind" needs an upper bound below one
half on the share of right answers, among replies that answer the question. Questions in words that
were never sent before reveal a cache that finds replies by their words alone.
"""

import re
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

from eyechart.calls import HOPELESS, REFUSED, Query, Reply
from eyechart.modes import FEWEST_TOKENS
from eyechart.probe.asker import Asker, LimitReachedError
from eyechart.probe.pictures import CHOICES, COUNTS, NONE, Kind, Question, questions, words
from eyechart.probe.sample import plain
from eyechart.seeds import key_seed
from eyechart.spaces.discrete import Discrete
from eyechart.stats.forced_choice import Block, ForcedChoice, right
from eyechart.stats.statistic import Statistic

ALPHA = 0.01
"""The largest probability of the outcome "sees" for a guessing model."""
HALF = 0.5
"""A model that looks is right at least this often; one with a rate surely below it is blind."""
SUDDEN = 0.1
"""A reply in less than this share of the usual time is hardly computed."""
SLOWEST_S = 0.1
"""If the usual time is shorter than this, a shorter one shows nothing."""
REPEATS = 2

Outcome = Literal["sees", "blind", "cannot_say"]

_NO_PICTURE = re.compile(
    r"\b(can(no|')t|do(n't| not)|unable|no|not|without|haven't|didn't)\b.{0,40}\b(images?|pictures?|photos?|see)\b",
    re.IGNORECASE | re.DOTALL,
)
_PICTURES = re.compile(r"(?<![a-z])(image|images|image_url|vision|multi-?modal|mmproj)(?![a-z])", re.IGNORECASE)
_DIGIT = re.compile(r"(?<![\w.-])[1-6](?![\w.-])")


@dataclass(frozen=True, slots=True)
class AnsweredQuestion:
    """A question with its picture and reply; ``said`` is the reply's choice, None without one."""

    question: Question
    reply: Reply
    said: str | None

    @property
    def is_right(self) -> bool:
        """Return whether the reply names the right answer."""
        return self.said == self.question.answer


@dataclass
class SightAnswers:
    """A model's replies: to the questions, to their words alone, and to repeats of the first.

    ``cut`` is the reason of an early end, None without one.
    """

    shots: list[AnsweredQuestion] = field(default_factory=list)
    bare: list[tuple[Kind, Reply]] = field(default_factory=list)
    again: list[Reply] = field(default_factory=list)
    cut: str | None = None

    @property
    def replies(self) -> list[Reply]:
        """Return every reply: to the questions, without a picture, and to repeats."""
        return [*(shot.reply for shot in self.shots), *(reply for _, reply in self.bare), *self.again]

    @property
    def answered(self) -> list[AnsweredQuestion]:
        """Return the shots with a choice in the reply, or with "no picture"."""
        return [shot for shot in self.shots if shot.said is not None]

    @property
    def says_none(self) -> int:
        """Return the count of replies that say that there is no picture."""
        return sum(shot.said == NONE for shot in self.shots)

    def score(self, kind: Kind | None = None, *, fresh: bool | None = None) -> Statistic:
        """Return the right answers of a kind, or of all, with the exact p against guessing."""
        return _score(
            question
            for question in self._came
            if kind in {None, question.question.kind} and fresh in {None, question.question.fresh}
        )

    def bound(self) -> Statistic:
        """Return the share of right answers among `answered`; its upper end is a 95 % bound."""
        return _score(self.answered)

    @property
    def _came(self) -> list[AnsweredQuestion]:
        return [shot for shot in self.shots if shot.reply.error is None]

    @property
    def p(self) -> float | None:
        """Return the least p against guessing, of all questions and each kind, times the number."""
        found = [p for kind in (None, *CHOICES) if (p := self.score(kind).p) is not None]
        return min(1.0, len(found) * min(found)) if found else None

    @property
    def takes_no_pictures(self) -> bool:
        """Return whether every picture was refused, while text alone was answered."""
        replies = [shot.reply for shot in self.shots]
        refused = [
            reply.error in REFUSED or (reply.error and _PICTURES.search(reply.error_detail)) for reply in replies
        ]
        plain = [reply.error is None for _, reply in self.bare]
        return len(refused) > 1 and all(refused) and bool(plain) and all(plain)

    @property
    def is_cached_by_words(self) -> bool:
        """Return whether different pictures got one reply where, and only where, words repeat."""
        p = self.score(fresh=True).p
        return bool(self._alike) and p is not None and p < ALPHA

    @property
    def is_sudden(self) -> bool:
        """Return whether exact repeats got the identical reply at once, as from a cache."""
        return self.same == (1 + REPEATS, 1 + REPEATS) and self._is_at_once(self.again)

    @property
    def is_sudden_by_words(self) -> bool:
        """Return whether different pictures with the same words got one reply a kind, at once."""
        return self._is_at_once(self._alike)

    @property
    def _alike(self) -> list[Reply]:
        """Return the replies to repeated words if each kind got a single reply, else nothing."""
        usual = [self._usual(kind) for kind in CHOICES]
        later = [reply for same in usual for reply in same[1:]]
        return later if len(later) > 2 and all(len({one.text for one in same}) <= 1 for same in usual) else []

    @property
    def fits_first(self) -> bool:
        """Return whether every answer of a kind fits its first picture, as from a prefix cache."""
        by_kind = [[shot for shot in self.shots if shot.question.kind == kind] for kind in CHOICES]
        several = [shots for shots in by_kind if len(shots) > 1]
        return bool(several) and all({shot.said for shot in shots} == {shots[0].question.answer} for shots in several)

    def _usual(self, kind: Kind) -> list[Reply]:
        """Return the replies to the repeated words of a kind."""
        return [
            question.reply for question in self._came if question.question.kind == kind and not question.question.fresh
        ]

    def _is_at_once(self, replies: Iterable[Reply]) -> bool:
        """Return whether replies took far less time than those to new words."""
        took, usual = _median(replies), _median(question.reply for question in self._came if question.question.fresh)
        return took is not None and usual is not None and usual >= SLOWEST_S and took < SUDDEN * usual

    @property
    def same(self) -> tuple[int, int]:
        """Return the count of the first picture's most frequent reply, and of all its replies."""
        texts = [reply.text for reply in (*(shot.reply for shot in self.shots[:1]), *self.again) if reply.error is None]
        return max((texts.count(text) for text in texts), default=0), len(texts)

    @property
    def image_tokens(self) -> int | None:
        """Return the tokens that a picture adds by the server's count; None without a count."""
        adds = []
        for kind, reply in self.bare:
            shown = next((one.prompt_tokens for one in self._usual(kind)), None)
            if shown and reply.prompt_tokens:
                adds.append(shown - reply.prompt_tokens)
        return round(statistics.median(adds)) if adds else None

    @property
    def outcome(self) -> Outcome:
        """Return what the replies prove: "sees", "blind" or, if neither, "cannot_say"."""
        if self.takes_no_pictures or self.is_cached_by_words:
            return "blind"
        if self.p is not None and self.p < ALPHA:
            return "sees"
        upper = self.bound().ci
        return "blind" if upper is not None and upper[1] < HALF else "cannot_say"

    @property
    def because(self) -> str:
        """Return the reason for the outcome."""
        if self.takes_no_pictures:
            return f"all {len(self.shots)} requests with a picture were refused, but their text alone was answered"
        every, bound = self.score(), self.bound()
        if not isinstance(every, ForcedChoice):
            return "no question was answered"
        counted = f"{every.right} of {every.n} right, where guessing gives {every.expected:.1f}"
        if self.is_cached_by_words:
            return f"different pictures got the identical reply whenever the words were the same ({counted})"
        if self.outcome == "sees":
            return f"{counted} (p {_p(self.p)})"
        if bound.ci is None:
            return f"none of {every.n} replies names any of the choices"
        answered = "" if bound.n == every.n else f", {bound.n} of {every.n} replies name one of the choices"
        return f"{counted} (p {_p(self.p)}){answered}; its rate is below {bound.ci[1]:.2f} (95 %)"


def _p(p: float | None) -> str:
    return "—" if p is None else "<10⁻⁴" if p < 0.0001 else f"{p:.4f}" if p < 0.01 else f"{p:.2f}"


def _score(shots: Iterable[AnsweredQuestion]) -> Statistic:
    held = list(shots)
    blocks = []
    for kind, choices in CHOICES.items():
        mine = [shot for shot in held if shot.question.kind == kind]
        dealt = [choices.index(shot.question.answer) for shot in mine]
        blocks.append(
            Block(
                len(choices), dealt, [None if shot.said not in choices else choices.index(shot.said) for shot in mine]
            )
        )
    return right(block for block in blocks if block.dealt)


def _median(replies: Iterable[Reply]) -> float | None:
    took = [reply.seconds for reply in replies if reply.seconds is not None]
    return statistics.median(took) if took else None


def said(kind: Kind, reply: Reply) -> str | None:
    """Return a reply's choice, ``NONE`` where it says that there is no picture, or None."""
    if kind == "count":
        reply = replace(reply, text=_DIGIT.sub(lambda digit: COUNTS[int(digit.group()) - 1], reply.text))
    # Version 3 takes a word that describes the picture as the answer.
    found = Discrete(kind, (*CHOICES[kind], NONE), (), (), (), reader=3).read(reply)
    if found.action is None and found.missing in {"refused", "unparsed"} and _NO_PICTURE.search(reply.text[:2000]):
        return NONE
    return found.action


async def look(asker: Asker, seed: int, *, spare: int = 0) -> SightAnswers:
    """Ask the fourteen questions, two of them again without a picture, and the first one again.

    It ends early at an error that every call would meet, or if pictures are refused. Repeats of the
    first question leave ``spare`` calls for the caller.
    """
    sight, series = SightAnswers(), questions(seed)
    try:
        for number, question in enumerate(series):
            reply = await asker.ask(_query(question.words, question.picture, seed, number))
            sight.shots.append(AnsweredQuestion(question, reply, said(question.kind, reply)))
            if number == 1 and all(shot.reply.error is not None for shot in sight.shots):
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


def _query(words: str, picture: bytes | None, seed: int, number: int) -> Query:
    return plain(words, key_seed("probe", seed, number), picture=picture)


def picture_counts(tokens: int | None) -> bool | None:
    """Return whether the server counts a picture's tokens; None where it reports no tokens."""
    return None if tokens is None else tokens >= FEWEST_TOKENS
