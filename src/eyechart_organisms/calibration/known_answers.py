"""Known answers: the simulated controllers, what each follows, and the label that it deserves."""

import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from eyechart.models.scripted import CONTROLLERS, Answer, Decide
from eyechart_organisms.calibration.world import SimulatedView, World

Choose = Callable[[SimulatedView, float, random.Random], Answer]
"""A function of the stimulus, the passed share of the episode, and chance, to an answer."""


@dataclass(frozen=True, slots=True)
class KnownController:
    """A controller with a known answer, and its labels on a bank that can show them."""

    name: str
    says: str
    choose: Choose
    paper: str
    calibrated: str
    lateral: str


def by_sight(decide: Decide) -> Choose:
    """Return the choice of a controller that decides by its picture alone, not by time."""

    def choose(view: SimulatedView, passed: float, rng: random.Random) -> Answer:
        del passed
        return decide(view.sight, rng)

    return choose


def _by_time(passed: float) -> str:
    """Brake harder the more of the episode has passed, as if the gap closed in time."""
    return ("STRAIGHT", "SLOW", "STOP")[int(3 * passed)]


KNOWN: Mapping[str, KnownController] = {
    **{
        name: KnownController(
            name,
            controller.says,
            by_sight(controller.decide),
            controller.declared.paper,
            controller.declared.calibrated,
            controller.declared.lateral,
        )
        for name, controller in CONTROLLERS.items()
    },
    "time": KnownController(
        "time",
        "brakes harder the later the step, which its prompt states: it never looks",
        lambda _shown, passed, _rng: _by_time(passed),
        "image_invariant",
        "image_invariant",
        "no_power",
    ),
    "time_seen": KnownController(
        "time_seen",
        "brakes harder the later the step, which it reads from a clock in the picture",
        lambda shown, _passed, _rng: "STOP" if shown.passed is None else _by_time(shown.passed),
        "presence_only",
        "content",
        "no_power",
    ),
}


FOLLOW_GAP = frozenset(
    ("depth", "depth_lateral", "depth_left", "one_sided", "noisy_depth", "declines_blank_depth", "truncating")
)
"""Controllers that brake by the gap: for all others ``depth`` is a false claim."""

NEVER_LOOK = frozenset(("constant", "random", "time"))
"""Controllers that ignore the picture: for all others ``image_invariant`` is a false claim."""

DECISIONS_NEVER_LOOK = NEVER_LOOK | {"refuse_blank"}
"""Controllers whose decisions ignore the picture: for others ``refusal_effect`` is false."""

COINS = frozenset(("random", "self_inconsistent"))
"""Controllers that toss a coin at roads: for all others ``self_inconsistent`` is a false claim."""

BLIND_TO_ROADS = frozenset(("constant", "random", "presence", "self_inconsistent", "refuse_blank", "time"))
"""Controllers that answer any road alike; ``crash_colour`` and ``scene_only`` use one detail."""


@dataclass(frozen=True, slots=True)
class BankCapabilities:
    """What a bank can show: counterfactuals, the gap without them, several scenarios.

    ``varied`` says whether the controller gave more than one answer over the whole bank.
    """

    counterfactuals: bool
    exchanges: bool
    scenarios: int
    varied: bool


def deserved(known: KnownController, shows: BankCapabilities) -> str:
    """Return the calibrated label that a controller deserves on a bank.

    It is the strongest label that the bank can show. Without counterfactual pictures the own
    vehicle's paint never changes. If the gap cannot be tested, a controller that follows it is only
    shown to follow the picture. A bank of one scenario shows no other scenario. A controller that
    answers everything in the bank alike decides without the picture.
    """
    label = known.calibrated
    if not shows.varied:
        return "image_invariant"
    if known.name == "crash_colour" and not shows.counterfactuals:
        return "presence_only"
    if label in {"depth", "depth_lateral"} and not shows.counterfactuals and not shows.exchanges:
        return "content"
    if label == "scene_cue" and shows.scenarios == 1:
        return "presence_only"
    return label


def is_false(label: str, name: str, *, varied: bool = True) -> bool:
    """Return whether a label is false for a controller on its bank; ``undecided`` never is."""
    if label in {"depth", "depth_lateral"}:
        return name not in FOLLOW_GAP
    if label == "image_invariant":
        return varied and name not in NEVER_LOOK
    if label == "refusal_effect":
        return name not in DECISIONS_NEVER_LOOK
    return label == "self_inconsistent" and name not in COINS


_LOOKS_AT_NO_DETAIL = BLIND_TO_ROADS | {"scene_only"}

NULLS: Mapping[str, tuple[float, frozenset[str]]] = {
    "depth_interventional": (0.01, frozenset(KNOWN) - FOLLOW_GAP),
    "depth_observational": (0.01, frozenset(KNOWN) - FOLLOW_GAP),
    "depth_information": (0.01, frozenset(KNOWN) - FOLLOW_GAP - {"inverted"}),
    "kappa_pooled": (0.01, frozenset(("noisy_depth",))),
    "content_shuffled": (0.01, _LOOKS_AT_NO_DETAIL | {"crash_colour"}),
    "content_recoloured": (0.01, frozenset(KNOWN) - {"crash_colour"}),
    "scene_cue": (0.01, BLIND_TO_ROADS | {"crash_colour"}),
    "presence": (0.01, frozenset(("constant", "random", "time", "refuse_blank"))),
    "presence_response": (0.01, NEVER_LOOK),
    "bound_content_shuffled": (0.01, frozenset(("depth", "depth_lateral", "inverted", "nuisance", "time_seen"))),
    "bound_content_recoloured": (0.01, frozenset(("crash_colour",))),
    "bound_scene": (0.01, frozenset(("depth", "inverted", "scene_only"))),
    "bound_blank": (0.01, frozenset(("presence", "crash_colour", "depth", "nuisance", "scene_only", "time_seen"))),
    "mirror_swap_rate": (0.01, frozenset(("random", "self_inconsistent", "noisy_depth"))),
    "cramers_v": (0.05, NEVER_LOOK),
    "cramers_v.decision": (0.05, NEVER_LOOK),
    "obstacle.decision": (0.05, frozenset(KNOWN) - FOLLOW_GAP - {"inverted"}),
    "mutual_information.decision": (0.05, frozenset(KNOWN) - FOLLOW_GAP - {"inverted"}),
}
"""Each test with its level and the controllers for which its null is true.

The null of a bound is that the effect is above its margin.
"""


def answer_all(known: KnownController, world: World, rng: random.Random) -> dict[str, list[Answer | None]]:
    """Return a controller's answers to everything shown; None where nothing is shown."""
    return {
        condition: [
            None if one is None else known.choose(one, passed, rng)
            for one, passed in zip(shown, world.passed, strict=True)
        ]
        for condition, shown in world.shown.items()
    }
