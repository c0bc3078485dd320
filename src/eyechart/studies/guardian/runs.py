"""The votes of an admission or structured run: a model votes hazard where its scene estimate says close."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from eyechart.calls import CallKey, Reply
from eyechart.errors import VoteError
from eyechart.frames import Frame, FrameBank
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER, read_run
from eyechart.perception.forward import distances_of
from eyechart.spaces.scene import SCENE_READER, SCENES, SceneSpace
from eyechart.stats.committee import MISSING
from eyechart.studies.battery import plan_of
from eyechart.studies.guardian.votes import HAZARD_COLUMN, About, VoteTable, episode_of, hazards_of, pictures_of

CONDITIONS = ("real", "mirrored")
"""What the two votes of a model are replies to, in the order of `VIEWS`."""


def votes_of_run(path: Path, *, hazard: str = HAZARD_COLUMN, reread: bool = False) -> VoteTable:
    """Return the votes of every model of a run on its frames; what holds no scene estimate is a missing vote.

    Truth is the bank's column ``hazard``, or where it has none whether the gap is below its threshold. Raises VoteError
    where the folder is no run of scene estimates, or was read by another version of the reader and not ``reread``.
    """
    manifest, bank = read_run(path)
    if not isinstance(manifest.prompt.space, SceneSpace):
        raise VoteError(f"{path} is a run of the study '{manifest.study}', whose replies are no scene estimates")
    if manifest.reader != SCENE_READER and not reread:
        raise VoteError(
            f"{path} was begun under version {manifest.reader} of the reader of scenes; this is version "
            f"{SCENE_READER}: its votes may differ from those seen before; read its replies anew with --reread"
        )
    plan = replace(plan_of(manifest, bank), shard=None)  # a shard lacks the votes of the others
    frames, models = plan.frames, tuple(sorted(manifest.models))
    votes = np.full((len(models), len(frames), 2), MISSING, dtype=np.int8)
    contradicting, nearest = np.zeros(votes.shape, dtype=np.bool_), _close_m(bank)
    with Ledger(path / LEDGER) as ledger:
        finished = ledger.finished()
        served = {
            model: _cast(ledger.replies(model), frames, votes[number], contradicting[number], nearest)
            for number, model in enumerate(models)
        }
    truth, axes = hazards_of(bank, hazard), {frame.mirror_axis for frame in frames}
    about = About(
        bank=bank.manifest.fingerprint,
        bank_name=bank.name,
        prompt=manifest.prompt.key,
        view=manifest.view,
        versions=dict(manifest.models),
        served={
            model: str(next(iter(names))) for model, names in served.items() if len(names) == 1 and None not in names
        },
        modes=dict(manifest.modes),
        wording=manifest.prompt,
        axis=axes.pop() if len(axes) == 1 else None,
        reader=SCENE_READER,
    )
    return VoteTable(
        name=path.name,
        frames=tuple(frame.id for frame in frames),
        episodes=tuple(episode_of(frame) for frame in frames),
        hazard=np.array([truth[frame.id] for frame in frames], dtype=np.bool_),
        models=models,
        votes=votes,
        about=about,
        pictures=pictures_of(bank, [frame.id for frame in frames]),
        unfinished={
            model: sum(key.condition in CONDITIONS and key not in finished for key in plan.keys_of(model))
            for model in models
        },
        contradicting=contradicting,
    )


def _cast(
    replies: Iterable[tuple[CallKey, Reply]],
    frames: Sequence[Frame],
    votes: npt.NDArray[np.int8],
    contradicting: npt.NDArray[np.bool_],
    close_m: float,
) -> set[str | None]:
    """Fill in a model's votes and which contradict its own gap, both (frames, 2); return the names it served as."""
    place = {frame.id: number for number, frame in enumerate(frames)}
    served = set[str | None]()
    for key, reply in replies:
        if key.frame in place and key.condition in CONDITIONS:
            if reply.error is None:
                served.add(reply.served)
            found, at = SCENES.read(reply).action, (place[key.frame], CONDITIONS.index(key.condition))
            votes[at] = MISSING if found is None else int(found.close)
            near = found is not None and found.gap_m is not None and found.gap_m < close_m
            contradicting[at] = near and not votes[at]
    return served


def _close_m(bank: FrameBank) -> float:
    """Return the gap in metres below which the prompt of a bank calls a lead close."""
    gap = bank.manifest.gap
    return distances_of(bank.manifest.simulator).close_m if gap is None or gap.unit != "m" else gap.threshold
