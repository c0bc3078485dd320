"""The page of 20 models on 288 frames under 15 conditions: it is small, opens lightly, and holds every reply whole."""

import re
from collections.abc import Iterator
from typing import Any

import pytest

from eyechart.report.page import Page, write_page
from eyechart.studies.battery.page import MOST_CHARACTERS, characters_beside, make_page
from eyechart.studies.battery.subjects import Evidence, subjects
from large_runs import CONDITIONS, FRAMES, MODELS, large_evidence
from report_runs import data_of

pytestmark = pytest.mark.browser

MOST_BYTES = 15_000_000
MOST_NODES = 60_000
"""Elements when it opens; ``make long-page`` measures what they cost."""


@pytest.fixture(scope="module")
def evidence(tmp_path_factory: pytest.TempPathFactory) -> Evidence:
    """Return the evidence: two known-answer controllers through the real run and score, ten copies of each."""
    return large_evidence(tmp_path_factory.mktemp("large"), ("random", "depth"))


@pytest.fixture(scope="module")
def large(evidence: Evidence) -> Page:
    """Return its page."""
    return make_page([evidence])


@pytest.fixture(params=[1280, 400], ids=lambda width: f"{width} px")
def opened(
    request: pytest.FixtureRequest,
    large: Page,
    engine: Any,  # noqa: ANN401 - playwright is not there when types are checked
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[Any]:
    """Return the page open in a window."""
    file = tmp_path_factory.mktemp("opened") / "report.html"
    write_page(large, file)
    page = engine.new_page(viewport={"width": request.param, "height": 900})
    page.goto(file.as_uri())
    yield page
    page.close()


def test_it_opens_with_few_elements_and_unpacks_nothing(opened: Any) -> None:  # noqa: ANN401 - as above
    """What makes a browser slow is what it must lay out and parse; replies wait until somebody comes to them."""
    assert 1000 < opened.evaluate("document.querySelectorAll('*').length") < MOST_NODES
    assert opened.locator("#packed").count() == 1
    assert opened.locator("#list button").count() == 0


def test_replies_are_there_when_somebody_looks(opened: Any) -> None:  # noqa: ANN401 - as above
    """Scrolled to, every frame is listed, and a reply stands there to its last word."""
    opened.evaluate("document.getElementById('frames').scrollIntoView()")
    opened.locator("#list button").first.wait_for(timeout=20_000)
    assert opened.locator("#list button").count() == FRAMES
    assert f"{FRAMES} of {FRAMES} frames" in opened.inner_text("#status")
    reply = opened.locator("#detail pre.reply").first.inner_text()
    assert reply.startswith("standin:random-0: ")
    assert reply.splitlines()[-1] in {"FASTER", "SLOWER", "IDLE", "STOP", "SLOW", "LEFT", "RIGHT", "MAINTAIN"}
    assert opened.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0


def test_it_has_less_than_15_mb_and_every_reply_whole(evidence: Evidence, large: Page) -> None:
    """All calls are in it, none is cut. Its pictures are small, so what is beside them is held to what is set aside."""
    found = data_of(large.html.decode())
    (run,) = found["runs"]
    assert [len(run["models"]), len(run["frames"]), len(run["conditions"])] == [MODELS, FRAMES, CONDITIONS]
    assert len(found["texts"]) > 75_000
    assert found["cut"] == {}
    assert not any("left out" in note or "cut" in note for note in large.notes)
    assert len(large.html) < MOST_CHARACTERS < MOST_BYTES
    beside = re.sub(rb'id="(data|packed)">[^<]*<', b"", large.html)
    assert len(beside) < characters_beside(subjects([evidence])) < 1.3 * len(beside)
