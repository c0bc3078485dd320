"""The page of drives and a film in headless Chromium, wide and narrow: a silent console, keys, and axe content.

Run by make test-browser, as the report's own tests.
"""

from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest

from corridors import corridor_run, open_corridors
from eyechart.report.page import write_page
from eyechart.simulators import SIMULATORS
from eyechart.studies.closed_loop import read_drives, score
from eyechart.studies.closed_loop.film import write_film
from eyechart.studies.closed_loop.page import make_drives_page
from eyechart.studies.closed_loop.replay import find_episode

pytestmark = pytest.mark.browser
HEIGHT_PX = 900


@pytest.fixture(scope="module", autouse=True)
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the page of a run and a film of one of its drives."""
    folder = tmp_path_factory.mktemp("drives")
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(SIMULATORS, "corridor", f"{open_corridors.__module__}:open_corridors")
        run = corridor_run(folder / "run")
        write_page(make_drives_page([run], score(run, resamples=200)), folder / "page.html")
        drives, found = find_episode(read_drives([run]), "onerror=alert(1)> corridor/light/1 blank")
        write_film(drives, found, folder / "film.html")
    return folder


@pytest.fixture(params=[1280, 400], ids=lambda width: f"{width} px")
def window(request: pytest.FixtureRequest, engine: Any) -> Iterator[Any]:  # noqa: ANN401 - playwright has no types here
    """Return an empty window as wide as the parameter; nothing may be said in its console."""
    opened = engine.new_page(viewport={"width": request.param, "height": HEIGHT_PX})
    said: list[str] = []
    opened.on("console", lambda message: said.append(message.text))
    opened.on("pageerror", lambda error: said.append(str(error)))
    yield opened
    assert said == []
    opened.close()


def axe(window: Any, rules: int = 11) -> list[str]:  # noqa: ANN401 - as above
    """Return the serious violations that axe-core finds, and require that it looked, by so many ``rules`` at least.

    Of what passes it names one place a rule: to name each took longer than to look.
    """
    script = Path(str(files("axe_playwright_python"))) / "axe.min.js"
    window.evaluate(script.read_text(encoding="utf-8") + "; undefined")
    ruling = window.evaluate("axe.run(document, {resultTypes: ['violations']})")
    assert len(ruling["passes"]) >= rules
    grave = [one for one in ruling["violations"] if one["impact"] in {"serious", "critical"}]
    return [f"{one['id']}: {one['nodes'][0]['html'][:200]}" for one in grave]


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("name", ["page.html", "film.html"])
def test_axe_finds_no_serious_violation_and_nothing_is_cut(window: Any, made: Path, name: str, scheme: str) -> None:  # noqa: ANN401 - as above
    """Light and dark, wide and narrow, the page and a film."""
    window.emulate_media(color_scheme=scheme)
    window.goto((made / name).as_uri())
    assert axe(window) == []
    assert window.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
    assert window.evaluate("window.pwned") is None


def test_episodes_are_filtered_and_stepped_through_by_keyboard(window: Any, made: Path) -> None:  # noqa: ANN401 - as above
    """A filter leaves its episodes, j goes to the next one, and an arrow on the slider to the next step's picture."""
    window.goto((made / "page.html").as_uri())
    assert window.inner_text("#status") == "12 of 12 episodes match."
    window.select_option("#f-condition", "blank")
    assert window.inner_text("#status") == "6 of 12 episodes match."
    first = window.inner_text("#detail h3")
    window.evaluate("document.activeElement.blur()")
    window.keyboard.press("j")
    assert window.inner_text("#detail h3") != first
    window.click("#f-clear")
    window.select_option("#f-pictures", "yes")
    assert window.inner_text("#status") == "4 of 12 episodes match."
    before = window.get_attribute("#detail img", "src")
    window.focus("#step")
    window.keyboard.press("ArrowRight")
    assert window.inner_text("#moment").startswith("Step 2 of 6")
    assert window.get_attribute("#detail img", "src") != before


def test_a_hostile_reply_is_text_in_page_and_film(window: Any, made: Path) -> None:  # noqa: ANN401 - as above
    """Step by step, none of the replies runs."""
    window.goto((made / "page.html").as_uri())
    window.focus("#step")
    for _ in range(6):
        window.keyboard.press("ArrowRight")
    assert window.locator("pre script, pre img, pre b").count() == 0
    window.goto((made / "film.html").as_uri())
    places = set()
    for _ in range(8):
        places.add(window.inner_text("#place"))
        window.keyboard.press("ArrowRight")
    assert len(places) == 7
    window.keyboard.press("Home")
    assert "decision 1 of 6" in window.inner_text("#place")
    assert window.evaluate("window.pwned") is None
