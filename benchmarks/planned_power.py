"""The power that ``eyechart plan`` prints, against models of the same kinds that are drawn, scored and judged.

    make long-power
    python benchmarks/planned_power.py --draws 1000 --processes 2

Every cell (frames, noise floor, kind) is kept on disk, so an interrupted measurement goes on. Writes
``benchmarks/results/power.json``; exit 1 where the plan is off by more than .05.
"""

import argparse
import datetime as dt
import json
import sys
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

import eyechart
from eyechart.conditions import BATTERY, CONDITIONS, COUNTERFACTUALS, OF_BANKS
from eyechart.frames import MAIN, BankManifest, Frame, FrameBank, alone
from eyechart.processes import open_pool
from eyechart.spaces.discrete import DRIVING
from eyechart.spaces.space import Decision
from eyechart.studies.battery.answers import Answers
from eyechart.studies.battery.calibrated_statistics import CalibratedTests, LazyStatistics
from eyechart.studies.battery.odds import READS, odds_of
from eyechart.studies.battery.paper_statistics import Resampling
from eyechart.verdicts import calibrated_rules
from eyechart_organisms.calibration.early_stops import sampled

RESULT = Path(__file__).parent / "results" / "power.json"
FRAMES, NOISES, WITHIN = (36, 72, 144, 288), (0.05, 0.11, 0.22), 0.05
THIRDS = tuple(np.geomspace(5, 60, 4)[1:3].tolist())
DRAWN = tuple(name for name in OF_BANKS if "counterfactual" in CONDITIONS[name].needs)
ABSENCES = ("image_invariant", "presence_only")
PLACED = {
    **dict.fromkeys(("lead_near", "lead_near_nudged"), "lead_near_m"),
    **dict.fromkeys(("lead_far", "exchange_apart", "exchange_beside"), "lead_far_m"),
    **dict.fromkeys(("lead_drawn", "lead_drawn_nudged"), "lead_drawn_m"),
    **dict.fromkeys(("exchange_own", "exchange_own_nudged"), "exchange_m"),
}
"""Where the lead is in each picture that depth compares, by the column that says so."""
KINDS = (*ABSENCES, *(f"{label}@{share:g}" for share in READS for label in ("depth", "depth_associated")))
BATCH = 50


@dataclass(frozen=True)
class Cell:
    """What is measured together: a size of bank, a noise floor and a kind of model, with the label that it deserves."""

    frames: int
    noise: float
    kind: str

    @property
    def name(self) -> str:
        """Return the cell in one word."""
        return f"{self.frames} {self.noise:g} {self.kind}"


@cache
def bank_of(frames: int) -> FrameBank:
    """Return a bank of four scenarios and twelve episodes, in memory, that has every picture and no gap to observe."""
    rng, made = np.random.default_rng(1), []
    for number in range(frames):
        scenario, episode = number % 4, number % 12
        near, far, lead, exchange = ((5.0, 5.0), (50.0, 60.0), (5.0, 60.0), (5.6, 49.0))
        ends = {"lead_near_m": near, "lead_far_m": far, "lead_drawn_m": lead, "exchange_m": exchange}
        truth = {name: float(np.exp(rng.uniform(*np.log(of)))) for name, of in ends.items()}
        drawn = {name: {MAIN: "-"} for name in DRAWN}
        place = f"s{scenario}", f"e{episode}", number // 12
        made.append(Frame(f"f{number}", *place, alone("vertical"), {MAIN: "-"}, truth, drawn))
    return FrameBank(Path(), tuple(made), BankManifest("drawn", "power", "no pictures", DRIVING, None))


def meant(cell: Cell, frames: int, rng: np.random.Generator) -> dict[str, list[str]]:
    """Return what a model means to answer, by condition; a noisy one slips from it."""
    label, _, share = cell.kind.partition("@")
    names = (*BATTERY, *COUNTERFACTUALS, "nudged", "lead_absent", "real_again")
    if label in ABSENCES:
        other = "STOP" if label == "presence_only" else "SLOW"
        columns = {name: ["SLOW"] * frames for name in names}
        return columns | dict.fromkeys(("blank", "noise", "text_only"), [other] * frames)
    reads = set(rng.permutation(frames)[: round(float(share) * frames)].tolist())
    columns = {name: ["SLOW"] * frames for name in names if label == "depth" or name != "nudged"}
    for name, at in PLACED.items():
        if label == "depth" or name in {"lead_near", "lead_far"}:
            truths = [frame.truth[at] for frame in bank_of(frames)]
            columns[name] = [_braked(truth) if place in reads else "SLOW" for place, truth in enumerate(truths)]
    return columns


def _braked(metres: object) -> str:
    """Brake hardest in the nearest third of the range, and go on in the farthest."""
    first, last = THIRDS
    return "STOP" if float(str(metres)) < first else "SLOW" if float(str(metres)) < last else "STRAIGHT"


def labels(cell: Cell, first: int, draws: int) -> int:
    """Return how many of so many models get the label of their kind."""
    bank, hits = bank_of(cell.frames), 0
    count = len(DRIVING.actions)
    most = (count - 1) / count
    slips = most * (1 - np.sqrt(1 - cell.noise / most))
    for number in range(first, first + draws):
        rng = np.random.default_rng([number, cell.frames, round(1000 * cell.noise), KINDS.index(cell.kind)])
        decisions = {}
        for name, column in meant(cell, cell.frames, rng).items():
            slipped, other = rng.random(cell.frames) < slips, rng.integers(1, count, cell.frames)
            codes = [DRIVING.actions.index(action) for action in column]
            given = [(code + step * slip) % count for code, step, slip in zip(codes, other, slipped, strict=True)]
            decisions[name] = tuple(Decision(DRIVING.actions[code]) for code in given)
        answers = sampled(Answers("drawn", bank.frames, DRIVING, None, decisions), number)
        statistics = LazyStatistics(CalibratedTests(answers, Resampling(499, number, intervals=False)).tests())
        label = calibrated_rules(statistics, turns=False)[0].label
        hits += label == cell.kind.partition("@")[0]
    return hits


def planned(cell: Cell) -> float:
    """Return what the plan says of a cell."""
    odds = odds_of(bank_of(cell.frames), noise=cell.noise)
    label, _, share = cell.kind.partition("@")
    found = getattr(odds, label)
    value = found[share] if share else found
    assert isinstance(value, float)
    return value


def measured(cells: list[Cell], draws: int, processes: int, kept: Path) -> dict[str, int]:
    """Return the hits of every cell, with those that an earlier measurement kept."""
    hits = json.loads(kept.read_text()) if kept.is_file() else {}
    with open_pool(processes) as pool:
        for cell in cells:
            if cell.name in hits:
                continue
            starts = range(0, draws, BATCH)
            found = pool.map(labels, [cell] * len(starts), starts, [min(BATCH, draws - start) for start in starts])
            hits[cell.name] = sum(found)
            kept.write_text(json.dumps(hits))
            sys.stderr.write(f"{cell.name}: {hits[cell.name]} of {draws}\n")
    return dict(hits)


def main() -> None:
    """Measure every cell, and hold the plan against it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=1000)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--frames", type=int, nargs="*", default=FRAMES)
    parser.add_argument("--keep", type=Path, default=Path("build/power"))
    given = parser.parse_args()
    given.keep.mkdir(parents=True, exist_ok=True)
    kept = given.keep / f"{eyechart.__version__}-{given.draws}.json"
    cells = [Cell(frames, noise, kind) for frames in given.frames for noise in NOISES for kind in KINDS]
    hits = measured(cells, given.draws, given.processes, kept)
    rows = []
    for cell in cells:
        share, plan = hits[cell.name] / given.draws, planned(cell)
        rows.append({"frames": cell.frames, "noise": cell.noise, "kind": cell.kind, "plan": plan, "measured": share})
    off = [row for row in rows if abs(row["plan"] - row["measured"]) > WITHIN]
    result = {
        "date": dt.datetime.now(dt.UTC).date().isoformat(),
        "version": eyechart.__version__,
        "draws": given.draws,
        "within": WITHIN,
        "largest": max(abs(row["plan"] - row["measured"]) for row in rows),
        "off": len(off),
        "cells": rows,
    }
    RESULT.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    for row in rows:
        mark = "  <- off" if row in off else ""
        print(f"{row['frames']:4} {row['noise']:.2f} {row['kind']:22} {row['plan']:.3f} {row['measured']:.3f}{mark}")
    sys.exit(bool(off))


if __name__ == "__main__":
    main()
