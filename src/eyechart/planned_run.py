"""A planned run of any study: the calls left, their cost, and how it is made."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, NamedTuple

from eyechart.calls import Emptiness
from eyechart.costs import CostEstimate, duration, emptiness
from eyechart.errors import SpecError, counted
from eyechart.event_loops import Progress
from eyechart.ledger import Ledger
from eyechart.limits import NOTHING, Limits, RunOutcome, Usage
from eyechart.manifest import LEDGER, EpisodesManifest, RunManifest
from eyechart.models import HERE, MEMORY_GB, WEIGHTS_GB, machine_of, memory_here_gb, sequential_groups
from eyechart.models.prices import Prices

if TYPE_CHECKING:  # a score probes no model
    from eyechart.probe import Sample

Manifest = RunManifest | EpisodesManifest
Bar = Callable[[str, str], AbstractContextManager[Progress]]
"""A progress bar from a name and a unit; it yields the function that moves it."""


def moving(progress: Progress | None) -> Bar:
    """Return a bar that calls ``progress``, if there is one."""
    return lambda *_: nullcontext(progress or (lambda *_: None))


@dataclass(frozen=True)
class RunAllowance:
    """How a run may be made: its limits, its concurrency, and steps before it.

    ``again`` retries calls that failed in transport. ``sequential`` asks models one after another
    (`eyechart.models.sequential_groups`). ``processes`` hold the worlds of drives. ``watch`` shows
    a page during the run. ``moved`` allows another address of a model. ``no_probe`` skips probing.
    ``before`` was spent outside the run and counts towards its limits. With the ``engine`` "ray",
    so many ``workers`` of a cluster hold each model, and each claims ``gpus``; ``concurrency`` is
    then that of each.
    """

    prices: Prices
    no_probe: bool = False
    dry_run: bool = False
    max_calls: int | None = None
    max_cost: float | None = None
    shard: str | None = None
    moved: bool = False
    watch: bool = False
    sequential: bool | None = None
    concurrency: int = 8
    again: bool = False
    processes: int = 1
    before: Usage = NOTHING
    engine: str = "local"
    workers: int = 1
    gpus: float = 0.0

    def __post_init__(self) -> None:
        if self.engine == "local" and (self.workers, self.gpus) != (1, 0.0):
            raise SpecError("--workers and --gpus are those of a cluster: give --engine ray too")

    def limits(self, manifest: Manifest) -> Limits:
        """Return the limits of one run."""
        return manifest.within(self.prices, calls=self.max_calls, cost_usd=self.max_cost, before=self.before)

    def require_room(self, unprobed: Sequence[str], made: Usage) -> None:
        """Raise SpecError if a run has no room to probe, or its shards would not match."""
        from eyechart.probe.mode_probe import MOST_CALLS  # noqa: PLC0415 - who reads what a run took probes nothing

        names, most = ", ".join(unprobed), MOST_CALLS * len(unprobed)
        if self.shard is not None:
            raise SpecError(
                f"all shards of a run need the same request mode: let 'eyechart probe' find one for {names}, "
                "and give it to all of them with --mode, or use --no-probe"
            )
        if self.max_calls is not None and self.max_calls - made.calls < most:
            raise SpecError(
                f"--max-calls {self.max_calls} leaves no room to probe {names}, which may take {most} calls: raise it, "
                "give a --mode file, or use --no-probe"
            )


class RunEnding(NamedTuple):
    """The last lines of a run, and the command's exit code; 0 continues with the next."""

    lines: Sequence[str] = ()
    code: int = 0


class PlannedRun(ABC):
    """A planned run: one object to probe, limit, show and make it.

    ``out`` is its folder, ``unit`` what its progress counts, and ``kept`` says what an interrupt
    leaves.
    """

    out: Path
    unit: ClassVar[str] = "calls"
    kept: ClassVar[str] = "finished calls are kept; the same command resumes"

    @property
    def keeper(self) -> "PlannedRun":
        """Return the run that records probing; a study of several runs names one."""
        return self

    def begin(self) -> Manifest:
        """Begin the run without models, if there is none, and return its manifest.

        The caller holds its folder. A probed model that was not recorded is probed again.
        """
        return self.keeper.begin()

    def sample(self) -> "Sample":
        """Return the questions of a probe of the run's models."""
        return self.keeper.sample()

    @abstractmethod
    def lines(self, how: RunAllowance) -> Iterator[str]:
        """Yield in words the plan and its expected cost."""

    @abstractmethod
    def make(self, how: RunAllowance, bar: Bar) -> RunOutcome:
        """Make the remaining calls within limits; return how that ended."""

    @abstractmethod
    def ends(self, outcome: RunOutcome, failed: Mapping[str, str]) -> Iterator[RunEnding]:
        """Yield the run's last lines; ``failed`` says why models were left out."""


def forecast(
    manifest: Manifest, models: Iterable[str], expected: Sequence[CostEstimate], how: RunAllowance
) -> list[str]:
    """Return in words the expected cost, the order of models, and the memory for weights.

    Warnings of the models come before the order.
    """
    specs, facts = list(models), manifest.facts
    lines = [estimate.words for estimate in expected]
    lines += [f"warning: {spec}: {facts[spec]['warning']}" for spec in specs if "warning" in facts.get(spec, {})]
    seconds = {estimate.model: estimate.seconds for estimate in expected}
    turns = sequential_groups(map(manifest.mode, specs), sequential=how.sequential)
    for turn in turns:
        if len(turn) > 1:
            known = [seconds.get(spec) for spec in turn]
            took = sum(one for one in known if one is not None)
            time = f", about {duration(took)} in all" if took and None not in known else ""
            lines.append(
                f"one after another, with only one open at a time{time}: {', '.join(turn)}; --together asks "
                "them at once"
            )
    return lines + _weights(manifest, turns)


_WORTH_SAYING_GB = 0.1
"""Smaller weights fit everywhere."""


def _weights(manifest: Manifest, turns: Sequence[Sequence[str]]) -> list[str]:
    """Return in words the memory for all weights that this machine holds at one time."""
    facts = {spec: fact for spec, fact in manifest.facts.items() if machine_of(manifest.mode(spec)) == HERE}
    needed = {spec: float(fact[WEIGHTS_GB]) for spec, fact in facts.items() if WEIGHTS_GB in fact}
    loaded = [[spec for spec in turn if spec in needed] for turn in turns]
    once = sum(max((needed[spec] for spec in turn), default=0.0) for turn in loaded)
    if once < _WORTH_SAYING_GB:
        return []
    each = ", ".join(f"{spec} {needed[spec]:.3g} GB" for turn in loaded for spec in turn)
    there = min(
        (float(facts[spec][MEMORY_GB]) for spec in needed if MEMORY_GB in facts[spec]), default=memory_here_gb()
    )
    of = "" if there is None else f" of {there:.3g} GB"
    lines = [f"memory: at most {once:.3g} GB{of} for weights at once, and more for answering ({each})"]
    if there is not None and once > there >= max(needed.values()):
        lines.append("warning: these weights do not fit together: ask the models with --sequential")
    return lines


_UNASKED = "models that were set aside were not asked: correct the cause, and the same command asks them"


def unasked(failed: Mapping[str, str]) -> RunEnding:
    """Return the ending that names models that were not asked at all."""
    return RunEnding([*(f"set aside: {spec}: {why}" for spec, why in failed.items()), _UNASKED], 1)


def aside(outcome: RunOutcome, failed: Mapping[str, str]) -> list[str]:
    """Return in words which models were set aside, and attempts of unknown cost."""
    lines = [f"set aside: {spec}: {why}" for spec, why in {**failed, **outcome.set_aside}.items()]
    if outcome.uncounted:
        lines.append(
            f"{counted(outcome.uncounted, 'attempt')} failed without a reported cost, which --max-cost does not count"
        )
    return lines


def calls_ended(outcome: RunOutcome, failed: Mapping[str, str], left: int, *, nothing: bool = False) -> RunEnding:
    """Return the ending of calls: exit 3 at a limit, 1 if some are unfinished.

    ``nothing`` to judge is exit 1 too, whatever stopped the calls.
    """
    unasked_here = {*failed, *outcome.set_aside}
    lines = aside(outcome, failed)
    lines += [f"{model}: {words}" for model, words in outcome.failed.items() if model not in unasked_here]
    if outcome.stopped is not None and left:
        return RunEnding(
            [*lines, f"stopped: {outcome.stopped}; {counted(left, 'call', 'are')} left; a higher limit resumes"],
            1 if nothing else 3,
        )
    if left:
        lines.append(f"{counted(left, 'call', 'are')} unfinished: {_to_finish(outcome)}")
    elif unasked_here:
        return RunEnding([*lines, _UNASKED], 1)
    return RunEnding(lines, int(left > 0 or nothing))


def _to_finish(outcome: RunOutcome) -> str:
    """Return in words what completes the unfinished calls."""
    tries = "their last error may pass, and the same command tries them again"
    lasting = sorted(outcome.lasting & outcome.set_aside.keys())
    if not lasting:
        return tries
    mend = (
        f"correct the cause for {', '.join(lasting)}, and the same command makes them; a changed Python file is "
        "another version, and needs another --out"
    )
    passing = {*outcome.set_aside, *outcome.failed} - outcome.lasting
    return f"{mend}. For the others {tries}" if passing else mend


def empty(runs: Iterable[Path]) -> RunEnding:
    """Return the ending for models whose replies are all empty, with the possible cause."""
    found: dict[str, Emptiness] = {}
    for run in runs:
        with Ledger(run / LEDGER, absent=True) as ledger:
            for spec, one in emptiness(ledger).items():
                found[spec] = found.get(spec, Emptiness()) + one
    lines = [f"nothing can be judged: {spec}: {one.words}" for spec, one in found.items() if one.is_whole]
    return RunEnding(lines, int(bool(lines)))
