"""Admission and structured runs, and the online run, as studies."""

from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

from eyechart.gate import ADMISSION, Gate, hold_admission
from eyechart.studies import Reading
from eyechart.studies.battery import NO_DRIVES, OfFrames
from eyechart.studies.closed_loop import NO_LEDGER, OfEpisodes
from eyechart.studies.structured import online
from eyechart.studies.structured.planning import STUDIES
from eyechart.studies.structured.scoring import StructuredScore, score
from eyechart.studies.structured.vetting import VETTING

_NO_VERDICT = "is a run of scene estimates, which are held to clauses instead: use 'eyechart score' or 'eyechart gate'"


class Structured(OfFrames[StructuredScore]):
    """Scene estimates of frames and of their reflections."""

    names = STUDIES
    requirements = ADMISSION
    required = "admission"
    refuses: ClassVar = {**NO_DRIVES, **dict.fromkeys(("verdict", "compare", "transfer"), _NO_VERDICT)}

    def score(self, folder: Path, reading: Reading) -> StructuredScore:
        return score(folder, reread=reading.reread)

    def gate(self, score: StructuredScore, require: Sequence[str], max_unparsed: float | None) -> Gate:
        return hold_admission(score, require, max_unparsed=max_unparsed)


class OnlineStudy(OfEpisodes[online.OnlineScore]):
    """Estimators that drive through the safety policy."""

    refuses: ClassVar = {
        **NO_LEDGER,
        **NO_DRIVES,
        "gate": "is an online run, which bounds no claim: hold an admission or structured run to one",
    }

    def holds(self, folder: Path) -> bool:
        return (folder / VETTING).is_file()

    def score(self, folder: Path, reading: Reading) -> online.OnlineScore:
        del reading
        return online.score(folder)
