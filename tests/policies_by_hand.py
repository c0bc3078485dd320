"""Statistics of policies, written down by hand, and the verdicts on them."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

from eyechart.stats.shares import FollowedShare, LogDistance, Share
from eyechart.stats.statistic import Statistic
from eyechart.verdicts.policy_verdict import PolicyVerdict, judge_policy
from eyechart.verdicts.share_predicates import MissingConditions, is_ignored, is_used

CHANNELS = ("cameras", "camera:top", "camera:wrist", "state", "instruction")
NAMES = {
    "swap": "T.swapped@cameras",
    "matched": "T.matched@cameras",
    "blank": "T.blank",
    "state": "T.swapped@state",
    "told": "T.swapped@instruction",
    "follow": "follow.named",
    "named": "follow.told",
}
"""Short names of the statistics that most cases change."""

Changes = dict[str, Statistic | None]


def share(low: float, high: float, p: float | None = None, episodes: int = 12) -> Share:
    """Return a share with this interval."""
    return Share((low + high) / 2, 72, (low, high), p, episodes=episodes)


USED, IGNORED, OPEN = share(0.021, 0.5), share(0.0, 0.099), share(0.019, 0.101)
FOLLOWED = FollowedShare(0.6, 72, (0.31, 0.9), 0.009, smallest_p=0.0002)
UNFOLLOWED = FollowedShare(0.0, 72, (-0.1, 0.1), 0.5, smallest_p=0.0002)
REVERSED = FollowedShare(-0.6, 72, (-0.9, -0.31), 1.0, smallest_p=0.0002)
A_LITTLE = FollowedShare(0.1, 72, (0.01, 0.3), 0.009, smallest_p=0.0002)
TOO_FEW = FollowedShare(0.6, 36, (0.31, 0.9), 1 / 64, smallest_p=1 / 64)
COLOURED = share(0.031, 0.5)
NOT_ONE_BIT = Share(0.0, 72, (0.0, 0.0), episodes=12, same=1.0)
GOOD = {
    "motions": Statistic(1.0, 72),
    "misfit": LogDistance(0.2, 72, offset=0.1, spread=1.1),
    "variation": Statistic(0.9, 72),
    "noise": Statistic(0.0, 72),
}
LOST = {"unparsed: not_finite": 9, "timeout": 2, "refused": 4, "closed": 1}


def verdict(
    *, left: int = 0, asked: MissingConditions | None = None, reads: Sequence[str] = (), **changed: Statistic | None
) -> PolicyVerdict:
    """Return the verdict on a policy that sees, hears and knows its state, but for what is changed.

    Where its cameras are ignored, or at a similar state, so is each of them, and no object is followed.
    """
    given = {kind: changed.get(kind) for kind in ("swap", "matched")}
    gone = {kind: is_ignored(one) and not is_used(one) for kind, one in given.items()}
    usual = dict.fromkeys(("swap", "matched", "blank", "state", "told"), USED)
    usual |= dict.fromkeys(("follow", "named"), UNFOLLOWED if any(gone.values()) else FOLLOWED)
    single = {"swapped": IGNORED if gone["swap"] else USED, "matched": IGNORED if any(gone.values()) else USED}
    statistics: dict[str, Statistic] = {
        **GOOD,
        **{f"T.{kind}@camera:{name}": one for kind, one in single.items() for name in ("top", "wrist")},
        **{NAMES.get(name, name): one for name, one in (usual | changed).items() if one is not None},
    }
    return judge_policy(
        "m",
        statistics,
        CHANNELS,
        scope="here.",
        missing=LOST,
        left=left,
        reads=reads,
        left_out=asked or MissingConditions(),
    )


def without(*conditions: str) -> MissingConditions:
    """Return what a run says that did not ask these conditions although its bank can show them."""
    return MissingConditions(frozenset(conditions))


def losing(one: Share, share: float) -> Share:
    """Return a statistic of which this share of the calls holds no motion."""
    return replace(one, lost=share)


def _wrist(**changed: Statistic | None) -> Changes:
    return {f"T.{kind}@camera:wrist": one for kind, one in changed.items() if kind != "blank"} | {
        "T.blank@wrist": changed.get("blank")
    }


def _misfit(value: float, offset: float, spread: float) -> Changes:
    return {"misfit": LogDistance(value, 72, offset=offset, spread=spread)}


CASES: dict[str, Changes] = {
    "sees": {},
    "no object is moved": {"follow": None},
    "no object can be moved": {"follow": Statistic(None, 0), "named": Statistic(None, 0)},
    "follows a little": {"follow": Statistic(0.6, 72, (0.30, 0.9), 0.009)},
    "follows by chance": {"follow": Statistic(0.6, 72, (0.31, 0.9), 0.010)},
    "follows in too few episodes": {"follow": TOO_FEW},
    "follows in just enough episodes": {"follow": FollowedShare(0.1, 42, (0.0, 0.9), 0.02, smallest_p=1 / 128)},
    "follows without an interval": {"follow": Statistic(0.6, 72, p=0.009)},
    "follows where no test could tell": {"follow": FollowedShare(0.0, 42, (-0.1, 0.1), 0.5, smallest_p=0.01)},
    "follows whatever is named": {"named": UNFOLLOWED},
    "follows what is named by a hair": {"named": Statistic(0.1, 72, (0.0, 0.3), 0.009)},
    "follows rather what is named": {"named": None, "follow.rather": FOLLOWED},
    "follows rather, little": {"named": Statistic(None, 0), "follow.rather": UNFOLLOWED},
    "pose": {"matched": IGNORED},
    "no state to match by": {"matched": None},
    "no matched moment": {"matched": Statistic(None, 0)},
    "alike states open": {"matched": OPEN},
    "cameras open": {"swap": OPEN},
    "ignores cameras": {"swap": IGNORED, "matched": IGNORED, "blank": IGNORED},
    "ignores cameras, no match": {"swap": IGNORED, "matched": None, "blank": IGNORED},
    "presence": {"swap": IGNORED, "matched": IGNORED},
    "presence open": {"swap": IGNORED, "matched": IGNORED, "blank": OPEN},
    "presence not asked": {"swap": IGNORED, "matched": IGNORED, "blank": None},
    "ignored but where alike": {"swap": IGNORED, "matched": OPEN, "blank": IGNORED},
    "used by chance": {"swap": share(0.021, 0.5, p=0.02)},
    "used at one percent": {"swap": share(0.021, 0.5, p=0.01)},
    "drawn answers": {"swap": share(0.03, 0.5, p=0.3), "matched": None},
    "too few episodes": {"swap": share(0.0, 0.05, episodes=5)},
    "too few episodes for nothing": dict.fromkeys(("swap", "matched", "blank"), share(0.0, 0.05, episodes=5)),
    "at the bound of nothing": dict.fromkeys(("swap", "matched", "blank"), share(0.0, 0.10)),
    "at the bound of next to nothing": {"swap": share(0.021, 0.10)},
    "just enough episodes": {"swap": share(0.0, 0.05, episodes=6), "matched": None, "blank": IGNORED},
    "open, just enough episodes": {"swap": share(0.019, 0.101, episodes=6)},
    "open, and by chance": {"swap": share(0.019, 0.101, p=0.3)},
    "at the bound, and by chance": {"swap": share(0.02, 0.5, p=0.3)},
    "by chance, without an interval": {"swap": Share(0.4, 72, p=0.3, episodes=12)},
    "episodes not counted": {"swap": Statistic(0.4, 72, (0.3, 0.5))},
    "swap not asked": {"swap": None},
    "swap cannot say": {"swap": Statistic(None, 0, note="one episode alone")},
    "swap without an interval": {"swap": Share(0.4, 72, episodes=12)},
    "own pose, near": {"beyond@cameras": OPEN, "T.near@cameras": share(0.1, 0.3), "follow": None},
    "own pose, near, but follows": {"beyond@cameras": OPEN, "T.near@cameras": share(0.1, 0.3)},
    "own pose, near, but colours": {
        "beyond@cameras": OPEN,
        "T.near@cameras": share(0.1, 0.3),
        "T.exchanged": COLOURED,
        "follow": None,
    },
    "own pose, near, and no colours": {
        "beyond@cameras": OPEN,
        "T.near@cameras": share(0.1, 0.3),
        "T.exchanged": OPEN,
        "follow": None,
    },
    "beyond the pose": {"beyond@cameras": USED, "T.near@cameras": IGNORED, "follow": None},
    "the wrist ignored": _wrist(swapped=IGNORED, matched=IGNORED, blank=IGNORED),
    "the wrist's presence": _wrist(swapped=IGNORED, matched=IGNORED, blank=USED),
    "the wrist's pose": _wrist(matched=IGNORED),
    "the wrist near its pose": {"beyond@camera:wrist": IGNORED, "T.near@camera:wrist": USED},
    "the wrist near its pose, but colours": {
        "beyond@camera:wrist": IGNORED,
        "T.near@camera:wrist": USED,
        "T.exchanged@wrist": COLOURED,
    },
    "the wrist beyond its pose": {"beyond@camera:wrist": USED, "T.near@camera:wrist": IGNORED},
    "state shortcut": {"swap": IGNORED, "matched": IGNORED, "blank": IGNORED, "state": USED},
    "ignores its state": {"state": IGNORED},
    "state open": {"state": OPEN},
    "state not asked": {"state": None},
    "not told": {"told": IGNORED, "named": UNFOLLOWED},
    "not told, but follows": {"told": IGNORED},
    "told open": {"told": OPEN},
    "told by nobody": {"told": None},
    "told, follows neither": {"named": UNFOLLOWED, "follow": UNFOLLOWED},
    "told, follows neither, and comes to the log": {
        "named": UNFOLLOWED,
        "follow": UNFOLLOWED,
        "follow.logged": FOLLOWED,
    },
    "told, follows neither, and goes from the log": {
        "named": UNFOLLOWED,
        "follow": UNFOLLOWED,
        "follow.logged": REVERSED,
    },
    "told, goes away": {"named": REVERSED, "follow": REVERSED},
    "told, nothing moved, and comes to the log": {"named": None, "follow": None, "follow.logged": FOLLOWED},
    "told, follows the other": {"named": UNFOLLOWED, "follow": UNFOLLOWED, "follow.other": FOLLOWED},
    "told, and takes one name for the other": {"named": REVERSED, "follow.other": FOLLOWED, "follow": UNFOLLOWED},
    "told, follows a hair more": {"named": A_LITTLE, "follow": A_LITTLE},
    "told, nothing moved": {"named": None, "follow": None},
    "no motions": {"motions": Statistic(0.89, 100)},
    "motions enough": {"motions": Statistic(0.9, 100)},
    "nothing came": {"motions": Statistic(None, 0)},
    "misfit by its mean": _misfit(1.0, 1.01, 1.0),
    "misfit by its spread": _misfit(1.25, 1.0, 3.1),
    "misfit by both": _misfit(3.0, 2.5, 4.0),
    "misfit by choice": _misfit(1.0, 1.0, 3.0),
    "misfit that nobody explains": {"misfit": Statistic(2.0, 72)},
    "fits in other units": _misfit(0.99, 9.0, 9.0),
    "a number held still": {"variation": Share(0.5, 72, still=["grip"])},
    "varies too little": {"variation": Statistic(0.019, 72)},
    "varies just enough": {"variation": Statistic(0.02, 72)},
    "always the same": {"noise": Share(None, 72, note="its answers do not vary", alike=True)},
    "noise": {"noise": Statistic(0.51, 72)},
    "just no noise": {"noise": Statistic(0.5, 72)},
    "remembers": {"noise": Statistic(0.011, 72), "memory": Statistic(0.021, 72, p=0.001)},
    "remembers too little": {"noise": Statistic(0.011, 72), "memory": Statistic(0.02, 72, p=0.001)},
    "remembers by chance": {"noise": Statistic(0.011, 72), "memory": Statistic(0.021, 72, p=0.0011)},
    "remembers in next to no noise": {"noise": Statistic(0.01, 72), "memory": Statistic(0.5, 72, p=0.001)},
    "remembering not told": {"noise": Statistic(0.011, 72), "memory": Statistic(None, 9)},
    "constant and noise": {"variation": Statistic(0.01, 72), "noise": Statistic(0.9, 72)},
    "pose in a part of the states": {"matched": replace(IGNORED, n=34), "swapped.alike@cameras": IGNORED},
    "pose, and used there": {"matched": replace(IGNORED, n=34), "swapped.alike@cameras": USED},
    "cameras of lost calls": {"swap": losing(USED, 0.11), "matched": losing(IGNORED, 0.11)},
    "cameras of a few lost calls": {"swap": losing(USED, 0.10)},
    "grey pictures of lost calls": {"swap": IGNORED, "matched": IGNORED, "blank": losing(IGNORED, 0.3)},
    "own episode's pictures of lost calls": {"beyond@cameras": losing(USED, 0.3), "follow": None},
    "moved objects of lost calls": {"follow": losing(FOLLOWED, 0.3), "named": losing(FOLLOWED, 0.3)},
    "words of lost calls": {"told": losing(IGNORED, 0.3), "named": UNFOLLOWED},
    "repeats of lost calls": {"noise": losing(Share(0.0, 72), 0.3)},
    "no repeats": {"noise": Statistic(None, 0, note="the run did not ask this")},
    "ignores cameras, and answers to decoys": dict.fromkeys(("swap", "matched", "blank"), IGNORED) | {"T.decoys": USED},
    "ignores cameras, and answers to noise": dict.fromkeys(("swap", "matched", "blank"), IGNORED) | {"T.noise": USED},
    "ignores cameras but for a number": {
        **dict.fromkeys(("swap", "blank"), IGNORED),
        "matched": replace(IGNORED, carried={"grip": 0.84, "step 8": 0.2}),
    },
    "ignores its state but for a step": {"state": replace(IGNORED, carried={"step 1": 0.3})},
    "not told but for a number": {
        "told": replace(IGNORED, carried={"grip": 0.3}),
        "named": UNFOLLOWED,
    },
    "each camera alone": {
        **_wrist(swapped=IGNORED, matched=IGNORED, blank=IGNORED),
        "T.swapped@camera:top": IGNORED,
        "T.matched@camera:top": IGNORED,
        "T.blank@top": IGNORED,
    },
    "paint": {"T.recoloured": USED},
    "paint open": {"T.recoloured": OPEN},
    "next to nothing": {"swap": share(0.021, 0.099)},
    "next to nothing, nearly": {"swap": share(0.02, 0.099)},
    "not one bit of the pictures": {"swap": NOT_ONE_BIT, "matched": NOT_ONE_BIT, "blank": NOT_ONE_BIT},
    "not one bit of swapped pictures": {"swap": NOT_ONE_BIT},
    "not one bit of the state": {"state": NOT_ONE_BIT},
    "not one bit of the words": {"told": NOT_ONE_BIT, "named": UNFOLLOWED},
}


def said(found: PolicyVerdict, *, whole: bool) -> object:
    """Return what a verdict says: its JSON, or a line for each of its axes, the guards and the remarks."""
    if whole:
        return found.as_dict()
    axes = {"camera": found.camera, "state": found.state, "instruction": found.instruction, **found.cameras}
    lines = [f"{name}: {axis.label} by {axis.by}: {axis.because} / {axis.why_not}" for name, axis in axes.items()]
    guards = [] if not found.guards else [f"guards: {', '.join(found.guards)}: {found.because}"]
    return [*lines, *guards, *found.remarks]


@cache
def cases() -> dict[str, PolicyVerdict]:
    """Return the verdicts on all cases by their names; also on a run that is not finished."""
    made = {f"policy: {name}": verdict(**changed) for name, changed in CASES.items()}
    made["policy: unfinished"] = verdict(left=3)
    made["policy: unfinished, no motions"] = verdict(left=3, motions=Statistic(0.5, 100))
    other = {"motions": Statistic(0.5, 100)}
    made["policy: no motions, no reasons"] = judge_policy("m", GOOD | other, (), scope="here.")
    made["policy: no channel"] = judge_policy("m", GOOD, (), scope="here.")
    return made
