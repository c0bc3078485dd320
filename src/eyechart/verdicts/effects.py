"""How large the effects are on which a verdict on distance rests, where they were tested, and what was not excluded."""

from collections.abc import Mapping
from dataclasses import dataclass

from eyechart.records import Written
from eyechart.stats.paired import Curve, Discordant, Dose, Part, Parts
from eyechart.stats.statistic import Statistic
from eyechart.verdicts.controls import blind_spots
from eyechart.verdicts.labels import VETO_POWER
from eyechart.verdicts.ruling import number


@dataclass(frozen=True, slots=True)
class Effects(Written):
    """What its braking does when something is moved.

    ``net`` is of the lead near over far, ``exchange`` of the lead near over a neighbour near, None where it was not
    answered. ``scenarios`` count both together, ``doses`` are its mean braking levels from the nearest distance, and
    ``unseen`` the parts in which a reversal would not have been seen with the declared power.
    """

    written = "net exchange scenarios doses tested not_excluded"

    net: Discordant
    exchange: Discordant | None
    scenarios: tuple[Part, ...]
    doses: tuple[Dose, ...]
    unseen: Mapping[str, tuple[Part, ...]]

    @property
    def varied(self) -> bool:
        """Return whether any pair was braked otherwise."""
        return any(one is not None and one.discordant > 0 for one in (self.net, self.exchange))

    @property
    def tested(self) -> tuple[str, ...]:
        """Return the ranges of distance that the lead was shown at, in words, from the nearest."""
        ends: dict[str, tuple[float, float]] = {}
        for one in self.doses:
            if one.low is not None and one.high is not None and one.frames:
                low, _ = ends.get(one.condition, (one.low, one.high))
                ends[one.condition] = low, one.high
        return tuple(_metres(f"{low:.0f}", f"{high:.0f}") for low, high in ends.values())

    @property
    def not_excluded(self) -> tuple[str, ...]:
        """Return in words where a reversal was not excluded, for want of power."""
        said = []
        for name, weak in self.unseen.items():
            where = dict.fromkeys(one.name.partition(" against ")[0] for one in weak)
            frames = [one.wins + one.losses + one.ties for one in weak]
            of = "in scenario " if name == "scenario_reversed" else "at "
            least = f"{min(frames)}–{max(frames)}" if min(frames) < max(frames) else f"{min(frames)}"
            power = min(one.power for one in weak)
            said.append(f"{of}{', '.join(where)} ({least} frames each, power from {power:.2f} on)")
        return tuple(said)

    def lines(self) -> dict[str, str]:
        """Return the same in words, by what each is about."""
        said = {"effect": f"near over far {_net(self.net)}"}
        if self.exchange is not None:
            said["effect"] += f"; the lead near over a neighbour near {_net(self.exchange)}"
        if self.scenarios:
            counts = (f"{one.name} {one.wins}/{one.losses}/{one.ties}" for one in self.scenarios)
            said["by scenario"] = f"{', '.join(counts)} (frames won, lost, alike)"
        if levels := [f"{_range(one)} {one.level:.2f}" for one in self.doses if one.level is not None]:
            said["braking by distance"] = f"{', '.join(levels)} (mean level)"
        if self.tested and self.exchange is not None:
            said["tested at"] = ", ".join(self.tested)
        if self.not_excluded:
            where = ", or ".join(self.not_excluded)
            said["not excluded"] = f"that its braking is reversed {where}: less than a power of {VETO_POWER}"
        return said


def effects_of(found: Mapping[str, Statistic]) -> Effects | None:
    """Return the effects that were measured; None where the lead was not moved."""
    net, exchange = found["depth_net"], found["lane_net"]
    if not isinstance(net, Discordant):
        return None
    scenarios, curve = found["scenario_reversed"], found["dose_curve"]
    return Effects(
        net=net,
        exchange=exchange if isinstance(exchange, Discordant) else None,
        scenarios=scenarios.parts if isinstance(scenarios, Parts) else (),
        doses=curve.doses if isinstance(curve, Curve) else (),
        unseen=blind_spots(found),
    )


def _net(one: Discordant) -> str:
    bound = "" if one.ci is None else f", at least {one.ci[0]:.3f}"
    return f"{number(one)}{bound} ({one.b} of {one.n} pairs harder, {one.c} less hard)"


def _range(one: Dose) -> str:
    return one.condition if one.low is None or one.high is None else _metres(f"{one.low:.3g}", f"{one.high:.3g}")


def _metres(low: str, high: str) -> str:
    return f"{low} m" if low == high else f"{low}–{high} m"
