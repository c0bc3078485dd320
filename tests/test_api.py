"""The main job from Python: what a notebook shows, and that nothing which a model or a file says becomes markup."""

import asyncio
import os
import signal
import subprocess
import sys
import threading
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest

import stand_ins
from banks import build_bank
from eyechart import models
from eyechart.api import Report, read_report, run_battery
from eyechart.api import build_bank as build
from eyechart.calls import Query, Reply
from eyechart.errors import LedgerError, SpecError
from eyechart.manifest import LEDGER
from eyechart.modes import RequestMode
from eyechart.spaces.reader import READER
from eyechart.stats.statistic import Statistic
from eyechart.studies import battery
from eyechart.studies.battery.page import make_page
from eyechart.studies.battery.subjects import evidence_of, find_pictures
from eyechart.testing import assert_grounded
from eyechart.verdicts import Ruling, Verdict, judge
from known import Demo
from seeing import served

EVIL = "<script>alert(1)</script>&\"'"


class Page(HTMLParser):
    """Notes the tags and the text of a piece of HTML, and that every tag is closed in its turn."""

    def __init__(self, html: str) -> None:
        super().__init__(convert_charrefs=True)
        self.tags: list[str] = []
        self.attributes: set[str] = set()
        self.words: list[str] = []
        self._open: list[str] = []
        self.feed(html)
        self.close()
        assert self._open == []

    @property
    def text(self) -> str:
        """Return all text, its lines joined."""
        return " ".join(self.words)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note a tag."""
        self.tags.append(tag)
        self.attributes |= {name for name, _ in attrs}
        self._open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        """Close the last tag, which must be this one."""
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        """Note a text."""
        self.words.append(data)


@pytest.fixture
def stand_in(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make ``standin:NAME`` a SPEC for one test."""
    monkeypatch.setitem(models.ADAPTERS, "standin", "stand_ins")


@pytest.fixture(scope="module")
def report(demo: Demo) -> Report:
    """Return the report on the demo's run."""
    return read_report(demo.run, resamples=500)


@pytest.mark.slow
def test_it_says_what_the_steps_say(report: Report, demo: Demo) -> None:
    """One call is the steps in their order: score, then judge."""
    steps = judge(battery.score(demo.run, resamples=500))
    assert {spec: verdict.as_dict() for spec, verdict in report.verdicts.items()} == {
        spec: step.as_dict() for spec, step in steps.items()
    }
    assert list(report) == list(steps)
    assert len(report) == 16
    assert report["scripted:depth"].calibrated.label == "depth"


def test_a_model_that_is_not_in_the_run_is_told_which_are(report: Report) -> None:
    """A wrong name lists the known ones."""
    with pytest.raises(SpecError, match=r"no model 'depth'; it holds scripted:constant, "):
        report["depth"]


def test_it_builds_runs_and_reads_in_three_lines(tmp_path: Path) -> None:
    """Paths may be words, one model needs no list, and a bank may be given as it was returned."""
    bank = build(str(tmp_path / "bank"), seeds=(0,), steps=4)
    assert repr(bank) == f"<FrameBank {bank.name}: 16 frames, 4 episodes, in {tmp_path / 'bank'}>"
    ran = run_battery(bank, "scripted:depth", str(tmp_path / "run"), seed=3)
    again = run_battery(str(tmp_path / "bank"), ["scripted:depth"], tmp_path / "run", seed=3)
    assert ran.verdicts == again.verdicts == read_report(str(tmp_path / "run")).verdicts
    assert ran.score.manifest.seed == 3
    assert repr(ran) == f"<Report on {tmp_path / 'run'}: scripted:depth: {ran['scripted:depth'].calibrated.label}>"
    assert repr(ran.score) == f"<BatteryScore of scripted:depth on {bank.name}>"
    with pytest.raises(TypeError, match="'promt'"):
        run_battery(bank, "scripted:depth", tmp_path / "mistyped", promt="minimal")
    assert not (tmp_path / "mistyped").exists()


def test_a_folder_that_is_no_run_is_refused(tmp_path: Path) -> None:
    """By the error of the command line."""
    with pytest.raises(LedgerError, match="does not exist"):
        read_report(tmp_path)


@pytest.mark.usefixtures("stand_in")
def test_it_runs_where_an_event_loop_runs_already(tmp_path: Path) -> None:
    """As in a notebook, whose cells are run inside a loop; the calls and the progress are the same."""
    bank = build_bank(tmp_path / "bank")
    moves: list[tuple[int, int]] = []

    async def cell() -> Report:
        return run_battery(bank, "standin:noisy", tmp_path / "inside", progress=lambda *move: moves.append(move))

    inside = asyncio.run(cell())
    outside = run_battery(bank, "standin:noisy", tmp_path / "outside")
    assert inside.rows() == outside.rows()
    assert moves[-1] == (moves[-1][1], moves[-1][1])
    assert moves[-1][0] == inside.score.models["standin:noisy"].planned


@pytest.mark.usefixtures("stand_in")
def test_an_interrupt_in_a_notebook_ends_the_calls_and_the_next_cell_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C stops the thread that makes the calls, keeps the finished ones, and no call is made twice."""
    slow = stand_ins.StandIn(pause_s=0.02)
    monkeypatch.setattr(stand_ins, "open_model", lambda *_: slow)
    bank, asked = build_bank(tmp_path / "bank"), threading.Event()

    def move(done: int, total: int) -> None:
        del total
        if done > 5:
            slow.pause_s = 120.0  # nothing comes back any more
            asked.set()

    async def cell() -> None:
        run_battery(bank, "standin:steady", tmp_path / "run", progress=move)

    def interrupt() -> None:
        asked.wait(30)
        os.kill(os.getpid(), signal.SIGINT)

    before_it = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it
    threading.Thread(target=interrupt, daemon=True).start()
    loop = asyncio.new_event_loop()  # as a notebook's kernel: no handler of its own for the signal
    with pytest.raises(KeyboardInterrupt):
        loop.run_until_complete(cell())
    loop.close()
    signal.signal(signal.SIGINT, before_it)
    slow.pause_s = 0.0
    partial = read_report(tmp_path / "run")["standin:steady"]
    assert partial.notes[0].startswith("unfinished: ")
    assert "(unfinished: " in partial._repr_html_()
    before = stand_ins.rows_in(tmp_path / "run" / "ledger.sqlite", "attempts")
    report = run_battery(bank, "standin:steady", tmp_path / "run")
    score = report.score.models["standin:steady"]
    assert score.answered == score.planned > before > 5


def test_the_rows_hold_every_statistic_as_plain_values(report: Report) -> None:
    """A row a model and statistic, ready for a data frame; what cannot be said is None."""
    rows = report.rows()
    assert len(rows) == sum(len(model.statistics) for model in report.score.models.values())
    assert all(type(value) in {str, int, float, type(None)} for row in rows for value in row.values())
    by_name = {(row["model"], row["statistic"]): row for row in rows}
    found = report.score.models["scripted:depth"].statistics["idi_adj"]
    row = by_name["scripted:depth", "idi_adj"]
    assert (row["value"], row["n"], (row["low"], row["high"])) == (found.value, found.n, found.ci)
    assert by_name["scripted:depth", "cramers_v"]["p_holm"] == report.score.models["scripted:depth"].holm["cramers_v"]
    assert by_name["scripted:depth", "idi_adj"]["p_holm"] is None
    assert by_name["scripted:depth", "mirror_swap_rate"]["value"] is None


def test_the_words_of_a_verdict_are_those_of_the_command(report: Report, demo: Demo) -> None:
    """``print(verdict)`` and ``eyechart verdict`` say the same, and repr is one line."""
    verdict = report["scripted:one_sided"]
    assert str(verdict).splitlines()[0] == "scripted:one_sided: depth, evidence controlled"
    for part in (
        f"{verdict.answer}: {verdict.calibrated.because}",
        verdict.lateral.because,
        verdict.trust,
        *verdict.notes,
    ):
        assert f"\n  {part}" in str(verdict)
    assert repr(verdict) == "<Verdict on scripted:one_sided: depth; lateral one_sided; paper's rules depth>"
    assert str(report).count("\n  ") > 16
    assert str(report).splitlines()[-1].startswith("Scope: On bank ")
    assert demo.run.name in repr(report)


def test_a_card_holds_all_that_a_verdict_must_not_be_shown_without(report: Report) -> None:
    """The answer first; label, sentence, deciding statistic with its numbers, other rules, notes and scope."""
    for verdict in report.verdicts.values():
        page = Page(verdict._repr_html_())
        deciding = verdict.calibrated.statistic
        assert deciding is not None
        assert " ".join(page.text.split()).startswith(f"{verdict.model} {verdict.answer} {verdict.headline} ")
        for words in (
            verdict.model,
            verdict.calibrated.label,
            verdict.trust,
            str(verdict.calibrated.reason)[1:],
            f"{verdict.calibrated.decided_by} = ",
            f"n = {deciding.n}",
            *(() if deciding.p is None else ("p = ",)),
            f"{verdict.lateral.label}: {verdict.lateral.because}",
            f"{verdict.paper.label}: {verdict.paper.because}",
            *verdict.notes,
            verdict.scope,
        ):
            assert words in page.text
        if deciding.ci is not None:
            assert f"[{deciding.ci[0]:.3f}, {deciding.ci[1]:.3f}]" in page.text


def test_a_report_shows_every_card_and_the_scope(report: Report) -> None:
    """One card a model, in order."""
    page = Page(report._repr_html_())
    places = [page.text.index(verdict.scope) for verdict in report.verdicts.values()]
    assert places == sorted(places)
    assert "not tested: other prompts, other cameras, closed loop." in page.text


def test_a_statistic_that_cannot_say_is_dashes() -> None:
    """No value, interval or p is made up, and a ruling without a statistic shows its name alone."""
    silent = Ruling("undecided", "bound_blank", "nothing", Statistic(None, 0))
    bare = Ruling("not_tested", "mirror_swap_rate", "no mirror axis")
    verdict = Verdict("m", bare, silent, bare, "none", "It may not.", "On nothing.", ())
    text = Page(verdict._repr_html_()).text
    assert "bound_blank = —, n = 0" in text
    assert "mirror_swap_rate" in Page(replace(verdict, calibrated=bare)._repr_html_()).text


def test_nothing_that_is_told_becomes_markup(report: Report) -> None:
    """A model's name, a reason, a note, a scope and a path are text, whatever tags they hold."""
    honest = report["scripted:depth"]
    tags, attributes = set(Page(honest._repr_html_()).tags), Page(honest._repr_html_()).attributes
    ruling = Ruling(EVIL, EVIL, EVIL, Statistic(1.0, 3))
    verdict = Verdict(EVIL, ruling, ruling, ruling, EVIL, EVIL, EVIL, (EVIL, EVIL))
    card = Page(verdict._repr_html_())
    assert set(card.tags) == tags
    assert card.attributes == attributes == {"style", "scope"}
    assert card.text.count(EVIL) == 15
    page = Page(replace(report, path=Path(EVIL), verdicts={EVIL: verdict})._repr_html_())
    assert set(page.tags) == tags | {"strong"}


@pytest.mark.usefixtures("stand_in")
def test_a_hostile_reply_stays_out_of_the_report(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a model writes is nowhere in the HTML as a tag."""

    def hostile(query: Query) -> Reply:
        return Reply(EVIL if query.image is None else "STOP", "stop")

    monkeypatch.setattr(stand_ins, "open_model", lambda *_: stand_ins.StandIn(hostile))
    html = run_battery(build_bank(tmp_path / "bank"), "standin:x", tmp_path / "run")._repr_html_()
    assert "script" not in Page(html).tags
    assert "<script" not in html


@pytest.mark.usefixtures("stand_in")
def test_a_report_is_written_as_the_page_of_the_command(tmp_path: Path) -> None:
    """The page of ``eyechart report`` for this score, byte by byte, with every model of the run."""
    report = run_battery(build_bank(tmp_path / "bank"), ["standin:noisy", "standin:steady"], tmp_path / "run")
    written = report.to_html(tmp_path / "page.html")
    html = written.read_bytes()
    assert all(spec.encode() in html for spec in report)
    pictures = find_pictures(report.score.manifest, report.score.bank, report.path)
    evidence = evidence_of(report.path.name, report.score, report.path / LEDGER, *pictures)
    assert html == make_page([evidence]).html


@pytest.mark.usefixtures("stand_in")
def test_the_page_is_of_the_score_that_was_asked_for(tmp_path: Path) -> None:
    """A run that was read anew on purpose is shown so, and is not read again with other options."""
    run_battery(build_bank(tmp_path / "bank"), "standin:noisy", tmp_path / "run", limit=4)
    manifest = tmp_path / "run" / "run.json"
    manifest.write_text(manifest.read_text().replace(f'"reader": {READER}', '"reader": 0'))
    anew = read_report(tmp_path / "run", resamples=100, reread=True)
    assert "standin:noisy" in anew.to_html(tmp_path / "page.html").read_text()
    with pytest.raises(AssertionError, match="standin:noisy depth"):
        assert_grounded(tmp_path / "run", resamples=100, reread=True)
    with pytest.raises(SpecError, match="episode"):
        assert_grounded(tmp_path / "run", reread=True, independent=True)


def test_a_report_without_models_says_so(report: Report) -> None:
    """An empty run is no good news."""
    empty = replace(report, score=replace(report.score, models={}), verdicts={})
    assert "holds no model" in Page(empty._repr_html_()).text
    assert "no model" in repr(empty)
    assert "holds no model" in str(empty)


def test_importing_eyechart_imports_nothing_else() -> None:
    """``import eyechart`` is the version and nothing heavy."""
    code = "import sys, eyechart; print([m for m in sys.modules if m.startswith('eyechart.') or m == 'numpy'])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


def test_a_served_model_is_probed_once_from_python_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Given by its SPEC; inside an event loop as in a notebook; not again when the run goes on."""
    bank = build_bank(tmp_path / "bank", scenarios=["light", "dense"], episodes=1)

    async def notebook() -> Report:
        return run_battery(bank, "openai:m", tmp_path / "run", limit=1)

    with served(only_new_tokens=True) as server:
        monkeypatch.setattr("eyechart.models.openai_compatible.BASE_URL", server.base_url)
        monkeypatch.setenv("OPENAI_API_KEY", "x")
        manifest = asyncio.run(notebook()).score.manifest
        requests = server.requests
        assert manifest.mode("openai:m").token_field != RequestMode("openai:m").token_field
        assert manifest.mode("openai:m").measured.sees_image is True
        assert requests == manifest.probes["openai:m"].calls + len(manifest.conditions)
        run_battery(bank, "openai:m", tmp_path / "run", limit=2)
        assert server.requests == requests + len(manifest.conditions)
        asked = run_battery(bank, "openai:m", tmp_path / "other", limit=1, probe=False).score.manifest
        assert (asked.probes, asked.mode("openai:m").measured) == ({}, None)
