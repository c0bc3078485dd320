"""The demo of policies: six small policies with a known use of their inputs, and their verdicts."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from eyechart.models import open_policy
from eyechart.models.trained import TRAINED
from eyechart.run import Progress
from eyechart.simulators import open_bank_simulator
from eyechart.studies.policy.plans import PolicySelection, plan, run
from eyechart.studies.policy.scores import PolicyScore, judge, score
from eyechart.verdicts.policy_verdict import PolicyVerdict

STEPS, SEEDS, ANSWERS = 6, 3, 2
"""Frames of an episode, seeds (12 episodes, 72 frames), and answers of a drawing policy."""

PRESETS = tuple(dict.fromkeys(one.preset for one in TRAINED.values()))
"""The presets of the banks; each has a run of its own."""

Watch = Callable[[str], Progress]
"""Returns the progress display for the run on a preset."""


@dataclass(frozen=True)
class DemoCase:
    """A policy of the demo: its verdict, and the labels that its training deserves, by axis."""

    verdict: PolicyVerdict
    says: str
    deserved: dict[str, str]

    @property
    def wrong(self) -> list[str]:
        """Return a sentence for each axis whose label is not the deserved one."""
        return [
            f"{axis} is {self.found[axis]}, deserved {label}"
            for axis, label in self.deserved.items()
            if self.found[axis] != label
        ]

    @property
    def found(self) -> dict[str, str]:
        """Return the labels that it got, by axis."""
        one = self.verdict
        labels = {"camera": one.camera, "state": one.state, "instruction": one.instruction}
        labels |= {f"{name} camera": judged for name, judged in one.cameras.items()}
        return {axis: labels[axis].label for axis in self.deserved}


def make(out: Path, seed: int, watch: Watch) -> tuple[list[PolicyScore], dict[str, DemoCase]]:
    """Build the banks and run each trained policy on its preset; a second call resumes."""
    # A missing package must raise its error before a bank is built.
    open_policy(f"trained:{next(iter(TRAINED))}")
    scores: list[PolicyScore] = []
    cases: dict[str, DemoCase] = {}
    for preset in PRESETS:
        bank, folder = out / f"bank-{preset}-{seed}", out / f"run-{preset}-{seed}"
        if not bank.exists():
            seeds = range(SEEDS * seed, SEEDS * (seed + 1))
            open_bank_simulator("tabletop").build(bank, preset=preset, seeds=seeds, steps=STEPS)
        specs = [f"trained:{name}" for name, one in TRAINED.items() if one.preset == preset]
        run(plan(bank, specs, folder, seed=seed, extent=PolicySelection(answers=ANSWERS)), progress=watch(preset))
        scored = score(folder)
        scores.append(scored)
        cases |= {spec: shown(spec, verdict) for spec, verdict in judge(scored).items()}
    return scores, {f"trained:{name}": cases[f"trained:{name}"] for name in TRAINED}


def shown(spec: str, verdict: PolicyVerdict) -> DemoCase:
    """Return a verdict together with the labels that the training deserves."""
    lesson = TRAINED[spec.removeprefix("trained:")]
    deserved = {"camera": lesson.camera, "state": lesson.state, "instruction": lesson.instruction}
    deserved |= {f"{name} camera": label for name, label in lesson.cameras.items()}
    return DemoCase(verdict, lesson.says, deserved)
