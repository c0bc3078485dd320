"""Labels of a policy have an order: who uses less of a channel never gets one that says that it uses more."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from random import Random

import pytest

from eyechart.stats.shares import FollowedShare, Share
from eyechart.stats.statistic import Statistic
from eyechart.verdicts.labels import CAMERA, USES
from eyechart.verdicts.policy_rules import of_camera
from eyechart.verdicts.policy_verdict import AXES, judge_policy
from eyechart.verdicts.share_predicates import MissingConditions
from policies_by_hand import FOLLOWED, NOT_ONE_BIT, OPEN, USED, share, verdict
from policy_evidences import CHANNELS, asked_of, evidence
from test_policy_rules import made

FACTORS = (1.0, 0.9, 0.7, 0.5, 0.3, 0.1, 0.03, 0.0)
"""How much of an effect is left, from all of it to not one bit."""


def _alone(*names: str) -> list[tuple[str, ...]]:
    return [(name,) for name in names]


def _of_cameras(channel: str) -> tuple[str, ...]:
    """Return the statistics of what pictures of a channel do; those of the own episode are a control."""
    over = "" if channel == "cameras" else f"@{channel.partition(':')[2]}"
    shares = (f"T.swapped@{channel}", f"T.matched@{channel}", f"T.blank{over}", f"T.exchanged{over}")
    claims = (f"{claim}@{channel}" for claim in ("responds", "responds.shown", "responds.alike"))
    return (*shares, f"beyond@{channel}", f"swapped.alike@{channel}", *claims)


FOLLOWING = ("follow.named", "follow.told", "follow.rather")
EFFECTS: Mapping[str, Sequence[Sequence[str]]] = {
    "camera": [*_alone(*_of_cameras("cameras"), "T.recoloured", "T.decoys", "follow.told", "follow.rather"), FOLLOWING],
    "camera:wrist": _alone(*_of_cameras("camera:wrist")),
    "state": _alone("T.swapped@state", "reads@state", "responds@state"),
    "instruction": _alone("T.swapped@instruction", "follow.told", "follow.logged", "responds@instruction"),
}
"""What a channel does, by axis. The other statistics are controls, which only take a claim away, or another channel's.

What is followed because it is named is a part of what is followed: who follows an object less far follows it less
because it is named too, so that these grow weaker together. What is followed for another reason is a control.
"""


def weaker(one: Statistic, left: float) -> Statistic:
    """Return a statistic of an effect of which so much is left; one that goes the other way is no weaker use."""

    def less(number: float | None) -> float | None:
        return number * left if number is not None and number > 0 else number

    ci = None if one.ci is None else (less(one.ci[0]), less(one.ci[1]))
    result = replace(one, value=less(one.value), ci=ci)
    if not isinstance(result, Share):
        return result
    carried = {name: size * left for name, size in (result.carried or {}).items() if size * left >= 0.1}
    result = replace(result, scatter=less(result.scatter), carried=carried or None)
    if isinstance(result, FollowedShare) and result.parts:
        parts = {
            name: {**part, "value": part["value"] * left, "at_most": part["at_most"] * left}
            for name, part in result.parts.items()
        }
        result = replace(result, parts=parts)
    return replace(result, same=1.0, p=None if result.p is None else 1.0) if left == 0 else result


def on_the_way_down(
    statistics: Mapping[str, Statistic], effects: Sequence[str], axis: str, asked: MissingConditions
) -> Iterator[str]:
    """Yield the labels on an axis as some effects grow weaker, all else being as it is."""
    for left in FACTORS:
        changed = {name: weaker(statistics[name], left) for name in effects}
        yield judge_policy("m", {**statistics, **changed}, CHANNELS, scope="here.", left_out=asked).axes[axis].label


def risen(labels: Sequence[str]) -> str:
    """Return how labels rise on the way down, nothing where they do not.

    One that says nothing may come in between, where an interval is neither above one margin nor below the other; but
    not after all use was denied.
    """
    least: str | None = None
    for label in labels:
        if least is not None and USES[least].is_absence and not USES[label].is_absence:
            return f"{least}, then {label}"
        rank, before = USES[label].rank, None if least is None else USES[least].rank
        if rank is not None:
            if before is not None and rank > before:
                return f"{least}, then {label}"
            least = label
    return ""


@pytest.mark.parametrize("axis", EFFECTS)
def test_a_weaker_effect_gives_no_stronger_label(axis: str) -> None:
    """One effect at a time, and all of a channel by as much, of random evidences."""
    for seed in range(60):
        rng, asked = Random(f"{axis} {seed}"), asked_of(Random(f"asked {seed}"))  # noqa: S311 - no secret
        statistics = evidence(rng, {"camera:wrist": "single"}.get(axis, axis), made)
        known = {name for name, statistic in statistics.items() if statistic.value is not None}
        there = [names for some in EFFECTS[axis] if (names := [name for name in some if name in known])]
        every = dict.fromkeys(name for some in there for name in some)
        for effects in (rng.choice(there), rng.choice(there), [*every]) if there else ():
            labels = list(on_the_way_down(statistics, effects, axis, asked))
            assert not risen(labels), f"{axis} {seed}, {', '.join(effects)}: {', '.join(labels)}"


def test_the_labels_of_an_axis_have_an_order() -> None:
    """The strongest first, one that says nothing used last of those that say something."""
    for labels in AXES.values():
        found = [label.rank for label in labels.values() if label.rank is not None]
        assert found == sorted(found, reverse=True)
        assert found[-1] == 0
        assert [label.is_open for label in labels.values()] == [name in {"undecided", "no_power"} for name in labels]
    ranks = [one.rank for name, one in CAMERA.items() if name != "uses_camera"]
    assert len(set(ranks)) == len(ranks)
    assert CAMERA["uses_camera"].rank == CAMERA["pose_only"].rank  # the least that it claims is a use for the pose


NOTHING = {"swap": NOT_ONE_BIT, "matched": NOT_ONE_BIT, "blank": NOT_ONE_BIT, "follow": None, "named": None}


@pytest.mark.parametrize(
    ("axis", "changed", "label"),
    [
        ("camera", NOTHING, "ignores_camera"),
        ("state", {"state": NOT_ONE_BIT}, "ignores_state"),
        ("state", {**NOTHING, "state": USED}, "state_shortcut"),
        ("instruction", {"told": NOT_ONE_BIT, "named": None, "follow": None}, "instruction_ignored"),
    ],
)
def test_who_uses_nothing_is_told_so_as_is_who_uses_a_little(
    axis: str, changed: Mapping[str, Statistic | None], label: str
) -> None:
    """Not one bit is less than next to nothing; that the channel may not be connected is said beside it."""
    found = verdict(**changed)
    assert getattr(found, axis).label == label
    if label != "state_shortcut":
        assert "not one bit of 72 answers: it may not be connected" in getattr(found, axis).because
        assert getattr(found, axis).may_be_unconnected


def test_an_axis_that_is_open_for_another_reason_says_first_that_nothing_arrives() -> None:
    """Whether a picture must be there is not known without grey ones; that none changes a bit is said before."""
    found = verdict(**{**NOTHING, "blank": None}).camera
    assert found.label == "undecided"
    assert found.because.startswith("Another picture changes not one bit of 72 answers: it may not be connected")
    assert "whether a picture must be there is open" in found.because


def test_pictures_that_are_open_stay_open() -> None:
    """What changes a bit is not said to be unconnected."""
    found = verdict(swap=OPEN).camera
    assert (found.label, found.may_be_unconnected) == ("undecided", False)
    assert of_camera({}, "cameras", "its cameras").label == "undecided"
    assert verdict(follow=FOLLOWED, swap=share(0.5, 0.9)).camera.label == "object_grounded"
