"""Every kind of page in headless Chromium, in light and dark: it answers above the fold, and nothing of it is cut.

The pages are of small runs with known answers; ``make test-browser`` runs this.
"""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from test_drives_browser import axe

import banks
import corridors
import intents
import stand_ins
import voters
from eyechart.guardian.page import guardian_page
from eyechart.models import ADAPTERS
from eyechart.overview import make_index
from eyechart.report.page import Page, write_page
from eyechart.simulators import SIMULATORS, open_bank_simulator
from eyechart.studies import (
    ReadOptions,
    battery,
    closed_loop,
    guardian,
    hierarchy,
    open_study,
    policy,
    prompts,
    structured,
)
from eyechart.studies.battery.page import make_page
from eyechart.studies.battery.subjects import read_evidence
from eyechart.studies.closed_loop.page import make_drives_page
from eyechart.studies.hierarchy.page import make_hierarchy_page
from eyechart.studies.structured.page import make_estimates_page
from report_runs import hostile, make_run

pytestmark = pytest.mark.browser

READING = ReadOptions(independent=False, reread=False)
QUICK = partial(battery.score, resamples=199)
HEIGHT_PX = 900
CUT = """
[...document.querySelectorAll('main .scroll, main table, main .plot, main .plot > svg')].filter(
  (one) => one.scrollWidth > one.clientWidth + 1 || one.getBoundingClientRect().right > innerWidth + 1
).map((one) => one.getAttribute('aria-label') || one.getAttribute('class') || one.getAttribute('aria-labelledby'))
"""
"""The tables and figures of a page of which something stands where nobody sees it."""


def a_battery(root: Path) -> Page:
    """Return the page of one battery: constant, hostile, and a long name."""
    bank = banks.build_bank(root / "bank").root
    models = {"steady": stand_ins.stop, "hostile-" + "x" * 40: hostile, "again": stand_ins.stop, "more": stand_ins.stop}
    return make_page(read_evidence([make_run(bank, root / "run", models)], score=QUICK))


def several(root: Path) -> Page:
    """Return the page of two batteries."""
    bank = banks.build_bank(root / "bank").root
    runs = [make_run(bank, root / name, {"steady": stand_ins.stop}) for name in ("first", "second")]
    return make_page(read_evidence(runs, score=QUICK))


def an_index(root: Path) -> Page:
    """Return the index of a folder of runs."""
    bank = banks.build_bank(root / "bank").root
    for name in ("first", "second-with-a-long-name-of-its-own-that-goes-on"):
        make_run(bank, root / "runs" / name, {"steady": stand_ins.stop, "hostile": hostile})
    return make_index(root / "runs", READING, lambda _: None).page


def drives(root: Path) -> Page:
    """Return the page of runs of episodes."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(SIMULATORS, "corridor", f"{corridors.__name__}:open_corridors")
        run = corridors.corridor_run(root / "run")
        return make_drives_page([run], closed_loop.score(run, resamples=200))


def intents_above(root: Path) -> Page:
    """Return the page of the hierarchy."""
    study = intents.make_study(root / "study")
    return make_hierarchy_page(study, hierarchy.score(study, resamples=200))


def estimates(root: Path) -> Page:
    """Return the page of scene estimates of two models, one of which never measures."""
    bank = banks.build_bank(root / "bank").root
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(ADAPTERS, "voter", "voters")
        battery.run(structured.plan("structured", bank, ["voter:never", "voter:sees"], root / "run"))
    return make_estimates_page(read_evidence([root / "run"], score=structured.score))


def a_guardian(root: Path) -> Page:
    """Return the page of a guardian that misses hazards."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(ADAPTERS, "voter", "voters")
        bank = banks.build_bank(root / "bank", episodes=3, steps=4, drawn=False)
        table = voters.ask_all(bank.root, ("never",), root / "run")
        frozen = guardian.fit(table.keep(table.frames[:12]), size=1)
        return guardian_page(guardian.score(frozen, table.keep(table.frames[12:])), bank)


def cells(root: Path) -> Page:
    """Return the page of a prompt study."""
    bank = banks.build_bank(root / "bank").root
    asked = prompts.plan(
        bank, ["scripted:constant", "scripted:random"], root / "study", prompts=["baseline", "minimal"]
    )
    prompts.run(asked)
    return open_study("prompts").report([root / "study"], [], READING, lambda _: None).page


def policies(root: Path) -> Page:
    """Return the page of two trained policies."""
    bank = open_bank_simulator("tabletop").build(root / "bank", seeds=(0, 1), steps=4).root
    policy.run(policy.plan(bank, ["trained:sees", "trained:privileged"], root / "run"))
    return open_study("policy").report([root / "run"], [bank], READING, lambda _: None).page


KINDS: Mapping[str, Callable[[Path], Page]] = {
    one.__name__: one
    for one in (a_battery, several, an_index, drives, intents_above, estimates, a_guardian, cells, policies)
}


@pytest.fixture(scope="module", autouse=True)
def made(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Path]:
    """Return the files of the pages by kind; made before the browser has a loop."""
    root, result = tmp_path_factory.mktemp("pages"), {}
    for name, make in KINDS.items():
        (root / name).mkdir()
        result[name] = root / name / "page.html"
        write_page(make(root / name), result[name])
    return result


@pytest.fixture(params=[1280, 800, 400], ids=lambda width: f"{width} px")
def window(request: pytest.FixtureRequest, engine: Any) -> Iterator[Any]:  # noqa: ANN401 - playwright has no types here
    """Return an empty window as wide as the parameter; nothing may be said in its console."""
    opened = engine.new_page(viewport={"width": request.param, "height": HEIGHT_PX})
    said: list[str] = []
    opened.on("console", lambda message: said.append(message.text))
    opened.on("pageerror", lambda error: said.append(str(error)))
    yield opened
    assert said == []
    opened.close()


@pytest.mark.parametrize("kind", KINDS)
def test_it_answers_above_the_fold_and_nothing_is_cut(window: Any, made: Mapping[str, Path], kind: str) -> None:  # noqa: ANN401 - as above
    """The sentence and the first verdict, then no table that is cut, all of it open, and no scrolling sideways."""
    window.goto(made[kind].as_uri())
    for place in (".sentence", ".sayings li"):
        box = window.locator(place).first.bounding_box()
        assert box is not None
        assert box["y"] + box["height"] < HEIGHT_PX, place
    assert window.inner_text(".sentence").strip().endswith(".")
    window.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
    window.evaluate(
        "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(done, 0))))"
    )
    assert window.evaluate(CUT) == []
    assert window.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0


def test_what_policies_use_stands_side_by_side_where_there_is_room(engine: Any, made: Mapping[str, Path]) -> None:  # noqa: ANN401 - as above
    """Tables stay tables at 1280 px, and statistics are folded, and no command breaks inside a word."""
    opened = engine.new_page(viewport={"width": 1280, "height": HEIGHT_PX})
    opened.goto(made["policies"].as_uri())
    assert opened.locator(".policies, .channels").count() == 2
    assert opened.locator(".policies.folded, .channels.folded").count() == 0
    opened.set_viewport_size({"width": 400, "height": HEIGHT_PX})
    assert opened.locator("details[open]").count() == 0
    assert opened.evaluate("document.documentElement.scrollHeight") < 20_000
    broken = (
        """[...document.querySelectorAll('.command span')].filter((one) => one.getClientRects().length > 1).length"""
    )
    assert opened.evaluate(broken) == 0
    opened.close()


@pytest.mark.parametrize(("kind", "screens"), [("a_battery", 40), ("several", 40), ("estimates", 60)])
def test_what_is_not_looked_at_is_folded(engine: Any, made: Mapping[str, Path], kind: str, screens: int) -> None:  # noqa: ANN401 - as above
    """A telephone shows a page on so many screens at most, and what is folded opens at a touch."""
    opened = engine.new_page(viewport={"width": 400, "height": HEIGHT_PX})
    opened.goto(made[kind].as_uri())
    assert opened.locator("details[open]").count() == 0
    assert opened.evaluate("document.documentElement.scrollHeight") < screens * HEIGHT_PX
    opened.locator("details > summary").last.click()
    assert opened.locator("details[open]").count() == 1
    opened.close()


@pytest.mark.parametrize("kind", ["several", "estimates", "a_guardian", "cells", "policies"])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_no_serious_violation(engine: Any, made: Mapping[str, Path], kind: str, scheme: str) -> None:  # noqa: ANN401 - as above
    """Light and dark, on a narrow page, which holds all that a wide one does; other kinds have tests of their own."""
    opened = engine.new_page(viewport={"width": 400, "height": HEIGHT_PX}, color_scheme=scheme)
    opened.goto(made[kind].as_uri())
    found = axe(opened)
    opened.close()
    assert found == []
