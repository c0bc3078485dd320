"""``python:MODULE:FUNCTION`` as a policy: any callable from pictures and a state to an array.

The callable takes ``(images, state, instruction)``. ``images`` is a dict of uint8 arrays (h, w, 3)
by camera, ``state`` a float array of all its numbers, and ``instruction`` a text or None. It
returns an array (horizon, dimensions), or a dict with no other array than that one, as ``actions``
or ``action``. ``python:MODULE:OBJECT.METHOD`` names a method. Calls are independent: the callable
must answer each as at the beginning of an episode, without a memory of earlier calls.

With ``history`` N above 0, it gets N instants before the frame too, from a bank that holds them.
Each picture then has the shape (N + 1, h, w, 3) and the state (N + 1, d), with the oldest first and
the frame last. LeRobot's ``n_obs_steps`` counts the frame: it is N + 1.

Attributes, with their defaults:
``seedable`` (False): it also takes ``seed=``, and equal seeds give equal answers. ``version`` (the
start of a digest of its files). ``channels`` (all): the names of the inputs that it reads.
``reset`` (none): called before every call. ``step`` (none): its training step, which orders
checkpoints. ``batch`` (none): it takes lists of up to so many images, states and instructions, with
``seed`` a list too. It returns a list of as many arrays, or an array of them. ``history`` (0): see above.
"""

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from inspect import Signature, iscoroutinefunction, isgeneratorfunction, signature
from threading import Lock, Thread

import numpy as np

from eyechart.calls import Query, Reply
from eyechart.channels import flat_state
from eyechart.errors import SpecError
from eyechart.frames import RGB, Stimulus, pixels_of
from eyechart.models import HISTORY, history_of
from eyechart.models.batches import SIZES, Batches, in_time, is_size
from eyechart.models.python_callable import (
    HISTORIES,
    identity_of,
    import_callable,
    in_thread,
    is_history,
    made_of_class,
    name_of,
)
from eyechart.modes import RequestMode
from eyechart.spaces.motion import Floats, Motion

Act = Callable[..., object]

_ALONE: defaultdict[str, Lock] = defaultdict(Lock)
"""A lock for each module: its callables may share a network, so one call runs at a time."""

DECLARED: Mapping[str, object] = {
    "seedable": False,
    "version": "",
    "channels": None,
    "reset": None,
    "step": None,
    HISTORY: 0,
    "batch": None,
}
"""The attributes that a callable may declare, with their defaults."""

_MAY_BE: Mapping[str, str] = {
    "seedable": "True or False",
    "version": "a text",
    "channels": "a list of texts, as ['cameras', 'state']: of cameras (all of them), camera:NAME, state, instruction",
    "reset": "a function that takes nothing",
    "step": "a whole number from 0 on",
    HISTORY: HISTORIES,
    "batch": SIZES,
}
"""The allowed values of each attribute, in words."""


@dataclass(slots=True)
class PolicyCallable:
    """A policy as a model; each call of a ``guest`` runs in a thread of its own.

    A call waits while another one holds ``alone``. ``facts`` hold what the callable declares:
    ``seedable``, ``channels``, ``step``, ``batch`` and ``history``.
    """

    act: Act
    version: str
    facts: Mapping[str, str]
    timeout_s: float
    seedable: bool = False
    reset: Callable[[], object] | None = None
    history: int = 0
    guest: bool = True
    left: set[Thread] = field(default_factory=set)
    alone: Lock = field(default_factory=Lock)
    batch: int | None = None
    batches: Batches = field(init=False)

    def __post_init__(self) -> None:
        self.batches = Batches(self.batch or 1, self._replies)

    async def answer(self, query: Query) -> Reply:
        """Call once. An exception, or a call past the mode's time limit, is a failed Reply."""
        return await self.batches.answer(query) if self.batch else (await self._replies([query]))[0]

    async def _replies(self, queries: Sequence[Query]) -> list[Reply]:
        return await in_time(self.timeout_s, queries, self._answers(queries))

    async def _answers(self, queries: Sequence[Query]) -> Sequence[Reply | Exception]:
        call = partial(self._call, queries)
        answers = call() if not self.guest else await in_thread(call, self.left)
        return [one if isinstance(one, Exception) else Reply(text=one.text, finish_reason="stop") for one in answers]

    def _call(self, queries: Sequence[Query]) -> Sequence[Motion | Exception]:
        """Return the answers. Inputs and answers are copies: no call changes those of another."""
        given = [(*arrays_of(query.stimulus, self.history), query.user or None) for query in queries]
        seeds = [query.seed for query in queries]
        with self.alone:  # a call after its time limit may still run
            if self.reset is not None:
                self.reset()
            # The answers are copies: the next call may reuse the buffer.
            if self.batch is None:
                return [Motion.of(self.act(*given[0], **({"seed": seeds[0]} if self.seedable else {})))]
            lists = map(list, zip(*given, strict=True))
            return Motion.each(self.act(*lists, **({"seed": seeds} if self.seedable else {})), len(queries))

    async def close(self) -> None:
        """Do nothing: there is nothing to release."""


def arrays_of(seen: Stimulus, history: int = 0) -> tuple[dict[str, RGB], Floats]:
    """Return pictures by camera, shape (h, w, 3), uint8, and all numbers of the state, shape (d,).

    With ``history`` above 0 both have a first axis of ``history + 1`` instants, the oldest first.
    Raises ValueError if there are fewer, or if a camera's pictures differ in size.
    """
    window = seen.window(history)
    images = {name: np.stack([pixels_of(one.images[name], name) for one in window]) for name in seen.images}
    state = np.array([flat_state(one.state) for one in window], np.float64)
    return (images, state) if history else ({name: many[0] for name, many in images.items()}, state[0])


def open_model(name: str, mode: RequestMode) -> PolicyCallable:
    """Import the callable; raises SpecError where it is missing or declares a wrong value."""
    act, version, facts = import_callable(name)
    opened = _opened(act, mode, version, facts)
    opened.alone = _ALONE[name.rpartition(":")[0]]
    return opened


def hold(act: Act, mode: RequestMode) -> PolicyCallable:
    """Return a callable object as a policy, for example from a notebook; ``mode`` names it.

    Its default version is that of `eyechart.models.python_callable.identity_of`. Raises SpecError
    where it does not take (images, state, instruction), or declares a wrong value.
    """
    opened = _opened(act, mode, *identity_of(act))
    opened.alone = _ALONE[name_of(act).partition(":")[0]]
    return opened


def _opened(act: Act, mode: RequestMode, found: str, digests: Mapping[str, str]) -> PolicyCallable:
    """Return a policy with its declared attributes; ``found`` is the default version."""
    own = {what: getattr(act, what, usual) for what, usual in DECLARED.items()}
    seedable, version, reset, batch = (own[what] for what in ("seedable", "version", "reset", "batch"))
    if amiss := [what for what, is_right in _IS_RIGHT.items() if not is_right(own[what])]:
        raise SpecError(f"'{mode.spec}' declares {amiss[0]} = {own[amiss[0]]!r}; it must be {_MAY_BE[amiss[0]]}")
    if cannot := _cannot_be_called(act, *(("seed",) if seedable else ())):
        raise SpecError(f"'{mode.spec}' cannot be called: {cannot}")
    facts = {**_facts(own), **digests}
    return PolicyCallable(
        act,
        str(version) or found,
        facts,
        mode.timeout_s,
        seedable=bool(seedable),
        reset=reset if callable(reset) else None,
        history=history_of(facts),
        batch=batch if isinstance(batch, int) else None,
    )


def _facts(own: Mapping[str, object]) -> dict[str, str]:
    """Return the facts that a run keeps of what a callable declares."""
    facts, channels = {"seedable": str(own["seedable"]).lower()}, own["channels"]
    if isinstance(channels, list | tuple):
        facts["channels"] = ", ".join(channels)
    numbers = {name: own[name] for name in ("step", HISTORY, "batch")}
    # A history of 0 is none; a step of 0 is one.
    return facts | {name: str(one) for name, one in numbers.items() if one is not None and (one or name == "step")}


def _cannot_be_called(act: Act, *named: str) -> str:
    """Return why a callable cannot take its arguments; "" where it can, or has no signature."""
    if words := made_of_class(act):
        return words
    for is_one, words in _LATE.items():
        if is_one(act) or is_one(type(act).__call__):
            return words
    try:
        signature(act).bind({}, None, None, **dict.fromkeys(named))
    except TypeError as error:
        given = ", ".join(("images", "state", "instruction", *(f"{one}=" for one in named)))
        own = _parameters(signature(act))
        if own.startswith("prompt, image"):
            return f"it takes ({own}), as a controller does: ask it with 'eyechart run battery' and --model"
        words = f"it must take the arguments ({given}) by position, and has ({own}): {error}"
        return f"{words}. Name a function that takes them and calls it"
    except ValueError:  # a callable that is not written in Python has no signature
        return ""
    return ""


def _parameters(taken: Signature) -> str:
    """Return the names of parameters as they stand in a ``def``, with * before those by name alone."""
    bare = [one.replace(annotation=one.empty, default=one.empty) for one in taken.parameters.values()]
    return str(Signature(bare)).strip("()")


_LATE: Mapping[Callable[[object], bool], str] = {
    iscoroutinefunction: "it is an async function; make it a plain one: each call runs in a thread of its own",
    isgeneratorfunction: "it yields; let it return the array (horizon, dimensions) instead",
}
"""Why functions that answer later cannot be called."""


def _is_word(one: object) -> bool:
    return isinstance(one, str) and bool(one)


def _are_words(channels: object) -> bool:
    return channels is None or (isinstance(channels, list | tuple) and all(map(_is_word, channels)))


def _is_step(step: object) -> bool:
    return step is None or (isinstance(step, int) and not isinstance(step, bool) and step >= 0)


_IS_RIGHT: Mapping[str, Callable[[object], bool]] = {
    "seedable": lambda one: isinstance(one, bool),
    "version": lambda one: isinstance(one, str),
    "channels": _are_words,
    "reset": lambda one: one is None or callable(one),
    "step": _is_step,
    HISTORY: is_history,
    "batch": is_size,
}
"""Whether a declared value of each attribute is allowed."""


def names() -> dict[str, str]:
    """Return what may stand after ``python:``."""
    return {"MODULE:FUNCTION": "a callable of your own, (images, state, instruction) -> array (horizon, dimensions)"}
