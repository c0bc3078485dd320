"""The model as its own blind baseline: the same policy in the same worlds with real pictures and without.

Source: paper, sections The Input-Ablation Battery (non-visual baselines) and Discussion: completing a task does not
show that the camera was used.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from eyechart.stats.statistic import Statistic
from eyechart.studies.closed_loop.identical import same_drive
from eyechart.studies.closed_loop.ladder import LEVEL, Outcomes, Paired, corrected, paired
from eyechart.studies.closed_loop.reading import UNDECIDED, Driver, Drives, undecided_share

DIFFERS, NO_DIFFERENCE, SAME, CANNOT_SAY = "differs", "no_difference_found", "identical", "cannot_say"

_WORDS = {
    "crash_rate": "crash rate",
    "success_rate": "success rate",
    "distance_m": "distance",
    "reward": "reward",
    "speed_mps": "speed",
}
_UNITS = {"distance_m": " m", "speed_mps": " m/s"}
OUTCOMES = ("success_rate", "crash_rate", "distance_m", "reward", "speed_mps")
"""What the sentence reads, in its order."""

SILENT = 0.05
"""Above this share of steps without a decision the sentence says how often the fail-safe drove."""

UNSEEN = ("blank", "noise")
"""Conditions that show nothing of any world: who completes with these needs no picture. Others show a wrong one."""


@dataclass(frozen=True)
class Blind:
    """A policy with real pictures less the same policy under another condition, and what that shows, in words.

    ``finding`` is one of differs, no_difference_found, identical (every drive the same to the last digit), cannot_say.
    """

    driver: Driver
    condition: str
    paired: Paired
    finding: str
    sentence: str

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        return {
            **self.paired.as_dict(),
            "policy": self.driver.policy,
            "condition": self.condition,
            "finding": self.finding,
            "sentence": self.sentence,
        }


def blind_baselines(drives: Sequence[Drives], outcomes: Outcomes, *, resamples: int = 5000) -> list[Blind]:
    """Return each policy's drives with real pictures less those under each other condition.

    Holm corrects over all tests of one policy: each is asked about for itself.
    """
    found = []
    for real in drives:
        if real.driver.condition == "real":
            others = [one for one in drives if _same_policy(real.driver, one.driver) and one is not real]
            family = corrected([paired(real, one, outcomes, resamples=resamples) for one in others])
            tests = sum(p is not None for each in family for p in each.holm.values())
            found += [_said(real, one, each, outcomes, tests) for one, each in zip(others, family, strict=True)]
    return found


def _same_policy(one: Driver, other: Driver) -> bool:
    return (one.simulator, one.policy, one.run) == (other.simulator, other.policy, other.run)


def _said(real: Drives, other: Drives, found: Paired, outcomes: Outcomes, tests: int) -> Blind:
    condition = other.driver.condition
    worlds = sorted(real.by_world.keys() & other.by_world.keys())
    same = sum(same_drive(real.by_world[name], other.by_world[name]) for name in worlds)
    failed = _failed(real, other)
    finding = CANNOT_SAY if failed else _finding(found, same, tests)
    what = failed or (
        _cannot_say(found, condition, tests)
        if finding == CANNOT_SAY
        else {DIFFERS: _differs, NO_DIFFERENCE: _no_difference, SAME: _identical}[finding](found, condition)
    )
    ends = _completion(real, other, worlds, outcomes)
    sentence = " ".join(filter(None, [f"{found.first.policy}, {condition}: {what}", _silence(real, other), ends]))
    return Blind(real.driver, condition, found, finding, sentence)


def _finding(found: Paired, same: int, tests: int) -> str:
    if found.worlds and same == found.worlds:
        return SAME
    if any(name in OUTCOMES for name in found.changed):
        return DIFFERS
    return CANNOT_SAY if found.worlds < _needed(tests) else NO_DIFFERENCE


def _needed(tests: int) -> int:
    """Return how many worlds that all differ alike reach the level, by the test of signs, in a family of ``tests``.

    Of n worlds the smallest p is 2^(1 - n), which Holm multiplies by the number of tests.
    """
    return math.ceil(1 + math.log2(max(1, tests) / LEVEL))


def _differs(found: Paired, condition: str) -> str:
    changed = [name for name in OUTCOMES if name in found.changed]
    numbers = "; ".join(f"{_number(found.differences[name], name)} (Holm p {_p(found.holm[name])})" for name in changed)
    return (
        f"it drives differently with real pictures than with {condition} ones in the same {found.worlds} worlds: "
        f"{numbers}. So its driving depends on what the camera shows; for better or for worse is in the signs."
    )


def _no_difference(found: Paired, condition: str) -> str:
    bounds = "; ".join(_number(found.differences[name], name) for name in OUTCOMES)
    return (
        f"no difference from {condition} pictures was found in {found.worlds} worlds. That is not none: the data bound "
        f"it, with 95 % intervals, to {bounds}. A dependence within these bounds is not excluded."
    )


def _identical(found: Paired, condition: str) -> str:
    return (
        f"all {found.worlds} drives are the same to the last digit with {condition} pictures as with real ones. In "
        "these worlds the picture has no say in how it drives."
    )


def _cannot_say(found: Paired, condition: str, tests: int) -> str:
    return (
        f"cannot say whether {condition} pictures change how it drives: with {found.worlds} worlds no exact test can "
        f"reach .05 after Holm over {tests} tests. Drive more seeds or scenarios, {_needed(tests)} worlds at least."
    )


def _failed(real: Drives, other: Drives) -> str:
    """Return why two drives cannot be held against each other: calls failed, or the fail-safe made them alike."""
    if said := _lost(real, other):
        return f"cannot say whether the picture matters: calls failed, {' and '.join(said)}, and the fail-safe drove."
    worlds = sorted(real.by_world.keys() & other.by_world.keys())
    steps = [[step for name in worlds for step in one.by_world[name].steps] for one in (real, other)]
    decided = [[step.decision.action is not None for step in mine] for mine in steps]
    alike = bool(worlds) and all(same_drive(real.by_world[name], other.by_world[name]) for name in worlds)
    if alike and decided[0] != decided[1]:
        return (
            "cannot say whether the picture matters: the drives are the same, but not the decisions. At some steps it "
            "decides nothing under one condition alone, and the fail-safe does there what it does under the other."
        )
    if alike and undecided_share(steps[0]) >= UNDECIDED:
        return (
            "cannot say whether the picture matters: the drives are the same, but at half of the steps or more it "
            "decides nothing, so that they are the fail-safe's more than its own."
        )
    if never := [one.driver.condition for one in (real, other) if undecided_share(one.steps) == 1]:
        return (
            f"cannot say whether the picture matters to its decisions: with {' and '.join(never)} pictures it decides "
            "nothing at all, and the fail-safe drove."
        )
    return ""


def _lost(real: Drives, other: Drives) -> list[str]:
    """Return, for each condition under which too many calls failed, the share that did."""
    lost = {one.driver.condition: [step.decision.missing == "error" for step in one.steps] for one in (real, other)}
    shares = {name: sum(mine) / max(1, len(mine)) for name, mine in lost.items()}
    return [f"{share:.0%} of them with {name} pictures" for name, share in shares.items() if share > SILENT]


def _silence(real: Drives, other: Drives) -> str:
    """Return how often the fail-safe drove in the place of the policy, where it did so often."""
    shares = {one.driver.condition: undecided_share(one.steps) for one in (real, other)}
    said = [f"{share:.0%} of the steps with {name} pictures" for name, share in shares.items() if share > SILENT]
    return f"It decides nothing at {' and '.join(said)}: the fail-safe drives there." if said else ""


def _completion(real: Drives, other: Drives, worlds: Sequence[str], outcomes: Outcomes) -> str:
    """Return what completing shows and what it does not, with the counts.

    Who completes with pictures that show nothing needs none; who does so with wrong ones may still have used them.
    """
    if not worlds:
        return ""
    with_real = sum(outcomes.success(real.by_world[name]) for name in worlds)
    without = sum(outcomes.success(other.by_world[name]) for name in worlds)
    n, condition = len(worlds), other.driver.condition
    counts = f"It completes {with_real} of {n} with real pictures and {without} of {n} with {condition} ones"
    if without and condition not in UNSEEN:
        what = "completion" if without >= with_real else "what it completes either way"
        return f"{counts}: {what} does not show that it reads what the camera shows rightly."
    if without and without >= with_real:
        return f"{counts}: completing these worlds needs no picture, so that completion says nothing of the camera."
    if without:
        return f"{counts}: what it completes either way says nothing of the camera."
    if with_real:
        return f"{counts}: completion shows that the worlds can be done, and only the comparison that pictures matter."
    return f"{counts}: there is no completion to explain."


def _number(one: Statistic, name: str) -> str:
    unit = _UNITS.get(name, "")
    scale, unit = (100.0, " points") if name.endswith("_rate") else (1.0, unit)
    if one.value is None:
        return f"{_WORDS[name]} —"
    interval = "" if one.ci is None else f" [{scale * one.ci[0]:+.1f}, {scale * one.ci[1]:+.1f}]"
    return f"{_WORDS[name]} {scale * one.value:+.1f}{interval}{unit}"


def _p(p: float | None) -> str:
    return "—" if p is None else "<.001" if p < 0.001 else f"{p:.3f}".lstrip("0")
