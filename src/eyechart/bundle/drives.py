"""Validate drives: drive every episode again from its record, within an announced bound."""

import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from eyechart.bundle.differences import TOLERANCE, PrintedDifference
from eyechart.episodes import ACTION_MAP, Episode, EpisodesManifest, every_episode, read_episodes, unfinished
from eyechart.episodes.plans import PATIENCE_S
from eyechart.episodes.records import decided_by
from eyechart.episodes.repeats import (
    Mismatch,
    ReplayDifferences,
    longest,
    other_versions,
    repeat,
    why_not_opened,
    world_of,
)
from eyechart.errors import BundleError, counted
from eyechart.ledger import Ledger
from eyechart.manifest import LEDGER, RUN, read_episodes_manifest
from eyechart.perception.view import find_view
from eyechart.policies.baselines import drawn_like
from eyechart.simulators import Simulator
from eyechart.studies import Tell
from eyechart.studies.structured.observed_frames import ObservedFrames, check, read_seen
from eyechart.studies.structured.online import WorldCheck, check_world, read_vetting

MOST_EPISODES = 100_000
MOST_STEPS = 5_000_000
"""The most episodes and steps of a run of drives in a bundle."""
MOST_DRIVEN = 1_000_000
"""World steps to drive again; a longer run is sampled up to this number."""

MOST_VETTED = 1_000
UNVETTED = "how worlds were vetted"
"""Not compared if other versions vetted the worlds."""
_ACTION_MAP = "action map"
"""The name of the action map's digest among a ``gym:`` world's versions."""


@dataclass(frozen=True, slots=True)
class ReplayCheck:
    """How to drive again.

    ``processes`` is their number, ``sample`` the episodes per run (None for all). A sample also
    limits the worlds that are vetted again. ``announce`` gets the bound of the work before it
    begins.
    """

    processes: int = 1
    sample: int | None = None
    announce: Tell = lambda _: None


@dataclass
class RunCheck:
    """The findings of a check of one run."""

    differences: list[PrintedDifference]
    uncompared: list[str]
    notes: list[str]
    compared: dict[str, int]


def require_bounded_drives(run: Path) -> None:
    """Raise BundleError if a run of drives is too large to validate; nothing is computed before."""
    episodes = steps = 0
    for episode in read_episodes(run):
        episodes, steps = episodes + 1, steps + len(episode.steps)
        for what, count, most in (("episodes", episodes, MOST_EPISODES), ("steps", steps, MOST_STEPS)):
            if count > most:
                raise BundleError(f"it has more than {most} {what}, the most that are validated: nothing is recomputed")


def check_drives(run: Path, *, exact: bool, same_pictures: bool, how: ReplayCheck, tell: Tell) -> RunCheck:
    """Drive the episodes of a run again and compare; ``exact`` if the same eyechart drove them.

    Worlds with foreign code are not opened; the notes name episodes that were not driven.
    """
    result, manifest = RunCheck([], [], [], {}), read_episodes_manifest(run)
    if (run / RUN).read_bytes() != manifest.as_text().encode():
        result.differences.append(PrintedDifference(RUN, "written in another way", "as a run is written"))
    episodes = list({episode.key: episode for episode in read_episodes(run)}.values())
    if (run / LEDGER).is_file():
        with Ledger(run / LEDGER, sound=False) as ledger:
            damaged = ledger.damaged()
            result.differences += [
                PrintedDifference(f"{LEDGER}, {one}", "a row", "another than was written") for one in damaged
            ]
            ledger.take()
            result.differences += _asked_twice(ledger, manifest)
    if why := why_not_opened(manifest):
        result.uncompared.append(f"the drives of {manifest.simulator}")
        result.notes.append(f"nothing was driven again: {why}")
        return result
    simulator = world_of(run, manifest)
    result.differences += [*_declared(manifest, simulator), *_drawn(run, manifest)]
    apart = other_versions(manifest, simulator)
    if _ACTION_MAP in apart:  # it lies beside the run and is no library
        result.differences.append(PrintedDifference(f"{ACTION_MAP}, digest", *apart.pop(_ACTION_MAP)))
    words = "; ".join(f"{name} {made}, here {here}" for name, (made, here) in apart.items())
    same = exact and not apart
    chosen, worlds = _chosen(run, manifest, episodes, how, result), manifest.simulator
    vetted, seen = _vetted(run, how, result, same=same), _seen(run, chosen, same=same)
    most = longest(manifest, episodes)
    how.announce(_bound(chosen, len(episodes), worlds, how, most) + _online_bound(vetted, seen))
    repeats = repeat(
        run,
        manifest,
        chosen,
        exact=same,
        processes=how.processes,
        progress=lambda done, all_: tell(f"driving again: {done} of {all_} episodes of {worlds}"),
    )
    result.compared.update({"episodes driven again": repeats.episodes, "steps": repeats.steps})
    _hold(repeats, result, words if exact else words or "another eyechart", same_pictures=same_pictures)
    _hold_vetting(vetted, manifest, simulator, result)
    _hold_seen(seen, manifest, simulator, result, has_frames=bool(read_seen(run)))
    _say(run, manifest, episodes, result)
    return result


def _declared(manifest: EpisodesManifest, simulator: Simulator) -> Iterator[PrintedDifference]:
    """Yield the manifest's statements about its world that the world contradicts."""
    declared = simulator.declared
    for name, mine, theirs in (
        ("action_space", manifest.action_space, declared.action_space.by(manifest.reader)),
        ("picture", manifest.picture, declared.picture),
    ):
        if mine != theirs:
            yield PrintedDifference(f"{RUN}, {name}", str(mine), str(theirs))


def _drawn(run: Path, manifest: EpisodesManifest) -> Iterator[PrintedDifference]:
    """Yield wrong counts of marginal policies: those that are not their driver's decisions."""
    for spec in {episode.key.policy: None for episode in read_episodes(run) if episode.steps}:
        if driver := manifest.marginal_of(spec):
            counts, made = decided_by(driver, spec, read_episodes(run)), manifest.policies[spec]
            if (here := drawn_like(counts, manifest.action_space).version) != made:
                yield PrintedDifference(f"{RUN}, counts of '{spec}'", made or "none", here)


def _asked_twice(ledger: Ledger, manifest: EpisodesManifest) -> Iterator[PrintedDifference]:
    """Yield the calls whose attempts had different requests."""
    for spec in manifest.models:
        first: dict[object, str] = {}
        for sent in ledger.attempts(spec):
            if (before := first.setdefault(sent.key, sent.request_sha256)) != sent.request_sha256:
                where = f"ledger, another attempt of {spec} about '{sent.key.frame}' under {sent.key.condition}"
                yield PrintedDifference(where, sent.request_sha256, before)


def _chosen(
    run: Path, manifest: EpisodesManifest, episodes: Sequence[Episode], how: ReplayCheck, found: RunCheck
) -> list[Episode]:
    """Return the episodes to drive again: all, or an unpredictable sample."""
    drawn = random.SystemRandom().sample(episodes, len(episodes))
    times, most = _steps_a_decision(run), longest(manifest, episodes)
    kept, steps = [], 0
    for one in drawn[: how.sample]:
        steps += times * (most if one.ended == "error" else len(one.steps))
        if steps > MOST_DRIVEN:
            break
        kept.append(one)
    if left := len(episodes) - len(kept):
        found.uncompared.append(f"{left} of {len(episodes)} episodes of {manifest.simulator}")
        found.notes.append(f"{left} episodes were not driven again; the others were chosen at random")
    return kept


def _steps_a_decision(run: Path) -> int:
    if not (run / ACTION_MAP).is_file():
        return 1
    from eyechart.simulators.gym.action_map import read_map  # noqa: PLC0415 - Gymnasium takes a while to import

    return read_map(run / ACTION_MAP).repeat


def _hold(repeats: ReplayDifferences, found: RunCheck, apart: str, *, same_pictures: bool) -> None:
    """Record the findings of driving again: differences, or what other versions cannot compare."""
    if apart:
        found.uncompared.append(f"{repeats.episodes} episodes, driven with other versions")
        found.notes.append(f"not comparable: driven with {apart}")
        first = min(repeats.mismatches, key=lambda mismatch: (mismatch.step or 0, mismatch.key), default=None)
        found.notes.append(
            "decisions and truth to 3 decimals are the same at every step"
            if first is None
            else f"with other versions the first step that differs: {_difference(first)}"
        )
        return
    found.differences += [_difference(mismatch) for mismatch in repeats.mismatches]
    if same_pictures:
        found.differences += [_difference(one) for one in repeats.unlike]
        found.compared["requests"] = repeats.requests
    elif repeats.unlike:
        found.uncompared.append("requests of drives")
        found.notes.append("this machine encodes pictures to other bytes: no request of a drive was compared")
    if repeats.lost:
        found.uncompared.append(f"how {len(repeats.lost)} episodes failed")
        found.notes += [f"an error that did not happen again: {one}" for one in repeats.lost[:3]]
    _hold_states(repeats, found)


def _hold_states(repeats: ReplayDifferences, found: RunCheck) -> None:
    """Compare exact states with the record; if all differ, one to one, another machine drove."""
    unlike = [state for state in repeats.states if state[1] != state[2]]
    one_to_one = len({pair[1:] for pair in repeats.states}) == len({state[1] for state in repeats.states})
    if unlike and len(unlike) == len(repeats.states) and one_to_one:
        found.uncompared.append("exact states")
        found.notes.append(
            "rounded states are the same at every step, but no episode has the same exact state: another kind "
            "of machine"
        )
        return
    for key, recorded, driven in unlike:
        found.differences.append(_difference(Mismatch(key, None, "state at the end (SHA-256)", recorded, driven)))


def _difference(mismatch: Mismatch) -> PrintedDifference:
    return PrintedDifference(mismatch.where, mismatch.recorded, mismatch.driven)


def _bound(chosen: Sequence[Episode], of: int, worlds: str, how: ReplayCheck, most: int) -> str:
    steps = sum(most if episode.ended == "error" else len(episode.steps) for episode in chosen)
    where = f"{counted(steps, 'step')} in {counted(how.processes, 'process')}"
    again = f"driving {len(chosen)} of {counted(of, 'episode')} of {worlds} again"
    return f"{again}: {where}, none longer than {PATIENCE_S:g} s"


def _online_bound(vetted: Sequence[WorldCheck], seen: Sequence[tuple[ObservedFrames, Episode]]) -> str:
    """Return in words an online run's extra work: worlds to vet and frames to check again."""
    if not vetted and not seen:
        return ""
    steps, frames = sum(one.frames for one in vetted), sum(len(one.steps) for _, one in seen)
    worlds = f"{counted(len(vetted), 'world')} vetted again, {counted(steps, 'step')}"
    return f"; then in one process: {worlds}, and {counted(frames, 'frame')} checked anew"


def _vetted(run: Path, how: ReplayCheck, found: RunCheck, *, same: bool) -> Sequence[WorldCheck]:
    """Return the worlds of an online run to vet again: all, or a random sample."""
    vetted = read_vetting(run) or ()
    if len(vetted) > MOST_VETTED:
        raise BundleError(f"it has {len(vetted)} vetted worlds, more than the {MOST_VETTED} that are vetted again")
    if vetted and not same:
        found.uncompared.append(UNVETTED)
        return ()
    kept = random.SystemRandom().sample(vetted, min(len(vetted), how.sample or len(vetted)))
    if left := len(vetted) - len(kept):
        found.uncompared.append(f"{left} of {len(vetted)} vetted worlds")
        found.notes.append(f"{left} worlds were not vetted again; the others were chosen at random")
    return kept


def _seen(run: Path, chosen: Sequence[Episode], *, same: bool) -> Sequence[tuple[ObservedFrames, Episode]]:
    """Return the chosen episodes that an online run recorded as checked, with that record."""
    recorded = {(one.policy, one.scenario, one.seed): one for one in read_seen(run)} if same else {}
    found = (
        (recorded.get((episode.key.policy, episode.key.scenario, episode.key.seed)), episode) for episode in chosen
    )
    return [(mine, one) for mine, one in found if mine is not None and one.ended != "error"]


def _hold_vetting(
    vetted: Sequence[WorldCheck], manifest: EpisodesManifest, simulator: Simulator, found: RunCheck
) -> None:
    """Let the positive control drive again in worlds that an online run vetted."""
    if not vetted:
        return
    view = find_view(manifest.view)
    for one in vetted:
        again, where = check_world(simulator, one.scenario, one.seed, view), f"vetting of {one.scenario}/{one.seed}"
        found.differences += _apart(where, one, again, ("frames", "ended", "actions", "gap_mae_m", "why", "unseen"))
    found.compared["vetted worlds"] = len(vetted)


def _apart(where: str, mine: object, again: object, names: Sequence[str]) -> Iterator[PrintedDifference]:
    """Yield the fields in which two records differ by more than rounding."""
    for name in names:
        one, other = getattr(mine, name), getattr(again, name)
        close = isinstance(one, float) and isinstance(other, float) and abs(one - other) <= TOLERANCE
        if one != other and not close:
            yield PrintedDifference(f"{where}, {name}", str(one), str(other))


def _hold_seen(
    seen: Sequence[tuple[ObservedFrames, Episode]],
    manifest: EpisodesManifest,
    simulator: Simulator,
    found: RunCheck,
    *,
    has_frames: bool,
) -> None:
    """Check again every frame that an online run recorded as checked."""
    if not has_frames:
        return
    if UNVETTED in found.uncompared:
        found.uncompared.append("how frames were checked")
        return
    view = find_view(manifest.view)
    for mine, episode in seen:
        where = f"frames seen in '{episode.key.policy} {episode.key.world}'"
        found.differences += _apart(where, mine, check(simulator, episode, view), ("frames", "why", "gap_mae_m"))
    found.compared["episodes whose frames were checked"] = len(seen)


def _say(run: Path, manifest: EpisodesManifest, episodes: Sequence[Episode], found: RunCheck) -> None:
    """Note the parts of a run that no drive can check."""
    if called := [spec for spec in manifest.models if spec.startswith("python:")]:
        found.notes.append(f"unchecked: the code of {', '.join(called)}; its replies are those of the record")
    over = {episode.key for episode in episodes}
    left = unfinished(run, [key for key in every_episode(manifest) if key not in over], manifest.models)
    if begun := sum(one.begun or 0 for one in left):
        found.notes.append(f"{begun} episodes were started and are unfinished: their calls were not compared")
