"""Stopping early: a model is no longer asked once its verdict is settled, and its ledger says when that was.

Which calls count does not depend on when they came back: frames count in one seeded random order, each when all calls
about it that were wanted have finished. So the stop can be computed again from manifest, bank and ledger alone.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from eyechart.calls import UNFINISHED, CallKey, Reply
from eyechart.conditions import CONTROLS, shuffled_order
from eyechart.frames import Frame
from eyechart.ledger import Ledger
from eyechart.run import Plan, Stages
from eyechart.spaces.discrete import Discrete
from eyechart.spaces.space import Decision
from eyechart.stats.statistic import Statistic
from eyechart.studies.battery.evidence import CONTROLLED, PAIRS, Claim, Row, claims
from eyechart.verdicts import LABELS, LATERAL, PREFIX, Stopped

NEEDED = ("real", "real_repeat", "blank")
"""Without these conditions nothing can be settled."""

RULES = {name: label.early for name, label in LABELS.items() if label.early}
"""The labels that can be settled early, in the order of the rules, and the claims that must all be settled. All but
the first label need ``scorable`` too. Those of a condition that the bank cannot show are left out, but
``bound_shuffled``, without which no absence is claimed."""

REQUIRED = frozenset(("bound_shuffled", "own_beside"))
"""Without the second no ``depth``: then ``depth_associated`` is all that can be settled."""

WALKS: tuple[tuple[frozenset[str], frozenset[str]], ...] = (
    (frozenset(("lead_near", "lead_far", *PAIRS["own_beside"])), frozenset(("own_beside", "net_own_beside"))),
    (frozenset(("real", "real_repeat", *CONTROLLED)), frozenset(("bound_reversed", "bound_nudged"))),
)
"""What ``depth`` needs of controls: conditions that are asked of all frames from the first, until these claims settle.

See docs/decisions/0039-asked-in-stages.md.
"""

LATERAL_RULES = {name: label.early for name, label in LATERAL.items() if label.early}
"""The lateral labels likewise; ``one_sided`` stands for the latter two where only one direction is ever given."""

DISTANCE = ("depth", "depth_associated")
"""The labels whose evidence is that it brakes by distance: the first where there are controls, else the second."""

_LATER = frozenset(name for _, names in WALKS for name in names)
_SCORABLE = frozenset(("scorable", "unscorable"))
_TURNS = frozenset(name for names in LATERAL_RULES.values() for name in names)

ONE_SIDED_FROM = 8
"""So many turns of one direction only, and none of another, are ``one_sided``."""


@dataclass(frozen=True)
class Layout:
    """What a run asks of a model: frames in the order in which they count, and the conditions asked of each.

    ``controls`` are those that it may be asked besides, none where any that ``depth`` needs cannot be shown.
    """

    order: tuple[str, ...]
    asked: Mapping[str, tuple[str, ...]]
    space: Discrete
    controls: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def planned(self) -> int:
        """Return the number of calls."""
        return sum(map(len, self.asked.values()))


def layout_of(frames: Sequence[Frame], every: Mapping[str, Sequence[str]], space: Discrete, seed: int) -> Layout:
    """Return the layout of a run that asks ``every`` frame these conditions; controls among them come later.

    Each frame's place in the order comes from the seed and its own id.
    """
    order = shuffled_order([frame.id for frame in frames], seed)
    asked = {frame: tuple(name for name in names if name not in CONTROLS) for frame, names in every.items()}
    needed = set(CONTROLS) & set(CONTROLLED)
    controls = {frame: tuple(name for name in names if name in needed) for frame, names in every.items()}
    whole = {name for names in every.values() for name in names}.issuperset(CONTROLLED)
    return Layout(tuple(order), asked, space, controls if whole else {})


@dataclass
class Course:
    """How far one model's evidence has come: ``counted`` calls as (frame, condition), claims, and what is settled."""

    layout: Layout
    frames: int = 0
    label: str | None = None
    lateral: str | None = None
    counted: dict[tuple[str, str], None] = field(default_factory=dict)
    turns: dict[str, int] = field(init=False)
    claims: dict[str, Claim] = field(init=False)

    def __post_init__(self) -> None:
        every = (*self.layout.asked.values(), *self.layout.controls.values())
        conditions = {name for asked in every for name in asked}
        directional = self.layout.space.directional
        self._turns_asked = bool(directional) and "mirrored" in conditions
        self.claims = claims(len(self.layout.order), self.layout.space, conditions, mirrored=self._turns_asked)
        self.turns = dict.fromkeys(directional, 0)
        self._judge()

    @property
    def _first(self) -> bool:
        """Return whether the first walk has nothing more to ask: a label has its evidence, and so has the rest."""
        ended = self.frames == len(self.layout.order)
        lateral = self.lateral is not None or not self._turns_asked or ended
        return self.label is not None and self._scored and lateral

    @property
    def walk(self) -> int:
        """Return which walk over the frames this is; one more than there are where nothing more need be asked."""
        if not self._first:
            return 0
        walks = () if self.label != "depth" else WALKS
        settled = (all(self.claims[name].settled for name in names) for _, names in walks)
        return next((number for number, one in enumerate(settled, 1) if not one), 1 + len(WALKS))

    @property
    def settled(self) -> bool:
        """Return whether nothing more need be asked: the label is settled, and so is the lateral axis."""
        return self.walk > len(WALKS) and not self._complete

    @property
    def exhausted(self) -> bool:
        """Return whether a walk is at its end and nothing is settled, so that the whole run has to decide."""
        walk, frames = self.walk, len(self.layout.order)
        if walk > len(WALKS) or (walk and self._complete):
            return self._complete
        return frames == (self.frames if not walk else self._walked(walk))

    @property
    def _complete(self) -> bool:
        """Return whether the first walk has counted every call that the run asks in its first stage."""
        return all((frame, name) in self.counted for frame, asked in self.layout.asked.items() for name in asked)

    def _walked(self, walk: int) -> int:
        """Return how many frames a walk over the controls has counted."""
        return max(self.claims[name].frames for name in WALKS[walk - 1][1])

    @property
    def _scored(self) -> bool:
        return self.label == "not_scorable" or self.claims["scorable"].settled

    def wanted(self, frame: str) -> tuple[str, ...]:
        """Return the conditions to ask of a frame that does not count yet, as far as the evidence has come."""
        asked = self.layout.asked[frame]
        if self.exhausted:
            return asked
        if walk := self.walk:
            names = () if walk > len(WALKS) else WALKS[walk - 1][0]
            return tuple(name for name in (*asked, *self.layout.controls.get(frame, ())) if name in names)
        if self.label is None:
            return asked
        still = set() if self._scored else {"real", "real_repeat"}
        if self._turns_asked and self.lateral is None and "mirrored" in asked:
            still |= {"real", "mirrored"}
        return tuple(name for name in asked if name in still)

    def advance(self, given: Mapping[tuple[str, str], Decision[str]]) -> None:
        """Count every next frame whose wanted calls are all ``given``, by (frame, condition), until it settles."""
        order = self.layout.order
        while not self.exhausted and (walk := self.walk) <= len(WALKS):
            frame = order[self._walked(walk) if walk else self.frames]
            wanted = self.wanted(frame)
            if any((frame, name) not in given for name in wanted):
                return
            self.counted |= dict.fromkeys((frame, name) for name in wanted)
            row = Row({name: given[frame, name] for name in wanted}, self.layout.space)
            if walk:
                for name in WALKS[walk - 1][1]:
                    self.claims[name].add(row)
            else:
                self._count(row)

    def _count(self, row: Row) -> None:
        """Add the next frame to the claims that are still open; once there is a label, to those of its two checks."""
        both = {"real", "real_repeat"} <= row.given.keys()
        for name, claim in self.claims.items():
            known = self.lateral if name in _TURNS else self.label
            if name not in _LATER and (both if name in _SCORABLE else known is None):
                claim.add(row)
        for condition in ("real", "mirrored"):
            action = row.action(condition)
            if action in self.turns:
                self.turns[action] += 1
        self.frames += 1
        self._judge()

    def _judge(self) -> None:
        if self._all("not_scorable", RULES):
            self.label = "not_scorable"
        elif self.label is None:
            self.label = next((label for label in RULES if self._reached(label)), None)
        if self.lateral is None:
            self.lateral = next((label for label in LATERAL_RULES if self._all(label, LATERAL_RULES)), None)

    def _reached(self, label: str) -> bool:
        """Return whether a label has its evidence of the first walk; that of its controls is walked for after it."""
        if label in DISTANCE and label != ("depth" if self.layout.controls else "depth_associated"):
            return False
        return self._all(label, RULES)

    def _all(self, label: str, rules: Mapping[str, tuple[str, ...]]) -> bool:
        needed = (name for name in self._needed(rules[label]) if name not in _LATER)
        return all(name in self.claims and self.claims[name].settled for name in needed)

    def _needed(self, names: tuple[str, ...]) -> list[str]:
        """Return the claims that a label needs on this bank; the first always, others where they can be tested."""
        return [name for name in names if name in self.claims or name in REQUIRED or name == names[0]]

    def stopped(self, finished: int) -> Stopped | None:
        """Return where it was settled, None where it was not, or only when every call had been made.

        ``finished`` counts the model's finished calls of this run, also those beyond the stop.
        """
        if not self.settled or self.label is None:
            return None
        lateral, by = self.lateral, "mirror_swap_rate"
        if lateral is not None:
            by = PREFIX + LATERAL_RULES[lateral][0]
            seen = [count for count in self.turns.values() if count]
            if lateral != "swaps" and len(seen) == 1 and seen[0] >= ONE_SIDED_FROM:
                lateral = "one_sided"
        controls = sum(map(len, self.layout.controls.values())) if self.label == "depth" else 0
        with_it = self._needed(RULES[self.label])[1:] + ([] if self.label == "not_scorable" else ["scorable"])
        return Stopped(
            label=self.label,
            decided_by=PREFIX + RULES[self.label][0],
            lateral=lateral,
            lateral_by=by,
            frames=max(self.frames, *(self.claims[name].frames for name in _LATER & self.claims.keys()), 0),
            calls=len(self.counted),
            planned=self.layout.planned + controls,
            beyond=finished - len(self.counted),
            interventional="near_far" in self.claims,
            with_it=tuple(PREFIX + name for name in with_it),
        )

    def statistics(self) -> dict[str, Statistic]:
        """Return every claim's e-value under its name."""
        return {PREFIX + name: claim.statistic() for name, claim in self.claims.items()}


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
    """The watch of a run that stops early: one course a model, begun from what its ledger holds.

    ``plan`` has every control that may be asked; ``later`` asks those of a run that settled nothing.
    """

    def __init__(self, plan: Plan, ledger: Ledger, later: Stages | None = None) -> None:
        self._plan, self._later, self._again = plan, later, set[tuple[str, int]]()
        self._space = plan.bank.manifest.action_space
        self._given: dict[str, Given] = {}
        self.courses: dict[str, Course] = {}
        for model in plan.models:
            course = Course(layout_for(plan, model))
            asked = {(key.frame, key.condition) for key in plan.keys_of(model)}
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
        if course.exhausted:
            yield from todo
            return
        walk = course.walk
        if walk and (model, walk) not in self._again:
            return  # its calls come with those of its controls
        of_frame: dict[str, list[CallKey]] = {}
        for key in todo:
            of_frame.setdefault(key.frame, []).append(key)
        for frame in course.layout.order:
            for key in of_frame.get(frame, ()):
                if course.walk != walk or self.courses[model].exhausted:
                    return
                if key.condition in course.wanted(frame):
                    yield key

    def finished(self, key: CallKey, reply: Reply) -> None:
        """Add what came back to the evidence, and count every frame that it completes."""
        self._given[key.model][key.frame, key.condition] = self._space.read(reply)
        self.courses[key.model].advance(self._given[key.model])

    def progress(self, model: str) -> Progress:
        """Return how far a model is."""
        course, given = self.courses[model], self._given[model]
        left = sum((frame, name) not in given for frame in course.layout.order for name in course.wanted(frame))
        return Progress(course.stopped(len(given)), left)

    def more(self, model: str) -> Sequence[CallKey]:
        """Return the calls of a model's next walk over the frames.

        Where a walk has come to the end and settled nothing, these are what was left out, and then its controls.
        """
        course, given = self.courses[model], self._given[model]
        plan = replace(self._plan, controls={}) if course.exhausted else self._plan
        left = [
            key
            for key in plan.keys_of(model)
            if (key.frame, key.condition) not in given and key.condition in course.wanted(key.frame)
        ]
        if course.exhausted and not left:
            return () if self._later is None else self._later.more(model)
        walk = 1 + len(WALKS) if course.exhausted else course.walk
        if not walk or (model, walk) in self._again:
            return ()
        self._again.add((model, walk))
        return left


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
        "depth": {"lead_near": other, "lane_own": other, "blank": other},
        "depth_associated": {"lead_near": other, "blank": other},
        "presence_only": {"blank": other},
        "refusal_effect": {"blank": lost},
        "image_invariant": {},
    }
    return {
        (frame, name): answers[label].get(name, Decision(go))
        for frame, names in layout.asked.items()
        for name in (*names, *layout.controls.get(frame, ()))
    }
