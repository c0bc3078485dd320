"""The contents of a bundle of a run on a bank: its calls and all results."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated

import matplotlib as mpl
import PIL
from msgspec import Meta
from PIL import features

from eyechart import __version__
from eyechart.calls import Reply
from eyechart.errors import BundleError, raising
from eyechart.frames import FrameBank
from eyechart.ledger import SINCE_FORMAT_3, Ledger
from eyechart.manifest import LEDGER, RunManifest
from eyechart.records import JsonRecord, build
from eyechart.report.table import files_of
from eyechart.spaces.reader import READER, READERS
from eyechart.studies import BundledRun, ReadOptions, StudyReport, Tell, study_of
from eyechart.studies.battery import BatteryScore
from eyechart.studies.battery.tables import decisions_table

FORMAT = "eyechart-bundle/1"
INDEX = "bundle.json"
RESULTS = "results.json"
REPORT = "report.html"
README = "README.txt"
TABLES = "tables/"
DECISIONS = f"{TABLES}decisions.csv"
"""Every decision of a battery, for an independent count: docs/bundles.md."""
RUN_FOLDER = "run"
SOURCE = "source/"
ALONE = "run"
"""The name of a single run in the results."""
_SINCE = {"runs", "episodes_sha256"}
"""Results that an older eyechart does not have."""
_HOW = """This is a bundle of eyechart: a run, and what follows from it.

run/            what was asked and answered: run.json, ledger.sqlite, the bank's manifest and the pictures used
results.json    every statistic and verdict, and what the run says of itself
report.html     the same for people, in any browser
tables/         the same as CSV, Markdown and LaTeX; of a battery every decision, in decisions.csv
bundle.json     how the results were made, and a digest of every file

  eyechart validate FILE.zip

recomputes all of it from run/ and names what differs.
"""
RESAMPLES = (100, 100_000)
"""Fewest and most resamples that a bundle may request from a validation."""


@dataclass(frozen=True)
class Recipe(JsonRecord):
    """How results follow from a run: the choices that were made, and no result.

    ``drawn_with`` are the library versions that the bytes of pictures and drawings depend on.
    """

    name: str
    resamples: Annotated[int, Meta(ge=RESAMPLES[0], le=RESAMPLES[1])]
    independent: bool
    eyechart: str
    reader: int
    drawn_with: Mapping[str, str]

    @classmethod
    def here(cls, name: str, *, resamples: int, independent: bool, reader: int = READER) -> "Recipe":
        """Return the recipe of this eyechart, with this version of the reader of replies."""
        return cls(name, resamples, independent, __version__, reader, drawn_with())

    @classmethod
    def from_dict(cls, raw: Mapping[str, object]) -> "Recipe":
        """Read a recipe, also of another eyechart; raises BundleError if it is none."""
        with raising(BundleError, f"{INDEX} does not say how its results were made", of=ValueError):
            return build(cls, {field.name: raw.get(field.name) for field in fields(cls)}, INDEX)

    def elsewhere(self, readers: Sequence[int] = READERS) -> str | None:
        """Return in words which other eyechart or reader made the results; None for this one.

        ``readers`` are the reader versions that can read the run's replies here, today's last.
        """
        if self.eyechart == __version__ and self.reader in readers:
            return None
        return (
            f"made by eyechart {self.eyechart!r} with version {self.reader} of the reader of replies, and this is "
            f"{__version__} with {readers[-1]}"
        )


def drawn_with() -> dict[str, str]:
    """Return the library versions that the bytes of pictures and drawings depend on."""
    return {
        "matplotlib": str(mpl.__version__),
        "pillow": PIL.__version__,
        "webp": str(features.version("webp")),
        "zlib": str(features.version("zlib")),
    }


@dataclass(frozen=True)
class DerivedResults:
    """All that follows from a run: results as plain values, files that print them, counts."""

    results: dict[str, object]
    files: dict[str, bytes]
    counted: dict[str, int]

    @classmethod
    def of(
        cls, results: Mapping[str, object], made: StudyReport, how: str, more: Mapping[str, bytes], **counted: int
    ) -> "DerivedResults":
        """Return the files of results and a report, with ``how`` to read them and ``more``."""
        files = {RESULTS: as_json(results), REPORT: made.page.html, README: how.encode()}
        files |= {f"{TABLES}{name}": content for name, content in files_of(made.tables).items()}
        return cls(json.loads(files[RESULTS]), {**files, **more}, counted)


def derive(
    run: Path, manifest: RunManifest, banks: tuple[FrameBank, FrameBank], recipe: Recipe, tell: Tell = lambda _: None
) -> DerivedResults:
    """Compute results, report and tables from a run's folder, its bank, and its pictures' bank."""
    tell("scoring")
    study, reading = study_of(run, "bundle"), ReadOptions(recipe.independent, resamples=recipe.resamples)
    score, made = study.derive(BundledRun(recipe.name, manifest, banks[0], run / LEDGER, banks[1]), reading, tell)
    (verdicts,) = study.verdict_json(score).values()
    results: dict[str, object] = {
        "score": score.as_dict(),
        **({"verdicts": verdicts} if verdicts else {}),
        "runs": {ALONE: json.loads(manifest.as_text())},
        "replies_sha256": {spec: digests(run / LEDGER, spec) for spec in score.models},
    }
    more = {}
    if isinstance(score, BatteryScore):
        more[DECISIONS] = decisions_table(score).csv().encode("utf-8", "backslashreplace")
    models = score.models.values()
    statistics, calls = sum(len(model.statistics) for model in models), sum(model.answered for model in models)
    return DerivedResults.of(results, made, _HOW, more, models=len(manifest.models), statistics=statistics, calls=calls)


def said_since(printed: Mapping[str, object], derived: Mapping[str, object]) -> dict[str, object]:
    """Return results without those that an older eyechart did not print."""
    return {name: value for name, value in derived.items() if name in printed or name not in _SINCE}


def digests(ledger_path: Path, spec: str) -> dict[str, str]:
    """Return a digest of a model's calls in the ledger by condition, without times of day."""
    digests: dict[str, hashlib._Hash] = {}
    with Ledger(ledger_path) as ledger:
        for sent in ledger.attempts(spec):
            reply = None if sent.reply is None else _as_of_old(sent.reply)
            held = {name: one for name, one in sent._asdict().items() if name != "sent_at"}
            line = json.dumps({**held, "key": sent.key._asdict(), "reply": reply}).encode() + b"\n"
            digests.setdefault(sent.key.condition, hashlib.sha256()).update(line)
    return {condition: digest.hexdigest() for condition, digest in sorted(digests.items())}


def _as_of_old(reply: Reply) -> dict[str, object]:
    """Return a reply without unknown fields that 0.1.0 lacked, to keep an older digest."""
    values = ((field.name, getattr(reply, field.name)) for field in fields(reply))
    return {name: value for name, value in values if value is not None or name not in SINCE_FORMAT_3}


def digest_of(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def as_json(values: object) -> bytes:
    """Return plain values as the bytes of a JSON file."""
    text = json.dumps(values, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    return text.encode("utf-8", "backslashreplace")
