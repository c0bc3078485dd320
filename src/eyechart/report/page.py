"""Pages: self-contained HTML files without requests, from templates that escape every value."""

import base64
import hashlib
import json
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import TypeVar

import jinja2
from markupsafe import Markup

from eyechart import __version__
from eyechart.destination import whole, write_files
from eyechart.report.charts import Drawing
from eyechart.report.table import Table, coded
from eyechart.verdicts.labels import GLYPHS, LABELS

_ESCAPES = {ord(sign): f"\\u{ord(sign):04x}" for sign in "<>&\u2028\u2029"}

T = TypeVar("T")


@dataclass(frozen=True)
class Page:
    """A report as HTML, with its figures by section, and ``notes`` on what it lacks."""

    html: bytes
    drawings: Mapping[str, Sequence[Drawing]]
    notes: tuple[str, ...] = ()


SIGNS = {"brake": "■", "proceed": "▲", "other": "●"}
"""The sign of each role of action; no colour, because red and green are for wrong and right."""
MOST_SAID = 6
"""The most verdicts at the head of a page; it gives the number of the others."""
_MOST_NAMED = 4


@dataclass(frozen=True)
class VerdictSummary:
    """The first lines about a model or policy: label, meaning, and why no stronger label.

    ``tone`` is one of ``GLYPHS``. ``answer`` is the outcome if the tone does not show it. ``place``
    is the id of the rest in the page, and ``beware`` a warning beside the label.
    """

    who: str
    label: str
    tone: str
    words: str = ""
    why_not: str = ""
    place: str = ""
    beware: str = ""
    answer: str = ""

    @property
    def comes_to(self) -> str:
        """Return the answer, or else the tone."""
        return self.answer or self.tone

    @property
    def glyph(self) -> str:
        """Return the sign of the label, the same as in the rest of a page; of others that of the tone."""
        label = LABELS.get(self.label.replace(" ", "_"))
        return GLYPHS[self.tone] if label is None or label.family != self.tone else label.glyph


@dataclass(frozen=True)
class ExamplePicture:
    """A picture of an example: its caption, a data URI or why it is absent, and the answers.

    Each model's answer is its role (brake, proceed, other, none; good or bad if right or wrong),
    its word, and its frequency.
    """

    shows: str
    uri: str
    absent: str
    answers: Sequence[tuple[str, str, str]]


@dataclass(frozen=True)
class Grid:
    """A grid of verdicts: a row per name under ``columns``; a cell is tone, text and meaning.

    A cell of None was not tested. ``of`` says what the rows are.
    """

    of: str
    columns: Sequence[str]
    rows: Sequence[tuple[str, Sequence[tuple[str, str, str] | None]]]


@dataclass(frozen=True)
class PageSummary:
    """The head of a page, readable in ten seconds: a sentence, the verdicts, and one picture.

    The picture is an example with ``shots`` that each hold an answer of every model, or a grid, or
    a figure.
    """

    sentence: str
    said: Sequence[VerdictSummary] = ()
    models: Sequence[str] = ()
    shots: Sequence[ExamplePicture] = ()
    grid: Grid | None = None
    figure: Drawing | None = None
    caption: str = ""

    @property
    def first(self) -> Sequence[VerdictSummary]:
        """Return the verdicts at the head of a page."""
        return self.said[:MOST_SAID]

    @property
    def more(self) -> int:
        """Return the number of the other verdicts."""
        return len(self.said) - len(self.first)


def parted(said: Sequence[VerdictSummary], answers: Mapping[str, Sequence[str]], what: str) -> str:
    """Return in one sentence how many of ``what`` have each answer, by name if they are few.

    ``answers`` are by outcome, in the order of the sentence. A second word is the preposition for a
    count: ``("yes", "for")``. For a single verdict it is that verdict's answer.
    """
    if len(said) == 1:
        return f"{said[0].who}: {answers[said[0].comes_to][0]}."
    many = {
        answer: [summary.who for summary in said if answers[summary.comes_to] == answer] for answer in answers.values()
    }
    parts = [
        f"{' '.join(answer)} {len(names)}" + (f" ({', '.join(names)})" if len(said) <= _MOST_NAMED else "")
        for answer, names in many.items()
        if names
    ]
    return f"Of {len(said)} {what}: {'; '.join(parts)}."


@dataclass(frozen=True)
class Section:
    """A part of a page, with figures, tables and lines; ``folded`` tables start closed."""

    title: str
    intro: str = ""
    drawings: Sequence[Drawing] = ()
    tables: Sequence[Table] = ()
    lines: Sequence[str] = ()
    folded: bool = False


def page_of(
    question: str, title: str, sections: Sequence[Section], notes: Sequence[str] = (), answer: PageSummary | None = None
) -> Page:
    """Return a page: the question, its answer, and a list of sections."""
    html = fill(
        "sections.html",
        question=question,
        title=title,
        sections=sections,
        notes=notes,
        answer=answer,
    )
    return Page(html, {section.title: section.drawings for section in sections}, tuple(notes))


def write_page(page: Page, out: Path) -> None:
    """Write a page atomically; raises OutputError if it may not be written there."""
    with whole(out, "report") as partial:
        partial.write_bytes(page.html)


def write_figures(drawn: Mapping[str, Sequence[Drawing]], folder: Path) -> list[Path]:
    """Write every figure as SVG and PDF; raises OutputError as `write_files` does."""
    files = {}
    for drawing in (one for section in drawn.values() for one in section):
        files[f"{drawing.name}.svg"] = drawing.svg().encode("utf-8", "backslashreplace")
        files[f"{drawing.name}.pdf"] = drawing.pdf()
    return write_files(files, folder)


def evenly(every: Sequence[T], count: int) -> list[T]:
    """Return ``count`` items of a sequence, evenly spaced; all if there are no more."""
    return [every[turn * len(every) // count] for turn in range(count)] if count < len(every) else list(every)


def fill(
    template: str,
    *,
    styles: Sequence[str] = (),
    scripts: Sequence[str] = ("layout.js",),
    data: object = None,
    packed: str = "",
    **values: object,
) -> bytes:
    """Return a page with the common style and its own, its scripts, and ``data`` as JSON.

    ``packed`` is more data from ``pack``, which scripts unpack when it is needed.
    """
    script = "".join(map(asset, scripts))
    html = (
        environment()
        .get_template(template)
        .render(
            csp=policy(script),
            css=Markup("".join(map(asset, ("page.css", *styles)))),  # noqa: S704 - our own files
            script=Markup(script),  # noqa: S704 - our own files
            data=embedded_json(data),
            packed=packed,
            version=__version__,
            glyphs=GLYPHS,
            acts=SIGNS,
            contents=[],
            **values,
        )
    )
    return html.encode("utf-8", "backslashreplace")


@cache
def environment() -> jinja2.Environment:
    """Return the environment that fills templates; it compiles each template once."""
    made = jinja2.Environment(
        loader=jinja2.FunctionLoader(asset),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        extensions=["jinja2.ext.do"],
    )
    made.filters["coded"] = coded
    made.filters["inline"] = lambda one: Markup(one.svg(inline=True))  # noqa: S704 - drawn here, every word escaped
    return made


def asset(name: str) -> str:
    """Return the text of a template, a style sheet or a script."""
    return (files("eyechart.report") / "template" / name).read_text(encoding="utf-8")


def policy(script: str) -> str:
    """Return the Content-Security-Policy: only data pictures and this script, no requests."""
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    runs = f"script-src 'sha256-{digest}'; " if script else ""
    return f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; {runs}base-uri 'none'; form-action 'none'"


def pack(values: object) -> str:
    """Return values as deflated JSON in base64, a fifth as long for replies in words."""
    return base64.b64encode(zlib.compress(str(embedded_json(values)).encode("utf-8", "backslashreplace"))).decode()


def unpack(packed: str, most: int) -> str:
    """Return the JSON of packed values; raises ValueError if damaged or above ``most`` bytes."""
    opened = zlib.decompressobj()
    try:
        text = opened.decompress(base64.b64decode(packed, validate=True), most)
    except zlib.error as error:
        raise ValueError(str(error)) from error
    if not opened.eof or opened.unused_data:
        raise ValueError("packed data is cut off or too long")
    return text.decode()


def embedded_json(values: object) -> Markup:
    """Return JSON for a script element; no character in it can end the element or a line."""
    text = json.dumps(values, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    return Markup(text.translate(_ESCAPES))  # noqa: S704 - what could be markup was escaped just now
