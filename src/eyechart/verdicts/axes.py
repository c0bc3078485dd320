"""The label of one axis of a policy: its cameras or one of them, its state, its instruction, as rows of clauses.

Source: docs/decisions/0051-what-is-said-of-a-policy.md.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache

from eyechart.records import picked
from eyechart.stats.guarantees import episodes_needed
from eyechart.stats.shares import Followed, Share
from eyechart.stats.statistic import Statistic
from eyechart.verdicts.rules import Axis, Clause, Reading, Rule, compared, fail, missing, there
from eyechart.verdicts.ruling import Ruling
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
    Known,
    Says,
    Statistics,
    Word,
    above,
    asked,
    carrying,
    disuse,
    enough,
    every,
    following,
    lossy,
    lost,
    may_follow,
    measured,
    of,
    of_action,
    opposing,
    quoted,
    saying,
    sentence,
    settled,
    share,
    unfollowed,
    use,
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
        episodes = {"episodes": self.responds.n, "responding": _count(self.responds)}
        bound = {"share_at_most": self.responds.ci[1], "confidence": SURENESS, "wanted": OF_DATA_SET}
        return {**found, "data_set": {"label": self.of_data_set, **episodes, **bound}}


@dataclass(frozen=True)
class _Channel:
    """What the rules of a channel are made of: its name, what a sentence calls it, and the words of its sentences."""

    channel: str
    what: str

    @property
    def say(self) -> Callable[..., Says]:
        """Return what makes the reason of a rule from its sentence."""
        raise NotImplementedError

    @property
    def swap(self) -> str:
        """Return the name of the share that goes with another episode's."""
        return f"T.swapped@{self.channel}"

    def against(self, claim: str) -> Iterator[tuple[tuple[Clause, ...], tuple[Clause, ...]]]:
        """Yield, with what they need, the conditions of which each has to hold where an absence is said."""
        del claim
        yield from ()

    def controls(self, claim: str) -> tuple[str, ...]:
        """Return the conditions that have to be asked for that, of those that the bank can show."""
        del claim
        return ()

    def absence(self, rule: Rule, claim: str, shown: str = "{shown}") -> Iterator[Rule]:
        """Yield a rule of absence behind those that take it away.

        A part of the answer, or another picture, shows a use; the run did not ask what may show one; or more of its
        episodes respond than may. ``shown`` are the shares that the label rests on, in words.
        """
        rests = tuple(f"T.{name}" for name in rests_on(claim, self.channel))
        bound, controls = f"{claim}@{self.channel}", self.controls(claim)

        def unless(words: str, *broken: Clause, needs: tuple[Clause, ...] = (), **more: Word) -> Rule:
            says = self.say(f"{shown}; {words}", **more)
            return Rule("undecided", rule.decided_by, (*rule.needs, *needs), says, broken)

        parts = "but that is the mean over all numbers, and some go with it: {parts}"
        yield unless(parts, *map(_no_part, rests), parts=lambda found: _parts(found, rests))
        for needs, broken in self.against(claim):
            yield unless("but {but}", *broken, needs=needs)
        yield unless("but {but}", *map(_no_scatter, rests))
        other = "but that is at one seed, and another seed changes {noise}: ask it without 'seedable' too"
        yield unless(other, needs=_SEEDS, noise=of(of_action, "noise"))
        forgot = "whether other pictures show a use is open: {forgot}"
        if controls:
            yield unless(forgot, *map(asked, controls), forgot=lambda found: found.forgot(*controls))
        for exact in ((compared("noise", "value", "<", LEAST_NOISE),), tuple(map(missing, rests))):
            some = (*exact, compared(bound, "value", ">", OF_DATA_SET))
            yield unless("but that is the mean, and {some}", needs=some, some=of(_responding, bound))
        yield replace(rule, bound=bound)


_SEEDS = (there("noise", "seeds"), compared("noise", "value", ">=", IGNORED))


def _no_part(name: str) -> Clause:
    """Return the condition that no number or step of the answer goes with a channel although their mean does not."""
    return Clause(name, (Reading("carried", "missing"), Reading("p", ">", ALPHA, otherwise=False)))


def _parts(found: Known, rests: Iterable[str]) -> str:
    carried = {
        part: one
        for name in rests
        if not _no_part(name).holds(found)
        for part, one in (found[name].carried or {}).items()
    }
    return ", ".join(f"{part} (T {one:.2f})" for part, one in list(carried.items())[:4])


def _no_scatter(name: str) -> Clause:
    """Return the condition that answers scatter as they do otherwise, so that their mean tells all."""
    but = "that is their mean, and how its answers scatter changes, by {one.scatter:.0%} of the variation (p {one.scatter_p:.4f})"
    return fail(
        every(name, Reading("scatter", ">", USED, otherwise=False), Reading("scatter_p", "<=", ALPHA, otherwise=False)),
        but,
    )


def _responding(one: Share) -> str:
    return f"{_count(one)} of {one.n} episodes each respond by {IGNORED:.2f} of the variation or more"


@dataclass(frozen=True)
class _Camera(_Channel):
    """The rules of all cameras together, or of one; ``singles`` are the single cameras of which there are shares.

    And ``others`` those which the bank could exchange and the run did not ask.
    """

    singles: tuple[str, ...] = ()
    others: tuple[str, ...] = ()

    @property
    def over(self) -> str:
        """Return what stands behind a condition of this camera alone."""
        return "" if self.channel == "cameras" else f"@{self.channel.partition(':')[2]}"

    def of(self, condition: str) -> str:
        """Return the name of a share of this camera: of the conditions of world and blank by its own name."""
        return f"T.{condition}{self.over}" if condition in {"blank", *OF_ITS_WORLD} else f"T.{condition}@{self.channel}"

    @property
    def say(self) -> Callable[..., Says]:
        """Return what makes the reason of a rule from its sentence."""
        carry = "carry" if self.what.endswith("cameras") else "carries"
        return saying(
            what=lambda _: self.what,
            shown=lambda found: f"{self.what} {carry} {of_action(found[self.swap])}",
            matched=of(share, self.of("matched")),
            grey=of(share, self.of("blank")),
            few=self._few,
            gain=of(way, _GAIN),
            lost=lambda found: lost(found[self.of("matched")]),
        )

    def _few(self, found: Known) -> str:
        n, of_all = found[self.of("matched")].n, found[self.swap].n
        return "" if n == of_all else f" ({n} of {of_all} moments have one)"

    def against(self, claim: str) -> Iterator[tuple[tuple[Clause, ...], tuple[Clause, ...]]]:
        """Yield which other pictures may carry as much as must not be ignored, so that no absence is said.

        Noise is none of them: no robot is shown noise, and who ignores what it is shown may answer to it. What is drawn
        in the pictures of all cameras, which are ignored otherwise, may have been seen through any of them.
        """
        if self.over:
            own, whole = self.of("exchanged"), "T.swapped@cameras"
            unused = (*disuse(whole), fail(use(whole)))
            yield (), (_no_use(own, f"{OF_ITS_WORLD['exchanged']} change {{of_action}}"),)
            drawn = {
                name: _no_use(f"T.{name}", f"{what} change {{of_action}}, by whichever camera")
                for name, what in OF_ITS_WORLD.items()
            }
            yield (*unused, measured(own, holds=False)), (drawn.pop("exchanged"),)
            yield unused, tuple(drawn.values())
            return
        alone = "the {} camera alone carries {{of_action}} while the others are there"
        moved = "an object that is moved in the picture is followed {way} of the oracle's way"
        yield (
            (),
            (
                *(_no_use(f"T.{name}", f"{what} change {{of_action}}") for name, what in OF_ITS_WORLD.items()),
                *(fail(following(f"follow.{which}", FOLLOWED), moved) for which in ("named", "other")),
                *(
                    _no_use(f"T.{name}", alone.format(single.partition(":")[2]))
                    for single in self.singles
                    for name in rests_on(claim, single)
                ),
            ),
        )

    def controls(self, claim: str) -> tuple[str, ...]:
        """Return the conditions that show such pictures."""
        if self.over:
            return (f"exchanged{self.over}",)
        alone = (name for single in (*self.singles, *self.others) for name in rests_on(claim, single))
        return tuple(dict.fromkeys((*OF_ITS_WORLD, *_OWN_MOVES, *alone)))

    def axis(self) -> Axis:
        """Return its rules."""
        swap, matched = self.swap, self.of("matched")
        own, alike = f"swapped@{self.channel}", f"matched@{self.channel}"
        return Axis(
            self.channel,
            (
                Rule(
                    "undecided",
                    swap,
                    (missing(swap, "value"),),
                    self.say("{what} cannot be judged: {why}", why=lambda f: f.without(own) or why_open(f[swap])),
                ),
                Rule(
                    "undecided",
                    swap,
                    says=self.say("{shown}; {forgot}", forgot=lambda f: f.forgot(alike)),
                    broken=(asked(alike),),
                ),
                *self.unshown((measured(matched, holds=False),)),
                *self.unshown(disuse(matched)),
                *self.pose((*use(swap), *disuse(matched))),
                *self.content((*use(swap), *use(matched))),
                *self.open(),
            ),
        )

    def unshown(self, alike: tuple[Clause, ...]) -> Iterator[Rule]:
        """Yield the rules of pictures that may be another episode's: whether they have to be there at all."""
        grey, needs = self.of("blank"), (*disuse(self.swap), *alike)
        words = "{what} could be unplugged{unnoticed} ({shown}; grey pictures {grey})"
        gone = Rule("ignores_camera", self.swap, (*needs, *disuse(grey)), self.say(words, unnoticed=self._unnoticed))
        yield from self.absence(gone, "responds", "{shown}, and grey pictures {grey}")
        shown = "{shown}, but grey pictures {grey}"
        words = f"{shown}: that there is a picture matters, not which of these it is"
        yield from self.absence(
            Rule("camera_presence", grey, (*needs, *use(grey)), self.say(words)), "responds.shown", shown
        )
        words = "{shown}; whether a picture must be there is open: {why}"
        yield Rule("undecided", grey, needs, self.say(words, why=self._presence))

    def _unnoticed(self, found: Known) -> str:
        """Return that nobody would notice, of who answers alike to the same and of whose episodes none responds."""
        drawn, some = found[self.swap].p is not None, found[f"responds@{self.channel}"].value
        return "" if drawn or some else " without anybody noticing"

    def _presence(self, found: Known) -> str:
        grey = found[self.of("blank")]
        open_ = f"grey ones change {share(grey)}" if settled(grey) else why_open(grey)
        return found.without(f"blank{self.over}") or open_

    def pose(self, needs: tuple[Clause, ...]) -> Iterator[Rule]:
        """Yield the rules of pictures that are used, and not at a similar state.

        A bank may hold such moments in a part of its states only. So any other episode's picture must be used in these
        same moments too.
        """
        shown, alike = (
            "{shown}, but of another episode at a similar state{few} only {matched}",
            f"swapped.alike@{self.channel}",
        )
        words = "in these moments any other episode's changes {alike}, so that what it uses elsewhere is open"
        says = self.say(f"{shown}; {words}", alike=of(share, alike))
        yield Rule("undecided", alike, (*needs, measured(alike), fail(use(alike))), says)
        rest: Word = lambda found: "; of the other moments nothing is said" if self._few(found) else ""
        says = self.say(f"{shown}: it reads what its state tells too{{rest}}", rest=rest)
        yield from self.absence(Rule("pose_only", self.of("matched"), needs, says), "responds.alike", shown)

    def content(self, needs: tuple[Clause, ...]) -> Iterator[Rule]:
        """Yield the rules of pictures whose content decides: whether the object in them is followed, is of all cameras.

        A picture of the own episode, as far off in its state as the matched one, or farther, takes the claim away where
        it changes as much, or was not asked; not from who follows an object that is moved, or answers to objects whose
        colours are exchanged, while the state stays.
        """
        beyond, near, colours = f"beyond@{self.channel}", f"asked.near@{self.channel}", self.of("exchanged")
        unseen = (*needs, *map(fail, (use(beyond), use(colours, COLOURED), *self._follows())))
        says = self.say("{content}; but {own}: it may read its own pose", content=self._content, own=self._own)
        yield Rule("undecided", beyond, (*unseen, *enough(beyond)), says)
        words = "{content}; without a picture of its own episode it may read its own pose: {why}{also}"
        says = self.say(words, content=self._content, also=self._also, why=self._not_near)
        for open_ in (near, beyond):
            yield Rule("undecided", beyond, (*unseen, measured(open_)), says)
        if not self.over:
            yield from self.grounded(needs)
        yield Rule("camera_content", self.of("matched"), needs, self.say("{content}", content=self._content))

    def _follows(self) -> tuple[tuple[Clause, ...], ...]:
        return () if self.over else (following(_GAIN, FOLLOWED),)

    def _content(self, found: Known) -> str:
        """Return the shares of content; what no picture of the own episode shows otherwise counts too."""
        shown = str(self.say("{shown}, and {matched} where the state is alike")(found, None))
        still = ", ".join(map(str, found[f"beyond@{self.channel}"].still or ()))
        proven = (use(self.of("exchanged"), COLOURED), *self._follows())
        if not still or any(all(clause.holds(found) for clause in one) for one in proven):
            return shown
        return f"{shown}; what the picture tells of {still} of the state, which never changes within an episode, counts too"

    def _also(self, found: Known) -> str:
        colours = self.of("exchanged")
        return f"; the objects' colours exchanged change {share(found[colours])}" if colours in found else ""

    def _own(self, found: Known) -> str:
        beyond = found[f"beyond@{self.channel}"]
        own = f"one of its own episode, as far off in its state or farther, {share(found[self.of('near')])}"
        apart = f"that it is more is not settled ({way(beyond)} more)"
        return f"{lost(beyond) or f'{own}, and {apart}'}{self._also(found)}"

    def _not_near(self, found: Known) -> str:
        return found.without(f"near@{self.channel}") or why_open(found[f"beyond@{self.channel}"])

    def grounded(self, content: tuple[Clause, ...]) -> Iterator[Rule]:
        """Yield the rules of whether it goes where the object that is named goes."""

        def plain(
            why_not: str, *needs: Clause, may: bool = False, broken: tuple[Clause, ...] = (), **words: Word
        ) -> Rule:
            label, by, may_be = "camera_content", self.of("matched"), "object_grounded" if may else ""
            says, why = self.say("{content}", content=self._content), self.say(why_not, **words)
            return Rule(label, by, (*content, *needs), says, broken, why_not=why, may_be=may_be)

        words = "so whether it is followed is open"
        yield plain(
            f"{{why}}, {words}", may=True, broken=tuple(map(asked, _MOVES)), why=lambda found: found.forgot(*_MOVES)
        )
        yield plain(f"the bank moves no object, {words}", missing(_GAIN, "value"), may=True)
        words = "the moved object is followed {gain} of the oracle's way; {open}"
        for may in (True, False):
            lacking = (fail(following(_GAIN, FOLLOWED)), *([may_follow(_GAIN)] if may else []))
            yield plain(words, *lacking, may=may, open=of(unfollowed, _GAIN))
        yield from self._because(plain, (there(_TOLD, "value"),), _TOLD, content)
        yield from self._because(plain, (), "follow.rather", content)

    def _because(
        self, plain: Callable[..., Rule], given: tuple[Clause, ...], control: str, content: tuple[Clause, ...]
    ) -> Iterator[Rule]:
        """Yield the rules of whether it is followed because it is named, and towards it, by a control."""
        words = "that it is followed because it is named is not shown: where it is named an object is followed {rather}"
        words, half = f"{words} of the oracle's way farther; {{open}}", compared(f"half@{control}", "value", "<", 1.0)
        rather, few = of(way, control), lambda _: "that is less than half of it"
        for lacking, open_ in ((half, few), (fail(following(control, BECAUSE)), of(unfollowed, control))):
            for may in (True, False):
                needs = (*given, lacking, *([may_follow(control)] if may else []))
                yield plain(words, *needs, may=may, rather=rather, open=open_)
        part = compared("follow.rather", "evenly", "<", EVENLY)
        words = "the named object is followed {gain} of the oracle's way, but {part}"
        yield plain(words, *given, part, may=True, part=of(_part, "follow.rather"))
        words = "its way is {off} degrees off that of the moved object, and goes {gain} of the oracle's along it"
        yield plain(words, *given, compared(_GAIN, "heading", "<", HEADING), off=of(_degrees, _GAIN))
        words = (
            "{content}; moved, the named object is followed {gain} of the oracle's way (p {p}), and {rather} farther"
        )
        more = {"content": self._content, "rather": rather, "p": of(lambda one: f"{one.p:.4f}", _GAIN)}
        says = self.say(f"{words} than where another is named", **more)
        yield Rule("object_grounded", _GAIN, (*content, *given), says)

    def open(self) -> Iterator[Rule]:
        """Yield the rules of pictures of which neither is settled."""
        swap, matched = self.swap, self.of("matched")
        settles = (fail(use(swap)), fail(disuse(swap)))
        yield Rule("undecided", swap, settles, self.say("{shown}: {why}", why=of(why_open, swap)))
        says = self.say("{shown}: whether it tells more than the pose is open: {why}", why=self._unmatched)
        yield Rule("undecided", swap, (missing(matched, "value"),), says)
        bounds = ((use(swap), f"neither above {USED} nor below {IGNORED}"), ((), f"not below {IGNORED}"))
        for needs, words in bounds:
            why: Word = lambda found, words=words: lost(found[matched]) or words
            says = self.say("{shown}: where the state is alike it is {matched}, {why}", why=why)
            yield Rule("undecided", swap, needs, says)

    def _unmatched(self, found: Known) -> str:
        why = found.without(f"matched@{self.channel}") or found[self.of("matched")].note
        return why or "the bank has no state to match by"


_GAIN, _TOLD = "follow.named", "follow.told"
_OWN_MOVES = tuple(f"{which}_{side}" for which in ("named", "other") for side in ("plus", "minus"))
_MOVES = (*_OWN_MOVES, *(f"told_{name}" for name in _OWN_MOVES))


def _no_use(name: str, but: str) -> Clause:
    """Return the condition that a share is not used, or is less than what must not be ignored."""
    return fail(carrying(name), but)


def _part(one: Share) -> str:
    """Return in words of what that was told, or along which axis, an object is followed less than on the mean.

    The mean over all is no claim about each: who goes to one block and not to the other has half of it.
    """
    assert isinstance(one, Followed)
    assert one.least is not None
    where, least = one.least
    far, whole = (f"{100 * (size or 0.0):.0f} %" for size in (least["value"], one.value))
    return f"{where} it is followed only {far} farther than the other, and {whole} on the whole"


def _degrees(one: Share) -> str:
    """Return how far the way of an answer is off that of what was moved."""
    assert isinstance(one, Followed)
    return f"{math.degrees(math.acos(max(-1.0, one.heading or 0.0))):.0f}"


@cache
def camera_axis(channel: str, what: str, singles: tuple[str, ...] = (), others: tuple[str, ...] = ()) -> Axis:
    """Return the axis of a camera, or of all; ``singles`` and ``others`` as there."""
    return _Camera(channel, what, singles, others).axis()


class _State(_Channel):
    """The rules of the state, and of places that are answered relative to it.

    A place that stays is another motion relative to another state, and one that goes along with it is the same.
    """

    @property
    def say(self) -> Callable[..., Says]:
        """Return what makes the reason of a rule from its sentence."""
        return saying(
            shown=lambda found: f"its state carries {of_action(found[self.swap])}",
            reads=of(share, "reads@state"),
            why=lambda found: found.without("swapped@state") or why_open(found[self.swap]),
            open=of(why_open, self.swap),
            told=lambda found: (
                f"; another instruction changes {of_action(found[_HEARS])}" if used(found[_HEARS]) else ""
            ),
        )

    def axis(self) -> Axis:
        """Return its rules."""
        swap, reads, say = self.swap, "reads@state", self.say
        places = "its answers are places, and change by {reads} with its state"
        along = "its answers are places that go along with it ({reads}): it reads it, and does the same from there"
        stays = "relative to another state the same place is another motion"
        stays = f"its answers are places, and as they are change by {{reads}} with it: {stays}"
        measured_ = there(reads, "value")
        short = "{shown}, and its cameras next to nothing{told}"
        blind = compared("ignores_camera", "value", ">=", 1.0)
        return Axis(
            "state",
            (
                Rule("undecided", "", (compared("has_state", "value", "<", 1.0),), say("the bank has no state")),
                Rule("undecided", swap, (missing(swap, "value"),), say("its state cannot be judged: {why}")),
                *self.absence(Rule("ignores_state", reads, disuse(reads), say(places)), "responds", places),
                Rule("undecided", reads, (measured_, *disuse(swap)), say(f"{{shown}}; but {along}")),
                Rule("undecided", reads, (measured_, *use(swap), fail(use(reads))), say(f"{{shown}}; but {stays}")),
                *self.absence(Rule("ignores_state", swap, disuse(swap), say("{shown}")), "responds"),
                Rule("undecided", swap, (fail(use(swap)),), say("{shown}: {open}")),
                Rule("state_shortcut", swap, (blind,), say(short), bound="responds@cameras"),
                Rule("state_used", swap, (), say("{shown}")),
            ),
        )


_HEARS = "T.swapped@instruction"
STATE = _State("state", "its state").axis()


class _Instruction(_Channel):
    """The rules of the instruction: whether another one changes the action, and towards what is named."""

    @property
    def say(self) -> Callable[..., Says]:
        """Return what makes the reason of a rule from its sentence."""
        logged = "follow.logged"
        return saying(
            shown=lambda found: f"another instruction{_exchanged(found[_HEARS])} changes {of_action(found[_HEARS])}",
            forgot=lambda found: found.forgot("swapped@instruction") or why_open(found[_HEARS]),
            without=lambda found: (
                found.without("swapped@instruction") or "no two episodes of the bank are told different things"
            ),
            moves=lambda found: found.forgot(*_MOVES) or lost(found[_TOLD]),
            open=of(why_open, _HEARS),
            share=of(share, _TOLD),
            way=of(way, _TOLD),
            why=of(unfollowed, _TOLD),
            nearer=lambda found: (
                f"its own brings it nearer to what was logged by {way(found[logged])} of what both differ by"
            ),
            unlogged=of(unfollowed, logged),
        )

    def axis(self) -> Axis:
        """Return its rules."""
        swap, say = self.swap, self.say
        told = "what it is told cannot be judged: {forgot}"
        whether = say("{shown}; whether it goes to what is named is open: {moves}")
        unheard = Rule("instruction_ignored", swap, (*disuse(swap), fail(following(_TOLD, HEARD))), say("{shown}"))
        follows = "but it follows what is named {share} of the oracle's way more than what is not"
        return Axis(
            "instruction",
            (
                Rule("undecided", swap, says=say(told), broken=(asked("swapped@instruction"),)),
                Rule("undecided", swap, (measured(swap), missing(swap, "value")), say(told)),
                Rule("no_power", "", (missing(swap, "value"),), say("{without}")),
                *(
                    Rule("undecided", swap, (*known, *needs), whether, broken)
                    for known in (use(swap), disuse(swap))
                    for needs, broken in (((), tuple(map(asked, _MOVES))), ((lossy(_TOLD),), ()))
                ),
                *self.absence(unheard, "responds"),
                *self.heard(use(swap)),
                Rule("undecided", _TOLD, disuse(swap), say(f"{{shown}}, {follows}")),
                Rule("undecided", swap, (), say("{shown}: {open}")),
            ),
        )

    def heard(self, needs: tuple[Clause, ...]) -> Iterator[Rule]:
        """Yield the rules of an instruction that changes the action: whether towards what is named."""
        words = "{shown}, and it follows what is named {way} of the oracle's way more than what is not"
        yield Rule("instruction_followed", _TOLD, (*needs, *following(_TOLD, HEARD)), self.say(words))
        away = (
            "{shown}, but it goes away from what is named or to what is not, {way} of the oracle's way: it may take one"
        )
        yield Rule("undecided", _TOLD, (*needs, *opposing(_TOLD)), self.say(f"{away} name for the other"))
        only = self.say("{shown}, but it follows what is named only {way} of the oracle's way more; {why}")
        for which in ("named", "other"):
            yield Rule("undecided", _TOLD, (*needs, *following(f"follow.{which}", FOLLOWED)), only)
        yield from self.logged(needs)

    def logged(self, needs: tuple[Clause, ...]) -> Iterator[Rule]:
        """Yield the rules of an instruction that changes the action where no object is followed, or none is moved.

        Its own instruction has to bring it nearer to what was logged than another one does. Where nobody can say
        whether it does, and nothing is moved, the label stands, and it is said what is not tested.
        """
        log, say = "follow.logged", self.say
        yield Rule("undecided", log, (*needs, *opposing(log)), say("{shown}, but {nearer}: the other way"))
        moved, still = (there(_TOLD, "value"),), (missing(_TOLD, "value"),)
        nearer, open_ = say("{shown}, and {nearer}"), "whether it goes to what is named is open: {what}"
        shown = ((moved, "that it follows an object is not shown"), (still, "the bank moves no object"))
        for given, what in shown:
            why = say(open_.format(what=what))
            for proof in (following(log, HEARD), *([above(log, HEARD)] if given is still else [])):
                yield Rule("instruction_followed", log, (*needs, *given, *proof), nearer, why_not=why)
        words = "{shown}, but it follows what is named only {way} of the oracle's way more than what is not"
        more = say(f"{words}, and {{nearer}}; {{unlogged}}")
        yield Rule("undecided", _TOLD, (*needs, *moved, there(log, "value")), more)
        yield Rule("undecided", _TOLD, (*needs, *moved), say(words))
        words = say("{shown}, but {nearer}; {unlogged}: that it changes towards what it is told is not shown")
        yield Rule("undecided", log, (*needs, there(log, "value")), words, may_be="instruction_followed")
        why = (
            "whether it does what it is told is not tested: the bank moves no object, and has no log to be held against"
        )
        yield Rule("instruction_followed", self.swap, needs, say(f"{{shown}}; {why}"), why_not=why)


def _exchanged(one: Share) -> str:
    """Return in brackets what was told most often, and in its place."""
    return f" (most often {quoted(one.texts[1])} for {quoted(one.texts[0])})" if one.texts else ""


INSTRUCTION = _Instruction("instruction", "its instruction").axis()


def judged(ruling: Ruling) -> Judged:
    """Return a ruling in words, of the whole data set only where few enough of its episodes may respond."""
    one, why = ruling.bound, str(ruling.why_not)
    found = Judged(ruling.label, sentence(str(ruling.reason)), ruling.decided_by, why, may_be=ruling.may_be)
    if one is None or one.value is None or one.ci is None:
        return found
    if one.ci[1] < OF_DATA_SET:
        return replace(found, responds=one)
    k = _count(one)
    some = f"{k} of {one.n} {'responds' if k == 1 else 'respond'}" if k else f"none of {one.n} responds"
    needed = episodes_needed(OF_DATA_SET, confidence=SURENESS)
    why = (
        f"it is said of these episodes: {some}, so that up to {one.ci[1]:.0%} of the data set's may; "
        f"{needed} episodes of which none does would bound that at {OF_DATA_SET:.0%}"
    )
    return replace(found, why_not=why, responds=one)


def _count(one: Statistic) -> int:
    """Return how many episodes respond."""
    return round((one.value or 0.0) * one.n)


def judge_camera(statistics: Statistics, channel: str, what: str, asked: Asked = EVERYTHING) -> Judged:
    """Return the label of all cameras together, or of one."""
    head = "swapped@camera:"
    singles = tuple(name.removeprefix("T.swapped@") for name in statistics if name.startswith(f"T.{head}"))
    others = tuple(name.partition("@")[2] for name in sorted(asked.unasked) if name.startswith(head))
    found = Known(statistics, asked)
    found.update(_halves(found))
    return judged(camera_axis(channel, what, singles, others).evaluate(found))


def _halves(found: Known) -> dict[str, Share]:
    """Return whether what is followed because it is named is half of what is followed at least, by either control."""
    gain = found[_GAIN].value or 0.0
    return {
        f"half@{name}": Share(float(name in found and 2 * (found[name].value or 0.0) >= gain), 1)
        for name in (_TOLD, "follow.rather")
    }


def judge_state(statistics: Statistics, camera: str, *, there: bool, asked: Asked = EVERYTHING) -> Judged:
    """Return the label of the state, where the bank has one; ``camera`` is that of all cameras."""
    blind = camera == "ignores_camera"
    return judged(STATE.evaluate(Known(statistics, asked, has_state=there, ignores_camera=blind)))


def judge_instruction(statistics: Statistics, asked: Asked = EVERYTHING) -> Judged:
    """Return the label of the instruction."""
    return judged(INSTRUCTION.evaluate(Known(statistics, asked)))
