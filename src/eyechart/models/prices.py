"""Prices of tokens: the user's own file, then a dated table. Without an entry: unknown, never 0."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eyechart.calls import Reply
from eyechart.errors import SpecError
from eyechart.modes import RequestMode, is_address, plain_address
from eyechart.spaces.discrete import read_toml

_TABLE = Path(__file__).with_name("prices.toml")
_MILLION = 1_000_000
Floats = NDArray[np.float64]
OWN_MACHINE = ("scripted", "hf", "ollama")
"""Adapters without a bill: their calls cost time and energy only."""


@dataclass(frozen=True, slots=True)
class Price:
    """Dollars for a million tokens in and out, with the date and the source of the price."""

    model: str
    input: float
    output: float
    date: str
    source: str
    base_url: str = ""

    def of(self, reply: Reply) -> float | None:
        """Return the cost of a reply in dollars; None where its tokens are not reported."""
        if reply.prompt_tokens is None or reply.completion_tokens is None:
            return None
        return (self.input * reply.prompt_tokens + self.output * reply.completion_tokens) / _MILLION

    @property
    def words(self) -> str:
        """Return the price in words, with its date and source."""
        return f"${self.input:g} in, ${self.output:g} out per million tokens ({self.date}, {self.source})"


@dataclass(frozen=True, slots=True)
class Prices:
    """Prices in order of precedence."""

    entries: tuple[Price, ...]

    def of(self, mode: RequestMode) -> Price | None:
        """Return the price of a model in a request mode, or None where none is known.

        An entry with an address holds for that server only, in any spelling; one without, for all.
        """
        if mode.spec.partition(":")[0] in OWN_MACHINE:
            return Price(mode.spec, 0.0, 0.0, "", "it runs on your own machine")
        at = plain_address(mode.base_url or "https://api.openai.com/v1")
        known = (entry for entry in self.entries if entry.model == mode.spec)
        return next((entry for entry in known if not entry.base_url or plain_address(entry.base_url) == at), None)

    def cost(self, mode: RequestMode, reply: Reply) -> tuple[float | None, str]:
        """Return an attempt's cost, and ``reported``, ``priced``, ``own machine`` or ``unknown``.

        The cost of a failure without tokens is unknown, not 0.
        """
        price = self.of(mode)
        if reply.cost_usd is not None:
            return reply.cost_usd, "reported"
        if price is not None and not price.date:
            return 0.0, "own machine"
        known = None if price is None else price.of(reply)
        return known, "unknown" if known is None else "priced"


def costs_at(
    price: Price | None, reported: Floats, tokens_in: Floats | None, tokens_out: Floats | None
) -> tuple[Floats, dict[str, int]]:
    """Return the costs of replies, NaN where unknown, and how many were found in which way.

    They follow as in `Prices.cost`, at one model's ``price``, from reported costs and tokens, NaN
    where unreported.
    """
    cost, left = reported.copy(), np.isnan(reported)
    if price is not None and not price.date:
        cost[left] = 0.0
    elif price is not None and tokens_in is not None and tokens_out is not None:
        cost[left] = (price.input * tokens_in[left] + price.output * tokens_out[left]) / _MILLION
    found, unknown = int(left.sum()), int(np.isnan(cost).sum())
    way = "own machine" if price is not None and not price.date else "priced"
    return cost, {"reported": len(cost) - found, way: found - unknown, "unknown": unknown}


_MOST = 1e6
"""More dollars for a million tokens are a typing error."""


def read_prices(path: Path | None = None) -> Prices:
    """Read the user's file of prices, then the table; raises SpecError for a wrong entry."""
    own = () if path is None else _entries(path)
    return Prices((*own, *_entries(_TABLE)))


def _entries(path: Path) -> tuple[Price, ...]:
    values = read_toml(path)
    entries = values.get("price")
    if set(values) != {"price"} or not isinstance(entries, list):
        raise SpecError(f"{path}: prices are tables [[price]] with model, input, output, date and source")
    return tuple(_entry(entry, f"{path}, price {number}") for number, entry in enumerate(entries, 1))


def _entry(values: object, where: str) -> Price:
    need = {"model": str, "input": float, "output": float, "date": str, "source": str}
    if not isinstance(values, Mapping) or not set(need) <= set(values) <= {*need, "base_url"}:
        raise SpecError(f"{where}: a price has {', '.join(need)}, and base_url if only one server has it")
    for name, value in values.items():
        kind = need.get(name, str)
        right = isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value <= _MOST
        if not (right if kind is float else isinstance(value, str)):
            raise SpecError(f"{where}: {name} must be {'a number of dollars' if kind is float else 'a text'}")
    if not values["date"]:
        raise SpecError(f"{where}: date must say when the source was read")
    if not is_address(values.get("base_url", "")):
        raise SpecError(f"{where}: base_url must be a URL that begins with http:// or https://")
    return Price(**values)
