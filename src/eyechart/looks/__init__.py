"""A look: one answer about any model, callable or policy, made from the usual steps.

The pictures become a bank. A served model first sees drawn pictures, and its request mode is found.
The run then asks it with early stopping, and the verdict and the page follow. All files are in one
folder, as the single commands would make them; the same look resumes there.
"""

from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

from eyechart.errors import SpecError, did_you_mean
from eyechart.frames import open_bank
from eyechart.importing.costs import costs, taken
from eyechart.looks.answer import EXIT_CODES, Look, NextStep, PictureResult
from eyechart.looks.models import ModelLook
from eyechart.looks.pictures import BANK, Pictures
from eyechart.looks.policies import PolicyLook, steps_of
from eyechart.looks.request import Bill, LookRequest, Watch, folder_name
from eyechart.models import ADAPTERS, POLICIES, history_of, open_model, open_policy, states

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
    known = top.isidentifier() and (here or find_spec(top) is not None)
    if not known and rest.isidentifier() and all(map(str.isidentifier, first.split("."))):
        raise SpecError(
            f"unknown model '{given}';{did_you_mean(first, [*ADAPTERS, *POLICIES])} '{first}' is neither an adapter "
            f"(see 'eyechart list models') nor a module: no {top}.py lies in {Path.cwd()}, and none is installed"
        )
    return f"python:{given}" if known else given


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
