"""The subjects of a run: SPECs, or callables with names, and the paths of a run."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path

from eyechart.errors import ArgumentError, SpecError, did_you_mean
from eyechart.frames import FrameBank


def placed(bank: FrameBank | Path | str) -> Path:
    """Return a bank's absolute path, before a callable can change the folder."""
    return (bank.root if isinstance(bank, FrameBank) else Path(bank)).absolute()


def still(out: Path | str, place: Path) -> Path:
    """Return a path as it was given if it still leads to ``place``, else ``place``."""
    return Path(out) if Path(out).absolute() == place else place


def each_named(asked: object, kind: str, argument: str, by_spec: Sequence[type]) -> list[tuple[str, object]]:
    """Return each of the ``asked`` subjects with its given name, or "" for none.

    Types in ``by_spec`` have a name already; a mapping names callables. Raises SpecError that names
    the ``argument`` if one is not a ``kind`` (model, policy).
    """
    own = tuple(by_spec)
    several: list[tuple[str, object]]
    if isinstance(asked, Mapping):
        several = [*asked.items()]
        for name, one in several:
            if isinstance(one, own):
                raise SpecError(
                    f"{argument}={{{name!r}: …}} names a callable, but a {type(one).__name__} has its SPEC as "
                    "its name: give it in a list"
                )
            if not isinstance(name, str):
                raise SpecError(f"{argument} maps names to callables; {name!r} is not a name")
    elif isinstance(asked, own) or not isinstance(asked, Sequence):
        several = [("", asked)]
    else:
        several = [("", one) for one in asked]
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


def require_new(spec: str, known: Mapping[str, object], argument: str) -> None:
    """Raise SpecError if two callables have the same name."""
    if spec in known:
        raise SpecError(f"two callables are called '{spec}'; name each: {argument}={{'one': f, 'other': g}}")
