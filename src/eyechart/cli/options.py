"""Options that several commands take are written once, as the fields of a dataclass."""

import inspect
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

if TYPE_CHECKING:
    from eyechart.models.prices import Prices

Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]
PriceFile = Annotated[Path | None, typer.Option(help="FILE.toml of prices; it comes before the table.")]


@dataclass(frozen=True)
class Spending:
    """What a run may take."""

    max_calls: Annotated[int | None, typer.Option(min=1, help="Stop at so many requests, all told.")] = None
    max_cost: Annotated[float | None, typer.Option(min=0, help="Stop at so many US dollars, all told.")] = None
    prices: PriceFile = None

    def table(self) -> "Prices":
        """Return the table of prices, that of the file before that of the package."""
        from eyechart.models.prices import read_prices

        return read_prices(self.prices)


NO_LIMIT = Spending()


def expanded(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command with an option for every field of the dataclasses among its parameters.

    Typer reads options from a command's signature alone, where commands cannot share them.
    """
    own = inspect.signature(command, eval_str=True)
    groups: dict[str, Any] = {
        one.name: one.annotation for one in own.parameters.values() if is_dataclass(one.annotation)
    }
    taken = [one for parameter in own.parameters.values() for one in _options(parameter)]

    @wraps(command)
    def run(**given: Any) -> None:  # noqa: ANN401  (as many kinds as there are options)
        for name, group in groups.items():
            given[name] = group(**{field.name: given.pop(field.name) for field in fields(group)})
        command(**given)

    run.__signature__ = own.replace(parameters=taken)  # type: ignore[attr-defined]
    run.__annotations__ = {one.name: one.annotation for one in taken}
    return run


def _options(parameter: inspect.Parameter) -> list[inspect.Parameter]:
    if not is_dataclass(parameter.annotation):
        return [parameter]
    hints = get_type_hints(parameter.annotation, include_extras=True)
    return [
        parameter.replace(name=field.name, annotation=hints[field.name], default=field.default)
        for field in fields(parameter.annotation)
    ]
