"""Series of corruptions: how far down a model's effect holds, step by step.

The effect is the one that a label rests on: harder braking for the near lead than for the far one.
Without such pictures it is another answer to another frame's picture than to the same one again.
Both pictures are corrupted alike. A series asks step 3 first and halves what is left, so it asks
three of the five steps at most. docs/decisions/battery.md says why.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eyechart.calls import CallKey, Reply
from eyechart.conditions import OVER, corruption_of
from eyechart.corruptions import CORRUPTIONS, STEPS, step_of
from eyechart.errors import require_known
from eyechart.spaces.failures import says_cannot_see
from eyechart.stats.jackknife import FEW, mean_of_frames
from eyechart.stats.statistic import Statistic
from eyechart.studies.battery.answers import Answers, Floats
from eyechart.studies.battery.evidence import NEAR_FAR
from eyechart.verdicts import MARGIN

SERIES = "series"
CLEAN = f"{SERIES}.clean"
"""The statistic of the effect in clean pictures."""

LEVEL = 0.98
"""Level of the intervals: each step's lower end is a bound at .01, so a series of three errs by .03."""

MOST_ASKED = 3
"""The most steps of a corruption that are asked."""

OTHERS = ("real_repeat", "shuffled")
"""The pictures that are compared where the bank has no near and far lead."""

StepReplies = Mapping[str, tuple[int, int]]
"""By step, as ``fog_3``: replies that say that they cannot see, and all replies."""


@dataclass(frozen=True, slots=True)
class StepEffect(Statistic):
    """The effect at a step of a corruption, from -1 to 1, with its interval over episodes.

    ``step`` is 0 for clean pictures. Of ``replies`` under it, ``unseeing`` say that they cannot see.
    """

    step: int = 0
    replies: int = 0
    unseeing: int = 0

    @property
    def holds(self) -> bool | None:
        """Return whether the lower end is above the margin; None without an interval."""
        return None if self.ci is None else self.ci[0] > MARGIN


def read_series(text: str | Sequence[str]) -> tuple[str, ...]:
    """Return corruptions by name, from commas or a sequence; ``all`` are all.

    Raises SpecError that lists the known ones.
    """
    names = [name.strip() for name in text.split(",")] if isinstance(text, str) else list(text)
    if names == ["all"]:
        return tuple(CORRUPTIONS)
    for name in names:
        require_known("corruption", name, CORRUPTIONS)
    return tuple(dict.fromkeys(names))


def every_step(series: Sequence[str]) -> tuple[str, ...]:
    """Return every condition that some step of these series may ask."""
    steps = (f"{name}_{step}" for name in series for step in STEPS)
    return tuple(one for step in steps for one in (step, *(f"{name}{OVER}{step}" for name in (*NEAR_FAR, *OTHERS))))


def pictures_at(step: str, answers: Answers, conditions: Collection[str] = ()) -> tuple[str, ...]:
    """Return the conditions that a step such as ``fog_3`` asks a model with these clean answers.

    ``conditions`` are those whose answers are still to come.
    """
    if _moves_lead(answers, conditions):
        return tuple(f"{name}{OVER}{step}" for name in NEAR_FAR)
    return (step, *(f"{name}{OVER}{step}" for name in OTHERS))


def _moves_lead(answers: Answers, conditions: Collection[str] = ()) -> bool:
    """Return whether braking for the near lead and for the far one can be compared."""
    has_both = {*answers.decisions, *conditions}.issuperset(NEAR_FAR)
    return has_both and answers.projection(NEAR_FAR[0], "brake") is not None


def effect_at(answers: Answers, step: str = "", said: StepReplies | None = None) -> StepEffect:
    """Return the effect at a step such as ``fog_3``; in clean pictures without one."""
    at = f"{OVER}{step}" if step else ""
    if _moves_lead(answers):
        pictures = tuple(f"{name}{at}" for name in NEAR_FAR)
        near, far = (_levels(answers, name) for name in pictures)
        scores, what = np.sign(near - far), "braking harder for the near lead, less for the far one"
    else:
        pictures = (step or "real", *(f"{name}{at}" for name in OTHERS))
        again, other = (_differs(answers, pictures[0], name) for name in pictures[1:])
        scores, what = other - again, "another answer to another frame's picture, less those to the same picture"
    # A reply without an action shows no effect: frames that it still sees are not all frames.
    scores = np.where(np.isnan(scores) & _came(answers, pictures), 0.0, scores)
    found, number = mean_of_frames(scores, answers.episodes, level=LEVEL), step_of(step)
    unseeing, replies = (said or {}).get(step, (0, 0))
    return StepEffect(
        value=found.value,
        n=found.n,
        ci=found.ci,
        method=f"{what}: {found.method}",
        note=found.note,
        level=LEVEL,
        step=0 if number is None else number[1],
        replies=replies,
        unseeing=unseeing,
    )


def _levels(answers: Answers, condition: str) -> Floats:
    found = answers.projection(condition, "brake")
    return np.full(len(answers.frames), np.nan) if found is None else found


def _differs(answers: Answers, one: str, other: str) -> Floats:
    """Return 1 where two conditions have different decisions, 0 where equal, NaN without both."""
    apart, have = answers.distance(one, other)
    found = np.full(len(answers.frames), np.nan)
    found[have] = apart > 0
    return found


def _came(answers: Answers, conditions: Iterable[str]) -> NDArray[np.bool_]:
    """Return the frames on which every condition has a reply, with an action or without one."""
    came = np.ones(len(answers.frames), dtype=bool)
    for name in conditions:
        column = answers.decisions.get(name, (None,) * len(came))
        came &= np.array([one is not None and one.missing != "error" for one in column], dtype=bool)
    return came


def unseeing(replies: Iterable[tuple[CallKey, Reply]]) -> StepReplies:
    """Return by step how many replies say that they cannot see, and how many replies there are."""
    found: dict[str, tuple[int, int]] = {}
    for key, reply in replies:
        if (step := step_in(key.condition)) and reply.error is None:
            some, every = found.get(step, (0, 0))
            found[step] = some + says_cannot_see(reply.text), every + 1
    return found


def step_in(condition: str) -> str:
    """Return the step in a condition's name, such as ``fog_3``; "" where there is none."""
    step = corruption_of(condition)
    return "" if step is None else f"{step[0].name}_{step[1]}"


def series_statistics(answers: Answers, said: StepReplies) -> dict[str, Statistic]:
    """Return the effect in clean pictures and at each step that was asked; empty without a series."""
    steps = _steps_run(answers)
    found: dict[str, Statistic] = {CLEAN: effect_at(answers)} if steps else {}
    return {**found, **{f"{SERIES}.{step}": effect_at(answers, step, said) for step in steps}}


def _steps_run(answers: Answers) -> list[str]:
    """Return the steps with all pictures that they compare, in the order of the table."""
    have = {step_in(name) for name in answers.decisions}
    every = [f"{name}_{step}" for name in CORRUPTIONS for step in STEPS]
    return [step for step in every if step in have and set(pictures_at(step, answers)) <= answers.decisions.keys()]


def next_steps(answers: Answers, series: Sequence[str]) -> tuple[str, ...]:
    """Return the conditions that each series asks next, given the answers so far.

    Empty where every series has ended, or the effect is not shown in clean pictures.
    """
    if not series or effect_at(answers).holds is not True:
        return ()
    steps_run = _steps_run(answers)
    found = {name: {int(one[-1]): effect_at(answers, one) for one in steps_run if one[:-2] == name} for name in series}
    steps = {name: _bisected(effects)[2] for name, effects in found.items()}
    return tuple(
        condition
        for name, step in steps.items()
        if step is not None and step not in found[name]
        for condition in pictures_at(f"{name}_{step}", answers)
    )


def _bisected(effects: Mapping[int, StepEffect]) -> tuple[int, int, int | None]:
    """Return the greatest step that is known to hold, the least that does not, and the one that decides next.

    The first is 0 for clean pictures. The last is None at the end; its effect may be there, and
    have no interval.
    """
    low, high = 0, len(STEPS) + 1
    while high - low > 1:
        step = (low + high) // 2
        if (at := effects.get(step)) is None or at.holds is None:
            return low, high, step
        low, high = (step, high) if at.holds else (low, step)
    return low, high, None


def most_left(answers: Answers, series: Sequence[str], conditions: Collection[str]) -> tuple[str, ...]:
    """Return conditions of as many steps as the series may still ask; which ones is not known yet.

    ``conditions`` are the model's so far, answered or not.
    """
    made, found = {step_in(name) for name in conditions}, list[str]()
    for name in series:
        own = [step for step in (f"{name}_{number}" for number in STEPS) if step not in made]
        found += own[: max(0, MOST_ASKED - (len(STEPS) - len(own)))]
    return tuple(condition for step in found for condition in pictures_at(step, answers, conditions))


@dataclass(frozen=True, slots=True)
class SeriesResult:
    """How far down the effect holds under a corruption.

    ``reached`` is the greatest step at which it is shown, 0 for none, and None where that is not
    known, with ``why``. ``shown`` is the effect there, ``lost`` that at the least step without.
    """

    name: str
    reached: int | None
    shown: StepEffect | None
    lost: StepEffect | None
    why: str = ""

    @property
    def words(self) -> str:
        """Return the result in words, such as "sees to fog 3 of 5"."""
        what = CORRUPTIONS[self.name].words
        if self.reached is None:
            return f"{what}: {self.why}"
        if self.reached == 0:
            return f"not shown in the mildest {what}"
        return f"sees to {what} {self.reached} of {len(STEPS)}"


def results(statistics: Mapping[str, Statistic]) -> tuple[SeriesResult, ...]:
    """Return the result of each series in a model's statistics, in the order of the table."""
    found: dict[str, dict[int, StepEffect]] = {}
    for name in statistics:
        step = step_of(name.removeprefix(f"{SERIES}."))
        if step is not None and isinstance(one := statistics[name], StepEffect):
            found.setdefault(step[0].name, {})[step[1]] = one
    clean = statistics.get(CLEAN)
    seen = clean.holds if isinstance(clean, StepEffect) else None
    return tuple(_result(name, found[name], seen=seen) for name in CORRUPTIONS if name in found)


def _result(name: str, steps: Mapping[int, StepEffect], *, seen: bool | None) -> SeriesResult:
    """Return the result of one series; ``seen`` says whether the effect holds in clean pictures."""
    low, high, open_ = _bisected(steps)
    if seen is False:
        return SeriesResult(name, None, None, None, "no effect is shown in clean pictures")
    if open_ is None and seen:
        return SeriesResult(name, low, steps.get(low), steps.get(high))
    at = None if open_ is None else steps.get(open_)
    why = "not finished" if at is None and seen else f"cannot say: {FEW}"
    return SeriesResult(name, None, steps.get(low), at or steps.get(high), why)
