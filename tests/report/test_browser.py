"""The page in headless Chromium, wide and narrow: nothing in the console, filters and keys work, axe-core is content.

Run by make test-browser; EYECHART_CHROMIUM names another Chromium than the one on the path.
"""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from test_drives_browser import axe

from banks import build_bank
from eyechart.report.page import write_page
from eyechart.studies import battery
from eyechart.studies.battery.page import make_page
from report_runs import HOSTILE, LONG, Reported, read_evidence

pytestmark = pytest.mark.browser
HEIGHT_PX = 900
ALLOWED = {"file", "data", "about"}


@pytest.fixture(params=[1280, 400], ids=lambda width: f"{width} px")
def page(request: pytest.FixtureRequest, engine: Any, hostile: Reported) -> Iterator[Any]:  # noqa: ANN401
    """Return the report open in a window as wide as the parameter; what its console says is kept in ``said``."""
    opened = engine.new_page(viewport={"width": request.param, "height": HEIGHT_PX})
    opened.said = []
    opened.asked = []
    opened.on("console", lambda message: opened.said.append(message.text))
    opened.on("pageerror", lambda error: opened.said.append(str(error)))
    opened.on("request", lambda asked: opened.asked.append(asked.url))
    opened.goto(hostile.page.as_uri())
    yield opened
    assert opened.said == []
    opened.close()


def choose(page: Any, field: str, value: str) -> None:  # noqa: ANN401 - playwright is not there when types are checked
    """Set a filter."""
    if field == "text":
        page.fill("#f-text", value)
    else:
        page.select_option(f"#f-{field}", value)


def texts(page: Any, selector: str) -> list[str]:  # noqa: ANN401 - as above
    """Return the text of every element that a selector finds, as it stands in the document."""
    return [str(text) for text in page.eval_on_selector_all(selector, "nodes => nodes.map(node => node.textContent)")]


def test_the_page_asks_for_nothing(page: Any) -> None:  # noqa: ANN401 - as above
    """Scrolled to its end, it has requested itself and what it carries in itself."""
    page.evaluate("document.querySelectorAll('details').forEach(one => { one.open = true; })")
    page.evaluate("scrollTo(0, document.body.scrollHeight)")
    page.wait_for_timeout(200)
    assert {url.partition(":")[0] for url in page.asked} <= ALLOWED
    assert sum(url.startswith("file:") for url in page.asked) == 1
    broken = "nodes => nodes.filter(node => node.complete && node.naturalWidth === 0).length"
    assert page.eval_on_selector_all("img", broken) == 0


def test_nothing_that_a_model_wrote_ran(page: Any) -> None:  # noqa: ANN401 - as above
    """The replies would set a mark on the window, or the title."""
    for place in range(len(texts(page, "#list button"))):
        page.locator("#list button").nth(place).dispatch_event("click")
    assert page.evaluate("window.pwned") is None
    assert page.title().startswith("eyechart report")
    assert page.locator("pre script, pre img, pre b").count() == 0


def test_a_hostile_reply_is_shown_word_for_word(page: Any) -> None:  # noqa: ANN401 - as above
    """Script, quotes, control signs and marks of direction are text."""
    shown: set[str] = set()
    for place in range(len(texts(page, "#list button"))):
        page.locator("#list button").nth(place).dispatch_event("click")
        shown |= set(texts(page, "pre.reply"))
    assert set(HOSTILE) <= shown


def test_a_reply_of_200_000_characters_is_cut_until_asked_for(page: Any) -> None:  # noqa: ANN401 - as above
    """A button shows all of it."""
    choose(page, "text", "long winded")
    page.locator("#list button").first.click()
    assert max(map(len, texts(page, "#detail pre.reply"))) < 2000
    page.locator("#detail .answer button").first.click()
    assert LONG in texts(page, "#detail pre.reply")
    assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("text", "light-0-1"),
        ("scenario", "dense"),
        ("condition", "mirrored"),
        ("decision", "a STOP"),
        ("differs", "differs"),
    ],
)
def test_every_filter_changes_what_is_shown(page: Any, field: str, value: str) -> None:  # noqa: ANN401 - as above
    """Each filter leaves fewer calls, and only such as match; Clear brings all back."""
    every = page.inner_text("#status")
    choose(page, field, value)
    assert page.inner_text("#status") != every
    if field == "scenario":
        assert all(text.startswith("dense") for text in texts(page, "#list button"))
    if field == "condition":
        assert set(texts(page, "#detail h4")) == {"mirrored"}
    if field == "decision":
        assert {text.removeprefix("■ ") for text in texts(page, "#detail .chip")} == {"STOP"}
    if field == "differs":
        assert all(text.startswith("≠") for text in texts(page, "#detail .against"))
    page.click("#f-clear")
    assert page.inner_text("#status") == every


def test_a_model_can_be_chosen(page: Any) -> None:  # noqa: ANN401 - as above
    """Then only its replies are shown."""
    choose(page, "model", "1")
    assert set(texts(page, "#detail .who")) == {"standin:steady"}


def test_filters_that_nothing_matches_say_so(page: Any) -> None:  # noqa: ANN401 - as above
    """An empty list, a sentence, and keys that do no harm."""
    choose(page, "text", "no such word anywhere")
    assert texts(page, "#list button") == []
    assert texts(page, "#detail") == ["No call matches these filters."]
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press("j")


def test_the_keyboard_moves_through_the_frames(page: Any) -> None:  # noqa: ANN401 - as above
    """J and k from anywhere, arrows in the list, / to the filter and Escape back."""

    def press(key: str) -> str:
        page.keyboard.press(key)
        return page.inner_text("#detail h3")

    def focused() -> str:
        return str(page.evaluate("document.activeElement.id || document.activeElement.tagName"))

    assert len(texts(page, "#list button")) > 3
    start = press("k")
    moved = [press(key) for key in ("j", "j", "ArrowDown", "ArrowUp", "k")]
    assert len({start, *moved}) == 4
    assert moved[4] == moved[0]
    assert press("End") == texts(page, "#list button > span:first-child")[-1]
    press("/")
    assert focused() == "f-text"
    page.keyboard.press("k")
    assert (page.input_value("#f-text"), focused()) == ("k", "f-text")
    page.click("#f-clear")
    press("/")
    press("Escape")
    assert focused() == "BUTTON"
    assert page.evaluate("getComputedStyle(document.activeElement).outlineStyle") == "solid"


def test_filters_are_reached_and_changed_by_keyboard_alone(page: Any) -> None:  # noqa: ANN401 - as above
    """Tab goes from field to field, and a letter chooses an option."""
    every = page.inner_text("#status")
    page.focus("#f-model")
    page.keyboard.press("Tab")
    page.keyboard.press("d")
    assert page.input_value("#f-scenario") == "dense"
    assert page.inner_text("#status") != every


def test_the_theme_can_be_chosen(page: Any) -> None:  # noqa: ANN401 - as above
    """Automatic, light, dark, and round again."""
    seen = set()
    for _ in range(3):
        page.click("#theme")
        seen.add((page.inner_text("#theme"), page.evaluate("getComputedStyle(document.body).backgroundColor")))
    assert {text for text, _ in seen} == {"Theme: automatic", "Theme: light", "Theme: dark"}
    assert len({colour for _, colour in seen}) == 2


def test_the_page_follows_the_reader_s_colour_scheme(page: Any) -> None:  # noqa: ANN401 - as above
    """Dark where the system is dark, until a theme is chosen."""
    colour = "getComputedStyle(document.body).backgroundColor"
    light = page.evaluate(colour)
    page.emulate_media(color_scheme="dark")
    assert page.evaluate(colour) != light


def test_the_page_is_not_wider_than_the_window(page: Any) -> None:  # noqa: ANN401 - as above
    """Wide figures and tables scroll inside themselves, also where every fold is open."""
    page.evaluate("document.querySelectorAll('details').forEach(one => { one.open = true; })")
    assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0


def test_a_printed_page_has_what_is_folded_on_a_screen(page: Any) -> None:  # noqa: ANN401 - as above
    """Without a script: paper cannot be unfolded."""
    shown = "nodes => nodes.map(node => node.checkVisibility())"
    folded = "details:not([open]) > :not(summary)"
    hidden = page.eval_on_selector_all(folded, shown)
    assert len(hidden) > 5
    assert not any(hidden)
    page.emulate_media(media="print")
    assert all(page.eval_on_selector_all(f"section:not(#frames) {folded}", shown))


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_no_serious_violation(page: Any, scheme: str) -> None:  # noqa: ANN401 - as above
    """Accessible names, contrast, roles and order, with every fold of the page open, light and dark."""
    page.emulate_media(color_scheme=scheme)
    page.evaluate("document.querySelectorAll('details').forEach(one => { one.open = true; })")
    assert axe(page, 21) == []


@pytest.mark.parametrize("width", [1280, 400])
def test_one_model_fills_the_page(engine: Any, tmp_path: Path, width: int) -> None:  # noqa: ANN401 - as above
    """Its card is as wide as the place for all cards."""
    bank = build_bank(tmp_path / "bank", episodes=2, steps=1)
    planned = battery.plan(bank.root, ["scripted:presence"], tmp_path / "run")
    with ThreadPoolExecutor(1) as beside:  # the browser has an event loop of its own in this thread
        beside.submit(battery.run, planned).result()
    write_page(make_page(read_evidence([tmp_path / "run"])), tmp_path / "page.html")
    opened = engine.new_page(viewport={"width": width, "height": HEIGHT_PX})
    opened.goto((tmp_path / "page.html").as_uri())
    card, cards = (opened.locator(name).bounding_box() for name in (".card", ".cards"))
    assert card["width"] > 0.98 * cards["width"] > 0.5 * width
    opened.close()
