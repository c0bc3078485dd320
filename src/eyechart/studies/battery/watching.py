"""Watching a run that may stop early: its calls come in, its evidence grows, and what is settled is asked no more."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from eyechart.calls import UNFINISHED, CallKey, Reply
from eyechart.ledger import Ledger
from eyechart.run import Plan
from eyechart.spaces.space import Decision
from eyechart.studies.battery.stopping import RULES, Course, Layout, layout_of
from eyechart.verdicts import Stopped

Given = dict[tuple[str, str], Decision[str]]
"""Decisions of finished calls, by (frame, condition)."""


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a model is: where it stopped, or None; ``left``: calls that are still to be made, at most."""

    stopped: Stopped | None
    left: int


def layout_for(plan: Plan, model: str) -> Layout:
    """Return what a plan asks of a model."""
    asked: dict[str, list[str]] = {frame.id: [] for frame in plan.frames}
    for key in plan.keys_of(model):
        asked[key.frame].append(key.condition)
    by_frame = {frame: tuple(names) for frame, names in asked.items()}
    return layout_of(plan.frames, by_frame, plan.bank.manifest.action_space, plan.seed)


class EarlyStop:
    """The watch of a run that stops early: one course a model, begun from what its ledger holds."""

    def __init__(self, plan: Plan, ledger: Ledger) -> None:
        self._space = plan.bank.manifest.action_space
        self._given: dict[str, Given] = {}
        self.courses: dict[str, Course] = {}
        for model in plan.models:
            course = Course(layout_for(plan, model))
            asked = {(frame, name) for frame, names in course.layout.asked.items() for name in names}
            self._given[model] = given = {
                (key.frame, key.condition): self._space.read(reply)
                for key, reply in ledger.replies(model)
                if reply.error not in UNFINISHED and (key.frame, key.condition) in asked
            }
            course.advance(given)
            self.courses[model] = course

    def queue(self, model: str, todo: Sequence[CallKey]) -> Iterator[CallKey]:
        """Yield the wanted calls of a model, frame by frame in the order in which frames count."""
        course = self.courses[model]
        of_frame: dict[str, list[CallKey]] = {}
        for key in todo:
            of_frame.setdefault(key.frame, []).append(key)
        for frame in course.layout.order:
            for key in of_frame.get(frame, ()):
                if key.condition in course.wanted(frame):
                    yield key

    def finished(self, key: CallKey, reply: Reply) -> None:
        """Add what came back to the evidence, and count every frame that it completes."""
        self._given[key.model][key.frame, key.condition] = self._space.read(reply)
        self.courses[key.model].advance(self._given[key.model])

    def progress(self, model: str) -> Progress:
        """Return how far a model is."""
        course, given = self.courses[model], self._given[model]
        open_ = (frame for frame in course.layout.order)
        left = sum((frame, name) not in given for frame in open_ for name in course.wanted(frame))
        return Progress(course.stopped(len(given)), left)

    @property
    def exhausted(self) -> bool:
        """Return whether the frames of some model are at an end with nothing settled and calls left out before."""
        return any(course.exhausted and self.progress(model).left for model, course in self.courses.items())


def typical(asked: Layout) -> dict[str, int]:
    """Return how many calls a model of each kind takes that never wavers, for the labels that can be settled early."""
    found = {}
    for label in RULES:
        course = Course(asked)
        course.advance(_unwavering(label, asked))
        stopped = course.stopped(len(course.counted))
        if stopped is not None and stopped.label == label:
            found[label] = stopped.calls
    return found


def _unwavering(label: str, layout: Layout) -> Mapping[tuple[str, str], Decision[str]]:
    """Return the answers of a clear controller that never turns; it goes on where it may, and brakes where it must."""
    space = layout.space
    straight = [action for action in space.actions if action not in space.directional] or list(space.actions)
    brake = space.brake[0] if space.brake else straight[-1]
    go = next((action for action in straight if action != brake), straight[0])
    lost: Decision[str] = Decision(None, "refused")
    other = Decision(brake)
    answers: dict[str, dict[str, Decision[str]]] = {
        "not_scorable": dict.fromkeys(("real", "real_repeat"), lost),
        "depth": {"lead_near": other, "blank": other},
        "presence_only": {"blank": other},
        "refusal_effect": {"blank": lost},
        "image_invariant": {},
    }
    return {
        (frame, name): answers[label].get(name, Decision(go)) for frame, names in layout.asked.items() for name in names
    }
