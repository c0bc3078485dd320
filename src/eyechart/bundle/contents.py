"""What a bundle holds: what was asked and answered, and all that follows from it; and how it is packed."""

import hashlib
import json
import shutil
import tempfile
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated

import matplotlib as mpl
import PIL
from msgspec import Meta
from PIL import features

from eyechart import __version__
from eyechart.bundle.unpacking import check_names
from eyechart.calls import Reply
from eyechart.destination import require_free, whole
from eyechart.errors import BundleError
from eyechart.frames import FrameBank, inside, open_bank, read_bounded
from eyechart.ledger import SINCE_FORMAT_3, Ledger
from eyechart.manifest import BANK, BANK_TEXT, LEDGER, RUN, RunManifest, asked_of, read_run
from eyechart.records import Plain, build
from eyechart.report.table import files_of
from eyechart.spaces.reader import READER, READERS
from eyechart.spaces.scene import SCENE_READER
from eyechart.studies import Packed, Reading, Tell, study_of
from eyechart.studies.battery import BatteryScore
from eyechart.studies.battery.subjects import find_pictures, used_pictures
from eyechart.studies.policy.scoring import PolicyScore
from eyechart.studies.structured import StructuredScore

FORMAT = "eyechart-bundle/1"
INDEX = "bundle.json"
RESULTS = "results.json"
REPORT = "report.html"
README = "README.txt"
TABLES = "tables/"
RUN_FOLDER = "run"
_HOW = """This is a bundle of eyechart: a run, and what follows from it.

run/            what was asked and answered: run.json, ledger.sqlite, the bank's manifest and the pictures used
results.json    every statistic and verdict
report.html     the same for people, in any browser
tables/         the same as CSV, Markdown and LaTeX
bundle.json     how the results were made, and a digest of every file

  eyechart validate FILE.zip

recomputes all of it from run/ and names what differs.
"""
_EPOCH = (1980, 1, 1, 0, 0, 0)
_PACKED = {".png", ".jpg", ".jpeg", ".webp"}
"""Pictures that are small already."""
RESAMPLES = (100, 100_000)
"""Fewest and most resamples that a bundle may ask whoever validates it to draw."""


@dataclass(frozen=True)
class Recipe(Plain):
    """How results follow from a run: no number of theirs, only what was chosen when they were made.

    ``drawn_with`` are the versions on which the bytes of pictures and drawings depend.
    """

    name: str
    resamples: Annotated[int, Meta(ge=RESAMPLES[0], le=RESAMPLES[1])]
    independent: bool
    eyechart: str
    reader: int
    drawn_with: Mapping[str, str]

    @classmethod
    def here(cls, name: str, *, resamples: int, independent: bool, reader: int = READER) -> "Recipe":
        """Return the recipe of results that are made by this eyechart, with this version of the reader of replies."""
        return cls(name, resamples, independent, __version__, reader, drawn_with())

    @classmethod
    def from_dict(cls, raw: Mapping[str, object]) -> "Recipe":
        """Read a recipe, also one of another eyechart; raises BundleError where it is none."""
        try:
            return build(cls, {one.name: raw.get(one.name) for one in fields(cls)}, INDEX)
        except ValueError as error:
            raise BundleError(f"{INDEX} does not say how its results were made: {error}") from error

    @property
    def elsewhere(self) -> str | None:
        """Return in words which other eyechart or reader of replies made the results; None where it was this one."""
        if self.eyechart == __version__ and self.reader in {*READERS, SCENE_READER}:
            return None
        return (
            f"made by eyechart {self.eyechart!r} with version {self.reader} of the reader of replies, and this is "
            f"{__version__} with {READER}, of scenes {SCENE_READER}"
        )


def drawn_with() -> dict[str, str]:
    """Return the versions on which the bytes of a report's pictures and drawings depend."""
    return {
        "matplotlib": str(mpl.__version__),
        "pillow": PIL.__version__,
        "webp": str(features.version("webp")),
        "zlib": str(features.version("zlib")),
    }


@dataclass(frozen=True)
class Derived:
    """What follows from a run: its score, its results as plain values, and every file that prints them."""

    score: BatteryScore | StructuredScore | PolicyScore
    results: dict[str, object]
    files: dict[str, bytes]


def derive(
    run: Path, manifest: RunManifest, banks: tuple[FrameBank, FrameBank], recipe: Recipe, tell: Tell = lambda _: None
) -> Derived:
    """Compute results, report and tables from the ledger in a run's folder, its bank, and the bank with pictures."""
    tell("scoring")
    study, reading = study_of(run, "bundle"), Reading(recipe.independent, resamples=recipe.resamples)
    score, made = study.derive(Packed(recipe.name, manifest, banks[0], run / LEDGER, banks[1]), reading, tell)
    (verdicts,) = study.verdict_json(score).values()
    results: dict[str, object] = {
        "score": score.as_dict(),
        **({"verdicts": verdicts} if verdicts else {}),
        "replies_sha256": {spec: _digests(run / LEDGER, spec) for spec in score.models},
    }
    tables = {f"{TABLES}{name}": content for name, content in files_of(made.tables).items()}
    files = {RESULTS: as_json(results), REPORT: made.page.html, README: _HOW.encode(), **tables}
    return Derived(score, json.loads(files[RESULTS]), files)


def _digests(ledger_path: Path, spec: str) -> dict[str, str]:
    """Return a digest of all that the ledger holds of a model's calls, by condition; times of day are left out."""
    digests: dict[str, hashlib._Hash] = {}
    with Ledger(ledger_path) as ledger:
        for sent in ledger.attempts(spec):
            reply = None if sent.reply is None else _as_of_old(sent.reply)
            held = {name: one for name, one in sent._asdict().items() if name != "sent_at"}
            line = json.dumps({**held, "key": sent.key._asdict(), "reply": reply}).encode() + b"\n"
            digests.setdefault(sent.key.condition, hashlib.sha256()).update(line)
    return {condition: digest.hexdigest() for condition, digest in sorted(digests.items())}


def _as_of_old(reply: Reply) -> dict[str, object]:
    """Leave out what 0.1.0 did not record where it is unknown, so that an older run has the digest that it had."""
    values = ((one.name, getattr(reply, one.name)) for one in fields(reply))
    return {name: value for name, value in values if value is not None or name not in SINCE_FORMAT_3}


def digest_of(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def as_json(values: object) -> bytes:
    """Return plain values as the bytes of a JSON file."""
    text = json.dumps(values, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    return text.encode("utf-8", "backslashreplace")


def write_bundle(
    run: Path,
    out: Path,
    *,
    banks: Sequence[Path] = (),
    independent: bool = False,
    reread: bool = False,
    resamples: int = 5000,
    tell: Tell = lambda _: None,
) -> int:
    """Write a run with its pictures and all that follows from it as one ZIP file; return how many files it holds.

    Raises LedgerError or BankError where the folder is no run, BundleError where its pictures are
    not at hand, and OutputError where ``out`` may not be written.
    """
    require_free(out, "bundle")
    manifest, bank = read_run(run, reread=reread)
    study_of(run, "bundle").require_scorable(run, Reading(independent, reread))
    tell("looking for the pictures")
    pictures, about = find_pictures(manifest, bank, run, banks)
    if pictures is None:
        raise BundleError(f"the pictures of {run} are not at hand: {about}; give the bank with --frames")
    name, reader = run.resolve().name or "run", manifest.prompt.asks(bank.manifest.action_space).reader
    recipe = Recipe.here(name, resamples=resamples, independent=independent, reader=reader)
    with tempfile.TemporaryDirectory(prefix="eyechart-bundle-") as work:
        folder = Path(work) / "bundle"
        _snapshot(run, folder / RUN_FOLDER, manifest, pictures)
        manifest, bank = read_run(folder / RUN_FOLDER, reread=reread)
        held = open_bank(folder / RUN_FOLDER / BANK)
        derived = derive(folder / RUN_FOLDER, manifest, (bank, held), recipe, tell)
        for name, content in derived.files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        files = {path.relative_to(folder).as_posix(): digest_of(path) for path in _files(folder)}
        index = {"format": FORMAT, **recipe.as_dict(), "files": dict(sorted(files.items()))}
        (folder / INDEX).write_bytes(as_json(index))
        tell("packing")
        _pack(folder, out)
    return len(files) + 1


def _snapshot(run: Path, copy: Path, manifest: RunManifest, pictures: FrameBank) -> None:
    """Copy a run as it stands, with the pictures that it used, and without the place where they lay."""
    (copy / BANK).mkdir(parents=True)
    (copy / RUN).write_text(replace(manifest, bank_path=BANK).as_text(), encoding="utf-8")
    with Ledger(run / LEDGER) as ledger:
        ledger.copy_to(copy / LEDGER)
    for name in BANK_TEXT:
        shutil.copyfile(run / BANK / name, copy / BANK / name)
    for file in used_pictures(manifest, asked_of(pictures, manifest.prompt)):
        path = inside(copy / BANK, file)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(read_bounded(pictures.root, file))


def _files(folder: Path) -> Iterator[Path]:
    return (path for path in sorted(folder.rglob("*")) if path.is_file())


def _pack(folder: Path, out: Path) -> None:
    with whole(out, "bundle") as partial:
        with zipfile.ZipFile(partial, "w") as packed:
            for path in _files(folder):
                entry = zipfile.ZipInfo(path.relative_to(folder).as_posix(), _EPOCH)
                entry.create_system = 3
                entry.external_attr = 0o644 << 16
                small = path.suffix.lower() in _PACKED
                entry.compress_type = zipfile.ZIP_STORED if small else zipfile.ZIP_DEFLATED
                entry.file_size = path.stat().st_size
                with path.open("rb") as source, packed.open(entry, "w") as target:
                    shutil.copyfileobj(source, target, 1 << 20)
        check_names(partial)  # what could not be opened again is not written
