"""A run that is planned and not yet made, of any study: what is left, what it takes, how it is asked, what it keeps."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, NamedTuple

from eyechart.calls import Emptiness
from eyechart.costs import CostEstimate, duration, emptiness
from eyechart.errors import SpecError, counted
from eyechart.ledger import Ledger
from eyechart.limits import NOTHING, Limits, Outcome, Spent
from eyechart.loops import Progress
from eyechart.manifest import LEDGER, EpisodesManifest, RunManifest
from eyechart.models import HERE, MEMORY_GB, WEIGHTS_GB, machine_of, memory_here_gb, turns_of
from eyechart.models.prices import Prices

if TYPE_CHECKING:  # a score probes no model
    from eyechart.probe import Sample

Manifest = RunManifest | EpisodesManifest
Bar = Callable[[str, str], AbstractContextManager[Progress]]
"""Shows how far something is, by its name and its unit, and yields what moves it."""


def moving(progress: Progress | None) -> Bar:
    """Return what shows how far something is by calling ``progress``, if that is given."""
    return lambda *_: nullcontext(progress or (lambda *_: None))


@dataclass(frozen=True)
class Allowed:
    """How a run may be made: its limits, how much at once, and what may come before it.

    ``again`` asks once more what failed on the way, ``sequential`` asks models one after another
    (`eyechart.models.turns_of`), ``processes`` hold the worlds of drives. ``watch`` says whether a page shows the run
    while it goes on, ``moved`` whether a model may have another address, ``no_probe`` that none is probed first,
    ``before`` what was spent outside the run and counts towards its limits.
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
    before: Spent = NOTHING

    def limits(self, manifest: Manifest) -> Limits:
        """Return the limits of one run."""
        return manifest.within(self.prices, calls=self.max_calls, cost_usd=self.max_cost, before=self.before)

    def require_room(self, unprobed: Sequence[str], made: Spent) -> None:
        """Raise SpecError where a run cannot probe: its limit is too small, or its shards would not ask alike."""
        from eyechart.probe.pinning import MOST_CALLS  # noqa: PLC0415 - who reads what a run took probes nothing

        names, most = ", ".join(unprobed), MOST_CALLS * len(unprobed)
        if self.shard is not None:
            raise SpecError(
                f"the shards of a run must ask alike: let 'eyechart probe' find a mode of {names} once, and give it to "
                "all of them with --mode, or use --no-probe"
            )
        if self.max_calls is not None and self.max_calls - made.calls < most:
            raise SpecError(
                f"--max-calls {self.max_calls} leaves no room to probe {names}, which may take {most} calls: raise it, "
                "give a --mode file, or use --no-probe"
            )


class Ending(NamedTuple):
    """What is said when a run is over, and the exit code that ends its command there; 0 goes on to the next."""

    lines: Sequence[str] = ()
    code: int = 0


class Planned(ABC):
    """A run that is planned and not yet made: one object for whoever probes, bounds, shows and makes it.

    ``out`` is its folder, ``unit`` what its progress counts, and ``kept`` says what an interrupt leaves.
    """

    out: Path
    unit: ClassVar[str] = "calls"
    kept: ClassVar[str] = "finished calls are kept; the same command resumes"

    @property
    def keeper(self) -> "Planned":
        """Return the run that keeps what probing takes; a study of several names one."""
        return self

    def begin(self) -> Manifest:
        """Begin the run with nobody in it, where none stands there, and return its manifest.

        Whoever calls holds its folder. A model that was probed and is not recorded is probed anew.
        """
        return self.keeper.begin()

    def sample(self) -> "Sample":
        """Return what a probe asks of the run's models."""
        return self.keeper.sample()

    @abstractmethod
    def lines(self, how: Allowed) -> Iterator[str]:
        """Yield in words what is planned, and what it is expected to take."""

    @abstractmethod
    def make(self, how: Allowed, bar: Bar) -> Outcome:
        """Make what is left, within limits, and return how that ended."""

    @abstractmethod
    def ends(self, outcome: Outcome, failed: Mapping[str, str]) -> Iterator[Ending]:
        """Yield what is said when it is over; ``failed`` says why models were left out of the plan."""


def forecast(manifest: Manifest, models: Iterable[str], expected: Sequence[CostEstimate], how: Allowed) -> list[str]:
    """Say what calls are expected to take, which models wait for others, and what weights need of this memory.

    Before the turns, what the models themselves give to think about.
    """
    asked, facts = list(models), manifest.facts
    lines = [one.words for one in expected]
    lines += [f"warning: {spec}: {facts[spec]['warning']}" for spec in asked if "warning" in facts.get(spec, {})]
    seconds = {one.model: one.seconds for one in expected}
    turns = turns_of(map(manifest.mode, asked), sequential=how.sequential)
    for turn in turns:
        if len(turn) > 1:
            known = [seconds.get(spec) for spec in turn]
            took = sum(one for one in known if one is not None)
            time = f", about {duration(took)} in all" if took and None not in known else ""
            lines.append(
                f"one after another, each closed before the next is opened{time}: {', '.join(turn)}; --together asks "
                "them at once"
            )
    return lines + _weights(manifest, turns)


_WORTH_SAYING_GB = 0.1
"""Smaller weights fit everywhere."""


def _weights(manifest: Manifest, turns: Sequence[Sequence[str]]) -> list[str]:
    """Say what the weights that this machine holds at one time take, where models tell what theirs do."""
    facts = {spec: one for spec, one in manifest.facts.items() if machine_of(manifest.mode(spec)) == HERE}
    needed = {spec: float(one[WEIGHTS_GB]) for spec, one in facts.items() if WEIGHTS_GB in one}
    asked = [[spec for spec in turn if spec in needed] for turn in turns]
    once = sum(max((needed[spec] for spec in turn), default=0.0) for turn in asked)
    if once < _WORTH_SAYING_GB:
        return []
    each = ", ".join(f"{spec} {needed[spec]:.3g} GB" for turn in asked for spec in turn)
    there = min(
        (float(facts[spec][MEMORY_GB]) for spec in needed if MEMORY_GB in facts[spec]), default=memory_here_gb()
    )
    of = "" if there is None else f" of {there:.3g} GB"
    lines = [f"memory: at most {once:.3g} GB{of} for weights at once, and what answering takes on top ({each})"]
    if there is not None and once > there >= max(needed.values()):
        lines.append("warning: these weights do not fit together: ask the models with --sequential")
    return lines


_UNASKED = "models that were set aside were not asked: mend what is wrong, and the same command asks them"


def unasked(failed: Mapping[str, str]) -> Ending:
    """Say which models were not asked at all."""
    return Ending([*(f"set aside: {spec}: {why}" for spec, why in failed.items()), _UNASKED], 1)


def aside(outcome: Outcome, failed: Mapping[str, str]) -> list[str]:
    """Say which models were set aside and why, and of how many attempts a bounded cost knows nothing."""
    lines = [f"set aside: {spec}: {why}" for spec, why in {**failed, **outcome.set_aside}.items()]
    if outcome.uncounted:
        lines.append(
            f"{counted(outcome.uncounted, 'attempt')} failed without telling the cost, which --max-cost does not count"
        )
    return lines


def calls_ended(outcome: Outcome, failed: Mapping[str, str], left: int, *, nothing: bool = False) -> Ending:
    """Say how calls ended; 3 where a limit stopped them, 1 where some are unfinished.

    Also 1 where ``nothing`` that came can be judged, whatever stopped them.
    """
    unasked_here = {*failed, *outcome.set_aside}
    lines = aside(outcome, failed)
    lines += [f"{model}: {words}" for model, words in outcome.failed.items() if model not in unasked_here]
    if outcome.stopped is not None and left:
        return Ending(
            [*lines, f"stopped: {outcome.stopped}; {counted(left, 'call', 'are')} left; a higher limit resumes"],
            1 if nothing else 3,
        )
    if left:
        lines.append(f"{counted(left, 'call', 'are')} unfinished: {_to_finish(outcome)}")
    elif unasked_here:
        return Ending([*lines, _UNASKED], 1)
    return Ending(lines, int(left > 0 or nothing))


def _to_finish(outcome: Outcome) -> str:
    """Return in words what makes the calls that are unfinished."""
    tries = "their last error may pass, and the same command tries them again"
    lasting = sorted(outcome.lasting & outcome.set_aside.keys())
    if not lasting:
        return tries
    mend = (
        f"mend what is wrong with {', '.join(lasting)}, and the same command makes them; a Python file that was "
        "changed is another version, and needs another --out"
    )
    passing = {*outcome.set_aside, *outcome.failed} - outcome.lasting
    return f"{mend}. Of the others {tries}" if passing else mend


def empty(runs: Iterable[Path]) -> Ending:
    """Say of models all of whose replies in these runs say nothing why that may be."""
    found: dict[str, Emptiness] = {}
    for run in runs:
        with Ledger(run / LEDGER, absent=True) as ledger:
            for spec, one in emptiness(ledger).items():
                found[spec] = found.get(spec, Emptiness()) + one
    lines = [f"nothing can be judged: {spec}: {one.words}" for spec, one in found.items() if one.whole]
    return Ending(lines, int(bool(lines)))
