"""The page in headless Chromium, wide and narrow: nothing in the console, filters and keys work, axe-core is content.

Run by make test-browser, which names axe-core's script in EYECHART_AXE.
"""

import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from report_runs import HOSTILE, LONG, Reported

pytestmark = pytest.mark.browser

FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
HEIGHT_PX = 900


@pytest.fixture(scope="module", params=[1280, 400], ids=lambda width: f"{width} px")
def browser(request: pytest.FixtureRequest, hostile: Reported) -> Iterator[Any]:
    """Return Chromium with a report open, as wide as the parameter."""
    from selenium import webdriver  # noqa: PLC0415 - an extra
    from selenium.webdriver.chrome.service import Service  # noqa: PLC0415 - an extra

    options = webdriver.ChromeOptions()
    options.binary_location = os.environ.get("EYECHART_CHROMIUM", "/usr/bin/chromium")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    with tempfile.TemporaryDirectory() as profile:
        for flag in (*FLAGS, f"--user-data-dir={profile}"):
            options.add_argument(flag)
        driver_path = os.environ.get("EYECHART_CHROMEDRIVER", "/usr/bin/chromedriver")
        driver = webdriver.Chrome(options=options, service=Service(driver_path))
        size = {"width": request.param, "height": HEIGHT_PX, "deviceScaleFactor": 1, "mobile": False}
        driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        driver.get(hostile.page.as_uri())
        yield driver
        driver.quit()


@pytest.fixture(autouse=True)
def _clear(browser: Any) -> None:  # noqa: ANN401 - selenium is not there when types are checked
    """Begin each test with cleared filters."""
    browser.find_element("id", "f-clear").click()


def choose(browser: Any, field: str, value: str) -> None:  # noqa: ANN401 - as above
    """Set a filter."""
    script = (
        "const f = document.getElementById(arguments[0]); f.value = arguments[1];"
        "if (f.value !== arguments[1]) throw new Error('no such option: ' + arguments[1]);"
        "f.dispatchEvent(new Event('input', { bubbles: true }));"
    )
    browser.execute_script(script, f"f-{field}", value)


def texts(browser: Any, selector: str) -> list[str]:  # noqa: ANN401 - as above
    """Return the text of every element that a selector finds, as it stands in the document."""
    return list(
        browser.execute_script(
            "return [...document.querySelectorAll(arguments[0])].map(node => node.textContent)", selector
        )
    )


def test_the_console_stays_empty(browser: Any) -> None:  # noqa: ANN401 - as above
    """No error, no warning, and no violation of the page's own policy."""
    assert browser.get_log("browser") == []


def test_nothing_that_a_model_wrote_ran(browser: Any) -> None:  # noqa: ANN401 - as above
    """The replies would set a mark on the window, or the title."""
    assert browser.execute_script("return window.pwned") is None
    assert browser.title.startswith("eyechart report")
    assert browser.execute_script("return document.querySelectorAll('pre script, pre img, pre b').length") == 0


def test_a_hostile_reply_is_shown_word_for_word(browser: Any) -> None:  # noqa: ANN401 - as above
    """Script, quotes, control signs and marks of direction are text."""
    shown: set[str] = set()
    for place in range(len(texts(browser, "#list button"))):
        browser.execute_script("document.querySelectorAll('#list button')[arguments[0]].click()", place)
        shown |= set(texts(browser, "pre.reply"))
    assert set(HOSTILE) <= shown


def test_a_reply_of_200_000_characters_is_cut_until_asked_for(browser: Any) -> None:  # noqa: ANN401 - as above
    """A button shows all of it."""
    choose(browser, "text", "long winded")
    browser.execute_script("document.querySelector('#list button').click()")
    cut = max(texts(browser, "#detail pre.reply"), key=len)
    assert len(cut) < 2000
    browser.execute_script("document.querySelector('#detail .answer button').click()")
    assert LONG in texts(browser, "#detail pre.reply")


def test_every_filter_changes_what_is_shown(browser: Any) -> None:  # noqa: ANN401 - as above
    """Each filter leaves fewer calls, and only such as match."""
    every = browser.find_element("id", "status").text
    for field, value in (
        ("text", "light-0-1"),
        ("scenario", "dense"),
        ("condition", "mirrored"),
        ("decision", "a STOP"),
        ("differs", "differs"),
    ):
        choose(browser, field, value)
        assert browser.find_element("id", "status").text != every, field
        if field == "condition":
            assert set(texts(browser, "#detail h4")) == {"mirrored"}
        if field == "differs":
            assert all(text.startswith("≠") for text in texts(browser, "#detail .against"))
        browser.find_element("id", "f-clear").click()
        assert browser.find_element("id", "status").text == every
    choose(browser, "model", "1")
    assert set(texts(browser, "#detail .who")) == {"standin:steady"}


def test_filters_that_nothing_matches_say_so(browser: Any) -> None:  # noqa: ANN401 - as above
    """An empty list, a sentence, and keys that do no harm."""
    choose(browser, "text", "no such word anywhere")
    assert texts(browser, "#list button") == []
    assert texts(browser, "#detail") == ["No call matches these filters."]
    browser.find_element("tag name", "body").send_keys("j")
    assert browser.get_log("browser") == []


def test_the_keyboard_moves_through_the_frames(browser: Any) -> None:  # noqa: ANN401 - as above
    """J and k from anywhere, arrows in the list, / to the filter and Escape back."""
    from selenium.webdriver.common.keys import Keys  # noqa: PLC0415 - an extra

    def press(key: str) -> str:
        browser.switch_to.active_element.send_keys(key)
        return str(browser.execute_script("return document.querySelector('#detail h3').textContent"))

    assert len(texts(browser, "#list button")) > 3
    browser.execute_script("document.querySelectorAll('#list button')[0].click(); document.activeElement.blur()")
    start = press("k")
    moved = [press(key) for key in ("j", "j", Keys.ARROW_DOWN, Keys.ARROW_UP, "k")]
    assert len({start, *moved}) == 4
    assert moved[4] == moved[0]
    press("/")
    assert browser.switch_to.active_element.get_attribute("id") == "f-text"
    browser.switch_to.active_element.send_keys("k")
    assert browser.find_element("id", "f-text").get_attribute("value") == "k"
    assert browser.switch_to.active_element.get_attribute("id") == "f-text"
    browser.find_element("id", "f-clear").click()
    press("/")
    press(Keys.ESCAPE)
    assert browser.switch_to.active_element.tag_name == "button"
    ring = browser.execute_script("return getComputedStyle(document.activeElement).outlineStyle")
    assert ring == "solid"


def test_the_theme_can_be_chosen(browser: Any) -> None:  # noqa: ANN401 - as above
    """Automatic, light, dark, and round again."""
    button = browser.find_element("id", "theme")
    seen = set()
    for _ in range(3):
        browser.execute_script("arguments[0].click()", button)
        seen.add((button.text, browser.execute_script("return getComputedStyle(document.body).backgroundColor")))
    assert {text for text, _ in seen} == {"Theme: automatic", "Theme: light", "Theme: dark"}
    assert len({colour for _, colour in seen}) == 2


def test_the_page_is_not_wider_than_the_window(browser: Any) -> None:  # noqa: ANN401 - as above
    """Wide figures and tables scroll inside themselves."""
    assert browser.execute_script("return document.documentElement.scrollWidth - innerWidth") <= 0


@pytest.mark.axe
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_axe_finds_no_serious_violation(browser: Any, theme: str) -> None:  # noqa: ANN401 - as above
    """Accessible names, contrast, roles and order, with every fold of the page open, light and dark."""
    browser.execute_script(
        "document.documentElement.dataset.theme = arguments[0];"
        "document.querySelectorAll('details').forEach(one => { one.open = true; })",
        theme,
    )
    browser.execute_script(Path(os.environ["EYECHART_AXE"]).read_text(encoding="utf-8"))
    found = browser.execute_async_script("const done = arguments[0]; axe.run(document).then(done, done)")
    grave = [one for one in found["violations"] if one["impact"] in {"serious", "critical"}]
    assert [f"{one['id']}: {one['nodes'][0]['html'][:200]}" for one in grave] == []
    assert len(found["passes"]) > 20
