"""Worlds that yield frames and can be driven, one module or package a simulator, one door for all."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Protocol, cast, runtime_checkable

import numpy as np
import numpy.typing as npt

from eyechart.errors import SpecError, meant
from eyechart.frames import RGB, FrameBank, MirrorAxis, Scalar
from eyechart.spaces.discrete import Discrete


@dataclass(frozen=True, slots=True)
class StepResult:
    """What one decision's worth of driving brought about.

    ``reward`` is the simulator's own. ``distance_m`` is what the vehicle has covered since the
    drive began, as the simulator counts progress; a speed or a distance that it does not tell is
    None. ``ended`` says in one word why the drive is over (``crash``, ``goal``, ``time``), None
    while it goes on. ``facts`` is what else the simulator says of the move, such as its solver's
    failures.
    """

    reward: float
    speed_mps: float | None
    distance_m: float | None
    crashed: bool
    ended: str | None
    facts: Mapping[str, Scalar] = field(default_factory=dict)


class Drive(Protocol):
    """A world under way. Equal scenario, seed and actions give equal pictures, truths and moves."""

    def picture(self) -> RGB:
        """Return what the camera shows now, shape (h, w, 3), uint8; asking has no effect on the world."""

    def truth(self) -> Mapping[str, Scalar]:
        """Return the ground truth of this moment, the columns that the simulator's banks have, None for "none"."""

    def step(self, action: str) -> StepResult:
        """Drive on for one decision's time with this action; raises ValueError after the end."""

    def state(self, decimals: int | None = None) -> bytes:
        """Return the world's state as bytes, equal for equal worlds on one machine, for a digest.

        With ``decimals`` its numbers are rounded, so that worlds that differ by an error of
        rounding are equal.
        """

    def close(self) -> None:
        """Let go of what the drive holds."""


@dataclass(frozen=True, slots=True)
class Sketch:
    """What a controller below the decisions made of the last one, as lines over the picture before it.

    ``plan`` is the predicted path, a point a stage, ``target`` what the decision asked it to
    follow, and ``driven`` the way that it then went. Each has shape (n, 2), column and row in
    pixels of the picture, NaN where a place is not before the camera. ``words`` say what the
    decision meant.
    """

    plan: npt.NDArray[np.float64]
    target: npt.NDArray[np.float64]
    driven: npt.NDArray[np.float64]
    words: str


@runtime_checkable
class Planning(Protocol):
    """A drive with a controller below the decisions, which can show what that planned."""

    def sketch(self) -> Sketch:
        """Return what became of the last decision; raises ValueError before the first."""


@runtime_checkable
class Halting(Protocol):
    """A drive that knows how to stop, where the fail-safe action alone might mean less than that."""

    def halt(self) -> StepResult:
        """Drive on for one decision's time, and stop; raises ValueError after the end."""


@runtime_checkable
class HalfBlind(Protocol):
    """A drive whose camera does not show what stands beside it."""

    def unseen_sides(self) -> frozenset[str]:
        """Return which of left and right is closed by nothing in the picture, so that no reader can be judged by it."""


def execute(drive: Drive, action: str, *, decided: bool) -> StepResult:
    """Drive on with an action that was decided, or with the fail-safe where nothing was."""
    return drive.halt() if isinstance(drive, Halting) and not decided else drive.step(action)


@dataclass(frozen=True, kw_only=True)
class Declaration:
    """What a simulator can, before any world of it is opened.

    ``picture`` is the kind of picture in words, ``mirror_axis`` the axis across which its pictures
    exchange left and right, ``action_space`` what its drives understand. ``camera`` names the
    simulator whose camera it has: by that name its calibrated view and its distances are found.
    ``scenarios`` of drives and ``presets`` of banks map a name to one sentence each; without
    scenarios it only makes banks, and without presets ``no_banks`` says where they come from. Where
    every drive has a goal, ``has_goal``. Where several actions are one command of the world,
    ``commands`` maps action to command. ``halts_with`` is the fail-safe where that is not the
    mildest brake.
    """

    name: str
    picture: str
    mirror_axis: MirrorAxis
    action_space: Discrete
    camera: str = ""
    scenarios: Mapping[str, str] = field(default_factory=dict)
    presets: Mapping[str, str] = field(default_factory=dict)
    no_banks: str = "it can only be driven"
    has_goal: bool = False
    commands: Mapping[str, str] = field(default_factory=dict)
    halts_with: str | None = None

    @property
    def fail_safe(self) -> str:
        """Return what is executed where there is no decision.

        Source: paper, section Corpus and parsing: SLOW. STOP under the model-predictive controller
        is ours.
        """
        space = self.action_space
        return self.halts_with or (space.brake[-1] if space.brake else space.actions[0])


class Simulator(Protocol):
    """The door to a simulator that can be driven."""

    declared: Declaration

    def drive(self, scenario: str, seed: int) -> Drive:
        """Open a world at its beginning; raises SpecError for an unknown scenario or a seed out of range."""

    def versions(self) -> dict[str, str]:
        """Return the versions of the libraries that make this world, by their names."""


class BankSimulator(Protocol):
    """The door to a simulator whose moments become banks."""

    declared: Declaration

    def build(
        self,
        out: Path,
        *,
        preset: str = "balanced",
        seeds: Sequence[int] = (0, 1, 2),
        steps: int = 12,
        controls_seed: int = 0,
        staging: int = 3,
        progress: Callable[[int, int], None] | None = None,
    ) -> FrameBank:
        """Write a bank of ``steps`` frames an episode into ``out``; ``progress`` gets (frames done, of how many).

        By ``controls_seed`` the distances of its control pictures are drawn; ``staging`` is the
        version of its moments.
        """


SIMULATORS: dict[str, str] = {
    "highway": "eyechart.simulators.highway:Highway",
    "rover": "eyechart.simulators.rover:Rover",
    "rover-mpc": "eyechart.simulators.rover.hierarchy:RoverMpc",
    "rover-mpc-unaware": "eyechart.simulators.rover.hierarchy:RoverMpcUnaware",
    "rover-mpc-lateral": "eyechart.simulators.rover.hierarchy:RoverMpcLateral",
    "drone": "eyechart.simulators.drone:Drone",
    "drone-pybullet": "eyechart.simulators.drone:PybulletDrone",
    "tabletop": "eyechart.simulators.tabletop:Tabletop",
}
"""What a simulator's name means: ``module:class``, imported when it is opened."""

KINDS: dict[str, tuple[str, str, str]] = {
    "gym": (
        "gym:ENV_ID --actions FILE.toml",
        "Any Gymnasium environment with discrete actions that renders RGB, by a map of its actions; it makes no banks.",
        "eyechart.simulators.gym:open_environment",
    ),
}
"""What the kind in ``KIND:NAME`` means: how it is written, what it is, and ``module:function``,
which is called with the name and the action map's file."""


def find_simulator(name: str, *, actions: Path | None = None) -> Simulator | BankSimulator:
    """Open the simulator of this name, or of a kind: ``gym:ENV_ID``, whose action map is the TOML file ``actions``.

    Raises SpecError that lists what is known, and for an action map that is missing, wrong, or not
    wanted.
    """
    kind, colon, rest = name.partition(":")
    if colon and kind in KINDS:
        return _import(KINDS[kind][-1])(rest, actions)
    if name not in SIMULATORS:
        raise SpecError(
            f"unknown simulator '{name}';{meant(name, SIMULATORS)} known: {', '.join(SIMULATORS)}, gym:ENV_ID"
        )
    if actions is not None:
        raise SpecError(f"simulator '{name}' has actions of its own; an action map is for gym:ENV_ID")
    return _import(SIMULATORS[name])()


def open_simulator(name: str, *, actions: Path | None = None) -> Simulator:
    """Open a simulator to drive in; raises SpecError as `find_simulator` does, and for one that only makes banks."""
    found = find_simulator(name, actions=actions)
    if not found.declared.scenarios:
        raise SpecError(f"simulator '{name}' only makes banks: it cannot be driven")
    return cast("Simulator", found)


def open_bank_simulator(name: str) -> BankSimulator:
    """Open a simulator that makes banks; raises SpecError for one that does not, and says where they come from."""
    found = find_simulator(name)
    if not found.declared.presets:
        raise SpecError(f"simulator '{name}' makes no banks: {found.declared.no_banks}")
    return cast("BankSimulator", found)


def declared_by(name: str) -> Declaration | None:
    """Return what the simulator of this name declares, None where the registry does not hold it here."""
    return find_simulator(name).declared if name in SIMULATORS else None


def _import(place: str) -> Callable[..., Simulator | BankSimulator]:
    module, _, attribute = place.partition(":")
    opened: Callable[..., Simulator | BankSimulator] = getattr(import_module(module), attribute)
    return opened
