"""Modular replay: the guardian brakes, a deterministic reader keeps distance and the sides clear.

Source: section Symmetry-consensus longitudinal guardian.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from eyechart.conditions import flip
from eyechart.errors import GuardianError
from eyechart.frames import FrameBank, decode
from eyechart.policies.scripted import read_scene
from eyechart.records import to_json_fields
from eyechart.spaces.scene import Scene, safe_action
from eyechart.stats.episodes import share_over_episodes
from eyechart.stats.statistic import Statistic
from eyechart.studies.guardian.frozen import FrozenGuardian
from eyechart.studies.guardian.scores import WORDS, answer_of
from eyechart.studies.guardian.votes import VoteTable

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Scenes = tuple[Scene, Scene]
"""The deterministic reader's scenes of a picture and of its reflection."""

ReadScenes = Callable[[str], Scenes | None]

MIRROR = {"LEFT": "RIGHT", "RIGHT": "LEFT"}


@dataclass(frozen=True)
class ModularReplay:
    """The actions of a modular controller on each frame, and how they compare.

    ``agreement`` is with the renderer policy, which acts on what the deterministic reader sees.
    ``answered`` is the share of frames on which the guardian does not abstain. If it abstains, the
    renderer policy acts and agrees with itself, so ``agreement_answered`` leaves those frames out.

    ``ceiling`` and ``ceiling_answered`` are the agreement of a perfect guardian, which answers the
    truth. They may be below 1 because the guardian answers about one distance and the policy heeds
    others too. ``equivariance`` is the share of frames whose reflection gets the reflected action.
    It tests the reader and the policy alone, since the votes on a frame and its reflection are
    exchanged.

    ``directional`` counts the frames on which the renderer policy turns. With few of them, lateral
    control is not tested. ``unread`` are the frames that the reader could not read; no share counts
    them. ``warnings`` name missing or outstanding votes, which make a guardian abstain and so
    agree.
    """

    agreement: Statistic
    agreement_answered: Statistic
    ceiling: Statistic
    ceiling_answered: Statistic
    answered: Statistic
    equivariance: Statistic
    directional: int
    actions: Mapping[str, str]
    unread: tuple[str, ...]
    warnings: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        return to_json_fields(
            self,
            "answered equivariance actions unread warnings",
            agreement_with_renderer_policy=self.agreement,
            agreement_where_answered=self.agreement_answered,
            agreement_of_a_perfect_guardian=self.ceiling,
            agreement_of_a_perfect_guardian_where_answered=self.ceiling_answered,
            directional_reference_actions=self.directional,
        )


def modular_action(answer: str, scene: Scene) -> str:
    """Return the action for an answer, under deterministic collision and lateral authority.

    Below the world's own stopping distance (12 m on a highway) it is STOP, whatever the answer.
    Else "clear" gives STRAIGHT, and "hazard" the one clear side or SLOW. If the guardian abstains,
    the fixed policy decides.
    """
    if scene.gap_m is not None and scene.gap_m < scene.distances.stop_m:
        return "STOP"
    if answer == "abstain":
        return safe_action(scene)
    if answer == "clear":
        return "STRAIGHT"
    if scene.left_clear != scene.right_clear:
        return "LEFT" if scene.left_clear else "RIGHT"
    return "SLOW"


def replay(frozen: FrozenGuardian, table: VoteTable, read: ReadScenes) -> ModularReplay:
    """Replay a guardian's answers with what ``read`` sees in each frame and in its reflection.

    A frame and its reflection have the same votes, exchanged, so they have one answer. Raises
    GuardianError as `FrozenGuardian.may_score` does, and if no frame can be read.
    """
    frozen.may_score(table)
    said = [WORDS[int(one)] for one in answer_of(frozen, table)[frozen.point]]
    actions, unread, rows, drives = {}, [], [], []
    for frame, episode, answer, hazard in zip(table.frames, table.episodes, said, table.hazard, strict=True):
        scenes = read(frame)
        if scenes is None:
            unread.append(frame)
            continue
        actions[frame] = modular_action(answer, scenes[0])
        rows.append(_row(answer, "hazard" if hazard else "clear", scenes))
        drives.append(episode)
    if not actions:
        raise GuardianError(
            f"{table.name}: the deterministic reader reads none of its {len(unread)} pictures; modular replay is for "
            "pictures of highway-env, of the rover and of the drone"
        )
    few = [
        f"{model}: {missing} of {2 * len(table.frames)} votes are missing; if the guardian abstains because of "
        "that, the renderer policy agrees with itself"
        for model in frozen.committee
        if (missing := table.missing(model))
    ]
    outcomes = np.array(rows, dtype=np.float64)
    _, codes = np.unique(drives, return_inverse=True)
    share = partial(_share, outcomes, codes)
    return ModularReplay(
        agreement=share(_AGREES),
        agreement_answered=share(_AGREES, of=_ANSWERED),
        ceiling=share(_PERFECT),
        ceiling_answered=share(_PERFECT, of=_ANSWERED),
        answered=share(_ANSWERED),
        equivariance=share(_MIRRORED),
        directional=int(outcomes[:, _TURNS].sum()),
        actions=actions,
        unread=tuple(unread),
        warnings=(*table.unfinished_words(frozen.committee), *few),
    )


_ANSWERED, _AGREES, _PERFECT, _MIRRORED, _TURNS = range(5)


def _row(answer: str, truth: str, scenes: Scenes) -> tuple[bool, ...]:
    """Return a frame's values by column: answered, agrees, perfect, mirrored, turns."""
    action, reflected = (modular_action(answer, scene) for scene in scenes)
    reference = safe_action(scenes[0])
    right = modular_action(truth, scenes[0]) == reference
    return answer != "abstain", action == reference, right, reflected == MIRROR.get(action, action), reference in MIRROR


def _share(outcomes: Floats, episodes: Ints, column: int, of: int | None = None) -> Statistic:
    """Return the share of frames for which a column holds, with its interval over episodes."""
    among = np.ones(len(outcomes)) if of is None else outcomes[:, of]
    hits = np.bincount(episodes, weights=outcomes[:, column] * among)
    return share_over_episodes(hits, np.bincount(episodes, weights=among))


def reader_of(bank: FrameBank) -> ReadScenes:
    """Return the reader of a bank's pictures, the image-only positive control.

    It reads each picture and its flip. Raises BankError for a picture that differs from the one in
    the manifest.
    """

    def read(frame_id: str) -> Scenes | None:
        frame = bank.frame(frame_id)
        if frame.mirror_axis == "none":
            return None
        pixels = decode(bank.recorded(frame), frame.file)
        here, there = read_scene(pixels), read_scene(np.ascontiguousarray(flip(pixels, frame.mirror_axis)))
        return None if here is None or there is None else (here, there)

    return read
