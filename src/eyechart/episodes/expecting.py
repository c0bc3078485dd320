"""What planned episodes are expected to take, what they may take, and what their worlds show first."""

from collections.abc import Sequence
from dataclasses import replace

from eyechart.costs import Estimate, estimate
from eyechart.episodes.nouns import Episode, EpisodeKey, fail_safe
from eyechart.episodes.planning import Episodes
from eyechart.episodes.recorded import recorded
from eyechart.episodes.running import calls_of
from eyechart.episodes.worlds import Worlds
from eyechart.errors import SpecError
from eyechart.ledger import Ledger
from eyechart.limits import NOTHING, Limits, Spent
from eyechart.manifest import LEDGER
from eyechart.models.prices import Prices
from eyechart.perception.view import through
from eyechart.policies import open_policy
from eyechart.simulators import open_simulator

_LONGEST_SAMPLE = 200


def expected(planned: Episodes, prices: Prices, *, concurrency: int) -> tuple[Estimate, ...]:
    """Return what the calls that are still to be made are expected to take, by model.

    An episode counts as long as one that brakes all the way, in the first of the seeds; that drive is made here. Of an
    episode that was cut the calls that are finished are not made again.
    """
    left = [key for key in planned.left() if key.policy in planned.drivers.models]
    if not left:
        return ()
    worlds = Worlds(replace(planned.setup, max_steps=min(planned.setup.max_steps, _LONGEST_SAMPLE)))
    simulator = open_simulator(planned.setup.simulator, actions=planned.setup.actions)
    brake = open_policy(f"constant:{fail_safe(simulator)}", planned.drivers.space, recorded)
    length = {
        scenario: len(worlds.drive(replace(key, policy="constant", seed=planned.manifest.seeds[0]), brake).steps)
        for scenario, key in {key.scenario: key for key in left}.items()
    }
    made = _finished(planned, left)
    return tuple(
        estimate(
            planned.manifest.mode(spec),
            sum(max(0, length[key.scenario] - made.get(key, 0)) for key in left if key.policy == spec),
            prices,
            concurrency=concurrency,
        )
        for spec in planned.drivers.models
    )


def _finished(planned: Episodes, left: Sequence[EpisodeKey]) -> dict[EpisodeKey, int]:
    """Return how many calls of each of these episodes are finished."""
    if not (planned.out / LEDGER).is_file():
        return {}
    with Ledger(planned.out / LEDGER) as ledger:
        return {key: len(calls) for key, calls in calls_of(left, planned.drivers, ledger).items()}


def first_pictures(planned: Episodes, most: int) -> tuple[bytes, ...]:
    """Return the first picture of each of the first worlds of a plan, as a model is shown it with real pictures.

    A world that shows none is passed over; raises SpecError where none of ``most`` shows any.
    """
    worlds, pictures, why = Worlds(planned.setup), list[bytes](), ""
    for key in list({key.world: replace(key, condition="real") for key in planned.keys}.values())[:most]:
        shown = worlds.open(key)
        if isinstance(shown, Episode):
            why = shown.detail
            continue
        picture = through(planned.drivers.view, shown.picture, shown.frame)
        assert picture is not None
        pictures.append(picture)
        worlds.close(key)
    if not pictures:
        raise SpecError(f"no world of {planned.manifest.simulator} shows a picture to probe a model with: {why}")
    return tuple(pictures)


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
