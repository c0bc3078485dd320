"""A program whose children run a battery against a server and are killed: ``killed BANK OUT URL KILLS``.

It imports everything once and forks, so that a start costs milliseconds and not seconds.
"""

import os
import random
import signal
import sys
import time
from pathlib import Path

from eyechart.modes import RequestMode
from eyechart.studies import battery as study

SPEC = "openai:m"
CONCURRENCY = 8
LONGEST_S = 0.3
"""Each child is killed at a random moment within so long after its first call may go out; every fifth before that."""


def run(bank: Path, out: Path, base_url: str, begun: int) -> None:
    """Begin or resume the battery; write a byte when it begins to ask."""
    mode = RequestMode(SPEC, base_url=base_url, seed=True)
    planned = study.plan(bank, [mode], out, seed=7)
    told: list[int] = []

    def progress(done: int, total: int) -> None:
        del done, total
        told.append(os.write(begun, b"!") if not told else 0)

    study.run(planned, concurrency=CONCURRENCY, progress=progress)


def main(bank: Path, out: Path, base_url: str, kills: int) -> None:
    """Kill so many children, each at its own moment; print how each ended."""
    dice = random.Random(11)  # noqa: S311 - moments, no secret
    for number in range(kills):
        reading, writing = os.pipe()
        child = os.fork()
        if child == 0:
            run(bank, out, base_url, writing)
            os._exit(0)
        if number % 5 < 4:
            os.read(reading, 1)
        time.sleep(dice.uniform(0.0, LONGEST_S))
        os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
        os.close(reading)
        os.close(writing)
        print(os.waitstatus_to_exitcode(status), flush=True)  # noqa: T201


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3], int(sys.argv[4]))
