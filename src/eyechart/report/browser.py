"""What the browser of frames shows: every call with its verbatim reply and its decision, as JSON inside the page."""

import json
from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup

from eyechart.actions import Decision
from eyechart.calls import Reply
from eyechart.conditions import CONDITIONS
from eyechart.frames import Frame
from eyechart.report.evidence import Evidence
from eyechart.report.pictures import Album

LONGEST = 400_000
"""Characters of one reply that the page holds; the ledger has all of it."""
BUDGET = 8_000_000
"""Characters of all replies together that the page holds."""

_ESCAPES = {ord(sign): f"\\u{ord(sign):04x}" for sign in "<>&\u2028\u2029"}


@dataclass(frozen=True)
class Texts:
    """Distinct replies, each at most ``limit`` characters of what the ledger holds."""

    numbers: dict[str, int]
    limit: int

    @property
    def cut(self) -> int:
        """Return how many replies are not there whole."""
        return sum(len(text) > self.limit for text in self.numbers)


def collect_texts(evidence: Sequence[Evidence], *, budget: int = BUDGET) -> Texts:
    """Return the distinct replies of all runs with numbers, and the length to which they fit the budget together."""
    numbers: dict[str, int] = {}
    for run in evidence:
        for spec in run.score.models:
            for reply in run.replies[spec].values():
                numbers.setdefault(reply.text, len(numbers))
    limit, left = LONGEST, budget
    lengths = sorted(map(len, numbers))
    for place, length in enumerate(lengths):
        share = left // (len(lengths) - place)
        if length > share:
            limit = min(limit, share)
            break
        left -= length
    return Texts(numbers, limit)


def browser_data(evidence: Sequence[Evidence], album: Album, texts: Texts) -> dict[str, object]:
    """Return plain JSON values: runs with frames and calls, distinct replies, distinct pictures."""
    return {
        "texts": [text[: texts.limit] for text in texts.numbers],
        "cut": {str(number): len(text) for text, number in texts.numbers.items() if len(text) > texts.limit},
        "pictures": list(album.uris),
        "runs": [_run(run, places, texts) for run, places in zip(evidence, album.places, strict=True)],
    }


def _run(run: Evidence, places: dict[str, tuple[int, ...]], texts: Texts) -> dict[str, object]:
    frames = next(iter(run.score.models.values())).answers.frames if run.score.models else ()
    space = run.score.bank.manifest.action_space
    roles = dict.fromkeys(space.brake, "brake") | dict.fromkeys(space.proceed, "proceed")
    return {
        "name": run.name,
        "conditions": [
            {"name": name, "image": CONDITIONS[name].image, "asks": CONDITIONS[name].asks} for name in run.conditions
        ],
        "actions": list(space.actions),
        "roles": roles,
        "frames": [
            {"id": frame.id, "scenario": frame.scenario, "episode": frame.episode, "step": frame.step, "truth": truth}
            for frame, truth in ((frame, _truth(frame)) for frame in frames)
        ],
        "pictures": {name: list(numbers) for name, numbers in places.items()},
        "models": [
            {"name": spec, "calls": {name: _calls(run, spec, name, frames, texts) for name in run.conditions}}
            for spec in run.score.models
        ],
    }


def _truth(frame: Frame) -> list[list[str]]:
    return [[name, "none" if value is None else str(value)] for name, value in frame.truth.items()]


def _calls(
    run: Evidence, spec: str, condition: str, frames: Sequence[Frame], texts: Texts
) -> list[list[int | str | bool] | None]:
    """Return per frame: the reply's number, the action or why there is none, whether it is an action, and a note."""
    given = run.score.models[spec].answers.decisions.get(condition, (None,) * len(frames))
    found: list[list[int | str | bool] | None] = []
    for frame, decision in zip(frames, given, strict=True):
        reply = run.replies[spec].get((frame.id, condition))
        found.append(None if reply is None or decision is None else _call(reply, decision, texts))
    return found


def _call(reply: Reply, decision: Decision, texts: Texts) -> list[int | str | bool]:
    word = decision.action if decision.action is not None else str(decision.missing)
    notes = []
    if reply.finish_reason not in {None, "stop"}:
        notes.append(f"finish reason {reply.finish_reason}")
    if reply.error is not None:
        notes.append(f"error {reply.error}: {reply.error_detail[:2000]}")
    call: list[int | str | bool] = [texts.numbers[reply.text], word, decision.action is not None]
    return [*call, "; ".join(notes)] if notes else call


def embedded_json(values: object) -> Markup:
    """Return JSON that can stand inside a script element: no sign in it can end the element or a line."""
    text = json.dumps(values, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    return Markup(text.translate(_ESCAPES))  # noqa: S704 - what could be markup was escaped just now
