"""A page that shows a run in progress, served on this machine only, from the run's own files.

It calls no model, writes nothing, and makes no claim. The browser also requests the end (``over``),
which is answered when the run ends. A failed reply there means a lost connection, not the end.
"""

import asyncio
import base64
import hashlib
import os
import secrets
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import astuple, dataclass, field
from functools import cache
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

from aiohttp import web

from eyechart.calls import DecisionReader
from eyechart.costs import ALL, Account, accounts_of
from eyechart.errors import EyechartError, printable
from eyechart.integrity import ServedChecks
from eyechart.ledger import Attempts, Ledger, SentAttempt, columns_of
from eyechart.manifest import LEDGER, RUN, EpisodesManifest, RunManifest
from eyechart.models.prices import Price, Prices
from eyechart.planned_run import PlannedRun
from eyechart.serve.connections import Connections
from eyechart.serve.host_names import HostNames
from eyechart.spaces.space import AnySpace
from eyechart.studies import Study, study_of

FIRST = 12
"""The number of a model's first answers on the page."""
_LONGEST = 600
_EVERY_S = 2.0
"""The least time between two reads of the files, in seconds; they are read only after progress."""
_UNTIL_FIRST_S = 1.0
"""The time between two reads of the files until the first answers, in seconds."""
_EARLY = 3
"""The number of reads with answers that are made at once; later ones keep the share."""
_SHARE = 0.01
"""The largest share of the run's own processor time for all later reads."""
_WINDOW_S = 30.0
_ENDING_S = 5.0
_CONNECTIONS = 32
_IDLE_S = 10.0
_REAP_S = 1.0
_BACKLOG = 8
"""The number of connections accepted at once; each has a descriptor until it is closed."""
_KEPT = 64
"""Descriptors reserved for the run: with fewer left, a connection is closed at once."""
_HELD_S = 60.0
"""The longest time of a request for the end, in seconds; the browser then repeats it."""
_NOTHING = "No call is written yet."
NOTHING_FOLLOWS = "Nothing follows from this before the run is over and scored."


_RunReading = tuple[RunManifest | EpisodesManifest, AnySpace, DecisionReader]
"""A run's manifest, its space, and what reads its replies."""


@dataclass(frozen=True)
class LiveAnswer:
    """One of a model's first answers: its frame and condition, the decision read, and its text."""

    frame: str
    condition: str
    decision: str
    text: str


@dataclass(frozen=True)
class LiveModel:
    """A model's answers so far, with ``warnings`` of faults."""

    name: str
    account: Account
    decisions: Mapping[str, int]
    first: tuple[LiveAnswer, ...]
    warnings: tuple[str, ...]

    @property
    def words(self) -> str:
        """Return the counts of decisions in a sentence without a claim."""
        found = ", ".join(f"{count} {name}" for name, count in self.decisions.items()) or "no answer"
        return f"So far {found}. {NOTHING_FOLLOWS}"


@dataclass
class LiveRun:
    """A run on the page: its progress, as the run itself reports it, and its ledgers' answers.

    Files are read at a request for the page, after progress, and so seldom that reading takes a
    small share of one processor. ``over`` is the end of the run in words; empty before it.
    """

    folder: Path
    prices: Prices
    done: int = 0
    total: int = 0
    unit: str = "calls"
    over: str = ""
    _moves: deque[tuple[float, int]] = field(default_factory=lambda: deque(maxlen=10_000))
    _kept: tuple[LiveModel, ...] = ()
    _readings: dict[Path, tuple[int, _RunReading]] = field(default_factory=dict)
    _reads: int = 0
    _spent: float = 0.0
    _why: str = ""
    _next: float = 0.0
    _seen: tuple[tuple[int, int], ...] | None = None

    def move(self, done: int, total: int) -> None:
        """Set the numbers of finished and of all calls or episodes."""
        self.done, self.total = done, total
        self._moves.append((time.monotonic(), done))

    @property
    def rate(self) -> float | None:
        """Return the recent number of finished ones a second; None before two."""
        now, moves = time.monotonic(), list(self._moves)
        of_late = [one for one in moves if now - one[0] <= _WINDOW_S] or moves[-1:]
        if not of_late or of_late[0] is of_late[-1] or now <= of_late[0][0]:
            return None
        return (of_late[-1][1] - of_late[0][1]) / (now - of_late[0][0])

    def models(self) -> tuple[LiveModel, ...]:
        """Return each model's answers so far, by the last read of the files."""
        now, before = time.monotonic(), time.thread_time()
        within = self._reads < _EARLY or self._spent <= _SHARE * (time.process_time() - self._spent)
        if now >= self._next and within and (written := self._written()) != self._seen:
            try:
                self._kept = tuple(self._read())
                self._why = "" if self._kept else _NOTHING
            except (EyechartError, OSError) as error:
                self._why = printable(str(error))
            answered = any(model.first for model in self._kept)
            self._reads += answered
            self._seen = written
            self._next = now + (_EVERY_S if answered else _UNTIL_FIRST_S)
            self._spent += time.thread_time() - before
        return self._kept

    def html(self) -> bytes:
        """Return the current page."""
        models, rate = self.models(), self.rate
        of_late = "" if rate is None else f", {rate:.2f} a second recently"
        count = f"{self.done} of {self.total} {self.unit}"
        bar = f'<p><progress max="{self.total or 1}" value="{self.done}">{count}</progress></p>'
        parts = [bar, f"<p><strong>{count}</strong>{of_late}{_cost(models)}.</p>"]
        parts += [f"<p>{escape(self._why)}</p>"] if not models else map(_section, models)
        title = escape(self.folder.resolve().name)
        values = {"title": title, "now": "\n".join(parts), "over": escape(self.over)}
        return _shell().substitute(values).encode("utf-8", "backslashreplace")

    def _written(self) -> tuple[tuple[int, int], ...]:
        """Return the time and size of each ledger and its log; a file may vanish at any time."""
        found = []
        for path in sorted(self.folder.rglob(f"{LEDGER}*")):
            with suppress(OSError):
                stat = path.stat()
                found.append((stat.st_mtime_ns, stat.st_size))
        return tuple(found)

    def _read(self) -> Iterator[LiveModel]:
        study = study_of(self.folder)
        for part, run in study.runs(self.folder).items():
            if not (run / LEDGER).is_file():
                continue
            manifest, space, read = self._manifest(study, run)
            with Ledger(run / LEDGER, sound=False) as ledger:
                for spec in manifest.models:
                    name = f"{spec} in {part}" if part else spec
                    sent, price = list(ledger.attempts(spec)), self.prices.of(manifest.mode(spec))
                    yield _live_model(name, sent, columns_of(sent, read), price, space)

    def _manifest(self, study: Study[Any], run: Path) -> _RunReading:
        """Return a run's manifest, space and reader, read again only after a change."""
        written = (run / RUN).stat().st_mtime_ns
        if run not in self._readings or self._readings[run][0] != written:
            self._readings[run] = written, (*study.manifest_and_space(run), study.reader(run))
        return self._readings[run][1]


@cache
def _shell() -> Template:
    """Return the fixed part of the page, with its script, and the policy that forbids any other."""
    folder = files("eyechart.report") / "template"
    parts = ("live.html", "live.js", "page.css", "live.css")
    html, script, *css = ((folder / name).read_text(encoding="utf-8") for name in parts)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    runs = f"script-src 'sha256-{digest}'; connect-src 'self'; style-src 'unsafe-inline'"
    return Template(
        html.replace("$csp", runs).replace("$css", "".join(css)).replace("$script", script.replace("$", "$$"))
    )


def _cost(models: Sequence[LiveModel]) -> str:
    known = sum(model.account.cost_usd or 0.0 for model in models)
    unknown = sum(model.account.cost_from.get("unknown", 0) for model in models)
    if not models or (unknown and not known):
        return "; the cost is not known" if models else ""
    return f"; cost so far ${known:.4f}{f', unknown of {unknown} requests' if unknown else ''}"


def _section(model: LiveModel) -> str:
    """Return a model's part of the page; all text of models is escaped."""
    names = ("asked about", "shown", "read as", "text")
    head = "".join(f'<th scope="col">{name}</th>' for name in names)
    rows = "\n".join(
        "<tr>"
        + "".join(
            f'<td dir="auto" data-name="{name}">{escape(printable(text))}</td>'
            for name, text in zip(names, astuple(answer), strict=True)
        )
        + "</tr>"
        for answer in model.first
    )
    amiss = "".join(f'<p class="warn"><strong>Look:</strong> {escape(printable(line))}</p>' for line in model.warnings)
    table = f"<table><caption>Its first answers</caption><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"
    return f"<section><h2><bdi>{escape(model.name)}</bdi></h2><p>{escape(model.words)}</p>{amiss}{table}</section>"


def _live_model(
    name: str, sent: Sequence[SentAttempt], attempts: Attempts, price: Price | None, space: AnySpace
) -> LiveModel:
    decisions, first, empty, replies = Counter[str](), list[LiveAnswer](), 0, 0
    model = sent[0].key.model if sent else name
    for attempt, place in zip(sent, attempts.decision.tolist(), strict=True):
        if attempt.reply is None:
            continue
        found = attempts.decisions[place]
        said = space.symbol(found.action) if found.action is not None else f"no decision ({found.why or found.missing})"
        replies += attempt.reply.error is None
        empty += attempt.reply.error is None and not attempt.reply.text.strip()
        decisions[said] += 1
        if len(first) < FIRST:
            words = attempt.reply.text or attempt.reply.error_detail or attempt.reply.error or ""
            first.append(LiveAnswer(attempt.key.frame, attempt.key.condition, said, words[:_LONGEST]))
    account, served = accounts_of(attempts, model, price)[ALL], ServedChecks(attempts, model).guards()
    amiss = [f"guard 'served': {guard.because}" for guard in served if guard.holds is False]
    amiss += [f"{empty} of {replies} replies are empty"] if empty else []
    amiss += [f"{count} requests failed: {kind}" for kind, count in account.errors.items()]
    silent = sum(account.missing.values())
    amiss += [f"in {silent} of {account.finished} answers no decision is read"] if silent else []
    if len(decisions) == 1 and replies >= FIRST:
        amiss.append(f"all {replies} answers are the same: {next(iter(decisions))}")
    return LiveModel(name, account, dict(decisions.most_common()), tuple(first), tuple(amiss))


def application(live: LiveRun, ended: asyncio.Event, token: str, connections: Connections) -> web.Application:
    """Return the application: the page at ``/TOKEN/``, and ``/TOKEN/over``, answered at the end.

    It answers only under this machine's own names. Without the token nothing is shown.
    """
    names = HostNames()

    async def page(request: web.Request) -> web.Response:
        with connections.answering(request):
            if (why := names.refuses(request.headers)) is not None:
                return web.Response(status=421, text=why)
            if not secrets.compare_digest(request.match_info["token"].encode(), token.encode()):
                return web.Response(status=404, text="there is no page here: open the address that the run printed")
            if request.path.endswith("/over"):
                try:
                    await asyncio.wait_for(ended.wait(), _HELD_S)
                except TimeoutError:
                    return web.Response(status=204)
            html = await asyncio.to_thread(live.html)
        headers = {"Cache-Control": "no-store", "X-Content-Type-Options": "nosniff", "Referrer-Policy": "no-referrer"}
        return web.Response(body=html, content_type="text/html", charset="utf-8", headers=headers)

    app = web.Application()
    app.router.add_get("/{token}/", page)
    app.router.add_get("/{token}/over", page)
    return app


@dataclass
class _PageServer:
    """The server of a page, in a thread with its own event loop: its failure ends no run."""

    live: LiveRun
    started: Callable[[str], None]
    failed: Callable[[str], None]
    ready: threading.Event = field(default_factory=threading.Event)
    _end: Callable[[], None] = lambda: None

    def run(self) -> None:
        """Serve until the end."""
        try:
            with asyncio.Runner() as runner:  # a failed start of a loop leaves nothing behind
                runner.run(self._serve())
        except Exception as error:  # noqa: BLE001 - whatever it is, the run goes on
            self.failed(printable(f"{type(error).__name__}: {error}"))
        finally:
            self.ready.set()

    def end(self) -> None:
        """Answer the requests that wait for the end, and stop."""
        with suppress(RuntimeError):  # it ended before
            self._end()

    async def _serve(self) -> None:
        loop, over = asyncio.get_running_loop(), asyncio.Event()
        loop.set_exception_handler(lambda *_: None)  # accept without a descriptor tries again
        self._end = lambda: _say_over(loop, over)
        token, connections = secrets.token_urlsafe(16), Connections(_CONNECTIONS, _IDLE_S)
        app = application(self.live, over, token, connections)
        runner = web.AppRunner(app, shutdown_timeout=_ENDING_S, **connections.head())
        await runner.setup()
        handlers = runner.server
        assert handlers is not None
        begin = _giving_way(connections.accepting(handlers, lambda: None))
        try:
            listening = await loop.create_server(begin, "127.0.0.1", 0, backlog=_BACKLOG)
            self.started(f"http://127.0.0.1:{listening.sockets[0].getsockname()[1]}/{token}/")
            self.ready.set()
            while not over.is_set():
                with suppress(TimeoutError):
                    await asyncio.wait_for(over.wait(), _REAP_S)
                connections.reap(list(handlers.connections))
            listening.close()
        finally:
            await runner.cleanup()


def _giving_way(begin: Callable[[], asyncio.BaseProtocol]) -> Callable[[], asyncio.BaseProtocol]:
    """Return the factory of connections; it closes them if only the run's descriptors are left."""

    def begin_or_close() -> asyncio.BaseProtocol:
        return begin() if _has_descriptors() else _ClosedConnection()

    return begin_or_close


def _has_descriptors() -> bool:
    """Return whether more descriptors are free than the run's reserve."""
    try:
        import resource  # noqa: PLC0415 - Windows has neither the module nor so low a limit
    except ImportError:
        return True
    most = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    try:
        lowest = os.open(os.devnull, os.O_RDONLY)  # the lowest number that is free
    except OSError:
        return False
    os.close(lowest)
    return most == resource.RLIM_INFINITY or lowest + _KEPT < most


class _ClosedConnection(asyncio.Protocol):
    """A connection that is closed at once."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Close it."""
        assert isinstance(transport, asyncio.Transport)
        transport.abort()


@contextmanager
def live_server(
    live: LiveRun, started: Callable[[str], None], failed: Callable[[str], None] = lambda _: None
) -> Iterator[None]:
    """Serve the page on a free port of this machine during the block; ``started`` gets the address.

    No fault of the page ends the run; ``failed`` gets the reason if the page is no longer served.
    """
    page = _PageServer(live, started, failed)
    thread = threading.Thread(target=page.run, name="eyechart-watch", daemon=True)
    try:
        thread.start()
        page.ready.wait(_ENDING_S)
    except RuntimeError as error:
        failed(str(error))
    ended = "The run was interrupted; the same command goes on with it."
    try:
        yield
        ended = "The run is over."
    finally:
        live.over = ended
        page.end()
        if thread.ident is not None:
            thread.join(_ENDING_S)


@contextmanager
def watched(planned: PlannedRun, prices: Prices, tell: Callable[[str], None]) -> Iterator[Callable[[int, int], None]]:
    """Serve the page of a run during the block; yield what moves its bar. ``tell`` gets its address."""
    live, words = LiveRun(planned.out, prices, unit=planned.unit), "the page of this run is not served"
    with live_server(
        live,
        lambda url: tell(f"watch: {url} shows this run as it goes"),
        lambda why: tell(f"watch: {words}, and the run continues: {why}"),
    ):
        yield live.move


def _say_over(loop: asyncio.AbstractEventLoop, over: asyncio.Event) -> None:
    loop.call_soon_threadsafe(over.set)
