"""What planned episodes are expected to take, what they may take, and what their worlds show first."""

import asyncio
from collections.abc import Sequence
from dataclasses import replace

from eyechart.costs import CostEstimate, estimate
from eyechart.episodes.nouns import Episode, EpisodeKey
from eyechart.episodes.planning import Episodes
from eyechart.episodes.records import recorded
from eyechart.episodes.running import calls_of
from eyechart.episodes.workers import LocalWorker, WorkerDiedError
from eyechart.episodes.worlds import Setup, Shown
from eyechart.errors import DriveError, EyechartError, SpecError, printable
from eyechart.frames import Stimulus
from eyechart.ledger import Ledger
from eyechart.limits import NOTHING, Limits, Spent
from eyechart.manifest import LEDGER
from eyechart.models.prices import Prices
from eyechart.perception.view import through
from eyechart.policies import Policy, open_policy
from eyechart.probe import Sample
from eyechart.simulators import open_simulator

PATIENCE_S = 30.0
"""A sample whose world takes longer for one answer is given up."""

ALTOGETHER_S = 120.0
"""A sample that takes longer is given up."""

_LONGEST_SAMPLE = 200
_PICTURES = 3


def expected(planned: Episodes, prices: Prices, *, concurrency: int) -> tuple[CostEstimate, ...]:
    """Return what the calls that are still to be made are expected to take, by model.

    An episode counts as long as one that brakes all the way, in the first of the seeds, and where that crashes as the
    longest of one action; these drives are made here, in a process of their own. Of an episode that was cut the calls
    that are finished are not made again. Raises DriveError where a drive fails or they take too long: then nothing can
    be said.
    """
    left = [key for key in planned.left() if key.policy in planned.drivers.models]
    if not left:
        return ()
    setup = replace(planned.setup, max_steps=min(planned.setup.max_steps, _LONGEST_SAMPLE))
    fail_safe = open_simulator(planned.setup.simulator, actions=planned.setup.actions).declared.fail_safe
    space = planned.drivers.space
    actions = dict.fromkeys((fail_safe, *space.actions))
    constants = [open_policy(f"constant:{action}", space, recorded) for action in actions]
    first = [
        replace(key, policy="constant", seed=planned.manifest.seeds[0])
        for key in {key.scenario: key for key in left}.values()
    ]
    length = asyncio.run(_lengths(setup, first, constants))
    made = _finished(planned, left)
    return tuple(
        estimate(
            planned.manifest.mode(spec),
            sum(max(0, length[key.scenario] - made.get(key, 0)) for key in left if key.policy == spec),
            prices,
            concurrency=concurrency,
            sampled=True,
        )
        for spec in planned.drivers.models
    )


async def _lengths(setup: Setup, keys: Sequence[EpisodeKey], policies: Sequence[Policy]) -> dict[str, int]:
    """Return, by scenario, how many steps the first policy drives, or where it crashes the most that any does.

    Raises DriveError that names the world that fails.
    """
    worker, found, world = LocalWorker(setup, patience_s=PATIENCE_S), list[Episode](), ""
    try:
        async with asyncio.timeout(ALTOGETHER_S):
            for key in keys:
                world = key.world
                for policy in policies:
                    over = await worker.ask("drive", key, policy)
                    assert isinstance(over, Episode)
                    found.append(over)
                    if not over.crashed and policy is policies[0]:
                        break
    except TimeoutError:
        raise DriveError(f"{world}: the sample's drives took longer than {ALTOGETHER_S:g} s") from None
    except EyechartError as error:
        raise DriveError(f"{world}: {printable(str(error))}") from error
    finally:
        worker.close()
    for one in found:
        if one.ended == "error" and len(one.steps) < setup.max_steps:
            raise DriveError(f"{one.key.world}: {printable(one.detail)}")
    return {key.scenario: max(len(one.steps) for one in found if one.key == key) for key in keys}


def _finished(planned: Episodes, left: Sequence[EpisodeKey]) -> dict[EpisodeKey, int]:
    """Return how many calls of each of these episodes are finished."""
    if not (planned.out / LEDGER).is_file():
        return {}
    with Ledger(planned.out / LEDGER) as ledger:
        return {key: len(calls) for key, calls in calls_of(left, planned.drivers, ledger).items()}


def sample_of(planned: Episodes, most: int = _PICTURES) -> Sample:
    """Return what a probe asks before drives: their words, with the first real picture of each of their first worlds.

    Worlds are opened in a process of their own. One that shows none is passed over; raises SpecError where none of
    ``most`` shows any.
    """
    keys = list({key.world: replace(key, condition="real") for key in planned.keys}.values())[:most]
    found, why = list[Stimulus](), ""
    for shown in asyncio.run(_shown(planned.setup, keys)):
        if isinstance(shown, str):
            why = shown
            continue
        found.append(through(planned.drivers.view, shown.stimulus, shown.frame))
    if not found:
        raise SpecError(f"no world of {planned.manifest.simulator} shows a picture to probe a model with: {why}")
    drivers = planned.drivers
    return Sample([(drivers.prompt, seen) for seen in found], drivers.answers)


async def _shown(setup: Setup, keys: Sequence[EpisodeKey]) -> list[Shown | str]:
    """Return what each world shows first, or in words why it shows nothing."""
    found: list[Shown | str] = []
    worker = LocalWorker(setup, patience_s=PATIENCE_S)
    try:
        for key in keys:
            if worker.dead:
                worker.close()
                worker = LocalWorker(setup, patience_s=PATIENCE_S)
            try:
                shown = await worker.ask("open", key)
                await worker.ask("close", key)
            except WorkerDiedError as error:
                shown = Episode(key, (), "error", "", str(error))
            assert isinstance(shown, Shown | Episode)
            found.append(shown if isinstance(shown, Shown) else printable(shown.detail))
    finally:
        worker.close()
    return found


def within(
    planned: Episodes,
    prices: Prices,
    *,
    calls: int | None = None,
    cost_usd: float | None = None,
    before: Spent = NOTHING,
) -> Limits:
    """Return the limits of a run: so many requests, so many dollars by these prices, with what was spent ``before``.

    What probing for the run took counts too.
    """
    return Limits(
        calls=calls,
        cost_usd=cost_usd,
        before=Spent.together([planned.manifest.spent_before(), before]),
        cost=lambda spec, reply: prices.cost(planned.manifest.mode(spec), reply)[0],
    )
