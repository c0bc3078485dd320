"""The doctor of policies: in at most twenty calls, whether what they are given reaches them, and what they answer."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from eyechart.attempts import close
from eyechart.calls import Query, Reply
from eyechart.channels import (
    CAMERA,
    CAMERAS,
    flat_state,
    instruction_column,
    logs,
    reads,
    relative,
    relative_log,
    require_channels,
    told,
)
from eyechart.conditions import show
from eyechart.errors import BankError
from eyechart.frames import Frame, FrameBank, Stimulus, decode, encode
from eyechart.loops import in_own_loop
from eyechart.models import Model, Opened, ask, open_policy
from eyechart.prompts import Prompt, policy_prompt
from eyechart.spaces.motion import Floats, Motion, MotionSpace
from eyechart.spaces.space import Decision
from eyechart.stats.total_effect import ROUNDING

MOST_CALLS = 20
ALIKE = 3
"""So many calls in a row that fail alike end the examination: each may load a network anew."""
_OUTCOMES = {True: "fine", False: "amiss", None: "cannot say"}
_FEW = 4
"""Further frames on which the numbers are held against the log."""
_LARGE, _SMALL, _AWAY = 3.0, 1 / 3, 2.0
"""Numbers so many times the log's, or a mean so many of its spreads away, are of another unit."""
_FAINT = 0.02
"""Of what another moment changes: a channel that changes less is next to none."""
_CONSTANT, _NOISY = 0.02, 0.5
"""Answers that vary less than this share of the log's are the same; those to one moment may vary this much of it."""
_FITS, _BETTER = 0.25, 0.25
"""An error below this share of the log's variance fits; another form of the pictures fits better by this factor."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One check: ``fine`` is True, False, or None where it could not be made; ``says`` why, in words."""

    name: str
    fine: bool | None
    says: str


@dataclass(frozen=True)
class PolicyDiagnosis:
    """What was found of a policy, and in how many calls."""

    spec: str
    findings: tuple[Finding, ...]
    calls: int

    @property
    def exit_code(self) -> int:
        """Return 0 where nothing is amiss, 1 where something is, and 2 where nothing could be checked."""
        fine = [one.fine for one in self.findings]
        return 1 if False in fine else 0 if True in fine else 2

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def lines(self) -> list[str]:
        """Return each check in words, with what is amiss in capitals, and how many calls it took."""
        words = {**_OUTCOMES, False: "AMISS"}
        found = [f"{words[one.fine]:<10}  {one.name}: {one.says}" for one in self.findings]
        return [*found, f"asked: {self.calls} calls"]

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        found = [{"check": one.name, "outcome": _OUTCOMES[one.fine], "says": one.says} for one in self.findings]
        return {"policy": self.spec, "calls": self.calls, "findings": found}


def examine_policy(
    policy: str | Opened,
    bank: FrameBank,
    *,
    timeout_s: float | None = None,
    tell: Callable[[int], None] = lambda _: None,
) -> PolicyDiagnosis:
    """Ask a policy about a few frames of a bank, and say what is amiss; ``policy`` is its SPEC, or it is open already.

    ``tell`` is told the number of each call before it is made. After three calls in a row that fail alike no more are.
    Raises SpecError for an unknown policy, or one that declares a channel that the bank has not, and BankError for a
    bank that declares no motion or has one episode.
    """
    opened = open_policy(policy, timeout_s)
    spec, model = opened.mode.spec, opened.model
    space = bank.manifest.motion
    if space is None:
        raise BankError(f"the bank {bank.root} does not say what a motion is, so no answer can be held against it")
    require_channels(spec, declared := _declared(model), bank)
    calls = _Calls(model, _Asked(bank, space), tell)
    return in_own_loop(_examine(spec, calls, declared))


def _declared(model: Model) -> tuple[str, ...]:
    """Return the channels that a policy declares to read, none where it declares nothing."""
    return tuple(filter(None, model.facts.get("channels", "").split(", ")))


def _spread(frames: Sequence[Frame]) -> tuple[Frame, ...]:
    """Return a few frames, of episodes far apart, each from another part of its own; fewer where there are fewer."""
    drives: dict[object, list[Frame]] = {}
    for frame in frames:
        drives.setdefault(frame.drive, []).append(frame)
    episodes = list(drives.values())
    found = []
    for number in range(_FEW):
        episode = episodes[len(episodes) * (2 * number + 1) // (2 * _FEW)]
        found.append(episode[len(episode) * (2 * number + 1) // (2 * _FEW)])
    return tuple({one.id: one for one in found}.values())


class _Asked:
    """The frames that are asked about, and what is asked: a moment, and one of another episode that differs."""

    def __init__(self, bank: FrameBank, space: MotionSpace) -> None:
        self.bank, self.space = bank, space
        self.prompt: Prompt = policy_prompt(space, instruction_column(bank))
        self.first = bank.frames[0]
        others = [frame for frame in bank if frame.drive != self.first.drive]
        if not others:
            raise BankError(f"the bank {bank.root} has one episode, and a policy is shown what another has")
        apart = [frame for frame in others if told(frame.fields) != told(self.first.fields)]
        self.other = (apart or others)[len(apart or others) // 2]
        self.further = _spread(bank.frames)
        self.logs = logs(bank)
        self.kept = {frame.id for frame in self.logs}

    def other_by(self, cameras: Sequence[str]) -> Frame | None:
        """Return a frame of another episode whose picture of any of these cameras is another; None where all are alike.

        It is the one of which all else is shown too, where that differs.
        """
        images = self.bank.manifest.images

        def seen(frame: Frame) -> list[str]:
            return [images.get(file, file) for file in (frame.pictures[name] for name in cameras)]

        others = (frame for frame in self.bank if frame.drive != self.first.drive)
        return next((one for one in (self.other, *others) if seen(one) != seen(self.first)), None)

    def of(self, frame: Frame) -> Stimulus:
        """Return all that a frame is."""
        return Stimulus(self.bank.images(frame), frame.fields, frame.state)

    @property
    def pair(self) -> tuple[Frame, ...]:
        """Return two of the further frames with a logged motion, told different things where there are such."""
        logged = [frame for frame in self.further if frame.id in self.kept]
        others = [frame for frame in logged[1:] if told(frame.fields) != told(logged[0].fields)] or logged[1:]
        return (*logged[:1], *others[:1])

    def forms(self, frame: Frame) -> dict[str, Stimulus]:
        """Return a moment with its pictures as a program before the policy may have left them, by what it did."""
        seen = self.of(frame)
        pixels = {name: decode(one, name) for name, one in seen.images.items()}
        names = list(pixels)
        made = {
            "red and blue exchanged": {name: one[..., ::-1] for name, one in pixels.items()},
            "turned by half": {name: one[::-1, ::-1] for name, one in pixels.items()},
            "the cameras exchanged": dict(zip(names, (pixels[name] for name in (*names[1:], names[0])), strict=True)),
        }
        return {
            what: replace(seen, images={name: encode(np.ascontiguousarray(one)) for name, one in many.items()})
            for what, many in made.items()
            if len(names) > 1 or what != "the cameras exchanged"
        }

    def logged(self, frames: Sequence[Frame], answers: Floats | None = None) -> Floats:
        """Return the logged motions of frames, or ``answers`` in their place, relative to their states."""
        return relative_log(frames, self.space) if answers is None else relative(answers, frames, self.space)

    def error(self, frame: Frame, answer: Motion) -> float:
        """Return the squared error to the logged motion, over the variance of all logged ones."""
        every = self.logged(self.logs)
        spread = np.maximum(every.std(axis=(0, 1)), 1e-9)
        given = flat_state(frame.state)
        own = np.array(given) if len(given) else None
        found, wanted = (self.space.relative(one, own) for one in (answer.array, np.array(frame.motion)))
        return float((((found - wanted) / spread) ** 2).mean())

    def changed(self) -> Iterator[tuple[str, Stimulus]]:
        """Yield the first moment with one thing changed: a channel of another's, or a grey picture."""
        mine, theirs = self.of(self.first), self.of(self.other)
        cameras = list(mine.images)
        if (other := self.other_by(cameras)) is not None:
            yield CAMERAS, replace(mine, images=self.bank.images(other))
        yield "grey", show("blank", self.first, self.bank, 0)
        if mine.state and mine.state != theirs.state:
            yield "state", replace(mine, state=theirs.state)
        if mine.fields and told(mine.fields) != told(theirs.fields):
            yield "instruction", replace(mine, fields=theirs.fields)
        for name in cameras if len(cameras) > 1 else ():
            if (other := self.other_by([name])) is not None:
                yield f"camera:{name}", replace(mine, images={**mine.images, name: self.bank.images(other)[name]})

    def alike(self) -> Iterator[str]:
        """Yield the channels of cameras whose pictures are the same in every other episode."""
        names = [one.name for one in self.first.cameras]
        if self.other_by(names) is None:
            yield CAMERAS
        yield from (f"camera:{name}" for name in names if len(names) > 1 and self.other_by([name]) is None)

    @property
    def given(self) -> str:
        """Return in words what a policy is given."""
        state = {name: len(numbers) for name, numbers in self.first.state.items()}
        numbers = f"a state of {sum(state.values())} numbers ({', '.join(state)})" if state else "no state"
        told = "an instruction" if self.first.fields else "no instruction"
        pixels = {name: decode(one, name) for name, one in self.bank.images(self.first).items()}
        pictures = ", ".join(f"{name}: {one.shape} {one.dtype}" for name, one in pixels.items())
        return f"the pictures {pictures}; {numbers}; {told}"


_UNASKED: Decision[Motion] = Decision(None, "error")
"""Stands for the answer to a call that was not made."""
_NUMBER = re.compile(r"0x[0-9a-f]+|\d+")


@dataclass
class _Calls:
    """Makes the calls, at most `MOST_CALLS`, and reads what comes back; after `ALIKE` failures alike it makes none."""

    model: Model
    asked: _Asked
    tell: Callable[[int], None]
    replies: list[Reply] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)

    @property
    def made(self) -> int:
        """Return how many calls were made."""
        return len(self.replies)

    @property
    def stopped(self) -> bool:
        """Return whether the last calls failed alike."""
        return len(self.failed) >= ALIKE

    async def motion(self, seen: Stimulus) -> Decision[Motion]:
        """Return the answer to one moment; `_UNASKED` where no more calls are made."""
        if self.made >= MOST_CALLS or self.stopped:
            return _UNASKED
        query: Query = self.asked.prompt.query(seen, 1, self.asked.space)
        self.tell(self.made + 1)
        reply = await ask(self.model, query)
        self.replies.append(reply)
        lacks = _NUMBER.sub("0", reply.error_detail) if reply.error else self.asked.space.lacks(reply)
        self.failed = [*(self.failed if lacks in self.failed else ()), *([lacks] if lacks else ())]
        return self.asked.space.read(reply)


async def _examine(spec: str, calls: _Calls, declared: tuple[str, ...]) -> PolicyDiagnosis:
    asked, model = calls.asked, calls.model
    try:
        mine, theirs = asked.of(asked.first), asked.of(asked.other)
        order = [await calls.motion(seen) for seen in (mine, mine, theirs, mine)]
        changed = {name: await calls.motion(seen) for name, seen in asked.changed()}
        further = {frame.id: await calls.motion(asked.of(frame)) for frame in asked.further}
        findings = [_motions(calls, [*order, *changed.values(), *further.values()])]
        forms = await _formed(calls, further) if not _drawn(order) else {}
    finally:
        await close(model)
    if order[0].action is not None:
        varies = len({one.action for one in (*order, *further.values())}) > 1
        seeded = model.facts.get("seedable") == "true"
        findings += [_again(order, varies=varies, seeded=seeded)]
        reached = list(_reached(order, changed))
        findings += [_as_declared(one, declared, reached) for one in reached]
        alike = "its pictures are the same in every other episode, so that nothing can be exchanged"
        findings += [Finding(name, None, alike) for name in asked.alike()]
        findings += [_varies(asked, order, further), _unit(asked, further), _form(forms)]
    return PolicyDiagnosis(spec, tuple(findings), calls.made)


def _motions(calls: _Calls, answers: list[Decision[Motion]]) -> Finding:
    """Say whether every call came back with a motion of the bank's shape, and if not, why and what to do."""
    made = [one for one in answers if one is not _UNASKED]
    without = [one for one in made if one.action is None]
    if not without:
        return Finding("motions", True, f"all {len(made)} calls came back with a motion {calls.asked.space.shape}")
    given = f" (it is given {calls.asked.given})"
    errors = (f"it fails: {reply.error_detail}{given}" for reply in calls.replies if reply.error is not None)
    lacks = (calls.asked.space.lacks(reply) for reply in calls.replies)
    said = "; ".join(dict.fromkeys([*list(errors)[:1], *filter(None, lacks)]))
    end = f". No more were made: the last {ALIKE} failed alike" if calls.stopped else ""
    return Finding("motions", False, f"{len(without)} of {len(made)} calls hold no motion: {said}{end}")


def _drawn(order: list[Decision[Motion]]) -> bool:
    """Return whether two answers to the same moment, one after the other, differ by more than rounding."""
    first, second, other, _ = (one.action for one in order)
    if first is None or second is None or other is None:
        return False
    return first != second and _apart(first, second) > ROUNDING * _apart(first, other)


def _again(order: list[Decision[Motion]], *, varies: bool, seeded: bool) -> Finding:
    """Say whether the same moment gets the same answer, also after another one; ``varies`` says that others differ.

    All calls have one seed, which fixes the answer of who is ``seeded``.
    """
    first, second, other, third = (one.action for one in order)
    if first is None or second is None or other is None or third is None:
        return Finding("same", None, "not every repeated call came back")
    if other == second and varies:
        said = "another moment got the answer of the one before: does it answer from a queue? declare reset"
        return Finding("same", False, said)
    if max(_apart(first, one) for one in (second, third)) <= ROUNDING * _apart(first, other):
        said = "the same moment gets the same answer, also after another one"
        return Finding("same", True, said if first == second == third else f"{said}, but for rounding")
    if first == second:
        said = "the same moment gets another answer after another moment: it keeps something; declare reset"
        return Finding("same", False, said)
    if seeded:
        return Finding("same", False, "it declares seedable, and the same moment gets two answers to one seed")
    return Finding("same", None, "the same moment gets two answers: it draws them, or keeps something")


def _reached(order: list[Decision[Motion]], changed: Mapping[str, Decision[Motion]]) -> Iterator[Finding]:
    """Yield, of each channel, whether another one changes a single bit of the answer, and next to nothing else."""
    first, other, drawn = order[0].action, order[2].action, _drawn(order)
    assert first is not None
    whole = 0.0 if other is None else _apart(first, other)
    rounds = any(one.action not in (first, None) for one in (order[1], order[3]))
    near = ROUNDING * whole if rounds else 0.0
    for name, one in changed.items():
        if one.action is None or drawn:
            why = "it was not asked" if one is _UNASKED else f"no motion: {one.reason}"
            why = "its answers are drawn, so that a change shows nothing" if drawn else why
            yield Finding(name, None, why)
        elif (size := _apart(first, one.action)) <= near:
            what = {"grey": "a grey picture", "state": "another state", "instruction": "another instruction"}.get(name)
            change = "the answer by no more than rounding" if rounds else "not one bit of the answer"
            said = f"{what or 'another picture'} changes {change}: does it reach the policy?"
            yield Finding(name, False, f"{said} is an earlier answer kept?")
        elif size < _FAINT * whole:
            said = f"it changes the answer by {size / whole:.2g} of what another moment does: it is ignored, or hardly"
            yield Finding(name, None, f"{said} to be seen (a picture that is divided by 255 twice?)")
        else:
            yield Finding(name, True, "it reaches the policy: the answer changes with it")


def _as_declared(found: Finding, declared: tuple[str, ...], others: Sequence[Finding]) -> Finding:
    """Return what is said of a channel, as the policy declares whether it reads it.

    ``cameras`` stand for all of them, together and one by one: of a camera that is not named, and that does not reach a
    policy which another one reaches, nobody knows whether it is to be read.
    """
    channel = CAMERAS if found.name == "grey" else found.name
    if not declared or found.fine is None:
        if found.fine is False and not declared:
            return replace(found, says=f"{found.says} a policy that is not to read it declares its channels")
        return found
    if reads(channel, declared):
        beside = [one for one in others if one.name.startswith(CAMERA) and one.name != channel and one.fine]
        if found.fine or channel in declared or not channel.startswith(CAMERA) or not beside:
            return found
        said = f"{found.says.partition(':')[0]}, and one of {beside[0].name} does"
        return Finding(
            found.name,
            None,
            f"{said}: is it to be read? it declares 'cameras', which are all; one that reads some names each",
        )
    if found.fine:
        said = "it declares that it does not read this, and the answer changes with it: declare it too"
        return Finding(found.name, False, said)
    return Finding(found.name, True, "it declares that it does not read this, and nothing changes with it")


def _apart(one: Motion, other: Motion) -> float:
    return float(np.sqrt(np.mean((one.array - other.array) ** 2)))


async def _formed(calls: _Calls, further: Mapping[str, Decision[Motion]]) -> dict[str, list[float]]:
    """Ask about two moments with their pictures in other forms, where it does not fit the log; errors by form."""
    asked = calls.asked
    given = [(frame, further[frame.id].action) for frame in asked.pair]
    found = {"": [asked.error(frame, action) for frame, action in given if action is not None]}
    if len(found[""]) < 2 or max(found[""]) < _FITS:
        return found
    for frame in asked.pair:
        for what, seen in asked.forms(frame).items():
            answer = (await calls.motion(seen)).action
            if answer is not None:
                found.setdefault(what, []).append(asked.error(frame, answer))
    return found


def _form(errors: Mapping[str, list[float]]) -> Finding:
    """Say whether pictures in another form bring the answers to the log, at both of two moments."""
    given = errors.get("", [])
    if len(given) < 2:
        return Finding("pictures", None, "their form was not tried: its answers are drawn, or the log is too short")
    better = {
        what: many
        for what, many in errors.items()
        if what and len(many) == 2 and max(many) < _FITS and sum(many) < _BETTER * sum(given)
    }
    if better:
        what = min(better, key=lambda one: sum(better[one]))
        said = f"with {what} its error to the log is {np.mean(better[what]):.2g} and not {np.mean(given):.2g}"
        return Finding("pictures", False, f"{said}: are they given as in its training?")
    if max(given) < _FITS:
        return Finding(
            "pictures",
            True,
            f"as they are given, its error on {len(given)} moments is at most {max(given):.2g} of the log's variance",
        )
    return Finding("pictures", None, "its answers are not the log's, and none of the forms that were tried mends that")


def _varies(asked: _Asked, order: list[Decision[Motion]], further: Mapping[str, Decision[Motion]]) -> Finding:
    """Say whether the answers to several moments vary, held against the log's, and against those to one moment."""
    given = {asked.first.id: order[0], asked.other.id: order[2]} | dict(further)
    answers = [(asked.bank.frame(name), one.action.array) for name, one in given.items() if one.action is not None]
    if len(answers) < 2:
        return Finding("constant", None, "another moment got no motion")
    numbers = asked.logged([frame for frame, _ in answers], np.stack([array for _, array in answers]))
    if (numbers == numbers[0]).all():
        return Finding("constant", False, "moments of different episodes get the same answer")
    logged = asked.logged(asked.logs) if asked.logs else np.zeros((0, 1, 1))
    spread = logged.std(axis=(0, 1)) if len(logged) else numbers.std(axis=(0, 1))
    units = np.where(spread > 0, spread, 1.0)
    varies = float((numbers / units).var(axis=0, ddof=1).mean())
    again = np.stack([one.action.array for one in (order[0], order[1], order[3]) if one.action is not None])
    noise = float((again / units).var(axis=0, ddof=1).mean()) if len(again) > 1 else 0.0
    usual = float((logged / units).var(axis=0).mean()) if len(logged) else 0.0
    if usual and varies < _CONSTANT * usual:
        said = f"its answers to {len(answers)} moments vary {varies / usual:.2g} times as much as the log"
        return Finding("constant", False, f"{said}: it is constant, or nearly so")
    if noise > _NOISY * varies:
        said = f"its answers to one moment differ {noise / varies:.2g} times as much as those to {len(answers)}"
        return Finding("constant", None, f"{said}: noise hides whether it is constant")
    size = f"{varies / usual:.2g} times as much as the log" if usual else "and there is no log to hold them against"
    return Finding("constant", True, f"its answers to {len(answers)} moments vary {size}")


def _unit(asked: _Asked, further: Mapping[str, Decision[Motion]]) -> Finding:
    """Say whether the numbers are of the log's size: a skipped normalisation, or another unit, is not.

    They are held against the log of these frames and of the whole bank: a few moments may call for next to no motion.
    """
    pairs = [(frame, further[frame.id].action) for frame in asked.further if frame.id in asked.kept]
    kept = [(frame, action.array) for frame, action in pairs if action is not None]
    if len(kept) < 2:
        return Finding("unit", None, "too few logged motions to hold the answers against")
    frames = [frame for frame, _ in kept]
    answers = asked.logged(frames, np.stack([numbers for _, numbers in kept]))
    logged, every = asked.logged(frames), asked.logged(asked.logs)
    here, usual, size = (np.maximum(np.sqrt((one**2).mean(axis=(0, 1))), 1e-9) for one in (logged, every, answers))
    most, least = size / np.maximum(here, usual), size / np.minimum(here, usual)
    sizes = np.where(most > 1, most, np.minimum(least, 1.0))
    away = np.abs(answers.mean(axis=(0, 1)) - logged.mean(axis=(0, 1))) / np.maximum(every.std(axis=(0, 1)), 1e-9)
    for number, one in enumerate(asked.space.dimensions):
        if every[..., number].std() < 1e-9:
            continue
        if _SMALL <= sizes[number] <= _LARGE and away[number] <= _AWAY:
            continue
        if np.ptp(answers[..., number]) == 0 < np.ptp(logged[..., number]):
            said = f"is '{one.name}' meant to be the same in every answer? it varies in the log"
            return Finding("unit", False, f"{said}; a run says so in a remark, and judges the other numbers")
        said = f"'{one.name}' is {sizes[number]:.2g} times as large as in the log"
        return Finding("unit", False, f"{said}: is its normalisation skipped, or its unit another?")
    return Finding("unit", True, f"its numbers are of the log's size ({sizes.min():.2g} to {sizes.max():.2g} times)")
