"""The label of one axis of a policy: its cameras or one of them, its state, its instruction.

Source: docs/decisions/0051-what-is-said-of-a-policy.md.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from eyechart.records import picked
from eyechart.stats.guarantees import episodes_needed
from eyechart.stats.statistic import Statistic
from eyechart.verdicts.uses import (
    ALPHA,
    BECAUSE,
    COLOURED,
    EVENLY,
    EVERYTHING,
    FOLLOWED,
    HEADING,
    HEARD,
    IGNORED,
    LEAST_NOISE,
    USED,
    Asked,
    Statistics,
    carried,
    enough,
    followed,
    ignored,
    lost,
    may_follow,
    of_action,
    opposed,
    quoted,
    sentence,
    settled,
    share,
    unfollowed,
    used,
    way,
    why_open,
)

OF_DATA_SET = 0.10
"""Absence is said of a data set, and not of its episodes alone, where fewer than this share of them may respond."""
SURENESS = 0.99
"""The confidence of that bound."""
OF_ITS_WORLD: Mapping[str, str] = {
    "exchanged": "the objects' colours exchanged",
    "recoloured": "other colours of the table",
    "decoys": "further objects",
}
"""Pictures of the same moment that are drawn otherwise, in words."""


RESPONDS: Mapping[str, tuple[str, ...]] = {
    "responds": ("swapped", "matched", "blank"),
    "responds.shown": ("swapped", "matched"),
    "responds.alike": ("matched",),
}
"""In which episodes a channel carries something all the same, by the conditions that a claim of absence rests on.

Of a channel that is ignored; of pictures that must only be there; of those that tell no more than the state.
"""


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


def judge_camera(statistics: Statistics, channel: str, what: str, asked: Asked = EVERYTHING) -> Judged:
    """Return the label of all cameras together, or of one."""
    swap, matched = (statistics.get(f"T.{name}@{channel}") for name in ("swapped", "matched"))
    shown = f"{what} {'carry' if what.endswith('cameras') else 'carries'} {of_action(swap)}"
    if swap is None or swap.value is None:
        why = asked.without(f"swapped@{channel}") or why_open(swap)
        return Judged("undecided", sentence(f"{what} cannot be judged: {why}"), f"T.swapped@{channel}")
    if forgot := asked.forgot(f"matched@{channel}"):
        return Judged("undecided", sentence(f"{shown}; {forgot}"), f"T.swapped@{channel}")
    if ignored(swap) and (matched is None or ignored(matched)):
        return _unshown(statistics, channel, what, shown, asked)
    if used(swap) and ignored(matched):
        return _pose(statistics, channel, shown, asked)
    if used(swap) and used(matched):
        return _content(statistics, channel, f"{shown}, and {share(matched)} where the state is alike", asked)
    why = _why_open(swap, matched, asked.without(f"matched@{channel}"))
    return Judged("undecided", sentence(f"{shown}: {why}"), f"T.swapped@{channel}")


def _unshown(statistics: Statistics, channel: str, what: str, shown: str, asked: Asked) -> Judged:
    """Return the label of pictures that may be another episode's: whether they have to be there at all."""
    grey = "blank" if channel == "cameras" else f"blank@{channel.partition(':')[2]}"
    blank = statistics.get(f"T.{grey}")
    if ignored(blank):
        words = f"{what} could be unplugged{_unnoticed(statistics, channel)} ({shown}; grey pictures {share(blank)})"
        gone = Judged("ignores_camera", sentence(words), f"T.swapped@{channel}")
        return _absent(gone, statistics, "responds", channel, f"{shown}, and grey pictures {share(blank)}", asked)
    if used(blank):
        words = f"{shown}, but grey pictures {share(blank)}: that there is a picture matters, not which of these it is"
        there = Judged("camera_presence", sentence(words), f"T.{grey}")
        return _absent(
            there, statistics, "responds.shown", channel, f"{shown}, but grey pictures {share(blank)}", asked
        )
    why = asked.without(grey) or (f"grey ones change {share(blank)}" if settled(blank) else why_open(blank))
    words = f"{shown}; whether a picture must be there is open: {why}"
    return Judged("undecided", sentence(words), f"T.{grey}")


def _unnoticed(statistics: Statistics, channel: str) -> str:
    """Return that nobody would notice, of who answers alike to the same and of whose episodes none responds."""
    one = statistics.get(f"responds@{channel}")
    swap = statistics.get(f"T.swapped@{channel}")
    drawn = swap is not None and swap.p is not None
    return "" if drawn or (one is not None and one.value) else " without anybody noticing"


def _pose(statistics: Statistics, channel: str, shown: str, asked: Asked) -> Judged:
    """Return the label of pictures that are used, and not at a similar state.

    A bank may hold such moments in a part of its states only. So any other episode's picture must be used in these
    same moments too.
    """
    swap, matched = (statistics[f"T.{name}@{channel}"] for name in ("swapped", "matched"))
    there = statistics.get(f"swapped.alike@{channel}", swap)
    few = "" if matched.n == swap.n else f" ({matched.n} of {swap.n} moments have one)"
    words = f"{shown}, but of another episode at a similar state{few} only {share(matched)}"
    if not used(there):
        why = f"in these moments any other episode's changes {share(there)}, so that what it uses elsewhere is open"
        return Judged("undecided", sentence(f"{words}; {why}"), f"swapped.alike@{channel}")
    rest = "; of the other moments nothing is said" if few else ""
    pose = Judged("pose_only", sentence(f"{words}: it reads what its state tells too{rest}"), f"T.matched@{channel}")
    return _absent(pose, statistics, "responds.alike", channel, words, asked)


def _content(statistics: Statistics, channel: str, shown: str, asked: Asked) -> Judged:
    """Return the label of pictures whose content decides: whether the object in them is followed, is of all cameras.

    A picture of the own episode, as far off in its state as the matched one, or farther, takes the claim away where it
    changes as much, or was not asked; not from who follows an object that is moved, or answers to objects whose colours
    are exchanged, while the state stays.
    """
    plain = Judged("camera_content", sentence(shown), f"T.matched@{channel}")
    gain = None if channel != "cameras" else statistics.get("follow.named")
    beyond, near = statistics.get(f"beyond@{channel}"), f"near@{channel}"
    colours = _exchanged(statistics, channel)
    also = "" if colours is None else f"; the objects' colours exchanged change {share(colours)}"
    if (still := _never_moved(beyond)) and not (used(colours, COLOURED) or followed(gain, FOLLOWED)):
        never = "which never changes within an episode"
        shown = f"{shown}; what the picture tells of {still} of the state, {never}, counts too"
        plain = replace(plain, because=sentence(shown))
    if used(beyond) or used(colours, COLOURED) or followed(gain, FOLLOWED):
        return plain if channel != "cameras" else _grounded(plain, statistics, shown, asked)
    if beyond is not None and beyond.value is not None and enough(beyond):
        own = f"one of its own episode, as far off in its state or farther, {share(statistics.get(f'T.{near}'))}"
        apart = f"that it is more is not settled ({way(beyond)} more)"
        why = f"{lost(beyond) or f'{own}, and {apart}'}{also}: it may read its own pose"
        return Judged("undecided", sentence(f"{shown}; but {why}"), f"beyond@{channel}")
    if why := asked.without(near) or ("" if beyond is None else why_open(beyond)):
        why = f"without a picture of its own episode it may read its own pose: {why}{also}"
        return Judged("undecided", sentence(f"{shown}; {why}"), f"beyond@{channel}")
    return plain if channel != "cameras" else _grounded(plain, statistics, shown, asked)


def _never_moved(beyond: Statistic | None) -> str:
    """Return in words which numbers of the state no picture of the own episode shows otherwise."""
    still = ((beyond.detail if beyond is not None else None) or {}).get("still")
    return ", ".join(map(str, still)) if isinstance(still, list) else ""


def _grounded(plain: Judged, statistics: Statistics, shown: str, asked: Asked) -> Judged:
    """Return the label of cameras whose content decides: whether it goes where the object that is named goes."""
    gain, control = statistics.get("follow.named"), "follow.told"
    forgot = asked.forgot(*_moves(), *_moves("told_"))
    if (gain is None or gain.value is None) or forgot:
        why = f"{forgot or 'the bank moves no object'}, so whether it is followed is open"
        return replace(plain, why_not=why, may_be="object_grounded")
    if (told := statistics.get(control)) is None or told.value is None:
        control = "follow.rather"
    if not followed(gain, FOLLOWED):
        why = f"the moved object is followed {way(gain)} of the oracle's way; {unfollowed(gain)}"
        return replace(plain, why_not=why, may_be="object_grounded" if may_follow(gain) else "")
    rather = statistics.get(control)
    half = rather is not None and 2 * (rather.value or 0.0) >= (gain.value or 0.0)
    if not (followed(rather, BECAUSE) and half):
        open_ = unfollowed(rather) if half else "that is less than half of it"
        apart = f"where it is named an object is followed {way(rather)} of the oracle's way farther; {open_}"
        why = f"that it is followed because it is named is not shown: {apart}"
        return replace(plain, why_not=why, may_be="object_grounded" if may_follow(rather) else "")
    if part := _partly(statistics.get("follow.rather")):
        why = f"the named object is followed {way(gain)} of the oracle's way, but {part}"
        return replace(plain, why_not=why, may_be="object_grounded")
    heading = (gain.detail or {}).get("heading")
    if isinstance(heading, float) and heading < HEADING:
        off = math.degrees(math.acos(max(-1.0, heading)))
        why = (
            f"its way is {off:.0f} degrees off that of the moved object, and goes {way(gain)} of the oracle's along it"
        )
        return replace(plain, why_not=why)
    words = (
        f"{shown}; moved, the named object is followed {way(gain)} of the oracle's way (p {gain.p:.4f}), and "
        f"{way(rather)} farther than where another is named"
    )
    return Judged("object_grounded", sentence(words), "follow.named")


def _partly(rather: Statistic | None) -> str:
    """Return in words of what that was told, or along which axis, the named object is followed less than on the mean.

    The mean over all is no claim about each: who goes to one block and not to the other has half of it.
    """
    parts = ((rather.detail if rather is not None else None) or {}).get("parts")
    if rather is None or rather.value is None or rather.value <= 0 or not isinstance(parts, Mapping) or not parts:
        return ""
    where, least = min(parts.items(), key=lambda one: float(one[1]["at_most"]))
    if least["at_most"] >= EVENLY * rather.value:
        return ""
    far, whole = (f"{100 * one:.0f} %" for one in (least["value"], rather.value))
    return f"{where} it is followed only {far} farther than the other, and {whole} on the whole"


def _moves(told: str = "") -> Iterator[str]:
    """Yield the conditions that move an object, ``told`` another instruction."""
    return (f"{told}{which}_{side}" for which in ("named", "other") for side in ("plus", "minus"))


def _exchanged(statistics: Statistics, channel: str) -> Statistic | None:
    """Return the share that goes with the objects' colours in these pictures, at the same state."""
    return statistics.get("T.exchanged" if channel == "cameras" else f"T.exchanged@{channel.partition(':')[2]}")


def judge_state(statistics: Statistics, camera: str, *, there: bool, asked: Asked = EVERYTHING) -> Judged:
    """Return the label of the state, where the bank has one; ``camera`` is that of all cameras."""
    if not there:
        return Judged("undecided", "The bank has no state.")
    swap, by = statistics.get("T.swapped@state"), "T.swapped@state"
    if swap is None or swap.value is None:
        why = asked.without("swapped@state") or why_open(swap)
        return Judged("undecided", sentence(f"its state cannot be judged: {why}"), by)
    shown, reads = f"its state carries {of_action(swap)}", statistics.get("reads@state")
    if reads is not None and reads.value is not None:
        if ignored(reads):
            swap, by = reads, "reads@state"
            shown = f"its answers are places, and change by {share(reads)} with its state"
        elif why := _of_places(swap, reads):
            return Judged("undecided", sentence(f"{shown}; but {why}"), "reads@state")
    if ignored(swap):
        return _absent(Judged("ignores_state", sentence(shown), by), statistics, "responds", "state", shown, asked)
    if not used(swap):
        return Judged("undecided", sentence(f"{shown}: {why_open(swap)}"), by)
    return _needed(statistics, camera, shown, by)


def _needed(statistics: Statistics, camera: str, shown: str, by: str) -> Judged:
    """Return the label of a state that is used: alone, where the cameras are ignored."""
    if camera != "ignores_camera":
        return Judged("state_used", sentence(shown), by)
    told = statistics.get("T.swapped@instruction")
    also = f"; another instruction changes {of_action(told)}" if used(told) else ""
    short = Judged("state_shortcut", sentence(f"{shown}, and its cameras next to nothing{also}"), by)
    return _bounded(short, statistics.get("responds@cameras"))


def _of_places(swap: Statistic, reads: Statistic) -> str:
    """Return in words what places tell of the state that they are measured relative to, against its own share.

    A place that stays is another motion relative to another state, and one that goes along with it is the same.
    """
    if ignored(swap):
        return (
            f"its answers are places that go along with it ({share(reads)}): it reads it, and does the same from there"
        )
    if used(swap) and not used(reads):
        own = "relative to another state the same place is another motion"
        return f"its answers are places, and as they are change by {share(reads)} with it: {own}"
    return ""


def judge_instruction(statistics: Statistics, asked: Asked = EVERYTHING) -> Judged:
    """Return the label of the instruction."""
    swap, by = statistics.get("T.swapped@instruction"), "T.swapped@instruction"
    if (forgot := asked.forgot("swapped@instruction")) or (swap is not None and swap.value is None):
        return Judged("undecided", sentence(f"what it is told cannot be judged: {forgot or why_open(swap)}"), by)
    if swap is None:
        why = asked.without("swapped@instruction")
        return Judged("no_power", sentence(why or "no two episodes of the bank are told different things"))
    texts = (swap.detail or {}).get("texts")
    other = "" if not isinstance(texts, list) else f" (most often {quoted(texts[1])} for {quoted(texts[0])})"
    shown = f"another instruction{other} changes {of_action(swap)}"
    told = statistics.get("follow.told")
    forgot = asked.forgot(*_moves(), *_moves("told_")) or lost(told)
    if (used(swap) or ignored(swap)) and forgot:
        return Judged("undecided", sentence(f"{shown}; whether it goes to what is named is open: {forgot}"), by)
    if ignored(swap) and not followed(told, HEARD):
        unheard = Judged("instruction_ignored", sentence(shown), by)
        return _absent(unheard, statistics, "responds", "instruction", shown, asked)
    if used(swap):
        return _heard(statistics, shown)
    but = f", but it follows what is named {share(told)} of the oracle's way more than what is not"
    why, by = (but, "follow.told") if ignored(swap) else (f": {why_open(swap)}", by)
    return Judged("undecided", sentence(f"{shown}{why}"), by)


def _heard(statistics: Statistics, shown: str) -> Judged:
    """Return the label of an instruction that changes the action: whether towards what is named."""
    told = statistics.get("follow.told")
    if followed(told, HEARD):
        words = f"{shown}, and it follows what is named {way(told)} of the oracle's way more than what is not"
        return Judged("instruction_followed", sentence(words), "follow.told")
    if opposed(told):
        why = f"it goes away from what is named or to what is not, {way(told)} of the oracle's way"
        return Judged("undecided", sentence(f"{shown}, but {why}: it may take one name for the other"), "follow.told")
    if any(followed(statistics.get(f"follow.{which}"), FOLLOWED) for which in ("named", "other")):
        why = f"it follows what is named only {way(told)} of the oracle's way more; {unfollowed(told)}"
        return Judged("undecided", sentence(f"{shown}, but {why}"), "follow.told")
    return _by_the_log(statistics, shown)


def _by_the_log(statistics: Statistics, shown: str) -> Judged:
    """Return the label of an instruction that changes the action where no object is followed, or none is moved.

    Its own instruction has to bring it nearer to what was logged than another one does. Where nobody can say whether it
    does, and nothing is moved, the label stands, and it is said what is not tested.
    """
    told, logged = statistics.get("follow.told"), statistics.get("follow.logged")
    moved = told is not None and told.value is not None
    nearer = f"its own brings it nearer to what was logged by {way(logged)} of what both differ by"
    if opposed(logged):
        return Judged("undecided", sentence(f"{shown}, but {nearer}: the other way"), "follow.logged")
    if followed(logged, HEARD) or (not moved and _surely_above(logged, HEARD)):
        what = "that it follows an object is not shown" if moved else "the bank moves no object"
        open_ = f"whether it goes to what is named is open: {what}"
        return Judged("instruction_followed", sentence(f"{shown}, and {nearer}"), "follow.logged", open_)
    if moved:
        why = f"it follows what is named only {way(told)} of the oracle's way more than what is not"
        also = "" if logged is None or logged.value is None else f", and {nearer}; {unfollowed(logged)}"
        return Judged("undecided", sentence(f"{shown}, but {why}{also}"), "follow.told")
    if logged is not None and logged.value is not None:
        why = f"{nearer}; {unfollowed(logged)}: that it changes towards what it is told is not shown"
        return Judged("undecided", sentence(f"{shown}, but {why}"), "follow.logged", may_be="instruction_followed")
    why = "whether it does what it is told is not tested: the bank moves no object, and has no log to be held against"
    return Judged("instruction_followed", sentence(f"{shown}; {why}"), "T.swapped@instruction", why)


def _surely_above(one: Statistic | None, least: float) -> bool:
    """Return whether an interval is above a margin, of calls of which nearly all came back."""
    return one is not None and one.ci is not None and not lost(one) and one.ci[0] > least


def _absent(
    found: Judged, statistics: Statistics, claim: str, channel: str, shown: str, asked: Asked = EVERYTHING
) -> Judged:
    """Return a label of absence, bounded; undecided where a part of the answer, or another picture, shows a use.

    So it is where the run did not ask what may show one, and where more of its episodes respond than may. ``shown`` are
    the shares that the label rests on, in words.
    """
    every = [f"T.{name}" for name in rests_on(claim, channel)]
    parts = {part: one for name in every for part, one in carried(statistics.get(name)).items()}
    if parts:
        said = ", ".join(f"{part} (T {one:.2f})" for part, one in list(parts.items())[:4])
        why = f"that is the mean over all numbers, and some go with it: {said}"
        return Judged("undecided", sentence(f"{shown}; but {why}"), found.by)
    if other := next(_contrary(statistics, claim, channel), "") or _otherwise(statistics, every):
        return Judged("undecided", sentence(f"{shown}; but {other}"), found.by)
    if forgot := asked.forgot(*dict.fromkeys(_controls(statistics, claim, channel, asked))):
        return Judged("undecided", sentence(f"{shown}; whether other pictures show a use is open: {forgot}"), found.by)
    one, noise = statistics.get(f"{claim}@{channel}"), statistics.get("noise")
    still = noise is not None and noise.value is not None and noise.value < LEAST_NOISE
    exact = still or all(_exact(statistics.get(name)) for name in every)
    if exact and one is not None and one.value is not None and one.value > OF_DATA_SET:
        some = f"{round(one.value * one.n)} of {one.n} episodes each respond by {IGNORED:.2f} of the variation or more"
        return Judged("undecided", sentence(f"{shown}; but that is the mean, and {some}"), found.by)
    return _bounded(found, one)


def _otherwise(statistics: Statistics, every: Sequence[str]) -> str:
    """Return in words what the mean answer at one seed does not tell: how answers scatter, and those to other seeds."""
    for name in every:
        one = statistics.get(name)
        detail = (one.detail if one is not None else None) or {}
        size, p = detail.get("scatter"), detail.get("scatter_p")
        if isinstance(size, float) and isinstance(p, float) and size > USED and p <= ALPHA:
            what = f"how its answers scatter changes, by {size:.0%} of the variation (p {p:.4f})"
            return f"that is their mean, and {what}"
    noise = statistics.get("noise")
    if noise is not None and (noise.detail or {}).get("seeds") and (noise.value or 0.0) >= IGNORED:
        return f"that is at one seed, and another seed changes {of_action(noise)}: ask it without 'seedable' too"
    return ""


def _exact(one: Statistic | None) -> bool:
    """Return whether a share is of answers that are not drawn: single episodes of these respond, and not by chance."""
    return one is None or one.p is None


def _controls(statistics: Statistics, claim: str, channel: str, asked: Asked) -> Iterator[str]:
    """Yield the conditions that `_contrary` looks at."""
    if channel in {"state", "instruction"}:
        return
    if channel != "cameras":
        yield f"exchanged@{channel.partition(':')[2]}"
        return
    yield from OF_ITS_WORLD
    yield from _moves()
    for single in (*_singles(statistics), *_unasked_singles(asked)):
        yield from rests_on(claim, single)


def _unasked_singles(asked: Asked) -> list[str]:
    """Return the single cameras that the bank could exchange and the run did not ask."""
    return [name.partition("@")[2] for name in sorted(asked.unasked) if name.startswith("swapped@camera:")]


def _singles(statistics: Statistics) -> list[str]:
    """Return the single cameras of which there are shares."""
    return [name.removeprefix("T.swapped@") for name in statistics if name.startswith("T.swapped@camera:")]


def _contrary(statistics: Statistics, claim: str, channel: str) -> Iterator[str]:
    """Yield in words which other pictures carry as much as must not be ignored, so that no absence is said.

    Noise is none of them: no robot is shown noise, and who ignores what it is shown may answer to it. What is drawn in
    the pictures of all cameras, which are ignored otherwise, may have been seen through any of them.
    """
    if channel in {"state", "instruction"}:
        return
    single = channel != "cameras"
    if single and _carries(one := _exchanged(statistics, channel)):
        yield f"{OF_ITS_WORLD['exchanged']} change {of_action(one)}"
    drawn = dict(OF_ITS_WORLD) if not single or _unused(statistics.get("T.swapped@cameras")) else {}
    if _exchanged(statistics, channel) is not None and single:
        drawn.pop("exchanged", "")
    for name, what in drawn.items():
        if _carries(one := statistics.get(f"T.{name}")):
            yield f"{what} change {of_action(one)}{', by whichever camera' if single else ''}"
    if not single:
        yield from _in_part(statistics, claim)


def _in_part(statistics: Statistics, claim: str) -> Iterator[str]:
    """Yield in words which objects are followed, and which single camera carries what all together do not."""
    for which in ("named", "other"):
        if followed(one := statistics.get(f"follow.{which}"), FOLLOWED):
            yield f"an object that is moved in the picture is followed {way(one)} of the oracle's way"
    for single in _singles(statistics):
        for one in (statistics.get(f"T.{condition}") for condition in rests_on(claim, single)):
            if _carries(one):
                yield f"the {single.partition(':')[2]} camera alone carries {of_action(one)} while the others are there"


def _unused(one: Statistic | None) -> bool:
    return ignored(one) and not used(one)


def _carries(one: Statistic | None) -> bool:
    """Return whether a share is used, and no less than what may be ignored."""
    return used(one) and not ignored(one)


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


def _why_open(swap: Statistic | None, matched: Statistic | None, lacks: str) -> str:
    """Return why no label of a camera is said; ``lacks`` is why nothing is matched, where the bank cannot."""
    if not (used(swap) or ignored(swap)):
        return why_open(swap)
    if matched is None or matched.value is None:
        why = lacks or (matched.note if matched is not None else "")
        return f"whether it tells more than the pose is open: {why or 'the bank has no state to match by'}"
    bounds = f"neither above {USED} nor below {IGNORED}" if used(swap) else f"not below {IGNORED}"
    return f"where the state is alike it is {share(matched)}, {lost(matched) or bounds}"
