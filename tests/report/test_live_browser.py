"""The page of a run that goes on, in headless Chromium: nothing is cut, it looks again by itself, and says the end."""

from typing import Any

import pytest

from eyechart.models.prices import read_prices
from eyechart.serve.live import LiveRun, live_server
from report_runs import Reported

pytestmark = pytest.mark.browser


@pytest.mark.parametrize("width", [1280, 800, 400])
def test_it_follows_the_run_and_fits_the_window(width: int, hostile: Reported, engine: Any) -> None:  # noqa: ANN401 - playwright is not there when types are checked
    """Replies that mean harm are text; the count moves without a reload; when the run is over the page says so."""
    live, told = LiveRun(hostile.run, read_prices()), list[str]()
    page = engine.new_page(viewport={"width": width, "height": 900})
    said: list[str] = []
    page.on("pageerror", lambda error: said.append(str(error)))
    with live_server(live, told.append):
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


def _page(route: Any, body: str, status: int = 200) -> None:  # noqa: ANN401 - as above
    route.fulfill(status=status, body=body, content_type="text/html")


@pytest.mark.parametrize(("status", "body"), [(200, "<p>A portal asks you to log in.</p>"), (502, "Bad gateway")])
def test_a_reply_that_is_no_page_of_the_run_is_a_lost_connection_and_no_end(
    status: int,
    body: str,
    hostile: Reported,
    engine: Any,  # noqa: ANN401 - as above
) -> None:
    """It says that it tries again, keeps what was seen, and goes on once the page answers."""
    live, told = LiveRun(hostile.run, read_prices()), list[str]()
    page = engine.new_page()
    with live_server(live, told.append):
        page.goto(told[0])
        page.route("**/*", lambda route: _page(route, body, status))
        live.move(7, 10)
        page.locator("#state", has_text="The connection was lost").wait_for(timeout=10_000)
        assert "over" not in page.inner_text("#state")
        assert page.locator("#now").count() == 1
        page.unroute_all(behavior="ignoreErrors")
        page.locator("#now strong", has_text="7 of 10 calls").wait_for(timeout=15_000)
        assert "It goes on" in page.inner_text("#state")
    page.close()


def test_a_run_that_is_interrupted_is_said_to_be(hostile: Reported, engine: Any) -> None:  # noqa: ANN401 - as above
    """The last word of the page is what the run said when it ended."""
    live, told = LiveRun(hostile.run, read_prices()), list[str]()
    page = engine.new_page()

    def interrupted() -> None:
        with live_server(live, told.append):
            page.goto(told[0])
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    page.locator("#state", has_text="The run was interrupted").wait_for(timeout=10_000)
    page.close()


def test_a_run_that_is_killed_is_not_said_to_be_over(hostile: Reported, engine: Any) -> None:  # noqa: ANN401 - as above
    """Its server is gone, and nothing told the end: the page cannot say."""
    live, told = LiveRun(hostile.run, read_prices()), list[str]()
    page = engine.new_page()
    page.route("**/over", lambda route: route.fulfill(status=204))
    with live_server(live, told.append):
        page.goto(told[0])
        page.wait_for_timeout(500)
    page.locator("#state", has_text="The connection was lost").wait_for(timeout=15_000)
    assert "cannot say whether the run goes on" in page.inner_text("#state")
    page.close()
