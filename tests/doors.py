"""What every adapter's model keeps to, asserted of one that can be opened where the test runs."""

import asyncio
import inspect
from collections.abc import Mapping

from eyechart.calls import Query, Reply
from eyechart.frames import Stimulus
from eyechart.models import open_model
from eyechart.modes import RequestMode


def assert_keeps_the_door(mode: RequestMode, image: bytes | None = None) -> None:
    """Assert a version and facts in words, an answer that is a Reply or an error of its kind, and two closings."""
    model = open_model(mode.spec, mode)
    assert isinstance(model.version, str)
    assert model.version.isprintable()
    assert isinstance(model.facts, Mapping)
    assert all(isinstance(part, str) for pair in model.facts.items() for part in pair)
    assert inspect.iscoroutinefunction(model.answer)

    query = Query("", "STOP or GO?", Stimulus.of(image), 1)

    async def ask_close_and_ask_again() -> tuple[Reply, Reply]:
        first = await model.answer(query)
        await model.close()
        second = await model.answer(query)
        await model.close()
        await model.close()
        return first, second

    first, second = asyncio.run(ask_close_and_ask_again())
    assert isinstance(first, Reply)
    assert (first.text, first.error) == (second.text, second.error)
    assert (first.error is None) or (first.text == "" and first.error_detail != "")
