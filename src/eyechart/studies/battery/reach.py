"""Which labels a bank can give, and how many more frames it needs, by error-free controllers.

Each label has controllers that deserve it. Their answers come from the bank's ground truth alone,
without a picture, and the rules of a verdict judge them. Where they give none of them the label,
the bank is made longer. Another controller may get what these do not.
"""

import random
from collections import ChainMap
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from eyechart.conditions import BATTERY, FURTHER, RANGED, is_available
from eyechart.frames import Frame, FrameBank
from eyechart.run import spread
from eyechart.seeds import key_seed
from eyechart.spaces.discrete import Discrete
from eyechart.spaces.space import Decision
from eyechart.studies.battery.answers import Answers
from eyechart.studies.battery.calibrated_statistics import CalibratedTests, LazyStatistics
from eyechart.studies.battery.controls import SIDES
from eyechart.studies.battery.depth import AT, BESIDE, PICTURE_OF, moved_of
from eyechart.studies.battery.odds import calls_of
from eyechart.studies.battery.paper_statistics import PaperStatistics, Resampling
from eyechart.verdicts import LABELS, calibrated_rules, lateral_rules
from eyechart.verdicts.battery_rules import DISTANCE, earns_lateral
from eyechart.verdicts.ruling import Ruling

MOST_TIMES, MOST_FRAMES = 8, 4000
"""A bank is extended up to this factor, and up to this number of frames."""

_HOW = Resampling(resamples=999)

NO_ROAD = ("blank", "noise", "text_only")
_DEPTH = ("lead_near", "lead_far", *RANGED)
_NEEDS: Mapping[str, tuple[str, ...]] = {
    "depth_lateral": ("mirrored", *_DEPTH),
    "depth": _DEPTH,
    "partial_depth": _DEPTH,
    "scene_cue": ("shuffled", "cross_scenario"),
    "content": ("shuffled",),
    "presence_only": ("shuffled", "blank"),
    "refusal_effect": ("shuffled", "blank"),
    "image_invariant": ("shuffled", "blank"),
}
"""The conditions that a label needs; ``depth_associated`` can also come from observation."""


@dataclass(frozen=True, slots=True)
class Reach:
    """Whether a bank can give a label, and if not, how many ``more`` frames it needs.

    ``more`` is None where no number of frames that was tried would do. ``lacks`` says in words what
    is missing, then on the longest bank tried; it is empty where nothing is.
    """

    label: str
    answer: str
    reached: bool
    more: int | None = None
    lacks: str = ""

    @property
    def words(self) -> str:
        """Return in words whether a simulated model reaches the label."""
        if self.reached:
            return "yes"
        return "no" if self.more is None else f"with about {self.more} more frames"


def reach_of(bank: FrameBank) -> tuple[Reach, ...]:
    """Return for every calibrated label whether a bank can give it."""
    return tuple(_reach(label, bank) for label in LABELS)


def unreachable_labels(bank: FrameBank, frames: tuple[Frame, ...], conditions: Collection[str]) -> list[str]:
    """Return the labels that no controller that is tried gets on these frames under these conditions.

    Conditions of later stages count as run.
    """
    if not bank.manifest.action_space.actions:
        bank = replace(bank, manifest=replace(bank.manifest, action_space=_OPEN))
    some, left = replace(bank, frames=frames), {*BATTERY, *_DEPTH[:2]} - {*conditions}
    parts = [spread(frames, _ENOUGH), *([frames] if len(frames) > _ENOUGH else [])]
    return [
        label
        for label in LABELS
        if LABELS[label].answer != "Inconclusive"
        and (
            left & {*_NEEDS.get(label, ())}
            or _lacks(label, some)
            or all(_kept_from(label, some, part) for part in parts)
        )
    ]


_OPEN = Discrete("open", ("one", "two", "three"), (), (), ())
"""Stands for answers whose names are not known beforehand: none brakes or turns."""

_ENOUGH = 288
"""A label that this many of the frames can show is not tried on all of them."""


def _reach(label: str, bank: FrameBank) -> Reach:
    answer = LABELS[label].answer
    if answer == "Inconclusive":  # any frames give such a label
        return Reach(label, answer, reached=True)
    if lacks := _lacks(label, bank):
        return Reach(label, answer, reached=False, lacks=lacks)
    if lacks := _kept_from(label, bank, bank.frames):
        more, still = _more(label, bank)
        return Reach(label, answer, reached=False, more=more, lacks=still or lacks)
    return Reach(label, answer, reached=True)


def _kept_from(label: str, bank: FrameBank, frames: tuple[Frame, ...]) -> str:
    """Return why the first deserving controller does not get a label on these frames; "" where one does.

    For a label without such a controller, return the rule's test that stays untested for a reader
    of distance.
    """
    if label in _CONTROLLERS:
        kept = ""
        for choose in _CONTROLLERS[label]:
            ruling = _ruled(label, choose, bank, frames)
            if ruling.label == label:
                return ""
            kept = kept or f"a simulated model that deserves it gets {ruling.label}: {ruling.reason}"
        return kept
    found = _found(_depth, bank, frames)[0]
    untested = [
        next((one.statistic for one in rule.needs if one.outcome(found) is None and not one.untested), "")
        for rule in DISTANCE.rules
        if rule.label == label
    ]
    return "" if "" in untested else f"its rule reads {untested[0]}: {found[untested[0]].note}"


def _lacks(label: str, bank: FrameBank) -> str:
    """Return which needed conditions no frame can be shown, or what else the bank lacks."""
    calls = calls_of(bank)
    shown = {name: calls.get(name, any(is_available(name, frame) for frame in bank)) for name in _NEEDS.get(label, ())}
    missing = [name for name, count in shown.items() if not count]
    if missing:
        return f"no frame can be shown {', '.join(missing)}"
    if label == "depth_lateral" and not any(
        all(isinstance(frame.truth.get(name), bool) for name in SIDES) for frame in bank
    ):
        return f"the bank does not say which side is clear ({' and '.join(SIDES)})"
    space = bank.manifest.action_space
    if "depth" in label and not space.brake:
        return "no action of this space brakes"
    if label == "depth_lateral" and not space.directional:
        return "no action of this space exchanges under reflection"
    return "" if len(space.actions) > 1 else "the space has one action"


def _more(label: str, bank: FrameBank) -> tuple[int | None, str]:
    """Return how many more frames like these would earn a label.

    None where none that are tried would, and what keeps it from the longest bank.
    """
    count = len(bank)

    def kept(frames: int) -> str:
        return _kept_from(label, bank, tuple(_longer(bank.frames, frames)))

    lacks = ""
    for enough in (many * count for many in (2, 4, MOST_TIMES) if many * count <= MOST_FRAMES):
        if not (still := kept(enough)):
            break
        lacks = f"{still} (on {enough} frames, the most that were tried)"
    else:
        return None, lacks
    least = enough // 2
    while enough - least > max(1, count // 16):
        middle = (least + enough) // 2
        least, enough = (middle, enough) if kept(middle) else (least, middle)
    return enough - count, ""


def _longer(frames: Sequence[Frame], count: int) -> Iterator[Frame]:
    """Yield so many frames: those of a bank repeatedly, each time as other episodes.

    The last repetition has the first steps only. Drawn distances are drawn again over their range,
    as evenly as in a built bank.
    """
    ordered = sorted(frames, key=lambda one: one.step)
    ranges = {name: _range_of(frames, name) for name in (*AT["drawn"], *AT["own"])}
    for place in range(count):
        again, one = divmod(place, len(ordered))
        frame = ordered[one]
        part = {name: (place * _GOLDEN + half / 2) % 1 for half, name in enumerate(ranges)}
        anew = {name: low * (high / low) ** part[name] for name, (low, high) in ranges.items() if frame.truth.get(name)}
        if again:
            frame = replace(
                frame, id=f"{frame.id}+{again}", episode=f"{frame.episode}+{again}", truth={**frame.truth, **anew}
            )
        yield frame


_GOLDEN = (5**0.5 - 1) / 2


def _range_of(frames: Sequence[Frame], column: str) -> tuple[float, float]:
    """Return the least and the greatest positive number in a column; (1, 1) without any."""
    known = [at for frame in frames if isinstance(at := frame.truth.get(column), int | float) and at > 0]
    return (min(known), max(known)) if known else (1.0, 1.0)


def _ruled(label: str, choose: "Choose", bank: FrameBank, frames: tuple[Frame, ...]) -> Ruling:
    """Return the ruling on a controller that deserves a label, if the bank had these frames."""
    without = (*RANGED, *FURTHER) if label == "depth_associated" else ()
    found, answers = _found(choose, bank, frames, without)
    turns = False
    if label == "depth_lateral":
        known = ChainMap({"mirror_swap_rate": PaperStatistics(answers, _HOW).swaps()}, found)  # type: ignore[arg-type]
        turns = earns_lateral(known, lateral_rules(known, answers.directions()).label)
    return calibrated_rules(found, turns=turns)[0]


def _found(
    choose: "Choose", bank: FrameBank, frames: tuple[Frame, ...], without: Sequence[str] = ()
) -> tuple[LazyStatistics, Answers]:
    """Return a controller's statistics and answers, if the bank had these frames."""
    answers = _Ideal(bank, frames).answers(choose, without=without)
    independent = bank.manifest.independent and bank.manifest.provenance != "rendered"
    return LazyStatistics(CalibratedTests(answers, _HOW, independent).tests()), answers


@dataclass(frozen=True)
class _Ideal:
    """The facts from which controllers answer, for a bank whose frames are ``frames``."""

    bank: FrameBank
    frames: tuple[Frame, ...]

    def answers(self, choose: "Choose", *, without: Sequence[str]) -> Answers:
        """Return a controller's answers to all calls of a run; an empty word is a refusal."""
        space, gap = self.bank.manifest.action_space, self.bank.manifest.gap
        conditions = [name for name, count in calls_of(self.bank).items() if count]
        conditions += [name for name in (*RANGED, *FURTHER, "nudged", "lead_absent") if name not in without]
        decisions = {
            name: tuple(
                _decided(choose(self, name, place)) if is_available(name, frame) else None
                for place, frame in enumerate(self.frames)
            )
            for name in conditions
        }
        given = {name: decision for name, decision in decisions.items() if any(decision)}
        return Answers("", self.frames, space, gap, given, made=self.bank.manifest.provenance)

    @cached_property
    def by_level(self) -> tuple[str, str, str]:
        """Return an action that goes on, one that brakes, and the one that brakes hardest."""
        space = self.space
        order = sorted(space.actions, key=lambda action: space.project(action, "brake") or 0.0)
        return order[0], order[-2], order[-1]

    @property
    def space(self) -> Discrete:
        """Return the bank's actions."""
        return self.bank.manifest.action_space

    @cached_property
    def distances(self) -> Mapping[str, np.ndarray]:
        """Return the lead's distance under each condition; unrecorded ones get a default."""
        levels = moved_of(Answers("", self.frames, self.space, self.bank.manifest.gap, {}))
        found = {name: levels.distance(picture) for name, picture in PICTURE_OF.items()}
        found |= {name: levels.distance("far") for name in (BESIDE, "exchange_apart")}
        return {name: np.where(np.isnan(one), _STANDS.get(name, np.inf), one) for name, one in found.items()}

    @cached_property
    def ends(self) -> tuple[float, float]:
        """Return the distances below which it brakes hardest, and beyond which it goes on."""
        known = np.concatenate([self.distances[name] for name in ("lead_drawn", "lead_near", "lead_far")])
        known, far = known[np.isfinite(known) & (known > 0)], self.distances["lead_far"]
        if not len(known) or known.min() == known.max():
            threshold = self.bank.manifest.gap.threshold if self.bank.manifest.gap is not None else 1.0
            return threshold, 2 * threshold
        near, least = float(np.geomspace(known.min(), known.max(), 4)[1]), float(far.min())
        return near, least if np.isfinite(least) else float(known.max())

    def partner(self, condition: str, place: int) -> int:
        """Return the frame that a condition shows: the next of the same or another scenario."""
        if condition not in {"shuffled", "cross_scenario"}:
            return place
        own = self.frames[place].scenario
        order = (*range(place + 1, len(self.frames)), *range(place))
        return next((one for one in order if (self.frames[one].scenario == own) == (condition == "shuffled")), place)


Choose = Callable[[_Ideal, str, int], str]
"""(the bank, condition, place of the frame) to an action."""

_STANDS = {"lead_near": 0.0, "lead_near_nudged": 0.0}
"""The distance of a lead that was not recorded: standing near; elsewhere infinite."""


def _decided(word: str) -> Decision[str]:
    return Decision(word) if word else Decision(None, "refused")


def _depth(of: _Ideal, condition: str, place: int) -> str:
    go, brake, hard = of.by_level
    at = _at(of, condition, place)
    return hard if condition in NO_ROAD or at < of.ends[0] else brake if at < of.ends[1] else go


def _at(of: _Ideal, condition: str, place: int) -> float:
    """Return the lead's distance in a picture, infinite without a lead."""
    if condition == "lead_absent":
        return np.inf
    return float(of.distances.get(condition, of.distances["real"])[of.partner(condition, place)])


def _but_one_scenario(of: _Ideal, condition: str, place: int) -> str:
    """Brake by distance except in the largest scenario."""
    names = [frame.scenario for frame in of.frames]
    blind = max(sorted(set(names)), key=names.count)
    said = _depth(of, condition, place)
    return of.by_level[0] if condition not in NO_ROAD and names[of.partner(condition, place)] == blind else said


def _but_far(of: _Ideal, condition: str, place: int) -> str:
    """Brake hardest in the near third of the range, and nowhere beyond it."""
    said = _depth(of, condition, place)
    return said if condition in NO_ROAD or said == of.by_level[2] else of.by_level[0]


def _lateral(of: _Ideal, condition: str, place: int, *, beyond: float, one_in: int) -> str:
    """Brake by distance; beyond a share of the range, in one in so many frames, turn to the only clear side."""
    near, far = of.ends
    said = _depth(of, condition, place)
    frame = of.frames[of.partner(condition, place)]
    is_near = _at(of, condition, place) < near ** (1 - beyond) * far**beyond
    if condition in NO_ROAD or is_near or key_seed("turn", frame.id) % one_in:
        return said
    clear = [side for side, name in zip(("left", "right"), SIDES, strict=True) if frame.truth.get(name) is True]
    turn = next(
        (action for action in of.space.actions if len(clear) == 1 and clear[0] in action.lower()), of.by_level[0]
    )
    return str(of.space.reflect(turn)) if condition == "mirrored" else turn


def _by_number(number: Callable[[_Ideal, str, int], int]) -> Choose:
    def choose(of: _Ideal, condition: str, place: int) -> str:
        return of.by_level[2] if condition in NO_ROAD else of.by_level[number(of, condition, place) % 3]

    return choose


def _of_picture(of: _Ideal, condition: str, place: int) -> int:
    return key_seed("picture", of.frames[of.partner(condition, place)].id)


def _of_scenario(of: _Ideal, condition: str, place: int) -> int:
    names = sorted({frame.scenario for frame in of.frames})
    return names.index(of.frames[of.partner(condition, place)].scenario)


def _coin(of: _Ideal, condition: str, place: int) -> str:
    if condition in NO_ROAD:
        return of.by_level[2]
    tossed = random.Random(key_seed("coin", condition, of.frames[place].id))  # noqa: S311 - no secret
    return tossed.choice(of.space.actions)


_CONTROLLERS: Mapping[str, tuple[Choose, ...]] = {
    "depth_lateral": (partial(_lateral, beyond=2 / 3, one_in=1), partial(_lateral, beyond=0.0, one_in=2)),
    "depth": (_depth,),
    "partial_depth": (_but_far, _but_one_scenario),
    "depth_associated": (_depth,),
    "content": (_by_number(_of_picture),),
    "self_inconsistent": (_coin,),
    "scene_cue": (_by_number(_of_scenario),),
    "presence_only": (lambda of, condition, _: of.by_level[2 if condition in NO_ROAD else 1],),
    "refusal_effect": (lambda of, condition, _: "" if condition == "blank" else of.by_level[1],),
    "image_invariant": (lambda of, _condition, _place: of.by_level[1],),
}
"""The controllers that deserve each label and never err, in the order in which they are tried."""
