"""The battery as a study, and what studies of the frames of a bank share."""

from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

from eyechart.gate import REQUIREMENTS, Gate, hold
from eyechart.manifest import read_manifest
from eyechart.models.prices import Prices
from eyechart.studies import Reading, S, Study, Took, run_json
from eyechart.studies.battery.planning import STUDY
from eyechart.studies.battery.scoring import BatteryScore, score, took

NO_DRIVES = {"against": "is no run of drives, and --against names a policy of one"}


class OfFrames(Study[S]):
    """A study whose runs are calls about the frames of a bank. ``names`` are those that its manifests give it."""

    names: ClassVar[Sequence[str]]
    refuses = NO_DRIVES

    def holds(self, folder: Path) -> bool:
        return run_json(folder).get("study") in self.names

    def took_run(self, run: Path, prices: Prices) -> Took:
        return Took(*took(run, prices=prices), probes=dict(read_manifest(run).probes))


class BatteryStudy(OfFrames[BatteryScore]):
    """The input-ablation battery."""

    names = (STUDY,)
    requirements = REQUIREMENTS
    required = "depth"

    def score(self, folder: Path, reading: Reading) -> BatteryScore:
        return score(folder, independent=reading.independent, reread=reading.reread)

    def gate(self, score: BatteryScore, require: Sequence[str], max_unparsed: float | None) -> Gate:
        return hold(score, require, max_unparsed=max_unparsed)
