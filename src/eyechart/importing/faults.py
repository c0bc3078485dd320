"""All that is wrong with a source, said at once and not one fault a round."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from eyechart.errors import BankError, SourceError, SpecError, printable

MOST_SHOWN = 40
"""So many faults are said, the others counted."""


class Faults:
    """Takes note of faults while a source is read on, and raises them together."""

    def __init__(self) -> None:
        self._lines: list[str] = []
        self._count = 0

    def __bool__(self) -> bool:
        return self._count > 0

    def add(self, words: str) -> None:
        """Take note of a fault; it is kept as one line."""
        self._count += 1
        if len(self._lines) < MOST_SHOWN:
            self._lines.append(printable(words))

    def take(self, lines: Iterable[str]) -> None:
        """Take note of several faults."""
        for words in lines:
            self.add(words)

    @property
    def lines(self) -> tuple[str, ...]:
        """Return the faults that are said."""
        return tuple(self._lines)

    def join(self, other: "Faults") -> None:
        """Take note of the faults that another took note of."""
        self._count += other._count  # noqa: SLF001 - of its own kind
        self._lines += other._lines[: MOST_SHOWN - len(self._lines)]  # noqa: SLF001

    @contextmanager
    def noted(self) -> Iterator[None]:
        """Take note of a fault that is raised inside, which ends there."""
        try:
            yield
        except (SourceError, BankError, SpecError) as error:
            self.add(str(error))

    def require_none(self, what: str) -> None:
        """Raise SourceError where there was a fault: a line each, and above several how many ``what`` has."""
        if self._count > 1:
            more = self._count - len(self._lines)
            above = f"{what} has {self._count} faults, and nothing was written:"
            raise SourceError("\n".join([above, *self._lines, *([f"and {more} more"] if more else [])]))
        if self._count:
            raise SourceError(self._lines[0])
