"""The model as its own blind baseline: one policy in the same worlds with and without pictures.

Source: paper, sections The Input-Ablation Battery (non-visual baselines) and Discussion and
Conclusion: completing a task does not show that the camera was used. A blank picture only tests
whether there is a picture. Another world's picture tests whether the content matters.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter

from eyechart.conditions import CONDITIONS, OVER
from eyechart.episodes import Step
from eyechart.records import to_json_fields
from eyechart.stats.statistic import Statistic
from eyechart.studies.closed_loop.drives import UNDECIDED, Driver, Drives, undecided_share
from eyechart.studies.closed_loop.identical_drives import is_same_drive
from eyechart.studies.closed_loop.ladder import LEVEL, PairedDifference, SuccessCriteria, corrected, paired
from eyechart.verdicts.labels import SIGHT, Label
from eyechart.verdicts.rules import Axis, Rule, compared, fact, p_below
from eyechart.verdicts.ruling import Ruling

DIFFERS, NO_DIFFERENCE, SAME, CANNOT_SAY = "differs", "no_difference_found", "identical", "cannot_say"
_FINDING = {"by_camera": DIFFERS, "in_part": DIFFERS, "unsteady": DIFFERS, "by_nothing_seen": SAME}
"""The finding of a label, where it has another name."""

_WORDS = {
    "crash_rate": "crash rate",
    "success_rate": "success rate",
    "distance_m": "distance",
    "reward": "reward",
    "speed_mps": "speed",
}
_UNITS = {"distance_m": " m", "speed_mps": " m/s"}
OUTCOMES = ("success_rate", "crash_rate", "distance_m", "reward", "speed_mps")
"""The outcomes that the sentence reads, in order."""

SILENT = 0.05
"""Above this share of steps without a decision, the sentence says how often the fail-safe drove."""

UNSEEN = ("blank", "text_only", "noise")
"""Conditions that show nothing of any world; completing under them needs no picture."""

CAMERA, REPEAT = "what the camera shows", "whether it repeats itself"
MARGINAL, MOMENT = "own marginal", "whether it matters when it does what"
ASKS = {
    "blank": "whether there is a picture",
    "text_only": "whether there is a picture",
    "noise": "whether its picture shows anything",
    "shuffled": CAMERA,
    "frozen": "whether its picture is of now",
    "mirrored": "which way round its picture is",
    "real_repeat": REPEAT,
    MARGINAL: MOMENT,
}
"""What a difference from real pictures tests, by condition.

Only another world's picture, as good as its own, tests what the camera shows.
"""


_ALIKE, _DIFFERS = compared("alike", "value", ">=", 1.0, untested=False), p_below("difference", LEVEL)
DRIVES = Axis(
    "drives",
    (
        Rule("cannot_say", "failed", (compared("failed", "value", ">", 0.0),)),
        Rule("by_nothing_seen", "alike", (_ALIKE, compared("shows_nothing", "value", ">", 0.0))),
        Rule("identical", "alike", (_ALIKE,)),
        Rule("by_camera", "difference", (_DIFFERS, compared("of_camera", "value", ">", 0.0))),
        Rule("unsteady", "difference", (_DIFFERS, compared("of_itself", "value", ">", 0.0))),
        Rule("in_part", "difference", (_DIFFERS,)),
        Rule("cannot_say", "worlds_to_spare", (compared("worlds_to_spare", "value", "<", 0.0),)),
        Rule("no_difference_found", "difference"),
    ),
)
"""The labels of a driver; ``difference`` is the outcome with the smallest p after Holm."""


@dataclass(frozen=True)
class BlindBaseline:
    """A policy with real pictures less the same policy under another condition, with the finding.

    ``unasked`` says what drives are missing; ``rest`` describes missing decisions and completion.
    """

    driver: Driver
    condition: str
    paired: PairedDifference
    ruling: Ruling
    shows: str = ""
    unasked: str = ""
    rest: str = ""

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        own = to_json_fields(self, "condition asks finding sentence")
        return {**self.paired.as_dict(), "policy": self.driver.policy, **own}

    @property
    def sentence(self) -> str:
        """Return the comparison in words, after the driver and the pictures."""
        who = f"{self.driver.policy}, {self.condition}: " if self.is_of_pictures else ""
        return who + " ".join(filter(None, [self.shows, self.unasked, self.rest]))

    @property
    def label(self) -> Label:
        """Return the label of the driver."""
        return SIGHT[self.ruling.label]

    @property
    def finding(self) -> str:
        """Return differs, no_difference_found, identical (to the last digit) or cannot_say."""
        return _FINDING.get(self.ruling.label, self.ruling.label)

    @property
    def decisive(self) -> str:
        """Return the outcome with the smallest p after Holm if it differs; else the reward."""
        first = self.ruling.decided_by if self.finding == DIFFERS else "reward"
        differences = self.paired.differences
        return next((name for name in (first, *OUTCOMES) if differences[name].value is not None), "reward")

    @property
    def asks(self) -> str:
        """Return in words what this comparison tests."""
        return asks(self.condition)

    @property
    def is_of_camera(self) -> bool:
        """Return whether it tests what the camera shows, with pictures of another world."""
        return self.asks == CAMERA

    @property
    def is_of_pictures(self) -> bool:
        """Return whether it tests pictures; the own marginal is another driver, so it does not."""
        return self.asks != MOMENT


def beside_marginals(
    drives: Sequence[Drives], outcomes: SuccessCriteria, *, resamples: int = 5000
) -> list[BlindBaseline]:
    """Return each driver against its own marginal, which draws its decisions without looking.

    The marginal must have driven in the same run. Holm corrects over the tests of one driver.
    Source: paper, section The Input-Ablation Battery.
    """
    result, place = [], attrgetter("simulator", "run", "condition")
    for drawn in drives:
        real = [
            drive
            for drive in drives
            if drawn.marginal_of == drive.driver.policy and place(drive.driver) == place(drawn.driver)
        ]
        for one in real:
            each = corrected([paired(one, drawn, outcomes, resamples=resamples)])[0]
            tests = sum(p is not None for p in each.holm.values())
            baseline = BlindBaseline(one.driver, MARGINAL, each, _ruling(one, drawn, each, MARGINAL, tests))
            shows = f"{each.first.policy} beside its own marginal: {_beside(baseline.finding, each, tests)}"
            result.append(replace(baseline, shows=shows))
    return result


def _beside(finding: str, found: PairedDifference, tests: int) -> str:
    """Return in words a driver's comparison with draws of its actions at equal frequency."""
    if finding == DIFFERS:
        return (
            f"it drives differently than draws of its own actions at equal frequency, in the same {found.worlds} "
            f"worlds: {_changes(found)}. So the timing of its actions matters; drives with other pictures show why."
        )
    if finding == SAME:
        return (
            f"all {found.worlds} drives are the same to the last digit as those of draws of its own actions at equal "
            "frequency: nothing in them needs a picture."
        )
    if finding == NO_DIFFERENCE:
        return (
            f"no difference from draws of its own actions at equal frequency was found in {found.worlds} worlds. "
            f"There may still be one: {_bounds(found)}."
        )
    return _too_few(found, tests, "whether it drives differently than draws of its own actions at equal frequency")


def blind_baselines(
    drives: Sequence[Drives], outcomes: SuccessCriteria, *, resamples: int = 5000
) -> list[BlindBaseline]:
    """Return each policy's drives with real pictures less those under each other condition.

    Holm corrects over all tests of one policy, because each policy is its own question.
    """
    result, whose = [], attrgetter("simulator", "policy", "run")
    for real in drives:
        if real.driver.condition == "real":
            others = [drive for drive in drives if whose(drive.driver) == whose(real.driver) and drive is not real]
            family = corrected([paired(real, drive, outcomes, resamples=resamples) for drive in others])
            tests = sum(p is not None for each in family for p in each.holm.values())
            shown = any(asks(drive.driver.condition) == CAMERA for drive in others)
            result += [
                _said(real, drive, each, outcomes, tests, shown=shown)
                for drive, each in zip(others, family, strict=True)
            ]
    return result


def asks(condition: str) -> str:
    """Return in words what a comparison of real pictures with a condition's tests."""
    name = condition.partition(OVER)[0]
    return ASKS.get(name) or CONDITIONS[name].asks.removesuffix("?")


def _is_unseen(condition: str) -> bool:
    return condition.partition(OVER)[0] in UNSEEN


def _said(
    real: Drives, other: Drives, difference: PairedDifference, outcomes: SuccessCriteria, tests: int, *, shown: bool
) -> BlindBaseline:
    """Return a comparison in words; ``shown`` says that other worlds' pictures were driven too."""
    condition, failed = other.driver.condition, _failed(real, other)
    baseline = BlindBaseline(
        real.driver, condition, difference, _ruling(real, other, difference, condition, tests, failed=bool(failed))
    )
    unasked = baseline.finding == DIFFERS and not shown and baseline.asks != REPEAT
    ends = "" if baseline.asks == REPEAT else _completion(real, other, outcomes)
    silent = _often(real, other, "the steps", undecided_share)
    silence = f"It decides nothing at {silent}: the fail-safe drives there." if silent else ""
    return replace(
        baseline,
        shows=failed or _shows(baseline.finding, difference, condition, tests),
        unasked=_UNASKED if unasked else "",
        rest=" ".join(filter(None, [silence, ends])),
    )


_UNASKED = f"Whether it depends on {CAMERA} was not tested: drive it with other worlds' pictures (shuffled) too."


def _ruling(
    real: Drives, other: Drives, difference: PairedDifference, condition: str, tests: int, *, failed: bool = False
) -> Ruling:
    """Return the ruling on a driver under a condition, from drives in the same worlds."""
    same = sum(
        is_same_drive(real.by_world[name], other.by_world[name]) for name in real.by_world.keys() & other.by_world
    )
    name, what = (
        min(OUTCOMES, key=lambda outcome: 2.0 if (p := difference.holm.get(outcome)) is None else p),
        asks(condition),
    )
    known = {
        "alike": Statistic(same / difference.worlds if difference.worlds else None, difference.worlds),
        "difference": replace(difference.differences[name], p=difference.holm.get(name)),
        "worlds_to_spare": Statistic(float(difference.worlds - _needed(tests)), difference.worlds),
        **fact("failed", holds=failed),
        **fact("of_camera", holds=what == CAMERA),
        **fact("of_itself", holds=what == REPEAT),
        **fact("shows_nothing", holds=what in {CAMERA, MOMENT} or _is_unseen(condition)),
    }
    ruling = DRIVES.evaluate(known)
    return replace(ruling, decided_by=name) if ruling.decided_by == "difference" else ruling


def _needed(tests: int) -> int:
    """Return how many worlds a sign test needs to reach the level, in a family of ``tests``.

    With n worlds that all differ the same way the smallest p is 2^(1 - n), which Holm multiplies by
    the number of tests.
    """
    return math.ceil(1 + math.log2(max(1, tests) / LEVEL))


def _shows(finding: str, found: PairedDifference, condition: str, tests: int) -> str:
    """Return in words what a finding says on the use of pictures, and its evidence."""
    if finding == DIFFERS:
        return (
            f"it drives differently with real pictures than with {condition} ones in the same {found.worlds} worlds: "
            f"{_changes(found)}. {_dependence(condition)}"
        )
    if finding == NO_DIFFERENCE:
        return (
            f"no difference from {condition} pictures was found in {found.worlds} worlds. There may still be one: "
            f"{_bounds(found)}. A dependence within these bounds is not excluded."
        )
    if finding == SAME:
        return (
            f"all {found.worlds} drives are the same to the last digit with {condition} pictures as with real ones. "
            f"{_independence(condition)}"
        )
    return _too_few(found, tests, f"whether {condition} pictures change how it drives")


def _changes(difference: PairedDifference) -> str:
    """Return what differs after Holm, each number with its interval and p."""
    changed = [
        (name, difference.differences[name], difference.holm[name]) for name in OUTCOMES if name in difference.changed
    ]
    return "; ".join(f"{_number(one, name)} (Holm p {_p(p)})" for name, one, p in changed)


def _bounds(difference: PairedDifference) -> str:
    bounded = [name for name in OUTCOMES if difference.differences[name].ci is not None]
    said = "; ".join(_number(difference.differences[name], name) for name in bounded)
    free = "; ".join(_number(difference.differences[name], name) for name in OUTCOMES if name not in bounded)
    return f"the data bound it, with 95 % intervals, to {said}" + (f" (without a bound: {free})" if free else "")


def bounds(found: PairedDifference, name: str) -> str:
    """Return the difference in one outcome with its interval, in words."""
    return _number(found.differences[name], name)


def _too_few(found: PairedDifference, tests: int, what: str) -> str:
    return (
        f"cannot say {what}: with {found.worlds} worlds no exact test can reach .05 after Holm over {tests} tests. "
        f"Drive more seeds or scenarios, {_needed(tests)} worlds at least."
    )


def _dependence(condition: str) -> str:
    if asks(condition) == REPEAT:
        return (
            "It had the same pictures both times: it does not repeat itself, so other differences are no sign of sight."
        )
    return f"So its driving depends on {asks(condition)}; the signs say whether for better or for worse."


def _independence(condition: str) -> str:
    if asks(condition) == REPEAT:
        return "It had the same pictures both times, and repeats itself."
    what = "the picture" if _is_unseen(condition) else asks(condition)
    return f"In these worlds {what} has no influence on how it drives."


def _failed(real: Drives, other: Drives) -> str:
    """Return why two drives cannot be compared: failed calls, or equal drives by the fail-safe."""
    if said := _often(real, other, "them", _failed_share):
        return f"cannot say whether the picture matters: calls failed, {said}, and the fail-safe drove."
    worlds = sorted(real.by_world.keys() & other.by_world.keys())
    steps = [[step for name in worlds for step in one.by_world[name].steps] for one in (real, other)]
    decided = [[step.decision.action is not None for step in mine] for mine in steps]
    alike = bool(worlds) and all(is_same_drive(real.by_world[name], other.by_world[name]) for name in worlds)
    if alike and decided[0] != decided[1]:
        return (
            "cannot say whether the picture matters: the drives are the same, but not the decisions. At some steps it "
            "decides nothing under one condition, and the fail-safe there does what it does under the other."
        )
    if alike and undecided_share(steps[0]) >= UNDECIDED:
        return (
            "cannot say whether the picture matters: the drives are the same, but at half of the steps or more it "
            "decides nothing, so they are mostly the fail-safe's."
        )
    if never := [one.driver.condition for one in (real, other) if undecided_share(one.steps) == 1]:
        return (
            f"cannot say whether the picture matters to its decisions: with {' and '.join(never)} pictures it decides "
            "nothing at all, and the fail-safe drove."
        )
    return ""


def _often(real: Drives, other: Drives, of: str, share_of: Callable[[Sequence[Step]], float]) -> str:
    """Return the shares of steps that exceed the limit, by condition, in words."""
    shares = {one.driver.condition: share_of(one.steps) for one in (real, other)}
    return " and ".join(f"{share:.0%} of {of} with {name} pictures" for name, share in shares.items() if share > SILENT)


def _failed_share(steps: Sequence[Step]) -> float:
    return sum(step.decision.missing == "error" for step in steps) / max(1, len(steps))


def _completion(real: Drives, other: Drives, outcomes: SuccessCriteria) -> str:
    """Return what completing the worlds shows and does not show, with the counts.

    Completing with pictures that show nothing needs no picture. Completing with wrong pictures may
    still use them.
    """
    worlds = real.by_world.keys() & other.by_world.keys()
    if not worlds:
        return ""
    with_real = sum(outcomes.is_success(real.by_world[name]) for name in worlds)
    without = sum(outcomes.is_success(other.by_world[name]) for name in worlds)
    n, condition = len(worlds), other.driver.condition
    counts = f"It completes {with_real} of {n} with real pictures and {without} of {n} with {condition} ones"
    if without and not _is_unseen(condition):
        what = "completion" if without >= with_real else "what it completes either way"
        return f"{counts}: {what} does not show that it reads what the camera shows correctly."
    if without and without >= with_real:
        return f"{counts}: completing these worlds needs no picture, so completion says nothing about the camera."
    if without:
        return f"{counts}: what it completes either way says nothing about the camera."
    if with_real:
        return f"{counts}: completion shows that the worlds can be done; only the comparison shows use of pictures."
    return f"{counts}: there is no completion to explain."


def _number(statistic: Statistic, name: str) -> str:
    unit = _UNITS.get(name, "")
    scale, unit = (100.0, " points") if name.endswith("_rate") else (1.0, unit)
    if statistic.value is None:
        return f"{_WORDS[name]} —"
    interval = "" if statistic.ci is None else f" [{scale * statistic.ci[0]:+.1f}, {scale * statistic.ci[1]:+.1f}]"
    return f"{_WORDS[name]} {scale * statistic.value:+.1f}{interval}{unit}"


def _p(p: float | None) -> str:
    return "—" if p is None else "<.001" if p < 0.001 else f"{p:.3f}".lstrip("0")
