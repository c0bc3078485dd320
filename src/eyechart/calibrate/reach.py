"""The labels that a bank can give: frames with a match at a similar state, and what is missing."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from eyechart.calibrate import policies
from eyechart.channels import CAMERA, CAMERAS, INSTRUCTION, MOVES, STATE, channels_of, own_pictures, partners
from eyechart.conditions import EXCHANGED, OVER, by_reason, is_available
from eyechart.conditions.policies import conditions_of, subset_conditions
from eyechart.frames import FrameBank
from eyechart.importing.log_warnings import notes
from eyechart.report.table import Table, of_lines
from eyechart.stats.partners import NOBODY
from eyechart.stats.risk_bounds import share_bound
from eyechart.verdicts.policy_rules import OF_DATA_SET, SURENESS
from eyechart.verdicts.policy_verdict import AXES
from eyechart.verdicts.share_predicates import LEAST_EPISODES

LEAST_GROUNDED = 7
"""The fewest episodes with which a test of a moved object can reach .01."""
BY_MATCH = ("object_grounded", "camera_content", "pose_only")
"""The camera labels that need pictures at a similar state."""


@dataclass(frozen=True)
class PolicyReach:
    """What a bank can decide about a policy, with which power and how many calls.

    ``matches``, ``never`` and ``unmoved`` are those of `matches`, `unreachable` and `unmoved`.
    ``shapley`` counts the further calls of ``--shapley``.
    """

    bank: FrameBank
    power: policies.PolicyPower
    conditions: int
    shapley: int
    matches: Mapping[str, int]
    never: Mapping[str, str]
    unmoved: list[str]

    @classmethod
    def of(cls, bank: FrameBank) -> "PolicyReach":
        """Return the reach of a bank that defines a motion."""
        conditions, left_out = conditions_of(bank)
        further = dict.fromkeys(name for name in subset_conditions(bank).values() if name not in conditions)
        calls, more = (
            sum(is_available(one, frame, bank) for one in many for frame in bank) for many in (conditions, further)
        )
        episodes = len({frame.drive for frame in bank})
        power = policies.power(episodes, len(bank), calls, left_out, matched=matched_of(bank))
        return cls(bank, power, len(conditions), more, matches(bank), unreachable(bank), unmoved(bank))

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        labels = {"matches": self.matches, "reachable": list(reachable(self.bank)), "unreachable": self.never}
        return {**self.power.as_dict(), **labels, "unmoved": self.unmoved, "notes": notes(self.bank)}

    def details(self) -> Table:
        """Return the basis of the power, a row each."""
        bank, one = self.bank, self.power
        some = ", not each of every frame" if one.calls < self.conditions * len(bank) else ""
        unasked = {name: why for name, why in one.left_out.items() if "frame" in why}
        alike = ", ".join(f"{channel} {count}" for channel, count in self.matches.items())
        bound = (share_bound(0, one.episodes, confidence=SURENESS).ci or (0.0, 1.0))[1]
        most = f"if none of {one.episodes} responds, up to {bound:.1%} may"
        whole = "the data set" if bound < OF_DATA_SET else "these episodes, not of the data set"
        lines = [
            f"channels: {', '.join(channels_of(bank))}",
            f"calls: {one.calls} ({self.conditions} conditions{some}); about four times that if answers are sampled",
            f"frames with a match at a similar state: of {len(bank)}: {alike}",
            f"labels that a policy may get: {', '.join(reachable(bank)) or 'none'}",
            *(f"not reachable: {labels}: {why}" for labels, why in by_reason(self.never).items()),
            *(f"counts as content: {it} of the state, which never changes within an episode" for it in self.unmoved),
            *(f"not asked: {names}: {why}" for names, why in by_reason(unasked).items()),
            *(f"note: {words}" for words in notes(bank)),
            *([f"--shapley: {self.shapley} more calls"] if self.shapley else []),
            f"absence (ignores_camera …): claimed for {whole}: {most}",
        ]
        return of_lines("details", "Basis of the power", lines)


def matches(bank: FrameBank) -> dict[str, int]:
    """Return the number of frames with a match at a similar state, for all cameras and for each."""
    cameras = [name for name in channels_of(bank) if name not in {STATE, INSTRUCTION}]
    if not bank.manifest.state:
        return dict.fromkeys(cameras, 0)
    images = bank.manifest.images
    return {
        name: int((partners(bank.frames, "matched", name, images, bank.manifest.motion) != NOBODY).sum())
        for name in cameras
    }


def matched_of(bank: FrameBank) -> tuple[int, int]:
    """Return the number of frames with a match of all cameras, and of their episodes."""
    if f"matched@{CAMERAS}" not in conditions_of(bank)[0]:
        return 0, 0
    there = partners(bank.frames, "matched", CAMERAS, bank.manifest.images, bank.manifest.motion) != NOBODY
    episodes = [frame.drive for frame, matched in zip(bank, there, strict=True) if matched]
    return len(episodes), len(set(episodes))


def unreachable(bank: FrameBank) -> dict[str, str]:
    """Return why no policy can get a label on a bank; of a camera, "LABEL of camera:NAME"."""
    result: dict[str, str] = {}
    for label, why in (*_of_episodes(bank), *_of_cameras(bank), *_of_the_rest(bank)):
        result.setdefault(label, why)
    return result


def reachable(bank: FrameBank) -> tuple[str, ...]:
    """Return the labels that a policy may get on a bank."""
    never = unreachable(bank)
    return tuple(label for axis in AXES for label in _said_on(axis) if label not in never)


def _said_on(axis: str) -> list[str]:
    """Return the conclusive labels of an axis."""
    return [name for name, one in AXES[axis].items() if not one.is_open]


def _of_episodes(bank: FrameBank) -> Iterator[tuple[str, str]]:
    count = len({frame.drive for frame in bank})
    if count < LEAST_EPISODES:
        why = f"{count} episodes bound nothing; at least {LEAST_EPISODES} are needed"
        yield from ((label, why) for axis in AXES for label in _said_on(axis))
    if count < LEAST_GROUNDED:
        yield "object_grounded", f"below {LEAST_GROUNDED} episodes the test has no power"


def _of_cameras(bank: FrameBank) -> Iterator[tuple[str, str]]:
    left_out = conditions_of(bank)[1]
    for channel in matches(bank):
        of = "" if channel == CAMERAS else f" of {channel}"
        labels = [one for one in _said_on("camera") if not (of and one == "object_grounded")]
        if why := left_out.get(f"swapped@{channel}", ""):
            yield from ((f"{label}{of}", why) for label in labels)
        elif why := left_out.get(f"matched@{channel}", ""):
            yield from ((f"{label}{of}", why) for label in labels if label in BY_MATCH)
        elif why := _its_pose(bank, channel):
            yield f"camera_content{of}", f"{why}, and a policy that reads its own pose responds to the matched ones too"
    if any(why := left_out.get(name, "") for name in MOVES):
        yield "object_grounded", f"the bank moves no object: {why}"


def unmoved(bank: FrameBank) -> list[str]:
    """Return the numbers of the state that never change within an episode but may be visible.

    They count as content, because no picture of the same episode shows other values. Empty if a
    world changes pictures while the state stays.
    """
    return [] if _keeps_state(bank, CAMERAS) or _its_pose(bank, CAMERAS) else own_pictures(bank, CAMERAS)[1]


def _keeps_state(bank: FrameBank, channel: str) -> bool:
    """Return whether a world moves objects or exchanges their colours in a channel's pictures."""
    over = "" if channel == CAMERAS else f"{OVER}{channel.removeprefix(CAMERA)}"
    able = conditions_of(bank)[0]
    return f"{EXCHANGED}{over}" in able or (channel == CAMERAS and set(MOVES) <= {*able})


def _its_pose(bank: FrameBank, channel: str) -> str:
    """Return why no picture of a channel can be separated from its pose; empty if one can."""
    if _keeps_state(bank, channel):
        return ""
    return conditions_of(bank)[1].get(f"near{OVER}{channel}", "") or own_pictures(bank, channel)[0]


def _of_the_rest(bank: FrameBank) -> Iterator[tuple[str, str]]:
    left_out = conditions_of(bank)[1]
    for channel in (STATE, INSTRUCTION):
        absent = "" if channel in channels_of(bank) else f"the bank has no {channel}"
        if why := absent or left_out.get(f"swapped@{channel}", ""):
            yield from ((label, why) for label in _said_on(channel))
