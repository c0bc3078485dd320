"""highway-env from above: four traffic scenarios as frame banks with ground truth and as drives."""

from eyechart.simulators import Declaration, Drive
from eyechart.simulators.banks import BankMaker, Preset, versions_of
from eyechart.spaces.discrete import DRIVING


class Highway(BankMaker):
    """The paper's ground vehicle (section Experimental Setup) in light, dense, merge and blocked.

    Its commands are highway-env's meta-actions with speeds of 20, 25 and 30 m/s. There is no stop,
    so STOP and SLOW drive equally. With IDLE instead of FASTER, STRAIGHT would drive at 24 m/s,
    which the paper's table (28.1) excludes.
    """

    declared = Declaration(
        name="highway",
        picture="top-down drawing of a highway (highway-env, 600 × 150 pixels)",
        mirror_axis="vertical",
        action_space=DRIVING,
        camera="highway",
        scenarios={
            "light": "Three lanes and fifteen vehicles, for 30 seconds.",
            "dense": "Three lanes and twenty vehicles, closer together.",
            "merge": "Two lanes that vehicles join from a ramp; the drive ends behind it.",
            "blocked": "Three lanes and twenty vehicles, the nearest right ahead.",
        },
        presets={
            "balanced": "Staged moments of natural traffic: every gap in every scenario, in no order, with LEFT and "
            "RIGHT demanded equally, no crash, and counterfactual pictures for every frame.",
            "paper": "Drives nearest to the paper's bank: the driver idles, drives on after a crash, and closes its "
            "gaps as time goes by.",
        },
        commands={
            "STOP": "SLOWER",
            "SLOW": "SLOWER",
            "STRAIGHT": "FASTER",
            "LEFT": "LANE_LEFT",
            "RIGHT": "LANE_RIGHT",
        },
    )

    def open_preset(self, name: str) -> Preset:
        """Return the staged moments of ``balanced``, or the drives of ``paper``."""
        from eyechart.simulators.highway.drives import PAPER  # noqa: PLC0415  (highway-env takes a second to import)
        from eyechart.simulators.highway.staged_moments import BALANCED  # noqa: PLC0415

        return {"balanced": BALANCED, "paper": PAPER}[name]

    def drive(self, scenario: str, seed: int) -> Drive:
        """Open one of the ladder's worlds at its beginning.

        Raises SpecError for an unknown scenario or a seed out of range.
        """
        from eyechart.simulators.highway.drives import LadderDrive  # noqa: PLC0415  (as above)

        return LadderDrive(scenario, seed, self.declared.commands)

    def versions(self) -> dict[str, str]:
        """Return the versions of the libraries; pygame has either of two names."""
        return versions_of(("highway-env", "gymnasium", "numpy", "pygame-ce", "pygame"))
