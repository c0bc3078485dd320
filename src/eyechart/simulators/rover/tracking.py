"""The tracking law: an action asks for a speed and a track, and acceleration and steering follow.

LEFT and RIGHT ask for the next track to that side, as far as there is one; the others keep the track that was asked
for last. Another law, such as a model predictive one, may stand in its place: it needs the plant and the obstacles.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from eyechart.simulators.road import TRACKS_M
from eyechart.simulators.rover.bicycle import MOST_ACCELERATION_MPS2, MOST_BRAKING_MPS2, WHEELBASE_M, RoverState

INNER_S = 0.05
"""The law's own period, and the plant's."""

_MILD_MPS2 = 2.0
_MOST_ASIDE_MPS2 = 5.0
_MOST_YAW = 0.6
_YAW_A_METRE = 0.6
_YAW_S = 0.15
_LEAST_SPEED_MPS = 0.2


@dataclass(frozen=True, slots=True)
class Intent:
    """What an action means: a speed in m/s, how hard it may be braked for in m/s², and how many tracks to the left."""

    speed: float
    braking: float = _MILD_MPS2
    tracks: int = 0


INTENTS: Mapping[str, Intent] = {
    "STOP": Intent(0.0, MOST_BRAKING_MPS2),
    "SLOW": Intent(2.5),
    "STRAIGHT": Intent(4.5),
    "LEFT": Intent(4.0, tracks=1),
    "RIGHT": Intent(4.0, tracks=-1),
}


def control(state: RoverState, intent: Intent, track: int) -> tuple[float, float]:
    """Return acceleration (m/s²) and steering angle (rad) towards the intent's speed and the middle of a track.

    The yaw aimed at grows with the distance from the track; the yaw rate is bounded by what the tyres give sideways.
    """
    acceleration = min(max((intent.speed - state.speed) / INNER_S, -intent.braking), MOST_ACCELERATION_MPS2)
    aimed = min(max((TRACKS_M[track] - state.y) * _YAW_A_METRE, -_MOST_YAW), _MOST_YAW)
    speed = max(state.speed, _LEAST_SPEED_MPS)
    most = _MOST_ASIDE_MPS2 / speed
    rate = min(max((aimed - state.yaw) / _YAW_S, -most), most)
    return acceleration, math.atan(rate * WHEELBASE_M / speed)
