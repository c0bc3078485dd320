"""The doctor of policies: at most 24 calls that check their inputs and their motions."""

import asyncio
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from eyechart.attempts import close
from eyechart.calls import Query, Reply
from eyechart.channels import (
    CAMERA,
    CAMERAS,
    INSTRUCTION,
    STATE,
    flat_state,
    instruction_key,
    logs,
    reads,
    relative,
    relative_log,
    require_history,
    require_inputs,
)
from eyechart.conditions import mixed, show
from eyechart.errors import BankError, counted
from eyechart.event_loops import in_own_loop
from eyechart.frames import Frame, FrameBank, Stimulus, decode, encode
from eyechart.models import Model, OpenedModel, ask, history_of, open_policy, states
from eyechart.models.policy_callable import PolicyCallable
from eyechart.modes import RequestMode
from eyechart.prompts import Prompt, motion_prompt, says
from eyechart.spaces.motion import Floats, Motion, MotionSpace, require_motions
from eyechart.spaces.space import Decision
from eyechart.stats.total_effect import ROUNDING

MOST_CALLS = 24
ALIKE = 3
"""This many equal failures in a row end the examination: each call may load a network again."""
_OUTCOMES = {True: "fine", False: "amiss", None: "cannot say"}
_FEW = 4
"""The number of further frames for comparison with the log."""
_LARGE, _SMALL, _AWAY = 3.0, 1 / 3, 2.0
"""Bounds of another unit: sizes as ratios to the log's, and a mean's distance in deviations."""
_ALIKE = 0.01
"""Answers that differ by less than this share of what those to two frames differ by count as equal."""
_FAINT = 0.02
"""The share of another frame's change below which a channel hardly counts."""
_CONSTANT, _NOISY = 0.02, 0.5
"""Shares of variance: below the first, of the log's, answers are constant. Repeats above the
second, of the answers', hide whether they are."""
_REVERSED, _DIGITS = 0.9, 6
"""From this share of steps on the wrong side a number of two values, equal to so many decimals, is reversed."""
_FITS, _BETTER = 0.25, 0.25
"""Shares of error: below the first, of the log's variance, an answer fits the log. Below the
second, of the given pictures' error, another form fits better."""


@dataclass(frozen=True, slots=True)
class PolicyCheck:
    """One check: ``fine`` is True, False, or None (inconclusive); ``says`` gives the reason."""

    name: str
    fine: bool | None
    says: str


@dataclass(frozen=True)
class PolicyDiagnosis:
    """The findings on a policy, and the count of calls."""

    spec: str
    findings: tuple[PolicyCheck, ...]
    calls: int

    @property
    def exit_code(self) -> int:
        """Return 0 if nothing is amiss, 1 if something is, and 2 if every check is inconclusive."""
        fine = [finding.fine for finding in self.findings]
        return 1 if False in fine else 0 if True in fine else 2

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def lines(self) -> list[str]:
        """Return a line for each check, with failed ones in capitals, and the count of calls."""
        words = {**_OUTCOMES, False: "AMISS"}
        found = [f"{words[finding.fine]:<10}  {finding.name}: {finding.says}" for finding in self.findings]
        return [*found, f"asked: {self.calls} calls"]

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        found = [
            {"check": finding.name, "outcome": _OUTCOMES[finding.fine], "says": finding.says}
            for finding in self.findings
        ]
        return {"policy": self.spec, "calls": self.calls, "findings": found}


def examine_policy(
    policy: str | RequestMode | OpenedModel,
    bank: FrameBank,
    *,
    timeout_s: float | None = None,
    prompt: str | None = None,
    tell: Callable[[int], None] = lambda _: None,
) -> PolicyDiagnosis:
    """Call a policy with a few frames of a bank, and return what is amiss.

    ``policy`` is a SPEC, a request mode or an open policy. ``prompt`` is a TOML file for a model that
    states its motions in words. ``tell`` gets the number of each call before it. Three equal
    failures in a row end the calls. Raises SpecError for an unknown policy, or for a channel that
    the bank lacks, and BankError for a bank without motions, or with only one episode.
    """
    opened = open_policy(policy, timeout_s)
    spec, model = opened.mode.spec, opened.model
    if bank.manifest.motion is None:
        raise BankError(f"the bank {bank.root} declares no motion, so no answer can be compared with it")
    formulation = motion_prompt(bank, prompt, in_words=states(spec))
    declared = (CAMERAS, *sorted(says(formulation, bank))) if states(spec) else _declared(model)
    require_inputs(spec, model.facts, bank)
    require_history(spec, history_of(model.facts), bank)
    calls = _ProbeCalls(model, _ProbeFrames(bank, formulation), tell)
    return in_own_loop(_examine(spec, calls, declared))


def _declared(model: Model) -> tuple[str, ...]:
    """Return the channels that a policy declares; empty where it declares none."""
    return tuple(filter(None, model.facts.get("channels", "").split(", ")))


def _spread(frames: Sequence[Frame]) -> tuple[Frame, ...]:
    """Return up to `_FEW` frames, from episodes far apart and from different parts of them."""
    drives: dict[object, list[Frame]] = {}
    for frame in frames:
        drives.setdefault(frame.drive, []).append(frame)
    episodes = list(drives.values())
    found = []
    for number in range(_FEW):
        episode = episodes[len(episodes) * (2 * number + 1) // (2 * _FEW)]
        found.append(episode[len(episode) * (2 * number + 1) // (2 * _FEW)])
    return tuple({one.id: one for one in found}.values())


class _ProbeFrames:
    """The frames of the calls: a first one, one of another episode, and further ones."""

    def __init__(self, bank: FrameBank, prompt: Prompt) -> None:
        self.bank, self.prompt = bank, prompt
        self.space: MotionSpace = require_motions(prompt.space)
        self.first = bank.frames[0]
        others = [frame for frame in bank if frame.drive != self.first.drive]
        if not others:
            raise BankError(f"the bank {bank.root} has one episode, and the checks need frames of another one")
        apart = [frame for frame in others if instruction_key(frame.fields) != instruction_key(self.first.fields)]
        self.other = (apart or others)[len(apart or others) // 2]
        self.further = _spread(bank.frames)
        self.logs = logs(bank)
        self.kept = {frame.id for frame in self.logs}

    def other_by(self, cameras: Sequence[str], mine: Frame | None = None) -> Frame | None:
        """Return a frame of another episode than ``mine`` with a different picture of a camera, else None.

        By default that is `first`. The frame is `other`, if its pictures differ.
        """
        mine = mine or self.first
        images = self.bank.manifest.images

        def seen(frame: Frame) -> list[str]:
            return [images.get(file, file) for file in (frame.pictures[name] for name in cameras)]

        others = [frame for frame in (self.other, *self.bank) if frame.drive != mine.drive]
        return next((one for one in others if seen(one) != seen(mine)), None)

    def of(self, frame: Frame) -> Stimulus:
        """Return a frame as a stimulus: pictures, fields and state, and the instants before it."""
        return show("real", frame, self.bank, 0)

    @property
    def pair(self) -> tuple[Frame, ...]:
        """Return two further frames with a logged motion, if possible of different instructions."""
        logged = [frame for frame in self.further if frame.id in self.kept]
        others = [
            frame for frame in logged[1:] if instruction_key(frame.fields) != instruction_key(logged[0].fields)
        ] or logged[1:]
        return (*logged[:1], *others[:1])

    def forms(self, frame: Frame) -> dict[str, Stimulus]:
        """Return a frame with its pictures in wrong forms, by the name of the likely mistake."""
        seen = self.of(frame)
        past = [_forms(one) for one in seen.past]
        return {what: replace(one, past=tuple(many[what] for many in past)) for what, one in _forms(seen).items()}

    def logged(self, frames: Sequence[Frame], answers: Floats | None = None) -> Floats:
        """Return the logged motions of frames, or ``answers`` instead, relative to their states."""
        return relative_log(frames, self.space) if answers is None else relative(answers, frames, self.space)

    def as_given(self, answer: Motion) -> Floats:
        """Return an answer as motions are compared, not relative to the state."""
        return self.space.relative(answer.array, None)

    def compared(self, answer: Decision[Motion]) -> Decision[Motion]:
        """Return an answer as motions are compared: a quaternion and its negative are equal."""
        if answer.action is None or not self.space.rotations_of("motion"):
            return answer
        return replace(answer, action=Motion.of(self.as_given(answer.action)))

    def error(self, frame: Frame, answer: Motion) -> float:
        """Return the mean squared error to the logged motion, over the log's variance."""
        every = self.logged(self.logs)
        spread = np.maximum(self.space.spreads(every), 1e-9)
        given = flat_state(frame.state)
        own = np.array(given) if len(given) else None
        found, wanted = (self.space.relative(one, own) for one in (answer.array, np.array(frame.motion)))
        return float((((found - wanted) / spread) ** 2).mean())

    def changed(self, mine: Frame | None = None) -> Iterator[tuple[str, Stimulus]]:
        """Yield a frame, by default the first, with one change: a channel of another frame, or a grey picture."""
        mine = mine or self.first
        theirs, cameras = self.other if mine.drive != self.other.drive else self.first, list(mine.pictures)
        if (other := self.other_by(cameras, mine)) is not None:
            yield CAMERAS, mixed(mine, other, CAMERAS, self.bank)
        yield "grey", show("blank", mine, self.bank, 0)
        if mine.state and mine.state != theirs.state:
            yield STATE, mixed(mine, theirs, STATE, self.bank)
        if mine.fields and instruction_key(mine.fields) != instruction_key(theirs.fields):
            yield INSTRUCTION, mixed(mine, theirs, INSTRUCTION, self.bank)
        for name in cameras if len(cameras) > 1 else ():
            if (other := self.other_by([name], mine)) is not None:
                yield f"{CAMERA}{name}", mixed(mine, other, f"{CAMERA}{name}", self.bank)

    def alike(self) -> Iterator[str]:
        """Yield the channels of cameras with the same pictures in every other episode."""
        names = [camera.name for camera in self.first.cameras]
        if self.other_by(names) is None:
            yield CAMERAS
        yield from (f"camera:{name}" for name in names if len(names) > 1 and self.other_by([name]) is None)

    @property
    def given(self) -> str:
        """Return a policy's inputs in words."""
        state = {name: len(numbers) for name, numbers in self.first.state.items()}
        numbers = f"a state of {sum(state.values())} numbers ({', '.join(state)})" if state else "no state"
        instruction = "an instruction" if self.first.fields else "no instruction"
        pixels = {name: decode(image, name) for name, image in self.bank.images(self.first).items()}
        pictures = ", ".join(f"{name}: {pixel.shape} {pixel.dtype}" for name, pixel in pixels.items())
        return f"the pictures {pictures}; {numbers}; {instruction}"

    def given_to(self, model: Model) -> str:
        """Return in words what a call of a policy gets, which a batch gets as lists."""
        if (size := model.facts.get("batch")) is None:
            return f"its inputs are {self.given}"
        way = "let it take lists and answer a list of arrays, or take 'batch' away"
        return f"its inputs come in lists of up to {size}, as it declares batch: {way}; each is {self.given}"


def _forms(seen: Stimulus) -> dict[str, Stimulus]:
    """Return an instant with its pictures in wrong forms, by the name of the likely mistake."""
    pixels = {name: decode(image, name) for name, image in seen.images.items()}
    names = list(pixels)
    made = {
        "red and blue exchanged": {name: pixel[..., ::-1] for name, pixel in pixels.items()},
        "turned by half": {name: pixel[::-1, ::-1] for name, pixel in pixels.items()},
        "the cameras exchanged": dict(zip(names, (pixels[name] for name in (*names[1:], names[0])), strict=True)),
    }
    return {
        what: replace(seen, images={name: encode(np.ascontiguousarray(one)) for name, one in many.items()})
        for what, many in made.items()
        if len(names) > 1 or what != "the cameras exchanged"
    }


_UNASKED: Decision[Motion] = Decision(None, "error")
"""Stands for the answer of a call that was not made."""
_NUMBER = re.compile(r"0x[0-9a-f]+|\d+")


@dataclass
class _ProbeCalls:
    """Makes at most `MOST_CALLS` calls and reads the replies; ends after `ALIKE` equal failures."""

    model: Model
    frames: _ProbeFrames
    tell: Callable[[int], None]
    replies: list[Reply] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)

    @property
    def made(self) -> int:
        """Return the count of calls."""
        return len(self.replies)

    @property
    def is_stopped(self) -> bool:
        """Return whether the last calls failed in the same way."""
        return len(self.failed) >= ALIKE

    async def motion(self, seen: Stimulus) -> Decision[Motion]:
        """Return the answer to one stimulus; `_UNASKED` if no more calls are made."""
        if self.made >= MOST_CALLS or self.is_stopped:
            return _UNASKED
        query: Query = self.frames.prompt.query(seen, 1, self.frames.space)
        self.tell(self.made + 1)
        reply = await ask(self.model, query)
        self.replies.append(reply)
        lacks = _NUMBER.sub("0", reply.error_detail) if reply.error else self.frames.space.lacks(reply)
        self.failed = [*(self.failed if lacks in self.failed else ()), *([lacks] if lacks else ())]
        return self.frames.space.read(reply)

    async def together(self, seen: Sequence[Stimulus]) -> list[Decision[Motion]]:
        """Return the answers to stimuli that are asked at once, so that they share a batch."""
        return await asyncio.gather(*map(self.motion, seen))


async def _examine(spec: str, calls: _ProbeCalls, declared: tuple[str, ...]) -> PolicyDiagnosis:
    frames, model = calls.frames, calls.model
    try:
        mine, theirs = frames.of(frames.first), frames.of(frames.other)
        order = [await calls.motion(seen) for seen in (mine, mine, theirs, mine)]
        changed = {name: await calls.motion(seen) for name, seen in frames.changed()}
        further = {frame.id: await calls.motion(frames.of(frame)) for frame in frames.further}
        # A run judges a policy that fails on grey alone by its other answers, so that is no fault here.
        seen = [answer for name, answer in changed.items() if name != "grey"]
        findings = [_motions(calls, [*order, *seen, *further.values()])]
        together = await calls.together([mine, theirs]) if "batch" in model.facts else []
        compared = [frames.compared(one) for one in order]
        forms = await _formed(calls, further) if not _is_drawn(compared) else {}
        more = await _tried_again(calls, compared, changed, further) if not _is_drawn(compared) else {}
    finally:
        await close(model)
    if order[0].action is not None:
        varies = len({frames.compared(one).action for one in (*order, *further.values())}) > 1
        seeded = model.facts.get("seedable") == "true"
        findings += [_again(compared, varies=varies, seeded=seeded)]
        findings += [_in_a_batch(compared, [frames.compared(one) for one in together], model)] if together else []
        reached = list(_reached(compared, {name: frames.compared(one) for name, one in changed.items()}, more))
        constant = _varies(frames, order, further)
        varying = _with_history(constant, model)
        checks = (*reached, _unit(frames, further))
        *reached, unit = checks if varying is constant else map(_of_one_answer, checks)
        findings += [_as_declared(one, declared, reached) for one in reached]
        alike = "its pictures are the same in every other episode, so nothing can be exchanged"
        findings += [PolicyCheck(name, None, alike) for name in frames.alike()]
        findings += [varying, unit, _form(forms)]
    return PolicyDiagnosis(spec, tuple(findings), calls.made)


def _motions(calls: _ProbeCalls, answers: list[Decision[Motion]]) -> PolicyCheck:
    """Check whether every call returned a motion of the bank's shape."""
    made = [answer for answer in answers if answer is not _UNASKED]
    without = [answer for answer in made if answer.action is None]
    if not without:
        return PolicyCheck("motions", True, f"all {len(made)} calls returned a motion {calls.frames.space.shape}")
    given = f" ({calls.frames.given_to(calls.model)})"
    errors = (f"it fails: {reply.error_detail}{given}" for reply in calls.replies if reply.error is not None)
    lacks = (calls.frames.space.lacks(reply) for reply in calls.replies)
    said = "; ".join(dict.fromkeys([*list(errors)[:1], *filter(None, lacks)]))
    end = f". No more were made: the last {ALIKE} failed in the same way" if calls.is_stopped else ""
    return PolicyCheck("motions", False, f"{len(without)} of {len(made)} calls hold no motion: {said}{end}")


def _is_drawn(order: list[Decision[Motion]]) -> bool:
    """Return whether two successive answers to the same frame differ by more than rounding."""
    first, second, other, _ = (one.action for one in order)
    if first is None or second is None or other is None:
        return False
    return first != second and _apart(first, second) > ROUNDING * _apart(first, other)


def _again(order: list[Decision[Motion]], *, varies: bool, seeded: bool) -> PolicyCheck:
    """Check whether the same frame gets the same answer, also after another frame.

    ``varies``: answers to other frames differ. ``seeded``: the seed, equal in all calls, fixes one.
    """
    first, second, other, third = (one.action for one in order)
    if first is None or second is None or other is None or third is None:
        return PolicyCheck("same", None, "not every repeated call returned a motion")
    if other == second and varies:
        said = "another frame got the answer of the one before: does it answer from a queue? Declare reset"
        return PolicyCheck("same", False, said)
    if max(_apart(first, one) for one in (second, third)) <= ROUNDING * _apart(first, other):
        said = "the same frame gets the same answer, also after another one"
        return PolicyCheck("same", True, said if first == second == third else f"{said}, except for rounding")
    if first == second:
        said = "the same frame gets a different answer after another frame: it keeps a memory; declare reset"
        return PolicyCheck("same", False, said)
    if seeded:
        return PolicyCheck("same", False, "it declares seedable, but the same frame gets two answers with one seed")
    said = "the same frame gets two answers: it draws them at random, or keeps a memory; for a memory, declare reset"
    return PolicyCheck("same", None, said)


def _in_a_batch(order: list[Decision[Motion]], together: list[Decision[Motion]], model: Model) -> PolicyCheck:
    """Check whether two frames in one batch get the answers that each gets alone."""
    if isinstance(model, PolicyCallable) and model.batches.failed:
        said = f"two frames in a batch fail, so each was asked alone, as a run does: {model.batches.failed}"
        return PolicyCheck("batch", False, said)
    pairs = [(order[0].action, together[0].action), (order[2].action, together[1].action)]
    known = [(alone, shared) for alone, shared in pairs if alone is not None and shared is not None]
    if len(known) < len(pairs) or _is_drawn(order):
        why = "its answers are drawn at random" if _is_drawn(order) else "not every call returned a motion"
        return PolicyCheck("batch", None, f"whether a batch gets the answers of single calls is open: {why}")
    whole = _apart(known[0][0], known[1][0])
    size = max(_apart(alone, shared) for alone, shared in known)
    if size <= ROUNDING * whole:
        return PolicyCheck("batch", True, "two frames in a batch get the answers that each gets alone")
    words = "in a batch its answers differ from those alone"
    words += f" by {size / whole:.2g} of what two frames differ by" if whole else ", which are the same for two frames"
    if whole and size <= _ALIKE * whole:
        return PolicyCheck("batch", True, f"{words}, which a run takes for equal")
    return PolicyCheck("batch", False, f"{words}: are they in the order of the queries, and without regard to others?")


async def _tried_again(
    calls: _ProbeCalls,
    order: list[Decision[Motion]],
    changed: Mapping[str, Decision[Motion]],
    further: Mapping[str, Decision[Motion]],
) -> dict[str, list[tuple[Motion, Motion]]]:
    """Return the answers to further frames, as they are and with a channel's change, as far as calls are left.

    Only the channels of which the change of the first frame changed no bit are tried.
    """
    frames, first = calls.frames, order[0].action
    silent = [name for name, one in changed.items() if first is not None and frames.compared(one).action == first]
    found: dict[str, list[tuple[Motion, Motion]]] = {}
    for frame in frames.further:
        own = frames.compared(further[frame.id]).action
        for name, seen in frames.changed(frame) if own is not None and frame.id != frames.first.id else ():
            if name in silent and (answer := frames.compared(await calls.motion(seen)).action) is not None:
                found.setdefault(name, []).append((own, answer))  # type: ignore[arg-type]
    return found


def _reached(
    order: list[Decision[Motion]],
    changed: Mapping[str, Decision[Motion]],
    more: Mapping[str, list[tuple[Motion, Motion]]],
) -> Iterator[PolicyCheck]:
    """Yield a check of each channel: whether its change changes the answer, and by enough.

    ``more`` has answers to further pairs of frames.
    """
    first, other, drawn = order[0].action, order[2].action, _is_drawn(order)
    assert first is not None
    whole = 0.0 if other is None else _apart(first, other)
    rounds = any(one.action not in (first, None) for one in (order[1], order[3]))
    near = ROUNDING * whole if rounds else 0.0
    for name, one in changed.items():
        if one.action is None or drawn:
            why = "the call was not made" if one is _UNASKED else f"no motion: {one.reason}"
            why += ". A run judges it by its other answers" if name == "grey" and one is not _UNASKED else ""
            why = "its answers are drawn at random, so a change shows nothing" if drawn else why
            yield PolicyCheck(name, None, why)
        elif (size := max(_apart(*pair) for pair in ((first, one.action), *more.get(name, ())))) <= near:
            what = {"grey": "a grey picture", "state": "another state", "instruction": "another instruction"}.get(name)
            change = "the answer by no more than rounding" if rounds else "not one bit of the answer"
            pairs = (
                f"in {counted(1 + len(more.get(name, ())), 'frame')} that {'were' if more.get(name) else 'was'} tried"
            )
            said = f"{what or 'another picture'} changes {change}, {pairs}: does it reach the policy?"
            yield PolicyCheck(name, False, f"{said} Or does the policy repeat an earlier answer?")
        elif size < _FAINT * whole:
            said = f"its change of the answer is {size / whole:.2g} of another frame's: it is ignored, or hardly"
            yield PolicyCheck(name, None, f"{said} visible (a picture that is divided by 255 twice?)")
        else:
            yield PolicyCheck(name, True, "it reaches the policy: the answer changes with it")


def _as_declared(check: PolicyCheck, declared: tuple[str, ...], others: Sequence[PolicyCheck]) -> PolicyCheck:
    """Return the check of a channel, adjusted by whether the policy declares to read it.

    ``cameras`` declares all cameras, together and each. With it, a camera that has no effect while
    another one has is inconclusive: it may not be meant to be read.
    """
    channel = CAMERAS if check.name == "grey" else check.name
    if not declared or check.fine is None:
        if check.fine is False and not declared:
            return replace(check, says=f"{check.says} If the policy is not meant to read it, declare its channels")
        return check
    if reads(channel, declared):
        beside = [one for one in others if one.name.startswith(CAMERA) and one.name != channel and one.fine]
        if check.fine or channel in declared or not channel.startswith(CAMERA) or not beside:
            return check
        said = f"{check.says.partition(':')[0]}, but one of {beside[0].name} does"
        return PolicyCheck(
            check.name,
            None,
            f"{said}: is it meant to be read? It declares 'cameras', which means all; to read only some, declare each",
        )
    if check.fine:
        said = "it does not declare to read this, but the answer changes with it: declare it too"
        return PolicyCheck(check.name, False, said)
    return PolicyCheck(check.name, True, "it does not declare to read this, and the answer does not change with it")


def _apart(motion: Motion, other: Motion) -> float:
    return float(np.sqrt(np.mean((motion.array - other.array) ** 2)))


async def _formed(calls: _ProbeCalls, further: Mapping[str, Decision[Motion]]) -> dict[str, list[float]]:
    """Return the errors on two frames by form; other forms only if answers do not fit the log."""
    frames = calls.frames
    given = [(frame, further[frame.id].action) for frame in frames.pair]
    result = {"": [frames.error(frame, action) for frame, action in given if action is not None]}
    if len(result[""]) < 2 or max(result[""]) < _FITS:
        return result
    for frame in frames.pair:
        for what, seen in frames.forms(frame).items():
            answer = (await calls.motion(seen)).action
            if answer is not None:
                result.setdefault(what, []).append(frames.error(frame, answer))
    return result


def _form(errors: Mapping[str, list[float]]) -> PolicyCheck:
    """Check whether another form of the pictures makes the answers fit the log, on two frames."""
    given = errors.get("", [])
    if len(given) < 2:
        return PolicyCheck(
            "pictures", None, "other forms were not tried: its answers are random, or the log is too short"
        )
    better = {
        what: many
        for what, many in errors.items()
        if what and len(many) == 2 and max(many) < _FITS and sum(many) < _BETTER * sum(given)
    }
    if better:
        what = min(better, key=lambda one: sum(better[one]))
        said = f"with {what} its error to the log is {np.mean(better[what]):.2g} instead of {np.mean(given):.2g}"
        return PolicyCheck("pictures", False, f"{said}: do the pictures have the form of its training?")
    if max(given) < _FITS:
        return PolicyCheck(
            "pictures",
            True,
            f"in this form its error on {len(given)} frames is at most {max(given):.2g} of the log's variance",
        )
    return PolicyCheck(
        "pictures", None, "its answers do not fit the log, and no other form of the pictures changes that"
    )


def _varies(
    probed: _ProbeFrames, order: list[Decision[Motion]], further: Mapping[str, Decision[Motion]]
) -> PolicyCheck:
    """Check whether answers to several frames vary, compared with the log and with repeats."""
    given = {probed.first.id: order[0], probed.other.id: order[2]} | dict(further)
    answers = [(probed.bank.frame(name), one.action.array) for name, one in given.items() if one.action is not None]
    if len(answers) < 2:
        return PolicyCheck("constant", None, "another frame got no motion")
    numbers = probed.logged([frame for frame, _ in answers], np.stack([array for _, array in answers]))
    if (numbers == numbers[0]).all():
        return PolicyCheck("constant", False, "frames of different episodes get the same answer")
    logged = probed.logged(probed.logs) if probed.logs else np.zeros((0, 1, 1))
    spread = probed.space.spreads(logged if len(probed.logs) else numbers)
    units = np.where(spread > 0, spread, 1.0)
    varies = float((numbers / units).var(axis=0, ddof=1).mean())
    again = np.stack([probed.as_given(one.action) for one in (order[0], order[1], order[3]) if one.action is not None])
    noise = float((again / units).var(axis=0, ddof=1).mean()) if len(again) > 1 else 0.0
    usual = float((logged / units).var(axis=0).mean()) if len(logged) else 0.0
    if usual and varies < _CONSTANT * usual:
        said = f"its answers to {len(answers)} frames vary {varies / usual:.2g} times as much as the log"
        return PolicyCheck("constant", False, f"{said}: it is constant, or nearly so")
    if noise > _NOISY * varies:
        said = f"its answers to one frame differ {noise / varies:.2g} times as much as those to {len(answers)}"
        return PolicyCheck("constant", None, f"{said}: noise hides whether it is constant")
    size = f"{varies / usual:.2g} times as much as the log" if usual else "and there is no log to compare them with"
    return PolicyCheck("constant", True, f"its answers to {len(answers)} frames vary {size}")


def _with_history(check: PolicyCheck, model: Model) -> PolicyCheck:
    """Return the check of constant answers; inconclusive where ``model`` may need earlier instants.

    A policy that declares reset, and no history, keeps something between calls. It begins each call
    without that.
    """
    if check.fine is not False or not isinstance(model, PolicyCallable) or model.reset is None or model.history:
        return check
    said = "It declares reset, and each call gives it one instant: if it needs earlier ones, let it declare history"
    return replace(check, fine=None, says=f"{check.says.partition(':')[0]}. {said}")


def _of_one_answer(check: PolicyCheck) -> PolicyCheck:
    """Return a check of answers that never vary: what failed is inconclusive."""
    return replace(check, fine=None, says="all frames get one answer: see 'constant'") if check.fine is False else check


def _reversed(probed: _ProbeFrames, kept: Sequence[tuple[Frame, Floats]]) -> PolicyCheck | None:
    """Return the check of a number with two values in the log that nearly always has the other one.

    A gripper is such a number, and data sets close it by either sign.
    """
    log = np.concatenate([frame.motion for frame in probed.logs])
    logged = np.concatenate([frame.motion for frame, _ in kept])
    own = np.concatenate([numbers for _, numbers in kept])
    for number in probed.space.plain:
        values = np.unique(np.round(log[:, number], _DIGITS))
        wanted, given = (many[:, number] > values.mean() for many in (logged, own))
        if len(values) != 2 or wanted.all() or not wanted.any():
            continue
        if (share := float((wanted != given).mean())) >= _REVERSED and given.any() and not given.all():
            name = probed.space.dimensions[number].name
            said = f"'{name}' has two values in the log, and the answers have the other one in {share:.0%} of the steps"
            return PolicyCheck("unit", False, f"{said}: is its sign the other, as of a gripper that closes by it?")
    return None


def _unit(probed: _ProbeFrames, further: Mapping[str, Decision[Motion]]) -> PolicyCheck:
    """Check whether the numbers have the log's size, which excludes another unit.

    The log is that of these frames and of the bank: a few frames may need almost no motion.
    """
    pairs = [(frame, further[frame.id].action) for frame in probed.further if frame.id in probed.kept]
    kept = [(frame, action.array) for frame, action in pairs if action is not None]
    if len(kept) < 2:
        return PolicyCheck("unit", None, "too few logged motions to compare the answers with")
    frames = [frame for frame, _ in kept]
    if (turned := _reversed(probed, kept)) is not None:
        return turned
    answers = probed.logged(frames, np.stack([numbers for _, numbers in kept]))
    logged, every = probed.logged(frames), probed.logged(probed.logs)
    here, usual, size = (np.maximum(np.sqrt((one**2).mean(axis=(0, 1))), 1e-9) for one in (logged, every, answers))
    most, least = size / np.maximum(here, usual), size / np.minimum(here, usual)
    sizes = np.where(most > 1, most, np.minimum(least, 1.0))
    away = np.abs(answers.mean(axis=(0, 1)) - logged.mean(axis=(0, 1))) / np.maximum(every.std(axis=(0, 1)), 1e-9)
    for number, dimension in enumerate(probed.space.dimensions[place] for place in probed.space.plain):
        if every[..., number].std() < 1e-9:
            continue
        if _SMALL <= sizes[number] <= _LARGE and away[number] <= _AWAY:
            continue
        if np.ptp(answers[..., number]) == 0 < np.ptp(logged[..., number]):
            said = f"is '{dimension.name}' meant to be the same in every answer? It varies in the log"
            return PolicyCheck("unit", False, f"{said}; a run notes that in a remark, and judges the other numbers")
        said = f"'{dimension.name}' is {sizes[number]:.2g} times as large as in the log"
        return PolicyCheck("unit", False, f"{said}: is its normalisation skipped, or its unit different?")
    return PolicyCheck("unit", True, f"its numbers have the log's size ({sizes.min():.2g} to {sizes.max():.2g} times)")
