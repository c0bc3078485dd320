"""The statistics of the paper's battery, each at response level and, with ``.decision``, at decision level.

Source: paper, section The Input-Ablation Battery; the choices that its text leaves open are in
docs/decisions/0006-two-sets-of-rules.md.
"""

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
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
    cramers_v_of_tables,
    entropy_bits,
    entropy_of_counts,
    information_of_tables,
    modal_share,
    quantile_bins,
)
from eyechart.stats.episodes import share_over_episodes
from eyechart.stats.paired import paired_difference
from eyechart.stats.resampling import (
    cluster_bootstrap,
    episode_bootstrap,
    median_by_counts,
    permute_mutual_information,
    ratio_of_sums,
)
from eyechart.stats.statistic import Statistic, cannot_say
from eyechart.studies.battery.answers import ABSENT, Answers, Mask, Symbols
from eyechart.verdicts import DECIDED

Statistics = dict[str, Statistic]
Floats = NDArray[np.float64]
Codes = NDArray[np.int64]

ALPHA = 0.05
"""The level of significance of the paper's tests, which is ours: the paper prints none."""

ONE_EPISODE = "one episode shows no spread: the interval takes its frames as independent"

ENUMERATE = 30_000
"""Up to so many multisets of episodes (9 episodes) the bootstrap is enumerated; beyond, resamples are drawn."""


@dataclass(frozen=True, slots=True)
class Resampling:
    """How many resamples are drawn, and the seed from which each test derives its own by its name.

    ``intervals=False`` leaves out the bootstrap intervals, which no rule reads and which take most of the time.
    """

    resamples: int = 5000
    seed: int = 0
    intervals: bool = True

    def seed_of(self, name: str) -> int:
        """Return the seed of the test of this name."""
        return key_seed("score", self.seed, name)


@dataclass(frozen=True)
class Published:
    """Computes the paper's statistics of one model's answers."""

    answers: Answers
    how: Resampling

    @cached_property
    def _episodes(self) -> Codes:
        """Return the number of each frame's episode."""
        return np.unique(self.answers.episodes, return_inverse=True)[1].astype(np.int64)

    def statistics(self) -> Statistics:
        """Return every statistic by its name."""
        found: Statistics = {"unparsed_rate": self._unparsed()}
        for level, suffix in (("response", ""), ("decision", ".decision")):
            at_level = {**self._agreements(level), **self._dependence(level), **self._gap_tests(level)}
            found |= {f"{name}{suffix}": value for name, value in at_level.items()}
        found["refusal_effect"] = refusal_effect(found["cramers_v"], found["cramers_v.decision"])
        found["mirror_swap_rate"] = self._swap()
        found["gap_order"] = self._gap_order()
        return found | self._diversity()

    def _unparsed(self) -> Statistic:
        counts = self.answers.counts()
        every = sum((counts[name] for name in BATTERY if name in counts), Counter[str]())
        reasons = {reason: count for reason, count in sorted(every.items()) if reason != DECIDED}
        return replace(rate(sum(reasons.values()), every.total()), detail={"reasons": reasons})

    def _agreements(self, level: str) -> Statistics:
        differ: dict[str, tuple[Floats, Mask]] = {}
        found: Statistics = {}
        asked = self.answers.decisions
        told = (*BATTERY, *COUNTERFACTUALS, *CONTROLS)  # counterfactuals are compared in pairs
        further = [name for name in dict.fromkeys((*CONDITIONS, *asked)) if name in asked and name not in told]
        for name in (*BATTERY[1:], *further):
            apart, have = self.answers.distance("real", name, level)
            differ[name] = ((apart > 0).astype(np.float64), have)
            found[f"agree.{name}"] = self._share((apart == 0).astype(np.float64), have)
        found["noise_floor"] = self._share(*differ["real_repeat"])
        found["idi"] = self._share(*differ["blank"])
        found["idi_adj"] = self._difference(*differ["blank"], *differ["real_repeat"], f"idi_adj.{level}")
        found["clears_floor"] = _clears(found["idi"], found["noise_floor"])
        return found

    def _dependence(self, level: str) -> Statistics:
        every = {name: self.answers.symbols(name, level) for name in BATTERY}
        pair = {name: every[name] for name in ("real", "blank")}
        return {
            "cramers_v": self._association(every, f"cramers_v.{level}"),
            "cramers_v_real_blank": self._association(pair, f"cramers_v_real_blank.{level}"),
        }

    def _association(self, columns: dict[str, Symbols], name: str) -> Statistic:
        """Return Cramér's V of condition × answer, with its bootstrap interval."""
        answer = self._coded(np.concatenate(list(columns.values())))
        conditions = tuple(sorted(columns))
        rows = np.repeat([conditions.index(condition) for condition in columns], len(self.answers.frames))
        episodes = np.tile(self._episodes, len(columns))
        have = answer.codes >= 0
        return self._table(_Coded(rows[have], conditions), answer.where(have), episodes[have], name)

    def _coded(self, symbols: Symbols) -> "_Coded":
        """Return symbols as numbers, in sorted order of their names, -1 for ``ABSENT``."""
        names = tuple(sorted({*self.answers.space.actions, UNPARSED}))
        codes = np.full(len(symbols), -1, dtype=np.int64)
        for code, name in enumerate(names):
            codes[symbols == name] = code
        return _Coded(codes, names)

    def _table(self, rows: "_Coded", columns: "_Coded", episodes: Codes, name: str) -> Statistic:
        made = contingency(rows.codes, columns.codes)
        found = cramers_v(made.table)
        shape = made.table.shape
        named = {"rows": rows.named(made.rows), "columns": columns.named(made.columns), "table": made.table.tolist()}
        detail = {**(found.detail or {}), **named}
        if found.value is None or 1 in shape:
            return replace(found, detail=detail)
        sums = _counts_by_episode(rows.codes, columns.codes, episodes)
        interval = self._bootstrap(sums, lambda tables: cramers_v_of_tables(tables.reshape(-1, *shape)), name)
        return replace(found, ci=interval.ci, method=f"{found.method}; {interval.method}", detail=detail)

    def _gap_tests(self, level: str) -> Statistics:
        gaps = self.answers.gaps
        if gaps is None or self.answers.gap is None:
            missing = cannot_say(self.answers.no_gap)
            return {"obstacle": missing, "mutual_information": missing}
        real = self.answers.symbols("real", level)
        have = real != ABSENT
        if not have.any():
            missing = cannot_say("no answers to real pictures")
            return {"obstacle": missing, "mutual_information": missing}
        near = _Coded((gaps[have] < self.answers.gap.threshold).astype(np.int64), ("far", "near"))
        answer = self._coded(real[have])
        obstacle = self._table(answer, near, self._episodes[have], f"obstacle.{level}")
        return {"obstacle": obstacle, "mutual_information": self._information(answer, gaps[have], have, level)}

    def _information(self, real: "_Coded", gaps: Floats, have: Mask, level: str) -> Statistic:
        bins = quantile_bins(gaps)
        made = contingency(real.codes, bins.codes)
        name = f"mutual_information.{level}"
        found = permute_mutual_information(made.table, seed=self.how.seed_of(name), resamples=self.how.resamples)
        sums = _counts_by_episode(real.codes, bins.codes, self._episodes[have])
        shape = made.table.shape
        interval = self._bootstrap(sums, lambda tables: information_of_tables(tables.reshape(-1, *shape)), name)
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
        return replace(found, ci=interval.ci, method=f"{found.method}; {interval.method}", detail=detail)

    def _swap(self) -> Statistic:
        partner = self.answers.partners
        if not partner:
            return cannot_say("no action of this space exchanges under reflection")
        if all(frame.mirror_axis == "none" for frame in self.answers.frames):
            return cannot_say("no frame of the bank has a mirror axis")
        real, mirrored = self.answers.actions("real"), self.answers.responses("mirrored")
        have = (real != ABSENT) & (mirrored != ABSENT)
        if not have.any():
            return cannot_say("no frame has an answer both to its real and to its mirrored picture")
        seed = self.how.seed_of("mirror_swap_rate")
        return swap_test(real[have], mirrored[have], partner, seed=seed, resamples=self.how.resamples)

    def _gap_order(self) -> Statistic:
        gaps, gap, space = self.answers.gaps, self.answers.gap, self.answers.space
        if gaps is None or gap is None:
            return cannot_say(self.answers.no_gap)
        real = self.answers.actions("real")
        finite = gaps[np.isfinite(gaps)]
        capped = np.where(np.isfinite(gaps), gaps, finite.max() if finite.size else 0.0)
        role = np.array([ABSENT if action == ABSENT else space.role(action) for action in real])
        medians = {str(action): float(np.median(capped[real == action])) for action in np.unique(real[real != ABSENT])}
        detail: dict[str, object] = {"median_by_action": medians, "no_lead_counts_as": "the farthest gap"}
        n = int(np.count_nonzero(role != ABSENT))
        if not ((role == "brake").any() and (role == "proceed").any()):
            why = "the model never brakes or never proceeds"
            return replace(cannot_say(why, n, "median gap, proceed minus brake"), detail=detail)
        found = self._bootstrap_medians(capped, role == "proceed", role == "brake")
        method = f"median gap, proceed minus brake; {found.method}"
        return replace(found, n=n, method=method, detail=detail, unit=gap.unit)

    def _diversity(self) -> Statistics:
        real = self.answers.actions("real")
        have = real != ABSENT
        found = {"modal_share": modal_share(real[have]), "entropy": entropy_bits(real[have])}
        answer = self._coded(real)
        if not have.any():
            return found
        sums = _counts_by_episode(np.zeros(int(have.sum()), dtype=np.int64), answer.codes[have], self._episodes[have])
        entropy = self._bootstrap(sums, entropy_of_counts, "entropy")
        counts = dict(zip(*(each.tolist() for each in np.unique(real[have], return_counts=True)), strict=True))
        common, mode = found["modal_share"], max(counts, key=lambda label: counts[label])
        often = self._over_episodes((real[have] == mode).astype(np.float64), self._episodes[have])
        method, detail = f"{common.method}; {often.method}", {**(common.detail or {}), "counts": counts}
        found["modal_share"] = replace(common, ci=often.ci, method=method, note=often.note, detail=detail)
        found["entropy"] = replace(found["entropy"], ci=entropy.ci)
        return found

    def _share(self, hits: Floats, have: Mask) -> Statistic:
        if not have.any():
            return cannot_say("no frame has both answers")
        return self._over_episodes(hits, self._episodes[have])

    def _over_episodes(self, hits: Floats, episodes: Codes) -> Statistic:
        """Return a share of frames with its interval over episodes; of one episode it is marked, and over frames."""
        k, n = int(hits.sum()), len(hits)
        sums = _sums_by_episode(np.column_stack([hits, np.ones(n)]), episodes)
        detail = {"k": k, "episodes": len(sums)}
        if not self.how.intervals:
            return replace(rate(k, n), detail=detail)
        found = share_over_episodes(sums[:, 0], sums[:, 1])
        if found.ci is None:
            return replace(rate(k, n), note=ONE_EPISODE, detail=detail)
        return found

    def _difference(self, one: Floats, have_one: Mask, other: Floats, have_other: Mask, name: str) -> Statistic:
        if not have_one.any() or not have_other.any():
            return cannot_say("no frame has both answers")
        columns = np.zeros((len(have_one), 4))
        columns[have_one, 0], columns[:, 1] = one, have_one
        columns[have_other, 2], columns[:, 3] = other, have_other
        sums = _sums_by_episode(columns, self._episodes)
        found = self._bootstrap(sums, lambda s: ratio_of_sums(s[:, :2]) - ratio_of_sums(s[:, 2:]), name)
        if found.ci is None:
            paired = have_one & have_other
            tango = paired_difference(columns[paired, 0], columns[paired, 2])
            found = replace(found, ci=tango.ci, method=f"{tango.method}; {found.method}")
        return replace(found, value=float(one.mean() - other.mean()), n=len(one), detail=None)

    def _bootstrap(self, sums: Floats, statistic: Callable[[Floats], Floats], name: str) -> Statistic:
        if not self.how.intervals:
            return _without_interval(len(sums), statistic(sums.sum(axis=0, keepdims=True)))
        seed = self.how.seed_of(name)
        found = cluster_bootstrap(sums, statistic, seed=seed, resamples=self.how.resamples, enumerate_up_to=ENUMERATE)
        if found.ci is not None and found.ci[0] == found.ci[1]:
            # No width would claim certainty; it only says that no episode differs from another.
            return replace(found, ci=None, note="the episodes do not differ, so resampling them shows no spread")
        return found

    def _bootstrap_medians(self, values: Floats, one: Mask, other: Mask) -> Statistic:
        """Return median(values[one]) - median(values[other]) with its interval over the episodes of either."""
        used = one | other
        numbers, episodes = np.unique(self._episodes[used], return_inverse=True)
        values, one, other = values[used], one[used], other[used]

        def apart(counts: Floats) -> Floats:
            return median_by_counts(values[one], episodes[one], counts) - median_by_counts(
                values[other], episodes[other], counts
            )

        if not self.how.intervals:
            return _without_interval(len(numbers), apart(np.ones((1, len(numbers)))))
        return episode_bootstrap(
            len(numbers),
            apart,
            seed=self.how.seed_of("gap_order"),
            resamples=self.how.resamples,
            enumerate_up_to=ENUMERATE,
        )


def median_gaps(answers: Answers, *, resamples: int = 5000) -> Statistics:
    """Return the median true gap of each action on real frames, resampled over episodes; none without gaps.

    A frame without a lead counts as the farthest. Source: paper, Table t:qwenorder.
    """
    if answers.gaps is None or answers.gap is None:
        return {}
    finite = answers.gaps[np.isfinite(answers.gaps)]
    capped = np.where(np.isfinite(answers.gaps), answers.gaps, finite.max() if finite.size else 0.0)
    real, found = answers.actions("real"), {}
    for action in map(str, np.unique(real[real != ABSENT])):
        mine = real == action
        numbers, episodes = np.unique(answers.episodes[mine], return_inverse=True)
        median = float(np.median(capped[mine]))
        one = episode_bootstrap(
            len(numbers),
            partial(median_by_counts, capped[mine], episodes),
            seed=key_seed("median gap", action),
            resamples=resamples,
            enumerate_up_to=ENUMERATE,
        )
        found[action] = replace(one, value=median, n=int(mine.sum()), unit=answers.gap.unit)
    return found


class _Coded(NamedTuple):
    """Labels as numbers, with the name of each number."""

    codes: Codes
    names: tuple[str, ...]

    def where(self, have: Mask) -> "_Coded":
        """Return the labels of some frames."""
        return _Coded(self.codes[have], self.names)

    def named(self, codes: Sequence[str | int]) -> tuple[str, ...]:
        """Return the names of some numbers."""
        return tuple(self.names[int(code)] for code in codes)


def refusal_effect(response: Statistic, decision: Statistic) -> Statistic:
    """Return 1 where answers depend on the condition at response level only (a refusal effect), else 0."""
    method = "significant at response level and not at decision level (alpha .05)"
    if response.p is None or decision.p is None:
        return cannot_say("one of the two tests could not be made", response.n, method)
    return Statistic(float(response.p < ALPHA <= decision.p), response.n, method=method)


def _clears(idi: Statistic, floor: Statistic) -> Statistic:
    method = "1 where IDI > 1.5 s, strictly"
    if idi.value is None or floor.value is None:
        return cannot_say("IDI or the noise floor could not be measured", method=method)
    return Statistic(float(clears_floor(idi.value, floor.value)), idi.n, method=method)


def _without_interval(episodes: int, values: Floats) -> Statistic:
    """Return what the bootstrap returns, but for its interval."""
    method = "no interval asked for"
    if math.isnan(values[0]):
        return cannot_say("the statistic is undefined on these episodes", episodes, method)
    return Statistic(float(values[0]), episodes, method=method)


def _sums_by_episode(columns: Floats, episodes: Codes) -> Floats:
    """Return what each episode that occurs adds up to, shape (episodes, columns)."""
    _, codes = np.unique(episodes, return_inverse=True)
    return np.stack([np.bincount(codes, weights=column) for column in columns.T], axis=1)


def _counts_by_episode(rows: Codes, columns: Codes, episodes: Codes) -> Floats:
    """Return the flat table of counts of each episode that occurs, shape (episodes, rows × columns)."""
    _, e = np.unique(episodes, return_inverse=True)
    names_r, r = np.unique(rows, return_inverse=True)
    names_c, c = np.unique(columns, return_inverse=True)
    cells = len(names_r) * len(names_c)
    flat = np.bincount(e * cells + r * len(names_c) + c, minlength=(int(e.max()) + 1) * cells)
    return flat.reshape(-1, cells).astype(np.float64)
