"""Stopping early: the calls of a model end once its verdict is settled; the ledger shows when.

Frames count in one seeded random order, each when all its wanted calls have finished. The order in
which calls come back does not matter, so the stop can be computed again from manifest, bank and
ledger.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from eyechart.calls import UNFINISHED, CallKey, Reply
from eyechart.conditions import CONTROLS, FURTHER, RANGED, shuffled_order
from eyechart.frames import BankManifest, Frame, Gap, Provenance
from eyechart.ledger import Ledger
from eyechart.run import Plan, Stages
from eyechart.spaces.discrete import Discrete
from eyechart.spaces.space import Decision
from eyechart.stats.statistic import Statistic
from eyechart.studies.battery.answers import Answers
from eyechart.studies.battery.calibrated_statistics import CalibratedTests, LazyStatistics
from eyechart.studies.battery.depth import AT, TWICE
from eyechart.studies.battery.evidence import Claim, FrameAnswers, claims
from eyechart.studies.battery.paper_statistics import Resampling
from eyechart.verdicts import LATERAL, PREFIX, StoppingPoint, calibrated_rules
from eyechart.verdicts.battery_rules import lateral_facts
from eyechart.verdicts.early_verdicts import EARLY, EARLY_LATERAL, NOT_YET
from eyechart.verdicts.rules import Axis, fact
from eyechart.verdicts.ruling import Ruling

NEEDED = ("real", "real_repeat", "blank")
"""Without these conditions no verdict can be settled."""


@dataclass(frozen=True, slots=True)
class SequentialTest:
    """Conditions run on the frames in order, ``until`` a claim settles or to the last frame.

    After the last frame the rules of a whole run say whether the verdict may still be ``depth``.
    """

    conditions: frozenset[str]
    until: str | None = None


ABSENT = "lead_absent"
_SAME = ("real", "real_repeat")
_ABSENT = (SequentialTest(frozenset((*_SAME, ABSENT)), f"bound_{ABSENT}"),)

ALONG = frozenset((*_SAME, "lead_near", "lead_far", *RANGED))
"""Without all of these conditions there is no early ``depth``."""

WALKS: Mapping[str, tuple[SequentialTest, ...]] = {
    "depth": (SequentialTest(ALONG),),
    "presence_only": _ABSENT,
    "refusal_effect": _ABSENT,
    "image_invariant": _ABSENT,
}
"""The walks over the controls that each label needs. See docs/decisions/stopping.md."""

_LATER = frozenset(walk.until for walks in WALKS.values() for walk in walks)
_SCORABLE = frozenset(("scorable", "unscorable"))
_TURNS = frozenset(name for label in LATERAL.values() for name in label.early)


class _ClaimStatistics(dict[str, Statistic]):
    """Facts, and the claims' statistics, each computed when a rule reads it.

    A claim that is not tested has no numbers.
    """

    def __init__(self, claims: Mapping[str, Claim], facts: Mapping[str, Statistic]) -> None:
        super().__init__(facts)
        self._claims = claims

    def __missing__(self, name: str) -> Statistic:
        claim = self._claims.get(name.removeprefix(PREFIX))
        return Statistic(None, 0) if claim is None else claim.statistic()


@dataclass(frozen=True)
class WholeRun:
    """What the rules of a whole run read of the bank besides the answers, and their seed."""

    gap: Gap | None = None
    made: Provenance = "rendered"
    independent: bool = False
    seed: int = 0

    @classmethod
    def of(cls, bank: BankManifest, seed: int) -> "WholeRun":
        """Return those of a bank; its gap as `read_answers` has it."""
        read = bank.independent or "episode" not in bank.absent
        return cls(bank.gap if read else None, bank.provenance, bank.independent, seed)


@dataclass(frozen=True)
class QuestionOrder:
    """The calls of one model: frames in the order in which they count, and the conditions of each.

    ``controls`` are further conditions that may follow; those of ``depth`` only if the frames have
    all that it needs. ``frames`` are the same frames in the order of the bank.
    """

    frames: tuple[Frame, ...]
    order: tuple[str, ...]
    conditions: Mapping[str, tuple[str, ...]]
    space: Discrete
    controls: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    whole: WholeRun = WholeRun()

    @cached_property
    def shown(self) -> frozenset[str]:
        """Return all conditions that any frame may be shown under."""
        return frozenset(name for one in (self.conditions, self.controls) for names in one.values() for name in names)

    def walks(self, label: str | None) -> tuple[SequentialTest, ...]:
        """Return the walks of a label that the frames allow.

        A walk along the range includes all further controls that the frames have.
        """
        made = [walk for walk in WALKS.get(label or "", ()) if walk.conditions <= self.shown]
        more = self.shown & {*FURTHER}
        return tuple(
            replace(walk, conditions=walk.conditions | more) if walk.conditions >= ALONG else walk for walk in made
        )

    def most(self, label: str) -> int:
        """Return how many control calls a label may need."""
        names = {name for walk in self.walks(label) for name in walk.conditions}
        return sum(name in names for control in self.controls.values() for name in control)

    @property
    def planned(self) -> int:
        """Return the number of calls."""
        return sum(map(len, self.conditions.values()))


def layout_of(frames: Sequence[Frame], every: Mapping[str, Sequence[str]], space: Discrete, seed: int) -> QuestionOrder:
    """Return the layout of a run of ``every`` frame under these conditions; controls come later.

    Each frame's place in the order comes from the seed and its own id.
    """
    order = shuffled_order([frame.id for frame in frames], seed)
    conditions = {frame: tuple(name for name in names if name not in CONTROLS) for frame, names in every.items()}
    shown = {name for names in every.values() for name in names}
    may = set(CONTROLS) & {ABSENT, *((*ALONG, *FURTHER) if shown >= ALONG else ())}
    controls = {frame: tuple(name for name in names if name in may) for frame, names in every.items()}
    return QuestionOrder(tuple(frames), tuple(order), conditions, space, controls if any(controls.values()) else {})


@dataclass
class StoppingState:
    """The state of one model: ``counted`` calls as (frame, condition), claims, and settled labels.

    ``passed`` counts the finished walks, ``walked`` the frames of the current one. ``failed`` says
    that a walk ended without showing its effect.
    """

    layout: QuestionOrder
    frames: int = 0
    label: str | None = None
    lateral: str | None = None
    counted: dict[tuple[str, str], None] = field(default_factory=dict)
    passed: int = 0
    walked: int = 0
    failed: bool = False
    turns: dict[str, int] = field(init=False)
    claims: dict[str, Claim] = field(init=False)

    def __post_init__(self) -> None:
        conditions = self.layout.shown
        directional = self.layout.space.turns
        self._turns_asked = bool(directional) and "mirrored" in conditions
        self.claims = claims(len(self.layout.order), self.layout.space, conditions, mirrored=self._turns_asked)
        self.turns = dict.fromkeys(directional, 0)
        self._judge()

    @property
    def _is_first_done(self) -> bool:
        """Return whether the first walk is done: label, scorability and turns are settled."""
        ended = self.frames == len(self.layout.order)
        lateral = self.lateral is not None or not self._turns_asked or ended
        return self.label is not None and self._is_scored and lateral

    @property
    def _walk(self) -> SequentialTest | None:
        """Return the current walk, None before the first and after the last one."""
        walks = self.layout.walks(self.label)
        return walks[self.passed] if self._is_first_done and self.passed < len(walks) else None

    @property
    def place(self) -> int:
        """Return the number of the current walk; 0 before the first walk of the controls."""
        return 1 + self.passed if self._is_first_done else 0

    @property
    def is_settled(self) -> bool:
        """Return whether the calls may end: the label and the lateral axis are settled."""
        return self._is_first_done and self._walk is None and not self.failed and not self._is_complete

    @property
    def is_exhausted(self) -> bool:
        """Return whether a walk ended with nothing settled; then the whole run decides."""
        if self._is_first_done:
            return self.failed or self._is_complete
        return self.frames == len(self.layout.order)

    @property
    def _is_complete(self) -> bool:
        """Return whether the first walk has counted every call of the run's first stage."""
        return all(
            (frame, name) in self.counted for frame, conditions in self.layout.conditions.items() for name in conditions
        )

    @property
    def _is_scored(self) -> bool:
        return self.label == "not_scorable" or self.claims["scorable"].is_settled

    def wanted(self, frame: str) -> tuple[str, ...]:
        """Return the wanted conditions of a frame that does not count yet."""
        conditions = self.layout.conditions[frame]
        if self.is_exhausted:
            return conditions
        if walk := self._walk:
            names = walk.conditions | ({"mirrored"} if self._turns_again else set())
            return tuple(name for name in (*conditions, *self.layout.controls.get(frame, ())) if name in names)
        if self._is_first_done:
            return ()
        if self.label is None:
            return conditions
        still = set() if self._is_scored else {"real", "real_repeat"}
        if self._turns_asked and self.lateral is None and "mirrored" in conditions:
            still |= {"real", "mirrored"}
        return tuple(name for name in conditions if name in still)

    @property
    def _turns_again(self) -> bool:
        """Return whether the turns are judged on all frames too.

        Where the turns swap with the mirror image, all frames may earn a stronger label.
        """
        return self.label == "depth" and self.lateral == "swaps"

    def advance(self, given: Mapping[tuple[str, str], Decision[str]]) -> None:
        """Count each next frame whose wanted calls are all ``given``, until the verdict settles.

        ``given`` maps (frame, condition) to the decision.
        """
        order = self.layout.order
        while not self.is_exhausted and not self.is_settled:
            walk = self._walk
            if walk and self.walked == len(order):
                self._end(walk, given)
                continue
            frame = order[self.walked if walk else self.frames]
            wanted = self.wanted(frame)
            if any((frame, name) not in given for name in wanted):
                return
            self.counted |= dict.fromkeys((frame, name) for name in wanted)
            row = FrameAnswers({name: given[frame, name] for name in wanted}, self.layout.space)
            if walk is None:
                self._count(row)
                continue
            self.walked += 1
            if walk.until:
                self.claims[walk.until].add(row)
                if self.claims[walk.until].is_settled:
                    self.passed, self.walked = self.passed + 1, 0

    def _end(self, walk: SequentialTest, given: Mapping[tuple[str, str], Decision[str]]) -> None:
        """Judge a walk after its last frame: by its claim, or by the rules of a whole run."""
        self.failed = bool(walk.until) or self._ruled(walk, given) != "depth"
        self.passed, self.walked = self.passed + 1, 0

    def _ruled(self, walk: SequentialTest, given: Mapping[tuple[str, str], Decision[str]]) -> str:
        """Return the label of the whole-run rules, for all frames and the walk's conditions."""
        frames, of = self.layout.frames, self.layout.whole
        shown = {name: tuple(given.get((frame.id, name)) for frame in frames) for name in sorted(walk.conditions)}
        answers = Answers("", frames, self.layout.space, of.gap, shown, made=of.made)
        tests = CalibratedTests(answers, Resampling(seed=of.seed), of.independent)
        return calibrated_rules(LazyStatistics(tests.tests()), turns=False)[0].label

    def _count(self, row: FrameAnswers) -> None:
        """Add the next frame to the open claims; once there is a label, to its two checks."""
        both = {"real", "real_repeat"} <= row.given.keys()
        for name, claim in self.claims.items():
            known = self.lateral if name in _TURNS else self.label
            if name not in _LATER and (both if name in _SCORABLE else known is None):
                claim.add(row)
        for condition in ("real", "mirrored"):
            action = row.action(condition)
            turn = None if action is None else self.layout.space.turn(action)
            if turn in self.turns:
                self.turns[turn] += 1
        self.frames += 1
        self._judge()

    def _judge(self) -> None:
        """Take the labels that the claims settle; a claim on controls is read by its walk."""
        first = {name: claim for name, claim in self.claims.items() if name not in _LATER}
        label, lateral = (self._ruling(axis, first).label for axis in (EARLY, EARLY_LATERAL))
        if label != NOT_YET and (self.label is None or label == "not_scorable"):  # what is settled stays
            self.label = label
        if lateral != NOT_YET and self.lateral is None:
            self.lateral = lateral

    def _ruling(self, axis: Axis, claims: Mapping[str, Claim], seen: Mapping[str, Statistic] | None = None) -> Ruling:
        return axis.evaluate(
            _ClaimStatistics(claims, {**fact("along", holds=self.layout.shown >= ALONG), **(seen or {})})
        )

    def stopped(self, finished: int) -> StoppingPoint | None:
        """Return where the verdict settled; None if it did not, or only after every call.

        ``finished`` counts the model's finished calls, including those after the stop.
        """
        if not self.is_settled or self.label is None:
            return None
        lateral, by = self._sideways()
        whole, ruling = self.label == "depth", self._ruling(EARLY, self.claims)
        scored = () if self.label == "not_scorable" else (f"{PREFIX}scorable",)
        later = [claim.frames for name, claim in self.claims.items() if name in _LATER]
        return StoppingPoint(
            label=self.label,
            decided_by="depth_interventional" if whole else ruling.decided_by,
            lateral=lateral,
            lateral_by=by,
            frames=len(self.layout.order) if whole else max(self.frames, *later, 0),
            calls=len(self.counted),
            planned=self.layout.planned + self.layout.most(self.label),
            beyond=finished - len(self.counted),
            interventional="near_far" in self.claims,
            other_claims=() if whole else (*ruling.other_claims, *scored),
        )

    def _sideways(self) -> tuple[str | None, str]:
        """Return the settled lateral label and its statistic; None where whole-run rules decide."""
        if self.lateral is None or self._turns_again:
            return None, "mirror_swap_rate"
        ruling = self._ruling(EARLY_LATERAL, self.claims, lateral_facts(_ClaimStatistics({}, {}), self.turns))
        return ruling.label, ruling.decided_by

    def statistics(self) -> dict[str, Statistic]:
        """Return every claim's e-value under its name."""
        return {PREFIX + name: claim.statistic() for name, claim in self.claims.items()}


GivenDecisions = dict[tuple[str, str], Decision[str]]
"""Decisions of finished calls, by (frame, condition)."""


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a model is: where it stopped, or None, and the most calls ``left`` to make."""

    stopped: StoppingPoint | None
    left: int


def layout_for(plan: Plan, model: str) -> QuestionOrder:
    """Return a plan's calls of a model."""
    conditions: dict[str, list[str]] = {frame.id: [] for frame in plan.frames}
    for key in plan.keys_of(model):
        conditions[key.frame].append(key.condition)
    by_frame = {frame: tuple(names) for frame, names in conditions.items()}
    layout = layout_of(plan.frames, by_frame, plan.bank.manifest.action_space, plan.seed)
    return replace(layout, whole=WholeRun.of(plan.bank.manifest, plan.seed))


class EarlyStop(Stages):
    """Stops models early: one course per model, begun from the replies in the ledger.

    ``plan`` has every control that may follow; ``later`` makes the control calls of a run in which
    nothing settled.
    """

    def __init__(self, plan: Plan, ledger: Ledger, later: Stages | None = None) -> None:
        self._plan, self._later, self._again = plan, later, set[tuple[str, int]]()
        self._given: dict[str, GivenDecisions] = {}
        self.courses: dict[str, StoppingState] = {}
        for model in plan.models:
            course = StoppingState(layout_for(plan, model))
            planned = {(key.frame, key.condition) for key in plan.keys_of(model)}
            self._given[model] = given = {
                (key.frame, key.condition): plan.read(key, reply)
                for key, reply in ledger.replies(model)
                if reply.error not in UNFINISHED and (key.frame, key.condition) in planned
            }
            course.advance(given)
            self.courses[model] = course

    def queue(self, model: str, todo: Sequence[CallKey]) -> Iterator[CallKey]:
        """Yield the wanted calls of a model, frame by frame in the order in which frames count."""
        course = self.courses[model]
        if course.is_exhausted:
            yield from todo
            return
        walk = course.place
        if walk and (model, walk) not in self._again:
            return  # these calls come with those of the controls
        of_frame: dict[str, list[CallKey]] = {}
        for key in todo:
            of_frame.setdefault(key.frame, []).append(key)
        for frame in course.layout.order:
            for key in of_frame.get(frame, ()):
                if course.place != walk or self.courses[model].is_exhausted:
                    return
                if key.condition in course.wanted(frame):
                    yield key

    def finished(self, key: CallKey, reply: Reply) -> None:
        """Add a reply to the evidence, and count every frame that it completes."""
        self._given[key.model][key.frame, key.condition] = self._plan.read(key, reply)
        self.courses[key.model].advance(self._given[key.model])
        if self._later is not None:
            self._later.finished(key, reply)

    def progress(self, model: str) -> Progress:
        """Return how far a model is."""
        course, given = self.courses[model], self._given[model]
        left = sum((frame, name) not in given for frame in course.layout.order for name in course.wanted(frame))
        return Progress(course.stopped(len(given)), left)

    def more(self, model: str) -> Sequence[CallKey]:
        """Return the calls of a model's next walk over the frames.

        Where a walk ended and settled nothing, these are the calls left out before, then the
        controls.
        """
        course, given = self.courses[model], self._given[model]
        plan = replace(self._plan, controls={}) if course.is_exhausted else self._plan
        left = [
            key
            for key in plan.keys_of(model)
            if (key.frame, key.condition) not in given and key.condition in course.wanted(key.frame)
        ]
        if course.is_exhausted and not left:
            return () if self._later is None else self._later.more(model)
        walk = -1 if course.is_exhausted else course.place
        if not walk or (model, walk) in self._again:
            return ()
        self._again.add((model, walk))
        return left


def typical(layout: QuestionOrder) -> dict[str, int]:
    """Return the calls of a model of each kind that never contradicts itself, by early label."""
    result = {}
    for label in (rule.label for rule in EARLY.rules if rule.label != NOT_YET):
        course = StoppingState(layout)
        course.advance(_unwavering(label, layout))
        stopped = course.stopped(len(course.counted))
        if stopped is not None and stopped.label == label:
            result[label] = stopped.calls
    return result


def _unwavering(label: str, layout: QuestionOrder) -> Mapping[tuple[str, str], Decision[str]]:
    """Return the answers of a clear model that never turns and brakes only where it must."""
    space = layout.space
    actions = space.actions or ("one", "other")  # of a space whose actions are not known beforehand
    straight = [action for action in actions if action not in space.directional] or list(actions)
    brake = space.brake[0] if space.brake else straight[-1]
    go = next((action for action in straight if action != brake), straight[0])
    lost: Decision[str] = Decision(None, "refused")
    other = Decision(brake)
    answers: dict[str, dict[str, Decision[str]]] = {
        "not_scorable": dict.fromkeys(("real", "real_repeat"), lost),
        "depth": dict.fromkeys((*TWICE["near"], "blank"), other),
        "depth_associated": {"lead_near": other, "blank": other},
        "presence_only": {"blank": other},
        "refusal_effect": {"blank": lost},
        "image_invariant": {},
    }
    found = {
        (frame, name): answers[label].get(name, Decision(go))
        for frame, names in layout.conditions.items()
        for name in (*names, *layout.controls.get(frame, ()))
    }
    return found | (dict.fromkeys(_nearer(layout) & found.keys(), other) if label == "depth" else {})


def _nearer(layout: QuestionOrder) -> set[tuple[str, str]]:
    """Return the pictures, by frame and condition, whose lead is nearer than the farthest."""
    columns = {name: AT[picture][0] for picture in ("drawn", "own") for name in TWICE[picture]}
    gaps = {(frame.id, name): frame.truth.get(column) for frame in layout.frames for name, column in columns.items()}
    known = {key: float(one) for key, one in gaps.items() if isinstance(one, int | float)}
    cut, gap = 0.7 * max(known.values(), default=0.0), layout.whole.gap
    if known and gap:
        known |= {(frame.id, name): gap.of(frame) for frame in layout.frames for name in TWICE["real"]}
    return {key for key, one in known.items() if one < cut}
