"""Series of corruptions on readers of known acuity: the last step at which each still sees, found and true.

    make long-series

A reader averages cells of a picture, and calls the lead near where most cells in its path differ from the road beside
by so many levels. Its acuity is its cell (size, noise) and its levels (contrast). The truth is its net effect at each
step, over two draws for every frame of the bank. The series sees one draw of its own, asks three steps at most, and
reads the controller through a real run. A reader's row is kept as soon as it is there, and the result is that of
the rows so far.

Writes ``benchmarks/results/series.json``; exit 1 where a series is more than one step from the truth.
"""

import argparse
import datetime as dt
import functools
import json
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from eyechart import __version__, api
from eyechart.corruptions import CORRUPTIONS, STEPS
from eyechart.frames import RGB, FrameBank, decode
from eyechart.simulators import open_bank_simulator
from eyechart.studies.battery.series import effect_at, results
from eyechart.verdicts import MARGIN

ROOT = Path(__file__).parents[1]
RESULT, KEPT = ROOT / "benchmarks" / "results" / "series.json", ROOT / "build" / "series.jsonl"
CELLS, LEVELS = (2, 8, 20), (10.0, 25.0, 60.0)
DRAWS = 2


class Reader:
    """A controller that brakes where its path differs from the road by ``levels``; cells have this side in pixels."""

    def __init__(self, cell: int, levels: float) -> None:
        self.cell, self.levels = cell, levels

    def is_near(self, pixels: RGB) -> bool:
        """Return whether it calls the lead near."""
        high, _, _ = pixels.shape
        strip = pixels[int(0.55 * high) : int(0.75 * high)].astype(np.float64)
        rows, columns = (side // self.cell for side in strip.shape[:2])
        cut = strip[: rows * self.cell, : columns * self.cell].reshape(rows, self.cell, columns, self.cell, 3)
        cells = cut.mean(axis=(1, 3))
        across = (np.arange(columns) + 0.5) / columns
        path, sides = cells[:, np.abs(across - 0.5) < 0.08], cells[:, (np.abs(across - 0.5) > 0.12)]
        road = np.median(sides.reshape(-1, 3), axis=0)
        return bool(np.median(np.abs(path - road).max(axis=2)) > self.levels)

    def __call__(self, prompt: str, picture: bytes | None) -> str:
        """Answer a query."""
        del prompt
        return "STRAIGHT" if picture is None or not self.is_near(decode(picture, "picture")) else "STOP"


READERS = {
    f"cell {cell}, {LEVELS[(place + turn) % 3]:g} levels": Reader(cell, LEVELS[(place + turn) % 3])
    for turn in range(3)
    for place, cell in enumerate(CELLS)
}
"""Every cell with every contrast; the first three have all cells and all contrasts once."""


def truth(pictures: list[tuple[RGB, RGB]], name: str) -> dict[str, list[float]]:
    """Return each reader's net effect at each step, clean first, over frames and draws. Pictures are corrupted once."""

    def effects(step: int) -> list[float]:
        found = []
        for place, pair in enumerate(pictures):
            for draw in range(DRAWS if step else 1):
                near, far = (
                    one if not step else CORRUPTIONS[name].applied(one, step, seed=1000 * place + draw) for one in pair
                )
                found.append([one.is_near(near) - float(one.is_near(far)) for one in READERS.values()])
        return np.mean(found, axis=0).tolist()

    steps = zip(*(effects(step) for step in (0, *STEPS)), strict=True)
    return dict(zip(READERS, map(list, steps), strict=True))


def rows_of(bank: FrameBank, folder: Path, kept: dict[str, dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """Yield a row per reader and series; those that are kept as they are."""
    frames = [frame for frame in bank if {"lead_near", "lead_far"} <= frame.counterfactuals.keys()]
    pictures = [
        tuple(decode(next(iter(bank.images(frame, name).values())), name) for name in ("lead_near", "lead_far"))
        for frame in frames
    ]
    truths = functools.cache(functools.partial(truth, pictures))
    for spec, reader in READERS.items():
        before = [kept[f"{spec}: {name}"] for name in CORRUPTIONS if f"{spec}: {name}" in kept]
        yield from before
        if len(before) == len(CORRUPTIONS) or (before and before[0]["found"] is None):
            continue
        wanted = f"cell-{reader.cell}-{reader.levels:g}"
        conditions = ["real", "real_repeat", "blank", "lead_near", "lead_far"]
        run = api.run_battery(bank, {wanted: reader}, folder / wanted, conditions=conditions, series="all")
        model = run.score.models[f"python:{wanted}"]
        ended = {one.name: one for one in results(model.statistics)}
        clean = effect_at(model.answers).value
        calls = sum(model.answers.counts()[one].total() for one in model.answers.decisions)
        for name in CORRUPTIONS if ended else ("fog",):
            if f"{spec}: {name}" in kept:
                continue
            effects = truths(name)[spec]
            below = (step for step, one in enumerate(effects) if one <= MARGIN)
            yield {
                "reader": spec,
                "series": name,
                "clean": clean,
                "found": ended[name].reached if name in ended else None,
                "truth": next(below, len(STEPS) + 1) - 1,
                "effects": [round(one, 3) for one in effects],
                "calls": calls,
            }


def main() -> int:
    """Ask every reader every series; write the result."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=4, help="seeds of the rover bank")
    seeds = parser.parse_args().seeds
    KEPT.parent.mkdir(exist_ok=True)
    lines = KEPT.read_text(encoding="utf-8").splitlines() if KEPT.exists() else []
    kept = {f"{row['reader']}: {row['series']}": row for row in map(json.loads, lines)}
    rows: list[dict[str, Any]] = []
    result: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder, KEPT.open("a", encoding="utf-8") as file:
        bank = open_bank_simulator("rover").build(Path(folder) / "bank", seeds=tuple(range(7100, 7100 + seeds)))
        for row in rows_of(bank, Path(folder), kept):
            rows.append(row)
            if f"{row['reader']}: {row['series']}" not in kept:
                file.write(json.dumps(row) + "\n")
                file.flush()
                print(row, flush=True)
            result = written(rows, len(bank.frames))
    print(
        f"{result['exact']} of {result['series']} exact, {len(result['more than one step off'])} more than one step off"
    )
    return bool(result["more than one step off"])


def written(rows: list[dict[str, Any]], frames: int) -> dict[str, Any]:
    """Write what is measured so far, and return it."""
    asked = [row for row in rows if row["found"] is not None]
    result = {
        "version": __version__,
        "date": dt.datetime.now(dt.UTC).date().isoformat(),
        "frames": frames,
        "readers": len({row["reader"] for row in rows}),
        "series": len(asked),
        "exact": sum(row["found"] == row["truth"] for row in asked),
        "a step too far": sum(row["found"] > row["truth"] for row in asked),
        "more than one step off": [row for row in asked if abs(row["found"] - row["truth"]) > 1],
        "rows": rows,
    }
    RESULT.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    return result


if __name__ == "__main__":
    sys.exit(main())
