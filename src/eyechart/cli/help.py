"""The help of the command line: commands by purpose, and examples that can be copied whole."""

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, ClassVar

from typer.core import TyperCommand, TyperGroup

from eyechart.cli.terminal import resumable

EXAMPLE = re.compile(r"(.*?) ?(?:(Example[^:]*): (eyechart .*?)\.?(?:(?<=\.) ([A-Z].*))?)?")
"""A paragraph: its text, its example's name, the example, and the text after it."""

_NOTHING = "nothing more is done"
_SENTENCE = 200
"""A list shows a command's first sentence, up to this many characters."""

GROUPS = {
    "Begin": ("look", "demo", "doctor", "probe", "list"),
    "Frames": ("frames", "plan"),
    "Ask": ("run", "merge", "costs"),
    "Judge": ("verdict", "score", "report", "gate", "compare", "transfer", "calibrate"),
    "Drive": ("ladder", "audit", "film"),
    "Guard": ("guardian", "serve"),
    "Publish": ("bundle", "paper", "validate"),
}
"""The commands by purpose, in the order of the list."""


class Command(TyperCommand):
    """A command; each example has its own line, so that it can be copied."""

    def format_help_text(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401 - they differ between versions of typer
        """Write the command's description."""
        del ctx
        _write(self.help, formatter)

    def format_epilog(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401
        """Write the text below the options."""
        del ctx
        _write(self.epilog, formatter)


class CommandGroup(TyperGroup):
    """A group of commands; the list shows each one's whole first sentence."""

    listed: ClassVar[Mapping[str, Sequence[str]]] = {}
    """The names of the commands under their headings, if there are several headings."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401
        """List the commands."""
        for title, names in (self.listed or {"Commands": self.list_commands(ctx)}).items():
            found = {name: self.get_command(ctx, name) for name in names}
            rows = [(name, one.get_short_help_str(_SENTENCE)) for name, one in found.items() if one is not None]
            with formatter.section(title):
                formatter.write_dl(rows)


class Commands(CommandGroup):
    """All commands; an interrupt outside a command prints one line and exits 130."""

    listed: ClassVar = GROUPS

    def make_context(self, *given: Any, **more: Any) -> Any:  # noqa: ANN401
        """Parse the command line."""
        with resumable(_NOTHING):
            return super().make_context(*given, **more)

    def invoke(self, ctx: Any) -> object:  # noqa: ANN401
        """Run a command."""
        with resumable(_NOTHING):
            return super().invoke(ctx)


def paragraphs(said: str | None) -> Iterator[tuple[str, str]]:
    """Yield a help text's paragraphs as (name, text); only an example has a name."""
    for part in (said or "").split("\n\n"):
        match = EXAMPLE.fullmatch(" ".join(part.split()))
        assert match is not None
        words, name, example, after = match.groups()
        yield from [("", words)] if words else []
        yield from [(name, example)] if example else []
        yield from [("", after)] if after else []


def _write(said: str | None, formatter: Any) -> None:  # noqa: ANN401
    for name, words in paragraphs(said):
        formatter.write_paragraph()
        with formatter.indentation():
            if not name:
                formatter.write_text(words)
                continue
            formatter.write_text(f"{name}:")
            formatter.write(f"    {words}\n")
