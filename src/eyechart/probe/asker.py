"""Calls a model a bounded number of times, and keeps the account of the calls."""

import asyncio
import re
import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from typing import TypedDict

from eyechart.attempts import close
from eyechart.calls import REFUSED, TRANSIENT, Query, Reply
from eyechart.errors import EyechartError, counted
from eyechart.limits import NOTHING, Usage, pause_s
from eyechart.models import Model, ask, open_model
from eyechart.models.prices import Prices, read_prices
from eyechart.modes import RequestMode, TokenField

Tell = Callable[[int, int], None]
"""Called with (calls made, calls at most) after each call."""
Spend = Callable[[Usage], None]
"""Called before and after each call with the total spent; running calls have an unknown cost."""

_REFUSES = re.compile(
    r"unsupported|not supported|does not support|only the default|not permitted|unrecogni[sz]ed|unknown",
    re.IGNORECASE,
)


class ProbeOptions(TypedDict, total=False):
    """Options of calls outside a run: prices, the limit in US dollars, and two callbacks."""

    prices: Prices
    max_cost: float | None
    tell: Tell | None
    spend: Spend | None


class LimitReachedError(EyechartError):
    """No further call is allowed: the limit of calls or of cost is reached."""


@dataclass
class Asker:
    """Calls models of one SPEC at most ``most`` times and for ``max_cost`` dollars.

    A call with a transient error is repeated once. If the model refuses a field that is not
    ``fixed``, this and later calls leave it out; ``notes`` say so. Raises LimitReachedError where
    no further call is allowed.
    """

    mode: RequestMode
    _: KW_ONLY
    most: int
    prices: Prices = field(default_factory=read_prices)
    fixed: Collection[str] = ()
    max_cost: float | None = None
    tell: Tell | None = None
    spend: Spend | None = None
    spent: Usage = NOTHING
    notes: list[str] = field(default_factory=list)
    stopped: str | None = None
    _model: Model | None = None
    _opened: RequestMode | None = None
    _under_way: int = 0

    async def ask(self, query: Query, mode: RequestMode | None = None) -> Reply:
        """Return the reply to a query, in this asker's mode or another; a failure is one too."""
        tried = mode or self.mode
        reply = await self._once(query, tried)
        while mode is None and (change := amended(self.mode, reply, self.fixed)) is not None:
            changed, words = change
            if words in self.notes:
                break  # both forms of the field are refused
            self.mode = changed
            self.notes.append(words)
            tried = self.mode
            reply = await self._once(query, tried)
        folds = mode is None and bool(query.system) and self.mode.system == "system" and "system" not in self.fixed
        if folds and reply.error in REFUSED:
            reply = await self._folded(query, reply)
        if reply.error in TRANSIENT:
            await asyncio.sleep(pause_s(1, reply))
            reply = await self._once(query, tried)
            if folds and reply.error == "server_error":  # some report a template's exception so
                reply = await self._folded(query, reply)
        return reply

    async def together(self, queries: Sequence[Query], at_once: int) -> list[Reply]:
        """Return the replies to queries, each sent once, ``at_once`` in parallel.

        A failure is a reply too.
        """
        self._require_room(of=len(queries))
        await self._open(self.mode)
        gate = asyncio.Semaphore(at_once)

        async def one(query: Query) -> Reply:
            async with gate:
                return await self._once(query, self.mode)

        return list(await asyncio.gather(*map(one, queries)))

    async def _folded(self, query: Query, refused: Reply) -> Reply:
        """Return the reply with the system text in the user's turn; the refusal if that fails."""
        changed = replace(self.mode, system="user")
        reply = await self._once(query, changed)
        if reply.error is not None:
            return refused
        self.mode = changed
        self.notes.append(f"the system role is refused ({refused.error_detail[:120]}): --system user is used")
        return reply

    async def facts(self) -> dict[str, str]:
        """Return the facts of the model without a call, its version included."""
        model = await self._open(self.mode)
        return {"version": model.version, **model.facts}

    async def close(self) -> None:
        """Close the model."""
        model, self._model = self._model, None
        if model is not None:
            await close(model)

    async def _once(self, query: Query, mode: RequestMode) -> Reply:
        self._require_room()
        start = time.perf_counter()
        model = await self._open(mode)
        self._tell_spent(1)
        reply = await ask(model, query)
        reply = replace(reply, seconds=time.perf_counter() - start) if reply.seconds is None else reply
        cost = self.prices.cost(mode, reply)[0]
        self.spent = self.spent.plus(reply, cost)
        self._tell_spent(-1)
        if self.tell is not None:
            self.tell(self.spent.calls, self.most)
        if self.max_cost is not None and cost is None and reply.error is None:
            spec = mode.spec
            self.stopped = f"the cost of {spec} is not known, so --max-cost cannot hold: give its price with --prices"
        return reply

    def _tell_spent(self, more: int) -> None:
        """Report the total spent, after the running calls changed by ``more``."""
        self._under_way += more
        if self.spend is not None:
            calls, unknown = (count + self._under_way for count in (self.spent.calls, self.spent.unknown))
            self.spend(replace(self.spent, calls=calls, unknown=unknown))

    def _require_room(self, of: int = 1) -> None:
        """Raise LimitReachedError if ``of`` parallel calls, each at the mean cost, pass a limit."""
        mean = self.spent.cost_usd / max(1, self.spent.calls)
        if of > 1 and self.max_cost is not None and self.spent.cost_usd + of * mean > self.max_cost:
            self.stopped = f"${self.spent.cost_usd:.4f} were spent, and {of} parallel calls may pass --max-cost"
        if self.stopped is None and self.spent.calls + of > self.most:
            self.stopped = f"{counted(self.spent.calls, 'call', 'were')} sent, and no more are allowed"
        if self.stopped is None and self.max_cost is not None and self.spent.cost_usd >= self.max_cost:
            self.stopped = f"${self.spent.cost_usd:.4f} were spent, and --max-cost is {self.max_cost:g}"
        if self.stopped is not None:
            raise LimitReachedError(self.stopped)

    async def _open(self, mode: RequestMode) -> Model:
        if self._model is None or self._opened != mode:
            await self.close()
            self._model, self._opened = open_model(mode.spec, mode), mode
        return self._model


def amended(mode: RequestMode, reply: Reply, fixed: Collection[str] = ()) -> tuple[RequestMode, str] | None:
    """Return a mode without the field that a reply refuses, and the change in words, or None.

    Fields in ``fixed`` stay. Hosted reasoning models refuse ``max_tokens`` and a temperature.
    """
    detail = reply.error_detail
    if reply.error in REFUSED and "stream" not in fixed and (change := _streaming(mode, detail)):
        return change
    if reply.error not in REFUSED or not _REFUSES.search(detail):
        return None
    newer: TokenField = "max_completion_tokens"
    other: TokenField = "max_tokens" if mode.token_field == newer else newer
    if "token_field" not in fixed and re.search(rf"\b{mode.token_field}\b", detail):
        return replace(mode, token_field=other), f"{mode.token_field} is refused: --token-field {other} is used"
    if "temperature" not in fixed and mode.temperature is not None and "temperature" in detail.lower():
        words = f"temperature {mode.temperature:g} is refused: --temperature default is used"
        return replace(mode, temperature=None), words
    if "seed" not in fixed and mode.seed and re.search(r"\bseed\b", detail):
        return replace(mode, seed=False), "a seed is refused: none is sent"
    return None


def _streaming(mode: RequestMode, detail: str) -> tuple[RequestMode, str] | None:
    """Return a mode with a stream, or one without its token counts, as the refusal asks."""
    if mode.stream == "none" and re.search(r"\bstream", detail, re.IGNORECASE):
        return replace(mode, stream="usage"), "a reply without a stream is refused: --stream usage is used"
    if mode.stream == "usage" and "stream_options" in detail:
        return replace(mode, stream="plain"), "token counts of a stream are refused: --stream plain is used"
    return None
