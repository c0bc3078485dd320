"""Corruptions of a camera: graded, seeded, alike for the pictures of a frame, and asked as series."""

import hashlib
import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import banks
from eyechart import api, cli
from eyechart.calls import CallKey, Reply
from eyechart.conditions import OF_BANKS, STEPPED, find_condition, show
from eyechart.corruptions import CORRUPTIONS, STEPS, step_of
from eyechart.errors import BankError, SpecError
from eyechart.frames import MAIN, RGB, FrameBank, decode
from eyechart.importing import Choices, import_table
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER, read_manifest
from eyechart.spaces.failures import says_cannot_see
from eyechart.studies.battery.series import CLEAN, SERIES, StepEffect, read_series, results, unseeing

SERIES_OF = tuple(CORRUPTIONS)


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of 24 drives of four frames, most of them with the lead near and far."""
    return banks.build_bank(tmp_path_factory.mktemp("corrupted") / "bank", episodes=8, steps=4)


def eyechart(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *words: object, code: int = 0) -> str:
    """Run a command; return what it printed."""
    monkeypatch.setattr(sys, "argv", ["eyechart", *map(str, words)])
    with pytest.raises(SystemExit) as left:
        cli.main()
    said = capsys.readouterr()
    assert (left.value.code or 0) == code, said.err
    return said.out + said.err


def reader(contrast: float) -> Callable[..., str]:
    """Return a controller that brakes for a red lead left of the middle, if it stands out by ``contrast`` levels."""

    def answer(prompt: str, picture: bytes | None) -> str:
        del prompt
        if picture is None:
            return "STRAIGHT"
        image = decode(picture, "it")
        red = image[1:, :, 0].astype(float) - image[1:, :, 1:].astype(float).mean(axis=2)
        columns = np.flatnonzero(np.median(np.sort(red, axis=0)[-3:], axis=0) >= contrast)
        return "STOP" if len(columns) and columns.min() < 25 else "STRAIGHT"

    return answer


def sees(prompt: str, picture: bytes | None) -> str:
    """Answer as a reader of known acuity."""
    return reader(60.0)(prompt, picture)


SEES = "python:test_corruptions:sees"


@pytest.mark.parametrize("name", CORRUPTIONS)
def test_a_later_step_leaves_less_of_the_picture(name: str) -> None:
    """The distance to the clean picture grows with the step; the same seed draws the same, another one not."""
    rng = np.random.default_rng(0)
    clean = np.kron(rng.integers(40, 215, (12, 16, 3)), np.ones((10, 10, 1))).astype(np.uint8)
    steps = [CORRUPTIONS[name].applied(clean, step, seed=4) for step in STEPS]
    apart = [float(np.abs(one.astype(float) - clean).mean()) for one in steps]
    assert apart == sorted(apart)
    assert apart[0] > 0.5
    assert len(set(apart)) == len(STEPS)
    assert all(one.shape == clean.shape and one.dtype == np.uint8 for one in steps)
    assert np.array_equal(CORRUPTIONS[name].applied(clean, 3, seed=4), steps[2])


def test_what_a_step_leaves_is_as_the_table_says() -> None:
    """Fog keeps this share of the contrast, night of the light; dead pixels and noise have these amounts."""
    clean = np.full((200, 200, 3), 60, np.uint8)
    clean[:, 100:] = 160

    def at(name: str, step: int) -> RGB:
        return CORRUPTIONS[name].applied(clean, step, seed=1)

    for step in STEPS:
        fog = at("fog", step).astype(float).mean(axis=(0, 2))
        kept = CORRUPTIONS["fog"].amounts[step - 1]
        assert abs((fog[100:].mean() - fog[:100].mean()) / 100 - kept) < 0.08
        dead = (np.isin(at("pixels", step), (0, 255)).all(axis=2)).mean()
        assert dead == pytest.approx(CORRUPTIONS["pixels"].amounts[step - 1], abs=0.01)
        night = at("night", step)[:, 100:].astype(float).mean()
        assert night == pytest.approx(160 * CORRUPTIONS["night"].amounts[step - 1], abs=3)
    assert at("grain", 1)[:, :100].astype(float).std() == pytest.approx(12, rel=0.05)


def test_pictures_of_a_frame_are_corrupted_alike(bank: FrameBank) -> None:
    """The same draw for the true picture, the near lead and the far one; another for another frame and seed."""
    one, other = [frame for frame in bank if frame.counterfactuals][:2]

    def drawn(condition: str, frame_id: str = one.id, seed: int = 0) -> RGB:
        return decode(show(condition, bank.frame(frame_id), bank, seed).images[MAIN], condition)

    dead = {name: np.isin(drawn(name), (0, 255)).all(axis=2) for name in ("lead_near@pixels_4", "lead_far@pixels_4")}
    road = (slice(13, 16), slice(0, 60))  # nothing is drawn there
    assert np.array_equal(dead["lead_near@pixels_4"][road], dead["lead_far@pixels_4"][road])
    assert dead["lead_near@pixels_4"][road].any()
    assert np.array_equal(drawn("real_repeat@fog_2"), drawn("fog_2"))
    assert not np.array_equal(drawn("grain_2"), drawn("grain_2", other.id))
    assert not np.array_equal(drawn("grain_2"), drawn("grain_2", seed=1))


def test_a_step_is_a_condition_of_any_bank_and_asked_only_by_name(
    bank: FrameBank, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is in no default run; named, it has its agreement and its words; unknown steps are refused."""
    assert not set(STEPPED) & set(OF_BANKS)
    assert "fog_1 ... fog_5" in eyechart(monkeypatch, capsys, "list", "conditions")
    run = tmp_path / "run"
    words = ("--model", "scripted:constant", "--frames", bank.root, "--out", run, "--conditions", "real,fog_3,blank")
    eyechart(monkeypatch, capsys, "run", "battery", *words)
    found = json.loads(eyechart(monkeypatch, capsys, "score", run, "--json"))["models"]["scripted:constant"]
    assert found["statistics"]["agree.fog_3"]["value"] == 1.0
    assert not [name for name in found["statistics"] if name.startswith(SERIES)]
    eyechart(monkeypatch, capsys, "report", run, "--out", tmp_path / "page.html")
    assert "fog_3" in (tmp_path / "page.html").read_text(encoding="utf-8")
    for name in ("fog_6", "fog_0", "mist_3", "blank@fog_3", "text_only@fog_3", "fog_3@fog_3"):
        with pytest.raises(SpecError, match="unknown condition"):
            find_condition(name)
    with pytest.raises(BankError, match="too small for fog"):
        CORRUPTIONS["fog"].applied(np.zeros((4, 40, 3), np.uint8), 1, 0)


def asked_steps(run: Path) -> set[str]:
    """Return the steps with a finished call in a run's ledger."""
    with Ledger(run / LEDGER) as ledger:
        steps = {key.condition.partition("@")[2] or key.condition for key in ledger.finished()}
    return {step for step in steps if step_of(step)}


@pytest.mark.parametrize(("contrast", "seen"), [(120.0, 1), (60.0, 2), (35.0, 3), (3.0, 5)])
def test_a_series_finds_the_step_of_a_reader_of_known_acuity(
    bank: FrameBank, tmp_path: Path, contrast: float, seen: int
) -> None:
    """A red lead stands out by 200 levels: fog leaves 140, 90, 54, 30 and 14 of them; three steps are asked."""
    run = tmp_path / "run"
    said = api.run_battery(bank, {"it": reader(contrast)}, run, series="fog", controls="none")
    (found,) = results(said.score.models["python:it"].statistics)
    assert (found.name, found.reached) == ("fog", seen)
    assert len(asked_steps(run)) <= 3
    before = (run / LEDGER).stat().st_mtime_ns
    again = api.run_battery(bank, {"it": reader(contrast)}, run, series="fog", controls="none")
    assert again.score.as_dict() == said.score.as_dict()
    assert (run / LEDGER).stat().st_mtime_ns == before


def test_without_moved_leads_another_frames_picture_is_the_effect(tmp_path: Path) -> None:
    """Real against shuffled, less what a repeat of the same corrupted picture changes."""
    plain = banks.build_bank(tmp_path / "bank", episodes=10, steps=4, drawn=False)
    said = api.run_battery(plain, {"it": reader(60.0)}, tmp_path / "run", series=["fog"], controls="none")
    (found,) = results(said.score.models["python:it"].statistics)
    assert found.reached == 2
    assert found.shown is not None
    assert "another frame's picture" in found.shown.method


def test_a_controller_that_does_not_look_is_asked_no_step(bank: FrameBank, tmp_path: Path) -> None:
    """A series follows an effect: without one in clean pictures it costs nothing."""
    said = api.run_battery(bank, "scripted:constant", tmp_path / "run", series="all", controls="none")
    assert not asked_steps(tmp_path / "run")
    assert not results(said.score.models["scripted:constant"].statistics)


def test_a_coin_buys_no_step(bank: FrameBank, tmp_path: Path) -> None:
    """A reader that loses the lead in fog and then answers by chance has no effect there."""
    rng, sure = np.random.default_rng(5), reader(60.0)

    def fickle(prompt: str, picture: bytes | None) -> str:
        clean = picture is not None and bool((decode(picture, "it")[1:3, :, 0] == 100).all())
        return sure(prompt, picture) if clean else str(rng.choice(["STOP", "SLOW", "STRAIGHT"]))

    said = api.run_battery(bank, {"it": fickle}, tmp_path / "run", series="fog", controls="none")
    (found,) = results(said.score.models["python:it"].statistics)
    assert found.reached == 0


def test_its_cost_is_said_before_and_it_goes_on_after_the_first_part(
    bank: FrameBank, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A dry run counts three steps of each series at most; a finished run takes a further series."""
    run = tmp_path / "run"
    words = ("run", "battery", "--model", SEES, "--frames", bank.root, "--out", run, "--controls", "none")
    moved = sum("lead_near" in frame.counterfactuals for frame in bank)
    said = eyechart(monkeypatch, capsys, *words, "--series", "fog,blur", "--dry-run")
    assert f"controls and series: up to {2 * 3 * 2 * moved} calls more" in said
    eyechart(monkeypatch, capsys, *words)
    eyechart(monkeypatch, capsys, *words, "--series", "fog")
    eyechart(monkeypatch, capsys, *words, "--series", "blur")
    assert read_manifest(run).series == ("fog", "blur")
    found = json.loads(eyechart(monkeypatch, capsys, "verdict", run, "--json"))["models"][SEES][SERIES]
    assert set(found) == {"fog", "blur"}
    assert all(0 <= one["step"] <= 5 for one in found.values())
    assert "How far down a corruption" in eyechart(monkeypatch, capsys, "verdict", run)
    eyechart(monkeypatch, capsys, "bundle", run, "--out", tmp_path / "run.zip")
    eyechart(monkeypatch, capsys, "validate", tmp_path / "run.zip")
    for more, why in (("--stop-early", "goes without --stop-early"), ("--shard=1/2", "merge the shards")):
        place = ("--out", tmp_path / "other")
        said = eyechart(monkeypatch, capsys, *words[:-4], *place, "--series", "fog", more, code=2)
        assert why in said
    said = eyechart(monkeypatch, capsys, *words, "--series", "mist", code=2)
    assert "unknown corruption" in said
    lacking = (*words[:-4], "--out", tmp_path / "few", "--conditions", "real,blank", "--series", "fog")
    assert "--series compares" in eyechart(monkeypatch, capsys, *lacking, code=2)


def test_replies_that_cannot_see_are_counted_by_step() -> None:
    """60 labelled replies: those that say so, and those that find no vehicle or drive with care."""
    lines = (Path(__file__).parent / "spaces" / "unseeing.tsv").read_text(encoding="utf-8").splitlines()
    wrong = [text for label, text in (line.split("\t") for line in lines) if says_cannot_see(text) != (label == "yes")]
    assert len(lines) == 60
    assert wrong == []
    key = CallKey("battery", "m", "p", "f", "lead_near@fog_3")
    said = [(key, Reply("It is too foggy to see.", "stop")), (key, Reply("STOP", "stop"))]
    said += [(key._replace(condition="real"), Reply("I cannot see anything", "stop")), (key, Reply(error="timeout"))]
    assert unseeing(said) == {"fog_3": (1, 2)}


def test_a_result_waits_for_its_last_step() -> None:
    """Which step is reached follows from those that were asked; without the last of them there is none."""

    def effect(step: int, low: float) -> StepEffect:
        return StepEffect(low + 0.1, 40, (low, low + 0.2), step=step)

    three, four, five = effect(3, 0.4), effect(4, 0.2), effect(5, 0.0)
    made = {CLEAN: effect(0, 0.9), "series.fog_3": three, "series.fog_4": four}
    assert [one.reached for one in results(made)] == [None]
    assert results({**made, "series.fog_5": five})[0].words == "sees to fog 4 of 5"
    low = {CLEAN: effect(0, 0.9), "series.rain_3": five, "series.rain_1": five, "series.rain_2": five}
    assert results(low)[0].words == "not shown in the mildest rain"
    assert read_series("all") == SERIES_OF
    assert read_series("rain, fog,rain") == ("rain", "fog")


def test_without_an_interval_or_an_effect_in_clean_pictures_no_step_is_named() -> None:
    """That a step is lost is a finding too: it needs six episodes, and something to lose."""
    clean, short = StepEffect(0.9, 40, (0.8, 1.0)), StepEffect(1.0, 4, None, step=3)
    (found,) = results({CLEAN: clean, "series.fog_3": short})
    assert (found.reached, found.lost) == (None, short)
    assert found.words == "fog: cannot say: an interval needs 6 episodes or more"
    (found,) = results({CLEAN: replace(clean, ci=(-0.2, 0.3)), "series.fog_3": replace(short, ci=(0.5, 1.0))})
    assert found.reached is None
    assert found.words == "fog: no effect is shown in clean pictures"


def test_a_reader_that_declines_most_frames_of_a_step_does_not_see_to_it(bank: FrameBank, tmp_path: Path) -> None:
    """What it answers on the few others is no effect of the step: frames without an action have none."""
    sure = reader(3.0)

    def declines(prompt: str, picture: bytes | None) -> str:
        clean = picture is not None and bool((decode(picture, "it")[1:3, :, 0] == 100).all())
        few = hashlib.sha256(picture or b"").digest()[0] < 80
        return sure(prompt, picture) if clean or few else "It is too foggy: I cannot see the road."

    said = api.run_battery(bank, {"it": declines}, tmp_path / "run", series="fog", controls="none")
    (found,) = results(said.score.models["python:it"].statistics)
    assert found.reached == 0
    assert found.lost is not None
    assert found.lost.n == said.score.models["python:it"].statistics[CLEAN].n
    assert found.lost.unseeing > found.lost.replies / 2


def test_pictures_too_small_for_a_corruption_are_refused_before_the_first_call(tmp_path: Path) -> None:
    """By a series and by a step's name; the other conditions of such a bank are asked."""
    lines = ["file,episode"]
    for number in range(6):
        Image.fromarray(np.full((4, 40, 3), 30 * number, np.uint8)).save(tmp_path / f"{number}.png")
        lines.append(f"{number}.png,{number}")
    (tmp_path / "t.csv").write_text("\n".join(lines))
    small = import_table(tmp_path, tmp_path / "t.csv", tmp_path / "bank", Choices())
    for how in ({"series": "fog"}, {"conditions": ("real", "blank", "dirt_2")}):
        with pytest.raises(BankError, match="has 40x4 pixels, and a corruption needs 8 on the shorter side"):
            api.run_battery(small, {"it": sees}, tmp_path / "run", **how)  # type: ignore[arg-type]
        assert not (tmp_path / "run").exists()
    api.run_battery(small, {"it": sees}, tmp_path / "run", conditions=("real", "blank"))
