"""run() drives the study's parts one after another, under limits that bound all of them together."""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace

from eyechart.episodes import Bounds, Episodes, within
from eyechart.episodes import run as run_episodes
from eyechart.limits import Outcome, Spent
from eyechart.models.prices import Prices
from eyechart.studies.probed import spent

Watch = Callable[[str], AbstractContextManager[Callable[[int, int], None] | None]]
"""From a part's name to what lasts while it is driven, and is told of its progress."""

USUAL = Bounds()


def _unwatched(part: str) -> AbstractContextManager[None]:
    del part
    return nullcontext()


def run(
    planned: Mapping[str, Episodes],
    prices: Prices,
    *,
    bounds: Bounds = USUAL,
    calls: int | None = None,
    cost_usd: float | None = None,
    watch: Watch = _unwatched,
) -> Outcome:
    """Drive what is left of each part; a model that is set aside in one drives in no later one.

    ``calls`` and ``cost_usd`` bound the whole study: what the ledgers of its other parts hold counts too. Raises what
    `eyechart.episodes.run` raises.
    """
    aside: dict[str, str] = {}
    stopped, uncounted = None, 0
    for name, part in planned.items():
        here = replace(part, keys=tuple(key for key in part.keys if key.policy not in aside))
        if here.left():
            others = (other for other in planned.values() if other is not part)
            before = Spent.together(spent(other.out, other.manifest, prices) for other in others)
            limits = within(part, prices, calls=calls, cost_usd=cost_usd, before=before)
            with watch(name) as progress:
                outcome = run_episodes(here, bounds=replace(bounds, limits=limits), progress=progress)
            aside |= outcome.set_aside
            stopped, uncounted = stopped or outcome.stopped, max(uncounted, outcome.uncounted)
    return Outcome(aside, stopped, uncounted)
