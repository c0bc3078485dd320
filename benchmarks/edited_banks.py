"""Whether verdicts agree on banks that were edited from photographs and on banks that were rendered.

    make long-edits
    python benchmarks/edited_banks.py --sizes 60

Moments of the rover and of the drone are rendered and annotated: true masks, distances, horizon and vanishing column.
`edits` makes their control pictures; the worlds render the same ones, the lead and its copy at the same places.
Fifteen controllers that read pixels answer both banks. Readers of distance also answer the world's own bank of as
many frames, in which nothing is refused: who has depth there, and what takes it away. Reported beside the labels: how
far the independent reader finds edited leads from where they are said to be, how often a filled hole is read as an
obstacle, how many answers are equal, and what was refused.

Writes ``benchmarks/results/edits.json``; exit 1 where a reader of distance has another label on the edited bank, or a
bound of the tests does not hold.
"""

import argparse
import datetime as dt
import json
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / "tests")]

import edited_controllers  # noqa: E402 - of the tests
import edited_worlds  # noqa: E402
import eyechart  # noqa: E402
from edited_worlds import LEADS, Pair  # noqa: E402
from eyechart.frames import FrameBank  # noqa: E402
from eyechart.importing import Choices, import_table  # noqa: E402
from eyechart.simulators import open_bank_simulator  # noqa: E402
from eyechart.simulators.road.layout import FAMILIES  # noqa: E402
from eyechart.studies import battery  # noqa: E402
from eyechart.verdicts import judge  # noqa: E402

RESULT = ROOT / "benchmarks" / "results" / "edits.json"
CHOICES = Choices(threshold=8.0, unit="m", mirror="horizontal")
SEEDS = (0, 1, 2)
"""The seeds of the moments."""
MEDIAN, NINETIETH, GHOSTS, EQUAL = 0.02, 0.05, 0.01, 0.98
"""The bounds: error of the gap, share of holes that are read as an obstacle, share of equal answers."""


def errors_of(pair: Pair) -> dict[str, dict[str, float]]:
    """Return how far edited leads are read from where they are, by picture."""
    found = {}
    for name, column in LEADS.items():
        errors = []
        for row in pair.rows():
            if row[name]:
                got = edited_worlds.gap_in(edited_worlds.pixels(pair.edited / row[name]), pair.moment(row))
                errors.append(np.inf if got is None else abs(got - float(row[column])) / float(row[column]))
        found[name] = {
            "n": len(errors),
            "median": round(float(np.median(errors)), 5),
            "p90": round(float(np.percentile(errors, 90)), 5),
            "unread": int(np.isinf(errors).sum()),
        }
    return found


def ghosts_of(pair: Pair) -> dict[str, int]:
    """Return how many filled holes are read as another gap than the rendered picture has."""
    count = wrong = 0
    for row in pair.rows():
        if row["lead_absent"]:
            moment, count = pair.moment(row), count + 1
            seen = [
                edited_worlds.gap_in(edited_worlds.pixels(folder / row["lead_absent"]), moment)
                for folder in (pair.edited, pair.rendered)
            ]
            same = seen[0] == seen[1] or (None not in seen and abs(seen[0] - seen[1]) <= 0.1 * seen[1])
            wrong += not same
    return {"n": count, "read otherwise": wrong}


def labels_of(bank: FrameBank, run: Path, names: Iterable[str] = edited_controllers.CONTROLLERS) -> dict[str, str]:
    """Return the label of controllers on a bank."""
    specs = [f"python:edited_controllers:{name}" for name in names]
    battery.run(battery.plan(bank.root, specs, run))
    return {spec.rpartition(":")[2]: one.calibrated.label for spec, one in judge(battery.score(run)).items()}


def whole_labels(world: str, size: int, work: Path) -> dict[str, str]:
    """Return the labels of the readers where nothing is refused: on the world's own bank, of as many episodes."""
    bank = open_bank_simulator(world).build(work / "whole", seeds=SEEDS, steps=size // (len(SEEDS) * len(FAMILIES)))
    return labels_of(bank, work / "run whole", edited_controllers.READERS)


def lost_by(labels: dict[str, dict[str, str]], whole: dict[str, str]) -> dict[str, str]:
    """Return what takes depth from a reader that has it where nothing is refused, by its name."""
    found = {}
    for name, label in whole.items():
        if label == "depth" != labels[name]["edited"]:
            by_edit = labels[name]["rendered"] == "depth"
            found[name] = "the clauses on an edit" if by_edit else "refused pictures: rendered ones lack it too"
    return found


def equal_answers(banks: dict[str, FrameBank]) -> dict[str, float]:
    """Return to how many pictures the graded reader gives the same answer in both banks."""
    same = count = 0
    for frame in banks["edited"]:
        other = banks["rendered"].frame(frame.id)
        for name in sorted(frame.counterfactuals.keys() & other.counterfactuals.keys() - {"patched"}):
            one, two = (
                edited_controllers.depth("", banks[kind].image(found, name))
                for kind, found in (("edited", frame), ("rendered", other))
            )
            count, same = count + 1, same + (one == two)
    return {"n": count, "equal": round(same / count, 5)}


def _made(edited: bool) -> Choices:  # noqa: FBT001 - of two folders
    return replace(CHOICES, made="edited" if edited else "rendered")


def measured(world: str, size: int, work: Path) -> dict[str, object]:
    """Return what is measured of a world at a number of photographs."""
    begun = time.process_time()
    pair = edited_worlds.write_pair(work, edited_worlds.moments(world, size))
    record = json.loads((pair.edited / "edit.json").read_text())
    banks = {
        folder.name: import_table(folder, table, work / f"bank {folder.name}", _made(folder == pair.edited))
        for folder, table in zip((pair.edited, pair.rendered), pair.tables, strict=True)
    }
    labels = {kind: labels_of(bank, work / f"run {kind}") for kind, bank in banks.items()}
    whole = whole_labels(world, size, work)
    table = {
        name: {kind: labels[kind][name] for kind in ("rendered", "edited")} for name in edited_controllers.CONTROLLERS
    }
    return {
        "photographs": len(pair.moments),
        "pictures": record["pictures"],
        "refused": dict(Counter(one["picture"] for one in record["refused"])),
        "gap error": errors_of(pair),
        "holes": ghosts_of(pair),
        "answers": equal_answers(banks),
        "labels": table,
        "whole": whole,
        "depth is lost by": lost_by(table, whole),
        "agree": sum(one["rendered"] == one["edited"] for one in table.values()),
        "of": len(table),
        "processor s": round(time.process_time() - begun, 1),
    }


def wrong_in(found: dict[str, dict[str, object]]) -> list[str]:
    """Return what does not hold, in words."""
    wrong = []
    for name, one in found.items():
        for picture, error in one["gap error"].items():
            if error["median"] > MEDIAN or error["p90"] > NINETIETH:
                wrong.append(f"{name}: {picture} is off by {error['median']:.1%}, {error['p90']:.1%} at p90")
        if one["holes"]["read otherwise"] > GHOSTS * one["holes"]["n"]:
            wrong.append(f"{name}: {one['holes']['read otherwise']} holes are read as an obstacle")
        if one["answers"]["equal"] < EQUAL:
            wrong.append(f"{name}: {one['answers']['equal']:.1%} of the answers are equal")
        for reader in edited_controllers.READERS:
            pair = one["labels"][reader]
            if pair["rendered"] != pair["edited"]:
                wrong.append(
                    f"{name}: {reader} is {pair['rendered']} on rendered and {pair['edited']} on edited pictures"
                )
    return wrong


def main() -> int:
    """Measure what is asked for, and write it beside what was measured before."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--worlds", default="rover,drone", help="with commas")
    parser.add_argument("--sizes", default="60,180", help="numbers of photographs, with commas")
    asked = parser.parse_args()
    found = json.loads(RESULT.read_text())["banks"] if RESULT.is_file() else {}
    for world in asked.worlds.split(","):
        for size in map(int, asked.sizes.split(",")):
            with tempfile.TemporaryDirectory(prefix="edits-") as work:
                found[f"{world} {size}"] = one = measured(world, size, Path(work))
            print(f"{world} {size}: {one['agree']} of {one['of']} labels agree, {one['answers']}, {one['holes']}")
            written = {
                "eyechart": eyechart.__version__,
                "date": dt.datetime.now(dt.UTC).date().isoformat(),
                "banks": found,
                "wrong": wrong_in(found),
            }
            RESULT.write_text(json.dumps(written, indent=1) + "\n")
    print(*wrong_in(found), sep="\n")
    return int(bool(wrong_in(found)))


if __name__ == "__main__":
    sys.exit(main())
