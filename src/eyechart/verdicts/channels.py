"""Verdicts on policies: what each channel is used for, one axis each, and the statistic that decided.

Source: docs/decisions/0051-what-is-said-of-a-policy.md.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeGuard

from eyechart.records import picked, plain
from eyechart.stats.guarantees import episodes_needed
from eyechart.stats.statistic import Statistic

USED = 0.02
"""A channel is used where its share is above this, with a chance of .01 to be wrong."""
IGNORED = 0.10
"""And ignored where its share is below this, likewise."""
COLOURED = 0.03
"""Of two ways to look beyond one's pose, colours that are exchanged count from here on: two chances are two errors."""
ALPHA = 0.01
FOLLOWED = 0.30
"""An object is followed where the answer goes at least so far with it, as a share of the oracle's way, likewise."""
UNSCORABLE = 0.10
"""Above this share of calls without a motion a policy is not scorable."""
MISFIT = 1.0
"""From this error on the policy fits the log worse than the log's own mean does."""
OFFSET, SPREAD = 1.0, 3.0
"""A misfit is one of units, not of choice: a mean so many spreads away, or a spread so many times another."""
CONSTANT = 0.02
"""A policy that varies less than this share of the log's variation is constant."""
INCONSISTENT = 0.50
"""Above this share of noise a policy does not agree with itself."""
REMEMBERED, SURE, LEAST_NOISE = 0.02, 0.001, 0.01
"""A policy keeps something from call to call where so much of its noise goes with the call before, with such a p.

Noise below the last is rounding, and what it goes with changes no share.
"""
OF_DATA_SET = 0.10
"""Absence is said of a data set, and not of its episodes alone, where fewer than this share of them may respond."""
SURENESS = 0.99
"""The confidence of that bound."""
LEAST_EPISODES = 6
"""Fewer episodes bound nothing: the jackknife's intervals are too short."""

GUARDS: Mapping[str, str] = {
    "not_scorable": "too few of its calls came back with a motion",
    "misfit": "its answers have other means or spreads than the logged motions, and fit worse than their mean does",
    "constant": "its answers hardly vary",
    "self_inconsistent": "its answers to one moment differ more than to different moments, or with the call before",
}
"""What is asked before any axis, in this order, with what it means where it fails."""

CAMERA_LABELS: Mapping[str, str] = {
    "object_grounded": "It goes where the object that it is told to reach goes in the picture.",
    "camera_content": "What the picture shows decides, beyond what the state tells.",
    "pose_only": "Of the picture it uses only what its own state tells as well.",
    "camera_presence": "It matters that there is a picture, not what it shows.",
    "ignores_camera": "The picture could be another episode's, or none, and hardly anything would change.",
    "undecided": "The run does not settle what the picture is used for.",
}
STATE_LABELS: Mapping[str, str] = {
    "state_shortcut": "It goes by its state alone, and ignores its cameras.",
    "state_used": "Its state decides, beside its cameras.",
    "ignores_state": "Its state could be another episode's, and hardly anything would change.",
    "undecided": "The run does not settle whether the state is used.",
}
INSTRUCTION_LABELS: Mapping[str, str] = {
    "instruction_followed": "It does what it is told.",
    "instruction_ignored": "It could be told something else, and hardly anything would change.",
    "no_power": "The bank tells every episode the same, or nothing.",
    "undecided": "The run does not settle whether the instruction is followed.",
}
AXES: Mapping[str, Mapping[str, str]] = {
    "camera": CAMERA_LABELS,
    "state": STATE_LABELS,
    "instruction": INSTRUCTION_LABELS,
}
MEETS: Mapping[str, tuple[str, ...]] = {"object_grounded": ("object_grounded", "camera_content")}
"""What a label meets beside itself."""
ABSENT = ("ignores_camera", "ignores_state", "instruction_ignored")
"""The labels that say of a channel that it is not used at all."""
OPEN = ("undecided", "no_power")
"""The labels that cannot say."""

REQUIREMENTS: Mapping[str, str] = {
    f"{axis}:{label}": f"the {axis} label is {' or '.join(one for one in labels if label in MEETS.get(one, (one,)))}"
    for axis, labels in AXES.items()
    for label in labels
    if label not in OPEN
}
"""What a gate may require of a policy, with what it means."""

RESPONDS: Mapping[str, tuple[str, ...]] = {
    "responds": ("swapped", "matched", "blank"),
    "responds.shown": ("swapped", "matched"),
    "responds.alike": ("matched",),
}
"""In which episodes a channel carries something all the same, by the conditions that a claim of absence rests on.

Of a channel that is ignored; of pictures that must only be there; of those that tell no more than the state.
"""

Statistics = Mapping[str, Statistic]


def rests_on(claim: str, channel: str) -> Iterator[str]:
    """Yield the conditions that a claim of `RESPONDS` on a channel rests on, of those that the channel has."""
    for name in RESPONDS[claim]:
        if name != "blank":
            yield f"{name}@{channel}"
        elif channel == "cameras":
            yield name
        elif channel.startswith("camera:"):
            yield f"{name}@{channel.partition(':')[2]}"


@dataclass(frozen=True, slots=True)
class Judged:
    """A label on one axis: why, the statistic that decided it, and what stood in the way of a stronger one.

    Of a label of absence, ``responds`` is the share of episodes that respond, and what it may be in the data set.
    ``may_be`` is a stronger label that the run neither gives nor refutes.
    """

    label: str
    because: str
    by: str = ""
    why_not: str = ""
    responds: Statistic | None = None
    may_be: str = ""

    @property
    def of_data_set(self) -> str:
        """Return the label that holds of the data set too, ``undecided`` where too many of its episodes may respond."""
        bound = None if self.responds is None else self.responds.ci
        return "undecided" if bound is not None and bound[1] >= OF_DATA_SET else self.label

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values; ``data_set`` says how far a claim of absence goes beyond the episodes asked."""
        found = picked(self, "label because by why_not")
        if self.responds is None or self.responds.ci is None:
            return found
        episodes = {"episodes": self.responds.n, "responding": (self.responds.detail or {}).get("k")}
        bound = {"share_at_most": self.responds.ci[1], "confidence": SURENESS, "wanted": OF_DATA_SET}
        return {**found, "data_set": {"label": self.of_data_set, **episodes, **bound}}


@dataclass(frozen=True)
class PolicyVerdict:
    """What is said of one policy: a label an axis, after the guards; ``channels`` holds the share of each channel."""

    model: str
    camera: Judged
    cameras: Mapping[str, Judged]
    state: Judged
    instruction: Judged
    guards: Mapping[str, str]
    channels: Mapping[str, Statistic]
    scope: str
    remarks: tuple[str, ...] = field(default=())

    @property
    def because(self) -> str:
        """Return why, in one paragraph."""
        if self.guards:
            return " ".join(f"{name}: {why}." for name, why in self.guards.items())
        parts = (self.camera, *self.cameras.values(), self.state, self.instruction)
        return " ".join(dict.fromkeys(one.because for one in parts))

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values; the first seven keys are those that scripts may rely on."""
        judged = {"camera": self.camera, "state": self.state, "instruction": self.instruction}
        judged |= {f"camera:{name}": one for name, one in self.cameras.items()}
        return {
            "camera": self.camera.label,
            "cameras": {name: one.label for name, one in self.cameras.items()},
            "state": self.state.label,
            "instruction": self.instruction.label,
            "guards": list(self.guards),
            "because": self.because,
            "channels": {name: picked(one, "T=value ci n") for name, one in self.channels.items()},
            "axes": plain(judged),
            **picked(self, "scope remarks"),
        }


def judge_policy(
    model: str,
    statistics: Statistics,
    channels: Sequence[str],
    *,
    scope: str,
    missing: Mapping[str, int] | None = None,
    left: int = 0,
    reads: Sequence[str] = (),
) -> PolicyVerdict:
    """Return the verdict on a policy; ``channels`` are those of the bank, ``missing`` the calls without a motion.

    ``left`` calls are not finished. ``reads`` are the channels that the policy declares to read, none where it declares
    nothing.
    """
    failed = failed_guards(statistics, missing or {})
    shares = {name: statistics[f"T.swapped@{name}"] for name in channels if f"T.swapped@{name}" in statistics}
    names = [name.partition(":")[2] for name in channels if name.startswith("camera:")]
    if failed:
        nothing = Judged("undecided", f"a guard failed: {', '.join(failed)}", next(iter(failed)))
        every = dict.fromkeys(names, nothing)
        return PolicyVerdict(model, nothing, every, nothing, nothing, failed, shares, scope, _unfinished(left))

    def reached(found: Judged, channel: str, what: str) -> Judged:
        return _reached(found, shares.get(channel), channel, what, reads)

    camera = reached(judge_camera(statistics, "cameras", "its cameras"), "cameras", "picture")
    cameras = {
        name: reached(
            judge_camera(statistics, f"camera:{name}", f"the {name} camera"), f"camera:{name}", f"picture of {name}"
        )
        for name in names
    }
    state = reached(judge_state(statistics, camera.label, there="state" in channels), "state", "state")
    instruction = reached(judge_instruction(statistics), "instruction", "instruction")
    remarks = [*_unfinished(left), *_left_out(statistics["motions"], missing or {})]
    remarks += _remarks(statistics, camera.label)
    return PolicyVerdict(model, camera, cameras, state, instruction, failed, shares, scope, tuple(remarks))


def _reached(found: Judged, swap: Statistic | None, channel: str, what: str, reads: Sequence[str]) -> Judged:
    """Return a label of absence, undecided where not one bit of any answer shows the channel and it is to be read.

    What computes with a channel changes some last bit with it: what changes none may never have been given it, and a
    fault of the wiring is no finding about the policy.
    """
    if found.label not in ABSENT or swap is None or (swap.detail or {}).get("same") != 1.0:
        return found
    if reads and not _declared(channel, reads):
        return replace(found, because=f"{found.because[:-1]}; it declares that it does not read it.")
    words = (
        f"another {what} changes not one bit of {swap.n} answers: it does not reach the policy, or an earlier answer "
        "is kept; 'eyechart doctor SPEC --frames BANK' asks, and a policy that is not to read it declares its channels"
    )
    return Judged("undecided", _sentence(words), f"T.swapped@{channel}")


def _declared(channel: str, reads: Sequence[str]) -> bool:
    """Return whether a channel is among those that are read; all cameras stand for each, and one for all together."""
    if channel == "cameras":
        return any(one == channel or one.startswith("camera:") for one in reads)
    return channel in reads or (channel.startswith("camera:") and "cameras" in reads)


def failed_guards(statistics: Statistics, missing: Mapping[str, int]) -> dict[str, str]:
    """Return the guards that failed, each with the number that says so, in their order."""
    found = {}
    motions, misfit, varies, noise = (statistics[name] for name in ("motions", "misfit", "variation", "noise"))
    without = 1 - motions.value if motions.value is not None else 1.0
    if without > UNSCORABLE:
        reasons = _reasons(missing, "none came back")
        return {"not_scorable": f"{without:.0%} of {motions.n} calls hold no motion{reasons}"}
    if misfit.value is not None and misfit.value >= MISFIT and (unlike := _unlike(misfit)):
        words = "is its normalisation skipped, or its action space another?"
        found["misfit"] = f"its error is {misfit.value:.2g} of the log's variance, and {unlike}: {words}"
    if varies.value is not None and varies.value < CONSTANT:
        found["constant"] = f"it varies {varies.value:.3f} times as much as the log between episodes, below {CONSTANT}"
    elif "do not vary" in noise.note:
        found["constant"] = "its answers are all the same"
    if noise.value is not None and noise.value > INCONSISTENT:
        found["self_inconsistent"] = f"{noise.value:.0%} of its variation is there when nothing changes at all"
    elif noise.value is not None and noise.value > LEAST_NOISE and _remembers(kept := statistics.get("memory")):
        words = "it keeps something; empty it before every call (reset)"
        found["self_inconsistent"] = (
            f"{kept.value:.0%} of its noise goes with the call before (p {kept.p:.3f}): {words}"
        )
    return found


def _remembers(kept: Statistic | None) -> TypeGuard[Statistic]:
    return kept is not None and kept.value is not None and kept.value > REMEMBERED and (kept.p or 0.0) <= SURE


def _unlike(misfit: Statistic) -> str:
    """Return in words how a policy's numbers are not those of the log, nothing where they are."""
    offset, spread = ((misfit.detail or {}).get(name) for name in ("offset", "spread"))
    found = []
    if isinstance(offset, float) and offset > OFFSET:
        found.append(f"a dimension's mean is {offset:.2g} spreads away")
    if isinstance(spread, float) and spread > SPREAD:
        found.append(f"a dimension's spread is another by a factor of {spread:.2g}")
    return ", ".join(found)


def used(one: Statistic | None, least: float = USED) -> bool:
    """Return whether a share is above the margin, and no chance."""
    return _settled(one) and one.ci[0] > least and (one.p is None or one.p <= ALPHA)  # type: ignore[index,union-attr]


def ignored(one: Statistic | None) -> bool:
    """Return whether a share is below the margin."""
    return _settled(one) and one.ci[1] < IGNORED  # type: ignore[index,union-attr]


def _settled(one: Statistic | None) -> bool:
    if one is None or one.value is None or one.ci is None:
        return False
    episodes = (one.detail or {}).get("episodes", 0)
    return isinstance(episodes, int) and episodes >= LEAST_EPISODES


def judge_camera(statistics: Statistics, channel: str, what: str) -> Judged:
    """Return the label of all cameras together, or of one."""
    over = "" if channel == "cameras" else f"@{channel.partition(':')[2]}"
    swap, matched, blank = (
        statistics.get(f"T.{name}") for name in (f"swapped@{channel}", f"matched@{channel}", f"blank{over}")
    )
    shown = f"{what} {'carry' if what.endswith('cameras') else 'carries'} {_of_action(swap)}"
    if ignored(swap) and (matched is None or ignored(matched)):
        if ignored(blank):
            words = f"{what} could be unplugged without anybody noticing ({shown}; grey pictures {_share(blank)})"
            gone = Judged("ignores_camera", _sentence(words), f"T.swapped@{channel}")
            return _bounded(gone, statistics.get(f"responds@{channel}"))
        if used(blank):
            words = f"{shown}, but grey pictures {_share(blank)}: that there is a picture matters, not what it shows"
            there = Judged("camera_presence", _sentence(words), f"T.blank{over}")
            return _bounded(there, statistics.get(f"responds.shown@{channel}"))
        why = f"whether a picture must be there is open: grey ones change {_share(blank)}"
        return Judged("undecided", _sentence(f"{shown}; {why}"), f"T.blank{over}")
    if used(swap) and ignored(matched):
        words = f"{shown}, but of another episode at a similar state only {_share(matched)}: it reads its own pose"
        pose = Judged("pose_only", _sentence(words), f"T.matched@{channel}")
        return _bounded(pose, statistics.get(f"responds.alike@{channel}"))
    if used(swap) and used(matched):
        return _content(statistics, channel, f"{shown}, and {_share(matched)} where the state is alike")
    return Judged("undecided", _sentence(f"{shown}: {_why_open(swap, matched)}"), f"T.swapped@{channel}")


def _content(statistics: Statistics, channel: str, shown: str) -> Judged:
    """Return the label of pictures whose content decides: whether the object in them is followed, is of all cameras.

    A picture of the own episode, as far off in its state as the matched one, takes the claim away where it changes as
    much; not from who follows an object that is moved, or answers to objects whose colours are exchanged, while the
    state stays.
    """
    plain = Judged("camera_content", _sentence(shown), f"T.matched@{channel}")
    gain, control = (None if channel != "cameras" else statistics.get("follow.named")), "follow.told"
    beyond = statistics.get(f"beyond@{channel}")
    looks = used(beyond) or used(_exchanged(statistics, channel), COLOURED) or _followed(gain, FOLLOWED)
    if beyond is not None and not looks:
        near = f"one of its own episode, as far off in its state, {_share(statistics.get(f'T.near@{channel}'))}"
        colours = _exchanged(statistics, channel)
        also = "" if colours is None else f", and the objects' colours exchanged {_share(colours)}"
        why = _sentence(f"{shown}; but {near}{also}: it may read its own pose")
        return Judged("undecided", why, f"beyond@{channel}")
    if channel != "cameras":
        return plain
    if (told := statistics.get(control)) is None or told.value is None:
        control = "follow.rather"
    if gain is None or gain.value is None:
        why = "the bank moves no object, so whether it is followed is open"
        return replace(plain, why_not=why, may_be="object_grounded")
    if not _followed(gain, FOLLOWED):
        why = f"the moved object is followed {_way(gain)} of the oracle's way; {_least(gain)}"
        return replace(plain, why_not=why, may_be="object_grounded" if _may_follow(gain) else "")
    if not _followed(rather := statistics.get(control), 0.0):
        why = f"objects are followed as well where another is named: the difference is {_way(rather)}; {_least(rather)}"
        return replace(plain, why_not=why, may_be="object_grounded" if _may_follow(rather) else "")
    words = f"{shown}; moved, the named object is followed {_way(gain)} of the oracle's way (p {gain.p:.4f})"
    return Judged("object_grounded", _sentence(words), "follow.named")


def _exchanged(statistics: Statistics, channel: str) -> Statistic | None:
    """Return the share that goes with the objects' colours in these pictures, at the same state."""
    return statistics.get("T.exchanged" if channel == "cameras" else f"T.exchanged@{channel.partition(':')[2]}")


def _followed(one: Statistic | None, least: float) -> bool:
    if one is None or one.value is None or one.ci is None or one.p is None:
        return False
    return one.p < ALPHA and one.ci[0] > least


def _may_follow(one: Statistic | None) -> bool:
    """Return whether a following that is not settled may be as large as `FOLLOWED` all the same."""
    return one is None or one.ci is None or one.ci[1] >= FOLLOWED


def _least(one: Statistic | None) -> str:
    """Return why a following is not settled."""
    smallest = None if one is None or one.detail is None else one.detail.get("smallest_p")
    if isinstance(smallest, float) and smallest >= ALPHA:
        return "below seven episodes no test can tell"
    return "p is not below .01" if one is None or one.p is None or one.p >= ALPHA else "its lower end is too low"


def judge_state(statistics: Statistics, camera: str, *, there: bool) -> Judged:
    """Return the label of the state, where the bank has one; ``camera`` is that of all cameras."""
    if not there:
        return Judged("undecided", "The bank has no state.")
    swap, by = statistics.get("T.swapped@state"), "T.swapped@state"
    shown = f"its state carries {_of_action(swap)}"
    if ignored(swap):
        return _bounded(Judged("ignores_state", _sentence(shown), by), statistics.get("responds@state"))
    if used(swap) and camera == "ignores_camera":
        short = Judged("state_shortcut", _sentence(f"{shown}, and its cameras next to nothing"), by)
        return _bounded(short, statistics.get("responds@cameras"))
    if used(swap):
        return Judged("state_used", _sentence(shown), by)
    return Judged("undecided", _sentence(f"{shown}: {_why_open(swap, None)}"), by)


def judge_instruction(statistics: Statistics) -> Judged:
    """Return the label of the instruction."""
    swap, by = statistics.get("T.swapped@instruction"), "T.swapped@instruction"
    if swap is None:
        return Judged("no_power", "No two episodes of the bank are told different things.")
    shown = f"another instruction changes {_of_action(swap)}"
    told = statistics.get("follow.told")
    if ignored(swap) and not _followed(told, 0.0):
        unheard = Judged("instruction_ignored", _sentence(shown), by)
        return _bounded(unheard, statistics.get("responds@instruction"))
    if not used(swap):
        but = f", but it follows what is named {_share(told)} of the oracle's way more than what is not"
        why, by = (but, "follow.told") if ignored(swap) else (f": {_why_open(swap, None)}", by)
        return Judged("undecided", _sentence(f"{shown}{why}"), by)
    if _followed(told, 0.0):
        words = f"{shown}, and it follows what is named {_way(told)} of the oracle's way more than what is not"
        return Judged("instruction_followed", _sentence(words), "follow.told")
    if any(_followed(statistics.get(f"follow.{which}"), FOLLOWED) for which in ("named", "other")):
        why = f"it follows what is named only {_way(told)} of the oracle's way more; {_least(told)}"
        if told is not None and told.ci is not None and told.ci[1] < 0:
            why = f"it goes to what is not named, {_way(told)} of the oracle's way: it may take one name for the other"
        return Judged("undecided", _sentence(f"{shown}, but {why}"), "follow.told")
    moved = told is not None and told.value is not None
    what = "it follows no object that is moved in the picture" if moved else "the bank moves no object"
    return Judged("instruction_followed", _sentence(shown), by, f"whether it goes to what is named is open: {what}")


def _bounded(found: Judged, one: Statistic | None) -> Judged:
    """Return a label of absence, of the whole data set only where few enough of its episodes may respond."""
    if one is None or one.value is None or one.ci is None:
        return found
    if one.ci[1] < OF_DATA_SET:
        return replace(found, responds=one)
    k = round(one.value * one.n)
    some = f"{k} of {one.n} {'responds' if k == 1 else 'respond'}" if k else f"none of {one.n} responds"
    needed = episodes_needed(OF_DATA_SET, confidence=SURENESS)
    why = (
        f"it is said of these episodes: {some}, so that up to {one.ci[1]:.0%} of the data set's may; "
        f"{needed} episodes of which none does would bound that at {OF_DATA_SET:.0%}"
    )
    return replace(found, why_not=why, responds=one)


def _unfinished(left: int) -> tuple[str, ...]:
    return (f"{left} calls are unfinished: what is said of part of a run may change",) if left else ()


def _left_out(motions: Statistic, missing: Mapping[str, int]) -> Iterator[str]:
    """Say how many calls hold no motion, of a policy of which few enough do not."""
    if motions.value is not None and (without := round((1 - motions.value) * motions.n)):
        words = f"{without} of {motions.n} calls hold no motion{_reasons(missing)}"
        yield f"{words}: they are left out, and what it would have done there is not known"


def _reasons(missing: Mapping[str, int], otherwise: str = "") -> str:
    """Return in brackets why most calls hold no motion that do not, or ``otherwise`` where nobody says."""
    said = ", ".join(f"{count} {why}" for why, count in sorted(missing.items(), key=lambda one: -one[1])[:3])
    return f" ({said or otherwise})" if said or otherwise else ""


def _remarks(statistics: Statistics, camera: str) -> Iterator[str]:
    """Yield what whoever acts on a verdict should know beside it; ``camera`` is the label of all cameras."""
    yield from _held_still(statistics)
    misfit = statistics.get("misfit")
    if misfit is not None and misfit.value is not None and misfit.value >= MISFIT:
        yield (
            f"Its error is {misfit.value:.2g} of the log's variance: it does something else than was logged, so that "
            "what it uses may be put to no good use"
        )
        if camera == "ignores_camera":
            yield (
                "It ignores its cameras, and does not do what was logged: are its pictures ordered and scaled as in "
                "training? 'eyechart doctor SPEC --frames BANK' tries other forms"
            )
    paint = statistics.get("T.recoloured")
    if used(paint):
        yield f"A table of another colour alone changes {_of_action(paint)}"
    yield from _beyond_all(statistics)
    near = statistics.get("T.swapped@cameras")
    if near is not None and near.ci is not None and near.ci[0] > USED and near.ci[1] < IGNORED:
        yield f"Its cameras are used, and carry next to nothing: {_of_action(near)}"


def _held_still(statistics: Statistics) -> Iterator[str]:
    varies = statistics.get("variation")
    if varies is not None and (still := (varies.detail or {}).get("still")):
        which = ", ".join(map(str, still)) if isinstance(still, list) else str(still)
        yield f"Its {which} is the same in every answer, and the log's is not: nothing here is said of that number"


def _beyond_all(statistics: Statistics) -> Iterator[str]:
    swapped = ((name, one.ci) for name, one in statistics.items() if name.startswith("T.swapped@"))
    beyond = [name for name, ci in swapped if ci is not None and ci[0] > 1]
    if beyond:
        which = ", ".join(name.partition("@")[2] for name in beyond)
        yield (
            f"A share above 1 ({which}) is no part of a whole: another episode's channel contradicts the others, "
            "and the answer changes more than between two moments"
        )


def _why_open(swap: Statistic | None, matched: Statistic | None) -> str:
    if swap is None or swap.value is None:
        return swap.note if swap is not None and swap.note else "the run did not ask it"
    episodes = (swap.detail or {}).get("episodes", 0)
    if isinstance(episodes, int) and episodes < LEAST_EPISODES:
        return f"{episodes} episodes bound nothing; {LEAST_EPISODES} are the least"
    if used(swap) and (matched is None or matched.value is None):
        return "the bank has no state to match by, so whether it tells more than the pose is open"
    if used(swap) or ignored(swap):
        bounds = f"neither above {USED} nor below {IGNORED}" if used(swap) else f"not below {IGNORED}"
        return f"where the state is alike it is {_share(matched)}, {bounds}"
    if swap.p is not None and swap.p > ALPHA and swap.ci is not None and swap.ci[0] > USED:
        return f"its answers are drawn, and such a difference comes by chance (p {swap.p:.3f})"
    return f"the interval is neither above {USED} nor below {IGNORED}; more episodes make it shorter"


def _share(one: Statistic | None) -> str:
    """Return a share of the action in words; one above 1 is no percentage of anything."""
    if one is None or one.value is None or one.value <= 1:
        way = _way(one)
        return way if one is None or one.ci is None or one.ci[1] <= 1 else f"{way.rpartition(',')[0]}, over 100]"
    return f"more than all (T {one.value:.2f}{_ends(one)})"


def _of_action(one: Statistic | None) -> str:
    if one is None or one.value is None or one.value <= 1:
        return f"{_share(one)} of the action"
    return f"all of the action and more (T {one.value:.2f}{_ends(one)})"


def _ends(one: Statistic) -> str:
    return "" if one.ci is None else f" [{one.ci[0]:.2f}, {one.ci[1]:.2f}]"


def _way(one: Statistic | None) -> str:
    """Return a share in percent; of a way that is followed it may be more than all, which is too far."""
    if one is None or one.value is None:
        return "— %"
    interval = "" if one.ci is None else f" [{100 * one.ci[0]:.1f}, {100 * one.ci[1]:.1f}]"
    return f"{100 * one.value:.1f} %{interval}"


def _sentence(words: str) -> str:
    return f"{words[0].upper()}{words[1:]}."
