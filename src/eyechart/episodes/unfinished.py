"""What is left of a run of episodes, and why: the errors of the last attempts at the calls of cut episodes."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from eyechart.calls import CallKey
from eyechart.episodes.nouns import STUDY, EpisodeKey
from eyechart.ledger import UNKNOWN, Ledger, Sent
from eyechart.manifest import LEDGER, EpisodesManifest
from eyechart.records import Plain

_DETAIL = 160


@dataclass(frozen=True, slots=True)
class Unfinished(Plain):
    """The episodes of one policy that have no record, and what their calls met last.

    ``begun`` of them have calls in the ledger; None for a policy that asks no model. ``errors`` counts the calls of
    these whose last attempt failed, by kind of error, ``unknown`` for one that was sent and never came back; ``detail``
    is what the last of them said.
    """

    policy: str
    episodes: int
    begun: int | None
    errors: Mapping[str, int]
    detail: str = ""

    @property
    def words(self) -> str:
        """Return it in one line, without the policy's name."""
        one = self.episodes == 1
        if self.begun is None:
            return f"{self.episodes} episode{' is' if one else 's are'} not driven yet"
        count = f"{self.episodes} episode{' is' if one else 's are'} unfinished, {self.begun} of them begun"
        if not self.begun:
            return count
        if not self.errors:
            return f"{count}; every call of these was answered: they were cut between two calls"
        kinds = ", ".join(f"{kind} {times}" for kind, times in self.errors.items())
        return f"{count}; their calls last met: {kinds}{f', as: {self.detail}' if self.detail else ''}"


def unfinished(out: Path, keys: Iterable[EpisodeKey], models: Iterable[str]) -> list[Unfinished]:
    """Return what is left by policy, in the order of the keys of episodes that have no record."""
    left: dict[str, set[tuple[str, str]]] = {}
    for key in keys:
        left.setdefault(key.policy, set()).add((key.world, key.condition))
    asked = {spec for spec in models if spec in left}
    last: dict[str, dict[CallKey, Sent]] = {spec: {} for spec in asked}
    if asked and (out / LEDGER).is_file():
        with Ledger(out / LEDGER) as ledger:
            for spec in asked:
                last[spec] = dict(_of(ledger.attempts(spec), left[spec]))
    return [_told(policy, len(worlds), last.get(policy)) for policy, worlds in left.items()]


def every_episode(manifest: EpisodesManifest) -> list[EpisodeKey]:
    """Return the episodes that a run's policies, scenarios, seeds and conditions make together.

    A run that was extended may never have been asked for all of them.
    """
    return [
        EpisodeKey(policy, manifest.simulator, scenario, seed, condition)
        for policy in manifest.policies
        for condition in manifest.conditions
        for scenario in manifest.scenarios
        for seed in manifest.seeds
    ]


def _of(attempts: Iterable[Sent], left: set[tuple[str, str]]) -> Iterator[tuple[CallKey, Sent]]:
    """Yield the attempts at calls of these worlds and conditions; of one call the last attempt comes last."""
    for sent in attempts:
        if sent.key.study == STUDY and (sent.key.frame.rpartition("/")[0], sent.key.condition) in left:
            yield sent.key, sent


def _told(policy: str, episodes: int, last: Mapping[CallKey, Sent] | None) -> Unfinished:
    if last is None:
        return Unfinished(policy, episodes, None, {})
    begun = {(key.frame.rpartition("/")[0], key.condition) for key in last}
    kinds: Counter[str] = Counter()
    detail = ""
    for sent in last.values():
        if sent.reply is None:
            kinds[UNKNOWN] += 1
        elif sent.reply.error is not None:
            kinds[sent.reply.error] += 1
            detail = " ".join(sent.reply.error_detail.split())[:_DETAIL]
    return Unfinished(policy, episodes, len(begun), dict(kinds.most_common()), detail)
