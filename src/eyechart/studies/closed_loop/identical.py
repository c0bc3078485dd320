"""Drives that are the same to the last digit are found and named: constants converge, a cache is suspect.

The words and the pace of replies tell of a cache: to requests that one model got before, and of two models alike. A
reply that follows from its decision tells no more than the decision: two models that decide alike then write alike. The
identity of a call is its key, never its content (docs/decisions/calls.md): what answers by content cannot be measured.

Source: paper, section Edge models are image-invariant (two models with numerically identical trajectories).
"""

import itertools
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter, eq
from statistics import median

from eyechart.calls import Reply
from eyechart.episodes import Episode
from eyechart.records import Written, picked
from eyechart.simulators import declared_by
from eyechart.studies.closed_loop.reading import MODAL_CONSTANT, UNDECIDED, Driver, Drives, undecided_share

FEWEST_REPEATS = 5
"""So many requests that were made before must come again before their latency is looked at."""

IMPLAUSIBLE = 0.1
"""A repeated request that takes less than this share of what first requests take was hardly answered anew."""

SLOW_S = 0.1
"""A model that answers faster than this is quick by itself, and its times tell nothing of a cache."""


@dataclass(frozen=True)
class Repeats(Written):
    """What a driver's repeated requests tell: the same request again, its text and how long it took.

    ``ratio`` is the median seconds of repeats over that of first requests, None where they are not measured.
    """

    written = "driver=driver.label driver.simulator repeats same_text latency_ratio=ratio suspect words"

    driver: Driver
    repeats: int
    same_text: int
    ratio: float | None
    suspect: bool
    words: str


def repeated_requests(drives: Drives) -> Repeats | None:
    """Return what requests that a driver made before tell when they come again; None where fewer than five did.

    A request is the same where its text and picture are. Suspect: the first replies vary, every repeat has the text of
    the first, and repeats come in less than a tenth of the time.
    """
    first: dict[str, Reply] = {}
    again: list[tuple[Reply, Reply]] = []
    for _, reply, asked in drives.replies:
        if reply.error is None and asked and (before := first.setdefault(asked, reply)) is not reply:
            again.append((before, reply))
    if len(again) < FEWEST_REPEATS:
        return None
    same = sum(one.text == two.text for one, two in again)
    slow, fast = seconds(first.values()), seconds(two for _, two in again)
    ratio = fast / slow if slow and any(two.seconds is not None for _, two in again) else None
    varies = len({one.text for one in first.values()}) > 1
    suspect = varies and same == len(again) and ratio is not None and ratio < IMPLAUSIBLE and slow >= SLOW_S
    words = f"{len(again)} requests came again, {same} got the text of the first"
    if ratio is not None:
        words += f", in {ratio:.2g} of its time"
    if suspect:
        words += ": a cache answered them, so that neither noise nor repeats can be measured; switch it off"
    return Repeats(drives.driver, len(again), same, ratio, suspect, words)


def seconds(replies: Iterable[Reply]) -> float:
    """Return the median seconds of some replies, 0 where none was measured."""
    given = [one.seconds for one in replies if one.seconds is not None]
    return median(given) if given else 0.0


VERBATIM = 0.9
"""A cache gives the text back; where fewer replies are word for word the same, two models found their own words."""


@dataclass(frozen=True)
class Wording:
    """What the ledgers tell of two drivers' replies about the same moments; ``words`` says it.

    ``compared`` counts the moments of which both have a reply, ``same`` those with the same text. ``beyond`` counts
    the same texts that do not follow from the decision: another text stands more often with the same action.
    ``faster`` says whether the one took implausibly less time.
    """

    compared: int
    same: int
    beyond: int
    faster: bool
    words: str

    @property
    def verbatim(self) -> bool:
        """Return whether the replies are the same to the word; never where none can be compared."""
        return self.compared > 0 and self.same >= VERBATIM * self.compared

    @property
    def beyond_decisions(self) -> bool:
        """Return whether the same texts tell more than the same decisions do."""
        return self.beyond >= FEWEST_REPEATS


def wording(one: Drives, other: Drives, worlds: Sequence[str]) -> Wording:
    """Return what the replies of two drivers about some worlds tell, as far as the ledgers know them."""
    mine, theirs = (
        {frame: (reply, asked) for frame, reply, asked in each.replies if frame.rpartition("/")[0] in worlds}
        for each in (one, other)
    )
    both = sorted(mine.keys() & theirs.keys())
    same = [frame for frame in both if mine[frame][0].text == theirs[frame][0].text]
    took = [seconds(reply for reply, _ in each.values()) for each in (mine, theirs)]
    quick = max(took) >= SLOW_S and 0 < min(took) < IMPLAUSIBLE * max(took)
    other_picture = sum(mine[frame][1] != theirs[frame][1] for frame in both)
    said = [f"{len(same)} of {len(both)} replies are word for word the same"]
    if other_picture:
        said.append(f"{other_picture} of them to other requests")
    if quick:
        said.append(f"and the median reply took {min(took):.3g} s against {max(took):.3g} s")
    return Wording(
        len(both), len(same), _beyond(one, {frame: mine[frame][0].text for frame in same}), quick, ", ".join(said)
    )


def _beyond(drives: Drives, said: Mapping[str, str]) -> int:
    """Return how many replies have another text than the one that stands most often with their action."""
    decided = {step.frame: step.decision.action for step in drives.steps}
    texts: dict[str | None, Counter[str]] = {}
    for frame, text in said.items():
        plain = "".join(sign for sign in text.casefold() if sign.isalnum())
        texts.setdefault(decided.get(frame), Counter())[plain] += 1
    return sum(found.total() - max(found.values()) for found in texts.values())


CONVERGED = "constant policies converge"
ALIASED = "aliased commands"
NO_EFFECT = "other actions, same drive"
REPEATS = "repeats itself"
SCRIPTED = "decides as a scripted policy"
SUSPECT = "suspect caching"
NO_DECISION = "no decision: the fail-safe drove"
ALIKE = "decide alike throughout"
COINCIDE = "decide alike here and there"

MOSTLY = 0.5
"""From this share of the common worlds on identical varying decisions of two models are more than coincidence."""


@dataclass(frozen=True)
class Twins:
    """Drivers with identical drives in ``same`` of the ``worlds`` that all of them drove; ``words`` says why."""

    drivers: tuple[Driver, ...]
    worlds: int
    same: int
    kind: str
    words: str

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        return {
            "drivers": [one.label for one in self.drivers],
            "simulator": self.drivers[0].simulator,
            **picked(self, "worlds identical=same kind words"),
        }


def same_drive(one: Episode, other: Episode) -> bool:
    """Return whether two episodes of one world went the same way to the last digit, whatever was decided."""
    ends = [(each.key.world, each.state_sha256, each.ended, len(each.steps)) for each in (one, other)]
    course = attrgetter("reward", "speed_mps", "distance_m", "crashed")
    return ends[0] == ends[1] and all(map(eq, map(course, one.steps), map(course, other.steps)))


def commands_of(drives: Drives) -> Mapping[str, str]:
    """Return what the simulator declares its actions to be in its own commands; empty where it declares nothing."""
    declared = declared_by(drives.driver.simulator)
    return {} if declared is None else declared.commands


def twins(drives: Sequence[Drives]) -> list[Twins]:
    """Return every group of drivers with identical drives: pairs of one kind, in the same worlds, are put together."""
    pairs: dict[str, dict[tuple[str, ...], list[tuple[Drives, Drives]]]] = {kind: {} for kind in WHY}
    for one, other in itertools.combinations(drives, 2):
        common = sorted(one.by_world.keys() & other.by_world.keys())
        if worlds := [world for world in common if same_drive(one.by_world[world], other.by_world[world])]:
            pairs[_kind(one, other, worlds)].setdefault(tuple(worlds), []).append((one, other))
    found = []
    for kind, by_worlds in pairs.items():
        for same, many in by_worlds.items():
            groups = [list(pair) for pair in many] if kind in {SUSPECT, ALIKE, COINCIDE} else _joined(many)
            found += [_twins(kind, group, same) for group in groups]
    return found


def _kind(one: Drives, other: Drives, worlds: Sequence[str]) -> str:
    mine, theirs = (_executed(each, worlds) for each in (one, other))
    if max(_undecided(each, worlds) for each in (one, other)) >= UNDECIDED:
        return NO_DECISION
    constant = all(_modal(each)[1] >= MODAL_CONSTANT for each in (mine, theirs))
    if mine != theirs:
        declared = commands_of(one)
        asked = [(declared.get(a, a), declared.get(b, b)) for a, b in zip(mine, theirs, strict=True)]
        return ALIASED if all(a == b for a, b in asked) else NO_EFFECT
    if constant:
        return CONVERGED
    if not (one.asked and other.asked):
        return SCRIPTED if one.driver.policy != other.driver.policy else REPEATS
    return _kind_of_models(one, other, worlds)


def _kind_of_models(one: Drives, other: Drives, worlds: Sequence[str]) -> str:
    """Return the kind of two drives by models whose decisions vary and are the same in some worlds."""
    mostly = len(worlds) >= MOSTLY * len(one.by_world.keys() & other.by_world.keys())
    told = wording(one, other, worlds)
    if one.driver.policy == other.driver.policy:
        if mostly and told.verbatim and told.faster:
            return SUSPECT
        return REPEATS if one.driver.condition == other.driver.condition else COINCIDE
    if mostly and told.verbatim and (told.beyond_decisions or told.faster):
        return SUSPECT
    return ALIKE if mostly and (told.verbatim or not told.compared) else COINCIDE


def _executed(drives: Drives, worlds: Sequence[str]) -> list[str]:
    return [action for world in worlds for action in drives.by_world[world].actions()]


def _undecided(drives: Drives, worlds: Sequence[str]) -> float:
    return undecided_share([step for world in worlds for step in drives.by_world[world].steps])


def _modal(actions: Sequence[str]) -> tuple[str, float]:
    if not actions:
        return "", 1.0
    name, count = Counter(actions).most_common(1)[0]
    return name, count / len(actions)


def _joined(pairs: Sequence[tuple[Drives, Drives]]) -> list[list[Drives]]:
    """Return the groups that overlapping pairs form, in the order in which they were found."""
    groups: list[list[Drives]] = []
    for pair in pairs:
        touched = [group for group in groups if any(each in group for each in pair)]
        merged = [one for group in touched for one in group]
        merged += [one for one in pair if one not in merged]
        groups = [group for group in groups if group not in touched] + [merged]
    return groups


def _twins(kind: str, group: Sequence[Drives], same: Sequence[str]) -> Twins:
    common = set.intersection(*(set(one.by_world) for one in group))
    return Twins(tuple(one.driver for one in group), len(common), len(same), kind, WHY[kind](group, same))


def _converged(group: Sequence[Drives], same: Sequence[str]) -> str:
    action, share = _modal(_executed(group[0], same))
    often = "and nothing else" if share == 1 else f"at {MODAL_CONSTANT:.0%} of the steps at least"
    own = [
        f" At {part:.0%} of them {one.driver.label} decides nothing, and {action} is the fail-safe's."
        for one in group
        if (part := _undecided(one, same))
    ]
    return (
        f"all of them take {action} {often}, which in a deterministic simulator gives one drive. That is a "
        f"genuine convergence and no sign of a cache; nor could these drives show one.{''.join(own)}"
    )


def _no_decision(group: Sequence[Drives], same: Sequence[str]) -> str:
    shares = {one.driver.label: _undecided(one, same) for one in group}
    said = ", ".join(f"{name} at {share:.0%} of the steps" for name, share in shares.items() if share >= UNDECIDED)
    return f"there is no decision of {said}: the fail-safe drove there, and what it does is not the policy's."


def _aliased(group: Sequence[Drives], same: Sequence[str]) -> str:
    declared = commands_of(group[0])
    used = sorted({action for one in group for action in _executed(one, same)})
    commands: dict[str, list[str]] = {}
    for action in used:
        commands.setdefault(declared.get(action, action), []).append(action)
    said = "; ".join(f"{' and '.join(names)} both are {name}" for name, names in commands.items() if len(names) > 1)
    return f"the simulator declares that {said}: one command by other words; drives and rows are identical."


def _no_effect(group: Sequence[Drives], same: Sequence[str]) -> str:
    taken = ", ".join(f"{one.driver.label}: {_modal(_executed(one, same))[0]}" for one in group)
    return (
        f"they took other actions (most often {taken}) and got the same drive; the simulator declares no alias, so "
        "that the actions that differ have no effect here."
    )


def _repeats(group: Sequence[Drives], same: Sequence[str]) -> str:
    del same
    if not any(one.asked for one in group):
        return "a policy that asks no model decides the same again, as it should."
    return (
        "the same model decides the same again. Of a model that does not sample that is expected; of one that does it "
        "would show a cache."
    )


def _scripted(group: Sequence[Drives], same: Sequence[str]) -> str:
    del same
    scripted = [one.driver.label for one in group if not one.asked]
    if len(scripted) == len(group):
        return "none of them asks a model: in these worlds their rules come to the same."
    return f"the decisions are those of {' and '.join(scripted)}, without a model: one rule, no cache."


def _coincide(group: Sequence[Drives], same: Sequence[str]) -> str:
    if len({one.driver.policy for one in group}) == 1:
        shown = " and ".join(one.driver.condition for one in group)
        return (
            f"the same model decides alike with {shown} pictures in {len(same)} worlds: what differs between them does "
            "not matter to it there. Nothing in its replies points to a cache."
        )
    return f"they decide alike in {len(same)} worlds, too few or in too different words for a cache."


def _alike(group: Sequence[Drives], same: Sequence[str]) -> str:
    told = wording(group[0], group[1], same)
    why = "no reply of both is at hand to be compared"
    if told.compared:
        why = f"{told.words}, but nearly each follows from its decision and tells no more"
    return (
        f"their decisions vary and are the same at every step; {why}. Two like rules, one model behind two names and a "
        "cache all look so. Ask for reasons in the reply to tell them apart."
    )


def _suspect(group: Sequence[Drives], same: Sequence[str]) -> str:
    one, other = group
    reasons = ["their decisions vary and yet are the same at every step"]
    if one.driver.condition != other.driver.condition:
        reasons.append(f"although the pictures differ ({one.driver.condition} and {other.driver.condition})")
    reasons.append(wording(one, other, same).words)
    said = ", ".join(reasons)
    if one.driver.policy == other.driver.policy:
        return (
            f"{said}. One model that is asked anew hardly answers so much faster; look for a cache, or for another "
            "machine behind the same name, and drive again."
        )
    return (
        f"{said}. Two models that look for themselves hardly agree so; look for a cache that answers for both, or for "
        "one model behind two names, and drive again."
    )


WHY: Mapping[str, Callable[[Sequence[Drives], Sequence[str]], str]] = {
    SUSPECT: _suspect,
    ALIKE: _alike,
    ALIASED: _aliased,
    CONVERGED: _converged,
    NO_DECISION: _no_decision,
    NO_EFFECT: _no_effect,
    REPEATS: _repeats,
    SCRIPTED: _scripted,
    COINCIDE: _coincide,
}
"""The kinds in the order in which they are told, each with what says why."""
