"""Find once whether a served model sees its pictures, and its request mode, before a run."""

import json
import secrets
import shlex
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from eyechart.destination import whole
from eyechart.errors import LedgerError, raising
from eyechart.limits import NOTHING, Usage
from eyechart.looks.answer import Look, NextStep
from eyechart.looks.request import MODE, LookRequest
from eyechart.models.prices import Prices
from eyechart.modes import RequestMode, read_mode, write_mode
from eyechart.planned_run import Bar
from eyechart.probe import ProbeError, Sample, doctor, is_served, probe
from eyechart.records import build, parse_json

SPENT = "spent.json"
MOST_CALLS = 28 + 76
"""The most calls of a doctor and a probe together."""


@dataclass(frozen=True)
class SightFailure:
    """Why a model is not asked: it does not see the pictures, or cannot be asked at all."""

    because: str
    causes: tuple[str, ...]
    spent: Usage


@dataclass(frozen=True)
class SightChecks:
    """The tests of a model's sight and request mode; their findings stay in the look's folder."""

    out: Path
    prices: Prices
    bar: Bar

    def known(self, mode: RequestMode) -> RequestMode | None:
        """Return the model's known request mode; None if it must be found first."""
        place = self.out / MODE
        if place.is_file() and (kept := read_mode(place)).spec == mode.spec:
            return replace(kept, base_url=mode.base_url, query=mode.query)
        return None if is_served(mode) else mode

    @property
    def spent(self) -> Usage:
        """Return what earlier tests spent that gave no mode: the model was blind, or they were killed."""
        file = self.out / SPENT
        with raising(LedgerError, f"{file} does not say what was spent", of=(ValueError, RecursionError)):
            return build(Usage, parse_json(file.read_text(encoding="utf-8"))) if file.is_file() else NOTHING

    def _keep(self, *spent: Usage) -> None:
        """Write what was spent, atomically, so that no end of this process loses a call."""
        self.out.mkdir(parents=True, exist_ok=True)
        partly = self.out / f".{SPENT}"
        partly.write_text(json.dumps(Usage.together(spent).as_dict()), encoding="utf-8")
        partly.replace(self.out / SPENT)

    def find(self, mode: RequestMode, sample: Sample) -> RequestMode | SightFailure:
        """Test a model on drawn pictures, then find its request mode; both are kept."""
        seed, before = secrets.randbelow(10**6), self.spent
        with self.bar("sight", "calls") as tell:
            seen = doctor(mode, seed=seed, prices=self.prices, tell=tell, spend=partial(self._keep, before))
        if seen.outcome == "blind" or seen.unasked:
            return SightFailure(seen.because, seen.causes, seen.spent)
        try:
            with self.bar("probe", "calls") as tell:
                found = probe(
                    seen.mode,
                    fixed=("base_url",),
                    sample=sample,
                    seed=seed,
                    sight=seen.sight,
                    prices=self.prices,
                    tell=tell,
                    spend=partial(self._keep, before, seen.spent),
                )
        except ProbeError as error:
            spent = Usage.together([seen.spent, error.spent])
            return SightFailure("it cannot be asked in the way that the run needs", (str(error),), spent)
        calls = before.calls + seen.spent.calls + found.spent.calls
        pinned = replace(found.mode, measured=replace(found.measured, calls=calls))
        with whole(self.out / MODE, "request mode") as partly:
            write_mode(partly, pinned)
        (self.out / SPENT).unlink()  # the mode records it from here on
        return pinned


def doctor_command(wanted: LookRequest) -> str:
    """Return the command that shows a served model the drawn pictures and prints each result."""
    address = ("--base-url", wanted.mode.base_url) if wanted.mode.base_url else ()
    return shlex.join(["eyechart", "doctor", wanted.spec, *address])


def unseen(wanted: LookRequest, found: SightFailure) -> Look:
    """Return the answer about a model that is not asked, with its likely causes."""
    said = "; ".join(found.causes)
    because = f"No call about the frames was made, because it was not shown to see: {found.because}."
    steps = (
        NextStep("see each question and its reply", doctor_command(wanted)),
        NextStep("look again after the repair", wanted.command()),
    )
    causes = (f"Likely cause: {said}.",) if said else ()
    return Look(wanted.spec, "Inconclusive", because, causes, "unseen", next=steps, calls=found.spent.calls)
