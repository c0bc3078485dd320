"""Who is asked: by a SPEC, or as a callable that is at hand and may be given a name; and where, whatever it does."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path

from eyechart.errors import ArgumentError, SpecError, meant
from eyechart.frames import FrameBank


def placed(bank: FrameBank | Path | str) -> Path:
    """Return where a bank lies, from whatever folder a callable changes to."""
    return (bank.root if isinstance(bank, FrameBank) else Path(bank)).absolute()


def still(out: Path | str, place: Path) -> Path:
    """Return a path as it was given while it still leads to its place, or else that place."""
    return Path(out) if Path(out).absolute() == place else place


def each_named(asked: object, kind: str, argument: str, by_spec: Sequence[type]) -> list[tuple[str, object]]:
    """Return each of those ``asked`` with the name that it is given, "" for none.

    What is ``by_spec`` has a name of its own, and a mapping names callables. Raises SpecError for what is no ``kind``
    (model, policy), in words that name the ``argument`` it was given in.
    """
    own = tuple(by_spec)
    several: list[tuple[str, object]]
    if isinstance(asked, Mapping):
        several = [*asked.items()]
        for name, one in several:
            if isinstance(one, own):
                raise SpecError(
                    f"{argument}={{{name!r}: …}} names a callable, and a {type(one).__name__} is called by its SPEC: "
                    "give it in a list"
                )
            if not isinstance(name, str):
                raise SpecError(f"{argument} maps names to callables; {name!r} is no name")
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
    """Raise ArgumentError that lists those ``known``, fields of a TypedDict, where another is given."""
    taken = known.__annotations__
    for name in given:
        if name not in taken:
            near = f"{meant(name, taken)} it takes {', '.join(taken)}"
            raise ArgumentError(f"{function}() got an unexpected keyword argument '{name}';{near}")


def require_several(argument: str, given: object, example: str) -> None:
    """Raise SpecError where one word stands in the place of several values."""
    if isinstance(given, str | bytes) or not isinstance(given, Iterable):
        raise SpecError(f"{argument} are several, for example {example}, not {given!r}")


def require_new(spec: str, known: Mapping[str, object], argument: str) -> None:
    """Raise SpecError where two callables have one name."""
    if spec in known:
        raise SpecError(f"two callables are called '{spec}'; name each: {argument}={{'one': f, 'other': g}}")
