"""The demo of models: every scripted controller or organism, and the verdict that it declares."""

from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

from eyechart.models import open_model
from eyechart.models.scripted import CONTROLLERS
from eyechart.modes import RequestMode
from eyechart.planned_run import Bar
from eyechart.simulators import open_bank_simulator
from eyechart.studies.battery.plans import plan, run
from eyechart.studies.battery.scores import BatteryScore, score
from eyechart.verdicts import Verdict, judge

_AT_ONCE = 48
"""Concurrent calls of an organism: one batch of it."""


@dataclass(frozen=True)
class BatteryDemo:
    """A demo's run and its verdicts; ``declared`` are the labels, ``says`` what each model does."""

    run: Path
    score: BatteryScore
    verdicts: Mapping[str, Verdict]
    declared: Mapping[str, str]
    says: Mapping[str, str]

    @property
    def explained(self) -> dict[str, tuple[str, str, str]]:
        """Return by model the answer, the label, and its permitted use with the reason."""
        found = {}
        for spec, one in self.verdicts.items():
            reason = one.calibrated.reason
            found[spec] = one.answer, one.calibrated.label, f"{one.trust} {reason[:1].upper()}{reason[1:]}."
        return found

    @property
    def wrong(self) -> list[str]:
        """Return the models whose label is not the declared one."""
        return [spec for spec, one in self.verdicts.items() if one.calibrated.label != self.declared[spec]]


def make(out: Path, seed: int, bar: Bar, kept: AbstractContextManager[None], *, vlm: bool) -> BatteryDemo:
    """Build a highway bank, and run the controllers or the organisms on it; a second call resumes.

    ``kept`` holds while calls are made, and says after an interrupt what is kept.
    """
    if vlm:
        from eyechart.models.huggingface.organisms import ORGANISMS  # noqa: PLC0415 - of another distribution

        declared = {f"hf:organism:{name}": (one.calibrated, one.says) for name, one in ORGANISMS.items()}
    else:
        declared = {f"scripted:{name}": (one.declared.calibrated, one.says) for name, one in CONTROLLERS.items()}
    # The checkpoint itself says whether it samples its answers.
    modes = [RequestMode(spec, temperature=None, max_tokens=16) if vlm else RequestMode(spec) for spec in declared]
    open_model(modes[0].spec, modes[0])  # names a missing package before a bank is built
    bank, folder = out / f"bank-{seed}", out / (f"run-vlm-{seed}" if vlm else f"run-{seed}")
    if not bank.exists():
        with bar("frames", "frames") as move:
            open_bank_simulator("highway").build(bank, seeds=range(3 * seed, 3 * seed + 3), progress=move)
    with kept, bar("calls", "calls") as move:
        run(plan(bank, modes, folder, seed=seed), concurrency=_AT_ONCE if vlm else 8, progress=move)
    scored = score(folder)
    labels, says = ({spec: both[at] for spec, both in declared.items()} for at in (0, 1))
    return BatteryDemo(folder, scored, judge(scored), labels, says)
