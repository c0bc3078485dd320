"""The whole line, end to end, through the command line: real frames to the verdicts that controllers declare."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from eyechart.cli.app import app
from eyechart.frames import open_bank
from eyechart.models.scripted import CONTROLLERS
from eyechart.studies import battery
from eyechart.studies.battery import BatteryScore
from eyechart.verdicts import LABELS, Verdict, judge
from known import Demo


def test_the_demo_prints_every_verdict_as_declared(demo: Demo) -> None:
    """The newcomer's first command ends with sixteen of sixteen and exit code 0."""
    assert "16 of 16 verdicts are as the controllers declared." in demo.printed
    assert demo.code == 0


@pytest.fixture(scope="module")
def scored(demo: Demo) -> BatteryScore:
    """Return the score of the demo's run."""
    return battery.score(demo.run, resamples=999)


@pytest.fixture(scope="module")
def verdicts(scored: BatteryScore) -> dict[str, Verdict]:
    """Return the verdicts on the demo's run."""
    return judge(scored)


@pytest.mark.parametrize("name", CONTROLLERS)
def test_a_controller_gets_the_labels_that_it_declares(verdicts: dict[str, Verdict], name: str) -> None:
    """Calibrated, lateral and paper label of each controller on the balanced bank."""
    verdict = verdicts[f"scripted:{name}"]
    declared = CONTROLLERS[name].declared
    assert verdict.calibrated.label == declared.calibrated
    assert verdict.lateral.label == declared.lateral
    assert verdict.paper.label == declared.paper


def test_a_verdict_names_its_scope(demo: Demo, verdicts: dict[str, Verdict]) -> None:
    """Bank, kind of picture, episodes, model, version, prompt and date, and what was not tested."""
    verdict = verdicts["scripted:depth"]
    bank = open_bank(demo.bank)
    for part in (bank.name, bank.manifest.picture, "12 episodes", "scripted:depth@", "prompt baseline@", "not tested"):
        assert part in verdict.scope


def test_json_has_the_names_that_scripts_rely_on(
    demo: Demo, scored: BatteryScore, monkeypatch: pytest.MonkeyPatch
) -> None:
    """``verdict --json`` and ``score --json`` carry the promised keys, and no NaN."""
    monkeypatch.setattr("eyechart.studies.battery.study.score", lambda *_, **__: scored)
    verdicts = _json("verdict", str(demo.run), "--json")
    for one in verdicts["models"].values():
        assert {"paper", "calibrated", "lateral", "evidence", "because", "notes"} <= one.keys()
    for one in _json("score", str(demo.run), "--json")["models"].values():
        for statistic in one["statistics"].values():
            assert {"value", "n", "ci", "p"} <= statistic.keys()


def test_a_repeat_is_asked_anew_and_never_answered_from_the_first_call(scored: BatteryScore) -> None:
    """A coin toss disagrees with itself on four of five repeats; a cache of contents would make it agree on all."""
    assert scored.models["scripted:random"].statistics["noise_floor"].value > 0.65
    assert scored.models["scripted:depth"].statistics["noise_floor"].value == 0


def test_the_demo_explains_one_of_each_answer_and_folds_the_rest(demo: Demo) -> None:
    """On 80 columns: who never looks, who looks in part and who sees, with what each does; a line for each other."""
    told, _, rest = demo.printed.partition("\n\n")
    heads = [line for line in told.splitlines() if not line.startswith(" ")]
    assert [line.partition(":")[0] for line in heads] == ["No", "In part", "Yes"]
    assert "answers SLOW, whatever it is shown" in told
    others = [line for line in rest.splitlines() if line.startswith("  ")]
    assert len(others) == len(CONTROLLERS) - 3
    assert max(map(len, demo.printed.splitlines())) <= 80
    assert "guard" not in demo.printed


@pytest.mark.slow
def test_a_finished_demo_makes_no_further_calls(demo: Demo) -> None:
    """A second demo in the same folder finds every call finished and prints the same."""
    before = (demo.run / "ledger.sqlite").read_bytes()
    again = CliRunner().invoke(app, ["demo", "--out", str(demo.folder)])
    assert again.exit_code == 0
    assert again.stdout == demo.printed
    assert (demo.run / "ledger.sqlite").read_bytes() == before


def test_a_contact_sheet_shows_the_bank(demo: Demo, tmp_path: Path) -> None:
    """``frames show`` writes a PNG with a row an episode, also of one kind of counterfactual."""
    from PIL import Image  # noqa: PLC0415

    for extra in ([], ["--counterfactual", "lead_near"]):
        out = tmp_path / f"sheet{len(extra)}.png"
        assert CliRunner().invoke(app, ["frames", "show", str(demo.bank), "--out", str(out), *extra]).exit_code == 0
        with Image.open(out) as sheet:
            assert sheet.width > 12 * 300
            assert sheet.height > 12 * 75


def _json(*arguments: str) -> dict[str, dict[str, dict]]:
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0
    return json.loads(result.stdout, parse_constant=lambda word: pytest.fail(f"{word} in the JSON"))


def test_blind_models_cost_what_they_did_and_a_reader_seven_conditions_more(
    scored: BatteryScore, verdicts: dict[str, Verdict]
) -> None:
    """On real pictures: eleven conditions of everybody, and the lead's absence, which a true picture goes with now."""
    found = {spec: verdict.calibrated.label for spec, verdict in verdicts.items()}
    frames = len(scored.bank)
    before = len(scored.manifest.conditions) * frames
    without_lead = int(0.55 * frames)
    assert len(scored.manifest.conditions) == 11
    blind = [model.planned for spec, model in scored.models.items() if LABELS[found[spec]].family == "blind"]
    unseeing = [*blind, *(model.planned for spec, model in scored.models.items() if found[spec] == "presence_only")]
    assert len(unseeing) >= 5
    assert before < max(blind)
    assert max(unseeing) <= 1.05 * (before + without_lead)
    readers = [model.planned for spec, model in scored.models.items() if found[spec] in {"depth", "depth_lateral"}]
    assert len(readers) >= 5
    assert all(before < calls <= before + 7 * frames for calls in readers)
    assert all(model.controls.ended for model in scored.models.values())
