"""The templates of the pages and how they are filled: every value is escaped, and an unknown name is an error."""

import base64
import hashlib
import json
from collections.abc import Sequence
from functools import cache
from importlib.resources import files

import jinja2
from markupsafe import Markup

from eyechart import __version__
from eyechart.report.drawing import Drawing
from eyechart.report.sheets import shown

_ESCAPES = {ord(sign): f"\\u{ord(sign):04x}" for sign in "<>&\u2028\u2029"}


def fill(
    template: str, *, styles: Sequence[str] = (), scripts: Sequence[str] = (), data: object = None, **values: object
) -> bytes:
    """Return a page: the style of all pages and its own, its scripts as one, and ``data`` for them as JSON."""
    script = "".join(map(asset, scripts))
    html = (
        environment()
        .get_template(template)
        .render(
            csp=policy(script),
            css=Markup("".join(map(asset, ("page.css", *styles)))),  # noqa: S704 - our own files
            script=Markup(script),  # noqa: S704 - our own files
            data=embedded_json(data),
            version=__version__,
            **values,
        )
    )
    return html.encode("utf-8", "backslashreplace")


@cache
def environment() -> jinja2.Environment:
    """Return the environment that fills a template; it compiles each template once."""
    loader = jinja2.FunctionLoader(asset)
    made = jinja2.Environment(
        loader=loader, autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    made.filters["shown"] = shown
    made.filters["inline"] = _inline
    return made


def _inline(drawing: Drawing) -> Markup:
    return Markup(drawing.svg(inline=True))  # noqa: S704 - drawn here; every word in it was escaped


def asset(name: str) -> str:
    """Return the text of a template, a style sheet or a script."""
    return (files("eyechart.report") / "template" / name).read_text(encoding="utf-8")


def policy(script: str) -> str:
    """Return the Content-Security-Policy: pictures from data, this one script or none, and nothing from anywhere."""
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    runs = f"script-src 'sha256-{digest}'; " if script else ""
    return f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; {runs}base-uri 'none'; form-action 'none'"


def embedded_json(values: object) -> Markup:
    """Return JSON that can stand inside a script element: no sign in it can end the element or a line."""
    text = json.dumps(values, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    return Markup(text.translate(_ESCAPES))  # noqa: S704 - what could be markup was escaped just now
