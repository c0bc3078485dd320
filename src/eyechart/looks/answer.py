"""The answer of a look: one screen of 80 columns, or plain values."""

import ast
import shlex
import textwrap
import unicodedata
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from eyechart.records import to_json_fields

COLUMNS = 80
PYTHON = "eyechart.look("
"""How the command of a function begins that no command line can reach."""
EXIT_CODES = {"Yes": 0, "In part": 1, "No": 1, "Inconclusive": 2}


@dataclass(frozen=True, slots=True)
class PictureResult:
    """One picture in words, with the counts of its answers, or the change of a motion.

    ``why`` says why there is neither.
    """

    shows: str
    answers: dict[str, int] | None = None
    change: float | None = None
    ci: tuple[float, float] | None = None
    n: int = 0
    why: str = "not asked"

    @property
    def words(self) -> str:
        """Return the result in words."""
        if self.answers is not None:
            counted = ", ".join(f"{name} {count}" for name, count in self.answers.items())
            return f"{counted} of {self.n} answers" if counted else self.why
        if self.change is None:
            return self.why
        change, low, high = (min(max(one, 0.0), 1.0) for one in (self.change, *(self.ci or (0.0, 0.0))))
        between = f" [{low:.0%}, {high:.0%}]" if low < high else ""
        return f"changes {change:.0%} of its motion{between}"


@dataclass(frozen=True, slots=True)
class NextStep:
    """A possible next step: a reason and a command."""

    why: str
    command: str


@dataclass(frozen=True)
class Look:
    """Whether a model or a policy looks, why, and the files that the look made.

    ``answer`` is Yes, In part, No or Inconclusive; ``because`` is its sentence. ``holes`` are the
    places where it does not hold. ``pictures`` are three in words, out of ``among``. ``ended`` says
    why the calls stopped early, if they did. ``report`` and ``run`` are None if there were no
    calls.
    """

    spec: str
    answer: str
    because: str
    holes: tuple[str, ...] = ()
    label: str = ""
    pictures: tuple[PictureResult, ...] = ()
    among: str = ""
    next: tuple[NextStep, ...] = ()
    report: Path | None = None
    run: Path | None = None
    calls: int = 0
    ended: str = ""

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        names = "answer because holes label pictures among ended calls"
        files = {"report": self.report and str(self.report), "run": self.run and str(self.run)}
        return to_json_fields(self, names, next=[step.command for step in self.next], model=self.spec, **files)

    def exit_code(self, *, accept_part: bool = False) -> int:
        """Return 0 for Yes, 1 for No and In part (0 if accepted), 2 for Inconclusive."""
        return 0 if accept_part and self.answer == "In part" else EXIT_CODES[self.answer]

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def markdown(self) -> str:
        """Return two Markdown tables: the answer, and the results of the three pictures."""
        said = " ".join([self.because, *self.holes])
        rows: list[tuple[str, ...]] = [
            ("looks?", "model", "because"),
            ("---",) * 3,
            (f"**{self.answer}**", f"`{self.spec}`", said),
        ]
        if self.pictures:
            rows += [(), (f"picture, {self.among}", "answers"), ("---",) * 2]
            rows += [(picture.shows, picture.words) for picture in self.pictures]
        cells = ([" ".join(cell.split()).replace("|", "/") for cell in row] for row in rows)
        return "".join(f"| {' | '.join(row)} |\n" if row else "\n" for row in cells)

    def lines(self, shown: Callable[[str], str] = str) -> Iterator[str]:
        """Yield the screen in lines of at most 80 columns; ``shown`` converts a text to display."""
        yield from _wrapped(shown(f"{self.answer}. {self.because}"))
        yield from (line for hole in self.holes for line in _wrapped(shown(hole), "  "))
        if self.pictures:
            yield ""
            yield from _wrapped(f"What it answers to three pictures, {self.among}:")
        wide = max((len(picture.shows) for picture in self.pictures), default=0)
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
    """Return a text in lines of at most 80 columns; a wide character, such as a Chinese one, takes two."""
    wide = "".join(f"{sign}{_SECOND}" if unicodedata.east_asian_width(sign) in "WF" else sign for sign in text)
    columns = COLUMNS - (_SECOND in wide)  # a line may end before a second column
    then = first if later is None else later
    lines = textwrap.wrap(
        wide, columns, initial_indent=first, subsequent_indent=then, break_on_hyphens=False, break_long_words=True
    )
    return [line.replace(_SECOND, "") for line in lines] or [first]


_SECOND = "\ue000"
"""Stands for the second column of a wide character while lines are counted: a private character of no font."""


def pasted(command: str) -> Iterator[str]:
    """Yield a command to paste, on lines of at most 80 columns if its words allow.

    Python code goes on inside its brackets, a line an argument.
    """
    if command.startswith(PYTHON):
        call = ast.parse(command, mode="eval").body
        arguments = [ast.unparse(one) for one in (*call.args, *call.keywords)] if isinstance(call, ast.Call) else []
        yield from (f"    {PYTHON}", *(f"        {one}," for one in arguments), "    )")
        return
    line = "    "
    for word in map(shlex.quote, shlex.split(command)):
        if line.strip() and len(line) + len(word) + 2 > COLUMNS:
            yield f"{line}\\"
            line = "      "
        line += f"{word} "
    yield line.rstrip()
