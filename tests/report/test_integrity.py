"""The integrity section counts every call by condition, and names what a run does not cover."""

import re
from dataclasses import replace
from html import unescape
from pathlib import Path

import pytest

import banks
import photographs
import stand_ins
from eyechart.calls import Query, Reply
from eyechart.conditions import seed_of, text_source_frame
from eyechart.frames import open_bank
from eyechart.importing import Choices, import_table
from eyechart.integrity import Guard
from eyechart.models import ADAPTERS
from eyechart.spaces.discrete import Discrete
from eyechart.studies import battery as study
from eyechart.studies.battery.browser import frames_shown
from eyechart.studies.battery.page import counts, make_page, not_covered, sum_counts
from eyechart.studies.battery.subjects import subjects
from eyechart.studies.battery.tables import judged_of, verdict_table
from report_runs import data_of, make_run, read_evidence, report

TWO = Discrete("two", ("HALT", "GO"), (), ("HALT",), ("GO",))
SAID = 'system = "You drive."\nuser = "You go at speed {speed}. Answer {actions}."\n'


def weak(query: Query) -> Reply:
    """Fail for some calls in passing, answer nothing for others, and STOP for the rest."""
    if query.seed % 5 == 0:
        return Reply(error="connection", error_detail="down")
    return Reply("" if query.seed % 5 == 1 else "STOP", "stop")


@pytest.fixture(scope="module")
def weak_run(bank: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a run of twelve frames under four conditions, some of whose calls stay unfinished."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("eyechart.run.random.random", lambda: -1.0)
        folder = tmp_path_factory.mktemp("weak")
        conditions = ["real", "blank", "text_only", "lead_near"]
        models = {"weak": weak, "steady": stand_ins.stop}
        return make_run(bank, folder / "run", models, extent=study.BatterySelection(12), conditions=conditions)


def test_calls_are_counted_by_condition(weak_run: Path) -> None:
    """Planned, answered, attempts (five for what stays down), failures, and what holds no decision, by its reason."""
    (run,) = read_evidence([weak_run])
    one, steady = (counts(who) for who in subjects([run]))
    drawn = sum("lead_near" in frame.counterfactuals for frame in run.frames)
    assert [(row.condition, row.planned) for row in one] == [
        ("real", 12),
        ("blank", 12),
        ("text_only", 12),
        ("lead_near", drawn),
    ]
    for row in one:
        down = row.planned - row.answered
        assert (row.attempts, row.errors) == (row.answered + 5 * down, 5 * down)
        assert row.missing == (0, 0, 0, row.missing[3], down)
        assert row.without == row.missing[3] + down
    assert sum(row.errors for row in one) > 0 < sum(row.missing[3] for row in one)
    assert all((row.answered, row.attempts, row.without) == (row.planned, row.planned, 0) for row in steady)
    both = sum_counts([one, steady])
    assert [row.planned for row in both] == [2 * row.planned for row in one]
    assert both[1].missing == one[1].missing


def test_what_is_not_covered_is_named(weak_run: Path) -> None:
    """Conditions that were not chosen or cannot be shown, frames and calls left, and tests that cannot say."""
    (run,) = read_evidence([weak_run])
    said = "\n".join(not_covered(run))
    assert "condition mirrored was not run: it was not chosen" in said
    assert "condition text_swapped was not run: prompt 'baseline' says nothing of a frame" in said
    assert "6 of the bank's 18 frames were not used (--limit)" in said
    assert re.search(r"standin:weak: \d+ of 4\d planned calls are not finished", said)
    assert re.search(r"cannot say: .*depth_interventional.* \(0 counterfactual pairs", said)
    assert said.endswith("not tested by any run: other prompts, other cameras, closed loop")


def test_the_page_shows_the_counts(weak_run: Path, tmp_path: Path) -> None:
    """A table over all models, and one a model."""
    made = report(weak_run, tmp_path / "page.html").html
    assert made.count("<caption>Calls by condition, ") == 3
    table = made.partition("<caption>Calls by condition, standin:steady</caption>")[2].partition("</table>")[0]
    row = re.search(r"<code>blank</code></th>(.*?)</tr>", table)
    assert row is not None
    assert re.findall(r"<td>(.*?)</td>", row.group(1))[:6] == ["12", "12", "12", "0", "0", "0"]
    for line in not_covered(read_evidence([weak_run])[0]):
        assert f"<li>{line}</li>" in unescape(made)


@pytest.fixture
def rover(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the run of an imported bank without a gap, a mirror axis or scenarios, whose prompt says the speed."""
    monkeypatch.setitem(ADAPTERS, "driver", "photographs")
    rows = photographs.rows(drives=3, ticks=4)
    photographs.take(tmp_path / "photos", rows)
    (tmp_path / "t.csv").write_text(photographs.as_csv(rows, without=["lidar_m", "place"]))
    (tmp_path / "prompt.toml").write_text(SAID)
    places = {"file": "photo", "episode": "drive", "step": "tick"}
    import_table(
        tmp_path / "photos",
        tmp_path / "t.csv",
        tmp_path / "bank",
        Choices(columns=places, prompt_columns=("speed",), space=TWO, picture="a rover's camera"),
    )
    models = ["driver:looks", "driver:listens"]
    study.run(study.plan(tmp_path / "bank", models, tmp_path / "run", prompt=str(tmp_path / "prompt.toml")))
    return tmp_path / "run"


def test_an_imported_bank_says_by_name_what_it_lacks(rover: Path, tmp_path: Path) -> None:
    """Sections without data say "cannot say" and why; the action space is the owner's."""
    html = unescape(report(rover, tmp_path / "page.html").html)
    assert html.count("Cannot say: the bank records no gap.") == 2
    assert "Cannot say: the run has no answers to counterfactual pictures, so distance was not tested" in html
    assert "Cannot say: no action of this space exchanges under reflection." in html
    assert re.search(r"cannot say: .*depth_observational.* \(the bank records no gap\)", html)
    assert "condition mirrored was not run: no frame has a mirror axis" in html
    assert "HALT, GO" in html
    assert "none is exchanged by reflection" in html
    assert data_of(html)["runs"][0]["actions"] == ["HALT", "GO"]


def test_a_run_that_cannot_say_is_named_beside_one_that_can(rover: Path, bank: Path, tmp_path: Path) -> None:
    """Each section has the figures of the one, and says of the other why it has none."""
    other = make_run(bank, tmp_path / "boxes", {"steady": stand_ins.stop})
    page = make_page(read_evidence([rover, other]))
    html = page.html.decode()
    assert html.count("Cannot say for <bdi>run</bdi>: the bank records no gap.") == 2
    assert html.count("Cannot say for <bdi>run</bdi>: ") == 4
    assert "Cannot say for <bdi>boxes</bdi>" not in html
    assert [one.of for one in page.drawings["gap"]] == ["boxes · standin:steady"]


def test_the_page_says_what_a_prompt_said_of_a_frame(rover: Path, tmp_path: Path) -> None:
    """Of the frame itself, and under text_swapped of which other frame."""
    held = data_of(report(rover, tmp_path / "page.html").html)["runs"][0]
    (run,) = read_evidence([rover])
    bank = replace(open_bank(rover.parent / "bank"), said=("speed",))
    for frame in held["frames"]:
        own = bank.frame(frame["id"])
        other = text_source_frame(own, bank, seed_of("text_swapped", own, run.score.manifest.seed))
        assert frame["said"] == [["speed", own.fields["speed"]]]
        assert frame["told"] == {"text_swapped": [other.id, [["speed", other.fields["speed"]]]]}
        assert other.fields["speed"] != own.fields["speed"]


def test_a_page_lists_no_more_frames_than_it_can_hold(bank: Path, tmp_path: Path) -> None:
    """Frames evenly from every episode, and a sentence that says how many."""
    evidence = read_evidence([make_run(bank, tmp_path / "run", {"steady": stand_ins.stop})])
    (every,) = frames_shown(evidence)
    assert every == tuple(range(18))
    (some,) = frames_shown(evidence, frames=7)
    assert len(some) == 7
    assert len({evidence[0].frames[place].episode for place in some}) == 6
    (few,) = frames_shown(evidence, calls=60)
    assert len(few) == 60 // 11
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("eyechart.studies.battery.page.frames_shown", lambda _: (some,))
        page = make_page(evidence)
    assert "The browser lists 7 of 18 frames, evenly from every episode" in page.html.decode()
    held = data_of(page.html.decode())["runs"][0]
    assert (len(held["frames"]), held["asked"], len(held["pictures"]["real"])) == (7, 18, 7)


def test_a_run_that_stopped_early_says_so_and_is_not_partial(tmp_path: Path) -> None:
    """The card shows the e-value and the calls, and nobody is told to go on with calls that are left out for good."""
    root = banks.build_bank(tmp_path / "bank", episodes=6, steps=6).root
    run = make_run(root, tmp_path / "run", {"steady": stand_ins.stop}, extent=study.BatterySelection(stop_early=True))
    (evidence,) = read_evidence([run])
    stopped = evidence.score.models["standin:steady"].stopped
    assert stopped is not None
    html = unescape(report(run, tmp_path / "page.html").html)
    assert f"<dd>{stopped.calls} of {stopped.planned}</dd>" in html
    assert f"standin:steady: {stopped.words()}" in html
    assert '<span class="flag">stopped early</span>' in html
    assert '<span class="flag">partial</span>' not in html
    assert "planned calls are not finished" not in html


@pytest.mark.slow
def test_a_failed_guard_marks_the_verdict_wherever_it_stands(bank: Path, tmp_path: Path) -> None:
    """On the card, in the table at a glance, among the guards, and in the tables for other programs."""
    models = dict.fromkeys(("a", "b", "c", "d", "e"), stand_ins.stop)
    (run,) = read_evidence([make_run(bank, tmp_path / "run", models)])
    wrong, right = Guard("pictures_arrive", False, "the picture costs no token"), Guard("pictures_arrive", True, "yes")
    guards = {spec: (wrong if spec == "standin:b" else right,) for spec in run.verdicts}
    score = replace(run.score, guards=guards)
    marked = replace(run, score=score)
    html = unescape(make_page([marked]).html.decode())
    mark = "Not to be relied on:</strong> guard 'pictures_arrive' failed: the picture costs no token."
    assert html.count(mark) == html.count("Not to be relied on") == 1
    assert html.count("! guard failed") == 1
    assert html.count("✗ fails</span></td><td>the picture costs no token") == 1
    assert "all 5 models" not in html
    healthy = replace(run, score=replace(score, guards=dict.fromkeys(guards, (right,))))
    assert "all 5 models" in make_page([healthy]).html.decode()
    assert [row[-1] for row in verdict_table(judged_of(subjects([marked]))).rows] == ["", "pictures_arrive", "", "", ""]
