"""How often the printed intervals that are of no single share hold a known truth: part of make long-coverage.

    python benchmarks/coverage_kinds.py --sets 1000

Differences of shares, balanced accuracy, shares of some frames (swaps, answered frames), information, Cramér's V,
entropy, medians and their differences, a mean error, differences of two runs, and T, over 6, 12 and 24 episodes.
Answers of an episode resemble one another: their chances are drawn for each episode around the model's, with the
correlation that a row names. An interval must hold the truth in at most .02 fewer data sets than its level says, and
its own value in all of them. Each finished row is written to ``benchmarks/results/coverage.json`` under ``others``, so
that an interrupted run goes on; other code or another number of data sets begins anew. Exit 1 where a row fails.
"""

import argparse
import datetime as dt
import hashlib
import json
import sys
from collections.abc import Callable, Iterator
from functools import partial
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import stats

from eyechart import __version__
from eyechart.stats import association, episodes, jackknife, total_effect
from eyechart.stats.association import cramers_v_of_tables, entropy_of_counts, information_of_tables
from eyechart.stats.statistic import Statistic

Floats = npt.NDArray[np.float64]
Of = Callable[[Floats], Floats]
Counts = npt.NDArray[np.int64]
Generator = np.random.Generator

RESULT = Path(__file__).parent / "results" / "coverage.json"
EPISODES, FRAMES, SHORT = (6, 12, 24), 12, 0.02
SIDES = np.eye(5)[:4]
READERS: dict[str, Callable[[float], Floats]] = {
    "reader of five": lambda w: w * SIDES + (1 - w) / 5,
    "reader of two": lambda w: w * np.repeat(np.eye(2), 2, axis=0) + (1 - w) / 2,
    "rare brake": lambda w: np.array([[0.5, 0.5, 0.0]] + [[1 - (1 - w) / 5, (1 - w) / 5, 0.0]] * 3),
}
SIGHT: dict[str, Callable[[float], Floats]] = {
    "eight conditions": lambda w: w * np.array([[0.2] * 5] * 2 + [[0.0, 0.0, 1.0, 0.0, 0.0]] * 6) + (1 - w) / 5,
    "two conditions": lambda w: w * np.array([[0.4, 0.3, 0.2, 0.1, 0.0], [1.0, 0.0, 0.0, 0.0, 0.0]]) + (1 - w) / 5,
    "two by two": lambda w: np.array([[1 + w, 1 - w], [1 - w, 1 + w]]) / 2,
}


class Row(NamedTuple):
    """What is measured: a name, the truth, and one data set's statistic made from a generator."""

    key: str
    truth: float
    made: Callable[[Generator], Statistic]


def counts_of(rng: Generator, count: int, rate: float, icc: float, frames: Counts | int = FRAMES) -> Floats:
    """Return hits of each episode whose own rate is drawn around a rate, shape (episodes,)."""
    if icc and 0 < rate < 1:
        return rng.binomial(frames, rng.beta(rate * (1 / icc - 1), (1 - rate) * (1 / icc - 1), count)).astype(float)
    return rng.binomial(frames, np.full(count, rate)).astype(float)


def tables_of(rng: Generator, count: int, chances: Floats, frames: int, icc: float) -> Floats:
    """Return each episode's table of what is shown × answers, shape (episodes, rows, columns)."""
    own = np.broadcast_to(chances, (count, *chances.shape))
    if icc:
        own = rng.gamma(np.maximum(chances * (1 / icc - 1), 1e-9), size=own.shape) + 1e-300
        own = own / own.sum(axis=2, keepdims=True)
    return rng.multinomial(frames, own).astype(float)


PAIRS = ((0.5, 0.0), (0.5, 0.05), (0.9, 0.1), (1.0, 0.05), (1.0, 0.01), (0.3, 0.3), (0.7, 0.4), (0.2, 0.02), (0.1, 0.1))
SIDED = ((0.95, 0.95), (0.9, 0.99), (0.7, 0.8), (0.5, 0.5), (0.99, 0.99))


def shares() -> Iterator[Row]:
    """Yield differences of shares, balanced accuracy, and shares of only some frames."""
    for n, icc in product(EPISODES, (0.1, 0.3)):
        at = f"{n} episodes, ICC {icc:g}"
        for a, b in PAIRS:
            yield Row(f"difference, {at}, {a:g} less {b:g}", a - b, partial(less, n, icc, (a, b)))
        for a, b in SIDED:
            yield Row(f"balanced accuracy, {at}, {a:g} and {b:g}", (a + b) / 2, partial(balanced, n, icc, (a, b)))
        for rate in (0.05, 0.3, 0.6, 0.95):
            yield Row(f"share of some frames, {at}, rate {rate:g}", rate, partial(some, n, icc, rate))


def less(n: int, icc: float, rates: tuple[float, float], rng: Generator) -> Statistic:
    """Return the difference of two shares of the same episodes."""
    every = np.full(n, float(FRAMES))
    one, other = (counts_of(rng, n, rate, icc) for rate in rates)
    return episodes.difference_over_episodes((one, every), (other, every))


def balanced(n: int, icc: float, rates: tuple[float, float], rng: Generator) -> Statistic:
    """Return balanced accuracy of episodes; who does well in one does so on both sides."""
    quality, beta, near, sides = rng.random(n), 1 / icc - 1, rng.binomial(FRAMES, 0.5, n), []
    for rate, frames in zip(rates, (near, FRAMES - near), strict=True):
        own = stats.beta.ppf(quality, rate * beta, (1 - rate) * beta)
        sides.append((rng.binomial(frames, own), frames))
    return episodes.mean_of_shares(*sides)


def some(n: int, icc: float, rate: float, rng: Generator) -> Statistic:
    """Return a share of frames of which some episodes have many and some none, as of turns."""
    frames = rng.binomial(FRAMES, rng.beta(1, 1, n))
    frames[0] = max(frames[0], 1)
    return episodes.share_over_episodes(counts_of(rng, n, rate, icc, frames), frames)


def dependences() -> Iterator[Row]:
    """Yield information, entropy and Cramér's V."""
    for n, icc in product(EPISODES, (0.0, 0.1, 0.3, 0.5)):
        at = f"{n} episodes, ICC {icc:g}"
        for (name, make), w in product(READERS.items(), (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 0.95)):
            chances = make(w)
            top = float(np.log2(chances.shape[1]))
            for what, of, most in (("information", information_of_tables, min(2.0, top)), ("entropy", entropy, top)):
                truth = float(of(1e9 * chances[None])[0])
                yield Row(f"{what}, {at}, {name} {w:g}", truth, partial(told, n, icc, chances, of, most))
        for (name, make), w in product(SIGHT.items(), (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 0.97)):
            truth = float(cramers_v_of_tables(1e9 * make(w)[None], correction=False)[0])
            yield Row(f"Cramér's V, {at}, {name} {w:g}", truth, partial(associated, n, icc, make(w)))


def told(n: int, icc: float, chances: Floats, of: Of, most: float, rng: Generator) -> Statistic:
    """Return information or entropy of answers to pictures of four gaps, as often each."""
    return jackknife.over_tables(tables_of(rng, n, chances, FRAMES // 4, icc), of, most)


def associated(n: int, icc: float, chances: Floats, rng: Generator) -> Statistic:
    """Return Cramér's V of what is shown and the answers, as a score has it."""
    frames = FRAMES // 2 if chances.shape == (2, 2) else FRAMES
    tables = tables_of(rng, n, chances, frames, icc)
    seen = tables[..., tables.any(axis=(0, 1))]
    return jackknife.association_interval(seen, association.cramers_v(seen.sum(axis=0)).value or 0.0)


def entropy(tables: Floats) -> Floats:
    """Return the entropy of the answers of each table."""
    return entropy_of_counts(tables.sum(axis=1))


def numbers() -> Iterator[Row]:
    """Yield medians and their differences, a mean error, differences of two runs, and T."""
    for n in EPISODES:
        for icc in (0.0, 0.1, 0.3, 0.6):
            at = f"{n} episodes, ICC {icc:g}"
            yield Row(f"median, {at}", 1.0, partial(gaps, n, icc, 1.0))
            yield Row(f"difference of medians, {at}", 2.0, partial(apart, n, icc))
        for icc in (0.1, 0.3):
            at = f"{n} episodes, ICC {icc:g}"
            yield Row(f"mean error, {at}", float(np.sqrt(2 / np.pi)), partial(error, n, icc))
            for w in (0.0, 0.4, 0.8):
                yield Row(f"information, second run less first, {at}, {w:g}", 0.0, partial(runs, n, icc, w))
        for share, icc in product((0.05, 0.2, 0.5, 0.8, 0.95), (0.1, 0.5)):
            yield Row(f"T, {n} episodes, ICC {icc:g}, {share:g}", share, partial(effect_of, n, icc, share))


def gaps(n: int, icc: float, scale: float, rng: Generator) -> Statistic:
    """Return the median of gaps whose logarithm is normal, half of the frames of each episode."""
    owner = np.repeat(np.arange(n), FRAMES // 2)
    spread = np.sqrt(icc) * rng.normal(size=n)[owner] + np.sqrt(1 - icc) * rng.normal(size=len(owner))
    return episodes.median_over_episodes(scale * np.exp(spread), owner)


def apart(n: int, icc: float, rng: Generator) -> Statistic:
    """Return the difference of two medians."""
    return episodes.median_difference(gaps(n, icc, 3.0, rng), gaps(n, icc, 1.0, rng))


def error(n: int, icc: float, rng: Generator) -> Statistic:
    """Return the mean absolute error of normal estimates."""
    own = np.abs(np.sqrt(icc) * rng.normal(size=(n, 1)) + np.sqrt(1 - icc) * rng.normal(size=(n, 9)))
    return jackknife.mean_over_episodes(np.column_stack([own.sum(axis=1), np.full(n, 9.0)]))


def runs(n: int, icc: float, w: float, rng: Generator) -> Statistic:
    """Return how much more information a second run of one model has."""
    one, other = (tables_of(rng, n, READERS["reader of five"](w), FRAMES // 4, icc) for _ in range(2))
    first, second = (partial(_weighted, each) for each in (one, other))
    return jackknife.over_counts(n, lambda counts: second(counts) - first(counts))


def _weighted(tables: Floats, counts: Floats) -> Floats:
    return information_of_tables(np.einsum("me,erc->mrc", counts, tables))


def effect_of(count: int, icc: float, share: float, rng: Generator) -> Statistic:
    """Return T of a policy that adds what two channels tell; a frame's partner is of another episode."""
    owner = np.repeat(np.arange(count), FRAMES)
    seen, rest = (
        np.sqrt(icc) * rng.normal(size=count)[owner] + np.sqrt(1 - icc) * rng.normal(size=len(owner)) for _ in range(2)
    )
    turn = rng.integers(1, count, len(owner))
    partner = (owner + turn) % count * FRAMES + rng.integers(FRAMES, size=len(owner))
    answers = np.sqrt(share) * seen + np.sqrt(1 - share) * rest
    moved = total_effect.Pairs(share * (seen - seen[partner]) ** 2 / 2, owner, owner[partner])
    varied = total_effect.Pairs((answers - answers[partner]) ** 2 / 2, owner, owner[partner])
    return total_effect.total_effect(moved, varied)


def rows() -> list[Row]:
    """Return every row, all of them required."""
    return [*shares(), *dependences(), *numbers()]


def measure(row: Row, sets: int) -> dict[str, object]:
    """Return how often the intervals of a row hold the truth and their own value, how many are given, and how wide."""
    rng = np.random.default_rng([2026, *hashlib.sha256(row.key.encode()).digest()[:8]])
    found = [row.made(rng) for _ in range(sets)]
    given = [(one.value, *one.ci) for one in found if one.ci is not None and one.value is not None]
    value, low, high = np.array(given).reshape(-1, 3).T
    slack = 1e-9
    told = {
        "coverage": ((low - slack <= row.truth) & (row.truth <= high + slack)).mean() if given else 1.0,
        "own_value": ((low <= value) & (value <= high)).mean() if given else 1.0,
        "width": (high - low).mean() if given else 0.0,
    }
    return {"level": found[0].level, "given": len(given), **{name: round(float(one), 4) for name, one in told.items()}}


def fails(found: dict[str, object]) -> bool:
    """Return whether a row covers too seldom, or an interval excludes its own value."""
    level, coverage, own = (float(str(found[name])) for name in ("level", "coverage", "own_value"))
    return coverage < round(level - SHORT, 6) or own < 1


def main() -> int:
    """Measure the rows that are missing; return 1 where one fails."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=1000, help="data sets a row (default: 1000)")
    sets = parser.parse_args().sets
    modules = (association, episodes, jackknife, total_effect)
    sources = b"".join(Path(str(module.__file__)).read_bytes() for module in modules) + Path(__file__).read_bytes()
    code = hashlib.sha256(sources).hexdigest()[:16]
    whole = json.loads(RESULT.read_text())
    others = whole.get("others", {})
    if (others.get("code"), others.get("sets")) != (code, sets):
        others = {"version": __version__, "date": "", "code": code, "sets": sets, "failing": None, "rows": {}}
    for place, row in enumerate(every := rows()):
        if row.key not in others["rows"]:
            others["rows"][row.key] = measure(row, sets)
            if fails(others["rows"][row.key]):
                print(row.key, others["rows"][row.key], flush=True)
            if place % 20 == 0:
                write(whole, others)
    others["failing"] = [row.key for row in every if fails(others["rows"][row.key])]
    write(whole, others)
    print(f"{len(every)} rows of {sets} data sets; failing: {others['failing'] or 'none'}")
    return 1 if others["failing"] else 0


def write(whole: dict[str, object], others: dict[str, object]) -> None:
    """Write the result whole or not at all."""
    others["date"] = dt.datetime.now(tz=dt.UTC).date().isoformat()
    part = RESULT.with_suffix(".part")
    part.write_text(json.dumps({**whole, "others": others}, indent=1) + "\n")
    part.replace(RESULT)


if __name__ == "__main__":
    sys.exit(main())
