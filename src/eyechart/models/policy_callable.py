"""``python:MODULE:FUNCTION`` as a policy: any callable from pictures, a state and an instruction to an array.

The callable takes ``(images, state, instruction)``: a dict of uint8 arrays (h, w, 3) by camera, a float array of all
numbers of the state, and a text or None. It returns an array (horizon, dimensions). Every call stands alone: it is to
answer as at the beginning of an episode, with what it keeps of earlier moments emptied. What it declares of itself are
attributes: ``seedable`` (False): it takes ``seed=`` too and answers alike to the same one; ``version`` (the head of a
digest of its files); ``channels`` (all): the names of those that it reads; ``reset`` (none): called before every call;
``step`` (none): how far its training had come, by which checkpoints are put in order.
"""

import asyncio
from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from inspect import iscoroutinefunction, signature
from threading import Lock, Thread

import numpy as np

from eyechart.calls import Query, Reply
from eyechart.errors import SpecError
from eyechart.frames import pixels_of
from eyechart.models.python_callable import (
    NotCalledError,
    identity_of,
    import_callable,
    in_thread,
    made_of_class,
    name_of,
)
from eyechart.modes import RequestMode, without_secrets
from eyechart.spaces.motion import Motion

Act = Callable[..., object]

_ALONE: defaultdict[str, Lock] = defaultdict(Lock)
"""One call at a time of all callables of a module, since they may share a network."""

DECLARED: Mapping[str, object] = {"seedable": False, "version": "", "channels": None, "reset": None, "step": None}
"""What a callable may declare of itself, with what holds where it does not."""

_MAY_BE: Mapping[str, str] = {
    "seedable": "True or False",
    "version": "a text",
    "channels": "a list of texts, as ['cameras', 'state']: of cameras (all of them), camera:NAME, state, instruction",
    "reset": "a function that takes nothing",
    "step": "a whole number from 0 on",
}
"""What each of these may be, where it is declared."""


@dataclass(slots=True)
class PolicyCallable:
    """A policy behind the door of a model; each call in a thread of its own where it is a ``guest``.

    While ``alone`` is held by another call, none is made.

    ``facts`` hold what it declares: ``seedable`` and ``channels``.
    """

    act: Act
    version: str
    facts: Mapping[str, str]
    timeout_s: float
    seedable: bool = False
    reset: Callable[[], object] | None = None
    guest: bool = True
    left: set[Thread] = field(default_factory=set)
    alone: Lock = field(default_factory=Lock)

    async def answer(self, query: Query) -> Reply:
        """Call once. What it raises, and what takes longer than the mode's time, is a Reply with its kind."""
        try:
            async with asyncio.timeout(self.timeout_s) as limit:
                call = partial(self._call, query)
                motion = call() if not self.guest else await in_thread(call, self.left)
        except NotCalledError as error:
            return Reply(error="not_called", error_detail=str(error))
        except Exception as error:  # noqa: BLE001 - whatever a callable raises is a row, not the end of the run
            if isinstance(error, TimeoutError) and limit.expired():
                return Reply(error="timeout", error_detail=f"no answer within {self.timeout_s:g} s")
            return Reply(error="exception", error_detail=without_secrets(f"{type(error).__name__}: {error}")[:500])
        return Reply(text=motion.text, finish_reason="stop")

    def _call(self, query: Query) -> Motion:
        """Return what it answers; copies, so that no call changes what another is shown, or what it has answered."""
        seen = query.stimulus
        images = {name: pixels_of(one, name) for name, one in seen.images.items()}
        state = np.array([number for numbers in seen.state.values() for number in numbers], np.float64)
        seed = {"seed": query.seed} if self.seedable else {}
        with self.alone:  # another call may be under way that was given up
            if self.reset is not None:
                self.reset()
            return Motion.of(self.act(images, state, query.user or None, **seed))  # the next may fill the same buffer

    async def close(self) -> None:
        """Hold nothing, so let go of nothing."""


def open_model(name: str, mode: RequestMode) -> PolicyCallable:
    """Import the callable; raises SpecError that says what is missing, or what it declares wrongly of itself."""
    act, version, facts = import_callable(name)
    opened = _opened(act, mode, version, facts)
    opened.alone = _ALONE[name.rpartition(":")[0]]
    return opened


def hold(act: Act, mode: RequestMode) -> PolicyCallable:
    """Return a callable that is at hand as a policy, for example one of a notebook; ``mode`` names it.

    A version that it does not declare is that of `eyechart.models.python_callable.identity_of`. Raises SpecError where
    it cannot be called with (images, state, instruction), or declares something wrongly of itself.
    """
    opened = _opened(act, mode, *identity_of(act))
    opened.alone = _ALONE[name_of(act).partition(":")[0]]
    return opened


def _opened(act: Act, mode: RequestMode, found: str, digests: Mapping[str, str]) -> PolicyCallable:
    """Return a policy with what it declares; ``found`` is its version where it declares none."""
    own = {what: getattr(act, what, usual) for what, usual in DECLARED.items()}
    seedable, version, channels, reset, step = (own[what] for what in DECLARED)
    wrong = {
        "seedable": not isinstance(seedable, bool),
        "version": not isinstance(version, str),
        "channels": not (channels is None or (isinstance(channels, list | tuple) and all(map(_is_word, channels)))),
        "reset": not (reset is None or callable(reset)),
        "step": not (step is None or (isinstance(step, int) and not isinstance(step, bool) and step >= 0)),
    }
    if amiss := [what for what, bad in wrong.items() if bad]:
        raise SpecError(f"'{mode.spec}' declares {amiss[0]} = {own[amiss[0]]!r}, and that is {_MAY_BE[amiss[0]]}")
    if cannot := _cannot_be_called(act, *(("seed",) if seedable else ())):
        raise SpecError(f"'{mode.spec}' cannot be asked: {cannot}")
    facts = {"seedable": str(seedable).lower(), **digests}
    if isinstance(channels, list | tuple):
        facts["channels"] = ", ".join(channels)
    if step is not None:
        facts["step"] = str(step)
    return PolicyCallable(
        act,
        str(version) or found,
        facts,
        mode.timeout_s,
        seedable=bool(seedable),
        reset=reset if callable(reset) else None,
    )


def _cannot_be_called(act: Act, *named: str) -> str:
    """Return in words why a callable does not take what it will be given; nothing where it does, or does not say."""
    if words := made_of_class(act):
        return words
    if iscoroutinefunction(act) or iscoroutinefunction(type(act).__call__):
        return "it is an async function; a plain one is called, in a thread of its own"
    try:
        signature(act).bind({}, None, None, **dict.fromkeys(named))
    except TypeError as error:
        return (
            f"it is called with {', '.join(('images', 'state', 'instruction', *(f'{one}=' for one in named)))}: {error}"
        )
    except ValueError:  # of what is not written in Python
        return ""
    return ""


def _is_word(one: object) -> bool:
    return isinstance(one, str) and bool(one)


def names() -> dict[str, str]:
    """Return what may stand after ``python:``."""
    return {"MODULE:FUNCTION": "a callable of one's own, (images, state, instruction) -> array (horizon, dimensions)"}
