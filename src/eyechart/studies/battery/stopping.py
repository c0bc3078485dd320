"""Stopping early: a model is no longer asked once its verdict is settled, and its ledger says when that was.

Which calls count does not depend on when they came back: frames count in one seeded random order, each when all calls
about it that were wanted have finished. So the stop can be computed again from manifest, bank and ledger alone.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from eyechart.frames import Frame
from eyechart.seeds import key_seed
from eyechart.spaces.discrete import Discrete
from eyechart.spaces.space import Decision
from eyechart.stats.statistic import Statistic
from eyechart.studies.battery.evidence import Claim, Row, claims
from eyechart.verdicts import LABELS, LATERAL, PREFIX, Stopped

NEEDED = ("real", "real_repeat", "blank")
"""Without these conditions nothing can be settled."""

RULES = {name: label.early for name, label in LABELS.items() if label.early}
"""The labels that can be settled early, in the order of the rules, and the claims that must all be settled. All but
the first label need ``scorable`` too. Those of a condition that the bank cannot show are left out, but
``bound_shuffled``, without which no absence is claimed."""

REQUIRED = frozenset(("bound_shuffled",))

LATERAL_RULES = {name: label.early for name, label in LATERAL.items() if label.early}
"""The lateral labels likewise; ``one_sided`` stands for the latter two where only one direction is ever given."""

_SCORABLE = frozenset(("scorable", "unscorable"))
_TURNS = frozenset(name for names in LATERAL_RULES.values() for name in names)

ONE_SIDED_FROM = 8
"""So many turns of one direction only, and none of another, are ``one_sided``."""


@dataclass(frozen=True)
class Layout:
    """What a run asks of a model: frames in the order in which they count, and the conditions asked of each."""

    order: tuple[str, ...]
    asked: Mapping[str, tuple[str, ...]]
    space: Discrete

    @property
    def planned(self) -> int:
        """Return the number of calls."""
        return sum(map(len, self.asked.values()))


def layout_of(frames: Sequence[Frame], asked: Mapping[str, tuple[str, ...]], space: Discrete, seed: int) -> Layout:
    """Return the layout of a run; each frame's place in the order comes from the seed and its own id."""
    order = sorted((frame.id for frame in frames), key=lambda one: (key_seed("stop early", seed, one), one))
    return Layout(tuple(order), asked, space)


@dataclass
class Course:
    """How far one model's evidence has come: ``counted`` calls as (frame, condition), claims, and what is settled."""

    layout: Layout
    frames: int = 0
    label: str | None = None
    lateral: str | None = None
    counted: list[tuple[str, str]] = field(default_factory=list)
    turns: dict[str, int] = field(init=False)
    claims: dict[str, Claim] = field(init=False)

    def __post_init__(self) -> None:
        conditions = {name for asked in self.layout.asked.values() for name in asked}
        directional = self.layout.space.directional
        self._turns_asked = bool(directional) and "mirrored" in conditions
        self.claims = claims(len(self.layout.order), self.layout.space, conditions, mirrored=self._turns_asked)
        self.turns = dict.fromkeys(directional, 0)
        self._judge()

    @property
    def settled(self) -> bool:
        """Return whether nothing more need be asked: the label is settled, and so is the lateral axis."""
        ended = self.frames == len(self.layout.order)
        lateral = self.lateral is not None or not self._turns_asked or ended
        return self.label is not None and self._scored and lateral

    @property
    def exhausted(self) -> bool:
        """Return whether all frames count and nothing is settled, so that the whole run has to decide."""
        return self.frames == len(self.layout.order) and not self.settled

    @property
    def _scored(self) -> bool:
        return self.label == "not_scorable" or self.claims["scorable"].settled

    def wanted(self, frame: str) -> tuple[str, ...]:
        """Return the conditions to ask of a frame that does not count yet, as far as the evidence has come."""
        asked = self.layout.asked[frame]
        if self.settled:
            return ()
        if self.label is None or self.exhausted:
            return asked
        still = set() if self._scored else {"real", "real_repeat"}
        if self._turns_asked and self.lateral is None and "mirrored" in asked:
            still |= {"real", "mirrored"}
        return tuple(name for name in asked if name in still)

    def advance(self, given: Mapping[tuple[str, str], Decision[str]]) -> None:
        """Count every next frame whose wanted calls are all ``given``, by (frame, condition), until it settles."""
        order = self.layout.order
        while self.frames < len(order) and not self.settled:
            frame = order[self.frames]
            wanted = self.wanted(frame)
            if any((frame, name) not in given for name in wanted):
                return
            self.counted += [(frame, name) for name in wanted]
            self._count(Row({name: given[frame, name] for name in wanted}, self.layout.space))

    def _count(self, row: Row) -> None:
        """Add the next frame to the claims that are still open; once there is a label, to those of its two checks."""
        both = {"real", "real_repeat"} <= row.given.keys()
        for name, claim in self.claims.items():
            if name in _SCORABLE:
                open_ = both
            elif name in _TURNS:
                open_ = self.lateral is None
            else:
                open_ = self.label is None
            if open_:
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
            self.label = next((label for label in RULES if self._all(label, RULES)), None)
        if self.lateral is None:
            self.lateral = next((label for label in LATERAL_RULES if self._all(label, LATERAL_RULES)), None)

    def _all(self, label: str, rules: Mapping[str, tuple[str, ...]]) -> bool:
        return all(name in self.claims and self.claims[name].settled for name in self._needed(rules[label]))

    def _needed(self, names: tuple[str, ...]) -> list[str]:
        """Return the claims that a label needs on this bank; the first always, others where they can be tested."""
        return [name for name in names if name in self.claims or name in REQUIRED or name == names[0]]

    def stopped(self, finished: int) -> Stopped | None:
        """Return where it was settled, None where it was not, or only when every call had been made.

        ``finished`` counts the model's finished calls of this run, also those beyond the stop.
        """
        if not self.settled or self.label is None or len(self.counted) == self.layout.planned:
            return None
        lateral, by = self.lateral, "mirror_swap_rate"
        if lateral is not None:
            by = PREFIX + LATERAL_RULES[lateral][0]
            seen = [count for count in self.turns.values() if count]
            if lateral != "swaps" and len(seen) == 1 and seen[0] >= ONE_SIDED_FROM:
                lateral = "one_sided"
        return Stopped(
            label=self.label,
            decided_by=PREFIX + RULES[self.label][0],
            lateral=lateral,
            lateral_by=by,
            frames=self.frames,
            calls=len(self.counted),
            planned=self.layout.planned,
            beyond=finished - len(self.counted),
            interventional="near_far" in self.claims,
            with_it=self._with_it(self.label),
        )

    def _with_it(self, label: str) -> tuple[str, ...]:
        names = self._needed(RULES[label])[1:] + ([] if label == "not_scorable" else ["scorable"])
        return tuple(PREFIX + name for name in names)

    def statistics(self) -> dict[str, Statistic]:
        """Return every claim's e-value under its name."""
        return {PREFIX + name: claim.statistic() for name, claim in self.claims.items()}
