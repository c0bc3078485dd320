"""What a model answers is kept without the values of keys, whichever adapter brought it."""

import asyncio

import pytest

from eyechart.calls import Query, Reply
from eyechart.frames import Stimulus
from eyechart.models import ask
from eyechart.models.python_callable import PythonCallable
from eyechart.modes import RequestMode


@pytest.mark.parametrize("whole", [True, False], ids=["a Reply", "a text"])
def test_a_callables_reply_is_cleaned_of_keys(*, whole: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """The value of a variable that is a key by its name stands in no text of a reply."""
    monkeypatch.setenv("MY_API_KEY", "hunter22hunter22")

    def leaks(prompt: str, _image: bytes | None) -> object:
        said = f"{prompt} STOP hunter22hunter22"
        return Reply(said, "stop", served="hunter22hunter22") if whole else said

    model = PythonCallable(leaks, RequestMode("python:m:f"), "v", {})
    reply = asyncio.run(ask(model, Query("", "go", Stimulus({}), 1)))
    assert "STOP [$MY_API_KEY]" in reply.text
    assert "hunter22" not in repr(reply)
