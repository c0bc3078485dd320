"""A statistic: a number with its n, its interval and its p; the number may be None."""

import sys
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cache
from importlib.util import find_spec
from types import ModuleType
from typing import Any, Self

from eyechart.records import plain, to_json_fields

CHUNK_BYTES = 2**24
"""Bytes of resamples drawn at a time; the draws do not depend on it."""

TIE = 1e-9
"""Resampled statistics within this relative distance of the observed one are ties."""


@dataclass(frozen=True, slots=True)
class Statistic:
    """A value with its evidence.

    ``value`` is None when the data cannot say (never a stand-in 0); ``note`` then says why. ``n``
    counts the observations behind the value. ``ci`` is a two-sided interval of this ``level``. It
    must hold the value, else ValueError, because it would belong to something else. ``p`` is None
    if there was no test. ``unit`` is that of the value, empty for a share or another pure number.

    ``detail`` holds further plain numbers (a table, bin sizes, a rival variant) for an audit of the
    value. Numbers that a rule reads are fields of a kind of Statistic, and are in the JSON of
    ``detail`` too.
    """

    value: float | None
    n: int
    ci: tuple[float, float] | None = None
    p: float | None = None
    method: str = ""
    note: str = ""
    detail: Mapping[str, object] | None = None
    level: float = 0.95
    unit: str = ""

    @property
    def is_sound(self) -> bool:
        """Return whether the interval, if there is one, holds the value up to rounding."""
        if self.ci is None or self.value is None:
            return True
        rounding = TIE * max(1.0, abs(self.value))
        return self.ci[0] - rounding <= self.value <= self.ci[1] + rounding

    def as_dict(self) -> dict[str, object]:
        """Return the statistic as plain JSON values, with every key always present."""
        own = {one.name: getattr(self, one.name) for one in fields(self)[len(fields(Statistic)) :] if one.repr}
        detail = {name: plain(one) for name, one in own.items() if one is not None} | dict(self.detail or {})
        return {**to_json_fields(self, "value n ci p method note"), "detail": detail or None}

    def less(self, by: float) -> Self:
        """Return the value and its interval moved down by an amount that has another cause."""
        ci = None if self.ci is None else (self.ci[0] - by, self.ci[1] - by)
        return replace(self, value=None if self.value is None else self.value - by, ci=ci)


@dataclass(frozen=True, slots=True)
class UpperBound(Statistic):
    """A rate with an upper bound only; ``longest`` is the longest episode of a rate per frame."""

    longest: int | None = field(default=None, repr=False)


@dataclass(frozen=True, slots=True)
class ModelStatistics:
    """The statistics of one model in one place: a bank, or a simulator.

    ``unfinished`` describes what its run lacks; empty if nothing.
    """

    model: str
    where: str
    statistics: Mapping[str, Statistic]
    unfinished: str = ""


def percent(level: float) -> str:
    """Return the level of an interval as text."""
    return f"{100 * level:g} %"


def not_available(why: str, n: int = 0, method: str = "") -> Statistic:
    """Return the statistic of data that cannot answer, with the reason."""
    return Statistic(value=None, n=n, method=method, note=why)


def chunks(rows: int, width: int) -> Iterator[slice]:
    """Yield slices of the rows of a matrix, each of at most `CHUNK_BYTES` at 8 bytes an entry."""
    step = max(1, CHUNK_BYTES // (8 * max(1, width)))
    for start in range(0, rows, step):
        yield slice(start, min(start + step, rows))


@cache
def special_functions() -> Any:  # noqa: ANN401 - a module
    """Return the functions of ``scipy.special``, such as ``stdtrit``.

    Only its compiled functions are imported where nothing else needs the rest, which takes longer
    to import than most verdicts to make. Not while other threads run, which could find it half made.
    """
    name = "scipy.special"
    if name not in sys.modules and threading.active_count() == 1 and (found := find_spec("scipy")) is not None:
        package = ModuleType(name)
        package.__path__ = [f"{place}/special" for place in found.submodule_search_locations or ()]
        sys.modules[name] = package
        try:
            from scipy.special import _ufuncs  # noqa: PLC0415 - slow to import
        except ImportError:  # scipy keeps them elsewhere
            pass
        else:
            return _ufuncs
        finally:  # its parts too: the whole package binds to its names only what it imports itself
            for part in [one for one in sys.modules if one == name or one.startswith(f"{name}.")]:
                del sys.modules[part]
    from scipy import special  # noqa: PLC0415 - slow to import

    return special
