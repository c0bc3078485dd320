"""Models of one machine are asked one after another, each closed before the next is opened; nothing else changes."""

import json
from collections.abc import Sequence
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

import banks
import short_worlds
import tiny_worlds
import weighty
from eyechart.api import run_battery
from eyechart.cli.app import app
from eyechart.errors import SpecError
from eyechart.frames import FrameBank
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER
from eyechart.models import sequential_groups
from eyechart.modes import RequestMode
from eyechart.simulators import SIMULATORS
from eyechart.studies import battery

pytestmark = pytest.mark.slow

IN_TURN = ["open depth", "close depth", "open presence", "close presence", "open random", "close random"]
SCENES = ("hf:scene_constant", "hf:scene_side_blind")
MODELS = ("hf:depth", "hf:presence", "hf:random")


@pytest.fixture(autouse=True)
def _local(monkeypatch: pytest.MonkeyPatch) -> None:
    weighty.take_place(monkeypatch)
    for name, place in {**tiny_worlds.SIMULATORS, **short_worlds.SIMULATORS}.items():
        monkeypatch.setitem(SIMULATORS, name, place)


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of 36 frames, with control pictures."""
    return banks.build_bank(tmp_path_factory.mktemp("turns") / "bank", episodes=4, controls=True)


def call(*words: object) -> Result:
    """Return what a command does; an error of eyechart's is raised."""
    result = CliRunner().invoke(app, list(map(str, words)))
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result


def options(name: str, specs: Sequence[str] = MODELS) -> list[str]:
    """Return an option for each SPEC."""
    return [word for spec in specs for word in (name, spec)]


@pytest.mark.parametrize(
    ("sequential", "turns"),
    [
        (None, (("hf:a", "ollama:b", "ollama:c"), ("openai:d",), ("ollama:e", "ollama:f"), ("scripted:depth",))),
        (True, (("hf:a", "ollama:b", "openai:d", "ollama:c", "ollama:e", "scripted:depth", "ollama:f"),)),
        (
            False,
            (("hf:a",), ("ollama:b",), ("openai:d",), ("ollama:c",), ("ollama:e",), ("scripted:depth",), ("ollama:f",)),
        ),
    ],
)
def test_the_models_of_one_machine_share_a_turn(*, sequential: bool | None, turns: tuple[tuple[str, ...], ...]) -> None:
    """This machine's by whatever adapter and address, another's by its host; what is hosted has no machine."""
    modes = [
        RequestMode("hf:a"),
        RequestMode("ollama:b"),
        RequestMode("openai:d", base_url="http://127.0.0.1:8000/v1"),
        RequestMode("ollama:c", base_url="http://localhost:11500"),
        RequestMode("ollama:e", base_url="http://box:11434"),
        RequestMode("scripted:depth"),
        RequestMode("ollama:f", base_url="http://box:11435"),
    ]
    assert sequential_groups(modes, sequential=sequential) == turns


def test_each_model_is_closed_before_the_next_is_opened_and_the_results_are_the_same(
    bank: FrameBank, tmp_path: Path
) -> None:
    """With controls that the answers call for, and Holm over all; asked at once all three are there at one time."""
    seen: list[tuple[int, int]] = []
    report = run_battery(bank, MODELS, tmp_path / "one", progress=lambda *now: seen.append(now))
    assert weighty.EVENTS == IN_TURN
    assert seen == sorted(seen)
    assert seen[-1][0] == seen[-1][1]
    asked = report.score.models["hf:depth"]
    assert "lead_mid_near" in asked.answers.decisions or "recoloured" in asked.answers.decisions

    weighty.EVENTS.clear()
    together = run_battery(bank, MODELS, tmp_path / "together", sequential=False)
    assert weighty.most_at_once() == 3
    assert together.rows() == report.rows()
    assert {row["p_holm"] for row in report.rows() if row["p_holm"] is not None} > {1.0}
    assert str(together).partition("Scope")[0] == str(report).partition("Scope")[0]


def test_stopping_early_and_what_is_saved_are_the_same(bank: FrameBank, tmp_path: Path) -> None:
    """Each model's calls are its own."""
    for name, how in (("one", ()), ("together", ("--together",))):
        words = ("--frames", bank.root, "--out", tmp_path / name, "--stop-early", *options("--model"), *how)
        assert call("run", "battery", *words).exit_code == 0
        assert weighty.most_at_once() == (3 if how else 1)
        weighty.EVENTS.clear()
    first, second = (battery.score(tmp_path / name) for name in ("one", "together"))
    assert [model.answers.finished for model in first.models.values()] == [
        model.answers.finished for model in second.models.values()
    ]


@pytest.mark.parametrize(
    ("words", "specs"),
    [
        (("prompts", "--prompt", "baseline", "--prompt", "minimal", "--limit", 4), ("--model", MODELS)),
        (("structured", "--limit", 4), ("--model", SCENES)),
        (("admission",), ("--model", SCENES)),
        (("closed-loop", "--simulator", "tiny", "--scenarios", "whole", "--seeds", 2), ("--policy", MODELS)),
        (("online", "--simulator", "short", "--view", "none", "--episodes", 1), ("--model", SCENES)),
    ],
    ids=lambda one: str(one[0]),
)
def test_every_run_keeps_one_model_at_a_time(
    bank: FrameBank, tmp_path: Path, words: tuple[object, ...], specs: tuple[str, tuple[str, ...]]
) -> None:
    """Prompts cell by cell, scenes, admission and drives; what a model gives to think about is said once in each."""
    frames = () if words[0] in {"closed-loop", "online"} else ("--frames", bank.root)
    for how in ((), ("--together",)):
        out = tmp_path / f"run{len(how)}"
        result = call("run", *words, *frames, *options(*specs), "--out", out, *how)
        assert result.exit_code == 0, result.stderr
        assert weighty.most_at_once() == (len(specs[1]) if how else 1)
        assert result.stderr.count("warning: hf:scene_constant: its weights alone do not fit") == (specs[1] == SCENES)
        assert ("one after another, with only one open at a time: " in result.stderr) is not bool(how)
        assert {event.partition(" ")[2] for event in weighty.EVENTS} == {one.partition(":")[2] for one in specs[1]}
        weighty.EVENTS.clear()


def test_what_is_planned_says_who_follows_whom_and_what_weights_take(bank: FrameBank, tmp_path: Path) -> None:
    """The largest of those in turn; all where they are asked at once, with a warning where that is too much."""
    words = ("run", "battery", "--frames", bank.root, "--out", tmp_path / "run", *options("--model"), "--dry-run")
    said = call(*words).stderr
    assert (
        "one after another, with only one open at a time: hf:depth, hf:presence, hf:random; "
        "--together asks them at once" in said
    )
    assert "memory: at most 9 GB of 16 GB for weights at once" in said
    assert "(hf:depth 5 GB, hf:presence 9 GB)" in said
    assert "warning" not in said
    weighty.NEEDS_GB["random"] = "4"
    try:
        said = call(*words, "--together").stderr
    finally:
        del weighty.NEEDS_GB["random"]
    assert "one after another" not in said
    assert "memory: at most 18 GB of 16 GB for weights at once" in said
    assert "warning: these weights do not fit together: ask the models with --sequential" in said
    assert not weighty.EVENTS


def test_a_model_whose_weights_cannot_be_loaded_stops_no_other_and_is_asked_by_a_resume(
    bank: FrameBank, tmp_path: Path
) -> None:
    """It is set aside with why, exit 1; the same command asks it alone, and opens no other."""
    specs = ("hf:depth", "hf:broken:presence", "hf:random")
    words = ("run", "battery", "--frames", bank.root, "--out", tmp_path / "run", *options("--model", specs))
    first = call(*words)
    assert first.exit_code == 1
    assert "set aside: hf:broken:presence: missing_model: the weights cannot be loaded: MemoryError" in first.stderr
    assert weighty.EVENTS == ["open depth", "close depth", "open random", "close random"]
    weighty.EVENTS.clear()
    weighty.MENDED.append("broken:presence")
    second = call(*words)
    assert second.exit_code == 0, second.stderr
    assert weighty.EVENTS == ["open broken:presence", "close broken:presence"]


def test_an_interrupt_between_two_models_is_resumed_with_the_second(bank: FrameBank, tmp_path: Path) -> None:
    """What the first answered is kept; its weights do not come again."""
    words = ("run", "battery", "--frames", bank.root, "--out", tmp_path / "run", *options("--model"))
    weighty.CLOSING.append("depth")
    stopped = call(*words)
    assert stopped.exit_code == 130
    assert "the same command resumes" in stopped.stderr
    assert weighty.EVENTS == ["open depth", "close depth"]
    with Ledger(tmp_path / "run" / LEDGER) as ledger:
        kept = len(ledger.finished())
        assert not ledger.unknown()
    weighty.EVENTS.clear()
    resumed = call(*words)
    assert resumed.exit_code == 0
    assert f"{kept} finished" in resumed.stderr
    assert weighty.EVENTS == ["open presence", "close presence", "open random", "close random"]


def test_a_limit_that_stops_a_run_opens_no_further_model(bank: FrameBank, tmp_path: Path) -> None:
    """Those whose turn has not come keep their calls, exit 3; a higher limit goes on."""
    words = ("run", "battery", "--frames", bank.root, "--out", tmp_path / "run", *options("--model"))
    assert call(*words, "--max-calls", 20).exit_code == 3
    assert weighty.EVENTS == ["open depth", "close depth"]
    assert call(*words).exit_code == 0
    scored = json.loads(call("score", tmp_path / "run", "--json").stdout)
    assert {one["answered"] == one["planned"] for one in scored["models"].values()} == {True}


def test_an_argument_that_is_no_choice_is_said(bank: FrameBank, tmp_path: Path) -> None:
    """From Python, by its name."""
    with pytest.raises(SpecError, match="sequential must be True, False or None, not 'yes'"):
        run_battery(bank, MODELS, tmp_path / "run", sequential="yes")  # type: ignore[arg-type]
