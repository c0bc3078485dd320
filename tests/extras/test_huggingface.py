"""Real checkpoints through ``hf:``: batches change no answer, failures are replies, and nothing unseen is trusted."""

import asyncio
import json
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from doors import assert_keeps_the_door
from eyechart.calls import Query, Reply
from eyechart.errors import SpecError
from eyechart.frames import FrameBank, Stimulus
from eyechart.messages import Turn
from eyechart.models import huggingface, open_model
from eyechart.models.huggingface import HuggingFaceModel, generation, organisms
from eyechart.modes import RequestMode
from eyechart.prompts import PROMPTS
from eyechart.simulators import open_simulator

pytestmark = [pytest.mark.models, pytest.mark.filterwarnings("ignore")]

GREEDY = [name for name, organism in organisms.ORGANISMS.items() if not organism.sampled]


@pytest.fixture(scope="module")
def bank(tmp_path_factory: pytest.TempPathFactory) -> FrameBank:
    """Build 48 frames of four episodes."""
    out = tmp_path_factory.mktemp("hf") / "bank"
    return open_simulator("highway").build(out, seeds=(31,))


def opened(name: str, **mode: Any) -> HuggingFaceModel:  # noqa: ANN401 - any field of a mode
    """Open a checkpoint in a mode of its own."""
    model = open_model(f"hf:{name}", RequestMode(f"hf:{name}", **mode))
    assert isinstance(model, HuggingFaceModel)
    return model


def queries(bank: FrameBank, prompt: str = "baseline") -> list[Query]:
    """Return a query for every frame, and every fourth of them once more without its picture."""
    words = PROMPTS[prompt]
    seen = [
        Query(words.system, words.user, Stimulus.of(bank.image(frame)), number) for number, frame in enumerate(bank)
    ]
    return seen + [Query(words.system, words.user, Stimulus(), 1000 + query.seed) for query in seen[::4]]


def together(model: HuggingFaceModel, asked: Sequence[Query]) -> list[Reply]:
    """Ask every query at once."""

    async def ask() -> list[Reply]:
        try:
            return await asyncio.gather(*(model.answer(query) for query in asked))
        finally:
            await model.close()

    return asyncio.run(ask())


def one_by_one(model: HuggingFaceModel, asked: Sequence[Query]) -> list[Reply]:
    """Ask each query when the one before it is answered."""

    async def ask() -> list[Reply]:
        try:
            return [await model.answer(query) for query in asked]
        finally:
            await model.close()

    return asyncio.run(ask())


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """Copy an organism's checkpoint, to be damaged."""
    return Path(shutil.copytree(organisms.folder("grounded"), tmp_path / "copy"))


@pytest.mark.parametrize("name", GREEDY)
def test_a_checkpoint_keeps_the_door(name: str) -> None:
    """As every adapter's model does."""
    assert_keeps_the_door(RequestMode(f"hf:organism:{name}"))


@pytest.mark.parametrize("prompt", ["baseline", "minimal"])
def test_a_batch_changes_no_greedy_answer(bank: FrameBank, prompt: str) -> None:
    """Every frame gets in a batch, whatever its size, the answer that it gets alone; token counts agree too."""
    asked = queries(bank, prompt)
    alone = one_by_one(opened("organism:grounded"), asked)
    assert len({reply.text for reply in alone}) == 5
    for batch in (7, 64):
        assert together(opened("organism:grounded", options={"batch": batch}), asked) == alone
    assert all(reply.error is None and reply.finish_reason == "stop" for reply in alone)


def test_turns_and_pictures_between_words_reach_the_model_in_their_order(bank: FrameBank) -> None:
    """The template's text has each turn, and the pixels are those of each picture alone, in order."""
    first, last = (bank.image(frame) for frame in (bank.frames[0], bank.frames[-1]))
    turns = (Turn("user", ("One", first, "two")), Turn("assistant", ("STOP",)), Turn("user", (last, "three")))
    model = opened("organism:grounded")
    asked = [Query("", "three", Stimulus(), number, messages=turns) for number in range(2)]
    encoded = model._speaker._encode(asked)
    text = re.sub(r"(<[^>]+>\s*)+", " <> ", model._speaker._reader.decode(encoded["input_ids"][1]))
    assert text.split() == [
        "<>",
        "User:",
        "One",
        "<>",
        "two",
        "<>",
        "Assistant:",
        "STOP",
        "<>",
        "User:",
        "<>",
        "three",
        "<>",
        "Assistant:",
    ]
    alone = [model._speaker._encode([Query("", "?", Stimulus.of(one), 0)])["pixel_values"][0] for one in (first, last)]
    assert encoded["pixel_values"][1].tolist() == [pixels.tolist() for (pixels,) in alone]
    assert [reply.error for reply in together(model, asked)] == [None, None]


def test_a_batch_and_its_order_change_no_drawn_answer(bank: FrameBank) -> None:
    """What is drawn depends on the query and its seed, not on what stands beside it, or where."""
    asked = queries(bank)
    alone = one_by_one(opened("organism:self_inconsistent", temperature=None), asked)
    assert len({reply.text for reply in alone}) >= 5
    assert together(opened("organism:self_inconsistent", temperature=None), asked) == alone
    backwards = together(opened("organism:self_inconsistent", temperature=None, options={"batch": 5}), asked[::-1])
    assert backwards[::-1] == alone
    other = [Query(query.system, query.user, Stimulus.of(query.image), query.seed + 5000) for query in asked]
    again = together(opened("organism:self_inconsistent", temperature=None), other)
    assert sum(one.text != two.text for one, two in zip(again, alone, strict=True)) > len(asked) / 2


def test_a_batch_that_runs_out_of_time_is_a_timeout_and_no_answer(bank: FrameBank, copy: Path) -> None:
    """What was generated so far is counted and not kept as text; time enough changes no answer."""
    asked = queries(bank)[:8]
    endless = json.loads((copy / "generation_config.json").read_text()) | {"eos_token_id": 10**6}
    (copy / "generation_config.json").write_text(json.dumps(endless))
    for reply in together(opened(str(copy), timeout_s=0.05, max_tokens=400), asked):
        assert (reply.error, reply.text, reply.finish_reason) == ("timeout", "", None)
        assert reply.error_detail.startswith("no whole reply within 0.05 s of generating, ")
        assert 0 < (reply.completion_tokens or 0) < 400
    whole = together(opened("organism:grounded", timeout_s=60.0), asked)
    assert whole == together(opened("organism:grounded"), asked)
    assert {reply.error for reply in whole} == {None}


def test_temperature_zero_is_greedy_and_a_temperature_draws(bank: FrameBank) -> None:
    """The mode decides; ``default`` leaves it to the checkpoint's own generation config."""
    asked = queries(bank)[:48]
    greedy = together(opened("organism:self_inconsistent", temperature=0.0), asked)
    assert len({reply.text for reply in greedy}) < 5
    drawn = together(opened("organism:grounded", temperature=50.0, max_tokens=5), asked)
    assert len({reply.text for reply in drawn}) > 30
    own = together(opened("organism:grounded", temperature=None), asked)
    assert own == together(opened("organism:grounded", temperature=0.0), asked)


def test_prompt_and_picture_tokens_are_counted(bank: FrameBank) -> None:
    """A picture costs its tokens: four, and the three that frame them."""
    with_picture, without = queries(bank)[0], queries(bank)[-1]
    seen, unseen = together(opened("organism:blind"), [with_picture, without])
    assert seen.prompt_tokens is not None
    assert unseen.prompt_tokens is not None
    assert seen.prompt_tokens - unseen.prompt_tokens == 7
    assert seen.completion_tokens == unseen.completion_tokens == 7
    assert seen.first_byte_s is None


def test_a_budget_spent_without_an_end_is_length(bank: FrameBank) -> None:
    """One token short of the whole answer is cut; the exact budget is enough."""
    asked = queries(bank)[:3]
    for budget, reason in ((6, "length"), (7, "stop")):
        for reply in together(opened("organism:grounded", max_tokens=budget), asked):
            assert (reply.finish_reason, reply.completion_tokens) == (reason, budget)


def test_the_event_loop_lives_while_a_batch_is_generated(bank: FrameBank) -> None:
    """Other work of the loop goes on: no pause comes near the time that the batch takes."""
    model, asked = opened("organism:grounded"), queries(bank)

    async def ask() -> tuple[float, float]:
        await model.answer(asked[0])
        pauses = [0.0]

        async def tick() -> None:
            while True:
                began = time.perf_counter()
                await asyncio.sleep(0.002)
                pauses.append(time.perf_counter() - began)

        ticker, began = asyncio.create_task(tick()), time.perf_counter()
        await asyncio.gather(*(model.answer(query) for query in asked * 4))
        took = time.perf_counter() - began
        ticker.cancel()
        await model.close()
        return took, float(len(pauses))

    took, ticks = asyncio.run(ask())
    assert ticks > 10 * took


def test_a_closed_model_answers_again(bank: FrameBank) -> None:
    """Closing twice is no error, and a new event loop begins anew."""
    model, asked = opened("organism:presence_only"), queries(bank)[:2]
    first = together(model, asked)
    assert together(model, asked) == first

    async def twice() -> None:
        await model.close()
        await model.close()

    asyncio.run(twice())


def test_a_picture_that_cannot_be_read_fails_its_own_query_only(bank: FrameBank) -> None:
    """Its Reply has an error; the others of its batch have their answers."""
    asked = queries(bank)[:6]
    broken = Query("", "?", Stimulus.of(b"no picture"), 0)
    replies = together(opened("organism:grounded"), [*asked[:3], broken, *asked[3:]])
    assert [reply.error for reply in replies] == [None] * 3 + ["exception"] + [None] * 3
    assert "no picture" in replies[3].error_detail
    assert replies[3].text == ""
    assert replies[:3] + replies[4:] == together(opened("organism:grounded"), asked)


def test_a_batch_too_large_for_the_memory_is_made_smaller(bank: FrameBank, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same answers come in smaller batches, and later ones are not tried large again."""
    import torch  # noqa: PLC0415 - an extra

    asked, sizes = queries(bank)[:32], []
    plain = together(opened("organism:grounded"), asked)
    generate = generation.TextGenerator._generate

    def small(speaker: generation.TextGenerator, batch: Sequence[Query], inputs: object) -> list[Reply]:
        sizes.append(len(batch))
        if len(batch) > 8:
            raise torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 2.00 GiB")
        return generate(speaker, batch, inputs)

    monkeypatch.setattr(generation.TextGenerator, "_generate", small)
    assert together(opened("organism:grounded", options={"batch": 16}), asked) == plain
    assert sum(size > 8 for size in sizes) == 1


def test_no_memory_for_one_query_is_a_reply(bank: FrameBank, monkeypatch: pytest.MonkeyPatch) -> None:
    """It says so, and what to do."""
    import torch  # noqa: PLC0415 - an extra

    def never(speaker: generation.TextGenerator, batch: Sequence[Query], inputs: object) -> list[Reply]:
        del speaker, batch, inputs
        raise torch.OutOfMemoryError("CUDA out of memory.")

    monkeypatch.setattr(generation.TextGenerator, "_generate", never)
    for reply in together(opened("organism:grounded"), queries(bank)[:3]):
        assert reply.error == "exception"
        assert reply.error_detail.startswith("out of memory with one query: take a smaller dtype or another device")


def test_weights_that_cannot_be_loaded_are_replies(bank: FrameBank, copy: Path) -> None:
    """A damaged file ends no run: every query learns why, and further ones would too."""
    (copy / "model.safetensors").write_bytes(b"damaged")
    for reply in together(opened(str(copy)), queries(bank)[:2]):
        assert reply.error == "missing_model"
        assert reply.error_detail.startswith(f"the weights of '{copy}' cannot be loaded: ")


def test_no_memory_for_the_weights_is_said(bank: FrameBank, monkeypatch: pytest.MonkeyPatch) -> None:
    """In one line, with what to do; once there is room, and the model was closed, it answers."""
    import torch  # noqa: PLC0415 - an extra

    def full(*_: object, **__: object) -> None:
        raise torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 2.00 GiB.\nSee the documentation")

    model = opened("organism:grounded")
    with monkeypatch.context() as patched:
        patched.setattr(torch.nn.Module, "to", full)
        (reply,) = together(model, queries(bank)[:1])
    assert reply.error == "missing_model"
    assert (
        "cannot be loaded: out of memory: load it smaller with --option dtype=bfloat16 or bits=4" in reply.error_detail
    )
    assert "free memory that other programs hold (OutOfMemoryError: CUDA out of memory." in reply.error_detail
    assert "\n" not in reply.error_detail
    (reply,) = together(model, queries(bank)[:1])
    assert reply.error is None


@pytest.mark.parametrize(
    "error",
    [
        ImportError(
            "\nQwen2VLImageProcessor requires the Torchvision library but it was not found in your environment."
        ),
        ValueError("Could not load any image processor class. Missing optional dependencies: torchvision. Please"),
    ],
)
def test_a_package_that_a_processor_lacks_is_named(error: Exception, monkeypatch: pytest.MonkeyPatch) -> None:
    """However the version of Transformers says it."""
    from transformers import AutoProcessor  # noqa: PLC0415 - an extra

    def lacking(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(AutoProcessor, "from_pretrained", lacking)
    with pytest.raises(SpecError, match=r"cannot be opened: it needs torchvision: pip install torchvision$"):
        opened("organism:grounded")


def test_pickled_weights_are_not_loaded(bank: FrameBank, copy: Path) -> None:
    """Only safetensors are: a pickle is a program."""
    import torch  # noqa: PLC0415 - an extra
    from safetensors.torch import load_file  # noqa: PLC0415

    torch.save(load_file(copy / "model.safetensors"), copy / "pytorch_model.bin")
    (copy / "model.safetensors").unlink()
    (reply,) = together(opened(str(copy)), queries(bank)[:1])
    assert reply.error == "missing_model"


@pytest.mark.parametrize(
    ("template", "message"),
    [
        ("{{ messages[-1]['content'][-1]['text'] }}", "has no image slot: the picture would never reach the model"),
        ("{{ messages[-1]['content'] + '?' }}", "takes no picture: "),
        (None, "has no chat template, so it takes no prompt"),
    ],
)
def test_a_chat_template_without_an_image_slot_is_refused(copy: Path, template: str | None, message: str) -> None:
    """Before any call, in words: otherwise a model that is never shown a picture would be judged blind."""
    file = copy / "chat_template.jinja"
    file.unlink() if template is None else file.write_text(template, encoding="utf-8")
    with pytest.raises(SpecError, match="template") as caught:
        opened(str(copy))
    assert message in str(caught.value)


def test_the_version_is_the_digest_of_what_answers(copy: Path) -> None:
    """Another weight is another version; another card is not."""
    before = opened(str(copy)).version
    assert before == opened("organism:grounded").version
    (copy / "README.md").write_text("another card", encoding="utf-8")
    assert opened(str(copy)).version == before
    config = json.loads((copy / "generation_config.json").read_text(encoding="utf-8"))
    (copy / "generation_config.json").write_text(json.dumps(config | {"do_sample": True}), encoding="utf-8")
    assert opened(str(copy)).version != before


def test_what_is_known_of_a_model_is_recorded() -> None:
    """Device, precision, template and library versions go into the run's manifest."""
    facts = opened("organism:grounded", options={"device": "cpu"}).facts
    assert facts["device"] == "cpu"
    assert facts["dtype"] == "float32"
    weighed = {"parameters", "weights_gb", "memory_gb"}
    assert set(facts) == {"device", "dtype", "template", "torch", "transformers"} | weighed


def test_a_revision_is_pinned_to_its_commit(copy: Path, tmp_path: Path) -> None:
    """Out of reach of the Hub the cache says which commit a branch stands for, and that commit is what is loaded."""
    commit = "0123456789abcdef0123456789abcdef01234567"
    repository = tmp_path / "hub" / "models--somebody--something"
    shutil.copytree(copy, repository / "snapshots" / commit)
    (repository / "refs").mkdir()
    (repository / "refs" / "main").write_text(commit, encoding="utf-8")
    program = (
        "from eyechart.models import open_model\n"
        "model = open_model('hf:somebody/something')\n"
        "print(model.version, model.facts['revision'])\n"
        "try:\n    open_model('hf:nobody/nothing')\n"
        "except Exception as error:\n    print(error)\n"
    )
    environment = {**os.environ, "HF_HUB_OFFLINE": "1", "HF_HUB_CACHE": str(tmp_path / "hub")}
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", program], capture_output=True, text=True, check=True, env=environment
    )
    first, second = done.stdout.splitlines()
    assert first == f"{commit} {commit}"
    assert second == "the Hub cannot be reached (OfflineModeIsEnabled) and 'nobody/nothing' is not in the cache"


def test_code_from_a_repository_runs_only_where_asked_by_name(copy: Path) -> None:
    """A checkpoint that brings a processor of its own is refused, with what to do."""
    for name in ("processor_config.json", "tokenizer_config.json"):
        values = json.loads((copy / name).read_text(encoding="utf-8"))
        values |= {"processor_class": "Evil", "auto_map": {"AutoProcessor": "evil.Evil", "AutoTokenizer": "evil.Evil"}}
        (copy / name).write_text(json.dumps(values), encoding="utf-8")
    ran = copy / "ran"
    (copy / "evil.py").write_text(f"open({str(ran)!r}, 'w').close()\nclass Evil: ...\n", encoding="utf-8")
    with pytest.raises(SpecError, match="trust_remote_code=true"):
        opened(str(copy))
    assert not ran.exists()


@pytest.mark.parametrize(
    ("mode", "message"),
    [
        ({"options": {"devise": "cpu"}}, "has no option 'devise'; did you mean 'device'? its options are: device: "),
        ({"options": {"device": "cuda:99"}}, "device 'cuda:99' is not available here"),
        ({"options": {"dtype": "int4"}}, "dtype is one of float32, float16, bfloat16, not 'int4'"),
        ({"options": {"batch": 0}}, "batch a whole number of at least 1"),
        ({"options": {"trust_remote_code": "yes"}}, "trust_remote_code is true or false"),
        ({"structured": "json_schema"}, "where 'structured' has no effect"),
    ],
)
def test_what_cannot_be_done_is_refused(mode: dict[str, Any], message: str) -> None:
    """A mode that this adapter would silently ignore is an error before any call."""
    with pytest.raises(SpecError) as caught:
        opened("organism:grounded", **mode)
    assert message in str(caught.value)


@pytest.mark.parametrize("name", list(organisms.SAYS))
def test_an_organism_is_a_small_ordinary_checkpoint(name: str) -> None:
    """Under one megabyte with tokenizer, processor and card; safetensors, and nothing that would be run."""
    files = list(organisms.folder(name).iterdir())
    assert sum(path.stat().st_size for path in files) < 1_000_000
    assert {path.suffix for path in files} == {".json", ".jinja", ".md", ".safetensors"}
    card = (organisms.folder(name) / "README.md").read_text(encoding="utf-8")
    for part in ("How it was trained", "On what", "What it is not"):
        assert part in card


def test_the_batterys_organisms_share_one_vision_part() -> None:
    """Between them only what stands behind the eye differs."""
    from safetensors.torch import load_file  # noqa: PLC0415 - an extra

    weights = [load_file(organisms.folder(name) / "model.safetensors") for name in organisms.ORGANISMS]
    for key, value in weights[0].items():
        same = [bool((value == other[key]).all()) for other in weights[1:]]
        assert all(same) or "text_model" in key


def test_adapters_names_open_nothing_heavy() -> None:
    """Listing models imports no torch."""
    program = (
        "import sys\nfrom eyechart.models import huggingface\nprint(len(huggingface.names()))\n"
        "print([name for name in ('torch', 'transformers') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == [str(len(huggingface.names())), "[]"]
