"""``python:MODULE:FUNCTION``: any callable from words and picture to text, for a stack of one's own.

The callable takes ``(prompt: str, image: bytes | None)``, the picture as encoded PNG or JPEG bytes or None, or
``(prompt, images, state)``, the pictures by camera and numbers by name. It returns the answer as text, or a Reply where
it knows more (tokens, finish reason). It may be asynchronous; a synchronous one runs in a thread, several at once up to
the run's concurrency; while 16 of those that were given up have not returned, no further call is begun.
"""

import asyncio
import hashlib
import inspect
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from pathlib import Path
from types import CellType, CodeType, FunctionType, MethodType
from typing import TypeVar
from weakref import WeakKeyDictionary

import numpy as np

from eyechart.calls import Query, Reply
from eyechart.errors import SpecError, raising
from eyechart.models import require_options
from eyechart.models.energy import metered
from eyechart.models.sources import facts_of, version_of
from eyechart.modes import RequestMode, without_secrets

OPTIONS = {"energy": "true measures this machine's energy during a call, for a model that runs here"}

Ask = Callable[..., object]
T = TypeVar("T")

_DEPTH = 4
"""How deep collections are looked into for what a callable holds."""
_FIRST: WeakKeyDictionary[object, str] = WeakKeyDictionary()
"""What each callable held when it was first taken."""

_CALL = "eyechart-call"
"""The name of the threads in which callables are called."""

LEFT_AT_MOST = 16
"""Calls that were given up and have not returned; while there are so many no further one is begun."""


@dataclass(slots=True)
class PythonCallable:
    """A callable behind the door of a model; ``version`` is the head of a digest of its files."""

    ask: Ask
    mode: RequestMode
    version: str
    facts: Mapping[str, str]
    whole: bool = False
    """Whether it takes all pictures and the state, and not one picture alone."""
    left: set[threading.Thread] = field(default_factory=set)

    async def answer(self, query: Query) -> Reply:
        """Call once. What it raises, and what takes longer than the mode's time, is a Reply with its kind."""
        call = self._call(query)
        return await metered(call) if self.mode.options.get("energy") else await call

    async def _call(self, query: Query) -> Reply:
        prompt = f"{query.system}\n\n{query.user}" if query.system else query.user
        try:
            async with asyncio.timeout(self.mode.timeout_s) as limit:
                said = await self._ask(prompt, *self._seen(query))
        except NotCalledError as error:
            return Reply(error="not_called", error_detail=str(error))
        except Exception as error:  # noqa: BLE001 - whatever a callable raises is a row, not the end of the run
            if isinstance(error, TimeoutError) and limit.expired():
                return Reply(error="timeout", error_detail=f"no answer within {self.mode.timeout_s:g} s")
            words = without_secrets(f"{type(error).__name__}: {error}")
            return Reply(error="exception", error_detail=words[:500])
        if isinstance(said, Reply):
            return said
        if isinstance(said, str):
            return Reply(text=said)
        words = f"the callable returned a {type(said).__name__}, not a text or a Reply"
        return Reply(error="exception", error_detail=words)

    def _seen(self, query: Query) -> tuple[object, ...]:
        """Return what the callable takes beside the prompt, its own to change.

        Raises TypeError where that would hide a camera.
        """
        if self.whole:
            return dict(query.stimulus.images), dict(query.stimulus.state)
        if len(query.images) > 1:
            cameras = ", ".join(query.stimulus.images)
            raise TypeError(f"it takes one image and the frame has {cameras}; let it take (prompt, images, state)")
        return (query.image,)

    async def _ask(self, *given: object) -> object:
        if inspect.iscoroutinefunction(self.ask) or inspect.iscoroutinefunction(type(self.ask).__call__):
            return await self.ask(*given)  # type: ignore[misc]
        return await in_thread(partial(self.ask, *given), self.left)

    async def close(self) -> None:
        """Hold nothing, so let go of nothing."""


class NotCalledError(Exception):
    """A call was not begun, because too many that were given up have not returned."""


async def in_thread(ask: Callable[[], T], left: set[threading.Thread]) -> T:
    """Call in a thread that nobody waits for at the end of the program, should it never return.

    A given-up call leaves its thread among ``left``; NotCalledError while too many of these have not ended.
    """
    left -= {thread for thread in left if not thread.is_alive()}
    if len(left) >= LEFT_AT_MOST:
        raise NotCalledError(f"not called: {len(left)} earlier calls have not returned")
    loop = asyncio.get_running_loop()
    done: asyncio.Future[T] = loop.create_future()

    def settle(ending: Callable[[], None]) -> None:
        if not done.done():
            ending()

    def work() -> None:
        try:
            ending = partial(done.set_result, ask())
        except StopIteration as stop:  # a Future cannot carry it
            ending = partial(done.set_exception, RuntimeError(f"StopIteration: {stop}"))
        except BaseException as raised:  # noqa: BLE001 - it must reach the caller, or he waits for ever
            error = raised if isinstance(raised, Exception) else RuntimeError(f"{type(raised).__name__}: {raised}")
            ending = partial(done.set_exception, error)
        if not loop.is_closed():
            loop.call_soon_threadsafe(settle, ending)

    thread = threading.Thread(target=work, name=_CALL, daemon=True)
    try:
        thread.start()
    except RuntimeError as error:  # the system has no room for one more
        raise NotCalledError(f"not called: {error}") from error
    try:
        return await done
    except asyncio.CancelledError:
        left.add(thread)
        raise


def under_way() -> frozenset[threading.Thread]:
    """Return the threads in which callables are being called, also where nobody waits for them any more."""
    return frozenset(one for one in threading.enumerate() if one.name == _CALL)


def open_model(name: str, mode: RequestMode) -> PythonCallable:
    """Import the callable; raises SpecError that says what is missing. Modules of the current folder are found."""
    require_options(mode, OPTIONS)
    ask, version, facts = import_callable(name)
    return PythonCallable(ask, mode, version, facts, _takes_all(ask, name))


def hold(ask: Ask, mode: RequestMode) -> PythonCallable:
    """Return a callable that is at hand as a model; ``mode`` names it, see `name_of`, and `identity_of` its version.

    Raises SpecError where it takes other than (prompt, image) or (prompt, images, state).
    """
    require_options(mode, OPTIONS)
    whole = _takes_all(ask, mode.spec.partition(":")[2])
    version, facts = identity_of(ask)
    return PythonCallable(ask, mode, version, facts, whole)


def identity_of(ask: Ask) -> tuple[str, dict[str, str]]:
    """Return the version of a callable that is at hand, with the digests that it is the head of.

    It is that of its module's files, as where it is imported by its SPEC; of one that no file holds, as in a notebook,
    of its own code, in which what it takes from elsewhere has no part. What a partial, a closure or an object holds is
    part of it as far as it is text, numbers, arrays and collections of these; of what else it holds, a network say, the
    type alone: give such models folders of their own.
    """
    written, more = _written(ask), list[str]()
    digests = facts_of(sys.modules.get(written.__module__)) if _is_in_a_file(written) else {}
    facts = digests or {"code_sha256": hashlib.sha256(_source(written)).hexdigest()}
    if held := _held(ask).strip():
        code = "\n".join(_code(written)) if digests else ""
        more.append(hashlib.sha256(f"{held}\n{code}".encode()).hexdigest())
        facts["state_sha256"] = more[0]
    if digests:
        facts |= version_of(digests, *more)
        return facts.pop("version"), facts
    version = hashlib.sha256("".join(facts.values()).encode()).hexdigest() if more else facts["code_sha256"]
    return version[:12], facts


def _is_in_a_file(written: FunctionType | type) -> bool:
    try:
        return Path(inspect.getfile(written)).is_file()
    except (TypeError, OSError):  # of a class that a notebook holds, or that is built in
        return False


def name_of(ask: Ask) -> str:
    """Return ``MODULE:FUNCTION`` of a callable; of an object, of its class."""
    written = _written(ask)
    function = written.__qualname__.replace("<lambda>", "lambda").replace(".<locals>", "")
    return f"{written.__module__}:{function}"


def _written(ask: object) -> FunctionType | type:
    """Return what somebody wrote: of a partial or a method its function, of an object its class."""
    while isinstance(ask, partial | MethodType):
        ask = ask.func if isinstance(ask, partial) else ask.__func__
    if isinstance(ask, FunctionType):
        ask = inspect.unwrap(ask)
    return ask if isinstance(ask, FunctionType | type) else type(ask)


def _source(written: object) -> bytes:
    return "\n".join(_code(written)).encode()


def _held(ask: object) -> str:
    """Return what a callable held when it was first taken: one that counts its calls stays the same model."""
    try:
        return _FIRST[ask] if ask in _FIRST else _FIRST.setdefault(ask, "\n".join(_state(ask)))
    except TypeError:  # of a class with slots, or without a hash
        return "\n".join(_state(ask))


def _state(ask: object) -> Iterator[str]:
    """Yield what a callable holds beside its code: a partial, a method, a closure, a lambda or an object."""
    if isinstance(ask, partial):
        yield from _values(ask.args)
        yield from _values(ask.keywords)
        yield _held(ask.func)
    elif isinstance(ask, MethodType):
        yield _held(ask.__self__)
        yield _held(ask.__func__)
    elif isinstance(ask, FunctionType):
        yield from _values([cell.cell_contents for cell in ask.__closure__ or () if _is_full(cell)])
        if ask.__name__ == "<lambda>":  # a file holds many
            yield from _code(ask)
            yield from _values(ask.__defaults__ or ())
    elif not isinstance(ask, type):
        try:
            yield from _values(vars(ask))
        except TypeError:  # a class with slots
            yield type(ask).__qualname__


def _is_full(cell: CellType) -> bool:
    try:
        return cell.cell_contents is not _state
    except ValueError:  # a variable that has no value yet
        return False


def _values(value: object, depth: int = 0) -> Iterator[str]:
    """Yield values that are the same in every process; of others the type."""
    if value is None or isinstance(value, str | int | float | complex | bytes):
        yield repr(value)
    elif isinstance(value, np.ndarray) and not value.dtype.hasobject:
        yield f"{value.dtype} {value.shape} {hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()}"
    elif isinstance(value, Mapping | Sequence | frozenset | set) and depth < _DEPTH:
        inside = value.items() if isinstance(value, Mapping) else value
        if not isinstance(value, Sequence):
            inside = sorted(inside, key=repr)
        for one in inside:
            yield from _values(one, depth + 1)
    elif isinstance(value, FunctionType):
        yield from _code(value)
    elif isinstance(value, MethodType | partial):
        yield _held(value)
    else:
        yield type(value).__qualname__


def _code(written: object) -> Iterator[str]:
    """Yield what a function, or a class with its methods, does, the same in every process."""
    if isinstance(written, type):
        for name, one in sorted(vars(written).items()):
            yield name
            yield from _code(one.__func__ if isinstance(one, staticmethod | classmethod) else one)
    code = written.__code__ if isinstance(written, FunctionType) else written
    if isinstance(code, CodeType):
        yield f"{code.co_code.hex()} {code.co_names} {code.co_varnames}"
        for constant in code.co_consts:
            if isinstance(constant, CodeType):
                yield from _code(constant)
            elif not isinstance(constant, frozenset):  # whose order is another in each process
                yield repr(constant)


def import_callable(name: str) -> tuple[Ask, str, dict[str, str]]:
    """Import ``MODULE:FUNCTION``; return it with its version and the digests of the files that it is made of.

    Raises SpecError that says what is missing. Modules of the current folder are found.
    """
    module_name, colon, function = name.rpartition(":")
    if not colon or not module_name or not function:
        near = _perhaps(name) or "for example python:my_robot:decide"
        raise SpecError(f"'python:{name}' is given as python:MODULE:FUNCTION, {near}")
    if module_name.endswith(".py") or "/" in module_name or "\\" in module_name:
        near = f"python:{Path(module_name.replace(chr(92), '/')).stem}:{function}"
        raise SpecError(
            f"'python:{name}' takes a module's name, not its file: '{near}', from the folder in which the file lies"
        )
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.append(here)
    try:
        module = import_module(module_name)
    except ImportError as error:
        raise SpecError(
            f"'python:{name}': module '{module_name}' cannot be imported: {without_secrets(str(error))}"
        ) from error
    except (Exception, SystemExit) as error:
        words = without_secrets(f"{type(error).__name__}: {error}")[:500]
        raise SpecError(f"'python:{name}': module '{module_name}' fails while it is imported: {words}") from error
    ask: Ask | None = getattr(module, function, None)
    if not callable(ask):
        raise SpecError(f"'python:{name}': module '{module_name}' has no callable '{function}'")
    if not (facts := facts_of(module)):
        return ask, "no file", {}
    facts |= version_of(facts)
    return ask, facts.pop("version"), facts


def _perhaps(name: str) -> str:
    """Return what may be meant by a name without a colon between module and function; nothing where nobody knows."""
    path, dot, function = name.rstrip(":").rpartition(".")
    if function == "py" or not dot or not path or not function:
        return ""
    return f"did you mean 'python:{path}:{function}'?"


def made_of_class(ask: object) -> str:
    """Return in words that a callable is a class, which would be made and not asked; nothing where it is none."""
    if not inspect.isclass(ask):
        return ""
    name = ask.__name__
    return f"it is a class: make an object of it in its module, as {name.lower()} = {name}(), and name that"


def _takes_all(ask: Ask, name: str) -> bool:
    """Return whether a callable takes (prompt, images, state); raises SpecError where it takes no image either."""
    if words := made_of_class(ask):
        raise SpecError(f"'python:{name}' cannot be asked: {words}")
    try:
        signature = inspect.signature(ask)
    except (TypeError, ValueError):
        return False  # a builtin without a signature
    taken = [*signature.parameters.values()]
    if [one.name for one in taken[2:3]] == ["state"] and (
        taken[1].name == "images" or taken[2].default is inspect.Parameter.empty
    ):
        return True  # (prompt, image, state=...) is a callable of one image with an option of its own
    if taken and taken[0].name == "images":
        raise SpecError(
            f"'python:{name}' takes images first, as a policy does: give it frames with motions, a data set with "
            "'look --dataset FOLDER', or a bank with --frames ('eyechart frames build tabletop --out bank' makes one)"
        )
    with raising(SpecError, f"'python:{name}' must take (prompt, image) or (prompt, images, state)", of=TypeError):
        signature.bind("", None)
    return False


def names() -> dict[str, str]:
    """Return what may stand after ``python:``."""
    return {"MODULE:FUNCTION": "a callable of one's own, (prompt: str, image: bytes or None) -> str"}
