"""The index of a folder of runs in headless Chromium: its filters work, and axe-core is content."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from test_drives_browser import axe

import banks
import stand_ins
from eyechart.overview import make_index
from eyechart.report.page import write_page
from eyechart.studies import ReadOptions
from report_runs import hostile, make_run

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module", autouse=True)
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the index of three runs; made before the browser has a loop."""
    root = tmp_path_factory.mktemp("index")
    bank = banks.build_bank(root / "bank")
    for name in ("first", "second", "with-a-long-name-of-its-own-that-goes-on-and-on"):
        make_run(bank.root, root / "runs" / name, {"steady": stand_ins.stop, "hostile-" + "x" * 40: hostile})
    page = make_index(root / "runs", ReadOptions(independent=False, reread=False), lambda _: None).page
    write_page(page, root / "index.html")
    return root / "index.html"


@pytest.fixture(params=[1280, 800, 400], ids=lambda width: f"{width} px")
def window(request: pytest.FixtureRequest, engine: Any, made: Path) -> Iterator[Any]:  # noqa: ANN401 - playwright has no types here
    """Return the index in a window as wide as the parameter; nothing may be said in its console."""
    opened = engine.new_page(viewport={"width": request.param, "height": 900})
    said: list[str] = []
    opened.on("console", lambda message: said.append(message.text))
    opened.on("pageerror", lambda error: said.append(str(error)))
    opened.goto(made.as_uri())
    yield opened
    assert said == []
    opened.close()


def test_filters_choose_rows(window: Any) -> None:  # noqa: ANN401 - as above
    """By a word and by a model, together; cleared, all are there."""
    assert window.inner_text("#status") == "6 of 6 rows"
    window.select_option("#f-model", "standin:steady")
    assert window.inner_text("#status") == "3 of 6 rows"
    window.fill("#f-text", "second")
    assert window.inner_text("#status") == "1 of 6 rows"
    assert window.locator("table.runs tbody tr:visible").count() == 1
    window.click("#f-clear")
    assert window.inner_text("#status") == "6 of 6 rows"


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_no_serious_violation_and_nothing_is_cut(window: Any, scheme: str) -> None:  # noqa: ANN401 - as above
    """Light and dark, wide and narrow."""
    window.emulate_media(color_scheme=scheme)
    assert axe(window) == []
    assert window.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
