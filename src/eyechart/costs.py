"""Accounts of calls by model and condition: attempts, outcomes, tokens, dollars, times, joules."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eyechart.calls import DecisionReader, Emptiness
from eyechart.errors import printable
from eyechart.ledger import AGAIN, UNKNOWN, Attempts, Ledger
from eyechart.models.prices import Price, Prices, costs_at
from eyechart.modes import ModeMeasurements, RequestMode
from eyechart.records import JsonRecord
from eyechart.spaces.motion import require_motions
from eyechart.spaces.space import MISSING, AnySpace, Missing
from eyechart.spaces.stated_motion import StatedMotionSpace

Ints = NDArray[np.integer[Any]]
Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

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
        once_more = f", {repeated} calls repeated after a failure" if (repeated := self.retries.get(AGAIN)) else ""
        return (
            f"{self.attempts} attempts, {self.attempts - self.calls} of them repeated, {self.unknown} of unknown "
            f"outcome, {self.missing.get('error', 0)} calls failed{once_more}{ended}"
        )

    @property
    def tokens(self) -> str:
        """Return the tokens in and out in words; an unreported sum is a dash."""
        both = (self.prompt_tokens, self.completion_tokens)
        return "—" if both == (None, None) else ", ".join("—" if one is None else str(one) for one in both)


def accounts_of(attempts: Attempts, model: str, price: Price | None) -> dict[str, Account]:
    """Return the account of all attempts of a model at this price, and one for each condition."""
    rows = attempts.of(model)
    conditions, named = attempts.codes["condition"][rows], attempts.names["condition"]
    found = {named[code]: rows[conditions == code] for code in np.flatnonzero(np.bincount(conditions)).tolist()}
    pages = {name: _ConditionSums.of(attempts, found[name], price) for name in sorted(found)}
    whole = _ConditionSums()
    for page in pages.values():
        whole.join(page)
    return {name: page.account() for name, page in {ALL: whole, **pages}.items()}


@dataclass(slots=True)
class _ConditionSums:
    """The sums of one condition; ``pending`` calls were left unfinished by their last reply."""

    counts: Counter[str] = field(default_factory=Counter)
    retries: Counter[str] = field(default_factory=Counter)
    errors: Counter[str] = field(default_factory=Counter)
    missing: Counter[str] = field(default_factory=Counter)
    cost_from: Counter[str] = field(default_factory=Counter)
    sums: dict[str, float] = field(default_factory=dict)
    pending: int = 0
    latency: Floats = field(default_factory=lambda: np.zeros(0))
    first_byte: Floats = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def of(cls, attempts: Attempts, rows: Ints, price: Price | None) -> "_ConditionSums":
        """Return the sums of these rows, which are in the order of sending."""
        page, came, number = cls(), rows[attempts.came[rows]], attempts.number[rows]
        finishing = attempts.finishing(rows)
        page.counts.update(calls=int((number == 1).sum()), attempts=len(rows), unknown=len(rows) - len(came))
        page.retries = _counted(attempts, "reason", rows[number > 1])
        page.errors = _counted(attempts, "error", came)
        page.cost_from[UNKNOWN] += len(rows) - len(came)
        page._finish(attempts, rows[finishing])
        page._pend(attempts, rows, finishing)
        page._take(attempts, came, price)
        return page

    def _finish(self, attempts: Attempts, rows: Ints) -> None:
        """Count final replies; for a call that was repeated after an error, the last one counts."""
        order = rows[np.argsort(attempts.call[rows], kind="stable")]
        again, failed = _follows(attempts.call[order]), ~attempts.error(order, [None])
        replaced = np.flatnonzero(again & np.roll(failed, 1)) - 1  # an error that a later reply follows
        self.counts["finished"] = len(order) - len(replaced)
        reasons = [one.missing or "" for one in attempts.decisions]
        each = np.bincount(attempts.decision[order], minlength=len(reasons))
        each -= np.bincount(attempts.decision[order[replaced]], minlength=len(reasons))
        for reason, count in zip(reasons, each.tolist(), strict=True):
            self.missing[reason] += count

    def _pend(self, attempts: Attempts, rows: Ints, finishing: Mask) -> None:
        """Count calls whose last reply left them unfinished, unless an error finished them before."""
        left = np.flatnonzero(attempts.came[rows] & ~finishing)
        if not len(left):
            return
        calls, call = np.unique(attempts.call[rows], return_inverse=True)
        last, ended = np.full(len(calls), -1), np.full(len(calls), -1)
        last[call[left]] = left
        ended[call[finishing]] = np.flatnonzero(finishing)
        open_calls = np.flatnonzero(last > ended)
        before = ended[open_calls]
        failed = np.zeros(len(before), dtype=np.bool_)
        failed[before >= 0] = ~attempts.error(rows[before[before >= 0]], [None])
        self.pending = int((~failed).sum())

    def _take(self, attempts: Attempts, rows: Ints, price: Price | None) -> None:
        """Add the replies' tokens, times, energy and cost."""
        plain = attempts.error(rows, [None])
        values = {name: attempts.real[name][rows] for name in attempts.real}
        values |= {name: np.where((one := column[rows]) < 0, np.nan, one) for name, column in attempts.whole.items()}
        for name, place in (("seconds", "latency"), ("first_byte_s", "first_byte")):
            times = values.get(name, np.zeros(0))[plain] if name in values else np.zeros(0)
            setattr(self, place, times[~np.isnan(times)])
        reported = values.pop("cost_usd", np.full(len(rows), np.nan))
        cost, how = costs_at(price, reported, values.get("prompt_tokens"), values.get("completion_tokens"))
        values.pop("first_byte_s", None)
        self.cost_from.update(how)
        for name, column in {**values, "cost_usd": cost}.items():
            known = column[~np.isnan(column)]
            if len(known):
                self.sums[name] = float(np.cumsum(known)[-1])  # in order, as a sum by hand
        self.counts["energy_measured"] = int((~np.isnan(values["energy_j"])).sum()) if "energy_j" in values else 0

    def join(self, other: "_ConditionSums") -> None:
        """Add another page to this one."""
        for name in ("counts", "retries", "errors", "missing", "cost_from"):
            getattr(self, name).update(getattr(other, name))
        for name, value in other.sums.items():
            self.sums[name] = self.sums.get(name, 0) + value
        self.pending += other.pending
        self.latency = np.concatenate([self.latency, other.latency])
        self.first_byte = np.concatenate([self.first_byte, other.first_byte])

    def account(self) -> Account:
        """Return the page as an account."""
        missing = self.missing + Counter(error=self.pending)
        median, late = _percentiles(self.latency, 50, 95)
        return Account(
            calls=self.counts["calls"],
            attempts=self.counts["attempts"],
            finished=self.counts["finished"],
            retries=_known(self.retries),
            unknown=self.counts["unknown"],
            errors=_known(self.errors),
            missing={reason: missing[reason] for reason in MISSING if missing[reason]},
            prompt_tokens=_whole(self.sums.get("prompt_tokens")),
            completion_tokens=_whole(self.sums.get("completion_tokens")),
            reasoning_tokens=_whole(self.sums.get("reasoning_tokens")),
            cost_usd=self.sums.get("cost_usd"),
            cost_from=_known(self.cost_from),
            latency_median_s=median,
            latency_p95_s=late,
            first_byte_median_s=_percentiles(self.first_byte, 50)[0],
            seconds=self.sums.get("seconds", 0.0),
            energy_j=self.sums.get("energy_j"),
            energy_measured=self.counts["energy_measured"],
        )


def _counted(attempts: Attempts, name: str, rows: Ints) -> Counter[str]:
    """Return how many rows have each word of a field; rows without one are left out."""
    words = attempts.names[name]
    counts = np.bincount(attempts.codes[name][rows], minlength=len(words)).tolist()
    return Counter({word: count for word, count in zip(words, counts, strict=True) if word is not None and count})


def _follows(column: Ints) -> Mask:
    """Return where a value is that of the place before."""
    return np.concatenate([np.zeros(min(1, len(column)), dtype=np.bool_), column[1:] == column[:-1]])


def _known(counts: Counter[str]) -> dict[str, int]:
    return {name: count for name, count in sorted(counts.items()) if count}


@dataclass(frozen=True, slots=True)
class UnreadReply(JsonRecord):
    """A reply without a decision: its count, the reason, and its first characters, made printable.

    For policies ``text`` is the fault of the array (of words, the words), and errors are listed too, by their text.
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
        in_words = not of_policy or isinstance(space, StatedMotionSpace)
        why, text = decision.why, reply.text if in_words else require_motions(space).lacks(reply)
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


def _percentiles(values: Floats, *percents: float) -> list[float | None]:
    return np.percentile(values, percents).tolist() if len(values) else [None] * len(percents)


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
