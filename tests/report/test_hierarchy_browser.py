"""The page of the hierarchy and its film in headless Chromium: accessible, whole, and inert but for its boxes."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from test_drives_browser import axe

import intents
from eyechart.report.page import write_page
from eyechart.studies.closed_loop import read_drives
from eyechart.studies.closed_loop.film import write_film
from eyechart.studies.closed_loop.replay import find_episode
from eyechart.studies.hierarchy import score
from eyechart.studies.hierarchy.page import make_hierarchy_page

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module", autouse=True)
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the page of a study and a film of one of its drives; made before the browser has a loop."""
    folder = tmp_path_factory.mktemp("hierarchy")
    study = intents.make_study(folder / "study")
    write_page(make_hierarchy_page(study, score(study, resamples=200)), folder / "page.html")
    drives, found = find_episode(read_drives([study / "lateral"]), "mirrored:route rover-mpc-lateral/offset/1")
    write_film(drives, found, folder / "film.html")
    return folder


@pytest.fixture(params=[1280, 420], ids=lambda width: f"{width} px")
def window(request: pytest.FixtureRequest, engine: Any) -> Iterator[Any]:  # noqa: ANN401 - playwright has no types here
    """Return an empty window as wide as the parameter; nothing may be said in its console."""
    opened = engine.new_page(viewport={"width": request.param, "height": 900})
    said: list[str] = []
    opened.on("console", lambda message: said.append(message.text))
    opened.on("pageerror", lambda error: said.append(str(error)))
    yield opened
    assert said == []
    opened.close()


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("name", ["page.html", "film.html"])
def test_axe_finds_no_serious_violation_and_nothing_is_cut(window: Any, made: Path, name: str, scheme: str) -> None:  # noqa: ANN401 - as above
    """Light and dark, wide and narrow, with every group of worlds open."""
    window.emulate_media(color_scheme=scheme)
    window.goto((made / name).as_uri())
    window.evaluate("document.querySelectorAll('details').forEach(one => { one.open = true; })")
    assert axe(window) == []
    assert window.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0


def test_a_source_is_hidden_by_its_box_without_any_script(engine: Any, made: Path) -> None:  # noqa: ANN401 - as above
    """In its own group only, its way, its end and its name."""
    context = engine.new_context(java_script_enabled=False)
    opened = context.new_page()
    opened.goto((made / "page.html").as_uri())
    first, other = (opened.locator(f'[id="ways-{group}-offset-0-k2-way"]') for group in ("primary-0", "second-0"))
    assert first.is_visible()
    opened.locator(".group .k2").first.uncheck()
    assert not first.is_visible()
    assert not opened.locator('[id="ways-primary-0-offset-0-k2-name"]').is_visible()
    assert other.is_visible()
    context.close()


def test_the_plan_over_a_film_can_be_taken_off(window: Any, made: Path) -> None:  # noqa: ANN401 - as above
    """Lines for each decision, which a box hides."""
    window.goto((made / "film.html").as_uri())
    assert window.locator("#overlay polyline.plan.line").count() == 1
    assert window.inner_text("#plan").startswith("controller: 4.5 m/s on the")
    assert window.locator("#overlay").is_visible()
    window.uncheck("#planned")
    assert not window.locator("#overlay").is_visible()
    window.keyboard.press("End")
    assert window.locator("#overlay polyline").count() == 0
