"""The doctor of policies: in at most twenty calls, whether what they are given reaches them, and what they answer."""

import asyncio
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from eyechart.attempts import close
from eyechart.calls import Query, Reply
from eyechart.channels import flat_state, instruction_column
from eyechart.conditions import show
from eyechart.errors import BankError
from eyechart.frames import Frame, FrameBank, Stimulus
from eyechart.models import Model, ask, open_model
from eyechart.modes import RequestMode
from eyechart.prompts import Prompt, policy_prompt
from eyechart.spaces.motion import Motion, MotionSpace
from eyechart.spaces.space import Decision

MOST_CALLS = 20
_FEW = 4
"""Further frames on which the numbers are held against the log."""
_LARGE, _SMALL, _AWAY = 3.0, 1 / 3, 2.0
"""Numbers so many times the log's, or a mean so many of its spreads away, are of another unit."""


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

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        words = {True: "fine", False: "amiss", None: "cannot say"}
        found = [{"check": one.name, "outcome": words[one.fine], "says": one.says} for one in self.findings]
        return {"policy": self.spec, "calls": self.calls, "findings": found}


def examine_policy(spec: str, bank: FrameBank, *, timeout_s: float | None = None) -> PolicyDiagnosis:
    """Ask a policy about a few frames of a bank, and say what is amiss.

    Raises SpecError for an unknown policy, and BankError for a bank that declares no motion or has one episode.
    """
    mode = RequestMode(spec) if timeout_s is None else RequestMode(spec, timeout_s=timeout_s)
    model = open_model(spec, mode, answering="policy")
    space = bank.manifest.motion
    if space is None:
        raise BankError(f"the bank {bank.root} does not say what a motion is, so no answer can be held against it")
    return asyncio.run(_examine(spec, model, _Asked(bank, space)))


class _Asked:
    """The frames that are asked about, and what is asked: a moment, and one of another episode that differs."""

    def __init__(self, bank: FrameBank, space: MotionSpace) -> None:
        self.bank, self.space = bank, space
        self.prompt: Prompt = policy_prompt(space, instruction_column(bank))
        self.first = bank.frames[0]
        others = [frame for frame in bank if frame.drive != self.first.drive]
        if not others:
            raise BankError(f"the bank {bank.root} has one episode, and a policy is shown what another has")
        told = [frame for frame in others if frame.fields != self.first.fields]
        self.other = (told or others)[len(told or others) // 2]
        step = max(1, len(bank) // _FEW)
        self.further = tuple(bank.frames[step // 2 :: step][:_FEW])

    def of(self, frame: Frame) -> Stimulus:
        """Return all that a frame is."""
        return Stimulus(self.bank.images(frame), frame.fields, frame.state)

    def changed(self) -> Iterator[tuple[str, Stimulus]]:
        """Yield the first moment with one thing changed: a channel of the other's, or a key that is missing."""
        mine, theirs = self.of(self.first), self.of(self.other)
        cameras = list(mine.images)
        yield "cameras", replace(mine, images=theirs.images)
        yield "grey", show("blank", self.first, self.bank, 0)
        if mine.state and mine.state != theirs.state:
            yield "state", replace(mine, state=theirs.state)
        if mine.fields and mine.fields != theirs.fields:
            yield "instruction", replace(mine, fields=theirs.fields)
        for name in cameras if len(cameras) > 1 else ():
            yield f"camera:{name}", replace(mine, images={**mine.images, name: theirs.images[name]})


@dataclass
class _Calls:
    """Makes the calls, at most `MOST_CALLS`, and reads what comes back."""

    model: Model
    asked: _Asked
    made: int = 0
    replies: list[Reply] = field(default_factory=list)

    async def motion(self, seen: Stimulus) -> Decision[Motion]:
        """Return the answer to one moment; ``error`` where no more calls may be made."""
        if self.made >= MOST_CALLS:
            return Decision(None, "error")
        query: Query = self.asked.prompt.query(seen, 1, self.asked.space)
        self.made += 1
        reply = await ask(self.model, query)
        self.replies.append(reply)
        return self.asked.space.read(reply)


async def _examine(spec: str, model: Model, asked: _Asked) -> PolicyDiagnosis:
    calls = _Calls(model, asked)
    try:
        mine, theirs = asked.of(asked.first), asked.of(asked.other)
        order = [await calls.motion(seen) for seen in (mine, mine, theirs, mine)]
        changed = {name: await calls.motion(seen) for name, seen in asked.changed()}
        further = {frame.id: await calls.motion(asked.of(frame)) for frame in asked.further}
    finally:
        await close(model)
    answers = [*order, *changed.values(), *further.values()]
    findings = [_motions(calls, answers)]
    if order[0].action is not None:
        varies = len({one.action for one in (*order, *further.values())}) > 1
        seeded = model.facts.get("seedable") == "true"
        findings += [_again(order, varies=varies, seeded=seeded), *_reached(order[0].action, changed, _drawn(order))]
        findings += [_varies(order), _unit(asked, further)]
    return PolicyDiagnosis(spec, tuple(findings), calls.made)


def _motions(calls: _Calls, answers: list[Decision[Motion]]) -> Finding:
    """Say whether every call came back with a motion of the bank's shape, and if not, why."""
    without = [one for one in answers if one.action is None]
    if not without:
        return Finding("motions", True, f"all {len(answers)} calls came back with a motion {calls.asked.space.shape}")
    errors = [reply.error_detail for reply in calls.replies if reply.error is not None]
    shapes = {str(Motion.read(reply.text).shape) for reply in calls.replies if reply.error is None}
    words = {
        "unparsed: wrong_shape": f"its answers have the shape {', '.join(sorted(shapes))}, and the bank's motions "
        f"{calls.asked.space.shape}",
        "unparsed: not_finite": "it answers with numbers that are none (NaN or infinite)",
        "error": f"it fails: {errors[0]}" if errors else "it fails",
    }
    reasons = dict.fromkeys(str(one.reason) for one in without)
    said = "; ".join(words.get(reason, reason) for reason in reasons)
    return Finding("motions", False, f"{len(without)} of {len(answers)} calls hold no motion: {said}")


def _drawn(order: list[Decision[Motion]]) -> bool:
    return order[0].action != order[1].action


def _again(order: list[Decision[Motion]], *, varies: bool, seeded: bool) -> Finding:
    """Say whether the same moment gets the same answer, also after another one; ``varies`` says that others differ.

    All calls have one seed, which fixes the answer of who is ``seeded``.
    """
    first, second, other, third = (one.action for one in order)
    if None in {second, other, third}:
        return Finding("same", None, "not every repeated call came back")
    if other == second and varies:
        said = "another moment got the answer of the one before: does it answer from a queue? declare reset"
        return Finding("same", False, said)
    if first == second == third:
        return Finding("same", True, "the same moment gets the same answer, also after another one")
    if first == second:
        said = "the same moment gets another answer after another moment: it keeps something; declare reset"
        return Finding("same", False, said)
    if seeded:
        return Finding("same", False, "it declares seedable, and the same moment gets two answers to one seed")
    return Finding("same", None, "the same moment gets two answers: it draws them, or keeps something")


def _reached(first: Motion, changed: Mapping[str, Decision[Motion]], drawn: bool) -> Iterator[Finding]:  # noqa: FBT001
    """Yield, of each channel, whether another one changes a single bit of the answer."""
    for name, one in changed.items():
        if one.action is None or drawn:
            why = "its answers are drawn, so that a change shows nothing" if drawn else f"no motion: {one.reason}"
            yield Finding(name, None, why)
        elif one.action == first:
            what = {"grey": "grey pictures", "state": "another state", "instruction": "another instruction"}.get(name)
            said = f"{what or 'another picture'} changes not one bit of the answer: does it reach the policy?"
            yield Finding(name, False, said)
        else:
            yield Finding(name, True, "it reaches the policy: the answer changes with it")


def _varies(order: list[Decision[Motion]]) -> Finding:
    first, other = order[0].action, order[2].action
    if other is None or first is None:
        return Finding("constant", None, "another moment got no motion")
    apart = float(np.abs(first.array - other.array).max())
    if apart == 0:
        return Finding("constant", False, "two moments of different episodes get the same answer")
    return Finding("constant", True, f"two moments of different episodes differ by up to {apart:.3g}")


def _unit(asked: _Asked, further: Mapping[str, Decision[Motion]]) -> Finding:
    """Say whether the numbers are of the log's size: a skipped normalisation, or another unit, is not."""
    pairs = [(frame, further[frame.id].action) for frame in asked.further if frame.motion]
    kept = [(frame, action.array) for frame, action in pairs if action is not None]
    if len(kept) < 2:
        return Finding("unit", None, "too few logged motions to hold the answers against")
    states = np.array([flat_state(frame.state) for frame, _ in kept])
    given = states if states.size else None
    logged = asked.space.relative(np.array([frame.motion for frame, _ in kept]), given)
    answers = asked.space.relative(np.stack([numbers for _, numbers in kept]), given)
    spread = np.maximum(logged.std(axis=(0, 1)), 1e-9)
    sizes = np.sqrt((answers**2).mean(axis=(0, 1))) / np.maximum(np.sqrt((logged**2).mean(axis=(0, 1))), 1e-9)
    away = np.abs(answers.mean(axis=(0, 1)) - logged.mean(axis=(0, 1))) / spread
    for number, one in enumerate(asked.space.dimensions):
        if logged[..., number].std() < 1e-9:
            continue
        if not _SMALL <= sizes[number] <= _LARGE or away[number] > _AWAY:
            said = f"'{one.name}' is {sizes[number]:.2g} times as large as in the log"
            return Finding("unit", False, f"{said}: is its normalisation skipped, or its unit another?")
    return Finding("unit", True, f"its numbers are of the log's size ({sizes.min():.2g} to {sizes.max():.2g} times)")
