"""The calls of a battery, exported to be made elsewhere: each with its key, its words and pictures.

A key holds for one bank, prompt and seed; with another of them each call has another key. A key
hides the frame and the condition from a reader of the export; the owner of the bank finds them
again.
"""

import csv
import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from pathlib import Path

from eyechart import __version__
from eyechart.calls import CallKey, Query
from eyechart.conditions import is_available
from eyechart.errors import LedgerError, OutputError, SpecError, raising
from eyechart.frames import MAIN, media_type, whole_folder
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER, RunManifest, asked_of, read_run
from eyechart.messages import Turn
from eyechart.models.faults import is_of_the_road
from eyechart.modes import ELSEWHERE, is_made_elsewhere
from eyechart.records import plain
from eyechart.report.table import no_formula
from eyechart.run import Plan, in_order
from eyechart.seeds import key_seed
from eyechart.studies.battery.plans import STUDY, Battery, BatterySettings, open_whole, plan_of, planned
from eyechart.studies.battery.stages import staged, stages_of, widest

FORMAT = "eyechart-asked/2"
TABLE, EXACT, ABOUT, README = "asked.csv", "asked.jsonl", "asked.json", "README.txt"
PICTURES = "pictures"
ANYBODY = f"{ELSEWHERE}:anybody"
"""The SPEC that seeds the calls where no model is named."""
KEYS = ("call", "repeat")
"""The columns that identify an answer."""
_ENDINGS = {"image/png": "png", "image/jpeg": "jpg", "image/webp": "webp", "image/bmp": "bmp"}
_HOW = """These are the calls of a battery of eyechart, to be made elsewhere.

asked.jsonl   one call per line, in the order in which a run would make them. Keep this order: else
              a drift of the model over time looks like an effect of a condition.
asked.csv     the same for a spreadsheet; a cell that it would take for a formula has an apostrophe before it.
asked.json    the prompt, and the schema of an answer.
pictures/     the pictures, named by their content; what a file is called says nothing about what it shows.

Make each call alone: the system words, the user's words, and the picture, or none where that is empty. Answers come
back as a table (CSV, JSON lines or Parquet). It has the columns call and repeat as they are here, and text with the
model's words verbatim. Where they are known it has finish_reason, error, served, prompt_tokens, completion_tokens,
seconds and cost_usd. A key does not say what its call is about; the owner of the bank finds it again.

  eyechart run import ANSWERS.jsonl --frames BANK --out RUN
"""
MESSAGES = "messages"
"""The column with all turns of a call, where the prompt has several, or pictures between words."""
_HOW_MESSAGES = """
The prompt of these calls has several messages, or pictures between its words. The column messages holds all of them
in order: send it, and not the columns system, user and picture, which hold only a part.
"""


@dataclass(frozen=True)
class Keys:
    """The keys of a run's calls about a bank, prompt and seed; the same on every machine.

    ``batch`` is the digest of the bank, the prompt, the seed and the encoding of pictures; an
    export holds it. ``own`` is a second digest of the same, which only the owner of the bank can
    make. Calls are named by it, so that nobody can find a key's frame and condition by trial.
    """

    batch: str
    own: str

    @classmethod
    def of(cls, manifest: RunManifest, plan: Plan) -> "Keys":
        """Return the keys of a run."""
        bank = plan.bank.manifest
        pictures = hashlib.sha256(json.dumps(sorted(bank.images.items())).encode()).hexdigest()
        said = (manifest.study, bank.fingerprint, pictures, plan.prompt.key, manifest.seed, manifest.encoding)
        return cls(*(hashlib.sha256(json.dumps(one).encode()).hexdigest() for one in (said, ("own", *said))))

    def call(self, condition: str, frame: str) -> str:
        """Return the key of a call about a frame under a condition."""
        return self._key(self.own, condition, frame)

    def older(self, condition: str, frame: str) -> str:
        """Return the key of the same call in an export of the first format."""
        return self._key(self.batch, condition, frame)

    def _key(self, digest: str, condition: str, frame: str) -> str:
        found = hashlib.sha256(json.dumps((digest, condition, frame)).encode()).hexdigest()
        return f"{self.batch[:8]}-{found[:20]}"

    def find(self, call: str, conditions: Iterable[str], frames: Iterable[str]) -> tuple[str, str] | None:
        """Return the condition and the frame of a key, out of these; None for an unknown key."""
        cells = product(conditions, frames)
        return next((one for one in cells if call in {self.call(*one), self.older(*one)}), None)

    def holds(self, call: str) -> bool:
        """Return whether a key belongs to this bank, prompt and seed, whichever its call."""
        return call.startswith(f"{self.batch[:8]}-")


@dataclass(frozen=True)
class Questions:
    """The calls of a planned battery for one SPEC, and the calls that are ``left``."""

    plan: Plan
    manifest: RunManifest
    left: tuple[CallKey, ...]
    left_out: Mapping[str, str]

    @cached_property
    def keys(self) -> Keys:
        """Return the keys of the calls."""
        return Keys.of(self.manifest, self.plan)

    @property
    def is_unnamed(self) -> bool:
        """Return whether no run of eyechart makes these calls itself, so that any seed will do."""
        return is_made_elsewhere(self.plan.models[0])

    @property
    def conditions(self) -> dict[str, int]:
        """Return how many calls are left under each condition, in the order of the plan."""
        counts = dict.fromkeys(self.plan.conditions_of(self.plan.models[0]), 0)
        for key in self.left:
            counts[key.condition] += 1
        return {name: count for name, count in counts.items() if count}

    def queries(self) -> Iterator[tuple[CallKey, Query]]:
        """Yield each remaining call with its query, in the order in which a run would make them."""
        stimuli = self.plan.stimuli()
        for key in self.left:
            yield key, self.plan.query(key, stimuli.show(key.condition, key.frame))


def questions_of(bank: Path, asking: BatterySettings, model: str | None = None) -> Questions:
    """Return the calls of a battery on a bank; ``model`` is the SPEC that seeds them.

    Raises BankError and SpecError as `plan` does.
    """
    spec = model or ANYBODY
    found = planned(bank, {}, {spec: ("", {})}, None, asking)
    wide = staged(found.plan, stages_of(found.manifest, found.plan, None))
    return Questions(wide, found.manifest, tuple(in_order(wide.keys_of(spec), wide.seed)), found.left_out)


def questions_left(bank: Path, run: Path, model: str | None = None) -> Questions:
    """Return a run's calls without an answer, including the controls that its answers call for.

    A call whose last reply is a failure in transport has no answer. ``model`` is one of the run's;
    it may be left out if there is only one. Raises SpecError for another model, LedgerError or
    BankError where the folder is no battery or the bank is another.
    """
    manifest, recorded = read_run(run)
    if manifest.study != STUDY:
        raise LedgerError(f"{run} is a run of the study '{manifest.study}'; only calls of a battery can be exported")
    spec = model if model is not None else next(iter(manifest.models), "")
    if spec not in manifest.models or (model is None and len(manifest.models) > 1):
        raise SpecError(f"{run} holds {', '.join(manifest.models) or 'no model'}: name one with --model")
    pictures = asked_of(open_whole(bank), manifest.prompt, manifest.reader)
    its_own = recorded.manifest.images.items() <= pictures.manifest.images.items()
    if pictures.manifest.fingerprint != manifest.fingerprint or not its_own:
        raise LedgerError(f"{run} was made on another bank than {bank}: give the run's own bank")
    whole = plan_of(manifest, pictures)
    with Ledger(run / LEDGER) as ledger:
        answered = ledger.finished() - {key for key, reply in ledger.replies(spec) if is_of_the_road(reply)}
        stages = stages_of(manifest, whole, ledger)
    one = replace(staged(whole, stages), models=(spec,))
    left = in_order((key for key in one.keys_of(spec) if key not in answered), one.seed)
    return Questions(one, manifest, tuple(left), {})


def showable(battery: Battery) -> Iterator[tuple[str, CallKey]]:
    """Yield every call that a run may make of its one model, by its new and its older key."""
    (spec,) = battery.plan.models
    keys, wide = Keys.of(battery.manifest, battery.plan), widest(battery.manifest, battery.plan)
    for key in wide.keys_of(spec):
        yield keys.call(key.condition, key.frame), key
        yield keys.older(key.condition, key.frame), key


def unasked(battery: Battery, condition: str, frame: str) -> str:
    """Return in words why a run has no call about a frame under a condition."""
    plan = battery.plan
    try:
        there = is_available(condition, plan.bank.frame(frame))
    except (SpecError, LookupError):
        there = False
    if not there:
        return f"frame '{frame}' cannot be shown under '{condition}'"
    if frame not in {one.id for one in plan.frames}:
        return f"frame '{frame}' is not among the --limit {battery.manifest.limit} frames of this run"
    return f"condition '{condition}' is none of this run: give the --conditions and --controls of the export"


def write_questions(
    questions: Questions, out: Path, *, progress: Callable[[int, int], None] = lambda *_: None
) -> tuple[int, int]:
    """Write the remaining calls with their pictures into a new folder; return both counts.

    The folder is written whole or not at all. Raises OutputError where it exists already or cannot
    be written, and SpecError where no call is left.
    """
    if not questions.left:
        raise SpecError("no call is left to be exported: every planned call has its answer")
    with _whole_folder(out) as work:
        (work / PICTURES).mkdir()
        return _write(questions, work, progress)


def _write(questions: Questions, work: Path, progress: Callable[[int, int], None]) -> tuple[int, int]:
    cameras = [camera.name for camera in questions.plan.bank.frames[0].cameras]
    names = {name: "picture" if name in {MAIN, cameras[0]} else f"picture@{name}" for name in cameras}
    several = [MESSAGES] if questions.plan.prompt.messages else []
    columns = [*KEYS, "seed", "system", "user", *names.values(), *several, "request_sha256"]
    files: dict[str, str] = {}
    with (work / EXACT).open("w", encoding="utf-8") as exact, (work / TABLE).open("w", encoding="utf-8") as table:
        sheet = csv.writer(table, lineterminator="\n")
        sheet.writerow(columns)
        for done, (key, query) in enumerate(questions.queries()):
            row: dict[str, object] = dict.fromkeys(columns, "")
            call = questions.keys.call(key.condition, key.frame)
            row |= dict(zip(KEYS, (call, key.repeat), strict=True))
            row |= {"seed": key_seed(0, call) if questions.is_unnamed else query.seed, "request_sha256": query.sha256()}
            row |= {"system": query.system, "user": query.user}
            row |= {names[camera]: _stored(image, work, files) for camera, image in query.stimulus.images.items()}
            row |= {MESSAGES: [_message(turn, work, files) for turn in query.messages]} if query.messages else {}
            exact.write(json.dumps(row, ensure_ascii=False) + "\n")
            sheet.writerow(list(map(_cell, row.values())))
            progress(done + 1, len(questions.left))
    (work / ABOUT).write_text(json.dumps(_about(questions), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    (work / README).write_text(_HOW + (_HOW_MESSAGES if several else ""), encoding="utf-8")
    return len(questions.left), len(files)


def _cell(value: object) -> object:
    """Return a value as a cell of the spreadsheet."""
    if isinstance(value, list):
        return json.dumps(value, ensure_ascii=False)
    return no_formula(value) if isinstance(value, str) else value


def _message(turn: Turn, work: Path, files: dict[str, str]) -> dict[str, object]:
    """Return a message as JSON, with the files of its pictures in their places."""
    content = [
        {"type": "text", "text": part}
        if isinstance(part, str)
        else {"type": "image", "image": _stored(part, work, files)}
        for part in turn.parts
    ]
    return {"role": turn.role, "content": content}


def _stored(image: bytes, work: Path, files: dict[str, str]) -> str:
    """Write a picture once, and return its place in the folder."""
    digest = hashlib.sha256(image).hexdigest()
    if digest not in files:
        files[digest] = f"{PICTURES}/{digest[:24]}.{_ENDINGS.get(media_type(image), 'bin')}"
        (work / files[digest]).write_bytes(image)
    return files[digest]


def _about(questions: Questions) -> dict[str, object]:
    return {
        "format": FORMAT,
        "eyechart": __version__,
        "bank": questions.plan.bank.name,
        "batch": questions.keys.batch,
        "prompt": plain(
            questions.manifest.prompt.wording() if questions.manifest.prompt.messages else questions.manifest.prompt
        ),
        "seeds_of": "" if questions.is_unnamed else questions.plan.models[0],
        "calls": len(questions.left),
        "actions": list(questions.plan.space.actions),
        "schema": questions.plan.space.schema(),
    }


@contextmanager
def _whole_folder(out: Path) -> Iterator[Path]:
    """Yield a folder that replaces ``out`` once it is complete; otherwise nothing is left of it."""
    if out.exists() and (not out.is_dir() or any(_entries(out))):
        raise OutputError(f"{out} exists and is not empty; choose another --out for the export")
    elsewhere = "; choose another place"
    with raising(OutputError, f"{out} cannot be written", elsewhere), whole_folder(out, OutputError) as work:
        yield work


def _entries(folder: Path) -> Iterable[Path]:
    with raising(OutputError, f"{folder} cannot be read"):
        return list(folder.iterdir())
