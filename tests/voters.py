"""Stand-in models that vote on the pictures of `banks`, opened as ``voter:NAME``; each fails in its own way."""

import asyncio
import threading
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import reply_classes
from eyechart.calls import Query, Reply
from eyechart.frames import decode
from eyechart.modes import RequestMode
from eyechart.spaces.scene import CLOSE_GAP_M, Estimate, Scene
from eyechart.studies import battery, guardian, structured

VERSION = {"all": "1"}
LATE_S = 30.0
GO_ON = threading.Event()
"""When it is set, ``holds`` lets the event loop turn again."""


def gap_of(picture: bytes) -> float | None:
    """Return the gap that a picture of `banks.draw` shows, in its pixels."""
    pixels = decode(picture, "drawn").astype(int)[1:]
    red = np.argwhere((pixels[..., 0] > 150) & (pixels[..., 1] < 50))
    return None if not len(red) else float(red[:, 1].min() - 10)


def says(gap_m: float | None) -> Reply:
    """Return the reply of a model that sees this gap."""
    return Reply(str(Estimate.of(Scene(gap_m, left_clear=True, right_clear=False))), "stop")


@dataclass
class Voter:
    """A model that answers as its name says."""

    name: str
    facts: Mapping[str, str]

    @property
    def version(self) -> str:
        """Return the version, which a test may change."""
        return VERSION["all"]

    async def answer(self, query: Query) -> Reply:
        """Answer from the picture, or fail."""
        assert query.image is not None
        if self.name == "late":
            await asyncio.sleep(LATE_S)
        if self.name == "holds":
            GO_ON.wait(LATE_S)  # that it holds the loop is what is tested
        if self.name == "raises":
            raise RuntimeError("out of memory")
        if self.name == "refused":
            return Reply(error="rate_limited", error_detail="HTTP 429")
        if self.name == "prose":
            return Reply("The road is clear.", "stop")
        if self.name.startswith("class "):
            return reply_classes.reply(reply_classes.ROWS[int(self.name.removeprefix("class "))])
        if self.name == "misfit":
            return Reply(text=None)  # type: ignore[arg-type]
        fixed = {"always": 5.0, "never": None, "replaced": None}
        if self.name == "torn":
            torn = Estimate.of(Scene(5.0, left_clear=True, right_clear=False))
            return Reply(str(replace(torn, close=False)), "stop")
        said = says(fixed[self.name] if self.name in fixed else gap_of(query.image))
        return replace(said, served="another" if self.name == "replaced" else "itself")

    async def close(self) -> None:
        """Hold nothing."""


def open_model(name: str, mode: RequestMode) -> Voter:
    """Open a voter by name."""
    del mode
    return Voter(name, {})


def names() -> dict[str, str]:
    """Return nothing to be listed."""
    return {}


def ask_all(bank: Path, models: tuple[str, ...], out: Path) -> guardian.VoteTable:
    """Run the structured study of these voters on a bank, and return their votes."""
    battery.run(structured.plan("structured", bank, [f"voter:{name}" for name in models], out))
    return guardian.votes_of_run(out)


__all__ = ["CLOSE_GAP_M", "VERSION", "ask_all", "gap_of", "says"]
