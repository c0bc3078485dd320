"""Replays an episode: its actions in the same world, which must end in the recorded state."""

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from eyechart.episodes import Episode, Step, read_manifest
from eyechart.errors import LedgerError, SpecError
from eyechart.frames import RGB, Scalar
from eyechart.simulators import ControlledDrive, Simulator, Sketch, execute
from eyechart.spaces.space import UNPARSED
from eyechart.studies.closed_loop.drives import ERROR, Drives

SHOWN_MOST = 6


@dataclass(frozen=True)
class ReplayMoment:
    """One step of a replay, with the picture before the decision; ``step`` is None at the end.

    ``sketch`` is the plan of a controller below the decision, where the world has one; the picture
    does not show it.
    """

    picture: RGB
    step: Step | None
    sketch: Sketch | None = None


def episode_id(episode: Episode) -> str:
    """Return the text for ``--episode``, such as ``constant:SLOW highway/dense/3 real``."""
    return f"{episode.key.policy} {episode.key.world} {episode.key.condition}"


def find_episode(drives: Sequence[Drives], wanted: str) -> tuple[Drives, Episode]:
    """Return the episode of an id, or of enough words of it; raises SpecError otherwise."""
    every = [(drive, episode) for drive in drives for episode in (*drive.episodes, *drive.errors)]
    exact = [pair for pair in every if episode_id(pair[1]) == wanted.strip()]
    words = set(wanted.split())
    named = [
        ({part for word in episode_id(pair[1]).split() for part in (word, *word.split("/"))}, pair) for pair in every
    ]
    found = exact or [pair for names, pair in named if words and words <= names]
    if len(found) == 1:
        return found[0]
    shown = "; ".join(f"'{episode_id(episode)}'" for _, episode in (found or every)[:SHOWN_MOST])
    more = len(found or every) - SHOWN_MOST
    some = f"{shown}{f' and {more} more' if more > 0 else ''}"
    if found:
        raise SpecError(f"--episode '{wanted}' names {len(found)} episodes: {some}; give one of them whole")
    raise SpecError(f"--episode '{wanted}' names no episode of the run; there are {some}")


def replay(drives: Drives, episode: Episode, simulator: Simulator | None = None) -> Iterator[ReplayMoment]:
    """Yield the steps of a replayed episode; the last has the picture after the last step.

    The world is first driven without pictures, so that no picture of a different drive is shown.
    Raises LedgerError, with the versions that differ, where the end differs from the record.
    """
    world = simulator or drives.open_simulator()
    verify(drives, episode, world)
    drive = world.drive(episode.key.scenario, episode.key.seed)
    try:
        for step in episode.steps:
            picture = drive.picture()
            execute(drive, step.executed_action, decided=step.decision.action is not None)
            yield ReplayMoment(picture, step, drive.sketch() if isinstance(drive, ControlledDrive) else None)
        yield ReplayMoment(drive.picture(), None)
    finally:
        drive.close()


def verify(drives: Drives, episode: Episode, simulator: Simulator) -> Mapping[str, Scalar]:
    """Replay an episode without pictures; return the simulator's facts on the last move.

    Raises LedgerError where the end differs from the record.
    """
    name = episode_id(episode)
    if not episode.steps:
        raise LedgerError(
            f"episode '{name}' has no step to show: it ended in {episode.ended} {episode.detail}".rstrip()
        )
    drive = simulator.drive(episode.key.scenario, episode.key.seed)
    try:
        for step in episode.steps:
            moved = execute(drive, step.executed_action, decided=step.decision.action is not None)
        state = hashlib.sha256(drive.state()).hexdigest()
    except ValueError as error:
        raise LedgerError(
            f"episode '{name}' does not drive again here: {error}{_versions(drives, simulator)}"
        ) from error
    finally:
        drive.close()
    if state != episode.state_sha256 and episode.ended == ERROR:
        raise LedgerError(
            f"episode '{name}' ended in an error inside step {len(episode.steps)}, not after a step, so it cannot "
            f"be checked: {episode.detail}"
        )
    if state != episode.state_sha256:
        raise LedgerError(
            f"episode '{name}' does not drive again here: its actions lead to another state than the recorded "
            f"one{_versions(drives, simulator)}"
        )
    return moved.facts


def decided(step: Step) -> str:
    """Return a step's decision in words: the action, or why there is none."""
    if step.decision.action is not None:
        return step.decision.action
    more = step.decision.why or step.error
    return f"{UNPARSED} ({step.decision.missing}{f': {more}' if more else ''})"


def _versions(drives: Drives, simulator: Simulator) -> str:
    """Return in words which versions of the run differ from the ones installed here."""
    made = read_manifest(drives.path).world
    here: Mapping[str, str] = simulator.versions()
    apart = [f"{name} {made[name]}, here {now}" for name, now in here.items() if name in made and made[name] != now]
    if apart:
        return f"; the run was driven with {'; '.join(apart)}: install those"
    return "; floating-point states repeat on one kind of machine only, so replay it on such a machine"
