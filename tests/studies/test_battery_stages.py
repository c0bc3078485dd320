"""A battery is asked in stages: a control only where answers claim what it could take away, whatever comes between."""

import itertools
import shutil
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path

import pytest
from typer.testing import CliRunner

import banks
import stand_ins
from banks import STAGED
from eyechart.calls import CallKey, Query, Reply
from eyechart.cli.app import app
from eyechart.conditions import CONTROLS
from eyechart.errors import LedgerError, SpecError
from eyechart.frames import FrameBank, decode
from eyechart.gate import hold
from eyechart.ledger import Ledger
from eyechart.limits import Limits
from eyechart.manifest import LEDGER, read_run
from eyechart.models import ADAPTERS
from eyechart.models.prices import Prices
from eyechart.stats.statistic import Statistic
from eyechart.studies import battery as study
from eyechart.studies.battery import BatterySelection, stages
from eyechart.studies.battery.plans import plan_of
from eyechart.transfer import transfer
from eyechart.verdicts import judge

pytestmark = pytest.mark.slow

BLIND, READER, PAINT = "standin:blind", "standin:reader", "standin:paint"
LANES = ("lane_own", "lane_beside")
REST = ("lead_mid_near", "lead_mid_far", "nudged")
FRAMES, LEADS = 36, 30
ABSENT = 25
"""Of so many frames ``lead_absent`` is asked: a twentieth of the calls of the first stage would be too few."""
AGAIN = 20
"""And of so many ``real_again``: a twentieth of all calls before it."""


def _seen(query: Query) -> tuple[int | None, bool]:
    """Return how many pixels ahead the lead of the own lane is, and whether the own vehicle is painted."""
    if query.image is None:
        return None, False
    pixels = decode(query.image, "asked")
    own = (pixels[..., 0] == 50) & (pixels[..., 2] == 0)
    if not own.any():
        return None, False
    row = pixels[int(own.any(axis=1).argmax())]
    ahead = row[:, 0] == 200
    return (int(ahead.argmax()) - 10 if ahead.any() else None), bool((pixels[own][:, 1] == 255).any())


def reading(query: Query) -> Reply:
    """Brake the harder the nearer the lead is."""
    gap, _ = _seen(query)
    return Reply("STRAIGHT" if gap is None or gap > 30 else "SLOW" if gap > 10 else "STOP", "stop")


def painted(query: Query) -> Reply:
    """Answer by the paint of the own vehicle."""
    return Reply("SLOW" if _seen(query)[1] else "STRAIGHT", "stop")


ANSWERS: dict[str, Callable[[Query], Reply]] = {"blind": stand_ins.stop, "reader": reading, "paint": painted}


def rule(
    found: Mapping[str, Statistic], *, supplied: Collection[str], conditions_run: Collection[str]
) -> tuple[str, ...]:
    """Want the lanes and then the rest of who brakes nearer, and the nudge of who follows paint."""
    far, paint = found["depth_interventional"].p, found["content_recoloured"].p
    wanted: tuple[str, ...] = ()
    if far is not None and far < 0.01:
        wanted = REST if set(LANES) <= set(conditions_run) else LANES
    elif paint is not None and paint < 0.01:
        wanted = ("nudged",)
    return tuple(name for name in wanted if name in supplied and name not in conditions_run)


@pytest.fixture(autouse=True)
def _installed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the stand-ins SPECs; what is wanted of whom is a rule of these tests."""
    install(monkeypatch)


def install(monkeypatch: pytest.MonkeyPatch) -> None:
    """Do so for as long as the patches hold."""
    monkeypatch.setattr(stand_ins, "open_model", lambda name, _: stand_ins.StandIn(ANSWERS[name]))
    monkeypatch.setitem(ADAPTERS, "standin", "stand_ins")
    monkeypatch.setattr(stages, "controls_wanted", rule)


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of 36 tiny frames with control pictures that no test changes."""
    found = banks.build_bank(tmp_path_factory.mktemp("stages") / "bank", episodes=3, steps=4, controls=True)
    assert (len(found), sum(bool(frame.counterfactuals) for frame in found)) == (FRAMES, LEADS)
    return found


def order(out: Path, spec: str) -> list[str]:
    """Return the conditions of a model's calls, in the order in which they were sent."""
    with Ledger(out / LEDGER) as ledger:
        return [attempt.key.condition for attempt in ledger.attempts(spec)]


def asked(out: Path) -> dict[str, stages.ControlProgress]:
    """Return what manifest, bank and ledger say that each model is asked."""
    manifest, its_bank = read_run(out)
    with Ledger(out / LEDGER) as ledger:
        return stages.stages_of(manifest, plan_of(manifest, its_bank), ledger)


def planned(bank: FrameBank, out: Path, *specs: str, **extent: object) -> study.Battery:
    """Plan a battery."""
    return study.plan(bank.root, specs, out, extent=BatterySelection(**extent))  # type: ignore[arg-type]


def make(bank: FrameBank, out: Path, *specs: str, **extent: object) -> study.Battery:
    """Plan and run a battery."""
    made = planned(bank, out, *specs, **extent)
    study.run(made, concurrency=4)
    return made


def test_each_model_is_asked_the_controls_that_its_own_answers_call_for(bank: FrameBank, tmp_path: Path) -> None:
    """One stage after the other; the counts are those of what was asked, and nothing is left."""
    made = make(bank, tmp_path / "run", BLIND, READER, PAINT)
    found = asked(tmp_path / "run")
    assert {spec: one.controls for spec, one in found.items()} == {
        BLIND: (),
        READER: (*LANES, *REST),
        PAINT: ("nudged",),
    }
    assert all(one.ended and not one.open and not one.most for one in found.values())
    sent = {spec: Counter(order(tmp_path / "run", spec)) for spec in (BLIND, READER, PAINT)}
    assert {name for name in sent[BLIND] if name in CONTROLS} == set()
    assert {name: sent[READER][name] for name in (*LANES, *REST)} == dict.fromkeys((*LANES, *REST[:2]), LEADS) | {
        "nudged": FRAMES
    }
    assert {name for name in sent[PAINT] if name in CONTROLS} == {"nudged"}
    calls = sum(sum(one.values()) for one in sent.values())
    assert made.counts() == (calls, calls, 0)
    assert (made.left(), sum(made.more_by_model().values())) == (0, 0)
    score = study.score(tmp_path / "run", resamples=99)
    assert {spec: (model.planned, model.answered) for spec, model in score.models.items()} == {
        spec: (sum(one.values()),) * 2 for spec, one in sent.items()
    }


def test_a_stage_begins_when_the_one_before_is_finished_and_has_an_order_of_its_own(
    bank: FrameBank, tmp_path: Path
) -> None:
    """No control before the last call of the stage before; within a stage conditions are mixed."""
    make(bank, tmp_path / "run", READER)
    sent = order(tmp_path / "run", READER)
    place = {name: [at for at, one in enumerate(sent) if one == name] for name in sent}
    first = [at for name, at in place.items() if name not in CONTROLS]
    assert max(itertools.chain(*first)) < min(place["lane_own"] + place["lane_beside"])
    assert max(place["lane_own"] + place["lane_beside"]) < min(itertools.chain(*(place[name] for name in REST)))
    assert len([one for one, _ in itertools.groupby(sent[min(place["nudged"]) :])]) > LEADS
    make(bank, tmp_path / "again", READER)
    assert sorted(order(tmp_path / "again", READER)) == sorted(sent)


def test_no_stage_reads_again_what_a_model_has_replied(
    bank: FrameBank, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However many stages there are, the ledger is read once, at the end of the first; what comes later is added."""
    read, replies = Counter[str](), Ledger.replies

    def counted(ledger: Ledger, model: str) -> Iterator[tuple[CallKey, Reply]]:
        read[model] += 1
        return replies(ledger, model)

    chosen = planned(bank, tmp_path / "run", READER, BLIND)
    monkeypatch.setattr(Ledger, "replies", counted)
    study.run(chosen)
    assert read[READER] == read[BLIND] > 0
    assert asked(tmp_path / "run")[READER].judged == (*LANES, *REST)


@pytest.fixture(scope="module")
def whole(bank: FrameBank, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a run of two models that nothing cut and that no test changes."""
    out = tmp_path_factory.mktemp("whole") / "run"
    with pytest.MonkeyPatch.context() as patched:
        install(patched)
        make(bank, out, READER, PAINT)
    return out


@pytest.mark.parametrize("calls", [200, 400, 440, 470])
def test_a_run_that_is_cut_anywhere_ends_as_one_that_was_not(
    bank: FrameBank, whole: Path, tmp_path: Path, calls: int
) -> None:
    """Whatever stage it was in: the same calls, the same controls, the same statistics, and nothing is left."""
    cut = tmp_path / "cut"
    assert not study.run(planned(bank, cut, READER, PAINT), concurrency=3, limits=Limits(calls=calls)).whole
    half = planned(bank, cut, READER, PAINT)
    assert half.counts()[1] == calls
    assert half.left() > 0
    assert study.run(half, concurrency=5).whole
    assert half.left() == 0
    assert {spec: sorted(order(cut, spec)) for spec in (READER, PAINT)} == {
        spec: sorted(order(whole, spec)) for spec in (READER, PAINT)
    }
    one, other = (study.score(out, resamples=99).as_dict()["models"] for out in (whole, cut))
    assert one == other


def test_a_stage_that_is_not_finished_is_asked_and_not_judged(bank: FrameBank, tmp_path: Path) -> None:
    """Its calls are planned and left; no statistic reads them before the last is back."""
    whole = make(bank, tmp_path / "whole", READER)
    first = len(whole.plan.keys())
    study.run(planned(bank, tmp_path / "run", READER), limits=Limits(calls=first + 20))
    found = asked(tmp_path / "run")[READER]
    assert (found.judged, found.open, found.ended) == ((), LANES, False)
    assert set(found.most) == {*REST, "lead_absent", "real_again"}
    score = study.score(tmp_path / "run", resamples=99)
    one = score.models[READER]
    assert (one.planned, one.answered) == (first + 2 * LEADS, first + 20)
    full = study.score(tmp_path / "whole", resamples=99).models[READER].statistics
    assert one.statistics["depth_interventional"] == full["depth_interventional"]
    assert score.evidence()[READER].is_unfinished


def test_a_stage_makes_no_call_again_that_a_walk_over_the_frames_has_made(bank: FrameBank, tmp_path: Path) -> None:
    """A run that stops early asks some controls before it comes to its end and to its stages."""
    first = len(make(bank, tmp_path / "whole", READER).plan.keys())
    study.run(planned(bank, tmp_path / "run", READER), limits=Limits(calls=first + 20))
    manifest, its_bank = read_run(tmp_path / "run")
    plan = plan_of(manifest, its_bank)
    with Ledger(tmp_path / "run" / LEDGER) as ledger:
        more = stages.AdaptiveStages(plan, plan, manifest, ledger).more(READER)
        assert not ledger.finished().intersection(more)
    assert len(more) == 2 * LEADS - 20


def test_a_first_stage_that_is_not_finished_calls_for_nothing(bank: FrameBank, tmp_path: Path) -> None:
    """However clear the answers are so far; up to so many calls may still come."""
    study.run(planned(bank, tmp_path / "run", READER, BLIND), limits=Limits(calls=500))
    found = asked(tmp_path / "run")
    assert found[READER].controls == ()
    more = planned(bank, tmp_path / "run", READER, BLIND).more_by_model()
    assert more[READER] == 4 * LEADS + ABSENT + AGAIN + FRAMES


def test_all_asks_every_model_every_control_at_once_and_none_asks_none(bank: FrameBank, tmp_path: Path) -> None:
    """Controls among the conditions are planned, shuffled and counted with them."""
    every = make(bank, tmp_path / "all", BLIND, controls="all")
    assert set(CONTROLS) & set(every.plan.conditions) == set(STAGED)
    assert every.more_by_model() == {BLIND: 0}
    sent = order(tmp_path / "all", BLIND)
    assert sent.index("nudged") < len(sent) - sent[::-1].index("real")
    none = make(bank, tmp_path / "none", READER, controls="none")
    assert set(order(tmp_path / "none", READER)).isdisjoint(CONTROLS)
    assert none.more_by_model() == {READER: 0}


def test_a_run_keeps_what_it_was_begun_with_and_may_be_widened(bank: FrameBank, tmp_path: Path) -> None:
    """None to auto asks what is missing; back again is refused, and so is another word."""
    out = tmp_path / "run"
    make(bank, out, READER, controls="none")
    before = order(out, READER)
    make(bank, out, READER)
    assert order(out, READER) == before
    make(bank, out, READER, controls="auto")
    assert read_run(out)[0].controls == "auto"
    assert set(order(out, READER)) & set(CONTROLS) == {*LANES, *REST}
    with pytest.raises(LedgerError, match="started with --controls auto, now none was asked for"):
        planned(bank, out, READER, controls="none")
    with pytest.raises(SpecError, match="--controls 'some' is none of none, auto, all"):
        planned(bank, tmp_path / "other", READER, controls="some")


def test_conditions_that_are_named_are_all_that_is_asked(bank: FrameBank, tmp_path: Path) -> None:
    """Unless controls are asked for too."""
    names = ["real", "real_repeat", "lead_near", "lead_far"]
    made = study.plan(bank.root, [READER], tmp_path / "run", conditions=names)
    assert (made.manifest.controls, sum(made.more_by_model().values())) == ("none", 0)
    both = study.plan(bank.root, [READER], tmp_path / "run", conditions=names, extent=BatterySelection(controls="auto"))
    study.run(both)
    assert set(order(tmp_path / "run", READER)) == {*names, *LANES, *REST}


def test_shards_ask_the_first_stage_and_the_merged_run_the_rest(bank: FrameBank, tmp_path: Path) -> None:
    """No shard has the answers that call for a control; the merged run, resumed, has them all."""
    for number in (1, 2):
        made = make(bank, tmp_path / f"{number}", READER, BLIND, shard=(number, 2))
        assert (made.left(), sum(made.more_by_model().values())) == (0, 0)
    shards = [str(tmp_path / "1"), str(tmp_path / "2")]
    said = CliRunner().invoke(app, ["merge", *shards, "--out", str(tmp_path / "merged")]).stderr
    more = sum(study.begun(tmp_path / "merged").more_by_model().values())
    assert f"{2 * LEADS} calls are left, and up to {more} of control pictures" in said
    assert more == 2 * LEADS + ABSENT + AGAIN + FRAMES
    for check in hold(study.score(tmp_path / "1", resamples=99), ["depth"]).checks:
        assert check.holds is None
        assert "a shard asks no controls: merge the shards and resume the run" in check.because
    for name, words in (("1", "controls not asked"), ("merged", f"{2 * LEADS} planned calls have no outcome")):
        verdict = judge(study.score(tmp_path / name, resamples=99))[READER]
        assert verdict.unfinished is not None
        assert words in verdict.text()
    assert planned(bank, tmp_path / "merged", READER, BLIND).left_by_model() == {READER: 2 * LEADS, BLIND: 0}
    make(bank, tmp_path / "merged", READER, BLIND)
    make(bank, tmp_path / "whole", READER, BLIND)
    one, other = (study.score(tmp_path / name, resamples=99).as_dict()["models"] for name in ("merged", "whole"))
    assert one == other


def test_answers_to_a_control_that_is_not_wanted_any_more_count_for_nothing(bank: FrameBank, tmp_path: Path) -> None:
    """A run of few frames that called for controls is grown, and with all frames calls for none."""
    out = tmp_path / "run"
    make(bank, out, READER, limit=12)
    assert asked(out)[READER].controls
    grown = planned(bank, out, READER)
    study.run(grown, limits=Limits(calls=Counter(order(out, READER)).total() + 1))
    one = study.score(out, resamples=99).models[READER]
    assert one.planned == len(grown.plan.keys())
    assert set(one.answers.decisions).isdisjoint(CONTROLS)
    assert one.controls.controls == ()


def test_a_bank_without_control_pictures_is_asked_the_nudge_alone(tmp_path: Path) -> None:
    """It is made from the true picture, and so can be shown of any bank."""
    plain = banks.build_bank(tmp_path / "bank", episodes=3, steps=4)
    make(plain, tmp_path / "run", READER, PAINT)
    assert {spec: one.controls for spec, one in asked(tmp_path / "run").items()} == {READER: (), PAINT: ("nudged",)}


def test_a_correlation_with_scores_names_runs_whose_controls_are_still_to_be_asked(
    bank: FrameBank, tmp_path: Path
) -> None:
    """Of one shard too, whose own calls are all answered; not of a run that is finished."""
    table = tmp_path / "scores.csv"
    table.write_text(f"model,score\n{READER},1\n{BLIND},0\n")
    made = make(bank, tmp_path / "1", READER, BLIND, shard=(1, 2))
    make(bank, tmp_path / "run", READER, BLIND)
    scores = {READER: 1.0, BLIND: 0.0}
    part, whole = (transfer([study.score(tmp_path / name, resamples=99)], scores) for name in ("1", "run"))
    assert part.unfinished[0].startswith(f"{READER} on {bank.name}: ")
    assert len(part.unfinished) == len(made.plan.models)
    assert whole.unfinished == ()
    said = CliRunner().invoke(app, ["transfer", str(tmp_path / "1"), "--scores", str(table)]).output
    assert "unfinished: " in said
    assert "controls may still follow" in " ".join(said.split())


def test_every_count_and_estimate_before_says_up_to(bank: FrameBank, tmp_path: Path) -> None:
    """The dry run, the estimate of what it costs, and the shard that leaves them to the merged run."""
    words = ["run", "battery", "--frames", str(bank.root), "--model", READER, "--model", BLIND, "--dry-run"]
    dry = CliRunner().invoke(app, [*words, "--out", str(tmp_path / "run")])
    most = 2 * (4 * LEADS + ABSENT + AGAIN + FRAMES)
    assert f"controls: up to {most} calls more" in dry.stderr
    assert f"{READER}: up to {8 * FRAMES + 3 * LEADS + most // 2} calls" in dry.stderr
    shard = CliRunner().invoke(app, [*words, "--out", str(tmp_path / "run"), "--shard", "1/2"])
    assert "controls: none in a shard" in shard.stderr
    (one, _) = study.expected(planned(bank, tmp_path / "run", READER, BLIND), Prices({}), concurrency=8)
    assert one.at_most


def test_a_run_on_a_bundle_of_models_that_were_asked_differently_is_shown_whole(
    bank: FrameBank, tmp_path: Path
) -> None:
    """Report, costs, guards and comparison take models of different conditions."""
    make(bank, tmp_path / "run", BLIND, READER)
    shutil.copytree(tmp_path / "run", tmp_path / "twin")
    for words in (["report", "--out", str(tmp_path / "page.html")], ["costs"], ["verdict"], ["score"]):
        ran = CliRunner().invoke(app, [words[0], str(tmp_path / "run"), *words[1:]])
        assert ran.exit_code == 0, ran.output
    assert "lane_beside" in (tmp_path / "page.html").read_text(encoding="utf-8")
    same = CliRunner().invoke(app, ["compare", str(tmp_path / "run"), str(tmp_path / "twin")])
    assert same.exit_code == 0, same.output
    packed = CliRunner().invoke(app, ["bundle", str(tmp_path / "run"), "--out", str(tmp_path / "bundle")])
    assert packed.exit_code == 0, packed.output
    checked = CliRunner().invoke(app, ["validate", str(tmp_path / "bundle")])
    assert checked.exit_code == 0, checked.output
    for guards in study.score(tmp_path / "run", resamples=99).guards.values():
        assert next(guard for guard in guards if guard.name == "outcomes").holds


def test_what_an_older_version_asked_of_the_absent_lead_is_finished(
    bank: FrameBank, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It asked no true picture beside it; where some of its calls are still to be made, today's stage is asked."""

    def absent(_: object, *, supplied: Collection[str], conditions_run: Collection[str]) -> tuple[str, ...]:
        return tuple(name for name in ("lead_absent", "real_again") if name in supplied and name not in conditions_run)

    monkeypatch.setattr(stages, "controls_wanted", absent)
    made = make(bank, tmp_path / "run", BLIND)
    may = stages.available_controls(made.manifest, made.plan)
    with Ledger(tmp_path / "run" / LEDGER) as ledger:
        replies = list(ledger.replies(BLIND))
    older = [reply for reply in replies if reply[0].condition != "real_again"]
    for given, judged in ((replies, ("lead_absent", "real_again")), (older, ("lead_absent",))):
        progress = stages.asked_of_model(made.plan, BLIND, stages.replied(given, made.plan, BLIND), may)
        assert (progress.judged, progress.open, progress.ended) == (judged, (), True)
    cut = [reply for reply in older if reply[0].condition != "lead_absent"] + older[-1:]
    came = stages.replied(cut, made.plan, BLIND)
    assert stages.asked_of_model(made.plan, BLIND, came, may).open == ("lead_absent", "real_again")
