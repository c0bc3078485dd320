"""What a probe found: a pinned mode, what was measured of complete replies, and what names the model."""

import datetime as dt
import statistics
from collections.abc import Sequence
from dataclasses import dataclass

from eyechart.calls import Reply
from eyechart.errors import EyechartError
from eyechart.limits import Spent
from eyechart.modes import Measured, RequestMode
from eyechart.probe.sight import Sight


class ProbeError(EyechartError):
    """A model cannot be probed; ``spent`` is what was asked until then, ``limit`` whether a limit ended it."""

    def __init__(self, words: str, spent: Spent, *, limit: bool = False) -> None:
        super().__init__(words)
        self.spent, self.limit = spent, limit


@dataclass(frozen=True)
class Found:
    """A model's pinned mode with what was measured in it, what its pictures did, and what else is worth knowing."""

    mode: RequestMode
    sight: Sight
    causes: tuple[str, ...]
    notes: tuple[str, ...]
    spent: Spent

    @property
    def measured(self) -> Measured:
        """Return what was measured."""
        assert self.mode.measured is not None
        return self.mode.measured

    def as_dict(self) -> dict[str, object]:
        """Return plain JSON values."""
        return {
            "mode": self.mode.as_dict(),
            "outcome": self.sight.outcome,
            "because": self.sight.because,
            "causes": list(self.causes),
            "notes": list(self.notes),
            "spent": self.spent.as_dict(),
        }


def measured_of(came: Sequence[Reply], bare: Reply) -> Measured:
    """Return the tokens and seconds of complete replies to the run's own question, and what its picture adds."""

    def known(name: str) -> list[float]:
        return [value for reply in came if (value := getattr(reply, name)) is not None]

    shown, tokens, thought, seconds = map(known, ("prompt_tokens", "completion_tokens", "reasoning_tokens", "seconds"))
    adds = None
    if shown and bare.prompt_tokens is not None and bare.error is None:
        adds = max(0, round(statistics.median(shown)) - bare.prompt_tokens)
    return Measured(
        date=dt.datetime.now(dt.UTC).date().isoformat(),
        image_tokens=adds,
        prompt_tokens=round(statistics.median(shown)) if shown else None,
        completion_tokens=statistics.fmean(tokens) if tokens else None,
        completion_tokens_max=round(max(tokens)) if tokens else None,
        reasoning_tokens=statistics.fmean(thought) if thought else None,
        seconds=round(statistics.median(seconds), 4) if seconds else None,
        seconds_min=round(min(seconds), 4) if seconds else None,
    )


def names_of(facts: dict[str, str], came: Sequence[Reply], sight: Sight, causes: Sequence[str]) -> dict[str, str]:
    """Return what names the model, and what its pictures did, in words."""
    found = {name: text for name, text in facts.items() if name not in {"template", "warning"}}
    for name in ("served", "provider"):
        told = sorted({value for reply in came if (value := getattr(reply, name)) is not None})
        found |= {name: ", ".join(told)} if told else {}
    return {**found, "picture": causes[0] if sight.outcome == "blind" and causes else sight.because}
