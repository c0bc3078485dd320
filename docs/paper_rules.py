"""Write docs/paper-rules.md: what the sixteen controllers read on `paper` banks, under both sets of rules.

Usage: python docs/paper_rules.py FOLDER [BANKS]   (FOLDER keeps banks and runs; BANKS defaults to 10)
"""

import sys
from collections import Counter
from pathlib import Path

from eyechart.models.scripted import CONTROLLERS
from eyechart.simulators import open_simulator
from eyechart.studies import battery
from eyechart.verdicts import Verdict, judge

PAGE = Path(__file__).with_name("paper-rules.md")
SPECS = [f"scripted:{name}" for name in CONTROLLERS]


def read(folder: Path, number: int, steps: int) -> dict[str, Verdict]:
    """Return the verdicts of all controllers on one paper bank; built and run where that was not done yet."""
    bank, run = folder / f"bank-{number}-{steps}", folder / f"run-{number}-{steps}"
    if not bank.exists():
        open_simulator("highway").build(bank, preset="paper", seeds=range(3 * number, 3 * number + 3), steps=steps)
    battery.run(battery.plan(bank, SPECS, run, seed=number))
    return judge(battery.score(run))


def labels(found: list[str]) -> str:
    """Return labels with how many banks gave each, the most frequent first."""
    counts = Counter(found).most_common()
    return counts[0][0] if len(counts) == 1 else ", ".join(f"{label} {count}" for label, count in counts)


def table(verdicts: list[dict[str, Verdict]]) -> str:
    """Return one row a controller."""
    rows = ["| controller | what it does | paper's rules | calibrated rules | lateral |", "|---|---|---|---|---|"]
    for name, controller in CONTROLLERS.items():
        mine = [found[f"scripted:{name}"] for found in verdicts]
        columns = (
            labels([one.paper.label for one in mine]),
            labels([one.calibrated.label for one in mine]),
            labels([one.lateral.label for one in mine]),
        )
        rows.append(f"| {name} | {controller.says} | " + " | ".join(columns) + " |")
    return "\n".join(rows)


def main() -> None:
    """Run every bank and write the page between its marks."""
    folder, banks = Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 10
    text = PAGE.read_text(encoding="utf-8")
    for steps in (12, 24):
        rows = table([read(folder, number, steps) for number in range(banks)])
        before, _, rest = text.partition(f"<!-- {steps} steps -->\n")
        _, _, after = rest.partition(f"<!-- end of {steps} steps -->")
        text = f"{before}<!-- {steps} steps -->\n{rows}\n<!-- end of {steps} steps -->{after}"
    PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
