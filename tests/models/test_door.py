"""The door that every adapter keeps: contract tests over the registry."""

import asyncio
import importlib
import inspect

import numpy as np
import pytest

from eyechart.calls import Query, Reply
from eyechart.errors import SpecError
from eyechart.frames import encode
from eyechart.models import ADAPTERS, open_model

EXAMPLES: dict[str, str] = {
    "scripted": "scripted:constant",
}
"""A model of every adapter that can be opened here, without a network or weights."""

PICTURE = encode(np.full((16, 60, 3), 128, dtype=np.uint8))


@pytest.mark.parametrize("adapter", ADAPTERS)
def test_every_adapter_opens_a_model_that_keeps_the_door(adapter: str) -> None:
    """A version in words, and an answer that is a Reply, with a picture and without: text, or an error of its kind."""
    model = open_model(EXAMPLES[adapter])
    assert isinstance(model.version, str)
    assert model.version.isprintable()
    assert inspect.iscoroutinefunction(model.answer)
    for image in (None, PICTURE):
        reply = asyncio.run(model.answer(Query("", "STOP or GO?", image, 1)))
        assert isinstance(reply, Reply)
        assert reply.error is None or (reply.text == "" and reply.error_detail)


@pytest.mark.parametrize("adapter", ADAPTERS)
def test_every_adapter_says_what_to_write_after_its_colon(adapter: str) -> None:
    """For ``eyechart list models``."""
    names = importlib.import_module(ADAPTERS[adapter]).names()
    assert names
    assert all(name and says.strip() for name, says in names.items())


@pytest.mark.parametrize("adapter", ADAPTERS)
def test_every_adapter_refuses_an_empty_name_in_words(adapter: str) -> None:
    """Not with a traceback."""
    with pytest.raises(SpecError):
        open_model(f"{adapter}:")
