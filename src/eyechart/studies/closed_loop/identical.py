"""Drives that are the same to the last digit are found and named: constants converge, a cache is suspect.

Source: paper, section Edge models are image-invariant (two models with numerically identical trajectories).
"""

import itertools
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter, eq

from eyechart.episodes import Episode
from eyechart.simulators import declared_by
from eyechart.studies.closed_loop.reading import MODAL_CONSTANT, UNDECIDED, Driver, Drives, undecided_share
from eyechart.studies.closed_loop.wording import wording

CONVERGED = "constant policies converge"
ALIASED = "aliased commands"
NO_EFFECT = "other actions, same drive"
REPEATS = "repeats itself"
SCRIPTED = "decides as a scripted policy"
SUSPECT = "suspect caching"
NO_DECISION = "no decision: the fail-safe drove"
ALIKE = "decide alike throughout"
COINCIDE = "decide alike here and there"
KINDS = (SUSPECT, ALIKE, ALIASED, CONVERGED, NO_DECISION, NO_EFFECT, REPEATS, SCRIPTED, COINCIDE)

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
            "worlds": self.worlds,
            "identical": self.same,
            "kind": self.kind,
            "words": self.words,
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
    pairs: dict[str, dict[tuple[str, ...], list[tuple[Drives, Drives]]]] = {kind: {} for kind in KINDS}
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
    words = {
        CONVERGED: _converged,
        ALIASED: _aliased,
        NO_EFFECT: _no_effect,
        REPEATS: _repeats,
        SCRIPTED: _scripted,
        NO_DECISION: _no_decision,
        SUSPECT: _suspect,
        ALIKE: _alike,
        COINCIDE: _coincide,
    }[kind](group, same)
    return Twins(tuple(one.driver for one in group), len(common), len(same), kind, words)


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
