"""The tests that the calibrated rules name: exact within a frame, or safe for episodes.

Positive claims are tested at alpha .01; absences are bounded below a margin of .10. See
docs/decisions/battery.md.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from eyechart.conditions import ABSENT as LEAD_ABSENT
from eyechart.conditions import AGAIN, FEWEST
from eyechart.stats.agreement import cohens_kappa, pooled_kappa, rate
from eyechart.stats.association import quantile_bins
from eyechart.stats.episode_permutation import Trend, exchange_mi_test, exchange_test, iid_trend_test
from eyechart.stats.paired_tests import (
    LabelSwap,
    bounded_below,
    label_swap_test,
    paired_difference,
    sign_test,
    stratified_association,
)
from eyechart.stats.statistic import Statistic, not_available
from eyechart.studies.battery.answers import ABSENT, Answers, Symbols
from eyechart.studies.battery.controls import DEPTH_TESTS, LEVEL, NO_BRAKE, ControlStatistics
from eyechart.studies.battery.depth import NAMES, BrakingLevels, moved_of
from eyechart.studies.battery.evidence import ALONE
from eyechart.studies.battery.paper_statistics import Resampling, Statistics
from eyechart.verdicts import ALPHA, BOUND_ALPHA, KAPPA_MARGIN, MARGIN

SAME = ("real", "real_repeat", "mirrored", "recoloured")
"""Pictures of a frame that call for one answer; the mirrored picture calls for its reflection."""

LIKE_CONTENT = ("shuffled", "recoloured", "lead_absent")
"""Pictures with other content; changing the answer more than a repeat does is ``content``."""

COUNTERFACTUAL_TESTS = (
    *DEPTH_TESTS,
    *NAMES,
    *(f"content_{name}" for name in LIKE_CONTENT[1:]),
    *(f"content_nudged_{name}" for name in LIKE_CONTENT[1:]),
    "bound_content_recoloured",
    *(f"bound_{name}" for name in ALONE if name.startswith("lead_")),
)
"""The tests that need counterfactual pictures; of the others, only ``kappa_pooled`` reads any."""


@dataclass(frozen=True)
class CalibratedTests:
    """Computes the calibrated tests of one model's answers.

    ``independent`` declares that frames without episodes are independent draws.
    """

    answers: Answers
    how: Resampling
    independent: bool = False

    def statistics(self) -> Statistics:
        """Return every test by its name."""
        return {name: test() for name, test in self.tests().items()}

    def tests(self) -> dict[str, Callable[[], Statistic]]:
        """Return the function of every test, by its name."""
        return {
            "unparsed_reference": self._unparsed_reference,
            "self_disagreement": self._self_disagreement,
            "kappa": self._kappa,
            "kappa_pooled": self.kappa_pooled,
            "bound_kappa": partial(self._kappa_over, SAME[:2], KAPPA_MARGIN),
            **ControlStatistics(self.answers).tests(),
            **{name: partial(self._of_depth, name) for name in NAMES},
            "repeat_over_nudged": partial(self._over, "real_repeat", "nudged"),
            "repeats_together": self._repeats_together,
            "depth_observational": self._observational,
            "depth_information": self._episode_safe_information,
            **{f"content_{name}": partial(self._over, "real_repeat", name) for name in LIKE_CONTENT},
            **{f"content_nudged_{name}": partial(self._over, "nudged", name) for name in LIKE_CONTENT},
            "scene_cue": partial(self._over, "shuffled", "cross_scenario"),
            "presence": partial(self._differs, "decision"),
            "presence_response": partial(self._differs, "response"),
            "bound_content_shuffled": partial(self._bound, "shuffled"),
            "bound_content_recoloured": partial(self._bound, "recoloured"),
            "bound_scene": partial(self._bound, "cross_scenario"),
            "bound_blank": partial(self._bound, "blank"),
            **{f"bound_{name}": partial(self._bound_alone, name) for name in ALONE},
            "image_token": partial(self._image_token, "response"),
            "image_token.decision": partial(self._image_token, "decision"),
        }

    @cached_property
    def _moved(self) -> BrakingLevels:
        return moved_of(self.answers)

    def _of_depth(self, name: str) -> Statistic:
        if self.answers.projection("real", "brake") is None:
            return not_available(NO_BRAKE)
        return self._moved.tests()[name]()

    def _unparsed_reference(self) -> Statistic:
        """Return the rate of replies without a decision; failed calls are left out."""
        given = [one for name in ("real", "real_repeat") for one in self.answers.decisions.get(name, ()) if one]
        given = [one for one in given if one.missing != "error"]
        return rate(sum(one.action is None for one in given), len(given), level=LEVEL)

    def _self_disagreement(self) -> Statistic:
        apart, _ = self.answers.distance("real", "real_repeat")
        return rate(int((apart > 0).sum()), len(apart), level=LEVEL)

    def _kappa(self) -> Statistic:
        real, repeat, _ = self.answers.both("real", "real_repeat", "decision")
        return cohens_kappa(real, repeat, level=LEVEL)

    def kappa_pooled(self) -> Statistic:
        """Bound the agreement beyond chance over a frame's pictures that call for one answer."""
        return self._kappa_over(SAME, MARGIN)

    def _kappa_over(self, names: tuple[str, ...], margin: float) -> Statistic:
        partners = self.answers.reflections
        codes = np.full((len(self.answers.frames), len(names)), -1, dtype=np.int64)
        for place, name in enumerate(names):
            given = self.answers.actions(name)
            for code, action in enumerate(self.answers.names):
                codes[given == (partners.get(action, action) if name == "mirrored" else action), place] = code
        statistic = pooled_kappa(codes, margin=margin, alpha=ALPHA)
        return replace(statistic, method=f"{', '.join(names)}: {statistic.method}")

    def _repeats_together(self) -> Statistic:
        """Test whether an unusual answer to a picture repeats, within frames of equal blank answer.

        An effect on few frames is bounded below the margin, but it is still no absence.
        """
        names = ("real", "real_repeat", "blank")
        real, repeat, blank = (self.answers.actions(name) for name in names)
        have, what = (real != ABSENT) & (repeat != ABSENT), "whether real and real_repeat get what most pictures get"
        if not have.any():
            return not_available("no frame has decisions on real and real_repeat", method=what)
        usual, counts = np.unique(real[have], return_counts=True)
        most = usual[counts.argmax()]
        groups = blank[have].tolist()
        statistic = stratified_association(real[have] != most, repeat[have] != most, groups, level=LEVEL)
        return replace(statistic, method=f"{what}, within what its blank gets: {statistic.method}")

    def _observational(self) -> Statistic:
        """Test the trend on real pictures; with a text per frame, also under another frame's text.

        A model that follows a text about the gap seems to see; under another frame's text it does
        not. The larger p of the two is valid whichever null holds.
        """
        statistic = self._trend("real")
        if not self.answers.has_text or statistic.p is None:
            return statistic
        swapped = self._trend("text_swapped")
        if swapped.p is None:
            why = "the prompt describes each frame, so text_swapped is needed too"
            return not_available(f"{why}: {swapped.note}", statistic.n)
        ps = {"p_real": statistic.p, "p_text_swapped": swapped.p}
        weaker = swapped if swapped.p > statistic.p else statistic
        return replace(weaker, detail={**(weaker.detail or {}), **ps}, method=f"{weaker.method}; real and text_swapped")

    def _trend(self, condition: str) -> Statistic:
        gaps = self.answers.gaps
        if gaps is None:
            return not_available(self.answers.no_gap)
        braking, ranks = self.answers.projection(condition, "brake"), _ranks(gaps)
        if braking is None:
            return not_available(NO_BRAKE)
        levels = np.where(np.isnan(braking), -1, braking).astype(np.int64)
        decided = levels[levels >= 0]
        if not len(decided):
            return not_available(f"no decisions on {condition} pictures")
        if (decided == decided[0]).all():
            return replace(not_available("the braking level never changes", len(decided)), p=1.0)
        seed, resamples = self.how.seed_of("depth_observational"), self.how.resamples
        if self.independent:
            have = levels >= 0
            scenarios = self.answers.scenarios[have]
            return _standardised(iid_trend_test(levels[have], ranks[have], scenarios, seed=seed, resamples=resamples))
        return _standardised(exchange_test(levels, ranks, *self._layout(), seed=seed, alpha=ALPHA, resamples=resamples))

    def _episode_safe_information(self) -> Statistic:
        gaps = self.answers.gaps
        if gaps is None:
            return not_available(self.answers.no_gap)
        real = self.answers.actions("real")
        if not (real != ABSENT).any():
            return not_available("no decisions on real pictures")
        bins = quantile_bins(gaps, no_lead_bin=True)
        seed, resamples = self.how.seed_of("depth_information"), self.how.resamples
        return exchange_mi_test(real, bins.codes, *self._layout(), seed=seed, alpha=ALPHA, resamples=resamples)

    def _layout(self) -> tuple[Symbols, Symbols, NDArray[np.int64]]:
        return self.answers.scenarios, self.answers.episodes, self.answers.steps

    def _alike(self, first: str, second: str, level: str = "decision") -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return where each condition agrees with the true picture, on frames with all answers."""
        true, first = self._true(first, second)
        (one, has_one), (other, has_other) = (self.answers.distance(true, name, level) for name in (first, second))
        return one[has_other[has_one]] == 0, other[has_one[has_other]] == 0

    def _true(self, repeat: str, other: str) -> tuple[str, str]:
        """Return the two answers to the true picture that are compared with another answer.

        For a condition of a later stage, one of them comes from that stage: a model that has
        changed by then does not answer to the picture's content.
        """
        staged = other == LEAD_ABSENT and AGAIN in self.answers.decisions
        return (AGAIN, "real" if repeat == "real_repeat" else repeat) if staged else ("real", repeat)

    def _over(self, first: str, second: str) -> Statistic:
        """Test whether one condition agrees with ``real`` on more frames than another."""
        one, other = self._alike(first, second)
        true, first = self._true(first, second)
        found, what = sign_test(one, other, level=LEVEL), f"agreement with {true}, {first} over {second}"
        if not len(one):
            return not_available("no frame has all three decisions", method=what)
        return replace(found, method=f"{what}: {found.method}")

    def _bound(self, other: str) -> Statistic:
        repeat, changed = self._alike("real_repeat", other)
        statistic = bounded_below(repeat, changed, margin=MARGIN, alpha=ALPHA)
        return replace(statistic, method=f"agreement with real, real_repeat minus {other}: {statistic.method}")

    def _bound_alone(self, other: str) -> Statistic:
        """Bound how much more a picture changes the decision than a repeat does.

        A missing decision is not another decision. In a small run the repeats of a later stage are
        too few; then those of the first stage are used.
        """
        names = self._true("real_repeat", other)
        if names[0] == AGAIN and np.count_nonzero(self.answers.actions(AGAIN) != ABSENT) < FEWEST:
            names = ("real", "real_repeat")
        real, repeat = map(self.answers.actions, names)
        given, replied = self.answers.actions(other), self.answers.responses(other) != ABSENT
        have = (real != ABSENT) & (repeat != ABSENT) & replied
        kept = (given == real) | (given == ABSENT)
        statistic = bounded_below((repeat == real)[have], kept[have], margin=MARGIN, alpha=BOUND_ALPHA)
        return replace(statistic, method="decision of {} kept, {} minus {}: {}".format(*names, other, statistic.method))

    def _image_token(self, level: str) -> Statistic:
        """Compare how often a grey picture and no picture get the real one's answer, by frame."""
        alike, what = self._alike("blank", "text_only", level), "agreement with real, blank minus text_only"
        if not len(alike[0]):
            return not_available("no frame has answers to real, blank and text_only", method=what)
        apart, test = paired_difference(*alike, level=LEVEL), sign_test(*alike, level=LEVEL)
        return replace(apart, p=test.p, method=f"{what}: {apart.method}; p: one-sided exact sign test")

    def _differs(self, level: str) -> Statistic:
        real, blank, _ = self.answers.both("real", "blank", level)
        seed = self.how.seed_of(f"presence.{level}")
        statistic = label_swap_test(real, blank, seed=seed, resamples=self.how.resamples)
        if not isinstance(statistic, LabelSwap):
            return statistic
        apart = sum(abs(one - other) for one, other in zip(statistic.first, statistic.second, strict=True)) / (
            2 * statistic.n
        )
        detail = {**(statistic.detail or {}), "sum_of_squared_differences": statistic.value}
        method = f"total variation between the answers to real and to blank; p: {statistic.method}"
        return replace(statistic, value=apart, method=method, detail=detail)


class LazyStatistics(Mapping[str, Statistic]):
    """Statistics by name, each computed at its first use by its function in ``tests``."""

    def __init__(self, tests: Mapping[str, Callable[[], Statistic]]) -> None:
        self._tests = dict(tests)
        self._made: dict[str, Statistic] = {}

    def __getitem__(self, name: str) -> Statistic:
        if name not in self._made:
            self._made[name] = self._tests[name]()
        return self._made[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._tests)

    def __len__(self) -> int:
        return len(self._tests)


def _standardised(statistic: Statistic) -> Statistic:
    """Return the trend in standard deviations of its null; negative: more braking when nearer."""
    if not isinstance(statistic, Trend) or statistic.value is None or statistic.null_sd == 0:
        return statistic
    method = f"standard deviations from the null; {statistic.method}"
    note = "; ".join(filter(None, (statistic.note, "no interval: it counts deviations of its own null")))
    value = (statistic.value - statistic.null_mean) / statistic.null_sd
    detail = {**(statistic.detail or {}), "trend": statistic.value}
    return replace(statistic, value=value, method=method, note=note, detail=detail)


def _ranks(gaps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return mid-ranks of the gaps; frames without a lead share the farthest rank."""
    _, place, count = np.unique(np.where(np.isfinite(gaps), gaps, np.inf), return_inverse=True, return_counts=True)
    ranks = np.cumsum(count) - (count - 1) / 2
    return np.asarray(ranks[place], dtype=np.float64)
