"""The rules of depth: what each statistic has to reach, what refutes it, and what leaves it open.

docs/verdicts.md has them on one screen, docs/statistics.md what each statistic does not show.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

from eyechart.conditions import OLDER, RANGED
from eyechart.stats.order import Rise
from eyechart.stats.paired import Place, Places
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
from eyechart.verdicts.rules import WORDS, Clause, Found, Reading, Rule, compared, p_below, p_from, word

STAGE = RANGED
"""What a model is asked in one stage, in a shuffled order, that brakes harder for the near lead."""

EXCHANGE, DOSE = OLDER[:2], OLDER[2:]
"""What a bank may have that has none of these: who is near exchanged, and the lead at two distances between."""

NUDGED = "nudged"
"""The true picture with a change that nobody sees: another file, the same picture."""

THIRDS = ("near", "middle", "far")
KIND_SHARES = {"near_far": FAR_SHARE, "near_drawn": 1.0, "drawn": 1.0, "drawn_far": FAR_SHARE}
"""The kinds of pairs, and how much of `ORDER_HIGH` and `ORDER_LOW` refutes each."""
KINDS = tuple(KIND_SHARES)

HARDER = "it brakes harder where the lead is nearer"


def _needs(name: str, reads: str, holds: str, threshold: float, **more: object) -> Clause:
    """Return that a bound reaches what depth needs."""
    needs = f"a {'lower' if reads == 'low' else 'upper'} bound {_WORDS[holds]} {threshold}"
    return compared(name, reads, holds, threshold, needs=needs, conditions=STAGE, unasked="not tested", **more)


_WORDS = {"<": "below", "<=": "of at most", ">=": "of at least"}


def _either(name: str, but: str, *readings: tuple[str, str, float]) -> Clause:
    """Return that one of some readings holds: where none does, it is refuted; what cannot be said refutes nothing."""
    made = tuple(Reading(*one) for one in readings)
    return Clause(name, made, but, needs=" or ".join(map(str, made)), untested=True)


MOVED = p_below("depth_interventional", ALPHA)
UNFOLLOWED = p_from("repeat_over_nudged", ALPHA)
"""It brakes harder for the nearer lead, and is not known to follow the file, which depth tests by itself."""

LARGE = compared("depth_net", "low", ">=", MARGIN)
EXCHANGED = compared("lane_net", "low", ">=", MARGIN)
"""What calls for the pictures of `EXCHANGE`, and for those of `DOSE` after them."""

TURNS = compared("lateral_earned", "value", ">=", 1.0)
"""What earns ``depth_lateral`` where distance earns ``depth``."""

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

SHOWN: tuple[Clause, ...] = (
    DENSE,
    EVEN,
    _needs("sensitivity", "low", ">=", MARGIN, but="on how many frames is not shown to matter"),
    _needs("specificity", "high", "<", 0.0, but="that a vehicle beside moves it less than half as much is not shown"),
    *(
        _needs(
            f"specificity_{name}",
            "high",
            "<",
            BESIDE_CUT,
            but=f"a vehicle beside is not excluded in the {name} third",
            untested=True,
        )
        for name in THIRDS
    ),
    _needs("order", "high", "<", ORDER_CUT, but="how many comparisons come out the wrong way round is not bounded"),
    compared(
        "unparsed_controls",
        "low",
        "<=",
        UNPARSED_CUT,
        but=f"more than {UNPARSED_CUT} of its replies to edited pictures hold no decision ({{note}})",
        needs=f"a lower bound of at most {UNPARSED_CUT}",
        untested=True,
    ),
)
"""What has to be shown: what is only not shown leaves it open."""

NO_RISE = compared(
    "rise",
    "p",
    ">",
    RISE_ALPHA,
    but="harder the farther, somewhere along the road{steepest}",
    unasked="whether it brakes harder the farther somewhere was not tested",
    needs=f"p above {RISE_ALPHA}",
)

REFUTING: tuple[Clause, ...] = (
    _either("depth_net", "harder for the nearer lead on too few frames to matter", ("high", ">=", MARGIN)),
    _either("lane_net", "for the lead rather than a neighbour on too few frames to matter", ("high", ">=", MARGIN)),
    _either("sensitivity", "harder for the nearer lead on too few frames to matter", ("value", ">=", MARGIN)),
    _either(
        "sensitivity",
        "harder for the nearer lead on too few frames to matter",
        ("low", ">=", MARGIN),
        ("high", ">=", SENSITIVE_FROM),
    ),
    _either(
        "specificity",
        "half as hard or more for a vehicle beside (or for neither, once the lane beside is free)",
        ("high", "<", 0.0),
        ("value", "<=", BESIDE_REFUTED),
    ),
    *(
        _either(
            f"specificity_{name}",
            f"half as hard or more for a vehicle beside in the {name} third of the range",
            ("high", "<", BESIDE_CUT),
            ("value", "<=", THIRD_REFUTED),
        )
        for name in THIRDS
    ),
    _either(
        "order",
        "the wrong way round in too many comparisons",
        ("high", "<", ORDER_CUT),
        ("value", "<=", ORDER_HIGH),
    ),
    *(
        _either(
            f"order_{kind}",
            f"the wrong way round in too many comparisons of {kind.replace('_', ' and ')}",
            ("value", "<=", share * ORDER_HIGH),
            ("low", "<=", share * ORDER_LOW),
        )
        for kind, share in KIND_SHARES.items()
    ),
    _either(
        "place_reversed", "less hard for the nearer lead {note}", ("value", "<=", ORDER_HIGH), ("low", "<=", ORDER_LOW)
    ),
    _either(
        "place_beside",
        "half as hard or more for a vehicle beside {note}",
        ("value", "<=", ORDER_HIGH),
        ("low", "<=", ORDER_LOW),
    ),
    NO_RISE,
)
"""What shows that it does not hold: `content`."""

NAMED = tuple(compared(f"order_{kind}", "high", "<=", ORDER_OPEN, untested=False) for kind in KINDS)
"""What is named where it does not hold, and keeps authority from whoever has the label."""

NO_HOLES = compared("holes", "value", "<=", 0.0)
HOLES = compared("holes", "value", ">", 0.0)
NO_OPEN_PLACE = compared(
    "place_open",
    "value",
    "<=",
    0.0,
    but="that it does so {note} is not shown",
    needs="an effect that is shown in every scenario and in what else is recorded",
    untested=True,
)
"""A place in which the effect is neither shown nor bounded may be a hole: more frames of it tell."""
FILE = p_below("file", FILE_ALPHA)
NO_FILE = compared(
    "file",
    "p",
    ">=",
    FILE_ALPHA,
    unasked="whether it follows the file was not tested",
    needs=f"p of {FILE_ALPHA} at least",
    untested=False,
)

UNSHOWN = (*SHOWN, NO_RISE, NO_OPEN_PLACE, NO_FILE)
"""What keeps who is not refuted from depth, the first that does not hold first."""
_HOLDS = (*SHOWN, *REFUTING, NO_FILE)


def is_drawn(found: Found) -> bool:
    """Return whether pictures were answered in which the lead is drawn along its range."""
    return "sensitivity" in found and found["sensitivity"].n > 0


def is_refuted(found: Found) -> bool:
    """Return whether who brakes harder for the nearer lead is shown not to brake by its distance."""
    return MOVED.holds(found) is True and any(clause.holds(found) is False for clause in REFUTING)


def holes(found: Found) -> tuple[Place, ...]:
    """Return the places in which its braking does not answer to the lead."""
    one = found["holes"]
    return one.places if isinstance(one, Places) else ()


def open_kinds(found: Found) -> Iterator[str]:
    """Yield in words what is not excluded: kinds of pairs, thirds of the range, and places that are not shown."""
    for kind, clause in zip(KINDS, NAMED, strict=True):
        if not clause.holds(found):
            yield f"that it is the wrong way round in comparisons of {kind.replace('_', ' and ')}"
    for name in THIRDS:
        if found[f"specificity_{name}"].ci is None and not any(one.of == "range" for one in holes(found)):
            yield f"that it brakes for a vehicle beside in the {name} third of the range"
    one = found["place_open"]
    for place in one.places if isinstance(one, Places) else ():
        yield f"that its braking does not answer {place.where}"


def bound(found: Found) -> str:
    """Return in words how many comparisons come out the wrong way round at most."""
    ends = found["order"].ci
    most = 100 if ends is None else math.ceil(100 * ends[1] - 1e-9)
    return f"at most {most} of 100 comparisons the wrong way round"


def named(places: Sequence[Place]) -> str:
    """Return places in words with their counts; those of one count together, for they are often the same frames."""
    counts = dict.fromkeys((one.harder, one.frames) for one in places)
    said = []
    for harder, frames in counts:
        where = [one.where for one in places if (one.harder, one.frames) == (harder, frames)]
        said.append(f"{', '.join(where)}: {harder} of {frames}{' each' if len(where) > 1 else ''}")
    return ", nor ".join(said)


@word
def _steepest(one: Rise) -> str:
    """Return in brackets where it brakes harder the farther most; nothing where that is not known."""
    if not (one.nearer and one.farther):
        return ""
    return " (most from {:.3g}-{:.3g} m to {:.3g}-{:.3g} m)".format(*one.nearer, *one.farther)


WORDS.update(
    bound=lambda found, _: bound(found),
    where=lambda found, _: named(holes(found)),
    tenths=lambda found, name: f"{found[name].value:.1f}",
)
DEPTH = Rule("depth", "order", (MOVED, *_HOLDS, NO_HOLES, NO_OPEN_PLACE), f"{HARDER}, {{bound}}")

RULES: tuple[Rule, ...] = (
    Rule("content", "", (MOVED, UNFOLLOWED), f"{HARDER}, but {{but}}", broken=REFUTING),
    Rule("undecided", "file", (MOVED, FILE), "it follows the file, or a cache answered, and neither is sight"),
    replace(DEPTH, label="depth_lateral", needs=(*DEPTH.needs, TURNS)),
    DEPTH,
    Rule("partial_depth", "holes", (MOVED, *_HOLDS, HOLES), "brakes by distance, not {where}; elsewhere {bound}"),
    Rule(
        "depth_associated",
        "depth_interventional",
        (MOVED, UNFOLLOWED),
        f"{HARDER}; {{but}}",
        open_to=UNSHOWN,
    ),
)
"""The rules of who brakes harder for the nearer lead, in their order."""
