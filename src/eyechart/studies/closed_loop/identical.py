"""Drives that are the same to the last digit are found and named: constants converge, a cache is suspect.

Source: paper, section Edge models are image-invariant (two models with numerically identical trajectories).
"""

import itertools
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from eyechart.episodes import Episode
from eyechart.errors import EyechartError
from eyechart.studies.closed_loop.reading import MODAL_CONSTANT, Driver, Drives
from eyechart.studies.closed_loop.repeated import IMPLAUSIBLE, seconds

CONVERGED = "constant policies converge"
ALIASED = "aliased commands"
NO_EFFECT = "other actions, same drive"
REPEATS = "repeats itself"
SCRIPTED = "decides as a scripted policy"
SUSPECT = "suspect caching"
COINCIDE = "decide alike here and there"
KINDS = (SUSPECT, ALIASED, CONVERGED, NO_EFFECT, REPEATS, SCRIPTED, COINCIDE)

MOSTLY = 0.5
"""From this share of the common worlds on identical varying decisions of two models are more than coincidence."""

VERBATIM = 0.9
"""A cache gives the text back; where fewer replies are word for word the same, two models found their own words."""


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
    if one.key.world != other.key.world or one.state_sha256 != other.state_sha256 or one.ended != other.ended:
        return False
    return _course(one) == _course(other)


def _course(episode: Episode) -> list[tuple[float | None, ...]]:
    return [(step.reward, step.speed_mps, step.distance_m, step.crashed) for step in episode.steps]


def commands_of(drives: Drives) -> Mapping[str, str]:
    """Return what the simulator declares its actions to be in its own commands; empty where it declares nothing.

    A simulator that is not installed here declares nothing: a run is scored anywhere.
    """
    try:
        declared = getattr(drives.open_simulator(), "commands", None)
    except EyechartError:
        return {}
    return dict(declared) if isinstance(declared, Mapping) else {}


def twins(drives: Sequence[Drives]) -> list[Twins]:
    """Return every group of drivers with identical drives: pairs of one kind, in the same worlds, are put together."""
    pairs: dict[str, dict[tuple[str, ...], list[tuple[Drives, Drives]]]] = {kind: {} for kind in KINDS}
    for one, other in itertools.combinations(drives, 2):
        if one.driver.simulator == other.driver.simulator and (worlds := _same_worlds(one, other)):
            pairs[_kind(one, other, worlds)].setdefault(tuple(worlds), []).append((one, other))
    found = []
    for kind, by_worlds in pairs.items():
        for same, many in by_worlds.items():
            groups = [list(pair) for pair in many] if kind in {SUSPECT, COINCIDE} else _joined(many)
            found += [_twins(kind, group, same) for group in groups]
    return found


def _same_worlds(one: Drives, other: Drives) -> list[str]:
    common = one.by_world.keys() & other.by_world.keys()
    return [world for world in sorted(common) if same_drive(one.by_world[world], other.by_world[world])]


def _kind(one: Drives, other: Drives, worlds: Sequence[str]) -> str:
    mine, theirs = (_executed(each, worlds) for each in (one, other))
    constant = all(_modal(each)[1] >= MODAL_CONSTANT for each in (mine, theirs))
    if mine != theirs:
        declared = commands_of(one)
        asked = [(declared.get(a, a), declared.get(b, b)) for a, b in zip(mine, theirs, strict=True)]
        return ALIASED if all(a == b for a, b in asked) else NO_EFFECT
    if constant:
        return CONVERGED
    if not (one.asked and other.asked):
        return SCRIPTED if one.driver.policy != other.driver.policy else REPEATS
    if one.driver.policy == other.driver.policy and not _faster(one, other):
        return REPEATS if one.driver.condition == other.driver.condition else COINCIDE
    common = len(one.by_world.keys() & other.by_world.keys())
    return SUSPECT if len(worlds) >= MOSTLY * common and _verbatim(one, other, worlds) else COINCIDE


def _verbatim(one: Drives, other: Drives, worlds: Sequence[str]) -> bool:
    """Return whether the replies about these worlds are the same to the word, as far as the ledgers know them."""
    mine, theirs = (_texts(each, set(worlds)) for each in (one, other))
    both = mine.keys() & theirs.keys()
    return sum(mine[frame] == theirs[frame] for frame in both) >= VERBATIM * len(both)


def _texts(drives: Drives, worlds: set[str]) -> dict[str, str]:
    """Return the text of each reply about some worlds, by its frame."""
    return {
        sent.key.frame: sent.reply.text
        for sent in drives.replies
        if sent.reply is not None and sent.key.frame.rpartition("/")[0] in worlds
    }


def _executed(drives: Drives, worlds: Sequence[str]) -> list[str]:
    return [action for world in worlds for action in drives.by_world[world].actions()]


def _modal(actions: Sequence[str]) -> tuple[str, float]:
    if not actions:
        return "", 1.0
    name, count = Counter(actions).most_common(1)[0]
    return name, count / len(actions)


def _faster(one: Drives, other: Drives) -> bool:
    """Return whether the one run's calls took implausibly less time than the other's."""
    first, second = (seconds(list(each.replies)) for each in (one, other))
    return bool(first and second) and min(first, second) < IMPLAUSIBLE * max(first, second)


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
        SUSPECT: _suspect,
        COINCIDE: _coincide,
    }[kind](group, same)
    return Twins(tuple(one.driver for one in group), len(common), len(same), kind, words)


def _converged(group: Sequence[Drives], same: Sequence[str]) -> str:
    action, _ = _modal(_executed(group[0], same))
    return (
        f"all of them take {action} and nothing else, which in a deterministic simulator gives one drive. That is a "
        "genuine convergence and no sign of a cache; nor could these drives show one."
    )


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


def _suspect(group: Sequence[Drives], same: Sequence[str]) -> str:
    one, other = group
    reasons = ["their decisions vary and yet are the same at every step"]
    if one.driver.condition != other.driver.condition:
        reasons.append(f"although the pictures differ ({one.driver.condition} and {other.driver.condition})")
    reasons += _told_by_replies(one, other, set(same))
    return (
        f"{', '.join(reasons)}. Two models that look for themselves hardly agree so; look for a cache that answers for "
        "both, or for one model behind two names, and drive again."
    )


def _told_by_replies(one: Drives, other: Drives, worlds: set[str]) -> list[str]:
    """Return what the ledgers add: how many replies are word for word the same, and what they took."""
    mine, theirs = (
        {sent.key.frame: sent for sent in each.replies if sent.key.frame.rpartition("/")[0] in worlds}
        for each in (one, other)
    )
    both = sorted(mine.keys() & theirs.keys())
    if not both:
        return []
    pairs = [(mine[frame].reply, theirs[frame].reply) for frame in both]
    verbatim = sum(a is not None and b is not None and a.text == b.text for a, b in pairs)
    other_picture = sum(mine[frame].request_sha256 != theirs[frame].request_sha256 for frame in both)
    said = [f"{verbatim} of {len(both)} replies are word for word the same"]
    if other_picture:
        said.append(f"{other_picture} of them to other requests")
    first, second = seconds(list(mine.values())), seconds(list(theirs.values()))
    if first and second and min(first, second) < IMPLAUSIBLE * max(first, second):
        said.append(f"and the median reply took {min(first, second):.3g} s against {max(first, second):.3g} s")
    return said
