"""Stand-in models: seeded, made for the tests, opened as ``standin:NAME``; run as a program, a battery of them."""

import asyncio
import sqlite3
import sys
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from eyechart import models
from eyechart.calls import CallKey, Query, Reply
from eyechart.modes import RequestMode
from eyechart.run import Plan
from eyechart.spaces.discrete import DRIVING
from eyechart.studies import battery as study

SPECS = ("standin:noisy", "standin:steady")


def stop(query: Query) -> Reply:
    """Answer STOP, whatever is asked."""
    del query
    return Reply("STOP", "stop")


def noisy(query: Query) -> Reply:
    """Answer at random from the call's seed; refuse now and then, and where there is no picture."""
    dice = np.random.default_rng(query.seed)
    if query.image is None or dice.random() < 0.1:
        return Reply("I'm sorry, I can't help with that.", "stop", prompt_tokens=3)
    return Reply(str(dice.choice(DRIVING.actions)), "stop", prompt_tokens=3, completion_tokens=1)


class Held:
    """The part of a model's door that a stand-in need not think about."""

    version: str = "1"
    facts: Mapping[str, str] = {}

    async def close(self) -> None:
        """Hold nothing."""


@dataclass
class StandIn(Held):
    """A model that notes the queries that it gets, and answers each after ``pause_s`` times a seeded fraction."""

    respond: Callable[[Query], Reply] = stop
    version: str = "1"
    pause_s: float = 0.0
    queries: list[Query] = field(default_factory=list)
    closed: int = 0

    async def answer(self, query: Query) -> Reply:
        """Answer one query."""
        self.queries.append(query)
        await asyncio.sleep(self.pause_s * np.random.default_rng(query.seed).random())
        return self.respond(query)

    async def close(self) -> None:
        """Count how often it was let go."""
        self.closed += 1

    def asked(self, plan: Plan) -> list[CallKey]:
        """Return the calls that were asked, in order, known by their seeds."""
        by_seed = {key.seed(plan.seed): key for model in plan.models for key in plan.keys_of(model)}
        return [by_seed[query.seed] for query in self.queries]


def rows_in(ledger: Path, table: str) -> int:
    """Return how many rows a table of a ledger holds while another process writes; -1 before there is one."""
    try:
        with closing(sqlite3.connect(f"file:{ledger}?mode=ro", uri=True)) as sql:
            return int(sql.execute(f"SELECT count(*) FROM {table}").fetchone()[0])  # noqa: S608 - a test's own name
    except sqlite3.Error:
        return -1


PAUSE_S = 0.0


def open_model(name: str, mode: RequestMode) -> StandIn:
    """Open a stand-in by name."""
    del mode
    return StandIn({"noisy": noisy, "steady": stop}[name], pause_s=PAUSE_S)


def names() -> dict[str, str]:
    """Return what the stand-ins are called."""
    return {"noisy": "answers at random", "steady": "answers STOP"}


def install() -> None:
    """Make ``standin:NAME`` a SPEC."""
    models.ADAPTERS["standin"] = "stand_ins"


def main(bank: Path, out: Path, pause_s: float) -> None:
    """Run or resume the battery of the two stand-ins."""
    install()
    sys.modules["stand_ins"] = sys.modules[__name__]
    globals()["PAUSE_S"] = pause_s
    study.run(study.plan(bank, SPECS, out, seed=7), concurrency=4)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), float(sys.argv[3]))
