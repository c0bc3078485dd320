"""What a model answers is kept without the values of keys, whichever adapter brought it."""

import asyncio
import base64
import html
import json
import textwrap
from urllib.parse import quote

import pytest

from eyechart.calls import Query, Reply
from eyechart.errors import SpecError
from eyechart.frames import Stimulus
from eyechart.keys import without_keys
from eyechart.models import ask
from eyechart.models.python_callable import PythonCallable
from eyechart.modes import RequestMode, mode_of


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


@pytest.mark.parametrize("nul", ["%00", "\\x00", "\\u0000", "\\000", "\\u{0}", "=00"])
def test_an_escaped_nul_is_a_sign_like_any_other(nul: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The answer is kept, and a key beside it is found; it was lost as an exception of the adapter."""
    monkeypatch.setenv("MY_API_KEY", "hunter22hunter22")
    model = PythonCallable(
        lambda prompt, _image: f"{prompt} {nul} hunter22hunter%32%32", RequestMode("python:m:f"), "v", {}
    )
    reply = asyncio.run(ask(model, Query("", "SLOW", Stimulus({}), 1)))
    assert (reply.error, reply.text) == (None, f"SLOW {nul} [$MY_API_KEY]")


@pytest.mark.parametrize("digest", ["hunter22hunter22", "A" * 64, "a" * 63])
def test_only_a_digest_stands_where_a_digest_is_due(digest: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The column is not searched for keys, so it holds nothing else."""
    monkeypatch.setenv("MY_API_KEY", "hunter22hunter22")
    model = PythonCallable(lambda *_: Reply("SLOW", payload_sha256=digest), RequestMode("python:m:f"), "v", {})
    reply = asyncio.run(ask(model, Query("", "go", Stimulus({}), 1)))
    assert (reply.error, "payload_sha256 is no SHA-256" in reply.error_detail) == ("exception", True)
    assert digest not in repr(reply)


@pytest.mark.parametrize("whole", [True, False], ids=["a Reply", "an exception"])
def test_a_failure_is_told_in_one_line(*, whole: bool) -> None:
    """Whatever its words look like: a screen and a page have a line for it."""

    def fails(_prompt: str, _image: bytes | None) -> Reply:
        words = "CUDA error:\n\n   illegal\r\n\taccess\n"
        if whole:
            return Reply(error="exception", error_detail=f"RuntimeError: {words}")
        raise RuntimeError(words)

    model = PythonCallable(fails, RequestMode("python:m:f"), "v", {})
    reply = asyncio.run(ask(model, Query("", "go", Stimulus({}), 1)))
    assert reply.error_detail == "RuntimeError: CUDA error: illegal access"


KEY = 'hunter22/hunter22+"x"='
RAW = KEY.encode()
BASE64 = base64.b64encode(b"user:" + RAW + b"!").decode()


def _each(form: str, *, joined: str = "") -> str:
    return joined.join(form.format(byte) for byte in RAW)


FORMS = {
    "plain": KEY,
    "another case": KEY.upper(),
    "quoted": quote(KEY, safe=""),
    "percent": _each("%{:02x}"),
    "percent, large": _each("%{:02X}"),
    "percent twice": _each("%25{:02x}"),
    "JSON": json.dumps(KEY),
    "JSON twice": json.dumps(json.dumps(KEY)),
    "JSON with slashes": json.dumps(KEY).replace("/", "\\/"),
    "Gson": json.dumps(KEY).replace("=", "\\u003d"),
    "\\u": _each("\\u{:04x}"),
    "\\u twice": _each("\\\\u{:04X}"),
    "\\u{}": _each("\\u{{{:x}}}"),
    "\\x": _each("\\x{:02x}"),
    "octal": _each("\\{:03o}"),
    "entities": _each("&#{};"),
    "hexadecimal entities": _each("&#x{:x};"),
    "HTML": html.escape(KEY),
    "hex": RAW.hex(),
    "hex with colons": _each("{:02X}", joined=":"),
    "codes": str(list(RAW)),
    "base32": base64.b32encode(b"ab" + RAW).decode(),
    "base64 twice": base64.b64encode(BASE64.encode()).decode(),
    "base64 in hex": BASE64.encode().hex(),
    "URL-safe base64": base64.urlsafe_b64encode(RAW).decode(),
    "lines": "\n".join(textwrap.wrap(KEY, 8)),
    "MIME": "\r\n".join(textwrap.wrap(BASE64, 8)),
    "MIME in JSON": "\\r\\n".join(textwrap.wrap(BASE64, 8)),
    **{f"base64 after {lead}": base64.b64encode(b"x" * lead + RAW + b".").decode() for lead in range(3)},
}


def _needles(form: str) -> list[str]:
    """Return what must not be left of a key: any third of the form."""
    third = len(form) // 3
    return [form[third : 2 * third]]


@pytest.mark.parametrize("raised", [True, False], ids=["raised", "returned"])
@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
def test_no_form_of_a_key_is_left_in_what_a_callable_returns_or_raises(
    form: str, monkeypatch: pytest.MonkeyPatch, *, raised: bool
) -> None:
    """However it is written, alone or in one another: as of what a server says. What stands beside it stays."""
    monkeypatch.setenv("MY_API_KEY", f"{KEY}\n")

    def leaks(_prompt: str, _image: bytes | None) -> object:
        if raised:
            raise ValueError(f"STOP ({form}) too late")
        return Reply(f"STOP ({form}) too late", "stop", served=form, provider=form)

    model = PythonCallable(leaks, RequestMode("python:m:f"), "v", {})
    reply = asyncio.run(ask(model, Query("", "go", Stimulus({}), 1)))
    for said in (reply.text, reply.error_detail, reply.served or "", reply.provider or ""):
        assert not any(needle in said for needle in _needles(form)), said
    assert "[$MY_API_KEY]" in reply.text + reply.error_detail
    assert "STOP (" in reply.text + reply.error_detail
    assert ") too late" in reply.text + reply.error_detail


@pytest.mark.parametrize(
    "text", ["The lead is near: 12, 40, 33, 29, 18, 77, 64, 52, 10", "%41%42 \\u0041 &amp; x=3D", "hunter22"]
)
def test_a_text_without_a_key_stays_as_it_is(text: str) -> None:
    """Its escapes, numbers and long words too; a value that is too short is no key."""
    assert without_keys(text, {KEY: "[key removed]", "EMPTY": "[key removed]"}) == text


def test_a_key_given_as_a_models_name_is_not_printed(monkeypatch: pytest.MonkeyPatch) -> None:
    """In the line that refuses it."""
    monkeypatch.setenv("MY_API_KEY", KEY)
    with pytest.raises(SpecError) as refused:
        mode_of(f"openai:{KEY}", {"base_url": "http://127.0.0.1:1/v1"})
    assert "hunter22" not in str(refused.value)
    assert "MY_API_KEY" in str(refused.value)
