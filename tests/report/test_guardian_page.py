"""The guardian's page: what was missed stands there with its views, and nothing on it is fetched or runs."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

import voters
from banks import build_bank
from eyechart.frames import FrameBank
from eyechart.guardian.page import choice_lines, curve, guardian_page, row_names, score_lines
from eyechart.models import ADAPTERS
from eyechart.studies import guardian as study
from report_runs import without_own_script


@pytest.fixture
def bank(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> FrameBank:
    """Return a bank of boxes, whose voters can be asked."""
    monkeypatch.setitem(ADAPTERS, "voter", "voters")
    return build_bank(tmp_path / "bank", episodes=3, steps=4, drawn=False)


def test_what_was_missed_is_shown_with_its_views_and_votes(bank: FrameBank, tmp_path: Path) -> None:
    """A committee that never sees a hazard: each is listed, marked in the table of votes, and pictured twice."""
    table = voters.ask_all(bank.root, ("never",), tmp_path / "run")
    chosen, rest = table.frames[:12], table.frames[12:]
    frozen = study.fit(table.keep(chosen), size=1)
    found = study.score(frozen, table.keep(rest))
    html = guardian_page(found, bank).html.decode()
    assert guardian_page(found, bank).html.decode() == html
    assert len(found.missed) == int(table.keep(rest).hazard.sum()) > 0
    assert len(re.findall(r'src="data:image/webp;base64,', html)) == 2 * len(found.missed)
    assert len(re.findall(r'<tr class="missed">', html)) == len(found.missed)
    for frame in rest:
        assert frame in html
    assert "original: voter:never clear" in html
    assert "Cannot say: no episodes were kept for a bound" in html
    without = guardian_page(found, None).html.decode()
    assert "data:image" not in without
    assert "give the bank with --frames" in without


def test_the_curve_has_the_pages_colours_and_an_interval_that_there_is_not_has_a_reason(
    bank: FrameBank, tmp_path: Path
) -> None:
    """Black axes would not be seen on a dark page; where nobody errs, it says why there is no interval."""
    table = voters.ask_all(bank.root, ("sees",), tmp_path / "run")
    frozen = study.fit(table.keep(table.frames[:12]), size=1)
    found = study.score(frozen, table.keep(table.frames[12:]))
    drawn = curve(found).svg(inline=True)
    assert "#000000" not in drawn
    assert "currentColor" in drawn
    said = next(score_lines(found))
    assert "bal" in said
    assert "acc, sens, spec: share of frames, 95% interval over episodes" in said


def test_a_committee_that_is_no_better_than_chance_is_said_to_be_none(bank: FrameBank, tmp_path: Path) -> None:
    """One that never says hazard; one that sees is not called so."""
    table = voters.ask_all(bank.root, ("never", "sees"), tmp_path / "run")
    blind, seeing = (study.fit(table, size=1, models=(f"voter:{name}",)) for name in ("never", "sees"))
    words = "no better than chance"
    assert (words in " ".join(choice_lines(blind)), words in " ".join(choice_lines(seeing))) == (True, False)


@pytest.mark.parametrize(("threshold", "ties"), [(1, "1–3 to 2–2"), (2, "2–2"), (3, "2–2"), (4, "2–2 to 3–1")])
def test_the_abstaining_row_says_which_votes_it_hands_on(
    bank: FrameBank, tmp_path: Path, threshold: int, ties: str
) -> None:
    """At the paper's thresholds the ties, and at 1 and 4 what threshold and majority say differently too."""
    frozen = study.fit(voters.ask_all(bank.root, ("never", "sees"), tmp_path / "run"))
    assert row_names(replace(frozen, threshold=threshold))["abstain"] == f"guardian, abstain on {ties}"


def test_nothing_on_it_is_fetched_or_runs(bank: FrameBank, tmp_path: Path) -> None:
    """No script but the page's own, no address; a model's name is text whatever it holds."""
    table = voters.ask_all(bank.root, ("sees",), tmp_path / "run")
    evil = "m<script>alert(1)</script>"
    named = replace(table, models=(evil,), about=study.VoteProvenance())
    frozen = study.fit(named.keep(named.frames[:12]), size=1)
    found = study.score(frozen, named.keep(named.frames[12:]))
    html = guardian_page(found, bank).html.decode()
    assert "<script" not in without_own_script(html)
    assert "m&lt;script&gt;" in html
    assert "default-src &#39;none&#39;" in html
    fetched = re.findall(r'(?:src|href)="(?!data:|#)([^"]*)"', html)
    assert fetched == []
