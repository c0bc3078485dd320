"""The page of a run that goes on, in headless Chromium: nothing is cut, it looks again by itself, and says the end."""

from typing import Any

import pytest

from eyechart.models.prices import read_prices
from eyechart.serve.live import Live, watched
from report_runs import Reported

pytestmark = pytest.mark.browser


@pytest.mark.parametrize("width", [1280, 800, 400])
def test_it_follows_the_run_and_fits_the_window(width: int, hostile: Reported, engine: Any) -> None:  # noqa: ANN401 - playwright is not there when types are checked
    """Replies that mean harm are text; the count moves without a reload; when the run is over the page says so."""
    live, told = Live(hostile.run, read_prices()), list[str]()
    page = engine.new_page(viewport={"width": width, "height": 900})
    said: list[str] = []
    page.on("pageerror", lambda error: said.append(str(error)))
    with watched(live, told.append):
        page.goto(told[0])
        assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
        live.move(7, 10)
        page.locator("#now strong", has_text="7 of 10 calls").wait_for(timeout=10_000)
        assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
        assert page.evaluate("window.pwned") is None
    page.locator("#state", has_text="The run is over").wait_for(timeout=10_000)
    assert "7 of 10 calls" in page.inner_text("#now")
    assert said == []
    page.close()
