"""Finished episodes are the lines of a file: appended whole, and read strictly, also for what a controller decided."""

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import NoReturn

from eyechart.episodes.nouns import Episode
from eyechart.errors import LedgerError, SpecError
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER, RUN, EpisodesManifest, read_run
from eyechart.records import build, shown

EPISODES = "episodes.jsonl"
"""A run's finished episodes, one a line, in the order in which they ended."""


def read_episodes(path: Path) -> Iterator[Episode]:
    """Yield the finished episodes of a run folder; what a kill cut at the end of the file is no episode.

    Raises LedgerError with the line, the field and what to do, for anything else that is none.
    """
    file = path / EPISODES
    if not file.is_file():
        return
    lines = file.read_bytes().split(b"\n")
    for number, line in enumerate(lines[:-1], 1):
        try:
            yield _episode(line)
        except (ValueError, RecursionError) as error:
            raise LedgerError(
                f"{file}: line {number} is no episode: {error}; restore the file from a copy, or delete this line: "
                "the command that began the run then drives its episode anew, and asks no finished call again"
            ) from error


def write_episodes(path: Path, episodes: Iterable[Episode]) -> None:
    """Append finished episodes to a run folder's file.

    Each is with the operating system when this returns, so that the kill of a process loses none.
    """
    with (path / EPISODES).open("a", encoding="utf-8", errors="backslashreplace") as file:
        for episode in episodes:
            file.write(episode.as_line() + "\n")
        file.flush()


def mend_episodes(path: Path) -> None:
    """Cut off the beginning of an episode that a kill left at the end of a run folder's file, before more is added."""
    file = path / EPISODES
    if file.is_file():
        text = file.read_bytes()
        whole = text.rfind(b"\n") + 1
        if whole < len(text):
            with file.open("r+b") as opened:
                opened.truncate(whole)


def _episode(line: bytes) -> Episode:
    def refuse(word: str) -> NoReturn:
        raise ValueError(f"it holds {word}, which is no number")

    try:
        raw = json.loads(line, parse_constant=refuse)
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"it is no JSON: {error}") from error
    episode = build(Episode, raw)
    for number, step in enumerate(episode.steps):
        for name, due in (("step", number), ("frame", episode.key.frame(number))):
            if (found := getattr(step, name)) != due:
                raise ValueError(f"steps[{number}].{name} is {shown(found)}, not {shown(due)}, which is this step's")
    return episode


_CONDITION = "real"


def recorded(run: Path) -> Mapping[str, int]:
    """Return how often each action was decided on real pictures in a run, of a battery or of episodes.

    ``RUN,SPEC`` takes one controller of several. Raises SpecError where the run holds several and none is named.
    """
    folder, _, spec = str(run).partition(",")
    path = Path(folder)
    by_spec = _of_episodes(path) if _is_episodes(path) else _of_battery(path)
    if spec and spec not in by_spec:
        raise SpecError(f"{folder} holds no decisions of '{spec}'; it holds {', '.join(by_spec) or 'none'}")
    if not spec and len(by_spec) > 1:
        named = f"marginal:{folder},{next(iter(by_spec))}"
        raise SpecError(f"{folder} holds {len(by_spec)} controllers; name one, as {named}")
    return by_spec[spec] if spec else next(iter(by_spec.values()), Counter())


def _is_episodes(path: Path) -> bool:
    try:
        return bool(json.loads((path / RUN).read_text(encoding="utf-8"))["format"] == EpisodesManifest.FORMAT)
    except (OSError, ValueError, LookupError, TypeError) as error:
        raise LedgerError(f"{path / RUN} is no manifest of a run: {error}") from error


def _of_episodes(path: Path) -> dict[str, Counter[str]]:
    found: dict[str, Counter[str]] = {}
    for episode in read_episodes(path):
        if episode.key.condition == _CONDITION and episode.ended != "error":
            taken = (step.decision.action for step in episode.steps)
            found.setdefault(episode.key.policy, Counter()).update(action for action in taken if action is not None)
    return found


def _of_battery(path: Path) -> dict[str, Counter[str]]:
    manifest, bank = read_run(path)
    found: dict[str, Counter[str]] = {}
    with Ledger(path / LEDGER) as ledger:
        for spec in manifest.models:
            counts = found.setdefault(spec, Counter())
            for key, reply in ledger.replies(spec):
                decision = bank.manifest.action_space.read(reply)
                if key.condition == _CONDITION and decision.action is not None:
                    counts[decision.action] += 1
    return found
