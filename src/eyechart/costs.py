"""Accounts of calls by model and condition: attempts, outcomes, tokens, dollars, times, joules."""

from array import array
from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from eyechart.calls import UNFINISHED, CallKey, DecisionReader, Emptiness, Reply
from eyechart.errors import printable
from eyechart.ledger import AGAIN, UNKNOWN, Ledger, SentAttempt
from eyechart.models.prices import Prices
from eyechart.modes import ModeMeasurements, RequestMode
from eyechart.records import JsonRecord
from eyechart.spaces.motion import require_motions
from eyechart.spaces.space import MISSING, AnySpace, Missing

ALL = "all"
"""The name of the account that holds every condition."""

_UNREAD_AT_MOST = 1000
_ROWS_OF_POLICIES = 20
_OTHERS = "(other replies)"


@dataclass(frozen=True, slots=True)
class Account(JsonRecord):
    """The account of one model's calls under one condition, or under all.

    ``calls`` began, and ``finished`` of them ended. ``attempts`` are requests: ``retries`` counts
    the repeated ones by reason, ``errors`` the failed ones by kind, ``unknown`` those without an
    outcome. ``missing`` counts, by reason, calls without a decision. Unreported token sums and
    unmeasured energy are None. ``cost_usd`` is the sum of known costs; ``cost_from`` counts
    attempts with a reported, priced or unknown cost. Times are seconds of attempts with a reply.
    """

    calls: int
    attempts: int
    finished: int
    retries: Mapping[str, int]
    unknown: int
    errors: Mapping[str, int]
    missing: Mapping[str, int]
    prompt_tokens: int | None
    completion_tokens: int | None
    reasoning_tokens: int | None
    cost_usd: float | None
    cost_from: Mapping[str, int]
    latency_median_s: float | None
    latency_p95_s: float | None
    first_byte_median_s: float | None
    seconds: float
    energy_j: float | None
    energy_measured: int

    @property
    def failed(self) -> int:
        """Return the number of attempts that ended in an error."""
        return sum(self.errors.values())

    @property
    def words(self) -> str:
        """Return the counts of attempts in one line, the same for every command."""
        kinds = ", ".join(f"{count} {name}" for name, count in self.errors.items())
        ended = f" ({self.failed} attempts ended in an error: {kinds})" if self.errors else ""
        once_more = f", {asked} calls repeated after a failure" if (asked := self.retries.get(AGAIN)) else ""
        return (
            f"{self.attempts} attempts, {self.attempts - self.calls} of them repeated, {self.unknown} of unknown "
            f"outcome, {self.missing.get('error', 0)} calls failed{once_more}{ended}"
        )

    @property
    def tokens(self) -> str:
        """Return the tokens in and out in words; an unreported sum is a dash."""
        both = (self.prompt_tokens, self.completion_tokens)
        return "—" if both == (None, None) else ", ".join("—" if one is None else str(one) for one in both)


class Book:
    """Adds up attempts one by one, in the order of sending; ``read`` reads their replies."""

    def __init__(self, mode: RequestMode, read: DecisionReader, prices: Prices) -> None:
        self._mode, self._decide, self._prices = mode, read, prices
        self._pages: defaultdict[str, _ConditionSums] = defaultdict(_ConditionSums)

    def add(self, one: SentAttempt) -> None:
        """Add an attempt."""
        page = self._pages[one.key.condition]
        page.counts["calls"] += one.number == 1
        page.counts["attempts"] += 1
        if one.number > 1 and one.reason is not None:
            page.retries[one.reason] += 1
        reply = one.reply
        if reply is None:
            page.counts["unknown"] += 1
            page.cost_from[UNKNOWN] += 1
            return
        if reply.error in UNFINISHED and not one.final:
            if one.key not in page.ended:  # for a repeated call the earlier reply still counts
                page.pending.add(one.key)
        else:
            page.pending.discard(one.key)
            page.finish(one.key, reply, self._decide(one.key, reply).missing or "")
        cost, how = self._prices.cost(self._mode, reply)
        page.cost_from[how] += 1
        page.take(reply, cost)

    def accounts(self) -> dict[str, Account]:
        """Return the account of all attempts, and one for each condition."""
        pages = dict(sorted(self._pages.items()))
        whole = _ConditionSums()
        for page in pages.values():
            whole.join(page)
        return {name: page.account() for name, page in {ALL: whole, **pages}.items()}


@dataclass(slots=True)
class _ConditionSums:
    """The running sums of one condition.

    ``pending`` are calls that their last reply left unfinished. ``ended`` are calls that an error
    finished, each with the reason of its missing decision.
    """

    counts: Counter[str] = field(default_factory=Counter)
    retries: Counter[str] = field(default_factory=Counter)
    errors: Counter[str] = field(default_factory=Counter)
    missing: Counter[str] = field(default_factory=Counter)
    cost_from: Counter[str] = field(default_factory=Counter)
    sums: dict[str, float] = field(default_factory=dict)
    pending: set[CallKey] = field(default_factory=set)
    ended: dict[CallKey, str] = field(default_factory=dict)
    latency: "array[float]" = field(default_factory=lambda: array("d"))
    first_byte: "array[float]" = field(default_factory=lambda: array("d"))

    def take(self, reply: Reply, cost: float | None) -> None:
        """Add a reply's tokens, times, energy and cost."""
        if reply.error is not None:
            self.errors[reply.error] += 1
        else:
            self.latency.extend(() if reply.seconds is None else (reply.seconds,))
            self.first_byte.extend(() if reply.first_byte_s is None else (reply.first_byte_s,))
        self.counts["energy_measured"] += reply.energy_j is not None
        for name, value in (
            ("prompt_tokens", reply.prompt_tokens),
            ("completion_tokens", reply.completion_tokens),
            ("reasoning_tokens", reply.reasoning_tokens),
            ("seconds", reply.seconds),
            ("energy_j", reply.energy_j),
            ("cost_usd", cost),
        ):
            if value is not None:
                self.sums[name] = self.sums.get(name, 0) + value

    def finish(self, key: CallKey, reply: Reply, missing: str) -> None:
        """Count a final reply; for a call that was repeated after an error, the last one counts."""
        if (before := self.ended.pop(key, None)) is None:
            self.counts["finished"] += 1
        else:
            self.missing[before] -= 1
        self.missing[missing] += 1
        if reply.error is not None:
            self.ended[key] = missing

    def join(self, other: "_ConditionSums") -> None:
        """Add another page to this one."""
        for name in ("counts", "retries", "errors", "missing", "cost_from"):
            getattr(self, name).update(getattr(other, name))
        for name, value in other.sums.items():
            self.sums[name] = self.sums.get(name, 0) + value
        self.pending |= other.pending
        self.latency.extend(other.latency)
        self.first_byte.extend(other.first_byte)

    def account(self) -> Account:
        """Return the page as an account."""
        missing = self.missing + Counter(error=len(self.pending))
        return Account(
            calls=self.counts["calls"],
            attempts=self.counts["attempts"],
            finished=self.counts["finished"],
            retries=dict(sorted(self.retries.items())),
            unknown=self.counts["unknown"],
            errors=dict(sorted(self.errors.items())),
            missing={reason: missing[reason] for reason in MISSING if missing[reason]},
            prompt_tokens=_whole(self.sums.get("prompt_tokens")),
            completion_tokens=_whole(self.sums.get("completion_tokens")),
            reasoning_tokens=_whole(self.sums.get("reasoning_tokens")),
            cost_usd=self.sums.get("cost_usd"),
            cost_from=dict(sorted(self.cost_from.items())),
            latency_median_s=_percentile(self.latency, 50),
            latency_p95_s=_percentile(self.latency, 95),
            first_byte_median_s=_percentile(self.first_byte, 50),
            seconds=self.sums.get("seconds", 0.0),
            energy_j=self.sums.get("energy_j"),
            energy_measured=self.counts["energy_measured"],
        )


@dataclass(frozen=True, slots=True)
class UnreadReply(JsonRecord):
    """A reply without a decision: its count, the reason, and its first characters, made printable.

    For policies ``text`` is the fault of the array, and errors are listed too, by their text.
    """

    count: int
    missing: Missing
    why: str | None
    text: str


def unread(ledger: Ledger, model: str, space: AnySpace, read: DecisionReader) -> tuple[UnreadReply, ...]:
    """Return a model's distinct replies without an error or a decision, most frequent first.

    The last reply of a call counts, as in its Account. Beyond a thousand distinct ones, the rest is
    added up. A policy's answers are numbers, so those with the same fault count as one. Its most
    frequent errors are listed too: they are texts of its own program.
    """
    of_policy = space.who == "policy"
    found: Counter[tuple[Missing, str | None, str]] = Counter()
    for key, reply in ledger.replies(model):
        decision = read(key, reply)
        if decision.missing is None or (reply.error is not None and not of_policy):
            continue
        why, text = decision.why, require_motions(space).lacks(reply) if of_policy else reply.text
        if reply.error is not None:
            why, text = reply.error, reply.error_detail
        seen = (decision.missing, why, printable(text))
        found[seen if seen in found or len(found) < _UNREAD_AT_MOST else (decision.missing, None, _OTHERS)] += 1
    if of_policy:  # texts of errors may differ by an address or a count
        for seen, count in found.most_common()[_ROWS_OF_POLICIES:]:
            del found[seen]
            found[seen[0], None, _OTHERS] += count
    listed = sorted(found.items(), key=lambda one: (-one[1], one[0][2], one[0][0]))
    return tuple(UnreadReply(count, *seen) for seen, count in listed)


def emptiness(ledger: Ledger) -> dict[str, Emptiness]:
    """Return, for each model, the counts of replies and of empty ones."""
    return {model: Emptiness.of(reply for _, reply in ledger.replies(model)) for model in ledger.models()}


def _whole(value: float | None) -> int | None:
    return None if value is None else int(value)


def _percentile(values: "array[float]", percent: float) -> float | None:
    return float(np.percentile(np.frombuffer(values), percent)) if values else None


@dataclass(frozen=True, slots=True)
class CostEstimate(JsonRecord):
    """The expected totals of calls still to make; None where nothing was measured.

    Failures and retries are not included. ``sampled``: the number of calls is itself an estimate
    from a sample. ``at_most``: there may be fewer calls.
    """

    model: str
    calls: int
    prompt_tokens: int | None
    completion_tokens: int | None
    cost_usd: float | None
    cost_from: str
    seconds: float | None
    sampled: bool = False
    at_most: bool = False

    @property
    def words(self) -> str:
        """Return the estimate in one line."""
        tokens = "tokens unknown"
        if self.prompt_tokens is not None and self.completion_tokens is not None:
            tokens = f"{self.prompt_tokens:,} tokens in, {self.completion_tokens:,} out"
        cost = "cost unknown" if self.cost_usd is None else f"${self.cost_usd:.2f}"
        time = "time unknown" if self.seconds is None else f"about {duration(self.seconds)}"
        about = "about " if self.sampled else "up to " if self.at_most else ""
        return f"{self.model}: {about}{self.calls} calls, {tokens}, {cost} ({self.cost_from}), {time}"


def estimate(
    mode: RequestMode,
    calls: int,
    prices: Prices,
    *,
    concurrency: int,
    sampled: bool = False,
    at_most: bool = False,
) -> CostEstimate:
    """Estimate the totals of a model's calls, from a probe's measurements and the table of prices.

    ``sampled``: there may be more or fewer calls. ``at_most``: there may be fewer.
    """
    found, price = mode.measured or ModeMeasurements(), prices.of(mode)
    each_in, each_out = found.prompt_tokens, found.completion_tokens
    cost, source = None, "no price known"
    if price is not None:
        source = price.words if price.date else price.source
        if not price.date:
            cost = 0.0
        elif each_in is not None and each_out is not None:
            cost = calls * (price.input * each_in + price.output * each_out) / 1e6
    return CostEstimate(
        model=mode.spec,
        calls=calls,
        prompt_tokens=None if each_in is None else calls * each_in,
        completion_tokens=None if each_out is None else round(calls * each_out),
        cost_usd=cost,
        cost_from=source,
        seconds=None if found.seconds is None else found.seconds * -(-calls // concurrency),
        sampled=sampled,
        at_most=at_most,
    )


ASSUMED_IN, ASSUMED_OUT = 1000, 100
"""The tokens of a call that an estimate assumes where no probe measured the model.

Each example picture of a prompt is assumed to take as many more."""


def assumed(mode: RequestMode, examples: int = 0) -> tuple[RequestMode, str]:
    """Return a mode with the measured or else assumed tokens of a call, and which of the two.

    ``examples`` is the number of example pictures in the prompt.
    """
    if mode.measured is not None:
        return mode, "as measured"
    tokens = ASSUMED_IN * (1 + examples)
    guessed = ModeMeasurements(prompt_tokens=tokens, completion_tokens=float(ASSUMED_OUT))
    return replace(mode, measured=guessed), f"if a call takes {tokens} tokens in and {ASSUMED_OUT} out"


def duration(seconds: float) -> str:
    """Return a number of seconds in words."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
