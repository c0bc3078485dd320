"""Guards: sanity checks that say whether a run is reliable.

They check that pictures arrived, that each call has one outcome, and that no answer is a copy. A
guard holds, fails, or cannot say; a failed one marks the verdict wherever it is printed.
"""

import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eyechart.calls import Emptiness, Reply
from eyechart.errors import printable
from eyechart.ledger import AGAIN, TEXTS_KEPT, Attempts
from eyechart.modes import ALONE, FEWEST_TOKENS, RequestMode, is_made_elsewhere
from eyechart.spaces.space import ending
from eyechart.stats.forced_choice import fewer_p

Ints = NDArray[np.integer[Any]]

FEWEST = 8
"""The fewest pairs for a suspicion."""
SUDDEN = 0.1
"""A repeat in less than this share of the first answer's time was hardly computed."""
MOST = 0.9
"""From this share of pairs on it is no accident."""

_TEXTS_KEPT = 1000
_OTHERS = "(others)"
_MARK = re.compile(r" (fp_\w+|b\d+-\w+|[0-9a-f]{8,}|[\w.]+-[0-9a-f]{8,})$")
"""The forms of server fingerprints: of OpenAI, of llama.cpp, and digests."""
_SHOWN = 3
_NAME_SHOWN = 60
_DIFFERS = {"model": "models", "provider": "providers", "system_fingerprint": "configurations (system_fingerprint)"}


@dataclass(frozen=True, slots=True)
class Guard:
    """One guard: its name, whether it holds (None is "cannot say"), and why."""

    name: str
    holds: bool | None
    because: str

    @property
    def mark(self) -> str:
        """Return in words that the guard failed, and why."""
        return f"guard '{self.name}' failed: {self.because}"

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        outcome = {True: "holds", False: "fails", None: "cannot say"}[self.holds]
        return {**asdict(self), "outcome": outcome}


def unfinished(over: int, whole: int, what: str = "calls", *, part: bool = False) -> str:
    """Return in words how far an unfinished run is; a ``part`` of a run is always unfinished."""
    return f"unfinished: {over} of {whole} {what}" if part or over < whole else ""


@dataclass(frozen=True, slots=True)
class ServedModel:
    """What answered, by its replies: names, count, and the times of the first and last call."""

    model: str | None
    provider: str | None
    system_fingerprint: str | None
    replies: int
    since: str
    until: str

    @property
    def words(self) -> str:
        """Return it in words."""
        names = (self.model, self.provider, self.system_fingerprint)
        name = " ".join(_shown(printable(one)) for one in names if one)
        return f"{name} ({self.replies} replies, {self.since} to {self.until})"


@dataclass(frozen=True, slots=True)
class ServedGuard(Guard):
    """Whether one model answered throughout; ``answered`` is in order of first replies.

    ``differs`` names what differs: model, provider, system_fingerprint.
    """

    answered: tuple[ServedModel, ...] = ()
    differs: tuple[str, ...] = ()

    @property
    def is_by_fingerprint(self) -> bool:
        """Return whether only the server's fingerprint differs."""
        return self.differs == ("system_fingerprint",)


class ServedChecks:
    """Compares the names in a model's replies, in the order of sending.

    A probed ``mode`` records the names of that time; another model later is a difference.
    """

    def __init__(self, attempts: Attempts, model: str, mode: RequestMode | None = None) -> None:
        self._probed: Mapping[str, str] = {} if mode is None or mode.measured is None else mode.measured.facts
        self._found: dict[tuple[str | None, str | None, str | None], tuple[int, str, str]] = {}
        self._unnamed = 0
        own = attempts.code("model", model)
        for (code, said), counted in attempts.served.items():
            if code == own:
                self._add(_named(*said[:3], older=said[3]), *counted)

    def _add(self, named: tuple[str | None, str | None, str | None], replies: int, since: str, until: str) -> None:
        """Add replies with the same names; those without any are counted."""
        self._unnamed += replies * (named[0] is None)
        if named == (None, None, None):
            return
        if named not in self._found and len(self._found) >= _TEXTS_KEPT:  # some servers rename each
            named = (named[0], named[1], _OTHERS) if named[2] else (_OTHERS, None, None)
            if named not in self._found and len(self._found) >= 2 * _TEXTS_KEPT:
                named = (_OTHERS, None, None)
        count, first, last = self._found.get(named, (0, since, ""))
        self._found[named] = (count + replies, first, max(last, until))

    def unlike(self) -> dict[str, str]:
        """Return in words the ``model`` and ``provider`` that differ from the probe's.

        Names that the probe did not record are skipped.
        """
        result = {}
        for name, fact in (("model", "served"), ("provider", "provider")):
            tables = self._probed.get(fact, "").split(", ")
            now = sorted({one for named in self._found if (one := named[name == "provider"]) not in {None, _OTHERS}})
            others = [one for one in now if not any(f"{known} ".startswith(f"{one} ") for known in tables)]
            if self._probed.get(fact) and others:
                before, after = (_shown(printable(one)) for one in (self._probed[fact], others[0]))
                result[name] = f"the probe saw {before}, and {after} answered"
        return result

    def guards(self) -> tuple[ServedGuard, ...]:
        """Return the guard, or none if no reply has a name."""
        answered = tuple(ServedModel(*named, *counted) for named, counted in self._found.items())
        if not answered:
            return ()
        several = {name: {getattr(model, name) for model in answered} - {None} for name in _DIFFERS}
        unlike = self.unlike()
        differs = tuple(name for name, found in several.items() if len(found) > 1 or name in unlike)
        shown = "; ".join(model.words for model in answered[:_SHOWN])
        more = f"; and {len(answered) - _SHOWN} more" if len(answered) > _SHOWN else ""
        if not differs and self._unnamed and several["model"]:
            replies = self._unnamed + sum(model.replies for model in answered if model.model)
            counted = f"{self._unnamed} of {replies} replies do not name their model, and the others do"
            words = f"{counted}, so another model may have answered: {shown}{more}"
            return (ServedGuard("served", False, words, answered, ("model",)),)
        if not differs:
            return (ServedGuard("served", True, f"one model answered: {shown}{more}", answered),)
        counted = " and ".join(f"{len(several[name])} {_DIFFERS[name]}" for name in differs if len(several[name]) > 1)
        parts = [*unlike.values(), f"{counted or 'one model'} answered: {shown}{more}"]
        return (ServedGuard("served", False, "; ".join(parts), answered, differs),)


class RequestChecks:
    """Compares the requests of all attempts at the same call, by any of a run's models.

    Every model must be shown the same for one frame, condition and prompt. A row without a digest
    is skipped.
    """

    def __init__(self, attempts: Attempts, models: Iterable[str]) -> None:
        self._unlike: dict[str, dict[tuple[str, ...], None]] = {}
        self._attempts, models = attempts, list(models)
        size, held = math.prod(len(attempts.names[name]) for name in _ASKED), None
        if size > max(_DENSE, 2 * len(attempts.call)):
            held = np.unique(
                np.concatenate([np.zeros(0, dtype=np.int64), *map(self._questions, map(self._rows, models))])
            )
            size = len(held)
        first = np.full(size, -1, dtype=np.int64)
        for rows in map(self._rows, models):  # one by one: all at once take much memory
            questions = self._questions(rows) if held is None else np.searchsorted(held, self._questions(rows))
            new = np.flatnonzero(first[questions] < 0)
            calls, place = np.unique(questions[new], return_index=True)
            first[calls] = rows[new[place]]
            before = first[questions]
            for at in np.flatnonzero(attempts.request[rows] != attempts.request[before]).tolist():
                key = attempts.key(int(rows[at]))
                same = tuple(map(str, (key.study, *key[2:])))
                for model in (key.model, attempts.key(int(before[at])).model):
                    self._unlike.setdefault(model, {})[same] = None

    def _rows(self, model: str) -> Ints:
        """Return the rows of a model that have a digest."""
        rows = self._attempts.of(model)
        return rows[self._attempts.request[rows] >= 0]

    def _questions(self, rows: Ints) -> Ints:
        """Return a number for what each row asks of any model."""
        questions = np.zeros(len(rows), dtype=np.int64)
        for name in _ASKED:
            questions = questions * len(self._attempts.names[name]) + self._attempts.codes[name][rows]
        return questions

    def guards(self, model: str) -> tuple[Guard, ...]:
        """Return the guard of a model, or none if its requests equal those of the others."""
        if model not in self._unlike:
            return ()
        found = self._unlike[model]
        _, _, frame, condition, _ = next(iter(found))
        where = f"first of frame '{printable(frame)}' under {printable(condition)}"
        says = f"{len(found)} calls have two digests of their request, {where}: another picture, or other words"
        return (Guard("shown", False, f"{says}, for another model or in another attempt"),)


def _shown(name: str) -> str:
    half = _NAME_SHOWN // 2
    return name if len(name) <= _NAME_SHOWN else f"{name[:half]}…{name[-half:]}"


_ASKED = ("study", "prompt", "frame", "condition", "repeat")
"""What names a call to any model."""
_DENSE = 1_000_000
"""Up to so many calls, of all that these names could make, have a place each."""


def names_of(reply: Reply) -> tuple[str | None, str | None, str | None]:
    """Return model, provider and fingerprint; an older ledger has the last behind the first.

    A model's name may have several words, so only what looks like a fingerprint is one.
    """
    return _named(reply.served, reply.provider, reply.system_fingerprint, older=reply.payload_sha256 is None)


def _named(
    served: str | None, provider: str | None, mark: str | None, *, older: bool
) -> tuple[str | None, str | None, str | None]:
    if served and mark:
        served = served.removesuffix(f" {mark}")
    elif served and older and (behind := _MARK.search(served)):
        served, mark = served[: behind.start()], behind.group(1)
    return served or None, provider or None, mark or None


def guards_of(
    attempts: Attempts, model: str, mode: RequestMode, planned: tuple[int, int], fingerprint: str, counted: str
) -> tuple[Guard, ...]:
    """Return every guard of a model; ``fingerprint`` is that of the bank's checked geometry.

    ``planned`` are the numbers of planned calls and of those without an outcome. ``counted`` says in
    words how many attempts there were and how they ended.
    """
    rows, served = attempts.of(model), ServedChecks(attempts, model, mode)
    plain = rows[attempts.error(rows, [None])]
    outcomes = _outcomes(planned, _twice(attempts, rows), counted)
    constant, ends = _constant(attempts, model, plain), _Ends.of(attempts, plain)
    if is_made_elsewhere(mode.spec):
        named = served.guards()
        return (
            *(Guard(name, None, words) for name, words in _ELSEWHERE.items()),
            outcomes,
            Guard("geometry", True, f"the answers are to the calls of this bank, by their keys ({fingerprint[:8]})"),
            constant,
            ends.guard(),
            *(named if any(not guard.holds for guard in named) else (_UNNAMED,)),
        )
    repeats = _Repeats.of(attempts, model, _alone(mode))
    return (
        _picture(_tokens(attempts, plain), mode, served.unlike()),
        outcomes,
        Guard("geometry", True, f"the frames have the geometry that the run was made on ({fingerprint[:8]})"),
        constant,
        repeats.guard(mode),
        *repeats.under_load(),
        *([ends.guard()] if ends.unknown else []),
        *served.guards(),
    )


def _emptiness(attempts: Attempts, rows: Ints) -> Emptiness:
    """Return the counts of replies without an error, and of empty ones among them."""
    ends = attempts.names["finish_reason"]
    found, silent = Emptiness(came=int((~attempts.silent[rows]).sum())), rows[attempts.silent[rows]]
    codes = attempts.codes["finish_reason"][silent].astype(np.int64) * 2 + attempts.thought[silent]
    for code, count in enumerate(np.bincount(codes).tolist()):
        end, thought = ends[code // 2], code % 2 == 1
        cut = ending(end) == "cut"
        called = not cut and end == "tool_calls"
        one = (1, not cut, thought and not cut, cut, thought and cut, called)
        found += Emptiness(*(count * of for of in one))
    return found


TokenCounts = Mapping[str, tuple[Ints, Ints]]
"""By condition: what was asked, a prompt about a frame, and the tokens of its last reply."""


def _tokens(attempts: Attempts, rows: Ints) -> TokenCounts:
    if "prompt_tokens" not in attempts.whole:
        return {}
    counts, frames = attempts.whole["prompt_tokens"], len(attempts.names["frame"])
    rows = rows[counts[rows] > 0]
    questions = attempts.codes["prompt"][rows].astype(np.int64) * frames + attempts.codes["frame"][rows]
    conditions, found = attempts.codes["condition"][rows], {}
    for code in np.flatnonzero(np.bincount(conditions)).tolist():
        own = np.flatnonzero(conditions == code)[::-1]
        which, last = np.unique(questions[own], return_index=True)
        found[attempts.names["condition"][code]] = (which, counts[rows[own[last]]].astype(np.int64))
    return found


_ELSEWHERE = {
    "calls": "eyechart did not make these calls: only their maker knows the questions and the model",
    "picture": "eyechart did not make the calls, so nothing shows that pictures arrived",
    "cache": "eyechart did not make the calls, so nothing shows that each was answered anew",
}
"""The reasons for answers that were made elsewhere, by guard."""
_UNNAMED = Guard("served", None, "eyechart did not make the calls, so nothing shows that one model answered them")


_ENDS_KEPT = 100
"""The most distinct finish reasons to count; all others count as one."""


@dataclass(slots=True)
class _Ends:
    """How replies ended: their number, those without a reason, and unknown reasons."""

    came: int = 0
    unsaid: int = 0
    unknown: Counter[str] = field(default_factory=Counter)

    @classmethod
    def of(cls, attempts: Attempts, rows: Ints) -> "_Ends":
        """Count replies by their finish reasons."""
        found, codes = cls(came=len(rows)), attempts.codes["finish_reason"][rows]
        words, first, counts = np.unique(codes, return_index=True, return_counts=True)
        for at in np.argsort(first).tolist():
            reason, count = attempts.names["finish_reason"][words[at]], int(counts[at])
            found.unsaid += count * (reason is None)
            if reason is not None and ending(reason) is None:
                known = reason in found.unknown or len(found.unknown) < _ENDS_KEPT
                found.unknown[reason if known else "another word"] += count
        return found

    def guard(self) -> Guard:
        """Return whether every reply has a known finish reason."""
        aside = "a reply that was cut off would be read as a whole one"
        if self.unknown:
            word = _beginning(self.unknown.most_common(1)[0][0]) + (" and others" if len(self.unknown) > 1 else "")
            words = f"{self.unknown.total()} of {self.came} answers end with {word}, an unknown finish reason"
            return Guard("truncation", None, f"{words}: {aside}")
        if self.unsaid:
            return Guard("truncation", None, f"{self.unsaid} of {self.came} answers name no finish reason: {aside}")
        return Guard("truncation", True, f"each of {self.came} answers names its finish reason")


_SHOWN_BEFORE = frozenset({"text_only", "real_repeat", "shuffled", "cross_scenario", "blank"})
"""Conditions without a picture of their own; a server may omit cached tokens for them."""


def _dropped(tokens: TokenCounts) -> str:
    """Return how many prompts with a picture have the tokens of their words alone, or ""."""
    questions, bare = tokens.get("text_only", _NO_TOKENS)
    if not len(bare) or bare.min() < max(FEWEST_TOKENS, bare.max() / 2):
        return ""
    for condition, (which, counts) in sorted(tokens.items(), key=lambda one: (one[0] != "real", one[0])):
        _, here, there = np.intersect1d(which, questions, assume_unique=True, return_indices=True)
        lost = int((counts[here] == bare[there]).sum())
        if lost and condition.partition("@")[0] not in _SHOWN_BEFORE:
            named = "" if condition == "real" else f", under {condition},"
            return f"{lost} of {len(here)} prompts with a picture{named} have exactly the tokens of the words alone"
    return ""


_NO_TOKENS = (np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64))


def _picture(tokens: TokenCounts, mode: RequestMode, unlike: Mapping[str, str]) -> Guard:
    """Return whether pictures arrived, by a probe of the same model or by the server's tokens.

    ``tokens`` are those of prompts by condition and frame. If a probe saw that the server counts
    pictures, a prompt with a picture but only the tokens of its words lost the picture.
    """
    found, shown, bare = mode.measured, *(tokens.get(name, _NO_TOKENS)[1] for name in ("real", "text_only"))
    if found is not None and (found.image_tokens or 0) >= FEWEST_TOKENS and not unlike and (words := _dropped(tokens)):
        words = f"{words}, where the probe's picture added {found.image_tokens}"
        return Guard("picture", False, f"pictures were dropped on the way: {words}")
    if found is not None and found.sees_image is not None and not unlike:
        words = f": {found.facts['picture']}" if "picture" in found.facts else ""
        says = f"the model {'saw' if found.sees_image else 'did not see'} the probe's pictures{words}"
        return Guard("picture", found.sees_image, says)
    adds = float(np.median(shown) - np.median(bare)) if len(shown) and len(bare) else None
    if adds is not None and adds >= FEWEST_TOKENS:
        return Guard("picture", True, f"a picture adds {adds:.0f} tokens to the prompt, as the server counts it")
    counted = ""
    if adds is not None:
        much = f"{adds:.0f} tokens" if adds else "no token"
        counted = f"; a picture adds {much} to the prompt, as the server counts it" + "; too few for one" * bool(adds)
    return Guard("picture", None, f"no probe has shown that pictures arrive{counted}")


_QUOTED = 40
"""Characters of a reply that a guard quotes."""


def _beginning(text: str) -> str:
    """Return a reply in quotes; of a long one, the beginning."""
    return repr(text) if len(text) <= _QUOTED else f"{text[:_QUOTED]!r} …"


def _constant(attempts: Attempts, model: str, rows: Ints) -> Guard:
    """Return whether a model's replies without an error differ from each other."""
    empty, texts = _emptiness(attempts, rows), attempts.texts.get(attempts.code("model", model), frozenset())
    replies, aside = empty.came, f"; {empty.words}" if empty.thought else ""
    if empty.is_whole:
        return Guard("degeneracy", False, empty.words)
    if replies < FEWEST:
        return Guard("degeneracy", None, f"{replies} replies are too few to call them constant{aside}")
    if len(texts) == 1:
        return Guard("degeneracy", False, f"all {replies} replies are the same: {_beginning(min(texts))}")
    each = np.bincount(attempts.decision[rows], minlength=len(attempts.decisions)).tolist()
    decided = Counter[str]()
    for one, count in zip(attempts.decisions, each, strict=True):
        decided.update({} if one.action is None or not count else {str(one.action): count})
    if len(decided) == 1 and (count := sum(decided.values())) >= FEWEST:
        return Guard("degeneracy", False, f"all {count} decisions are the same: {min(decided)}{aside}")
    more = " or more" if len(texts) == TEXTS_KEPT else ""
    return Guard("degeneracy", True, f"{len(texts)}{more} different replies among {replies}{aside}")


def _twice(attempts: Attempts, rows: Ints) -> int:
    """Return how many outcomes followed one of the same call; a retried call has one, its last."""
    order = rows[np.argsort(attempts.call[rows], kind="stable")]
    again = np.cumsum(attempts.codes["reason"][order] == attempts.code("reason", AGAIN))
    ended = np.flatnonzero(attempts.finishing(order))
    call, repeats = attempts.call[order[ended]], again[ended]
    return int(((call[1:] == call[:-1]) & (repeats[1:] == repeats[:-1])).sum())


def _outcomes(planned: tuple[int, int], twice: int, counted: str) -> Guard:
    """Return whether every planned call has exactly one outcome."""
    calls, without = planned
    if twice or without:
        words = f"{without} planned calls have no outcome, {twice} have two; {counted}"
        return Guard("outcomes", False, words)
    return Guard("outcomes", True, f"each of {calls} planned calls has one outcome; {counted}")


@dataclass(slots=True)
class _Repeats:
    """Compares real_repeat with real for the same frame: a cache answers the later one at once.

    ``alone`` is the number of equal repeats, out of how many, that a probe made one by one; None if
    unknown.
    """

    alone: tuple[int, int] | None
    counts: Mapping[str, int]

    @classmethod
    def of(cls, attempts: Attempts, model: str, alone: tuple[int, int] | None) -> "_Repeats":
        """Compare the replies about each frame in pairs, in the order of sending."""
        rows, own = (
            attempts.repeats.rows,
            np.flatnonzero(attempts.codes["model"][attempts.repeats.rows] == attempts.code("model", model)),
        )
        own = own[np.argsort(attempts.codes["frame"][rows[own]], kind="stable")]
        frames = attempts.codes["frame"][rows[own]]
        starts = np.flatnonzero(np.concatenate([[True], frames[1:] != frames[:-1]])[: len(frames)])
        place = np.arange(len(own)) - np.repeat(starts, np.diff([*starts.tolist(), len(own)]))
        later = np.flatnonzero(place % 2 == 1)
        one, other = own[later - 1], own[later]
        first, then = rows[one], rows[other]
        said = attempts.repeats
        same = (said.text[one] == said.text[other]) & (said.reasoning[one] == said.reasoning[other])
        seconds = np.nan_to_num(attempts.real.get("seconds", np.zeros(len(attempts.call))))
        acted = np.array([decision.action is not None for decision in attempts.decisions], dtype=np.bool_)
        answers, again = attempts.decision[first], attempts.decision[then]
        decided = acted[answers] & acted[again] if alone is not None else np.zeros(len(answers), dtype=np.bool_)
        found = {
            "pairs": same | True,
            "same": same,
            "decided": decided,
            "alike": decided & (answers == again),
            "sudden": same & (seconds[then] < SUDDEN * seconds[first]),
        }
        return cls(alone, {name: int(where.sum()) for name, where in found.items()})

    def guard(self, mode: RequestMode) -> Guard:
        """Return whether a cache is suspected."""
        pairs, same, sudden = (self.counts[name] for name in ("pairs", "same", "sudden"))
        if pairs < FEWEST:
            return Guard("cache", None, f"{pairs} frames have two answers to the same picture; {FEWEST} are needed")
        if mode.spec.partition(":")[0] != "scripted" and sudden >= MOST * pairs:
            says = f"on {sudden} of {pairs} frames the repeat is equal and came in under {SUDDEN:.0%} of the time"
            return Guard("cache", False, f"a cache is suspected: {says}")
        if mode.temperature and same == pairs:
            says = f"real_repeat equals real to the byte on all {same} frames, at temperature {mode.temperature:g}"
            return Guard("cache", None, f"{says}: by a cache, or by a model that is sure of a short answer")
        return Guard("cache", True, f"{same} of {pairs} repeats are equal, and they were not answered suddenly")

    def under_load(self) -> tuple[Guard, ...]:
        """Return whether repeats agree in the run as alone at temperature 0; none if unknown."""
        alike, decided = self.counts["alike"], self.counts["decided"]
        if self.alone is None or decided < FEWEST:
            return ()
        same, of = self.alone
        words = f"{alike} of {decided} repeats give the same decision in the run, and {same} of {of} did one by one"
        if 2 * alike < decided and fewer_p(alike, decided, same, of) < _UNLIKELY:
            why = "pictures may be mixed up with several calls under way: ask with --concurrency 1"
            return (Guard("load", False, f"{words}, at temperature 0: {why}"),)
        return (Guard("load", True, words),)


_UNLIKELY = 0.01


def _alone(mode: RequestMode) -> tuple[int, int] | None:
    """Return the equal repeats, out of how many, of a probe one by one at temperature 0."""
    said = "" if mode.measured is None or mode.temperature != 0 else mode.measured.facts.get(ALONE, "")
    found = re.fullmatch(r"(\d{1,3}) of (\d{1,3})", said)
    return None if found is None else (int(found.group(1)), int(found.group(2)))
