"""What calls took: attempts and their outcomes, tokens, dollars, seconds and joules, by model and condition."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from eyechart.actions import MISSING, ActionSpace
from eyechart.calls import Reply
from eyechart.ledger import UNKNOWN, Sent
from eyechart.models.prices import Prices
from eyechart.modes import RequestMode
from eyechart.reader import read_decision

ALL = "all"
"""The name of the account that holds every condition."""


@dataclass(frozen=True, slots=True)
class Account:
    """What the calls of one model under one condition took, or under all of them.

    ``calls`` were begun; ``attempts`` are requests, of which ``retries`` counts the repeated ones by reason and
    ``errors`` the failed ones by kind; ``unknown`` were sent and never came back, because the run was killed.
    ``missing`` counts, by reason, the calls whose last reply holds no decision. Token sums are None where no reply
    reports any. ``cost_usd`` adds up what is known, and ``cost_from`` says of how many attempts it is reported, priced
    or unknown. Times are of the attempts that brought a reply, in seconds; ``energy_j`` is None where not measured.
    """

    calls: int
    attempts: int
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

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        return asdict(self)


def accounts(sent: Sequence[Sent], mode: RequestMode, space: ActionSpace, prices: Prices) -> dict[str, Account]:
    """Return the account of a model's attempts, all of them first, and then by condition."""
    groups: dict[str, list[Sent]] = {ALL: list(sent)}
    for one in sent:
        groups.setdefault(one.key.condition, []).append(one)
    names = [ALL, *sorted(groups.keys() - {ALL})]
    return {name: _account(groups[name], mode, space, prices) for name in names}


def _account(sent: Sequence[Sent], mode: RequestMode, space: ActionSpace, prices: Prices) -> Account:
    replies = [one.reply for one in sent if one.reply is not None]
    answered = [reply for reply in replies if reply.error is None]
    last = {one.key: one.reply for one in sent if one.reply is not None}
    costs = [prices.cost(mode, reply) for reply in replies]
    known = [cost for cost, _ in costs if cost is not None]
    unknown = len(sent) - len(replies)
    return Account(
        calls=len({one.key for one in sent}),
        attempts=len(sent),
        retries=_counted(one.reason for one in sent if one.number > 1 and one.reason is not None),
        unknown=unknown,
        errors=_counted(reply.error for reply in replies if reply.error is not None),
        missing=_missing(last.values(), space),
        prompt_tokens=_total(reply.prompt_tokens for reply in replies),
        completion_tokens=_total(reply.completion_tokens for reply in replies),
        reasoning_tokens=_total(reply.reasoning_tokens for reply in replies),
        cost_usd=sum(known) if known else None,
        cost_from=_counted([*(how for _, how in costs), *[UNKNOWN] * unknown]),
        latency_median_s=_percentile([reply.seconds for reply in answered], 50),
        latency_p95_s=_percentile([reply.seconds for reply in answered], 95),
        first_byte_median_s=_percentile([reply.first_byte_s for reply in answered], 50),
        seconds=sum(reply.seconds or 0.0 for reply in replies),
        energy_j=_joules(replies),
        energy_measured=sum(reply.energy_j is not None for reply in replies),
    )


def _counted(names: Iterable[str]) -> dict[str, int]:
    return dict(sorted(Counter(names).items()))


def _missing(last: Iterable[Reply], space: ActionSpace) -> dict[str, int]:
    read = [read_decision(reply.text, reply.finish_reason, reply.error, space).missing for reply in last]
    return {reason: read.count(reason) for reason in MISSING if reason in read}


def _total(counts: Iterable[int | None]) -> int | None:
    known = [count for count in counts if count is not None]
    return sum(known) if known else None


def _percentile(values: Sequence[float | None], percent: float) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.percentile(known, percent)) if known else None


def _joules(replies: Sequence[Reply]) -> float | None:
    known = [reply.energy_j for reply in replies if reply.energy_j is not None]
    return sum(known) if known else None


@dataclass(frozen=True, slots=True)
class Estimate:
    """What calls that are still to be made are expected to take; None is "cannot say", because nothing was measured.

    Failures and retries come on top.
    """

    model: str
    calls: int
    prompt_tokens: int | None
    completion_tokens: int | None
    cost_usd: float | None
    cost_from: str
    seconds: float | None

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        return asdict(self)

    @property
    def words(self) -> str:
        """Return the estimate in one line."""
        tokens = "tokens unknown"
        if self.prompt_tokens is not None and self.completion_tokens is not None:
            tokens = f"{self.prompt_tokens:,} tokens in, {self.completion_tokens:,} out"
        cost = "cost unknown" if self.cost_usd is None else f"${self.cost_usd:.2f}"
        time = "time unknown" if self.seconds is None else f"about {_duration(self.seconds)}"
        return f"{self.model}: {self.calls} calls, {tokens}, {cost} ({self.cost_from}), {time}"


def estimate(mode: RequestMode, calls: int, prices: Prices, *, concurrency: int) -> Estimate:
    """Estimate what so many calls of a model take, from what a probe measured of it and the table of prices."""
    found, price = mode.measured, prices.of(mode)
    each_in = None if found is None else found.prompt_tokens
    each_out = None if found is None else found.completion_tokens
    cost, source = None, "no price known"
    if price is not None:
        source = price.words if price.date else price.source
        if not price.date:
            cost = 0.0
        elif each_in is not None and each_out is not None:
            cost = calls * (price.input * each_in + price.output * each_out) / 1e6
    seconds = None if found is None or found.seconds is None else found.seconds * -(-calls // concurrency)
    return Estimate(
        model=mode.spec,
        calls=calls,
        prompt_tokens=None if each_in is None else calls * each_in,
        completion_tokens=None if each_out is None else round(calls * each_out),
        cost_usd=cost,
        cost_from=source,
        seconds=seconds,
    )


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
