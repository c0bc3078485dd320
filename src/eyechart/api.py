"""The main job in a few lines of Python: build a bank, run the battery on models, and look at the report.

What the command line does step by step is done here in one call each; the steps stand in `eyechart.studies.battery`,
`eyechart.verdicts` and the other modules that the docs name, and there is no third way.
"""

import asyncio
import secrets
import threading
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any, TypedDict, Unpack

from eyechart.errors import SpecError
from eyechart.frames import FrameBank
from eyechart.limits import Spent
from eyechart.manifest import LEDGER
from eyechart.models.prices import read_prices
from eyechart.modes import RequestMode
from eyechart.probe import Found, Sample
from eyechart.probe import probe as find_mode
from eyechart.run import Progress
from eyechart.simulators import open_bank_simulator
from eyechart.studies import battery
from eyechart.studies.battery import Battery, BatteryScore, Extent
from eyechart.studies.probed import Allowed, Asked, Probing, plan_probed
from eyechart.verdicts import Verdict, judge, words_of


@dataclass(frozen=True, repr=False)
class Report:
    """A run, scored and judged: ``report["scripted:depth"]`` is the verdict on that model.

    ``path`` is the run's folder, ``score`` holds every statistic, ``verdicts`` maps each model's SPEC to its verdict.
    ``print`` it for the verdicts in words; a notebook shows them as cards.
    """

    path: Path
    score: BatteryScore
    verdicts: Mapping[str, Verdict]

    def __getitem__(self, model: str) -> Verdict:
        """Return the verdict on a model; raises SpecError that lists the models of the run."""
        if model not in self.verdicts:
            raise SpecError(f"{self.path} holds no model '{model}'; it holds {', '.join(self.verdicts) or 'none'}")
        return self.verdicts[model]

    def __iter__(self) -> Iterator[str]:
        return iter(self.verdicts)

    def __len__(self) -> int:
        return len(self.verdicts)

    def rows(self) -> list[dict[str, object]]:
        """Return every statistic of every model as plain values, a row each; ``pandas.DataFrame`` takes the list.

        ``low`` and ``high`` are the ends of the interval, ``p_holm`` is the p corrected over the run's models where it
        is corrected; what cannot be said is None, and ``note`` says why.
        """
        return [
            {
                "model": spec,
                "statistic": name,
                "value": one.value,
                "low": None if one.ci is None else one.ci[0],
                "high": None if one.ci is None else one.ci[1],
                "n": one.n,
                "p": one.p,
                "p_holm": model.holm.get(name),
                "note": one.note,
            }
            for spec, model in self.score.models.items()
            for name, one in model.statistics.items()
        ]

    def to_html(self, out: Path | str) -> Path:
        """Write the report as one self-contained page, as ``eyechart report`` does, and return where it is.

        The page shows this report's own score. Raises LedgerError where the ledger cannot be read, and OutputError
        where the page may not be written there.
        """
        from eyechart.destination import require_free  # noqa: PLC0415
        from eyechart.report.page import write_page  # noqa: PLC0415
        from eyechart.studies.battery.page import make_page  # noqa: PLC0415
        from eyechart.studies.battery.subjects import evidence_of, find_pictures  # noqa: PLC0415 - matplotlib is slow to import

        require_free(Path(out), "report")
        pictures = find_pictures(self.score.manifest, self.score.bank, self.path)
        name = self.path.resolve().name or "run"
        write_page(make_page([evidence_of(name, self.score, self.path / LEDGER, *pictures)]), Path(out))
        return Path(out)

    def __repr__(self) -> str:
        labels = ", ".join(f"{spec}: {one.headline}" for spec, one in self.verdicts.items())
        return f"<Report on {self.path}: {labels or 'no model'}>"

    def __str__(self) -> str:
        return "\n\n".join([*filter(None, [words_of(self.verdicts)]), f"Scope: {self._scope()}"])

    def _repr_html_(self) -> str:
        cards = "".join(one._repr_html_() for one in self.verdicts.values())
        return f"<div><p><strong>{escape(str(self.path))}</strong>. {escape(self._scope())}</p>{cards}</div>"

    def _scope(self) -> str:
        return self.score.scope() if self.verdicts else "the run holds no model"


def build_bank(
    out: Path | str,
    *,
    simulator: str = "highway",
    preset: str = "balanced",
    seeds: Sequence[int] = (0, 1, 2),
    steps: int = 12,
    progress: Progress | None = None,
) -> FrameBank:
    """Render a frame bank into the folder ``out``, as ``eyechart frames build`` does.

    ``steps`` frames are taken of every episode, and each of ``seeds`` gives one episode a scenario; ``progress`` gets
    (frames done, of how many). Raises SpecError for an unknown simulator or preset, BankError where ``out`` is taken.
    """
    opened = open_bank_simulator(simulator)
    return opened.build(Path(out), preset=preset, seeds=seeds, steps=steps, progress=progress)


class _Asking(TypedDict, total=False):
    """How a battery asks: options that are passed on to `eyechart.studies.battery.plan`, with its defaults."""

    prompt: str | None
    seed: int
    limit: int | None
    controls: str | None


def run_battery(
    bank: FrameBank | Path | str,
    models: Sequence[str | RequestMode] | str | RequestMode,
    out: Path | str,
    *,
    concurrency: int = 8,
    probe: bool = True,
    progress: Progress | None = None,
    **asking: Unpack[_Asking],
) -> Report:
    """Ask models about every frame of a bank under every condition, and return the report.

    It makes calls, which may cost money; those that the run's folder ``out`` holds already are not made again, so an
    interrupted call goes on where it stopped. ``models`` is a SPEC, a request mode, or several of them; a model that is
    served elsewhere and given by its SPEC is probed first, once a run, unless ``probe`` is false. ``prompt``, ``seed``,
    ``limit`` and ``controls`` are those of ``eyechart run battery`` (the rarer ones are those of
    `eyechart.studies.battery.plan`); ``progress`` gets (calls done, of how many). Raises BankError, SpecError or
    LedgerError as ``plan`` does, and ProbeError where a model cannot be probed. A report on calls that
    failed says so in its notes.
    """
    given = [models] if isinstance(models, str | RequestMode) else models
    named: dict[str, Any] = {**asking}
    extent = Extent(named.pop("limit", None), controls=named.pop("controls", None))

    def plan(modes: Sequence[RequestMode], probes: Mapping[str, Spent]) -> Battery:
        root = bank.root if isinstance(bank, FrameBank) else Path(bank)
        return battery.plan(root, modes, Path(out), extent=extent, **named).counting(probes)

    modes = [one if isinstance(one, RequestMode) else RequestMode(one) for one in given]
    asked = Asked(modes, frozenset(one for one in given if isinstance(one, str)), {})
    probing = Probing(plan, lambda one: battery.sample_of([one]), battery.keep_probes, [Path(out)])
    planned = plan_probed(probing, asked, Allowed(read_prices(), no_probe=not probe), _ask)[0]
    assert planned is not None  # a model that cannot be probed has raised
    _make_calls(planned, concurrency, progress)
    return read_report(out)


def read_report(run: Path | str, *, resamples: int = 5000, independent: bool = False, reread: bool = False) -> Report:
    """Score and judge a run, finished or not, as ``eyechart verdict`` does; it makes no call and changes nothing.

    ``resamples`` are drawn in each permutation test and bootstrap; ``independent`` declares that frames outside
    episodes are independent draws; ``reread`` reads the replies of a run that was begun under another version of the
    reader by today's. Raises LedgerError or BankError where the folder is no run, or needs ``reread``, and SpecError
    where independence is declared of a bank with episodes.
    """
    scored = battery.score(Path(run), resamples=resamples, independent=independent, reread=reread)
    return Report(Path(run), scored, judge(scored))


def _ask(mode: RequestMode, sample: Sample, most: float | None) -> Found:
    """Probe a model in a thread, because a notebook has an event loop of its own."""
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(find_mode, mode, sample=sample, seed=secrets.randbelow(10**6), max_cost=most).result()


def _make_calls(planned: Battery, concurrency: int, progress: Progress | None) -> None:
    """Run a battery; where an event loop is running already, as in a notebook, in a thread with a loop of its own."""
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        battery.run(planned, concurrency=concurrency, progress=progress)
        return
    calls = _Calls(progress)
    with ThreadPoolExecutor(1) as thread:
        running = thread.submit(battery.run, planned, concurrency=concurrency, progress=calls.move)
        try:
            running.result()
        except KeyboardInterrupt:
            calls.stop()
            raise


class _Calls:
    """The calls that another thread makes, so that an interrupt of this one can end them."""

    def __init__(self, progress: Progress | None) -> None:
        self._progress = progress
        self._stopped = threading.Event()
        self._main: tuple[asyncio.AbstractEventLoop, asyncio.Task[object]] | None = None

    def move(self, done: int, total: int) -> None:
        """Pass the progress on; the first time it is told by the task that all others belong to."""
        task = asyncio.current_task()
        if self._main is None and task is not None:
            self._main = (task.get_loop(), task)
        if self._stopped.is_set():
            raise KeyboardInterrupt
        if self._progress is not None:
            self._progress(done, total)

    def stop(self) -> None:
        """Cancel the calls under way; in the ledger they stand as sent, with their outcome unknown."""
        self._stopped.set()
        if self._main is not None:
            loop, task = self._main
            with suppress(RuntimeError):  # the loop has ended meanwhile
                loop.call_soon_threadsafe(task.cancel)
