"""The request modes of the paper's hosted and structured models: as the paper prints them, and what is ours is said."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

import banks
from eyechart.cli.app import app
from eyechart.errors import SpecError
from eyechart.manifest import read_manifest
from eyechart.models import find_mode, known_modes, ollama
from eyechart.modes import RequestMode
from faults import Loopback
from ollama_stand_in import StandIn

HOSTED = {
    "hosted-qwen2.5-vl-72b": "Qwen2.5-VL-72B",
    "hosted-minicpm-v-4.5": "MiniCPM-V-4.5",
    "hosted-cosmos3-super-reasoner": "Cosmos3-Super-Reasoner (33B)",
    "hosted-kimi-k2.6": "Kimi-K2.6",
    "hosted-kimi-k3": "Kimi-K3",
}
STRUCTURED = {
    "structured-qwen3-vl-8b": "Qwen3-VL-8B",
    "structured-gemma4-12b": "Gemma 4-12B",
    "structured-qwen3.5-9b": "Qwen3.5-9B",
    "structured-qwen2.5-vl-7b": "Qwen2.5-VL-7B",
    "structured-ministral-3-8b": "Ministral 3-8B",
    "structured-minicpm-v-4.5": "MiniCPM-V-4.5",
}
"""The models of both arms, as the paper's section Models names them."""


def call(*words: object) -> Result:
    """Return what a command does; an error of eyechart's is raised."""
    result = CliRunner().invoke(app, list(map(str, words)))
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result


def test_there_is_a_mode_of_every_model_of_both_arms() -> None:
    """And no other: eleven modes, each of a model of its own."""
    modes = known_modes()
    assert {name: mode.about["paper"] for name, mode in modes.items()} == HOSTED | STRUCTURED
    assert len({mode.spec for mode in modes.values()}) == 11


@pytest.mark.parametrize("name", [*HOSTED, *STRUCTURED])
def test_a_mode_says_what_is_printed_and_what_is_ours(name: str) -> None:
    """It was never tried, names its source, holds no secret or address, and keeps to what its adapter knows."""
    mode = known_modes()[name]
    assert list(mode.about) == ["paper", "arm", "tested", "source", "printed", "ours"]
    assert all(mode.about.values())
    assert (mode.about["tested"], mode.measured, mode.headers, mode.base_url) == ("no", None, {}, "")
    assert "section Models" in mode.about["source"]
    hosted = name in HOSTED
    assert mode.about["arm"] == ("hosted" if hosted else "structured local")
    assert mode.spec.startswith("openai:" if hosted else "ollama:")
    assert set(mode.options) <= set(() if hosted else ollama.OPTIONS)
    assert mode.temperature == 0.0


@pytest.mark.parametrize(
    ("name", "max_tokens", "words"),
    [
        ("hosted-kimi-k2.6", 4096, "28 % of calls"),
        ("hosted-kimi-k3", 4096, "0.7 % of calls"),
        ("hosted-cosmos3-super-reasoner", 1024, "mean of 187 tokens"),
    ],
)
def test_the_budgets_are_those_that_the_paper_prints(name: str, max_tokens: int, words: str) -> None:
    """4096 tokens with JSON-mode output for both Kimi models, the shared 1024 for the others."""
    mode = known_modes()[name]
    assert (mode.max_tokens, mode.structured) == (max_tokens, "json_object")
    assert words in mode.about["printed"]


def test_where_a_mode_comes_from_changes_no_request() -> None:
    """It is kept with a run, and a run is resumed by the same mode without it."""
    mode = known_modes()["structured-gemma4-12b"]
    plain = RequestMode(mode.spec, structured="json_schema", options={"think": False})
    assert mode.is_same_request(plain)
    assert RequestMode.from_dict(mode.as_dict()) == mode


def test_a_mode_without_a_server_says_what_to_do(tmp_path: Path) -> None:
    """The hosted ones, for the paper names no endpoint; the text that is written reads back, and takes an address."""
    with pytest.raises(
        SpecError, match=r"names no server, because the paper names none\. Write it to a file with 'eyechart"
    ):
        find_mode(Path("hosted-kimi-k3"))
    written = call("list", "modes", "hosted-kimi-k3").stdout
    (tmp_path / "mode.toml").write_text(f'base_url = "http://127.0.0.1:1/v1"\n{written}', encoding="utf-8")
    assert find_mode(tmp_path / "mode.toml").base_url == "http://127.0.0.1:1/v1"
    with pytest.raises(SpecError, match=r"no request mode 'hosted-kimi-k4'; did you mean 'hosted-kimi-k3'"):
        call("list", "modes", "hosted-kimi-k4")
    with pytest.raises(SpecError, match=r"no request mode 'nothing'; give FILE.toml, or see 'eyechart list modes'"):
        find_mode(Path("nothing"))


def test_the_list_says_that_none_was_tried() -> None:
    """One line a mode, or all their fields as JSON."""
    lines = call("list", "modes").stdout.splitlines()
    assert len(lines) == 11
    assert all(line.endswith("; untested") for line in lines)
    kimi = "the paper's Kimi-K3 (hosted arm): openai:moonshotai/Kimi-K3, 4096 tokens, json_object, temperature 0"
    assert kimi in lines[2]
    told = json.loads(call("list", "modes", "--json").stdout)
    assert {name: one["spec"] for name, one in told.items()} == {
        name: mode.spec for name, mode in known_modes().items()
    }


def test_a_structured_mode_is_asked_by_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Against a stand-in of Ollama: the request holds what the mode says, and the run keeps where it comes from."""
    bank = banks.build_bank(tmp_path / "bank", scenarios=["light", "dense"], episodes=1)
    names = ("gemma4:12b", "qwen2.5vl:7b")
    server = StandIn(models=names)
    with Loopback(server.app()) as served:
        monkeypatch.setattr(ollama, "BASE_URL", f"http://127.0.0.1:{served.port}")
        asked = ("--mode", "structured-gemma4-12b", "--mode", "structured-qwen2.5-vl-7b")
        words = ("run", "structured", "--frames", bank.root, "--limit", 2, "--out", tmp_path / "run", *asked)
        result = call(*words)
    assert "note: the mode structured-gemma4-12b of ollama:gemma4:12b was never tried" in result.stderr
    assert {one["model"] for one in server.asked} == set(names)
    for one in server.asked:
        assert one["options"] == {"num_predict": 1024, "temperature": 0.0}
        assert isinstance(one["format"], dict)
        assert one.get("think") is (False if one["model"] == "gemma4:12b" else None)
    order = [event for place, event in enumerate(server.events) if event != ([None, *server.events])[place]]
    assert order == [f"{what} {name}" for name in names for what in ("ask", "unload")]
    assert read_manifest(tmp_path / "run").modes["ollama:gemma4:12b"].about["tested"] == "no"
