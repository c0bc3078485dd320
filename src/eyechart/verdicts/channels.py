"""Verdicts on policies: what each channel is used for, one axis each, and the statistic that decided.

Why these rules: docs/decisions/policies.md.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache

from eyechart.channels import reads as is_read
from eyechart.records import picked, plain
from eyechart.stats.shares import Misfit, Share
from eyechart.stats.statistic import Statistic
from eyechart.verdicts.axes import (
    OF_ITS_WORLD,
    Judged,
    judged,
    of_camera,
    of_instruction,
    of_state,
)
from eyechart.verdicts.card import card
from eyechart.verdicts.labels import CAMERA, INSTRUCTION, LOOKS, STATE, USES, Use, meets
from eyechart.verdicts.rules import WORDS, Axis, Clause, Reading, Rule, compared, fail, missing, there, word
from eyechart.verdicts.ruling import Ruling
from eyechart.verdicts.uses import (
    EVERYTHING,
    FOLLOWED,
    IGNORED,
    LEAST_NOISE,
    UNSCORABLE,
    USED,
    Asked,
    Known,
    Statistics,
    disuse,
    every,
    following,
    lossy,
    measured,
    undecided,
    use,
)
from eyechart.verdicts.uses import asked as asked_for

MISFIT = 1.0
"""From this error on the policy fits the log worse than the log's own mean does."""
OFFSET, SPREAD = 1.0, 3.0
"""A misfit is one of units, not of choice: a mean so many spreads away, or a spread so many times another."""
CONSTANT = 0.02
"""A policy that varies less than this share of the log's variation is constant."""
INCONSISTENT = 0.50
"""Above this share of noise a policy does not agree with itself."""
REMEMBERED, SURE = 0.02, 0.001
"""A policy keeps something from call to call where so much of its noise goes with the call before, with such a p."""
AXES: Mapping[str, Mapping[str, Use]] = {"camera": CAMERA, "state": STATE, "instruction": INSTRUCTION}
"""The labels of each axis of a policy, by their names."""


def requirements() -> Iterator[tuple[str, str]]:
    """Yield what a gate may require of a policy, with what it means."""
    for axis, labels in AXES.items():
        for wanted in (name for name, one in labels.items() if not one.is_open):
            meeting = " or ".join(name for name in labels if wanted in meets(name, labels))
            yield f"{axis}:{wanted}", f"the {axis} label is {meeting}"
    yield LOOKS, f"the camera label is {' or '.join(name for name in CAMERA if LOOKS in meets(name, CAMERA))}"


REQUIREMENTS: Mapping[str, str] = dict(requirements())


@dataclass(frozen=True)
class PolicyVerdict:
    """What is said of one policy: a label an axis, after the guards; ``channels`` holds the share of each channel.

    ``misfit`` is its error to the log, as a share of the log's variance.
    """

    model: str
    camera: Judged
    cameras: Mapping[str, Judged]
    state: Judged
    instruction: Judged
    guards: Mapping[str, str]
    channels: Mapping[str, Statistic]
    scope: str
    remarks: tuple[str, ...] = field(default=())
    misfit: float | None = None

    @property
    def because(self) -> str:
        """Return why, in one paragraph."""
        if self.guards:
            return " ".join(f"{name}: {why}." for name, why in self.guards.items())
        parts = (self.camera, *self.cameras.values(), self.state, self.instruction)
        return " ".join(dict.fromkeys(one.because for one in parts))

    @property
    def axes(self) -> dict[str, Judged]:
        """Return what is said of each axis, by its name; each camera stands by ``camera:NAME``."""
        cameras = {f"camera:{name}": one for name, one in self.cameras.items()}
        return {"camera": self.camera, **cameras, "state": self.state, "instruction": self.instruction}

    @property
    def headline(self) -> str:
        """Return the labels of camera, state and instruction; where a guard failed, which one."""
        if self.guards:
            return f"undecided: {', '.join(self.guards)}"
        return ", ".join(one.label for one in (self.camera, self.state, self.instruction))

    @property
    def answer(self) -> str:
        """Return whether it looks: Yes, In part, No, or Inconclusive, also where a guard failed."""
        return CAMERA[self.camera.label].answer

    def facts(self) -> dict[str, str]:
        """Return in words what is said of each axis and why not more; where guards failed, what each found."""
        if self.guards:
            return dict(self.guards)
        return {
            name: f"{one.label}. {one.because}{f' Not more, because {one.why_not}.' if one.why_not else ''}"
            for name, one in self.axes.items()
        }

    def __repr__(self) -> str:
        return f"<PolicyVerdict on {self.model}: {self.headline}>"

    def __str__(self) -> str:
        facts = (f"{name}: {words}" for name, words in self.facts().items())
        return "\n  ".join([f"{self.model}: {self.headline}", *facts, *self.remarks, self.scope])

    def _repr_html_(self) -> str:
        """Return a card of what is said of each axis."""
        return card(self.model, self.answer, self.headline, "", self.facts(), (*self.remarks, self.scope))

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values; the first nine keys are those that scripts may rely on.

        ``holes`` are the places where what the answer says does not hold; of a policy none is looked for.
        """
        return {
            "camera": self.camera.label,
            "cameras": {name: one.label for name, one in self.cameras.items()},
            "state": self.state.label,
            "instruction": self.instruction.label,
            "guards": list(self.guards),
            "because": self.because,
            "channels": {name: picked(one, "T=value ci n") for name, one in self.channels.items()},
            "answer": self.answer,
            "holes": [],
            "axes": plain(self.axes),
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
    asked: Asked = EVERYTHING,
) -> PolicyVerdict:
    """Return the verdict on a policy; ``channels`` are those of the bank, ``missing`` the calls without a motion.

    ``left`` calls are not finished. ``reads`` are the channels that the policy declares to read, none where it declares
    nothing. ``asked`` says what the run did not ask, and what its bank cannot show.
    """
    known = Known(statistics, asked)
    failed = failed_guards(known, missing or {})
    shares = {name: statistics[f"T.swapped@{name}"] for name in channels if f"T.swapped@{name}" in statistics}
    names = [name.partition(":")[2] for name in channels if name.startswith("camera:")]
    remarks = list(_unfinished(left))
    guarded = UNGUARDED.evaluate(known)
    nothing = judged(guarded)
    if failed:
        nothing = Judged("undecided", f"a guard failed: {', '.join(failed)}", next(iter(failed)))
    if failed or guarded.label != HOLDS:
        every = dict.fromkeys(names, nothing)
        return PolicyVerdict(model, nothing, every, nothing, nothing, failed, shares, scope, tuple(remarks))

    def reached(ruling: Ruling, channel: str, what: str, alone: str = "") -> Judged:
        unread = bool(reads) and not is_read(channel, reads)
        return _reached(ruling, reaching(channel, what).evaluate(known), alone, unread=unread)

    whole = of_camera(statistics, "cameras", "its cameras", asked)
    single = {name: of_camera(statistics, f"camera:{name}", f"the {name} camera", asked) for name in names}
    several = (
        []
        if whole.label == "ignores_camera"
        else [name for name, one in single.items() if one.label == "ignores_camera"]
    )
    camera = reached(whole, "cameras", "picture")
    cameras = {
        name: reached(one, f"camera:{name}", f"picture of {name}", _alone(name, several))
        for name, one in single.items()
    }
    state = reached(of_state(statistics, camera.label, there="state" in channels, asked=asked), "state", "state")
    instruction = reached(of_instruction(statistics, asked), "instruction", "instruction")
    remarks += [*_left_out(statistics["motions"], missing or {}), *_remarks(known, camera.label)]
    misfit = statistics["misfit"].value
    return PolicyVerdict(
        model, camera, cameras, state, instruction, failed, shares, scope, tuple(remarks), misfit=misfit
    )


def _alone(name: str, several: Sequence[str]) -> str:
    """Return that the label of a single camera is said of it alone, where others of ``several`` are ignored too."""
    others = ", ".join(one for one in several if one != name)
    if name not in several or not others:
        return ""
    return (
        f"that is said of it alone, while the others are there: so could {others}, and that they could together is not "
        "said, since they may tell the same"
    )


HOLDS = "holds"
"""The label of what no rule speaks against."""


def _reached(ruling: Ruling, reaches: Ruling, alone: str, *, unread: bool) -> Judged:
    """Return a ruling in words with the remark that the channel may not be connected, of one that changes not one bit.

    It stands behind an absence, which is true either way, and before what else leaves an axis open; and is not made of
    a channel that the policy declares to leave ``unread``. What is said of it ``alone`` ends the last sentence.
    """
    absent, said = USES[ruling.label].is_absence, [ruling.reason]
    still = reaches.label != HOLDS and (absent or ruling.label == "undecided")
    if still and not unread:
        said.insert(len(said) if absent else 0, reaches.reason)
    elif still and absent:
        said[-1] += "; it declares that it does not read it"
    if alone:
        said[-1] += f"; {alone}"
    return replace(judged(ruling, *said), may_be_unconnected=still and not unread)


@cache
def reaching(channel: str, what: str) -> Axis:
    """Return the rules of whether a channel reaches a policy, of which a sentence says that another ``what`` is shown.

    What computes with a channel changes some last bit with it: what changes none may never have been given it. Nothing
    of it is used either way, and whoever wired it should know. Pictures of another kind that change a bit did reach it.
    """
    swap, name, same = f"T.swapped@{channel}", channel.partition(":")[2], Reading("same", ">=", 1.0)
    pictures = [f"matched@{channel}", f"blank@{name}", f"exchanged@{name}"] if name else []
    if channel == "cameras":
        pictures = ["matched@cameras", "blank", "noise", *OF_ITS_WORLD]
    alike = (*every(swap, same), *(Clause(f"T.{one}", (same, Reading("n", "<", 0.0))) for one in pictures))
    words = (
        f"another {what} changes {{bits:{channel}}}: it may not be connected, or an earlier answer is kept; "
        "'eyechart doctor SPEC --frames {bank}' asks, and a policy that is not to read it declares its channels"
    )
    return Axis(f"reaching {channel}", (undecided(swap, alike, words), Rule(HOLDS, swap, (), "it does")))


def _bits(found: Known, channel: str) -> str:
    """Return how little changes: of places as they are, rounding may be left."""
    swap = found[f"T.swapped@{channel}"]
    n, as_given = swap.n, found.get(f"reads@{channel}", swap).value
    return f"none of {n} answers by more than rounding" if as_given else f"not one bit of {n} answers"


def failed_guards(found: Known, missing: Mapping[str, int]) -> dict[str, str]:
    """Return the guards that failed, each with the number that says so, in their order.

    ``missing`` counts the calls without a motion by their reasons.
    """
    failed = {one.label: one.reason for axis in GUARDING if (one := axis.evaluate(found)).label != HOLDS}
    if why := failed.get("not_scorable"):
        return {"not_scorable": f"{why}{_reasons(missing, 'none came back')}"}
    return failed


def _guard(*rules: Rule) -> Axis:
    return Axis("guard", (*rules, Rule(HOLDS, rules[0].decided_by, (), "holds", quiet=True)))


UNFIT = compared("misfit", "value", ">=", MISFIT)
UNLIKE = Clause("misfit", (Reading("offset", ">", OFFSET), Reading("spread", ">", SPREAD)))


def _guards() -> Iterator[Axis]:
    """Yield what is asked before any axis, in the order of `GUARDS`."""
    few = "{unanswered:motions} calls hold no motion"
    yield _guard(
        Rule("not_scorable", "motions", (missing("motions", "value"),), few),
        Rule("not_scorable", "motions", (compared("motions", "value", "<", 1 - UNSCORABLE),), few),
    )
    words = "a skipped normalisation, another action space, or a policy that is hardly trained"
    words = f"its error is {{size:misfit}} of the log's variance, and {{unlike:misfit}}: {words}"
    yield _guard(Rule("misfit", "misfit", (UNFIT, UNLIKE), words))
    words = f"it varies {{value:variation}} times as much as the log between episodes, below {CONSTANT}"
    yield _guard(
        Rule("constant", "variation", (compared("variation", "value", "<", CONSTANT),), words),
        Rule("constant", "noise", (compared("noise", "alike", ">=", 1.0),), "its answers are all the same"),
    )
    label, noisy = "self_inconsistent", compared("noise", "value", ">", INCONSISTENT)
    noise = "{percent:noise} of its variation is there when nothing changes at all, on {n:noise} frames"
    nudged = "{share:T.nudged} of its variation goes with one value of its pictures that is one level off"
    words = (
        "and that another episode's change more is not shown ({way:T.swapped@cameras}): it answers by the bytes of its "
        "pictures, as a cache or a hash of them does, or with noise that hangs on them and hides what it sees"
    )
    swap, by_bytes = "T.swapped@cameras", "it answers by the bytes of its pictures more than by what they show"
    remembers = (
        compared("noise", "value", ">", LEAST_NOISE),
        compared("memory", "value", ">", REMEMBERED),
        compared("memory", "p", "<=", SURE),
    )
    kept = "{percent:memory} of its noise goes with the call before (p {p3:memory}, {n:memory} calls)"
    yield _guard(
        Rule(label, "noise", (noisy,), noise),
        Rule(label, "T.nudged", (compared("T.nudged", "value", ">", INCONSISTENT),), f"{nudged}: {by_bytes}"),
        *(
            Rule(label, "T.nudged", (*use("T.nudged"), fail(use(swap)), fail(disuse(name))), f"{nudged}, {words}")
            for name in (swap, "T.nudged")
        ),
        Rule(label, "memory", remembers, f"{kept}: it keeps something; empty it before every call (reset)"),
    )


@word
def _size(one: Share) -> str:
    """Return a ratio in words, with its interval where there is one."""
    return f"{one.value:.2g}" if one.ci is None else f"{one.value:.2g} [{one.ci[0]:.2g}, {one.ci[1]:.2g}]"


@word
def _unlike(one: Share) -> str:
    """Return in words how a policy's numbers are not those of the log, nothing where they are."""
    assert isinstance(one, Misfit)
    found = []
    if one.offset is not None and one.offset > OFFSET:
        found.append(f"the mean of {_dimension(one.offset_of)} is {one.offset:.2g} of the log's spreads away")
    if one.spread is not None and one.spread > SPREAD:
        found.append(f"the spread of {_dimension(one.spread_of)} is another by a factor of {one.spread:.2g}")
    return ", ".join(found)


@word
def _far_off(one: Share) -> str:
    """Return of how many moments, and which numbers, the log is far off."""
    assert isinstance(one, Misfit)
    which = ", ".join(one.far_off_of or ())
    return f"{one.far_off} moments are left out of what answers are measured by, since numbers of {which}"


def _dimension(name: str | None) -> str:
    """Return of which number of the answer something is said."""
    return f"'{name}'" if name is not None else "a dimension"


WORDS |= {
    "unanswered": lambda found, name: f"{1 - (found[name].value or 0.0):.0%} of {found[name].n}",
    "percent": lambda found, name: f"{found[name].value:.0%}",
    "p3": lambda found, name: f"{found[name].p:.3f}",
    "n": lambda found, name: str(found[name].n),
    "bits": _bits,
    "still_of": lambda found, name: ", ".join(found[name].still or ()),
}
GUARDING = tuple(_guards())


def _unguarded() -> Iterator[Rule]:
    """Yield the rules of what is open where a guard could not be asked, and the last, of a policy of which each was."""
    without = {
        "noise": ("{forgot:real_repeat|lost:noise|note:noise}", "it draws its answers"),
        "misfit": ("{lost:misfit|note:misfit}", "its numbers are those of the log"),
        "variation": ("{lost:variation|note:variation}", "it varies at all"),
        "T.nudged": ("{lost:T.nudged|note:T.nudged} (nudged)", ""),
    }
    by_bytes = "it answers by the bytes of its pictures, and not by what they show"
    for name, (why, what) in without.items():
        for clause in (missing(name, "value"), lossy(name)):
            sentence = f"{why}, so that nobody knows whether {what or by_bytes}"
            yield undecided(name, (measured(name), clause), sentence)
    alone = f"{{forgot:nudged}} (the same command asks it alone), so that nobody knows whether {by_bytes}"
    yield undecided("T.nudged", (), alone, asked_for("nudged"))
    yield Rule(HOLDS, "noise", (), "it does")


UNGUARDED = Axis("unguarded", tuple(_unguarded()))


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


def _remarks(known: Known, camera: str) -> Iterator[str]:
    """Yield what whoever acts on a verdict should know beside it; ``camera`` is the label of all cameras."""
    swapped = {name.partition("@")[2]: one.ci for name, one in known.items() if name.startswith("T.swapped@")}
    above = [name for name, ci in swapped.items() if ci is not None and ci[0] > 1]
    known["above_all"] = Share(float(len(above)), len(swapped), note=", ".join(above))
    known["ignores_camera"] = Share(float(camera == "ignores_camera"), 1)
    for rule in REMARKS:
        if ruling := rule.ruling(known):
            words = ruling.reason
            yield f"{words[0].upper()}{words[1:]}"


def _remark(sentence: str, *needs: Clause) -> Rule:
    return Rule("remark", needs=needs, says=sentence)


_BLIND = compared("ignores_camera", "value", ">=", 1.0)
REMARKS = (
    _remark(
        "its {still_of:variation} is the same in every answer, and the log's is not: nothing here is said of "
        "that number",
        there("variation", "still"),
    ),
    _remark(
        "of the log {far_off:misfit} are far from all others there: a wrong row, another unit, or a move that is rare "
        "(then declare its scale)",
        there("misfit", "far_off"),
    ),
    _remark(
        "{unlike:misfit}, although its error is below the log's variance: is that its unit?",
        compared("misfit", "value", "<", MISFIT),
        UNLIKE,
    ),
    _remark(
        "its error is {size:misfit} of the log's variance: it does something else than was logged, so that what it "
        "uses may be put to no good use",
        UNFIT,
    ),
    _remark(
        "it ignores its cameras, and does not do what was logged: are its pictures ordered and scaled as in training? "
        "'eyechart doctor SPEC --frames {bank}' tries other forms",
        UNFIT,
        _BLIND,
    ),
    _remark(
        "all is said of its answers at one seed, and another seed changes {of_action:noise}: what it does at others "
        "may be something else",
        there("noise", "seeds"),
        compared("noise", "value", ">", USED),
    ),
    _remark(
        "one value of its pictures that is one level off changes {of_action:T.nudged}: its noise hangs on the bytes of "
        "what it is given, so that only what a share has beyond that counts as a use, and all of it against an absence",
        *use("T.nudged"),
    ),
    _remark("a table of another colour alone changes {of_action:T.recoloured}", *use("T.recoloured")),
    _remark(
        "noise in place of its pictures changes {of_action:T.noise}: they reach it, and real ones change little",
        *use("T.noise"),
        _BLIND,
    ),
    _remark(
        "a share above 1 ({note:above_all}) is no part of a whole: the answer changes more than between two moments of "
        "different episodes, which may have the same there, or where the channel then contradicts the others",
        compared("above_all", "value", ">", 0.0),
    ),
    _remark(
        "it goes only {way:follow.told} of the oracle's way farther to what is named: it hardly does what it is told",
        *use("T.swapped@instruction"),
        *following("follow.told", 0.0),
        compared("follow.told", "high", "<", FOLLOWED),
    ),
    _remark(
        "its cameras are used, and carry next to nothing: {of_action:T.swapped@cameras}",
        compared("T.swapped@cameras", "low", ">", USED),
        compared("T.swapped@cameras", "high", "<", IGNORED),
    ),
)
"""What is said beside the labels."""
