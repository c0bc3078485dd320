"""Verdicts on policies: guards, then what each channel is used for, one axis each.

Why these rules: docs/decisions/policies.md.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache

from eyechart.channels import reads as is_read
from eyechart.records import plain, to_json_fields
from eyechart.stats.shares import LogDistance, Share
from eyechart.stats.statistic import Statistic
from eyechart.verdicts.labels import CAMERA, INSTRUCTION, LOOKS, STATE, USES, UseLabel, meets
from eyechart.verdicts.policy_rules import AxisVerdict, condition_of, judged, of_camera, of_instruction, of_state
from eyechart.verdicts.rules import WORDS, Axis, Clause, Reading, Rule, compared, fail, there, word
from eyechart.verdicts.ruling import Ruling, card
from eyechart.verdicts.share_predicates import (
    ALPHA,
    EVERYTHING,
    FOLLOWED,
    IGNORED,
    LEAST_NOISE,
    UNSCORABLE,
    USED,
    MissingConditions,
    ShareStatistics,
    Statistics,
    disuse,
    every,
    fails_on,
    following,
    measured,
    sentence,
    undecided,
    unknown,
    use,
)
from eyechart.verdicts.share_predicates import condition_run as asked_for

MISFIT = 1.0
"""From this error on the policy fits the log worse than the mean of the log does."""
OFFSET, SPREAD = 1.0, 3.0
"""A misfit is of units from so many spreads between means, or such a ratio of spreads."""
CONSTANT = 0.02
"""A policy that varies less than this share of the log's variation is constant."""
INCONSISTENT = 0.50
"""Above this share of noise a policy does not agree with itself."""
REMEMBERED, SURE = 0.02, 0.001
"""From this share of noise that goes with the call before, at this p, a policy remembers calls."""
AXES: Mapping[str, Mapping[str, UseLabel]] = {"camera": CAMERA, "state": STATE, "instruction": INSTRUCTION}
"""The labels of each axis of a policy, by their names."""


def _met(axis: str, wanted: str) -> str:
    labels = AXES[axis]
    return f"the {axis} label is {' or '.join(name for name in labels if wanted in meets(name, labels))}"


REQUIREMENTS: Mapping[str, str] = {
    f"{axis}:{name}": _met(axis, name) for axis, labels in AXES.items() for name in labels if not labels[name].is_open
} | {LOOKS: _met("camera", LOOKS)}
"""What a gate may require of a policy, with what it means."""


@dataclass(frozen=True)
class PolicyVerdict:
    """The verdict on one policy: guards that failed, and a label an axis.

    ``channels`` holds the share of each channel, ``misfit`` the error to the log as a share of its
    variance.
    """

    model: str
    camera: AxisVerdict
    cameras: Mapping[str, AxisVerdict]
    state: AxisVerdict
    instruction: AxisVerdict
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
        return " ".join(dict.fromkeys(part.because for part in parts))

    @property
    def axes(self) -> dict[str, AxisVerdict]:
        """Return the label of each axis by its name; each camera by ``camera:NAME``."""
        cameras = {f"camera:{name}": one for name, one in self.cameras.items()}
        return {"camera": self.camera, **cameras, "state": self.state, "instruction": self.instruction}

    @property
    def headline(self) -> str:
        """Return the labels of camera, state and instruction, or the guards that failed."""
        if self.guards:
            return f"undecided: {', '.join(self.guards)}"
        return ", ".join(one.label for one in (self.camera, self.state, self.instruction))

    @property
    def answer(self) -> str:
        """Return whether it looks: Yes, In part, No, or Inconclusive (also if a guard failed)."""
        return CAMERA[self.camera.label].answer

    def facts(self) -> dict[str, str]:
        """Return in words the label of each axis and why not more, or the guards that failed."""
        if self.guards:
            return dict(self.guards)
        return {
            name: f"{axis.label}. {axis.because}{f' Not more, because {axis.why_not}.' if axis.why_not else ''}"
            for name, axis in self.axes.items()
        }

    def __repr__(self) -> str:
        return f"<PolicyVerdict on {self.model}: {self.headline}>"

    def __str__(self) -> str:
        facts = (f"{name}: {words}" for name, words in self.facts().items())
        return "\n  ".join([f"{self.model}: {self.headline}", *facts, *self.remarks, self.scope])

    def _repr_html_(self) -> str:
        return card(self.model, self.answer, self.headline, "", self.facts(), (*self.remarks, self.scope))

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values; the first nine keys are those that scripts may rely on.

        ``holes`` are empty: no test of a policy looks for any.
        """
        return {
            "camera": self.camera.label,
            "cameras": {name: one.label for name, one in self.cameras.items()},
            "state": self.state.label,
            "instruction": self.instruction.label,
            "guards": list(self.guards),
            "because": self.because,
            "channels": {
                name: to_json_fields(channel, "ci n", T=channel.value) for name, channel in self.channels.items()
            },
            "answer": self.answer,
            "holes": [],
            "axes": plain(self.axes),
            **to_json_fields(self, "scope remarks"),
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
    left_out: MissingConditions = EVERYTHING,
) -> PolicyVerdict:
    """Return the verdict on a policy.

    ``channels`` are those of the bank, ``reads`` those that the policy declares to read, if any.
    ``missing`` counts the calls without a motion by reason; ``left`` calls are not finished.
    """
    known = ShareStatistics(statistics, left_out)
    failed = failed_guards(known, missing or {})
    shares = {name: statistics[f"T.swapped@{name}"] for name in channels if f"T.swapped@{name}" in statistics}
    names = [name.partition(":")[2] for name in channels if name.startswith("camera:")]
    remarks = [f"{left} calls are unfinished: what is said of part of a run may change"] if left else []
    guarded = UNGUARDED.evaluate(known)
    nothing = judged(guarded)
    if failed:
        nothing = AxisVerdict("undecided", f"a guard failed: {', '.join(failed)}", next(iter(failed)))
    is_judged = not failed and guarded.label == HOLDS
    if "not_scorable" not in failed:  # else it fails on all kinds of pictures
        remarks += _fails_on(left_out.failing, is_judged=is_judged)
    if not is_judged:
        single = dict.fromkeys(names, nothing)
        return PolicyVerdict(model, nothing, single, nothing, nothing, failed, shares, scope, tuple(remarks))

    def reached(ruling: Ruling, channel: str, what: str, alone: str = "") -> AxisVerdict:
        unread = bool(reads) and not is_read(channel, reads)
        return _reached(ruling, reaching(channel, what).evaluate(known), alone, unread=unread)

    whole = of_camera(statistics, "cameras", "its cameras", left_out)
    rulings = {name: of_camera(statistics, f"camera:{name}", f"the {name} camera", left_out) for name in names}
    ignored = [name for name, ruling in rulings.items() if ruling.label == "ignores_camera" != whole.label]
    single = {
        name: reached(ruling, f"camera:{name}", f"picture of {name}", _alone(name, ignored))
        for name, ruling in rulings.items()
    }
    camera = reached(whole, "cameras", "picture")
    state = reached(of_state(statistics, camera.label, there="state" in channels, left_out=left_out), "state", "state")
    instruction = reached(of_instruction(statistics, left_out), "instruction", "instruction")
    remarks += [*_left_out(statistics["motions"], missing or {}), *_remarks(known, camera.label)]
    misfit = statistics["misfit"].value
    return PolicyVerdict(
        model, camera, single, state, instruction, failed, shares, scope, tuple(remarks), misfit=misfit
    )


def not_arrived(verdict: PolicyVerdict, failed: Mapping[str, str]) -> PolicyVerdict:
    """Return a verdict that says nothing of any channel: guards of the way to a model ``failed``."""
    nothing = AxisVerdict("undecided", f"a guard failed: {', '.join(failed)}", next(iter(failed)))
    guards, cameras = {**failed, **verdict.guards}, dict.fromkeys(verdict.cameras, nothing)
    return replace(verdict, guards=guards, cameras=cameras, camera=nothing, state=nothing, instruction=nothing)


def _alone(name: str, ignored: Sequence[str]) -> str:
    """Return that the label of a camera is said of it alone, where others are ``ignored`` too."""
    others = ", ".join(one for one in ignored if one != name)
    if name not in ignored or not others:
        return ""
    return (
        f"that is said of it alone, while the others are there: {others} could be exchanged too, but whether all could "
        "together is open, since they may show the same"
    )


HOLDS = "holds"
"""The label where no other rule holds."""


def _reached(ruling: Ruling, reaches: Ruling, alone: str, *, unread: bool) -> AxisVerdict:
    """Return a ruling in words; a sentence says if the channel may not be connected.

    The sentence stands behind an absence, which is true either way, and before the reason of an
    open axis. A channel that the policy declares to leave ``unread`` has none; that it uses one
    such contradicts what it declares.
    """
    absent, said = USES[ruling.label].is_absence, [ruling.reason]
    still = reaches.label != HOLDS and (absent or ruling.label == "undecided")
    if still and not unread:
        said.insert(len(said) if absent else 0, reaches.reason)
    elif still and absent:
        said[-1] += "; it declares that it does not read it"
    elif unread and not absent and not USES[ruling.label].is_open:
        said[-1] += "; it declares that it does not read it, which its answers contradict: let it declare that it does"
    if alone:
        said[-1] += f"; {alone}"
    return replace(judged(ruling, *said), may_be_unconnected=still and not unread)


@cache
def reaching(channel: str, what: str) -> Axis:
    """Return the rules of whether a channel reaches a policy; sentences call it ``what``.

    A policy that computes with a channel changes some last bit with it. One that changes none may
    never have been given it. Pictures of another kind that change a bit did reach it.
    """
    swap, same = f"T.swapped@{channel}", Reading("same", ">=", 1.0)
    own = ("matched", "blank", "exchanged") if channel.startswith("camera") else ()
    others = ("noise", "recoloured", "decoys") if channel == "cameras" else ()
    pictures = (*(condition_of(name, channel) for name in own), *others)
    alike = (*every(swap, same), *(Clause(f"T.{picture}", (same, Reading("n", "<", 0.0))) for picture in pictures))
    words = (
        f"another {what} changes {{bits:{channel}}}: it may not be connected, or an earlier answer is kept; "
        "'eyechart doctor SPEC --frames {bank}' asks, and a policy that is not to read it declares its channels"
    )
    return Axis(f"reaching {channel}", (undecided(swap, alike, words), Rule(HOLDS, swap, (), "it does")))


def _bits(found: ShareStatistics, channel: str) -> str:
    """Return in words how little changes; answers that are places may differ by rounding."""
    swap = found[f"T.swapped@{channel}"]
    n, as_given = swap.n, found.get(f"reads@{channel}", swap).value
    return f"none of {n} answers by more than rounding" if as_given else f"not one bit of {n} answers"


def failed_guards(found: ShareStatistics, missing: Mapping[str, int]) -> dict[str, str]:
    """Return the guards that failed, each with the number that says so, in their order."""
    failed: dict[str, str] = {}
    for rule in GUARDING.rules:
        if rule.label not in (HOLDS, *failed) and (ruling := rule.ruling(found)):
            failed[rule.label] = ruling.reason
    if why := failed.get("not_scorable"):
        return {"not_scorable": f"{why}{_reasons(missing, 'none came back')}"}
    return failed


UNFIT = compared("misfit", "value", ">=", MISFIT)
UNLIKE = Clause("misfit", (Reading("offset", ">", OFFSET), Reading("spread", ">", SPREAD)))
_MOTIONS = compared("motions", "value", "<", 1 - UNSCORABLE, untested=True)
_ODD = "a skipped normalisation, another action space, or a policy that is hardly trained"
_INSTANTS = "with the instants that it is given; a policy that needs earlier ones declares history"
_VARIES = f"it varies {{value:variation}} times as much as the log between episodes, below {CONSTANT}, {_INSTANTS}"
# Answers whose very noise is that small are constant; greater noise hides whether they are.
_HARDLY, _STILL = (compared("variation", reads, "<", CONSTANT) for reads in ("value", "with_noise"))
_MOVES = Clause("variation", (Reading("with_noise", ">=", CONSTANT, otherwise=True),))
_SWAP, _NUDGED = "T.swapped@cameras", "T.nudged"
_BY_BYTES = "{share:T.nudged} of its variation goes with one value of its pictures that is one level off"
_NOT_SHOWN = (
    "and that another episode's change more is not shown ({share:T.swapped@cameras}): it answers by the bytes of its "
    "pictures, as a cache or a hash of them does, or with noise that hangs on them and hides what it sees"
)

GUARDING = Axis(
    "guards",
    (
        Rule("not_scorable", "motions", (_MOTIONS,), "{unanswered:motions} calls hold no motion"),
        Rule(
            "misfit",
            "misfit",
            (UNFIT, UNLIKE),
            f"its error is {{size:misfit}} times the log's variance, and {{unlike:misfit}}: {_ODD}",
        ),
        Rule("constant", "variation", (_HARDLY, _STILL), _VARIES),
        Rule(
            "constant", "variation", (_HARDLY, Clause("noise", (Reading("value", "<=", INCONSISTENT, True),))), _VARIES
        ),
        Rule(
            "constant", "noise", (compared("noise", "alike", ">=", 1.0),), f"its answers are all the same {_INSTANTS}"
        ),
        Rule(
            "self_inconsistent",
            "noise",
            (compared("noise", "value", ">", INCONSISTENT), _MOVES),
            "{percent:noise} of its variation is there when nothing changes at all, on {n:noise} frames",
        ),
        Rule(
            "self_inconsistent",
            _NUDGED,
            (
                compared(_NUDGED, "value", ">", INCONSISTENT),
                Clause(_NUDGED, (Reading("p", "<=", ALPHA, otherwise=True),)),
            ),
            f"{_BY_BYTES}: it answers by the bytes of its pictures more than by what they show",
        ),
        Rule(
            "self_inconsistent",
            _NUDGED,
            (*use(_NUDGED), fail(use(_SWAP))),
            f"{_BY_BYTES}, {_NOT_SHOWN}",
            (*disuse(_SWAP), *disuse(_NUDGED)),
        ),
        Rule(
            "self_inconsistent",
            "memory",
            (
                compared("noise", "value", ">", LEAST_NOISE),
                compared("memory", "value", ">", REMEMBERED),
                compared("memory", "p", "<=", SURE),
            ),
            "{percent:memory} of its noise goes with the call before (p {p3:memory}, {n:memory} calls): it keeps "
            "something; empty it before every call (reset)",
        ),
        Rule(HOLDS, "noise", (), "it does", quiet=True),
    ),
)
"""The guards, in the order of `GUARDS`: of each the first rule that holds says why it failed."""


@word
def _size(one: Share) -> str:
    return f"{one.value:.2g}" if one.ci is None else f"{one.value:.2g} [{one.ci[0]:.2g}, {one.ci[1]:.2g}]"


@word
def _unlike(one: LogDistance) -> str:
    """Return in words how a policy's numbers differ from those of the log."""
    found = []
    if one.offset is not None and one.offset > OFFSET:
        found.append(f"the mean of {_dimension(one.offset_of)} is {one.offset:.2g} of the log's spreads away")
    if one.spread is not None and one.spread > SPREAD:
        found.append(f"the spread of {_dimension(one.spread_of)} is another by a factor of {one.spread:.2g}")
    return ", ".join(found)


def _dimension(name: str | None) -> str:
    return f"'{name}'" if name is not None else "a dimension"


WORDS |= {
    "unanswered": lambda found, name: f"{1 - (found[name].value or 0.0):.0%} of {found[name].n}",
    "percent": lambda found, name: f"{found[name].value:.0%}",
    "p3": lambda found, name: f"{found[name].p:.3f}",
    "n": lambda found, name: str(found[name].n),
    "far_off": lambda found, name: str(found[name].far_off),
    "far_off_of": lambda found, name: ", ".join(found[name].far_off_of or ()),
    "bits": _bits,
    "still_of": lambda found, name: ", ".join(found[name].still or ()),
}


def _unguarded() -> Iterator[Rule]:
    """Yield the rules of guards that could not be asked, and the last, for where all were."""
    without = {
        "noise": ("{forgot:real_repeat|lost:noise|note:noise}", "it draws its answers"),
        "misfit": ("{lost:misfit|note:misfit}", "its numbers are those of the log"),
        "variation": ("{lost:variation|note:variation}", "it varies at all"),
        "T.nudged": ("{lost:T.nudged|note:T.nudged} (nudged)", ""),
    }
    by_bytes = "it answers by the bytes of its pictures, and not by what they show"
    for name, (why, what) in without.items():
        words = f"{why}, so that nobody knows whether {what or by_bytes}"
        yield undecided(name, (measured(name), unknown(name)), words)
    alone = f"{{forgot:nudged}} (the same command asks it alone), so that nobody knows whether {by_bytes}"
    yield undecided("T.nudged", (), alone, asked_for("nudged"))
    yield Rule(HOLDS, "noise", (), "it does")


UNGUARDED = Axis("unguarded", tuple(_unguarded()))


def _fails_on(failing: Mapping[str, tuple[int, int]], *, is_judged: bool) -> Iterator[str]:
    """Say which computed pictures a policy fails on, and what it is judged by, if by anything."""
    if said := fails_on(failing):
        rest = "and it is judged by its other answers" if is_judged else "and its other answers are not judged either"
        yield sentence(f"{said}: what it would do there is not known, {rest}", end="")


def _left_out(motions: Statistic, missing: Mapping[str, int]) -> Iterator[str]:
    """Say how many calls hold no motion, where they are few."""
    if motions.value is not None and (without := round((1 - motions.value) * motions.n)):
        words = f"{without} of {motions.n} calls hold no motion{_reasons(missing)}"
        yield f"{words}: they are left out, and what it would have done there is not known"


def _reasons(missing: Mapping[str, int], otherwise: str = "") -> str:
    """Return in brackets the most frequent reasons of calls without a motion, or ``otherwise``."""
    said = ", ".join(f"{count} {why}" for why, count in sorted(missing.items(), key=lambda one: -one[1])[:3])
    return f" ({said or otherwise})" if said or otherwise else ""


def _remarks(known: ShareStatistics, camera: str) -> Iterator[str]:
    """Yield the remarks that stand beside a verdict; ``camera`` is the label of all cameras."""
    swapped = {name.partition("@")[2]: one.ci for name, one in known.items() if name.startswith("T.swapped@")}
    above = [name for name, ci in swapped.items() if ci is not None and ci[0] > 1]
    known["above_all"] = Share(float(len(above)), len(swapped), note=", ".join(above))
    known["ignores_camera"] = Share(float(camera == "ignores_camera"), 1)
    for rule in REMARKS:
        if ruling := rule.ruling(known):
            yield sentence(ruling.reason, end="")


def _remark(says: str, *needs: Clause) -> Rule:
    return Rule("remark", needs=needs, says=says)


_BLIND = compared("ignores_camera", "value", ">=", 1.0)
REMARKS = (
    _remark(
        "its {still_of:variation} is the same in every answer, and the log's is not: nothing here is said of "
        "that number",
        there("variation", "still"),
    ),
    _remark(
        "of the log {far_off:misfit} moments are left out of what answers are measured by, since numbers of "
        "{far_off_of:misfit} are far from all others there: a wrong row, another unit, or a move that is rare (then "
        "declare its scale)",
        there("misfit", "far_off"),
    ),
    _remark(
        "{unlike:misfit}, although its error is below the log's variance: is that its unit?",
        compared("misfit", "value", "<", MISFIT),
        UNLIKE,
    ),
    _remark(
        "its error is {size:misfit} times the log's variance: it does something else than was logged, so that what it "
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
"""The remarks beside the labels."""
