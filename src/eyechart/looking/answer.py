"""The answer of a look: one screen of 80 columns, or the same as plain values."""

import shlex
import textwrap
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from eyechart.records import Written

COLUMNS = 80
EXIT_CODES = {"Yes": 0, "In part": 1, "No": 1, "Inconclusive": 2}


@dataclass(frozen=True, slots=True)
class Pictured:
    """One picture in words, and what came of it: how often each answer was given, or how much a motion changed."""

    shows: str
    answers: dict[str, int] | None = None
    change: float | None = None
    ci: tuple[float, float] | None = None
    n: int = 0

    @property
    def words(self) -> str:
        """Return what came of it."""
        if self.answers is not None:
            counted = ", ".join(f"{name} {count}" for name, count in self.answers.items())
            return f"{counted} of {self.n} asked" if counted else "not asked"
        if self.change is None:
            return "not asked"
        low, high = (min(one, 1.0) for one in self.ci or (0.0, 0.0))
        between = f" [{low:.0%}, {high:.0%}]" if low < high else ""
        return f"changes {min(self.change, 1.0):.0%} of its motion{between}"


@dataclass(frozen=True, slots=True)
class Step:
    """What may be done next: why, and the command."""

    why: str
    command: str


@dataclass(frozen=True)
class Look(Written):
    """Whether a model or a policy looks, why, where it does not, and what was made.

    ``answer`` is Yes, In part, No or Inconclusive, ``because`` the sentence that goes with it, ``holes`` are the places
    of which it does not hold. ``pictures`` are three in words, out of ``among``. ``ended`` says where it was asked no
    more, because it was settled. ``report`` and ``run`` are None where nothing was asked.
    """

    written = "answer because holes next=commands report=page run=folder model=spec label pictures among ended calls"

    spec: str
    answer: str
    because: str
    holes: tuple[str, ...] = ()
    label: str = ""
    pictures: tuple[Pictured, ...] = ()
    among: str = ""
    next: tuple[Step, ...] = ()
    report: Path | None = None
    run: Path | None = None
    calls: int = 0
    ended: str = ""

    @property
    def commands(self) -> list[str]:
        """Return what may be done next, as commands."""
        return [one.command for one in self.next]

    @property
    def page(self) -> str | None:
        """Return where the page was written."""
        return None if self.report is None else str(self.report)

    @property
    def folder(self) -> str | None:
        """Return the folder of the run."""
        return None if self.run is None else str(self.run)

    def exit_code(self, *, accept_part: bool = False) -> int:
        """Return 0 for Yes, 1 for No and In part, 2 for Inconclusive; 0 for In part too where that is accepted."""
        return 0 if accept_part and self.answer == "In part" else EXIT_CODES[self.answer]

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def markdown(self) -> str:
        """Return two tables, as the page of a job shows them: the answer, and what came of the three pictures."""
        said = " ".join([self.because, *self.holes])
        rows: list[tuple[str, ...]] = [
            ("looks?", "who", "because"),
            ("---",) * 3,
            (f"**{self.answer}**", f"`{self.spec}`", said),
        ]
        if self.pictures:
            rows += [(), (f"picture, {self.among}", "answers"), ("---",) * 2]
            rows += [(one.shows, one.words) for one in self.pictures]
        return "".join(f"| {' | '.join(cell.replace('|', '/') for cell in row)} |\n" if row else "\n" for row in rows)

    def lines(self, shown: Callable[[str], str] = str) -> Iterator[str]:
        """Yield the screen, a line of at most 80 columns each; ``shown`` returns a text as it is to be read."""
        yield from _wrapped(shown(f"{self.answer}. {self.because}"))
        yield from (line for hole in self.holes for line in _wrapped(shown(hole), "  "))
        if self.pictures:
            yield ""
            yield from _wrapped(f"What it answers to three pictures, {self.among}:")
        wide = max((len(one.shows) for one in self.pictures), default=0)
        for one in self.pictures:
            yield from _wrapped(one.words, f"  {one.shows:<{wide}}  ", " " * (wide + 4))
        if self.ended:
            yield from ["", *_wrapped(self.ended)]
        yield from ["", "Next"] if self.next else []
        for step in self.next:
            yield from _wrapped(f"{shown(step.why)}:", "  ")
            yield from pasted(shown(step.command))
        if self.report is not None:
            yield ""
            yield from _wrapped(shown(f"The page: {self.report}"))


def _wrapped(text: str, first: str = "", later: str | None = None) -> Sequence[str]:
    then = first if later is None else later
    return textwrap.wrap(
        text, COLUMNS, initial_indent=first, subsequent_indent=then, break_on_hyphens=False, break_long_words=True
    ) or [first]


def pasted(command: str) -> Iterator[str]:
    """Yield a command that can be pasted, on lines of at most 80 columns as far as its words allow."""
    line = "    "
    for word in map(shlex.quote, shlex.split(command)):
        if line.strip() and len(line) + len(word) + 2 > COLUMNS:
            yield f"{line}\\"
            line = "      "
        line += f"{word} "
    yield line.rstrip()
