"""Build a bank, run the battery on models, and read the report."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

from eyechart.api.reports import RunReport, row_of, written_page
from eyechart.api.subjects import Subjects, placed, require_arguments, require_several, still, subjects_of
from eyechart.errors import SpecError, speaks_of_arguments, whole_number
from eyechart.frames import FrameBank
from eyechart.manifest import LEDGER
from eyechart.models.prices import read_prices
from eyechart.models.python_callable import hold
from eyechart.modes import RequestMode, Scalar
from eyechart.planned_run import RunAllowance, moving
from eyechart.run import Progress
from eyechart.simulators import open_bank_simulator
from eyechart.studies import battery
from eyechart.studies.battery import BatteryScore, BatterySelection
from eyechart.studies.battery.series import read_series
from eyechart.studies.probes import accept_losses
from eyechart.verdicts import Verdict, judge, words_of

if TYPE_CHECKING:  # a score needs no templates
    from eyechart.report.page import Page

_RESAMPLES = 5000
AskedModel = str | RequestMode | Callable[..., object]
"""A model: its SPEC, its request mode, or a callable that takes (prompt, image) and answers."""


@dataclass(frozen=True, repr=False)
class Report(RunReport[BatteryScore, Verdict]):
    """A scored and judged run: ``report["scripted:depth"]`` is the verdict on that model.

    ``path`` is the run's folder, ``score`` holds every statistic, and ``verdicts`` maps each SPEC
    to its verdict. ``print`` it for the verdicts in words; a notebook shows them as cards.
    """

    def rows(self) -> list[dict[str, object]]:
        """Return every statistic of every model as a row of plain values, for ``pandas.DataFrame``.

        ``low`` and ``high`` are the ends of the interval. ``p_holm`` is the p corrected over the
        run's models, where it is corrected. An inconclusive value is None, and ``note`` says why.
        """
        return [
            row_of("model", spec, name, statistic, p_holm=model.holm.get(name))
            for spec, model in self.score.models.items()
            for name, statistic in model.statistics.items()
        ]

    @speaks_of_arguments
    def to_html(self, out: Path | str) -> Path:
        """Write the report as one page, as ``eyechart report`` does, and return its path.

        The page shows this report's own score. Raises LedgerError if the ledger cannot be read, and
        OutputError if the page may not be written there.
        """
        from eyechart.studies.battery.page import make_page  # noqa: PLC0415 - matplotlib is slow to import
        from eyechart.studies.battery.subjects import evidence_of, find_pictures  # noqa: PLC0415 - as above

        def page() -> "Page":
            pictures = find_pictures(self.score.manifest, self.score.bank, self.path)
            name = self.path.resolve().name or "run"
            return make_page([evidence_of(name, self.score, self.path / LEDGER, *pictures)])

        return written_page(page, out)

    def _said(self) -> str:
        return words_of(self.verdicts)

    def _scope(self) -> str:
        return self.score.scope() if self.verdicts else "the run holds no model"


@speaks_of_arguments
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

    Each of ``seeds`` gives one episode per scenario, with ``steps`` frames. ``progress`` gets
    (frames done, total). Raises SpecError for an unknown simulator or preset, and BankError if
    ``out`` is taken.
    """
    steps = whole_number("steps", steps, 1)
    require_several("seeds", seeds, "(0, 1, 2)")
    drawn = [whole_number("each of seeds", seed, 0) for seed in seeds]
    opened = open_bank_simulator(simulator)
    return opened.build(Path(out), preset=preset, seeds=drawn, steps=steps, progress=progress)


class _Mode(TypedDict, total=False):
    """The request-mode fields for models that are given as SPECs or callables."""

    base_url: str
    key_env: str
    token_field: str
    max_tokens: int
    structured: str
    temperature: float | None
    timeout_s: float
    headers: Mapping[str, str]
    body: Mapping[str, object]
    options: Mapping[str, Scalar]
    system: str
    answer: str
    stream: str


class _BatteryOptions(_Mode, total=False):
    """The options of a battery: request-mode fields, and those of its ``plan`` and ``run``."""

    prompt: str | None
    conditions: Sequence[str] | None
    seed: int
    limit: int | None
    controls: str | None
    series: Sequence[str] | str | None
    again: bool
    accept_loss: bool
    moved: bool
    sequential: bool | None
    engine: str
    workers: int
    gpus: float


@speaks_of_arguments
def run_battery(
    bank: FrameBank | Path | str,
    models: Sequence[AskedModel] | AskedModel | Mapping[str, Callable[..., object]],
    out: Path | str,
    *,
    concurrency: int = 8,
    probe: bool = True,
    progress: Progress | None = None,
    **asking: Unpack[_BatteryOptions],
) -> Report:
    """Ask models about every frame of a bank under every condition, and return the report.

    It makes calls, which may cost money. Calls that the folder ``out`` already holds are not
    repeated, so the same call resumes an interrupted run. ``models`` is a SPEC, a request mode, a
    callable, or several of them. A callable takes (prompt, image) or (prompt, images, state); the
    report calls it ``python:MODULE:FUNCTION``. A mapping gives callables other names (``{"mine":
    f}`` is ``python:mine``). A model that is served elsewhere and given by its SPEC is probed
    first, once per run, unless ``probe`` is false.

    ``prompt``, ``conditions``, ``seed``, ``limit``, ``controls`` and ``series`` are those of
    ``eyechart run battery``. ``again`` retries calls that failed in transport. ``accept_loss`` continues although
    the ledger lost finished calls. ``moved`` continues although addresses, keys or headers of
    models changed. ``sequential`` asks models one after another, with only one open at a time; that
    is the default for local models (``hf:``, ``ollama:``). With ``engine="ray"``, so many
    ``workers`` of the cluster of RAY_ADDRESS hold each model, and each claims ``gpus``.

    ``base_url``, ``max_tokens``, ``temperature`` and the other fields of a
    `eyechart.modes.RequestMode` (all but ``seed``) apply to models that are not given by a request
    mode. A temperature of None is not sent. ``progress`` gets (calls done, total).

    Raises BankError, SpecError or LedgerError as ``plan`` does, and ProbeError if a probe fails. A
    report's notes name failed calls.
    """
    require_arguments("run_battery", asking, _BatteryOptions)
    if asking.get("conditions") is not None:
        require_several("conditions", asking["conditions"], '["real", "blank"]')
    named: dict[str, Any] = {**asking}
    root, place = placed(bank), Path(out).absolute()
    how = {name: named.pop(name) for name in _Mode.__annotations__ if name in named}
    subjects = _models(models, how)
    concurrency = whole_number("concurrency", concurrency, 1)
    if "seed" in named:
        named["seed"] = whole_number("seed", named["seed"], 0)
    limit = named.pop("limit", None)
    extent = BatterySelection(
        None if limit is None else whole_number("limit", limit, 1),
        controls=named.pop("controls", None),
        series=() if (series := named.pop("series", None)) is None else read_series(series),
    )
    again, moved = named.pop("again", False), named.pop("moved", False)
    sequential = named.pop("sequential", None)
    cluster = {name: named.pop(name) for name in ("engine", "workers", "gpus") if name in named}
    if sequential not in (True, False, None):
        raise SpecError(f"sequential must be True, False or None, not {sequential!r}")
    if named.pop("accept_loss", False):
        list(accept_losses(place))

    bounds = {"concurrency": concurrency, "again": again, "sequential": sequential}
    allowed = RunAllowance(read_prices(), no_probe=not probe, moved=moved, **bounds, **cluster)
    planned = subjects.planned(partial(battery.plan, root, out=place, extent=extent, **named), [place], allowed)
    planned.make(allowed, moving(progress))
    return _read_report(still(out, place))


def _models(given: object, how: Mapping[str, Any]) -> Subjects:
    """Return the models of an argument; raises SpecError if the fields would change none of them."""
    found = subjects_of(given, "model", "models", how, hold)
    if how and not found.by_spec and not found.held:
        raise SpecError(f"{', '.join(how)} would change no model: a RequestMode is asked as it says")
    return found


@speaks_of_arguments
def read_report(
    run: Path | str, *, resamples: int = _RESAMPLES, independent: bool = False, reread: bool = False
) -> Report:
    """Score and judge a run, finished or not, as ``eyechart verdict`` does, without a call.

    ``resamples`` is the number of draws in each permutation test and bootstrap. ``independent``
    declares that frames outside episodes are independent draws. ``reread`` reads the replies of an
    older run with today's reader. Raises LedgerError or BankError if the folder is no run or needs
    ``reread``. Raises SpecError if independence is declared for a bank with episodes.
    """
    return _read_report(run, resamples=resamples, independent=independent, reread=reread)


def _read_report(run: Path | str, **reading: Any) -> Report:  # noqa: ANN401 - those of `read_report`
    reading["resamples"] = whole_number("resamples", reading.get("resamples", _RESAMPLES), 1)
    scored = battery.score(Path(run), **reading)
    return Report(Path(run), scored, judge(scored))
