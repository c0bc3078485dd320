"""An adapter in the place of ``hf:`` whose models note when their weights come and go; they answer as scripted ones do.

``hf:NAME`` is scripted:NAME; ``hf:broken:NAME`` cannot load its weights.
"""

import asyncio
import os
import signal
from collections.abc import Mapping
from dataclasses import dataclass, field

import pytest

from eyechart import models
from eyechart.calls import Query, Reply
from eyechart.models import MEMORY_GB, WEIGHTS_GB, Model, scripted
from eyechart.modes import RequestMode

EVENTS: list[str] = []
"""``open NAME`` with the first query of a model, ``close NAME`` when weights that were there are let go."""
CLOSING: list[str] = []
"""Names whose weights are interrupted when they are let go."""
MENDED: list[str] = []
"""Names of broken models whose weights can be loaded now."""
NEEDS_GB = {"depth": "5", "presence": "9", "blind": "4"}


@dataclass
class Weighty:
    """A scripted model with weights."""

    name: str
    inside: Model
    facts: Mapping[str, str]
    version: str = "1"
    there: bool = False
    under_way: int = field(default=0)

    async def answer(self, query: Query) -> Reply:
        """Load the weights if they are not there, and answer."""
        if self.name.startswith("broken:") and self.name not in MENDED:
            return Reply(error="missing_model", error_detail="the weights cannot be loaded: MemoryError")
        if not self.there:
            EVENTS.append(f"open {self.name}")
        self.there = True
        await asyncio.sleep(0)
        return await self.inside.answer(query)

    async def close(self) -> None:
        """Let the weights go."""
        if self.there:
            EVENTS.append(f"close {self.name}")
        self.there = False
        if self.name in CLOSING:
            CLOSING.remove(self.name)
            os.kill(os.getpid(), signal.SIGINT)  # as from the keyboard
            await asyncio.sleep(60)


def open_model(name: str, mode: RequestMode) -> Weighty:
    """Open a model; its weights come with the first query."""
    inside = scripted.open_model(name.removeprefix("broken:"), RequestMode(mode.spec))
    facts = {WEIGHTS_GB: NEEDS_GB[name], MEMORY_GB: "16"} if name in NEEDS_GB else {}
    if name == "scene_constant":
        facts = {"warning": "its weights alone do not fit"}
    return Weighty(name, inside, facts)


def names() -> dict[str, str]:
    """Return what may stand after the colon."""
    return {"NAME": "a scripted model with weights"}


def take_place(patch: pytest.MonkeyPatch) -> None:
    """Put this adapter in the place of ``hf:`` for a test."""
    patch.setitem(models.ADAPTERS, "hf", "weighty")
    for noted in (EVENTS, CLOSING, MENDED):
        noted.clear()


def most_at_once() -> int:
    """Return how many models had their weights loaded at one time."""
    there, most = 0, 0
    for event in EVENTS:
        there += 1 if event.startswith("open") else -1
        most = max(most, there)
    return most
