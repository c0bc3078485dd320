"""The structured arm end to end: known-answer estimators fail the clauses that they declare, and no other."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

import banks
from eyechart.api import build_bank
from eyechart.calls import Query, Reply
from eyechart.conditions import show
from eyechart.errors import BankError, LedgerError, SpecError
from eyechart.frames import MAIN, FrameBank, Stimulus, decode
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER, read_run
from eyechart.models import ADAPTERS
from eyechart.modes import RequestMode
from eyechart.perception.estimators import ESTIMATORS
from eyechart.perception.view import VIEWS, through
from eyechart.report.contact_sheet import write_frame
from eyechart.spaces.discrete import DRIVING
from eyechart.spaces.scene import SCENES, Estimate, Scene, SceneDecision
from eyechart.studies import battery, structured
from eyechart.studies.structured import EstimatorScore, StructuredScore
from eyechart.studies.structured.plans import choose
from eyechart.studies.structured.scores import Bootstrap, Figures
from eyechart.studies.structured.study import StructuredStudy

SPECS = [f"scripted:{name}" for name in ESTIMATORS]
CONTROL = "scripted:scene_positive_control"


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a balanced bank of 48 frames, an episode in each of four scenarios."""
    return build_bank(tmp_path_factory.mktemp("scenes") / "bank", seeds=(0,))


def ran(study: str, bank: FrameBank, out: Path, specs: list[str], **options: object) -> StructuredScore:
    """Plan, run and score."""
    battery.run(structured.plan(study, bank.root, specs, out, **options))  # type: ignore[arg-type]
    return structured.score(out)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return where the admission of every known-answer estimator lies."""
    return tmp_path_factory.mktemp("admission") / "run"


@pytest.fixture(scope="module")
def admission(bank: FrameBank, folder: Path) -> StructuredScore:
    """Return the admission of every known-answer estimator."""
    return ran("admission", bank, folder, SPECS)


@pytest.fixture(scope="module")
def control(bank: FrameBank, tmp_path_factory: pytest.TempPathFactory) -> EstimatorScore:
    """Return the positive control's score on all frames."""
    return ran("structured", bank, tmp_path_factory.mktemp("structured") / "run", [CONTROL]).models[CONTROL]


@pytest.mark.parametrize("name", ESTIMATORS)
def test_an_estimator_fails_exactly_the_clauses_that_it_declares(admission: StructuredScore, name: str) -> None:
    """Seeing neither sides nor distance, calling everything close, saying one thing, leaving a field out."""
    scored = admission.models[f"scripted:{name}"]
    assert scored.failed == ESTIMATORS[name].fails
    assert scored.is_admitted == (not ESTIMATORS[name].fails)
    assert {held.statistic.n for held in scored.clauses} <= {16, 32, 14}


def test_the_picture_holds_the_answer(control: EstimatorScore) -> None:
    """The positive control errs by half a pixel at most, exactly alike in the reflection, and uses all actions."""
    statistics = control.statistics
    assert statistics["gap_mae_m"].detail["largest"] < 0.5 / 5.5 + 0.001  # ground truth has three decimals
    assert statistics["gap_mae_m"].value < 0.055
    assert statistics["gap_mae_m"].n == control.answers.visible.sum() > 40
    for name in ("parse", "balanced_accuracy", "scene_equivariance", "action_equivariance", "swap_rate"):
        assert statistics[name].value == 1.0
    assert statistics["actions"].value == 5
    assert control.is_admitted
    assert control.before is not None


@dataclass
class Oracle:
    """Knows the truth of each picture by heart: no Query holds it."""

    scenes: Mapping[str, Scene]
    version: str = "1"
    facts: Mapping[str, str] = field(default_factory=dict)

    async def answer(self, query: Query) -> Reply:
        """Answer with the truth."""
        assert query.image is not None
        return Reply(str(Estimate.of(self.scenes[hashlib.sha256(query.image).hexdigest()])), "stop")

    async def close(self) -> None:
        """Hold nothing."""


def test_an_oracle_is_admitted_without_an_error(
    bank: FrameBank, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With the truth the gap's error is 0, which also holds the truth against the policy's demand."""
    scenes: dict[str, Scene] = {}
    for frame in choose(bank, 0):
        gap = frame.truth["lead_gap_m"] if frame.truth["lead_visible"] else None
        scene = Scene(gap, frame.truth["left_clear"], frame.truth["right_clear"])  # type: ignore[arg-type]
        assert Estimate.of(scene).act() == frame.truth["demand"]
        for condition, shown in (("real", scene), ("mirrored", scene.mirrored())):
            picture = through(VIEWS["highway"], show(condition, frame, bank, 0)).images[MAIN]
            scenes[hashlib.sha256(picture).hexdigest()] = shown
    monkeypatch.setattr("oracle_door.ORACLE", Oracle(scenes), raising=False)
    monkeypatch.setitem(ADAPTERS, "oracle", "oracle_door")
    scored = ran("admission", bank, tmp_path / "run", ["oracle:truth"]).models["oracle:truth"]
    assert scored.is_admitted
    assert scored.statistics["gap_mae_m"].value == 0
    assert scored.statistics["lead_missed"].value == 0


def test_the_admission_set_is_balanced_seeded_and_recorded(admission: StructuredScore, bank: FrameBank) -> None:
    """Eight close frames and eight others that demand every action, the same for a seed, in the run's manifest."""
    frames = choose(bank, 0)
    assert [bank.manifest.gap.is_near(frame) for frame in frames].count(True) == 8
    assert {frame.truth["demand"] for frame in frames} == set(DRIVING.actions)
    assert admission.manifest.frames == tuple(frame.id for frame in frames)
    assert admission.as_dict()["frames"] == list(admission.manifest.frames)
    assert choose(bank, 0) == frames
    assert choose(bank, 1) != frames


def test_a_score_is_the_same_every_time_and_a_finished_run_asks_no_more(
    admission: StructuredScore, bank: FrameBank, folder: Path
) -> None:
    """The same bytes, also after the run was begun again."""
    before = (folder / LEDGER).read_bytes()
    battery.run(structured.plan("admission", bank.root, SPECS, folder))
    assert (folder / LEDGER).read_bytes() == before
    assert json.dumps(structured.score(folder).as_dict()) == json.dumps(admission.as_dict())


def test_a_run_records_view_prompt_and_reader_and_goes_on_only_as_it_was_begun(bank: FrameBank, tmp_path: Path) -> None:
    """Another view or seed is another run; nobody is admitted on half the calls."""
    out = tmp_path / "run"
    planned = structured.plan("admission", bank.root, [CONTROL], out)
    assert planned.counts() == (32, 0, 0)
    battery.run(planned, limits=planned.manifest.within(_prices(), calls=20))
    scored = structured.score(out).models[CONTROL]
    assert (scored.answered, scored.is_admitted) == (20, False)
    manifest, _ = read_run(out)
    assert (manifest.view, manifest.prompt.name, manifest.prompt.space) == (VIEWS["highway"].key, "scene", SCENES)
    for options, message in (({"view": "none"}, "this run has view highway@"), ({"seed": 1}, "this run has seed 0")):
        with pytest.raises(LedgerError, match=message):
            structured.plan("admission", bank.root, [CONTROL], out, **options)  # type: ignore[arg-type]
    with pytest.raises(LedgerError, match="this run has study admission"):
        structured.plan("structured", bank.root, [CONTROL], out)
    with Ledger(out / LEDGER) as ledger:
        assert {key.condition for key in ledger.finished()} <= {"real", "mirrored"}


def _prices() -> object:
    from eyechart.models.prices import read_prices  # noqa: PLC0415 - nowhere else needed

    return read_prices()


def test_a_run_of_another_study_is_refused_by_name(
    admission: StructuredScore, bank: FrameBank, folder: Path, tmp_path: Path
) -> None:
    """A battery's statistics are not of scenes, and the other way round."""
    assert admission.manifest.study == "admission"
    with pytest.raises(LedgerError, match=r"a run of the study 'admission', not of a battery.*eyechart score"):
        battery.score(folder)
    few = battery.BatterySelection(4)
    battery.run(battery.plan(bank.root, ["scripted:constant"], tmp_path / "battery", conditions=["real"], extent=few))
    with pytest.raises(LedgerError, match="a run of the study 'battery', not one of admission, structured"):
        structured.score(tmp_path / "battery")
    kinds = [StructuredStudy().holds(one) for one in (folder, tmp_path / "battery", tmp_path / "nothing")]
    assert kinds == [True, False, False]


def test_what_the_calls_took_counts_estimates(admission: StructuredScore) -> None:
    """A reply with an estimate is no reply without a decision."""
    silent = "scripted:scene_silent_when_free"
    assert admission.accounting[CONTROL]["all"].missing == {}
    assert admission.accounting[silent]["all"].missing == {"unparsed": 4}
    assert admission.models[silent].answers.reasons == {"missing_field": 4}
    outcomes = {guard.name: guard.holds for guard in admission.guards[CONTROL]}
    assert outcomes["outcomes"] is True
    assert outcomes["degeneracy"] is True
    constant = {guard.name: guard.holds for guard in admission.guards["scripted:scene_constant"]}
    assert constant["degeneracy"] is False


def test_pictures_without_a_view_are_asked_about_in_plain_words(tmp_path: Path) -> None:
    """The bank's own words and threshold, no legend; a calibrated view of them is refused."""
    own = banks.build_bank(tmp_path / "bank", episodes=4, steps=3)
    planned = structured.plan("admission", own.root, [CONTROL], tmp_path / "run")
    assert planned.manifest.view == "none"
    assert planned.manifest.prompt.name == "scene_plain"
    assert own.manifest.picture in planned.manifest.prompt.user
    assert "legend" not in planned.manifest.prompt.user
    with pytest.raises(SpecError, match="no calibrated view of pictures from 'boxes'"):
        structured.plan("admission", own.root, [CONTROL], tmp_path / "other", view="calibrated")


def test_a_bank_that_cannot_serve_is_refused_before_a_call(tmp_path: Path) -> None:
    """Too few frames of a class, or none that can be reflected."""
    few = banks.build_bank(tmp_path / "few", scenarios=["light"], episodes=1)
    with pytest.raises(BankError, match=r"has \d close frames, and admission needs 8"):
        structured.plan("admission", few.root, [CONTROL], tmp_path / "run")
    still = banks.build_bank(tmp_path / "still", axis="none")
    with pytest.raises(BankError, match="has no mirror axis"):
        structured.plan("structured", still.root, [CONTROL], tmp_path / "run")
    assert not (tmp_path / "run").exists()


# ---- figures by hand


FRAMES = banks.frames_of(["light"], 2, 4, "vertical", drawn=False)
NEAR = Estimate(15.0, close=True, left_clear=True, right_clear=False, confidence=0.5)
FAR = Estimate(30.0, close=False, left_clear=True, right_clear=False, confidence=0.5)


def told(real: list[Estimate | None], mirrored: list[Estimate | None]) -> structured.SceneAnswers:
    """Return eight frames of two episodes, in turn close at 14 m and far at 32 m, with these estimates."""
    replies = {
        "real": tuple(_reply(estimate) for estimate in real),
        "mirrored": tuple(_reply(estimate) for estimate in mirrored),
    }
    gaps = np.array([14.0, 32.0] * 4)
    every = np.ones(8, dtype=np.bool_)
    return structured.SceneAnswers("m", tuple(FRAMES), replies, gaps, gaps < 18, every, before=every)


def _reply(one: Estimate | None) -> SceneDecision:
    return SceneDecision(None, "unparsed", "malformed") if one is None else SceneDecision(one)


def figures(of: structured.SceneAnswers) -> Mapping[str, object]:
    """Return the figures over all frames."""
    episodes = np.array([frame.episode for frame in of.frames])
    return Figures(of, DRIVING, np.ones(8, dtype=np.bool_), Bootstrap(episodes)).statistics()


def test_a_reply_without_an_estimate_is_never_right() -> None:
    """It is a wrong call of close, an unequal pair and no swap, and stays in every n."""
    real: list[Estimate | None] = [NEAR, FAR] * 4
    mirrored: list[Estimate | None] = [estimate and estimate.mirrored() for estimate in real]
    real[0], mirrored[3] = None, None
    found = figures(told(real, mirrored))
    values = {name: (round(figure.value, 6), figure.n) for name, figure in found.items() if figure.value is not None}  # type: ignore[attr-defined]
    assert values["parse"] == (14 / 16, 16)
    assert values["close_accuracy"] == (7 / 8, 8)
    assert values["sensitivity"] == (3 / 4, 4)
    assert values["specificity"] == (1.0, 4)
    assert values["balanced_accuracy"] == (7 / 8, 8)
    assert values["scene_equivariance"] == values["action_equivariance"] == (6 / 8, 8)
    assert values["swap_rate"] == (round(6 / 7, 6), 7)
    assert values["gap_mae_m"] == (round((3 * 1 + 4 * 2) / 7, 6), 7)
    assert (values["actions"], values["directional"]) == ((1.0, 7), (7.0, 7))


def test_scene_equivariance_is_of_all_fields_and_of_the_exchanged_sides() -> None:
    """A gap that differs by little, sides that did not move, and another confidence are each unequal; or aside."""
    real: list[Estimate | None] = [FAR] * 8
    other = FAR.mirrored()
    mirrored: list[Estimate | None] = [other] * 5
    mirrored += [
        Estimate(30.01, other.close, other.left_clear, other.right_clear, other.confidence),
        FAR,
        Estimate(30.0, other.close, other.left_clear, other.right_clear, 0.9),
    ]
    found = figures(told(real, mirrored))
    assert found["scene_equivariance"].value == 5 / 8  # type: ignore[attr-defined]
    assert found["scene_equivariance.confidence_aside"].value == 6 / 8  # type: ignore[attr-defined]
    assert found["action_equivariance"].value == 7 / 8  # type: ignore[attr-defined]


def test_frames_from_a_collision_on_do_not_count_before_it(tmp_path: Path) -> None:
    """The crashed frame itself and all that follow in its episode."""
    own = banks.build_bank(tmp_path / "bank", scenarios=["light"], episodes=2, steps=4)
    crashed = [_crashed(frame, crash=frame.episode == "light-0" and frame.step == 2) for frame in own]
    wrecked = FrameBank(own.root, tuple(crashed), own.manifest)
    before = structured.read_scene_answers("m", [], wrecked, wrecked.frames).before
    assert before is not None
    assert before.tolist() == [True, True, False, False, True, True, True, True]
    assert (
        structured.read_scene_answers("m", [], FrameBank(own.root, own.frames[2:3], own.manifest), ()).before
        is not None
    )


def _crashed(frame: object, *, crash: bool) -> object:
    from dataclasses import replace  # noqa: PLC0415 - nowhere else needed

    return replace(frame, truth={**frame.truth, "crashed": crash})  # type: ignore[type-var,attr-defined]


def test_one_frame_is_shown_in_its_view_and_reflected(bank: FrameBank, tmp_path: Path) -> None:
    """What ``frames show FRAME`` writes is what an estimator is sent."""
    frame = bank.frames[3]
    for condition, mirrored in (("real", False), ("mirrored", True)):
        write_frame(bank, frame, tmp_path / "view.png", view=True, mirrored=mirrored)
        sent = through(VIEWS["highway"], show(condition, frame, bank, 0)).images[MAIN]
        assert (decode((tmp_path / "view.png").read_bytes(), "view") == decode(sent, "sent")).all()
    write_frame(bank, frame, tmp_path / "plain.png")
    assert (decode((tmp_path / "plain.png").read_bytes(), "plain") == decode(bank.image(frame), "frame")).all()


def test_a_mode_without_a_schema_is_read_strictly_and_with_one_binds_it(bank: FrameBank, tmp_path: Path) -> None:
    """The plan's queries carry the form; the mode decides whether the server is told."""
    planned = structured.plan("admission", bank.root, [RequestMode(CONTROL)], tmp_path / "run")
    key = planned.plan.keys()[0]
    query = planned.plan.query(key, Stimulus())
    assert query.schema["required"] == ["lead_gap_m", "close", "left_clear", "right_clear", "confidence"]


@pytest.mark.slow
def test_forward_cameras_are_asked_through_their_own_view_with_their_own_distances(tmp_path: Path) -> None:
    """On a rover's pictures, 8 m is close; each estimator fails the clauses there that it fails on a highway."""
    rover = build_bank(tmp_path / "rover", simulator="rover", seeds=(0,), steps=6)
    scored = ran("admission", rover, tmp_path / "run", SPECS)
    assert scored.manifest.view == VIEWS["rover"].key
    assert scored.manifest.prompt.name == "scene_forward"
    assert "nearer than 8 m" in scored.manifest.prompt.user
    assert scored.models[CONTROL].is_admitted
    assert scored.models[CONTROL].statistics["gap_mae_m"].value < 0.05
    failed = {name: scored.models[f"scripted:{name}"].failed for name in ESTIMATORS}
    assert failed == {name: estimator.fails for name, estimator in ESTIMATORS.items()}


class Unseeing(Oracle):
    """Tells a clear road, and in a field of its own that there was no picture."""

    async def answer(self, query: Query) -> Reply:
        """Answer the same to every query."""
        del query
        said = json.loads(str(Estimate(None, close=False, left_clear=True, right_clear=True, confidence=0.9)))
        return Reply(json.dumps({"error": "no image", **said}), "stop")


def test_an_estimate_without_a_picture_is_counted_by_name_and_by_the_version_of_the_run(
    bank: FrameBank, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A run of version 3 is scored by it, and by today's only where its replies are read anew."""
    monkeypatch.setattr("oracle_door.ORACLE", Unseeing({}), raising=False)
    monkeypatch.setitem(ADAPTERS, "oracle", "oracle_door")
    out, file = tmp_path / "run", tmp_path / "run" / "run.json"

    def counted(found: StructuredScore) -> tuple[object, Mapping[str, int]]:
        return found.as_dict()["reader"], found.models["oracle:none"].answers.reasons

    assert counted(ran("structured", bank, out, ["oracle:none"], limit=2)) == (4, {"says_error": 4})
    file.write_text(json.dumps({**json.loads(file.read_text(encoding="utf-8")), "reader": 3}), encoding="utf-8")
    assert counted(structured.score(out)) == (3, {})
    assert counted(structured.score(out, reread=True)) == (4, {"says_error": 4})
    assert structured.plan("structured", bank.root, ["oracle:none"], out, limit=2).manifest.reader == 3
