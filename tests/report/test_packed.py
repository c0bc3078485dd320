"""Replies that are packed into a page: what does not fit is cut and said, and damage is an error."""

from functools import partial
from pathlib import Path

import pytest

import banks
from eyechart.report.page import pack, unpack
from eyechart.studies.battery import browser
from eyechart.studies.battery import page as page_of_battery
from eyechart.studies.battery.page import make_page
from eyechart.studies.battery.scores import score
from eyechart.studies.battery.subjects import read_evidence
from large_runs import wordy
from report_runs import data_of, make_run


def test_what_does_not_fit_is_cut_and_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a page whose packed replies are too long, each keeps as many characters as there is room for."""
    bank = banks.build_bank(tmp_path / "bank")
    run = make_run(bank.root, tmp_path / "run", {"random": partial(wordy, "random")}, conditions=("real", "blank"))
    (evidence,) = read_evidence([run], score=partial(score, resamples=199))
    monkeypatch.setattr(browser, "PACKED_FROM", 500)
    monkeypatch.setattr(page_of_battery, "MOST_CHARACTERS", 0)
    monkeypatch.setattr(page_of_battery, "LEAST_PACKED", 2500)
    page = make_page([evidence])
    assert any("replies are cut after" in note for note in page.notes)
    assert 20 < max(map(len, data_of(page.html.decode())["texts"])) < 200
    assert b'id="packed"' in page.html


def test_packed_values_come_back() -> None:
    """Also signs that could end an element, and halves of signs that no text may have."""
    assert unpack(pack({"a": "</script>"}), 100) == '{"a":"\\u003c/script\\u003e"}'
    assert "<" not in unpack(pack({"texts": ["</script><b>", "漢字 \ud800"], "runs": []}), 1000)


@pytest.mark.parametrize(
    "break_it", [lambda one: one[: len(one) // 8 * 4], lambda one: one[:-4] + "!!!!", lambda _: "AAAA"]
)
def test_damage_is_an_error(break_it: object) -> None:
    """What is cut, is no base64, or was never packed is refused."""
    assert callable(break_it)
    with pytest.raises(ValueError, match=r"."):
        unpack(break_it(pack({"texts": ["word"] * 1000})), 100_000)


def test_what_unpacks_to_too_much_is_refused() -> None:
    """A small file may not fill the memory of who validates it."""
    with pytest.raises(ValueError, match="cut off or too long"):
        unpack(pack(["word" * 1000]), 1000)
