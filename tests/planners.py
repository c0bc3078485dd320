"""Planners behind an OpenAI-compatible endpoint on loopback, one of which reads the picture as ``clear_side`` does.

As a program it serves until it is killed, and prints its address.
"""

import random
import threading

from aiohttp import web

from eyechart.models.scripted import PLANNERS, see
from faults import FaultServer, answer
from seeing import read

SPEC = "openai:clear-side"


async def clear_side(request: web.Request, asked: dict[str, object], attempt: int) -> web.StreamResponse:
    """Answer from the picture of the request alone."""
    del request, attempt
    said = PLANNERS["clear_side"].decide(see(read(asked)[1]), random.Random(0))  # noqa: S311
    assert isinstance(said, str)
    return answer(said)


def main() -> None:
    """Serve until killed."""
    with FaultServer([clear_side]) as server:
        print(server.base_url, flush=True)  # noqa: T201
        threading.Event().wait()


if __name__ == "__main__":
    main()
