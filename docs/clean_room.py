"""Recompute the paper's statistics from a bundle's table of decisions, with the standard library alone.

    python docs/clean_room.py run.zip

It imports nothing of eyechart: what it does is the description of the table and of the six numbers, in code. It prints
each number beside the one in the bundle, and exits with 1 where two differ by more than 1e-12; of a prompt study cell
by cell. A bundle without a table of decisions, as of drives, is said to have none, with exit 2.
"""

import csv
import io
import json
import math
import sys
import zipfile
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

BATTERY = ("real", "real_repeat", "blank", "noise", "shuffled", "cross_scenario", "text_only", "mirrored")
"""The conditions of the paper's Table t:conditions; a run may hold others, which these numbers do not read."""

UNPARSED = "UNPARSED"
"""Stands for every reply without a decision, where outputs are compared."""

TOLERANCE = 1e-12

Row = Mapping[str, str]
Answers = dict[str, dict[str, Row]]
"""A model's rows by condition and frame."""

NAMES = {
    "idi": "IDI",
    "noise_floor": "s",
    "idi_adj": "IDI_adj",
    "cramers_v": "V",
    "mirror_swap_rate": "swap rate",
    "mutual_information.decision": "I(A;g)",
}
"""What a bundle calls each number, and the paper."""


def read_table(bundle: zipfile.ZipFile, cell: str = "") -> dict[str, Answers]:
    """Return the rows of ``tables/decisions.csv``, or of a prompt study's cell, by model, condition and frame."""
    text = io.StringIO(bundle.read(f"tables/decisions{cell and '-'}{cell}.csv").decode("utf-8"), newline="")
    models: dict[str, Answers] = {}
    for row in csv.DictReader(text):
        models.setdefault(row["model"], {}).setdefault(row["condition"], {})[row["frame"]] = row
    return models


def output(row: Row) -> str:
    """Return what was answered: the action, or UNPARSED where the reply holds none."""
    return row["decision"] or UNPARSED


def disagreement(answers: Answers, condition: str) -> float | None:
    """Return the share of frames, among those with both answers, whose answer is not the one to the real frame."""
    real, other = answers.get("real", {}), answers.get(condition, {})
    pairs = [(output(row), output(other[frame])) for frame, row in real.items() if frame in other]
    return sum(a != b for a, b in pairs) / len(pairs) if pairs else None


def cramers_v(answers: Answers) -> float | None:
    """Return V of condition by output: sqrt(chi2 / (n (k - 1))), k the shorter side, Yates' correction at 2 x 2."""
    counts = Counter((name, output(row)) for name in BATTERY for row in answers.get(name, {}).values())
    n = counts.total()
    if not n:
        return None
    rows, columns = totals(counts, 0), totals(counts, 1)
    shorter = min(len(rows), len(columns)) - 1
    if not shorter:
        return 0.0
    chi2 = 0.0
    for row, of_row in rows.items():
        for column, of_column in columns.items():
            expected = of_row * of_column / n
            apart = abs(counts[row, column] - expected)
            if len(rows) == len(columns) == 2:
                apart -= min(0.5, apart)
            chi2 += apart * apart / expected
    return math.sqrt(chi2 / (n * shorter))


def totals(counts: Mapping[tuple[str, str], int], side: int) -> Counter[str]:
    """Return the sums of a table's rows (``side`` 0) or columns (1)."""
    result: Counter[str] = Counter()
    for names, count in counts.items():
        result[names[side]] += count
    return result


def swap_rate(answers: Answers, partner: Mapping[str, str]) -> float | None:
    """Return the share of directions given to real frames that the reflected frame exchanges."""
    real, mirrored = answers.get("real", {}), answers.get("mirrored", {})
    both = [(row["decision"], output(mirrored[frame])) for frame, row in real.items() if frame in mirrored]
    turned = [(a, b) for a, b in both if a in partner]
    return sum(partner[a] == b for a, b in turned) / len(turned) if turned else None


def information(answers: Answers) -> float | None:
    """Return the plug-in mutual information, in bits, of the action and the gap's quartile on real frames.

    Replies without a decision are dropped. A frame without a lead, whose gap is ``inf``, counts as the farthest.
    """
    decided = [row for row in answers.get("real", {}).values() if row["decision"]]
    if not decided or any(not row["gap"] for row in decided):
        return None
    bins = quartiles([float(row["gap"]) for row in decided])
    counts = Counter((row["decision"], str(place)) for row, place in zip(decided, bins, strict=True))
    n, rows, columns = len(decided), totals(counts, 0), totals(counts, 1)
    bits = (count / n * math.log2(count * n / (rows[a] * columns[b])) for (a, b), count in counts.items())
    return max(0.0, math.fsum(bits))


def quartiles(gaps: Sequence[float]) -> list[int]:
    """Return each gap's bin: edges are the quartiles, equal ones are one, and an edge belongs to the bin below."""
    finite = [gap for gap in gaps if math.isfinite(gap)]
    farthest = max(finite, default=0.0) + 1.0
    known = [gap if math.isfinite(gap) else farthest for gap in gaps]
    edges = sorted({quantile(sorted(known), share) for share in (0.0, 0.25, 0.5, 0.75, 1.0)})[1:-1]
    return [sum(edge < gap for edge in edges) for gap in known]


def quantile(ordered: Sequence[float], share: float) -> float:
    """Return a quantile between the two numbers next to it, in proportion (Hyndman and Fan's type 7)."""
    place = share * (len(ordered) - 1)
    below = math.floor(place)
    above, weight = min(below + 1, len(ordered) - 1), place - below
    apart = ordered[above] - ordered[below]
    return ordered[above] - apart * (1 - weight) if weight >= 0.5 else ordered[below] + apart * weight


def statistics(answers: Answers, partner: Mapping[str, str]) -> dict[str, float | None]:
    """Return the six numbers of one model; None is "cannot say"."""
    idi, floor = disagreement(answers, "blank"), disagreement(answers, "real_repeat")
    return {
        "idi": idi,
        "noise_floor": floor,
        "idi_adj": None if idi is None or floor is None else idi - floor,
        "cramers_v": cramers_v(answers),
        "mirror_swap_rate": swap_rate(answers, partner),
        "mutual_information.decision": information(answers),
    }


def compared(bundle: zipfile.ZipFile) -> Iterable[tuple[str, str, float | None, float | None]]:
    """Yield model, number, what was recomputed and what the bundle holds; of a cell only the numbers that it holds."""
    score = json.loads(bundle.read("results.json"))["score"]
    held = [(one["cell"], one["model"], one["statistics"]) for one in score.get("cells", ())]
    held += [("", model, one["statistics"]) for model, one in score.get("models", {}).items()]
    for cell, model, found in held:
        bank = json.loads(bundle.read(f"run/{cell}{cell and '/'}bank/manifest.json"))
        partner = {a: b for pair in bank["action_space"]["mirror_pairs"] for a, b in (pair, pair[::-1])}
        for name, value in statistics(read_table(bundle, cell).get(model, {}), partner).items():
            if name in found or not cell:
                yield f"{model} in {cell}" if cell else model, name, value, found[name]["value"]


def same(one: float | None, other: float | None) -> bool:
    """Return whether two numbers agree to the tolerance; "cannot say" agrees with itself only."""
    return one is other is None or (one is not None and other is not None and abs(one - other) <= TOLERANCE)


def main(path: str) -> int:
    """Print every number beside the bundle's; return 1 where two differ, 2 where there is nothing to count."""
    differ = 0
    if not zipfile.is_zipfile(path):
        sys.stdout.write(f"{path} is no bundle\n")
        return 2
    with zipfile.ZipFile(path) as bundle:
        if not any(name.startswith("tables/decisions") for name in bundle.namelist()):
            sys.stdout.write(f"{path} holds no table of decisions; of drives 'eyechart validate' drives them again\n")
            return 2
        for model, name, value, held in compared(bundle):
            differ += not same(value, held)
            word = "same" if same(value, held) else "DIFFERS"
            sys.stdout.write(f"{word:<8} {model}  {NAMES[name]}  {value!r}  bundle {held!r}\n")
    return int(differ > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]) if len(sys.argv) == 2 else "usage: python clean_room.py FILE.zip")
