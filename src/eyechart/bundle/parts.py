"""Drives and studies of several runs in a bundle: the copies of the runs, and the results."""

import hashlib
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import eyechart
from eyechart.bundle.contents import (
    ALONE,
    RUN_FOLDER,
    SOURCE,
    TABLES,
    DerivedResults,
    Recipe,
    digests,
)
from eyechart.episodes import ACTION_MAP, EPISODES, read_episodes
from eyechart.ledger import Ledger
from eyechart.manifest import BESIDE, LEDGER, RUN
from eyechart.models.prices import read_prices
from eyechart.records import plain
from eyechart.studies import ReadOptions, Tell, is_episodes, run_json, study_of
from eyechart.studies.battery.tables import decisions_table
from eyechart.studies.prompts import PromptsScore

OF_DRIVES = (RUN, EPISODES, LEDGER, ACTION_MAP, *BESIDE)
"""The files of a run of drives; only the first is always present."""
_CONTROLLERS = ("policies", "simulators", "mpc.py", "spaces/scene.py")
"""The package's source of controllers and worlds."""
_PLAIN_NAME = re.compile(r"[\w.-]{1,100}")
_HOW = """This is a bundle of eyechart: drives, or a study of several runs, and what follows from them.

run/            what was driven, asked and answered: run.json, episodes.jsonl, ledger.sqlite; a folder a run
results.json    every statistic, and what each run says of itself
report.html     the same for people, in any browser
tables/         the same as CSV, Markdown and LaTeX; of prompts every decision, in decisions-CELL.csv
source/         the source of the controllers and the worlds, to be read; a validation runs its own and compares
bundle.json     how the results were made, and a digest of every file

  eyechart validate FILE.zip

recomputes all of it from run/, drives every episode again from its record, and names what differs.
Pictures of drives are not in the report: 'eyechart film RUN' makes them from the record.
"""


def has_parts(run: Path) -> bool:
    """Return whether a folder holds drives or several runs, not one run on a bank."""
    return not (run / RUN).is_file() or is_episodes(run)


def copy_drives(run: Path, copy: Path) -> None:
    """Copy a run of drives, without half-written parts of a killed run."""
    copy.mkdir(parents=True)
    for name in OF_DRIVES:
        if (run / name).is_file() and name not in {EPISODES, LEDGER}:
            shutil.copyfile(run / name, copy / name)
    if (run / EPISODES).is_file():
        text = (run / EPISODES).read_bytes()
        (copy / EPISODES).write_bytes(text[: text.rfind(b"\n") + 1])
    if (run / LEDGER).is_file():
        with Ledger(run / LEDGER) as ledger:
            ledger.copy_to(copy / LEDGER)


def sources() -> dict[str, bytes]:
    """Return the source of the controllers and worlds that ship, by file name in a bundle."""
    root = Path(eyechart.__file__).parent
    found = (
        path
        for name in _CONTROLLERS
        for path in ([root / name] if name.endswith(".py") else (root / name).rglob("*.py"))
    )
    return {f"{SOURCE}eyechart/{path.relative_to(root).as_posix()}": path.read_bytes() for path in sorted(found)}


def derive_parts(folder: Path, recipe: Recipe, tell: Tell = lambda _: None) -> DerivedResults:
    """Compute results, report and tables of a bundle's run or runs, without driving."""
    tell("scoring")
    study, reading = (
        study_of(folder, "bundle"),
        ReadOptions(recipe.independent, resamples=recipe.resamples, driven=False),
    )
    prices = read_prices()
    with _called(folder, recipe.name) as named:
        score, made = study.whole(named, reading, tell)
        runs = {name or ALONE: run for name, run in study.runs(named).items()}
        manifests = {name: study.manifest(run) for name, run in runs.items()}
        results: dict[str, object] = {
            "score": score.as_dict(),
            "runs": {name: run_json(run) for name, run in runs.items()},
            "episodes_sha256": {name: _episodes(run) for name, run in runs.items() if (run / EPISODES).is_file()},
            "took": study.took(named, prices).as_dict(),
            "prices": {spec: plain(prices.of(one.mode(spec))) for one in manifests.values() for spec in one.models},
            "replies_sha256": {
                name: {spec: digests(run / LEDGER, spec) for spec in manifests[name].models}
                for name, run in runs.items()
                if (run / LEDGER).is_file()
            },
        }
        drives = any(is_episodes(run) for run in runs.values())
    return DerivedResults.of(results, made, _HOW, (sources() if drives else {}) | _decisions(score), runs=len(runs))


def _decisions(score: object) -> dict[str, bytes]:
    """Return a table of every decision for each cell of a prompt study; empty for drives."""
    cells = score.batteries if isinstance(score, PromptsScore) else {}
    return {
        f"{TABLES}decisions-{name}.csv": decisions_table(cell).csv().encode("utf-8", "backslashreplace")
        for name, cell in cells.items()
    }


def _episodes(run: Path) -> dict[str, str]:
    """Return a digest of a run's episode records by policy, for what no drive can check."""
    found: dict[str, hashlib._Hash] = {}
    for episode in read_episodes(run):
        found.setdefault(episode.key.policy, hashlib.sha256()).update(
            episode.as_line().encode("utf-8", "backslashreplace")
        )
    return {policy: digest.hexdigest() for policy, digest in sorted(found.items())}


@contextmanager
def _called(folder: Path, name: str) -> Iterator[Path]:
    """Rename a folder to the run's name during the block, because a page prints that name."""
    within = folder.parent / "named"
    named = within / (name if _PLAIN_NAME.fullmatch(name) and name.strip(".") else RUN_FOLDER)
    within.mkdir()
    folder.rename(named)
    try:
        yield named
    finally:
        named.rename(folder)
        within.rmdir()
