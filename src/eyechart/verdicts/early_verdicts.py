"""The verdict on a run that stopped early rests on the e-values that stopped it alone."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

from eyechart.records import to_json_fields
from eyechart.verdicts.battery_rules import calibrated_rules
from eyechart.verdicts.labels import ALPHA, BOUND_ALPHA, LABELS, LATERAL, MARGIN, NET_ALPHA, NOT_JUDGED
from eyechart.verdicts.rules import WORDS, Axis, Clause, NamedStatistics, Reading, Rule, compared, filled
from eyechart.verdicts.ruling import Ruling

PREFIX = "early."
"""The names of e-values among the statistics of a model begin with it."""

FORECAST_ALPHA = 0.02
"""The chance that a forecast of the rest of the run is wrong."""

_SETTLED = [name for name, label in LABELS.items() if label.early and name != "depth"]

NOT_YET = "not_yet"
"""The label of a run of which no claim is settled that would give one."""

_REQUIRED = frozenset(("bound_shuffled",))
"""Without it no absence is claimed, even where a bank cannot test it."""
_ALONG = {
    "depth": compared("along", "value", ">=", 1.0),
    "depth_associated": compared("along", "value", "<", 1.0),
}
"""Braking by distance is evidence for the first with pictures along the range, else the second."""
_ALONE = compared("one_direction", "value", ">=", 1.0)
WORDS["says"] = lambda found, name: found[name].says


def _row(label: str, claims: tuple[str, ...], *facts: Clause) -> Rule:
    by, needed = PREFIX + claims[0], _REQUIRED | {claims[0]}
    settled = (Reading("settled", ">=", 1.0),)  # a claim that the bank cannot test is left out, unless it is needed
    needs = tuple(Clause(PREFIX + name, settled, untested=name not in needed) for name in claims)
    return Rule(label, by, (*facts, *needs), f"{{says:{by}}}")


def _of_turns() -> Iterator[Rule]:
    for label, one in LATERAL.items():
        if one.early:
            if label != "swaps":
                yield _row("one_sided", one.early, _ALONE)
            yield _row(label, one.early)


_OPEN = Rule(NOT_YET, f"{PREFIX}scorable", says="no claim that would give a label is settled", quiet=True)

EARLY = Axis(
    "early",
    (
        *(_row(label, one.early, *filter(None, (_ALONG.get(label),))) for label, one in LABELS.items() if one.early),
        _OPEN,
    ),
)
"""The labels that e-values settle; ``along`` says whether there are pictures along the range."""

EARLY_LATERAL = Axis("early lateral", (*_of_turns(), _OPEN))
"""The lateral labels likewise; ``one_direction`` is that of `lateral_facts`."""

GUARANTEE = (
    f"a false early verdict has a chance of at most {ALPHA * len(_SETTLED):.2f} a model, however often one looks "
    f"({ALPHA} for each of {', '.join(_SETTLED)}); depth is judged by the rules of a whole run, on all frames, and "
    "only what they do not read is left out; that depth_associated is said of braking that goes with distance on "
    f"{MARGIN} of the frames or less, {NET_ALPHA}; that a reaction to one condition alone was missed, {BOUND_ALPHA}; "
    f"that the whole run would have been not_scorable, {FORECAST_ALPHA}; lateral, {ALPHA} for swaps, {ALPHA} for "
    f"their denial, {FORECAST_ALPHA} that the whole run would have held turns enough"
)
VALIDITY = (
    "it needs frames in random order, which the seed gives, and answers that do not depend on the calls before; "
    "correlated frames of an episode do no harm"
)


@dataclass(frozen=True, slots=True)
class StoppingPoint:
    """Where a model's verdict was settled before its run ended.

    ``decided_by`` is the first of the claims that the calibrated ``label`` rests on, ``other_claims``
    has the others. ``lateral`` is None where the ordinary lateral rules apply. ``calls`` counts the
    calls up to the stop, ``beyond`` those that were under way then and do not count.
    """

    label: str
    decided_by: str
    lateral: str | None
    lateral_by: str
    frames: int
    calls: int
    planned: int
    beyond: int = 0
    interventional: bool = False
    other_claims: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        counts = to_json_fields(self, "lateral lateral_by frames calls planned saved beyond")
        return {"rule": self.label, "decided_by": self.decided_by, "with": list(self.other_claims), **counts}

    @property
    def is_whole(self) -> bool:
        """Return whether its label is judged by the rules of a whole run."""
        return self.label == "depth"

    @property
    def saved(self) -> int:
        """Return the number of calls that were not made."""
        return self.planned - self.calls - self.beyond

    def words(self) -> str:
        """Return what happened, in words."""
        return f"stopped early after {self.calls} of {self.planned} calls, as {self.label} was settled"


def early_rules(found: NamedStatistics, stopped: StoppingPoint, *, turns: bool) -> tuple[Ruling, str]:
    """Return the calibrated label of a run that stopped, and how distance was tested."""
    if stopped.is_whole:
        ruling, evidence = calibrated_rules(found, turns=turns)
        return replace(ruling, reason=f"{stopped.words()}: {ruling.reason}", found=ruling.reason), evidence
    evidence = "interventional" if stopped.interventional else "none"
    ruling = _settled(found, stopped.label, stopped.decided_by, stopped.words())
    return replace(ruling, other_claims=stopped.other_claims), evidence


def early_lateral(found: NamedStatistics, stopped: StoppingPoint) -> Ruling | None:
    """Return the lateral label of a run that stopped; None where the ordinary rules apply."""
    name = stopped.lateral
    return None if name is None else _settled(found, name, stopped.lateral_by, "stopped early")


def early_paper(stopped: StoppingPoint) -> Ruling:
    """Return what stands in place of the paper's label of a run that stopped."""
    return Ruling(NOT_JUDGED, stopped.decided_by, f"{stopped.words()}: the paper's tests need the whole run")


def _settled(found: NamedStatistics, label: str, name: str, how: str) -> Ruling:
    says = filled("{says:" + name + "}", found)
    return Ruling(label, name, f"{how}: {says}", found[name], found=says)
