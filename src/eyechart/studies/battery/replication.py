"""Whether two runs of one battery agree: each statistic's difference, with a randomisation test.

If nothing changed, a frame's replies in both runs come from the same distribution. Then each
frame's replies may be exchanged between the runs, all conditions together. This gives every
difference an exact null distribution (Fisher's randomisation test), whatever the frames have in
common.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from eyechart.conditions import BATTERY
from eyechart.errors import SpecError
from eyechart.seeds import key_seed
from eyechart.spaces.space import UNPARSED
from eyechart.stats.association import cramers_v_of_tables, entropy_of_counts, information_of_tables, quantile_bins
from eyechart.stats.episodes import share_over_episodes
from eyechart.stats.jackknife import over_counts
from eyechart.stats.resamples import permutation_p, ratio_of_sums
from eyechart.stats.statistic import Statistic, not_available
from eyechart.studies.battery.answers import ABSENT, Answers

Codes = NDArray[np.int16]
Floats = NDArray[np.float64]
Measure = Callable[[Codes, Floats], Floats]
"""Maps answers (m, conditions, frames), -1 for none, and weights (m, frames) to values (m,)."""

_CHUNK_BYTES = 64_000_000
_METHOD = "second run minus first; two-sided randomisation test that exchanges the runs within a frame"


@dataclass(frozen=True, slots=True, kw_only=True)
class StatisticDifference(Statistic):
    """The difference of a statistic between two runs, with its value in each."""

    first: float
    second: float


def differences(first: Answers, second: Answers, *, seed: int = 0, resamples: int = 2000) -> dict[str, Statistic]:
    """Return each statistic's difference between two runs of one model, by its name.

    A value is the second run's minus the first's, over the frames and conditions of both; its
    interval is over the episodes of both runs together.

    Two entries are no differences. ``across_runs`` is the share of real pictures with the same
    answer in both runs; compare it with ``agree.real_repeat``, the same within one run.
    ``answer_shift`` is the total variation distance between the runs' answers to real pictures. It
    is needed because most statistics ignore which answer was given: they cannot tell always STOP
    from always LEFT.

    Raises SpecError where the two have no frame in common, or different action spaces.
    """
    pair = _Pair(first, second, seed, resamples)
    statistics: dict[str, Statistic] = {}
    for level, suffix in (("response", ""), ("decision", ".decision")):
        codes = pair.codes(level)
        measures = {**pair.agreements(), **pair.dependence()}
        statistics |= {
            f"{name}{suffix}": pair.test(codes, measure, f"{name}.{level}") for name, measure in measures.items()
        }
    statistics["unparsed_rate"] = pair.test(pair.codes("response"), pair.unparsed, "unparsed_rate")
    statistics["mirror_swap_rate"] = pair.test(pair.codes("response"), pair.swaps, "mirror_swap_rate")
    for name, measure in pair.diversity().items():
        statistics[name] = pair.test(pair.codes("decision"), measure, name)
    return {"across_runs": pair.across(), "answer_shift": pair.shift(), **statistics}


@dataclass(frozen=True)
class _Pair:
    """Two runs' answers of one model about their common frames."""

    first: Answers
    second: Answers
    seed: int
    resamples: int

    def __post_init__(self) -> None:
        if self.first.space != self.second.space:
            raise SpecError("the two runs have different action spaces, so their answers cannot be compared")
        if not self._places[0]:
            raise SpecError("the two runs have no frame in common; a replication needs the same frames")

    @cached_property
    def _places(self) -> tuple[list[int], list[int]]:
        there = {frame.id: place for place, frame in enumerate(self.second.frames)}
        common = [(place, there[frame.id]) for place, frame in enumerate(self.first.frames) if frame.id in there]
        return [one for one, _ in common], [other for _, other in common]

    @cached_property
    def _names(self) -> tuple[str, ...]:
        return (*dict.fromkeys((*self.first.names, *self.second.names)), UNPARSED)

    @cached_property
    def _row(self) -> Mapping[str, int]:
        return {name: row for row, name in enumerate(BATTERY)}

    @cached_property
    def _episodes(self) -> NDArray[np.int64]:
        episodes = self.first.episodes[self._places[0]]
        return np.unique(episodes, return_inverse=True)[1].astype(np.int64)

    def codes(self, level: str) -> Codes:
        """Return both runs' answers as codes (2, conditions, frames), -1 where either has none."""
        out = np.full((2, len(BATTERY), len(self._places[0])), -1, dtype=np.int16)
        in_both = np.ones(out.shape[1:], dtype=bool)
        for run, (answers, places) in enumerate(zip((self.first, self.second), self._places, strict=True)):
            for name, row in self._row.items():
                symbols = answers.symbols(name, level)[places]
                in_both[row] &= answers.responses(name)[places] != ABSENT
                for code, symbol in enumerate(self._names):
                    out[run, row, symbols == symbol] = code
        out[:, ~in_both] = -1
        return out

    def test(self, codes: Codes, measure: Measure, name: str) -> Statistic:
        """Return a statistic's difference between the runs, with interval over episodes and p."""
        frames = codes.shape[2]
        even = np.ones((1, frames))
        first, second = (float(measure(codes[run : run + 1], even)[0]) for run in (0, 1))
        n = int((codes >= 0).all(axis=0).any(axis=0).sum())
        if np.isnan(first) or np.isnan(second):
            return not_available("one of the two runs cannot say", n, _METHOD)
        interval = over_counts(int(self._episodes.max()) + 1, lambda counts: self._resampled(codes, measure, counts))
        p = self._p(codes, measure, second - first, name)
        ci, note = interval.ci, interval.note
        method = f"{_METHOD}, B={self.resamples}; {interval.method}"
        return StatisticDifference(second - first, n, ci, p, method, note, first=first, second=second)

    def _resampled(self, codes: Codes, measure: Measure, counts: Floats) -> Floats:
        parts = []
        for rows in self._chunks(len(counts), codes):
            weights = np.asarray(counts[rows], dtype=np.float64)[:, self._episodes]
            one, other = (
                measure(np.broadcast_to(codes[run], (len(weights), *codes.shape[1:])), weights) for run in (0, 1)
            )
            parts.append(other - one)
        return np.concatenate(parts)

    def _p(self, codes: Codes, measure: Measure, observed: float, name: str) -> float:
        if (codes[0] == codes[1]).all():
            return 1.0
        rng = np.random.default_rng(key_seed("compare", self.seed, name, "exchange"))
        frames, reached, undefined = codes.shape[2], 0, 0
        for rows in self._chunks(self.resamples, codes):
            swap = rng.integers(0, 2, size=(rows.stop - rows.start, 1, frames), dtype=np.int8).astype(bool)
            even = np.ones((len(swap), frames))
            one = measure(np.where(swap, codes[1], codes[0]), even)
            other = measure(np.where(swap, codes[0], codes[1]), even)
            gap = np.abs(other - one)
            undefined += int(np.isnan(gap).sum())
            reached += int((gap >= abs(observed) - 1e-12).sum())
        # An exchange with an undefined statistic counts as one that reaches it, to be on the safe
        # side.
        return permutation_p(reached + undefined, self.resamples)

    def _chunks(self, rows: int, codes: Codes) -> Iterator[slice]:
        step = max(1, _CHUNK_BYTES // (codes[0].size * (len(self._names) + 2) * 8))
        for start in range(0, rows, step):
            yield slice(start, min(start + step, rows))

    def agreements(self) -> dict[str, Measure]:
        """Return the agreement of each condition with real, and the indices derived from it."""
        real = self._row["real"]

        def agree(row: int, codes: Codes, weights: Floats) -> Floats:
            both = (codes[:, real] >= 0) & (codes[:, row] >= 0)
            same = both & (codes[:, real] == codes[:, row])
            return _ratio((same * weights).sum(axis=1), (both * weights).sum(axis=1))

        agreements: dict[str, Measure] = {
            f"agree.{name}": partial(agree, row) for name, row in self._row.items() if name != "real"
        }
        blank, repeat = agreements["agree.blank"], agreements["agree.real_repeat"]
        return {
            **agreements,
            "noise_floor": lambda codes, weights: 1 - repeat(codes, weights),
            "idi": lambda codes, weights: 1 - blank(codes, weights),
            "idi_adj": lambda codes, weights: repeat(codes, weights) - blank(codes, weights),
        }

    def dependence(self) -> dict[str, Measure]:
        """Return Cramér's V over conditions and, with a gap, information and the obstacle's V."""

        def over_conditions(codes: Codes, weights: Floats) -> Floats:
            return cramers_v_of_tables(
                np.stack([self._counts(codes[:, row], weights) for row in range(codes.shape[1])], axis=1)
            )

        result: dict[str, Measure] = {"cramers_v": over_conditions}
        if self.first.gaps is None or self.first.gap is None:
            return result
        gaps, real = self.first.gaps[self._places[0]], self._row["real"]
        bins, near = quantile_bins(gaps).codes, (gaps < self.first.gap.threshold).astype(np.int64)

        def by(groups: NDArray[np.int64], codes: Codes, weights: Floats) -> Floats:
            kinds = range(int(groups.max()) + 1)
            return np.stack([self._counts(codes[:, real], weights * (groups == kind)) for kind in kinds], axis=1)

        return {
            **result,
            "mutual_information": lambda codes, weights: information_of_tables(by(bins, codes, weights)),
            "obstacle": lambda codes, weights: cramers_v_of_tables(by(near, codes, weights)),
        }

    def _counts(self, answers: Codes, weights: Floats) -> Floats:
        """Return the weight of each answer, shape (m, answers)."""
        return np.stack([((answers == code) * weights).sum(axis=1) for code in range(len(self._names))], axis=1)

    def unparsed(self, codes: Codes, weights: Floats) -> Floats:
        """Return the share of the calls that hold no decision."""
        missing = ((codes == len(self._names) - 1) * weights[:, None]).sum(axis=(1, 2))
        return _ratio(missing, ((codes >= 0) * weights[:, None]).sum(axis=(1, 2)))

    def swaps(self, codes: Codes, weights: Floats) -> Floats:
        """Return the mirror swap rate: the share of real turns that the reflection swaps."""
        partners, turns = self.first.partners, [self.first.space.turn(name) for name in self._names[:-1]]
        kinds = list(dict.fromkeys(turns))
        kind = np.array([*map(kinds.index, turns), -2, -3])
        partner = np.array([kinds.index(partners.get(turn, turn)) for turn in kinds])
        real, mirrored = kind[codes[:, self._row["real"]]], codes[:, self._row["mirrored"]]
        comparable = np.isin(real, [kinds.index(turn) for turn in partners]) & (mirrored >= 0)
        swapped = comparable & (partner[real] == kind[mirrored])
        return _ratio((swapped * weights).sum(axis=1), (comparable * weights).sum(axis=1))

    def diversity(self) -> dict[str, Measure]:
        """Return the modal share and the entropy of the decisions on real pictures."""
        real = self._row["real"]

        def entropy(codes: Codes, weights: Floats) -> Floats:
            return entropy_of_counts(self._counts(codes[:, real], weights))

        def modal(codes: Codes, weights: Floats) -> Floats:
            counts = self._counts(codes[:, real], weights)
            return _ratio(counts.max(axis=1), counts.sum(axis=1))

        return {"modal_share": modal, "entropy": entropy}

    def shift(self) -> Statistic:
        """Return the total variation distance of answers to real pictures, with its p."""
        codes = self.codes("response")[:, self._row["real"]]
        codes = codes[:, (codes >= 0).all(axis=0)]
        n, method = codes.shape[1], f"total variation distance of answers to real pictures, B={self.resamples}"
        if not n:
            return not_available("no real picture was answered in both runs", method=method)
        one, other = (np.eye(len(self._names))[codes[run]] for run in (0, 1))
        moved = one - other
        rng = np.random.default_rng(key_seed("compare", self.seed, "answer_shift", "exchange"))
        signs = rng.choice([-1.0, 1.0], size=(self.resamples, n))
        distances = np.abs(signs @ moved).sum(axis=1) / (2 * n)
        value = float(np.abs(moved.sum(axis=0)).sum() / (2 * n))
        p = permutation_p(int((distances >= value - 1e-12).sum()), self.resamples)
        return Statistic(value, n, p=p, method=method, detail={"expected_by_chance": float(distances.mean())})

    def across(self) -> Statistic:
        """Return the share of real pictures with equal answers, with its interval over episodes."""
        codes = self.codes("response")[:, self._row["real"]]
        both = (codes >= 0).all(axis=0)
        if not both.any():
            return not_available("no real picture was answered in both runs")
        same = both & (codes[0] == codes[1])
        hits, frames = (np.bincount(self._episodes, weights=one) for one in (same, both))
        statistic = share_over_episodes(hits, frames)
        return Statistic(
            statistic.value,
            statistic.n,
            statistic.ci,
            method=f"agreement across the runs; {statistic.method}",
            note=statistic.note,
        )


def _ratio(above: Floats, below: Floats) -> Floats:
    return ratio_of_sums(np.column_stack([above, below]))
