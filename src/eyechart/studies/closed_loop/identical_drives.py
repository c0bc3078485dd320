"""Finds and explains drives that are identical to the last digit: constant policies, or a cache.

The words and the times of replies can show a cache: for repeated requests of one model, and for two
models with equal replies. A reply that follows from its decision shows no more than the decision,
because two models that decide equally then write equally. The identity of a call is its key, never
its content (docs/decisions/calls.md): what answers by content cannot be measured.

Source: paper, section Edge models are image-invariant (two models with numerically identical
trajectories).
"""

import itertools
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter, eq
from statistics import median

from eyechart.calls import Reply
from eyechart.episodes import Episode
from eyechart.records import to_json_fields
from eyechart.simulators import declared_by
from eyechart.studies.closed_loop.drives import MODAL_CONSTANT, UNDECIDED, Driver, Drives, undecided_share

FEWEST_REPEATS = 5
"""The fewest repeated requests whose latency is compared."""

IMPLAUSIBLE = 0.1
"""A repeat faster than this share of a first request was hardly answered anew."""

SLOW_S = 0.1
"""A model that answers faster than this has times that cannot show a cache."""


@dataclass(frozen=True)
class RepeatedRequests:
    """A driver's repeated requests: how many, with which text, and how fast.

    ``ratio`` is the median seconds of repeats over that of first requests, None where not measured.
    """

    driver: Driver
    repeats: int
    same_text: int
    ratio: float | None
    suspect: bool
    words: str

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        of = {"driver": self.driver.label, "simulator": self.driver.simulator}
        return of | to_json_fields(self, "repeats same_text suspect words", latency_ratio=self.ratio)


def repeated_requests(drives: Drives) -> RepeatedRequests | None:
    """Return a driver's repeated requests; None where there are fewer than five.

    A request is the same where its text and picture are. Suspect: the first replies vary, every
    repeat has the text of the first, and repeats take less than a tenth of the time.
    """
    first: dict[str, Reply] = {}
    again: list[tuple[Reply, Reply]] = []
    for _, reply, request in drives.replies:
        if reply.error is None and request and (before := first.setdefault(request, reply)) is not reply:
            again.append((before, reply))
    if len(again) < FEWEST_REPEATS:
        return None
    same = sum(one.text == two.text for one, two in again)
    slow, fast = seconds(first.values()), seconds(two for _, two in again)
    ratio = fast / slow if slow and any(two.seconds is not None for _, two in again) else None
    varies = len({one.text for one in first.values()}) > 1
    suspect = varies and same == len(again) and ratio is not None and ratio < IMPLAUSIBLE and slow >= SLOW_S
    words = f"{len(again)} requests were repeated, {same} got the text of the first"
    if ratio is not None:
        words += f", in {ratio:.2g} of its time"
    if suspect:
        words += ": a cache answered them, so neither noise nor repeats can be measured; switch it off"
    return RepeatedRequests(drives.driver, len(again), same, ratio, suspect, words)


def seconds(replies: Iterable[Reply]) -> float:
    """Return the median seconds of some replies, 0 where none was measured."""
    given = [reply.seconds for reply in replies if reply.seconds is not None]
    return median(given) if given else 0.0


VERBATIM = 0.9
"""A cache returns the text; below this share of identical replies, two models wrote their own."""


@dataclass(frozen=True)
class ReplyComparison:
    """A comparison of two drivers' replies about the same frames; ``words`` describes it.

    ``compared`` counts the frames with a reply of both, ``same`` those with the same text.
    ``beyond`` counts the same texts that do not follow from the decision: another text is more
    frequent with the same action. ``faster`` says whether one of them took implausibly little time.
    """

    compared: int
    same: int
    beyond: int
    faster: bool
    words: str

    @property
    def is_verbatim(self) -> bool:
        """Return whether the replies are the same to the word; False where none can be compared."""
        return self.compared > 0 and self.same >= VERBATIM * self.compared

    @property
    def is_beyond_decisions(self) -> bool:
        """Return whether the same texts show more than the same decisions do."""
        return self.beyond >= FEWEST_REPEATS


def wording(one: Drives, other: Drives, worlds: Sequence[str]) -> ReplyComparison:
    """Return the comparison of two drivers' replies in some worlds, from their ledgers."""
    mine, theirs = (
        {frame: (reply, request) for frame, reply, request in each.replies if frame.rpartition("/")[0] in worlds}
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
    return ReplyComparison(
        len(both), len(same), _beyond(one, {frame: mine[frame][0].text for frame in same}), quick, ", ".join(said)
    )


def _beyond(drives: Drives, said: Mapping[str, str]) -> int:
    """Return how many replies differ from the most frequent text of their action."""
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
"""From this share of the common worlds on, two models with equal decisions are no coincidence."""


@dataclass(frozen=True)
class IdenticalEpisodes:
    """Drivers with identical drives in ``same`` of their common ``worlds``; ``words`` says why."""

    drivers: tuple[Driver, ...]
    worlds: int
    same: int
    kind: str
    words: str

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        return {
            "drivers": [driver.label for driver in self.drivers],
            "simulator": self.drivers[0].simulator,
            **to_json_fields(self, "worlds kind words", identical=self.same),
        }


def is_same_drive(episode: Episode, other: Episode) -> bool:
    """Return whether two episodes of one world went the same way to the last digit.

    The decisions may differ.
    """
    ends = [(each.key.world, each.state_sha256, each.ended, len(each.steps)) for each in (episode, other)]
    course = attrgetter("reward", "speed_mps", "distance_m", "crashed")
    return ends[0] == ends[1] and all(map(eq, map(course, episode.steps), map(course, other.steps)))


def commands_of(drives: Drives) -> Mapping[str, str]:
    """Return the simulator's own command for each action; empty where it declares none."""
    declared = declared_by(drives.driver.simulator)
    return {} if declared is None else declared.commands


def identical_groups(drives: Sequence[Drives]) -> list[IdenticalEpisodes]:
    """Return every group of drivers with identical drives; pairs of one kind are joined."""
    pairs: dict[str, dict[tuple[str, ...], list[tuple[Drives, Drives]]]] = {kind: {} for kind in WHY}
    for one, other in itertools.combinations(drives, 2):
        common = sorted(one.by_world.keys() & other.by_world.keys())
        if worlds := [world for world in common if is_same_drive(one.by_world[world], other.by_world[world])]:
            pairs[_kind(one, other, worlds)].setdefault(tuple(worlds), []).append((one, other))
    result = []
    for kind, by_worlds in pairs.items():
        for same, many in by_worlds.items():
            groups = [list(pair) for pair in many] if kind in {SUSPECT, ALIKE, COINCIDE} else _joined(many)
            result += [_twins(kind, group, same) for group in groups]
    return result


def _kind(one: Drives, other: Drives, worlds: Sequence[str]) -> str:
    mine, theirs = (_executed(each, worlds) for each in (one, other))
    if max(_undecided(each, worlds) for each in (one, other)) >= UNDECIDED:
        return NO_DECISION
    constant = all(_modal(each)[1] >= MODAL_CONSTANT for each in (mine, theirs))
    if mine != theirs:
        declared = commands_of(one)
        actions = [(declared.get(a, a), declared.get(b, b)) for a, b in zip(mine, theirs, strict=True)]
        return ALIASED if all(a == b for a, b in actions) else NO_EFFECT
    if constant:
        return CONVERGED
    if not (one.is_model and other.is_model):
        return SCRIPTED if one.driver.policy != other.driver.policy else REPEATS
    return _kind_of_models(one, other, worlds)


def _kind_of_models(one: Drives, other: Drives, worlds: Sequence[str]) -> str:
    """Return the kind of two models' drives whose decisions vary but are equal in some worlds."""
    mostly = len(worlds) >= MOSTLY * len(one.by_world.keys() & other.by_world.keys())
    comparison = wording(one, other, worlds)
    if one.driver.policy == other.driver.policy:
        if mostly and comparison.is_verbatim and comparison.faster:
            return SUSPECT
        return REPEATS if one.driver.condition == other.driver.condition else COINCIDE
    if mostly and comparison.is_verbatim and (comparison.is_beyond_decisions or comparison.faster):
        return SUSPECT
    return ALIKE if mostly and (comparison.is_verbatim or not comparison.compared) else COINCIDE


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
    """Return the groups that overlapping pairs form, in the order of the pairs."""
    groups: list[list[Drives]] = []
    for pair in pairs:
        touched = [group for group in groups if any(each in group for each in pair)]
        merged = [one for group in touched for one in group]
        merged += [one for one in pair if one not in merged]
        groups = [group for group in groups if group not in touched] + [merged]
    return groups


def _twins(kind: str, group: Sequence[Drives], same: Sequence[str]) -> IdenticalEpisodes:
    common = set.intersection(*(set(one.by_world) for one in group))
    return IdenticalEpisodes(tuple(one.driver for one in group), len(common), len(same), kind, WHY[kind](group, same))


def _converged(group: Sequence[Drives], same: Sequence[str]) -> str:
    action, share = _modal(_executed(group[0], same))
    often = "and nothing else" if share == 1 else f"at {MODAL_CONSTANT:.0%} of the steps at least"
    own = [
        f" At {part:.0%} of them {one.driver.label} decides nothing, and {action} comes from the fail-safe."
        for one in group
        if (part := _undecided(one, same))
    ]
    return (
        f"all of them take {action} {often}, which in a deterministic simulator gives one drive. That is a "
        f"genuine convergence and no sign of a cache; these drives could not show a cache.{''.join(own)}"
    )


def _no_decision(group: Sequence[Drives], same: Sequence[str]) -> str:
    shares = {one.driver.label: _undecided(one, same) for one in group}
    said = ", ".join(f"{name} at {share:.0%} of the steps" for name, share in shares.items() if share >= UNDECIDED)
    return f"there is no decision of {said}: the fail-safe drove there, so its actions are not the policy's."


def _aliased(group: Sequence[Drives], same: Sequence[str]) -> str:
    declared = commands_of(group[0])
    used = sorted({action for one in group for action in _executed(one, same)})
    commands: dict[str, list[str]] = {}
    for action in used:
        commands.setdefault(declared.get(action, action), []).append(action)
    said = "; ".join(f"{' and '.join(names)} both are {name}" for name, names in commands.items() if len(names) > 1)
    return f"the simulator declares that {said}: one command with several names; drives and rows are identical."


def _no_effect(group: Sequence[Drives], same: Sequence[str]) -> str:
    taken = ", ".join(f"{one.driver.label}: {_modal(_executed(one, same))[0]}" for one in group)
    return (
        f"they took other actions (most often {taken}) and got the same drive. The simulator declares no alias, so "
        "the actions that differ have no effect here."
    )


def _repeats(group: Sequence[Drives], same: Sequence[str]) -> str:
    del same
    if not any(one.is_model for one in group):
        return "a policy that calls no model makes the same decisions again, as it should."
    return (
        "the same model makes the same decisions again. Without sampling that is expected; with sampling it would "
        "show a cache."
    )


def _scripted(group: Sequence[Drives], same: Sequence[str]) -> str:
    del same
    scripted = [one.driver.label for one in group if not one.is_model]
    if len(scripted) == len(group):
        return "none of them calls a model: in these worlds their rules give the same actions."
    return f"the decisions are those of {' and '.join(scripted)}, which calls no model: one rule, no cache."


def _coincide(group: Sequence[Drives], same: Sequence[str]) -> str:
    if len({one.driver.policy for one in group}) == 1:
        shown = " and ".join(one.driver.condition for one in group)
        return (
            f"the same model makes the same decisions with {shown} pictures in {len(same)} worlds: their difference "
            "does not matter to it there. Nothing in its replies points to a cache."
        )
    return f"they decide equally in {len(same)} worlds: too few worlds, or too different words, for a cache."


def _alike(group: Sequence[Drives], same: Sequence[str]) -> str:
    comparison = wording(group[0], group[1], same)
    why = "no replies of both can be compared"
    if comparison.compared:
        why = f"{comparison.words}, but nearly each follows from its decision and shows no more"
    return (
        f"their decisions vary and are the same at every step; {why}. Equal rules, one model behind two names, and a "
        "cache would all look like this. A prompt that demands reasons in the reply tells them apart."
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
            f"{said}. A model that answers anew is hardly so much faster. Look for a cache, or for another "
            "machine behind the same name, and drive again."
        )
    return (
        f"{said}. Two models that look for themselves hardly agree so closely. Look for a cache that answers for "
        "both, or for one model behind two names, and drive again."
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
"""The kinds in order of output, each with the function that explains it."""
