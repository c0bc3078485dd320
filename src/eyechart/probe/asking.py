"""Asks a model a bounded number of questions, one after the other, and keeps what came and what it took."""

import asyncio
import re
import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from typing import TypedDict

from eyechart.attempts import close
from eyechart.calls import REFUSED, TRANSIENT, Query, Reply
from eyechart.errors import EyechartError, counted
from eyechart.limits import NOTHING, Spent, pause_s
from eyechart.models import Model, ask, open_model
from eyechart.models.prices import Prices, read_prices
from eyechart.modes import RequestMode, TokenField

Tell = Callable[[int, int], None]
"""Called with (calls made, calls at most) after each call."""
Spend = Callable[[Spent], None]
"""Called before each call and after it with what all calls took; those under way count, at a cost that nobody knows."""

_REFUSES = re.compile(
    r"unsupported|not supported|does not support|only the default|not permitted|unrecogni[sz]ed|unknown",
    re.IGNORECASE,
)


class Asking(TypedDict, total=False):
    """How models are asked outside a run: by these prices, for so many US dollars, and who is told of it."""

    prices: Prices
    max_cost: float | None
    tell: Tell | None
    spend: Spend | None


class LimitReachedError(EyechartError):
    """No further call may be made: so many were, or so much was spent."""


@dataclass
class Asker:
    """Asks models of one SPEC, each mode by a model of its own, at most ``most`` times and for ``max_cost`` dollars.

    A call whose error is transient is repeated once. One that is refused for a field that the model does not take is
    made without it from then on, unless the field is ``fixed``; ``notes`` say so. Raises LimitReachedError where no
    further call may be made.
    """

    mode: RequestMode
    _: KW_ONLY
    most: int
    prices: Prices = field(default_factory=read_prices)
    fixed: Collection[str] = ()
    max_cost: float | None = None
    tell: Tell | None = None
    spend: Spend | None = None
    spent: Spent = NOTHING
    notes: list[str] = field(default_factory=list)
    stopped: str | None = None
    _model: Model | None = None
    _opened: RequestMode | None = None
    _under_way: int = 0

    async def ask(self, query: Query, mode: RequestMode | None = None) -> Reply:
        """Return the reply to a query, in the mode of this asker or in another; a failure is a reply too."""
        asked = mode or self.mode
        reply = await self._once(query, asked)
        while mode is None and (change := amended(self.mode, reply, self.fixed)) is not None:
            changed, words = change
            if words in self.notes:
                break  # the one is refused, and so is the other
            self.mode = changed
            self.notes.append(words)
            asked = self.mode
            reply = await self._once(query, asked)
        folds = mode is None and bool(query.system) and self.mode.system == "system" and "system" not in self.fixed
        if folds and reply.error in REFUSED:
            reply = await self._folded(query, reply)
        if reply.error in TRANSIENT:
            await asyncio.sleep(pause_s(1, reply))
            reply = await self._once(query, asked)
            if folds and reply.error == "server_error":  # as some servers say that their template raises
                reply = await self._folded(query, reply)
        return reply

    async def together(self, queries: Sequence[Query], at_once: int) -> list[Reply]:
        """Return the replies to queries, ``at_once`` of which are under way at a time, each sent once.

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
        """Return the reply to a refused query with its system words in the user's turn; the refusal if that is too."""
        changed = replace(self.mode, system="user")
        reply = await self._once(query, changed)
        if reply.error is not None:
            return refused
        self.mode = changed
        self.notes.append(f"the system role is refused ({refused.error_detail[:120]}): asked with --system user")
        return reply

    async def facts(self) -> dict[str, str]:
        """Return what is known of the model without asking it, its version among it."""
        model = await self._open(self.mode)
        return {"version": model.version, **model.facts}

    async def close(self) -> None:
        """Let the model go."""
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
            self.stopped = f"what {spec} costs is not known, so --max-cost cannot hold: give its price with --prices"
        return reply

    def _tell_spent(self, more: int) -> None:
        """Tell what was spent, with one call ``more`` or less under way."""
        self._under_way += more
        if self.spend is not None:
            calls, unknown = (count + self._under_way for count in (self.spent.calls, self.spent.unknown))
            self.spend(replace(self.spent, calls=calls, unknown=unknown))

    def _require_room(self, of: int = 1) -> None:
        """Raise LimitReachedError where ``of`` calls at once have no room; each costs what a call cost on the mean."""
        mean = self.spent.cost_usd / max(1, self.spent.calls)
        if of > 1 and self.max_cost is not None and self.spent.cost_usd + of * mean > self.max_cost:
            self.stopped = f"${self.spent.cost_usd:.4f} were spent, and {of} calls at once may pass --max-cost"
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
    """Return a mode that does without what a failed reply refuses, and what was changed in words, or None.

    Fields in ``fixed`` are not changed. Hosted models that think refuse ``max_tokens`` and a temperature of their own.
    """
    detail = reply.error_detail
    if reply.error in REFUSED and "stream" not in fixed and (change := _streaming(mode, detail)):
        return change
    if reply.error not in REFUSED or not _REFUSES.search(detail):
        return None
    newer: TokenField = "max_completion_tokens"
    other: TokenField = "max_tokens" if mode.token_field == newer else newer
    if "token_field" not in fixed and re.search(rf"\b{mode.token_field}\b", detail):
        return replace(mode, token_field=other), f"{mode.token_field} is refused: asked with --token-field {other}"
    if "temperature" not in fixed and mode.temperature is not None and "temperature" in detail.lower():
        words = f"temperature {mode.temperature:g} is refused: asked with --temperature default"
        return replace(mode, temperature=None), words
    if "seed" not in fixed and mode.seed and re.search(r"\bseed\b", detail):
        return replace(mode, seed=False), "a seed is refused: asked without one"
    return None


def _streaming(mode: RequestMode, detail: str) -> tuple[RequestMode, str] | None:
    """Return a mode that streams where a refusal speaks of that, one without the tokens where it speaks of them."""
    if mode.stream == "none" and re.search(r"\bstream", detail, re.IGNORECASE):
        return replace(mode, stream="usage"), "what is not streamed is refused: asked with --stream usage"
    if mode.stream == "usage" and "stream_options" in detail:
        return replace(mode, stream="plain"), "tokens of a stream are refused: asked with --stream plain"
    return None
