"""Kinds of statistics about a controller's motions: what a rule reads of them beside value, interval and p."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cache
from typing import TypeVar

from eyechart.stats.statistic import Statistic


@dataclass(frozen=True, slots=True)
class Share(Statistic):
    """A share of what a controller does; what was not looked at is None.

    ``episodes`` is how many bound it, ``lost`` the share of its calls without a motion, ``same``
    that of its answers of which not one bit changes. ``scatter`` is by how much of the variation
    the answers scatter otherwise, with ``scatter_p``; ``carried`` names the numbers and steps of an
    answer that go with it although their mean does not; ``texts`` holds what was told most often,
    and in its place; ``still`` the numbers that never change; ``seeds`` how many were asked.
    ``bytes`` is the share that other bytes of the same pictures change, where that is something:
    then the lower end is of what goes beyond it. ``alike`` says that all answers are the same.
    """

    episodes: int | None = None
    lost: float | None = None
    same: float | None = None
    scatter: float | None = None
    scatter_p: float | None = None
    carried: Mapping[str, float] | None = None
    texts: Sequence[str] | None = None
    still: Sequence[str] | None = None
    seeds: int | None = None
    bytes: float | None = None
    alike: bool = field(default=False, repr=False)


@dataclass(frozen=True, slots=True)
class Followed(Share):
    """How far something that was moved is followed.

    ``smallest_p`` is the least that the episodes allow, ``heading`` the cosine of its way and that
    of what was moved; ``parts`` tells by what was told and by axis how much it is: ``value``,
    ``at_most`` and ``episodes``.
    """

    smallest_p: float | None = None
    heading: float | None = None
    parts: Mapping[str, Mapping[str, float]] | None = None

    @property
    def least(self) -> tuple[str, Mapping[str, float]] | None:
        """Return the part that is at most the least, with its name."""
        return min(self.parts.items(), key=lambda one: one[1]["at_most"]) if self.parts else None

    @property
    def evenly(self) -> float | None:
        """Return what the least part is at most, as a share of the whole; None where there is none."""
        return self.least[1]["at_most"] / self.value if self.least and self.value and self.value > 0 else None


@dataclass(frozen=True, slots=True)
class Misfit(Share):
    """How far motions are from logged ones.

    ``offset`` is how many spreads the mean of the number ``offset_of`` is away, ``spread`` by what
    factor the spread of ``spread_of`` is another; ``far_off`` moments are left out, in which the
    log's own ``far_off_of`` are far off.
    """

    offset: float | None = None
    offset_of: str | None = None
    spread: float | None = None
    spread_of: str | None = None
    far_off: int | None = None
    far_off_of: Sequence[str] | None = None


Kind = TypeVar("Kind", bound=Statistic)


def of_kind(kind: type[Kind], one: Statistic, **numbers: object) -> Kind:
    """Return a statistic as one of another kind, with the fields that both have and further numbers."""
    kinds: tuple[type, type] = (type(one), kind)
    return kind(**{name: getattr(one, name) for name in _shared(*kinds)} | numbers)


@cache
def _shared(one: type, kind: type) -> frozenset[str]:
    """Return the names of the fields that two kinds have."""
    return frozenset(each.name for each in fields(one)) & frozenset(each.name for each in fields(kind))
