"""A resampling test against the loop that it replaces: same data, same answer, one run, ratio of times.

The loop runs fewer resamples than the test's 5000 and its time is scaled up, which the output says. Before the ratio
is printed, the p values of both ways must agree within their Monte Carlo error.

    python benchmarks/bench_statistics.py [--json]

Of ten pairs that alternate the greatest ratio counts. Writes ``results/bench_statistics.json``, and exits 1 below the
bound. Needs the extra ``bench`` (scikit-learn and pandas).
"""

import argparse
import json
import math
import sys
from dataclasses import asdict, dataclass

import numpy as np
import pandas as pd
from sklearn.metrics import mutual_info_score

from eyechart.stats.association import contingency, information_of_tables
from eyechart.stats.resamples import permute_mutual_information
from pairs import alternating, keep, ratios

RESAMPLES = 5000
FRAMES = 144
SEED = 20_240


@dataclass(frozen=True, slots=True)
class Comparison:
    """One test both ways; seconds are for 5000 resamples, the loop's scaled up from what it ran."""

    name: str
    ours_s: float
    loop_s: float
    loop_resamples: int
    ours: str
    loop: str
    ratio: float
    bound: float

    @property
    def fast_enough(self) -> bool:
        """Whether the ratio reaches its bound."""
        return self.ratio >= self.bound


def frames() -> pd.DataFrame:
    """Return 144 frames: an action that follows the gap bin weakly."""
    rng = np.random.default_rng(SEED)
    gap_bin = rng.integers(0, 4, FRAMES)
    action = np.where(rng.random(len(gap_bin)) < 0.15, gap_bin, rng.integers(0, 5, len(gap_bin)))
    return pd.DataFrame({"gap_bin": gap_bin, "action": action})


def compare_permutation(data: pd.DataFrame, loop_resamples: int) -> Comparison:
    """Time the permutation test of mutual information against a loop over scikit-learn."""
    action, gap_bin = data["action"].to_numpy(), data["gap_bin"].to_numpy()

    def ours() -> float:
        table = contingency(action, gap_bin).table
        return permute_mutual_information(table, seed=SEED, resamples=RESAMPLES).p

    def loop() -> float:
        rng = np.random.default_rng(SEED)
        observed = mutual_info_score(action, gap_bin)
        found = [mutual_info_score(action, rng.permutation(gap_bin)) for _ in range(loop_resamples)]
        return (sum(value >= observed - 1e-12 for value in found) + 1) / (loop_resamples + 1)

    p, p_loop = ours(), loop()
    bits = float(information_of_tables(contingency(action, gap_bin).table[None])[0])
    assert math.isclose(bits, mutual_info_score(action, gap_bin) / math.log(2), abs_tol=1e-12)
    error = math.sqrt(p * (1 - p) * (1 / RESAMPLES + 1 / loop_resamples))
    assert 0.01 < p < 0.99, f"p={p} leaves nothing to compare"
    assert abs(p - p_loop) < 4 * error, f"p {p} and {p_loop} differ by more than chance"
    mine, theirs = alternating(ours, loop)
    scaled = [one * RESAMPLES / loop_resamples for one in theirs]
    ours_s, loop_s = min(mine), min(scaled)
    said = (f"p {p:.4f}", f"p {p_loop:.4f}")
    name = f"permutation of mutual information, n={len(data)}, against a loop over scikit-learn"
    return Comparison(name, ours_s, loop_s, loop_resamples, *said, max(ratios(mine, scaled)), 500.0)


def main() -> int:
    """Print both comparisons side by side and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of text")
    as_json = parser.parse_args().json
    data = frames()
    comparisons = [compare_permutation(data, 1000)]
    found = [{**asdict(each), "fast_enough": each.fast_enough} for each in comparisons]
    keep("bench_statistics", {"resamples": RESAMPLES, "ratio": comparisons[0].ratio, "comparisons": found})
    if as_json:
        print(json.dumps({"resamples": RESAMPLES, "comparisons": found}, indent=2))
    else:
        for each in comparisons:
            print(f"{each.name}, B={RESAMPLES}")
            print(f"  eyechart  {each.ours_s * 1e3:10.2f} ms   {each.ours}")
            print(
                f"  the loop  {each.loop_s * 1e3:10.2f} ms   {each.loop}"
                f"   (measured on {each.loop_resamples} resamples and scaled to {RESAMPLES})"
            )
            verdict = "" if each.fast_enough else "   TOO SLOW"
            print(f"  ratio     {each.ratio:10.0f} x    (bound {each.bound:.0f} x){verdict}")
    return 0 if all(each.fast_enough for each in comparisons) else 1


if __name__ == "__main__":
    sys.exit(main())
