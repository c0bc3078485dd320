"""The conditions that depth needs beside its first: which of them fail, and which could not be tested.

Number 38 of docs/decisions says why they are these, and what still fools them.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from eyechart.stats.paired import Part, Parts
from eyechart.stats.resampling import holm
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

ORDER = {
    "dose_lost": "less hard the nearer on more frames than its noise explains",
    "dose_by_frame": "the wrong way round on some of the frames, each time",
    "twice_lost": "the wrong way round at one end, in both pictures of it",
    "dose_scan": "less hard the nearer somewhere between",
}
"""What each test of the order means where it rejects; of all but the last also more frames than `BOTH_LOST`."""

LOST = {
    "near_far_lost": "harder for the far lead on more frames than its noise explains",
    "lane_lost": "harder for the neighbour on more frames than its noise explains",
    "both_lost": "the wrong way round on a share of the frames of their own",
    "ends_lost": "least for the nearer and hardest for the farther in more pairs than noise in each picture explains",
    "any_lost": "the wrong way round in one comparison or another on too many frames together",
}
"""What each share of pairs that are lost means where it is too large."""


@dataclass(frozen=True, slots=True)
class Failure:
    """A condition of depth that was tested and does not hold: its statistic, what that means, and what it needs."""

    statistic: str
    says: str
    needs: str
    p: float | None = None


@dataclass(frozen=True, slots=True)
class Lacking:
    """A condition of depth that cannot be tested: its statistic, the pictures that are not answered, and why."""

    statistic: str
    conditions: tuple[str, ...]
    says: str


def below(p: float | None, alpha: float = ALPHA) -> bool:
    """Return whether a test was made and rejects."""
    return p is not None and p < alpha


def reaches(net: Statistic) -> bool:
    """Return whether the lower bound of a net effect reaches the margin."""
    return net.ci is not None and net.ci[0] >= MARGIN


def failures(found: Mapping[str, Statistic]) -> Iterator[Failure]:
    """Yield the conditions (2) to (6) of depth that were tested and fail, in their order."""
    yield from _too_little(found, "depth_net", "on too few frames to matter")
    exchange = found["lane_exchange"]
    if exchange.p is not None and not below(exchange.p):
        says = "a vehicle of a neighbouring lane does as well: it may brake for any vehicle, wherever it stands"
        yield Failure("lane_exchange", says, f"p below {ALPHA}")
    yield from _too_little(found, "lane_net", "for the lead rather than a neighbour on too few frames to matter")
    for name, p in zip(STEPS, holm([found[name].p for name in STEPS]), strict=True):
        if p is not None and p < DOSE_ALPHA:
            says = "less hard at one of the distances between than at a farther one"
            yield Failure(name, says, f"p of a reversal, corrected, of {DOSE_ALPHA} at least", p)
    for name, alpha in VETOES.items():
        if below(found[name].p, alpha):
            where = "in part of the range" if name == "dose_bins" else "in one of its scenarios"
            says = f"less hard the nearer {where} ({found[name].note})"
            yield Failure(name, says, f"p of a reversal, corrected, of {alpha} at least")
    yield from _lost(found)
    for name, says in ORDER.items():
        one = found[name]
        enough = name == "dose_scan" or (one.value is not None and one.value > BOTH_LOST)
        if enough and below(one.p, DOSE_ALPHA):
            yield Failure(name, f"{says} ({one.note})", f"p of {DOSE_ALPHA} at least")


def _lost(found: Mapping[str, Statistic]) -> Iterator[Failure]:
    """Yield what is lost on too many frames: of any comparison also beyond what few frames leave open."""
    for name, says in LOST.items():
        lost, most = found[name].value, {"ends_lost": ENDS_LOST, "any_lost": ANY_LOST}.get(name, BOTH_LOST)
        bound = found[name].ci if name == "any_lost" else None
        if lost is not None and lost > most and (bound is None or bound[0] > 0):
            yield Failure(name, says, f"at most {most}")


def _too_little(found: Mapping[str, Statistic], name: str, says: str) -> Iterator[Failure]:
    if found[name].ci is not None and not reaches(found[name]):
        yield Failure(name, says, f"lower bound of {MARGIN} at least")


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


def lacking(found: Mapping[str, Statistic]) -> Iterator[Lacking]:
    """Yield what keeps the conditions of depth from being tested, in the order in which they are asked."""
    if found["lane_exchange"].p is None:
        yield Lacking("lane_exchange", EXCHANGE, "whether it brakes for the lead or for whoever is near was not tested")
    for name in STEPS:
        if found[name].p is None:
            yield Lacking(name, DOSE, "whether its braking falls with distance all the way was not tested")
            break
    if found["repeat_over_nudged"].p is None:
        yield Lacking("repeat_over_nudged", (NUDGED,), "whether it follows the file was not tested")
    declined = found["unparsed_controls"]
    if declined.ci is not None and declined.ci[0] > UNPARSED_CUT:
        says = f"more than {UNPARSED_CUT} of its replies to edited pictures hold no decision ({declined.note})"
        yield Lacking("unparsed_controls", (), says)


def blind_spots(found: Mapping[str, Statistic]) -> dict[str, tuple[Part, ...]]:
    """Return the parts of a bank in which a veto would not have seen a reversal with the power that is declared."""
    spots = {}
    for name in VETOES:
        one = found[name]
        weak = tuple(part for part in one.parts if part.power < VETO_POWER) if isinstance(one, Parts) else ()
        if weak:
            spots[name] = weak
    return spots
