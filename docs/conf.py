"""How Sphinx builds the site: make docs."""

import re
import sys
from pathlib import Path

from sphinx.application import Sphinx

DOCS = Path(__file__).resolve().parent
sys.path.insert(0, str(DOCS))

import api_pages  # noqa: E402 - it stands beside this file

from eyechart import __version__  # noqa: E402

project = "eyechart"
author = "The eyechart authors"
version = release = __version__
html_title = "eyechart"
html_theme = "furo"
html_show_copyright = False
html_show_sphinx = False
html_copy_source = False
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_favicon = "_static/eye.svg"
html_theme_options = {"light_logo": "eye.svg", "dark_logo": "eye.svg", "navigation_with_keys": True}

extensions = ["myst_parser", "sphinx.ext.autodoc"]
exclude_patterns = ["_build"]
myst_heading_anchors = 3
default_role = "literal"  # docstrings write `names` in single backticks too
nitpicky = False
suppress_warnings = ["myst.header"]  # a page may begin with what README and GitHub need

autodoc_typehints = "signature"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_use_type_comments = False  # we have none, and each function's source would be parsed for them
add_module_names = False
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 88


_UPWARDS = re.compile(r"\[([^\]]+)\]\((\.\./[^)#\s]+)[^)\s]*\)")


def _decisions(_app: Sphinx, docname: str, source: list[str]) -> None:
    """Hang the decisions below their list, which stays plain Markdown for who reads it in the repository."""
    if docname == "decisions/README":
        source[0] += "\n```{toctree}\n:hidden:\n:glob:\n\n[!R]*\n```\n"


def _outside(_app: Sphinx, docname: str, source: list[str]) -> None:
    """Name the file of the repository where a link leads out of the docs: the site does not hold it."""

    def named(link: re.Match[str]) -> str:
        target = (DOCS / docname).parent.joinpath(link[2]).resolve()
        return link[0] if target.is_relative_to(DOCS) else f"{link[1]} (`{target.relative_to(DOCS.parent)}`)"

    source[0] = _UPWARDS.sub(named, source[0])


def setup(app: Sphinx) -> None:
    """Write the pages of the API, and hang up the decisions."""
    api_pages.write(DOCS / "api")
    app.connect("source-read", _decisions)
    app.connect("source-read", _outside)
