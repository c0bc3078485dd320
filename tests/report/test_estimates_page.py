"""The page of scene estimates: clauses, the worst frames with their views, and what was told beside the truth."""

import csv
import json
import re
from functools import partial
from pathlib import Path

import pytest

import banks
import report_runs
import roads
import voters
from eyechart.calls import Query, Reply
from eyechart.limits import Limits
from eyechart.models import ADAPTERS
from eyechart.modes import RequestMode
from eyechart.report.table import write_tables
from eyechart.studies import battery, structured
from eyechart.studies.battery.subjects import read_evidence, subjects
from eyechart.studies.structured.page import make_estimates_page
from eyechart.studies.structured.scene_answers import faults
from eyechart.studies.structured.tables import scored_of, tables_of

estimates = partial(read_evidence, score=structured.score)
SEES, NEVER = "scripted:scene_positive_control", "scripted:scene_constant"


def ran(bank: Path, out: Path, *specs: str, calls: int | None = None) -> Path:
    """Run the structured study of these models, or a part of it."""
    battery.run(structured.plan("structured", bank, specs, out), limits=Limits(calls=calls))
    return out


def text_of(html: str) -> str:
    """Return a page's words without its markup."""
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", html.partition("<main")[2]))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a run of one that measures and one that sees a free road, on eight pictures of a rover."""
    folder = tmp_path_factory.mktemp("estimates")
    return ran(roads.build_bank(folder / "bank").root, folder / "run", SEES, NEVER)


def test_clauses_and_worst_frames_stand_there_with_their_views(run: Path) -> None:
    """Every clause with value, n and outcome; the frame that most is told wrong of first; pictures through the view."""
    evidence = estimates([run])
    html = make_estimates_page(evidence).html.decode()
    words = text_of(html)
    assert f"Of 2 estimators: admitted 1 ({SEES}); not admitted 1 ({NEVER})" in words
    assert re.search(r"close_accuracy 0\.750 0\.500 \[0\.\d+, 0\.\d+\] 95 % 8 fail share of frames", words)
    assert words.count(" pass ") == 7 + 3
    order = re.findall(r"<h4><bdi>(single-0-\d)</bdi>", html)
    told = evidence[0].score.models[NEVER].answers
    worst = max(range(8), key=lambda place: len(faults(told, place)))
    assert order[0] == told.frames[worst].id
    assert sorted(order) == [frame.id for frame in told.frames]
    near = html[html.index("<bdi>single-0-1</bdi>") :].partition("</article>")[0]
    assert "<td>4.5 m</td><td>close</td><td>taken</td><td>clear</td>" in near
    assert '<td class="wrong">no lead</td><td class="wrong">not close</td><td class="wrong">clear</td>' in near
    assert f"No fault: <bdi>{SEES}</bdi>" in near
    pictures = re.findall(r'src="data:image/webp;base64,([^"]+)"', html)
    assert (len(pictures), len(set(pictures))) == (
        18,
        12,
    )  # two at its head; where both sides are free it is its own reflection
    assert evidence[0].score.manifest.view.startswith("rover@")


def test_the_tables_and_the_page_say_the_same(run: Path, tmp_path: Path) -> None:
    """Of a clause its outcome, of an estimator its row; as CSV, Markdown and LaTeX."""
    written = write_tables(tables_of(scored_of(subjects(estimates([run])))), tmp_path)
    assert len(written) == 9
    rows = (tmp_path / "clauses.csv").read_text().splitlines()
    assert sum(",fail," in row for row in rows) == 4
    controllers = csv.DictReader((tmp_path / "controllers.csv").read_text().splitlines())
    (found,) = [row for row in controllers if row["estimator"] == SEES]
    assert (found["parse"], found["bal. acc."], found["admitted"]) == ("1.0", "1.0", "yes")
    assert "before collision" in (tmp_path / "estimates.md").read_text()


def test_what_is_missing_is_said(run: Path, tmp_path: Path) -> None:
    """Calls that are left, pictures that are gone, and a model that gave no estimate with its words."""
    bank = roads.build_bank(tmp_path / "bank", roads.GAPS_M[:4])
    half = ran(bank.root, tmp_path / "half", SEES, calls=5)
    words = text_of(make_estimates_page(estimates([half])).html.decode())
    assert f"Unfinished: {SEES}: 5 of 8 calls are answered" in words
    assert "It is not admitted yet." in words
    assert "; unfinished: 5 of 8 calls." in words
    for picture in bank.root.glob("images/*"):
        picture.unlink()
    html = make_estimates_page(estimates([half])).html.decode()
    assert "data:image" not in html
    assert "half is shown without pictures, because" in text_of(html)
    both = text_of(make_estimates_page(estimates([run, half])).html.decode())
    assert f"run · {SEES}" in both
    assert f"half · {SEES}" in both


def test_replies_and_names_are_text_whatever_they_hold(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No script but the page's own, no address, no markup of a model's; its words stand where there is no estimate."""
    monkeypatch.setitem(ADAPTERS, "voter", "voters")
    monkeypatch.setattr(voters, "open_model", _hostile)
    run = ran(banks.build_bank(tmp_path / "bank", drawn=False).root, tmp_path / "run", "voter:<script>evil</script>")
    html = make_estimates_page(estimates([run])).html.decode()
    assert "<script" not in report_runs.without_own_script(html)
    assert "&lt;script&gt;window.pwned = 1&lt;/script&gt;" in html
    assert "no estimate: unparsed (no_object)" in html
    assert "default-src &#39;none&#39;" in html
    assert re.findall(r'(?:src|href)="(?!data:|#)([^"]*)"', html) == []


class _Hostile(voters.Voter):
    async def answer(self, query: Query) -> Reply:
        return Reply(report_runs.HOSTILE[query.seed % len(report_runs.HOSTILE)], "stop")


def _hostile(name: str, mode: RequestMode) -> voters.Voter:
    del mode
    return _Hostile(name, {})


def test_a_repaired_reply_is_counted_on_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As the score counts it."""
    monkeypatch.setitem(ADAPTERS, "voter", "voters")
    monkeypatch.setattr(voters, "says", lambda _: Reply(f"```json\n{json.dumps(_SCENE)}\n```", "stop"))
    run = ran(banks.build_bank(tmp_path / "bank", drawn=False).root, tmp_path / "run", "voter:sees")
    assert "Repaired syntax: code_fence 36" in text_of(make_estimates_page(estimates([run])).html.decode())


_SCENE = {"lead_gap_m": 5, "close": True, "left_clear": True, "right_clear": False, "confidence": 1}
