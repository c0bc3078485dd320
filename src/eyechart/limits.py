"""Limits of a run: the number and cost of calls, their pace, and when a model is set aside."""

import asyncio
import random
from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

from eyechart.calls import HOPELESS, TRANSIENT, UNASKED, Reply
from eyechart.errors import counted
from eyechart.records import Amount, Count, JsonRecord

LONGEST_WAIT_S = 120.0
"""The longest Retry-After that a run obeys; a model with a longer one is set aside."""


_PERHAPS_ONE = frozenset({400, 403, 404, 413, 422})
"""Statuses that may concern one call only: two such refusals in a row set the model aside."""


@dataclass(frozen=True, slots=True)
class Usage(JsonRecord):
    """The totals of calls: their count, reported tokens in and out, dollars, and seconds.

    Tokens are None where no reply reports any. ``cost_usd`` is the sum of known costs; ``unknown``
    counts the calls without one.
    """

    calls: Count = 0
    prompt_tokens: Count | None = None
    completion_tokens: Count | None = None
    cost_usd: Amount = 0.0
    unknown: Count = 0
    seconds: Amount = 0.0

    def plus(self, reply: Reply, cost: float | None) -> "Usage":
        """Return the totals with one more call."""
        return Usage(
            self.calls + 1,
            _sum([self.prompt_tokens, reply.prompt_tokens]),
            _sum([self.completion_tokens, reply.completion_tokens]),
            self.cost_usd + (cost or 0.0),
            self.unknown + (cost is None),
            self.seconds + (reply.seconds or 0.0),
        )

    @classmethod
    def together(cls, parts: Iterable["Usage"]) -> "Usage":
        """Return the sum of several totals."""
        rows = list(parts)
        return cls(
            calls=sum(row.calls for row in rows),
            prompt_tokens=_sum(row.prompt_tokens for row in rows),
            completion_tokens=_sum(row.completion_tokens for row in rows),
            cost_usd=sum(row.cost_usd for row in rows),
            unknown=sum(row.unknown for row in rows),
            seconds=sum(row.seconds for row in rows),
        )

    @property
    def words(self) -> str:
        """Return the totals in one line."""
        cost = f"${self.cost_usd:.4f}"
        if self.unknown:
            cost = "cost unknown" if self.unknown == self.calls else f"{cost} and {self.unknown} calls of unknown cost"
        sent, came = ("—" if one is None else f"{one:,}" for one in (self.prompt_tokens, self.completion_tokens))
        tokens = f"{sent} tokens in, {came} out"
        return f"{self.calls} calls, {tokens}, {cost}, {self.seconds:.1f} s"


def _sum(counts: Iterable[int | None]) -> int | None:
    """Return the sum of the reported counts, None without one."""
    known = [count for count in counts if count is not None]
    return sum(known) if known else None


NOTHING = Usage()


def added(earlier: Mapping[str, Usage], now: Mapping[str, Usage]) -> dict[str, Usage]:
    """Return the totals of ``now`` by model, with the earlier ones of the same models added."""
    return {spec: Usage.together([earlier.get(spec, NOTHING), usage]) for spec, usage in now.items()}


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits that end a run before its plan is done; nothing is lost, and the run can be resumed.

    ``calls`` and ``cost_usd`` limit the attempts and the cost of the whole run, earlier sessions
    included; running calls may finish. ``before`` is the total of a probe or of another run of the
    study, and counts too. ``patience`` is the number of failed calls in a row that sets a model
    aside. ``cost`` returns the cost of an attempt in dollars, None where it is unknown.
    """

    calls: int | None = None
    cost_usd: float | None = None
    patience: int = 10
    cost: Callable[[str, Reply], float | None] = lambda _, reply: reply.cost_usd
    before: Usage = NOTHING


@dataclass(frozen=True, slots=True)
class RunOutcome:
    """The end of a run: the models set aside with the reasons, and the limit that stopped it.

    ``uncounted`` is the number of failed attempts of unknown cost, in a run with a limit of cost.
    ``failed`` gives the number of failed calls of a model, and the last failure. ``lasting`` are
    the models with failures that need a repair first. ``whole`` says that every call so far is
    finished, so the ledger need not be read for the rest; False where that was not counted.
    """

    set_aside: Mapping[str, str]
    stopped: str | None = None
    uncounted: int = 0
    failed: Mapping[str, str] = field(default_factory=dict)
    lasting: frozenset[str] = frozenset()
    whole: bool = field(default=False, compare=False)


class Budget:
    """Counts the calls and the cost of a run, and decides when it stops or sets a model aside."""

    def __init__(self, limits: Limits, models: Iterable[str]) -> None:
        self.limits = limits
        self.set_aside: dict[str, str] = {}
        self.stopped: str | None = None
        self._sent, self._spent, self._under_way = limits.before.calls, limits.before.cost_usd, 0
        self.uncounted = limits.before.unknown if limits.cost_usd is not None else 0
        self._dearest = 0.0
        self._priced: set[str] = set()
        self._asking: Counter[str] = Counter()
        self._refused: Counter[str] = Counter()
        self._came = asyncio.Event()
        self._spent_up = False
        self._in_a_row = dict.fromkeys(models, 0)
        self._failed: Counter[str] = Counter()
        self._without: Counter[str] = Counter()
        self._last: dict[str, str] = {}
        self._lacked: dict[str, str] = {}
        self._passes: dict[str, bool] = {}
        self._passed: set[str] = set()

    def made_before(self, model: str, reply: Reply | None) -> None:
        """Count an attempt of an earlier session; None is one of unknown outcome and cost."""
        if reply is not None and reply.error in UNASKED:
            return
        self._sent += 1
        if self.limits.cost_usd is None:
            return
        if reply is None:
            self.uncounted += 1
        else:
            self._add(model, reply)

    async def turn(self, model: str) -> bool:
        """Return whether another attempt may be sent, as ``may_send`` does.

        With a limit of cost, a model makes one call at a time until the cost of a call is known.
        """
        while self.limits.cost_usd is not None and self._asking[model] and model not in self._priced:
            if self.stopped is not None or model in self.set_aside:
                return False
            await self._came.wait()
        return self.may_send(model)

    def may_send(self, model: str) -> bool:
        """Return whether another attempt may be sent, and count it as sent if so."""
        limits = self.limits
        if self.stopped is None and limits.calls is not None and self._sent >= limits.calls:
            self.stopped = f"{counted(self._sent, 'call', 'were')} sent, and --max-calls is {limits.calls}"
        reserved = self._spent + self._under_way * self._dearest
        if self.stopped is None and limits.cost_usd is not None and reserved >= limits.cost_usd:
            self._spent_up = True
            self._say_spent()
        if self.stopped is not None or model in self.set_aside:
            return False
        self._sent += 1
        self._under_way += 1
        self._asking[model] += 1
        return True

    def came(self, model: str, reply: Reply) -> None:
        """Count the cost of an attempt that ended."""
        self._under_way -= 1
        self._asking[model] -= 1
        if reply.error in UNASKED:
            self._sent -= 1
        elif self.limits.cost_usd is not None:
            self._add(model, reply)
        if self.limits.cost_usd is not None:
            self._came.set()
            self._came = asyncio.Event()
        if is_asking_too_much(reply):
            pause = f"its server asks for a pause of {reply.retry_after_s:.0f} s (Retry-After)"
            ends = f"a run waits at most {LONGEST_WAIT_S:.0f} s; the same command goes on later"
            self.set_aside.setdefault(model, f"{reply.error}: {pause}, and {ends}")
        self._refused[model] = self._refused[model] + 1 if reply.error in HOPELESS else 0
        if self._refused[model] >= (2 if reply.status in _PERHAPS_ONE else 1):
            self.set_aside.setdefault(model, f"{reply.error}: {reply.error_detail}")

    def ended(self, model: str, reply: Reply, lacks: str = "") -> None:
        """Register the end of a call; a model that keeps failing is set aside.

        ``lacks`` is what a reply lacks that the run cannot use: that is a failure too.
        """
        if not reply.error and not lacks:
            self._in_a_row[model] = 0
            return
        self._in_a_row[model] += 1
        if reply.error:
            self._failed[model] += 1
            self._last[model] = last = f"{reply.error}: {reply.error_detail}"
        else:
            self._without[model] += 1
            self._lacked[model] = last = lacks
        self._passes[model] = reply.error in TRANSIENT
        if self._passes[model]:
            self._passed.add(model)
        if self._in_a_row[model] >= self.limits.patience:
            self.set_aside.setdefault(model, f"{self._in_a_row[model]} calls in a row failed, the last one with {last}")

    def failures(self) -> dict[str, str]:
        """Return, for each model with failed calls, their number and the last failure in words."""
        said: dict[str, list[str]] = {}
        for model, count in self._failed.items():
            last = f"the last one with {self._last[model]}"
            said[model] = [f"{counted(count, 'call')} ended in an error, {last}"]
        for model, count in self._without.items():
            said.setdefault(model, []).append(f"{counted(count, 'call')} came back with {self._lacked[model]}")
        return {model: "; ".join(words) for model, words in said.items()}

    def lasting(self) -> frozenset[str]:
        """Return the models with failures that need a repair; once set aside, the last decides."""
        return frozenset(
            model
            for model, passes in self._passes.items()
            if not passes and (model in self.set_aside or model not in self._passed)
        )

    def _add(self, model: str, reply: Reply) -> None:
        cost = self.limits.cost(model, reply)
        if cost is None and reply.error is None:
            self.stopped = f"the cost of {model} is not known, so --max-cost cannot hold: give its price with --prices"
        self.uncounted += cost is None
        self._spent += cost or 0.0
        self._dearest = max(self._dearest, cost or 0.0)
        if cost is not None and reply.error is None:
            self._priced.add(model)
        if self._spent_up:
            self._say_spent()  # calls that were still running cost too

    def _say_spent(self) -> None:
        self.stopped = f"${self._spent:.4f} were spent, and --max-cost is {self.limits.cost_usd:g}"


class Pace:
    """Limits the parallel attempts at one model: fewer after each 429, more again without one.

    Additive increase, multiplicative decrease (Chiu and Jain 1989), within the run's concurrency.
    """

    def __init__(self, most: int) -> None:
        self.limit = float(most)
        self._most = most
        self._under_way = 0
        self._waiting: deque[asyncio.Future[None]] = deque()
        self._slowed_at = self._hold_until = 0.0

    async def enter(self) -> float:
        """Wait for a turn; return its time, in seconds of the event loop's clock."""
        loop = asyncio.get_running_loop()
        while self._under_way >= max(1, int(self.limit)):
            turn = loop.create_future()
            self._waiting.append(turn)
            await turn
        self._under_way += 1
        if (left := self._hold_until - loop.time()) > 0:
            try:
                await asyncio.sleep(left)
            except BaseException:
                self._leave()
                raise
        return loop.time()

    def leave(self, entered: float, reply: Reply) -> None:
        """Register the end of an attempt that entered at this time."""
        now = asyncio.get_running_loop().time()
        if reply.error == "rate_limited":
            if entered >= self._slowed_at:  # one decrease for all that ran at the first 429
                self.limit, self._slowed_at = max(1.0, self.limit / 2), now
            if reply.retry_after_s is not None and not is_asking_too_much(reply):
                self._hold_until = max(self._hold_until, now + reply.retry_after_s)
        elif reply.error is None:
            self.limit = min(float(self._most), self.limit + 1 / self.limit)
        self._leave()

    def _leave(self) -> None:
        self._under_way -= 1
        free = max(1, int(self.limit)) - self._under_way
        while free > 0 and self._waiting:
            turn = self._waiting.popleft()
            if not turn.done():
                turn.set_result(None)
                free -= 1


def pause_s(number: int, reply: Reply) -> float:
    """Return the seconds before the next attempt: doubling, with jitter, at least Retry-After."""
    backoff = min(30.0, 2.0 ** (number - 1)) * (0.5 + random.random() / 2)  # noqa: S311 - no secret
    return max(backoff, min(reply.retry_after_s or 0.0, LONGEST_WAIT_S))


def is_asking_too_much(reply: Reply) -> bool:
    """Return whether a transient failure asks for a longer wait than a run makes."""
    return reply.error in TRANSIENT and (reply.retry_after_s or 0.0) > LONGEST_WAIT_S
