"""A look: from whatever is brought, a model, a callable or a policy, to one answer, in the steps of the long way.

The pictures become a bank, a served model is shown drawn ones first and its mode is pinned, the run asks it with early
stopping, and the verdict and the page come of that. All of it lies in one folder, and is what the commands of these
steps make; the same look again goes on where it stopped.
"""

from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

from eyechart.errors import SpecError, meant
from eyechart.frames import open_bank
from eyechart.importing.costs import taken
from eyechart.looking.answer import EXIT_CODES, Look, Pictured, Step
from eyechart.looking.models import ModelLook
from eyechart.looking.pictures import BANK, Pictures
from eyechart.looking.policies import PolicyLook, steps_of
from eyechart.looking.wanted import Bill, Wanted, Watch, folder_name
from eyechart.models import ADAPTERS, POLICIES, open_model, open_policy

__all__ = [
    "EXIT_CODES",
    "Bill",
    "Look",
    "Pictured",
    "Pictures",
    "Step",
    "Wanted",
    "Watch",
    "folder_name",
    "is_policy",
    "look",
    "spec_of",
]


SUMMARY = "summary.md"
"""The answer as tables in Markdown, in the look's folder."""


def spec_of(given: str) -> str:
    """Return the SPEC of what was given: ``python:`` comes before the ``MODULE:FUNCTION`` of a module that is there.

    Raises SpecError that says what was looked for where that may be meant, and no such module is there.
    """
    first, colon, rest = given.partition(":")
    if not colon or not rest or first in ADAPTERS or first in POLICIES:
        return given
    top = first.partition(".")[0]
    here = Path(f"{top}.py").is_file() or Path(top).is_dir()
    known = top.isidentifier() and (here or find_spec(top) is not None)
    if not known and rest.isidentifier() and all(map(str.isidentifier, first.split("."))):
        raise SpecError(
            f"unknown model '{given}';{meant(first, [*ADAPTERS, *POLICIES])} neither an adapter (see 'eyechart list "
            f"models') nor a module is called '{first}': no {top}.py lies in {Path.cwd()}, and none is installed"
        )
    return f"python:{given}" if known else given


def is_policy(spec: str, pictures: Pictures) -> bool:
    """Return whether a SPEC names a policy: a callable is one where the pictures come with motions."""
    adapter = spec.partition(":")[0]
    if adapter not in POLICIES or adapter not in ADAPTERS:
        return adapter in POLICIES
    if pictures.frames is not None:
        return open_bank(pictures.frames).manifest.motion is not None
    return pictures.dataset is not None


def look(wanted: Wanted, watch: Watch) -> Look:
    """Look at a model or a policy, and return the answer.

    Raises SpecError for what cannot be asked or was not agreed to, and what the steps raise: BankError, SourceError,
    LedgerError.
    """
    acts = is_policy(wanted.spec, wanted.pictures)
    if acts:
        wanted = replace(wanted, held=wanted.held or open_policy(wanted.spec))
    elif wanted.held is None:
        open_model(wanted.spec, wanted.mode)  # what is wrong with it is said before a bank is made
    brought = wanted.pictures.are_brought and not (wanted.out / BANK).exists()
    with watch.bar("frames", "frames") as move:
        bank = wanted.pictures.bank(wanted.out, move, steps_of(wanted) if acts else None)
    if brought:
        watch.say(*taken(open_bank(bank)))
    kind = PolicyLook if acts else ModelLook
    found = kind(wanted, bank, watch).look()
    wanted.out.mkdir(parents=True, exist_ok=True)
    (wanted.out / SUMMARY).write_text(found.markdown(), encoding="utf-8")
    return found
