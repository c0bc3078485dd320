"""Stopping early on known answers: what it saves, and whether it changes the verdict."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from eyechart.calibrate.known import is_false
from eyechart.calibrate.nulls import DRAWS, EVER, NULLS
from eyechart.conditions import COUNTERFACTUALS
from eyechart.spaces.discrete import DRIVING
from eyechart.spaces.space import Decision
from eyechart.stats.agreement import rate
from eyechart.stats.paired import clopper_pearson
from eyechart.studies.battery.answers import Answers
from eyechart.studies.battery.stopping import Course, layout_of

MEASURED = ("default", "unequal", "ordered", "frames_96", "frames_288")
"""The settings in which stopping early is measured."""

EQUAL, SAVED = 0.95, 0.5
"""What is wanted in the setting ``default``: verdicts as the full battery's, and calls saved of each of `SAVERS`."""

SAVERS = ("constant", "truncating", "depth", "presence")


@dataclass(frozen=True, slots=True)
class Early:
    """What stopping early made of one controller on one bank; a run that did not stop saved nothing and is equal."""

    label: str
    stopped: bool
    saved: float
    equal: bool
    lateral_equal: bool
    false: bool


def stop_early(answers: Answers, label: str, lateral: str, *, counterfactuals: bool, varied: bool, seed: int) -> Early:
    """Follow a controller's answers until they settle; ``label`` and ``lateral`` are the full battery's."""
    given: dict[tuple[str, str], Decision[str]] = {}
    asked: dict[str, list[str]] = {frame.id: [] for frame in answers.frames}
    for name, column in answers.decisions.items():
        if counterfactuals or name not in COUNTERFACTUALS:
            for frame, one in zip(answers.frames, column, strict=True):
                if one is not None:
                    given[frame.id, name] = one
                    asked[frame.id].append(name)
    by_frame = {frame: tuple(names) for frame, names in asked.items()}
    course = Course(layout_of(answers.frames, by_frame, DRIVING, seed))
    course.advance(given)
    stopped = course.stopped(len(course.counted))
    if stopped is None:
        return Early(label, False, 0.0, equal=True, lateral_equal=True, false=False)
    sideways = stopped.lateral or lateral
    found = "depth_lateral" if stopped.label == "depth" and sideways == "swaps" else stopped.label
    saved = 1 - stopped.calls / stopped.planned
    return Early(found, True, saved, found == label, sideways == lateral, is_false(found, answers.model, varied=varied))


Sums = Mapping[str, float]
"""Counts over replications: runs, stopped, equal, lateral, false; and the sum and the squares of the share saved."""

EMPTY: Sums = dict.fromkeys(("runs", "stopped", "equal", "lateral", "false", "saved", "squares"), 0)


def add(sums: Sums, one: Early) -> Sums:
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
    """Return the mean share of calls saved with its normal 95 % interval over the replications."""
    n, mean = sums["runs"], sums["saved"] / sums["runs"]
    spread = math.sqrt(max(sums["squares"] / n - mean**2, 0.0) / max(n - 1, 1))
    return mean, mean - 1.96 * spread, mean + 1.96 * spread


def misses(
    early: Mapping[str, Mapping[str, Mapping[str, Sums]]], ever: Sequence[int], replications: int, *, strict: bool
) -> list[str]:
    """Return every target of early stopping that is missed, in words; a share is held strictly where that is asked."""
    found = []
    for variant, by in early.get("default", {}).items():
        for name, sums in by.items():
            equal = rate(int(sums["equal"]), int(sums["runs"]))
            if (equal.ci or (0, 0))[1] < EQUAL or (strict and (equal.value or 0.0) < EQUAL):
                share = f"{equal.value:.3f} of {equal.n} replications"
                found.append(f"stopped early, {name} has the full battery's verdict in {share}, {variant}")
            saved, _, high = mean_saved(sums)
            if name in SAVERS and variant.startswith("with ") and (high < SAVED or (strict and saved < SAVED)):
                found.append(f"stopping early saves {saved:.3f} of the calls for {name}, wanted {SAVED}")
    for null, count in zip(NULLS, ever, strict=False):
        low, _ = clopper_pearson(count, DRAWS * replications)
        if low > EVER or (strict and count > EVER * DRAWS * replications):
            found.append(f"early stopping rejects '{null.claim}' under '{null.says}' {count} times")
    return found
