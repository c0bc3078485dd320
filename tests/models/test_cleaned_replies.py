"""What a model answers is kept without the values of keys, whichever adapter brought it."""

import asyncio
import base64
import json
from urllib.parse import quote

import pytest

from eyechart.calls import Query, Reply
from eyechart.frames import Stimulus
from eyechart.keys import forms_of
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


KEY = 'hunter22/hunter22+"x"'


@pytest.mark.parametrize("raised", [True, False], ids=["raised", "returned"])
@pytest.mark.parametrize("form", forms_of(KEY))
def test_no_form_of_a_key_is_left_in_what_a_callable_returns_or_raises(
    form: str, monkeypatch: pytest.MonkeyPatch, *, raised: bool
) -> None:
    """In base64, in hex, percent-encoded or escaped: as of what a server says."""
    monkeypatch.setenv("MY_API_KEY", f"{KEY}\n")

    def leaks(_prompt: str, _image: bytes | None) -> object:
        if raised:
            raise ValueError(form)
        return Reply(f"STOP {form}", "stop", served=form, provider=form)

    model = PythonCallable(leaks, RequestMode("python:m:f"), "v", {})
    reply = asyncio.run(ask(model, Query("", "go", Stimulus({}), 1)))
    assert form not in repr(reply)
    assert form not in "\n".join([reply.text, reply.error_detail, reply.served or "", reply.provider or ""])
    assert "[$MY_API_KEY]" in reply.text + reply.error_detail


def test_the_forms_of_a_key_are_those_that_programs_write() -> None:
    """Of any text that holds it, at each alignment of base64."""
    for lead in ("", "a", "ab"):
        whole = base64.b64encode(f"{lead}{KEY}.".encode()).decode()
        assert any(form in whole for form in forms_of(KEY))
    assert {KEY.encode().hex(), quote(KEY, safe=""), json.dumps(KEY)[1:-1]} <= {*forms_of(KEY)}
    assert forms_of("EMPTY") == ()
