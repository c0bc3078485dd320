"""``run battery --stop-early`` from bank to verdict: what stops, what is printed, what resumes, what is refused."""

import functools
import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

import banks
import stand_ins
from eyechart.calls import Query, Reply
from eyechart.cli.app import app
from eyechart.compare import compare
from eyechart.errors import LedgerError, SpecError
from eyechart.frames import FrameBank
from eyechart.gate import hold
from eyechart.ledger import Ledger
from eyechart.limits import Limits
from eyechart.manifest import LEDGER, read_run
from eyechart.models import ADAPTERS
from eyechart.spaces.space import Decision
from eyechart.studies import battery as study
from eyechart.studies.battery.early_stop import NEEDED, EarlyStop, WholeRun, layout_for
from eyechart.verdicts import NOT_JUDGED, judge
from known import Demo

pytestmark = pytest.mark.slow

STEADY, LOSING, LOCKED = "standin:steady", "standin:losing", "standin:locked"
EARLY = study.BatterySelection(stop_early=True)
SCORED = functools.cache(functools.partial(study.score, resamples=99))
"""Scores a run that no test changes once, with few resamples."""
CLEAR = ("constant", "truncating", "depth", "presence", "depth_lateral", "refuse_blank")


def losing(query: Query) -> Reply:
    """Answer nothing that holds a decision, every second time."""
    return Reply("I'm sorry, I can't help with that.", "stop") if query.seed % 2 else Reply("SLOW", "stop")


def locked(query: Query) -> Reply:
    """Fail as an endpoint does that takes no picture."""
    del query
    return Reply(error="bad_request", error_detail="400")


@pytest.fixture(autouse=True)
def _installed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make three stand-ins SPECs, each with pauses so that calls end in another order than they began."""
    answers = {"steady": stand_ins.stop, "losing": losing, "locked": locked}
    monkeypatch.setattr(stand_ins, "open_model", lambda name, _: stand_ins.StandIn(answers[name], pause_s=0.004))
    monkeypatch.setitem(ADAPTERS, "standin", "stand_ins")


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of 72 tiny frames without counterfactual pictures that no test changes."""
    return banks.build_bank(tmp_path_factory.mktemp("early") / "bank", episodes=4, steps=6, drawn=False)


@pytest.fixture(scope="module")
def stopped(bank: FrameBank, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a run that stopped two models early, one call at a time, and that no test changes."""
    out = tmp_path_factory.mktemp("stopped") / "run"
    ADAPTERS["standin"] = "stand_ins"
    before, stand_ins.open_model = stand_ins.open_model, _quick
    try:
        study.run(study.plan(bank.root, [STEADY, LOSING], out, extent=EARLY), concurrency=1)
    finally:
        stand_ins.open_model = before
        del ADAPTERS["standin"]
    return out


def _quick(name: str, _: object) -> stand_ins.StandIn:
    return stand_ins.StandIn({"steady": stand_ins.stop, "losing": losing}[name])


@pytest.fixture(scope="module")
def highway(demo: Demo, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Result]:
    """Return a run of six controllers on the demo's highway bank that stops early, and what the command printed."""
    out = tmp_path_factory.mktemp("highway") / "run"
    models = [word for name in CLEAR for word in ("--model", f"scripted:{name}")]
    words = ["run", "battery", *models, "--frames", str(demo.bank), "--out", str(out), "--stop-early"]
    return out, CliRunner().invoke(app, words)


def test_a_stop_is_judged_by_what_a_whole_run_reads_of_its_bank(bank: FrameBank, tmp_path: Path) -> None:
    """The gaps, how control pictures were made, and the run's seed."""
    planned = study.plan(bank.root, [STEADY], tmp_path / "run", extent=EARLY)
    gap = bank.manifest.gap
    assert gap is not None
    assert layout_for(planned.plan, STEADY).whole == WholeRun(gap, bank.manifest.provenance, seed=planned.plan.seed)


ORDERED = "picture_before"
"""The number that reads the order of the calls, which a run that may stop makes frame by frame."""


def test_on_real_pictures_the_verdicts_are_those_of_the_whole_battery(demo: Demo, highway: tuple[Path, Result]) -> None:
    """The same labels, lateral ones too, with half of the calls saved; of depth a third, with its numbers."""
    out, _ = highway
    whole, early = (judge(study.score(run, resamples=199)) for run in (demo.run, out))
    for name in CLEAR:
        one, full = early[f"scripted:{name}"], whole[f"scripted:{name}"]
        assert one.stopped is not None
        late = (full.calibrated.label, full.lateral.label)
        assert (one.calibrated.label, one.lateral.label) == late, name
        most = 0.7 if one.stopped.is_whole else 1 / 2
        assert one.stopped.calls + one.stopped.beyond <= one.stopped.planned * most
        assert one.paper.label == NOT_JUDGED
        assert full.stopped is None
        early_numbers, numbers = ([number for number in of.numbers if number.name != ORDERED] for of in (one, full))
        assert (early_numbers == numbers) is one.stopped.is_whole or not numbers, name
        assert [number.outcome for number in one.numbers] == [number.outcome for number in full.numbers]


def test_the_run_prints_its_guarantee_the_most_the_typical_and_the_saved(highway: tuple[Path, Result]) -> None:
    """Before the first call and after the last one, on standard error."""
    _, ran = highway
    assert ran.exit_code == 0, ran.output
    said = ran.stderr.splitlines()
    promise = next(line for line in said if "a false early verdict" in line)
    assert "at most 0.05 a model, however often one looks" in promise
    assert any("frames in random order" in line and "episode" in line for line in said)
    typical = next(line for line in said if "repeats never differ" in line)
    assert "at most 2894 calls per model" in typical
    assert "1687 (depth)" in typical
    assert any(line.startswith("scripted:depth: stopped early after ") and "calls saved (3" in line for line in said)
    total = next(line for line in said if line.startswith("calls saved: "))
    assert "of 11757" in total


@pytest.mark.usefixtures("few_pictures")
def test_the_card_of_an_early_depth_shows_its_test_and_that_of_an_absence_its_e_value(
    highway: tuple[Path, Result], tmp_path: Path
) -> None:
    """A share is never printed as an e-value; the page says how many controls any model was asked."""
    out, _ = highway
    CliRunner().invoke(app, ["report", str(out), "--out", str(tmp_path / "page.html")])
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    cards = {text.partition("</bdi>")[0]: text for text in page.split("<h3><bdi>")[1:]}
    depth, blind = (cards[f"scripted:{name}"].partition("</article>")[0] for name in ("depth", "constant"))
    assert "<dt>90 % interval</dt>" in depth
    assert "<dt>e-value</dt>" not in depth
    assert "<dt>e-value</dt>" in blind
    assert "each under 11 conditions and up to 8 controls; prompt" in page


def test_a_gate_takes_a_stopped_run_for_complete(highway: tuple[Path, Result]) -> None:
    """Depth holds, its absence fails, and the reason says that the run stopped early, and by what."""
    out, _ = highway
    held = {check.model: check for check in hold(SCORED(out), ["depth"]).checks}
    assert held["scripted:depth"].holds
    assert held["scripted:depth_lateral"].holds
    assert not held["scripted:presence"].holds
    because = held["scripted:depth"].because
    assert "stopped early after 1687 of 2592 calls, as depth was settled" in because
    assert "of 100 comparisons the wrong way round (bound of 95 %): order = " in because
    rate = hold(SCORED(out), ["depth"], max_unparsed=0.9).checks[1]
    assert (rate.requirement, rate.holds) == ("max_unparsed", None)
    assert "stopped early" in rate.because


def test_verdict_and_score_say_that_a_run_stopped_early(
    highway: tuple[Path, Result], monkeypatch: pytest.MonkeyPatch
) -> None:
    """After how many calls, by which rule, and the e-values; what was asked of all frames keeps its p."""
    out, _ = highway
    monkeypatch.setattr("eyechart.studies.battery.study.score", lambda folder, **_: SCORED(folder))
    shown = CliRunner().invoke(app, ["verdict", str(out)], env={"COLUMNS": "200"}).output
    assert "(1687/2592)" in shown
    assert "stopped early after 1687 of 2592 calls, as depth was settled" in " ".join(shown.split())
    judged = json.loads(CliRunner().invoke(app, ["verdict", str(out), "--json"]).stdout)["models"]["scripted:depth"]
    assert judged["stopped_early"]["rule"] == "depth"
    assert (judged["stopped_early"]["calls"], judged["stopped_early"]["planned"]) == (1687, 2592)
    assert judged["stopped_early"]["saved"] == 2592 - 1687 - judged["stopped_early"]["beyond"]
    assert (judged["paper"], judged["decided_by"]) == (NOT_JUDGED, "order")
    raw = json.loads(CliRunner().invoke(app, ["score", str(out), "--json"]).stdout)
    assert raw["stop_early"] is True
    scored = raw["models"]["scripted:depth"]
    assert scored["stopped"]["rule"] == "depth"
    deciding = scored["statistics"]["early.near_far"]
    assert deciding["value"] > 100
    assert "e-process against" in deciding["method"]
    ordinary = {name: one for name, one in scored["statistics"].items() if not name.startswith("early.")}
    bare = {name for name, one in ordinary.items() if one["p"] is None and one["ci"] is None}
    assert {"idi", "presence", "content_shuffled", "bound_blank", "cramers_v"} <= bare
    assert bare.isdisjoint({"depth_interventional", "sensitivity", "specificity", "order", "rise", "file"})
    assert ordinary["idi"]["value"] is not None
    blind = raw["models"]["scripted:constant"]["statistics"]
    assert all(one["p"] is None and one["ci"] is None for name, one in blind.items() if not name.startswith("early."))
    table = CliRunner().invoke(app, ["score", str(out), "--all"], env={"COLUMNS": "200"}).output
    assert "1687 of 2592 calls" in table


def test_scoring_twice_gives_the_same_bytes(stopped: Path) -> None:
    """The stop is computed again from manifest, bank and ledger alone."""
    one, other = (study.score(stopped, resamples=99) for _ in range(2))
    assert json.dumps(one.as_dict()) == json.dumps(other.as_dict())
    assert {spec: score.stopped and score.stopped.label for spec, score in one.models.items()} == {
        STEADY: "image_invariant",
        LOSING: "not_scorable",
    }


def test_what_ended_after_the_stop_changes_nothing(bank: FrameBank, stopped: Path, tmp_path: Path) -> None:
    """With sixteen calls under way some overtake others and end after the stop: beyond it, and in no statistic."""
    study.run(study.plan(bank.root, [STEADY, LOSING], tmp_path / "run", extent=EARLY), concurrency=16)
    slow, fast = study.score(stopped, resamples=99), study.score(tmp_path / "run", resamples=99)
    for spec in (STEADY, LOSING):
        one, other = slow.models[spec].stopped, fast.models[spec].stopped
        assert one is not None
        assert other is not None
        assert one.beyond == 0
        assert other.beyond > 0
        assert replace(other, beyond=0) == one
        assert fast.models[spec].statistics == slow.models[spec].statistics
    verdicts = [{spec: one.calibrated for spec, one in judge(score).items()} for score in (slow, fast)]
    assert verdicts[0] == verdicts[1]


def test_a_stopped_run_asks_no_more_when_it_is_run_again(bank: FrameBank, stopped: Path) -> None:
    """The command finds nothing left, and says what was saved."""
    planned = study.plan(bank.root, [STEADY, LOSING], stopped, extent=EARLY)
    before = planned.counts()
    study.run(planned)
    assert planned.counts() == before
    assert [one.left for one in planned.progress().values()] == [0, 0]


def test_a_settled_label_stays_whatever_is_asked_of_the_run_later(tmp_path: Path) -> None:
    """More models come and the command is given again; more controls, which might unsettle it, are refused."""
    moved = banks.build_bank(tmp_path / "bank", episodes=4, steps=6, controls=True)
    out, extent = tmp_path / "run", study.BatterySelection(stop_early=True, controls="none")
    study.run(study.plan(moved.root, [STEADY], out, extent=extent), concurrency=1)
    before = study.score(out, resamples=99)
    settled = before.models[STEADY].stopped
    assert settled is not None
    assert settled.label == "image_invariant"
    assert study.plan(moved.root, [STEADY], tmp_path / "more", extent=EARLY).more_by_model()[STEADY] > 0
    with pytest.raises(LedgerError, match="begun with --controls none, now --controls auto was given"):
        study.plan(moved.root, [STEADY], out, extent=replace(extent, controls="auto"))
    for models in ([LOSING], [STEADY, LOSING], [STEADY]):
        study.run(study.plan(moved.root, models, out, extent=extent), concurrency=4)
        after = study.score(out, resamples=99)
        assert after.models[STEADY].stopped == settled
        assert after.models[STEADY].controls == before.models[STEADY].controls
        assert after.models[STEADY].statistics == before.models[STEADY].statistics
        assert judge(after)[STEADY].calibrated == judge(before)[STEADY].calibrated
    judged = json.loads(CliRunner().invoke(app, ["verdict", str(out), "--json"]).stdout)["models"][STEADY]
    assert judged["stopped_early"] == settled.as_dict()


PROGRAM = """
import sys
from pathlib import Path
import stand_ins
from eyechart.models import ADAPTERS
from eyechart.studies import battery as study
sys.modules["stand_ins"] = stand_ins
stand_ins.open_model = lambda *_: stand_ins.StandIn(stand_ins.stop, pause_s=0.01)
ADAPTERS["standin"] = "stand_ins"
selection = study.BatterySelection(stop_early=True)
planned = study.plan(Path(sys.argv[1]), ["standin:steady"], Path(sys.argv[2]), extent=selection)
study.run(planned, concurrency=4)
"""


def test_a_run_killed_at_three_moments_stops_where_an_undisturbed_one_does(
    bank: FrameBank, stopped: Path, tmp_path: Path
) -> None:
    """The evidence is computed again from the ledger: the same calls count, the same e-values, the same verdict."""
    out = tmp_path / "run"
    env = os.environ | {"PYTHONPATH": str(Path(stand_ins.__file__).parent)}
    for attempts in random.Random(5).sample(range(30, 110), 3):  # noqa: S311 - moments, no secret
        goal = attempts + max(0, stand_ins.rows_in(out / LEDGER, "attempts"))
        with subprocess.Popen([sys.executable, "-c", PROGRAM, str(bank.root), str(out)], env=env) as running:
            while running.poll() is None and stand_ins.rows_in(out / LEDGER, "attempts") < goal:
                time.sleep(0.002)
            running.send_signal(signal.SIGKILL)
        assert running.returncode == -signal.SIGKILL
    assert study.score(out, resamples=99).models[STEADY].stopped is None
    planned = study.plan(bank.root, [STEADY], out, extent=EARLY)
    study.run(planned, concurrency=4)
    one, whole = (study.score(run, resamples=99).models[STEADY] for run in (out, stopped))
    assert one.stopped is not None
    assert whole.stopped is not None
    assert replace(one.stopped, beyond=0) == whole.stopped
    assert one.statistics == whole.statistics


def test_a_run_that_was_cut_before_its_stop_is_unfinished(bank: FrameBank, tmp_path: Path) -> None:
    """It is partial, and a gate cannot say; only what its evidence has settled is complete."""
    out = tmp_path / "run"
    planned = study.plan(bank.root, [STEADY], out, extent=EARLY)
    with pytest.raises(KeyboardInterrupt):
        study.run(planned, concurrency=1, progress=_cut_at(100))
    scored = study.score(out, resamples=99)
    assert scored.models[STEADY].stopped is None
    note = judge(scored)[STEADY].notes[0]
    assert note.startswith("unfinished: ")
    assert "nothing is settled early" in note
    gate = hold(scored, ["depth"])
    assert gate.exit_code == 2
    assert "unfinished" in gate.checks[0].because


def _cut_at(calls: int) -> Callable[[int, int], None]:
    def cut(done: int, total: int) -> None:
        del total
        if done >= calls:
            raise KeyboardInterrupt

    return cut


def test_refused_requests_stop_nothing_early(bank: FrameBank, tmp_path: Path) -> None:
    """Errors are no evidence: every call is made, and a gate cannot say."""
    out = tmp_path / "run"
    study.run(study.plan(bank.root, [LOCKED], out, extent=EARLY), concurrency=32, limits=Limits(patience=9999))
    scored = study.score(out, resamples=99)
    assert scored.models[LOCKED].stopped is None
    assert scored.models[LOCKED].answered == scored.models[LOCKED].planned
    assert hold(scored, ["depth"]).exit_code == 2


def test_a_call_that_fails_for_now_holds_the_stop_back_until_it_is_made_again(
    bank: FrameBank, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The command says what is left; once the call has come back the stop is where it would have been."""
    out = tmp_path / "run"
    monkeypatch.setattr("eyechart.run.random.random", lambda: -1.0)  # no pause before a call is tried again
    planned = study.plan(bank.root, [STEADY], out, extent=EARLY)
    fourth = sorted(planned.plan.keys())[30].seed(planned.plan.seed)

    def failing(query: Query) -> Reply:
        return Reply(error="connection") if query.seed == fourth else stand_ins.stop(query)

    study.run(replace(planned, models={STEADY: stand_ins.StandIn(failing)}), concurrency=1)
    assert planned.progress()[STEADY].stopped is None
    assert planned.progress()[STEADY].left > 0
    study.run(planned, concurrency=1)
    assert planned.progress()[STEADY].left == 0
    found = planned.progress()[STEADY].stopped
    assert found is not None
    assert found.label == "image_invariant"


def test_one_with_errors_is_asked_for_what_was_left_out(bank: FrameBank, tmp_path: Path) -> None:
    """Where the frames end and a few errors left it open, the calls that had been left out are made after all."""
    out = tmp_path / "run"
    planned = study.plan(bank.root, [STEADY], out, extent=EARLY)
    repeats = [key for key in planned.plan.keys_of(STEADY) if key.condition == "real_repeat"]
    broken = {key.seed(planned.plan.seed) for key in repeats[:10]}

    def failing(query: Query) -> Reply:
        return Reply(error="exception") if query.seed in broken else stand_ins.stop(query)

    study.run(replace(planned, models={STEADY: stand_ins.StandIn(failing)}), concurrency=4)
    assert planned.progress()[STEADY].left == 0
    assert study.score(out, resamples=99).models[STEADY].stopped is None
    assert planned.counts()[:2] == (72 * 8, 72 * 8)
    with Ledger(out / LEDGER) as ledger:
        course = EarlyStop(planned.plan, ledger).courses[STEADY]
    assert course.is_exhausted
    assert course.label == "image_invariant"
    assert len(course.counted) < 72 * 8  # so the others were asked once nothing had settled


REFUSED = {
    "shard": ({"extent": study.BatterySelection(shard=(1, 2), stop_early=True)}, "leave out --shard"),
    "conditions": ({"extent": EARLY, "conditions": ["real", "blank"]}, "--conditions lacks real_repeat"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_cannot_be_stopped_early_is_refused(bank: FrameBank, tmp_path: Path, what: str) -> None:
    """In one line that says what to do, before anything is written."""
    options, says = REFUSED[what]
    with pytest.raises(SpecError, match=says):
        study.plan(bank.root, [STEADY], tmp_path / "run", **options)  # type: ignore[arg-type]
    assert not (tmp_path / "run").exists()


def test_a_run_is_resumed_as_it_was_begun(bank: FrameBank, stopped: Path, tmp_path: Path) -> None:
    """Neither is a run that stops early resumed without, nor another one with it."""
    with pytest.raises(LedgerError, match="this run has stop_early True, now stop_early False was asked for"):
        study.plan(bank.root, [STEADY], stopped)
    study.run(study.plan(bank.root, [STEADY], tmp_path / "run", extent=study.BatterySelection(2)))
    with pytest.raises(LedgerError, match="stop_early False"):
        study.plan(bank.root, [STEADY], tmp_path / "run", extent=EARLY)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"extent": study.BatterySelection(10, stop_early=True)}, "begun with all frames, now --limit 10 was given"),
        ({"extent": EARLY, "conditions": NEEDED}, "now --conditions real,real_repeat,blank was given"),
    ],
)
def test_a_run_that_stops_early_is_not_resumed_with_other_frames_or_conditions(
    bank: FrameBank, stopped: Path, tmp_path: Path, options: dict[str, object], says: str
) -> None:
    """What settles depends on all that a run asks: neither less nor more is asked of it later, and that is said."""
    with pytest.raises(LedgerError, match=says):
        study.plan(bank.root, [STEADY], stopped, **options)  # type: ignore[arg-type]
    planned = study.plan(bank.root, [STEADY], stopped, extent=EARLY)
    assert (len(planned.plan.conditions), len(planned.plan.frames), planned.progress()[STEADY].left) == (8, 72, 0)
    fewer = study.plan(bank.root, [STEADY], tmp_path / "run", **options)  # type: ignore[arg-type]
    study.run(fewer, concurrency=8)
    assert study.plan(bank.root, [STEADY], tmp_path / "run", **options).left() == 0  # type: ignore[arg-type]
    with pytest.raises(LedgerError, match="give the same options"):
        study.plan(bank.root, [STEADY], tmp_path / "run", extent=EARLY)


def test_runs_of_different_models_merge(bank: FrameBank, tmp_path: Path) -> None:
    """Machines share the models instead of the calls; each model's stop stays where it was."""
    for name, spec in (("one", STEADY), ("two", LOSING)):
        study.run(study.plan(bank.root, [spec], tmp_path / name, extent=EARLY))
    study.merge([tmp_path / "one", tmp_path / "two"], tmp_path / "both")
    both = study.score(tmp_path / "both", resamples=99)
    assert [model.stopped and model.stopped.label for model in both.models.values()] == [
        "image_invariant",
        "not_scorable",
    ]


def test_the_manifest_says_that_stopping_early_was_asked_for(stopped: Path, tmp_path: Path) -> None:
    """A run of before that had no such word did not ask for it, and anything but true or false is refused."""
    assert read_run(stopped)[0].stop_early
    raw = json.loads((stopped / "run.json").read_text())
    copy = tmp_path / "run"
    copy.mkdir()
    (copy / "bank").symlink_to(stopped / "bank")
    del raw["stop_early"]
    (copy / "run.json").write_text(json.dumps(raw))
    assert not read_run(copy)[0].stop_early
    (copy / "run.json").write_text(json.dumps({**raw, "stop_early": "no"}))
    with pytest.raises(LedgerError, match='stop_early is "no", not true or false'):
        read_run(copy)


def test_a_dry_run_says_the_most_and_the_typical_and_asks_nothing(bank: FrameBank, tmp_path: Path) -> None:
    """So that one knows before paying."""
    words = ["run", "battery", "--model", STEADY, "--frames", str(bank.root), "--out", str(tmp_path / "run")]
    said = CliRunner().invoke(app, [*words, "--stop-early", "--dry-run"])
    assert said.exit_code == 0
    assert "at most 648 calls per model; a model whose repeats never differ takes" in said.stderr
    assert "(image_invariant)" in said.stderr
    assert not (tmp_path / "run").exists()


def test_only_calls_that_count_are_in_the_statistics(stopped: Path) -> None:
    """The answers of a stopped model are those of its counted calls, one for one."""
    scored = study.score(stopped, resamples=99).models[STEADY]
    assert scored.stopped is not None
    kept: list[Decision[str]] = [
        one for column in scored.answers.decisions.values() for one in column if one is not None
    ]
    assert len(kept) == scored.stopped.calls == scored.answered
    with Ledger(stopped / LEDGER) as ledger:
        assert len(list(ledger.replies(STEADY))) == scored.stopped.calls + scored.stopped.beyond


def test_a_stopped_run_is_not_compared(stopped: Path) -> None:
    """Its answers chose its frames, so that no test that exchanges the runs holds."""
    scored = study.score(stopped, resamples=99)
    with pytest.raises(SpecError, match="standin:steady stopped early in the first run"):
        compare(scored, scored)
