"""The common part of all reports: verdicts by name, words, cards and a page."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Generic, Protocol, TypeVar

from eyechart.errors import SpecError, speaks_of_arguments
from eyechart.stats.statistic import Statistic

if TYPE_CHECKING:  # a score needs no templates
    from eyechart.report.page import Page


class _AnyVerdict(Protocol):
    """A verdict on one model or policy."""

    @property
    def headline(self) -> str:
        """Return its labels."""

    def _repr_html_(self) -> str:
        """Return it as a card."""


S = TypeVar("S")
V = TypeVar("V", bound=_AnyVerdict)


@dataclass(frozen=True, repr=False)
class RunReport(ABC, Generic[S, V]):
    """A scored and judged run: its folder, its score, and each verdict by SPEC."""

    path: Path
    score: S
    verdicts: Mapping[str, V]
    subject: ClassVar[str] = "model"

    @speaks_of_arguments
    def __getitem__(self, model: str) -> V:
        """Return the verdict on a model; raises SpecError that lists the models of the run."""
        if model not in self.verdicts:
            raise SpecError(
                f"{self.path} holds no {self.subject} '{model}'; it holds {', '.join(self.verdicts) or 'none'}"
            )
        return self.verdicts[model]

    def __iter__(self) -> Iterator[str]:
        return iter(self.verdicts)

    def __len__(self) -> int:
        return len(self.verdicts)

    def __repr__(self) -> str:
        labels = ", ".join(f"{spec}: {verdict.headline}" for spec, verdict in self.verdicts.items())
        return f"<{type(self).__name__} on {self.path}: {labels or f'no {self.subject}'}>"

    def __str__(self) -> str:
        return "\n\n".join([*filter(None, [self._said()]), f"Scope: {self._scope()}"])

    def _repr_html_(self) -> str:
        cards = "".join(verdict._repr_html_() for verdict in self.verdicts.values())
        return f"<div><p><strong>{escape(str(self.path))}</strong>. {escape(self._scope())}</p>{cards}</div>"

    def _said(self) -> str:
        """Return the verdicts in words."""
        return "\n\n".join(map(str, self.verdicts.values()))

    @abstractmethod
    def _scope(self) -> str:
        """Return the sentence that limits the verdicts' scope."""


def row_of(who: str, spec: str, name: str, one: Statistic, **further: float | None) -> dict[str, object]:
    """Return a statistic as plain values; ``who`` names the first column."""
    low, high = one.ci or (None, None)
    found = {who: spec, "statistic": name, "value": one.value, "low": low, "high": high, "n": one.n, "p": one.p}
    return {**found, **further, "note": one.note}


def written_page(made: "Callable[[], Page]", out: Path | str) -> Path:
    """Write a page and return its path; raises OutputError first if it may not be written."""
    from eyechart.destination import require_free  # noqa: PLC0415 - a score needs no templates
    from eyechart.report.page import write_page  # noqa: PLC0415 - as above

    require_free(Path(out), "report")
    write_page(made(), Path(out))
    return Path(out)
