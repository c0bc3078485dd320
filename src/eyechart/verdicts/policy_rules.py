"""The rules of each axis of a policy: all cameras, one camera, the state and the instruction.

Why these rules: docs/decisions/policies.md.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache

from eyechart.records import to_json_fields
from eyechart.stats.risk_bounds import episodes_needed
from eyechart.stats.shares import FollowedShare, Share
from eyechart.stats.statistic import Statistic
from eyechart.verdicts.rules import WORDS, Axis, Clause, Reading, Rule, compared, fail, missing, there, word
from eyechart.verdicts.ruling import Ruling
from eyechart.verdicts.share_predicates import (
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
    MissingConditions,
    ShareStatistics,
    Statistics,
    bounded,
    carrying,
    condition_run,
    disuse,
    following,
    is_conclusive,
    is_used,
    lossy,
    may_exceed,
    measured,
    measured_clauses,
    of_action,
    quote,
    sentence,
    share,
    undecided,
    use,
    way,
)

OF_DATA_SET = 0.10
"""An absence holds of the data set where fewer than this share of its episodes may respond."""
SURENESS = 0.99
"""The confidence of that bound."""
OF_ITS_WORLD: Mapping[str, str] = {
    "exchanged": "the objects' colours exchanged",
    "recoloured": "other colours of the table",
    "decoys": "further objects",
}
"""Other pictures of the same moment, and what they show."""
RESPONDS: Mapping[str, tuple[str, ...]] = {
    "responds": ("swapped", "matched", "blank"),
    "responds.shown": ("swapped", "matched"),
    "responds.alike": ("matched",),
}
"""The conditions of each claim of absence, by the statistic that counts responding episodes.

The claims: the channel is ignored; pictures only have to be there; they tell no more than the
state.
"""


def condition_of(name: str, channel: str) -> str:
    """Return the name of a condition of a channel; grey and recoloured pictures go by the camera's."""
    if name not in {"blank", "exchanged"}:
        return f"{name}@{channel}"
    return name if channel == "cameras" else f"{name}@{channel.partition(':')[2]}"


def rests_on(claim: str, channel: str) -> Iterator[str]:
    """Yield the conditions of a channel that a claim of `RESPONDS` rests on."""
    for name in RESPONDS[claim]:
        if name != "blank" or channel.startswith("camera"):
            yield condition_of(name, channel)


@dataclass(frozen=True, slots=True)
class AxisVerdict:
    """A label on one axis, why, the statistic that decided it, and why it is no stronger one.

    Of an absence, ``responds`` is the share of episodes that respond, with its interval for the
    data set. ``may_be`` is a stronger label that the run neither gives nor refutes.
    ``may_be_unconnected``: the channel changes not one bit of any answer, so that the policy may
    never have been given it.
    """

    label: str
    because: str
    by: str = ""
    why_not: str = ""
    responds: Statistic | None = None
    may_be: str = ""
    may_be_unconnected: bool = False

    @property
    def of_data_set(self) -> str:
        """Return the label for the whole data set; ``undecided`` if too many may respond."""
        bound = None if self.responds is None else self.responds.ci
        return "undecided" if bound is not None and bound[1] >= OF_DATA_SET else self.label

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values; ``data_set`` bounds an absence for the whole data set."""
        found = to_json_fields(self, "label because by why_not")
        if self.responds is None or self.responds.ci is None:
            return found
        episodes = {"episodes": self.responds.n, "responding": _count(self.responds)}
        bound = {"share_at_most": self.responds.ci[1], "confidence": SURENESS, "wanted": OF_DATA_SET}
        return {**found, "data_set": {"label": self.of_data_set, **episodes, **bound}}


_GAIN, _TOLD, _RATHER, _LOG = "follow.named", "follow.told", "follow.rather", "follow.logged"
_HEARS, _STATE = "T.swapped@instruction", "T.swapped@state"
_MOVES = tuple(f"{which}_{side}" for which in ("named", "other") for side in ("plus", "minus"))
_ALL_MOVES = (*_MOVES, *(f"told_{name}" for name in _MOVES))
_FORGOT_MOVES = f"forgot:{','.join(_ALL_MOVES)}"
_DRAWN = (Reading("low", ">", COLOURED), Reading("p", "missing"))
"""Where answers are drawn, an open use counts from here on: it is a further chance to err.

With the margin of a use it was untrue in .0144 of 5000 data sets (noise 1, two answers), and with
this one in .0088.
"""
CameraNames = tuple[tuple[str, ...], tuple[str, ...]]
"""The single cameras that have shares, and those that the run left out."""


def _absence(rule: Rule, claim: str, channel: str, shown: str, beside: CameraNames = ((), ())) -> Iterator[Rule]:
    """Yield a rule of absence after the rules that take it away.

    These are: a part of the answer or another picture shows a use, a control was not run, or too
    many episodes respond. ``shown`` has the shares that the label rests on, in words.
    """
    rests, bound = tuple(f"T.{name}" for name in rests_on(claim, channel)), f"{claim}@{channel}"

    def unless(sentence: str, *broken: Clause, needs: tuple[Clause, ...] = ()) -> Rule:
        return undecided(rule.decided_by, (*rule.needs, *needs), f"{shown}; {sentence}", *broken)

    parts = f"{{parts:{','.join(rests)}}}"
    yield unless(f"but that is the mean over all numbers, and some go with it: {parts}", *map(_no_part, rests))
    for needs, broken in _against(claim, channel, beside[0]):
        yield unless("but {but}", *broken, needs=needs)
    yield unless("but that is their mean, and {but}", *map(_no_scatter, rests))
    seeds = (there("noise", "seeds"), compared("noise", "value", ">=", IGNORED))
    other = "but that is at one seed, and another seed changes {of_action:noise}: ask it without 'seedable' too"
    yield unless(other, needs=seeds)
    if controls := _controls(claim, channel, (*beside[0], *beside[1])):
        open_ = f"whether other pictures show a use is open: {{forgot:{','.join(controls)}}}"
        yield unless(open_, *map(condition_run, controls))
    for exact in ((compared("noise", "value", "<", LEAST_NOISE),), tuple(map(missing, rests))):
        some = (*exact, compared(bound, "value", ">", OF_DATA_SET))
        yield unless(f"but that is the mean, and {{responding:{bound}}}", needs=some)
    yield replace(rule, bound=bound)


def _no_part(name: str) -> Clause:
    """Return the condition that no single number or step of the answer goes with a channel."""
    return Clause(name, (Reading("carried", "missing"), Reading("p", ">", ALPHA, otherwise=False)))


def _parts(found: ShareStatistics, names: str) -> str:
    rests = [name for name in names.split(",") if not _no_part(name).holds(found)]
    carried = {part: size for name in rests for part, size in (found[name].carried or {}).items()}
    return ", ".join(f"{part} (T {size:.2f})" for part, size in list(carried.items())[:4])


def _no_scatter(name: str) -> Clause:
    """Return the condition that answers scatter as they do otherwise."""
    scatter = Reading("scatter", "<=", USED, otherwise=True), Reading("scatter_p", ">", ALPHA, otherwise=True)
    return Clause(name, scatter, "how its answers scatter changes, by {scatter}")


def _against(claim: str, channel: str, singles: tuple[str, ...]) -> Iterator[tuple[tuple[Clause, ...], list[Clause]]]:
    """Yield what speaks against an absence: needs, and clauses of which one then fails.

    Noise is none of them: no robot is shown noise, and a policy that ignores its pictures may
    answer to it. What is drawn in the pictures of all cameras may have been seen through any of
    them.
    """
    if channel in {"state", "instruction"}:
        return
    drawn = {name: (f"T.{name}", f"{what} change {{of_action}}") for name, what in OF_ITS_WORLD.items()}
    if channel != "cameras":
        own, whole = f"T.{condition_of('exchanged', channel)}", "T.swapped@cameras"
        unused = (*disuse(whole), fail(use(whole)))
        yield (), [fail(carrying(own), drawn["exchanged"][1])]
        seen = [fail(carrying(name), f"{but}, by whichever camera") for name, but in drawn.values()]
        yield (*unused, measured(own, holds=False)), seen[:1]
        yield unused, seen[1:]
        return
    moved = "an object that is moved in the picture is followed {way} of the oracle's way"
    followed = [fail(following(f"follow.{which}", FOLLOWED), moved) for which in ("named", "other")]
    alone = [
        (f"T.{name}", f"the {one.partition(':')[2]} camera alone carries {{of_action}} while the others are there")
        for one in singles
        for name in rests_on(claim, one)
    ]
    seen, single = ([fail(carrying(name), but) for name, but in some] for some in (drawn.values(), alone))
    yield (), [*seen, *followed, *single]


def _controls(claim: str, channel: str, singles: tuple[str, ...]) -> tuple[str, ...]:
    if channel != "cameras":
        return (condition_of("exchanged", channel),) if channel.startswith("camera:") else ()
    return tuple(
        dict.fromkeys((*OF_ITS_WORLD, *_MOVES, *(name for single in singles for name in rests_on(claim, single))))
    )


@dataclass(frozen=True)
class _CameraRules:
    """The rules of all cameras together, or of one."""

    channel: str
    what: str
    beside: CameraNames

    def share(self, name: str) -> str:
        """Return the name of a share of this camera."""
        return f"T.{condition_of(name, self.channel)}"

    @property
    def swap(self) -> str:
        """Return the name of the share that goes with another episode's pictures."""
        return self.share("swapped")

    @property
    def shown(self) -> str:
        """Return that share in words."""
        return f"{self.what} {'carry' if self.what.endswith('cameras') else 'carries'} {{of_action:{self.swap}}}"

    @property
    def seen(self) -> str:
        """Return that share and the one at a similar state in words."""
        return f"{self.shown}, and {{share:{self.share('matched')}}} where the state is alike{{still:{self.channel}}}"

    def axis(self) -> Axis:
        """Return its rules.

        Where pictures are used, and the run left nothing out, what is open is what for.
        """
        swap, matched, alike = self.swap, self.share("matched"), f"matched@{self.channel}"
        open_ = f"{self.what} cannot be judged: {{without:swapped@{self.channel}|why_open:{swap}}}"
        rules = (
            undecided(swap, (missing(swap, "value"),), open_),
            undecided(swap, (), f"{self.shown}; {{forgot:{alike}}}", condition_run(alike)),
            *self.unshown(),
            *self.used(self.pose((*use(swap), *disuse(matched)))),
            *self.used(self.content((*use(swap), *use(matched)))),
            *self.used(self.open()),
        )
        return Axis(self.channel, rules)

    def used(self, rules: Iterator[Rule]) -> Iterator[Rule]:
        """Yield rules, and before each of what is open one by which pictures are used all the same."""
        firm = (*use(self.swap), Clause(self.swap, _DRAWN))
        for rule in rules:
            forgotten = any(one.statistic.startswith("asked.") for one in rule.broken)
            if rule.label == "undecided" and not forgotten:
                yield replace(rule, label="uses_camera", needs=(*rule.needs, *firm))
            yield rule

    def unshown(self) -> Iterator[Rule]:
        """Yield the rules of pictures that may be another episode's, or none."""
        grey, needs = self.share("blank"), (*disuse(self.swap), *disuse(self.share("matched"), may_lack=True))
        shown = f"{self.shown}, and grey pictures change {{share:{grey}}}"
        words = f"{shown}: both are below {IGNORED}{{responds:{self.channel}}}"
        gone = Rule("ignores_camera", self.swap, (*needs, *disuse(grey)), words)
        yield from _absence(gone, "responds", self.channel, shown, self.beside)
        shown = f"{self.shown}, but grey pictures change {{share:{grey}}}"
        says = f"{shown}: that there is a picture matters, and which of these it is hardly does"
        there_ = Rule("camera_presence", grey, (*needs, *use(grey)), says)
        yield from _absence(there_, "responds.shown", self.channel, shown, self.beside)
        open_ = f"{{without:{grey.removeprefix('T.')}|settled:{grey}|why_open:{grey}}}"
        yield undecided(grey, needs, f"{self.shown}; whether a picture must be there is open: {open_}")

    def pose(self, needs: tuple[Clause, ...]) -> Iterator[Rule]:
        """Yield the rules of pictures that are used, and not at a similar state.

        A bank may hold such moments for some states only, so the swapped picture must have an
        effect in them too.
        """
        matched, alike = self.share("matched"), f"swapped.alike@{self.channel}"
        few, only = f"{{few:{self.channel}}}", f"changes only {{share:{matched}}}"
        shown = f"{self.shown}, but a picture of another episode at a similar state{few} {only}"
        why = f"in these moments any other episode's changes {{share:{alike}}}, so that what it uses elsewhere is open"
        yield undecided(alike, (*needs, measured(alike), fail(use(alike))), f"{shown}; {why}")
        pose = Rule("pose_only", matched, needs, f"{shown}: it reads what its state tells too{{rest:{self.channel}}}")
        yield from _absence(pose, "responds.alike", self.channel, shown, self.beside)

    def content(self, needs: tuple[Clause, ...]) -> Iterator[Rule]:
        """Yield the rules of pictures whose content decides.

        The claim is withdrawn if a picture of the same episode, at least as far off in its state,
        changes as much or was not asked. It stays where the state stays and the policy follows a
        moved object or exchanged colours.
        """
        beyond, near = f"beyond@{self.channel}", f"near@{self.channel}"
        unseen = (*needs, fail(use(beyond)), *map(fail, _proofs(self.channel)))
        own = f"{{lost:{beyond}|own:{self.channel}}}{{also:{self.share('exchanged')}}}"
        yield undecided(
            beyond, (*unseen, *measured_clauses(beyond)), f"{self.seen}; but {own}: it may read its own pose"
        )
        why = f"{{without:{near}|why_open:{beyond}}}{{also:{self.share('exchanged')}}}"
        why = f"{self.seen}; without a picture of its own episode it may read its own pose: {why}"
        yield undecided(beyond, unseen, why, condition_run(near))
        yield from (undecided(beyond, (*unseen, measured(name)), why) for name in (f"asked.{near}", beyond))
        plain = Rule("camera_content", self.share("matched"), needs, self.seen)
        if self.channel == "cameras":
            yield from _grounded(plain, self.seen)
        yield plain

    def open(self) -> Iterator[Rule]:
        """Yield the rules of pictures that are neither used nor ignored."""
        swap, matched = self.swap, self.share("matched")
        neither = (fail(use(swap)), fail(disuse(swap)))
        yield undecided(swap, neither, f"{self.shown}: {{why_open:{swap}}}")
        why = f"{{without:matched@{self.channel}|note:{matched}|=the bank has no state to match by}}"
        unmatched = f"{self.shown}: whether it tells more than the pose is open: {why}"
        yield undecided(swap, (missing(matched, "value"),), unmatched)
        shown = f"{self.shown}: where the state is alike it is {{share:{matched}}}, {{lost:{matched}|="
        yield undecided(swap, use(swap), f"{shown}neither above {USED} nor below {IGNORED}}}")
        yield undecided(swap, (), f"{shown}not below {IGNORED}}}")


def _proofs(channel: str) -> tuple[tuple[Clause, ...], ...]:
    """Return the conditions of each proof that more than the robot's own pose is seen."""
    coloured = use(f"T.{condition_of('exchanged', channel)}", COLOURED)
    return (coloured, following(_GAIN, FOLLOWED)) if channel == "cameras" else (coloured,)


def _still(found: ShareStatistics, channel: str) -> str:
    """Return in words which numbers of the state never change within an episode."""
    still = ", ".join(map(str, found[f"beyond@{channel}"].still or ()))
    proven = any(all(clause.holds(found) for clause in proof) for proof in _proofs(channel))
    never = "of the state, which never changes within an episode, counts too"
    return f"; what the picture tells of {still} {never}" if still and not proven else ""


def _few(found: ShareStatistics, channel: str) -> str:
    n, of_all = found[f"T.matched@{channel}"].n, found[f"T.swapped@{channel}"].n
    return "" if n == of_all else f" ({n} of {of_all} moments have one)"


def _own(found: ShareStatistics, channel: str) -> str:
    own = (
        f"a picture of its own episode, as far off in its state or farther, changes {share(found[f'T.near@{channel}'])}"
    )
    return f"{own}, and that another episode's changes more is not settled ({way(found[f'beyond@{channel}'])} more)"


@word
def _exchanged(one: Share) -> str:
    """Return in brackets which instruction most often took the place of which."""
    return f" (most often {quote(one.texts[1])} for {quote(one.texts[0])})" if one.texts else ""


@word
def _hears(one: Share) -> str:
    return f"; another instruction changes {of_action(one)}" if is_used(one) else ""


@word
def _degrees(one: FollowedShare) -> str:
    """Return how many degrees the way of an answer is off that of the moved object."""
    return f"{math.degrees(math.acos(max(-1.0, one.heading or 0.0))):.0f}"


def _responds(found: ShareStatistics, channel: str) -> str:
    """Return that no episode responds, of a policy whose answers are not drawn."""
    drawn, some = found[f"T.swapped@{channel}"].p is not None, found[f"responds@{channel}"].value
    return "" if drawn or some else f", and no episode was found that responds by {IGNORED} or more"


WORDS |= {
    "parts": _parts,
    "still": _still,
    "few": _few,
    "rest": lambda found, channel: "; of the other moments nothing is said" if _few(found, channel) else "",
    "responds": _responds,
    "own": _own,
    "settled": lambda found, name: f"grey ones change {share(found[name])}" if is_conclusive(found[name]) else "",
    "also": lambda found, name: (
        f"; the objects' colours exchanged change {share(found[name])}" if name in found else ""
    ),
    "p": lambda found, name: f"{found[name].p:.4f}",
    "scatter": lambda found, name: f"{found[name].scatter:.0%} of the variation (p {found[name].scatter_p:.4f})",
    "responding": lambda found, name: (
        f"{_count(found[name])} of {found[name].n} episodes each respond by {IGNORED:.2f} of the variation or more"
    ),
}


def _grounded(content: Rule, seen: str) -> Iterator[Rule]:
    """Yield the rules of whether it goes where the object that is named goes."""

    def plain(why_not: str, *needs: Clause, may: bool = False, broken: tuple[Clause, ...] = ()) -> Rule:
        may_be = "object_grounded" if may else ""
        return replace(content, needs=(*content.needs, *needs), why_not=why_not, may_be=may_be, broken=broken)

    words = "so whether it is followed is open"
    yield plain(f"{{{_FORGOT_MOVES}}}, {words}", may=True, broken=tuple(map(condition_run, _ALL_MOVES)))
    yield plain(f"the bank moves no object, {words}", missing(_GAIN, "value"), may=True)
    gain = f"followed {{way:{_GAIN}}} of the oracle's way"
    words, away = f"the moved object is {gain}; {{unfollowed:{_GAIN}}}", fail(following(_GAIN, FOLLOWED))
    yield plain(words, away, may_exceed(_GAIN), may=True)
    yield plain(words, away)
    for given, control in (((there(_TOLD, "value"),), _TOLD), ((), _RATHER)):
        words = "that it is followed because it is named is not shown: where it is named an object is followed"
        words = f"{words} {{way:{control}}} of the oracle's way farther; "
        half = compared(f"half@{control}", "value", "<", 1.0), "that is less than half of it"
        for away, open_ in (half, (fail(following(control, BECAUSE)), f"{{unfollowed:{control}}}")):
            yield plain(f"{words}{open_}", *given, away, may_exceed(control), may=True)
            yield plain(f"{words}{open_}", *given, away)
        part = compared(_RATHER, "evenly", "<", EVENLY)
        yield plain(f"the named object is {gain}, but {{part:{_RATHER}}}", *given, part, may=True)
        off = f"its way is {{degrees:{_GAIN}}} degrees off that of the moved object, and goes {{way:{_GAIN}}}"
        yield plain(f"{off} of the oracle's along it", *given, compared(_GAIN, "heading", "<", HEADING))
        farther = f"{{way:{control}}} farther than where another is named"
        says = f"{seen}; when it is moved, the named object is {gain} (p {{p:{_GAIN}}}), and {farther}"
        yield Rule("object_grounded", _GAIN, (*content.needs, *given), says)


@word
def _part(one: FollowedShare) -> str:
    """Return in words for which instruction, or along which axis, an object is followed least.

    The mean is no claim about each: a policy that goes to one block of two has half of it.
    """
    assert one.least is not None
    where, least = one.least
    far, whole = (f"{100 * (size or 0.0):.0f} %" for size in (least["value"], one.value))
    return f"{where} it is followed only {far} farther than the other, and {whole} on the whole"


@cache
def camera_axis(channel: str, what: str, beside: CameraNames = ((), ())) -> Axis:
    """Return the axis of one camera, or of all; sentences call it ``what``."""
    return _CameraRules(channel, what, beside).axis()


def _of_state() -> Iterator[Rule]:
    """Yield the rules of the state.

    An answer may be a place: relative to another state the same place is another motion, and one
    that goes along is the same motion.
    """
    swap, reads = _STATE, "reads@state"
    yield undecided("", (compared("has_state", "value", "<", 1.0),), "the bank has no state")
    open_ = f"its state cannot be judged: {{without:swapped@state|why_open:{swap}}}"
    yield undecided(swap, (missing(swap, "value"),), open_)
    shown = f"its answers are places, and change by {{share:{reads}}} with its state"
    yield from _absence(Rule("ignores_state", reads, disuse(reads), shown), "responds", "state", shown)
    shown, given = f"its state carries {{of_action:{swap}}}", there(reads, "value")
    along = (
        f"its answers are places that go along with it ({{share:{reads}}}): it reads it, and does the same from there"
    )
    yield undecided(reads, (given, *disuse(swap)), f"{shown}; but {along}")
    stays = (
        f"its answers are places, and as they are change by {{share:{reads}}} with it: relative to another state the"
    )
    yield undecided(reads, (given, *use(swap), fail(use(reads))), f"{shown}; but {stays} same place is another motion")
    yield from _absence(Rule("ignores_state", swap, disuse(swap), shown), "responds", "state", shown)
    yield undecided(swap, (fail(use(swap)),), f"{shown}: {{why_open:{swap}}}")
    blind, short = (
        compared("ignores_camera", "value", ">=", 1.0),
        f"{shown}, and its cameras less than {IGNORED}{{hears:{_HEARS}}}",
    )
    yield Rule("state_shortcut", swap, (blind,), short, bound="responds@cameras")
    yield Rule("state_used", swap, (), shown)


def _of_instruction() -> Iterator[Rule]:
    swap, shown = _HEARS, f"another instruction{{exchanged:{_HEARS}}} changes {{of_action:{_HEARS}}}"
    open_ = f"what it is told cannot be judged: {{forgot:swapped@instruction|why_open:{swap}}}"
    yield undecided(swap, (), open_, condition_run("swapped@instruction"))
    yield undecided(swap, (measured(swap), missing(swap, "value")), open_)
    why = "{without:swapped@instruction|=no two episodes of the bank are told different things}"
    yield Rule("no_power", "", (missing(swap, "value"),), why)
    open_ = f"{shown}; whether it goes to what is named is open: {{{_FORGOT_MOVES}|lost:{_TOLD}}}"
    for known in (use(swap), disuse(swap)):
        yield undecided(swap, known, open_, *map(condition_run, _ALL_MOVES))
        yield undecided(swap, (*known, lossy(_TOLD)), open_)
    unheard = Rule("instruction_ignored", swap, (*disuse(swap), fail(following(_TOLD, HEARD))), shown)
    yield from _absence(unheard, "responds", "instruction", shown)
    yield from _heard(use(swap), shown)
    follows = f"it follows what is named {{share:{_TOLD}}} of the oracle's way more than what is not"
    yield undecided(_TOLD, disuse(swap), f"{shown}, but {follows}")
    yield undecided(swap, (), f"{shown}: {{why_open:{swap}}}")


def _heard(needs: tuple[Clause, ...], shown: str) -> Iterator[Rule]:
    """Yield the rules of an instruction that changes the action: whether towards what is named.

    Where no object is followed or moved, its own instruction has to bring it nearer to the log than
    another one does. If there is no log either, the label stands, and its sentence says what was
    not tested.
    """
    label, more = "instruction_followed", f"{{way:{_TOLD}}} of the oracle's way more"
    says = f"{shown}, and it follows what is named {more} than what is not"
    yield Rule(label, _TOLD, (*needs, *following(_TOLD, HEARD)), says)
    back = ("high", "<", 0.0)
    away = f"it goes away from what is named or to what is not, {{way:{_TOLD}}} of the oracle's way"
    yield undecided(_TOLD, (*needs, *bounded(_TOLD, *back)), f"{shown}, but {away}: it may take one name for the other")
    only = f"{shown}, but it follows what is named only {more}"
    for name in (_GAIN, "follow.other"):
        yield undecided(_TOLD, (*needs, *following(name, FOLLOWED)), f"{only}; {{unfollowed:{_TOLD}}}")
    nearer = f"its own brings it nearer to what was logged by {{way:{_LOG}}} of what both differ by"
    yield undecided(_LOG, (*needs, *bounded(_LOG, *back)), f"{shown}, but {nearer}: the other way")
    moved, still, says = there(_TOLD, "value"), missing(_TOLD, "value"), f"{shown}, and {nearer}"
    open_ = "whether it goes to what is named is open: "
    for proof, what in (
        ((moved, *following(_LOG, HEARD)), "that it follows an object is not shown"),
        ((still, *bounded(_LOG, "low", ">", HEARD)), "the bank moves no object"),
    ):
        yield Rule(label, _LOG, (*needs, *proof), says, why_not=f"{open_}{what}")
    only = f"{only} than what is not"
    yield undecided(_TOLD, (*needs, moved, there(_LOG, "value")), f"{only}, and {nearer}; {{unfollowed:{_LOG}}}")
    yield undecided(_TOLD, (*needs, moved), only)
    why = f"{nearer}; {{unfollowed:{_LOG}}}: that it changes towards what it is told is not shown"
    yield replace(undecided(_LOG, (*needs, there(_LOG, "value")), f"{shown}, but {why}"), may_be=label)
    why = "whether it does what it is told is not tested: the bank moves no object, and has no log to be held against"
    yield Rule(label, _HEARS, needs, f"{shown}; {why}", why_not=why)


STATE = Axis("state", tuple(_of_state()))
INSTRUCTION = Axis("instruction", tuple(_of_instruction()))


def judged(ruling: Ruling, *beside: str) -> AxisVerdict:
    """Return a ruling in words; ``beside`` are its sentences, by default its reason.

    An absence is said of the episodes alone where too many of the data set's may respond.
    """
    one, why = ruling.bound, ruling.why_not
    because = " ".join(map(sentence, beside or (ruling.reason,)))
    verdict = AxisVerdict(ruling.label, because, ruling.decided_by, why, may_be=ruling.may_be)
    if one is None or one.value is None or one.ci is None:
        return verdict
    if one.ci[1] < OF_DATA_SET:
        return replace(verdict, responds=one)
    k = _count(one)
    some = f"{k} of {one.n} {'responds' if k == 1 else 'respond'}" if k else f"none of {one.n} responds"
    needed = episodes_needed(OF_DATA_SET, confidence=SURENESS)
    why = (
        f"it is said of these episodes: {some}, so that up to {one.ci[1]:.0%} of the data set's may; "
        f"{needed} episodes of which none does would bound that at {OF_DATA_SET:.0%}"
    )
    return replace(verdict, why_not=why, responds=one)


def _count(statistic: Statistic) -> int:
    return round((statistic.value or 0.0) * statistic.n)


def of_camera(statistics: Statistics, channel: str, what: str, left_out: MissingConditions = EVERYTHING) -> Ruling:
    """Return the ruling on all cameras together, or on one."""
    head = "swapped@camera:"
    singles = tuple(name.removeprefix("T.swapped@") for name in statistics if name.startswith(f"T.{head}"))
    others = tuple(name.partition("@")[2] for name in sorted(left_out.unasked) if name.startswith(head))
    sharestatistics = ShareStatistics(statistics, left_out)
    sharestatistics.update(_halves(sharestatistics))
    return camera_axis(channel, what, (singles, others)).evaluate(sharestatistics)


def _halves(found: ShareStatistics) -> dict[str, Share]:
    """Return by control whether at least half of the following is because the object is named."""
    gain = found[_GAIN].value or 0.0
    return {
        f"half@{name}": Share(float(name in found and 2 * (found[name].value or 0.0) >= gain), 1)
        for name in (_TOLD, _RATHER)
    }


def of_state(statistics: Statistics, camera: str, *, there: bool, left_out: MissingConditions = EVERYTHING) -> Ruling:
    """Return the ruling on the state, where the bank has one; ``camera`` is that of all cameras."""
    blind = camera == "ignores_camera"
    return STATE.evaluate(ShareStatistics(statistics, left_out, has_state=there, ignores_camera=blind))


def of_instruction(statistics: Statistics, left_out: MissingConditions = EVERYTHING) -> Ruling:
    """Return the ruling on the instruction."""
    return INSTRUCTION.evaluate(ShareStatistics(statistics, left_out))
