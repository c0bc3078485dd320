"""A look: one answer about any model, callable or policy, made from the usual steps.

The pictures become a bank. A served model first sees drawn pictures, and its request mode is found.
The run then asks it with early stopping, and the verdict and the page follow. All files are in one
folder, as the single commands would make them; the same look resumes there.
"""

from contextlib import suppress
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from eyechart.errors import SpecError, did_you_mean
from eyechart.frames import open_bank
from eyechart.importing.costs import costs, taken
from eyechart.looks.answer import EXIT_CODES, Look, NextStep, PictureResult
from eyechart.looks.models import ModelLook
from eyechart.looks.pictures import BANK, Pictures
from eyechart.looks.policies import PolicyLook, steps_of
from eyechart.looks.request import Bill, LookRequest, Watch, folder_name
from eyechart.models import ADAPTERS, POLICIES, history_of, open_model, open_policy, states

if TYPE_CHECKING:
    from eyechart.edits import Moves

__all__ = [
    "EXIT_CODES",
    "Bill",
    "Look",
    "LookRequest",
    "NextStep",
    "PictureResult",
    "Pictures",
    "Watch",
    "folder_name",
    "is_policy",
    "look",
    "look_at_sheet",
    "spec_of",
]


SUMMARY = "summary.md"
"""The answer as Markdown tables, in the look's folder."""


def spec_of(given: str) -> str:
    """Return the SPEC of a given text; an existing module's ``MODULE:FUNCTION`` gets ``python:``.

    Raises SpecError that names the missing module if the text looks like one.
    """
    first, colon, rest = given.partition(":")
    if not colon or not rest or first in ADAPTERS or first in POLICIES:
        return given
    top = first.partition(".")[0]
    here = Path(f"{top}.py").is_file() or Path(top).is_dir()
    known = top.isidentifier() and (here or _is_installed(top))
    if not known and rest.isidentifier() and all(map(str.isidentifier, first.split("."))):
        raise SpecError(
            f"unknown model '{given}';{did_you_mean(first, [*ADAPTERS, *POLICIES])} '{first}' is neither an adapter "
            f"(see 'eyechart list models') nor a module: no {top}.py lies in {Path.cwd()}, and none is installed"
        )
    return f"python:{given}" if known else given


def _is_installed(module: str) -> bool:
    """Return whether a module is found; a running one that has no file, as ``__main__``, is not."""
    with suppress(ValueError):
        return find_spec(module) is not None
    return False


def is_policy(spec: str, pictures: Pictures) -> bool:
    """Return whether a SPEC names a policy; a callable is one if the pictures have motions.

    A model that answers in words is one too, unless the pictures have distances to brake for.
    """
    adapter = spec.partition(":")[0]
    if adapter not in POLICIES or adapter not in ADAPTERS:
        return adapter in POLICIES
    if pictures.frames is not None:
        manifest = open_bank(pictures.frames).manifest
        return manifest.motion is not None and not (states(spec) and manifest.gap is not None)
    return pictures.dataset is not None and not (states(spec) and pictures.threshold is not None)


def look(wanted: LookRequest, watch: Watch) -> Look:
    """Look at a model or a policy, and return the answer.

    Raises SpecError if it cannot be asked or the cost was not agreed to. The steps raise BankError,
    SourceError and LedgerError.
    """
    wanted.require_own_folder()
    acts, history = is_policy(wanted.spec, wanted.pictures), 0
    if acts and states(wanted.spec):
        open_policy(wanted.mode)  # reports what is wrong with it before a bank is made
    elif acts:
        held = wanted.held or open_policy(wanted.spec)
        wanted, history = replace(wanted, held=held), history_of(held.model.facts)
    elif wanted.held is None:
        open_model(wanted.spec, wanted.mode)  # reports what is wrong with it before a bank is made
    brought = wanted.pictures.are_brought and not (wanted.out / BANK).exists()
    with watch.bar("frames", "frames") as move:
        bank = wanted.pictures.bank(wanted.out, move, steps_of(wanted) if acts else None, history)
    if brought:
        made = open_bank(bank)
        watch.say(*taken(made), *costs(made))
    kind = PolicyLook if acts else ModelLook
    result = kind(wanted, bank, watch).look()
    wanted.out.mkdir(parents=True, exist_ok=True)
    (wanted.out / SUMMARY).write_text(result.markdown(), encoding="utf-8")
    return result


def look_at_sheet(wanted: LookRequest, objects: Path, moves: "Moves", watch: Watch) -> Look:
    """Edit a look's photographs into its folder, and return the answer that stops at the sheet."""
    from eyechart.edits import TABLE, EditSource, edit_photographs, read_annotations  # noqa: PLC0415 - rarely used

    photos, table, out = wanted.pictures.photos, wanted.pictures.table, wanted.out / "edited"
    if photos is None or table is None:
        raise SpecError("--objects belongs to --photos FOLDER and --table FILE: they say what these objects are in")
    threshold = wanted.pictures.threshold or moves.between
    brought = replace(wanted.pictures, photos=out, table=out / TABLE, threshold=threshold, unit="m")
    step = NextStep("go on, if these are pictures of a road", replace(wanted, pictures=brought).command())
    if out.exists():
        raise SpecError(f"{out} was edited already: look at {out / 'sheet.png'}, then '{step.command}'")
    source = EditSource(photos, read_annotations(photos, table, objects), objects.parent)
    with watch.bar("edit", "photographs") as move:
        record = edit_photographs(source, moves, out, move)
    watch.say(*record.lines(out))
    because = f"No call was made yet. First look at {out / 'sheet.png'}: are these pictures of a road?"
    return Look(wanted.spec, "Inconclusive", because, next=(step,))
