"""An episode is a drive; finished ones are lines of a file: appended whole, read strictly, and summed up."""

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
from eyechart.ledger import UNKNOWN, Ledger, Sent
from eyechart.manifest import EPISODES, LEDGER, RUN, EpisodesManifest, read_run
from eyechart.policies.baselines import without
from eyechart.records import Count, Name, Plain, build, parse_json, shown
from eyechart.spaces.space import Decision

STUDY = "closed_loop"

SILENCES: Mapping[str, frozenset[str]] = {"unfinished": frozenset(), "fail-safe": SILENT}
"""What becomes of a call that fails in a way that may pass, with the kinds of failure that are then
a model's silence: the episode is left for a resumed run, or the fail-safe is executed
(docs/decisions/drives.md)."""


REAL = "real"

REFLECTED = "mirrored"
"""The condition under which a call about the reflection of a picture stands in the ledger."""


@dataclass(frozen=True, slots=True, order=True)
class EpisodeKey:
    """The identity of an episode: who drives, in which world, and what the camera's picture is replaced by."""

    policy: Name
    simulator: Name
    scenario: Name
    seed: Count
    condition: Name = "real"

    @property
    def world(self) -> str:
        """Return the world's name, which every policy and condition shares: ``highway/dense/3``."""
        return f"{self.simulator}/{self.scenario}/{self.seed}"

    def frame(self, step: int) -> str:
        """Return the id of the picture before a decision: ``highway/dense/3/017``."""
        return f"{self.world}/{step:03d}"

    def call(self, prompt: str, step: int) -> CallKey:
        """Return the key of the call that a model's decision of this step is."""
        return CallKey(STUDY, self.policy, prompt, self.frame(step), self.condition)

    def reflection(self, prompt: str, step: int) -> CallKey:
        """Return the key of the call about the reflection of this step's picture, which decides nothing."""
        return CallKey(STUDY, self.policy, prompt, self.frame(step), REFLECTED)


@dataclass(frozen=True, slots=True)
class Step:
    """One decision of an episode.

    ``truth`` is of the moment before the decision, ``reward``, ``speed_mps``, ``distance_m`` and
    ``crashed`` of the one after it. ``executed_action`` is the decision's or, where there is none,
    the fail-safe, which is never credited to the policy. ``error`` is the kind of failure where the
    model's call failed. A speed or a distance that the simulator does not tell is None. ``facts``
    is what else the simulator says of the move. ``rounded_state_sha256`` is the digest of the
    world's state after it, its numbers rounded to 3 decimals; None where a record is older than
    that field, or the world told no state. A model's Reply stands in the ledger under
    ``EpisodeKey.call``.
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
    """A drive that is over: ``ended`` is ``crash``, ``goal``, ``time`` or ``error``, of which ``detail`` says more.

    ``state_sha256`` is the digest of the world's state after the last step, for telling equal
    drives. An episode that ended in an error has the steps until then, and counts in no statistic.
    ``max_steps`` is the bound that it was driven under: of more decisions it would have been an
    error; None where a record is older than that field.
    """

    key: EpisodeKey
    steps: tuple[Step, ...]
    ended: Name
    state_sha256: str
    detail: str = ""
    max_steps: Count | None = None

    @property
    def distance_m(self) -> float | None:
        """Return what was covered, 0 for an episode without a step, None where the simulator does not tell."""
        return self.steps[-1].distance_m if self.steps else 0.0

    @property
    def reward(self) -> float:
        """Return the sum of the rewards."""
        return sum(step.reward for step in self.steps)

    @property
    def speed_mps(self) -> float | None:
        """Return the mean speed after a decision, None without a step, or where the simulator does not tell it."""
        speeds = [step.speed_mps for step in self.steps if step.speed_mps is not None]
        return sum(speeds) / len(speeds) if speeds and len(speeds) == len(self.steps) else None

    @property
    def crashed(self) -> bool:
        """Return whether any step ended in a crash."""
        return any(step.crashed for step in self.steps)

    def actions(self) -> tuple[str, ...]:
        """Return what was executed, step by step: replayed in the same world it gives the same episode."""
        return tuple(step.executed_action for step in self.steps)

    def as_line(self) -> str:
        """Return the episode as one line of JSON."""
        return json.dumps(asdict(self), ensure_ascii=False, separators=(",", ":"), allow_nan=False)


def read_episodes(path: Path) -> Iterator[Episode]:
    """Yield the finished episodes of a run folder; what a kill cut at the end of the file is no episode.

    Raises LedgerError with the line, the field and what to do, for anything else that is none.
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
                raise ValueError(f"steps[{number}].{name} is {shown(found)}, not {shown(due)}, which is this step's")
    return episode


def recorded(run: Path) -> Mapping[str, int]:
    """Return how often each action was decided on real pictures in a run, of a battery or of episodes.

    ``RUN,SPEC`` takes one controller of several. Raises SpecError where the run holds several and
    none is named.
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
    found: dict[str, Counter[str]] = {}
    for episode in read_episodes(path):
        if episode.key.condition == REAL and episode.ended != "error":
            taken = (step.decision.action for step in episode.steps)
            found.setdefault(episode.key.policy, Counter()).update(action for action in taken if action is not None)
    return found


def decided_by(driver: str, marginal: str, episodes: Iterable[Episode]) -> Mapping[str, int]:
    """Return by what the marginal of a driver draws, from the episodes of its run in the order of their record.

    These are the driver's decisions on real pictures, by action, and by reason where there was
    none, in the episodes that were over when its marginal first drove. An episode that ended in an
    error counts in nothing.
    """
    before: dict[EpisodeKey, Episode] = {}
    for one in episodes:
        if one.key.policy == marginal and one.steps:
            break
        if (one.key.policy, one.key.condition) == (driver, REAL) and one.ended != "error":
            before.setdefault(one.key, one)
    taken = (step.decision for one in before.values() for step in one.steps)
    return Counter(without(one.missing) if one.missing is not None else str(one.action) for one in taken)


def _of_battery(path: Path) -> dict[str, Counter[str]]:
    manifest, bank = read_run(path)
    found: dict[str, Counter[str]] = {}
    with Ledger(path / LEDGER) as ledger:
        for spec in manifest.models:
            counts = found.setdefault(spec, Counter())
            for key, reply in ledger.replies(spec):
                decision = bank.manifest.action_space.read(reply)
                if key.condition == REAL and decision.action is not None:
                    counts[decision.action] += 1
    return found


_DETAIL = 160


@dataclass(frozen=True, slots=True)
class Unfinished(Plain):
    """The episodes of one policy that have no record, and what their calls met last.

    ``begun`` of them have calls in the ledger; None for a policy that asks no model. ``errors``
    counts the calls of these whose last attempt failed, by kind of error, ``unknown`` for one that
    was sent and never came back; ``detail`` is what the last of them said.
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
    last: dict[str, dict[CallKey, Sent]] = {}
    if asked:
        with Ledger(out / LEDGER, absent=True) as ledger:
            last = {spec: dict(_of(ledger.attempts(spec), left[spec])) for spec in asked}
    return [_told(policy, len(worlds), last.get(policy)) for policy, worlds in left.items()]


def every_episode(manifest: EpisodesManifest) -> tuple[EpisodeKey, ...]:
    """Return the episodes that a run's policies, scenarios, seeds and conditions make together.

    The marginal of one of its drivers, which looks at no picture, drives by real ones alone. A run
    that was extended may never have been asked for all of them.
    """
    return tuple(
        EpisodeKey(policy, manifest.simulator, scenario, seed, condition)
        for policy in manifest.policies
        for condition in ((REAL,) if manifest.marginal_of(policy) else manifest.conditions)
        for scenario in manifest.scenarios
        for seed in manifest.seeds
    )


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


@dataclass(frozen=True, slots=True)
class Row(Plain):
    """Means over the episodes of one policy under one condition; None where no episode tells the number.

    ``episodes`` ended otherwise than in one of the ``errors``, which count in no mean.
    ``without_decision`` is the share of steps at which the fail-safe was executed because there was
    no decision.
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


def summarise(episodes: Iterable[Episode]) -> list[Row]:
    """Return the rows in the order in which a policy and a condition first come."""
    groups: dict[tuple[str, str], list[Episode]] = {}
    for episode in episodes:
        groups.setdefault((episode.key.policy, episode.key.condition), []).append(episode)
    return [_row(*names, group) for names, group in groups.items()]


def _row(policy: str, condition: str, group: list[Episode]) -> Row:
    good = [one for one in group if one.ended != "error"]
    steps = [step for one in good for step in one.steps]
    return Row(
        policy=policy,
        condition=condition,
        episodes=len(good),
        errors=len(group) - len(good),
        distance_m=_mean(one.distance_m for one in good),
        reward=fmean(one.reward for one in good) if good else None,
        speed_mps=_mean(one.speed_mps for one in good),
        crash_rate=fmean(one.crashed for one in good) if good else None,
        without_decision=fmean(step.decision.action is None for step in steps) if steps else None,
    )


def _mean(values: Iterable[float | None]) -> float | None:
    told = [value for value in values if value is not None]
    return fmean(told) if told else None
