"""The claims that may settle a verdict early, and the evidence of each frame for or against them.

An e-process over frames in random order tests each claim. docs/decisions/stopping.md lists the
nulls, and why they hold for autocorrelated episodes.
"""

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from functools import cached_property

from eyechart.spaces.discrete import Discrete
from eyechart.spaces.space import Decision
from eyechart.stats.evalues import EProcess, EValue, MeanProcess, PairingProcess, SymmetryProcess
from eyechart.verdicts import ALPHA, BOUND_ALPHA, FLOOR, FORECAST_ALPHA, MARGIN, NET_ALPHA, UNPARSED_CUT

E_MOST = 1e9
"""The largest e-value in a report; it stands for certainty too."""

Symbol = str


@dataclass(frozen=True)
class FrameAnswers:
    """The decisions on one frame, by condition, as far as they have come back."""

    given: Mapping[str, Decision[str]]
    space: Discrete

    def action(self, condition: str) -> Symbol | None:
        """Return the decision, None where there is none."""
        one = self.given.get(condition)
        return None if one is None else one.action

    def symbol(self, condition: str) -> Symbol | None:
        """Return the response-level symbol, None where there is no reply."""
        one = self.given.get(condition)
        return None if one is None else one.symbol

    @cached_property
    def has_failed(self) -> bool:
        """Return whether a call ended in an error: such a frame is evidence for nothing."""
        return any(one.missing == "error" for one in self.given.values())

    def turn(self) -> tuple[Symbol, Symbol] | None:
        """Return the direction of the real and of the mirrored answer, where the real one turns."""
        real, mirrored = self.action("real"), self.symbol("mirrored")
        if not real or not mirrored or (turn := self.space.turn(real)) not in self.space.turns:
            return None
        return turn, self.space.turn(mirrored)


@dataclass
class Claim:
    """A claim with its e-process; it is settled once the e-value reaches 1/alpha, and stays so.

    ``observe`` adds one frame; ``against`` is the null in words.
    """

    name: str
    says: str
    against: str
    process: EProcess
    observe: Callable[[FrameAnswers], None]
    alpha: float = ALPHA
    frames: int = 0
    most: float = field(init=False)
    is_settled: bool = field(init=False)

    def __post_init__(self) -> None:
        self.most = self.process.log_e
        self.is_settled = self.most >= -math.log(self.alpha)

    def add(self, row: FrameAnswers) -> None:
        """Add a frame, unless the claim is settled already."""
        if self.is_settled:
            return
        self.observe(row)
        self.frames += 1
        self.most = max(self.most, self.process.log_e)
        self.is_settled = self.process.log_e >= -math.log(self.alpha)

    def statistic(self) -> EValue:
        """Return the e-value, with its anytime-valid p: 1 over the largest e-value so far."""
        value = min(math.exp(min(self.process.log_e, 50.0)), E_MOST)
        threshold = 1 / self.alpha
        return EValue(
            value,
            self.frames,
            p=min(1.0, math.exp(-min(self.most, math.log(E_MOST)))),
            method=f"e-process against: {self.against}; settled at {threshold:g}, p is anytime-valid",
            note=f"{'settled' if self.is_settled else 'open'} after {self.frames} frames: {self.says}",
            threshold=threshold,
            alpha=self.alpha,
            settled=self.is_settled,
            says=self.says,
        )


def fewest_turns(labels: int) -> int:
    """Return the fewest directional decisions whose pairing a permutation test shows at ``ALPHA``.

    With n of them, spread evenly over the labels, n! / (n_1! n_2! …) pairings are equally likely.
    """
    n = 1
    while math.factorial(n) / math.prod(math.factorial((n + i) // labels) for i in range(labels)) < 1 / ALPHA:
        n += 1
    return n


def claims(frames: int, space: Discrete, conditions: Collection[str], *, mirrored: bool) -> dict[str, Claim]:
    """Return the claims that a run of ``frames`` frames with these conditions can test, by name.

    ``mirrored`` says whether the run has mirrored pictures of turns. Raises ValueError for no
    frames.
    """
    itself, changes = "it disagrees with itself on", f"a blank picture changes less than {MARGIN} of the"
    kept = f"on less than {MARGIN} of the frames a blank picture gets another decision, rather than none"
    made = [
        *_scorability(frames),
        _bound(
            "steady", f"{itself} less than {FLOOR}", frames, _wavers, FLOOR, f"{itself} {FLOOR} of the frames or more"
        ),
        _bound("bound_blank", f"{changes} decisions more than a repeat does", frames, _excess("blank", "action")),
        _bound(
            "bound_blank_response", f"{changes} outputs more than a repeat does", frames, _excess("blank", "symbol")
        ),
        _bound("bound_blank_kept", kept, frames, _changed("blank")),
        _differs("presence", "action"),
        _differs("presence_response", "symbol"),
    ]
    bounded = {"bound_shuffled": "shuffled", "bound_recoloured": "recoloured", "bound_scene": "cross_scenario"}
    for name, condition in bounded.items():
        if condition in conditions:
            says = f"showing {condition} instead changes the decision on less than {MARGIN} of the frames more"
            made.append(_bound(name, says, frames, _excess(condition, "action")))
    for name in ALONE:
        if name in conditions:
            says = f"under {name} the decision is another one on less than {MARGIN} of the frames more"
            made.append(_bound(f"bound_{name}", says, frames, _changed(name), alpha=BOUND_ALPHA))
    if space.brake and set(NEAR_FAR) <= set(conditions):
        says = f"with the lead near it brakes harder on less than {MARGIN} of the frames more than less hard"
        made += [*_near_far(frames), _bound("bound_near_far", says, frames, _harder_near)]
    if mirrored:
        says, against = "it exchanges less than half of its turns under reflection", "it exchanges half of its turns"
        no_swaps = _mean("no_swaps", says, f"{against} or more", MeanProcess(frames, -1.0), lambda row: -_swap(row))
        made += [_few_turns(frames, space), *_swaps(frames, space), no_swaps]
    return {one.name: one for one in made}


NEAR_FAR = ("lead_near", "lead_far")
"""The pictures whose braking is compared; the first calls for more braking."""

ALONE = ("mirrored", "lead_near", "lead_far", "noise", "text_only", "lead_absent")
"""Conditions without another frame's picture; their change of decision is bounded separately."""


def _mean(
    name: str,
    says: str,
    against: str,
    process: MeanProcess,
    payoff: Callable[[FrameAnswers], float],
    *,
    failed: float = 0.0,
    alpha: float = ALPHA,
) -> Claim:
    """Return a claim about the mean payoff per frame; a frame with an error has ``failed``."""

    def observe(row: FrameAnswers) -> None:
        process.add(failed if row.has_failed else payoff(row))

    return Claim(name, says, against, process, observe, alpha)


def _scorability(frames: int) -> tuple[Claim, Claim]:
    """Return the claims that the whole run is not scorable, and that it is.

    ``cut`` is the fewest calls without a decision, with two calls per frame, at which a whole run
    is not scorable.
    """
    cut = math.floor(UNPARSED_CUT * 2 * frames + 1e-9) + 1
    most, least = (cut - 1) / (2 * frames), cut / (2 * frames)
    lost = "real and real_repeat calls hold no decision"
    more, fewer = f"more than {UNPARSED_CUT} of {{}} {lost}", f"at most {UNPARSED_CUT} of {{}} {lost}"
    whole, this = "the whole run's", "this run's"
    process, forecast = MeanProcess(frames, -most, bank=True), MeanProcess(frames, least - 1, bank=True)

    def share(row: FrameAnswers) -> float:
        return sum(row.action(name) is None for name in ("real", "real_repeat")) / 2

    return _mean(
        "unscorable", more.format(whole), fewer.format(this), process, lambda row: share(row) - most, failed=-most
    ), _mean(
        "scorable",
        fewer.format(whole),
        more.format(this),
        forecast,
        lambda row: least - share(row),
        failed=least - 1,
        alpha=FORECAST_ALPHA,
    )


def _wavers(row: FrameAnswers) -> float | None:
    """Return 1 where a repeat changes the decision, else 0; None where one is missing."""
    real, repeat = row.action("real"), row.action("real_repeat")
    return None if real is None or repeat is None else float(real != repeat)


def _changed(condition: str) -> Callable[[FrameAnswers], float | None]:
    """Return the excess of changed decisions under a condition over those of a repeat.

    A missing decision is not a changed one.
    """

    def changed(row: FrameAnswers) -> float | None:
        wavers, other = _wavers(row), row.action(condition)
        missing = wavers is None or condition not in row.given
        return None if missing else (other not in (None, row.action("real"))) - (wavers or 0.0)

    return changed


def _excess(condition: str, level: str) -> Callable[[FrameAnswers], float | None]:
    """Return the excess of changed answers under a condition over those of a repeat.

    It is None where an answer is missing.
    """

    def excess(row: FrameAnswers) -> float | None:
        read = row.action if level == "action" else row.symbol
        real, repeat, other = read("real"), read("real_repeat"), read(condition)
        if real is None or repeat is None or other is None:
            return None
        return float((row.space.distance(real, other) > 0) - (row.space.distance(real, repeat) > 0))

    return excess


def _bound(
    name: str,
    says: str,
    frames: int,
    excess: Callable[[FrameAnswers], float | None],
    margin: float = MARGIN,
    against: str = f"the mean excess is {MARGIN} or more",
    alpha: float = ALPHA,
) -> Claim:
    """Return the claim that a mean excess is below the margin; a frame without one pays 0."""

    def payoff(row: FrameAnswers) -> float:
        found = excess(row)
        return 0.0 if found is None else margin - found

    return _mean(name, says, against, MeanProcess(frames, margin - 1), payoff, alpha=alpha)


def _differs(name: str, level: str) -> Claim:
    process = SymmetryProcess()

    def observe(row: FrameAnswers) -> None:
        real, blank = (getattr(row, level)(condition) for condition in ("real", "blank"))
        if real is not None and blank is not None and not row.has_failed:
            process.add(real, blank)

    what = "decisions" if level == "action" else "outputs"
    against = "within every frame the answers to real and to blank are exchangeable"
    return Claim(name, f"real and blank get other {what}", against, process, observe)


def _harder_near(row: FrameAnswers) -> int | None:
    """Return 1 where it brakes harder with the lead near than far, -1 less hard, 0 equally."""
    near, far = (row.action(name) for name in NEAR_FAR)
    if near is None or far is None:
        return None
    difference = (row.space.project(near, "brake") or 0) - (row.space.project(far, "brake") or 0)
    return (difference > 0) - (difference < 0)


def _near_far(frames: int) -> tuple[Claim, Claim]:
    """Return the claims that it brakes harder with the lead near: at all, and beyond the margin."""

    def payoff(row: FrameAnswers) -> float:
        return float(_harder_near(row) or 0)

    def beyond(row: FrameAnswers) -> float:
        found = _harder_near(row)
        return 0.0 if found is None else found - MARGIN

    says = "it brakes harder with the lead near than with the lead far"
    against = "within every frame, or on average over the bank, it brakes no harder with the lead near"
    any_effect = _mean("near_far", says, against, MeanProcess(frames, -1.0), payoff)
    says = f"it does so on more than {MARGIN} of the frames, less those where less hard"
    against = f"it does so on {MARGIN} of the frames or less, less those where less hard"
    process = MeanProcess(frames, -1.0 - MARGIN)
    return any_effect, _mean("net_near_far", says, against, process, beyond, alpha=NET_ALPHA)


def _swap(row: FrameAnswers) -> float:
    """Return 1 where a turn swaps under reflection, -1 where it does not, 0 without a turn."""
    turn = row.turn()
    return 0.0 if turn is None else 1.0 if row.space.opposite(turn[0]) == turn[1] else -1.0


def _swaps(frames: int, space: Discrete) -> tuple[Claim, Claim]:
    pairing = PairingProcess(len(space.turns))

    def observe(row: FrameAnswers) -> None:
        turn = row.turn()
        if turn is not None and turn[1] in space.turns and not row.has_failed:
            pairing.add(space.opposite(turn[0]), turn[1])

    says = "it exchanges more than half of its turns under reflection"
    rate = _mean("swaps_rate", says, "it exchanges half of its turns or fewer", MeanProcess(frames, -1.0), _swap)
    says = "which way it turns in the mirror depends on which way it turned"
    against = "which way it turns in the mirror does not depend on which way it turned"
    return rate, Claim("swaps_pairing", says, against, pairing, observe)


def _few_turns(frames: int, space: Discrete) -> Claim:
    need = fewest_turns(len(space.turns))
    least = need / frames
    says = f"the whole run would hold fewer than {need} turns, too few to show exchange"
    process, against = MeanProcess(frames, least - 1, bank=True), f"this run holds {need} turns or more"

    def payoff(row: FrameAnswers) -> float:
        return least - (row.turn() is not None)

    return _mean("few_turns", says, against, process, payoff, failed=least - 1, alpha=FORECAST_ALPHA)
