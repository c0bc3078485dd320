"""``eyechart serve`` offers a guardian over HTTP, until it is told to stop."""

from pathlib import Path
from typing import Annotated

import typer

from eyechart.cli.terminal import say


def serve(
    guardian: Annotated[Path, typer.Argument(help="File of a guardian, exported or not.", metavar="GUARDIAN")],
    host: Annotated[str, typer.Option(help="Address to listen on; there is no password.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="0 takes a free one.", min=0, max=65535)] = 8600,
    deadline: Annotated[float, typer.Option(help="Seconds from a request's head to its answer.")] = 2.0,
    concurrency: Annotated[int, typer.Option(help="Pictures asked about at a time.", min=1, max=64)] = 8,
    queue: Annotated[int, typer.Option(help="Pictures that may wait; more are refused with 503.", min=0)] = 32,
    max_bytes: Annotated[int, typer.Option(help="Bytes of a picture.", min=1)] = 4_000_000,
    max_pixels: Annotated[
        int, typer.Option(help="Pixels of a picture, width × height in its header; none is decoded above it.", min=1)
    ] = 2_100_000,
    no_warm_up: Annotated[
        bool, typer.Option("--no-warm-up", help="Do not first ask each model about a blank picture, for at most 60 s.")
    ] = False,
    mode: Annotated[
        list[Path] | None,
        typer.Option(help="FILE.toml: another address, key or header for a model; it names its model."),
    ] = None,
) -> None:
    """Serve a guardian: POST a picture to /assess; /health, /metrics (Prometheus), /openapi.json.

    Example: eyechart serve guardian.json, then curl --data-binary @frame.png -H 'Content-Type: image/png'
    http://127.0.0.1:8600/assess
    """
    import asyncio

    from eyechart.guardian import Guardian
    from eyechart.modes import read_mode
    from eyechart.serve import Limits
    from eyechart.serve import serve as run

    modes = {one.spec: one for one in map(read_mode, mode or ())}
    limits = Limits(concurrency=concurrency, queue=queue, most_bytes=max_bytes, most_pixels=max_pixels)
    with Guardian.load(guardian, deadline_s=deadline, modes=modes) as loaded:
        served = run(
            loaded,
            host=host,
            port=port,
            limits=limits,
            warm_up_s=0.0 if no_warm_up else 60.0,
            tell=say,
            started=lambda url: say(f"{guardian} at {url}"),
        )
        asyncio.run(served)
    say("stopped")
