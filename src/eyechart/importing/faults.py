"""A collection of all faults of a source, which are reported together."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from eyechart.errors import BankError, SourceError, SpecError, printable

MOST_SHOWN = 40
"""The number of faults that are shown; the others are counted."""


class Faults:
    """Collects faults while a source is read on, and raises them together."""

    def __init__(self, lines: Iterable[str] = ()) -> None:
        self._lines: list[str] = []
        self._count = 0
        self.take(lines)

    def __bool__(self) -> bool:
        return self._count > 0

    def add(self, words: str) -> None:
        """Add a fault as one line."""
        self._count += 1
        if len(self._lines) < MOST_SHOWN:
            self._lines.append(printable(words))

    def take(self, lines: Iterable[str]) -> None:
        """Add several faults."""
        for words in lines:
            self.add(words)

    @property
    def lines(self) -> tuple[str, ...]:
        """Return the faults that are shown."""
        return tuple(self._lines)

    def join(self, other: "Faults") -> None:
        """Add the faults of another collection."""
        self._count += other._count  # noqa: SLF001 - of its own kind
        self._lines += other._lines[: MOST_SHOWN - len(self._lines)]  # noqa: SLF001

    @contextmanager
    def noted(self) -> Iterator[None]:
        """Add a fault that is raised in the context, and end the context there."""
        try:
            yield
        except (SourceError, BankError, SpecError) as error:
            self.add(str(error))

    def require_none(self, what: str) -> None:
        """Raise SourceError if there was a fault: one line each, below a line with their number."""
        if self._count > 1:
            more = self._count - len(self._lines)
            above = f"{what} has {self._count} faults, and nothing was written:"
            raise SourceError("\n".join([above, *self._lines, *([f"and {more} more"] if more else [])]))
        if self._count:
            raise SourceError(self._lines[0])
