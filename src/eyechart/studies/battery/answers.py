"""One model's answers: its decisions by frame and condition, and the ground truth."""

import math
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from eyechart.calls import UNFINISHED, CallKey, Reply
from eyechart.frames import Frame, Gap, Provenance
from eyechart.ledger import Attempts
from eyechart.modes import is_made_elsewhere
from eyechart.run import Plan
from eyechart.spaces.space import UNPARSED, AnySpace, Decision
from eyechart.verdicts import DECIDED

Symbols = NDArray[np.str_]
Mask = NDArray[np.bool_]
Floats = NDArray[np.float64]
Codes = NDArray[np.int64]
Turns = NDArray[np.int32]
PairedValues = tuple[Floats, Mask]

D = TypeVar("D")
"""The type of a reply once it is read."""

ABSENT = ""
"""The symbol of a call without a reply."""

_SYMBOLS_KEPT = 500_000
"""The most bytes of a condition's symbols that are kept; a symbol has 4 bytes a letter, and many models add up."""

_FEW = 100
"""With fewer actions it is quicker to count the pairs of a column than to sort them."""

NO_GAP = "the bank records no gap"
NO_EPISODES = "the bank records no episodes, and its frames were not declared independent (--independent of its import)"


@dataclass(frozen=True)
class Answers:
    """A model's decisions. ``decisions[condition]`` follows ``frames``; None without a reply.

    ``finished`` counts the calls about these frames whose reply is final. ``no_gap`` gives the
    reason where ``gap`` is None. ``has_text`` says whether the prompt described each frame. ``made``
    says how the bank's control pictures were made. ``sent`` gives by condition the turn of each
    frame's call among all that were sent, -1 without one; it is empty where the order is unknown.
    """

    model: str
    frames: tuple[Frame, ...]
    space: AnySpace
    gap: Gap | None
    decisions: Mapping[str, tuple[Decision[Any] | None, ...]]
    finished: int = 0
    no_gap: str = NO_GAP
    has_text: bool = False
    made: Provenance = "rendered"
    sent: Mapping[str, Turns] = field(default_factory=dict, compare=False)

    def under(self, conditions: Collection[str]) -> "Answers":
        """Return the decisions under some conditions alone; ``finished`` still counts all calls."""
        return replace(
            self, decisions={name: decision for name, decision in self.decisions.items() if name in conditions}
        )

    def responses(self, condition: str) -> Symbols:
        """Return response-level symbols, one per frame: the action, UNPARSED, or ``ABSENT``."""
        return self.symbols(condition, "response")

    def actions(self, condition: str) -> Symbols:
        """Return decision-level symbols, one per frame: the action, or ``ABSENT`` without one."""
        return self.symbols(condition, "decision")

    def symbols(self, condition: str, level: str) -> Symbols:
        """Return a condition's symbols, read-only, at level ``response`` or ``decision``."""
        if (condition, level) not in self._symbols:
            names = [self.space.symbol(action) for action in self._coded[0]]
            none = UNPARSED if level == "response" else ABSENT
            made = _fixed(np.array([ABSENT, none, *names], dtype=np.str_)[self._column(condition) + 2])
            if made.nbytes > _SYMBOLS_KEPT:
                return made
            self._symbols[condition, level] = made
        return self._symbols[condition, level]

    def codes(self, condition: str, level: str, names: Sequence[str]) -> Codes:
        """Return the place of each frame's symbol in ``names``, -1 for ``ABSENT``; see `symbols`."""
        place, none = {name: at for at, name in enumerate(names)}, UNPARSED if level == "response" else ABSENT
        symbols = [ABSENT, none, *map(self.space.symbol, self._coded[0])]
        return np.array([place.get(one, -1) for one in symbols], dtype=np.int64)[self._column(condition) + 2]

    @cached_property
    def _symbols(self) -> dict[tuple[str, str], Symbols]:
        return {}

    @cached_property
    def _coded(self) -> tuple[tuple[Any, ...], dict[str, Codes]]:
        """Return the distinct actions, and each condition's decisions as indices into them.

        -1 stands for no decision, -2 for no reply.
        """
        codes, columns = dict[Any, int]({None: -1}), dict[str, Codes]()
        for name, column in self.decisions.items():
            known = dict(zip(map(id, column), column, strict=True))  # few are distinct
            place = {
                at: -2 if one is None else codes.setdefault(one.action, len(codes) - 1) for at, one in known.items()
            }
            columns[name] = np.fromiter(map(place.__getitem__, map(id, column)), np.int32, len(column))
        return tuple(codes)[1:], columns

    def _column(self, condition: str) -> Codes:
        columns = self._coded[1]
        return columns[condition] if condition in columns else np.full(len(self.frames), -2, dtype=np.int32)

    def given(self, condition: str) -> tuple[Mask, Mask]:
        """Return which frames have a reply, and which one without a decision."""
        codes = self._column(condition)
        return codes >= -1, codes == -1

    def distance(self, first: str, second: str, level: str = "decision", *, reflect: bool = False) -> PairedValues:
        """Return the distance between two conditions' answers, and the frames that have both.

        At level ``response`` a reply without a decision is 1 apart from every action. ``reflect``
        compares with the action for the reflected world; frames without such an action are left
        out.
        """
        one, other = self._column(first), self._column(second)
        least = -1 if level == "response" else 0
        have = (one >= least) & (other >= least)
        actions, count = self._coded[0], len(self._coded[0]) + 1

        def apart(pair: int) -> float:
            here, there = pair // count - 1, pair % count - 1
            if here < 0 or there < 0:
                return float(here != there)
            action = self.space.reflect(actions[here]) if reflect else actions[here]
            return math.nan if action is None else self.space.distance(action, actions[there])

        keys = (one[have].astype(np.int64) + 1) * count + other[have] + 1
        pairs = np.flatnonzero(np.bincount(keys)) if count < _FEW else np.unique(keys)
        found = np.array([apart(int(pair)) for pair in pairs], dtype=np.float64)[np.searchsorted(pairs, keys)]
        have[have] = ~np.isnan(found)
        return found[~np.isnan(found)], have

    def projection(self, condition: str, axis: str) -> Floats | None:
        """Return each decision along an axis, NaN without one; None for an unknown axis."""
        found = [self.space.project(action, axis) for action in self._coded[0]]
        if None in found:
            return None
        return np.array([math.nan, math.nan, *found], dtype=np.float64)[self._column(condition) + 2]

    def numbers(self, column: str) -> Floats:
        """Return each frame's number in a column of ground truth, NaN where there is none."""
        return _columns_of(_SameFrames(self.frames)).numbers(column)

    def both(self, first: str, second: str, level: str) -> tuple[Symbols, Symbols, Mask]:
        """Return two conditions' symbols on the frames that have both, and these frames' mask."""
        one, other = self.symbols(first, level), self.symbols(second, level)
        have = (one != ABSENT) & (other != ABSENT)
        return one[have], other[have], have

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Return the names of the actions, or of all answers where none is known beforehand."""
        return self.space.actions or tuple(sorted({self.space.symbol(action) for action in self._coded[0]}))

    @cached_property
    def reflections(self) -> dict[str, str]:
        """Return the actions that a reflection exchanges, each with its partner."""
        return {name: str(other) for name in self.space.actions if (other := self.space.reflect(name)) != name}

    @cached_property
    def partners(self) -> dict[str, str]:
        """Return the directions of `turns`, each with its partner."""
        return {self.space.turn(one): self.space.turn(other) for one, other in self.reflections.items()}

    def turns(self, condition: str, level: str = "decision") -> Symbols:
        """Return a condition's symbols as directions: their part that a reflection exchanges."""
        names = [self.space.symbol(action) for action in self._coded[0]]
        turned = [self.space.turn(one) for one in (ABSENT, UNPARSED if level == "response" else ABSENT, *names)]
        return np.array(turned, dtype=np.str_)[self._column(condition) + 2]

    def directions(self) -> dict[str, int]:
        """Return how often each direction was the answer to real and to mirrored pictures."""
        given = [self.turns(name) for name in ("real", "mirrored")]
        return {name: sum(int(np.count_nonzero(one == name)) for one in given) for name in self.partners}

    def counts(self) -> dict[str, Counter[str]]:
        """Return by condition how many replies hold a decision, and how many do not, by reason."""
        found = {}
        for name, column in self.decisions.items():
            known, found[name] = dict(zip(map(id, column), column, strict=True)), Counter[str]()
            for at, count in Counter(map(id, column)).items():  # few are distinct
                if (one := known[at]) is not None:
                    found[name][one.reason or DECIDED] += count
        return found

    @property
    def episodes(self) -> Symbols:
        """Return each frame's episode."""
        return _columns_of(_SameFrames(self.frames)).episodes

    @property
    def scenarios(self) -> Symbols:
        """Return each frame's scenario."""
        return _columns_of(_SameFrames(self.frames)).scenarios

    @property
    def steps(self) -> NDArray[np.int64]:
        """Return each frame's step."""
        return _columns_of(_SameFrames(self.frames)).steps

    @cached_property
    def gaps(self) -> NDArray[np.float64] | None:
        """Return each frame's gap in the bank's unit, infinite without a lead; None without a gap.

        Raises BankError with the frame's name where the declared column is missing or holds no
        number.
        """
        return None if self.gap is None else np.array(list(map(self.gap.of, self.frames)), dtype=np.float64)


class _FrameColumns:
    """What is read of frames alone, read-only, which many models' answers share."""

    def __init__(self, frames: tuple[Frame, ...]) -> None:
        self._frames = frames
        self._numbers: dict[str, Floats] = {}

    def numbers(self, column: str) -> Floats:
        """Return each frame's number in a column of ground truth, NaN where there is none."""
        if column not in self._numbers:
            found = [frame.truth.get(column) for frame in self._frames]
            made = np.array([float(one) if isinstance(one, int | float) else math.nan for one in found])
            self._numbers[column] = _fixed(made)
        return self._numbers[column]

    @cached_property
    def episodes(self) -> Symbols:
        return _fixed(np.array([frame.episode for frame in self._frames], dtype=np.str_))

    @cached_property
    def scenarios(self) -> Symbols:
        return _fixed(np.array([frame.scenario for frame in self._frames], dtype=np.str_))

    @cached_property
    def steps(self) -> NDArray[np.int64]:
        return _fixed(np.array([frame.step for frame in self._frames], dtype=np.int64))


def _fixed(array: NDArray[Any]) -> NDArray[Any]:
    array.flags.writeable = False
    return array


class _SameFrames:
    """Frames by their identity, because comparing them takes long."""

    def __init__(self, frames: tuple[Frame, ...]) -> None:
        self.frames = frames

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _SameFrames) and other.frames is self.frames

    def __hash__(self) -> int:
        return id(self.frames)


@lru_cache(maxsize=2)
def _columns_of(same: _SameFrames) -> _FrameColumns:
    return _FrameColumns(same.frames)


def read_answers(
    model: str,
    replies: Iterable[tuple[CallKey, Reply]],
    plan: Plan,
    *,
    independent: bool = False,
    has_text: bool = False,
) -> Answers:
    """Read every reply of a model under the plan's conditions as a decision.

    Where the bank records no episodes, its gap is read only if the frames were declared
    ``independent``.
    """
    conditions = frozenset(plan.conditions_of(model))
    wanted = ((key, reply) for key, reply in replies if key.condition in conditions)
    return _answers(
        model, plan, *read_columns(wanted, plan.frames, plan.read), independent=independent, has_text=has_text
    )


def answers_in(
    attempts: Attempts, plan: Plan, model: str, *, independent: bool = False, has_text: bool = False
) -> Answers:
    """Return what `read_answers` returns, from the attempts of a ledger, with the order of the calls.

    Of answers made elsewhere the ledger's order is that of their file, so theirs is unknown.
    """
    names, rows = frozenset(plan.conditions_of(model)), attempts.last(model)
    shown = np.array([name in names for name in attempts.names["condition"]], dtype=np.bool_)
    place = attempts.places(plan.places)[attempts.codes["frame"][rows]]
    kept = shown[attempts.codes["condition"][rows]] & (place >= 0)
    rows, place = rows[kept], place[kept]
    conditions, table = attempts.codes["condition"][rows], np.array([*attempts.decisions, None], dtype=object)
    turns, decisions, sent = np.searchsorted(attempts.of(model), rows), dict[str, Any](), dict[str, Turns]()
    for code in np.flatnonzero(np.bincount(conditions)).tolist():
        name, own = attempts.names["condition"][code], conditions == code
        column, sent[name] = np.full(len(plan.frames), -1), np.full(len(plan.frames), -1, dtype=np.int32)
        column[place[own]], sent[name][place[own]] = attempts.decision[rows[own]], turns[own]
        decisions[name] = tuple(table[column].tolist())
    finished = len(rows) - int(attempts.error(rows, UNFINISHED).sum())
    answers = _answers(
        model, plan, dict(sorted(decisions.items())), finished, independent=independent, has_text=has_text
    )
    return answers if is_made_elsewhere(model) else replace(answers, sent=sent)


def _answers(
    model: str,
    plan: Plan,
    decisions: Mapping[str, tuple[Decision[Any] | None, ...]],
    finished: int,
    *,
    independent: bool,
    has_text: bool,
) -> Answers:
    bank = plan.bank.manifest
    gap, silent = bank.gap, "episode" in bank.absent and not independent
    return Answers(
        model=model,
        frames=plan.frames,
        space=plan.space,
        gap=None if silent else gap,
        decisions=decisions,
        finished=finished,
        no_gap=NO_EPISODES if silent and gap is not None else NO_GAP,
        has_text=has_text,
        made=bank.provenance,
    )


def read_columns(
    replies: Iterable[tuple[CallKey, Reply]], frames: Sequence[Frame], read: Callable[[CallKey, Reply], D]
) -> tuple[dict[str, tuple[D | None, ...]], int]:
    """Return the replies as read, by condition and in frame order, and how many are final."""
    place, finished = {frame.id: index for index, frame in enumerate(frames)}, 0
    found: dict[str, list[D | None]] = {}
    for key, reply in replies:
        if key.frame in place:
            found.setdefault(key.condition, [None] * len(frames))[place[key.frame]] = read(key, reply)
            finished += reply.error not in UNFINISHED
    return {condition: tuple(column) for condition, column in sorted(found.items())}, finished
