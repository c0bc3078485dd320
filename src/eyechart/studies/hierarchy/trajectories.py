"""Where each source of intent drove, world by world: the recorded places of an episode among obstacles."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from eyechart.episodes import Episode
from eyechart.errors import EyechartError, LedgerError
from eyechart.frames import Scalar, rounded_truth
from eyechart.simulators.road import FAMILIES, Layout, make_layout
from eyechart.studies.closed_loop import Drives, verify

_CHECKED = ("lead_gap_m", "free_left_m", "free_middle_m", "free_right_m")
"""What the truth of a world's first moment tells of its obstacles."""

_PLACE = ("x_m", "y_m", "yaw", "speed_mps")


@dataclass(frozen=True)
class Trajectory:
    """One episode from above. ``places`` has shape (n, 4): x, y, yaw and speed at each decision and at the end.

    x is along the road and y to the left, in metres, yaw in rad, speed in m/s. ``ended`` is goal, crash or time.
    """

    ended: str
    places: npt.NDArray[np.float64]

    @cached_property
    def curve(self) -> npt.NDArray[np.float64]:
        """Return a smooth way through the places, shape (3 n - 2, 2): a cubic Bezier's corners from place to place.

        A second lies between decisions, during which a rover that turns gently stays near this curve.
        """
        x, y, yaw, speed = self.places.T
        at = np.column_stack([x, y])
        chord = np.hypot(*np.diff(at, axis=0).T)
        seconds = np.minimum(1.0, chord / np.maximum((speed[:-1] + speed[1:]) / 2, 1e-3))
        way = np.column_stack([np.cos(yaw), np.sin(yaw)]) * speed[:, None] / 3
        corners = np.empty((3 * len(at) - 2, 2))
        corners[::3] = at
        corners[1::3] = at[:-1] + way[:-1] * seconds[:, None]
        corners[2::3] = at[1:] - way[1:] * seconds[:, None]
        return corners


@dataclass(frozen=True)
class PairedWorld:
    """A world that several sources drove: its obstacles, and each one's way, None where a source did not drive it."""

    scenario: str
    seed: int
    layout: Layout
    ways: tuple[Trajectory | None, ...]


def paired_worlds(sources: Sequence[Drives]) -> tuple[list[PairedWorld], list[str]]:
    """Return every world with the ways of the sources in their order, and in words which worlds could not be drawn.

    A world whose obstacles here are not those that the record tells of is left out.
    """
    found: dict[tuple[str, int], dict[int, Episode]] = {}
    for number, source in enumerate(sources):
        for episode in source.episodes:
            if episode.steps:
                found.setdefault((episode.key.scenario, episode.key.seed), {})[number] = episode
    worlds, notes = [], []
    for scenario, seed in in_order(found):
        mine = found[scenario, seed]
        first = min(mine)
        if not _told_of(sources[first], mine[first]):
            notes.append(f"World {scenario}/{seed} is not drawn: its obstacles here are not those of the record.")
            continue
        ways: list[Trajectory | None] = [None] * len(sources)
        for place, episode in mine.items():
            try:
                ways[place] = trajectory(sources[place], episode)
            except LedgerError as error:
                notes.append(f"A way is not drawn: {error}.")
        worlds.append(PairedWorld(scenario, seed, make_layout(scenario, seed), tuple(ways)))
    return worlds, notes


def in_order(worlds: Iterable[tuple[str, int]]) -> list[tuple[str, int]]:
    """Return worlds, each a scenario and a seed, as the study names its scenarios."""
    places = {name: place for place, name in enumerate(FAMILIES)}
    return sorted(worlds, key=lambda one: (places.get(one[0], len(places)), one))


def trajectory(drives: Drives, episode: Episode) -> Trajectory:
    """Return where an episode led. Where its end was not recorded it is driven again, and has to end as it did.

    Raises LedgerError where it does not, and where a place is missing.
    """
    rows = [_place(step.truth) for step in episode.steps]
    last = episode.steps[-1]
    end = last.facts if "y_m" in last.facts else _driven_again(drives, episode)
    rows.append(_place({**end, "x_m": last.distance_m, "speed_mps": last.speed_mps}))
    return Trajectory(episode.ended, np.array(rows))


def _place(told: Mapping[str, Scalar]) -> tuple[float, ...]:
    found = [told.get(name) for name in _PLACE]
    if not all(isinstance(one, int | float) for one in found):
        raise LedgerError(f"the record holds no place at some step: it needs {', '.join(_PLACE)}")
    return tuple(float(one or 0.0) for one in found)


def _driven_again(drives: Drives, episode: Episode) -> Mapping[str, Scalar]:
    return rounded_truth(verify(drives, episode, drives.open_simulator()), episode.steps[-1].frame)


def _told_of(drives: Drives, episode: Episode) -> bool:
    """Return whether a world has the obstacles here that its record tells of."""
    try:
        drive = drives.open_simulator().drive(episode.key.scenario, episode.key.seed)
    except EyechartError:
        return False
    truth, then = rounded_truth(drive.truth(), episode.steps[0].frame), episode.steps[0].truth
    drive.close()
    return all(truth.get(name) == then.get(name) for name in _CHECKED)
