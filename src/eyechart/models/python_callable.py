"""``python:MODULE:FUNCTION``: any callable from a prompt and a picture to text, for your own stack.

The callable takes ``(prompt: str, image: bytes | None)``, with the picture as PNG or JPEG bytes, or
``(prompt, images, state)``, with pictures by camera and numbers by name. It returns the answer as
text, or a Reply with more (tokens, finish reason). With a further parameter ``messages`` it also
gets every turn of the prompt. It may be asynchronous; else it runs in threads,
in parallel. No call begins while 16 calls past their time limit still run. With an attribute
``batch = N`` it takes lists of up to N prompts, pictures (and states, and messages), and returns a
list of as many answers.

A callable of (prompt, images, state) that declares ``history`` N also gets the N instants before
the frame, from a bank that holds them. Each picture and each state is then a list of N + 1, with
the oldest first and the frame last.
"""

import asyncio
import atexit
import hashlib
import inspect
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from pathlib import Path
from queue import SimpleQueue
from types import CellType, CodeType, FunctionType, MethodType, ModuleType
from typing import Any, ClassVar, TypeGuard, TypeVar
from weakref import WeakKeyDictionary

import numpy as np

from eyechart.calls import Query, Reply
from eyechart.errors import SpecError, fill_streams, raising, suggestion
from eyechart.frames import MOST_HISTORY
from eyechart.messages import Turn
from eyechart.models import HISTORY, require_options
from eyechart.models.batches import SIZES, Batches, NotCalledError, in_time, is_size
from eyechart.models.energy import metered
from eyechart.models.sources import facts_of, version_of
from eyechart.modes import RequestMode, in_one_line

OPTIONS = {"energy": "true measures this machine's energy during a call, for a model that runs here"}

DECLARED: Mapping[str, object] = {"batch": None, HISTORY: 0}
"""The attributes that a callable may declare, with their defaults."""

Ask = Callable[..., object]
T = TypeVar("T")

_DEPTH = 4
"""How deep nested collections of a callable's values are read."""
_FIRST: WeakKeyDictionary[object, str] = WeakKeyDictionary()
"""The values that each callable held when it was first seen."""

_CALL, _FREE = "eyechart-call", "eyechart-free"
"""The names of threads that call callables, and of those that are kept for further calls."""

_END_S = 1.0
"""The longest that the program's end waits for a thread without a call."""

HISTORIES = f"a whole number from 0 to {MOST_HISTORY}, of instants before the frame: LeRobot's n_obs_steps less 1"
"""The allowed values of ``history``, in words."""

LEFT_AT_MOST = 16
"""The most calls past their time limit that may still run; with so many, no call begins."""


@dataclass(slots=True)
class PythonCallable:
    """A callable as a model; ``version`` is the start of a digest of its files."""

    ask: Ask
    mode: RequestMode
    version: str
    facts: Mapping[str, str]
    whole: bool = False
    """Whether it takes all pictures and the state, instead of one picture."""
    history: int = 0
    left: set[threading.Thread] = field(default_factory=set)
    batch: int | None = None
    batches: Batches = field(init=False)
    takes_messages: bool = field(init=False)
    is_async: bool = field(init=False)

    def __post_init__(self) -> None:
        self.batches = Batches(self.batch or 1, self._replies)
        self.takes_messages = _takes_messages(self.ask)
        self.is_async = any(map(inspect.iscoroutinefunction, (self.ask, type(self.ask).__call__)))

    async def answer(self, query: Query) -> Reply:
        """Call once. An exception, or a call past the mode's time limit, is a failed Reply."""
        if self.batch is not None:
            return await self.batches.answer(query)
        call = self._alone(query)
        return await metered(call) if self.mode.options.get("energy") else await call

    async def _alone(self, query: Query) -> Reply:
        return (await self._replies([query]))[0]

    async def _replies(self, queries: Sequence[Query]) -> list[Reply]:
        """Return a reply to each query of a call."""
        return await in_time(self.mode.timeout_s, queries, self._answers(queries))

    async def _answers(self, queries: Sequence[Query]) -> Sequence[Reply | Exception]:
        turns = [list(map(_message, query.turns)) for query in queries] if self.takes_messages else []
        given = [(_words(query), *self._seen(query)) for query in queries]
        if self.batch is None:
            return [_reply(await self._ask(*given[0], **({"messages": turns[0]} if turns else {})))]
        lists = map(list, zip(*given, strict=True))
        answers = await self._ask(*lists, **({"messages": turns} if turns else {}))
        if not isinstance(answers, Sequence) or isinstance(answers, str) or len(answers) != len(queries):
            raise TypeError(f"{len(queries)} queries got no list of as many answers, but a {type(answers).__name__}")
        return list(map(_reply, answers))

    def _seen(self, query: Query) -> tuple[object, ...]:
        """Return the arguments after the prompt, as copies that the callable may change.

        Raises TypeError where a callable of one image would miss a camera, or one without
        ``messages`` a turn.
        """
        if not self.takes_messages and _has_more(query):
            raise TypeError(
                "the prompt has several messages or pictures: let it take them, as (prompt, image, *, messages)"
            )
        if self.whole and self.history:
            window, seen = query.stimulus.window(self.history), query.stimulus
            pictures = {name: [one.images[name] for one in window] for name in seen.images}
            return pictures, {name: [one.state[name] for one in window] for name in seen.state}
        if self.whole:
            return dict(query.stimulus.images), dict(query.stimulus.state)
        if len(query.images) > 1:
            cameras = ", ".join(query.stimulus.images)
            raise TypeError(f"it takes one image and the frame has {cameras}; let it take (prompt, images, state)")
        return (query.image,)

    async def _ask(self, *given: object, **more: object) -> object:
        if self.is_async:
            return await self.ask(*given, **more)  # type: ignore[misc]
        return await in_thread(partial(self.ask, *given, **more), self.left)

    async def close(self) -> None:
        """Do nothing: there is nothing to release."""


def _has_more(query: Query) -> bool:
    """Return whether a query has messages or pictures beside its own."""
    several = sum(turn.role != "system" for turn in query.messages) > 1
    return several or not set(query.pictures if query.messages else ()) <= set(query.images)


def _words(query: Query) -> str:
    return f"{query.system}\n\n{query.user}" if query.system else query.user


def _reply(said: object) -> Reply:
    """Return what a callable answered as a reply."""
    if isinstance(said, Reply):
        return said
    if isinstance(said, str):
        return Reply(text=said)
    words = f"the callable returned a {type(said).__name__}, not a text or a Reply"
    return Reply(error="exception", error_detail=words)


async def in_thread(ask: Callable[[], T], left: set[threading.Thread]) -> T:
    """Call in a thread that does not keep the program from ending, even if the call never returns.

    Threads are kept for further calls. A cancelled call leaves its thread in ``left`` until it
    returns. Raises NotCalledError while too many run.
    """
    left -= {thread for thread in left if not thread.is_alive()}
    if len(left) >= LEFT_AT_MOST:
        raise NotCalledError(f"not called: {len(left)} earlier calls have not returned")
    loop = asyncio.get_running_loop()
    done: asyncio.Future[T] = loop.create_future()

    def settle(ending: Callable[[], None]) -> None:
        if not done.done():
            ending()

    def work() -> Callable[[], object]:
        try:
            ending = partial(done.set_result, ask())
        except StopIteration as stop:  # a Future cannot carry it
            ending = partial(done.set_exception, RuntimeError(f"StopIteration: {stop}"))
        except BaseException as raised:  # noqa: BLE001 - without it the caller waits for ever
            error = raised if isinstance(raised, Exception) else RuntimeError(f"{type(raised).__name__}: {raised}")
            ending = partial(done.set_exception, error)
        fill_streams()  # it may have closed them
        return partial(loop.call_soon_threadsafe, settle, ending)

    try:
        thread = _CallThread.free()
    except RuntimeError as error:  # the system has no room for another thread
        raise NotCalledError(f"not called: {error}") from error
    thread.make(work)
    try:
        return await done
    except asyncio.CancelledError:
        if thread.give_up(work):
            left.add(thread)
        raise


Work = Callable[[], Callable[[], object]]
"""Makes a call and returns what hands its result over."""


class _CallThread(threading.Thread):
    """A thread that makes calls one after another, and ends after one that was given up."""

    _free: ClassVar[list["_CallThread"]] = []
    _lock: ClassVar[threading.Lock] = threading.Lock()

    def __init__(self) -> None:
        super().__init__(name=_CALL, daemon=True)
        self._queue: SimpleQueue[Work] = SimpleQueue()
        self._work: Work | None = None
        self._given_up = False

    @classmethod
    def free(cls) -> "_CallThread":
        """Return a thread without a call, a new one if all have one; raises RuntimeError."""
        with cls._lock:
            while cls._free:
                if (thread := cls._free.pop()).is_alive():  # none is, in a process that was forked
                    thread.name = _CALL
                    return thread
        (thread := cls()).start()
        atexit.unregister(cls.end_free)
        atexit.register(cls.end_free)  # the last to be registered runs first: before the called code's own
        return thread

    @classmethod
    def end_free(cls) -> None:
        """End the threads without a call: a library may abort if the interpreter ends below a thread."""
        with suppress(IndexError):  # none is left
            while True:
                cls._free.pop().end()  # without the lock, which a process that was forked may find held

    def end(self) -> None:
        """End this thread, which has no call."""
        self._given_up = True
        self._queue.put(lambda: int)  # a call of nothing
        self.join(_END_S)

    def make(self, work: Work) -> None:
        """Make a call in this thread, which has none."""
        self._work = work
        self._queue.put(work)

    def give_up(self, work: Work) -> bool:
        """End the thread after this call; return False if the call has returned already."""
        with self._lock:
            self._given_up = self._given_up or self._work is work
            return self._work is work

    def run(self) -> None:
        while not self._given_up:
            work = self._queue.get()
            hand_over = work()
            with self._lock:
                self._work = None
                if not self._given_up:
                    self.name = _FREE
                    self._free.append(self)
            with suppress(RuntimeError):  # the loop is closed, and nobody waits
                hand_over()
            del work, hand_over  # they hold the call's pictures and its result


def under_way() -> frozenset[threading.Thread]:
    """Return the threads of running calls, also of those past their time limit."""
    return frozenset(one for one in threading.enumerate() if one.name == _CALL)


def open_model(name: str, mode: RequestMode) -> PythonCallable:
    """Import the callable, also from the current folder; raises SpecError where it is missing."""
    require_options(mode, OPTIONS)
    ask, version, facts = import_callable(name)
    return _opened(ask, mode, version, facts, name)


def hold(ask: Ask, mode: RequestMode) -> PythonCallable:
    """Return a callable object as a model; ``mode`` names it, `identity_of` gives its version.

    Raises SpecError unless it takes (prompt, image) or (prompt, images, state).
    """
    require_options(mode, OPTIONS)
    return _opened(ask, mode, *identity_of(ask), mode.spec.partition(":")[2])


def _opened(ask: Ask, mode: RequestMode, version: str, facts: Mapping[str, str], name: str) -> PythonCallable:
    """Return a callable as a model, with its declared size of batches and its history."""
    batch, history = (getattr(ask, what, usual) for what, usual in DECLARED.items())
    whole = _takes_all(ask, name)
    if not is_size(batch):
        raise SpecError(f"'{mode.spec}' declares batch = {batch!r}; it must be {SIZES}")
    if batch is not None and mode.options.get("energy"):
        raise SpecError(f"'{mode.spec}' declares batch, and energy is measured call by call: leave out one of the two")
    if not is_history(history):
        raise SpecError(f"'{mode.spec}' declares history = {history!r}; it must be {HISTORIES}")
    if history and not whole:
        raise SpecError(f"'{mode.spec}' declares history = {history}: let it take (prompt, images, state)")
    more = {} if batch is None else {"batch": str(batch)}
    more |= {HISTORY: str(history)} if history else {}
    return PythonCallable(ask, mode, version, {**facts, **more}, whole, history, batch=batch)


def is_history(value: object) -> TypeGuard[int]:
    """Return whether a value may be declared as ``history``."""
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= MOST_HISTORY


def identity_of(ask: Ask) -> tuple[str, dict[str, str]]:
    """Return the version of a callable object (the start of a digest), and its digests by name.

    The digest covers the files of its module, as for a SPEC. Without a file, as in a notebook, it
    covers the callable's own code, and not the code that it calls. Values that a partial, a closure
    or an object holds are included: text, numbers, arrays and collections of them. Of any other
    value, for example a network, only the type is included: give such models folders of their own.
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
    except (TypeError, OSError):  # a class of a notebook, or a built-in one
        return False


def name_of(ask: Ask) -> str:
    """Return ``MODULE:FUNCTION`` of a callable; for an object, ``MODULE:CLASS``."""
    written = _written(ask)
    function = written.__qualname__.replace("<lambda>", "lambda").replace(".<locals>", "")
    return f"{written.__module__}:{function}"


def _written(ask: object) -> FunctionType | type:
    """Return the function of a partial or method, or the class of an object."""
    while isinstance(ask, partial | MethodType):
        ask = ask.func if isinstance(ask, partial) else ask.__func__
    if isinstance(ask, FunctionType):
        ask = inspect.unwrap(ask)
    return ask if isinstance(ask, FunctionType | type) else type(ask)


def _source(written: object) -> bytes:
    return "\n".join(_code(written)).encode()


def _held(ask: object) -> str:
    """Return a callable's values at its first use: one that counts its calls stays the same."""
    try:
        return _FIRST[ask] if ask in _FIRST else _FIRST.setdefault(ask, "\n".join(_state(ask)))
    except TypeError:  # its class has slots, or no hash
        return "\n".join(_state(ask))


def _state(ask: object) -> Iterator[str]:
    """Yield the values that a partial, a method, a closure, a lambda or an object holds."""
    if isinstance(ask, partial):
        yield from _values(ask.args)
        yield from _values(ask.keywords)
        yield _held(ask.func)
    elif isinstance(ask, MethodType):
        yield _held(ask.__self__)
        yield _held(ask.__func__)
    elif isinstance(ask, FunctionType):
        yield from _values([cell.cell_contents for cell in ask.__closure__ or () if _is_full(cell)])
        if ask.__name__ == "<lambda>":  # one file may hold many, all with this name
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
    except ValueError:  # the variable has no value yet
        return False


def _values(value: object, depth: int = 0) -> Iterator[str]:
    """Yield values that are equal in every process; for any other value, its type."""
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
    """Yield the code of a function, or of a class and its methods, equal in every process."""
    if isinstance(written, type):
        for name, var in sorted(vars(written).items()):
            yield name
            yield from _code(var.__func__ if isinstance(var, staticmethod | classmethod) else var)
    code = written.__code__ if isinstance(written, FunctionType) else written
    if isinstance(code, CodeType):
        yield f"{code.co_code.hex()} {code.co_names} {code.co_varnames}"
        for constant in code.co_consts:
            if isinstance(constant, CodeType):
                yield from _code(constant)
            elif not isinstance(constant, frozenset):  # its order differs by process
                yield repr(constant)


def import_callable(name: str) -> tuple[Ask, str, dict[str, str]]:
    """Import ``MODULE:FUNCTION`` or ``MODULE:OBJECT.METHOD``, also from the current folder.

    Returns it with its version and its files' digests. Raises SpecError where it is missing.
    """
    module_name, colon, function = name.rpartition(":")
    if not colon or not module_name or not function:
        near = _suggestion(name) or "for example python:my_robot:decide"
        raise SpecError(f"'python:{name}' must be python:MODULE:FUNCTION, {near}")
    if module_name.endswith(".py") or "/" in module_name or "\\" in module_name:
        near = f"python:{Path(module_name.replace(chr(92), '/')).stem}:{function}"
        raise SpecError(f"'python:{name}' needs a module's name, not its file: give '{near}' in the folder of the file")
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.append(here)
    try:
        module = import_module(module_name)
    except ImportError as error:
        words = in_one_line(error).partition(": ")[2]
        raise SpecError(f"'python:{name}': module '{module_name}' cannot be imported: {words}") from error
    except (Exception, SystemExit) as error:
        raise SpecError(f"'python:{name}': the import of module '{module_name}' fails: {in_one_line(error)}") from error
    ask: Any = module
    for part in function.split("."):
        owner, ask = ask, getattr(ask, part, None)
    if not callable(ask):
        own = f"'python:{name}': module '{module_name}' has no callable '{function}'"
        raise SpecError(f"{own}{_instead(name, part, owner, ask)}")
    if inspect.isclass(owner) and inspect.isfunction(inspect.getattr_static(owner, part)):
        owned = f"'{part}' is a method, and its owner {made_of_class(owner).removeprefix('it ')}"
        raise SpecError(f"'python:{name}' cannot be called: {owned}")
    if not (facts := facts_of(module)):
        return ask, "no file", {}
    facts |= version_of(facts)
    return ask, facts.pop("version"), facts


def _instead(name: str, part: str, owner: object, found: object) -> str:
    """Return in words what to name instead of a missing callable, or of an object that is none."""
    if found is None:
        return suggestion(part, vars(owner) if isinstance(owner, ModuleType) else dir(owner))
    methods = [one for one, _ in inspect.getmembers(type(found), inspect.isfunction) if not one.startswith("_")]
    near = f"; name one of its methods: {', '.join(f'python:{name}.{one}' for one in methods[:3])}" if methods else ""
    return f": it is a value of type {type(found).__name__}{near}"


def _suggestion(name: str) -> str:
    """Suggest a SPEC for a name without a colon between module and function; "" without a guess."""
    path, dot, function = name.rstrip(":").rpartition(".")
    if function == "py" or not dot or not path or not function:
        return ""
    return f"did you mean 'python:{path}:{function}'?"


def made_of_class(ask: object) -> str:
    """Return an error text for a class: its call would make an object; "" for anything else."""
    if not inspect.isclass(ask):
        return ""
    name = ask.__name__
    return f"it is a class: make an object of it in its module, as {name.lower()} = {name}(), and name the object"


def _takes_all(ask: Ask, name: str) -> bool:
    """Return whether it takes (prompt, images, state); raises SpecError if it takes no image."""
    if words := made_of_class(ask):
        raise SpecError(f"'python:{name}' cannot be called: {words}")
    try:
        signature = inspect.signature(ask)
    except (TypeError, ValueError):
        return False  # a builtin without a signature
    taken = [*signature.parameters.values()]
    if [parameter.name for parameter in taken[2:3]] == ["state"] and (
        taken[1].name == "images" or taken[2].default is inspect.Parameter.empty
    ):
        return True  # (prompt, image, state=...) takes one image: state is an option of its own
    if taken and taken[0].name == "images":
        raise SpecError(
            f"'python:{name}' takes images first, as a policy does. Give it frames with motions: a data set with "
            "'look --dataset FOLDER', or a bank with --frames ('eyechart frames build tabletop --out bank' makes one)"
        )
    with raising(SpecError, f"'python:{name}' must take (prompt, image) or (prompt, images, state)", of=TypeError):
        signature.bind("", None, **({"messages": []} if _takes_messages(ask) else {}))
    return False


def _takes_messages(ask: Ask) -> bool:
    """Return whether a callable has a parameter for the turns of a prompt."""
    try:
        return "messages" in inspect.signature(ask).parameters
    except (TypeError, ValueError):
        return False  # a builtin without a signature


def _message(turn: Turn) -> dict[str, object]:
    """Return a turn for a callable: its role, and a list of words and encoded pictures."""
    return {"role": turn.role, "content": list(turn.parts)}


def names() -> dict[str, str]:
    """Return what may stand after ``python:``."""
    return {"MODULE:FUNCTION": "a callable of your own, (prompt: str, image: bytes or None) -> str"}
