"""The page and the films of drives: inert, the same every time, and only of drives that repeat."""

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from PIL import Image

from corridors import corridor_run, open_corridors
from drives import always, by_depth, drive, make_run
from eyechart.errors import LedgerError, OutputError, SpecError
from eyechart.report.page import Page
from eyechart.report.table import write_tables
from eyechart.simulators import SIMULATORS
from eyechart.studies.closed_loop import browser, film, read_drives, score
from eyechart.studies.closed_loop.page import make_drives_page
from eyechart.studies.closed_loop.replay import episode_id, find_episode
from eyechart.studies.closed_loop.tables import tables_of
from report_runs import HOSTILE


@pytest.fixture(autouse=True)
def _corridor(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(SIMULATORS, "corridor", f"{open_corridors.__module__}:open_corridors")


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a run of a model whose replies mean harm, and of a constant, that no test changes."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setitem(SIMULATORS, "corridor", f"{open_corridors.__module__}:open_corridors")
        return corridor_run(tmp_path_factory.mktemp("driven") / "run")


@pytest.fixture
def run(driven: Path, tmp_path: Path) -> Path:
    """Return a copy of that run, with real and blank pictures, which a test may change."""
    return shutil.copytree(driven, tmp_path / "run")


@pytest.fixture(scope="module")
def page(driven: Path) -> Page:
    """Return the page of that run, made once."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setitem(SIMULATORS, "corridor", f"{open_corridors.__module__}:open_corridors")
        return page_of(driven)


def page_of(run: Path) -> Page:
    """Make the page of a run."""
    return make_drives_page([run], score(run, resamples=200))


def data_of(page: Page) -> dict[str, list[dict[str, object]]]:
    """Return what the browser of episodes reads."""
    block = re.search(r'<script type="application/json" id="data">(.*?)</script>', page.html.decode(), re.DOTALL)
    assert block is not None
    result: dict[str, list[dict[str, object]]] = json.loads(block.group(1))
    return result


def test_the_page_is_inert_and_the_same_every_time(run: Path) -> None:
    """Nothing that a model wrote is markup, nothing is requested, and every reply is there word for word."""
    page = page_of(run)
    html = page.html.decode()
    assert page_of(run).html == page.html
    outside = re.sub(r'<script type="application/json".*?</script>', "", html, flags=re.DOTALL)
    assert "<img src=x" not in outside
    assert "window.pwned" not in outside
    assert "&lt;img src=x onerror=alert(1)&gt;" in outside
    assert html.count("<script") == 2
    assert "default-src &#39;none&#39;" in html
    assert not re.search(r'(?:src|href)="(?!data:|#)', html)
    assert set(HOSTILE) == set(map(str, data_of(page)["texts"]))


def test_the_page_says_what_the_blind_baseline_shows(page: Page) -> None:
    """In the words of the score, for each policy, and of the one that is a model at its head too."""
    html = page.html.decode()
    assert html.count("the same to the last digit with blank pictures as with real ones") == 2 + 1
    assert "constant policies converge" in html


def test_every_episode_stands_in_the_browser_with_its_steps(page: Page) -> None:
    """Decisions, executed actions and gaps; a few drives with pictures, one a moment and one at the end."""
    episodes = data_of(page)["episodes"]
    assert len(episodes) == 12
    steps = episodes[0]["steps"]
    assert isinstance(steps, list)
    assert [step[:4] for step in steps][:2] == [["LEFT", "LEFT", True, 49.0], ["LEFT", "LEFT", True, 48.0]]
    pictured = [episode for episode in episodes if episode["pictures"]]
    assert len(pictured) == 4
    assert all(isinstance(episode["pictures"], list) and len(episode["pictures"]) == 7 for episode in pictured)
    assert any("Pictures of 4 episodes" in note for note in page.notes)


def test_a_drive_that_does_not_repeat_has_no_pictures(run: Path, tmp_path: Path) -> None:
    """The note names the versions that differ; everything else is there."""
    file = run / "episodes.jsonl"
    file.write_text(re.sub(r'"state_sha256":"....', '"state_sha256":"0000', file.read_text()))
    page = page_of(run)
    assert not any(one["pictures"] for one in data_of(page)["episodes"])
    assert any("the run was driven with corridor 1, here 2: install those" in note for note in page.notes)
    drives, found = find_episode(read_drives([run]), "constant:SLOW corridor/light/1 real")
    with pytest.raises(LedgerError, match="does not drive again here"):
        film.write_film(drives, found, tmp_path / "film.gif")
    assert not (tmp_path / "film.gif").exists()


def test_pictures_and_replies_keep_to_their_room(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What does not fit is left out with a sentence."""
    monkeypatch.setattr(browser, "PICTURE_BYTES", 300)
    monkeypatch.setattr(browser, "MOST_EPISODES", 5)
    monkeypatch.setattr(browser, "TEXT_BUDGET", 40)
    page = page_of(run)
    found = data_of(page)
    assert len(found["episodes"]) == 5
    assert len(found["pictures"]) < 10
    assert sum(len(str(text)) for text in found["texts"]) <= 40
    assert any("lists 5 of 12 episodes" in note for note in page.notes)
    assert any("replies are cut or left out" in note for note in page.notes)


def test_films_hold_every_moment(run: Path, tmp_path: Path) -> None:
    """A GIF of seven pictures, and a page with the same pictures, the decisions and the replies as text."""
    drives, found = find_episode(read_drives([run]), "<img src=x onerror=alert(1)> corridor/light/1 blank")
    assert film.write_film(drives, found, tmp_path / "film.gif") == 7
    with Image.open(tmp_path / "film.gif") as opened:
        assert getattr(opened, "n_frames", 0) == 7
        assert opened.width >= 700
    assert film.write_film(drives, found, tmp_path / "film.html") == 7
    html = (tmp_path / "film.html").read_text()
    assert "<img src=x" not in html
    steps = json.loads(html.partition('id="data">')[2].partition("</script>")[0])["steps"]
    assert [step["executed"] for step in steps] == ["LEFT"] * 6 + [""]
    assert {step["reply"] for step in steps[:-1]} <= set(HOSTILE)
    assert "shown: blank" in steps[0]["place"]
    assert "gap 49.0 m" in steps[0]["state"]


def test_a_film_says_what_is_wrong_with_it(run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its name, its rate, a missing extra, an episode that is not one, and a place that is taken."""
    drives, found = find_episode(read_drives([run]), "constant:SLOW corridor/light/0 real")
    with pytest.raises(SpecError, match=r"written as \.mp4, \.gif, \.html"):
        film.write_film(drives, found, tmp_path / "film.avi")
    with pytest.raises(SpecError, match=r"give 0\.1 to 60"):
        film.write_film(drives, found, tmp_path / "film.gif", fps=0)
    monkeypatch.setattr(film, "find_spec", lambda _: None)
    with pytest.raises(SpecError, match=r"pip install 'eyechart\[film\]'"):
        film.write_film(drives, found, tmp_path / "film.mp4")
    with pytest.raises(SpecError, match="names 6 episodes"):
        find_episode(read_drives([run]), "constant:SLOW")
    with pytest.raises(SpecError, match="names no episode"):
        find_episode(read_drives([run]), "nobody")
    _, by_parts = find_episode(read_drives([run]), "light 0 constant:SLOW real")
    assert episode_id(by_parts) == "constant:SLOW corridor/light/0 real"
    with pytest.raises(OutputError, match="belongs to the run"):
        film.write_film(drives, found, run / "episodes.jsonl" / "x.gif")
    (tmp_path / "taken.gif").write_text("my notes")
    with pytest.raises(OutputError, match="is no film"):
        film.write_film(drives, found, tmp_path / "taken.gif")
    failed = replace(found, steps=(), ended="error", detail="the camera shows black only")
    with pytest.raises(LedgerError, match="no step to show: it ended in error the camera shows black only"):
        film.write_film(drives, failed, tmp_path / "film.gif")


def test_tables_of_drives_hold_every_number(tmp_path: Path) -> None:
    """CSV, Markdown and LaTeX of the ladder, the paired differences and the audit."""
    made = make_run(tmp_path / "run", [*drive("oracle", by_depth), *drive("constant:SLOW", always("SLOW"))])
    files = write_tables(tables_of(score(made, resamples=200)), tmp_path / "tables")
    names = {file.name for file in files}
    tables = ("baselines", "ladder", "ladder_summary", "less_reference_1", "paired", "audit", "degeneracy", "replay")
    assert {f"{name}.{kind}" for name in tables for kind in ("csv", "md", "tex")} == names
    ladder = (tmp_path / "tables" / "ladder.csv").read_text()
    assert "highway,constant:SLOW,real,,distance_m,400.0" in ladder


def test_a_driver_is_named_with_its_run_only_where_that_tells_it_apart(tmp_path: Path) -> None:
    """A policy of one of several runs needs no prefix; one that drove in both does."""
    one = make_run(tmp_path / "one", [*drive("oracle", by_depth), *drive("constant:SLOW", always("SLOW"))])
    two = make_run(tmp_path / "two", drive("constant:SLOW", always("SLOW")))
    labels = [each.driver.label for each in score([one, two], resamples=200).drives]
    assert sorted(labels) == ["one · constant:SLOW", "oracle", "two · constant:SLOW"]
