"""The subjects of a run: SPECs, or callables with names, and the paths of a run."""

import secrets
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from eyechart.errors import ArgumentError, SpecError, did_you_mean
from eyechart.frames import FrameBank
from eyechart.limits import Usage
from eyechart.models import Model, OpenedModel
from eyechart.models.python_callable import name_of
from eyechart.modes import RequestMode
from eyechart.planned_run import PlannedRun, RunAllowance
from eyechart.probe import ProbeResult, Sample
from eyechart.probe import probe as find_mode
from eyechart.studies.probes import Planner, RunModes, plan_probed

P = TypeVar("P", bound=PlannedRun)


@dataclass(frozen=True)
class Subjects:
    """The models or policies of a run: their modes in order, open callables, and the given SPECs.

    ``how`` are the fields of a request mode that were given for those without one.
    """

    modes: list[RequestMode]
    held: Mapping[str, OpenedModel]
    by_spec: frozenset[str]
    how: Mapping[str, Any]

    def planned(self, plan: Callable[..., P], runs: Sequence[Path], allowed: RunAllowance) -> P:
        """Return a study's ``plan`` of these ``specs``; those served elsewhere are probed first.

        Raises ProbeError if a probe fails.
        """

        def plan_of(modes: Sequence[RequestMode]) -> P:
            return plan(specs=[self.held.get(mode.spec, mode) for mode in modes])

        run_modes = RunModes(self.modes, self.by_spec, self.how)
        result = plan_probed(Planner(plan_of, runs), run_modes, allowed, partial(_ask, fixed=[*self.how]))[0]
        assert result is not None  # a failed probe raises before this
        return result


def subjects_of(
    given: object, kind: str, argument: str, how: Mapping[str, Any], hold: Callable[[Any, RequestMode], Model]
) -> Subjects:
    """Return the subjects of an ``argument``, each a SPEC, a request mode or a callable.

    Raises SpecError if one is no ``kind``, or if two have the same name and are not the same.
    """
    modes: dict[str, RequestMode] = {}
    held: dict[str, OpenedModel] = {}
    several = each_named(given, kind, argument, (str, RequestMode))
    for name, one in several:
        if isinstance(one, str | RequestMode):
            mode = one if isinstance(one, RequestMode) else RequestMode(one, **how)
        else:
            assert callable(one)
            mode = RequestMode(f"python:{name or name_of(one)}", **how)
            if mode.spec in held:
                raise SpecError(
                    f"two callables are called '{mode.spec}'; name each: {argument}={{'one': f, 'other': g}}"
                )
            held[mode.spec] = OpenedModel(mode, hold(one, mode))
        if mode.spec in held and modes.keys() & {mode.spec}:
            raise SpecError(f"{argument} hold '{mode.spec}' as a callable and by its SPEC: keep one of them")
        if modes.setdefault(mode.spec, mode) != mode:
            raise SpecError(f"{argument} name '{mode.spec}' twice, to be asked in two ways: a run asks it in one")
    return Subjects(list(modes.values()), held, frozenset(one for _, one in several if isinstance(one, str)), how)


def _ask(
    mode: RequestMode, sample: Sample, most: float | None, spend: Callable[[Usage], None], *, fixed: Sequence[str]
) -> ProbeResult:
    """Probe a model without changing ``fixed`` fields; it runs in a thread if a loop runs here."""
    return find_mode(mode, fixed=fixed, sample=sample, seed=secrets.randbelow(10**6), max_cost=most, spend=spend)


def placed(bank: FrameBank | Path | str) -> Path:
    """Return a bank's absolute path, before a callable can change the folder."""
    return (bank.root if isinstance(bank, FrameBank) else Path(bank)).absolute()


def still(out: Path | str, place: Path) -> Path:
    """Return a path as it was given if it still leads to ``place``, else ``place``."""
    return Path(out) if Path(out).absolute() == place else place


def each_named(given: object, kind: str, argument: str, by_spec: Sequence[type]) -> list[tuple[str, object]]:
    """Return each of the ``given`` subjects with its name, or "" for none.

    Types in ``by_spec`` have a name already; a mapping names callables. Raises SpecError that names
    the ``argument`` if one is not a ``kind`` (model, policy).
    """
    own = tuple(by_spec)
    several: list[tuple[str, object]]
    if isinstance(given, Mapping):
        several = [*given.items()]
        for name, one in several:
            if isinstance(one, own):
                raise SpecError(
                    f"{argument}={{{name!r}: …}} names a callable, but a {type(one).__name__} has its SPEC as "
                    "its name: give it in a list"
                )
            if not isinstance(name, str):
                raise SpecError(f"{argument} maps names to callables; {name!r} is not a name")
    elif isinstance(given, own) or not isinstance(given, Sequence):
        several = [("", given)]
    else:
        several = [("", one) for one in given]
    for _, one in several:
        if not (isinstance(one, own) or callable(one)):
            kinds = ", a ".join(each for each in ("SPEC", *(one.__name__ for one in own if one is not str)))
            raise SpecError(f"a {kind} is a {kinds} or a callable, not a {type(one).__name__}")
    return several


def require_arguments(function: str, given: Collection[str], known: type) -> None:
    """Raise ArgumentError that lists the fields of the TypedDict ``known`` if another is given."""
    taken = known.__annotations__
    for name in given:
        if name not in taken:
            near = f"{did_you_mean(name, taken)} it takes {', '.join(taken)}"
            raise ArgumentError(f"{function}() got an unexpected keyword argument '{name}';{near}")


def require_several(argument: str, given: object, example: str) -> None:
    """Raise SpecError if an argument of several values is a single word."""
    if isinstance(given, str | bytes) or not isinstance(given, Iterable):
        raise SpecError(f"{argument} takes several values, for example {example}, not {given!r}")
