"""How often intervals of a share over frames in episodes hold a known truth, and how wide they are.

    make long-coverage
    python benchmarks/long_coverage.py --sets 2000

The model: an episode's rate is drawn from a beta distribution of a mean (the rate) and a correlation within the episode
(ICC); each of its 12 frames is a hit with that rate. What `score` shows, `share_over_episodes`, must hold the rate in
at least .93 of the data sets of every row, at a mean width of at most 1.6 times that of Wilson's interval for a known
ICC, whose n is frames / (1 + 11 ICC). Beside it stand the ways that were not taken, and rows outside the requirement:
no correlation, strong correlation, 3 episodes, 48 episodes, and episodes of unequal length whose rate goes with it.

Each finished row is written to ``benchmarks/results/coverage.json``, so that an interrupted run goes on where it
stopped; another version of the interval or another number of data sets begins anew. Exit 1 where a required row fails.
"""

import argparse
import datetime as dt
import hashlib
import json
import sys
from pathlib import Path
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import special, stats

from eyechart import __version__
from eyechart.stats import episodes as measured
from eyechart.stats.episodes import share_over_episodes

Floats = npt.NDArray[np.float64]
Pair = tuple[Floats, Floats]

ROOT = Path(__file__).parents[1]
RESULT = ROOT / "benchmarks" / "results" / "coverage.json"
FRAMES, LEVEL, Z = 12, 0.95, NormalDist().inv_cdf(0.975)
COVERAGE, WIDTH = 0.93, 1.6
RATES = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95)
BESIDE = ("percentile", "t", "wilson_t", "korn_graubard", "profile", "bayes")


class Row(NamedTuple):
    """A rate, the correlation within an episode, and how many episodes; ``unequal`` ones have 2 to 22 frames."""

    episodes: int
    icc: float
    rate: float
    required: bool = True
    unequal: bool = False

    @property
    def key(self) -> str:
        """Return the row's name in the result."""
        return f"{self.episodes} episodes, ICC {self.icc:g}, rate {self.rate:g}" + ", unequal" * self.unequal


def rows() -> list[Row]:
    """Return the required rows, then the others."""
    inside = [Row(n, icc, rate) for n in (6, 12, 24) for icc in (0.1, 0.3, 0.5) for rate in RATES]
    some, beyond = (0.05, 0.2, 0.5, 0.8, 0.95), []
    beyond += [Row(12, icc, rate, required=False) for icc in (0.0, 0.02, 0.7, 0.9) for rate in some]
    beyond += [Row(n, 0.3, rate, required=False) for n in (3, 48) for rate in some]
    beyond += [Row(n, 0.3, rate, required=False, unequal=True) for n in (6, 12, 24) for rate in some]
    return inside + beyond


def draw(row: Row, sets: int) -> Pair:
    """Return hits and frames of each data set's episodes, shape (sets, episodes)."""
    rng = np.random.default_rng([2026, row.episodes, round(1000 * row.icc), round(1000 * row.rate), row.unequal])
    shape = (sets, row.episodes)
    frames = rng.choice([2, 12, 22], size=shape) if row.unequal else np.full(shape, FRAMES)
    mean = row.rate + (frames - FRAMES) / 10 * min(row.rate, 1 - row.rate) / 4  # longer episodes have higher rates
    beta = 1 / row.icc - 1 if row.icc else 0.0
    own = rng.beta(mean * beta, (1 - mean) * beta) if beta else mean
    return rng.binomial(frames, own).astype(np.float64), frames.astype(np.float64)


def truth(row: Row) -> float:
    """Return the share of frames that are hits, over endless episodes."""
    if not row.unequal:
        return row.rate
    more = min(row.rate, 1 - row.rate) / 4
    return (2 * (row.rate - more) + 12 * row.rate + 22 * (row.rate + more)) / 36


def ours(k: Floats, n: Floats) -> Pair:
    """Return what `score` shows; data sets alike but for the order of their episodes are computed once."""
    seen: dict[bytes, tuple[float, float]] = {}
    ends = []
    for one, frames in zip(k, n, strict=True):
        order = np.lexsort((one, frames))
        name = np.stack([one[order], frames[order]]).tobytes()
        if name not in seen:
            seen[name] = share_over_episodes(one[order], frames[order], level=LEVEL).ci or (0.0, 1.0)
        ends.append(seen[name])
    low, high = np.array(ends).T
    return low, high


def wilson(p: Floats, n: Floats, z: Floats | float = Z) -> Pair:
    """Return Wilson's interval of a share with an effective number of frames."""
    middle, half = (p + z * z / 2 / n), z * np.sqrt(p * (1 - p) / n + (z / 2 / n) ** 2)
    return (middle - half) / (1 + z * z / n), (middle + half) / (1 + z * z / n)


def known(k: Floats, n: Floats, icc: float) -> Pair:
    """Return Wilson's interval with the design effect of a known correlation."""
    total = n.sum(axis=1)
    return wilson(k.sum(axis=1) / total, total / (1 + ((n * n).sum(axis=1) / total - 1) * icc))


def beside(k: Floats, n: Floats, seed: int) -> dict[str, Pair]:
    """Return the intervals of the ways that were not taken; those of the likelihood for equal episodes alone."""
    sets, episodes = k.shape
    total = n.sum(axis=1)
    p = k.sum(axis=1) / total
    rng = np.random.default_rng(seed)
    taken = rng.multinomial(episodes, np.full(episodes, 1 / episodes), size=1000).astype(np.float64)
    resampled = (k @ taken.T) / (n @ taken.T)
    low, high = np.quantile(resampled, [0.025, 0.975], axis=1)
    result: dict[str, Pair] = {"percentile": (low, high)}
    off = (k - p[:, None] * n) / (total / episodes)[:, None]
    variance = (off**2).sum(axis=1) / (episodes - 1) / episodes
    t = float(stats.t.ppf(0.975, episodes - 1))
    result["t"] = (np.maximum(p - t * np.sqrt(variance), 0), np.minimum(p + t * np.sqrt(variance), 1))
    spread = variance > 0
    effective = np.where(spread, p * (1 - p) / np.where(spread, variance, 1.0), episodes)
    result["wilson_t"] = wilson(p, np.minimum(effective, total), t)
    shrunk = np.minimum(effective * (Z / t) ** 2, total)
    hits = p * shrunk
    with np.errstate(invalid="ignore"):
        ends = stats.beta.ppf(0.025, hits, shrunk - hits + 1), stats.beta.ppf(0.975, hits + 1, shrunk - hits)
    result["korn_graubard"] = (np.nan_to_num(ends[0], nan=0.0), np.nan_to_num(ends[1], nan=1.0))
    if (n == FRAMES).all():
        result |= _on_a_grid(k, sets, episodes)
    return result


def _on_a_grid(k: Floats, sets: int, episodes: int) -> dict[str, Pair]:
    """Return the profile likelihood's interval with F(1, episodes - 1), and Bayes's: Jeffreys' rate and a flat ICC."""
    edges = np.sin(np.pi / 2 * np.linspace(0, 1, 202)) ** 2
    rate = np.sin(np.pi / 2 * (np.arange(201) + 0.5) / 201) ** 2
    icc = (np.arange(30) + 0.5) / 30
    a, b = (part[:, None] * (1 / icc - 1) for part in (rate, 1 - rate))
    hit = np.arange(FRAMES + 1)[:, None, None]
    table = (special.betaln(a + hit, b + FRAMES - hit) - special.betaln(a, b)).reshape(FRAMES + 1, -1)
    counts = np.stack([(k == index).sum(axis=1) for index in range(FRAMES + 1)], axis=1).astype(np.float64)
    ends: dict[str, list[Floats]] = {"profile": [], "bayes": []}
    cut = float(stats.f.ppf(LEVEL, 1, episodes - 1))
    for start in range(0, sets, 500):
        likelihood = counts[start : start + 500] @ table
        likelihood -= likelihood.max(axis=1, keepdims=True)
        cube = likelihood.reshape(-1, len(rate), len(icc))
        within = cube.max(axis=2) >= -cut / 2
        first, last = within.argmax(axis=1), len(rate) - 1 - within[:, ::-1].argmax(axis=1)
        ends["profile"].append(np.stack([edges[first], edges[last + 1]]))
        below = np.cumsum(np.exp(cube).sum(axis=2), axis=1)
        below /= below[:, -1:]
        first, last = (below <= 0.025).sum(axis=1), (below < 0.975).sum(axis=1)
        ends["bayes"].append(np.stack([edges[first], edges[last + 1]]))
    return {name: (both[0], both[1]) for name, parts in ends.items() for both in [np.concatenate(parts, axis=1)]}


def measure(row: Row, sets: int) -> dict[str, object]:
    """Return coverage and mean width of every interval in one row."""
    k, n = draw(row, sets)
    at = truth(row)
    reference = known(k, n, row.icc)
    width = float((reference[1] - reference[0]).mean())

    def told(ends: Pair) -> dict[str, float]:
        low, high = ends
        covered = float(((low <= at + 1e-12) & (at - 1e-12 <= high)).mean())
        return {"coverage": round(covered, 4), "width": round(float((high - low).mean()) / width, 3)}

    all_equal = (k / n == (k / n)[:, :1]).all(axis=1)
    return {
        "required": row.required,
        **told(ours(k, n)),
        "all_equal": round(float(all_equal.mean()), 4),
        "known": {**told(reference), "mean": round(width, 4)},
        **{name: told(ends) for name, ends in beside(k, n, row.episodes).items()},
    }


def fails(found: dict[str, object]) -> bool:
    """Return whether a required row misses its coverage or its width."""
    return bool(found["required"]) and (float(str(found["coverage"])) < COVERAGE or float(str(found["width"])) > WIDTH)


def begin(sets: int) -> dict[str, object]:
    """Return the result so far, where it is of this interval and this number of data sets, else an empty one."""
    code = hashlib.sha256(Path(str(measured.__file__)).read_bytes() + Path(__file__).read_bytes()).hexdigest()[:16]
    before: dict[str, object] = json.loads(RESULT.read_text()) if RESULT.exists() else {}
    if (before.get("code"), before.get("sets")) == (code, sets):
        return before
    kept = {name: before[name] for name in before.keys() & {"others"}}  # measured by coverage_kinds.py
    return {"version": __version__, "date": "", "code": code, "sets": sets, "failing": None, "rows": {}, **kept}


def write(result: dict[str, object]) -> None:
    """Write the result whole or not at all."""
    result["date"] = dt.datetime.now(tz=dt.UTC).date().isoformat()
    part = RESULT.with_suffix(".part")
    part.write_text(json.dumps(result, indent=1) + "\n")
    part.replace(RESULT)


def main() -> int:
    """Measure the rows that are missing; return 1 where a required one fails."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=2000, help="data sets a row (default: 2000)")
    sets = parser.parse_args().sets
    result = begin(sets)
    done = result["rows"]
    assert isinstance(done, dict)
    for row in rows():
        if row.key not in done:
            done[row.key] = measure(row, sets)
            write(result)
            print(row.key, done[row.key]["coverage"], done[row.key]["width"], flush=True)
    result["failing"] = [name for name, found in done.items() if fails(found)]
    write(result)
    needed = [found for found in done.values() if found["required"]]
    print(f"\nof {len(needed)} required rows: lowest coverage, largest mean width over that of a known correlation")
    for name in ("ours", *BESIDE):
        mine = [found if name == "ours" else found[name] for found in needed]
        low, wide = min(one["coverage"] for one in mine), max(one["width"] for one in mine)
        bad = sum(one["coverage"] < COVERAGE or one["width"] > WIDTH for one in mine)
        print(f"{name:>14}: {low:.3f}, {wide:.2f}; {bad} rows miss .93 or 1.6")
    print("failing:", result["failing"] or "none")
    return 1 if result["failing"] else 0


if __name__ == "__main__":
    sys.exit(main())
