"""The hierarchy as a study."""

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

from eyechart.studies import Reading
from eyechart.studies.battery import NO_DRIVES
from eyechart.studies.closed_loop import NO_LEDGER, OfEpisodes
from eyechart.studies.hierarchy.scoring import HierarchyScore, runs_of, score


class Hierarchy(OfEpisodes[HierarchyScore]):
    """Sources of intent above a controller: up to seven runs of drives in one folder."""

    refuses: ClassVar = {**NO_LEDGER, **NO_DRIVES}

    def holds(self, folder: Path) -> bool:
        return bool(runs_of(folder))

    def runs(self, folder: Path) -> Mapping[str, Path]:
        return runs_of(folder)

    def score(self, folder: Path, reading: Reading) -> HierarchyScore:
        del reading
        return score(folder)
