"""Records of episodes: finished drives, appended as whole lines, read strictly, and summed up."""

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from statistics import fmean
from typing import NoReturn

from eyechart.calls import SILENT, CallKey
from eyechart.errors import LedgerError, SpecError, raising, text_file
from eyechart.frames import Scalar
from eyechart.ledger import UNKNOWN, Ledger, SentAttempt
from eyechart.manifest import EPISODES, LEDGER, RUN, EpisodesManifest, read_run
from eyechart.policies.baselines import without
from eyechart.records import Count, JsonRecord, Name, build, parse_json, shown
from eyechart.spaces.space import Decision

STUDY = "closed_loop"

SILENCES: Mapping[str, frozenset[str]] = {"unfinished": frozenset(), "fail-safe": SILENT}
"""The treatment of a call whose failure may pass, with the kinds of failure that count as silence.
Either the episode is left for a resumed run, or the fail-safe is executed
(docs/decisions/drives.md)."""


REAL = "real"

REFLECTED = "mirrored"
"""The condition, in the ledger, of a call about a picture's reflection."""


@dataclass(frozen=True, slots=True, order=True)
class EpisodeKey:
    """The identity of an episode: its driver, its world, and the condition of its pictures."""

    policy: Name
    simulator: Name
    scenario: Name
    seed: Count
    condition: Name = "real"

    @property
    def world(self) -> str:
        """Return the world's name, shared by all policies and conditions: ``highway/dense/3``."""
        return f"{self.simulator}/{self.scenario}/{self.seed}"

    def frame(self, step: int) -> str:
        """Return the id of the picture before a decision: ``highway/dense/3/017``."""
        return f"{self.world}/{step:03d}"

    def call(self, prompt: str, step: int) -> CallKey:
        """Return the key of the model's call for this step's decision."""
        return CallKey(STUDY, self.policy, prompt, self.frame(step), self.condition)

    def reflection(self, prompt: str, step: int) -> CallKey:
        """Return the key of the call about this step's reflected picture, which decides nothing."""
        return CallKey(STUDY, self.policy, prompt, self.frame(step), REFLECTED)


@dataclass(frozen=True, slots=True)
class Step:
    """One decision of an episode.

    ``truth`` describes the moment before the decision. ``reward``, ``speed_mps``, ``distance_m``
    and ``crashed`` describe the moment after it. ``executed_action`` is the decision's, or without
    one the fail-safe, which is never credited to the policy. ``error`` is the kind of failure of
    the model's call. A speed or a distance that the simulator does not report is None. ``facts``
    holds its other numbers of the step. ``rounded_state_sha256`` is the digest of the world's state
    after it, with numbers rounded to 3 decimals. It is None in older records, and if the world has
    no state. A model's Reply is in the ledger under ``EpisodeKey.call``.
    """

    step: Count
    frame: Name
    decision: Decision[Name]
    executed_action: Name
    truth: Mapping[str, Scalar]
    reward: float
    speed_mps: float | None
    distance_m: float | None
    crashed: bool
    facts: Mapping[str, Scalar] = field(default_factory=dict)
    error: str = ""
    rounded_state_sha256: str | None = None


@dataclass(frozen=True, slots=True)
class Episode:
    """A finished drive: ``ended`` is ``crash``, ``goal``, ``time`` or ``error``, with a ``detail``.

    ``state_sha256`` is the digest of the world's state after the last step, for comparing drives.
    An episode that ended in an error has the steps until then, and counts in no statistic.
    ``max_steps`` is its bound: more decisions would have been an error. It is None in older
    records.
    """

    key: EpisodeKey
    steps: tuple[Step, ...]
    ended: Name
    state_sha256: str
    detail: str = ""
    max_steps: Count | None = None

    @property
    def distance_m(self) -> float | None:
        """Return the distance covered, 0 without a step, None if the simulator reports none."""
        return self.steps[-1].distance_m if self.steps else 0.0

    @property
    def reward(self) -> float:
        """Return the sum of the rewards."""
        return sum(step.reward for step in self.steps)

    @property
    def speed_mps(self) -> float | None:
        """Return the mean speed after decisions, None without a step or a reported speed."""
        speeds = [step.speed_mps for step in self.steps if step.speed_mps is not None]
        return sum(speeds) / len(speeds) if speeds and len(speeds) == len(self.steps) else None

    @property
    def has_crashed(self) -> bool:
        """Return whether any step ended in a crash."""
        return any(step.crashed for step in self.steps)

    def actions(self) -> tuple[str, ...]:
        """Return the executed actions; replayed in the same world they give the same episode."""
        return tuple(step.executed_action for step in self.steps)

    def as_line(self) -> str:
        """Return the episode as one line of JSON."""
        return json.dumps(asdict(self), ensure_ascii=False, separators=(",", ":"), allow_nan=False)


def read_episodes(path: Path) -> Iterator[Episode]:
    """Yield a run folder's finished episodes, without a last line that a kill cut.

    Raises LedgerError with the line, the fault and the remedy for any other line that is none.
    """
    file = path / EPISODES
    if not file.exists():
        return
    with raising(LedgerError, f"{file} cannot be read"):
        lines = text_file(file).read_bytes().split(b"\n")
    for number, line in enumerate(lines[:-1], 1):
        try:
            yield _episode(line)
        except (ValueError, RecursionError) as error:
            raise LedgerError(
                f"{file}: line {number} is no episode: {error}; restore the file from a copy, or delete this line. "
                "The command that began the run then drives its episode again, without repeating finished calls"
            ) from error


def write_episodes(path: Path, episodes: Iterable[Episode]) -> None:
    """Append finished episodes to a run folder's file.

    They are handed to the operating system before this returns, so that a killed process loses
    none.
    """
    with (path / EPISODES).open("a", encoding="utf-8", errors="backslashreplace") as file:
        for episode in episodes:
            file.write(episode.as_line() + "\n")
        file.flush()


def mend_episodes(path: Path) -> None:
    """Remove an incomplete last line that a kill left in a run folder's file."""
    file = path / EPISODES
    if file.is_file():
        text = text_file(file).read_bytes()
        whole = text.rfind(b"\n") + 1
        if whole < len(text):
            with file.open("r+b") as opened:
                opened.truncate(whole)


def _episode(line: bytes) -> Episode:
    def refuse(word: str) -> NoReturn:
        raise ValueError(f"it holds {word}, which is no number")

    with raising(ValueError, "it is no JSON", of=(json.JSONDecodeError, UnicodeDecodeError)):
        raw = parse_json(line, parse_constant=refuse)
    episode = build(Episode, raw)
    for number, step in enumerate(episode.steps):
        for name, due in (("step", number), ("frame", episode.key.frame(number))):
            if (found := getattr(step, name)) != due:
                raise ValueError(f"steps[{number}].{name} is {shown(found)}, but this step's is {shown(due)}")
    return episode


def recorded(run: Path) -> Mapping[str, int]:
    """Return the counts of actions decided on real pictures in a battery or a run of episodes.

    ``RUN,SPEC`` takes one controller of several. Raises SpecError if the run holds several and none
    is named.
    """
    folder, _, spec = str(run).partition(",")
    path = Path(folder)
    unlike = (OSError, ValueError, LookupError, TypeError)
    with raising(LedgerError, f"{path / RUN} is no manifest of a run", of=unlike):
        driven = parse_json(text_file(path / RUN).read_text(encoding="utf-8"))["format"] == EpisodesManifest.FORMAT
    by_spec = _of_episodes(path) if driven else _of_battery(path)
    if spec and spec not in by_spec:
        raise SpecError(f"{folder} holds no decisions of '{spec}'; it holds {', '.join(by_spec) or 'none'}")
    if not spec and len(by_spec) > 1:
        named = f"marginal:{folder},{next(iter(by_spec))}"
        raise SpecError(f"{folder} holds {len(by_spec)} controllers; name one, as {named}")
    return by_spec[spec] if spec else next(iter(by_spec.values()), Counter())


def _of_episodes(path: Path) -> dict[str, Counter[str]]:
    result: dict[str, Counter[str]] = {}
    for episode in read_episodes(path):
        if episode.key.condition == REAL and episode.ended != "error":
            taken = (step.decision.action for step in episode.steps)
            result.setdefault(episode.key.policy, Counter()).update(action for action in taken if action is not None)
    return result


def decided_by(driver: str, marginal: str, episodes: Iterable[Episode]) -> Mapping[str, int]:
    """Return the counts from which a driver's marginal draws, from its run's episodes in order.

    These are the driver's decisions on real pictures, by action, or by reason if there was none.
    Only episodes that were over when the marginal first drove count, and none that ended in an
    error.
    """
    before: dict[EpisodeKey, Episode] = {}
    for episode in episodes:
        if episode.key.policy == marginal and episode.steps:
            break
        if (episode.key.policy, episode.key.condition) == (driver, REAL) and episode.ended != "error":
            before.setdefault(episode.key, episode)
    taken = (step.decision for one in before.values() for step in one.steps)
    return Counter(without(one.missing) if one.missing is not None else str(one.action) for one in taken)


def _of_battery(path: Path) -> dict[str, Counter[str]]:
    manifest, bank = read_run(path)
    result: dict[str, Counter[str]] = {}
    with Ledger(path / LEDGER) as ledger:
        for spec in manifest.models:
            counts = result.setdefault(spec, Counter())
            for key, reply in ledger.replies(spec):
                decision = bank.manifest.action_space.read(reply)
                if key.condition == REAL and decision.action is not None:
                    counts[decision.action] += 1
    return result


_DETAIL = 160


@dataclass(frozen=True, slots=True)
class UnfinishedEpisodes(JsonRecord):
    """The episodes of one policy without a record, and the last errors of their calls.

    ``begun`` is the number with calls in the ledger, None for a policy without calls. ``errors``
    counts the calls whose last attempt failed by kind of error. It counts ``unknown`` for a call
    that was sent and never answered. ``detail`` is the last error's text.
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
            return f"{count}; every call of them was answered: they were cut between two calls"
        kinds = ", ".join(f"{kind} {times}" for kind, times in self.errors.items())
        return f"{count}; the last errors of their calls: {kinds}{f', as: {self.detail}' if self.detail else ''}"


def unfinished(out: Path, keys: Iterable[EpisodeKey], models: Iterable[str]) -> list[UnfinishedEpisodes]:
    """Return the episodes without a record by policy, in the order of their keys."""
    left: dict[str, set[tuple[str, str]]] = {}
    for key in keys:
        left.setdefault(key.policy, set()).add((key.world, key.condition))
    pending = {spec for spec in models if spec in left}
    last: dict[str, dict[CallKey, SentAttempt]] = {}
    if pending:
        with Ledger(out / LEDGER, absent=True) as ledger:
            last = {spec: dict(_of(ledger.attempts(spec), left[spec])) for spec in pending}
    return [_unfinished_episodes(policy, len(worlds), last.get(policy)) for policy, worlds in left.items()]


def every_episode(manifest: EpisodesManifest) -> tuple[EpisodeKey, ...]:
    """Return all episodes of a run's policies, scenarios, seeds and conditions.

    The marginal of a driver looks at no picture and drives with real ones alone. In an extended
    run, some of these episodes may never have been planned.
    """
    return tuple(
        EpisodeKey(policy, manifest.simulator, scenario, seed, condition)
        for policy in manifest.policies
        for condition in ((REAL,) if manifest.marginal_of(policy) else manifest.conditions)
        for scenario in manifest.scenarios
        for seed in manifest.seeds
    )


def _of(attempts: Iterable[SentAttempt], left: set[tuple[str, str]]) -> Iterator[tuple[CallKey, SentAttempt]]:
    """Yield the attempts at calls of these worlds and conditions, a call's last attempt last."""
    for sent in attempts:
        if sent.key.study == STUDY and (sent.key.frame.rpartition("/")[0], sent.key.condition) in left:
            yield sent.key, sent


def _unfinished_episodes(policy: str, episodes: int, last: Mapping[CallKey, SentAttempt] | None) -> UnfinishedEpisodes:
    if last is None:
        return UnfinishedEpisodes(policy, episodes, None, {})
    begun = {(key.frame.rpartition("/")[0], key.condition) for key in last}
    kinds: Counter[str] = Counter()
    detail = ""
    for sent in last.values():
        if sent.reply is None:
            kinds[UNKNOWN] += 1
        elif sent.reply.error is not None:
            kinds[sent.reply.error] += 1
            detail = " ".join(sent.reply.error_detail.split())[:_DETAIL]
    return UnfinishedEpisodes(policy, episodes, len(begun), dict(kinds.most_common()), detail)


@dataclass(frozen=True, slots=True)
class EpisodeMeans(JsonRecord):
    """Means over one policy's episodes under one condition, None without any value.

    ``episodes`` counts those that did not end in an error; ``errors`` count in no mean.
    ``without_decision`` is the share of steps with the fail-safe, because there was no decision.
    """

    policy: str
    condition: str
    episodes: int
    errors: int
    distance_m: float | None
    reward: float | None
    speed_mps: float | None
    crash_rate: float | None
    without_decision: float | None


def summarise(episodes: Iterable[Episode]) -> list[EpisodeMeans]:
    """Return the rows in order of the first episode of a policy and a condition."""
    groups: dict[tuple[str, str], list[Episode]] = {}
    for episode in episodes:
        groups.setdefault((episode.key.policy, episode.key.condition), []).append(episode)
    return [_row(*names, group) for names, group in groups.items()]


def _row(policy: str, condition: str, group: list[Episode]) -> EpisodeMeans:
    good = [episode for episode in group if episode.ended != "error"]
    steps = [step for episode in good for step in episode.steps]
    return EpisodeMeans(
        policy=policy,
        condition=condition,
        episodes=len(good),
        errors=len(group) - len(good),
        distance_m=_mean(episode.distance_m for episode in good),
        reward=fmean(episode.reward for episode in good) if good else None,
        speed_mps=_mean(episode.speed_mps for episode in good),
        crash_rate=fmean(episode.has_crashed for episode in good) if good else None,
        without_decision=fmean(step.decision.action is None for step in steps) if steps else None,
    )


def _mean(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return fmean(known) if known else None
