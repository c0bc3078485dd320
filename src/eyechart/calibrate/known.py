"""Known answers: which controllers are simulated, what each follows in truth, and the label that it deserves."""

import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from eyechart.calibrate.world import Shown, World
from eyechart.models import organisms_folder
from eyechart.models.scripted import CONTROLLERS, Answer, Decide

if TYPE_CHECKING:
    from eyechart_organisms.adversaries import Adversary

Choose = Callable[[Shown, float, random.Random], Answer]
"""(what is shown, how much of the asked frame's episode has passed, chance) to an answer."""


@dataclass(frozen=True, slots=True)
class Known:
    """A controller whose answer is known, with the labels that it deserves on a bank that can tell."""

    name: str
    says: str
    choose: Choose
    paper: str
    calibrated: str
    lateral: str


def by_sight(decide: Decide) -> Choose:
    """Return the choice of a controller that decides on what it sees, whatever the time."""

    def choose(shown: Shown, passed: float, rng: random.Random) -> Answer:
        del passed
        return decide(shown.sight, rng)

    return choose


def _by_time(passed: float) -> str:
    """Brake harder the more of the episode has passed, which looks like distance where the gap closes in time."""
    return ("STRAIGHT", "SLOW", "STOP")[int(3 * passed)]


KNOWN: Mapping[str, Known] = {
    **{
        name: Known(
            name, one.says, by_sight(one.decide), one.declared.paper, one.declared.calibrated, one.declared.lateral
        )
        for name, one in CONTROLLERS.items()
    },
    "time": Known(
        "time",
        "brakes harder the later the step, which it is told in words: it never looks",
        lambda _shown, passed, _rng: _by_time(passed),
        "image_invariant",
        "image_invariant",
        "no_power",
    ),
    "time_seen": Known(
        "time_seen",
        "brakes harder the later the step, which it reads from a clock in the picture",
        lambda shown, _passed, _rng: "STOP" if shown.passed is None else _by_time(shown.passed),
        "presence_only",
        "content",
        "no_power",
    ),
}


def adversaries() -> "Mapping[str, Adversary]":
    """Return the rules that must not pass, by name; raises SpecError that says what to install where they are not."""
    organisms_folder("'eyechart calibrate'")
    from eyechart_organisms.adversaries import ADVERSARIES  # noqa: PLC0415 - a distribution of its own

    return ADVERSARIES


FOLLOW_GAP = frozenset(
    ("depth", "depth_lateral", "depth_left", "one_sided", "noisy_depth", "declines_blank_depth", "truncating")
)
"""Their braking follows the gap: for all others ``depth`` is a false claim."""

NEVER_LOOK = frozenset(("constant", "random", "time"))
"""What they answer does not depend on the picture: for all others ``image_invariant`` is a false claim."""

DECISIONS_NEVER_LOOK = NEVER_LOOK | {"refuse_blank"}
"""Their decisions, where they give one, do not depend on the picture: for all others ``refusal_effect`` is false."""

COINS = frozenset(("random", "self_inconsistent"))
"""They toss a coin at roads: for all others ``self_inconsistent`` is a false claim."""

BLIND_TO_ROADS = frozenset(("constant", "random", "presence", "self_inconsistent", "refuse_blank", "time"))
"""Any road is as good as another to them; ``crash_colour`` and ``scene_only`` look at one thing only."""


@dataclass(frozen=True, slots=True)
class Shows:
    """What a bank can show: counterfactuals, the gap without them, several scenarios.

    ``varied`` is whether the controller gave more than one answer over everything that it was shown.
    """

    counterfactuals: bool
    exchanges: bool
    scenarios: int
    varied: bool


def deserved(known: Known, shows: Shows) -> str:
    """Return the calibrated label that a controller deserves on a bank: the most that the bank can show of it.

    Without counterfactual pictures the own vehicle's paint never changes; where the gap cannot be tested a follower
    of it shows that it follows the picture; in one scenario there is no other to be told from. A controller that
    answers alike to everything that a bank has, and to no picture, decides there without the picture.
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
    """Return whether a label claims of a controller what is not true on its bank; ``undecided`` never does."""
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
"""Each test with its level and the controllers of which its null is true; of a bound, that the effect is above its
margin."""


def answer_all(known: Known, world: World, rng: random.Random) -> dict[str, list[Answer | None]]:
    """Return what a controller answers to everything that is shown; None where nothing is shown."""
    return {
        condition: [
            None if one is None else known.choose(one, passed, rng)
            for one, passed in zip(shown, world.passed, strict=True)
        ]
        for condition, shown in world.shown.items()
    }
