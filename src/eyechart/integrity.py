"""Guards: sanity checks that say whether a run is reliable.

They check that pictures arrived, that each call has one outcome, and that no answer is a copy. A
guard holds, fails, or cannot say; a failed one marks the verdict wherever it is printed.
"""

import re
import statistics
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from collections.abc import Set as AbstractSet
from dataclasses import asdict, dataclass, field

from eyechart.calls import UNFINISHED, CallKey, DecisionReader, Emptiness, Reply
from eyechart.errors import printable
from eyechart.ledger import AGAIN, SentAttempt
from eyechart.modes import ALONE, FEWEST_TOKENS, RequestMode, made_elsewhere
from eyechart.spaces.space import ending
from eyechart.stats.forced_choice import fewer_p

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
    def by_fingerprint(self) -> bool:
        """Return whether only the server's fingerprint differs."""
        return self.differs == ("system_fingerprint",)


class ServedChecks:
    """Compares the names in replies, attempt by attempt in the order of sending.

    A probed ``mode`` records the names of that time; another model later is a difference.
    """

    def __init__(self, mode: RequestMode | None = None) -> None:
        self._probed: Mapping[str, str] = {} if mode is None or mode.measured is None else mode.measured.facts
        self._found: dict[tuple[str | None, str | None, str | None], tuple[int, str, str]] = {}
        self._unnamed = 0

    def add(self, one: SentAttempt) -> None:
        """Add an attempt; replies without names are counted."""
        if one.reply is None or one.reply.error is not None:
            return
        named = names_of(one.reply)
        self._unnamed += named[0] is None
        if named == (None, None, None):
            return
        if named not in self._found and len(self._found) >= _TEXTS_KEPT:  # some servers rename each
            named = (named[0], named[1], _OTHERS) if named[2] else (_OTHERS, None, None)
            if named not in self._found and len(self._found) >= 2 * _TEXTS_KEPT:
                named = (_OTHERS, None, None)
        count, since, _ = self._found.get(named, (0, one.sent_at, ""))
        self._found[named] = (count + 1, since, one.sent_at)

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
    """Compares the requests of all attempts at the same call, by any model of a run.

    Every model must be shown the same for one frame, condition and prompt. It reads a whole run.
    """

    def __init__(self) -> None:
        self._first: dict[tuple[str, ...], tuple[str, str]] = {}
        self._unlike: dict[str, dict[tuple[str, ...], None]] = {}

    def add(self, one: SentAttempt) -> None:
        """Add an attempt; a row without a digest is skipped."""
        if not one.request_sha256:
            return
        study, model, *asked = map(str, one.key)
        key = (study, *asked)
        before, whose = self._first.setdefault(key, (one.request_sha256, model))
        if before != one.request_sha256:
            for either in (model, whose):
                self._unlike.setdefault(either, {})[key] = None

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


def names_of(reply: Reply) -> tuple[str | None, str | None, str | None]:
    """Return model, provider and fingerprint; an older ledger has the last behind the first.

    A model's name may have several words, so only what looks like a fingerprint is one.
    """
    served, mark = reply.served, reply.system_fingerprint
    if served and mark:
        served = served.removesuffix(f" {mark}")
    elif served and reply.payload_sha256 is None and (behind := _MARK.search(served)):
        served, mark = served[: behind.start()], behind.group(1)
    return served or None, reply.provider or None, mark or None


class GuardChecks:
    """Checks attempts one by one, in the order of sending, without keeping them.

    ``read`` reads replies, to find decisions that never differ in differing words.
    """

    def __init__(self, mode: RequestMode, read: DecisionReader) -> None:
        self._mode = mode
        self._read = read
        self._decided: Counter[str] = Counter()
        self._outcomes = _Outcomes()
        self._repeats = _Repeats(_alone(mode))
        self._texts: set[str] = set()
        self._empty = Emptiness()
        self._ends = _Ends()
        self._served = ServedChecks(mode)
        self._tokens: dict[str, dict[str, int]] = defaultdict(dict)

    def add(self, one: SentAttempt) -> None:
        """Add an attempt."""
        self._outcomes.add(one)
        self._served.add(one)
        reply = one.reply
        if reply is None or reply.error is not None:
            return
        self._empty = self._empty.plus(reply)
        self._ends.add(reply.finish_reason)
        if len(self._texts) < _TEXTS_KEPT:
            self._texts.add(reply.text.strip())
        if len(self._decided) < 2:  # two different ones are enough
            found = self._read(one.key, reply).action
            self._decided.update([] if found is None else [str(found)])
        if reply.prompt_tokens:
            self._tokens[one.key.condition][f"{one.key.prompt} {one.key.frame}"] = reply.prompt_tokens
        if one.key.condition in {"real", "real_repeat"}:
            told = self._read(one.key, reply).action if self._repeats.alone else None
            self._repeats.add(one.key.frame, reply, "" if told is None else str(told))

    def guards(self, planned: Iterable[CallKey], fingerprint: str, counted: str) -> tuple[Guard, ...]:
        """Return every guard; ``fingerprint`` is that of the bank's checked geometry.

        ``counted`` says in words how many attempts there were and how they ended.
        """
        same = f"the frames have the geometry that the run was made on ({fingerprint[:8]})"
        if made_elsewhere(self._mode.spec):
            served = self._served.guards()
            return (
                *(Guard(name, None, words) for name, words in _ELSEWHERE.items()),
                self._outcomes.guard(planned, counted),
                Guard(
                    "geometry", True, f"the answers are to the calls of this bank, by their keys ({fingerprint[:8]})"
                ),
                _constant(self._texts, self._decided, self._empty),
                self._ends.guard(),
                *(served if any(not guard.holds for guard in served) else (_UNNAMED,)),
            )
        return (
            _picture(self._tokens, self._mode, self._served.unlike()),
            self._outcomes.guard(planned, counted),
            Guard("geometry", True, same),
            _constant(self._texts, self._decided, self._empty),
            self._repeats.guard(self._mode),
            *self._repeats.under_load(),
            *([self._ends.guard()] if self._ends.unknown else []),
            *self._served.guards(),
        )


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

    def add(self, reason: str | None) -> None:
        """Count a reply by its finish reason."""
        self.came += 1
        self.unsaid += reason is None
        if reason is not None and ending(reason) is None:
            known = reason in self.unknown or len(self.unknown) < _ENDS_KEPT
            self.unknown[reason if known else "another word"] += 1

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


def _dropped(tokens: Mapping[str, Mapping[str, int]]) -> str:
    """Return how many prompts with a picture have the tokens of their words alone, or ""."""
    bare = tokens.get("text_only", {})
    if min(bare.values(), default=0) < max(FEWEST_TOKENS, max(bare.values(), default=0) / 2):
        return ""
    for condition, counts in sorted(tokens.items(), key=lambda one: (one[0] != "real", one[0])):
        both = counts.keys() & bare.keys()
        lost = sum(counts[frame] == bare[frame] for frame in both)
        if lost and condition.partition("@")[0] not in _SHOWN_BEFORE:
            named = "" if condition == "real" else f", under {condition},"
            return f"{lost} of {len(both)} prompts with a picture{named} have exactly the tokens of the words alone"
    return ""


def _picture(tokens: Mapping[str, Mapping[str, int]], mode: RequestMode, unlike: Mapping[str, str]) -> Guard:
    """Return whether pictures arrived, by a probe of the same model or by the server's tokens.

    ``tokens`` are those of prompts by condition and frame. If a probe saw that the server counts
    pictures, a prompt with a picture but only the tokens of its words lost the picture.
    """
    found, shown, bare = mode.measured, tokens.get("real", {}), tokens.get("text_only", {})
    if found is not None and (found.image_tokens or 0) >= FEWEST_TOKENS and not unlike and (words := _dropped(tokens)):
        words = f"{words}, where the probe's picture added {found.image_tokens}"
        return Guard("picture", False, f"pictures were dropped on the way: {words}")
    if found is not None and found.sees_image is not None and not unlike:
        words = f": {found.facts['picture']}" if "picture" in found.facts else ""
        says = f"the model {'saw' if found.sees_image else 'did not see'} the probe's pictures{words}"
        return Guard("picture", found.sees_image, says)
    adds = statistics.median(shown.values()) - statistics.median(bare.values()) if shown and bare else None
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


def _constant(texts: AbstractSet[str], decided: Mapping[str, int], empty: Emptiness) -> Guard:
    replies, aside = empty.came, f"; {empty.words}" if empty.thought else ""
    if empty.whole:
        return Guard("degeneracy", False, empty.words)
    if replies < FEWEST:
        return Guard("degeneracy", None, f"{replies} replies are too few to call them constant{aside}")
    if len(texts) == 1:
        return Guard("degeneracy", False, f"all {replies} replies are the same: {_beginning(min(texts))}")
    if len(decided) == 1 and (count := sum(decided.values())) >= FEWEST:
        return Guard("degeneracy", False, f"all {count} decisions are the same: {min(decided)}{aside}")
    more = " or more" if len(texts) == _TEXTS_KEPT else ""
    return Guard("degeneracy", True, f"{len(texts)}{more} different replies among {replies}{aside}")


@dataclass(slots=True)
class _Outcomes:
    """The calls with an outcome, by hashes of their keys, and the number with two."""

    finals: set[int] = field(default_factory=set)
    again: set[int] = field(default_factory=set)
    twice: int = 0

    def add(self, one: SentAttempt) -> None:
        """Add an attempt; a retried call has one outcome, its last."""
        call = hash(one.key)
        if one.reason == AGAIN:
            self.again.add(call)
        if one.reply is not None and (one.final or one.reply.error not in UNFINISHED):
            self.twice += call in self.finals and call not in self.again
            self.finals.add(call)
            self.again.discard(call)

    def guard(self, planned: Iterable[CallKey], counted: str) -> Guard:
        """Return whether every planned call has exactly one outcome."""
        calls = without = 0
        for key in planned:
            calls += 1
            without += hash(key) not in self.finals
        if self.twice or without:
            words = f"{without} planned calls have no outcome, {self.twice} have two; {counted}"
            return Guard("outcomes", False, words)
        return Guard("outcomes", True, f"each of {calls} planned calls has one outcome; {counted}")


@dataclass(slots=True)
class _Repeats:
    """Compares real_repeat with real for the same frame: a cache answers the later one at once.

    ``alone`` is the number of equal repeats, out of how many, that a probe made one by one; None if
    unknown.
    """

    alone: tuple[int, int] | None = None
    first: dict[str, tuple[str, str, float, str]] = field(default_factory=dict)
    counts: Counter[str] = field(default_factory=Counter)

    def add(self, frame: str, reply: Reply, told: str = "") -> None:
        """Add one of a frame's two replies, in the order of sending, and its decision."""
        this = reply.text, reply.reasoning, reply.seconds or 0.0, told
        before = self.first.pop(frame, None)
        if before is None:
            self.first[frame] = this
            return
        same = before[:2] == this[:2]
        self.counts["pairs"] += 1
        self.counts["same"] += same
        self.counts["decided"] += bool(before[3] and told)
        self.counts["alike"] += bool(told) and before[3] == told
        self.counts["sudden"] += same and this[2] < SUDDEN * before[2]

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
