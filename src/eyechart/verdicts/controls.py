"""The conditions that depth needs beside its first: which of them fail, and which could not be tested.

Number 38 of docs/decisions says why they are these, and what still fools them.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from eyechart.stats.paired import Part, Parts
from eyechart.stats.statistic import Statistic
from eyechart.verdicts.labels import (
    ALPHA,
    ANY_LOST,
    BOTH_LOST,
    DOSE_ALPHA,
    ENDS_LOST,
    MARGIN,
    SCENARIO_ALPHA,
    UNPARSED_CUT,
    VETO_POWER,
)
from eyechart.verdicts.rules import Clause, Reading, p_below, p_from, said_of
from eyechart.verdicts.ruling import measured

EXCHANGE = ("lane_own", "lane_beside")
"""Who is near, the lead or a neighbour, exchanged at equal distance."""

DOSE = ("lead_mid_near", "lead_mid_far")
"""The lead at two distances between near and far."""

NUDGED = "nudged"
"""The true picture with a change that nobody sees: another file, the same picture."""

ABSENT = "lead_absent"
"""The same moment without the lead: it tells who asks only whether there is one."""

STEPS = ("dose_near_mid", "dose_mid", "dose_mid_far")
"""The steps of the dose, from the nearest distance."""

VETOES = {"dose_bins": DOSE_ALPHA, "scenario_reversed": SCENARIO_ALPHA}
"""The vetoes that look at parts of a bank, and the level of each."""


OPEN = ("depth_net", "lane_exchange", "lane_net")
"""The conditions that fail where an effect is not shown; the others fail where a reversal is."""

_HARDER = {
    "near_far_lost": "harder for the far lead on more frames than its noise explains",
    "lane_lost": "harder for the neighbour on more frames than its noise explains",
    "both_lost": "the wrong way round on a share of the frames of their own",
    "ends_lost": "least for the nearer and hardest for the farther in more pairs than noise in each picture explains",
    "any_lost": "the wrong way round in one comparison or another on too many frames together",
}
"""What each share of pairs that are lost means where it is too large."""

_ORDER = {
    "dose_lost": "less hard the nearer on more frames than its noise explains",
    "dose_by_frame": "the wrong way round on some of the frames, each time",
    "twice_lost": "the wrong way round at one end, in both pictures of it",
    "dose_scan": "less hard the nearer somewhere between",
}
"""What each test of the order means where it rejects; of all but the last also more frames than `BOTH_LOST`."""


def _net(name: str, but: str) -> Clause:
    """Return that the lower end of a net effect reaches the margin."""
    reaches = Reading("low", ">=", MARGIN)
    return Clause(name, (reaches,), but, f"lower bound of {MARGIN} at least", untested=True)


def _step(name: str) -> Clause:
    """Return that a step of the dose is not reversed; without it there is no dose."""
    return Clause(
        name,
        (Reading("p", ">=", DOSE_ALPHA),),
        but="less hard at one of the distances between than at a farther one",
        needs=f"p of a reversal, corrected, of {DOSE_ALPHA} at least",
        unasked="whether its braking falls with distance all the way was not tested",
        family=STEPS,
        conditions=DOSE,
    )


def _veto(name: str, where: str) -> Clause:
    """Return that no part of a bank shows a reversal."""
    needs = f"p of a reversal, corrected, of {VETOES[name]} at least"
    return p_from(name, VETOES[name], but=f"less hard the nearer {where} ({{note}})", needs=needs)


def _lost(name: str) -> Clause:
    """Return that not too many pairs are lost: of any comparison also beyond what few frames leave open."""
    most = {"ends_lost": ENDS_LOST, "any_lost": ANY_LOST}.get(name, BOTH_LOST)
    few = (Reading("low", "<=", 0.0, otherwise=False),) if name == "any_lost" else ()
    return Clause(name, (Reading("value", "<=", most), *few), _HARDER[name], f"at most {most}", untested=True)


def _ordered(name: str) -> Clause:
    """Return that a test of the order does not reject, or not on frames enough."""
    enough = () if name == "dose_scan" else (Reading("value", "<=", BOTH_LOST),)
    readings = (Reading("p", ">=", DOSE_ALPHA), *enough)
    return Clause(name, readings, f"{_ORDER[name]} ({{note}})", f"p of {DOSE_ALPHA} at least", untested=True)


EXCHANGED = p_below(
    "lane_exchange",
    ALPHA,
    but="a vehicle of a neighbouring lane does as well: it may brake for any vehicle, wherever it stands",
    unasked="whether it brakes for the lead or for whoever is near was not tested",
    untested=None,
    conditions=EXCHANGE,
)

CONTROLS: tuple[Clause, ...] = (
    _net("depth_net", "on too few frames to matter"),
    EXCHANGED,
    _net("lane_net", "for the lead rather than a neighbour on too few frames to matter"),
    *map(_step, STEPS),
    _veto("dose_bins", "in part of the range"),
    _veto("scenario_reversed", "in one of its scenarios"),
    *map(_lost, _HARDER),
    *map(_ordered, _ORDER),
)
"""The conditions (2) to (6) of depth, in their order: one that was tested and fails is `content`."""

ASKED: tuple[Clause, ...] = (
    Clause(
        "repeat_over_nudged",
        (Reading("p", "there"),),
        "whether it follows the file was not tested",
        conditions=(NUDGED,),
    ),
    Clause(
        "unparsed_controls",
        (Reading("low", "<=", UNPARSED_CUT),),
        f"more than {UNPARSED_CUT} of its replies to edited pictures hold no decision ({{note}})",
        f"a lower bound of at most {UNPARSED_CUT}",
        untested=True,
    ),
)
"""What else has to be asked, and answered."""

LACKING = (EXCHANGED, *map(_step, STEPS), *ASKED)
"""What keeps a question of depth open, in the order in which it is asked."""


@dataclass(frozen=True, slots=True)
class Failure:
    """A condition of depth that was tested and does not hold: its clause, the statistic as read, and what it says."""

    clause: Clause
    read: Statistic
    says: str

    @property
    def statistic(self) -> str:
        """Return the name of the statistic."""
        return self.clause.statistic


def below(p: float | None, alpha: float = ALPHA) -> bool:
    """Return whether a test was made and rejects."""
    return p is not None and p < alpha


def failures(found: Mapping[str, Statistic]) -> Iterator[Failure]:
    """Yield the conditions (2) to (6) of depth that were tested and fail, in their order."""
    for clause in CONTROLS:
        if clause.holds(found) is False:
            yield Failure(clause, clause.read(found), said_of(clause, found))


def lacking(found: Mapping[str, Statistic]) -> Iterator[Clause]:
    """Yield the clauses that were not tested, or not answered, in the order in which they are asked."""
    return (clause for clause in LACKING if not clause.holds(found))


def refuted(found: Mapping[str, Statistic]) -> bool:
    """Return whether it is shown that braking does not follow the lead's distance, and not only that nothing shows it.

    So it is where a veto rejects, and where its braking for the lead rather than a neighbour is bounded below the
    margin, of who brakes harder for the nearer lead.
    """
    if not below(found["depth_interventional"].p):
        return False
    beside = found["lane_net"].ci
    bounded = beside is not None and beside[1] < MARGIN
    return bounded or any(one.statistic not in OPEN for one in failures(found))


def besides(found: Mapping[str, Statistic], decided_by: str) -> str:
    """Return in words what is shown not to hold beside a condition whose effect is only not shown; empty if nothing is.

    More frames may show that effect, and do not take away the other.
    """
    vetoed = next((one for one in failures(found) if one.statistic not in OPEN), None)
    if decided_by not in OPEN or vetoed is None:
        return ""
    return f"besides, it brakes {vetoed.says}: {measured(vetoed.statistic, found[vetoed.statistic])}"


def blind_spots(found: Mapping[str, Statistic]) -> dict[str, tuple[Part, ...]]:
    """Return the parts of a bank in which a veto would not have seen a reversal with the power that is declared."""
    spots = {}
    for name in VETOES:
        one = found[name]
        weak = tuple(part for part in one.parts if part.power < VETO_POWER) if isinstance(one, Parts) else ()
        if weak:
            spots[name] = weak
    return spots
