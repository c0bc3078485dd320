"""Only what was named is sent to a server: no login of ``.netrc``, and no cookie that a server has set before."""

import asyncio
import base64
from collections.abc import Awaitable, Callable
from pathlib import Path

import numpy as np
import pytest
from aiohttp import web

from eyechart.calls import Query
from eyechart.frames import Stimulus, encode
from eyechart.models import ask, open_model
from eyechart.modes import RequestMode
from faults import Loopback
from ollama_stand_in import StandIn

LOGIN, PASSWORD, COOKIE = "netrc-login-zq", "netrc-password-zq", "cookie-zq"
FORMS = (LOGIN, PASSWORD, COOKIE, base64.b64encode(f"{LOGIN}:{PASSWORD}".encode()).decode())
PICTURE = encode(np.full((16, 60, 3), 128, dtype=np.uint8))
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


def hosted() -> web.Application:
    """Return a server of chat completions."""

    async def chat(request: web.Request) -> web.Response:
        del request
        choice = {"index": 0, "message": {"role": "assistant", "content": "SLOW"}, "finish_reason": "stop"}
        return web.json_response({"id": "1", "object": "chat.completion", "model": "m", "choices": [choice]})

    app = web.Application(client_max_size=10**8)
    app.router.add_post("/v1/chat/completions", chat)
    return app


def recorded(app: web.Application, heads: list[str]) -> web.Application:
    """Have an application keep what it was sent but for the body, and set a cookie with every reply."""

    @web.middleware
    async def keep(request: web.Request, handler: Handler) -> web.StreamResponse:
        heads.append(f"{request.raw_path} {dict(request.headers)}")
        came = await handler(request)
        if not came.prepared:
            came.set_cookie("session", COOKIE)
        return came

    app.middlewares.append(keep)
    return app


@pytest.mark.parametrize(("spec", "path"), [("openai:m", "/v1"), ("ollama:llava", "")])
def test_no_login_of_a_file_and_no_cookie_is_sent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, spec: str, path: str
) -> None:
    """Whichever way the file is found, and to whatever the adapter asks of the server beside its calls."""
    netrc = f"machine 127.0.0.1\nlogin {LOGIN}\npassword {PASSWORD}\ndefault login {LOGIN} password {PASSWORD}\n"
    for name in (".netrc", "_netrc"):
        (tmp_path / name).write_text(netrc, encoding="utf-8")
        (tmp_path / name).chmod(0o600)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("USERPROFILE", str(tmp_path))
    monkeypatch.setenv("NETRC", str(tmp_path / ".netrc"))
    heads: list[str] = []
    app = hosted() if path else StandIn().app()
    with Loopback(recorded(app, heads)) as server:
        model = open_model(spec, RequestMode(spec, base_url=f"http://127.0.0.1:{server.port}{path}"))

        async def twice() -> list[str]:
            replies = [await ask(model, Query("", "Decide.", Stimulus.of(PICTURE), 1)) for _ in range(2)]
            await model.close()
            return [reply.text for reply in replies]

        assert asyncio.run(twice()) == ["SLOW", "SLOW"]
    assert len(heads) >= 2
    assert not [head for head in heads for form in FORMS if form in head]
    assert not [head for head in heads if "authorization" in head.lower() or "cookie" in head.lower()]
