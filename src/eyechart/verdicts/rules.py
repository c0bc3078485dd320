"""One evaluator: an axis is an ordered table of rules; the first that holds gives the label.

A clause is one condition on one statistic: it holds, it does not, or it was not tested.
"""

import operator
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from string import Formatter
from typing import Any

from eyechart.stats.evalues import EValue
from eyechart.stats.resamples import holm
from eyechart.stats.statistic import Statistic
from eyechart.verdicts.ruling import Ruling, number

NamedStatistics = Mapping[str, Statistic]
"""A model's statistics by name."""

_COMPARED: Mapping[str, Callable[[float, float], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
_SPOKEN = {"low": "lower end", "high": "upper end"}
_SIGNS = {"<": "<", "<=": "≤", ">": ">", ">=": "≥"}
_NEEDS = {
    ("p", "<"): "p below {:g}",
    ("p", ">"): "p above {:g}",
    ("p", ">="): "p of {:g} at least",
    ("low", ">="): "a lower bound of at least {:g}",
    ("low", "<="): "a lower bound of at most {:g}",
    ("high", "<"): "an upper bound below {:g}",
}
"""What a comparison needs, in words."""
_OPPOSITE = {"<": ">=", ">=": "<", ">": "<=", "<=": ">", "there": "missing", "missing": "there"}


@dataclass(frozen=True, slots=True)
class Reading:
    """One comparison of one number of a statistic with a threshold.

    ``reads`` is ``p``, ``value``, ``low`` or ``high`` (the ends of its interval) or another number
    of its kind; ``threshold`` may be the name of such a number. ``holds`` is the comparison, or
    ``there`` or ``missing``. ``otherwise`` is the outcome where a number is missing.
    """

    reads: str
    holds: str
    threshold: float | str = 0.0
    otherwise: bool | None = None

    def of(self, one: Statistic) -> bool | None:
        """Return whether it holds of a statistic."""
        read = number_of(one, self.reads)
        if self.holds in {"there", "missing"}:
            return (read is None) == (self.holds == "missing")
        against = number_of(one, self.threshold) if isinstance(self.threshold, str) else self.threshold
        return self.otherwise if read is None or against is None else _COMPARED[self.holds](read, against)

    def __invert__(self) -> "Reading":
        otherwise = None if self.otherwise is None else not self.otherwise
        return Reading(self.reads, _OPPOSITE[self.holds], self.threshold, otherwise)

    def __str__(self) -> str:
        if self.holds in {"there", "missing"}:
            return f"{self.reads} {self.holds}"
        against = self.threshold if isinstance(self.threshold, str) else f"{self.threshold:g}"
        return f"{_SPOKEN.get(self.reads, self.reads)} {_SIGNS[self.holds]} {against}"


def number_of(one: Statistic, reads: str) -> float | None:
    """Return a number of a statistic by its name, None where it is missing.

    Raises AttributeError for a number that its kind does not have.
    """
    if reads in {"low", "high"}:
        return None if one.ci is None else one.ci[reads == "high"]
    silent = one.value is None and one.p is None
    result: float | None = getattr(one, reads, None) if silent else getattr(one, reads)
    return result


@dataclass(frozen=True, slots=True)
class Clause:
    """A condition on a statistic: one of some readings has to hold.

    ``but`` says what it means that it does not hold, ``unasked`` that it was not tested, ``needs``
    what would make it hold. The p of a ``family`` are corrected together. ``untested`` is what a
    rule takes it for where it was not tested; ``conditions`` are the pictures that would test it.
    ``when`` names a fact: where a run has none of this name, it holds.
    """

    statistic: str
    readings: tuple[Reading, ...]
    but: str = ""
    needs: str = ""
    unasked: str = ""
    family: tuple[str, ...] = ()
    untested: bool | None = None
    conditions: tuple[str, ...] = ()
    when: str = ""

    def read(self, found: NamedStatistics) -> Statistic:
        """Return its statistic, with the p that it reads."""
        one = found[self.statistic]
        if not self.family:
            return one
        corrected = holm([found[name].p for name in self.family])
        return replace(one, p=dict(zip(self.family, corrected, strict=True))[self.statistic])

    def applies(self, found: NamedStatistics) -> bool:
        """Return whether a run has the fact that it depends on."""
        return not self.when or self.when in found

    def outcome(self, found: NamedStatistics) -> bool | None:
        """Return whether it holds, None where it was not tested."""
        if not self.applies(found):
            return True
        one = self.read(found)
        said = {reading.of(one) for reading in self.readings}
        return True if True in said else None if None in said else False

    def is_settled(self, found: NamedStatistics) -> bool:
        """Return whether it holds of an e-value."""
        return self.applies(found) and isinstance(found[self.statistic], EValue) and self.outcome(found) is True

    def holds(self, found: NamedStatistics) -> bool | None:
        """Return the outcome as a rule takes it."""
        said = self.outcome(found)
        return self.untested if said is None else said


@dataclass(frozen=True, slots=True)
class Rule:
    """A label: each clause of ``needs`` has to hold, and one of ``broken``, if any, to fail.

    ``decided_by`` names the statistic that decides; without it the first clause of ``broken`` that
    fails does, or the one with the greatest p where the ``worst`` decides. ``says`` is the
    sentence, see `filled`; its ``{but}`` is of the clause that decides, or of the first of
    ``open_to`` that does not hold. ``why_not`` says what stood in the way of a stronger label,
    ``may_be`` which label is neither given nor refuted. ``bound`` names the statistic that bounds
    the label beyond what was asked. A ``quiet`` rule prints no numbers.
    """

    label: str
    decided_by: str = ""
    needs: tuple[Clause, ...] = ()
    says: str = ""
    broken: tuple[Clause, ...] = ()
    open_to: tuple[Clause, ...] = ()
    worst: bool = False
    quiet: bool = False
    why_not: str = ""
    may_be: str = ""
    bound: str = ""

    def ruling(self, found: NamedStatistics) -> Ruling | None:
        """Return the ruling, None where the rule does not hold."""
        if not all(clause.holds(found) for clause in self.needs):
            return None
        broken = [clause for clause in self.broken if clause.holds(found) is False]
        if self.broken and not broken:
            return None
        clause = max(broken, key=lambda one: one.read(found).p or 0.0) if self.worst else next(iter(broken), None)
        name = self.decided_by or (clause.statistic if clause else "")
        clause = clause or next((one for one in self.open_to if not one.holds(found)), None)
        return Ruling(
            self.label,
            name,
            filled(self.says, found, clause),
            None if self.quiet else found[name],
            tuple(one.statistic for one in self.needs if one.statistic != name and one.is_settled(found)),
            why_not=filled(self.why_not, found, clause),
            may_be=self.may_be,
            bound=found[self.bound] if self.bound else None,
        )


WORDS: dict[str, Callable[[Any, str], str]] = {
    "value": lambda found, name: number(found[name]),
    "note": lambda found, name: found[name].note,
}
"""The words of places: each a function of the statistics and of the name of one."""


def word(says: Callable[[Any], str]) -> Callable[[Any], str]:
    """Register a function of one statistic as a word of sentences."""
    WORDS[says.__name__.strip("_")] = lambda found, name: says(found[name])
    return says


def filled(sentence: str, found: NamedStatistics, clause: Clause | None = None) -> str:
    """Return a sentence with its places filled: ``{value:NAME}`` is the value of a statistic.

    ``{note:NAME|=words}`` is the first that is not empty. ``{but}`` is what the clause says; its
    places are of its own statistic where they name none.
    """
    parts = []
    for literal, name, spec, _ in Formatter().parse(sentence):
        parts.append(literal)
        if name == "but":
            parts.append("" if clause is None else filled(_said_of(clause, found), found, clause))
        elif name is not None:
            own = clause.statistic if clause is not None else ""
            places = f"{name}:{spec}".split("|")
            parts.append(next((said for place in places if (said := _filled(place, found, own))), ""))
    return "".join(parts)


def _said_of(clause: Clause, found: NamedStatistics) -> str:
    is_tested = not clause.unasked or clause.outcome(found) is not None
    return clause.but if is_tested else clause.unasked


def _filled(place: str, found: NamedStatistics, own: str) -> str:
    if place.startswith("="):
        return place[1:]
    name, _, of = place.partition(":")
    return WORDS[name](found, of or own)


@dataclass(frozen=True, slots=True)
class Axis:
    """Rules in their order; the last one always holds."""

    name: str
    rules: tuple[Rule, ...]

    def evaluate(self, found: NamedStatistics) -> Ruling:
        """Return the ruling of the first rule that holds."""
        return next(ruling for rule in self.rules if (ruling := rule.ruling(found)))

    @property
    def clauses(self) -> tuple[Clause, ...]:
        """Return every clause of its rules once."""
        return tuple(dict.fromkeys(clause for rule in self.rules for clause in (*rule.needs, *rule.broken)))


def p_below(name: str, alpha: float, **more: object) -> Clause:
    """Return the condition that a test was made and rejects."""
    return compared(name, "p", "<", alpha, **{"untested": False, **more})


def p_from(name: str, alpha: float, **more: object) -> Clause:
    """Return the condition that a test does not reject, or was not made."""
    return compared(name, "p", ">=", alpha, untested=True, **more)


def missing(name: str, reads: str = "p") -> Clause:
    """Return the condition that there is no such number."""
    return Clause(name, (Reading(reads, "missing"),))


def there(name: str, reads: str = "p") -> Clause:
    """Return the condition that there is such a number."""
    return Clause(name, (Reading(reads, "there"),))


def compared(name: str, reads: str, holds: str, threshold: float | str, **more: object) -> Clause:
    """Return the condition of one comparison."""
    needs = _NEEDS.get((reads, holds), "").format(threshold)
    return Clause(name, (Reading(reads, holds, threshold),), **{"needs": needs, **more})  # type: ignore[arg-type]


def fail(clauses: Iterable[Clause], but: str = "") -> Clause:
    """Return the condition that one of some conditions on one statistic does not hold."""
    many = tuple(clauses)
    return Clause(many[0].statistic, tuple(~clause.readings[0] for clause in many), but)


def fact(name: str, *, holds: bool) -> Mapping[str, Statistic]:
    """Return a fact on a run as a statistic that a rule can read."""
    return {name: Statistic(float(holds), 1)}
