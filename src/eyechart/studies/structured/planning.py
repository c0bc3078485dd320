"""Planning the structured study: every frame and its reflection through the view; for admission sixteen pairs."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from eyechart.errors import BankError
from eyechart.frames import Frame, FrameBank
from eyechart.manifest import PNG_2, RunManifest, today, versions
from eyechart.modes import RequestMode
from eyechart.perception.forward import worlds_distances
from eyechart.perception.view import NONE, view_for
from eyechart.prompts import scene_prompt
from eyechart.seeds import key_seed
from eyechart.spaces.scene import SCENE_READER
from eyechart.studies.battery import Battery, open_models, open_whole, plan_of, resumed

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
    """Plan an ``admission`` or a ``structured`` run, or the rest of one that ``out`` holds; nothing is asked yet.

    ``view`` is ``calibrated`` or ``none``, and by default calibrated where the bank's pictures have such a view.
    Admission asks about 8 close and 8 other frames, chosen by ``seed``, whose ids the manifest records; the structured
    run about all frames or the first ``limit``. Every frame needs a mirror axis, and the bank a gap. The plan is
    counted, estimated, run and resumed by `eyechart.studies.battery`. Raises BankError, SpecError or LedgerError as a
    battery's plan does.
    """
    asked, models = open_models(specs)
    bank = open_whole(bank_path)
    if bank.manifest.gap is None:
        raise BankError(f"the bank {bank.root} records no gap, so nobody can say which leads are close")
    for frame in bank:
        if frame.mirror_axis == "none":
            raise BankError(f"frame '{frame.id}' has no mirror axis, and every estimate is asked for in both views")
    shown = view_for(view, bank.manifest.simulator)
    chosen = choose(bank, seed) if study == ADMISSION else ()
    manifest = RunManifest(
        study=study,
        created=today(),
        seed=seed,
        prompt=scene_prompt(bank.manifest.picture, worlds_distances(bank), shown),
        models={spec: model.version for spec, model in models.items()},
        conditions=CONDITIONS,
        limit=limit,
        shard=None,
        bank_path=str(bank_path.resolve()),
        fingerprint=bank.manifest.fingerprint,
        versions=versions(),
        modes=asked,
        facts={spec: dict(model.facts) for spec, model in models.items() if model.facts},
        reader=SCENE_READER,
        view=NONE if shown is None else shown.key,
        frames=tuple(frame.id for frame in chosen),
        encoding=PNG_2,
    )
    manifest = resumed(out, manifest, bank)
    calls = plan_of(manifest, bank, models=tuple(models), conditions=CONDITIONS, limit=limit, view=shown)
    return Battery(calls, models, manifest, out)


def choose(bank: FrameBank, seed: int) -> tuple[Frame, ...]:
    """Return the admission set in the bank's order: 8 close and 8 other frames, drawn by the seed.

    Within a class the actions that the safety policy demands of the truth are taken in turn, so that the set demands
    as many of them as the bank has, and the episodes of an action likewise. Raises BankError where the bank has too
    few of a class.
    """
    rng = np.random.default_rng(key_seed("admission", seed, bank.manifest.fingerprint))
    chosen, gap = list[Frame](), bank.manifest.gap
    for close, name in ((True, "close"), (False, "other")):
        frames = [frame for frame in bank if (gap is not None and gap.near(frame)) == close]
        if len(frames) < PAIRS_A_CLASS:
            raise BankError(
                f"the bank {bank.root} has {len(frames)} {name} frames, and admission needs {PAIRS_A_CLASS}: "
                "build or import a larger one"
            )
        chosen += _in_turn([frames[place] for place in rng.permutation(len(frames))])[:PAIRS_A_CLASS]
    order = {frame.id: place for place, frame in enumerate(bank)}
    return tuple(sorted(chosen, key=lambda frame: order[frame.id]))


def _in_turn(frames: Sequence[Frame]) -> list[Frame]:
    """Return the frames so that the demanded actions come in turn, and within an action the episodes do."""
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
