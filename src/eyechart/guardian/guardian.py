"""A guardian in a stack: its committee judges one picture as hazard, clear, or abstains.

Late, failed and unreadable votes are missing votes, and missing votes never count as clear. The
models run in an event loop in a thread of its own, so an answer comes by the deadline in any case.
"""

import asyncio
import threading
import time
from collections.abc import Callable, Coroutine, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeVar

import numpy as np

from eyechart.calls import Reply, invalid_field
from eyechart.errors import BankError, GuardianError, encodable
from eyechart.frames import encode, require_plain
from eyechart.guardian.interface import Answer, Assessment, Interface, Pictures, Vote, interface_of
from eyechart.integrity import names_of
from eyechart.models import Model, open_model
from eyechart.models.sources import FORMERLY
from eyechart.modes import RequestMode, in_one_line
from eyechart.seeds import key_seed
from eyechart.stats.committee_votes import CLEAR, HAZARD, answers
from eyechart.studies.guardian import VIEWS, FrozenGuardian, read_frozen

T = TypeVar("T")

DEADLINE_S = 2.0
_MARGIN_S = 0.02
"""Part of the deadline, a tenth at most, that is kept to put the answer together."""
_CLOSING_S = 5.0
MOST_AT_ONCE = 64
"""Pictures at one time; another one gets an abstention, so a blocked loop holds no memory."""
_WORDS = 200
_BLANK_PX = 64
_HELD = "no vote came by the deadline: something holds the models' event loop"
_FULL = f"{MOST_AT_ONCE} pictures are under way already: something holds the models' event loop"


class Guardian:
    """A frozen guardian with its models, ready for pictures; a context manager closes its models.

    It may be used from several threads at once.
    """

    def __init__(
        self,
        frozen: FrozenGuardian,
        models: Mapping[str, Model],
        interface: Interface,
        *,
        deadline_s: float = DEADLINE_S,
    ) -> None:
        self.frozen, self.models, self.deadline_s = frozen, models, deadline_s
        self._limit(None)
        self._interface = interface
        self._pool = ThreadPoolExecutor(4, "eyechart-views")
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread: threading.Thread | None = None
        self._lock, self._closed, self._under_way = threading.Lock(), False, 0
        self._tasks: set[asyncio.Task[tuple[Vote, str]]] = set()
        self._voted: dict[str, float] = {}

    @classmethod
    def load(
        cls,
        path: Path | str,
        *,
        deadline_s: float = DEADLINE_S,
        interface: Interface | None = None,
        modes: Mapping[str, RequestMode] | None = None,
    ) -> "Guardian":
        """Open a guardian and its models.

        Raises GuardianError that names what changed since its choice: an edited file, another
        prompt or view, another version of a model. ``modes`` may change a model's address, key,
        header or time limit, and nothing else. ``interface`` is needed only if the votes came from
        a table, not from a run. No call is made yet.
        """
        frozen = read_frozen(Path(path))
        shown = interface or interface_of(frozen)
        for name in ("view", "prompt", "reader"):
            chosen, here = getattr(frozen.about, name), getattr(shown, name)
            if chosen != here:
                raise GuardianError(f"{path}: the {name} differs: it was chosen with {chosen!r}, here is {here!r}")
        given = modes or {}
        if unknown := sorted(set(given) - set(frozen.committee)):
            raise GuardianError(f"{path} has no model '{unknown[0]}'; it has {', '.join(frozen.committee)}")
        models = {}
        for spec in frozen.committee:
            mode, other = frozen.about.modes.get(spec), given.get(spec)
            if mode is not None and other is not None and not mode.differs_in_address_only(other):
                raise GuardianError(
                    f"'{spec}' would get other requests than when the guardian was chosen: only base_url, key_env, "
                    "headers and timeout_s of its mode may differ"
                )
            models[spec] = open_model(spec, other or mode)
            chosen, here = frozen.about.versions.get(spec), models[spec].version
            if chosen != here and chosen != models[spec].facts.get(FORMERLY):
                raise GuardianError(
                    f"{path}: the model '{spec}' differs: it was chosen with version '{chosen}', here is '{here}'; "
                    "choose a guardian for this version with 'eyechart guardian fit'"
                )
        return cls(frozen, models, shown, deadline_s=deadline_s)

    def assess(self, image: bytes, *, deadline_s: float | None = None) -> Assessment:
        """Return the committee's judgement of an encoded picture, by the deadline.

        It abstains for a picture that no bank would take: damaged, rotated by metadata, not in
        8-bit RGB, or of more than 25 megapixels. At most four are decoded at once. Raises
        GuardianError after `close`, and never for a model's fault.
        """
        start, limit = time.perf_counter(), self._limit(deadline_s)
        future = self._submit(self._assess(image, start, limit))
        if future is None:
            return self._silent(start, _FULL)
        try:
            return future.result(limit)
        except TimeoutError:
            future.cancel()
            return self._silent(start, _HELD)

    async def assess_async(self, image: bytes, *, deadline_s: float | None = None) -> Assessment:
        """Return what `assess` does, without blocking the caller's event loop."""
        start, limit = time.perf_counter(), self._limit(deadline_s)
        return await self._awaited(self._assess(image, start, limit), start, limit)

    def show(self, image: bytes) -> Pictures:
        """Return a picture as the models get it; BankError for one that no bank would take."""
        require_plain(image, "the picture")
        return self._interface.views(image)

    async def ask_async(self, pictures: Pictures, *, deadline_s: float | None = None) -> Assessment:
        """Return the committee's judgement of a picture that `show` returned."""
        start, limit = time.perf_counter(), self._limit(deadline_s)
        return await self._awaited(self._ask(pictures, start, limit), start, limit)

    async def warm_up(self, limit_s: float) -> dict[str, str]:
        """Call each model once with a blank picture; return the reason for each late or failed one.

        The first reply may take much longer than a deadline if a model must be loaded.
        """
        try:
            async with asyncio.timeout(limit_s + 1):
                future = self._submit(self._warm(limit_s))
                return dict.fromkeys(self.models, _FULL) if future is None else await asyncio.wrap_future(future)
        except TimeoutError:
            return dict.fromkeys(self.models, "something holds the models' event loop")

    def since_votes(self) -> dict[str, float | None]:
        """Return for each model the seconds since its last vote; None before its first one."""
        now = time.monotonic()
        return {spec: now - self._voted[spec] if spec in self._voted else None for spec in self.models}

    def close(self) -> None:
        """Close the models, within a few seconds at most. A second call has no effect."""
        with self._lock:
            loop, self._loop, self._closed = self._loop, None, True
            self._pool.shutdown(wait=False, cancel_futures=True)
        if loop is not None and self._thread is not None:
            asyncio.run_coroutine_threadsafe(self._let_go(), loop)
            self._thread.join(_CLOSING_S)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _limit(self, deadline_s: float | None) -> float:
        limit = self.deadline_s if deadline_s is None else deadline_s
        if not 0 < limit < 3600:
            raise GuardianError(f"deadline_s={limit} must be a number of seconds above 0 and below 3600")
        return limit

    def _submit(self, work: Coroutine[Any, Any, T]) -> Future[T] | None:
        """Start work in the models' loop; None if it has too much work already."""
        with self._lock:
            if self._closed:
                work.close()
                raise GuardianError("this guardian was closed; load it again")
            if self._under_way >= MOST_AT_ONCE:
                work.close()
                return None
            if self._loop is None:
                self._loop = asyncio.new_event_loop()
                self._thread = threading.Thread(target=_turn, args=(self._loop,), name="eyechart-guardian", daemon=True)
                self._thread.start()
            self._under_way += 1
            future: Future[T] = Future()
            self._loop.call_soon_threadsafe(self._begin, work, future)
            return future

    def _begin(self, work: Coroutine[Any, Any, T], future: Future[T]) -> None:
        """Start a task in the models' loop, such that the release of its picture is noticed."""
        loop = asyncio.get_running_loop()
        if future.cancelled():
            work.close()
            self._let_one()
            return
        task = loop.create_task(work)

        def over(done: asyncio.Task[T]) -> None:
            self._let_one()
            if done.cancelled():
                future.cancel()
            elif future.set_running_or_notify_cancel():
                if (error := done.exception()) is not None:
                    future.set_exception(error)
                else:
                    future.set_result(done.result())

        def given_up(future: Future[T]) -> None:
            if future.cancelled():
                with suppress(RuntimeError):  # the loop was closed meanwhile
                    loop.call_soon_threadsafe(task.cancel)

        task.add_done_callback(over)
        future.add_done_callback(given_up)

    def _let_one(self) -> None:
        with self._lock:
            self._under_way -= 1

    async def _awaited(self, work: Coroutine[Any, Any, Assessment], start: float, limit: float) -> Assessment:
        try:
            async with asyncio.timeout(limit):
                future = self._submit(work)
                return self._silent(start, _FULL) if future is None else await asyncio.wrap_future(future)
        except TimeoutError:
            return self._silent(start, _HELD)

    async def _assess(self, image: bytes, start: float, limit: float) -> Assessment:
        try:
            async with asyncio.timeout(_left(start, limit)):
                pictures = await asyncio.get_running_loop().run_in_executor(self._pool, self.show, image)
        except TimeoutError:
            return self._silent(start, "the picture was not prepared by the deadline")
        except BankError as error:
            return self._silent(start, f"no picture that can be shown: {error}")
        except asyncio.CancelledError:
            raise
        except BaseException as error:  # noqa: BLE001 - nor over what an interface of its own does
            return self._silent(start, f"the picture could not be prepared: {in_one_line(error)}"[:_WORDS])
        return await self._ask(pictures, start, limit)

    async def _ask(self, pictures: Pictures, start: float, limit: float) -> Assessment:
        calls = {
            (spec, view): self._vote(spec, model, picture, view, self._interface.read)
            for spec, model in self.models.items()
            for view, picture in zip(VIEWS, pictures, strict=True)
        }
        late = f"late: no reply within {limit:g} s"
        return self._answer(await self._votes(calls, _left(start, limit), late), start)

    async def _warm(self, limit_s: float) -> dict[str, str]:
        blank = encode(np.full((_BLANK_PX, _BLANK_PX, 3), 128, dtype=np.uint8))
        calls = {
            spec: self._vote(spec, model, blank, VIEWS[0], lambda _: (None, "")) for spec, model in self.models.items()
        }
        found = await self._votes(calls, limit_s, f"no reply within {limit_s:g} s")
        return {spec: encodable(why) for spec, (_, why) in found.items() if why}

    async def _votes(
        self, calls: Mapping[T, Coroutine[Any, Any, tuple[Vote, str]]], limit_s: float, late: str
    ) -> dict[T, tuple[Vote, str]]:
        """Return the votes that come within a number of seconds, and why the others are missing."""
        tasks = {key: asyncio.create_task(one) for key, one in calls.items()}
        self._tasks.update(tasks.values())
        for task in tasks.values():
            task.add_done_callback(self._tasks.discard)
        try:
            await asyncio.wait(tasks.values(), timeout=limit_s)
        finally:
            for task in tasks.values():
                task.cancel()  # has no effect on a finished task
        return {
            key: task.result() if task.done() and not task.cancelled() else (None, late) for key, task in tasks.items()
        }

    async def _vote(
        self, spec: str, model: Model, picture: bytes, view: str, read: Callable[[Reply], tuple[Vote, str]]
    ) -> tuple[Vote, str]:
        """Call for one vote; any failure is a missing vote with its reason."""
        try:
            seed = key_seed("guardian", self.frozen.digest, spec, view)
            reply = await model.answer(self._interface.query(picture, seed))
            if (wrong := invalid_field(reply)) is not None:
                return None, f"no reply: {wrong}"
            if reply.error is not None:
                return None, f"{reply.error}: {reply.error_detail}"[:_WORDS]
            served = self.frozen.about.served.get(spec)
            if served is not None and reply.served not in {None, served} and names_of(reply)[0] != served:
                return None, f"another model answered: {reply.served}, not {served}"
            vote, why = read(reply)
            if vote is not None:
                self._voted[spec] = time.monotonic()
        except asyncio.CancelledError:
            raise
        except BaseException as error:  # noqa: BLE001 - no model may end a stack
            return None, in_one_line(error, _WORDS)
        return vote, why

    def _answer(self, votes: Mapping[tuple[str, str], tuple[Vote, str]], start: float) -> Assessment:
        hazard = sum(vote is True for vote, _ in votes.values())
        missing = {f"{spec}/{view}": encodable(why) for (spec, view), (vote, why) in votes.items() if vote is None}
        frozen = self.frozen
        code = int(answers(hazard, len(missing), voters=frozen.voters, threshold=frozen.threshold, point=frozen.point))
        answer: Answer = "hazard" if code == HAZARD else "clear" if code == CLEAR else "abstain"
        why = f"{hazard} of {frozen.voters} votes say hazard (hazard from {frozen.threshold} on, {frozen.point})"
        if missing:
            name, reason = next(iter(missing.items()))
            why += f"; {len(missing)} missing, which never count as clear: {name}: {reason}"
        pairs = {spec: (votes[spec, VIEWS[0]][0], votes[spec, VIEWS[1]][0]) for spec in self.models}
        return Assessment(answer, pairs, time.perf_counter() - start, why, missing)

    def _silent(self, start: float, why: str) -> Assessment:
        """Return the abstention of a committee without any vote."""
        votes: dict[tuple[str, str], tuple[Vote, str]] = {
            (spec, view): (None, why) for spec in self.models for view in VIEWS
        }
        return replace(self._answer(votes, start), answer="abstain", why=encodable(why))

    async def _let_go(self) -> None:
        loop = asyncio.get_running_loop()
        tasks = tuple(self._tasks)
        for task in tasks:
            task.cancel()
        if tasks:
            await asyncio.wait(tasks, timeout=_CLOSING_S / 2)
        for model in self.models.values():
            try:
                async with asyncio.timeout(_CLOSING_S / 2):
                    await model.close()
            except asyncio.CancelledError:
                raise
            except BaseException:  # noqa: BLE001, S112 - what cannot be closed is left
                continue
        loop.stop()


def _turn(loop: asyncio.AbstractEventLoop) -> None:
    """Run the models' loop until stopped; SystemExit in a model's task only interrupts it."""
    turning = True
    while turning:
        try:
            loop.run_forever()
            turning = False
        except BaseException:  # noqa: BLE001, S112 - the next picture needs the loop
            continue
    loop.close()


def _left(start: float, limit: float) -> float:
    """Return the seconds that are left for votes."""
    return max(0.0, limit - min(_MARGIN_S, limit / 10) - (time.perf_counter() - start))
