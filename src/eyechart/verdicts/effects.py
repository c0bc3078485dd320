"""How large the effects are of what was moved, beside what depth rests on."""

from collections.abc import Mapping
from dataclasses import dataclass

from eyechart.records import Written
from eyechart.stats.paired import Discordant
from eyechart.stats.statistic import Statistic
from eyechart.verdicts.ruling import number


@dataclass(frozen=True, slots=True)
class Effects(Written):
    """What its braking does when something is moved.

    ``net`` is of the lead near over far, ``exchange`` of the lead near over a neighbour near, None where it was not
    answered.
    """

    written = "net exchange"

    net: Discordant
    exchange: Discordant | None

    @property
    def varied(self) -> bool:
        """Return whether any pair was braked otherwise."""
        return any(one is not None and one.discordant > 0 for one in (self.net, self.exchange))

    def lines(self) -> dict[str, str]:
        """Return the same in words, by what each is about."""
        beside = "" if self.exchange is None else f"; the lead near over a neighbour near {_net(self.exchange)}"
        return {"effect": f"near over far {_net(self.net)}{beside}"}


def effects_of(found: Mapping[str, Statistic]) -> Effects | None:
    """Return the effects that were measured; None where the lead was not moved."""
    net, exchange = found["depth_net"], found["lane_net"]
    if not isinstance(net, Discordant):
        return None
    return Effects(net, exchange if isinstance(exchange, Discordant) else None)


def _net(one: Discordant) -> str:
    bound = "" if one.ci is None else f", at least {one.ci[0]:.3f}"
    return f"{number(one)}{bound} ({one.b} of {one.n} pairs harder, {one.c} less hard)"
