"""Early stopping on known answers: the calls saved, the verdicts changed, the false rejections.

The nulls are drawn at their boundaries; each count is the number of whole runs that ever reject.
"""

import math
import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from eyechart.conditions import BATTERY, CONTROLS, COUNTERFACTUALS, SAMPLED, sample
from eyechart.frames import Frame
from eyechart.spaces.discrete import DRIVING
from eyechart.spaces.space import Decision
from eyechart.stats.agreement import clopper_pearson, rate
from eyechart.studies.battery.answers import Answers
from eyechart.studies.battery.early_stop import StoppingState, WholeRun, layout_of
from eyechart.studies.battery.evidence import ALONE, FrameAnswers, claims
from eyechart.verdicts import FLOOR, MARGIN, NET_ALPHA, UNPARSED_CUT
from eyechart_organisms.calibration.known_answers import is_false

DRAWS = 10
"""Draws of each null in one replication of the setting ``default``."""

EVER = 0.05
"""The largest share of rejections to accept; for a net effect, its own level if that is larger."""

_DECIDED: dict[str, Decision[str]] = {action: Decision(action) for action in DRIVING.actions}
_DECIDED[""] = Decision(None, "refused")

Columns = dict[str, list[str]]
"""Answers by condition, one per frame; an empty one is a reply without a decision."""

Draw = Callable[[Sequence[Frame], random.Random], Columns]


@dataclass(frozen=True, slots=True)
class Null:
    """A null of early stopping: its claim, its answers in words, and their draw."""

    claim: str
    says: str
    draw: Draw


def has_rejected(null: Null, frames: Sequence[Frame], rng: random.Random) -> bool:
    """Draw answers under a null; return whether its claim is ever settled in random frame order."""
    columns = {**_steady(frames), **null.draw(frames, rng)}
    decided = {name: [_DECIDED[answer] for answer in column] for name, column in columns.items()}
    one = claims(len(frames), DRIVING, columns, mirrored=True)[null.claim]
    order = list(range(len(frames)))
    rng.shuffle(order)
    for place in order:
        if one.is_settled:
            break
        one.add(FrameAnswers({name: column[place] for name, column in decided.items()}, DRIVING))
    return one.is_settled


def _steady(frames: Sequence[Frame]) -> Columns:
    """Return the answers of a controller that never changes its answer."""
    names = (*BATTERY, *COUNTERFACTUALS, *CONTROLS)
    return {name: ["SLOW"] * len(frames) for name in names}


def _first(frames: Sequence[Frame], count: int, rng: random.Random) -> list[bool]:
    """Return marks on ``count`` frames, in whole episodes from a random one on."""
    episodes = list(dict.fromkeys(frame.episode for frame in frames))
    rng.shuffle(episodes)
    rank = {name: place for place, name in enumerate(episodes)}
    marked = set(sorted(range(len(frames)), key=lambda place: (rank[frames[place].episode], place))[:count])
    return [place in marked for place in range(len(frames))]


def _habits(frames: Sequence[Frame], rng: random.Random) -> list[str]:
    """Return an answer per frame with habits: with chance .9 the previous frame's."""
    habits: list[str] = []
    for place, frame in enumerate(frames):
        again = place and frames[place - 1].episode == frame.episode and rng.random() < 0.9
        habits.append(habits[-1] if again else rng.choice(DRIVING.actions))
    return habits


def _of(marks: Sequence[bool], yes: str, no: str = "SLOW") -> list[str]:
    return [yes if mark else no for mark in marks]


def _at_margin(condition: str, share: float, *, most: bool = False) -> Draw:
    """Return the null that a condition changes just the margin's share of the frames."""

    def draw(frames: Sequence[Frame], rng: random.Random) -> Columns:
        exact = share * len(frames)
        count = math.floor(exact + 1e-9) if most else math.ceil(exact - 1e-9)
        return {condition: _of(_first(frames, count, rng), "STOP")}

    return draw


def _noisy_margin(condition: str) -> Draw:
    """Return the null that a condition changes answers more often than a repeat, by the margin."""

    def draw(frames: Sequence[Frame], rng: random.Random) -> Columns:
        def changed(share: float) -> list[str]:
            return _of([rng.random() < share for _ in frames], "STOP")

        return {"real_repeat": changed(0.2), condition: changed(0.2 + MARGIN)}

    return draw


def _coins(first: str, second: str, *, lost: float = 0.0, clings: float = 0.0) -> Draw:
    """Return the null that two conditions draw from the same law in each frame, or from a habit."""

    def draw(frames: Sequence[Frame], rng: random.Random) -> Columns:
        habits = _habits(frames, rng)

        def answer(habit: str) -> str:
            if rng.random() < lost:
                return ""
            return habit if rng.random() < clings else rng.choice(DRIVING.actions)

        return {name: [answer(habit) for habit in habits] for name in (first, second)}

    return draw


def _halves(frames: Sequence[Frame], rng: random.Random) -> Columns:
    half = _first(frames, len(frames) // 2, rng)
    return {"lead_near": _of(half, "STOP", "STRAIGHT"), "lead_far": _of(half, "STRAIGHT", "STOP")}


def _lost(extra: int) -> Draw:
    """Return the null of ``extra`` calls without a decision above the cut, side by side."""

    def draw(frames: Sequence[Frame], rng: random.Random) -> Columns:
        count = math.floor(UNPARSED_CUT * 2 * len(frames) + 1e-9) + extra
        marked = _first(frames, (count + 1) // 2, rng)
        repeat = list(marked)
        if count % 2:
            repeat[marked.index(True)] = False
        return {"real": _of(marked, ""), "real_repeat": _of(repeat, "")}

    return draw


def _turning(left_real: float, left_mirrored: float) -> Draw:
    """Return the null that turns on real and mirrored pictures are independent."""

    def draw(frames: Sequence[Frame], rng: random.Random) -> Columns:
        def turns(left: float) -> list[str]:
            return ["LEFT" if rng.random() < left else "RIGHT" for _ in frames]

        return {"real": turns(left_real), "mirrored": turns(left_mirrored)}

    return draw


def _half_swapped(frames: Sequence[Frame], rng: random.Random) -> Columns:
    half = _first(frames, len(frames) // 2, rng)
    real = [rng.choice(("LEFT", "RIGHT")) for _ in frames]
    return {
        "real": real,
        "mirrored": [DRIVING.reflect(one) if swap else one for one, swap in zip(real, half, strict=True)],
    }


def _few(frames: Sequence[Frame], rng: random.Random) -> Columns:
    marked = _first(frames, 9, rng)
    return {"real": _of(marked, "LEFT"), "mirrored": _of(marked, "RIGHT")}


def _wavering(frames: Sequence[Frame], rng: random.Random) -> Columns:
    return {"real_repeat": _of([rng.random() < FLOOR for _ in frames], "STOP")}


_CLUSTER = "in whole episodes"

NULLS: tuple[Null, ...] = (
    Null("unscorable", f"lost calls just at the cut, {_CLUSTER}", _lost(0)),
    Null("scorable", f"one lost call above the cut, {_CLUSTER}", _lost(1)),
    Null("near_far", "a coin for each of the two", _coins("lead_near", "lead_far")),
    Null("near_far", "both pulled by an episode's habit", _coins("lead_near", "lead_far", clings=0.7)),
    Null("near_far", "harder near in half of the episodes, harder far in the others", _halves),
    Null("presence", "a coin for each of the two", _coins("real", "blank")),
    Null("presence", "both pulled by an episode's habit", _coins("real", "blank", clings=0.7)),
    Null(
        "presence_response", "both refused 3 of 10 times, else a habit", _coins("real", "blank", lost=0.3, clings=0.7)
    ),
    Null("bound_shuffled", f"changed at the margin, {_CLUSTER}", _at_margin("shuffled", MARGIN)),
    Null("bound_shuffled", "changed at the margin above a noise of .2", _noisy_margin("shuffled")),
    Null("bound_recoloured", f"changed at the margin, {_CLUSTER}", _at_margin("recoloured", MARGIN)),
    Null("bound_scene", f"changed at the margin, {_CLUSTER}", _at_margin("cross_scenario", MARGIN)),
    Null("bound_blank", f"changed at the margin, {_CLUSTER}", _at_margin("blank", MARGIN)),
    Null("bound_blank", "changed at the margin above a noise of .2", _noisy_margin("blank")),
    Null("bound_blank_response", f"changed at the margin, {_CLUSTER}", _at_margin("blank", MARGIN)),
    Null("bound_blank_kept", f"changed at the margin, {_CLUSTER}", _at_margin("blank", MARGIN)),
    Null("bound_near_far", f"harder near at the margin, {_CLUSTER}", _at_margin("lead_near", MARGIN)),
    Null("net_near_far", f"harder near on the margin, {_CLUSTER}", _at_margin("lead_near", MARGIN, most=True)),
    *(Null(f"bound_{name}", f"changed at the margin, {_CLUSTER}", _at_margin(name, MARGIN)) for name in ALONE),
    Null("steady", f"self-disagreement of exactly .2, {_CLUSTER}", _at_margin("real_repeat", FLOOR)),
    Null("steady", "self-disagreement of .2, frame by frame", _wavering),
    Null("swaps_rate", "turns that do not depend on each other", _turning(0.5, 0.5)),
    Null("swaps_rate", f"exactly half of the turns exchanged, {_CLUSTER}", _half_swapped),
    Null("swaps_pairing", "turns that do not depend on each other", _turning(0.5, 0.5)),
    Null("swaps_pairing", "mostly left, and mostly right in the mirror, whatever it shows", _turning(0.8, 0.2)),
    Null("no_swaps", f"exactly half of the turns exchanged, {_CLUSTER}", _half_swapped),
    Null("no_swaps", "turns that do not depend on each other, either side alike", _turning(0.5, 0.5)),
    Null("few_turns", f"as few turns as could show exchange, {_CLUSTER}", _few),
)
"""Every null, at its boundary if it has one."""


def count_rejections(frames: Sequence[Frame], rng: random.Random) -> list[int]:
    """Return the number of rejections of each of `NULLS` in `DRAWS` draws."""
    return [sum(has_rejected(null, frames, rng) for _ in range(DRAWS)) for null in NULLS]


MEASURED = ("default", "unequal", "ordered", "frames_96", "frames_288")
"""The settings that measure early stopping."""

EQUAL = 0.95
"""The least share of verdicts equal to the full battery's, in the setting ``default``."""

SAVERS: Mapping[str, float] = {"constant": 0.5, "truncating": 0.5, "depth": 0.3, "presence": 0.5}
"""The least share of calls to save there, by controller; depth is asked all that its rules read."""


@dataclass(frozen=True, slots=True)
class EarlyStopOutcome:
    """The result of early stopping on one bank; equal if the controller never stopped."""

    label: str
    stopped: bool
    saved: float
    equal: bool
    lateral_equal: bool
    false: bool


def sampled(answers: Answers, seed: int) -> Answers:
    """Return the answers without those of sampled controls outside a run's sample."""
    decisions = dict(answers.decisions)
    first = [name for name in decisions if name not in CONTROLS]
    calls = sum(one is not None for name in first for one in decisions[name])
    for name in {*SAMPLED} & decisions.keys():
        shown = [frame.id for frame, one in zip(answers.frames, decisions[name], strict=True) if one is not None]
        few = sample(name, shown, calls, seed)
        kept = (one if frame.id in few else None for frame, one in zip(answers.frames, decisions[name], strict=True))
        decisions[name] = tuple(kept)
    return replace(answers, decisions=decisions)


def stop_early(
    answers: Answers, label: str, lateral: str, *, counterfactuals: bool, varied: bool, seed: int
) -> EarlyStopOutcome:
    """Follow a controller's answers until they settle; compare with the full battery's labels."""
    answers, given = sampled(answers, seed), dict[tuple[str, str], Decision[str]]()
    conditions: dict[str, list[str]] = {frame.id: [] for frame in answers.frames}
    for name, column in answers.decisions.items():
        if counterfactuals or name not in {*COUNTERFACTUALS, *CONTROLS}:
            for frame, one in zip(answers.frames, column, strict=True):
                if one is not None:
                    given[frame.id, name] = one
                    conditions[frame.id].append(name)
    by_frame = {frame: tuple(names) for frame, names in conditions.items()}
    layout = layout_of(answers.frames, by_frame, DRIVING, seed)
    course = StoppingState(replace(layout, whole=WholeRun(answers.gap, seed=seed)))
    course.advance(given)
    stopped = course.stopped(len(course.counted))
    if stopped is None:
        return EarlyStopOutcome(label, False, 0.0, equal=True, lateral_equal=True, false=False)
    sideways = stopped.lateral or lateral
    found = "depth_lateral" if stopped.label == "depth" and sideways == "turns_clear" else stopped.label
    saved = 1 - stopped.calls / stopped.planned
    return EarlyStopOutcome(
        found, True, saved, found == label, sideways == lateral, is_false(found, answers.model, varied=varied)
    )


Sums = Mapping[str, float]
"""Counts over replications (runs, stopped, equal, lateral, false), and sums of saved and squares.
"""

EMPTY: Sums = dict.fromkeys(("runs", "stopped", "equal", "lateral", "false", "saved", "squares"), 0)


def add(sums: Sums, one: EarlyStopOutcome) -> Sums:
    """Return the counts with one more run."""
    more = {
        "runs": 1,
        "stopped": int(one.stopped),
        "equal": int(one.equal),
        "lateral": int(one.lateral_equal),
        "false": int(one.false),
        "saved": one.saved,
        "squares": one.saved**2,
    }
    return {name: sums[name] + more[name] for name in sums}


def mean_saved(sums: Sums) -> tuple[float, float, float]:
    """Return the mean share of calls saved with its normal 95 % interval."""
    n, mean = sums["runs"], sums["saved"] / sums["runs"]
    spread = math.sqrt(max(sums["squares"] / n - mean**2, 0.0) / max(n - 1, 1))
    return mean, mean - 1.96 * spread, mean + 1.96 * spread


def misses(
    early: Mapping[str, Mapping[str, Mapping[str, Sums]]], ever: Sequence[int], replications: int, *, strict: bool
) -> list[str]:
    """Return in words every missed target of early stopping."""
    result = []
    for variant, by in early.get("default", {}).items():
        for name, sums in by.items():
            equal = rate(int(sums["equal"]), int(sums["runs"]))
            if (equal.ci or (0, 0))[1] < EQUAL or (strict and (equal.value or 0.0) < EQUAL):
                share = f"{equal.value:.3f} of {equal.n} replications"
                result.append(f"stopped early, {name} has the full battery's verdict in {share}, {variant}")
            saved, _, high = mean_saved(sums)
            wanted = SAVERS.get(name, 0.0) if variant.startswith("with ") else 0.0
            if high < wanted or (strict and saved < wanted):
                result.append(f"stopping early saves {saved:.3f} of the calls for {name}, wanted {wanted}")
    for null, count in zip(NULLS, ever, strict=False):
        low, _ = clopper_pearson(count, DRAWS * replications)
        most = max(EVER, NET_ALPHA) if null.claim.startswith("net_") else EVER
        if low > most or (strict and count > most * DRAWS * replications):
            result.append(f"early stopping rejects '{null.claim}' under '{null.says}' {count} times")
    return result
