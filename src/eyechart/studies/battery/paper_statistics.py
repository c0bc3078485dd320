"""The statistics of the paper's battery, at response level and (``.decision``) decision level.

Source: paper, section The Input-Ablation Battery; the choices that its text leaves open are in
docs/decisions/battery.md.
"""

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eyechart.conditions import BATTERY, CONDITIONS, CONTROLS, COUNTERFACTUALS
from eyechart.seeds import key_seed
from eyechart.spaces.space import UNPARSED
from eyechart.stats.agreement import clears_floor, rate, swap_test
from eyechart.stats.association import (
    contingency,
    cramers_v,
    entropy_bits,
    entropy_of_counts,
    information_of_tables,
    modal_share,
    numbered,
    quantile_bins,
)
from eyechart.stats.episodes import (
    difference_over_episodes,
    median_difference,
    median_over_episodes,
    share_over_episodes,
)
from eyechart.stats.jackknife import association_interval, over_tables
from eyechart.stats.resamples import permute_mutual_information
from eyechart.stats.statistic import Statistic, not_available
from eyechart.studies.battery.answers import ABSENT, Answers, Mask
from eyechart.verdicts import DECIDED

Statistics = dict[str, Statistic]
Floats = NDArray[np.float64]
Codes = NDArray[np.int64]

ALPHA = 0.05
"""The significance level of the paper's tests; our choice, because the paper prints none."""

ONE_EPISODE = "one episode shows no spread: the interval takes its frames as independent"


@dataclass(frozen=True, slots=True)
class Resampling:
    """The number of resamples, and the seed from which each test derives its own by its name.

    ``intervals=False`` leaves out the intervals that no rule reads.
    """

    resamples: int = 5000
    seed: int = 0
    intervals: bool = True

    def seed_of(self, name: str) -> int:
        """Return the seed of the test of this name."""
        return key_seed("score", self.seed, name)


@dataclass(frozen=True)
class PaperStatistics:
    """Computes the paper's statistics of one model's answers."""

    answers: Answers
    how: Resampling

    @cached_property
    def _episodes(self) -> Codes:
        """Return the number of each frame's episode."""
        return np.unique(self.answers.episodes, return_inverse=True)[1].astype(np.int64)

    def statistics(self) -> Statistics:
        """Return every statistic by its name."""
        return {name: test() for name, test in self.tests().items()}

    def tests(self) -> dict[str, Callable[[], Statistic]]:
        """Return the function of every statistic, by its name."""
        found: dict[str, Callable[[], Statistic]] = {"unparsed_rate": self._unparsed}
        for level, suffix in (("response", ""), ("decision", ".decision")):
            at_level = {**self._agreements(level), **self._dependence(level), **self._gap_tests(level)}
            found |= {f"{name}{suffix}": test for name, test in at_level.items()}
        both = found["cramers_v"], found["cramers_v.decision"]
        found["refusal_effect"] = lambda: refusal_effect(*(test() for test in both))
        found["mirror_swap_rate"] = self.swaps
        found["gap_order"] = self._gap_order
        diversity = cache(self._diversity)
        return found | {name: partial(lambda name: diversity()[name], name) for name in ("modal_share", "entropy")}

    def _unparsed(self) -> Statistic:
        conditions, counts = [name for name in BATTERY if name in self.answers.decisions], self.answers.counts()
        given = [self.answers.given(name) for name in conditions]
        if not any(came.any() for came, _ in given):
            return not_available("no observations")
        lost = np.concatenate([without[came] for came, without in given]).astype(np.float64)
        statistic = self._over_episodes(lost, np.concatenate([self._episodes[came] for came, _ in given]))
        reasons = sum((counts[name] for name in conditions), Counter())
        del reasons[DECIDED]
        return replace(statistic, detail={"reasons": dict(sorted(reasons.items()))})

    def _agreements(self, level: str) -> dict[str, Callable[[], Statistic]]:
        decisions = self.answers.decisions
        compared = (*BATTERY, *COUNTERFACTUALS, *CONTROLS)  # counterfactuals are compared in pairs
        further = [
            name for name in dict.fromkeys((*CONDITIONS, *decisions)) if name in decisions and name not in compared
        ]
        distance = cache(lambda name: self.answers.distance("real", name, level))

        def agree(name: str) -> Statistic:
            apart, have = distance(name)
            return self._share((apart == 0).astype(np.float64), have)

        def differ(name: str) -> tuple[Floats, Mask]:
            apart, have = distance(name)
            return (apart > 0).astype(np.float64), have

        floor, idi = (cache(lambda name=name: self._share(*differ(name))) for name in ("real_repeat", "blank"))
        return {
            **{f"agree.{name}": partial(agree, name) for name in (*BATTERY[1:], *further)},
            "noise_floor": floor,
            "idi": idi,
            "idi_adj": lambda: self._difference(*differ("blank"), *differ("real_repeat")),
            "clears_floor": lambda: _clears(idi(), floor()),
        }

    def _dependence(self, level: str) -> dict[str, Callable[[], Statistic]]:
        def over(names: Sequence[str]) -> Statistic:
            return self._association(names, level)

        return {
            "cramers_v": cache(partial(over, BATTERY)),
            "cramers_v_real_blank": partial(over, ("real", "blank")),
        }

    def _association(self, names: Sequence[str], level: str) -> Statistic:
        """Return Cramér's V of condition × answer, with its interval over episodes."""
        answer, conditions = self._coded(names, level), tuple(sorted(names))
        rows = np.repeat([conditions.index(condition) for condition in names], len(self.answers.frames))
        episodes = np.tile(self._episodes, len(names))
        have = answer.codes >= 0
        return self._table(_CodedLabels(rows[have], conditions), answer.where(have), episodes[have])

    def _coded(self, conditions: Sequence[str], level: str) -> "_CodedLabels":
        """Return the symbols of conditions as numbers, in sorted order of their names, -1 for ``ABSENT``."""
        names = tuple(sorted({*self.answers.names, UNPARSED}))
        codes = [self.answers.codes(condition, level, names) for condition in conditions]
        return _CodedLabels(np.concatenate(codes), names)

    def _table(self, rows: "_CodedLabels", columns: "_CodedLabels", episodes: Codes) -> Statistic:
        made = contingency(rows.codes, columns.codes)
        found = cramers_v(made.table)
        shape = made.table.shape
        named = {"rows": rows.named(made.rows), "columns": columns.named(made.columns), "table": made.table.tolist()}
        detail = {**(found.detail or {}), **named}
        if found.value is None or 1 in shape or not self.how.intervals:
            return replace(found, detail=detail)
        (_, i), (_, j) = numbered(rows.codes), numbered(columns.codes)
        interval = association_interval(_by_episode(i, j, episodes, shape), found.value)
        return _with_interval(replace(found, detail=detail), interval)

    def _gap_tests(self, level: str) -> dict[str, Callable[[], Statistic]]:
        return {"obstacle": partial(self._obstacle, level), "mutual_information": partial(self._of_gaps, level)}

    def _obstacle(self, level: str) -> Statistic:
        """Return how real answers go with a gap below the bank's threshold."""
        if isinstance(found := self._real(level), Statistic) or self.answers.gap is None:
            return found if isinstance(found, Statistic) else not_available(self.answers.no_gap)
        answer, gaps, have = found
        near = _CodedLabels((gaps < self.answers.gap.threshold).astype(np.int64), ("far", "near"))
        return self._table(answer, near, self._episodes[have])

    def _of_gaps(self, level: str) -> Statistic:
        """Return the information of real answers about the gap."""
        found = self._real(level)
        return found if isinstance(found, Statistic) else self._information(*found, level)

    def _real(self, level: str) -> "Statistic | tuple[_CodedLabels, Floats, Mask]":
        """Return the answers to real pictures with their gaps and frames, or why there are none."""
        gaps = self.answers.gaps
        if gaps is None or self.answers.gap is None:
            return not_available(self.answers.no_gap)
        real = self._coded(["real"], level)
        have = real.codes >= 0
        if not have.any():
            return not_available("no answers to real pictures")
        return real.where(have), gaps[have], have

    def _information(self, real: "_CodedLabels", gaps: Floats, have: Mask, level: str) -> Statistic:
        bins = quantile_bins(gaps)
        made = contingency(real.codes, bins.codes)
        name = f"mutual_information.{level}"
        found = permute_mutual_information(made.table, seed=self.how.seed_of(name), resamples=self.how.resamples)
        n, occupied = found.n, (np.count_nonzero(made.table.sum(axis=1)), np.count_nonzero(made.table.sum(axis=0)))
        bias = (occupied[0] - 1) * (occupied[1] - 1) / (2 * n * math.log(2))
        detail = {
            "bin_sizes": bins.sizes,
            "edges": bins.edges,
            "ceiling": min(entropy_bits(real.codes).value or 0.0, entropy_bits(bins.codes).value or 0.0),
            "miller_madow": (found.value or 0.0) - bias,
            "rows": real.named(made.rows),
            "table": made.table.tolist(),
        }
        found = replace(found, detail=detail)
        if not self.how.intervals or found.value is None:
            return found
        shape = len(real.names), len(bins.sizes)
        counts = _by_episode(real.codes, bins.codes, self._episodes[have], shape).transpose(0, 2, 1)
        return _with_interval(found, over_tables(counts, information_of_tables, math.log2(max(2, min(shape)))))

    def swaps(self) -> Statistic:
        """Return how often reflection exchanges directions, with the test against chance."""
        partner = self.answers.partners
        if not partner:
            return not_available("no action of this space exchanges under reflection")
        if all(frame.mirror_axis == "none" for frame in self.answers.frames):
            return not_available("no frame of the bank has a mirror axis")
        real, mirrored = self.answers.turns("real"), self.answers.turns("mirrored", "response")
        have = (real != ABSENT) & (mirrored != ABSENT)
        if not have.any():
            return not_available("no frame has an answer both to its real and to its mirrored picture")
        seed = self.how.seed_of("mirror_swap_rate")
        found = swap_test(real[have], mirrored[have], partner, seed=seed, resamples=self.how.resamples)
        turns = np.isin(real[have], list(partner))
        if found.value is None:
            return found
        swapped = np.array([partner[str(one)] for one in real[have][turns]]) == mirrored[have][turns]
        share = self._over_episodes(swapped.astype(np.float64), self._episodes[have][turns], always=True)
        method = f"{share.method}; {found.tested}"
        return replace(found, ci=share.ci, method=method, note=found.note or share.note)

    def _gap_order(self) -> Statistic:
        gaps, gap, space = self.answers.gaps, self.answers.gap, self.answers.space
        if gaps is None or gap is None:
            return not_available(self.answers.no_gap)
        real = self.answers.actions("real")
        finite = gaps[np.isfinite(gaps)]
        capped = np.where(np.isfinite(gaps), gaps, finite.max() if finite.size else 0.0)
        role = np.array([ABSENT if action == ABSENT else space.role(action) for action in real])
        medians = {str(action): float(np.median(capped[real == action])) for action in np.unique(real[real != ABSENT])}
        detail: dict[str, object] = {"median_by_action": medians, "no_lead_counts_as": "the farthest gap"}
        n = int(np.count_nonzero(role != ABSENT))
        if not ((role == "brake").any() and (role == "proceed").any()):
            why = "the model never brakes or never proceeds"
            return replace(not_available(why, n, "median gap, proceed minus brake"), detail=detail)
        ends = [self._median(capped, role == one) for one in ("proceed", "brake")]
        statistic = median_difference(*ends)
        method = f"median gap, proceed minus brake; {statistic.method}"
        return replace(statistic, n=n, method=method, detail=detail, unit=gap.unit)

    def _median(self, values: Floats, of: Mask) -> Statistic:
        if not self.how.intervals:
            return Statistic(float(np.median(values[of])), int(of.sum()), method="no interval computed")
        return median_over_episodes(values[of], self._episodes[of])

    def _diversity(self) -> Statistics:
        real = self.answers.actions("real")
        have = real != ABSENT
        result = {"modal_share": modal_share(real[have]), "entropy": entropy_bits(real[have])}
        answer = self._coded(["real"], "decision")
        if not have.any():
            return result
        counts = dict(zip(*(each.tolist() for each in np.unique(real[have], return_counts=True)), strict=True))
        common, mode = result["modal_share"], max(counts, key=lambda label: counts[label])
        often = self._over_episodes((real[have] == mode).astype(np.float64), self._episodes[have])
        method, detail = f"{common.method}; {often.method}", {**(common.detail or {}), "counts": counts}
        result["modal_share"] = replace(common, ci=often.ci, method=method, note=often.note, detail=detail)
        if self.how.intervals:
            shape, nothing = (1, len(answer.names)), np.zeros(int(have.sum()), dtype=np.int64)
            tables = _by_episode(nothing, answer.codes[have], self._episodes[have], shape)
            interval = over_tables(tables, lambda each: entropy_of_counts(each[:, 0]), math.log2(shape[1]))
            result["entropy"] = _with_interval(result["entropy"], interval)
        return result

    def _share(self, hits: Floats, have: Mask) -> Statistic:
        if not have.any():
            return not_available("no frame has both answers")
        return self._over_episodes(hits, self._episodes[have])

    def _over_episodes(self, hits: Floats, episodes: Codes, *, always: bool = False) -> Statistic:
        """Return a share of frames with its interval over episodes.

        One episode gives an interval over frames, with a note. ``always`` computes the interval
        even without ``intervals``, because a rule reads it.
        """
        k, n = int(hits.sum()), len(hits)
        sums = _sums_by_episode(np.column_stack([hits, np.ones(n)]), episodes)
        detail = {"k": k, "episodes": len(sums)}
        if not (self.how.intervals or always):
            return replace(rate(k, n), detail=detail)
        statistic = share_over_episodes(sums[:, 0], sums[:, 1])
        if statistic.ci is None:
            return replace(rate(k, n), note=ONE_EPISODE, detail=detail)
        return statistic

    def _difference(self, one: Floats, have_one: Mask, other: Floats, have_other: Mask) -> Statistic:
        if not have_one.any() or not have_other.any():
            return not_available("no frame has both answers")
        if not self.how.intervals:
            return Statistic(float(one.mean() - other.mean()), len(one), method="no interval computed")
        columns = np.zeros((len(have_one), 4))
        columns[have_one, 0], columns[:, 1] = one, have_one
        columns[have_other, 2], columns[:, 3] = other, have_other
        sums = _sums_by_episode(columns, self._episodes)
        return difference_over_episodes((sums[:, 0], sums[:, 1]), (sums[:, 2], sums[:, 3]))


def median_gaps(answers: Answers) -> Statistics:
    """Return the median true gap of each action on real frames, with its interval over episodes.

    Empty without gaps. A frame without a lead counts as the farthest. Source: paper, Table
    t:qwenorder.
    """
    if answers.gaps is None or answers.gap is None:
        return {}
    finite = answers.gaps[np.isfinite(answers.gaps)]
    capped = np.where(np.isfinite(answers.gaps), answers.gaps, finite.max() if finite.size else 0.0)
    real, result = answers.actions("real"), {}
    for action in map(str, np.unique(real[real != ABSENT])):
        mine = real == action
        result[action] = replace(median_over_episodes(capped[mine], answers.episodes[mine]), unit=answers.gap.unit)
    return result


class _CodedLabels(NamedTuple):
    """Labels as numbers, with the name of each number."""

    codes: Codes
    names: tuple[str, ...]

    def where(self, have: Mask) -> "_CodedLabels":
        """Return the labels of some frames."""
        return _CodedLabels(self.codes[have], self.names)

    def named(self, codes: Sequence[str | int]) -> tuple[str, ...]:
        """Return the names of some numbers."""
        return tuple(self.names[int(code)] for code in codes)


def refusal_effect(response: Statistic, decision: Statistic) -> Statistic:
    """Return 1 where answers depend on the condition only at response level (refusal), else 0."""
    method = "significant at response level and not at decision level (alpha .05)"
    if response.p is None or decision.p is None:
        return not_available("one of the two tests could not be made", response.n, method)
    return Statistic(float(response.p < ALPHA <= decision.p), response.n, method=method)


def _clears(idi: Statistic, floor: Statistic) -> Statistic:
    method = "1 where IDI > 1.5 s, strictly"
    if idi.value is None or floor.value is None:
        return not_available("IDI or the noise floor could not be measured", method=method)
    return Statistic(float(clears_floor(idi.value, floor.value)), idi.n, method=method)


def _with_interval(statistic: Statistic, interval: Statistic) -> Statistic:
    """Return a statistic with another one's interval, or with the reason that there is none."""
    method = f"{statistic.method}; {interval.method}"
    return replace(statistic, ci=interval.ci, method=method, note=statistic.note or interval.note)


def _sums_by_episode(columns: Floats, episodes: Codes) -> Floats:
    """Return the sums of each episode that occurs, shape (episodes, columns)."""
    _, codes = np.unique(episodes, return_inverse=True)
    return np.stack([np.bincount(codes, weights=column) for column in columns.T], axis=1)


def _by_episode(rows: Codes, columns: Codes, episodes: Codes, shape: tuple[int, int]) -> Floats:
    """Return the table of counts of each episode that occurs, shape (episodes, *shape)."""
    _, e = np.unique(episodes, return_inverse=True)
    cells = shape[0] * shape[1]
    flat = np.bincount(e * cells + rows * shape[1] + columns, minlength=(int(e.max()) + 1) * cells)
    return flat.reshape(-1, *shape).astype(np.float64)
