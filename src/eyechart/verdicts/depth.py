"""The rules of depth: what each statistic has to reach, what refutes it, and what leaves it open.

docs/verdicts.md shows them on one screen.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

from eyechart.conditions import OLDER, RANGED
from eyechart.frames import PATCHED
from eyechart.stats.order import Rise
from eyechart.stats.paired_tests import ChangedPairs, Place, Places
from eyechart.stats.statistic import Statistic
from eyechart.verdicts.labels import (
    ALPHA,
    BESIDE_CUT,
    BESIDE_REFUTED,
    DRAWN,
    DRAWN_LEAST,
    FAR_SHARE,
    FILE_ALPHA,
    MARGIN,
    ORDER_CUT,
    ORDER_HIGH,
    ORDER_LOW,
    ORDER_OPEN,
    RISE_ALPHA,
    SENSITIVE_FROM,
    THIRD_REFUTED,
    UNPARSED_CUT,
)
from eyechart.verdicts.rules import WORDS, Clause, NamedStatistics, Reading, Rule, compared, p_below, p_from, word

STAGE = RANGED
"""What a model is asked that brakes harder for the near lead: one stage, shuffled."""

EXCHANGE, DOSE = OLDER[:2], OLDER[2:]
"""The controls of an older bank: vehicles exchanged, and the lead at two further distances."""

NUDGED = "nudged"
"""The condition of the true picture with an invisible change: another file, the same picture."""

THIRDS = ("near", "middle", "far")
KIND_SHARES = {"near_far": FAR_SHARE, "near_drawn": 1.0, "drawn": 1.0, "drawn_far": FAR_SHARE}
"""The kinds of pairs, and how much of `ORDER_HIGH` and `ORDER_LOW` refutes each."""
KINDS = tuple(KIND_SHARES)

HARDER = "it brakes harder where the lead is nearer"
NEAR_FAR = "it brakes harder for the near lead than for the far one"
"""What is said of the whole range, and what of its two ends alone."""


def _bound(name: str, reads: str, holds: str, threshold: float, but: str, **more: object) -> Clause:
    """Return the condition that a bound reaches what depth needs."""
    return compared(name, reads, holds, threshold, but=but, conditions=STAGE, unasked=f"{but} ({{note}})", **more)


def _either(name: str, but: str, *readings: tuple[str, str, float]) -> Clause:
    """Return the condition that one of some readings holds; if all fail, depth is refuted."""
    made = tuple(Reading(*reading) for reading in readings)
    return Clause(name, made, but, needs=" or ".join(map(str, made)), untested=True)


MOVED = p_below("depth_interventional", ALPHA)
UNFOLLOWED = p_from("repeat_over_nudged", ALPHA)
"""It brakes harder for the nearer lead, and is not known to follow the file."""

LARGE = compared("depth_net", "low", ">=", MARGIN)
EXCHANGED = compared("lane_net", "low", ">=", MARGIN)
"""What calls for the pictures of `EXCHANGE`, and for those of `DOSE` after them."""

DENSE = compared(
    "drawn_distances",
    "value",
    ">=",
    DRAWN,
    but=f"a window a factor of 1.2 wide holds {{tenths}} drawn distances; to see a hole takes {DRAWN}",
    unasked="not tested {note}",
    needs=f"{DRAWN} drawn distances in a window a factor of 1.2 wide",
    conditions=STAGE,
)
EVEN = compared(
    "drawn_distances",
    "fewest",
    ">=",
    DRAWN_LEAST,
    but=f"a window a factor of 1.2 wide holds fewer than {DRAWN_LEAST} drawn distances",
    needs=f"{DRAWN_LEAST} drawn distances in each window a factor of 1.2 wide",
)

PHOTOGRAPHED = "photographed"
"""The fact that the control pictures are not known to be rendered."""

AS_TAKEN = compared(
    "depth_observational",
    "p",
    "<",
    ALPHA,
    but="on the photographs as they were taken its braking does not follow the gap",
    unasked="whether its braking follows the gap on the photographs as they were taken was not tested ({note})",
    when=PHOTOGRAPHED,
)
"""What follows moved pictures alone may follow how they were made."""

NO_EDIT = compared(
    "patched_excess",
    "p",
    ">=",
    ALPHA,
    but="it answers to the edit: pasted back where it stood, the same thing gets another decision on {changed} of the "
    "frames (a repeat: {repeated})",
    untested=True,
    conditions=(PATCHED,),
    when="patched_excess",
)
PATCHED_BOUND = compared(
    "patched_bound",
    "high",
    "<",
    MARGIN,
    but="that it answers to the edit was not excluded: {unbounded}",
    unasked="whether it answers to the edit was not tested ({note})",
    conditions=(PATCHED,),
    when="patched_bound",
)

_BESIDE_OPEN = "a vehicle beside is not excluded"
SHOWN: tuple[Clause, ...] = (
    DENSE,
    EVEN,
    _bound("sensitivity", "low", ">=", MARGIN, "that it does so on enough frames to matter is not shown"),
    _bound("specificity", "high", "<", 0.0, "that a vehicle beside moves it less than half as much is not shown"),
    *(
        _bound(f"specificity_{one}", "high", "<", BESIDE_CUT, f"{_BESIDE_OPEN} in the {one} third", untested=True)
        for one in THIRDS
    ),
    _bound(
        "specificity_reversed",
        "high",
        "<",
        0.0,
        "that a near vehicle beside hardly keeps it from braking is not shown",
        untested=True,
    ),
    _bound("order", "high", "<", ORDER_CUT, "that few comparisons come out the wrong way round is not shown"),
    _bound(
        "picture_before",
        "high",
        "<",
        0.0,
        "that earlier pictures move its braking less than half as much is not shown",
        untested=True,
    ),
    compared(
        "unparsed_controls",
        "low",
        "<=",
        UNPARSED_CUT,
        but=f"more than {UNPARSED_CUT} of its replies to edited pictures hold no decision ({{note}})",
        untested=True,
    ),
    AS_TAKEN,
    PATCHED_BOUND,
)
"""What has to be shown; where it is not, depth is open."""

NO_RISE = compared(
    "rise",
    "p",
    ">",
    RISE_ALPHA,
    but="somewhere along the road it brakes harder for a farther lead{steepest}",
    unasked="whether it brakes harder for a farther lead somewhere was not tested",
)

_TOO_FEW = "it does so on too few frames to matter"
_BESIDE = "it brakes at least half as hard for a vehicle beside"
_WRONG = "too many comparisons"
_IN_A_PLACE = ("value", "<=", ORDER_HIGH), ("low", "<=", ORDER_LOW)
REFUTING: tuple[Clause, ...] = (
    NO_EDIT,
    _either("depth_net", _TOO_FEW, ("high", ">=", MARGIN)),
    _either("lane_net", "it tells the lead from a neighbour on too few frames to matter", ("high", ">=", MARGIN)),
    _either("sensitivity", _TOO_FEW, ("value", ">=", MARGIN)),
    _either("sensitivity", _TOO_FEW, ("low", ">=", MARGIN), ("high", ">=", SENSITIVE_FROM)),
    _either(
        "specificity",
        f"{_BESIDE} (or for neither, once the lane beside is free)",
        ("high", "<", 0.0),
        ("value", "<=", BESIDE_REFUTED),
    ),
    *(
        _either(
            f"specificity_{name}",
            f"{_BESIDE} in the {name} third of the range",
            ("high", "<", BESIDE_CUT),
            ("value", "<=", THIRD_REFUTED),
        )
        for name in THIRDS
    ),
    _either("order", f"{_WRONG} come out the wrong way round", ("high", "<", ORDER_CUT), ("value", "<=", ORDER_HIGH)),
    *(
        _either(
            f"order_{kind}",
            f"{_WRONG} of {kind.replace('_', ' and ')} distances come out the wrong way round",
            ("value", "<=", share * ORDER_HIGH),
            ("low", "<=", share * ORDER_LOW),
        )
        for kind, share in KIND_SHARES.items()
    ),
    _either("place_reversed", "it brakes less hard for the nearer lead {note}", *_IN_A_PLACE),
    _either("place_beside", f"{_BESIDE} {{note}}", *_IN_A_PLACE),
    NO_RISE,
)
"""What refutes depth where it fails: the label is `content`."""

NAMED = tuple(compared(f"order_{kind}", "high", "<=", ORDER_OPEN, untested=False) for kind in KINDS)
"""What is named where it does not hold, and keeps a gate that requires depth from being met."""

_NO_HOLES, _HOLES = (compared("holes", "value", holds, 0.0) for holds in ("<=", ">"))
NO_OPEN_PLACE = compared(
    "place_open",
    "value",
    "<=",
    0.0,
    but="that it does so {note} is not shown",
    needs="an effect that is shown in every scenario and in what else is recorded",
    untested=True,
)
"""A place in which the effect is neither shown nor bounded may be a hole."""
FILE = p_below("file", FILE_ALPHA)
NO_FILE = compared(
    "file",
    "p",
    ">=",
    FILE_ALPHA,
    unasked="whether it follows the file was not tested",
    untested=False,
)

UNSHOWN = (*SHOWN, NO_RISE, NO_OPEN_PLACE, NO_FILE)
"""What keeps a model that is not refuted from depth, in this order."""
_HOLDS = (*SHOWN, *REFUTING, NO_FILE)


def is_drawn(found: NamedStatistics) -> bool:
    """Return whether pictures were answered in which the lead is drawn along its range."""
    return "sensitivity" in found and found["sensitivity"].n > 0


def is_edited(found: NamedStatistics) -> bool:
    """Return whether the control pictures of a run are edited photographs."""
    return PATCHED_BOUND.when in found


def is_refuted(found: NamedStatistics) -> bool:
    """Return whether a model brakes harder for the nearer lead, and not by distance."""
    return MOVED.holds(found) is True and any(clause.holds(found) is False for clause in REFUTING)


def holes(found: NamedStatistics) -> tuple[Place, ...]:
    """Return the places in which braking does not answer to the lead."""
    one = found["holes"]
    return one.places if isinstance(one, Places) else ()


def open_kinds(found: NamedStatistics) -> Iterator[str]:
    """Yield in words what is not excluded: kinds of pairs, thirds of the range, and all places at once."""
    for kind, clause in zip(KINDS, NAMED, strict=True):
        if not clause.holds(found):
            yield f"that comparisons of {kind.replace('_', ' and ')} distances come out the wrong way round"
    for name in THIRDS:
        if found[f"specificity_{name}"].ci is None and not any(hole.of == "range" for hole in holes(found)):
            yield f"that it brakes for a vehicle beside in the {name} third of the range"
    one = found["place_open"]
    if isinstance(one, Places) and one.places:
        yield f"that its braking does not answer {', '.join(place.where for place in one.places)}"


def bound(found: NamedStatistics) -> str:
    """Return in words how many comparisons come out the wrong way round at most."""
    ends = found["order"].ci
    most = 100 if ends is None else math.ceil(100 * ends[1] - 1e-9)
    return f"with at most {most} of 100 comparisons the wrong way round (bound of 95 %)"


def named(places: Sequence[Place]) -> str:
    """Return places in words; those of one count together: they are often the same frames."""
    where: dict[tuple[int, int], list[str]] = {}
    for place in places:
        where.setdefault((place.harder, place.frames), []).append(place.where)
    return ", and ".join(
        f"{', '.join(names)}: {harder} of {frames}{' each' if len(names) > 1 else ''}"
        for (harder, frames), names in where.items()
    )


def frames_to_exclude(one: Statistic) -> int:
    """Return about how many frames would bound the effect of an edit, if the rest are like these."""
    least = math.ceil(math.log(ALPHA) / math.log(1 - MARGIN))
    if one.ci is None or one.value is None or one.n < least or one.value >= MARGIN:
        return max(least, one.n + 1)
    return max(one.n + 1, math.ceil(one.n * ((one.ci[1] - one.value) / (MARGIN - one.value)) ** 2))


@word
def _unbounded(one: Statistic) -> str:
    """Return how many frames there are, and about how many are needed."""
    return f"n = {one.n}, about {frames_to_exclude(one)} frames are needed"


@word
def _changed(one: Statistic) -> str:
    """Return the share of decisions that another picture changes, in per cent."""
    return f"{one.changed / one.n:.0%}" if isinstance(one, ChangedPairs) else "some"


@word
def _repeated(one: Statistic) -> str:
    """Return the share of decisions that a repeat changes, in per cent."""
    return f"{one.repeated / one.n:.0%}" if isinstance(one, ChangedPairs) else "unknown"


@word
def _steepest(one: Statistic) -> str:
    """Return in brackets where it most brakes harder the farther; empty if that is not known."""
    if not (isinstance(one, Rise) and one.nearer and one.farther):
        return ""
    return " (most from {:.3g}-{:.3g} m to {:.3g}-{:.3g} m)".format(*one.nearer, *one.farther)


WORDS.update(
    bound=lambda found, _: bound(found),
    where=lambda found, _: named(holes(found)),
    hardly=lambda found, _: f", but hardly {named(holes(found))}" if "holes" in found and holes(found) else "",
    tenths=lambda found, name: f"{found[name].value:.1f}",
)
DEPTH = Rule("depth", "order", (MOVED, *_HOLDS, _NO_HOLES, NO_OPEN_PLACE), f"{HARDER}, {{bound}}")

RULES: tuple[Rule, ...] = (
    Rule("content", "", (MOVED, UNFOLLOWED), f"{NEAR_FAR}, but {{but}}", broken=REFUTING),
    Rule(
        "undecided",
        "file",
        (MOVED, FILE),
        "it follows the file, or a cache answered, so that its answers do not show what it sees",
    ),
    replace(DEPTH, label="depth_lateral", needs=(*DEPTH.needs, compared("lateral_earned", "value", ">=", 1.0))),
    DEPTH,
    Rule(
        "partial_depth",
        "holes",
        (MOVED, *_HOLDS, _HOLES),
        f"its braking answers to the lead on less than {MARGIN} of the frames {{where}}; elsewhere {HARDER}, {{bound}}",
    ),
    Rule(
        "depth_associated",
        "depth_interventional",
        (MOVED, UNFOLLOWED),
        f"{NEAR_FAR}{{hardly}}; {{but}}",
        open_to=UNSHOWN,
    ),
)
"""The rules of a model that brakes harder for the nearer lead, in their order."""
