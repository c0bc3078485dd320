"""A server on loopback in a process of its own: it answers by what it is sent, and echoes the key in a given form."""

import base64
import codecs
import ctypes
import hashlib
import json
import os
import signal
import socket
import urllib.parse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

ACTIONS = ("SLOW", "STRAIGHT", "LEFT", "RIGHT", "STOP")
FORMS: dict[str, Callable[[str], str]] = {
    "plain": str,
    "base64": lambda key: base64.b64encode(key.encode()).decode(),
    "base64 twice": lambda key: base64.b64encode(base64.b64encode(key.encode())).decode(),
    "base64 of a header": lambda key: base64.b64encode(b"Bearer " + key.encode()).decode(),
    "base32": lambda key: base64.b32encode(key.encode()).decode(),
    "hex": lambda key: key.encode().hex(),
    "percent": lambda key: urllib.parse.quote(key, safe=""),
    "percent of every byte": lambda key: "".join(f"%{byte:02x}" for byte in key.encode()),
    "escapes": lambda key: "".join(f"\\u{ord(sign):04x}" for sign in key),
    "escapes of bytes": lambda key: "".join(f"\\x{byte:02x}" for byte in key.encode()),
    "entities": lambda key: "".join(f"&#{ord(sign)};" for sign in key),
    "octal": lambda key: "".join(f"\\{byte:03o}" for byte in key.encode()),
    "other case": str.swapcase,
    "lines": lambda key: "\n".join(key[at : at + 8] for at in range(0, len(key), 8)),
    "numbers": lambda key: str(list(key.encode())),
    "reversed": lambda key: key[::-1],
    "rot13": lambda key: codecs.encode(key, "rot13"),
}
"""Ways in which a server can write a key that it was sent. Of the last two nobody promises that they are found."""
_PARENT_DIED = 1
"""The option of Linux's prctl: the signal that a process gets when its parent has ended."""
UNPROMISED = {"reversed", "rot13"}


def handler(form: str, pause_s: float) -> type[BaseHTTPRequestHandler]:
    """Return what answers chat completions, a 400 in every fifth where it echoes."""

    class Answer(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
            key = (self.headers.get("Authorization") or "").removeprefix("Bearer ")
            number = hashlib.sha256(body).digest()[0]
            said, status = ACTIONS[number % 5], 200
            if form and key:
                said, status = f"{said} because {FORMS[form](key)}", 400 if number % 5 == 0 else 200
            signal.sigtimedwait([], pause_s) if pause_s else None
            self.send(status, said)

        def do_GET(self) -> None:
            self.send(404, "no such place")

        def send(self, status: int, said: str) -> None:
            message = {"role": "assistant", "content": said}
            done = {"choices": [{"index": 0, "message": message, "finish_reason": "stop"}], "model": "m"}
            usage = {"prompt_tokens": 10, "completion_tokens": 2}
            text = json.dumps({**done, "usage": usage} if status == 200 else {"error": {"message": said}}).encode()
            self.send_response(status)
            self.send_header("Content-Type", "application/json")
            self.send_header("Content-Length", str(len(text)))
            self.end_headers()
            self.wfile.write(text)

        def log_message(self, *given: object) -> None:
            del given

    return Answer


def free_port() -> int:
    """Return a port that nobody listens on."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


@contextmanager
def serving(port: int, form: str = "", pause_s: float = 0.0) -> Iterator[str]:
    """Serve in a child while the block lasts, at a port that stays that of a run; gives the base URL."""
    server = ThreadingHTTPServer(("127.0.0.1", port), handler(form, pause_s))
    child = os.fork()
    if child == 0:
        ctypes.CDLL(None).prctl(_PARENT_DIED, signal.SIGKILL)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # of clients that break off
        try:
            server.serve_forever()
        finally:
            os._exit(0)
    server.server_close()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}/v1"
    finally:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
