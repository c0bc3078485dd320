"""Kinds of statistics about a controller's motions: the fields that rules read."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cache
from typing import TypeVar

from eyechart.stats.statistic import Statistic


@dataclass(frozen=True, slots=True)
class Share(Statistic):
    """A share of a controller's variation; None in a field means not computed.

    ``episodes`` is the number behind the bound, ``lost`` the share of calls without a motion,
    ``same`` the share of bit-identical answers. ``scatter`` is the change in the answers' spread as
    a share of the variation, with ``scatter_p``. ``carried`` names the dimensions and steps that
    change although the mean does not. ``texts`` holds the most frequent instruction and its
    replacement. ``still`` names the numbers that never change; ``seeds`` counts the seeds.

    ``bytes`` is the share that other bytes of the same pictures change, if any; the lower end is
    then of the rest. ``alike`` says that all answers are equal. ``with_noise`` is the share with the
    noise of drawn answers in it.
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
    with_noise: float | None = None
    alike: bool = field(default=False, repr=False)


@dataclass(frozen=True, slots=True)
class FollowedShare(Share):
    """How far a moved object is followed.

    ``smallest_p`` is the least p that the episodes allow. ``heading`` is the cosine between the
    ways of the answer and of the object. ``parts`` gives ``value``, ``at_most`` and ``episodes`` by
    instruction and by axis.
    """

    smallest_p: float | None = None
    heading: float | None = None
    parts: Mapping[str, Mapping[str, float]] | None = None

    @property
    def least(self) -> tuple[str, Mapping[str, float]] | None:
        """Return the part with the least upper end, with its name."""
        return min(self.parts.items(), key=lambda one: one[1]["at_most"]) if self.parts else None

    @property
    def evenly(self) -> float | None:
        """Return the upper end of the least part as a share of the whole; None without parts."""
        return self.least[1]["at_most"] / self.value if self.least and self.value and self.value > 0 else None


@dataclass(frozen=True, slots=True)
class LogDistance(Share):
    """How far motions are from logged ones.

    ``offset`` is the distance of the means of ``offset_of``, in spreads. ``spread`` is the ratio of
    the spreads of ``spread_of``. ``far_off`` moments are left out, because the log's ``far_off_of``
    lie far off there.
    """

    offset: float | None = None
    offset_of: str | None = None
    spread: float | None = None
    spread_of: str | None = None
    far_off: int | None = None
    far_off_of: Sequence[str] | None = None


def shown_share(one: Statistic) -> Statistic:
    """Return a share as people read it: what is below 0 is the noise of an estimate, and shown as 0."""
    ends = None if one.ci is None else (max(0.0, one.ci[0]), max(0.0, one.ci[1]))
    return one if one.value is None else replace(one, value=max(0.0, one.value), ci=ends)


Kind = TypeVar("Kind", bound=Statistic)


def of_kind(kind: type[Kind], statistic: Statistic, **numbers: object) -> Kind:
    """Return a statistic as another kind, with the shared fields and further numbers."""
    kinds: tuple[type, type] = (type(statistic), kind)
    return kind(**{name: getattr(statistic, name) for name in _shared(*kinds)} | numbers)


@cache
def _shared(one: type, kind: type) -> frozenset[str]:
    """Return the names of the fields that both kinds have."""
    return frozenset(each.name for each in fields(one)) & frozenset(each.name for each in fields(kind))
