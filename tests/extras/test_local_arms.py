"""Local models with real weights: the paper's edge architectures, how weights are loaded, and one model at a time."""

import asyncio
import json
import weakref
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import banks
from eyechart.api import run_battery
from eyechart.calls import Query, Reply
from eyechart.errors import LedgerError, SpecError
from eyechart.frames import FrameBank, Stimulus, encode
from eyechart.models import open_model
from eyechart.models.huggingface import HuggingFaceModel, generation, organisms, weights
from eyechart.models.huggingface.checkpoint import edge_models
from eyechart.models.huggingface.weights import LoadSettings, Weights, weigh, weights_by_type
from eyechart.modes import RequestMode
from tiny_checkpoints import EDGE, published

pytestmark = [pytest.mark.models, pytest.mark.filterwarnings("ignore")]

PICTURES = [
    *(encode(np.full((60, 120, 3), level, dtype=np.uint8)) for level in (0, 120, 255)),
    encode(np.random.default_rng(1).integers(0, 255, (60, 120, 3), dtype=np.uint8)),
]
ADDED = {
    "HuggingFaceTB/SmolVLM-Instruct": 3 * 4 + 9,
    "llava-hf/llava-1.5-7b-hf": 4 * 4,
    "Qwen/Qwen2-VL-2B-Instruct": 4 * 8 // 4 + 2,
    "Qwen/Qwen2-VL-7B-Instruct": 4 * 8 // 4 + 2,
}
"""Tokens that a picture of 60 x 120 adds.

SmolVLM: two tiles and the whole, 4 tokens each, framed by 9. LLaVA: 56 x 56 in patches of 14. Qwen2-VL: scaled to
56 x 112, in patches of 14, four of which are one token, between two that frame them.
"""
NEEDS_TORCHVISION = [name for name in EDGE if name.startswith("Qwen/")]


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Return a bank of six frames."""
    out = tmp_path_factory.mktemp("arms") / "bank"
    return banks.build_bank(out, scenarios=["light", "dense"], episodes=1)


def opened(name: object, **mode: Any) -> HuggingFaceModel:  # noqa: ANN401 - any field of a mode
    """Open a checkpoint in a mode of its own."""
    model = open_model(f"hf:{name}", RequestMode(f"hf:{name}", **mode))
    assert isinstance(model, HuggingFaceModel)
    return model


def answers(model: HuggingFaceModel, pictures: list[bytes | None], *, together: bool = False) -> list[Reply]:
    """Ask about pictures, one by one or at once."""

    async def ask() -> list[Reply]:
        queries = [Query("Drive.", "Which action?", Stimulus.of(picture), 1) for picture in pictures]
        try:
            if together:
                return await asyncio.gather(*(model.answer(query) for query in queries))
            return [await model.answer(query) for query in queries]
        finally:
            await model.close()

    return asyncio.run(ask())


@pytest.mark.parametrize("name", EDGE)
def test_the_papers_edge_architectures_are_asked_through_their_own_processors(name: str, tmp_path: Path) -> None:
    """With random weights: the tokens of a picture are counted, its pixels matter, and a batch changes no answer.

    Qwen2-VL's processor needs torchvision. Where that is not installed it is refused in words, and not exercised.
    """
    torch.manual_seed(0)
    EDGE[name](tmp_path)
    if name in NEEDS_TORCHVISION and find_spec("torchvision") is None:
        with pytest.raises(SpecError, match=r"cannot be opened: it needs torchvision: pip install torchvision$"):
            opened(tmp_path)
        return
    model = opened(tmp_path, max_tokens=12)
    *seen, blind = answers(model, [*PICTURES, None])
    assert [one.error for one in (*seen, blind)] == [None] * 5
    assert {one.prompt_tokens - blind.prompt_tokens for one in seen} == {ADDED[name]}  # type: ignore[operator]
    assert len({one.text for one in seen}) == len(PICTURES)
    plain = PICTURES[:3]  # of equal patches; sums over noise may differ in a last bit
    assert answers(opened(tmp_path, max_tokens=12), plain, together=True) == seen[:3]


def test_weights_are_gone_before_the_next_model_loads_its_own(
    bank: FrameBank, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a run of three checkpoints by the default, at every loading no other network lives; together they all do."""
    alive: weakref.WeakSet[torch.nn.Module] = weakref.WeakSet()
    seen: list[int] = []
    load = generation.TextGenerator._load

    def noting(speaker: generation.TextGenerator) -> None:
        seen.append(len(alive))
        load(speaker)
        alive.add(speaker._model)

    monkeypatch.setattr(generation.TextGenerator, "_load", noting)
    specs = [f"hf:organism:{name}" for name in ("blind", "presence_only", "grounded")]
    how: dict[str, Any] = {"conditions": ("real", "real_repeat", "blank"), "limit": 3}
    report = run_battery(bank, specs, tmp_path / "one", **how)
    assert seen == [0, 0, 0]
    assert not alive
    seen.clear()
    together = run_battery(bank, specs, tmp_path / "together", sequential=False, **how)
    assert sorted(seen) == [0, 1, 2]
    assert together.rows() == report.rows()


def test_accelerate_places_weights_without_changing_an_answer() -> None:
    """On one CPU a device map has one place; the manifest says who placed them."""
    plain, spread = opened("organism:grounded"), opened("organism:grounded", options={"device_map": "auto"})
    asked = [encode(banks.draw(gap, 1)) for gap in (5.0, 20.0, 40.0)]
    assert answers(spread, asked) == answers(plain, asked)  # type: ignore[arg-type]
    assert spread.facts["device_map"] == "auto"
    assert spread.facts["accelerate"] == version("accelerate")
    assert spread.version == plain.version


@pytest.mark.parametrize("bits", [4, 8])
def test_weights_are_packed_by_bitsandbytes(bits: int) -> None:
    """They answer still, and are another version; where the package is not installed, that is said before any call."""
    how = {"bits": bits}
    try:
        package = version("bitsandbytes")
    except PackageNotFoundError:
        with pytest.raises(SpecError, match=rf"bits={bits} needs bitsandbytes: pip install bitsandbytes$"):
            opened("organism:grounded", options=how)
        return
    model = opened("organism:grounded", options=how)
    assert model.version.endswith(f" {bits} bits")
    assert (model.facts["bitsandbytes"], model.facts["quantisation"][:6]) == (package, f"{bits} bits")
    (reply,) = answers(model, [encode(banks.draw(5.0, 1))])
    assert (reply.error, reply.finish_reason) == (None, "stop")


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"bits": 3}, "bits is 4 or 8, not '3'"),
        ({"bits": True}, "bits is 4 or 8, not 'True'"),
        ({"device_map": "anywhere"}, "device_map is one of auto, balanced, balanced_low_0, sequential, not 'anywhere'"),
        ({"device_map": "auto", "device": "cpu"}, "device_map spreads them: give only one"),
    ],
)
def test_a_loading_that_cannot_be_is_refused(options: dict[str, Any], says: str) -> None:
    """Before any call, in words."""
    with pytest.raises(SpecError) as caught:
        opened("organism:grounded", options=options)
    assert says in str(caught.value)


@pytest.mark.parametrize("package", ["accelerate", "bitsandbytes"])
def test_a_package_that_is_missing_is_named(package: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """With what to install; packing needs both."""

    def found(name: str) -> str:
        if name == package:
            raise PackageNotFoundError(name)
        return "1"

    monkeypatch.setattr(weights, "version", found)
    with pytest.raises(SpecError, match=rf"bits=4 needs {package}: pip install {package}$"):
        opened("organism:grounded", options={"bits": 4})


def test_a_checkpoint_that_is_packed_already_is_not_packed_again(tmp_path: Path) -> None:
    """Its own method is known from its configuration, before a weight is loaded."""
    EDGE["llava-hf/llava-1.5-7b-hf"](tmp_path)
    config = json.loads((tmp_path / "config.json").read_text(encoding="utf-8"))
    packed = config | {"quantization_config": {"quant_method": "awq", "bits": 4}}
    (tmp_path / "config.json").write_text(json.dumps(packed), encoding="utf-8")
    assert opened(tmp_path).facts["quantisation"] == "awq"
    with pytest.raises(SpecError, match=r"are packed already \(awq\): leave out --option bits"):
        opened(tmp_path, options={"bits": 4})


def test_precision_is_part_of_what_answers(bank: FrameBank, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A run is not resumed in another one: neither by an option, nor where the default became another."""
    spec, how = "hf:organism:blind", {"conditions": ("real", "blank", "real_repeat"), "limit": 2}
    mode = RequestMode(spec, options={"dtype": "bfloat16"})
    report = run_battery(bank, [mode], tmp_path / "run", **how)  # type: ignore[arg-type]
    assert report.score.manifest.models[spec] == f"{opened('organism:blind').version} bfloat16"
    assert report.score.manifest.facts[spec]["dtype"] == "bfloat16"
    for other in ({}, {"dtype": "float16"}, {"dtype": "bfloat16", "batch": 2}):
        with pytest.raises(LedgerError, match=r"now|another mode"):
            run_battery(bank, [RequestMode(spec, options=other)], tmp_path / "run", **how)  # type: ignore[arg-type]

    run_battery(bank, [spec], tmp_path / "default", **how)  # type: ignore[arg-type]
    monkeypatch.setattr(weights, "_choose_dtype", lambda *_: "bfloat16")  # as on a GPU, where the checkpoint's own is
    with pytest.raises(LedgerError, match=r"at version .*, which is now .* bfloat16"):
        run_battery(bank, [spec], tmp_path / "default", **how)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", EDGE)
def test_what_is_said_of_an_edge_models_size_is_counted(name: str) -> None:
    """By Transformers from the published dimensions, with no memory for a weight; the last layer is never packed."""
    facts = edge_models()[name]
    with torch.device("meta"):
        network = published(name)
    assert type(network).__name__ == facts["architecture"]
    assert network.num_parameters() == facts["parameters"]
    last = network.get_output_embeddings()
    layers = (module for module in network.modules() if isinstance(module, torch.nn.Linear) and module is not last)
    assert sum(layer.weight.numel() for layer in layers) == facts["linear"]


def test_weights_are_weighed_before_they_are_loaded(tmp_path: Path) -> None:
    """By the headers of the files, as many as torch counts; in each precision what torch then holds."""
    EDGE["llava-hf/llava-1.5-7b-hf"](tmp_path)
    model = opened(tmp_path, options={"dtype": "bfloat16"})
    speaker = model._speaker
    speaker._load()
    network = speaker._model
    assert model.facts["parameters"] == str(network.num_parameters())
    assert float(model.facts["weights_gb"]) == pytest.approx(network.get_memory_footprint() / 1e9, rel=0.01)
    linear = sum(
        one.weight.numel()
        for name, one in network.named_modules()
        if isinstance(one, torch.nn.Linear) and "lm_head" not in name
    )
    found = weigh(tmp_path)
    assert found is not None
    assert found.packed == linear
    (tmp_path / "model.safetensors").write_bytes(b"\xff" * 40)
    assert weigh(tmp_path) is None


def test_what_weights_take_is_parameters_times_bytes() -> None:
    """Of packed ones 4.5 bits each with their scales; what the Hub tells by type is taken, and packed is not known."""
    whole = Weights(7_000_000_000, 14_000_000_000, 6_500_000_000)
    assert LoadSettings("cpu", "float32").gigabytes(whole) == 28.0
    assert LoadSettings("cuda", "float16").gigabytes(whole) == 14.0
    assert LoadSettings("cuda", "float16", bits=8).gigabytes(whole) == 7.5
    assert LoadSettings("cuda", "float16", bits=4).gigabytes(whole) == pytest.approx(6.5 * 4.5 / 8 + 1.0)
    told = weights_by_type({"BF16": 2_000, "F32": 10})
    assert told == Weights(2_010, 4_040)
    assert LoadSettings("cuda", "float16", bits=4).gigabytes(told) is None
    assert LoadSettings("cuda", "auto").gigabytes(told) == 4_040 / 1e9
    assert weights_by_type({}) is None


def test_weights_that_do_not_fit_are_warned_of(monkeypatch: pytest.MonkeyPatch) -> None:
    """Before any call, with what to do; what there is stands in the manifest."""
    monkeypatch.setattr(weights, "memory_here_gb", lambda: 1e-4)
    facts = opened("organism:grounded").facts
    assert facts["memory_gb"] == "0.0001"
    assert facts["warning"].startswith(
        "its weights alone take 0.0 GB as float32, the memory is 0.0 GB: load it smaller"
    )
    monkeypatch.setattr(weights, "memory_here_gb", lambda: None)
    assert "memory_gb" not in opened("organism:grounded").facts


def test_an_organism_weighs_what_its_file_does() -> None:
    """Whatever the precision that it is stored in, the parameters are those of its network."""
    found = weigh(organisms.folder("grounded"))
    assert found is not None
    assert 300_000 < found.parameters < 500_000
    assert found.stored_bytes == 2 * found.parameters
