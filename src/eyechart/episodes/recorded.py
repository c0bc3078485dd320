"""What a controller decided in an earlier run, for sampling from its marginal."""

import json
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

from eyechart.episodes.records import read_episodes
from eyechart.errors import LedgerError, SpecError
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER, RUN, EpisodesManifest, read_run

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
