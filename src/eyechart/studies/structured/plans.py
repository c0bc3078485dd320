"""Plans the structured study: frames and their reflections through a view; sixteen to admit."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eyechart.errors import BankError
from eyechart.frames import Frame, FrameBank
from eyechart.manifest import RunManifest
from eyechart.modes import RequestMode
from eyechart.perception.forward import worlds_distances
from eyechart.perception.view import NONE, view_for
from eyechart.prompts import scene_prompt
from eyechart.seeds import key_seed
from eyechart.spaces.scene import SCENE_READER
from eyechart.studies.battery import Battery, open_models, open_whole, plan_of, resume_manifest

ADMISSION, STRUCTURED = "admission", "structured"
STUDIES = (ADMISSION, STRUCTURED)
CONDITIONS = ("real", "mirrored")
PAIRS_A_CLASS = 8


def plan(
    study: str,
    bank_path: Path,
    specs: Sequence[str | RequestMode],
    out: Path,
    *,
    view: str | None = None,
    seed: int = 0,
    limit: int | None = None,
) -> Battery:
    """Plan an ``admission`` or ``structured`` run, or the rest of one in ``out``; makes no call.

    ``view`` is ``calibrated`` or ``none``; the default is calibrated where the bank's pictures have
    such a view. Admission uses 8 close and 8 other frames, chosen by ``seed``; the manifest records
    their ids. A structured run uses all frames or the first ``limit``. Every frame needs a mirror
    axis, and the bank a gap. `eyechart.studies.battery` counts, estimates, runs and resumes the
    plan. Raises BankError, SpecError or LedgerError as a battery's plan does.
    """
    modes, models = open_models(specs)
    bank = open_whole(bank_path)
    if bank.manifest.gap is None:
        raise BankError(f"the bank {bank.root} records no gap, so it is unknown which leads are close")
    for frame in bank:
        if frame.mirror_axis == "none":
            raise BankError(f"frame '{frame.id}' has no mirror axis, but every estimate needs the mirrored view too")
    shown = view_for(view, bank.manifest.simulator)
    chosen = choose(bank, seed) if study == ADMISSION else ()
    manifest = RunManifest.begun(
        bank,
        modes,
        {spec: (model.version, model.facts) for spec, model in models.items()},
        study=study,
        seed=seed,
        prompt=scene_prompt(bank.manifest.picture, worlds_distances(bank), shown),
        conditions=CONDITIONS,
        limit=limit,
        shard=None,
        reader=SCENE_READER,
        view=NONE if shown is None else shown.key,
        frames=tuple(frame.id for frame in chosen),
    )
    manifest = resume_manifest(out, manifest, bank)
    calls = plan_of(manifest, bank, models=tuple(models), conditions=CONDITIONS, limit=limit, view=shown)
    return Scenes(calls, models, manifest, out)


@dataclass(frozen=True)
class Scenes(Battery):
    """A battery whose answers are scene estimates, through a view."""

    def sizes(self) -> list[str]:
        """Return the view, how many calls there are, and whether a schema binds the answers."""
        modes = map(self.manifest.mode, self.plan.models)
        return [f"view: {self.manifest.view}", *super().sizes(), *bound(modes)]


def bound(modes: Iterable[RequestMode]) -> list[str]:
    """Return for each model whether its server gets the schema, or was found to ignore it."""
    lines = []
    for mode in modes:
        if mode.spec.startswith("scripted:"):
            continue
        if mode.spec.startswith("hf:"):
            lines.append(f"{mode.spec}: replies are read strictly; a checkpoint run here binds no schema")
        elif mode.structured != "json_schema":
            lines.append(f"{mode.spec}: replies are read strictly; --json-mode json_schema binds the schema")
        elif mode.measured is not None and mode.measured.schema_binds is False:
            lines.append(f"warning: {mode.spec}: the schema is sent, but a probe found that this server ignores it")
    return lines


def choose(bank: FrameBank, seed: int) -> tuple[Frame, ...]:
    """Return the admission set in the bank's order: 8 close and 8 other frames, by the seed.

    Within a class the actions that the safety policy demands are taken in turn, so the set demands
    as many of them as the bank has. The episodes of an action are taken in turn too. Raises
    BankError where the bank has too few frames of a class.
    """
    rng = np.random.default_rng(key_seed("admission", seed, bank.manifest.fingerprint))
    chosen, gap = list[Frame](), bank.manifest.gap
    for close, name in ((True, "close"), (False, "other")):
        frames = [frame for frame in bank if (gap is not None and gap.is_near(frame)) == close]
        if len(frames) < PAIRS_A_CLASS:
            raise BankError(
                f"the bank {bank.root} has {len(frames)} {name} frames, and admission needs {PAIRS_A_CLASS}: "
                "build or import a larger one"
            )
        chosen += _in_turn([frames[place] for place in rng.permutation(len(frames))])[:PAIRS_A_CLASS]
    order = {frame.id: place for place, frame in enumerate(bank)}
    return tuple(sorted(chosen, key=lambda frame: order[frame.id]))


def _in_turn(frames: Sequence[Frame]) -> list[Frame]:
    """Return the frames with demanded actions in turn, and within an action the episodes."""
    by_demand: dict[str, list[Frame]] = {}
    for frame in frames:
        by_demand.setdefault(str(frame.truth.get("demand")), []).append(frame)
    ranked: list[tuple[int, int, Frame]] = []
    for number, group in enumerate(by_demand.values()):
        taken: Counter[str] = Counter()
        turns: list[tuple[int, int]] = []
        for place, frame in enumerate(group):
            turns.append((taken[frame.drive], place))
            taken[frame.drive] += 1
        ranked += [(rank, number, group[place]) for rank, (_, place) in enumerate(sorted(turns))]
    return [frame for _, _, frame in sorted(ranked, key=lambda one: one[:2])]
