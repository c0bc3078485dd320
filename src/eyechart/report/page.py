"""A page is one self-contained HTML file that makes no request; its templates escape every value."""

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
from eyechart.verdicts.labels import GLYPHS

_ESCAPES = {ord(sign): f"\\u{ord(sign):04x}" for sign in "<>&\u2028\u2029"}

T = TypeVar("T")


@dataclass(frozen=True)
class Page:
    """A report as HTML, with its figures by section, and in ``notes`` what is not in it or was made smaller."""

    html: bytes
    drawings: Mapping[str, Sequence[Drawing]]
    notes: tuple[str, ...] = ()


SIGNS = {"brake": "■", "proceed": "▲", "other": "●"}
"""What stands before an action of each role; its colour says nothing: red and green are for wrong and right alone."""
MOST_SAID = 6
"""So many verdicts stand at the head of a page; it says how many more there are."""
_MOST_NAMED = 4


@dataclass(frozen=True)
class Said:
    """What a page says first of somebody: the verdict in a word, what it means, and why it is no stronger one.

    ``tone`` is one of ``GLYPHS``, ``answer`` what it comes to where the tone does not say it; ``place`` the id in the
    page where the rest stands; ``beware`` what must not be overlooked beside the word.
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
        """Return the answer, or the tone where that says it."""
        return self.answer or self.tone


@dataclass(frozen=True)
class Shot:
    """A picture of an example: what it shows, the picture as a data URI or why there is none, and an answer a model.

    An answer is its role (brake, proceed, other, none; good or bad where it is right or wrong), its word, and how
    usual it is.
    """

    shows: str
    uri: str
    absent: str
    answers: Sequence[tuple[str, str, str]]


@dataclass(frozen=True)
class Grid:
    """A picture of verdicts: a row a name under ``columns``, a cell its tone, what stands in it, and what it means.

    A cell that is None was not asked. ``of`` says what the rows are.
    """

    of: str
    columns: Sequence[str]
    rows: Sequence[tuple[str, Sequence[tuple[str, str, str] | None]]]


@dataclass(frozen=True)
class Opening:
    """What somebody with ten seconds reads: one sentence, a verdict each, and one picture of it.

    The picture is an example, whose ``shots`` each hold an answer of every one of ``models``, a grid, or a figure.
    """

    sentence: str
    said: Sequence[Said] = ()
    models: Sequence[str] = ()
    shots: Sequence[Shot] = ()
    grid: Grid | None = None
    figure: Drawing | None = None
    caption: str = ""

    @property
    def first(self) -> Sequence[Said]:
        """Return as many verdicts as stand at the head of a page."""
        return self.said[:MOST_SAID]

    @property
    def more(self) -> int:
        """Return how many verdicts do not."""
        return len(self.said) - len(self.first)


def parted(said: Sequence[Said], answers: Mapping[str, Sequence[str]], what: str) -> str:
    """Return in one sentence of how many of ``what`` each answer holds, by name where they are few; of one its own.

    ``answers`` are by what the verdicts come to, in the order in which they are told; behind one may stand the
    preposition that a count needs: ``("yes", "for")``.
    """
    if len(said) == 1:
        return f"{said[0].who}: {answers[said[0].comes_to][0]}."
    many = {answer: [one.who for one in said if answers[one.comes_to] == answer] for answer in answers.values()}
    told = [
        f"{' '.join(answer)} {len(names)}" + (f" ({', '.join(names)})" if len(said) <= _MOST_NAMED else "")
        for answer, names in many.items()
        if names
    ]
    return f"Of {len(said)} {what}: {'; '.join(told)}."


@dataclass(frozen=True)
class Section:
    """A part of a page: an introduction, figures, tables, and lines of words; ``folded`` tables are closed at first."""

    title: str
    intro: str = ""
    drawings: Sequence[Drawing] = ()
    tables: Sequence[Table] = ()
    lines: Sequence[str] = ()
    folded: bool = False


def page_of(
    question: str, title: str, sections: Sequence[Section], notes: Sequence[str] = (), answer: Opening | None = None
) -> Page:
    """Return a page that is a list of sections under the question that it answers, with its answer."""
    html = fill(
        "sections.html",
        question=question,
        title=title,
        sections=sections,
        notes=notes,
        answer=answer,
    )
    return Page(html, {one.title: one.drawings for one in sections}, tuple(notes))


def write_page(page: Page, out: Path) -> None:
    """Write a page; a reader never sees half of it. Raises OutputError where it may not be written there."""
    with whole(out, "report") as partial:
        partial.write_bytes(page.html)


def write_figures(drawn: Mapping[str, Sequence[Drawing]], folder: Path) -> list[Path]:
    """Write every figure as SVG and PDF; return the files. Raises OutputError as `write_files` does."""
    files = {}
    for drawing in (one for section in drawn.values() for one in section):
        files[f"{drawing.name}.svg"] = drawing.svg().encode("utf-8", "backslashreplace")
        files[f"{drawing.name}.pdf"] = drawing.pdf()
    return write_files(files, folder)


def evenly(every: Sequence[T], count: int) -> list[T]:
    """Return so many of a sequence, evenly taken; all of it where there are no more."""
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
    """Return a page: the style of all pages and its own, its scripts as one, and ``data`` for them as JSON.

    ``packed`` is more data, made by ``pack``, which scripts unpack when it is looked at.
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
    """Return the environment that fills a template; it compiles each template once."""
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
    """Return the Content-Security-Policy: pictures from data, this one script or none, and nothing from anywhere."""
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    runs = f"script-src 'sha256-{digest}'; " if script else ""
    return f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; {runs}base-uri 'none'; form-action 'none'"


def pack(values: object) -> str:
    """Return values as JSON that is deflated, in base64: a fifth of its length where replies are words."""
    return base64.b64encode(zlib.compress(str(embedded_json(values)).encode("utf-8", "backslashreplace"))).decode()


def unpack(packed: str, most: int) -> str:
    """Return the JSON of packed values; raises ValueError where it is damaged, or has more than ``most`` bytes."""
    opened = zlib.decompressobj()
    try:
        text = opened.decompress(base64.b64decode(packed, validate=True), most)
    except zlib.error as error:
        raise ValueError(str(error)) from error
    if not opened.eof or opened.unused_data:
        raise ValueError("packed data that is cut or too long")
    return text.decode()


def embedded_json(values: object) -> Markup:
    """Return JSON that can stand inside a script element: no sign in it can end the element or a line."""
    text = json.dumps(values, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    return Markup(text.translate(_ESCAPES))  # noqa: S704 - what could be markup was escaped just now
