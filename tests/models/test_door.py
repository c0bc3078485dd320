"""The door that every adapter keeps: contract tests over the registry."""

import importlib
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from doors import assert_keeps_the_door
from eyechart.errors import SpecError
from eyechart.frames import encode
from eyechart.models import ADAPTERS, open_model, require_options
from eyechart.modes import RequestMode
from faults import Loopback
from ollama_stand_in import StandIn

PICTURE = encode(np.full((16, 60, 3), 128, dtype=np.uint8))


EXAMPLES: dict[str, RequestMode] = {
    "scripted": RequestMode("scripted:constant"),
    "openai": RequestMode("openai:m", base_url="http://127.0.0.1:9/v1"),
    "ollama": RequestMode("ollama:llava"),
    "python": RequestMode("python:test_door:decide"),
}
"""A model of every adapter that can be opened here, without weights or a key."""


@pytest.fixture(scope="module")
def examples() -> Iterator[dict[str, RequestMode]]:
    """Yield the examples, that of Ollama at the address of a stand-in: it is asked what it is when it is opened."""
    with Loopback(StandIn().app()) as ollama:
        yield EXAMPLES | {"ollama": replace(EXAMPLES["ollama"], base_url=f"http://127.0.0.1:{ollama.port}")}


def decide(prompt: str, image: bytes | None) -> str:
    """Answer as a callable of one's own."""
    del prompt, image
    return "GO"


NEEDS_AN_EXTRA = {"hf"}
"""Adapters whose example stands in tests/extras."""


@pytest.mark.parametrize("adapter", [name for name in ADAPTERS if name not in NEEDS_AN_EXTRA])
@pytest.mark.parametrize("image", [None, PICTURE], ids=["without", "with a picture"])
def test_every_adapter_opens_a_model_that_keeps_the_door(
    adapter: str, image: bytes | None, examples: dict[str, RequestMode]
) -> None:
    """A version and facts in words, an answer that is a Reply or an error of its kind, and two closings."""
    assert_keeps_the_door(examples[adapter], image)


@pytest.mark.parametrize("adapter", ADAPTERS)
def test_every_adapter_says_what_to_write_after_its_colon(adapter: str) -> None:
    """For ``eyechart list models``."""
    names = importlib.import_module(ADAPTERS[adapter]).names()
    assert names
    assert all(name and says.strip() for name, says in names.items())


def test_the_mode_of_another_model_is_refused() -> None:
    """A mode is one model's."""
    with pytest.raises(SpecError, match="the mode of 'scripted:depth' is not one of 'scripted:random'"):
        open_model("scripted:random", RequestMode("scripted:depth"))


def test_an_option_that_an_adapter_does_not_know_is_named_with_those_it_knows() -> None:
    """Silence would let a mistyped option pass for one that works."""
    mode = RequestMode("x:y", options={"thinks": True})
    with pytest.raises(
        SpecError,
        match="'x:y' has no option 'thinks'; did you mean 'think'\\? its options are: think: whether it thinks",
    ):
        require_options(mode, {"think": "whether it thinks"})
    require_options(mode, {"thinks": ""})


@pytest.mark.parametrize("adapter", ADAPTERS)
def test_every_adapter_refuses_an_empty_name_in_words(adapter: str) -> None:
    """Not with a traceback."""
    with pytest.raises(SpecError):
        open_model(f"{adapter}:")
