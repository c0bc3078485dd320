"""Drift between stages cannot help: a controller that brakes harder as calls go by is asked controls and earns none."""

import math
import random
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

import banks
import stand_ins
from eyechart.calls import CallKey, Query, Reply
from eyechart.conditions import RANGED
from eyechart.frames import FrameBank
from eyechart.models import ADAPTERS
from eyechart.run import Plan, in_order
from eyechart.seeds import key_seed
from eyechart.spaces.discrete import DRIVING
from eyechart.studies import battery as study
from eyechart.studies.battery.answers import read_answers
from eyechart.studies.battery.calibrated_statistics import CalibratedTests, LazyStatistics
from eyechart.studies.battery.depth import AT, BESIDE, PICTURE_OF
from eyechart.studies.battery.paper_statistics import Resampling
from eyechart.studies.battery.stages import asked_of_model, available_controls, replied
from eyechart.verdicts import calibrated_rules, judge

pytestmark = pytest.mark.slow

ORDERS = 100
HARDER = ("STRAIGHT", "SLOW", "STOP")

Rule = Callable[[float, CallKey, random.Random], float]
"""How hard it brakes in a call, from 0 to 1, by how much of the calls of a reader of distance have gone by."""


def growing(passed: float, key: CallKey, rng: random.Random) -> float:
    """Brake a little harder with every call."""
    del key
    return passed + 0.1 * rng.random()


def tiring(passed: float, key: CallKey, rng: random.Random) -> float:
    """Brake hard for the first stage and less after it, call by call."""
    del key
    return 1 - passed + 0.2 * rng.random()


def waking(passed: float, key: CallKey, rng: random.Random) -> float:
    """Brake from the second stage on."""
    del key
    return float(passed > 0.68) * 0.8 + 0.2 * rng.random()


def waving(passed: float, key: CallKey, rng: random.Random) -> float:
    """Brake in waves."""
    del key
    return 0.5 + 0.45 * math.sin(40 * passed) + 0.1 * rng.random()


def drawn_to_the_near(passed: float, key: CallKey, rng: random.Random) -> float:
    """Brake for whoever is near, in any lane, and harder as calls go by: the first stage calls for the controls."""
    near = key.condition in {"lead_near", "exchange_own", "exchange_beside"} or hash_of(key.frame) < 0.3
    return 0.6 * near + 0.4 * passed + 0.1 * rng.random()


def lucky(passed: float, key: CallKey, rng: random.Random) -> float:
    """Brake for the near lead of the first stage, by its file, and drift from then on."""
    return 1.0 if key.condition == "lead_near" else passed + 0.3 * rng.random()


RULES: tuple[Rule, ...] = (growing, tiring, waking, waving, drawn_to_the_near, lucky)


def hash_of(text: str) -> float:
    """Return a number from 0 to 1 that is a frame's own."""
    return random.Random(text).random()  # noqa: S311 - no secret


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of 72 tiny frames with control pictures that no test changes."""
    return banks.build_bank(tmp_path_factory.mktemp("drift") / "bank", episodes=6, steps=4, ranged=True)


@pytest.fixture(autouse=True)
def _installed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make ``standin:NAME`` a SPEC for one test."""
    monkeypatch.setitem(ADAPTERS, "standin", "stand_ins")


def level(braking: float) -> Reply:
    """Return a reply of three levels."""
    return Reply(HARDER[min(2, max(0, int(3 * braking)))], "stop")


def followed(plan: Plan, may: tuple[str, ...], rule: Rule) -> tuple[list[tuple[CallKey, Reply]], tuple[str, ...]]:
    """Ask a drifting controller stage by stage, in the orders of a run, and return its replies and its controls."""
    (model,), rng = plan.models, random.Random(plan.seed)  # noqa: S311 - no secret
    most = len(plan.keys()) + sum(1 for _ in replace(plan, conditions=RANGED).keys_of(model))
    replies: list[tuple[CallKey, Reply]] = []
    fresh = in_order(plan.keys(), plan.seed)
    while fresh:
        for key in fresh:
            replies.append((key, level(rule(len(replies) / most, key, rng))))
        progress = asked_of_model(plan, model, replied(replies, plan, model), may)
        stage = replace(plan, conditions=progress.open).keys_of(model)
        fresh = in_order(stage, key_seed("stage", plan.seed, model, *progress.open))
    return replies, progress.controls


def orders(bank: FrameBank, out: Path) -> Iterator[tuple[Plan, tuple[str, ...]]]:
    """Yield the plan of a run in so many orders, with the controls that it may ask."""
    planned = study.plan(bank.root, ["standin:steady"], out)
    may = available_controls(planned.manifest, planned.plan)
    for seed in range(ORDERS):
        yield replace(planned.plan, seed=seed), may


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.__name__)
def test_drift_earns_no_depth(bank: FrameBank, tmp_path: Path, rule: Rule) -> None:
    """Over many orders next to none, whatever the first stage said: all but its first test is of one stage."""
    earned, called = 0, 0
    for plan, may in orders(bank, tmp_path / "run"):
        replies, controls = followed(plan, may, rule)
        called += set(RANGED) <= set(controls)
        if not set(RANGED) <= set(controls):
            continue
        answers = read_answers("standin:steady", replies, replace(plan, controls={"standin:steady": controls}))
        calibratedstatistics = LazyStatistics(
            CalibratedTests(answers, Resampling(99, plan.seed, intervals=False)).tests()
        )
        earned += calibrated_rules(calibratedstatistics, turns=False)[0].label in {"depth", "partial_depth"}
    assert earned <= 1
    if rule in {drawn_to_the_near, lucky}:
        assert called > ORDERS / 2


def test_drift_earns_no_depth_in_a_real_run(bank: FrameBank, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same through planning, ledger and event loop, where several calls are under way at once."""

    def drifting(rule: Rule) -> stand_ins.StandIn:
        made, rng = stand_ins.StandIn(), random.Random(4)  # noqa: S311 - no secret

        def respond(query: Query) -> Reply:
            seen = by_seed.get(query.seed)
            assert seen is not None
            return level(rule(len(made.queries) / 1100, seen, rng))

        made.respond = respond
        return made

    rules = {one.__name__: one for one in (drawn_to_the_near, lucky)}
    monkeypatch.setattr(stand_ins, "open_model", lambda name, _: drifting(rules[name]))
    specs = [f"standin:{name}" for name in rules]
    planned = study.plan(bank.root, specs, tmp_path / "run", seed=11)
    wide = replace(planned.plan, controls=dict.fromkeys(specs, available_controls(planned.manifest, planned.plan)))
    by_seed = {key.seed(11): key for key in wide.keys()}  # noqa: SIM118 - a plan is no mapping
    study.run(planned, concurrency=3)
    score = study.score(tmp_path / "run", resamples=99)
    for model in score.models.values():
        assert set(RANGED) <= set(model.controls.controls)
        assert judge(score)[model.model].calibrated.label not in {"depth", "partial_depth"}
    assert DRIVING.brake


def shown_m(key: CallKey, bank: FrameBank) -> float:
    """Return how far away the lead is in what a call shows; 80 m where it has none."""
    frame = next(one for one in bank if one.id == key.frame)
    columns = AT.get({**PICTURE_OF, BESIDE: "far"}.get(key.condition, ""), ())
    told = [frame.truth[name] for name in ("lead_gap_m", *columns) if frame.truth.get(name)]
    return float(told[-1]) if told and key.condition not in {"blank", "noise", "text_only"} else 80.0


@pytest.mark.parametrize(("share", "label"), [(1.0, "depth"), (0.5, "depth_associated")])
def test_memory_earns_no_depth_in_a_real_run(
    share: float, label: str, bank: FrameBank, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It grades by the mean of this picture and the one before. The ledger has the calls in the order of the asking."""
    made, before = stand_ins.StandIn(pause_s=0.001), [20.0]

    def respond(query: Query) -> Reply:
        now = shown_m(by_seed[query.seed], bank)
        far, before[0] = now**share * before[0] ** (1 - share), now
        return level(0.9 if far < 13 else 0.5 if far < 40 else 0.1)

    made.respond = respond
    monkeypatch.setattr(stand_ins, "open_model", lambda *_: made)
    spec = "standin:remembers"
    planned = study.plan(bank.root, [spec], tmp_path / "run", seed=11)
    wide = replace(planned.plan, controls={spec: available_controls(planned.manifest, planned.plan)})
    by_seed = {key.seed(11): key for key in wide.keys()}  # noqa: SIM118 - a plan is no mapping
    study.run(planned, concurrency=3)
    score = study.score(tmp_path / "run", resamples=99)
    answers, verdict = score.models[spec].answers, judge(score)[spec]
    sent = {
        int(turn): (frame.id, name) for name, of in answers.sent.items() for frame, turn in zip(bank, of, strict=True)
    }
    asked = [by_seed[query.seed] for query in made.queries]
    assert [sent[turn] for turn in range(len(asked))] == [(key.frame, key.condition) for key in asked]
    assert verdict.calibrated.label == label
    assert not score.evidence()[spec].is_unfinished
    if label != "depth":
        before_it = score.models[spec].statistics["picture_before"]
        assert before_it.ci is not None
        assert before_it.ci[1] >= 0
