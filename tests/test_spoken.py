"""Prompts from a file say of each frame what its bank declares sayable, and nothing that is ground truth."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import banks
import photographs
import stand_ins
from eyechart.conditions import BATTERY, CONDITIONS, seed_of, show, text_source_frame
from eyechart.errors import BankError, EyechartError, LedgerError, SpecError
from eyechart.frames import MAIN, BankWriter, Frame, FrameBank, Stimulus, check, encode, open_bank
from eyechart.importing import Choices, import_table
from eyechart.manifest import read_run
from eyechart.models import ADAPTERS
from eyechart.prompts import PROMPTS, Prompt, find_prompt, neutral, read_prompt
from eyechart.spaces.discrete import DRIVING, Discrete
from eyechart.studies import battery
from eyechart.verdicts import judge

SAID = '''
name = "rover-1"
system = "You drive. Actions: {actions}."
user = """You go at speed {speed} {{sic}}. Reply as {"action": "HALT"}."""
'''
PLACES = {"file": "photo", "episode": "drive", "step": "tick", "scenario": "place", "gap": "lidar_m"}
TWO = Discrete("two", ("HALT", "GO"), (), ("HALT",), ("GO",))

UNDRAWN = tuple(
    name
    for name, condition in CONDITIONS.items()
    if not condition.needs & {"counterfactual", "control", "text", "drive"}
)
"""What a bank without counterfactuals can show where a prompt says nothing of a frame."""

Ask = Callable[[str], Path]


@pytest.fixture(autouse=True)
def _models(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the stand-ins SPECs for one test."""
    monkeypatch.setitem(ADAPTERS, "driver", "photographs")
    monkeypatch.setitem(ADAPTERS, "standin", "stand_ins")


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank whose prompts may say the speed."""
    folder = tmp_path_factory.mktemp("said")
    rows = photographs.rows(drives=6, ticks=4)
    photographs.take(folder / "photos", rows)
    (folder / "t.csv").write_text(photographs.as_csv(rows))
    choices = Choices(
        columns=PLACES, threshold=18.0, unit="m", prompt_columns=("speed",), space=TWO, mirror="horizontal"
    )
    return import_table(folder / "photos", folder / "t.csv", folder / "bank", choices)


@pytest.fixture
def ask(tmp_path: Path) -> Ask:
    """Return a function that writes a prompt's file."""

    def write(text: str) -> Path:
        (tmp_path / "prompt.toml").write_text(text)
        return tmp_path / "prompt.toml"

    return write


def test_a_prompt_says_of_each_frame_what_stands_in_its_row(bank: FrameBank, ask: Ask, tmp_path: Path) -> None:
    """As it stands in the table; braces that name no column stay; only text_swapped speaks of another."""
    planned = battery.plan(bank.root, ["standin:steady"], tmp_path / "run", prompt=str(ask(SAID)))
    battery.run(planned)
    model = planned.models["standin:steady"]
    assert isinstance(model, stand_ins.StandIn)
    for key, query in zip(model.asked(planned.plan), model.queries, strict=True):
        frame = bank.frame(key.frame)
        own = f'You go at speed {frame.fields["speed"]} {{sic}}. Reply as {{"action": "HALT"}}.'
        assert query.system == "You drive. Actions: HALT, GO."
        assert (query.user == own) == (key.condition != "text_swapped")
        assert "lidar" not in query.user + query.system


def test_text_swapped_keeps_the_picture_and_says_what_another_frame_would(bank: FrameBank) -> None:
    """The other is of the same scenario, says something else, and is the same in any order of asking."""
    said = replace(bank, said=("speed",))

    def other_than(frame: Frame, run_seed: int = 3) -> Frame:
        return text_source_frame(frame, said, seed_of("text_swapped", frame, run_seed))

    others = {frame.id: other_than(frame) for frame in bank}
    for frame in reversed(bank.frames):
        other = other_than(frame)
        assert other == others[frame.id]
        assert other.fields["speed"] != frame.fields["speed"]
        assert other.scenario == frame.scenario
        assert show("text_swapped", frame, said, 3) == Stimulus(bank.images(frame), other.fields)
        assert show("mirrored", frame, said, 3).fields == frame.fields
    assert len({other.id for other in others.values()}) > 5
    assert len({other_than(bank.frames[0], seed).id for seed in range(9)}) > 1


def test_where_all_frames_say_the_same_no_text_can_be_swapped(bank: FrameBank) -> None:
    """Named, not asked in vain."""
    mute = replace(bank, frames=tuple(replace(frame, fields={"speed": 5}) for frame in bank), said=("speed",))
    with pytest.raises(BankError, match=r"all frames have the same \[5\]"):
        text_source_frame(mute.frames[0], mute, 0)


@pytest.mark.parametrize(("spec", "agrees"), [("driver:listens", False), ("driver:looks", True)])
def test_who_follows_the_text_is_told_from_who_follows_the_picture(
    *, bank: FrameBank, ask: Ask, tmp_path: Path, spec: str, agrees: bool
) -> None:
    """agree.text_swapped is 1 for the one that looks; V over the eight conditions stays as without text_swapped."""
    path = str(ask(SAID.replace("HALT", "HALT or CRAWL")))
    battery.run(battery.plan(bank.root, [spec], tmp_path / "run", prompt=path))
    statistics = battery.score(tmp_path / "run", resamples=200).models[spec].statistics
    assert (statistics["agree.text_swapped"].value == 1.0) == agrees
    assert statistics["agree.text_swapped"].n > 0
    assert statistics["agree.text_swapped"].ci is not None
    battery.run(battery.plan(bank.root, [spec], tmp_path / "eight", prompt=path, conditions=BATTERY))
    eight = battery.score(tmp_path / "eight", resamples=200).models[spec].statistics
    assert "agree.text_swapped" not in eight
    assert {name: statistics[name] for name in eight} == dict(eight)


def test_who_follows_a_text_that_goes_with_the_gap_is_not_taken_for_one_who_sees_it(ask: Ask, tmp_path: Path) -> None:
    """The listener brakes near by its own text and not by another's; the looker does by both."""
    rows = [{**row, "speed": f"{50 - (row['lidar_m'] or 60) / 2} km/h"} for row in photographs.rows()]  # type: ignore[operator]
    photographs.take(tmp_path / "photos", rows)
    (tmp_path / "t.csv").write_text(photographs.as_csv(rows))
    choices = Choices(PLACES, "horizontal", TWO, threshold=18.0, unit="m", prompt_columns=("speed",))
    near = import_table(tmp_path / "photos", tmp_path / "t.csv", tmp_path / "bank", choices)
    specs = ["driver:listens", "driver:looks"]
    said = (
        SAID.replace("HALT", "HALT or CRAWL")
        + '\n[action_space]\nactions = ["HALT", "CRAWL", "GO"]\nbrake = ["HALT", "CRAWL"]\n'
    )
    battery.run(battery.plan(near.root, specs, tmp_path / "run", prompt=str(ask(said))))
    scored = battery.score(tmp_path / "run", resamples=1000)
    assert {spec: one.calibrated.label for spec, one in judge(scored).items()} == {
        "driver:listens": "image_invariant",
        "driver:looks": "depth_associated",
    }
    heard = scored.models["driver:listens"].statistics["depth_observational"]
    assert heard.detail is not None
    assert float(str(heard.detail["p_real"])) < 0.01 < float(str(heard.detail["p_text_swapped"]))
    battery.run(battery.plan(near.root, specs, tmp_path / "real", prompt=str(ask(said)), conditions=BATTERY))
    unasked = battery.score(tmp_path / "real", resamples=200).models["driver:looks"].statistics["depth_observational"]
    assert unasked.p is None
    assert "text_swapped is needed too" in unasked.note


def test_the_frame_that_lends_its_text_is_the_one_that_a_scan_finds(bank: FrameBank) -> None:
    """In the bank's order, of the same scenario where one has another text; texts may be few or a scenario's own."""
    few = tuple(replace(frame, fields={"speed": place % 3}) for place, frame in enumerate(bank))
    own = tuple(replace(frame, fields={"speed": frame.scenario}) for frame in bank)
    for frames in (bank.frames, few, own):
        source = replace(bank, frames=frames, said=("speed",))
        for frame in frames:
            others = [other for other in frames if other.fields["speed"] != frame.fields["speed"]]
            near = [other for other in others if other.scenario == frame.scenario] or others
            for seed in range(5):
                wanted = near[int(np.random.default_rng(seed).integers(len(near)))]
                assert text_source_frame(frame, source, seed) is wanted


def test_text_swapped_is_there_only_where_the_prompt_says_something(bank: FrameBank, ask: Ask, tmp_path: Path) -> None:
    """It is none of the eight; asked by name for a prompt that says nothing, it is refused."""
    assert "text_swapped" not in BATTERY
    assert tuple(CONDITIONS)[:8] == BATTERY
    with_text = battery.plan(bank.root, ["standin:steady"], tmp_path / "run", prompt=str(ask(SAID)))
    assert set(with_text.plan.conditions) == {*UNDRAWN, "text_swapped"}
    plain = battery.plan(bank.root, ["standin:steady"], tmp_path / "run")
    assert plain.plan.conditions == UNDRAWN
    assert plain.plan.prompt == neutral(bank.manifest.picture, TWO)
    with pytest.raises(BankError, match="'text_swapped' cannot be shown: prompt 'neutral' says nothing of a frame"):
        battery.plan(bank.root, ["standin:steady"], tmp_path / "run", conditions=["real", "text_swapped"])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            SAID.replace("{speed}", "{lidar_m}"),
            "'rover-1' asks for {lidar_m}, which is ground truth; a",
        ),
        (
            SAID.replace("{speed}", "{pace}"),
            "{pace}, which is not a prompt column; a prompt of this bank may say: speed",
        ),
        (SAID.replace("{speed}", "{scenario}"), "asks for {scenario}, which is not a prompt column"),
        (
            "user = 'At {speed}: HALT?'",
            "does not ask for the actions HALT, GO of action space",
        ),
        ("user = 3", "'user' must be a text"),
        ("system = 'x'", "'user' must be a text"),
        ("user = ' '", "needs a user message"),
        ("user = 'x'\nname = 'a b'", "a name of letters"),
        (
            "user = 'x'\ntemperature = 1",
            "a prompt has no 'temperature'; it has name, system, user, messages, action_space, answer",
        ),
        ("user = 'x'\naction_space = 3", "action_space must be a table"),
        ("user = 'x'\n[action_space]\nname = 'y'", "no actions"),
        ("user = ", "is no TOML file"),
        (
            "user = 'x'\n[answer]\nfields = [{name = 'v', kind = 'number', values = ['< 5', '< 3']}]",
            "answer field 'v': the range '< 3' never holds",
        ),
    ],
)
def test_a_prompt_that_must_not_be_asked_is_one_line(
    *, bank: FrameBank, ask: Ask, tmp_path: Path, text: str, said: str
) -> None:
    """Ground truth by name, unknown columns, unsaid actions, and files that are no prompt."""
    with pytest.raises(SpecError) as refused:
        battery.plan(bank.root, ["standin:steady"], tmp_path / "run", prompt=str(ask(text)))
    assert said in str(refused.value)
    assert not (tmp_path / "run").exists()


def test_the_run_records_the_wording_and_its_hash(bank: FrameBank, ask: Ask, tmp_path: Path) -> None:
    """It is read back as it was, does not depend on the file, and an edited wording is noticed."""
    path = ask(SAID)
    battery.run(
        battery.plan(
            bank.root, ["standin:steady"], tmp_path / "run", prompt=str(path), extent=battery.BatterySelection(2)
        )
    )
    path.unlink()
    manifest, _ = read_run(tmp_path / "run")
    recorded = json.loads((tmp_path / "run/run.json").read_text())
    assert manifest.prompt.key == recorded["prompt"]["key"]
    assert manifest.prompt.user == recorded["prompt"]["user"]
    assert manifest.prompt.fields == ("speed",)
    recorded["prompt"]["user"] += " Hurry."
    (tmp_path / "run/run.json").write_text(json.dumps(recorded))
    with pytest.raises(LedgerError, match="the wording of prompt 'rover-1' has key"):
        read_run(tmp_path / "run")


def test_a_prompt_may_bring_its_own_actions_and_is_scored_by_them(bank: FrameBank, ask: Ask, tmp_path: Path) -> None:
    """The bank keeps its own; the key of the prompt knows the difference."""
    space = '\n[action_space]\nactions = ["HALT", "CRAWL", "GO"]\nbrake = ["HALT", "CRAWL"]\nproceed = ["GO"]\n'
    path = ask('user = "{actions}?"' + space)
    battery.run(battery.plan(bank.root, ["driver:looks"], tmp_path / "run", prompt=str(path)))
    scored = battery.score(tmp_path / "run", resamples=200)
    assert scored.bank.manifest.action_space.actions == ("HALT", "CRAWL", "GO")
    assert "CRAWL" in scored.models["driver:looks"].answers.actions("real")
    assert judge(scored)["driver:looks"].calibrated.label != "not_scorable"
    assert open_bank(bank.root).manifest.action_space == TWO
    prompt = read_prompt(path)
    assert prompt.key != replace(prompt, space=None).key
    assert Prompt.from_dict(prompt.as_dict()) == prompt


def test_a_built_in_prompt_is_refused_where_it_asks_for_other_actions(bank: FrameBank, tmp_path: Path) -> None:
    """It would get answers that nobody can read."""
    with pytest.raises(SpecError, match="'baseline' does not ask for the actions HALT, GO"):
        battery.plan(bank.root, ["standin:steady"], tmp_path / "run", prompt="baseline")


@pytest.mark.parametrize("name", PROMPTS)
def test_a_built_in_prompt_says_nothing_of_a_frame_and_keeps_its_key(name: str) -> None:
    """Its braces are braces."""
    prompt = find_prompt(name)
    assert prompt.fields == ()
    assert prompt.render({"action": "x"}, DRIVING.actions) == (prompt.system, prompt.user)
    assert Prompt.from_dict({"name": name, "system": prompt.system, "user": prompt.user}) == prompt
    assert find_prompt("baseline").key == "baseline@4c0af29c"


def test_what_a_prompt_may_say_is_part_of_the_fingerprint_and_no_ground_truth(bank: FrameBank, tmp_path: Path) -> None:
    """A changed word is found; a column cannot be both."""
    frame = bank.frames[0]
    assert "speed" not in frame.truth
    assert frame.geometry() != replace(frame, fields={"speed": "5"}).geometry()
    lines = (bank.root / "metadata.jsonl").read_text()
    copy = tmp_path / "copy"
    copy.mkdir()
    (copy / "manifest.json").write_bytes((bank.root / "manifest.json").read_bytes())
    (copy / "metadata.jsonl").write_text(lines.replace(".50 km/h", ".51 km/h", 1))
    assert any("differs from the manifest's fingerprint" in problem for problem in check(copy))
    both = replace(frame, truth={**frame.truth, "speed": "5"})
    for wrong in (both, replace(frame, fields={})):
        with (
            pytest.raises(EyechartError, match="give each once, and none as ground truth"),
            BankWriter(tmp_path / "new", bank.manifest) as writer,
        ):
            writer.add(wrong, {MAIN: encode(photographs.draw(3.0))}, {})


def test_a_frame_without_fields_has_the_geometry_that_it_always_had() -> None:
    """The fingerprints of existing banks stay."""
    frame = banks.one("a", ("s", "e", 0), "none", "a.png", truth={"lead_gap_m": 5.0})
    assert frame.geometry() == "b1f500d2f35b4b85"
