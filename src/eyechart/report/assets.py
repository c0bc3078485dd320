"""The templates of the pages and how they are filled: every value is escaped, and an unknown name is an error."""

import base64
import hashlib
from functools import cache
from importlib.resources import files

import jinja2

from eyechart.report.sheets import shown


@cache
def environment() -> jinja2.Environment:
    """Return the environment that fills a template; it compiles each template once."""
    loader = jinja2.FunctionLoader(asset)
    made = jinja2.Environment(
        loader=loader, autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    made.filters["shown"] = shown
    return made


def asset(name: str) -> str:
    """Return the text of a template, a style sheet or a script."""
    return (files("eyechart.report") / "template" / name).read_text(encoding="utf-8")


def policy(script: str) -> str:
    """Return the Content-Security-Policy: pictures from data, this one script, and nothing from anywhere."""
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return (
        f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'sha256-{digest}'; "
        "base-uri 'none'; form-action 'none'"
    )
