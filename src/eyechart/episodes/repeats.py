"""Replays of episodes: worlds are driven again and compared with the record, step by step.

Models are answered from the ledger. Only worlds and policies that ship with eyechart are driven: a
record may come from anywhere, and may name foreign code.
"""

import re
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from eyechart.calls import CallKey
from eyechart.episodes.coordinator import Bounds, Drivers, Progress, RecordedModel, calls_of, drive_again
from eyechart.episodes.plans import ACTION_MAP, PATIENCE_S
from eyechart.episodes.records import SILENCES, Episode, EpisodeKey, Step
from eyechart.episodes.workers import LocalWorker
from eyechart.episodes.worlds import Setup
from eyechart.errors import SpecError
from eyechart.frames import Scalar
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER, EpisodesManifest
from eyechart.perception.forward import distances_of
from eyechart.perception.view import find_view
from eyechart.policies import Policy, open_policy
from eyechart.policies.baselines import drawn_like
from eyechart.simulators import SIMULATORS, Simulator, open_simulator

_CLOSE = 1e-9
_UNDER_WAY = 8
"""Episodes of a model that are driven at once; without real calls, a few keep the processes
busy."""
_COUNTS = re.compile(r"'([^']+)': (\d+)")
_MOST_COUNT = 18
"""The most digits of a number in a marginal's counts."""
_MODULE = ":"


@dataclass(frozen=True, slots=True)
class Mismatch:
    """A difference between a record and its replay, at the first step that differs.

    ``step`` is None for a difference of the whole episode.
    """

    key: EpisodeKey
    step: int | None
    what: str
    recorded: str
    driven: str

    @property
    def where(self) -> str:
        """Return the place of the difference in words."""
        at = "" if self.step is None else f", step {self.step}"
        return f"episode '{self.key.policy} {self.key.world} {self.key.condition}'{at}, {self.what}"


@dataclass
class ReplayDifferences:
    """The result of a replay: mismatches, changed requests, and episodes without a replay.

    ``requests`` is the number of compared requests. ``states`` are pairs of exact digests at the
    ends of episodes, as recorded and as driven. ``lost`` are episodes that ended in an error that
    did not recur.
    """

    episodes: int = 0
    steps: int = 0
    mismatches: list[Mismatch] = field(default_factory=list)
    requests: int = 0
    unlike: list[Mismatch] = field(default_factory=list)
    states: list[tuple[EpisodeKey, str, str]] = field(default_factory=list)
    lost: list[EpisodeKey] = field(default_factory=list)


def why_not_opened(manifest: EpisodesManifest) -> str:
    """Return in words why this run's worlds are not opened, empty if they ship with eyechart.

    Gymnasium's own environments count as shipped. An id with a module imports it, and may be
    foreign code.
    """
    kind, colon, name = manifest.simulator.partition(_MODULE)
    if not colon:
        return "" if kind in SIMULATORS else f"'{manifest.simulator}' is no simulator of this eyechart"
    if kind != "gym" or _MODULE in name:
        return f"'{manifest.simulator}' names a module, and a validation runs no foreign code"
    from eyechart.simulators.gym.drive import is_plain  # noqa: PLC0415 - Gymnasium takes a while to import

    return "" if is_plain(name) else f"'{manifest.simulator}' is none of Gymnasium's own small environments"


def world_of(run: Path, manifest: EpisodesManifest) -> Simulator:
    """Open the world of a run that `why_not_opened` allows, with the run's own action map."""
    actions = run / ACTION_MAP
    return open_simulator(manifest.simulator, actions=actions if actions.is_file() else None)


def other_versions(manifest: EpisodesManifest, simulator: Simulator) -> dict[str, tuple[str, str]]:
    """Return the differing versions: by name, the recorded version and the present one."""
    made, here = manifest.world, simulator.versions()
    pairs = {name: (made.get(name, "unknown"), here.get(name, "unknown")) for name in [*made, *here]}
    return {name: pair for name, pair in pairs.items() if pair[0] != pair[1]}


def repeat(
    run: Path,
    manifest: EpisodesManifest,
    episodes: Sequence[Episode],
    *,
    exact: bool,
    processes: int = 1,
    progress: Progress | None = None,
) -> ReplayDifferences:
    """Drive recorded episodes again and return the differences, without calls or files.

    ``exact`` compares every field, and the rounded state after each step by its digest. Otherwise
    decisions are compared, and truth, reward, speed and distance to 3 decimals. An episode in error
    is driven for one step more than recorded, to find one that was cut short. Raises SpecError for
    a run that `why_not_opened` refuses.
    """
    if why := why_not_opened(manifest):
        raise SpecError(why)
    drivers = _drivers(manifest, world_of(run, manifest), {episode.key.policy for episode in episodes})
    recorded = {
        episode.key: episode for episode in episodes if episode.key.policy in {*drivers.policies, *drivers.models}
    }
    replaydifferences = ReplayDifferences(lost=[episode.key for episode in episodes if episode.key not in recorded])
    setup = Setup(manifest.simulator, manifest.seed, longest(manifest, episodes), silence=manifest.silence)
    actions = run / ACTION_MAP
    setup = replace(setup, actions=actions) if actions.is_file() else setup
    compare = partial(_compare, exact=exact)

    def keep(driven: Episode) -> None:
        replaydifferences.episodes += 1
        replaydifferences.steps += len(driven.steps)
        compare(recorded[driven.key], driven, replaydifferences)
        if progress is not None:
            progress(replaydifferences.episodes, len(recorded))

    with Ledger(run / LEDGER, absent=True, sound=False) as ledger:
        calls = calls_of(list(recorded), drivers, ledger)
    replaydifferences.requests = sum(len(of) for of in calls.values())

    def unlike(key: EpisodeKey, call: CallKey, sent: str, shown: str) -> None:
        replaydifferences.unlike.append(
            Mismatch(key, int(call.frame.rpartition("/")[2]), "request (SHA-256)", sent, shown)
        )

    drive_again(
        sorted(recorded),
        drivers,
        partial(LocalWorker, setup, patience_s=PATIENCE_S),
        keep,
        calls=calls,
        unlike=unlike,
        bounds=Bounds(processes, _UNDER_WAY),
    )
    return replaydifferences


def longest(manifest: EpisodesManifest, episodes: Sequence[Episode]) -> int:
    """Return the most steps of a replay: the longest episode's, and one more after an error."""
    steps = max((len(episode.steps) + (episode.ended == "error") for episode in episodes), default=1)
    return max(1, min(steps, manifest.max_steps))


def _drivers(manifest: EpisodesManifest, simulator: Simulator, drove: Container[str]) -> Drivers:
    """Return the drivers: shipped policies, and a record for every model.

    Marginals that never drew are left out.
    """
    space, answers = manifest.action_space, manifest.prompt.asks(manifest.action_space)
    policies = {
        spec: _policy(spec, made, manifest)
        for spec, made in manifest.policies.items()
        if spec not in manifest.modes and (not manifest.marginal_of(spec) or (spec in drove and _COUNTS.search(made)))
    }
    return Drivers(
        policies=policies,
        models={spec: RecordedModel() for spec in manifest.modes},
        prompt=manifest.prompt,
        space=space,
        seed=manifest.seed,
        answers=answers.in_world(distances_of(simulator.declared.camera)),
        view=find_view(manifest.view),
        silent=SILENCES[manifest.silence],
    )


def _policy(spec: str, version: str, manifest: EpisodesManifest) -> Policy:
    """Open a policy; a marginal draws from the recorded counts, and reads no other run."""
    counts = {name: int(count) for name, count in _COUNTS.findall(version) if len(count) <= _MOST_COUNT}
    if manifest.marginal_of(spec):
        return drawn_like(counts, manifest.action_space)
    return open_policy(spec, manifest.action_space, lambda _: counts)


def _compare(recorded: Episode, driven: Episode, found: ReplayDifferences, *, exact: bool) -> None:
    """Add the first step that differs with its differences, or the exact states if none does."""
    key = recorded.key
    for before, now in zip(recorded.steps, driven.steps, strict=False):
        differs = list(_step(before, now, exact=exact))
        if differs:
            found.mismatches += [Mismatch(key, before.step, *one) for one in differs]
            return
    if len(driven.steps) < len(recorded.steps) and "error" in {recorded.ended, driven.ended}:  # it ended earlier
        ending = driven.detail or f"ended in {driven.ended}"
        found.mismatches.append(Mismatch(key, len(driven.steps), "the step", "recorded", ending))
        return
    if recorded.ended == "error":
        if (driven.ended, len(driven.steps), driven.detail) != ("error", len(recorded.steps), recorded.detail):
            found.lost.append(key)
        return
    whole = (
        ("number of steps", str(len(recorded.steps)), str(len(driven.steps))),
        ("how it ended", recorded.ended, driven.ended),
    )
    differs = [one for one in whole if one[1] != one[2]]
    found.mismatches += [Mismatch(key, None, *one) for one in differs]
    if exact and not differs:
        found.states.append((key, recorded.state_sha256, driven.state_sha256))


def _step(before: Step, now: Step, *, exact: bool) -> Iterator[tuple[str, str, str]]:
    """Yield the differences at a step: the name, the recorded and the driven value."""
    yield from _mapping("truth", before.truth, now.truth, exact=exact)
    pairs: list[tuple[str, object, object]] = [
        ("decision", before.decision.action, now.decision.action),
        ("missing decision", before.decision.missing, now.decision.missing),
        ("why there is no decision", before.decision.why, now.decision.why),
        ("error of the call", before.error, now.error),
        ("executed action", before.executed_action, now.executed_action),
    ]
    numbers = ("reward", "speed_mps", "distance_m")
    pairs += [(name, getattr(before, name), getattr(now, name)) for name in numbers]
    if exact:
        yield from _mapping("facts", before.facts, now.facts, exact=True)
        if before.rounded_state_sha256 is not None:
            digests = before.rounded_state_sha256, now.rounded_state_sha256
            pairs.append(("rounded state (SHA-256)", *digests))
    pairs.append(("crashed", before.crashed, now.crashed))
    yield from ((name, str(one), str(other)) for name, one, other in pairs if not _is_same(one, other, exact=exact))


def _mapping(
    what: str, before: Mapping[str, Scalar], now: Mapping[str, Scalar], *, exact: bool
) -> Iterator[tuple[str, str, str]]:
    for name in dict.fromkeys([*before, *now]):
        one, other = before.get(name), now.get(name)
        if name not in before or name not in now or not _is_same(one, other, exact=exact):
            yield f"{what} {name}", str(before.get(name, "nothing")), str(now.get(name, "nothing"))


def _is_same(one: object, other: object, *, exact: bool) -> bool:
    """Return whether two values are equal: numbers up to rounding, or else to 3 decimals."""
    numbers = [value for value in (one, other) if isinstance(value, int | float) and not isinstance(value, bool)]
    if len(numbers) < 2:
        return one == other
    if exact:
        return abs(numbers[0] - numbers[1]) <= _CLOSE * max(1.0, abs(numbers[0]))
    return round(numbers[0], 3) == round(numbers[1], 3)
