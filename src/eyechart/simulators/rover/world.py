"""A world under way: a rover among a layout's obstacles, driven a decision at a time."""

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass, replace

from eyechart.simulators.rover.bicycle import RADIUS_M, State, advance
from eyechart.simulators.rover.layout import GOAL_M, ROAD_HALF_M, TRACKS_M, Layout, Obstacle
from eyechart.simulators.rover.tracking import INNER_S, INTENTS, Intent, control, next_track

DECISION_S = 1.0
TIME_S = 40.0
START_SPEED_MPS = 1.0
MIDDLE = len(TRACKS_M) // 2

Law = Callable[[State, Intent, int], tuple[float, float]]
"""From the state, the intent and the track to acceleration and steering, every ``INNER_S``."""


@dataclass(frozen=True, slots=True)
class World:
    """The rover's state in a layout, the track it was last asked to follow, and how many seconds have passed."""

    layout: Layout
    state: State
    track: int = MIDDLE
    seconds: float = 0.0
    crashed: bool = False

    @property
    def ended(self) -> str | None:
        """Return why the drive is over, None while it goes on."""
        if self.crashed:
            return "crash"
        if self.state.x >= GOAL_M:
            return "goal"
        return "time" if self.seconds >= TIME_S else None

    def mirrored(self) -> "World":
        """Return the mirrored world."""
        return replace(
            self,
            layout=self.layout.mirrored(),
            state=self.state.mirrored(),
            track=len(TRACKS_M) - 1 - self.track,
        )

    def as_bytes(self) -> bytes:
        """Return the state of the world as bytes: numbers as they are, obstacles too."""
        state = self.state
        numbers = [state.x, state.y, state.yaw, state.speed, self.seconds, float(self.track), float(self.crashed)]
        for one in self.layout.obstacles:
            numbers += [one.x, one.y, one.radius, one.height]
        return struct.pack(f"<{len(numbers)}d", *(number + 0.0 for number in numbers))


def start(layout: Layout) -> World:
    """Return the world of a layout at its beginning: the rover in the middle of the road, at 1 m/s."""
    return World(layout, State(0.0, 0.0, 0.0, START_SPEED_MPS))


def decide(world: World, action: str, law: Law = control) -> World:
    """Return the world one decision later, or where the drive ended before."""
    intent = INTENTS[action]
    track, state, crashed = next_track(world.track, intent), world.state, False
    steps = round(DECISION_S / INNER_S)
    for number in range(1, steps + 1):
        acceleration, steering = law(state, intent, track)
        state = advance(state, acceleration, steering, INNER_S)
        crashed = touches(state, world.layout)
        if crashed or state.x >= GOAL_M or number == steps:
            break
    return replace(world, state=state, track=track, seconds=world.seconds + number * INNER_S, crashed=crashed)


def touches(state: State, layout: Layout) -> bool:
    """Return whether the rover touches an obstacle or leaves the road."""
    if abs(state.y) + RADIUS_M > ROAD_HALF_M:
        return True
    return any(_distance(state, one) < one.radius + RADIUS_M for one in layout.obstacles)


def _distance(state: State, obstacle: Obstacle) -> float:
    return math.hypot(obstacle.x - state.x, obstacle.y - state.y)
