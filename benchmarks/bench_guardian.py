"""Nested leave-one-episode-out of the guardian against a plain scikit-learn loop: same votes, same selections, one run.

The loop tries every pair of 20 models at every threshold in every fold with ``balanced_accuracy_score``, in declared
order, so that its first best is the declared tie-break. Both must choose alike in every fold before a ratio is printed.

    python benchmarks/bench_guardian.py [--json]

Three pairs alternate, as the loop takes half a minute and the bound is far. Writes ``results/bench_guardian.json``, and
exits 1 below the bound. Needs the extra ``bench`` (scikit-learn).
"""

import argparse
import json
import sys
from itertools import combinations

import numpy as np
from sklearn.metrics import balanced_accuracy_score

from eyechart.stats.committee_votes import select_without_each, tally
from pairs import alternating, keep, ratios

MODELS, EPISODES, STEPS = 20, 12, 24
TIMES, PAIRS = 50, 3
"""How often ours is done where the loop is done once, and the pairs of both."""
BOUND = 1000.0
SEED = 5
Chosen = list[tuple[tuple[int, ...], int]]


def votes() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return votes of 20 models of different worth, the truth and the episode of each frame."""
    dice = np.random.default_rng(SEED)
    frames = EPISODES * STEPS
    truth = dice.random(frames) < 220 / 288
    worth = np.linspace(0.55, 0.9, MODELS)[:, None, None]
    right = dice.random((MODELS, frames, 2)) < worth
    return (
        np.where(right, truth[None, :, None], ~truth[None, :, None]).astype(np.int8),
        truth,
        np.arange(frames) // STEPS,
    )


def ours(said: np.ndarray, truth: np.ndarray, group: np.ndarray) -> Chosen:
    """Choose in every fold at once."""
    choices = select_without_each(tally(said, truth, group, size=2))
    return [(choice.committee, choice.threshold) for choice in choices]


def loop(said: np.ndarray, truth: np.ndarray, group: np.ndarray) -> Chosen:
    """Choose fold by fold, pair by pair, threshold by threshold."""
    chosen: Chosen = []
    for fold in range(EPISODES):
        kept = group != fold
        best, first = -1.0, ((0, 1), 1)
        for pair in combinations(range(MODELS), 2):
            hazard_votes = said[list(pair)][:, kept].sum(axis=(0, 2))
            for threshold in range(1, 5):
                worth = balanced_accuracy_score(truth[kept], hazard_votes >= threshold)
                if worth > best + 1e-12:
                    best, first = worth, (pair, threshold)
        chosen.append(first)
    return chosen


def main() -> int:
    """Compare, print and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    data = votes()
    mine, theirs = ours(*data), list[Chosen]()
    many, once = alternating(lambda: [ours(*data) for _ in range(TIMES)], lambda: theirs.append(loop(*data)), PAIRS)
    if any(mine != chosen for chosen in theirs):
        print(f"the selections differ: {mine} against {theirs}")
        return 1
    each = [one / TIMES for one in many]
    fast, slow, ratio = min(each), min(once), max(ratios(each, once))
    values = {"pairs": PAIRS, "ours_s": fast, "loop_s": slow, "ratio": ratio, "bound": BOUND, "folds": len(mine)}
    keep("bench_guardian", values)
    if asked.json:
        print(json.dumps(values))
    else:
        print(
            f"nested leave-one-episode-out, {MODELS} models, {len(mine)} folds with the same selections: {ratio:.0f}×"
        )
        print(f"  vectorised {1e3 * fast:.2f} ms, scikit-learn loop {slow:.1f} s; bound {BOUND:.0f}×")
    return 0 if ratio >= BOUND else 1


if __name__ == "__main__":
    sys.exit(main())
