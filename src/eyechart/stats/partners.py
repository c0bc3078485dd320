"""Partners: frames of other episodes, balanced or at a similar state, that lend a channel."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from eyechart.stats.statistic import TIE, chunks

Places = npt.NDArray[np.intp]
_Marks = npt.NDArray[np.bool_]

NOBODY = -1
"""The partner of a frame without one."""
SIMILAR = 0.10
"""States are similar if their squared distance is at most this share of two random states'."""
_ROUNDS = 20


def balanced_partners(episodes: Sequence[object], values: Sequence[object], *, seed: int) -> Places:
    """Return each frame's partner of another episode and value, as a place, shape (n,).

    ``episodes`` and ``values`` are labels, one a frame. The partners are a random exchange, so each
    frame is the partner of one other. Sometimes no such exchange exists: an episode has more than
    half of the frames, or values differ in number. Then the frames left over get any partner that
    fits. A frame gets `NOBODY` only if no frame of another episode has another value. ValueError if
    the lengths differ.
    """
    if len(episodes) != len(values):
        raise ValueError(f"{len(episodes)} episodes and {len(values)} values: give one of each a frame")
    episode, value = _numbered(episodes), _numbered(values)
    rng, n = np.random.default_rng(seed), len(episode)

    def fits(frame: Places | int, partner: Places | int) -> _Marks:
        return np.asarray((episode[frame] != episode[partner]) & (value[frame] != value[partner]))

    every, result = np.arange(n), rng.permutation(n)
    for _ in range(_ROUNDS):
        amiss = np.flatnonzero(~fits(every, result))
        for place in map(int, amiss):
            others = rng.permutation(n)
            better = others[fits(place, result[others]) & fits(others, int(result[place]))]
            if len(better):
                result[[place, better[0]]] = result[[better[0], place]]
    for place in map(int, np.flatnonzero(~fits(every, result))):
        free = every[fits(place, every)]
        result[place] = rng.choice(free) if len(free) else NOBODY
    return result


def matched_partners(
    episodes: Sequence[object],
    states: npt.ArrayLike,
    values: Sequence[object] | None = None,
    *,
    within: float = SIMILAR,
) -> Places:
    """Return each frame's nearest frame by state in another episode, as a place, shape (n,).

    ``states`` has shape (n, d); each number counts in units of its own spread over the frames. With
    ``values``, one label a frame, the other frame's value differs. `NOBODY` if none is similar:
    within a share ``within`` of the squared distance of two random states. ValueError if the
    lengths differ.
    """
    episode, scaled, value = _numbered(episodes), _scaled(episodes, states), _valued(episodes, values)
    result = np.full(len(episode), NOBODY)
    most = within * 2 * np.count_nonzero(scaled.std(axis=0))
    for rows in chunks(len(episode), scaled.size):
        far = ((scaled[rows, None, :] - scaled[None]) ** 2).sum(axis=2)
        far[(episode[rows, None] == episode[None]) | (value[rows, None] == value[None])] = np.inf
        nearest = far.argmin(axis=1)
        there = np.take_along_axis(far, nearest[:, None], axis=1)[:, 0] <= most
        result[rows] = np.where(there, nearest, NOBODY)
    return result


def near_partners(
    episodes: Sequence[object], states: npt.ArrayLike, matched: Places, values: Sequence[object] | None = None
) -> Places:
    """Return a frame of each frame's own episode, as far off by state as its match, shape (n,).

    ``matched`` are `matched_partners` of the same ``values``. Candidates are other frames of the
    episode with another value. The chosen one falls least short of the match, summed over the
    numbers of the state; among equals it is the nearest. The reason: a small change of pose cannot
    speak for a larger one, nor a gripper's change for an arm's. `NOBODY` for a frame without a
    match or a candidate.
    """
    episode, scaled, value = _numbered(episodes), _scaled(episodes, states), _valued(episodes, values)
    result = np.full(len(episode), NOBODY)
    for place in map(int, np.flatnonzero(matched != NOBODY)):
        own = np.flatnonzero(episode == episode[place])
        own = own[value[own] != value[place]]
        if len(own):
            far = (scaled[own] - scaled[place]) ** 2
            short = np.maximum((scaled[matched[place]] - scaled[place]) ** 2 - far, 0.0).sum(axis=1)
            result[place] = own[np.lexsort((far.sum(axis=1), short))[0]]
    return result


def reaches(states: npt.ArrayLike, frames: Places, near: Places, matched: Places) -> npt.NDArray[np.float64]:
    """Return for each number of the state a ratio of mean squared changes, shape (d,).

    It is the change of ``frames`` to own-episode partners over that to their matches. ``states``
    has shape (n, d); the others are places in it. Below 1, a number changes less than to the match.
    Infinite for a number that no match changes.
    """
    given = np.asarray(states, np.float64)
    own, theirs = (((given[places] - given[frames]) ** 2).mean(axis=0) for places in (near, matched))
    moved = theirs > TIE * given.var(axis=0)
    return np.where(moved, own, np.inf) / np.where(moved, theirs, 1.0)


def _scaled(episodes: Sequence[object], states: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return states in units of their spread over frames; ValueError unless one row a frame."""
    given = np.asarray(states, np.float64)
    if given.ndim != 2 or len(given) != len(episodes):
        raise ValueError(f"{len(episodes)} episodes and states of shape {given.shape}: give one row a frame")
    spread = given.std(axis=0)
    return np.asarray((given - given.mean(axis=0)) / np.where(spread > 0, spread, 1.0))


def _valued(episodes: Sequence[object], values: Sequence[object] | None) -> Places:
    """Return values as numbers, one a frame; without any, each frame has its own."""
    if values is not None and len(values) != len(episodes):
        raise ValueError(f"{len(episodes)} episodes and {len(values)} values: give one of each a frame")
    return np.arange(len(episodes)) if values is None else _numbered(values)


def _numbered(labels: Sequence[object]) -> Places:
    """Return equal labels as equal numbers, in the order of their first places."""
    numbers: dict[object, int] = {}
    return np.array([numbers.setdefault(label, len(numbers)) for label in labels], dtype=np.intp)
