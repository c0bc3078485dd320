"""Simulated worlds that make frame banks and can be driven."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Protocol, cast, runtime_checkable

import numpy as np
import numpy.typing as npt

from eyechart.errors import SpecError, did_you_mean
from eyechart.frames import RGB, FrameBank, MirrorAxis, Scalar
from eyechart.spaces.discrete import Discrete


@dataclass(frozen=True, slots=True)
class StepResult:
    """The outcome of one decision.

    ``reward`` is the simulator's own. ``distance_m`` is the distance covered since the drive began,
    as the simulator counts progress. A speed or a distance that the simulator does not report is
    None. ``ended`` says in one word why the drive is over (``crash``, ``goal``, ``time``), and is
    None while it goes on. ``facts`` holds the simulator's other numbers of the step, such as
    failures of its solver.
    """

    reward: float
    speed_mps: float | None
    distance_m: float | None
    crashed: bool
    ended: str | None
    facts: Mapping[str, Scalar] = field(default_factory=dict)


class Drive(Protocol):
    """A world under way; equal scenarios, seeds and actions give equal pictures and steps."""

    def picture(self) -> RGB:
        """Return the camera's picture, shape (h, w, 3), uint8, with no effect on the world."""

    def truth(self) -> Mapping[str, Scalar]:
        """Return this moment's truth by the columns of the simulator's banks; None is "none"."""

    def step(self, action: str) -> StepResult:
        """Drive on with this action for one decision's time; raises ValueError after the end."""

    def state(self, decimals: int | None = None) -> bytes:
        """Return the world's state as bytes; equal worlds on one machine give equal bytes.

        With ``decimals`` its numbers are rounded, so that worlds that differ by a rounding error
        are equal.
        """

    def close(self) -> None:
        """Release the resources of the drive."""


@dataclass(frozen=True, slots=True)
class Sketch:
    """What a low-level controller did with the last decision, as lines over the picture before it.

    ``plan`` is the predicted path with one point a stage, ``target`` the path that the decision
    set, and ``driven`` the path that was driven. Each has shape (n, 2): column and row in pixels of
    the picture, NaN for a place that is not in front of the camera. ``words`` say what the decision
    meant.
    """

    plan: npt.NDArray[np.float64]
    target: npt.NDArray[np.float64]
    driven: npt.NDArray[np.float64]
    words: str


@runtime_checkable
class ControlledDrive(Protocol):
    """A drive with a low-level controller, which can show its plan."""

    def sketch(self) -> Sketch:
        """Return the last decision's plan and path; raises ValueError before the first one."""


@runtime_checkable
class StoppableDrive(Protocol):
    """A drive that can stop by itself, for worlds in which the fail-safe action does not stop."""

    def halt(self) -> StepResult:
        """Stop, for the time of one decision; raises ValueError after the end."""


@runtime_checkable
class PartialView(Protocol):
    """A drive whose camera does not show the obstacles at its sides."""

    def unseen_sides(self) -> frozenset[str]:
        """Return the sides, left or right, that are blocked only by obstacles outside the picture.

        A reader of the picture cannot be judged by such a side.
        """


def execute(drive: Drive, action: str, *, decided: bool) -> StepResult:
    """Execute a decided action; without a decision, stop if the drive can, else take ``action``."""
    return drive.halt() if isinstance(drive, StoppableDrive) and not decided else drive.step(action)


@dataclass(frozen=True, kw_only=True)
class Declaration:
    """What a simulator can do; readable before any of its worlds is opened.

    ``picture`` describes the kind of picture in words. ``mirror_axis`` is the axis across which its
    pictures exchange left and right. ``action_space`` holds the actions of its drives. ``camera``
    names the simulator that has the same camera: the calibrated view and the distances are found by
    it. ``scenarios`` of drives and ``presets`` of banks map a name to one sentence each. A
    simulator without scenarios only makes banks; one without presets says in ``no_banks`` where
    banks come from. ``has_goal`` is true if every drive has a goal. ``commands`` maps actions to
    the world's commands if several actions share one. ``halts_with`` is the fail-safe action if
    that is not the mildest brake.
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
        """Return the action that is executed if the controller gives no decision.

        Source: paper, section Corpus and parsing: SLOW. STOP under the model-predictive controller
        is eyechart's own choice.
        """
        space = self.action_space
        return self.halts_with or (space.brake[-1] if space.brake else space.actions[0])


class Simulator(Protocol):
    """The interface of a simulator that can be driven."""

    declared: Declaration

    def drive(self, scenario: str, seed: int) -> Drive:
        """Open a world at its start; raises SpecError for an unknown scenario or a bad seed."""

    def versions(self) -> dict[str, str]:
        """Return the versions of the libraries behind this world, by name."""


class BankSimulator(Protocol):
    """The interface of a simulator that makes frame banks."""

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
        """Write a bank of ``steps`` frames an episode into ``out``.

        ``progress`` gets the number of frames written and their total. ``controls_seed`` draws the
        distances of the control pictures; ``staging`` is the version of the staged moments.
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
"""The class behind each simulator's name, as ``module:class``, imported when it is opened."""

KINDS: dict[str, tuple[str, str, str]] = {
    "gym": (
        "gym:ENV_ID --actions FILE.toml",
        "Any Gymnasium environment with discrete actions that renders RGB, by a map of its actions; it makes no banks.",
        "eyechart.simulators.gym:open_environment",
    ),
}
"""What each ``KIND:NAME`` means: its spelling, its description, and ``module:function``. The
function is called with the name and the path of the action map."""


def find_simulator(name: str, *, actions: Path | None = None) -> Simulator | BankSimulator:
    """Open the simulator of this name, or one of a kind, such as ``gym:ENV_ID``.

    ``actions`` is the TOML file of the action map that ``gym:ENV_ID`` needs. Raises SpecError,
    listing the known names, for an unknown name and for an action map that is missing, wrong or not
    wanted.
    """
    kind, colon, rest = name.partition(":")
    if colon and kind in KINDS:
        return _import(KINDS[kind][-1])(rest, actions)
    if name not in SIMULATORS:
        raise SpecError(
            f"unknown simulator '{name}';{did_you_mean(name, SIMULATORS)} known: {', '.join(SIMULATORS)}, gym:ENV_ID"
        )
    if actions is not None:
        raise SpecError(f"simulator '{name}' has actions of its own; an action map is for gym:ENV_ID")
    return _import(SIMULATORS[name])()


def open_simulator(name: str, *, actions: Path | None = None) -> Simulator:
    """Open a simulator that can be driven.

    Raises SpecError as `find_simulator` does, and for a simulator that only makes banks.
    """
    found = find_simulator(name, actions=actions)
    if not found.declared.scenarios:
        raise SpecError(f"simulator '{name}' only makes banks: it cannot be driven")
    return cast("Simulator", found)


def open_bank_simulator(name: str) -> BankSimulator:
    """Open a simulator that makes banks; raises SpecError, with a hint, for one that does not."""
    found = find_simulator(name)
    if not found.declared.presets:
        raise SpecError(f"simulator '{name}' makes no banks: {found.declared.no_banks}")
    return cast("BankSimulator", found)


def declared_by(name: str) -> Declaration | None:
    """Return the declaration of a simulator by its name, None for a name not in the registry."""
    return find_simulator(name).declared if name in SIMULATORS else None


def _import(place: str) -> Callable[..., Simulator | BankSimulator]:
    module, _, attribute = place.partition(":")
    opened: Callable[..., Simulator | BankSimulator] = getattr(import_module(module), attribute)
    return opened


def known_simulators() -> dict[str, str]:
    """Return every preset and scenario of the simulators as it is written, with a description."""
    declared = {name: find_simulator(name).declared for name in SIMULATORS}
    rows = {
        f"{name} --{option} {choice}": says
        for name, one in declared.items()
        for option, choices in (("preset", one.presets), ("scenarios", one.scenarios))
        for choice, says in choices.items()
    }
    return rows | {written: says for written, says, _ in KINDS.values()}
