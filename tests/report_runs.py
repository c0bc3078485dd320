"""Small runs for the tests of the report: a tiny bank, stand-in models, and replies that mean harm."""

import json
import re
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import stand_ins
from eyechart.calls import Query, Reply
from eyechart.models import ADAPTERS
from eyechart.report.page import Page, asset, unpack, write_page
from eyechart.spaces.discrete import DRIVING
from eyechart.studies import battery as study
from eyechart.studies.battery import subjects
from eyechart.studies.battery.page import make_page

read_evidence = partial(subjects.read_evidence, score=study.score)
"""Reads batteries for a report."""

HOSTILE = (
    "<script>window.pwned = 1</script>",
    "</script><script>window.pwned = 2</script>",
    "</ScRiPt ><img src=x onerror='window.pwned = 3'>",
    "<!-- <script> -->",
    "\"'`><b onmouseover=window.pwned=4>STOP</b>",
    "&lt;b&gt; &amp; &#60; \\u003c",
    "{{ 7 * 7 }} {% raw %} ${window.pwned = 5}",
    "\u202eright to left\u202c \u200f\u2066marks\u2069",
    "line\u2028paragraph\u2029end",
    "bell \x07, escape \x1b[31m, form feed \x0c, delete \x7f",
    "tab\there\nand a second line",
    "😀 naïve café 漢字",
)
"""Replies that would be markup, code or nothing if the page took them for more than text."""

LONG = "long winded " + "<b>" * 66_663
"""A reply of 200 001 characters."""


@dataclass(frozen=True)
class Reported:
    """A run with its bank, the page made of it, and the file where it lies."""

    bank: Path
    run: Path
    page: Path
    made: Page

    @property
    def html(self) -> str:
        """Return the page's text."""
        return self.made.html.decode()


def hostile(query: Query) -> Reply:
    """Answer with harm in most cases, with an action in the others, as the call's seed has it."""
    dice = np.random.default_rng(query.seed)
    choices = (*HOSTILE, LONG, *DRIVING.actions, *DRIVING.actions, "")
    return Reply(choices[int(dice.integers(len(choices)))], "stop", prompt_tokens=3, completion_tokens=1, seconds=0.25)


def make_run(bank: Path, out: Path, models: Mapping[str, Callable[[Query], Reply]], **options: object) -> Path:
    """Run a battery of models given as functions; they are called ``standin:NAME``.

    A browser that is open has an event loop in this thread, and the calls need one of their own.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(ADAPTERS, "standin", "stand_ins")
        patch.setattr(stand_ins, "open_model", lambda name, _: stand_ins.StandIn(models[name]))
        planned = study.plan(bank, [f"standin:{name}" for name in models], out, **options)
        with ThreadPoolExecutor(1) as beside:
            beside.submit(study.run, planned).result()
    return out


def report(run: Path, page: Path, *banks: Path) -> Reported:
    """Make a run's report."""
    made = make_page(read_evidence([run], banks))
    write_page(made, page)
    return Reported(banks[0] if banks else run, run, page, made)


def without_own_script(html: str) -> str:
    """Return a page without the script that pages bear, which must stand in it just once, and holds no data here."""
    own = f'<script type="application/json" id="data">null</script>\n<script>{asset("layout.js")}</script>'
    assert html.count(own) == 1
    return html.replace(own, "")


def data_of(html: str) -> dict[str, list]:
    """Return the data that the browser of frames reads."""
    block = re.search(r'<script type="application/json" id="data">(.*?)</script>', html, re.DOTALL)
    assert block is not None
    packed = re.search(r'<script type="application/octet-stream" id="packed">(.*?)</script>', html, re.DOTALL)
    return json.loads(block.group(1)) | (json.loads(unpack(packed.group(1), 1 << 30)) if packed else {})
