"""highway-env seen from above: four traffic scenarios as frame banks with ground truth, and as drives."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from eyechart.frames import FrameBank, MirrorAxis
from eyechart.simulators import Drive
from eyechart.simulators.highway.declared import MEANS, PICTURE, versions
from eyechart.spaces.discrete import DRIVING, Discrete


class Highway:
    """The ground vehicle of the paper (section Experimental Setup): light and dense traffic, merge, blocked lane."""

    name = "highway"
    presets: Mapping[str, str] = {
        "balanced": "Staged moments of natural traffic: every gap in every scenario, in no order, with LEFT and RIGHT "
        "demanded alike, no crash, and counterfactual pictures for every frame.",
        "paper": "Drives nearest to the published bank: the driver idles, drives on after a crash, and closes its gaps "
        "as time goes by.",
    }
    scenarios: Mapping[str, str] = {
        "light": "Three lanes and fifteen vehicles, for 30 seconds.",
        "dense": "Three lanes and twenty vehicles, closer together.",
        "merge": "Two lanes that vehicles join from a ramp; the drive ends behind it.",
        "blocked": "Three lanes and twenty vehicles, the nearest right ahead.",
    }
    picture = PICTURE
    mirror_axis: MirrorAxis = "vertical"
    action_space: Discrete = DRIVING
    commands: Mapping[str, str] = MEANS

    def build(
        self,
        out: Path,
        *,
        preset: str = "balanced",
        seeds: Sequence[int] = (0, 1, 2),
        steps: int = 12,
        progress: Callable[[int, int], None] | None = None,
    ) -> FrameBank:
        """Write a bank of four scenarios × ``seeds`` × ``steps`` frames into ``out``.

        ``progress`` gets the number of frames written and their total. Raises SpecError for an unknown preset,
        seeds that are negative, doubled or missing, and too few steps; BankError where ``out`` is taken.
        """
        from eyechart.simulators.highway.bank import build_bank  # noqa: PLC0415  (highway-env takes a second to import)

        return build_bank(out, preset=preset, seeds=seeds, steps=steps, progress=progress)

    def drive(self, scenario: str, seed: int) -> Drive:
        """Open one of the ladder's worlds at its beginning.

        Raises SpecError for an unknown scenario or a seed out of range.
        """
        from eyechart.simulators.highway.ladder import LadderDrive  # noqa: PLC0415  (as above)

        return LadderDrive(scenario, seed)

    def versions(self) -> dict[str, str]:
        """Return the versions of highway-env and of what it needs."""
        return versions()
