"""The page of the hierarchy and the film of one of its drives: where everybody drove, and what was planned."""

import json
import re
import shutil
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

import intents
from corridors import HOSTILE_NAME
from eyechart.cli.app import app
from eyechart.episodes import read_episodes
from eyechart.errors import SpecError
from eyechart.report.overlay import over, pieces
from eyechart.report.page import Page
from eyechart.report.table import write_tables
from eyechart.simulators.rover.hierarchy import RoverMpc, RoverMpcUnaware
from eyechart.studies.closed_loop import read_drives
from eyechart.studies.closed_loop.film import write_film
from eyechart.studies.closed_loop.replay import find_episode, replay
from eyechart.studies.hierarchy import figures, score
from eyechart.studies.hierarchy.figures import trajectory
from eyechart.studies.hierarchy.page import make_hierarchy_page
from eyechart.studies.hierarchy.tables import tables_of


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a study that no test changes."""
    return intents.make_study(tmp_path_factory.mktemp("intents") / "study")


@pytest.fixture
def copied(study: Path, tmp_path: Path) -> Path:
    """Return a study that a test may change."""
    shutil.copytree(study, tmp_path / "study")
    return tmp_path / "study"


def page_of(study: Path) -> Page:
    """Make the page of a study."""
    return make_hierarchy_page(study, score(study, resamples=200))


@pytest.fixture(scope="module")
def page(study: Path) -> Page:
    """Return the page of the study that no test changes, made once."""
    return page_of(study)


def test_the_page_is_inert_the_same_every_time_and_says_what_completion_shows(study: Path, page: Page) -> None:
    """A planner's name is text whatever it holds, and the words stand beside its rates with other pictures."""
    html = page.html.decode()
    assert page_of(study).html == page.html
    assert HOSTILE_NAME not in html
    assert "&lt;img src=x onerror=alert(1)&gt;" in html
    assert html.count("<script") == 2
    assert not re.search(r'(?:src|href)="(?!data:|#)', html)
    words = " ".join(re.sub(r"<[^>]+>", " ", html).split())
    assert "completion does not show perception" in words
    assert "real pictures 0/2 blank 0/2" in words
    assert "23/25" in words


def test_the_answer_says_why_a_planner_is_not_shown_to_see(page: Page) -> None:
    """How many worlds it would need, which other pictures it lacks, or what the data allow."""
    words = unescape(" ".join(re.sub(r"<[^>]+>", " ", page.html.decode().split("</section>")[0]).split()))
    assert "Why not more?" in words
    assert "with 2 worlds no exact test can reach .05" in words or "pictures, which the comparison needs" in words


def test_each_world_shows_every_source_and_how_it_ended(page: Page) -> None:
    """Two worlds in three groups; in words for those who cannot see them, and on the figure of outcomes too."""
    html = unescape(page.html.decode())
    ways = page.drawings["ways"]
    assert [way.title for way in ways] == ["offset, seed 0", "offset, seed 1"] * 3
    assert "MPC-only: reached the goal at 100." in ways[0].description
    assert "always STOP: out of time at 0.3 m" in ways[0].description
    assert "blank: out of time at 0.3 m" in ways[2].description
    assert "mpc-blind: crashed at 2" in ways[4].description
    assert html.count("2 worlds, 4 sources in each") == 1
    assert len(page.drawings["primary"]) == len(page.drawings["second"]) == 1


def test_a_way_runs_through_the_recorded_places_and_near_the_driven_ones(study: Path) -> None:
    """Every place between two decisions lies within a quarter of a metre of the curve."""
    (drives,) = (one for one in read_drives([study / "primary"]) if one.driver.policy == "route")
    episode = drives.episodes[0]
    way = trajectory(drives, episode)
    np.testing.assert_array_equal(way.curve[:-3:3, 0], [step.truth["x_m"] for step in episode.steps])
    share = np.linspace(0, 1, 21)[:, None]
    drive = RoverMpc().drive(episode.key.scenario, episode.key.seed)
    for number, step in enumerate(episode.steps):
        drive.step(step.executed_action)
        a, b, c, d = way.curve[3 * number : 3 * number + 4]
        drawn = a * (1 - share) ** 3 + 3 * b * share * (1 - share) ** 2 + 3 * c * share**2 * (1 - share) + d * share**3
        away = np.linalg.norm(np.array(drive.driven)[:, None] - drawn, axis=2).min(axis=1)
        assert away.max() < 0.25
    np.testing.assert_allclose(way.places[-1, :2], drive.driven[-1], atol=0.001)


@pytest.mark.slow
def test_an_end_that_was_not_recorded_is_driven_again_and_checked(copied: Path, page: Page) -> None:
    """It is the same; where the drive ends in another state its way is left out, and the page says so."""
    file = copied / "primary" / "episodes.jsonl"
    file.write_text(re.sub(r',"y_m":[^,]*,"yaw":[^,}]*}', "}", file.read_text()))
    assert not any("y_m" in step.facts for episode in read_episodes(copied / "primary") for step in episode.steps)
    before, after = (one.drawings["ways"] for one in (page, page_of(copied)))
    assert [one.svg() for one in before] == [one.svg() for one in after]
    file.write_text(re.sub(r'"state_sha256":"....', '"state_sha256":"0000', file.read_text()))
    other = page_of(copied)
    assert any("does not drive again here" in note for note in other.notes)
    assert "MPC-only: did not drive here" in other.drawings["ways"][0].description


def test_a_world_with_other_obstacles_than_the_records_is_not_drawn(copied: Path) -> None:
    """The truth of the first moment tells; the numbers stay."""
    for file in copied.glob("*/episodes.jsonl"):
        file.write_text(re.sub(r'"free_left_m":[^,]*', '"free_left_m":1.5', file.read_text()))
    page = page_of(copied)
    assert page.drawings["ways"] == []
    assert "World offset/1 is not drawn: its obstacles here are not those of the record." in page.notes


def test_a_record_without_places_is_not_drawn(copied: Path) -> None:
    """The way is left out with a sentence; another source's is there."""
    file = copied / "primary" / "episodes.jsonl"
    file.write_text(file.read_text().replace('"x_m":', '"x":'))
    page = page_of(copied)
    assert "A way is not drawn: the record lacks a place at some step: it needs x_m, y_m, yaw, speed_mps." in page.notes
    assert "MPC-only: did not drive here" in page.drawings["ways"][0].description
    assert "mpc-blind: crashed" in page.drawings["ways"][4].description


def test_of_many_worlds_some_are_drawn_and_the_page_says_so(study: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The figure of outcomes and the tables count all."""
    monkeypatch.setattr(figures, "MOST_WORLDS", 1)
    page = page_of(study)
    assert len(page.drawings["ways"]) == 3
    assert page.notes == ("1 of 2 worlds are drawn from above, evenly taken; every number counts all.",)
    assert "1 of 2 worlds, 4 sources in each" in page.html.decode()


def test_tables_hold_every_source_and_every_difference(study: Path, tmp_path: Path) -> None:
    """CSV, Markdown and LaTeX."""
    files = write_tables(tables_of(score(study, resamples=200)), tmp_path / "tables")
    assert {file.name for file in files} >= {
        f"{name}.{kind}"
        for name in ("sources", "paired", "sources_primary", "intents_second")
        for kind in ("csv", "md", "tex")
    }
    sources = (tmp_path / "tables" / "sources.csv").read_text()
    assert "mpc-blind,unaware,rover-mpc-unaware,constant:STRAIGHT,real,2,0.0" in sources
    assert "positive control" in (tmp_path / "tables" / "paired.csv").read_text()


def test_a_film_draws_the_plan_over_the_picture_and_leaves_the_picture_as_it_is(study: Path, tmp_path: Path) -> None:
    """Lines for each decision, none at the end; what the camera saw has none of them."""
    drives, found = find_episode(read_drives([study / "unaware"]), "constant:STRAIGHT rover-mpc-unaware/offset/0")
    shots = list(replay(drives, found))
    assert [shot.sketch is None for shot in shots] == [False] * (len(shots) - 1) + [True]
    drive = RoverMpcUnaware().drive("offset", 0)
    np.testing.assert_array_equal(shots[0].picture, drive.picture())
    picture = Image.fromarray(shots[0].picture)
    sketch = shots[0].sketch
    assert sketch is not None
    drawn = over(picture, sketch, 1)
    np.testing.assert_array_equal(np.asarray(picture), shots[0].picture)
    changed = (np.asarray(drawn) != shots[0].picture).any(axis=2)
    places = [place for piece in pieces(sketch.plan) for place in piece if place[1] < 238]
    assert places
    assert all(changed[int(y), int(x)] for x, y in places)
    assert not changed[: int(np.nanmin(sketch.target[:, 1])) - 3].any()
    assert write_film(drives, found, tmp_path / "film.gif") == len(shots)
    assert write_film(drives, found, tmp_path / "film.html") == len(shots)
    html = (tmp_path / "film.html").read_text()
    steps = json.loads(html.partition('id="data">')[2].partition("</script>")[0])["steps"]
    assert steps[0]["plan"] == "controller: 4.5 m/s on the middle track · 5 of 5 plans solved (flag 1)"
    assert [list(one) for one in steps[0]["lines"]["plan"][0]] == np.round(sketch.plan, 1).tolist()
    assert (steps[-1]["plan"], steps[-1]["lines"]) == ("", None)


@pytest.mark.slow
def test_the_commands_know_a_study_by_its_folder(study: Path, tmp_path: Path) -> None:
    """The report and the score of all of it; a report is about one study."""
    run = CliRunner()
    result = run.invoke(
        app, ["report", str(study), "--out", str(tmp_path / "page.html"), "--figures", str(tmp_path / "f")]
    )
    assert result.exit_code == 0, result.stderr
    assert "16 files of figures" in result.stderr
    assert (tmp_path / "f" / "ways-primary-0-offset-1.pdf").is_file()
    found = json.loads(run.invoke(app, ["score", str(study), "--json"]).stdout)
    assert found["study"] == "hierarchy"
    other = shutil.copytree(study, tmp_path / "other")
    with pytest.raises(SpecError, match="a report is about one hierarchy"):
        run.invoke(app, ["report", str(study), str(other), "--out", str(tmp_path / "x.html")], catch_exceptions=False)
